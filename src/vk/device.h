/* >>vk-device: finding a device that will do, and making it ready */
#ifndef HYI_VK_DEVICE_H
#define HYI_VK_DEVICE_H

#include "functions.h"

#define HYI_VK_STORAGE_BUFFERS (HYK_SCENE_BINDINGS + HYK_PASS_BINDINGS)
#define HYI_VK_DEVICES_MOST 64u

/* Memory comes from few large blocks (memory.h). */
typedef struct hyi_vk_block hyi_vk_block;
typedef struct hyi_vk_pipeline hyi_vk_pipeline;
typedef struct hyi_vk_asker hyi_vk_asker;

/* Between threads that cast rays. Without threads there is nothing to wait for. */
#if defined(HYDRA_NO_THREADS)
typedef int hyi_vk_lock;
#define hyi_vk_lock_init(lock) ((void)(*(lock) = 0))
#define hyi_vk_lock_destroy(lock) ((void)(lock))
#define hyi_vk_acquire(lock) ((void)(lock))
#define hyi_vk_release(lock) ((void)(lock))
#else
typedef hyi_mutex hyi_vk_lock;
#define hyi_vk_lock_init(lock) hyi_mutex_init(lock)
#define hyi_vk_lock_destroy(lock) hyi_mutex_destroy(lock)
#define hyi_vk_acquire(lock) hyi_mutex_lock(lock)
#define hyi_vk_release(lock) hyi_mutex_unlock(lock)
#endif

/* A context's device. */
typedef struct hyi_vk {
    hydra_context *context;
    hydra_vk_desc desc; /* pointers to strings and cache are not valid after create */
    hyi_vk_functions f;
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    bool owns_instance, owns_device, times; /* times: the queue writes timestamps */
    double seconds_a_tick;
    VkDebugUtilsMessengerEXT messenger;
    hyi_atomic validation_messages;
    hydra_vk_device_type type;
    VkPhysicalDeviceLimits limits;
    VkPhysicalDeviceMemoryProperties memory;
    hyi_atomic lost;
    hyi_vk_lock shared, asking; /* the first guards the queue and all below; the second lets one thread at a time cast rays */
    hyi_vk_block *blocks;
    uint64_t bytes_now, bytes_peak;
    VkDescriptorSetLayout scene_layout, pass_layout, film_set_layout;
    VkPipelineLayout layout, film_layout;
    VkPipelineCache cache;
    hyi_vk_pipeline *pipelines;
    hyi_vk_asker *asker; /* made when first rays are cast */
    uint32_t pipeline_count;
    double seconds_start, seconds_pipelines, slice_total, slice_longest;
    uint64_t bytes_read; /* by the host */
    uint64_t submissions, slices; /* slices: submissions of work, not of uploads */
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
} hyi_vk;

HYI_FN hydra_result hyi_vk_fail(hyi_vk *vk, hydra_result result, const char *what) { return hyi_fail(vk->context, result, "%s", what); }

/* What a VkResult below zero means to a caller. */
HYI_FN hydra_result hyi_vk_result(hyi_vk *vk, VkResult result, const char *what) {
    if (result >= 0) return HYDRA_OK;
    if (result == VK_ERROR_DEVICE_LOST) {
        hyi_atomic_store(&vk->lost, 1);
        return hyi_fail(vk->context, HYDRA_ERROR_DEVICE_LOST, "%s", what);
    }
    if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY) return hyi_fail(vk->context, HYDRA_ERROR_DEVICE_MEMORY, "%s", what);
    if (result == VK_ERROR_OUT_OF_HOST_MEMORY) return hyi_fail(vk->context, HYDRA_ERROR_OUT_OF_MEMORY, "%s: the driver", what);
    return hyi_fail(vk->context, HYDRA_ERROR_DEVICE, "%s gave VkResult %d", what, (int)result);
}
#define HYI_VK_TRY(vk, what, call) HYI_TRY(hyi_vk_result((vk), (vk)->f.call, what))
/* The same for a call that makes handle: what a failing one leaves in it is undefined. */
#define HYI_VK_MAKE(vk, what, call, handle)                              \
    do {                                                                 \
        hydra_result hyi_made = hyi_vk_result((vk), (vk)->f.call, what); \
        if (hyi_made != HYDRA_OK) {                                      \
            (handle) = VK_NULL_HANDLE;                                   \
            return hyi_made;                                             \
        }                                                                \
    } while (0)

/* To be asked before anything is begun that needs the device. */
HYI_FN hydra_result hyi_vk_check_lost(hyi_vk *vk) {
    return hyi_atomic_load(&vk->lost) ? hyi_vk_fail(vk, HYDRA_ERROR_DEVICE_LOST, "it was lost before") : HYDRA_OK;
}

/* ---- instance */

HYI_FN bool hyi_vk_has_layer(const hyi_vk_functions *f, const char *name) {
    VkLayerProperties layers[64];
    uint32_t count = 64;
    if (f->EnumerateInstanceLayerProperties(&count, layers) < 0) return false;
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(layers[i].layerName, name) == 0) return true;
    return false;
}

HYI_FN VkBool32 VKAPI_PTR hyi_vk_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity, VkDebugUtilsMessageTypeFlagsEXT types,
                                         const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    hyi_vk *vk = (hyi_vk *)user;
    (void)types;
    hyi_atomic_add(&vk->validation_messages, 1);
    hyi_log(vk->context, severity >= VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT ? HYDRA_LOG_ERROR : HYDRA_LOG_WARNING, data->pMessage);
    return VK_FALSE;
}

HYI_FN VkDebugUtilsMessengerCreateInfoEXT hyi_vk_messenger_info(hyi_vk *vk) {
    VkDebugUtilsMessengerCreateInfoEXT info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
    info.pfnUserCallback = hyi_vk_message;
    info.pUserData = vk;
    return info;
}

/* validation: layers and extension are there. */
HYI_FN VkResult hyi_vk_create_instance(hyi_vk_functions *f, hyi_vk *vk, bool validation, VkInstance *instance) {
    const char *layer = "VK_LAYER_KHRONOS_validation", *extension = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
    VkValidationFeatureEnableEXT synchronization = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
    VkDebugUtilsMessengerCreateInfoEXT messenger;
    VkValidationFeaturesEXT features;
    VkApplicationInfo application;
    VkInstanceCreateInfo info;
    memset(&features, 0, sizeof features);
    memset(&application, 0, sizeof application);
    memset(&info, 0, sizeof info);
    application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    application.pEngineName = "hydra";
    application.apiVersion = VK_API_VERSION_1_2;
    info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
    info.pApplicationInfo = &application;
    if (validation) {
        messenger = hyi_vk_messenger_info(vk);
        features.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
        features.pNext = &messenger;
        features.enabledValidationFeatureCount = 1;
        features.pEnabledValidationFeatures = &synchronization;
        info.pNext = &features;
        info.enabledLayerCount = info.enabledExtensionCount = 1;
        info.ppEnabledLayerNames = &layer;
        info.ppEnabledExtensionNames = &extension;
    }
    return f->CreateInstance(&info, vk ? vk->desc.allocation : NULL, instance);
}

/* ---- what a device has */

HYI_FN hydra_vk_device_type hyi_vk_type(VkPhysicalDeviceType type) {
    switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU: return HYDRA_VK_DEVICE_DISCRETE;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU: return HYDRA_VK_DEVICE_INTEGRATED;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU: return HYDRA_VK_DEVICE_VIRTUAL;
    default: return HYDRA_VK_DEVICE_CPU;
    }
}

/* The family with compute, preferably without graphics: its work stands in nobody's way. UINT32_MAX: none. */
HYI_FN uint32_t hyi_vk_compute_family(const hyi_vk_functions *f, VkPhysicalDevice physical, uint32_t *timestamp_bits) {
    VkQueueFamilyProperties families[32];
    uint32_t count = 32, best = UINT32_MAX;
    f->GetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    for (uint32_t i = 0; i < count; i++) {
        if (!(families[i].queueFlags & VK_QUEUE_COMPUTE_BIT)) continue;
        if (best == UINT32_MAX || !(families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT)) best = i;
    }
    if (best != UINT32_MAX && timestamp_bits) *timestamp_bits = families[best].timestampValidBits;
    return best;
}

HYI_FN bool hyi_vk_has_ballot(const hyi_vk_functions *f, VkPhysicalDevice physical) {
    VkPhysicalDeviceSubgroupProperties subgroup;
    VkPhysicalDeviceProperties2 properties;
    memset(&subgroup, 0, sizeof subgroup);
    memset(&properties, 0, sizeof properties);
    subgroup.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES;
    properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
    properties.pNext = &subgroup;
    f->GetPhysicalDeviceProperties2(physical, &properties);
    const VkSubgroupFeatureFlags needed = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_BALLOT_BIT;
    return (subgroup.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT) && (subgroup.supportedOperations & needed) == needed;
}

/* Writes what the device lacks, "" for nothing. */
HYI_FN void hyi_vk_tell_lacks(const hyi_vk_functions *f, VkPhysicalDevice physical, const VkPhysicalDeviceProperties *p, char lacks[128]) {
    VkPhysicalDeviceFeatures features;
    lacks[0] = 0;
    if (p->apiVersion < VK_API_VERSION_1_2) {
        snprintf(lacks, 128, "Vulkan 1.2 (it has %u.%u)", VK_API_VERSION_MAJOR(p->apiVersion), VK_API_VERSION_MINOR(p->apiVersion));
        return;
    }
    f->GetPhysicalDeviceFeatures(physical, &features);
    const VkPhysicalDeviceLimits *l = &p->limits;
    if (!features.shaderFloat64) snprintf(lacks, 128, "shaderFloat64");
    else if (hyi_vk_compute_family(f, physical, NULL) == UINT32_MAX) snprintf(lacks, 128, "a queue with compute");
    else if (!hyi_vk_has_ballot(f, physical)) snprintf(lacks, 128, "subgroup ballot in compute shaders");
    else if (l->maxPerStageDescriptorStorageBuffers < HYI_VK_STORAGE_BUFFERS)
        snprintf(lacks, 128, "%u storage buffers a stage (it has %u)", HYI_VK_STORAGE_BUFFERS, l->maxPerStageDescriptorStorageBuffers);
    else if (l->maxComputeWorkGroupInvocations < HYK_GROUP || l->maxComputeWorkGroupSize[0] < HYK_GROUP) snprintf(lacks, 128, "workgroups of %u", HYK_GROUP);
}

HYI_FN uint64_t hyi_vk_largest_heap(const VkPhysicalDeviceMemoryProperties *memory) {
    uint64_t most = 0;
    for (uint32_t i = 0; i < memory->memoryHeapCount; i++)
        if ((memory->memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) && memory->memoryHeaps[i].size > most) most = memory->memoryHeaps[i].size;
    return most;
}

HYI_FN void hyi_vk_describe(const hyi_vk_functions *f, VkPhysicalDevice physical, hydra_vk_device_info *info) {
    VkPhysicalDeviceProperties properties;
    VkPhysicalDeviceMemoryProperties memory;
    f->GetPhysicalDeviceProperties(physical, &properties);
    f->GetPhysicalDeviceMemoryProperties(physical, &memory);
    memset(info, 0, sizeof *info);
    memcpy(info->name, properties.deviceName, sizeof info->name);
    info->type = hyi_vk_type(properties.deviceType);
    info->api_version = properties.apiVersion;
    info->driver_version = properties.driverVersion;
    info->memory = hyi_vk_largest_heap(&memory);
    info->binding_most = properties.limits.maxStorageBufferRange;
    hyi_vk_tell_lacks(f, physical, &properties, info->lacks);
}

/* ---- choice */

HYI_FN bool hyi_vk_device_fits(const hydra_vk_desc *desc, const hydra_vk_device_info *info, uint32_t number) {
    if (desc->device_number && desc->device_number != number) return false;
    if (desc->device_name && !strstr(info->name, desc->device_name)) return false;
    return desc->device_type == HYDRA_VK_DEVICE_ANY || desc->device_type == info->type;
}

/* The first of the best type among those that fit and lack nothing. */
HYI_FN hydra_result hyi_vk_choose(hyi_vk *vk) {
    VkPhysicalDevice devices[HYI_VK_DEVICES_MOST];
    uint32_t count = HYI_VK_DEVICES_MOST, fitting = 0;
    hydra_vk_device_info info, best;
    memset(&best, 0, sizeof best);
    HYI_VK_TRY(vk, "vkEnumeratePhysicalDevices", EnumeratePhysicalDevices(vk->instance, &count, devices));
    for (uint32_t i = 0; i < count; i++) {
        hyi_vk_describe(&vk->f, devices[i], &info);
        if (!hyi_vk_device_fits(&vk->desc, &info, i + 1)) continue;
        if (!fitting++ || (best.lacks[0] && !info.lacks[0]) || (!best.lacks[0] == !info.lacks[0] && info.type < best.type)) {
            best = info;
            vk->physical = devices[i];
        }
    }
    if (!count) return hyi_fail(vk->context, HYDRA_ERROR_DEVICE, "the Vulkan loader knows no device");
    if (!fitting) return hyi_fail(vk->context, HYDRA_ERROR_DEVICE, "none of the %u devices has the number, name and type asked for", count);
    return HYDRA_OK;
}

/* ---- making it */

HYI_FN hydra_result hyi_vk_make_device(hyi_vk *vk) {
    float priority = 1.0f;
    VkDeviceQueueCreateInfo queue;
    VkPhysicalDeviceFeatures features;
    VkDeviceCreateInfo info;
    memset(&queue, 0, sizeof queue);
    memset(&features, 0, sizeof features);
    memset(&info, 0, sizeof info);
    queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
    queue.queueFamilyIndex = vk->family;
    queue.queueCount = 1;
    queue.pQueuePriorities = &priority;
    features.shaderFloat64 = VK_TRUE;
    info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
    info.queueCreateInfoCount = 1;
    info.pQueueCreateInfos = &queue;
    info.pEnabledFeatures = &features;
    HYI_VK_MAKE(vk, "vkCreateDevice", CreateDevice(vk->physical, &info, vk->desc.allocation, &vk->device), vk->device);
    vk->owns_device = true;
    if (!hyi_vk_load_device(&vk->f, vk->device)) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the device lacks functions of Vulkan 1.2");
    vk->f.GetDeviceQueue(vk->device, vk->family, 0, &vk->queue);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_take_instance(hyi_vk *vk) {
    const hydra_vk_desc *d = &vk->desc;
    if (!hyi_vk_open(&vk->f, d->get_instance_proc_addr)) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "no Vulkan loader was found");
    vk->instance = d->instance;
    bool validate = d->validation && !d->instance;
    if (validate && !hyi_vk_has_layer(&vk->f, "VK_LAYER_KHRONOS_validation"))
        return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "VK_LAYER_KHRONOS_validation is not installed");
    if (!d->instance) {
        VkResult made = hyi_vk_create_instance(&vk->f, vk, validate, &vk->instance);
        if (made == VK_ERROR_INCOMPATIBLE_DRIVER) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the Vulkan loader knows no device of Vulkan 1.2");
        HYI_TRY(hyi_vk_result(vk, made, "vkCreateInstance"));
        vk->owns_instance = true;
    }
    if (!hyi_vk_load_instance(&vk->f, vk->instance)) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the instance lacks functions of Vulkan 1.2");
    if (!validate) return HYDRA_OK;
    VkDebugUtilsMessengerCreateInfoEXT messenger = hyi_vk_messenger_info(vk);
    if (!vk->f.CreateDebugUtilsMessengerEXT || !vk->f.DestroyDebugUtilsMessengerEXT) return hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the instance lacks functions of VK_EXT_debug_utils");
    HYI_VK_MAKE(vk, "vkCreateDebugUtilsMessengerEXT", CreateDebugUtilsMessengerEXT(vk->instance, &messenger, d->allocation, &vk->messenger), vk->messenger);
    return HYDRA_OK;
}

HYI_FN void hyi_vk_keep_facts(hyi_vk *vk) {
    VkPhysicalDeviceProperties properties;
    VkQueueFamilyProperties families[32];
    uint32_t count = 32;
    vk->f.GetPhysicalDeviceProperties(vk->physical, &properties);
    vk->f.GetPhysicalDeviceMemoryProperties(vk->physical, &vk->memory);
    vk->f.GetPhysicalDeviceQueueFamilyProperties(vk->physical, &count, families);
    vk->limits = properties.limits;
    vk->type = hyi_vk_type(properties.deviceType);
    vk->times = vk->family < count && families[vk->family].timestampValidBits != 0;
    vk->seconds_a_tick = 1e-9 * (double)properties.limits.timestampPeriod;
    memcpy(vk->name, properties.deviceName, sizeof vk->name);
}

HYI_FN hydra_result hyi_vk_take_device(hyi_vk *vk) {
    const hydra_vk_desc *d = &vk->desc;
    if ((d->device != VK_NULL_HANDLE) != (d->queue != VK_NULL_HANDLE) || (d->device && (!d->physical_device || !d->instance)))
        return hyi_vk_fail(vk, HYDRA_ERROR_NULL, "a device of yours needs its instance, physical device and queue");
    if (d->physical_device && !d->instance) return hyi_vk_fail(vk, HYDRA_ERROR_NULL, "a physical device of yours needs its instance");
    vk->physical = d->physical_device;
    if (!vk->physical) HYI_TRY(hyi_vk_choose(vk));
    hydra_vk_device_info info;
    hyi_vk_describe(&vk->f, vk->physical, &info);
    if (info.lacks[0]) return hyi_fail(vk->context, HYDRA_ERROR_DEVICE, "%s lacks %s", info.name, info.lacks);
    vk->family = d->device ? d->queue_family : hyi_vk_compute_family(&vk->f, vk->physical, NULL);
    hyi_vk_keep_facts(vk);
    if (!d->device) return hyi_vk_make_device(vk);
    vk->device = d->device;
    vk->queue = d->queue;
    return hyi_vk_load_device(&vk->f, vk->device) ? HYDRA_OK : hyi_vk_fail(vk, HYDRA_ERROR_DEVICE, "the device lacks functions of Vulkan 1.2");
}

HYI_FN void hyi_vk_release_device(hyi_vk *vk) {
    if (vk->owns_device && vk->f.DestroyDevice) vk->f.DestroyDevice(vk->device, vk->desc.allocation);
    if (vk->messenger) vk->f.DestroyDebugUtilsMessengerEXT(vk->instance, vk->messenger, vk->desc.allocation);
    if (vk->owns_instance && vk->f.DestroyInstance) vk->f.DestroyInstance(vk->instance, vk->desc.allocation);
    hyi_vk_close_library(&vk->f);
}

#endif /* HYI_VK_DEVICE_H */
