/* >>shared-texture: texels, wrapping, bilinear lookup in one mip level */
#ifndef HYK_TEXTURE_H
#define HYK_TEXTURE_H

#include "views.h"

HYK_STRUCT(hyk_rgba) {
    hyk_vec3 rgb;
    hyk_real a;
} HYK_END(hyk_rgba)

/* sRGB decoding, IEC 61966-2-1. */
HYK_FN hyk_real hyk_srgb_decode(hyk_real c) {
    return c <= HYK_C(0.04045) ? c * HYK_C(1.0 / 12.92) : hyk_pow((c + HYK_C(0.055)) * HYK_C(1.0 / 1.055), HYK_C(2.4));
}

HYK_FN hyk_uint hyk_wrap_texel(hyk_int i, hyk_uint size, hyk_uint mode) {
    hyk_int n = HYK_TO_INT(size);
    if (mode == HYK_WRAP_CLAMP) return HYK_TO_UINT(i < 0 ? 0 : (i >= n ? n - 1 : i));
    if (mode == HYK_WRAP_REPEAT) {
        hyk_int r = i % n;
        return HYK_TO_UINT(r < 0 ? r + n : r);
    }
    hyk_int period = 2 * n;
    hyk_int m = i % period;
    if (m < 0) m += period;
    return HYK_TO_UINT(m < n ? m : period - 1 - m);
}

HYK_FN hyk_rgba hyk_load_texel(hyk_view view, hyk_uint texture, hyk_uint format, hyk_uint at) {
    hyk_rgba r;
    if (format == HYK_TEXEL_RGBA32F) {
        r.rgb = hyk_make3(HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at))),
                          HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 1u))),
                          HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 2u))));
        r.a = HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 3u)));
        return r;
    }
    hyk_uint word = HYK_LOAD_TEXEL_WORD(view, texture, at);
    hyk_real unit = HYK_C(1.0 / 255.0);
    r.rgb = hyk_make3(HYK_TO_REAL(word & 255u) * unit, HYK_TO_REAL((word >> 8) & 255u) * unit, HYK_TO_REAL((word >> 16) & 255u) * unit);
    r.a = HYK_TO_REAL(word >> 24) * unit;
    if (format == HYK_TEXEL_RGBA8_SRGB)
        r.rgb = hyk_make3(hyk_srgb_decode(r.rgb.x), hyk_srgb_decode(r.rgb.y), hyk_srgb_decode(r.rgb.z));
    return r;
}

HYK_FN hyk_rgba hyk_lerp_rgba(hyk_rgba a, hyk_rgba b, hyk_real t) {
    hyk_rgba r;
    r.rgb = hyk_lerp3(a.rgb, b.rgb, t);
    r.a = hyk_lerp(a.a, b.a, t);
    return r;
}

/* uv brought near the origin first, so that its fraction keeps its bits and its floor fits an integer. */
HYK_FN hyk_real hyk_wrap_coordinate(hyk_real u, hyk_uint mode) {
    if (!hyk_is_finite(u)) return 0.0f;
    if (mode == HYK_WRAP_CLAMP) return hyk_clamp(u, -1.0f, 2.0f);
    return u - 2.0f * hyk_floor(u * 0.5f);
}

/* Bilinear lookup at uv in the level nearest to lod (log2 of the footprint in texels of level 0). */
HYK_CALLED hyk_rgba hyk_sample_texture(hyk_view view, hyk_uint texture, hyk_vec2 uv, hyk_real lod) {
    hyk_texture t = HYK_LOAD_TEXTURE(view, texture);
    hyk_uint level = HYK_TO_UINT(hyk_clamp(lod + 0.5f, 0.0f, HYK_TO_REAL(t.levels) - 0.5f));
    hyk_uint w = hyk_max_uint(t.width >> level, 1u), h = hyk_max_uint(t.height >> level, 1u);
    hyk_real x = hyk_wrap_coordinate(uv.x, t.wrap_u) * HYK_TO_REAL(w) - 0.5f;
    hyk_real y = hyk_wrap_coordinate(uv.y, t.wrap_v) * HYK_TO_REAL(h) - 0.5f;
    hyk_real fx = hyk_floor(x), fy = hyk_floor(y);
    hyk_uint x0 = hyk_wrap_texel(HYK_TO_INT(fx), w, t.wrap_u), x1 = hyk_wrap_texel(HYK_TO_INT(fx) + 1, w, t.wrap_u);
    hyk_uint y0 = hyk_wrap_texel(HYK_TO_INT(fy), h, t.wrap_v), y1 = hyk_wrap_texel(HYK_TO_INT(fy) + 1, h, t.wrap_v);
    hyk_uint base = t.level_offset[level];
    hyk_rgba top = hyk_lerp_rgba(hyk_load_texel(view, texture, t.format, base + y0 * w + x0),
                                 hyk_load_texel(view, texture, t.format, base + y0 * w + x1), x - fx);
    hyk_rgba bottom = hyk_lerp_rgba(hyk_load_texel(view, texture, t.format, base + y1 * w + x0),
                                    hyk_load_texel(view, texture, t.format, base + y1 * w + x1), x - fx);
    return hyk_lerp_rgba(top, bottom, y - fy);
}

#endif /* HYK_TEXTURE_H */
