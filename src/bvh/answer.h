/* >>bvh-answer: what rays are answered with: hits for the renderer, hits for the caller, or whether anything was met */
#ifndef HYI_BVH_ANSWER_H
#define HYI_BVH_ANSWER_H

#include "walk.h"
#include "../../shaders/shared/shape.h"
#include "../../shaders/shared/surface.h"

/* Where the answers of rays go: one of the three, by the ray's number. */
typedef struct hyi_answers {
    hyk_hit *hits;
    hydra_hit *told;
    uint8_t *occluded;
} hyi_answers;

HYI_INLINE hyi_answers hyi_answers_from(const hyi_answers *answers, size_t first) {
    hyi_answers from;
    from.hits = answers->hits ? answers->hits + first : NULL;
    from.told = answers->told ? answers->told + first : NULL;
    from.occluded = answers->occluded ? answers->occluded + first : NULL;
    return from;
}

/* ---- for the renderer */

HYI_INLINE void hyi_answer(const hyi_accel *accel, const hyi_best *best, hyk_hit *hit) {
    bool found = best->instance != HYK_NONE;
    hit->t = found ? best->t : -1.0f;
    hit->u = best->u;
    hit->v = best->v;
    hit->instance = best->instance;
    hit->primitive = best->primitive;
    hyi_locate_in_world(accel, &hit->instance, &hit->primitive);
}

HYI_INLINE void hyi_answer_miss(hyk_hit *hit) {
    hit->t = -1.0f;
    hit->u = hit->v = 0.0f;
    hit->instance = hit->primitive = HYK_NONE;
}

/* ---- for the caller */

/* Squares of products of floats stay in double's range, so nothing has to be scaled. Component by component: a vector of two
   would wait until both have left for memory, where they have just been written one by one. */
HYI_INLINE hyk_vec3 hyi_unit_of(const double n[3]) {
    double x = hyi_rounded_double(n[0]), y = hyi_rounded_double(n[1]), z = hyi_rounded_double(n[2]);
    double inverse = hyi_rounded_double(1.0 / sqrt(hyi_sum_products(x, x, y, y, z, z)));
    return hyk_make3((float)(x * inverse), (float)(y * inverse), (float)(z * inverse));
}

/* Of a triangle whose corners' coordinates lie stride floats apart. */
HYI_INLINE hyk_vec3 hyi_unit_normal(const float *a, const float *b, const float *c, size_t stride) {
    double e[3], f[3], n[3];
    for (size_t i = 0; i < 3; i++) {
        e[i] = (double)b[i * stride] - (double)a[i * stride];
        f[i] = (double)c[i * stride] - (double)a[i * stride];
    }
    hyi_normal(e, f, n);
    return hyi_unit_of(n);
}

/* Whose triangles a tree holds is known by the instance of a hit in it, before that is located in the world. */
HYI_INLINE const hyi_bvh *hyi_tree_of(const hyi_accel *accel, uint32_t instance) {
    return accel->world && instance == 0 ? accel->world : &accel->meshes[accel->view->instances[instance].mesh];
}

/* From the caller's corners. */
HYI_FN hyk_vec3 hyi_normal_of_hit(const hyi_accel *accel, hyk_hit hit) {
    const hyk_mesh_arrays *arrays = &accel->view->mesh_arrays[accel->view->instances[hit.instance].mesh];
    const uint32_t *index = arrays->indices + 3u * (size_t)hit.primitive;
    const float *at = arrays->positions;
    return hyi_unit_normal(at + 3u * (size_t)index[0], at + 3u * (size_t)index[1], at + 3u * (size_t)index[2], 1u);
}

/* The tree's own copy of the corners has just been read, and holds the same floats unless it is scaled. */
HYI_INLINE hyk_vec3 hyi_normal_of_lane(const hyi_accel *accel, const hyi_bvh *bvh, uint32_t leaf, uint32_t lane, hyk_hit hit) {
    if (bvh->scale != 1.0f) return hyi_normal_of_hit(accel, hit);
    const float *row = hyi_leaf_rows(bvh, leaf) + lane;
    size_t count = hyi_leaf_count(leaf);
    return hyi_unit_normal(row, row + 3u * count, row + 6u * count, count);
}

/* A normal out of an instance's own space. One copy for all instruction sets: it rounds. */
HYI_NOINLINE hyk_vec3 hyi_place_normal(const hyk_instance *placed, hyk_vec3 n) { return hyk_normalize(hyk_transform_normal(*placed, n)); }

/* n: the normal in the mesh's own space. */
HYI_INLINE void hyi_tell_surface(const hyi_accel *accel, hyk_hit hit, hyk_vec3 n, hydra_hit *out) {
    const hyk_instance *placed = &accel->view->instances[hit.instance];
    if (!(placed->flags & HYK_INSTANCE_IDENTITY)) n = hyi_place_normal(placed, n);
    out->t = hit.t;
    out->u = hit.u;
    out->v = hit.v;
    out->primitive = hit.primitive;
    out->mesh = placed->mesh + 1;
    out->instance = accel->placed_ids[hit.instance];
    out->light = 0;
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

HYI_INLINE void hyi_tell_miss(hydra_hit *out) {
    out->t = -1.0f;
    out->u = out->v = 0.0f;
    out->primitive = HYDRA_NONE;
    out->mesh = out->instance = out->light = 0;
    out->normal[0] = out->normal[1] = out->normal[2] = 0.0f;
}

HYI_FN void hyi_tell_shape(const hyi_accel *accel, uint32_t light, float t, const hyk_ray *at, hydra_hit *out) {
    hyk_ray ray = hyi_load_ray(at);
    hyk_vec3 n = hyk_shape_normal(accel->view->lights[light], hyk_add_scaled(ray.origin, ray.direction, t));
    hyi_tell_miss(out);
    out->t = t;
    out->light = accel->light_ids[light];
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

/* n: the normal of the hit in the mesh's own space, of any length, where it is known; else NULL. */
HYI_INLINE void hyi_tell_flight(const hyi_accel *accel, const hyi_flight *flight, const double n[3], hydra_hit *out) {
    hyk_hit hit;
    if (flight->best.instance == HYK_NONE) {
        hyi_tell_miss(out);
        return;
    }
    hyi_answer(accel, &flight->best, &hit);
    if (n) hyi_tell_surface(accel, hit, hyi_unit_of(n), out);
    else hyi_tell_surface(accel, hit, hyi_normal_of_lane(accel, hyi_tree_of(accel, flight->best.instance), flight->best.leaf, flight->best.lane, hit), out);
}

/* ---- for either */

/* Hits of count rays from number k on will be written soon: they fill more cache lines than wait for memory at a time. */
HYI_INLINE void hyi_prefetch_answers(const hyi_answers *answers, size_t k, size_t count) {
    if (answers->occluded) return;
    const char *at = answers->told ? (const char *)&answers->told[k] : (const char *)&answers->hits[k];
    size_t bytes = count * (answers->told ? sizeof *answers->told : sizeof *answers->hits);
    for (size_t i = 0; i < bytes; i += 64u) hyi_prefetch(at + i);
}

/* Answers ray number k; n: as for hyi_tell_flight. */
HYI_INLINE void hyi_tell(const hyi_accel *accel, const hyi_flight *flight, const double n[3], const hyi_answers *answers, size_t k) {
    if (answers->occluded) answers->occluded[k] = flight->best.instance != HYK_NONE;
    else if (answers->told) hyi_tell_flight(accel, flight, n, &answers->told[k]);
    else hyi_answer(accel, &flight->best, &answers->hits[k]);
}

#endif /* HYI_BVH_ANSWER_H */
