/* All instruction sets of this machine, rays one by one and in streams, against plain C one by one: every bit. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

#define TL_MOST 70000
static hyk_ray tl_rays[TL_MOST];
static hyk_hit tl_truth[TL_MOST], tl_hits[TL_MOST];
static uint8_t tl_any_truth[TL_MOST], tl_any[TL_MOST];

/* ---- scenes: meshes within 1 of the origin that stand by themselves, and placed copies of them */

#define TL_MOST_PLACED 8

typedef struct tl_scene {
    ht_host host;
    hydra_scene *scene;
    ht_mesh mesh[3];
    hydra_mesh handle[3];
    uint32_t mesh_count, placed_count;
    hydra_instance_desc placed[TL_MOST_PLACED];
    uint32_t placed_mesh[TL_MOST_PLACED];
    float size; /* rays stay within */
} tl_scene;

static void tl_begin(tl_scene *s) {
    memset(s, 0, sizeof *s);
    s->scene = hydra_scene_create(ht_open(&s->host, NULL));
    s->size = 1.2f;
}

static hydra_instance_desc *tl_note_placed(tl_scene *s, uint32_t mesh, const float transform[12]) {
    hydra_instance_desc *desc = &s->placed[s->placed_count];
    desc->mesh = s->handle[mesh];
    memcpy(desc->transform, transform, sizeof desc->transform);
    s->placed_mesh[s->placed_count++] = mesh;
    return desc;
}

/* Takes the mesh over. Holes: by a texture (u and v of a vertex are its x and y), or by a hash of the ray. */
static void tl_add(tl_scene *s, ht_mesh mesh, hydra_alpha_mode mode) {
    static const float texels[4][4] = {{1, 0, 0, 1}, {0, 0, 0, 1}, {0.25f, 0, 0, 1}, {0.75f, 0, 0, 1}};
    const float stays[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    hydra_texture_desc texture;
    hydra_material_desc material;
    memset(&texture, 0, sizeof texture);
    memset(&material, 0, sizeof material);
    texture.texels = texels;
    texture.width = texture.height = 2;
    texture.format = HYDRA_TEXEL_RGBA32F;
    material.alpha_mode = mode;
    material.alpha_texture = hydra_scene_add_texture(s->scene, &texture);
    hydra_mesh_desc desc = ht_mesh_desc(&mesh, hydra_scene_add_material(s->scene, &material));
    desc.uvs = desc.positions;
    desc.uvs.stride = 3 * sizeof(float);
    s->mesh[s->mesh_count] = mesh;
    s->handle[s->mesh_count] = hydra_scene_add_mesh(s->scene, &desc);
    (void)tl_note_placed(s, s->mesh_count++, stays);
}

/* Mirrored and stretched; turned and small; flat; and two meshes twice at one place each. */
static void tl_add_instances(tl_scene *s) {
    const float placed[4][12] = {{-1.5f, 0, 0, 1, 0, 0.5f, 0, 0.3f, 0, 0, 2, -1},
                                 {0.06f, 0.08f, 0, -1, -0.08f, 0.06f, 0, 1, 0, 0, 0.1f, 0.5f},
                                 {1, 0.5f, 0, 0, 0, 0.001f, 0, -1, 0.25f, 0, 1, 0},
                                 {1, 0, 0, 0.25f, 0, 1, 0, 0, 0, 0, 1, 0}};
    for (uint32_t i = 0; i < 6; i++) (void)hydra_scene_add_instance(s->scene, tl_note_placed(s, i % 2, placed[i < 3 ? i : 3]));
    s->size = 2.5f;
}

static void tl_end(tl_scene *s) {
    ht_ok(s->host.context, hydra_scene_destroy(s->scene));
    for (uint32_t m = 0; m < s->mesh_count; m++) ht_mesh_free(&s->mesh[m]);
    ht_close(&s->host);
}

/* ---- rays */

/* TL_UNLIKE: of all kinds before it. TL_FAR rays pass no box by: they are slow. */
enum { TL_RANDOM, TL_SEAMS, TL_AXES, TL_LENGTHS, TL_LIMITS, TL_UNLIKE, TL_FAR, TL_BLOCKS, TL_SEAM_BLOCKS, TL_KINDS };

/* A corner of a triangle, or a point on an edge. */
static void tl_seam(const tl_scene *s, ht_rng *rng, float p[3]) {
    uint32_t k = ht_below(rng, s->placed_count), e = ht_below(rng, 3);
    const float *m = s->placed[k].transform;
    const ht_mesh *mesh = &s->mesh[s->placed_mesh[k]];
    const uint32_t *t = mesh->indices + 3 * ht_below(rng, mesh->index_count / 3);
    const float *a = mesh->positions + 3 * t[e], *b = mesh->positions + 3 * t[(e + 1) % 3];
    float f = ht_below(rng, 2) ? 0.0f : ht_uniform(rng), q[3];
    for (int i = 0; i < 3; i++) q[i] = a[i] + f * (b[i] - a[i]);
    for (int i = 0; i < 3; i++) p[i] = m[4 * i] * q[0] + m[4 * i + 1] * q[1] + m[4 * i + 2] * q[2] + m[4 * i + 3];
}

static hyk_ray tl_ray(const float o[3], const float target[3], float length) {
    hyk_ray ray;
    ray.origin = hyk_make3(o[0], o[1], o[2]);
    ray.direction = hyk_make3((target[0] - o[0]) * length, (target[1] - o[1]) * length, (target[2] - o[2]) * length);
    ray.t_min = 0;
    ray.t_max = INFINITY;
    return ray;
}

/* Along an axis, with zeros of both signs or a denormal beside it. */
static hyk_ray tl_axis_ray(const tl_scene *s, ht_rng *rng, float o[3]) {
    const float nearly[3] = {0, -0.0f, 1e-41f};
    float d[3] = {nearly[ht_below(rng, 3)], nearly[ht_below(rng, 3)], nearly[ht_below(rng, 3)]};
    uint32_t axis = ht_below(rng, 3);
    if (ht_below(rng, 2)) tl_seam(s, rng, o);
    d[axis] = ht_below(rng, 2) ? 1.0f : -1.0f;
    o[axis] = d[axis] * -s->size * (ht_below(rng, 64) ? 1.0f : 1e25f); /* beyond HYI_FAR_AWAY */
    hyk_ray ray = tl_ray(o, o, 1);
    ray.direction = hyk_make3(d[0], d[1], d[2]);
    return ray;
}

/* The last only where denormals are numbers: t of such rays is below normal, and where that is 0, all that a ray meets is a tie. */
static float tl_length(ht_rng *rng) {
    static const float lengths[] = {1e-42f, 1e-38f, 1e-30f, 1e-12f, 1e-9f, 1e9f, 1e12f, 1e30f, 1e37f};
    volatile float least = 1e-40f;
    return lengths[ht_below(rng, (uint32_t)HYI_COUNT(lengths) - (2.0f * least > 0.0f ? 0u : 1u))];
}

static hyk_ray tl_one_ray(const tl_scene *s, ht_rng *rng, uint32_t kind) {
    float o[3], p[3];
    for (int a = 0; a < 3; a++) o[a] = ht_range(rng, -s->size, s->size) * (kind == TL_FAR ? 1e6f : 1.0f);
    for (int a = 0; a < 3; a++) p[a] = ht_range(rng, -s->size, s->size);
    if (kind == TL_AXES) return tl_axis_ray(s, rng, o);
    if (kind == TL_SEAMS || (kind == TL_FAR && ht_below(rng, 2))) tl_seam(s, rng, p);
    hyk_ray ray = tl_ray(o, p, kind == TL_LENGTHS ? tl_length(rng) : 1.0f);
    if (kind == TL_LIMITS) {
        ray.t_min = ht_range(rng, -1, 1);
        ray.t_max = ht_range(rng, -0.5f, 1.5f);
    }
    return ray;
}

/* Alike: they start at one place, or nearly, towards places side by side. */
static void tl_block(const tl_scene *s, ht_rng *rng, bool seams, hyk_ray *rays, uint32_t count) {
    float o[3], p[3], spread = s->size * (seams ? 1e-6f : 0.02f), scatter = s->size * (ht_below(rng, 2) ? 0 : 1e-3f);
    bool limited = ht_below(rng, 4) == 0;
    for (int a = 0; a < 3; a++) o[a] = ht_range(rng, -s->size, s->size);
    if (ht_below(rng, 4) == 0) tl_seam(s, rng, o); /* zeros of both signs for t */
    tl_seam(s, rng, p);
    for (uint32_t i = 0; i < count; i++) {
        float from[3], to[3];
        for (int a = 0; a < 3; a++) from[a] = o[a] + ht_range(rng, -scatter, scatter);
        for (int a = 0; a < 3; a++) to[a] = p[a] + (seams && i % 4 == 0 ? 0 : ht_range(rng, -spread, spread));
        rays[i] = tl_ray(from, to, 1);
        if (!limited) continue;
        rays[i].t_min = ht_range(rng, -0.5f, 0.5f);
        rays[i].t_max = ht_range(rng, 0.5f, 2);
    }
}

static void tl_fill(const tl_scene *s, ht_rng *rng, uint32_t kind, uint32_t count) {
    for (uint32_t i = 0; i < count; i += 16) {
        uint32_t some = count - i < 16 ? count - i : 16;
        if (kind >= TL_BLOCKS) tl_block(s, rng, kind == TL_SEAM_BLOCKS, tl_rays + i, some);
        for (uint32_t k = i; k < i + some && kind < TL_BLOCKS; k++) tl_rays[k] = tl_one_ray(s, rng, kind == TL_UNLIKE ? ht_below(rng, kind) : kind);
    }
}

/* ---- comparing */

/* Returns how many hit something. */
static uint32_t tl_find_truth(const tl_scene *s, uint32_t count) {
    hyi_accel accel = s->scene->accel;
    uint32_t found = 0;
    accel.isa = HYDRA_ISA_SCALAR;
    hyi_trace_closest(&accel, NULL, tl_rays, tl_truth, count);
    hyi_trace_any(&accel, NULL, tl_rays, tl_any_truth, count);
    for (uint32_t i = 0; i < count; i++) {
        found += tl_truth[i].instance != HYK_NONE;
        assert_true(ht_finite(tl_truth[i].t) && ht_finite(tl_truth[i].u) && ht_finite(tl_truth[i].v));
        assert_int_equal(tl_any_truth[i], tl_truth[i].instance != HYK_NONE);
    }
    return found;
}

/* Through a stream made for capacity rays; 0: one by one. */
static void tl_compare(const tl_scene *s, hydra_isa isa, uint32_t capacity, uint32_t count) {
    hyi_accel accel = s->scene->accel;
    hyi_ray_stream stream;
    accel.isa = isa;
    ht_ok(s->host.context, hyi_ray_stream_alloc(s->host.context, &accel, capacity, &stream));
    memset(tl_hits, 0xa5, count * sizeof *tl_hits);
    memset(tl_any, 0xa5, count);
    hyi_trace_closest(&accel, &stream, tl_rays, tl_hits, count);
    hyi_trace_any(&accel, &stream, tl_rays, tl_any, count);
    hyi_ray_stream_free(s->host.context, &stream);
    assert_memory_equal(tl_hits, tl_truth, count * sizeof *tl_hits);
    assert_memory_equal(tl_any, tl_any_truth, count);
}

static uint32_t tl_compare_all(const tl_scene *s, uint32_t count) {
    uint32_t found = tl_find_truth(s, count);
    for (int isa = HYDRA_ISA_SSE42; isa <= HYDRA_ISA_NEON; isa++) {
        if (!hyi_isa_is_there((hydra_isa)isa)) continue;
        tl_compare(s, (hydra_isa)isa, 0, count);
        if (count >= HYI_STREAM_LEAST) tl_compare(s, (hydra_isa)isa, count, count);
        if (count > 100) tl_compare(s, (hydra_isa)isa, 100, count);
    }
    return found;
}

/* Limits at what was found, or next to it. */
static void tl_limit_to_truth(uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        float t = tl_truth[i].t;
        if (tl_truth[i].instance == HYK_NONE) continue;
        if (i % 4 < 2) tl_rays[i].t_max = i % 4 ? t : nextafterf(t, -INFINITY);
        else tl_rays[i].t_min = i % 4 == 2 ? t : nextafterf(t, INFINITY);
    }
}

/* Commits the scene, and ends it. */
static void tl_all_kinds(tl_scene *s, uint32_t seed) {
    static const uint32_t counts[TL_KINDS] = {4097, 1, 64, 4095, 49, 4096, 48, 63, 47};
    ht_rng rng = ht_rng_make(seed);
    uint32_t found = 0, rays = 0;
    ht_ok(s->host.context, hydra_scene_commit(s->scene));
    for (uint32_t i = 0; i < ht_pick(2, 1) * TL_KINDS; i++) { /* kinds and counts meet differently each time around */
        uint32_t kind = i % TL_KINDS, count = counts[(i + 2 * (i / TL_KINDS) + seed) % TL_KINDS];
        if (count > 200 && (kind == TL_FAR || (ht_quick() && seed != 12))) count = 200;
        tl_fill(s, &rng, kind, count);
        rays += count;
        found += tl_compare_all(s, count);
        if (count > 64 && i % 2) continue;
        tl_limit_to_truth(count);
        (void)tl_compare_all(s, count);
    }
    assert_true(found > rays / 20 && found < rays - rays / 50);
    tl_end(s);
}

/* ---- tests */

static void meshes_alone(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(1);
    tl_begin(&s);
    tl_add(&s, ht_soup(&rng, 3000, 1, 0.1f), HYDRA_ALPHA_OPAQUE);
    tl_all_kinds(&s, 11);
    tl_begin(&s);
    tl_add(&s, ht_icosphere(1, 3), HYDRA_ALPHA_OPAQUE);
    tl_add(&s, ht_torus(0.7f, 0.25f, 24, 16), HYDRA_ALPHA_OPAQUE);
    tl_all_kinds(&s, 12);
}

static void instances_and_holes(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(2);
    for (uint32_t k = 0; k < 3; k++) {
        tl_begin(&s);
        tl_add(&s, ht_icosphere(1, 2), k > 0 ? HYDRA_ALPHA_MASK : HYDRA_ALPHA_OPAQUE);
        tl_add(&s, ht_soup(&rng, 1000, 1, 0.2f), k > 0 ? HYDRA_ALPHA_BLEND : HYDRA_ALPHA_OPAQUE);
        if (k < 2) tl_add_instances(&s);
        tl_all_kinds(&s, 13 + k);
    }
}

/* Twenty triangles almost in one place each: t differs in the last bits. Catches: hits that are taken for certain, or for the
   nearest, or for missed, before they are worked out. */
static void thin_layers(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(5);
    for (uint32_t k = 0; k < 2; k++) {
        ht_mesh one = ht_soup(&rng, 60, 1, 0.5f), mesh = ht_soup(&rng, 60, 1, 0.5f);
        for (uint32_t layer = 0; layer < 20; layer++) ht_mesh_append(&mesh, &one);
        ht_mesh_jitter(&mesh, &rng, k ? 1e-7f : 3e-6f);
        ht_mesh_free(&one);
        tl_begin(&s);
        tl_add(&s, mesh, HYDRA_ALPHA_OPAQUE);
        tl_all_kinds(&s, 16 + k);
    }
}

/* Small triangles at t whose product with an edge function underflows, and limits next to that t. Catches: bounds of t that
   are taken for true although what they are made of was flushed to zero. */
static void near_underflow(void **state) {
    (void)state;
    static tl_scene s;
    static const float sizes[4][3] = {{1e-12f, 1e-19f, 1}, {4e-15f, 4e-15f, 1}, {1e-10f, 1e-10f, 536870912.0f}, {1e-18f, 1e-12f, 1}};
    ht_rng rng = ht_rng_make(6);
    for (uint32_t k = 0; k < HYI_COUNT(sizes); k++) {
        float size = sizes[k][0], z = sizes[k][1];
        ht_mesh mesh;
        memset(&mesh, 0, sizeof mesh);
        for (uint32_t t = 0; t < 3; t++) {
            float w = t < 2 ? size : 1, at = t == 0 ? z * 1.00001f : t == 1 ? z : 1;
            uint32_t a = ht_mesh_vertex(&mesh, -w, -w, at), b = ht_mesh_vertex(&mesh, w, -0.9f * w, at), c = ht_mesh_vertex(&mesh, 0.1f * w, w, at);
            ht_mesh_triangle(&mesh, a, b, c);
        }
        tl_begin(&s);
        tl_add(&s, mesh, HYDRA_ALPHA_OPAQUE);
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        for (uint32_t i = 0; i < 4000; i++) {
            const float o[3] = {ht_range(&rng, -0.3f, 0.3f) * size, ht_range(&rng, -0.3f, 0.3f) * size, 0};
            const float target[3] = {o[0], o[1], 1};
            tl_rays[i] = tl_ray(o, target, sizes[k][2]);
        }
        assert_int_equal(tl_compare_all(&s, 4000), 4000);
        for (uint32_t i = 0; i < 4000; i++) {
            tl_rays[i].t_min = tl_truth[i].t * (1 - 1e-7f * (float)(i % 64));
            tl_rays[i].t_max = tl_truth[i].t * (1 + 1e-7f * (float)(i % 64));
        }
        (void)tl_compare_all(&s, 4000);
        tl_end(&s);
    }
}

/* Sixteen at a time from one point, whose directions differ a little. */
static void tl_bunch(ht_rng *rng, const float o[3], hyk_ray *rays) {
    uint32_t axis = ht_below(rng, 3);
    float slope[2] = {ht_range(rng, -0.6f, 0.6f), ht_range(rng, -0.6f, 0.6f)}, spread = ht_below(rng, 4) ? ht_range(rng, 0, 0.2f) : 0, d[3];
    for (uint32_t i = 0; i < 16; i++) {
        d[axis] = 1;
        for (uint32_t a = 0; a < 2; a++) d[(axis + 1 + a) % 3] = slope[a] + ht_range(rng, -spread, spread);
        rays[i] = tl_ray(o, o, 1);
        rays[i].direction = hyk_make3(d[0], d[1], d[2]);
        rays[i].t_min = -1;
    }
}

/* Packets among triangles whose coordinates are a few of the smallest floats, in a tree that is not scaled. Catches: a leaf sifted
   with a margin that underflows. */
static void packets_below_normal(void **state) {
    (void)state;
    static tl_scene s;
    const uint32_t meshes = ht_pick(80, 40), count = 256;
    uint32_t found = 0;
    volatile float least = 1e-40f; /* 0 where denormals are flushed, as with fast-math: there nothing is left of these triangles */
    ht_rng rng = ht_rng_make(9);
    for (uint32_t k = 0; k < meshes; k++) {
        float unit = ldexpf(1, k % 2 ? -149 : -132), p[4][3];
        ht_mesh mesh;
        memset(&mesh, 0, sizeof mesh);
        for (uint32_t t = 0; t < 40; t++) {
            for (uint32_t i = 0; i < 12; i++) p[i / 3][i % 3] = t ? ((float)ht_below(&rng, 9) - 4.0f) * unit : ht_range(&rng, -5, 5);
            uint32_t a = ht_mesh_vertex(&mesh, p[0][0], p[0][1], p[0][2]), b = ht_mesh_vertex(&mesh, p[1][0], p[1][1], p[1][2]);
            ht_mesh_triangle(&mesh, a, b, ht_mesh_vertex(&mesh, p[2][0], p[2][1], p[2][2]));
        }
        tl_begin(&s);
        tl_add(&s, mesh, HYDRA_ALPHA_OPAQUE);
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        for (uint32_t i = 0; i < count; i += 16) tl_bunch(&rng, p[3], tl_rays + i);
        found += tl_compare_all(&s, count);
        tl_end(&s);
    }
    assert_true(found > meshes * count / 4 || !(2.0f * least > 0.0f));
}

/* Triangles of sizes down to 1e-30 around one point: the deepest trees. Catches: lists that outgrow their memory. */
static void deep_trees(void **state) {
    (void)state;
    static tl_scene s;
    const uint32_t counts[3] = {48, 64, ht_pick(4096, 1000)};
    ht_rng rng = ht_rng_make(4);
    ht_mesh mesh = ht_soup(&rng, 8000, 1, 0.3f);
    for (uint32_t v = 0; v < 3 * mesh.vertex_count; v++) mesh.positions[v] *= powf(10, -30.0f * (float)(v / 9) / 8000.0f);
    tl_begin(&s);
    tl_add(&s, mesh, HYDRA_ALPHA_OPAQUE);
    ht_ok(s.host.context, hydra_scene_commit(s.scene));
    assert_true(s.scene->world.depth > 30);
    for (uint32_t k = 0; k < 3; k++) {
        for (uint32_t i = 0; i < counts[k]; i++) { /* all towards the point, from one side */
            memset(&tl_rays[i], 0, sizeof tl_rays[i]);
            tl_rays[i].origin = hyk_make3(ht_range(&rng, 0.001f, 0.01f), ht_range(&rng, 0.001f, 0.01f), 2);
            tl_rays[i].direction = hyk_neg(tl_rays[i].origin);
            tl_rays[i].t_min = 0.9999999f; /* past all that stands before the point */
            tl_rays[i].t_max = INFINITY;
        }
        (void)tl_compare_all(&s, counts[k]);
    }
    tl_end(&s);
}

/* Many slices; and alike rays do go in packets. */
static void many_rays(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(3);
    hyi_ray_stream stream;
    tl_begin(&s);
    tl_add(&s, ht_soup(&rng, 3000, 1, 0.1f), HYDRA_ALPHA_OPAQUE);
    ht_ok(s.host.context, hydra_scene_commit(s.scene));
    tl_fill(&s, &rng, TL_RANDOM, TL_MOST);
    tl_fill(&s, &rng, TL_BLOCKS, TL_MOST / 2);
    (void)tl_find_truth(&s, TL_MOST);
    tl_compare(&s, s.scene->accel.isa, TL_MOST, TL_MOST);
    ht_ok(s.host.context, hyi_ray_stream_alloc(s.host.context, &s.scene->accel, TL_MOST, &stream));
    hyi_site site = hyi_first_site(&s.scene->accel);
    hyi_begun begun = {0, 0, 0, {0.0f, 0.0f, 0.0f}, true};
    hyi_answers answers = {tl_hits, NULL, NULL};
    HYI_DISPATCH_VECTOR(site.accel->isa, hyi_begin_rays, (&site, &stream, tl_rays, &answers, stream.capacity, stream.packet_share, &begun))
    assert_true(begun.sound && begun.flights <= begun.rays / 4);
    hyi_ray_stream_free(s.host.context, &stream);
    tl_end(&s);
}

/* More packets in an instance than there is room for at a time; and rays of lengths with which they go in none. */
static void alike_in_instances(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(4);
    tl_begin(&s);
    tl_add(&s, ht_icosphere(1, 2), HYDRA_ALPHA_OPAQUE);
    tl_add(&s, ht_torus(0.7f, 0.25f, 24, 16), HYDRA_ALPHA_OPAQUE);
    tl_add_instances(&s);
    ht_ok(s.host.context, hydra_scene_commit(s.scene));
    for (uint32_t k = 0; k < 4; k++) {
        tl_block(&s, &rng, false, tl_rays, HYI_STREAM_RAYS);
        for (uint32_t i = 0; i < HYI_STREAM_RAYS && k == 3; i++) tl_rays[i].direction = hyk_scale(tl_rays[i].direction, 1e12f);
        assert_true(tl_compare_all(&s, HYI_STREAM_RAYS) > HYI_STREAM_RAYS / 2);
    }
    tl_end(&s);
}

/* Sixteen at a time from one place, or nearly, far away, towards seams all over the mesh, or past them. */
static void tl_fan(const tl_scene *s, ht_rng *rng, hyk_ray *rays) {
    static const float away[3] = {3.5f, 2, 1.2f}; /* of one octant and axis */
    float from[3], scatter = ht_below(rng, 2) ? 0 : 2e-3f;
    uint32_t turn = ht_below(rng, 3);
    for (uint32_t a = 0; a < 3; a++) from[a] = away[(a + turn) % 3] * (ht_below(rng, 2) ? 1.0f : -1.0f);
    for (uint32_t i = 0; i < 16; i++) {
        float o[3], p[3], past = i % 3 ? 0 : 1e-3f;
        tl_seam(s, rng, p);
        for (int a = 0; a < 3; a++) o[a] = from[a] + ht_range(rng, -scatter, scatter);
        for (int a = 0; a < 3; a++) p[a] += ht_range(rng, -past, past);
        rays[i] = tl_ray(o, p, 1);
    }
}

/* Triangles once, twice nearly at one place, and twice at the very same. */
static ht_mesh tl_layers(ht_rng *rng) {
    ht_mesh one = ht_soup(rng, 1000, 0.5f, 0.08f), mesh = ht_soup(rng, 1000, 0.5f, 0.08f);
    for (uint32_t layer = 0; layer < 4; layer++) {
        ht_mesh_append(&mesh, &one);
        if (layer == 1) ht_mesh_jitter(&mesh, rng, 1e-7f);
    }
    ht_mesh_free(&one);
    return mesh;
}

/* Packets whose rays meet different leaves. Catches: what a ray of few that meet a leaf is told of it, or keeps, otherwise than
   where all of the packet do. */
static void packets_that_part(void **state) {
    (void)state;
    static tl_scene s;
    static const float mirrored[12] = {-1, 0, 0, 0.05f, 0, 0.75f, 0, 0, 0, 0, 1, 0};
    const uint32_t count = ht_pick(4096, 1024);
    ht_rng rng = ht_rng_make(7);
    for (uint32_t k = 0; k < 2; k++) {
        tl_begin(&s);
        tl_add(&s, tl_layers(&rng), HYDRA_ALPHA_OPAQUE);
        if (k == 1) (void)hydra_scene_add_instance(s.scene, tl_note_placed(&s, 0, mirrored));
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        for (uint32_t i = 0; i < count; i += 16) tl_fan(&s, &rng, tl_rays + i);
        assert_true(tl_compare_all(&s, count) > count / 2);
        tl_limit_to_truth(count);
        (void)tl_compare_all(&s, count);
        tl_end(&s);
    }
}

/* Needles along one direction, as far from the middle as they are wide: thin, or of several widths. */
#define TL_THIN 3e-6f
static const float tl_slope[2] = {0.53f, 0.31f};

static ht_mesh tl_bundle(ht_rng *rng, bool widths) {
    ht_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    for (uint32_t t = 0; t < 600; t++) {
        float width = TL_THIN * (float)(1u << (widths ? t % 6 : 0));
        uint32_t v[3];
        for (int k = 0; k < 3; k++) {
            float z = ht_range(rng, -0.5f, 0.5f);
            v[k] = ht_mesh_vertex(&mesh, tl_slope[0] * z + ht_range(rng, -width, width), tl_slope[1] * z + ht_range(rng, -width, width), z);
        }
        ht_mesh_triangle(&mesh, v[0], v[1], v[2]);
    }
    return mesh;
}

/* Along the needles; seam: towards an edge of one. */
static hyk_ray tl_ray_along(const tl_scene *s, ht_rng *rng, float away, bool seam) {
    float o[3] = {0, 0, away}, p[3] = {0, 0, 0};
    if (seam) tl_seam(s, rng, p);
    for (int a = 0; a < 2; a++) {
        p[a] += seam ? 0 : ht_range(rng, -TL_THIN, TL_THIN);
        o[a] = tl_slope[a] * away + ht_range(rng, -TL_THIN, TL_THIN);
    }
    return tl_ray(o, p, 1);
}

/* t at the corners differs a lot, and what shearing rounds is much of a needle's width. Catches: bounds of t from that width alone,
   without the distance; t of a plane that the ray meets beside the needle. */
static void along_needles(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(8);
    for (uint32_t k = 0; k < 2; k++) {
        tl_begin(&s);
        tl_add(&s, tl_bundle(&rng, k == 1), HYDRA_ALPHA_OPAQUE);
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        const uint32_t count = k == 1 ? 16384 : 4096;
        for (uint32_t i = 0; i < count; i++) { /* half of them by themselves */
            float away = i < count / 2 ? ht_range(&rng, 2, 4) * (ht_below(&rng, 2) ? 1.0f : -1.0f) : 3;
            tl_rays[i] = tl_ray_along(&s, &rng, away, k == 1 && i % 4);
        }
        assert_true(tl_compare_all(&s, count) > count / 4);
        tl_end(&s);
    }
}

/* Lists for which the levels above have left no room go one by one, with hits that are put off already. */
static void lists_without_room(void **state) {
    (void)state;
    static tl_scene s;
    ht_rng rng = ht_rng_make(5);
    tl_begin(&s);
    ht_mesh mesh = ht_soup(&rng, 3000, 1, 0.4f);
    for (uint32_t i = 0; i < 9000; i++) { /* the nearer to the middle, the more, and all rays pass there */
        for (int a = 0; a < 3; a++) mesh.positions[3 * i + (uint32_t)a] *= powf(0.5f, (float)(i / 3) / 300);
    }
    tl_add(&s, mesh, HYDRA_ALPHA_OPAQUE);
    ht_ok(s.host.context, hydra_scene_commit(s.scene));
    tl_fill(&s, &rng, TL_RANDOM, HYI_STREAM_RAYS);
    for (uint32_t i = 0; i < HYI_STREAM_RAYS; i++) {
        const hyk_vec3 o = tl_rays[i].origin;
        tl_rays[i].direction = hyk_make3(ht_range(&rng, -1e-3f, 1e-3f) - o.x, ht_range(&rng, -1e-3f, 1e-3f) - o.y, ht_range(&rng, -1e-3f, 1e-3f) - o.z);
        tl_rays[i].t_min = -1;
        tl_rays[i].t_max = 4;
    }
    assert_true(tl_find_truth(&s, HYI_STREAM_RAYS) > HYI_STREAM_RAYS / 2);
    for (int isa = 2 * HYDRA_ISA_SSE42; isa <= 2 * HYDRA_ISA_NEON + 1; isa++) {
        hyi_accel accel = s.scene->accel;
        hyi_ray_stream stream;
        accel.isa = (hydra_isa)(isa / 2);
        if (!hyi_isa_is_there(accel.isa)) continue;
        ht_ok(s.host.context, hyi_ray_stream_alloc(s.host.context, &accel, HYI_STREAM_RAYS, &stream));
        size_t whole = stream.list_count;
        stream.list_count = 12u * (HYI_STREAM_RAYS + 16u) + HYI_LIST_RESERVE; /* as few as a list begins with */
        memset(stream.lists + stream.list_count, 0xa5, (whole - stream.list_count) * sizeof *stream.lists);
        hyi_trace_closest(&accel, &stream, tl_rays, tl_hits, HYI_STREAM_RAYS);
        for (size_t i = stream.list_count; i < whole; i++) assert_int_equal(stream.lists[i], 0xa5a5a5a5u);
        stream.list_count = whole;
        hyi_ray_stream_free(s.host.context, &stream);
        assert_memory_equal(tl_hits, tl_truth, HYI_STREAM_RAYS * sizeof *tl_hits);
    }
    tl_end(&s);
}

/* As many flights wait at the root as are let wait anywhere: of all that they come to, the last goes first. */
static void waiting_in_numbers(void **state) {
    (void)state;
    static tl_scene s;
    static hyi_waiters waiters;
    ht_rng rng = ht_rng_make(6);
    tl_begin(&s);
    tl_add(&s, ht_soup(&rng, 3000, 1, 0.1f), HYDRA_ALPHA_OPAQUE);
    ht_ok(s.host.context, hydra_scene_commit(s.scene));
    tl_fill(&s, &rng, TL_RANDOM, HYI_NODES_ENOUGH);
    assert_true(tl_find_truth(&s, HYI_NODES_ENOUGH) > HYI_NODES_ENOUGH / 4);
    for (int isa = HYDRA_ISA_SSE42; isa <= HYDRA_ISA_NEON; isa++) {
        hyi_accel accel = s.scene->accel;
        hyi_ray_stream stream;
        hyi_swarm swarm;
        hyi_begun begun = {0, 0, 0, {0.0f, 0.0f, 0.0f}, true};
        hyi_answers answers = {tl_hits, NULL, NULL};
        accel.isa = (hydra_isa)isa;
        if (!hyi_isa_is_there(accel.isa)) continue;
        ht_ok(s.host.context, hyi_ray_stream_alloc(s.host.context, &accel, HYI_NODES_ENOUGH, &stream));
        hyi_site site = hyi_first_site(&accel);
        HYI_DISPATCH_VECTOR(accel.isa, hyi_begin_rays, (&site, &stream, tl_rays, &answers, HYI_NODES_ENOUGH, 0, &begun))
        assert_int_equal(begun.flights, HYI_NODES_ENOUGH);
        memset(&swarm, 0, sizeof swarm);
        swarm.site = site;
        swarm.stream = &stream;
        swarm.flights = stream.flights;
        waiters.at_leaves = 0;
        waiters.at_nodes = HYI_NODES_ENOUGH;
        for (uint32_t i = 0; i < HYI_NODES_ENOUGH; i++) {
            waiters.node_rays[i] = i;
            waiters.nodes[i] = site.bvh->root;
        }
        HYI_DISPATCH_VECTOR(accel.isa, (void)hyi_run_nodes, (&swarm, &waiters))
        HYI_DISPATCH_VECTOR(accel.isa, (void)hyi_run_leaves, (&swarm, &waiters))
        HYI_DISPATCH_VECTOR(accel.isa, hyi_settle_all, (&site, stream.flights, HYI_NODES_ENOUGH))
        for (uint32_t i = 0; i < HYI_NODES_ENOUGH; i++) hyi_tell(&accel, &stream.flights[i], NULL, &answers, (size_t)(stream.flights[i].ray - tl_rays));
        hyi_ray_stream_free(s.host.context, &stream);
        assert_memory_equal(tl_hits, tl_truth, HYI_NODES_ENOUGH * sizeof *tl_hits);
    }
    tl_end(&s);
}

/* The slabs of blocks are as thick as the farthest ray of a slice needs: rays from near by, and from as far as coordinates are, go in
   blocks, and one from very far away keeps its slice from it. */
static void thick_slabs(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        const float middle = k == 2 ? 5000.0f : 0.0f;
        const float bounds[3] = {1.0f, k == 1 ? 0.0f : 1.0f, 1.0f}, direction[3] = {0.5f, 0.6f, 0.7f};
        hyi_bvh bvh;
        memset(&bvh, 0, sizeof bvh);
        bvh.scale = 1.0f;
        for (int a = 0; a < 3; a++) bvh.scaled.lower[a] = middle - bounds[a], bvh.scaled.upper[a] = middle + bounds[a];
        for (float away = 0.25f; away < 1e7f; away *= 2.0f) {
            const float origin[3] = {middle + away, middle, middle - away};
            hyi_aim aim;
            float bound[3] = {0.0f, 0.0f, 0.0f};
            assert_true(hyi_aim_at(&aim, &bvh, origin, direction, 0.0f, 1.0f, false));
            hyi_cover_slabs(bound, &aim, &bvh.scaled, false);
            for (int a = 0; a < 3; a++) { /* what was moved: twice the bound, as far as roundings of offsets tell it */
                float moved = (aim.far_offset[a] - aim.near_offset[a]) / fabsf(aim.inverse[a]);
                assert_true(moved <= 2.0f * bound[a] + 4.0f * HYI_ULP * fabsf(origin[a]) && moved >= 2.0f * bound[a] - 4.0f * HYI_ULP * fabsf(origin[a]));
            }
            if (away < 256.0f) assert_false(hyi_slabs_are_thick(&bvh.scaled, bound));
            if (away > 1e6f) assert_true(hyi_slabs_are_thick(&bvh.scaled, bound));
        }
    }
}

/* Triangles that collapse to a point far away keep their place in a refitted tree: boxes reach there, from the midst of the others. */
static void boxes_that_reach_far(void **state) {
    (void)state;
    for (int k = 0; k < 14; k++) {
        static tl_scene s;
        ht_rng rng = ht_rng_make(80 + (uint64_t)k);
        hydra_view none;
        memset(&none, 0, sizeof none);
        tl_begin(&s);
        const float size = 1.0f / 64.0f; /* scales keep to coordinates below 2^20: so much larger is the way to there */
        s.size = size;
        ht_mesh mesh = ht_soup(&rng, 3000, size, 0.1f * size);
        hydra_material_desc material;
        memset(&material, 0, sizeof material);
        hydra_mesh_desc desc = ht_mesh_desc(&mesh, hydra_scene_add_material(s.scene, &material));
        desc.dynamic = true;
        hydra_mesh handle = hydra_scene_add_mesh(s.scene, &desc);
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        for (uint32_t v = 0; v < mesh.vertex_count; v += 3) {
            float *p = mesh.positions + 3 * v;
            if (fabsf(p[0]) + fabsf(p[1]) + fabsf(p[2]) < 0.5f * size)
                for (int i = 0; i < 9; i++) p[i] = ldexpf(k % 2 ? 1.0f : -1.0f, 7 + k);
        }
        ht_ok(s.host.context, hydra_scene_move_vertices(s.scene, handle, desc.positions, none));
        ht_ok(s.host.context, hydra_scene_commit(s.scene));
        tl_fill(&s, &rng, TL_RANDOM, 4096);
        assert_true(tl_compare_all(&s, 4096) > 100);
        ht_mesh_free(&mesh);
        tl_end(&s);
    }
}

int hydra_test_lanes(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_alone),
        cmocka_unit_test(instances_and_holes),
        cmocka_unit_test(thin_layers),
        cmocka_unit_test(near_underflow),
        cmocka_unit_test(packets_below_normal),
        cmocka_unit_test(deep_trees),
        cmocka_unit_test(many_rays),
        cmocka_unit_test(alike_in_instances),
        cmocka_unit_test(packets_that_part),
        cmocka_unit_test(along_needles),
        cmocka_unit_test(lists_without_room),
        cmocka_unit_test(waiting_in_numbers),
        cmocka_unit_test(thick_slabs),
        cmocka_unit_test(boxes_that_reach_far),
    };
    return cmocka_run_group_tests_name("lanes", tests, NULL, NULL);
}
