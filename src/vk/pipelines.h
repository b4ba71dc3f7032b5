/* >>vk-pipelines: kernels made for what a scene requires, once each

   What a kernel is made for stands in specialisation constants, so that an absent feature leaves no code. */
#ifndef HYI_VK_PIPELINES_H
#define HYI_VK_PIPELINES_H

#include "../../shaders/shared/film.h"
#include "memory.h"
#include "spirv.h"

typedef enum hyi_vk_kernel {
#define HYI_VK_KERNEL_ENUM(name) HYI_VK_KERNEL_##name,
    HYI_VK_KERNELS(HYI_VK_KERNEL_ENUM)
#undef HYI_VK_KERNEL_ENUM
    HYI_VK_KERNEL_COUNT
} hyi_vk_kernel;

/* The values of specialisation constants, constant i being word i. */
typedef struct hyi_vk_shape {
    uint32_t features, depth, top_depth, mode, wants;
} hyi_vk_shape;

struct hyi_vk_pipeline {
    hyi_vk_pipeline *next;
    hyi_vk_kernel kernel;
    hyi_vk_shape shape;
    VkPipeline pipeline;
};

#define HYI_VK_TEXEL_BUFFERS 2u
#define HYI_VK_TEXEL 16u /* bytes */

/* ---- layouts */

/* storage buffers, and behind them texel buffers. */
HYI_FN hydra_result hyi_vk_make_set_layout(hyi_vk *vk, uint32_t storage, uint32_t texels, VkDescriptorSetLayout *layout) {
    VkDescriptorSetLayoutBinding bindings[HYI_VK_STORAGE_BUFFERS];
    VkDescriptorSetLayoutCreateInfo info;
    memset(bindings, 0, sizeof bindings);
    memset(&info, 0, sizeof info);
    for (uint32_t i = 0; i < storage + texels; i++) {
        bindings[i].binding = i;
        bindings[i].descriptorType = i < storage ? VK_DESCRIPTOR_TYPE_STORAGE_BUFFER : VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
        bindings[i].descriptorCount = 1;
        bindings[i].stageFlags = VK_SHADER_STAGE_COMPUTE_BIT;
    }
    info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
    info.bindingCount = storage + texels;
    info.pBindings = bindings;
    HYI_VK_MAKE(vk, "vkCreateDescriptorSetLayout", CreateDescriptorSetLayout(vk->device, &info, vk->desc.allocation, layout), *layout);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_make_layout(hyi_vk *vk, const VkDescriptorSetLayout *sets, uint32_t set_count, uint32_t push_bytes, VkPipelineLayout *layout) {
    VkPushConstantRange push = { VK_SHADER_STAGE_COMPUTE_BIT, 0, push_bytes };
    VkPipelineLayoutCreateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    info.setLayoutCount = set_count;
    info.pSetLayouts = sets;
    info.pushConstantRangeCount = 1;
    info.pPushConstantRanges = &push;
    HYI_VK_MAKE(vk, "vkCreatePipelineLayout", CreatePipelineLayout(vk->device, &info, vk->desc.allocation, layout), *layout);
    return HYDRA_OK;
}

/* Kernels over films have sets of their own, so that no stage needs the storage buffers of both. */
HYI_FN hydra_result hyi_vk_make_layouts(hyi_vk *vk) {
    HYI_TRY(hyi_vk_make_set_layout(vk, HYK_SCENE_BINDINGS, HYI_VK_TEXEL_BUFFERS, &vk->scene_layout));
    HYI_TRY(hyi_vk_make_set_layout(vk, HYK_PASS_BINDINGS, 0, &vk->pass_layout));
    HYI_TRY(hyi_vk_make_set_layout(vk, HYK_FILM_BINDINGS, 0, &vk->film_set_layout));
    VkDescriptorSetLayout sets[2] = { vk->scene_layout, vk->pass_layout };
    HYI_TRY(hyi_vk_make_layout(vk, sets, 2, sizeof(hyk_dispatch), &vk->layout));
    return hyi_vk_make_layout(vk, &vk->film_set_layout, 1, sizeof(hyk_film_call), &vk->film_layout);
}

HYI_FN bool hyi_vk_kernel_is_of_films(hyi_vk_kernel kernel) { return kernel == HYI_VK_KERNEL_accumulate || kernel == HYI_VK_KERNEL_resolve; }

/* A cache that does not fit the device is the driver's to refuse: an empty one then. */
HYI_FN hydra_result hyi_vk_make_cache(hyi_vk *vk) {
    VkPipelineCacheCreateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO;
    info.initialDataSize = vk->desc.pipeline_cache ? vk->desc.pipeline_cache_size : 0;
    info.pInitialData = info.initialDataSize ? vk->desc.pipeline_cache : NULL;
    if (vk->f.CreatePipelineCache(vk->device, &info, vk->desc.allocation, &vk->cache) >= 0) return HYDRA_OK;
    info.initialDataSize = 0;
    info.pInitialData = NULL;
    HYI_VK_MAKE(vk, "vkCreatePipelineCache", CreatePipelineCache(vk->device, &info, vk->desc.allocation, &vk->cache), vk->cache);
    return HYDRA_OK;
}

/* ---- descriptor sets */

typedef struct hyi_vk_set {
    VkDescriptorPool pool;
    VkDescriptorSet set;
} hyi_vk_set;

HYI_FN void hyi_vk_free_set(hyi_vk *vk, hyi_vk_set *set) {
    if (set->pool) vk->f.DestroyDescriptorPool(vk->device, set->pool, vk->desc.allocation);
    memset(set, 0, sizeof *set);
}

HYI_FN hydra_result hyi_vk_make_set(hyi_vk *vk, VkDescriptorSetLayout layout, uint32_t storage, uint32_t texels, hyi_vk_set *set) {
    VkDescriptorPoolSize sizes[2] = { { VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, storage }, { VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, texels } };
    VkDescriptorPoolCreateInfo pool;
    VkDescriptorSetAllocateInfo info;
    memset(&pool, 0, sizeof pool);
    memset(&info, 0, sizeof info);
    pool.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
    pool.maxSets = 1;
    pool.poolSizeCount = texels ? 2 : 1;
    pool.pPoolSizes = sizes;
    HYI_VK_MAKE(vk, "vkCreateDescriptorPool", CreateDescriptorPool(vk->device, &pool, vk->desc.allocation, &set->pool), set->pool);
    info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
    info.descriptorPool = set->pool;
    info.descriptorSetCount = 1;
    info.pSetLayouts = &layout;
    HYI_VK_MAKE(vk, "vkAllocateDescriptorSets", AllocateDescriptorSets(vk->device, &info, &set->set), set->set);
    return HYDRA_OK;
}

/* Binding i is buffers[i]. */
HYI_FN void hyi_vk_write_set(hyi_vk *vk, const hyi_vk_set *set, const hyi_vk_buffer *buffers, uint32_t count) {
    VkDescriptorBufferInfo infos[HYI_VK_STORAGE_BUFFERS];
    VkWriteDescriptorSet write;
    memset(&write, 0, sizeof write);
    for (uint32_t i = 0; i < count; i++) {
        infos[i].buffer = buffers[i].buffer;
        infos[i].offset = 0;
        infos[i].range = VK_WHOLE_SIZE;
    }
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstSet = set->set;
    write.descriptorCount = count; /* runs on from binding 0 through the following ones */
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = infos;
    vk->f.UpdateDescriptorSets(vk->device, 1, &write, 0, NULL);
}

HYI_FN void hyi_vk_write_texels(hyi_vk *vk, const hyi_vk_set *set, uint32_t binding, VkBufferView view) {
    VkWriteDescriptorSet write;
    memset(&write, 0, sizeof write);
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstSet = set->set;
    write.dstBinding = binding;
    write.descriptorCount = 1;
    write.descriptorType = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
    write.pTexelBufferView = &view;
    vk->f.UpdateDescriptorSets(vk->device, 1, &write, 0, NULL);
}

/* ---- pipelines */

HYI_FN void hyi_vk_kernel_words(hyi_vk_kernel kernel, const uint32_t **words, size_t *bytes) {
    switch (kernel) {
#define HYI_VK_KERNEL_CASE(name) case HYI_VK_KERNEL_##name: *words = hyk_spirv_##name; *bytes = sizeof hyk_spirv_##name; return;
    HYI_VK_KERNELS(HYI_VK_KERNEL_CASE)
#undef HYI_VK_KERNEL_CASE
    default: *words = NULL, *bytes = 0;
    }
}

HYI_FN hydra_result hyi_vk_build_pipeline(hyi_vk *vk, hyi_vk_pipeline *p) {
    VkSpecializationMapEntry entries[sizeof(hyi_vk_shape) / 4];
    VkSpecializationInfo constants;
    VkShaderModuleCreateInfo code;
    VkComputePipelineCreateInfo info;
    VkShaderModule module;
    for (uint32_t i = 0; i < sizeof entries / sizeof entries[0]; i++) {
        entries[i].constantID = i;
        entries[i].offset = 4 * i;
        entries[i].size = 4;
    }
    constants.mapEntryCount = sizeof entries / sizeof entries[0];
    constants.pMapEntries = entries;
    constants.dataSize = sizeof p->shape;
    constants.pData = &p->shape;
    memset(&code, 0, sizeof code);
    code.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    hyi_vk_kernel_words(p->kernel, &code.pCode, &code.codeSize);
    HYI_VK_TRY(vk, "vkCreateShaderModule", CreateShaderModule(vk->device, &code, vk->desc.allocation, &module));
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
    info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
    info.stage.module = module;
    info.stage.pName = "main";
    info.stage.pSpecializationInfo = &constants;
    info.layout = hyi_vk_kernel_is_of_films(p->kernel) ? vk->film_layout : vk->layout;
    VkResult result = vk->f.CreateComputePipelines(vk->device, vk->cache, 1, &info, vk->desc.allocation, &p->pipeline);
    vk->f.DestroyShaderModule(vk->device, module, vk->desc.allocation);
    return hyi_vk_result(vk, result, "vkCreateComputePipelines");
}

HYI_FN hydra_result hyi_vk_add_pipeline(hyi_vk *vk, hyi_vk_kernel kernel, const hyi_vk_shape *shape, VkPipeline *made) {
    double start = hyi_seconds();
    hyi_vk_pipeline *p;
    HYI_TRY(hyi_alloc_array(vk->context, &p, 1));
    memset(p, 0, sizeof *p);
    p->kernel = kernel;
    p->shape = *shape;
    hydra_result result = hyi_vk_build_pipeline(vk, p);
    if (result != HYDRA_OK) {
        hyi_free_array(vk->context, &p, 1);
        return result;
    }
    p->next = vk->pipelines;
    vk->pipelines = p;
    vk->pipeline_count++;
    vk->seconds_pipelines += hyi_seconds() - start;
    *made = p->pipeline;
    return HYDRA_OK;
}

/* The pipeline of a kernel for a shape, made if there is none. */
HYI_FN hydra_result hyi_vk_get_pipeline(hyi_vk *vk, hyi_vk_kernel kernel, const hyi_vk_shape *shape, VkPipeline *pipeline) {
    hydra_result result = HYDRA_OK;
    hyi_vk_acquire(&vk->shared);
    hyi_vk_pipeline *p = vk->pipelines;
    while (p && !(p->kernel == kernel && memcmp(&p->shape, shape, sizeof *shape) == 0)) p = p->next;
    if (p) *pipeline = p->pipeline;
    else result = hyi_vk_add_pipeline(vk, kernel, shape, pipeline);
    hyi_vk_release(&vk->shared);
    return result;
}

HYI_FN void hyi_vk_free_pipelines(hyi_vk *vk) {
    for (hyi_vk_pipeline *p = vk->pipelines; p;) {
        hyi_vk_pipeline *next = p->next;
        vk->f.DestroyPipeline(vk->device, p->pipeline, vk->desc.allocation);
        hyi_free_array(vk->context, &p, 1);
        p = next;
    }
    vk->pipelines = NULL;
    if (vk->cache) vk->f.DestroyPipelineCache(vk->device, vk->cache, vk->desc.allocation);
    if (vk->layout) vk->f.DestroyPipelineLayout(vk->device, vk->layout, vk->desc.allocation);
    if (vk->film_layout) vk->f.DestroyPipelineLayout(vk->device, vk->film_layout, vk->desc.allocation);
    if (vk->film_set_layout) vk->f.DestroyDescriptorSetLayout(vk->device, vk->film_set_layout, vk->desc.allocation);
    if (vk->pass_layout) vk->f.DestroyDescriptorSetLayout(vk->device, vk->pass_layout, vk->desc.allocation);
    if (vk->scene_layout) vk->f.DestroyDescriptorSetLayout(vk->device, vk->scene_layout, vk->desc.allocation);
}

#endif /* HYI_VK_PIPELINES_H */
