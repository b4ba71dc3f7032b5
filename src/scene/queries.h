/* >>scene-queries: the caller's own rays */
#ifndef HYI_QUERIES_H
#define HYI_QUERIES_H

#include "commit.h"

#define HYI_QUERY_BATCH 65536u /* rays whose answers are still near when light shapes are looked for */

HYI_STATIC_ASSERT(sizeof(hydra_ray) == sizeof(hyk_ray) && offsetof(hydra_ray, t_max) == offsetof(hyk_ray, t_max));

/* Tells the caller what a backend found. */
HYI_FN void hyi_tell_hits(const hydra_scene *scene, const hyk_hit *found, const hydra_ray *rays, hydra_hit *hits, uint32_t count) {
    const hyi_accel *accel = &scene->accel;
    for (uint32_t i = 0; i < count; i++) {
        if (found[i].instance == HYK_HIT_SHAPE) {
            hyi_tell_shape(accel, found[i].primitive, found[i].t, (const hyk_ray *)(const void *)&rays[i], &hits[i]);
        } else if (found[i].instance != HYK_NONE) {
            hyi_tell_surface(accel, found[i], hyi_normal_of_hit(accel, found[i]), &hits[i]);
        } else {
            hyi_tell_miss(&hits[i]);
        }
    }
}

/* ---- the calls */

/* These do not write the context's error text, since many threads may call them. */
HYI_FN hydra_result hyi_check_query(const hydra_scene *scene, const void *rays, const void *answers, size_t count) {
    if (!scene || (count && (!rays || !answers))) return HYDRA_ERROR_NULL;
    return scene->dirty ? HYDRA_ERROR_NOT_COMMITTED : HYDRA_OK;
}

/* hits, or else occluded. */
HYI_INLINE hyi_answers hyi_answers_to(hydra_hit *hits, uint8_t *occluded) {
    hyi_answers answers;
    answers.hits = NULL;
    answers.told = hits;
    answers.occluded = occluded;
    return answers;
}

HYI_INLINE void hyi_ask_shapes(const hyi_accel *accel, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    if (!accel->shapes) return;
    if (answers->occluded) hyi_trace_shapes_any(accel, rays, answers->occluded, count);
    else hyi_trace_shapes_closest(accel, rays, NULL, answers->told, count, false);
}

/* ---- few rays, one by one: nothing is set up for them that only many need */

HYI_INLINE bool hyi_are_few(const hydra_scene *scene, size_t count) {
    return count < HYI_STREAM_LEAST && !scene->accel.empty && !scene->context->backend;
}

HYI_INLINE hydra_result hyi_query_few(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, uint32_t count) {
    const hyk_ray *from = (const hyk_ray *)(const void *)rays;
    hyi_answers answers = hyi_answers_to(hits, occluded);
    bool sound = hyi_trace_singles(&scene->accel, from, &answers, count);
    hyi_ask_shapes(&scene->accel, from, &answers, count);
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

/* ---- many */

/* hits, or else occluded, of the context's own threads: in the calling one. Without the memory for a stream rays go one by
   one. Quiet on failure: the error text is not a query's to write. */
HYI_FN bool hyi_query_here(const hydra_scene *scene, const hyk_ray *rays, const hyi_answers *answers, size_t count) {
    const hyi_accel *accel = &scene->accel;
    hyi_ray_stream stream;
    bool sound = true;
    (void)hyi_ray_stream_alloc(scene->context, accel, answers->occluded && count > HYI_STREAM_RAYS_ANY ? HYI_STREAM_RAYS_ANY : count, &stream);
    for (size_t first = 0; first < count; first += HYI_QUERY_BATCH) {
        uint32_t n = count - first < HYI_QUERY_BATCH ? (uint32_t)(count - first) : HYI_QUERY_BATCH;
        hyi_answers from = hyi_answers_from(answers, first);
        sound = hyi_trace(accel, &stream, rays + first, &from, n) && sound;
        hyi_ask_shapes(accel, rays + first, &from, n);
    }
    hyi_ray_stream_free(scene->context, &stream);
    return sound;
}

/* The same on a backend, whose hits wait in memory until they are told. */
HYI_FN hydra_result hyi_query_device(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    size_t batch = count < HYI_QUERY_BATCH ? count : HYI_QUERY_BATCH;
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

/* hits, or else occluded. Not inlined: calls with few rays would save registers for it. */
HYI_NOINLINE hydra_result hyi_query_all(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    if (scene->context->backend) return count ? hyi_query_device(scene, rays, hits, occluded, count) : HYDRA_OK;
    hyi_answers answers = hyi_answers_to(hits, occluded);
    return hyi_query_here(scene, (const hyk_ray *)(const void *)rays, &answers, count) ? HYDRA_OK : HYDRA_ERROR_RAY;
}

HYDRA_API hydra_result hydra_scene_closest_hits(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, hits, count));
    if (hyi_are_few(scene, count)) return hyi_query_few(scene, rays, hits, NULL, (uint32_t)count);
    return hyi_query_all(scene, rays, hits, NULL, count);
}

HYDRA_API hydra_result hydra_scene_any_hits(const hydra_scene *scene, const hydra_ray *rays, uint8_t *occluded, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, occluded, count));
    if (hyi_are_few(scene, count)) return hyi_query_few(scene, rays, NULL, occluded, (uint32_t)count);
    return hyi_query_all(scene, rays, NULL, occluded, count);
}

#endif /* HYI_QUERIES_H */
