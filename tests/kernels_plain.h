/* The part of kernels_list.h whose kernels see nothing of a scene. */
#ifndef KERNELS_PLAIN_H
#define KERNELS_PLAIN_H

/* ---- scalars and vectors */

#define KT_VECTOR(X) X(sine) X(sine_of_little) X(arc) X(exponential) X(logarithm) X(power_of_two) X(srgb) X(quotient)  \
    X(length) X(products) X(frame) X(little) X(bits)
#if KT_IN_GROUP(0)
KT_KERNEL(sine) {
    hyk_real x = KT_GET(real);
    KT_SCALE(1.0f);
    KT_REAL(hyk_sin(x));
    KT_REAL(hyk_cos(x));
}
KT_KERNEL(sine_of_little) {
    hyk_real x = KT_GET(real);
    KT_REAL(hyk_sin(x));
    KT_REAL(hyk_cos(x));
}
KT_KERNEL(arc) {
    hyk_real y = KT_GET(real);
    hyk_real x = KT_GET(real);
    KT_REAL(hyk_atan2(y, x));
}
KT_KERNEL(exponential) {
    hyk_real x = KT_GET(real);
    KT_REAL(hyk_exp(x));
}
KT_KERNEL(logarithm) {
    hyk_real x = KT_GET(real);
    KT_SCALE(1.0f);
    KT_REAL(hyk_log2(x));
}
KT_KERNEL(power_of_two) {
    hyk_real x = KT_GET(real);
    KT_REAL(hyk_exp2(x));
}
KT_KERNEL(srgb) {
    hyk_uint byte_value = KT_GET(uint);
    KT_REAL(hyk_srgb_decode(byte_value));
}
KT_KERNEL(quotient) {
    hyk_real x = KT_GET(real);
    hyk_real y = KT_GET(real);
    KT_REAL(hyk_sqrt(x));
    KT_REAL(x / y);
    KT_REAL(1.0f / hyk_sqrt(y));
}
KT_KERNEL(length) {
    hyk_vec3 v = KT_GET(vec3);
    KT_REAL(hyk_length(v));
    KT_VEC3(hyk_normalize(v));
}
KT_KERNEL(products) {
    hyk_vec3 a = KT_GET(vec3);
    hyk_vec3 b = KT_GET(vec3);
    KT_SCALE(KT_SIZE3(a) * KT_SIZE3(b));
    KT_REAL(hyk_dot(a, b));
    KT_VEC3(hyk_cross(a, b));
    KT_SCALE(KT_SIZE3(a));
    KT_REAL(hyk_luminance(a));
}
KT_KERNEL(frame) {
    hyk_vec3 n = KT_GET(vec3);
    hyk_vec3 v = KT_GET(vec3);
    hyk_frame f = hyk_make_frame(n);
    KT_SCALE(1.0f);
    KT_VEC3(f.x);
    KT_VEC3(f.y);
    KT_VEC3(f.z);
    KT_VEC3(hyk_to_local(f, v));
    KT_VEC3(hyk_to_world(f, v));
}
KT_KERNEL(little) {
    hyk_vec3 v = KT_GET(vec3);
    hyk_real t = KT_GET(real);
    KT_SCALE(hyk_max(KT_SIZE3(v), hyk_abs(v.x * t)));
    KT_REAL(hyk_lerp(v.x, v.y, t));
    KT_REAL(hyk_square(t));
    KT_REAL(hyk_clamp(v.x, hyk_min(v.y, v.z), hyk_max(v.y, v.z)));
    KT_REAL(hyk_saturate(t));
    KT_REAL(hyk_safe_sqrt(t));
    KT_REAL(hyk_max3(v));
    KT_FLAG(hyk_is_black(v));
}
KT_KERNEL(bits) {
    hyk_uint x = KT_GET(uint);
    KT_UINT(hyk_reverse_bits(x));
    KT_FLAG(hyk_is_finite(HYK_TO_REAL(hyk_bits_float(x))));
    KT_UINT(hyk_min_uint(x, hyk_reverse_bits(x)));
    KT_UINT(hyk_max_uint(x, hyk_reverse_bits(x)));
}
#endif

/* ---- whole numbers */

#define KT_WHOLE(X) X(hashes) X(curve) X(pair) X(salt) X(threshold) X(wrap) X(plan)
#if KT_IN_GROUP(1)
KT_KERNEL(hashes) {
    hyk_uint a = KT_GET(uint);
    hyk_uint b = KT_GET(uint);
    KT_UINT(hyk_hash(a));
    KT_UINT(hyk_hash2(a, b));
    KT_UINT(hyk_owen(a, b));
    KT_UINT(hyk_sobol_second(a));
    KT_UINT(hyk_choice_hash(a));
}
KT_KERNEL(curve) {
    hyk_uint x = KT_GET(uint);
    hyk_uint y = KT_GET(uint);
    hyk_uint width = KT_GET(uint);
    KT_UINT(hyk_morton(x, y));
    KT_UINT(hyk_morton_even_bits(x));
    KT_UINT(hyk_tile_column(width, y & 1u, x));
    KT_UINT(hyk_tile_row(width, y & 1u, x));
}
KT_KERNEL(pair) {
    hyk_uint x = KT_GET(uint);
    hyk_uint y = KT_GET(uint);
    hyk_uint index = KT_GET(uint);
    hyk_uint seed = KT_GET(uint);
    hyk_uint d = KT_GET(uint);
    hyk_sampler s = hyk_make_sampler(x, y, index, seed);
    hyk_vec2 u = hyk_sample_pair(s, d);
    KT_UINT(s.pixel);
    KT_BITS(u.x);
    KT_BITS(u.y);
}
KT_KERNEL(salt) {
    hyk_sampler s = KT_GET(sampler);
    hyk_uint which = KT_GET(uint);
    KT_BITS(hyk_salt(s, which));
    KT_REAL(hyk_salted_infinity(s, which, KT_ALL));
    KT_REAL(hyk_salted_infinity(s, which, 0u));
}
KT_KERNEL(threshold) {
    hyk_ray ray;
    ray.origin.x = KT_GET(exact);
    ray.origin.y = KT_GET(exact);
    ray.origin.z = KT_GET(exact);
    ray.t_min = 0.0f;
    ray.direction.x = KT_GET(exact);
    ray.direction.y = KT_GET(exact);
    ray.direction.z = KT_GET(exact);
    ray.t_max = KT_GET(exact);
    hyk_uint instance = KT_GET(uint);
    hyk_uint primitive = KT_GET(uint);
    KT_BITS(hyk_alpha_threshold(ray, instance, primitive));
}
KT_KERNEL(wrap) {
    hyk_uint i = KT_GET(uint);
    hyk_uint size = KT_GET(uint);
    hyk_uint mode = KT_GET(uint);
    KT_UINT(hyk_wrap_texel(HYK_TO_INT(i), size, mode));
}
KT_KERNEL(plan) {
    hyk_uint count = KT_GET(uint);
    hyk_uint capacity = KT_GET(uint);
    hyk_scan_plan plan = hyk_plan_scan(count, capacity);
    KT_UINT(plan.parts);
    KT_UINT(plan.count);
    KT_UINT(plan.part_tiles);
}
#endif

/* ---- warps */

#define KT_WARPS(X) X(disc) X(hemisphere) X(near_axis) X(cone) X(respread) X(linear) X(choices) X(weights)
#if KT_IN_GROUP(2)
KT_KERNEL(disc) {
    hyk_vec2 d = hyk_sample_disc(KT_GET(units));
    KT_SCALE(1.0f);
    KT_REAL(d.x);
    KT_REAL(d.y);
}
KT_KERNEL(hemisphere) {
    hyk_vec3 w = hyk_sample_cosine_hemisphere(KT_GET(units));
    KT_VEC3(w);
    KT_SCALE(1.0f);
    KT_REAL(hyk_pdf_cosine_hemisphere(w.z));
}
KT_KERNEL(near_axis) {
    hyk_real one_minus_cos = KT_GET(real);
    hyk_real phi = KT_GET(real);
    hyk_vec3 w = hyk_direction_near_axis(one_minus_cos, phi);
    KT_SCALE(hyk_safe_sqrt(one_minus_cos));
    KT_REAL(w.x);
    KT_REAL(w.y);
    KT_SCALE(1.0f);
    KT_REAL(w.z);
}
KT_KERNEL(cone) {
    hyk_real one_minus_cos = KT_GET(real);
    hyk_vec3 w = hyk_sample_cone(one_minus_cos, KT_GET(units));
    KT_SCALE(hyk_safe_sqrt(one_minus_cos));
    KT_REAL(w.x);
    KT_REAL(w.y);
    KT_SCALE(1.0f);
    KT_REAL(w.z);
    KT_SCALE(0.0f);
    KT_REAL(hyk_pdf_cone(one_minus_cos));
}
KT_KERNEL(respread) {
    hyk_real u = KT_GET(unit);
    hyk_real lo = KT_GET(unit);
    hyk_real width = KT_GET(real);
    KT_SCALE(1.0f);
    KT_REAL(hyk_respread(u, lo, width));
}
KT_KERNEL(linear) {
    hyk_real u = KT_GET(unit);
    hyk_real a = KT_GET(real);
    hyk_real b = KT_GET(real);
    KT_REAL(hyk_sample_linear(u, a, b));
}
/* The number's grid becomes coarser by what is chosen: by the inverse of its probability. */
KT_KERNEL(choices) {
    hyk_real u = KT_GET(exact);
    hyk_vec2 other;
    other.x = KT_GET(exact);
    other.y = KT_GET(exact);
    hyk_chooser c = hyk_start_choosing(u, other);
    KT_UINT(c.seed);
    KT_UINT(c.steps);
    c.steps = hyk_to_choice_steps(KT_GET(unit));
    for (hyk_uint i = 0u; i < 4u; i++) {
        hyk_real first = KT_GET(real);
        hyk_real second = KT_GET(real);
        c = hyk_choose(c, first, second);
        KT_FLAG(c.second);
    }
    KT_UINT(c.seed);
    KT_REAL(c.probability);
    KT_SCALE(1.0f / c.probability);
    KT_REAL(hyk_choice_rest(c));
}
KT_KERNEL(weights) {
    hyk_real a = KT_GET(real);
    hyk_real b = KT_GET(real);
    hyk_path_settings settings;
    settings.strategy = KT_GET(uint);
    settings.wants = 0u;
    KT_REAL(hyk_power_heuristic(a, b));
    KT_REAL(hyk_emission_weight(settings, a, b));
    KT_REAL(hyk_light_weight(settings, false, a, b));
}
#endif

/* ---- interfaces, micro facets, cameras */

#define KT_OPTICS(X) X(dielectric) X(metal) X(schlick) X(mirror) X(facet) X(facet_normal) X(halves) X(lost)            \
    X(energy_place) X(film) X(camera_ray) X(callers_ray)
#if KT_IN_GROUP(3)
KT_KERNEL(dielectric) {
    hyk_real c = KT_GET(real);
    hyk_real eta = KT_GET(real);
    KT_REAL(hyk_refracted_cosine(c, eta));
    KT_REAL(hyk_fresnel_dielectric(c, eta));
}
KT_KERNEL(metal) {
    hyk_real c = KT_GET(real);
    hyk_real eta = KT_GET(real);
    hyk_real kappa = KT_GET(real);
    KT_REAL(hyk_fresnel_complex(c, eta, kappa));
}
KT_KERNEL(schlick) {
    hyk_real c = KT_GET(real);
    hyk_vec3 f0 = KT_GET(vec3);
    KT_SCALE(1.0f);
    KT_REAL(hyk_schlick_weight(c));
    KT_VEC3(hyk_fresnel_schlick(f0, c));
}
KT_KERNEL(mirror) {
    hyk_vec3 wo = KT_GET(vec3);
    hyk_vec3 h = KT_GET(vec3);
    hyk_real eta = KT_GET(real);
    hyk_real c = hyk_dot(wo, h);
    hyk_real g = hyk_refracted_cosine(c, eta);
    KT_VEC3(hyk_reflect(wo, h, c));
    KT_FLAG(g > 0.0f);
    hyk_vec3 wi = hyk_zero3();
    if (g > 0.0f) wi = hyk_refract(wo, h, c, g, eta);
    KT_VEC3(wi);
}
KT_KERNEL(facet) {
    hyk_vec3 wo = KT_GET(vec3);
    hyk_vec3 wi = KT_GET(vec3);
    hyk_vec3 h = KT_GET(vec3);
    hyk_real alpha = KT_GET(real);
    hyk_real d = hyk_ggx_distribution(h, alpha);
    KT_REAL(d);
    KT_REAL(hyk_ggx_stretch(wo, alpha));
    KT_REAL(hyk_ggx_visibility(wo, wi, alpha));
    KT_REAL(hyk_ggx_stopped(wo, wi, alpha));
    KT_REAL(hyk_ggx_pdf_reflected(wo, d, alpha));
}
KT_KERNEL(facet_normal) {
    hyk_vec3 wo = KT_GET(vec3);
    hyk_real alpha = KT_GET(real);
    KT_VEC3(hyk_ggx_sample(wo, alpha, KT_GET(units)));
}
KT_KERNEL(halves) {
    hyk_vec3 wo = KT_GET(vec3);
    hyk_vec3 wi = KT_GET(vec3);
    hyk_real eta = KT_GET(real);
    hyk_vec3 h = hyk_half_refracted(wo, hyk_neg(wi), eta);
    KT_VEC3(hyk_half_reflected(wo, wi));
    KT_VEC3(h);
    KT_REAL(hyk_refraction_jacobian(wo.z, hyk_refracted_cosine(wo.z, eta), eta));
}
KT_KERNEL(lost) {
    hyk_real alpha = KT_GET(real);
    hyk_real c = KT_GET(real);
    KT_VEC3(hyk_lost_sample(alpha, KT_GET(units)));
    KT_REAL(hyk_lost_pdf(c, alpha));
}
KT_KERNEL(energy_place) {
    hyk_real c = KT_GET(real);
    hyk_real alpha = KT_GET(real);
    hyk_real column = hyk_energy_column(c, alpha);
    hyk_energy_rows rows = hyk_energy_rows_of(alpha);
    KT_SCALE(HYK_TO_REAL(HYK_ENERGY_COLUMNS));
    KT_REAL(column);
    KT_REAL(hyk_energy_row(alpha));
    KT_UINT(rows.offset);
    KT_REAL(rows.share);
    KT_SCALE(0.0f);
    KT_REAL(hyk_energy_row_alpha(c * 31.0f));
    KT_REAL(hyk_energy_lost_scale(alpha));
    KT_REAL(hyk_multiple_scattering(c, alpha));
}
KT_KERNEL(film) {
    hyk_camera camera = KT_GET(camera);
    hyk_uint x = KT_GET(uint);
    hyk_uint y = KT_GET(uint);
    hyk_vec2 f = hyk_film_point(camera, x, y, KT_GET(units));
    KT_SCALE(1.0f);
    KT_REAL(f.x);
    KT_REAL(f.y);
}
KT_KERNEL(camera_ray) {
    hyk_camera camera = KT_GET(camera);
    hyk_vec2 f = KT_GET(vec2);
    hyk_ray ray = hyk_camera_ray(camera, f, KT_GET(units));
    KT_SCALE(hyk_max(camera.half_width, camera.lens_radius));
    KT_VEC3(ray.origin);
    KT_SCALE(1.0f);
    KT_VEC3(ray.direction);
    KT_REAL(ray.t_min);
    KT_REAL(ray.t_max);
}
KT_KERNEL(callers_ray) {
    hyk_ray ray = hyk_callers_ray(KT_GET(ray));
    KT_VEC3(ray.origin);
    KT_VEC3(ray.direction);
    KT_REAL(ray.t_min);
    KT_REAL(ray.t_max);
}
#endif

#endif /* KERNELS_PLAIN_H */
