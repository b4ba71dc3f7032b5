/* >>vk-create: device contexts, and the calls that only they have */
#ifndef HYI_VK_CREATE_H
#define HYI_VK_CREATE_H

#include "queries.h"

/* ---- life */

HYI_FN void hyi_vk_destroy(hydra_context *context) {
    hyi_vk *vk = (hyi_vk *)context->device;
    if (!vk) return;
    if (vk->device) {
        hyi_vk_free_asker(vk);
        hyi_vk_free_pipelines(vk);
    }
    hyi_vk_release_device(vk);
    hyi_vk_lock_destroy(&vk->shared);
    hyi_vk_lock_destroy(&vk->asking);
    hyi_free_array(context, &vk, 1);
    context->device = NULL;
}

HYI_FN const hyi_backend *hyi_vk_backend(void) {
    static const hyi_backend backend = { hyi_vk_destroy,      hyi_vk_commit, hyi_vk_forget_scene, hyi_vk_begin_render,
                                         hyi_vk_end_render, hyi_vk_work,   hyi_vk_sync_film, hyi_vk_measure_film, hyi_vk_trace };
    return &backend;
}

HYI_FN hydra_result hyi_vk_start(hyi_vk *vk) {
    double start = hyi_seconds();
    HYI_TRY(hyi_vk_take_instance(vk));
    HYI_TRY(hyi_vk_take_device(vk));
    HYI_TRY(hyi_vk_make_layouts(vk));
    HYI_TRY(hyi_vk_make_cache(vk));
    vk->seconds_start = hyi_seconds() - start;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_equip(hydra_context *context, const hydra_vk_desc *desc) {
    hyi_vk *vk;
    HYI_TRY(hyi_alloc_array(context, &vk, 1));
    memset(vk, 0, sizeof *vk);
    vk->context = context;
    if (desc) vk->desc = *desc;
    if (!(vk->desc.slice_seconds > 0.0)) vk->desc.slice_seconds = 0.03;
    hyi_vk_lock_init(&vk->shared);
    hyi_vk_lock_init(&vk->asking);
    context->device = vk;
    context->backend = hyi_vk_backend();
    return hyi_vk_start(vk);
}

HYI_FN void hyi_vk_tell_error(const hydra_vk_desc *desc, const char *text) {
    if (desc && desc->error && desc->error_size) snprintf(desc->error, desc->error_size, "%s", text);
}

HYDRA_API hydra_result hydra_vk_create(const hydra_context_desc *desc, const hydra_vk_desc *vk, hydra_context **context) {
    hyi_vk_tell_error(vk, "");
    if (!context) return HYDRA_ERROR_NULL;
    *context = hydra_create(desc);
    if (!*context) {
        hyi_vk_tell_error(vk, hydra_error_text(NULL));
        return desc && !hyi_isa_is_there(hyi_resolved_context_desc(desc).isa) ? HYDRA_ERROR_ISA : HYDRA_ERROR_OUT_OF_MEMORY;
    }
    hydra_result result = hyi_vk_equip(*context, vk);
    if (result == HYDRA_OK) return HYDRA_OK;
    hyi_vk_tell_error(vk, hydra_error_text(*context));
    hydra_destroy(*context);
    *context = NULL;
    return result;
}

/* ---- devices */

HYI_FN hydra_result hyi_vk_list(hyi_vk_functions *f, VkInstance instance, hydra_vk_device_info *infos, uint32_t *count) {
    VkPhysicalDevice devices[HYI_VK_DEVICES_MOST];
    uint32_t there = HYI_VK_DEVICES_MOST, room = *count;
    if (!hyi_vk_load_instance(f, instance) || f->EnumeratePhysicalDevices(instance, &there, devices) < 0) return HYDRA_ERROR_DEVICE;
    for (uint32_t i = 0; infos && i < there && i < room; i++) hyi_vk_describe(f, devices[i], &infos[i]);
    *count = there;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_vk_list_devices(const hydra_vk_desc *desc, hydra_vk_device_info *infos, uint32_t *count) {
    hyi_vk_functions f;
    if (!count) return HYDRA_ERROR_NULL;
    if (!infos) *count = 0;
    if (!hyi_vk_open(&f, desc ? desc->get_instance_proc_addr : NULL)) return HYDRA_ERROR_DEVICE;
    VkInstance instance = desc ? desc->instance : VK_NULL_HANDLE;
    hydra_result result = HYDRA_ERROR_DEVICE;
    if (instance) result = hyi_vk_list(&f, instance, infos, count);
    else {
        VkResult made = hyi_vk_create_instance(&f, NULL, false, &instance);
        if (made >= 0) result = hyi_vk_list(&f, instance, infos, count);
        if (made >= 0 && f.DestroyInstance) f.DestroyInstance(instance, NULL);
        if (made == VK_ERROR_INCOMPATIBLE_DRIVER) { /* a loader without drivers */
            *count = 0;
            result = HYDRA_OK;
        }
    }
    hyi_vk_close_library(&f);
    return result;
}

/* ---- what a device context adds */

HYI_FN hyi_vk *hyi_vk_of(const hydra_context *context) {
    return context && context->backend == hyi_vk_backend() ? (hyi_vk *)context->device : NULL;
}

HYDRA_API hydra_result hydra_vk_get_info(const hydra_context *context, hydra_vk_info *info) {
    hyi_vk *vk = hyi_vk_of(context);
    if (!info) return HYDRA_ERROR_NULL;
    memset(info, 0, sizeof *info);
    if (!vk) return HYDRA_ERROR_HANDLE;
    hyi_vk_acquire(&vk->shared);
    memcpy(info->name, vk->name, sizeof info->name);
    info->type = vk->type;
    info->bytes_now = vk->bytes_now;
    info->bytes_peak = vk->bytes_peak;
    info->pipelines = vk->pipeline_count;
    info->seconds_start = vk->seconds_start;
    info->seconds_pipelines = vk->seconds_pipelines;
    info->bytes_read = vk->bytes_read;
    info->submissions = vk->submissions;
    info->slices = vk->slices;
    info->slice_mean = vk->slices ? vk->slice_total / (double)vk->slices : 0.0;
    info->slice_longest = vk->slice_longest;
    info->validation_messages = (uint32_t)hyi_atomic_load(&vk->validation_messages);
    info->lost = hyi_atomic_load(&vk->lost) != 0;
    hyi_vk_release(&vk->shared);
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_vk_save_pipelines(const hydra_context *context, void *buffer, size_t *size) {
    hyi_vk *vk = hyi_vk_of(context);
    if (!size) return HYDRA_ERROR_NULL;
    if (!vk) return HYDRA_ERROR_HANDLE;
    size_t room = *size;
    HYI_VK_TRY(vk, "vkGetPipelineCacheData", GetPipelineCacheData(vk->device, vk->cache, size, NULL));
    if (!buffer) return HYDRA_OK;
    if (room < *size) return hyi_fail(vk->context, HYDRA_ERROR_BUFFER, "pipelines take %zu bytes, there are %zu", *size, room);
    HYI_VK_TRY(vk, "vkGetPipelineCacheData", GetPipelineCacheData(vk->device, vk->cache, size, buffer));
    return HYDRA_OK;
}

/* Rows of pixels in a buffer of the caller's. */
typedef struct hyi_vk_rows {
    VkBuffer buffer;
    VkDeviceSize offset, stride, row; /* row: bytes of one */
    uint32_t count;
} hyi_vk_rows;

/* Ends commands with a copy of tight rows, and waits for it all. */
HYI_FN hydra_result hyi_vk_copy_rows(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_buffer *from, const hyi_vk_rows *to) {
    double seconds;
    bool tight = to->stride == to->row;
    for (uint32_t y = 0; y < (tight ? 1u : to->count); y++) {
        VkBufferCopy region = { y * to->row, to->offset + y * to->stride, tight ? to->count * to->row : to->row };
        vk->f.CmdCopyBuffer(c->buffer, from->buffer, to->buffer, 1, &region);
    }
    hyi_vk_barrier(vk, c);
    HYI_TRY(hyi_vk_submit(vk, c));
    return hyi_vk_wait(vk, c, &seconds);
}

/* Pixels that the host makes. */
HYI_FN hydra_result hyi_vk_write_read(hydra_render *render, hyi_vk *vk, hydra_output output, const hyi_vk_rows *to) {
    hyi_vk_buffer stage;
    hyi_vk_commands c;
    memset(&stage, 0, sizeof stage);
    memset(&c, 0, sizeof c);
    HYI_TRY(hyi_vk_make_buffer(vk, &stage, HYI_VK_UPLOAD, to->row * to->count, "pixels"));
    hydra_result result = hydra_render_read(render, output, stage.mapped, 0);
    if (result == HYDRA_OK) result = hyi_vk_make_commands(vk, &c);
    if (result == HYDRA_OK) result = hyi_vk_begin(vk, &c);
    if (result == HYDRA_OK) result = hyi_vk_copy_rows(vk, &c, &stage, to);
    hyi_vk_free_commands(vk, &c);
    hyi_vk_free_buffer(vk, &stage);
    return result;
}

/* Pixels that the device makes of its film. */
HYI_FN hydra_result hyi_vk_write_resolved(hydra_render *render, hyi_vk_render *r, hydra_output output, const hyi_vk_rows *to) {
    hyi_vk_commands *c = &r->film.commands;
    hyi_vk_buffer out;
    memset(&out, 0, sizeof out);
    HYI_TRY(hyi_vk_make_buffer(r->vk, &out, HYI_VK_DEVICE, to->row * to->count, "pixels"));
    uint32_t values = (render->film.right - render->film.left) * to->count;
    hydra_result result = hyi_vk_record_resolve(render, r->vk, &r->film, &r->picture, (uint32_t)output, values, &out);
    if (result == HYDRA_OK) result = hyi_vk_copy_rows(r->vk, c, &out, to);
    hyi_vk_drain(r->vk, c);
    hyi_vk_free_buffer(r->vk, &out);
    return result;
}

/* Whether the device's film is what the output follows from. */
HYI_FN bool hyi_vk_can_resolve(const hydra_render *render, const hyi_vk_render *r, hydra_output output) {
    return r->film.here && !r->film.stale && hyi_vk_resolves(output) && hyi_output_is_there(render, output) && !hyi_atomic_load(&r->vk->lost);
}

HYDRA_API hydra_result hydra_vk_render_write(hydra_render *render, hydra_output output, VkBuffer buffer, VkDeviceSize offset, size_t row_stride) {
    if (!render) return HYDRA_ERROR_NULL;
    hyi_vk *vk = hyi_vk_of(render->context);
    if (!vk) return hyi_fail(render->context, HYDRA_ERROR_HANDLE, "hydra_vk_render_write: not a device context");
    if (!buffer) return hyi_vk_fail(vk, HYDRA_ERROR_NULL, "hydra_vk_render_write: the buffer");
    const hyi_film *film = &render->film;
    size_t row = hydra_output_size(output) * (film->right - film->left), stride = row_stride ? row_stride : row;
    uint32_t rows = film->bottom - film->top;
    if (!row) return hyi_vk_fail(vk, HYDRA_ERROR_ENUM, "hydra_vk_render_write: the output");
    if (stride < row || stride % 4 || offset % 4) return hyi_fail(render->context, HYDRA_ERROR_STRIDE, "offset %llu, rows of %zu bytes, %zu apart", (unsigned long long)offset, row, stride);
    hyi_vk_rows to = { buffer, offset, stride, row, rows };
    hyi_vk_render *r = (hyi_vk_render *)render->device;
    if (!hyi_vk_can_resolve(render, r, output)) return hyi_vk_write_read(render, vk, output, &to);
    HYI_TRY(hyi_vk_settle(r));
    return hyi_vk_write_resolved(render, r, output, &to);
}

#endif /* HYI_VK_CREATE_H */
