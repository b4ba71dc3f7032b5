/* The caller's own rays, in calls of any size: with every instruction set, with and without memory, sound or not, from
   several threads. The truth is what single-ray calls in plain C say. */
#include "hydra_test.h"

#include <pthread.h>

int hydra_test_queries(void);

#ifdef HT_VULKAN /* there a call takes long, whatever its rays, and the processor's instruction set means nothing */
#define TQ_MOST 600
#define TQ_LAST_ISA HYDRA_ISA_SCALAR
#else
#define TQ_MOST 70000 /* more than a call goes through at a time */
#define TQ_LAST_ISA HYDRA_ISA_NEON
#endif

/* ---- scenes: all within a cube of 1 about the origin, so that the same rays serve all */

enum { TQ_EMPTY, TQ_SHAPES, TQ_MESHES, TQ_INSTANCES, TQ_SCENES };

typedef struct tq_world {
    ht_host host;
    hydra_scene *scene;
    int kind;
    uint32_t logged;
    char text[512]; /* of the context, before any query */
} tq_world;

/* Takes the mesh over. opacity 0: opaque; else the share of rays that it stops. */
static hydra_mesh tq_add(tq_world *w, ht_mesh mesh, float opacity, bool instanced_only) {
    hydra_material_desc material;
    memset(&material, 0, sizeof material);
    material.alpha_mode = opacity > 0 ? HYDRA_ALPHA_BLEND : HYDRA_ALPHA_OPAQUE;
    material.alpha = opacity;
    hydra_mesh_desc desc = ht_mesh_desc(&mesh, hydra_scene_add_material(w->scene, &material));
    desc.instanced_only = instanced_only;
    hydra_mesh made = hydra_scene_add_mesh(w->scene, &desc);
    ht_mesh_free(&mesh);
    return made;
}

static void tq_add_meshes(tq_world *w) {
    ht_rng rng = ht_rng_make(1);
    (void)tq_add(w, ht_soup(&rng, 300, 1, 0.15f), 0, false);
    (void)tq_add(w, ht_torus(0.6f, 0.2f, 16, 8), 0.5f, false);
}

static void tq_add_instances(tq_world *w) {
    const float placed[2][12] = {{-0.8f, 0, 0, 0.5f, 0, 0.4f, 0, 0, 0, 0, 0.5f, 0},
                                 {0.3f, 0.4f, 0, -0.5f, -0.4f, 0.3f, 0, 0, 0, 0, 0.5f, 0}};
    hydra_instance_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.mesh = tq_add(w, ht_icosphere(1, 1), 0, true);
    for (int i = 0; i < 2; i++) {
        memcpy(desc.transform, placed[i], sizeof placed[i]);
        (void)hydra_scene_add_instance(w->scene, &desc);
    }
}

/* A disc, a rectangle, a sphere that sensors do not see, and a light without a shape. */
static void tq_add_lights(tq_world *w) {
    hydra_light_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.color[0] = 1;
    desc.kind = HYDRA_LIGHT_POINT;
    (void)hydra_scene_add_light(w->scene, &desc);
    desc.kind = HYDRA_LIGHT_DISC;
    desc.position[1] = 0.8f;
    desc.radius = 0.4f;
    (void)hydra_scene_add_light(w->scene, &desc);
    desc.kind = HYDRA_LIGHT_RECT;
    desc.position[1] = -0.8f;
    desc.axis_u[0] = desc.axis_v[2] = 0.5f;
    (void)hydra_scene_add_light(w->scene, &desc);
    desc.kind = HYDRA_LIGHT_SPHERE;
    desc.position[1] = 0;
    desc.radius = 0.3f;
    desc.hidden = true;
    (void)hydra_scene_add_light(w->scene, &desc);
}

/* Leaves something in the context's error text, for queries to leave alone. */
static void tq_say_something(tq_world *w) {
    hydra_mesh nothing = {9999};
    hydra_mesh_info info;
    assert_int_equal(hydra_scene_get_mesh_info(w->scene, nothing, &info), HYDRA_ERROR_HANDLE);
    snprintf(w->text, sizeof w->text, "%s", hydra_error_text(w->host.context));
    assert_true(strlen(w->text) > 10);
    w->logged = w->host.errors + w->host.warnings;
}

/* False: this machine lacks the instruction set. */
static bool tq_open(tq_world *w, int kind, hydra_isa isa, size_t cap) {
    hydra_context_desc desc;
    memset(w, 0, sizeof *w);
    memset(&desc, 0, sizeof desc);
    desc.threads = 1;
    desc.isa = isa;
    desc.memory_cap = cap;
    w->kind = kind;
    bool there = ht_open(&w->host, &desc) != NULL;
    if (!there && isa != HYDRA_ISA_SCALAR && isa != HYDRA_ISA_AUTO) return false;
    assert_true(there);
    w->scene = hydra_scene_create(w->host.context);
    if (kind >= TQ_MESHES) tq_add_meshes(w);
    if (kind >= TQ_INSTANCES) tq_add_instances(w);
    if (kind != TQ_EMPTY) tq_add_lights(w);
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
    tq_say_something(w);
    return true;
}

/* Queries have said nothing. */
static void tq_expect_quiet(const tq_world *w) {
    assert_string_equal(hydra_error_text(w->host.context), w->text);
    assert_int_equal(w->host.errors + w->host.warnings, w->logged);
}

static void tq_close(tq_world *w) {
    tq_expect_quiet(w);
    assert_int_equal(hydra_scene_destroy(w->scene), HYDRA_OK);
    ht_close(&w->host);
}

/* Whether queries of these may go through trees together, and so take memory that they can do without. */
static bool tq_has_streams(const tq_world *w) {
    return TQ_LAST_ISA != HYDRA_ISA_SCALAR && w->kind >= TQ_MESHES && hydra_context_isa(w->host.context) != HYDRA_ISA_SCALAR;
}

/* ---- rays, and what they meet one by one */

static hydra_ray tq_rays[TQ_MOST];
static hydra_hit tq_hits[TQ_SCENES][TQ_MOST], tq_miss;
static uint8_t tq_occluded[TQ_SCENES][TQ_MOST];

/* The most are for scenes of no tree, one tree, and trees in a tree; not all in quick runs. */
static uint32_t tq_known(int kind) {
    bool some = kind == TQ_SHAPES || (kind == TQ_MESHES && ht_quick());
    return some && TQ_MOST > 8000 ? 8000 : TQ_MOST;
}

/* By turns: sixteen from one place towards places side by side, from anywhere to anywhere, and along axes with limits. */
static void tq_make_rays(void) {
    ht_rng rng = ht_rng_make(2);
    float from[3] = {0, 0, 0}, to[3] = {0, 0, 0};
    for (uint32_t i = 0; i < TQ_MOST; i++) {
        uint32_t kind = i / 64 % 4;
        float spread = kind < 2 ? 0.05f : 1.2f;
        for (int a = 0; a < 3 && (i % 16 == 0 || kind > 1); a++) from[a] = ht_range(&rng, -1.2f, 1.2f);
        for (int a = 0; a < 3 && i % 16 == 0; a++) to[a] = kind < 2 ? ht_range(&rng, -0.8f, 0.8f) : 0;
        for (int a = 0; a < 3; a++) {
            tq_rays[i].origin[a] = from[a];
            tq_rays[i].direction[a] = to[a] + ht_range(&rng, -spread, spread) - from[a];
            if (kind == 3 && a != (int)(i % 3)) tq_rays[i].direction[a] = i % 2 ? 0.0f : -0.0f;
        }
        tq_rays[i].t_min = kind == 3 ? ht_range(&rng, -1, 0.5f) : 0;
        tq_rays[i].t_max = kind == 3 ? ht_range(&rng, 0.5f, 2) : INFINITY;
    }
}

static void tq_find_truth(int kind) {
    tq_world w;
    uint32_t misses = 0, triangles = 0, placed = 0, lights = 0;
    (void)tq_open(&w, kind, HYDRA_ISA_SCALAR, 0);
    uint32_t known = tq_known(kind);
    for (uint32_t i = 0; i < known; i++) {
        hydra_hit *hit = &tq_hits[kind][i];
        assert_int_equal(hydra_scene_closest_hits(w.scene, &tq_rays[i], hit, 1), HYDRA_OK);
        assert_int_equal(hydra_scene_any_hits(w.scene, &tq_rays[i], &tq_occluded[kind][i], 1), HYDRA_OK);
        assert_int_equal(tq_occluded[kind][i], hit->t >= tq_rays[i].t_min && (hit->mesh || hit->light));
        misses += !tq_occluded[kind][i];
        triangles += hit->mesh != 0;
        placed += hit->instance != 0;
        lights += hit->light != 0;
    }
    if (kind == TQ_EMPTY) tq_miss = tq_hits[kind][0];
    assert_true(kind == TQ_EMPTY ? misses == known : misses > known / 20);
    assert_true(kind == TQ_EMPTY || lights > known / 50);
    assert_true(kind < TQ_MESHES || triangles > known / 20);
    assert_true(kind < TQ_INSTANCES || placed > known / 50);
    tq_close(&w);
}

static int tq_prepare(void **state) {
    (void)state;
    tq_make_rays();
    for (int kind = 0; kind < TQ_SCENES; kind++) tq_find_truth(kind);
    return 0;
}

#if defined(__FAST_MATH__) /* which takes an inverse root for a root and a quotient, and denormals for zero */
#define TQ_ROUNDING 1e-6f
#else
#define TQ_ROUNDING 0.0f
#endif

/* ---- rays that are not sound */

#define TQ_SPOILS 12

/* -ffast-math takes leave to forget what it knows is not finite. */
static float tq_of_bits(uint32_t bits) {
    volatile uint32_t unknown = bits;
    float value;
    bits = unknown;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static hydra_ray tq_spoiled(hydra_ray ray, uint32_t how) {
    const float bad[3] = {tq_of_bits(0x7fc00000u), tq_of_bits(0x7f800000u), tq_of_bits(0xff800000u)};
    float *at = how < 3 ? ray.origin : ray.direction;
    switch (how) {
    default: at[how % 3] = bad[how % 3]; break; /* below 6 */
    case 6: ray.t_min = bad[0]; break;
    case 7: ray.t_min = bad[2]; break;
    case 8: ray.t_min = ray.t_max = bad[1]; break;
    case 9: ray.t_max = bad[0]; break;
    case 10: ray.t_min = 1, ray.t_max = nextafterf(1, 0); break;
    case 11: ray.direction[0] = ray.direction[1] = 0, ray.direction[2] = -0.0f; break;
    }
    return ray;
}

/* Which of the rays of a call are spoiled. */
enum { TQ_NONE, TQ_FIRST, TQ_MIDDLE, TQ_LAST, TQ_SCATTERED, TQ_RUN, TQ_ALL, TQ_PATTERNS };

static bool tq_is_spoiled(int pattern, uint32_t i, uint32_t count) {
    switch (pattern) {
    case TQ_FIRST: return i == 0;
    case TQ_MIDDLE: return i == count / 2;
    case TQ_LAST: return i == count - 1;
    case TQ_SCATTERED: return i % 7 == 3;
    case TQ_RUN: return i / 40 % 3 == 1; /* more than a packet, and parts of packets */
    case TQ_ALL: return true;
    default: return false;
    }
}

/* ---- a call, on arrays that end where the heap's block does, or before bytes that must stay */

#if defined(__SANITIZE_ADDRESS__)
#define TQ_GUARD 0u
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define TQ_GUARD 0u
#endif
#endif
#ifndef TQ_GUARD
#define TQ_GUARD 256u
#endif

typedef struct tq_block {
    unsigned char *memory;
    size_t shift, size;
} tq_block;

/* shift: the array begins no better aligned than its type asks for. */
static void *tq_take(tq_block *block, size_t size, size_t shift) {
    block->memory = (unsigned char *)malloc(shift + size + TQ_GUARD);
    block->shift = shift;
    block->size = size;
    if (block->memory) memset(block->memory, 0xa5, shift + size + TQ_GUARD);
    return block->memory ? block->memory + shift : NULL;
}

/* False: bytes around the array were written. */
static bool tq_give(const tq_block *block) {
    bool whole = true;
    for (size_t i = 0; i < block->shift + TQ_GUARD; i++) whole = whole && block->memory[i < block->shift ? i : i + block->size] == 0xa5;
    free(block->memory);
    return whole;
}

typedef struct tq_call {
    const tq_world *world;
    uint32_t first, count; /* of tq_rays */
    int pattern;
} tq_call;

/* Returns whether some are spoiled. */
static bool tq_fill(const tq_call *call, hydra_ray *rays) {
    bool spoiled = false;
    for (uint32_t i = 0; i < call->count; i++) {
        bool bad = tq_is_spoiled(call->pattern, i, call->count);
        rays[i] = bad ? tq_spoiled(tq_rays[call->first + i], i % TQ_SPOILS) : tq_rays[call->first + i];
        spoiled = spoiled || bad;
    }
    return spoiled;
}

/* Returns count where all answers are right, else the number of the first that is not. */
static uint32_t tq_check_answers(const tq_call *call, const hydra_hit *hits, const uint8_t *occluded) {
    int kind = call->world->kind;
    for (uint32_t i = 0; i < call->count; i++) {
        bool bad = tq_is_spoiled(call->pattern, i, call->count);
        const hydra_hit *hit = bad ? &tq_miss : &tq_hits[kind][call->first + i];
        if (memcmp(&hits[i], hit, sizeof *hit) != 0 || occluded[i] != (bad ? 0 : tq_occluded[kind][call->first + i])) return i;
    }
    return call->count;
}

/* Both queries. Asserts nothing, since any thread may call it: returns what is wrong, or NULL. */
static const char *tq_ask(const tq_call *call) {
    const hydra_scene *scene = call->world->scene;
    tq_block blocks[3];
    hydra_ray *rays = (hydra_ray *)tq_take(&blocks[0], call->count * sizeof *rays, 4);
    hydra_hit *hits = (hydra_hit *)tq_take(&blocks[1], call->count * sizeof *hits, 4);
    uint8_t *occluded = (uint8_t *)tq_take(&blocks[2], call->count, 1);
    if (!rays || !hits || !occluded) return "the test has no memory";
    hydra_result wanted = tq_fill(call, rays) ? HYDRA_ERROR_RAY : HYDRA_OK;
    const char *wrong = NULL;
    if (hydra_scene_closest_hits(scene, rays, hits, call->count) != wanted) wrong = "the result of the closest hits";
    if (hydra_scene_any_hits(scene, rays, occluded, call->count) != wanted) wrong = "the result of any hits";
    if (tq_check_answers(call, hits, occluded) != call->count) wrong = "an answer";
    for (int i = 0; i < 3; i++)
        if (!tq_give(&blocks[i])) wrong = "bytes beside an array";
    return wrong;
}

static void tq_expect(const tq_world *w, uint32_t first, uint32_t count, int pattern) {
    tq_call call = {w, first, count, pattern};
    const char *wrong = tq_ask(&call);
    if (wrong)
        fail_msg("scene %d, isa %d, rays %u to %u, pattern %d: wrong is %s", w->kind, (int)hydra_context_isa(w->host.context), first,
                 first + count, pattern, wrong);
}

/* ---- tests */

static const uint32_t tq_counts[] = {0, 1, 47, 48, 49, 255, 256, 257, 4097, TQ_MOST};
#define TQ_COUNTS (sizeof tq_counts / sizeof tq_counts[0])

/* Catches: batches larger than the memory that was had for them; answers written to a batch's beginning only; rays past
   the first 65536; what holds for one instruction set alone. */
static void answers_of_any_batch(void **state) {
    (void)state;
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        for (int isa = ht_quick() ? HYDRA_ISA_AUTO : HYDRA_ISA_SCALAR; isa <= TQ_LAST_ISA; isa++) {
            tq_world w;
            if (!tq_open(&w, kind, (hydra_isa)isa, 0)) continue;
            for (uint32_t i = 0; i < TQ_COUNTS; i++) {
                uint32_t count = tq_counts[i], known = tq_known(kind);
                bool slow = kind == TQ_MESHES ? isa == HYDRA_ISA_SCALAR : kind == TQ_INSTANCES && ht_quick() && isa != HYDRA_ISA_AUTO;
                if (count > known || (count == TQ_MOST && slow)) continue;
                tq_expect(&w, 0, count, TQ_NONE);
                if (count < known / 2) tq_expect(&w, known / 2, count, TQ_NONE);
            }
            for (uint32_t i = 0; i < ht_pick(200, 50); i++) tq_expect(&w, 37 * i % tq_known(kind), 1, TQ_NONE);
            tq_close(&w);
        }
    }
}

/* An array may be NULL where nothing is asked. */
static void nothing_asked(void **state) {
    (void)state;
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        tq_world w;
        (void)tq_open(&w, kind, HYDRA_ISA_AUTO, 0);
        assert_int_equal(hydra_scene_closest_hits(w.scene, NULL, NULL, 0), HYDRA_OK);
        assert_int_equal(hydra_scene_any_hits(w.scene, NULL, NULL, 0), HYDRA_OK);
        tq_close(&w);
    }
}

/* The truth about misses, which is what the empty scene says, and about lights. */
static void answers_say_what_they_should(void **state) {
    (void)state;
    static const float nothing[3] = {0, 0, 0};
    assert_true(tq_miss.t < 0 && tq_miss.primitive == HYDRA_NONE && tq_miss.mesh == 0 && tq_miss.instance == 0 && tq_miss.light == 0);
    assert_memory_equal(tq_miss.normal, nothing, sizeof nothing);
    uint32_t seen[5] = {0, 0, 0, 0, 0};
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        for (uint32_t i = 0; i < tq_known(kind); i++) {
            const hydra_hit *hit = &tq_hits[kind][i];
            double square = 0;
            for (int a = 0; a < 3; a++) square += (double)hit->normal[a] * (double)hit->normal[a];
            if (!tq_occluded[kind][i])
                assert_memory_equal(hit, &tq_miss, sizeof *hit);
            else
                ht_assert_near(square, 1, 1e-5);
            assert_true(hit->light <= 4 && !(hit->light && hit->mesh));
            seen[hit->light]++;
            if (!hit->light) continue;
            assert_true(hit->primitive == HYDRA_NONE && hit->instance == 0 && hit->u == 0 && hit->v == 0);
            assert_true(hit->light == 4 || fabsf(fabsf(hit->normal[1]) - 1.0f) <= TQ_ROUNDING); /* the disc and the rectangle lie level */
        }
    }
    assert_true(seen[1] == 0 && seen[2] > 30 && seen[3] > 30 && seen[4] > 30);
}

/* Catches: a normal of what is left of a tiny triangle in the units of a tree that holds a huge one too. */
static void normals_of_the_tiny_beside_the_huge(void **state) {
    (void)state;
    if (TQ_ROUNDING > 0) skip();
    static const float positions[18] = {0, 0, 0, 3e-25f, 0, 1e-25f, 0, 3e-25f, 2e-25f, 1e20f, 0, -1e20f, 0, 1e20f, -1e20f, 1e20f, 1e20f, -1e20f};
    static const uint32_t indices[6] = {0, 1, 2, 3, 4, 5};
    const hydra_ray ray = {{1e-25f, 1e-25f, 1}, 0, {0, 0, -1}, INFINITY};
    hydra_mesh_desc desc;
    ht_host host;
    memset(&host, 0, sizeof host);
    memset(&desc, 0, sizeof desc);
    desc.positions.data = positions;
    desc.positions.stride = 3 * sizeof(float);
    desc.positions.count = 6;
    desc.indices.data = indices;
    desc.indices.stride = sizeof(uint32_t);
    desc.indices.count = 6;
    hydra_scene *scene = hydra_scene_create(ht_open(&host, NULL));
    (void)hydra_scene_add_mesh(scene, &desc);
    ht_ok(host.context, hydra_scene_commit(scene));
    hydra_hit hit;
    ht_ok(host.context, hydra_scene_closest_hits(scene, &ray, &hit, 1));
    assert_int_equal(hit.primitive, 0);
    ht_assert_near(hit.normal[0], -1 / sqrt(14), 1e-6); /* of (3, 0, 1) x (0, 3, 2) = (-3, -6, 9) */
    ht_assert_near(hit.normal[1], -2 / sqrt(14), 1e-6);
    ht_assert_near(hit.normal[2], 3 / sqrt(14), 1e-6);
    ht_ok(host.context, hydra_scene_destroy(scene));
    ht_close(&host);
}

/* Catches: sound rays left unanswered once one is not; spoiled ones that meet something, in trees or light shapes; a result
   that forgets an earlier batch, or one of the first part of a stream. */
static void unsound_rays_among_sound(void **state) {
    (void)state;
    static const uint32_t counts[] = {1, 47, 48, 257, 400, 4097}; /* the last not in quick runs */
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        for (int isa = HYDRA_ISA_SCALAR; isa <= TQ_LAST_ISA; isa++) {
            tq_world w;
            if (!tq_open(&w, kind, (hydra_isa)isa, 0)) continue;
            for (uint32_t i = 0; i < ht_pick(6, 5) && counts[i] < TQ_MOST; i++)
                for (int pattern = TQ_FIRST; pattern < TQ_PATTERNS; pattern++) tq_expect(&w, 32 * i, counts[i], pattern);
            if (!ht_quick() && kind == TQ_MESHES && isa != HYDRA_ISA_SCALAR) tq_expect(&w, 0, TQ_MOST, TQ_FIRST);
            for (uint32_t how = 0; how < TQ_SPOILS; how++) {
                hydra_ray ray = tq_spoiled(tq_rays[how], how);
                hydra_hit hit;
                uint8_t occluded = 1;
                assert_int_equal(hydra_scene_closest_hits(w.scene, &ray, &hit, 1), HYDRA_ERROR_RAY);
                assert_int_equal(hydra_scene_any_hits(w.scene, &ray, &occluded, 1), HYDRA_ERROR_RAY);
                assert_memory_equal(&hit, &tq_miss, sizeof hit);
                assert_int_equal(occluded, 0);
            }
            tq_close(&w);
        }
    }
}

#ifndef HT_VULKAN

/* ---- the memory of queries on the processor

   The allocator refuses one call or the other, or both. Catches: an answer that needs memory, a text
   written, a block lost. */
static void an_allocator_that_refuses(void **state) {
    (void)state;
    static const uint32_t counts[] = {48, 257, 4097, TQ_MOST};
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        tq_world w;
        (void)tq_open(&w, kind, HYDRA_ISA_AUTO, 0);
        ht_memory *memory = &w.host.memory;
        for (uint32_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
            if (counts[i] == TQ_MOST && (ht_quick() || kind != TQ_MESHES)) continue;
            for (int64_t later = 1; later <= 3; later++) { /* the two calls take two blocks */
                int64_t blocks = memory->blocks_now, bytes = memory->bytes_now;
                memory->fail_at = memory->calls + (later < 3 ? later : 1);
                memory->fail_after = later == 3;
                tq_expect(&w, 100 % (TQ_MOST - counts[i] + 1), counts[i], i % 2 ? TQ_NONE : TQ_SCATTERED);
                tq_expect_quiet(&w);
                assert_true(!tq_has_streams(&w) || memory->calls >= memory->fail_at);
                assert_true(memory->blocks_now == blocks && memory->bytes_now == bytes);
                assert_int_equal(hydra_memory(w.host.context).bytes_now, (size_t)bytes);
            }
            memory->fail_at = 0;
        }
        tq_close(&w);
    }
}

/* What a call takes beside what is there: of its rays only the number matters, so all go the short way past everything. */
static size_t tq_taken(tq_world *w, uint32_t count, bool any) {
    static hydra_ray rays[TQ_MOST];
    static hydra_hit hits[TQ_MOST];
    ht_memory *memory = &w->host.memory;
    for (uint32_t i = 0; i < count; i++) rays[i].origin[0] = rays[i].direction[0] = rays[i].t_max = 9;
    memory->bytes_peak = memory->bytes_now;
    if (any)
        assert_int_equal(hydra_scene_any_hits(w->scene, rays, (uint8_t *)(void *)hits, count), HYDRA_OK);
    else
        assert_int_equal(hydra_scene_closest_hits(w->scene, rays, hits, count), HYDRA_OK);
    return (size_t)(memory->bytes_peak - memory->bytes_now);
}

/* The cap refuses all that a query asks for, or leaves just the room that one takes. */
static void a_cap_that_refuses(void **state) {
    (void)state;
    const uint32_t count = 4097;
    for (int kind = TQ_MESHES; kind < TQ_SCENES; kind++) {
        tq_world free_one, capped;
        (void)tq_open(&free_one, kind, HYDRA_ISA_AUTO, 0);
        size_t now = (size_t)free_one.host.memory.bytes_now, peak = hydra_memory(free_one.host.context).bytes_peak;
        size_t taken = tq_taken(&free_one, count, false);
        assert_true(tq_taken(&free_one, count, true) <= taken);
        bool streams = tq_has_streams(&free_one);
        tq_close(&free_one);
        assert_true(!streams || now + taken > peak);
        for (uint32_t k = 0; k < 2; k++) {
            size_t cap = k == 0 || !streams ? peak : now + taken;
            (void)tq_open(&capped, kind, HYDRA_ISA_AUTO, cap);
            ht_memory *memory = &capped.host.memory;
            int64_t calls = memory->calls;
            tq_expect(&capped, 0, count, TQ_NONE);
            tq_expect_quiet(&capped);
            assert_int_equal(memory->calls, calls + (streams && k ? 2 : 0)); /* a stream for each of both calls */
            assert_true(hydra_memory(capped.host.context).bytes_peak <= cap);
            tq_close(&capped);
        }
    }
}

/* As api.h says: nothing below some fifty rays, and at most 3.3 MB, with instances 4.8 MB; where any hit does, 1.8 and 2.6 MB. */
static void memory_of_a_query(void **state) {
    (void)state;
    static const uint32_t counts[] = {1, 47, 50, 256, 1000, 4096, 4097, 65536, TQ_MOST};
    size_t most[TQ_SCENES] = {0, 0, 0, 0};
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        for (int isa = HYDRA_ISA_SCALAR; isa <= TQ_LAST_ISA; isa++) {
            tq_world w;
            if (!tq_open(&w, kind, (hydra_isa)isa, 0)) continue;
            for (uint32_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
                if (counts[i] > 4097 && !tq_has_streams(&w)) continue; /* these take no time with streams */
                size_t taken = tq_taken(&w, counts[i], true), closest = tq_taken(&w, counts[i], false);
                if (closest > most[kind]) most[kind] = closest;
                assert_true((taken == 0 && closest == 0) || counts[i] >= 48);
                assert_true(taken <= (kind == TQ_INSTANCES ? 2600000u : 1800000u));
                assert_true(closest <= (kind == TQ_INSTANCES ? 4800000u : 3300000u));
                assert_true(!tq_has_streams(&w) || counts[i] < 50 || (taken > 0 && closest > 0));
            }
            tq_close(&w);
        }
    }
    print_message("           at most %.2f MB, with instances %.2f MB\n", 1e-6 * (double)most[TQ_MESHES],
                  1e-6 * (double)most[TQ_INSTANCES]);
}

#endif

/* ---- threads */

#define TQ_THREADS 4

typedef struct tq_worker {
    const tq_world *world;
    uint32_t number;
    const char *wrong;
} tq_worker;

static void *tq_work(void *argument) {
    tq_worker *worker = (tq_worker *)argument;
    static const uint32_t counts[] = {1, 48, 300, TQ_MOST > 4097 ? 4097 : 100, 200, 47};
    for (uint32_t i = 0; i < ht_pick(12, 6) && !worker->wrong; i++) {
        tq_call call = {worker->world, 64 * worker->number, counts[(i + worker->number) % 6], i % 2 ? TQ_SCATTERED : TQ_NONE};
        worker->wrong = tq_ask(&call);
    }
    return NULL;
}

/* While the allocator refuses now and then to whoever asks. Catches: memory or texts that threads share. */
static void many_threads_on_one_scene(void **state) {
    (void)state;
    for (int kind = 0; kind < TQ_SCENES; kind++) {
        tq_world w;
        (void)tq_open(&w, kind, HYDRA_ISA_AUTO, 0);
        for (int64_t round = 0; round < 3; round++) {
            pthread_t threads[TQ_THREADS];
            tq_worker workers[TQ_THREADS];
            w.host.memory.fail_at = round && tq_has_streams(&w) ? w.host.memory.calls + 9 * round : 0;
            for (uint32_t i = 0; i < TQ_THREADS; i++) {
                tq_worker worker = {&w, i, NULL};
                workers[i] = worker;
                assert_int_equal(pthread_create(&threads[i], NULL, tq_work, &workers[i]), 0);
            }
            for (uint32_t i = 0; i < TQ_THREADS; i++) pthread_join(threads[i], NULL);
            for (uint32_t i = 0; i < TQ_THREADS; i++)
                if (workers[i].wrong) fail_msg("scene %d, thread %u: wrong is %s", kind, i, workers[i].wrong);
            tq_expect_quiet(&w);
        }
        w.host.memory.fail_at = 0;
        tq_close(&w);
    }
}

int hydra_test_queries(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(answers_of_any_batch),
        cmocka_unit_test(nothing_asked),
        cmocka_unit_test(answers_say_what_they_should),
        cmocka_unit_test(normals_of_the_tiny_beside_the_huge),
        cmocka_unit_test(unsound_rays_among_sound),
        cmocka_unit_test(many_threads_on_one_scene),
#ifndef HT_VULKAN
        cmocka_unit_test(an_allocator_that_refuses),
        cmocka_unit_test(a_cap_that_refuses),
        cmocka_unit_test(memory_of_a_query),
#endif
    };
    return cmocka_run_group_tests_name("queries", tests, tq_prepare, NULL);
}
