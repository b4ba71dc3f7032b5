/* What the tests of trees that outlive their geometry or their program share: a scene with one mesh, and rays at it that
   tell it from another. For files that have a copy of the library of their own. */
#ifndef TREE_HELPERS_H
#define TREE_HELPERS_H

#include "hydra_test.h"

/* ---------------------------------------------------------------- a scene with one mesh */

typedef struct world {
    ht_host host;
    hydra_scene *scene;
    hydra_mesh mesh;
} world;

static inline hydra_view view_of(const float *data, size_t count) {
    hydra_view view;
    view.data = data;
    view.stride = 0;
    view.count = count;
    return view;
}

static inline hydra_view nothing(void) { return view_of(NULL, 0); }

/* desc: NULL, or with threads or a cap. */
static inline void open_world(world *w, const hydra_context_desc *desc) {
    memset(w, 0, sizeof *w);
    assert_non_null(ht_open(&w->host, desc));
    w->scene = hydra_scene_create(w->host.context);
    assert_non_null(w->scene);
}

static inline hydra_mesh add_mesh(world *w, const ht_mesh *mesh, bool dynamic, hydra_build build) {
    hydra_material none = {0};
    hydra_mesh_desc desc = ht_mesh_desc(mesh, none);
    desc.dynamic = dynamic;
    desc.build = build;
    hydra_mesh made = hydra_scene_add_mesh(w->scene, &desc);
    assert_int_not_equal(made.id, 0);
    return made;
}

static inline void open_mesh(world *w, const ht_mesh *mesh, bool dynamic, hydra_build build) {
    open_world(w, NULL);
    w->mesh = add_mesh(w, mesh, dynamic, build);
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
}

static inline void close_world(world *w) {
    assert_int_equal(hydra_scene_destroy(w->scene), HYDRA_OK);
    ht_close(&w->host);
}

static inline hydra_scene_info info_of(const world *w) {
    hydra_scene_info info;
    ht_ok(w->host.context, hydra_scene_get_info(w->scene, &info));
    return info;
}

static inline hydra_mesh_info mesh_info_of(const world *w, hydra_mesh mesh) {
    hydra_mesh_info info;
    ht_ok(w->host.context, hydra_scene_get_mesh_info(w->scene, mesh, &info));
    return info;
}

static inline void move(world *w, const ht_mesh *to) {
    ht_ok(w->host.context, hydra_scene_move_vertices(w->scene, w->mesh, view_of(to->positions, to->vertex_count), nothing()));
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
}

/* ---------------------------------------------------------------- rays at it */

enum { RAYS = 400 };

/* From one point in the bounds, widened to twice their size, to another inside. */
static inline void make_rays(const hydra_scene_info *info, hydra_ray rays[RAYS]) {
    ht_rng rng = ht_rng_make(7);
    for (int i = 0; i < RAYS; i++) {
        for (int a = 0; a < 3; a++) {
            double low = (double)info->bounds_min[a], extent = (double)info->bounds_max[a] - low;
            double from = low + extent * (2.0 * (double)ht_uniform(&rng) - 0.5), to = low + extent * (double)ht_uniform(&rng);
            rays[i].origin[a] = (float)from;
            rays[i].direction[a] = (float)(to - from);
        }
        rays[i].t_min = 0;
        rays[i].t_max = INFINITY;
    }
}

static inline void shoot(const world *w, const hydra_ray rays[RAYS], hydra_hit hits[RAYS]) {
    static uint8_t blocked[RAYS];
    assert_int_equal(hydra_scene_closest_hits(w->scene, rays, hits, RAYS), HYDRA_OK);
    assert_int_equal(hydra_scene_any_hits(w->scene, rays, blocked, RAYS), HYDRA_OK);
    for (int i = 0; i < RAYS; i++) assert_int_equal(blocked[i], hits[i].t >= 0);
}

/* Ties have one answer whatever the tree, so hits of two scenes agree to the bit. Returns how many there were. */
static inline uint32_t expect_same_hits(const world *a, const world *b) {
    static hydra_ray rays[RAYS];
    static hydra_hit hits_a[RAYS], hits_b[RAYS];
    hydra_scene_info info_a = info_of(a), info_b = info_of(b);
    assert_memory_equal(info_a.bounds_min, info_b.bounds_min, sizeof info_a.bounds_min);
    assert_memory_equal(info_a.bounds_max, info_b.bounds_max, sizeof info_a.bounds_max);
    assert_int_equal(info_a.degenerate, info_b.degenerate);
    make_rays(&info_b, rays);
    bool castable = memcmp(info_b.bounds_min, info_b.bounds_max, sizeof info_b.bounds_min) != 0;
    if (!castable) return 0;
    shoot(a, rays, hits_a);
    shoot(b, rays, hits_b);
    uint32_t hit = 0;
    for (int i = 0; i < RAYS; i++) {
        assert_memory_equal(&hits_a[i], &hits_b[i], sizeof hits_a[i]);
        hit += hits_a[i].t >= 0 ? 1u : 0u;
    }
    return hit;
}

/* The scene against a fresh one with the same mesh as it is now. */
static inline uint32_t expect_like_fresh(const world *w, const ht_mesh *now) {
    world fresh;
    open_mesh(&fresh, now, true, HYDRA_BUILD_AUTO);
    uint32_t hit = expect_same_hits(w, &fresh);
    close_world(&fresh);
    return hit;
}

/* ---------------------------------------------------------------- meshes */

static inline ht_mesh copy_of(const ht_mesh *mesh) {
    ht_mesh copy;
    memset(&copy, 0, sizeof copy);
    ht_mesh_append(&copy, mesh);
    return copy;
}

static inline ht_mesh some_mesh(uint32_t kind) {
    ht_rng rng = ht_rng_make(kind);
    if (kind == 0) return ht_soup(&rng, 700, 1.0f, 0.2f);
    if (kind == 1) return ht_icosphere(1.0f, 3);
    if (kind == 2) return ht_torus(1.0f, 0.3f, 120, 60); /* more nodes than HYI_REFIT_PARTS: several parts */
    if (kind == 3) return ht_soup(&rng, 5, 1.0f, 0.5f);  /* one leaf */
    return ht_soup(&rng, 300, 1.0f, 2.0f);               /* large ones that cross: what spatial splits cut up */
}

#endif /* TREE_HELPERS_H */
