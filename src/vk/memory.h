/* >>vk-memory: buffers, in few large blocks of device memory

   Drivers allow few allocations (4096 are promised), so buffers are placed side by side in blocks, one list of blocks
   for all kinds of memory. A place is the first gap that is large enough; a block goes when its last buffer does. All of
   this is done under vk->shared. */
#ifndef HYI_VK_MEMORY_H
#define HYI_VK_MEMORY_H

#include "device.h"

#define HYI_VK_BLOCK_BYTES ((VkDeviceSize)32 << 20) /* at least; a larger buffer has a block of its own */

typedef struct hyi_vk_range { VkDeviceSize offset, size; } hyi_vk_range;

struct hyi_vk_block {
    hyi_vk_block *next;
    VkDeviceMemory memory;
    VkDeviceSize size;
    uint32_t type;
    char *mapped; /* NULL: the host does not see it */
    hyi_vk_range *used; /* in order of offset */
    size_t used_count, used_capacity;
};

typedef enum hyi_vk_kind {
    HYI_VK_DEVICE,  /* on the device; mapped where host and device share their memory, and the host caches it */
    HYI_VK_UPLOAD,  /* the host writes, the device reads */
    HYI_VK_READBACK /* the device writes, the host reads */
} hyi_vk_kind;

/* All zero: none. */
typedef struct hyi_vk_buffer {
    VkBuffer buffer;
    VkDeviceSize size;
    hyi_vk_block *block;
    VkDeviceSize offset;
    void *mapped; /* NULL: the host does not see it */
} hyi_vk_buffer;

/* ---- which memory */

#define HYI_VK_VISIBLE (VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT)

/* The first type among bits with all of wanted, or with all of needed; UINT32_MAX: none. */
HYI_FN uint32_t hyi_vk_find_type(const hyi_vk *vk, uint32_t bits, VkMemoryPropertyFlags wanted, VkMemoryPropertyFlags needed) {
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < vk->memory.memoryTypeCount; i++) {
            VkMemoryPropertyFlags all = pass ? needed : wanted;
            if ((bits >> i & 1u) && (vk->memory.memoryTypes[i].propertyFlags & all) == all) return i;
        }
    return UINT32_MAX;
}

HYI_FN uint32_t hyi_vk_memory_type(const hyi_vk *vk, uint32_t bits, hyi_vk_kind kind) {
    switch (kind) {
    case HYI_VK_DEVICE: return hyi_vk_find_type(vk, bits, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 0);
    case HYI_VK_UPLOAD: return hyi_vk_find_type(vk, bits, HYI_VK_VISIBLE, HYI_VK_VISIBLE);
    default: return hyi_vk_find_type(vk, bits, HYI_VK_VISIBLE | VK_MEMORY_PROPERTY_HOST_CACHED_BIT, HYI_VK_VISIBLE);
    }
}

/* ---- blocks */

HYI_FN void hyi_vk_free_block(hyi_vk *vk, hyi_vk_block *block) {
    if (block->memory) {
        vk->f.FreeMemory(vk->device, block->memory, vk->desc.allocation);
        vk->bytes_now -= block->size;
    }
    hyi_free_array(vk->context, &block->used, block->used_capacity);
    hyi_free_array(vk->context, &block, 1);
}

HYI_FN hydra_result hyi_vk_fill_block(hyi_vk *vk, hyi_vk_block *block) {
    VkMemoryAllocateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
    info.allocationSize = block->size;
    info.memoryTypeIndex = block->type;
    if (vk->desc.memory_cap && vk->bytes_now + block->size > vk->desc.memory_cap)
        return hyi_fail(vk->context, HYDRA_ERROR_DEVICE_MEMORY, "%llu bytes more than the %llu now, the cap is %zu", (unsigned long long)block->size,
                        (unsigned long long)vk->bytes_now, vk->desc.memory_cap);
    HYI_VK_MAKE(vk, "vkAllocateMemory", AllocateMemory(vk->device, &info, vk->desc.allocation, &block->memory), block->memory);
    vk->bytes_now += block->size;
    if (vk->bytes_now > vk->bytes_peak) vk->bytes_peak = vk->bytes_now;
    if ((vk->memory.memoryTypes[block->type].propertyFlags & HYI_VK_VISIBLE) != HYI_VK_VISIBLE) return HYDRA_OK;
    void *mapped;
    HYI_VK_TRY(vk, "vkMapMemory", MapMemory(vk->device, block->memory, 0, VK_WHOLE_SIZE, 0, &mapped));
    block->mapped = (char *)mapped;
    return HYDRA_OK;
}

/* Under a cap, and for what is large, a block is no larger than it must be. */
HYI_FN hydra_result hyi_vk_new_block(hyi_vk *vk, uint32_t type, VkDeviceSize least, hyi_vk_block **made) {
    hyi_vk_block *block;
    HYI_TRY(hyi_alloc_array(vk->context, &block, 1));
    memset(block, 0, sizeof *block);
    block->type = type;
    block->size = least > HYI_VK_BLOCK_BYTES / 2 || vk->desc.memory_cap ? least : HYI_VK_BLOCK_BYTES;
    hydra_result result = hyi_vk_fill_block(vk, block);
    if (result != HYDRA_OK) {
        hyi_vk_free_block(vk, block);
        return result;
    }
    block->next = vk->blocks;
    vk->blocks = block;
    *made = block;
    return HYDRA_OK;
}

/* The first gap of a block for size bytes: before which of the used ranges; false: none. */
HYI_FN bool hyi_vk_find_gap(const hyi_vk_block *block, VkDeviceSize size, VkDeviceSize alignment, size_t *before, VkDeviceSize *offset) {
    VkDeviceSize at = 0;
    for (size_t i = 0; i <= block->used_count; i++) {
        VkDeviceSize end = i < block->used_count ? block->used[i].offset : block->size;
        if (at <= end && end - at >= size) {
            *before = i;
            *offset = at;
            return true;
        }
        if (i < block->used_count) at = (block->used[i].offset + block->used[i].size + alignment - 1) / alignment * alignment;
    }
    return false;
}

HYI_FN hydra_result hyi_vk_take_gap(hyi_vk *vk, hyi_vk_buffer *buffer, hyi_vk_block *block, VkDeviceSize size, size_t before, VkDeviceSize offset) {
    HYI_TRY(hyi_grow_array(vk->context, &block->used, &block->used_capacity, block->used_count + 1));
    memmove(block->used + before + 1, block->used + before, (block->used_count - before) * sizeof *block->used);
    block->used[before].offset = offset;
    block->used[before].size = size;
    block->used_count++;
    buffer->block = block;
    buffer->offset = offset;
    buffer->mapped = block->mapped ? block->mapped + offset : NULL;
    return HYDRA_OK;
}

HYI_FN void hyi_vk_drop_block_if_empty(hyi_vk *vk, hyi_vk_block *block) {
    if (block->used_count) return;
    hyi_vk_block **link = &vk->blocks;
    while (*link != block) link = &(*link)->next;
    *link = block->next;
    hyi_vk_free_block(vk, block);
}

HYI_FN hydra_result hyi_vk_place(hyi_vk *vk, hyi_vk_buffer *buffer, hyi_vk_kind kind) {
    VkMemoryRequirements need;
    vk->f.GetBufferMemoryRequirements(vk->device, buffer->buffer, &need);
    uint32_t type = hyi_vk_memory_type(vk, need.memoryTypeBits, kind);
    size_t before = 0;
    VkDeviceSize offset = 0;
    if (type == UINT32_MAX) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the device has no memory of a kind that is needed");
    hyi_vk_block *block = vk->blocks;
    while (block && !(block->type == type && hyi_vk_find_gap(block, need.size, need.alignment, &before, &offset))) block = block->next;
    if (!block) HYI_TRY(hyi_vk_new_block(vk, type, need.size, &block));
    hydra_result result = hyi_vk_take_gap(vk, buffer, block, need.size, before, offset);
    if (result != HYDRA_OK) hyi_vk_drop_block_if_empty(vk, block);
    bool cached = (vk->memory.memoryTypes[type].propertyFlags & VK_MEMORY_PROPERTY_HOST_CACHED_BIT) != 0;
    if (kind == HYI_VK_DEVICE && !cached) buffer->mapped = NULL; /* reading there is slower than a copy by the device */
    return result;
}

/* ---- buffers */

HYI_FN void hyi_vk_free_buffer_held(hyi_vk *vk, hyi_vk_buffer *buffer) {
    if (buffer->buffer) vk->f.DestroyBuffer(vk->device, buffer->buffer, vk->desc.allocation);
    hyi_vk_block *block = buffer->block;
    if (block) {
        size_t i = 0;
        while (block->used[i].offset != buffer->offset) i++;
        memmove(block->used + i, block->used + i + 1, (block->used_count - i - 1) * sizeof *block->used);
        block->used_count--;
        hyi_vk_drop_block_if_empty(vk, block);
    }
    memset(buffer, 0, sizeof *buffer);
}

HYI_FN hydra_result hyi_vk_make_buffer_held(hyi_vk *vk, hyi_vk_buffer *buffer, hyi_vk_kind kind, VkDeviceSize size, VkBufferUsageFlags usage) {
    VkBufferCreateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
    info.size = size;
    info.usage = usage;
    HYI_VK_MAKE(vk, "vkCreateBuffer", CreateBuffer(vk->device, &info, vk->desc.allocation, &buffer->buffer), buffer->buffer);
    buffer->size = size;
    HYI_TRY(hyi_vk_place(vk, buffer, kind));
    HYI_VK_TRY(vk, "vkBindBufferMemory", BindBufferMemory(vk->device, buffer->buffer, buffer->block->memory, buffer->offset));
    return HYDRA_OK;
}

HYI_FN void hyi_vk_free_buffer(hyi_vk *vk, hyi_vk_buffer *buffer) {
    hyi_vk_acquire(&vk->shared);
    hyi_vk_free_buffer_held(vk, buffer);
    hyi_vk_release(&vk->shared);
}

/* buffer is all zero; so it is after a failure. what: its name in messages. */
HYI_FN hydra_result hyi_vk_make_buffer(hyi_vk *vk, hyi_vk_buffer *buffer, hyi_vk_kind kind, VkDeviceSize size, const char *what) {
    VkBufferUsageFlags usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    if (kind == HYI_VK_DEVICE) usage |= VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT;
    if (kind == HYI_VK_DEVICE && size > vk->limits.maxStorageBufferRange)
        return hyi_fail(vk->context, HYDRA_ERROR_DEVICE_LIMIT, "%s: %llu bytes, %s binds %u", what, (unsigned long long)size, vk->name, vk->limits.maxStorageBufferRange);
    hyi_vk_acquire(&vk->shared);
    hydra_result result = hyi_vk_make_buffer_held(vk, buffer, kind, size ? size : 16, usage);
    if (result != HYDRA_OK) hyi_vk_free_buffer_held(vk, buffer);
    hyi_vk_release(&vk->shared);
    return result;
}

#endif /* HYI_VK_MEMORY_H */
