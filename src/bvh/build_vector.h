/* >>bvh-build-vector: four floats at a time for the builder: boxes as two of them

   What the instruction set of every machine of its kind has: SSE2, NEON, or plain C. Lane 3 is along for
   the ride: nothing that is asked of a box looks at it. */
#ifndef HYI_BVH_BUILD_VECTOR_H
#define HYI_BVH_BUILD_VECTOR_H

#include "layout.h"

#if HYI_X86

typedef __m128 hyi_four;
HYI_INLINE hyi_four hyi_four_all(float x) { return _mm_set1_ps(x); }
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) { return _mm_setr_ps(x, y, z, 0.0f); }
HYI_INLINE hyi_four hyi_four_load(const float *p) { return _mm_loadu_ps(p); }
HYI_INLINE hyi_four hyi_four_load3(const float *p) {
    return _mm_movelh_ps(_mm_castsi128_ps(_mm_loadl_epi64((const __m128i *)(const void *)p)), _mm_load_ss(p + 2));
}
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { _mm_storeu_ps(p, a); }
HYI_INLINE hyi_four hyi_four_min(hyi_four a, hyi_four b) { return _mm_min_ps(a, b); }
HYI_INLINE hyi_four hyi_four_max(hyi_four a, hyi_four b) { return _mm_max_ps(a, b); }
HYI_INLINE hyi_four hyi_four_add(hyi_four a, hyi_four b) { return _mm_add_ps(a, b); }
HYI_INLINE hyi_four hyi_four_sub(hyi_four a, hyi_four b) { return _mm_sub_ps(a, b); }
HYI_INLINE hyi_four hyi_four_mul(hyi_four a, hyi_four b) { return _mm_mul_ps(a, b); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) { return _mm_shuffle_ps(a, a, _MM_SHUFFLE(3, 0, 2, 1)); }
HYI_INLINE float hyi_four_sum(hyi_four a) {
    return _mm_cvtss_f32(_mm_add_ss(_mm_add_ss(a, _mm_shuffle_ps(a, a, 1)), _mm_movehl_ps(a, a)));
}
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) { _mm_storeu_si128((__m128i *)(void *)to, _mm_cvttps_epi32(a)); }
/* What is behind the point. */
HYI_INLINE hyi_four hyi_four_rest(hyi_four a) { return _mm_sub_ps(a, _mm_cvtepi32_ps(_mm_cvttps_epi32(a))); }
/* Lanes of x where a < b, elsewhere of y. */
HYI_INLINE hyi_four hyi_four_pick_less(hyi_four a, hyi_four b, hyi_four x, hyi_four y) {
    __m128 less = _mm_cmplt_ps(a, b);
    return _mm_or_ps(_mm_and_ps(less, x), _mm_andnot_ps(less, y));
}
/* The last lane of before, then the first three of a. */
HYI_INLINE hyi_four hyi_four_shift(hyi_four before, hyi_four a) {
    __m128 seam = _mm_shuffle_ps(before, a, _MM_SHUFFLE(0, 0, 3, 3));
    return _mm_shuffle_ps(seam, a, _MM_SHUFFLE(2, 1, 2, 0));
}
/* Eight whole numbers from 0 to 127. */
HYI_INLINE void hyi_four_to_bytes(hyi_four a, hyi_four b, uint8_t *to) {
    __m128i words = _mm_packs_epi32(_mm_cvttps_epi32(a), _mm_cvttps_epi32(b));
    _mm_storel_epi64((__m128i *)(void *)to, _mm_packus_epi16(words, words));
}
HYI_INLINE void hyi_four_transpose(hyi_four a[4]) { _MM_TRANSPOSE4_PS(a[0], a[1], a[2], a[3]); }
/* Bits of the lanes where a > b. */
HYI_INLINE uint32_t hyi_four_greater(hyi_four a, hyi_four b) { return (uint32_t)_mm_movemask_ps(_mm_cmpgt_ps(a, b)); }

#elif HYI_NEON

typedef float32x4_t hyi_four;
HYI_INLINE hyi_four hyi_four_all(float x) { return vdupq_n_f32(x); }
HYI_INLINE hyi_four hyi_four_load(const float *p) { return vld1q_f32(p); }
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) {
    const float lanes[4] = {x, y, z, 0.0f};
    return vld1q_f32(lanes);
}
HYI_INLINE hyi_four hyi_four_load3(const float *p) { return vcombine_f32(vld1_f32(p), vset_lane_f32(p[2], vdup_n_f32(0.0f), 0)); }
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { vst1q_f32(p, a); }
HYI_INLINE hyi_four hyi_four_min(hyi_four a, hyi_four b) { return vminq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_max(hyi_four a, hyi_four b) { return vmaxq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_add(hyi_four a, hyi_four b) { return vaddq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_sub(hyi_four a, hyi_four b) { return vsubq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_mul(hyi_four a, hyi_four b) { return vmulq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) { return vsetq_lane_f32(vgetq_lane_f32(a, 0), vextq_f32(a, a, 1), 2); }
HYI_INLINE float hyi_four_sum(hyi_four a) { return vgetq_lane_f32(a, 0) + vgetq_lane_f32(a, 1) + vgetq_lane_f32(a, 2); }
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) { vst1q_s32(to, vcvtq_s32_f32(a)); }
HYI_INLINE hyi_four hyi_four_rest(hyi_four a) { return vsubq_f32(a, vcvtq_f32_s32(vcvtq_s32_f32(a))); }
HYI_INLINE hyi_four hyi_four_pick_less(hyi_four a, hyi_four b, hyi_four x, hyi_four y) { return vbslq_f32(vcltq_f32(a, b), x, y); }
HYI_INLINE hyi_four hyi_four_shift(hyi_four before, hyi_four a) { return vextq_f32(before, a, 3); }
HYI_INLINE void hyi_four_to_bytes(hyi_four a, hyi_four b, uint8_t *to) {
    vst1_u8(to, vqmovn_u16(vcombine_u16(vmovn_u32(vcvtq_u32_f32(a)), vmovn_u32(vcvtq_u32_f32(b)))));
}
HYI_INLINE void hyi_four_transpose(hyi_four a[4]) {
    float32x4x2_t low = vtrnq_f32(a[0], a[1]), high = vtrnq_f32(a[2], a[3]);
    a[0] = vcombine_f32(vget_low_f32(low.val[0]), vget_low_f32(high.val[0]));
    a[1] = vcombine_f32(vget_low_f32(low.val[1]), vget_low_f32(high.val[1]));
    a[2] = vcombine_f32(vget_high_f32(low.val[0]), vget_high_f32(high.val[0]));
    a[3] = vcombine_f32(vget_high_f32(low.val[1]), vget_high_f32(high.val[1]));
}
HYI_INLINE uint32_t hyi_four_greater(hyi_four a, hyi_four b) {
    const uint32_t bits[4] = {1u, 2u, 4u, 8u};
    uint32x4_t more = vandq_u32(vcgtq_f32(a, b), vld1q_u32(bits));
    return vgetq_lane_u32(more, 0) | vgetq_lane_u32(more, 1) | vgetq_lane_u32(more, 2) | vgetq_lane_u32(more, 3);
}

#else

typedef struct hyi_four {
    float f[4];
} hyi_four;
#define HYI_FOUR_OP(name, expression)                                     \
    HYI_INLINE hyi_four name(hyi_four a, hyi_four b) {                    \
        hyi_four r;                                                       \
        for (int i = 0; i < 4; i++) r.f[i] = (expression);                \
        return r;                                                         \
    }
HYI_FOUR_OP(hyi_four_min, a.f[i] < b.f[i] ? a.f[i] : b.f[i])
HYI_FOUR_OP(hyi_four_max, a.f[i] > b.f[i] ? a.f[i] : b.f[i])
HYI_FOUR_OP(hyi_four_add, a.f[i] + b.f[i])
HYI_FOUR_OP(hyi_four_sub, a.f[i] - b.f[i])
HYI_FOUR_OP(hyi_four_mul, a.f[i] * b.f[i])
#undef HYI_FOUR_OP
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) {
    hyi_four r;
    r.f[0] = x;
    r.f[1] = y;
    r.f[2] = z;
    r.f[3] = 0.0f;
    return r;
}
HYI_INLINE hyi_four hyi_four_load3(const float *p) { return hyi_four_make(p[0], p[1], p[2]); }
HYI_INLINE hyi_four hyi_four_all(float x) {
    hyi_four r = hyi_four_make(x, x, x);
    r.f[3] = x;
    return r;
}
HYI_INLINE hyi_four hyi_four_load(const float *p) {
    hyi_four r = hyi_four_make(p[0], p[1], p[2]);
    r.f[3] = p[3];
    return r;
}
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { memcpy(p, a.f, sizeof a.f); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) {
    hyi_four r = hyi_four_make(a.f[1], a.f[2], a.f[0]);
    r.f[3] = a.f[3];
    return r;
}
HYI_INLINE float hyi_four_sum(hyi_four a) { return a.f[0] + a.f[1] + a.f[2]; }
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) {
    for (int i = 0; i < 4; i++) to[i] = (int32_t)a.f[i];
}
HYI_INLINE hyi_four hyi_four_rest(hyi_four a) {
    for (int i = 0; i < 4; i++) a.f[i] -= (float)(int32_t)a.f[i];
    return a;
}
HYI_INLINE hyi_four hyi_four_pick_less(hyi_four a, hyi_four b, hyi_four x, hyi_four y) {
    for (int i = 0; i < 4; i++) x.f[i] = a.f[i] < b.f[i] ? x.f[i] : y.f[i];
    return x;
}
HYI_INLINE hyi_four hyi_four_shift(hyi_four before, hyi_four a) {
    hyi_four r = hyi_four_make(before.f[3], a.f[0], a.f[1]);
    r.f[3] = a.f[2];
    return r;
}
HYI_INLINE void hyi_four_to_bytes(hyi_four a, hyi_four b, uint8_t *to) {
    for (int i = 0; i < 8; i++) to[i] = (uint8_t)(i < 4 ? a.f[i] : b.f[i - 4]);
}
HYI_INLINE void hyi_four_transpose(hyi_four a[4]) {
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < i; j++) {
            float keep = a[i].f[j];
            a[i].f[j] = a[j].f[i];
            a[j].f[i] = keep;
        }
    }
}
HYI_INLINE uint32_t hyi_four_greater(hyi_four a, hyi_four b) {
    uint32_t bits = 0;
    for (uint32_t i = 0; i < 4u; i++) bits |= a.f[i] > b.f[i] ? 1u << i : 0u;
    return bits;
}

#endif

/* Whether a > b in x, y or z. */
HYI_INLINE bool hyi_four_exceeds(hyi_four a, hyi_four b) { return (hyi_four_greater(a, b) & 7u) != 0u; }

HYI_INLINE hyi_four hyi_four_abs(hyi_four a) { return hyi_four_max(a, hyi_four_sub(hyi_four_all(0.0f), a)); }

/* Keeps a value as rounded, so that it is the same wherever it is computed again: see hyi_rounded. */
HYI_INLINE hyi_four hyi_four_rounded(hyi_four a) {
#if HYI_GNU && HYI_X86
    __asm__("" : "+x"(a));
#elif HYI_GNU && HYI_NEON
    __asm__("" : "+w"(a));
#elif !HYI_X86 && !HYI_NEON
    for (int i = 0; i < 4; i++) a.f[i] = hyi_rounded(a.f[i]);
#endif
    return a;
}

/* x, y and z, each stride floats behind the other. */
HYI_INLINE void hyi_four_scatter(hyi_four a, float *to, uint32_t stride) {
#if HYI_X86
    _mm_store_ss(to, a);
    _mm_store_ss(to + stride, _mm_shuffle_ps(a, a, 1));
    _mm_store_ss(to + 2u * stride, _mm_movehl_ps(a, a));
#else
    float lanes[4];
    hyi_four_store(lanes, a);
    for (uint32_t i = 0; i < 3; i++) to[i * stride] = lanes[i];
#endif
}

/* ---- boxes */

typedef struct hyi_bounds {
    hyi_four lower, upper;
} hyi_bounds;

HYI_INLINE hyi_bounds hyi_bounds_empty(void) {
    hyi_bounds b;
    b.lower = hyi_four_all(HYI_EMPTY_PLANE);
    b.upper = hyi_four_all(-HYI_EMPTY_PLANE);
    return b;
}

HYI_INLINE void hyi_bounds_add(hyi_bounds *b, hyi_four lower, hyi_four upper) {
    b->lower = hyi_four_min(b->lower, lower);
    b->upper = hyi_four_max(b->upper, upper);
}

HYI_INLINE void hyi_bounds_meet(hyi_bounds *b, const hyi_bounds *with) {
    b->lower = hyi_four_max(b->lower, with->lower);
    b->upper = hyi_four_min(b->upper, with->upper);
}

HYI_INLINE bool hyi_bounds_are_empty(const hyi_bounds *b) { return hyi_four_exceeds(b->lower, b->upper); }

/* Half of the surface; of an empty box 0. Coordinates are scaled: what gets lost in float is too small to matter. */
HYI_INLINE float hyi_bounds_area(const hyi_bounds *b) {
    hyi_four size = hyi_four_max(hyi_four_sub(b->upper, b->lower), hyi_four_all(0.0f));
    return hyi_four_sum(hyi_four_mul(size, hyi_four_turn(size)));
}

HYI_INLINE float hyi_bounds_area_with(const hyi_bounds *b, hyi_four lower, hyi_four upper) {
    hyi_bounds grown = *b;
    hyi_bounds_add(&grown, lower, upper);
    return hyi_bounds_area(&grown);
}

HYI_INLINE void hyi_bounds_store(const hyi_bounds *b, float *lower, float *upper) {
    float lanes[4];
    hyi_four_store(lanes, b->lower);
    memcpy(lower, lanes, 3 * sizeof *lower);
    hyi_four_store(lanes, b->upper);
    memcpy(upper, lanes, 3 * sizeof *upper);
}

HYI_INLINE hyi_bounds hyi_bounds_load(const float *lower, const float *upper) {
    hyi_bounds b;
    b.lower = hyi_four_load3(lower);
    b.upper = hyi_four_load3(upper);
    return b;
}

/* Boxes of four children from c on become planes. */
HYI_INLINE void hyi_node_set_planes(hyi_node *node, uint32_t c, hyi_four lower[4], hyi_four upper[4]) {
    hyi_four_transpose(lower);
    hyi_four_transpose(upper);
    for (uint32_t a = 0; a < 3; a++) {
        hyi_four_store(&node->planes[2u * a][c], lower[a]);
        hyi_four_store(&node->planes[2u * a + 1u][c], upper[a]);
    }
}

#endif /* HYI_BVH_BUILD_VECTOR_H */
