/* image_exr.c: writes all layers of a render into one OpenEXR file, with OpenEXR's core C library */
#include "image_io.h"

#include "app.h"

#include <openexr.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CHANNEL_NAME = 32 };

typedef struct exr_writer {
    exr_context_t file;
    int part;
    const image_target *target;
    const image_source *source;
    const image_layer *layers[IMAGE_LAYERS];
    void *pixels[IMAGE_LAYERS];
    size_t count;
} exr_writer;

/* OpenEXR tells its reasons through a callback; the user wants them with the file's name. */
static void report(exr_const_context_t file, exr_result_t code, const char *text) {
    const char *path = NULL;
    if (file != NULL) exr_get_file_name(file, &path);
    app_error("%s: %s", path != NULL ? path : "EXR file", text != NULL ? text : exr_get_default_error_message(code));
}

static void channel_name(char name[CHANNEL_NAME], const image_layer *layer, uint32_t component) {
    const char *prefix = layer->name, *dot = prefix[0] ? "." : "";
    if (layer->components > 1)
        snprintf(name, CHANNEL_NAME, "%s%s%c", prefix, dot, layer->channels[component]);
    else
        snprintf(name, CHANNEL_NAME, "%s%s%s", prefix, dot, layer->channels);
}

static bool collect_layers(exr_writer *writer) {
    bool alone = writer->target->layer != &image_layers[0];
    for (size_t i = 0; i < IMAGE_LAYERS; i++) {
        const image_layer *layer = &image_layers[i];
        bool wanted = alone ? layer == writer->target->layer : i == 0 || (writer->source->outputs >> layer->output & 1u);
        if (!wanted) continue;
        void *pixels = image_read_layer(writer->source, layer);
        if (pixels == NULL) return false;
        writer->layers[writer->count] = layer;
        writer->pixels[writer->count++] = pixels;
    }
    return true;
}

static exr_result_t add_channels(exr_writer *writer) {
    exr_result_t result = EXR_ERR_SUCCESS;
    for (size_t i = 0; i < writer->count; i++) {
        const image_layer *layer = writer->layers[i];
        for (uint32_t c = 0; c < layer->components && result == EXR_ERR_SUCCESS; c++) {
            char name[CHANNEL_NAME];
            channel_name(name, layer, c);
            result = exr_add_channel(writer->file, writer->part, name, layer->whole ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT,
                                     EXR_PERCEPTUALLY_LINEAR, 1, 1);
        }
    }
    return result;
}

static exr_result_t write_head(exr_writer *writer) {
    const image_source *source = writer->source;
    exr_result_t result = exr_add_part(writer->file, "hydra", EXR_STORAGE_SCANLINE, &writer->part);
    if (result == EXR_ERR_SUCCESS)
        result = exr_initialize_required_attr_simple(writer->file, writer->part, (int32_t)source->width, (int32_t)source->height,
                                                     EXR_COMPRESSION_ZIP);
    if (result == EXR_ERR_SUCCESS) result = add_channels(writer);
    if (result == EXR_ERR_SUCCESS) result = exr_attr_set_string(writer->file, writer->part, "comments", source->comment);
    if (result == EXR_ERR_SUCCESS) result = exr_write_header(writer->file);
    return result;
}

/* Points a channel of the chunk that starts at row y to its pixels. False: no layer has this name. */
static bool bind_channel(const exr_writer *writer, exr_coding_channel_info_t *channel, int32_t y) {
    for (size_t i = 0; i < writer->count; i++) {
        const image_layer *layer = writer->layers[i];
        for (uint32_t c = 0; c < layer->components; c++) {
            char name[CHANNEL_NAME];
            channel_name(name, layer, c);
            if (strcmp(name, channel->channel_name) != 0) continue;
            size_t pixel = 4 * (size_t)layer->components, row = pixel * writer->source->width;
            channel->user_pixel_stride = (int32_t)pixel;
            channel->user_line_stride = (int32_t)row;
            channel->user_bytes_per_element = 4;
            channel->user_data_type = (uint16_t)(layer->whole ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT);
            channel->encode_from_ptr = (const uint8_t *)writer->pixels[i] + (size_t)y * row + 4 * (size_t)c;
            return true;
        }
    }
    return false;
}

static exr_result_t write_chunk(exr_writer *writer, exr_encode_pipeline_t *encoder, int32_t y, bool first) {
    exr_chunk_info_t chunk;
    exr_result_t result = exr_write_scanline_chunk_info(writer->file, writer->part, y, &chunk);
    if (result == EXR_ERR_SUCCESS)
        result = first ? exr_encoding_initialize(writer->file, writer->part, &chunk, encoder)
                       : exr_encoding_update(writer->file, writer->part, &chunk, encoder);
    if (result != EXR_ERR_SUCCESS) return result;
    for (int16_t i = 0; i < encoder->channel_count; i++)
        if (!bind_channel(writer, &encoder->channels[i], y)) return EXR_ERR_INVALID_ARGUMENT;
    if (first) result = exr_encoding_choose_default_routines(writer->file, writer->part, encoder);
    if (result == EXR_ERR_SUCCESS) result = exr_encoding_run(writer->file, writer->part, encoder);
    return result;
}

static exr_result_t write_body(exr_writer *writer) {
    exr_encode_pipeline_t encoder;
    int32_t rows = 0, height = (int32_t)writer->source->height;
    memset(&encoder, 0, sizeof encoder);
    exr_result_t result = exr_get_scanlines_per_chunk(writer->file, writer->part, &rows);
    for (int32_t y = 0; y < height && result == EXR_ERR_SUCCESS; y += rows) result = write_chunk(writer, &encoder, y, y == 0);
    exr_encoding_destroy(writer->file, &encoder);
    return result;
}

static bool write_file(exr_writer *writer) {
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = report;
    exr_result_t result = exr_start_write(&writer->file, writer->target->path, EXR_INTERMEDIATE_TEMP_FILE, &setup);
    if (result != EXR_ERR_SUCCESS) return false;
    result = write_head(writer);
    if (result == EXR_ERR_SUCCESS) result = write_body(writer);
    exr_result_t closed = exr_finish(&writer->file);
    if (result == EXR_ERR_SUCCESS && closed == EXR_ERR_SUCCESS) return true;
    app_error("%s: could not be written: %s", writer->target->path,
              exr_get_default_error_message(result != EXR_ERR_SUCCESS ? result : closed));
    return false;
}

bool image_write_exr(const image_target *target, const image_source *source) {
    exr_writer writer;
    memset(&writer, 0, sizeof writer);
    writer.target = target;
    writer.source = source;
    bool good = collect_layers(&writer) && write_file(&writer);
    for (size_t i = 0; i < writer.count; i++) free(writer.pixels[i]);
    return good;
}
