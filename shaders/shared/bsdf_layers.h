/* >>shared-bsdf-layers: what a surface point is made of, and how much each part takes of the light

   Every material is a mixture of three bases under one coat:
     metal    a GGX conductor,
     plastic  a GGX dielectric over a Lambert base,
     glass    a GGX dielectric that light passes: refracting, or a thin sheet that it crosses straight.
   Single scattering loses light to masking, the coat takes some; what is left over goes into lobes of the form
   a(wo) a(wi) / (pi mean(a)), whose albedo is a(wo): reciprocal, and exactly lossless for white inputs
   (Kulla & Conty 2017, "Revisiting physically based shading at Imageworks"). Under a coat that passes t(cos),
   single scattering is weighted by min(t(wo), t(wi)), so that what is left over is never negative. */
#ifndef HYK_BSDF_LAYERS_H
#define HYK_BSDF_LAYERS_H

#include "energy.h"

#define HYK_COAT_IOR 1.5f

#define HYK_BSDF_LAMBERT 0x1u      /* Lambert alone */
#define HYK_BSDF_COMPLEX 0x2u      /* metal with eta and k */
#define HYK_BSDF_THIN 0x4u
#define HYK_BSDF_SMOOTH 0x8u       /* the base is a mirror */
#define HYK_BSDF_GLASS_SMOOTH 0x10u
#define HYK_BSDF_COAT_SMOOTH 0x20u
#define HYK_BSDF_INSIDE 0x40u      /* wo is inside the glass */

HYK_STRUCT(hyk_bsdf) {
    hyk_vec3 base_color;     /* also the tint of what passes */
    hyk_real alpha;
    hyk_vec3 f0;             /* metal: Schlick's, for COMPLEX the one with the same mean */
    hyk_real metal;          /* shares of the bases; their sum is 1 */
    hyk_vec3 eta;
    hyk_real plastic;
    hyk_vec3 k;
    hyk_real glass;
    hyk_vec3 bounce;         /* albedo of the metal's further bounces */
    hyk_real plastic_bounce; /* the same of the dielectric */
    hyk_real ior;
    hyk_real glass_eta;      /* index beyond the surface over the one before it */
    hyk_real coat, coat_alpha;
    hyk_real metal_scale, plastic_scale; /* 1 / (pi mean) of the lobes of what is left over */
    hyk_real glass_reflect, glass_through, glass_split;
    hyk_uint flags;
    hyk_uint at_metal, at_plastic, at_near, at_far, at_coat; /* planes, 0: none */
    hyk_energy_rows rows;
} HYK_END(hyk_bsdf)

HYK_FN hyk_bool hyk_bsdf_is(hyk_bsdf bsdf, hyk_uint flag) { return (bsdf.flags & flag) != 0u; }

/* ---- coat */

HYK_FN hyk_real hyk_coat_reflectance(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    hyk_real smooth_value = hyk_fresnel_dielectric(cos_theta, HYK_COAT_IOR);
    if (bsdf.at_coat == 0u || hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH)) return smooth_value;
    hyk_real more = hyk_energy_in_row(view, bsdf.at_coat, hyk_energy_column(cos_theta, bsdf.coat_alpha));
    return hyk_saturate(smooth_value + more);
}
/* Share of light that passes the coat. */
HYK_FN hyk_real hyk_coat_pass(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    if (!(bsdf.coat > 0.0f)) return 1.0f;
    return 1.0f - bsdf.coat * hyk_coat_reflectance(view, bsdf, cos_theta);
}

/* ---- micro facets: reflectances at cos_h = dot(wo, h); pass: what the coat leaves of the pair */

HYK_FN hyk_vec3 hyk_metal_fresnel(hyk_bsdf bsdf, hyk_real cos_h) {
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_COMPLEX)) return hyk_fresnel_schlick(bsdf.f0, cos_h);
    return hyk_make3(hyk_fresnel_complex(cos_h, bsdf.eta.x, bsdf.k.x), hyk_fresnel_complex(cos_h, bsdf.eta.y, bsdf.k.y),
                     hyk_fresnel_complex(cos_h, bsdf.eta.z, bsdf.k.z));
}

/* Refracting glass. From inside, what the coat stops returns: the facet reflects it. */
HYK_FN hyk_real hyk_glass_facet_reflects(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real pass) {
    hyk_real f = hyk_fresnel_dielectric(cos_h, bsdf.glass_eta);
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE)) return f * pass;
    if (!(bsdf.coat > 0.0f)) return f;
    hyk_real cos_t = hyk_refracted_cosine(cos_h, bsdf.glass_eta) / bsdf.glass_eta;
    return f + (1.0f - f) * (1.0f - hyk_coat_pass(view, bsdf, cos_t));
}
/* g: glass_eta times the refracted cosine; cos_outside: of the pair's direction outside the body, to the macro
   normal. */
HYK_FN hyk_real hyk_glass_facet_passes(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real g, hyk_real cos_outside) {
    hyk_real t = 1.0f - hyk_fresnel_of_pair(cos_h, g, bsdf.glass_eta);
    if (!(bsdf.coat > 0.0f)) return t;
    hyk_real cos_facet = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? g / bsdf.glass_eta : cos_h;
    return t * hyk_min(hyk_coat_pass(view, bsdf, cos_outside), hyk_coat_pass(view, bsdf, cos_facet));
}

/* ---- shares by direction */

HYK_STRUCT(hyk_layers) {
    hyk_real pass;         /* through the coat */
    hyk_real metal_lost;   /* of the white metal, pass included in the balance: pass - its albedo */
    hyk_real schlick;      /* albedo of a metal that reflects (1 - cos)^5 */
    hyk_real diffuse;      /* what reaches the plastic's Lambert base, or crosses a thin sheet */
    hyk_real glass_lost;   /* refracting glass: neither reflected nor transmitted at once */
    hyk_real glass_back;   /* its single reflection */
    hyk_real glass_along;  /* its single transmission */
} HYK_END(hyk_layers)

HYK_FN hyk_layers hyk_layers_of_glass(hyk_view view, hyk_bsdf bsdf, hyk_layers r, hyk_real cos_theta, hyk_real column) {
    hyk_real whole = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? 1.0f : r.pass;
    r.glass_back = hyk_glass_facet_reflects(view, bsdf, cos_theta, r.pass);
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH) && bsdf.at_near != 0u) {
        r.glass_lost = hyk_saturate(hyk_energy_lookup(view, bsdf.at_near, bsdf.rows, column));
        hyk_real more = hyk_energy_lookup(view, bsdf.at_near + HYK_ENERGY_PLANE, bsdf.rows, column);
        r.glass_back = hyk_clamp(r.glass_back + more, 0.0f, hyk_max(whole - r.glass_lost, 0.0f));
    }
    r.glass_along = hyk_max(whole - r.glass_lost - r.glass_back, 0.0f);
    return r;
}

/* Of a direction on wo's side (or beyond a thin sheet). */
HYK_FN hyk_layers hyk_layers_at(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta, hyk_uint features) {
    hyk_layers r;
    hyk_real column = hyk_energy_column(cos_theta, bsdf.alpha);
    hyk_bool tabulated = !hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH);
    r.pass = hyk_coat_pass(view, bsdf, cos_theta);
    r.metal_lost = 0.0f;
    r.schlick = r.pass * hyk_schlick_weight(cos_theta);
    r.diffuse = 0.0f;
    r.glass_lost = 0.0f;
    r.glass_back = 0.0f;
    r.glass_along = 0.0f;
    if (tabulated && bsdf.at_metal != 0u) {
        r.metal_lost = hyk_saturate(hyk_energy_lookup(view, bsdf.at_metal, bsdf.rows, column));
        hyk_real more = hyk_energy_lookup(view, bsdf.at_metal + HYK_ENERGY_PLANE, bsdf.rows, column);
        r.schlick = hyk_clamp(r.schlick + more, 0.0f, r.pass);
    }
    hyk_bool sheet = HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    if (bsdf.plastic > 0.0f || sheet) {
        r.diffuse = r.pass * (1.0f - hyk_fresnel_dielectric(cos_theta, bsdf.ior));
        if (tabulated && bsdf.at_plastic != 0u) r.diffuse += hyk_energy_lookup(view, bsdf.at_plastic, bsdf.rows, column);
        r.diffuse = hyk_saturate(r.diffuse);
    }
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f && !sheet)
        r = hyk_layers_of_glass(view, bsdf, r, cos_theta, column);
    return r;
}

/* Loss of refracting glass for a direction on the other side. */
HYK_FN hyk_real hyk_glass_lost_beyond(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    if (bsdf.at_far == 0u) return 0.0f;
    return hyk_saturate(hyk_energy_lookup(view, bsdf.at_far, bsdf.rows, hyk_energy_column(cos_theta, bsdf.alpha)));
}

/* Plastic's first reflection. */
HYK_FN hyk_real hyk_plastic_back(hyk_bsdf bsdf, hyk_layers l) {
    return hyk_max(l.pass - l.diffuse - bsdf.plastic_bounce * l.metal_lost, 0.0f);
}
/* A thin sheet's first transmission. */
HYK_FN hyk_real hyk_sheet_along(hyk_bsdf bsdf, hyk_layers l) {
    return hyk_max(l.diffuse - (1.0f - bsdf.plastic_bounce) * l.metal_lost, 0.0f);
}

/* ---- making */

HYK_FN hyk_real hyk_inverse_mean(hyk_real mean) {
    return mean > HYK_ENERGY_LEAST ? HYK_INV_PI / mean : 0.0f;
}

/* How the glass's lost light divides: beta n_far^2 mean_far of it passes. Any beta is reciprocal (n^2-scaled)
   and lossless; both sides' divisions should be near that of their first scattering: the geometric mean of
   the two betas that would make them equal, kept where both divisions are at most 1. */
HYK_FN hyk_bsdf hyk_divide_glass(hyk_view view, hyk_bsdf r) {
    hyk_real near_lost = hyk_energy_mean_lost(view, r.at_near, r.rows, r.alpha);
    hyk_real far_lost = hyk_energy_mean_lost(view, r.at_far, r.rows, r.alpha);
    if (!(hyk_min(near_lost, far_lost) > HYK_ENERGY_LEAST)) return r;
    hyk_real near_back = hyk_energy_mean(view, r.at_near + HYK_ENERGY_PLANE, r.rows);
    hyk_real far_back = hyk_energy_mean(view, r.at_far + HYK_ENERGY_PLANE, r.rows);
    hyk_real near_part = hyk_saturate(1.0f - near_back / (1.0f - near_lost));
    hyk_real far_part = hyk_saturate(1.0f - far_back / (1.0f - far_lost));
    hyk_bool inside = hyk_bsdf_is(r, HYK_BSDF_INSIDE);
    hyk_real n2 = r.ior * r.ior;
    hyk_real near_limit = 1.0f / ((inside ? 1.0f : n2) * far_lost), far_limit = 1.0f / ((inside ? n2 : 1.0f) * near_lost);
    hyk_real beta = hyk_sqrt(near_part * near_limit) * hyk_sqrt(far_part * far_limit);
    beta = hyk_min(beta, hyk_min(near_limit, far_limit));
    r.glass_split = hyk_saturate(beta / near_limit);
    r.glass_reflect = (1.0f - r.glass_split) * HYK_INV_PI / near_lost;
    r.glass_through = beta * (inside ? n2 : 1.0f) * HYK_INV_PI;
    return r;
}

/* Hemispherical mean of a metal's reflectance; of_complex is it for eta and k. */
HYK_FN hyk_vec3 hyk_metal_mean(hyk_material material, hyk_vec3 of_complex) {
    if ((material.flags & HYK_MATERIAL_COMPLEX_IOR) != 0u && material.kind == HYK_MATERIAL_CONDUCTOR) return of_complex;
    return hyk_lerp3(material.base_color, hyk_splat(1.0f), HYK_SCHLICK_MEAN);
}

HYK_FN hyk_bsdf hyk_set_metal(hyk_bsdf r, hyk_material material, hyk_vec3 mean) {
    r.f0 = material.base_color;
    if ((material.flags & HYK_MATERIAL_COMPLEX_IOR) == 0u || material.kind != HYK_MATERIAL_CONDUCTOR) return r;
    r.flags |= HYK_BSDF_COMPLEX;
    r.eta = material.eta;
    r.k = material.k;
    hyk_vec3 above = hyk_scale(hyk_sub(mean, hyk_splat(HYK_SCHLICK_MEAN)), 1.0f / (1.0f - HYK_SCHLICK_MEAN));
    r.f0 = hyk_make3(hyk_saturate(above.x), hyk_saturate(above.y), hyk_saturate(above.z));
    return r;
}

/* Offsets of the planes, and what depends on roughness alone. */
HYK_FN hyk_bsdf hyk_set_energy(hyk_view view, hyk_bsdf r, hyk_material material, hyk_uint features) {
    hyk_uint header = material.energy_table;
    hyk_vec3 mean = hyk_make3(HYK_LOAD_ENERGY(view, header), HYK_LOAD_ENERGY(view, header + 1u), HYK_LOAD_ENERGY(view, header + 2u));
    mean = hyk_metal_mean(material, mean);
    r = hyk_set_metal(r, material, mean);
    r.at_metal = hyk_energy_plane(view, header, HYK_ENERGY_AT_METAL);
    r.at_plastic = hyk_energy_plane(view, header, HYK_ENERGY_AT_PLASTIC);
    r.at_coat = hyk_energy_plane(view, header, HYK_ENERGY_AT_COAT);
    if (r.at_metal != 0u) {
        hyk_real lost = hyk_energy_mean_lost(view, r.at_metal, r.rows, r.alpha);
        r.metal_scale = hyk_inverse_mean(lost);
        r.bounce = hyk_make3(hyk_multiple_scattering(mean.x, 1.0f - lost), hyk_multiple_scattering(mean.y, 1.0f - lost),
                             hyk_multiple_scattering(mean.z, 1.0f - lost));
        r.plastic_bounce = hyk_multiple_scattering(HYK_LOAD_ENERGY(view, header + HYK_ENERGY_IOR_MEAN), 1.0f - lost);
    }
    if (r.at_plastic != 0u) r.plastic_scale = hyk_inverse_mean(hyk_energy_mean(view, r.at_plastic, r.rows));
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return r;
    hyk_uint glass = hyk_energy_plane(view, header, HYK_ENERGY_AT_GLASS);
    if (glass == 0u) return r;
    hyk_bool inside = hyk_bsdf_is(r, HYK_BSDF_INSIDE);
    r.at_near = inside ? glass + 2u * HYK_ENERGY_PLANE : glass;
    r.at_far = inside ? glass : glass + 2u * HYK_ENERGY_PLANE;
    return hyk_divide_glass(view, r);
}

/* Nothing but Lambert; the start of all others. */
HYK_FN hyk_bsdf hyk_lambert_bsdf(hyk_material material) {
    hyk_bsdf r;
    r.base_color = material.base_color;
    r.alpha = 1.0f;
    r.f0 = hyk_zero3();
    r.metal = 0.0f;
    r.eta = hyk_zero3();
    r.plastic = 0.0f;
    r.k = hyk_zero3();
    r.glass = 0.0f;
    r.bounce = hyk_zero3();
    r.plastic_bounce = 0.0f;
    r.ior = 1.0f;
    r.glass_eta = 1.0f;
    r.coat = 0.0f;
    r.coat_alpha = 1.0f;
    r.metal_scale = 0.0f;
    r.plastic_scale = 0.0f;
    r.glass_reflect = 0.0f;
    r.glass_through = 0.0f;
    r.glass_split = 0.0f;
    r.flags = HYK_BSDF_LAMBERT;
    r.at_metal = 0u;
    r.at_plastic = 0u;
    r.at_near = 0u;
    r.at_far = 0u;
    r.at_coat = 0u;
    r.rows.offset = 0u;
    r.rows.share = 0.0f;
    return r;
}

HYK_FN hyk_bsdf hyk_set_shares(hyk_bsdf r, hyk_material material, hyk_uint features) {
    hyk_real passing = HYK_HAS(features, HYK_NEEDS_TRANSMISSION) ? hyk_saturate(material.transmission) : 0.0f;
    r.metal = material.kind == HYK_MATERIAL_CONDUCTOR ? 1.0f : hyk_saturate(material.metallic);
    if (material.kind == HYK_MATERIAL_DIELECTRIC) {
        passing = 1.0f;
        r.metal = 0.0f;
        if (hyk_is_black(r.base_color)) r.base_color = hyk_splat(1.0f);
    }
    r.glass = (1.0f - r.metal) * passing;
    r.plastic = (1.0f - r.metal) * (1.0f - passing);
    if (material.kind == HYK_MATERIAL_METALLIC_ROUGHNESS) r.coat = hyk_saturate(material.clearcoat);
    r.coat_alpha = hyk_alpha_of_roughness(material.clearcoat_roughness);
    return r;
}

/* Which parts are delta functions. Glass that bends less than a float direction resolves within its lobe
   (alpha (ior - 1) below 2e-5) counts as smooth: rounding would decide what a rough one looks like. So does
   glass of an index below 1.002: nothing in it can be seen to bend, and micro facets would only shadow. */
HYK_FN hyk_bsdf hyk_set_smoothness(hyk_bsdf r, hyk_bool thin, hyk_bool front) {
    if (thin) r.flags |= HYK_BSDF_THIN;
    if (!thin && !front && r.glass > 0.0f) r.flags |= HYK_BSDF_INSIDE;
    if (hyk_is_smooth(r.alpha)) r.flags |= HYK_BSDF_SMOOTH | HYK_BSDF_GLASS_SMOOTH;
    if (!thin && (r.alpha * (r.ior - 1.0f) < HYK_C(2e-5) || r.ior < HYK_C(1.002))) r.flags |= HYK_BSDF_GLASS_SMOOTH;
    if (hyk_is_smooth(r.coat_alpha)) r.flags |= HYK_BSDF_COAT_SMOOTH;
    r.glass_eta = hyk_bsdf_is(r, HYK_BSDF_INSIDE) ? 1.0f / r.ior : r.ior;
    return r;
}

/* The BSDF at a point: material has its textures applied; front: wo is on the surface's front. */
HYK_FN hyk_bsdf hyk_make_bsdf(hyk_view view, hyk_material material, hyk_bool front, hyk_uint features) {
    hyk_bsdf r = hyk_lambert_bsdf(material);
    if (!HYK_HAS(features, HYK_NEEDS_SPECULAR)) return r;
    if (material.kind == HYK_MATERIAL_LAMBERT) return r;
    r.flags = 0u;
    r.alpha = hyk_alpha_of_roughness(material.roughness);
    r.ior = material.ior;
    r.rows = hyk_energy_rows_of(hyk_max(r.alpha, HYK_SMOOTH_ALPHA));
    r = hyk_set_shares(r, material, features);
    r = hyk_set_smoothness(r, (material.flags & HYK_MATERIAL_THIN) != 0u, front);
    hyk_real f0 = hyk_fresnel_dielectric(1.0f, r.ior);
    r.plastic_scale = HYK_INV_PI / ((1.0f - f0) * (1.0f - HYK_SCHLICK_MEAN)); /* without a table: Schlick's mean */
    if (material.energy_table == HYK_NONE) {
        hyk_vec3 mean = hyk_make3(hyk_fresnel_complex(0.5f, material.eta.x, material.k.x), hyk_fresnel_complex(0.5f, material.eta.y, material.k.y),
                                  hyk_fresnel_complex(0.5f, material.eta.z, material.k.z));
        return hyk_set_metal(r, material, hyk_metal_mean(material, mean));
    }
    return hyk_set_energy(view, r, material, features);
}

#endif /* HYK_BSDF_LAYERS_H */
