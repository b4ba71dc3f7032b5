/* >>shared-tree: the compressed eight-wide nodes that devices walk

   After Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs": the boxes
   of a node's children are numbers of 8 bits on a grid of the node's own, whose steps are powers of two, rounded outwards.
   A child's place says in which octant of the node it lies, so that a ray finds its order by one exclusive or. Other than
   there, leaves hold up to four triangles, and children that are nodes stand at their places in memory too, with gaps where
   a place between them is a leaf's: one addition finds them. */
#ifndef HYK_TREE_H
#define HYK_TREE_H

#include "layouts.h"

/* Words of a node. Words 8 to 19: lower x, upper x, lower y, upper y, lower z, upper z, eight bytes each. */
#define HYK_NODE_WORDS 20u
#define HYK_NODE_TEXELS 5u   /* four words each */
#define HYK_NODE_ORIGIN 0u   /* three floats */
#define HYK_NODE_STEPS 3u    /* exponents of the grid's steps, biased as in a float, a byte an axis; top byte: which places have a node */
#define HYK_NODE_CHILDREN 4u /* the node at a place is this + the place */
#define HYK_NODE_SLOTS 5u    /* the first of its leaves' slots */
#define HYK_NODE_LEAVES 6u   /* a byte a place: the first of a leaf's slots, counted from there | HYK_LEAF_MOST less their count << 5 */
#define HYK_NODE_PLANES 8u

/* Slots of a leaf: those of a node's leaves are then bits of one word. A place without a leaf lacks all of them. */
#define HYK_LEAF_MOST 4u

/* Nodes of one tree; the others of a stack's word tell which of its children wait. */
#define HYK_NODES_MOST 0x00ffffffu

/* A triangle: corners in units of 1 / scale of its tree. In a tree over boxes only item counts. */
HYK_STRUCT(hyk_slot) {
    hyk_vec3 a;
    hyk_uint item; /* triangle of the mesh, or of the world; instance; shape */
    hyk_vec3 b;
    hyk_uint unused0;
    hyk_vec3 c;
    hyk_uint unused1;
} HYK_END(hyk_slot)
HYK_SIZE_IS(hyk_slot, 48)

#define HYK_TREE_EMPTY 0xffffffffu
HYK_STRUCT(hyk_tree) {
    hyk_vec3 lower; /* times scale, as upper */
    hyk_real scale;
    hyk_vec3 upper;
    hyk_uint first_node; /* the root; HYK_TREE_EMPTY: there is nothing in it */
    hyk_uint first_slot;
    hyk_uint asks_alpha; /* not 0: hyk_hit_is_opaque must be asked of its triangles */
    hyk_uint meshes;     /* the world: how many it is over, see hyi_accel.world_count; 0: none */
    hyk_uint unused;
} HYK_END(hyk_tree)
HYK_SIZE_IS(hyk_tree, 48)

/* Which tree is which. */
#define HYK_TREE_TOP 0u    /* over the world and the other instances; unused where one tree is all */
#define HYK_TREE_WORLD 1u  /* over all unmoved meshes, or the one mesh that is all */
#define HYK_TREE_SHAPES 2u /* over the shapes of lights; an item is the light */
#define HYK_TREE_MESHES 3u /* of mesh m: this + m */

#endif /* HYK_TREE_H */
