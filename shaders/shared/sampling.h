/* >>shared-sampling: warps of the unit square, their densities, and the weights of multiple importance sampling

   Every warp takes u in [0, 1)^2. Directions are local: z is the axis. Densities are per steradian for
   directions, per unit area for points of a shape of area 1. */
#ifndef HYK_SAMPLING_H
#define HYK_SAMPLING_H

#include "vector.h"

#define HYK_TWO_PI HYK_C(6.28318530717958647693)
#define HYK_HALF_PI HYK_C(1.57079632679489661923)
#define HYK_QUARTER_PI HYK_C(0.78539816339744830962)
/* The largest number below 1: remapped random numbers are kept at or under it. */
#define HYK_BELOW_ONE (1.0f - HYK_REAL_EPSILON)

/* Unit disc, area-preserving and of low distortion (Shirley & Chiu 1997). Density 1 / pi. */
HYK_FN hyk_vec2 hyk_sample_disc(hyk_vec2 u) {
    hyk_real a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
    if (a == 0.0f && b == 0.0f) return hyk_make2(0.0f, 0.0f);
    hyk_bool wide = hyk_abs(a) > hyk_abs(b);
    hyk_real r = wide ? a : b;
    hyk_real phi = wide ? HYK_QUARTER_PI * (b / a) : HYK_HALF_PI - HYK_QUARTER_PI * (a / b);
    return hyk_make2(r * hyk_cos(phi), r * hyk_sin(phi));
}

/* Hemisphere around +z in proportion to the cosine (Malley). z is never exactly zero, so that the density is
   not either: the disc's rim is met only by rounding. */
HYK_FN hyk_vec3 hyk_sample_cosine_hemisphere(hyk_vec2 u) {
    hyk_vec2 d = hyk_sample_disc(u);
    hyk_real z = hyk_sqrt(hyk_max(1.0f - d.x * d.x - d.y * d.y, HYK_REAL_EPSILON * HYK_REAL_EPSILON));
    return hyk_make3(d.x, d.y, z);
}
HYK_FN hyk_real hyk_pdf_cosine_hemisphere(hyk_real cos_theta) { return hyk_max(cos_theta, 0.0f) * HYK_INV_PI; }

/* The direction whose 1 - cos(theta) is given: the form that keeps the bits of small angles. */
HYK_FN hyk_vec3 hyk_direction_near_axis(hyk_real one_minus_cos, hyk_real phi) {
    hyk_real sin_theta = hyk_safe_sqrt(one_minus_cos * (2.0f - one_minus_cos));
    return hyk_make3(sin_theta * hyk_cos(phi), sin_theta * hyk_sin(phi), 1.0f - one_minus_cos);
}

/* Cone around +z that ends where 1 - cos(theta) is one_minus_cos, uniformly in solid angle. Concentric, so
   that strata stay compact. */
HYK_FN hyk_vec3 hyk_sample_cone(hyk_real one_minus_cos, hyk_vec2 u) {
    hyk_vec2 d = hyk_sample_disc(u);
    hyk_real r2 = d.x * d.x + d.y * d.y;
    hyk_real h = one_minus_cos * hyk_min(r2, 1.0f);
    /* (x, y) = sin(theta) d / |d| and sin^2(theta) = h (2 - h), h = one_minus_cos |d|^2 */
    hyk_real s = hyk_sqrt(one_minus_cos * (2.0f - h));
    return hyk_make3(d.x * s, d.y * s, 1.0f - h);
}
HYK_FN hyk_real hyk_pdf_cone(hyk_real one_minus_cos) { return 1.0f / (HYK_TWO_PI * one_minus_cos); }

/* u, known to lie in [lo, lo + width), spread over [0, 1) again. */
HYK_FN hyk_real hyk_respread(hyk_real u, hyk_real lo, hyk_real width) {
    return hyk_clamp((u - lo) / width, 0.0f, HYK_BELOW_ONE);
}

/* Point of [0, 1) with density in proportion to a at 0, b at 1, linear between. */
HYK_FN hyk_real hyk_sample_linear(hyk_real u, hyk_real a, hyk_real b) {
    hyk_real m = hyk_max(a, b);
    if (!(m > 0.0f)) return u;
    hyk_real p = a / m, q = b / m;
    hyk_real root = hyk_sqrt(hyk_lerp(p * p, q * q, u));
    return p + root > 0.0f ? hyk_min(u * (p + q) / (p + root), HYK_BELOW_ONE) : 0.0f;
}

/* ---- long chains of choices from one random number

   A random number has 24 bits. A tree of a million leaves eats 20 of them on the way down, and a branch of
   probability 1e-9 is not even seen. So the number lives on a grid of 2^-24 and every choice draws what lies
   below the grid from a hash: probabilities keep their relative precision at every depth, and the number's
   own stratification is kept, because the hash only fills in bits that were never there. */
HYK_STRUCT(hyk_chooser) {
    hyk_uint steps;        /* the number, in units of 2^-24: an integer, so that its distance from 1 is exact too */
    hyk_uint seed;
    hyk_real probability;  /* of all choices so far */
    hyk_bool second;       /* the last choice */
} HYK_END(hyk_chooser)

#define HYK_CHOICE_STEPS 16777216.0f
#define HYK_CHOICE_LAST 16777215u
#define HYK_CHOICE_CELL HYK_C(5.9604644775390625e-08)

HYK_FN hyk_uint hyk_to_choice_steps(hyk_real u) { return HYK_TO_UINT(hyk_clamp(u, 0.0f, HYK_BELOW_ONE) * HYK_CHOICE_STEPS); }

/* What is left of the number after the choices, for other use. */
HYK_FN hyk_real hyk_choice_rest(hyk_chooser c) { return HYK_TO_REAL(c.steps) * HYK_CHOICE_CELL; }

/* Permuted congruential generator's output step (O'Neill 2014), as a hash. */
HYK_FN hyk_uint hyk_choice_hash(hyk_uint x) {
    hyk_uint word = ((x >> ((x >> 28) + 4u)) ^ x) * 277803737u;
    return (word >> 22) ^ word;
}

/* other: random numbers of the same sample that serve other purposes; they seed the hash. */
HYK_FN hyk_chooser hyk_start_choosing(hyk_real u, hyk_vec2 other) {
    hyk_chooser c;
    c.steps = hyk_to_choice_steps(u);
    c.seed = hyk_choice_hash(c.steps * 747796405u + 2891336453u) ^ hyk_to_choice_steps(other.x);
    c.seed = hyk_choice_hash(c.seed * 747796405u + 2891336453u) ^ hyk_to_choice_steps(other.y);
    c.probability = 1.0f;
    c.second = false;
    return c;
}

/* Takes the rarer branch with probability share (at most 1/2); rarer_is_second says which one it is. The
   number is measured from the rarer branch's end. */
HYK_FN hyk_chooser hyk_choose_share(hyk_chooser c, hyk_real share, hyk_bool rarer_is_second) {
    c.seed = c.seed * 747796405u + 2891336453u;
    hyk_real below_grid = HYK_TO_REAL(hyk_choice_hash(c.seed) >> 8) * (HYK_CHOICE_CELL * HYK_CHOICE_CELL);
    hyk_real on_grid = HYK_TO_REAL(rarer_is_second ? HYK_CHOICE_LAST - c.steps : c.steps) * HYK_CHOICE_CELL;
    hyk_bool rare = on_grid + below_grid < share;
    hyk_real u = rare ? (on_grid + below_grid) / hyk_max(share, HYK_C(1e-37)) : ((on_grid - share) + below_grid) / (1.0f - share);
    hyk_uint steps = hyk_to_choice_steps(u);
    c.steps = rarer_is_second ? HYK_CHOICE_LAST - steps : steps;
    c.probability *= rare ? share : 1.0f - share;
    c.second = rare == rarer_is_second;
    return c;
}

/* Takes the first or the second branch in proportion to weights that are not both zero. */
HYK_FN hyk_chooser hyk_choose(hyk_chooser c, hyk_real first, hyk_real second) {
    return hyk_choose_share(c, hyk_min(first, second) / (first + second), second < first);
}

/* Power heuristic (Veach 1997, 9.2.4, exponent 2): weight of a sample whose own density is a where another
   strategy has density b. Ratios only, so that neither huge nor tiny densities overflow their squares. */
HYK_FN hyk_real hyk_power_heuristic(hyk_real a, hyk_real b) {
    hyk_real p = hyk_min(a, HYK_REAL_MAX), q = hyk_min(b, HYK_REAL_MAX);
    if (!(p > 0.0f)) return 0.0f;
    if (!(q > 0.0f)) return 1.0f;
    if (p >= q) {
        hyk_real r = q / p;
        return 1.0f / (1.0f + r * r);
    }
    hyk_real s = p / q;
    return s * s / (1.0f + s * s);
}

#endif /* HYK_SAMPLING_H */
