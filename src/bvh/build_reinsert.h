/* >>bvh-build-reinsert: subtrees go where the tree gets cheapest by it

   Meister, Bittner 2018, "Parallel reinsertion for bounding volume hierarchy optimization": all threads look, on the tree as
   it stands, which candidates would save surface elsewhere. Those are few; they move one after the other, each to where it
   saves most by then. Candidates are the nodes of largest surface (Bittner, Hapala, Havran 2013, "Fast insertion-based
   optimization of bounding volume hierarchies"): the largest fiftieth has nearly all of the gain, and the largest
   four-hundredth what is worth its time in a quick build.
   References keep their boxes, so parts of triangles stay parts. */
#ifndef HYI_BVH_BUILD_REINSERT_H
#define HYI_BVH_BUILD_REINSERT_H

#include "build_tree.h"

#define HYI_REINSERT_PIECE 64u /* candidates in a piece of work */
#define HYI_NO_NODE UINT32_MAX

typedef struct hyi_candidate {
    uint32_t node;
    float area;
    bool moves;
} hyi_candidate;

typedef struct hyi_reinsert {
    hyi_build *build;
    hyi_candidate *candidates;
    hyi_candidate *heap; /* largest first, while candidates are chosen */
    uint32_t count, most, root;
} hyi_reinsert;

HYI_INLINE hyi_bounds hyi_node_bounds(const hyi_build *build, uint32_t node) {
    return hyi_bounds_load(build->nodes[node].lower, build->nodes[node].upper);
}

HYI_INLINE uint32_t hyi_parent_of(const hyi_build *build, uint32_t node) { return build->parents[node / 2u]; }

/* ---- candidates */

HYI_FN void hyi_heap_push(hyi_candidate *heap, uint32_t count, hyi_candidate entry) {
    uint32_t at = count;
    for (; at > 0 && heap[(at - 1u) / 2u].area < entry.area; at = (at - 1u) / 2u) heap[at] = heap[(at - 1u) / 2u];
    heap[at] = entry;
}

/* Takes the first off a heap of count. */
HYI_FN hyi_candidate hyi_heap_pop(hyi_candidate *heap, uint32_t count) {
    hyi_candidate first = heap[0], last = heap[count - 1u];
    uint32_t at = 0, left = count - 1u;
    for (;;) {
        uint32_t child = 2u * at + 1u;
        if (child >= left) break;
        if (child + 1u < left && heap[child + 1u].area > heap[child].area) child++;
        if (heap[child].area <= last.area) break;
        heap[at] = heap[child];
        at = child;
    }
    heap[at] = last;
    return first;
}

HYI_INLINE hyi_candidate hyi_make_candidate(const hyi_build *build, uint32_t node) {
    hyi_candidate candidate;
    candidate.node = node;
    candidate.area = hyi_node_area(&build->nodes[node]);
    candidate.moves = false;
    return candidate;
}

/* The nodes of largest surface, but for the root and its children. */
HYI_FN void hyi_choose_candidates(hyi_reinsert *work) {
    const hyi_build *build = work->build;
    uint32_t waiting = 1;
    work->count = 0;
    work->heap[0] = hyi_make_candidate(build, work->root);
    while (waiting > 0 && work->count < work->most) {
        hyi_candidate next = hyi_heap_pop(work->heap, waiting--);
        const hyi_build_node *node = &build->nodes[next.node];
        if (next.node != work->root && hyi_parent_of(build, next.node) != work->root) work->candidates[work->count++] = next;
        if (hyi_build_is_leaf(node)) continue;
        hyi_heap_push(work->heap, waiting++, hyi_make_candidate(build, node->first));
        hyi_heap_push(work->heap, waiting++, hyi_make_candidate(build, node->first + 1u));
    }
}

/* ---- places */

typedef struct hyi_spot {
    uint32_t node;
    float saved; /* surface of the nodes that go or shrink, less what those above this one gain */
} hyi_spot;

/* Looks below a node, whose place is the first of the list; best: the best place so far. */
HYI_FN void hyi_search_below(const hyi_build *build, const hyi_bounds *box, float area, uint32_t sibling, hyi_spot first, hyi_spot *best) {
    hyi_spot list[HYI_TREE_DEPTH + 2u];
    uint32_t waiting = 1;
    list[0] = first;
    while (waiting > 0) {
        hyi_spot place = list[--waiting];
        if (place.saved - area <= best->saved) continue;
        const hyi_build_node *node = &build->nodes[place.node];
        hyi_bounds here = hyi_node_bounds(build, place.node);
        float alone = hyi_bounds_area(&here), saved = place.saved - hyi_bounds_area_with(&here, box->lower, box->upper);
        if (saved > best->saved && place.node != sibling) {
            best->saved = saved;
            best->node = place.node;
        }
        saved += alone;
        if (hyi_build_is_leaf(node) || saved - area <= best->saved) continue;
        list[waiting].node = node->first;
        list[waiting++].saved = saved;
        list[waiting].node = node->first + 1u;
        list[waiting++].saved = saved;
    }
}

/* From the candidate up: at each level below the sibling there, then what the ancestor shrinks by without it. */
HYI_FN uint32_t hyi_find_spot(const hyi_reinsert *work, uint32_t node) {
    const hyi_build *build = work->build;
    hyi_bounds box = hyi_node_bounds(build, node), rest = hyi_bounds_empty();
    uint32_t at = node, parent = hyi_parent_of(build, at), above = parent;
    hyi_spot best = {HYI_NO_NODE, 0.0f};
    float area = hyi_bounds_area(&box), saved = hyi_node_area(&build->nodes[parent]);
    for (;; above = hyi_parent_of(build, at)) {
        hyi_spot side;
        side.node = at ^ 1u;
        side.saved = saved;
        hyi_search_below(build, &box, area, node ^ 1u, side, &best);
        if (above == work->root) return best.node;
        hyi_bounds other = hyi_node_bounds(build, at ^ 1u);
        hyi_bounds_add(&rest, other.lower, other.upper);
        if (above != parent) saved += hyi_node_area(&build->nodes[above]) - hyi_bounds_area(&rest);
        at = above;
    }
}

HYI_FN void hyi_find_movers(void *argument, uint32_t piece) {
    const hyi_reinsert *work = (const hyi_reinsert *)argument;
    uint32_t begin = piece * HYI_REINSERT_PIECE, end = work->count - begin < HYI_REINSERT_PIECE ? work->count : begin + HYI_REINSERT_PIECE;
    for (uint32_t i = begin; i < end; i++) work->candidates[i].moves = hyi_find_spot(work, work->candidates[i].node) != HYI_NO_NODE;
}

/* ---- moves */

/* Gives a node another place: its children, and costs with them, go along. */
HYI_FN void hyi_replace_node(hyi_build *build, uint32_t at, const hyi_build_node *node) {
    build->nodes[at] = *node;
    if (!hyi_build_is_leaf(node)) build->parents[node->first / 2u] = at;
}

/* Boxes, counts and heights from a node upwards; what the subtrees cost is no longer known. */
HYI_FN void hyi_mend_above(hyi_build *build, uint32_t at) {
    for (; at != HYI_NO_NODE; at = hyi_parent_of(build, at)) {
        hyi_build_node *node = &build->nodes[at];
        const hyi_build_node *left = &build->nodes[node->first], *right = left + 1;
        uint32_t low = hyi_height_of(build, left), high = hyi_height_of(build, right);
        hyi_cost *cost = hyi_cost_at(build, node);
        hyi_bounds box = hyi_node_bounds(build, node->first), other = hyi_node_bounds(build, node->first + 1u);
        hyi_bounds_add(&box, other.lower, other.upper);
        hyi_bounds_store(&box, node->lower, node->upper);
        node->count = HYI_BUILD_INNER | ((left->count & ~HYI_BUILD_INNER) + (right->count & ~HYI_BUILD_INNER));
        cost->height = (uint8_t)(1u + (low > high ? low : high));
        cost->tips = 0;
    }
}

/* Whether the tree gets too deep. */
HYI_FN bool hyi_move_is_deep(const hyi_build *build, uint32_t node, uint32_t to) {
    uint32_t depth = 1, below = hyi_height_of(build, &build->nodes[node]), other = hyi_height_of(build, &build->nodes[to]);
    below = other > below ? other : below;
    for (uint32_t at = to; at != HYI_NO_NODE; at = hyi_parent_of(build, at)) depth++;
    return depth + below >= HYI_TREE_DEPTH;
}

/* The sibling takes the place of the parent, and the pair of places that gets free the two that become siblings. */
HYI_FN void hyi_make_move(hyi_build *build, uint32_t node, uint32_t to) {
    uint32_t pair = node & ~1u, parent = hyi_parent_of(build, node), above = hyi_parent_of(build, parent);
    hyi_build_node mover = build->nodes[node], stays = build->nodes[node ^ 1u];
    hyi_replace_node(build, parent, &stays);
    hyi_build_node partner = build->nodes[to];
    hyi_replace_node(build, pair, &mover);
    hyi_replace_node(build, pair + 1u, &partner);
    build->nodes[to].first = pair;
    build->nodes[to].count = HYI_BUILD_INNER;
    build->parents[pair / 2u] = to;
    hyi_mend_above(build, above == to ? pair + 1u : above); /* as a partner it stands elsewhere now */
    hyi_mend_above(build, to);
}

HYI_FN void hyi_reinsert_pass(hyi_reinsert *work) {
    hyi_build *build = work->build;
    hyi_choose_candidates(work);
    hyi_parallel(build->context, (work->count + HYI_REINSERT_PIECE - 1u) / HYI_REINSERT_PIECE, hyi_find_movers, work);
    for (uint32_t i = 0; i < work->count; i++) {
        uint32_t node = work->candidates[i].node;
        if (!work->candidates[i].moves || hyi_parent_of(build, node) == work->root) continue;
        uint32_t to = hyi_find_spot(work, node);
        if (to != HYI_NO_NODE && !hyi_move_is_deep(build, node, to)) hyi_make_move(work->build, node, to);
    }
}

/* Costs of the nodes above those that moved. */
HYI_FN void hyi_cost_mended(const hyi_build *build, uint32_t at) {
    const hyi_build_node *node = &build->nodes[at];
    if (hyi_build_is_leaf(node) || hyi_cost_at(build, node)->tips != 0) return;
    hyi_cost_mended(build, node->first);
    hyi_cost_mended(build, node->first + 1u);
    hyi_cost_of(build, at);
}

/* How much is tried: one candidate for so many references, but no fewer than the least, where there are as many nodes. */
typedef struct hyi_reinsert_effort {
    uint32_t passes, share, least;
} hyi_reinsert_effort;

HYI_FN hydra_result hyi_reinsert_largest(hyi_build *build) {
    const hyi_reinsert_effort thorough = {2, 25, 1024}, quick = {4, 200, 64}, effort = build->best ? thorough : quick;
    hyi_reinsert work;
    uint32_t count = build->in_units ? build->unit_count : build->ref_count, nodes = 2u * count - 1u, most = count / effort.share;
    memset(&work, 0, sizeof work);
    work.build = build;
    work.root = build->node_capacity - 1u;
    work.most = most > effort.least ? most : nodes < effort.least ? nodes : effort.least;
    HYI_TRY(hyi_alloc_array(build->context, &work.candidates, 2u * (size_t)work.most + 4u));
    work.heap = work.candidates + work.most;
    for (uint32_t pass = 0; pass < effort.passes; pass++) hyi_reinsert_pass(&work);
    hyi_free_array(build->context, &work.candidates, 2u * (size_t)work.most + 4u);
    hyi_cost_mended(build, work.root);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_REINSERT_H */
