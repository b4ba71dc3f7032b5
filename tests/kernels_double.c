/* The oracle of test_vk_kernels.c: shaders/shared in double, with float's constants for rounding and overflow, which are
   part of what kernels compute. */
#ifdef HT_VULKAN
#include <stdlib.h>

#define HYK_REAL double
#include "../shaders/shared/language.h"
#undef HYK_REAL_MAX
#undef HYK_REAL_EPSILON
#define HYK_REAL_MAX 3.4028234663852886e+38
#define HYK_REAL_EPSILON 5.9604644775390625e-08
#include "../shaders/shared/passes.h"
#include "../shaders/shared/scan.h"

#include "kernels_host.h"

void kt_run_double(uint32_t kernel, kt_case *k) { kt_run_here(kernel, k); }

/* ---- a scene */

static hyk_scene_constants read_constants(kt_case *k) {
    hyk_scene_constants c;
    c.center = kt_vec3(k);
    c.radius = kt_real(k);
    c.environment = kt_vec3(k);
    c.environment_rotation = kt_real(k);
    c.finite_lights = kt_uint(k);
    c.suns = kt_uint(k);
    c.environment_width = kt_uint(k);
    c.environment_height = kt_uint(k);
    c.environment_integral = kt_real(k);
    c.light_nodes = kt_uint(k);
    c.shapes = kt_uint(k);
    c.features = kt_uint(k);
    return c;
}

static hyk_material read_material(kt_case *k) {
    hyk_material m;
    m.base_color = kt_vec3(k);
    m.metallic = kt_real(k);
    m.emission = kt_vec3(k);
    m.roughness = kt_real(k);
    m.absorption = kt_vec3(k);
    m.ior = kt_real(k);
    m.eta = kt_vec3(k);
    m.transmission = kt_real(k);
    m.k = kt_vec3(k);
    m.alpha_cutoff = kt_real(k);
    m.kind = kt_uint(k);
    m.flags = kt_uint(k);
    m.energy_table = kt_uint(k);
    m.normal_scale = kt_real(k);
    m.base_color_texture = kt_uint(k);
    m.metallic_roughness_texture = kt_uint(k);
    m.normal_texture = kt_uint(k);
    m.emission_texture = kt_uint(k);
    m.alpha_texture = kt_uint(k);
    m.alpha = kt_real(k);
    m.clearcoat = kt_real(k);
    m.clearcoat_roughness = kt_real(k);
    return m;
}

static hyk_instance read_instance(kt_case *k) {
    hyk_instance m;
    m.row0 = kt_vec3(k);
    m.t0 = kt_real(k);
    m.row1 = kt_vec3(k);
    m.t1 = kt_real(k);
    m.row2 = kt_vec3(k);
    m.t2 = kt_real(k);
    m.inverse0 = kt_vec3(k);
    m.s0 = kt_real(k);
    m.inverse1 = kt_vec3(k);
    m.s1 = kt_real(k);
    m.inverse2 = kt_vec3(k);
    m.s2 = kt_real(k);
    m.mesh = kt_uint(k);
    m.material = kt_uint(k);
    m.first_light = kt_uint(k);
    m.flags = kt_uint(k);
    return m;
}

static hyk_light_node read_light_node(kt_case *k) {
    hyk_light_node n;
    n.lower = kt_vec3(k);
    n.intensity = kt_real(k);
    n.upper = kt_vec3(k);
    n.cos_o = kt_exact(k); /* 1 and 0 mean something */
    n.axis = kt_vec3(k);
    n.cos_e = kt_exact(k);
    n.child = kt_uint(k);
    n.is_leaf = kt_uint(k);
    n.both_sides = kt_uint(k);
    n.unused = kt_uint(k);
    return n;
}

/* The records of one buffer, one after the other. */
#define READ_ALL(record, type, words, count, to)                       \
    {                                                                  \
        type *all = (type *)malloc((count + 1) * sizeof *all);         \
        k.in = words;                                                  \
        k.read = 0;                                                    \
        for (uint32_t i = 0; i < count; i++) all[i] = record(&k);      \
        to = all;                                                      \
    }

const void *kt_make_wide_view(const kt_scene *scene, double ulps, uint64_t noise) {
    hyk_scene_view *view = (hyk_scene_view *)calloc(1, sizeof *view);
    kt_case k;
    memset(&k, 0, sizeof k);
    k.ulps = ulps;
    k.noise = noise;
    k.in = scene->constants;
    view->constants = read_constants(&k);
    READ_ALL(read_material, hyk_material, scene->materials, scene->material_count, view->materials)
    READ_ALL(read_instance, hyk_instance, scene->instances, scene->instance_count, view->instances)
    READ_ALL(kt_light, hyk_light, scene->lights, scene->light_count, view->lights)
    READ_ALL(read_light_node, hyk_light_node, scene->light_nodes, scene->light_node_count, view->light_nodes)
    view->textures = (const hyk_texture *)scene->textures;
    view->texels = (const uint32_t *const *)scene->texels;
    view->meshes = (const hyk_mesh *)scene->meshes;
    view->mesh_arrays = (const hyk_mesh_arrays *)scene->mesh_arrays;
    view->environment = scene->environment;
    view->environment_cdf = scene->environment_cdf;
    view->energy_tables = scene->energy_tables;
    return view;
}

void kt_free_wide_view(const void *view) {
    const hyk_scene_view *wide = (const hyk_scene_view *)view;
    free((void *)wide->materials);
    free((void *)wide->instances);
    free((void *)wide->lights);
    free((void *)wide->light_nodes);
    free((void *)wide);
}
#endif
