/* >>shared-surface: what stands at a hit: place and its error bound, normals, material with textures applied */
#ifndef HYK_SURFACE_H
#define HYK_SURFACE_H

#include "alpha.h"

HYK_STRUCT(hyk_surface) {
    hyk_vec3 position;
    hyk_real error;      /* the true point lies within error of position, measured along the normal */
    hyk_vec3 geometric;  /* unit normal of the face, towards the side the ray came from */
    hyk_real uv_scale;   /* uv units per metre, for mip selection */
    hyk_vec3 shading;    /* unit, the same side as geometric */
    hyk_uint material;
    hyk_vec2 uv;
    hyk_bool front;      /* the ray came from outside */
} HYK_END(hyk_surface)

/* Bound of n rounded operations (Higham 2002, section 3.1). */
HYK_FN hyk_real hyk_gamma(hyk_real n) { return n * HYK_REAL_EPSILON / (1.0f - n * HYK_REAL_EPSILON); }

HYK_FN hyk_vec3 hyk_transform_point(hyk_instance m, hyk_vec3 p) {
    return hyk_make3(hyk_dot(m.row0, p) + m.t0, hyk_dot(m.row1, p) + m.t1, hyk_dot(m.row2, p) + m.t2);
}
HYK_FN hyk_vec3 hyk_transform_vector(hyk_instance m, hyk_vec3 v) {
    return hyk_make3(hyk_dot(m.row0, v), hyk_dot(m.row1, v), hyk_dot(m.row2, v));
}
/* By the transpose of the inverse; not unit length. A mirrored instance keeps its outside outside. */
HYK_FN hyk_vec3 hyk_transform_normal(hyk_instance m, hyk_vec3 n) {
    return hyk_add(hyk_scale(m.inverse0, n.x), hyk_add(hyk_scale(m.inverse1, n.y), hyk_scale(m.inverse2, n.z)));
}

/* Error of a point that went through the instance's transform and whose ray will come back through the inverse: both
   roundings, carried to world space (Pharr, Jakob, Humphreys 2023, section 6.8.1, with the way back added). */
HYK_FN hyk_vec3 hyk_transformed_error(hyk_instance m, hyk_vec3 p, hyk_vec3 world, hyk_vec3 error) {
    hyk_vec3 a = hyk_abs3(p), w = hyk_abs3(world);
    hyk_real g = hyk_gamma(4.0f);
    hyk_vec3 back = hyk_make3(hyk_dot(hyk_abs3(m.inverse0), w) + hyk_abs(m.s0), hyk_dot(hyk_abs3(m.inverse1), w) + hyk_abs(m.s1),
                              hyk_dot(hyk_abs3(m.inverse2), w) + hyk_abs(m.s2));
    hyk_vec3 local = hyk_add(error, hyk_scale(back, g));
    return hyk_make3(hyk_dot(hyk_abs3(m.row0), local) + g * (hyk_dot(hyk_abs3(m.row0), a) + hyk_abs(m.t0)),
                     hyk_dot(hyk_abs3(m.row1), local) + g * (hyk_dot(hyk_abs3(m.row1), a) + hyk_abs(m.t1)),
                     hyk_dot(hyk_abs3(m.row2), local) + g * (hyk_dot(hyk_abs3(m.row2), a) + hyk_abs(m.t2)));
}

/* The start of a ray leaving p to the side of the unit normal n: moved by the error bound, and by one rounding more, so
   that it is never on the wrong side of its own surface. */
HYK_FN hyk_vec3 hyk_offset_point(hyk_vec3 p, hyk_vec3 n, hyk_real error) {
    hyk_real rounding = 2.0f * HYK_REAL_EPSILON * (hyk_abs(n.x * p.x) + hyk_abs(n.y * p.y) + hyk_abs(n.z * p.z));
    return hyk_add_scaled(p, n, 2.0f * (error + rounding));
}

/* Unit normal of a triangle from two edges of any length. */
HYK_FN hyk_vec3 hyk_face_normal(hyk_vec3 e1, hyk_vec3 e2) { return hyk_normalize(hyk_cross(hyk_normalize(e1), hyk_normalize(e2))); }

/* A shading normal that the viewer sees from above: bent towards him where interpolation turned it away. */
HYK_FN hyk_vec3 hyk_visible_normal(hyk_vec3 shading, hyk_vec3 to_viewer) {
    hyk_real c = hyk_dot(shading, to_viewer);
    if (c > HYK_C(0.01)) return shading;
    return hyk_normalize(hyk_add_scaled(shading, to_viewer, HYK_C(0.01) - c));
}

HYK_FN hyk_vec3 hyk_smooth_normal(hyk_view view, hyk_instance placed, hyk_vec3 weights, hyk_uint i0, hyk_uint i1, hyk_uint i2) {
    hyk_vec3 n = hyk_scale(hyk_load_normal(view, placed.mesh, i0), weights.x);
    n = hyk_add_scaled(n, hyk_load_normal(view, placed.mesh, i1), weights.y);
    n = hyk_add_scaled(n, hyk_load_normal(view, placed.mesh, i2), weights.z);
    return hyk_normalize(hyk_transform_normal(placed, n));
}

/* Tangent-space normal map over the smooth normal: tangent from the uv gradient, made orthogonal to it. */
HYK_FN hyk_vec3 hyk_mapped_normal(hyk_view view, hyk_material material, hyk_vec2 uv, hyk_real lod, hyk_vec3 shading, hyk_vec3 tangent,
                                  hyk_real handedness) {
    hyk_vec3 t = hyk_normalize(hyk_add_scaled(tangent, shading, -hyk_dot(tangent, shading)));
    if (hyk_length_squared(t) < 0.5f) return shading;
    hyk_vec3 b = hyk_scale(hyk_cross(shading, t), handedness);
    hyk_vec3 m = hyk_sample_texture(view, material.normal_texture, uv, lod).rgb;
    hyk_real x = (2.0f * m.x - 1.0f) * material.normal_scale, y = (2.0f * m.y - 1.0f) * material.normal_scale;
    hyk_real z = 2.0f * m.z - 1.0f;
    if (z <= 0.0f) return shading;
    return hyk_normalize(hyk_add(hyk_scale(t, x), hyk_add(hyk_scale(b, y), hyk_scale(shading, z))));
}

/* log2 of a texture's footprint in texels, for a footprint of width metres. */
HYK_FN hyk_real hyk_texture_lod(hyk_view view, hyk_uint texture, hyk_real width, hyk_real uv_scale) {
    hyk_texture t = HYK_LOAD_TEXTURE(view, texture);
    hyk_real texels = width * uv_scale * hyk_sqrt(HYK_TO_REAL(t.width) * HYK_TO_REAL(t.height));
    return texels > 1.0f ? hyk_log2(texels) : 0.0f;
}

/* The corners of a hit triangle in object space, and what follows from them. */
HYK_STRUCT(hyk_corners) {
    hyk_vec3 weights;    /* barycentric, of the hit */
    hyk_uint i0;
    hyk_vec3 edge1, edge2;
    hyk_vec3 position;
    hyk_uint i1;
    hyk_vec3 error;      /* per component */
    hyk_uint i2;
} HYK_END(hyk_corners)

HYK_FN hyk_corners hyk_load_corners(hyk_view view, hyk_uint mesh, hyk_hit hit) {
    hyk_corners t;
    t.i0 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive);
    t.i1 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive + 1u);
    t.i2 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive + 2u);
    hyk_vec3 a = hyk_load_position(view, mesh, t.i0);
    hyk_vec3 b = hyk_load_position(view, mesh, t.i1);
    hyk_vec3 c = hyk_load_position(view, mesh, t.i2);
    t.weights = hyk_make3(1.0f - hit.u - hit.v, hit.u, hit.v);
    hyk_vec3 wa = hyk_scale(a, t.weights.x), wb = hyk_scale(b, t.weights.y), wc = hyk_scale(c, t.weights.z);
    t.position = hyk_add(wa, hyk_add(wb, wc));
    t.error = hyk_scale(hyk_add(hyk_abs3(wa), hyk_add(hyk_abs3(wb), hyk_abs3(wc))), hyk_gamma(8.0f));
    t.edge1 = hyk_sub(b, a);
    t.edge2 = hyk_sub(c, a);
    return t;
}

/* uv and uv_scale of s, and the normal map over its smooth normal; edges in world space. */
HYK_FN hyk_surface hyk_add_texture_space(hyk_view view, hyk_surface s, hyk_uint mesh, hyk_corners t, hyk_vec3 e1, hyk_vec3 e2,
                                         hyk_real width, hyk_uint features) {
    hyk_vec2 a = hyk_load_uv(view, mesh, t.i0), b = hyk_load_uv(view, mesh, t.i1), c = hyk_load_uv(view, mesh, t.i2);
    s.uv = hyk_make2(t.weights.x * a.x + t.weights.y * b.x + t.weights.z * c.x, t.weights.x * a.y + t.weights.y * b.y + t.weights.z * c.y);
    hyk_real du1 = b.x - a.x, dv1 = b.y - a.y, du2 = c.x - a.x, dv2 = c.y - a.y;
    hyk_real determinant = du1 * dv2 - du2 * dv1;
    hyk_real length1 = hyk_length(e1);
    hyk_real height = length1 > 0.0f ? hyk_length(hyk_cross(hyk_scale(e1, 1.0f / length1), e2)) : 0.0f;
    if (height > 0.0f) s.uv_scale = hyk_sqrt(hyk_abs(determinant) / height / length1);
    if (!HYK_HAS(features, HYK_NEEDS_NORMAL_MAPS) || determinant == 0.0f) return s;
    hyk_material material = HYK_LOAD_MATERIAL(view, s.material);
    if (material.normal_texture == HYK_NONE) return s;
    hyk_real sign = determinant > 0.0f ? 1.0f : -1.0f;
    hyk_vec3 tangent = hyk_normalize(hyk_scale(hyk_sub(hyk_scale(e1, dv2), hyk_scale(e2, dv1)), sign));
    hyk_real lod = hyk_texture_lod(view, material.normal_texture, width, s.uv_scale);
    /* v grows downwards in the image, but the map's green points up: hence the minus */
    s.shading = hyk_mapped_normal(view, material, s.uv, lod, s.shading, tangent, -sign);
    return s;
}

/* The surface at a triangle hit; direction is the ray's, width the diameter of its cone there (0: finest mip level). */
HYK_FN hyk_surface hyk_surface_at(hyk_view view, hyk_hit hit, hyk_vec3 direction, hyk_real width, hyk_uint features) {
    hyk_instance placed = HYK_LOAD_INSTANCE(view, hit.instance);
    hyk_uint mesh_flags = HYK_LOAD_MESH(view, placed.mesh).flags;
    hyk_corners t = hyk_load_corners(view, placed.mesh, hit);
    hyk_vec3 e1 = t.edge1, e2 = t.edge2, error = t.error;
    hyk_surface s;
    s.position = t.position;
    s.geometric = hyk_face_normal(e1, e2);
    if (HYK_HAS(features, HYK_NEEDS_INSTANCES) && (placed.flags & HYK_INSTANCE_IDENTITY) == 0u) {
        s.position = hyk_transform_point(placed, t.position);
        error = hyk_transformed_error(placed, t.position, s.position, error);
        s.geometric = hyk_normalize(hyk_transform_normal(placed, s.geometric));
        e1 = hyk_transform_vector(placed, e1);
        e2 = hyk_transform_vector(placed, e2);
    }
    s.error = hyk_dot(hyk_abs3(s.geometric), error);
    s.front = hyk_dot(s.geometric, direction) < 0.0f;
    s.shading = s.geometric;
    s.uv = hyk_make2(0.0f, 0.0f);
    s.uv_scale = 0.0f;
    s.material = hyk_triangle_material(view, hit.instance, hit.primitive);
    if (HYK_HAS(features, HYK_NEEDS_SMOOTH_NORMALS) && (mesh_flags & HYK_MESH_HAS_NORMALS) != 0u) {
        hyk_vec3 smooth_normal = hyk_smooth_normal(view, placed, t.weights, t.i0, t.i1, t.i2);
        if (hyk_length_squared(smooth_normal) > 0.5f)
            s.shading = hyk_scale(smooth_normal, hyk_dot(smooth_normal, s.geometric) < 0.0f ? -1.0f : 1.0f);
    }
    if (HYK_HAS(features, HYK_NEEDS_TEXTURES) && (mesh_flags & HYK_MESH_HAS_UVS) != 0u)
        s = hyk_add_texture_space(view, s, placed.mesh, t, e1, e2, width, features);
    if (!s.front) {
        s.geometric = hyk_neg(s.geometric);
        s.shading = hyk_neg(s.shading);
    }
    s.shading = hyk_visible_normal(s.shading, hyk_neg(direction));
    return s;
}

/* The surface's material with its textures multiplied in. */
HYK_FN hyk_material hyk_material_at(hyk_view view, hyk_surface s, hyk_real width, hyk_uint features) {
    hyk_material m = HYK_LOAD_MATERIAL(view, s.material);
    if (!HYK_HAS(features, HYK_NEEDS_TEXTURES)) return m;
    if (m.base_color_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.base_color_texture, width, s.uv_scale);
        hyk_vec3 texel = hyk_sample_texture(view, m.base_color_texture, s.uv, lod).rgb;
        m.base_color = hyk_mul(m.base_color, hyk_make3(hyk_min(texel.x, 1.0f), hyk_min(texel.y, 1.0f), hyk_min(texel.z, 1.0f)));
    }
    if (m.metallic_roughness_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.metallic_roughness_texture, width, s.uv_scale);
        hyk_rgba texel = hyk_sample_texture(view, m.metallic_roughness_texture, s.uv, lod);
        m.roughness = hyk_saturate(m.roughness * texel.rgb.y);
        m.metallic = hyk_saturate(m.metallic * texel.rgb.z);
    }
    if (m.emission_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.emission_texture, width, s.uv_scale);
        m.emission = hyk_mul(m.emission, hyk_sample_texture(view, m.emission_texture, s.uv, lod).rgb);
    }
    return m;
}

#endif /* HYK_SURFACE_H */
