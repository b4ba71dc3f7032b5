/* >>bvh-build: from triangles or boxes to a tree */
#ifndef HYI_BVH_BUILD_H
#define HYI_BVH_BUILD_H

#include "build_collapse.h"

HYI_FN void hyi_free_parents(hyi_build *build) {
    if (!build->nodes_in_room) hyi_free_array(build->context, &build->parents, (size_t)build->node_capacity / 2u + 1u);
    build->parents = NULL;
}

HYI_FN void hyi_free_other(hyi_build *build) {
    if (!build->other_in_room) hyi_free_array(build->context, &build->other, build->capacity);
    build->other = NULL;
}

HYI_FN void hyi_build_release(hyi_build *build) {
    hyi_free_other(build);
    hyi_free_parents(build);
    hyi_free_array(build->context, &build->chunk_splits, build->chunk_split_count);
    if (!build->nodes_in_room) {
        hyi_free_array(build->context, &build->nodes, build->node_capacity);
        hyi_free_array(build->context, &build->costs, build->node_capacity / 2u);
        if (build->in_units) hyi_free_array(build->context, &build->places, build->node_capacity / 2u);
    }
    hyi_free_array(build->context, &build->block, build->room);
    hyi_free_array(build->context, &build->spare, build->spare_count);
    hyi_free_array(build->context, &build->crowd, build->crowd_count);
    hyi_free_array(build->context, &build->pieces, build->piece_count);
    hyi_free_array(build->context, &build->chunks, build->chunk_count);
    hyi_free_array(build->context, &build->tasks, build->task_capacity);
    hyi_free_array(build->context, &build->wide_tasks, build->wide_task_capacity);
}

/* What was cut with goes before the tree comes. */
HYI_FN hydra_result hyi_build_steps(hyi_build *build) {
    HYI_TRY(hyi_build_refs(build));
    if (build->ref_count == 0) return HYDRA_OK;
    if (build->in_units) HYI_TRY(hyi_build_units(build));
    HYI_TRY(hyi_build_tree(build));
    if (build->parents) HYI_TRY(hyi_reinsert_largest(build));
    hyi_free_parents(build);
    hyi_free_array(build->context, &build->chunk_splits, build->chunk_split_count);
    if (build->in_units) hyi_free_other(build);
    return hyi_collapse(build);
}

/* On failure everything is freed and the tree is empty. */
HYI_FN hydra_result hyi_build_run(hyi_build *build) {
    memset(build->bvh, 0, sizeof *build->bvh);
    if (build->source_count == 0) return HYDRA_OK;
    if (build->source_count > HYI_PRIMITIVES_MAX) {
        return hyi_fail(build->context, HYDRA_ERROR_COUNT, "%u primitives in one tree, the limit is %u", build->source_count,
                        HYI_PRIMITIVES_MAX);
    }
    hydra_result result = hyi_build_steps(build);
    hyi_build_release(build);
    if (result != HYDRA_OK) hyi_bvh_free(build->context, build->bvh);
    return result;
}

HYI_FN void hyi_build_describe(hyi_build *build, hydra_context *context, const float *positions, const uint32_t *indices,
                               uint32_t triangle_count, hydra_build quality, hyi_bvh *bvh) {
    memset(build, 0, sizeof *build);
    build->context = context;
    build->positions = positions;
    build->indices = indices;
    build->source_count = triangle_count;
    build->leaf_max = context->device ? HYI_LEAF_MAX_DEVICE : HYI_LEAF_MAX;
    build->best = quality != HYDRA_BUILD_FAST;
    build->in_units = !build->best;
    build->range_max = build->in_units ? 1u : build->leaf_max;
    build->bvh = bvh;
}

/* positions: x, y, z tightly packed and finite; indices: three a triangle, in range; quality: BEST or FAST; cost: of the tree, as
   of hyi_bvh_cost. The tree
   depends on these alone, and on whether a device will walk it, not on threads. Degenerate triangles are dropped and counted. With BEST a triangle may
   stand in several leaves. */
HYI_FN hydra_result hyi_bvh_build_triangles(hydra_context *context, const float *positions, const uint32_t *indices,
                                            uint32_t triangle_count, hydra_build quality, hyi_bvh *bvh, float *cost) {
    hyi_build build;
    hyi_build_describe(&build, context, positions, indices, triangle_count, quality, bvh);
    hydra_result result = hyi_build_run(&build);
    *cost = build.cost;
    return result;
}

/* A leaf is one box: it stands in its parent already. */
HYI_FN hydra_result hyi_bvh_build_boxes(hydra_context *context, const hyi_box *boxes, uint32_t count, hyi_bvh *bvh) {
    hyi_build build;
    memset(&build, 0, sizeof build);
    build.context = context;
    build.boxes = boxes;
    build.source_count = count;
    build.leaf_max = build.range_max = 1;
    build.bvh = bvh;
    return hyi_build_run(&build);
}

#endif /* HYI_BVH_BUILD_H */
