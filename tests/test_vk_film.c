/* A film on the device: the same bytes as one that the host adds up, whatever is asked for and however the work is cut; what
   it gives to a buffer of the device's; what comes back to the host; and that nothing that fails loses a sample or counts
   one twice. */
#include "vk_helpers.h"

int hydra_test_vk_film(void);

enum { ALL_OUTPUTS = (1 << HYDRA_OUTPUT_COUNT) - 1, SIDE = 40 };

/* ---- scenes */

/* Matte things under a lamp; or among them glass, metal, instances and a sky; or lamps as bright as floats go, of which some
   samples are not finite. */
typedef enum kind { MATTE, RICH, GLARING } kind;

static void add_ball(hydra_scene *scene, hydra_material material, float x, bool instanced) {
    ht_mesh ball = ht_icosphere(0.4f, 2);
    ht_mesh_place(&ball, 1, instanced ? 0 : x, -0.2f, 0);
    hydra_mesh_desc desc = ht_mesh_desc(&ball, material);
    desc.instanced_only = instanced;
    hydra_instance_desc instance = {.mesh = hydra_scene_add_mesh(scene, &desc), .transform = {0.8f, 0, 0.6f, x, 0, 1, 0, 0, -0.6f, 0, 0.8f, 0.5f}};
    assert_true(instance.mesh.id != 0 && (!instanced || hydra_scene_add_instance(scene, &instance).id != 0));
    ht_mesh_free(&ball);
}

static hydra_scene *make_scene(hydra_context *context, kind of) {
    const hydra_material_desc glass = {.kind = HYDRA_MATERIAL_DIELECTRIC}, metal = {.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS, .base_color = {0.9f, 0.7f, 0.4f}, .metallic = 1, .roughness = 0.2f};
    const hydra_environment_desc sky = {.color = {0.2f, 0.25f, 0.3f}};
    ht_rng rng = ht_rng_make(5);
    ht_mesh soup = ht_soup(&rng, 50, 1, 0.5f);
    float power = of == GLARING ? 2e38f : 9;
    hydra_light_desc light = {.kind = HYDRA_LIGHT_RECT, .color = {power, 0.9f * power, 0.8f * power}, .position = {0, 1.4f, 0}, .axis_u = {1, 0, 0}, .axis_v = {0, 0, 1}};
    hydra_mesh_desc mesh = ht_mesh_desc(&soup, (hydra_material){0});
    hydra_scene *scene = hydra_scene_create(context);
    assert_non_null(scene);
    assert_true(hydra_scene_add_mesh(scene, &mesh).id && hydra_scene_add_light(scene, &light).id);
    ht_mesh_free(&soup);
    if (of == RICH) {
        add_ball(scene, hydra_scene_add_material(scene, &glass), -0.7f, false);
        add_ball(scene, hydra_scene_add_material(scene, &metal), 0.6f, true);
        assert_int_equal(hydra_scene_set_environment(scene, &sky), HYDRA_OK);
    }
    ht_ok(context, hydra_scene_commit(scene));
    return scene;
}

/* ---- pictures */

typedef struct picture {
    const char *name;
    kind of;
    hydra_render_desc desc;
    bool points;
} picture;

static const hydra_sensor_desc from_the_front = {.position = {0, 0.5f, 4}};

enum { PLAIN, ALL, TO_TARGET, ALL_TO_TARGET, POINTS, NARROW, ONE_PIXEL, GLARE, PICTURES };

/* Few sets of kernels, since their making is what most of the time goes to. */
static picture make_picture(uint32_t i) {
    picture p[PICTURES] = {
        {"plain", MATTE, {.max_samples = 24}, false},
        {"all outputs, a region, a last chunk of six", RICH, {.max_samples = 30, .outputs = ALL_OUTPUTS, .region = {3, 5, 33, 30}, .max_depth = 4}, false},
        {"to a target", MATTE, {.max_samples = 128, .target_error = 0.2f}, false},
        {"all outputs to a target", MATTE, {.max_samples = 62, .target_error = 0.15f, .tile_size = 8, .outputs = ALL_OUTPUTS}, false},
        {"points", MATTE, {.width = 37, .height = 3, .max_samples = 16, .outputs = ALL_OUTPUTS}, true},
        {"narrow", MATTE, {.width = 3, .height = 90, .max_samples = 40, .outputs = ALL_OUTPUTS}, false},
        {"one pixel", MATTE, {.width = 1, .height = 1, .max_samples = 100, .target_error = 0.01f}, false},
        {"glaring", GLARING, {.max_samples = 16, .outputs = ALL_OUTPUTS, .max_depth = 3}, false},
    };
    p[i].desc.sensor = from_the_front;
    p[i].desc.step_seconds = 60;
    if (!p[i].desc.width) p[i].desc.width = p[i].desc.height = SIDE;
    return p[i];
}

static float points[2][3 * 111];

static hydra_render *make_render(hydra_scene *scene, picture p) {
    if (p.points) {
        ht_rng rng = ht_rng_make(8);
        for (int i = 0; i < 111; i++) {
            ht_direction(&rng, &points[1][3 * i]);
            for (int k = 0; k < 3; k++) points[0][3 * i + k] = ht_range(&rng, -1.2f, 1.2f);
        }
        p.desc.sensor.kind = HYDRA_SENSOR_POINTS;
        p.desc.sensor.point_positions = (hydra_view){points[0], 0, 111};
        p.desc.sensor.point_normals = (hydra_view){points[1], 0, 111};
        p.desc.sensor.lightmap = HYDRA_LIGHTMAP_RADIOSITY;
        for (int k = 0; k < 3; k++) p.desc.sensor.lightmap_albedo[k] = 0.3f + 0.2f * (float)k;
    }
    hydra_render *render = hydra_render_create(scene, &p.desc);
    assert_non_null(render);
    return render;
}

/* ---- films */

typedef struct bytes {
    void *at;
    size_t size;
} bytes;

static bytes save(hydra_context *context, hydra_render *render) {
    bytes film;
    ht_ok(context, hydra_render_save(render, NULL, &film.size));
    film.at = malloc(film.size);
    ht_ok(context, hydra_render_save(render, film.at, &film.size));
    return film;
}

static void expect_film(hydra_context *context, hydra_render *render, const bytes *truth, const char *what) {
    bytes film = save(context, render);
    assert_int_equal(film.size, truth->size);
    if (memcmp(film.at, truth->at, film.size) != 0) fail_msg("%s: another film", what);
    free(film.at);
}

/* A device of the test's own, and two contexts on it, which all tests share that need nothing else: one with films on the
   host, one with films on the device. */
enum { HOST, DEVICE };
static vkt_own own;
static vkt_host hosts[2];
static hydra_context *contexts[2];

/* Of every picture, as the host adds it up. */
static bytes truths[PICTURES];
static hydra_status statuses[PICTURES];

static void finish(hydra_context *context, uint32_t i, bytes *film, hydra_status *status) {
    picture p = make_picture(i);
    hydra_scene *scene = make_scene(context, p.of);
    hydra_render *render = make_render(scene, p);
    ht_ok(context, ht_finish(render));
    *status = hydra_render_status(render);
    *film = save(context, render);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
}

static int open_all(void **state) {
    (void)state;
    vkt_own_open(&own, NULL);
    for (int i = 0; i < 2; i++) {
        hydra_vk_desc desc = vkt_own_desc(&own);
        desc.film = i == DEVICE ? HYDRA_VK_FILM_DEVICE : HYDRA_VK_FILM_AUTO; /* which it is on a processor */
        desc.slice_seconds = 60;
        contexts[i] = vkt_open(&hosts[i], &desc, 3);
    }
    for (uint32_t i = 0; i < PICTURES; i++) finish(contexts[HOST], i, &truths[i], &statuses[i]);
    assert_true(statuses[TO_TARGET].samples < 100 && statuses[ALL_TO_TARGET].samples < 60); /* some tiles ended early */
    assert_true(statuses[GLARE].dropped_samples > 0);
    return 0;
}

static int close_all(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) vkt_close(&hosts[i]);
    for (int i = 0; i < PICTURES; i++) free(truths[i].at);
    vkt_own_close(&own);
    return 0;
}

/* One whose memory the host does not see; what it does when nothing is asked for is to keep the film. */
static hydra_vk_desc staged_film(double slice) {
    vkt_spy_begin();
    vkt_spied.pretended = 1;
    vkt_spied.pretences[0].staged = true;
    vkt_spied.pretences[0].type = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU;
    vkt_spied.pretences[0].no_times = slice < 1e-6;
    hydra_vk_desc desc = vkt_spy_desc();
    desc.slice_seconds = slice;
    return desc;
}

static void expect_finish(hydra_context *context, uint32_t i) {
    hydra_status status;
    bytes film;
    finish(context, i, &film, &status);
    const hydra_status *t = &statuses[i];
    assert_true(status.samples == t->samples && status.error == t->error && status.dropped_samples == t->dropped_samples);
    assert_true(status.paths == t->paths && status.rays_camera == t->rays_camera && status.rays_bounce == t->rays_bounce && status.rays_shadow == t->rays_shadow);
    if (film.size != truths[i].size || memcmp(film.at, truths[i].at, film.size) != 0) fail_msg("%s: another film", make_picture(i).name);
    free(film.at);
}

/* ---- films and cuts */

/* In large batches, which hold many units of a tile. */
static void test_same_film(void **state) {
    (void)state;
    for (uint32_t i = 0; i < PICTURES; i++) expect_finish(contexts[DEVICE], i);
}

/* Cancelled over and over, in steps of no length, and asked for errors after each. */
static void expect_film_of_cuts(hydra_context *context, uint32_t which) {
    picture p = make_picture(which);
    hydra_scene *scene = make_scene(context, p.of);
    uint32_t cancelled = 0, steps = 0;
    hydra_result result;
    p.desc.step_seconds = 1e-9;
    hydra_render *render = make_render(scene, p);
    do {
        if (steps++ % 3) hydra_render_cancel(render);
        result = hydra_render_step(render);
        cancelled += result == HYDRA_CANCELLED;
        assert_true(hydra_render_status(render).samples > 0 || result == HYDRA_CANCELLED);
    } while (result == HYDRA_MORE || result == HYDRA_CANCELLED);
    assert_int_equal(result, HYDRA_OK);
    assert_true(cancelled > 5);
    expect_film(context, render, &truths[which], "cancelled");
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
}

/* In the smallest batches, on a device whose memory the host does not see; and with many cuts. */
static void test_cuts(void **state) {
    (void)state;
    vkt_host h;
    hydra_vk_desc desc = staged_film(1e-7);
    hydra_context *context = vkt_open(&h, &desc, 1);
    expect_finish(context, TO_TARGET);
    expect_finish(context, NARROW);
    expect_finish(context, GLARE);
    expect_film_of_cuts(context, PLAIN);
    expect_film_of_cuts(context, ALL_TO_TARGET);
    vkt_close(&h);
}

/* ---- shares */

static void merge(hydra_context *context, hydra_render *to, hydra_render *from) {
    bytes film = save(context, from);
    ht_ok(context, hydra_render_merge(to, film.at, film.size));
    free(film.at);
}

/* The outputs' pixels, which a film that took shares in another order has as well. */
static void expect_pixels(hydra_context *context, hydra_render *render, hydra_render *other) {
    static float seen[2][3 * SIDE * SIDE];
    for (int output = 0; output < HYDRA_OUTPUT_COUNT; output++) {
        memset(seen, 0, sizeof seen);
        ht_ok(context, hydra_render_read(render, (hydra_output)output, seen[0], 0));
        ht_ok(context, hydra_render_read(other, (hydra_output)output, seen[1], 0));
        assert_memory_equal(seen[0], seen[1], sizeof seen[0]);
    }
}

/* Halves of the samples; parts of the picture, merged into a render that goes on, before it began and after; and a render that is saved on
   its way and resumed by another context, from the device's film to the host's and back. */
static void test_shares(void **state) {
    (void)state;
    picture p = make_picture(ALL), first = p, second = p;
    hydra_context *context = contexts[DEVICE];
    hydra_scene *scenes[2] = {make_scene(contexts[0], p.of), make_scene(contexts[1], p.of)};
    hydra_render *whole = make_render(scenes[DEVICE], p);
    ht_ok(context, ht_finish(whole));

    first.desc.max_samples = 12, second.desc.first_sample = 12;
    hydra_render *a = make_render(scenes[DEVICE], first), *b = make_render(scenes[DEVICE], second);
    ht_ok(context, ht_finish(a));
    ht_ok(context, ht_finish(b));
    merge(context, b, a);
    expect_pixels(context, b, whole);
    hydra_render_destroy(a);
    hydra_render_destroy(b);
    hydra_render_destroy(whole);

    const uint32_t parts[2][4] = {{3, 5, 13, 30}, {32, 32, 4, 3}};
    second.desc.first_sample = 0;
    p.desc.step_seconds = 1e-9;
    for (int begun = 0; begun < 2; begun++) {
        memcpy(second.desc.region, parts[begun], sizeof parts[begun]);
        a = make_render(scenes[DEVICE], second), b = make_render(scenes[DEVICE], p);
        ht_ok(context, ht_finish(a));
        if (begun) assert_int_equal(hydra_render_step(b), HYDRA_MORE); /* not yet at the last tile */
        merge(context, b, a);
        ht_ok(context, ht_finish(b));
        expect_film(context, b, &truths[ALL], "parts of the picture");
        hydra_render_destroy(a);
        hydra_render_destroy(b);
    }

    for (int from = 0; from < 2; from++) {
        a = make_render(scenes[from], p), b = make_render(scenes[1 - from], p);
        for (int i = 0; i < 3; i++) assert_int_equal(hydra_render_step(a), HYDRA_MORE);
        bytes film = save(contexts[from], a);
        ht_ok(contexts[1 - from], hydra_render_merge(b, film.at, film.size));
        free(film.at);
        ht_ok(contexts[1 - from], ht_finish(b));
        expect_film(contexts[1 - from], b, &truths[ALL], "resumed");
        hydra_render_destroy(a);
        hydra_render_destroy(b);
    }
    for (int i = 0; i < 2; i++) assert_int_equal(hydra_scene_destroy(scenes[i]), HYDRA_OK);
}

/* ---- into a buffer of the device */

/* Every output, tight and with rows apart, is what hydra_render_read gives later: to the bit, on a device whose double
   division rounds correctly. Up to then the host has read nothing but counts, where the count of samples is given. */
static void expect_written(hydra_context *context, uint32_t which) {
    enum { most = 12 * SIDE * SIDE };
    static unsigned char written[HYDRA_OUTPUT_COUNT][most], read[most];
    picture p = make_picture(which);
    hydra_scene *scene = make_scene(context, p.of);
    hydra_render *render = make_render(scene, p);
    vkt_buffer to = vkt_make_buffer(&own, most + 64 * SIDE);
    uint32_t width = p.desc.region[2] ? p.desc.region[2] : p.desc.width, height = p.desc.region[3] ? p.desc.region[3] : p.desc.height;
    hydra_vk_info before = vkt_info(context);
    ht_ok(context, ht_finish(render));
    for (int output = 0; output < HYDRA_OUTPUT_COUNT; output++) {
        size_t row = width * hydra_output_size((hydra_output)output), stride = row + (output % 2 ? 16 : 0);
        if (output == HYDRA_ERROR || output == HYDRA_VALIDITY) continue; /* these the host makes */
        memset(to.bytes, 0xab, most + 64 * SIDE);
        ht_ok(context, hydra_vk_render_write(render, (hydra_output)output, to.buffer, 4, stride));
        for (uint32_t y = 0; y < height; y++) memcpy(written[output] + y * row, to.bytes + 4 + y * stride, row);
        for (size_t i = 0; i < 4; i++) assert_int_equal(to.bytes[i], 0xab);
        for (size_t i = 4 + (height - 1) * stride + row; i < most + 64 * SIDE; i++) assert_int_equal(to.bytes[i], 0xab);
    }
    hydra_vk_info after = vkt_info(context);
    if (!(p.desc.target_error > 0)) assert_true(after.bytes_read - before.bytes_read <= 64 * (after.submissions - before.submissions));
    for (int output = 0; output < HYDRA_OUTPUT_COUNT; output++) {
        ht_ok(context, hydra_render_read(render, (hydra_output)output, read, 0));
        if (output == HYDRA_ERROR || output == HYDRA_VALIDITY) {
            ht_ok(context, hydra_vk_render_write(render, (hydra_output)output, to.buffer, 4, 0));
            memcpy(written[output], to.bytes + 4, (size_t)width * height * hydra_output_size((hydra_output)output));
        }
        if (memcmp(read, written[output], (size_t)width * height * hydra_output_size((hydra_output)output)) != 0) fail_msg("%s: output %d is another", p.name, output);
    }
    vkt_free_buffer(&own, &to);
    expect_film(context, render, &truths[which], p.name);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
}

static void test_write(void **state) {
    (void)state;
    expect_written(contexts[DEVICE], ALL);
    expect_written(contexts[DEVICE], ALL_TO_TARGET);
    expect_written(contexts[DEVICE], POINTS);
}

/* ---- where there is no room */

/* A film that a binding cannot hold is the host's, unless the device's was asked for; so is a processor's film. */
static void test_no_room(void **state) {
    (void)state;
    picture p = make_picture(PLAIN);
    p.desc.tile_size = 8;
    for (int way = 0; way < 2; way++) {
        vkt_host h;
        hydra_vk_desc desc = staged_film(0.03);
        vkt_spied.pretences[0].binding_most = 200000;
        desc.film = way ? HYDRA_VK_FILM_DEVICE : HYDRA_VK_FILM_AUTO;
        hydra_context *context = vkt_open(&h, &desc, 1);
        hydra_scene *scene = make_scene(context, p.of);
        uint64_t before = vkt_info(context).bytes_read;
        if (way) {
            assert_null(hydra_render_create(scene, &p.desc));
            assert_non_null(strstr(hydra_error_text(context), "the film: 204800 bytes"));
        } else {
            hydra_scene *other = make_scene(contexts[DEVICE], p.of);
            hydra_render *here = make_render(scene, p), *there = make_render(other, p);
            ht_ok(context, ht_finish(here));
            ht_ok(contexts[DEVICE], ht_finish(there));
            bytes film = save(contexts[DEVICE], there);
            expect_film(context, here, &film, "a film of the host's");
            free(film.at);
            hydra_render_destroy(here);
            hydra_render_destroy(there);
            assert_int_equal(hydra_scene_destroy(other), HYDRA_OK);
            assert_true(vkt_info(context).bytes_read - before >= 16u * 24 * SIDE * SIDE);
        }
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
    assert_true(vkt_info(contexts[HOST]).bytes_read > 16u * 24 * SIDE * SIDE);
}

/* ---- what fails */

static VkResult shortage(uint64_t n) { return n % 2 ? VK_ERROR_OUT_OF_DEVICE_MEMORY : VK_ERROR_OUT_OF_HOST_MEMORY; }

static void arm(uint64_t at, const char *name, VkResult result) {
    vkt_spied.fail_at = at;
    vkt_spied.fail_name = name;
    vkt_spied.fail_result = result;
    vkt_spied.fail_after = result == VK_ERROR_DEVICE_LOST;
    vkt_spied.fail_more = name && !vkt_spied.fail_after ? 2 : 0;
    vkt_spied.calls = 0;
    vkt_spied.failed = NULL;
}

/* A call that may fail, for one reason, once; or three times, where waits do. */
#define ONCE_OR_THRICE(call)                                                                  \
    do {                                                                                      \
        hydra_result once = (call);                                                           \
        if (once == HYDRA_OK || once == HYDRA_MORE) break;                                    \
        assert_true(once == HYDRA_ERROR_DEVICE_MEMORY || once == HYDRA_ERROR_OUT_OF_MEMORY);  \
        assert_true(++failures <= 1 + vkt_spied.fail_more);                                   \
    } while (true)

/* A small picture to a target, its film half-way, merged into another render, its pixels, and the film in the end. */
static picture small_picture(void) {
    picture p = make_picture(TO_TARGET);
    p.desc.width = 12;
    p.desc.height = 8;
    p.desc.tile_size = 8;
    p.desc.max_samples = 40;
    p.desc.max_depth = 2;
    p.desc.target_error = 0.02f;
    return p;
}

static bytes small_truth(void) {
    picture p = small_picture();
    hydra_scene *scene = make_scene(contexts[HOST], p.of);
    hydra_render *render = make_render(scene, p);
    ht_ok(contexts[HOST], ht_finish(render));
    bytes truth = save(contexts[HOST], render);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    return truth;
}

/* With the n-th call or allocation failing that comes after both renders are made; name: of that function, three times in a row. */
static void go_through(vkt_host *h, hydra_scene *scene, const bytes *truth, uint64_t call, const char *name, int64_t allocation) {
    hydra_context *context = h->host.context;
    picture p = small_picture();
    float pixels[3 * 12 * 8];
    static unsigned char film[1 << 18];
    size_t size = sizeof film;
    uint32_t failures = 0;
    p.desc.step_seconds = 1e-9;
    hydra_render *a = make_render(scene, p), *b = make_render(scene, p);
    arm(call, name, shortage(call));
    h->host.memory.fail_at = allocation ? h->host.memory.calls + allocation : 0;
    for (int i = 0; i < 2; i++) ONCE_OR_THRICE(hydra_render_step(a));
    ONCE_OR_THRICE(hydra_render_save(a, film, &size));
    ONCE_OR_THRICE(hydra_render_merge(b, film, size));
    ONCE_OR_THRICE(ht_finish(b));
    ONCE_OR_THRICE(hydra_render_step(a));
    ONCE_OR_THRICE(hydra_render_read(a, HYDRA_RADIANCE, pixels, 0));
    vkt_spied.fail_at = 0;
    h->host.memory.fail_at = h->host.memory.calls < h->host.memory.fail_at ? 0 : h->host.memory.fail_at;
    expect_film(context, b, truth, "after a failure");
    ht_ok(context, ht_finish(a));
    expect_film(context, a, truth, "after a failure");
    hydra_render_destroy(a);
    hydra_render_destroy(b);
}

static void fail_creation(hydra_context *context, hydra_scene *scene) {
    picture p = small_picture();
    hydra_render *render = NULL;
    uint64_t before = vkt_info(context).bytes_now;
    for (uint64_t n = 1; !render; n++) {
        arm(n, NULL, shortage(n));
        render = hydra_render_create(scene, &p.desc);
        assert_int_equal(render != NULL, vkt_spied.failed == NULL);
        if (!render) assert_int_equal(vkt_info(context).bytes_now, before);
        assert_true(n < 250);
    }
    vkt_spied.fail_at = 0;
    hydra_render_destroy(render);
}

/* Each call of Vulkan's that can fail, and each allocation of the host's, once: what fails is done again, and no sample is
   lost nor counted twice. */
static void test_failures(void **state) {
    (void)state;
    bytes truth = small_truth();
    for (int way = 0; way < 2; way++) {
        vkt_host h;
        hydra_vk_desc desc = staged_film(0.03);
        vkt_spied.pretences[0].staged = way == 0;
        desc.film = HYDRA_VK_FILM_DEVICE;
        hydra_context *context = vkt_open(&h, &desc, 1);
        hydra_scene *scene = make_scene(context, small_picture().of);
        fail_creation(context, scene);
        go_through(&h, scene, &truth, 0, NULL, 0); /* all pipelines are made */
        uint64_t n = 0;
        do go_through(&h, scene, &truth, n += way ? 5 : 1, NULL, 0); /* every one where there are more */
        while (vkt_spied.failed && n < 2000);
        assert_true(n > 50 && n < 2000);
        n = way ? 0 : 2000; /* while nothing is staged: of what is, the second wait is the last before its memory goes */
        while (n < 2000) {
            go_through(&h, scene, &truth, n += 2, "vkWaitForFences", 0);
            if (!vkt_spied.failed) break;
        }
        int64_t m = 0;
        do go_through(&h, scene, &truth, 0, NULL, ++m);
        while (h.host.memory.fail_at && m < 200);
        assert_true(m > 1 && m < 200);
        assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
        vkt_close(&h);
    }
    free(truth.at);
}

/* Lost at the n-th submission, or while that is waited for: the film is then what it was when it was last read, and goes on
   elsewhere to the bits that it would have had. */
static void lose(const picture *p, uint64_t way, unsigned char *film, size_t *size) {
    vkt_host h;
    hydra_vk_desc desc = staged_film(0.03);
    vkt_spied.pretences[0].staged = way % 2;
    desc.film = HYDRA_VK_FILM_DEVICE;
    hydra_scene *scene = make_scene(vkt_open(&h, &desc, 1), p->of);
    hydra_render *render = make_render(scene, *p);
    size_t room = *size;
    double samples = 0;
    for (uint64_t i = 0; i < way; i++) {
        assert_int_equal(hydra_render_step(render), HYDRA_MORE);
        if (i != way / 2) continue;
        ht_ok(h.host.context, hydra_render_save(render, film, size));
        samples = hydra_render_status(render).samples;
        *size = room;
    }
    arm(1 + way % 3, way % 2 ? "vkWaitForFences" : "vkQueueSubmit", VK_ERROR_DEVICE_LOST);
    hydra_result result = HYDRA_MORE;
    while (result == HYDRA_MORE) result = hydra_render_step(render);
    assert_int_equal(result, HYDRA_ERROR_DEVICE_LOST);
    ht_ok(h.host.context, hydra_render_save(render, film, size));
    assert_true(vkt_info(h.host.context).lost && hydra_render_status(render).samples == samples);
    assert_int_equal(hydra_render_step(render), HYDRA_ERROR_DEVICE_LOST);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

/* Lost while a status fetches the film for the first time: there is no error then, least of all one of 0. */
static void lose_in_status(void) {
    vkt_host h;
    hydra_vk_desc desc = staged_film(0.03);
    desc.film = HYDRA_VK_FILM_DEVICE;
    picture p = small_picture();
    p.desc.target_error = 0;
    hydra_context *context = vkt_open(&h, &desc, 1);
    hydra_scene *scene = make_scene(context, p.of);
    hydra_render *render = make_render(scene, p);
    ht_ok(context, ht_finish(render));
    arm(1, "vkWaitForFences", VK_ERROR_DEVICE_LOST);
    assert_true(hydra_render_status(render).error == HUGE_VAL);
    assert_true(vkt_info(context).lost && hydra_render_status(render).samples == 0);
    hydra_render_destroy(render);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    vkt_close(&h);
}

static void test_lost(void **state) {
    (void)state;
    static unsigned char film[1 << 18];
    bytes truth = small_truth();
    picture p = small_picture();
    p.desc.step_seconds = 1e-9;
    hydra_scene *scene = make_scene(contexts[HOST], p.of);
    for (uint64_t way = 1; way < 4; way++) {
        size_t size = sizeof film;
        lose(&p, way, film, &size);
        hydra_render *render = make_render(scene, p);
        ht_ok(contexts[HOST], hydra_render_merge(render, film, size));
        ht_ok(contexts[HOST], ht_finish(render));
        expect_film(contexts[HOST], render, &truth, "after a loss");
        hydra_render_destroy(render);
    }
    lose_in_status();
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
    free(truth.at);
}

int hydra_test_vk_film(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_film),
        cmocka_unit_test(test_cuts),
        cmocka_unit_test(test_shares),
        cmocka_unit_test(test_write),
        cmocka_unit_test(test_no_room),
        cmocka_unit_test(test_failures),
        cmocka_unit_test(test_lost),
    };
    return cmocka_run_group_tests_name("vk_film", tests, open_all, close_all);
}
