/* The part of kernels_list.h whose kernels see the scene, and those around them. */
#ifndef KERNELS_SEEING_H
#define KERNELS_SEEING_H

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

#define KT_LIGHTS(X) X(light_point) X(light_surface) X(light_density) X(light_sun) X(light_shape) X(light_bound)       \
    X(light_pick) X(light_any) X(light_pdf) X(light_far)
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

#endif /* KERNELS_SEEING_H */
