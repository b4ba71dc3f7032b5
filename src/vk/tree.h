/* >>vk-tree: trees of the processor turned into those of a device (shared/tree.h) */
#ifndef HYI_VK_TREE_H
#define HYI_VK_TREE_H

#include "../../shaders/shared/tree.h"
#include "functions.h"

/* Where nodes and slots of all trees are written, one tree after the other. */
typedef struct hyi_vk_forest {
    uint32_t *nodes; /* HYK_NODE_WORDS each */
    hyk_slot *slots;
    uint32_t node_count, slot_count; /* written so far */
} hyi_vk_forest;

HYI_FN uint32_t hyi_vk_nodes_of(const hyi_bvh *bvh) { return !bvh->primitive_count ? 0u : bvh->node_count ? bvh->node_count : 1u; }
HYI_FN uint32_t hyi_vk_slots_of(const hyi_bvh *bvh) { return bvh->primitive_count ? bvh->slot_count : 0u; }

/* A child on its way into a node: its box, and what it is. */
typedef struct hyi_vk_child {
    float box[6]; /* lower x, upper x, lower y, ... */
    uint32_t child;
} hyi_vk_child;

/* ---- which place a child takes */

/* How far from center along the diagonal of place's octant a child's middle lies. Larger: it belongs there more. */
HYI_FN double hyi_vk_belongs(const hyi_vk_child *child, const double center[3], uint32_t place) {
    double sum = 0.0;
    for (uint32_t a = 0; a < 3; a++) {
        double middle = 0.5 * ((double)child->box[2 * a] + (double)child->box[2 * a + 1]) - center[a];
        sum += place >> a & 1u ? middle : -middle;
    }
    return sum;
}

/* The mean of the children's middles. */
HYI_FN void hyi_vk_center(const hyi_vk_child *children, uint32_t count, double center[3]) {
    for (uint32_t a = 0; a < 3; a++) {
        center[a] = 0.0;
        for (uint32_t c = 0; c < count; c++) center[a] += 0.5 / count * ((double)children[c].box[2 * a] + (double)children[c].box[2 * a + 1]);
    }
}

/* Gives each of count children a place of its own, best fits first (Ylitie et al. 2017, section 3.2, with greedy choice). */
HYI_FN void hyi_vk_choose_places(const hyi_vk_child *children, uint32_t count, uint32_t place_of[HYI_WIDTH]) {
    uint32_t placed = 0, taken = 0;
    double center[3];
    hyi_vk_center(children, count, center);
    for (uint32_t n = 0; n < count; n++) {
        uint32_t best_child = 0, best_place = 0;
        double best = -DBL_MAX;
        for (uint32_t c = 0; c < count; c++)
            for (uint32_t p = 0; p < HYI_WIDTH; p++) {
                double fit = placed >> c & 1u || taken >> p & 1u ? -DBL_MAX : hyi_vk_belongs(&children[c], center, p);
                if (fit > best) best = fit, best_child = c, best_place = p;
            }
        place_of[best_child] = best_place;
        placed |= 1u << best_child;
        taken |= 1u << best_place;
    }
}

/* ---- the grid */

/* Exponent, biased, of the smallest step whose 255 fold reaches from lower to upper. */
HYI_FN uint32_t hyi_vk_step(float lower, float upper) {
    int exponent;
    double extent = (double)upper - (double)lower;
    if (!(extent > 0.0)) return 1u;
    double part = frexp(extent / 255.0, &exponent); /* part in [1/2, 1) */
    if (part == 0.5) exponent--;
    while (ceil(ldexp(extent, -exponent)) > 255.0) exponent++;
    return exponent < -126 ? 1u : (uint32_t)(exponent + 127);
}

HYI_FN void hyi_vk_write_planes(uint32_t *node, const hyi_vk_child *children, uint32_t count, const uint32_t place_of[HYI_WIDTH]) {
    unsigned char planes[6][HYI_WIDTH];
    uint32_t steps = 0;
    memset(planes, 0, sizeof planes);
    for (uint32_t a = 0; a < 3; a++) {
        float lower = children[0].box[2 * a], upper = children[0].box[2 * a + 1];
        for (uint32_t c = 1; c < count; c++) {
            lower = fminf(lower, children[c].box[2 * a]);
            upper = fmaxf(upper, children[c].box[2 * a + 1]);
        }
        uint32_t exponent = hyi_vk_step(lower, upper);
        double to_steps = ldexp(1.0, 127 - (int)exponent);
        steps |= exponent << 8 * a;
        memcpy(&node[HYK_NODE_ORIGIN + a], &lower, sizeof lower);
        for (uint32_t c = 0; c < count; c++) {
            planes[2 * a][place_of[c]] = (unsigned char)floor(((double)children[c].box[2 * a] - (double)lower) * to_steps);
            planes[2 * a + 1][place_of[c]] = (unsigned char)ceil(((double)children[c].box[2 * a + 1] - (double)lower) * to_steps);
        }
    }
    node[HYK_NODE_STEPS] |= steps;
    for (uint32_t i = 0; i < 6 * HYI_WIDTH; i++) node[HYK_NODE_PLANES + i / 4] |= (uint32_t)planes[i / HYI_WIDTH][i % HYI_WIDTH] << 8 * (i % 4);
}

/* ---- slots */

HYI_FN void hyi_vk_write_slot(const hyi_bvh *bvh, uint32_t leaf, uint32_t lane, hyk_slot *slot) {
    uint32_t count = hyi_leaf_count(leaf), first = hyi_leaf_first(leaf);
    memset(slot, 0, sizeof *slot);
    slot->item = bvh->ids[first + lane];
    if (!bvh->rows) return;
    const float *row = bvh->rows + (size_t)9 * first + lane;
    slot->a = hyk_make3(row[0], row[count], row[2 * count]);
    slot->b = hyk_make3(row[3 * count], row[4 * count], row[5 * count]);
    slot->c = hyk_make3(row[6 * count], row[7 * count], row[8 * count]);
}

/* ---- nodes */

typedef struct hyi_vk_planting {
    const hyi_bvh *bvh;
    hyi_vk_forest *forest;
    uint32_t first_node, first_slot, next_node, next_slot;
} hyi_vk_planting;

HYI_FN uint32_t hyi_vk_gather_children(const hyi_node *from, hyi_vk_child *children) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < HYI_WIDTH; i++) {
        if (from->child[i] == HYI_CHILD_NONE) continue;
        for (uint32_t p = 0; p < 6; p++) children[count].box[p] = from->planes[p][i];
        children[count++].child = from->child[i];
    }
    return count;
}

HYI_FN void hyi_vk_link(uint32_t *node, uint32_t place, uint32_t field) {
    node[HYK_NODE_LINKS + place / 4 * 4 + 2 + place / 2 % 2] |= field << 16 * (place % 2);
}

HYI_FN void hyi_vk_plant_leaf(hyi_vk_planting *planting, uint32_t *node, uint32_t leaf, uint32_t place, uint32_t offset) {
    uint32_t count = hyi_leaf_count(leaf);
    hyi_vk_link(node, place, count << 8 | offset);
    for (uint32_t i = 0; i < count; i++)
        hyi_vk_write_slot(planting->bvh, leaf, i, &planting->forest->slots[planting->first_slot + planting->next_slot++]);
}

/* One node; below[] gets its children that are nodes, in order of place. Returns how many. */
HYI_FN uint32_t hyi_vk_plant_node(hyi_vk_planting *planting, uint32_t index, const hyi_vk_child *children, uint32_t count, uint32_t below[HYI_WIDTH]) {
    uint32_t node[HYK_NODE_WORDS] = { 0 }, place_of[HYI_WIDTH], child_at[HYI_WIDTH], inner = 0;
    hyi_vk_choose_places(children, count, place_of);
    for (uint32_t p = 0; p < HYI_WIDTH; p++) child_at[p] = HYI_CHILD_NONE;
    for (uint32_t c = 0; c < count; c++) child_at[place_of[c]] = children[c].child;
    const uint32_t first_slot = planting->next_slot;
    node[HYK_NODE_LINKS] = node[HYK_NODE_LINKS + 4] = planting->next_node;
    node[HYK_NODE_LINKS + 1] = node[HYK_NODE_LINKS + 5] = first_slot;
    for (uint32_t p = 0; p < HYI_WIDTH; p++) {
        if (child_at[p] == HYI_CHILD_NONE) continue;
        node[HYK_NODE_STEPS] |= 1u << (24 + p);
        if (hyi_child_is_leaf(child_at[p])) {
            hyi_vk_plant_leaf(planting, node, child_at[p], p, planting->next_slot - first_slot);
        } else {
            hyi_vk_link(node, p, inner);
            below[inner++] = child_at[p];
        }
    }
    planting->next_node += inner;
    hyi_vk_write_planes(node, children, count, place_of);
    memcpy(planting->forest->nodes + (size_t)HYK_NODE_WORDS * (planting->first_node + index), node, sizeof node);
    return inner;
}

typedef struct hyi_vk_pair { uint32_t from, to; } hyi_vk_pair;

/* Depth first, so that what lies together stands together. */
HYI_FN void hyi_vk_plant_nodes(hyi_vk_planting *planting) {
    hyi_vk_pair stack[HYI_STACK];
    hyi_vk_child children[HYI_WIDTH];
    uint32_t waiting = 1, below[HYI_WIDTH];
    stack[0].from = planting->bvh->root;
    stack[0].to = 0;
    planting->next_node = 1;
    while (waiting) {
        hyi_vk_pair at = stack[--waiting];
        uint32_t first = planting->next_node, count = hyi_vk_gather_children(&planting->bvh->nodes[at.from], children);
        uint32_t inner = hyi_vk_plant_node(planting, at.to, children, count, below);
        for (uint32_t i = inner; i-- > 0; waiting++) {
            stack[waiting].from = below[i];
            stack[waiting].to = first + i;
        }
    }
}

/* A tree that is one leaf gets a node above it. */
HYI_FN void hyi_vk_plant_leaf_alone(hyi_vk_planting *planting) {
    hyi_vk_child only;
    uint32_t below[HYI_WIDTH];
    for (uint32_t a = 0; a < 3; a++) {
        only.box[2 * a] = planting->bvh->scaled.lower[a];
        only.box[2 * a + 1] = planting->bvh->scaled.upper[a];
    }
    only.child = planting->bvh->root;
    planting->next_node = 1;
    hyi_vk_plant_node(planting, 0, &only, 1, below);
}

/* Appends bvh to the forest; what remains to be set in the record is asks_alpha and meshes. */
HYI_FN hyk_tree hyi_vk_plant(const hyi_bvh *bvh, hyi_vk_forest *forest) {
    hyi_vk_planting planting;
    hyk_tree tree;
    memset(&tree, 0, sizeof tree);
    tree.first_node = HYK_TREE_EMPTY;
    if (!bvh->primitive_count) return tree;
    tree.lower = hyk_make3(bvh->scaled.lower[0], bvh->scaled.lower[1], bvh->scaled.lower[2]);
    tree.upper = hyk_make3(bvh->scaled.upper[0], bvh->scaled.upper[1], bvh->scaled.upper[2]);
    tree.scale = bvh->scale;
    memset(&planting, 0, sizeof planting);
    planting.bvh = bvh;
    planting.forest = forest;
    tree.first_node = planting.first_node = forest->node_count;
    tree.first_slot = planting.first_slot = forest->slot_count;
    if (hyi_child_is_leaf(bvh->root)) hyi_vk_plant_leaf_alone(&planting);
    else hyi_vk_plant_nodes(&planting);
    forest->node_count += planting.next_node;
    forest->slot_count += planting.next_slot;
    return tree;
}

#endif /* HYI_VK_TREE_H */
