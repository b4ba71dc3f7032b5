/* What the tests of trees over triangles share: a context made by hand, scenes of one mesh or of a few instances that are
   put together without hydra_scene, and rays at them. For files that have a copy of the library of their own. */
#ifndef BVH_HELPERS_H
#define BVH_HELPERS_H

#include "hydra_test.h"

/* ---- a context made by hand: no thread of its own */

typedef struct tb_host {
    hydra_context context;
    ht_memory memory;
} tb_host;

static inline void tb_open(tb_host *host) {
    memset(host, 0, sizeof *host);
    host->context.desc.allocator = ht_memory_allocator(&host->memory);
    host->context.threads = 1;
}

static inline void tb_close(tb_host *host) {
    assert_int_equal(host->memory.blocks_now, 0);
    assert_int_equal(host->memory.bytes_now, 0);
    assert_int_equal(host->memory.damaged, 0);
    assert_int_equal(hyi_atomic_load(&host->context.bytes_now), 0);
}

/* ---- scenes of a few instances */

#define TB_MESHES 4
#define TB_INSTANCES 12

typedef struct tb_scene {
    tb_host host;
    ht_mesh mesh[TB_MESHES];
    uint32_t mesh_count, instance_count;
    hyi_bvh bvh[TB_MESHES], top;
    hyk_instance instances[TB_INSTANCES];
    hyk_scene_view view;
    hyi_accel accel;
} tb_scene;

static inline void tb_build_mesh(tb_scene *s, ht_mesh mesh) {
    uint32_t m = s->mesh_count++;
    float cost;
    s->mesh[m] = mesh;
    assert_int_equal(hyi_bvh_build_triangles(&s->host.context, mesh.positions, mesh.indices, mesh.index_count / 3, HYDRA_BUILD_BEST, &s->bvh[m], &cost), HYDRA_OK);
}

static inline void tb_begin(tb_scene *s) {
    memset(s, 0, sizeof *s);
    tb_open(&s->host);
    s->view.instances = s->instances;
    s->accel.view = &s->view;
    s->accel.meshes = s->bvh;
    s->accel.instances = &s->top;
    s->accel.isa = hyi_best_isa();
}

/* A scene of one unmoved mesh; takes the mesh over. */
static inline void tb_single(tb_scene *s, ht_mesh mesh) {
    tb_begin(s);
    tb_build_mesh(s, mesh);
    s->instances[0].flags = HYK_INSTANCE_IDENTITY;
    s->instance_count = 1;
    s->accel.single = true;
}

static inline void tb_end(tb_scene *s) {
    for (uint32_t m = 0; m < s->mesh_count; m++) {
        hyi_bvh_free(&s->host.context, &s->bvh[m]);
        ht_mesh_free(&s->mesh[m]);
    }
    hyi_bvh_free(&s->host.context, &s->top);
    tb_close(&s->host);
}

/* ---- meshes */

/* A flat grid in z = 0, all boxes flat and sharing planes. */
static inline ht_mesh tb_grid(uint32_t n) {
    const float centre[3] = {0, 0, 0}, u[3] = {1, 0, 0}, v[3] = {0, 1, 0};
    return ht_quad(centre, u, v, n);
}

/* Long and thin, right across the cube, so that all their boxes overlap; size: of the one short edge. */
static inline ht_mesh tb_needles(ht_rng *rng, uint32_t count, float size) {
    ht_mesh mesh = ht_soup(rng, count, 1.0f, size);
    for (uint32_t t = 0; t < count; t++) {
        float *p = mesh.positions + 3 * mesh.indices[3 * t + 2];
        for (int a = 0; a < 3; a++) p[a] = ht_range(rng, -1, 1);
    }
    return mesh;
}

/* ---- rays */

static inline hyk_ray tb_ray(const float o[3], const float d[3], float t_min, float t_max) {
    hyk_ray ray;
    ray.origin = hyk_make3(o[0], o[1], o[2]);
    ray.direction = hyk_make3(d[0], d[1], d[2]);
    ray.t_min = t_min;
    ray.t_max = t_max;
    return ray;
}

/* From within a cube to within a cube, of any length; some along axes, some short. */
static inline hyk_ray tb_random_ray(ht_rng *rng, float size) {
    float o[3], d[3];
    for (int a = 0; a < 3; a++) {
        o[a] = ht_range(rng, -size, size);
        d[a] = ht_range(rng, -size, size) - o[a];
    }
    uint32_t kind = ht_below(rng, 16);
    if (kind < 3) d[kind] = 0;
    if (kind == 3) d[ht_below(rng, 3)] = -0.0f, d[ht_below(rng, 3)] = 1e-41f;
    if (kind == 4) for (int a = 0; a < 3; a++) o[a] = (float)(int)o[a];
    if (d[0] == 0 && d[1] == 0 && d[2] == 0) d[0] = 1;
    return tb_ray(o, d, kind == 5 ? 0.3f : 0, kind == 6 ? 0.7f : INFINITY);
}

/* The closest hit, and that any hit says the same. */
static inline hyk_hit tb_one(const tb_scene *s, float ox, float oy, float oz, float dx, float dy, float dz, float t_min, float t_max) {
    const float o[3] = {ox, oy, oz}, d[3] = {dx, dy, dz};
    hyk_ray ray = tb_ray(o, d, t_min, t_max);
    hyk_hit hit;
    uint8_t any;
    hyi_trace_closest(&s->accel, NULL, &ray, &hit, 1);
    hyi_trace_any(&s->accel, NULL, &ray, &any, 1);
    assert_int_equal(any, hit.instance != HYK_NONE);
    return hit;
}

#endif /* BVH_HELPERS_H */
