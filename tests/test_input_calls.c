/* Bad renders, sensors, lists and rays, calls in the wrong order, NULL, foreign handles, and how errors are reported. */
#include "input_helpers.h"

int hydra_test_input_calls(void);

static const float nan_value = NAN, infinite = INFINITY;

/* ---------------------------------------------------------------- renders */

static hydra_render_desc good_render(void) {
    hydra_render_desc d;
    memset(&d, 0, sizeof d);
    d.width = d.height = 4;
    d.max_samples = 2;
    return d;
}

/* The result is read from the message: hydra_render_create returns NULL. */
static void expect_render(truth_world *world, const char *what, const hydra_render_desc *d, hydra_result wanted) {
    hydra_render *render = hydra_render_create(world->scene, d);
    if (render) fail_msg("%s: was accepted", what);
    const char *text = hydra_error_text(world->context);
    if (strncmp(text, hydra_result_text(wanted), strlen(hydra_result_text(wanted))) != 0)
        fail_msg("%s: \"%s\", wanted \"%s\"", what, text, hydra_result_text(wanted));
    hydra_estimate_result estimate; /* does not read lists, so it may not know what is in them */
    hydra_result result = hydra_estimate(world->scene, d, &estimate);
    if (result != HYDRA_OK || d->sensor.kind < HYDRA_SENSOR_POINTS) TRUTH_RESULT(world->context, result, wanted);
    expect_usable(world);
}

#define BAD_RENDER(set, wanted)                  \
    do {                                         \
        hydra_render_desc d = good_render();     \
        d.set;                                   \
        expect_render(&world, #set, &d, wanted); \
    } while (0)

static void test_renders(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    BAD_RENDER(width = 0, HYDRA_ERROR_SIZE);
    BAD_RENDER(height = 0, HYDRA_ERROR_SIZE);
    BAD_RENDER(region[2] = 5, HYDRA_ERROR_SIZE);
    BAD_RENDER(region[0] = 1, HYDRA_ERROR_SIZE); /* a corner without a size */
    BAD_RENDER(outputs = 1u << HYDRA_OUTPUT_COUNT, HYDRA_ERROR_ENUM);
    BAD_RENDER(target_error = -0.1f, HYDRA_ERROR_BUDGET);
    BAD_RENDER(target_error = nan_value, HYDRA_ERROR_BUDGET);
    BAD_RENDER(time_budget = -1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(time_budget = (double)nan_value, HYDRA_ERROR_BUDGET);
    BAD_RENDER(step_seconds = -1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(max_samples = 3, HYDRA_ERROR_BUDGET);
    BAD_RENDER(first_sample = 2, HYDRA_ERROR_BUDGET); /* nothing is left up to max_samples */
    BAD_RENDER(first_sample = 1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(strategy = (hydra_strategy)5, HYDRA_ERROR_ENUM);
    BAD_RENDER(tile_size = 12, HYDRA_ERROR_SIZE);
    BAD_RENDER(sensor.kind = (hydra_sensor_kind)17, HYDRA_ERROR_ENUM);
    BAD_RENDER(sensor.filter = (hydra_filter)17, HYDRA_ERROR_ENUM);
    BAD_RENDER(sensor.fov_y = 1e-6f, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = 3.141592f, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = -1, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.position[2] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.target[2] = infinite, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.up[1] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.shift[1] = infinite, HYDRA_ERROR_NOT_FINITE);
    hydra_render_desc d = good_render();
    d.first_sample = 2;
    d.max_samples = 4;
    d.target_error = 0.1f;
    expect_render(&world, "a share with a target", &d, HYDRA_ERROR_BUDGET);
    d = good_render();
    d.sensor.kind = HYDRA_SENSOR_THIN_LENS;
    d.sensor.lens_radius = -1;
    expect_render(&world, "lens radius", &d, HYDRA_ERROR_SENSOR);
    d.sensor.lens_radius = 0.1f;
    d.sensor.focus_distance = -1;
    expect_render(&world, "focus distance", &d, HYDRA_ERROR_SENSOR);
    d = good_render();
    d.sensor.kind = HYDRA_SENSOR_ORTHOGRAPHIC;
    d.sensor.ortho_height = -1;
    expect_render(&world, "ortho height", &d, HYDRA_ERROR_SENSOR);
    truth_close(&world);
}

/* Catches: width x height x bytes wrapping round, on any route; tested under a cap, so that nothing large is ever
   allocated. */
static void test_huge_images(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{65536, 65536}, {0xffffffffu, 0xffffffffu}, {0xffffffffu, 2}, {0x80000001u, 0x80000001u}};
    hydra_context_desc context;
    truth_world world;
    memset(&context, 0, sizeof context);
    context.memory_cap = 256u << 20;
    truth_open_with(&world, &context);
    truth_commit(&world);
    for (int i = 0; i < 4; i++) {
        hydra_render_desc d = good_render();
        d.width = sizes[i][0];
        d.height = sizes[i][1];
        d.outputs = (1u << HYDRA_OUTPUT_COUNT) - 1;
        assert_null(hydra_render_create(world.scene, &d));
        const char *text = hydra_error_text(world.context);
        assert_true(strstr(text, hydra_result_text(HYDRA_ERROR_OVERFLOW)) || strstr(text, hydra_result_text(HYDRA_ERROR_MEMORY_CAP)) ||
                    strstr(text, hydra_result_text(HYDRA_ERROR_SIZE)));
        hydra_estimate_result e;
        hydra_result result = hydra_estimate(world.scene, &d, &e);
        if (result == HYDRA_OK) assert_true((double)e.bytes_film >= 12.0 * sizes[i][0] * sizes[i][1]);
        else assert_true(result == HYDRA_ERROR_OVERFLOW || result == HYDRA_ERROR_SIZE);
        d.region[2] = d.region[3] = 8; /* a small part of a huge frame is fine */
        hydra_render *part = i == 0 ? truth_render(world.scene, &d) : NULL;
        hydra_render_destroy(part);
    }
    truth_close(&world);
}

/* Catches: point and ray lists of the wrong length, with bad numbers, or missing. */
static void test_lists(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    float p[12] = {0}, n[12];
    for (int i = 0; i < 12; i++) n[i] = 1;
    hydra_render_desc good = good_render(), d;
    good.width = good.height = 2;
    good.sensor = truth_sensor_points(p, n, 4);
    d = good;
    d.sensor.point_positions.count = 3;
    expect_render(&world, "three positions for four pixels", &d, HYDRA_ERROR_COUNT);
    d = good;
    d.sensor.point_normals.count = 5;
    expect_render(&world, "five normals", &d, HYDRA_ERROR_COUNT);
    d = good;
    d.sensor.point_normals.data = NULL;
    expect_render(&world, "no normals", &d, HYDRA_ERROR_NULL);
    d = good;
    d.sensor.point_positions.stride = 10;
    expect_render(&world, "stride", &d, HYDRA_ERROR_STRIDE);
    d = good;
    d.sensor.lightmap = (hydra_lightmap)9;
    expect_render(&world, "lightmap", &d, HYDRA_ERROR_ENUM);
    p[4] = nan_value;
    expect_render(&world, "NaN position", &good, HYDRA_ERROR_NOT_FINITE);
    p[4] = 0;
    n[3] = n[4] = n[5] = 0;
    expect_render(&world, "normal without direction", &good, HYDRA_ERROR_SENSOR);
    hydra_ray rays[4];
    memset(rays, 0, sizeof rays);
    for (int i = 0; i < 4; i++) {
        rays[i].direction[0] = 1;
        rays[i].t_max = infinite;
    }
    memset(&good.sensor, 0, sizeof good.sensor);
    good.sensor.kind = HYDRA_SENSOR_RAYS;
    good.sensor.rays.data = rays;
    good.sensor.rays.count = 4;
    d = good;
    d.sensor.rays.count = 2;
    expect_render(&world, "two rays for four pixels", &d, HYDRA_ERROR_COUNT);
    rays[3].direction[0] = 0;
    expect_render(&world, "ray without direction", &good, HYDRA_ERROR_RAY);
    rays[3].direction[0] = nan_value;
    expect_render(&world, "ray with NaN", &good, HYDRA_ERROR_RAY);
    rays[3].direction[0] = 1;
    rays[3].t_min = 2;
    rays[3].t_max = 1;
    expect_render(&world, "ray that ends before it begins", &good, HYDRA_ERROR_RAY);
    truth_close(&world);
}

/* ---------------------------------------------------------------- order of calls */

/* Catches: use after destroy, destroy under living children, edits under living renders. */
static void test_order(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    hydra_render_desc d = good_render();
    hydra_scene_info info;
    hydra_mesh extra = hydra_scene_add_mesh(world.scene, &m.desc);
    expect_render(&world, "create before commit", &d, HYDRA_ERROR_NOT_COMMITTED); /* and commits */
    hydra_render *render = hydra_render_create(world.scene, &d);
    assert_non_null(render);
    TRUTH_RESULT(world.context, hydra_scene_destroy(world.scene), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_destroy(world.context), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(world.scene, extra, &m.desc), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, NULL), HYDRA_ERROR_BUSY);
    assert_int_equal(hydra_scene_add_mesh(world.scene, &m.desc).id, 0);
    truth_run(render);
    hydra_render_destroy(render);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_ERROR_HANDLE);
    hydra_ray ray = {{0, 0, 0}, 0, {0, 0, -1}, INFINITY};
    hydra_hit hit;
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_ERROR_NOT_COMMITTED);
    (void)hydra_scene_commit(world.scene); /* the add while busy may be reported here */
    expect_usable(&world);
    TRUTH_RESULT(world.context, hydra_scene_get_info(world.scene, &info), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_get_info(world.scene, NULL), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_destroy(world.context), HYDRA_ERROR_BUSY); /* the scene lives */
    truth_close(&world);
}

/* Catches: a reused slot that answers to an old handle, or another scene's handles taken without a word. */
static void test_foreign_handles(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    hydra_mesh old = hydra_scene_add_mesh(world.scene, &m.desc);
    assert_int_equal(hydra_scene_remove_mesh(world.scene, old), HYDRA_OK);
    hydra_mesh fresh = hydra_scene_add_mesh(world.scene, &m.desc);
    assert_int_not_equal(fresh.id, old.id);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(world.scene, old, &m.desc), HYDRA_ERROR_HANDLE);
    hydra_scene *other = hydra_scene_create(world.context);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(other, fresh, &m.desc), HYDRA_ERROR_HANDLE);
    m.desc.material = truth_lambert(world.scene, 0.3);
    assert_int_equal(hydra_scene_add_mesh(other, &m.desc).id, 0);
    TRUTH_RESULT(world.context, hydra_scene_commit(other), HYDRA_ERROR_HANDLE);
    TRUTH_RESULT(world.context, hydra_scene_destroy(other), HYDRA_OK);
    truth_close(&world);
}

/* Catches: NULL that crashes, and NULL that must be ignored. */
static void test_null(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    assert_int_equal(hydra_destroy(NULL), HYDRA_OK);
    assert_int_equal(hydra_scene_destroy(NULL), HYDRA_OK);
    hydra_render_destroy(NULL);
    hydra_render_cancel(NULL);
    assert_non_null(hydra_error_text(NULL));
    assert_null(hydra_scene_create(NULL));
    assert_int_equal(hydra_scene_commit(NULL), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_render_step(NULL), HYDRA_ERROR_NULL);
    assert_null(hydra_render_create(NULL, NULL));
    assert_null(hydra_render_create(world.scene, NULL));
    assert_int_equal(hydra_scene_requirements(NULL), 0);
    assert_int_equal(hydra_scene_add_mesh(NULL, NULL).id, 0);
    assert_int_equal(hydra_scene_add_material(NULL, NULL).id, 0);
    assert_int_equal(hydra_scene_add_light(NULL, NULL).id, 0);
    expect_reported(&world, "NULL mesh", hydra_scene_add_mesh(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL material", hydra_scene_add_material(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL texture", hydra_scene_add_texture(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL light", hydra_scene_add_light(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL instance", hydra_scene_add_instance(world.scene, NULL).id, HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, NULL, NULL, 1), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_any_hits(world.scene, NULL, NULL, 1), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, NULL, NULL, 0), HYDRA_OK);
    truth_close(&world);
}

/* Catches: one bad ray that spoils its neighbours; NaN in hits. */
static void test_bad_rays(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    hydra_ray rays[9];
    hydra_hit hits[9];
    uint8_t blocked[9];
    for (int i = 0; i < 9; i++) {
        hydra_ray good = {{0.1f, 0.1f, 0}, 0, {0, 0, -1}, INFINITY};
        rays[i] = good;
    }
    rays[1].origin[0] = nan_value;
    rays[2].direction[1] = infinite;
    rays[3].direction[2] = 0;
    rays[5].t_min = 3;
    rays[5].t_max = 2;
    rays[6].t_max = nan_value;
    rays[7].t_max = 1.999f;
    memset(hits, 0xff, sizeof hits);
    memset(blocked, 0xff, sizeof blocked);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, rays, hits, 9), HYDRA_ERROR_RAY);
    TRUTH_RESULT(world.context, hydra_scene_any_hits(world.scene, rays, blocked, 9), HYDRA_ERROR_RAY);
    for (int i = 0; i < 9; i++) {
        bool good = i == 0 || i == 4 || i == 8;
        assert_int_equal(blocked[i], good);
        if (good) assert_true(hits[i].t == 2);
        else assert_true(hits[i].t < 0 && hits[i].primitive == HYDRA_NONE && hits[i].mesh == 0);
    }
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, rays + 7, hits, 2), HYDRA_OK);
    truth_close(&world);
}

/* ---------------------------------------------------------------- reports and log */

/* Catches: the second error hiding the first; an error reported twice; a log that stays silent. */
static void test_first_error(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    m.desc.indices.stride = 3;
    assert_int_equal(hydra_scene_add_mesh(world.scene, &m.desc).id, 0);
    char first[512];
    snprintf(first, sizeof first, "%s", hydra_error_text(world.context));
    hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, -1);
    assert_int_equal(hydra_scene_add_light(world.scene, &light).id, 0);
    assert_string_not_equal(first, hydra_error_text(world.context));
    uint32_t logged = world.host.errors;
    TRUTH_RESULT(world.context, hydra_scene_commit(world.scene), HYDRA_ERROR_INDEX_SIZE);
    assert_true(strstr(hydra_error_text(world.context), hydra_result_text(HYDRA_ERROR_INDEX_SIZE)) != NULL);
    TRUTH_RESULT(world.context, hydra_scene_commit(world.scene), HYDRA_OK);
    assert_true(logged >= 2 && world.host.errors >= logged);
    assert_non_null(strstr(first, "3")); /* "the last message with the numbers in it" */
    expect_usable(&world);
    truth_close(&world);
}

/* Catches: a code without text, or texts mixed up. */
static void test_result_texts(void **state) {
    (void)state;
    static const char *texts[] = {
#define TEXT(name, text) text,
        HYDRA_RESULTS(TEXT)
#undef TEXT
    };
    for (int r = 0; r < HYDRA_RESULT_COUNT; r++) assert_string_equal(hydra_result_text((hydra_result)r), texts[r]);
    assert_non_null(hydra_result_text(HYDRA_RESULT_COUNT));
    assert_non_null(hydra_result_text((hydra_result)-1));
}

/* Catches: contexts that cannot be had and come anyway. */
static void test_contexts(void **state) {
    (void)state;
    hydra_context_desc d;
    memset(&d, 0, sizeof d);
    hydra_context *both[2];
    both[0] = hydra_create(NULL);
    both[1] = hydra_create(&d);
    for (int i = 0; i < 2; i++) {
        assert_non_null(both[i]);
        assert_string_equal(hydra_error_text(both[i]), "");
        assert_true(hydra_context_threads(both[i]) >= 1);
        assert_true(hydra_context_isa(both[i]) != HYDRA_ISA_AUTO);
    }
    for (int i = 0; i < 2; i++) assert_int_equal(hydra_destroy(both[i]), HYDRA_OK);
    d.isa = (hydra_isa)42;
    assert_null(hydra_create(&d));
    d.isa = HYDRA_ISA_AUTO;
    d.memory_cap = 1;
    assert_null(hydra_create(&d));
}

int hydra_test_input_calls(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_renders),
                                       cmocka_unit_test(test_huge_images),
                                       cmocka_unit_test(test_lists),
                                       cmocka_unit_test(test_order),
                                       cmocka_unit_test(test_foreign_handles),
                                       cmocka_unit_test(test_null),
                                       cmocka_unit_test(test_bad_rays),
                                       cmocka_unit_test(test_first_error),
                                       cmocka_unit_test(test_result_texts),
                                       cmocka_unit_test(test_contexts)};
    return cmocka_run_group_tests_name("input: calls", tests, NULL, NULL);
}
