/* Bodies of the helpers in hydra_test.h. */
#include "hydra_test.h"
#include "hydra_test_run.h"

#ifdef HT_VULKAN
#include <pthread.h>
#endif

/* ---- running */

ht_totals ht_total;
bool ht_idle;
static uint64_t skipped_now;
static CMFixtureFunction setup_now;
static bool setup_failed;

/* cmocka reports a failed group set-up as no failure at all. */
static int watched_setup(void **state) {
    setup_failed = true;
    int result = setup_now(state);
    if (result == 0) setup_failed = false;
    return result;
}

int ht_run_group(const char *name, const struct CMUnitTest *tests, size_t count, CMFixtureFunction setup, CMFixtureFunction teardown) {
    if (ht_idle) {
        ht_total.groups++;
        ht_total.skipped += count;
        return 0;
    }
    skipped_now = 0;
    setup_failed = false;
    setup_now = setup;
    int failed = _cmocka_run_group_tests(name, tests, count, setup ? watched_setup : NULL, teardown);
    if (setup_failed || failed < 0 || (size_t)failed > count) failed = (int)count;
    ht_total.groups++;
    ht_total.failed += (uint64_t)failed;
    ht_total.skipped += skipped_now;
    ht_total.passed += count - (uint64_t)failed - skipped_now;
    return failed;
}

void ht_count_skip(void) { skipped_now++; }

bool ht_quick(void) {
    const char *quick = getenv("HYDRA_TEST_QUICK");
    return quick && *quick && strcmp(quick, "0") != 0;
}

uint32_t ht_pick(uint32_t full, uint32_t quick) { return ht_quick() ? quick : full; }

/* ---- random numbers */

ht_rng ht_rng_make(uint64_t seed) {
    ht_rng rng = {0};
    ht_u32(&rng);
    rng.state += seed;
    ht_u32(&rng);
    return rng;
}

uint32_t ht_u32(ht_rng *rng) {
    uint64_t old = rng->state;
    rng->state = old * 6364136223846793005u + 1442695040888963407u;
    uint32_t mixed = (uint32_t)(((old >> 18) ^ old) >> 27), turn = (uint32_t)(old >> 59);
    return (mixed >> turn) | (mixed << ((32 - turn) & 31));
}

uint32_t ht_below(ht_rng *rng, uint32_t n) {
    uint32_t surplus = (0u - n) % n, x; /* 2^32 mod n: that many values would come once too often */
    do x = ht_u32(rng);
    while (x < surplus);
    return x % n;
}

float ht_uniform(ht_rng *rng) { return (float)(ht_u32(rng) >> 8) * 0x1p-24f; }

float ht_range(ht_rng *rng, float low, float high) {
    float u = ht_uniform(rng);
    return low * (1 - u) + high * u;
}

double ht_normal(ht_rng *rng) {
    double u = ((double)ht_u32(rng) + 0.5) * 0x1p-32, v = (double)ht_u32(rng) * 0x1p-32;
    return sqrt(-2 * log(u)) * cos(2 * HT_PI * v);
}

void ht_direction(ht_rng *rng, float direction[3]) {
    double z = 1 - 2 * ((double)ht_u32(rng) + 0.5) * 0x1p-32, turn = 2 * HT_PI * (double)ht_u32(rng) * 0x1p-32;
    double r = sqrt(1 - z * z);
    direction[0] = (float)(r * cos(turn));
    direction[1] = (float)(r * sin(turn));
    direction[2] = (float)z;
}

/* ---- statistics */

void ht_add(ht_stats *stats, double value) {
    double before = value - stats->mean;
    stats->count++;
    stats->mean += before / (double)stats->count;
    stats->squares += before * (value - stats->mean);
}

double ht_variance(const ht_stats *stats) { return stats->count < 2 ? 0 : stats->squares / (double)(stats->count - 1); }

double ht_standard_error(const ht_stats *stats) { return stats->count < 2 ? 0 : sqrt(ht_variance(stats) / (double)stats->count); }

/* P(a, x) by its power series: quick for x < a + 1 (Abramowitz and Stegun 6.5.29). */
static double gamma_series(double a, double x) {
    double term = 1 / a, sum = term;
    for (double n = a + 1; term > sum * DBL_EPSILON; n++) {
        term *= x / n;
        sum += term;
    }
    return sum * exp(a * log(x) - x - lgamma(a));
}

/* Q(a, x) by its continued fraction (Abramowitz and Stegun 6.5.31, even part), evaluated by Lentz's method (1976). */
static double gamma_fraction(double a, double x) {
    const double tiny = 1e-300;
    double b = x + 1 - a, c = 1 / tiny, d = 1 / b, h = d;
    for (int i = 1; i < 100000; i++) {
        double numerator = -i * (i - a);
        b += 2;
        d = numerator * d + b;
        c = b + numerator / c;
        if (fabs(d) < tiny) d = tiny;
        if (fabs(c) < tiny) c = tiny;
        d = 1 / d;
        h *= d * c;
        if (fabs(d * c - 1) < 1e-14) break;
    }
    return h * exp(a * log(x) - x - lgamma(a));
}

double ht_gamma_q(double a, double x) {
    if (!(x > 0)) return 1;
    return x < a + 1 ? 1 - gamma_series(a, x) : gamma_fraction(a, x);
}

double ht_chi_square_q(double statistic, double degrees) { return ht_gamma_q(degrees / 2, statistic / 2); }

double ht_normal_q(double z) { return erfc(fabs(z) / sqrt(2.0)); }

double ht_chi_square_p(const double *observed, const double *expected, size_t bins, uint32_t constraints) {
    double pooled_observed = 0, pooled_expected = 0, statistic = 0;
    uint32_t used = 0;
    for (size_t i = 0; i < bins; i++) {
        if (expected[i] <= 0 && observed[i] > 0) return 0;
        if (expected[i] < 5) {
            pooled_observed += observed[i];
            pooled_expected += expected[i];
            continue;
        }
        double off = observed[i] - expected[i];
        statistic += off * off / expected[i];
        used++;
    }
    if (pooled_expected >= 5) {
        double off = pooled_observed - pooled_expected;
        statistic += off * off / pooled_expected;
        used++;
    }
    if (used < 2 || used <= constraints) fail_msg("chi-square test with %u bins says nothing", used);
    return ht_chi_square_q(statistic, (double)(used - constraints));
}

void ht_check_estimate(double estimate, double truth, double standard_error, double bound, const char *what, const char *file, int line) {
    double off = fabs(estimate - truth);
    bool exact = standard_error <= 0 && off <= 1e-6 * fabs(truth);
    if (standard_error <= bound && (off < 4 * standard_error || exact)) return;
    print_error("%s = %.9g, truth %.9g, standard error %.3g (bound %.3g): off by %.2f standard errors\n", what, estimate, truth,
                standard_error, bound, off / standard_error);
    _fail(file, line);
}

void ht_check_near(double value, double truth, double tolerance, const char *what, const char *file, int line) {
    if (fabs(value - truth) <= tolerance) return;
    print_error("%s = %.9g, truth %.9g, off by %.3g, allowed %.3g\n", what, value, truth, fabs(value - truth), tolerance);
    _fail(file, line);
}

bool ht_finite(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & 0x7f800000u) != 0x7f800000u;
}

/* ---- meshes */

void ht_mesh_free(ht_mesh *mesh) {
    free(mesh->positions);
    free(mesh->indices);
    memset(mesh, 0, sizeof *mesh);
}

static void *grown(void *memory, uint32_t *capacity, uint32_t need, size_t element) {
    if (need <= *capacity) return memory;
    *capacity = need > *capacity * 2 ? need : *capacity * 2;
    memory = realloc(memory, *capacity * element);
    assert_non_null(memory);
    return memory;
}

uint32_t ht_mesh_vertex(ht_mesh *mesh, float x, float y, float z) {
    mesh->positions = (float *)grown(mesh->positions, &mesh->vertex_capacity, mesh->vertex_count + 1, 3 * sizeof(float));
    float *p = mesh->positions + 3 * (size_t)mesh->vertex_count;
    p[0] = x;
    p[1] = y;
    p[2] = z;
    return mesh->vertex_count++;
}

void ht_mesh_triangle(ht_mesh *mesh, uint32_t a, uint32_t b, uint32_t c) {
    mesh->indices = (uint32_t *)grown(mesh->indices, &mesh->index_capacity, mesh->index_count + 3, sizeof(uint32_t));
    uint32_t *i = mesh->indices + mesh->index_count;
    i[0] = a;
    i[1] = b;
    i[2] = c;
    mesh->index_count += 3;
}

void ht_mesh_append(ht_mesh *mesh, const ht_mesh *other) {
    uint32_t base = mesh->vertex_count;
    for (uint32_t i = 0; i < other->vertex_count; i++) {
        const float *p = other->positions + 3 * (size_t)i;
        ht_mesh_vertex(mesh, p[0], p[1], p[2]);
    }
    for (uint32_t i = 0; i < other->index_count; i += 3)
        ht_mesh_triangle(mesh, base + other->indices[i], base + other->indices[i + 1], base + other->indices[i + 2]);
}

void ht_mesh_flip(ht_mesh *mesh) {
    for (uint32_t i = 0; i < mesh->index_count; i += 3) {
        uint32_t b = mesh->indices[i + 1];
        mesh->indices[i + 1] = mesh->indices[i + 2];
        mesh->indices[i + 2] = b;
    }
}

void ht_mesh_place(ht_mesh *mesh, float scale, float x, float y, float z) {
    const float offset[3] = {x, y, z};
    for (size_t i = 0; i < 3 * (size_t)mesh->vertex_count; i++) mesh->positions[i] = mesh->positions[i] * scale + offset[i % 3];
}

void ht_mesh_jitter(ht_mesh *mesh, ht_rng *rng, float amount) {
    for (size_t i = 0; i < 3 * (size_t)mesh->vertex_count; i++) mesh->positions[i] += ht_range(rng, -amount, amount);
}

hydra_mesh_desc ht_mesh_desc(const ht_mesh *mesh, hydra_material material) {
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions.data = mesh->positions;
    desc.positions.count = mesh->vertex_count;
    desc.indices.data = mesh->indices;
    desc.indices.count = mesh->index_count;
    desc.material = material;
    return desc;
}

/* Two triangles for each cell of a grid of (columns + 1) x (rows + 1) vertices that starts at first. */
static void grid_triangles(ht_mesh *mesh, uint32_t first, uint32_t columns, uint32_t rows) {
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            uint32_t a = first + y * (columns + 1) + x, b = a + 1, d = a + columns + 1, c = d + 1;
            ht_mesh_triangle(mesh, a, b, c);
            ht_mesh_triangle(mesh, a, c, d);
        }
    }
}

ht_mesh ht_quad(const float centre[3], const float u[3], const float v[3], uint32_t n) {
    ht_mesh mesh = {0};
    for (uint32_t y = 0; y <= n; y++) {
        for (uint32_t x = 0; x <= n; x++) {
            float s = 2 * (float)x / (float)n - 1, t = 2 * (float)y / (float)n - 1;
            ht_mesh_vertex(&mesh, centre[0] + s * u[0] + t * v[0], centre[1] + s * u[1] + t * v[1], centre[2] + s * u[2] + t * v[2]);
        }
    }
    grid_triangles(&mesh, 0, n, n);
    return mesh;
}

ht_mesh ht_box(const float low[3], const float high[3]) {
    static const uint8_t faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    ht_mesh mesh = {0};
    for (uint32_t i = 0; i < 8; i++) ht_mesh_vertex(&mesh, i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]);
    for (uint32_t f = 0; f < 6; f++) {
        ht_mesh_triangle(&mesh, faces[f][0], faces[f][1], faces[f][2]);
        ht_mesh_triangle(&mesh, faces[f][0], faces[f][2], faces[f][3]);
    }
    return mesh;
}

/* The vertex in the middle of the edge, pushed out to the sphere; each edge is split once. */
static uint32_t split_edge(ht_mesh *mesh, float radius, uint32_t a, uint32_t b, uint64_t *keys, uint32_t *middles, uint32_t slots) {
    uint64_t key = a < b ? ((uint64_t)a << 32 | b) + 1 : ((uint64_t)b << 32 | a) + 1;
    uint32_t slot = (uint32_t)((key * 0x9e3779b97f4a7c15u) >> 32) % slots;
    while (keys[slot] && keys[slot] != key) slot = (slot + 1) % slots;
    if (keys[slot]) return middles[slot];
    const float *p = mesh->positions + 3 * (size_t)a, *q = mesh->positions + 3 * (size_t)b;
    double m[3] = {(double)p[0] + (double)q[0], (double)p[1] + (double)q[1], (double)p[2] + (double)q[2]};
    double s = (double)radius / sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
    keys[slot] = key;
    middles[slot] = ht_mesh_vertex(mesh, (float)(m[0] * s), (float)(m[1] * s), (float)(m[2] * s));
    return middles[slot];
}

static void subdivide(ht_mesh *mesh, float radius) {
    uint32_t count = mesh->index_count, slots = 2 * count + 1;
    uint32_t *old = mesh->indices;
    uint64_t *keys = (uint64_t *)calloc(slots, sizeof *keys);
    uint32_t *middles = (uint32_t *)calloc(slots, sizeof *middles);
    assert_true(keys && middles);
    mesh->indices = NULL;
    mesh->index_count = mesh->index_capacity = 0;
    for (uint32_t i = 0; i < count; i += 3) {
        uint32_t a = old[i], b = old[i + 1], c = old[i + 2];
        uint32_t ab = split_edge(mesh, radius, a, b, keys, middles, slots), bc = split_edge(mesh, radius, b, c, keys, middles, slots);
        uint32_t ca = split_edge(mesh, radius, c, a, keys, middles, slots);
        ht_mesh_triangle(mesh, a, ab, ca);
        ht_mesh_triangle(mesh, ab, b, bc);
        ht_mesh_triangle(mesh, ca, bc, c);
        ht_mesh_triangle(mesh, ab, bc, ca);
    }
    free(old);
    free(keys);
    free(middles);
}

ht_mesh ht_icosphere(float radius, uint32_t subdivisions) {
    static const uint8_t faces[20][3] = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                                         {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                                         {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    const double golden = (1 + sqrt(5.0)) / 2, scale = (double)radius / sqrt(1 + golden * golden);
    const float s = (float)scale, g = (float)(golden * scale);
    const float corners[12][3] = {{-s, g, 0},  {s, g, 0},  {-s, -g, 0}, {s, -g, 0}, {0, -s, g},  {0, s, g},
                                  {0, -s, -g}, {0, s, -g}, {g, 0, -s},  {g, 0, s},  {-g, 0, -s}, {-g, 0, s}};
    ht_mesh mesh = {0};
    for (uint32_t i = 0; i < 12; i++) ht_mesh_vertex(&mesh, corners[i][0], corners[i][1], corners[i][2]);
    for (uint32_t i = 0; i < 20; i++) ht_mesh_triangle(&mesh, faces[i][0], faces[i][1], faces[i][2]);
    for (uint32_t i = 0; i < subdivisions; i++) subdivide(&mesh, radius);
    return mesh;
}

ht_mesh ht_torus(float ring, float tube, uint32_t ring_steps, uint32_t tube_steps) {
    ht_mesh mesh = {0};
    for (uint32_t r = 0; r < ring_steps; r++) {
        for (uint32_t t = 0; t < tube_steps; t++) {
            double a = 2 * HT_PI * r / ring_steps, b = 2 * HT_PI * t / tube_steps;
            double out = (double)ring + (double)tube * cos(b);
            ht_mesh_vertex(&mesh, (float)(out * cos(a)), (float)((double)tube * sin(b)), (float)(-out * sin(a)));
        }
    }
    for (uint32_t r = 0; r < ring_steps; r++) {
        for (uint32_t t = 0; t < tube_steps; t++) {
            uint32_t r1 = (r + 1) % ring_steps * tube_steps, t1 = (t + 1) % tube_steps, r0 = r * tube_steps;
            ht_mesh_triangle(&mesh, r0 + t, r1 + t, r1 + t1);
            ht_mesh_triangle(&mesh, r0 + t, r1 + t1, r0 + t1);
        }
    }
    return mesh;
}

ht_mesh ht_soup(ht_rng *rng, uint32_t triangles, float extent, float size) {
    ht_mesh mesh = {0};
    for (uint32_t i = 0; i < triangles; i++) {
        float c[3], p[9];
        for (int k = 0; k < 3; k++) c[k] = ht_range(rng, -extent, extent);
        for (int k = 0; k < 9; k++) p[k] = c[k % 3] + ht_range(rng, -size, size);
        uint32_t a = ht_mesh_vertex(&mesh, p[0], p[1], p[2]), b = ht_mesh_vertex(&mesh, p[3], p[4], p[5]);
        ht_mesh_triangle(&mesh, a, b, ht_mesh_vertex(&mesh, p[6], p[7], p[8]));
    }
    return mesh;
}

/* ---- the allocator: [ malloc's bytes | head, 64 before | block | 64 bytes of tail ] */

enum { guard = 64, guard_byte = 0xa5 };

typedef struct block_head {
    void *base;
    size_t size;
    uint64_t mark;
} block_head;

static const uint64_t head_mark = 0x6879647261626c6bu;

static void raise_to(int64_t *peak, int64_t value) {
    int64_t seen = __atomic_load_n(peak, __ATOMIC_RELAXED);
    while (seen < value && !__atomic_compare_exchange_n(peak, &seen, value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {}
}

static void *memory_alloc(void *user, size_t size) {
    ht_memory *memory = (ht_memory *)user;
    int64_t call = __atomic_add_fetch(&memory->calls, 1, __ATOMIC_RELAXED);
    if (memory->fail_at && (call == memory->fail_at || (memory->fail_after && call > memory->fail_at))) return NULL;
    if (size > SIZE_MAX / 2) return NULL;
    char *base = (char *)malloc(size + 3 * guard);
    if (!base) return NULL;
    char *block = base + guard;
    block += (guard - (uintptr_t)block % guard) % guard;
    block_head head = {base, size, head_mark};
    memcpy(block - sizeof head, &head, sizeof head);
    memset(block, guard_byte, size + guard); /* what is read before it is written is large and not a number anyone meant */
    __atomic_add_fetch(&memory->blocks_now, 1, __ATOMIC_RELAXED);
    raise_to(&memory->bytes_peak, __atomic_add_fetch(&memory->bytes_now, (int64_t)size, __ATOMIC_RELAXED));
    return block;
}

static bool is_damaged(const char *block, const block_head *head, size_t size) {
    if (head->mark != head_mark || head->size != size) return true;
    for (size_t i = 0; i < guard; i++) {
        if ((unsigned char)block[size + i] != guard_byte) return true;
    }
    return false;
}

static void memory_release(void *user, void *block, size_t size) {
    ht_memory *memory = (ht_memory *)user;
    block_head head;
    memcpy(&head, (char *)block - sizeof head, sizeof head);
    if (is_damaged((const char *)block, &head, size)) {
        __atomic_add_fetch(&memory->damaged, 1, __ATOMIC_RELAXED);
        if (head.mark != head_mark) return; /* where it came from is lost */
    }
    __atomic_sub_fetch(&memory->blocks_now, 1, __ATOMIC_RELAXED);
    __atomic_sub_fetch(&memory->bytes_now, (int64_t)head.size, __ATOMIC_RELAXED);
    head.mark = 0;
    memcpy((char *)block - sizeof head, &head, sizeof head);
    free(head.base);
}

hydra_allocator ht_memory_allocator(ht_memory *memory) {
    hydra_allocator allocator = {memory_alloc, memory_release, memory};
    return allocator;
}

void ht_host_log(void *user, hydra_log_level level, const char *text) {
    ht_host *host = (ht_host *)user;
    if (level == HYDRA_LOG_INFO) return;
    if (level == HYDRA_LOG_WARNING)
        host->warnings++;
    else
        host->errors++;
    snprintf(host->last, sizeof host->last, "%s", text);
}

/* ---- the device, and what its validation layer says */

#ifndef HT_VULKAN

ht_device ht_find_device(char *text, size_t size) {
    if (size) text[0] = 0;
    return HT_DEVICE_READY;
}

uint64_t ht_validation_messages(void) { return 0; }

ht_device_totals ht_device_total(void) {
    ht_device_totals none = {0, 0, 0};
    return none;
}

#else

#undef hydra_create
#undef hydra_destroy

/* The log of one context. */
typedef struct watch {
    struct watch *next;
    hydra_context *context; /* NULL until there is one */
    void (*log)(void *user, hydra_log_level level, const char *text);
    void *user;
    uint32_t messages;
} watch;

static struct {
    pthread_mutex_t mutex;
    watch *living;
    uint64_t messages, provoked;
    ht_device_totals totals;
} watches = {PTHREAD_MUTEX_INITIALIZER, NULL, 0, 0, {0, 0, 0}};

/* The layer names the rule that was broken. */
static bool is_of_layer(hydra_log_level level, const char *text) {
    return level != HYDRA_LOG_INFO && (strstr(text, "VUID-") || strstr(text, "SYNC-HAZARD") || strstr(text, "UNASSIGNED-"));
}

static void watch_log(void *user, hydra_log_level level, const char *text) {
    watch *w = (watch *)user;
    if (is_of_layer(level, text)) {
        __atomic_add_fetch(&w->messages, 1, __ATOMIC_RELAXED);
        print_error("%s\n", text);
    }
    if (w->log) w->log(w->user, level, text);
}

hydra_context_desc ht_vk_watched(const hydra_context_desc *desc) {
    hydra_context_desc watched;
    memset(&watched, 0, sizeof watched);
    if (desc) watched = *desc;
    watch *w = (watch *)calloc(1, sizeof *w);
    if (!w) abort();
    w->log = watched.log;
    w->user = watched.log_user;
    watched.log = watch_log;
    watched.log_user = w;
    return watched;
}

static void forget(watch *w, uint32_t messages) {
    watches.messages += messages;
    for (watch **at = &watches.living; *at; at = &(*at)->next) {
        if (*at != w) continue;
        *at = w->next;
        break;
    }
    free(w);
}

void ht_vk_opened(const hydra_context_desc *watched, hydra_context *context, hydra_result result, const char *error) {
    watch *w = (watch *)watched->log_user;
    if (result == HYDRA_ERROR_DEVICE) print_error("%s\n", error);
    pthread_mutex_lock(&watches.mutex);
    w->context = context;
    w->next = watches.living;
    watches.living = w;
    if (!context) forget(w, w->messages);
    pthread_mutex_unlock(&watches.mutex);
}

/* The context's own count does not hold what its destruction brought up, and the log only what could be told apart. */
void ht_vk_closed(hydra_context *context, const hydra_vk_info *before) {
    pthread_mutex_lock(&watches.mutex);
    watches.totals.contexts++;
    watches.totals.pipelines += before->pipelines;
    watches.totals.seconds_pipelines += before->seconds_pipelines;
    watch *w = watches.living;
    while (w && w->context != context) w = w->next;
    if (!w)
        watches.messages += before->validation_messages; /* made by the test itself, with a log of its own */
    else
        forget(w, w->messages > before->validation_messages ? w->messages : before->validation_messages);
    pthread_mutex_unlock(&watches.mutex);
}

void ht_vk_provoke(uint32_t messages) {
    pthread_mutex_lock(&watches.mutex);
    watches.provoked += messages;
    pthread_mutex_unlock(&watches.mutex);
}

uint64_t ht_validation_messages(void) {
    watches.messages += ht_vk_share_end();
    uint64_t said = watches.messages, meant = watches.provoked;
    return said > meant ? said - meant : meant - said;
}

ht_device_totals ht_device_total(void) { return watches.totals; }

static hydra_result try_device(bool validation, char *text, size_t size) {
    hydra_context *context = NULL;
    hydra_vk_info info;
    hydra_vk_desc vk;
    memset(&vk, 0, sizeof vk);
    vk.validation = validation;
    vk.error = text;
    vk.error_size = size;
    hydra_result result = hydra_vk_create(NULL, &vk, &context);
    if (result != HYDRA_OK) return result;
    if (hydra_vk_get_info(context, &info) == HYDRA_OK) snprintf(text, size, "%s", info.name);
    return hydra_destroy(context);
}

ht_device ht_find_device(char *text, size_t size) {
    char without[256];
    if (try_device(true, text, size) == HYDRA_OK) return HT_DEVICE_READY;
    return try_device(false, without, sizeof without) == HYDRA_ERROR_DEVICE ? HT_DEVICE_NONE : HT_DEVICE_NOT_WATCHED;
}

#endif
