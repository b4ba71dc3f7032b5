/* What a device refuses: memory, sizes, any call at all, the device itself. Every failure has its name and its number,
   leaves nothing behind, and the context goes on where that is possible. */
#include "vk_helpers.h"

int hydra_test_vk_limits(void);

enum { side = 16, pixels = side * side, ray_count = 64, samples = 16 };

/* ---- a tiny scene, its rays and its picture */

static void add_soup(hydra_context *context, hydra_scene *scene, uint32_t triangles) {
    ht_rng rng = ht_rng_make(5);
    ht_mesh soup = ht_soup(&rng, triangles, 1, 0.5f);
    hydra_light_desc light = {.kind = HYDRA_LIGHT_RECT, .color = {9, 8, 7}, .position = {0, 3, 0}, .axis_u = {1, 0, 0}, .axis_v = {0, 0, 1}};
    hydra_mesh_desc mesh = ht_mesh_desc(&soup, (hydra_material){0});
    mesh.build = HYDRA_BUILD_FAST;
    hydra_mesh made = hydra_scene_add_mesh(scene, &mesh);
    ht_mesh_free(&soup);
    hydra_light lit = made.id ? hydra_scene_add_light(scene, &light) : (hydra_light){0};
    (void)context;
    (void)lit; /* what could not be added, the commit reports */
}

static hydra_scene *make_scene(hydra_context *context, uint32_t triangles) {
    hydra_scene *scene = hydra_scene_create(context);
    if (scene) add_soup(context, scene, triangles);
    return scene;
}

static void make_rays(hydra_ray rays[ray_count]) {
    ht_rng rng = ht_rng_make(6);
    memset(rays, 0, ray_count * sizeof *rays);
    for (int i = 0; i < ray_count; i++) {
        ht_direction(&rng, rays[i].direction);
        rays[i].t_max = INFINITY;
    }
}

static hydra_render *make_render(hydra_scene *scene) {
    hydra_render_desc desc = {.width = side, .height = side, .max_samples = samples, .sensor = {.position = {0, 0.5f, 4}}, .max_depth = 2, .step_seconds = 60};
    return hydra_render_create(scene, &desc);
}

static hydra_result cast(hydra_scene *scene, hydra_hit hits[ray_count]) {
    hydra_ray rays[ray_count];
    make_rays(rays);
    return hydra_scene_closest_hits(scene, rays, hits, ray_count);
}

/* What it gives when nothing fails: hits by the processor, the picture by a device. */
static struct {
    bool made;
    uint32_t triangles;
    hydra_hit hits[ray_count];
    float radiance[3 * pixels];
} truth;

static void make_truth(void) {
    vkt_host h;
    if (truth.made) return;
    truth.made = true;
    truth.triangles = 40;
    hydra_scene *scene = make_scene(vkt_open_cpu(&h, 1), truth.triangles);
    ht_ok(h.host.context, hydra_scene_commit(scene));
    ht_ok(h.host.context, cast(scene, truth.hits));
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
    scene = make_scene(vkt_open(&h, NULL, 1), truth.triangles);
    ht_ok(h.host.context, hydra_scene_commit(scene));
    hydra_render *render = make_render(scene);
    ht_ok(h.host.context, ht_finish(render));
    ht_ok(h.host.context, hydra_render_read(render, HYDRA_RADIANCE, truth.radiance, 0));
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

static void expect_hits(hydra_context *context, hydra_scene *scene) {
    hydra_hit hits[ray_count];
    ht_ok(context, cast(scene, hits));
    assert_memory_equal(hits, truth.hits, sizeof hits);
}

static void expect_picture(hydra_context *context, hydra_render *render) {
    float radiance[3 * pixels];
    ht_ok(context, hydra_render_read(render, HYDRA_RADIANCE, radiance, 0));
    assert_memory_equal(radiance, truth.radiance, sizeof radiance);
}

static void expect_text(hydra_context *context, const char *part) {
    if (!strstr(hydra_error_text(context), part)) fail_msg("\"%s\" does not say \"%s\"", hydra_error_text(context), part);
}

/* ---- memory and sizes */

/* Under a cap on device memory: what does not fit is refused with both numbers, what is there works on, and when room was
   made the same commit succeeds. */
static void test_memory_cap(void **state) {
    (void)state;
    vkt_host h;
    hydra_vk_desc desc;
    char number[32];
    make_truth();
    memset(&desc, 0, sizeof desc);
    desc.memory_cap = (size_t)1 << 40;
    hydra_scene *scene = make_scene(vkt_open(&h, &desc, 1), truth.triangles);
    ht_ok(h.host.context, hydra_scene_commit(scene));
    size_t of_scene = (size_t)vkt_info(h.host.context).bytes_now;
    expect_hits(h.host.context, scene);
    size_t of_rays = (size_t)vkt_info(h.host.context).bytes_now - of_scene;
    hydra_render *render = make_render(scene);
    size_t of_render = (size_t)vkt_info(h.host.context).bytes_now - of_scene - of_rays;
    hydra_render_destroy(render);
    assert_int_equal(vkt_info(h.host.context).bytes_now, of_scene + of_rays);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    assert_int_equal(vkt_info(h.host.context).bytes_now, of_rays);
    vkt_close(&h);

    desc.memory_cap = of_scene + of_rays + (of_scene < of_render ? of_scene : of_render) / 2;
    scene = make_scene(vkt_open(&h, &desc, 1), truth.triangles);
    ht_ok(h.host.context, hydra_scene_commit(scene));
    expect_hits(h.host.context, scene);
    hydra_scene *second = make_scene(h.host.context, truth.triangles);
    for (int twice = 0; twice < 2; twice++) {
        assert_int_equal(hydra_scene_commit(second), HYDRA_ERROR_DEVICE_MEMORY);
        snprintf(number, sizeof number, "cap is %zu", desc.memory_cap);
        expect_text(h.host.context, number);
        assert_null(make_render(scene));
        expect_text(h.host.context, number);
    }
    expect_hits(h.host.context, scene);
    hydra_hit hits[ray_count];
    assert_int_equal(cast(second, hits), HYDRA_ERROR_NOT_COMMITTED);
    hydra_vk_info info = vkt_info(h.host.context);
    assert_true(info.bytes_now == of_scene + of_rays && info.bytes_peak <= desc.memory_cap);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    ht_ok(h.host.context, hydra_scene_commit(second));
    expect_hits(h.host.context, second);
    assert_int_equal(hydra_scene_destroy(second), HYDRA_OK);
    vkt_close(&h);
}

/* A buffer that the device cannot bind: its name and both numbers; without it the same scene commits. */
static void test_binding_limit(void **state) {
    (void)state;
    vkt_host h;
    make_truth();
    vkt_spy_begin();
    vkt_spied.pretended = 1;
    vkt_spied.pretences[0].binding_most = 4u << 20;
    vkt_spied.pretences[0].name = "narrow";
    hydra_vk_desc desc = vkt_spy_desc();
    hydra_scene *scene = make_scene(vkt_open(&h, &desc, 1), truth.triangles);
    ht_ok(h.host.context, hydra_scene_commit(scene));
    enum { vertices = 400000 };
    float *many = (float *)calloc(vertices, 12);
    const uint32_t triangle[3] = {0, 1, vertices - 1};
    many[3] = many[3 * vertices - 2] = 5;
    hydra_mesh_desc mesh = {.positions = {many, 0, vertices}, .indices = {triangle, 4, 3}};
    hydra_mesh large = hydra_scene_add_mesh(scene, &mesh);
    free(many);
    for (int twice = 0; twice < 2; twice++) {
        assert_int_equal(hydra_scene_commit(scene), HYDRA_ERROR_DEVICE_LIMIT);
        expect_text(h.host.context, "vertex positions: 48");
        expect_text(h.host.context, "narrow binds 4194304");
    }
    ht_ok(h.host.context, hydra_scene_remove_mesh(scene, large));
    ht_ok(h.host.context, hydra_scene_commit(scene));
    expect_hits(h.host.context, scene);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* ---- any call fails */

static void arm(uint64_t at, VkResult result) {
    vkt_spied.fail_at = at;
    vkt_spied.fail_result = result;
    vkt_spied.fail_after = false;
    vkt_spied.calls = 0;
    vkt_spied.failed = NULL;
}

static VkResult shortage(uint64_t n) { return n % 2 ? VK_ERROR_OUT_OF_DEVICE_MEMORY : VK_ERROR_OUT_OF_HOST_MEMORY; }

/* After the call that was to fail: true when all went well since no call was the n-th. */
static bool expect_shortage(const char *error, uint64_t n, hydra_result result) {
    const char *failed = vkt_spied.failed;
    vkt_spied.fail_at = 0;
    if (!failed) {
        assert_int_equal(result, HYDRA_OK);
        return true;
    }
    if (result == HYDRA_OK && strcmp(failed, "vkCreatePipelineCache") == 0) return false; /* an empty one instead */
    hydra_result expected = shortage(n) == VK_ERROR_OUT_OF_DEVICE_MEMORY ? HYDRA_ERROR_DEVICE_MEMORY : HYDRA_ERROR_OUT_OF_MEMORY;
    if (result != expected) fail_msg("%s failed: %s", failed, hydra_result_text(result));
    if (error && !strstr(error, failed)) fail_msg("%s failed: \"%s\"", failed, error);
    return false;
}

static hydra_vk_desc faulty(bool staged) {
    vkt_spy_begin();
    vkt_spied.pretended = staged;
    vkt_spied.pretences[0].staged = staged;
    return vkt_spy_desc();
}

/* Creation: the n-th call of any function that can fail, for all n. */
static void test_failing_creation(void **state) {
    (void)state;
    bool done = false;
    for (uint64_t n = 1; !done; n++) {
        vkt_host h;
        hydra_vk_desc desc = faulty(false);
        memset(&h, 0, sizeof h);
        arm(n, shortage(n));
        hydra_result result = vkt_try(&h, &desc, 1);
        done = expect_shortage(h.error, n, result);
        if (result == HYDRA_OK) assert_int_equal(hydra_destroy(h.host.context), HYDRA_OK);
        vkt_expect_clean(&h);
        assert_null(vkt_spied.last_instance);
        assert_null(vkt_spied.last_device);
        assert_true(n < 40);
    }
}

static void fail_commits(hydra_context *context) {
    bool done = false;
    for (uint64_t n = 1; !done; n++) {
        hydra_scene *scene = make_scene(context, truth.triangles);
        uint64_t before = vkt_info(context).bytes_now;
        arm(n, shortage(n));
        hydra_result result = hydra_scene_commit(scene);
        done = expect_shortage(hydra_error_text(context), n, result);
        if (!done) assert_int_equal(vkt_info(context).bytes_now, before);
        if (!done && n % 8 == 0) { /* again, and all is well */
            ht_ok(context, hydra_scene_commit(scene));
            if (n % 32 == 0) expect_hits(context, scene);
        }
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        assert_true(n < 200);
    }
}

static void fail_rays(hydra_context *context, hydra_scene *scene) {
    char before[512];
    hydra_hit hits[ray_count];
    bool done = false;
    (void)hydra_render_create(scene, NULL); /* leaves a text */
    snprintf(before, sizeof before, "%s", hydra_error_text(context));
    for (uint64_t n = 1; !done; n++) {
        arm(n, shortage(n));
        hydra_result result = cast(scene, hits);
        done = expect_shortage(NULL, n, result);
        assert_string_equal(hydra_error_text(context), before); /* queries write no text */
        assert_true(n < 120);
    }
    expect_hits(context, scene);
}

static hydra_render *fail_render_creation(hydra_context *context, hydra_scene *scene) {
    hydra_render *render = NULL;
    uint64_t before = vkt_info(context).bytes_now;
    for (uint64_t n = 1; !render; n++) {
        arm(n, shortage(n));
        render = make_render(scene);
        hydra_result expected = shortage(n) == VK_ERROR_OUT_OF_DEVICE_MEMORY ? HYDRA_ERROR_DEVICE_MEMORY : HYDRA_ERROR_OUT_OF_MEMORY;
        bool done = expect_shortage(hydra_error_text(context), n, render ? HYDRA_OK : expected);
        assert_int_equal(done, render != NULL);
        if (!render) assert_non_null(strstr(hydra_error_text(context), hydra_result_text(expected)));
        if (!render) assert_int_equal(vkt_info(context).bytes_now, before);
        assert_true(n < 250);
    }
    return render;
}

/* Every step of a picture but the last fails somewhere; it ends with the bits that it would have had. */
static void fail_steps(hydra_context *context, hydra_scene *scene, hydra_render *render) {
    bool done = false;
    for (uint64_t n = 1; !done; n++) {
        if (n > 1) render = make_render(scene);
        arm(n, shortage(n));
        hydra_result result = hydra_render_step(render);
        bool harmless = vkt_spied.failed && result == HYDRA_OK; /* the last picture's times could not be read */
        done = harmless || expect_shortage(hydra_error_text(context), n, result);
        vkt_spied.fail_at = 0;
        if (n % 4 == 1 || done) {
            ht_ok(context, ht_finish(render));
            expect_picture(context, render);
        }
        hydra_render_destroy(render);
        assert_true(n < 200);
    }
}

/* A scene, rays, a picture: each with its n-th call failing; with memory that the host sees, and with memory that it does not. */
static void test_failing_calls(void **state) {
    (void)state;
    make_truth();
    for (int staged = 0; staged < 2; staged++) {
        vkt_host h;
        hydra_vk_desc desc = faulty(staged != 0);
        hydra_context *context = vkt_open(&h, &desc, 1);
        fail_commits(context);
        hydra_scene *scene = make_scene(context, truth.triangles);
        ht_ok(context, hydra_scene_commit(scene));
        fail_steps(context, scene, fail_render_creation(context, scene));
        fail_rays(context, scene);
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
}

/* ---- the host's memory fails */

static bool expect_no_memory(vkt_host *h, int64_t before, hydra_result result) {
    bool reached = h->host.memory.fail_at && h->host.memory.calls >= h->host.memory.fail_at;
    (void)before;
    h->host.memory.fail_at = 0;
    if (!reached) {
        assert_int_equal(result, HYDRA_OK);
        return true;
    }
    if (result != HYDRA_OK && result != HYDRA_ERROR_OUT_OF_MEMORY) fail_msg("%s", hydra_result_text(result));
    return false;
}

static void fail_host(vkt_host *h, int64_t n) { h->host.memory.fail_at = h->host.memory.calls + n; }

static void starve_creation(void) {
    bool done = false;
    for (int64_t n = 1; !done; n++) {
        vkt_host h;
        hydra_vk_desc desc = faulty(true);
        memset(&h, 0, sizeof h);
        fail_host(&h, n);
        hydra_result result = vkt_try(&h, &desc, 1);
        done = expect_no_memory(&h, 0, result);
        if (result == HYDRA_OK) assert_int_equal(hydra_destroy(h.host.context), HYDRA_OK);
        vkt_expect_clean(&h);
        assert_null(vkt_spied.last_instance);
    }
}

/* Scene, commit, rays, render, a step, a film: with every n-th allocation of the host failing. What fails fails with
   HYDRA_ERROR_OUT_OF_MEMORY, and done again it succeeds. */
static void test_failing_host(void **state) {
    (void)state;
    vkt_host h;
    make_truth();
    starve_creation();
    hydra_vk_desc desc = faulty(true);
    hydra_context *context = vkt_open(&h, &desc, 1);
    bool done = false;
    for (int64_t n = 1; !done; n++) {
        int64_t blocks = h.host.memory.blocks_now;
        uint64_t bytes = vkt_info(context).bytes_now;
        fail_host(&h, n);
        hydra_scene *scene = make_scene(context, truth.triangles);
        done = expect_no_memory(&h, 0, scene ? hydra_scene_commit(scene) : HYDRA_ERROR_OUT_OF_MEMORY);
        if (scene) assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        assert_int_equal(h.host.memory.blocks_now, blocks);
        assert_int_equal(vkt_info(context).bytes_now, bytes);
        assert_true(n < 500);
    }
    hydra_scene *scene = make_scene(context, truth.triangles);
    ht_ok(context, hydra_scene_commit(scene));
    done = false;
    for (int64_t n = 1; !done; n++) {
        hydra_hit hits[ray_count];
        fail_host(&h, n);
        hydra_result result = cast(scene, hits);
        done = expect_no_memory(&h, 0, result);
        if (result == HYDRA_OK) assert_memory_equal(hits, truth.hits, sizeof hits);
        assert_true(n < 100);
    }
    done = false;
    for (int64_t n = 1; !done; n++) {
        int64_t blocks = h.host.memory.blocks_now;
        uint64_t bytes = vkt_info(context).bytes_now, pipelines = vkt_info(context).pipelines;
        fail_host(&h, n);
        hydra_render *render = make_render(scene);
        if (render) {
            h.host.memory.fail_at = 0;
            ht_ok(context, ht_finish(render));
            expect_picture(context, render);
        }
        done = expect_no_memory(&h, 0, render ? HYDRA_OK : HYDRA_ERROR_OUT_OF_MEMORY) || render;
        hydra_render_destroy(render);
        int64_t made = (int64_t)(vkt_info(context).pipelines - pipelines); /* these stay */
        assert_int_equal(h.host.memory.blocks_now, blocks + made);
        assert_int_equal(vkt_info(context).bytes_now, bytes);
        assert_true(n < 200);
    }
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* ---- the device is lost */

static void arm_loss(const char *name, uint64_t at) {
    arm(at, VK_ERROR_DEVICE_LOST);
    vkt_spied.fail_name = name;
    vkt_spied.fail_after = true; /* it stays lost */
}

/* Everything that needs the device says that it is lost; what was rendered can be read and saved. */
static void expect_lost(hydra_context *context, hydra_scene *scene, hydra_render *render) {
    hydra_hit hits[ray_count];
    float radiance[3 * pixels];
    size_t size;
    assert_true(vkt_info(context).lost);
    assert_int_equal(cast(scene, hits), HYDRA_ERROR_DEVICE_LOST);
    hydra_light_desc light = {.kind = HYDRA_LIGHT_POINT, .color = {1, 1, 1}};
    hydra_scene *other = make_scene(context, 4);
    assert_true(hydra_scene_add_light(other, &light).id != 0);
    assert_int_equal(hydra_scene_commit(other), HYDRA_ERROR_DEVICE_LOST);
    assert_int_equal(hydra_scene_destroy(other), HYDRA_OK);
    assert_null(make_render(scene));
    expect_text(context, hydra_result_text(HYDRA_ERROR_DEVICE_LOST));
    if (!render) return;
    for (int twice = 0; twice < 2; twice++) {
        assert_int_equal(hydra_render_step(render), HYDRA_ERROR_DEVICE_LOST);
        expect_text(context, hydra_result_text(HYDRA_ERROR_DEVICE_LOST));
    }
    ht_ok(context, hydra_render_read(render, HYDRA_RADIANCE, radiance, 0));
    for (int i = 0; i < 3 * pixels; i++) assert_true(ht_finite(radiance[i]));
    ht_ok(context, hydra_render_save(render, NULL, &size));
}

static void *save_film(hydra_context *context, hydra_render *render, size_t *size) {
    ht_ok(context, hydra_render_save(render, NULL, size));
    void *film = malloc(*size);
    ht_ok(context, hydra_render_save(render, film, size));
    return film;
}

/* While a picture is made, at its n-th submission or wait; what it had gone through goes on elsewhere to the same bits. */
static void test_lost_in_a_picture(void **state) {
    (void)state;
    make_truth();
    for (int way = 0; way < 3; way++) {
        vkt_host h, other;
        size_t size;
        hydra_vk_desc desc = faulty(way == 2);
        desc.slice_seconds = 1e-6; /* many submissions */
        hydra_context *context = vkt_open(&h, &desc, 1);
        hydra_scene *scene = make_scene(context, truth.triangles);
        ht_ok(context, hydra_scene_commit(scene));
        hydra_render *render = make_render(scene);
        arm_loss(way == 1 ? "vkWaitForFences" : "vkQueueSubmit", way ? 4 : 1);
        assert_int_equal(hydra_render_step(render), HYDRA_ERROR_DEVICE_LOST);
        expect_text(context, vkt_spied.failed);
        expect_lost(context, scene, render);
        void *film = save_film(context, render, &size);
        hydra_render_destroy(render);
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
        vkt_spy_begin();
        if (way == 1) { /* resumed */
            scene = make_scene(vkt_open(&other, NULL, 1), truth.triangles);
            ht_ok(other.host.context, hydra_scene_commit(scene));
            render = make_render(scene);
            ht_ok(other.host.context, hydra_render_merge(render, film, size));
            ht_ok(other.host.context, ht_finish(render));
            expect_picture(other.host.context, render);
            hydra_render_destroy(render);
            assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
            vkt_close(&other);
        }
        free(film);
    }
}

/* While rays are cast, and while a scene goes up by staging. */
static void test_lost_elsewhere(void **state) {
    (void)state;
    vkt_host h;
    hydra_hit hits[ray_count];
    make_truth();
    for (int way = 0; way < 2; way++) {
        hydra_vk_desc desc = faulty(false);
        hydra_scene *scene = make_scene(vkt_open(&h, &desc, 1), truth.triangles);
        ht_ok(h.host.context, hydra_scene_commit(scene));
        arm_loss(way ? "vkWaitForFences" : "vkQueueSubmit", 1);
        assert_int_equal(cast(scene, hits), HYDRA_ERROR_DEVICE_LOST);
        expect_lost(h.host.context, scene, NULL);
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
    hydra_vk_desc desc = faulty(true);
    hydra_scene *scene = make_scene(vkt_open(&h, &desc, 1), truth.triangles);
    arm_loss("vkQueueSubmit", 1);
    assert_int_equal(hydra_scene_commit(scene), HYDRA_ERROR_DEVICE_LOST);
    expect_text(h.host.context, "vkQueueSubmit");
    assert_int_equal(hydra_scene_commit(scene), HYDRA_ERROR_DEVICE_LOST);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

int hydra_test_vk_limits(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory_cap),
        cmocka_unit_test(test_binding_limit),
        cmocka_unit_test(test_failing_creation),
        cmocka_unit_test(test_failing_calls),
        cmocka_unit_test(test_failing_host),
        cmocka_unit_test(test_lost_in_a_picture),
        cmocka_unit_test(test_lost_elsewhere),
    };
    return cmocka_run_group_tests_name("vk_limits", tests, NULL, NULL);
}
