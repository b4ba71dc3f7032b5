/* A device against the processor. Hits: to the bit. First surfaces: ids to the bit, places to some roundings. Pictures of
   one seed: sample by sample nearly the same, so far closer than their error bars; pictures of two seeds: as far apart as
   their error bars say. */
#include "vk_helpers.h"

int hydra_test_vk_equal(void);

/* ---- both at once */

typedef struct pair {
    vkt_host host[2]; /* the processor's, the device's */
    hydra_scene *scene[2];
} pair;

static void pair_open(pair *p) {
    memset(p, 0, sizeof *p);
    vkt_open_cpu(&p->host[0], 1);
    vkt_open(&p->host[1], NULL, 1);
}

static void pair_close(pair *p) {
    for (int i = 0; i < 2; i++) vkt_close(&p->host[i]);
}

static void pair_commit(pair *p) {
    for (int i = 0; i < 2; i++) ht_ok(p->host[i].host.context, hydra_scene_commit(p->scene[i]));
    assert_int_equal(hydra_scene_requirements(p->scene[0]), hydra_scene_requirements(p->scene[1]));
}

static void pair_forget(pair *p) {
    for (int i = 0; i < 2; i++) assert_int_equal(hydra_scene_destroy(p->scene[i]), HYDRA_OK);
}

/* ---- rays that ask for trouble */

enum { ray_most = 70000 };
static hydra_ray rays[ray_most];
static hydra_hit hits[2][ray_most];
static uint8_t occluded[2][ray_most];

typedef struct target {
    float middle[3], extent;
    const ht_mesh *mesh; /* NULL: none */
} target;

static void vertex_of(const target *t, ht_rng *rng, float p[3]) {
    for (int k = 0; k < 3; k++) p[k] = t->middle[k];
    if (t->mesh && t->mesh->vertex_count) memcpy(p, t->mesh->positions + 3 * ht_below(rng, t->mesh->vertex_count), 12);
}

static void anywhere(const target *t, ht_rng *rng, float p[3]) {
    for (int k = 0; k < 3; k++) p[k] = t->middle[k] + ht_range(rng, -1.5f, 1.5f) * t->extent;
}

/* By turns: anywhere to anywhere; to a vertex; to the middle between two; along an axis through a vertex; from a vertex;
   with limits; with directions of all lengths; from far away. */
static void make_ray(const target *t, ht_rng *rng, uint32_t kind, hydra_ray *ray) {
    float to[3], more[3];
    memset(ray, 0, sizeof *ray);
    ray->t_max = INFINITY;
    anywhere(t, rng, ray->origin);
    anywhere(t, rng, to);
    if (kind == 1 || kind == 3) vertex_of(t, rng, to);
    if (kind == 2) {
        vertex_of(t, rng, to);
        vertex_of(t, rng, more);
        for (int k = 0; k < 3; k++) to[k] = 0.5f * to[k] + 0.5f * more[k];
    }
    if (kind == 4) vertex_of(t, rng, ray->origin);
    float length = kind == 6 ? powf(10, ht_range(rng, -6, 6)) : 1;
    uint32_t axis = ht_below(rng, 3);
    for (uint32_t k = 0; k < 3; k++) {
        if (kind == 3 && k != axis) ray->origin[k] = to[k];
        if (kind == 7) ray->origin[k] = t->middle[k] + 2000 * (ray->origin[k] - t->middle[k]);
        ray->direction[k] = length * (to[k] - ray->origin[k]);
        if (kind == 3 && k != axis && ht_below(rng, 2)) ray->direction[k] = -0.0f;
    }
    if (kind == 5) ray->t_min = ht_uniform(rng), ray->t_max = ray->t_min + ht_uniform(rng);
}

static void make_rays(const target *t, uint64_t seed, uint32_t count) {
    ht_rng rng = ht_rng_make(seed);
    for (uint32_t i = 0; i < count; i++) make_ray(t, &rng, i % 8, &rays[i]);
}

/* Answers are the same, to the bit, ids and all; the codes are. Returns how many rays hit. */
static uint32_t expect_same_hits(const pair *p, uint32_t count, const char *what) {
    hydra_result result[2], any[2];
    uint32_t found = 0;
    memset(hits, 0xee, sizeof hits);
    memset(occluded, 0xee, sizeof occluded);
    for (int i = 0; i < 2; i++) {
        result[i] = hydra_scene_closest_hits(p->scene[i], rays, hits[i], count);
        any[i] = hydra_scene_any_hits(p->scene[i], rays, occluded[i], count);
    }
    assert_true(result[0] == result[1] && any[0] == any[1] && result[0] == any[0]);
    for (uint32_t i = 0; i < count; i++) {
        const hydra_hit *c = &hits[0][i], *d = &hits[1][i];
        if (memcmp(c, d, sizeof *c) != 0)
            fail_msg("%s, ray %u: t %.9g u %.9g v %.9g primitive %u, instance %u, light %u; on the device %.9g %.9g %.9g %u, %u, %u", what, i, (double)c->t,
                     (double)c->u, (double)c->v, c->primitive, c->instance, c->light, (double)d->t, (double)d->u, (double)d->v, d->primitive, d->instance, d->light);
        if (occluded[0][i] != occluded[1][i]) fail_msg("%s, ray %u: occluded %u, on the device %u", what, i, occluded[0][i], occluded[1][i]);
        found += c->t >= 0;
    }
    for (uint32_t i = count; i < ray_most && i < count + 8; i++) assert_int_equal(occluded[1][i], 0xee); /* nor beyond */
    return found;
}

/* ---- plain scenes: one tree */

static void add_mesh(const pair *p, const hydra_mesh_desc *desc) {
    for (int i = 0; i < 2; i++) assert_true(hydra_scene_add_mesh(p->scene[i], desc).id != 0);
}

static void add_plain(pair *p, const ht_mesh *mesh, uint32_t copies) {
    for (int i = 0; i < 2; i++) p->scene[i] = hydra_scene_create(p->host[i].host.context);
    hydra_mesh_desc desc = ht_mesh_desc(mesh, (hydra_material){0});
    for (uint32_t i = 0; i < copies && mesh->index_count; i++) add_mesh(p, &desc);
}

static void expect_plain(pair *p, const ht_mesh *mesh, target t, uint32_t copies, uint32_t count, uint32_t least, const char *what) {
    t.mesh = mesh;
    add_plain(p, mesh, copies);
    pair_commit(p);
    make_rays(&t, 9, count);
    uint32_t found = expect_same_hits(p, count, what);
    if (found < least) fail_msg("%s: only %u of %u rays hit anything", what, found, count);
    pair_forget(p);
}

static void test_plain_hits(void **state) {
    (void)state;
    pair p;
    const target unit = {{0, 0, 0}, 1, NULL};
    const float zero[3] = {0, 0, 0}, x[3] = {1, 0, 0}, z[3] = {0, 0, -1};
    ht_rng rng = ht_rng_make(8);
    ht_mesh nothing = {0}, one = {0}, soup = ht_soup(&rng, 400, 1, 0.3f), needles = ht_soup(&rng, 60, 0.1f, 1), sphere = ht_icosphere(0.9f, 3);
    ht_mesh grid = ht_quad(zero, x, z, 12);
    ht_mesh_triangle(&one, ht_mesh_vertex(&one, -1, -1, 0.25f), ht_mesh_vertex(&one, 1, -1, -0.5f), ht_mesh_vertex(&one, 0.25f, 1, 0));
    pair_open(&p);
    expect_plain(&p, &nothing, unit, 0, 200, 0, "an empty scene");
    expect_plain(&p, &one, unit, 1, 2000, 100, "one triangle");
    expect_plain(&p, &needles, unit, 1, 2000, 500, "needles");
    expect_plain(&p, &sphere, unit, 1, 3000, 500, "a sphere");
    expect_plain(&p, &grid, unit, 1, 3000, 500, "a grid in a plane");
    expect_plain(&p, &grid, unit, 3, 2000, 500, "three meshes in one place");
    for (uint32_t i = 0; i + 3 < soup.vertex_count; i += 12) memcpy(soup.positions + 3 * i, soup.positions + 3 * i + 3, 12); /* no area */
    expect_plain(&p, &soup, unit, 1, 3000, 500, "degenerate triangles");
    const float scales[5] = {1e-6f, 1e-3f, 1e6f, 1, 1}, offsets[5] = {0, 0, 0, 1000, 1e6f};
    for (int i = 0; i < 5; i++) {
        const target there = {{offsets[i], -offsets[i], offsets[i]}, scales[i], NULL};
        ht_mesh moved = {0};
        ht_mesh_append(&moved, &soup);
        ht_mesh_place(&moved, scales[i], there.middle[0], there.middle[1], there.middle[2]);
        expect_plain(&p, &moved, there, 1, 1500, 200, i < 3 ? "scaled" : "far away");
        ht_mesh_free(&moved);
    }
    pair_close(&p);
    ht_mesh_free(&one);
    ht_mesh_free(&soup);
    ht_mesh_free(&needles);
    ht_mesh_free(&sphere);
    ht_mesh_free(&grid);
}

/* In the planes of triangles, as floats have them, and often past them. Catches: another t than the CPU's where the plane says
   nothing. */
static void test_grazing_hits(void **state) {
    (void)state;
    pair p;
    ht_rng rng = ht_rng_make(11);
    ht_mesh soup = ht_soup(&rng, 300, 1, 1);
    pair_open(&p);
    add_plain(&p, &soup, 1);
    pair_commit(&p);
    for (uint32_t i = 0; i < 20000; i++) {
        const float *t = soup.positions + 9 * ht_below(&rng, 300);
        float b = ht_range(&rng, -2, 2), c = ht_range(&rng, -2, 2), u = ht_range(&rng, -2, 2), v = ht_range(&rng, -2, 2);
        memset(&rays[i], 0, sizeof rays[i]);
        rays[i].t_max = INFINITY;
        for (int k = 0; k < 3; k++) {
            rays[i].origin[k] = t[k] + b * (t[3 + k] - t[k]) + c * (t[6 + k] - t[k]);
            rays[i].direction[k] = u * (t[3 + k] - t[k]) + v * (t[6 + k] - t[k]);
        }
    }
    assert_true(expect_same_hits(&p, 20000, "grazing rays") > 10000);
    pair_forget(&p);
    pair_close(&p);
    ht_mesh_free(&soup);
}

/* Counts about the sizes of groups and slices, and rays that are not sound. */
static void test_counts_and_unsound_rays(void **state) {
    (void)state;
    pair p;
    const target unit = {{0, 0, 0}, 1, NULL};
    const uint32_t counts[] = {0, 1, 63, 64, 65, 2049, ray_most};
    ht_rng rng = ht_rng_make(8);
    ht_mesh soup = ht_soup(&rng, 400, 1, 0.3f);
    target t = unit;
    t.mesh = &soup;
    pair_open(&p);
    add_plain(&p, &soup, 1);
    pair_commit(&p);
    make_rays(&t, 10, ray_most);
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) (void)expect_same_hits(&p, counts[i], "a count");
    const float bad[6] = {NAN, INFINITY, -INFINITY, 0, 0, 0};
    for (int i = 0; i < 20; i++) {
        hydra_ray *r = &rays[7 * i + 3];
        if (i % 10 < 3) r->origin[i % 3] = bad[i % 10];
        else if (i % 10 < 6) r->direction[i % 3] = bad[i % 10 - 3];
        else if (i % 10 == 6) r->direction[0] = r->direction[1] = r->direction[2] = 0;
        else if (i % 10 == 7) r->t_min = NAN;
        else if (i % 10 == 8) r->t_max = NAN;
        else r->t_min = 2, r->t_max = 1;
    }
    (void)expect_same_hits(&p, 3, "sound ones first");
    (void)expect_same_hits(&p, 200, "some are not sound");
    assert_int_equal(hydra_scene_closest_hits(p.scene[1], rays, hits[1], 200), HYDRA_ERROR_RAY);
    assert_int_equal(hydra_scene_any_hits(p.scene[1], rays, occluded[1], 200), HYDRA_ERROR_RAY);
    assert_int_equal(hydra_scene_closest_hits(p.scene[1], NULL, hits[1], 1), HYDRA_ERROR_NULL);
    pair_forget(&p);
    pair_close(&p);
    ht_mesh_free(&soup);
}

/* ---- scenes of everything that rays can meet */

static void add_lights(hydra_scene *scene, float scale) {
    hydra_light_desc rect = {.kind = HYDRA_LIGHT_RECT, .color = {1, 1, 1}, .position = {0, 0.9f, 0}, .axis_u = {0.5f, 0, 0}, .axis_v = {0, 0, 0.4f}};
    hydra_light_desc disc = {.kind = HYDRA_LIGHT_DISC, .color = {1, 1, 1}, .position = {0.6f, -0.4f, 0}, .direction = {1, 2, 3}, .radius = 0.4f};
    hydra_light_desc ball = {.kind = HYDRA_LIGHT_SPHERE, .color = {1, 1, 1}, .position = {-0.7f, 0.3f, 0.2f}, .radius = 0.3f, .hidden = true};
    hydra_light_desc all[3];
    all[0] = rect, all[1] = disc, all[2] = ball;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            all[i].position[k] *= scale;
            all[i].axis_u[k] *= scale;
            all[i].axis_v[k] *= scale;
        }
        all[i].radius *= scale;
        assert_true(hydra_scene_add_light(scene, &all[i]).id != 0);
    }
}

static hydra_material add_holes(hydra_scene *scene, hydra_alpha_mode mode, uint64_t seed) {
    unsigned char texels[8 * 8 * 4];
    ht_rng rng = ht_rng_make(seed);
    for (size_t i = 0; i < sizeof texels; i++) texels[i] = (unsigned char)ht_below(&rng, 256);
    hydra_texture_desc texture = {.texels = texels, .width = 8, .height = 8, .wrap_u = HYDRA_WRAP_MIRROR};
    hydra_material_desc material = {.base_color = {1, 1, 1}, .alpha_mode = mode, .alpha = 0.8f, .alpha_cutoff = 0.4f};
    material.base_color_texture = hydra_scene_add_texture(scene, &texture);
    return hydra_scene_add_material(scene, &material);
}

/* Rotated, sheared, mirrored, squeezed. */
static const float transforms[4][12] = {{0.6f, 0, 0.8f, -0.4f, 0, 1, 0, 0.1f, -0.8f, 0, 0.6f, 0.3f},
                                        {-0.5f, 0, 0, 0.5f, 0, 0.5f, 0, 0.2f, 0, 0, 0.5f, 0},
                                        {0.3f, 0.2f, 0, 0, 0.1f, 1.5f, 0.3f, 0, 0, 0.4f, 0.02f, -0.5f},
                                        {0.25f, 0, 0, 0.1f, 0, 0.25f, 0, -0.6f, 0, 0, 0.25f, 0.6f}};

static hydra_mesh fill_everything(hydra_scene *scene, float scale, const ht_mesh *sphere, const ht_mesh *soup, const float *uvs) {
    hydra_material mask = add_holes(scene, HYDRA_ALPHA_MASK, 1), blend = add_holes(scene, HYDRA_ALPHA_BLEND, 2);
    hydra_mesh_desc standing = ht_mesh_desc(soup, mask), placed = ht_mesh_desc(sphere, (hydra_material){0}), moving = ht_mesh_desc(sphere, blend);
    standing.uvs = (hydra_view){uvs, 0, soup->vertex_count};
    moving.uvs = (hydra_view){uvs, 0, sphere->vertex_count};
    moving.dynamic = placed.instanced_only = true;
    moving.normals = moving.positions;
    (void)hydra_scene_add_mesh(scene, &standing);
    hydra_mesh result = hydra_scene_add_mesh(scene, &moving);
    hydra_instance_desc instance = {.mesh = hydra_scene_add_mesh(scene, &placed)};
    for (int i = 0; i < 4; i++) {
        memcpy(instance.transform, transforms[i], sizeof instance.transform);
        for (int k = 3; k < 12; k += 4) instance.transform[k] *= scale;
        instance.material = i == 3 ? blend : (hydra_material){0};
        assert_true(hydra_scene_add_instance(scene, &instance).id != 0);
    }
    add_lights(scene, scale);
    return result;
}

/* Instances, holes, shapes of lights, a mesh that moves; small, of our size, and large. */
static void test_hits_of_everything(void **state) {
    (void)state;
    pair p;
    static float uvs[2 * 2000];
    ht_rng rng = ht_rng_make(12);
    const float scales[3] = {1, 1e-5f, 1e5f};
    for (size_t i = 0; i < sizeof uvs / sizeof uvs[0]; i++) uvs[i] = ht_range(&rng, -2, 2);
    pair_open(&p);
    for (int s = 0; s < 3; s++) {
        hydra_mesh moving[2];
        ht_mesh sphere = ht_icosphere(0.8f * scales[s], 2), soup = ht_soup(&rng, 300, scales[s], 0.3f * scales[s]);
        const target t = {{0, 0, 0}, scales[s], &soup};
        for (int i = 0; i < 2; i++) {
            p.scene[i] = hydra_scene_create(p.host[i].host.context);
            moving[i] = fill_everything(p.scene[i], scales[s], &sphere, &soup, uvs);
        }
        pair_commit(&p);
        make_rays(&t, 13, 4000);
        assert_true(expect_same_hits(&p, 4000, "everything") > 1000);
        ht_mesh_jitter(&sphere, &rng, 0.2f * scales[s]);
        for (int i = 0; i < 2; i++)
            ht_ok(p.host[i].host.context, hydra_scene_move_vertices(p.scene[i], moving[i], (hydra_view){sphere.positions, 0, sphere.vertex_count}, (hydra_view){0}));
        pair_commit(&p);
        assert_true(expect_same_hits(&p, 2000, "after a mesh moved") > 500);
        pair_forget(&p);
        ht_mesh_free(&sphere);
        ht_mesh_free(&soup);
    }
    pair_close(&p);
}

/* ---- a zoo: every light, texture and kind of map, and a ball of any material in the middle */

typedef struct zoo {
    hydra_material ball, floor;
    hydra_texture color, rough, bumps;
} zoo;

static hydra_texture zoo_texture(hydra_scene *scene, uint64_t seed, hydra_texel_format format, hydra_wrap wrap, bool bumps) {
    unsigned char bytes[16 * 8 * 4];
    float floats[16 * 8 * 4];
    ht_rng rng = ht_rng_make(seed);
    for (int i = 0; i < 16 * 8 * 4; i++) {
        bytes[i] = (unsigned char)(bumps ? (i % 4 == 2 ? 250 : 100 + ht_below(&rng, 56)) : 60 + ht_below(&rng, 180));
        floats[i] = (float)bytes[i] / 255;
    }
    hydra_texture_desc desc = {.texels = format == HYDRA_TEXEL_RGBA32F ? (const void *)floats : bytes, .width = 16, .height = 8, .format = format, .wrap_u = wrap, .wrap_v = wrap};
    return hydra_scene_add_texture(scene, &desc);
}

static void zoo_lights(hydra_scene *scene) {
    const hydra_light_desc lights[6] = {
        {.kind = HYDRA_LIGHT_RECT, .color = {6, 5, 4}, .position = {-1, 2.2f, 0}, .axis_u = {0.4f, 0, 0}, .axis_v = {0, 0, 0.4f}},
        {.kind = HYDRA_LIGHT_DISC, .color = {3, 4, 5}, .position = {1.5f, 1.8f, 0.5f}, .direction = {-1, -2, 0}, .radius = 0.3f, .both_sides = true},
        {.kind = HYDRA_LIGHT_SPHERE, .unit = HYDRA_UNIT_POWER, .color = {20, 25, 20}, .position = {-1.4f, 0.5f, 0.9f}, .radius = 0.15f},
        {.kind = HYDRA_LIGHT_POINT, .color = {1, 0.4f, 0.2f}, .position = {0.2f, 1.5f, 1.4f}},
        {.kind = HYDRA_LIGHT_SPOT, .color = {4, 4, 6}, .position = {1.4f, 2, 1.2f}, .direction = {-1, -2, -1}},
        {.kind = HYDRA_LIGHT_SUN, .unit = HYDRA_UNIT_IRRADIANCE, .color = {0.8f, 0.7f, 0.5f}, .direction = {1, -2, -1}, .angular_radius = 0.05f}};
    for (int i = 0; i < 6; i++) assert_true(hydra_scene_add_light(scene, &lights[i]).id != 0);
    hydra_light_desc beam = lights[5];
    beam.angular_radius = 0;
    beam.direction[0] = -1;
    assert_true(hydra_scene_add_light(scene, &beam).id != 0);
    float texels[8 * 4 * 3];
    ht_rng rng = ht_rng_make(21);
    for (int i = 0; i < 8 * 4 * 3; i++) texels[i] = ht_uniform(&rng) * (i == 33 ? 20 : 1);
    hydra_environment_desc sky = {.color = {0.5f, 0.6f, 0.7f}, .texels = texels, .width = 8, .height = 4, .rotation = 0.7f};
    assert_int_equal(hydra_scene_set_environment(scene, &sky), HYDRA_OK);
}

static zoo zoo_fill(hydra_scene *scene) {
    zoo z;
    ht_mesh ball = ht_icosphere(0.6f, 2), box, floor, card;
    const float centre[3] = {0, -0.6f, 0}, x[3] = {2.5f, 0, 0}, back[3] = {0, 0, -2.5f}, low[3] = {0.7f, -0.6f, -1}, high[3] = {1.3f, 0.3f, -0.4f};
    const float there[3] = {-0.9f, 0.1f, 0.6f}, side[3] = {0.3f, 0, 0.1f}, up[3] = {0, 0.5f, 0};
    static const float corner_uvs[8] = {0, 0, 3, 0, 3, 2, 0, 2};
    z.color = zoo_texture(scene, 1, HYDRA_TEXEL_RGBA8_SRGB, HYDRA_WRAP_REPEAT, false);
    z.rough = zoo_texture(scene, 2, HYDRA_TEXEL_RGBA32F, HYDRA_WRAP_MIRROR, false);
    z.bumps = zoo_texture(scene, 3, HYDRA_TEXEL_RGBA8_LINEAR, HYDRA_WRAP_CLAMP, true);
    hydra_material_desc lambert = {.base_color = {0.8f, 0.8f, 0.8f}, .base_color_texture = z.color, .normal_texture = z.bumps};
    hydra_material_desc leaf = {.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS, .base_color = {0.7f, 0.9f, 0.3f}, .roughness = 0.7f, .alpha_mode = HYDRA_ALPHA_MASK, .alpha_texture = z.rough,
                                .metallic_roughness_texture = z.rough, .metallic = 0.5f, .transmission = 0.3f, .thin = true};
    hydra_material_desc glass = {.kind = HYDRA_MATERIAL_DIELECTRIC, .absorption = {0.2f, 1, 2}};
    hydra_material_desc lamp = {.base_color = {0.2f, 0.2f, 0.2f}, .emission = {0.5f, 0.2f, 0.9f}, .emission_texture = z.color};
    z.ball = hydra_scene_add_material(scene, &(hydra_material_desc){.base_color = {0.5f, 0.5f, 0.5f}});
    z.floor = hydra_scene_add_material(scene, &lambert);
    floor = ht_quad(centre, x, back, 1);
    card = ht_quad(there, side, up, 1);
    box = ht_box(low, high);
    hydra_mesh_desc mesh = ht_mesh_desc(&ball, z.ball);
    mesh.normals = mesh.positions;
    mesh.dynamic = true;
    (void)hydra_scene_add_mesh(scene, &mesh);
    mesh = ht_mesh_desc(&floor, z.floor);
    mesh.uvs = (hydra_view){corner_uvs, 0, 4};
    (void)hydra_scene_add_mesh(scene, &mesh);
    mesh = ht_mesh_desc(&card, hydra_scene_add_material(scene, &leaf));
    mesh.uvs = (hydra_view){corner_uvs, 0, 4};
    (void)hydra_scene_add_mesh(scene, &mesh);
    mesh = ht_mesh_desc(&box, hydra_scene_add_material(scene, &glass));
    mesh.instanced_only = true;
    hydra_instance_desc instance = {.mesh = hydra_scene_add_mesh(scene, &mesh)};
    (void)hydra_scene_add_instance(scene, &instance);
    instance.material = hydra_scene_add_material(scene, &lamp);
    const float moved[12] = {0.3f, 0, 0, -1.7f, 0, 0.3f, 0, -0.3f, 0, 0, 0.3f, -0.6f};
    memcpy(instance.transform, moved, sizeof moved);
    (void)hydra_scene_add_instance(scene, &instance);
    zoo_lights(scene);
    ht_mesh_free(&ball);
    ht_mesh_free(&floor);
    ht_mesh_free(&card);
    ht_mesh_free(&box);
    return z;
}

/* ---- pictures of both */

enum { side = 24, pixels = side * side };

typedef struct picture {
    float f[HYDRA_OUTPUT_COUNT][3 * pixels];
    uint32_t u[HYDRA_OUTPUT_COUNT][pixels];
} picture;

static picture pictures[2];

static bool is_words(int output) { return output >= HYDRA_PRIMITIVE_ID; }

static void take_picture(const pair *p, int which, const hydra_render_desc *desc) {
    hydra_context *context = p->host[which].host.context;
    hydra_render *render = hydra_render_create(p->scene[which], desc);
    if (!render) fail_msg("%s", hydra_error_text(context));
    ht_ok(context, ht_finish(render));
    memset(&pictures[which], 0, sizeof pictures[which]);
    for (int o = 0; o < HYDRA_OUTPUT_COUNT; o++) {
        bool always = o == HYDRA_RADIANCE || o == HYDRA_ERROR || o == HYDRA_SAMPLES || o == HYDRA_VALIDITY;
        if (!always && !(desc->outputs >> o & 1u)) continue;
        ht_ok(context, hydra_render_read(render, (hydra_output)o, is_words(o) ? (void *)pictures[which].u[o] : pictures[which].f[o], 0));
    }
    hydra_render_destroy(render);
}

/* Words all equal; the largest difference of a float output, relative to its largest value. */
static double largest_difference(int output) {
    double most = 0, scale = 0;
    for (int i = 0; i < 3 * pixels; i++) {
        double c = (double)pictures[0].f[output][i], d = (double)pictures[1].f[output][i];
        if (c == d) continue; /* infinities too */
        assert_true(ht_finite((float)c) && ht_finite((float)d));
        if (fabs(c - d) > most) most = fabs(c - d);
        if (fabs(c) > scale) scale = fabs(c);
    }
    return scale > 0 ? most / scale : most;
}

static void expect_same_words(const char *what, int output) {
    for (int i = 0; i < pixels; i++)
        if (pictures[0].u[output][i] != pictures[1].u[output][i])
            fail_msg("%s, output %d, pixel %d: %u, on the device %u", what, output, i, pictures[0].u[output][i], pictures[1].u[output][i]);
}

/* How two pictures differ: in error bars, pixel by pixel and on the whole. */
typedef struct apart {
    double outside; /* share of values more than three combined error bars apart */
    double mean;    /* difference of the means in error bars of it */
    double same;    /* share of values equal to 1e-4 of themselves */
} apart;

static apart how_far_apart(void) {
    apart a = {0, 0, 0};
    double sum = 0, variance = 0;
    for (int i = 0; i < 3 * pixels; i++) {
        double c = (double)pictures[0].f[HYDRA_RADIANCE][i], d = (double)pictures[1].f[HYDRA_RADIANCE][i];
        double ec = (double)pictures[0].f[HYDRA_ERROR][i], ed = (double)pictures[1].f[HYDRA_ERROR][i], e = ec * ec + ed * ed;
        a.outside += fabs(c - d) > 3 * sqrt(e) + 1e-5 * fabs(c);
        a.same += fabs(c - d) <= 1e-4 * fabs(c);
        sum += c - d;
        variance += e;
    }
    a.outside /= 3 * pixels;
    a.same /= 3 * pixels;
    a.mean = variance > 0 ? fabs(sum) / sqrt(variance) : fabs(sum) > 0 ? 99 : 0;
    return a;
}

static const uint32_t all_outputs = (1u << HYDRA_OUTPUT_COUNT) - 1;

/* How many pixels have another first surface: none, but where sines and cosines made the rays. */
static uint32_t other_ids(void) {
    uint32_t other = 0;
    for (int i = 0; i < pixels; i++) {
        bool same = true;
        for (int o = HYDRA_PRIMITIVE_ID; o <= HYDRA_MATERIAL_ID; o++) same = same && pictures[0].u[o][i] == pictures[1].u[o][i];
        other += !same;
    }
    return other;
}

/* One seed on both: ids are equal; so are places and normals of first surfaces, to some roundings; radiance differs by so
   little that error bars, which are of independent samples, are far from being reached. same: the least share of values
   that are equal to 1e-4 of themselves; the others had a path whose turn a last bit decided. */
static void expect_same_picture(const pair *p, hydra_render_desc desc, double same, bool exact_rays, const char *what) {
    desc.width = desc.height = side;
    for (int i = 0; i < 2; i++) take_picture(p, i, &desc);
    expect_same_words(what, HYDRA_SAMPLES);
    uint32_t other = other_ids();
    if (other > (exact_rays ? 0 : pixels / 200)) fail_msg("%s: %u pixels have other ids", what, other);
    apart a = how_far_apart();
    for (int o = HYDRA_ALBEDO; o <= HYDRA_COVERAGE && exact_rays; o++)
        if (!(largest_difference(o) <= 1e-6)) fail_msg("%s, output %d: %g apart", what, o, largest_difference(o));
    if (!(a.outside <= 0.01 && a.mean < 1 && a.same >= same)) fail_msg("%s: %g outside three error bars, means %g apart, %g the same", what, a.outside, a.mean, a.same);
}

/* Two seeds: as far apart as error bars say. Those of few samples are estimates themselves: hence 3 % where 0.3 % are due. */
static void expect_two_seeds(const pair *p, hydra_render_desc desc, const char *what) {
    desc.width = desc.height = side;
    for (int i = 0; i < 2; i++, desc.seed += 100) take_picture(p, i, &desc);
    apart a = how_far_apart();
    if (!(a.outside <= 0.03 && a.mean < 4 && a.same < 0.5)) fail_msg("%s, two seeds: %g outside three error bars, means %g apart, %g the same", what, a.outside, a.mean, a.same);
}

static hydra_render_desc view_of(hydra_sensor_kind kind) {
    hydra_render_desc desc = {.width = side, .height = side, .max_samples = 16, .outputs = all_outputs, .max_depth = 8, .seed = 3};
    desc.sensor = (hydra_sensor_desc){.kind = kind, .position = {0.4f, 0.9f, 3}, .target = {0, 0.1f, 0}, .ortho_height = 3, .lens_radius = 0.1f};
    if (kind == HYDRA_SENSOR_EQUIRECTANGULAR) desc.sensor.position[2] = 1.2f;
    return desc;
}

/* Materials of the ball, by turns. */
static uint32_t ball_material(const zoo *z, uint32_t i, hydra_material_desc *m) {
    const hydra_material_desc all[] = {
        {.base_color = {0.7f, 0.5f, 0.3f}},
        {.kind = HYDRA_MATERIAL_CONDUCTOR, .base_color = {0.9f, 0.8f, 0.5f}},
        {.kind = HYDRA_MATERIAL_CONDUCTOR, .eta = {0.2f, 0.9f, 1.1f}, .k = {3.9f, 2.4f, 2.2f}, .roughness = 0.4f},
        {.kind = HYDRA_MATERIAL_DIELECTRIC, .ior = 1.7f, .absorption = {1, 0.2f, 0.1f}},
        {.kind = HYDRA_MATERIAL_DIELECTRIC, .roughness = 0.5f, .base_color = {0.9f, 1, 0.8f}},
        {.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS, .base_color = {0.8f, 0.3f, 0.2f}, .roughness = 0.6f, .clearcoat = 1, .clearcoat_roughness = 0.1f},
        {.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS, .base_color = {0.9f, 0.9f, 0.9f}, .transmission = 0.8f, .roughness = 0.3f, .absorption = {0.5f, 0.5f, 2}},
        {.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS, .base_color = {1, 1, 1}, .metallic = 1, .roughness = 0.8f, .metallic_roughness_texture = z->rough, .base_color_texture = z->color},
        {.base_color = {0.5f, 0.5f, 0.5f}, .emission = {2, 1, 0.5f}, .emit_both_sides = true, .alpha_mode = HYDRA_ALPHA_BLEND, .alpha = 0.5f}};
    uint32_t count = sizeof all / sizeof all[0];
    if (i < count) *m = all[i];
    return count;
}

static void zoo_open(pair *p, zoo z[2]) {
    pair_open(p);
    for (int i = 0; i < 2; i++) {
        p->scene[i] = hydra_scene_create(p->host[i].host.context);
        z[i] = zoo_fill(p->scene[i]);
    }
    pair_commit(p);
    assert_int_equal(hydra_scene_requirements(p->scene[0]), 0x1fff);
}

/* Every sensor but points, every output, every strategy, in a scene with everything. */
static void zoo_sensors(const pair *p) {
    static hydra_ray given[pixels];
    expect_same_picture(p, view_of(HYDRA_SENSOR_PINHOLE), 0.97, true, "pinhole");
    expect_same_picture(p, view_of(HYDRA_SENSOR_THIN_LENS), 0.97, false, "thin lens");
    expect_same_picture(p, view_of(HYDRA_SENSOR_ORTHOGRAPHIC), 0.97, true, "orthographic");
    expect_same_picture(p, view_of(HYDRA_SENSOR_EQUIRECTANGULAR), 0.97, false, "all around");
    ht_rng rng = ht_rng_make(30);
    for (int i = 0; i < pixels; i++) {
        memset(&given[i], 0, sizeof given[i]);
        given[i].origin[1] = 1, given[i].origin[2] = 2;
        for (int k = 0; k < 3; k++) given[i].direction[k] = ht_range(&rng, -0.7f, 0.7f) - given[i].origin[k];
        given[i].t_max = INFINITY;
    }
    hydra_render_desc desc = view_of(HYDRA_SENSOR_RAYS);
    desc.sensor.rays = (hydra_view){given, 0, pixels};
    expect_same_picture(p, desc, 0.97, true, "rays");
    desc = view_of(HYDRA_SENSOR_PINHOLE);
    desc.sensor.filter = HYDRA_FILTER_TENT;
    desc.strategy = HYDRA_STRATEGY_LIGHTS;
    expect_same_picture(p, desc, 0.97, true, "by lights");
    desc.strategy = HYDRA_STRATEGY_BSDF;
    expect_same_picture(p, desc, 0.97, true, "by BSDFs");
    desc = view_of(HYDRA_SENSOR_PINHOLE);
    desc.max_samples = 48;
    expect_two_seeds(p, desc, "pinhole");
}

static void test_zoo(void **state) {
    (void)state;
    pair p;
    zoo z[2];
    hydra_material_desc m;
    zoo_open(&p, z);
    zoo_sensors(&p);
    for (uint32_t k = 0; k < ball_material(&z[0], k, &m); k++) {
        char name[32];
        for (int i = 0; i < 2; i++) {
            (void)ball_material(&z[i], k, &m);
            ht_ok(p.host[i].host.context, hydra_scene_update_material(p.scene[i], z[i].ball, &m));
        }
        pair_commit(&p);
        assert_int_equal(hydra_scene_requirements(p.scene[0]), 0x1fff);
        snprintf(name, sizeof name, "material %u", k);
        hydra_render_desc desc = view_of(HYDRA_SENSOR_PINHOLE);
        desc.sensor.fov_y = 0.4f;
        desc.max_samples = 8;
        expect_same_picture(&p, desc, m.alpha_mode ? 0.3 : 0.97, true, name); /* which rays holes let pass, a hash of their bits decides */
    }
    assert_true(vkt_info(p.host[1].host.context).pipelines <= 6); /* all of this is one set of requirements */
    pair_forget(&p);
    pair_close(&p);
}

/* ---- where there is one path only */

/* A floor under one square of light, one scattering: the device's values are the processor's to 1e-4 in every pixel and
   2e-5 on the mean; more than roundings, since the light is sampled by its solid angle, through arc tangents, for which
   Vulkan allows 4096 units in the last place. Irradiance at points likewise. */
static void test_one_scattering(void **state) {
    (void)state;
    pair p;
    static float points[3 * pixels], normals[3 * pixels];
    pair_open(&p);
    const float centre[3] = {0, -1, 0}, x[3] = {3, 0, 0}, back[3] = {0, 0, -3};
    hydra_light_desc light = {.kind = HYDRA_LIGHT_RECT, .color = {9, 8, 7}, .position = {0, 1, 0}, .axis_u = {1, 0, 0}, .axis_v = {0, 0, 1}};
    ht_mesh floor = ht_quad(centre, x, back, 4);
    add_plain(&p, &floor, 1);
    for (int i = 0; i < 2; i++) assert_true(hydra_scene_add_light(p.scene[i], &light).id != 0);
    pair_commit(&p);
    hydra_render_desc desc = {.width = side, .height = side, .max_samples = 16, .max_depth = 1, .sensor = {.position = {0, 2, 4}, .target = {0, -1, 0}}};
    for (int i = 0; i < 2; i++) take_picture(&p, i, &desc);
    double most = 0, sum = 0;
    for (int i = 0; i < 3 * pixels; i++) {
        double c = (double)pictures[0].f[HYDRA_RADIANCE][i], d = (double)pictures[1].f[HYDRA_RADIANCE][i], apart = c == d ? 0 : fabs(c - d) / fabs(c);
        sum += apart / (3 * pixels);
        if (!(apart <= most)) most = apart;
    }
    if (!(most <= 1e-4 && sum <= 2e-5)) fail_msg("one scattering: %g apart, on the mean %g", most, sum);
    ht_rng rng = ht_rng_make(40);
    for (int i = 0; i < pixels; i++) {
        points[3 * i] = ht_range(&rng, -2.5f, 2.5f), points[3 * i + 1] = -1, points[3 * i + 2] = ht_range(&rng, -2.5f, 2.5f);
        normals[3 * i + 1] = 1;
    }
    desc.sensor = (hydra_sensor_desc){.kind = HYDRA_SENSOR_POINTS, .point_positions = {points, 0, pixels}, .point_normals = {normals, 0, pixels}};
    desc.outputs = 1u << HYDRA_DIRECT;
    for (int i = 0; i < 2; i++) take_picture(&p, i, &desc);
    expect_same_words("points", HYDRA_VALIDITY);
    assert_true(largest_difference(HYDRA_RADIANCE) <= 1e-5);
    pair_forget(&p);
    pair_close(&p);
    ht_mesh_free(&floor);
}

int hydra_test_vk_equal(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plain_hits),
        cmocka_unit_test(test_grazing_hits),
        cmocka_unit_test(test_counts_and_unsound_rays),
        cmocka_unit_test(test_hits_of_everything),
        cmocka_unit_test(test_zoo),
        cmocka_unit_test(test_one_scattering),
    };
    return cmocka_run_group_tests_name("vk_equal", tests, NULL, NULL);
}
