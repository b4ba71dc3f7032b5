/* The helpers themselves: a wrong p-value or an inside-out sphere would make other tests say nothing. */
#include "hydra_test.h"

static void random_numbers_are_uniform(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(42);
    double counts[16] = {0}, expected[16];
    ht_stats mean = {0, 0, 0};
    for (int i = 0; i < 100000; i++) {
        float u = ht_uniform(&rng);
        assert_true(u >= 0 && u < 1);
        ht_add(&mean, (double)u);
        counts[ht_below(&rng, 16)]++;
    }
    for (int i = 0; i < 16; i++) expected[i] = 100000 / 16.0;
    ht_assert_mean(&mean, 0.5, 0.001);
    assert_true(ht_chi_square_p(counts, expected, 16, 1) > 1e-4);
    counts[3] += 800;
    assert_true(ht_chi_square_p(counts, expected, 16, 0) < 1e-6);
}

static void directions_are_uniform(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(7);
    ht_stats axis[3], square[3];
    memset(axis, 0, sizeof axis);
    memset(square, 0, sizeof square);
    for (int i = 0; i < 50000; i++) {
        float d[3];
        ht_direction(&rng, d);
        for (int k = 0; k < 3; k++) {
            ht_add(&axis[k], (double)d[k]);
            ht_add(&square[k], (double)d[k] * (double)d[k]);
        }
    }
    for (int k = 0; k < 3; k++) {
        ht_assert_mean(&axis[k], 0, 0.003);
        ht_assert_mean(&square[k], 1.0 / 3, 0.002);
    }
}

/* Closed forms: Q(1, x) = e^-x, Q(1/2, x) = erfc(sqrt x), Q(2, x) = (1 + x) e^-x. */
static void gamma_function_matches_closed_forms(void **state) {
    (void)state;
    for (double x = 0.01; x < 60; x *= 1.3) {
        ht_assert_near(ht_gamma_q(1, x) / exp(-x), 1, 1e-10);
        ht_assert_near(ht_gamma_q(0.5, x) / erfc(sqrt(x)), 1, 1e-9);
        ht_assert_near(ht_gamma_q(2, x) / ((1 + x) * exp(-x)), 1, 1e-10);
    }
    ht_assert_near(ht_chi_square_q(18.307038053275146, 10), 0.05, 1e-10); /* the table value for 10 degrees */
    ht_assert_near(ht_normal_q(1.959963984540054), 0.05, 1e-12);
}

static double signed_volume(const ht_mesh *mesh) {
    double sum = 0;
    for (uint32_t i = 0; i < mesh->index_count; i += 3) {
        const float *a = mesh->positions + 3 * (size_t)mesh->indices[i], *b = mesh->positions + 3 * (size_t)mesh->indices[i + 1];
        const float *c = mesh->positions + 3 * (size_t)mesh->indices[i + 2];
        double x = (double)b[1] * (double)c[2] - (double)b[2] * (double)c[1];
        double y = (double)b[2] * (double)c[0] - (double)b[0] * (double)c[2];
        double z = (double)b[0] * (double)c[1] - (double)b[1] * (double)c[0];
        sum += ((double)a[0] * x + (double)a[1] * y + (double)a[2] * z) / 6;
    }
    return sum;
}

/* Every directed edge once, and its reverse once: closed and consistently wound. */
static void assert_closed(const ht_mesh *mesh) {
    for (uint32_t i = 0; i < mesh->index_count; i++) {
        uint32_t a = mesh->indices[i], b = mesh->indices[i - i % 3 + (i + 1) % 3], same = 0, reverse = 0;
        for (uint32_t j = 0; j < mesh->index_count; j++) {
            uint32_t c = mesh->indices[j], d = mesh->indices[j - j % 3 + (j + 1) % 3];
            same += c == a && d == b;
            reverse += c == b && d == a;
        }
        assert_int_equal(same, 1);
        assert_int_equal(reverse, 1);
    }
}

static void solids_are_closed_and_face_outwards(void **state) {
    (void)state;
    const float low[3] = {-1, -2, -3}, high[3] = {1, 2, 3};
    ht_mesh box = ht_box(low, high), ball = ht_icosphere(2, 2), ring = ht_torus(2, 0.5f, 32, 24);
    assert_closed(&box);
    assert_closed(&ball);
    assert_closed(&ring);
    ht_assert_near(signed_volume(&box), 48, 1e-4);
    assert_int_equal(ball.index_count, 3 * 20 * 16);
    ht_assert_near(signed_volume(&ball) / (4.0 / 3 * HT_PI * 8), 0.97, 0.03);
    ht_assert_near(signed_volume(&ring) / (2 * HT_PI * HT_PI * 2 * 0.25), 0.98, 0.02);
    ht_mesh_flip(&box);
    ht_assert_near(signed_volume(&box), -48, 1e-4);
    ht_mesh_free(&box);
    ht_mesh_free(&ball);
    ht_mesh_free(&ring);
}

static void quad_faces_its_cross_product(void **state) {
    (void)state;
    const float centre[3] = {0, 0, 3}, u[3] = {2, 0, 0}, v[3] = {0, 1, 0}; /* normal +z: volume to the origin is positive */
    ht_mesh quad = ht_quad(centre, u, v, 3);
    assert_int_equal(quad.index_count, 3 * 18);
    ht_assert_near(signed_volume(&quad), 8 * 3 / 3.0, 1e-5);
    ht_mesh_free(&quad);
}

static void allocator_sees_wrong_sizes_and_overruns(void **state) {
    (void)state;
    ht_memory memory;
    memset(&memory, 0, sizeof memory);
    hydra_allocator hooks = ht_memory_allocator(&memory);
    char *good = (char *)hooks.alloc(hooks.user, 100), *bad = (char *)hooks.alloc(hooks.user, 100),
         *odd = (char *)hooks.alloc(hooks.user, 7);
    assert_int_equal((uintptr_t)good % 64, 0);
    assert_int_equal(memory.bytes_now, 207);
    memset(good, 0, 100);
    memset(bad, 0, 101);
    hooks.release(hooks.user, good, 100);
    assert_int_equal(memory.damaged, 0);
    hooks.release(hooks.user, bad, 100);
    assert_int_equal(memory.damaged, 1);
    hooks.release(hooks.user, odd, 8);
    assert_int_equal(memory.damaged, 2);
    assert_int_equal(memory.bytes_now, 0);
    assert_int_equal(memory.bytes_peak, 207);
    memory.fail_at = memory.calls + 2;
    void *first = hooks.alloc(hooks.user, 1);
    assert_non_null(first);
    assert_null(hooks.alloc(hooks.user, 1));
    hooks.release(hooks.user, first, 1);
}

int hydra_test_helpers(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_numbers_are_uniform),          cmocka_unit_test(directions_are_uniform),
        cmocka_unit_test(gamma_function_matches_closed_forms), cmocka_unit_test(solids_are_closed_and_face_outwards),
        cmocka_unit_test(quad_faces_its_cross_product),        cmocka_unit_test(allocator_sees_wrong_sizes_and_overruns),
    };
    return cmocka_run_group_tests_name("helpers", tests, NULL, NULL);
}
