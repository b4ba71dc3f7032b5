/* Inputs of the kernels of kernels_list.h, in the order in which they are read there: ordinary ones, and in between those
   that ask for trouble. For test_vk_kernels.c. */
#ifndef KERNELS_INPUTS_H
#define KERNELS_INPUTS_H

#include "hydra_test.h"

/* Where inputs go; i: which case. */
typedef struct input {
    uint32_t *words;
    uint32_t count, i;
    ht_rng *rng;
    const hydra_scene *scene;
} input;

static void put(input *in, uint32_t word) { in->words[in->count++] = word; }
static void put_real(input *in, float x) { put(in, hyk_float_bits(x)); }
static void put_vec(input *in, hyk_vec3 v) {
    put_real(in, v.x);
    put_real(in, v.y);
    put_real(in, v.z);
}

/* ---- numbers */

static float any(input *in, float low, float high) { return ht_range(in->rng, low, high); }
static uint32_t below(input *in, uint32_t n) { return ht_below(in->rng, n); }
/* A power of ten between two. */
static float tens(input *in, float low, float high) { return powf(10, any(in, low, high)); }
static float either(input *in) { return below(in, 2) ? 1.0f : -1.0f; }
static bool once_in(input *in, uint32_t n) { return below(in, n) == 0; }

/* Of [0, 1): on the grid that samples have, its ends, and near them. */
static float unit(input *in) {
    if (!once_in(in, 6)) return ht_uniform(in->rng);
    const float ends[] = {0, 0.5f, 1 - 0x1p-24f, 0x1p-24f, 0.25f, 0.75f, 1 - 0x1p-12f, 0x1p-12f};
    return ends[below(in, 8)];
}
static void put_units(input *in) {
    put_real(in, unit(in));
    put_real(in, unit(in));
}

static hyk_vec3 rounded(double x, double y, double z) {
    double length = sqrt(x * x + y * y + z * z);
    return hyk_make3((float)(x / length), (float)(y / length), (float)(z / length));
}

/* Directions: anywhere, along axes, in planes of axes, nearly along axes. */
static hyk_vec3 direction(input *in) {
    float d[3];
    ht_direction(in->rng, d);
    uint32_t kind = below(in, 12), axis = below(in, 3);
    for (uint32_t k = 0; k < 3; k++) {
        if (kind == 0 && k != axis) d[k] = 0;
        if (kind == 1 && k == axis) d[k] = 0;
        if (kind == 2 && k != axis) d[k] *= tens(in, -8, -2);
    }
    return rounded((double)d[0], (double)d[1], (double)d[2]);
}

/* The same with z above 0, some of them grazing. */
static hyk_vec3 upward(input *in) {
    hyk_vec3 d = direction(in);
    if (once_in(in, 5) || d.z == 0) d.z = tens(in, -6, -1);
    return rounded((double)d.x, (double)d.y, fabs((double)d.z));
}

static hyk_vec3 near_to(input *in, hyk_vec3 d, float by) {
    hyk_vec3 o = direction(in);
    return rounded((double)(d.x + by * o.x), (double)(d.y + by * o.y), (double)(d.z + by * o.z));
}

static hyk_vec3 place(input *in, float size) { return hyk_make3(any(in, -size, size), any(in, -size, size), any(in, -size, size)); }

static float alpha(input *in) { return once_in(in, 4) ? tens(in, -4, -1) : hyk_square(any(in, 0.01f, 1)); }
static float index_of_refraction(input *in) {
    float eta = once_in(in, 3) ? 1 + tens(in, -4, -1) : any(in, 1.05f, 3);
    if (once_in(in, 8)) eta = any(in, 3, 10);
    return below(in, 2) ? eta : 1 / eta;
}

/* ---- records */

/* Two unit vectors at right angles to n. */
static void around(hyk_vec3 n, hyk_vec3 *x, hyk_vec3 *y) {
    hyk_frame f = hyk_make_frame(n);
    *x = f.x;
    *y = f.y;
}

static hyk_vec3 times(hyk_vec3 v, float s) { return hyk_scale(v, s); }

/* A light of a kind and a point that it may light, within some sizes of it. */
static void make_light(input *in, uint32_t kind, hyk_light *l, hyk_vec3 *p) {
    float size = once_in(in, 3) ? tens(in, -3, 3) : any(in, 0.1f, 2);
    hyk_vec3 x, y, n = direction(in), away = direction(in);
    memset(l, 0, sizeof *l);
    around(n, &x, &y);
    l->kind = kind;
    l->position = place(in, once_in(in, 8) ? 1000 * size : size);
    l->radiance = hyk_make3(tens(in, -2, 3), any(in, 0, 5), any(in, 0.5f, 2));
    l->normal = n;
    l->flags = once_in(in, 3) ? HYK_LIGHT_BOTH_SIDES : 0;
    l->instance = l->primitive = HYK_NONE;
    l->radius = kind == HYK_LIGHT_SUN ? tens(in, -4, 0.3f) : size;
    l->cos_inner = 0.9f;
    l->cos_outer = 0.6f;
    l->axis_u = times(x, size * any(in, 0.2f, 1));
    l->axis_v = times(y, size * any(in, 0.2f, 1));
    if (kind == HYK_LIGHT_TRIANGLE) l->axis_v = hyk_add_scaled(l->axis_v, l->axis_u, any(in, -0.7f, 0.7f));
    float distance = size * (once_in(in, 3) ? tens(in, -2, 3) : any(in, 0.5f, 6));
    if (kind == HYK_LIGHT_SPHERE) distance += size; /* from its surface on */
    if (hyk_dot(away, n) < 0 && !(l->flags & HYK_LIGHT_BOTH_SIDES)) away = times(away, -1);
    *p = hyk_add_scaled(l->position, away, distance);
}

static void put_light(input *in, const hyk_light *l) {
    uint32_t words[sizeof *l / 4];
    memcpy(words, l, sizeof words);
    for (uint32_t i = 0; i < sizeof words / 4; i++) put(in, words[i]);
}

static hyk_camera make_camera(input *in) {
    hyk_camera c;
    memset(&c, 0, sizeof c);
    c.forward = direction(in);
    around(c.forward, &c.right, &c.up);
    c.position = place(in, once_in(in, 4) ? 1e6f : 5);
    c.kind = in->i % 4;
    c.half_width = once_in(in, 4) ? tens(in, -5, 3) : any(in, 0.2f, 1.5f);
    c.half_height = 0.75f * c.half_width;
    c.lens_radius = once_in(in, 5) ? 0 : tens(in, -3, 0);
    c.focus_distance = tens(in, -1, 3);
    c.shift_x = once_in(in, 2) ? 0 : any(in, -0.5f, 0.5f);
    c.filter_kind = below(in, 2);
    c.width = 1 + below(in, 4000);
    c.height = 1 + below(in, 3000);
    return c;
}

static void put_camera(input *in, const hyk_camera *c) {
    uint32_t words[sizeof *c / 4];
    memcpy(words, c, sizeof words);
    for (uint32_t i = 0; i < sizeof words / 4; i++) put(in, words[i]);
}

static void put_sampler(input *in) {
    for (int i = 0; i < 3; i++) put(in, ht_u32(in->rng));
}

/* A place in the scene, which is within some metres of 0; the direction that is up there; whether below counts too. */
static void put_lit_point(input *in) {
    put_vec(in, place(in, once_in(in, 6) ? 50 : 3));
    put_vec(in, direction(in));
    put(in, below(in, 2));
}

/* ---- the kernels' inputs, group by group */

static void in_sine(input *in) {
    float x = any(in, -7, 7);
    if (once_in(in, 3)) x = either(in) * tens(in, -6, 3.3f);
    if (once_in(in, 6)) x = 0.785398163f * (float)((int)below(in, 4001) - 2000);
    put_real(in, x);
}
static void in_sine_of_little(input *in) { put_real(in, either(in) * any(in, 0, 0.78f) * (once_in(in, 2) ? tens(in, -20, 0) : 1)); }
static void in_arc(input *in) {
    put_real(in, once_in(in, 8) ? 0 : either(in) * tens(in, -9, 9));
    put_real(in, once_in(in, 8) ? 1 : either(in) * tens(in, -9, 9));
}
static void in_exponential(input *in) { put_real(in, once_in(in, 8) ? -0.0f : -tens(in, -6, 1.9f)); }
static void in_logarithm(input *in) { put_real(in, once_in(in, 3) ? any(in, 0.5f, 2) : tens(in, -30, 30)); }
static void in_power_of_two(input *in) { put_real(in, any(in, -30, 30)); }
static void in_srgb(input *in) { put(in, in->i % 256); }
static void in_quotient(input *in) {
    put_real(in, tens(in, -18, 18));
    put_real(in, tens(in, -18, 18));
}
static void in_length(input *in) {
    hyk_vec3 v = direction(in);
    put_vec(in, times(v, tens(in, -25, 25)));
}
static void in_products(input *in) {
    hyk_vec3 a = times(direction(in), tens(in, -5, 5));
    put_vec(in, a);
    put_vec(in, once_in(in, 4) ? near_to(in, a, 0.001f) : times(direction(in), tens(in, -5, 5)));
}
static void in_frame(input *in) {
    put_vec(in, direction(in));
    put_vec(in, direction(in));
}
static void in_little(input *in) {
    put_vec(in, once_in(in, 8) ? hyk_zero3() : place(in, tens(in, -6, 6)));
    put_real(in, any(in, -1, 2));
}
static void in_bits(input *in) {
    const uint32_t special[] = {0, 0x80000000u, 0x7f800000u, 0xff800000u, 0x7fc00000u, 0xffc00001u, 0x7f7fffffu, 0x3f800000u};
    put(in, in->i < 8 ? special[in->i] : ht_u32(in->rng));
}

static void in_whole(input *in) { /* of any kernel that takes whole numbers alone */
    for (int i = 0; i < 5; i++) put(in, ht_u32(in->rng) >> (once_in(in, 3) ? below(in, 32) : 0));
}
static void in_curve(input *in) {
    put(in, ht_u32(in->rng) & 0xffffu);
    put(in, ht_u32(in->rng) & 0xffffu);
    put(in, 1 + below(in, 5000));
}
static void in_salt(input *in) {
    put_sampler(in);
    put(in, ht_u32(in->rng));
}
static void in_threshold(input *in) {
    for (int i = 0; i < 7; i++) put_real(in, i == 6 ? tens(in, 0, 38) : any(in, -100, 100));
    in_whole(in);
}
static void in_wrap(input *in) {
    uint32_t size = 1 + below(in, once_in(in, 2) ? 8 : 65536);
    put(in, (uint32_t)((int32_t)below(in, 6 * size + 6) - (int32_t)(3 * size + 3)));
    put(in, size);
    put(in, in->i % 3);
}

static void in_units(input *in) { put_units(in); }
static void in_near_axis(input *in) {
    put_real(in, once_in(in, 2) ? tens(in, -12, 0) : any(in, 0, 2));
    put_real(in, any(in, -6.3f, 6.3f));
}
static void in_cone(input *in) {
    put_real(in, once_in(in, 2) ? tens(in, -12, 0) : any(in, 0.01f, 2));
    put_units(in);
}
static void in_respread(input *in) {
    float lo = any(in, 0, 0.9f), width = any(in, 0.01f, 1 - lo);
    put_real(in, lo + width * ht_uniform(in->rng));
    put_real(in, lo);
    put_real(in, width);
}
static void in_linear(input *in) {
    put_real(in, unit(in));
    put_real(in, once_in(in, 6) ? 0 : tens(in, -6, 6));
    put_real(in, once_in(in, 6) ? 0 : tens(in, -6, 6));
}
static void in_choices(input *in) {
    float u = unit(in);
    put_real(in, u);
    put_units(in);
    put_real(in, u);
    for (int i = 0; i < 8; i++) put_real(in, once_in(in, 4) ? tens(in, -6, 3) : any(in, 0.1f, 1));
}
static void in_weights(input *in) {
    put_real(in, once_in(in, 8) ? 0 : tens(in, -30, 38));
    put_real(in, once_in(in, 8) ? 0 : tens(in, -30, 38));
    put(in, below(in, 3));
}

static void in_dielectric(input *in) {
    put_real(in, upward(in).z);
    put_real(in, index_of_refraction(in));
}
static void in_metal(input *in) {
    put_real(in, upward(in).z);
    put_real(in, once_in(in, 4) ? tens(in, -2, 1) : any(in, 0.1f, 3));
    put_real(in, once_in(in, 4) ? tens(in, -2, 1) : any(in, 0.5f, 8));
}
static void in_schlick(input *in) {
    put_real(in, upward(in).z);
    put_vec(in, hyk_make3(ht_uniform(in->rng), ht_uniform(in->rng), 1));
}
static void in_mirror(input *in) {
    hyk_vec3 wo = upward(in), h = once_in(in, 2) ? near_to(in, hyk_make3(0, 0, 1), alpha(in)) : upward(in);
    if (hyk_dot(wo, h) < 0.001f) h = wo;
    put_vec(in, wo);
    put_vec(in, h);
    put_real(in, index_of_refraction(in));
}
static void in_facet(input *in) {
    float a = alpha(in);
    put_vec(in, upward(in));
    put_vec(in, upward(in));
    hyk_vec3 h = near_to(in, hyk_make3(0, 0, 1), a * tens(in, -1, 1));
    put_vec(in, h);
    put_real(in, a);
}
static void in_facet_normal(input *in) {
    put_vec(in, upward(in));
    put_real(in, alpha(in));
    put_units(in);
}
static void in_halves(input *in) {
    put_vec(in, upward(in));
    put_vec(in, upward(in));
    put_real(in, index_of_refraction(in));
}
static void in_lost(input *in) {
    put_real(in, alpha(in));
    put_real(in, upward(in).z);
    put_units(in);
}
static void in_energy_place(input *in) {
    put_real(in, upward(in).z);
    put_real(in, alpha(in));
}
static void in_film(input *in) {
    hyk_camera c = make_camera(in);
    put_camera(in, &c);
    put(in, below(in, c.width));
    put(in, below(in, c.height));
    put_units(in);
}
static void in_camera_ray(input *in) {
    hyk_camera c = make_camera(in);
    put_camera(in, &c);
    put_real(in, ht_uniform(in->rng) * (float)c.width);
    put_real(in, ht_uniform(in->rng) * (float)c.height);
    put_units(in);
}
static void in_callers_ray(input *in) {
    put_vec(in, place(in, tens(in, -3, 6)));
    put_real(in, once_in(in, 2) ? 0 : tens(in, -6, 0));
    put_vec(in, times(direction(in), tens(in, -15, 15)));
    put_real(in, once_in(in, 2) ? 3.402823466e+38f : tens(in, 0, 20));
}

static uint32_t any_of(input *in, size_t count) { return in->i % (uint32_t)count; }
static void put_uv(input *in) {
    float size = once_in(in, 8) ? 1000 : 2;
    for (int k = 0; k < 2; k++) put_real(in, once_in(in, 10) ? (float)((int)below(in, 9) - 4) * 0.25f : any(in, -size, size));
}
static void in_texture(input *in) {
    put(in, any_of(in, in->scene->view_texture_count));
    put_uv(in);
    put_real(in, once_in(in, 2) ? 0 : any(in, -1, 7));
}
static void in_texture_lod(input *in) {
    put(in, any_of(in, in->scene->view_texture_count));
    put_real(in, tens(in, -4, 1));
    put_real(in, tens(in, -2, 2));
}
static void in_alpha(input *in) {
    put(in, any_of(in, in->scene->view_material_count));
    put_uv(in);
    put_real(in, unit(in));
}
static void put_triangle(input *in) {
    uint32_t instance = any_of(in, in->scene->placed_count);
    const hyk_mesh *mesh = &in->scene->view_meshes[in->scene->placed[instance].mesh];
    float u = ht_uniform(in->rng), v = ht_uniform(in->rng);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    put(in, instance);
    put(in, below(in, mesh->triangle_count));
    put_real(in, u);
    put_real(in, v);
}
static void in_triangle(input *in) { put_triangle(in); }
static void in_sky(input *in) { put_vec(in, direction(in)); }
static void in_sky_sample(input *in) {
    const hyk_scene_constants *c = &in->scene->view.constants;
    put_units(in);
    put_units(in);
    put(in, below(in, c->environment_width));
    put(in, below(in, c->environment_height + 1));
}
static void in_sky_plain(input *in) {
    put_vec(in, direction(in));
    put(in, below(in, 2));
    put_vec(in, direction(in));
    put_units(in);
}

static void put_bsdf(input *in) {
    put(in, any_of(in, in->scene->view_material_count));
    put(in, !once_in(in, 3));
}
static void in_bsdf(input *in) { put_bsdf(in); }
/* wi: anywhere, or near where the material's lobes point. */
static void in_bsdf_value(input *in) {
    const hyk_material *m = &in->scene->view_materials[any_of(in, in->scene->view_material_count)];
    hyk_vec3 wo = upward(in), wi = direction(in);
    float a = hyk_max(hyk_square(m->roughness), 1e-4f);
    put_bsdf(in);
    if (once_in(in, 2)) wi = near_to(in, hyk_make3(-wo.x, -wo.y, once_in(in, 3) ? -wo.z : wo.z), hyk_min(a * tens(in, -1, 0.5f), 0.5f));
    put_vec(in, wo);
    put_vec(in, wi);
}
static void in_bsdf_sample(input *in) {
    put_bsdf(in);
    put_vec(in, upward(in));
    put_real(in, unit(in));
    put_units(in);
}
static void in_bsdf_albedo(input *in) {
    put_bsdf(in);
    put_vec(in, upward(in));
}

static void put_surface_light(input *in, hyk_light *l, hyk_vec3 *p) {
    const uint32_t kinds[] = {HYK_LIGHT_RECT, HYK_LIGHT_DISC, HYK_LIGHT_SPHERE, HYK_LIGHT_TRIANGLE};
    make_light(in, kinds[in->i % 4], l, p);
    put_light(in, l);
    put_vec(in, *p);
}
static void in_light_point(input *in) {
    hyk_light l;
    hyk_vec3 p;
    make_light(in, in->i % 2 ? HYK_LIGHT_POINT : HYK_LIGHT_SPOT, &l, &p);
    put_light(in, &l);
    put_vec(in, p);
}
static void in_light_surface(input *in) {
    hyk_light l;
    hyk_vec3 p;
    put_surface_light(in, &l, &p);
    put_units(in);
}
/* The direction from p to a place on the light. */
static hyk_vec3 towards(input *in, const hyk_light *l, hyk_vec3 p) {
    float u = any(in, -0.7f, 0.7f), v = any(in, -0.7f, 0.7f);
    hyk_vec3 x = l->axis_u, y = l->axis_v;
    if (l->kind == HYK_LIGHT_TRIANGLE) u = any(in, 0.05f, 0.45f), v = any(in, 0.05f, 0.45f);
    if (l->kind == HYK_LIGHT_DISC || l->kind == HYK_LIGHT_SPHERE) {
        around(l->normal, &x, &y);
        x = times(x, l->radius);
        y = times(y, l->radius);
    }
    hyk_vec3 q = hyk_add_scaled(hyk_add_scaled(l->position, x, u), y, v);
    return rounded((double)q.x - (double)p.x, (double)q.y - (double)p.y, (double)q.z - (double)p.z);
}
static void in_light_density(input *in) {
    hyk_light l;
    hyk_vec3 p;
    put_surface_light(in, &l, &p);
    put_vec(in, towards(in, &l, p));
}
static void in_light_sun(input *in) {
    hyk_light l;
    hyk_vec3 p;
    make_light(in, HYK_LIGHT_SUN, &l, &p);
    if (once_in(in, 6)) l.radius = 0;
    put_light(in, &l);
    put_vec(in, direction(in));
    put_vec(in, near_to(in, l.normal, any(in, 0, 2) * l.radius));
    put(in, below(in, 2));
    put_units(in);
}
static void in_light_shape(input *in) {
    hyk_light l;
    hyk_vec3 p;
    make_light(in, in->i % 3, &l, &p);
    put_light(in, &l);
    put_vec(in, p);
    put_real(in, 0);
    float length = once_in(in, 3) ? tens(in, -6, 6) : 1;
    put_vec(in, times(once_in(in, 3) ? direction(in) : towards(in, &l, p), length));
    put_real(in, 3.402823466e+38f);
}
static void in_light_bound(input *in) {
    put(in, any_of(in, in->scene->light_node_count));
    put_lit_point(in);
}
static void in_light_pick(input *in) {
    put_lit_point(in);
    put_units(in);
    put(in, below(in, in->scene->view.constants.finite_lights));
}
static void in_light_any(input *in) {
    put_lit_point(in);
    put_real(in, unit(in));
    put_units(in);
}
static void in_light_pdf(input *in) {
    uint32_t light = below(in, in->scene->view.constants.finite_lights);
    hyk_vec3 p = place(in, 3);
    put(in, light);
    put_vec(in, p);
    put_vec(in, direction(in));
    put(in, below(in, 2));
    put_vec(in, towards(in, &in->scene->view.lights[light], p));
    put_real(in, 1);
}
static void in_light_far(input *in) {
    const hyk_scene_constants *c = &in->scene->view.constants;
    uint32_t sun = below(in, c->suns + 1);
    hyk_vec3 d = direction(in);
    put(in, sun);
    put_lit_point(in);
    if (sun) {
        const hyk_light *light = &in->scene->view.lights[c->finite_lights + sun - 1];
        d = near_to(in, light->normal, any(in, 0, 1.5f) * light->radius);
    }
    put_vec(in, d);
}

static void in_offset(input *in) {
    float size = tens(in, -6, 6);
    put_vec(in, place(in, size));
    put_vec(in, direction(in));
    put_real(in, size * tens(in, -8, -6));
    put_vec(in, times(direction(in), tens(in, -6, 6)));
    put_vec(in, times(direction(in), tens(in, -6, 6)));
}
static void in_place(input *in) {
    put(in, any_of(in, in->scene->placed_count));
    hyk_vec3 p = place(in, tens(in, -3, 3));
    put_vec(in, p);
    put_vec(in, times(hyk_abs3(p), 1e-7f));
}
static void in_surface(input *in) {
    put_triangle(in);
    put_vec(in, direction(in));
    put_real(in, once_in(in, 3) ? 0 : tens(in, -4, 0));
}
static void in_material(input *in) {
    put_real(in, tens(in, -2, 2));
    put(in, any_of(in, in->scene->view_material_count));
    put_uv(in);
    put_real(in, once_in(in, 3) ? 0 : tens(in, -4, 0));
}
static void in_shadow(input *in) {
    hyk_vec3 p = place(in, tens(in, -2, 4)), d = direction(in);
    float distance = tens(in, -2, 4);
    put_vec(in, p);
    put_vec(in, d);
    put_real(in, distance);
    put_vec(in, hyk_add_scaled(p, d, distance));
    put_vec(in, direction(in));
    put_sampler(in);
}
static void in_survival(input *in) {
    put_sampler(in);
    put_vec(in, times(hyk_abs3(direction(in)), tens(in, -3, 1)));
    put_real(in, any(in, 0.4f, 2.5f));
    put(in, below(in, 100));
    put(in, ht_u32(in->rng) & 0x1ffu);
}
static void in_escape(input *in) {
    const hyk_scene_constants *c = &in->scene->view.constants;
    hyk_vec3 d = direction(in);
    if (once_in(in, 2)) d = near_to(in, in->scene->view.lights[c->finite_lights].normal, 0.5f * in->scene->view.lights[c->finite_lights].radius);
    put(in, below(in, 3));
    put_vec(in, place(in, 3));
    put_vec(in, d);
    put_sampler(in);
    put_vec(in, direction(in));
    put_vec(in, hyk_make3(ht_uniform(in->rng), ht_uniform(in->rng), 1));
    put_real(in, once_in(in, 4) ? 0 : tens(in, -2, 3));
    put(in, ht_u32(in->rng) & 0x7fu);
}
static void in_first_path(input *in) {
    hyk_camera c = make_camera(in);
    put_camera(in, &c);
    put(in, ht_u32(in->rng));
    put(in, ht_u32(in->rng));
    put(in, below(in, c.width));
    put(in, below(in, c.height));
    put(in, ht_u32(in->rng) >> below(in, 32));
}

/* Hits of triangles; in between of lights' own shapes, and of nothing. */
static void in_shade(input *in) {
    const hydra_scene *scene = in->scene;
    bool from_sensor = once_in(in, 4);
    hyk_vec3 vertex = place(in, 3), d = direction(in);
    uint32_t kind = below(in, 8), shape = scene->shape_lights[below(in, scene->shape_count)];
    if (kind == 0) d = towards(in, &scene->view.lights[shape], vertex);
    put_vec(in, vertex);
    put_vec(in, d);
    put_vec(in, hyk_make3(any(in, 0.1f, 1), any(in, 0.1f, 1), any(in, 0.1f, 1)));
    put_real(in, from_sensor || once_in(in, 4) ? 0 : tens(in, -1, 2));
    put_vec(in, direction(in));
    put(in, from_sensor ? HYK_PATH_FROM_SENSOR : ht_u32(in->rng) & 0x17eu);
    put_vec(in, hyk_make3(any(in, 0.1f, 1), any(in, 0.1f, 1), any(in, 0.1f, 1)));
    put(in, from_sensor ? 5 : below(in, 6));
    put_sampler(in);
    put(in, from_sensor ? 0 : below(in, 10));
    put_real(in, any(in, 0, 0.1f));
    put_real(in, tens(in, -4, -1));
    put_vec(in, vertex);
    put_real(in, once_in(in, 3) ? any(in, 0.4f, 2.5f) : 1);
    put_real(in, any(in, 0.5f, 4));
    if (kind > 1) {
        uint32_t at = in->count;
        put_triangle(in); /* instance, triangle, u, v; of a hit they stand in another order */
        uint32_t words[4];
        memcpy(words, in->words + at, sizeof words);
        const uint32_t turned[4] = {words[2], words[3], words[0], words[1]};
        memcpy(in->words + at, turned, sizeof turned);
        return;
    }
    put_real(in, 0);
    put_real(in, 0);
    put(in, kind == 0 ? HYK_HIT_SHAPE : HYK_NONE);
    put(in, kind == 0 ? shape : HYK_NONE);
}

#define in_hashes in_whole
#define in_pair in_whole
#define in_plan in_whole
#define in_disc in_units
#define in_hemisphere in_units
#define in_sky_place in_sky

#endif /* KERNELS_INPUTS_H */
