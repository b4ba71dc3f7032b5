/* Tables, the CSV file, and how each goal was met. */
#include "rays.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MAX_ROWS = 1024 };

static ray_row rays[MAX_ROWS];
static build_row builds[MAX_ROWS];
static int ray_rows, build_rows;
static FILE *csv, *builds_csv;

static void print_rays_header(void) {
    printf("\n%-14s %-8s %2s %9s | %7s %7s | %7s %7s %-26s | %7s %-24s | %7s\n", "Mray/s", "", "", "hydra", "", "ratio", "peer's", "ratio",
           "by its best mode", "robust", "by its best robust mode", "single");
    printf("%-14s %-8s %2s %9s | %7s %7s | %7s %7s %-26s | %7s %-24s | %7s\n", "scene", "rays", "th", "count", "batch", "single", "best",
           "", "", "ratio", "", "ratio");
}

static FILE *open_csv(const char *path, const char *columns) {
    FILE *file = fopen(path, "w");
    if (file)
        fprintf(file, "%s\n", columns);
    else
        printf("%s cannot be written\n", path);
    return file;
}

void report_begin(void) {
    csv = open_csv("build/bench/rays.csv",
                   "scene,kind,threads,rays,batch,single,peer_best,best_mode,ratio,peer_robust,robust_mode,ratio_robust,peer_single,"
                   "ratio_single,instructions,cycles,misses,peer_instructions,peer_cycles,peer_misses");
    builds_csv =
        open_csv("build/bench/rays_builds.csv", "scene,job,triangles,seconds,peer_seconds,ratio,bytes_per_triangle,peer_bytes_per_triangle,"
                                                "bounce1_mrays,peer_bounce1_mrays");
}

static void print_counted(const char *who, const double counted[COUNTERS]) {
    if (counted[COUNTER_INSTRUCTIONS] > 0.0)
        printf("  %s, per ray: %.0f instructions, %.0f cycles, %.2f cache misses\n", who, counted[COUNTER_INSTRUCTIONS],
               counted[COUNTER_CYCLES], counted[COUNTER_MISSES]);
}

void report_rays(const ray_row *r) {
    if (ray_rows % 24 == 0) print_rays_header();
    if (ray_rows < MAX_ROWS) rays[ray_rows] = *r;
    ray_rows++;
    printf("%-14s %-8s %2d %9zu | %7.2f %7.2f |", r->scene, kind_names[r->kind], r->threads, r->rays, r->batch, r->single);
    if (r->peer_best > 0.0)
        printf(" %7.2f %7.2f %-26s | %7.2f %-24s | %7.2f", r->peer_best, r->ratio, r->best_name, r->ratio_robust, r->robust_name,
               r->ratio_single);
    printf("\n");
    print_counted("hydra", r->counted[0]);
    print_counted("peer", r->counted[1]);
    fflush(stdout);
    if (!csv) return;
    fprintf(csv, "%s,%s,%d,%zu,%.4f,%.4f,%.4f,%s,%.4f,%.4f,%s,%.4f,%.4f,%.4f", r->scene, kind_names[r->kind], r->threads, r->rays, r->batch,
            r->single, r->peer_best, r->best_name, r->ratio, r->peer_robust, r->robust_name, r->ratio_robust, r->peer_single,
            r->ratio_single);
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < COUNTERS; i++) fprintf(csv, ",%.2f", r->counted[side][i]);
    fprintf(csv, "\n");
}

static const char *const job_names[BUILD_JOBS] = {"build BEST against high", "build FAST against medium", "build FAST against low",
                                                  "refit"};

static void write_build(const build_row *b, int job) {
    const build_cost *ours = &b->ours[job], *theirs = &b->theirs[job];
    double n = (double)b->triangles;
    fprintf(builds_csv, "%s,%s,%zu,%.6f,%.6f,%.4f,%.2f,%.2f,%.3f,%.3f\n", b->scene, job_names[job], b->triangles, ours->seconds,
            theirs->seconds, theirs->seconds / ours->seconds, (double)ours->bytes / n, (double)theirs->bytes / n, ours->speed,
            theirs->speed);
}

void report_build(const build_row *b) {
    double n = (double)b->triangles;
    if (build_rows < MAX_ROWS) builds[build_rows] = *b;
    build_rows++;
    for (int j = 0; j < BUILD_JOBS; j++) {
        const build_cost *ours = &b->ours[j], *theirs = &b->theirs[j];
        if (!(ours->seconds > 0.0)) continue;
        printf("  %s: hydra %.1f ms, bounce 1 then %.2f Mray/s", job_names[j], 1e3 * ours->seconds, ours->speed);
        if (ours->bytes) printf(", %.1f bytes a triangle", (double)ours->bytes / n);
        if (theirs->seconds > 0.0) printf("; peer %.1f ms, %.2f Mray/s", 1e3 * theirs->seconds, theirs->speed);
        if (theirs->bytes) printf(", %.1f bytes", (double)theirs->bytes / n);
        printf("\n");
        if (builds_csv) write_build(b, j);
    }
    fflush(stdout);
}

/* ---- goals: the geometric mean over scenes, and the least */

typedef struct mean {
    double log_sum, least;
    int count;
    const char *where;
} mean;

static void add_to_mean(mean *m, double ratio, const char *where) {
    if (!(ratio > 0.0)) return;
    if (!m->count || ratio < m->least) m->least = ratio, m->where = where;
    m->log_sum += log(ratio);
    m->count++;
}

static double mean_of(const mean *m) { return exp(m->log_sum / m->count); }

static void goal(const char *name, double measured, double target, bool ok) {
    printf("goal %s %.3f %g %s\n", name, measured, target, ok ? "ok" : "short");
}

static void print_mean(const char *what, const mean *m) {
    if (m->count) printf("%-40s geometric mean %.3f over %d, least %.3f (%s)\n", what, mean_of(m), m->count, m->least, m->where);
}

/* name NULL: only the summary. */
static void end_ratio(const char *name, const char *what, const mean *m, double target) {
    print_mean(what, m);
    if (m->count && name) goal(name, mean_of(m), target, mean_of(m) >= target);
}

/* Goals are per thread, so they are judged with one where one was run. */
static void end_rays(int kind, int threads, bool judged, double target) {
    mean best = {.count = 0}, robust = {.count = 0};
    char what[64];
    for (int i = 0; i < ray_rows && i < MAX_ROWS; i++) {
        if (rays[i].kind != kind || rays[i].threads != threads) continue;
        add_to_mean(&best, rays[i].ratio, rays[i].scene);
        add_to_mean(&robust, rays[i].ratio_robust, rays[i].scene);
    }
    snprintf(what, sizeof what, "%s, %d thread%s, robust peer", kind_names[kind], threads, threads > 1 ? "s" : "");
    end_ratio(NULL, what, &robust, 0.0);
    snprintf(what, sizeof what, "%s, %d thread%s", kind_names[kind], threads, threads > 1 ? "s" : "");
    end_ratio(judged ? kind_names[kind] : NULL, what, &best, target);
}

/* Single calls answer what cannot be batched, so incoherent closest hits. */
static void end_single(int threads, bool judged) {
    mean m = {.count = 0};
    for (int i = 0; i < ray_rows && i < MAX_ROWS; i++)
        if ((rays[i].kind == KIND_BOUNCE1 || rays[i].kind == KIND_BOUNCE2) && rays[i].threads == threads)
            add_to_mean(&m, rays[i].ratio_single, rays[i].scene);
    end_ratio(judged ? "single" : NULL, threads > 1 ? "single calls, bounces, threads" : "single calls, bounces", &m, 1.0);
}

/* equal: the time counts only if rays are then as fast as in the peer's structure. */
static void end_build(const char *name, build_job job, bool equal) {
    mean time = {.count = 0}, speed = {.count = 0};
    char what[64];
    for (int i = 0; i < build_rows && i < MAX_ROWS; i++) {
        const build_cost *ours = &builds[i].ours[job], *theirs = &builds[i].theirs[job];
        if (!(ours->seconds > 0.0)) continue;
        add_to_mean(&time, theirs->seconds / ours->seconds, builds[i].scene);
        add_to_mean(&speed, ours->speed / theirs->speed, builds[i].scene);
    }
    snprintf(what, sizeof what, "%s, rays after it", job_names[job]);
    if (!time.count || !speed.count) return;
    print_mean(what, &speed);
    print_mean(job_names[job], &time);
    goal(name, mean_of(&time), 1.0, mean_of(&time) >= 1.0 && (!equal || mean_of(&speed) >= 1.0));
}

static void end_builds(void) {
    mean bytes = {.count = 0};
    double most = 0.0;
    end_build("build", BUILD_BEST, true);
    end_build("fast_build_medium", BUILD_FAST, false);
    end_build("fast_build", BUILD_FASTEST, false);
    end_build("refit", BUILD_REFIT, false);
    for (int i = 0; i < build_rows && i < MAX_ROWS; i++) {
        double ours = (double)builds[i].ours[BUILD_BEST].bytes, each = ours / (double)builds[i].triangles;
        add_to_mean(&bytes, (double)builds[i].theirs[BUILD_BEST].bytes / ours, builds[i].scene);
        if (each > most) most = each;
    }
    end_ratio("bytes_peer", "bytes, peer's over hydra's", &bytes, 1.0);
    if (most > 0.0) goal("bytes", most, 60.0, most < 60.0); /* the most of any scene */
}

static bool have_threads(int threads) {
    for (int i = 0; i < ray_rows && i < MAX_ROWS; i++)
        if (rays[i].threads == threads) return true;
    return false;
}

void report_end(bool peer_used) {
    static const double targets[KIND_COUNT] = {1.2, 1.3, 1.3, 1.3, 1.3, 0.0};
    if (!ray_rows && !build_rows) bench_stop("nothing to time", "look at --scenes, --sizes and --kinds");
    if (csv) fclose(csv);
    if (builds_csv) fclose(builds_csv);
    printf("\n");
    compare_end();
    if (!peer_used) printf("no peer, so no ratios and no goals but those of bytes\n");
    int judged = have_threads(1) ? 1 : ray_rows ? rays[0].threads : 0;
    for (int pass = 0; pass < 2; pass++) /* what is judged comes last, in lines of its own */
        for (int threads = 1; threads <= 64; threads++)
            if ((threads == judged) == (pass == 1) && have_threads(threads)) {
                for (int k = 0; k < KIND_COUNT; k++) end_rays(k, threads, pass == 1 && targets[k] > 0.0, targets[k]);
                end_single(threads, pass == 1);
            }
    end_builds();
}
