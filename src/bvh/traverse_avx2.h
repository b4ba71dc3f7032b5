/* >>bvh-avx2: eight boxes or eight triangles at a time */
#ifndef HYI_BVH_AVX2_H
#define HYI_BVH_AVX2_H

#include "walk.h"

#if HYI_X86

/* Keeps a value as rounded: see hyi_rounded. */
HYI_INLINE HYI_AVX2 __m256 hyi_rounded8(__m256 value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

typedef union hyi_eight {
    __m256 lanes;
    float t[HYI_WIDTH];
} hyi_eight;

/* A ray's side of the slab test, in every lane. */
typedef struct hyi_slabs8 {
    __m256 near_x, near_y, near_z, far_x, far_y, far_z, inverse_x, inverse_y, inverse_z, t_near;
    size_t row_x, row_y, row_z; /* bytes from the node to the planes met first; the others are at ^ 32 */
} hyi_slabs8;

HYI_INLINE HYI_AVX2 hyi_slabs8 hyi_load_slabs8(const hyi_aim *aim) {
    hyi_slabs8 s;
    s.near_x = _mm256_broadcast_ss(&aim->near_origin[0]);
    s.near_y = _mm256_broadcast_ss(&aim->near_origin[1]);
    s.near_z = _mm256_broadcast_ss(&aim->near_origin[2]);
    s.far_x = _mm256_broadcast_ss(&aim->far_origin[0]);
    s.far_y = _mm256_broadcast_ss(&aim->far_origin[1]);
    s.far_z = _mm256_broadcast_ss(&aim->far_origin[2]);
    s.inverse_x = _mm256_broadcast_ss(&aim->inverse[0]);
    s.inverse_y = _mm256_broadcast_ss(&aim->inverse[1]);
    s.inverse_z = _mm256_broadcast_ss(&aim->inverse[2]);
    s.t_near = _mm256_broadcast_ss(&aim->t_near);
    s.row_x = aim->near_plane[0] * sizeof(__m256);
    s.row_y = aim->near_plane[1] * sizeof(__m256);
    s.row_z = aim->near_plane[2] * sizeof(__m256);
    return s;
}

HYI_INLINE HYI_AVX2 __m256 hyi_slab8(const hyi_node *node, size_t row, __m256 origin, __m256 inverse) {
    __m256 planes = _mm256_load_ps((const float *)(const void *)((const char *)node + row));
    return _mm256_mul_ps(_mm256_sub_ps(planes, origin), inverse);
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_AVX2 uint32_t hyi_boxes_avx2(const hyi_slabs8 *s, const hyi_node *node, __m256 t_far, hyi_eight *t) {
    __m256 nx = hyi_slab8(node, s->row_x, s->near_x, s->inverse_x), fx = hyi_slab8(node, s->row_x ^ 32u, s->far_x, s->inverse_x);
    __m256 ny = hyi_slab8(node, s->row_y, s->near_y, s->inverse_y), fy = hyi_slab8(node, s->row_y ^ 32u, s->far_y, s->inverse_y);
    __m256 nz = hyi_slab8(node, s->row_z, s->near_z, s->inverse_z), fz = hyi_slab8(node, s->row_z ^ 32u, s->far_z, s->inverse_z);
    __m256 enter = _mm256_max_ps(_mm256_max_ps(nx, ny), _mm256_max_ps(nz, s->t_near));
    __m256 leave = _mm256_min_ps(_mm256_min_ps(fx, fy), _mm256_min_ps(fz, t_far));
    t->lanes = enter;
    return (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(enter, leave, _CMP_LE_OQ));
}

/* Corners in the sheared frame, eight at once. */
typedef struct hyi_corner8 {
    __m256 x, y, z;
} hyi_corner8;

HYI_INLINE HYI_AVX2 hyi_corner8 hyi_shear8(const hyi_aim *aim, const float *row, uint32_t stride) {
    hyi_corner8 p;
    p.z = hyi_rounded8(_mm256_sub_ps(_mm256_loadu_ps(row + aim->axis[2] * stride), _mm256_broadcast_ss(&aim->origin[2])));
    __m256 dx = hyi_rounded8(_mm256_sub_ps(_mm256_loadu_ps(row + aim->axis[0] * stride), _mm256_broadcast_ss(&aim->origin[0])));
    __m256 dy = hyi_rounded8(_mm256_sub_ps(_mm256_loadu_ps(row + aim->axis[1] * stride), _mm256_broadcast_ss(&aim->origin[1])));
    p.x = hyi_rounded8(_mm256_sub_ps(dx, hyi_rounded8(_mm256_mul_ps(_mm256_broadcast_ss(&aim->shear[0]), p.z))));
    p.y = hyi_rounded8(_mm256_sub_ps(dy, hyi_rounded8(_mm256_mul_ps(_mm256_broadcast_ss(&aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_AVX2 __m256 hyi_cross8(hyi_corner8 p, hyi_corner8 q) {
    return _mm256_sub_ps(hyi_rounded8(_mm256_mul_ps(p.x, q.y)), hyi_rounded8(_mm256_mul_ps(p.y, q.x)));
}

/* Lanes whose corners all lie beyond one of the limits: t of a hit is a mean of t at the corners. */
HYI_INLINE HYI_AVX2 __m256 hyi_beyond8(const hyi_aim *aim, __m256 az, __m256 bz, __m256 cz) {
    __m256 scale = _mm256_broadcast_ss(&aim->inverse_z);
    __m256 a = _mm256_mul_ps(az, scale), b = _mm256_mul_ps(bz, scale), c = _mm256_mul_ps(cz, scale);
    __m256 first = _mm256_min_ps(_mm256_min_ps(a, b), c), last = _mm256_max_ps(_mm256_max_ps(a, b), c);
    return _mm256_or_ps(_mm256_cmp_ps(first, _mm256_broadcast_ss(&aim->t_far), _CMP_GT_OQ),
                        _mm256_cmp_ps(last, _mm256_broadcast_ss(&aim->t_near), _CMP_LT_OQ));
}

/* Bits of the triangles that need a closer look. Lanes past count hold other triangles of the tree, or zeros. */
HYI_INLINE HYI_AVX2 uint32_t hyi_triangles_avx2(const hyi_aim *aim, const float *rows, uint32_t count) {
    hyi_corner8 p = hyi_shear8(aim, rows, count), q = hyi_shear8(aim, rows + 3u * count, count), r = hyi_shear8(aim, rows + 6u * count, count);
    __m256 a = hyi_cross8(r, q), b = hyi_cross8(p, r), c = hyi_cross8(q, p);
    __m256 zero = _mm256_setzero_ps();
    __m256 below = _mm256_cmp_ps(_mm256_min_ps(_mm256_min_ps(a, b), c), zero, _CMP_LT_OQ);
    __m256 above = _mm256_cmp_ps(_mm256_max_ps(_mm256_max_ps(a, b), c), zero, _CMP_GT_OQ);
    __m256 out = _mm256_or_ps(_mm256_and_ps(below, above), hyi_beyond8(aim, p.z, q.z, r.z));
    return ~(uint32_t)_mm256_movemask_ps(out) & ((1u << count) - 1u);
}

/* One node of a tree that is not the innermost: boxes of instances or of light shapes. */
HYI_NOINLINE HYI_AVX2 void hyi_visit_node_avx2(hyi_walk *walk) {
    const hyi_node *node = &walk->bvh->nodes[walk->at];
    hyi_eight near_t;
    hyi_slabs8 slabs = hyi_load_slabs8(&walk->aim);
    uint32_t mask = hyi_boxes_avx2(&slabs, node, _mm256_broadcast_ss(&walk->aim.t_far), &near_t);
    _mm256_zeroupper();
    if (mask) hyi_walk_descend(walk, node->child, near_t.t, mask);
    else hyi_walk_pop(walk);
}

/* The whole way through a tree of triangles, from the child that the walk stands at until nothing that
   was put on the stack since is left. The ray stays in registers. */
HYI_INLINE HYI_AVX2 void hyi_walk_mesh_avx2(hyi_walk *walk, uint32_t flags) {
    const hyi_node *nodes = walk->bvh->nodes;
    const hyi_slabs8 slabs = hyi_load_slabs8(&walk->aim);
    hyi_waiting *base = walk->stack + walk->waiting, *top = base;
    float t_far = walk->aim.t_far;
    uint32_t at = walk->at;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            hyi_eight near_t;
            uint32_t mask = hyi_boxes_avx2(&slabs, node, _mm256_set1_ps(t_far), &near_t);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, near_t.t, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            walk->at = at;
            uint32_t mask = hyi_triangles_avx2(&walk->aim, hyi_leaf_rows(walk), hyi_leaf_count(at));
            if (mask && hyi_walk_offer_all(walk, mask, flags)) {
                if (flags & HYI_WALK_ANY) {
                    hyi_walk_stop(walk);
                    return;
                }
                t_far = walk->aim.t_far;
            }
        }
        do {
            if (top == base) {
                hyi_walk_pop(walk);
                return;
            }
            top--;
        } while (top->t > t_far);
        at = top->child;
    }
}

HYI_INLINE HYI_AVX2 void hyi_run_avx2(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    hyi_walk walk;
    for (uint32_t i = 0; i < count; i++) {
        hyi_walk_begin(&walk, accel, &rays[i]);
        while (walk.at != HYI_WALK_ENDED) {
            if (!(flags & HYI_WALK_LEVELS) || !walk.upper) {
                hyi_walk_mesh_avx2(&walk, flags);
                _mm256_zeroupper(); /* what is called next is compiled for SSE, and would crawl */
            } else if (hyi_child_is_leaf(walk.at)) {
                hyi_walk_enter(&walk);
            } else {
                hyi_visit_node_avx2(&walk);
            }
        }
        if (flags & HYI_WALK_ANY) occluded[i] = walk.best.instance != HYK_NONE;
        else hyi_walk_answer(&walk, &hits[i]);
    }
}

HYI_FN HYI_AVX2 void hyi_trace_avx2(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count, uint32_t flags) {
    switch (flags) {
#define HYI_CASE(set) case set: hyi_run_avx2(accel, rays, hits, occluded, count, set); break;
        HYI_CASE(0u) HYI_CASE(1u) HYI_CASE(2u) HYI_CASE(3u)
        HYI_CASE(4u) HYI_CASE(5u) HYI_CASE(6u) HYI_CASE(7u)
#undef HYI_CASE
    }
}

#endif /* HYI_X86 */
#endif /* HYI_BVH_AVX2_H */
