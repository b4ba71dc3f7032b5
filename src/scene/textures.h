/* >>scene-textures: copies of texels and their mip pyramids */
#ifndef HYI_TEXTURES_H
#define HYI_TEXTURES_H

#include "../../shaders/shared/texture.h"
#include "scene.h"
#include "validate.h"

HYI_STATIC_ASSERT((int)HYK_TEXEL_RGBA8_SRGB == (int)HYDRA_TEXEL_RGBA8_SRGB && (int)HYK_TEXEL_RGBA8_LINEAR == (int)HYDRA_TEXEL_RGBA8_LINEAR &&
                  (int)HYK_TEXEL_RGBA32F == (int)HYDRA_TEXEL_RGBA32F);
HYI_STATIC_ASSERT((int)HYK_WRAP_REPEAT == (int)HYDRA_WRAP_REPEAT && (int)HYK_WRAP_CLAMP == (int)HYDRA_WRAP_CLAMP &&
                  (int)HYK_WRAP_MIRROR == (int)HYDRA_WRAP_MIRROR);

HYI_FN uint32_t hyi_texel_words(uint32_t format) { return format == HYK_TEXEL_RGBA32F ? 4 : 1; }

HYI_FN hydra_result hyi_check_texture(hydra_context *context, const hydra_texture_desc *desc) {
    if (!desc->texels) return hyi_fail(context, HYDRA_ERROR_NULL, "texture.texels");
    HYI_TRY(hyi_check_enum(context, (int)desc->format, HYDRA_TEXEL_RGBA32F + 1, "texture.format"));
    HYI_TRY(hyi_check_enum(context, (int)desc->wrap_u, HYDRA_WRAP_MIRROR + 1, "texture.wrap_u"));
    HYI_TRY(hyi_check_enum(context, (int)desc->wrap_v, HYDRA_WRAP_MIRROR + 1, "texture.wrap_v"));
    if (desc->width == 0 || desc->height == 0 || desc->width > 65536 || desc->height > 65536)
        return hyi_fail(context, HYDRA_ERROR_TEXTURE, "%u x %u texels", desc->width, desc->height);
    size_t row = (size_t)desc->width * 4 * hyi_texel_words((uint32_t)desc->format);
    if (desc->row_stride && desc->row_stride < row) return hyi_fail(context, HYDRA_ERROR_STRIDE, "texture.row_stride is %zu, a row has %zu bytes", desc->row_stride, row);
    return HYDRA_OK;
}

/* Level sizes and offsets; returns the number of texels of all levels, 0 when they cannot be numbered in 32 bits. */
HYI_FN size_t hyi_plan_levels(hyk_texture *t, bool mipmaps) {
    uint64_t texels = 0;
    uint32_t w = t->width, h = t->height;
    for (t->levels = 0; t->levels < HYK_TEXTURE_LEVELS; t->levels++) {
        t->level_offset[t->levels] = (uint32_t)texels;
        texels += (uint64_t)w * h;
        if ((w == 1 && h == 1) || !mipmaps) {
            t->levels++;
            break;
        }
        w = w > 1 ? w / 2 : 1;
        h = h > 1 ? h / 2 : 1;
    }
    return texels * hyi_texel_words(t->format) > UINT32_MAX ? 0 : (size_t)texels;
}

HYI_FN float hyi_srgb_encode(float c) { return c <= 0.0031308f ? 12.92f * c : 1.055f * powf(c, 1.0f / 2.4f) - 0.055f; }

HYI_FN uint32_t hyi_pack_texel(hyk_rgba c, uint32_t format) {
    float channel[4] = { c.rgb.x, c.rgb.y, c.rgb.z, c.a };
    uint32_t word = 0;
    for (int i = 0; i < 4; i++) {
        float x = i < 3 && format == HYK_TEXEL_RGBA8_SRGB ? hyi_srgb_encode(channel[i]) : channel[i];
        word |= (uint32_t)(x * 255.0f + 0.5f) << (8 * i);
    }
    return word;
}

HYI_FN void hyi_store_texel(uint32_t *texels, uint32_t format, size_t at, hyk_rgba c) {
    if (format != HYK_TEXEL_RGBA32F) {
        texels[at] = hyi_pack_texel(c, format);
        return;
    }
    float channel[4] = { c.rgb.x, c.rgb.y, c.rgb.z, c.a };
    memcpy(texels + 4 * at, channel, sizeof channel);
}

/* One texel of a level: the mean, in linear light, of the box it covers in the level above; boxes of odd sizes overlap
   none and lose none: the last takes what is left. */
HYI_FN hyk_rgba hyi_box_texel(const hyi_texture_slot *slot, uint32_t level, uint32_t x, uint32_t y) {
    const hyk_texture *t = &slot->record;
    hyk_scene_view view;
    memset(&view, 0, sizeof view);
    const uint32_t *texels = slot->texels;
    view.texels = &texels;
    uint32_t w = t->width >> (level - 1), h = t->height >> (level - 1);
    w = w ? w : 1;
    h = h ? h : 1;
    uint32_t nw = w > 1 ? w / 2 : 1, nh = h > 1 ? h / 2 : 1;
    uint32_t x0 = w > 1 ? 2 * x : 0, y0 = h > 1 ? 2 * y : 0;
    uint32_t x1 = x + 1 == nw ? w : x0 + 2, y1 = y + 1 == nh ? h : y0 + 2;
    double sum[4] = { 0, 0, 0, 0 };
    for (uint32_t j = y0; j < y1; j++)
        for (uint32_t i = x0; i < x1; i++) {
            hyk_rgba c = hyk_load_texel(&view, 0, t->format, t->level_offset[level - 1] + j * w + i);
            sum[0] += (double)c.rgb.x;
            sum[1] += (double)c.rgb.y;
            sum[2] += (double)c.rgb.z;
            sum[3] += (double)c.a;
        }
    double scale = 1.0 / ((double)(x1 - x0) * (double)(y1 - y0));
    hyk_rgba mean;
    mean.rgb = hyk_make3((float)(sum[0] * scale), (float)(sum[1] * scale), (float)(sum[2] * scale));
    mean.a = (float)(sum[3] * scale);
    return mean;
}

HYI_FN void hyi_build_level(hyi_texture_slot *slot, uint32_t level) {
    uint32_t w = slot->record.width >> level, h = slot->record.height >> level;
    w = w ? w : 1;
    h = h ? h : 1;
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++)
            hyi_store_texel(slot->texels, slot->record.format, slot->record.level_offset[level] + (size_t)y * w + x, hyi_box_texel(slot, level, x, y));
}

HYI_FN void hyi_texture_mean(hyi_texture_slot *slot) {
    hyk_scene_view view;
    memset(&view, 0, sizeof view);
    const uint32_t *texels = slot->texels;
    view.texels = &texels;
    double sum[4] = { 0, 0, 0, 0 };
    uint32_t count = slot->record.width * slot->record.height;
    for (uint32_t i = 0; i < count; i++) {
        hyk_rgba c = hyk_load_texel(&view, 0, slot->record.format, i);
        sum[0] += (double)c.rgb.x;
        sum[1] += (double)c.rgb.y;
        sum[2] += (double)c.rgb.z;
        sum[3] += (double)c.a;
    }
    for (int i = 0; i < 4; i++) slot->mean[i] = (float)(sum[i] / (double)count);
}

/* Copies the rows into level 0. */
HYI_FN hydra_result hyi_copy_texels(hydra_context *context, hyi_texture_slot *slot, const hydra_texture_desc *desc) {
    size_t row = (size_t)desc->width * 4 * hyi_texel_words(slot->record.format);
    size_t stride = desc->row_stride ? desc->row_stride : row;
    for (uint32_t y = 0; y < desc->height; y++) memcpy((char *)slot->texels + y * row, (const char *)desc->texels + y * stride, row);
    if (slot->record.format != HYK_TEXEL_RGBA32F) return HYDRA_OK;
    for (size_t i = 0; i < (size_t)desc->width * desc->height * 4; i++) {
        float value;
        memcpy(&value, slot->texels + i, sizeof value);
        if (!hyi_is_finite(value)) return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "texel %zu of the texture", i / 4);
        if (value < 0.0f) return hyi_fail(context, HYDRA_ERROR_COLOR, "texel %zu of the texture has a channel of %g", i / 4, (double)value);
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_texture(hydra_context *context, const hydra_texture_desc *desc, hyi_texture_slot *slot) {
    memset(slot, 0, sizeof *slot);
    HYI_TRY(hyi_check_texture(context, desc));
    hyk_texture *t = &slot->record;
    t->width = desc->width;
    t->height = desc->height;
    t->format = (uint32_t)desc->format;
    t->wrap_u = (uint32_t)desc->wrap_u;
    t->wrap_v = (uint32_t)desc->wrap_v;
    size_t texels = hyi_plan_levels(t, !desc->no_mipmaps);
    if (!texels) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u x %u texels", desc->width, desc->height);
    slot->words = texels * hyi_texel_words(t->format);
    HYI_TRY(hyi_alloc_array(context, &slot->texels, slot->words));
    hydra_result result = hyi_copy_texels(context, slot, desc);
    if (result != HYDRA_OK) {
        hyi_free_array(context, &slot->texels, slot->words);
        return result;
    }
    for (uint32_t level = 1; level < t->levels; level++) hyi_build_level(slot, level);
    hyi_texture_mean(slot);
    return HYDRA_OK;
}

HYDRA_API hydra_texture hydra_scene_add_texture(hydra_scene *scene, const hydra_texture_desc *desc) {
    hydra_texture handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_texture") != HYDRA_OK) return handle;
    hyi_texture_slot slot;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->textures, &scene->texture_capacity, scene->texture_count + 1)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_make_texture(scene->context, desc, &slot)) != HYDRA_OK) return handle;
    scene->textures[scene->texture_count++] = slot;
    scene->dirty |= HYI_DIRTY_MATERIALS;
    handle.id = (uint32_t)scene->texture_count;
    return handle;
}

#endif /* HYI_TEXTURES_H */
