/* >>bvh-build-sort: references in Morton order

   Neighbours on a space-filling curve are neighbours in space. Bits of the code go to the axis whose cells are longest
   (Vinkler, Bittner, Havran 2017, "Extended Morton codes for high performance bounding volume hierarchy construction",
   section 4.1), so flat scenes get cells as cubic as others do. The sort is stable: the same order for any pieces. */
#ifndef HYI_BVH_BUILD_SORT_H
#define HYI_BVH_BUILD_SORT_H

#include "build_refs.h"

#define HYI_AXIS_BITS 16u

/* How doubled centroids map to codes: cells of each axis by two tables, of the low and of the high byte of the cell. */
typedef struct hyi_curve {
    hyi_four origin, scale, last;
    uint32_t low[3][256], high[3][256];
} hyi_curve;

typedef struct hyi_sort {
    hyi_build *build;
    hyi_curve curve;
    hyi_sort_shape shape;
    uint64_t *keys, *other; /* code, and below it the reference */
    uint32_t *counts;       /* of the digits, by piece; then where they go */
    uint32_t shift;
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
    for (int a = 0; a < 3; a++) {
        if (extent[a] > 1.0e-30f) scale[a] = (float)(1u << bits[a]) / extent[a];
        last[a] = (float)((1u << bits[a]) - 1u);
        curve->low[a][0] = curve->high[a][0] = 0u;
        for (uint32_t cell = 1; cell < 256u; cell++) { /* a bit more than a cell before */
            uint32_t rest = cell & (cell - 1u), bit = hyi_lowest_bit(cell);
            curve->low[a][cell] = curve->low[a][rest] | (bit < bits[a] ? 1u << place[a][bit] : 0u);
            curve->high[a][cell] = curve->high[a][rest] | (bit + 8u < bits[a] ? 1u << place[a][bit + 8u] : 0u);
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

/* ---- pieces: some chunks each */

HYI_INLINE uint32_t hyi_sort_chunk(const hyi_sort *sort, uint32_t piece) {
    return (uint32_t)((uint64_t)sort->build->chunk_count * piece / sort->shape.pieces);
}

HYI_INLINE uint32_t hyi_sort_begin(const hyi_sort *sort, uint32_t piece) {
    return piece < sort->shape.pieces ? sort->build->chunks[hyi_sort_chunk(sort, piece)].first : sort->build->ref_count;
}

HYI_INLINE uint32_t hyi_digit_of(const hyi_sort *sort, uint64_t key) { return (uint32_t)(key >> sort->shift) & (sort->shape.digits - 1u); }

HYI_INLINE uint32_t *hyi_digit_counts(const hyi_sort *sort, uint32_t piece) { return sort->counts + (size_t)piece * sort->shape.digits; }

/* References of a chunk lie where its part of the source does, without gaps; keys have none at all. Counts the first digits. */
HYI_FN void hyi_make_keys(void *argument, uint32_t piece) {
    hyi_sort *sort = (hyi_sort *)argument;
    uint32_t *counts = hyi_digit_counts(sort, piece);
    memset(counts, 0, sort->shape.digits * sizeof *counts);
    for (uint32_t c = hyi_sort_chunk(sort, piece); c < hyi_sort_chunk(sort, piece + 1u); c++) {
        const hyi_chunk_sum *chunk = &sort->build->chunks[c];
        for (uint32_t i = 0; i < chunk->kept; i++) {
            uint32_t at = c * HYI_BUILD_CHUNK + i;
            hyi_bounds box = hyi_ref_box(&sort->build->refs[at]);
            uint64_t key = (uint64_t)hyi_code_of(&sort->curve, hyi_centroid(&box)) << 32 | at;
            sort->keys[chunk->first + i] = key;
            counts[hyi_digit_of(sort, key)]++;
        }
    }
}

HYI_FN void hyi_count_digits(void *argument, uint32_t piece) {
    hyi_sort *sort = (hyi_sort *)argument;
    uint32_t *counts = hyi_digit_counts(sort, piece), end = hyi_sort_begin(sort, piece + 1u);
    memset(counts, 0, sort->shape.digits * sizeof *counts);
    for (uint32_t i = hyi_sort_begin(sort, piece); i < end; i++) counts[hyi_digit_of(sort, sort->keys[i])]++;
}

/* Counts become places: digit by digit, and within one piece by piece. */
HYI_FN void hyi_place_digits(hyi_sort *sort) {
    uint32_t next = 0;
    for (uint32_t digit = 0; digit < sort->shape.digits; digit++) {
        for (uint32_t piece = 0; piece < sort->shape.pieces; piece++) {
            uint32_t *place = hyi_digit_counts(sort, piece) + digit, count = *place;
            *place = next;
            next += count;
        }
    }
}

HYI_FN void hyi_scatter_digits(void *argument, uint32_t piece) {
    hyi_sort *sort = (hyi_sort *)argument;
    uint32_t *places = hyi_digit_counts(sort, piece), end = hyi_sort_begin(sort, piece + 1u);
    for (uint32_t i = hyi_sort_begin(sort, piece); i < end; i++) {
        uint64_t key = sort->keys[i];
        sort->other[places[hyi_digit_of(sort, key)]++] = key;
    }
}

/* Begins where the last pass brings the keys to where the build has them. */
HYI_FN void hyi_sort_refs(hyi_build *build) {
    hyi_sort sort;
    sort.build = build;
    sort.shape = hyi_shape_of_sort(build);
    uint64_t *second = (uint64_t *)(void *)build->units;
    sort.keys = sort.shape.passes % 2u ? second : build->keys;
    sort.other = sort.shape.passes % 2u ? build->keys : second;
    sort.counts = (uint32_t *)(void *)(second + build->ref_count);
    sort.shift = 32u;
    hyi_make_curve(&build->root_centroids, &sort.curve);
    hyi_parallel(build->context, sort.shape.pieces, hyi_make_keys, &sort);
    for (uint32_t pass = 0; pass < sort.shape.passes; pass++, sort.shift += sort.shape.digit_bits) {
        uint64_t *keys = sort.keys;
        if (pass > 0) hyi_parallel(build->context, sort.shape.pieces, hyi_count_digits, &sort);
        hyi_place_digits(&sort);
        hyi_parallel(build->context, sort.shape.pieces, hyi_scatter_digits, &sort);
        sort.keys = sort.other;
        sort.other = keys;
    }
}

#endif /* HYI_BVH_BUILD_SORT_H */
