/* >>vk-passes: batches of units on the device, from their first rays to the film

   A batch is one dispatch of first rays and then rounds of trace, shade and shadow passes, whose sizes the device knows
   (indirect dispatches) and the host learns once a submission. Two batches are on their way at a time, so that the device
   works on one while the host adds up the other, where it is the host that does (film.h). Batches enter the film in the
   order in which they were taken: those that an error or a cancel cuts off are then simply given back to the schedule. */
#ifndef HYI_VK_PASSES_H
#define HYI_VK_PASSES_H

#include "film.h"

#define HYI_VK_BATCHES 2u
#define HYI_VK_UNITS_MOST 4096u           /* of a batch: what vkCmdUpdateBuffer takes */
#define HYI_VK_LANES_GPU (256u << 10)     /* of a batch: more than any device has at work at once */
#define HYI_VK_LANES_CPU (16u << 10)
#define HYI_VK_ROUNDS_MOST 24u            /* of a submission */
#define HYI_VK_GROWTH 4.0                 /* a batch grows by at most that from one to the next */
#define HYI_VK_FIRST_SHARE 0.5            /* of a slice, for the first round of a batch */

/* What the time between two marks was spent on. */
typedef enum hyi_vk_phase { HYI_VK_GENERATE, HYI_VK_INTERSECT, HYI_VK_SHADE, HYI_VK_SHADOW, HYI_VK_REST, HYI_VK_PHASES } hyi_vk_phase;

typedef struct hyi_vk_batch {
    hyi_vk_commands commands;
    hyi_vk_set set;
    hyi_vk_buffer buffers[HYK_PASS_BINDINGS]; /* PICTURE and SENSOR are the render's */
    hyi_vk_buffer told_counts, told_radiance, told_extras; /* what the host reads; the last two where it does not see the device's memory */
    hyi_vk_set film_set;                                   /* these where the film is on the device */
    hyi_vk_buffer chains, scatters, told_scatters;
    hyk_film_unit *film_units;
    hyk_unit *units;
    uint32_t *tiles; /* of each unit */
    uint32_t unit_count;
    int64_t first_taken; /* of the schedule's round */
    bool traced, reading;
    bool entering;       /* the device was told to add it to its film: no way back */
    int64_t next_after;  /* of the schedule, when it has entered; where a wait for that failed */
    double seconds;      /* of its submissions so far */
    hyi_vk_phase phases[HYI_VK_MARKS_MOST]; /* phases[i] ends at mark i + 1 */
} hyi_vk_batch;

typedef struct hyi_vk_render {
    hyi_vk *vk;
    hydra_render *render;
    hyi_vk_film film;
    hyi_vk_buffer picture, sensor;
    hyi_vk_batch batches[HYI_VK_BATCHES];
    uint32_t pool_lanes, lanes_of_unit, units_most, units_now;
    double rays_a_second; /* 0: not known yet */
    VkPipeline first, arguments, shade, paths, shadows;
    bool has_shadows, has_extras;
    const hyi_vk_batch *adding; /* for the threads that add up */
    hyi_atomic next_added;
} hyi_vk_render;

/* ---- creation */

/* Positions and then normals, or rays. */
HYI_FN hydra_result hyi_vk_send_sensor(hydra_render *render, hyi_vk_render *r) {
    const hyi_sensor *sensor = &render->sensor;
    size_t vectors = sensor->positions ? 12 * sensor->count : 0, rays = sensor->rays ? sizeof(hydra_ray) * sensor->count : 0;
    float *packed;
    HYI_TRY(hyi_vk_make_buffer(r->vk, &r->sensor, HYI_VK_DEVICE, 2 * vectors + rays, "points or rays of the sensor"));
    if (rays) return hyi_vk_send(r->vk, &r->sensor, sensor->rays, rays);
    if (!vectors) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(render->context, &packed, 6 * sensor->count));
    memcpy(packed, sensor->positions, vectors);
    memcpy(packed + 3 * sensor->count, sensor->normals, vectors);
    hydra_result result = hyi_vk_send(r->vk, &r->sensor, packed, 2 * vectors);
    hyi_free_array(render->context, &packed, 6 * sensor->count);
    return result;
}

HYI_FN VkDeviceSize hyi_vk_lane_bytes(uint32_t binding, const hyi_vk_render *r) {
    switch (binding) {
    case HYK_BINDING_QUEUES: return 12;
    case HYK_BINDING_PATHS: return sizeof(hyk_path);
    case HYK_BINDING_HITS: return sizeof(hyk_hit);
    case HYK_BINDING_SHADOWS: return r->has_shadows ? sizeof(hyk_shadow) : 0;
    case HYK_BINDING_RADIANCE: return sizeof(hyk_lane_radiance);
    case HYK_BINDING_EXTRAS: return r->has_extras ? sizeof(hyk_lane_extra) : 0;
    default: return 0;
    }
}

/* No larger than the picture, the device's bindings and an eighth of its memory. */
HYI_FN void hyi_vk_plan_pool(hydra_render *render, hyi_vk_render *r) {
    uint64_t lanes = r->vk->type == HYDRA_VK_DEVICE_CPU ? HYI_VK_LANES_CPU : HYI_VK_LANES_GPU;
    uint64_t all = (uint64_t)hyi_film_tile_count(&render->film) * render->schedule.total_chunks;
    uint64_t bound = r->vk->limits.maxStorageBufferRange / sizeof(hyk_path), share = hyi_vk_largest_heap(&r->vk->memory) / 8 / 400;
    lanes = lanes < bound ? lanes : bound;
    lanes = lanes < share ? lanes : share;
    uint64_t units = lanes / r->lanes_of_unit;
    units = units < all ? units : all;
    units = units < HYI_VK_UNITS_MOST ? units : HYI_VK_UNITS_MOST;
    r->units_most = units ? (uint32_t)units : 1u;
    r->units_now = 1;
    r->pool_lanes = r->units_most * r->lanes_of_unit;
}

HYI_FN hydra_result hyi_vk_make_batch_for_film(hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk *vk = r->vk;
    hyi_vk_buffer bound[HYK_FILM_BINDINGS];
    VkDeviceSize scatters = r->render->schedule.weights ? (VkDeviceSize)r->units_most * r->render->film.tile_pixels * sizeof(double) : 0;
    HYI_TRY(hyi_alloc_array(vk->context, &b->film_units, r->units_most));
    HYI_TRY(hyi_vk_make_buffer(vk, &b->chains, HYI_VK_DEVICE, r->units_most * sizeof *b->film_units, "units of the film"));
    HYI_TRY(hyi_vk_make_buffer(vk, &b->scatters, HYI_VK_DEVICE, scatters, "scatter of samples"));
    if (scatters && !b->scatters.mapped) HYI_TRY(hyi_vk_make_buffer(vk, &b->told_scatters, HYI_VK_READBACK, scatters, "scatter of samples"));
    HYI_TRY(hyi_vk_make_set(vk, vk->film_set_layout, HYK_FILM_BINDINGS, 0, &b->film_set));
    hyi_vk_bind_film(&r->film, &r->picture, bound);
    bound[HYK_BINDING_FILM_UNITS] = b->buffers[HYK_BINDING_UNITS];
    bound[HYK_BINDING_FILM_CHAINS] = b->chains;
    bound[HYK_BINDING_FILM_RADIANCE] = b->buffers[HYK_BINDING_RADIANCE];
    bound[HYK_BINDING_FILM_EXTRAS] = b->buffers[HYK_BINDING_EXTRAS];
    bound[HYK_BINDING_FILM_OUT] = b->scatters;
    hyi_vk_write_set(vk, &b->film_set, bound, HYK_FILM_BINDINGS);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_make_batch(hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk *vk = r->vk;
    hyi_vk_buffer bound[HYK_PASS_BINDINGS];
    HYI_TRY(hyi_alloc_array(vk->context, &b->units, r->units_most));
    HYI_TRY(hyi_alloc_array(vk->context, &b->tiles, r->units_most));
    HYI_TRY(hyi_vk_make_commands(vk, &b->commands));
    HYI_TRY(hyi_vk_make_buffer(vk, &b->buffers[HYK_BINDING_UNITS], HYI_VK_DEVICE, r->units_most * sizeof(hyk_unit), "units"));
    HYI_TRY(hyi_vk_make_buffer(vk, &b->buffers[HYK_BINDING_COUNTS], HYI_VK_DEVICE, sizeof(hyk_counts), "counts"));
    for (uint32_t i = HYK_BINDING_QUEUES; i < HYK_PASS_BINDINGS; i++)
        HYI_TRY(hyi_vk_make_buffer(vk, &b->buffers[i], HYI_VK_DEVICE, r->pool_lanes * hyi_vk_lane_bytes(i, r), "lanes"));
    HYI_TRY(hyi_vk_make_buffer(vk, &b->told_counts, HYI_VK_READBACK, sizeof(hyk_counts), "counts"));
    if (!r->film.here && !b->buffers[HYK_BINDING_RADIANCE].mapped)
        HYI_TRY(hyi_vk_make_buffer(vk, &b->told_radiance, HYI_VK_READBACK, b->buffers[HYK_BINDING_RADIANCE].size, "lanes"));
    if (!r->film.here && !b->buffers[HYK_BINDING_EXTRAS].mapped)
        HYI_TRY(hyi_vk_make_buffer(vk, &b->told_extras, HYI_VK_READBACK, b->buffers[HYK_BINDING_EXTRAS].size, "lanes"));
    HYI_TRY(hyi_vk_make_set(vk, vk->pass_layout, HYK_PASS_BINDINGS, 0, &b->set));
    memcpy(bound, b->buffers, sizeof bound);
    bound[HYK_BINDING_PICTURE] = r->picture;
    bound[HYK_BINDING_SENSOR] = r->sensor;
    hyi_vk_write_set(vk, &b->set, bound, HYK_PASS_BINDINGS);
    return r->film.here ? hyi_vk_make_batch_for_film(r, b) : HYDRA_OK;
}

/* What a picture asks of a kernel, without what makes no difference to that one, so that like pictures share it.
   The compilers of processors that pose as devices take seconds for shading: there it is made for a few sets of features,
   those of the host's own kernels. */
HYI_FN hydra_result hyi_vk_choose_pipeline(const hydra_render *render, hyi_vk_render *r, hyi_vk_kernel kernel, uint32_t mode, VkPipeline *pipeline) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)render->scene->device;
    uint32_t features = render->picture.features, wants = render->picture.kernel.settings.wants;
    hyi_vk_shape shape;
    memset(&shape, 0, sizeof shape);
    if (kernel == s->trace) {
        shape = hyi_vk_trace_shape(render->scene, mode);
        shape.wants = wants & (mode == HYK_TRACE_PATHS ? HYK_WANTS_SURFACE : HYK_WANTS_IRRADIANCE);
    } else if (kernel != HYI_VK_KERNEL_arguments) {
        shape.features = kernel == HYI_VK_KERNEL_generate ? features & HYK_NEEDS_ALPHA : kernel == HYI_VK_KERNEL_points ? features & HYK_NEEDS_AT_POINTS : features;
        shape.wants = wants;
    }
    if (kernel == HYI_VK_KERNEL_shade && r->vk->type == HYDRA_VK_DEVICE_CPU) shape.features = hyi_kernel_features(features);
    return hyi_vk_get_pipeline(r->vk, kernel, &shape, pipeline);
}

HYI_FN hydra_result hyi_vk_choose_pipelines(const hydra_render *render, hyi_vk_render *r) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)render->scene->device;
    bool points = render->picture.kernel.camera.kind == HYK_SENSOR_POINTS;
    HYI_TRY(hyi_vk_choose_pipeline(render, r, HYI_VK_KERNEL_arguments, 0, &r->arguments));
    HYI_TRY(hyi_vk_choose_pipeline(render, r, points ? HYI_VK_KERNEL_points : HYI_VK_KERNEL_generate, 0, &r->first));
    HYI_TRY(hyi_vk_choose_pipeline(render, r, HYI_VK_KERNEL_shade, 0, &r->shade));
    HYI_TRY(hyi_vk_choose_pipeline(render, r, s->trace, HYK_TRACE_PATHS, &r->paths));
    return r->has_shadows ? hyi_vk_choose_pipeline(render, r, s->trace, HYK_TRACE_SHADOWS, &r->shadows) : HYDRA_OK;
}

HYI_FN void hyi_vk_bind(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)render->scene->device;
    VkDescriptorSet sets[2] = { s->set.set, b->set.set };
    hyk_dispatch call;
    call.lanes = b->unit_count * r->lanes_of_unit;
    call.pool_lanes = r->pool_lanes;
    call.lanes_of_unit = r->lanes_of_unit;
    call.unused = 0;
    r->vk->f.CmdBindDescriptorSets(b->commands.buffer, VK_PIPELINE_BIND_POINT_COMPUTE, r->vk->layout, 0, 2, sets, 0, NULL);
    r->vk->f.CmdPushConstants(b->commands.buffer, r->vk->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof call, &call);
}

/* Some drivers put off compiling to a pipeline's first dispatch: it comes here, over no lanes, so that no slice and no time
   budget has to bear it. */
HYI_FN hydra_result hyi_vk_warm(hydra_render *render, hyi_vk_render *r) {
    hyi_vk_commands *c = &r->batches[0].commands;
    const VkPipeline all[5] = { r->first, r->arguments, r->paths, r->shade, r->shadows };
    double start = hyi_seconds(), seconds;
    HYI_TRY(hyi_vk_begin(r->vk, c));
    if (r->film.here) {
        hyi_vk_record_accumulate(r->vk, &r->film, c, &r->batches[0].film_set, 0, r->lanes_of_unit, 0);
        hyi_vk_barrier(r->vk, c);
    }
    hyi_vk_bind(render, r, &r->batches[0]);
    for (int i = 0; i < 5; i++) {
        if (!all[i]) continue;
        r->vk->f.CmdBindPipeline(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, all[i]);
        r->vk->f.CmdDispatch(c->buffer, 0, 1, 1);
        hyi_vk_barrier(r->vk, c);
    }
    HYI_TRY(hyi_vk_submit(r->vk, c));
    HYI_TRY(hyi_vk_wait(r->vk, c, &seconds));
    hyi_vk_acquire(&r->vk->shared);
    r->vk->seconds_pipelines += hyi_seconds() - start;
    hyi_vk_release(&r->vk->shared);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_fill_render(hydra_render *render, hyi_vk_render *r) {
    const uint32_t lights = HYK_NEEDS_EMITTERS | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT;
    r->vk = (hyi_vk *)render->context->device;
    r->lanes_of_unit = render->film.tile_pixels * HYI_CHUNK_SAMPLES;
    r->has_shadows = (render->picture.features & lights) != 0; /* lights without extent are sampled whatever the strategy */
    r->has_extras = render->picture.kernel.settings.wants != 0;
    hyi_vk_plan_pool(render, r);
    HYI_TRY(hyi_vk_make_buffer(r->vk, &r->picture, HYI_VK_DEVICE, sizeof(hyk_picture), "the picture"));
    HYI_TRY(hyi_vk_send(r->vk, &r->picture, &render->picture.kernel, sizeof(hyk_picture)));
    HYI_TRY(hyi_vk_send_sensor(render, r));
    uint32_t pipelines = r->vk->pipeline_count;
    HYI_TRY(hyi_vk_make_film(render, r->vk, &r->film));
    HYI_TRY(hyi_vk_choose_pipelines(render, r));
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++) HYI_TRY(hyi_vk_make_batch(r, &r->batches[i]));
    return r->vk->pipeline_count == pipelines ? HYDRA_OK : hyi_vk_warm(render, r);
}

HYI_FN void hyi_vk_free_batch(hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk_free_commands(r->vk, &b->commands); /* first: it waits for what uses the rest */
    hyi_vk_free_set(r->vk, &b->set);
    for (uint32_t i = 0; i < HYK_PASS_BINDINGS; i++) hyi_vk_free_buffer(r->vk, &b->buffers[i]);
    hyi_vk_free_buffer(r->vk, &b->told_counts);
    hyi_vk_free_buffer(r->vk, &b->told_radiance);
    hyi_vk_free_buffer(r->vk, &b->told_extras);
    hyi_vk_free_set(r->vk, &b->film_set);
    hyi_vk_free_buffer(r->vk, &b->chains);
    hyi_vk_free_buffer(r->vk, &b->scatters);
    hyi_vk_free_buffer(r->vk, &b->told_scatters);
    hyi_free_array(r->vk->context, &b->film_units, r->units_most);
    hyi_free_array(r->vk->context, &b->units, r->units_most);
    hyi_free_array(r->vk->context, &b->tiles, r->units_most);
}

HYI_FN void hyi_vk_end_render(hydra_render *render) {
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    if (!r) return;
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++) hyi_vk_free_batch(r, &r->batches[i]);
    hyi_vk_free_film(render, r->vk, &r->film);
    hyi_vk_free_buffer(r->vk, &r->picture);
    hyi_vk_free_buffer(r->vk, &r->sensor);
    hyi_free_array(render->context, &r, 1);
    render->device = NULL;
}

/* hydra_render_destroy cleans up after a failure. */
HYI_FN hydra_result hyi_vk_begin_render(hydra_render *render) {
    hyi_vk_render *r;
    HYI_TRY(hyi_vk_check_lost((hyi_vk *)render->context->device));
    HYI_TRY(hyi_alloc_array(render->context, &r, 1));
    memset(r, 0, sizeof *r);
    r->vk = (hyi_vk *)render->context->device;
    r->render = render;
    render->device = r;
    return hyi_vk_fill_render(render, r);
}

/* ---- recording */

HYI_FN void hyi_vk_end_phase(hyi_vk_render *r, hyi_vk_batch *b, hyi_vk_phase phase) {
    hyi_vk_barrier(r->vk, &b->commands);
    if (b->commands.mark_count && b->commands.mark_count < HYI_VK_MARKS_MOST) b->phases[b->commands.mark_count - 1] = phase;
    hyi_vk_mark(r->vk, &b->commands);
}

/* groups 0: as many as the device has counted, told by the words at offset in COUNTS. */
HYI_FN void hyi_vk_pass(hyi_vk_render *r, hyi_vk_batch *b, VkPipeline pipeline, uint32_t groups, VkDeviceSize offset, hyi_vk_phase phase) {
    const hyi_vk_functions *f = &r->vk->f;
    f->CmdBindPipeline(b->commands.buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    if (groups) f->CmdDispatch(b->commands.buffer, groups, 1, 1);
    else f->CmdDispatchIndirect(b->commands.buffer, b->buffers[HYK_BINDING_COUNTS].buffer, offset);
    hyi_vk_end_phase(r, b, phase);
}

HYI_FN void hyi_vk_record_arguments(hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk_pass(r, b, r->arguments, 1, 0, HYI_VK_REST);
    if (r->has_shadows) hyi_vk_pass(r, b, r->shadows, 0, offsetof(hyk_counts, shadow_groups), HYI_VK_SHADOW);
}

HYI_FN void hyi_vk_record_first(hyi_vk_render *r, hyi_vk_batch *b) {
    r->vk->f.CmdUpdateBuffer(b->commands.buffer, b->buffers[HYK_BINDING_UNITS].buffer, 0, b->unit_count * sizeof *b->units, b->units);
    r->vk->f.CmdFillBuffer(b->commands.buffer, b->buffers[HYK_BINDING_COUNTS].buffer, 0, VK_WHOLE_SIZE, 0);
    hyi_vk_end_phase(r, b, HYI_VK_REST);
    hyi_vk_pass(r, b, r->first, (b->unit_count * r->lanes_of_unit + HYK_GROUP - 1) / HYK_GROUP, 0, HYI_VK_GENERATE);
    hyi_vk_record_arguments(r, b);
}

HYI_FN void hyi_vk_record_round(hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk_pass(r, b, r->paths, 0, offsetof(hyk_counts, path_groups), HYI_VK_INTERSECT);
    hyi_vk_pass(r, b, r->shade, 0, offsetof(hyk_counts, path_groups), HYI_VK_SHADE);
    hyi_vk_record_arguments(r, b);
}

HYI_FN hydra_result hyi_vk_submit_rounds(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b, bool first, uint32_t rounds) {
    HYI_TRY(hyi_vk_begin(r->vk, &b->commands));
    hyi_vk_bind(render, r, b);
    hyi_vk_mark(r->vk, &b->commands);
    if (first) hyi_vk_record_first(r, b);
    for (uint32_t i = 0; i < rounds; i++) hyi_vk_record_round(r, b);
    hyi_vk_copy(r->vk, &b->commands, &b->buffers[HYK_BINDING_COUNTS], &b->told_counts, sizeof(hyk_counts));
    hyi_vk_barrier_to_host(r->vk, &b->commands);
    return hyi_vk_submit(r->vk, &b->commands);
}

HYI_FN hydra_result hyi_vk_submit_reading(hyi_vk_render *r, hyi_vk_batch *b) {
    uint32_t lanes = b->unit_count * r->lanes_of_unit;
    HYI_TRY(hyi_vk_begin(r->vk, &b->commands));
    hyi_vk_copy(r->vk, &b->commands, &b->buffers[HYK_BINDING_RADIANCE], &b->told_radiance, lanes * sizeof(hyk_lane_radiance));
    if (r->has_extras) hyi_vk_copy(r->vk, &b->commands, &b->buffers[HYK_BINDING_EXTRAS], &b->told_extras, lanes * sizeof(hyk_lane_extra));
    hyi_vk_barrier_to_host(r->vk, &b->commands);
    b->reading = true;
    return hyi_vk_submit(r->vk, &b->commands);
}

/* ---- how much at a time */

/* Rounds that the next submission of a batch may take: two rays a path and round, if none dies. */
HYI_FN uint32_t hyi_vk_rounds_for(const hyi_vk_render *r, double paths) {
    double rounds = r->rays_a_second * r->vk->desc.slice_seconds / (2.0 * (paths > 1.0 ? paths : 1.0));
    return rounds < 1.0 ? 1u : rounds > HYI_VK_ROUNDS_MOST ? HYI_VK_ROUNDS_MOST : (uint32_t)rounds;
}

/* From whole batches: their last submissions have so few rays that their speed alone says nothing. */
HYI_FN void hyi_vk_learn_speed(hyi_vk_render *r, const hyi_vk_batch *b) {
    const hyk_counts *counts = (const hyk_counts *)b->told_counts.mapped;
    double rays = (double)counts->rays_path + (double)counts->rays_shadow;
    if (!(rays > 0.0 && b->seconds > 0.0)) return;
    double speed = rays / b->seconds;
    r->rays_a_second = r->rays_a_second > 0.0 ? 0.5 * (r->rays_a_second + speed) : speed;
}

/* A larger batch is never wrong for the film, only for the length of a slice. */
HYI_FN void hyi_vk_resize_batches(hyi_vk_render *r) {
    double lanes = HYI_VK_FIRST_SHARE * r->rays_a_second * r->vk->desc.slice_seconds / 2.0, units = lanes / r->lanes_of_unit;
    double most = HYI_VK_GROWTH * r->units_now;
    units = units < most ? units : most;
    r->units_now = units < 1.0 ? 1u : units > r->units_most ? r->units_most : (uint32_t)units;
}

/* ---- the life of a batch */

/* Takes the next units of the round; false: there are none. Every unit up to schedule.next is in a batch or the film. */
HYI_FN bool hyi_vk_take_units(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_schedule *s = &render->schedule;
    int64_t units = (int64_t)s->active_count * s->rounds_each, at = hyi_atomic_load(&s->next);
    uint32_t target = hyi_stage_target(s);
    b->first_taken = at;
    b->unit_count = 0;
    for (; at < units && b->unit_count < r->units_now; at++) {
        uint32_t slot = (uint32_t)(at % s->active_count), chunk = s->base[slot] + (uint32_t)(at / s->active_count);
        if (chunk >= target) continue;
        b->tiles[b->unit_count] = s->active[slot];
        b->units[b->unit_count++] = hyi_describe_unit(render, s->active[slot], chunk);
    }
    hyi_atomic_store(&s->next, at);
    return b->unit_count > 0;
}

HYI_FN hydra_result hyi_vk_start_batch(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    double lanes = (double)b->unit_count * r->lanes_of_unit;
    b->traced = b->reading = b->entering = false;
    b->seconds = 0.0;
    return hyi_vk_submit_rounds(render, r, b, true, hyi_vk_rounds_for(r, lanes));
}

HYI_FN void hyi_vk_keep_times(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    double between[HYI_VK_MARKS_MOST], spent[HYI_VK_PHASES] = { 0.0 };
    hyi_counters *c = &render->batches[0].counters;
    uint32_t count = hyi_vk_read_marks(r->vk, &b->commands, between);
    for (uint32_t i = 0; i < count; i++) spent[b->phases[i]] += between[i];
    c->generate += spent[HYI_VK_GENERATE];
    c->intersect += spent[HYI_VK_INTERSECT];
    c->shade += spent[HYI_VK_SHADE] + spent[HYI_VK_REST];
    c->shadow += spent[HYI_VK_SHADOW];
}

/* A submission is done: the next one, or none is needed. */
HYI_FN hydra_result hyi_vk_advance(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    double seconds;
    HYI_TRY(hyi_vk_wait(r->vk, &b->commands, &seconds));
    hyi_vk_count_slice(r->vk, seconds);
    if (b->reading) {
        b->traced = true;
        return HYDRA_OK;
    }
    const hyk_counts *counts = (const hyk_counts *)b->told_counts.mapped;
    hyi_vk_count_read(r->vk, sizeof *counts);
    hyi_vk_keep_times(render, r, b);
    b->seconds += seconds;
    if (counts->paths) return hyi_vk_submit_rounds(render, r, b, false, hyi_vk_rounds_for(r, counts->paths));
    if (b->told_radiance.buffer) return hyi_vk_submit_reading(r, b);
    b->traced = true;
    return HYDRA_OK;
}

/* ---- adding up */

HYI_FN void hyi_vk_unpack_lane(hyi_lane *lane, const hyk_lane_radiance *radiance, const hyk_lane_extra *extra) {
    hyi_clear_lane(lane, false);
    lane->flags = radiance->flags;
    lane->part[0] = radiance->radiance;
    if (!extra) return;
    lane->part[1] = extra->indirect;
    lane->part[2] = extra->caustic;
    lane->irradiance = extra->irradiance;
    lane->first = extra->first;
    lane->instance = extra->instance;
    lane->primitive = extra->primitive;
}

HYI_FN void hyi_vk_add_unit(hydra_render *render, const hyi_vk_render *r, const hyi_vk_batch *b, uint32_t index, uint32_t worker) {
    const hyi_vk_buffer *radiance = b->told_radiance.buffer ? &b->told_radiance : &b->buffers[HYK_BINDING_RADIANCE];
    const hyi_vk_buffer *extras = b->told_extras.buffer ? &b->told_extras : &b->buffers[HYK_BINDING_EXTRAS];
    const hyk_unit *unit = &b->units[index];
    size_t first = (size_t)index * r->lanes_of_unit;
    uint32_t lanes = render->film.tile_pixels * unit->samples;
    hyi_lane *to = render->batches[worker].lanes;
    for (uint32_t i = 0; i < lanes; i++)
        hyi_vk_unpack_lane(&to[i], (const hyk_lane_radiance *)radiance->mapped + first + i, r->has_extras ? (const hyk_lane_extra *)extras->mapped + first + i : NULL);
    hyi_accumulate(render, b->tiles[index], unit, to);
    uint64_t used = 0;
    for (uint32_t i = 0; i < lanes; i++) used += to[i].flags & HYK_LANE_USED;
    if (render->picture.kernel.camera.kind != HYK_SENSOR_POINTS) render->batches[worker].counters.rays_camera += used;
    render->batches[worker].counters.paths += lanes;
}

HYI_FN void hyi_vk_add_units(void *argument, uint32_t worker) {
    hydra_render *render = (hydra_render *)argument;
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    double start = hyi_seconds();
    for (;;) {
        int64_t i = hyi_atomic_add(&r->next_added, 1);
        if (i >= (int64_t)r->adding->unit_count) break;
        hyi_vk_add_unit(render, r, r->adding, (uint32_t)i, worker);
    }
    render->accumulate[worker] += hyi_seconds() - start;
}

HYI_FN uint64_t hyi_vk_camera_rays(const hydra_render *render) {
    uint64_t rays = 0;
    for (uint32_t i = 0; i < render->workers; i++) rays += render->batches[i].counters.rays_camera;
    return rays;
}

/* A batch is in the film; there were so many rays of cameras before it was. */
HYI_FN void hyi_vk_end_batch(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b, uint64_t camera_rays) {
    const hyk_counts *counts = (const hyk_counts *)b->told_counts.mapped;
    hyi_counters *c = &render->batches[0].counters;
    c->rays_bounce += counts->rays_path - (hyi_vk_camera_rays(render) - camera_rays);
    c->rays_shadow += counts->rays_shadow;
    b->unit_count = 0;
    b->traced = b->entering = false;
    hyi_vk_learn_speed(r, b);
    hyi_vk_resize_batches(r);
}

HYI_FN void hyi_vk_add_batch(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    uint64_t before = hyi_vk_camera_rays(render), lanes = (uint64_t)b->unit_count * r->lanes_of_unit;
    r->adding = b;
    hyi_atomic_store(&r->next_added, 0);
    hyi_parallel(render->context, render->workers, hyi_vk_add_units, render);
    hyi_vk_count_read(r->vk, lanes * (sizeof(hyk_lane_radiance) + (r->has_extras ? sizeof(hyk_lane_extra) : 0)));
    hyi_vk_end_batch(render, r, b, before);
}

/* ---- adding up on the device */

HYI_FN bool hyi_vk_batch_is_judged(const hydra_render *render, const hyi_vk_batch *b) {
    for (uint32_t i = 0; i < b->unit_count; i++)
        if (hyi_unit_is_judged(render, &b->units[i])) return true;
    return false;
}

HYI_FN hydra_result hyi_vk_submit_entering(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    hyi_vk *vk = r->vk;
    const hyi_film *film = &render->film;
    HYI_TRY(hyi_vk_ready_film(render, vk, &r->film));
    HYI_TRY(hyi_vk_begin(vk, &b->commands));
    hyi_vk_link_units(render, &r->film, b->units, b->tiles, b->unit_count, b->film_units);
    vk->f.CmdUpdateBuffer(b->commands.buffer, b->chains.buffer, 0, b->unit_count * sizeof *b->film_units, b->film_units);
    hyi_vk_barrier(vk, &b->commands);
    hyi_vk_mark(vk, &b->commands);
    hyi_vk_record_accumulate(vk, &r->film, &b->commands, &b->film_set, b->unit_count, r->lanes_of_unit, film->tile_pixels);
    hyi_vk_barrier(vk, &b->commands);
    hyi_vk_mark(vk, &b->commands);
    if (b->told_scatters.buffer && hyi_vk_batch_is_judged(render, b))
        hyi_vk_copy(vk, &b->commands, &b->scatters, &b->told_scatters, (VkDeviceSize)b->unit_count * film->tile_pixels * sizeof(double));
    hyi_vk_barrier_to_host(vk, &b->commands);
    HYI_TRY(hyi_vk_submit(vk, &b->commands));
    b->entering = r->film.ahead = true;
    return HYDRA_OK;
}

HYI_FN void hyi_vk_count_units(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    const hyi_film *film = &render->film;
    const double *scatters = (const double *)(b->told_scatters.buffer ? b->told_scatters.mapped : b->scatters.mapped);
    bool cameras = render->picture.kernel.camera.kind != HYK_SENSOR_POINTS;
    hyi_counters *c = &render->batches[0].counters;
    for (uint32_t i = 0; i < b->unit_count; i++) {
        bool judged = hyi_unit_is_judged(render, &b->units[i]);
        if (cameras) c->rays_camera += (uint64_t)hyi_vk_pixels_inside(film, b->tiles[i]) * b->units[i].samples;
        c->paths += (uint64_t)film->tile_pixels * b->units[i].samples;
        hyi_vk_count_unit(render, b->tiles[i], &b->units[i], judged ? scatters + (size_t)i * film->tile_pixels : NULL);
        if (judged) hyi_vk_count_read(r->vk, film->tile_pixels * sizeof(double));
    }
}

/* A batch that the device was told to add is in its film. */
HYI_FN hydra_result hyi_vk_finish_entering(hydra_render *render, hyi_vk_render *r, hyi_vk_batch *b) {
    double seconds;
    uint64_t before = hyi_vk_camera_rays(render);
    HYI_TRY(hyi_vk_wait(r->vk, &b->commands, &seconds));
    hyi_vk_count_units(render, r, b);
    render->accumulate[0] += seconds;
    hyi_vk_end_batch(render, r, b, before);
    return HYDRA_OK;
}

/* Batches whose way into the film could not be waited for when last tried. */
HYI_FN hydra_result hyi_vk_settle(hyi_vk_render *r) {
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++) {
        hyi_vk_batch *b = &r->batches[i];
        if (!b->entering) continue;
        HYI_TRY(hyi_vk_finish_entering(r->render, r, b));
        hyi_atomic_store(&r->render->schedule.next, b->next_after);
    }
    return HYDRA_OK;
}

HYI_FN void hyi_vk_lose(hyi_vk_render *r) {
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++)
        if (r->batches[i].entering) r->batches[i].unit_count = 0, r->batches[i].entering = r->batches[i].traced = false;
    hyi_vk_lose_film(r->render, &r->film);
}

HYI_FN hydra_result hyi_vk_settle_or_lose(hyi_vk_render *r) {
    hydra_result result = hyi_vk_settle(r);
    if (result == HYDRA_ERROR_DEVICE_LOST) hyi_vk_lose(r);
    return result;
}

/* NULL where the host's film is as good. */
HYI_FN hydra_result hyi_vk_measure_film(hydra_render *render, const double **luminance) {
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    *luminance = NULL;
    HYI_TRY(hyi_vk_settle(r));
    return r->film.ahead ? hyi_vk_fetch_luminance(render, r->vk, &r->film, &r->picture, luminance) : HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_sync_film(const hydra_render *render, bool to_change) {
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    if (!r->film.here) return HYDRA_OK;
    hydra_result result = hyi_vk_check_lost(r->vk);
    if (result == HYDRA_OK) result = hyi_vk_settle(r);
    if (result == HYDRA_OK) result = hyi_vk_fetch_film(r->render, r->vk, &r->film);
    if (result == HYDRA_ERROR_DEVICE_LOST) {
        hyi_vk_lose(r);
        result = HYDRA_OK; /* what is there is the host's */
    }
    if (result == HYDRA_OK && to_change) r->film.stale = true, r->film.blank = false;
    return result;
}

/* ---- the backend's work */

/* Gives back what is on its way; what the device still does with it is waited for. */
HYI_FN void hyi_vk_give_back(hydra_render *render, hyi_vk_render *r, uint32_t oldest) {
    double seconds;
    for (uint32_t i = HYI_VK_BATCHES; i-- > 0;) {
        hyi_vk_batch *b = &r->batches[(oldest + i) % HYI_VK_BATCHES];
        if (b->entering) {
            b->next_after = hyi_atomic_load(&render->schedule.next);
            if (hyi_vk_finish_entering(render, r, b) != HYDRA_OK) hyi_atomic_store(&render->schedule.next, b->first_taken); /* until hyi_vk_settle */
            continue;
        }
        if (b->commands.in_flight) (void)hyi_vk_wait(r->vk, &b->commands, &seconds);
        if (b->unit_count) hyi_atomic_store(&render->schedule.next, b->first_taken);
        b->unit_count = 0;
        b->traced = b->reading = false;
    }
}

/* Every batch that is on its way goes on by a submission; those that are done enter the film in order. *oldest: the first
   of them. The device is told to add one up, and waited for when the others have gone on. */
HYI_FN hydra_result hyi_vk_advance_all(hydra_render *render, hyi_vk_render *r, uint32_t *oldest) {
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++) {
        hyi_vk_batch *b = &r->batches[(*oldest + i) % HYI_VK_BATCHES];
        if (b->unit_count && !b->traced) HYI_TRY(hyi_vk_advance(render, r, b));
    }
    while (r->batches[*oldest].unit_count && r->batches[*oldest].traced) {
        hyi_vk_batch *b = &r->batches[*oldest];
        if (r->film.here && !b->entering) return hyi_vk_submit_entering(render, r, b);
        if (r->film.here) HYI_TRY(hyi_vk_finish_entering(render, r, b));
        else hyi_vk_add_batch(render, r, b);
        *oldest = (*oldest + 1) % HYI_VK_BATCHES;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_start_idle(hydra_render *render, hyi_vk_render *r, uint32_t oldest) {
    for (uint32_t i = 0; i < HYI_VK_BATCHES; i++) {
        hyi_vk_batch *b = &r->batches[(oldest + i) % HYI_VK_BATCHES];
        if (b->unit_count) continue;
        if (!hyi_vk_take_units(render, r, b)) return HYDRA_OK;
        HYI_TRY(hyi_vk_start_batch(render, r, b));
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_work(hydra_render *render) {
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    uint32_t oldest = 0;
    HYI_TRY(hyi_vk_settle_or_lose(r)); /* nothing else is on its way yet: the schedule stays as it is */
    hydra_result result = hyi_vk_start_idle(render, r, oldest); /* progress even when a step is shorter than a batch */
    while (result == HYDRA_OK && r->batches[oldest].unit_count && !hyi_atomic_load(&render->cancel)) {
        result = hyi_vk_advance_all(render, r, &oldest);
        if (result == HYDRA_OK && !hyi_must_stop(render)) result = hyi_vk_start_idle(render, r, oldest);
    }
    hyi_vk_give_back(render, r, oldest);
    if (result == HYDRA_ERROR_DEVICE_LOST) hyi_vk_lose(r);
    return result;
}

#endif /* HYI_VK_PASSES_H */
