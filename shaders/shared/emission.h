/* >>shared-emission: what a surface radiates at a texture coordinate */
#ifndef HYK_EMISSION_H
#define HYK_EMISSION_H

#include "texture.h"

/* Radiance that leaves a side that emits; which sides do is for the caller to say. */
HYK_FN hyk_vec3 hyk_emission_at(hyk_view view, hyk_material material, hyk_vec2 uv, hyk_real lod, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_TEXTURES) || material.emission_texture == HYK_NONE) return material.emission;
    return hyk_mul(material.emission, hyk_sample_texture(view, material.emission_texture, uv, lod).rgb);
}

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

/* Emission of an emitting triangle at those weights, finest texture level. */
HYK_FN hyk_vec3 hyk_triangle_emission(hyk_view view, hyk_uint instance, hyk_uint triangle, hyk_vec2 weights, hyk_uint features) {
    hyk_vec2 uv = hyk_triangle_uv(view, HYK_LOAD_INSTANCE(view, instance).mesh, triangle, weights);
    return hyk_emission_at(view, HYK_LOAD_MATERIAL(view, hyk_triangle_material(view, instance, triangle)), uv, 0.0f, features);
}

#endif /* HYK_EMISSION_H */
