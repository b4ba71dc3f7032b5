/* >>shared-light-layouts: nodes of the light tree, and how the environment's sampling weights are laid out */
#ifndef HYK_LIGHT_LAYOUTS_H
#define HYK_LIGHT_LAYOUTS_H

#include "layouts.h"

/* Binary tree over the finite lights (Conty & Kulla 2018), in depth-first order; node 0 is the root. */
HYK_STRUCT(hyk_light_node) {
    hyk_vec3 lower;
    hyk_real intensity; /* luminance of the largest intensity (W/sr) the lights can send, summed */
    hyk_vec3 upper;
    hyk_real cos_o;  /* cone that bounds the lights' normals; -1: any direction */
    hyk_vec3 axis;
    hyk_real cos_e;  /* how far off its normal a light still emits */
    hyk_uint child;  /* inner: index of the second child (the first is the next node); leaf: the light */
    hyk_uint is_leaf;
    hyk_uint both_sides; /* some light also emits against its normal */
    hyk_uint unused;
} HYK_END(hyk_light_node)
HYK_SIZE_IS(hyk_light_node, 64)

#define HYK_LIGHT_TREE_DEPTH 32u /* most choices from the root to a light: the bits of tree_path */

/* Environment map of width w and height h, sampled over the cells between texel centres, where the bilinear
   lookup has one formula: w columns (column x from the centre of texel x to that of x + 1, wrapping round) by
   h + 1 rows (row y from the centre of texel row y - 1 to that of row y; rows 0 and h are the halves at the
   poles). A cell weighs its solid angle times the mean luminance of its four corners;
   environment_integral is the sum of all weights.

   Cells are found by bisection of first the rows, then the columns of that row: the range [first, last) splits
   at m = (first + last) / 2, and the number at m says how: x >= 0: the lower half has the share x of the weight,
   x < 0: the upper half has the share -x. The smaller share is stored, so that shares of 1e-20 keep all bits.
   HYK_LOAD_ENVIRONMENT_CDF: [m], 0 < m < h + 1: rows; [(h + 1) + w * row + m], 0 < m < w: columns. */
#define HYK_ENVIRONMENT_CDF_COUNT(w, h) (((h) + 1u) + (w) * ((h) + 1u))

#endif /* HYK_LIGHT_LAYOUTS_H */
