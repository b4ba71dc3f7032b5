/* gltf_buffers.h: the JSON text and the float accessors of a glTF or GLB file */
#ifndef GLTF_BUFFERS_H
#define GLTF_BUFFERS_H

#include "json.h"

#include <stdbool.h>
#include <stddef.h>

typedef struct gltf_buffers {
    const char *path;
    char *file;       /* the whole file */
    const char *text; /* its JSON */
    size_t text_length;
    const char *binary; /* the GLB's binary chunk, or NULL */
    size_t binary_length;
    const json_document *json; /* of text; set by the caller */
} gltf_buffers;

/* False with a message when the file cannot be read. */
bool gltf_buffers_open(gltf_buffers *buffers, const char *path);
void gltf_buffers_close(gltf_buffers *buffers);

/* The elements of an accessor as floats, components each, in app_alloc memory. Returns their number; 0, and NULL in
   *floats, when there is none or it reaches outside its buffer. Normalised integers become -1..1 or 0..1. */
size_t gltf_buffers_floats(gltf_buffers *buffers, uint32_t accessor_number, size_t components, float **floats);

#endif
