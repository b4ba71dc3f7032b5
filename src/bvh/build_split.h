/* >>bvh-build-split: where to cut a range of primitives: binned surface area heuristic

   Wald 2007, "On fast construction of SAH-based bounding volume hierarchies": primitives fall into equal
   bins by their centroids along each axis, and the cut between two bins of least expected cost is taken.
   Bins hold minima, maxima and counts, which add up to the same values in any order. */
#ifndef HYI_BVH_BUILD_SPLIT_H
#define HYI_BVH_BUILD_SPLIT_H

#include "build_units.h"

#define HYI_BINS 32u

/* Expected cost while cutting, by the triangle, of a visit to a leaf. Wide nodes and leaves are chosen afterwards, by the
   costs in bvh-build-cost. */
#define HYI_SPLIT_BLOCK 2.0f

typedef struct hyi_bins {
    hyi_bounds box[HYI_BINS][3];
    uint32_t count[HYI_BINS][4];
} hyi_bins;

/* How doubled centroids map to bins; the bin of a primitive is the same wherever it is asked for. scale 0: no
   extent along that axis. */
typedef struct hyi_binning {
    hyi_four origin, scale, last;
    float origin_of[4], scale_of[4]; /* the same, by axis */
    uint32_t count;
    bool usable[3];
} hyi_binning;

/* A range of references that becomes a node. It owns capacity places from first on, and uses count of them. */
typedef struct hyi_range {
    hyi_bounds box, centroids;
    uint32_t node, first, count, capacity, depth;
    bool in_other; /* which array it lies in */
} hyi_range;

typedef struct hyi_split {
    float cost;      /* of both sides times the area of the node */
    int axis;        /* -1: none */
    bool spatial;
    uint32_t bin;    /* first bin of the right side */
    float plane;     /* of a spatial split */
    uint32_t left_count, right_count;
    hyi_bounds left, right;
} hyi_split;

HYI_INLINE hyi_binning hyi_make_binning(const hyi_bounds *centroids, uint32_t primitives) {
    hyi_binning binning;
    float extent[4];
    memset(binning.scale_of, 0, sizeof binning.scale_of);
    binning.count = primitives < 8u * (HYI_BINS - 4u) ? 4u + primitives / 8u : HYI_BINS;
    hyi_four_store(extent, hyi_four_sub(centroids->upper, centroids->lower));
    for (int a = 0; a < 3; a++) {
        binning.usable[a] = extent[a] > 1.0e-30f;
        if (binning.usable[a]) binning.scale_of[a] = (float)binning.count / extent[a];
    }
    binning.origin = centroids->lower;
    binning.scale = hyi_four_load(binning.scale_of);
    hyi_four_store(binning.origin_of, binning.origin);
    binning.last = hyi_four_all((float)(binning.count - 1u));
    return binning;
}

/* Bins along all axes. The scale rounds, so that the last bin may be passed: hence the minimum. */
HYI_INLINE void hyi_bins_of(const hyi_binning *binning, hyi_four centroid, int32_t bin[4]) {
    hyi_four at = hyi_four_rounded(hyi_four_mul(hyi_four_rounded(hyi_four_sub(centroid, binning->origin)), binning->scale));
    hyi_four_truncate(hyi_four_min(hyi_four_max(at, hyi_four_all(0.0f)), binning->last), bin);
}

/* Whether a primitive falls into a bin before one that is not the first: as hyi_bins_of says, with the same roundings. */
HYI_INLINE bool hyi_is_before_bin(const hyi_binning *binning, const hyi_ref *ref, int axis, float bin) {
    float centroid = hyi_rounded(ref->lower[axis] + ref->upper[axis]);
    return hyi_rounded(hyi_rounded(centroid - binning->origin_of[axis]) * binning->scale_of[axis]) < bin;
}

/* A loop for each array: see hyi_spatial_clear. */
HYI_FN void hyi_bins_clear(hyi_bins *bins, uint32_t count) {
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) bins->box[b][a] = hyi_bounds_empty();
    }
    memset(bins->count, 0, count * sizeof bins->count[0]);
}

HYI_FN void hyi_bins_merge(hyi_bins *bins, const hyi_bins *more, uint32_t count) {
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) hyi_bounds_add(&bins->box[b][a], more->box[b][a].lower, more->box[b][a].upper);
    }
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) bins->count[b][a] += more->count[b][a];
    }
}

HYI_INLINE void hyi_bins_add(hyi_bins *bins, const hyi_binning *binning, const hyi_ref *ref) {
    hyi_bounds box = hyi_ref_box(ref);
    int32_t bin[4];
    hyi_bins_of(binning, hyi_centroid(&box), bin);
    hyi_bounds_add(&bins->box[bin[0]][0], box.lower, box.upper);
    hyi_bounds_add(&bins->box[bin[1]][1], box.lower, box.upper);
    hyi_bounds_add(&bins->box[bin[2]][2], box.lower, box.upper);
    bins->count[bin[0]][0]++;
    bins->count[bin[1]][1]++;
    bins->count[bin[2]][2]++;
}

/* Neighbours often share a bin, and would wait for each other there: in long ranges every other one has its own bins. */
#define HYI_BINS_PAIRED (16u * HYI_BINS)

HYI_FN void hyi_bins_fill(hyi_bins *bins, const hyi_binning *binning, const hyi_ref *refs, uint32_t count) {
    hyi_bins odd;
    uint32_t i = 0;
    hyi_bins_clear(bins, binning->count);
    if (count >= HYI_BINS_PAIRED) {
        hyi_bins_clear(&odd, binning->count);
        for (; i + 1u < count; i += 2u) {
            hyi_bins_add(bins, binning, &refs[i]);
            hyi_bins_add(&odd, binning, &refs[i + 1u]);
        }
        hyi_bins_merge(bins, &odd, binning->count);
    }
    for (; i < count; i++) hyi_bins_add(bins, binning, &refs[i]);
}

/* Expected cost of a subtree of count primitives, were it entered: leaves test up to HYI_LEAF_MAX at once, which
   makes ranges that fill them dear to cut. */
HYI_INLINE float hyi_primitives_cost(uint32_t count) {
    return HYI_SPLIT_BLOCK * (float)((count + HYI_LEAF_MAX - 1u) / HYI_LEAF_MAX) + (float)count;
}

/* Both sides of a cut have primitives: what it costs. */
HYI_INLINE float hyi_cut_cost(float left_area, uint32_t left_count, float right_area, uint32_t right_count) {
    return left_area * hyi_primitives_cost(left_count) + right_area * hyi_primitives_cost(right_count);
}

/* Sweeps all axes from the right, then from the left. */
HYI_FN hyi_split hyi_best_split(const hyi_bins *bins, const hyi_binning *binning) {
    float right_area[HYI_BINS][3];
    uint32_t right_count[HYI_BINS][3], count[3] = {0, 0, 0};
    hyi_bounds box[3];
    hyi_split best;
    memset(&best, 0, sizeof best);
    best.axis = -1;
    for (int a = 0; a < 3; a++) box[a] = hyi_bounds_empty();
    for (uint32_t b = binning->count; b-- > 1u;) {
        for (int a = 0; a < 3; a++) {
            hyi_bounds_add(&box[a], bins->box[b][a].lower, bins->box[b][a].upper);
            right_area[b][a] = hyi_bounds_area(&box[a]);
            right_count[b][a] = count[a] += bins->count[b][a];
        }
    }
    for (int a = 0; a < 3; a++) box[a] = hyi_bounds_empty();
    memset(count, 0, sizeof count);
    for (uint32_t b = 1; b < binning->count; b++) {
        for (int a = 0; a < 3; a++) {
            hyi_bounds_add(&box[a], bins->box[b - 1u][a].lower, bins->box[b - 1u][a].upper);
            count[a] += bins->count[b - 1u][a];
            float cost = hyi_cut_cost(hyi_bounds_area(&box[a]), count[a], right_area[b][a], right_count[b][a]);
            if (count[a] == 0 || right_count[b][a] == 0 || !binning->usable[a] || (best.axis >= 0 && cost >= best.cost)) continue;
            best.cost = cost;
            best.axis = a;
            best.bin = b;
            best.left = box[a];
            best.left_count = count[a];
            best.right_count = right_count[b][a];
        }
    }
    if (best.axis < 0) return best;
    best.right = hyi_bounds_empty();
    for (uint32_t b = best.bin; b < binning->count; b++) {
        hyi_bounds_add(&best.right, bins->box[b][best.axis].lower, bins->box[b][best.axis].upper);
    }
    return best;
}

/* Levels that cutting in the middle takes to come down to one primitive. */
HYI_INLINE uint32_t hyi_levels_to_one(uint32_t count) {
    uint32_t levels = 0;
    while ((1u << levels) < count) levels++;
    return levels;
}

/* Whether the range must be cut in the middle for the tree to stay within HYI_TREE_DEPTH. */
HYI_INLINE bool hyi_depth_is_short(uint32_t depth, uint32_t count) {
    return depth + 1u + hyi_levels_to_one(count) >= HYI_TREE_DEPTH;
}

#endif /* HYI_BVH_BUILD_SPLIT_H */
