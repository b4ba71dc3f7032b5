/* Sums that do not depend on order, and the schedule of tiles that stands on them. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

int hydra_test_sums(void);

static double random_term(ht_rng *rng, int spread) {
    double x = (double)ht_uniform(rng) + 0.5;
    int exponent = (int)(ht_uniform(rng) * (float)(2 * spread)) - spread;
    return ldexp(ht_uniform(rng) < 0.5f ? -x : x, exponent);
}

/* Any order, any grouping: the same bytes. Fails if a digit below the kept lanes leaks into them by a carry. */
static void test_order_does_not_matter(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(1);
    for (int trial = 0; trial < 500; trial++) {
        double terms[120];
        hyi_sum forward, backward, odd;
        memset(&forward, 0, sizeof forward);
        memset(&backward, 0, sizeof backward);
        memset(&odd, 0, sizeof odd);
        for (int i = 0; i < 120; i++) {
            terms[i] = random_term(&rng, 1 + trial % 300);
            hyi_sum_add(&forward, terms[i]);
        }
        for (int i = 119; i >= 0; i--) hyi_sum_add(i & 1 ? &odd : &backward, terms[i]);
        hyi_sums_merge(&odd.lanes, &odd.top, &backward.lanes, backward.top, 1);
        assert_memory_equal(&forward, &odd, sizeof odd);
    }
}

/* Against long double: within 2^-32 of the largest term, a term. */
static void test_precision(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(2);
    for (int trial = 0; trial < 200; trial++) {
        long double truth = 0.0L;
        double largest = 0.0;
        hyi_sum sum;
        memset(&sum, 0, sizeof sum);
        for (int i = 0; i < 1000; i++) {
            double term = random_term(&rng, 60);
            truth += (long double)term;
            largest = fmax(largest, fabs(term));
            hyi_sum_add(&sum, term);
        }
        assert_true(fabsl((long double)hyi_sum_value(&sum) - truth) <= (long double)ldexp(1000.0 * largest, -32));
    }
}

/* A million terms of 0.1f: a float sum is off by a percent, this one by nothing. */
static void test_a_million_terms(void **state) {
    (void)state;
    hyi_sum3 sum;
    float naive = 0.0f;
    const float terms[3] = { 0.1f, 1e-12f, 1e12f };
    memset(&sum, 0, sizeof sum);
    for (int i = 0; i < 1000000; i++) {
        hyi_sum3_add(&sum, terms);
        naive += terms[0];
    }
    double value[3];
    hyi_sum3_value(&sum, value);
    assert_true(fabs((double)naive - 1e5) > 100.0);
    assert_true(value[2] == 1e6 * (double)terms[2]);
    assert_true(fabs(value[0] - 1e6 * (double)terms[0]) <= 1e6 * 1e12 * ldexp(1.0, -32)); /* one top for all three: see film.h */
    hyi_sum alone;
    memset(&alone, 0, sizeof alone);
    for (int i = 0; i < 1000000; i++) hyi_sum_add(&alone, (double)terms[0]);
    assert_true(fabs(hyi_sum_value(&alone) / (1e6 * (double)terms[0]) - 1.0) < 1e-9);
}

static void test_special_terms(void **state) {
    (void)state;
    const double terms[] = { 4.9406564584124654e-324, 2.2250738585072014e-308, 1.0, DBL_MAX, -1.0, -3.5e-310 };
    for (size_t i = 0; i < sizeof terms / sizeof terms[0]; i++) {
        hyi_sum sum;
        memset(&sum, 0, sizeof sum);
        hyi_sum_add(&sum, terms[i]);
        assert_true(fabs(hyi_sum_value(&sum) - terms[i]) <= fabs(terms[i]) * ldexp(1.0, -32));
        hyi_sum_add(&sum, 0.0);
        assert_true(fabs(hyi_sum_value(&sum) - terms[i]) <= fabs(terms[i]) * ldexp(1.0, -32));
    }
}

/* Stages grow by a third, never stand still, and every pixel of the frame has one place in the film. */
static void test_stages_and_places(void **state) {
    (void)state;
    assert_int_equal(hyi_stage_chunks(0), 1);
    for (uint32_t stage = 1; stage < 40; stage++) {
        assert_true(hyi_stage_chunks(stage) > hyi_stage_chunks(stage - 1));
        assert_true(hyi_stage_chunks(stage) <= 2 * hyi_stage_chunks(stage - 1));
    }
    const uint32_t frames[][3] = { { 16, 37, 21 }, { 8, 37, 21 }, { 16, 1000, 1 }, { 16, 3, 500 }, { 8, 1, 1 }, { 16, 4, 4 } };
    for (size_t f = 0; f < sizeof frames / sizeof frames[0]; f++) {
        const uint32_t whole[4] = { 0, 0, 0, 0 };
        hyi_film film;
        hyi_plan_film(&film, frames[f][0], frames[f][1], frames[f][2], whole);
        assert_true(film.tile_pixels <= frames[f][0] * frames[f][0]);
        size_t count = hyi_film_pixel_count(&film);
        uint8_t *seen = (uint8_t *)calloc(count, 1);
        for (uint32_t y = 0; y < frames[f][2]; y++)
            for (uint32_t x = 0; x < frames[f][1]; x++) {
                size_t at = hyi_pixel_index(&film, x, y);
                assert_true(at < count && !seen[at]);
                seen[at] = 1;
            }
        free(seen);
    }
}

int hydra_test_sums(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order_does_not_matter), cmocka_unit_test(test_precision),        cmocka_unit_test(test_a_million_terms),
        cmocka_unit_test(test_special_terms),         cmocka_unit_test(test_stages_and_places),
    };
    return cmocka_run_group_tests_name("sums", tests, NULL, NULL);
}
