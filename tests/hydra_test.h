/* What every test file includes: cmocka, hydra.h, and the helpers below.

   A test file tests/test_<subject>.c exports one function:

       int hydra_test_<subject>(void) {
           const struct CMUnitTest tests[] = {cmocka_unit_test(first), cmocka_unit_test(second)};
           return cmocka_run_group_tests_name("<subject>", tests, NULL, NULL);
       }

   and is found by its name: no list to keep. Tests that look inside the implementation begin with

       #define HYDRA_STATIC
       #define HYDRA_IMPLEMENTATION
       #include "hydra.h"
       #include "hydra_test.h"

   and are compiled in one piece with the library and with each other (see the Makefile), so their names must differ.
   All helpers begin with ht_.

   All others are built a second time with HT_VULKAN, where hydra_create makes a context on a Vulkan device. Files
   named test_vk_<subject>.c are built in that way only. */
#ifndef HYDRA_TEST_H
#define HYDRA_TEST_H

#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdbool.h>
#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hydra.h"

#ifdef HT_VULKAN
#include "hydra_vk.h"

/* ---- on Vulkan: every context is one of a device, with the validation layer on; main fails when it said anything */

/* desc with a log that counts what the layer says, then calls the log of desc. */
hydra_context_desc ht_vk_watched(const hydra_context_desc *desc);
void ht_vk_opened(const hydra_context_desc *watched, hydra_context *context, hydra_result result, const char *error);
void ht_vk_closed(hydra_context *context, const hydra_vk_info *before);
/* The next so many messages of the layer are meant: a test provokes them. */
void ht_vk_provoke(uint32_t messages);

/* Lets a context share device and pipelines with all others (vk_sharing.c). */
void ht_vk_share(hydra_vk_desc *desc);
/* Destroys the device. Returns how many messages that brought up. */
uint64_t ht_vk_share_end(void);

/* These two are in the header so that they call the library this file was compiled with. */
static inline hydra_context *ht_vk_create(const hydra_context_desc *desc) {
    char error[512] = "";
    hydra_vk_desc vk;
    memset(&vk, 0, sizeof vk);
    vk.validation = true;
    vk.error = error;
    vk.error_size = sizeof error;
    ht_vk_share(&vk);
    hydra_context_desc watched = ht_vk_watched(desc);
    hydra_context *context = NULL;
    hydra_result result = hydra_vk_create(&watched, &vk, &context);
    ht_vk_opened(&watched, context, result, error);
    return context;
}

static inline hydra_result ht_vk_destroy(hydra_context *context) {
    hydra_vk_info info;
    bool device = context && hydra_vk_get_info(context, &info) == HYDRA_OK;
    hydra_result result = hydra_destroy(context);
    if (device && result == HYDRA_OK) ht_vk_closed(context, &info);
    return result;
}

#define hydra_create ht_vk_create
#define hydra_destroy ht_vk_destroy
#endif

#ifndef HT_PI
#define HT_PI 3.14159265358979323846
#endif

/* ---- running: the two cmocka macros below count what ran, for the line that main prints last */

int ht_run_group(const char *name, const struct CMUnitTest *tests, size_t count, CMFixtureFunction setup, CMFixtureFunction teardown);
void ht_count_skip(void);

#undef cmocka_run_group_tests_name
#define cmocka_run_group_tests_name(name, tests, setup, teardown) \
    ht_run_group((name), (tests), sizeof(tests) / sizeof((tests)[0]), (setup), (teardown))
#undef cmocka_run_group_tests
#define cmocka_run_group_tests(tests, setup, teardown) cmocka_run_group_tests_name(#tests, tests, setup, teardown)
#undef skip
#define skip() (ht_count_skip(), _skip(__FILE__, __LINE__))

/* Whether the environment asks for the reduced selection (HYDRA_TEST_QUICK=1): sanitizers and emulators. */
bool ht_quick(void);
/* full, or quick under HYDRA_TEST_QUICK. */
uint32_t ht_pick(uint32_t full, uint32_t quick);

/* ---- random numbers: the same sequence for the same seed on every machine (PCG32, O'Neill 2014) */

typedef struct ht_rng {
    uint64_t state;
} ht_rng;

ht_rng ht_rng_make(uint64_t seed);
uint32_t ht_u32(ht_rng *rng);
uint32_t ht_below(ht_rng *rng, uint32_t n);         /* 0..n-1, without bias; n > 0 */
float ht_uniform(ht_rng *rng);                      /* [0, 1) */
float ht_range(ht_rng *rng, float low, float high); /* [low, high] */
double ht_normal(ht_rng *rng);                      /* mean 0, variance 1 */
void ht_direction(ht_rng *rng, float direction[3]); /* unit length, uniform over the sphere */

/* ---- statistics */

/* Mean and variance of a stream (Welford 1962). Zero it to start. */
typedef struct ht_stats {
    uint64_t count;
    double mean, squares; /* squares: sum of squared distances from the mean */
} ht_stats;

void ht_add(ht_stats *stats, double value);
double ht_variance(const ht_stats *stats);       /* of one value, n - 1 in the divisor; 0 for less than two */
double ht_standard_error(const ht_stats *stats); /* of the mean */

double ht_gamma_q(double a, double x);                    /* regularised upper incomplete gamma function Q(a, x) */
double ht_chi_square_q(double statistic, double degrees); /* probability of a larger value by chance */
double ht_normal_q(double z);                             /* probability that |N(0,1)| is larger */
/* Pearson's test of counts against expectations: bins that expect less than 5 are pooled. Returns the p-value
   (tiny: they differ); constraints is subtracted from the degrees of freedom (1: the totals agree by design).
   A count where nothing is expected gives 0. Fails the test when fewer than two pooled bins are left. */
double ht_chi_square_p(const double *observed, const double *expected, size_t bins, uint32_t constraints);

/* The rule of all statistical tests: |estimate - truth| < 4 standard errors, and the standard error is below
   bound, so that the test can fail. A standard error of 0 asks for equality up to 1e-6 of the truth. */
#define ht_assert_estimate(estimate, truth, standard_error, bound) \
    ht_check_estimate((double)(estimate), (double)(truth), (double)(standard_error), (double)(bound), #estimate, __FILE__, __LINE__)
#define ht_assert_mean(stats, truth, bound) \
    ht_check_estimate((stats)->mean, (double)(truth), ht_standard_error(stats), (double)(bound), #stats, __FILE__, __LINE__)
void ht_check_estimate(double estimate, double truth, double standard_error, double bound, const char *what, const char *file, int line);

/* |value - truth| <= tolerance; NaN fails. */
#define ht_assert_near(value, truth, tolerance) \
    ht_check_near((double)(value), (double)(truth), (double)(tolerance), #value, __FILE__, __LINE__)
void ht_check_near(double value, double truth, double tolerance, const char *what, const char *file, int line);

/* Whether the bits say finite: right under -ffast-math too. */
bool ht_finite(float value);

/* ---- meshes: three floats a vertex, three indices a triangle, counter-clockwise from outside */

typedef struct ht_mesh {
    float *positions;
    uint32_t *indices;
    uint32_t vertex_count, index_count, vertex_capacity, index_capacity;
} ht_mesh;

void ht_mesh_free(ht_mesh *mesh);
uint32_t ht_mesh_vertex(ht_mesh *mesh, float x, float y, float z);
void ht_mesh_triangle(ht_mesh *mesh, uint32_t a, uint32_t b, uint32_t c);
void ht_mesh_append(ht_mesh *mesh, const ht_mesh *other);
void ht_mesh_flip(ht_mesh *mesh);                                          /* inside out */
void ht_mesh_place(ht_mesh *mesh, float scale, float x, float y, float z); /* scales about the origin, then moves */
void ht_mesh_jitter(ht_mesh *mesh, ht_rng *rng, float amount);             /* moves every vertex by up to amount in each axis */
hydra_mesh_desc ht_mesh_desc(const ht_mesh *mesh, hydra_material material);

/* Corners centre -u-v, +u-v, +u+v, -u+v; front face towards cross(u, v); n x n cells. */
ht_mesh ht_quad(const float centre[3], const float u[3], const float v[3], uint32_t n);
ht_mesh ht_box(const float low[3], const float high[3]);                            /* 12 triangles, normals outwards */
ht_mesh ht_icosphere(float radius, uint32_t subdivisions);                          /* 20 * 4^subdivisions triangles on the sphere */
ht_mesh ht_torus(float ring, float tube, uint32_t ring_steps, uint32_t tube_steps); /* about the y axis */
ht_mesh ht_soup(ht_rng *rng, uint32_t triangles, float extent, float size);         /* corners within size of centres within extent */

/* ---- an allocator that counts, checks sizes and bytes around each block, and fails when told to */

typedef struct ht_memory {
    int64_t bytes_now, bytes_peak, blocks_now;
    int64_t calls;   /* of alloc */
    int64_t fail_at; /* the call that returns NULL, counted from 1, and all after it if fail_after; 0: none */
    bool fail_after;
    int64_t damaged; /* blocks released with a wrong size, or written out of bounds */
} ht_memory;

/* memory must outlive the context. Any thread. */
hydra_allocator ht_memory_allocator(ht_memory *memory);

/* ---- a context with that allocator, and its log */

typedef struct ht_host {
    hydra_context *context;
    ht_memory memory;
    uint32_t warnings, errors; /* messages logged */
    char last[256];            /* the last of them */
} ht_host;

void ht_host_log(void *user, hydra_log_level level, const char *text);

/* Opens a context whose memory and log go to the host; the caller may set desc first (NULL: 1 thread, defaults).
   These three are in the header so that they call the library this file was compiled with. */
static inline hydra_context *ht_open(ht_host *host, const hydra_context_desc *desc) {
    hydra_context_desc own;
    memset(&own, 0, sizeof own);
    own.threads = 1;
    if (desc) own = *desc;
    own.allocator = ht_memory_allocator(&host->memory);
    own.log = ht_host_log;
    own.log_user = host;
    host->context = hydra_create(&own);
    return host->context;
}

static inline hydra_context *ht_open_threads(ht_host *host, uint32_t threads) {
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.threads = threads;
    return ht_open(host, &desc);
}

/* Destroys the context and fails the test if anything leaked or was damaged. */
static inline void ht_close(ht_host *host) {
    assert_int_equal(hydra_destroy(host->context), HYDRA_OK);
    host->context = NULL;
    assert_int_equal(host->memory.blocks_now, 0);
    assert_int_equal(host->memory.bytes_now, 0);
    assert_int_equal(host->memory.damaged, 0);
}

/* A call that must succeed; the message of the context is printed when it does not. */
#define ht_ok(context, call)                                                                  \
    do {                                                                                      \
        hydra_result ht_result = (call);                                                      \
        if (ht_result != HYDRA_OK) print_error("%s: %s\n", #call, hydra_error_text(context)); \
        assert_int_equal(ht_result, HYDRA_OK);                                                \
    } while (0)

/* Steps until the render is done; returns the last result. */
static inline hydra_result ht_finish(hydra_render *render) {
    hydra_result result = hydra_render_step(render);
    while (result == HYDRA_MORE) result = hydra_render_step(render);
    return result;
}

#endif /* HYDRA_TEST_H */
