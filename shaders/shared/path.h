/* >>shared-path: one vertex of a path: emission found, light sampled, next direction

   The estimator is that of Veach 1997, chapters 9 and 10: at each vertex one light sample, and what the BSDF's own
   direction meets next, weighted against each other by the power heuristic. */
#ifndef HYK_PATH_H
#define HYK_PATH_H

#include "bsdf.h"
#include "camera.h"
#include "environment.h"
#include "light.h"
#include "surface.h"

/* What the picture asks of its paths. */
#define HYK_WANTS_COMPONENTS 0x1u
#define HYK_WANTS_IRRADIANCE 0x2u
#define HYK_WANTS_SURFACE 0x4u
#define HYK_STRATEGY_MIS 0u
#define HYK_STRATEGY_LIGHTS 1u
#define HYK_STRATEGY_BSDF 2u

/* Which part of the picture a contribution belongs to (ALGORITHMS section 0): with D the scatterings that a diffuse
   lobe made, direct has at most one D, and that one last; a caustic has one D, then speculars; the rest is indirect. */
#define HYK_COMPONENT_DIRECT 0u
#define HYK_COMPONENT_INDIRECT 1u
#define HYK_COMPONENT_CAUSTIC 2u

#define HYK_PATH_FROM_SENSOR 0x1u     /* no scattering yet */
#define HYK_PATH_BOTH_SIDES 0x2u      /* the last vertex sampled lights on both its sides */
#define HYK_PATH_DIFFUSE 0x4u         /* one D at least */
#define HYK_PATH_DIFFUSE_TWICE 0x8u
#define HYK_PATH_SPECULAR_LAST 0x10u
#define HYK_PATH_IRRADIANCE 0x20u     /* past the surface whose irradiance is asked for */
#define HYK_PATH_NO_IRRADIANCE 0x40u  /* that surface gives none on this path */
#define HYK_PATH_POINT 0x80u          /* at a sensor's point, which is a white Lambert surface of its own */
#define HYK_PATH_LEFT_POINT 0x100u    /* the ray that left it */

HYK_STRUCT(hyk_path) {
    hyk_ray ray;             /* unit direction */
    hyk_vec3 throughput;
    hyk_real pdf;            /* of the direction, solid angle; 0: sensor or delta, so no light sampling competes */
    hyk_vec3 normal;         /* shading normal where the direction was made */
    hyk_uint flags;
    hyk_vec3 irradiance;     /* throughput since the surface whose irradiance is asked for, cosine over pdf included */
    hyk_uint depth_left;     /* scatterings still allowed */
    hyk_sampler random;
    hyk_uint bounce;         /* scatterings so far, the point's own included: picks the random numbers */
    hyk_real cone_width, cone_spread;
    hyk_uint unused3, unused4;
    hyk_vec3 vertex;         /* where the direction was made: the ray's origin before it was moved off the surface */
    hyk_real eta_scale;      /* product of n^2 ratios, which Russian roulette must not see as loss */
    hyk_uint lane;           /* whose sample it is */
    hyk_uint unused0, unused1, unused2;
} HYK_END(hyk_path)
HYK_SIZE_IS(hyk_path, 144)

#define HYK_SCATTER_SHADOW 0x1u     /* shadow ray to be cast */
#define HYK_SCATTER_CONTINUES 0x2u  /* next is alive */
#define HYK_SCATTER_SURFACE 0x4u    /* first surface recorded */
#define HYK_SCATTER_INSIDE 0x8u     /* the ray from a sensor's point met a back face */

HYK_STRUCT(hyk_first_surface) {
    hyk_vec3 albedo;
    hyk_real depth;
    hyk_vec3 normal;
    hyk_uint material;
    hyk_vec3 position;
    hyk_uint unused;
} HYK_END(hyk_first_surface)

HYK_STRUCT(hyk_scatter) {
    hyk_vec3 emitted;             /* reaches the sensor for sure */
    hyk_uint emitted_component;
    hyk_vec3 emitted_irradiance;
    hyk_uint flags;
    hyk_vec3 diffuse;             /* reaches it if the shadow ray is free */
    hyk_uint diffuse_component;
    hyk_vec3 specular;
    hyk_uint specular_component;
    hyk_vec3 light_irradiance;
    hyk_real unused;
    hyk_ray shadow;
    hyk_path next;
    hyk_first_surface first;
} HYK_END(hyk_scatter)

HYK_STRUCT(hyk_path_settings) {
    hyk_uint strategy, wants;
} HYK_END(hyk_path_settings)

/* Rays that leave a surface meet it at t = 0 when it is an axis plane through 0, where no rounding moves them off it:
   they begin a little after 0, where no float on a surface is. Not at the very smallest number: its error bound would be
   denormal, and a denormal result costs a hundred cycles. */
#define HYK_AFTER_START HYK_C(1.0e-30)

/* Random pairs: two for the sensor, then four a vertex. */
#define HYK_PAIR_FILM 0u
#define HYK_PAIR_LENS 1u
HYK_FN hyk_uint hyk_pair_of(hyk_path path, hyk_uint which) { return 2u + 4u * path.bounce + which; }

HYK_FN hyk_uint hyk_component_of_emission(hyk_uint flags) {
    if ((flags & HYK_PATH_DIFFUSE_TWICE) != 0u) return HYK_COMPONENT_INDIRECT;
    if ((flags & HYK_PATH_DIFFUSE) != 0u && (flags & HYK_PATH_SPECULAR_LAST) != 0u) return HYK_COMPONENT_CAUSTIC;
    return HYK_COMPONENT_DIRECT;
}
HYK_FN hyk_uint hyk_component_of_diffuse(hyk_uint flags) {
    return (flags & HYK_PATH_DIFFUSE) != 0u ? HYK_COMPONENT_INDIRECT : HYK_COMPONENT_DIRECT;
}
HYK_FN hyk_uint hyk_component_of_specular(hyk_uint flags) {
    return hyk_component_of_emission(flags | HYK_PATH_SPECULAR_LAST);
}

/* Weight of light met by a BSDF's ray, against the light sampling that could have found it with pdf light_pdf. */
HYK_FN hyk_real hyk_emission_weight(hyk_path_settings settings, hyk_real bsdf_pdf, hyk_real light_pdf) {
    if (bsdf_pdf == 0.0f || light_pdf == 0.0f || settings.strategy == HYK_STRATEGY_BSDF) return 1.0f;
    if (settings.strategy == HYK_STRATEGY_LIGHTS) return 0.0f;
    return hyk_power_heuristic(bsdf_pdf, light_pdf);
}
HYK_FN hyk_real hyk_light_weight(hyk_path_settings settings, hyk_bool delta, hyk_real light_pdf, hyk_real bsdf_pdf) {
    if (delta || settings.strategy == HYK_STRATEGY_LIGHTS) return 1.0f;
    if (settings.strategy == HYK_STRATEGY_BSDF) return 0.0f;
    return hyk_power_heuristic(light_pdf, bsdf_pdf);
}

HYK_FN hyk_scatter hyk_no_scatter(void) {
    hyk_scatter r;
    r.emitted = hyk_zero3();
    r.emitted_component = HYK_COMPONENT_DIRECT;
    r.emitted_irradiance = hyk_zero3();
    r.flags = 0u;
    r.diffuse = hyk_zero3();
    r.diffuse_component = HYK_COMPONENT_DIRECT;
    r.specular = hyk_zero3();
    r.specular_component = HYK_COMPONENT_DIRECT;
    r.light_irradiance = hyk_zero3();
    r.unused = 0.0f;
    return r;
}

HYK_FN hyk_scatter hyk_add_emission(hyk_scatter r, hyk_path_settings settings, hyk_path path, hyk_vec3 radiance, hyk_real light_pdf) {
    hyk_vec3 weighted = hyk_scale(radiance, hyk_emission_weight(settings, path.pdf, light_pdf));
    r.emitted = hyk_add(r.emitted, hyk_mul(path.throughput, weighted));
    if ((path.flags & HYK_PATH_IRRADIANCE) != 0u)
        r.emitted_irradiance = hyk_add(r.emitted_irradiance, hyk_mul(path.irradiance, weighted));
    return r;
}

/* What a ray that hit nothing brings: suns and environment. */
HYK_FN hyk_scatter hyk_escape(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_uint features) {
    hyk_scatter r = hyk_no_scatter();
    r.emitted_component = hyk_component_of_emission(path.flags);
    hyk_bool both = (path.flags & HYK_PATH_BOTH_SIDES) != 0u;
    hyk_bool seen = (path.flags & HYK_PATH_FROM_SENSOR) != 0u;
    if (HYK_HAS(features, HYK_NEEDS_SUNS)) {
        hyk_uint first = HYK_CONSTANTS(view).finite_lights;
        for (hyk_uint i = first; i < first + HYK_CONSTANTS(view).suns; i++) {
            hyk_light sun = HYK_LOAD_LIGHT(view, i);
            hyk_vec3 radiance = hyk_sun_radiance(sun, path.ray.direction);
            if (hyk_is_black(radiance) || (seen && (sun.flags & HYK_LIGHT_HIDDEN) != 0u)) continue;
            hyk_real pdf = path.pdf > 0.0f ? hyk_pdf_infinite(view, i, path.vertex, path.normal, both, path.ray.direction, features) : 0.0f;
            r = hyk_add_emission(r, settings, path, radiance, pdf);
        }
    }
    if (HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) {
        hyk_real pdf = path.pdf > 0.0f ? hyk_pdf_infinite(view, HYK_NONE, path.vertex, path.normal, both, path.ray.direction, features) : 0.0f;
        r = hyk_add_emission(r, settings, path, hyk_environment_radiance(view, path.ray.direction, features), pdf);
    }
    return r;
}

/* A light's own shape was hit. It reflects nothing, so the path ends. */
HYK_FN hyk_scatter hyk_meet_shape(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_hit hit, hyk_uint features) {
    hyk_scatter r = hyk_no_scatter();
    hyk_light light = HYK_LOAD_LIGHT(view, hit.primitive);
    hyk_vec3 n = hyk_shape_normal(light, hyk_add_scaled(path.ray.origin, path.ray.direction, hit.t));
    hyk_vec3 radiance = hyk_shape_radiance(light, n, path.ray.direction);
    r.emitted_component = hyk_component_of_emission(path.flags);
    hyk_real pdf = 0.0f;
    if (path.pdf > 0.0f && !hyk_is_black(radiance))
        pdf = hyk_pdf_light(view, hit.primitive, path.vertex, path.normal, (path.flags & HYK_PATH_BOTH_SIDES) != 0u,
                            path.ray.direction, hit.t, n, features);
    r = hyk_add_emission(r, settings, path, radiance, pdf);
    if ((path.flags & HYK_PATH_FROM_SENSOR) != 0u) {
        r.flags |= HYK_SCATTER_SURFACE;
        r.first.albedo = hyk_zero3();
        r.first.depth = hit.t;
        r.first.normal = hyk_dot(n, path.ray.direction) > 0.0f ? hyk_neg(n) : n;
        r.first.position = hyk_add_scaled(path.ray.origin, path.ray.direction, hit.t);
        r.first.material = HYK_NONE;
        r.first.unused = 0u;
    }
    return r;
}

/* Radiance that a surface of the scene emits against the path, weighted. */
HYK_FN hyk_scatter hyk_meet_emitter(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_hit hit, hyk_surface s,
                                    hyk_material material, hyk_uint features) {
    if ((material.flags & HYK_MATERIAL_EMITS) == 0u || !(s.front || (material.flags & HYK_MATERIAL_EMITS_BOTH_SIDES) != 0u)) return r;
    hyk_instance placed = HYK_LOAD_INSTANCE(view, hit.instance);
    hyk_real pdf = 0.0f;
    if (HYK_HAS(features, HYK_NEEDS_EMITTERS) && path.pdf > 0.0f && placed.first_light != HYK_NONE) {
        hyk_uint slot = hit.primitive;
        if ((HYK_LOAD_MESH(view, placed.mesh).flags & HYK_MESH_LIGHT_SLOTS) != 0u) slot = HYK_LOAD_LIGHT_SLOT(view, placed.mesh, slot);
        if (slot != HYK_NONE)
            pdf = hyk_pdf_light(view, placed.first_light + slot, path.vertex, path.normal, (path.flags & HYK_PATH_BOTH_SIDES) != 0u,
                                path.ray.direction, hit.t, s.front ? s.geometric : hyk_neg(s.geometric), features);
    }
    return hyk_add_emission(r, settings, path, material.emission, pdf);
}

/* Alpha that blends asks a hash of the ray (alpha.h), so rays that are the same in all but their sample must differ in
   something: in how far beyond everything they end, or in the length of a direction that need not be unit. */
HYK_FN hyk_real hyk_salt(hyk_sampler random, hyk_uint which) { return hyk_unit_real(hyk_hash2(hyk_hash2(random.seed, random.index), random.pixel ^ which)); }
HYK_FN hyk_real hyk_salted_infinity(hyk_sampler random, hyk_uint which, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA)) return HYK_REAL_MAX;
    return HYK_REAL_MAX * (1.0f - 0.125f * hyk_salt(random, which));
}

/* From one offset point to a sampled light point, itself moved off its surface; or to infinity. */
HYK_FN hyk_ray hyk_shadow_ray(hyk_vec3 origin, hyk_light_sample light, hyk_path path, hyk_uint features) {
    hyk_ray r;
    r.origin = origin;
    r.t_min = HYK_AFTER_START;
    r.direction = light.direction;
    r.t_max = hyk_salted_infinity(path.random, path.bounce, features);
    if (light.distance >= HYK_REAL_MAX) return r;
    hyk_vec3 target = light.position;
    if ((light.flags & HYK_SAMPLE_SURFACE) != 0u) {
        hyk_real side = hyk_dot(light.normal, light.direction) > 0.0f ? -1.0f : 1.0f;
        hyk_real error = hyk_gamma(16.0f) * hyk_dot(hyk_abs3(light.normal), hyk_abs3(target));
        target = hyk_offset_point(target, hyk_scale(light.normal, side), error);
    }
    r.direction = hyk_sub(target, origin);
    /* The last 2^-12 of the way is left out: a curved light's surface is known no better near its rim. */
    r.t_max = HYK_C(1.0 - 1.0 / 4096.0);
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA)) return r;
    hyk_real longer = 1.0f + hyk_salt(path.random, path.bounce);
    r.direction = hyk_scale(r.direction, longer);
    r.t_max = r.t_max / longer;
    return r;
}

/* Light sampling at s: the contributions if nothing is in the way, and the ray that finds out. */
HYK_FN hyk_scatter hyk_sample_direct(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_bsdf bsdf,
                                     hyk_frame frame, hyk_vec3 wo, hyk_uint features) {
    hyk_bool both = hyk_bsdf_transmits(bsdf);
    hyk_real select = hyk_sample_pair(path.random, hyk_pair_of(path, 1u)).y;
    hyk_light_sample light = hyk_sample_lights(view, s.position, s.shading, both, select, hyk_sample_pair(path.random, hyk_pair_of(path, 2u)), features);
    if ((light.flags & HYK_SAMPLE_VALID) == 0u || !(light.pdf > 0.0f)) return r;
    hyk_vec3 wi = hyk_to_local(frame, light.direction);
    hyk_real side = hyk_dot(light.direction, s.geometric);
    if (wi.z * side <= 0.0f || (wi.z < 0.0f && !both)) return r;
    hyk_bsdf_value f = hyk_bsdf_eval(view, bsdf, wo, wi, features);
    hyk_real weight = hyk_light_weight(settings, (light.flags & HYK_SAMPLE_DELTA) != 0u, light.pdf, f.pdf) / light.pdf;
    hyk_vec3 incoming = hyk_scale(light.radiance, weight);
    hyk_vec3 arriving = hyk_mul(path.throughput, incoming);
    r.diffuse = hyk_mul(arriving, f.diffuse);
    r.specular = hyk_mul(arriving, f.specular);
    r.diffuse_component = hyk_component_of_diffuse(path.flags);
    r.specular_component = hyk_component_of_specular(path.flags);
    if ((settings.wants & HYK_WANTS_IRRADIANCE) != 0u) {
        if ((path.flags & HYK_PATH_IRRADIANCE) != 0u)
            r.light_irradiance = hyk_mul(path.irradiance, hyk_mul(incoming, hyk_add(f.diffuse, f.specular)));
        else if ((path.flags & HYK_PATH_NO_IRRADIANCE) == 0u && hyk_bsdf_has_diffuse(bsdf) && wi.z > 0.0f)
            r.light_irradiance = hyk_mul(path.irradiance, hyk_scale(incoming, wi.z));
    }
    if (hyk_is_black(r.diffuse) && hyk_is_black(r.specular) && hyk_is_black(r.light_irradiance)) return r;
    hyk_vec3 n = side > 0.0f ? s.geometric : hyk_neg(s.geometric);
    r.shadow = hyk_shadow_ray(hyk_offset_point(s.position, n, s.error), light, path, features);
    r.flags |= HYK_SCATTER_SHADOW;
    return r;
}

/* Probability of going on: the share of light the path still carries. Not before the fourth vertex; and below 1 from the
   64th on, so that light in a lossless trap ends too. Not earlier: weights that grow while nothing is lost are noise. */
HYK_FN hyk_real hyk_survival(hyk_path path) {
    if (path.bounce < 4u) return 1.0f;
    return hyk_clamp(hyk_max3(path.throughput) * path.eta_scale, HYK_C(0.02), path.bounce < 64u ? 1.0f : HYK_C(0.999));
}

/* The part of a sampled scattering that is followed. The whole of it, unless components are told apart: then either the
   diffuse or the specular part, by their luminance, so that each part is estimated without bias. */
HYK_FN hyk_vec3 hyk_choose_part(hyk_bsdf_sample sampled, hyk_bool split, hyk_bool diffuse) {
    if (!split) return hyk_add(sampled.diffuse, sampled.specular);
    hyk_real d = hyk_luminance(sampled.diffuse), s = hyk_luminance(sampled.specular);
    if (diffuse) return hyk_scale(sampled.diffuse, (d + s) / d);
    return hyk_scale(sampled.specular, (d + s) / s);
}

HYK_FN hyk_uint hyk_scatter_flags(hyk_uint flags, hyk_bool diffuse) {
    hyk_uint f = flags & ~(HYK_PATH_FROM_SENSOR | HYK_PATH_BOTH_SIDES | HYK_PATH_SPECULAR_LAST | HYK_PATH_POINT | HYK_PATH_LEFT_POINT);
    if (!diffuse) return f | HYK_PATH_SPECULAR_LAST;
    if ((f & HYK_PATH_DIFFUSE) != 0u) f |= HYK_PATH_DIFFUSE_TWICE;
    return f | HYK_PATH_DIFFUSE;
}

/* Throughput since the surface whose irradiance is asked for; this vertex may be that surface. */
HYK_FN hyk_path hyk_follow_irradiance(hyk_path next, hyk_path path, hyk_bsdf bsdf, hyk_bsdf_sample sampled) {
    if ((path.flags & HYK_PATH_IRRADIANCE) != 0u) {
        next.irradiance = hyk_mul(path.irradiance, hyk_add(sampled.diffuse, sampled.specular));
        return next;
    }
    if (hyk_bsdf_is_delta_only(bsdf)) return next;
    hyk_bool given = hyk_bsdf_has_diffuse(bsdf) && (sampled.flags & (HYK_LOBE_DELTA | HYK_LOBE_TRANSMIT)) == 0u;
    if (!given || (path.flags & HYK_PATH_NO_IRRADIANCE) != 0u) {
        next.flags |= HYK_PATH_NO_IRRADIANCE;
        return next;
    }
    next.flags |= HYK_PATH_IRRADIANCE;
    next.irradiance = hyk_scale(path.irradiance, sampled.wi.z / sampled.pdf);
    return next;
}

/* The path after scattering at s, or no continuation. */
HYK_FN hyk_scatter hyk_sample_next(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_material material,
                                   hyk_bsdf bsdf, hyk_frame frame, hyk_vec3 wo, hyk_uint features) {
    hyk_real u_lobe = hyk_sample_pair(path.random, hyk_pair_of(path, 1u)).x;
    hyk_bsdf_sample sampled = hyk_bsdf_sample_direction(view, bsdf, wo, u_lobe, hyk_sample_pair(path.random, hyk_pair_of(path, 0u)), features);
    if (!(sampled.pdf > 0.0f)) return r;
    hyk_vec3 direction = hyk_normalize(hyk_to_world(frame, sampled.wi));
    hyk_real side = hyk_dot(direction, s.geometric);
    if (side * sampled.wi.z <= 0.0f) return r; /* the shading normal promised a side that the face does not have */
    hyk_vec2 u = hyk_sample_pair(path.random, hyk_pair_of(path, 3u));
    hyk_real d = hyk_luminance(sampled.diffuse), sp = hyk_luminance(sampled.specular);
    hyk_bool split = (settings.wants & HYK_WANTS_COMPONENTS) != 0u && d > 0.0f && sp > 0.0f;
    hyk_bool diffuse = split ? u.y * (d + sp) < d : d > sp;
    hyk_path next = path;
    next.throughput = hyk_mul(path.throughput, hyk_choose_part(sampled, split, diffuse));
    if (hyk_is_black(next.throughput)) return r;
    next.flags = hyk_scatter_flags(path.flags, diffuse);
    if (hyk_bsdf_transmits(bsdf)) next.flags |= HYK_PATH_BOTH_SIDES;
    if ((path.flags & HYK_PATH_POINT) != 0u) next.flags |= HYK_PATH_LEFT_POINT;
    else next.depth_left = path.depth_left - 1u;
    next.bounce = path.bounce + 1u;
    next.pdf = (sampled.flags & HYK_LOBE_DELTA) != 0u ? 0.0f : sampled.pdf;
    next.normal = s.shading;
    next.vertex = s.position;
    if ((settings.wants & HYK_WANTS_IRRADIANCE) != 0u) next = hyk_follow_irradiance(next, path, bsdf, sampled);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && (sampled.flags & HYK_LOBE_TRANSMIT) != 0u && (material.flags & HYK_MATERIAL_THIN) == 0u)
        next.eta_scale = path.eta_scale * (s.front ? hyk_square(material.ior) : 1.0f / hyk_square(material.ior));
    if ((sampled.flags & HYK_LOBE_DIFFUSE) != 0u) next.cone_spread = hyk_max(path.cone_spread, HYK_C(0.1));
    else if ((sampled.flags & HYK_LOBE_GLOSSY) != 0u) next.cone_spread = hyk_max(path.cone_spread, HYK_C(0.1) * hyk_square(material.roughness));
    hyk_real survival = hyk_survival(next);
    if (u.x >= survival) return r;
    next.throughput = hyk_scale(next.throughput, 1.0f / survival);
    next.irradiance = hyk_scale(next.irradiance, 1.0f / survival);
    next.ray.origin = hyk_offset_point(s.position, side > 0.0f ? s.geometric : hyk_neg(s.geometric), s.error);
    next.ray.direction = direction;
    next.ray.t_min = HYK_AFTER_START;
    next.ray.t_max = hyk_salted_infinity(path.random, next.bounce, features);
    r.next = next;
    r.flags |= HYK_SCATTER_CONTINUES;
    return r;
}

/* Light sampling and continuation at a surface. */
HYK_FN hyk_scatter hyk_scatter_at(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_material material,
                                  hyk_uint features) {
    hyk_bsdf bsdf = hyk_make_bsdf(view, material, s.front, features);
    hyk_frame frame = hyk_make_frame(s.shading);
    hyk_vec3 wo = hyk_to_local(frame, hyk_neg(path.ray.direction));
    if ((path.flags & HYK_PATH_FROM_SENSOR) != 0u && (settings.wants & HYK_WANTS_SURFACE) != 0u) {
        r.flags |= HYK_SCATTER_SURFACE;
        r.first.albedo = hyk_bsdf_albedo(view, bsdf, wo, features);
        r.first.normal = s.shading;
        r.first.position = s.position;
        r.first.material = s.material;
        r.first.unused = 0u;
    }
    if (path.depth_left == 0u && (path.flags & HYK_PATH_POINT) == 0u) return r;
    const hyk_uint any_light = HYK_NEEDS_EMITTERS | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT;
    if (HYK_HAS(features, any_light) && !hyk_bsdf_is_delta_only(bsdf))
        r = hyk_sample_direct(view, settings, r, path, s, bsdf, frame, wo, features);
    return hyk_sample_next(view, settings, r, path, s, material, bsdf, frame, wo, features);
}

/* Vertex of a path where its ray ended: hit.instance HYK_NONE: nowhere. */
HYK_FN hyk_scatter hyk_shade(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_hit hit, hyk_uint features) {
    if (hit.instance == HYK_NONE) return hyk_escape(view, settings, path, features);
    if (HYK_HAS(features, HYK_NEEDS_SHAPES) && hit.instance == HYK_HIT_SHAPE) return hyk_meet_shape(view, settings, path, hit, features);
    path.cone_width += path.cone_spread * hit.t;
    hyk_surface s = hyk_surface_at(view, hit, path.ray.direction, path.cone_width, features);
    hyk_material material = hyk_material_at(view, s, path.cone_width, features);
    if (HYK_HAS(features, HYK_NEEDS_ABSORPTION) && !s.front && (material.flags & HYK_MATERIAL_ABSORBS) != 0u) {
        hyk_vec3 passed = hyk_make3(hyk_exp(-material.absorption.x * hit.t), hyk_exp(-material.absorption.y * hit.t),
                                    hyk_exp(-material.absorption.z * hit.t));
        path.throughput = hyk_mul(path.throughput, passed);
        path.irradiance = hyk_mul(path.irradiance, passed);
    }
    hyk_scatter r = hyk_no_scatter();
    r.first.depth = hit.t;
    r.emitted_component = hyk_component_of_emission(path.flags);
    r = hyk_meet_emitter(view, settings, r, path, hit, s, material, features);
    if ((path.flags & HYK_PATH_LEFT_POINT) != 0u && !s.front && (material.flags & HYK_MATERIAL_TRANSMITS) == 0u) r.flags |= HYK_SCATTER_INSIDE;
    return hyk_scatter_at(view, settings, r, path, s, material, features);
}

HYK_FN hyk_path hyk_begin_path(hyk_ray ray, hyk_sampler random, hyk_uint lane, hyk_uint max_depth, hyk_real cone_width, hyk_real cone_spread) {
    hyk_path p;
    p.ray = ray;
    p.throughput = hyk_splat(1.0f);
    p.pdf = 0.0f;
    p.normal = ray.direction;
    p.vertex = ray.origin;
    p.unused0 = 0u;
    p.unused1 = 0u;
    p.unused2 = 0u;
    p.unused3 = 0u;
    p.unused4 = 0u;
    p.flags = HYK_PATH_FROM_SENSOR;
    p.irradiance = hyk_splat(1.0f);
    p.depth_left = max_depth;
    p.random = random;
    p.bounce = 0u;
    p.cone_width = cone_width;
    p.cone_spread = cone_spread;
    p.eta_scale = 1.0f;
    p.lane = lane;
    return p;
}

/* The first vertex of a path from a sensor's point: white Lambert, so that radiance is irradiance over pi. The point is the
   caller's, rounded in ways unknown: 32 roundings of its coordinates are allowed for. */
HYK_FN hyk_scatter hyk_shade_point(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_vec3 position, hyk_vec3 normal,
                                   hyk_uint features) {
    hyk_surface s;
    s.position = position;
    s.error = hyk_gamma(32.0f) * hyk_dot(hyk_abs3(normal), hyk_abs3(position));
    s.geometric = normal;
    s.shading = normal;
    s.uv = hyk_make2(0.0f, 0.0f);
    s.uv_scale = 0.0f;
    s.material = HYK_NONE;
    s.front = true;
    hyk_material white;
    white.base_color = hyk_splat(1.0f);
    white.metallic = 0.0f;
    white.emission = hyk_zero3();
    white.roughness = 1.0f;
    white.absorption = hyk_zero3();
    white.ior = 1.5f;
    white.eta = hyk_zero3();
    white.transmission = 0.0f;
    white.k = hyk_zero3();
    white.alpha_cutoff = 0.5f;
    white.kind = HYK_MATERIAL_LAMBERT;
    white.flags = 0u;
    white.energy_table = HYK_NONE;
    white.normal_scale = 1.0f;
    white.base_color_texture = HYK_NONE;
    white.metallic_roughness_texture = HYK_NONE;
    white.normal_texture = HYK_NONE;
    white.emission_texture = HYK_NONE;
    white.alpha_texture = HYK_NONE;
    white.alpha = 1.0f;
    white.clearcoat = 0.0f;
    white.clearcoat_roughness = 0.0f;
    hyk_scatter r = hyk_no_scatter();
    r.first.depth = 0.0f;
    path.flags |= HYK_PATH_POINT;
    path.ray.direction = hyk_neg(normal);
    return hyk_scatter_at(view, settings, r, path, s, white, features);
}

#endif /* HYK_PATH_H */
