/* >>shared-passes: what passes over a pool of lanes hand to each other, and how a lane begins

   A lane is one sample of one pixel. Its path, its hit, its shadow ray and its result stand at the lane's number in one
   buffer each; which lanes are at work stands in queues of lane numbers. */
#ifndef HYK_PASSES_H
#define HYK_PASSES_H

#include "path.h"

/* All that the samples of a picture depend on beside the scene. */
HYK_STRUCT(hyk_picture) {
    hyk_camera camera;
    hyk_path_settings settings;
    hyk_uint max_depth;
    hyk_uint tile_pixels;
    hyk_uint tile_width;
    hyk_uint tile_is_square;
    hyk_uint seed_even, seed_odd;      /* of the two halves of the samples */
    hyk_uint left, top, right, bottom; /* pixels outside are not traced */
} HYK_END(hyk_picture)
HYK_SIZE_IS(hyk_picture, 144)

/* Some samples of all pixels of a tile; sample s of pixel p is lane p * samples + s of the unit's lanes. */
HYK_STRUCT(hyk_unit) {
    hyk_uint tile_x, tile_y; /* its first pixel */
    hyk_uint first_sample, samples;
} HYK_END(hyk_unit)
HYK_SIZE_IS(hyk_unit, 16)

#define HYK_LANE_USED 1u   /* the pixel is inside the picture */
#define HYK_LANE_HIT 2u    /* the sensor's ray met something, or the sensor is a point */
#define HYK_LANE_INSIDE 4u /* the first ray from a sensor's point met a back face */

/* What a device gives back of a lane: its radiance, or the first part of it where components are told apart. */
HYK_STRUCT(hyk_lane_radiance) {
    hyk_vec3 radiance;
    hyk_uint flags;
} HYK_END(hyk_lane_radiance)
HYK_SIZE_IS(hyk_lane_radiance, 16)

/* The rest, where it is wanted: the parts after the first, and what the sensor's ray met. */
HYK_STRUCT(hyk_lane_extra) {
    hyk_vec3 indirect;
    hyk_uint instance;
    hyk_vec3 caustic;
    hyk_uint primitive;
    hyk_vec3 irradiance;
    hyk_uint unused;
    hyk_first_surface first;
} HYK_END(hyk_lane_extra)
HYK_SIZE_IS(hyk_lane_extra, 96)

/* A shadow ray, and what its lane gets if nothing is in the way. */
HYK_STRUCT(hyk_shadow) {
    hyk_ray ray;
    hyk_vec3 diffuse;
    hyk_uint diffuse_component;
    hyk_vec3 specular;
    hyk_uint specular_component;
    hyk_vec3 irradiance;
    hyk_uint unused;
} HYK_END(hyk_shadow)
HYK_SIZE_IS(hyk_shadow, 80)

/* ---- a device's buffers for them, set 1 */

#define HYK_BINDING_PICTURE 0
#define HYK_BINDING_UNITS 1
#define HYK_BINDING_SENSOR 2   /* POINTS: position and normal of each; RAYS: hyk_ray each */
#define HYK_BINDING_COUNTS 3
#define HYK_BINDING_QUEUES 4   /* three of them, pool_lanes long each: paths, paths, shadow rays */
#define HYK_BINDING_PATHS 5
#define HYK_BINDING_HITS 6
#define HYK_BINDING_SHADOWS 7
#define HYK_BINDING_RADIANCE 8
#define HYK_BINDING_EXTRAS 9
#define HYK_PASS_BINDINGS 10

#define HYK_GROUP 64u /* lanes of a workgroup */

/* What trace.comp is made for; odd: any hit does. */
#define HYK_TRACE_PATHS 0u
#define HYK_TRACE_SHADOWS 1u
#define HYK_TRACE_RAYS 2u        /* of the caller: SENSOR to HITS */
#define HYK_TRACE_RAYS_ANY 3u    /* SENSOR to QUEUES: 1 or 0 for each */

/* Arguments of an indirect dispatch: workgroups. */
HYK_STRUCT(hyk_groups) {
    hyk_uint x, y, z, unused;
} HYK_END(hyk_groups)

/* How many lanes are in each queue. Shading appends to paths_next and shadows_next; the arguments pass makes them the
   counts of the passes that follow. */
HYK_STRUCT(hyk_counts) {
    hyk_groups path_groups, shadow_groups;
    hyk_uint paths, shadows;
    hyk_uint paths_next, shadows_next;
    hyk_uint rays_path, rays_shadow; /* of the batch so far */
    hyk_uint front;                  /* queue of paths that is read now: 0 or 1 */
    hyk_uint unused;
} HYK_END(hyk_counts)
HYK_SIZE_IS(hyk_counts, 64)

/* Small facts of one dispatch, as push constants. */
HYK_STRUCT(hyk_dispatch) {
    hyk_uint lanes;         /* of all units together, or rays */
    hyk_uint pool_lanes;    /* length of a queue */
    hyk_uint lanes_of_unit; /* at most: its samples are those of the fullest unit */
    hyk_uint unused;
} HYK_END(hyk_dispatch)

/* ---- the first ray of a lane */

/* Even samples belong to one half of the estimate, odd ones to the other: two independent sequences. */
HYK_FN hyk_sampler hyk_lane_sampler(hyk_picture picture, hyk_uint x, hyk_uint y, hyk_uint sample_number) {
    return hyk_make_sampler(x, y, sample_number >> 1, (sample_number & 1u) != 0u ? picture.seed_odd : picture.seed_even);
}

/* A ray as the caller gave it, with a unit direction. */
HYK_FN hyk_ray hyk_callers_ray(hyk_ray given) {
    hyk_real stretch = hyk_length(given.direction);
    hyk_ray ray;
    ray.origin = given.origin;
    ray.direction = hyk_normalize(given.direction);
    ray.t_min = given.t_min * stretch;
    ray.t_max = given.t_max < HYK_REAL_MAX / hyk_max(stretch, 1.0f) ? given.t_max * stretch : HYK_REAL_MAX;
    return ray;
}

HYK_FN hyk_ray hyk_sensor_ray(hyk_camera camera, hyk_uint x, hyk_uint y, hyk_sampler random) {
    hyk_vec2 lens = hyk_make2(0.0f, 0.0f);
    if (camera.kind == HYK_SENSOR_THIN_LENS) lens = hyk_sample_pair(random, HYK_PAIR_LENS);
    return hyk_camera_ray(camera, hyk_film_point(camera, x, y, hyk_sample_pair(random, HYK_PAIR_FILM)), lens);
}

HYK_FN hyk_path hyk_first_path(hyk_picture picture, hyk_ray ray, hyk_sampler random, hyk_uint lane, hyk_uint features) {
    if (ray.t_max >= HYK_REAL_MAX) ray.t_max = hyk_salted_infinity(random, HYK_NONE, features);
    return hyk_begin_path(ray, random, lane, picture.max_depth, picture.camera.start_width, picture.camera.spread);
}

/* Before the scattering at a sensor's point: no ray yet. */
HYK_FN hyk_path hyk_point_path(hyk_picture picture, hyk_sampler random, hyk_uint lane) {
    hyk_ray none;
    none.origin = hyk_zero3();
    none.t_min = 0.0f;
    none.direction = hyk_zero3();
    none.t_max = 0.0f;
    return hyk_begin_path(none, random, lane, picture.max_depth, 0.0f, picture.camera.spread);
}

/* Where pixel i of a tile lies in it: along the Morton curve where the tile is square, else in rows. */
HYK_FN hyk_uint hyk_tile_column(hyk_uint tile_width, hyk_uint is_square, hyk_uint i) {
    return is_square != 0u ? hyk_morton_even_bits(i) : i % tile_width;
}
HYK_FN hyk_uint hyk_tile_row(hyk_uint tile_width, hyk_uint is_square, hyk_uint i) {
    return is_square != 0u ? hyk_morton_even_bits(i >> 1) : i / tile_width;
}

HYK_FN hyk_bool hyk_picture_holds(hyk_picture picture, hyk_uint x, hyk_uint y) {
    return x >= picture.left && x < picture.right && y >= picture.top && y < picture.bottom;
}

#endif /* HYK_PASSES_H */
