/* >>bvh-build-collapse: from the binary tree to eight-wide nodes and rows of triangles

   The inner children of a node stand together, the largest is followed first, and its subtree lies in one
   piece: a ray that goes on reads memory close by. What is near the root comes first. */
#ifndef HYI_BVH_BUILD_COLLAPSE_H
#define HYI_BVH_BUILD_COLLAPSE_H

#include "build_reinsert.h"

/* Subtrees with no more references than this are written by one thread. */
#define HYI_WIDE_TASK 4096u

/* The binary nodes that become the children of one wide node, widest surface first. */
typedef struct hyi_family {
    uint32_t count, inner;
    uint32_t member[HYI_WIDTH];
    float area[HYI_WIDTH];
} hyi_family;

/* A subtree that one thread writes: its root has its place, its own nodes and slots lie from first on. */
typedef struct hyi_wide_task {
    uint32_t binary, place, level;
    uint32_t first_node, nodes, first_slot, slots, depth;
} hyi_wide_task;

/* A walk over the wide tree, which counts, and then writes. */
typedef struct hyi_wide_walk {
    hyi_build *build;
    bool writes, collects; /* collects: leaves subtrees to tasks */
    uint32_t next_node, next_slot, next_task, depth;
} hyi_wide_walk;

HYI_INLINE bool hyi_becomes_leaf(const hyi_build *build, uint32_t at) {
    const hyi_build_node *node = &build->nodes[at];
    return hyi_build_is_leaf(node) || hyi_cost_at(build, node)->leaf;
}

/* Keeps the order: largest surface first, then who came first. */
HYI_FN void hyi_family_add(hyi_family *family, const hyi_build *build, uint32_t node) {
    float area = hyi_node_area(&build->nodes[node]);
    uint32_t at = family->count++;
    for (; at > 0 && family->area[at - 1u] < area; at--) {
        family->area[at] = family->area[at - 1u];
        family->member[at] = family->member[at - 1u];
    }
    family->area[at] = area;
    family->member[at] = node;
    family->inner += hyi_becomes_leaf(build, node) ? 0u : 1u;
}

/* Puts a subtree into up to places children. */
HYI_FN void hyi_family_share(hyi_family *family, const hyi_build *build, uint32_t node, uint32_t places) {
    const hyi_build_node *from = &build->nodes[node];
    if (hyi_build_is_leaf(from)) places = 1;
    while (places > 1u && hyi_cost_at(build, from)->left[places - 2u] == 0) places--;
    if (places == 1u) {
        hyi_family_add(family, build, node);
        return;
    }
    uint32_t left = hyi_cost_at(build, from)->left[places - 2u];
    hyi_family_share(family, build, from->first, left);
    hyi_family_share(family, build, from->first + 1u, places - left);
}

/* Finds the children of a wide node, and keeps them where its costs were, which nobody asks for any more. */
HYI_FN void hyi_gather_family(hyi_build *build, uint32_t node, hyi_family *family) {
    hyi_cost *cost = hyi_cost_at(build, &build->nodes[node]);
    uint32_t left = cost->left[HYI_WIDTH - 2u];
    family->count = family->inner = 0;
    hyi_family_share(family, build, build->nodes[node].first, left);
    hyi_family_share(family, build, build->nodes[node].first + 1u, HYI_WIDTH - left);
    memcpy(cost->as.members, family->member, sizeof family->member);
    cost->tips = (uint8_t)family->count;
}

/* The same once more. */
HYI_FN void hyi_recall_family(const hyi_build *build, uint32_t node, hyi_family *family) {
    const hyi_cost *cost = hyi_cost_at(build, &build->nodes[node]);
    memcpy(family->member, cost->as.members, sizeof family->member);
    family->count = cost->tips;
    family->inner = 0;
    for (uint32_t c = 0; c < family->count; c++) family->inner += hyi_becomes_leaf(build, family->member[c]) ? 0u : 1u;
}

/* ---- leaves */

/* The primitives below a binary node that becomes a leaf, each once; returns how many. */
HYI_FN uint32_t hyi_gather_leaf(const hyi_build *build, uint32_t node, uint32_t count, uint32_t ids[HYI_LEAF_MAX]) {
    const hyi_build_node *from = &build->nodes[node];
    if (!hyi_build_is_leaf(from)) {
        count = hyi_gather_leaf(build, from->first, count, ids);
        return hyi_gather_leaf(build, from->first + 1u, count, ids);
    }
    if (build->in_units) {
        memcpy(ids + count, build->order + from->first, from->count * sizeof *ids);
        return count + from->count;
    }
    for (uint32_t i = 0; i < from->count; i++) {
        uint32_t id = hyi_ref_id(&build->refs[from->first + i]), at = 0;
        while (at < count && ids[at] != id) at++;
        ids[at] = id;
        count += at == count ? 1u : 0u;
    }
    return count;
}

HYI_FN void hyi_write_leaf(const hyi_build *build, uint32_t first, uint32_t count, const uint32_t *ids) {
    memcpy(build->bvh->ids + first, ids, count * sizeof *ids);
    if (!build->positions) return;
    float *row = build->bvh->rows + 9u * (size_t)first;
    hyi_four scale = hyi_four_all(build->scale);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *index = build->indices + 3u * (size_t)ids[i];
        for (uint32_t corner = 0; corner < 3; corner++) {
            hyi_four p = hyi_four_load3(build->positions + 3u * (size_t)index[corner]);
            hyi_four_scatter(hyi_four_mul(p, scale), row + 3u * corner * count + i, count);
        }
    }
}

/* ---- nodes */

HYI_FN void hyi_clear_node(hyi_node *node) {
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        for (int a = 0; a < 3; a++) {
            node->planes[2 * a][c] = HYI_EMPTY_PLANE;
            node->planes[2 * a + 1][c] = -HYI_EMPTY_PLANE;
        }
        node->child[c] = HYI_CHILD_NONE;
        node->unused[c] = 0;
    }
}

HYI_FN void hyi_set_child(hyi_node *node, uint32_t c, const hyi_build_node *box, uint32_t child) {
    for (int a = 0; a < 3; a++) {
        node->planes[2 * a][c] = box->lower[a];
        node->planes[2 * a + 1][c] = box->upper[a];
    }
    node->child[c] = child;
}

/* Gives a leaf its slots, and writes it; returns the child. */
HYI_FN uint32_t hyi_place_leaf(hyi_wide_walk *walk, uint32_t binary) {
    const hyi_build_node *node = &walk->build->nodes[binary];
    uint32_t ids[HYI_LEAF_MAX], first = walk->next_slot;
    uint32_t count = hyi_build_is_leaf(node) ? node->count : hyi_cost_at(walk->build, node)->count;
    if (walk->writes || walk->build->best) count = hyi_gather_leaf(walk->build, binary, 0, ids); /* parts of one triangle count once */
    walk->next_slot += count;
    if (walk->writes) hyi_write_leaf(walk->build, first, count, ids);
    return hyi_make_leaf(first, count);
}

/* Hands a subtree to a task. The walk that writes meets the same ones in the same order as the one that counts. */
HYI_FN hydra_result hyi_hand_over(hyi_wide_walk *walk, uint32_t binary, uint32_t place, uint32_t level) {
    hyi_build *build = walk->build;
    size_t capacity = build->wide_task_capacity;
    uint32_t at = walk->next_task++;
    if (walk->writes) return HYDRA_OK;
    HYI_TRY(hyi_grow_array(build->context, &build->wide_tasks, &capacity, (size_t)at + 1u));
    build->wide_task_capacity = (uint32_t)capacity;
    memset(&build->wide_tasks[at], 0, sizeof build->wide_tasks[at]);
    build->wide_tasks[at].binary = binary;
    build->wide_tasks[at].place = place;
    build->wide_tasks[at].level = level;
    return HYDRA_OK;
}

/* The wide tree below a binary node that does not become a leaf, whose wide node has its place. */
HYI_FN hydra_result hyi_walk_wide(hyi_wide_walk *walk, uint32_t root, uint32_t root_place, uint32_t root_level) {
    uint32_t binary[HYI_TREE_DEPTH * HYI_WIDTH], place[HYI_TREE_DEPTH * HYI_WIDTH], level[HYI_TREE_DEPTH * HYI_WIDTH];
    hyi_build *build = walk->build;
    uint32_t waiting = 1;
    binary[0] = root;
    place[0] = root_place;
    level[0] = root_level;
    while (waiting > 0) {
        hyi_family family;
        uint32_t from = binary[--waiting], depth = level[waiting];
        hyi_node *node = walk->writes ? &build->bvh->nodes[place[waiting]] : NULL;
        if (walk->collects && (build->nodes[from].count & ~HYI_BUILD_INNER) <= HYI_WIDE_TASK) {
            HYI_TRY(hyi_hand_over(walk, from, place[waiting], depth));
            continue;
        }
        walk->depth = depth + 1u > walk->depth ? depth + 1u : walk->depth;
        if (walk->writes) hyi_recall_family(build, from, &family);
        else hyi_gather_family(build, from, &family);
        walk->next_node += family.inner;
        if (node) hyi_clear_node(node);
        for (uint32_t c = family.count, at = walk->next_node; c-- > 0;) {
            uint32_t member = family.member[c], child;
            if (hyi_becomes_leaf(build, member)) {
                child = hyi_place_leaf(walk, member);
            } else {
                child = --at;
                binary[waiting] = member;
                place[waiting] = at;
                level[waiting++] = depth + 1u;
            }
            if (node) hyi_set_child(node, c, &build->nodes[member], child);
        }
    }
    return HYDRA_OK;
}

/* ---- the whole tree */

HYI_FN void hyi_count_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, false, false, 0, 0, 0, 0};
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
    task->nodes = walk.next_node;
    task->slots = walk.next_slot;
    task->depth = walk.depth;
}

HYI_FN void hyi_write_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    const hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, true, false, 0, 0, 0, 0};
    walk.next_node = task->first_node;
    walk.next_slot = task->first_slot;
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
}

/* Counts nodes and slots, and gives each task its own. */
HYI_FN hydra_result hyi_count_wide(hyi_build *build, uint32_t root) {
    hyi_wide_walk walk = {build, false, true, 1, 0, 0, 0};
    HYI_TRY(hyi_walk_wide(&walk, root, 0, 0));
    build->wide_task_count = walk.next_task;
    hyi_parallel(build->context, build->wide_task_count, hyi_count_wide_task, build);
    for (uint32_t t = 0; t < build->wide_task_count; t++) {
        hyi_wide_task *task = &build->wide_tasks[t];
        task->first_node = walk.next_node;
        task->first_slot = walk.next_slot;
        walk.next_node += task->nodes;
        walk.next_slot += task->slots;
        walk.depth = task->depth > walk.depth ? task->depth : walk.depth;
    }
    build->bvh->depth = walk.depth;
    build->bvh->node_count = walk.next_node;
    build->bvh->slot_count = walk.next_slot;
    return HYDRA_OK;
}

/* Arrays for the nodes and slots that were counted. */
HYI_FN hydra_result hyi_allocate_wide(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    HYI_TRY(hyi_alloc_array(build->context, &bvh->nodes, bvh->node_count));
    HYI_TRY(hyi_alloc_array(build->context, &bvh->ids, bvh->slot_count));
    bvh->bytes = (size_t)bvh->node_count * sizeof(hyi_node) + (size_t)bvh->slot_count * sizeof(uint32_t);
    if (!build->positions) return HYDRA_OK;
    size_t floats = hyi_bvh_row_floats(bvh->slot_count);
    HYI_TRY(hyi_alloc_array(build->context, &bvh->rows, floats));
    memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    bvh->bytes += floats * sizeof(float);
    return HYDRA_OK;
}

/* Allocates and writes what stays. */
HYI_FN hydra_result hyi_collapse(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    uint32_t root = build->node_capacity - 1u, ids[HYI_LEAF_MAX];
    bool one_leaf = hyi_becomes_leaf(build, root);
    bvh->scale = build->scale;
    hyi_bounds_store(&build->root_box, bvh->scaled.lower, bvh->scaled.upper);
    if (one_leaf) {
        bvh->slot_count = hyi_gather_leaf(build, root, 0, ids);
        HYI_TRY(hyi_allocate_wide(build));
        bvh->root = hyi_make_leaf(0, bvh->slot_count);
        hyi_write_leaf(build, 0, bvh->slot_count, ids);
        return HYDRA_OK;
    }
    HYI_TRY(hyi_count_wide(build, root));
    HYI_TRY(hyi_allocate_wide(build));
    bvh->root = 0;
    hyi_wide_walk walk = {build, true, true, 1, 0, 0, 0};
    HYI_TRY(hyi_walk_wide(&walk, root, 0, 0));
    hyi_parallel(build->context, build->wide_task_count, hyi_write_wide_task, build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COLLAPSE_H */
