/* >>bvh-build-sort: references in Morton order

   Neighbours on a space-filling curve are neighbours in space. Bits of the code go to the axis whose cells are longest
   (Vinkler, Bittner, Havran 2017, "Extended Morton codes for high performance bounding volume hierarchy construction",
   section 4.1), so flat scenes get cells as cubic as others do. The sort is stable: the same order for any pieces. */
#ifndef HYI_BVH_BUILD_SORT_H
#define HYI_BVH_BUILD_SORT_H

#include "build_refs.h"

#define HYI_CODE_BITS 32u
#define HYI_AXIS_BITS 16u
#define HYI_DIGIT_BITS 8u
#define HYI_DIGITS (1u << HYI_DIGIT_BITS)

/* How doubled centroids map to codes: cells of each axis by two tables, of the low and of the high byte of the cell. */
typedef struct hyi_curve {
    hyi_four origin, scale, last;
    uint32_t low[3][256], high[3][256];
} hyi_curve;

typedef struct hyi_sort {
    hyi_build *build;
    hyi_curve curve;
    uint64_t *keys, *other; /* code, and below it the reference */
    uint32_t *counts;       /* of the digits, by piece; then where they go */
    uint32_t count, pieces, shift;
} hyi_sort;

/* Which axis each bit of the code belongs to, from the highest down; returns the bits of each. */
HYI_FN void hyi_share_bits(const float *extent, uint8_t axis_of[HYI_CODE_BITS], uint32_t bits[3]) {
    float cell[3] = {extent[0], extent[1], extent[2]};
    bits[0] = bits[1] = bits[2] = 0;
    for (uint32_t i = 0; i < HYI_CODE_BITS; i++) {
        uint8_t longest = 0;
        for (uint8_t a = 1; a < 3; a++) {
            if (bits[longest] == HYI_AXIS_BITS || (cell[a] > cell[longest] && bits[a] < HYI_AXIS_BITS)) longest = a;
        }
        axis_of[i] = longest;
        cell[longest] *= 0.5f;
        bits[longest]++;
    }
}

HYI_FN void hyi_make_curve(const hyi_bounds *centroids, hyi_curve *curve) {
    float extent[4], scale[4] = {0.0f, 0.0f, 0.0f, 0.0f}, last[4] = {0.0f, 0.0f, 0.0f, 0.0f};
    uint8_t axis_of[HYI_CODE_BITS];
    uint32_t bits[3], place[3][HYI_AXIS_BITS], filled[3] = {0, 0, 0};
    hyi_four_store(extent, hyi_four_sub(centroids->upper, centroids->lower));
    hyi_share_bits(extent, axis_of, bits);
    for (uint32_t i = HYI_CODE_BITS; i-- > 0;) place[axis_of[i]][filled[axis_of[i]]++] = HYI_CODE_BITS - 1u - i;
    memset(curve->low, 0, sizeof curve->low);
    memset(curve->high, 0, sizeof curve->high);
    for (int a = 0; a < 3; a++) {
        if (extent[a] > 1.0e-30f) scale[a] = (float)(1u << bits[a]) / extent[a];
        last[a] = (float)((1u << bits[a]) - 1u);
        for (uint32_t cell = 0; cell < 256u; cell++) {
            for (uint32_t b = 0; b < bits[a]; b++) {
                if (b < 8u) curve->low[a][cell] |= (cell >> b & 1u) << place[a][b];
                else curve->high[a][cell] |= (cell >> (b - 8u) & 1u) << place[a][b];
            }
        }
    }
    curve->origin = centroids->lower;
    curve->scale = hyi_four_load(scale);
    curve->last = hyi_four_load(last);
}

HYI_INLINE uint32_t hyi_code_of(const hyi_curve *curve, hyi_four centroid) {
    hyi_four at = hyi_four_rounded(hyi_four_mul(hyi_four_rounded(hyi_four_sub(centroid, curve->origin)), curve->scale));
    int32_t cell[4];
    uint32_t code = 0;
    hyi_four_truncate(hyi_four_min(hyi_four_max(at, hyi_four_all(0.0f)), curve->last), cell);
    for (int a = 0; a < 3; a++) code |= curve->low[a][cell[a] & 255] | curve->high[a][cell[a] >> 8 & 255];
    return code;
}

/* ---- pieces */

#define HYI_SORT_PIECES 64u
#define HYI_SORT_PIECE 8192u /* the least keys of a piece: with fewer, threads wait for each other longer than they work */
HYI_STATIC_ASSERT(HYI_SORT_PIECES * HYI_DIGITS * sizeof(uint32_t) <= HYI_KEY_COUNTS * sizeof(uint64_t));

HYI_INLINE uint32_t hyi_piece_begin(const hyi_sort *sort, uint32_t piece) {
    return (uint32_t)((uint64_t)sort->count * piece / sort->pieces);
}

/* References of a chunk lie where its part of the source does, without gaps; keys have none at all. */
HYI_FN void hyi_make_keys(void *argument, uint32_t index) {
    hyi_sort *sort = (hyi_sort *)argument;
    const hyi_chunk_sum *chunk = &sort->build->chunks[index];
    for (uint32_t i = 0; i < chunk->kept; i++) {
        uint32_t at = index * HYI_BUILD_CHUNK + i;
        hyi_bounds box = hyi_ref_box(&sort->build->refs[at]);
        sort->keys[chunk->first + i] = (uint64_t)hyi_code_of(&sort->curve, hyi_centroid(&box)) << 32 | at;
    }
}

HYI_FN void hyi_count_digits(void *argument, uint32_t piece) {
    hyi_sort *sort = (hyi_sort *)argument;
    uint32_t counts[HYI_DIGITS], end = hyi_piece_begin(sort, piece + 1u);
    memset(counts, 0, sizeof counts);
    for (uint32_t i = hyi_piece_begin(sort, piece); i < end; i++) counts[sort->keys[i] >> sort->shift & (HYI_DIGITS - 1u)]++;
    memcpy(sort->counts + (size_t)piece * HYI_DIGITS, counts, sizeof counts);
}

/* Counts become places: digit by digit, and within one piece by piece. */
HYI_FN void hyi_place_digits(hyi_sort *sort) {
    uint32_t next = 0;
    for (uint32_t digit = 0; digit < HYI_DIGITS; digit++) {
        for (uint32_t piece = 0; piece < sort->pieces; piece++) {
            uint32_t *place = &sort->counts[(size_t)piece * HYI_DIGITS + digit], count = *place;
            *place = next;
            next += count;
        }
    }
}

HYI_FN void hyi_scatter_digits(void *argument, uint32_t piece) {
    hyi_sort *sort = (hyi_sort *)argument;
    uint32_t places[HYI_DIGITS], end = hyi_piece_begin(sort, piece + 1u);
    memcpy(places, sort->counts + (size_t)piece * HYI_DIGITS, sizeof places);
    for (uint32_t i = hyi_piece_begin(sort, piece); i < end; i++) {
        uint64_t key = sort->keys[i];
        sort->other[places[key >> sort->shift & (HYI_DIGITS - 1u)]++] = key;
    }
}

/* An even number of passes: the result is where the keys were. */
HYI_FN void hyi_sort_keys(hyi_sort *sort) {
    const hydra_context *context = sort->build->context;
    for (sort->shift = 32u; sort->shift < 64u; sort->shift += HYI_DIGIT_BITS) {
        uint64_t *keys = sort->keys;
        hyi_parallel(context, sort->pieces, hyi_count_digits, sort);
        hyi_place_digits(sort);
        hyi_parallel(context, sort->pieces, hyi_scatter_digits, sort);
        sort->keys = sort->other;
        sort->other = keys;
    }
}

#endif /* HYI_BVH_BUILD_SORT_H */
