/* progress.h: how far it is and how wrong it still is, on stderr */
#ifndef PROGRESS_H
#define PROGRESS_H

#include "hydra.h"

typedef struct progress {
    bool terminal;
    double last; /* when the last line was shown */
} progress;

void progress_begin(progress *p);
void progress_show(progress *p, const hydra_status *status);
/* Clears the bar and says what was reached. */
void progress_end(progress *p, const hydra_status *status);

#endif
