/* progress.c: see progress.h. A bar on a terminal, a line every ten seconds elsewhere, nothing when quiet. */
#include "progress.h"

#include "app.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { BAR = 24, LINE = 256 };

void progress_begin(progress *p) {
    p->terminal = isatty(STDERR_FILENO) != 0;
    p->last = app_seconds();
}

static void describe_error(char *line, size_t size, const hydra_status *status) {
    if (!isfinite(status->error))
        snprintf(line, size, "error not known yet");
    else
        snprintf(line, size, "error %.2f %% (%.2f to %.2f)", 100.0 * status->error, 100.0 * status->error_low, 100.0 * status->error_high);
}

static void describe_time(char *line, size_t size, double seconds) {
    if (!isfinite(seconds))
        snprintf(line, size, "time left unknown");
    else if (seconds < 100.0)
        snprintf(line, size, "%.0f s left", ceil(seconds));
    else if (seconds < 6000.0)
        snprintf(line, size, "%.0f min left", ceil(seconds / 60.0));
    else
        snprintf(line, size, "%.1f h left", seconds / 3600.0);
}

static void describe(char *line, size_t size, const hydra_status *status) {
    char error[64], left[32];
    describe_error(error, sizeof error, status);
    describe_time(left, sizeof left, status->seconds_left);
    snprintf(line, size, "%3.0f %%  %.1f samples  %s  %s", 100.0 * status->fraction, status->samples, error, left);
}

void progress_show(progress *p, const hydra_status *status) {
    double now = app_seconds();
    if (app_is_quiet() || now - p->last < (p->terminal ? 0.1 : 10.0)) return;
    p->last = now;
    char line[LINE], bar[BAR + 1];
    describe(line, sizeof line, status);
    if (!p->terminal) {
        fprintf(stderr, "hydra-render: %s\n", line);
        return;
    }
    int full = (int)(status->fraction * BAR + 0.5);
    for (int i = 0; i < BAR; i++) bar[i] = i < full ? '#' : '.';
    bar[BAR] = '\0';
    fprintf(stderr, "\r\033[K[%s] %s", bar, line);
    fflush(stderr);
}

void progress_end(progress *p, const hydra_status *status) {
    if (app_is_quiet()) return;
    char error[64];
    describe_error(error, sizeof error, status);
    if (p->terminal) fputs("\r\033[K", stderr);
    fprintf(stderr, "hydra-render: %.1f samples a pixel in %.2f s, %s\n", status->samples, status->seconds, error);
    if (status->heavy_pixels > 0)
        fprintf(stderr, "hydra-render: note: %llu pixels have rare bright samples; their error bars are not to be trusted\n",
                (unsigned long long)status->heavy_pixels);
}
