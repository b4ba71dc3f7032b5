/* >>bvh-build-units: triangles in Morton order merged to leaves, for quick builds

   As in Meister, Bittner 2018, "Parallel locally-ordered clustering for bounding volume hierarchy construction", neighbours
   on the curve that are each other's best partner merge, until no merge makes the tree cheaper. What they end as is a unit,
   which no cut takes apart again: the tree above is cut top down over units, a third as many as triangles or fewer. */
#ifndef HYI_BVH_BUILD_UNITS_H
#define HYI_BVH_BUILD_UNITS_H

#include "build_sort.h"

/* Expected cost of a unit that rays enter, as a leaf's in bvh-build-cost, and what a place in a node is worth. More for the
   place makes larger units, which are quicker to build over and slower for rays. */
#define HYI_UNIT_VISIT 1.0f
#define HYI_UNIT_TRIANGLE 0.05f
#define HYI_UNIT_PLACE 0.16f
#define HYI_MERGE_FEW 64u /* passes end when one has merged less than this part of the units */

/* A unit is a reference whose id is its first place in the order, and lane 3 of upper its number of triangles. */
HYI_INLINE uint32_t hyi_unit_count(const hyi_ref *unit) {
    uint32_t bits;
    memcpy(&bits, &unit->upper[3], sizeof bits);
    return bits & ~HYI_REF_ID_BITS;
}

HYI_INLINE void hyi_unit_set(hyi_ref *unit, const hyi_bounds *box, uint32_t first, uint32_t count) {
    uint32_t bits = count | HYI_REF_ID_BITS;
    hyi_ref_set(unit, box, first);
    memcpy(&unit->upper[3], &bits, sizeof bits);
}

HYI_INLINE float hyi_unit_cost(const hyi_bounds *box, uint32_t count) {
    return hyi_bounds_area(box) * (HYI_UNIT_VISIT + HYI_UNIT_TRIANGLE * (float)count);
}

/* What merging each unit with the next one adds to the cost of the tree; FLT_MAX: that makes too large a unit, or there is
   no next. Nothing of a pass depends on the merges of the same pass, and no branch on the losses. */
HYI_FN void hyi_merge_losses(const hyi_ref *units, uint32_t count, uint32_t most, float *losses) {
    hyi_bounds box = hyi_ref_box(&units[0]);
    uint32_t triangles = hyi_unit_count(&units[0]);
    float cost = hyi_unit_cost(&box, triangles);
    for (uint32_t i = 0; i + 1u < count; i++) {
        hyi_bounds next = hyi_ref_box(&units[i + 1u]);
        uint32_t more = hyi_unit_count(&units[i + 1u]), all = triangles + more;
        hyi_bounds_add(&box, next.lower, next.upper);
        float merged = hyi_bounds_area(&box) * (HYI_UNIT_VISIT - HYI_UNIT_PLACE + HYI_UNIT_TRIANGLE * (float)all);
        float alone = hyi_unit_cost(&next, more);
        losses[i] = all <= most ? merged - cost - alone : FLT_MAX;
        box = next;
        triangles = more;
        cost = alone;
    }
    losses[count - 1u] = FLT_MAX;
}

/* Merges each pair of neighbours that no other neighbour suits better; returns how many units are left. losses: room. */
HYI_FN uint32_t hyi_merge_pass(hyi_ref *units, uint32_t count, uint32_t most, float *losses) {
    uint32_t left = 0, taken = 0; /* taken: 1: the unit before has this one in it */
    float before = FLT_MAX;
    hyi_merge_losses(units, count, most, losses);
    for (uint32_t i = 0; i < count; i++) {
        float here = losses[i], after = losses[i + 1u < count ? i + 1u : i];
        uint32_t merges = (uint32_t)(here < 0.0f) & (uint32_t)(here < before) & (uint32_t)(here <= after);
        const hyi_ref *unit = &units[i], *other = unit + merges;
        hyi_bounds box = hyi_ref_box(unit), next = hyi_ref_box(other);
        uint32_t triangles = hyi_unit_count(unit) + merges * hyi_unit_count(other);
        hyi_bounds_add(&box, next.lower, next.upper);
        hyi_unit_set(&units[left], &box, hyi_ref_id(unit), triangles);
        left += 1u - taken; /* what was written of one that is taken, the next one replaces */
        taken = merges;
        before = here;
    }
    return left;
}

/* ---- pieces, each by itself */

typedef struct hyi_units {
    hyi_build *build;
    const uint64_t *keys;
} hyi_units;

HYI_FN void hyi_merge_chunk(void *argument, uint32_t chunk) {
    hyi_units *units = (hyi_units *)argument;
    hyi_build *build = units->build;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, build->primitive_count), count = end - begin, before;
    hyi_ref *room = build->other + begin;
    float losses[HYI_BUILD_CHUNK];
    for (uint32_t i = begin; i < end; i++) {
        const hyi_ref *ref = &build->refs[(uint32_t)units->keys[i]];
        hyi_bounds box = hyi_ref_box(ref);
        build->order[i] = hyi_ref_id(ref);
        hyi_unit_set(&build->other[i], &box, i, 1);
    }
    do {
        before = count;
        count = hyi_merge_pass(room, count, build->leaf_max, losses);
    } while (count < before - before / HYI_MERGE_FEW);
    build->chunks[chunk].kept = count;
}

/* Brings units together; measures them. */
HYI_FN void hyi_gather_chunk(void *argument, uint32_t chunk) {
    hyi_build *build = (hyi_build *)argument;
    hyi_chunk_sum *sum = &build->chunks[chunk];
    const hyi_ref *from = build->other + chunk * HYI_BUILD_CHUNK;
    hyi_bounds centroids = hyi_bounds_empty();
    memcpy(build->refs + sum->first, from, sum->kept * sizeof *from);
    for (uint32_t i = 0; i < sum->kept; i++) {
        hyi_bounds box = hyi_ref_box(&from[i]);
        hyi_four centroid = hyi_centroid(&box);
        hyi_bounds_add(&centroids, centroid, centroid);
    }
    sum->centroids = centroids;
}

HYI_FN void hyi_make_units(hyi_build *build, const uint64_t *keys) {
    hyi_units units = {build, keys};
    uint32_t chunks = hyi_chunks_of(build->primitive_count);
    hyi_parallel(build->context, chunks, hyi_merge_chunk, &units);
    build->ref_count = 0;
    for (uint32_t c = 0; c < chunks; c++) {
        build->chunks[c].first = build->ref_count;
        build->ref_count += build->chunks[c].kept;
    }
    hyi_parallel(build->context, chunks, hyi_gather_chunk, build);
    build->root_centroids = hyi_bounds_empty();
    for (uint32_t c = 0; c < chunks; c++)
        hyi_bounds_add(&build->root_centroids, build->chunks[c].centroids.lower, build->chunks[c].centroids.upper);
}

/* References become units. */
HYI_FN hydra_result hyi_build_units(hyi_build *build) {
    hyi_sort sort;
    uint64_t *keys;
    uint32_t count = build->primitive_count = build->ref_count;
    sort.build = build;
    sort.count = count;
    sort.pieces = hyi_chunks_of(count) < HYI_SORT_PIECES ? hyi_chunks_of(count) : HYI_SORT_PIECES;
    HYI_TRY(hyi_alloc_array(build->context, &build->order, count));
    HYI_TRY(hyi_alloc_array(build->context, &build->other, build->capacity));
    HYI_TRY(hyi_alloc_array(build->context, &keys, 2u * (size_t)count + sort.pieces * HYI_DIGITS / 2u));
    sort.keys = keys;
    sort.other = keys + count;
    sort.counts = (uint32_t *)(void *)(keys + 2u * (size_t)count);
    hyi_make_curve(&build->root_centroids, &sort.curve);
    hyi_parallel(build->context, sort.pieces, hyi_make_keys, &sort);
    hyi_sort_keys(&sort);
    hyi_make_units(build, sort.keys);
    hyi_free_array(build->context, &keys, 2u * (size_t)count + sort.pieces * HYI_DIGITS / 2u);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_UNITS_H */
