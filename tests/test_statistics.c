/* Whether error bars are honest and stopping is fair: coverage over seeds, strategies against each other, adaptive
   against fixed, convergence, the status's error and its interval, precision of long sums. */
#include "truth_helpers.h"

int hydra_test_statistics(void);

/* ---------------------------------------------------------------- scenes with a known value for each pixel */

enum { SIDE = 8, PIXELS = SIDE * SIDE };

typedef struct known_scene {
    truth_world world;
    float positions[3 * PIXELS], normals[3 * PIXELS];
    double truth[PIXELS];
    hydra_sensor_desc sensor;
} known_scene;

/* A.1: every ray finds radiance 1. */
static void open_furnace(known_scene *s) {
    truth_open(&s->world);
    truth_scene_mesh(s->world.scene, truth_mesh_box(truth_v(0, 0, 0), truth_v(1, 0.8, 1.1), true), truth_emitter(s->world.scene, 0.5, 0.5));
    truth_commit(&s->world);
    s->sensor = truth_sensor_pinhole(truth_v(0.1, 0, 0.2), truth_v(-1, 0.3, -0.4), 1);
    for (int i = 0; i < PIXELS; i++) s->truth[i] = 1;
}

/* Points on a grid in the plane y = 0 under a rectangle at height 1; a screen at half height may hide x > 0. */
static void open_lit_plane(known_scene *s, bool edge) {
    truth_open(&s->world);
    hydra_light_desc light = truth_light(HYDRA_LIGHT_RECT, 1);
    truth_store(light.position, truth_v(0, 1, 0));
    truth_store(light.axis_u, truth_v(0.4, 0, 0));
    truth_store(light.axis_v, truth_v(0, 0, 0.3));
    hydra_scene_add_light(s->world.scene, &light);
    if (edge)
        truth_scene_mesh(s->world.scene, truth_mesh_quad(truth_v(1, 0.5, 0), truth_v(1, 0, 0), truth_v(0, 0, -1), 1), truth_lambert(s->world.scene, 0));
    truth_commit(&s->world);
    for (int i = 0; i < PIXELS; i++) {
        double x = (i % SIDE - 3.5) * 0.1, z = (i / SIDE - 3.5) * 0.1;
        /* from (x, 0) the edge at (0, 0.5) hides light beyond x' = -x */
        double right = edge ? fmax(-0.4, fmin(0.4, -x)) : 0.4;
        truth_v3 c[4] = {{-0.4, 1, -0.3}, {0, 1, -0.3}, {0, 1, 0.3}, {-0.4, 1, 0.3}};
        c[1].x = c[2].x = right;
        s->truth[i] = truth_polygon_irradiance(c, 4, truth_v(x, 0, z), truth_v(0, 1, 0), 1);
        truth_store(&s->positions[3 * i], truth_v(x, 0, z));
        truth_store(&s->normals[3 * i], truth_v(0, 1, 0));
    }
    s->sensor = truth_sensor_points(s->positions, s->normals, PIXELS);
}

static void open_known(known_scene *s, int which) {
    memset(s, 0, sizeof *s);
    if (which == 0) open_furnace(s);
    else open_lit_plane(s, which == 2);
}

static const char *known_names[] = {"furnace", "rectangle light", "shadow edge"};

static hydra_render_desc known_desc(const known_scene *s, uint32_t samples, float target, uint32_t seed) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = s->sensor;
    desc.width = desc.height = SIDE;
    desc.max_samples = samples;
    desc.target_error = target;
    desc.seed = seed;
    desc.tile_size = 8;
    desc.step_seconds = 10;
    return desc;
}

/* ---------------------------------------------------------------- coverage of the error bars */

typedef struct coverage {
    double held, intervals; /* 95 % intervals of pixels that hold the truth */
    double sum[PIXELS], squares[PIXELS];
    double samples;
} coverage;

static void add_coverage(coverage *c, const known_scene *s, hydra_render *render) {
    float *value = truth_read(render, HYDRA_RADIANCE, PIXELS), *error = truth_read(render, HYDRA_ERROR, PIXELS);
    for (int i = 0; i < PIXELS; i++) {
        double v = (double)value[3 * i + 1];
        double rounding = 4 * (double)FLT_EPSILON * s->truth[i]; /* exact pixels have no bar to speak of */
        c->held += fabs(v - s->truth[i]) <= 1.96 * (double)error[3 * i + 1] + rounding;
        c->intervals++;
        c->sum[i] += v;
        c->squares[i] += v * v;
    }
    c->samples += hydra_render_status(render).samples;
    free(value);
    free(error);
}

static coverage cover(const known_scene *s, uint32_t samples, float target, uint32_t seeds) {
    coverage c;
    memset(&c, 0, sizeof c);
    for (uint32_t seed = 0; seed < seeds; seed++) {
        hydra_render_desc desc = known_desc(s, samples, target, 1000 + seed);
        hydra_render *render = truth_render(s->world.scene, &desc);
        add_coverage(&c, s, render);
        hydra_render_destroy(render);
    }
    c.samples /= seeds;
    return c;
}

/* Catches: error bars that are too short (correlated samples, one half deciding what it reports) or so long that they
   say nothing. Of 64 pixels each, so many seeds that chance alone moves the share by 0.3 %, and in the quick form by less
   than 1 %. */
static void test_coverage_fixed(void **state) {
    (void)state;
    static const uint32_t samples[] = {32, 64, 256};
    for (int which = 0; which < 3; which++) {
        known_scene s;
        open_known(&s, which);
        for (int k = 0; k < 3; k++) {
            coverage c = cover(&s, samples[k], 0, ht_pick(k == 2 ? 60 : 100, k == 2 ? 10 : 30));
            char name[80];
            snprintf(name, sizeof name, "coverage of 95 %% bars: %s, %u samples", known_names[which], samples[k]);
            TRUTH_WITHIN(name, c.held / c.intervals, 0.90, 0.995);
        }
        truth_close(&s.world);
    }
}

static double worst_z(const known_scene *s, const coverage *c, double seeds) {
    double worst = 0;
    for (int i = 0; i < PIXELS; i++) {
        double mean = c->sum[i] / seeds, variance = fmax(0, c->squares[i] / seeds - mean * mean) / (seeds - 1);
        double z = (mean - s->truth[i]) / sqrt(variance + pow(1e-6 * s->truth[i], 2));
        if (s->truth[i] > 0 && fabs(z) > fabs(worst)) worst = z;
    }
    return worst;
}

static double pooled_z(const known_scene *s, const coverage *c, double seeds) {
    double off = 0, variance = 0;
    for (int i = 0; i < PIXELS; i++) {
        double mean = c->sum[i] / seeds;
        off += mean - s->truth[i];
        variance += fmax(0, c->squares[i] / seeds - mean * mean) / (seeds - 1) + pow(1e-6 * s->truth[i], 2);
    }
    return off / sqrt(variance);
}

/* Catches: adaptive stopping that biases its picture (stops when chance is kind) or breaks its bars. The mean over
   seeds holds the truth in every pixel (4.5 for the worst of 64) and over all pixels. */
static void test_adaptive(void **state) {
    (void)state;
    static const float targets[] = {0.2f, 0.05f};
    for (int which = 0; which < 3; which++)
        for (int k = 0; k < 2; k++) {
            known_scene s;
            char name[80];
            uint32_t seeds = ht_pick(k ? 150 : 300, 60);
            open_known(&s, which);
            coverage c = cover(&s, 4096, targets[k], seeds);
            snprintf(name, sizeof name, "adaptive, target %g, %s", (double)targets[k], known_names[which]);
            TRUTH_WITHIN(name, c.held / c.intervals, 0.90, 0.995);
            TRUTH_WITHIN(name, pooled_z(&s, &c, seeds), -4, 4);
            TRUTH_WITHIN(name, worst_z(&s, &c, seeds), -4.8, 4.8);
            TRUTH_WITHIN(name, c.samples, 2, 4095);
            truth_close(&s.world);
        }
}

/* Catches: dark tiles dropped because their first samples found nothing. The left tile looks down at a large light; the
   right one looks up at a small lamp by BSDF sampling alone: a sample in 10,000 finds it, and its mean over seeds must
   still be the formula's. (A tile that stops by its own verdict when it is black loses 60 % here.) */
static void test_dark_tiles(void **state) {
    (void)state;
    static float positions[6 * PIXELS], normals[6 * PIXELS];
    truth_world world;
    truth_open(&world);
    hydra_light_desc floor = truth_light(HYDRA_LIGHT_RECT, 1), lamp = truth_light(HYDRA_LIGHT_SPHERE, 1e4 / TRUTH_PI);
    truth_store(lamp.position, truth_v(0, 1, 0));
    lamp.radius = 0.01f;
    truth_store(floor.position, truth_v(0, -1, 0));
    truth_store(floor.axis_u, truth_v(0, 0, 1));
    truth_store(floor.axis_v, truth_v(1, 0, 0));
    hydra_scene_add_light(world.scene, &lamp);
    hydra_scene_add_light(world.scene, &floor);
    truth_commit(&world);
    for (int i = 0; i < 2 * PIXELS; i++) truth_store(&normals[3 * i], truth_v(0, i % (2 * SIDE) < SIDE ? -1 : 1, 0));
    ht_stats stats;
    memset(&stats, 0, sizeof stats);
    for (uint32_t seed = 0; seed < ht_pick(1000, 300); seed++) {
        hydra_render_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.sensor = truth_sensor_points(positions, normals, 2 * PIXELS);
        desc.width = 2 * SIDE;
        desc.height = SIDE;
        desc.tile_size = SIDE;
        desc.max_samples = 1024;
        desc.target_error = 0.2f;
        desc.seed = seed;
        desc.strategy = HYDRA_STRATEGY_BSDF;
        hydra_render *render = truth_render(world.scene, &desc);
        float *e = truth_read(render, HYDRA_RADIANCE, 2 * PIXELS);
        double mean = 0;
        for (int i = 0; i < 2 * PIXELS; i++) mean += i % (2 * SIDE) < SIDE ? 0 : (double)e[3 * i] / PIXELS;
        ht_add(&stats, mean);
        free(e);
        hydra_render_destroy(render);
    }
    truth_estimate e;
    e.mean = stats.mean;
    e.error = ht_standard_error(&stats);
    TRUTH_EXPECT("irradiance that is seldom found", e, 1, 0.1, 1e-4);
    truth_close(&world);
}

/* ---------------------------------------------------------------- strategies */

static truth_estimate picture_mean(hydra_scene *scene, const hydra_render_desc *desc) {
    hydra_render *render = truth_render(scene, desc);
    size_t pixels = (size_t)desc->width * desc->height;
    float *rgb = truth_read(render, HYDRA_RADIANCE, pixels), *error = truth_read(render, HYDRA_ERROR, pixels);
    truth_estimate e = {0, 0};
    for (size_t i = 0; i < pixels; i++) {
        e.mean += (double)rgb[3 * i] / (double)pixels;
        e.error += pow((double)error[3 * i] / (double)pixels, 2);
    }
    e.error = sqrt(e.error);
    free(rgb);
    free(error);
    hydra_render_destroy(render);
    return e;
}

static void glossy_room(hydra_scene *scene, bool textured_sky) {
    hydra_material_desc metal, coat;
    memset(&metal, 0, sizeof metal);
    memset(&coat, 0, sizeof coat);
    metal.kind = HYDRA_MATERIAL_CONDUCTOR;
    metal.roughness = 0.3f;
    metal.base_color[0] = metal.base_color[1] = metal.base_color[2] = 0.9f;
    coat.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
    coat.roughness = 0.4f;
    coat.clearcoat = 0.5f;
    coat.base_color[0] = coat.base_color[1] = coat.base_color[2] = 0.6f;
    truth_scene_mesh(scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(0, 0, 3), truth_v(3, 0, 0), 1), hydra_scene_add_material(scene, &coat));
    truth_scene_mesh(scene, truth_mesh_sphere(truth_v(0.5, 0.6, 0), 0.6, 3, false), hydra_scene_add_material(scene, &metal));
    truth_scene_mesh(scene, truth_mesh_quad(truth_v(-1, 1, 0), truth_v(0, 0.5, 0), truth_v(0, 0, 0.5), 1), truth_emitter(scene, 0.2, 4));
    if (textured_sky) {
        static float texels[3 * 16 * 8];
        hydra_environment_desc sky;
        memset(&sky, 0, sizeof sky);
        for (int i = 0; i < 3 * 16 * 8; i++) texels[i] = i / 3 == 37 ? 8.f : 0.2f;
        sky.texels = texels;
        sky.width = 16;
        sky.height = 8;
        assert_int_equal(hydra_scene_set_environment(scene, &sky), HYDRA_OK);
    } else {
        hydra_light_desc ball = truth_light(HYDRA_LIGHT_SPHERE, 6), rect = truth_light(HYDRA_LIGHT_RECT, 3);
        truth_store(ball.position, truth_v(0, 2, 0.8));
        ball.radius = 0.4f;
        truth_store(rect.position, truth_v(1.4, 1, 0));
        truth_store(rect.axis_u, truth_v(0, 0.3, 0));
        truth_store(rect.axis_v, truth_v(0, 0, -0.4));
        hydra_scene_add_light(scene, &ball);
        hydra_scene_add_light(scene, &rect);
    }
}

/* Catches: a strategy that sees less light than another: wrong pdfs, MIS weights that do not add to 1. */
static void test_strategies_agree(void **state) {
    (void)state;
    for (int which = 0; which < 2; which++) {
        truth_world world;
        truth_estimate e[3];
        truth_open(&world);
        glossy_room(world.scene, which == 1);
        truth_commit(&world);
        for (int k = 0; k < 3; k++) {
            hydra_render_desc desc;
            memset(&desc, 0, sizeof desc);
            desc.sensor = truth_sensor_pinhole(truth_v(0, 1.5, 4), truth_v(0, 0.6, 0), 0.7);
            desc.width = desc.height = 16;
            desc.max_samples = truth_samples(k == 0 ? 512 : 1024);
            desc.strategy = (hydra_strategy)k;
            desc.seed = (uint32_t)k;
            e[k] = picture_mean(world.scene, &desc);
            TRUTH_WITHIN("error of a strategy", e[k].error / e[k].mean, 0, truth_bound(0.01));
        }
        for (int k = 1; k < 3; k++)
            TRUTH_WITHIN("strategy against MIS, in standard errors", (e[k].mean - e[0].mean) / hypot(e[k].error, e[0].error), -4, 4);
        truth_close(&world);
    }
}

/* ---------------------------------------------------------------- convergence and targets */

static double real_error(const known_scene *s, hydra_render *render) {
    float *rgb = truth_read(render, HYDRA_RADIANCE, PIXELS);
    double mean = 0, sum = 0;
    for (int i = 0; i < PIXELS; i++) mean += (double)rgb[3 * i] / PIXELS;
    for (int i = 0; i < PIXELS; i++) sum += pow(((double)rgb[3 * i] - s->truth[i]) / fmax(s->truth[i], mean / 10), 2) / PIXELS;
    free(rgb);
    return sqrt(sum);
}

/* Mean square of the real relative error over seeds, and what the status said. */
typedef struct error_report {
    double real, said; /* root mean squares */
    double held;       /* share of intervals that hold the real error */
} error_report;

static error_report report(const known_scene *s, uint32_t samples, float target, uint32_t seeds) {
    error_report r = {0, 0, 0};
    for (uint32_t seed = 0; seed < seeds; seed++) {
        hydra_render_desc desc = known_desc(s, samples, target, 77 + seed);
        hydra_render *render = truth_render(s->world.scene, &desc);
        hydra_status status = hydra_render_status(render);
        double real = real_error(s, render);
        r.real += real * real / seeds;
        r.said += status.error * status.error / seeds;
        r.held += (real >= status.error_low && real <= status.error_high) / (double)seeds;
        assert_true(status.error_low <= status.error && status.error <= status.error_high);
        hydra_render_destroy(render);
    }
    r.real = sqrt(r.real);
    r.said = sqrt(r.said);
    return r;
}

/* Catches: error that does not fall as N^-1/2 or faster; a status that says something else than the truth; an
   interval that is decoration. */
static void test_convergence(void **state) {
    (void)state;
    for (int which = 0; which < 3; which++) {
        known_scene s;
        open_known(&s, which);
        uint32_t seeds = ht_pick(100, 40), most = ht_pick(1024, 512);
        /* ten pictures have 640 errors: their root mean square is known to 3 %, the slope to 0.008 */
        error_report few = report(&s, 16, 0, seeds), many = report(&s, most, 0, 10);
        TRUTH_WITHIN("slope of the error", log(many.real / few.real) / log(most / 16.0), -3, -0.45);
        error_report middle = report(&s, 64, 0, seeds);
        TRUTH_WITHIN("said error over real error", middle.said / middle.real, 0.85, 1.25);
        TRUTH_WITHIN("intervals of the picture's error that hold it", middle.held, 0.88, 1.001);
        truth_close(&s.world);
    }
}

/* Catches: targets that are reached on paper only, or far overshot: where a target ended the render, the real
   relative error is the target within a factor 2. */
static void test_target_reached(void **state) {
    (void)state;
    known_scene s;
    open_known(&s, 0);
    uint32_t seeds = ht_pick(40, 20);
    error_report r = report(&s, 65536, 0.02f, seeds);
    TRUTH_WITHIN("real error at a target of 2 %, furnace", r.real, 0.01, 0.04);
    r = report(&s, 65536, 0.05f, seeds);
    TRUTH_WITHIN("real error at a target of 5 %, furnace", r.real, 0.025, 0.1);
    hydra_render_desc desc = known_desc(&s, 65536, 0.05f, 5);
    hydra_render *render = truth_render(s.world.scene, &desc);
    uint32_t *bits = truth_read_words(render, HYDRA_VALIDITY, PIXELS);
    for (int i = 0; i < PIXELS; i++) assert_true(bits[i] & HYDRA_VALID_CONVERGED);
    assert_true(hydra_render_status(render).tiles_active == 0);
    free(bits);
    hydra_render_destroy(render);
    desc = known_desc(&s, 4, 1e-6f, 5); /* the cap comes first: not converged, and done all the same */
    render = truth_render(s.world.scene, &desc);
    bits = truth_read_words(render, HYDRA_VALIDITY, PIXELS);
    for (int i = 0; i < PIXELS; i++) assert_false(bits[i] & HYDRA_VALID_CONVERGED);
    free(bits);
    hydra_render_destroy(render);
    truth_close(&s.world);
}

/* Catches: seeds or pixels that share their random numbers: the spread of the picture's mean over seeds is what
   independent pixels give (at most; negative correlation between neighbours is welcome). */
static void test_independence(void **state) {
    (void)state;
    known_scene s;
    open_known(&s, 0);
    ht_stats stats;
    memset(&stats, 0, sizeof stats);
    double expected = 0;
    uint32_t seeds = ht_pick(200, 60);
    for (uint32_t seed = 0; seed < seeds; seed++) {
        hydra_render_desc desc = known_desc(&s, 16, 0, seed);
        truth_estimate e = picture_mean(s.world.scene, &desc);
        ht_add(&stats, e.mean);
        expected += e.error * e.error / seeds;
    }
    TRUTH_WITHIN("spread over seeds against error bars", sqrt(ht_variance(&stats) / expected), 0.02, 1.25);
    truth_close(&s.world);
}

/* ---------------------------------------------------------------- long sums */

/* One pixel with many samples: radiance and its error, channels 0 and 1. */
static void long_pixel(hydra_scene *scene, double x, uint32_t samples, double value[2], double error[2]) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(truth_v(x, 0, 0), truth_v(x, 0, -1), 0.02);
    desc.width = desc.height = 1;
    desc.max_samples = samples;
    hydra_render *render = truth_render(scene, &desc);
    float *rgb = truth_read(render, HYDRA_RADIANCE, 1), *bars = truth_read(render, HYDRA_ERROR, 1);
    for (int c = 0; c < 2; c++) {
        value[c] = (double)rgb[c];
        error[c] = (double)bars[c];
    }
    free(rgb);
    free(bars);
    hydra_render_destroy(render);
}

/* Catches: float sums. 0.1 added a million times in float is off by 1 %; the mean must be 0.1 to its last bit, with an
   error bar of nothing. A second picture has an edge: its error bar must be at most that of a Bernoulli mean. */
static void test_million_samples(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int c = 0; c < 3; c++) sky.color[c] = c == 0 ? 0.1f : 1.0f / 3.0f;
    assert_int_equal(hydra_scene_set_environment(world.scene, &sky), HYDRA_OK);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(5.003, 0, -1), truth_v(5, 0, 0), truth_v(0, 5, 0), 1), truth_emitter(world.scene, 0, 7));
    truth_commit(&world);
    uint32_t samples = ht_pick(1000000, 200000);
    double value[2], error[2];
    long_pixel(world.scene, -0.1, samples, value, error);
    TRUTH_NEAR("mean of a constant", value[0], (double)0.1f, 1e-7);
    TRUTH_NEAR("mean of a constant", value[1], (double)(1.0f / 3.0f), 1e-7);
    TRUTH_WITHIN("error of a constant", error[0], 0, 1e-9);
    long_pixel(world.scene, 0, samples, value, error);
    double share = 0.5 - 0.003 / (2 * tan(0.01)), truth = 7 * share + (double)0.1f * (1 - share);
    TRUTH_WITHIN("share of an edge", value[0], truth * (1 - 2e-4), truth * (1 + 2e-4));
    TRUTH_WITHIN("error at an edge", error[0], fabs(value[0] - truth) / 4, 1.05 * 6.9 * sqrt(share * (1 - share) / samples));
    truth_close(&world);
}

/* Catches: variance lost to cancellation: a small signal on a large pedestal keeps its error bar. */
static void test_small_variance(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(5, 0, -1), truth_v(5, 0, 0), truth_v(0, 5, 0), 1), truth_emitter(world.scene, 0, 1000.5));
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(-5, 0, -1), truth_v(5, 0, 0), truth_v(0, 5, 0), 1), truth_emitter(world.scene, 0, 1000));
    truth_commit(&world);
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = truth_sensor_pinhole(truth_v(0, 0, 0), truth_v(0, 0, -1), 0.1);
    desc.width = desc.height = 1;
    desc.max_samples = 256;
    ht_stats values;
    memset(&values, 0, sizeof values);
    double said = 0;
    uint32_t seeds = ht_pick(200, 100);
    for (uint32_t seed = 0; seed < seeds; seed++) {
        desc.seed = seed;
        truth_estimate e = picture_mean(world.scene, &desc);
        ht_add(&values, e.mean);
        said += e.error * e.error / seeds;
    }
    TRUTH_NEAR("mean on a pedestal", values.mean, 1000.25, 1e-5);
    TRUTH_WITHIN("error bar on a pedestal", sqrt(said), 0.8 * sqrt(ht_variance(&values)), 0.05);
    truth_close(&world);
}

int hydra_test_statistics(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coverage_fixed),  cmocka_unit_test(test_adaptive),
        cmocka_unit_test(test_dark_tiles),      cmocka_unit_test(test_strategies_agree),
        cmocka_unit_test(test_convergence),     cmocka_unit_test(test_target_reached),
        cmocka_unit_test(test_independence),    cmocka_unit_test(test_million_samples),
        cmocka_unit_test(test_small_variance)};
    return cmocka_run_group_tests_name("statistics", tests, NULL, NULL);
}
