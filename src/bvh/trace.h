/* >>bvh-trace: what the renderer calls: batches of rays against surfaces, then against light shapes */
#ifndef HYI_BVH_TRACE_H
#define HYI_BVH_TRACE_H

#include "build.h"
#include "traverse_scalar.h"
#include "traverse_avx2.h"
#include "traverse_neon.h"
#include "../../shaders/shared/shape.h"

HYI_INLINE uint32_t hyi_walk_flags(const hyi_accel *accel) {
    return (accel->mesh_has_alpha ? HYI_WALK_ALPHA : 0u) | (accel->single ? 0u : HYI_WALK_LEVELS);
}

HYI_FN void hyi_trace_dispatch(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    switch (accel->isa) {
#if HYI_X86
    case HYDRA_ISA_AVX2: hyi_trace_avx2(accel, rays, hits, occluded, count, flags); return;
#endif
#if HYI_NEON
    case HYDRA_ISA_NEON: hyi_trace_neon(accel, rays, hits, occluded, count, flags); return;
#endif
    default: hyi_trace_scalar(accel, rays, hits, occluded, count, flags); return;
    }
}

/* Closest hits of count rays on triangles: instance HYK_NONE and t -1 on a miss. Ties: smallest instance,
   then primitive. Light shapes are not looked at. */
HYI_FN void hyi_trace_closest(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint32_t count) {
    if (!accel->empty) {
        hyi_trace_dispatch(accel, rays, hits, NULL, count, hyi_walk_flags(accel));
        return;
    }
    for (uint32_t i = 0; i < count; i++) {
        hits[i].t = -1.0f;
        hits[i].u = hits[i].v = 0.0f;
        hits[i].instance = hits[i].primitive = HYK_NONE;
    }
}

/* occluded[i] is set to 0 or 1. Light shapes are not looked at. */
HYI_FN void hyi_trace_any(const hyi_accel *accel, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    if (accel->empty) memset(occluded, 0, count);
    else hyi_trace_dispatch(accel, rays, NULL, occluded, count, hyi_walk_flags(accel) | HYI_WALK_ANY);
}

/* ---- light shapes: few, so one walk at a time does */

HYI_FN void hyi_shapes_visit_node(hyi_walk *walk) {
    switch (walk->accel->isa) {
#if HYI_X86
    case HYDRA_ISA_AVX2: hyi_visit_node_avx2(walk); return;
#endif
#if HYI_NEON
    case HYDRA_ISA_NEON: hyi_visit_node_neon(walk); return;
#endif
    default: hyi_visit_node_scalar(walk); return;
    }
}

HYI_FN void hyi_shapes_visit_leaf(hyi_walk *walk, bool skip_hidden) {
    uint32_t index = walk->accel->shape_lights[walk->bvh->ids[hyi_leaf_first(walk->at)]];
    const hyk_light *light = &walk->accel->view->lights[index];
    if (!(skip_hidden && (light->flags & HYK_LIGHT_HIDDEN))) {
        float t = hyk_intersect_shape(*light, *walk->ray);
        if (t >= walk->ray->t_min && t <= walk->best.t && t >= 0.0f && hyi_beats(&walk->best, t, HYK_HIT_SHAPE, index)) {
            walk->best.t = t;
            walk->best.u = walk->best.v = 0.0f;
            walk->best.instance = HYK_HIT_SHAPE;
            walk->best.primitive = index;
            hyi_aim_limit(&walk->aim, t);
        }
    }
    hyi_walk_pop(walk);
}

/* Whether a shape beats limit, the best that is known; the answer is then in walk->best. */
HYI_FN bool hyi_shapes_walk(hyi_walk *walk, const hyi_accel *accel, const hyk_ray *ray, const hyi_best *limit, bool skip_hidden, bool any) {
    hyi_walk_begin_tree(walk, accel, accel->shapes, ray, limit->t);
    walk->best = *limit;
    while (walk->at != HYI_WALK_ENDED) {
        if (!hyi_child_is_leaf(walk->at)) hyi_shapes_visit_node(walk);
        else hyi_shapes_visit_leaf(walk, skip_hidden);
        if (any && walk->best.instance == HYK_HIT_SHAPE) hyi_walk_stop(walk);
    }
    return walk->best.instance == HYK_HIT_SHAPE;
}

/* Replaces hits[i] where a light shape is nearer: instance HYK_HIT_SHAPE, primitive the light, u = v = 0.
   skip_hidden: lights flagged HYK_LIGHT_HIDDEN are not seen. */
HYI_FN void hyi_trace_shapes_closest(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint32_t count, bool skip_hidden) {
    hyi_walk walk;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_best limit;
        limit.t = hits[i].instance == HYK_NONE ? hyi_finite_limit(rays[i].t_max) : hits[i].t;
        limit.u = hits[i].u;
        limit.v = hits[i].v;
        limit.instance = hits[i].instance;
        limit.primitive = hits[i].primitive;
        if (hyi_shapes_walk(&walk, accel, &rays[i], &limit, skip_hidden, false)) hyi_walk_answer(&walk, &hits[i]);
    }
}

/* Sets occluded[i] to 1 where a shape lies on the ray; rays already occluded are skipped. */
HYI_FN void hyi_trace_shapes_any(const hyi_accel *accel, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    hyi_walk walk;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_best limit;
        limit.t = hyi_finite_limit(rays[i].t_max);
        limit.u = limit.v = 0.0f;
        limit.instance = limit.primitive = HYK_NONE;
        if (!occluded[i] && hyi_shapes_walk(&walk, accel, &rays[i], &limit, false, true)) occluded[i] = 1;
    }
}

#endif /* HYI_BVH_TRACE_H */
