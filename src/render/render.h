/* >>render: a picture in progress: creation, steps, cancelling */
#ifndef HYI_RENDER_H
#define HYI_RENDER_H

#include "../backend/cpu.h"
#include "../scene/commit.h"
#include "adaptive.h"
#include "sensor.h"

HYI_STATIC_ASSERT((int)HYK_STRATEGY_MIS == (int)HYDRA_STRATEGY_MIS && (int)HYK_STRATEGY_LIGHTS == (int)HYDRA_STRATEGY_LIGHTS &&
                  (int)HYK_STRATEGY_BSDF == (int)HYDRA_STRATEGY_BSDF);

/* Error figures of the picture at some moment (statistics.h); making them costs a pass over all pixels. */
typedef struct hyi_error_report {
    double error, low, high;
    uint64_t heavy_pixels, dropped_samples;
    double made_at, cost; /* seconds of rendering when made; seconds it took; made_at < 0: never */
} hyi_error_report;

/* Samples that came with films made elsewhere. */
#define HYI_MAX_RANGES 64
typedef struct hyi_sample_range { uint32_t first, end; } hyi_sample_range;

struct hydra_render {
    hydra_context *context;
    hydra_scene *scene;
    hydra_render_desc desc; /* sensor views are not valid after create */
    hyi_picture picture;
    hyi_sensor sensor;
    hyi_film film;
    hyi_schedule schedule;
    hyi_sample_range ranges[HYI_MAX_RANGES];
    uint32_t range_count;
    hyi_batch *batches; /* one a worker */
    void *device;       /* the backend's */
    uint32_t workers;
    double *accumulate; /* seconds, by worker */
    hyi_atomic cancel;
    bool done;
    double seconds, step_deadline;
    hyi_error_report report;
};

/* ---- checks of the descriptor */

HYI_FN hydra_result hyi_check_frame(hydra_context *context, const hydra_render_desc *d) {
    const uint32_t *r = d->region;
    if (d->width == 0 || d->height == 0) return hyi_fail(context, HYDRA_ERROR_SIZE, "%u x %u pixels", d->width, d->height);
    if ((r[2] == 0) != (r[3] == 0) || (!r[2] && (r[0] || r[1]))) return hyi_fail(context, HYDRA_ERROR_SIZE, "region of %u x %u pixels", r[2], r[3]);
    if ((uint64_t)r[0] + r[2] > d->width || (uint64_t)r[1] + r[3] > d->height)
        return hyi_fail(context, HYDRA_ERROR_SIZE, "region %u, %u, %u x %u reaches beyond %u x %u pixels", r[0], r[1], r[2], r[3], d->width, d->height);
    if (!hyi_is_list(d->sensor.kind) && (d->width > 65536 || d->height > 65536)) return hyi_fail(context, HYDRA_ERROR_SIZE, "%u x %u pixels, the most is 65536 a side", d->width, d->height);
    if ((uint64_t)d->width * d->height > (uint64_t)1 << 36) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u x %u pixels", d->width, d->height);
    if (d->tile_size != 0 && d->tile_size != 8 && d->tile_size != 16) return hyi_fail(context, HYDRA_ERROR_SIZE, "tile_size is %u, not 8 or 16", d->tile_size);
    return HYDRA_OK;
}

HYI_FN bool hyi_is_sound_time(double seconds) { return seconds >= 0.0 && seconds <= 1e15; }

HYI_FN hydra_result hyi_check_budget(hydra_context *context, const hydra_render_desc *d) {
    if (!(d->target_error >= 0.0f) || !hyi_is_finite(d->target_error)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "target_error is %g", (double)d->target_error);
    if (!hyi_is_sound_time(d->time_budget)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "time_budget is %g", d->time_budget);
    if (!hyi_is_sound_time(d->step_seconds)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "step_seconds is %g", d->step_seconds);
    if (d->max_samples % 2 || d->first_sample % 2) return hyi_fail(context, HYDRA_ERROR_BUDGET, "samples %u to %u: both must be even", d->first_sample, d->max_samples);
    if (d->max_samples > 0x7ffffff0u) return hyi_fail(context, HYDRA_ERROR_BUDGET, "max_samples is %u", d->max_samples);
    if (d->first_sample && (d->max_samples <= d->first_sample || d->target_error > 0.0f))
        return hyi_fail(context, HYDRA_ERROR_BUDGET, "first_sample needs a greater max_samples and no target_error");
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_render_desc(hydra_context *context, const hydra_render_desc *d) {
    HYI_TRY(hyi_check_frame(context, d));
    HYI_TRY(hyi_check_budget(context, d));
    HYI_TRY(hyi_check_enum(context, (int)d->strategy, HYDRA_STRATEGY_BSDF + 1, "strategy"));
    if (d->outputs >> HYDRA_OUTPUT_COUNT) return hyi_fail(context, HYDRA_ERROR_ENUM, "outputs is 0x%x", d->outputs);
    return hyi_check_sensor(context, &d->sensor, d->width, d->height);
}

HYI_FN hydra_render_desc hyi_resolved_render_desc(const hydra_render_desc *d) {
    hydra_render_desc r = *d;
    if (r.tile_size == 0) r.tile_size = 16;
    if (r.max_samples == 0) r.max_samples = r.target_error > 0.0f || r.time_budget > 0.0 ? 0x7ffffff0u : 64;
    if (r.max_depth == 0) r.max_depth = 0xffffffffu;
    if (r.step_seconds == 0.0) r.step_seconds = 0.05;
    return r;
}

/* ---- what outputs cost */

HYI_FN bool hyi_wants(const hydra_render_desc *d, hydra_output output) { return (d->outputs >> output & 1u) != 0; }

HYI_FN void hyi_plan_outputs(const hydra_render_desc *d, hyi_film *film) {
    const uint32_t components = 1u << HYDRA_DIRECT | 1u << HYDRA_INDIRECT | 1u << HYDRA_CAUSTIC;
    if (d->outputs & components) film->planes_wanted |= 1u << HYI_PLANE_DIRECT | 1u << HYI_PLANE_INDIRECT | 1u << HYI_PLANE_CAUSTIC;
    if (hyi_wants(d, HYDRA_IRRADIANCE) && d->sensor.kind != HYDRA_SENSOR_POINTS) film->planes_wanted |= 1u << HYI_PLANE_IRRADIANCE;
    if (hyi_wants(d, HYDRA_ALBEDO)) film->planes_wanted |= 1u << HYI_PLANE_ALBEDO;
    if (hyi_wants(d, HYDRA_NORMAL)) film->planes_wanted |= 1u << HYI_PLANE_NORMAL;
    if (hyi_wants(d, HYDRA_POSITION)) film->planes_wanted |= 1u << HYI_PLANE_POSITION;
    if (hyi_wants(d, HYDRA_DEPTH) || d->sensor.kind == HYDRA_SENSOR_POINTS) film->planes_wanted |= 1u << HYI_PLANE_DEPTH;
    film->ids_wanted = (d->outputs & (1u << HYDRA_PRIMITIVE_ID | 1u << HYDRA_INSTANCE_ID | 1u << HYDRA_MESH_ID | 1u << HYDRA_MATERIAL_ID)) != 0;
}

HYI_FN void hyi_plan_render(const hydra_render_desc *d, hyi_film *film) {
    hyi_plan_film(film, d->tile_size, d->width, d->height, d->region);
    film->first_sample = d->first_sample;
    hyi_plan_outputs(d, film);
}

HYI_FN uint32_t hyi_wants_of(const hyi_film *film) {
    uint32_t wants = 0;
    const uint32_t surface = 1u << HYI_PLANE_ALBEDO | 1u << HYI_PLANE_NORMAL | 1u << HYI_PLANE_POSITION | 1u << HYI_PLANE_DEPTH;
    if (film->planes_wanted & 1u << HYI_PLANE_DIRECT) wants |= HYK_WANTS_COMPONENTS;
    if (film->planes_wanted & 1u << HYI_PLANE_IRRADIANCE) wants |= HYK_WANTS_IRRADIANCE;
    if (film->planes_wanted & surface || film->ids_wanted) wants |= HYK_WANTS_SURFACE;
    return wants;
}

HYI_FN size_t hyi_schedule_bytes(const hyi_film *film, bool adaptive) {
    return 2 * hyi_film_tile_count(film) * sizeof(uint32_t) + (adaptive ? hyi_film_pixel_count(film) * sizeof(float) : 0);
}
HYI_FN size_t hyi_worker_bytes(const hydra_scene *scene, const hyi_film *film) {
    size_t lanes = (size_t)film->tile_pixels * HYI_CHUNK_SAMPLES, bytes = sizeof(hyi_batch) + sizeof(double);
    if (scene->context->backend) return bytes + lanes * sizeof(hyi_lane);
    hyi_ray_stream stream = hyi_plan_ray_stream(&scene->accel, lanes);
    return bytes + lanes * HYI_LANE_BYTES + hyi_ray_stream_bytes(&stream);
}

/* ---- creation */

HYI_FN void hyi_fill_picture(hydra_render *r) {
    hyi_picture *p = &r->picture;
    hyk_picture *k = &p->kernel;
    p->view = &r->scene->view;
    p->accel = &r->scene->accel;
    k->settings.strategy = (uint32_t)r->desc.strategy;
    k->settings.wants = hyi_wants_of(&r->film);
    k->tile_pixels = r->film.tile_pixels;
    k->tile_width = r->film.tile_width;
    k->tile_is_square = r->film.tile_width == r->film.tile_height;
    k->left = r->film.left;
    k->top = r->film.top;
    k->right = r->film.right;
    k->bottom = r->film.bottom;
    k->max_depth = r->desc.max_depth;
    k->seed_even = hyk_hash2(r->desc.seed, 0x68616c66u);
    k->seed_odd = hyk_hash2(r->desc.seed, 0x6f746872u);
    p->point_positions = r->sensor.positions;
    p->point_normals = r->sensor.normals;
    p->rays = r->sensor.rays;
    p->features = r->scene->view.constants.features;
}

HYI_FN hydra_result hyi_schedule_alloc(hydra_render *r) {
    hyi_schedule *s = &r->schedule;
    size_t tiles = hyi_film_tile_count(&r->film);
    s->target = r->desc.target_error;
    s->total_chunks = (r->desc.max_samples - r->desc.first_sample + HYI_CHUNK_SAMPLES - 1) / HYI_CHUNK_SAMPLES;
    HYI_TRY(hyi_alloc_array(r->context, &s->active, tiles));
    HYI_TRY(hyi_alloc_array(r->context, &s->base, tiles));
    if (!(s->target > 0.0f)) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(r->context, &s->weights, hyi_film_pixel_count(&r->film)));
    memset(s->weights, 0, hyi_film_pixel_count(&r->film) * sizeof *s->weights);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_workers_alloc(hydra_render *r) {
    uint32_t count = r->context->threads;
    HYI_TRY(hyi_alloc_array(r->context, &r->batches, count));
    memset(r->batches, 0, count * sizeof *r->batches);
    r->workers = count;
    HYI_TRY(hyi_alloc_array(r->context, &r->accumulate, count));
    memset(r->accumulate, 0, count * sizeof *r->accumulate);
    for (uint32_t i = 0; i < count; i++) HYI_TRY(hyi_batch_alloc(r->context, &r->scene->accel, r->film.tile_pixels * HYI_CHUNK_SAMPLES, &r->batches[i]));
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_render_fill(hydra_render *r, const hydra_render_desc *desc) {
    r->desc = hyi_resolved_render_desc(desc);
    r->report.made_at = -1.0;
    HYI_TRY(hyi_fill_camera(r->context, &r->desc.sensor, r->desc.width, r->desc.height, &r->picture.kernel.camera));
    hyi_film planned;
    hyi_plan_render(&r->desc, &planned);
    if (hyi_film_pixel_count(&planned) > (size_t)UINT32_MAX * planned.tile_pixels) return hyi_fail(r->context, HYDRA_ERROR_OVERFLOW, "%u x %u pixels", r->desc.width, r->desc.height);
    HYI_TRY(hyi_take_sensor(r->context, &r->desc.sensor, (uint64_t)r->desc.width * r->desc.height, &r->sensor));
    HYI_TRY(hyi_film_alloc(r->context, &planned));
    r->film = planned;
    HYI_TRY(hyi_schedule_alloc(r));
    HYI_TRY(hyi_workers_alloc(r));
    hyi_fill_picture(r);
    return r->context->backend ? r->context->backend->begin_render(r) : HYDRA_OK;
}

HYDRA_API void hydra_render_destroy(hydra_render *render) {
    if (!render) return;
    hydra_context *context = render->context;
    if (context->backend) context->backend->end_render(render);
    for (uint32_t i = 0; render->batches && i < render->workers; i++) hyi_batch_free(context, &render->batches[i]);
    hyi_free_array(context, &render->batches, render->workers);
    hyi_free_array(context, &render->accumulate, render->workers);
    hyi_free_array(context, &render->schedule.active, hyi_film_tile_count(&render->film));
    hyi_free_array(context, &render->schedule.base, hyi_film_tile_count(&render->film));
    hyi_free_array(context, &render->schedule.weights, hyi_film_pixel_count(&render->film));
    hyi_film_free(context, &render->film);
    hyi_sensor_free(context, &render->sensor);
    render->scene->renders_living--;
    hyi_free_array(context, &render, 1);
}

HYDRA_API hydra_render *hydra_render_create(hydra_scene *scene, const hydra_render_desc *desc) {
    if (!scene) return NULL;
    if (!desc) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "hydra_render_create: the desc"), (hydra_render *)NULL;
    if (hyi_check_committed(scene) != HYDRA_OK || hyi_check_render_desc(scene->context, desc) != HYDRA_OK) return NULL;
    hydra_render *render;
    if (hyi_alloc_array(scene->context, &render, 1) != HYDRA_OK) return NULL;
    memset(render, 0, sizeof *render);
    render->context = scene->context;
    render->scene = scene;
    scene->renders_living++;
    if (hyi_render_fill(render, desc) == HYDRA_OK) return render;
    hydra_render_destroy(render);
    return NULL;
}

/* ---- one unit of work: a chunk of a tile */

HYI_FN uint32_t hyi_chunk_samples(const hydra_render *r, uint32_t chunk) {
    uint32_t first = r->film.first_sample + chunk * HYI_CHUNK_SAMPLES, left = r->desc.max_samples - first;
    return left < HYI_CHUNK_SAMPLES ? left : HYI_CHUNK_SAMPLES;
}

HYI_FN hyk_unit hyi_describe_unit(const hydra_render *r, uint32_t tile, uint32_t chunk) {
    hyk_unit unit;
    unit.tile_x = hyi_tile_left(&r->film, tile);
    unit.tile_y = hyi_tile_top(&r->film, tile);
    unit.first_sample = r->film.first_sample + chunk * HYI_CHUNK_SAMPLES;
    unit.samples = hyi_chunk_samples(r, chunk);
    return unit;
}

/* Whether its samples are evidence for the verdict on their tile. */
HYI_FN bool hyi_unit_is_judged(const hydra_render *r, const hyk_unit *unit) {
    return r->schedule.weights && r->schedule.stage > 0 && unit->samples >= 4;
}

HYI_FN void hyi_keep_ids(hydra_render *r, size_t index, const hyi_lane *lane) {
    hyi_ids *ids = &r->film.ids[index];
    if (lane->instance >= HYK_HIT_SHAPE) return;
    ids->primitive = lane->primitive;
    ids->instance = r->scene->placed_ids[lane->instance];
    ids->mesh = r->scene->placed[lane->instance].mesh + 1;
    ids->material = lane->first.material == HYK_NONE ? 0 : lane->first.material;
}

HYI_FN void hyi_accumulate_pixel(hydra_render *r, const hyi_tile *tile, const hyk_unit *unit, size_t index, hyi_lane *lanes, double *judgement) {
    float luminance[HYI_CHUNK_SAMPLES];
    if (r->film.ids && unit->first_sample == r->film.first_sample) hyi_keep_ids(r, index, &lanes[0]);
    uint32_t group = hyi_group_of(index);
    bool open = !(tile->closed >> group & 1u);
    for (uint32_t s = 0; s < unit->samples; s++) luminance[s] = hyi_film_add(&r->film, index, (int)(s & 1), open, &lanes[s]);
    if (!r->schedule.weights) return;
    double weight = (double)r->schedule.weights[index];
    judgement[group] += weight * weight * hyi_chunk_variance(luminance, unit->samples);
}

/* A tile has got a chunk. judgement: by group, the weighted variance of its pixels. */
HYI_FN void hyi_count_unit(const hydra_render *r, hyi_tile *tile, const hyk_unit *unit, const double judgement[HYI_GROUPS]) {
    for (uint32_t g = 0; g < HYI_GROUPS; g++)
        if (!(tile->closed >> g & 1u)) tile->reported[g] += unit->samples;
    tile->taken += unit->samples;
    tile->chunks++;
    if (!hyi_unit_is_judged(r, unit)) return;
    for (uint32_t g = 0; g < HYI_GROUPS; g++) hyi_sum_add(&tile->statistic[g], judgement[g]);
    tile->judged++;
}

/* The order in which chunks arrive does not matter: every sum is exact. */
HYI_FN void hyi_accumulate(hydra_render *r, uint32_t tile_index, const hyk_unit *unit, hyi_lane *lanes) {
    hyi_tile *tile = &r->film.tiles[tile_index];
    double judgement[HYI_GROUPS] = { 0.0 };
    while (!hyi_atomic_swap_if(&tile->lock, 0, 1)) continue;
    for (uint32_t p = 0; p < r->film.tile_pixels; p++) {
        hyi_lane *first = &lanes[p * unit->samples];
        if (first->flags & HYK_LANE_USED) hyi_accumulate_pixel(r, tile, unit, (size_t)tile_index * r->film.tile_pixels + p, first, judgement);
    }
    hyi_count_unit(r, tile, unit, judgement);
    hyi_atomic_store(&tile->lock, 0);
}

HYI_FN void hyi_run_unit(hydra_render *r, uint32_t worker, uint32_t tile, uint32_t chunk) {
    hyi_batch *batch = &r->batches[worker];
    hyk_unit unit = hyi_describe_unit(r, tile, chunk);
    hyi_cpu_trace_unit(&r->picture, &unit, batch);
    double start = hyi_seconds();
    hyi_accumulate(r, tile, &unit, batch->lanes);
    r->accumulate[worker] += hyi_seconds() - start;
}

/* ---- steps */

HYI_FN bool hyi_must_stop(const hydra_render *r) { return hyi_atomic_load(&r->cancel) || hyi_seconds() >= r->step_deadline; }

/* Takes units of the round until it is empty or time is up; every unit that was taken is finished. */
HYI_FN void hyi_work(void *argument, uint32_t worker) {
    hydra_render *r = (hydra_render *)argument;
    hyi_schedule *s = &r->schedule;
    int64_t units = (int64_t)s->active_count * s->rounds_each;
    uint32_t target = hyi_stage_target(s);
    bool first = worker == 0; /* progress even when a step is shorter than a unit */
    while (first || !hyi_must_stop(r)) {
        int64_t unit = hyi_atomic_add(&s->next, 1);
        if (unit >= units) return;
        uint32_t slot = (uint32_t)(unit % s->active_count);
        uint32_t chunk = s->base[slot] + (uint32_t)(unit / s->active_count);
        if (chunk < target) hyi_run_unit(r, worker, s->active[slot], chunk);
        first = false;
    }
}

/* To be called before the film's sums are read, or changed. */
HYI_FN hydra_result hyi_sync_film(const hydra_render *r, bool to_change) {
    return r->context->backend ? r->context->backend->sync_film(r, to_change) : HYDRA_OK;
}

HYI_FN hydra_result hyi_weigh(hydra_render *r) {
    const double *luminance = NULL;
    if (!hyi_lacks_weights(&r->schedule)) return HYDRA_OK;
    if (r->context->backend) HYI_TRY(r->context->backend->measure_film(r, &luminance));
    hyi_weigh_round(&r->schedule, &r->film, luminance);
    return HYDRA_OK;
}

HYI_FN bool hyi_time_is_up(const hydra_render *r, double step_start) {
    return r->desc.time_budget > 0.0 && r->seconds + (hyi_seconds() - step_start) >= r->desc.time_budget;
}

HYI_FN hydra_result hyi_render_run(hydra_render *r, double start) {
    hyi_schedule *s = &r->schedule;
    do {
        bool round_left = s->active_count && hyi_atomic_load(&s->next) < (int64_t)s->active_count * s->rounds_each;
        if (!round_left && !hyi_next_round(s, &r->film)) {
            r->done = true;
            return HYDRA_OK;
        }
        HYI_TRY(hyi_weigh(r));
        if (r->context->backend) HYI_TRY(r->context->backend->work(r));
        else hyi_parallel(r->context, r->workers, hyi_work, r);
        if (hyi_atomic_load(&r->cancel)) {
            hyi_atomic_store(&r->cancel, 0);
            return HYDRA_CANCELLED;
        }
        if (hyi_time_is_up(r, start)) {
            r->done = true;
            return HYDRA_OK;
        }
    } while (hyi_seconds() < r->step_deadline);
    return HYDRA_MORE;
}

HYDRA_API hydra_result hydra_render_step(hydra_render *render) {
    if (!render) return HYDRA_ERROR_NULL;
    if (render->done) return HYDRA_OK;
    double start = hyi_seconds(), length = render->desc.step_seconds;
    if (render->desc.time_budget > 0.0 && render->desc.time_budget - render->seconds < length) length = render->desc.time_budget - render->seconds;
    render->step_deadline = start + length;
    hydra_result result = hyi_render_run(render, start);
    render->seconds += hyi_seconds() - start;
    return result;
}

HYDRA_API void hydra_render_cancel(hydra_render *render) {
    if (render) hyi_atomic_store(&render->cancel, 1);
}

#endif /* HYI_RENDER_H */
