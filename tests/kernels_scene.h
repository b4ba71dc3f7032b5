/* A scene with something of everything that kernels read: materials of all kinds and limits, textures of all formats, moved
   and mirrored meshes, lights, suns and a map. For test_vk_kernels.c. */
#ifndef KERNELS_SCENE_H
#define KERNELS_SCENE_H

#include "hydra_test.h"

typedef struct kernels_scene {
    hydra_scene *scene;
    hydra_material grey, shiny, patterned, glowing, cut;
    hydra_texture bytes, data, floats;
    ht_rng rng;
} kernels_scene;

static hydra_texture add_texture(kernels_scene *s, uint32_t width, uint32_t height, hydra_texel_format format, hydra_wrap u, hydra_wrap v) {
    hydra_texture_desc desc;
    uint32_t words = width * height * (format == HYDRA_TEXEL_RGBA32F ? 4 : 1), *texels = (uint32_t *)malloc(4 * words);
    for (uint32_t i = 0; i < words; i++) texels[i] = format == HYDRA_TEXEL_RGBA32F ? hyk_float_bits(ht_uniform(&s->rng)) : ht_u32(&s->rng);
    memset(&desc, 0, sizeof desc);
    desc.texels = texels;
    desc.width = width;
    desc.height = height;
    desc.format = format;
    desc.wrap_u = u;
    desc.wrap_v = v;
    hydra_texture texture = hydra_scene_add_texture(s->scene, &desc);
    assert_true(texture.id != 0);
    free(texels);
    return texture;
}

static void add_textures(kernels_scene *s) {
    s->bytes = add_texture(s, 16, 8, HYDRA_TEXEL_RGBA8_SRGB, HYDRA_WRAP_REPEAT, HYDRA_WRAP_REPEAT);
    s->data = add_texture(s, 13, 29, HYDRA_TEXEL_RGBA8_LINEAR, HYDRA_WRAP_MIRROR, HYDRA_WRAP_CLAMP);
    s->floats = add_texture(s, 32, 5, HYDRA_TEXEL_RGBA32F, HYDRA_WRAP_CLAMP, HYDRA_WRAP_MIRROR);
    (void)add_texture(s, 1, 1, HYDRA_TEXEL_RGBA8_SRGB, HYDRA_WRAP_MIRROR, HYDRA_WRAP_REPEAT);
    (void)add_texture(s, 1, 7, HYDRA_TEXEL_RGBA32F, HYDRA_WRAP_REPEAT, HYDRA_WRAP_MIRROR);
}

static hydra_material_desc material_of(hydra_material_kind kind, float roughness) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    m.kind = kind;
    m.roughness = roughness;
    m.base_color[0] = 0.8f;
    m.base_color[1] = 0.5f;
    m.base_color[2] = 0.25f;
    return m;
}

static hydra_material add_material(kernels_scene *s, const hydra_material_desc *desc) {
    hydra_material material = hydra_scene_add_material(s->scene, desc);
    if (!material.id) print_error("%s\n", hydra_error_text(s->scene->context));
    assert_true(material.id != 0);
    return material;
}

static void add_glasses(kernels_scene *s) {
    const float glasses[][2] = {{0, 1.5f}, {0.3f, 1.5f}, {0.02f, 1.33f}, {1, 2.4f}, {0.1f, 1.003f}, {0.5f, 10}, {0.2f, 1.0001f}};
    for (size_t i = 0; i < sizeof glasses / sizeof glasses[0]; i++) {
        hydra_material_desc m = material_of(HYDRA_MATERIAL_DIELECTRIC, glasses[i][0]);
        m.ior = glasses[i][1];
        m.absorption[1] = 0.5f;
        (void)add_material(s, &m);
    }
}

static void add_metals(kernels_scene *s) {
    const float roughness[] = {0, 0.011f, 0.2f, 1};
    for (int i = 0; i < 4; i++) {
        hydra_material_desc m = material_of(HYDRA_MATERIAL_CONDUCTOR, roughness[i]);
        (void)add_material(s, &m);
        m.eta[0] = 0.14f, m.eta[1] = 0.37f, m.eta[2] = 1.44f;
        m.k[0] = 3.98f, m.k[1] = 2.39f, m.k[2] = 1.6f;
        (void)add_material(s, &m);
    }
}

/* Metallic-roughness with everything, thin and not, coats smooth and rough. */
static void add_mixtures(kernels_scene *s) {
    const float roughness[] = {0, 0.05f, 0.4f, 1}, coats[] = {0, 0.3f, 0.02f, 0};
    for (int i = 0; i < 8; i++) {
        hydra_material_desc m = material_of(HYDRA_MATERIAL_METALLIC_ROUGHNESS, roughness[i % 4]);
        m.ior = 1.2f + 0.1f * (float)i;
        m.metallic = i % 3 == 2 ? 0.3f : 0;
        m.transmission = i > 1 ? 0.6f : 0;
        m.thin = i > 4;
        m.clearcoat = i % 4 == 3 ? 0 : 0.5f + 0.1f * (float)(i % 4);
        m.clearcoat_roughness = coats[i % 4];
        (void)add_material(s, &m);
    }
}

static void add_materials(kernels_scene *s) {
    hydra_material_desc m = material_of(HYDRA_MATERIAL_LAMBERT, 0);
    s->grey = add_material(s, &m);
    m = material_of(HYDRA_MATERIAL_METALLIC_ROUGHNESS, 0.3f);
    s->shiny = add_material(s, &m);
    m.base_color_texture = s->bytes;
    m.metallic_roughness_texture = s->floats;
    m.normal_texture = s->data;
    m.normal_scale = 0.7f;
    s->patterned = add_material(s, &m);
    m = material_of(HYDRA_MATERIAL_LAMBERT, 0);
    m.emission[0] = m.emission[2] = 1;
    m.emission[1] = 0.5f;
    m.emission_texture = s->floats;
    m.emit_both_sides = true;
    s->glowing = add_material(s, &m);
    m = material_of(HYDRA_MATERIAL_LAMBERT, 0);
    m.emission[1] = 0.5f;
    m.alpha_mode = HYDRA_ALPHA_MASK;
    m.alpha_texture = s->data;
    s->cut = add_material(s, &m);
    m.alpha_mode = HYDRA_ALPHA_BLEND;
    m.alpha_texture.id = 0;
    m.alpha = 0.7f;
    m.base_color_texture = s->bytes;
    (void)add_material(s, &m);
    add_glasses(s);
    add_metals(s);
    add_mixtures(s);
}

/* A sphere with normals and uvs of its own. */
static hydra_mesh add_ball(kernels_scene *s, hydra_material material, bool instanced_only) {
    ht_mesh mesh = ht_icosphere(1, 1);
    float *uvs = (float *)malloc(8 * mesh.vertex_count);
    hydra_mesh_desc desc = ht_mesh_desc(&mesh, material);
    for (uint32_t i = 0; i < 2 * mesh.vertex_count; i++) uvs[i] = ht_range(&s->rng, -2, 2);
    desc.normals = desc.positions;
    desc.uvs.data = uvs;
    desc.uvs.stride = 8;
    desc.uvs.count = mesh.vertex_count;
    desc.instanced_only = instanced_only;
    hydra_mesh added = hydra_scene_add_mesh(s->scene, &desc);
    assert_true(added.id != 0);
    free(uvs);
    ht_mesh_free(&mesh);
    return added;
}

static void add_meshes(kernels_scene *s) {
    const float moved[3][12] = {{0.5f, 0.2f, 0, 1, -0.1f, 0.7f, 0, 2, 0, 0.3f, 0.4f, -3},
                                {-30, 0, 0, 500, 0, 30, 10, -70, 0, 0, 30, 0},
                                {0.001f, 0, 0, 0, 0, 0, 0.002f, 1, 0, -0.001f, 0, 0}};
    ht_mesh soup = ht_soup(&s->rng, 12, 2, 0.5f), far = ht_soup(&s->rng, 8, 1, 0.5f);
    hydra_mesh_desc desc = ht_mesh_desc(&soup, s->glowing);
    assert_true(hydra_scene_add_mesh(s->scene, &desc).id != 0);
    ht_mesh_place(&far, 1, 1e4f, 0, 0);
    desc = ht_mesh_desc(&far, s->grey);
    assert_true(hydra_scene_add_mesh(s->scene, &desc).id != 0);
    (void)add_ball(s, s->patterned, false);
    (void)add_ball(s, s->cut, false);
    hydra_mesh ball = add_ball(s, s->glowing, true);
    for (int i = 0; i < 3; i++) {
        hydra_instance_desc place;
        memset(&place, 0, sizeof place);
        place.mesh = ball;
        memcpy(place.transform, moved[i], sizeof moved[i]);
        place.material = i == 2 ? s->patterned : (hydra_material){0};
        assert_true(hydra_scene_add_instance(s->scene, &place).id != 0);
    }
    ht_mesh_free(&soup);
    ht_mesh_free(&far);
}

static void add_lights(kernels_scene *s) {
    for (uint32_t i = 0; i < 12; i++) {
        hydra_light_desc l;
        memset(&l, 0, sizeof l);
        l.kind = i < 10 ? (hydra_light_kind)(i % 5) : HYDRA_LIGHT_SUN;
        for (int k = 0; k < 3; k++) {
            l.color[k] = ht_range(&s->rng, 0.1f, 4);
            l.position[k] = ht_range(&s->rng, -3, 3);
        }
        ht_direction(&s->rng, l.direction);
        l.axis_u[i % 3] = 0.5f;
        l.axis_v[(i + 1) % 3] = 0.25f;
        l.radius = ht_range(&s->rng, 0.05f, 0.5f);
        l.angular_radius = i == 10 ? 0.005f : 0.3f;
        l.both_sides = i % 5 < 2 && i > 4;
        if (!hydra_scene_add_light(s->scene, &l).id) fail_msg("light %u: %s", i, hydra_error_text(s->scene->context));
    }
}

static void add_environment(kernels_scene *s) {
    enum { WIDTH = 12, HEIGHT = 7 };
    float texels[3 * WIDTH * HEIGHT];
    hydra_environment_desc e;
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) texels[i] = i / 3 % 9 == 4 ? 0 : ht_uniform(&s->rng);
    memset(&e, 0, sizeof e);
    e.texels = texels;
    e.width = WIDTH;
    e.height = HEIGHT;
    e.rotation = 0.7f;
    e.color[0] = e.color[1] = e.color[2] = 0.8f;
    ht_ok(s->scene->context, hydra_scene_set_environment(s->scene, &e));
}

static hydra_scene *make_scene(hydra_context *context) {
    kernels_scene s;
    memset(&s, 0, sizeof s);
    s.scene = hydra_scene_create(context);
    s.rng = ht_rng_make(77);
    assert_non_null(s.scene);
    add_textures(&s);
    add_materials(&s);
    add_meshes(&s);
    add_lights(&s);
    add_environment(&s);
    ht_ok(context, hydra_scene_commit(s.scene));
    return s.scene;
}

#endif /* KERNELS_SCENE_H */
