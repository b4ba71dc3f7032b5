/* >>scene-queries: the caller's own rays */
#ifndef HYI_QUERIES_H
#define HYI_QUERIES_H

#include "../../shaders/shared/shape.h"
#include "../../shaders/shared/surface.h"
#include "commit.h"

#define HYI_QUERY_BATCH 256

HYI_STATIC_ASSERT(sizeof(hydra_ray) == sizeof(hyk_ray) && offsetof(hydra_ray, t_max) == offsetof(hyk_ray, t_max));

HYI_FN bool hyi_ray_is_sound(const hydra_ray *ray) {
    bool t_max_is_number = ray->t_max >= ray->t_min; /* infinity is allowed, NaN compares false */
    return hyi_all_finite(ray->origin, 3) && hyi_all_finite(ray->direction, 3) && !hyi_all_zero(ray->direction, 3) && hyi_is_finite(ray->t_min) &&
           t_max_is_number;
}

/* A batch of the caller's rays as kernels want them; an unsound ray becomes one that meets nothing. */
HYI_FN bool hyi_take_rays(const hydra_ray *rays, hyk_ray *taken, uint32_t count) {
    bool sound = true;
    memcpy(taken, rays, count * sizeof *taken);
    for (uint32_t i = 0; i < count; i++) {
        if (!(taken[i].t_max < FLT_MAX)) taken[i].t_max = FLT_MAX;
        if (hyi_ray_is_sound(&rays[i])) continue;
        sound = false;
        memset(&taken[i], 0, sizeof taken[i]);
        taken[i].direction.z = 1.0f;
        taken[i].t_min = FLT_MAX;
        taken[i].t_max = -FLT_MAX;
    }
    return sound;
}

HYI_FN hyk_vec3 hyi_hit_normal(const hydra_scene *scene, const hyk_hit *hit, const hyk_ray *ray) {
    const hyk_scene_view *view = &scene->view;
    if (hit->instance == HYK_HIT_SHAPE) return hyk_shape_normal(view->lights[hit->primitive], hyk_add_scaled(ray->origin, ray->direction, hit->t));
    const hyk_instance *placed = &view->instances[hit->instance];
    hyk_corners corners = hyk_load_corners(view, placed->mesh, *hit);
    hyk_vec3 n = hyk_face_normal(corners.edge1, corners.edge2);
    return (placed->flags & HYK_INSTANCE_IDENTITY) ? n : hyk_normalize(hyk_transform_normal(*placed, n));
}

HYI_FN hydra_hit hyi_public_hit(const hydra_scene *scene, const hyk_hit *hit, const hyk_ray *ray) {
    hydra_hit out;
    memset(&out, 0, sizeof out);
    out.t = -1.0f;
    out.primitive = HYDRA_NONE;
    if (hit->instance == HYK_NONE) return out;
    hyk_vec3 n = hyi_hit_normal(scene, hit, ray);
    out.t = hit->t;
    out.normal[0] = n.x;
    out.normal[1] = n.y;
    out.normal[2] = n.z;
    if (hit->instance == HYK_HIT_SHAPE) {
        out.light = scene->light_ids[hit->primitive];
        return out;
    }
    out.u = hit->u;
    out.v = hit->v;
    out.primitive = hit->primitive;
    out.mesh = scene->placed[hit->instance].mesh + 1;
    out.instance = scene->placed_ids[hit->instance];
    return out;
}

/* These do not write the context's error text, since many threads may call them. */
HYI_FN hydra_result hyi_check_query(const hydra_scene *scene, const void *rays, const void *answers, size_t count) {
    if (!scene || (count && (!rays || !answers))) return HYDRA_ERROR_NULL;
    return scene->dirty ? HYDRA_ERROR_NOT_COMMITTED : HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_closest_hits(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, hits, count));
    hyk_ray batch[HYI_QUERY_BATCH];
    hyk_hit found[HYI_QUERY_BATCH];
    bool sound = true;
    for (size_t first = 0; first < count; first += HYI_QUERY_BATCH) {
        uint32_t n = count - first < HYI_QUERY_BATCH ? (uint32_t)(count - first) : HYI_QUERY_BATCH;
        sound = hyi_take_rays(rays + first, batch, n) && sound;
        hyi_trace_closest(&scene->accel, batch, found, n);
        if (scene->accel.shapes) hyi_trace_shapes_closest(&scene->accel, batch, found, n, false);
        for (uint32_t i = 0; i < n; i++) hits[first + i] = hyi_public_hit(scene, &found[i], &batch[i]);
    }
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

HYDRA_API hydra_result hydra_scene_any_hits(const hydra_scene *scene, const hydra_ray *rays, uint8_t *occluded, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, occluded, count));
    hyk_ray batch[HYI_QUERY_BATCH];
    bool sound = true;
    for (size_t first = 0; first < count; first += HYI_QUERY_BATCH) {
        uint32_t n = count - first < HYI_QUERY_BATCH ? (uint32_t)(count - first) : HYI_QUERY_BATCH;
        sound = hyi_take_rays(rays + first, batch, n) && sound;
        hyi_trace_any(&scene->accel, batch, occluded + first, n);
        if (scene->accel.shapes) hyi_trace_shapes_any(&scene->accel, batch, occluded + first, n);
    }
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

#endif /* HYI_QUERIES_H */
