/* >>bvh-build-cost: which subtrees of the binary tree become wide nodes and leaves

   Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs", section
   3.1: for every node of the binary tree, from the bottom up, the least expected cost of its subtree in 1 to 7
   places of a wide node above it is known from those of its children. */
#ifndef HYI_BVH_BUILD_COST_H
#define HYI_BVH_BUILD_COST_H

#include "build_part.h"

/* Expected costs, in visits of a node: a leaf is one pass over its lanes, and more memory with more triangles. */
#define HYI_COST_NODE 1.0f
#define HYI_COST_LEAF 1.0f
#define HYI_COST_TRIANGLE 0.05f

#define HYI_COUNT_MANY 64u

/* Of a node with children, kept by the pair that these are. */
typedef struct hyi_cost {
    uint8_t left[HYI_WIDTH]; /* of 2 to 8 places, those for the left child; 0: one place less does as well; the last is not read */
    uint8_t tips;            /* leaves of the binary tree, up to HYI_WIDTH; 0: costs are not known; children */
    uint8_t count;           /* references, up to HYI_COUNT_MANY */
    bool leaf;               /* in one place: whether as a leaf */
    uint8_t height;          /* levels below */
} hyi_cost;

/* The same. After the collapse has met a node that becomes a wide one, its children stand here instead. */
typedef union hyi_place_costs {
    float cost[HYI_WIDTH];      /* least in 1 to 8 places, or fewer */
    uint32_t member[HYI_WIDTH];
} hyi_place_costs;
HYI_STATIC_ASSERT(sizeof(hyi_place_costs) == sizeof(hyi_ref));
#define HYI_COST_NONE 1.0e37f

HYI_INLINE float hyi_node_area(const hyi_build_node *node) {
    hyi_bounds box = hyi_bounds_load(node->lower, node->upper);
    return hyi_bounds_area(&box);
}

HYI_INLINE float hyi_leaf_cost(float area, uint32_t count) { return area * (HYI_COST_LEAF + HYI_COST_TRIANGLE * (float)count); }

HYI_INLINE hyi_cost *hyi_cost_at(const hyi_build *build, const hyi_build_node *node) { return &build->costs[node->first / 2u]; }

HYI_INLINE hyi_place_costs *hyi_places_at(const hyi_build *build, const hyi_build_node *node) { return &build->places[node->first / 2u]; }

/* Levels below a node. */
HYI_INLINE uint32_t hyi_height_of(const hyi_build *build, const hyi_build_node *node) {
    return hyi_build_is_leaf(node) ? 0u : hyi_cost_at(build, node)->height;
}

/* What cutting up a subtree into places needs to know of it. */
typedef struct hyi_shareable {
    hyi_four low, high; /* hyi_place_costs */
    uint32_t tips, count, height;
} hyi_shareable;

HYI_INLINE hyi_shareable hyi_share_of(const hyi_build *build, const hyi_build_node *node) {
    hyi_shareable share;
    if (hyi_build_is_leaf(node)) {
        share.low = share.high = hyi_four_all(hyi_leaf_cost(hyi_node_area(node), node->count));
        share.tips = 1;
        share.count = node->count;
        share.height = 0;
    } else {
        const hyi_cost *cost = hyi_cost_at(build, node);
        const hyi_place_costs *places = hyi_places_at(build, node);
        share.low = hyi_four_load(places->cost);
        share.high = hyi_four_load(places->cost + 4);
        share.tips = cost->tips;
        share.count = cost->count;
        share.height = cost->height;
    }
    return share;
}

/* The least costs of 2 to 8 places for two children, and how many the one with fewer tips gets then. */
typedef struct hyi_sharing {
    hyi_four low, high, few_low, few_high;
} hyi_sharing;

HYI_INLINE hyi_sharing hyi_best_sharing(const hyi_shareable *few, const hyi_shareable *many) {
    const hyi_four none = hyi_four_all(HYI_COST_NONE);
    hyi_sharing best = {none, none, none, none};
    hyi_four low = many->low, high = many->high; /* in as many places as are left */
    float mine[HYI_WIDTH];
    hyi_four_store(mine, few->low);
    hyi_four_store(mine + 4, few->high);
    for (uint32_t k = 1; k < HYI_WIDTH && k <= few->tips; k++) {
        hyi_four here = hyi_four_all(mine[k - 1u]), places = hyi_four_all((float)k);
        hyi_four low_cost = hyi_four_add(here, low), high_cost = hyi_four_add(here, high);
        best.few_low = hyi_four_pick_less(low_cost, best.low, places, best.few_low);
        best.few_high = hyi_four_pick_less(high_cost, best.high, places, best.few_high);
        best.low = hyi_four_min(low_cost, best.low);
        best.high = hyi_four_min(high_cost, best.high);
        high = hyi_four_shift(low, high);
        low = hyi_four_shift(none, low);
    }
    return best;
}

/* The least costs of all places, from those of one place and of just so many; and where one place less does not do as well,
   how many of them the left child gets. */
HYI_INLINE void hyi_set_places(hyi_cost *cost, hyi_place_costs *places, const hyi_sharing *best, hyi_four one, hyi_four left_low, hyi_four left_high) {
    const hyi_four none = hyi_four_all(0.0f);
    hyi_four low = hyi_four_shift(one, best->low), high = hyi_four_shift(best->low, best->high);
    low = hyi_four_min(low, hyi_four_shift(one, low));
    low = hyi_four_min(low, hyi_four_shift(one, hyi_four_shift(one, low)));
    high = hyi_four_min(high, hyi_four_shift(low, high));
    high = hyi_four_min(high, hyi_four_shift(low, hyi_four_shift(low, high)));
    hyi_four_store(places->cost, low);
    hyi_four_store(places->cost + 4, high);
    hyi_four_to_bytes(hyi_four_pick_less(best->low, low, left_low, none), hyi_four_pick_less(best->high, high, left_high, none), cost->left);
}

HYI_FN void hyi_cost_of_inner(const hyi_build *build, const hyi_build_node *node) {
    hyi_cost *cost = hyi_cost_at(build, node);
    const float low_places[4] = {2.0f, 3.0f, 4.0f, 5.0f}, high_places[4] = {6.0f, 7.0f, 8.0f, 9.0f};
    const hyi_build_node *children = &build->nodes[node->first];
    hyi_shareable left = hyi_share_of(build, &children[0]), right = hyi_share_of(build, &children[1]);
    bool left_is_few = left.tips <= right.tips;
    hyi_sharing best = left_is_few ? hyi_best_sharing(&left, &right) : hyi_best_sharing(&right, &left);
    hyi_four left_low = left_is_few ? best.few_low : hyi_four_sub(hyi_four_load(low_places), best.few_low);
    hyi_four left_high = left_is_few ? best.few_high : hyi_four_sub(hyi_four_load(high_places), best.few_high);
    uint32_t count = left.count + right.count, tips = left.tips + right.tips;
    float area = hyi_node_area(node), shared[4], shares[4];
    hyi_four_store(shared, best.high);
    hyi_four_store(shares, left_high);
    float wide = area * HYI_COST_NODE + shared[HYI_WIDTH - 6u], leaf = count <= build->leaf_max ? hyi_leaf_cost(area, count) : FLT_MAX;
    cost->leaf = leaf <= wide;
    hyi_set_places(cost, hyi_places_at(build, node), &best, hyi_four_all(cost->leaf ? leaf : wide), left_low, left_high);
    cost->left[HYI_WIDTH - 2u] = (uint8_t)shares[HYI_WIDTH - 6u];
    cost->tips = (uint8_t)(tips < HYI_WIDTH ? tips : HYI_WIDTH);
    cost->count = (uint8_t)(count < HYI_COUNT_MANY ? count : HYI_COUNT_MANY);
    cost->height = (uint8_t)(1u + (left.height > right.height ? left.height : right.height));
}

/* The costs of a node whose children's are known; of triangles in units, their count as well. */
HYI_INLINE void hyi_cost_of(const hyi_build *build, uint32_t at) {
    hyi_build_node *node = &build->nodes[at];
    const hyi_build_node *left, *right;
    if (hyi_build_is_leaf(node)) return;
    left = &build->nodes[node->first];
    right = left + 1;
    if (build->in_units) node->count = HYI_BUILD_INNER | ((left->count & ~HYI_BUILD_INNER) + (right->count & ~HYI_BUILD_INNER));
    hyi_cost_of_inner(build, node);
}

/* Those above the tasks: what has more references than these. Goes no deeper than HYI_TREE_DEPTH. */
HYI_FN void hyi_cost_above(const hyi_build *build, uint32_t at) {
    const hyi_build_node *node = &build->nodes[at];
    if ((node->count & ~HYI_BUILD_INNER) <= HYI_BUILD_TASK) return;
    hyi_cost_above(build, node->first);
    hyi_cost_above(build, node->first + 1u);
    hyi_cost_of(build, at);
}

/* ---- of the tree that was made */

/* What visiting a child adds to the cost of a tree, by the share of rays that come there. */
HYI_INLINE float hyi_child_cost(uint32_t child) {
    return hyi_child_is_leaf(child) ? HYI_COST_LEAF + HYI_COST_TRIANGLE * (float)hyi_leaf_count(child) : HYI_COST_NODE;
}

/* areas: the sum of hyi_child_cost times area over all children. The unit is the visit of a node. */
HYI_INLINE float hyi_relative_cost(const hyi_bvh *bvh, double areas, double area) {
    return (float)(((double)hyi_child_cost(bvh->root) + (area > 0.0 ? areas / area : 0.0)) / (double)HYI_COST_NODE);
}

/* What the children of a node add to that sum. Who is not there has an area of 0. */
HYI_INLINE double hyi_node_areas(const hyi_node *node) {
    hyi_four sum = hyi_four_all(0.0f);
    float lanes[4];
    for (uint32_t c = 0; c < HYI_WIDTH; c += 4u) {
        hyi_four size[3];
        float cost[4];
        for (uint32_t a = 0; a < 3; a++) {
            hyi_four extent = hyi_four_sub(hyi_four_load(&node->planes[2u * a + 1u][c]), hyi_four_load(&node->planes[2u * a][c]));
            size[a] = hyi_four_max(extent, hyi_four_all(0.0f));
        }
        for (uint32_t k = 0; k < 4; k++) cost[k] = hyi_child_cost(node->child[c + k]);
        sum = hyi_four_add(sum, hyi_four_mul(hyi_four_surface(size[0], size[1], size[2]), hyi_four_load(cost)));
    }
    hyi_four_store(lanes, sum);
    return (double)lanes[0] + (double)lanes[1] + (double)lanes[2] + (double)lanes[3];
}

#endif /* HYI_BVH_BUILD_COST_H */
