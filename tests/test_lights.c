/* Sampling of lights: shapes, warps, densities, the light tree, suns and the environment. The truth is computed
   here in double, from formulas that share nothing with the kernels. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

#define PI 3.14159265358979323846
#define ALL_FEATURES (HYK_NEEDS_EMITTERS | HYK_NEEDS_SHAPES | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT | HYK_NEEDS_ENVIRONMENT_MAP | HYK_NEEDS_TEXTURES)

int hydra_test_lights(void);

/* ---------------------------------------------------------------- random numbers and small vectors, in double */

typedef struct rng { uint64_t state; } rng;

static double next(rng *r) { /* splitmix64, 24 bits as the renderer's numbers have */
    uint64_t z = (r->state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double)((z ^ (z >> 31)) >> 40) * (1.0 / 16777216.0);
}
static double between(rng *r, double lo, double hi) { return lo + (hi - lo) * next(r); }
static hyk_vec2 next2(rng *r) {
    float x = (float)next(r);
    return hyk_make2(x, (float)next(r));
}

typedef struct vec { double x, y, z; } vec;

static vec v3(double x, double y, double z) { vec v = {x, y, z}; return v; }
static vec from3(hyk_vec3 a) { return v3((double)a.x, (double)a.y, (double)a.z); }
static hyk_vec3 to3(vec a) { return hyk_make3((float)a.x, (float)a.y, (float)a.z); }
static vec plus(vec a, vec b, double s) { return v3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z); }
static vec minus(vec a, vec b) { return plus(a, b, -1.0); }
static vec times(vec a, double s) { return v3(s * a.x, s * a.y, s * a.z); }
static double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static vec cross(vec a, vec b) { return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x); }
static double length(vec a) { return sqrt(dot(a, a)); }
static vec unit(vec a) { return times(a, 1.0 / length(a)); }
static vec random_unit(rng *r) {
    double z = between(r, -1, 1), phi = 2 * PI * next(r), s = sqrt(1 - z * z);
    return v3(s * cos(phi), s * sin(phi), z);
}

/* ---------------------------------------------------------------- lights and scenes */

static hyk_light empty_light(hyk_uint kind, double radiance) {
    hyk_light l;
    memset(&l, 0, sizeof l);
    l.kind = kind;
    l.radiance = hyk_splat((float)radiance);
    l.instance = l.primitive = HYK_NONE;
    return l;
}
static hyk_light sheet_light(hyk_uint kind, vec center, vec u, vec v, double radiance) {
    hyk_light l = empty_light(kind, radiance);
    vec n = cross(u, v);
    l.position = to3(center);
    l.axis_u = to3(u);
    l.axis_v = to3(v);
    l.normal = to3(unit(n));
    l.area = (float)(length(n) * (kind == HYK_LIGHT_RECT ? 4.0 : 0.5));
    return l;
}
static hyk_light rect_light(vec center, vec u, vec v, double radiance) { return sheet_light(HYK_LIGHT_RECT, center, u, v, radiance); }
static hyk_light triangle_light(vec a, vec ab, vec ac, double radiance) { return sheet_light(HYK_LIGHT_TRIANGLE, a, ab, ac, radiance); }
static hyk_light disc_light(vec center, vec normal, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_DISC, radiance);
    l.position = to3(center);
    l.normal = to3(unit(normal));
    l.radius = (float)radius;
    l.area = (float)(PI * radius * radius);
    return l;
}
static hyk_light sphere_light(vec center, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_SPHERE, radiance);
    l.position = to3(center);
    l.radius = (float)radius;
    l.area = (float)(4 * PI * radius * radius);
    return l;
}
static hyk_light point_light(vec position, double intensity) {
    hyk_light l = empty_light(HYK_LIGHT_POINT, intensity);
    l.position = to3(position);
    return l;
}
static hyk_light spot_light(vec position, vec axis, double inner, double outer, double intensity) {
    hyk_light l = empty_light(HYK_LIGHT_SPOT, intensity);
    l.position = to3(position);
    l.normal = to3(unit(axis));
    l.cos_inner = (float)cos(inner);
    l.cos_outer = (float)cos(outer);
    return l;
}
static hyk_light sun_light(vec towards, double radius, double radiance) {
    hyk_light l = empty_light(HYK_LIGHT_SUN, radiance);
    l.normal = to3(unit(towards));
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

static void open_scene(light_scene *s, hyk_light *lights, uint32_t finite, uint32_t suns) {
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
static void set_map(light_scene *s, const float *texels, uint32_t width, uint32_t height, double factor, double rotation) {
    hyk_scene_constants *c = &s->view.constants;
    assert_int_equal(hyi_environment_build(&s->context, texels, width, height, &s->cdf, &s->cdf_count, &c->environment_integral), HYDRA_OK);
    s->view.environment = texels;
    s->view.environment_cdf = s->cdf;
    c->environment = hyk_splat((float)factor);
    c->environment_rotation = (float)rotation;
    c->environment_width = width;
    c->environment_height = height;
}
static void close_scene(light_scene *s) {
    hyi_free_array(&s->context, &s->nodes, s->node_count);
    hyi_free_array(&s->context, &s->cdf, s->cdf_count);
    assert_int_equal(hyi_atomic_load(&s->context.bytes_now), 0);
}

/* The kernels are inlined wherever they are called: once here is enough. */
HYI_NOINLINE hyk_light_sample sample_scene(const light_scene *s, hyk_vec3 p, hyk_vec3 n, bool both_sides, rng *r) {
    float u = (float)next(r);
    return hyk_sample_lights(&s->view, p, n, both_sides, u, next2(r), ALL_FEATURES);
}
HYI_NOINLINE hyk_light_sample sample_light(const light_scene *s, uint32_t light, hyk_vec3 p, rng *r) {
    return hyk_sample_finite_light(&s->view, light, p, next2(r), ALL_FEATURES);
}
HYI_NOINLINE double light_density(const light_scene *s, uint32_t light, hyk_vec3 p, hyk_vec3 n, bool both_sides, hyk_vec3 d, double t, hyk_vec3 light_normal) {
    return (double)hyk_pdf_light(&s->view, light, p, n, both_sides, d, (float)t, light_normal, ALL_FEATURES);
}
HYI_NOINLINE double sky_density(const light_scene *s, uint32_t which, hyk_vec3 p, hyk_vec3 n, bool both_sides, hyk_vec3 d) {
    return (double)hyk_pdf_infinite(&s->view, which, p, n, both_sides, d, ALL_FEATURES);
}
HYI_NOINLINE hyk_vec3 sky(const light_scene *s, hyk_vec3 d) { return hyk_environment_radiance(&s->view, d, ALL_FEATURES); }
HYI_NOINLINE hyk_light_pick pick_light(const light_scene *s, hyk_vec3 p, hyk_vec3 n, rng *r) {
    float u = (float)next(r);
    return hyk_pick_light(&s->view, p, n, false, hyk_start_choosing(u, next2(r)));
}
HYI_NOINLINE double pick_probability(const light_scene *s, uint32_t light, hyk_vec3 p, hyk_vec3 n) {
    return (double)hyk_light_pick_probability(&s->view, s->view.lights[light].tree_path, p, n, false);
}

static hyk_ray ray_of(hyk_vec3 origin, hyk_vec3 direction) {
    hyk_ray r;
    r.origin = origin;
    r.direction = direction;
    r.t_min = 0.0f;
    r.t_max = HYK_REAL_MAX;
    return r;
}

/* ---------------------------------------------------------------- statistics */

typedef struct mean { double sum, squares; uint32_t count; } mean;

static void gather(mean *m, double x) { m->sum += x; m->squares += x * x; m->count++; }
static double average(const mean *m) { return m->sum / m->count; }
static double variance(const mean *m) { return fmax(m->squares / m->count - average(m) * average(m), 0.0) / m->count; }

/* Within 4 standard errors, which must be below bound times the truth; rounding is granted 1e-5. */
static void assert_estimate(const char *what, const mean *m, double truth, double bound) {
    double error = sqrt(variance(m));
    if (fabs(average(m) - truth) <= 4 * error + 1e-5 * fabs(truth) && error <= bound * fabs(truth)) return;
    fail_msg("%s: %.9g +- %.3g, truth %.9g (%.1f sigma)", what, average(m), error, truth, (average(m) - truth) / (error + 1e-300));
}

/* Q(a, x), the upper regularised incomplete gamma function: series below, continued fraction above. */
static double gamma_q(double a, double x) {
    double front = exp(-x + a * log(x) - lgamma(a));
    if (x < a + 1) {
        double term = 1 / a, sum = term;
        for (int i = 1; i < 10000 && term > sum * 1e-15; i++) sum += term *= x / (a + i);
        return 1 - front * sum;
    }
    double b = x + 1 - a, c = 1e300, d = 1 / b, h = d;
    for (int i = 1; i < 10000; i++) {
        double an = -i * (i - a), step;
        b += 2;
        d = 1 / (an * d + b);
        c = b + an / c;
        step = c * d;
        h *= step;
        if (fabs(step - 1) < 1e-15) break;
    }
    return front * h;
}

/* The chance of a worse chi-square; cells that expect fewer than 5 are pooled. */
static double chi_square_chance(const double *observed, const double *expected, uint32_t cells) {
    double chi = 0, pooled_o = 0, pooled_e = 0;
    uint32_t freedom = 0;
    for (uint32_t i = 0; i < cells; i++) {
        if (expected[i] < 5) {
            pooled_o += observed[i];
            pooled_e += expected[i];
            continue;
        }
        chi += (observed[i] - expected[i]) * (observed[i] - expected[i]) / expected[i];
        freedom++;
    }
    if (pooled_e > 5) {
        chi += (pooled_o - pooled_e) * (pooled_o - pooled_e) / pooled_e;
        freedom++;
    } else if (pooled_o > 25) {
        return 0; /* samples where the density says there are none */
    }
    return freedom < 2 ? 1.0 : gamma_q(0.5 * (freedom - 1), 0.5 * chi);
}
static double sidak(double tests) { return 1 - pow(1 - 0.01, 1 / tests); }

/* ---------------------------------------------------------------- intersection */

typedef long double wide;
typedef struct wvec { wide x, y, z; } wvec;
static wvec wide3(hyk_vec3 a) { wvec v; v.x = a.x; v.y = a.y; v.z = a.z; return v; }
static wide wdot(wvec a, wvec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static wvec wplus(wvec a, wvec b, wide s) { wvec v; v.x = a.x + s * b.x; v.y = a.y + s * b.y; v.z = a.z + s * b.z; return v; }
static wvec wcross(wvec a, wvec b) {
    wvec v;
    v.x = a.y * b.z - a.z * b.y;
    v.y = a.z * b.x - a.x * b.z;
    v.z = a.x * b.y - a.y * b.x;
    return v;
}

/* t, or -1; *margin: how far from the edge, in sizes of the shape. */
static wide true_hit(hyk_light l, hyk_ray r, wide *margin) {
    wvec o = wplus(wide3(r.origin), wide3(l.position), -1), d = wide3(r.direction);
    if (l.kind == HYK_LIGHT_SPHERE) {
        wide a = wdot(d, d), b = -wdot(o, d), radius = l.radius;
        wvec m = wplus(o, d, b / a);
        wide height = sqrtl(wdot(m, m)), half, c = wdot(o, o) - radius * radius;
        *margin = fabsl(height / radius - 1);
        if (height > radius) return -1;
        half = sqrtl((radius - height) * (radius + height) * a);
        if (c < 0) return (b + half) / a;
        return b > 0 ? (b - half) / a : -1;
    }
    wvec u = wide3(l.axis_u), v = wide3(l.axis_v), n = l.kind == HYK_LIGHT_DISC ? wide3(l.normal) : wcross(u, v);
    wide slope = wdot(n, d), t;
    if (slope == 0) return -1;
    t = -wdot(n, o) / slope;
    wvec w = wplus(o, d, t);
    wide x, y = 0;
    if (l.kind == HYK_LIGHT_DISC) {
        x = sqrtl(wdot(w, w)) / l.radius;
    } else {
        x = fabsl(wdot(w, wcross(v, n)) / wdot(u, wcross(v, n)));
        y = fabsl(wdot(w, wcross(n, u)) / wdot(v, wcross(n, u)));
    }
    *margin = fabsl((x > y ? x : y) - 1);
    return t > 0 && x <= 1 && y <= 1 ? t : -1;
}

static hyk_light random_shape(rng *r, double size) {
    vec c = times(random_unit(r), size * between(r, 0, 3));
    double pick = next(r);
    if (pick < 0.34) return sphere_light(c, size * between(r, 0.2, 1), 1);
    if (pick < 0.67) return disc_light(c, random_unit(r), size * between(r, 0.2, 1), 1);
    vec u = random_unit(r), v = random_unit(r); /* a parallelogram as often as not */
    if (next(r) < 0.5) v = unit(cross(u, v));
    return rect_light(c, times(u, size * between(r, 0.2, 1)), times(v, size * between(r, 0.2, 1)), 1);
}

/* Rays from near (1e-3 sizes) to far (1e4 sizes) at three scales. Error of t in units of the rounding of the
   distances involved; the answer hit or miss may differ only as near to the edge as rounding reaches. */
static void test_shapes_against_long_double(void **state) {
    (void)state;
    rng r = {1};
    double worst = 0;
    uint32_t hits = 0;
    for (uint32_t i = 0; i < 60000; i++) {
        double size = i % 3 == 0 ? 1 : i % 3 == 1 ? 1e-6 : 1e6, away = pow(10, between(&r, -3, 4)), wide_of;
        hyk_light l = random_shape(&r, size);
        vec target = plus(from3(l.position), random_unit(&r), size * between(&r, 0, 1.1));
        vec origin = plus(target, random_unit(&r), size * away);
        hyk_ray ray = ray_of(to3(origin), to3(times(minus(target, origin), pow(10, between(&r, -3, 3)) / size)));
        wide margin = 0, truth = true_hit(l, ray, &margin);
        float t = hyk_intersect_shape(l, ray);
        double slope = l.kind == HYK_LIGHT_SPHERE ? 1 : fabs(dot(from3(l.normal), unit(from3(ray.direction))));
        wide_of = (length(minus(from3(ray.origin), from3(l.position))) + 2 * size) * FLT_EPSILON / size; /* in sizes */
        double reach = 40 * wide_of / fmax(slope, 1e-3);
        if ((double)margin < reach) continue;
        if ((t >= 0) != (truth >= 0)) fail_msg("kind %u: t %g, truth %Lg, margin %Lg", l.kind, (double)t, truth, margin);
        if (truth < 0) continue;
        hits++;
        double step = length(from3(ray.direction)) / size, steep = l.kind == HYK_LIGHT_SPHERE ? sqrt((double)margin) : slope;
        worst = fmax(worst, fabs((double)((wide)t - truth)) * step / (wide_of / fmax(steep, 1e-6)));
    }
    print_message("  intersection: %u hits, worst error %.2f ulp of the distances / cosine\n", hits, worst);
    assert_true(hits > 10000);
    assert_true(worst < 8);
}

static void test_shape_edge_cases(void **state) {
    (void)state;
    hyk_light s = sphere_light(v3(0, 0, 0), 1, 3);
    hyk_ray r = ray_of(hyk_zero3(), hyk_make3(0, 0, 2));
    assert_float_equal(hyk_intersect_shape(s, r), 0.5, 1e-6); /* from inside */
    r.t_max = 0.25f;
    assert_true(hyk_intersect_shape(s, r) == -1.0f);
    r = ray_of(hyk_make3(0, 0, -3), hyk_make3(0, 0, 1));
    r.t_min = 2.5f;
    assert_float_equal(hyk_intersect_shape(s, r), 4.0, 1e-6); /* the near side is before t_min */
    assert_true(hyk_is_black(hyk_shape_radiance(s, hyk_make3(0, 0, 1), hyk_make3(0, 0, 1))));
    assert_float_equal(hyk_shape_radiance(s, hyk_make3(0, 0, 1), hyk_make3(0, 0, -1)).x, 3, 0);
    s.position = hyk_make3(0, 0, 1e15f);
    s.radius = 1e14f;
    assert_float_equal(hyk_intersect_shape(s, ray_of(hyk_zero3(), hyk_make3(0, 0, 1))) / 9e14f, 1, 1e-6);
    hyk_light d = disc_light(v3(0, 0, 1), v3(0, 0, -1), 1, 3);
    r = ray_of(hyk_zero3(), hyk_make3(1, 0, 0)); /* in parallel */
    assert_true(hyk_intersect_shape(d, r) == -1.0f);
    r = ray_of(hyk_make3(0, 0, 1), hyk_make3(1, 0, 0)); /* within the sheet */
    assert_true(hyk_intersect_shape(d, r) == -1.0f);
    assert_float_equal(hyk_intersect_shape(d, ray_of(hyk_make3(0, 0, 3), hyk_make3(0, 0, -1))), 2, 1e-6); /* from behind */
    assert_true(hyk_is_black(hyk_shape_radiance(d, d.normal, hyk_make3(0, 0, -1))));
    d.flags = HYK_LIGHT_BOTH_SIDES;
    assert_float_equal(hyk_shape_radiance(d, d.normal, hyk_make3(0, 0, -1)).x, 3, 0);
    assert_true(hyk_intersect_shape(point_light(v3(0, 0, 1), 1), r) == -1.0f);
}

/* ---------------------------------------------------------------- warps and weights */

static void test_warps(void **state) {
    (void)state;
    rng r = {2};
    mean cosine = {0, 0, 0}, cone = {0, 0, 0}, linear = {0, 0, 0};
    for (int i = 0; i < 100000; i++) {
        hyk_vec2 u = next2(&r);
        hyk_vec3 c = hyk_sample_cosine_hemisphere(u), k = hyk_sample_cone(1e-10f, u);
        assert_float_equal(length(from3(c)), 1, 1e-6);
        assert_true(c.z > 0);
        gather(&cosine, (double)c.z);          /* mean 2/3 */
        gather(&cone, 0.5e10 * (double)(k.x * k.x + k.y * k.y)); /* 1/2: uniform in 1 - cos, at 1e-10 too */
        gather(&linear, (double)hyk_sample_linear(u.x, 1e30f, 3e30f)); /* 7/12 */
    }
    assert_estimate("cosine", &cosine, 2.0 / 3, 2e-3);
    assert_estimate("cone", &cone, 0.5, 3e-3);
    assert_estimate("linear", &linear, 7.0 / 12, 2e-3);
}

static void test_power_heuristic(void **state) {
    (void)state;
    assert_float_equal(hyk_power_heuristic(1, 2), 0.2, 1e-7);
    assert_float_equal(hyk_power_heuristic(3e30f, 4e30f), 0.36, 1e-6);
    assert_float_equal(hyk_power_heuristic(3e-30f, 4e-30f), 0.36, 1e-6);
    assert_true(hyk_power_heuristic(1e38f, 1e-38f) == 1 && hyk_power_heuristic(1e-38f, 1e38f) == 0);
    assert_true(hyk_power_heuristic(0, 0) == 0 && hyk_power_heuristic(0, 1) == 0 && hyk_power_heuristic(1, 0) == 1);
    assert_true(hyk_power_heuristic(HYK_REAL_MAX, HYK_REAL_MAX) == 0.5f);
}

/* A chain of 30 choices between halves must reach each of 2^20 blocks of leaves evenly, and a branch of 1e-9
   must be as rare as it says: beyond what 24 bits can tell. */
static void test_chooser(void **state) {
    (void)state;
    rng r = {3};
    enum { CELLS = 1024, COUNT = 1 << 18 };
    static double observed[CELLS], expected[CELLS];
    double rare = 0;
    memset(observed, 0, sizeof observed);
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_chooser c = hyk_start_choosing((float)next(&r), next2(&r));
        uint32_t leaf = 0;
        for (int level = 0; level < 30; level++) {
            c = hyk_choose(c, 1, 1);
            leaf = 2 * leaf + (c.second ? 1 : 0);
        }
        observed[leaf % CELLS]++; /* the last ten choices, long after the bits of u ran out */
        /* u = 0 happens once in 2^24; given that, the rare branch has 1e-9 * 2^24 */
        c = hyk_choose(hyk_start_choosing(0, next2(&r)), 1e-9f, 1.0f);
        if (!c.second) rare++;
        c = hyk_choose(hyk_start_choosing(HYK_BELOW_ONE, next2(&r)), 1.0f, 1e-9f);
        if (c.second) rare++;
    }
    for (uint32_t i = 0; i < CELLS; i++) expected[i] = (double)COUNT / CELLS;
    assert_true(chi_square_chance(observed, expected, CELLS) > 0.01);
    double truth = 2.0 * COUNT * 1e-9 * 16777216.0;
    assert_true(fabs(rare - truth) < 4 * sqrt(truth));
}

/* ---------------------------------------------------------------- densities of surface lights */

/* Where on the light a sample lies, as a place in the unit square, and back. */
static hyk_vec2 place_on(hyk_light l, vec point) {
    vec w = minus(point, from3(l.position)), u = from3(l.axis_u), v = from3(l.axis_v), n = from3(l.normal);
    if (l.kind == HYK_LIGHT_DISC) {
        hyk_frame f = hyk_make_frame(l.normal);
        double x = dot(w, from3(f.x)), y = dot(w, from3(f.y)), radius = (double)l.radius;
        return hyk_make2((float)((x * x + y * y) / (radius * radius)), (float)(atan2(y, x) / (2 * PI) + 0.5));
    }
    double a = dot(w, cross(v, n)) / dot(u, cross(v, n)), b = dot(w, cross(n, u)) / dot(v, cross(n, u));
    if (l.kind == HYK_LIGHT_RECT) return hyk_make2((float)(0.5 * a + 0.5), (float)(0.5 * b + 0.5));
    return hyk_make2((float)((a + b) * (a + b)), (float)(a + b > 0 ? b / (a + b) : 0)); /* TRIANGLE */
}
static vec point_at(hyk_light l, double s, double t) {
    vec c = from3(l.position), u = from3(l.axis_u), v = from3(l.axis_v);
    if (l.kind == HYK_LIGHT_DISC) {
        hyk_frame f = hyk_make_frame(l.normal);
        double phi = 2 * PI * (t - 0.5), rho = sqrt(s) * (double)l.radius;
        return plus(plus(c, from3(f.x), rho * cos(phi)), from3(f.y), rho * sin(phi));
    }
    if (l.kind == HYK_LIGHT_RECT) return plus(plus(c, u, 2 * s - 1), v, 2 * t - 1);
    return plus(plus(c, u, sqrt(s) * (1 - t)), v, sqrt(s) * t);
}

enum { GRID = 12, FINE = 20 };

/* Expected share of samples in each cell of the place square: the kernel's own density, times the true
   solid angle of each small piece of the light. */
static double expected_shares(const light_scene *s, hyk_light l, vec p, hyk_vec3 n, double *shares) {
    double sum = 0, area = (double)l.area / (GRID * FINE) / (GRID * FINE);
    for (int i = 0; i < GRID * GRID; i++) shares[i] = 0;
    for (int i = 0; i < GRID * FINE; i++)
        for (int j = 0; j < GRID * FINE; j++) {
            vec to = minus(point_at(l, (i + 0.5) / (GRID * FINE), (j + 0.5) / (GRID * FINE)), p);
            double d = length(to), solid = area * fabs(dot(from3(l.normal), to)) / (d * d * d);
            double pdf = light_density(s, 0, to3(p), n, true, to3(unit(to)), d, l.normal);
            shares[i / FINE * GRID + j / FINE] += pdf * solid;
            sum += pdf * solid;
        }
    return sum;
}

/* kind, seen from a point at that distance (in sizes) and that height angle over its plane. */
static hyk_light posed_light(rng *r, hyk_uint kind, double size) {
    vec c = times(random_unit(r), size), u = times(random_unit(r), size), v = times(random_unit(r), size * between(r, 0.3, 1));
    if (kind == HYK_LIGHT_DISC) return disc_light(c, u, size, 1);
    if (kind == HYK_LIGHT_TRIANGLE) return triangle_light(c, u, v, 1);
    if (next(r) < 0.7) v = times(unit(cross(u, v)), length(v));
    return rect_light(c, u, v, 1);
}

typedef struct pose { double away, angle, scale; } pose;
static const pose poses[] = {
    {0.15, 1.2, 1}, {0.5, 1.5, 1}, {0.7, 0.3, 1}, {1, 0.8, 1}, {1.2, 0.15, 1}, {2, 0.5, 1}, {2, 0.02, 1}, {5, 1, 1},
    {30, 0.7, 1}, {1e3, 0.9, 1}, {1e4, 0.01, 1}, {1, 0.8, 1e-6}, {1, 0.8, 1e6}, {3, 0.05, 1e-6}, {100, 0.3, 1e6}
};
static const hyk_uint sheets[] = {HYK_LIGHT_RECT, HYK_LIGHT_TRIANGLE, HYK_LIGHT_DISC};

static vec pose_point(rng *r, hyk_light l, pose at) {
    vec middle = l.kind == HYK_LIGHT_TRIANGLE ? point_at(l, 0.44, 0.5) : from3(l.position), n = from3(l.normal);
    vec side = unit(cross(n, random_unit(r)));
    return plus(plus(middle, side, at.away * at.scale * cos(at.angle)), n, at.away * at.scale * sin(at.angle));
}

static void check_density(rng *r, hyk_uint kind, pose at, double *worst_sum, double *worst_chance) {
    enum { COUNT = 20000 };
    hyk_light l = posed_light(r, kind, at.scale);
    vec p = from3(to3(pose_point(r, l, at)));
    hyk_vec3 n = to3(random_unit(r));
    light_scene s;
    open_scene(&s, &l, 1, 0);
    double shares[GRID * GRID], expected[GRID * GRID], observed[GRID * GRID];
    double sum = expected_shares(&s, l, p, n, shares);
    for (int i = 0; i < GRID * GRID; i++) expected[i] = COUNT * shares[i] / sum, observed[i] = 0;
    for (int i = 0; i < COUNT; i++) {
        hyk_light_sample q = sample_scene(&s, to3(p), n, true, r);
        assert_true(q.flags == (HYK_SAMPLE_VALID | HYK_SAMPLE_SURFACE));
        hyk_vec2 place = place_on(l, from3(q.position));
        int x = (int)(fmin(fmax((double)place.x, 0), 0.99999) * GRID), y = (int)(fmin(fmax((double)place.y, 0), 0.99999) * GRID);
        observed[x * GRID + y]++;
    }
    double chance = chi_square_chance(observed, expected, GRID * GRID);
    if (fabs(sum - 1) > fabs(*worst_sum)) *worst_sum = sum - 1;
    if (chance < *worst_chance) *worst_chance = chance;
    if (fabs(sum - 1) > 0.004 || chance < sidak(2 * HYI_COUNT(sheets) * HYI_COUNT(poses)))
        fail_msg("kind %u away %g angle %g scale %g: integral %.5f, chance %.3g", kind, at.away, at.angle, at.scale, sum, chance);
    close_scene(&s);
}

static void test_sheet_densities(void **state) {
    (void)state;
    rng r = {4};
    double worst_sum = 0, worst_chance = 1;
    for (size_t k = 0; k < HYI_COUNT(sheets); k++)
        for (size_t i = 0; i < HYI_COUNT(poses); i++) {
            check_density(&r, sheets[k], poses[i], &worst_sum, &worst_chance);
            check_density(&r, sheets[k], poses[i], &worst_sum, &worst_chance);
        }
    print_message("  rectangles, triangles, discs: %d poses, worst |integral - 1| %.5f, least chance %.4f\n",
                  (int)(2 * HYI_COUNT(sheets) * HYI_COUNT(poses)), fabs(worst_sum), worst_chance);
}

/* Sphere and sun: uniform in the cone that they subtend, computed here from cross products in double. */
static void check_cone(rng *r, hyk_light l, vec p, double half_angle, double tests) {
    enum { COUNT = 20000 };
    light_scene s;
    bool sun = l.kind == HYK_LIGHT_SUN;
    open_scene(&s, &l, sun ? 0 : 1, sun ? 1 : 0);
    vec axis = sun ? unit(from3(l.normal)) : unit(minus(from3(l.position), p));
    double cap = 2 * sin(0.5 * half_angle) * sin(0.5 * half_angle), observed[64], expected[64];
    hyk_frame f = hyk_make_frame(to3(axis));
    for (int i = 0; i < 64; i++) observed[i] = 0, expected[i] = COUNT / 64.0;
    for (int i = 0; i < COUNT; i++) {
        hyk_light_sample q = sample_scene(&s, to3(p), to3(axis), true, r);
        vec d = unit(from3(q.direction)), chord = minus(d, axis);
        double h = 0.5 * dot(chord, chord) / cap, phi = atan2(dot(d, from3(f.y)), dot(d, from3(f.x))) / (2 * PI) + 0.5;
        assert_true(q.flags & HYK_SAMPLE_VALID);
        assert_true(h < 1 + 1e-4 + 1e-6 / half_angle);
        assert_float_equal((double)q.pdf * 2 * PI * cap, 1, 2e-5);
        observed[(int)(fmin(h, 0.9999) * 8) * 8 + (int)(fmin(phi, 0.9999) * 8)]++;
    }
    double chance = chi_square_chance(observed, expected, 64);
    if (chance < sidak(tests)) fail_msg("kind %u, half angle %g: chance %g", l.kind, half_angle, chance);
    close_scene(&s);
}

static void test_cone_densities(void **state) {
    (void)state;
    rng r = {5};
    static const double distances[] = {1.0001, 1.1, 2, 10, 300, 3e4}, radii[] = {1e-4, 0.00465, 0.3, 1.5, 2.5};
    double tests = 2 * HYI_COUNT(distances) + HYI_COUNT(radii);
    for (size_t i = 0; i < HYI_COUNT(distances); i++)
        for (int big = 0; big < 2; big++) {
            double scale = big ? 1e6 : 1e-6;
            hyk_light l = sphere_light(times(random_unit(&r), scale), scale, 1);
            vec p = from3(to3(plus(from3(l.position), random_unit(&r), distances[i] * scale)));
            check_cone(&r, l, p, asin((double)l.radius / length(minus(p, from3(l.position)))), tests);
        }
    for (size_t i = 0; i < HYI_COUNT(radii); i++) check_cone(&r, sun_light(random_unit(&r), radii[i], 1), v3(1, 2, 3), (double)(float)radii[i], tests);
}

/* The point that a sample names is on the light, and a ray in its direction meets the light there; the density
   told for that ray is the sample's. */
static void test_density_of_hits(void **state) {
    (void)state;
    rng r = {6};
    double worst = 0, worst_place = 0;
    uint32_t hits = 0;
    for (int i = 0; i < 3000; i++) {
        pose at = poses[(size_t)i % HYI_COUNT(poses)];
        hyk_uint kind = i % 4 == 3 ? HYK_LIGHT_SPHERE : sheets[i % 4];
        hyk_light l = kind == HYK_LIGHT_SPHERE ? sphere_light(times(random_unit(&r), at.scale), at.scale, 1) : posed_light(&r, kind, at.scale);
        if (kind == HYK_LIGHT_SPHERE) l.normal = to3(random_unit(&r)), at.away += 1.01;
        hyk_vec3 p = to3(pose_point(&r, l, at)), n = to3(random_unit(&r));
        light_scene s;
        open_scene(&s, &l, 1, 0);
        for (int k = 0; k < 10; k++) {
            hyk_light_sample q = sample_scene(&s, p, n, true, &r);
            hyk_light rect = l;
            if (!(q.flags & HYK_SAMPLE_VALID)) continue;
            float t = kind == HYK_LIGHT_TRIANGLE ? q.distance : hyk_intersect_shape(rect, ray_of(p, q.direction));
            if (t < 0) continue; /* rounding at the edge */
            vec hit = plus(from3(p), from3(q.direction), (double)t);
            double cosine = fmax(fabs(dot(from3(q.normal), from3(q.direction))), 1e-4);
            if (kind == HYK_LIGHT_SPHERE) { /* its normal leads from the centre to the point */
                vec out = times(minus(from3(q.position), from3(l.position)), 1 / at.scale);
                assert_true(length(minus(out, from3(q.normal))) < 1e-5 * (1 + at.away));
            }
            worst_place = fmax(worst_place, length(minus(hit, from3(q.position))) / ((double)q.distance + at.scale) * cosine);
            double pdf = light_density(&s, 0, p, n, true, q.direction, (double)t, hyk_shape_normal(l, to3(hit)));
            if (kind == HYK_LIGHT_SPHERE && pdf == 0) continue; /* the rim's normal, seen from afar */
            worst = fmax(worst, fabs(pdf / (double)q.pdf - 1));
            hits++;
        }
        close_scene(&s);
    }
    print_message("  density of %u hits: worst relative difference %.2g; place of the hit within %.2g of the distance\n", hits, worst, worst_place);
    assert_true(hits > 28000);
    assert_true(worst < 1e-3);
    assert_true(worst_place < 1e-4);
}

/* ---------------------------------------------------------------- irradiance against formulas (TRUTH B) */

static mean irradiance(const light_scene *s, hyk_vec3 p, hyk_vec3 n, uint32_t count, rng *r) {
    mean m = {0, 0, 0};
    for (uint32_t i = 0; i < count; i++) {
        hyk_light_sample q = sample_scene(s, p, n, false, r);
        double value = q.flags & HYK_SAMPLE_VALID ? (double)q.radiance.x / (double)q.pdf * (double)hyk_dot(n, q.direction) : 0;
        gather(&m, value);
    }
    return m;
}
static void check_irradiance(const char *what, hyk_light l, vec p, vec n, double truth, double bound) {
    rng r = {7};
    light_scene s;
    open_scene(&s, &l, l.kind == HYK_LIGHT_SUN ? 0 : 1, l.kind == HYK_LIGHT_SUN ? 1 : 0);
    mean m = irradiance(&s, to3(p), to3(n), 40000, &r);
    assert_estimate(what, &m, truth, bound);
    close_scene(&s);
}

/* B.5 (Lambert 1760), after clipping to the horizon. */
static double polygon_irradiance(const vec *corners, int count, vec p, vec n) {
    vec kept[16];
    int m = 0;
    for (int i = 0; i < count; i++) {
        vec a = minus(corners[i], p), b = minus(corners[(i + 1) % count], p);
        double x = dot(a, n), y = dot(b, n);
        if (x > 0) kept[m++] = a;
        if ((x > 0) != (y > 0)) kept[m++] = plus(a, minus(b, a), x / (x - y));
    }
    double sum = 0;
    for (int i = 0; i < m; i++) {
        vec a = unit(kept[i]), b = unit(kept[(i + 1) % m]), g = cross(a, b);
        double sine = length(g);
        if (sine > 0) sum += atan2(sine, dot(a, b)) * dot(n, g) / sine;
    }
    return 0.5 * fabs(sum);
}

static void test_irradiance_formulas(void **state) {
    (void)state;
    double h = 2, d = 1.5, R = 0.8;
    vec o = v3(0, 0, 0), up = v3(0, 1, 0);
    check_irradiance("B.2 point", point_light(v3(d, h, 0), 5), o, up, 5 * h / pow(h * h + d * d, 1.5), 1e-6);
    check_irradiance("B.3 sphere above", sphere_light(v3(0, h, 0), R, 3), o, up, PI * 3 * R * R / (h * h), 1e-3);
    vec aslant = unit(v3(1, 2, 0));
    check_irradiance("B.3 sphere aslant", sphere_light(times(aslant, 4), R, 3), o, up, PI * 3 * R * R / 16 * aslant.y, 1e-3);
    check_irradiance("B.4 disc", disc_light(v3(0, h, 0), v3(0, -1, 0), R, 3), o, up, PI * 3 * R * R / (R * R + h * h), 2e-3);
    check_irradiance("B.4 disc, near", disc_light(v3(0, 0.01, 0), v3(0, -1, 0), R, 3), o, up, PI * 3 * R * R / (R * R + 1e-4), 5e-3);
    check_irradiance("B.7 sun", sun_light(aslant, 0.2, 3), o, up, PI * 3 * sin(0.2) * sin(0.2) * aslant.y, 1e-3);
    check_irradiance("B.7 small sun", sun_light(aslant, 1e-5, 3e10), o, up, PI * 3e10 * 1e-10 * aslant.y, 1e-3);
    check_irradiance("parallel sun", sun_light(aslant, 0, 3), o, up, 3 * aslant.y, 1e-6);
    double a = 1.3, b = 0.9, X = a / h, Y = b / h;
    double F = (X / sqrt(1 + X * X) * atan(Y / sqrt(1 + X * X)) + Y / sqrt(1 + Y * Y) * atan(X / sqrt(1 + Y * Y))) / (2 * PI);
    check_irradiance("B.6 rectangle", rect_light(v3(a / 2, h, b / 2), v3(a / 2, 0, 0), v3(0, 0, b / 2), 3), o, up, PI * 3 * F, 1e-3);
    vec axis = unit(v3(-1, -1, 0)); /* spot, on the axis and between the cones */
    check_irradiance("spot axis", spot_light(v3(1, 1, 0), axis, 0.3, 0.6, 4), o, up, 4 / 2.0 * sqrt(0.5), 1e-6);
    double c = cos(0.45), x = (c - cos(0.6)) / (cos(0.3) - cos(0.6));
    check_irradiance("spot falloff", spot_light(v3(0, 1, 0), v3(sin(0.45), -c, 0), 0.3, 0.6, 4), o, up, 4 * x * x * (3 - 2 * x), 1e-5);
}

/* Random polygons at any pose, some cut by the horizon, near and far, at three scales and three radiances. */
static void test_polygon_irradiance(void **state) {
    (void)state;
    rng r = {8};
    static const double scales[] = {1, 1e-6, 1e6}, radiances[] = {1, 1e-12, 1e12};
    for (int i = 0; i < 90; i++) {
        double scale = scales[i % 3], radiance = radiances[i / 3 % 3];
        bool rect = i % 2 == 0;
        vec p = times(random_unit(&r), scale), c = plus(p, random_unit(&r), scale * pow(10, between(&r, -0.5, 1.5)));
        vec u = times(random_unit(&r), scale), v = times(random_unit(&r), scale);
        if (dot(cross(u, v), minus(p, c)) < 0) v = times(v, -1);
        if (rect && i % 4 == 0) v = cross(unit(cross(u, v)), u); /* right angles */
        hyk_light l = rect ? rect_light(c, u, v, radiance) : triangle_light(c, u, v, radiance);
        vec n = unit(plus(unit(minus(c, p)), random_unit(&r), 0.7)), corners[4];
        c = from3(l.position), u = from3(l.axis_u), v = from3(l.axis_v), p = from3(to3(p));
        corners[0] = rect ? plus(plus(c, u, -1), v, -1) : c;
        corners[1] = rect ? plus(plus(c, u, 1), v, -1) : plus(c, u, 1);
        corners[2] = rect ? plus(plus(c, u, 1), v, 1) : plus(c, v, 1);
        corners[3] = plus(plus(c, u, -1), v, 1);
        double truth = (double)l.radiance.x * polygon_irradiance(corners, rect ? 4 : 3, p, n);
        if (truth < 1e-5 * radiance) continue; /* hardly above the horizon */
        char what[64];
        snprintf(what, sizeof what, "polygon %d (scale %g, radiance %g)", i, scale, radiance);
        check_irradiance(what, l, p, n, truth, 0.03);
    }
}

/* ---------------------------------------------------------------- the light tree */

static hyk_light mixed_light(rng *r, double scale) {
    vec c = times(v3(between(r, -10, 10), between(r, -1, 1), between(r, -10, 10)), scale);
    double size = scale * pow(10, between(r, -2, -0.7)), power = pow(10, between(r, -2, 2));
    double pick = next(r) * 6;
    vec a = random_unit(r), b = unit(cross(a, random_unit(r)));
    hyk_light l = rect_light(c, times(a, size), times(b, size), power / (size * size));
    if (pick < 1) l = disc_light(c, a, size, power / (size * size));
    else if (pick < 2) l = sphere_light(c, size, power / (size * size));
    else if (pick < 3) l = point_light(c, power);
    else if (pick < 4) l = spot_light(c, a, 0.5, between(r, 0.5, 3), power);
    else if (pick < 5) l = triangle_light(c, times(a, size), times(plus(b, a, 0.3), size), power / (size * size));
    if (next(r) < 0.2 && (l.kind == HYK_LIGHT_RECT || l.kind == HYK_LIGHT_DISC)) l.flags = HYK_LIGHT_BOTH_SIDES;
    return l;
}

/* Probability that the walk ends where neither child can contribute. */
static double lost_probability(const light_scene *s, uint32_t at, double probability, hyk_vec3 p, hyk_vec3 n) {
    hyk_light_node node = s->nodes[at];
    if (node.is_leaf) return 0;
    hyk_vec2 share = hyk_light_child_shares(&s->view, at + 1, node.child, p, n, false);
    double lost = 0;
    if (!(share.x + share.y > 0)) return probability;
    if (share.x > 0) lost += lost_probability(s, at + 1, probability * (double)share.x, p, n);
    if (share.y > 0) lost += lost_probability(s, node.child, probability * (double)share.y, p, n);
    return lost;
}

static uint32_t tree_depth(const light_scene *s, uint32_t at) {
    if (s->nodes[at].is_leaf) return 0;
    uint32_t a = tree_depth(s, at + 1), b = tree_depth(s, s->nodes[at].child);
    return 1 + (a > b ? a : b);
}

enum { MANY = 10000 };

static void test_tree_probabilities(void **state) {
    (void)state;
    rng r = {9};
    static hyk_light lights[MANY];
    light_scene s;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    assert_int_equal(s.node_count, 2 * MANY - 1);
    for (int k = 0; k < 20; k++) {
        hyk_vec3 p = to3(v3(between(&r, -11, 11), between(&r, -2, 2), between(&r, -11, 11))), n = to3(random_unit(&r));
        double sum = 0;
        for (uint32_t i = 0; i < MANY; i++) {
            double probability = pick_probability(&s, i, p, n);
            sum += probability;
            if (probability > 0) continue;
            for (int tries = 0; tries < 8; tries++) { /* a light that can contribute has a probability */
                hyk_light_sample q = sample_light(&s, i, p, &r);
                assert_false((q.flags & HYK_SAMPLE_VALID) && hyk_dot(q.direction, n) > 1e-5f);
            }
        }
        assert_float_equal(sum + lost_probability(&s, 0, 1, p, n), 1, 1e-5);
        for (int tries = 0; tries < 1000; tries++) {
            hyk_light_pick pick = pick_light(&s, p, n, &r);
            if (pick.light == HYK_NONE) continue;
            double told = pick_probability(&s, pick.light, p, n);
            assert_float_equal((double)pick.probability / told, 1, 1e-5);
        }
    }
    close_scene(&s);
}

/* How often each light is taken, against the probability told. */
static void test_tree_frequencies(void **state) {
    (void)state;
    rng r = {10};
    enum { COUNT = 400000 };
    static hyk_light lights[MANY];
    static double observed[MANY + 1], expected[MANY + 1];
    light_scene s;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    hyk_vec3 p = hyk_make3(0.3f, 0.2f, -1), n = to3(unit(v3(1, 2, 0.5)));
    memset(observed, 0, sizeof observed);
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_light_pick pick = pick_light(&s, p, n, &r);
        observed[pick.light == HYK_NONE ? MANY : pick.light]++;
    }
    for (uint32_t i = 0; i < MANY; i++) expected[i] = COUNT * pick_probability(&s, i, p, n);
    expected[MANY] = COUNT * lost_probability(&s, 0, 1, p, n);
    double chance = chi_square_chance(observed, expected, MANY + 1);
    if (chance < 0.01) fail_msg("chance %g", chance);
    close_scene(&s);
}

/* Against choosing lights evenly: same estimate, far less variance. */
static void test_tree_variance(void **state) {
    (void)state;
    rng r = {11};
    static hyk_light lights[MANY];
    light_scene s;
    double logarithms = 0;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    for (int k = 0; k < 10; k++) {
        hyk_vec3 p = to3(v3(between(&r, -8, 8), -1.5, between(&r, -8, 8))), n = hyk_make3(0, 1, 0);
        mean tree = irradiance(&s, p, n, 20000, &r), even = {0, 0, 0};
        for (uint32_t i = 0; i < 200000; i++) {
            hyk_light_sample q = sample_light(&s, (uint32_t)(next(&r) * MANY), p, &r);
            bool counts = (q.flags & HYK_SAMPLE_VALID) && q.direction.y > 0;
            gather(&even, counts ? MANY * (double)q.radiance.x / (double)q.pdf * (double)q.direction.y : 0);
        }
        double apart = fabs(average(&tree) - average(&even)) / sqrt(variance(&tree) + variance(&even));
        assert_true(apart < 4.5);
        assert_true(sqrt(variance(&tree)) < 0.05 * average(&tree));
        logarithms += log(variance(&even) * 10 / variance(&tree)) / 10;
    }
    print_message("  light tree, %d lights: variance %.0f times below even choice\n", MANY, exp(logarithms));
    assert_true(exp(logarithms) > 10);
    close_scene(&s);
}

static void check_tree_shape(hyk_light *lights, uint32_t count) {
    light_scene s;
    open_scene(&s, lights, count, 0);
    assert_int_equal(s.node_count, count ? 2 * count - 1 : 0);
    if (count) assert_true(tree_depth(&s, 0) <= HYK_LIGHT_TREE_DEPTH);
    for (uint32_t i = 0; i < count; i++) { /* the path leads to the light */
        uint32_t at = 0, depth = 0;
        for (; !s.nodes[at].is_leaf; depth++) at = lights[i].tree_path >> depth & 1u ? s.nodes[at].child : at + 1;
        assert_int_equal(s.nodes[at].child, i);
    }
    close_scene(&s);
}

static void test_tree_shapes(void **state) {
    (void)state;
    rng r = {12};
    static hyk_light lights[4096];
    check_tree_shape(lights, 0);
    for (int i = 0; i < 4096; i++) lights[i] = point_light(v3(1, 2, 3), 1);
    check_tree_shape(lights, 1);
    check_tree_shape(lights, 2);
    check_tree_shape(lights, 4096); /* all in one place */
    for (int i = 0; i < 4096; i++) lights[i] = point_light(v3(pow(2, -(i % 120)) * (1 + i / 120), 0, 0), pow(10, i % 25 - 12));
    check_tree_shape(lights, 4096); /* a chain that a greedy split makes far deeper than 32 */
    for (int i = 0; i < 4096; i++) lights[i] = mixed_light(&r, i % 2 ? 1e-6 : 1e6);
    check_tree_shape(lights, 4096);
    for (int i = 0; i < 4096; i++) lights[i] = point_light(v3(0, i, 0), 0);
    check_tree_shape(lights, 4096);
    light_scene s; /* lights that are all off are never taken */
    open_scene(&s, lights, 4096, 0);
    assert_int_equal(sample_scene(&s, hyk_zero3(), hyk_make3(0, 1, 0), false, &r).flags, 0);
    close_scene(&s);
}

/* Powers from 1e-12 to 1e12 in one tree, at three scales and far away: the weak light beside the point is found,
   and everything is finite. */
static void test_tree_extremes(void **state) {
    (void)state;
    static const double scales[] = {1e-6, 1, 1e6, 1e14};
    rng r = {13};
    for (size_t k = 0; k < HYI_COUNT(scales); k++) {
        double scale = scales[k];
        hyk_light lights[3];
        light_scene s;
        lights[0] = point_light(v3(0, scale, 0), 1e-12);
        lights[1] = sphere_light(v3(10 * scale, 3 * scale, 0), scale, 1e12 / (PI * scale * scale));
        lights[2] = disc_light(v3(0, -scale, 0), v3(0, 1, 0), scale, 1); /* below the horizon */
        open_scene(&s, lights, 3, 0);
        hyk_vec3 p = hyk_zero3(), n = hyk_make3(0, 1, 0);
        assert_true(pick_probability(&s, 0, p, n) > 0);
        assert_true(pick_probability(&s, 1, p, n) > 0.9);
        assert_true(pick_probability(&s, 2, p, n) == 0);
        mean m = irradiance(&s, p, n, 20000, &r);
        double truth = PI * (double)lights[1].radiance.x * scale * scale / (109 * scale * scale) * 3 / sqrt(109);
        assert_estimate("sphere among extremes", &m, truth, 1e-2);
        close_scene(&s);
    }
}

static void test_tree_million(void **state) {
    (void)state;
    rng r = {14};
    uint32_t count = 1000000;
    hyk_light *lights = (hyk_light *)malloc(count * sizeof *lights);
    light_scene s;
    assert_non_null(lights);
    for (uint32_t i = 0; i < count; i++) {
        vec c = v3(between(&r, -1e3, 1e3), between(&r, -10, 10), between(&r, -1e3, 1e3)), a = random_unit(&r);
        lights[i] = triangle_light(c, times(a, 0.01), times(unit(cross(a, v3(0, 1, 0))), 0.01), 100);
    }
    double start = hyi_seconds();
    open_scene(&s, lights, count, 0);
    double built = hyi_seconds() - start;
    start = hyi_seconds();
    mean m = irradiance(&s, hyk_make3(0, -20, 0), hyk_make3(0, 1, 0), 20000, &r);
    print_message("  a million lights: built in %.2f s, depth %u, %.2f us a sample\n", built, tree_depth(&s, 0), (hyi_seconds() - start) / 20000 * 1e6);
    assert_true(average(&m) > 0 && built < 60);
    close_scene(&s);
    free(lights);
}

/* ---------------------------------------------------------------- environment */

static void fill_map(float *texels, uint32_t count, rng *r, double low) {
    for (uint32_t i = 0; i < 3 * count; i++) texels[i] = (float)pow(10, between(r, low, 0));
}

/* Integral over the sphere, or over the cosine about n, of the kernel's radiance (density: false) or density,
   midpoint rule in double, per cell of a sphere grid when cells is given. */
enum { RINGS = 16, SECTORS = 32 };
static double integrate_sphere(const light_scene *s, bool density, const vec *n, uint32_t fine, double *cells) {
    double sum = 0;
    uint32_t rings = RINGS * fine, sectors = SECTORS * fine;
    for (uint32_t i = 0; cells && i < RINGS * SECTORS; i++) cells[i] = 0;
    for (uint32_t i = 0; i < rings; i++) {
        double z = 1 - 2 * (i + 0.5) / rings, side = sqrt(1 - z * z);
        for (uint32_t j = 0; j < sectors; j++) {
            double phi = 2 * PI * (j + 0.5) / sectors, weight = 4 * PI / rings / sectors;
            vec d = v3(side * cos(phi), z, side * sin(phi));
            if (n) weight *= fmax(dot(d, *n), 0);
            double f = density ? sky_density(s, HYK_NONE, hyk_zero3(), hyk_make3(0, 1, 0), true, to3(d))
                               : (double)sky(s, to3(d)).x;
            sum += f * weight;
            if (cells) cells[i / fine * SECTORS + j / fine] += f * weight;
        }
    }
    return sum;
}

static double check_map(light_scene *s, rng *r, double tests) {
    enum { COUNT = 100000 };
    static double observed[RINGS * SECTORS], expected[RINGS * SECTORS];
    double sum = integrate_sphere(s, true, NULL, 32, expected);
    if (fabs(sum - 1) > 2e-3) fail_msg("density integrates to %.6f", sum);
    for (uint32_t i = 0; i < RINGS * SECTORS; i++) expected[i] *= COUNT / sum, observed[i] = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_light_sample q = sample_scene(s, hyk_zero3(), hyk_make3(0, 1, 0), true, r);
        double ring = (1 - (double)q.direction.y) / 2, sector = atan2((double)q.direction.z, (double)q.direction.x) / (2 * PI);
        assert_true((q.flags & HYK_SAMPLE_VALID) && q.light == HYK_NONE);
        if (sector < 0) sector += 1;
        observed[(int)(fmin(ring, 0.99999) * RINGS) * SECTORS + (int)(fmin(sector, 0.999999) * SECTORS)]++;
    }
    double chance = chi_square_chance(observed, expected, RINGS * SECTORS);
    if (chance < sidak(tests)) fail_msg("map %u x %u: chance %g", s->view.constants.environment_width, s->view.constants.environment_height, chance);
    return chance;
}

static void test_map_density(void **state) {
    (void)state;
    rng r = {15};
    static const uint32_t sizes[][2] = {{1, 1}, {2, 1}, {1, 3}, {7, 5}, {16, 8}, {64, 33}};
    static float texels[3 * 64 * 33];
    for (size_t i = 0; i < HYI_COUNT(sizes); i++) {
        light_scene s;
        open_scene(&s, NULL, 0, 0);
        fill_map(texels, sizes[i][0] * sizes[i][1], &r, -2);
        set_map(&s, texels, sizes[i][0], sizes[i][1], 1, between(&r, -4, 4));
        check_map(&s, &r, HYI_COUNT(sizes));
        close_scene(&s);
    }
}

/* One bright texel on black: every direction that sees it, up to the dark neighbours' middles, can be sampled. */
static void test_map_bright_texel(void **state) {
    (void)state;
    rng r = {16};
    enum { W = 32, H = 16 };
    static float texels[3 * W * H];
    static const uint32_t places[][2] = {{5, 7}, {0, 0}, {31, 15}, {16, 15}};
    for (size_t k = 0; k < HYI_COUNT(places); k++) {
        light_scene s;
        memset(texels, 0, sizeof texels);
        for (int c = 0; c < 3; c++) texels[3 * (places[k][1] * W + places[k][0]) + (uint32_t)c] = 1e6f;
        open_scene(&s, NULL, 0, 0);
        set_map(&s, texels, W, H, 1e-3, 0.4);
        for (int i = 0; i < 100000; i++) {
            hyk_vec3 d = to3(random_unit(&r));
            bool bright = sky(&s, d).x > 0;
            bool found = sky_density(&s, HYK_NONE, hyk_zero3(), d, false, d) > 0;
            assert_true(bright == found);
        }
        vec n = unit(plus(from3(hyk_map_direction(&s.view, places[k][0], places[k][1], 0, 0.5f)), random_unit(&r), 0.5));
        double truth = integrate_sphere(&s, false, &n, 64, NULL);
        mean m = irradiance(&s, hyk_zero3(), to3(n), 40000, &r);
        double error = sqrt(variance(&m));
        assert_true(fabs(average(&m) - truth) < 4 * error + 3e-3 * truth); /* the quadrature has 25 points across the texel */
        assert_true(error < 5e-3 * truth);
        close_scene(&s);
    }
}

/* The probability that bisection by the stored shares gives the range's member. */
static double bisected(const float *shares, uint32_t count, uint32_t member) {
    double probability = 1;
    for (uint32_t first = 0, last = count; last - first > 1;) {
        uint32_t middle = first + (last - first) / 2;
        double x = (double)shares[middle], below = x >= 0 ? x : 1 + x, above = x < 0 ? -x : 1 - x;
        probability *= member < middle ? below : above;
        if (member < middle) last = middle;
        else first = middle;
    }
    return probability;
}

/* A texel of 1e12 among those of 1: the cells' probabilities, down to 1e-17, are their shares of the integral. */
static void test_map_shares(void **state) {
    (void)state;
    enum { W = 64, H = 33 };
    static float texels[3 * W * H];
    light_scene s;
    for (int i = 0; i < 3 * W * H; i++) texels[i] = 1;
    for (int c = 0; c < 3; c++) texels[3 * (10 * W + 20) + c] = 1e12f;
    open_scene(&s, NULL, 0, 0);
    set_map(&s, texels, W, H, 1, 0);
    for (uint32_t row = 0; row <= H; row++)
        for (uint32_t x = 0; x < W; x++) {
            double from = row == 0 ? 0 : PI * (row - 0.5) / H, to = row == H ? PI : PI * (row + 0.5) / H;
            double mean_corner = (row == 10 || row == 11) && (x == 19 || x == 20) ? 0.25e12 + 0.75 : 1;
            double truth = (cos(from) - cos(to)) * 2 * PI / W * mean_corner / (double)s.view.constants.environment_integral;
            double told = bisected(s.cdf, H + 1, row) * bisected(s.cdf + (H + 1) + W * row, W, x);
            assert_float_equal(told / truth, 1, 1e-5);
        }
    close_scene(&s);
}

/* A sun of 1e9 in a map of 1: dim places keep their probability, which a table of sums in float would lose. */
static void test_map_contrast(void **state) {
    (void)state;
    rng r = {17};
    enum { W = 512, H = 256 };
    float *texels = (float *)malloc(3 * W * H * sizeof *texels);
    light_scene s;
    assert_non_null(texels);
    for (int i = 0; i < 3 * W * H; i++) texels[i] = 1;
    for (int c = 0; c < 3; c++) texels[3 * (100 * W + 200) + c] = 1e9f;
    open_scene(&s, NULL, 0, 0);
    set_map(&s, texels, W, H, 1, 0);
    uint32_t dim = 0, count = 4000000;
    for (uint32_t i = 0; i < count; i++) {
        hyk_vec3 d = hyk_sample_map(&s.view, next2(&r));
        if (sky(&s, d).x < 2) dim++;
    }
    double truth = count * 4 * PI / (double)s.view.constants.environment_integral;
    assert_true(truth > 100);
    if (fabs(dim - truth) > 4 * sqrt(truth) + 0.01 * truth) fail_msg("%u dim samples, truth %g", dim, truth);
    close_scene(&s);
    free(texels);
}

/* Poles, seam, orientation: u = 1/2 + atan2(x, -z) / 2 pi; row 0 at +Y; the rotation turns what is at -Z to -X. */
static void test_map_orientation(void **state) {
    (void)state;
    float texels[3 * 4 * 2];
    light_scene s;
    for (int i = 0; i < 24; i++) texels[i] = (float)(i / 3 + 1);
    open_scene(&s, NULL, 0, 0);
    set_map(&s, texels, 4, 2, 1, 0);
    double high = sin(PI / 4), low = cos(PI / 4);
    /* middle of the upper row's third texel: u = 5/8, that is atan2(x, -z) = pi / 4 */
    vec third = v3(low * sin(PI / 4), high, -low * cos(PI / 4));
    assert_float_equal(sky(&s, to3(third)).x, 3, 1e-5);
    assert_float_equal(sky(&s, hyk_make3(0, 1, 0)).x, 2.5, 1.6);
    assert_float_equal(sky(&s, to3(v3(0, high, low))).x, 2.5, 1e-5); /* seam: between 4 and 1 */
    s.view.constants.environment_rotation = (float)(PI / 2);
    vec turned = v3(third.z, third.y, -third.x); /* right-handed quarter turn about +Y */
    assert_float_equal(sky(&s, to3(turned)).x, 3, 1e-5);
    close_scene(&s);
}

static void test_constant_environment(void **state) {
    (void)state;
    rng r = {18};
    light_scene s;
    open_scene(&s, NULL, 0, 0);
    s.view.constants.environment = hyk_splat(2);
    mean m = irradiance(&s, hyk_zero3(), to3(unit(v3(1, -2, 3))), 10000, &r), both = {0, 0, 0};
    assert_estimate("B.1", &m, 2 * PI, 1e-5);
    hyk_vec3 n = to3(random_unit(&r));
    for (int i = 0; i < 10000; i++) {
        hyk_light_sample q = sample_scene(&s, hyk_zero3(), n, true, &r);
        gather(&both, (double)q.radiance.x / (double)q.pdf * fabs((double)hyk_dot(n, q.direction)));
    }
    assert_estimate("both sides", &both, 4 * PI, 1e-5);
    s.view.constants.environment = hyk_zero3();
    assert_int_equal(sample_scene(&s, hyk_zero3(), n, true, &r).flags, 0);
    close_scene(&s);
}

/* ---------------------------------------------------------------- all together */

/* A rectangle, three suns and a map: irradiance is the sum of what each gives, and the densities told for rays
   that hit them are those of the samples. */
static void test_groups(void **state) {
    (void)state;
    rng r = {19};
    static float texels[3 * 16 * 8];
    hyk_light lights[4];
    light_scene s, alone;
    vec n = unit(v3(0.2, 1, -0.1));
    hyk_vec3 p = hyk_zero3(), normal = to3(n);
    lights[0] = rect_light(v3(0, 2, 0), v3(0, 0, 0.5), v3(-0.5, 0, 0), 5);
    if (lights[0].normal.y > 0) lights[0] = rect_light(v3(0, 2, 0), v3(-0.5, 0, 0), v3(0, 0, 0.5), 5);
    lights[1] = sun_light(v3(1, 1, 0), 0.1, 20);
    lights[2] = sun_light(v3(0, 1, 1), 0, 1);
    lights[3] = sun_light(v3(0, -0.05, 1), 0.3, 3); /* half set */
    fill_map(texels, 16 * 8, &r, -1);
    double truth = 0;
    for (uint32_t i = 0; i < 4; i++) {
        open_scene(&alone, &lights[i], i ? 0 : 1, i ? 1 : 0);
        mean m = irradiance(&alone, p, normal, 100000, &r);
        truth += average(&m);
        close_scene(&alone);
    }
    open_scene(&s, lights, 1, 3);
    set_map(&s, texels, 16, 8, 0.5, 1);
    truth += integrate_sphere(&s, false, &n, 32, NULL);
    mean m = irradiance(&s, p, normal, 200000, &r);
    double error = sqrt(variance(&m));
    assert_true(fabs(average(&m) - truth) < 4 * error + 2e-3 * truth && error < 5e-3 * truth);
    uint32_t seen[5] = {0, 0, 0, 0, 0};
    double worst = 0;
    for (int i = 0; i < 20000; i++) {
        hyk_light_sample q = sample_scene(&s, p, normal, i % 2 == 0, &r);
        if (!(q.flags & HYK_SAMPLE_VALID)) continue;
        seen[q.light == HYK_NONE ? 4 : q.light]++;
        if (q.flags & HYK_SAMPLE_DELTA) continue;
        bool rim = q.light != 0 && q.light != HYK_NONE && hyk_is_black(hyk_sun_radiance(lights[q.light], q.direction));
        if (rim) continue; /* rounding put it just beside the disc */
        double told = q.light == 0 ? light_density(&s, 0, p, normal, i % 2 == 0, q.direction, (double)q.distance, q.normal)
                                   : sky_density(&s, q.light, p, normal, i % 2 == 0, q.direction);
        worst = fmax(worst, fabs(told / (double)q.pdf - 1));
    }
    for (int i = 0; i < 5; i++) assert_true(seen[i] > 50);
    assert_true(worst < 1e-5);
    close_scene(&s);
}

/* A triangle whose emission is a texture: red = u, so the radiance at a point is linear in its place. */
static void test_textured_triangle(void **state) {
    (void)state;
    rng r = {20};
    enum { W = 256 };
    static uint32_t words[4 * W * 2];
    light_scene s;
    hyk_light l = triangle_light(v3(0, 2, 0), v3(0, 0, -1), v3(1, 0, 0), 1);
    if (l.normal.y > 0) l = triangle_light(v3(0, 2, 0), v3(1, 0, 0), v3(0, 0, -1), 1);
    hyk_texture texture;
    hyk_material materials[2];
    hyk_mesh mesh;
    hyk_instance instance;
    static const float uvs[] = {0.1f, 0.5f, 0.9f, 0.5f, 0.4f, 0.5f};
    static const uint32_t indices[] = {0, 1, 2};
    const uint32_t *texels[1];
    hyk_mesh_arrays arrays;
    memset(&texture, 0, sizeof texture), memset(materials, 0, sizeof materials), memset(&mesh, 0, sizeof mesh);
    memset(&instance, 0, sizeof instance), memset(&arrays, 0, sizeof arrays);
    for (uint32_t i = 0; i < 2 * W; i++) {
        float value = ((float)(i % W) + 0.5f) / W;
        memcpy(&words[4 * i], &value, 4);
    }
    texels[0] = words;
    texture.width = W, texture.height = 2, texture.levels = 1, texture.format = HYK_TEXEL_RGBA32F;
    texture.wrap_u = texture.wrap_v = HYK_WRAP_CLAMP;
    materials[1].emission = hyk_splat(6);
    materials[1].emission_texture = 0;
    mesh.flags = HYK_MESH_HAS_UVS, mesh.material = 1;
    instance.material = HYK_NONE;
    arrays.uvs = uvs, arrays.indices = indices;
    l.flags = HYK_LIGHT_TEXTURED;
    l.instance = l.primitive = 0;
    open_scene(&s, &l, 1, 0);
    s.view.materials = materials, s.view.textures = &texture, s.view.texels = texels;
    s.view.meshes = &mesh, s.view.mesh_arrays = &arrays, s.view.instances = &instance;
    for (int i = 0; i < 2000; i++) {
        hyk_light_sample q = sample_scene(&s, hyk_zero3(), hyk_make3(0, 1, 0), false, &r);
        vec w = minus(from3(q.position), from3(l.position));
        double u = 0.1 + 0.8 * dot(w, from3(l.axis_u)) + 0.3 * dot(w, from3(l.axis_v));
        assert_true(q.flags & HYK_SAMPLE_VALID);
        assert_float_equal(q.radiance.x, 6 * u, 1e-4);
    }
    instance.material = 0; /* the instance's own material wins, and is black */
    materials[0].emission_texture = HYK_NONE;
    assert_int_equal(sample_scene(&s, hyk_zero3(), hyk_make3(0, 1, 0), false, &r).flags, 0);
    close_scene(&s);
}

/* Points in a light's plane, behind it, on its centre, inside a sphere, at a point light: no sample, nothing that
   is not finite. */
static void test_degenerate_points(void **state) {
    (void)state;
    rng r = {21};
    hyk_light lights[6];
    lights[0] = rect_light(v3(0, 0, 0), v3(1, 0, 0), v3(0, 1, 0), 1);
    lights[1] = disc_light(v3(0, 0, 0), v3(0, 0, 1), 1, 1);
    lights[2] = triangle_light(v3(0, 0, 0), v3(1, 0, 0), v3(0, 1, 0), 1);
    lights[3] = sphere_light(v3(0, 0, 0), 1, 1);
    lights[4] = point_light(v3(0, 0, 0), 1);
    lights[5] = lights[1];
    lights[5].flags = HYK_LIGHT_BOTH_SIDES;
    static const float points[][3] = {{0, 0, 0}, {1, 0, 0}, {0.5f, 0.5f, 0}, {3, 0, 0}, {0, 0, -1e-20f}, {1, 1, 1e-30f}, {0, 0, 1e-38f}, {0, 0, 1e15f}, {1e15f, 0, 1}};
    for (size_t i = 0; i < HYI_COUNT(points); i++)
        for (int k = 0; k < 6; k++) {
            light_scene s;
            hyk_light l = lights[k];
            open_scene(&s, &l, 1, 0);
            for (int j = 0; j < 50; j++) {
                hyk_vec3 p = hyk_make3(points[i][0], points[i][1], points[i][2]);
                hyk_light_sample q = sample_scene(&s, p, hyk_make3(0, 0, -1), true, &r);
                assert_true(hyk_is_finite(q.pdf) && hyk_is_finite(q.radiance.x) && hyk_is_finite(q.distance));
                if (q.flags & HYK_SAMPLE_VALID) assert_float_equal(length(from3(q.direction)), 1, 1e-5);
            }
            close_scene(&s);
        }
}

int hydra_test_lights(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shapes_against_long_double), cmocka_unit_test(test_shape_edge_cases), cmocka_unit_test(test_warps),
        cmocka_unit_test(test_power_heuristic), cmocka_unit_test(test_chooser), cmocka_unit_test(test_sheet_densities),
        cmocka_unit_test(test_cone_densities), cmocka_unit_test(test_density_of_hits), cmocka_unit_test(test_irradiance_formulas),
        cmocka_unit_test(test_polygon_irradiance), cmocka_unit_test(test_tree_probabilities), cmocka_unit_test(test_tree_frequencies),
        cmocka_unit_test(test_tree_variance), cmocka_unit_test(test_tree_shapes), cmocka_unit_test(test_tree_extremes),
        cmocka_unit_test(test_tree_million), cmocka_unit_test(test_map_density), cmocka_unit_test(test_map_bright_texel),
        cmocka_unit_test(test_map_shares), cmocka_unit_test(test_map_contrast), cmocka_unit_test(test_map_orientation), cmocka_unit_test(test_constant_environment),
        cmocka_unit_test(test_groups), cmocka_unit_test(test_textured_triangle), cmocka_unit_test(test_degenerate_points)
    };
    return cmocka_run_group_tests_name("lights", tests, NULL, NULL);
}
