/* Sensors: where every pixel looks, which way is up, what lens, filter, region and shift do. Read off positions,
   depths and edges of known planes and spheres. */
#include "truth_helpers.h"

int hydra_test_sensors(void);

typedef struct shot {
    hydra_render_desc desc;
    hydra_render *render;
    size_t pixels;
} shot;

static hydra_render_desc shot_desc(const hydra_sensor_desc *sensor, uint32_t width, uint32_t height, uint32_t samples) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = *sensor;
    desc.width = width;
    desc.height = height;
    desc.max_samples = samples;
    desc.outputs = 1u << HYDRA_POSITION | 1u << HYDRA_DEPTH | 1u << HYDRA_COVERAGE;
    return desc;
}

/* A pixel's place in the image: 0..1 from left to right and from top to bottom. */
static double across(uint32_t i, uint32_t n) { return (i + 0.5) / n; }

static void expect_place(const float *got, truth_v3 truth, double slack) {
    truth_v3 p = truth_load(got);
    if (truth_length(truth_sub(p, truth)) <= slack) return;
    print_error("position (%g, %g, %g), truth (%g, %g, %g), slack %g\n", p.x, p.y, p.z, truth.x, truth.y, truth.z, slack);
    fail();
}

/* The axes of an image: forward, right, up, from position, target and up as a camera has them. */
typedef struct frame {
    truth_v3 origin, forward, right, up;
} frame;

static frame frame_of(const hydra_sensor_desc *sensor, truth_v3 up) {
    frame f;
    f.origin = truth_load(sensor->position);
    f.forward = truth_unit(truth_sub(truth_load(sensor->target), f.origin));
    f.right = truth_unit(truth_cross(f.forward, up));
    f.up = truth_cross(f.right, f.forward);
    return f;
}

/* A square across the view axis at a distance, large enough to fill the view. */
static void add_screen(hydra_scene *scene, const frame *f, double distance, double half, hydra_material material) {
    truth_v3 centre = truth_add(f->origin, truth_mul(f->forward, distance));
    truth_scene_mesh(scene, truth_mesh_quad(centre, truth_mul(f->up, half), truth_mul(f->right, half), 1), material);
}

/* Every pixel of a pinhole picture of a plane across the axis: its mean position is that of its middle, within a
   tenth of a pixel, and its depth is Euclidean.
   Catches: flips, half-pixel offsets, the angle taken horizontally, aspect, z-depth instead of distance. */
static void pinhole(uint32_t width, uint32_t height, double fov, uint64_t seed) {
    truth_world world;
    truth_open(&world);
    ht_rng rng = ht_rng_make(seed);
    truth_v3 eye = truth_mul(truth_rng_direction(&rng), 5), up = seed % 2 ? truth_v(0, 1, 0) : truth_rng_direction(&rng);
    hydra_sensor_desc sensor = truth_sensor_pinhole(eye, truth_add(eye, truth_rng_direction(&rng)), fov);
    if (seed % 2 == 0) truth_store(sensor.up, truth_mul(up, 7)); /* else the default */
    frame f = frame_of(&sensor, up);
    double distance = 3, tall = 2 * distance * tan(0.5 * fov), pixel = tall / height;
    add_screen(world.scene, &f, distance, 2 * tall * fmax(1, (double)width / height), truth_lambert(world.scene, 0.5));
    truth_commit(&world);
    hydra_render_desc desc = shot_desc(&sensor, width, height, 64);
    hydra_render *render = truth_render(world.scene, &desc);
    float *at = truth_read(render, HYDRA_POSITION, (size_t)width * height), *depth = truth_read(render, HYDRA_DEPTH, (size_t)width * height);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            double right = (across(x, width) - 0.5) * pixel * width, rise = (0.5 - across(y, height)) * tall;
            truth_v3 truth = truth_add(truth_mul(f.forward, distance), truth_add(truth_mul(f.right, right), truth_mul(f.up, rise)));
            size_t i = (size_t)y * width + x;
            expect_place(&at[3 * i], truth_add(f.origin, truth), 0.1 * pixel + 1e-6 * 10);
            TRUTH_NEAR("depth", (double)depth[i], truth_length(truth), 0.1 * pixel / distance + 2e-6);
        }
    free(at);
    free(depth);
    hydra_render_destroy(render);
    truth_close(&world);
}

static void test_pinhole(void **state) {
    (void)state;
    pinhole(16, 16, 0.8, 1);
    pinhole(17, 9, 1.4, 2);
    pinhole(5, 23, 0.3, 3);
    pinhole(1, 1, 0.1, 4);
}

/* Catches: default angle that is not 0.8, default direction that is not -Z, default up that is not +Y. */
static void test_pinhole_defaults(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, -2), truth_v(9, 0, 0), truth_v(0, 9, 0), 1), truth_lambert(world.scene, 1));
    truth_commit(&world);
    hydra_sensor_desc sensor;
    memset(&sensor, 0, sizeof sensor);
    hydra_render_desc desc = shot_desc(&sensor, 8, 8, 64);
    hydra_render *render = truth_render(world.scene, &desc);
    float *at = truth_read(render, HYDRA_POSITION, 64);
    double pixel = 4 * tan(0.4) / 8;
    expect_place(&at[0], truth_v(-3.5 * pixel, 3.5 * pixel, -2), 0.1 * pixel);
    expect_place(&at[3 * 63], truth_v(3.5 * pixel, -3.5 * pixel, -2), 0.1 * pixel);
    free(at);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* Catches: looking straight along up, where the axes have no direction, without a word; a given up that is not used. */
static void test_looking_along_up(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, 0), truth_v(0, 0, 9), truth_v(9, 0, 0), 1), truth_lambert(world.scene, 1));
    truth_commit(&world);
    hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0, 2, 0), truth_v(0, 0, 0), 0.5);
    hydra_render_desc desc = shot_desc(&sensor, 8, 8, 64);
    assert_null(hydra_render_create(world.scene, &desc));
    assert_non_null(strstr(hydra_error_text(world.context), hydra_result_text(HYDRA_ERROR_SENSOR)));
    desc.sensor.up[2] = -1; /* a map: north is -Z, east is +X */
    hydra_render *render = truth_render(world.scene, &desc);
    float *at = truth_read(render, HYDRA_POSITION, 64);
    double pixel = 4 * tan(0.25) / 8;
    expect_place(&at[0], truth_v(-3.5 * pixel, 0, -3.5 * pixel), 0.1 * pixel);
    expect_place(&at[3 * 63], truth_v(3.5 * pixel, 0, 3.5 * pixel), 0.1 * pixel);
    free(at);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* Catches: tangents that overflow or directions that lose their bits at the ends of the range of angles. */
static void test_extreme_angles(void **state) {
    (void)state;
    static const double degrees[] = {0.001, 0.1, 170, 179.9};
    for (int i = 0; i < 4; i++) {
        double fov = degrees[i] * TRUTH_PI / 180, tall = 2 * tan(0.5 * fov);
        truth_world world;
        truth_open(&world);
        truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, -1), truth_v(2 * tall, 0, 0), truth_v(0, 2 * tall, 0), 1),
                         truth_lambert(world.scene, 1));
        truth_commit(&world);
        hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0, 0, 0), truth_v(0, 0, -1), fov);
        hydra_render_desc desc = shot_desc(&sensor, 8, 8, 64);
        hydra_render *render = truth_render(world.scene, &desc);
        float *at = truth_read(render, HYDRA_POSITION, 64);
        for (uint32_t p = 0; p < 64; p++) {
            truth_v3 truth = truth_v((across(p % 8, 8) - 0.5) * tall, (0.5 - across(p / 8, 8)) * tall, -1);
            expect_place(&at[3 * p], truth, 0.1 * tall / 8 + 1e-6 * tall);
        }
        free(at);
        hydra_render_destroy(render);
        truth_close(&world);
    }
}

/* ---------------------------------------------------------------- shift, region, filter */

static float *positions_of(hydra_scene *scene, const hydra_render_desc *desc, size_t pixels) {
    hydra_render *render = truth_render(scene, desc);
    float *at = truth_read(render, HYDRA_POSITION, pixels);
    hydra_render_destroy(render);
    return at;
}

/* The window moves right and up by shift image heights. Catches: a shift that moves the picture instead of the window,
   that is measured in widths, or that is not applied. */
static void test_shift(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, -1), truth_v(9, 0, 0), truth_v(0, 9, 0), 1), truth_lambert(world.scene, 1));
    truth_commit(&world);
    for (int lens = 0; lens < 2; lens++) {
        hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0, 0, 0), truth_v(0, 0, -1), 1);
        sensor.kind = lens ? HYDRA_SENSOR_THIN_LENS : HYDRA_SENSOR_PINHOLE;
        sensor.lens_radius = 0.1f;
        sensor.shift[0] = 0.75f;
        sensor.shift[1] = 0.25f;
        double tall = 2 * tan(0.5);
        hydra_render_desc desc = shot_desc(&sensor, 12, 8, 256);
        float *at = positions_of(world.scene, &desc, 96);
        for (uint32_t p = 0; p < 96; p++) {
            double right = (across(p % 12, 12) - 0.5) * 1.5 + 0.75, rise = 0.5 - across(p / 12, 8) + 0.25;
            expect_place(&at[3 * p], truth_v(right * tall, rise * tall, -1), 0.1 * tall / 8);
        }
        free(at);
    }
    truth_close(&world);
}

/* Catches: regions that are mirrored, offset or scaled, or whose samples differ from those of the whole: the bits
   must be the same. */
static void test_region(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_soup(4, 100), truth_emitter(world.scene, 0.7, 0.3));
    truth_commit(&world);
    hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0.5, 0.5, 3), truth_v(0.5, 0.5, 0), 0.6);
    hydra_render_desc desc = shot_desc(&sensor, 40, 24, 8);
    hydra_render *render = truth_render(world.scene, &desc);
    float *whole = truth_read(render, HYDRA_RADIANCE, 40 * 24);
    hydra_render_destroy(render);
    static const uint32_t regions[][4] = {{0, 0, 16, 16}, {5, 3, 20, 10}, {39, 23, 1, 1}, {17, 0, 3, 24}};
    for (int r = 0; r < 4; r++) {
        const uint32_t *box = regions[r];
        memcpy(desc.region, box, sizeof desc.region);
        render = truth_render(world.scene, &desc);
        float *part = truth_read(render, HYDRA_RADIANCE, (size_t)box[2] * box[3]);
        for (uint32_t y = 0; y < box[3]; y++)
            assert_memory_equal(&part[3 * y * box[2]], &whole[3 * ((y + box[1]) * 40 + box[0])], 12 * (size_t)box[2]);
        free(part);
        hydra_render_destroy(render);
    }
    free(whole);
    truth_close(&world);
}

/* A glowing half plane, x > 0, seen so that its edge lies between two pixel columns. */
static float *edge_picture(hydra_filter filter, double move) {
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(10, 0, -1), truth_v(10, 0, 0), truth_v(0, 10, 0), 1), truth_emitter(world.scene, 0, 1));
    truth_commit(&world);
    double tall = 2 * tan(0.2);
    hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(-move * tall / 8, 0, 0), truth_v(-move * tall / 8, 0, -1), 0.4);
    sensor.filter = filter;
    hydra_render_desc desc = shot_desc(&sensor, 8, 8, 256);
    hydra_render *render = truth_render(world.scene, &desc);
    float *rgb = truth_read(render, HYDRA_RADIANCE, 64);
    hydra_render_destroy(render);
    truth_close(&world);
    return rgb;
}

static double column_mean(const float *rgb, uint32_t x) {
    double sum = 0;
    for (uint32_t y = 0; y < 8; y++) sum += (double)rgb[3 * (8 * y + x)] / 8;
    return sum;
}

/* The share of a filter of this width that lies beyond the edge, d pixels from its middle. */
static double tent_beyond(double d) { return d >= 1 ? 0 : d <= -1 ? 1 : d > 0 ? 0.5 * (1 - d) * (1 - d) : 1 - 0.5 * (1 + d) * (1 + d); }
static double box_beyond(double d) { return fmax(0, fmin(1, 0.5 - d)); }

/* Catches: filters of another width or shape, or weighted so that edges move. */
static void test_filters(void **state) {
    (void)state;
    static const double moves[] = {0, 0.25};
    for (int m = 0; m < 2; m++) {
        float *box = edge_picture(HYDRA_FILTER_BOX, moves[m]), *tent = edge_picture(HYDRA_FILTER_TENT, moves[m]);
        for (uint32_t x = 0; x < 8; x++) {
            double d = 4 + moves[m] - (x + 0.5); /* the edge, in pixels right of this pixel's middle */
            TRUTH_WITHIN("box at an edge", column_mean(box, x), box_beyond(d) - 0.005, box_beyond(d) + 0.005);
            TRUTH_WITHIN("tent at an edge", column_mean(tent, x), tent_beyond(d) - 0.01, tent_beyond(d) + 0.01);
        }
        free(box);
        free(tent);
    }
}

/* ---------------------------------------------------------------- thin lens */

/* Share of a disc of radius 1 with x > c. */
static double disc_beyond(double c) { return c >= 1 ? 0 : c <= -1 ? 1 : (acos(c) - c * sqrt(1 - c * c)) / TRUTH_PI; }

/* A glowing half plane x > 0 at distance z, focus at distance f: through lens point u the pixel at X on the focus plane
   sees x = u (1 - z/f) + X z/f. */
static double blurred(double x, double z, double f, double radius) {
    double blur = fabs(1 - z / f) * radius;
    if (blur == 0) return x > 0;
    return disc_beyond(-x * z / f / blur);
}

static void lens(double z, double focus, bool by_target) {
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(50, 0, -z), truth_v(50, 0, 0), truth_v(0, 50, 0), 1), truth_emitter(world.scene, 0, 1));
    truth_commit(&world);
    hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0, 0, 0), truth_v(0, 0, by_target ? -focus : -1), 0.5);
    sensor.kind = HYDRA_SENSOR_THIN_LENS;
    sensor.lens_radius = 0.2f;
    sensor.focus_distance = by_target ? 0 : (float)focus;
    hydra_render_desc desc = shot_desc(&sensor, 16, 8, 1024);
    hydra_render *render = truth_render(world.scene, &desc);
    float *rgb = truth_read(render, HYDRA_RADIANCE, 128);
    double pixel = 2 * tan(0.25) * focus / 8;
    for (uint32_t x = 0; x < 16; x++) {
        double truth = 0, mean = 0;
        for (int k = 0; k < 100; k++) truth += 0.01 * blurred(((double)x - 8 + (k + 0.5) / 100) * pixel, z, focus, 0.2);
        for (uint32_t y = 0; y < 8; y++) mean += (double)rgb[3 * (16 * y + x)] / 8;
        TRUTH_WITHIN("edge through a lens", mean, truth - 0.02, truth + 0.02);
    }
    free(rgb);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* Catches: lens radius taken as diameter, focus by Euclidean distance, lens samples that are not uniform, blur that
   is not a disc; what is in focus must be sharp. */
static void test_thin_lens(void **state) {
    (void)state;
    lens(2, 2, false);
    lens(2, 2, true);
    lens(4, 2, false);
    lens(1.2, 2, true);
}

/* ---------------------------------------------------------------- orthographic, panorama, points, rays */

/* Catches: ortho_height taken as half, directions that diverge, depth from the wrong place. */
static void test_orthographic(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        double tall = k ? 0.6 : 2; /* the default */
        truth_world world;
        truth_open(&world);
        hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(1, 2, 3), truth_v(3, 1, -4), 0);
        sensor.kind = HYDRA_SENSOR_ORTHOGRAPHIC;
        sensor.ortho_height = k ? 0.6f : 0;
        frame f = frame_of(&sensor, truth_v(0, 1, 0));
        add_screen(world.scene, &f, 4, 10, truth_lambert(world.scene, 1));
        truth_commit(&world);
        hydra_render_desc desc = shot_desc(&sensor, 12, 8, 64);
        hydra_render *render = truth_render(world.scene, &desc);
        float *at = truth_read(render, HYDRA_POSITION, 96), *depth = truth_read(render, HYDRA_DEPTH, 96);
        for (uint32_t p = 0; p < 96; p++) {
            double right = (across(p % 12, 12) - 0.5) * 1.5 * tall, rise = (0.5 - across(p / 12, 8)) * tall;
            truth_v3 truth = truth_add(truth_mul(f.forward, 4), truth_add(truth_mul(f.right, right), truth_mul(f.up, rise)));
            expect_place(&at[3 * p], truth_add(f.origin, truth), 0.1 * tall / 8);
            TRUTH_NEAR("orthographic depth", (double)depth[p], 4, 2e-6);
        }
        free(at);
        free(depth);
        hydra_render_destroy(render);
        truth_close(&world);
    }
}

/* All directions: the middle looks at the target, right of it is right, the top row is up.
   Catches: mirrored panoramas, poles at the wrong end, a seam in the middle. */
static void test_equirectangular(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_sensor_desc sensor = truth_sensor_pinhole(truth_v(0.2, 0.3, -0.1), truth_v(5, 0.3, 2), 0);
    sensor.kind = HYDRA_SENSOR_EQUIRECTANGULAR;
    frame f = frame_of(&sensor, truth_v(0, 1, 0));
    truth_scene_mesh(world.scene, truth_mesh_sphere(f.origin, 100, 4, true), truth_lambert(world.scene, 0)); /* white, paths never end */
    truth_commit(&world);
    hydra_render_desc desc = shot_desc(&sensor, 32, 16, 64);
    float *at = positions_of(world.scene, &desc, 512);
    for (uint32_t p = 0; p < 512; p++) {
        double azimuth = (across(p % 32, 32) - 0.5) * 2 * TRUTH_PI, polar = across(p / 32, 16) * TRUTH_PI;
        truth_v3 level = truth_add(truth_mul(f.forward, cos(azimuth)), truth_mul(f.right, sin(azimuth)));
        truth_v3 truth = truth_add(truth_mul(level, sin(polar)), truth_mul(f.up, cos(polar)));
        truth_v3 seen = truth_unit(truth_sub(truth_load(&at[3 * p]), f.origin));
        TRUTH_WITHIN("angle between pixel and truth", truth_length(truth_sub(seen, truth)), 0, 0.1 * TRUTH_PI / 16);
    }
    free(at);
    truth_close(&world);
}

/* Catches: rays of the caller that are jittered, normalised wrongly (depth), reordered, or cut at t_max; points that
   are reordered. Strided input for both. */
static void test_rays(void **state) {
    (void)state;
    struct {
        hydra_ray ray;
        double between;
    } rays[24];
    truth_world world;
    truth_open(&world);
    truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(0, 0, -2), truth_v(99, 0, 0), truth_v(0, 99, 0), 1), truth_lambert(world.scene, 1));
    truth_commit(&world);
    ht_rng rng = ht_rng_make(3);
    for (int i = 0; i < 24; i++) {
        truth_store(rays[i].ray.origin, truth_rng_direction(&rng));
        truth_store(rays[i].ray.direction, truth_mul(truth_v(truth_rng_unit(&rng), truth_rng_unit(&rng), -1), 0.01 + 50 * truth_rng_unit(&rng)));
        rays[i].ray.t_min = 0;
        rays[i].ray.t_max = i % 5 ? INFINITY : 0.001f; /* every fifth ends in the air */
    }
    hydra_sensor_desc sensor;
    memset(&sensor, 0, sizeof sensor);
    sensor.kind = HYDRA_SENSOR_RAYS;
    sensor.rays.data = rays;
    sensor.rays.count = 24;
    sensor.rays.stride = sizeof rays[0];
    hydra_render_desc desc = shot_desc(&sensor, 6, 4, 2);
    hydra_render *render = truth_render(world.scene, &desc);
    float *at = truth_read(render, HYDRA_POSITION, 24), *depth = truth_read(render, HYDRA_DEPTH, 24);
    for (int i = 0; i < 24; i++) {
        truth_v3 o = truth_load(rays[i].ray.origin), d = truth_load(rays[i].ray.direction);
        double t = (-2 - o.z) / d.z;
        if (i % 5 == 0) {
            assert_true((double)depth[i] > 1e30);
            continue;
        }
        expect_place(&at[3 * i], truth_add(o, truth_mul(d, t)), 5e-5); /* corners are 99 away: 99 2^-24 a corner */
        TRUTH_NEAR("distance along a ray", (double)depth[i], t * truth_length(d), 1e-5);
    }
    free(at);
    free(depth);
    hydra_render_destroy(render);
    truth_close(&world);
}

/* Catches: points handed out in another order than they came in, or strides ignored. A point light at the origin
   gives every point at distance d, facing it, 1 / d^2. */
static void test_points_in_order(void **state) {
    (void)state;
    float positions[5 * 35], normals[4 * 35];
    ht_rng rng = ht_rng_make(8);
    for (int i = 0; i < 35; i++) {
        truth_v3 d = truth_rng_direction(&rng);
        truth_store(&positions[5 * i], truth_mul(d, 1 + 0.2 * i));
        truth_store(&normals[4 * i], truth_mul(d, -1));
    }
    truth_world world;
    truth_open(&world);
    hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, 1);
    hydra_scene_add_light(world.scene, &light);
    truth_commit(&world);
    hydra_sensor_desc sensor = truth_sensor_points(positions, normals, 35);
    sensor.point_positions.stride = 20;
    sensor.point_normals.stride = 16;
    hydra_render_desc desc = shot_desc(&sensor, 7, 5, 4);
    desc.outputs = 0;
    hydra_render *render = truth_render(world.scene, &desc);
    memset(positions, 0xff, sizeof positions);
    float *rgb = truth_read(render, HYDRA_RADIANCE, 35);
    for (int i = 0; i < 35; i++) TRUTH_NEAR("irradiance of a point", (double)rgb[3 * i], pow(1 + 0.2 * i, -2), 1e-5);
    free(rgb);
    hydra_render_destroy(render);
    truth_close(&world);
}

int hydra_test_sensors(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pinhole),        cmocka_unit_test(test_pinhole_defaults),
        cmocka_unit_test(test_looking_along_up), cmocka_unit_test(test_extreme_angles),
        cmocka_unit_test(test_shift),          cmocka_unit_test(test_region),
        cmocka_unit_test(test_filters),        cmocka_unit_test(test_thin_lens),
        cmocka_unit_test(test_orthographic),   cmocka_unit_test(test_equirectangular),
        cmocka_unit_test(test_rays),           cmocka_unit_test(test_points_in_order)};
    return cmocka_run_group_tests_name("sensors", tests, NULL, NULL);
}
