/* >>shared-camera: rays of the sensors */
#ifndef HYK_CAMERA_H
#define HYK_CAMERA_H

#include "layouts.h"
#include "sampling.h"

#define HYK_SENSOR_PINHOLE 0u
#define HYK_SENSOR_THIN_LENS 1u
#define HYK_SENSOR_ORTHOGRAPHIC 2u
#define HYK_SENSOR_EQUIRECTANGULAR 3u
#define HYK_SENSOR_POINTS 4u
#define HYK_SENSOR_RAYS 5u
#define HYK_FILTER_BOX 0u
#define HYK_FILTER_TENT 1u

HYK_STRUCT(hyk_camera) {
    hyk_vec3 position;
    hyk_uint kind;
    hyk_vec3 right;      /* unit, as up and forward */
    hyk_real half_width; /* of the image window: at distance 1 (perspective), in metres (orthographic) */
    hyk_vec3 up;
    hyk_real half_height;
    hyk_vec3 forward;
    hyk_real lens_radius;
    hyk_real focus_distance;
    hyk_real shift_x, shift_y; /* of the window, in its own units */
    hyk_uint filter_kind;
    hyk_uint width, height;
    hyk_real spread;     /* growth of a pixel's cone per metre */
    hyk_real start_width; /* of the cone at the ray's origin (orthographic) */
} HYK_END(hyk_camera)
HYK_SIZE_IS(hyk_camera, 96)

/* A tent two pixels wide, as an offset from the pixel's middle (the inverse of its distribution). */
HYK_FN hyk_real hyk_tent(hyk_real u) {
    return u < 0.5f ? hyk_sqrt(2.0f * u) - 1.0f : 1.0f - hyk_sqrt(2.0f - 2.0f * u);
}

/* Where in the image, in pixels, sample u of a pixel lies. */
HYK_FN hyk_vec2 hyk_film_point(hyk_camera c, hyk_uint x, hyk_uint y, hyk_vec2 u) {
    if (c.filter_kind == HYK_FILTER_TENT)
        return hyk_make2(HYK_TO_REAL(x) + 0.5f + hyk_tent(u.x), HYK_TO_REAL(y) + 0.5f + hyk_tent(u.y));
    return hyk_make2(HYK_TO_REAL(x) + u.x, HYK_TO_REAL(y) + u.y);
}

HYK_FN hyk_vec3 hyk_camera_space(hyk_camera c, hyk_real x, hyk_real y, hyk_real z) {
    return hyk_add(hyk_scale(c.right, x), hyk_add(hyk_scale(c.up, y), hyk_scale(c.forward, z)));
}

/* The ray through film point f (pixels); lens is uniform in the unit square. */
HYK_FN hyk_ray hyk_camera_ray(hyk_camera c, hyk_vec2 f, hyk_vec2 lens) {
    hyk_real sx = 2.0f * f.x / HYK_TO_REAL(c.width) - 1.0f, sy = 1.0f - 2.0f * f.y / HYK_TO_REAL(c.height);
    hyk_real x = sx * c.half_width + c.shift_x, y = sy * c.half_height + c.shift_y;
    hyk_ray r;
    r.origin = c.position;
    r.t_min = 0.0f;
    r.t_max = HYK_REAL_MAX;
    if (c.kind == HYK_SENSOR_ORTHOGRAPHIC) {
        r.origin = hyk_add(c.position, hyk_camera_space(c, x, y, 0.0f));
        r.direction = c.forward;
    } else if (c.kind == HYK_SENSOR_EQUIRECTANGULAR) {
        hyk_real longitude = sx * HYK_PI, latitude = sy * HYK_PI * 0.5f;
        hyk_real ring = hyk_cos(latitude);
        r.direction = hyk_normalize(hyk_camera_space(c, ring * hyk_sin(longitude), hyk_sin(latitude), ring * hyk_cos(longitude)));
    } else if (c.kind == HYK_SENSOR_THIN_LENS && c.lens_radius > 0.0f) {
        hyk_vec2 on_lens = hyk_sample_disc(lens);
        hyk_real lx = on_lens.x * c.lens_radius, ly = on_lens.y * c.lens_radius;
        /* from the lens to the point that the pinhole ray has in the plane of focus */
        r.origin = hyk_add(c.position, hyk_camera_space(c, lx, ly, 0.0f));
        r.direction = hyk_normalize(hyk_camera_space(c, x * c.focus_distance - lx, y * c.focus_distance - ly, c.focus_distance));
    } else {
        r.direction = hyk_normalize(hyk_camera_space(c, x, y, 1.0f));
    }
    return r;
}

#endif /* HYK_CAMERA_H */
