/* textures.c: see textures.h. Decoding is stb_image's work. */
#include "textures.h"

#include "app.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <stb/stb_image.h>

static const size_t file_limit = (size_t)1 << 30;

typedef struct image {
    void *texels;
    int width, height;
    bool is_float;
} image;

/* ---------------------------------------------------------------- file names */

static int hex_digit(char c) {
    if (isdigit((unsigned char)c)) return c - '0';
    return isxdigit((unsigned char)c) ? tolower((unsigned char)c) - 'a' + 10 : -1;
}

/* Backslashes become slashes, %20 a space. */
static void clean_name(char *name) {
    char *out = name;
    for (char *in = name; *in != '\0'; in++) {
        if (in[0] == '%' && hex_digit(in[1]) >= 0 && hex_digit(in[2]) >= 0) {
            *out++ = (char)(16 * hex_digit(in[1]) + hex_digit(in[2]));
            in += 2;
        } else {
            *out++ = *in == '\\' ? '/' : *in;
        }
    }
    *out = '\0';
}

static char *beside_scene(const char *scene_path, const char *name) {
    const char *slash = strrchr(scene_path, '/');
    size_t directory = slash != NULL ? (size_t)(slash - scene_path) + 1 : 0;
    char *path = app_alloc(directory + strlen(name) + 1, 1);
    memcpy(path, scene_path, directory);
    strcpy(path + directory, name);
    return path;
}

/* As written; relative to the scene; the name cleaned; only its last part. NULL: nowhere. */
static char *find_file(const char *scene_path, const char *name) {
    char *cleaned = app_copy(name);
    clean_name(cleaned);
    const char *slash = strrchr(cleaned, '/');
    char *tries[4];
    tries[0] = beside_scene(scene_path, name);
    tries[1] = beside_scene(scene_path, cleaned);
    tries[2] = beside_scene(scene_path, slash != NULL ? slash + 1 : cleaned);
    tries[3] = app_copy(cleaned);
    char *found = NULL;
    for (int i = 0; i < 4; i++) {
        if (found == NULL && access(tries[i], R_OK) == 0)
            found = tries[i];
        else
            free(tries[i]);
    }
    free(cleaned);
    return found;
}

/* ---------------------------------------------------------------- decoding */

static bool decode(image *result, const void *bytes, size_t size) {
    int channels;
    if (size > INT32_MAX) return false;
    result->is_float = stbi_is_hdr_from_memory(bytes, (int)size) != 0;
    if (result->is_float)
        result->texels = stbi_loadf_from_memory(bytes, (int)size, &result->width, &result->height, &channels, 4);
    else
        result->texels = stbi_load_from_memory(bytes, (int)size, &result->width, &result->height, &channels, 4);
    return result->texels != NULL;
}

/* aiTexel is b, g, r, a. */
static bool copy_texels(image *result, const struct aiTexture *texture) {
    size_t count = (size_t)texture->mWidth * texture->mHeight;
    if (texture->mWidth > 65536 || texture->mHeight > 65536 || texture->pcData == NULL) return false;
    unsigned char *texels = app_alloc(count, 4);
    for (size_t i = 0; i < count; i++) {
        texels[4 * i] = texture->pcData[i].r;
        texels[4 * i + 1] = texture->pcData[i].g;
        texels[4 * i + 2] = texture->pcData[i].b;
        texels[4 * i + 3] = texture->pcData[i].a;
    }
    result->texels = texels;
    result->width = (int)texture->mWidth;
    result->height = (int)texture->mHeight;
    result->is_float = false;
    return true;
}

/* "*3" is the third embedded texture; FBX names its embedded ones as files. */
static const struct aiTexture *find_embedded(const struct aiScene *source, const char *name) {
    if (name[0] == '*') {
        char *end;
        unsigned long index = strtoul(name + 1, &end, 10);
        return end != name + 1 && index < source->mNumTextures ? source->mTextures[index] : NULL;
    }
    for (unsigned i = 0; i < source->mNumTextures; i++) {
        const struct aiTexture *texture = source->mTextures[i];
        if (texture->mFilename.length > 0 && strcmp(texture->mFilename.data, name) == 0) return texture;
    }
    return NULL;
}

static bool load_file(image *result, const texture_cache *cache, const char *name) {
    char *path = find_file(cache->scene_path, name);
    if (path == NULL) {
        app_warning("texture %s: not found near %s; its factor is used alone", name, cache->scene_path);
        return false;
    }
    size_t size;
    char *bytes = app_read_file(path, file_limit, &size);
    bool good = bytes != NULL && decode(result, bytes, size);
    if (bytes != NULL && !good) app_warning("texture %s: %s; its factor is used alone", path, size > 0 ? stbi_failure_reason() : "empty");
    free(bytes);
    free(path);
    return good;
}

static bool load(image *result, const texture_cache *cache, const char *name) {
    memset(result, 0, sizeof *result);
    const struct aiTexture *embedded = find_embedded(cache->source, name);
    if (embedded == NULL && name[0] != '*') return load_file(result, cache, name);
    bool good = false;
    if (embedded != NULL && embedded->pcData != NULL)
        good = embedded->mHeight == 0 ? decode(result, embedded->pcData, embedded->mWidth) : copy_texels(result, embedded);
    if (!good) app_warning("embedded texture %s of %s cannot be decoded; its factor is used alone", name, cache->scene_path);
    return good;
}

/* ---------------------------------------------------------------- the cache */

/* hydra blends between texels. Where the file wants squares, a small picture is repeated texel by texel up to this
   size, which leaves a narrow blend at the edges; a larger one looks the same either way. */
enum { SHARP_SIZE = 256 };

static int repeats_for(const image *picture) {
    int larger = picture->width > picture->height ? picture->width : picture->height;
    return larger < SHARP_SIZE ? SHARP_SIZE / larger : 1;
}

static void sharpen(image *picture) {
    int times = repeats_for(picture), width = picture->width * times, height = picture->height * times;
    if (times < 2) return;
    size_t texel = picture->is_float ? 16 : 4;
    unsigned char *larger = app_alloc((size_t)width * (size_t)height, texel);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            size_t from = (size_t)(y / times) * (size_t)picture->width + (size_t)(x / times), to = (size_t)y * (size_t)width + (size_t)x;
            memcpy(larger + to * texel, (unsigned char *)picture->texels + from * texel, texel);
        }
    stbi_image_free(picture->texels);
    picture->texels = larger;
    picture->width = width;
    picture->height = height;
}

static hydra_texture add(const texture_cache *cache, const texture_entry *entry) {
    hydra_texture none = {0};
    image picture;
    if (!load(&picture, cache, entry->name)) return none;
    if (entry->nearest) sharpen(&picture);
    hydra_texture_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.texels = picture.texels;
    desc.width = (uint32_t)picture.width;
    desc.height = (uint32_t)picture.height;
    desc.format = picture.is_float ? HYDRA_TEXEL_RGBA32F : entry->format;
    desc.wrap_u = entry->wrap_u;
    desc.wrap_v = entry->wrap_v;
    hydra_texture texture = hydra_scene_add_texture(cache->scene, &desc);
    stbi_image_free(picture.texels);
    return texture;
}

static bool is_same(const texture_entry *a, const texture_entry *b) {
    return a->format == b->format && a->wrap_u == b->wrap_u && a->wrap_v == b->wrap_v && a->nearest == b->nearest &&
           strcmp(a->name, b->name) == 0;
}

hydra_texture textures_get(texture_cache *cache, const char *name, const texture_use *use) {
    texture_entry entry;
    memset(&entry, 0, sizeof entry);
    entry.name = app_copy(name);
    entry.format = use->srgb ? HYDRA_TEXEL_RGBA8_SRGB : HYDRA_TEXEL_RGBA8_LINEAR;
    entry.wrap_u = use->wrap_u;
    entry.wrap_v = use->wrap_v;
    entry.nearest = use->nearest;
    for (size_t i = 0; i < cache->count; i++) {
        if (!is_same(&cache->entries[i], &entry)) continue;
        free(entry.name);
        return cache->entries[i].texture;
    }
    entry.texture = add(cache, &entry);
    cache->entries = app_realloc(cache->entries, cache->count + 1, sizeof entry);
    cache->entries[cache->count++] = entry;
    return entry.texture;
}

void textures_free(texture_cache *cache) {
    for (size_t i = 0; i < cache->count; i++) free(cache->entries[i].name);
    free(cache->entries);
    cache->entries = NULL;
    cache->count = 0;
}
