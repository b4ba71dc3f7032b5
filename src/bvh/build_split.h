/* >>bvh-build-split: where to cut a range of primitives: binned surface area heuristic

   Wald 2007, "On fast construction of SAH-based bounding volume hierarchies": primitives fall into equal
   bins by their centroids along each axis, and the cut between two bins of least expected cost is taken.
   Bins hold minima, maxima and counts, which add up to the same values in any order. */
#ifndef HYI_BVH_BUILD_SPLIT_H
#define HYI_BVH_BUILD_SPLIT_H

#include "build_refs.h"

#define HYI_BINS 32u

/* Expected costs, in visits of a node. A leaf costs one pass over its lanes, and memory by the triangle. */
#define HYI_COST_NODE 4.0
#define HYI_COST_LEAF 0.5
#define HYI_COST_TRIANGLE 0.25

typedef struct hyi_bins {
    hyi_box box[3][HYI_BINS];
    uint32_t count[3][HYI_BINS];
} hyi_bins;

/* How centroids map to bins; the bin of a primitive is the same wherever it is asked for. Centroids are
   kept doubled (lower + upper). scale 0: no extent along that axis. */
typedef struct hyi_binning {
    float origin[3], scale[3];
    uint32_t count;
} hyi_binning;

/* A range that becomes a node, with the bounds of its centroids. */
typedef struct hyi_range {
    hyi_box centroids;
    uint32_t node, first, count, depth;
} hyi_range;

typedef struct hyi_split {
    double cost;      /* of both sides times the area of the node */
    int axis;         /* -1: cut in the middle of the range as it lies */
    uint32_t bin;     /* first bin of the right side */
    hyi_box left, right;
} hyi_split;

HYI_INLINE float hyi_centroid(const hyi_ref *ref, int axis) { return ref->lower[axis] + ref->upper[axis]; }

HYI_INLINE void hyi_add_centroid(hyi_box *box, const hyi_ref *ref) {
    float c[3];
    for (int a = 0; a < 3; a++) c[a] = hyi_centroid(ref, a);
    hyi_box_add(box, c, c);
}

HYI_INLINE hyi_binning hyi_make_binning(const hyi_box *centroids, uint32_t primitives) {
    hyi_binning binning;
    binning.count = primitives < 4u * HYI_BINS ? 4u + primitives / 8u : HYI_BINS;
    binning.count = binning.count < HYI_BINS ? binning.count : HYI_BINS;
    for (int a = 0; a < 3; a++) {
        float extent = centroids->upper[a] - centroids->lower[a];
        binning.origin[a] = centroids->lower[a];
        binning.scale[a] = extent > 1.0e-30f ? (float)binning.count / extent : 0.0f;
    }
    return binning;
}

HYI_INLINE uint32_t hyi_bin_of(const hyi_binning *binning, const hyi_ref *ref, int axis) {
    float offset = hyi_rounded(hyi_rounded(hyi_centroid(ref, axis)) - binning->origin[axis]);
    int32_t bin = (int32_t)hyi_rounded(offset * binning->scale[axis]);
    int32_t last = (int32_t)binning->count - 1;
    bin = bin < last ? bin : last;
    return (uint32_t)(bin > 0 ? bin : 0);
}

HYI_FN void hyi_bins_clear(hyi_bins *bins, uint32_t count) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < count; b++) {
            bins->box[a][b] = hyi_box_empty();
            bins->count[a][b] = 0;
        }
    }
}

HYI_FN void hyi_bins_fill(hyi_bins *bins, const hyi_binning *binning, const hyi_ref *refs, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        for (int a = 0; a < 3; a++) {
            uint32_t bin = hyi_bin_of(binning, &refs[i], a);
            hyi_box_add(&bins->box[a][bin], refs[i].lower, refs[i].upper);
            bins->count[a][bin]++;
        }
    }
}

HYI_FN void hyi_bins_merge(hyi_bins *bins, const hyi_bins *more, uint32_t count) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < count; b++) {
            hyi_box_add(&bins->box[a][b], more->box[a][b].lower, more->box[a][b].upper);
            bins->count[a][b] += more->count[a][b];
        }
    }
}

/* Expected cost of a subtree of count primitives, were it entered. */
HYI_INLINE double hyi_primitives_cost(uint32_t count, uint32_t leaf_max) {
    uint32_t blocks = (count + leaf_max - 1u) / leaf_max;
    return HYI_COST_LEAF * (double)blocks + HYI_COST_TRIANGLE * (double)count;
}

/* Sweeps one axis from the right, then from the left. */
HYI_FN void hyi_best_on_axis(const hyi_bins *bins, uint32_t count, int axis, uint32_t leaf_max, hyi_split *best) {
    hyi_box right[HYI_BINS];
    double right_cost[HYI_BINS];
    hyi_box box = hyi_box_empty();
    uint32_t primitives = 0;
    for (uint32_t b = count; b-- > 1u;) {
        hyi_box_add(&box, bins->box[axis][b].lower, bins->box[axis][b].upper);
        primitives += bins->count[axis][b];
        right[b] = box;
        right_cost[b] = primitives ? hyi_box_area(&box) * hyi_primitives_cost(primitives, leaf_max) : -1.0;
    }
    box = hyi_box_empty();
    primitives = 0;
    for (uint32_t b = 1; b < count; b++) {
        hyi_box_add(&box, bins->box[axis][b - 1u].lower, bins->box[axis][b - 1u].upper);
        primitives += bins->count[axis][b - 1u];
        if (primitives == 0 || right_cost[b] < 0.0) continue;
        double cost = hyi_box_area(&box) * hyi_primitives_cost(primitives, leaf_max) + right_cost[b];
        if (best->axis >= 0 && cost >= best->cost) continue;
        best->cost = cost;
        best->axis = axis;
        best->bin = b;
        best->left = box;
        best->right = right[b];
    }
}

HYI_FN hyi_split hyi_best_split(const hyi_bins *bins, const hyi_binning *binning, uint32_t leaf_max) {
    hyi_split best;
    memset(&best, 0, sizeof best);
    best.axis = -1;
    for (int a = 0; a < 3; a++) {
        if (binning->scale[a] > 0.0f) hyi_best_on_axis(bins, binning->count, a, leaf_max, &best);
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

/* Whether the range is better left a leaf. The children of a node are tested together, so cutting adds no
   node of its own, only its share of one. */
HYI_INLINE bool hyi_leaf_is_better(const hyi_split *split, const hyi_box *box, uint32_t count, uint32_t leaf_max) {
    if (count > leaf_max) return false;
    double area = hyi_box_area(box);
    double leaf = hyi_primitives_cost(count, leaf_max) * area;
    return split->axis < 0 || leaf <= HYI_COST_NODE / (double)(HYI_WIDTH - 1u) * area + split->cost;
}

#endif /* HYI_BVH_BUILD_SPLIT_H */
