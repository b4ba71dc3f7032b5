/* guard.h: model files come from anywhere, and importers crash on some: between begin and end a crash, a hang or
   hunger for memory ends the program with a message that names the file, and APP_INPUT */
#ifndef GUARD_H
#define GUARD_H

void guard_begin(const char *path);
void guard_end(void);

#endif
