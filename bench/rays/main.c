/* The fastest rays: hydra against Embree, the same rays in the same run.

       make bench-rays                       about half an hour        QUICK=1 make bench-rays        under 45 seconds
       build/bench/rays [options] [files.obj]

       --scenes smooth,thin,clustered,foliage    --sizes 10k,260k,1m,4m       generated scenes (with files: none, unless named)
       --kinds primary,bounce1,bounce2,shadow,ao,random,builds               what to time (default all)
       --threads 1,2    --reps 5    --width 1024 (primary rays: width^2)    --rays 262144 (at most, of the other kinds)
       --eye x,y,z  --look x,y,z  --light x,y,z     instead of the scene's own          --no-peer       --no-check

   For every scene and kind of rays, all of the peer's modes (single, packets, streams; coherent or not) in all kinds of
   structure (medium and high quality, compact or not, robust or not) are tried on a sample; the best few, the best robust
   one and the best single one are then timed against hydra in turns. Ratios are hydra's speed over the peer's, medians
   over rounds. Speeds are by the processor time of the slowest thread. */
#include "rays.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

typedef struct options {
    bool quick, use_peer, check, counters;
    const char *scenes, *sizes, *kinds;
    int threads[8], thread_counts, repeats;
    uint32_t width;
    size_t most_rays;
    const char *eye, *look, *light;
    const char *files[64];
    int file_count;
} options;

/* Is the word one of a list with commas? No list has all words. */
static bool listed(const char *list, const char *word) {
    size_t length = strlen(word);
    for (const char *at = list; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL)
        if (!strncmp(at, word, length) && (at[length] == ',' || !at[length])) return true;
    return !list;
}

static size_t number(const char *text) {
    char *end;
    double value = strtod(text, &end);
    return (size_t)(value * (*end == 'k' ? 1e3 : *end == 'm' ? 1e6 : 1.0));
}

static void read_threads(options *o, const char *list) {
    o->thread_counts = 0;
    for (const char *at = list; at && o->thread_counts < 8; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        int n = atoi(at);
        if (n < 1 || n > 64) bench_stop("--threads", "1 to 64");
        o->threads[o->thread_counts++] = n;
    }
}

static bool read_option(options *o, const char *name, const char *value) {
    if (!strcmp(name, "--scenes"))
        o->scenes = value;
    else if (!strcmp(name, "--sizes"))
        o->sizes = value;
    else if (!strcmp(name, "--kinds"))
        o->kinds = value;
    else if (!strcmp(name, "--threads"))
        read_threads(o, value);
    else if (!strcmp(name, "--reps"))
        o->repeats = atoi(value) < 1 ? 1 : atoi(value) > 64 ? 64 : atoi(value);
    else if (!strcmp(name, "--width"))
        o->width = (uint32_t)number(value);
    else if (!strcmp(name, "--rays"))
        o->most_rays = number(value);
    else if (!strcmp(name, "--eye"))
        o->eye = value;
    else if (!strcmp(name, "--look"))
        o->look = value;
    else if (!strcmp(name, "--light"))
        o->light = value;
    else
        return false;
    return true;
}

static options read_options(int argc, char **argv) {
    const char *quick = getenv("QUICK");
    options o = {.quick = quick && *quick && strcmp(quick, "0"), .use_peer = true, .check = true, .repeats = 5, .width = 1024};
    o.most_rays = 262144;
    read_threads(&o, "1,2");
    if (o.quick) {
        o.width = 512, o.most_rays = 65536;
        read_threads(&o, "1");
    }
    for (int i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "--no-peer"))
            o.use_peer = false;
        else if (!strcmp(argv[i], "--no-check"))
            o.check = false;
        else if (!strncmp(argv[i], "--", 2) && i + 1 < argc && read_option(&o, argv[i], argv[i + 1]))
            i++;
        else if (!strncmp(argv[i], "--", 2))
            bench_stop(argv[i], "no such option, or it lacks its value");
        else if (o.file_count < 64)
            o.files[o.file_count++] = argv[i];
    }
    if (o.width < 8 || o.width > 4096 || (o.width & (o.width - 1))) bench_stop("--width", "a power of two, 8 to 4096");
    return o;
}

static void read_point(float point[3], const char *text) {
    if (text && sscanf(text, "%f,%f,%f", &point[0], &point[1], &point[2]) != 3) bench_stop(text, "not a point x,y,z");
}

/* ---- one scene */

static hydra_scene *scene_of(hydra_context *context, const geometry *g) {
    hydra_scene *scene = hydra_scene_create(context);
    hydra_mesh_desc mesh = {.positions = {g->positions, 12, g->vertices}, .indices = {g->indices, 4, 3 * g->triangles}};
    hydra_scene_add_mesh(scene, &mesh);
    if (hydra_scene_commit(scene) != HYDRA_OK) bench_stop("hydra_scene_commit", hydra_error_text(context));
    return scene;
}

typedef struct job {
    const options *o;
    const geometry *g;
    hydra_scene *scene;
    peer *p;          /* NULL: none */
    reference *truth; /* NULL: not checked */
    ray_set sets[KIND_COUNT];
    search searches[KIND_COUNT];
} job;

static bool wanted(const job *j, int kind) { return listed(j->o->kinds, kind_names[kind]) && j->sets[kind].count; }

static bool in_a_final(const job *j, int variant) {
    for (int k = 0; k < KIND_COUNT; k++) {
        candidate finalists[MAX_FINALISTS];
        int count = search_finalists(&j->searches[k], finalists);
        for (int i = 0; i < count; i++)
            if (finalists[i].variant == variant) return true;
    }
    return false;
}

static void search_all(job *j) {
    size_t few = j->o->quick ? 4096 : 32768;
    for (int v = 0; j->p && v < PEER_VARIANTS; v++) {
        if (j->o->quick && peer_variant_compact(v)) continue;
        peer_build(j->p, v);
        for (int k = 0; k < KIND_COUNT; k++) {
            if (!wanted(j, k)) continue;
            ray_set sample = ray_set_sample(&j->sets[k], few);
            search_variant(&j->searches[k], j->p, v, &sample);
            ray_set_free(&sample);
        }
        for (int past = 0; past <= v; past++)
            if (!in_a_final(j, past)) peer_release(j->p, past);
    }
}

static void check(const job *j, const ray_set *set, tracer *tracers, int best, int robust) {
    answer *ours = bench_alloc(set->count * sizeof *ours), *theirs = bench_alloc(set->count * sizeof *theirs);
    tracers[0].read(&tracers[0], ours, set->count);
    compare_sample(j->g->name, set, ours, j->truth);
    tracers[1].read(&tracers[1], theirs, set->count);
    for (size_t i = 0; i < set->count; i++)
        if (ours[i].t != theirs[i].t || ours[i].primitive != theirs[i].primitive) {
            compare_answers(j->g->name, set, ours, theirs, "hydra's single calls", j->truth);
            break;
        }
    for (int side = 0; side < 2; side++) {
        int who = side ? robust : best;
        if (who < 0 || (side && robust == best)) continue;
        tracers[who].read(&tracers[who], theirs, set->count);
        compare_answers(j->g->name, set, ours, theirs, tracers[who].name, j->truth);
    }
    free(ours);
    free(theirs);
}

/* The fastest of those tracers that are robust, or single, if that is asked. */
static int fastest(const tracer *tracers, const double *medians, int count, bool robust, bool single) {
    int best = -1;
    for (int i = 2; i < count; i++)
        if ((!robust || tracers[i].robust) && (!single || tracers[i].single) && (best < 0 || medians[i] < medians[best])) best = i;
    return best;
}

/* tracers: hydra's batch, hydra's single, then the peer's. */
static void time_kind(const job *j, const ray_set *set, int threads, bool checked) {
    enum { MOST = 2 + MAX_FINALISTS };
    tracer tracers[MOST] = {hydra_tracer(j->scene, set->any, false), hydra_tracer(j->scene, set->any, true)};
    candidate finalists[MAX_FINALISTS];
    int count = 2, n = search_finalists(&j->searches[set->kind], finalists), repeats = j->o->repeats;
    for (int i = 0; i < n; i++) tracers[count++] = peer_tracer(j->p, finalists[i].variant, finalists[i].mode, set->any);
    double times[MOST * 64], medians[MOST], mega = 1e-6 * (double)set->count;
    time_alternating(tracers, count, set, threads, repeats, times);
    for (int i = 0; i < count; i++) medians[i] = median(times + i * repeats, repeats);
    ray_row row = {.kind = set->kind, .threads = threads, .rays = set->count, .batch = mega / medians[0], .single = mega / medians[1]};
    memcpy(row.scene, j->g->name, sizeof row.scene);
    int best = fastest(tracers, medians, count, false, false), robust = fastest(tracers, medians, count, true, false);
    int single = fastest(tracers, medians, count, false, true);
    if (best >= 0) {
        row.peer_best = mega / medians[best], row.peer_robust = mega / medians[robust], row.peer_single = mega / medians[single];
        row.ratio = median_ratio(times + best * repeats, times, repeats);
        row.ratio_robust = median_ratio(times + robust * repeats, times, repeats);
        row.ratio_single = median_ratio(times + single * repeats, times + repeats, repeats);
        memcpy(row.best_name, tracers[best].name, sizeof row.best_name);
        memcpy(row.robust_name, tracers[robust].name, sizeof row.robust_name);
    }
    for (int side = 0; side < 2 && threads == 1 && j->o->counters; side++) {
        int who = side ? best : 0;
        if (who < 0) continue;
        tracers[who].fill(&tracers[who], set);
        trace_counted(&tracers[who], set->count, row.counted[side]);
    }
    report_rays(&row);
    if (checked) check(j, set, tracers, best, robust);
    for (int i = 0; i < count; i++) tracers[i].empty(&tracers[i]);
}

static void make_sets(job *j) {
    ray_sets_make(j->sets, j->g, j->scene, j->o->width);
    for (int k = 0; k < KIND_COUNT; k++) {
        if ((k == KIND_PRIMARY && !j->o->quick) || j->sets[k].count <= j->o->most_rays) continue;
        ray_set few = ray_set_sample(&j->sets[k], j->o->most_rays);
        ray_set_free(&j->sets[k]);
        j->sets[k] = few;
    }
}

static void run_scene(const options *o, hydra_context *context, geometry *g) {
    job j = {.o = o, .g = g};
    bool any_kind = false;
    read_point(g->eye, o->eye);
    read_point(g->look, o->look);
    read_point(g->light, o->light);
    for (int k = 0; k < KIND_COUNT; k++) any_kind |= listed(o->kinds, kind_names[k]);
    printf("%s: %zu triangles\n", g->name, g->triangles);
    if (listed(o->kinds, "builds")) bench_builds(context, g, o->use_peer, o->repeats);
    if (!any_kind) return;
    j.scene = scene_of(context, g);
    j.p = o->use_peer ? peer_open(g) : NULL;
    j.truth = o->check ? reference_build(g) : NULL;
    make_sets(&j);
    search_all(&j);
    for (int t = 0; t < o->thread_counts; t++)
        for (int k = 0; k < KIND_COUNT; k++)
            if (wanted(&j, k)) time_kind(&j, &j.sets[k], o->threads[t], j.truth && t == 0);
    for (int k = 0; k < KIND_COUNT; k++) ray_set_free(&j.sets[k]);
    reference_free(j.truth);
    if (j.p) peer_close(j.p);
    hydra_scene_destroy(j.scene);
}

/* ---- all scenes */

static void run_files(const options *o, hydra_context *context) {
    for (int i = 0; i < o->file_count; i++) {
        geometry g;
        if (!geometry_read_obj(&g, o->files[i])) bench_stop(o->files[i], "no triangles could be read");
        run_scene(o, context, &g);
        geometry_free(&g);
    }
}

static void run_generated(const options *o, hydra_context *context) {
    static const char *const sizes[4] = {"10k", "260k", "1m", "4m"};
    static const char *const quick[4] = {"10k", "10k", "260k", "10k"}; /* one of each kind of scene */
    if (o->file_count && !o->scenes && !o->sizes) return;
    for (int kind = 0; kind < 4; kind++)
        for (int size = 0; size < 4; size++) {
            geometry g;
            if (!listed(o->scenes, scene_kinds[kind]) || !listed(o->sizes, sizes[size])) continue;
            if (o->quick && !o->sizes && strcmp(sizes[size], quick[kind])) continue;
            geometry_generate(&g, kind, number(sizes[size]));
            run_scene(o, context, &g);
            geometry_free(&g);
        }
}

static const char *isa_name(hydra_isa isa) {
    switch (isa) {
    case HYDRA_ISA_SSE42: return "SSE4.2";
    case HYDRA_ISA_AVX2: return "AVX2";
    case HYDRA_ISA_AVX512: return "AVX-512";
    case HYDRA_ISA_NEON: return "NEON";
    default: return "scalar";
    }
}

int main(int argc, char **argv) {
    options o = read_options(argc, argv);
    char text[128];
    hydra_context *context = hydra_create(NULL);
    if (!context) bench_stop("hydra_create", "no context");
    bool installed = peer_installed(text);
    printf("hydra %d.%d (%s) against %s; %u threads build\n", HYDRA_VERSION_MAJOR, HYDRA_VERSION_MINOR,
           isa_name(hydra_context_isa(context)), text, hydra_context_threads(context));
    o.use_peer = o.use_peer && installed;
    o.counters = counters_work();
    mkdir("build", 0777);
    mkdir("build/bench", 0777);
    report_begin();
    run_files(&o, context);
    run_generated(&o, context);
    report_end(o.use_peer);
    hydra_destroy(context);
    return compare_wrong() ? 1 : 0;
}
