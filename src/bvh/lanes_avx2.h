/* >>bvh-avx2: traversal in the words of AVX2: eight rays a packet */
#ifndef HYI_BVH_AVX2_H
#define HYI_BVH_AVX2_H

#include "stream.h"

#if HYI_X86

#include "lanes_begin.inc.h"

HYI_INLINE HYI_AVX2 __m256d hyi_pin_double_avx2(__m256d value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX2 __m256 hyi_pin8_avx2(__m256 value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX2 float hyi_greatest_avx2(__m256 a) {
    __m128 four = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    __m128 two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps(two, two, 1)));
}

/* By mask: the numbers of its set bits, lowest first. */
static const uint8_t hyi_front[256][8] = {
    {0,0,0,0,0,0,0,0}, {0,0,0,0,0,0,0,0}, {1,0,0,0,0,0,0,0}, {0,1,0,0,0,0,0,0},
    {2,0,0,0,0,0,0,0}, {0,2,0,0,0,0,0,0}, {1,2,0,0,0,0,0,0}, {0,1,2,0,0,0,0,0},
    {3,0,0,0,0,0,0,0}, {0,3,0,0,0,0,0,0}, {1,3,0,0,0,0,0,0}, {0,1,3,0,0,0,0,0},
    {2,3,0,0,0,0,0,0}, {0,2,3,0,0,0,0,0}, {1,2,3,0,0,0,0,0}, {0,1,2,3,0,0,0,0},
    {4,0,0,0,0,0,0,0}, {0,4,0,0,0,0,0,0}, {1,4,0,0,0,0,0,0}, {0,1,4,0,0,0,0,0},
    {2,4,0,0,0,0,0,0}, {0,2,4,0,0,0,0,0}, {1,2,4,0,0,0,0,0}, {0,1,2,4,0,0,0,0},
    {3,4,0,0,0,0,0,0}, {0,3,4,0,0,0,0,0}, {1,3,4,0,0,0,0,0}, {0,1,3,4,0,0,0,0},
    {2,3,4,0,0,0,0,0}, {0,2,3,4,0,0,0,0}, {1,2,3,4,0,0,0,0}, {0,1,2,3,4,0,0,0},
    {5,0,0,0,0,0,0,0}, {0,5,0,0,0,0,0,0}, {1,5,0,0,0,0,0,0}, {0,1,5,0,0,0,0,0},
    {2,5,0,0,0,0,0,0}, {0,2,5,0,0,0,0,0}, {1,2,5,0,0,0,0,0}, {0,1,2,5,0,0,0,0},
    {3,5,0,0,0,0,0,0}, {0,3,5,0,0,0,0,0}, {1,3,5,0,0,0,0,0}, {0,1,3,5,0,0,0,0},
    {2,3,5,0,0,0,0,0}, {0,2,3,5,0,0,0,0}, {1,2,3,5,0,0,0,0}, {0,1,2,3,5,0,0,0},
    {4,5,0,0,0,0,0,0}, {0,4,5,0,0,0,0,0}, {1,4,5,0,0,0,0,0}, {0,1,4,5,0,0,0,0},
    {2,4,5,0,0,0,0,0}, {0,2,4,5,0,0,0,0}, {1,2,4,5,0,0,0,0}, {0,1,2,4,5,0,0,0},
    {3,4,5,0,0,0,0,0}, {0,3,4,5,0,0,0,0}, {1,3,4,5,0,0,0,0}, {0,1,3,4,5,0,0,0},
    {2,3,4,5,0,0,0,0}, {0,2,3,4,5,0,0,0}, {1,2,3,4,5,0,0,0}, {0,1,2,3,4,5,0,0},
    {6,0,0,0,0,0,0,0}, {0,6,0,0,0,0,0,0}, {1,6,0,0,0,0,0,0}, {0,1,6,0,0,0,0,0},
    {2,6,0,0,0,0,0,0}, {0,2,6,0,0,0,0,0}, {1,2,6,0,0,0,0,0}, {0,1,2,6,0,0,0,0},
    {3,6,0,0,0,0,0,0}, {0,3,6,0,0,0,0,0}, {1,3,6,0,0,0,0,0}, {0,1,3,6,0,0,0,0},
    {2,3,6,0,0,0,0,0}, {0,2,3,6,0,0,0,0}, {1,2,3,6,0,0,0,0}, {0,1,2,3,6,0,0,0},
    {4,6,0,0,0,0,0,0}, {0,4,6,0,0,0,0,0}, {1,4,6,0,0,0,0,0}, {0,1,4,6,0,0,0,0},
    {2,4,6,0,0,0,0,0}, {0,2,4,6,0,0,0,0}, {1,2,4,6,0,0,0,0}, {0,1,2,4,6,0,0,0},
    {3,4,6,0,0,0,0,0}, {0,3,4,6,0,0,0,0}, {1,3,4,6,0,0,0,0}, {0,1,3,4,6,0,0,0},
    {2,3,4,6,0,0,0,0}, {0,2,3,4,6,0,0,0}, {1,2,3,4,6,0,0,0}, {0,1,2,3,4,6,0,0},
    {5,6,0,0,0,0,0,0}, {0,5,6,0,0,0,0,0}, {1,5,6,0,0,0,0,0}, {0,1,5,6,0,0,0,0},
    {2,5,6,0,0,0,0,0}, {0,2,5,6,0,0,0,0}, {1,2,5,6,0,0,0,0}, {0,1,2,5,6,0,0,0},
    {3,5,6,0,0,0,0,0}, {0,3,5,6,0,0,0,0}, {1,3,5,6,0,0,0,0}, {0,1,3,5,6,0,0,0},
    {2,3,5,6,0,0,0,0}, {0,2,3,5,6,0,0,0}, {1,2,3,5,6,0,0,0}, {0,1,2,3,5,6,0,0},
    {4,5,6,0,0,0,0,0}, {0,4,5,6,0,0,0,0}, {1,4,5,6,0,0,0,0}, {0,1,4,5,6,0,0,0},
    {2,4,5,6,0,0,0,0}, {0,2,4,5,6,0,0,0}, {1,2,4,5,6,0,0,0}, {0,1,2,4,5,6,0,0},
    {3,4,5,6,0,0,0,0}, {0,3,4,5,6,0,0,0}, {1,3,4,5,6,0,0,0}, {0,1,3,4,5,6,0,0},
    {2,3,4,5,6,0,0,0}, {0,2,3,4,5,6,0,0}, {1,2,3,4,5,6,0,0}, {0,1,2,3,4,5,6,0},
    {7,0,0,0,0,0,0,0}, {0,7,0,0,0,0,0,0}, {1,7,0,0,0,0,0,0}, {0,1,7,0,0,0,0,0},
    {2,7,0,0,0,0,0,0}, {0,2,7,0,0,0,0,0}, {1,2,7,0,0,0,0,0}, {0,1,2,7,0,0,0,0},
    {3,7,0,0,0,0,0,0}, {0,3,7,0,0,0,0,0}, {1,3,7,0,0,0,0,0}, {0,1,3,7,0,0,0,0},
    {2,3,7,0,0,0,0,0}, {0,2,3,7,0,0,0,0}, {1,2,3,7,0,0,0,0}, {0,1,2,3,7,0,0,0},
    {4,7,0,0,0,0,0,0}, {0,4,7,0,0,0,0,0}, {1,4,7,0,0,0,0,0}, {0,1,4,7,0,0,0,0},
    {2,4,7,0,0,0,0,0}, {0,2,4,7,0,0,0,0}, {1,2,4,7,0,0,0,0}, {0,1,2,4,7,0,0,0},
    {3,4,7,0,0,0,0,0}, {0,3,4,7,0,0,0,0}, {1,3,4,7,0,0,0,0}, {0,1,3,4,7,0,0,0},
    {2,3,4,7,0,0,0,0}, {0,2,3,4,7,0,0,0}, {1,2,3,4,7,0,0,0}, {0,1,2,3,4,7,0,0},
    {5,7,0,0,0,0,0,0}, {0,5,7,0,0,0,0,0}, {1,5,7,0,0,0,0,0}, {0,1,5,7,0,0,0,0},
    {2,5,7,0,0,0,0,0}, {0,2,5,7,0,0,0,0}, {1,2,5,7,0,0,0,0}, {0,1,2,5,7,0,0,0},
    {3,5,7,0,0,0,0,0}, {0,3,5,7,0,0,0,0}, {1,3,5,7,0,0,0,0}, {0,1,3,5,7,0,0,0},
    {2,3,5,7,0,0,0,0}, {0,2,3,5,7,0,0,0}, {1,2,3,5,7,0,0,0}, {0,1,2,3,5,7,0,0},
    {4,5,7,0,0,0,0,0}, {0,4,5,7,0,0,0,0}, {1,4,5,7,0,0,0,0}, {0,1,4,5,7,0,0,0},
    {2,4,5,7,0,0,0,0}, {0,2,4,5,7,0,0,0}, {1,2,4,5,7,0,0,0}, {0,1,2,4,5,7,0,0},
    {3,4,5,7,0,0,0,0}, {0,3,4,5,7,0,0,0}, {1,3,4,5,7,0,0,0}, {0,1,3,4,5,7,0,0},
    {2,3,4,5,7,0,0,0}, {0,2,3,4,5,7,0,0}, {1,2,3,4,5,7,0,0}, {0,1,2,3,4,5,7,0},
    {6,7,0,0,0,0,0,0}, {0,6,7,0,0,0,0,0}, {1,6,7,0,0,0,0,0}, {0,1,6,7,0,0,0,0},
    {2,6,7,0,0,0,0,0}, {0,2,6,7,0,0,0,0}, {1,2,6,7,0,0,0,0}, {0,1,2,6,7,0,0,0},
    {3,6,7,0,0,0,0,0}, {0,3,6,7,0,0,0,0}, {1,3,6,7,0,0,0,0}, {0,1,3,6,7,0,0,0},
    {2,3,6,7,0,0,0,0}, {0,2,3,6,7,0,0,0}, {1,2,3,6,7,0,0,0}, {0,1,2,3,6,7,0,0},
    {4,6,7,0,0,0,0,0}, {0,4,6,7,0,0,0,0}, {1,4,6,7,0,0,0,0}, {0,1,4,6,7,0,0,0},
    {2,4,6,7,0,0,0,0}, {0,2,4,6,7,0,0,0}, {1,2,4,6,7,0,0,0}, {0,1,2,4,6,7,0,0},
    {3,4,6,7,0,0,0,0}, {0,3,4,6,7,0,0,0}, {1,3,4,6,7,0,0,0}, {0,1,3,4,6,7,0,0},
    {2,3,4,6,7,0,0,0}, {0,2,3,4,6,7,0,0}, {1,2,3,4,6,7,0,0}, {0,1,2,3,4,6,7,0},
    {5,6,7,0,0,0,0,0}, {0,5,6,7,0,0,0,0}, {1,5,6,7,0,0,0,0}, {0,1,5,6,7,0,0,0},
    {2,5,6,7,0,0,0,0}, {0,2,5,6,7,0,0,0}, {1,2,5,6,7,0,0,0}, {0,1,2,5,6,7,0,0},
    {3,5,6,7,0,0,0,0}, {0,3,5,6,7,0,0,0}, {1,3,5,6,7,0,0,0}, {0,1,3,5,6,7,0,0},
    {2,3,5,6,7,0,0,0}, {0,2,3,5,6,7,0,0}, {1,2,3,5,6,7,0,0}, {0,1,2,3,5,6,7,0},
    {4,5,6,7,0,0,0,0}, {0,4,5,6,7,0,0,0}, {1,4,5,6,7,0,0,0}, {0,1,4,5,6,7,0,0},
    {2,4,5,6,7,0,0,0}, {0,2,4,5,6,7,0,0}, {1,2,4,5,6,7,0,0}, {0,1,2,4,5,6,7,0},
    {3,4,5,6,7,0,0,0}, {0,3,4,5,6,7,0,0}, {1,3,4,5,6,7,0,0}, {0,1,3,4,5,6,7,0},
    {2,3,4,5,6,7,0,0}, {0,2,3,4,5,6,7,0}, {1,2,3,4,5,6,7,0}, {0,1,2,3,4,5,6,7},
};

/* Where those of eight items go whose bits are set, to stand first. */
HYI_INLINE HYI_AVX2 __m256i hyi_front_places_avx2(uint32_t takes) {
    return _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)hyi_front[takes]));
}

/* Appends eight items to the lists of the children that their masks name. The items whose bit is set are moved to the
   front by a permutation from a table. */
HYI_INLINE HYI_AVX2 void hyi_deal_out_avx2(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    __m256i all = _mm256_loadu_si256((const __m256i *)(const void *)items);
    __m128i bits = _mm_loadl_epi64((const __m128i *)(const void *)masks->bytes);
    for (int c = 7; c >= 0; c--) { /* the highest bit of each byte is the child's */
        uint32_t takes = (uint32_t)_mm_movemask_epi8(bits) & 0xffu;
        bits = _mm_add_epi8(bits, bits);
        _mm256_storeu_si256((__m256i *)(void *)(lists + (size_t)(uint32_t)c * stride + dealt[c]), _mm256_permutevar8x32_epi32(all, hyi_front_places_avx2(takes)));
        dealt[c] += (uint32_t)_mm_popcnt_u32(takes);
    }
}

/* hyi_wait_at_children, without a branch. */
HYI_INLINE HYI_AVX2 void hyi_wait_at_children_avx2(hyi_waiters *w, const hyi_node *node, uint32_t ray, uint32_t mask, __m256 enter) {
    __m256i child = _mm256_load_si256((const __m256i *)(const void *)node->child), rays = _mm256_set1_epi32((int)ray);
    uint32_t leaves = mask & (uint32_t)_mm256_movemask_ps(_mm256_castsi256_ps(child)), nodes = mask ^ leaves;
    __m256i to_leaves = hyi_front_places_avx2(leaves), to_nodes = hyi_front_places_avx2(nodes);
    _mm256_storeu_si256((__m256i *)(void *)(w->leaves + w->at_leaves), _mm256_permutevar8x32_epi32(child, to_leaves));
    _mm256_storeu_ps(w->enter + w->at_leaves, _mm256_permutevar8x32_ps(enter, to_leaves));
    _mm256_storeu_si256((__m256i *)(void *)(w->leaf_rays + w->at_leaves), rays);
    _mm256_storeu_si256((__m256i *)(void *)(w->nodes + w->at_nodes), _mm256_permutevar8x32_epi32(child, to_nodes));
    _mm256_storeu_si256((__m256i *)(void *)(w->node_rays + w->at_nodes), rays);
    w->at_leaves += (uint32_t)_mm_popcnt_u32(leaves);
    w->at_nodes += (uint32_t)_mm_popcnt_u32(nodes);
}

/* hyi_ray_words: two times, two rays to a register, and two transpositions of four by four in two steps. */
HYI_INLINE HYI_AVX2 void hyi_ray_words_avx2(const hyk_ray *rays, float words[8][HYI_PACKET_WIDTH]) {
    for (uint32_t half = 0; half < 2u; half++) {
        __m256 a[4];
        for (uint32_t k = 0; k < 4u; k++) {
            a[k] = _mm256_castps128_ps256(_mm_loadu_ps((const float *)(const void *)&rays[k] + 4u * half));
            a[k] = _mm256_insertf128_ps(a[k], _mm_loadu_ps((const float *)(const void *)&rays[k + 4u] + 4u * half), 1);
        }
        __m256 low01 = _mm256_unpacklo_ps(a[0], a[1]), high01 = _mm256_unpackhi_ps(a[0], a[1]);
        __m256 low23 = _mm256_unpacklo_ps(a[2], a[3]), high23 = _mm256_unpackhi_ps(a[2], a[3]);
        _mm256_storeu_ps(words[4u * half], _mm256_shuffle_ps(low01, low23, 0x44));
        _mm256_storeu_ps(words[4u * half + 1u], _mm256_shuffle_ps(low01, low23, 0xee));
        _mm256_storeu_ps(words[4u * half + 2u], _mm256_shuffle_ps(high01, high23, 0x44));
        _mm256_storeu_ps(words[4u * half + 3u], _mm256_shuffle_ps(high01, high23, 0xee));
    }
}

/* Four successive words of each of eight rays, as rows of one word of all: four by four in each half. */
HYI_INLINE HYI_AVX2 void hyi_four_words_avx2(const char *const at[8], size_t offset, __m256 rows[4]) {
    __m256 a[4];
    for (uint32_t k = 0; k < 4u; k++) {
        a[k] = _mm256_castps128_ps256(_mm_loadu_ps((const float *)(const void *)(at[k] + offset)));
        a[k] = _mm256_insertf128_ps(a[k], _mm_loadu_ps((const float *)(const void *)(at[4u + k] + offset)), 1);
    }
    __m256 low01 = _mm256_unpacklo_ps(a[0], a[1]), high01 = _mm256_unpackhi_ps(a[0], a[1]);
    __m256 low23 = _mm256_unpacklo_ps(a[2], a[3]), high23 = _mm256_unpackhi_ps(a[2], a[3]);
    rows[0] = _mm256_shuffle_ps(low01, low23, 0x44);
    rows[1] = _mm256_shuffle_ps(low01, low23, 0xee);
    rows[2] = _mm256_shuffle_ps(high01, high23, 0x44);
    rows[3] = _mm256_shuffle_ps(high01, high23, 0xee);
}

/* hyi_lines: two transpositions of eight by eight, in three steps each. */
HYI_INLINE HYI_AVX2 void hyi_lines_avx2(const void *const rows[16], char *lines) {
    for (int side = 0; side < 2; side++) {
        __m256 a[8], b[8];
        for (int i = 0; i < 8; i++) a[i] = _mm256_loadu_ps((const float *)rows[8 * side + i]);
        for (int i = 0; i < 8; i += 2) {
            b[i] = _mm256_unpacklo_ps(a[i], a[i + 1]);
            b[i + 1] = _mm256_unpackhi_ps(a[i], a[i + 1]);
        }
        for (int i = 0; i < 8; i += 4) {
            for (int k = 0; k < 2; k++) {
                a[i + 2 * k] = _mm256_shuffle_ps(b[i + k], b[i + k + 2], 0x44);
                a[i + 2 * k + 1] = _mm256_shuffle_ps(b[i + k], b[i + k + 2], 0xee);
            }
        }
        for (int k = 0; k < 4; k++) {
            float *low = (float *)(void *)(lines + (size_t)(uint32_t)k * sizeof(hyi_flight)) + 8 * side;
            float *high = (float *)(void *)(lines + (size_t)(uint32_t)(k + 4) * sizeof(hyi_flight)) + 8 * side;
            _mm256_store_ps(low, _mm256_permute2f128_ps(a[k], a[k + 4], 0x20));
            _mm256_store_ps(high, _mm256_permute2f128_ps(a[k], a[k + 4], 0x31));
        }
    }
}

/* Eight keys and the same in another order: the greater go where bits of places has one, the lesser elsewhere. */
#define HYI_SORT_STEP_AVX2(keys, others, places)                                                                         \
    do {                                                                                                                 \
        __m256i sort_others = (others);                                                                                  \
        keys = _mm256_blend_epi32(_mm256_min_epi32(keys, sort_others), _mm256_max_epi32(keys, sort_others), places);     \
    } while (0)

/* The greatest first: each step compares all, in pairs. Nothing is guessed, so nothing is guessed wrong. */
HYI_INLINE HYI_AVX2 __m256i hyi_sorted_avx2(__m256i keys) {
    HYI_SORT_STEP_AVX2(keys, _mm256_shuffle_epi32(keys, 0xb1), 0x55);
    HYI_SORT_STEP_AVX2(keys, _mm256_shuffle_epi32(keys, 0x1b), 0x33);
    HYI_SORT_STEP_AVX2(keys, _mm256_shuffle_epi32(keys, 0xb1), 0x55);
    HYI_SORT_STEP_AVX2(keys, _mm256_permute4x64_epi64(_mm256_shuffle_epi32(keys, 0x1b), 0x4e), 0x0f);
    HYI_SORT_STEP_AVX2(keys, _mm256_shuffle_epi32(keys, 0x4e), 0x33);
    HYI_SORT_STEP_AVX2(keys, _mm256_shuffle_epi32(keys, 0xb1), 0x55);
    return keys;
}
#undef HYI_SORT_STEP_AVX2

/* The least of eight. */
HYI_INLINE HYI_AVX2 uint32_t hyi_least_key_avx2(__m256i keys) {
    keys = _mm256_min_epi32(keys, _mm256_shuffle_epi32(keys, 0xb1));
    keys = _mm256_min_epi32(keys, _mm256_shuffle_epi32(keys, 0x4e));
    return (uint32_t)_mm_cvtsi128_si32(_mm_min_epi32(_mm256_castsi256_si128(keys), _mm256_extracti128_si256(keys, 1)));
}

/* hyi_push_farther of three children or more. They are sorted by t, or by 0 where that is less, with the number of the child in its
   last bits; what waits has these clear, so that it is no more than t, if that matters. All eight are written: those that are not met
   lie above the top. */
HYI_INLINE HYI_AVX2 uint32_t hyi_push_several_avx2(hyi_waiting **stack, const hyi_node *node, const float enter[8], uint32_t mask, const hyi_ahead *ahead) {
    const __m256i numbers = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128), last = _mm256_set1_epi32(7);
    __m256i met = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32((int)mask), bits), bits);
    __m256i t = _mm256_max_epi32(_mm256_castps_si256(_mm256_loadu_ps(enter)), _mm256_setzero_si256());
    __m256i keys = _mm256_or_si256(_mm256_andnot_si256(last, t), numbers);
    uint32_t nearest = node->child[hyi_least_key_avx2(_mm256_blendv_epi8(_mm256_set1_epi32(INT32_MAX), keys, met)) & 7u];
    keys = hyi_sorted_avx2(_mm256_blendv_epi8(_mm256_or_si256(_mm256_set1_epi32(INT32_MIN), numbers), keys, met));
    __m256i child = _mm256_permutevar8x32_epi32(_mm256_load_si256((const __m256i *)(const void *)node->child), keys);
    t = _mm256_andnot_si256(last, keys);
    __m256i even = _mm256_unpacklo_epi32(child, t), odd = _mm256_unpackhi_epi32(child, t);
    _mm256_storeu_si256((__m256i *)(void *)*stack, _mm256_permute2x128_si256(even, odd, 0x20));
    _mm256_storeu_si256((__m256i *)(void *)(*stack + 4), _mm256_permute2x128_si256(even, odd, 0x31));
    *stack += _mm_popcnt_u32(mask) - 1;
    for (; ahead && mask; mask &= mask - 1u) hyi_ask_for(ahead, node->child[hyi_lowest_bit(mask)]);
    return nearest;
}

#define HYI_TARGET HYI_AVX2
#define HYI_I(name) name##_avx2
#define HYI_F8 __m256
#define HYI_ALWAYS_EXACT 0
#define HYI_EXACT_ALONE 0
#define HYI_PUSH_SEVERAL(stack, node, enter, mask, ahead) hyi_push_several_avx2(stack, node, enter, mask, ahead)
#define HYI_M8 __m256
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
#define HYI_LT8(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define HYI_LE8(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define HYI_AND8(a, b) _mm256_and_ps(a, b)
#define HYI_OR8(a, b) _mm256_or_ps(a, b)
#define HYI_BITS8(m) ((uint32_t)_mm256_movemask_ps(m))
#define HYI_MIN8_WHERE(a, m, b) _mm256_blendv_ps(a, _mm256_min_ps(a, b), m)
#define HYI_PIN8(a) hyi_pin8_avx2(a)
#define HYI_RAY_WORDS(rays, words) hyi_ray_words_avx2(rays, words)
#define HYI_RECORDS(rows, words, out) HYI_I(hyi_records_four)(rows, words, out)
#define HYI_LINES(rows, lines) hyi_lines_avx2(rows, lines)
#define HYI_FOUR_WORDS(at, offset, rows) hyi_four_words_avx2(at, offset, rows)
#define HYI_PAIRS false
#define HYI_LANES 8u
#define HYI_ALLW 0xffu
#define HYI_FW __m256
#define HYI_MW __m256
#define HYI_LOADW(p) _mm256_loadu_ps(p)
#define HYI_SETW(value) _mm256_set1_ps(value)
#define HYI_ZEROW() _mm256_setzero_ps()
#define HYI_SUBW(a, b) _mm256_sub_ps(a, b)
#define HYI_MULW(a, b) _mm256_mul_ps(a, b)
#define HYI_MADW(a, b, c) _mm256_fmadd_ps(a, b, c)
#define HYI_MINW(a, b) _mm256_min_ps(a, b)
#define HYI_MAXW(a, b) _mm256_max_ps(a, b)
#define HYI_MAXW_AS_INTS(a, b) HYI_MAX8_AS_INTS(a, b)
#define HYI_SIZEW(a) HYI_SIZE8(a)
#define HYI_LTW(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define HYI_ANDW(a, b) _mm256_and_ps(a, b)
#define HYI_ORW(a, b) _mm256_or_ps(a, b)
#define HYI_CHOOSEW(m, a, b) _mm256_blendv_ps(b, a, m)
#define HYI_SAMEW(a, b) _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b)))
#define HYI_BITSW(m) ((uint32_t)_mm256_movemask_ps(m))
#define HYI_PINW(a) hyi_pin8_avx2(a)
#define HYI_GREATESTW(a) hyi_greatest_avx2(a)
#define HYI_DEAL_BLOCKS(swarm, node, list, count, lists, stride, dealt, nearest) 0u
#define HYI_WAIT_AT_CHILDREN(waiters, node, ray, mask, enter) hyi_wait_at_children_avx2(waiters, node, ray, HYI_BITS8(mask), enter)

#define HYI_STOREW(p, a) _mm256_storeu_ps(p, a)
#define HYI_ADDW(a, b) _mm256_add_ps(a, b)
#define HYI_DIVW(a, b) _mm256_div_ps(a, b)
#define HYI_LEW(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define HYI_LEASTW(a) (-hyi_greatest_avx2(_mm256_sub_ps(_mm256_setzero_ps(), a)))
#define HYI_FD __m256d
#define HYI_SETD(value) _mm256_set1_pd(value)
#define HYI_LOADH(p, half) _mm256_cvtps_pd(_mm_loadu_ps((p) + 4 * (half)))
#define HYI_LOADD(p) _mm256_loadu_pd(p)
#define HYI_STORED(p, a) _mm256_storeu_pd(p, a)
#define HYI_STOREH(p, half, a) _mm_storeu_ps((p) + 4 * (half), _mm256_cvtpd_ps(a))
#define HYI_ADDD(a, b) _mm256_add_pd(a, b)
#define HYI_SUBD(a, b) _mm256_sub_pd(a, b)
#define HYI_MULD(a, b) _mm256_mul_pd(a, b)
#define HYI_DIVD(a, b) _mm256_div_pd(a, b)
#define HYI_MIND(a, b) _mm256_min_pd(a, b)
#define HYI_MAXD(a, b) _mm256_max_pd(a, b)
#define HYI_LTD(a, b) ((uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_LT_OQ)))
#define HYI_PIND(a) hyi_pin_double_avx2(a)
#include "lanes_four.inc.h"
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
#endif /* HYI_BVH_AVX2_H */
