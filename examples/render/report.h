/* report.h: what --stats prints */
#ifndef REPORT_H
#define REPORT_H

#include "import.h"

typedef struct report {
    double load_seconds;   /* import, textures and environment */
    double commit_seconds; /* the whole commit, the trees included */
    double write_seconds;
} report;

void report_print(const report *times, const imported *scene_file, hydra_context *context, const hydra_scene *scene,
                  const hydra_status *status);

#endif
