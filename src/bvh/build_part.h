/* >>bvh-build-part: a range of references becomes two: who goes where, and who owns which places

   A range owns more places than it uses where spatial splits may add references. The two children of a node
   whose places are cut at m are nodes 2 (m - 1) and 2 (m - 1) + 1: no two cuts share an m, so places need no
   counter and come out the same on any thread. */
#ifndef HYI_BVH_BUILD_PART_H
#define HYI_BVH_BUILD_PART_H

#include "build_spatial.h"

HYI_INLINE void hyi_set_build_node(hyi_build *build, const hyi_range *range) {
    hyi_build_node *node = &build->nodes[range->node];
    hyi_bounds_store(&range->box, node->lower, node->upper);
    node->first = range->first;
    node->count = range->count;
}

/* Shares out the places that are left, and makes the children's nodes. Counts, boxes and centroids are set. */
HYI_FN void hyi_link_children(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    uint32_t spare = range->capacity - left->count - right->count;
    double weight = (double)left->count, other = (double)right->count;
    uint32_t share = spare ? (uint32_t)((double)spare * (weight / (weight + other))) : 0u;
    left->first = range->first;
    left->capacity = left->count + (share < spare ? share : spare);
    right->first = range->first + left->capacity;
    right->capacity = range->capacity - left->capacity;
    left->node = 2u * (right->first - 1u);
    right->node = left->node + 1u;
    left->depth = right->depth = range->depth + 1u;
    left->in_other = right->in_other = range->in_other;
    if (build->parents) build->parents[left->node / 2u] = range->node;
    build->nodes[range->node].first = left->node;
    build->nodes[range->node].count |= HYI_BUILD_INNER;
}

/* Two ranges that fill, their boxes and centroids growing. */
HYI_INLINE void hyi_begin_sides(hyi_range *left, hyi_range *right) {
    left->count = right->count = 0;
    left->box = left->centroids = right->box = right->centroids = hyi_bounds_empty();
}

HYI_INLINE void hyi_add_centroid(hyi_bounds *centroids, const hyi_bounds *box) {
    hyi_four centroid = hyi_centroid(box);
    hyi_bounds_add(centroids, centroid, centroid);
}

HYI_INLINE void hyi_range_add(hyi_range *range, const hyi_bounds *box) {
    hyi_bounds_add(&range->box, box->lower, box->upper);
    hyi_add_centroid(&range->centroids, box);
    range->count++;
}

/* Sorts references into two places by an object split, without branches. left may be where they lie. */
HYI_FN void hyi_part_objects(const hyi_ref *refs, uint32_t count, const hyi_binning *binning, const hyi_split *split, hyi_ref *to_left,
                             hyi_ref *to_right, hyi_range *left, hyi_range *right) {
    const hyi_four beyond[2] = {hyi_four_all(-HYI_EMPTY_PLANE), hyi_four_all(HYI_EMPTY_PLANE)};
    const float bin = (float)split->bin;
    hyi_bounds l = hyi_bounds_empty(), r = hyi_bounds_empty();
    hyi_ref *to[2] = {to_left, to_right};
    uint32_t filled[2] = {0, 0};
    for (uint32_t i = 0; i < count; i++) {
        uint32_t goes_right = hyi_is_before_bin(binning, &refs[i], split->axis, bin) ? 0u : 1u;
        hyi_ref ref = refs[i];
        hyi_bounds box = hyi_ref_box(&ref);
        hyi_four centroid = hyi_centroid(&box), below = beyond[goes_right], above = beyond[1u - goes_right];
        l.lower = hyi_four_min(l.lower, hyi_four_max(centroid, below));
        l.upper = hyi_four_max(l.upper, hyi_four_min(centroid, above));
        r.lower = hyi_four_min(r.lower, hyi_four_max(centroid, above));
        r.upper = hyi_four_max(r.upper, hyi_four_min(centroid, below));
        to[goes_right][filled[goes_right]++] = ref;
    }
    hyi_begin_sides(left, right);
    left->count = filled[0];
    right->count = filled[1];
    left->centroids = l;
    right->centroids = r;
    left->box = split->left;
    right->box = split->right;
}

/* The same by a spatial split; room: how many references may be added. */
HYI_FN void hyi_part_spatial(const hyi_build *build, const hyi_ref *refs, uint32_t count, const hyi_split *split, uint32_t room,
                             hyi_ref *to_left, hyi_ref *to_right, hyi_range *left, hyi_range *right) {
    hyi_begin_sides(left, right);
    for (uint32_t i = 0; i < count; i++) {
        hyi_ref ref = refs[i];
        hyi_parts parts;
        hyi_part_ref(build, split, &ref, left->count + right->count < i + room, &parts);
        if (parts.left) {
            hyi_ref_set(&to_left[left->count], &parts.left_box, hyi_ref_id(&ref));
            hyi_range_add(left, &parts.left_box);
        }
        if (parts.right) {
            hyi_ref_set(&to_right[right->count], &parts.right_box, hyi_ref_id(&ref));
            hyi_range_add(right, &parts.right_box);
        }
    }
}

/* ---- the middle of the range, where the heuristic cannot tell or may not */

HYI_INLINE bool hyi_ref_before(const hyi_ref *a, const hyi_ref *b, int axis) {
    float ca = hyi_rounded(a->lower[axis] + a->upper[axis]), cb = hyi_rounded(b->lower[axis] + b->upper[axis]);
    return ca < cb || (ca == cb && hyi_ref_id(a) < hyi_ref_id(b));
}

HYI_INLINE void hyi_swap_refs(hyi_ref *a, hyi_ref *b) {
    hyi_ref keep = *a;
    *a = *b;
    *b = keep;
}

/* Orders refs so that no one before middle belongs after it (Hoare's selection, middle of three as pivot). */
HYI_FN void hyi_select_middle(hyi_ref *refs, uint32_t count, uint32_t middle, int axis) {
    uint32_t low = 0, high = count - 1u;
    while (low < high) {
        hyi_ref *a = &refs[low], *b = &refs[low + (high - low) / 2u], *c = &refs[high];
        if (hyi_ref_before(b, a, axis)) hyi_swap_refs(a, b);
        if (hyi_ref_before(c, b, axis)) hyi_swap_refs(b, c);
        if (hyi_ref_before(b, a, axis)) hyi_swap_refs(a, b);
        hyi_ref pivot = *b;
        uint32_t i = low, j = high;
        while (i <= j) {
            while (hyi_ref_before(&refs[i], &pivot, axis)) i++;
            while (hyi_ref_before(&pivot, &refs[j], axis)) j--;
            if (i > j) break;
            hyi_swap_refs(&refs[i], &refs[j]);
            i++;
            if (j == 0) break;
            j--;
        }
        if (middle <= j) high = j;
        else if (middle >= i) low = i;
        else return;
    }
}

HYI_FN int hyi_widest_axis(const hyi_bounds *box) {
    float extent[4];
    int widest = 0;
    hyi_four_store(extent, hyi_four_sub(box->upper, box->lower));
    for (int a = 1; a < 3; a++) {
        if (extent[a] > extent[widest]) widest = a;
    }
    return widest;
}

/* Cuts the range in two halves by count, in the array it lies in. */
HYI_FN void hyi_split_middle(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_ref *refs = (range->in_other ? build->other : build->refs) + range->first;
    uint32_t half = range->count / 2u;
    hyi_select_middle(refs, range->count, half, hyi_widest_axis(&range->centroids));
    hyi_begin_sides(left, right);
    for (uint32_t i = 0; i < range->count; i++) {
        hyi_bounds box = hyi_ref_box(&refs[i]);
        hyi_range_add(i < half ? left : right, &box);
    }
    hyi_link_children(build, range, left, right);
    memmove(refs + left->capacity, refs + half, right->count * sizeof *refs);
}

#endif /* HYI_BVH_BUILD_PART_H */
