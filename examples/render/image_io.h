/* image_io.h: pictures to write, and the environment picture to read */
#ifndef IMAGE_IO_H
#define IMAGE_IO_H

#include "hydra.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum image_curve { IMAGE_CURVE_NONE, IMAGE_CURVE_REINHARD, IMAGE_CURVE_ACES } image_curve;

/* How radiance becomes a PNG. */
typedef struct image_tone {
    float exposure; /* stops */
    image_curve curve;
} image_tone;

/* One kind of output: its name on the command line and in EXR channels. */
typedef struct image_layer {
    const char *name;     /* layer in an EXR; "" for radiance */
    const char *channels; /* one letter a float or uint, or a word for a single one */
    hydra_output output;
    uint32_t components;
    bool whole; /* uint32 */
    enum { IMAGE_LIGHT, IMAGE_REFLECTANCE, IMAGE_DIRECTION, IMAGE_NUMBER } meaning;
} image_layer;

enum { IMAGE_LAYERS = 17 };
extern const image_layer image_layers[IMAGE_LAYERS];

typedef enum image_format { IMAGE_PNG, IMAGE_EXR, IMAGE_PFM } image_format;

typedef struct image_target {
    const char *path;
    const image_layer *layer;
    image_format format;
} image_target;

/* Bits 1 << hydra_output of a name of the given length; 0: no such name. "all" is all of them. */
uint32_t image_layer_bits(const char *name, size_t length);
/* FILE or LAYER=FILE. False with a message. */
bool image_target_parse(image_target *target, const char *text);
uint32_t image_target_bits(const image_target *target);
/* Finds out, before any work, whether the file can be written; leaves nothing behind. False with a message. */
bool image_target_probe(const image_target *target);

typedef struct image_source {
    hydra_render *render;
    uint32_t width, height;
    uint32_t outputs; /* bits that the render has */
    image_tone tone;
    const char *comment; /* goes into the EXR's header */
} image_source;

/* False with a message. */
bool image_write(const image_target *target, const image_source *source);
/* The part of image_write for EXR. */
bool image_write_exr(const image_target *target, const image_source *source);
/* The layer as the render holds it; app_alloc memory. NULL with a message. */
void *image_read_layer(const image_source *source, const image_layer *layer);

#endif
