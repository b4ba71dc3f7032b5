/* >>bvh-build-tree: the binary tree: large ranges cut by all threads together, others a thread each */
#ifndef HYI_BVH_BUILD_TREE_H
#define HYI_BVH_BUILD_TREE_H

#include "build_cluster.h"

/* Ranges above this are cut by all threads together. */
#define HYI_BUILD_LARGE (4u * HYI_BUILD_CHUNK)

/* A piece of a large range: its bins, then where its primitives go. */
typedef struct hyi_chunk_split {
    hyi_bins bins;
    hyi_spatial_bins spatial;
    hyi_range left, right;
    uint32_t left_first, right_first;
} hyi_chunk_split;

/* The large range in work, for its chunks. */
typedef struct hyi_large {
    hyi_build *build;
    hyi_range range;
    hyi_binning binning;
    hyi_grid grid;
    hyi_split split;
    const hyi_ref *from;
    hyi_ref *to_left, *to_right;
} hyi_large;

/* What a subtree is cut with. */
typedef struct hyi_small {
    hyi_bins bins;
    hyi_spatial_bins spatial;
} hyi_small;

/* ---- ranges in one thread. They lie in refs; other is room to work in. */

HYI_FN void hyi_bring_home(hyi_build *build, hyi_range *range) {
    if (range->in_other) memcpy(build->refs + range->first, build->other + range->first, range->count * sizeof(hyi_ref));
    range->in_other = false;
}

HYI_FN hyi_split hyi_choose_split(hyi_build *build, hyi_small *work, const hyi_range *range, const hyi_binning *binning) {
    const hyi_ref *refs = build->refs + range->first;
    hyi_bins_fill(&work->bins, binning, refs, range->count);
    hyi_split split = hyi_best_split(&work->bins, binning);
    if (!hyi_spatial_pays(build, range, &split)) return split;
    hyi_grid grid = hyi_make_grid(&range->box, range->count);
    hyi_spatial_fill(&work->spatial, build, &grid, refs, range->count);
    hyi_split spatial = hyi_spatial_best(&work->spatial, &grid);
    return hyi_spatial_is_better(&spatial, &split) ? spatial : split;
}

/* Cuts by a split; false: all went to one side, and nothing is done. */
HYI_FN bool hyi_part_small(hyi_build *build, const hyi_range *range, const hyi_binning *binning, const hyi_split *split,
                           hyi_range *left, hyi_range *right) {
    hyi_ref *refs = build->refs + range->first, *scratch = build->other + range->first;
    if (split->spatial) hyi_part_spatial(build, refs, range->count, split, range->capacity - range->count, refs, scratch, left, right);
    else hyi_part_objects(refs, range->count, binning, split, refs, scratch, left, right);
    if (left->count == 0) memcpy(refs, scratch, right->count * sizeof *refs);
    if (left->count == 0 || right->count == 0) return false;
    hyi_link_children(build, range, left, right);
    memcpy(build->refs + right->first, scratch, right->count * sizeof *refs);
    return true;
}

#define HYI_SWEPT 8u

/* Cuts a few clusters where they lie, at the best place there is: partitions keep the order, so it is still Morton's. */
HYI_FN void hyi_sweep_clusters(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    const hyi_ref *refs = build->refs + range->first;
    hyi_bounds after[HYI_SWEPT], box = hyi_bounds_empty();
    float cost[HYI_SWEPT], best = FLT_MAX;
    bool halves = hyi_depth_is_short(range->depth, range->count);
    uint32_t middle = range->count / 2u;
    for (uint32_t i = range->count; i-- > 1u;) {
        hyi_bounds_add(&box, hyi_four_load(refs[i].lower), hyi_four_load(refs[i].upper));
        after[i] = box;
        cost[i] = hyi_bounds_area(&box) * (float)(range->count - i);
    }
    box = hyi_bounds_empty();
    for (uint32_t i = 1; i < range->count; i++) {
        hyi_bounds_add(&box, hyi_four_load(refs[i - 1u].lower), hyi_four_load(refs[i - 1u].upper));
        float here = hyi_bounds_area(&box) * (float)i + cost[i];
        if (halves ? i != range->count / 2u : here >= best) continue;
        best = here;
        middle = i;
        left->box = box;
    }
    right->box = after[middle];
    left->count = middle;
    right->count = range->count - middle;
    hyi_link_children(build, range, left, right);
}

/* Cuts a small range. Returns false where it becomes a leaf. */
HYI_FN bool hyi_split_small(hyi_build *build, hyi_small *work, const hyi_range *range, hyi_range *left, hyi_range *right) {
    if (range->count < 2u) return false;
    if (build->in_units && range->count <= HYI_SWEPT) {
        hyi_sweep_clusters(build, range, left, right);
        return true;
    }
    hyi_binning binning = hyi_make_binning(&range->centroids, range->count);
    hyi_split split = hyi_choose_split(build, work, range, &binning);
    if (split.axis < 0 && range->count <= build->range_max) return false;
    bool short_of_depth = hyi_depth_is_short(range->depth, range->count);
    if (short_of_depth && range->count <= build->range_max) return false;
    if (split.axis >= 0 && !short_of_depth && hyi_part_small(build, range, &binning, &split, left, right)) return true;
    if (range->count <= build->range_max) return false;
    hyi_split_middle(build, range, left, right);
    return true;
}

/* The node of a range that lies in refs. */
HYI_INLINE void hyi_set_range_node(hyi_build *build, const hyi_range *range) {
    if (build->in_units && range->count == 1u) hyi_set_cluster_node(build, range->node, &build->refs[range->first]);
    else hyi_set_build_node(build, range);
}

/* Depth first with a list of its own: an entry a level for the other child, and one for the node itself, which gets its
   costs when both are done. */
HYI_FN void hyi_build_subtree(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_range list[2u * HYI_TREE_DEPTH + 4u];
    hyi_small work;
    uint32_t waiting = 1;
    list[0] = build->tasks[index];
    hyi_bring_home(build, &list[0]);
    while (waiting > 0) {
        hyi_range range = list[--waiting], left, right;
        bool done = range.count == 0;
        if (!done) hyi_set_range_node(build, &range);
        if (done || !hyi_split_small(build, &work, &range, &left, &right)) {
            hyi_cost_of(build, range.node);
            continue;
        }
        list[waiting].node = range.node;
        list[waiting++].count = 0;
        list[waiting++] = right;
        list[waiting++] = left;
    }
}

/* ---- large ranges: chunks in parallel, from one array to the other, order kept */

HYI_FN void hyi_bin_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    hyi_bins_fill(&large->build->chunk_splits[chunk].bins, &large->binning, large->from + begin, end - begin);
}

HYI_FN void hyi_spatial_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    hyi_spatial_bins *bins = &large->build->chunk_splits[chunk].spatial;
    hyi_spatial_fill(bins, large->build, &large->grid, large->from + begin, end - begin);
}

/* What a spatial split would make of a chunk, counted. */
HYI_FN void hyi_count_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    hyi_chunk_split *piece = &large->build->chunk_splits[chunk];
    uint32_t end = hyi_chunk_end(chunk, large->range.count);
    piece->left.count = piece->right.count = 0;
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_parts parts;
        hyi_part_ref(large->build, &large->split, &large->from[i], true, &parts);
        piece->left.count += parts.left ? 1u : 0u;
        piece->right.count += parts.right ? 1u : 0u;
    }
}

/* For an object split the bins know the counts. */
HYI_FN void hyi_count_object_chunks(hyi_large *large, uint32_t chunks) {
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->left.count = 0;
        for (uint32_t b = 0; b < large->split.bin; b++) piece->left.count += piece->bins.count[b][large->split.axis];
        piece->right.count = hyi_chunk_end(c, large->range.count) - c * HYI_BUILD_CHUNK - piece->left.count;
    }
}

HYI_FN void hyi_scatter_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    hyi_chunk_split *piece = &large->build->chunk_splits[chunk];
    uint32_t begin = chunk * HYI_BUILD_CHUNK, count = hyi_chunk_end(chunk, large->range.count) - begin;
    hyi_ref *left = large->to_left + piece->left_first, *right = large->to_right + piece->right_first;
    if (large->split.spatial) {
        hyi_part_spatial(large->build, large->from + begin, count, &large->split, UINT32_MAX - count, left, right, &piece->left,
                         &piece->right);
    } else {
        hyi_part_objects(large->from + begin, count, &large->binning, &large->split, left, right, &piece->left, &piece->right);
    }
}

/* Gives each chunk its places on both sides; adds up the counts. */
HYI_FN void hyi_place_chunks(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    left->count = right->count = 0;
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->left_first = left->count;
        piece->right_first = right->count;
        left->count += piece->left.count;
        right->count += piece->right.count;
    }
}

/* Replaces the object split by a spatial one where that is better, and fits. Returns whether it did; the chunks are
   then counted. */
HYI_FN bool hyi_choose_spatial(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    hyi_build *build = large->build;
    if (!hyi_spatial_pays(build, &large->range, &large->split)) return false;
    large->grid = hyi_make_grid(&large->range.box, large->range.count);
    hyi_parallel(build->context, chunks, hyi_spatial_chunk, large);
    hyi_spatial_bins *bins = &build->chunk_splits[0].spatial;
    for (uint32_t c = 1; c < chunks; c++) hyi_spatial_merge(bins, &build->chunk_splits[c].spatial, &large->grid);
    hyi_split object = large->split, spatial = hyi_spatial_best(bins, &large->grid);
    if (!hyi_spatial_is_better(&spatial, &object)) return false;
    large->split = spatial;
    hyi_parallel(build->context, chunks, hyi_count_chunk, large);
    hyi_place_chunks(large, chunks, left, right);
    if (left->count && right->count && left->count + right->count <= large->range.capacity) return true;
    large->split = object;
    return false;
}

/* The best object split, from bins that all chunks fill. */
HYI_FN void hyi_choose_object(hyi_large *large, uint32_t chunks) {
    hyi_build *build = large->build;
    hyi_parallel(build->context, chunks, hyi_bin_chunk, large);
    hyi_bins bins = build->chunk_splits[0].bins;
    for (uint32_t c = 1; c < chunks; c++) hyi_bins_merge(&bins, &build->chunk_splits[c].bins, large->binning.count);
    large->split = hyi_best_split(&bins, &large->binning);
}

/* Moves the references of counted chunks to the other array, and measures both sides. */
HYI_FN void hyi_part_large(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    hyi_build *build = large->build;
    hyi_link_children(build, &large->range, left, right);
    left->in_other = right->in_other = !large->range.in_other;
    large->to_left = (large->range.in_other ? build->refs : build->other) + left->first;
    large->to_right = large->to_left + left->capacity;
    hyi_parallel(build->context, chunks, hyi_scatter_chunk, large);
    left->box = left->centroids = right->box = right->centroids = hyi_bounds_empty();
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &build->chunk_splits[c];
        hyi_bounds_add(&left->box, piece->left.box.lower, piece->left.box.upper);
        hyi_bounds_add(&right->box, piece->right.box.lower, piece->right.box.upper);
        hyi_bounds_add(&left->centroids, piece->left.centroids.lower, piece->left.centroids.upper);
        hyi_bounds_add(&right->centroids, piece->right.centroids.lower, piece->right.centroids.upper);
    }
}

HYI_FN void hyi_split_large(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_large large;
    uint32_t chunks = hyi_chunks_of(range->count);
    large.build = build;
    large.range = *range;
    large.binning = hyi_make_binning(&range->centroids, range->count);
    large.from = (range->in_other ? build->other : build->refs) + range->first;
    bool short_of_depth = hyi_depth_is_short(range->depth, range->count);
    if (!short_of_depth) hyi_choose_object(&large, chunks);
    bool spatial = !short_of_depth && hyi_choose_spatial(&large, chunks, left, right);
    if (short_of_depth || large.split.axis < 0) {
        hyi_split_middle(build, range, left, right);
        return;
    }
    if (!spatial) {
        hyi_count_object_chunks(&large, chunks);
        hyi_place_chunks(&large, chunks, left, right);
    }
    hyi_part_large(&large, chunks, left, right);
}

/* ---- the whole tree */

/* Places that references of the tree may come to take. */
HYI_INLINE uint32_t hyi_places(const hyi_build *build) { return build->best ? build->capacity : build->ref_count; }

HYI_FN hyi_range hyi_root_range(const hyi_build *build) {
    hyi_range root;
    root.box = build->root_box;
    root.centroids = build->root_centroids;
    root.node = build->node_capacity - 1u;
    root.first = 0;
    root.depth = build->in_units ? HYI_CLUSTER_HEIGHT : 0u; /* levels that are taken */
    root.count = build->ref_count;
    root.capacity = hyi_places(build);
    root.in_other = false;
    return root;
}

HYI_FN hydra_result hyi_make_room_for_tasks(hyi_build *build, size_t more) {
    size_t capacity = build->task_capacity;
    HYI_TRY(hyi_grow_array(build->context, &build->tasks, &capacity, build->task_count + more));
    build->task_capacity = (uint32_t)capacity;
    return HYDRA_OK;
}

/* Cuts large ranges until none is left; the others become tasks. */
HYI_FN hydra_result hyi_cut_large(hyi_build *build) {
    hyi_range list[HYI_TREE_DEPTH + 2u];
    uint32_t waiting = 1;
    list[0] = hyi_root_range(build);
    while (waiting > 0) {
        hyi_range range = list[--waiting];
        if (range.count > HYI_BUILD_LARGE) {
            hyi_range left, right;
            hyi_set_build_node(build, &range);
            hyi_split_large(build, &range, &left, &right);
            list[waiting++] = right;
            list[waiting++] = left;
            continue;
        }
        HYI_TRY(hyi_make_room_for_tasks(build, 1));
        build->tasks[build->task_count++] = range;
    }
    return HYDRA_OK;
}

/* Tasks that a round cuts: a left side comes where its range was, a right side as far behind as there are ranges. */
typedef struct hyi_round {
    hyi_build *build;
    uint32_t first, count;
} hyi_round;

HYI_FN void hyi_cut_task(void *argument, uint32_t index) {
    const hyi_round *round = (const hyi_round *)argument;
    hyi_build *build = round->build;
    hyi_small work;
    hyi_range *left = &build->tasks[round->first + index], range = *left;
    hyi_bring_home(build, &range);
    hyi_set_build_node(build, &range);
    (void)hyi_split_small(build, &work, &range, left, left + round->count); /* so many are always cut */
}

/* Tasks that are small enough come to stand before those of the next round. */
HYI_FN hydra_result hyi_cut_tasks(hyi_build *build) {
    hyi_round round;
    round.build = build;
    for (round.first = 0;;) {
        for (uint32_t i = round.first; i < build->task_count; i++) {
            hyi_range task = build->tasks[i];
            if (task.count > HYI_BUILD_TASK) continue;
            build->tasks[i] = build->tasks[round.first];
            build->tasks[round.first++] = task;
        }
        round.count = build->task_count - round.first;
        if (round.count == 0) return HYDRA_OK;
        HYI_TRY(hyi_make_room_for_tasks(build, round.count));
        hyi_parallel(build->context, round.count, hyi_cut_task, &round);
        build->task_count += round.count;
    }
}

/* Whether quick builds have room left for nodes: that of the references that units were made of, behind the ones to clusters,
   each pair in one cache line; and for what is kept by pairs, behind the nodes. */
HYI_STATIC_ASSERT(9u * (2u * sizeof(hyi_build_node) + sizeof(hyi_place_costs) + sizeof(hyi_cost) + sizeof(uint32_t)) <= 16u * HYI_NODE_BYTES);
HYI_FN bool hyi_nodes_in_room(hyi_build *build, uint32_t pairs) {
    size_t clusters = ((size_t)build->ref_count + 1u) / 2u * 2u, room = build->room - (size_t)(build->refs - build->block);
    size_t bytes = (clusters + 2u * ((size_t)pairs + 1u)) * sizeof(hyi_ref) + ((size_t)pairs + 1u) * sizeof *build->parents;
    bytes += pairs * (sizeof *build->places + sizeof *build->costs);
    if (bytes > room * sizeof(hyi_ref)) return false;
    build->nodes = (hyi_build_node *)(void *)(build->refs + clusters);
    build->places = (hyi_place_costs *)(void *)(build->nodes + 2u * ((size_t)pairs + 1u));
    build->costs = (hyi_cost *)(void *)(build->places + pairs);
    build->parents = (uint32_t *)(void *)(build->costs + pairs);
    return true;
}

/* Places for nodes, and for what is kept by pairs of them. */
HYI_FN hydra_result hyi_place_nodes(hyi_build *build) {
    uint32_t pairs = (build->in_units ? build->unit_count : hyi_places(build)) - 1u;
    build->node_capacity = 2u * pairs + 1u;
    build->nodes_in_room = build->in_units && hyi_nodes_in_room(build, pairs);
    if (!build->nodes_in_room) {
        HYI_TRY(hyi_alloc_array(build->context, &build->nodes, build->node_capacity));
        HYI_TRY(hyi_alloc_array(build->context, &build->costs, pairs));
        if (build->in_units) HYI_TRY(hyi_alloc_array(build->context, &build->places, pairs));
        if (build->positions) HYI_TRY(hyi_alloc_array(build->context, &build->parents, (size_t)pairs + 1u));
    }
    if (build->parents) build->parents[pairs] = UINT32_MAX; /* of the root */
    return HYDRA_OK;
}

/* Room to partition in: in quick builds that of the units, which have become nodes by then. */
HYI_FN hydra_result hyi_place_other(hyi_build *build) {
    build->other_in_room = build->in_units && build->ref_count <= build->piece_count * HYI_PIECE_UNITS;
    build->other = build->units;
    if (!build->other_in_room) HYI_TRY(hyi_alloc_array(build->context, &build->other, build->capacity));
    if (!build->in_units) build->places = (hyi_place_costs *)(void *)build->other;
    return HYDRA_OK;
}

/* The binary tree over all references; its root is the last node. */
HYI_FN hydra_result hyi_build_tree(hyi_build *build) {
    HYI_TRY(hyi_place_nodes(build));
    HYI_TRY(hyi_place_other(build));
    if (build->ref_count > HYI_BUILD_LARGE) {
        build->chunk_split_count = hyi_chunks_of(build->capacity);
        HYI_TRY(hyi_alloc_array(build->context, &build->chunk_splits, build->chunk_split_count));
    }
    if (build->in_units) hyi_place_clusters(build);
    HYI_TRY(hyi_cut_large(build));
    HYI_TRY(hyi_cut_tasks(build));
    hyi_parallel(build->context, build->task_count, hyi_build_subtree, build);
    hyi_cost_above(build, build->node_capacity - 1u);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_TREE_H */
