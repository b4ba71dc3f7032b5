/* >>shared-tree: the compressed eight-wide nodes that devices walk

   After Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs": the boxes
   of a node's children are numbers of 8 bits on a grid of the node's own, whose steps are powers of two, rounded outwards.
   A child's place says in which octant of the node it lies, so that a ray finds its order by one exclusive or. Other than
   there, leaves may hold eight triangles, and each has a field of its own instead of a unary code. */
#ifndef HYK_TREE_H
#define HYK_TREE_H

#include "layouts.h"

/* Words of a node. Words 12 to 23: lower x, upper x, lower y, upper y, lower z, upper z, eight bytes each. */
#define HYK_NODE_WORDS 24u
#define HYK_NODE_ORIGIN 0u   /* three floats */
#define HYK_NODE_STEPS 3u    /* exponents of the grid's steps, biased as in a float, a byte an axis; top byte: which places have a child */
/* Four words for places 0 to 3, and four for the others, so that one fetch tells of a child: the first child that is a
   node, the first slot of the leaves, and 16 bits a place: count of slots << 8 | which of the slots, or with no slots
   which of the nodes. */
#define HYK_NODE_LINKS 4u
#define HYK_NODE_PLANES 12u

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
