/* Choosing among many lights: the light tree. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "light_helpers.h"

int hydra_test_lights_tree(void);

/* ---------------------------------------------------------------- the light tree */

static hyk_light mixed_light(ht_rng *r, double scale) {
    truth_v3 c = truth_mul(truth_v(between(r, -10, 10), between(r, -1, 1), between(r, -10, 10)), scale);
    double size = scale * pow(10, between(r, -2, -0.7)), power = pow(10, between(r, -2, 2));
    double pick = truth_rng_unit(r) * 6;
    truth_v3 a = truth_rng_direction(r), b = truth_unit(truth_cross(a, truth_rng_direction(r)));
    hyk_light l = rect_light(c, truth_mul(a, size), truth_mul(b, size), power / (size * size));
    if (pick < 1) l = disc_light(c, a, size, power / (size * size));
    else if (pick < 2) l = sphere_light(c, size, power / (size * size));
    else if (pick < 3) l = point_light(c, power);
    else if (pick < 4) l = spot_light(c, a, 0.5, between(r, 0.5, 3), power);
    else if (pick < 5) l = triangle_light(c, truth_mul(a, size), truth_mul(plus(b, a, 0.3), size), power / (size * size));
    if (truth_rng_unit(r) < 0.2 && (l.kind == HYK_LIGHT_RECT || l.kind == HYK_LIGHT_DISC)) l.flags = HYK_LIGHT_BOTH_SIDES;
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
    ht_rng r = ht_rng_make(9);
    static hyk_light lights[MANY];
    light_scene s;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    assert_int_equal(s.node_count, 2 * MANY - 1);
    for (int k = 0; k < 20; k++) {
        hyk_vec3 p = to3(truth_v(between(&r, -11, 11), between(&r, -2, 2), between(&r, -11, 11))), n = to3(truth_rng_direction(&r));
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
    ht_rng r = ht_rng_make(10);
    enum { COUNT = 400000 };
    static hyk_light lights[MANY];
    static double observed[MANY + 1], expected[MANY + 1];
    light_scene s;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    hyk_vec3 p = hyk_make3(0.3f, 0.2f, -1), n = to3(truth_unit(truth_v(1, 2, 0.5)));
    memset(observed, 0, sizeof observed);
    for (uint32_t i = 0; i < COUNT; i++) {
        hyk_light_pick pick = pick_light(&s, p, n, &r);
        observed[pick.light == HYK_NONE ? MANY : pick.light]++;
    }
    for (uint32_t i = 0; i < MANY; i++) expected[i] = COUNT * pick_probability(&s, i, p, n);
    expected[MANY] = COUNT * lost_probability(&s, 0, 1, p, n);
    double chance = ht_chi_square_p(observed, expected, MANY + 1, 1);
    if (chance < 0.01) fail_msg("chance %g", chance);
    close_scene(&s);
}

/* Against choosing lights evenly: same estimate, far less variance. */
static void test_tree_variance(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(11);
    static hyk_light lights[MANY];
    light_scene s;
    double logarithms = 0;
    for (int i = 0; i < MANY; i++) lights[i] = mixed_light(&r, 1);
    open_scene(&s, lights, MANY, 0);
    for (int k = 0; k < 10; k++) {
        hyk_vec3 p = to3(truth_v(between(&r, -8, 8), -1.5, between(&r, -8, 8))), n = hyk_make3(0, 1, 0);
        ht_stats tree = irradiance(&s, p, n, 20000, &r), even = {0, 0, 0};
        for (uint32_t i = 0; i < 200000; i++) {
            hyk_light_sample q = sample_light(&s, ht_below(&r, MANY), p, &r);
            bool counts = (q.flags & HYK_SAMPLE_VALID) && q.direction.y > 0;
            ht_add(&even, counts ? MANY * (double)q.radiance.x / (double)q.pdf * (double)q.direction.y : 0);
        }
        double tree_error = ht_standard_error(&tree), even_error = ht_standard_error(&even);
        assert_true(fabs(tree.mean - even.mean) < 4.5 * sqrt(tree_error * tree_error + even_error * even_error));
        assert_true(tree_error < 0.05 * tree.mean);
        logarithms += log(ht_variance(&even) / ht_variance(&tree)) / 10;
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
    ht_rng r = ht_rng_make(12);
    static hyk_light lights[4096];
    check_tree_shape(lights, 0);
    for (int i = 0; i < 4096; i++) lights[i] = point_light(truth_v(1, 2, 3), 1);
    check_tree_shape(lights, 1);
    check_tree_shape(lights, 2);
    check_tree_shape(lights, 4096); /* all in one place */
    for (int i = 0; i < 4096; i++) lights[i] = point_light(truth_v(pow(2, -(i % 120)) * (1 + i / 120), 0, 0), pow(10, i % 25 - 12));
    check_tree_shape(lights, 4096); /* a chain that a greedy split makes far deeper than 32 */
    for (int i = 0; i < 4096; i++) lights[i] = mixed_light(&r, i % 2 ? 1e-6 : 1e6);
    check_tree_shape(lights, 4096);
    for (int i = 0; i < 4096; i++) lights[i] = point_light(truth_v(0, i, 0), 0);
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
    ht_rng r = ht_rng_make(13);
    for (size_t k = 0; k < HYI_COUNT(scales); k++) {
        double scale = scales[k];
        hyk_light lights[3];
        light_scene s;
        lights[0] = point_light(truth_v(0, scale, 0), 1e-12);
        lights[1] = sphere_light(truth_v(10 * scale, 3 * scale, 0), scale, 1e12 / (HT_PI * scale * scale));
        lights[2] = disc_light(truth_v(0, -scale, 0), truth_v(0, 1, 0), scale, 1); /* below the horizon */
        open_scene(&s, lights, 3, 0);
        hyk_vec3 p = hyk_zero3(), n = hyk_make3(0, 1, 0);
        assert_true(pick_probability(&s, 0, p, n) > 0);
        assert_true(pick_probability(&s, 1, p, n) > 0.9);
        assert_true(pick_probability(&s, 2, p, n) == 0);
        ht_stats m = irradiance(&s, p, n, 20000, &r);
        double truth = HT_PI * (double)lights[1].radiance.x * scale * scale / (109 * scale * scale) * 3 / sqrt(109);
        expect_mean("sphere among extremes", &m, truth, 1e-2);
        close_scene(&s);
    }
}

static void test_tree_million(void **state) {
    (void)state;
    ht_rng r = ht_rng_make(14);
    uint32_t count = 1000000;
    hyk_light *lights = (hyk_light *)malloc(count * sizeof *lights);
    light_scene s;
    assert_non_null(lights);
    for (uint32_t i = 0; i < count; i++) {
        truth_v3 c = truth_v(between(&r, -1e3, 1e3), between(&r, -10, 10), between(&r, -1e3, 1e3)), a = truth_rng_direction(&r);
        lights[i] = triangle_light(c, truth_mul(a, 0.01), truth_mul(truth_unit(truth_cross(a, truth_v(0, 1, 0))), 0.01), 100);
    }
    double start = hyi_seconds();
    open_scene(&s, lights, count, 0);
    double built = hyi_seconds() - start;
    start = hyi_seconds();
    ht_stats m = irradiance(&s, hyk_make3(0, -20, 0), hyk_make3(0, 1, 0), 20000, &r);
    print_message("  a million lights: built in %.2f s, depth %u, %.2f us a sample\n", built,
                  tree_depth(&s, 0), (hyi_seconds() - start) / 20000 * 1e6);
    assert_true(m.mean > 0 && built < 60);
    close_scene(&s);
    free(lights);
}

int hydra_test_lights_tree(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tree_probabilities),
        cmocka_unit_test(test_tree_frequencies),
        cmocka_unit_test(test_tree_variance),
        cmocka_unit_test(test_tree_shapes),
        cmocka_unit_test(test_tree_extremes),
        cmocka_unit_test(test_tree_million),
    };
    return cmocka_run_group_tests_name("lights_tree", tests, NULL, NULL);
}
