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

/* Gaps between nodes, at most. */
HYI_INLINE uint32_t hyi_vk_gaps_of(uint32_t nodes) { return nodes / 4u + HYI_WIDTH; }

/* Leaves that get a node of their own. */
HYI_FN uint32_t hyi_vk_large_leaves(const hyi_bvh *bvh) {
    uint32_t large = 0;
    for (uint32_t i = 0; i < bvh->node_count; i++)
        for (uint32_t p = 0; p < HYI_WIDTH; p++) {
            uint32_t child = bvh->nodes[i].child[p];
            if (hyi_child_is_leaf(child) && hyi_leaf_count(child) > HYK_LEAF_MOST) large++;
        }
    return large;
}

/* At most, with gaps. */
HYI_FN uint32_t hyi_vk_nodes_of(const hyi_bvh *bvh) {
    if (!bvh->primitive_count) return 0;
    uint32_t nodes = bvh->node_count + hyi_vk_large_leaves(bvh);
    return nodes ? nodes + hyi_vk_gaps_of(nodes) : 1u;
}

HYI_FN uint32_t hyi_vk_slots_of(const hyi_bvh *bvh) { return bvh->primitive_count ? bvh->slot_count : 0u; }

/* A child on its way into a node: its box, and what it is. */
typedef struct hyi_vk_child {
    float box[6]; /* lower x, upper x, lower y, ... */
    uint32_t child;
    uint32_t lane, lanes; /* which of a leaf's triangles; lanes 0: a node */
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

/* A node that waits to be planted: a node of the tree, or a leaf too large for one place. */
typedef struct hyi_vk_seed {
    hyi_vk_child from;
    uint32_t to;
} hyi_vk_seed;

typedef struct hyi_vk_planting {
    const hyi_bvh *bvh;
    hyi_vk_forest *forest;
    uint32_t first_node, next_node; /* the latter from the former, as all of a node's links */
    uint32_t first_slot, next_slot;
    uint32_t gaps; /* that there may still be */
    hyi_vk_seed waiting[HYI_STACK];
    uint32_t waiting_count;
} hyi_vk_planting;

/* The parts of a leaf, in its box. */
HYI_FN uint32_t hyi_vk_part_leaf(const hyi_vk_child *leaf, hyi_vk_child *parts) {
    uint32_t count = hyi_leaf_count(leaf->child), n = 0;
    for (uint32_t lane = 0; lane < count; lane += HYK_LEAF_MOST, n++) {
        parts[n] = *leaf;
        parts[n].lane = lane;
        parts[n].lanes = count - lane < HYK_LEAF_MOST ? count - lane : HYK_LEAF_MOST;
    }
    return n;
}

HYI_FN uint32_t hyi_vk_gather_children(const hyi_bvh *bvh, const hyi_vk_child *of, hyi_vk_child *children) {
    uint32_t count = 0;
    if (hyi_child_is_leaf(of->child)) return hyi_vk_part_leaf(of, children);
    const hyi_node *from = &bvh->nodes[of->child];
    for (uint32_t i = 0; i < HYI_WIDTH; i++) {
        hyi_vk_child *c = &children[count];
        if (from->child[i] == HYI_CHILD_NONE) continue;
        for (uint32_t p = 0; p < 6; p++) c->box[p] = from->planes[p][i];
        c->child = from->child[i];
        c->lane = 0;
        c->lanes = hyi_child_is_leaf(c->child) && hyi_leaf_count(c->child) <= HYK_LEAF_MOST ? hyi_leaf_count(c->child) : 0u;
        count++;
    }
    return count;
}

/* Where those of a node's children stand that are nodes: from the first of their places to the last. */
HYI_FN uint32_t hyi_vk_span(const hyi_vk_child *children, uint32_t count, const uint32_t place_of[HYI_WIDTH], uint32_t *lowest, uint32_t *nodes) {
    uint32_t end = 0;
    *lowest = HYI_WIDTH;
    *nodes = 0;
    for (uint32_t c = 0; c < count; c++) {
        if (children[c].lanes) continue;
        if (place_of[c] < *lowest) *lowest = place_of[c];
        if (place_of[c] >= end) end = place_of[c] + 1;
        ++*nodes;
    }
    return end;
}

/* Without gaps, and without an order. */
HYI_FN void hyi_vk_pack_places(const hyi_vk_child *children, uint32_t count, uint32_t place_of[HYI_WIDTH]) {
    uint32_t next = 0;
    for (uint32_t turn = 0; turn < 2; turn++)
        for (uint32_t c = 0; c < count; c++)
            if ((children[c].lanes != 0) == (turn != 0)) place_of[c] = next++;
}

/* Places for the children of a node, and nodes for those that are nodes. Returns what the place is added to. */
HYI_FN uint32_t hyi_vk_allot(hyi_vk_planting *planting, const hyi_vk_child *children, uint32_t count, uint32_t place_of[HYI_WIDTH]) {
    uint32_t lowest, nodes, end;
    hyi_vk_choose_places(children, count, place_of);
    end = hyi_vk_span(children, count, place_of, &lowest, &nodes);
    if (!nodes) return 0;
    uint32_t base = planting->next_node > lowest ? planting->next_node - lowest : 0u, gaps = base + end - planting->next_node - nodes;
    if (gaps > planting->gaps) {
        hyi_vk_pack_places(children, count, place_of);
        base = planting->next_node;
        end = nodes;
        gaps = 0;
    }
    planting->gaps -= gaps;
    planting->next_node = base + end;
    return base;
}

HYI_FN void hyi_vk_plant_leaf(hyi_vk_planting *planting, const hyi_vk_child *leaf) {
    for (uint32_t i = 0; i < leaf->lanes; i++)
        hyi_vk_write_slot(planting->bvh, leaf->child, leaf->lane + i, &planting->forest->slots[planting->first_slot + planting->next_slot++]);
}

/* One node; its children that are nodes then wait. */
HYI_FN void hyi_vk_plant_node(hyi_vk_planting *planting, uint32_t index, const hyi_vk_child *children, uint32_t count) {
    uint32_t node[HYK_NODE_WORDS] = { 0 }, place_of[HYI_WIDTH];
    uint8_t leaves[HYI_WIDTH];
    node[HYK_NODE_CHILDREN] = hyi_vk_allot(planting, children, count, place_of);
    node[HYK_NODE_SLOTS] = planting->next_slot;
    for (uint32_t p = 0; p < HYI_WIDTH; p++) leaves[p] = HYK_LEAF_MOST << 5;
    for (uint32_t c = 0; c < count; c++) {
        if (children[c].lanes) {
            leaves[place_of[c]] = (uint8_t)((HYK_LEAF_MOST - children[c].lanes) << 5 | (planting->next_slot - node[HYK_NODE_SLOTS]));
            hyi_vk_plant_leaf(planting, &children[c]);
        } else {
            hyi_vk_seed *seed = &planting->waiting[planting->waiting_count++];
            seed->from = children[c];
            seed->to = node[HYK_NODE_CHILDREN] + place_of[c];
            node[HYK_NODE_STEPS] |= 1u << (24 + place_of[c]);
        }
    }
    for (uint32_t p = 0; p < HYI_WIDTH; p++) node[HYK_NODE_LEAVES + p / 4] |= (uint32_t)leaves[p] << 8 * (p % 4);
    hyi_vk_write_planes(node, children, count, place_of);
    memcpy(planting->forest->nodes + (size_t)HYK_NODE_WORDS * (planting->first_node + index), node, sizeof node);
}

/* Depth first, so that what lies together stands together. A tree that is one leaf gets a node above it. */
HYI_FN void hyi_vk_plant_nodes(hyi_vk_planting *planting) {
    const hyi_bvh *bvh = planting->bvh;
    hyi_vk_child children[HYI_WIDTH];
    hyi_vk_seed *root = &planting->waiting[0];
    for (uint32_t a = 0; a < 3; a++) {
        root->from.box[2 * a] = bvh->scaled.lower[a];
        root->from.box[2 * a + 1] = bvh->scaled.upper[a];
    }
    root->from.child = bvh->root;
    root->to = 0;
    planting->waiting_count = planting->next_node = 1;
    while (planting->waiting_count) {
        hyi_vk_seed at = planting->waiting[--planting->waiting_count];
        hyi_vk_plant_node(planting, at.to, children, hyi_vk_gather_children(bvh, &at.from, children));
    }
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
    planting.gaps = hyi_vk_gaps_of(bvh->node_count);
    tree.first_node = planting.first_node = forest->node_count;
    tree.first_slot = planting.first_slot = forest->slot_count;
    hyi_vk_plant_nodes(&planting);
    forest->node_count += planting.next_node;
    forest->slot_count += planting.next_slot;
    return tree;
}

#endif /* HYI_VK_TREE_H */
