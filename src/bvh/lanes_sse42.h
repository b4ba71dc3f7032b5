/* >>bvh-sse42: traversal in the words of SSE4.2: eight lanes are two times four */
#ifndef HYI_BVH_SSE42_H
#define HYI_BVH_SSE42_H

#include "stream.h"

#if HYI_X86

#include "lanes_begin.inc.h"

HYI_INLINE HYI_SSE42 __m128 hyi_pin4_sse42(__m128 value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_SSE42 __m128d hyi_pin2_sse42(__m128d value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_SSE42 float hyi_greatest4_sse42(__m128 a) {
    __m128 two = _mm_max_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps(two, two, 1)));
}

HYI_INLINE HYI_SSE42 float hyi_least4_sse42(__m128 a) {
    __m128 two = _mm_min_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_min_ss(two, _mm_shuffle_ps(two, two, 1)));
}

#define HYI_TARGET HYI_SSE42
#define HYI_I(name) name##_sse42
#define HYI_PUSH_SEVERAL(stack, node, enter, mask, ahead) hyi_push_farther(stack, (node)->child, enter, mask, ahead)
#include "lanes_four.inc.h"
#define HYI_M4 __m128
#define HYI_LOAD4_ALIGNED(p) _mm_load_ps(p)
#define HYI_MAD4(a, b, c) _mm_add_ps(_mm_mul_ps(a, b), c)
#define HYI_MIN4(a, b) _mm_min_ps(a, b)
#define HYI_MAX4_AS_INTS(a, b) _mm_castsi128_ps(_mm_max_epi32(_mm_castps_si128(a), _mm_castps_si128(b)))
#define HYI_MIN4_AS_INTS(a, b) _mm_castsi128_ps(_mm_min_epi32(_mm_castps_si128(a), _mm_castps_si128(b)))
#define HYI_LT4(a, b) _mm_cmplt_ps(a, b)
#define HYI_AND4(a, b) _mm_and_ps(a, b)
#define HYI_OR4(a, b) _mm_or_ps(a, b)
#define HYI_CHOOSE4(m, a, b) _mm_blendv_ps(b, a, m)
#define HYI_SAME4(a, b) _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_castps_si128(a), _mm_castps_si128(b)))
#define HYI_BITS4_4(low, high) ((uint32_t)_mm_movemask_ps(low) | (uint32_t)_mm_movemask_ps(high) << 4)
#define HYI_TURN4(a) _MM_TRANSPOSE4_PS((a)[0], (a)[1], (a)[2], (a)[3])
#define HYI_PIN4(a) hyi_pin4_sse42(a)
#define HYI_GREATEST4(a) hyi_greatest4_sse42(a)
#define HYI_LEAST4(a) hyi_least4_sse42(a)
#define HYI_D2 __m128d
#define HYI_SET2(value) _mm_set1_pd(value)
#define HYI_LOAD2(p) _mm_loadu_pd(p)
#define HYI_STORE2(p, a) _mm_storeu_pd(p, a)
#define HYI_LOW_AS_DOUBLES(a) _mm_cvtps_pd(a)
#define HYI_HIGH_AS_DOUBLES(a) _mm_cvtps_pd(_mm_movehl_ps(a, a))
#define HYI_AS_FLOATS(low, high) _mm_movelh_ps(_mm_cvtpd_ps(low), _mm_cvtpd_ps(high))
#define HYI_ADD2(a, b) _mm_add_pd(a, b)
#define HYI_SUB2(a, b) _mm_sub_pd(a, b)
#define HYI_MUL2(a, b) _mm_mul_pd(a, b)
#define HYI_DIV2(a, b) _mm_div_pd(a, b)
#define HYI_MIN2(a, b) _mm_min_pd(a, b)
#define HYI_MAX2(a, b) _mm_max_pd(a, b)
#define HYI_LT2(a, b) _mm_cmplt_pd(a, b)
#define HYI_BITS2_2(low, high) ((uint32_t)_mm_movemask_pd(low) | (uint32_t)_mm_movemask_pd(high) << 2)
#define HYI_PIN2(a) hyi_pin2_sse42(a)
#define HYI_RECORDS(rows, words, out) HYI_I(hyi_records_four)(rows, words, out)
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

#endif /* HYI_X86 */
#endif /* HYI_BVH_SSE42_H */
