/* Memory: an allocator that fails at every call in turn over a whole life, caps of every size, and counts that agree. */
#include "truth_helpers.h"

int hydra_test_memory(void);

/* ---------------------------------------------------------------- one small life */

typedef struct life {
    ht_host host;
    hydra_scene *scene;
    hydra_render *render, *second;
    void *film;
    size_t film_size;
    hydra_result wanted; /* what a failure must be called */
    uint32_t failures;
    bool retry;          /* the failing call is made once more, and must then succeed */
    bool opened, gave_up;
} life;

/* A call of the life gave result: fine, or the failure that was arranged, and worth a retry or the end. */
static bool again_untold(life *l, hydra_result result) {
    if (result == HYDRA_OK || result == HYDRA_MORE) return false;
    l->failures++;
    if (result != l->wanted) fail_msg("failure number %u is \"%s\"", l->failures, hydra_error_text(l->host.context));
    if (l->failures > 1 || !l->retry) l->gave_up = true;
    return !l->gave_up;
}

/* The same, and the failure has a message. */
static bool again(life *l, hydra_result result) {
    if (result != HYDRA_OK && result != HYDRA_MORE) assert_int_not_equal(strlen(hydra_error_text(l->host.context)), 0);
    return again_untold(l, result);
}

/* Handles and pointers: 0 is a failure, whose kind stands in the message. */
static bool missing(life *l, bool is_there) {
    if (is_there) return false;
    const char *text = hydra_error_text(l->host.context), *wanted = hydra_result_text(l->wanted);
    if (strncmp(text, wanted, strlen(wanted)) != 0) fail_msg("the message is \"%s\"", text);
    return again(l, l->wanted);
}

#define TRY_CALL(call)          \
    while (again(l, (call))) {} \
    if (l->gave_up) return
#define TRY_MAKE(call)                 \
    while (missing(l, (call) != 0)) {} \
    if (l->gave_up) return

static void live_textures(life *l, hydra_material *paint) {
    static const uint8_t texels[64] = {200, 100};
    hydra_texture_desc texture;
    hydra_material_desc material;
    hydra_texture made = {0};
    memset(&texture, 0, sizeof texture);
    memset(&material, 0, sizeof material);
    texture.texels = texels;
    texture.width = texture.height = 4;
    TRY_MAKE((made = hydra_scene_add_texture(l->scene, &texture)).id);
    material.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
    material.base_color[0] = material.base_color[1] = material.base_color[2] = 0.5f;
    material.roughness = 0.5f;
    material.base_color_texture = made;
    TRY_MAKE((*paint = hydra_scene_add_material(l->scene, &material)).id);
}

static void live_geometry(life *l, hydra_material paint) {
    static const float turned[12] = {0, 1, 0, 3, -1, 0, 0, 0, 0, 0, 1, 0};
    truth_mesh ball = truth_mesh_sphere(truth_v(0, 0, 0), 1, 1, false);
    hydra_mesh_desc mesh = truth_mesh_desc(&ball, paint);
    hydra_mesh made = {0};
    while (missing(l, (made = hydra_scene_add_mesh(l->scene, &mesh)).id != 0)) {}
    while (!l->gave_up && again(l, hydra_scene_update_mesh(l->scene, made, &mesh))) {}
    truth_mesh_free(&ball);
    if (l->gave_up) return;
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = made;
    memcpy(instance.transform, turned, sizeof turned);
    TRY_MAKE(hydra_scene_add_instance(l->scene, &instance).id);
}

static void live_lights(life *l) {
    static const float sky_texels[24] = {1, 2, 3, 4};
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 5);
    hydra_environment_desc sky;
    lamp.position[1] = 3;
    lamp.radius = 0.5f;
    TRY_MAKE(hydra_scene_add_light(l->scene, &lamp).id);
    memset(&sky, 0, sizeof sky);
    sky.texels = sky_texels;
    sky.width = 4;
    sky.height = 2;
    TRY_CALL(hydra_scene_set_environment(l->scene, &sky));
}

static hydra_render_desc live_desc(void) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(truth_v(0, 1, 5), truth_v(0, 0, 0), 0.8);
    desc.width = 20;
    desc.height = 18;
    desc.max_samples = 4;
    desc.outputs = (1u << HYDRA_OUTPUT_COUNT) - 1;
    return desc;
}

static void live_film(life *l) {
    hydra_render_desc desc = live_desc();
    float pixels[3 * 20 * 18];
    TRY_CALL(hydra_render_read(l->render, HYDRA_RADIANCE, pixels, 0));
    for (int i = 0; i < 3 * 20 * 18; i++) assert_true(pixels[i] >= 0);
    TRY_CALL(hydra_render_save(l->render, NULL, &l->film_size));
    l->film = malloc(l->film_size);
    TRY_CALL(hydra_render_save(l->render, l->film, &l->film_size));
    desc.max_samples = 8;
    TRY_MAKE(l->second = hydra_render_create(l->scene, &desc));
    TRY_CALL(hydra_render_merge(l->second, l->film, l->film_size));
    hydra_result result = HYDRA_MORE;
    while (!l->gave_up && result != HYDRA_OK) {
        result = hydra_render_step(l->second);
        again(l, result);
    }
}

static void live_render(life *l) {
    hydra_render_desc desc = live_desc();
    hydra_ray ray = {{0, 0, 5}, 0, {0, 0, -1}, INFINITY};
    hydra_hit hit;
    TRY_CALL(hydra_scene_commit(l->scene));
#ifdef HT_VULKAN /* there a query takes memory, and when it fails it leaves no message, since many threads may ask */
    while (again_untold(l, hydra_scene_closest_hits(l->scene, &ray, &hit, 1))) {}
    if (l->gave_up) return;
#else
    assert_int_equal(hydra_scene_closest_hits(l->scene, &ray, &hit, 1), HYDRA_OK);
#endif
    assert_true(hit.t > 3.9f && hit.t < 4.3f);
    TRY_MAKE(l->render = hydra_render_create(l->scene, &desc));
    hydra_result result = HYDRA_MORE;
    while (!l->gave_up && result != HYDRA_OK) {
        result = hydra_render_step(l->render);
        again(l, result);
    }
    if (!l->gave_up) live_film(l);
}

static void live_scene(life *l) {
    hydra_material paint = {0};
    TRY_MAKE(l->scene = hydra_scene_create(l->host.context));
    live_textures(l, &paint);
    if (!l->gave_up) live_geometry(l, paint);
    if (!l->gave_up) live_lights(l);
    if (l->retry && !l->gave_up && l->failures) (void)hydra_scene_commit(l->scene); /* reports the add that failed */
    if (!l->gave_up) live_render(l);
}

/* Runs a life to its end, or to where it failed for good, and buries it. Returns whether it got to its end. */
static bool live(life *l, const hydra_context_desc *desc) {
    if (!ht_open(&l->host, desc)) {
        assert_int_equal(l->host.memory.blocks_now, 0);
        l->failures++;
        return false;
    }
    l->opened = true;
    live_scene(l);
    hydra_memory_status status = hydra_memory(l->host.context);
    assert_int_equal(status.bytes_now, l->host.memory.bytes_now);
    assert_int_equal(status.allocations_now, l->host.memory.blocks_now);
    hydra_render_destroy(l->second);
    hydra_render_destroy(l->render);
    assert_int_equal(hydra_scene_destroy(l->scene), HYDRA_OK);
    free(l->film);
    ht_close(&l->host);
    return !l->gave_up;
}

/* ---------------------------------------------------------------- failing allocations */

static int64_t calls_of_a_life(uint32_t threads) {
    life l;
    hydra_context_desc desc;
    memset(&l, 0, sizeof l);
    memset(&desc, 0, sizeof desc);
    desc.threads = threads;
    l.wanted = HYDRA_ERROR_OUT_OF_MEMORY;
    assert_true(live(&l, &desc));
    assert_int_equal(l.failures, 0);
    return l.host.memory.calls;
}

/* Every call fails once, and stays failing in the first round: no crash, no leak, the right name, a message.
   In the second round it fails once only and the same call is made again: it must then succeed. */
static void fail_each(uint32_t threads, bool retry) {
    int64_t calls = calls_of_a_life(threads), steps = ht_quick() ? 5 : 1;
    assert_true(calls > 20 && calls < 100000);
    if (calls > 3000) steps *= calls / 3000 + 1;
    for (int64_t n = 1; n <= calls; n += steps) {
        life l;
        hydra_context_desc desc;
        memset(&l, 0, sizeof l);
        memset(&desc, 0, sizeof desc);
        desc.threads = threads;
        l.wanted = HYDRA_ERROR_OUT_OF_MEMORY;
        l.retry = retry;
        l.host.memory.fail_at = n;
        l.host.memory.fail_after = !retry;
        bool finished = live(&l, &desc);
        if (finished != (retry && l.opened)) fail_msg("allocation %d of %d", (int)n, (int)calls);
    }
}

/* Catches: NULL followed, memory lost on the way out, errors without a name, commits that cannot be repeated. */
static void test_every_allocation_fails(void **state) {
    (void)state;
    fail_each(1, false);
    fail_each(3, false);
}

static void test_every_allocation_fails_once(void **state) {
    (void)state;
    fail_each(1, true);
}

/* Catches: a life that takes more every time it is lived in one context. */
static void test_no_growth(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_soup(1, 100), truth_lambert(world.scene, 0.5));
    truth_commit(&world);
    int64_t bytes = 0, blocks = 0;
    for (int i = 0; i < 5; i++) {
        hydra_mesh extra = truth_scene_mesh(world.scene, truth_mesh_soup((uint64_t)i, 100), truth_emitter(world.scene, 0.5, 1));
        hydra_light_desc lamp = truth_light(HYDRA_LIGHT_POINT, 1);
        hydra_light light = hydra_scene_add_light(world.scene, &lamp);
        truth_commit(&world);
        hydra_render_desc desc = live_desc();
        hydra_render_destroy(truth_render(world.scene, &desc));
        assert_int_equal(hydra_scene_remove_mesh(world.scene, extra), HYDRA_OK);
        assert_int_equal(hydra_scene_remove_light(world.scene, light), HYDRA_OK);
        truth_commit(&world);
        if (i == 1) bytes = world.host.memory.bytes_now;
        if (i == 1) blocks = world.host.memory.blocks_now;
    }
    assert_int_equal(world.host.memory.blocks_now, blocks);
    TRUTH_WITHIN("growth of bytes", (double)(world.host.memory.bytes_now - bytes), -1e9, 4096); /* slots of gone handles, materials */
    truth_close(&world);
}

/* ---------------------------------------------------------------- caps */

static int64_t peak_of_a_life(void) {
    life l;
    hydra_context_desc desc;
    memset(&l, 0, sizeof l);
    memset(&desc, 0, sizeof desc);
    desc.threads = 1;
    l.wanted = HYDRA_ERROR_MEMORY_CAP;
    assert_true(live(&l, &desc));
    return l.host.memory.bytes_peak;
}

/* Catches: caps that are passed, even for a moment; failures under a cap that bear another name; a cap of just what is
   needed that does not suffice. */
static void test_caps(void **state) {
    (void)state;
    int64_t peak = peak_of_a_life();
    for (int k = 0; k < 64; k++) {
        int64_t cap = k == 0 ? peak : k == 1 ? peak - 1 : peak * k / 64;
        life l;
        hydra_context_desc desc;
        memset(&l, 0, sizeof l);
        memset(&desc, 0, sizeof desc);
        desc.threads = 1;
        desc.memory_cap = (size_t)cap;
        l.wanted = HYDRA_ERROR_MEMORY_CAP;
        bool finished = live(&l, &desc);
        assert_true(l.host.memory.bytes_peak <= cap);
        if (finished != (k == 0)) fail_msg("cap %d of %d", (int)cap, (int)peak);
    }
}

/* The message of a cap has the numbers in it. */
static void test_cap_message(void **state) {
    (void)state;
    hydra_context_desc desc;
    truth_world world;
    memset(&desc, 0, sizeof desc);
    desc.memory_cap = 4000000;
    truth_open_with(&world, &desc);
    truth_commit(&world);
    hydra_render_desc huge = live_desc();
    huge.width = huge.height = 2000;
    assert_null(hydra_render_create(world.scene, &huge));
    assert_non_null(strstr(hydra_error_text(world.context), hydra_result_text(HYDRA_ERROR_MEMORY_CAP)));
    assert_non_null(strstr(hydra_error_text(world.context), "4000000"));
    assert_true(hydra_memory(world.context).bytes_peak <= 4000000);
    truth_close(&world);
}

int hydra_test_memory(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_allocation_fails), cmocka_unit_test(test_every_allocation_fails_once),
        cmocka_unit_test(test_no_growth), cmocka_unit_test(test_caps), cmocka_unit_test(test_cap_message)};
    return cmocka_run_group_tests_name("memory", tests, NULL, NULL);
}
