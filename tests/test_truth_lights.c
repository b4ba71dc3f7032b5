/* Truth B.2 to B.7: every kind of light against its formula, through the whole renderer, at several poses and
   scales, by each strategy. Receivers are points in free space or on surfaces. */
#include "truth_helpers.h"

int hydra_test_truth_lights(void);

static const double scales[] = {1, 1e-3, 1e3};

/* ---------------------------------------------------------------- one light over one point */

/* The light moved with the pose; radiance stays, intensity and power grow with the square of the scale. */
static hydra_light_desc posed(const hydra_light_desc *local, const truth_pose *pose) {
    hydra_light_desc light = *local;
    bool quadratic = local->unit == HYDRA_UNIT_POWER || local->kind == HYDRA_LIGHT_POINT || local->kind == HYDRA_LIGHT_SPOT;
    truth_store(light.position, truth_pose_point(pose, truth_load(local->position)));
    truth_store(light.direction, truth_pose_direction(pose, truth_load(local->direction)));
    truth_store(light.axis_u, truth_pose_vector(pose, truth_load(local->axis_u)));
    truth_store(light.axis_v, truth_pose_vector(pose, truth_load(local->axis_v)));
    light.radius = (float)((double)local->radius * pose->scale);
    for (int c = 0; c < 3; c++) light.color[c] *= quadratic ? (float)(pose->scale * pose->scale) : 1;
    return light;
}

/* The receiver stands at the origin and looks along +z, before the pose. */
static truth_estimate lit_by(const hydra_light_desc *local, const truth_pose *pose, hydra_strategy strategy, uint32_t samples) {
    truth_world world;
    truth_open(&world);
    hydra_light_desc light = posed(local, pose);
    assert_int_not_equal(hydra_scene_add_light(world.scene, &light).id, 0);
    truth_commit(&world);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = truth_samples(samples);
    probe.strategy = strategy;
    truth_estimate e = truth_irradiance(world.scene, pose->origin, truth_pose_direction(pose, truth_v(0, 0, 1)), probe);
    truth_close(&world);
    return e;
}

/* Float positions of a light at distance D from the world's origin carry D 2^-24: with offsets of three sizes the
   irradiance is good to about 2e-6; 2e-5 is allowed. */
static void expect_light(const char *what, const hydra_light_desc *local, double truth, double bound) {
    for (int i = 0; i < 3; i++) {
        truth_pose pose = truth_pose_random(100u + (unsigned)i, scales[i], 3);
        TRUTH_EXPECT(what, lit_by(local, &pose, HYDRA_STRATEGY_MIS, 64), truth, bound, 2e-5);
        TRUTH_EXPECT(what, lit_by(local, &pose, HYDRA_STRATEGY_LIGHTS, 64), truth, bound, 2e-5);
    }
}

/* Lights with an extent are found by scattered rays too: their shape, its pose and the weights must agree. */
static void expect_area_light(const char *what, const hydra_light_desc *local, double truth, double bound) {
    expect_light(what, local, truth, bound);
    truth_pose pose = truth_pose_random(200, 1, 3);
    TRUTH_EXPECT(what, lit_by(local, &pose, HYDRA_STRATEGY_BSDF, 256), truth, 0.04, 2e-5);
}

/* E from a cone of uniform radiance 1, its axis at an angle from the normal; midpoint rule in double. Below the
   horizon counts nothing. */
static double cone_irradiance(double axis_angle, double half_angle) {
    enum { N = 1000 };
    double sum = 0, s = sin(axis_angle), c = cos(axis_angle), lowest = cos(half_angle);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double z = lowest + (1 - lowest) * (i + 0.5) / N, r = sqrt(1 - z * z);
            double cosine = c * z + s * r * cos(2 * TRUTH_PI * (j + 0.5) / N);
            if (cosine > 0) sum += cosine;
        }
    return sum * 2 * TRUTH_PI * (1 - lowest) / ((double)N * N);
}

/* ---------------------------------------------------------------- points and spots */

/* Catches: inverse square or cosine wrong, intensity taken for power, a factor 4 pi or pi. */
static void test_point_light(void **state) {
    (void)state;
    hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, 5);
    double h = 1.3, d = 0.7, e = h / pow(h * h + d * d, 1.5);
    truth_store(light.position, truth_v(d, 0, h));
    expect_light("point light", &light, 5 * e, 1e-5);
    light.unit = HYDRA_UNIT_POWER;
    expect_light("point light of known power", &light, 5 / (4 * TRUTH_PI) * e, 1e-5);
}

/* Catches: lights lost to overflow, underflow or a threshold: 1e-12 to 1e12, and points very near. */
static void test_point_light_extremes(void **state) {
    (void)state;
    static const double intensities[] = {1e-12, 1e-6, 1e6, 1e12}, distances[] = {1e-4, 1, 1e5};
    truth_pose pose = truth_pose_identity();
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 3; j++) {
            hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, intensities[i]);
            truth_store(light.position, truth_v(0, 0, distances[j]));
            double truth = (double)light.color[0] / (distances[j] * distances[j]);
            TRUTH_EXPECT("extreme point light", lit_by(&light, &pose, HYDRA_STRATEGY_MIS, 8), truth, 1e-5, 2e-5);
        }
}

/* E at a point that the spot sees at an angle off its axis; the receiver faces the spot. */
static truth_estimate spot_at(double angle, double inner, double outer) {
    hydra_light_desc light = truth_light(HYDRA_LIGHT_SPOT, 7);
    truth_store(light.position, truth_v(0, 0, 2));
    truth_store(light.direction, truth_mul(truth_v(sin(angle), 0, -cos(angle)), 3));
    light.cone_inner = (float)inner;
    light.cone_outer = (float)outer;
    truth_pose pose = truth_pose_random(17, 1, 1);
    return lit_by(&light, &pose, HYDRA_STRATEGY_MIS, 8);
}

/* Catches: cone angles taken as full angles, degrees, or cosines swapped; a step instead of a smooth edge. */
static void test_spot_light(void **state) {
    (void)state;
    double last = 7.0 / 4;
    TRUTH_EXPECT("spot on its axis", spot_at(0, 0.4, 0.6), 7.0 / 4, 1e-5, 2e-5);
    TRUTH_EXPECT("spot in the inner cone", spot_at(0.39, 0.4, 0.6), 7.0 / 4, 1e-5, 2e-5);
    for (double angle = 0.42; angle < 0.6; angle += 0.04) {
        truth_estimate e = spot_at(angle, 0.4, 0.6);
        TRUTH_WITHIN("spot between the cones", e.mean, 1e-6, last);
        assert_true(e.mean < last);
        last = e.mean;
    }
    TRUTH_WITHIN("spot outside", spot_at(0.61, 0.4, 0.6).mean, 0, 0);
    TRUTH_WITHIN("spot behind", spot_at(TRUTH_PI, 0.4, 0.6).mean, 0, 0);
    TRUTH_EXPECT("default cone, inside", spot_at(0.69, 0, 0), 7.0 / 4, 1e-5, 2e-5);
    TRUTH_WITHIN("default cone, outside", spot_at(0.79, 0, 0).mean, 0, 0);
}

/* ---------------------------------------------------------------- area lights */

/* Catches: cone sampling of spheres with a wrong pdf or sine, for small, large and half-set spheres. */
static void test_sphere_light(void **state) {
    (void)state;
    static const double angles[] = {0, 0.7, 1.2}, ratios[] = {0.25, 0.01, 0.3};
    for (int i = 0; i < 3; i++) {
        double distance = 2, radius = ratios[i] * distance;
        hydra_light_desc light = truth_light(HYDRA_LIGHT_SPHERE, 3);
        truth_store(light.position, truth_mul(truth_v(sin(angles[i]), 0, cos(angles[i])), distance));
        light.radius = (float)radius;
        double truth = 3 * TRUTH_PI * ratios[i] * ratios[i] * cos(angles[i]);
        if (ratios[i] > 0.1) expect_area_light("sphere light", &light, truth, 0.003);
        else expect_light("small sphere light", &light, truth, 0.003);
        light.unit = HYDRA_UNIT_POWER;
        expect_light("sphere light of known power", &light, truth / (4 * TRUTH_PI * TRUTH_PI * radius * radius), 0.003);
    }
}

static void test_sphere_light_at_horizon(void **state) {
    (void)state;
    hydra_light_desc light = truth_light(HYDRA_LIGHT_SPHERE, 3);
    truth_store(light.position, truth_mul(truth_v(sin(1.5), 0, cos(1.5)), 2));
    light.radius = 0.8f;
    expect_area_light("sphere light half set", &light, 3 * cone_irradiance(1.5, asin(0.4)), 0.006);
}

/* A disc as a polygon of 512 corners, 0.003 % too small, made larger by as much. */
static double disc_irradiance(const hydra_light_desc *light, truth_v3 u, truth_v3 v) {
    static truth_v3 corners[TRUTH_CORNERS];
    double step = 2 * TRUTH_PI / TRUTH_CORNERS, r = (double)light->radius * sqrt(step / sin(step));
    for (int i = 0; i < TRUTH_CORNERS; i++)
        corners[i] = truth_add(truth_load(light->position),
                               truth_add(truth_mul(u, r * cos(i * step)), truth_mul(v, r * sin(i * step))));
    return truth_polygon_irradiance(corners, TRUTH_CORNERS, truth_v(0, 0, 0), truth_v(0, 0, 1), (double)light->color[0]);
}

/* Catches: disc sampling that is not uniform, a wrong side, a cosine missing. */
static void test_disc_light(void **state) {
    (void)state;
    hydra_light_desc light = truth_light(HYDRA_LIGHT_DISC, 2);
    truth_store(light.position, truth_v(0, 0, 0.8));
    truth_store(light.direction, truth_v(0, 0, -4));
    light.radius = 1;
    expect_area_light("disc light above", &light, TRUTH_PI * 2 / (1 + 0.64), 0.003);
    light.unit = HYDRA_UNIT_POWER;
    expect_light("disc light of known power", &light, TRUTH_PI * 2 / (1 + 0.64) / (TRUTH_PI * TRUTH_PI), 0.003);
    light.unit = HYDRA_UNIT_DEFAULT;
    truth_store(light.position, truth_v(1, 0.3, 0.9)); /* tilted, partly below the horizon */
    truth_store(light.direction, truth_v(-1, 0, 0));
    light.radius = 1.4f;
    expect_area_light("disc light across the horizon", &light, disc_irradiance(&light, truth_v(0, 1, 0), truth_v(0, 0, 1)), 0.006);
    truth_store(light.direction, truth_v(1, 0, 0));
    truth_pose pose = truth_pose_identity();
    TRUTH_WITHIN("disc light from behind", lit_by(&light, &pose, HYDRA_STRATEGY_MIS, 16).mean, 0, 0);
    light.both_sides = true;
    TRUTH_EXPECT("disc light of two sides", lit_by(&light, &pose, HYDRA_STRATEGY_MIS, 64),
                 disc_irradiance(&light, truth_v(0, 1, 0), truth_v(0, 0, 1)), 0.006, 2e-5);
}

static void rect_corners(const hydra_light_desc *light, truth_v3 corners[4]) {
    static const int su[4] = {-1, 1, 1, -1}, sv[4] = {-1, -1, 1, 1};
    truth_v3 p = truth_load(light->position), u = truth_load(light->axis_u), v = truth_load(light->axis_v);
    for (int i = 0; i < 4; i++) corners[i] = truth_add(p, truth_add(truth_mul(u, su[i]), truth_mul(v, sv[i])));
}

/* A rectangle anywhere above or across the horizon that shines towards the origin. */
static hydra_light_desc random_rect(uint64_t seed) {
    ht_rng rng = ht_rng_make(seed);
    hydra_light_desc light = truth_light(HYDRA_LIGHT_RECT, 1.5);
    truth_v3 centre = truth_rng_direction(&rng);
    centre.z = fabs(centre.z) + 0.2;
    truth_v3 normal = truth_unit(truth_add(truth_mul(truth_unit(centre), -1), truth_mul(truth_rng_direction(&rng), 0.6)));
    truth_v3 u = truth_unit(truth_cross(truth_rng_direction(&rng), normal)), v = truth_cross(normal, u);
    truth_store(light.position, centre);
    truth_store(light.axis_u, truth_mul(u, 0.1 + truth_rng_unit(&rng)));
    truth_store(light.axis_v, truth_mul(v, 0.1 + truth_rng_unit(&rng)));
    return light;
}

/* Catches: anything wrong with rectangles at general poses; solid angle sampling near and across the horizon. */
static void test_rect_light(void **state) {
    (void)state;
    for (uint64_t seed = 0; seed < 6; seed++) {
        hydra_light_desc light = random_rect(seed);
        truth_v3 corners[4];
        rect_corners(&light, corners);
        double truth = truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 1.5);
        expect_area_light("rectangle light", &light, truth, 0.01);
    }
}

/* B.6 and Lambert's formula agree to rounding, and the light with both. Catches: a mistake in the truth itself. */
static void test_rect_corner_formula(void **state) {
    (void)state;
    double a = 1.2, b = 0.7, h = 0.9, x = a / h, y = b / h;
    double f = (x / sqrt(1 + x * x) * atan(y / sqrt(1 + x * x)) + y / sqrt(1 + y * y) * atan(x / sqrt(1 + y * y))) / (2 * TRUTH_PI);
    hydra_light_desc light = truth_light(HYDRA_LIGHT_RECT, 1);
    truth_v3 corners[4];
    truth_store(light.position, truth_v(a / 2, b / 2, h));
    truth_store(light.axis_u, truth_v(0, b / 2, 0));
    truth_store(light.axis_v, truth_v(a / 2, 0, 0));
    rect_corners(&light, corners);
    TRUTH_NEAR("corner formula", truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 1), TRUTH_PI * f, 1e-6);
    expect_area_light("rectangle above a corner", &light, TRUTH_PI * f, 0.004);
    light.unit = HYDRA_UNIT_POWER;
    expect_light("rectangle of known power", &light, TRUTH_PI * f / (TRUTH_PI * a * b), 0.004);
}

/* Catches: sampling that breaks down when the light is almost touched or almost edge-on. */
static void test_rect_light_near(void **state) {
    (void)state;
    hydra_light_desc light = truth_light(HYDRA_LIGHT_RECT, 1);
    truth_v3 corners[4];
    truth_store(light.position, truth_v(0, 0, 0.01));
    truth_store(light.axis_u, truth_v(0, 1, 0));
    truth_store(light.axis_v, truth_v(1, 0, 0));
    rect_corners(&light, corners);
    double truth = truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 1);
    truth_pose pose = truth_pose_random(3, 1, 1);
    TRUTH_EXPECT("rectangle a hundredth away", lit_by(&light, &pose, HYDRA_STRATEGY_MIS, 64), truth, 0.01, 2e-5);
}

/* ---------------------------------------------------------------- the sun */

/* Catches: the sun's disc without sin^2, its direction reversed, units mixed, a set sun that still shines. */
static void test_sun(void **state) {
    (void)state;
    static const double angles[] = {0, 0.9, 1.2};
    for (int i = 0; i < 3; i++) {
        hydra_light_desc sun = truth_light(HYDRA_LIGHT_SUN, 4);
        truth_store(sun.direction, truth_mul(truth_v(-sin(angles[i]), 0, -cos(angles[i])), 5));
        expect_light("parallel sun", &sun, 4 * cos(angles[i]), 1e-5);
        sun.angular_radius = 0.2f;
        expect_area_light("sun with a disc", &sun, 4 * TRUTH_PI * sin(0.2) * sin(0.2) * cos(angles[i]), 0.003);
        sun.angular_radius = 0.00465f;
        expect_light("sun as large as ours", &sun, 4 * TRUTH_PI * pow(sin(0.00465), 2) * cos(angles[i]), 0.001);
        sun.unit = HYDRA_UNIT_IRRADIANCE;
        expect_light("sun of known irradiance", &sun, 4 * cos(angles[i]), 0.001);
    }
    hydra_light_desc low = truth_light(HYDRA_LIGHT_SUN, 4);
    truth_store(low.direction, truth_v(-sin(1.5), 0, -cos(1.5)));
    low.angular_radius = 0.3f;
    expect_area_light("sun half set", &low, 4 * cone_irradiance(1.5, 0.3), 0.006);
}

/* ---------------------------------------------------------------- what is seen of lights */

static double seen(hydra_scene *scene, truth_v3 origin, truth_v3 direction) {
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = 2;
    return truth_radiance(scene, origin, direction, probe).mean;
}

/* Catches: a light seen with another radiance than it lights with; its dark side; hidden lights; suns in the sky. */
static void test_lights_seen(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_light_desc rect = truth_light(HYDRA_LIGHT_RECT, 3), disc = truth_light(HYDRA_LIGHT_DISC, 4);
    hydra_light_desc ball = truth_light(HYDRA_LIGHT_SPHERE, 5), sun = truth_light(HYDRA_LIGHT_SUN, 6);
    truth_store(rect.axis_u, truth_v(1, 0, 0));
    truth_store(rect.axis_v, truth_v(0, 1, 0));
    truth_store(disc.position, truth_v(5, 0, 0));
    truth_store(disc.direction, truth_v(0, 0, 1));
    disc.radius = 1;
    disc.both_sides = true;
    truth_store(ball.position, truth_v(10, 0, 0));
    ball.radius = 1;
    truth_store(sun.direction, truth_v(-1, 0, 0));
    sun.angular_radius = 0.1f;
    hydra_scene_add_light(world.scene, &rect);
    hydra_scene_add_light(world.scene, &disc);
    hydra_scene_add_light(world.scene, &ball);
    hydra_scene_add_light(world.scene, &sun);
    hydra_light_desc hidden = rect;
    truth_store(hidden.position, truth_v(0, 0, 1));
    hidden.hidden = true;
    hidden.color[0] = 9;
    hydra_scene_add_light(world.scene, &hidden);
    truth_commit(&world);
    TRUTH_NEAR("rectangle through a hidden one", seen(world.scene, truth_v(0.9, 0.9, 3), truth_v(0, 0, -1)), 3, 1e-6);
    TRUTH_WITHIN("rectangle from behind", seen(world.scene, truth_v(0.9, 0.9, -3), truth_v(0, 0, 1)), 0, 0);
    TRUTH_WITHIN("beside the rectangle", seen(world.scene, truth_v(1.1, 0.9, 3), truth_v(0, 0, -1)), 0, 0);
    TRUTH_NEAR("disc, front", seen(world.scene, truth_v(5.7, 0.7, 3), truth_v(0, 0, -1)), 4, 1e-6);
    TRUTH_NEAR("disc, back", seen(world.scene, truth_v(5.7, 0.7, -3), truth_v(0, 0, 1)), 4, 1e-6);
    TRUTH_WITHIN("beside the disc", seen(world.scene, truth_v(5.75, 0.75, 3), truth_v(0, 0, -1)), 0, 0);
    TRUTH_NEAR("sphere", seen(world.scene, truth_v(10.7, 0.7, 3), truth_v(0, 0, -1)), 5, 1e-6);
    TRUTH_NEAR("sun", seen(world.scene, truth_v(0, 20, 0), truth_v(1, 0.09, 0)), 6, 1e-6);
    TRUTH_WITHIN("beside the sun", seen(world.scene, truth_v(0, 20, 0), truth_v(1, 0.11, 0)), 0, 0);
    truth_close(&world);
}

/* Catches: lights that do not shade each other: a rectangle between a point light and the receiver takes it all,
   even a hidden one ("casting shadows, by any ray"). */
static void test_lights_cast_shadows(void **state) {
    (void)state;
    for (int hidden = 0; hidden < 2; hidden++) {
        truth_world world;
        truth_open(&world);
        hydra_light_desc point = truth_light(HYDRA_LIGHT_POINT, 100), rect = truth_light(HYDRA_LIGHT_RECT, 0.5);
        truth_store(point.position, truth_v(0, 0, 4));
        truth_store(rect.position, truth_v(0, 0, 1));
        truth_store(rect.axis_u, truth_v(0, 0.5, 0));
        truth_store(rect.axis_v, truth_v(0.5, 0, 0));
        rect.hidden = hidden != 0;
        hydra_scene_add_light(world.scene, &point);
        hydra_scene_add_light(world.scene, &rect);
        truth_commit(&world);
        truth_v3 corners[4];
        rect_corners(&rect, corners);
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(128);
        double truth = truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 0.5);
        TRUTH_EXPECT("point light behind a rectangle light", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 0, 1), probe),
                     truth, 0.02, 2e-5);
        truth_close(&world);
    }
}

/* A strip of light past the edge of a screen half a metre above the point. The screen is one metre or a kilometre wide,
   which must not matter. Catches: receivers or shadow rays moved by a share of the scene's size: an offset of 1e-5 of
   it moves this shadow by a seventh of the strip. */
static void test_shadow_in_large_scene(void **state) {
    (void)state;
    static const double sizes[] = {0.5, 25, 500};
    truth_v3 strip[4] = {{-0.4, 1, -0.3}, {-0.35, 1, -0.3}, {-0.35, 1, 0.3}, {-0.4, 1, 0.3}}, point = truth_v(0.35, 0, 0.15);
    double truth = truth_polygon_irradiance(strip, 4, point, truth_v(0, 1, 0), 1);
    for (int i = 0; i < 3; i++) {
        double half = sizes[i];
        truth_world world;
        truth_open(&world);
        hydra_light_desc light = truth_light(HYDRA_LIGHT_RECT, 1);
        truth_store(light.position, truth_v(0, 1, 0));
        truth_store(light.axis_u, truth_v(0.4, 0, 0));
        truth_store(light.axis_v, truth_v(0, 0, 0.3));
        hydra_scene_add_light(world.scene, &light);
        truth_scene_mesh(world.scene, truth_mesh_quad(truth_v(half, 0.5, 0), truth_v(half, 0, 0), truth_v(0, 0, -half), 1), truth_lambert(world.scene, 0));
        truth_commit(&world);
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(1024);
        TRUTH_EXPECT("light past an edge", truth_irradiance(world.scene, point, truth_v(0, 1, 0), probe), truth, 0.003, 5e-4);
        truth_close(&world);
    }
}

/* ---------------------------------------------------------------- power, and many lights */

/* All flux lands on the walls of a black box, whatever the light. Catches: power units of every kind. */
static void expect_power(const char *what, hydra_light_desc light, double bound) {
    truth_world world;
    truth_open(&world);
    truth_mesh box = truth_mesh_box(truth_v(0.2, 0, 0.1), truth_v(1, 1.5, 1.2), true);
    hydra_mesh_desc desc = truth_mesh_desc(&box, truth_lambert(world.scene, 0));
    hydra_scene_add_mesh(world.scene, &desc);
    light.unit = HYDRA_UNIT_POWER;
    hydra_scene_add_light(world.scene, &light);
    truth_commit(&world);
    truth_estimate e = {0, 0};
    enum { RUNS = 8 }; /* fresh points each time: the spread over the walls is the error that counts */
    for (uint32_t run = 0; run < RUNS; run++) {
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(16);
        probe.seed = run;
        truth_estimate part = truth_mesh_irradiance(world.scene, &box, probe);
        e.mean += part.mean / RUNS;
        e.error += part.error * part.error / (RUNS * RUNS);
    }
    e.error = sqrt(e.error);
    TRUTH_EXPECT(what, e, (double)light.color[0] / truth_mesh_area(&box), bound, 1e-5);
    truth_mesh_free(&box);
    truth_close(&world);
}

static void test_power(void **state) {
    (void)state;
    hydra_light_desc light = truth_light(HYDRA_LIGHT_SPOT, 10);
    light.cone_outer = 0.9f;
    light.cone_inner = 0.2f;
    truth_store(light.direction, truth_v(0.2, 1, -0.3));
    expect_power("power of a spot", light, 0.06);
    light.cone_outer = 3.0f;
    light.cone_inner = 2.0f;
    expect_power("power of a wide spot", light, 0.03);
    light = truth_light(HYDRA_LIGHT_RECT, 10);
    truth_store(light.axis_u, truth_v(0.3, 0.1, 0));
    truth_store(light.axis_v, truth_v(0, 0, 0.4));
    expect_power("power of a rectangle", light, 0.03);
    light.both_sides = true;
    expect_power("power of two sides", light, 0.03);
    light = truth_light(HYDRA_LIGHT_DISC, 10);
    light.radius = 0.4f;
    light.both_sides = true;
    expect_power("power of a disc of two sides", light, 0.03);
    light = truth_light(HYDRA_LIGHT_SPHERE, 10);
    light.radius = 0.5f;
    expect_power("power of a sphere", light, 0.03);
}

/* Catches: light selection whose probabilities do not add up: 200 points of very different power, some behind. */
static void test_many_lights(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    ht_rng rng = ht_rng_make(12);
    double truth = 0;
    for (int i = 0; i < 200; i++) {
        double intensity = pow(10, 4 * truth_rng_unit(&rng) - 2);
        truth_v3 p = truth_mul(truth_rng_direction(&rng), 1 + 3 * truth_rng_unit(&rng));
        hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, intensity);
        truth_store(light.position, p);
        hydra_scene_add_light(world.scene, &light);
        if (p.z > 0) truth += intensity * p.z / pow(truth_length(p), 3);
    }
    truth_commit(&world);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = truth_samples(256);
    TRUTH_EXPECT("200 point lights", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 0, 1), probe), truth, 0.01, 1e-5);
    truth_close(&world);
}

/* ---------------------------------------------------------------- meshes that emit */

static truth_estimate mesh_light(truth_mesh mesh, hydra_material_desc *material, const hydra_texture_desc *texture,
                                 const float transform[12], hydra_strategy strategy) {
    truth_world world;
    truth_open(&world);
    if (texture) material->emission_texture = hydra_scene_add_texture(world.scene, texture);
    hydra_mesh_desc desc = truth_mesh_desc(&mesh, hydra_scene_add_material(world.scene, material));
    desc.instanced_only = transform != NULL;
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = hydra_scene_add_mesh(world.scene, &desc);
    if (transform) {
        memcpy(instance.transform, transform, sizeof instance.transform);
        assert_int_not_equal(hydra_scene_add_instance(world.scene, &instance).id, 0);
    }
    truth_commit(&world);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = truth_samples(128);
    probe.strategy = strategy;
    truth_estimate e = truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 0, 1), probe);
    truth_mesh_free(&mesh);
    truth_close(&world);
    return e;
}

static hydra_material_desc glow(double radiance) {
    hydra_material_desc material;
    memset(&material, 0, sizeof material);
    for (int c = 0; c < 3; c++) material.emission[c] = (float)radiance;
    return material;
}

/* Catches: triangle lights with a wrong area, side or pdf; finely divided ones; both-sided ones. */
static void test_mesh_lights(void **state) {
    (void)state;
    for (uint64_t seed = 20; seed < 24; seed++) {
        hydra_light_desc rect = random_rect(seed);
        truth_v3 c[4], p = truth_load(rect.position), u = truth_load(rect.axis_u), v = truth_load(rect.axis_v);
        rect_corners(&rect, c);
        double truth = truth_polygon_irradiance(c, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 2);
        hydra_material_desc material = glow(2);
        for (int s = 0; s < 3; s++)
            TRUTH_EXPECT("glowing quad", mesh_light(truth_mesh_quad(p, u, v, 1), &material, NULL, NULL, (hydra_strategy)s), truth, 0.03, 2e-5);
        TRUTH_EXPECT("quad of 128 triangles", mesh_light(truth_mesh_quad(p, u, v, 8), &material, NULL, NULL, HYDRA_STRATEGY_MIS), truth, 0.01, 2e-5);
        TRUTH_WITHIN("its back", mesh_light(truth_mesh_quad(p, v, u, 2), &material, NULL, NULL, HYDRA_STRATEGY_MIS).mean, 0, 0);
        material.emit_both_sides = true;
        TRUTH_EXPECT("its back, both sides", mesh_light(truth_mesh_quad(p, v, u, 2), &material, NULL, NULL, HYDRA_STRATEGY_MIS), truth, 0.01, 2e-5);
    }
}

/* Catches: a glowing closed mesh against the sphere light's formula. 1280 triangles lose 0.5 % of the disc's area;
   the truth is that of the polyhedron, from each facing triangle by Lambert's formula. */
static void test_glowing_sphere(void **state) {
    (void)state;
    truth_mesh ball = truth_mesh_sphere(truth_v(0.5, 0, 2), 0.7, 3, false);
    double truth = 0;
    for (uint32_t t = 0; t < ball.triangles; t++) {
        truth_v3 p[3];
        for (uint32_t k = 0; k < 3; k++) p[k] = truth_load(&ball.positions[3 * ball.indices[3 * t + k]]);
        truth_v3 front = truth_cross(truth_sub(p[1], p[0]), truth_sub(p[2], p[0]));
        if (truth_dot(front, p[0]) < 0) truth += truth_polygon_irradiance(p, 3, truth_v(0, 0, 0), truth_v(0, 0, 1), 3);
    }
    double cosine = 2 / sqrt(4.25);
    TRUTH_NEAR("polyhedron and sphere", truth, 3 * TRUTH_PI * 0.49 / 4.25 * cosine, 0.01);
    hydra_material_desc material = glow(3);
    TRUTH_EXPECT("glowing sphere", mesh_light(ball, &material, NULL, NULL, HYDRA_STRATEGY_MIS), truth, 0.01, 2e-5);
}

/* Catches: emitters under a transform: area scaled, mirrored faces turned inside out, shear forgotten. */
static void test_instanced_light(void **state) {
    (void)state;
    static const float transforms[3][12] = {{2, 0, 0, 0.3f, 0, 0.5f, 0, 0, 0, 0, 1, 1},           /* scaled unevenly */
                                            {-1, 0, 0, 0.2f, 0, 1, 0, 0.1f, 0, 0, 1, 1.5f},       /* mirrored */
                                            {1, 0.5f, 0, 0, 0, 1, 0.2f, 0, 0.3f, 0, -1.2f, 1.4f}}; /* sheared, mirrored */
    for (int i = 0; i < 3; i++) {
        const float *m = transforms[i];
        truth_v3 corners[4];
        for (int k = 0; k < 4; k++) {
            double x = k == 1 || k == 2 ? 0.6 : -0.6, y = k >= 2 ? 0.6 : -0.6;
            corners[k] = truth_v((double)m[0] * x + (double)m[1] * y + (double)m[3], (double)m[4] * x + (double)m[5] * y + (double)m[7],
                                 (double)m[8] * x + (double)m[9] * y + (double)m[11]);
        }
        double truth = truth_polygon_irradiance(corners, 4, truth_v(0, 0, 0), truth_v(0, 0, 1), 2);
        hydra_material_desc material = glow(2);
        bool up = i == 2; /* z is mirrored there: the quad that faces +z comes to face down */
        truth_mesh quad = truth_mesh_quad(truth_v(0, 0, 0), up ? truth_v(0.6, 0, 0) : truth_v(0, 0.6, 0),
                                          up ? truth_v(0, 0.6, 0) : truth_v(0.6, 0, 0), 2);
        TRUTH_EXPECT("instanced light", mesh_light(quad, &material, NULL, m, HYDRA_STRATEGY_MIS), truth, 0.01, 2e-5);
    }
}

/* Radiance of the quad below: four texels across, bilinear, clamped. */
static double ramp(const float *texels, double u) {
    double x = u * 4 - 0.5, f = floor(x);
    int a = (int)fmax(0, fmin(3, f)), b = (int)fmax(0, fmin(3, f + 1));
    return (double)texels[4 * a] * (1 - (x - f)) + (double)texels[4 * b] * (x - f);
}

/* Catches: textured emitters lit by their mean, or by another filter than they are seen with; sides of u swapped. */
static void test_textured_light(void **state) {
    (void)state;
    static const float texels[16] = {0, 0, 0, 1, 8, 8, 8, 1, 1, 1, 1, 1, 2, 2, 2, 1};
    enum { N = 400 };
    double truth = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double u = (i + 0.5) / N, v = (j + 0.5) / N;
            truth_v3 p = truth_v(2 * v - 0.6, 2 * u - 0.8, 0.7); /* u runs along y: the quad faces down */
            truth += 3 * ramp(texels, u) * 0.49 / pow(truth_dot(p, p), 2) * 4 / ((double)N * N);
        }
    hydra_texture_desc texture;
    memset(&texture, 0, sizeof texture);
    texture.texels = texels;
    texture.width = 4;
    texture.height = 1;
    texture.format = HYDRA_TEXEL_RGBA32F;
    texture.wrap_u = HYDRA_WRAP_CLAMP;
    texture.wrap_v = HYDRA_WRAP_CLAMP;
    texture.no_mipmaps = true;
    hydra_material_desc material = glow(3);
    for (int s = 0; s < 3; s++)
        for (uint32_t cells = 1; cells <= 8; cells += 7) {
            truth_mesh quad = truth_mesh_quad(truth_v(0.4, 0.2, 0.7), truth_v(0, 1, 0), truth_v(1, 0, 0), cells);
            TRUTH_EXPECT("textured light", mesh_light(quad, &material, &texture, NULL, (hydra_strategy)s), truth, 0.02, 1e-4);
        }
}

int hydra_test_truth_lights(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point_light),         cmocka_unit_test(test_point_light_extremes),
        cmocka_unit_test(test_spot_light),          cmocka_unit_test(test_sphere_light),
        cmocka_unit_test(test_sphere_light_at_horizon), cmocka_unit_test(test_disc_light),
        cmocka_unit_test(test_rect_light),          cmocka_unit_test(test_rect_corner_formula),
        cmocka_unit_test(test_rect_light_near),     cmocka_unit_test(test_sun),
        cmocka_unit_test(test_lights_seen),         cmocka_unit_test(test_lights_cast_shadows),
        cmocka_unit_test(test_shadow_in_large_scene), cmocka_unit_test(test_power),               cmocka_unit_test(test_many_lights),
        cmocka_unit_test(test_mesh_lights),         cmocka_unit_test(test_glowing_sphere),
        cmocka_unit_test(test_instanced_light),     cmocka_unit_test(test_textured_light)};
    return cmocka_run_group_tests_name("truth: lights", tests, NULL, NULL);
}
