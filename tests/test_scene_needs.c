/* The scene: alpha, what it requires and what a render of it takes, extremes of scale, place and number. */
#include "truth_helpers.h"

int hydra_test_scene_needs(void);

static void constant_sky(hydra_scene *scene, double radiance) {
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int c = 0; c < 3; c++) sky.color[c] = (float)radiance;
    assert_int_equal(hydra_scene_set_environment(scene, &sky), HYDRA_OK);
}

static hydra_scene_info info_of(hydra_scene *scene) {
    hydra_scene_info info;
    assert_int_equal(hydra_scene_get_info(scene, &info), HYDRA_OK);
    return info;
}

/* ---------------------------------------------------------------- alpha */

/* A quad whose left half is a hole (alpha texture of two texels, u < 1/2: 0), before a glowing wall of radiance 2. */
static void alpha_scene(truth_world *world, hydra_alpha_mode mode, float alpha, bool own_texture) {
    static const uint8_t texels[8] = {0, 255, 255, 0, 255, 255, 255, 255};
    truth_open(world);
    hydra_texture_desc texture;
    memset(&texture, 0, sizeof texture);
    texture.texels = texels;
    texture.width = 2;
    texture.height = 1;
    texture.format = HYDRA_TEXEL_RGBA8_LINEAR;
    texture.wrap_u = texture.wrap_v = HYDRA_WRAP_CLAMP;
    hydra_material_desc sheet;
    memset(&sheet, 0, sizeof sheet);
    sheet.alpha_mode = mode;
    sheet.alpha = alpha;
    if (mode == HYDRA_ALPHA_MASK) {
        hydra_texture made = hydra_scene_add_texture(world->scene, &texture);
        if (own_texture) sheet.alpha_texture = made; /* its red: 0, then 255 */
        else sheet.base_color_texture = made;        /* its alpha: the same */
    }
    truth_scene_mesh(world->scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1), hydra_scene_add_material(world->scene, &sheet));
    truth_scene_mesh(world->scene, truth_mesh_quad(truth_v(0, 0, -1), truth_v(9, 0, 0), truth_v(0, 9, 0), 1), truth_emitter(world->scene, 0, 2));
    truth_commit(world);
}

/* Catches: cut-outs that rays do not see, in queries, pictures and shadows; the wrong channel. */
static void test_alpha_mask(void **state) {
    (void)state;
    for (int own = 0; own < 2; own++) {
        truth_world world;
        alpha_scene(&world, HYDRA_ALPHA_MASK, 0, own != 0);
        hydra_ray rays[2] = {{{-0.5f, 0.1f, 1}, 0, {0, 0, -1}, 1.5f}, {{0.5f, 0.1f, 1}, 0, {0, 0, -1}, 1.5f}};
        hydra_hit hits[2];
        uint8_t blocked[2];
        assert_int_equal(hydra_scene_closest_hits(world.scene, rays, hits, 2), HYDRA_OK);
        assert_int_equal(hydra_scene_any_hits(world.scene, rays, blocked, 2), HYDRA_OK);
        assert_true(hits[0].t < 0 && hits[1].t == 1);
        assert_true(blocked[0] == 0 && blocked[1] == 1);
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(16);
        TRUTH_NEAR("through a hole", truth_radiance(world.scene, truth_v(-0.5, 0.1, 1), truth_v(0, 0, -1), probe).mean, 2, 1e-6);
        TRUTH_WITHIN("at the sheet", truth_radiance(world.scene, truth_v(0.5, 0.1, 1), truth_v(0, 0, -1), probe).mean, 0, 0);
        truth_close(&world);
    }
    /* shadows: a hole lets the light of the wall through, all of it where the sheet is all hole */
    truth_world world;
    alpha_scene(&world, HYDRA_ALPHA_MASK, 0, false);
    truth_v3 wall[4] = {{-9, -9, -1}, {9, -9, -1}, {9, 9, -1}, {-9, 9, -1}}, solid[4] = {{0, -1, 0}, {1, -1, 0}, {1, 1, 0}, {0, 1, 0}};
    truth_v3 point = truth_v(-0.4, 0.2, 0.5), normal = truth_v(0, 0, -1);
    double truth = truth_polygon_irradiance(wall, 4, point, normal, 2) - truth_polygon_irradiance(solid, 4, point, normal, 2);
    for (int strategy = 0; strategy < 3; strategy++) {
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(128);
        probe.strategy = (hydra_strategy)strategy;
        TRUTH_EXPECT("light through a hole", truth_irradiance(world.scene, point, normal, probe), truth, 0.01, 2e-5);
    }
    truth_close(&world);
}

/* Catches: BLEND as an average of colours instead of a share of rays; wrong shares in shadows. */
static void test_alpha_blend(void **state) {
    (void)state;
    truth_world world;
    alpha_scene(&world, HYDRA_ALPHA_BLEND, 0.5f, false);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = truth_samples(256);
    truth_estimate half = truth_radiance(world.scene, truth_v(0.5, 0.1, 1), truth_v(0, 0, -1), probe);
    TRUTH_EXPECT("radiance behind half a sheet", half, 1, 0.01, 1e-5);
    truth_v3 wall[4] = {{-9, -9, -1}, {9, -9, -1}, {9, 9, -1}, {-9, 9, -1}}, sheet[4] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
    truth_v3 point = truth_v(0.1, 0.2, 0.3), normal = truth_v(0, 0, -1);
    double truth = truth_polygon_irradiance(wall, 4, point, normal, 2) - 0.5 * truth_polygon_irradiance(sheet, 4, point, normal, 2);
    for (int strategy = 0; strategy < 3; strategy++) {
        probe.strategy = (hydra_strategy)strategy;
        TRUTH_EXPECT("light through half a sheet", truth_irradiance(world.scene, point, normal, probe), truth, 0.01, 2e-5);
    }
    truth_close(&world);
}

/* ---------------------------------------------------------------- requirements and estimates */

static uint32_t needs_of(void (*build)(hydra_scene *), uint32_t *passes) {
    truth_world world;
    truth_open(&world);
    build(world.scene);
    truth_commit(&world);
    uint32_t needs = hydra_scene_requirements(world.scene);
    hydra_render_desc desc;
    hydra_estimate_result estimate;
    memset(&desc, 0, sizeof desc);
    desc.width = desc.height = 16;
    TRUTH_RESULT(world.context, hydra_estimate(world.scene, &desc, &estimate), HYDRA_OK);
    assert_int_equal(needs & ~estimate.kernel_features, 0); /* the kernel has all that the scene needs */
    *passes = estimate.passes;
    truth_close(&world);
    return needs;
}

static void only_quad(hydra_scene *scene) {
    truth_scene_mesh(scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1), truth_lambert(scene, 0.5));
}
static void with_lamp(hydra_scene *scene) {
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_POINT, 1);
    only_quad(scene);
    hydra_scene_add_light(scene, &lamp);
}
static void with_ball(hydra_scene *scene) {
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 1);
    lamp.radius = 1;
    only_quad(scene);
    hydra_scene_add_light(scene, &lamp);
}
static void with_sun(hydra_scene *scene) {
    hydra_light_desc sun = truth_light(HYDRA_LIGHT_SUN, 1);
    only_quad(scene);
    hydra_scene_add_light(scene, &sun);
}
static void with_sky(hydra_scene *scene) {
    only_quad(scene);
    constant_sky(scene, 1);
}
static void with_map(hydra_scene *scene) {
    static const float texels[6] = {1, 1, 1, 1, 1, 1};
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    sky.texels = texels;
    sky.width = 2;
    sky.height = 1;
    only_quad(scene);
    hydra_scene_set_environment(scene, &sky);
}
static void with_material(hydra_scene *scene, const hydra_material_desc *desc) {
    truth_scene_mesh(scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1), hydra_scene_add_material(scene, desc));
}
static void with_metal(hydra_scene *scene) {
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_CONDUCTOR;
    with_material(scene, &desc);
}
static void with_glass(hydra_scene *scene) {
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_DIELECTRIC;
    desc.absorption[0] = 1;
    with_material(scene, &desc);
}
static void with_textures(hydra_scene *scene) {
    static const uint8_t texel[4] = {255, 255, 255, 255};
    hydra_texture_desc texture;
    hydra_material_desc desc;
    memset(&texture, 0, sizeof texture);
    memset(&desc, 0, sizeof desc);
    texture.texels = texel;
    texture.width = texture.height = 1;
    desc.base_color_texture = desc.normal_texture = hydra_scene_add_texture(scene, &texture);
    desc.alpha_mode = HYDRA_ALPHA_MASK;
    with_material(scene, &desc);
}
static void with_instance(hydra_scene *scene) {
    truth_mesh quad = truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1);
    hydra_material none = {0};
    hydra_mesh_desc desc = truth_mesh_desc(&quad, none);
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = hydra_scene_add_mesh(scene, &desc);
    instance.transform[0] = instance.transform[5] = instance.transform[10] = 2;
    hydra_scene_add_instance(scene, &instance);
    truth_mesh_free(&quad);
}
static void with_unused(hydra_scene *scene) { /* a material that nothing wears is no need */
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_DIELECTRIC;
    hydra_scene_add_material(scene, &desc);
    only_quad(scene);
}

/* Catches: features that cost though they are absent, or that are missing though they are there. */
static void test_requirements(void **state) {
    (void)state;
    static const struct {
        void (*build)(hydra_scene *);
        uint32_t needs, passes, not_passes;
    } cases[] = {
        {only_quad, 0, 0, HYDRA_PASS_SHAPES | HYDRA_PASS_SHADOW},
        {with_unused, 0, 0, HYDRA_PASS_SHAPES | HYDRA_PASS_SHADOW},
        {with_lamp, HYDRA_NEEDS_EMITTERS, HYDRA_PASS_SHADOW, HYDRA_PASS_SHAPES},
        {with_ball, HYDRA_NEEDS_EMITTERS | HYDRA_NEEDS_SHAPES, HYDRA_PASS_SHADOW | HYDRA_PASS_SHAPES, 0},
        {with_sun, HYDRA_NEEDS_SUNS, HYDRA_PASS_SHADOW, HYDRA_PASS_SHAPES},
        {with_sky, HYDRA_NEEDS_ENVIRONMENT, 0, HYDRA_PASS_SHAPES},
        {with_map, HYDRA_NEEDS_ENVIRONMENT | HYDRA_NEEDS_ENVIRONMENT_MAP, HYDRA_PASS_SHADOW, HYDRA_PASS_SHAPES},
        {with_metal, HYDRA_NEEDS_SPECULAR, 0, HYDRA_PASS_SHADOW},
        {with_glass, HYDRA_NEEDS_SPECULAR | HYDRA_NEEDS_TRANSMISSION | HYDRA_NEEDS_ABSORPTION, 0, HYDRA_PASS_SHADOW},
        {with_textures, HYDRA_NEEDS_TEXTURES | HYDRA_NEEDS_NORMAL_MAPS | HYDRA_NEEDS_ALPHA, 0, HYDRA_PASS_SHADOW},
        {with_instance, HYDRA_NEEDS_INSTANCES, 0, HYDRA_PASS_SHADOW}};
    for (unsigned i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint32_t passes = 0, needs = needs_of(cases[i].build, &passes);
        const uint32_t always = HYDRA_PASS_GENERATE | HYDRA_PASS_INTERSECT | HYDRA_PASS_SHADE | HYDRA_PASS_ACCUMULATE;
        if (needs != cases[i].needs) fail_msg("case %u: needs %x, should be %x", i, needs, cases[i].needs);
        if ((passes & always) != always || (passes & cases[i].passes) != cases[i].passes || (passes & cases[i].not_passes))
            fail_msg("case %u: passes %x", i, passes);
    }
}

/* Catches: forecasts that are wrong: the allocator hands out for a render what the estimate said. */
static void test_estimate(void **state) {
    (void)state;
    for (int k = 0; k < 4; k++) {
        truth_world world;
        truth_open(&world);
        if (k % 2) with_ball(world.scene);
        else with_metal(world.scene);
        truth_commit(&world);
        float points[3 * 1024], normals[3 * 1024];
        for (int i = 0; i < 3 * 1024; i++) points[i] = normals[i] = 1;
        hydra_render_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.width = k < 2 ? 100 : 32;
        desc.height = k < 2 ? 70 : 32;
        desc.outputs = k == 1 ? (1u << HYDRA_OUTPUT_COUNT) - 1 : 0;
        if (k >= 2) desc.sensor = truth_sensor_points(points, normals, 1024);
        hydra_estimate_result e;
        TRUTH_RESULT(world.context, hydra_estimate(world.scene, &desc, &e), HYDRA_OK);
        int64_t before = world.host.memory.bytes_now;
        hydra_render *render = hydra_render_create(world.scene, &desc);
        assert_non_null(render);
        truth_run(render);
        hydra_status status = hydra_render_status(render);
        int64_t taken = world.host.memory.bytes_now - before;
        size_t parts = e.bytes_film + e.bytes_lanes + e.bytes_sensor; /* the rest is the render's own record */
        assert_true(e.bytes_total >= parts && e.bytes_total - parts < 8192);
        assert_int_equal(status.bytes_film, e.bytes_film);
        assert_int_equal(status.bytes_lanes, e.bytes_lanes);
#ifdef HT_VULKAN /* and the backend's own records, which stay with the context where they are of kernels */
        assert_in_range(taken - (int64_t)e.bytes_total, 0, 64 * 1024);
#else
        assert_int_equal(taken, e.bytes_total);
#endif
        if (k < 2) assert_int_equal(e.bytes_sensor, 0);
        else assert_true(e.bytes_sensor >= 24 * 1024);
        hydra_render_destroy(render);
#ifdef HT_VULKAN
        assert_in_range(world.host.memory.bytes_now - before, 0, 64 * 1024);
#else
        assert_int_equal(world.host.memory.bytes_now, before);
#endif
        truth_close(&world);
    }
}

/* ---------------------------------------------------------------- extremes */

/* Catches: an empty scene that crashes, or shows something else than the sky; bounds of nothing. */
static void test_empty(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_commit(&world);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = 2;
    TRUTH_WITHIN("nothing", truth_radiance(world.scene, truth_v(0, 0, 0), truth_v(1, 1, 1), probe).mean, 0, 0);
    hydra_scene_info info = info_of(world.scene);
    for (int i = 0; i < 3; i++) assert_true(info.bounds_min[i] == 0 && info.bounds_max[i] == 0);
    constant_sky(world.scene, 0.7);
    truth_commit(&world);
    TRUTH_NEAR("the sky", truth_radiance(world.scene, truth_v(0, 0, 0), truth_v(1, 1, 1), probe).mean, (double)0.7f, 1e-6);
    hydra_hit hit;
    hydra_ray ray = {{0, 0, 0}, 0, {1, 0, 0}, INFINITY};
    assert_int_equal(hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_OK);
    assert_true(hit.t < 0);
    truth_close(&world);
}

/* A convex mirror ball and a Lambert ball in a furnace of radiance 1: all pixels show 1 or 0.5-lit shades; here the
   picture is compared with itself at another place and size. */
static truth_estimate placed_picture(double scale, double offset) {
    truth_world world;
    truth_open(&world);
    truth_pose pose = truth_pose_identity();
    pose.x = truth_v(scale, 0, 0);
    pose.y = truth_v(0, scale, 0);
    pose.z = truth_v(0, 0, scale);
    pose.scale = scale;
    pose.origin = truth_mul(truth_v(1, -0.7, 0.4), offset * scale);
    truth_mesh box = truth_mesh_box(truth_v(0, 0, 0), truth_v(1, 1, 1), true), ball = truth_mesh_sphere(truth_v(0.2, -0.5, 0.1), 0.5, 3, false);
    truth_mesh_pose(&box, &pose);
    truth_mesh_pose(&ball, &pose);
    hydra_material_desc metal;
    memset(&metal, 0, sizeof metal);
    metal.kind = HYDRA_MATERIAL_CONDUCTOR;
    metal.base_color[0] = 0.9f;
    metal.roughness = 0.4f;
    truth_scene_mesh(world.scene, box, truth_lambert(world.scene, 0.6));
    truth_scene_mesh(world.scene, ball, hydra_scene_add_material(world.scene, &metal));
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_RECT, 4);
    truth_store(lamp.position, truth_pose_point(&pose, truth_v(0, 0.9, 0)));
    truth_store(lamp.axis_u, truth_pose_vector(&pose, truth_v(0.5, 0, 0)));
    truth_store(lamp.axis_v, truth_pose_vector(&pose, truth_v(0, 0, 0.5)));
    hydra_scene_add_light(world.scene, &lamp);
    truth_commit(&world);
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(truth_pose_point(&pose, truth_v(-0.3, 0.1, 0.9)), truth_pose_point(&pose, truth_v(0, -0.4, 0)), 1);
    desc.width = desc.height = 32;
    desc.max_samples = truth_samples(64);
    desc.outputs = 1u << HYDRA_COVERAGE;
    hydra_render *render = truth_render(world.scene, &desc);
    float *rgb = truth_read(render, HYDRA_RADIANCE, 1024), *error = truth_read(render, HYDRA_ERROR, 1024);
    float *coverage = truth_read(render, HYDRA_COVERAGE, 1024);
    truth_estimate e = {0, 0};
    for (int i = 0; i < 1024; i++) {
        assert_true(coverage[i] == 1); /* a closed box: nothing slips through */
        e.mean += (double)rgb[3 * i] / 1024;
        e.error += pow((double)error[3 * i] / 1024, 2);
    }
    e.error = sqrt(e.error);
    free(rgb);
    free(error);
    free(coverage);
    hydra_render_destroy(render);
    truth_close(&world);
    return e;
}

/* Catches: absolute epsilons. Scales are exact; at 1e4 sizes from the origin vertices move by 6e-4 of the box's size
   at most, which shades by less than 0.3 %. */
static void test_scale_and_place(void **state) {
    (void)state;
    static const double places[][2] = {{1e-6, 0}, {1e-3, 0}, {1e3, 0}, {1e6, 0}, {1, 100}, {1, 1e4}, {1e-4, 1e4}};
    truth_estimate reference = placed_picture(1, 0);
    TRUTH_WITHIN("error of the reference", reference.error / reference.mean, 0, truth_bound(0.005));
    for (int i = 0; i < 7; i++) {
        truth_estimate e = placed_picture(places[i][0], places[i][1]);
        e.error = hypot(e.error, reference.error);
        TRUTH_EXPECT("picture at another scale and place", e, reference.mean, 0.01, places[i][1] > 1000 ? 0.003 : 1e-4);
    }
}

/* Catches: 10,000 emitters that slow down, run out of indices, or add up to something else. */
static void test_many_emitters(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    ht_rng rng = ht_rng_make(2);
    double truth = 0;
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 400);
    lamp.radius = 0.0003f;
    for (int i = 0; i < 5000; i++) {
        truth_v3 p = truth_v(4 * truth_rng_unit(&rng) - 2, 1 + truth_rng_unit(&rng), 4 * truth_rng_unit(&rng) - 2);
        truth_store(lamp.position, p);
        assert_int_not_equal(hydra_scene_add_light(world.scene, &lamp).id, 0);
        truth += 400 * TRUTH_PI * 0.0003 * 0.0003 * p.y / pow(truth_length(p), 3);
    }
    /* 5,000 glowing triangles in a plane, facing down: 2 x 50 x 50 */
    truth_v3 corners[4] = {{-2, 3, -2}, {2, 3, -2}, {2, 3, 2}, {-2, 3, 2}};
    truth += truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 1, 0), 0.01);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 3, 0), truth_v(2, 0, 0), truth_v(0, 0, 2), 50), truth_emitter(world.scene, 0, 0.01));
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).emitters, 10000);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = truth_samples(256);
    /* lamps shade each other and the plane by about the share of the sky they cover: 1e-4 */
    TRUTH_EXPECT("10,000 emitters", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 1, 0), probe), truth, 0.01, 1e-3);
    truth_close(&world);
}

int hydra_test_scene_needs(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_alpha_mask),
                                       cmocka_unit_test(test_alpha_blend),
                                       cmocka_unit_test(test_requirements),
                                       cmocka_unit_test(test_estimate),
                                       cmocka_unit_test(test_empty),
                                       cmocka_unit_test(test_scale_and_place),
                                       cmocka_unit_test(test_many_emitters)};
    return cmocka_run_group_tests_name("scene: needs", tests, NULL, NULL);
}
