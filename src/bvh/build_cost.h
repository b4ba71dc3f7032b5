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

/* Of a node with children, kept by the pair that these are. After the collapse has met a node that becomes a wide one, its
   children stand here instead. */
typedef struct hyi_cost {
    union {
        float in_places[HYI_WIDTH];   /* least cost in 1 to 7 places; HYI_COST_NONE: there are not as many tips */
        uint32_t members[HYI_WIDTH];
    } as;
    uint8_t left[HYI_WIDTH - 1u];     /* of 2 to 8 places, those for the left child; 0: one place less does as well */
    uint8_t tips;                     /* leaves of the binary tree, up to HYI_WIDTH; 0: costs are not known; children */
    uint8_t count;                    /* references, up to HYI_COUNT_MANY */
    bool leaf;                        /* in one place: whether as a leaf */
    uint8_t height;                   /* levels below */
} hyi_cost;
#define HYI_COST_NONE 1.0e37f

HYI_INLINE float hyi_node_area(const hyi_build_node *node) {
    hyi_bounds box = hyi_bounds_load(node->lower, node->upper);
    return hyi_bounds_area(&box);
}

HYI_INLINE float hyi_leaf_cost(float area, uint32_t count) { return area * (HYI_COST_LEAF + HYI_COST_TRIANGLE * (float)count); }

HYI_INLINE hyi_cost *hyi_cost_at(const hyi_build *build, const hyi_build_node *node) { return &build->costs[node->first / 2u]; }

/* Levels below a node. */
HYI_INLINE uint32_t hyi_height_of(const hyi_build *build, const hyi_build_node *node) {
    return hyi_build_is_leaf(node) ? 0u : hyi_cost_at(build, node)->height;
}

HYI_INLINE void hyi_cost_of_leaf(const hyi_build_node *node, hyi_cost *cost) {
    hyi_four none = hyi_four_all(HYI_COST_NONE);
    memset(cost->left, 0, sizeof cost->left);
    hyi_four_store(cost->as.in_places, none);
    hyi_four_store(cost->as.in_places + 4, none);
    cost->as.in_places[0] = hyi_leaf_cost(hyi_node_area(node), node->count);
    cost->tips = 1;
    cost->count = (uint8_t)node->count;
    cost->leaf = true;
    cost->height = 0;
}

/* The best way to share out 2 to 8 places between two children: its cost, and how many the left one gets. */
HYI_INLINE void hyi_best_shares(const hyi_cost *left, const hyi_cost *right, float shared[HYI_WIDTH], int32_t to_left[HYI_WIDTH]) {
    hyi_four none = hyi_four_all(HYI_COST_NONE), low = none, high = none, low_left = hyi_four_all(1.0f), high_left = low_left;
    float others[3u * HYI_WIDTH]; /* those of the right child from HYI_WIDTH on, nothing around them */
    for (uint32_t i = 0; i < 3u * HYI_WIDTH; i += 4u)
        hyi_four_store(others + i, i >= HYI_WIDTH && i < 2u * HYI_WIDTH ? hyi_four_load(right->as.in_places + (i - HYI_WIDTH)) : none);
    for (uint32_t k = 1; k < HYI_WIDTH && k <= left->tips; k++) {
        hyi_four mine = hyi_four_all(left->as.in_places[k - 1u]), here = hyi_four_all((float)k);
        const float *rest = others + HYI_WIDTH + 1u - k;
        hyi_four low_cost = hyi_four_add(mine, hyi_four_load(rest)), high_cost = hyi_four_add(mine, hyi_four_load(rest + 4));
        low_left = hyi_four_pick_less(low_cost, low, here, low_left);
        high_left = hyi_four_pick_less(high_cost, high, here, high_left);
        low = hyi_four_min(low_cost, low);
        high = hyi_four_min(high_cost, high);
    }
    hyi_four_store(shared, low);
    hyi_four_store(shared + 4, high);
    hyi_four_truncate(low_left, to_left);
    hyi_four_truncate(high_left, to_left + 4);
}

/* The costs of a child; room: for those of a leaf. */
HYI_INLINE const hyi_cost *hyi_cost_below(const hyi_build *build, const hyi_build_node *child, hyi_cost *room) {
    if (!hyi_build_is_leaf(child)) return hyi_cost_at(build, child);
    hyi_cost_of_leaf(child, room);
    return room;
}

HYI_FN void hyi_cost_of_inner(const hyi_build *build, const hyi_build_node *node, hyi_cost *cost) {
    hyi_cost rooms[2];
    const hyi_build_node *children = &build->nodes[node->first];
    const hyi_cost *left = hyi_cost_below(build, &children[0], &rooms[0]), *right = hyi_cost_below(build, &children[1], &rooms[1]);
    float area = hyi_node_area(node), shared[HYI_WIDTH];
    int32_t to_left[HYI_WIDTH];
    uint32_t count = (uint32_t)left->count + right->count, tips = (uint32_t)left->tips + right->tips;
    hyi_best_shares(left, right, shared, to_left);
    tips = tips < HYI_WIDTH ? tips : HYI_WIDTH;
    float wide = area * HYI_COST_NODE + shared[tips - 2u];
    float leaf = count <= build->leaf_max ? hyi_leaf_cost(area, count) : FLT_MAX;
    cost->tips = (uint8_t)tips;
    cost->count = (uint8_t)(count < HYI_COUNT_MANY ? count : HYI_COUNT_MANY);
    cost->leaf = leaf <= wide;
    cost->height = (uint8_t)(1u + (left->height > right->height ? left->height : right->height));
    float least = cost->as.in_places[0] = cost->leaf ? leaf : wide;
    for (uint32_t places = 2; places < HYI_WIDTH; places++) {
        bool better = places <= tips && shared[places - 2u] < least;
        least = better ? shared[places - 2u] : least;
        cost->left[places - 2u] = (uint8_t)(better ? to_left[places - 2u] : 0);
        cost->as.in_places[places - 1u] = places <= tips ? least : HYI_COST_NONE;
    }
    cost->as.in_places[HYI_WIDTH - 1u] = HYI_COST_NONE;
    cost->left[HYI_WIDTH - 2u] = (uint8_t)to_left[tips - 2u];
}

/* The costs of a node whose children's are known; of triangles in units, their count as well. */
HYI_INLINE void hyi_cost_of(const hyi_build *build, uint32_t at) {
    hyi_build_node *node = &build->nodes[at];
    const hyi_build_node *left, *right;
    if (hyi_build_is_leaf(node)) return;
    left = &build->nodes[node->first];
    right = left + 1;
    if (build->in_units) node->count = HYI_BUILD_INNER | ((left->count & ~HYI_BUILD_INNER) + (right->count & ~HYI_BUILD_INNER));
    hyi_cost_of_inner(build, node, hyi_cost_at(build, node));
}

/* Those above the tasks: what has more references than these. Goes no deeper than HYI_TREE_DEPTH. */
HYI_FN void hyi_cost_above(const hyi_build *build, uint32_t at) {
    const hyi_build_node *node = &build->nodes[at];
    if ((node->count & ~HYI_BUILD_INNER) <= HYI_BUILD_TASK) return;
    hyi_cost_above(build, node->first);
    hyi_cost_above(build, node->first + 1u);
    hyi_cost_of(build, at);
}

#endif /* HYI_BVH_BUILD_COST_H */
