/* >>bvh-build-units: triangles in Morton order merged to leaves, for quick builds

   As in Meister, Bittner 2018, "Parallel locally-ordered clustering for bounding volume hierarchy construction", neighbours
   on the curve that are each other's best partner merge, until no merge makes the tree cheaper. What they end as is a unit:
   a leaf of the binary tree, of which there are a third as many as triangles or fewer. */
#ifndef HYI_BVH_BUILD_UNITS_H
#define HYI_BVH_BUILD_UNITS_H

#include "build_sort.h"

/* Expected cost of a unit that rays enter, as a leaf's in bvh-build-cost, and what a place in a node is worth. More for the
   place makes larger units, which are quicker to build over and slower for rays. */
#define HYI_UNIT_VISIT 1.0f
#define HYI_UNIT_TRIANGLE 0.05f
#define HYI_UNIT_PLACE 0.16f
#define HYI_MERGE_FEW 8u /* passes end when one has merged less than this part of the units */

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

/* Triangles of a part of the order become units, in the same places of other; returns how many. */
HYI_FN uint32_t hyi_make_units(hyi_build *build, uint32_t begin, uint32_t count) {
    hyi_ref *units = build->other + begin;
    float losses[HYI_PIECE];
    uint32_t before, left = count;
    for (uint32_t i = 0; i < count; i++) {
        const hyi_ref *ref = &build->refs[(uint32_t)build->keys[begin + i]];
        hyi_bounds box = hyi_ref_box(ref);
        build->order[begin + i] = hyi_ref_id(ref);
        hyi_unit_set(&units[i], &box, begin + i, 1);
    }
    do {
        before = left;
        left = hyi_merge_pass(units, left, build->leaf_max, losses);
    } while (left < before - before / HYI_MERGE_FEW);
    return left;
}

#endif /* HYI_BVH_BUILD_UNITS_H */
