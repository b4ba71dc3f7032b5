/* >>shared-microfacet: the GGX distribution, Smith masking and sampling of visible normals

   Local frame, z the macro normal, alpha the isotropic width. Slopes are taken from x and y, never from
   1 - z^2, and masking from sqrt(z^2 + alpha^2 (x^2 + y^2)), so that narrow lobes and grazing directions keep
   their bits (Walter et al. 2007; Heitz 2014, "Understanding the masking-shadowing function"). */
#ifndef HYK_MICROFACET_H
#define HYK_MICROFACET_H

#include "sampling.h"

/* Below this alpha (roughness 0.01) a surface is perfectly smooth. */
#define HYK_SMOOTH_ALPHA HYK_C(1e-4)

HYK_FN hyk_real hyk_alpha_of_roughness(hyk_real roughness) { return hyk_square(hyk_saturate(roughness)); }
HYK_FN hyk_bool hyk_is_smooth(hyk_real alpha) { return alpha < HYK_C(0.9999e-4); }

/* Density of micro normals, per steradian of normal and area of macro surface. */
HYK_FN hyk_real hyk_ggx_distribution(hyk_vec3 h, hyk_real alpha) {
    if (!(h.z > 0.0f)) return 0.0f;
    hyk_real x = h.x / alpha, y = h.y / alpha;
    hyk_real t = alpha * (x * x + y * y + h.z * h.z);
    return HYK_INV_PI / (t * t);
}

/* |cos| (1 + 2 Lambda) of the Smith masking function, 0 only for the zero vector. */
HYK_FN hyk_real hyk_ggx_stretch(hyk_vec3 w, hyk_real alpha) {
    return hyk_sqrt(w.z * w.z + alpha * alpha * (w.x * w.x + w.y * w.y));
}

/* Height-correlated G2(wo, wi) |cos wi| / (4 cos wo |cos wi|): times D and F this is f cos of reflection.
   Also used for transmission, as in today's renderers, with wi on the other side. */
HYK_FN hyk_real hyk_ggx_visibility(hyk_vec3 wo, hyk_vec3 wi, hyk_real alpha) {
    hyk_real o = hyk_abs(wo.z), i = hyk_abs(wi.z);
    return 0.5f * i / (i * hyk_ggx_stretch(wo, alpha) + o * hyk_ggx_stretch(wi, alpha));
}

/* 1 - G2 / G1(wo): what a visible normal loses of the direction it sends on. No difference of near equals:
   the stretch of wi minus its cosine is alpha^2 sin^2 / (their sum). */
HYK_FN hyk_real hyk_ggx_stopped(hyk_vec3 wo, hyk_vec3 wi, hyk_real alpha) {
    hyk_real o = hyk_abs(wo.z), i = hyk_abs(wi.z), stretch_i = hyk_ggx_stretch(wi, alpha);
    hyk_real over = alpha * alpha * (wi.x * wi.x + wi.y * wi.y) / (stretch_i + i);
    return hyk_min(o * over / (i * hyk_ggx_stretch(wo, alpha) + o * stretch_i), 1.0f);
}

/* Density of hyk_ggx_sample over 4 cos(wo, h): the density of the mirrored direction. */
HYK_FN hyk_real hyk_ggx_pdf_reflected(hyk_vec3 wo, hyk_real distribution, hyk_real alpha) {
    return 0.5f * distribution / (wo.z + hyk_ggx_stretch(wo, alpha));
}

/* A micro normal visible from wo, by the spherical cap that mirrors wo into the hemisphere (Dupuy &
   Benyoub 2023, "Sampling visible GGX normals with spherical caps"). wo.z >= 0; around: cosine and sine of the
   cap's azimuth. */
HYK_FN hyk_vec3 hyk_ggx_sample_around(hyk_vec3 wo, hyk_real alpha, hyk_vec2 around, hyk_real u) {
    hyk_vec3 w = hyk_normalize(hyk_make3(alpha * wo.x, alpha * wo.y, wo.z));
    hyk_real z = (1.0f - u) * (1.0f + w.z) - w.z;
    hyk_real r = hyk_safe_sqrt((1.0f - z) * (1.0f + z));
    hyk_vec3 h = hyk_make3(r * around.x + w.x, r * around.y + w.y, z + w.z);
    return hyk_normalize(hyk_make3(alpha * h.x, alpha * h.y, hyk_max(h.z, HYK_REAL_EPSILON * HYK_REAL_EPSILON)));
}
HYK_FN hyk_vec3 hyk_ggx_sample(hyk_vec3 wo, hyk_real alpha, hyk_vec2 u) {
    hyk_real phi = HYK_TWO_PI * u.x;
    return hyk_ggx_sample_around(wo, alpha, hyk_make2(hyk_cos(phi), hyk_sin(phi)), u.y);
}

/* Half vector of a pair on the same side. */
HYK_FN hyk_vec3 hyk_half_reflected(hyk_vec3 wo, hyk_vec3 wi) { return hyk_normalize(hyk_add(wo, wi)); }

/* Half vector of a refracted pair, on the side of +z (Walter et al. 2007, eq. 16). */
HYK_FN hyk_vec3 hyk_half_refracted(hyk_vec3 wo, hyk_vec3 wi, hyk_real eta) {
    hyk_vec3 h = hyk_normalize(hyk_add_scaled(wo, wi, eta));
    if (h.z < 0.0f) return hyk_neg(h);
    return h;
}

/* 4 cos_o times d omega_h / d omega_i of refraction, eta^2 |wi.h| / (wo.h + eta wi.h)^2, with g = eta cos_t and
   |wo.h + eta wi.h| = |eta^2 - 1| / (cos_o + g). Turns the visibility and the pdf of reflection into those of
   transmission. Zero under total internal reflection. */
HYK_FN hyk_real hyk_refraction_jacobian(hyk_real cos_o, hyk_real g, hyk_real eta) {
    hyk_real inverse = (cos_o + g) / ((eta - 1.0f) * (eta + 1.0f));
    return 4.0f * cos_o * eta * g * inverse * inverse;
}

/* ---- directions for light that masking took away once: it leaves in proportion to 1 - E(cos), which falls
   like alpha^2 / (cos^2 + alpha^2). p(cos) is proportional to cos / (cos^2 + alpha^2), inverted exactly. */

HYK_FN hyk_real hyk_lost_norm(hyk_real alpha) { return hyk_log2(1.0f + 1.0f / (alpha * alpha)); }

HYK_FN hyk_vec3 hyk_lost_sample(hyk_real alpha, hyk_vec2 u) {
    hyk_real a2 = alpha * alpha;
    hyk_real z2 = hyk_min(a2 * (hyk_exp2(u.x * hyk_lost_norm(alpha)) - 1.0f), 1.0f);
    hyk_real z = hyk_max(hyk_safe_sqrt(z2), alpha * HYK_REAL_EPSILON);
    hyk_real r = hyk_safe_sqrt(1.0f - z2), phi = HYK_TWO_PI * u.y;
    return hyk_make3(r * hyk_cos(phi), r * hyk_sin(phi), z);
}

HYK_FN hyk_real hyk_lost_pdf(hyk_real cos_i, hyk_real alpha) {
    hyk_real c = hyk_abs(cos_i);
    /* log2 e = 1.4427: the norm is a binary logarithm */
    return HYK_INV_PI * HYK_C(1.44269504088896340736) * c / ((c * c + alpha * alpha) * hyk_lost_norm(alpha));
}

#endif /* HYK_MICROFACET_H */
