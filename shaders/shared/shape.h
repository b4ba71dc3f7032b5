/* >>shared-shape: lights that rays can hit: rectangle, disc, sphere */
#ifndef HYK_SHAPE_H
#define HYK_SHAPE_H

#include "layouts.h"

HYK_FN hyk_real hyk_within_ray(hyk_ray ray, hyk_real t) { return t >= ray.t_min && t <= ray.t_max ? t : -1.0f; }

/* Where the ray meets the plane of a sheet, or -1. */
HYK_FN hyk_real hyk_intersect_sheet_plane(hyk_light light, hyk_vec3 to_center, hyk_ray ray) {
    hyk_real slope = hyk_dot(light.normal, ray.direction);
    if (slope == 0.0f) return -1.0f;
    return hyk_within_ray(ray, hyk_dot(light.normal, to_center) / slope);
}

/* A parallelogram: half edges need not be perpendicular. w lies in it when both its coordinates along them,
   found with the dual basis, are at most 1. */
HYK_FN hyk_bool hyk_rect_holds(hyk_light light, hyk_vec3 w) {
    hyk_vec3 across_v = hyk_cross(light.axis_v, light.normal), across_u = hyk_cross(light.normal, light.axis_u);
    return hyk_abs(hyk_dot(w, across_v)) <= hyk_abs(hyk_dot(light.axis_u, across_v)) &&
           hyk_abs(hyk_dot(w, across_u)) <= hyk_abs(hyk_dot(light.axis_v, across_u));
}

HYK_FN hyk_real hyk_intersect_sheet(hyk_light light, hyk_ray ray) {
    hyk_vec3 to_center = hyk_sub(light.position, ray.origin);
    hyk_real t = hyk_intersect_sheet_plane(light, to_center, ray);
    if (t < 0.0f) return -1.0f;
    hyk_vec3 w = hyk_sub(hyk_scale(ray.direction, t), to_center);
    if (light.kind == HYK_LIGHT_DISC) return hyk_length(w) <= light.radius ? t : -1.0f;
    return hyk_rect_holds(light, w) ? t : -1.0f;
}

/* The discriminant comes from the distance of the centre to the line, not from b^2 - ac, and the roots from
   q, so that neither a distant nor a near or huge sphere loses its bits (Haines, Guenther, Akenine-Moeller
   2019, "Precision improvements for ray/sphere intersection"). All lengths are in units of the larger of
   radius and distance, the direction in units of its largest component: no square over- or underflows. */
HYK_FN hyk_real hyk_intersect_sphere(hyk_light light, hyk_ray ray) {
    hyk_vec3 f = hyk_sub(ray.origin, light.position);
    hyk_real unit = hyk_max(hyk_max3(hyk_abs3(f)), light.radius), stretch = hyk_max3(hyk_abs3(ray.direction));
    if (!(unit > 0.0f && stretch > 0.0f)) return -1.0f;
    f = hyk_make3(f.x / unit, f.y / unit, f.z / unit);
    hyk_vec3 d = hyk_make3(ray.direction.x / stretch, ray.direction.y / stretch, ray.direction.z / stretch);
    hyk_real r = light.radius / unit;
    hyk_real a = hyk_dot(d, d), b = -hyk_dot(f, d);
    hyk_vec3 miss = hyk_add_scaled(f, d, b / a);
    hyk_real height = hyk_length(miss);
    if (!(height <= r)) return -1.0f;
    hyk_real half_chord = hyk_sqrt(a * (r - height) * (r + height));
    hyk_real q = b >= 0.0f ? b + half_chord : b - half_chord;
    if (q == 0.0f) return -1.0f;
    hyk_real length_f = hyk_sqrt(hyk_dot(f, f));
    hyk_real x = (length_f - r) * (length_f + r) / q, y = q / a;
    hyk_real to_ray = unit / stretch;
    hyk_real t = hyk_within_ray(ray, hyk_min(x, y) * to_ray);
    return t < 0.0f ? hyk_within_ray(ray, hyk_max(x, y) * to_ray) : t;
}

/* t of the nearest hit in [t_min, t_max], -1: none. The ray's direction need not be unit length. Sheets are
   hit from both sides, a sphere also from inside. Kinds without a body are never hit. */
HYK_FN hyk_real hyk_intersect_shape(hyk_light light, hyk_ray ray) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_intersect_sphere(light, ray);
    if (light.kind == HYK_LIGHT_RECT || light.kind == HYK_LIGHT_DISC) return hyk_intersect_sheet(light, ray);
    return -1.0f;
}

/* The front's geometric normal, unit length; outwards for the sphere. */
HYK_FN hyk_vec3 hyk_shape_normal(hyk_light light, hyk_vec3 point) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_normalize(hyk_sub(point, light.position));
    return light.normal;
}

/* The radiance that a point of the shape with that front normal sends against a ray of that direction. */
HYK_FN hyk_vec3 hyk_shape_radiance(hyk_light light, hyk_vec3 normal, hyk_vec3 direction) {
    if (hyk_dot(normal, direction) < 0.0f) return light.radiance;
    hyk_bool glows_behind = light.kind != HYK_LIGHT_SPHERE && (light.flags & HYK_LIGHT_BOTH_SIDES) != 0u;
    return glows_behind ? light.radiance : hyk_zero3();
}

#endif /* HYK_SHAPE_H */
