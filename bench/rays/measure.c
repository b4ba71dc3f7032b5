/* Timing: only tracing is inside the clock, rays are laid out afresh before it, sides take turns. */
#include "rays.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

void bench_stop(const char *what, const char *why) {
    fprintf(stderr, "rays: %s: %s\n", what, why);
    exit(1);
}

void *bench_alloc(size_t size) {
    void *memory = NULL;
    if (posix_memalign(&memory, 64, size ? size : 1)) bench_stop("memory", "there is none");
    return memory;
}

static double clock_seconds(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

double wall_seconds(void) { return clock_seconds(CLOCK_MONOTONIC); }

typedef struct share {
    const tracer *tracer;
    size_t first, count;
    double seconds;
    pthread_barrier_t *start;
} share;

/* Processor time, not wall time: tracing neither waits nor asks the system for anything, so on a quiet machine the two
   are equal, and on a shared one only this is a property of the tracer. */
static void *run_share(void *argument) {
    share *s = argument;
    if (s->start) pthread_barrier_wait(s->start);
    double from = clock_seconds(CLOCK_THREAD_CPUTIME_ID);
    s->tracer->trace(s->tracer, s->first, s->count);
    s->seconds = clock_seconds(CLOCK_THREAD_CPUTIME_ID) - from;
    return NULL;
}

enum { MAX_THREADS = 64 };

double trace_seconds(const tracer *t, size_t count, int threads) {
    share shares[MAX_THREADS];
    pthread_t ids[MAX_THREADS];
    pthread_barrier_t start;
    if (threads > MAX_THREADS) threads = MAX_THREADS;
    size_t step = (count / (size_t)threads + SHARE_STEP - 1) / SHARE_STEP * SHARE_STEP;
    pthread_barrier_init(&start, NULL, (unsigned)threads);
    for (int i = 0; i < threads; i++) {
        size_t first = (size_t)i * step < count ? (size_t)i * step : count;
        size_t end = i + 1 < threads && first + step < count ? first + step : count;
        shares[i] = (share){t, first, end - first, 0.0, threads > 1 ? &start : NULL};
        if (i && pthread_create(&ids[i], NULL, run_share, &shares[i])) bench_stop("pthread_create", "no thread");
    }
    run_share(&shares[0]);
    double longest = shares[0].seconds;
    for (int i = 1; i < threads; i++) {
        pthread_join(ids[i], NULL);
        if (shares[i].seconds > longest) longest = shares[i].seconds;
    }
    pthread_barrier_destroy(&start);
    return longest;
}

void time_alternating(tracer *tracers, int tracer_count, const ray_set *set, int threads, int repeats, double *times) {
    for (int r = 0; r < repeats; r++)
        for (int i = 0; i < tracer_count; i++) {
            tracers[i].fill(&tracers[i], set);
            times[i * repeats + r] = trace_seconds(&tracers[i], set->count, threads);
        }
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double median(const double *values, int count) {
    double sorted[64];
    if (count > 64) count = 64;
    if (count < 1) return 0.0;
    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    return 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
}

double median_ratio(const double *a, const double *b, int count) {
    double ratios[64];
    if (count > 64) count = 64;
    for (int i = 0; i < count; i++) ratios[i] = a[i] / b[i];
    return median(ratios, count);
}
