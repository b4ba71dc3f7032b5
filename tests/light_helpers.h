/* What the tests of light sampling share: random numbers and vectors of the truth, which is computed in double from
   formulas that share nothing with the kernels; lights and scenes of them put together without hydra_scene; the kernels.
   For files that have a copy of the library of their own. */
#ifndef LIGHT_HELPERS_H
#define LIGHT_HELPERS_H

#include "truth_helpers.h"

#define ALL_FEATURES \
    (HYK_NEEDS_EMITTERS | HYK_NEEDS_SHAPES | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT | HYK_NEEDS_ENVIRONMENT_MAP | HYK_NEEDS_TEXTURES)

/* ---------------------------------------------------------------- random numbers and vectors */

static inline double between(ht_rng *r, double lo, double hi) { return lo + (hi - lo) * truth_rng_unit(r); }
static inline hyk_vec2 next2(ht_rng *r) {
    float x = ht_uniform(r);
    return hyk_make2(x, ht_uniform(r));
}

static inline truth_v3 from3(hyk_vec3 a) { return truth_v((double)a.x, (double)a.y, (double)a.z); }
static inline hyk_vec3 to3(truth_v3 a) { return hyk_make3((float)a.x, (float)a.y, (float)a.z); }
static inline truth_v3 plus(truth_v3 a, truth_v3 b, double s) { return truth_add(a, truth_mul(b, s)); }

/* ---------------------------------------------------------------- lights and scenes */

static inline hyk_light empty_light(hyk_uint kind, double radiance) {
    hyk_light l;
    memset(&l, 0, sizeof l);
    l.kind = kind;
    l.radiance = hyk_splat((float)radiance);
    l.instance = l.primitive = HYK_NONE;
    return l;
}
static inline hyk_light sheet_light(hyk_uint kind, truth_v3 center, truth_v3 u, truth_v3 v, double radiance) {
    hyk_light l = empty_light(kind, radiance);
    truth_v3 n = truth_cross(u, v);
    l.position = to3(center);
    l.axis_u = to3(u);
    l.axis_v = to3(v);
    l.normal = to3(truth_unit(n));
    l.area = (float)(truth_length(n) * (kind == HYK_LIGHT_RECT ? 4.0 : 0.5));
    return l;
}
static inline hyk_light rect_light(truth_v3 center, truth_v3 u, truth_v3 v, double radiance) {
    return sheet_light(HYK_LIGHT_RECT, center, u, v, radiance);
}
static inline hyk_light triangle_light(truth_v3 a, truth_v3 ab, truth_v3 ac, double radiance) {
    return sheet_light(HYK_LIGHT_TRIANGLE, a, ab, ac, radiance);
}
static inline hyk_light disc_light(truth_v3 center, truth_v3 normal, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_DISC, radiance);
    l.position = to3(center);
    l.normal = to3(truth_unit(normal));
    l.radius = (float)radius;
    l.area = (float)(HT_PI * radius * radius);
    return l;
}
static inline hyk_light sphere_light(truth_v3 center, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_SPHERE, radiance);
    l.position = to3(center);
    l.radius = (float)radius;
    l.area = (float)(4 * HT_PI * radius * radius);
    return l;
}
static inline hyk_light point_light(truth_v3 position, double intensity) {
    hyk_light l = empty_light(HYK_LIGHT_POINT, intensity);
    l.position = to3(position);
    return l;
}
static inline hyk_light spot_light(truth_v3 position, truth_v3 axis, double inner, double outer, double intensity) {
    hyk_light l = empty_light(HYK_LIGHT_SPOT, intensity);
    l.position = to3(position);
    l.normal = to3(truth_unit(axis));
    l.cos_inner = (float)cos(inner);
    l.cos_outer = (float)cos(outer);
    return l;
}
static inline hyk_light sun_light(truth_v3 towards, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_SUN, radiance);
    l.normal = to3(truth_unit(towards));
    l.radius = (float)radius;
    l.cos_outer = (float)cos(radius);
    return l;
}

typedef struct light_scene {
    hydra_context context;
    hyk_scene_view view;
    hyk_light_node *nodes;
    uint32_t node_count;
    float *cdf;
    size_t cdf_count;
} light_scene;

static inline void open_scene(light_scene *s, hyk_light *lights, uint32_t finite, uint32_t suns) {
    memset(s, 0, sizeof *s);
    s->context.desc.allocator.alloc = hyi_default_alloc;
    s->context.desc.allocator.release = hyi_default_release;
    s->context.threads = 1;
    assert_int_equal(hyi_light_tree_build(&s->context, lights, finite, &s->nodes, &s->node_count), HYDRA_OK);
    s->view.lights = lights;
    s->view.light_nodes = s->nodes;
    s->view.constants.finite_lights = finite;
    s->view.constants.suns = suns;
    s->view.constants.light_nodes = s->node_count;
}
static inline void set_map(light_scene *s, const float *texels, uint32_t width, uint32_t height, double factor, double rotation) {
    hyk_scene_constants *c = &s->view.constants;
    assert_int_equal(hyi_environment_build(&s->context, texels, width, height, &s->cdf, &s->cdf_count, &c->environment_integral), HYDRA_OK);
    s->view.environment = texels;
    s->view.environment_cdf = s->cdf;
    c->environment = hyk_splat((float)factor);
    c->environment_rotation = (float)rotation;
    c->environment_width = width;
    c->environment_height = height;
}
static inline void close_scene(light_scene *s) {
    hyi_free_array(&s->context, &s->nodes, s->node_count);
    hyi_free_array(&s->context, &s->cdf, s->cdf_count);
    assert_int_equal(hyi_atomic_load(&s->context.bytes_now), 0);
}

/* The kernels are inlined wherever they are called: once here is enough. */
HYI_NOINLINE hyk_light_sample sample_scene(const light_scene *s, hyk_vec3 p, hyk_vec3 n, bool both_sides, ht_rng *r) {
    float u = ht_uniform(r);
    return hyk_sample_lights(&s->view, p, n, both_sides, u, next2(r), ALL_FEATURES);
}
HYI_NOINLINE hyk_light_sample sample_light(const light_scene *s, uint32_t light, hyk_vec3 p, ht_rng *r) {
    return hyk_sample_finite_light(&s->view, light, p, next2(r), ALL_FEATURES);
}
HYI_NOINLINE double light_density(const light_scene *s, uint32_t light, hyk_vec3 p, hyk_vec3 n, bool both_sides, hyk_vec3 d, double t,
                                  hyk_vec3 light_normal) {
    return (double)hyk_pdf_light(&s->view, light, p, n, both_sides, d, (float)t, light_normal, ALL_FEATURES);
}
HYI_NOINLINE double sky_density(const light_scene *s, uint32_t which, hyk_vec3 p, hyk_vec3 n, bool both_sides, hyk_vec3 d) {
    return (double)hyk_pdf_infinite(&s->view, which, p, n, both_sides, d, ALL_FEATURES);
}
HYI_NOINLINE hyk_vec3 sky(const light_scene *s, hyk_vec3 d) { return hyk_environment_radiance(&s->view, d, ALL_FEATURES); }
HYI_NOINLINE hyk_light_pick pick_light(const light_scene *s, hyk_vec3 p, hyk_vec3 n, ht_rng *r) {
    float u = ht_uniform(r);
    return hyk_pick_light(&s->view, p, n, false, hyk_start_choosing(u, next2(r)));
}
HYI_NOINLINE double pick_probability(const light_scene *s, uint32_t light, hyk_vec3 p, hyk_vec3 n) {
    return (double)hyk_light_pick_probability(&s->view, s->view.lights[light].tree_path, p, n, false);
}

/* ---------------------------------------------------------------- estimates */

/* Within 4 standard errors, which must be below bound times the truth; rounding is granted 1e-5. */
static inline void expect_mean(const char *what, const ht_stats *stats, double truth, double bound) {
    truth_estimate estimate = {stats->mean, ht_standard_error(stats)};
    truth_expect_at(__FILE__, __LINE__, what, estimate, truth, bound, 1e-5);
}

/* The chance that one of so many tests, all right, may have of failing, so that all together have 1 % (Sidak 1967). */
static inline double sidak(double tests) { return 1 - pow(1 - 0.01, 1 / tests); }

static inline ht_stats irradiance(const light_scene *s, hyk_vec3 p, hyk_vec3 n, uint32_t count, ht_rng *r) {
    ht_stats m = {0, 0, 0};
    for (uint32_t i = 0; i < count; i++) {
        hyk_light_sample q = sample_scene(s, p, n, false, r);
        double value = q.flags & HYK_SAMPLE_VALID ? (double)q.radiance.x / (double)q.pdf * (double)hyk_dot(n, q.direction) : 0;
        ht_add(&m, value);
    }
    return m;
}

#endif /* LIGHT_HELPERS_H */
