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

/* Units of a piece while they merge: boxes with the places of the first triangle and behind the last in lane 3, as floats, so
   that minima and maxima of all four lanes are the union; the same as rows; and what each costs, whether it merges with the
   next one, and what that adds to the cost of the tree, with one before the first. */
#define HYI_UNIT_ROOM (HYI_PIECE + 8u)
typedef struct hyi_units {
    hyi_ref *refs; /* in lane 3 of lower and upper: the first triangle of the part of the order, and the one after the last */
    float rows[8][HYI_UNIT_ROOM];
    float costs[HYI_UNIT_ROOM], losses[HYI_UNIT_ROOM];
    int32_t merges[HYI_UNIT_ROOM];
    uint32_t count;
} hyi_units;
#define HYI_LOSS_FIRST 4u

/* Half of the surface of four boxes. */
HYI_INLINE hyi_four hyi_four_surface(hyi_four x, hyi_four y, hyi_four z) {
    return hyi_four_add(hyi_four_mul(x, hyi_four_add(y, z)), hyi_four_mul(y, z));
}

HYI_FN void hyi_spread_units(hyi_units *u) {
    const hyi_four visit = hyi_four_all(HYI_UNIT_VISIT), each = hyi_four_all(HYI_UNIT_TRIANGLE);
    for (uint32_t i = 0; i < u->count; i += 4u) {
        hyi_four rows[8], size[4];
        for (uint32_t k = 0; k < 4; k++) {
            const hyi_ref *ref = &u->refs[i + k < u->count ? i + k : i];
            rows[k] = hyi_four_load(ref->lower);
            rows[4u + k] = hyi_four_load(ref->upper);
        }
        hyi_four_transpose(rows);
        hyi_four_transpose(rows + 4);
        for (uint32_t r = 0; r < 8; r++) hyi_four_store(&u->rows[r][i], rows[r]);
        for (uint32_t r = 0; r < 4; r++) size[r] = hyi_four_sub(rows[4u + r], rows[r]);
        hyi_four_store(&u->costs[i], hyi_four_mul(hyi_four_surface(size[0], size[1], size[2]), hyi_four_add(visit, hyi_four_mul(each, size[3]))));
    }
}

/* What merging each unit with the next one adds to the cost of the tree; FLT_MAX: that makes too large a unit, or there is
   no next. Nothing of a pass depends on the merges of the same pass, and no branch on the losses. */
HYI_FN void hyi_weigh_merges(hyi_units *u, uint32_t most) {
    const hyi_four visit = hyi_four_all(HYI_UNIT_VISIT - HYI_UNIT_PLACE), each = hyi_four_all(HYI_UNIT_TRIANGLE);
    const hyi_four limit = hyi_four_all((float)most), never = hyi_four_all(FLT_MAX);
    float *losses = u->losses + HYI_LOSS_FIRST;
    for (uint32_t i = 0; i < u->count; i += 4u) {
        hyi_four size[4];
        for (uint32_t r = 0; r < 4; r++) {
            hyi_four upper = hyi_four_max(hyi_four_load(&u->rows[4u + r][i]), hyi_four_load(&u->rows[4u + r][i + 1u]));
            size[r] = hyi_four_sub(upper, hyi_four_min(hyi_four_load(&u->rows[r][i]), hyi_four_load(&u->rows[r][i + 1u])));
        }
        hyi_four merged = hyi_four_mul(hyi_four_surface(size[0], size[1], size[2]), hyi_four_add(visit, hyi_four_mul(each, size[3])));
        hyi_four loss = hyi_four_sub(hyi_four_sub(merged, hyi_four_load(&u->costs[i])), hyi_four_load(&u->costs[i + 1u]));
        hyi_four_store(&losses[i], hyi_four_pick_less(limit, size[3], never, loss));
    }
    u->losses[HYI_LOSS_FIRST - 1u] = losses[u->count - 1u] = losses[u->count] = FLT_MAX;
}

/* A unit merges with the next one where no other neighbour suits either better. */
HYI_FN void hyi_choose_merges(hyi_units *u) {
    const hyi_four none = hyi_four_all(0.0f);
    const float *losses = u->losses + HYI_LOSS_FIRST;
    for (uint32_t i = 0; i < u->count; i += 4u) {
        hyi_four here = hyi_four_load(&losses[i]), merges = hyi_four_pick_less(here, none, hyi_four_all(1.0f), none);
        merges = hyi_four_pick_less(here, hyi_four_load(u->losses + HYI_LOSS_FIRST - 1u + i), merges, none);
        merges = hyi_four_pick_less(hyi_four_load(&losses[i + 1u]), here, none, merges);
        hyi_four_truncate(merges, &u->merges[i]);
    }
}

HYI_FN void hyi_merge_units(hyi_units *u) {
    uint32_t left = 0;
    int32_t taken = 0; /* 1: the unit before has this one in it */
    for (uint32_t i = 0; i < u->count; i++) {
        const hyi_ref *unit = &u->refs[i], *other = unit + u->merges[i];
        hyi_bounds box = hyi_ref_box(unit), next = hyi_ref_box(other);
        hyi_bounds_add(&box, next.lower, next.upper);
        hyi_four_store(u->refs[left].lower, box.lower);
        hyi_four_store(u->refs[left].upper, box.upper);
        left += 1u - (uint32_t)taken; /* what was written of one that is taken, the next one replaces */
        taken = u->merges[i];
    }
    u->count = left;
}

/* The triangles of a part of the order, a unit each. */
HYI_FN void hyi_begin_units(const hyi_build *build, uint32_t begin, hyi_units *u) {
    for (uint32_t i = 0; i < u->count; i++) {
        const hyi_ref *ref = &build->refs[(uint32_t)build->keys[begin + i]];
        build->order[begin + i] = hyi_ref_id(ref);
        u->refs[i] = *ref;
        u->refs[i].lower[3] = (float)i;
        u->refs[i].upper[3] = (float)(i + 1u);
    }
}

/* Triangles of a part of the order become units; returns how many. Of more than most nothing is kept. */
HYI_NOINLINE uint32_t hyi_make_units(hyi_build *build, uint32_t begin, uint32_t count, hyi_ref *to, uint32_t most) {
    hyi_ref refs[HYI_PIECE];
    hyi_units u;
    uint32_t before;
    u.refs = refs;
    u.count = count;
    hyi_begin_units(build, begin, &u);
    do {
        before = u.count;
        hyi_spread_units(&u);
        hyi_weigh_merges(&u, build->leaf_max);
        hyi_choose_merges(&u);
        hyi_merge_units(&u);
    } while (u.count < before - before / HYI_MERGE_FEW);
    for (uint32_t i = 0; i < u.count && u.count <= most; i++) {
        hyi_bounds box = hyi_ref_box(&refs[i]);
        uint32_t first = (uint32_t)refs[i].lower[3], end = (uint32_t)refs[i].upper[3];
        hyi_unit_set(&to[i], &box, begin + first, end - first);
    }
    return u.count;
}

#endif /* HYI_BVH_BUILD_UNITS_H */
