/* >>shared-alpha: a triangle's material and uv, and which candidate hits stop a ray, decided inside the traversal */
#ifndef HYK_ALPHA_H
#define HYK_ALPHA_H

#include "sampler.h"
#include "texture.h"

/* Index of the material on a triangle of a placed mesh. */
HYK_FN hyk_uint hyk_triangle_material(hyk_view view, hyk_uint instance, hyk_uint triangle) {
    hyk_uint own = HYK_LOAD_INSTANCE(view, instance).material;
    if (own != HYK_NONE) return own;
    hyk_uint mesh = HYK_LOAD_INSTANCE(view, instance).mesh;
    hyk_mesh m = HYK_LOAD_MESH(view, mesh);
    if ((m.flags & HYK_MESH_TRIANGLE_MATERIALS) != 0u) return HYK_LOAD_TRIANGLE_MATERIAL(view, mesh, triangle);
    return m.material;
}

/* uv at the weights of vertex 1 and vertex 2; zero where the mesh has none. */
HYK_FN hyk_vec2 hyk_triangle_uv(hyk_view view, hyk_uint mesh, hyk_uint triangle, hyk_vec2 weights) {
    if ((HYK_LOAD_MESH(view, mesh).flags & HYK_MESH_HAS_UVS) == 0u) return hyk_make2(0.0f, 0.0f);
    hyk_vec2 a = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle));
    hyk_vec2 b = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle + 1u));
    hyk_vec2 c = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle + 2u));
    return hyk_make2(a.x + (b.x - a.x) * weights.x + (c.x - a.x) * weights.y,
                     a.y + (b.y - a.y) * weights.x + (c.y - a.y) * weights.y);
}

HYK_FN hyk_real hyk_alpha_at(hyk_view view, hyk_material material, hyk_vec2 uv) {
    if (material.alpha_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.alpha_texture, uv, 0.0f).rgb.x;
    if (material.base_color_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.base_color_texture, uv, 0.0f).a;
    return material.alpha;
}

/* A number in [0, 1) that depends on the ray and the triangle alone: the same answer in whatever order they meet. A ray
   exactly through a shared edge asks both triangles; a common number for a mesh would tie the layers of foliage together. */
HYK_FN hyk_real hyk_alpha_threshold(hyk_ray ray, hyk_uint instance, hyk_uint primitive) {
    hyk_uint h = hyk_hash2(instance, primitive);
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.y)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.z)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.t_max)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.y)));
    return hyk_unit_real(hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.z))));
}

/* Whether a surface of alpha there stops a ray that draws threshold. */
HYK_FN hyk_bool hyk_alpha_stops(hyk_material material, hyk_real alpha, hyk_real threshold) {
    if ((material.flags & HYK_MATERIAL_ALPHA_MASK) != 0u) return alpha >= material.alpha_cutoff;
    return threshold < alpha;
}

HYK_FN hyk_bool hyk_material_has_alpha(hyk_material material) {
    return (material.flags & (HYK_MATERIAL_ALPHA_MASK | HYK_MATERIAL_ALPHA_BLEND)) != 0u;
}

/* ray is in world space. */
HYK_FN hyk_bool hyk_hit_is_opaque(hyk_view view, hyk_uint instance, hyk_uint primitive, hyk_real u, hyk_real v, hyk_ray ray) {
    hyk_material material = HYK_LOAD_MATERIAL(view, hyk_triangle_material(view, instance, primitive));
    if (!hyk_material_has_alpha(material)) return true;
    hyk_vec2 uv = hyk_triangle_uv(view, HYK_LOAD_INSTANCE(view, instance).mesh, primitive, hyk_make2(u, v));
    return hyk_alpha_stops(material, hyk_alpha_at(view, material, uv), hyk_alpha_threshold(ray, instance, primitive));
}

#endif /* HYK_ALPHA_H */
