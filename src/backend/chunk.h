/* >>backend-chunk: what a backend is asked for: the samples of one tile, and what it gives back

   A backend traces the paths of a unit's lanes to their end and leaves a result for each lane. Films, schedules and error
   bars above know nothing of how. */
#ifndef HYI_CHUNK_H
#define HYI_CHUNK_H

#include "../../shaders/shared/passes.h"
#include "../bvh/trace.h"

/* Everything about a picture that its samples depend on. */
typedef struct hyi_picture {
    const hyk_scene_view *view;
    const hyi_accel *accel;
    hyk_picture kernel;
    const float *point_positions, *point_normals; /* POINTS: 3 floats each; width x height of them */
    const hydra_ray *rays;                        /* RAYS */
    uint32_t features;                            /* of the scene */
} hyi_picture;

/* Parts of a lane's radiance; without HYK_WANTS_COMPONENTS all of it is in the first. */
typedef struct hyi_lane {
    hyk_vec3 part[3];
    hyk_vec3 irradiance;
    hyk_first_surface first;
    uint32_t instance, primitive; /* first hit, as hyk_hit */
    uint32_t flags;               /* HYK_LANE_... */
} hyi_lane;

typedef struct hyi_counters {
    uint64_t rays_camera, rays_bounce, rays_shadow, paths;
    double generate, intersect, shade, shadow;
} hyi_counters;

HYI_FN void hyi_clear_lane(hyi_lane *lane, bool used) {
    memset(lane, 0, sizeof *lane);
    lane->instance = lane->primitive = HYK_NONE;
    lane->first.material = HYK_NONE;
    lane->flags = used ? HYK_LANE_USED : 0u;
}

#endif /* HYI_CHUNK_H */
