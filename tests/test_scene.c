/* The scene: layouts of arrays, hits, instances against baked vertices, edits. */
#include "truth_helpers.h"

int hydra_test_scene(void);

static hydra_scene_info info_of(hydra_scene *scene) {
    hydra_scene_info info;
    assert_int_equal(hydra_scene_get_info(scene, &info), HYDRA_OK);
    return info;
}

/* Hits of random rays through the unit cube. */
enum { RAYS = 500 };
static void shoot(hydra_scene *scene, hydra_hit hits[RAYS]) {
    static hydra_ray rays[RAYS];
    static uint8_t blocked[RAYS];
    ht_rng rng = ht_rng_make(99);
    for (int i = 0; i < RAYS; i++) {
        truth_v3 from = truth_add(truth_v(0.5, 0.5, 0.5), truth_mul(truth_rng_direction(&rng), 2));
        truth_v3 to = truth_v(truth_rng_unit(&rng), truth_rng_unit(&rng), truth_rng_unit(&rng));
        truth_store(rays[i].origin, from);
        truth_store(rays[i].direction, truth_sub(to, from));
        rays[i].t_min = 0;
        rays[i].t_max = INFINITY;
    }
    assert_int_equal(hydra_scene_closest_hits(scene, rays, hits, RAYS), HYDRA_OK);
    assert_int_equal(hydra_scene_any_hits(scene, rays, blocked, RAYS), HYDRA_OK);
    for (int i = 0; i < RAYS; i++) assert_int_equal(blocked[i], hits[i].t >= 0);
}

static void expect_same_hits(const hydra_hit a[RAYS], const hydra_hit b[RAYS]) {
    int hit = 0;
    for (int i = 0; i < RAYS; i++) {
        assert_true(a[i].t == b[i].t);
        assert_int_equal(a[i].primitive, b[i].primitive);
        assert_memory_equal(a[i].normal, b[i].normal, sizeof a[i].normal);
        hit += a[i].t >= 0;
    }
    TRUTH_WITHIN("rays that hit", hit, RAYS / 4, RAYS);
}

/* ---------------------------------------------------------------- layouts of arrays */

/* The same soup with 32-bit and 16-bit indices, without indices, and with strides. Catches: arrays read wrongly. */
static void test_layouts(void **state) {
    (void)state;
    truth_mesh soup = truth_mesh_soup(1, 60);
    static hydra_hit reference[RAYS], hits[RAYS];
    uint16_t shorts[180];
    float wide[180 * 5];
    for (uint32_t i = 0; i < 180; i++) {
        soup.indices[i] = (i * 7) % 180 / 3 * 3 + i % 3; /* not in order */
        shorts[i] = (uint16_t)soup.indices[i];
        memcpy(&wide[5 * i], &soup.positions[3 * i], 12);
        wide[5 * i + 3] = wide[5 * i + 4] = NAN; /* never to be read */
    }
    float loose[540];
    for (uint32_t i = 0; i < 180; i++) memcpy(&loose[3 * i], &soup.positions[3 * soup.indices[i]], 12);
    for (int layout = 0; layout < 5; layout++) {
        truth_world world;
        truth_open(&world);
        hydra_material none = {0};
        hydra_mesh_desc desc = truth_mesh_desc(&soup, none);
        if (layout == 1) desc.indices.data = shorts;
        if (layout == 1) desc.indices.stride = 2;
        if (layout == 2) desc.indices.stride = 4;
        if (layout == 3) desc.positions.data = wide;
        if (layout == 3) desc.positions.stride = 20;
        if (layout == 4) {
            desc.positions.data = loose;
            memset(&desc.indices, 0, sizeof desc.indices);
        }
        assert_int_not_equal(hydra_scene_add_mesh(world.scene, &desc).id, 0);
        truth_commit(&world);
        shoot(world.scene, layout ? hits : reference);
        if (layout) expect_same_hits(reference, hits);
        truth_close(&world);
    }
    truth_mesh_free(&soup);
}

/* Catches: barycentric weights of the wrong vertices, normals of the wrong side, t that is not in units of direction. */
static void test_hit_fields(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_mesh soup = truth_mesh_soup(2, 60);
    hydra_material none = {0};
    hydra_mesh_desc desc = truth_mesh_desc(&soup, none);
    hydra_mesh mesh = hydra_scene_add_mesh(world.scene, &desc);
    truth_commit(&world);
    for (int i = 0; i < 60; i++) {
        truth_v3 p[3], at;
        for (int k = 0; k < 3; k++) p[k] = truth_load(&soup.positions[9 * i + 3 * k]);
        at = truth_add(truth_mul(p[0], 0.3), truth_add(truth_mul(p[1], 0.2), truth_mul(p[2], 0.5)));
        truth_v3 front = truth_unit(truth_cross(truth_sub(p[1], p[0]), truth_sub(p[2], p[0])));
        hydra_ray ray;
        hydra_hit hit;
        truth_store(ray.origin, truth_add(at, truth_mul(front, i % 2 ? 1e-3 : -1e-3)));
        truth_store(ray.direction, truth_mul(front, i % 2 ? -0.5e-3 : 0.5e-3));
        ray.t_min = 0;
        ray.t_max = 4;
        assert_int_equal(hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_OK);
        if ((int)hit.primitive != i) continue; /* another triangle of the soup lies in between */
        TRUTH_NEAR("t", (double)hit.t, 2, 1e-3);
        TRUTH_NEAR("u", (double)hit.u, 0.2, 1e-3);
        TRUTH_NEAR("v", (double)hit.v, 0.5, 1e-3);
        TRUTH_WITHIN("normal", truth_dot(truth_load(hit.normal), front), 1 - 1e-5, 1 + 1e-5);
        assert_int_equal(hit.mesh, mesh.id);
        assert_int_equal(hit.instance, 0);
        assert_int_equal(hit.light, 0);
    }
    truth_mesh_free(&soup);
    truth_close(&world);
}

/* Catches: shapes of lights that rays do not find, or find with another identity. */
static void test_light_hits(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_light_desc ball = truth_light(HYDRA_LIGHT_SPHERE, 1), disc = truth_light(HYDRA_LIGHT_DISC, 1);
    truth_store(ball.position, truth_v(0, 0, -5));
    ball.radius = 1;
    truth_store(disc.position, truth_v(5, 0, -5));
    truth_store(disc.direction, truth_v(0, 0, 2));
    disc.radius = 1;
    hydra_light a = hydra_scene_add_light(world.scene, &ball), b = hydra_scene_add_light(world.scene, &disc);
    truth_commit(&world);
    hydra_ray rays[2] = {{{0, 0, 0}, 0, {0, 0, -2}, INFINITY}, {{5.5f, 0, 0}, 0, {0, 0, -1}, INFINITY}};
    hydra_hit hits[2];
    assert_int_equal(hydra_scene_closest_hits(world.scene, rays, hits, 2), HYDRA_OK);
    TRUTH_NEAR("t of a sphere", (double)hits[0].t, 2, 1e-6);
    TRUTH_NEAR("t of a disc", (double)hits[1].t, 5, 1e-6);
    assert_int_equal(hits[0].light, a.id);
    assert_int_equal(hits[1].light, b.id);
    for (int i = 0; i < 2; i++) {
        assert_true(hits[i].primitive == HYDRA_NONE && hits[i].mesh == 0 && hits[i].instance == 0);
        TRUTH_NEAR("normal of a light", (double)hits[i].normal[2], 1, 1e-6);
    }
    truth_close(&world);
}

/* ---------------------------------------------------------------- instances against baked vertices */

static void bake(truth_mesh *mesh, const float m[12]) {
    for (uint32_t i = 0; i < mesh->vertices; i++) {
        float *p = &mesh->positions[3 * i];
        double x = (double)p[0], y = (double)p[1], z = (double)p[2];
        for (int r = 0; r < 3; r++)
            p[r] = (float)((double)m[4 * r] * x + (double)m[4 * r + 1] * y + (double)m[4 * r + 2] * z + (double)m[4 * r + 3]);
    }
}

/* Catches: transforms transposed or inverted, normals not by the inverse transpose, mirrored fronts turned over. */
static void test_instances(void **state) {
    (void)state;
    static const float transforms[3][12] = {{0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0},                /* rotated */
                                            {-1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0},               /* mirrored */
                                            {0.5f, 0.2f, 0, 0.1f, 0, 1.5f, 0, -0.3f, 0.1f, 0, 0.7f, 0.2f}}; /* sheared */
    for (int t = 0; t < 3; t++) {
        static hydra_hit placed[RAYS], baked[RAYS];
        for (int k = 0; k < 2; k++) {
            truth_world world;
            truth_open(&world);
            truth_mesh ball = truth_mesh_sphere(truth_v(0.4, 0.5, 0.6), 0.45, 2, false);
            if (k) bake(&ball, transforms[t]);
            hydra_material none = {0};
            hydra_mesh_desc desc = truth_mesh_desc(&ball, none);
            desc.instanced_only = k == 0;
            hydra_instance_desc instance;
            memset(&instance, 0, sizeof instance);
            instance.mesh = hydra_scene_add_mesh(world.scene, &desc);
            memcpy(instance.transform, transforms[t], sizeof instance.transform);
            hydra_instance made = {0};
            if (k == 0) made = hydra_scene_add_instance(world.scene, &instance);
            truth_commit(&world);
            shoot(world.scene, k ? baked : placed);
            for (int i = 0; i < RAYS && k == 0; i++) assert_int_equal(placed[i].instance, placed[i].t >= 0 ? made.id : 0);
            truth_mesh_free(&ball);
            truth_close(&world);
        }
        int hit = 0, other = 0;
        for (int i = 0; i < RAYS; i++) {
            hit += placed[i].t >= 0;
            if ((placed[i].t >= 0) != (baked[i].t >= 0) || placed[i].primitive != baked[i].primitive) {
                other++; /* rounding moves edges */
                continue;
            }
            if (placed[i].t < 0) continue;
            TRUTH_NEAR("t of an instance", (double)placed[i].t, (double)baked[i].t, 1e-5);
            /* baking keeps the order of vertices, so a mirror turns the baked front over and not the instance's */
            double sign = t == 1 ? -1 : 1;
            TRUTH_WITHIN("normal of an instance", sign * truth_dot(truth_load(placed[i].normal), truth_load(baked[i].normal)), 0.9999, 1.0001);
        }
        TRUTH_WITHIN("rays that hit", hit, RAYS / 10, RAYS);
        TRUTH_WITHIN("rays that hit another triangle", other, 0, RAYS / 100);
    }
}

/* Picture of a mesh through an instance against its baked form. Catches: shading in the wrong space. */
static void test_instance_picture(void **state) {
    (void)state;
    static const float transform[12] = {0.6f, 0.3f, 0, 0.1f, -0.2f, 0.9f, 0, 0.2f, 0, 0.1f, -1.2f, 0};
    truth_estimate e[2];
    for (int k = 0; k < 2; k++) {
        truth_world world;
        truth_open(&world);
        truth_mesh ball = truth_mesh_sphere(truth_v(0, 0, 0), 1, 3, false);
        if (k) bake(&ball, transform);
        hydra_material_desc paint;
        memset(&paint, 0, sizeof paint);
        paint.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
        paint.roughness = 0.5f;
        paint.base_color[0] = 0.7f;
        hydra_mesh_desc desc = truth_mesh_desc(&ball, hydra_scene_add_material(world.scene, &paint));
        for (uint32_t t = 0; k && t < ball.triangles; t++) { /* the transform mirrors: turn the faces back */
            uint32_t swap = ball.indices[3 * t];
            ball.indices[3 * t] = ball.indices[3 * t + 1];
            ball.indices[3 * t + 1] = swap;
        }
        desc.instanced_only = k == 0;
        hydra_instance_desc instance;
        memset(&instance, 0, sizeof instance);
        instance.mesh = hydra_scene_add_mesh(world.scene, &desc);
        memcpy(instance.transform, transform, sizeof transform);
        if (k == 0) hydra_scene_add_instance(world.scene, &instance);
        hydra_light_desc lamp = truth_light(HYDRA_LIGHT_SPHERE, 20);
        truth_store(lamp.position, truth_v(2, 3, 4));
        lamp.radius = 0.5f;
        hydra_scene_add_light(world.scene, &lamp);
        truth_commit(&world);
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = truth_samples(64);
        e[k] = truth_radiance(world.scene, truth_v(0.3, 0.2, 4), truth_v(0, 0, -1), probe);
        truth_mesh_free(&ball);
        truth_close(&world);
    }
    TRUTH_WITHIN("instance against baked", (e[0].mean - e[1].mean) / hypot(e[0].error + 1e-5 * e[0].mean, e[1].error), -4, 4);
    TRUTH_WITHIN("its error", e[0].error / e[0].mean, 0, truth_bound(0.02));
}

/* Catches: materials of instances that do not replace, or replace for all. */
static void test_instance_material(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    truth_mesh quad = truth_mesh_quad(truth_v(0, 0, 0), truth_v(1, 0, 0), truth_v(0, 1, 0), 1);
    hydra_mesh_desc desc = truth_mesh_desc(&quad, truth_emitter(world.scene, 0, 1));
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = hydra_scene_add_mesh(world.scene, &desc); /* stands by itself too */
    for (int i = 1; i < 3; i++) {
        float place[12] = {1, 0, 0, 3.f * (float)i, 0, 1, 0, 0, 0, 0, 1, 0};
        memcpy(instance.transform, place, sizeof place);
        if (i == 2) instance.material = truth_emitter(world.scene, 0, 5);
        hydra_scene_add_instance(world.scene, &instance);
    }
    truth_mesh_free(&quad);
    truth_commit(&world);
    static const double radiance[3] = {1, 1, 5};
    for (int i = 0; i < 3; i++) {
        truth_probe probe;
        memset(&probe, 0, sizeof probe);
        probe.samples = 2;
        TRUTH_NEAR("radiance of an instance", truth_radiance(world.scene, truth_v(3.0 * i + 0.2, 0.1, 2), truth_v(0, 0, -1), probe).mean, radiance[i], 1e-6);
    }
    assert_int_equal(info_of(world.scene).emitters, 6);
    assert_int_equal(info_of(world.scene).triangles, 2);
    assert_int_equal(info_of(world.scene).placed_triangles, 6);
    truth_close(&world);
}

/* ---------------------------------------------------------------- edits */

static hydra_mesh add_soup(hydra_scene *scene, uint64_t seed, hydra_material material, bool dynamic) {
    truth_mesh soup = truth_mesh_soup(seed, 50);
    hydra_mesh_desc desc = truth_mesh_desc(&soup, material);
    desc.dynamic = dynamic;
    hydra_mesh mesh = hydra_scene_add_mesh(scene, &desc);
    truth_mesh_free(&soup);
    return mesh;
}

/* Meshes that stand still share one BVH. Catches: one each, or the shared one built again for nothing. */
static void test_shared_bvh(void **state) {
    (void)state;
    static hydra_hit apart[RAYS], together[RAYS];
    for (int dynamic = 0; dynamic < 2; dynamic++) {
        truth_world world;
        truth_open(&world);
        hydra_material grey = truth_lambert(world.scene, 0.5);
        for (uint64_t i = 0; i < 3; i++) add_soup(world.scene, i, grey, dynamic != 0);
        truth_commit(&world);
        assert_int_equal(info_of(world.scene).meshes_built, dynamic ? 3 : 1);
        shoot(world.scene, dynamic ? apart : together);
        truth_commit(&world);
        assert_int_equal(info_of(world.scene).meshes_built, 0);
        truth_close(&world);
    }
    expect_same_hits(together, apart);
    for (int i = 0; i < RAYS; i++) assert_int_equal(together[i].mesh, apart[i].mesh);
}

/* Catches: commits that rebuild everything, or nothing. */
static void test_edits(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_material grey = truth_lambert(world.scene, 0.5), none = {0};
    hydra_mesh a = add_soup(world.scene, 1, grey, true), b = add_soup(world.scene, 2, grey, true);
    add_soup(world.scene, 3, none, true);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 3);
    assert_int_equal(info_of(world.scene).triangles, 150);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 0);
    hydra_material_desc paint;
    memset(&paint, 0, sizeof paint);
    paint.emission[0] = 1;
    assert_int_equal(hydra_scene_update_material(world.scene, grey, &paint), HYDRA_OK);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 0); /* materials need no BVH */
    assert_int_equal(info_of(world.scene).emitters, 100);
    truth_mesh other = truth_mesh_soup(4, 70);
    hydra_mesh_desc desc = truth_mesh_desc(&other, none);
    desc.dynamic = true;
    assert_int_equal(hydra_scene_update_mesh(world.scene, b, &desc), HYDRA_OK);
    truth_mesh_free(&other);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 1);
    assert_int_equal(info_of(world.scene).triangles, 170);
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = a;
    instance.transform[0] = instance.transform[5] = instance.transform[10] = 2;
    hydra_instance made = hydra_scene_add_instance(world.scene, &instance);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 0);
    assert_int_equal(info_of(world.scene).placed_triangles, 220);
    assert_int_equal(hydra_scene_remove_mesh(world.scene, a), HYDRA_OK);
    truth_commit(&world);
    assert_int_equal(info_of(world.scene).meshes_built, 0);
    assert_int_equal(info_of(world.scene).placed_triangles, 120);
    TRUTH_RESULT(world.context, hydra_scene_remove_instance(world.scene, made), HYDRA_ERROR_HANDLE); /* went with its mesh */
    truth_close(&world);
}

/* Catches: edits of lights and instances that are not seen after the next commit. */
static void test_edits_seen(void **state) {
    (void)state;
    truth_world world;
    truth_open(&world);
    hydra_light_desc lamp = truth_light(HYDRA_LIGHT_POINT, 1);
    truth_store(lamp.position, truth_v(0, 1, 0));
    hydra_light light = hydra_scene_add_light(world.scene, &lamp);
    truth_mesh quad = truth_mesh_quad(truth_v(0, 0.5, 0), truth_v(1, 0, 0), truth_v(0, 0, -1), 1);
    hydra_material none = {0};
    hydra_mesh_desc desc = truth_mesh_desc(&quad, none);
    desc.instanced_only = true;
    hydra_instance_desc instance;
    memset(&instance, 0, sizeof instance);
    instance.mesh = hydra_scene_add_mesh(world.scene, &desc);
    truth_mesh_free(&quad);
    truth_commit(&world);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = 2;
    probe.max_depth = 1;
    TRUTH_NEAR("lit", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 1, 0), probe).mean, 1, 1e-5);
    hydra_instance shade = hydra_scene_add_instance(world.scene, &instance);
    truth_commit(&world);
    TRUTH_WITHIN("shaded", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 1, 0), probe).mean, 0, 0);
    instance.transform[0] = instance.transform[5] = instance.transform[10] = 1;
    instance.transform[3] = 5;
    assert_int_equal(hydra_scene_update_instance(world.scene, shade, &instance), HYDRA_OK);
    lamp.color[0] = 3;
    assert_int_equal(hydra_scene_update_light(world.scene, light, &lamp), HYDRA_OK);
    truth_commit(&world);
    TRUTH_NEAR("lit again", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 1, 0), probe).mean, 3, 1e-5);
    assert_int_equal(hydra_scene_remove_light(world.scene, light), HYDRA_OK);
    truth_commit(&world);
    TRUTH_WITHIN("dark", truth_irradiance(world.scene, truth_v(0, 0, 0), truth_v(0, 1, 0), probe).mean, 0, 0);
    truth_close(&world);
}

int hydra_test_scene(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_layouts),
                                       cmocka_unit_test(test_hit_fields),
                                       cmocka_unit_test(test_light_hits),
                                       cmocka_unit_test(test_instances),
                                       cmocka_unit_test(test_instance_picture),
                                       cmocka_unit_test(test_instance_material),
                                       cmocka_unit_test(test_shared_bvh),
                                       cmocka_unit_test(test_edits),
                                       cmocka_unit_test(test_edits_seen)};
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
