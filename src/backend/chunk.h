/* >>backend-chunk: what a backend is asked for: the samples of one tile, and what it gives back

   A chunk is a tile's pixels times some samples; a lane is one sample. A backend traces a chunk's paths to their end and
   leaves a result for each lane. Films, schedules and error bars above know nothing of how. */
#ifndef HYI_CHUNK_H
#define HYI_CHUNK_H

#include "../../shaders/shared/path.h"
#include "../bvh/trace.h"

/* Everything about a picture that its samples depend on. */
typedef struct hyi_picture {
    const hyk_scene_view *view;
    const hyi_accel *accel;
    hyk_path_settings settings;
    hyk_camera camera;
    const float *point_positions, *point_normals; /* POINTS: 3 floats each; width x height of them */
    const hydra_ray *rays;                        /* RAYS */
    uint32_t max_depth;
    uint32_t seed_of_half[2];
    uint32_t features; /* of the scene */
} hyi_picture;

typedef struct hyi_chunk {
    const uint16_t *pixel_x, *pixel_y; /* of the tile's pixels within the tile, in the order of lanes */
    uint32_t tile_x, tile_y;           /* first pixel of the tile, in the frame */
    uint32_t right, bottom;            /* pixels at or beyond are outside the picture */
    uint32_t left, top;                /* as are those before */
    uint32_t pixels;                   /* pixels of a tile */
    uint32_t first_sample, samples;    /* samples first ... first + samples - 1 of each pixel; sample s of pixel p is
                                          lane p * samples + s */
} hyi_chunk;

/* Parts of a lane's radiance; without HYK_WANTS_COMPONENTS all of it is in the first. */
typedef struct hyi_lane {
    hyk_vec3 part[3];
    hyk_vec3 irradiance;
    hyk_first_surface first;
    uint32_t instance, primitive; /* first hit, as hyk_hit */
    uint32_t flags;
} hyi_lane;

#define HYI_LANE_USED 1u
#define HYI_LANE_HIT 2u
#define HYI_LANE_INSIDE 4u

typedef struct hyi_counters {
    uint64_t rays_camera, rays_bounce, rays_shadow, paths;
    double generate, intersect, shade, shadow;
} hyi_counters;

#endif /* HYI_CHUNK_H */
