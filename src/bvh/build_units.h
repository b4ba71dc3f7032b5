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

/* A unit on its way through a pass. */
typedef struct hyi_walker {
    hyi_bounds box;
    uint32_t first, count;
    float cost;
} hyi_walker;

HYI_INLINE hyi_walker hyi_take_unit(const hyi_ref *unit) {
    hyi_walker w;
    w.box = hyi_ref_box(unit);
    w.first = hyi_ref_id(unit);
    w.count = hyi_unit_count(unit);
    w.cost = hyi_unit_cost(&w.box, w.count);
    return w;
}

/* What merging two neighbours adds to the cost of the tree. */
HYI_INLINE float hyi_merge_loss(const hyi_walker *a, const hyi_walker *b, uint32_t most) {
    hyi_bounds box = a->box;
    uint32_t count = a->count + b->count;
    if (count > most) return FLT_MAX;
    hyi_bounds_add(&box, b->box.lower, b->box.upper);
    float area = hyi_bounds_area(&box);
    return area * (HYI_UNIT_VISIT - HYI_UNIT_PLACE + HYI_UNIT_TRIANGLE * (float)count) - a->cost - b->cost;
}

/* Three neighbours, and what merging each with the next would lose; FLT_MAX: there is no next. */
typedef struct hyi_merge {
    const hyi_ref *units;
    uint32_t count, at, most; /* most: triangles of a unit */
    hyi_walker a, b, c;
    float before, here, after;
} hyi_merge;

HYI_INLINE float hyi_look_ahead(const hyi_merge *merge, uint32_t ahead, const hyi_walker *from, hyi_walker *to) {
    if (merge->at + ahead >= merge->count) return FLT_MAX;
    *to = hyi_take_unit(&merge->units[merge->at + ahead]);
    return hyi_merge_loss(from, to, merge->most);
}

/* Merges each pair of neighbours that no other neighbour suits better; returns how many units are left. */
HYI_FN uint32_t hyi_merge_pass(hyi_ref *units, uint32_t count, uint32_t most) {
    hyi_merge m;
    uint32_t left = 0;
    m.units = units;
    m.count = count;
    m.most = most;
    m.at = 0;
    m.a = m.b = m.c = hyi_take_unit(&units[0]);
    m.before = FLT_MAX;
    m.here = hyi_look_ahead(&m, 1, &m.a, &m.b);
    while (m.at < count) {
        m.after = hyi_look_ahead(&m, 2, &m.b, &m.c);
        if (m.here < 0.0f && m.here < m.before && m.here <= m.after) {
            hyi_bounds_add(&m.a.box, m.b.box.lower, m.b.box.upper);
            hyi_unit_set(&units[left++], &m.a.box, m.a.first, m.a.count + m.b.count);
            m.at += 2u;
            m.before = m.after;
            m.a = m.c;
            m.here = hyi_look_ahead(&m, 1, &m.a, &m.b);
        } else {
            units[left++] = units[m.at++];
            m.before = m.here;
            m.here = m.after;
            m.a = m.b;
            m.b = m.c;
        }
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
    for (uint32_t i = begin; i < end; i++) {
        const hyi_ref *ref = &build->refs[(uint32_t)units->keys[i]];
        hyi_bounds box = hyi_ref_box(ref);
        build->order[i] = hyi_ref_id(ref);
        hyi_unit_set(&build->other[i], &box, i, 1);
    }
    do {
        before = count;
        count = hyi_merge_pass(room, count, build->leaf_max);
    } while (count < before);
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
