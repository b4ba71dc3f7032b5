/* >>scene-materials: descriptors checked and turned into what kernels read */
#ifndef HYI_MATERIALS_H
#define HYI_MATERIALS_H

#include "scene.h"
#include "validate.h"

HYI_STATIC_ASSERT((int)HYK_MATERIAL_LAMBERT == (int)HYDRA_MATERIAL_LAMBERT && (int)HYK_MATERIAL_CONDUCTOR == (int)HYDRA_MATERIAL_CONDUCTOR &&
                  (int)HYK_MATERIAL_DIELECTRIC == (int)HYDRA_MATERIAL_DIELECTRIC &&
                  (int)HYK_MATERIAL_METALLIC_ROUGHNESS == (int)HYDRA_MATERIAL_METALLIC_ROUGHNESS);

HYI_FN hydra_result hyi_check_texture_handle(hydra_scene *scene, hydra_texture texture, const char *what) {
    if (texture.id > scene->texture_count) return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "%s: texture %u of %zu", what, texture.id, scene->texture_count);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_complex_ior(hydra_context *context, const hydra_material_desc *d) {
    if (hyi_all_zero(d->k, 3)) return HYDRA_OK;
    for (int i = 0; i < 3; i++) {
        HYI_TRY(hyi_check_range(context, d->eta[i], 1e-4f, 100.0f, HYDRA_ERROR_IOR, "material.eta"));
        HYI_TRY(hyi_check_range(context, d->k[i], 0.0f, 100.0f, HYDRA_ERROR_IOR, "material.k"));
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_material(hydra_scene *scene, const hydra_material_desc *d) {
    hydra_context *context = scene->context;
    const hydra_result share = HYDRA_ERROR_ROUGHNESS;
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_MATERIAL_METALLIC_ROUGHNESS + 1, "material.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->alpha_mode, HYDRA_ALPHA_BLEND + 1, "material.alpha_mode"));
    HYI_TRY(hyi_check_color(context, d->base_color, 1.0f, "material.base_color"));
    HYI_TRY(hyi_check_color(context, d->emission, FLT_MAX, "material.emission"));
    HYI_TRY(hyi_check_color(context, d->absorption, FLT_MAX, "material.absorption"));
    HYI_TRY(hyi_check_range(context, d->metallic, 0.0f, 1.0f, share, "material.metallic"));
    HYI_TRY(hyi_check_range(context, d->roughness, 0.0f, 1.0f, share, "material.roughness"));
    HYI_TRY(hyi_check_range(context, d->transmission, 0.0f, 1.0f, share, "material.transmission"));
    HYI_TRY(hyi_check_range(context, d->clearcoat, 0.0f, 1.0f, share, "material.clearcoat"));
    HYI_TRY(hyi_check_range(context, d->clearcoat_roughness, 0.0f, 1.0f, share, "material.clearcoat_roughness"));
    HYI_TRY(hyi_check_range(context, d->alpha, 0.0f, 1.0f, share, "material.alpha"));
    HYI_TRY(hyi_check_range(context, d->alpha_cutoff, 0.0f, 1.0f, share, "material.alpha_cutoff"));
    HYI_TRY(hyi_check_finite(context, &d->normal_scale, 1, "material.normal_scale"));
    HYI_TRY(hyi_check_finite(context, &d->ior, 1, "material.ior"));
    if (d->ior != 0.0f) HYI_TRY(hyi_check_range(context, d->ior, 1.0001f, 10.0f, HYDRA_ERROR_IOR, "material.ior"));
    HYI_TRY(hyi_check_complex_ior(context, d));
    HYI_TRY(hyi_check_texture_handle(scene, d->base_color_texture, "material.base_color_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->metallic_roughness_texture, "material.metallic_roughness_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->normal_texture, "material.normal_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->emission_texture, "material.emission_texture"));
    return hyi_check_texture_handle(scene, d->alpha_texture, "material.alpha_texture");
}

HYI_INLINE hyk_vec3 hyi_vec3(const float v[3]) { return hyk_make3(v[0], v[1], v[2]); }
HYI_INLINE uint32_t hyi_texture_slot_of(hydra_texture texture) { return texture.id ? texture.id - 1 : HYK_NONE; }

HYI_FN uint32_t hyi_material_flags(const hydra_material_desc *d) {
    uint32_t flags = 0;
    bool glass = d->kind == HYDRA_MATERIAL_DIELECTRIC || (d->kind == HYDRA_MATERIAL_METALLIC_ROUGHNESS && d->transmission > 0.0f);
    if (!hyi_all_zero(d->emission, 3)) flags |= HYK_MATERIAL_EMITS;
    if (d->emit_both_sides) flags |= HYK_MATERIAL_EMITS_BOTH_SIDES;
    if (d->thin && d->kind == HYDRA_MATERIAL_METALLIC_ROUGHNESS) flags |= HYK_MATERIAL_THIN;
    if (d->kind == HYDRA_MATERIAL_CONDUCTOR && !hyi_all_zero(d->k, 3)) flags |= HYK_MATERIAL_COMPLEX_IOR;
    if (d->alpha_mode == HYDRA_ALPHA_MASK) flags |= HYK_MATERIAL_ALPHA_MASK;
    if (d->alpha_mode == HYDRA_ALPHA_BLEND) flags |= HYK_MATERIAL_ALPHA_BLEND;
    if (glass) flags |= HYK_MATERIAL_TRANSMITS;
    if (glass && !(flags & HYK_MATERIAL_THIN) && !hyi_all_zero(d->absorption, 3)) flags |= HYK_MATERIAL_ABSORBS;
    return flags;
}

/* What a surface without a material is made of, and what a desc's zeros mean. */
HYI_FN hyk_material hyi_default_material(void) {
    hyk_material m;
    memset(&m, 0, sizeof m);
    m.base_color = hyk_splat(0.8f);
    m.ior = 1.5f;
    m.alpha = 1.0f;
    m.alpha_cutoff = 0.5f;
    m.normal_scale = 1.0f;
    m.energy_table = HYK_NONE;
    m.base_color_texture = m.metallic_roughness_texture = m.normal_texture = m.emission_texture = m.alpha_texture = HYK_NONE;
    return m;
}

HYI_FN hyk_material hyi_material_record(const hydra_material_desc *d) {
    hyk_material m = hyi_default_material();
    m.kind = (uint32_t)d->kind;
    m.flags = hyi_material_flags(d);
    m.base_color = hyi_vec3(d->base_color);
    m.emission = hyi_vec3(d->emission);
    m.absorption = hyi_vec3(d->absorption);
    m.eta = hyi_vec3(d->eta);
    m.k = hyi_vec3(d->k);
    m.metallic = d->metallic;
    m.roughness = d->roughness;
    m.transmission = d->transmission;
    if (d->ior != 0.0f) m.ior = d->ior;
    if (d->alpha != 0.0f) m.alpha = d->alpha;
    if (d->alpha_cutoff != 0.0f) m.alpha_cutoff = d->alpha_cutoff;
    if (d->normal_scale != 0.0f) m.normal_scale = d->normal_scale;
    m.clearcoat = d->clearcoat;
    m.clearcoat_roughness = d->clearcoat_roughness;
    m.base_color_texture = hyi_texture_slot_of(d->base_color_texture);
    m.metallic_roughness_texture = hyi_texture_slot_of(d->metallic_roughness_texture);
    m.normal_texture = hyi_texture_slot_of(d->normal_texture);
    m.emission_texture = hyi_texture_slot_of(d->emission_texture);
    m.alpha_texture = hyi_texture_slot_of(d->alpha_texture);
    return m;
}

/* Bits of hydra_feature that a material asks for. */
HYI_FN uint32_t hyi_material_needs(const hyk_material *m) {
    uint32_t needs = 0;
    bool alpha = (m->flags & (HYK_MATERIAL_ALPHA_MASK | HYK_MATERIAL_ALPHA_BLEND)) != 0;
    if (m->base_color_texture != HYK_NONE || m->metallic_roughness_texture != HYK_NONE || m->emission_texture != HYK_NONE)
        needs |= HYK_NEEDS_TEXTURES;
    if (m->normal_texture != HYK_NONE) needs |= HYK_NEEDS_TEXTURES | HYK_NEEDS_NORMAL_MAPS;
    if (alpha) needs |= HYK_NEEDS_ALPHA;
    if (alpha && m->alpha_texture != HYK_NONE) needs |= HYK_NEEDS_TEXTURES;
    if (m->kind != HYK_MATERIAL_LAMBERT) needs |= HYK_NEEDS_SPECULAR;
    if (m->flags & HYK_MATERIAL_TRANSMITS) needs |= HYK_NEEDS_TRANSMISSION;
    if (m->flags & HYK_MATERIAL_ABSORBS) needs |= HYK_NEEDS_ABSORPTION;
    return needs;
}

HYDRA_API hydra_material hydra_scene_add_material(hydra_scene *scene, const hydra_material_desc *desc) {
    hydra_material handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_material") != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_check_material(scene, desc)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->materials, &scene->material_capacity, scene->material_count + 1)) != HYDRA_OK) return handle;
    scene->materials[scene->material_count++] = hyi_material_record(desc);
    scene->dirty |= HYI_DIRTY_MATERIALS;
    handle.id = (uint32_t)scene->material_count;
    return handle;
}

HYDRA_API hydra_result hydra_scene_update_material(hydra_scene *scene, hydra_material material, const hydra_material_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_material"));
    if (material.id == 0 || material.id > scene->material_count)
        return hyi_reject(scene, hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "material %u of %zu", material.id, scene->material_count));
    HYI_TRY(hyi_reject(scene, hyi_check_material(scene, desc)));
    scene->materials[material.id - 1] = hyi_material_record(desc);
    scene->dirty |= HYI_DIRTY_MATERIALS;
    return HYDRA_OK;
}

#endif /* HYI_MATERIALS_H */
