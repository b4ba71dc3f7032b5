/* How work is cut into submissions, and that the cuts do not matter: slices, steps, threads, cancelling, films, and
   devices whose memory the host does not see. And that the validation layer would tell of a missing barrier. */
#include "vk_helpers.h"

#include <pthread.h>
#include <time.h>

int hydra_test_vk_slices(void);

enum { side = 48, pixels = side * side, ray_count = 300 };

static hydra_scene *make_scene(hydra_context *context) {
    ht_rng rng = ht_rng_make(5);
    ht_mesh soup = ht_soup(&rng, 60, 1, 0.5f);
    hydra_light_desc light = {.kind = HYDRA_LIGHT_RECT, .color = {9, 8, 7}, .position = {0, 3, 0}, .axis_u = {1, 0, 0}, .axis_v = {0, 0, 1}};
    hydra_mesh_desc mesh = ht_mesh_desc(&soup, (hydra_material){0});
    hydra_scene *scene = hydra_scene_create(context);
    assert_non_null(scene);
    assert_true(hydra_scene_add_mesh(scene, &mesh).id && hydra_scene_add_light(scene, &light).id);
    ht_mesh_free(&soup);
    ht_ok(context, hydra_scene_commit(scene));
    return scene;
}

static hydra_render_desc view(void) {
    hydra_render_desc desc = {.width = side, .height = side, .max_samples = 32, .sensor = {.position = {0, 0.5f, 4}}, .step_seconds = 60};
    return desc;
}

static hydra_render *make_render(hydra_scene *scene, const hydra_render_desc *desc) {
    hydra_render *render = hydra_render_create(scene, desc);
    assert_non_null(render);
    return render;
}

/* The picture with the library's defaults, and its film; plain, and to a target error. */
typedef struct outcome {
    float radiance[3 * pixels], error[3 * pixels];
    uint32_t samples[pixels];
} outcome;

static void read_outcome(hydra_render *render, outcome *o) {
    assert_int_equal(hydra_render_read(render, HYDRA_RADIANCE, o->radiance, 0), HYDRA_OK);
    assert_int_equal(hydra_render_read(render, HYDRA_ERROR, o->error, 0), HYDRA_OK);
    assert_int_equal(hydra_render_read(render, HYDRA_SAMPLES, o->samples, 0), HYDRA_OK);
}

static outcome plain, judged, seen;

static hydra_render_desc judged_view(void) {
    hydra_render_desc desc = view();
    desc.target_error = 0.25f;
    desc.max_samples = 128;
    return desc;
}

static void run(hydra_scene *scene, const hydra_render_desc *desc, outcome *o) {
    hydra_render *render = make_render(scene, desc);
    assert_int_equal(ht_finish(render), HYDRA_OK);
    read_outcome(render, o);
    hydra_render_destroy(render);
}

static void make_outcomes(void) {
    static bool made;
    vkt_host h;
    if (made) return;
    made = true;
    hydra_render_desc desc = view(), other = judged_view();
    hydra_scene *scene = make_scene(vkt_open(&h, NULL, 1));
    run(scene, &desc, &plain);
    run(scene, &other, &judged);
    uint32_t least = judged.samples[0], most = least;
    for (int i = 0; i < pixels; i++) {
        if (judged.samples[i] < least) least = judged.samples[i];
        if (judged.samples[i] > most) most = judged.samples[i];
    }
    assert_true(least < most); /* tiles end at different times */
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

static void expect_outcome(hydra_scene *scene, hydra_render_desc desc, const outcome *o) {
    run(scene, &desc, &seen);
    assert_memory_equal(&seen, o, sizeof seen);
}

/* ---- slices */

/* The shorter a slice may be, the more submissions there are; each is then as short as one unit of work allows. Pictures are
   the same to the bit, with one thread and with three, twice over, and to a target error. */
static void test_slices(void **state) {
    (void)state;
    const double slices[3] = {1e-7, 0.001, 60};
    uint64_t submissions[3];
    double mean[3];
    make_outcomes();
    for (int i = 0; i < 3; i++) {
        vkt_host h;
        hydra_vk_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.slice_seconds = slices[i];
        hydra_scene *scene = make_scene(vkt_open(&h, &desc, i == 1 ? 3 : 1));
        uint64_t before = vkt_info(h.host.context).submissions;
        expect_outcome(scene, view(), &plain);
        hydra_vk_info info = vkt_info(h.host.context);
        submissions[i] = info.submissions - before;
        mean[i] = info.slice_mean;
        if (i) expect_outcome(scene, judged_view(), &judged);
        if (i == 1) expect_outcome(scene, view(), &plain);
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
    assert_true(submissions[0] > 4 * submissions[2] && submissions[1] >= submissions[2]);
    assert_true(mean[0] < mean[2]);
}

/* Steps of any length, down to none at all: progress in each, and the same bits. */
static void test_steps(void **state) {
    (void)state;
    vkt_host h;
    const double lengths[3] = {1e-9, 0.004, 60};
    uint32_t steps[3] = {0, 0, 0};
    make_outcomes();
    hydra_scene *scene = make_scene(vkt_open(&h, NULL, 2));
    for (int i = 0; i < 3; i++) {
        hydra_render_desc desc = view();
        desc.step_seconds = lengths[i];
        hydra_render *render = make_render(scene, &desc);
        double before = -1;
        hydra_result result;
        do {
            result = hydra_render_step(render);
            steps[i]++;
            double samples = hydra_render_status(render).samples;
            assert_true(samples > before || result == HYDRA_OK);
            before = samples;
        } while (result == HYDRA_MORE);
        assert_int_equal(result, HYDRA_OK);
        read_outcome(render, &seen);
        assert_memory_equal(&seen, &plain, sizeof seen);
        hydra_status status = hydra_render_status(render);
        assert_true(status.paths == 32 * pixels && status.rays_camera == 32 * pixels && status.rays_shadow > 0 && status.rays_bounce > 0);
        hydra_render_destroy(render);
    }
    assert_true(steps[0] > steps[2]);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* ---- cancelling */

typedef struct canceller {
    hydra_render *render;
    uint64_t submissions; /* when it was told */
} canceller;

static void *cancel_soon(void *argument) {
    canceller *c = (canceller *)argument;
    const struct timespec wait = {0, 1000 * 1000};
    for (int i = 0; i < 20000 && __atomic_load_n(&vkt_spied.submissions, __ATOMIC_RELAXED) < 12; i++) nanosleep(&wait, NULL);
    hydra_render_cancel(c->render);
    c->submissions = __atomic_load_n(&vkt_spied.submissions, __ATOMIC_RELAXED);
    return NULL;
}

/* From another thread, in the middle of a picture that would take hours: no more is submitted than what two slices hold,
   and the picture can be read. Cancelled over and over, it ends with the bits of one that was left alone. */
static void test_cancel(void **state) {
    (void)state;
    vkt_host h;
    pthread_t thread;
    make_outcomes();
    vkt_spy_begin();
    hydra_vk_desc vk = vkt_spy_desc();
    vk.slice_seconds = 0.002;
    hydra_scene *scene = make_scene(vkt_open(&h, &vk, 1));
    hydra_render_desc desc = view();
    desc.max_samples = 1u << 24;
    desc.step_seconds = 3600;
    canceller c = {make_render(scene, &desc), 0};
    vkt_spied.submissions = 0;
    assert_int_equal(pthread_create(&thread, NULL, cancel_soon, &c), 0);
    assert_int_equal(hydra_render_step(c.render), HYDRA_CANCELLED);
    pthread_join(thread, NULL);
    assert_true(vkt_spied.submissions - c.submissions <= 4);
    hydra_status status = hydra_render_status(c.render);
    assert_true(status.samples < 1e6 && status.stage != HYDRA_STAGE_DONE);
    read_outcome(c.render, &seen);
    hydra_render_destroy(c.render);

    static outcome alone;
    desc = view();
    desc.max_samples = 128;
    run(scene, &desc, &alone);
    desc.step_seconds = 0.002;
    hydra_render *render = make_render(scene, &desc);
    hydra_result result;
    uint32_t cancelled = 0, step = 0;
    do {
        if (step++ % 3) hydra_render_cancel(render);
        result = hydra_render_step(render);
        cancelled += result == HYDRA_CANCELLED;
    } while (result == HYDRA_MORE || result == HYDRA_CANCELLED);
    assert_int_equal(result, HYDRA_OK);
    assert_true(cancelled > 5);
    read_outcome(render, &seen);
    assert_memory_equal(&seen, &alone, sizeof seen);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* ---- films */

static void merge_film(hydra_context *context, hydra_render *to, hydra_render *from) {
    size_t size;
    ht_ok(context, hydra_render_save(from, NULL, &size));
    void *film = malloc(size);
    ht_ok(context, hydra_render_save(from, film, &size));
    ht_ok(context, hydra_render_merge(to, film, size));
    free(film);
}

/* Halves of the samples, halves of the picture, and a picture that is saved half-way and resumed. */
static void test_films(void **state) {
    (void)state;
    vkt_host h;
    make_outcomes();
    hydra_context *context = vkt_open(&h, NULL, 1);
    hydra_scene *scene = make_scene(context);
    for (int way = 0; way < 3; way++) {
        const uint32_t left[4] = {0, 0, 16, side}, right[4] = {16, 0, side - 16, side};
        hydra_render_desc all = view(), first = view(), second = view();
        if (way == 0) first.max_samples = 12, second.first_sample = 12;
        if (way == 1) memcpy(first.region, left, sizeof left), memcpy(second.region, right, sizeof right);
        if (way == 2) first.step_seconds = 1e-9;
        hydra_render *a = make_render(scene, &first), *b = way == 2 ? NULL : make_render(scene, &second), *whole = way ? make_render(scene, &all) : a;
        for (int i = 0; way == 2 && i < 3; i++) assert_int_equal(hydra_render_step(a), HYDRA_MORE);
        if (b) ht_ok(context, ht_finish(a));
        if (whole != a) merge_film(context, whole, a);
        if (b) ht_ok(context, ht_finish(b));
        if (b) merge_film(context, whole, b);
        if (whole != a) ht_ok(context, ht_finish(whole));
        read_outcome(whole, &seen);
        assert_memory_equal(&seen, &plain, sizeof seen);
        if (whole != a) hydra_render_destroy(whole);
        hydra_render_destroy(b);
        hydra_render_destroy(a);
    }
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* ---- other devices, pretended */

static void cast(const hydra_scene *scene, hydra_hit hits[ray_count], uint8_t occluded[ray_count]) {
    ht_rng rng = ht_rng_make(7);
    hydra_ray rays[ray_count];
    memset(rays, 0, sizeof rays);
    for (int i = 0; i < ray_count; i++) {
        ht_direction(&rng, rays[i].direction);
        rays[i].t_max = INFINITY;
    }
    assert_int_equal(hydra_scene_closest_hits(scene, rays, hits, ray_count), HYDRA_OK);
    assert_int_equal(hydra_scene_any_hits(scene, rays, occluded, ray_count), HYDRA_OK);
}

/* A discrete device, whose memory the host does not see, without timestamps; and a processor that binds few texels: what goes
   up, down and through other kernels is the same. */
static void test_pretended_devices(void **state) {
    (void)state;
    static const vkt_pretence as[2] = {{.type = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, .staged = true, .no_times = true}, {.texels_most = 8}};
    hydra_hit hits[3][ray_count];
    uint8_t occluded[3][ray_count];
    vkt_host h;
    make_outcomes();
    hydra_scene *scene = make_scene(vkt_open(&h, NULL, 1));
    cast(scene, hits[2], occluded[2]);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
    for (int i = 0; i < 2; i++) {
        vkt_spy_begin();
        vkt_spied.pretended = 1;
        vkt_spied.pretences[0] = as[i];
        hydra_vk_desc desc = vkt_spy_desc();
        scene = make_scene(vkt_open(&h, &desc, 1));
        assert_true(i == 1 || vkt_spied.staging_copies > 10);
        cast(scene, hits[i], occluded[i]);
        assert_memory_equal(hits[i], hits[2], sizeof hits[i]);
        assert_memory_equal(occluded[i], occluded[2], sizeof occluded[i]);
        expect_outcome(scene, view(), &plain);
        assert_true(vkt_spied.allocations < 12); /* few large blocks */
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
}

/* ---- hazards */

/* Two fills of one buffer: without a barrier between them the layer speaks up, with one it is silent. */
static void fill_twice(vkt_own *own, bool with_barrier) {
    VkCommandPool pool;
    VkCommandBuffer c;
    vkt_buffer buffer = vkt_make_buffer(own, 256);
    VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    assert_int_equal(own->CreateCommandPool(own->device, &pool_info, NULL, &pool), VK_SUCCESS);
    VkCommandBufferAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = pool, .commandBufferCount = 1};
    assert_int_equal(own->AllocateCommandBuffers(own->device, &info, &c), VK_SUCCESS);
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT, .dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT};
    assert_int_equal(own->BeginCommandBuffer(c, &begin), VK_SUCCESS);
    own->CmdFillBuffer(c, buffer.buffer, 0, VK_WHOLE_SIZE, 1);
    if (with_barrier) own->CmdPipelineBarrier(c, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 1, &barrier, 0, NULL, 0, NULL);
    own->CmdFillBuffer(c, buffer.buffer, 0, VK_WHOLE_SIZE, 2);
    assert_int_equal(own->EndCommandBuffer(c), VK_SUCCESS);
    VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &c};
    assert_int_equal(own->QueueSubmit(own->queue, 1, &submit, VK_NULL_HANDLE), VK_SUCCESS);
    assert_int_equal(own->QueueWaitIdle(own->queue), VK_SUCCESS);
    own->DestroyCommandPool(own->device, pool, NULL);
    vkt_free_buffer(own, &buffer);
}

static void test_planted_hazard(void **state) {
    (void)state;
    vkt_own own;
    vkt_own_open(&own, NULL);
    fill_twice(&own, true);
    assert_int_equal(own.said, 0);
    fill_twice(&own, false);
    assert_true(own.said > 0);
    assert_non_null(strstr(own.last_said, "SYNC-HAZARD-WRITE-AFTER-WRITE"));
    own.said = 0;
    vkt_own_close(&own);
}

/* The library's own barriers, one left out at a time: the layer misses most of them. Not those that only the host waits
   for, nor those behind passes of shadows, with whose neighbours it sees nothing shared. */
static void test_dropped_barriers(void **state) {
    (void)state;
    vkt_host h;
    vkt_spy_begin();
    hydra_vk_desc vk = vkt_spy_desc();
    vk.slice_seconds = 1e-7;
    hydra_scene *scene = make_scene(vkt_open(&h, &vk, 1));
    hydra_render_desc desc = view();
    desc.width = desc.height = 16;
    desc.max_samples = 2;
    desc.max_depth = 1;
    hydra_render *render = make_render(scene, &desc);
    vkt_spied.barriers = 0;
    ht_ok(h.host.context, ht_finish(render));
    uint64_t all = vkt_spied.barriers, missed = 0;
    hydra_render_destroy(render);
    assert_int_equal(h.said, 0);
    for (uint64_t i = 1; i <= all; i++) {
        render = make_render(scene, &desc);
        vkt_spied.barriers = 0;
        vkt_spied.barrier_dropped = i;
        ht_ok(h.host.context, ht_finish(render));
        vkt_spied.barrier_dropped = 0;
        hydra_render_destroy(render);
        missed += h.said > 0;
        if (h.said) assert_non_null(strstr(h.last_said, "SYNC-HAZARD"));
        h.said = 0;
    }
    assert_true(all >= 6 && missed >= all / 2);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

int hydra_test_vk_slices(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slices),
        cmocka_unit_test(test_steps),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_films),
        cmocka_unit_test(test_pretended_devices),
        cmocka_unit_test(test_planted_hazard),
        cmocka_unit_test(test_dropped_barriers),
    };
    return cmocka_run_group_tests_name("vk_slices", tests, NULL, NULL);
}
