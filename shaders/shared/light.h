/* >>shared-light: choosing a light and a direction to it, and the density of that choice */
#ifndef HYK_LIGHT_H
#define HYK_LIGHT_H

#include "emission.h"
#include "environment.h"
#include "light_tree.h"
#include "shape.h"
#include "surface_light.h"

#define HYK_SAMPLE_VALID 0x1u
#define HYK_SAMPLE_DELTA 0x2u   /* no other strategy can find this direction: weight 1 */
#define HYK_SAMPLE_SURFACE 0x4u /* position and normal are set */

/* The contribution is always f cos radiance / pdf. */
HYK_STRUCT(hyk_light_sample) {
    hyk_vec3 direction; /* unit, to the light */
    hyk_real distance;  /* HYK_REAL_MAX: sun, environment */
    hyk_vec3 radiance;  /* that arrives if nothing is in the way; DELTA: irradiance on a facing surface */
    hyk_real pdf;       /* per steradian, choice of the light included; DELTA: that choice alone */
    hyk_vec3 position;
    hyk_uint light;     /* HYK_NONE: environment */
    hyk_vec3 normal;
    hyk_uint flags;
} HYK_END(hyk_light_sample)

HYK_FN hyk_light_sample hyk_no_light_sample(void) {
    hyk_light_sample s;
    s.direction = hyk_zero3();
    s.distance = 0.0f;
    s.radiance = hyk_zero3();
    s.pdf = 0.0f;
    s.position = hyk_zero3();
    s.light = HYK_NONE;
    s.normal = hyk_zero3();
    s.flags = 0u;
    return s;
}

/* ---- lights without extent */

/* Share of a spot's intensity at an angle of that cosine off its axis: 1 inside cone_inner, 0 outside
   cone_outer, x^2 (3 - 2 x) between with x linear in the cosine. Its flux is therefore
   2 pi intensity (1 - (cos_inner + cos_outer) / 2). */
HYK_FN hyk_real hyk_spot_falloff(hyk_light light, hyk_real cosine) {
    if (cosine >= light.cos_inner) return cosine >= light.cos_outer ? 1.0f : 0.0f;
    if (cosine <= light.cos_outer) return 0.0f;
    hyk_real x = hyk_saturate((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer));
    return x * x * (3.0f - 2.0f * x);
}

HYK_FN hyk_real hyk_to_finite(hyk_real x) { return hyk_min(x, HYK_REAL_MAX); }

/* POINT and SPOT: intensity over the square of the distance, divided twice so that no square overflows. */
HYK_FN hyk_light_sample hyk_sample_point_light(hyk_light light, hyk_vec3 p) {
    hyk_light_sample s = hyk_no_light_sample();
    hyk_vec3 offset = hyk_sub(light.position, p);
    s.distance = hyk_length(offset);
    if (!(s.distance > 0.0f)) return s;
    s.direction = hyk_normalize(offset);
    hyk_real share = light.kind == HYK_LIGHT_SPOT ? hyk_spot_falloff(light, -hyk_dot(s.direction, light.normal)) : 1.0f;
    if (!(share > 0.0f)) return s;
    hyk_vec3 e = hyk_scale(light.radiance, share);
    s.radiance = hyk_make3(hyk_to_finite(e.x / s.distance / s.distance), hyk_to_finite(e.y / s.distance / s.distance),
                           hyk_to_finite(e.z / s.distance / s.distance));
    s.pdf = 1.0f;
    s.position = light.position;
    s.normal = hyk_neg(s.direction);
    s.flags = HYK_SAMPLE_VALID | HYK_SAMPLE_DELTA;
    return s;
}

/* ---- suns */

/* 1 - cos of its angular radius, from the angle: the stored cosine has lost the bits of small ones. */
HYK_FN hyk_real hyk_sun_cap(hyk_light light) {
    hyk_real s = hyk_sin(0.5f * light.radius);
    return 2.0f * s * s;
}

/* Whether the disc covers a unit direction: by the chord, which is precise for the smallest discs. */
HYK_FN hyk_bool hyk_sun_covers(hyk_light light, hyk_vec3 direction) {
    if (!(light.radius > 0.0f)) return false;
    hyk_vec3 chord = hyk_sub(direction, light.normal);
    return hyk_dot(chord, chord) <= 2.0f * hyk_sun_cap(light);
}

/* Radiance of a sun seen in a unit direction; zero beside its disc and for parallel beams. */
HYK_FN hyk_vec3 hyk_sun_radiance(hyk_light light, hyk_vec3 direction) {
    if (hyk_sun_covers(light, direction)) return light.radiance;
    return hyk_zero3();
}

HYK_FN hyk_light_sample hyk_sample_sun(hyk_light light, hyk_vec2 u) {
    hyk_light_sample s = hyk_no_light_sample();
    s.distance = HYK_REAL_MAX;
    s.radiance = light.radiance;
    s.flags = HYK_SAMPLE_VALID;
    if (light.radius > 0.0f) {
        hyk_real cap = hyk_sun_cap(light);
        s.direction = hyk_normalize(hyk_to_world(hyk_make_frame(light.normal), hyk_sample_cone(cap, u)));
        s.pdf = hyk_pdf_cone(hyk_max(cap, HYK_LEAST_SOLID_ANGLE));
    } else {
        s.direction = light.normal;
        s.pdf = 1.0f;
        s.flags = HYK_SAMPLE_VALID | HYK_SAMPLE_DELTA;
    }
    return s;
}

/* Luminance of the irradiance a sun can give, at most: zero only when all of its disc is below the horizon. */
HYK_FN hyk_real hyk_estimate_sun(hyk_light light, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real luminance = hyk_max(hyk_luminance(light.radiance), 0.0f), facing = hyk_dot(n, light.normal);
    if (both_sides) facing = hyk_abs(facing);
    if (!(light.radius > 0.0f)) return luminance * hyk_max(facing, 0.0f);
    hyk_real slack = 0.00048828125f; /* of sines taken from cosines near 1 */
    hyk_vec2 disc = hyk_make2(hyk_cos(hyk_min(light.radius, HYK_PI)), hyk_sin(hyk_min(light.radius, HYK_PI)));
    hyk_real beyond = hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), disc).x;
    if (beyond <= -slack) return 0.0f;
    return HYK_TWO_PI * hyk_sun_cap(light) * luminance * hyk_max(beyond, slack);
}

HYK_FN hyk_real hyk_estimate_suns(hyk_view view, hyk_vec3 n, hyk_bool both_sides) {
    hyk_uint first = HYK_CONSTANTS(view).finite_lights, suns = HYK_CONSTANTS(view).suns;
    hyk_real sum = 0.0f;
    for (hyk_uint i = 0u; i < suns; i++) sum += hyk_estimate_sun(HYK_LOAD_LIGHT(view, first + i), n, both_sides);
    return sum;
}

/* Each sun takes the place of those before it in proportion to the sum so far. */
HYK_FN hyk_light_pick hyk_pick_sun(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_chooser chooser) {
    hyk_uint first = HYK_CONSTANTS(view).finite_lights, suns = HYK_CONSTANTS(view).suns;
    hyk_light_pick pick;
    pick.light = first;
    pick.probability = 1.0f;
    if (suns == 1u) return pick;
    hyk_real sum = 0.0f, taken = 0.0f;
    for (hyk_uint i = 0u; i < suns; i++) {
        hyk_real weight = hyk_estimate_sun(HYK_LOAD_LIGHT(view, first + i), n, both_sides);
        if (!(weight > 0.0f)) continue;
        if (sum > 0.0f) chooser = hyk_choose(chooser, sum, weight);
        if (!(sum > 0.0f) || chooser.second) {
            pick.light = first + i;
            taken = weight;
        }
        sum += weight;
    }
    if (!(sum > 0.0f)) pick.light = HYK_NONE;
    pick.probability = sum > 0.0f ? taken / sum : 0.0f;
    return pick;
}

HYK_FN hyk_real hyk_sun_pick_probability(hyk_view view, hyk_light light, hyk_vec3 n, hyk_bool both_sides) {
    if (HYK_CONSTANTS(view).suns == 1u) return 1.0f;
    hyk_real total = hyk_estimate_suns(view, n, both_sides);
    return total > 0.0f ? hyk_estimate_sun(light, n, both_sides) / total : 0.0f;
}

/* ---- finite lights, suns, environment: which */

/* Every group that can contribute gets at least this probability: the estimates know nothing of shadows. */
#define HYK_LEAST_GROUP_SHARE 0.125f

HYK_STRUCT(hyk_light_groups) {
    hyk_real finite, suns, environment; /* probabilities */
} HYK_END(hyk_light_groups)

HYK_FN hyk_bool hyk_has_finite_lights(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_EMITTERS) && HYK_CONSTANTS(view).finite_lights > 0u;
}
HYK_FN hyk_bool hyk_has_suns(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_SUNS) && HYK_CONSTANTS(view).suns > 0u;
}
HYK_FN hyk_bool hyk_has_environment(hyk_view view, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) return false;
    return !hyk_has_environment_map(view, features) || HYK_CONSTANTS(view).environment_integral > 0.0f;
}

/* In proportion to the estimates, above the least share. */
HYK_FN hyk_real hyk_group_share(hyk_real estimate, hyk_real total, hyk_real groups) {
    return estimate > 0.0f ? HYK_LEAST_GROUP_SHARE + (1.0f - groups * HYK_LEAST_GROUP_SHARE) * (estimate / total) : 0.0f;
}

HYK_FN hyk_light_groups hyk_choose_light_groups(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_uint features) {
    hyk_bool finite = hyk_has_finite_lights(view, features), suns = hyk_has_suns(view, features);
    hyk_bool environment = hyk_has_environment(view, features);
    hyk_light_groups g;
    g.finite = finite ? 1.0f : 0.0f;
    g.suns = suns ? 1.0f : 0.0f;
    g.environment = environment ? 1.0f : 0.0f;
    if (g.finite + g.suns + g.environment <= 1.0f) return g;
    if (finite) g.finite = hyk_min(hyk_estimate_finite_lights(view, p, n, both_sides), HYK_C(1e37));
    if (suns) g.suns = hyk_min(hyk_estimate_suns(view, n, both_sides), HYK_C(1e37));
    if (environment) g.environment = hyk_min(hyk_estimate_environment(view, both_sides, features), HYK_C(1e37));
    hyk_real total = g.finite + g.suns + g.environment;
    hyk_real groups = (g.finite > 0.0f ? 1.0f : 0.0f) + (g.suns > 0.0f ? 1.0f : 0.0f) + (g.environment > 0.0f ? 1.0f : 0.0f);
    g.finite = hyk_group_share(g.finite, total, groups);
    g.suns = hyk_group_share(g.suns, total, groups);
    g.environment = hyk_group_share(g.environment, total, groups);
    return g;
}

/* ---- the sample */

HYK_FN hyk_vec3 hyk_surface_light_radiance(hyk_view view, hyk_light light, hyk_surface_sample s, hyk_vec3 direction, hyk_uint features) {
    hyk_vec3 radiance = hyk_shape_radiance(light, s.normal, direction);
    if (HYK_HAS(features, HYK_NEEDS_TEXTURES | HYK_NEEDS_ALPHA) && (light.flags & HYK_LIGHT_TEXTURED) != 0u && !hyk_is_black(radiance))
        radiance = hyk_triangle_emission(view, light.instance, light.primitive, s.weights, features);
    return radiance;
}

HYK_FN hyk_light_sample hyk_sample_finite_light(hyk_view view, hyk_uint index, hyk_vec3 p, hyk_vec2 u, hyk_uint features) {
    hyk_light light = HYK_LOAD_LIGHT(view, index);
    if (light.kind == HYK_LIGHT_POINT || light.kind == HYK_LIGHT_SPOT) return hyk_sample_point_light(light, p);
    hyk_light_sample s = hyk_no_light_sample();
    hyk_surface_sample on_light = hyk_sample_surface_light(light, p, u);
    if (!(on_light.pdf > 0.0f)) return s;
    s.distance = hyk_length(on_light.offset);
    s.direction = hyk_normalize(on_light.offset);
    s.radiance = hyk_surface_light_radiance(view, light, on_light, s.direction, features);
    s.position = hyk_add(p, on_light.offset);
    s.normal = on_light.normal;
    s.pdf = light.kind == HYK_LIGHT_DISC ? hyk_pdf_disc_light(light, p, s.direction) : on_light.pdf;
    s.flags = s.pdf > 0.0f && !hyk_is_black(s.radiance) ? HYK_SAMPLE_VALID | HYK_SAMPLE_SURFACE : 0u;
    return s;
}

HYK_FN hyk_light_sample hyk_sample_sky(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec2 u, hyk_uint features) {
    hyk_light_sample s = hyk_no_light_sample();
    s.direction = hyk_sample_environment(view, n, both_sides, u, features);
    s.distance = HYK_REAL_MAX;
    s.radiance = hyk_environment_radiance(view, s.direction, features);
    s.pdf = hyk_pdf_environment(view, n, both_sides, s.direction, features);
    s.flags = s.pdf > 0.0f && !hyk_is_black(s.radiance) ? HYK_SAMPLE_VALID : 0u;
    return s;
}

/* One direction to one light. n: the shading normal, on the viewer's side; both_sides: the surface transmits,
   so that light from behind counts too; u_select chooses the light, u the direction. */
HYK_CALLED hyk_light_sample hyk_sample_lights(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_real u_select, hyk_vec2 u,
                                          hyk_uint features) {
    hyk_light_groups groups = hyk_choose_light_groups(view, p, n, both_sides, features);
    hyk_light_sample s = hyk_no_light_sample();
    if (!(groups.finite + groups.suns + groups.environment > 0.0f)) return s;
    hyk_chooser chooser = hyk_start_choosing(u_select, u);
    hyk_bool infinite = !(groups.finite > 0.0f);
    if (groups.finite > 0.0f && groups.finite < 1.0f) {
        chooser = hyk_choose(chooser, groups.finite, groups.suns + groups.environment);
        infinite = chooser.second;
    }
    hyk_bool sky = infinite && !(groups.suns > 0.0f);
    if (infinite && groups.suns > 0.0f && groups.environment > 0.0f) {
        chooser = hyk_choose(chooser, groups.suns, groups.environment);
        sky = chooser.second;
    }
    hyk_real probability = groups.environment;
    hyk_light_pick pick;
    pick.light = HYK_NONE;
    pick.probability = 1.0f;
    if (sky) {
        s = hyk_sample_sky(view, n, both_sides, u, features);
    } else if (infinite) {
        probability = groups.suns;
        pick = hyk_pick_sun(view, n, both_sides, chooser);
        if (pick.light == HYK_NONE) return s;
        s = hyk_sample_sun(HYK_LOAD_LIGHT(view, pick.light), u);
    } else {
        probability = groups.finite;
        pick = hyk_pick_light(view, p, n, both_sides, chooser);
        if (pick.light == HYK_NONE) return s;
        s = hyk_sample_finite_light(view, pick.light, p, u, features);
    }
    s.light = pick.light;
    s.pdf = hyk_to_finite(s.pdf * probability * pick.probability);
    if (!(s.pdf > 0.0f) || (!both_sides && !(hyk_dot(n, s.direction) > 0.0f))) s.flags = 0u;
    return s;
}

/* The density with which hyk_sample_lights, given the same p, n and both_sides, would have produced a unit
   direction that hits a RECT, DISC, SPHERE or TRIANGLE light. distance and light_normal describe that hit. */
HYK_CALLED hyk_real hyk_pdf_light(hyk_view view, hyk_uint light, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction,
                              hyk_real distance, hyk_vec3 light_normal, hyk_uint features) {
    if (!hyk_has_finite_lights(view, features) || !(distance > 0.0f)) return 0.0f;
    hyk_light l = HYK_LOAD_LIGHT(view, light);
    if (!hyk_light_shows_back(l) && !(hyk_dot(light_normal, direction) < 0.0f)) return 0.0f;
    hyk_real pdf = hyk_pdf_surface_light(l, p, direction);
    if (!(pdf > 0.0f)) return 0.0f;
    pdf *= hyk_choose_light_groups(view, p, n, both_sides, features).finite;
    return hyk_to_finite(pdf * hyk_light_pick_probability(view, l.tree_path, p, n, both_sides));
}

/* The same for a ray that escapes: which is a sun, or HYK_NONE for the environment. */
HYK_CALLED hyk_real hyk_pdf_infinite(hyk_view view, hyk_uint which, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction,
                                 hyk_uint features) {
    if (which == HYK_NONE) {
        if (!hyk_has_environment(view, features)) return 0.0f;
        hyk_real share = hyk_choose_light_groups(view, p, n, both_sides, features).environment;
        return share > 0.0f ? share * hyk_pdf_environment(view, n, both_sides, direction, features) : 0.0f;
    }
    if (!hyk_has_suns(view, features)) return 0.0f;
    hyk_light light = HYK_LOAD_LIGHT(view, which);
    if (!hyk_sun_covers(light, direction)) return 0.0f;
    hyk_real pick = hyk_sun_pick_probability(view, light, n, both_sides);
    if (!(pick > 0.0f)) return 0.0f;
    hyk_real pdf = hyk_pdf_cone(hyk_max(hyk_sun_cap(light), HYK_LEAST_SOLID_ANGLE));
    return hyk_choose_light_groups(view, p, n, both_sides, features).suns * pick * pdf;
}

#endif /* HYK_LIGHT_H */
