/* One Vulkan device for all contexts of a test run, and one shader module and pipeline for all that are made alike.

   Making a context's pipelines takes lavapipe and the validation layer some seconds, its work in most tests some
   milliseconds. So hydra_test.h gives the library this loader: instance and device are made by the first context and kept,
   and so are modules of the same words and pipelines of the same module and constants (layouts that are defined alike are
   compatible). All other calls go straight to Vulkan. What a context forgets to destroy the layer reports when the device
   goes, at the end of the run.
   tests/test_vk_*.c make contexts with devices of their own. */
#ifdef HT_VULKAN
#include "hydra_test.h"

#include <dlfcn.h>
#include <pthread.h>

#include "hydra_test_run.h"

typedef struct shared_pipeline {
    uint64_t key;
    VkPipeline pipeline;
} shared_pipeline;

typedef struct known_module {
    VkShaderModule module;
    uint64_t words; /* hash of its SPIR-V */
} known_module;

static struct {
    pthread_mutex_t mutex, queue;
    PFN_vkGetInstanceProcAddr load;
    PFN_vkGetDeviceProcAddr load_device;
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    shared_pipeline pipelines[4096];
    known_module modules[64];
    uint32_t pipeline_count, module_count;
    uint64_t last_messages;
} shared = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_MUTEX_INITIALIZER, NULL, NULL, NULL, NULL, NULL, {{0, NULL}}, {{NULL, 0}}, 0, 0, 0};

/* ISO C converts no function pointers to void *, POSIX does. */
#define INSTANCE_FUNCTION(name) ((PFN_vk##name)(uintptr_t)shared.load(shared.instance, "vk" #name))
#define DEVICE_FUNCTION(name) ((PFN_vk##name)(uintptr_t)shared.load_device(shared.device, "vk" #name))

/* FNV-1a (Fowler, Noll, Vo). */
static uint64_t hash(uint64_t seed, const void *data, size_t size) {
    const unsigned char *bytes = (const unsigned char *)data;
    for (size_t i = 0; i < size; i++) seed = (seed ^ bytes[i]) * 0x100000001b3u;
    return seed;
}

static VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo *info, const VkAllocationCallbacks *callbacks, VkInstance *instance) {
    pthread_mutex_lock(&shared.mutex);
    VkResult result = VK_SUCCESS;
    if (!shared.instance) result = ((PFN_vkCreateInstance)(uintptr_t)shared.load(NULL, "vkCreateInstance"))(info, callbacks, &shared.instance);
    *instance = shared.instance;
    pthread_mutex_unlock(&shared.mutex);
    return result;
}

static void VKAPI_CALL keep_instance(VkInstance instance, const VkAllocationCallbacks *callbacks) {
    (void)instance;
    (void)callbacks;
}

static VkResult VKAPI_CALL create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo *info, const VkAllocationCallbacks *callbacks,
                                         VkDevice *device) {
    pthread_mutex_lock(&shared.mutex);
    VkResult result = VK_SUCCESS;
    if (!shared.device) {
        result = INSTANCE_FUNCTION(CreateDevice)(physical, info, callbacks, &shared.device);
        shared.physical = physical;
    } else if (physical != shared.physical) {
        result = VK_ERROR_INITIALIZATION_FAILED; /* tests that use several devices make them themselves */
    }
    *device = result == VK_SUCCESS ? shared.device : NULL;
    pthread_mutex_unlock(&shared.mutex);
    return result;
}

static void VKAPI_CALL keep_device(VkDevice device, const VkAllocationCallbacks *callbacks) {
    (void)device;
    (void)callbacks;
}

static VkResult VKAPI_CALL create_module(VkDevice device, const VkShaderModuleCreateInfo *info, const VkAllocationCallbacks *callbacks,
                                         VkShaderModule *module) {
    pthread_mutex_lock(&shared.mutex);
    VkResult result = VK_SUCCESS;
    const uint64_t words = hash(0xcbf29ce484222325u, info->pCode, info->codeSize);
    uint32_t i = 0;
    while (i < shared.module_count && shared.modules[i].words != words) i++;
    if (i < shared.module_count) *module = shared.modules[i].module;
    else result = DEVICE_FUNCTION(CreateShaderModule)(device, info, callbacks, module);
    if (result == VK_SUCCESS && i == shared.module_count && i < sizeof shared.modules / sizeof shared.modules[0]) {
        shared.modules[i].module = *module;
        shared.modules[i].words = words;
        shared.module_count++;
    }
    pthread_mutex_unlock(&shared.mutex);
    return result;
}

static void VKAPI_CALL destroy_module(VkDevice device, VkShaderModule module, const VkAllocationCallbacks *callbacks) {
    pthread_mutex_lock(&shared.mutex);
    bool kept = false;
    for (uint32_t i = 0; i < shared.module_count; i++) kept = kept || shared.modules[i].module == module;
    if (!kept) DEVICE_FUNCTION(DestroyShaderModule)(device, module, callbacks);
    pthread_mutex_unlock(&shared.mutex);
}

/* What makes a pipeline what it is: 0 if that is not known. */
static uint64_t key_of(const VkComputePipelineCreateInfo *info) {
    const VkSpecializationInfo *constants = info->stage.pSpecializationInfo;
    uint64_t key = 0;
    for (uint32_t i = 0; i < shared.module_count && !key; i++) {
        if (shared.modules[i].module == info->stage.module) key = shared.modules[i].words;
    }
    if (!key || info->pNext || info->stage.pNext || info->flags || info->stage.flags) return 0;
    key = hash(key, info->stage.pName, strlen(info->stage.pName));
    if (!constants) return key;
    for (uint32_t i = 0; i < constants->mapEntryCount; i++) {
        const VkSpecializationMapEntry *entry = &constants->pMapEntries[i];
        key = hash(key, &entry->constantID, sizeof entry->constantID);
        key = hash(key, (const char *)constants->pData + entry->offset, entry->size);
    }
    return key;
}

static VkResult create_pipeline(VkDevice device, VkPipelineCache cache, const VkComputePipelineCreateInfo *info,
                                const VkAllocationCallbacks *callbacks, VkPipeline *pipeline) {
    uint64_t key = key_of(info);
    for (uint32_t i = 0; key && i < shared.pipeline_count; i++) {
        if (shared.pipelines[i].key != key) continue;
        *pipeline = shared.pipelines[i].pipeline;
        return VK_SUCCESS;
    }
    VkResult result = DEVICE_FUNCTION(CreateComputePipelines)(device, cache, 1, info, callbacks, pipeline);
    if (result != VK_SUCCESS || !key || shared.pipeline_count == sizeof shared.pipelines / sizeof shared.pipelines[0]) return result;
    shared.pipelines[shared.pipeline_count].key = key;
    shared.pipelines[shared.pipeline_count++].pipeline = *pipeline;
    return result;
}

static VkResult VKAPI_CALL create_pipelines(VkDevice device, VkPipelineCache cache, uint32_t count, const VkComputePipelineCreateInfo *infos,
                                            const VkAllocationCallbacks *callbacks, VkPipeline *pipelines) {
    pthread_mutex_lock(&shared.mutex);
    VkResult result = VK_SUCCESS;
    for (uint32_t i = 0; i < count; i++) {
        pipelines[i] = VK_NULL_HANDLE;
        VkResult one = create_pipeline(device, cache, &infos[i], callbacks, &pipelines[i]);
        if (one != VK_SUCCESS) result = one;
    }
    pthread_mutex_unlock(&shared.mutex);
    return result;
}

static void VKAPI_CALL destroy_pipeline(VkDevice device, VkPipeline pipeline, const VkAllocationCallbacks *callbacks) {
    pthread_mutex_lock(&shared.mutex);
    bool kept = false;
    for (uint32_t i = 0; i < shared.pipeline_count; i++) kept = kept || shared.pipelines[i].pipeline == pipeline;
    if (!kept) DEVICE_FUNCTION(DestroyPipeline)(device, pipeline, callbacks);
    pthread_mutex_unlock(&shared.mutex);
}

static PFN_vkVoidFunction VKAPI_CALL load_device(VkDevice device, const char *name);

static PFN_vkVoidFunction own(const char *name) {
#define OWN(function, body) \
    if (!strcmp(name, "vk" #function)) return (PFN_vkVoidFunction)(uintptr_t)body
    OWN(CreateInstance, create_instance);
    OWN(DestroyInstance, keep_instance);
    OWN(CreateDevice, create_device);
    OWN(DestroyDevice, keep_device);
    OWN(GetDeviceProcAddr, load_device);
    OWN(CreateShaderModule, create_module);
    OWN(DestroyShaderModule, destroy_module);
    OWN(CreateComputePipelines, create_pipelines);
    OWN(DestroyPipeline, destroy_pipeline);
    return NULL;
}

static PFN_vkVoidFunction VKAPI_CALL load_device(VkDevice device, const char *name) {
    PFN_vkVoidFunction mine = own(name);
    if (!shared.load_device) shared.load_device = INSTANCE_FUNCTION(GetDeviceProcAddr);
    return mine ? mine : shared.load_device(device, name);
}

static PFN_vkVoidFunction VKAPI_CALL load(VkInstance instance, const char *name) {
    PFN_vkVoidFunction mine = own(name);
    return mine ? mine : shared.load(instance, name);
}

static void lock_queue(void *user) {
    (void)user;
    pthread_mutex_lock(&shared.queue);
}

static void unlock_queue(void *user) {
    (void)user;
    pthread_mutex_unlock(&shared.queue);
}

void ht_vk_share(hydra_vk_desc *desc) {
    pthread_mutex_lock(&shared.mutex);
    void *library = shared.load ? NULL : dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    if (library) shared.load = (PFN_vkGetInstanceProcAddr)(uintptr_t)dlsym(library, "vkGetInstanceProcAddr");
    if (shared.load) {
        desc->get_instance_proc_addr = load;
        desc->lock_queue = lock_queue;
        desc->unlock_queue = unlock_queue;
    }
    pthread_mutex_unlock(&shared.mutex);
}

/* ---- the end */

static VkBool32 VKAPI_CALL count_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity, VkDebugUtilsMessageTypeFlagsEXT type,
                                         const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    (void)severity;
    (void)type;
    (void)user;
    print_error("%s\n", data->pMessage);
    shared.last_messages++;
    return VK_FALSE;
}

uint64_t ht_vk_share_end(void) {
    if (!shared.device) return 0;
    VkDebugUtilsMessengerCreateInfoEXT info;
    VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
    info.pfnUserCallback = count_message;
    INSTANCE_FUNCTION(CreateDebugUtilsMessengerEXT)(shared.instance, &info, NULL, &messenger);
    PFN_vkDestroyPipeline destroy = DEVICE_FUNCTION(DestroyPipeline);
    PFN_vkDestroyShaderModule forget = DEVICE_FUNCTION(DestroyShaderModule);
    for (uint32_t i = 0; i < shared.pipeline_count; i++) destroy(shared.device, shared.pipelines[i].pipeline, NULL);
    for (uint32_t i = 0; i < shared.module_count; i++) forget(shared.device, shared.modules[i].module, NULL);
    shared.pipeline_count = shared.module_count = 0;
    DEVICE_FUNCTION(DestroyDevice)(shared.device, NULL);
    shared.device = NULL;
    INSTANCE_FUNCTION(DestroyDebugUtilsMessengerEXT)(shared.instance, messenger, NULL);
    return shared.last_messages; /* the instance stays: it remembers the context that made it, for its own destruction */
}

#endif
