/* >>shared-light-layouts: nodes of the light tree, and how the environment's sampling weights are laid out */
#ifndef HYK_LIGHT_LAYOUTS_H
#define HYK_LIGHT_LAYOUTS_H

#include "layouts.h"

/* Binary tree over the finite lights (Conty & Kulla 2018). */
HYK_STRUCT(hyk_light_node) {
    hyk_vec3 lower;
    hyk_real power;
    hyk_vec3 upper;
    hyk_real cos_o;  /* cone that bounds the lights' normals */
    hyk_vec3 axis;
    hyk_real cos_e;  /* how far off its normal a light still emits */
    hyk_uint child;  /* inner: index of the second child (the first is the next node); leaf: the light */
    hyk_uint is_leaf;
    hyk_uint both_sides;
    hyk_uint unused;
} HYK_END(hyk_light_node)
HYK_SIZE_IS(hyk_light_node, 64)

#endif /* HYK_LIGHT_LAYOUTS_H */
