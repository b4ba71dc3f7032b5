/* >>shared-fresnel: reflectance of smooth interfaces, mirrored and refracted directions

   cos_o is the cosine between the outgoing direction and the (micro) normal on its side, eta the index on
   the far side over the index on the near side. The formulas are rearranged so that nothing cancels as
   eta goes to 1. */
#ifndef HYK_FRESNEL_H
#define HYK_FRESNEL_H

#include "vector.h"

/* eta times the cosine of the refracted direction, from eta^2 cos_t^2 = cos_o^2 + eta^2 - 1;
   0: total internal reflection. */
HYK_FN hyk_real hyk_refracted_cosine(hyk_real cos_o, hyk_real eta) {
    return hyk_safe_sqrt(cos_o * cos_o + (eta - 1.0f) * (eta + 1.0f));
}

/* Unpolarised reflectance of a dielectric, of both cosines, g = eta cos_t. With e = eta^2 - 1 the amplitudes are
   r_s = -e / (cos_o + g)^2 and r_p = e (cos_o^2 (eta^2 + 1) - 1) / (eta^2 cos_o + g)^2. */
HYK_FN hyk_real hyk_fresnel_of_pair(hyk_real c, hyk_real g, hyk_real eta) {
    hyk_real e = (eta - 1.0f) * (eta + 1.0f);
    if (!(g > 0.0f)) return e == 0.0f ? 0.0f : 1.0f;
    hyk_real s = c + g, p = eta * eta * c + g;
    hyk_real r_s = e / (s * s);
    hyk_real r_p = e * (c * c * (eta * eta + 1.0f) - 1.0f) / (p * p);
    return hyk_min(0.5f * (r_s * r_s + r_p * r_p), 1.0f);
}
HYK_FN hyk_real hyk_fresnel_dielectric(hyk_real cos_o, hyk_real eta) {
    hyk_real c = hyk_saturate(cos_o);
    return hyk_fresnel_of_pair(c, hyk_refracted_cosine(c, eta), eta);
}

/* Unpolarised reflectance of a medium of index eta + i k. With (a + i b)^2 = (eta + i k)^2 - sin^2:
   R_s = |cos - (a + ib)|^2 / |cos + (a + ib)|^2 and R_p = R_s |(a + ib) cos - sin^2|^2 / |(a + ib) cos + sin^2|^2.
   The smaller of a and b comes from a b = eta k, so that it does not cancel. */
HYK_FN hyk_real hyk_fresnel_complex(hyk_real cos_o, hyk_real eta, hyk_real k) {
    hyk_real c = hyk_saturate(cos_o);
    hyk_real c2 = c * c, s2 = 1.0f - c2;
    hyk_real t = (eta - k) * (eta + k) - s2;
    hyk_real length = hyk_sqrt(t * t + 4.0f * eta * eta * k * k);
    hyk_real large = hyk_sqrt(0.5f * (length + hyk_abs(t)));
    hyk_real small_one = large > 0.0f ? eta * k / large : 0.0f;
    hyk_real a = t >= 0.0f ? large : small_one;
    hyk_real b = t >= 0.0f ? small_one : large;
    hyk_real below = hyk_square(a + c) + b * b;
    if (!(below > 0.0f)) return 1.0f;
    hyk_real r_s = (hyk_square(a - c) + b * b) / below;
    hyk_real below_p = hyk_square(a * c + s2) + b * b * c2;
    if (!(below_p > 0.0f)) return r_s;
    hyk_real r_p = r_s * (hyk_square(a * c - s2) + b * b * c2) / below_p;
    return hyk_min(0.5f * (r_s + r_p), 1.0f);
}

/* (1 - cos)^5, the shape of Schlick's approximation (1994); its hemispherical mean is 1/21. */
HYK_FN hyk_real hyk_schlick_weight(hyk_real cos_o) {
    hyk_real m = 1.0f - hyk_saturate(cos_o);
    hyk_real m2 = m * m;
    return m2 * m2 * m;
}
HYK_FN hyk_vec3 hyk_fresnel_schlick(hyk_vec3 f0, hyk_real cos_o) {
    hyk_real w = hyk_schlick_weight(cos_o);
    return hyk_add_scaled(hyk_splat(w), f0, 1.0f - w);
}
#define HYK_SCHLICK_MEAN HYK_C(1.0 / 21.0)

/* Mirror image of wo about the unit normal h, cos_o = dot(wo, h). */
HYK_FN hyk_vec3 hyk_reflect(hyk_vec3 wo, hyk_vec3 h, hyk_real cos_o) {
    return hyk_normalize(hyk_sub(hyk_scale(h, 2.0f * cos_o), wo));
}

/* Snell's law: the direction on the far side; g = hyk_refracted_cosine(cos_o, eta) > 0.
   cos_o - g is written as -(eta^2 - 1) / (cos_o + g). */
HYK_FN hyk_vec3 hyk_refract(hyk_vec3 wo, hyk_vec3 h, hyk_real cos_o, hyk_real g, hyk_real eta) {
    hyk_real along = -(eta - 1.0f) * (eta + 1.0f) / (cos_o + g);
    return hyk_normalize(hyk_sub(hyk_scale(h, along), wo));
}

#endif /* HYK_FRESNEL_H */
