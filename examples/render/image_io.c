/* image_io.c: the layers, tone mapping, PNG and PFM */
#include "image_io.h"

#include "app.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include <stb/stb_image_write.h>

const image_layer image_layers[IMAGE_LAYERS] = {
    {"", "RGB", HYDRA_RADIANCE, 3, false, IMAGE_LIGHT},
    {"error", "RGB", HYDRA_ERROR, 3, false, IMAGE_LIGHT},
    {"direct", "RGB", HYDRA_DIRECT, 3, false, IMAGE_LIGHT},
    {"indirect", "RGB", HYDRA_INDIRECT, 3, false, IMAGE_LIGHT},
    {"caustic", "RGB", HYDRA_CAUSTIC, 3, false, IMAGE_LIGHT},
    {"irradiance", "RGB", HYDRA_IRRADIANCE, 3, false, IMAGE_LIGHT},
    {"albedo", "RGB", HYDRA_ALBEDO, 3, false, IMAGE_REFLECTANCE},
    {"normal", "XYZ", HYDRA_NORMAL, 3, false, IMAGE_DIRECTION},
    {"position", "XYZ", HYDRA_POSITION, 3, false, IMAGE_NUMBER},
    {"depth", "Z", HYDRA_DEPTH, 1, false, IMAGE_NUMBER},
    {"coverage", "A", HYDRA_COVERAGE, 1, false, IMAGE_REFLECTANCE},
    {"primitive", "id", HYDRA_PRIMITIVE_ID, 1, true, IMAGE_NUMBER},
    {"instance", "id", HYDRA_INSTANCE_ID, 1, true, IMAGE_NUMBER},
    {"mesh", "id", HYDRA_MESH_ID, 1, true, IMAGE_NUMBER},
    {"material", "id", HYDRA_MATERIAL_ID, 1, true, IMAGE_NUMBER},
    {"samples", "count", HYDRA_SAMPLES, 1, true, IMAGE_NUMBER},
    {"validity", "bits", HYDRA_VALIDITY, 1, true, IMAGE_NUMBER},
};

static const image_layer *find_layer(const char *name, size_t length) {
    for (size_t i = 0; i < IMAGE_LAYERS; i++) {
        const char *known = i > 0 ? image_layers[i].name : "radiance";
        if (strlen(known) == length && strncmp(known, name, length) == 0) return &image_layers[i];
    }
    return NULL;
}

uint32_t image_layer_bits(const char *name, size_t length) {
    const image_layer *layer = find_layer(name, length);
    if (layer != NULL) return 1u << layer->output;
    if (length == 3 && strncmp(name, "all", 3) == 0) return (1u << HYDRA_OUTPUT_COUNT) - 1u;
    return 0;
}

uint32_t image_target_bits(const image_target *target) { return 1u << target->layer->output; }

static bool check_fit(const image_target *target) {
    const image_layer *layer = target->layer;
    if (target->format == IMAGE_PNG && layer->meaning == IMAGE_NUMBER) {
        app_error("%s: %s has no look of its own: write it to .exr%s", target->path, layer->name, layer->whole ? "" : " or .pfm");
        return false;
    }
    if (target->format == IMAGE_PFM && layer->whole) {
        app_error("%s: PFM holds no whole numbers: write %s to .exr", target->path, layer->name);
        return false;
    }
    return true;
}

bool image_target_parse(image_target *target, const char *text) {
    static const char *const extensions[] = {".png", ".exr", ".pfm"};
    size_t prefix = strcspn(text, "=");
    target->path = text;
    target->layer = &image_layers[0];
    if (text[prefix] == '=' && find_layer(text, prefix) != NULL) {
        target->layer = find_layer(text, prefix);
        target->path = text + prefix + 1;
    }
    const char *dot = strrchr(target->path, '.');
    for (int i = 0; i < 3; i++) {
        if (dot == NULL || strcasecmp(dot, extensions[i]) != 0) continue;
        target->format = (image_format)i;
        return check_fit(target);
    }
    app_error("-o %s: the name must end in .png, .exr or .pfm", text);
    return false;
}

bool image_target_probe(const image_target *target) {
    bool existed = access(target->path, F_OK) == 0;
    int file = open(target->path, O_WRONLY | O_CREAT, 0666);
    if (file < 0) {
        app_error("%s: cannot be written: %s", target->path, strerror(errno));
        return false;
    }
    close(file);
    if (!existed) unlink(target->path);
    return true;
}

void *image_read_layer(const image_source *source, const image_layer *layer) {
    void *pixels = app_alloc((size_t)source->width * source->height, 4 * (size_t)layer->components);
    hydra_result result = hydra_render_read(source->render, layer->output, pixels, 0);
    if (result == HYDRA_OK) return pixels;
    app_error("%s: %s", layer->name[0] ? layer->name : "radiance", hydra_result_text(result));
    free(pixels);
    return NULL;
}

/* The curve that S. Narkowicz fitted to the ACES filmic tone scale ("ACES Filmic Tone Mapping Curve", 2016). */
static float aces(float x) { return x * (2.51f * x + 0.03f) / (x * (2.43f * x + 0.59f) + 0.14f); }

static void tone_map(float rgb[3], const image_tone *tone) {
    float scale = exp2f(tone->exposure);
    for (int i = 0; i < 3; i++) rgb[i] = fminf(rgb[i] * scale, 1e6f);
    if (tone->curve == IMAGE_CURVE_ACES)
        for (int i = 0; i < 3; i++) rgb[i] = aces(0.6f * rgb[i]);
    if (tone->curve == IMAGE_CURVE_REINHARD) { /* Reinhard et al. 2002, on luminance: keeps the hue */
        float luminance = 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
        for (int i = 0; i < 3; i++) rgb[i] /= 1.0f + luminance;
    }
}

static uint8_t to_byte(float value, bool encode) {
    float clamped = fminf(fmaxf(value, 0.0f), 1.0f);
    if (encode) clamped = clamped <= 0.0031308f ? 12.92f * clamped : 1.055f * powf(clamped, 1.0f / 2.4f) - 0.055f;
    return (uint8_t)(255.0f * clamped + 0.5f);
}

static void png_pixel(uint8_t *bytes, const float *value, const image_layer *layer, const image_tone *tone) {
    float rgb[3];
    for (uint32_t i = 0; i < 3; i++) rgb[i] = value[i < layer->components ? i : 0];
    if (layer->meaning == IMAGE_LIGHT) tone_map(rgb, tone);
    for (int i = 0; i < 3; i++) {
        if (layer->meaning == IMAGE_DIRECTION) rgb[i] = 0.5f + 0.5f * rgb[i];
        bytes[i] = to_byte(rgb[i], layer->meaning != IMAGE_DIRECTION);
    }
}

static void write_bytes(void *file, void *bytes, int count) { fwrite(bytes, 1, (size_t)count, file); }

static bool write_png(FILE *file, const float *pixels, const image_target *target, const image_source *source) {
    size_t count = (size_t)source->width * source->height;
    uint8_t *bytes = app_alloc(count, 3);
    for (size_t i = 0; i < count; i++) png_pixel(bytes + 3 * i, pixels + target->layer->components * i, target->layer, &source->tone);
    int written = stbi_write_png_to_func(write_bytes, file, (int)source->width, (int)source->height, 3, bytes, 0);
    free(bytes);
    return written != 0;
}

/* PFM rows go from the bottom up; the sign of the scale tells the byte order. */
static bool write_pfm(FILE *file, const float *pixels, const image_target *target, const image_source *source) {
    const uint16_t one = 1;
    bool little = *(const uint8_t *)&one == 1;
    size_t row = (size_t)source->width * target->layer->components;
    fprintf(file, "%s\n%u %u\n%s\n", target->layer->components == 3 ? "PF" : "Pf", (unsigned)source->width, (unsigned)source->height,
            little ? "-1.0" : "1.0");
    for (uint32_t y = source->height; y-- > 0;)
        if (fwrite(pixels + y * row, sizeof(float), row, file) != row) return false;
    return true;
}

static bool write_simple(const image_target *target, const image_source *source, const float *pixels) {
    FILE *file = fopen(target->path, "wb");
    bool good = file != NULL;
    if (good && target->format == IMAGE_PNG) good = write_png(file, pixels, target, source);
    if (good && target->format == IMAGE_PFM) good = write_pfm(file, pixels, target, source);
    if (file != NULL) good = !ferror(file) && good;
    if (file != NULL) good = fclose(file) == 0 && good;
    if (!good) app_error("%s: could not be written: %s", target->path, strerror(errno));
    return good;
}

bool image_write(const image_target *target, const image_source *source) {
    if (target->format == IMAGE_EXR) return image_write_exr(target, source);
    float *pixels = image_read_layer(source, target->layer);
    bool good = pixels != NULL && write_simple(target, source, pixels);
    free(pixels);
    return good;
}
