/* >>bvh-avx512: traversal in the words of AVX-512: sixteen rays a packet, lists dealt by compression */
#ifndef HYI_BVH_AVX512_H
#define HYI_BVH_AVX512_H

#include "lanes_avx2.h"

#if HYI_X86

#include "lanes_begin.inc.h"

/* The compiler's own intrinsics begin with undefined values, which it then warns of (GCC bug 105593). */
#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#define HYI_UNROLL_8 _Pragma("GCC unroll 8")
#else
#define HYI_UNROLL_8
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

/* Appends those of eight items that have a bit. */
HYI_INLINE HYI_AVX512 void hyi_append_avx512(uint32_t *to, __m256i items, __mmask8 takes) {
    _mm256_storeu_si256((__m256i *)(void *)to, _mm256_maskz_compress_epi32(takes, items));
}

/* Appends eight items to the lists of the children that their masks name. */
HYI_INLINE HYI_AVX512 void hyi_deal_out_avx512(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    __m256i all = _mm256_loadu_si256((const __m256i *)(const void *)items);
    __m128i bits = _mm_loadl_epi64((const __m128i *)(const void *)masks->bytes);
    for (int c = 7; c >= 0; c--) { /* the highest bit of each byte is the child's */
        uint32_t takes = (uint32_t)_mm_movemask_epi8(bits) & 0xffu;
        bits = _mm_add_epi8(bits, bits);
        hyi_append_avx512(lists + (size_t)(uint32_t)c * stride + dealt[c], all, (__mmask8)takes);
        dealt[c] += (uint32_t)_mm_popcnt_u32(takes);
    }
}

/* Four successive words of each of sixteen rays, as rows of one word of all: four by four in each quarter. */
HYI_INLINE HYI_AVX512 void hyi_four_words_avx512(const char *const at[16], size_t offset, __m512 rows[4]) {
    __m512 a[4];
    for (uint32_t k = 0; k < 4u; k++) {
        a[k] = _mm512_castps128_ps512(_mm_loadu_ps((const float *)(const void *)(at[k] + offset)));
        a[k] = _mm512_insertf32x4(a[k], _mm_loadu_ps((const float *)(const void *)(at[4u + k] + offset)), 1);
        a[k] = _mm512_insertf32x4(a[k], _mm_loadu_ps((const float *)(const void *)(at[8u + k] + offset)), 2);
        a[k] = _mm512_insertf32x4(a[k], _mm_loadu_ps((const float *)(const void *)(at[12u + k] + offset)), 3);
    }
    __m512 low01 = _mm512_unpacklo_ps(a[0], a[1]), high01 = _mm512_unpackhi_ps(a[0], a[1]);
    __m512 low23 = _mm512_unpacklo_ps(a[2], a[3]), high23 = _mm512_unpackhi_ps(a[2], a[3]);
    rows[0] = _mm512_shuffle_ps(low01, low23, 0x44);
    rows[1] = _mm512_shuffle_ps(low01, low23, 0xee);
    rows[2] = _mm512_shuffle_ps(high01, high23, 0x44);
    rows[3] = _mm512_shuffle_ps(high01, high23, 0xee);
}

/* ---- flights side by side at a node

   What else meets the boxes of a node ray by ray, eight boxes at a time, meets them here box by box, sixteen or eight rays at a time:
   planes are broadcast instead of rays, of which there are more, and who enters a child is known in the order of the list. Boxes go by
   their middles and halves, which fall and rise along with a ray's direction: no lane has to choose between planes, and one offset is read
   of each ray. */

/* hyi_aim of flights from inverse to t_far, and the sizes of inverse. */
typedef struct hyi_slabs8_avx512 {
    __m256 words[8], size[3];
} hyi_slabs8_avx512;

typedef struct hyi_slabs16_avx512 {
    __m512 words[8], size[3];
} hyi_slabs16_avx512;

HYI_STATIC_ASSERT(offsetof(hyi_aim, near_offset) - offsetof(hyi_aim, inverse) == 12 && offsetof(hyi_aim, t_near) - offsetof(hyi_aim, inverse) == 24 &&
                  offsetof(hyi_aim, t_far) - offsetof(hyi_aim, inverse) == 28);

/* Boxes of a node: their middles, and what is between these and the planes that rays enter and leave by. */
typedef struct hyi_centred_avx512 {
    float middle[3][HYI_WIDTH], to_near[3][HYI_WIDTH], to_far[3][HYI_WIDTH];
} hyi_centred_avx512;

/* Offsets are those of origins moved back by each ray's bound, so boxes end beyond the far planes by twice the greatest. What is rounded
   more than in hyi_meet_boxes, in 2^-24: the middle, by its size, the half, by its own, and t at the middle, by that of the middle and of
   the ray's origin. 2^-23 of middle and half together, and a quarter of the bound, which is no less than 2^-24 of the origin
   (hyi_slab_bound), are added on both sides. Bounds alone would not do: after a refit, planes may lie far outside of the box of the tree,
   which is that of triangles with an area. */
HYI_INLINE HYI_AVX512 void hyi_centre_boxes_avx512(const hyi_swarm *swarm, const hyi_node *node, hyi_centred_avx512 *boxes) {
    const __m256 half = _mm256_set1_ps(0.5f);
    for (int a = 0; a < 3; a++) {
        __m256 lower = _mm256_load_ps(node->planes[2 * a]), upper = _mm256_load_ps(node->planes[2 * a + 1]), bound = _mm256_set1_ps(swarm->bound[a]);
        __m256 middle = _mm256_mul_ps(_mm256_add_ps(lower, upper), half), reach = _mm256_mul_ps(_mm256_sub_ps(upper, lower), half);
        __m256 rounded = _mm256_mul_ps(_mm256_set1_ps(HYI_ULP), _mm256_add_ps(_mm256_andnot_ps(_mm256_set1_ps(-0.0f), middle), reach));
        __m256 to_near = _mm256_fmadd_ps(_mm256_set1_ps(0.25f), bound, _mm256_add_ps(reach, rounded));
        _mm256_storeu_ps(boxes->middle[a], middle);
        _mm256_storeu_ps(boxes->to_near[a], to_near);
        _mm256_storeu_ps(boxes->to_far[a], _mm256_fmadd_ps(_mm256_set1_ps(2.0f), bound, to_near));
    }
}

/* Boxes stay in memory, from where they are broadcast for nothing: gcc would broadcast them once, into 72 vectors on the stack. */
HYI_INLINE void hyi_keep_in_memory_avx512(hyi_centred_avx512 *boxes) {
#if HYI_GNU
    __asm__("" : "+m"(*boxes));
#else
    (void)boxes;
#endif
}

HYI_INLINE HYI_AVX512 void hyi_load_slabs8_avx512(const hyi_flight *flights, const uint32_t list[8], hyi_slabs8_avx512 *s) {
    const char *at[8];
    for (uint32_t i = 0; i < 8u; i++) at[i] = (const char *)flights[list[i]].aim.inverse;
    for (uint32_t word = 0; word < 8u; word += 4u) hyi_four_words_avx2(at, 4u * word, s->words + word);
    for (int a = 0; a < 3; a++) s->size[a] = _mm256_andnot_ps(_mm256_set1_ps(-0.0f), s->words[a]);
}

HYI_INLINE HYI_AVX512 void hyi_load_slabs16_avx512(const hyi_flight *flights, const uint32_t list[16], hyi_slabs16_avx512 *s) {
    const char *at[16];
    for (uint32_t i = 0; i < 16u; i++) at[i] = (const char *)flights[list[i]].aim.inverse;
    for (uint32_t word = 0; word < 8u; word += 4u) hyi_four_words_avx512(at, 4u * word, s->words + word);
    for (int a = 0; a < 3; a++) s->size[a] = _mm512_abs_ps(s->words[a]);
}

/* Who meets the box of child c, and where. */
HYI_INLINE HYI_AVX512 __mmask8 hyi_meet_child8_avx512(const hyi_slabs8_avx512 *s, const hyi_centred_avx512 *boxes, uint32_t c, __m256 *enter) {
    const __m256 *inverse = s->words, *near_offset = inverse + 3;
    __m256 first = s->words[6], last = s->words[7];
    for (int a = 0; a < 3; a++) {
        __m256 middle = _mm256_fmadd_ps(inverse[a], _mm256_set1_ps(boxes->middle[a][c]), near_offset[a]);
        first = _mm256_max_ps(first, _mm256_fnmadd_ps(s->size[a], _mm256_set1_ps(boxes->to_near[a][c]), middle));
        last = _mm256_min_ps(last, _mm256_fmadd_ps(s->size[a], _mm256_set1_ps(boxes->to_far[a][c]), middle));
    }
    *enter = first;
    return _mm256_cmp_ps_mask(first, last, _CMP_LE_OQ);
}

HYI_INLINE HYI_AVX512 __mmask16 hyi_meet_child16_avx512(const hyi_slabs16_avx512 *s, const hyi_centred_avx512 *boxes, uint32_t c, __m512 *enter) {
    const __m512 *inverse = s->words, *near_offset = inverse + 3;
    __m512 first = s->words[6], last = s->words[7];
    for (int a = 0; a < 3; a++) {
        __m512 middle = _mm512_fmadd_ps(inverse[a], _mm512_set1_ps(boxes->middle[a][c]), near_offset[a]);
        first = _mm512_max_ps(first, _mm512_fnmadd_ps(s->size[a], _mm512_set1_ps(boxes->to_near[a][c]), middle));
        last = _mm512_min_ps(last, _mm512_fmadd_ps(s->size[a], _mm512_set1_ps(boxes->to_far[a][c]), middle));
    }
    *enter = first;
    return _mm512_cmp_ps_mask(first, last, _CMP_LE_OQ);
}

/* The least of each. */
HYI_INLINE HYI_AVX512 __m256 hyi_least_of_each_avx512(const __m256 v[8]) {
    __m256 a[4], b[2];
    for (int i = 0; i < 4; i++) a[i] = _mm256_min_ps(_mm256_unpacklo_ps(v[2 * i], v[2 * i + 1]), _mm256_unpackhi_ps(v[2 * i], v[2 * i + 1]));
    for (int i = 0; i < 2; i++) b[i] = _mm256_min_ps(_mm256_shuffle_ps(a[2 * i], a[2 * i + 1], 0x44), _mm256_shuffle_ps(a[2 * i], a[2 * i + 1], 0xee));
    return _mm256_min_ps(_mm256_permute2f128_ps(b[0], b[1], 0x20), _mm256_permute2f128_ps(b[0], b[1], 0x31));
}

/* Deals out a list of flights as far as it makes blocks of sixteen, and returns how far; least: of each child, where rays enter it. */
HYI_INLINE HYI_AVX512 uint32_t hyi_deal_sixteens_avx512(const hyi_flight *flights, hyi_centred_avx512 *boxes, const uint32_t *list, uint32_t count,
                                                        uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], __m256 least[HYI_WIDTH]) {
    __m512 enters[HYI_WIDTH];
    uint32_t first = 0;
    for (uint32_t c = 0; c < HYI_WIDTH; c++) enters[c] = _mm512_set1_ps(FLT_MAX);
    for (; first + 16u <= count; first += 16u) {
        hyi_slabs16_avx512 slabs;
        __m512i items = _mm512_loadu_si512(list + first);
        hyi_keep_in_memory_avx512(boxes);
        hyi_load_slabs16_avx512(flights, list + first, &slabs);
        HYI_UNROLL_8
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            __m512 enter;
            __mmask16 takes = hyi_meet_child16_avx512(&slabs, boxes, c, &enter);
            enters[c] = _mm512_mask_min_ps(enters[c], takes, enters[c], enter);
            _mm512_storeu_si512(lists + (size_t)c * stride + dealt[c], _mm512_maskz_compress_epi32(takes, items));
            dealt[c] += (uint32_t)_mm_popcnt_u32(hyi_bits16_avx512(takes));
        }
    }
    for (uint32_t c = 0; c < HYI_WIDTH; c++) least[c] = _mm256_min_ps(_mm512_castps512_ps256(enters[c]), _mm512_extractf32x8_ps(enters[c], 1));
    return first;
}

/* The same by eights. */
HYI_INLINE HYI_AVX512 uint32_t hyi_deal_eights_avx512(const hyi_flight *flights, hyi_centred_avx512 *boxes, const uint32_t *list, uint32_t first, uint32_t count,
                                                      uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], __m256 least[HYI_WIDTH]) {
    for (; first + 8u <= count; first += 8u) {
        hyi_slabs8_avx512 slabs;
        __m256i items = _mm256_loadu_si256((const __m256i *)(const void *)(list + first));
        hyi_keep_in_memory_avx512(boxes);
        hyi_load_slabs8_avx512(flights, list + first, &slabs);
        HYI_UNROLL_8
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            __m256 enter;
            __mmask8 takes = hyi_meet_child8_avx512(&slabs, boxes, c, &enter);
            least[c] = _mm256_mask_min_ps(least[c], takes, least[c], enter);
            hyi_append_avx512(lists + (size_t)c * stride + dealt[c], items, takes);
            dealt[c] += (uint32_t)_mm_popcnt_u32(hyi_bits8_avx512(takes));
        }
    }
    return first;
}

/* Deals out a list of flights as far as it makes blocks of eight, and returns how far; nearest: as hyi_deal_rays has it. Blocks have the
   bounds of the ray that needs the widest; where that is too much for others, all go by their own. */
HYI_INLINE HYI_AVX512 uint32_t hyi_deal_blocks_avx512(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                                      uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], __m256 *nearest) {
    __m256 least[HYI_WIDTH];
    hyi_centred_avx512 boxes;
    uint32_t first, taken[HYI_WIDTH] = {0}; /* apart from dealt, which lies in memory with the lists */
    if (count < 8u || swarm->thick) return 0;
    hyi_centre_boxes_avx512(swarm, node, &boxes);
    first = hyi_deal_sixteens_avx512(swarm->flights, &boxes, list, count, lists, stride, taken, least);
    first = hyi_deal_eights_avx512(swarm->flights, &boxes, list, first, count, lists, stride, taken, least);
    memcpy(dealt, taken, sizeof taken);
    *nearest = hyi_least_of_each_avx512(least);
    return first;
}

/* ---- corners of a leaf's triangles in the order of the axes of each lane: looked up */

typedef struct hyi_frames_avx512 {
    __m512i place[3]; /* of each axis in hyi_leaf_all_avx512 */
} hyi_frames_avx512;

HYI_INLINE HYI_AVX512 hyi_frames_avx512 hyi_frames_of_avx512(const __m512 axis[3]) {
    hyi_frames_avx512 frames;
    for (int i = 0; i < 3; i++) frames.place[i] = _mm512_slli_epi32(_mm512_castps_si512(axis[i]), 3);
    return frames;
}

/* Of each corner, x of eight triangles, y of eight, and z. */
typedef struct hyi_leaf_all_avx512 {
    __m512 xy[3], z[3];
} hyi_leaf_all_avx512;

HYI_INLINE HYI_AVX512 hyi_leaf_all_avx512 hyi_open_leaf_avx512(const float *rows, uint32_t count) {
    hyi_leaf_all_avx512 leaf;
    for (uint32_t k = 0; k < 3u; k++) {
        const float *row = rows + 3u * k * count;
        leaf.xy[k] = _mm512_insertf32x8(_mm512_castps256_ps512(_mm256_loadu_ps(row)), _mm256_loadu_ps(row + count), 1);
        leaf.z[k] = _mm512_castps256_ps512(_mm256_loadu_ps(row + 2u * count));
    }
    return leaf;
}

HYI_INLINE HYI_AVX512 void hyi_turn_corner_avx512(const hyi_frames_avx512 *frames, const hyi_leaf_all_avx512 *leaf, uint32_t triangle, uint32_t k, __m512 turned[3]) {
    __m512i at = _mm512_set1_epi32((int)triangle);
    for (int i = 0; i < 3; i++) turned[i] = _mm512_permutex2var_ps(leaf->xy[k], _mm512_add_epi32(frames->place[i], at), leaf->z[k]);
}

/* hyi_wait_at_children, without a branch. */
HYI_INLINE HYI_AVX512 void hyi_wait_at_children_avx512(hyi_waiters *w, const hyi_node *node, uint32_t ray, __mmask8 mask, __m256 enter) {
    __m256i child = _mm256_load_si256((const __m256i *)(const void *)node->child), rays = _mm256_set1_epi32((int)ray);
    __mmask8 leaves = (__mmask8)(mask & _mm256_movepi32_mask(child)), nodes = (__mmask8)(mask ^ leaves);
    hyi_append_avx512(w->leaves + w->at_leaves, child, leaves);
    _mm256_storeu_ps(w->enter + w->at_leaves, _mm256_maskz_compress_ps(leaves, enter));
    _mm256_storeu_si256((__m256i *)(void *)(w->leaf_rays + w->at_leaves), rays);
    hyi_append_avx512(w->nodes + w->at_nodes, child, nodes);
    _mm256_storeu_si256((__m256i *)(void *)(w->node_rays + w->at_nodes), rays);
    w->at_leaves += (uint32_t)_mm_popcnt_u32(hyi_bits8_avx512(leaves));
    w->at_nodes += (uint32_t)_mm_popcnt_u32(hyi_bits8_avx512(nodes));
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

/* Two words of two records, size bytes apart. */
HYI_INLINE HYI_AVX512 void hyi_store_pairs_avx512(char *at, uint32_t size, __m128 pairs) {
    _mm_storel_pi((__m64 *)(void *)at, pairs);
    _mm_storeh_pi((__m64 *)(void *)(at + size), pairs);
}

/* hyi_records: four words of all at a time, transposed four by four; then two, and one. */
HYI_INLINE HYI_AVX512 void hyi_records_avx512(float rows[HYI_RECORD_WORDS][HYI_PACKET_WIDTH], uint32_t words, char *out) {
    uint32_t size = 4u * words, word = 0;
    for (; word + 4u <= words; word += 4u) {
        __m512 a = _mm512_loadu_ps(rows[word]), b = _mm512_loadu_ps(rows[word + 1u]), c = _mm512_loadu_ps(rows[word + 2u]), d = _mm512_loadu_ps(rows[word + 3u]);
        __m512d low01 = _mm512_castps_pd(_mm512_unpacklo_ps(a, b)), high01 = _mm512_castps_pd(_mm512_unpackhi_ps(a, b));
        __m512d low23 = _mm512_castps_pd(_mm512_unpacklo_ps(c, d)), high23 = _mm512_castps_pd(_mm512_unpackhi_ps(c, d));
        const __m512d quads[4] = {_mm512_unpacklo_pd(low01, low23), _mm512_unpackhi_pd(low01, low23), _mm512_unpacklo_pd(high01, high23), _mm512_unpackhi_pd(high01, high23)};
        for (uint32_t k = 0; k < 4u; k++) {
            float *at = (float *)(void *)(out + k * size + 4u * word);
            _mm_storeu_ps(at, _mm512_extractf32x4_ps(_mm512_castpd_ps(quads[k]), 0));
            _mm_storeu_ps(at + 4u * words, _mm512_extractf32x4_ps(_mm512_castpd_ps(quads[k]), 1));
            _mm_storeu_ps(at + 8u * words, _mm512_extractf32x4_ps(_mm512_castpd_ps(quads[k]), 2));
            _mm_storeu_ps(at + 12u * words, _mm512_extractf32x4_ps(_mm512_castpd_ps(quads[k]), 3));
        }
    }
    for (; word + 2u <= words; word += 2u) {
        __m512 a = _mm512_loadu_ps(rows[word]), b = _mm512_loadu_ps(rows[word + 1u]);
        const __m512 pairs[2] = {_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b)};
        for (uint32_t k = 0; k < 2u; k++) {
            char *at = out + 2u * k * size + 4u * word;
            hyi_store_pairs_avx512(at, size, _mm512_extractf32x4_ps(pairs[k], 0));
            hyi_store_pairs_avx512(at + 4u * size, size, _mm512_extractf32x4_ps(pairs[k], 1));
            hyi_store_pairs_avx512(at + 8u * size, size, _mm512_extractf32x4_ps(pairs[k], 2));
            hyi_store_pairs_avx512(at + 12u * size, size, _mm512_extractf32x4_ps(pairs[k], 3));
        }
    }
    for (uint32_t i = 0; i < 16u && word < words; i++) memcpy(out + i * size + 4u * word, &rows[word][i], 4);
}

#define HYI_TARGET HYI_AVX512
#define HYI_RECORDS(rows, words, out) hyi_records_avx512(rows, words, out)
#define HYI_RAY_WORDS(rays, words) hyi_ray_words_avx512(rays, words)
#define HYI_LINES(rows, lines) hyi_lines_avx512(rows, lines)
#define HYI_FOUR_WORDS(at, offset, rows) hyi_four_words_avx512(at, offset, rows)
#define HYI_I(name) name##_avx512
#define HYI_F8 __m256
#define HYI_ALWAYS_EXACT 0
#define HYI_EXACT_ALONE 0
#define HYI_PUSH_SEVERAL(stack, node, enter, mask, ahead) hyi_push_several_avx2(stack, node, enter, mask, ahead)
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
#define HYI_PAIRS true
#define HYI_LANES 16u
#define HYI_ALLW 0xffffu
#define HYI_FW __m512
#define HYI_MW __mmask16
#define HYI_LOADW(p) _mm512_loadu_ps(p)
#define HYI_SETW(value) _mm512_set1_ps(value)
#define HYI_ZEROW() _mm512_setzero_ps()
#define HYI_SUBW(a, b) _mm512_sub_ps(a, b)
#define HYI_MULW(a, b) _mm512_mul_ps(a, b)
#define HYI_MADW(a, b, c) _mm512_fmadd_ps(a, b, c)
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
#define HYI_DEAL_BLOCKS(swarm, node, list, count, lists, stride, dealt, nearest) \
    hyi_deal_blocks_avx512(swarm, node, list, count, lists, stride, dealt, nearest)
#define HYI_WAIT_AT_CHILDREN(waiters, node, ray, mask, enter) hyi_wait_at_children_avx512(waiters, node, ray, mask, enter)

#define HYI_STOREW(p, a) _mm512_storeu_ps(p, a)
#define HYI_ADDW(a, b) _mm512_add_ps(a, b)
#define HYI_DIVW(a, b) _mm512_div_ps(a, b)
#define HYI_LEW(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define HYI_LEASTW(a) _mm512_reduce_min_ps(a)
#define HYI_FD __m512d
#define HYI_SETD(value) _mm512_set1_pd(value)
#define HYI_LOADH(p, half) _mm512_cvtps_pd(_mm256_loadu_ps((p) + 8 * (half)))
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
#include "leaf_body.inc.h"
#include "stream_body.inc.h"
#include "lanes_end.inc.h"
#undef HYI_UNROLL_8

#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#endif /* HYI_X86 */
#endif /* HYI_BVH_AVX512_H */
