/* >>bvh-neon: traversal in the words of NEON: eight lanes are two times four */
#ifndef HYI_BVH_NEON_H
#define HYI_BVH_NEON_H

#include "stream.h"

#if HYI_NEON

#include "lanes_begin.inc.h"

HYI_INLINE float32x4_t hyi_pin4_neon(float32x4_t value) {
#if HYI_GNU
    __asm__("" : "+w"(value));
#endif
    return value;
}

HYI_INLINE float64x2_t hyi_pin2_neon(float64x2_t value) {
#if HYI_GNU
    __asm__("" : "+w"(value));
#endif
    return value;
}

/* One bit a lane. */
HYI_INLINE uint32_t hyi_bits4_4_neon(uint32x4_t low, uint32x4_t high) {
    static const uint16_t bits[8] = {1, 2, 4, 8, 16, 32, 64, 128};
    return vaddvq_u16(vandq_u16(vcombine_u16(vmovn_u32(low), vmovn_u32(high)), vld1q_u16(bits)));
}

HYI_INLINE uint32_t hyi_bits2_2_neon(uint64x2_t low, uint64x2_t high) {
    static const uint32_t bits[4] = {1, 2, 4, 8};
    return vaddvq_u32(vandq_u32(vcombine_u32(vmovn_u64(low), vmovn_u64(high)), vld1q_u32(bits)));
}

/* Of two zeros the second, as elsewhere: vminq and vmaxq tell them apart. */
HYI_INLINE float64x2_t hyi_min2_neon(float64x2_t a, float64x2_t b) { return vbslq_f64(vcltq_f64(a, b), a, b); }
HYI_INLINE float64x2_t hyi_max2_neon(float64x2_t a, float64x2_t b) { return vbslq_f64(vcgtq_f64(a, b), a, b); }

/* Four by four: rows become columns. */
HYI_INLINE void hyi_turn4_neon(float32x4_t a[4]) {
    float32x4x2_t low = vtrnq_f32(a[0], a[1]), high = vtrnq_f32(a[2], a[3]);
    for (int k = 0; k < 2; k++) {
        a[k] = vcombine_f32(vget_low_f32(low.val[k]), vget_low_f32(high.val[k]));
        a[k + 2] = vcombine_f32(vget_high_f32(low.val[k]), vget_high_f32(high.val[k]));
    }
}

/* hyi_aim.near_plane by the bits of a direction; HYI_WIDTH is 8. */
HYI_INLINE void hyi_store_places4_neon(uint32_t *at, uint32x4_t bits) {
    static const uint32_t rows[4] = {0, 2u * HYI_WIDTH, 4u * HYI_WIDTH, 0};
    vst1q_u32(at, vorrq_u32(vandq_u32(vshrq_n_u32(bits, 28), vdupq_n_u32(HYI_WIDTH)), vld1q_u32(rows)));
}

#define HYI_TARGET
#define HYI_I(name) name##_neon
#define HYI_PUSH_SEVERAL(stack, node, enter, mask, ahead) hyi_push_farther(stack, (node)->child, enter, mask, ahead)
#define HYI_F4 float32x4_t
#define HYI_M4 uint32x4_t
#define HYI_LOAD4(p) vld1q_f32(p)
#define HYI_LOAD4_ALIGNED(p) vld1q_f32(p)
#define HYI_STORE4(p, a) vst1q_f32(p, a)
#define HYI_SET4(value) vdupq_n_f32(value)
#define HYI_ADD4(a, b) vaddq_f32(a, b)
#define HYI_SUB4(a, b) vsubq_f32(a, b)
#define HYI_MUL4(a, b) vmulq_f32(a, b)
#define HYI_DIV4(a, b) vdivq_f32(a, b)
#define HYI_MAD4(a, b, c) vfmaq_f32(c, a, b)
#define HYI_MIN4(a, b) vminq_f32(a, b)
#define HYI_MAX4(a, b) vmaxq_f32(a, b)
#define HYI_SIZE4(a) vabsq_f32(a)
#define HYI_MAX4_AS_INTS(a, b) HYI_MAX4(a, b) /* as soon done */
#define HYI_MIN4_AS_INTS(a, b) HYI_MIN4(a, b)
#define HYI_LT4(a, b) vcltq_f32(a, b)
#define HYI_LE4(a, b) vcleq_f32(a, b)
#define HYI_AND4(a, b) vandq_u32(a, b)
#define HYI_OR4(a, b) vorrq_u32(a, b)
#define HYI_CHOOSE4(m, a, b) vbslq_f32(m, a, b)
#define HYI_SAME4(a, b) vceqq_u32(vreinterpretq_u32_f32(a), vreinterpretq_u32_f32(b))
#define HYI_BITS4_4(low, high) hyi_bits4_4_neon(low, high)
#define HYI_TURN4(a) hyi_turn4_neon(a)
#define HYI_PIN4(a) hyi_pin4_neon(a)
#define HYI_GREATEST4(a) vmaxvq_f32(a)
#define HYI_LEAST4(a) vminvq_f32(a)
#define HYI_D2 float64x2_t
#define HYI_SET2(value) vdupq_n_f64(value)
#define HYI_LOAD2(p) vld1q_f64(p)
#define HYI_STORE2(p, a) vst1q_f64(p, a)
#define HYI_LOW_AS_DOUBLES(a) vcvt_f64_f32(vget_low_f32(a))
#define HYI_HIGH_AS_DOUBLES(a) vcvt_high_f64_f32(a)
#define HYI_AS_FLOATS(low, high) vcvt_high_f32_f64(vcvt_f32_f64(low), high)
#define HYI_ADD2(a, b) vaddq_f64(a, b)
#define HYI_SUB2(a, b) vsubq_f64(a, b)
#define HYI_MUL2(a, b) vmulq_f64(a, b)
#define HYI_DIV2(a, b) vdivq_f64(a, b)
#define HYI_MIN2(a, b) hyi_min2_neon(a, b)
#define HYI_MAX2(a, b) hyi_max2_neon(a, b)
#define HYI_LT2(a, b) vcltq_f64(a, b)
#define HYI_BITS2_2(low, high) hyi_bits2_2_neon(low, high)
#define HYI_PIN2(a) hyi_pin2_neon(a)
#define HYI_RECORDS(rows, words, out) hyi_records(rows, words, out, 8u)
#define HYI_SIGNED4(size, of) vbslq_f32(vdupq_n_u32(0x80000000u), of, size)
#define HYI_EXCEED4(a, most) vmaxvq_u32(vcgtq_u32(vreinterpretq_u32_f32(vabsq_f32(a)), vld1q_u32(most)))
#define HYI_BYTES4(a, bytes) vreinterpretq_f32_u8(vqtbl1q_u8(vreinterpretq_u8_f32(a), vld1q_u8(bytes)))
#define HYI_STORE_PLACES4(p, a) hyi_store_places4_neon(p, vreinterpretq_u32_f32(a))
#include "lanes_pair.inc.h"
#include "aim_body.inc.h"
#include "walk_body.inc.h"
#include "packet_body.inc.h"
#include "begin_body.inc.h"
#include "lanes_turn.inc.h"
#include "unpack_body.inc.h"
#include "leaf_body.inc.h"
#include "stream_body.inc.h"
#include "lanes_end.inc.h"

#endif /* HYI_NEON */
#endif /* HYI_BVH_NEON_H */
