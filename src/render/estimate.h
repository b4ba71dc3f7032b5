/* >>render-estimate: what a render would take, by the very functions that will take it */
#ifndef HYI_ESTIMATE_H
#define HYI_ESTIMATE_H

#include "render.h"

HYI_FN uint32_t hyi_passes(uint32_t features) {
    uint32_t passes = HYDRA_PASS_GENERATE | HYDRA_PASS_INTERSECT | HYDRA_PASS_SHADE | HYDRA_PASS_ACCUMULATE;
    const uint32_t lights = HYK_NEEDS_EMITTERS | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT;
    if (features & HYK_NEEDS_SHAPES) passes |= HYDRA_PASS_SHAPES;
    if (features & lights) passes |= HYDRA_PASS_SHADOW; /* lights without extent are sampled whatever the strategy */
    return passes;
}

HYDRA_API hydra_result hydra_estimate(hydra_scene *scene, const hydra_render_desc *desc, hydra_estimate_result *estimate) {
    HYI_TRY(hyi_check_committed(scene));
    if (!desc || !estimate) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "hydra_estimate: the desc or the result");
    HYI_TRY(hyi_check_render_desc(scene->context, desc));
    hydra_render_desc resolved = hyi_resolved_render_desc(desc);
    hyi_film film;
    hyi_plan_render(&resolved, &film);
    uint32_t features = scene->view.constants.features;
    estimate->bytes_film = hyi_film_bytes(&film) + hyi_schedule_bytes(&film, resolved.target_error > 0.0f);
    estimate->bytes_lanes = scene->context->threads * hyi_worker_bytes(scene, &film);
    estimate->bytes_sensor = hyi_sensor_bytes(resolved.sensor.kind, (uint64_t)resolved.width * resolved.height);
    estimate->bytes_total = sizeof(hydra_render) + estimate->bytes_film + estimate->bytes_lanes + estimate->bytes_sensor;
    estimate->passes = hyi_passes(features);
    estimate->kernel_features = hyi_kernel_features(features);
    return HYDRA_OK;
}

#endif /* HYI_ESTIMATE_H */
