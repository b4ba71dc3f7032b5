/* materials.c: see materials.h. glTF's model is hydra's own; MTL and its kin are translated to the nearest. */
#include "materials.h"

#include "app.h"

#include <assimp/GltfMaterial.h>
#include <assimp/material.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* assimp spells a key as three arguments: a name, a texture type and an index. */
static float get_float(const struct aiMaterial *m, const char *key, unsigned type, unsigned index, float fallback) {
    ai_real value;
    unsigned count = 1;
    bool found = aiGetMaterialFloatArray(m, key, type, index, &value, &count) == aiReturn_SUCCESS && count == 1;
    return found ? (float)value : fallback;
}

static int get_int(const struct aiMaterial *m, const char *key, unsigned type, unsigned index, int fallback) {
    int value;
    unsigned count = 1;
    bool found = aiGetMaterialIntegerArray(m, key, type, index, &value, &count) == aiReturn_SUCCESS && count == 1;
    return found ? value : fallback;
}

/* The alpha of the colour, or 1. */
static float get_color(const struct aiMaterial *m, const char *key, unsigned type, unsigned index, float rgb[3]) {
    ai_real value[4] = {0, 0, 0, 1};
    unsigned count = 4;
    if (aiGetMaterialFloatArray(m, key, type, index, value, &count) != aiReturn_SUCCESS || count < 3) return 1.0f;
    for (int i = 0; i < 3; i++) rgb[i] = (float)value[i];
    return count > 3 ? (float)value[3] : 1.0f;
}

static const char *get_name(const struct aiMaterial *m, struct aiString *name) {
    return aiGetMaterialString(m, AI_MATKEY_NAME, name) == aiReturn_SUCCESS && name->length > 0 ? name->data : "(unnamed)";
}

/* Outside 0..1 is a slip that pictures survive; NaN passes and becomes hydra's error. */
static float unit(const char *material, const char *what, float value) {
    if (!(value < 0.0f) && !(value > 1.0f)) return value;
    app_warning("material %s: %s %g is outside 0..1 and was clamped", material, what, (double)value);
    return value < 0.0f ? 0.0f : 1.0f;
}

static void unit_color(const char *material, const char *what, float rgb[3]) {
    for (int i = 0; i < 3; i++) rgb[i] = unit(material, what, rgb[i]);
}

static float highest(const float rgb[3]) { return fmaxf(rgb[0], fmaxf(rgb[1], rgb[2])); }

/* ---------------------------------------------------------------- textures */

enum { GLTF_NEAREST = 9728 }; /* the number of the filter in glTF and OpenGL */

static hydra_wrap to_wrap(enum aiTextureMapMode mode) {
    if (mode == aiTextureMapMode_Clamp || mode == aiTextureMapMode_Decal) return HYDRA_WRAP_CLAMP;
    return mode == aiTextureMapMode_Mirror ? HYDRA_WRAP_MIRROR : HYDRA_WRAP_REPEAT;
}

/* The first texture of this type, or none; its name and uv set where wanted. */
static hydra_texture get_texture(texture_cache *textures, const struct aiMaterial *m, enum aiTextureType type, bool srgb,
                                 struct aiString *name, unsigned *uv_set) {
    hydra_texture none = {0};
    struct aiString path;
    unsigned set = 0;
    enum aiTextureMapMode modes[2] = {aiTextureMapMode_Wrap, aiTextureMapMode_Wrap};
    if (aiGetMaterialTexture(m, type, 0, &path, NULL, &set, NULL, NULL, modes, NULL) != aiReturn_SUCCESS) return none;
    if (name != NULL) *name = path;
    if (uv_set != NULL) *uv_set = set;
    texture_use use = {srgb, false, to_wrap(modes[0]), to_wrap(modes[1])};
    use.nearest = get_int(m, AI_MATKEY_GLTF_MAPPINGFILTER_MAG(type, 0), 0) == GLTF_NEAREST;
    return textures_get(textures, path.data, &use);
}

static void warn_ignored(const struct aiMaterial *m, const char *name, enum aiTextureType type, const char *what) {
    if (aiGetMaterialTextureCount(m, type) > 0) app_warning("material %s: its %s texture is ignored", name, what);
}

/* ---------------------------------------------------------------- glTF */

static void gltf_alpha(hydra_material_desc *desc, const struct aiMaterial *m, const char *name, float alpha) {
    struct aiString mode;
    bool found = aiGetMaterialString(m, AI_MATKEY_GLTF_ALPHAMODE, &mode) == aiReturn_SUCCESS;
    float cutoff = get_float(m, AI_MATKEY_GLTF_ALPHACUTOFF, 0.5f);
    if (!found || strcmp(mode.data, "OPAQUE") == 0) return;
    desc->alpha_mode = strcmp(mode.data, "MASK") == 0 ? HYDRA_ALPHA_MASK : HYDRA_ALPHA_BLEND;
    if (desc->alpha_mode == HYDRA_ALPHA_MASK && cutoff <= 0.0f) desc->alpha_mode = HYDRA_ALPHA_OPAQUE;
    desc->alpha = fmaxf(unit(name, "alpha", alpha), 1e-30f); /* hydra takes 0 for "not given" */
    desc->alpha_cutoff = unit(name, "alphaCutoff", cutoff);
}

/* Beer-Lambert: what is left after the attenuation distance is the attenuation colour. */
static void gltf_volume(hydra_material_desc *desc, const gltf_material *extras) {
    bool attenuates = extras->attenuation_distance > 0.0f && highest(extras->attenuation_color) >= 0.0f;
    desc->thin = !(extras->thickness > 0.0f) && !attenuates;
    if (desc->thin || !attenuates) return;
    for (int i = 0; i < 3; i++) {
        float left = fminf(fmaxf(extras->attenuation_color[i], 1e-6f), 1.0f);
        desc->absorption[i] = -logf(left) / extras->attenuation_distance;
    }
}

/* KHR_materials_specular scales the reflectance at normal incidence: an ior with that reflectance does the same.
   0 is a purely diffuse surface. */
static void gltf_specular(hydra_material_desc *desc, const gltf_material *extras) {
    float ior = extras->ior == 0.0f ? 10.0f : fminf(fmaxf(extras->ior, 1.0001f), 10.0f); /* 0 means infinite */
    desc->ior = ior;
    if (extras->specular >= 1.0f || desc->transmission > 0.0f) return;
    bool diffuse = extras->specular <= 0.0f && desc->metallic == 0.0f && desc->clearcoat == 0.0f;
    if (diffuse) desc->kind = HYDRA_MATERIAL_LAMBERT;
    float root = (ior - 1.0f) / (ior + 1.0f) * sqrtf(fmaxf(extras->specular, 0.0f));
    desc->ior = fmaxf((1.0f + root) / (1.0f - root), 1.0001f);
}

static void gltf_unlit(hydra_material_desc *desc) {
    memcpy(desc->emission, desc->base_color, sizeof desc->emission);
    memset(desc->base_color, 0, sizeof desc->base_color);
    desc->emission_texture = desc->base_color_texture;
    desc->kind = HYDRA_MATERIAL_LAMBERT;
}

static void gltf_factors(hydra_material_desc *desc, const struct aiMaterial *m, const char *name, const gltf_material *extras) {
    float alpha = get_color(m, AI_MATKEY_BASE_COLOR, desc->base_color);
    unit_color(name, "baseColorFactor", desc->base_color);
    desc->metallic = unit(name, "metallicFactor", get_float(m, AI_MATKEY_METALLIC_FACTOR, 1.0f));
    desc->roughness = unit(name, "roughnessFactor", get_float(m, AI_MATKEY_ROUGHNESS_FACTOR, 1.0f));
    desc->transmission = unit(name, "transmissionFactor", extras->transmission);
    desc->clearcoat = unit(name, "clearcoatFactor", get_float(m, AI_MATKEY_CLEARCOAT_FACTOR, 0.0f));
    desc->clearcoat_roughness = unit(name, "clearcoatRoughnessFactor", get_float(m, AI_MATKEY_CLEARCOAT_ROUGHNESS_FACTOR, 0.0f));
    desc->emit_both_sides = get_int(m, AI_MATKEY_TWOSIDED, 0) != 0;
    get_color(m, AI_MATKEY_COLOR_EMISSIVE, desc->emission);
    for (int i = 0; i < 3; i++) desc->emission[i] *= extras->emissive_strength;
    gltf_alpha(desc, m, name, alpha);
    gltf_volume(desc, extras);
    gltf_specular(desc, extras);
}

static void gltf_textures(hydra_material_desc *desc, texture_cache *textures, const struct aiMaterial *m, const char *name) {
    desc->base_color_texture = get_texture(textures, m, aiTextureType_BASE_COLOR, true, NULL, NULL);
    desc->emission_texture = get_texture(textures, m, aiTextureType_EMISSIVE, true, NULL, NULL);
    desc->normal_texture = get_texture(textures, m, aiTextureType_NORMALS, false, NULL, NULL);
    desc->metallic_roughness_texture = get_texture(textures, m, aiTextureType_METALNESS, false, NULL, NULL);
    if (desc->metallic_roughness_texture.id == 0)
        desc->metallic_roughness_texture = get_texture(textures, m, aiTextureType_UNKNOWN, false, NULL, NULL);
    desc->normal_scale = get_float(m, AI_MATKEY_GLTF_TEXTURE_SCALE(aiTextureType_NORMALS, 0), 1.0f);
    warn_ignored(m, name, aiTextureType_CLEARCOAT, "clearcoat");
    warn_ignored(m, name, aiTextureType_TRANSMISSION, "transmission or thickness");
    warn_ignored(m, name, aiTextureType_SHEEN, "sheen");
}

static void from_gltf(hydra_material_desc *desc, texture_cache *textures, const struct aiMaterial *m, const char *name,
                      const gltf_material *extras) {
    desc->kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
    for (int i = 0; i < 3; i++) desc->base_color[i] = 1.0f;
    gltf_factors(desc, m, name, extras);
    gltf_textures(desc, textures, m, name);
    if (get_int(m, AI_MATKEY_SHADING_MODEL, 0) == (int)aiShadingMode_Unlit) gltf_unlit(desc);
    if (extras->uv_mixed) app_warning("material %s: its textures use different uv sets or transforms; all follow the first", name);
}

/* ---------------------------------------------------------------- MTL, FBX, PLY and others */

/* Phong's exponent against the Beckmann and GGX width of the same lobe: alpha^2 = 2 / (n + 2) (Walter et al. 2007);
   roughness is the root of alpha. */
static float phong_roughness(float exponent) { return powf(2.0f / (fmaxf(exponent, 0.0f) + 2.0f), 0.25f); }

/* MTL's illumination models: 3, 5, 8 are mirrors, 4, 6, 7, 9 glass. */
static bool is_mirror(int illum) { return illum == 3 || illum == 5 || illum == 8; }
static bool is_glass(int illum) { return illum == 4 || illum == 6 || illum == 7 || illum == 9; }

static void legacy_glass(hydra_material_desc *desc, const struct aiMaterial *m, const char *name) {
    float ior = get_float(m, AI_MATKEY_REFRACTI, 1.5f);
    desc->kind = HYDRA_MATERIAL_DIELECTRIC;
    desc->ior = ior > 1.0001f && ior <= 10.0f ? ior : 1.5f;
    for (int i = 0; i < 3; i++) desc->base_color[i] = 1.0f;
    get_color(m, AI_MATKEY_COLOR_TRANSPARENT, desc->base_color);
    unit_color(name, "transmission filter", desc->base_color);
    desc->roughness = 0.0f;
}

/* Ks has no physical scale: 1 is taken as a reflectance of 8 % at normal incidence, as Burley's specular (2012). */
static void legacy_reflection(hydra_material_desc *desc, const struct aiMaterial *m, const char *name) {
    float specular[3] = {0.0f, 0.0f, 0.0f};
    int illum = get_int(m, "$mat.illum", 0, 0, 2);
    float exponent = get_float(m, AI_MATKEY_SHININESS, 0.0f);
    float metallic = get_float(m, AI_MATKEY_METALLIC_FACTOR, -1.0f);
    get_color(m, AI_MATKEY_COLOR_SPECULAR, specular);
    unit_color(name, "specular colour", specular);
    desc->roughness = unit(name, "roughness", get_float(m, AI_MATKEY_ROUGHNESS_FACTOR, phong_roughness(exponent)));
    if (is_glass(illum)) {
        legacy_glass(desc, m, name);
    } else if (metallic > 0.0f) {
        desc->kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
        desc->metallic = unit(name, "metallic", metallic);
    } else if (is_mirror(illum) && highest(specular) > 0.0f) {
        desc->kind = HYDRA_MATERIAL_CONDUCTOR;
        memcpy(desc->base_color, specular, sizeof specular);
        if (exponent == 0.0f) desc->roughness = 0.0f;
    } else if (illum >= 2 && exponent > 0.0f && highest(specular) > 0.001f) {
        float root = sqrtf(0.08f * highest(specular));
        desc->kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS;
        desc->ior = fmaxf((1.0f + root) / (1.0f - root), 1.0001f);
    }
}

static void legacy_alpha(hydra_material_desc *desc, texture_cache *textures, const struct aiMaterial *m, const char *name,
                         const char *color_name) {
    struct aiString mask;
    hydra_texture texture = get_texture(textures, m, aiTextureType_OPACITY, false, &mask, NULL);
    float opacity = unit(name, "opacity", get_float(m, AI_MATKEY_OPACITY, 1.0f));
    if (desc->kind == HYDRA_MATERIAL_DIELECTRIC || (texture.id == 0 && opacity >= 1.0f)) return;
    desc->alpha_mode = HYDRA_ALPHA_BLEND;
    desc->alpha = fmaxf(opacity, 1e-30f);
    /* A mask that is the colour picture itself means that picture's alpha. */
    if (texture.id != 0 && strcmp(mask.data, color_name) != 0) desc->alpha_texture = texture;
}

static void from_legacy(hydra_material_desc *desc, texture_cache *textures, const struct aiMaterial *m, const char *name,
                        unsigned *uv_set) {
    struct aiString color_name;
    color_name.data[0] = '\0';
    desc->kind = HYDRA_MATERIAL_LAMBERT;
    for (int i = 0; i < 3; i++) desc->base_color[i] = 0.8f;
    get_color(m, AI_MATKEY_COLOR_DIFFUSE, desc->base_color);
    unit_color(name, "diffuse colour", desc->base_color);
    desc->base_color_texture = get_texture(textures, m, aiTextureType_DIFFUSE, true, &color_name, uv_set);
    /* Exporters write black beside a texture, meaning the texture alone. */
    if (desc->base_color_texture.id != 0 && highest(desc->base_color) == 0.0f)
        for (int i = 0; i < 3; i++) desc->base_color[i] = 1.0f;
    legacy_reflection(desc, m, name);
    legacy_alpha(desc, textures, m, name, color_name.data);
    get_color(m, AI_MATKEY_COLOR_EMISSIVE, desc->emission);
    desc->emission_texture = get_texture(textures, m, aiTextureType_EMISSIVE, true, NULL, NULL);
    if (desc->emission_texture.id != 0 && highest(desc->emission) == 0.0f)
        for (int i = 0; i < 3; i++) desc->emission[i] = 1.0f;
    desc->emit_both_sides = true; /* these formats say nothing about sides */
    desc->normal_texture = get_texture(textures, m, aiTextureType_NORMALS, false, NULL, NULL);
    warn_ignored(m, name, aiTextureType_HEIGHT, "bump");
    warn_ignored(m, name, aiTextureType_SPECULAR, "specular");
}

material_entry materials_add(texture_cache *textures, const struct aiMaterial *source, bool is_gltf, const gltf_material *extras) {
    gltf_material none = gltf_material_default();
    if (extras == NULL) extras = &none;
    hydra_material_desc desc;
    material_entry entry;
    struct aiString buffer;
    unsigned uv_set = extras->uv_set;
    const char *name = get_name(source, &buffer);
    memset(&desc, 0, sizeof desc);
    if (is_gltf)
        from_gltf(&desc, textures, source, name, extras);
    else
        from_legacy(&desc, textures, source, name, &uv_set);
    entry.material = hydra_scene_add_material(textures->scene, &desc);
    entry.uv_set = uv_set;
    memcpy(entry.uv_transform, extras->uv_transform, sizeof entry.uv_transform);
    entry.emits = highest(desc.emission) > 0.0f;
    return entry;
}
