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
