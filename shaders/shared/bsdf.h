/* >>shared-bsdf: evaluates and samples a surface's scattering

   Local frame, z the shading normal on wo's side. Values are f |cos wi|, radiance transport: across a
   refracting surface they carry (n_o / n_i)^2. Without HYK_NEEDS_SPECULAR only Lambert is left. */
#ifndef HYK_BSDF_H
#define HYK_BSDF_H

#include "bsdf_lobes.h"

#define HYK_LOBE_DIFFUSE 0x1u
#define HYK_LOBE_GLOSSY 0x2u
#define HYK_LOBE_DELTA 0x4u
#define HYK_LOBE_TRANSMIT 0x8u

/* flags 0 and pdf 0: no direction. Not delta: diffuse + specular is the whole value over the whole density.
   Delta: pdf is the probability of the choice, specular the weight over it. */
HYK_STRUCT(hyk_bsdf_sample) {
    hyk_vec3 wi;
    hyk_real pdf;
    hyk_vec3 diffuse;
    hyk_real u_left; /* what is still uniform of u_lobe */
    hyk_vec3 specular;
    hyk_uint flags;
} HYK_END(hyk_bsdf_sample)

HYK_FN hyk_bool hyk_bsdf_has_diffuse(hyk_bsdf bsdf) {
    return (hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT) || bsdf.plastic > 0.0f) && !hyk_is_black(bsdf.base_color);
}
HYK_FN hyk_bool hyk_bsdf_transmits(hyk_bsdf bsdf) { return bsdf.glass > 0.0f && !hyk_is_black(bsdf.base_color); }

HYK_FN hyk_bool hyk_bsdf_is_delta_only(hyk_bsdf bsdf) {
    if (hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT) || hyk_bsdf_has_diffuse(bsdf)) return false;
    if (bsdf.metal + bsdf.plastic > 0.0f && !hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH)) return false;
    if (bsdf.glass > 0.0f && !hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return false;
    return !(bsdf.coat > 0.0f) || hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH);
}

HYK_FN hyk_bool hyk_bsdf_only_lambert(hyk_bsdf bsdf, hyk_uint features) {
    return !HYK_HAS(features, HYK_NEEDS_SPECULAR) || hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT);
}

HYK_FN hyk_bsdf_value hyk_eval_lambert(hyk_bsdf bsdf, hyk_real cos_i) {
    hyk_bsdf_value r = hyk_no_value();
    r.pdf = hyk_pdf_cosine_hemisphere(cos_i);
    r.diffuse = hyk_scale(bsdf.base_color, r.pdf);
    return r;
}

/* Of a pair, with what is known of wo already. */
HYK_FN hyk_bsdf_value hyk_eval_pair(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    if (wi.z > 0.0f) return hyk_eval_reflected(view, bsdf, wo, wi, o, q, features);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && wi.z < 0.0f && bsdf.glass > 0.0f)
        return hyk_eval_transmitted(view, bsdf, wo, wi, o, q, features);
    return hyk_no_value();
}

HYK_CALLED hyk_bsdf_value hyk_eval_layers(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_uint features) {
    hyk_layers o = hyk_layers_at(view, bsdf, wo.z, features);
    return hyk_eval_pair(view, bsdf, wo, wi, o, hyk_lobe_shares_of(bsdf, o, features), features);
}

HYK_FN hyk_bsdf_value hyk_bsdf_eval(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_uint features) {
    if (!(wo.z > 0.0f)) return hyk_no_value();
    if (hyk_bsdf_only_lambert(bsdf, features)) return hyk_eval_lambert(bsdf, wi.z);
    return hyk_eval_layers(view, bsdf, wo, wi, features);
}

/* ---- sampling */

HYK_FN hyk_bsdf_sample hyk_no_sample(hyk_real u_lobe) {
    hyk_bsdf_sample r;
    r.wi = hyk_make3(0.0f, 0.0f, 1.0f);
    r.pdf = 0.0f;
    r.diffuse = hyk_zero3();
    r.u_left = u_lobe;
    r.specular = hyk_zero3();
    r.flags = 0u;
    return r;
}

HYK_FN hyk_bsdf_sample hyk_sample_lambert(hyk_bsdf bsdf, hyk_real u_lobe, hyk_vec2 u) {
    hyk_bsdf_sample r = hyk_no_sample(u_lobe);
    r.wi = hyk_sample_cosine_hemisphere(u);
    r.pdf = hyk_pdf_cosine_hemisphere(r.wi.z);
    r.diffuse = bsdf.base_color;
    r.flags = HYK_LOBE_DIFFUSE;
    return r;
}

/* Delta reflection: coat and smooth bases share its direction. */
HYK_FN hyk_bsdf_sample hyk_sample_mirror(hyk_view view, hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_layers o, hyk_real chance,
                                         hyk_uint features) {
    r.wi = hyk_make3(-wo.x, -wo.y, wo.z);
    r.pdf = chance;
    r.specular = hyk_facet_color(view, bsdf, wo.z, o.pass, true, features);
    if (hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH))
        r.specular = hyk_add(r.specular, hyk_splat(hyk_coat_weight(bsdf) * hyk_fresnel_dielectric(wo.z, HYK_COAT_IOR)));
    r.specular = hyk_scale(r.specular, 1.0f / chance);
    r.flags = HYK_LOBE_DELTA;
    return r;
}

/* Delta transmission, straight through a thin sheet or refracted. */
HYK_FN hyk_bsdf_sample hyk_sample_window(hyk_view view, hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_layers o, hyk_real chance) {
    hyk_real t;
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) {
        r.wi = hyk_neg(wo);
        t = o.diffuse;
    } else {
        hyk_real g = hyk_refracted_cosine(wo.z, bsdf.glass_eta);
        if (!(g > 0.0f)) return r;
        r.wi = hyk_refract(wo, hyk_make3(0.0f, 0.0f, 1.0f), wo.z, g, bsdf.glass_eta);
        hyk_real cos_outside = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? -r.wi.z : wo.z;
        t = hyk_glass_facet_passes(view, bsdf, wo.z, g, cos_outside) / (bsdf.glass_eta * bsdf.glass_eta);
    }
    r.pdf = chance;
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * t / chance);
    r.flags = HYK_LOBE_DELTA | HYK_LOBE_TRANSMIT;
    return r;
}

/* Reflection or transmission at a visible facet: direction and flags; flags stay 0 where it leaves on the
   wrong side. */
HYK_FN hyk_bsdf_sample hyk_sample_facet(hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec2 u, hyk_uint features) {
    hyk_vec3 h = hyk_ggx_sample(wo, bsdf.alpha, u);
    hyk_real cos_h = hyk_dot(wo, h);
    if (!(cos_h > 0.0f)) return r;
    hyk_real reflects = hyk_facet_reflects(bsdf, cos_h, features);
    hyk_bool back = r.u_left < reflects;
    r.u_left = back ? hyk_respread(r.u_left, 0.0f, reflects) : hyk_respread(r.u_left, reflects, 1.0f - reflects);
    r.wi = hyk_reflect(wo, h, cos_h);
    if (back) {
        if (r.wi.z > 0.0f) r.flags = HYK_LOBE_GLOSSY;
        return r;
    }
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) r.wi.z = -r.wi.z;
    else {
        hyk_real g = hyk_refracted_cosine(cos_h, bsdf.glass_eta);
        if (!(g > 0.0f)) return r;
        r.wi = hyk_refract(wo, h, cos_h, g, bsdf.glass_eta);
    }
    if (r.wi.z < 0.0f) r.flags = HYK_LOBE_GLOSSY | HYK_LOBE_TRANSMIT;
    return r;
}

HYK_FN hyk_bsdf_sample hyk_sample_coat(hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec2 u) {
    hyk_vec3 h = hyk_ggx_sample(wo, bsdf.coat_alpha, u);
    r.wi = hyk_reflect(wo, h, hyk_dot(wo, h));
    if (r.wi.z > 0.0f) r.flags = HYK_LOBE_GLOSSY;
    return r;
}

/* Chooses a lobe and in it a direction: wi, flags and u_left; delta lobes are complete. */
HYK_FN hyk_bsdf_sample hyk_sample_lobe(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_layers o,
                                       hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_sample r = hyk_no_sample(u_lobe);
    hyk_real lo = 0.0f;
    /* the shares add up to 1 but for rounding: no number lies beyond the last of them */
    u_lobe = hyk_min(u_lobe, (q.facets + q.diffuse + q.mirror + q.coat + q.bounce + q.through + q.window) * HYK_BELOW_ONE);
    if (u_lobe < lo + q.facets) {
        r.u_left = hyk_respread(u_lobe, lo, q.facets);
        return hyk_sample_facet(r, bsdf, wo, u, features);
    }
    lo += q.facets;
    if (u_lobe < lo + q.diffuse) {
        r.u_left = hyk_respread(u_lobe, lo, q.diffuse);
        r.wi = hyk_sample_cosine_hemisphere(u);
        r.flags = HYK_LOBE_DIFFUSE;
        return r;
    }
    lo += q.diffuse;
    if (u_lobe < lo + q.mirror) {
        r.u_left = hyk_respread(u_lobe, lo, q.mirror);
        return hyk_sample_mirror(view, r, bsdf, wo, o, q.mirror, features);
    }
    lo += q.mirror;
    if (u_lobe < lo + q.coat) {
        r.u_left = hyk_respread(u_lobe, lo, q.coat);
        return hyk_sample_coat(r, bsdf, wo, u);
    }
    lo += q.coat;
    if (u_lobe < lo + q.bounce) {
        r.u_left = hyk_respread(u_lobe, lo, q.bounce);
        r.wi = hyk_lost_sample(bsdf.alpha, u);
        r.flags = HYK_LOBE_GLOSSY;
        return r;
    }
    lo += q.bounce;
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return r;
    if (q.through > 0.0f && (u_lobe < lo + q.through || !(q.window > 0.0f))) {
        r.u_left = hyk_respread(u_lobe, lo, q.through);
        r.wi = hyk_neg(hyk_lost_sample(bsdf.alpha, u));
        r.flags = HYK_LOBE_GLOSSY | HYK_LOBE_TRANSMIT;
        return r;
    }
    if (!(q.window > 0.0f)) return r;
    r.u_left = hyk_respread(u_lobe, lo + q.through, q.window);
    return hyk_sample_window(view, r, bsdf, wo, o, q.window);
}

HYK_CALLED hyk_bsdf_sample hyk_sample_layers(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_uint features) {
    hyk_layers o = hyk_layers_at(view, bsdf, wo.z, features);
    hyk_lobe_shares q = hyk_lobe_shares_of(bsdf, o, features);
    if (!(q.total > 0.0f)) return hyk_no_sample(u_lobe);
    hyk_bsdf_sample r = hyk_sample_lobe(view, bsdf, wo, u_lobe, u, o, q, features);
    if (r.flags == 0u || (r.flags & HYK_LOBE_DELTA) != 0u) return r;
    hyk_bsdf_value value = hyk_eval_pair(view, bsdf, wo, r.wi, o, q, features);
    if (!(value.pdf > 0.0f)) return hyk_no_sample(r.u_left);
    r.pdf = value.pdf;
    r.diffuse = hyk_scale(value.diffuse, 1.0f / value.pdf);
    r.specular = hyk_scale(value.specular, 1.0f / value.pdf);
    return r;
}

HYK_FN hyk_bsdf_sample hyk_bsdf_sample_direction(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_uint features) {
    if (!(wo.z > 0.0f)) return hyk_no_sample(u_lobe);
    if (hyk_bsdf_only_lambert(bsdf, features)) return hyk_sample_lambert(bsdf, u_lobe, u);
    return hyk_sample_layers(view, bsdf, wo, u_lobe, u, features);
}

/* ---- albedo */

HYK_FN hyk_vec3 hyk_glass_albedo(hyk_bsdf bsdf, hyk_layers o) {
    hyk_bool sheet = hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    hyk_real back = o.glass_back + (1.0f - bsdf.glass_split) * o.glass_lost;
    hyk_real along = o.glass_along + bsdf.glass_split * o.glass_lost;
    if (sheet) {
        back = o.pass - o.diffuse;
        along = o.diffuse;
    }
    return hyk_add_scaled(hyk_splat(back), bsdf.base_color, along);
}

/* Share of the light along wo that is reflected or transmitted (power: without the n^2 of radiance). */
HYK_CALLED hyk_vec3 hyk_bsdf_albedo(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_uint features) {
    if (hyk_bsdf_only_lambert(bsdf, features)) return bsdf.base_color;
    hyk_layers o = hyk_layers_at(view, bsdf, hyk_max(wo.z, 0.0f), features);
    hyk_real rest = hyk_max(o.pass - o.metal_lost - o.schlick, 0.0f);
    hyk_vec3 metal = hyk_add_scaled(hyk_splat(o.schlick), bsdf.f0, rest);
    metal = hyk_add_scaled(metal, bsdf.bounce, o.metal_lost);
    hyk_vec3 r = hyk_scale(metal, bsdf.metal);
    hyk_real opaque = bsdf.metal + bsdf.plastic;
    hyk_real coat = (1.0f - o.pass) * (hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? opaque : 1.0f);
    r = hyk_add(r, hyk_splat(coat + bsdf.plastic * (o.pass - o.diffuse)));
    r = hyk_add_scaled(r, bsdf.base_color, bsdf.plastic * o.diffuse);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) r = hyk_add_scaled(r, hyk_glass_albedo(bsdf, o), bsdf.glass);
    return r;
}

#endif /* HYK_BSDF_H */
