/* Every kernel of shaders/shared, called on words: what test_vk_kernels.c runs on a device, in float on the host and in
   double on the host. This one source is all three: tests/kernels.comp includes it for the device, test_vk_kernels.c and
   kernels_double.c for the host; each says before how words are read and results told:

       KT_KERNEL(name)           a kernel: begins a function kt_<name> that reads its inputs and tells its results
       KT_GET(what)              the next input: a uint, a real, a unit (a real of [0, 1)), an exact (a real whose last bit
                                 is meant), a vec2, units, a vec3 or a record
       KT_UINT(x) KT_REAL(x) KT_VEC3(x)   the next result; whole numbers must agree to the bit
       KT_SCALE(x)               errors of the next results are in ulps of at least this; 0: of their own size

   A kernel tells always the same number of results. The order of reading is that of statements: no two in one. */
#ifndef KERNELS_LIST_H
#define KERNELS_LIST_H

/* A device gets a group of kernels at a time, -DKT_GROUP=n; the host has them all. */
#ifdef KT_GROUP
#define KT_IN_GROUP(group) (KT_GROUP == group)
#else
#define KT_IN_GROUP(group) 1
#endif
#define KT_GROUPS 8

#define KT_ALL 0xffffffffu /* features */

/* ---- records among the inputs, word by word as they lie in buffers */

KT_READER(hyk_ray, ray) {
    hyk_ray r;
    r.origin = KT_GET(vec3);
    r.t_min = KT_GET(exact);
    r.direction = KT_GET(vec3);
    r.t_max = KT_GET(exact);
    return r;
}

KT_READER(hyk_light, light) {
    hyk_light l;
    l.position = KT_GET(vec3);
    l.area = KT_GET(real);
    l.axis_u = KT_GET(vec3);
    l.radius = KT_GET(real);
    l.axis_v = KT_GET(vec3);
    l.cos_outer = KT_GET(real);
    l.normal = KT_GET(vec3);
    l.cos_inner = KT_GET(real);
    l.radiance = KT_GET(vec3);
    l.kind = KT_GET(uint);
    l.flags = KT_GET(uint);
    l.instance = KT_GET(uint);
    l.primitive = KT_GET(uint);
    l.tree_path = KT_GET(uint);
    return l;
}

KT_READER(hyk_camera, camera) {
    hyk_camera c;
    c.position = KT_GET(vec3);
    c.kind = KT_GET(uint);
    c.right = KT_GET(vec3);
    c.half_width = KT_GET(real);
    c.up = KT_GET(vec3);
    c.half_height = KT_GET(real);
    c.forward = KT_GET(vec3);
    c.lens_radius = KT_GET(real);
    c.focus_distance = KT_GET(real);
    c.shift_x = KT_GET(real);
    c.shift_y = KT_GET(real);
    c.filter_kind = KT_GET(uint);
    c.width = KT_GET(uint);
    c.height = KT_GET(uint);
    c.spread = KT_GET(real);
    c.start_width = KT_GET(real);
    return c;
}

KT_READER(hyk_sampler, sampler) {
    hyk_sampler s;
    s.pixel = KT_GET(uint);
    s.index = KT_GET(uint);
    s.seed = KT_GET(uint);
    return s;
}

KT_READER(hyk_bool, flag) { return KT_GET(uint) != 0u; }

#define KT_FLAG(x) KT_UINT((x) ? 1u : 0u)
#define KT_BITS(x) KT_UINT(hyk_float_bits(HYK_TO_FLOAT(x))) /* a real that must agree to the bit */
#define KT_SIZE3(x) hyk_max3(hyk_abs3(x))

/* ---- scalars and vectors */

#define KT_VECTOR(X) X(sine) X(sine_of_little) X(arc) X(exponential) X(logarithm) X(power_of_two) X(srgb) X(quotient) X(length) X(products) X(frame) X(little) X(bits)
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

#define KT_OPTICS(X) X(dielectric) X(metal) X(schlick) X(mirror) X(facet) X(facet_normal) X(halves) X(lost) X(energy_place) X(film) X(camera_ray) X(callers_ray)
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

/* ---- textures and the environment */

#define KT_IMAGES(X) X(texture) X(texture_lod) X(alpha) X(triangle) X(sky) X(sky_place) X(sky_sample) X(sky_plain)
#if KT_IN_GROUP(4)
KT_KERNEL(texture) {
    hyk_uint texture = KT_GET(uint);
    hyk_vec2 uv = KT_GET(vec2);
    hyk_real lod = KT_GET(real);
    hyk_rgba r = hyk_sample_texture(KT_VIEW, texture, uv, lod);
    KT_SCALE(1.0f);
    KT_VEC3(r.rgb);
    KT_REAL(r.a);
}
KT_KERNEL(texture_lod) {
    hyk_uint texture = KT_GET(uint);
    hyk_real width = KT_GET(real);
    hyk_real uv_scale = KT_GET(real);
    KT_SCALE(1.0f);
    KT_REAL(hyk_texture_lod(KT_VIEW, texture, width, uv_scale));
}
KT_KERNEL(alpha) {
    hyk_uint material = KT_GET(uint);
    hyk_vec2 uv = KT_GET(vec2);
    hyk_real threshold = KT_GET(real);
    hyk_material m = HYK_LOAD_MATERIAL(KT_VIEW, material);
    hyk_real alpha = hyk_alpha_at(KT_VIEW, m, uv);
    KT_SCALE(1.0f);
    KT_REAL(alpha);
    KT_FLAG(hyk_alpha_stops(m, alpha, threshold));
    KT_FLAG(hyk_material_has_alpha(m));
}
KT_KERNEL(triangle) {
    hyk_uint instance = KT_GET(uint);
    hyk_uint triangle = KT_GET(uint);
    hyk_vec2 weights = KT_GET(vec2);
    hyk_vec2 uv = hyk_triangle_uv(KT_VIEW, HYK_LOAD_INSTANCE(KT_VIEW, instance).mesh, triangle, weights);
    KT_UINT(hyk_triangle_material(KT_VIEW, instance, triangle));
    KT_SCALE(1.0f);
    KT_REAL(uv.x);
    KT_REAL(uv.y);
    KT_VEC3(hyk_triangle_emission(KT_VIEW, instance, triangle, weights, KT_ALL));
}
KT_KERNEL(sky) {
    hyk_vec3 direction = KT_GET(vec3);
    KT_SCALE(1.0f);
    KT_VEC3(hyk_environment_radiance(KT_VIEW, direction, KT_ALL));
    KT_REAL(hyk_pdf_map(KT_VIEW, direction));
}
KT_KERNEL(sky_place) {
    hyk_vec3 direction = KT_GET(vec3);
    hyk_map_place at = hyk_place_on_map(KT_VIEW, direction);
    hyk_vec2 range = hyk_map_row_range(at.row, HYK_CONSTANTS(KT_VIEW).environment_height);
    KT_UINT(at.column);
    KT_UINT(at.row);
    KT_SCALE(HYK_TO_REAL(HYK_CONSTANTS(KT_VIEW).environment_width));
    KT_REAL(at.s);
    KT_REAL(at.t);
    KT_SCALE(0.0f);
    KT_REAL(range.x);
    KT_REAL(range.y);
}
KT_KERNEL(sky_sample) {
    hyk_vec2 u = KT_GET(units);
    hyk_real s = KT_GET(unit);
    hyk_real share = KT_GET(unit);
    hyk_uint column = KT_GET(uint);
    hyk_uint row = KT_GET(uint);
    hyk_map_choice chosen = hyk_bisect_map(KT_VIEW, 0u, HYK_CONSTANTS(KT_VIEW).environment_height + 1u, hyk_start_choosing(u.y, u));
    KT_UINT(chosen.index);
    KT_VEC3(hyk_sample_map(KT_VIEW, u));
    KT_VEC3(hyk_map_direction(KT_VIEW, column, row, s, share));
}
KT_KERNEL(sky_plain) {
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_vec3 direction = KT_GET(vec3);
    KT_VEC3(hyk_sample_environment(KT_VIEW, n, both_sides, KT_GET(units), HYK_NEEDS_ENVIRONMENT));
    KT_SCALE(1.0f);
    KT_REAL(hyk_pdf_environment(KT_VIEW, n, both_sides, direction, HYK_NEEDS_ENVIRONMENT));
    KT_SCALE(0.0f);
    KT_REAL(hyk_estimate_environment(KT_VIEW, both_sides, KT_ALL));
}
#endif

/* ---- scattering */

#define KT_BSDF(X) X(bsdf) X(bsdf_value) X(bsdf_sample) X(bsdf_albedo)
#if KT_IN_GROUP(5)
KT_KERNEL(bsdf) {
    hyk_uint material = KT_GET(uint);
    hyk_bool front = KT_GET(flag);
    hyk_bsdf b = hyk_make_bsdf(KT_VIEW, HYK_LOAD_MATERIAL(KT_VIEW, material), front, KT_ALL);
    KT_UINT(b.flags);
    KT_UINT(b.at_metal);
    KT_UINT(b.at_plastic);
    KT_UINT(b.at_near);
    KT_UINT(b.at_far);
    KT_UINT(b.at_coat);
    KT_UINT(b.rows.offset);
    KT_REAL(b.alpha);
    KT_REAL(b.metal);
    KT_REAL(b.plastic);
    KT_REAL(b.glass);
    KT_REAL(b.glass_eta);
    KT_REAL(b.coat);
    KT_REAL(b.coat_alpha);
    KT_REAL(b.metal_scale);
    KT_REAL(b.plastic_scale);
    KT_REAL(b.glass_through);
    KT_REAL(b.glass_reflect);
    KT_SCALE(HYK_TO_REAL(HYK_ENERGY_ROWS));
    KT_REAL(b.rows.share);
    KT_SCALE(1.0f);
    KT_REAL(b.plastic_bounce);
    KT_REAL(b.glass_split);
    KT_VEC3(b.base_color);
    KT_VEC3(b.f0);
    KT_VEC3(b.bounce);
}
KT_KERNEL(bsdf_value) {
    hyk_uint material = KT_GET(uint);
    hyk_bool front = KT_GET(flag);
    hyk_vec3 wo = KT_GET(vec3);
    hyk_vec3 wi = KT_GET(vec3);
    hyk_bsdf b = hyk_make_bsdf(KT_VIEW, HYK_LOAD_MATERIAL(KT_VIEW, material), front, KT_ALL);
    hyk_bsdf_value f = hyk_bsdf_eval(KT_VIEW, b, wo, wi, KT_ALL);
    KT_VEC3(f.diffuse);
    KT_SCALE(0.0009765625f); /* light that masking took away is known to so much: see energy.h, where the tables fall steeply */
    KT_VEC3(f.specular);
    KT_REAL(f.pdf);
}
KT_KERNEL(bsdf_sample) {
    hyk_uint material = KT_GET(uint);
    hyk_bool front = KT_GET(flag);
    hyk_vec3 wo = KT_GET(vec3);
    hyk_real u_lobe = KT_GET(unit);
    hyk_bsdf b = hyk_make_bsdf(KT_VIEW, HYK_LOAD_MATERIAL(KT_VIEW, material), front, KT_ALL);
    hyk_bsdf_sample s = hyk_bsdf_sample_direction(KT_VIEW, b, wo, u_lobe, KT_GET(units), KT_ALL);
    KT_UINT(s.flags);
    KT_SCALE(1.0f);
    KT_VEC3(s.wi);
    KT_VEC3(s.diffuse);
    KT_VEC3(s.specular);
    KT_REAL(s.pdf);
    KT_REAL(s.u_left);
}
KT_KERNEL(bsdf_albedo) {
    hyk_uint material = KT_GET(uint);
    hyk_bool front = KT_GET(flag);
    hyk_vec3 wo = KT_GET(vec3);
    hyk_bsdf b = hyk_make_bsdf(KT_VIEW, HYK_LOAD_MATERIAL(KT_VIEW, material), front, KT_ALL);
    hyk_layers l = hyk_layers_at(KT_VIEW, b, wo.z, KT_ALL);
    KT_SCALE(1.0f);
    KT_VEC3(hyk_bsdf_albedo(KT_VIEW, b, wo, KT_ALL));
    KT_REAL(l.pass);
    KT_REAL(l.metal_lost);
    KT_REAL(l.schlick);
    KT_REAL(l.diffuse);
    KT_REAL(l.glass_lost);
    KT_REAL(l.glass_back);
    KT_REAL(l.glass_along);
}
#endif

/* ---- lights */

#define KT_LIGHTS(X) X(light_point) X(light_surface) X(light_density) X(light_sun) X(light_shape) X(light_bound) X(light_pick) X(light_any) X(light_pdf) X(light_far)
#if KT_IN_GROUP(6)
KT_KERNEL(light_point) {
    hyk_light light = KT_GET(light);
    hyk_vec3 p = KT_GET(vec3);
    hyk_light_sample s = hyk_sample_point_light(light, p);
    KT_UINT(s.flags);
    KT_VEC3(s.direction);
    KT_REAL(s.distance);
    KT_VEC3(s.radiance);
}
KT_KERNEL(light_surface) {
    hyk_light light = KT_GET(light);
    hyk_vec3 p = KT_GET(vec3);
    hyk_surface_sample s = hyk_sample_surface_light(light, p, KT_GET(units));
    KT_FLAG(s.pdf > 0.0f);
    KT_REAL(s.pdf);
    KT_VEC3(s.offset);
    KT_VEC3(s.normal);
    KT_SCALE(1.0f);
    KT_REAL(s.weights.x);
    KT_REAL(s.weights.y);
}
KT_KERNEL(light_density) {
    hyk_light light = KT_GET(light);
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 direction = KT_GET(vec3);
    KT_REAL(hyk_pdf_surface_light(light, p, direction));
}
KT_KERNEL(light_sun) {
    hyk_light light = KT_GET(light);
    hyk_vec3 n = KT_GET(vec3);
    hyk_vec3 direction = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_light_sample s = hyk_sample_sun(light, KT_GET(units));
    KT_UINT(s.flags);
    KT_FLAG(hyk_sun_covers(light, direction));
    KT_VEC3(s.direction);
    KT_REAL(s.pdf);
    KT_REAL(hyk_sun_cap(light));
    KT_REAL(hyk_estimate_sun(light, n, both_sides));
}
KT_KERNEL(light_shape) {
    hyk_light light = KT_GET(light);
    hyk_ray ray = KT_GET(ray);
    hyk_real t = hyk_intersect_shape(light, ray);
    hyk_vec3 at = hyk_add_scaled(ray.origin, ray.direction, t);
    hyk_vec3 n = hyk_shape_normal(light, at);
    KT_FLAG(t >= 0.0f);
    KT_REAL(t);
    KT_VEC3(t >= 0.0f ? n : hyk_splat(1.0f));
    KT_VEC3(hyk_shape_radiance(light, n, ray.direction));
}
KT_KERNEL(light_bound) {
    hyk_uint node = KT_GET(uint);
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_light_bound bound = hyk_bound_light_node(HYK_LOAD_LIGHT_NODE(KT_VIEW, node), p, n, both_sides);
    KT_FLAG(bound.weight > 0.0f);
    KT_REAL(bound.weight);
    KT_REAL(bound.distance);
    KT_REAL(hyk_estimate_finite_lights(KT_VIEW, p, n, both_sides));
}
KT_KERNEL(light_pick) {
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_vec2 u = KT_GET(units);
    hyk_uint light = KT_GET(uint);
    hyk_light_pick pick = hyk_pick_light(KT_VIEW, p, n, both_sides, hyk_start_choosing(u.x, u));
    KT_UINT(pick.light);
    KT_REAL(pick.probability);
    KT_REAL(hyk_light_pick_probability(KT_VIEW, HYK_LOAD_LIGHT(KT_VIEW, light).tree_path, p, n, both_sides));
}
KT_KERNEL(light_any) {
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_real select = KT_GET(unit);
    hyk_light_sample s = hyk_sample_lights(KT_VIEW, p, n, both_sides, select, KT_GET(units), KT_ALL);
    KT_UINT(s.flags);
    KT_UINT(s.light);
    KT_VEC3(s.direction);
    KT_REAL(s.distance);
    KT_REAL(s.pdf);
    KT_VEC3(s.radiance);
    KT_VEC3(s.position);
    KT_VEC3(s.normal);
}
KT_KERNEL(light_pdf) {
    hyk_uint light = KT_GET(uint);
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_vec3 direction = KT_GET(vec3);
    hyk_real distance = KT_GET(real);
    KT_REAL(hyk_pdf_light(KT_VIEW, light, p, n, both_sides, direction, distance, HYK_LOAD_LIGHT(KT_VIEW, light).normal, KT_ALL));
}
KT_KERNEL(light_far) {
    hyk_uint sun = KT_GET(uint); /* 0: the environment */
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_bool both_sides = KT_GET(flag);
    hyk_vec3 direction = KT_GET(vec3);
    hyk_uint which = sun == 0u ? HYK_NONE : HYK_CONSTANTS(KT_VIEW).finite_lights + sun - 1u;
    KT_REAL(hyk_pdf_infinite(KT_VIEW, which, p, n, both_sides, direction, KT_ALL));
}
#endif

/* ---- surfaces and paths */

#define KT_PATHS(X) X(offset) X(place) X(surface) X(material) X(shadow) X(survival) X(escape) X(first_path)
#if KT_IN_GROUP(7)
KT_KERNEL(offset) {
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 n = KT_GET(vec3);
    hyk_real error = KT_GET(real);
    hyk_vec3 e1 = KT_GET(vec3);
    hyk_vec3 e2 = KT_GET(vec3);
    KT_VEC3(hyk_offset_point(p, n, error));
    KT_VEC3(hyk_sub(hyk_offset_point(hyk_zero3(), n, error), hyk_zero3()));
    KT_VEC3(hyk_face_normal(e1, e2));
    KT_VEC3(hyk_visible_normal(n, hyk_normalize(e1)));
}
KT_KERNEL(place) {
    hyk_uint instance = KT_GET(uint);
    hyk_vec3 p = KT_GET(vec3);
    hyk_vec3 error = KT_GET(vec3);
    hyk_instance m = HYK_LOAD_INSTANCE(KT_VIEW, instance);
    hyk_vec3 world = hyk_transform_point(m, p);
    KT_SCALE(KT_SIZE3(p));
    KT_VEC3(world);
    KT_VEC3(hyk_transform_vector(m, p));
    KT_VEC3(hyk_transform_normal(m, p));
    KT_SCALE(0.0f);
    KT_VEC3(hyk_transformed_error(m, p, world, error));
}
KT_KERNEL(surface) {
    hyk_hit hit;
    hit.t = 1.0f;
    hit.instance = KT_GET(uint);
    hit.primitive = KT_GET(uint);
    hit.u = KT_GET(real);
    hit.v = KT_GET(real);
    hyk_vec3 direction = KT_GET(vec3);
    hyk_real width = KT_GET(real);
    hyk_surface s = hyk_surface_at(KT_VIEW, hit, direction, width, KT_ALL);
    KT_UINT(s.material);
    KT_FLAG(s.front);
    KT_VEC3(s.position);
    KT_REAL(s.error);
    KT_VEC3(s.geometric);
    KT_VEC3(s.shading);
    KT_REAL(s.uv_scale);
    KT_SCALE(1.0f);
    KT_REAL(s.uv.x);
    KT_REAL(s.uv.y);
}
KT_KERNEL(material) {
    hyk_surface s;
    s.position = hyk_zero3();
    s.error = 0.0f;
    s.geometric = hyk_zero3();
    s.uv_scale = KT_GET(real);
    s.shading = hyk_zero3();
    s.material = KT_GET(uint);
    s.uv = KT_GET(vec2);
    s.front = true;
    hyk_real width = KT_GET(real);
    hyk_material m = hyk_material_at(KT_VIEW, s, width, KT_ALL);
    KT_UINT(m.flags);
    KT_SCALE(1.0f);
    KT_VEC3(m.base_color);
    KT_REAL(m.metallic);
    KT_REAL(m.roughness);
    KT_VEC3(m.emission);
}
KT_KERNEL(shadow) {
    hyk_vec3 origin = KT_GET(vec3);
    hyk_light_sample light = hyk_no_light_sample();
    light.direction = KT_GET(vec3);
    light.distance = KT_GET(real);
    light.position = KT_GET(vec3);
    light.normal = KT_GET(vec3);
    light.flags = HYK_SAMPLE_VALID | HYK_SAMPLE_SURFACE;
    hyk_ray none;
    none.origin = origin;
    none.t_min = 0.0f;
    none.direction = light.direction;
    none.t_max = 0.0f;
    hyk_path path = hyk_begin_path(none, KT_GET(sampler), 0u, 4u, 0.0f, 0.0f);
    hyk_ray plain = hyk_shadow_ray(origin, light, path, 0u), salted = hyk_shadow_ray(origin, light, path, KT_ALL);
    KT_SCALE(KT_SIZE3(light.position));
    KT_VEC3(plain.direction);
    KT_VEC3(salted.direction);
    KT_SCALE(0.0f);
    KT_REAL(plain.t_max);
    KT_REAL(salted.t_max);
    KT_REAL(salted.t_min);
}
KT_KERNEL(survival) {
    hyk_ray none;
    none.origin = hyk_zero3();
    none.t_min = 0.0f;
    none.direction = hyk_zero3();
    none.t_max = 0.0f;
    hyk_path path = hyk_begin_path(none, KT_GET(sampler), 0u, 4u, 0.0f, 0.0f);
    path.throughput = KT_GET(vec3);
    path.eta_scale = KT_GET(real);
    path.bounce = KT_GET(uint);
    hyk_uint flags = KT_GET(uint);
    KT_REAL(hyk_survival(path));
    KT_UINT(hyk_component_of_emission(flags));
    KT_UINT(hyk_component_of_diffuse(flags));
    KT_UINT(hyk_component_of_specular(flags));
    KT_UINT(hyk_scatter_flags(flags, true));
    KT_UINT(hyk_scatter_flags(flags, false));
    KT_UINT(hyk_pair_of(path, 3u));
}
KT_KERNEL(escape) {
    hyk_path_settings settings;
    settings.strategy = KT_GET(uint);
    settings.wants = HYK_WANTS_IRRADIANCE;
    hyk_ray ray;
    ray.origin = KT_GET(vec3);
    ray.t_min = 0.0f;
    ray.direction = KT_GET(vec3);
    ray.t_max = HYK_REAL_MAX;
    hyk_path path = hyk_begin_path(ray, KT_GET(sampler), 0u, 4u, 0.0f, 0.0f);
    path.normal = KT_GET(vec3);
    path.throughput = KT_GET(vec3);
    path.pdf = KT_GET(real);
    path.flags = KT_GET(uint);
    hyk_scatter r = hyk_escape(KT_VIEW, settings, path, KT_ALL);
    KT_UINT(r.emitted_component);
    KT_SCALE(1.0f);
    KT_VEC3(r.emitted);
    KT_VEC3(r.emitted_irradiance);
}
KT_KERNEL(first_path) {
    hyk_picture picture;
    picture.camera = KT_GET(camera);
    picture.max_depth = 7u;
    picture.seed_even = KT_GET(uint);
    picture.seed_odd = KT_GET(uint);
    hyk_uint x = KT_GET(uint);
    hyk_uint y = KT_GET(uint);
    hyk_sampler random = hyk_lane_sampler(picture, x, y, KT_GET(uint));
    hyk_path path = hyk_first_path(picture, hyk_sensor_ray(picture.camera, x, y, random), random, x, KT_ALL);
    KT_UINT(path.random.pixel);
    KT_UINT(path.random.seed);
    KT_UINT(path.flags);
    KT_SCALE(hyk_max(picture.camera.half_width, picture.camera.lens_radius));
    KT_VEC3(path.ray.origin);
    KT_SCALE(1.0f);
    KT_VEC3(path.ray.direction);
    KT_REAL(path.ray.t_max);
}
#endif

#define KT_LIST(X) KT_VECTOR(X) KT_WHOLE(X) KT_WARPS(X) KT_OPTICS(X) KT_IMAGES(X) KT_BSDF(X) KT_LIGHTS(X) KT_PATHS(X)

#endif /* KERNELS_LIST_H */
