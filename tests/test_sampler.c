/* Random numbers: nets, uniformity, error rates, and how error lies on the screen. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

int hydra_test_sampler(void);

static hyk_vec2 point(uint32_t x, uint32_t y, uint32_t index, uint32_t seed, uint32_t pair) {
    return hyk_sample_pair(hyk_make_sampler(x, y, index, seed), pair);
}

/* TRUTH F.2: 2^m points put one into each elementary box of area 2^-m. Fails if scrambling or shifting breaks the nets
   (for example with an addition where an exclusive or belongs). */
static void assert_net(uint32_t m, uint32_t first, uint32_t pixel, uint32_t pair) {
    uint32_t n = 1u << m;
    for (uint32_t split = 0; split <= m; split++) {
        uint8_t *seen = (uint8_t *)calloc(n, 1);
        assert_non_null(seen);
        for (uint32_t i = 0; i < n; i++) {
            hyk_vec2 u = point(pixel, pixel * 7 + 3, first + i, 99, pair);
            uint32_t column = (uint32_t)(u.x * (float)(1u << split)), row = (uint32_t)(u.y * (float)(1u << (m - split)));
            uint32_t box = row << split | column;
            assert_true(box < n);
            assert_int_equal(seen[box], 0);
            seen[box] = 1;
        }
        free(seen);
    }
}

static void test_every_pair_is_a_net(void **state) {
    (void)state;
    for (uint32_t pair = 0; pair < 40; pair += 3)
        for (uint32_t m = 1; m <= 10; m += 3) assert_net(m, 0, 5 + pair, pair);
    assert_net(6, 64, 2, 1); /* any aligned stretch of the sequence is one too */
    assert_net(4, 48, 3, 5);
}

/* The mean over pixels and seeds of each coordinate and of the product of two pairs: 1/2, 1/2, 1/4. */
static void test_coordinates_are_uniform_and_pairs_independent(void **state) {
    (void)state;
    const uint32_t side = ht_pick(256, 96);
    double sum[4] = { 0, 0, 0, 0 }, count = 0.0;
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++)
            for (uint32_t s = 0; s < 2; s++) {
                hyk_vec2 a = point(x, y, s, 1, 4), b = point(x, y, s, 1, 5);
                sum[0] += (double)a.x;
                sum[1] += (double)a.y;
                sum[2] += (double)a.x * (double)b.x;
                sum[3] += (double)a.x * (double)a.y;
                count += 1.0;
            }
    double tolerance = 4.0 * 0.29 / sqrt(count);
    assert_true(fabs(sum[0] / count - 0.5) < tolerance);
    assert_true(fabs(sum[1] / count - 0.5) < tolerance);
    assert_true(fabs(sum[2] / count - 0.25) < tolerance);
    assert_true(fabs(sum[3] / count - 0.25) < tolerance);
}

static double smooth(hyk_vec2 u) { return (double)u.x * (double)u.y * exp((double)u.x); } /* integral: 1/2 */
static double edge(hyk_vec2 u) { return (double)u.x + 0.7 * (double)u.y < 0.6 ? 1.0 : 0.0; }
static const double edge_truth = 0.5 * 0.6 * 0.6 / 0.7;

static double rms_error(double (*f)(hyk_vec2), double truth, uint32_t n, uint32_t seeds) {
    double sum = 0.0;
    for (uint32_t seed = 0; seed < seeds; seed++) {
        double mean = 0.0;
        for (uint32_t i = 0; i < n; i++) mean += f(point(seed & 15, seed >> 4, i, seed * 31 + 7, 2)) / (double)n;
        sum += (mean - truth) * (mean - truth);
    }
    return sqrt(sum / (double)seeds);
}

/* TRUTH F.2: error of a smooth integrand falls about as N^-1.5, of an edge about as N^-0.75; random numbers give N^-0.5. */
static void test_error_falls_faster_than_random(void **state) {
    (void)state;
    double smooth_rate = log2(rms_error(smooth, 0.5, 16, 200) / rms_error(smooth, 0.5, 1024, 200)) / 6.0;
    double edge_rate = log2(rms_error(edge, edge_truth, 16, 200) / rms_error(edge, edge_truth, 1024, 200)) / 6.0;
    print_message("sampler: error falls as N^-%.2f (smooth), N^-%.2f (edge)\n", smooth_rate, edge_rate);
    assert_true(smooth_rate > 1.35);
    assert_true(edge_rate > 0.65);
    assert_true(rms_error(edge, edge_truth, 16, 400) < sqrt(edge_truth * (1.0 - edge_truth) / 16.0));
}

/* Error of one sample a pixel, averaged over 4x4 pixels, against what independent pixels would give. */
static double block_error(uint32_t samples, uint32_t block) {
    const uint32_t side = 128;
    double blocks = 0.0, sum = 0.0, single = 0.0;
    for (uint32_t y = 0; y < side; y += block)
        for (uint32_t x = 0; x < side; x += block) {
            double mean = 0.0;
            for (uint32_t j = 0; j < block; j++)
                for (uint32_t i = 0; i < block; i++) {
                    double pixel = 0.0;
                    for (uint32_t s = 0; s < samples; s++) pixel += smooth(point(x + i, y + j, s, 3, 6)) / (double)samples;
                    single += (pixel - 0.5) * (pixel - 0.5);
                    mean += pixel;
                }
            mean /= (double)(block * block);
            sum += (mean - 0.5) * (mean - 0.5);
            blocks += 1.0;
        }
    single /= (double)(side * side);
    return (sum / blocks) / (single / (double)(block * block));
}

/* Blue-noise-like: neighbours' errors cancel when samples are few, and never add up when they are many. */
static void test_errors_of_neighbours_cancel(void **state) {
    (void)state;
    double one = block_error(1, 4), four = block_error(4, 4), many = block_error(64, 4);
    print_message("sampler: variance over 4x4 pixels against independent ones: %.3f at 1 sample, %.2f at 4, %.2f at 64\n", one, four, many);
    assert_true(one < 0.2);
    assert_true(four < 1.15);
    assert_true(many < 1.2);
}

/* The two halves of a pixel's samples, and different seeds, must be uncorrelated: error bars stand on it. */
static void test_seeds_are_independent(void **state) {
    (void)state;
    const uint32_t side = 96;
    double product = 0.0, square = 0.0;
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++) {
            double a = 0.0, b = 0.0;
            for (uint32_t s = 0; s < 4; s++) {
                a += smooth(point(x, y, s, 17, 3)) / 4.0 - 0.125;
                b += smooth(point(x, y, s, 18, 3)) / 4.0 - 0.125;
            }
            product += a * b;
            square += a * a;
        }
    assert_true(fabs(product / square) < 4.0 / (double)side);
}

int hydra_test_sampler(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_pair_is_a_net),
        cmocka_unit_test(test_coordinates_are_uniform_and_pairs_independent),
        cmocka_unit_test(test_error_falls_faster_than_random),
        cmocka_unit_test(test_errors_of_neighbours_cancel),
        cmocka_unit_test(test_seeds_are_independent),
    };
    return cmocka_run_group_tests_name("sampler", tests, NULL, NULL);
}
