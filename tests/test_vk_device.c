/* Devices: which there are, which one is taken, devices and queues of the caller's own, what they lack, and what a
   context on one leaves behind. */
#include "vk_helpers.h"

#include <pthread.h>

int hydra_test_vk_device(void);

enum { side = 16, pixels = side * side, ray_count = 200 };

/* ---- a small scene: some triangles under a square of light */

typedef struct small_scene {
    hydra_scene *scene;
    hydra_render *render;
} small_scene;

static hydra_scene *small_commit(hydra_context *context) {
    ht_rng rng = ht_rng_make(3);
    ht_mesh soup = ht_soup(&rng, 60, 1, 0.6f);
    hydra_light_desc light = {.kind = HYDRA_LIGHT_RECT, .color = {9, 8, 7}, .position = {0, 3, 0}, .axis_u = {1, 0, 0}, .axis_v = {0, 0, 1}};
    hydra_scene *scene = hydra_scene_create(context);
    assert_non_null(scene);
    hydra_mesh_desc mesh = ht_mesh_desc(&soup, (hydra_material){0});
    (void)hydra_scene_add_mesh(scene, &mesh);
    ht_mesh_free(&soup);
    (void)hydra_scene_add_light(scene, &light);
    ht_ok(context, hydra_scene_commit(scene));
    return scene;
}

static small_scene small_make(hydra_context *context) {
    small_scene s;
    hydra_render_desc desc = {.width = side, .height = side, .max_samples = 16, .sensor = {.position = {0, 0.5f, 4}}, .max_depth = 3};
    s.scene = small_commit(context);
    s.render = hydra_render_create(s.scene, &desc);
    if (!s.render) fail_msg("%s", hydra_error_text(context));
    return s;
}

static void small_free(small_scene *s) {
    hydra_render_destroy(s->render);
    assert_int_equal(hydra_scene_destroy(s->scene), HYDRA_OK);
}

static void small_rays(hydra_context *context, const hydra_scene *scene, hydra_hit hits[ray_count]) {
    ht_rng rng = ht_rng_make(4);
    hydra_ray rays[ray_count];
    memset(rays, 0, sizeof rays);
    for (int i = 0; i < ray_count; i++) {
        ht_direction(&rng, rays[i].direction);
        rays[i].t_max = INFINITY;
    }
    ht_ok(context, hydra_scene_closest_hits(scene, rays, hits, ray_count));
}

static void small_cast(hydra_context *context, hydra_hit hits[ray_count]) {
    hydra_scene *scene = small_commit(context);
    small_rays(context, scene, hits);
    assert_int_equal(hydra_scene_destroy(scene), HYDRA_OK);
}

/* Everything that a context does, in a nutshell. */
static void small_run(hydra_context *context, float radiance[3 * pixels], hydra_hit hits[ray_count]) {
    small_scene s = small_make(context);
    ht_ok(context, ht_finish(s.render));
    ht_ok(context, hydra_render_read(s.render, HYDRA_RADIANCE, radiance, 0));
    small_rays(context, s.scene, hits);
    small_free(&s);
}

/* What it gives on the library's own device: made once. */
static float own_radiance[3 * pixels];
static hydra_hit own_hits[ray_count];

static void make_own(void) {
    static bool made;
    vkt_host h;
    if (made) return;
    made = true;
    small_run(vkt_open(&h, NULL, 1), own_radiance, own_hits);
    vkt_close(&h);
}

/* Rays alone, of a context that need not show more: one pipeline. */
static void expect_small_rays(hydra_context *context) {
    hydra_hit hits[ray_count];
    make_own();
    small_cast(context, hits);
    assert_memory_equal(hits, own_hits, sizeof hits);
}

static void expect_small_run(hydra_context *context) {
    float radiance[3 * pixels];
    hydra_hit hits[ray_count];
    make_own();
    small_run(context, radiance, hits);
    assert_memory_equal(radiance, own_radiance, sizeof radiance);
    assert_memory_equal(hits, own_hits, sizeof hits);
}

/* ---- lists */

static void test_list(void **state) {
    (void)state;
    uint32_t count = 77, room;
    assert_int_equal(hydra_vk_list_devices(NULL, NULL, &count), HYDRA_OK);
    assert_true(count >= 1 && count < 77);
    hydra_vk_device_info infos[8];
    memset(infos, 0xee, sizeof infos);
    room = count < 8 ? count : 8;
    uint32_t told = room;
    assert_int_equal(hydra_vk_list_devices(NULL, infos, &told), HYDRA_OK);
    assert_int_equal(told, count);
    for (uint32_t i = 0; i < room; i++) {
        assert_true(infos[i].name[0] && infos[i].type >= HYDRA_VK_DEVICE_DISCRETE && infos[i].type <= HYDRA_VK_DEVICE_CPU);
        assert_true(infos[i].memory > 0 && infos[i].binding_most >= 1u << 27);
    }
    assert_int_equal(hydra_vk_list_devices(NULL, infos, NULL), HYDRA_ERROR_NULL);
    /* Without room, none is written and the count is told. */
    hydra_vk_device_info before = infos[0];
    told = 0;
    assert_int_equal(hydra_vk_list_devices(NULL, infos, &told), HYDRA_OK);
    assert_int_equal(told, count);
    assert_memory_equal(&before, infos, sizeof before);
}

/* The loader is there and has no driver: an empty list, not an error; and contexts say why there is none. */
static void test_no_device(void **state) {
    (void)state;
    for (uint32_t way = 1; way <= 2; way++) {
        vkt_spy_begin();
        vkt_spied.no_devices = way;
        hydra_vk_desc desc = vkt_spy_desc();
        hydra_vk_device_info info;
        uint32_t count = 1;
        assert_int_equal(hydra_vk_list_devices(&desc, &info, &count), HYDRA_OK);
        assert_int_equal(count, 0);
        vkt_host h;
        memset(&h, 0, sizeof h);
        assert_int_equal(vkt_try(&h, &desc, 1), HYDRA_ERROR_DEVICE);
        assert_null(h.host.context);
        assert_non_null(strstr(h.error, "device"));
        if (way == 1) assert_non_null(strstr(h.error, "no device"));
        vkt_expect_clean(&h);
        assert_null(vkt_spied.last_instance);
    }
}

/* ---- choice */

static const vkt_pretence five[5] = {
    {.name = "slow cpu", .type = VK_PHYSICAL_DEVICE_TYPE_CPU},
    {.name = "large discrete", .type = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, .no_float64 = true},
    {.name = "thrifty integrated", .type = VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU},
    {.name = "cloud virtual", .type = VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU},
    {.name = "thrifty integrated two", .type = VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU}};

static hydra_vk_desc pretend(const vkt_pretence *pretences, uint32_t count) {
    vkt_spy_begin();
    memcpy(vkt_spied.pretences, pretences, count * sizeof *pretences);
    vkt_spied.pretended = count;
    return vkt_spy_desc();
}

static void expect_choice(uint32_t number, const char *name, hydra_vk_device_type type, const char *chosen) {
    vkt_host h;
    hydra_vk_desc desc = pretend(five, 5);
    desc.device_number = number;
    desc.device_name = name;
    desc.device_type = type;
    hydra_vk_info info = vkt_info(vkt_open(&h, &desc, 1));
    assert_string_equal(info.name, chosen);
    vkt_close(&h);
}

static void expect_no_choice(uint32_t number, const char *name, hydra_vk_device_type type, const char *text) {
    vkt_host h;
    memset(&h, 0, sizeof h);
    hydra_vk_desc desc = pretend(five, 5);
    desc.device_number = number;
    desc.device_name = name;
    desc.device_type = type;
    assert_int_equal(vkt_try(&h, &desc, 1), HYDRA_ERROR_DEVICE);
    assert_null(h.host.context);
    if (!strstr(h.error, text)) fail_msg("\"%s\" does not say \"%s\"", h.error, text);
    vkt_expect_clean(&h);
    assert_null(vkt_spied.last_instance);
}

/* By number, by a part of the name, by type, by several of these; the best that lacks nothing where nothing is asked. */
static void test_choice(void **state) {
    (void)state;
    expect_choice(0, NULL, HYDRA_VK_DEVICE_ANY, "thrifty integrated");
    expect_choice(1, NULL, HYDRA_VK_DEVICE_ANY, "slow cpu");
    expect_choice(5, NULL, HYDRA_VK_DEVICE_ANY, "thrifty integrated two");
    expect_choice(0, "two", HYDRA_VK_DEVICE_ANY, "thrifty integrated two");
    expect_choice(0, "thrifty", HYDRA_VK_DEVICE_INTEGRATED, "thrifty integrated");
    expect_choice(0, NULL, HYDRA_VK_DEVICE_VIRTUAL, "cloud virtual");
    expect_choice(0, NULL, HYDRA_VK_DEVICE_CPU, "slow cpu");
    expect_choice(4, "virtual", HYDRA_VK_DEVICE_VIRTUAL, "cloud virtual");
    expect_no_choice(6, NULL, HYDRA_VK_DEVICE_ANY, "none of the 5 devices");
    expect_no_choice(0, "Thrifty", HYDRA_VK_DEVICE_ANY, "none of the 5 devices");
    expect_no_choice(1, NULL, HYDRA_VK_DEVICE_VIRTUAL, "none of the 5 devices");
    expect_no_choice(0, NULL, HYDRA_VK_DEVICE_DISCRETE, "large discrete lacks shaderFloat64");
    expect_no_choice(2, NULL, HYDRA_VK_DEVICE_ANY, "large discrete lacks shaderFloat64");
}

static void expect_lacks(vkt_pretence as, const char *text) {
    vkt_host h;
    as.name = "poor device";
    memset(&h, 0, sizeof h);
    hydra_vk_desc desc = pretend(&as, 1);
    hydra_vk_device_info info;
    uint32_t count = 1;
    assert_int_equal(hydra_vk_list_devices(&desc, &info, &count), HYDRA_OK);
    assert_string_equal(info.lacks, text);
    assert_int_equal(vkt_try(&h, &desc, 1), HYDRA_ERROR_DEVICE);
    if (!strstr(h.error, "poor device lacks") || !strstr(h.error, text)) fail_msg("\"%s\" does not say that it lacks %s", h.error, text);
    vkt_expect_clean(&h);
    assert_null(vkt_spied.last_instance);
}

/* What is missing has a name, with the number that there is. */
static void test_lacks(void **state) {
    (void)state;
    expect_lacks((vkt_pretence){.no_float64 = true}, "shaderFloat64");
    expect_lacks((vkt_pretence){.no_ballot = true}, "subgroup ballot in compute shaders");
    expect_lacks((vkt_pretence){.no_compute = true}, "a queue with compute");
    expect_lacks((vkt_pretence){.api_version = VK_API_VERSION_1_1}, "Vulkan 1.2 (it has 1.1)");
    expect_lacks((vkt_pretence){.storage_buffers = 16}, "31 storage buffers a stage (it has 16)");
    expect_lacks((vkt_pretence){.group_most = 32}, "workgroups of 64");
}

/* A loader or a driver without one of the functions: creation says so or does without, and never calls it. */
static void test_hidden_functions(void **state) {
    (void)state;
    static char names[128][56];
    vkt_host h;
    vkt_spy_begin();
    hydra_vk_desc desc = vkt_spy_desc();
    (void)vkt_open(&h, &desc, 1);
    vkt_close(&h);
    uint32_t count = vkt_spied.asked_count, refused = 0;
    assert_true(count > 50);
    memcpy(names, vkt_spied.asked, sizeof names);
    for (uint32_t i = 0; i < count; i++) {
        vkt_spy_begin();
        vkt_spied.hidden = names[i];
        memset(&h, 0, sizeof h);
        hydra_result result = vkt_try(&h, &desc, 1);
        if (result == HYDRA_OK) { /* not needed for this */
            assert_int_equal(hydra_destroy(h.host.context), HYDRA_OK);
        } else {
            refused++;
            assert_int_equal(result, HYDRA_ERROR_DEVICE);
            assert_null(h.host.context);
            if (strlen(h.error) < strlen(hydra_result_text(result)) + 4) fail_msg("without %s: \"%s\"", names[i], h.error);
        }
        assert_int_equal(h.host.memory.blocks_now, 0);
        vkt_spy_clear_up();
    }
    assert_true(refused + 4 > count);
}

/* The loader knows nothing at all. */
static PFN_vkVoidFunction VKAPI_CALL know_nothing(VkInstance instance, const char *name) {
    (void)instance;
    (void)name;
    return NULL;
}

static void test_loader_that_knows_nothing(void **state) {
    (void)state;
    vkt_host h;
    hydra_vk_desc desc;
    memset(&desc, 0, sizeof desc);
    memset(&h, 0, sizeof h);
    desc.get_instance_proc_addr = know_nothing;
    assert_int_equal(vkt_try(&h, &desc, 1), HYDRA_ERROR_DEVICE);
    assert_true(strlen(h.error) > 20);
    vkt_expect_clean(&h);
    uint32_t count = 5;
    assert_int_equal(hydra_vk_list_devices(&desc, NULL, &count), HYDRA_ERROR_DEVICE);
    assert_int_equal(count, 0);
    /* The message is cut to what there is room for, with its zero, and nothing beyond. */
    char text[8] = "1234567";
    desc.error = text;
    desc.error_size = 4;
    hydra_context *context;
    assert_int_equal(hydra_vk_create(NULL, &desc, &context), HYDRA_ERROR_DEVICE);
    assert_null(context);
    assert_true(strlen(text) == 3 && text[4] == '5');
    assert_int_equal(hydra_vk_create(NULL, &desc, NULL), HYDRA_ERROR_NULL);
}

/* ---- the caller's own */

typedef struct queue_lock {
    pthread_mutex_t mutex;
    int64_t taken, given;
} queue_lock;

static void take_queue(void *user) {
    queue_lock *lock = (queue_lock *)user;
    pthread_mutex_lock(&lock->mutex);
    lock->taken++;
}

static void give_queue(void *user) {
    queue_lock *lock = (queue_lock *)user;
    lock->given++;
    pthread_mutex_unlock(&lock->mutex);
}

/* Instance, device and queue of the caller, with a lock and counted allocations: the pictures are the same, locks and
   allocations balance, and the device lives on. */
static void test_own_device(void **state) {
    (void)state;
    vkt_counted counted;
    vkt_own own;
    vkt_host h;
    queue_lock lock = {PTHREAD_MUTEX_INITIALIZER, 0, 0};
    vkt_count_allocations(&counted);
    vkt_own_open(&own, &counted.callbacks);
    int64_t calls = counted.calls;
    hydra_vk_desc desc = vkt_own_desc(&own);
    desc.lock_queue = take_queue;
    desc.unlock_queue = give_queue;
    desc.lock_user = &lock;
    expect_small_run(vkt_open(&h, &desc, 1));
    assert_true(lock.taken == (int64_t)vkt_info(h.host.context).submissions && lock.taken > 1);
    vkt_close(&h);
    assert_int_equal(lock.taken, lock.given);
    assert_true(counted.calls > calls);
    vkt_buffer buffer = vkt_make_buffer(&own, 64); /* it lives */
    vkt_free_buffer(&own, &buffer);
    vkt_own_close(&own); /* the layer names what the library left alive; drivers keep some blocks until then */
    assert_int_equal(counted.blocks_now, 0);
}

/* An instance and a physical device of the caller, the device of the library; and allocations counted on all of its own. */
static void test_own_instance(void **state) {
    (void)state;
    vkt_counted counted;
    vkt_own own;
    vkt_host h;
    vkt_own_open(&own, NULL);
    hydra_vk_desc desc = vkt_own_desc(&own);
    desc.device = VK_NULL_HANDLE;
    desc.queue = VK_NULL_HANDLE;
    expect_small_rays(vkt_open(&h, &desc, 1));
    vkt_close(&h);
    uint32_t count = 0;
    assert_int_equal(hydra_vk_list_devices(&desc, NULL, &count), HYDRA_OK);
    assert_true(count >= 1);
    vkt_own_close(&own);

    vkt_count_allocations(&counted);
    memset(&desc, 0, sizeof desc);
    desc.allocation = &counted.callbacks;
    expect_small_rays(vkt_open(&h, &desc, 1));
    assert_true(counted.blocks_now > 0);
    vkt_close(&h);
    assert_int_equal(counted.blocks_now, 0);
}

/* Some of what belongs together is not enough. */
static void test_own_in_part(void **state) {
    (void)state;
    vkt_own own;
    vkt_own_open(&own, NULL);
    for (int without = 0; without < 5; without++) {
        vkt_host h;
        memset(&h, 0, sizeof h);
        hydra_vk_desc desc = vkt_own_desc(&own);
        if (without == 0) desc.queue = VK_NULL_HANDLE;
        if (without == 1) desc.device = VK_NULL_HANDLE;
        if (without == 2) desc.physical_device = VK_NULL_HANDLE;
        if (without == 3) desc.instance = VK_NULL_HANDLE;
        if (without == 4) desc.instance = VK_NULL_HANDLE, desc.device = VK_NULL_HANDLE, desc.queue = VK_NULL_HANDLE;
        assert_int_equal(vkt_try(&h, &desc, 1), HYDRA_ERROR_NULL);
        assert_non_null(strstr(h.error, "of yours needs"));
        vkt_expect_clean(&h);
    }
    vkt_own_close(&own);
}

/* ---- into a buffer of the caller's */

/* Every output, at an offset, rows apart: the bytes that hydra_render_read gives, and none beside them is touched. */
static void test_render_write(void **state) {
    (void)state;
    vkt_own own;
    vkt_host h;
    vkt_own_open(&own, NULL);
    hydra_vk_desc desc = vkt_own_desc(&own);
    small_scene s;
    s.scene = small_commit(vkt_open(&h, &desc, 1));
    hydra_render_desc all = {.width = 13, .height = 9, .region = {2, 1, 9, 7}, .max_samples = 4, .sensor = {.position = {0, 0.5f, 4}}};
    all.outputs = ((1u << HYDRA_OUTPUT_COUNT) - 1) & ~(1u << HYDRA_IRRADIANCE); /* a set of which kernels are needed elsewhere too */
    s.render = hydra_render_create(s.scene, &all);
    assert_non_null(s.render);
    ht_ok(h.host.context, ht_finish(s.render));
    enum { row_most = 9 * 12, stride = row_most + 8, offset = 20, size = offset + 7 * stride };
    vkt_buffer to = vkt_make_buffer(&own, size + 32);
    for (int output = 0; output < HYDRA_OUTPUT_COUNT; output++) {
        for (int tight = 0; tight < 2 && output != HYDRA_IRRADIANCE; tight++) {
            unsigned char expected[size + 32];
            size_t row = 9 * hydra_output_size((hydra_output)output), apart = tight ? row : stride;
            unsigned char *read = (unsigned char *)malloc(row * 7);
            memset(expected, 0xab, sizeof expected);
            memset(to.bytes, 0xab, sizeof expected);
            ht_ok(h.host.context, hydra_render_read(s.render, (hydra_output)output, read, 0));
            for (size_t y = 0; y < 7; y++) memcpy(expected + offset + y * apart, read + y * row, row);
            free(read);
            ht_ok(h.host.context, hydra_vk_render_write(s.render, (hydra_output)output, to.buffer, offset, tight ? 0 : stride));
            assert_memory_equal(to.bytes, expected, sizeof expected);
        }
    }
    memset(to.bytes, 0xab, size);
    assert_int_equal(hydra_vk_render_write(NULL, HYDRA_RADIANCE, to.buffer, 0, 0), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_RADIANCE, VK_NULL_HANDLE, 0, 0), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_RADIANCE, to.buffer, 2, 0), HYDRA_ERROR_STRIDE);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_RADIANCE, to.buffer, 0, 9 * 12 - 4), HYDRA_ERROR_STRIDE);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_RADIANCE, to.buffer, 0, 9 * 12 + 2), HYDRA_ERROR_STRIDE);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_OUTPUT_COUNT, to.buffer, 0, 0), HYDRA_ERROR_ENUM);
    hydra_render *plain = hydra_render_create(s.scene, &(hydra_render_desc){.width = 4, .height = 4});
    assert_non_null(plain);
    assert_int_equal(hydra_vk_render_write(plain, HYDRA_DEPTH, to.buffer, 0, 0), HYDRA_ERROR_OUTPUT);
    hydra_render_destroy(plain);
    for (size_t i = 0; i < size; i++) assert_int_equal(to.bytes[i], 0xab);
    small_free(&s);
    vkt_close(&h);
    vkt_free_buffer(&own, &to);
    vkt_own_close(&own);
}

/* A context of the processor has none of this, and says so. */
static void test_not_a_device_context(void **state) {
    (void)state;
    vkt_host h;
    hydra_vk_info info;
    size_t size = 0;
    small_scene s = small_make(vkt_open_cpu(&h, 1));
    assert_int_equal(hydra_vk_get_info(h.host.context, &info), HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_vk_get_info(NULL, &info), HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_vk_save_pipelines(h.host.context, NULL, &size), HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_vk_render_write(s.render, HYDRA_RADIANCE, (VkBuffer)(uintptr_t)64, 0, 0), HYDRA_ERROR_HANDLE);
    small_free(&s);
    vkt_close(&h);
}

/* ---- pipelines kept */

static void test_pipeline_cache(void **state) {
    (void)state;
    vkt_host h;
    hydra_vk_desc desc;
    float radiance[3 * pixels];
    hydra_hit hits[ray_count];
    size_t size = 0, told;
    small_run(vkt_open(&h, NULL, 1), radiance, hits);
    assert_int_equal(hydra_vk_save_pipelines(h.host.context, NULL, NULL), HYDRA_ERROR_NULL);
    ht_ok(h.host.context, hydra_vk_save_pipelines(h.host.context, NULL, &size));
    assert_true(size >= 32); /* its head, at least */
    char *cache = (char *)malloc(size);
    told = size - 1;
    assert_int_equal(hydra_vk_save_pipelines(h.host.context, cache, &told), HYDRA_ERROR_BUFFER);
    assert_int_equal(told, size);
    ht_ok(h.host.context, hydra_vk_save_pipelines(h.host.context, cache, &size));
    hydra_vk_info info = vkt_info(h.host.context);
    assert_true(info.pipelines > 3 && info.seconds_pipelines > 0 && info.seconds_start > 0 && info.submissions > 0);
    assert_true(info.slice_mean > 0 && info.slice_longest >= info.slice_mean && info.bytes_now > 0 && info.bytes_peak >= info.bytes_now && !info.lost);
    vkt_close(&h);
    /* As saved, cut off, and something else altogether. */
    for (int kind = 0; kind < 3; kind++) {
        memset(&desc, 0, sizeof desc);
        if (kind == 2)
            for (size_t i = 0; i < size; i++) cache[i] = (char)(i * 37);
        desc.pipeline_cache = cache;
        desc.pipeline_cache_size = kind == 1 ? 20 : size;
        (void)vkt_open(&h, &desc, 1);
        if (kind) memset(cache, 0, 20); /* read during the call only */
        if (kind) expect_small_rays(h.host.context);
        else expect_small_run(h.host.context);
        vkt_close(&h);
    }
    free(cache);
}

/* ---- several at once */

typedef struct one_of_two {
    vkt_host h;
    bool processor;
    float radiance[3 * pixels];
    hydra_hit hits[ray_count];
} one_of_two;

static void *run_one(void *argument) {
    one_of_two *one = (one_of_two *)argument;
    small_run(one->h.host.context, one->radiance, one->hits);
    return NULL;
}

/* Two contexts of a device and one of the processor, each in a thread of its own. */
static void test_contexts_side_by_side(void **state) {
    (void)state;
    static one_of_two all[3];
    pthread_t threads[3];
    make_own();
    for (int i = 0; i < 3; i++) {
        if (i == 2)
            vkt_open_cpu(&all[i].h, 1);
        else
            vkt_open(&all[i].h, NULL, 1 + (uint32_t)i);
    }
    for (int i = 0; i < 3; i++) assert_int_equal(pthread_create(&threads[i], NULL, run_one, &all[i]), 0);
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);
    for (int i = 0; i < 3; i++) {
        assert_memory_equal(all[i].hits, own_hits, sizeof own_hits);
        if (i < 2) assert_memory_equal(all[i].radiance, own_radiance, sizeof own_radiance);
        vkt_close(&all[i].h);
    }
}

typedef struct asker {
    const hydra_scene *scene;
    uint32_t seed;
    uint32_t wrong;
} asker;

/* Rays in calls of many sizes, closest and any by turns; the truth is what a first call said. */
static void *ask_over_and_over(void *argument) {
    asker *a = (asker *)argument;
    ht_rng rng = ht_rng_make(a->seed);
    hydra_ray rays[ray_count];
    hydra_hit first[ray_count], again[ray_count];
    uint8_t occluded[ray_count];
    memset(rays, 0, sizeof rays);
    for (int i = 0; i < ray_count; i++) {
        ht_direction(&rng, rays[i].direction);
        rays[i].t_max = INFINITY;
    }
    if (hydra_scene_closest_hits(a->scene, rays, first, ray_count) != HYDRA_OK) a->wrong++;
    for (uint32_t round = 0; round < 40; round++) {
        uint32_t n = 1 + ht_below(&rng, ray_count);
        if (hydra_scene_closest_hits(a->scene, rays, again, n) != HYDRA_OK || memcmp(first, again, n * sizeof *again) != 0) a->wrong++;
        if (hydra_scene_any_hits(a->scene, rays, occluded, n) != HYDRA_OK) a->wrong++;
        for (uint32_t i = 0; i < n; i++) a->wrong += occluded[i] != (first[i].t >= 0);
    }
    return NULL;
}

/* Three threads cast rays on one context while a fourth renders. */
static void test_threads_on_one_context(void **state) {
    (void)state;
    vkt_host h;
    asker askers[3];
    pthread_t threads[3];
    float radiance[3 * pixels];
    make_own();
    small_scene s = small_make(vkt_open(&h, NULL, 2));
    for (uint32_t i = 0; i < 3; i++) {
        askers[i] = (asker){s.scene, 50 + i, 0};
        assert_int_equal(pthread_create(&threads[i], NULL, ask_over_and_over, &askers[i]), 0);
    }
    ht_ok(h.host.context, ht_finish(s.render));
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);
    for (int i = 0; i < 3; i++) assert_int_equal(askers[i].wrong, 0);
    ht_ok(h.host.context, hydra_render_read(s.render, HYDRA_RADIANCE, radiance, 0));
    assert_memory_equal(radiance, own_radiance, sizeof radiance);
    small_free(&s);
    vkt_close(&h);
}

int hydra_test_vk_device(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_list),
        cmocka_unit_test(test_no_device),
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_lacks),
        cmocka_unit_test(test_hidden_functions),
        cmocka_unit_test(test_loader_that_knows_nothing),
        cmocka_unit_test(test_own_device),
        cmocka_unit_test(test_own_instance),
        cmocka_unit_test(test_own_in_part),
        cmocka_unit_test(test_render_write),
        cmocka_unit_test(test_not_a_device_context),
        cmocka_unit_test(test_pipeline_cache),
        cmocka_unit_test(test_contexts_side_by_side),
        cmocka_unit_test(test_threads_on_one_context),
    };
    return cmocka_run_group_tests_name("vk_device", tests, NULL, NULL);
}
