/* Ending a render: by time, by another thread, by its samples; and the self-test. No assertion on speed. */
#include "truth_helpers.h"

#include <pthread.h>
#include <time.h>

int hydra_test_control(void);

/* A closed grey box that glows: every path goes on until Russian roulette ends it. */
static void open_furnace(truth_world *world) {
    truth_open(world);
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    for (int i = 0; i < 3; i++) desc.base_color[i] = desc.emission[i] = 0.5f;
    desc.emit_both_sides = true;
    const float low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    ht_mesh box = ht_box(low, high);
    hydra_mesh_desc mesh = ht_mesh_desc(&box, hydra_scene_add_material(world->scene, &desc));
    hydra_scene_add_mesh(world->scene, &mesh);
    ht_mesh_free(&box);
    truth_commit(world);
}

static hydra_render_desc small_frame(void) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.width = desc.height = 32;
    return desc;
}

/* A time budget ends the render, with samples in every pixel that was reached and a status that says so. Catches: budgets
   that are looked at only between rounds, and a fraction that does not reach 1. */
static void test_time_budget(void **state) {
    (void)state;
    truth_world world;
    open_furnace(&world);
    hydra_render_desc desc = small_frame();
    desc.time_budget = 0.2;
    desc.step_seconds = 0.02;
    hydra_render *render = hydra_render_create(world.scene, &desc);
    assert_non_null(render);
    double before = 0;
    while (hydra_render_step(render) == HYDRA_MORE) { /* never, where other work holds the first step up for so long */
        hydra_status status = hydra_render_status(render);
        assert_true(status.fraction >= before && status.fraction <= 1);
        assert_true(status.stage != HYDRA_STAGE_DONE);
        before = status.fraction;
    }
    hydra_status status = hydra_render_status(render);
    assert_int_equal(status.stage, HYDRA_STAGE_DONE);
    assert_true(status.fraction == 1 && status.seconds_left == 0 && status.seconds >= 0.2 && status.samples > 0);
    assert_int_equal(hydra_render_step(render), HYDRA_OK); /* done stays done */
    assert_true(hydra_render_status(render).samples == status.samples);
    hydra_render_destroy(render);
    truth_close(&world);
}

static void *stop_soon(void *render) {
    struct timespec wait = {0, 20 * 1000 * 1000};
    nanosleep(&wait, NULL);
    hydra_render_cancel((hydra_render *)render);
    return NULL;
}

/* Cancelling from another thread ends a step that would take minutes; what is there can be read, and the render goes on
   to the very bits that an undisturbed one ends with. */
static void test_cancel_from_another_thread(void **state) {
    (void)state;
    truth_world world;
    open_furnace(&world);
    hydra_render_desc desc = small_frame();
    desc.max_samples = 4096;
    desc.step_seconds = 600;
    hydra_render *render = hydra_render_create(world.scene, &desc);
    assert_non_null(render);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, stop_soon, render), 0);
    assert_int_equal(hydra_render_step(render), HYDRA_CANCELLED);
    pthread_join(thread, NULL);
    hydra_status status = hydra_render_status(render);
    assert_true(status.samples < 4096 && status.stage != HYDRA_STAGE_DONE);
#ifndef HT_VULKAN /* a device gives up what is on its way: vk_slices waits for samples before it cancels */
    assert_true(status.samples > 0);
#endif
    float pixels[3 * 32 * 32];
    assert_int_equal(hydra_render_read(render, HYDRA_RADIANCE, pixels, 0), HYDRA_OK);
    hydra_render_destroy(render);

    desc.max_samples = 64;
    float whole[3 * 32 * 32];
    for (int stopped = 0; stopped < 2; stopped++) {
        render = hydra_render_create(world.scene, &desc);
        if (stopped) {
            hydra_render_cancel(render);
            assert_int_equal(hydra_render_step(render), HYDRA_CANCELLED);
        }
        assert_int_equal(hydra_render_step(render), HYDRA_OK);
        hydra_render_read(render, HYDRA_RADIANCE, stopped ? pixels : whole, 0);
        hydra_render_destroy(render);
    }
    assert_memory_equal(pixels, whole, sizeof whole);
    truth_close(&world);
}

/* On this machine, with one thread and with several: the library finds nothing wrong with itself, and leaves nothing. */
static void test_selftest(void **state) {
    (void)state;
    for (uint32_t threads = 1; threads <= 3; threads += 2) {
        hydra_context_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.threads = threads;
        hydra_context *context = hydra_create(&desc);
        assert_non_null(context);
#ifdef HT_VULKAN /* kernels stay with the context: the first run makes them */
        assert_int_equal(hydra_selftest(context), HYDRA_OK);
#endif
        size_t before = hydra_memory(context).bytes_now;
        if (hydra_selftest(context) != HYDRA_OK) fail_msg("%s", hydra_error_text(context));
        assert_int_equal(hydra_memory(context).bytes_now, before);
        assert_int_equal(hydra_destroy(context), HYDRA_OK);
    }
    assert_int_equal(hydra_selftest(NULL), HYDRA_ERROR_NULL);
}

static void *no_memory(void *user, size_t size) {
    (void)user;
    (void)size;
    fail_msg("half an allocator was called");
    return NULL;
}

/* Half an allocator is refused, not quietly replaced by another. */
static void test_half_an_allocator(void **state) {
    (void)state;
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.allocator.alloc = no_memory;
    assert_null(hydra_create(&desc));
}

int hydra_test_control(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_time_budget),
        cmocka_unit_test(test_cancel_from_another_thread),
        cmocka_unit_test(test_selftest),
        cmocka_unit_test(test_half_an_allocator),
    };
    return cmocka_run_group_tests_name("control", tests, NULL, NULL);
}
