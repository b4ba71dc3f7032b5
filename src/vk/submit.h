/* >>vk-submit: command buffers, one submission at a time in each, and how long it took */
#ifndef HYI_VK_SUBMIT_H
#define HYI_VK_SUBMIT_H

#include "pipelines.h"

#define HYI_VK_MARKS_MOST 128u

/* A command buffer that is recorded, submitted and waited for, over and over. */
typedef struct hyi_vk_commands {
    VkCommandPool pool;
    VkCommandBuffer buffer;
    VkFence fence;
    VkQueryPool marks; /* none: the queue writes no timestamps */
    uint32_t mark_count;
    bool in_flight;
    double submitted;
} hyi_vk_commands;

HYI_FN void hyi_vk_free_commands(hyi_vk *vk, hyi_vk_commands *c) {
    if (c->in_flight) (void)vk->f.WaitForFences(vk->device, 1, &c->fence, VK_TRUE, UINT64_MAX); /* a wait had failed */
    if (c->marks) vk->f.DestroyQueryPool(vk->device, c->marks, vk->desc.allocation);
    if (c->fence) vk->f.DestroyFence(vk->device, c->fence, vk->desc.allocation);
    if (c->pool) vk->f.DestroyCommandPool(vk->device, c->pool, vk->desc.allocation);
    memset(c, 0, sizeof *c);
}

HYI_FN hydra_result hyi_vk_make_marks(hyi_vk *vk, hyi_vk_commands *c) {
    VkQueryPoolCreateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO;
    info.queryType = VK_QUERY_TYPE_TIMESTAMP;
    info.queryCount = HYI_VK_MARKS_MOST;
    HYI_VK_MAKE(vk, "vkCreateQueryPool", CreateQueryPool(vk->device, &info, vk->desc.allocation, &c->marks), c->marks);
    return HYDRA_OK;
}

/* c is all zero. What was made before a failure is freed by hyi_vk_free_commands. */
HYI_FN hydra_result hyi_vk_make_commands(hyi_vk *vk, hyi_vk_commands *c) {
    VkCommandPoolCreateInfo pool;
    VkCommandBufferAllocateInfo buffer;
    VkFenceCreateInfo fence;
    memset(&pool, 0, sizeof pool);
    memset(&buffer, 0, sizeof buffer);
    memset(&fence, 0, sizeof fence);
    pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
    pool.queueFamilyIndex = vk->family;
    HYI_VK_MAKE(vk, "vkCreateCommandPool", CreateCommandPool(vk->device, &pool, vk->desc.allocation, &c->pool), c->pool);
    buffer.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
    buffer.commandPool = c->pool;
    buffer.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    buffer.commandBufferCount = 1;
    HYI_VK_TRY(vk, "vkAllocateCommandBuffers", AllocateCommandBuffers(vk->device, &buffer, &c->buffer));
    fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
    HYI_VK_MAKE(vk, "vkCreateFence", CreateFence(vk->device, &fence, vk->desc.allocation, &c->fence), c->fence);
    return vk->times ? hyi_vk_make_marks(vk, c) : HYDRA_OK;
}

/* ---- recording */

HYI_FN hydra_result hyi_vk_begin(hyi_vk *vk, hyi_vk_commands *c) {
    VkCommandBufferBeginInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
    info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    HYI_TRY(hyi_vk_check_lost(vk));
    if (c->in_flight) HYI_VK_TRY(vk, "vkWaitForFences", WaitForFences(vk->device, 1, &c->fence, VK_TRUE, UINT64_MAX)); /* a wait had failed */
    c->in_flight = false;
    HYI_VK_TRY(vk, "vkBeginCommandBuffer", BeginCommandBuffer(c->buffer, &info));
    c->mark_count = 0;
    if (c->marks) vk->f.CmdResetQueryPool(c->buffer, c->marks, 0, HYI_VK_MARKS_MOST);
    return HYDRA_OK;
}

/* What was written before is seen after, by whatever reads or writes it. */
HYI_FN void hyi_vk_barrier(hyi_vk *vk, hyi_vk_commands *c) {
    const VkPipelineStageFlags work = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
    VkMemoryBarrier barrier;
    memset(&barrier, 0, sizeof barrier);
    barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT |
                            VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    vk->f.CmdPipelineBarrier(c->buffer, work | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT, work | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT, 0, 1, &barrier, 0, NULL, 0, NULL);
}

/* What was written before is seen by the host after the fence. */
HYI_FN void hyi_vk_barrier_to_host(hyi_vk *vk, hyi_vk_commands *c) {
    VkMemoryBarrier barrier;
    memset(&barrier, 0, sizeof barrier);
    barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT | VK_ACCESS_HOST_WRITE_BIT;
    vk->f.CmdPipelineBarrier(c->buffer, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, NULL, 0, NULL);
}

/* The time at which all before is done. */
HYI_FN void hyi_vk_mark(hyi_vk *vk, hyi_vk_commands *c) {
    if (c->marks && c->mark_count < HYI_VK_MARKS_MOST)
        vk->f.CmdWriteTimestamp(c->buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, c->marks, c->mark_count++);
}

HYI_FN void hyi_vk_copy(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_buffer *from, const hyi_vk_buffer *to, VkDeviceSize bytes) {
    VkBufferCopy region = { 0, 0, bytes };
    vk->f.CmdCopyBuffer(c->buffer, from->buffer, to->buffer, 1, &region);
}

/* ---- submitting */

HYI_FN VkResult hyi_vk_queue(hyi_vk *vk, const VkSubmitInfo *info, VkFence fence) {
    hyi_vk_acquire(&vk->shared);
    vk->submissions++;
    if (vk->desc.lock_queue) vk->desc.lock_queue(vk->desc.lock_user);
    VkResult result = vk->f.QueueSubmit(vk->queue, 1, info, fence);
    if (vk->desc.unlock_queue) vk->desc.unlock_queue(vk->desc.lock_user);
    hyi_vk_release(&vk->shared);
    return result;
}

HYI_FN hydra_result hyi_vk_submit(hyi_vk *vk, hyi_vk_commands *c) {
    VkSubmitInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    info.commandBufferCount = 1;
    info.pCommandBuffers = &c->buffer;
    HYI_VK_TRY(vk, "vkEndCommandBuffer", EndCommandBuffer(c->buffer));
    HYI_VK_TRY(vk, "vkResetFences", ResetFences(vk->device, 1, &c->fence));
    c->submitted = hyi_seconds();
    HYI_TRY(hyi_vk_result(vk, hyi_vk_queue(vk, &info, c->fence), "vkQueueSubmit"));
    c->in_flight = true;
    return HYDRA_OK;
}

HYI_FN void hyi_vk_count_slice(hyi_vk *vk, double seconds) {
    hyi_vk_acquire(&vk->shared);
    vk->slices++;
    vk->slice_total += seconds;
    if (seconds > vk->slice_longest) vk->slice_longest = seconds;
    hyi_vk_release(&vk->shared);
}

/* Seconds between marks, of which there are mark_count; nothing in them where there are no timestamps. */
HYI_FN uint32_t hyi_vk_read_marks(hyi_vk *vk, const hyi_vk_commands *c, double seconds[HYI_VK_MARKS_MOST]) {
    uint64_t ticks[HYI_VK_MARKS_MOST];
    if (c->mark_count < 2) return 0;
    if (vk->f.GetQueryPoolResults(vk->device, c->marks, 0, c->mark_count, sizeof ticks, ticks, sizeof ticks[0], VK_QUERY_RESULT_64_BIT) != VK_SUCCESS) return 0;
    for (uint32_t i = 0; i + 1 < c->mark_count; i++) seconds[i] = (double)(ticks[i + 1] - ticks[i]) * vk->seconds_a_tick;
    return c->mark_count - 1;
}

/* *seconds: how long the submission ran, as the device tells it, or else from submitting it to now. */
HYI_FN hydra_result hyi_vk_wait(hyi_vk *vk, hyi_vk_commands *c, double *seconds) {
    double between[HYI_VK_MARKS_MOST];
    *seconds = 0.0;
    if (!c->in_flight) return HYDRA_OK;
    HYI_VK_TRY(vk, "vkWaitForFences", WaitForFences(vk->device, 1, &c->fence, VK_TRUE, UINT64_MAX));
    c->in_flight = false;
    uint32_t count = hyi_vk_read_marks(vk, c, between);
    for (uint32_t i = 0; i < count; i++) *seconds += between[i];
    if (!count) *seconds = hyi_seconds() - c->submitted;
    return HYDRA_OK;
}

/* Before what it uses goes: a wait for it may have failed. */
HYI_FN void hyi_vk_drain(hyi_vk *vk, hyi_vk_commands *c) {
    if (c->in_flight) (void)vk->f.WaitForFences(vk->device, 1, &c->fence, VK_TRUE, UINT64_MAX);
}

/* ---- what moves between host and device */

/* Copies into a buffer of the device. */
HYI_FN hydra_result hyi_vk_send(hyi_vk *vk, hyi_vk_buffer *to, const void *from, size_t bytes) {
    hyi_vk_buffer stage;
    hyi_vk_commands commands;
    double seconds;
    if (bytes && to->mapped) memcpy(to->mapped, from, bytes);
    if (!bytes || to->mapped) return HYDRA_OK;
    memset(&stage, 0, sizeof stage);
    memset(&commands, 0, sizeof commands);
    hydra_result result = hyi_vk_make_buffer(vk, &stage, HYI_VK_UPLOAD, bytes, "an upload");
    if (result == HYDRA_OK) result = hyi_vk_make_commands(vk, &commands);
    if (result == HYDRA_OK) result = hyi_vk_begin(vk, &commands);
    if (result == HYDRA_OK) {
        memcpy(stage.mapped, from, bytes);
        hyi_vk_copy(vk, &commands, &stage, to, bytes);
        hyi_vk_barrier(vk, &commands);
        result = hyi_vk_submit(vk, &commands);
    }
    if (result == HYDRA_OK) result = hyi_vk_wait(vk, &commands, &seconds);
    hyi_vk_free_commands(vk, &commands);
    hyi_vk_free_buffer(vk, &stage);
    return result;
}

/* The host has taken bytes of what the device made. */
HYI_FN void hyi_vk_count_read(hyi_vk *vk, uint64_t bytes) {
    hyi_vk_acquire(&vk->shared);
    vk->bytes_read += bytes;
    hyi_vk_release(&vk->shared);
}

#endif /* HYI_VK_SUBMIT_H */
