/* >>bvh-neon: eight boxes or triangles as two times four lanes; close to bvh-avx2 on purpose */
#ifndef HYI_BVH_NEON_H
#define HYI_BVH_NEON_H

#include "walk.h"

#if HYI_NEON

/* Keeps a value as rounded: see hyi_rounded. */
HYI_INLINE float32x4_t hyi_rounded4(float32x4_t value) {
#if HYI_GNU
    __asm__("" : "+w"(value));
#endif
    return value;
}

/* One bit a lane. */
HYI_INLINE uint32_t hyi_mask4(uint32x4_t lanes) {
    static const uint32_t bits[4] = {1u, 2u, 4u, 8u};
    return vaddvq_u32(vandq_u32(lanes, vld1q_u32(bits)));
}

HYI_INLINE float32x4_t hyi_slab4(const float *planes, float origin, float inverse) {
    return vmulq_n_f32(vsubq_f32(vld1q_f32(planes), vdupq_n_f32(origin)), inverse);
}

HYI_INLINE uint32_t hyi_boxes4(const hyi_aim *aim, const hyi_node *node, uint32_t lane, float *t) {
    const uint32_t *row = aim->near_plane;
    float32x4_t nx = hyi_slab4(&node->planes[row[0]][lane], aim->near_origin[0], aim->inverse[0]);
    float32x4_t ny = hyi_slab4(&node->planes[row[1]][lane], aim->near_origin[1], aim->inverse[1]);
    float32x4_t nz = hyi_slab4(&node->planes[row[2]][lane], aim->near_origin[2], aim->inverse[2]);
    float32x4_t fx = hyi_slab4(&node->planes[row[0] ^ 1u][lane], aim->far_origin[0], aim->inverse[0]);
    float32x4_t fy = hyi_slab4(&node->planes[row[1] ^ 1u][lane], aim->far_origin[1], aim->inverse[1]);
    float32x4_t fz = hyi_slab4(&node->planes[row[2] ^ 1u][lane], aim->far_origin[2], aim->inverse[2]);
    float32x4_t enter = vmaxq_f32(vmaxq_f32(nx, ny), vmaxq_f32(nz, vdupq_n_f32(aim->t_near)));
    float32x4_t leave = vminq_f32(vminq_f32(fx, fy), vminq_f32(fz, vdupq_n_f32(aim->t_far)));
    vst1q_f32(t + lane, enter);
    return hyi_mask4(vcleq_f32(enter, leave)) << lane;
}

HYI_INLINE uint32_t hyi_boxes_neon(const hyi_aim *aim, const hyi_node *node, float *t) {
    return hyi_boxes4(aim, node, 0u, t) | hyi_boxes4(aim, node, 4u, t);
}

/* Corners in the sheared frame, four at once. */
typedef struct hyi_corner4 {
    float32x4_t x, y, z;
} hyi_corner4;

HYI_INLINE hyi_corner4 hyi_shear4(const hyi_aim *aim, const float *row, uint32_t stride) {
    hyi_corner4 p;
    p.z = hyi_rounded4(vsubq_f32(vld1q_f32(row + aim->axis[2] * stride), vdupq_n_f32(aim->origin[2])));
    float32x4_t dx = hyi_rounded4(vsubq_f32(vld1q_f32(row + aim->axis[0] * stride), vdupq_n_f32(aim->origin[0])));
    float32x4_t dy = hyi_rounded4(vsubq_f32(vld1q_f32(row + aim->axis[1] * stride), vdupq_n_f32(aim->origin[1])));
    p.x = hyi_rounded4(vsubq_f32(dx, hyi_rounded4(vmulq_n_f32(p.z, aim->shear[0]))));
    p.y = hyi_rounded4(vsubq_f32(dy, hyi_rounded4(vmulq_n_f32(p.z, aim->shear[1]))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE float32x4_t hyi_cross4(hyi_corner4 p, hyi_corner4 q) {
    return vsubq_f32(hyi_rounded4(vmulq_f32(p.x, q.y)), hyi_rounded4(vmulq_f32(p.y, q.x)));
}

/* Lanes whose corners all lie beyond one of the limits: t of a hit is a mean of t at the corners. */
HYI_INLINE uint32x4_t hyi_beyond4(const hyi_aim *aim, float32x4_t az, float32x4_t bz, float32x4_t cz) {
    float32x4_t a = vmulq_n_f32(az, aim->inverse_z), b = vmulq_n_f32(bz, aim->inverse_z), c = vmulq_n_f32(cz, aim->inverse_z);
    float32x4_t first = vminq_f32(vminq_f32(a, b), c), last = vmaxq_f32(vmaxq_f32(a, b), c);
    return vorrq_u32(vcgtq_f32(first, vdupq_n_f32(aim->t_far)), vcltq_f32(last, vdupq_n_f32(aim->t_near)));
}

/* Four triangles from lane on: the rows are read lane floats further on. */
HYI_INLINE uint32_t hyi_triangles4(const hyi_aim *aim, const float *rows, uint32_t count, uint32_t lane) {
    rows += lane;
    hyi_corner4 p = hyi_shear4(aim, rows, count), q = hyi_shear4(aim, rows + 3u * count, count), r = hyi_shear4(aim, rows + 6u * count, count);
    float32x4_t a = hyi_cross4(r, q), b = hyi_cross4(p, r), c = hyi_cross4(q, p);
    uint32x4_t below = vcltzq_f32(vminq_f32(vminq_f32(a, b), c));
    uint32x4_t above = vcgtzq_f32(vmaxq_f32(vmaxq_f32(a, b), c));
    uint32x4_t out = vorrq_u32(vandq_u32(below, above), hyi_beyond4(aim, p.z, q.z, r.z));
    return (~hyi_mask4(out) & 15u) << lane;
}

HYI_INLINE uint32_t hyi_triangles_neon(const hyi_aim *aim, const float *rows, uint32_t count) {
    uint32_t mask = hyi_triangles4(aim, rows, count, 0u);
    if (count > 4u) mask |= hyi_triangles4(aim, rows, count, 4u);
    return mask & ((1u << count) - 1u);
}

HYI_INLINE void hyi_step_node_neon(hyi_walk *walk) {
    const hyi_node *node = &walk->bvh->nodes[walk->at];
    float t[HYI_WIDTH];
    uint32_t mask = hyi_boxes_neon(&walk->aim, node, t);
    if (mask) hyi_walk_descend(walk, node->child, t, mask);
    else hyi_walk_pop(walk);
}

HYI_NOINLINE void hyi_visit_node_neon(hyi_walk *walk) { hyi_step_node_neon(walk); }

/* Visits the node or leaf that the walk stands at, and chooses the next. */
HYI_INLINE void hyi_visit_neon(hyi_walk *walk, uint32_t flags) {
    if (!hyi_child_is_leaf(walk->at)) {
        hyi_step_node_neon(walk);
    } else if ((flags & HYI_WALK_LEVELS) && walk->upper) {
        hyi_walk_enter(walk);
    } else {
        hyi_walk_leaf(walk, hyi_triangles_neon(&walk->aim, hyi_leaf_rows(walk), hyi_leaf_count(walk->at)), flags);
    }
}

HYI_INLINE void hyi_run_neon(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    hyi_walk walk;
    for (uint32_t i = 0; i < count; i++) {
        hyi_walk_begin(&walk, accel, &rays[i]);
        while (walk.at != HYI_WALK_ENDED) hyi_visit_neon(&walk, flags);
        if (flags & HYI_WALK_ANY) occluded[i] = walk.best.instance != HYK_NONE;
        else hyi_walk_answer(&walk, &hits[i]);
    }
}

HYI_FN void hyi_trace_neon(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    switch (flags) {
#define HYI_CASE(set) case set: hyi_run_neon(accel, rays, hits, occluded, count, set); break;
        HYI_CASE(0u) HYI_CASE(1u) HYI_CASE(2u) HYI_CASE(3u)
        HYI_CASE(4u) HYI_CASE(5u) HYI_CASE(6u) HYI_CASE(7u)
#undef HYI_CASE
    }
}

#endif /* HYI_NEON */
#endif /* HYI_BVH_NEON_H */
