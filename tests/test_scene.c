/* The scene: layouts of arrays, instances, edits, alpha, requirements and estimates, extremes of scale and number. */
#include "truth_helpers.h"

int hydra_test_scene(void);

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
        assert_int_equal(taken, e.bytes_total);
        if (k < 2) assert_int_equal(e.bytes_sensor, 0);
        else assert_true(e.bytes_sensor >= 24 * 1024);
        hydra_render_destroy(render);
        assert_int_equal(world.host.memory.bytes_now, before);
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

int hydra_test_scene(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_layouts),        cmocka_unit_test(test_hit_fields),
        cmocka_unit_test(test_light_hits),     cmocka_unit_test(test_instances),
        cmocka_unit_test(test_instance_picture), cmocka_unit_test(test_instance_material),
        cmocka_unit_test(test_shared_bvh), cmocka_unit_test(test_edits),          cmocka_unit_test(test_edits_seen),
        cmocka_unit_test(test_alpha_mask),     cmocka_unit_test(test_alpha_blend),
        cmocka_unit_test(test_requirements),   cmocka_unit_test(test_estimate),
        cmocka_unit_test(test_empty),          cmocka_unit_test(test_scale_and_place),
        cmocka_unit_test(test_many_emitters)};
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
