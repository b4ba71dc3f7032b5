/* >>vk-queries: rays of the caller, cast on the device

   One thread at a time, with one set of buffers for the context: rays go up, hits come down, a slice of them at a time. */
#ifndef HYI_VK_QUERIES_H
#define HYI_VK_QUERIES_H

#include "passes.h"

#define HYI_VK_RAYS_MOST 65536u
#define HYI_VK_RAYS_FIRST 2048u

struct hyi_vk_asker {
    hyi_vk_commands commands;
    hyi_vk_set set;
    hyi_vk_buffer buffers[HYK_PASS_BINDINGS];
    hyi_vk_buffer up, down; /* where the host does not see the device's memory */
    uint32_t rays_now;
};

HYI_FN void hyi_vk_free_asker(hyi_vk *vk) {
    hyi_vk_asker *a = vk->asker;
    if (!a) return;
    hyi_vk_free_commands(vk, &a->commands); /* first: it waits for what uses the rest */
    hyi_vk_free_set(vk, &a->set);
    for (uint32_t i = 0; i < HYK_PASS_BINDINGS; i++) hyi_vk_free_buffer(vk, &a->buffers[i]);
    hyi_vk_free_buffer(vk, &a->up);
    hyi_vk_free_buffer(vk, &a->down);
    hyi_free_array(vk->context, &vk->asker, 1);
}

HYI_FN VkDeviceSize hyi_vk_query_bytes(uint32_t binding) {
    switch (binding) {
    case HYK_BINDING_SENSOR: return HYI_VK_RAYS_MOST * sizeof(hyk_ray);
    case HYK_BINDING_HITS: return HYI_VK_RAYS_MOST * sizeof(hyk_hit);
    case HYK_BINDING_QUEUES: return HYI_VK_RAYS_MOST * sizeof(uint32_t);
    default: return sizeof(hyk_picture); /* bound, not used */
    }
}

HYI_FN hydra_result hyi_vk_fill_asker(hyi_vk *vk, hyi_vk_asker *a) {
    HYI_TRY(hyi_vk_make_commands(vk, &a->commands));
    for (uint32_t i = 0; i < HYK_PASS_BINDINGS; i++) HYI_TRY(hyi_vk_make_buffer(vk, &a->buffers[i], HYI_VK_DEVICE, hyi_vk_query_bytes(i), "rays"));
    if (!a->buffers[HYK_BINDING_SENSOR].mapped) HYI_TRY(hyi_vk_make_buffer(vk, &a->up, HYI_VK_UPLOAD, a->buffers[HYK_BINDING_SENSOR].size, "rays"));
    if (!a->buffers[HYK_BINDING_HITS].mapped) HYI_TRY(hyi_vk_make_buffer(vk, &a->down, HYI_VK_READBACK, a->buffers[HYK_BINDING_HITS].size, "hits"));
    HYI_TRY(hyi_vk_make_set(vk, vk->pass_layout, HYK_PASS_BINDINGS, 0, &a->set));
    hyi_vk_write_set(vk, &a->set, a->buffers, HYK_PASS_BINDINGS);
    a->rays_now = HYI_VK_RAYS_FIRST;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_need_asker(hyi_vk *vk) {
    if (vk->asker) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(vk->context, &vk->asker, 1));
    memset(vk->asker, 0, sizeof *vk->asker);
    hydra_result result = hyi_vk_fill_asker(vk, vk->asker);
    if (result != HYDRA_OK) hyi_vk_free_asker(vk);
    return result;
}

/* Rays that are not sound get no direction, with which they meet nothing. Returns whether all were. */
HYI_FN bool hyi_vk_put_rays(hyi_vk_asker *a, const hydra_ray *rays, uint32_t count) {
    hyk_ray *to = (hyk_ray *)(a->up.buffer ? a->up.mapped : a->buffers[HYK_BINDING_SENSOR].mapped);
    bool sound = true;
    for (uint32_t i = 0; i < count; i++) {
        hyk_ray ray = hyi_load_ray((const hyk_ray *)(const void *)&rays[i]);
        bool this_one = hyi_ray_is_sound(&ray);
        if (!this_one) memset(&ray, 0, sizeof ray);
        to[i] = ray;
        sound = sound && this_one;
    }
    return sound;
}

HYI_FN void hyi_vk_get_answers(const hyi_vk_asker *a, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    const hyi_vk_buffer *from = &a->buffers[hits ? HYK_BINDING_HITS : HYK_BINDING_QUEUES];
    if (a->down.buffer) from = &a->down;
    if (hits) memcpy(hits, from->mapped, count * sizeof *hits);
    for (uint32_t i = 0; !hits && i < count; i++) occluded[i] = (uint8_t)((const uint32_t *)from->mapped)[i];
}

HYI_FN void hyi_vk_record_query(hyi_vk *vk, hyi_vk_asker *a, const hydra_scene *scene, VkPipeline pipeline, bool any, uint32_t count) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)scene->device;
    const hyi_vk_buffer *answers = &a->buffers[any ? HYK_BINDING_QUEUES : HYK_BINDING_HITS];
    VkDescriptorSet sets[2] = { s->set.set, a->set.set };
    VkCommandBuffer c = a->commands.buffer;
    hyk_dispatch call = { count, HYI_VK_RAYS_MOST, 1, 0 };
    if (a->up.buffer) hyi_vk_copy(vk, &a->commands, &a->up, &a->buffers[HYK_BINDING_SENSOR], count * sizeof(hyk_ray));
    if (a->up.buffer) hyi_vk_barrier(vk, &a->commands);
    hyi_vk_mark(vk, &a->commands);
    vk->f.CmdBindDescriptorSets(c, VK_PIPELINE_BIND_POINT_COMPUTE, vk->layout, 0, 2, sets, 0, NULL);
    vk->f.CmdPushConstants(c, vk->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof call, &call);
    vk->f.CmdBindPipeline(c, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    vk->f.CmdDispatch(c, (count + HYK_GROUP - 1) / HYK_GROUP, 1, 1);
    hyi_vk_mark(vk, &a->commands);
    if (a->down.buffer) hyi_vk_barrier(vk, &a->commands);
    if (a->down.buffer) hyi_vk_copy(vk, &a->commands, answers, &a->down, count * (any ? sizeof(uint32_t) : sizeof(hyk_hit)));
    hyi_vk_barrier_to_host(vk, &a->commands);
}

/* So many rays next time that they take a slice. */
HYI_FN void hyi_vk_learn_slice(hyi_vk *vk, hyi_vk_asker *a, uint32_t count, double seconds) {
    if (count < a->rays_now) return;
    double next = seconds > 0.0 ? 0.5 * count * vk->desc.slice_seconds / seconds : (double)HYI_VK_RAYS_MOST;
    next = next < HYI_VK_GROWTH * count ? next : HYI_VK_GROWTH * count;
    a->rays_now = next < HYK_GROUP ? HYK_GROUP : next > HYI_VK_RAYS_MOST ? HYI_VK_RAYS_MOST : (uint32_t)next;
}

HYI_FN hydra_result hyi_vk_ask(hyi_vk *vk, const hydra_scene *scene, VkPipeline pipeline, const hydra_ray *rays, hyk_hit *hits, uint8_t *occluded,
                               uint32_t count, bool *sound) {
    hyi_vk_asker *a = vk->asker;
    double seconds;
    *sound = hyi_vk_put_rays(a, rays, count) && *sound;
    HYI_TRY(hyi_vk_begin(vk, &a->commands));
    hyi_vk_record_query(vk, a, scene, pipeline, hits == NULL, count);
    HYI_TRY(hyi_vk_submit(vk, &a->commands));
    HYI_TRY(hyi_vk_wait(vk, &a->commands, &seconds));
    hyi_vk_count_slice(vk, seconds);
    hyi_vk_get_answers(a, hits, occluded, count);
    hyi_vk_count_read(vk, count * (hits ? sizeof *hits : sizeof(uint32_t)));
    hyi_vk_learn_slice(vk, a, count, seconds);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_ask_all(hyi_vk *vk, const hydra_scene *scene, const hydra_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)scene->device;
    VkPipeline pipeline;
    hyi_vk_shape shape = hyi_vk_trace_shape(scene, hits ? HYK_TRACE_RAYS : HYK_TRACE_RAYS_ANY);
    bool sound = true;
    HYI_TRY(hyi_vk_get_pipeline(vk, s->trace, &shape, &pipeline));
    HYI_TRY(hyi_vk_need_asker(vk));
    for (uint32_t first = 0, n; first < count; first += n) {
        n = count - first < vk->asker->rays_now ? count - first : vk->asker->rays_now;
        HYI_TRY(hyi_vk_ask(vk, scene, pipeline, rays + first, hits ? hits + first : NULL, hits ? NULL : occluded + first, n, &sound));
    }
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

HYI_FN hydra_result hyi_vk_trace(const hydra_scene *scene, const hydra_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    hyi_vk *vk = (hyi_vk *)scene->context->device;
    hyi_vk_acquire(&vk->asking);
    hyi_atomic_store(&vk->context->quiet_thread, hyi_this_thread());
    hydra_result result = hyi_vk_ask_all(vk, scene, rays, hits, occluded, count);
    hyi_atomic_store(&vk->context->quiet_thread, 0);
    hyi_vk_release(&vk->asking);
    return result;
}

#endif /* HYI_VK_QUERIES_H */
