/* Bad input: every named error that can be provoked is provoked, the scene stays usable after each, the next commit
   reports the first failing add once, and nothing leaks. */
#include "truth_helpers.h"

int hydra_test_input(void);

static const float nan_value = NAN, infinite = INFINITY;

/* ---------------------------------------------------------------- a scene that must survive everything */

static void open_good(truth_world *world) {
    truth_open(world);
    truth_scene_mesh(world->scene, truth_mesh_quad(truth_v(0, 0, -2), truth_v(1, 0, 0), truth_v(0, 1, 0), 1), truth_emitter(world->scene, 0.5, 3));
    truth_commit(world);
}

/* The scene still commits, and still shows what it showed. */
static void expect_usable(truth_world *world) {
    TRUTH_RESULT(world->context, hydra_scene_commit(world->scene), HYDRA_OK);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = 2;
    probe.max_depth = 1;
    TRUTH_NEAR("radiance of the good mesh", truth_radiance(world->scene, truth_v(0, 0, 0), truth_v(0, 0.1, -1), probe).mean, 3, 1e-6);
}

/* An add failed: the commit names it once, with a message, and the one after that succeeds. */
static void expect_reported(truth_world *world, const char *what, uint32_t id, hydra_result wanted) {
    if (id != 0) fail_msg("%s: was accepted", what);
    hydra_result got = hydra_scene_commit(world->scene);
    if (got != wanted) fail_msg("%s: \"%s\", wanted \"%s\"", what, hydra_result_text(got), hydra_result_text(wanted));
    assert_int_not_equal(strlen(hydra_error_text(world->context)), 0);
    expect_usable(world);
}

/* ---------------------------------------------------------------- meshes */

typedef struct mesh_input {
    float positions[12], normals[12], uvs[8];
    uint32_t indices[6];
    uint16_t short_indices[6];
    hydra_material materials[2];
    hydra_mesh_desc desc;
} mesh_input;

static void good_mesh(mesh_input *m) {
    static const float square[12] = {5, 0, 0, 6, 0, 0, 6, 1, 0, 5, 1, 0}; /* out of the way of the good mesh */
    static const uint32_t order[6] = {0, 1, 2, 0, 2, 3};
    memset(m, 0, sizeof *m);
    memcpy(m->positions, square, sizeof square);
    for (int i = 0; i < 4; i++) m->normals[3 * i + 2] = 1;
    for (int i = 0; i < 6; i++) {
        m->indices[i] = order[i];
        m->short_indices[i] = (uint16_t)order[i];
    }
    m->desc.positions.data = m->positions;
    m->desc.positions.count = 4;
    m->desc.normals.data = m->normals;
    m->desc.normals.count = 4;
    m->desc.uvs.data = m->uvs;
    m->desc.uvs.count = 4;
    m->desc.indices.data = m->indices;
    m->desc.indices.count = 6;
}

static void expect_mesh(truth_world *world, const char *what, const mesh_input *m, hydra_result wanted) {
    expect_reported(world, what, hydra_scene_add_mesh(world->scene, &m->desc).id, wanted);
    mesh_input good; /* the same on an update: the old contents stay */
    good_mesh(&good);
    hydra_mesh mesh = hydra_scene_add_mesh(world->scene, &good.desc);
    assert_int_not_equal(mesh.id, 0);
    TRUTH_RESULT(world->context, hydra_scene_update_mesh(world->scene, mesh, &m->desc), wanted);
    assert_int_equal(hydra_scene_remove_mesh(world->scene, mesh), HYDRA_OK);
    (void)hydra_scene_commit(world->scene);
    expect_usable(world);
}

/* Catches: numbers that are not finite in any vertex array, and indices that point out of it. */
static void test_mesh_numbers(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    for (int k = 0; k < 2; k++) {
        float bad = k ? infinite : nan_value;
        good_mesh(&m);
        m.positions[11] = bad;
        expect_mesh(&world, "position", &m, HYDRA_ERROR_NOT_FINITE);
        good_mesh(&m);
        m.normals[4] = -bad;
        expect_mesh(&world, "normal", &m, HYDRA_ERROR_NOT_FINITE);
        good_mesh(&m);
        m.uvs[7] = bad;
        expect_mesh(&world, "uv", &m, HYDRA_ERROR_NOT_FINITE);
    }
    good_mesh(&m);
    m.indices[5] = 4;
    expect_mesh(&world, "index", &m, HYDRA_ERROR_INDEX_RANGE);
    m.indices[5] = 0xffffffffu;
    expect_mesh(&world, "largest index", &m, HYDRA_ERROR_INDEX_RANGE);
    good_mesh(&m);
    m.short_indices[0] = 65535;
    m.desc.indices.data = m.short_indices;
    m.desc.indices.stride = 2;
    expect_mesh(&world, "short index", &m, HYDRA_ERROR_INDEX_RANGE);
    truth_close(&world);
}

/* Catches: counts, strides and sizes that read outside the caller's arrays. */
static void test_mesh_shapes(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    m.desc.indices.count = 5;
    expect_mesh(&world, "five indices", &m, HYDRA_ERROR_COUNT);
    good_mesh(&m);
    m.desc.indices.data = NULL;
    m.desc.indices.count = 0;
    expect_mesh(&world, "four positions without indices", &m, HYDRA_ERROR_COUNT);
    good_mesh(&m);
    m.desc.positions.count = 0;
    m.desc.normals.count = m.desc.uvs.count = 0;
    expect_mesh(&world, "no positions", &m, HYDRA_ERROR_COUNT);
    good_mesh(&m);
    m.desc.positions.data = NULL;
    expect_mesh(&world, "NULL positions", &m, HYDRA_ERROR_NULL);
    good_mesh(&m);
    m.desc.normals.count = 3;
    expect_mesh(&world, "three normals for four positions", &m, HYDRA_ERROR_COUNT);
    good_mesh(&m);
    m.desc.uvs.count = 5;
    expect_mesh(&world, "five uvs for four positions", &m, HYDRA_ERROR_COUNT);
    good_mesh(&m);
    m.desc.indices.stride = 3;
    expect_mesh(&world, "index size 3", &m, HYDRA_ERROR_INDEX_SIZE);
    m.desc.indices.stride = 8;
    expect_mesh(&world, "index size 8", &m, HYDRA_ERROR_INDEX_SIZE);
    good_mesh(&m);
    m.desc.positions.stride = 8;
    expect_mesh(&world, "stride below its element", &m, HYDRA_ERROR_STRIDE);
    m.desc.positions.stride = 13;
    expect_mesh(&world, "misaligned stride", &m, HYDRA_ERROR_STRIDE);
    good_mesh(&m);
    m.desc.uvs.stride = 4;
    expect_mesh(&world, "stride of uvs", &m, HYDRA_ERROR_STRIDE);
    truth_close(&world);
}

/* Catches: products of sizes that wrap round. The data pointer is never followed so far. */
static void test_mesh_overflow(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    static const size_t counts[] = {SIZE_MAX / 12 + 1, SIZE_MAX / 2, (size_t)1 << 33};
    for (int i = 0; i < 3; i++) {
        good_mesh(&m);
        m.desc.positions.count = counts[i];
        m.desc.normals.data = m.desc.uvs.data = NULL;
        m.desc.normals.count = m.desc.uvs.count = 0;
        hydra_mesh mesh = hydra_scene_add_mesh(world.scene, &m.desc);
        assert_int_equal(mesh.id, 0);
        hydra_result result = hydra_scene_commit(world.scene);
        assert_true(result == HYDRA_ERROR_OVERFLOW || result == HYDRA_ERROR_COUNT);
        expect_usable(&world);
    }
    good_mesh(&m);
    m.desc.positions.stride = SIZE_MAX / 2 + 2;
    hydra_mesh mesh = hydra_scene_add_mesh(world.scene, &m.desc);
    assert_int_equal(mesh.id, 0);
    hydra_result result = hydra_scene_commit(world.scene);
    assert_true(result == HYDRA_ERROR_OVERFLOW || result == HYDRA_ERROR_STRIDE);
    truth_close(&world);
}

/* Catches: handles that were not checked. */
static void test_mesh_materials(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    m.desc.material.id = 999;
    expect_mesh(&world, "material", &m, HYDRA_ERROR_HANDLE);
    good_mesh(&m);
    m.desc.triangle_materials.data = m.materials;
    m.desc.triangle_materials.count = 2;
    m.materials[0] = m.materials[1] = truth_lambert(world.scene, 0.5);
    m.materials[1].id += 1;
    expect_mesh(&world, "triangle material", &m, HYDRA_ERROR_HANDLE);
    m.materials[1] = m.materials[0];
    m.desc.triangle_materials.count = 1;
    expect_mesh(&world, "too few triangle materials", &m, HYDRA_ERROR_COUNT);
    truth_close(&world);
}

/* Catches: degenerate triangles that crash, count wrongly or are hit; a mesh of nothing else. */
static void test_degenerate(void **state) {
    (void)state;
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1, 0, 0, 1, 0, 1e-30f, 0, 0};
    static const uint32_t indices[15] = {0, 1, 2, 0, 1, 3, 1, 1, 3, 1, 3, 4, 0, 5, 3};
    truth_world world;
    hydra_mesh_desc desc;
    hydra_scene_info info;
    truth_open(&world);
    memset(&desc, 0, sizeof desc);
    desc.positions.data = positions;
    desc.positions.count = 6;
    desc.indices.data = indices;
    desc.indices.count = 15;
    hydra_mesh mesh = hydra_scene_add_mesh(world.scene, &desc);
    truth_commit(&world);
    assert_int_equal(hydra_scene_get_info(world.scene, &info), HYDRA_OK);
    assert_int_equal(info.triangles, 5);
    TRUTH_WITHIN("degenerate triangles", (double)info.degenerate, 3, 4); /* the last one has an area, in double */
    hydra_ray ray = {{0.2f, 0.2f, 1}, 0, {0, 0, -1}, INFINITY};
    hydra_hit hit;
    assert_int_equal(hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_OK);
    assert_int_equal(hit.primitive, 1); /* numbers stay those of the input */
    desc.indices.count = 3;
    assert_int_equal(hydra_scene_update_mesh(world.scene, mesh, &desc), HYDRA_OK);
    truth_commit(&world);
    assert_int_equal(hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_OK);
    assert_true(hit.t < 0);
    truth_close(&world);
}

/* ---------------------------------------------------------------- materials and textures */

static void expect_material(truth_world *world, const char *what, const hydra_material_desc *desc, hydra_result wanted) {
    expect_reported(world, what, hydra_scene_add_material(world->scene, desc).id, wanted);
    hydra_material good = truth_lambert(world->scene, 0.5);
    TRUTH_RESULT(world->context, hydra_scene_update_material(world->scene, good, desc), wanted);
    (void)hydra_scene_commit(world->scene);
    expect_usable(world);
}

/* One field of a good material set to a bad value. */
#define BAD_MATERIAL(set, wanted)                      \
    do {                                               \
        hydra_material_desc d;                         \
        memset(&d, 0, sizeof d);                       \
        d.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;    \
        d.set;                                         \
        expect_material(&world, #set, &d, wanted);     \
    } while (0)

static void test_materials(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    BAD_MATERIAL(kind = (hydra_material_kind)99, HYDRA_ERROR_ENUM);
    BAD_MATERIAL(alpha_mode = (hydra_alpha_mode)-1, HYDRA_ERROR_ENUM);
    BAD_MATERIAL(base_color[1] = 1.01f, HYDRA_ERROR_COLOR);
    BAD_MATERIAL(base_color[1] = -0.01f, HYDRA_ERROR_COLOR);
    BAD_MATERIAL(emission[2] = -1, HYDRA_ERROR_COLOR);
    BAD_MATERIAL(absorption[0] = -1, HYDRA_ERROR_COLOR);
    BAD_MATERIAL(roughness = 2, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(roughness = -0.1f, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(metallic = 1.5f, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(transmission = 1.5f, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(clearcoat = -1, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(clearcoat_roughness = 3, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(alpha = 1.5f, HYDRA_ERROR_ROUGHNESS);
    BAD_MATERIAL(ior = 0.5f, HYDRA_ERROR_IOR);
    BAD_MATERIAL(ior = 1, HYDRA_ERROR_IOR);
    BAD_MATERIAL(ior = 11, HYDRA_ERROR_IOR);
    BAD_MATERIAL(k[0] = -1, HYDRA_ERROR_IOR);
    BAD_MATERIAL(base_color[0] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(emission[0] = infinite, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(roughness = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(ior = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(kind = HYDRA_MATERIAL_CONDUCTOR; d.k[0] = 1; d.eta[1] = infinite, HYDRA_ERROR_IOR);
    BAD_MATERIAL(absorption[1] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(normal_scale = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_MATERIAL(base_color_texture.id = 77, HYDRA_ERROR_HANDLE);
    BAD_MATERIAL(normal_texture.id = 77, HYDRA_ERROR_HANDLE);
    BAD_MATERIAL(alpha_texture.id = 77, HYDRA_ERROR_HANDLE);
    hydra_material none = {0}, far = {12345};
    hydra_material_desc good;
    memset(&good, 0, sizeof good);
    TRUTH_RESULT(world.context, hydra_scene_update_material(world.scene, none, &good), HYDRA_ERROR_HANDLE);
    TRUTH_RESULT(world.context, hydra_scene_update_material(world.scene, far, &good), HYDRA_ERROR_HANDLE);
    truth_close(&world);
}

static void expect_texture(truth_world *world, const char *what, const hydra_texture_desc *desc, hydra_result wanted) {
    expect_reported(world, what, hydra_scene_add_texture(world->scene, desc).id, wanted);
}

static void test_textures(void **state) {
    (void)state;
    static float texels[4 * 4] = {0};
    truth_world world;
    open_good(&world);
    hydra_texture_desc good, d;
    memset(&good, 0, sizeof good);
    good.texels = texels;
    good.width = good.height = 2;
    d = good;
    d.texels = NULL;
    expect_texture(&world, "NULL texels", &d, HYDRA_ERROR_NULL);
    d = good;
    d.width = 0;
    expect_texture(&world, "no width", &d, HYDRA_ERROR_TEXTURE);
    d = good;
    d.height = 65537;
    expect_texture(&world, "too high", &d, HYDRA_ERROR_TEXTURE);
    d = good;
    d.format = (hydra_texel_format)7;
    expect_texture(&world, "format", &d, HYDRA_ERROR_ENUM);
    d = good;
    d.wrap_v = (hydra_wrap)7;
    expect_texture(&world, "wrap", &d, HYDRA_ERROR_ENUM);
    d = good;
    d.row_stride = 7;
    expect_texture(&world, "row stride", &d, HYDRA_ERROR_STRIDE);
    d = good;
    d.format = HYDRA_TEXEL_RGBA32F;
    texels[5] = nan_value;
    expect_texture(&world, "NaN texel", &d, HYDRA_ERROR_NOT_FINITE);
    texels[5] = 0;
    truth_close(&world);
}

/* ---------------------------------------------------------------- instances, lights, environment */

static void test_instances(void **state) {
    (void)state;
    static const float singular[4][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}, /* flat */
                                          {1, 2, 3, 0, 2, 4, 6, 0, 0, 0, 1, 0},
                                          {0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0, 0}, /* not "all zero" */
                                          {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, NAN, 0}};
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    hydra_instance_desc d;
    memset(&d, 0, sizeof d);
    d.mesh = hydra_scene_add_mesh(world.scene, &m.desc);
    hydra_instance good = hydra_scene_add_instance(world.scene, &d);
    assert_int_not_equal(good.id, 0);
    for (int i = 0; i < 4; i++) {
        hydra_result wanted = i < 3 ? HYDRA_ERROR_TRANSFORM : HYDRA_ERROR_NOT_FINITE;
        memcpy(d.transform, singular[i], sizeof d.transform);
        expect_reported(&world, "transform", hydra_scene_add_instance(world.scene, &d).id, wanted);
        TRUTH_RESULT(world.context, hydra_scene_update_instance(world.scene, good, &d), wanted);
        (void)hydra_scene_commit(world.scene);
    }
    memset(d.transform, 0, sizeof d.transform);
    d.material.id = 50;
    expect_reported(&world, "material", hydra_scene_add_instance(world.scene, &d).id, HYDRA_ERROR_HANDLE);
    d.material.id = 0;
    d.mesh.id = 0;
    expect_reported(&world, "no mesh", hydra_scene_add_instance(world.scene, &d).id, HYDRA_ERROR_HANDLE);
    d.mesh.id = 50;
    expect_reported(&world, "mesh", hydra_scene_add_instance(world.scene, &d).id, HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_scene_remove_instance(world.scene, good), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_remove_instance(world.scene, good), HYDRA_ERROR_HANDLE);
    truth_close(&world);
}

static hydra_light_desc good_light(hydra_light_kind kind) {
    hydra_light_desc d = truth_light(kind, 1);
    d.axis_u[0] = d.axis_v[1] = 1;
    d.radius = 1;
    return d;
}

#define BAD_LIGHT(of, set, wanted)                                                         \
    do {                                                                                   \
        hydra_light_desc d = good_light(of);                                               \
        d.set;                                                                             \
        expect_reported(&world, #set, hydra_scene_add_light(world.scene, &d).id, wanted);  \
        TRUTH_RESULT(world.context, hydra_scene_update_light(world.scene, good, &d), wanted); \
        (void)hydra_scene_commit(world.scene);                                             \
    } while (0)

static void test_lights(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    hydra_light_desc desc = good_light(HYDRA_LIGHT_POINT);
    desc.color[0] = desc.color[1] = desc.color[2] = 0;
    hydra_light good = hydra_scene_add_light(world.scene, &desc);
    assert_int_not_equal(good.id, 0);
    BAD_LIGHT((hydra_light_kind)9, unit = HYDRA_UNIT_DEFAULT, HYDRA_ERROR_ENUM);
    BAD_LIGHT(HYDRA_LIGHT_RECT, unit = (hydra_light_unit)9, HYDRA_ERROR_ENUM);
    BAD_LIGHT(HYDRA_LIGHT_RECT, color[0] = -1, HYDRA_ERROR_COLOR);
    BAD_LIGHT(HYDRA_LIGHT_RECT, color[0] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_LIGHT(HYDRA_LIGHT_RECT, position[1] = infinite, HYDRA_ERROR_NOT_FINITE);
    BAD_LIGHT(HYDRA_LIGHT_RECT, axis_u[0] = 0, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_RECT, axis_v[1] = 0, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_RECT, axis_v[0] = 0.5f, HYDRA_ERROR_LIGHT); /* not perpendicular */
    BAD_LIGHT(HYDRA_LIGHT_RECT, axis_u[2] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_LIGHT(HYDRA_LIGHT_DISC, radius = 0, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_DISC, radius = -1, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SPHERE, radius = 0, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SPHERE, radius = infinite, HYDRA_ERROR_NOT_FINITE);
    BAD_LIGHT(HYDRA_LIGHT_SPOT, cone_outer = -1, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SPOT, cone_outer = 4, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SPOT, cone_inner = 2, HYDRA_ERROR_LIGHT); /* wider than the outer */
    BAD_LIGHT(HYDRA_LIGHT_SPOT, direction[0] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_LIGHT(HYDRA_LIGHT_SUN, angular_radius = -0.1f, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SUN, angular_radius = 4, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_SUN, unit = HYDRA_UNIT_POWER, HYDRA_ERROR_LIGHT);
    BAD_LIGHT(HYDRA_LIGHT_POINT, unit = HYDRA_UNIT_IRRADIANCE, HYDRA_ERROR_LIGHT);
    assert_int_equal(hydra_scene_remove_light(world.scene, good), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_remove_light(world.scene, good), HYDRA_ERROR_HANDLE);
    TRUTH_RESULT(world.context, hydra_scene_update_light(world.scene, good, &desc), HYDRA_ERROR_HANDLE);
    truth_close(&world);
}

static void test_environment(void **state) {
    (void)state;
    static float texels[12] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    truth_world world;
    open_good(&world);
    hydra_environment_desc good, d;
    memset(&good, 0, sizeof good);
    d = good;
    d.color[0] = -1;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_COLOR);
    d.color[0] = nan_value;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_NOT_FINITE);
    d = good;
    d.rotation = infinite;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_NOT_FINITE);
    d = good;
    d.texels = texels;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_TEXTURE);
    d.width = d.height = 2;
    texels[7] = -1;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_COLOR);
    texels[7] = nan_value;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_ERROR_NOT_FINITE);
    (void)hydra_scene_commit(world.scene);
    expect_usable(&world);
    texels[7] = 1;
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, &d), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, NULL), HYDRA_OK);
    expect_usable(&world);
    truth_close(&world);
}

/* ---------------------------------------------------------------- renders */

static hydra_render_desc good_render(void) {
    hydra_render_desc d;
    memset(&d, 0, sizeof d);
    d.width = d.height = 4;
    d.max_samples = 2;
    return d;
}

/* The result is read from the message: hydra_render_create returns NULL. */
static void expect_render(truth_world *world, const char *what, const hydra_render_desc *d, hydra_result wanted) {
    hydra_render *render = hydra_render_create(world->scene, d);
    if (render) fail_msg("%s: was accepted", what);
    const char *text = hydra_error_text(world->context);
    if (strncmp(text, hydra_result_text(wanted), strlen(hydra_result_text(wanted))) != 0)
        fail_msg("%s: \"%s\", wanted \"%s\"", what, text, hydra_result_text(wanted));
    hydra_estimate_result estimate; /* does not read lists, so it may not know what is in them */
    hydra_result result = hydra_estimate(world->scene, d, &estimate);
    if (result != HYDRA_OK || d->sensor.kind < HYDRA_SENSOR_POINTS) TRUTH_RESULT(world->context, result, wanted);
    expect_usable(world);
}

#define BAD_RENDER(set, wanted)                  \
    do {                                         \
        hydra_render_desc d = good_render();     \
        d.set;                                   \
        expect_render(&world, #set, &d, wanted); \
    } while (0)

static void test_renders(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    BAD_RENDER(width = 0, HYDRA_ERROR_SIZE);
    BAD_RENDER(height = 0, HYDRA_ERROR_SIZE);
    BAD_RENDER(region[2] = 5, HYDRA_ERROR_SIZE);
    BAD_RENDER(region[0] = 1, HYDRA_ERROR_SIZE); /* a corner without a size */
    BAD_RENDER(outputs = 1u << HYDRA_OUTPUT_COUNT, HYDRA_ERROR_ENUM);
    BAD_RENDER(target_error = -0.1f, HYDRA_ERROR_BUDGET);
    BAD_RENDER(target_error = nan_value, HYDRA_ERROR_BUDGET);
    BAD_RENDER(time_budget = -1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(time_budget = (double)nan_value, HYDRA_ERROR_BUDGET);
    BAD_RENDER(step_seconds = -1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(max_samples = 3, HYDRA_ERROR_BUDGET);
    BAD_RENDER(first_sample = 2, HYDRA_ERROR_BUDGET); /* nothing is left up to max_samples */
    BAD_RENDER(first_sample = 1, HYDRA_ERROR_BUDGET);
    BAD_RENDER(strategy = (hydra_strategy)5, HYDRA_ERROR_ENUM);
    BAD_RENDER(tile_size = 12, HYDRA_ERROR_SIZE);
    BAD_RENDER(sensor.kind = (hydra_sensor_kind)17, HYDRA_ERROR_ENUM);
    BAD_RENDER(sensor.filter = (hydra_filter)17, HYDRA_ERROR_ENUM);
    BAD_RENDER(sensor.fov_y = 1e-6f, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = 3.141592f, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = -1, HYDRA_ERROR_SENSOR);
    BAD_RENDER(sensor.fov_y = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.position[2] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.target[2] = infinite, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.up[1] = nan_value, HYDRA_ERROR_NOT_FINITE);
    BAD_RENDER(sensor.shift[1] = infinite, HYDRA_ERROR_NOT_FINITE);
    hydra_render_desc d = good_render();
    d.first_sample = 2;
    d.max_samples = 4;
    d.target_error = 0.1f;
    expect_render(&world, "a share with a target", &d, HYDRA_ERROR_BUDGET);
    d = good_render();
    d.sensor.kind = HYDRA_SENSOR_THIN_LENS;
    d.sensor.lens_radius = -1;
    expect_render(&world, "lens radius", &d, HYDRA_ERROR_SENSOR);
    d.sensor.lens_radius = 0.1f;
    d.sensor.focus_distance = -1;
    expect_render(&world, "focus distance", &d, HYDRA_ERROR_SENSOR);
    d = good_render();
    d.sensor.kind = HYDRA_SENSOR_ORTHOGRAPHIC;
    d.sensor.ortho_height = -1;
    expect_render(&world, "ortho height", &d, HYDRA_ERROR_SENSOR);
    truth_close(&world);
}

/* Catches: width x height x bytes wrapping round, on any route; tested under a cap, so that nothing large is ever
   allocated. */
static void test_huge_images(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{65536, 65536}, {0xffffffffu, 0xffffffffu}, {0xffffffffu, 2}, {0x80000001u, 0x80000001u}};
    hydra_context_desc context;
    truth_world world;
    memset(&context, 0, sizeof context);
    context.memory_cap = 256u << 20;
    truth_open_with(&world, &context);
    truth_commit(&world);
    for (int i = 0; i < 4; i++) {
        hydra_render_desc d = good_render();
        d.width = sizes[i][0];
        d.height = sizes[i][1];
        d.outputs = (1u << HYDRA_OUTPUT_COUNT) - 1;
        assert_null(hydra_render_create(world.scene, &d));
        const char *text = hydra_error_text(world.context);
        assert_true(strstr(text, hydra_result_text(HYDRA_ERROR_OVERFLOW)) || strstr(text, hydra_result_text(HYDRA_ERROR_MEMORY_CAP)) ||
                    strstr(text, hydra_result_text(HYDRA_ERROR_SIZE)));
        hydra_estimate_result e;
        hydra_result result = hydra_estimate(world.scene, &d, &e);
        if (result == HYDRA_OK) assert_true((double)e.bytes_film >= 12.0 * sizes[i][0] * sizes[i][1]);
        else assert_true(result == HYDRA_ERROR_OVERFLOW || result == HYDRA_ERROR_SIZE);
        d.region[2] = d.region[3] = 8; /* a small part of a huge frame is fine */
        hydra_render *part = i == 0 ? truth_render(world.scene, &d) : NULL;
        hydra_render_destroy(part);
    }
    truth_close(&world);
}

/* Catches: point and ray lists of the wrong length, with bad numbers, or missing. */
static void test_lists(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    float p[12] = {0}, n[12];
    for (int i = 0; i < 12; i++) n[i] = 1;
    hydra_render_desc good = good_render(), d;
    good.width = good.height = 2;
    good.sensor = truth_sensor_points(p, n, 4);
    d = good;
    d.sensor.point_positions.count = 3;
    expect_render(&world, "three positions for four pixels", &d, HYDRA_ERROR_COUNT);
    d = good;
    d.sensor.point_normals.count = 5;
    expect_render(&world, "five normals", &d, HYDRA_ERROR_COUNT);
    d = good;
    d.sensor.point_normals.data = NULL;
    expect_render(&world, "no normals", &d, HYDRA_ERROR_NULL);
    d = good;
    d.sensor.point_positions.stride = 10;
    expect_render(&world, "stride", &d, HYDRA_ERROR_STRIDE);
    d = good;
    d.sensor.lightmap = (hydra_lightmap)9;
    expect_render(&world, "lightmap", &d, HYDRA_ERROR_ENUM);
    p[4] = nan_value;
    expect_render(&world, "NaN position", &good, HYDRA_ERROR_NOT_FINITE);
    p[4] = 0;
    n[3] = n[4] = n[5] = 0;
    expect_render(&world, "normal without direction", &good, HYDRA_ERROR_SENSOR);
    hydra_ray rays[4];
    memset(rays, 0, sizeof rays);
    for (int i = 0; i < 4; i++) {
        rays[i].direction[0] = 1;
        rays[i].t_max = infinite;
    }
    memset(&good.sensor, 0, sizeof good.sensor);
    good.sensor.kind = HYDRA_SENSOR_RAYS;
    good.sensor.rays.data = rays;
    good.sensor.rays.count = 4;
    d = good;
    d.sensor.rays.count = 2;
    expect_render(&world, "two rays for four pixels", &d, HYDRA_ERROR_COUNT);
    rays[3].direction[0] = 0;
    expect_render(&world, "ray without direction", &good, HYDRA_ERROR_RAY);
    rays[3].direction[0] = nan_value;
    expect_render(&world, "ray with NaN", &good, HYDRA_ERROR_RAY);
    rays[3].direction[0] = 1;
    rays[3].t_min = 2;
    rays[3].t_max = 1;
    expect_render(&world, "ray that ends before it begins", &good, HYDRA_ERROR_RAY);
    truth_close(&world);
}

/* ---------------------------------------------------------------- order of calls */

/* Catches: use after destroy, destroy under living children, edits under living renders. */
static void test_order(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    hydra_render_desc d = good_render();
    hydra_scene_info info;
    hydra_mesh extra = hydra_scene_add_mesh(world.scene, &m.desc);
    expect_render(&world, "create before commit", &d, HYDRA_ERROR_NOT_COMMITTED); /* and commits */
    hydra_render *render = hydra_render_create(world.scene, &d);
    assert_non_null(render);
    TRUTH_RESULT(world.context, hydra_scene_destroy(world.scene), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_destroy(world.context), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(world.scene, extra, &m.desc), HYDRA_ERROR_BUSY);
    TRUTH_RESULT(world.context, hydra_scene_set_environment(world.scene, NULL), HYDRA_ERROR_BUSY);
    assert_int_equal(hydra_scene_add_mesh(world.scene, &m.desc).id, 0);
    truth_run(render);
    hydra_render_destroy(render);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_remove_mesh(world.scene, extra), HYDRA_ERROR_HANDLE);
    hydra_ray ray = {{0, 0, 0}, 0, {0, 0, -1}, INFINITY};
    hydra_hit hit;
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, &ray, &hit, 1), HYDRA_ERROR_NOT_COMMITTED);
    (void)hydra_scene_commit(world.scene); /* the add while busy may be reported here */
    expect_usable(&world);
    TRUTH_RESULT(world.context, hydra_scene_get_info(world.scene, &info), HYDRA_OK);
    TRUTH_RESULT(world.context, hydra_scene_get_info(world.scene, NULL), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_destroy(world.context), HYDRA_ERROR_BUSY); /* the scene lives */
    truth_close(&world);
}

/* Catches: a reused slot that answers to an old handle, or another scene's handles taken without a word. */
static void test_foreign_handles(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    hydra_mesh old = hydra_scene_add_mesh(world.scene, &m.desc);
    assert_int_equal(hydra_scene_remove_mesh(world.scene, old), HYDRA_OK);
    hydra_mesh fresh = hydra_scene_add_mesh(world.scene, &m.desc);
    assert_int_not_equal(fresh.id, old.id);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(world.scene, old, &m.desc), HYDRA_ERROR_HANDLE);
    hydra_scene *other = hydra_scene_create(world.context);
    TRUTH_RESULT(world.context, hydra_scene_update_mesh(other, fresh, &m.desc), HYDRA_ERROR_HANDLE);
    m.desc.material = truth_lambert(world.scene, 0.3);
    assert_int_equal(hydra_scene_add_mesh(other, &m.desc).id, 0);
    TRUTH_RESULT(world.context, hydra_scene_commit(other), HYDRA_ERROR_HANDLE);
    TRUTH_RESULT(world.context, hydra_scene_destroy(other), HYDRA_OK);
    truth_close(&world);
}

/* Catches: NULL that crashes, and NULL that must be ignored. */
static void test_null(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    assert_int_equal(hydra_destroy(NULL), HYDRA_OK);
    assert_int_equal(hydra_scene_destroy(NULL), HYDRA_OK);
    hydra_render_destroy(NULL);
    hydra_render_cancel(NULL);
    assert_non_null(hydra_error_text(NULL));
    assert_null(hydra_scene_create(NULL));
    assert_int_equal(hydra_scene_commit(NULL), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_render_step(NULL), HYDRA_ERROR_NULL);
    assert_null(hydra_render_create(NULL, NULL));
    assert_null(hydra_render_create(world.scene, NULL));
    assert_int_equal(hydra_scene_requirements(NULL), 0);
    assert_int_equal(hydra_scene_add_mesh(NULL, NULL).id, 0);
    assert_int_equal(hydra_scene_add_material(NULL, NULL).id, 0);
    assert_int_equal(hydra_scene_add_light(NULL, NULL).id, 0);
    expect_reported(&world, "NULL mesh", hydra_scene_add_mesh(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL material", hydra_scene_add_material(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL texture", hydra_scene_add_texture(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL light", hydra_scene_add_light(world.scene, NULL).id, HYDRA_ERROR_NULL);
    expect_reported(&world, "NULL instance", hydra_scene_add_instance(world.scene, NULL).id, HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, NULL, NULL, 1), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_any_hits(world.scene, NULL, NULL, 1), HYDRA_ERROR_NULL);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, NULL, NULL, 0), HYDRA_OK);
    truth_close(&world);
}

/* Catches: one bad ray that spoils its neighbours; NaN in hits. */
static void test_bad_rays(void **state) {
    (void)state;
    truth_world world;
    open_good(&world);
    hydra_ray rays[9];
    hydra_hit hits[9];
    uint8_t blocked[9];
    for (int i = 0; i < 9; i++) {
        hydra_ray good = {{0.1f, 0.1f, 0}, 0, {0, 0, -1}, INFINITY};
        rays[i] = good;
    }
    rays[1].origin[0] = nan_value;
    rays[2].direction[1] = infinite;
    rays[3].direction[2] = 0;
    rays[5].t_min = 3;
    rays[5].t_max = 2;
    rays[6].t_max = nan_value;
    rays[7].t_max = 1.999f;
    memset(hits, 0xff, sizeof hits);
    memset(blocked, 0xff, sizeof blocked);
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, rays, hits, 9), HYDRA_ERROR_RAY);
    TRUTH_RESULT(world.context, hydra_scene_any_hits(world.scene, rays, blocked, 9), HYDRA_ERROR_RAY);
    for (int i = 0; i < 9; i++) {
        bool good = i == 0 || i == 4 || i == 8;
        assert_int_equal(blocked[i], good);
        if (good) assert_true(hits[i].t == 2);
        else assert_true(hits[i].t < 0 && hits[i].primitive == HYDRA_NONE && hits[i].mesh == 0);
    }
    TRUTH_RESULT(world.context, hydra_scene_closest_hits(world.scene, rays + 7, hits, 2), HYDRA_OK);
    truth_close(&world);
}

/* ---------------------------------------------------------------- reports and log */

/* Catches: the second error hiding the first; an error reported twice; a log that stays silent. */
static void test_first_error(void **state) {
    (void)state;
    truth_world world;
    mesh_input m;
    open_good(&world);
    good_mesh(&m);
    m.desc.indices.stride = 3;
    assert_int_equal(hydra_scene_add_mesh(world.scene, &m.desc).id, 0);
    char first[512];
    snprintf(first, sizeof first, "%s", hydra_error_text(world.context));
    hydra_light_desc light = truth_light(HYDRA_LIGHT_POINT, -1);
    assert_int_equal(hydra_scene_add_light(world.scene, &light).id, 0);
    assert_string_not_equal(first, hydra_error_text(world.context));
    uint32_t logged = world.host.errors;
    TRUTH_RESULT(world.context, hydra_scene_commit(world.scene), HYDRA_ERROR_INDEX_SIZE);
    assert_true(strstr(hydra_error_text(world.context), hydra_result_text(HYDRA_ERROR_INDEX_SIZE)) != NULL);
    TRUTH_RESULT(world.context, hydra_scene_commit(world.scene), HYDRA_OK);
    assert_true(logged >= 2 && world.host.errors >= logged);
    assert_non_null(strstr(first, "3")); /* "the last message with the numbers in it" */
    expect_usable(&world);
    truth_close(&world);
}

/* Catches: a code without text, or texts mixed up. */
static void test_result_texts(void **state) {
    (void)state;
    static const char *texts[] = {
#define TEXT(name, text) text,
        HYDRA_RESULTS(TEXT)
#undef TEXT
    };
    for (int r = 0; r < HYDRA_RESULT_COUNT; r++) assert_string_equal(hydra_result_text((hydra_result)r), texts[r]);
    assert_non_null(hydra_result_text(HYDRA_RESULT_COUNT));
    assert_non_null(hydra_result_text((hydra_result)-1));
}

/* Catches: contexts that cannot be had and come anyway. */
static void test_contexts(void **state) {
    (void)state;
    hydra_context_desc d;
    memset(&d, 0, sizeof d);
    hydra_context *both[2];
    both[0] = hydra_create(NULL);
    both[1] = hydra_create(&d);
    for (int i = 0; i < 2; i++) {
        assert_non_null(both[i]);
        assert_string_equal(hydra_error_text(both[i]), "");
        assert_true(hydra_context_threads(both[i]) >= 1);
        assert_true(hydra_context_isa(both[i]) != HYDRA_ISA_AUTO);
    }
    for (int i = 0; i < 2; i++) assert_int_equal(hydra_destroy(both[i]), HYDRA_OK);
    d.isa = (hydra_isa)42;
    assert_null(hydra_create(&d));
    d.isa = HYDRA_ISA_AUTO;
    d.memory_cap = 1;
    assert_null(hydra_create(&d));
}

int hydra_test_input(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mesh_numbers),  cmocka_unit_test(test_mesh_shapes),
        cmocka_unit_test(test_mesh_overflow), cmocka_unit_test(test_mesh_materials),
        cmocka_unit_test(test_degenerate),    cmocka_unit_test(test_materials),
        cmocka_unit_test(test_textures),      cmocka_unit_test(test_instances),
        cmocka_unit_test(test_lights),        cmocka_unit_test(test_environment),
        cmocka_unit_test(test_renders),       cmocka_unit_test(test_huge_images),
        cmocka_unit_test(test_lists),         cmocka_unit_test(test_order),
        cmocka_unit_test(test_foreign_handles), cmocka_unit_test(test_null),
        cmocka_unit_test(test_bad_rays),      cmocka_unit_test(test_first_error),
        cmocka_unit_test(test_result_texts),  cmocka_unit_test(test_contexts)};
    return cmocka_run_group_tests_name("input", tests, NULL, NULL);
}
