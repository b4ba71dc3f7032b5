/* >>shared-emission: what a surface radiates at a texture coordinate */
#ifndef HYK_EMISSION_H
#define HYK_EMISSION_H

#include "alpha.h"

/* Radiance that leaves a side that emits; which sides do is for the caller to say. */
HYK_FN hyk_vec3 hyk_emission_at(hyk_view view, hyk_material material, hyk_vec2 uv, hyk_real lod, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_TEXTURES) || material.emission_texture == HYK_NONE) return material.emission;
    return hyk_mul(material.emission, hyk_sample_texture(view, material.emission_texture, uv, lod).rgb);
}

/* Emission of an emitting triangle at those weights, finest texture level; what alpha cuts out of it does not shine. */
HYK_FN hyk_vec3 hyk_triangle_emission(hyk_view view, hyk_uint instance, hyk_uint triangle, hyk_vec2 weights, hyk_uint features) {
    hyk_vec2 uv = hyk_triangle_uv(view, HYK_LOAD_INSTANCE(view, instance).mesh, triangle, weights);
    hyk_material material = HYK_LOAD_MATERIAL(view, hyk_triangle_material(view, instance, triangle));
    hyk_vec3 radiance = hyk_emission_at(view, material, uv, 0.0f, features);
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA) || !hyk_material_has_alpha(material)) return radiance;
    hyk_real alpha = hyk_alpha_at(view, material, uv);
    if ((material.flags & HYK_MATERIAL_ALPHA_MASK) != 0u) alpha = alpha >= material.alpha_cutoff ? 1.0f : 0.0f;
    return hyk_scale(radiance, hyk_saturate(alpha));
}

#endif /* HYK_EMISSION_H */
