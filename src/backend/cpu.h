/* >>backend-cpu: the pass sequence on one worker's batch

   generate -> (intersect -> shapes -> shade -> shadow) until no path is left (Laine, Karras, Aila 2013: small kernels
   connected by buffers). A batch is a few hundred kilobytes, so that it stays in the worker's own cache; paths that end
   are squeezed out by shade as it writes the survivors. */
#ifndef HYI_CPU_H
#define HYI_CPU_H

#include "chunk.h"

typedef struct hyi_shadow {
    hyk_vec3 diffuse;
    uint32_t diffuse_component;
    hyk_vec3 specular;
    uint32_t specular_component;
    hyk_vec3 irradiance;
    uint32_t lane;
} hyi_shadow;

typedef struct hyi_batch {
    uint32_t capacity;
    uint32_t paths_alive, shadows_alive;
    hyk_path *paths;
    hyk_ray *rays;
    hyk_hit *hits;
    hyk_ray *shadow_rays;
    hyi_shadow *shadows;
    uint8_t *occluded;
    hyi_lane *lanes;
    hyi_ray_stream stream;
    hyi_counters counters;
} hyi_batch;

#define HYI_LANE_BYTES \
    (sizeof(hyk_path) + 2 * sizeof(hyk_ray) + sizeof(hyk_hit) + sizeof(hyi_shadow) + sizeof(uint8_t) + sizeof(hyi_lane))

HYI_FN void hyi_batch_free(hydra_context *context, hyi_batch *batch) {
    hyi_free_array(context, &batch->paths, batch->capacity);
    hyi_free_array(context, &batch->rays, batch->capacity);
    hyi_free_array(context, &batch->hits, batch->capacity);
    hyi_free_array(context, &batch->shadow_rays, batch->capacity);
    hyi_free_array(context, &batch->shadows, batch->capacity);
    hyi_free_array(context, &batch->occluded, batch->capacity);
    hyi_free_array(context, &batch->lanes, batch->capacity);
    hyi_ray_stream_free(context, &batch->stream);
}

/* Where a backend traces, only lanes are taken: it hands its results over in them. */
HYI_FN hydra_result hyi_batch_alloc(hydra_context *context, const hyi_accel *accel, uint32_t capacity, hyi_batch *batch) {
    memset(batch, 0, sizeof *batch);
    batch->capacity = capacity;
    HYI_TRY(hyi_alloc_array(context, &batch->lanes, capacity));
    if (context->backend) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &batch->paths, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->rays, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->hits, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->shadow_rays, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->shadows, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->occluded, capacity));
    hydra_result result = hyi_ray_stream_alloc(context, accel, capacity, &batch->stream);
    if (result == HYDRA_OK) return result;
    return hyi_fail(context, result, "ray streams for %u lanes", capacity);
}

/* ---- results */

HYI_INLINE void hyi_lane_add(hyi_lane *lane, uint32_t component, hyk_vec3 radiance) {
    lane->part[component] = hyk_add(lane->part[component], radiance);
}

/* What a vertex gave: light found, a shadow ray to cast, a path to go on with. */
HYI_INLINE void hyi_keep_scatter(hyi_batch *batch, const hyk_scatter *r, uint32_t lane_index, bool split) {
    hyi_lane *lane = &batch->lanes[lane_index];
    hyi_lane_add(lane, split ? r->emitted_component : 0, r->emitted);
    lane->irradiance = hyk_add(lane->irradiance, r->emitted_irradiance);
    if (r->flags & HYK_SCATTER_SURFACE) lane->first = r->first;
    if (r->flags & HYK_SCATTER_INSIDE) lane->flags |= HYK_LANE_INSIDE;
    if (r->flags & HYK_SCATTER_SHADOW) {
        hyi_shadow *shadow = &batch->shadows[batch->shadows_alive];
        shadow->diffuse = r->diffuse;
        shadow->diffuse_component = split ? r->diffuse_component : 0;
        shadow->specular = r->specular;
        shadow->specular_component = split ? r->specular_component : 0;
        shadow->irradiance = r->light_irradiance;
        shadow->lane = lane_index;
        batch->shadow_rays[batch->shadows_alive++] = r->shadow;
    }
    if (r->flags & HYK_SCATTER_CONTINUES) {
        batch->paths[batch->paths_alive] = r->next;
        batch->rays[batch->paths_alive++] = r->next.ray;
    }
}

/* ---- shade: one instantiation for each set of features that scenes commonly have */

HYI_INLINE void hyi_shade_batch(const hyi_picture *picture, hyi_batch *batch, uint32_t features) {
    uint32_t count = batch->paths_alive;
    bool split = (picture->kernel.settings.wants & HYK_WANTS_COMPONENTS) != 0;
    batch->paths_alive = batch->shadows_alive = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t lane = batch->paths[i].lane;
        hyk_scatter r = hyk_shade(picture->view, picture->kernel.settings, batch->paths[i], batch->hits[i], features);
        hyi_keep_scatter(batch, &r, lane, split);
    }
}

#define HYI_FEATURES_PLAIN (HYK_NEEDS_EMITTERS | HYK_NEEDS_SHAPES)
#define HYI_FEATURES_OUTDOOR (HYI_FEATURES_PLAIN | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT | HYK_NEEDS_ENVIRONMENT_MAP | HYK_NEEDS_SMOOTH_NORMALS)
#define HYI_FEATURES_TEXTURED (HYI_FEATURES_OUTDOOR | HYK_NEEDS_TEXTURES | HYK_NEEDS_NORMAL_MAPS | HYK_NEEDS_ALPHA | HYK_NEEDS_INSTANCES)
#define HYI_FEATURES_SPECULAR \
    (HYI_FEATURES_PLAIN | HYK_NEEDS_SPECULAR | HYK_NEEDS_TRANSMISSION | HYK_NEEDS_ABSORPTION | HYK_NEEDS_SMOOTH_NORMALS | HYK_NEEDS_INSTANCES)
#define HYI_FEATURES_EVERYTHING (HYI_FEATURES_TEXTURED | HYI_FEATURES_SPECULAR)
#define HYI_SHADE_KERNELS(X)               \
    X(plain, HYI_FEATURES_PLAIN)           \
    X(outdoor, HYI_FEATURES_OUTDOOR)       \
    X(textured, HYI_FEATURES_TEXTURED)     \
    X(specular, HYI_FEATURES_SPECULAR)     \
    X(everything, HYI_FEATURES_EVERYTHING)

#define HYI_DEFINE_SHADE(name, features) \
    HYI_NOINLINE void hyi_shade_##name(const hyi_picture *picture, hyi_batch *batch) { hyi_shade_batch(picture, batch, (features)); }
HYI_SHADE_KERNELS(HYI_DEFINE_SHADE)
#undef HYI_DEFINE_SHADE

/* The leanest kernel that has all the features; also what hydra_estimate reports. */
HYI_FN uint32_t hyi_kernel_features(uint32_t needs) {
#define HYI_IF_ENOUGH(name, features) if ((needs & ~(uint32_t)(features)) == 0) return (features);
    HYI_SHADE_KERNELS(HYI_IF_ENOUGH)
#undef HYI_IF_ENOUGH
    return HYI_FEATURES_EVERYTHING;
}

HYI_FN void hyi_shade(const hyi_picture *picture, hyi_batch *batch) {
    uint32_t kernel = hyi_kernel_features(picture->features);
#define HYI_CALL_SHADE(name, features) if (kernel == (features)) { hyi_shade_##name(picture, batch); return; }
    HYI_SHADE_KERNELS(HYI_CALL_SHADE)
#undef HYI_CALL_SHADE
}

/* ---- generate */

/* Paths from points start with a scattering at the point, not with a ray. */
HYI_FN void hyi_scatter_point(const hyi_picture *picture, hyi_batch *batch, hyk_sampler random, uint32_t lane, size_t point) {
    const float *p = picture->point_positions + 3 * point, *n = picture->point_normals + 3 * point;
    hyk_vec3 position = hyk_make3(p[0], p[1], p[2]), normal = hyk_make3(n[0], n[1], n[2]);
    hyk_path path = hyk_point_path(picture->kernel, random, lane);
    hyk_scatter r = hyk_shade_point(picture->view, picture->kernel.settings, path, position, normal, HYK_NEEDS_AT_POINTS);
    batch->lanes[lane].flags |= HYK_LANE_HIT;
    hyi_keep_scatter(batch, &r, lane, (picture->kernel.settings.wants & HYK_WANTS_COMPONENTS) != 0);
}

HYI_FN void hyi_generate_lane(const hyi_picture *picture, hyi_batch *batch, uint32_t x, uint32_t y, uint32_t sample, uint32_t lane) {
    const hyk_camera *camera = &picture->kernel.camera;
    size_t element = (size_t)y * camera->width + x; /* of a list */
    hyk_sampler random = hyk_lane_sampler(picture->kernel, x, y, sample);
    if (camera->kind == HYK_SENSOR_POINTS) {
        hyi_scatter_point(picture, batch, random, lane, element);
        return;
    }
    hyk_ray ray;
    if (camera->kind == HYK_SENSOR_RAYS) ray = hyk_callers_ray(hyi_load_ray((const hyk_ray *)(const void *)&picture->rays[element]));
    else ray = hyk_sensor_ray(*camera, x, y, random);
    batch->paths[batch->paths_alive] = hyk_first_path(picture->kernel, ray, random, lane, picture->features);
    batch->rays[batch->paths_alive] = batch->paths[batch->paths_alive].ray;
    batch->paths_alive++;
}

HYI_FN void hyi_generate(const hyi_picture *picture, const hyk_unit *unit, hyi_batch *batch) {
    const hyk_picture *k = &picture->kernel;
    batch->paths_alive = batch->shadows_alive = 0;
    for (uint32_t p = 0; p < k->tile_pixels; p++) {
        uint32_t x = unit->tile_x + hyk_tile_column(k->tile_width, k->tile_is_square, p);
        uint32_t y = unit->tile_y + hyk_tile_row(k->tile_width, k->tile_is_square, p);
        bool used = hyk_picture_holds(*k, x, y);
        for (uint32_t s = 0; s < unit->samples; s++) {
            uint32_t lane = p * unit->samples + s;
            hyi_clear_lane(&batch->lanes[lane], used);
            if (used) hyi_generate_lane(picture, batch, x, y, unit->first_sample + s, lane);
        }
    }
}

/* ---- shadow and intersect */

HYI_FN void hyi_shadow_pass(const hyi_picture *picture, hyi_batch *batch) {
    uint32_t count = batch->shadows_alive;
    if (!count) return;
    hyi_trace_any(picture->accel, &batch->stream, batch->shadow_rays, batch->occluded, count);
    if (picture->accel->shapes) hyi_trace_shapes_any(picture->accel, batch->shadow_rays, batch->occluded, count);
    for (uint32_t i = 0; i < count; i++) {
        if (batch->occluded[i]) continue;
        const hyi_shadow *shadow = &batch->shadows[i];
        hyi_lane *lane = &batch->lanes[shadow->lane];
        hyi_lane_add(lane, shadow->diffuse_component, shadow->diffuse);
        hyi_lane_add(lane, shadow->specular_component, shadow->specular);
        lane->irradiance = hyk_add(lane->irradiance, shadow->irradiance);
    }
    batch->counters.rays_shadow += count;
    batch->shadows_alive = 0;
}

HYI_FN void hyi_intersect_pass(const hyi_picture *picture, hyi_batch *batch, bool from_sensor) {
    hyi_trace_closest(picture->accel, &batch->stream, batch->rays, batch->hits, batch->paths_alive);
    if (picture->accel->shapes) hyi_trace_shapes_closest(picture->accel, batch->rays, batch->hits, NULL, batch->paths_alive, from_sensor);
}

HYI_FN void hyi_keep_first_hits(hyi_batch *batch) {
    for (uint32_t i = 0; i < batch->paths_alive; i++) {
        hyi_lane *lane = &batch->lanes[batch->paths[i].lane];
        const hyk_hit *hit = &batch->hits[i];
        lane->instance = hit->instance;
        lane->primitive = hit->primitive;
        if (hit->instance != HYK_NONE) lane->flags |= HYK_LANE_HIT;
    }
}

/* ---- the sequence */

HYI_FN void hyi_cpu_trace_unit(const hyi_picture *picture, const hyk_unit *unit, hyi_batch *batch) {
    hyi_counters *c = &batch->counters;
    double start = hyi_seconds(), now;
    hyi_generate(picture, unit, batch);
    bool from_sensor = picture->kernel.camera.kind != HYK_SENSOR_POINTS;
    if (from_sensor) c->rays_camera += batch->paths_alive;
    c->paths += (uint64_t)picture->kernel.tile_pixels * unit->samples;
    now = hyi_seconds(), c->generate += now - start, start = now;
    hyi_shadow_pass(picture, batch);
    now = hyi_seconds(), c->shadow += now - start, start = now;
    for (bool first = from_sensor; batch->paths_alive; first = false) {
        if (!first) c->rays_bounce += batch->paths_alive;
        hyi_intersect_pass(picture, batch, first);
        now = hyi_seconds(), c->intersect += now - start, start = now;
        if (first) hyi_keep_first_hits(batch);
        hyi_shade(picture, batch);
        now = hyi_seconds(), c->shade += now - start, start = now;
        hyi_shadow_pass(picture, batch);
        now = hyi_seconds(), c->shadow += now - start, start = now;
    }
}

#endif /* HYI_CPU_H */
