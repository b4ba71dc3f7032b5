/* >>bvh-build-cost: which subtrees of the binary tree become wide nodes and leaves

   Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs", section
   3.1: for every node of the binary tree, from the bottom up, the least expected cost of its subtree in 1 to 7
   places of a wide node above it is known from those of its children. */
#ifndef HYI_BVH_BUILD_COST_H
#define HYI_BVH_BUILD_COST_H

#include "build_tree.h"

/* Expected costs, in visits of a node: a leaf is one pass over its lanes, and more memory with more triangles. */
#define HYI_COST_NODE 1.0f
#define HYI_COST_LEAF 1.0f
#define HYI_COST_TRIANGLE 0.05f

#define HYI_COUNT_MANY 64u

typedef struct hyi_cost {
    float in_places[HYI_WIDTH - 1u]; /* least cost in 1 to 7 places, as far as there are tips */
    uint8_t left[HYI_WIDTH - 1u];    /* of 2 to 8 places, those for the left child; 0: one place less does as well */
    uint8_t tips;                    /* leaves of the binary tree, up to HYI_WIDTH */
    uint8_t count;                   /* references, up to HYI_COUNT_MANY */
    bool leaf;                       /* in one place: whether as a leaf */
} hyi_cost;

HYI_INLINE float hyi_node_area(const hyi_build_node *node) {
    hyi_bounds box = hyi_bounds_load(node->lower, node->upper);
    return hyi_bounds_area(&box);
}

HYI_INLINE float hyi_leaf_cost(float area, uint32_t count) { return area * (HYI_COST_LEAF + HYI_COST_TRIANGLE * (float)count); }

HYI_INLINE void hyi_cost_of_leaf(const hyi_build_node *node, hyi_cost *cost) {
    memset(cost, 0, sizeof *cost);
    cost->in_places[0] = hyi_leaf_cost(hyi_node_area(node), node->count);
    cost->tips = 1;
    cost->count = (uint8_t)node->count;
    cost->leaf = true;
}

/* The best way to share out places, of which there are no more than tips, between two children. */
HYI_INLINE float hyi_best_share(const hyi_cost *left, const hyi_cost *right, uint32_t places, uint8_t *to_left) {
    uint32_t first = places > right->tips ? places - right->tips : 1u, last = left->tips < places ? left->tips : places - 1u;
    float best = FLT_MAX;
    *to_left = (uint8_t)first;
    for (uint32_t k = first; k <= last; k++) {
        float cost = left->in_places[k - 1u] + right->in_places[places - k - 1u];
        if (cost < best) {
            best = cost;
            *to_left = (uint8_t)k;
        }
    }
    return best;
}

/* Costs in two and more places, but for a whole node's. */
HYI_INLINE void hyi_cost_in_places(const hyi_cost *left, const hyi_cost *right, hyi_cost *cost) {
    for (uint32_t places = 2; places < HYI_WIDTH && places <= cost->tips; places++) {
        float shared = hyi_best_share(left, right, places, &cost->left[places - 2u]), less = cost->in_places[places - 2u];
        cost->in_places[places - 1u] = shared < less ? shared : less;
        if (!(shared < less)) cost->left[places - 2u] = 0;
    }
}

HYI_FN void hyi_cost_of_inner(const hyi_build *build, const hyi_build_node *node, hyi_cost *cost) {
    const hyi_cost *left = &build->costs[node->first], *right = left + 1;
    float area = hyi_node_area(node);
    uint32_t count = (uint32_t)left->count + right->count, tips = (uint32_t)left->tips + right->tips;
    uint8_t whole_left;
    tips = tips < HYI_WIDTH ? tips : HYI_WIDTH;
    float wide = area * HYI_COST_NODE + hyi_best_share(left, right, tips, &whole_left);
    float leaf = count <= build->leaf_max ? hyi_leaf_cost(area, count) : FLT_MAX;
    memset(cost->left, 0, sizeof cost->left);
    cost->tips = (uint8_t)tips;
    cost->count = (uint8_t)(count < HYI_COUNT_MANY ? count : HYI_COUNT_MANY);
    cost->leaf = leaf <= wide;
    cost->in_places[0] = cost->leaf ? leaf : wide;
    hyi_cost_in_places(left, right, cost);
    cost->left[HYI_WIDTH - 2u] = whole_left;
}

/* Goes no deeper than HYI_TREE_DEPTH. next: the first task whose costs are known already; UINT32_MAX: there is none. */
HYI_FN void hyi_cost_below(const hyi_build *build, uint32_t at, uint32_t *next) {
    const hyi_build_node *node = &build->nodes[at];
    if (*next < build->task_count && build->tasks[*next].node == at) {
        ++*next;
    } else if (hyi_build_is_leaf(node)) {
        hyi_cost_of_leaf(node, &build->costs[at]);
    } else {
        hyi_cost_below(build, node->first, next);
        hyi_cost_below(build, node->first + 1u, next);
        hyi_cost_of_inner(build, node, &build->costs[at]);
    }
}

HYI_FN void hyi_cost_task(void *argument, uint32_t index) {
    const hyi_build *build = (const hyi_build *)argument;
    uint32_t none = UINT32_MAX;
    hyi_cost_below(build, build->tasks[index].node, &none);
}

/* Costs of all subtrees; tasks were collected from left to right. */
HYI_FN hydra_result hyi_build_costs(hyi_build *build) {
    uint32_t next = 0;
    HYI_TRY(hyi_alloc_array(build->context, &build->costs, build->node_capacity));
    hyi_parallel(build->context, build->task_count, hyi_cost_task, build);
    hyi_cost_below(build, build->node_capacity - 1u, &next);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COST_H */
