/* >>shared-bsdf-lobes: values and densities of the lobes, for a pair of directions */
#ifndef HYK_BSDF_LOBES_H
#define HYK_BSDF_LOBES_H

#include "bsdf_layers.h"

/* f cos, split, and the density of hyk_bsdf_sample_direction; delta functions excluded. */
HYK_STRUCT(hyk_bsdf_value) {
    hyk_vec3 diffuse;
    hyk_real pdf;
    hyk_vec3 specular;
    hyk_real unused;
} HYK_END(hyk_bsdf_value)

/* Probabilities of the lobes. */
HYK_STRUCT(hyk_lobe_shares) {
    hyk_real coat;          /* rough coat */
    hyk_real facets;        /* visible normals of the base: reflection and transmission */
    hyk_real diffuse;       /* Lambert */
    hyk_real bounce;        /* lost by masking, reflected */
    hyk_real through;       /* lost by masking, transmitted */
    hyk_real mirror;        /* delta reflection of coat and base */
    hyk_real window;        /* delta transmission */
    hyk_real total;         /* before normalisation: about the albedo; 0: absorbs everything */
} HYK_END(hyk_lobe_shares)

HYK_FN hyk_bsdf_value hyk_no_value(void) {
    hyk_bsdf_value r;
    r.diffuse = hyk_zero3();
    r.pdf = 0.0f;
    r.specular = hyk_zero3();
    r.unused = 0.0f;
    return r;
}

/* Weight of the coat over what lies under it: seen from inside the glass it covers only the opaque bases. */
HYK_FN hyk_real hyk_coat_weight(hyk_bsdf bsdf) {
    return hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? bsdf.coat * (bsdf.metal + bsdf.plastic) : bsdf.coat;
}

/* Brightness of a metal's single scattering. */
HYK_FN hyk_real hyk_metal_back(hyk_bsdf bsdf, hyk_layers l) {
    hyk_real rest = hyk_max(l.pass - l.metal_lost - l.schlick, 0.0f);
    return l.schlick + hyk_max3(bsdf.f0) * rest;
}

HYK_FN hyk_lobe_shares hyk_shares_of_glass(hyk_bsdf bsdf, hyk_layers l, hyk_lobe_shares q) {
    hyk_real tint = hyk_max3(bsdf.base_color);
    hyk_bool sheet = hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    hyk_real back = sheet ? hyk_plastic_back(bsdf, l) : l.glass_back;
    hyk_real along = (sheet ? hyk_sheet_along(bsdf, l) : l.glass_along) * tint;
    if (hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) {
        q.mirror += bsdf.glass * back;
        q.window += bsdf.glass * along;
    } else
        q.facets += bsdf.glass * (back + along);
    hyk_real lost = sheet ? l.metal_lost : l.glass_lost;
    hyk_real split = sheet ? 1.0f - bsdf.plastic_bounce : bsdf.glass_split;
    q.bounce += bsdf.glass * lost * (1.0f - split);
    q.through += bsdf.glass * lost * split * tint;
    return q;
}

/* Chosen in proportion to the albedos of the lobes at wo. */
HYK_FN hyk_lobe_shares hyk_lobe_shares_of(hyk_bsdf bsdf, hyk_layers l, hyk_uint features) {
    hyk_lobe_shares q;
    hyk_real coat = (1.0f - l.pass) * (hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? bsdf.metal + bsdf.plastic : 1.0f);
    hyk_real opaque = bsdf.metal * hyk_metal_back(bsdf, l) + bsdf.plastic * hyk_plastic_back(bsdf, l);
    hyk_bool coat_smooth = hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH), base_smooth = hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH);
    q.coat = coat_smooth ? 0.0f : coat;
    q.mirror = (coat_smooth ? coat : 0.0f) + (base_smooth ? opaque : 0.0f);
    q.facets = base_smooth ? 0.0f : opaque;
    q.diffuse = bsdf.plastic * l.diffuse * hyk_max3(bsdf.base_color);
    q.bounce = l.metal_lost * (bsdf.metal * hyk_max3(bsdf.bounce) + bsdf.plastic * bsdf.plastic_bounce);
    q.through = 0.0f;
    q.window = 0.0f;
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) q = hyk_shares_of_glass(bsdf, l, q);
    q.total = q.coat + q.facets + q.diffuse + q.bounce + q.through + q.mirror + q.window;
    hyk_real scale = q.total > 0.0f ? 1.0f / q.total : 0.0f;
    q.coat *= scale;
    q.facets *= scale;
    q.diffuse *= scale;
    q.bounce *= scale;
    q.through *= scale;
    q.mirror *= scale;
    q.window *= scale;
    return q;
}

/* Probability that a visible facet at cos_h reflects, where some of the base is clear. */
HYK_FN hyk_real hyk_facet_reflects(hyk_bsdf bsdf, hyk_real cos_h, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return 1.0f;
    if (!(bsdf.glass > 0.0f) || hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return 1.0f;
    hyk_real f = hyk_fresnel_dielectric(cos_h, bsdf.glass_eta);
    hyk_real w = hyk_schlick_weight(cos_h);
    hyk_real back = bsdf.glass * f + bsdf.metal * hyk_lerp(hyk_max3(bsdf.f0), 1.0f, w);
    if (bsdf.plastic > 0.0f) back += bsdf.plastic * hyk_fresnel_dielectric(cos_h, bsdf.ior);
    hyk_real along = bsdf.glass * (1.0f - f) * hyk_max3(bsdf.base_color);
    return back + along > 0.0f ? back / (back + along) : 1.0f;
}

/* What facets at cos_h reflect, pass: of the pair through the coat. */
HYK_FN hyk_vec3 hyk_facet_color(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real pass, hyk_bool smooth_parts, hyk_uint features) {
    hyk_vec3 r = hyk_zero3();
    hyk_real grey = 0.0f;
    if (smooth_parts == hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH)) {
        if (bsdf.metal > 0.0f) r = hyk_scale(hyk_metal_fresnel(bsdf, cos_h), bsdf.metal * pass);
        if (bsdf.plastic > 0.0f) grey = bsdf.plastic * pass * hyk_fresnel_dielectric(cos_h, bsdf.ior);
    }
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f && smooth_parts == hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH))
        grey += bsdf.glass * hyk_glass_facet_reflects(view, bsdf, cos_h, pass);
    return hyk_add(r, hyk_splat(grey));
}

/* ---- reflection */

HYK_FN hyk_bsdf_value hyk_add_coat(hyk_bsdf_value r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_vec3 h, hyk_lobe_shares q) {
    hyk_real d = hyk_ggx_distribution(h, bsdf.coat_alpha);
    hyk_real f = hyk_coat_weight(bsdf) * hyk_fresnel_dielectric(hyk_dot(wo, h), HYK_COAT_IOR);
    r.specular = hyk_add(r.specular, hyk_splat(f * d * hyk_ggx_visibility(wo, wi, bsdf.coat_alpha)));
    r.pdf += q.coat * hyk_ggx_pdf_reflected(wo, d, bsdf.coat_alpha);
    return r;
}

/* The product lobes: Lambert base and further bounces. */
HYK_FN hyk_bsdf_value hyk_add_left_over(hyk_bsdf_value r, hyk_bsdf bsdf, hyk_real cos_i, hyk_layers o, hyk_layers i, hyk_lobe_shares q,
                                        hyk_uint features) {
    hyk_real diffuse = bsdf.plastic * o.diffuse * i.diffuse * bsdf.plastic_scale * cos_i;
    r.diffuse = hyk_scale(bsdf.base_color, diffuse);
    hyk_real lost = o.metal_lost * i.metal_lost * bsdf.metal_scale * cos_i;
    hyk_real grey = bsdf.plastic * bsdf.plastic_bounce * lost;
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) {
        if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) grey += bsdf.glass * bsdf.plastic_bounce * lost;
        else grey += bsdf.glass * bsdf.glass_reflect * o.glass_lost * i.glass_lost * cos_i;
    }
    r.specular = hyk_add(r.specular, hyk_add_scaled(hyk_splat(grey), bsdf.bounce, bsdf.metal * lost));
    r.pdf += q.diffuse * hyk_pdf_cosine_hemisphere(cos_i);
    if (q.bounce > 0.0f) r.pdf += q.bounce * hyk_lost_pdf(cos_i, bsdf.alpha);
    return r;
}

HYK_FN hyk_bsdf_value hyk_eval_reflected(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_value r = hyk_no_value();
    hyk_layers i = hyk_layers_at(view, bsdf, wi.z, features);
    hyk_vec3 h = hyk_half_reflected(wo, wi);
    if (q.facets > 0.0f) {
        hyk_real cos_h = hyk_dot(wo, h);
        hyk_real d = hyk_ggx_distribution(h, bsdf.alpha);
        hyk_vec3 color = hyk_facet_color(view, bsdf, cos_h, hyk_min(o.pass, i.pass), false, features);
        r.specular = hyk_scale(color, d * hyk_ggx_visibility(wo, wi, bsdf.alpha));
        r.pdf = q.facets * hyk_facet_reflects(bsdf, cos_h, features) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    }
    if (q.coat > 0.0f) r = hyk_add_coat(r, bsdf, wo, wi, h, q);
    return hyk_add_left_over(r, bsdf, wi.z, o, i, q, features);
}

/* ---- transmission */

/* A thin sheet: the reflection of the direction mirrored back through it (KHR_materials_transmission). */
HYK_FN hyk_bsdf_value hyk_eval_sheet(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_value r = hyk_no_value();
    hyk_vec3 mirrored = hyk_make3(wi.x, wi.y, -wi.z);
    hyk_layers i = hyk_layers_at(view, bsdf, mirrored.z, features);
    hyk_real value = (1.0f - bsdf.plastic_bounce) * o.metal_lost * i.metal_lost * bsdf.metal_scale * mirrored.z;
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) {
        hyk_vec3 h = hyk_half_reflected(wo, mirrored);
        hyk_real cos_h = hyk_dot(wo, h);
        hyk_real d = hyk_ggx_distribution(h, bsdf.alpha);
        hyk_real t = (1.0f - hyk_fresnel_dielectric(cos_h, bsdf.ior)) * hyk_min(o.pass, i.pass);
        value += t * d * hyk_ggx_visibility(wo, mirrored, bsdf.alpha);
        r.pdf = q.facets * (1.0f - hyk_facet_reflects(bsdf, cos_h, features)) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    }
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * value);
    if (q.through > 0.0f) r.pdf += q.through * hyk_lost_pdf(mirrored.z, bsdf.alpha);
    return r;
}

/* Walter et al. 2007, eq. 21, times cos wi; radiance comes in with (n_o / n_i)^2 = 1 / glass_eta^2. */
HYK_FN hyk_bsdf_value hyk_add_refracted(hyk_bsdf_value r, hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_lobe_shares q,
                                        hyk_uint features) {
    hyk_vec3 h = hyk_half_refracted(wo, wi, bsdf.glass_eta);
    hyk_real cos_h = hyk_dot(wo, h);
    hyk_real g = bsdf.glass_eta * -hyk_dot(wi, h); /* not from cos_h: the same from both sides, and near total reflection sharp */
    if (!(cos_h > 0.0f) || !(g > 0.0f)) return r;
    hyk_real d = hyk_ggx_distribution(h, bsdf.alpha) * hyk_refraction_jacobian(cos_h, g, bsdf.glass_eta);
    hyk_real cos_outside = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? -wi.z : wo.z;
    hyk_real t = hyk_glass_facet_passes(view, bsdf, cos_h, g, cos_outside) * d * hyk_ggx_visibility(wo, wi, bsdf.alpha);
    r.specular = hyk_add_scaled(r.specular, bsdf.base_color, bsdf.glass * t / (bsdf.glass_eta * bsdf.glass_eta));
    r.pdf += q.facets * (1.0f - hyk_facet_reflects(bsdf, cos_h, features)) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    return r;
}

HYK_FN hyk_bsdf_value hyk_eval_transmitted(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q,
                                           hyk_uint features) {
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) return hyk_eval_sheet(view, bsdf, wo, wi, o, q, features);
    hyk_bsdf_value r = hyk_no_value();
    if (hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return r;
    hyk_real lost = o.glass_lost * hyk_glass_lost_beyond(view, bsdf, -wi.z) * bsdf.glass_through;
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * lost * -wi.z);
    if (q.through > 0.0f) r.pdf = q.through * hyk_lost_pdf(wi.z, bsdf.alpha);
    return hyk_add_refracted(r, view, bsdf, wo, wi, q, features);
}

#endif /* HYK_BSDF_LOBES_H */
