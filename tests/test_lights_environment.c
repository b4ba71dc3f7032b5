/* The environment and its map; and lights of all kinds together. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "light_helpers.h"

int hydra_test_lights_environment(void);

/* ---------------------------------------------------------------- environment */

static void fill_map(float *texels, uint32_t count, ht_rng *r, double low) {
    for (uint32_t i = 0; i < 3 * count; i++) texels[i] = (float)pow(10, between(r, low, 0));
}

/* Integral over the sphere, or over the cosine about n, of the kernel's radiance (density: false) or density,
   midpoint rule in double, per cell of a sphere grid when cells is given. */
enum { RINGS = 16, SECTORS = 32 };
static double integrate_sphere(const light_scene *s, bool density, const truth_v3 *n, uint32_t fine, double *cells) {
    double sum = 0;
    uint32_t rings = RINGS * fine, sectors = SECTORS * fine;
    for (uint32_t i = 0; cells && i < RINGS * SECTORS; i++) cells[i] = 0;
    for (uint32_t i = 0; i < rings; i++) {
        double z = 1 - 2 * (i + 0.5) / rings, side = sqrt(1 - z * z);
        for (uint32_t j = 0; j < sectors; j++) {
            double phi = 2 * HT_PI * (j + 0.5) / sectors, weight = 4 * HT_PI / rings / sectors;
            truth_v3 d = truth_v(side * cos(phi), z, side * sin(phi));
            if (n) weight *= fmax(truth_dot(d, *n), 0);
            double f = density ? sky_density(s, HYK_NONE, hyk_zero3(), hyk_make3(0, 1, 0), true, to3(d))
                               : (double)sky(s, to3(d)).x;
            sum += f * weight;
            if (cells) cells[i / fine * SECTORS + j / fine] += f * weight;
        }
    }
    return sum;
}

static double check_map(light_scene *s, ht_rng *r, double tests) {
    enum { COUNT = 100000 };
    static double observed[RINGS * SECTORS], expected[RINGS * SECTORS];
    double sum = integrate_sphere(s, true, NULL, 32, expected);
    if (fabs(sum - 1) > 2e-3) fail_msg("density integrates to %.6f", sum);
    for (uint32_t i = 0; i < RINGS * SECTORS; i++) expected[i] *= COUNT / sum, observed[i] = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_light_sample q = sample_scene(s, hyk_zero3(), hyk_make3(0, 1, 0), true, r);
        double ring = (1 - (double)q.direction.y) / 2, sector = atan2((double)q.direction.z, (double)q.direction.x) / (2 * HT_PI);
        assert_true((q.flags & HYK_SAMPLE_VALID) && q.light == HYK_NONE);
        if (sector < 0) sector += 1;
        observed[(int)(fmin(ring, 0.99999) * RINGS) * SECTORS + (int)(fmin(sector, 0.999999) * SECTORS)]++;
    }
    double chance = ht_chi_square_p(observed, expected, RINGS * SECTORS, 1);
    if (chance < sidak(tests))
        fail_msg("map %u x %u: chance %g", s->view.constants.environment_width, s->view.constants.environment_height, chance);
    return chance;
}

static void test_map_density(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(15);
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
    ht_rng r = ht_rng_make(16);
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
            hyk_vec3 d = to3(truth_rng_direction(&r));
            bool bright = sky(&s, d).x > 0;
            bool found = sky_density(&s, HYK_NONE, hyk_zero3(), d, false, d) > 0;
            assert_true(bright == found);
        }
        truth_v3 n = truth_unit(plus(from3(hyk_map_direction(&s.view, places[k][0], places[k][1], 0, 0.5f)), truth_rng_direction(&r), 0.5));
        double truth = integrate_sphere(&s, false, &n, 64, NULL);
        ht_stats m = irradiance(&s, hyk_zero3(), to3(n), 40000, &r);
        double error = ht_standard_error(&m);
        assert_true(fabs(m.mean - truth) < 4 * error + 3e-3 * truth); /* the quadrature has 25 points across the texel */
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
            double from = row == 0 ? 0 : HT_PI * (row - 0.5) / H, to = row == H ? HT_PI : HT_PI * (row + 0.5) / H;
            double mean_corner = (row == 10 || row == 11) && (x == 19 || x == 20) ? 0.25e12 + 0.75 : 1;
            double truth = (cos(from) - cos(to)) * 2 * HT_PI / W * mean_corner / (double)s.view.constants.environment_integral;
            double told = bisected(s.cdf, H + 1, row) * bisected(s.cdf + (H + 1) + W * row, W, x);
            assert_float_equal(told / truth, 1, 1e-5);
        }
    close_scene(&s);
}

/* A sun of 1e9 in a map of 1: dim places keep their probability, which a table of sums in float would lose. */
static void test_map_contrast(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(17);
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
    double truth = count * 4 * HT_PI / (double)s.view.constants.environment_integral;
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
    double high = sin(HT_PI / 4), low = cos(HT_PI / 4);
    /* middle of the upper row's third texel: u = 5/8, that is atan2(x, -z) = pi / 4 */
    truth_v3 third = truth_v(low * sin(HT_PI / 4), high, -low * cos(HT_PI / 4));
    assert_float_equal(sky(&s, to3(third)).x, 3, 1e-5);
    assert_float_equal(sky(&s, hyk_make3(0, 1, 0)).x, 2.5, 1.6);
    assert_float_equal(sky(&s, to3(truth_v(0, high, low))).x, 2.5, 1e-5); /* seam: between 4 and 1 */
    s.view.constants.environment_rotation = (float)(HT_PI / 2);
    truth_v3 turned = truth_v(third.z, third.y, -third.x); /* right-handed quarter turn about +Y */
    assert_float_equal(sky(&s, to3(turned)).x, 3, 1e-5);
    close_scene(&s);
}

static void test_constant_environment(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(18);
    light_scene s;
    open_scene(&s, NULL, 0, 0);
    s.view.constants.environment = hyk_splat(2);
    ht_stats m = irradiance(&s, hyk_zero3(), to3(truth_unit(truth_v(1, -2, 3))), 10000, &r), both = {0, 0, 0};
    expect_mean("B.1", &m, 2 * HT_PI, 1e-5);
    hyk_vec3 n = to3(truth_rng_direction(&r));
    for (int i = 0; i < 10000; i++) {
        hyk_light_sample q = sample_scene(&s, hyk_zero3(), n, true, &r);
        ht_add(&both, (double)q.radiance.x / (double)q.pdf * fabs((double)hyk_dot(n, q.direction)));
    }
    expect_mean("both sides", &both, 4 * HT_PI, 1e-5);
    s.view.constants.environment = hyk_zero3();
    assert_int_equal(sample_scene(&s, hyk_zero3(), n, true, &r).flags, 0);
    close_scene(&s);
}

/* ---------------------------------------------------------------- all together */

/* A rectangle, three suns and a map: irradiance is the sum of what each gives, and the densities told for rays
   that hit them are those of the samples. */
static void test_groups(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(19);
    static float texels[3 * 16 * 8];
    hyk_light lights[4];
    light_scene s, alone;
    truth_v3 n = truth_unit(truth_v(0.2, 1, -0.1));
    hyk_vec3 p = hyk_zero3(), normal = to3(n);
    lights[0] = rect_light(truth_v(0, 2, 0), truth_v(0, 0, 0.5), truth_v(-0.5, 0, 0), 5);
    if (lights[0].normal.y > 0) lights[0] = rect_light(truth_v(0, 2, 0), truth_v(-0.5, 0, 0), truth_v(0, 0, 0.5), 5);
    lights[1] = sun_light(truth_v(1, 1, 0), 0.1, 20);
    lights[2] = sun_light(truth_v(0, 1, 1), 0, 1);
    lights[3] = sun_light(truth_v(0, -0.05, 1), 0.3, 3); /* half set */
    fill_map(texels, 16 * 8, &r, -1);
    double truth = 0;
    for (uint32_t i = 0; i < 4; i++) {
        open_scene(&alone, &lights[i], i ? 0 : 1, i ? 1 : 0);
        ht_stats m = irradiance(&alone, p, normal, 100000, &r);
        truth += m.mean;
        close_scene(&alone);
    }
    open_scene(&s, lights, 1, 3);
    set_map(&s, texels, 16, 8, 0.5, 1);
    truth += integrate_sphere(&s, false, &n, 32, NULL);
    ht_stats m = irradiance(&s, p, normal, 200000, &r);
    double error = ht_standard_error(&m);
    assert_true(fabs(m.mean - truth) < 4 * error + 2e-3 * truth && error < 5e-3 * truth);
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

int hydra_test_lights_environment(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_map_density),
        cmocka_unit_test(test_map_bright_texel),
        cmocka_unit_test(test_map_shares),
        cmocka_unit_test(test_map_contrast),
        cmocka_unit_test(test_map_orientation),
        cmocka_unit_test(test_constant_environment),
        cmocka_unit_test(test_groups),
    };
    return cmocka_run_group_tests_name("lights_environment", tests, NULL, NULL);
}
