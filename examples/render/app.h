/* app.h: messages and exit codes, shared by all parts of the renderer */
#ifndef APP_H
#define APP_H

#include <stdbool.h>
#include <stddef.h>

enum {
    APP_DONE = 0,   /* the picture is complete */
    APP_USAGE = 1,  /* the command line is wrong, or a target cannot be written */
    APP_INPUT = 2,  /* a file cannot be read or says impossible things */
    APP_DEVICE = 3, /* memory, threads or the machine */
    APP_STOPPED = 4 /* Ctrl-C: what there was is written */
};

/* Quiet leaves only errors on stderr. */
void app_set_quiet(bool quiet);
bool app_is_quiet(void);

/* What is wrong, which file, what to do; one line on stderr each. */
#if defined(__GNUC__)
#define APP_PRINTF __attribute__((format(printf, 1, 2)))
#else
#define APP_PRINTF
#endif
void app_error(const char *format, ...) APP_PRINTF;
/* The same warning (by its format) is shown five times, then summed up by app_flush_warnings. */
void app_warning(const char *format, ...) APP_PRINTF;
void app_flush_warnings(void);

/* Seconds on a monotonic clock. */
double app_seconds(void);

/* The whole file, with a zero byte behind it; NULL with a message when it cannot be read or is above the limit. */
char *app_read_file(const char *path, size_t limit, size_t *size);

/* malloc and realloc of count elements that end the program with APP_DEVICE when there is no memory. */
void *app_alloc(size_t count, size_t size);
void *app_realloc(void *memory, size_t count, size_t size);
char *app_copy(const char *text);

#endif
