/* >>shared-alpha: which candidate hits stop a ray, decided inside the traversal */
#ifndef HYK_ALPHA_H
#define HYK_ALPHA_H

#include "sampler.h"
#include "texture.h"

HYK_FN hyk_uint hyk_material_of(hyk_view view, hyk_instance placed, hyk_uint primitive) {
    if (placed.material != HYK_NONE) return placed.material;
    hyk_mesh mesh = HYK_LOAD_MESH(view, placed.mesh);
    if ((mesh.flags & HYK_MESH_TRIANGLE_MATERIALS) != 0u) return HYK_LOAD_TRIANGLE_MATERIAL(view, placed.mesh, primitive);
    return mesh.material;
}

HYK_FN hyk_vec2 hyk_interpolate_uv(hyk_view view, hyk_uint mesh, hyk_uint primitive, hyk_real u, hyk_real v) {
    hyk_vec2 a = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * primitive));
    hyk_vec2 b = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * primitive + 1u));
    hyk_vec2 c = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * primitive + 2u));
    hyk_real w = 1.0f - u - v;
    return hyk_make2(w * a.x + u * b.x + v * c.x, w * a.y + u * b.y + v * c.y);
}

HYK_FN hyk_real hyk_alpha_at(hyk_view view, hyk_material material, hyk_vec2 uv) {
    if (material.alpha_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.alpha_texture, uv, 0.0f).rgb.x;
    if (material.base_color_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.base_color_texture, uv, 0.0f).a;
    return material.alpha;
}

/* A number in [0, 1) that depends on the ray and the triangle alone: the same answer in whatever order they meet. */
HYK_FN hyk_real hyk_alpha_threshold(hyk_ray ray, hyk_uint instance, hyk_uint primitive) {
    hyk_uint h = hyk_hash2(instance, primitive);
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.y)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.z)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.y)));
    return hyk_unit_real(hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.z))));
}

/* ray is in world space. */
HYK_FN hyk_bool hyk_hit_is_opaque(hyk_view view, hyk_uint instance, hyk_uint primitive, hyk_real u, hyk_real v, hyk_ray ray) {
    hyk_instance placed = HYK_LOAD_INSTANCE(view, instance);
    hyk_material material = HYK_LOAD_MATERIAL(view, hyk_material_of(view, placed, primitive));
    if ((material.flags & (HYK_MATERIAL_ALPHA_MASK | HYK_MATERIAL_ALPHA_BLEND)) == 0u) return true;
    hyk_vec2 uv = hyk_make2(0.0f, 0.0f);
    if ((HYK_LOAD_MESH(view, placed.mesh).flags & HYK_MESH_HAS_UVS) != 0u) uv = hyk_interpolate_uv(view, placed.mesh, primitive, u, v);
    hyk_real alpha = hyk_alpha_at(view, material, uv);
    if ((material.flags & HYK_MATERIAL_ALPHA_MASK) != 0u) return alpha >= material.alpha_cutoff;
    return hyk_alpha_threshold(ray, instance, primitive) < alpha;
}

#endif /* HYK_ALPHA_H */
