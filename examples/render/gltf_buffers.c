/* gltf_buffers.c: see gltf_buffers.h. All offsets and lengths come from the file and are checked. */
#include "gltf_buffers.h"

#include "app.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const size_t file_limit = (size_t)1 << 31;

static uint32_t little_endian(const char *bytes) {
    const unsigned char *b = (const unsigned char *)bytes;
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

/* GLB 2.0: a 12-byte header, then chunks of length, type and data. */
static void split_glb(gltf_buffers *buffers, size_t size) {
    size_t at = 12;
    buffers->text_length = 0;
    while (size >= 8 && at <= size - 8) {
        size_t length = little_endian(buffers->file + at);
        const char *type = buffers->file + at + 4, *data = buffers->file + at + 8;
        if (length > size - at - 8) length = size - at - 8;
        if (memcmp(type, "JSON", 4) == 0 && buffers->text_length == 0) {
            buffers->text = data;
            buffers->text_length = length;
        }
        if (memcmp(type, "BIN", 4) == 0 && buffers->binary == NULL) {
            buffers->binary = data;
            buffers->binary_length = length;
        }
        at += 8 + length + (0u - length) % 4u;
    }
}

bool gltf_buffers_open(gltf_buffers *buffers, const char *path) {
    memset(buffers, 0, sizeof *buffers);
    size_t size = 0;
    buffers->path = path;
    buffers->file = app_read_file(path, file_limit, &size);
    if (buffers->file == NULL) return false;
    buffers->text = buffers->file;
    buffers->text_length = size;
    if (size >= 12 && memcmp(buffers->file, "glTF", 4) == 0) split_glb(buffers, size);
    return true;
}

void gltf_buffers_close(gltf_buffers *buffers) {
    free(buffers->file);
    memset(buffers, 0, sizeof *buffers);
}

/* ---------------------------------------------------------------- where the bytes of a buffer are */

static int base64_digit(char c) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *found = c != '\0' ? strchr(digits, c) : NULL;
    return found != NULL ? (int)(found - digits) : -1;
}

static char *decode_base64(const char *text, size_t length, size_t *size) {
    char *bytes = app_alloc(length / 4 * 3 + 3, 1);
    uint32_t bits = 0;
    int held = 0;
    *size = 0;
    for (size_t i = 0; i < length && base64_digit(text[i]) >= 0; i++) {
        bits = bits << 6 | (uint32_t)base64_digit(text[i]);
        held += 6;
        if (held < 8) continue;
        held -= 8;
        bytes[(*size)++] = (char)(unsigned char)(bits >> held & 255u);
    }
    return bytes;
}

static char *read_beside(const char *scene_path, const char *uri, size_t length, size_t *size) {
    const char *slash = strrchr(scene_path, '/');
    size_t directory = slash != NULL ? (size_t)(slash - scene_path) + 1 : 0;
    char *path = app_alloc(directory + length + 1, 1);
    memcpy(path, scene_path, directory);
    memcpy(path + directory, uri, length);
    path[directory + length] = '\0';
    char *bytes = app_read_file(path, file_limit, size);
    free(path);
    return bytes;
}

/* The caller frees *owned, which is NULL when the bytes lie in the GLB. */
static const char *buffer_bytes(const gltf_buffers *buffers, uint32_t buffer, size_t *size, char **owned) {
    uint32_t uri = json_get(buffers->json, buffer, "uri");
    *owned = NULL;
    *size = buffers->binary_length;
    if (uri == JSON_NONE) return buffers->binary;
    const json_value *text = &buffers->json->values[uri];
    if (text->kind != JSON_STRING) return NULL;
    const char *comma = text->length > 5 && memcmp(text->text, "data:", 5) == 0 ? memchr(text->text, ',', text->length) : NULL;
    if (comma != NULL)
        *owned = decode_base64(comma + 1, (size_t)(text->text + text->length - comma - 1), size);
    else
        *owned = read_beside(buffers->path, text->text, text->length, size);
    return *owned;
}

/* ---------------------------------------------------------------- accessors */

static float component_at(const char *bytes, int type) {
    const unsigned char *b = (const unsigned char *)bytes;
    float value;
    uint32_t word;
    switch (type) {
    case 5120: return fmaxf((float)(signed char)b[0] / 127.0f, -1.0f);
    case 5121: return (float)b[0] / 255.0f;
    case 5122: return fmaxf((float)(int16_t)(uint16_t)(b[0] | b[1] << 8) / 32767.0f, -1.0f);
    case 5123: return (float)(b[0] | b[1] << 8) / 65535.0f;
    default:
        word = little_endian(bytes);
        memcpy(&value, &word, sizeof value);
        return value;
    }
}

static size_t component_size(int type) {
    if (type == 5120 || type == 5121) return 1;
    if (type == 5122 || type == 5123) return 2;
    return type == 5126 ? 4 : 0;
}

static size_t size_in(const json_document *json, uint32_t object, const char *key) {
    double number = json_number(json, json_get(json, object, key), 0.0);
    return number > 0.0 && number < 4e9 ? (size_t)number : 0;
}

size_t gltf_buffers_floats(gltf_buffers *buffers, uint32_t accessor_number, size_t components, float **floats) {
    const json_document *json = buffers->json;
    *floats = NULL;
    double number = json_number(json, accessor_number, -1.0);
    if (!(number >= 0.0 && number < 1e9)) return 0;
    uint32_t accessor = json_at(json, json_get(json, 0, "accessors"), (size_t)number);
    uint32_t view = json_at(json, json_get(json, 0, "bufferViews"), size_in(json, accessor, "bufferView"));
    uint32_t buffer = json_at(json, json_get(json, 0, "buffers"), size_in(json, view, "buffer"));
    int type = (int)size_in(json, accessor, "componentType");
    size_t element = component_size(type) * components, count = size_in(json, accessor, "count");
    size_t stride = size_in(json, view, "byteStride"), offset = size_in(json, view, "byteOffset") + size_in(json, accessor, "byteOffset");
    size_t size;
    char *owned;
    const char *bytes = buffer != JSON_NONE ? buffer_bytes(buffers, buffer, &size, &owned) : NULL;
    if (bytes == NULL) return 0;
    if (stride == 0) stride = element;
    bool inside = element > 0 && count > 0 && offset <= size && element <= size - offset && count - 1 <= (size - offset - element) / stride;
    if (inside) *floats = app_alloc(count * components, sizeof(float));
    for (size_t i = 0; inside && i < count * components; i++) {
        size_t at = offset + i / components * stride + i % components * component_size(type);
        (*floats)[i] = component_at(bytes + at, type);
    }
    free(owned);
    return inside ? count : 0;
}
