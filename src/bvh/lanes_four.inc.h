/* ---- four floats in the words of x86, for the instruction sets that have them: all */

#define HYI_F4 __m128
#define HYI_LOAD4(p) _mm_loadu_ps(p)
#define HYI_STORE4(p, a) _mm_storeu_ps(p, a)
#define HYI_SET4(value) _mm_set1_ps(value)
#define HYI_ADD4(a, b) _mm_add_ps(a, b)
#define HYI_SUB4(a, b) _mm_sub_ps(a, b)
#define HYI_MUL4(a, b) _mm_mul_ps(a, b)
#define HYI_DIV4(a, b) _mm_div_ps(a, b)
#define HYI_MAX4(a, b) _mm_max_ps(a, b)
#define HYI_LE4(a, b) _mm_cmple_ps(a, b)
#define HYI_SIZE4(a) _mm_andnot_ps(_mm_set1_ps(-0.0f), a)
#define HYI_SIGNED4(size, of) _mm_or_ps(size, _mm_and_ps(_mm_set1_ps(-0.0f), of))
#define HYI_EXCEED4(a, most) HYI_I(hyi_exceed4)(a, most)
#define HYI_BYTES4(a, bytes) _mm_castsi128_ps(_mm_shuffle_epi8(_mm_castps_si128(a), _mm_loadu_si128((const __m128i *)(const void *)(bytes))))
#define HYI_STORE_PLACES4(p, a) HYI_I(hyi_store_places4)(p, a)

/* Bits of those whose size has greater bits, as an integer. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_exceed4)(__m128 a, const uint32_t most[4]) {
    __m128i exceeds = _mm_cmpgt_epi32(_mm_castps_si128(HYI_SIZE4(a)), _mm_loadu_si128((const __m128i *)(const void *)most));
    return (uint32_t)_mm_movemask_ps(_mm_castsi128_ps(exceeds));
}

/* hyi_aim.near_plane by the signs of a direction; HYI_WIDTH is 8. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_store_places4)(uint32_t *at, __m128 direction) {
    __m128i falls = _mm_and_si128(_mm_srli_epi32(_mm_castps_si128(direction), 28), _mm_set1_epi32((int)HYI_WIDTH));
    _mm_storeu_si128((__m128i *)(void *)at, _mm_or_si128(falls, _mm_setr_epi32(0, (int)(2u * HYI_WIDTH), (int)(4u * HYI_WIDTH), 0)));
}

/* hyi_records of eight: four words of four lanes at a time, transposed. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_records_four)(float rows[HYI_RECORD_WORDS][HYI_PACKET_WIDTH], uint32_t words, char *out) {
    uint32_t last = words & ~3u;
    for (uint32_t i = 0; i < 8u; i += 4u) {
        for (uint32_t word = 0; word < last; word += 4u) {
            __m128 a = _mm_loadu_ps(rows[word] + i), b = _mm_loadu_ps(rows[word + 1u] + i);
            __m128 c = _mm_loadu_ps(rows[word + 2u] + i), d = _mm_loadu_ps(rows[word + 3u] + i);
            float *at = (float *)(void *)out + words * i + word;
            _MM_TRANSPOSE4_PS(a, b, c, d);
            _mm_storeu_ps(at, a);
            _mm_storeu_ps(at + words, b);
            _mm_storeu_ps(at + 2u * words, c);
            _mm_storeu_ps(at + 3u * words, d);
        }
        for (uint32_t k = i; k < i + 4u; k++)
            for (uint32_t word = last; word < words; word++) memcpy(out + sizeof(float) * (words * k + word), &rows[word][k], sizeof(float));
    }
}
