/* gltf_extras.c: see gltf_extras.h */
#include "gltf_extras.h"

#include "app.h"
#include "gltf_buffers.h"
#include "json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

gltf_material gltf_material_default(void) {
    gltf_material material;
    memset(&material, 0, sizeof material);
    material.specular = 1.0f;
    material.ior = 1.5f;
    material.emissive_strength = 1.0f;
    for (int i = 0; i < 3; i++) material.attenuation_color[i] = 1.0f;
    material.uv_transform[0] = material.uv_transform[4] = 1.0f;
    return material;
}

static float number_in(const json_document *json, uint32_t object, const char *key, float fallback) {
    return (float)json_number(json, json_get(json, object, key), (double)fallback);
}

/* ---------------------------------------------------------------- textures */

/* KHR_texture_transform: translation * rotation * scale, applied to (u, v). */
static void read_transform(const json_document *json, uint32_t info, float matrix[6]) {
    uint32_t extension = json_get(json, json_get(json, info, "extensions"), "KHR_texture_transform");
    float offset[2] = {0.0f, 0.0f}, scale[2] = {1.0f, 1.0f};
    float rotation = number_in(json, extension, "rotation", 0.0f);
    json_numbers(json, json_get(json, extension, "offset"), offset, 2);
    json_numbers(json, json_get(json, extension, "scale"), scale, 2);
    float c = cosf(rotation), s = sinf(rotation);
    float rows[6] = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
    memcpy(matrix, rows, sizeof rows);
}

static uint32_t read_uv_set(const json_document *json, uint32_t info) {
    uint32_t extension = json_get(json, json_get(json, info, "extensions"), "KHR_texture_transform");
    double set = json_number(json, json_get(json, info, "texCoord"), 0.0);
    set = json_number(json, json_get(json, extension, "texCoord"), set);
    return set >= 0.0 && set < 8.0 ? (uint32_t)set : 0;
}

/* hydra has one uv per vertex: the first texture decides, the others have to agree. */
static void read_textures(gltf_material *material, const json_document *json, uint32_t object) {
    uint32_t base = json_get(json, object, "pbrMetallicRoughness");
    uint32_t infos[4];
    infos[0] = json_get(json, base, "baseColorTexture");
    infos[1] = json_get(json, base, "metallicRoughnessTexture");
    infos[2] = json_get(json, object, "normalTexture");
    infos[3] = json_get(json, object, "emissiveTexture");
    bool found = false;
    for (int i = 0; i < 4; i++) {
        float matrix[6];
        if (infos[i] == JSON_NONE) continue;
        read_transform(json, infos[i], matrix);
        uint32_t set = read_uv_set(json, infos[i]);
        if (found && (set != material->uv_set || memcmp(matrix, material->uv_transform, sizeof matrix) != 0)) material->uv_mixed = true;
        if (found) continue;
        found = true;
        material->uv_set = set;
        memcpy(material->uv_transform, matrix, sizeof matrix);
    }
}

/* ---------------------------------------------------------------- materials */

static gltf_material read_material(const json_document *json, uint32_t object) {
    gltf_material material = gltf_material_default();
    uint32_t extensions = json_get(json, object, "extensions");
    uint32_t volume = json_get(json, extensions, "KHR_materials_volume");
    uint32_t specular = json_get(json, extensions, "KHR_materials_specular");
    material.specular = number_in(json, specular, "specularFactor", 1.0f);
    material.ior = number_in(json, json_get(json, extensions, "KHR_materials_ior"), "ior", 1.5f);
    material.emissive_strength = number_in(json, json_get(json, extensions, "KHR_materials_emissive_strength"), "emissiveStrength", 1.0f);
    material.transmission = number_in(json, json_get(json, extensions, "KHR_materials_transmission"), "transmissionFactor", 0.0f);
    material.thickness = number_in(json, volume, "thicknessFactor", 0.0f);
    material.attenuation_distance = number_in(json, volume, "attenuationDistance", 0.0f);
    json_numbers(json, json_get(json, volume, "attenuationColor"), material.attenuation_color, 3);
    read_textures(&material, json, object);
    return material;
}

static void read_materials(gltf_extras *extras, const json_document *json) {
    uint32_t list = json_get(json, 0, "materials");
    extras->materials = app_alloc(json_count(json, list), sizeof(gltf_material));
    for (uint32_t i = json_first(json, list); i != JSON_NONE; i = json_next(json, list, i))
        if (extras->material_count < json_count(json, list)) extras->materials[extras->material_count++] = read_material(json, i);
}

static void read_cameras(gltf_extras *extras, const json_document *json) {
    uint32_t list = json_get(json, 0, "cameras");
    extras->camera_fov_y = app_alloc(json_count(json, list), sizeof(float));
    for (uint32_t i = json_first(json, list); i != JSON_NONE; i = json_next(json, list, i))
        extras->camera_fov_y[extras->camera_count++] = number_in(json, json_get(json, i, "perspective"), "yfov", 0.0f);
}

/* ---------------------------------------------------------------- EXT_mesh_gpu_instancing */

/* Rotation by a unit quaternion (x, y, z, w) after scaling, then translation. */
static void compose(float m[12], const float t[3], const float q[4], const float s[3]) {
    float x = q[0], y = q[1], z = q[2], w = q[3];
    float r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w),    1 - 2 * (x * x + z * z),
                  2 * (y * z - x * w),     2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) m[4 * row + column] = r[3 * row + column] * s[column];
        m[4 * row + 3] = t[row];
    }
}

static bool read_placement(gltf_placement *placement, gltf_buffers *buffers, uint32_t attributes) {
    float *t = NULL, *r = NULL, *s = NULL;
    size_t counts[3];
    counts[0] = gltf_buffers_floats(buffers, json_get(buffers->json, attributes, "TRANSLATION"), 3, &t);
    counts[1] = gltf_buffers_floats(buffers, json_get(buffers->json, attributes, "ROTATION"), 4, &r);
    counts[2] = gltf_buffers_floats(buffers, json_get(buffers->json, attributes, "SCALE"), 3, &s);
    static const float zero[3] = {0, 0, 0}, identity[4] = {0, 0, 0, 1}, one[3] = {1, 1, 1};
    size_t count = counts[0] > counts[1] ? counts[0] : counts[1];
    count = count > counts[2] ? count : counts[2];
    bool good = count > 0;
    for (int i = 0; i < 3; i++) good = good && (counts[i] == 0 || counts[i] == count);
    placement->transforms = app_alloc(good ? count : 0, sizeof *placement->transforms);
    placement->count = good ? count : 0;
    for (size_t i = 0; i < placement->count; i++)
        compose(placement->transforms[i], t ? t + 3 * i : zero, r ? r + 4 * i : identity, s ? s + 3 * i : one);
    free(t);
    free(r);
    free(s);
    return good;
}

/* assimp takes the node's own name, or nodes[i]. */
static char *node_name(const json_document *json, uint32_t node, unsigned index) {
    uint32_t name = json_get(json, node, "name");
    char numbered[32];
    snprintf(numbered, sizeof numbered, "nodes[%u]", index);
    if (name == JSON_NONE || json->values[name].length == 0) return app_copy(numbered);
    char *copy = app_alloc(json->values[name].length + 1, 1);
    memcpy(copy, json->values[name].text, json->values[name].length);
    copy[json->values[name].length] = '\0';
    return copy;
}

static void read_placements(gltf_extras *extras, gltf_buffers *buffers) {
    const json_document *json = buffers->json;
    uint32_t list = json_get(json, 0, "nodes");
    unsigned index = 0;
    for (uint32_t i = json_first(json, list); i != JSON_NONE; i = json_next(json, list, i), index++) {
        uint32_t extension = json_get(json, json_get(json, i, "extensions"), "EXT_mesh_gpu_instancing");
        if (extension == JSON_NONE) continue;
        gltf_placement placement = {NULL, NULL, 0};
        if (!read_placement(&placement, buffers, json_get(json, extension, "attributes"))) {
            app_warning("%s: node %u: its EXT_mesh_gpu_instancing cannot be read; placed once", buffers->path, index);
            free(placement.transforms);
            continue;
        }
        placement.name = node_name(json, i, index);
        extras->placements = app_realloc(extras->placements, extras->placement_count + 1, sizeof placement);
        extras->placements[extras->placement_count++] = placement;
    }
}

/* ---------------------------------------------------------------- the file */

bool gltf_extras_read(gltf_extras *extras, const char *path) {
    memset(extras, 0, sizeof *extras);
    gltf_buffers buffers;
    json_document json;
    if (!gltf_buffers_open(&buffers, path)) return false;
    if (json_parse(&json, buffers.text, buffers.text_length) == NULL) {
        buffers.json = &json;
        read_materials(extras, &json);
        read_cameras(extras, &json);
        read_placements(extras, &buffers);
    }
    json_free(&json);
    gltf_buffers_close(&buffers);
    return true;
}

void gltf_extras_free(gltf_extras *extras) {
    for (size_t i = 0; i < extras->placement_count; i++) {
        free(extras->placements[i].name);
        free(extras->placements[i].transforms);
    }
    free(extras->placements);
    free(extras->materials);
    free(extras->camera_fov_y);
    memset(extras, 0, sizeof *extras);
}
