/* Lights one at a time: shapes and rays, warps, densities, and irradiance against formulas. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "light_helpers.h"

int hydra_test_lights(void);

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

static hyk_ray ray_of(hyk_vec3 origin, hyk_vec3 direction) {
    hyk_ray r;
    r.origin = origin;
    r.direction = direction;
    r.t_min = 0.0f;
    r.t_max = HYK_REAL_MAX;
    return r;
}

static hyk_light random_shape(ht_rng *r, double size) {
    truth_v3 c = truth_mul(truth_rng_direction(r), size * between(r, 0, 3));
    double pick = truth_rng_unit(r);
    if (pick < 0.34) return sphere_light(c, size * between(r, 0.2, 1), 1);
    if (pick < 0.67) return disc_light(c, truth_rng_direction(r), size * between(r, 0.2, 1), 1);
    truth_v3 u = truth_rng_direction(r), v = truth_rng_direction(r); /* a parallelogram as often as not */
    if (truth_rng_unit(r) < 0.5) v = truth_unit(truth_cross(u, v));
    return rect_light(c, truth_mul(u, size * between(r, 0.2, 1)), truth_mul(v, size * between(r, 0.2, 1)), 1);
}

/* Rays from near (1e-3 sizes) to far (1e4 sizes) at three scales. Error of t in units of the rounding of the
   distances involved; the answer hit or miss may differ only as near to the edge as rounding reaches. */
static void test_shapes_against_long_double(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(1);
    double worst = 0;
    uint32_t hits = 0;
    for (uint32_t i = 0; i < 60000; i++) {
        double size = i % 3 == 0 ? 1 : i % 3 == 1 ? 1e-6 : 1e6, away = pow(10, between(&r, -3, 4)), wide_of;
        hyk_light l = random_shape(&r, size);
        truth_v3 target = plus(from3(l.position), truth_rng_direction(&r), size * between(&r, 0, 1.1));
        truth_v3 origin = plus(target, truth_rng_direction(&r), size * away);
        hyk_ray ray = ray_of(to3(origin), to3(truth_mul(truth_sub(target, origin), pow(10, between(&r, -3, 3)) / size)));
        wide margin = 0, truth = true_hit(l, ray, &margin);
        float t = hyk_intersect_shape(l, ray);
        double slope = l.kind == HYK_LIGHT_SPHERE ? 1 : fabs(truth_dot(from3(l.normal), truth_unit(from3(ray.direction))));
        wide_of = (truth_length(truth_sub(from3(ray.origin), from3(l.position))) + 2 * size) * FLT_EPSILON / size; /* in sizes */
        double reach = 40 * wide_of / fmax(slope, 1e-3);
        if ((double)margin < reach) continue;
        if ((t >= 0) != (truth >= 0)) fail_msg("kind %u: t %g, truth %Lg, margin %Lg", l.kind, (double)t, truth, margin);
        if (truth < 0) continue;
        hits++;
        double step = truth_length(from3(ray.direction)) / size, steep = l.kind == HYK_LIGHT_SPHERE ? sqrt((double)margin) : slope;
        worst = fmax(worst, fabs((double)((wide)t - truth)) * step / (wide_of / fmax(steep, 1e-6)));
    }
    print_message("  intersection: %u hits, worst error %.2f ulp of the distances / cosine\n", hits, worst);
    assert_true(hits > 10000);
    assert_true(worst < 8);
}

static void test_shape_edge_cases(void **state) {
    (void)state;
    hyk_light s = sphere_light(truth_v(0, 0, 0), 1, 3);
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
    hyk_light d = disc_light(truth_v(0, 0, 1), truth_v(0, 0, -1), 1, 3);
    r = ray_of(hyk_zero3(), hyk_make3(1, 0, 0)); /* in parallel */
    assert_true(hyk_intersect_shape(d, r) == -1.0f);
    r = ray_of(hyk_make3(0, 0, 1), hyk_make3(1, 0, 0)); /* within the sheet */
    assert_true(hyk_intersect_shape(d, r) == -1.0f);
    assert_float_equal(hyk_intersect_shape(d, ray_of(hyk_make3(0, 0, 3), hyk_make3(0, 0, -1))), 2, 1e-6); /* from behind */
    assert_true(hyk_is_black(hyk_shape_radiance(d, d.normal, hyk_make3(0, 0, -1))));
    d.flags = HYK_LIGHT_BOTH_SIDES;
    assert_float_equal(hyk_shape_radiance(d, d.normal, hyk_make3(0, 0, -1)).x, 3, 0);
    assert_true(hyk_intersect_shape(point_light(truth_v(0, 0, 1), 1), r) == -1.0f);
}

/* ---------------------------------------------------------------- warps and weights */

static void test_warps(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(2);
    ht_stats cosine = {0, 0, 0}, cone = {0, 0, 0}, linear = {0, 0, 0};
    for (int i = 0; i < 100000; i++) {
        hyk_vec2 u = next2(&r);
        hyk_vec3 c = hyk_sample_cosine_hemisphere(u), k = hyk_sample_cone(1e-10f, u);
        assert_float_equal(truth_length(from3(c)), 1, 1e-6);
        assert_true(c.z > 0);
        ht_add(&cosine, (double)c.z);          /* mean 2/3 */
        ht_add(&cone, 0.5e10 * (double)(k.x * k.x + k.y * k.y)); /* 1/2: uniform in 1 - cos, at 1e-10 too */
        ht_add(&linear, (double)hyk_sample_linear(u.x, 1e30f, 3e30f)); /* 7/12 */
    }
    expect_mean("cosine", &cosine, 2.0 / 3, 2e-3);
    expect_mean("cone", &cone, 0.5, 3e-3);
    expect_mean("linear", &linear, 7.0 / 12, 2e-3);
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
    ht_rng r = ht_rng_make(3);
    enum { CELLS = 1024, COUNT = 1 << 18 };
    static double observed[CELLS], expected[CELLS];
    double rare = 0;
    memset(observed, 0, sizeof observed);
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_chooser c = hyk_start_choosing(ht_uniform(&r), next2(&r));
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
    assert_true(ht_chi_square_p(observed, expected, CELLS, 1) > 0.01);
    double truth = 2.0 * COUNT * 1e-9 * 16777216.0;
    assert_true(fabs(rare - truth) < 4 * sqrt(truth));
}

/* ---------------------------------------------------------------- densities of surface lights */

/* Where on the light a sample lies, as a place in the unit square, and back. */
static hyk_vec2 place_on(hyk_light l, truth_v3 point) {
    truth_v3 w = truth_sub(point, from3(l.position)), u = from3(l.axis_u), v = from3(l.axis_v), n = from3(l.normal);
    if (l.kind == HYK_LIGHT_DISC) {
        hyk_frame f = hyk_make_frame(l.normal);
        double x = truth_dot(w, from3(f.x)), y = truth_dot(w, from3(f.y)), radius = (double)l.radius;
        return hyk_make2((float)((x * x + y * y) / (radius * radius)), (float)(atan2(y, x) / (2 * HT_PI) + 0.5));
    }
    double a = truth_dot(w, truth_cross(v, n)) / truth_dot(u, truth_cross(v, n));
    double b = truth_dot(w, truth_cross(n, u)) / truth_dot(v, truth_cross(n, u));
    if (l.kind == HYK_LIGHT_RECT) return hyk_make2((float)(0.5 * a + 0.5), (float)(0.5 * b + 0.5));
    return hyk_make2((float)((a + b) * (a + b)), (float)(a + b > 0 ? b / (a + b) : 0)); /* TRIANGLE */
}
static truth_v3 point_at(hyk_light l, double s, double t) {
    truth_v3 c = from3(l.position), u = from3(l.axis_u), v = from3(l.axis_v);
    if (l.kind == HYK_LIGHT_DISC) {
        hyk_frame f = hyk_make_frame(l.normal);
        double phi = 2 * HT_PI * (t - 0.5), rho = sqrt(s) * (double)l.radius;
        return plus(plus(c, from3(f.x), rho * cos(phi)), from3(f.y), rho * sin(phi));
    }
    if (l.kind == HYK_LIGHT_RECT) return plus(plus(c, u, 2 * s - 1), v, 2 * t - 1);
    return plus(plus(c, u, sqrt(s) * (1 - t)), v, sqrt(s) * t);
}

enum { GRID = 12, FINE = 20 };

/* Expected share of samples in each cell of the place square: the kernel's own density, times the true
   solid angle of each small piece of the light. */
static double expected_shares(const light_scene *s, hyk_light l, truth_v3 p, hyk_vec3 n, double *shares) {
    double sum = 0, area = (double)l.area / (GRID * FINE) / (GRID * FINE);
    for (int i = 0; i < GRID * GRID; i++) shares[i] = 0;
    for (int i = 0; i < GRID * FINE; i++)
        for (int j = 0; j < GRID * FINE; j++) {
            truth_v3 to = truth_sub(point_at(l, (i + 0.5) / (GRID * FINE), (j + 0.5) / (GRID * FINE)), p);
            double d = truth_length(to), solid = area * fabs(truth_dot(from3(l.normal), to)) / (d * d * d);
            double pdf = light_density(s, 0, to3(p), n, true, to3(truth_unit(to)), d, l.normal);
            shares[i / FINE * GRID + j / FINE] += pdf * solid;
            sum += pdf * solid;
        }
    return sum;
}

/* kind, seen from a point at that distance (in sizes) and that height angle over its plane. */
static hyk_light posed_light(ht_rng *r, hyk_uint kind, double size) {
    truth_v3 c = truth_mul(truth_rng_direction(r), size), u = truth_mul(truth_rng_direction(r), size);
    truth_v3 v = truth_mul(truth_rng_direction(r), size * between(r, 0.3, 1));
    if (kind == HYK_LIGHT_DISC) return disc_light(c, u, size, 1);
    if (kind == HYK_LIGHT_TRIANGLE) return triangle_light(c, u, v, 1);
    if (truth_rng_unit(r) < 0.7) v = truth_mul(truth_unit(truth_cross(u, v)), truth_length(v));
    return rect_light(c, u, v, 1);
}

typedef struct pose { double away, angle, scale; } pose;
static const pose poses[] = {
    {0.15, 1.2, 1}, {0.5, 1.5, 1}, {0.7, 0.3, 1}, {1, 0.8, 1}, {1.2, 0.15, 1}, {2, 0.5, 1}, {2, 0.02, 1}, {5, 1, 1},
    {30, 0.7, 1}, {1e3, 0.9, 1}, {1e4, 0.01, 1}, {1, 0.8, 1e-6}, {1, 0.8, 1e6}, {3, 0.05, 1e-6}, {100, 0.3, 1e6}
};
static const hyk_uint sheets[] = {HYK_LIGHT_RECT, HYK_LIGHT_TRIANGLE, HYK_LIGHT_DISC};

static truth_v3 pose_point(ht_rng *r, hyk_light l, pose at) {
    truth_v3 middle = l.kind == HYK_LIGHT_TRIANGLE ? point_at(l, 0.44, 0.5) : from3(l.position), n = from3(l.normal);
    truth_v3 side = truth_unit(truth_cross(n, truth_rng_direction(r)));
    return plus(plus(middle, side, at.away * at.scale * cos(at.angle)), n, at.away * at.scale * sin(at.angle));
}

static void check_density(ht_rng *r, hyk_uint kind, pose at, double *worst_sum, double *worst_chance) {
    enum { COUNT = 20000 };
    hyk_light l = posed_light(r, kind, at.scale);
    truth_v3 p = from3(to3(pose_point(r, l, at)));
    hyk_vec3 n = to3(truth_rng_direction(r));
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
    double chance = ht_chi_square_p(observed, expected, GRID * GRID, 1);
    if (fabs(sum - 1) > fabs(*worst_sum)) *worst_sum = sum - 1;
    if (chance < *worst_chance) *worst_chance = chance;
    if (fabs(sum - 1) > 0.004 || chance < sidak(2 * HYI_COUNT(sheets) * HYI_COUNT(poses)))
        fail_msg("kind %u away %g angle %g scale %g: integral %.5f, chance %.3g", kind, at.away, at.angle, at.scale, sum, chance);
    close_scene(&s);
}

static void test_sheet_densities(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(4);
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
static void check_cone(ht_rng *r, hyk_light l, truth_v3 p, double half_angle, double tests) {
    enum { COUNT = 20000 };
    light_scene s;
    bool sun = l.kind == HYK_LIGHT_SUN;
    open_scene(&s, &l, sun ? 0 : 1, sun ? 1 : 0);
    truth_v3 axis = sun ? truth_unit(from3(l.normal)) : truth_unit(truth_sub(from3(l.position), p));
    double cap = 2 * sin(0.5 * half_angle) * sin(0.5 * half_angle), observed[64], expected[64];
    hyk_frame f = hyk_make_frame(to3(axis));
    for (int i = 0; i < 64; i++) observed[i] = 0, expected[i] = COUNT / 64.0;
    for (int i = 0; i < COUNT; i++) {
        hyk_light_sample q = sample_scene(&s, to3(p), to3(axis), true, r);
        truth_v3 d = truth_unit(from3(q.direction)), chord = truth_sub(d, axis);
        double h = 0.5 * truth_dot(chord, chord) / cap, phi = atan2(truth_dot(d, from3(f.y)), truth_dot(d, from3(f.x))) / (2 * HT_PI) + 0.5;
        assert_true(q.flags & HYK_SAMPLE_VALID);
        assert_true(h < 1 + 1e-4 + 1e-6 / half_angle);
        assert_float_equal((double)q.pdf * 2 * HT_PI * cap, 1, 2e-5);
        observed[(int)(fmin(h, 0.9999) * 8) * 8 + (int)(fmin(phi, 0.9999) * 8)]++;
    }
    double chance = ht_chi_square_p(observed, expected, 64, 1);
    if (chance < sidak(tests)) fail_msg("kind %u, half angle %g: chance %g", l.kind, half_angle, chance);
    close_scene(&s);
}

static void test_cone_densities(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(5);
    static const double distances[] = {1.0001, 1.1, 2, 10, 300, 3e4}, radii[] = {1e-4, 0.00465, 0.3, 1.5, 2.5};
    double tests = 2 * HYI_COUNT(distances) + HYI_COUNT(radii);
    for (size_t i = 0; i < HYI_COUNT(distances); i++)
        for (int big = 0; big < 2; big++) {
            double scale = big ? 1e6 : 1e-6;
            hyk_light l = sphere_light(truth_mul(truth_rng_direction(&r), scale), scale, 1);
            truth_v3 p = from3(to3(plus(from3(l.position), truth_rng_direction(&r), distances[i] * scale)));
            check_cone(&r, l, p, asin((double)l.radius / truth_length(truth_sub(p, from3(l.position)))), tests);
        }
    for (size_t i = 0; i < HYI_COUNT(radii); i++)
        check_cone(&r, sun_light(truth_rng_direction(&r), radii[i], 1), truth_v(1, 2, 3), (double)(float)radii[i], tests);
}

/* The point that a sample names is on the light, and a ray in its direction meets the light there; the density
   told for that ray is the sample's. */
static void test_density_of_hits(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(6);
    double worst = 0, worst_place = 0;
    uint32_t hits = 0;
    for (int i = 0; i < 3000; i++) {
        pose at = poses[(size_t)i % HYI_COUNT(poses)];
        hyk_uint kind = i % 4 == 3 ? HYK_LIGHT_SPHERE : sheets[i % 4];
        hyk_light l = kind == HYK_LIGHT_SPHERE ? sphere_light(truth_mul(truth_rng_direction(&r), at.scale), at.scale, 1)
                                               : posed_light(&r, kind, at.scale);
        if (kind == HYK_LIGHT_SPHERE) l.normal = to3(truth_rng_direction(&r)), at.away += 1.01;
        hyk_vec3 p = to3(pose_point(&r, l, at)), n = to3(truth_rng_direction(&r));
        light_scene s;
        open_scene(&s, &l, 1, 0);
        for (int k = 0; k < 10; k++) {
            hyk_light_sample q = sample_scene(&s, p, n, true, &r);
            hyk_light rect = l;
            if (!(q.flags & HYK_SAMPLE_VALID)) continue;
            float t = kind == HYK_LIGHT_TRIANGLE ? q.distance : hyk_intersect_shape(rect, ray_of(p, q.direction));
            if (t < 0) continue; /* rounding at the edge */
            truth_v3 hit = plus(from3(p), from3(q.direction), (double)t);
            double cosine = fmax(fabs(truth_dot(from3(q.normal), from3(q.direction))), 1e-4);
            if (kind == HYK_LIGHT_SPHERE) { /* its normal leads from the centre to the point */
                truth_v3 out = truth_mul(truth_sub(from3(q.position), from3(l.position)), 1 / at.scale);
                assert_true(truth_length(truth_sub(out, from3(q.normal))) < 1e-5 * (1 + at.away));
            }
            worst_place = fmax(worst_place, truth_length(truth_sub(hit, from3(q.position))) / ((double)q.distance + at.scale) * cosine);
            double pdf = light_density(&s, 0, p, n, true, q.direction, (double)t, hyk_shape_normal(l, to3(hit)));
            if (kind == HYK_LIGHT_SPHERE && pdf == 0) continue; /* the rim's normal, seen from afar */
            worst = fmax(worst, fabs(pdf / (double)q.pdf - 1));
            hits++;
        }
        close_scene(&s);
    }
    print_message("  density of %u hits: worst relative difference %.2g; place of the hit within %.2g of the distance\n", hits, worst,
                  worst_place);
    assert_true(hits > 28000);
    assert_true(worst < 1e-3);
    assert_true(worst_place < 1e-4);
}

/* ---------------------------------------------------------------- irradiance against formulas (TRUTH B) */

static void check_irradiance(const char *what, hyk_light l, truth_v3 p, truth_v3 n, double truth, double bound) {
    ht_rng r = ht_rng_make(7);
    light_scene s;
    open_scene(&s, &l, l.kind == HYK_LIGHT_SUN ? 0 : 1, l.kind == HYK_LIGHT_SUN ? 1 : 0);
    ht_stats m = irradiance(&s, to3(p), to3(n), 40000, &r);
    expect_mean(what, &m, truth, bound);
    close_scene(&s);
}

static void test_irradiance_formulas(void **state) {
    (void)state;
    double h = 2, d = 1.5, R = 0.8;
    truth_v3 o = truth_v(0, 0, 0), up = truth_v(0, 1, 0);
    check_irradiance("B.2 point", point_light(truth_v(d, h, 0), 5), o, up, 5 * h / pow(h * h + d * d, 1.5), 1e-6);
    check_irradiance("B.3 sphere above", sphere_light(truth_v(0, h, 0), R, 3), o, up, HT_PI * 3 * R * R / (h * h), 1e-3);
    truth_v3 aslant = truth_unit(truth_v(1, 2, 0));
    check_irradiance("B.3 sphere aslant", sphere_light(truth_mul(aslant, 4), R, 3), o, up, HT_PI * 3 * R * R / 16 * aslant.y, 1e-3);
    check_irradiance("B.4 disc", disc_light(truth_v(0, h, 0), truth_v(0, -1, 0), R, 3), o, up, HT_PI * 3 * R * R / (R * R + h * h), 2e-3);
    check_irradiance("B.4 disc, near", disc_light(truth_v(0, 0.01, 0), truth_v(0, -1, 0), R, 3), o, up,
                     HT_PI * 3 * R * R / (R * R + 1e-4), 5e-3);
    check_irradiance("B.7 sun", sun_light(aslant, 0.2, 3), o, up, HT_PI * 3 * sin(0.2) * sin(0.2) * aslant.y, 1e-3);
    check_irradiance("B.7 small sun", sun_light(aslant, 1e-5, 3e10), o, up, HT_PI * 3e10 * 1e-10 * aslant.y, 1e-3);
    check_irradiance("parallel sun", sun_light(aslant, 0, 3), o, up, 3 * aslant.y, 1e-6);
    double a = 1.3, b = 0.9, X = a / h, Y = b / h;
    double F = (X / sqrt(1 + X * X) * atan(Y / sqrt(1 + X * X)) + Y / sqrt(1 + Y * Y) * atan(X / sqrt(1 + Y * Y))) / (2 * HT_PI);
    check_irradiance("B.6 rectangle", rect_light(truth_v(a / 2, h, b / 2), truth_v(a / 2, 0, 0), truth_v(0, 0, b / 2), 3), o, up,
                     HT_PI * 3 * F, 1e-3);
    truth_v3 axis = truth_unit(truth_v(-1, -1, 0)); /* spot, on the axis and between the cones */
    check_irradiance("spot axis", spot_light(truth_v(1, 1, 0), axis, 0.3, 0.6, 4), o, up, 4 / 2.0 * sqrt(0.5), 1e-6);
    double c = cos(0.45), x = (c - cos(0.6)) / (cos(0.3) - cos(0.6));
    check_irradiance("spot falloff", spot_light(truth_v(0, 1, 0), truth_v(sin(0.45), -c, 0), 0.3, 0.6, 4), o, up,
                     4 * x * x * (3 - 2 * x), 1e-5);
}

/* Random polygons at any pose, some cut by the horizon, near and far, at three scales and three radiances. */
static void test_polygon_irradiance(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(8);
    static const double scales[] = {1, 1e-6, 1e6}, radiances[] = {1, 1e-12, 1e12};
    for (int i = 0; i < 90; i++) {
        double scale = scales[i % 3], radiance = radiances[i / 3 % 3];
        bool rect = i % 2 == 0;
        truth_v3 p = truth_mul(truth_rng_direction(&r), scale);
        truth_v3 c = plus(p, truth_rng_direction(&r), scale * pow(10, between(&r, -0.5, 1.5)));
        truth_v3 u = truth_mul(truth_rng_direction(&r), scale), v = truth_mul(truth_rng_direction(&r), scale);
        if (truth_dot(truth_cross(u, v), truth_sub(p, c)) < 0) v = truth_mul(v, -1);
        if (rect && i % 4 == 0) v = truth_cross(truth_unit(truth_cross(u, v)), u); /* right angles */
        hyk_light l = rect ? rect_light(c, u, v, radiance) : triangle_light(c, u, v, radiance);
        truth_v3 n = truth_unit(plus(truth_unit(truth_sub(c, p)), truth_rng_direction(&r), 0.7)), corners[4];
        c = from3(l.position), u = from3(l.axis_u), v = from3(l.axis_v), p = from3(to3(p));
        corners[0] = rect ? plus(plus(c, u, -1), v, -1) : c;
        corners[1] = rect ? plus(plus(c, u, 1), v, -1) : plus(c, u, 1);
        corners[2] = rect ? plus(plus(c, u, 1), v, 1) : plus(c, v, 1);
        corners[3] = plus(plus(c, u, -1), v, 1);
        double truth = truth_polygon_irradiance(corners, rect ? 4 : 3, p, n, (double)l.radiance.x);
        if (truth < 1e-5 * radiance) continue; /* hardly above the horizon */
        char what[64];
        snprintf(what, sizeof what, "polygon %d (scale %g, radiance %g)", i, scale, radiance);
        check_irradiance(what, l, p, n, truth, 0.03);
    }
}

/* ---------------------------------------------------------------- special cases */

/* A triangle whose emission is a texture: red = u, so the radiance at a point is linear in its place. */
static void test_textured_triangle(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(20);
    enum { W = 256 };
    static uint32_t words[4 * W * 2];
    light_scene s;
    hyk_light l = triangle_light(truth_v(0, 2, 0), truth_v(0, 0, -1), truth_v(1, 0, 0), 1);
    if (l.normal.y > 0) l = triangle_light(truth_v(0, 2, 0), truth_v(1, 0, 0), truth_v(0, 0, -1), 1);
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
        truth_v3 w = truth_sub(from3(q.position), from3(l.position));
        double u = 0.1 + 0.8 * truth_dot(w, from3(l.axis_u)) + 0.3 * truth_dot(w, from3(l.axis_v));
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
    ht_rng r = ht_rng_make(21);
    hyk_light lights[6];
    lights[0] = rect_light(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1);
    lights[1] = disc_light(truth_v(0, 0, 0), truth_v(0, 0, 1), 1, 1);
    lights[2] = triangle_light(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1);
    lights[3] = sphere_light(truth_v(0, 0, 0), 1, 1);
    lights[4] = point_light(truth_v(0, 0, 0), 1);
    lights[5] = lights[1];
    lights[5].flags = HYK_LIGHT_BOTH_SIDES;
    static const float points[][3] = {{0, 0, 0}, {1, 0, 0}, {0.5f, 0.5f, 0}, {3, 0, 0}, {0, 0, -1e-20f},
                                      {1, 1, 1e-30f}, {0, 0, 1e-38f}, {0, 0, 1e15f}, {1e15f, 0, 1}};
    for (size_t i = 0; i < HYI_COUNT(points); i++)
        for (int k = 0; k < 6; k++) {
            light_scene s;
            hyk_light l = lights[k];
            open_scene(&s, &l, 1, 0);
            for (int j = 0; j < 50; j++) {
                hyk_vec3 p = hyk_make3(points[i][0], points[i][1], points[i][2]);
                hyk_light_sample q = sample_scene(&s, p, hyk_make3(0, 0, -1), true, &r);
                assert_true(hyk_is_finite(q.pdf) && hyk_is_finite(q.radiance.x) && hyk_is_finite(q.distance));
                if (q.flags & HYK_SAMPLE_VALID) assert_float_equal(truth_length(from3(q.direction)), 1, 1e-5);
            }
            close_scene(&s);
        }
}

int hydra_test_lights(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shapes_against_long_double),
        cmocka_unit_test(test_shape_edge_cases),
        cmocka_unit_test(test_warps),
        cmocka_unit_test(test_power_heuristic),
        cmocka_unit_test(test_chooser),
        cmocka_unit_test(test_sheet_densities),
        cmocka_unit_test(test_cone_densities),
        cmocka_unit_test(test_density_of_hits),
        cmocka_unit_test(test_irradiance_formulas),
        cmocka_unit_test(test_polygon_irradiance),
        cmocka_unit_test(test_textured_triangle),
        cmocka_unit_test(test_degenerate_points),
    };
    return cmocka_run_group_tests_name("lights", tests, NULL, NULL);
}
