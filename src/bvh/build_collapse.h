/* >>bvh-build-collapse: from the binary tree to eight-wide nodes and rows of triangles

   The inner children of a node stand together, the largest is followed first, and its subtree lies in one
   piece: a ray that goes on reads memory close by. What is near the root comes first. */
#ifndef HYI_BVH_BUILD_COLLAPSE_H
#define HYI_BVH_BUILD_COLLAPSE_H

#include "build_reinsert.h"

/* Subtrees with no more references than a sixteenth of all, but for these bounds, are written by one thread. */
#define HYI_WIDE_TASK_LEAST 256u
#define HYI_WIDE_TASK_MOST 4096u

HYI_INLINE uint32_t hyi_wide_task_size(const hyi_build *build) {
    uint32_t size = build->source_count / 16u;
    return size < HYI_WIDE_TASK_LEAST ? HYI_WIDE_TASK_LEAST : size < HYI_WIDE_TASK_MOST ? size : HYI_WIDE_TASK_MOST;
}

/* The binary nodes that become the children of one wide node, widest surface first: with HYI_MEMBER_LEAF where it becomes
   a leaf. */
#define HYI_MEMBER_LEAF 0x80000000u
typedef struct hyi_family {
    uint32_t count, inner;
    uint32_t member[HYI_WIDTH];
} hyi_family;

/* A subtree that one thread writes: its root has its place, its own nodes and slots lie from first on. */
typedef struct hyi_wide_task {
    uint32_t binary, place, level;
    uint32_t first_node, nodes, first_slot, slots, depth;
    double areas; /* see hyi_relative_cost */
} hyi_wide_task;

/* A walk over the wide tree, which counts, and then writes. */
typedef struct hyi_wide_walk {
    hyi_build *build;
    bool writes, collects; /* collects: leaves subtrees to tasks */
    uint32_t next_node, next_slot, next_task, depth;
    double areas; /* of nodes written */
} hyi_wide_walk;

HYI_INLINE bool hyi_becomes_leaf(const hyi_build *build, uint32_t at) {
    const hyi_build_node *node = &build->nodes[at];
    return hyi_build_is_leaf(node) || hyi_cost_at(build, node)->leaf;
}

/* A subtree, and in how many places of a node it goes. */
typedef struct hyi_share {
    uint32_t node, places;
} hyi_share;

/* The members of a node's family from left to right; returns how many. */
HYI_FN uint32_t hyi_share_out(const hyi_build *build, uint32_t node, uint32_t member[HYI_WIDTH]) {
    hyi_share list[HYI_WIDTH];
    uint32_t waiting = 2, count = 0, left = hyi_cost_at(build, &build->nodes[node])->left[HYI_WIDTH - 2u];
    list[0].node = build->nodes[node].first + 1u;
    list[0].places = HYI_WIDTH - left;
    list[1].node = list[0].node - 1u;
    list[1].places = left;
    while (waiting > 0) {
        hyi_share share = list[--waiting];
        const hyi_build_node *from = &build->nodes[share.node];
        if (hyi_build_is_leaf(from)) {
            member[count++] = share.node | HYI_MEMBER_LEAF;
            continue;
        }
        const hyi_cost *cost = hyi_cost_at(build, from);
        while (share.places > 1u && cost->left[share.places - 2u] == 0) share.places--;
        if (share.places == 1u) {
            member[count++] = share.node | (cost->leaf ? HYI_MEMBER_LEAF : 0u);
            continue;
        }
        left = cost->left[share.places - 2u];
        list[waiting].node = from->first + 1u;
        list[waiting++].places = share.places - left;
        list[waiting].node = from->first;
        list[waiting++].places = left;
    }
    return count;
}

/* Largest surface first, then who came first. No branch on the surfaces, which nobody can guess. */
HYI_FN void hyi_order_family(hyi_family *family, const hyi_build *build, const uint32_t *member, uint32_t count) {
    float area[HYI_WIDTH];
    uint32_t place[HYI_WIDTH];
    for (uint32_t i = 0; i < HYI_WIDTH; i++) {
        area[i] = i < count ? hyi_node_area(&build->nodes[member[i] & ~HYI_MEMBER_LEAF]) : -1.0f;
        place[i] = 0;
    }
    for (uint32_t i = 1; i < HYI_WIDTH; i++) {
        for (uint32_t j = 0; j < i; j++) {
            uint32_t before = area[j] < area[i] ? 1u : 0u;
            place[j] += before;
            place[i] += 1u - before;
        }
    }
    family->count = count;
    family->inner = 0;
    for (uint32_t i = 0; i < count; i++) {
        family->member[place[i]] = member[i];
        family->inner += 1u - member[i] / HYI_MEMBER_LEAF;
    }
}

/* Finds the children of a wide node, and keeps them where its costs were, which nobody asks for any more. */
HYI_FN void hyi_gather_family(hyi_build *build, uint32_t node, hyi_family *family) {
    hyi_cost *cost = hyi_cost_at(build, &build->nodes[node]);
    uint32_t member[HYI_WIDTH];
    hyi_order_family(family, build, member, hyi_share_out(build, node, member));
    memcpy(hyi_places_at(build, &build->nodes[node])->member, family->member, sizeof family->member);
    cost->tips = (uint8_t)family->count;
}

/* The same once more. */
HYI_FN void hyi_recall_family(const hyi_build *build, uint32_t node, hyi_family *family) {
    const hyi_cost *cost = hyi_cost_at(build, &build->nodes[node]);
    memcpy(family->member, hyi_places_at(build, &build->nodes[node])->member, sizeof family->member);
    family->count = cost->tips;
    family->inner = 0;
    for (uint32_t c = 0; c < family->count; c++) family->inner += 1u - family->member[c] / HYI_MEMBER_LEAF;
}

/* Of a node that comes next. */
HYI_INLINE void hyi_ask_for_family(const hyi_build *build, uint32_t node) {
    const uint32_t *member = hyi_places_at(build, &build->nodes[node])->member;
    uint32_t count = hyi_cost_at(build, &build->nodes[node])->tips;
    for (uint32_t i = 0; i < count; i++) hyi_prefetch(&build->nodes[member[i] & ~HYI_MEMBER_LEAF]);
}

/* ---- leaves */

/* The primitives below a binary node that becomes a leaf, each once; returns how many. Units are copied with what comes
   behind them, as if they were as large as may be. */
HYI_FN uint32_t hyi_gather_leaf(const hyi_build *build, uint32_t node, uint32_t count, uint32_t ids[2u * HYI_LEAF_MAX]) {
    const hyi_build_node *from = &build->nodes[node];
    if (!hyi_build_is_leaf(from)) {
        count = hyi_gather_leaf(build, from->first, count, ids);
        return hyi_gather_leaf(build, from->first + 1u, count, ids);
    }
    if (build->in_units) {
        memcpy(ids + count, build->order + from->first, HYI_LEAF_MAX * sizeof *ids);
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

/* The rows of a leaf whose ids are there; of more than four triangles, those at the end with some once more. */
HYI_FN void hyi_write_leaf(const hyi_build *build, uint32_t leaf) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf), more = count > 4u ? count - 4u : 0u, most = more ? 4u : count;
    const uint32_t *ids = build->bvh->ids + first;
    float *rows = hyi_leaf_lane(build->bvh, first, 0);
    hyi_four scale = hyi_four_all(build->scale);
    hyi_four_triangles lanes;
    hyi_load_triangles(build->positions, build->indices, ids, most, &lanes);
    hyi_turn_triangles(&lanes);
    hyi_store_triangles(&lanes, most, scale, rows, count);
    if (more == 0) return;
    hyi_load_triangles(build->positions, build->indices, ids + more, 4, &lanes);
    hyi_turn_triangles(&lanes);
    hyi_store_triangles(&lanes, 4, scale, rows + more, count);
}

/* All leaves of a node, in the order of their slots, which is from the last on. end: as for hyi_ask_for_slots. */
HYI_FN void hyi_write_leaves(const hyi_build *build, const hyi_node *node, uint32_t end) {
    for (uint32_t c = HYI_WIDTH; c-- > 0;) {
        uint32_t child = node->child[c];
        if (!hyi_child_is_leaf(child)) continue;
        if (build->source_count >= HYI_SOURCE_LARGE)
            hyi_ask_for_slots(build->bvh, build->positions, build->indices, hyi_leaf_first(child), hyi_leaf_count(child), end);
        hyi_write_leaf(build, child);
    }
}

/* Rows of a subtree whose nodes and ids are there, slot by slot; returns what its nodes add to the cost. */
HYI_FN double hyi_write_rows(const hyi_build *build, uint32_t root, uint32_t end) {
    uint32_t list[HYI_TREE_DEPTH * HYI_WIDTH], waiting = 1;
    double areas = 0.0;
    list[0] = root;
    while (waiting > 0) {
        const hyi_node *node = &build->bvh->nodes[list[--waiting]];
        areas += hyi_node_areas(node);
        if (build->positions) hyi_write_leaves(build, node, end);
        for (uint32_t c = HYI_WIDTH; c-- > 0;) {
            if (!hyi_child_is_leaf(node->child[c]) && node->child[c] != HYI_CHILD_NONE) list[waiting++] = node->child[c];
        }
    }
    return areas;
}

/* ---- nodes */

/* Boxes of a family's members as planes, those of no one behind them; children are set as they get their places. */
HYI_FN void hyi_begin_node(hyi_node *node, const hyi_build *build, const hyi_family *family) {
    const hyi_build_node none = {{HYI_EMPTY_PLANE, HYI_EMPTY_PLANE, HYI_EMPTY_PLANE}, 0, {-HYI_EMPTY_PLANE, -HYI_EMPTY_PLANE, -HYI_EMPTY_PLANE}, 0};
    for (uint32_t c = 0; c < HYI_WIDTH; c += 4u) {
        hyi_four lower[4], upper[4];
        for (uint32_t k = 0; k < 4; k++) {
            const hyi_build_node *box = c + k < family->count ? &build->nodes[family->member[c + k] & ~HYI_MEMBER_LEAF] : &none;
            lower[k] = hyi_four_load(box->lower);
            upper[k] = hyi_four_load(box->upper);
        }
        hyi_node_set_planes(node, c, lower, upper);
    }
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        node->child[c] = HYI_CHILD_NONE;
        node->unused[c] = 0;
    }
}

/* Gives a leaf its slots; returns the child. ids: room for the triangles, and for HYI_LEAF_MAX more. */
HYI_FN uint32_t hyi_place_leaf(hyi_wide_walk *walk, uint32_t binary, uint32_t *ids) {
    const hyi_build_node *node = &walk->build->nodes[binary];
    uint32_t first = walk->next_slot;
    uint32_t count = hyi_build_is_leaf(node) ? node->count : hyi_cost_at(walk->build, node)->count;
    if (walk->writes || walk->build->best) count = hyi_gather_leaf(walk->build, binary, 0, ids); /* parts of one triangle count once */
    walk->next_slot += count;
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
    uint32_t ids[(HYI_WIDTH + 1u) * HYI_LEAF_MAX], binary[HYI_TREE_DEPTH * HYI_WIDTH], place[HYI_TREE_DEPTH * HYI_WIDTH], level[HYI_TREE_DEPTH * HYI_WIDTH];
    hyi_build *build = walk->build;
    uint32_t waiting = 1;
    binary[0] = root;
    place[0] = root_place;
    level[0] = root_level;
    while (waiting > 0) {
        hyi_family family;
        uint32_t from = binary[--waiting], depth = level[waiting];
        hyi_node *node = walk->writes ? &build->bvh->nodes[place[waiting]] : NULL;
        if (walk->collects && (build->nodes[from].count & ~HYI_BUILD_INNER) <= hyi_wide_task_size(build)) {
            HYI_TRY(hyi_hand_over(walk, from, place[waiting], depth));
            continue;
        }
        walk->depth = depth + 1u > walk->depth ? depth + 1u : walk->depth;
        if (walk->writes && waiting > 0) hyi_ask_for_family(build, binary[waiting - 1u]);
        if (walk->writes) hyi_recall_family(build, from, &family);
        else hyi_gather_family(build, from, &family);
        uint32_t first_slot = walk->next_slot;
        walk->next_node += family.inner;
        if (node) hyi_begin_node(node, build, &family);
        for (uint32_t c = family.count, at = walk->next_node; c-- > 0;) {
            uint32_t member = family.member[c] & ~HYI_MEMBER_LEAF, child;
            if (family.member[c] & HYI_MEMBER_LEAF) {
                child = hyi_place_leaf(walk, member, ids + (walk->next_slot - first_slot));
            } else {
                child = --at;
                hyi_prefetch(hyi_cost_at(build, &build->nodes[member]));
                if (walk->writes) hyi_prefetch(hyi_places_at(build, &build->nodes[member]));
                else hyi_prefetch(&build->nodes[build->nodes[member].first]);
                binary[waiting] = member;
                place[waiting] = at;
                level[waiting++] = depth + 1u;
            }
            if (node) node->child[c] = child;
        }
        if (!node) continue;
        memcpy(build->bvh->ids + first_slot, ids, (walk->next_slot - first_slot) * sizeof *ids);
        if (!walk->collects) continue;
        if (build->positions) hyi_write_leaves(build, node, walk->next_slot);
        walk->areas += hyi_node_areas(node);
    }
    return HYDRA_OK;
}

/* ---- the whole tree */

HYI_FN void hyi_count_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, false, false, 0, 0, 0, 0, 0.0};
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
    task->nodes = walk.next_node;
    task->slots = walk.next_slot;
    task->depth = walk.depth;
}

HYI_FN void hyi_write_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, true, false, 0, 0, 0, 0, 0.0};
    walk.next_node = task->first_node;
    walk.next_slot = task->first_slot;
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
    task->areas = hyi_write_rows(build, task->place, walk.next_slot);
}

/* Counts nodes and slots, and gives each task its own. */
HYI_FN hydra_result hyi_count_wide(hyi_build *build, uint32_t root) {
    hyi_wide_walk walk = {build, false, true, 1, 0, 0, 0, 0.0};
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
    if (!bvh->rows) HYI_TRY(hyi_alloc_array(build->context, &bvh->rows, floats)); /* a quick build has them */
    memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    bvh->bytes += floats * sizeof(float);
    return HYDRA_OK;
}

/* Allocates and writes what stays, and says what it costs. */
HYI_FN hydra_result hyi_collapse(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    uint32_t root = build->node_capacity - 1u, ids[2u * HYI_LEAF_MAX];
    bool one_leaf = hyi_becomes_leaf(build, root);
    bvh->scale = build->scale;
    hyi_bounds_store(&build->root_box, bvh->scaled.lower, bvh->scaled.upper);
    if (one_leaf) {
        bvh->slot_count = hyi_gather_leaf(build, root, 0, ids);
        HYI_TRY(hyi_allocate_wide(build));
        bvh->root = hyi_make_leaf(0, bvh->slot_count);
        memcpy(bvh->ids, ids, bvh->slot_count * sizeof *ids);
        if (build->positions) hyi_write_leaf(build, bvh->root);
        build->cost = hyi_relative_cost(bvh, 0.0, 0.0);
        return HYDRA_OK;
    }
    HYI_TRY(hyi_count_wide(build, root));
    HYI_TRY(hyi_allocate_wide(build));
    bvh->root = 0;
    hyi_wide_walk walk = {build, true, true, 1, 0, 0, 0, 0.0};
    HYI_TRY(hyi_walk_wide(&walk, root, 0, 0));
    hyi_parallel(build->context, build->wide_task_count, hyi_write_wide_task, build);
    for (uint32_t t = 0; t < build->wide_task_count; t++) walk.areas += build->wide_tasks[t].areas;
    build->cost = hyi_relative_cost(bvh, walk.areas, hyi_box_area(&bvh->scaled));
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COLLAPSE_H */
