/* >>scene-queries: the caller's own rays */
#ifndef HYI_QUERIES_H
#define HYI_QUERIES_H

#include "../../shaders/shared/shape.h"
#include "../../shaders/shared/surface.h"
#include "commit.h"

#define HYI_QUERY_BATCH 256u /* rays a time without memory of the context's */

HYI_STATIC_ASSERT(sizeof(hydra_ray) == sizeof(hyk_ray) && offsetof(hydra_ray, t_max) == offsetof(hyk_ray, t_max));

/* ---- answers */

HYI_FN void hyi_shape_hit(const hydra_scene *scene, const hyk_hit *hit, const hydra_ray *at, hydra_hit *out) {
    hyk_vec3 origin = hyk_make3(at->origin[0], at->origin[1], at->origin[2]), direction = hyk_make3(at->direction[0], at->direction[1], at->direction[2]);
    hyk_vec3 n = hyk_shape_normal(scene->view.lights[hit->primitive], hyk_add_scaled(origin, direction, hit->t));
    out->primitive = HYDRA_NONE;
    out->mesh = out->instance = 0;
    out->light = scene->light_ids[hit->primitive];
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

/* Squares of products of floats stay in double's range, so nothing has to be scaled. */
HYI_INLINE void hyi_unit_normal(const float *a, const float *b, const float *c, float normal[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
    }
    double x = e[1] * f[2] - e[2] * f[1], y = e[2] * f[0] - e[0] * f[2], z = e[0] * f[1] - e[1] * f[0];
    double inverse = 1.0 / sqrt(x * x + y * y + z * z);
    normal[0] = (float)(x * inverse);
    normal[1] = (float)(y * inverse);
    normal[2] = (float)(z * inverse);
}

HYI_INLINE void hyi_surface_hit(const hydra_scene *scene, const hyk_hit *hit, hydra_hit *out) {
    const hyk_instance *placed = &scene->placed[hit->instance];
    const hyk_mesh_arrays *arrays = &scene->view_arrays[placed->mesh];
    const uint32_t *index = arrays->indices + 3u * (size_t)hit->primitive;
    hyi_unit_normal(arrays->positions + 3u * (size_t)index[0], arrays->positions + 3u * (size_t)index[1], arrays->positions + 3u * (size_t)index[2], out->normal);
    out->primitive = hit->primitive;
    out->mesh = placed->mesh + 1;
    out->instance = scene->placed_ids[hit->instance];
    out->light = 0;
    if (placed->flags & HYK_INSTANCE_IDENTITY) return;
    hyk_vec3 n = hyk_normalize(hyk_transform_normal(*placed, hyk_make3(out->normal[0], out->normal[1], out->normal[2])));
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

HYI_INLINE void hyi_public_hit(const hydra_scene *scene, const hyk_hit *hit, const hydra_ray *ray, hydra_hit *out) {
    out->t = hit->t;
    out->u = hit->u;
    out->v = hit->v;
    if (hit->instance == HYK_HIT_SHAPE) {
        hyi_shape_hit(scene, hit, ray, out);
    } else if (hit->instance != HYK_NONE) {
        hyi_surface_hit(scene, hit, out);
    } else {
        out->primitive = HYDRA_NONE;
        out->mesh = out->instance = out->light = 0;
        out->normal[0] = out->normal[1] = out->normal[2] = 0.0f;
    }
}

/* Asks for the corners of a hit triangle, or first for the numbers of its corners. */
HYI_INLINE void hyi_prefetch_hit(const hydra_scene *scene, const hyk_hit *hit, bool corners) {
    if (hit->instance == HYK_NONE || hit->instance == HYK_HIT_SHAPE) return;
    const hyk_mesh_arrays *arrays = &scene->view_arrays[scene->placed[hit->instance].mesh];
    const uint32_t *index = arrays->indices + 3u * (size_t)hit->primitive;
    if (!corners) hyi_prefetch(index);
    for (int i = 0; corners && i < 3; i++) hyi_prefetch(arrays->positions + 3u * (size_t)index[i]);
}

HYI_FN void hyi_tell_hits(const hydra_scene *scene, const hyk_hit *found, const hydra_ray *rays, hydra_hit *hits, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (i + 16u < count) hyi_prefetch_hit(scene, &found[i + 16u], false);
        if (i + 8u < count) hyi_prefetch_hit(scene, &found[i + 8u], true);
        hyi_public_hit(scene, &found[i], &rays[i], &hits[i]);
    }
}

/* ---- the calls */

/* These do not write the context's error text, since many threads may call them. */
HYI_FN hydra_result hyi_check_query(const hydra_scene *scene, const void *rays, const void *answers, size_t count) {
    if (!scene || (count && (!rays || !answers))) return HYDRA_ERROR_NULL;
    return scene->dirty ? HYDRA_ERROR_NOT_COMMITTED : HYDRA_OK;
}

/* One query: its memory, and how many rays it goes through at a time. */
typedef struct hyi_query {
    const hydra_scene *scene;
    hyi_ray_stream stream;
    hyk_hit *found;
    size_t batch, found_count;
} hyi_query;

HYI_FN void hyi_query_end(hyi_query *query) {
    hyi_ray_stream_free(query->scene->context, &query->stream);
    hyi_free_array(query->scene->context, &query->found, query->found_count);
}

/* Without the memory for it, rays go one by one. Quiet on failure: the error text is not a query's to write. */
HYI_FN hyi_query hyi_query_begin(const hydra_scene *scene, size_t count, bool any) {
    hyi_query query;
    memset(&query, 0, sizeof query);
    query.scene = scene;
    query.batch = HYI_QUERY_BATCH;
    if (count < HYI_STREAM_LEAST || hyi_ray_stream_alloc(scene->context, &scene->accel, count, &query.stream) != HYDRA_OK) return query;
    size_t batch = count < HYI_STREAM_SORTED ? count : HYI_STREAM_SORTED;
    bool whole = any || (query.stream.capacity > 0 && hyi_try_alloc(scene->context, batch * sizeof *query.found, (void **)&query.found) == HYDRA_OK);
    if (whole) query.batch = batch;
    if (query.found) query.found_count = batch;
    return query;
}

HYI_FN bool hyi_query_closest(hyi_query *query, const hydra_ray *rays, hydra_hit *hits, uint32_t count) {
    const hydra_scene *scene = query->scene;
    const hyk_ray *at = (const hyk_ray *)(const void *)rays;
    hyk_hit here[HYI_QUERY_BATCH], *found = query->found ? query->found : here;
    bool sound = hyi_trace_closest(&scene->accel, &query->stream, at, found, count);
    if (scene->accel.shapes) hyi_trace_shapes_closest(&scene->accel, at, found, count, false);
    hyi_tell_hits(scene, found, rays, hits, count);
    return sound;
}

HYI_FN bool hyi_query_any(hyi_query *query, const hydra_ray *rays, uint8_t *occluded, uint32_t count) {
    const hyk_ray *at = (const hyk_ray *)(const void *)rays;
    bool sound = hyi_trace_any(&query->scene->accel, &query->stream, at, occluded, count);
    if (query->scene->accel.shapes) hyi_trace_shapes_any(&query->scene->accel, at, occluded, count);
    return sound;
}

/* The same on a backend, whose hits wait in memory until they are told. */
HYI_FN hydra_result hyi_query_device(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    size_t batch = count < HYI_STREAM_SORTED ? count : HYI_STREAM_SORTED;
    hydra_result result = HYDRA_OK;
    hyk_hit *found = NULL;
    if (hits) HYI_TRY(hyi_try_alloc(scene->context, batch * sizeof *found, (void **)&found));
    for (size_t first = 0; first < count && (result == HYDRA_OK || result == HYDRA_ERROR_RAY); first += batch) {
        uint32_t n = count - first < batch ? (uint32_t)(count - first) : (uint32_t)batch;
        hydra_result part = scene->context->backend->trace(scene, rays + first, found, hits ? NULL : occluded + first, n);
        if (part != HYDRA_OK) result = part;
        if (hits && (part == HYDRA_OK || part == HYDRA_ERROR_RAY)) hyi_tell_hits(scene, found, rays + first, hits + first, n);
    }
    hyi_free_bytes(scene->context, found, batch * sizeof *found);
    return result;
}

/* hits, or else occluded. */
HYI_FN hydra_result hyi_query_all(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    if (scene->context->backend) return count ? hyi_query_device(scene, rays, hits, occluded, count) : HYDRA_OK;
    hyi_query query = hyi_query_begin(scene, count, hits == NULL);
    bool sound = true;
    for (size_t first = 0; first < count; first += query.batch) {
        uint32_t n = count - first < query.batch ? (uint32_t)(count - first) : (uint32_t)query.batch;
        if (hits) sound = hyi_query_closest(&query, rays + first, hits + first, n) && sound;
        else sound = hyi_query_any(&query, rays + first, occluded + first, n) && sound;
    }
    hyi_query_end(&query);
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

HYDRA_API hydra_result hydra_scene_closest_hits(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, hits, count));
    return hyi_query_all(scene, rays, hits, NULL, count);
}

HYDRA_API hydra_result hydra_scene_any_hits(const hydra_scene *scene, const hydra_ray *rays, uint8_t *occluded, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, occluded, count));
    return hyi_query_all(scene, rays, NULL, occluded, count);
}

#endif /* HYI_QUERIES_H */
