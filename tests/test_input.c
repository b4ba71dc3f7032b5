/* Bad meshes, materials, textures, instances, lights and environments: every named error that can be provoked is
   provoked, the scene stays usable after each, the next commit reports the first failing add once, nothing leaks. */
#include "input_helpers.h"

int hydra_test_input(void);

static const float nan_value = NAN, infinite = INFINITY;

/* ---------------------------------------------------------------- meshes */

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

int hydra_test_input(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_mesh_numbers),
                                       cmocka_unit_test(test_mesh_shapes),
                                       cmocka_unit_test(test_mesh_overflow),
                                       cmocka_unit_test(test_mesh_materials),
                                       cmocka_unit_test(test_degenerate),
                                       cmocka_unit_test(test_materials),
                                       cmocka_unit_test(test_textures),
                                       cmocka_unit_test(test_instances),
                                       cmocka_unit_test(test_lights),
                                       cmocka_unit_test(test_environment)};
    return cmocka_run_group_tests_name("input", tests, NULL, NULL);
}
