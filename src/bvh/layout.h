/* >>bvh-layout: what a built tree looks like in memory

   Eight-wide nodes: one AVX register holds one plane of all eight children. A leaf has one to eight
   triangles, its nine coordinates each as a row of exactly as many floats as there are triangles: no
   lane is stored that is not used, so the same bytes hold a third more triangles in cache than padded
   blocks do. A reader of eight lanes reads past the end of a row, into the next one, and masks.
   Ids stand apart: only hits look at them. */
#ifndef HYI_BVH_LAYOUT_H
#define HYI_BVH_LAYOUT_H

#include "../base/threads.h"

#define HYI_WIDTH 8u
#define HYI_LEAF_MAX 8u
#define HYI_LEAF_MAX_DEVICE 4u /* where lanes are rays, and triangles are met one after the other */
#define HYI_TREE_DEPTH 56u /* levels of the binary tree, and so of the wide one */
#define HYI_PRIMITIVES_MAX (1u << 28)
#define HYI_EMPTY_PLANE 1.0e38f

/* A child: bit 31 set: a leaf, bits 28..30 its count - 1, bits 0..27 its first slot; clear: a node's index. */
#define HYI_CHILD_LEAF 0x80000000u
#define HYI_CHILD_SLOT 0x0fffffffu
#define HYI_CHILD_NONE 0x7fffffffu

typedef struct hyi_box {
    float lower[3], upper[3];
} hyi_box;

/* Planes in the order lower x, upper x, lower y, upper y, lower z, upper z. Unused children are inside out. */
typedef struct hyi_node {
    float planes[6][HYI_WIDTH];
    uint32_t child[HYI_WIDTH];
    uint32_t unused[HYI_WIDTH]; /* fills the fourth cache line */
} hyi_node;

/* All zero: empty, valid, hit by nothing. Nodes and triangles are in units of 1 / scale, a power of two
   that keeps products of three coordinates inside float's range. */
typedef struct hyi_bvh {
    hyi_node *nodes;
    float *rows;      /* 9 floats a slot; NULL: a tree over boxes */
    uint32_t *ids;    /* by slot: triangle or box */
    uint32_t root;    /* a child */
    uint32_t node_count, slot_count, depth;
    float scale;
    hyi_box scaled;   /* bounds times scale */
    hyi_box bounds;
    uint32_t degenerate;      /* triangles dropped */
    uint32_t primitive_count; /* those in the tree */
    size_t bytes;
} hyi_bvh;

/* Eight lanes read from the last row of the last leaf. */
#define HYI_ROWS_PADDING 8u

HYI_INLINE size_t hyi_bvh_row_floats(uint32_t slots) { return (size_t)slots * 9u + HYI_ROWS_PADDING; }

HYI_INLINE uint32_t hyi_make_leaf(uint32_t first, uint32_t count) {
    return HYI_CHILD_LEAF | ((count - 1u) << 28) | first;
}
HYI_INLINE bool hyi_child_is_leaf(uint32_t child) { return (child & HYI_CHILD_LEAF) != 0u; }
HYI_INLINE uint32_t hyi_leaf_count(uint32_t child) { return ((child >> 28) & 7u) + 1u; }
HYI_INLINE uint32_t hyi_leaf_first(uint32_t child) { return child & HYI_CHILD_SLOT; }

/* Leaves it zeroed. */
HYI_FN void hyi_bvh_free(hydra_context *context, hyi_bvh *bvh) {
    hyi_free_array(context, &bvh->nodes, bvh->node_count);
    if (bvh->rows) hyi_free_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    hyi_free_array(context, &bvh->ids, bvh->slot_count);
    memset(bvh, 0, sizeof *bvh);
}

/* Index of the lowest set bit; mask is not 0. */
HYI_INLINE uint32_t hyi_lowest_bit(uint32_t mask) {
#if HYI_GNU
    return (uint32_t)__builtin_ctz(mask);
#else
    unsigned long index;
    _BitScanForward(&index, mask);
    return (uint32_t)index;
#endif
}

/* ---- boxes */

HYI_INLINE hyi_box hyi_box_empty(void) {
    hyi_box box;
    for (int a = 0; a < 3; a++) {
        box.lower[a] = FLT_MAX;
        box.upper[a] = -FLT_MAX;
    }
    return box;
}

HYI_INLINE void hyi_box_add(hyi_box *box, const float *lower, const float *upper) {
    for (int a = 0; a < 3; a++) {
        box->lower[a] = lower[a] < box->lower[a] ? lower[a] : box->lower[a];
        box->upper[a] = upper[a] > box->upper[a] ? upper[a] : box->upper[a];
    }
}

/* The largest size of a coordinate. */
HYI_INLINE float hyi_box_largest(const hyi_box *box) {
    float largest = 0.0f;
    for (int a = 0; a < 3; a++) {
        largest = fabsf(box->lower[a]) > largest ? fabsf(box->lower[a]) : largest;
        largest = fabsf(box->upper[a]) > largest ? fabsf(box->upper[a]) : largest;
    }
    return largest;
}

/* Half of the surface, in double: squares of the smallest and largest floats stay in range. Empty: 0. */
HYI_INLINE double hyi_box_area(const hyi_box *box) {
    double x = (double)box->upper[0] - (double)box->lower[0];
    double y = (double)box->upper[1] - (double)box->lower[1];
    double z = (double)box->upper[2] - (double)box->lower[2];
    return x < 0.0 ? 0.0 : x * y + y * z + z * x;
}

/* Eight planes of a node by the place of the first, which is a row's number times HYI_WIDTH. */
HYI_INLINE const float *hyi_planes_at(const hyi_node *node, uint32_t place) { return (const float *)(const void *)node->planes + place; }

/* ---- nodes, for whoever does not build or pass them: all that knows how they lie in memory */

/* HYI_CHILD_NONE: there is no such child, nor one behind it. */
HYI_INLINE uint32_t hyi_node_child(const hyi_bvh *bvh, uint32_t node, uint32_t c) { return bvh->nodes[node].child[c]; }

/* In the tree's units. */
HYI_INLINE hyi_box hyi_node_box(const hyi_bvh *bvh, uint32_t node, uint32_t c) {
    hyi_box box;
    for (int a = 0; a < 3; a++) {
        box.lower[a] = bvh->nodes[node].planes[2 * a][c];
        box.upper[a] = bvh->nodes[node].planes[2 * a + 1][c];
    }
    return box;
}

/* Where the first float of a triangle lies in its leaf; the other eight follow at distances of count. */
HYI_INLINE float *hyi_leaf_lane(const hyi_bvh *bvh, uint32_t first, uint32_t lane) { return bvh->rows + 9u * (size_t)first + lane; }

#endif /* HYI_BVH_LAYOUT_H */
