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
