/* >>base-backend: what a context offers that computes elsewhere than on its threads

   Scenes, films, schedules and error bars are the host's; a backend is told when a scene was committed, traces rays, and
   takes units of a render's round and hands their lanes to hyi_accumulate, or adds them up in a film of its own. */
#ifndef HYI_BACKEND_H
#define HYI_BACKEND_H

#include "threads.h"

struct hyk_hit;

/* Any of them may be called only while the object it is about lives. Those that fail say why in the context's text, but
   for trace, which many threads may call. */
typedef struct hyi_backend {
    void (*destroy)(hydra_context *context);
    /* dirty: HYI_DIRTY_... since the last commit that succeeded. */
    hydra_result (*commit)(hydra_scene *scene, uint32_t dirty);
    void (*forget_scene)(hydra_scene *scene);
    hydra_result (*begin_render)(hydra_render *render);
    void (*end_render)(hydra_render *render);
    /* Takes units of the round until it is empty or time is up; all that were taken are finished on return. */
    hydra_result (*work)(hydra_render *render);
    /* Brings the film of the render up to date, of which samples may be elsewhere. to_change: the caller then changes it. */
    hydra_result (*sync_film)(const hydra_render *render, bool to_change);
    /* The mean luminance of each of the film's pixels, good until the next call for that render; *luminance NULL: the host's
       film tells it. */
    hydra_result (*measure_film)(hydra_render *render, const double **luminance);
    /* hits, or else occluded; light shapes included. HYDRA_ERROR_RAY: some were not sound; they meet nothing. */
    hydra_result (*trace)(const hydra_scene *scene, const hydra_ray *rays, struct hyk_hit *hits, uint8_t *occluded, uint32_t count);
} hyi_backend;

#endif /* HYI_BACKEND_H */
