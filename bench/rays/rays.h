/* What the files of bench/rays share: a scene's triangles, sets of rays, and tracers, which are one way each of one
   library to answer a set. Everything that is timed is a tracer, so that no library is timed differently from another. */
#ifndef BENCH_RAYS_H
#define BENCH_RAYS_H

#include "hydra.h"

/* ---- geometry (geometry.c, scenes.c, obj.c) */

typedef struct geometry {
    char name[64];
    float *positions;  /* x, y, z; 16 bytes more than it needs, which Embree asks for in shared buffers */
    uint32_t *indices; /* three a triangle */
    size_t vertices, triangles;
    float eye[3], look[3]; /* where primary rays start, and a point they go towards */
    float light[3];        /* the middle of what shadow rays go towards */
    float bounds[2][3];
} geometry;

extern const char *const scene_kinds[4];
/* Of about so many triangles. */
void geometry_generate(geometry *g, int scene_kind, size_t triangles);
/* false: no triangles in it, or no such file. */
bool geometry_read_obj(geometry *g, const char *path);
void geometry_free(geometry *g);
float geometry_size(const geometry *g); /* diagonal of the bounds */

/* Collects triangles. */
typedef struct maker {
    float *positions;
    uint32_t *indices;
    size_t vertices, triangles, vertex_room, triangle_room;
} maker;
uint32_t maker_vertex(maker *m, float x, float y, float z);
void maker_triangle(maker *m, uint32_t a, uint32_t b, uint32_t c);
void maker_finish(maker *m, geometry *g); /* empties m; sets all of g but name, eye, look, light */

/* Random numbers of a counter, so that no part depends on how many another drew. */
uint32_t hash_u32(uint32_t seed, uint32_t i);
float hash_float(uint32_t seed, uint32_t i); /* [0, 1) */

/* ---- ray sets (raysets.c) */

enum { KIND_PRIMARY, KIND_BOUNCE1, KIND_BOUNCE2, KIND_SHADOW, KIND_AO, KIND_RANDOM, KIND_COUNT };
extern const char *const kind_names[KIND_COUNT];

typedef struct ray_set {
    int kind;
    bool any; /* asks only whether anything is hit */
    hydra_ray *rays;
    size_t count;
} ray_set;

/* Primary rays are width x width. The rays of later kinds start where hydra's hits of the earlier ones are. */
void ray_sets_make(ray_set sets[KIND_COUNT], const geometry *g, const hydra_scene *scene, uint32_t width);
/* Runs of neighbouring rays from all over the set: as coherent as the whole, and short. */
ray_set ray_set_sample(const ray_set *set, size_t count);
void ray_set_free(ray_set *set);

/* ---- tracers (hydra.c) */

typedef struct answer {
    float t;            /* negative: no hit; in sets that ask for any hit 0 stands for one */
    uint32_t primitive; /* HYDRA_NONE in those */
} answer;

#define SHARE_STEP 64 /* threads' shares of a set begin at multiples of this, so that packets are whole */

typedef struct tracer {
    char name[48];
    bool robust, single;
    void *self;
    int mode;
    bool any;
    void *data;                                              /* rays and room for answers, in the library's own layout */
    void (*fill)(struct tracer *tracer, const ray_set *set); /* untouched rays; not timed */
    void (*trace)(const struct tracer *tracer, size_t first, size_t count);
    void (*read)(const struct tracer *tracer, answer *answers, size_t count);
    void (*empty)(struct tracer *tracer); /* releases data */
} tracer;

tracer hydra_tracer(const hydra_scene *scene, bool any, bool single);

/* How a structure was made or mended, and what it takes. */
typedef struct build_cost {
    double seconds;
    size_t bytes;
    double speed; /* of bounce rays through it, Mray/s, one thread */
} build_cost;

typedef enum build_job { BUILD_BEST, BUILD_FAST, BUILD_FASTEST, BUILD_REFIT, BUILD_JOBS } build_job;

/* ---- the peer (peer_embree.c, peer_embree_build.c) */

typedef struct peer peer;
enum { PEER_VARIANTS = 8, PEER_MODES = 11 };

bool peer_installed(char text[128]); /* text: its name and version, or that it is not there */
peer *peer_open(const geometry *g);
void peer_close(peer *p);
bool peer_variant_compact(int variant);
void peer_build(peer *p, int variant);
void peer_release(peer *p, int variant);
/* trace is NULL where the peer cannot be trusted with this combination. */
tracer peer_tracer(peer *p, int variant, int mode, bool any);

typedef struct peer_builder peer_builder;
/* g NULL: one whose every cost is 0. */
peer_builder *peer_builder_open(const geometry *g);
void peer_builder_close(peer_builder *b);
/* Until the next run the structure stays. */
build_cost peer_builder_run(peer_builder *b, build_job job);
/* Packets of 8, closest hits, in the structure of the last run; trace NULL without a peer. */
tracer peer_builder_tracer(const peer_builder *b);
/* For a scene of the peer's own kind. */
tracer peer_scene_tracer(void *scene, int width);

/* ---- builds.c */

/* Times all build jobs and reports them; g's vertices are moved meanwhile and put back. */
void bench_builds(hydra_context *context, geometry *g, bool use_peer, int repeats);

/* ---- the best of the peer's ways (search.c) */

enum { MAX_FINALISTS = 6 };
typedef struct candidate {
    int variant, mode;
    bool robust, single;
    double seconds;
} candidate;
typedef struct search {
    candidate found[PEER_VARIANTS * PEER_MODES];
    int count;
} search;
void search_variant(search *s, peer *p, int variant, const ray_set *sample);
/* The fastest few, and the fastest robust and the fastest single one if they are not among those. */
int search_finalists(const search *s, candidate finalists[MAX_FINALISTS]);

/* ---- the truth (reference.c) and who disagrees (compare.c) */

typedef struct reference reference;
typedef enum verdict { VERDICT_RIGHT, VERDICT_EDGE, VERDICT_WRONG } verdict;
reference *reference_build(const geometry *g);
void reference_free(reference *r);
verdict reference_judge(const reference *r, const hydra_ray *ray, answer given, bool any);

void compare_sample(const char *scene, const ray_set *set, const answer *answers, const reference *truth);
void compare_answers(const char *scene, const ray_set *set, const answer *ours, const answer *theirs, const char *their_name,
                     const reference *truth);
void compare_end(void);            /* prints what came of all comparisons */
unsigned long compare_wrong(void); /* answers of hydra's found wrong so far */

/* ---- measuring (measure.c) */

void *bench_alloc(size_t size); /* aligned to 64; ends the program when there is no memory */
void bench_stop(const char *what, const char *why);
double wall_seconds(void);
/* The slowest thread's time over a set already filled in, by the processor time that its thread took. */
double trace_seconds(const tracer *t, size_t count, int threads);
/* times[i * repeats + r]: tracer i in round r; in every round each is filled and timed once. */
void time_alternating(tracer *tracers, int tracer_count, const ray_set *set, int threads, int repeats, double *times);
double median(const double *values, int count);
/* Median over rounds of a's time over b's. */
double median_ratio(const double *a, const double *b, int count);

enum { COUNTER_INSTRUCTIONS, COUNTER_CYCLES, COUNTER_MISSES, COUNTERS };
/* Does the machine let programs count (counters.c)? Says so if not. */
bool counters_work(void);
/* One run in the calling thread over a set filled in; counts are per ray. */
void trace_counted(const tracer *t, size_t count, double counted[COUNTERS]);

/* ---- report (report.c) */

typedef struct ray_row {
    char scene[64];
    int kind, threads;
    size_t rays;
    double batch, single, peer_best, peer_robust, peer_single; /* Mray/s; the peer's are 0 without it */
    double ratio, ratio_robust, ratio_single;                  /* medians over rounds */
    char best_name[48], robust_name[48];
    double counted[2][COUNTERS]; /* per ray, hydra batch and the peer's best; 0 where not counted */
} ray_row;

typedef struct build_row {
    char scene[64];
    size_t triangles;
    build_cost ours[BUILD_JOBS], theirs[BUILD_JOBS]; /* seconds 0: not measured */
} build_row;

void report_begin(void); /* CSV goes to build/bench */
void report_rays(const ray_row *row);
void report_build(const build_row *row);
void report_end(bool peer_used);

#endif
