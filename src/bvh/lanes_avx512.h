/* >>bvh-avx512: traversal in the words of AVX-512: sixteen rays a packet, lists dealt by compression */
#ifndef HYI_BVH_AVX512_H
#define HYI_BVH_AVX512_H

#include "stream.h"

#if HYI_X86

/* The compiler's own intrinsics begin with undefined values, which it then warns of (GCC bug 105593). */
#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#endif

HYI_INLINE HYI_AVX512 __m512d hyi_pin_double_avx512(__m512d value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX512 __m256 hyi_pin8_avx512(__m256 value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX512 __m512 hyi_pin16_avx512(__m512 value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

/* Masks as bits. By an instruction of their own: where gcc 12 widens a mask itself and then runs out of registers, it stores
   two bytes of it and loads four (seen with -fsanitize=thread: rays were put on lists that did not exist). */
HYI_INLINE HYI_AVX512 uint32_t hyi_bits16_avx512(__mmask16 mask) {
#if HYI_GNU
    uint32_t bits;
    __asm__("kmovw %1, %0" : "=r"(bits) : "k"(mask));
    return bits;
#else
    return (uint32_t)mask;
#endif
}

HYI_INLINE HYI_AVX512 uint32_t hyi_bits8_avx512(__mmask8 mask) {
#if HYI_GNU
    uint32_t bits;
    __asm__("kmovb %1, %0" : "=r"(bits) : "k"(mask));
    return bits;
#else
    return (uint32_t)mask;
#endif
}

typedef union hyi_masks16 {
    uint8_t bytes[16];
    __m128i lanes;
} hyi_masks16;

/* Appends sixteen items to the lists of the children that their masks name. */
HYI_INLINE HYI_AVX512 void hyi_deal_out_avx512(const uint32_t *items, const hyi_masks16 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    __m512i all = _mm512_loadu_si512(items);
    __m128i bits = masks->lanes;
    for (int c = 7; c >= 0; c--) { /* the highest bit of each byte is the child's */
        __mmask16 takes = _mm_movepi8_mask(bits);
        bits = _mm_add_epi8(bits, bits);
        _mm512_storeu_si512(lists + (size_t)(uint32_t)c * stride + dealt[c], _mm512_maskz_compress_epi32(takes, all));
        dealt[c] += (uint32_t)_mm_popcnt_u32(hyi_bits16_avx512(takes));
    }
}

/* hyi_ray_words: two rays to a register, in such pairs that the last of three steps brings them into their order. */
HYI_INLINE HYI_AVX512 void hyi_ray_words_avx512(const hyk_ray *rays, float words[8][HYI_PACKET_WIDTH]) {
    __m512d halves[2][4];
    for (uint32_t side = 0; side < 2u; side++) {
        __m512 a[4];
        for (uint32_t k = 0; k < 4u; k++) {
            const float *low = (const float *)(const void *)&rays[8u * side + k], *high = (const float *)(const void *)&rays[8u * side + 4u + k];
            a[k] = _mm512_insertf32x8(_mm512_castps256_ps512(_mm256_loadu_ps(low)), _mm256_loadu_ps(high), 1);
        }
        __m512d low01 = _mm512_castps_pd(_mm512_unpacklo_ps(a[0], a[1])), high01 = _mm512_castps_pd(_mm512_unpackhi_ps(a[0], a[1]));
        __m512d low23 = _mm512_castps_pd(_mm512_unpacklo_ps(a[2], a[3])), high23 = _mm512_castps_pd(_mm512_unpackhi_ps(a[2], a[3]));
        halves[side][0] = _mm512_unpacklo_pd(low01, low23);
        halves[side][1] = _mm512_unpackhi_pd(low01, low23);
        halves[side][2] = _mm512_unpacklo_pd(high01, high23);
        halves[side][3] = _mm512_unpackhi_pd(high01, high23);
    }
    for (uint32_t k = 0; k < 4u; k++) {
        _mm512_storeu_ps(words[k], _mm512_castpd_ps(_mm512_shuffle_f64x2(halves[0][k], halves[1][k], 0x88)));
        _mm512_storeu_ps(words[4u + k], _mm512_castpd_ps(_mm512_shuffle_f64x2(halves[0][k], halves[1][k], 0xdd)));
    }
}

/* hyi_lines: a transposition in four steps. */
HYI_INLINE HYI_AVX512 void hyi_lines_avx512(const void *const rows[16], char *lines) {
    __m512 a[16], b[16];
    for (int i = 0; i < 16; i++) a[i] = _mm512_loadu_ps(rows[i]);
    for (int i = 0; i < 16; i += 2) {
        b[i] = _mm512_unpacklo_ps(a[i], a[i + 1]);
        b[i + 1] = _mm512_unpackhi_ps(a[i], a[i + 1]);
    }
    for (int i = 0; i < 16; i += 4) {
        for (int k = 0; k < 2; k++) {
            __m512d low = _mm512_castps_pd(b[i + k]), high = _mm512_castps_pd(b[i + k + 2]);
            a[i + 2 * k] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, high));
            a[i + 2 * k + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, high));
        }
    }
    for (int i = 0; i < 16; i += 8) {
        for (int k = 0; k < 4; k++) {
            b[i + k] = _mm512_shuffle_f32x4(a[i + k], a[i + k + 4], 0x88);
            b[i + k + 4] = _mm512_shuffle_f32x4(a[i + k], a[i + k + 4], 0xdd);
        }
    }
    for (int k = 0; k < 8; k++) {
        char *low = lines + (size_t)(uint32_t)k * sizeof(hyi_flight);
        _mm512_store_ps((float *)(void *)low, _mm512_shuffle_f32x4(b[k], b[k + 8], 0x88));
        _mm512_store_ps((float *)(void *)(low + 8u * sizeof(hyi_flight)), _mm512_shuffle_f32x4(b[k], b[k + 8], 0xdd));
    }
}

#define HYI_TARGET HYI_AVX512
#define HYI_RAY_WORDS(rays, words) hyi_ray_words_avx512(rays, words)
#define HYI_LINES(rows, lines) hyi_lines_avx512(rows, lines)
#define HYI_I(name) name##_avx512
#define HYI_F8 __m256
#define HYI_ALWAYS_EXACT 0
#define HYI_M8 __mmask8
#define HYI_LOAD8(p) _mm256_load_ps(p)
#define HYI_LOADU8(p) _mm256_loadu_ps(p)
#define HYI_STORE8(p, a) _mm256_storeu_ps(p, a)
#define HYI_SET8(value) _mm256_set1_ps(value)
#define HYI_ZERO8() _mm256_setzero_ps()
#define HYI_ADD8(a, b) _mm256_add_ps(a, b)
#define HYI_SUB8(a, b) _mm256_sub_ps(a, b)
#define HYI_MUL8(a, b) _mm256_mul_ps(a, b)
#define HYI_DIV8(a, b) _mm256_div_ps(a, b)
#define HYI_MAD8(a, b, c) _mm256_fmadd_ps(a, b, c)
#define HYI_MIN8(a, b) _mm256_min_ps(a, b)
#define HYI_MAX8(a, b) _mm256_max_ps(a, b)
#define HYI_SIZE8(a) _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a)
#define HYI_MAX8_AS_INTS(a, b) _mm256_castsi256_ps(_mm256_max_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b)))
#define HYI_MIN8_AS_INTS(a, b) _mm256_castsi256_ps(_mm256_min_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b)))
#define HYI_LT8(a, b) _mm256_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define HYI_LE8(a, b) _mm256_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define HYI_AND8(a, b) ((__mmask8)((a) & (b)))
#define HYI_OR8(a, b) ((__mmask8)((a) | (b)))
#define HYI_BITS8(m) hyi_bits8_avx512(m)
#define HYI_MIN8_WHERE(a, m, b) _mm256_mask_min_ps(a, m, a, b)
#define HYI_PIN8(a) hyi_pin8_avx512(a)
#define HYI_LANES 16u
#define HYI_ALLW 0xffffu
#define HYI_FW __m512
#define HYI_MW __mmask16
#define HYI_LOADW(p) _mm512_loadu_ps(p)
#define HYI_SETW(value) _mm512_set1_ps(value)
#define HYI_ZEROW() _mm512_setzero_ps()
#define HYI_SUBW(a, b) _mm512_sub_ps(a, b)
#define HYI_MULW(a, b) _mm512_mul_ps(a, b)
#define HYI_MINW(a, b) _mm512_min_ps(a, b)
#define HYI_MAXW(a, b) _mm512_max_ps(a, b)
#define HYI_MAXW_AS_INTS(a, b) _mm512_castsi512_ps(_mm512_max_epi32(_mm512_castps_si512(a), _mm512_castps_si512(b)))
#define HYI_SIZEW(a) _mm512_abs_ps(a)
#define HYI_LTW(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define HYI_ANDW(a, b) ((__mmask16)((a) & (b)))
#define HYI_ORW(a, b) ((__mmask16)((a) | (b)))
#define HYI_CHOOSEW(m, a, b) _mm512_mask_blend_ps(m, b, a)
#define HYI_SAMEW(a, b) _mm512_cmpeq_epi32_mask(_mm512_castps_si512(a), _mm512_castps_si512(b))
#define HYI_BITSW(m) hyi_bits16_avx512(m)
#define HYI_PINW(a) hyi_pin16_avx512(a)
#define HYI_GREATESTW(a) _mm512_reduce_max_ps(a)
#define HYI_DEAL 16u
#define HYI_MASKS hyi_masks16
#define HYI_CLEAR_MASKS(masks) ((masks).lanes = _mm_setzero_si128())

#define HYI_STOREW(p, a) _mm512_storeu_ps(p, a)
#define HYI_ADDW(a, b) _mm512_add_ps(a, b)
#define HYI_DIVW(a, b) _mm512_div_ps(a, b)
#define HYI_LEW(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define HYI_LEASTW(a) _mm512_reduce_min_ps(a)
#define HYI_FD __m512d
#define HYI_SETD(value) _mm512_set1_pd(value)
#define HYI_HALFD(a, half) _mm512_cvtps_pd((half) ? _mm512_extractf32x8_ps(a, 1) : _mm512_castps512_ps256(a))
#define HYI_LOADD(p) _mm512_loadu_pd(p)
#define HYI_STORED(p, a) _mm512_storeu_pd(p, a)
#define HYI_STOREH(p, half, a) _mm256_storeu_ps((p) + 8 * (half), _mm512_cvtpd_ps(a))
#define HYI_ADDD(a, b) _mm512_add_pd(a, b)
#define HYI_SUBD(a, b) _mm512_sub_pd(a, b)
#define HYI_MULD(a, b) _mm512_mul_pd(a, b)
#define HYI_DIVD(a, b) _mm512_div_pd(a, b)
#define HYI_MIND(a, b) _mm512_min_pd(a, b)
#define HYI_MAXD(a, b) _mm512_max_pd(a, b)
#define HYI_LTD(a, b) hyi_bits8_avx512(_mm512_cmp_pd_mask(a, b, _CMP_LT_OQ))
#define HYI_PIND(a) hyi_pin_double_avx512(a)
#include "lanes_four.inc.h"
#include "aim_body.inc.h"
#include "walk_body.inc.h"
#include "packet_body.inc.h"
#include "begin_body.inc.h"
#include "unpack_body.inc.h"
#include "stream_body.inc.h"
#include "lanes_end.inc.h"

#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#endif /* HYI_X86 */
#endif /* HYI_BVH_AVX512_H */
