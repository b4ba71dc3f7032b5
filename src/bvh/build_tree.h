/* >>bvh-build-tree: the binary tree: large ranges cut by all threads together, small ones a thread each */
#ifndef HYI_BVH_BUILD_TREE_H
#define HYI_BVH_BUILD_TREE_H

#include "build_split.h"

/* Ranges above this are cut by all threads together. */
#define HYI_BUILD_LARGE (4u * HYI_BUILD_CHUNK)

/* A piece of a large range: its bins, then where its primitives go. */
typedef struct hyi_chunk_split {
    hyi_bins bins;
    hyi_box left_centroids, right_centroids;
    uint32_t left_count, left_first, right_first;
} hyi_chunk_split;

/* The large range in work, for its chunks. */
typedef struct hyi_large {
    hyi_build *build;
    hyi_range range;
    hyi_binning binning;
    hyi_split split;
} hyi_large;

/* Makes the children of the range's node, cut at slot middle. */
HYI_FN void hyi_link_children(hyi_build *build, const hyi_range *range, uint32_t middle, const hyi_box *left, const hyi_box *right) {
    uint32_t at = 2u * (middle - 1u);
    hyi_build_node *node = &build->nodes[at];
    node[0].box = *left;
    node[0].first = range->first;
    node[0].count = middle - range->first;
    node[0].left = HYI_CHILD_NONE;
    node[1].box = *right;
    node[1].first = middle;
    node[1].count = range->first + range->count - middle;
    node[1].left = HYI_CHILD_NONE;
    build->nodes[range->node].left = at;
}

HYI_FN void hyi_make_child_ranges(const hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    uint32_t at = build->nodes[range->node].left;
    left->node = at;
    right->node = at + 1u;
    left->first = build->nodes[at].first;
    left->count = build->nodes[at].count;
    right->first = build->nodes[at + 1u].first;
    right->count = build->nodes[at + 1u].count;
    left->depth = right->depth = range->depth + 1u;
}

/* ---- the middle of the range, where the heuristic cannot tell or may not */

HYI_FN void hyi_measure(const hyi_ref *refs, uint32_t count, hyi_box *box, hyi_box *centroids) {
    *box = *centroids = hyi_box_empty();
    for (uint32_t i = 0; i < count; i++) {
        hyi_box_add(box, refs[i].lower, refs[i].upper);
        hyi_add_centroid(centroids, &refs[i]);
    }
}

HYI_INLINE bool hyi_ref_before(const hyi_ref *a, const hyi_ref *b, int axis) {
    float ca = hyi_rounded(hyi_centroid(a, axis)), cb = hyi_rounded(hyi_centroid(b, axis));
    return ca < cb || (ca == cb && a->id < b->id);
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

HYI_FN int hyi_widest_axis(const hyi_box *box) {
    int widest = 0;
    for (int a = 1; a < 3; a++) {
        if (box->upper[a] - box->lower[a] > box->upper[widest] - box->lower[widest]) widest = a;
    }
    return widest;
}

HYI_FN void hyi_split_middle(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_ref *refs = build->refs + range->first;
    uint32_t half = range->count / 2u;
    hyi_select_middle(refs, range->count, half, hyi_widest_axis(&range->centroids));
    hyi_box left_box, right_box;
    hyi_measure(refs, half, &left_box, &left->centroids);
    hyi_measure(refs + half, range->count - half, &right_box, &right->centroids);
    hyi_link_children(build, range, range->first + half, &left_box, &right_box);
    hyi_make_child_ranges(build, range, left, right);
}

/* ---- small ranges: in place */

/* Returns how many went left. */
HYI_FN uint32_t hyi_partition(hyi_ref *refs, uint32_t count, const hyi_binning *binning, const hyi_split *split,
                              hyi_box *left, hyi_box *right) {
    uint32_t i = 0, j = count;
    *left = *right = hyi_box_empty();
    while (i < j) {
        if (hyi_bin_of(binning, &refs[i], split->axis) < split->bin) {
            hyi_add_centroid(left, &refs[i++]);
        } else {
            hyi_swap_refs(&refs[i], &refs[--j]);
            hyi_add_centroid(right, &refs[j]);
        }
    }
    return i;
}

/* Cuts the range, or returns false: it stays a leaf. */
HYI_FN bool hyi_split_small(hyi_build *build, hyi_bins *bins, const hyi_range *range, hyi_range *left, hyi_range *right) {
    if (range->count < 2u) return false;
    hyi_ref *refs = build->refs + range->first;
    hyi_binning binning = hyi_make_binning(&range->centroids, range->count);
    hyi_bins_clear(bins, binning.count);
    hyi_bins_fill(bins, &binning, refs, range->count);
    hyi_split split = hyi_best_split(bins, &binning, build->leaf_max);
    if (hyi_leaf_is_better(&split, &build->nodes[range->node].box, range->count, build->leaf_max)) return false;
    if (split.axis < 0 || hyi_depth_is_short(range->depth, range->count)) {
        if (range->count <= build->leaf_max) return false;
        hyi_split_middle(build, range, left, right);
        return true;
    }
    uint32_t count = hyi_partition(refs, range->count, &binning, &split, &left->centroids, &right->centroids);
    hyi_link_children(build, range, range->first + count, &split.left, &split.right);
    hyi_make_child_ranges(build, range, left, right);
    return true;
}

/* Depth first with a list of its own: one entry a level at most. */
HYI_FN void hyi_build_subtree(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_range list[HYI_TREE_DEPTH + 2u];
    hyi_bins bins;
    uint32_t waiting = 1;
    list[0] = build->tasks[index];
    while (waiting > 0) {
        hyi_range range = list[--waiting], left, right;
        if (!hyi_split_small(build, &bins, &range, &left, &right)) continue;
        list[waiting++] = right;
        list[waiting++] = left;
    }
}

/* ---- large ranges: chunks in parallel, out of place, order kept */

HYI_INLINE uint32_t hyi_large_chunks(const hyi_range *range) {
    return (range->count + HYI_BUILD_CHUNK - 1u) / HYI_BUILD_CHUNK;
}

HYI_FN void hyi_bin_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    hyi_bins *bins = &large->build->chunk_splits[chunk].bins;
    hyi_bins_clear(bins, large->binning.count);
    hyi_bins_fill(bins, &large->binning, large->build->refs + large->range.first + begin, end - begin);
}

HYI_FN void hyi_scatter_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    hyi_chunk_split *piece = &large->build->chunk_splits[chunk];
    const hyi_ref *refs = large->build->refs + large->range.first;
    hyi_ref *left = large->build->other + piece->left_first, *right = large->build->other + piece->right_first;
    piece->left_centroids = piece->right_centroids = hyi_box_empty();
    uint32_t end = hyi_chunk_end(chunk, large->range.count);
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        bool goes_left = hyi_bin_of(&large->binning, &refs[i], large->split.axis) < large->split.bin;
        hyi_add_centroid(goes_left ? &piece->left_centroids : &piece->right_centroids, &refs[i]);
        *(goes_left ? left++ : right++) = refs[i];
    }
}

HYI_FN void hyi_copy_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    memcpy(large->build->refs + large->range.first + begin, large->build->other + begin, (end - begin) * sizeof(hyi_ref));
}

/* Gives each chunk its places on both sides; returns how many go left. The bins know the counts. */
HYI_FN uint32_t hyi_place_chunks(hyi_large *large) {
    uint32_t chunks = hyi_large_chunks(&large->range), left = 0;
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->left_count = 0;
        for (uint32_t b = 0; b < large->split.bin; b++) piece->left_count += piece->bins.count[large->split.axis][b];
        piece->left_first = left;
        left += piece->left_count;
    }
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->right_first = left + c * HYI_BUILD_CHUNK - piece->left_first;
    }
    return left;
}

HYI_FN void hyi_split_large(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_large large;
    large.build = build;
    large.range = *range;
    large.binning = hyi_make_binning(&range->centroids, range->count);
    uint32_t chunks = hyi_large_chunks(range);
    hyi_parallel(build->context, chunks, hyi_bin_chunk, &large);
    hyi_bins bins = build->chunk_splits[0].bins;
    for (uint32_t c = 1; c < chunks; c++) hyi_bins_merge(&bins, &build->chunk_splits[c].bins, large.binning.count);
    large.split = hyi_best_split(&bins, &large.binning, build->leaf_max);
    if (large.split.axis < 0 || hyi_depth_is_short(range->depth, range->count)) {
        hyi_split_middle(build, range, left, right);
        return;
    }
    uint32_t count = hyi_place_chunks(&large);
    hyi_parallel(build->context, chunks, hyi_scatter_chunk, &large);
    hyi_parallel(build->context, chunks, hyi_copy_chunk, &large);
    left->centroids = right->centroids = hyi_box_empty();
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &build->chunk_splits[c];
        hyi_box_add(&left->centroids, piece->left_centroids.lower, piece->left_centroids.upper);
        hyi_box_add(&right->centroids, piece->right_centroids.lower, piece->right_centroids.upper);
    }
    hyi_link_children(build, range, range->first + count, &large.split.left, &large.split.right);
    hyi_make_child_ranges(build, range, left, right);
}

/* ---- the whole tree */

HYI_FN hyi_range hyi_root_range(hyi_build *build) {
    hyi_range root;
    hyi_build_node *node = &build->nodes[build->node_capacity - 1u];
    hyi_measure(build->refs, build->ref_count, &node->box, &root.centroids);
    node->first = root.first = 0;
    node->count = root.count = build->ref_count;
    node->left = HYI_CHILD_NONE;
    root.node = build->node_capacity - 1u;
    root.depth = 0;
    return root;
}

/* Cuts large ranges until only small ones are left, which become tasks. */
HYI_FN hydra_result hyi_collect_tasks(hyi_build *build, hyi_range root) {
    hyi_range list[HYI_TREE_DEPTH + 2u];
    uint32_t waiting = 1;
    list[0] = root;
    while (waiting > 0) {
        hyi_range range = list[--waiting];
        if (range.count > HYI_BUILD_LARGE) {
            hyi_range left, right;
            hyi_split_large(build, &range, &left, &right);
            list[waiting++] = right;
            list[waiting++] = left;
            continue;
        }
        size_t capacity = build->task_capacity;
        HYI_TRY(hyi_grow_array(build->context, &build->tasks, &capacity, (size_t)build->task_count + 1u));
        build->task_capacity = (uint32_t)capacity;
        build->tasks[build->task_count++] = range;
    }
    return HYDRA_OK;
}

/* The binary tree over all references; its root is the last node. */
HYI_FN hydra_result hyi_build_tree(hyi_build *build) {
    build->node_capacity = 2u * build->ref_count - 1u;
    HYI_TRY(hyi_alloc_array(build->context, &build->nodes, build->node_capacity));
    if (build->ref_count > HYI_BUILD_LARGE) {
        HYI_TRY(hyi_alloc_array(build->context, &build->other, build->ref_count));
        HYI_TRY(hyi_alloc_array(build->context, &build->chunk_splits, build->chunk_count));
    }
    HYI_TRY(hyi_collect_tasks(build, hyi_root_range(build)));
    hyi_free_array(build->context, &build->other, build->ref_count);
    hyi_parallel(build->context, build->task_count, hyi_build_subtree, build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_TREE_H */
