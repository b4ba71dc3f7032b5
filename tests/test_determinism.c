/* The same bits, whatever the threads, the order of tasks, tiles, steps, interruptions, shares and instruction set. */
#include "truth_helpers.h"

int hydra_test_determinism(void);

#ifdef HT_VULKAN /* still several tiles, none of them whole */
enum { WIDTH = 26, HEIGHT = 18 };
#else
enum { WIDTH = 40, HEIGHT = 26 };
#endif
enum { PIXELS = WIDTH * HEIGHT };
#define ALL_OUTPUTS ((1u << HYDRA_OUTPUT_COUNT) - 1u)

/* A scene with everything that could race or reorder: instances, textures, alpha, glass, metal, many lights, a map. */
static void busy_scene(hydra_scene *scene) {
    static const uint8_t texels[16] = {255, 255, 255, 255, 90, 40, 200, 120, 30, 200, 60, 10, 255, 0, 90, 255};
    static const float sky_texels[3 * 8] = {1, 1, 1, .1f, .2f, .3f, 2, 1, 0, 0, 0, 1, 3, 3, 1, 0, 1, 0, 1, 0, 1, .5f, .5f, .5f};
    hydra_texture_desc texture;
    hydra_material_desc desc;
    hydra_environment_desc sky;
    memset(&texture, 0, sizeof texture);
    texture.texels = texels;
    texture.width = texture.height = 2;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
    desc.base_color_texture = hydra_scene_add_texture(scene, &texture);
    desc.base_color[0] = desc.base_color[1] = desc.base_color[2] = 0.9f;
    desc.roughness = 0.5f;
    desc.metallic = 0.3f;
    desc.alpha_mode = HYDRA_ALPHA_BLEND;
    truth_scene_mesh(scene, truth_mesh_quad(truth_v(0, -1, 0), truth_v(0, 0, 3), truth_v(3, 0, 0), 3), hydra_scene_add_material(scene, &desc));
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_DIELECTRIC;
    desc.roughness = 0.2f;
    truth_scene_mesh(scene, truth_mesh_sphere(truth_v(0.8, -0.3, 0), 0.6, 2, false), hydra_scene_add_material(scene, &desc));
    desc.kind = HYDRA_MATERIAL_CONDUCTOR;
    desc.base_color[0] = 0.9f;
    truth_mesh soup = truth_mesh_soup(3, 200);
    hydra_mesh_desc mesh = truth_mesh_desc(&soup, hydra_scene_add_material(scene, &desc));
    mesh.instanced_only = true;
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = hydra_scene_add_mesh(scene, &mesh);
    truth_mesh_free(&soup);
    for (int i = 0; i < 4; i++) {
        float place[12] = {0.8f, 0, 0.1f, -1.6f + 0.5f * (float)i, 0.2f, 0.7f, 0, -0.6f, 0, 0, i % 2 ? -0.6f : 0.9f, -1};
        memcpy(instance.transform, place, sizeof place);
        instance.material = i == 2 ? truth_emitter(scene, 0.5, 0.7) : instance.material;
        hydra_scene_add_instance(scene, &instance);
    }
    for (int i = 0; i < 12; i++) {
        hydra_light_desc light = truth_light((hydra_light_kind)(i % 5), 0.5 + i);
        truth_store(light.position, truth_v(2 * sin(i), 2, 2 * cos(i)));
        truth_store(light.axis_u, truth_v(0.2, 0, 0));
        truth_store(light.axis_v, truth_v(0, 0, 0.1));
        light.radius = 0.15f;
        hydra_scene_add_light(scene, &light);
    }
    memset(&sky, 0, sizeof sky);
    sky.texels = sky_texels;
    sky.width = 4;
    sky.height = 2;
    hydra_scene_set_environment(scene, &sky);
}

static hydra_render_desc busy_desc(uint32_t samples) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(truth_v(0.3, 0.7, 4), truth_v(0, -0.3, 0), 0.9);
    desc.sensor.kind = HYDRA_SENSOR_THIN_LENS;
    desc.sensor.lens_radius = 0.03f;
    desc.width = WIDTH;
    desc.height = HEIGHT;
    desc.outputs = ALL_OUTPUTS;
    desc.max_samples = samples;
    return desc;
}

/* All outputs of a picture, one after the other. */
typedef struct pixels_of {
    unsigned char bytes[HYDRA_OUTPUT_COUNT][12 * PIXELS];
} pixels_of;

static pixels_of *read_all(hydra_render *render) {
    pixels_of *all = (pixels_of *)calloc(1, sizeof *all);
    assert_non_null(all);
    for (int o = 0; o < HYDRA_OUTPUT_COUNT; o++) assert_int_equal(hydra_render_read(render, (hydra_output)o, all->bytes[o], 0), HYDRA_OK);
    return all;
}

static bool same_bits(const pixels_of *a, const pixels_of *b, bool tell) {
    for (int o = 0; o < HYDRA_OUTPUT_COUNT; o++) {
        size_t differ = 0;
        for (size_t i = 0; i < sizeof a->bytes[o] / 4; i++) differ += memcmp(&a->bytes[o][4 * i], &b->bytes[o][4 * i], 4) != 0;
        if (differ && tell) print_error("output %d: %u of %u words differ\n", o, (unsigned)differ, (unsigned)(sizeof a->bytes[o] / 4));
        if (differ) return false;
    }
    return true;
}

static pixels_of *picture(const hydra_context_desc *context, const hydra_render_desc *desc) {
    truth_world world;
    truth_open_with(&world, context);
    busy_scene(world.scene);
    truth_commit(&world);
    hydra_render *render = truth_render(world.scene, desc);
    pixels_of *all = read_all(render);
    hydra_render_destroy(render);
    truth_close(&world);
    return all;
}

static hydra_context_desc with_threads(uint32_t threads) {
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.threads = threads;
    return desc;
}

static void expect_same(const pixels_of *reference, pixels_of *other) {
    bool same = same_bits(reference, other, true);
    free(other);
    assert_true(same);
}

/* ---------------------------------------------------------------- threads */

/* Catches: sums in the order of arrival, samples that depend on the worker, builds that race. */
static void test_thread_counts(void **state) {
    (void)state;
    static const uint32_t counts[] = {2, 3, 7};
    for (int adaptive = 0; adaptive < 2; adaptive++) {
        hydra_render_desc desc = busy_desc(adaptive ? 256 : 16);
        desc.target_error = adaptive ? 0.2f : 0;
        hydra_context_desc one = with_threads(1);
        pixels_of *reference = picture(&one, &desc);
        for (int i = 0; i < 3; i++) {
            hydra_context_desc many = with_threads(counts[i]);
            expect_same(reference, picture(&many, &desc));
        }
        free(reference);
    }
}

static void backwards(void *user, uint32_t count, void (*task)(void *argument, uint32_t index), void *argument) {
    *(uint32_t *)user += 1;
    for (uint32_t i = count; i-- > 0;) task(argument, i);
}

/* Catches: tasks that rely on their order, or a caller's job system that is not used. */
static void test_callers_threads(void **state) {
    (void)state;
    uint32_t calls = 0;
    hydra_render_desc desc = busy_desc(16);
    hydra_context_desc plain = with_threads(1), reversed = with_threads(3);
    reversed.parallel_for = backwards;
    reversed.parallel_user = &calls;
    pixels_of *reference = picture(&plain, &desc);
    expect_same(reference, picture(&reversed, &desc));
    assert_int_not_equal(calls, 0);
    free(reference);
}

/* Catches: traversal in SIMD that finds other hits than the scalar one. */
static void test_instruction_sets(void **state) {
    (void)state;
#ifdef HT_VULKAN
    print_message("not on a device: the processor's instruction sets trace no rays of its renders\n");
    skip();
#endif
    hydra_render_desc desc = busy_desc(16);
    hydra_context_desc scalar = with_threads(2);
    scalar.isa = HYDRA_ISA_SCALAR;
    pixels_of *reference = picture(&scalar, &desc);
    for (int isa = HYDRA_ISA_AUTO; isa <= HYDRA_ISA_NEON; isa++) {
        hydra_context_desc other = with_threads(2);
        other.isa = (hydra_isa)isa;
        hydra_context *context = hydra_create(&other);
        if (!context) continue; /* this machine or build lacks it */
        if (isa != HYDRA_ISA_AUTO) assert_int_equal(hydra_context_isa(context), isa);
        assert_int_equal(hydra_destroy(context), HYDRA_OK);
        expect_same(reference, picture(&other, &desc));
    }
    free(reference);
}

/* ---------------------------------------------------------------- tiles, steps, seeds */

/* Catches: samples that depend on the tile or on where a step ended. Without a target the tile size decides nothing. */
static void test_tiles_and_steps(void **state) {
    (void)state;
    hydra_context_desc context = with_threads(2);
    hydra_render_desc desc = busy_desc(16);
    pixels_of *reference = picture(&context, &desc);
    desc.tile_size = 8;
    expect_same(reference, picture(&context, &desc));
    desc.step_seconds = 1e-9;
    expect_same(reference, picture(&context, &desc));
    desc.tile_size = 16;
    expect_same(reference, picture(&context, &desc));
    desc.step_seconds = 1000;
    expect_same(reference, picture(&context, &desc));
    free(reference);
}

/* Catches: stops that depend on time. With a target, every step length gives the same bits. */
static void test_adaptive_steps(void **state) {
    (void)state;
    hydra_context_desc context = with_threads(2);
    hydra_render_desc desc = busy_desc(512);
    desc.target_error = 0.1f;
    desc.step_seconds = 1000;
    pixels_of *reference = picture(&context, &desc);
    desc.step_seconds = 1e-9;
    expect_same(reference, picture(&context, &desc));
    free(reference);
}

/* Catches: a seed that does nothing, or that changes what is not random. */
static void test_seeds(void **state) {
    (void)state;
    hydra_context_desc context = with_threads(2);
    hydra_render_desc desc = busy_desc(16);
    pixels_of *reference = picture(&context, &desc);
    for (uint32_t seed = 1; seed < 0xf0000000u; seed = seed * 31 + 7) {
        desc.seed = seed;
        pixels_of *other = picture(&context, &desc);
        assert_false(same_bits(reference, other, false));
        assert_memory_equal(reference->bytes[HYDRA_SAMPLES], other->bytes[HYDRA_SAMPLES], 4 * PIXELS);
        free(other);
        if (seed > 1000) break;
    }
    free(reference);
}

/* Catches: commits that depend on how the scene came to be: rebuilt after edits that are undone. */
static void test_recommit(void **state) {
    (void)state;
    hydra_context_desc context = with_threads(2);
    hydra_render_desc desc = busy_desc(8);
    pixels_of *reference = picture(&context, &desc);
    truth_world world;
    truth_open_with(&world, &context);
    busy_scene(world.scene);
    hydra_mesh extra = truth_scene_mesh(world.scene, truth_mesh_soup(9, 50), truth_emitter(world.scene, 0.5, 1));
    truth_commit(&world);
    assert_int_equal(hydra_scene_remove_mesh(world.scene, extra), HYDRA_OK);
    truth_commit(&world);
    hydra_render *render = truth_render(world.scene, &desc);
    expect_same(reference, read_all(render));
    hydra_render_destroy(render);
    truth_close(&world);
    free(reference);
}

/* ---------------------------------------------------------------- films: shares, merges, resumes */

typedef struct film {
    void *bytes;
    size_t size;
} film;

static film save(hydra_render *render) {
    film f;
    assert_int_equal(hydra_render_save(render, NULL, &f.size), HYDRA_OK);
    f.bytes = malloc(f.size);
    assert_non_null(f.bytes);
    assert_int_equal(hydra_render_save(render, f.bytes, &f.size), HYDRA_OK);
    return f;
}

static film share(hydra_scene *scene, hydra_render_desc desc, uint32_t first, uint32_t last) {
    desc.first_sample = first;
    desc.max_samples = last;
    hydra_render *render = truth_render(scene, &desc);
    film f = save(render);
    hydra_render_destroy(render);
    return f;
}

static void open_busy(truth_world *world) {
    truth_open(world);
    busy_scene(world->scene);
    truth_commit(world);
}

/* Sample ranges [0,2), [2,16), [16,40), [40,64), rendered apart; each in turn takes in the others, in both directions.
   Catches: sums that depend on their grouping (floating point is not associative), ids that are not the first sample's. */
static void test_sample_shares(void **state) {
    (void)state;
    static const uint32_t cuts[] = {0, 2, 16, 40, 64};
    truth_world world;
    open_busy(&world);
    hydra_render_desc desc = busy_desc(64);
    hydra_render *whole = truth_render(world.scene, &desc);
    pixels_of *reference = read_all(whole);
    film films[4];
    for (int i = 0; i < 4; i++) films[i] = share(world.scene, desc, cuts[i], cuts[i + 1]);
    for (int order = 0; order < 8; order++) {
        int mine = order & 3;
        hydra_render_desc part = desc;
        part.first_sample = cuts[mine];
        part.max_samples = cuts[mine + 1];
        hydra_render *sum = truth_render(world.scene, &part);
        for (int i = 1; i < 4; i++) {
            int other = (mine + (order & 4 ? 4 - i : i)) & 3;
            TRUTH_RESULT(world.context, hydra_render_merge(sum, films[other].bytes, films[other].size), HYDRA_OK);
        }
        assert_int_equal(hydra_render_step(sum), HYDRA_OK); /* nothing is left to do */
        expect_same(reference, read_all(sum));
        hydra_render_destroy(sum);
    }
    for (int i = 0; i < 4; i++) free(films[i].bytes);
    hydra_render_destroy(whole);
    free(reference);
    truth_close(&world);
}

/* Catches: the same samples counted twice; films of another picture accepted; damaged films accepted. On each error
   the render stays as it was. */
static void test_merge_errors(void **state) {
    (void)state;
    truth_world world;
    open_busy(&world);
    hydra_render_desc desc = busy_desc(16), other = desc;
    hydra_render *render = truth_render(world.scene, &desc);
    pixels_of *reference = read_all(render);
    film same = save(render), overlap = share(world.scene, desc, 14, 20);
    other.seed = 5;
    film seeded = share(world.scene, other, 16, 20);
    other = desc;
    other.sensor.fov_y = 0.9001f;
    film turned = share(world.scene, other, 16, 20);
    other = desc;
    other.width = WIDTH + 1;
    film wider = share(world.scene, other, 16, 20);
    TRUTH_RESULT(world.context, hydra_render_merge(render, same.bytes, same.size), HYDRA_ERROR_FILM_OVERLAP);
    TRUTH_RESULT(world.context, hydra_render_merge(render, overlap.bytes, overlap.size), HYDRA_ERROR_FILM_OVERLAP);
    TRUTH_RESULT(world.context, hydra_render_merge(render, seeded.bytes, seeded.size), HYDRA_ERROR_FILM_MISMATCH);
    TRUTH_RESULT(world.context, hydra_render_merge(render, turned.bytes, turned.size), HYDRA_ERROR_FILM_MISMATCH);
    TRUTH_RESULT(world.context, hydra_render_merge(render, wider.bytes, wider.size), HYDRA_ERROR_FILM_MISMATCH);
    TRUTH_RESULT(world.context, hydra_render_merge(render, same.bytes, 0), HYDRA_ERROR_FILM_FORMAT);
    TRUTH_RESULT(world.context, hydra_render_merge(render, same.bytes, 3), HYDRA_ERROR_FILM_FORMAT);
    TRUTH_RESULT(world.context, hydra_render_merge(render, same.bytes, same.size - 1), HYDRA_ERROR_FILM_FORMAT);
    TRUTH_RESULT(world.context, hydra_render_merge(render, NULL, 10), HYDRA_ERROR_NULL);
    ((unsigned char *)overlap.bytes)[0] ^= 1;
    TRUTH_RESULT(world.context, hydra_render_merge(render, overlap.bytes, overlap.size), HYDRA_ERROR_FILM_FORMAT);
    size_t little = same.size - 1;
    TRUTH_RESULT(world.context, hydra_render_save(render, same.bytes, &little), HYDRA_ERROR_BUFFER);
    expect_same(reference, read_all(render));
    hydra_render_destroy(render);
    /* every byte of a film damaged in turn (or one in a thousand, or five): never a crash, and the render stays usable */
    desc.max_samples = 32;
    film good = share(world.scene, desc, 16, 32);
    for (size_t at = 0; at < good.size; at += at < 256 ? 1 : ht_pick(997, 4993)) {
        render = hydra_render_create(world.scene, &desc);
        ((unsigned char *)good.bytes)[at] ^= 0x55;
        hydra_result result = hydra_render_merge(render, good.bytes, good.size);
        ((unsigned char *)good.bytes)[at] ^= 0x55;
        assert_true(result == HYDRA_OK || result == HYDRA_ERROR_FILM_FORMAT || result == HYDRA_ERROR_FILM_MISMATCH);
        hydra_render_destroy(render);
    }
    free(same.bytes);
    free(overlap.bytes);
    free(seeded.bytes);
    free(turned.bytes);
    free(wider.bytes);
    free(good.bytes);
    free(reference);
    truth_close(&world);
}

/* Interrupted after a few steps, saved, merged into a fresh render and gone on, again and again.
   Catches: state that lives outside the film: adaptation, sample counters, sampler state. */
static void resume(float target, uint32_t samples, uint32_t tile) {
    truth_world world;
    open_busy(&world);
    hydra_render_desc desc = busy_desc(samples);
    desc.target_error = target;
    desc.tile_size = tile;
    hydra_render *whole = truth_render(world.scene, &desc);
    pixels_of *reference = read_all(whole);
    desc.step_seconds = 1e-9;
    hydra_render *piece = hydra_render_create(world.scene, &desc);
    int stops = 0;
    while (hydra_render_step(piece) == HYDRA_MORE) {
        assert_true(++stops < 100000); /* it must get on, however often it is stopped */
        if (stops % 3) continue;
        film f = save(piece);
        hydra_render_destroy(piece);
        piece = hydra_render_create(world.scene, &desc);
        assert_non_null(piece);
        TRUTH_RESULT(world.context, hydra_render_merge(piece, f.bytes, f.size), HYDRA_OK);
        free(f.bytes);
    }
    assert_true(stops > 3);
    expect_same(reference, read_all(piece));
    film a = save(whole), b = save(piece);
    assert_int_equal(a.size, b.size);
    assert_memory_equal(a.bytes, b.bytes, a.size); /* "the same bytes on every machine" */
    free(a.bytes);
    free(b.bytes);
    hydra_render_destroy(piece);
    hydra_render_destroy(whole);
    free(reference);
    truth_close(&world);
}

static void test_resume(void **state) {
    (void)state;
    resume(0, 32, 16);
    resume(0, 32, 8);
    resume(0.2f, 256, 16);
    resume(0.1f, 256, 8);
}

/* Disjoint regions of one frame, rendered by different processes, merged into the whole frame. Catches: tiles that know
   of each other. Regions on tile borders, as the merge contract asks. With a target, regions may differ from the whole
   (each judges by its own brightness), but not between orders of merging. */
static void test_region_shares(void **state) {
    (void)state;
    for (int adaptive = 0; adaptive < 2; adaptive++) {
        truth_world world;
        open_busy(&world);
        hydra_render_desc desc = busy_desc(adaptive ? 128 : 16);
        desc.tile_size = 8;
        desc.target_error = adaptive ? 0.2f : 0;
        hydra_render *whole = truth_render(world.scene, &desc);
        pixels_of *reference = read_all(whole);
        static const uint32_t parts[3][4] = {{0, 0, 16, HEIGHT}, {16, 0, WIDTH - 16, 8}, {16, 8, WIDTH - 16, HEIGHT - 8}};
        for (int order = 0; order < 3; order++) {
            hydra_render *sum = hydra_render_create(world.scene, &desc);
            for (int i = 0; i < 3; i++) {
                hydra_render_desc part = desc;
                memcpy(part.region, parts[(i + order) % 3], sizeof part.region);
                hydra_render *render = truth_render(world.scene, &part);
                film f = save(render);
                TRUTH_RESULT(world.context, hydra_render_merge(sum, f.bytes, f.size), HYDRA_OK);
                free(f.bytes);
                hydra_render_destroy(render);
            }
            assert_int_equal(hydra_render_step(sum), HYDRA_OK);
            pixels_of *merged = read_all(sum);
            hydra_render_destroy(sum);
            if (adaptive && order == 0) {
                free(reference);
                reference = merged;
            } else {
                expect_same(reference, merged);
            }
        }
        hydra_render_destroy(whole);
        free(reference);
        truth_close(&world);
    }
}

/* Cancelled, read, gone on: the same bits in the end. Catches: cancel that loses or repeats samples. */
static void test_cancel(void **state) {
    (void)state;
    truth_world world;
    open_busy(&world);
    hydra_render_desc desc = busy_desc(32);
    hydra_render *whole = truth_render(world.scene, &desc);
    pixels_of *reference = read_all(whole);
    desc.step_seconds = 1e-9; /* so that it is not done in one */
    hydra_render *render = hydra_render_create(world.scene, &desc);
    for (int i = 0; i < 3; i++) {
        hydra_render_cancel(render);
        assert_int_equal(hydra_render_step(render), HYDRA_CANCELLED);
        free(read_all(render)); /* readable, whatever there is */
        hydra_result next = hydra_render_step(render);
        assert_true(next == HYDRA_MORE || next == HYDRA_OK);
    }
    truth_run(render);
    expect_same(reference, read_all(render));
    hydra_render_destroy(render);
    hydra_render_destroy(whole);
    free(reference);
    truth_close(&world);
}

int hydra_test_determinism(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_thread_counts),   cmocka_unit_test(test_callers_threads),
        cmocka_unit_test(test_instruction_sets), cmocka_unit_test(test_tiles_and_steps),
        cmocka_unit_test(test_adaptive_steps),  cmocka_unit_test(test_seeds),
        cmocka_unit_test(test_recommit),        cmocka_unit_test(test_sample_shares),
        cmocka_unit_test(test_merge_errors),    cmocka_unit_test(test_resume),
        cmocka_unit_test(test_region_shares),   cmocka_unit_test(test_cancel)};
    return cmocka_run_group_tests_name("determinism", tests, NULL, NULL);
}
