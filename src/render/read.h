/* >>render-read: outputs, pixel by pixel */
#ifndef HYI_READ_H
#define HYI_READ_H

#include "statistics.h"

HYDRA_API size_t hydra_output_size(hydra_output output) {
    if ((int)output < 0 || output >= HYDRA_OUTPUT_COUNT) return 0;
    return output <= HYDRA_POSITION ? 12 : 4;
}

HYI_FN bool hyi_output_is_there(const hydra_render *r, hydra_output output) {
    return output == HYDRA_RADIANCE || output == HYDRA_ERROR || output == HYDRA_SAMPLES || output == HYDRA_VALIDITY || hyi_wants(&r->desc, output);
}

/* Factor from the radiance of a point's white surface to what the lightmap means. */
HYI_FN float hyi_lightmap_factor(const hydra_render *r, int channel) {
    const hydra_sensor_desc *s = &r->desc.sensor;
    if (s->kind != HYDRA_SENSOR_POINTS || s->lightmap == HYDRA_LIGHTMAP_RADIANCE) return 1.0f;
    return (float)HYI_PI * (s->lightmap == HYDRA_LIGHTMAP_RADIOSITY ? s->lightmap_albedo[channel] : 1.0f);
}

HYI_FN void hyi_read_pair(const hydra_render *r, hyi_plane plane, size_t index, const hyi_tile *tile, double mean[3]) {
    double half[2][3], n = (double)tile->reported[hyi_group_of(index)];
    for (int h = 0; h < 2; h++) hyi_sum3_value(&r->film.planes[plane][2 * index + (size_t)h], half[h]);
    for (int c = 0; c < 3; c++) mean[c] = n > 0.0 ? (half[0][c] + half[1][c]) / n : 0.0;
}

HYI_FN void hyi_read_mean(const hydra_render *r, hyi_plane plane, size_t index, double count, double mean[3]) {
    hyi_sum3_value(&r->film.planes[plane][index], mean);
    for (int c = 0; c < 3; c++) mean[c] = count > 0.0 ? mean[c] / count : 0.0;
}

HYI_FN void hyi_read_color(const hydra_render *r, hydra_output output, size_t index, float out[3]) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    double mean[3], hits = (double)r->film.pixels[index].hits, taken = (double)tile->taken;
    bool lightmap = true; /* whether the value is light at a point's surface */
    switch (output) {
        case HYDRA_DIRECT: hyi_read_pair(r, HYI_PLANE_DIRECT, index, tile, mean); break;
        case HYDRA_INDIRECT: hyi_read_pair(r, HYI_PLANE_INDIRECT, index, tile, mean); break;
        case HYDRA_CAUSTIC: hyi_read_pair(r, HYI_PLANE_CAUSTIC, index, tile, mean); break;
        case HYDRA_ALBEDO: hyi_read_mean(r, HYI_PLANE_ALBEDO, index, taken, mean), lightmap = false; break;
        case HYDRA_NORMAL: hyi_read_mean(r, HYI_PLANE_NORMAL, index, taken, mean), lightmap = false; break;
        case HYDRA_POSITION: hyi_read_mean(r, HYI_PLANE_POSITION, index, hits, mean), lightmap = false; break;
        case HYDRA_IRRADIANCE:
            lightmap = false;
            if (r->desc.sensor.kind != HYDRA_SENSOR_POINTS) {
                hyi_read_pair(r, HYI_PLANE_IRRADIANCE, index, tile, mean);
                break;
            }
            hyi_pixel_mean(&r->film, tile, index, mean);
            for (int c = 0; c < 3; c++) mean[c] *= HYI_PI;
            break;
        default: hyi_pixel_mean(&r->film, tile, index, mean); break;
    }
    for (int c = 0; c < 3; c++) out[c] = (float)mean[c] * (lightmap ? hyi_lightmap_factor(r, c) : 1.0f);
}

HYI_FN uint32_t hyi_read_validity(const hydra_render *r, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    uint32_t bits = 0;
    if (tile->reported[hyi_group_of(index)]) bits |= HYDRA_VALID_SAMPLED;
    if (tile->closed >> hyi_group_of(index) & 1u) bits |= HYDRA_VALID_CONVERGED;
    if (hyi_is_heavy(&r->film, index)) bits |= HYDRA_VALID_HEAVY_TAIL;
    if (r->film.pixels[index].dropped) bits |= HYDRA_VALID_DROPPED;
    if (r->desc.sensor.kind == HYDRA_SENSOR_POINTS) {
        double met[3];
        hyi_sum3_value(&r->film.planes[HYI_PLANE_DEPTH][index], met);
        if (tile->taken && met[1] > 0.5 * (double)tile->taken) bits |= HYDRA_VALID_INSIDE;
    }
    return bits;
}

HYI_FN float hyi_read_scalar(const hydra_render *r, hydra_output output, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    double hits = (double)r->film.pixels[index].hits, depth[3];
    if (output == HYDRA_COVERAGE) return tile->taken ? (float)(hits / (double)tile->taken) : 0.0f;
    hyi_sum3_value(&r->film.planes[HYI_PLANE_DEPTH][index], depth);
    return hits > 0.0 ? (float)(depth[0] / hits) : HUGE_VALF;
}

HYI_FN uint32_t hyi_read_word(const hydra_render *r, hydra_output output, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    switch (output) {
        case HYDRA_PRIMITIVE_ID: return r->film.ids[index].primitive;
        case HYDRA_INSTANCE_ID: return r->film.ids[index].instance;
        case HYDRA_MESH_ID: return r->film.ids[index].mesh;
        case HYDRA_MATERIAL_ID: return r->film.ids[index].material;
        case HYDRA_SAMPLES: return tile->reported[hyi_group_of(index)];
        default: return hyi_read_validity(r, index);
    }
}

HYI_FN void hyi_read_pixel(const hydra_render *r, hydra_output output, size_t index, void *out) {
    if (output <= HYDRA_POSITION) {
        float color[3];
        hyi_read_color(r, output, index, color);
        memcpy(out, color, sizeof color);
    } else if (output == HYDRA_DEPTH || output == HYDRA_COVERAGE) {
        float scalar = hyi_read_scalar(r, output, index);
        memcpy(out, &scalar, sizeof scalar);
    } else {
        uint32_t word = hyi_read_word(r, output, index);
        memcpy(out, &word, sizeof word);
    }
}

typedef struct hyi_error_reader {
    const hydra_render *render;
    char *out;
    size_t stride;
} hyi_error_reader;

HYI_FN void hyi_read_block_errors(void *argument, const hyi_film *film, const hyi_block *block) {
    const hyi_error_reader *to = (const hyi_error_reader *)argument;
    for (uint32_t i = 0; i < block->count; i++) {
        float error[3];
        hyi_pixel_error(film, block, i, error);
        for (int c = 0; c < 3; c++) error[c] *= hyi_lightmap_factor(to->render, c);
        size_t x = block->left - film->left + i % block->columns, y = block->top - film->top + i / block->columns;
        memcpy(to->out + y * to->stride + x * sizeof error, error, sizeof error);
    }
}

HYDRA_API hydra_result hydra_render_read(hydra_render *render, hydra_output output, void *pixels, size_t row_stride) {
    if (!render) return HYDRA_ERROR_NULL;
    const hyi_film *film = &render->film;
    size_t size = hydra_output_size(output), row = size * (film->right - film->left);
    if (!size) return hyi_fail(render->context, HYDRA_ERROR_ENUM, "output %d", (int)output);
    if (!pixels) return hyi_fail(render->context, HYDRA_ERROR_NULL, "pixels");
    if (!hyi_output_is_there(render, output)) return hyi_fail(render->context, HYDRA_ERROR_OUTPUT, "output %d", (int)output);
    if (row_stride && row_stride < row) return hyi_fail(render->context, HYDRA_ERROR_STRIDE, "row_stride is %zu, a row has %zu bytes", row_stride, row);
    size_t stride = row_stride ? row_stride : row;
    HYI_TRY(hyi_sync_film(render, false));
    if (output == HYDRA_ERROR) {
        hyi_error_reader reader = { render, (char *)pixels, stride };
        hyi_each_block(film, hyi_read_block_errors, &reader);
        return HYDRA_OK;
    }
    for (uint32_t y = film->top; y < film->bottom; y++)
        for (uint32_t x = film->left; x < film->right; x++)
            hyi_read_pixel(render, output, hyi_pixel_index(film, x, y), (char *)pixels + (y - film->top) * stride + size * (x - film->left));
    return HYDRA_OK;
}

#endif /* HYI_READ_H */
