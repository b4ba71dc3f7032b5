/* materials.h: what assimp knows of a surface becomes a hydra material */
#ifndef MATERIALS_H
#define MATERIALS_H

#include "gltf_extras.h"
#include "textures.h"

/* A material in the scene, and how its meshes have to prepare their uv. */
typedef struct material_entry {
    hydra_material material;
    uint32_t uv_set;
    float uv_transform[6]; /* rows of a 2x3 matrix, for uv with (0, 0) at the top left */
    bool emits;
} material_entry;

/* extras: NULL unless the file is glTF and has this material. */
material_entry materials_add(texture_cache *textures, const struct aiMaterial *source, bool is_gltf, const gltf_material *extras);

#endif
