/* textures.h: finds, decodes and adds the textures of a scene file, each (file, encoding, wrap) once */
#ifndef TEXTURES_H
#define TEXTURES_H

#include "hydra.h"

#include <assimp/scene.h>

#include <stdbool.h>
#include <stddef.h>

typedef struct texture_entry {
    char *name;
    hydra_texel_format format;
    hydra_wrap wrap_u, wrap_v;
    bool nearest;
    hydra_texture texture; /* id 0: could not be had, and was complained about */
} texture_entry;

typedef struct texture_cache {
    hydra_scene *scene;
    const struct aiScene *source;
    const char *scene_path;
    texture_entry *entries;
    size_t count;
} texture_cache;

/* How a texture is to be read. srgb: colours; else data. nearest: texels are little squares, not blended. */
typedef struct texture_use {
    bool srgb, nearest;
    hydra_wrap wrap_u, wrap_v;
} texture_use;

/* A texture that cannot be had is id 0 after a warning. */
hydra_texture textures_get(texture_cache *cache, const char *name, const texture_use *use);
void textures_free(texture_cache *cache);

#endif
