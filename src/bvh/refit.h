/* >>bvh-refit: a tree over triangles that moved: same nodes, new boxes and rows, and what it costs now

   Boxes are made anew from the leaves up, every reference taking the whole of its triangle (a build with spatial splits
   had cut some of them). Parts of the tree are refitted by all threads; minima and maxima come out the same in any order,
   and sums are added up in the order of the parts, which depends on the tree alone. */
#ifndef HYI_BVH_REFIT_H
#define HYI_BVH_REFIT_H

#include "build.h"

/* ---- boxes of points as the caller gave them: in any part of float's range */

HYI_INLINE hyi_bounds hyi_raw_empty(void) {
    hyi_bounds box;
    box.lower = hyi_four_all(FLT_MAX);
    box.upper = hyi_four_all(-FLT_MAX);
    return box;
}

HYI_INLINE hyi_box hyi_box_of(const hyi_bounds *bounds) {
    hyi_box box;
    hyi_bounds_store(bounds, box.lower, box.upper);
    return box;
}

/* ---- expected cost */

/* Expected cost of a ray that meets the tree's bounds and nothing in them (MacDonald and Booth 1990). */
HYI_FN float hyi_bvh_cost(const hyi_bvh *bvh) {
    double areas = 0.0;
    if (bvh->primitive_count == 0) return 0.0f;
    for (uint32_t n = 0; n < bvh->node_count; n++) areas += hyi_node_areas(&bvh->nodes[n]);
    return hyi_relative_cost(bvh, areas, hyi_box_area(&bvh->scaled));
}

/* ---- leaves */

/* What a part of the tree comes to. */
typedef struct hyi_refit_sum {
    hyi_bounds real;  /* bounds of the triangles that have an area */
    uint32_t collapsed; /* references to others */
    double areas;       /* see hyi_relative_cost */
} hyi_refit_sum;

/* A subtree. The first ones are opened: their nodes' inner children are parts of their own, from first_child on. */
typedef struct hyi_refit_part {
    uint32_t node, first_child;
    hyi_bounds box;
    hyi_refit_sum sum;
} hyi_refit_part;

typedef struct hyi_refit {
    hydra_context *context;
    const float *positions;
    const uint32_t *indices;
    hyi_bvh *bvh;
    float scale;
    hyi_refit_part *parts;
    uint32_t part_count, opened;
} hyi_refit;

HYI_INLINE hyi_refit_sum hyi_refit_nothing(void) {
    hyi_refit_sum sum;
    sum.real = hyi_raw_empty();
    sum.collapsed = 0;
    sum.areas = 0.0;
    return sum;
}

HYI_FN void hyi_refit_add(hyi_refit_sum *sum, const hyi_refit_sum *more) {
    hyi_bounds_add(&sum->real, more->real.lower, more->real.upper);
    sum->collapsed += more->collapsed;
    sum->areas += more->areas;
}

/* Writes the rows of one triangle and adds it to the leaf's box; false: it has no area. It is then written as a point,
   which no ray hits. point: its first corner. */
HYI_INLINE bool hyi_refit_lane(const hyi_refit *refit, const uint32_t *index, float *rows, uint32_t count, hyi_bounds *box,
                               hyi_four *point) {
    const float *pa = refit->positions + 3u * (size_t)index[0];
    const float *pb = refit->positions + 3u * (size_t)index[1];
    const float *pc = refit->positions + 3u * (size_t)index[2];
    hyi_four a = hyi_four_load3(pa), b = hyi_four_load3(pb), c = hyi_four_load3(pc), scale = hyi_four_all(refit->scale);
    bool flat = hyi_four_is_flat(a, b, c, pa, pb, pc);
    if (HYI_UNLIKELY(flat))
        b = c = a;
    else
        hyi_bounds_add(box, hyi_four_min(a, hyi_four_min(b, c)), hyi_four_max(a, hyi_four_max(b, c)));
    hyi_four_scatter(hyi_four_mul(a, scale), rows, count);
    hyi_four_scatter(hyi_four_mul(b, scale), rows + 3u * count, count);
    hyi_four_scatter(hyi_four_mul(c, scale), rows + 6u * count, count);
    *point = a;
    return !flat;
}

/* Up to four triangles side by side: their rows, and their box. false: one of them may have no area, and nothing is done. */
HYI_INLINE bool hyi_refit_lanes(const hyi_refit *refit, const uint32_t *ids, uint32_t count, float *rows, uint32_t stride, hyi_bounds *box) {
    hyi_four_triangles lanes;
    hyi_bounds all = *box;
    hyi_load_triangles(refit->positions, refit->indices, ids, count, &lanes);
    for (uint32_t k = 0; k < 4; k++) {
        hyi_four a = lanes.corner[0][k], b = lanes.corner[1][k], c = lanes.corner[2][k];
        hyi_bounds_add(&all, hyi_four_min(a, hyi_four_min(b, c)), hyi_four_max(a, hyi_four_max(b, c)));
    }
    hyi_turn_triangles(&lanes);
    if (HYI_UNLIKELY(hyi_four_maybe_flat(lanes.corner[0], lanes.corner[1], lanes.corner[2]))) return false;
    *box = all;
    hyi_store_triangles(&lanes, count, hyi_four_all(refit->scale), rows, stride);
    return true;
}

/* A leaf one by one. A triangle without area counts for its box only where there is no other. */
HYI_NOINLINE hyi_bounds hyi_refit_leaf_slowly(const hyi_refit *refit, const uint32_t *ids, uint32_t count, float *rows, hyi_refit_sum *sum) {
    hyi_bounds box = hyi_raw_empty();
    hyi_four point = box.lower;
    for (uint32_t lane = 0; lane < count; lane++) {
        if (!hyi_refit_lane(refit, refit->indices + 3u * (size_t)ids[lane], rows + lane, count, &box, &point)) sum->collapsed++;
    }
    hyi_bounds_add(&sum->real, box.lower, box.upper);
    if (hyi_bounds_are_empty(&box)) box.lower = box.upper = point;
    return box;
}

/* Box of a leaf's triangles, whose rows are written. */
HYI_FN hyi_bounds hyi_refit_leaf(const hyi_refit *refit, uint32_t leaf, hyi_refit_sum *sum) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf), more = count > 4u ? count - 4u : 0u;
    const uint32_t *ids = refit->bvh->ids + first;
    float *rows = hyi_leaf_lane(refit->bvh, first, 0);
    hyi_bounds box = hyi_raw_empty();
    bool done = hyi_refit_lanes(refit, ids, count - more < 4u ? count : 4u, rows, count, &box);
    if (more) done = done && hyi_refit_lanes(refit, ids + more, 4, rows + more, count, &box); /* those at the end, some once more */
    if (!done) return hyi_refit_leaf_slowly(refit, ids, count, rows, sum);
    hyi_bounds_add(&sum->real, box.lower, box.upper);
    return box;
}

/* ---- nodes */

/* Writes a node whose children's boxes are known; returns their union. */
HYI_FN hyi_bounds hyi_refit_close(const hyi_refit *refit, uint32_t at, const hyi_bounds *raw, hyi_refit_sum *sum) {
    const hyi_four scale = hyi_four_all(refit->scale);
    const hyi_bounds none = hyi_bounds_empty();
    hyi_node *node = &refit->bvh->nodes[at];
    hyi_bounds all = hyi_raw_empty();
    for (uint32_t c = 0; c < HYI_WIDTH; c += 4u) {
        hyi_four lower[4], upper[4];
        for (uint32_t k = 0; k < 4; k++) {
            bool there = node->child[c + k] != HYI_CHILD_NONE;
            lower[k] = there ? hyi_four_mul(raw[c + k].lower, scale) : none.lower;
            upper[k] = there ? hyi_four_mul(raw[c + k].upper, scale) : none.upper;
            if (there) hyi_bounds_add(&all, raw[c + k].lower, raw[c + k].upper);
        }
        hyi_node_set_planes(node, c, lower, upper);
    }
    sum->areas += hyi_node_areas(node);
    return all;
}

/* A node on the way down, the boxes of its children as far as they are known, and bits of those that are not. */
typedef struct hyi_refit_frame {
    uint32_t node, open;
    hyi_bounds boxes[HYI_WIDTH];
} hyi_refit_frame;

/* Leaves in the order of their slots, which is from the last on. Asks for what closing the node, and entering those below it,
   comes to first. */
HYI_FN void hyi_refit_enter(const hyi_refit *refit, uint32_t node, hyi_refit_frame *frame, hyi_refit_sum *sum) {
    frame->node = node;
    frame->open = 0;
    for (uint32_t c = 0; c < 6; c += 2u) hyi_prefetch(refit->bvh->nodes[node].planes[c]);
    for (uint32_t c = HYI_WIDTH; c-- > 0;) {
        uint32_t child = hyi_node_child(refit->bvh, node, c);
        if (hyi_child_is_leaf(child)) {
            if (refit->bvh->slot_count >= HYI_SOURCE_LARGE)
                hyi_ask_for_slots(refit->bvh, refit->positions, refit->indices, hyi_leaf_first(child), hyi_leaf_count(child), refit->bvh->slot_count);
            frame->boxes[c] = hyi_refit_leaf(refit, child, sum);
        } else if (child != HYI_CHILD_NONE) {
            hyi_prefetch(refit->bvh->nodes[child].child);
            frame->open |= 1u << c;
        }
    }
}

/* Depth first, the leaves of a node before the nodes below it: so slots come one after the other. */
HYI_FN hyi_bounds hyi_refit_subtree(const hyi_refit *refit, uint32_t root, hyi_refit_sum *sum) {
    hyi_refit_frame frames[HYI_TREE_DEPTH];
    uint32_t level = 0;
    hyi_refit_enter(refit, root, &frames[0], sum);
    for (;;) {
        hyi_refit_frame *frame = &frames[level];
        if (frame->open) {
            uint32_t child = hyi_node_child(refit->bvh, frame->node, hyi_lowest_bit(frame->open));
            hyi_refit_enter(refit, child, &frames[++level], sum);
            continue;
        }
        hyi_bounds box = hyi_refit_close(refit, frame->node, frame->boxes, sum);
        if (level == 0) return box;
        frame = &frames[--level];
        frame->boxes[hyi_lowest_bit(frame->open)] = box;
        frame->open &= frame->open - 1u;
    }
}

/* ---- parts */

/* Enough to keep threads evenly busy; a smaller tree is one part. */
#define HYI_REFIT_PARTS 512u

/* Opens parts from the root down, in the order they come, until there are enough. */
HYI_FN void hyi_refit_divide(hyi_refit *refit) {
    refit->part_count = 1;
    refit->opened = 0;
    refit->parts[0].node = 0;
    if (refit->bvh->node_count <= HYI_REFIT_PARTS) return;
    for (; refit->part_count + HYI_WIDTH <= HYI_REFIT_PARTS && refit->opened < refit->part_count; refit->opened++) {
        hyi_refit_part *part = &refit->parts[refit->opened];
        part->first_child = refit->part_count;
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(refit->bvh, part->node, c);
            if (child == HYI_CHILD_NONE) break;
            if (!hyi_child_is_leaf(child)) refit->parts[refit->part_count++].node = child;
        }
    }
}

HYI_FN void hyi_refit_part_task(void *argument, uint32_t index) {
    hyi_refit *refit = (hyi_refit *)argument;
    hyi_refit_part *part = &refit->parts[refit->opened + index];
    hyi_refit_sum sum = hyi_refit_nothing(); /* a local one: parts of other threads lie close */
    part->box = hyi_refit_subtree(refit, part->node, &sum);
    part->sum = sum;
}

/* The node of an opened part, when those below it are done. */
HYI_FN void hyi_refit_opened(const hyi_refit *refit, hyi_refit_part *part) {
    hyi_bounds boxes[HYI_WIDTH];
    uint32_t below = part->first_child;
    part->sum = hyi_refit_nothing();
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        uint32_t child = hyi_node_child(refit->bvh, part->node, c);
        if (child == HYI_CHILD_NONE) break;
        boxes[c] = hyi_child_is_leaf(child) ? hyi_refit_leaf(refit, child, &part->sum) : refit->parts[below++].box;
    }
    part->box = hyi_refit_close(refit, part->node, boxes, &part->sum);
}

/* Refits everything; box: of the whole tree. */
HYI_FN hyi_refit_sum hyi_refit_pass(hyi_refit *refit, hyi_bounds *box) {
    hyi_refit_sum sum = hyi_refit_nothing();
    if (hyi_child_is_leaf(refit->bvh->root)) {
        *box = hyi_refit_leaf(refit, refit->bvh->root, &sum);
        return sum;
    }
    hyi_refit_divide(refit);
    hyi_parallel(refit->context, refit->part_count - refit->opened, hyi_refit_part_task, refit);
    for (uint32_t p = refit->opened; p-- > 0;) hyi_refit_opened(refit, &refit->parts[p]);
    for (uint32_t p = 0; p < refit->part_count; p++) hyi_refit_add(&sum, &refit->parts[p].sum);
    *box = refit->parts[0].box;
    return sum;
}

/* ---- what the tree must hold */

/* Whether a scale keeps coordinates as near to 1 as hyi_build_scale wants them; those far below may be anywhere. */
HYI_FN bool hyi_scale_serves(float scale, const hyi_box *box, bool from_below) {
    float largest = hyi_box_largest(box);
    int exponent = 0;
    (void)frexp((double)largest * (double)scale, &exponent);
    return largest <= 0.0f || (exponent <= 20 && (exponent >= -20 || !from_below));
}

/* Marks the triangles that the tree holds; returns how many. marks: a bit each, zeroed. */
HYI_FN uint32_t hyi_mark_held(const hyi_bvh *bvh, uint32_t *marks) {
    uint32_t held = 0;
    for (uint32_t s = 0; s < bvh->slot_count; s++) {
        uint32_t *word = &marks[bvh->ids[s] / 32u], bit = 1u << (bvh->ids[s] % 32u);
        held += *word & bit ? 0u : 1u;
        *word |= bit;
    }
    return held;
}

/* Counts triangles without area. lost: one that has an area is not in the tree. all: those in the tree may have none. */
HYI_FN uint32_t hyi_count_flat(const hyi_refit *refit, const uint32_t *marks, uint32_t triangle_count, bool all, bool *lost) {
    uint32_t flat = 0;
    *lost = false;
    for (uint32_t t = 0; t < triangle_count; t++) {
        bool held = (marks[t / 32u] >> (t % 32u) & 1u) != 0u;
        if (held && !all) {
            t |= marks[t / 32u] == 0xffffffffu ? 31u : 0u; /* on to the next word */
            continue;
        }
        const uint32_t *index = refit->indices + 3u * (size_t)t;
        const float *p = refit->positions;
        bool is_flat = hyi_triangle_is_degenerate(p + 3u * (size_t)index[0], p + 3u * (size_t)index[1], p + 3u * (size_t)index[2]);
        flat += is_flat ? 1u : 0u;
        *lost = *lost || (!is_flat && !held);
    }
    return flat;
}

HYI_INLINE size_t hyi_mark_words(uint32_t count) { return ((size_t)count + 31u) / 32u; }

/* Sets the number of triangles without area. lost: the tree cannot serve these positions, as a triangle that its build
   dropped has an area now. */
HYI_FN hydra_result hyi_refit_census(const hyi_refit *refit, uint32_t triangle_count, uint32_t collapsed, bool *lost) {
    hyi_bvh *bvh = refit->bvh;
    *lost = false;
    bvh->degenerate = 0;
    if (collapsed == 0 && bvh->primitive_count == triangle_count) return HYDRA_OK;
    uint32_t *marks;
    size_t words = hyi_mark_words(triangle_count);
    HYI_TRY(hyi_alloc_array(refit->context, &marks, words));
    memset(marks, 0, words * sizeof *marks);
    (void)hyi_mark_held(bvh, marks);
    bvh->degenerate = hyi_count_flat(refit, marks, triangle_count, collapsed != 0, lost);
    hyi_free_array(refit->context, &marks, words);
    return HYDRA_OK;
}

/* Bounds of what rays can hit, and the scale. */
HYI_FN void hyi_refit_finish(const hyi_refit *refit, const hyi_box *real) {
    hyi_bvh *bvh = refit->bvh;
    bvh->bounds = *real;
    bvh->scale = refit->scale;
    for (int a = 0; a < 3; a++) {
        bvh->scaled.lower[a] = real->lower[a] * refit->scale;
        bvh->scaled.upper[a] = real->upper[a] * refit->scale;
    }
}

/* A scale that no longer serves costs a second pass. */
HYI_FN hydra_result hyi_refit_run(hyi_refit *refit, uint32_t triangle_count, bool *fits, float *cost) {
    hyi_bounds box;
    bool lost, empty;
    hyi_refit_sum sum = hyi_refit_pass(refit, &box);
    hyi_box real = hyi_box_of(&sum.real), all;
    empty = hyi_bounds_are_empty(&sum.real);
    if (!empty && !hyi_scale_serves(refit->scale, &real, true)) {
        refit->scale = hyi_build_scale(&real);
        sum = hyi_refit_pass(refit, &box);
    }
    all = hyi_box_of(&box);
    HYI_TRY(hyi_refit_census(refit, triangle_count, sum.collapsed, &lost));
    *fits = !lost && !empty && hyi_scale_serves(refit->scale, &all, false);
    if (!*fits) return HYDRA_OK;
    hyi_refit_finish(refit, &real);
    *cost = hyi_relative_cost(refit->bvh, sum.areas, hyi_box_area(&refit->bvh->scaled));
    return HYDRA_OK;
}

/* Fits a tree to new positions of the triangles it was built over. fits is false where it cannot be done: no triangle
   that it holds has an area, one that it does not hold has one, or one without area lies too far outside for any scale.
   The tree must then be built again. After an error it may be refitted once more. */
HYI_FN hydra_result hyi_bvh_refit(hydra_context *context, const float *positions, const uint32_t *indices, uint32_t triangle_count,
                                  hyi_bvh *bvh, bool *fits, float *cost) {
    hyi_refit refit;
    memset(&refit, 0, sizeof refit);
    refit.context = context;
    refit.positions = positions;
    refit.indices = indices;
    refit.bvh = bvh;
    refit.scale = bvh->scale;
    *fits = false;
    if (bvh->primitive_count == 0) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &refit.parts, HYI_REFIT_PARTS));
    hydra_result result = hyi_refit_run(&refit, triangle_count, fits, cost);
    hyi_free_array(context, &refit.parts, HYI_REFIT_PARTS);
    return result;
}

#endif /* HYI_BVH_REFIT_H */
