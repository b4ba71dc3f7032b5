/* >>bvh-build-collapse: from the binary tree to eight-wide nodes and rows of triangles

   Wald, Benthin, Boulos 2008, "Getting rid of packets": a node takes its two children, then replaces the
   one of largest surface by that one's children, until eight stand there or all are leaves. The choice of
   least expected cost (Ylitie, Karras, Laine 2017, section 3.1) fills nodes better, but was measured to
   visit as many nodes and 10 to 50 % more leaves (Sponza): it counts rays that do not stop at a hit. */
#ifndef HYI_BVH_BUILD_COLLAPSE_H
#define HYI_BVH_BUILD_COLLAPSE_H

#include "build_tree.h"

/* The binary nodes that become the children of one wide node, widest surface first. */
typedef struct hyi_family {
    uint32_t count;
    uint32_t member[HYI_WIDTH];
    double area[HYI_WIDTH];
} hyi_family;

HYI_INLINE bool hyi_build_is_leaf(const hyi_build_node *node) { return node->left == HYI_CHILD_NONE; }

/* Keeps the order: largest surface first, then who came first. */
HYI_FN void hyi_family_add(hyi_family *family, const hyi_build_node *nodes, uint32_t node) {
    double area = hyi_box_area(&nodes[node].box);
    uint32_t at = family->count++;
    for (; at > 0 && family->area[at - 1u] < area; at--) {
        family->area[at] = family->area[at - 1u];
        family->member[at] = family->member[at - 1u];
    }
    family->area[at] = area;
    family->member[at] = node;
}

HYI_FN void hyi_family_remove(hyi_family *family, uint32_t at) {
    family->count--;
    for (; at < family->count; at++) {
        family->area[at] = family->area[at + 1u];
        family->member[at] = family->member[at + 1u];
    }
}

HYI_FN void hyi_gather_family(const hyi_build *build, uint32_t node, hyi_family *family) {
    const hyi_build_node *nodes = build->nodes;
    family->count = 0;
    hyi_family_add(family, nodes, nodes[node].left);
    hyi_family_add(family, nodes, nodes[node].left + 1u);
    while (family->count < HYI_WIDTH) {
        uint32_t at = 0;
        while (at < family->count && hyi_build_is_leaf(&nodes[family->member[at]])) at++;
        if (at == family->count) return;
        uint32_t left = nodes[family->member[at]].left;
        hyi_family_remove(family, at);
        hyi_family_add(family, nodes, left);
        hyi_family_add(family, nodes, left + 1u);
    }
}

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

HYI_FN void hyi_set_child(hyi_node *node, uint32_t c, const hyi_box *box, uint32_t child) {
    for (int a = 0; a < 3; a++) {
        node->planes[2 * a][c] = box->lower[a];
        node->planes[2 * a + 1][c] = box->upper[a];
    }
    node->child[c] = child;
}

/* Counts the wide nodes below (and with) a binary one: the same walk as the one that writes them. */
HYI_FN uint32_t hyi_count_wide(const hyi_build *build, uint32_t root) {
    uint32_t list[HYI_TREE_DEPTH * HYI_WIDTH];
    uint32_t waiting = 1, total = 0;
    list[0] = root;
    while (waiting > 0) {
        hyi_family family;
        hyi_gather_family(build, list[--waiting], &family);
        total++;
        for (uint32_t c = 0; c < family.count; c++) {
            if (!hyi_build_is_leaf(&build->nodes[family.member[c]])) list[waiting++] = family.member[c];
        }
    }
    return total;
}

/* Writes the wide nodes: the inner children of one stand together, and the largest is followed first, so
   that a ray that goes on reads memory close by. */
HYI_FN void hyi_write_wide(hyi_build *build, uint32_t root) {
    uint32_t binary[HYI_TREE_DEPTH * HYI_WIDTH], wide[HYI_TREE_DEPTH * HYI_WIDTH], level[HYI_TREE_DEPTH * HYI_WIDTH];
    hyi_bvh *bvh = build->bvh;
    uint32_t waiting = 1, next = 1;
    binary[0] = root;
    wide[0] = level[0] = 0;
    while (waiting > 0) {
        hyi_family family;
        uint32_t from = binary[--waiting], depth = level[waiting], inner = 0;
        hyi_node *node = &bvh->nodes[wide[waiting]];
        bvh->depth = depth + 1u > bvh->depth ? depth + 1u : bvh->depth;
        hyi_gather_family(build, from, &family);
        hyi_clear_node(node);
        for (uint32_t c = 0; c < family.count; c++) inner += !hyi_build_is_leaf(&build->nodes[family.member[c]]);
        next += inner;
        for (uint32_t c = family.count, place = next; c-- > 0;) {
            const hyi_build_node *child = &build->nodes[family.member[c]];
            if (hyi_build_is_leaf(child)) {
                hyi_set_child(node, c, &child->box, hyi_make_leaf(child->first, child->count));
                continue;
            }
            hyi_set_child(node, c, &child->box, --place);
            binary[waiting] = family.member[c];
            wide[waiting] = place;
            level[waiting++] = depth + 1u;
        }
    }
}

/* ---- triangles */

HYI_FN void hyi_write_leaf(const hyi_build *build, uint32_t leaf) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t id = build->refs[first + i].id;
        build->bvh->ids[first + i] = id;
        if (!build->positions) continue;
        float *row = build->bvh->rows + 9u * (size_t)first;
        for (uint32_t corner = 0; corner < 3; corner++) {
            const float *p = build->positions + 3u * (size_t)build->indices[3u * (size_t)id + corner];
            for (uint32_t a = 0; a < 3; a++) row[(3u * corner + a) * count + i] = p[a] * build->scale;
        }
    }
}

HYI_FN void hyi_write_leaves_chunk(void *argument, uint32_t chunk) {
    const hyi_build *build = (const hyi_build *)argument;
    uint32_t end = hyi_chunk_end(chunk, build->bvh->node_count);
    for (uint32_t n = chunk * HYI_BUILD_CHUNK; n < end; n++) {
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = build->bvh->nodes[n].child[c];
            if (hyi_child_is_leaf(child)) hyi_write_leaf(build, child);
        }
    }
}

/* Allocates and writes what stays. */
HYI_FN hydra_result hyi_collapse(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    uint32_t root = build->node_capacity - 1u;
    bool one_leaf = hyi_build_is_leaf(&build->nodes[root]);
    uint32_t nodes = one_leaf ? 0u : hyi_count_wide(build, root);
    HYI_TRY(hyi_alloc_array(build->context, &bvh->nodes, nodes));
    bvh->node_count = nodes;
    HYI_TRY(hyi_alloc_array(build->context, &bvh->ids, build->ref_count));
    bvh->slot_count = build->ref_count;
    if (build->positions) {
        HYI_TRY(hyi_alloc_array(build->context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count)));
        memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    }
    bvh->scale = build->scale;
    bvh->scaled = build->nodes[root].box;
    bvh->root = one_leaf ? hyi_make_leaf(0, build->ref_count) : 0u;
    if (one_leaf) {
        hyi_write_leaf(build, bvh->root);
    } else {
        hyi_write_wide(build, root);
        hyi_parallel(build->context, (nodes + HYI_BUILD_CHUNK - 1u) / HYI_BUILD_CHUNK, hyi_write_leaves_chunk, build);
    }
    bvh->bytes = (size_t)nodes * sizeof(hyi_node) + (size_t)bvh->slot_count * sizeof(uint32_t);
    if (bvh->rows) bvh->bytes += hyi_bvh_row_floats(bvh->slot_count) * sizeof(float);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COLLAPSE_H */
