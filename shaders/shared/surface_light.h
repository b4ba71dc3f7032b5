/* >>shared-surface-light: points on rectangles, discs, spheres and triangles, in proportion to solid angle

   Everything is relative to the point p that is lit, in units of the light's distance, and built from the
   light's own edges, not from differences of unit vectors: small, distant and grazing lights keep their
   relative precision and no square leaves the range. */
#ifndef HYK_SURFACE_LIGHT_H
#define HYK_SURFACE_LIGHT_H

#include "sampling.h"
#include "layouts.h"

/* Solid angles below this are beyond float: densities end there. */
#define HYK_LEAST_SOLID_ANGLE HYK_C(1e-36)

HYK_STRUCT(hyk_surface_sample) {
    hyk_vec3 offset;  /* from p to the point on the light */
    hyk_real pdf;     /* per steradian; 0: the light cannot be seen from p */
    hyk_vec3 normal;  /* front */
    hyk_real unused;
    hyk_vec2 weights; /* TRIANGLE: of vertex 1 and vertex 2 */
} HYK_END(hyk_surface_sample)

/* ---- spherical triangles */

/* A triangle seen from the origin: vertex a and the edges to b and c. volume: distance of its plane times its
   double area, that is |a . (b x c)|, handed in because the caller knows it without cancellation. */
HYK_STRUCT(hyk_view_triangle) {
    hyk_vec3 a;
    hyk_real volume;
    hyk_vec3 ab;
    hyk_real solid_angle;
    hyk_vec3 ac;
    hyk_real unused;
} HYK_END(hyk_view_triangle)

/* Van Oosterom & Strackee 1983. */
HYK_FN hyk_view_triangle hyk_view_of_triangle(hyk_vec3 a, hyk_vec3 ab, hyk_vec3 ac, hyk_real volume) {
    hyk_view_triangle t;
    t.a = a;
    t.ab = ab;
    t.ac = ac;
    t.volume = volume;
    hyk_vec3 b = hyk_add(a, ab), c = hyk_add(a, ac);
    hyk_real la = hyk_sqrt(hyk_dot(a, a)), lb = hyk_sqrt(hyk_dot(b, b)), lc = hyk_sqrt(hyk_dot(c, c));
    hyk_real low = la * lb * lc + hyk_dot(a, b) * lc + hyk_dot(a, c) * lb + hyk_dot(b, c) * la;
    t.solid_angle = volume > 0.0f ? 2.0f * hyk_atan2(volume, low) : 0.0f;
    return t;
}

/* Tangent of half the angle between two vectors, from their lengths' product, cross product's length and dot. */
HYK_FN hyk_real hyk_tan_half(hyk_real lengths, hyk_real across, hyk_real along) {
    return along > 0.0f ? across / (lengths + along) : (lengths - along) / hyk_max(across, HYK_C(1e-37));
}

/* From the end of vector a along edge e: which part of the edge lies under an angle whose half has this
   tangent. The edge is resolved into parts along a and across it. */
HYK_FN hyk_real hyk_edge_part(hyk_vec3 a, hyk_vec3 e, hyk_real tan_half) {
    hyk_real length_a = hyk_sqrt(hyk_dot(a, a));
    hyk_vec3 normal = hyk_cross(a, e);
    hyk_real across = hyk_sqrt(hyk_dot(normal, normal)), along = hyk_dot(a, e);
    hyk_real low = across * (1.0f - tan_half) * (1.0f + tan_half) - 2.0f * tan_half * along;
    hyk_real high = 2.0f * tan_half * length_a * length_a;
    return low > high ? hyk_max(high / low, 0.0f) : 1.0f;
}

/* Arvo 1995, "Stratified sampling of spherical triangles", with the sub-triangle's side found from
   tan(E/2) = t t' sin(alpha) / (1 + t t' cos(alpha)), t and t' the tangents of its half sides: no inverse
   cosine, and small triangles lose nothing. Returns the weights of b and c. */
HYK_FN hyk_vec2 hyk_sample_view_triangle(hyk_view_triangle t, hyk_vec2 u) {
    hyk_vec3 b = hyk_add(t.a, t.ab);
    hyk_vec3 n_ab = hyk_cross(t.a, t.ab), n_ac = hyk_cross(t.a, t.ac);
    hyk_real length_a = hyk_sqrt(hyk_dot(t.a, t.a)), length_b = hyk_sqrt(hyk_dot(b, b));
    /* angle at a, up to a common factor: both parts keep their relative precision */
    hyk_real sin_alpha = length_a * t.volume, cos_alpha = hyk_dot(n_ab, n_ac);
    hyk_real norm = hyk_max(hyk_max(hyk_abs(sin_alpha), hyk_abs(cos_alpha)), HYK_C(1e-37));
    sin_alpha /= norm;
    cos_alpha /= norm;
    hyk_real unit = 1.0f / hyk_sqrt(sin_alpha * sin_alpha + cos_alpha * cos_alpha);
    hyk_real half_excess = 0.5f * u.x * t.solid_angle;
    hyk_real se = hyk_sin(half_excess), ce = hyk_cos(half_excess);
    hyk_real tan_ab = hyk_tan_half(length_a * length_b, hyk_sqrt(hyk_dot(n_ab, n_ab)), hyk_dot(t.a, b));
    hyk_real low = tan_ab * unit * (sin_alpha * ce - cos_alpha * se);
    hyk_real part = low > 0.0f ? hyk_edge_part(t.a, t.ac, hyk_min(se / low, HYK_C(1e18))) : 1.0f;
    /* on the arc from b to the point q of edge ac, uniformly in the cosine of the angle at b */
    hyk_vec3 bq = hyk_sub(hyk_scale(t.ac, part), t.ab), q = hyk_add_scaled(t.a, t.ac, part);
    hyk_vec3 n_bq = hyk_cross(b, bq);
    hyk_real across = hyk_sqrt(hyk_dot(n_bq, n_bq));
    hyk_real tan_bq = hyk_min(hyk_tan_half(length_b * hyk_sqrt(hyk_dot(q, q)), across, hyk_dot(b, q)), HYK_C(1e18));
    hyk_real one_minus_cos = u.y * 2.0f * tan_bq * tan_bq / (1.0f + tan_bq * tan_bq);
    hyk_real r = hyk_edge_part(b, bq, hyk_sqrt(one_minus_cos / (2.0f - one_minus_cos)));
    return hyk_make2(1.0f - r, r * part);
}

/* ---- rectangles: two spherical triangles, which, unlike spherical rectangles, need no right angles and do
   not subtract 2 pi from a sum of angles */

/* A light as two triangles around its lower left corner; TRIANGLE: the second has no solid angle. */
HYK_STRUCT(hyk_view_sheet) {
    hyk_view_triangle first, second;
    hyk_real unit;
} HYK_END(hyk_view_sheet)

HYK_FN hyk_bool hyk_light_shows_back(hyk_light light) { return (light.flags & HYK_LIGHT_BOTH_SIDES) != 0u; }

HYK_FN hyk_view_sheet hyk_view_of_sheet(hyk_light light, hyk_vec3 p) {
    hyk_bool rect = light.kind == HYK_LIGHT_RECT;
    hyk_vec3 corner = hyk_sub(light.position, p);
    hyk_vec3 e = light.axis_u, f = light.axis_v;
    if (rect) {
        corner = hyk_sub(hyk_sub(corner, e), f);
        e = hyk_scale(e, 2.0f);
        f = hyk_scale(f, 2.0f);
    }
    hyk_view_sheet s;
    s.unit = hyk_max(hyk_max3(hyk_abs3(corner)), hyk_max(hyk_max3(hyk_abs3(e)), hyk_max3(hyk_abs3(f))));
    hyk_real shrink = 1.0f / s.unit;
    hyk_vec3 a = hyk_scale(corner, shrink);
    e = hyk_scale(e, shrink);
    f = hyk_scale(f, shrink);
    /* the plane's distance from the centre, which is exact for p near the middle of a large sheet */
    hyk_real height = hyk_dot(light.normal, hyk_scale(hyk_sub(p, light.position), shrink));
    if (hyk_light_shows_back(light)) height = hyk_abs(height);
    hyk_vec3 area = hyk_cross(e, f);
    hyk_real volume = height * hyk_sqrt(hyk_dot(area, area));
    s.first = hyk_view_of_triangle(a, e, f, volume);
    s.second = s.first;
    if (rect) s.second = hyk_view_of_triangle(hyk_add(hyk_add(a, e), f), hyk_neg(e), hyk_neg(f), volume);
    else s.second.solid_angle = 0.0f;
    return s;
}

HYK_FN hyk_real hyk_sheet_pdf(hyk_view_sheet s) {
    hyk_real solid_angle = s.first.solid_angle + s.second.solid_angle;
    return solid_angle > HYK_LEAST_SOLID_ANGLE ? 1.0f / solid_angle : 0.0f;
}

HYK_FN hyk_surface_sample hyk_sample_sheet(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_view_sheet s = hyk_view_of_sheet(light, p);
    hyk_surface_sample r;
    r.offset = hyk_zero3();
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = hyk_sheet_pdf(s);
    if (r.pdf == 0.0f) return r;
    hyk_real share = s.first.solid_angle * r.pdf;
    hyk_view_triangle t = s.first;
    if (u.x < share || !(s.second.solid_angle > 0.0f)) { /* share of a lone triangle is 1 but for rounding */
        u.x = hyk_respread(u.x, 0.0f, share);
    } else {
        t = s.second;
        u.x = hyk_respread(u.x, share, hyk_max(1.0f - share, HYK_REAL_EPSILON));
    }
    r.weights = hyk_sample_view_triangle(t, u);
    r.offset = hyk_scale(hyk_add(t.a, hyk_add(hyk_scale(t.ab, r.weights.x), hyk_scale(t.ac, r.weights.y))), s.unit);
    return r;
}

/* ---- disc

   In polar coordinates around the foot of the perpendicular from p: the angle phi of a uniform point of the
   disc, then the radius rho between the chord's ends rho0, rho1 uniformly in the cosine h / sqrt(rho^2 + h^2),
   that is uniformly in solid angle along the chord. The place of the uniform point between the chord's ends,
   (rho^2 - rho0^2) / (rho1^2 - rho0^2), is uniform and independent of phi, so it serves again. The density is
   s0 s1 (s0 + s1) / (2 pi R^2 h) with s = sqrt(rho^2 + h^2): bounded where the area's density s^3 / (pi R^2 h)
   varies without bound. With the foot inside, phi is also drawn uniformly with probability
   R^2 / (R^2 + h^2), density s1 (s1 + h) / (2 pi rho1^2), which is best near the disc. */

HYK_STRUCT(hyk_view_disc) {
    hyk_vec3 to_center; /* from the foot, in the plane; unit is R, or the distance where that is larger */
    hyk_real height;
    hyk_real radius, unit, uniform_share;
    hyk_bool inside;
} HYK_END(hyk_view_disc)

HYK_FN hyk_view_disc hyk_view_of_disc(hyk_light light, hyk_vec3 p) {
    hyk_vec3 to_center = hyk_sub(light.position, p);
    hyk_view_disc d;
    d.unit = hyk_max(hyk_max3(hyk_abs3(to_center)), light.radius);
    to_center = hyk_scale(to_center, 1.0f / d.unit);
    d.radius = light.radius / d.unit;
    hyk_real along = hyk_dot(to_center, light.normal);
    d.height = hyk_light_shows_back(light) ? hyk_abs(along) : -along;
    d.to_center = hyk_add_scaled(to_center, light.normal, -along);
    hyk_real r2 = d.radius * d.radius;
    d.inside = hyk_dot(d.to_center, d.to_center) < r2;
    d.uniform_share = d.inside ? r2 / (r2 + d.height * d.height) : 0.0f;
    return d;
}

/* Ends of the chord through the foot in a unit direction of the plane: rho0, rho1. */
HYK_FN hyk_vec2 hyk_disc_chord(hyk_view_disc d, hyk_vec3 direction) {
    hyk_real along = hyk_dot(d.to_center, direction);
    hyk_vec3 across = hyk_add_scaled(d.to_center, direction, -along);
    hyk_real aside = hyk_sqrt(hyk_dot(across, across));
    hyk_real half_chord = hyk_safe_sqrt((d.radius - aside) * (d.radius + aside));
    return hyk_make2(d.inside ? 0.0f : hyk_max(along - half_chord, 0.0f), hyk_max(along + half_chord, HYK_REAL_EPSILON * d.radius));
}

HYK_FN hyk_real hyk_disc_pdf(hyk_view_disc d, hyk_vec2 chord) {
    hyk_real h = d.height;
    if (!(h * d.radius * d.radius > HYK_LEAST_SOLID_ANGLE)) return 0.0f;
    hyk_real s0 = hyk_sqrt(chord.x * chord.x + h * h), s1 = hyk_sqrt(chord.y * chord.y + h * h);
    hyk_real by_area = s0 * s1 * (s0 + s1) / (HYK_TWO_PI * d.radius * d.radius * h);
    if (!d.inside) return by_area;
    return hyk_lerp(by_area, s1 * (s1 + h) / (HYK_TWO_PI * chord.y * chord.y), d.uniform_share);
}

HYK_FN hyk_surface_sample hyk_sample_disc_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_view_disc d = hyk_view_of_disc(light, p);
    hyk_frame frame = hyk_make_frame(light.normal);
    hyk_vec3 direction;
    hyk_vec2 chord;
    hyk_real place; /* along the chord */
    if (u.x < d.uniform_share) {
        hyk_real phi = HYK_TWO_PI * hyk_respread(u.x, 0.0f, d.uniform_share);
        direction = hyk_add(hyk_scale(frame.x, hyk_cos(phi)), hyk_scale(frame.y, hyk_sin(phi)));
        chord = hyk_disc_chord(d, direction);
        place = u.y;
    } else {
        u.x = hyk_respread(u.x, d.uniform_share, hyk_max(1.0f - d.uniform_share, HYK_REAL_EPSILON));
        hyk_vec2 q = hyk_sample_disc(u);
        hyk_vec3 point = hyk_add(d.to_center, hyk_scale(hyk_add(hyk_scale(frame.x, q.x), hyk_scale(frame.y, q.y)), d.radius));
        direction = hyk_dot(point, point) > 0.0f ? hyk_normalize(point) : frame.x;
        chord = hyk_disc_chord(d, direction);
        hyk_real rho = hyk_dot(point, direction);
        place = hyk_saturate((rho - chord.x) * (rho + chord.x) / hyk_max((chord.y - chord.x) * (chord.y + chord.x), HYK_C(1e-37)));
    }
    hyk_surface_sample r;
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = d.height > 0.0f ? hyk_disc_pdf(d, chord) : 0.0f;
    hyk_real h = d.height;
    hyk_real s0 = hyk_sqrt(chord.x * chord.x + h * h), s1 = hyk_sqrt(chord.y * chord.y + h * h);
    /* s between s0 and s1, uniform in 1 / s; rho^2 = rho0^2 + s^2 - s0^2. From afar s0 and s1 are nearly the same, so s - s0
       comes from the chord: s1 - s0 = (rho1^2 - rho0^2) / (s0 + s1) */
    hyk_real shrink = s0 / hyk_max(hyk_lerp(s1, s0, place), HYK_C(1e-37)), s = s1 * shrink;
    hyk_real beyond = shrink * place * ((chord.y - chord.x) * (chord.y + chord.x) / (s0 + s1));
    hyk_real rho = hyk_clamp(hyk_safe_sqrt(chord.x * chord.x + beyond * (s + s0)), chord.x, chord.y);
    hyk_real side = hyk_dot(hyk_sub(light.position, p), light.normal) < 0.0f ? -1.0f : 1.0f;
    r.offset = hyk_scale(hyk_add_scaled(hyk_scale(direction, rho), light.normal, side * h), d.unit);
    return r;
}

/* Density of a direction that hits the disc. */
HYK_FN hyk_real hyk_pdf_disc_light(hyk_light light, hyk_vec3 p, hyk_vec3 direction) {
    hyk_view_disc d = hyk_view_of_disc(light, p);
    if (!(d.height > 0.0f)) return 0.0f;
    hyk_vec3 in_plane = hyk_add_scaled(direction, light.normal, -hyk_dot(direction, light.normal));
    hyk_bool straight = !(hyk_dot(in_plane, in_plane) > 0.0f);
    in_plane = hyk_normalize(straight ? hyk_make_frame(light.normal).x : in_plane);
    return hyk_disc_pdf(d, hyk_disc_chord(d, in_plane));
}

/* ---- sphere: the cone it subtends */

/* 1 - cos of the cone's half angle; 0: p is not outside. */
HYK_FN hyk_real hyk_sphere_cap(hyk_real distance, hyk_real radius) {
    if (!(distance > radius)) return 0.0f;
    hyk_real sine = radius / distance;
    hyk_real cosine = hyk_sqrt((distance - radius) / distance * (1.0f + sine));
    return hyk_max(sine * sine / (1.0f + cosine), HYK_LEAST_SOLID_ANGLE);
}

HYK_FN hyk_surface_sample hyk_sample_sphere_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_vec3 to_center = hyk_sub(light.position, p);
    hyk_real distance = hyk_length(to_center);
    hyk_real cap = hyk_sphere_cap(distance, light.radius);
    hyk_surface_sample r;
    r.offset = to_center;
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = 0.0f;
    if (cap == 0.0f) return r;
    r.pdf = hyk_pdf_cone(cap);
    hyk_frame frame = hyk_make_frame(hyk_scale(to_center, 1.0f / distance));
    hyk_vec3 local = hyk_sample_cone(cap, u);
    /* nearer root of the ray with the sphere, in units of the distance, without cancellation */
    hyk_real sine = light.radius / distance, sin_theta = hyk_sqrt(local.x * local.x + local.y * local.y);
    hyk_real share = hyk_min(sin_theta / sine, 1.0f);
    hyk_real half_chord = sine * hyk_safe_sqrt((1.0f - share) * (1.0f + share));
    hyk_real t = (distance - light.radius) / distance * (1.0f + sine) / (local.z + half_chord);
    /* the normal from its part across the axis, which is exact however far the sphere is */
    hyk_real across = t / sine;
    hyk_vec3 n = hyk_make3(across * local.x, across * local.y, 0.0f);
    n.z = -hyk_safe_sqrt(1.0f - n.x * n.x - n.y * n.y);
    r.normal = hyk_normalize(hyk_to_world(frame, n));
    r.offset = hyk_scale(hyk_to_world(frame, local), t * distance);
    return r;
}

/* ---- any of them */

HYK_FN hyk_surface_sample hyk_sample_surface_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_sample_sphere_light(light, p, u);
    if (light.kind == HYK_LIGHT_DISC) return hyk_sample_disc_light(light, p, u);
    return hyk_sample_sheet(light, p, u);
}

/* Density, per steradian, of a direction from p that hits the light. */
HYK_FN hyk_real hyk_pdf_surface_light(hyk_light light, hyk_vec3 p, hyk_vec3 direction) {
    if (light.kind == HYK_LIGHT_SPHERE) {
        hyk_real cap = hyk_sphere_cap(hyk_length(hyk_sub(light.position, p)), light.radius);
        return cap > 0.0f ? hyk_pdf_cone(cap) : 0.0f;
    }
    if (light.kind == HYK_LIGHT_DISC) return hyk_pdf_disc_light(light, p, direction);
    return hyk_sheet_pdf(hyk_view_of_sheet(light, p));
}

#endif /* HYK_SURFACE_LIGHT_H */
