/* >>bvh-scalar: boxes and triangles one at a time, on any machine */
#ifndef HYI_BVH_SCALAR_H
#define HYI_BVH_SCALAR_H

#include "walk.h"

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE uint32_t hyi_boxes_scalar(const hyi_aim *aim, const hyi_node *node, float *t) {
    uint32_t mask = 0;
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        float near_t = aim->t_near, far_t = aim->t_far;
        for (int a = 0; a < 3; a++) {
            float enter = (node->planes[aim->near_plane[a]][c] - aim->near_origin[a]) * aim->inverse[a];
            float leave = (node->planes[aim->near_plane[a] ^ 1u][c] - aim->far_origin[a]) * aim->inverse[a];
            near_t = enter > near_t ? enter : near_t;
            far_t = leave < far_t ? leave : far_t;
        }
        t[c] = near_t;
        mask |= (near_t <= far_t ? 1u : 0u) << c;
    }
    return mask;
}

/* One edge function, as the vector units compute it. */
HYI_INLINE float hyi_cross_float(float p, float q, float r, float s) { return hyi_rounded(p * q) - hyi_rounded(r * s); }

/* Bits of the triangles whose edge functions do not differ in sign. */
HYI_INLINE uint32_t hyi_triangles_scalar(const hyi_aim *aim, const float *rows, uint32_t count) {
    uint32_t mask = 0;
    for (uint32_t i = 0; i < count; i++) {
        float ax, ay, bx, by, cx, cy;
        hyi_shear_corner(aim, rows + i, count, &ax, &ay);
        hyi_shear_corner(aim, rows + 3u * count + i, count, &bx, &by);
        hyi_shear_corner(aim, rows + 6u * count + i, count, &cx, &cy);
        float a = hyi_cross_float(cx, by, cy, bx), b = hyi_cross_float(ax, cy, ay, cx), c = hyi_cross_float(bx, ay, by, ax);
        bool below = a < 0.0f || b < 0.0f || c < 0.0f, above = a > 0.0f || b > 0.0f || c > 0.0f;
        mask |= (below && above ? 0u : 1u) << i;
    }
    return mask;
}

HYI_INLINE void hyi_step_node_scalar(hyi_walk *walk) {
    const hyi_node *node = &walk->bvh->nodes[walk->at];
    float t[HYI_WIDTH];
    uint32_t mask = hyi_boxes_scalar(&walk->aim, node, t);
    if (mask) hyi_walk_descend(walk, node->child, t, mask);
    else hyi_walk_pop(walk);
}

HYI_NOINLINE void hyi_visit_node_scalar(hyi_walk *walk) { hyi_step_node_scalar(walk); }

/* Visits the node or leaf that the walk stands at, and chooses the next. */
HYI_INLINE void hyi_visit_scalar(hyi_walk *walk, uint32_t flags) {
    if (!hyi_child_is_leaf(walk->at)) {
        hyi_step_node_scalar(walk);
    } else if ((flags & HYI_WALK_LEVELS) && walk->upper) {
        hyi_walk_enter(walk);
    } else {
        hyi_walk_leaf(walk, hyi_triangles_scalar(&walk->aim, hyi_leaf_rows(walk), hyi_leaf_count(walk->at)), flags);
    }
}

HYI_INLINE void hyi_run_scalar(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    hyi_walk walk;
    for (uint32_t i = 0; i < count; i++) {
        hyi_walk_begin(&walk, accel, &rays[i]);
        while (walk.at != HYI_WALK_ENDED) hyi_visit_scalar(&walk, flags);
        if (flags & HYI_WALK_ANY) occluded[i] = walk.best.instance != HYK_NONE;
        else hyi_walk_answer(&walk, &hits[i]);
    }
}

HYI_FN void hyi_trace_scalar(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    switch (flags) {
#define HYI_CASE(set) case set: hyi_run_scalar(accel, rays, hits, occluded, count, set); break;
        HYI_CASE(0u) HYI_CASE(1u) HYI_CASE(2u) HYI_CASE(3u)
        HYI_CASE(4u) HYI_CASE(5u) HYI_CASE(6u) HYI_CASE(7u)
#undef HYI_CASE
    }
}

#endif /* HYI_BVH_SCALAR_H */
