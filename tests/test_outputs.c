/* Every hydra_output on scenes whose answers are known: components that add up, ids, depths of misses, coverage,
   samples, validity, and how buffers are written. */
#include "truth_helpers.h"

int hydra_test_outputs(void);

#define BIT(output) (1u << (output))

static hydra_render_desc picture(truth_v3 eye, truth_v3 target, double fov, uint32_t size, uint32_t samples, uint32_t outputs) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(eye, target, fov);
    desc.width = desc.height = size;
    desc.max_samples = samples;
    desc.outputs = outputs;
    return desc;
}

static void constant_sky(hydra_scene *scene, double radiance) {
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int c = 0; c < 3; c++) sky.color[c] = (float)radiance;
    assert_int_equal(hydra_scene_set_environment(scene, &sky), HYDRA_OK);
}

static hydra_material mirror(hydra_scene *scene) {
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_MATERIAL_CONDUCTOR;
    desc.base_color[0] = desc.base_color[1] = desc.base_color[2] = 1;
    return hydra_scene_add_material(scene, &desc);
}

/* Catches: sizes that do not fit what is written. */
static void test_sizes(void **state) {
    (void)state;
    static const size_t sizes[HYDRA_OUTPUT_COUNT] = {12, 12, 12, 12, 12, 12, 12, 12, 12, 4, 4, 4, 4, 4, 4, 4, 4};
    for (int o = 0; o < HYDRA_OUTPUT_COUNT; o++) assert_int_equal(hydra_output_size((hydra_output)o), sizes[o]);
    assert_int_equal(hydra_output_size(HYDRA_OUTPUT_COUNT), 0);
    assert_int_equal(hydra_output_size((hydra_output)1000), 0);
}

/* ---------------------------------------------------------------- a coloured square before a constant sky */

typedef struct square_scene {
    truth_world world;
    hydra_mesh mesh;
    hydra_material material;
    hydra_render *render;
} square_scene;

/* The square covers the left half of the picture, to 0.25 pixels right of its middle. */
static void open_square(square_scene *s) {
    truth_open(&s->world);
    constant_sky(s->world.scene, 2);
    hydra_material_desc paint;
    memset(&paint, 0, sizeof paint);
    paint.base_color[0] = 0.2f;
    paint.base_color[1] = 0.5f;
    paint.base_color[2] = 0.8f;
    truth_lambert(s->world.scene, 0.1); /* so that the id of the next is not the first */
    s->material = hydra_scene_add_material(s->world.scene, &paint);
    double pixel = 2 * tan(0.25) * 3 / 16;
    s->mesh = truth_scene_mesh(s->world.scene, truth_mesh_quad(truth_v(-10 + 0.25 * pixel, 0, -3), truth_v(10, 0, 0), truth_v(0, 10, 0), 1), s->material);
    truth_commit(&s->world);
    hydra_render_desc desc = picture(truth_v(0, 0, 0), truth_v(0, 0, -1), 0.5, 16, 64, BIT(HYDRA_OUTPUT_COUNT) - 1);
    s->render = truth_render(s->world.scene, &desc);
}

static void close_square(square_scene *s) {
    hydra_render_destroy(s->render);
    truth_close(&s->world);
}

/* Left half (hit) and right half (missed) of an RGB output hold these values in every pixel. */
static void expect_halves(square_scene *s, hydra_output output, const double left[3], const double right[3], double slack) {
    float *rgb = truth_read(s->render, output, 256);
    for (size_t p = 0; p < 256; p++) {
        if (p % 16 == 8) continue; /* the column of the edge */
        for (size_t c = 0; c < 3; c++) {
            double truth = p % 16 < 8 ? left[c] : right[c];
            TRUTH_WITHIN("pixel of an output", (double)rgb[3 * p + c], truth - slack, truth + slack);
        }
    }
    free(rgb);
}

/* Catches: wrong colours, albedo or normals; irradiance without pi; a sky that is not "direct". A plane under a
   constant sky has no noise beyond that of light sampling, for which 5 % a pixel is allowed. */
static void test_colours(void **state) {
    (void)state;
    static const double none[3] = {0, 0, 0}, sky[3] = {2, 2, 2}, paint[3] = {0.2, 0.5, 0.8}, front[3] = {0, 0, 1};
    static const double lit[3] = {0.4, 1, 1.6}, e[3] = {2 * TRUTH_PI, 2 * TRUTH_PI, 2 * TRUTH_PI};
    square_scene s;
    open_square(&s);
    expect_halves(&s, HYDRA_ALBEDO, paint, none, 1e-6);
    expect_halves(&s, HYDRA_NORMAL, front, none, 1e-6);
    expect_halves(&s, HYDRA_RADIANCE, lit, sky, 0.08);
    expect_halves(&s, HYDRA_DIRECT, lit, sky, 0.08);
    expect_halves(&s, HYDRA_IRRADIANCE, e, none, 0.35);
    expect_halves(&s, HYDRA_INDIRECT, none, none, 0);
    expect_halves(&s, HYDRA_CAUSTIC, none, none, 0);
    close_square(&s);
}

/* Catches: misses that count into depth or position, or are not infinite; coverage of edges. */
static void test_coverage_and_depth(void **state) {
    (void)state;
    square_scene s;
    open_square(&s);
    float *coverage = truth_read(s.render, HYDRA_COVERAGE, 256), *depth = truth_read(s.render, HYDRA_DEPTH, 256);
    float *position = truth_read(s.render, HYDRA_POSITION, 256);
    for (size_t p = 0; p < 256; p++) {
        double share = p % 16 < 8 ? 1 : p % 16 == 8 ? 0.25 : 0;
        TRUTH_WITHIN("coverage", (double)coverage[p], share - 0.04, share + 0.04);
        if (p % 16 != 8) assert_true((double)coverage[p] == share);
        if (share > 0) TRUTH_WITHIN("depth", (double)depth[p], 3, 3 / cos(0.4));
        else assert_true((double)depth[p] > DBL_MAX / 2 || depth[p] > FLT_MAX);
        if (share > 0) TRUTH_NEAR("plane of positions", (double)position[3 * p + 2], -3, 1e-5);
    }
    free(coverage);
    free(depth);
    free(position);
    close_square(&s);
}

static void expect_words(hydra_render *render, hydra_output output, uint32_t left, uint32_t right) {
    uint32_t *words = truth_read_words(render, output, 256);
    for (size_t p = 0; p < 256; p++) {
        if (p % 16 != 8) assert_int_equal(words[p], p % 16 < 8 ? left : right);
        else assert_true(words[p] == left || words[p] == right);
    }
    free(words);
}

/* Catches: ids off by one, of misses, or mixed up. */
static void test_ids(void **state) {
    (void)state;
    square_scene s;
    open_square(&s);
    expect_words(s.render, HYDRA_MESH_ID, s.mesh.id, 0);
    expect_words(s.render, HYDRA_MATERIAL_ID, s.material.id, 0);
    expect_words(s.render, HYDRA_INSTANCE_ID, 0, 0);
    expect_words(s.render, HYDRA_SAMPLES, 64, 64);
    expect_words(s.render, HYDRA_VALIDITY, HYDRA_VALID_SAMPLED, HYDRA_VALID_SAMPLED);
    uint32_t *triangle = truth_read_words(s.render, HYDRA_PRIMITIVE_ID, 256);
    for (size_t p = 0; p < 256; p++)
        if (p % 16 != 8) assert_true(p % 16 < 8 ? triangle[p] < 2 : triangle[p] == HYDRA_NONE);
    free(triangle);
    close_square(&s);
}

/* Catches: instance ids, overriding materials, per-triangle materials and light shapes in the id outputs. */
static void test_instance_ids(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_material a = truth_lambert(world.scene, 0.1), b = truth_lambert(world.scene, 0.2), c = truth_lambert(world.scene, 0.3);
    hydra_material sides[2];
    sides[0] = a; /* below the diagonal of a quad */
    sides[1] = b;
    truth_mesh quad = truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1);
    hydra_mesh_desc desc = truth_mesh_desc(&quad, a);
    desc.instanced_only = true;
    desc.triangle_materials.data = sides;
    desc.triangle_materials.count = 2;
    hydra_mesh mesh = hydra_scene_add_mesh(world.scene, &desc);
    truth_mesh_free(&quad);
    hydra_instance made[2];
    for (int i = 0; i < 2; i++) {
        static const float places[2][12] = {{1, 0, 0, -1.5f, 0, 1, 0, 0, 0, 0, 1, 0}, {1, 0, 0, 1.5f, 0, 1, 0, 0, 0, 0, 1, 0}};
        hydra_instance_desc instance;
        memset(&instance, 0, sizeof instance);
        instance.mesh = mesh;
        memcpy(instance.transform, places[i], sizeof instance.transform);
        if (i) instance.material = c;
        made[i] = hydra_scene_add_instance(world.scene, &instance);
    }
    hydra_light_desc ball = truth_light(HYDRA_LIGHT_SPHERE, 1);
    ball.radius = 0.2f;
    hydra_scene_add_light(world.scene, &ball);
    truth_commit(&world);
    /* pixels: upper left and lower right of the left quad, the ball, the right quad, a miss */
    static const double x[5] = {-2.2, -0.8, 0, 1.5, 0}, y[5] = {0.7, -0.7, 0, 0.1, 3};
    hydra_ray rays[5];
    for (int i = 0; i < 5; i++) {
        truth_store(rays[i].origin, truth_v(x[i], y[i], 5));
        truth_store(rays[i].direction, truth_v(0, 0, -1));
        rays[i].t_min = 0;
        rays[i].t_max = INFINITY;
    }
    hydra_render_desc shot = picture(truth_v(0, 0, 0), truth_v(0, 0, 1), 0, 1, 2, BIT(HYDRA_OUTPUT_COUNT) - 1);
    shot.sensor.kind = HYDRA_SENSOR_RAYS;
    shot.sensor.rays.data = rays;
    shot.sensor.rays.count = 5;
    shot.width = 5;
    hydra_render *render = truth_render(world.scene, &shot);
    uint32_t *m = truth_read_words(render, HYDRA_MATERIAL_ID, 5), *i = truth_read_words(render, HYDRA_INSTANCE_ID, 5);
    uint32_t *p = truth_read_words(render, HYDRA_PRIMITIVE_ID, 5), *g = truth_read_words(render, HYDRA_MESH_ID, 5);
    const uint32_t materials[5] = {b.id, a.id, 0, c.id, 0}, instances[5] = {made[0].id, made[0].id, 0, made[1].id, 0};
    for (int k = 0; k < 5; k++) {
        assert_int_equal(m[k], materials[k]);
        assert_int_equal(i[k], instances[k]);
        assert_int_equal(g[k], instances[k] ? mesh.id : 0);
    }
    assert_int_equal(p[0], 1);
    assert_int_equal(p[1], 0);
    assert_int_equal(p[2], HYDRA_NONE);
    assert_int_equal(p[4], HYDRA_NONE);
    free(m);
    free(i);
    free(p);
    free(g);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* ---------------------------------------------------------------- components */

/* The three components add to the radiance in every pixel and channel. Each is a float mean of at most 1e3 samples
   kept with compensation, so 4 roundings of a float: 3e-7, and 1e-6 is allowed. */
static void expect_sum(hydra_render *render, size_t pixels) {
    float *all = truth_read(render, HYDRA_RADIANCE, pixels), *direct = truth_read(render, HYDRA_DIRECT, pixels);
    float *indirect = truth_read(render, HYDRA_INDIRECT, pixels), *caustic = truth_read(render, HYDRA_CAUSTIC, pixels);
    for (size_t i = 0; i < 3 * pixels; i++) {
        double sum = (double)direct[i] + (double)indirect[i] + (double)caustic[i];
        TRUTH_WITHIN("sum of components", sum, (double)all[i] * (1 - 1e-6), (double)all[i] * (1 + 1e-6));
    }
    free(all);
    free(direct);
    free(indirect);
    free(caustic);
}

static double mean_of(hydra_render *render, hydra_output output, size_t pixels, double *error) {
    float *rgb = truth_read(render, output, pixels);
    truth_estimate e = truth_estimate_channel(rgb, pixels, 1);
    free(rgb);
    if (error) *error = e.error;
    return e.mean;
}

/* Catches: events counted wrongly. In the furnace of albedo and emission 1/2, what is seen and once scattered is
   3/4 of the light, the rest is indirect, and nothing is a caustic. */
static void test_components_of_furnace(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_box(truth_v(0, 0, 0), truth_v(1, 1, 1), true), truth_emitter(world.scene, 0.5, 0.5));
    truth_commit(&world);
    hydra_render_desc desc = picture(truth_v(0, 0, 0), truth_v(1, 0.2, 0.3), 1, 16, truth_samples(128),
                                     BIT(HYDRA_DIRECT) | BIT(HYDRA_INDIRECT) | BIT(HYDRA_CAUSTIC));
    hydra_render *render = truth_render(world.scene, &desc);
    truth_estimate e;
    e.mean = mean_of(render, HYDRA_DIRECT, 256, &e.error);
    TRUTH_EXPECT("direct", e, 0.75, 0.003, 1e-5);
    e.mean = mean_of(render, HYDRA_INDIRECT, 256, &e.error);
    TRUTH_EXPECT("indirect", e, 0.25, 0.006, 1e-5);
    TRUTH_WITHIN("caustic", mean_of(render, HYDRA_CAUSTIC, 256, NULL), 0, 0);
    expect_sum(render, 256);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* A room with a lamp and, if asked, a mirror and a glass ball. */
static void room(hydra_scene *scene, bool speculars) {
    truth_scene_mesh(scene, truth_mesh_box(truth_v(0, 0, 0), truth_v(1, 1, 1), true), truth_lambert(scene, 0.7));
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_RECT, 5);
    truth_store(lamp.position, truth_v(0, 0.99, 0));
    truth_store(lamp.axis_u, truth_v(0.3, 0, 0));
    truth_store(lamp.axis_v, truth_v(0, 0, 0.3));
    hydra_scene_add_light(scene, &lamp);
    if (!speculars) return;
    hydra_material_desc glass;
    memset(&glass, 0, sizeof glass);
    glass.kind = HYDRA_MATERIAL_DIELECTRIC;
    truth_scene_mesh(scene, truth_mesh_sphere(truth_v(0.4, -0.6, 0.1), 0.35, 3, false), hydra_scene_add_material(scene, &glass));
    truth_scene_mesh(scene, truth_mesh_sphere(truth_v(-0.4, -0.6, -0.3), 0.35, 3, false), mirror(scene));
}

/* Catches: paths that fall between the components or into two; caustics without speculars; none with them. */
static void test_components_of_room(void **state) {
    (void)state;
    for (int speculars = 0; speculars < 2; speculars++) {
        truth_world world;
        truth_open(&world);
        room(world.scene, speculars != 0);
        truth_commit(&world);
        hydra_render_desc desc = picture(truth_v(0, 0, 0.99), truth_v(0, -0.2, 0), 1.2, 32, 64,
                                         BIT(HYDRA_DIRECT) | BIT(HYDRA_INDIRECT) | BIT(HYDRA_CAUSTIC));
        hydra_render *render = truth_render(world.scene, &desc);
        expect_sum(render, 1024);
        double caustic = mean_of(render, HYDRA_CAUSTIC, 1024, NULL);
        if (speculars) TRUTH_WITHIN("caustics of a mirror and a ball", caustic, 1e-3, 10);
        else TRUTH_WITHIN("caustics without speculars", caustic, 0, 0);
        assert_true(mean_of(render, HYDRA_INDIRECT, 1024, NULL) > 0.01);
        hydra_render_destroy(render);
        truth_close(&world);
    }
}

/* A lamp over a black-backed mirror: a Lambert point gets the lamp directly and, as a caustic, its image.
   Catches: D S L counted as direct, S D L counted as caustic. */
static void test_components_with_mirror(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(9, 0, 0), truth_v(0, 9, 0), 1), mirror(world.scene));
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(3, 0, 2), truth_v(0, 0, 2), truth_v(0, 3, 0), 1), truth_lambert(world.scene, 0.5));
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 4);
    truth_store(lamp.position, truth_v(0, 0, 1.5));
    lamp.radius = 0.5f;
    hydra_scene_add_light(world.scene, &lamp);
    truth_commit(&world);
    truth_v3 point = truth_v(3, 0.1, 1.2), normal = truth_v(-1, 0, 0);
    truth_v3 real = truth_sub(truth_v(0, 0, 1.5), point), image = truth_sub(truth_v(0, 0, -1.5), point);
    double direct = 4 * TRUTH_PI * 0.25 * truth_dot(real, normal) / pow(truth_length(real), 3);
    double caustic = 4 * TRUTH_PI * 0.25 * truth_dot(image, normal) / pow(truth_length(image), 3);
    /* the same wall, seen from its front: straight, and in the mirror */
    static const truth_v3 eyes[2] = {{1, 0.1, 3}, {1, 0.1, 3}}, targets[2] = {{3, 0.1, 1.2}, {3, 0.1, -1.2}};
    for (int seen = 0; seen < 2; seen++) {
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(256);
        probe.output = HYDRA_DIRECT;
        truth_v3 look = truth_sub(targets[seen], eyes[seen]);
        TRUTH_EXPECT("lamp on the wall", truth_radiance(world.scene, eyes[seen], look, probe), 0.5 / TRUTH_PI * direct, 0.01, 2e-5);
        probe.output = HYDRA_CAUSTIC;
        TRUTH_EXPECT("lamp by the mirror on the wall", truth_radiance(world.scene, eyes[seen], look, probe), 0.5 / TRUTH_PI * caustic, 0.05, 2e-5);
    }
    truth_close(&world);
}

/* Catches: irradiance that is not pi radiance / albedo on Lambert, or not 0 on a mirror. */
static void test_irradiance_output(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    room(world.scene, false);
    constant_sky(world.scene, 1);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 5, 0), truth_v(1, 0, 0), truth_v(0, 0, -1), 1), mirror(world.scene));
    truth_commit(&world);
    hydra_render_desc desc = picture(truth_v(0, 0, 0.9), truth_v(0, -0.5, 0), 0.8, 16, 32, BIT(HYDRA_IRRADIANCE));
    hydra_render *render = truth_render(world.scene, &desc);
    float *radiance = truth_read(render, HYDRA_RADIANCE, 256), *e = truth_read(render, HYDRA_IRRADIANCE, 256);
    for (size_t i = 0; i < 768; i++) TRUTH_NEAR("irradiance on a wall", (double)e[i], TRUTH_PI / (double)0.7f * (double)radiance[i], 1e-4);
    free(radiance);
    free(e);
    hydra_render_destroy(render);
    desc.sensor = truth_sensor_pinhole(truth_v(0.1, 7, 0.1), truth_v(0, 5, 0), 0.3);
    render = truth_render(world.scene, &desc);
    TRUTH_WITHIN("irradiance of a mirror", mean_of(render, HYDRA_IRRADIANCE, 256, NULL), 0, 0);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* ---------------------------------------------------------------- validity */

static uint32_t validity_at(hydra_scene *scene, truth_v3 point, truth_v3 normal) {
    float p[3], n[3];
    uint32_t bits = 0;
    truth_store(p, point);
    truth_store(n, normal);
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_points(p, n, 1);
    desc.width = desc.height = 1;
    desc.max_samples = 64;
    hydra_render *render = truth_render(scene, &desc);
    assert_int_equal(hydra_render_read(render, HYDRA_VALIDITY, &bits, 0), HYDRA_OK);
    hydra_render_destroy(render);
    return bits;
}

/* Catches: lightmap texels inside walls that look valid, and good ones that are flagged. */
static void test_inside(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    constant_sky(world.scene, 1);
    hydra_material grey = truth_lambert(world.scene, 0.5);
    truth_scene_mesh(world.scene, truth_mesh_box(truth_v(0, 0, 0), truth_v(1, 1, 1), false), grey);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, -1.5, 0), truth_v(0, 0, 9), truth_v(9, 0, 0), 1), grey);
    truth_commit(&world);
    assert_true(validity_at(world.scene, truth_v(0.3, 0.2, 0.1), truth_v(0, 1, 0)) & HYDRA_VALID_INSIDE);
    assert_true(validity_at(world.scene, truth_v(0.3, 0.2, 0.1), truth_v(0, -1, 0)) & HYDRA_VALID_INSIDE);
    assert_false(validity_at(world.scene, truth_v(0.3, 1, 0.1), truth_v(0, 1, 0)) & HYDRA_VALID_INSIDE);
    assert_false(validity_at(world.scene, truth_v(2, -1.5, 0), truth_v(0, 1, 0)) & HYDRA_VALID_INSIDE);
    assert_false(validity_at(world.scene, truth_v(0, -1.5, 0), truth_v(0, 1, 0)) & HYDRA_VALID_INSIDE);
    truth_close(&world);
}

/* A tiny bright lamp that only chance finds: one sample carries a pixel. Catches: silence about such pixels, and
   warnings about good ones; a count in the status that does not agree. */
static void test_heavy_tail(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    constant_sky(world.scene, 0.01);
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 1e4);
    truth_store(lamp.position, truth_v(0, 2, 0));
    lamp.radius = 0.02f; /* share of cosine samples that hit: 1e-4 */
    hydra_scene_add_light(world.scene, &lamp);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(0, 0, 1), truth_v(1, 0, 0), 1), truth_lambert(world.scene, 0.5));
    truth_commit(&world);
    for (int strategy = 0; strategy < 3; strategy += 2) {
        hydra_render_desc desc = picture(truth_v(0, 1, 0), truth_v(0, 0, 0.01), 0.2, 32, 256, 0);
        desc.strategy = (hydra_strategy)strategy;
        hydra_render *render = truth_render(world.scene, &desc);
        uint32_t *bits = truth_read_words(render, HYDRA_VALIDITY, 1024);
        uint64_t heavy = 0;
        for (int i = 0; i < 1024; i++) heavy += (bits[i] & HYDRA_VALID_HEAVY_TAIL) != 0;
        assert_int_equal(hydra_render_status(render).heavy_pixels, heavy);
        if (strategy == HYDRA_STRATEGY_BSDF) TRUTH_WITHIN("flagged pixels", (double)heavy, 5, 200); /* 26 expected */
        else assert_int_equal(heavy, 0);
        free(bits);
        hydra_render_destroy(render);
    }
    truth_close(&world);
}

/* Catches: infinities in the film. Two skies' worth of the largest floats overflow in every sample of the plane. */
static void test_dropped(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    constant_sky(world.scene, 3e38);
    truth_commit(&world);
    float p[3] = {0, 0, 0}, n[3] = {0, 1, 0}, e[3], error[3];
    uint32_t bits = 0;
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_points(p, n, 1);
    desc.width = desc.height = 1;
    hydra_render *render = truth_render(world.scene, &desc);
    assert_int_equal(hydra_render_read(render, HYDRA_RADIANCE, e, 0), HYDRA_OK);
    assert_int_equal(hydra_render_read(render, HYDRA_ERROR, error, 0), HYDRA_OK);
    assert_int_equal(hydra_render_read(render, HYDRA_VALIDITY, &bits, 0), HYDRA_OK);
    for (int c = 0; c < 3; c++) assert_true(ht_finite(e[c]) && error[c] == error[c]);
    assert_true(bits & HYDRA_VALID_DROPPED);
    assert_int_equal(hydra_render_status(render).dropped_samples, 64);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* ---------------------------------------------------------------- buffers and status */

/* Catches: rows written past their end or into the gap between them; outputs that were not asked for. */
static void test_strides(void **state) {
    (void)state;
    square_scene s;
    open_square(&s);
    unsigned char rows[16][200];
    float *tight = truth_read(s.render, HYDRA_RADIANCE, 256);
    memset(rows, 0xab, sizeof rows);
    assert_int_equal(hydra_render_read(s.render, HYDRA_RADIANCE, rows, 200), HYDRA_OK);
    for (int y = 0; y < 16; y++) {
        assert_memory_equal(rows[y], &tight[48 * y], 192);
        for (int i = 192; i < 200; i++) assert_int_equal(rows[y][i], 0xab);
    }
    assert_int_not_equal(hydra_render_read(s.render, HYDRA_RADIANCE, rows, 188), HYDRA_OK);
    assert_int_equal(hydra_render_read(s.render, HYDRA_RADIANCE, NULL, 0), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_render_read(s.render, HYDRA_OUTPUT_COUNT, rows, 0), HYDRA_ERROR_ENUM);
    hydra_render_desc desc = picture(truth_v(0, 0, 0), truth_v(0, 0, -1), 0.5, 16, 2, 0);
    hydra_render *plain = truth_render(s.world.scene, &desc);
    for (int o = 0; o < HYDRA_OUTPUT_COUNT; o++) {
        bool always = o == HYDRA_RADIANCE || o == HYDRA_ERROR || o == HYDRA_SAMPLES || o == HYDRA_VALIDITY;
        assert_int_equal(hydra_render_read(plain, (hydra_output)o, rows, 200), always ? HYDRA_OK : HYDRA_ERROR_OUTPUT);
    }
    hydra_render_destroy(plain);
    free(tight);
    close_square(&s);
}

/* Catches: a status that does not move, runs backwards or disagrees with the film. */
static void test_status(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    room(world.scene, true);
    truth_commit(&world);
    hydra_render_desc desc = picture(truth_v(0, 0, 0.9), truth_v(0, 0, 0), 1, 32, 64, 0);
    desc.step_seconds = 1e-4;
    hydra_render *render = hydra_render_create(world.scene, &desc);
    assert_non_null(render);
    hydra_status before = hydra_render_status(render);
    assert_true(before.stage == HYDRA_STAGE_FIRST_PASS && before.fraction == 0 && before.samples == 0);
    assert_true(before.error > DBL_MAX && before.tiles_total == 4);
    int steps = 0;
    for (hydra_result result = HYDRA_MORE; result == HYDRA_MORE; steps++) {
        result = hydra_render_step(render);
        hydra_status now = hydra_render_status(render);
        assert_true(now.fraction >= before.fraction && now.fraction <= 1 && now.samples >= before.samples);
        assert_true(now.seconds >= before.seconds && now.rays_camera >= before.rays_camera && now.stage >= before.stage);
        before = now;
    }
    assert_true(steps > 1);
    assert_true(before.stage == HYDRA_STAGE_DONE && before.fraction == 1 && before.samples == 64 && before.seconds_left == 0);
    assert_int_equal(before.paths, 64 * 1024);
    assert_int_equal(before.rays_camera, 64 * 1024);
    assert_true(before.rays_bounce > 64 * 1024 && before.rays_shadow > 64 * 1024 && before.bytes_film > 0);
    assert_true(before.error > 0 && before.error_low <= before.error && before.error <= before.error_high);
    assert_int_equal(hydra_render_step(render), HYDRA_OK); /* and stays done */
    hydra_render_destroy(render);
    hydra_status none = hydra_render_status(NULL);
    assert_true(none.samples == 0 && none.paths == 0);
    truth_close(&world);
}

int hydra_test_outputs(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes),             cmocka_unit_test(test_colours),
        cmocka_unit_test(test_coverage_and_depth), cmocka_unit_test(test_ids),
        cmocka_unit_test(test_instance_ids),      cmocka_unit_test(test_components_of_furnace),
        cmocka_unit_test(test_components_of_room), cmocka_unit_test(test_components_with_mirror),
        cmocka_unit_test(test_irradiance_output), cmocka_unit_test(test_inside),
        cmocka_unit_test(test_heavy_tail),        cmocka_unit_test(test_dropped),
        cmocka_unit_test(test_strides),           cmocka_unit_test(test_status)};
    return cmocka_run_group_tests_name("outputs", tests, NULL, NULL);
}
