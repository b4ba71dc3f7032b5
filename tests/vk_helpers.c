/* See vk_helpers.h. */
#ifdef HT_VULKAN

#include "vk_helpers.h"

#include <dlfcn.h>

/* ---- contexts */

static void vkt_log(void *user, hydra_log_level level, const char *text) {
    vkt_host *h = (vkt_host *)user;
    if (strstr(text, "VUID-") || strstr(text, "SYNC-") || strstr(text, "UNASSIGNED-")) {
        if (!h->said++) snprintf(h->last_said, sizeof h->last_said, "%s", text);
        return;
    }
    ht_host_log(&h->host, level, text);
}

static hydra_context_desc host_desc(vkt_host *h, uint32_t threads) {
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.threads = threads ? threads : 1;
    desc.allocator = ht_memory_allocator(&h->host.memory);
    desc.log = vkt_log;
    desc.log_user = h;
    return desc;
}

hydra_result vkt_try(vkt_host *h, const hydra_vk_desc *vk, uint32_t threads) {
    hydra_context_desc desc = host_desc(h, threads);
    hydra_vk_desc own;
    memset(&own, 0, sizeof own);
    if (vk) own = *vk;
    if (!own.instance) own.validation = true;
    own.error = h->error;
    own.error_size = sizeof h->error;
    return hydra_vk_create(&desc, &own, &h->host.context);
}

hydra_context *vkt_open(vkt_host *h, const hydra_vk_desc *vk, uint32_t threads) {
    memset(h, 0, sizeof *h);
    hydra_result result = vkt_try(h, vk, threads);
    if (result != HYDRA_OK) fail_msg("hydra_vk_create: %s", h->error);
    return h->host.context;
}

hydra_context *vkt_open_cpu(vkt_host *h, uint32_t threads) {
    memset(h, 0, sizeof *h);
    hydra_context_desc desc = host_desc(h, threads);
    h->host.context = hydra_create(&desc);
    assert_non_null(h->host.context);
    return h->host.context;
}

void vkt_expect_clean(const vkt_host *h) {
    if (h->said) fail_msg("the validation layer: %s", h->last_said);
    assert_int_equal(h->host.memory.blocks_now, 0);
    assert_int_equal(h->host.memory.bytes_now, 0);
    assert_int_equal(h->host.memory.damaged, 0);
}

void vkt_close(vkt_host *h) {
    assert_int_equal(hydra_destroy(h->host.context), HYDRA_OK);
    h->host.context = NULL;
    vkt_expect_clean(h);
}

hydra_vk_info vkt_info(const hydra_context *context) {
    hydra_vk_info info;
    assert_int_equal(hydra_vk_get_info(context, &info), HYDRA_OK);
    return info;
}

/* ---- the loader, and a device of the test's own */

PFN_vkGetInstanceProcAddr vkt_loader(void) {
    static PFN_vkGetInstanceProcAddr entry;
    if (entry) return entry;
    void *library = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL); /* stays open */
    void *found = library ? dlsym(library, "vkGetInstanceProcAddr") : NULL;
    assert_non_null(found);
    memcpy(&entry, &found, sizeof entry);
    return entry;
}

static VkBool32 VKAPI_CALL own_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity, VkDebugUtilsMessageTypeFlagsEXT types,
                                       const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    vkt_own *own = (vkt_own *)user;
    (void)severity;
    (void)types;
    if (!own->said++) snprintf(own->last_said, sizeof own->last_said, "%s", data->pMessage);
    return VK_FALSE;
}

static void own_make_instance(vkt_own *own) {
    static const char *const layer = "VK_LAYER_KHRONOS_validation", *const extension = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
    const VkValidationFeatureEnableEXT synchronization = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
    VkDebugUtilsMessengerCreateInfoEXT messenger = {.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
                                                    .messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
                                                    .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
                                                    .pfnUserCallback = own_message,
                                                    .pUserData = own};
    VkValidationFeaturesEXT features = {.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT,
                                        .enabledValidationFeatureCount = 1,
                                        .pEnabledValidationFeatures = &synchronization};
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_2};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pNext = &features, .pApplicationInfo = &application};
    info.enabledLayerCount = info.enabledExtensionCount = 1;
    info.ppEnabledLayerNames = &layer;
    info.ppEnabledExtensionNames = &extension;
    PFN_vkCreateInstance create = (PFN_vkCreateInstance)vkt_loader()(NULL, "vkCreateInstance");
    assert_int_equal(create(&info, own->allocation, &own->instance), VK_SUCCESS);
#define VKT_LOAD(name) own->name = (PFN_vk##name)vkt_loader()(own->instance, "vk" #name);
    VKT_OWN_FUNCTIONS(VKT_LOAD)
#undef VKT_LOAD
    assert_int_equal(own->CreateDebugUtilsMessengerEXT(own->instance, &messenger, own->allocation, &own->messenger), VK_SUCCESS);
}

void vkt_own_open(vkt_own *own, const VkAllocationCallbacks *allocation) {
    memset(own, 0, sizeof *own);
    own->allocation = allocation;
    own_make_instance(own);
    uint32_t count = 1;
    assert_true(own->EnumeratePhysicalDevices(own->instance, &count, &own->physical) >= 0 && count == 1);
    const float priority = 1;
    VkPhysicalDeviceFeatures features = {.shaderFloat64 = VK_TRUE};
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueCount = 1, .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, .queueCreateInfoCount = 1, .pQueueCreateInfos = &queue, .pEnabledFeatures = &features};
    assert_int_equal(own->CreateDevice(own->physical, &info, allocation, &own->device), VK_SUCCESS);
    own->GetDeviceQueue(own->device, 0, 0, &own->queue);
}

void vkt_own_close(vkt_own *own) {
    own->DestroyDevice(own->device, own->allocation);
    own->DestroyDebugUtilsMessengerEXT(own->instance, own->messenger, own->allocation);
    own->DestroyInstance(own->instance, own->allocation);
    if (own->said) fail_msg("the validation layer: %s", own->last_said);
}

hydra_vk_desc vkt_own_desc(const vkt_own *own) {
    hydra_vk_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.get_instance_proc_addr = vkt_loader();
    desc.instance = own->instance;
    desc.physical_device = own->physical;
    desc.device = own->device;
    desc.queue = own->queue;
    desc.allocation = own->allocation;
    return desc;
}

vkt_buffer vkt_make_buffer(const vkt_own *own, VkDeviceSize size) {
    vkt_buffer b;
    void *mapped;
    VkMemoryRequirements need;
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = size, .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT};
    memset(&b, 0, sizeof b);
    assert_int_equal(own->CreateBuffer(own->device, &info, own->allocation, &b.buffer), VK_SUCCESS);
    own->GetBufferMemoryRequirements(own->device, b.buffer, &need);
    VkPhysicalDeviceMemoryProperties memory;
    own->GetPhysicalDeviceMemoryProperties(own->physical, &memory);
    const VkMemoryPropertyFlags seen = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    VkMemoryAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = need.size};
    while (!(need.memoryTypeBits >> allocate.memoryTypeIndex & 1u) || (memory.memoryTypes[allocate.memoryTypeIndex].propertyFlags & seen) != seen)
        assert_true(++allocate.memoryTypeIndex < memory.memoryTypeCount);
    assert_int_equal(own->AllocateMemory(own->device, &allocate, own->allocation, &b.memory), VK_SUCCESS);
    assert_int_equal(own->BindBufferMemory(own->device, b.buffer, b.memory, 0), VK_SUCCESS);
    assert_int_equal(own->MapMemory(own->device, b.memory, 0, VK_WHOLE_SIZE, 0, &mapped), VK_SUCCESS);
    b.bytes = (unsigned char *)mapped;
    return b;
}

void vkt_free_buffer(const vkt_own *own, vkt_buffer *buffer) {
    own->DestroyBuffer(own->device, buffer->buffer, own->allocation);
    own->FreeMemory(own->device, buffer->memory, own->allocation);
    memset(buffer, 0, sizeof *buffer);
}

/* ---- allocation callbacks that count: [ malloc's pointer, size | block ] */

typedef struct counted_head {
    void *base;
    size_t size;
} counted_head;

static void *VKAPI_CALL counted_alloc(void *user, size_t size, size_t alignment, VkSystemAllocationScope scope) {
    vkt_counted *c = (vkt_counted *)user;
    (void)scope;
    if (alignment < sizeof(counted_head)) alignment = sizeof(counted_head);
    char *base = (char *)malloc(size + 2 * alignment);
    if (!base) return NULL;
    char *block = base + alignment;
    block += (alignment - (uintptr_t)block % alignment) % alignment;
    counted_head head = {base, size};
    memcpy(block - sizeof head, &head, sizeof head);
    __atomic_add_fetch(&c->blocks_now, 1, __ATOMIC_RELAXED);
    __atomic_add_fetch(&c->calls, 1, __ATOMIC_RELAXED);
    return block;
}

static void VKAPI_CALL counted_free(void *user, void *block) {
    vkt_counted *c = (vkt_counted *)user;
    counted_head head;
    if (!block) return;
    memcpy(&head, (char *)block - sizeof head, sizeof head);
    __atomic_sub_fetch(&c->blocks_now, 1, __ATOMIC_RELAXED);
    free(head.base);
}

static void *VKAPI_CALL counted_realloc(void *user, void *old, size_t size, size_t alignment, VkSystemAllocationScope scope) {
    counted_head head = {NULL, 0};
    if (old) memcpy(&head, (char *)old - sizeof head, sizeof head);
    void *block = size ? counted_alloc(user, size, alignment, scope) : NULL;
    if (size && !block) return NULL;
    if (block && old) memcpy(block, old, head.size < size ? head.size : size);
    counted_free(user, old);
    return block;
}

void vkt_count_allocations(vkt_counted *counted) {
    memset(counted, 0, sizeof *counted);
    counted->callbacks.pUserData = counted;
    counted->callbacks.pfnAllocation = counted_alloc;
    counted->callbacks.pfnReallocation = counted_realloc;
    counted->callbacks.pfnFree = counted_free;
}

/* ---- the spy: what it does before a call */

vkt_spy vkt_spied;

static bool spy_fails(const char *name) {
    if (vkt_spied.fail_name && strcmp(vkt_spied.fail_name, name) != 0) return false;
    uint64_t call = ++vkt_spied.calls;
    if (!vkt_spied.fail_at || !(call == vkt_spied.fail_at || (call > vkt_spied.fail_at && (vkt_spied.fail_after || call <= vkt_spied.fail_at + vkt_spied.fail_more)))) return false;
    vkt_spied.failed = name;
    return true;
}

/* What a failing call would have made is undefined. */
#define VKT_FAIL(name, out)                      \
    if (spy_fails(#name)) {                      \
        memset((out), 0x5a, sizeof *(out));      \
        return vkt_spied.fail_result;            \
    }
#define VKT_FAIL_ALONE(name) \
    if (spy_fails(#name)) return vkt_spied.fail_result;

/* name, parameters, arguments, what fails before: functions that need no more than that. */
#define VKT_PASSED(X)                                                                                                                          \
    X(MapMemory, (VkDevice d, VkDeviceMemory m, VkDeviceSize o, VkDeviceSize s, VkMemoryMapFlags g, void **out), (d, m, o, s, g, out), VKT_FAIL(vkMapMemory, out)) \
    X(CreateBuffer, (VkDevice d, const VkBufferCreateInfo *i, const VkAllocationCallbacks *a, VkBuffer *out), (d, i, a, out), VKT_FAIL(vkCreateBuffer, out)) \
    X(CreateBufferView, (VkDevice d, const VkBufferViewCreateInfo *i, const VkAllocationCallbacks *a, VkBufferView *out), (d, i, a, out), VKT_FAIL(vkCreateBufferView, out)) \
    X(BindBufferMemory, (VkDevice d, VkBuffer b, VkDeviceMemory m, VkDeviceSize o), (d, b, m, o), VKT_FAIL_ALONE(vkBindBufferMemory))          \
    X(CreateShaderModule, (VkDevice d, const VkShaderModuleCreateInfo *i, const VkAllocationCallbacks *a, VkShaderModule *out), (d, i, a, out), VKT_FAIL(vkCreateShaderModule, out)) \
    X(CreateDescriptorSetLayout, (VkDevice d, const VkDescriptorSetLayoutCreateInfo *i, const VkAllocationCallbacks *a, VkDescriptorSetLayout *out), (d, i, a, out), VKT_FAIL(vkCreateDescriptorSetLayout, out)) \
    X(CreatePipelineLayout, (VkDevice d, const VkPipelineLayoutCreateInfo *i, const VkAllocationCallbacks *a, VkPipelineLayout *out), (d, i, a, out), VKT_FAIL(vkCreatePipelineLayout, out)) \
    X(CreateDescriptorPool, (VkDevice d, const VkDescriptorPoolCreateInfo *i, const VkAllocationCallbacks *a, VkDescriptorPool *out), (d, i, a, out), VKT_FAIL(vkCreateDescriptorPool, out)) \
    X(AllocateDescriptorSets, (VkDevice d, const VkDescriptorSetAllocateInfo *i, VkDescriptorSet *out), (d, i, out), VKT_FAIL(vkAllocateDescriptorSets, out)) \
    X(CreateCommandPool, (VkDevice d, const VkCommandPoolCreateInfo *i, const VkAllocationCallbacks *a, VkCommandPool *out), (d, i, a, out), VKT_FAIL(vkCreateCommandPool, out)) \
    X(AllocateCommandBuffers, (VkDevice d, const VkCommandBufferAllocateInfo *i, VkCommandBuffer *out), (d, i, out), VKT_FAIL(vkAllocateCommandBuffers, out)) \
    X(BeginCommandBuffer, (VkCommandBuffer c, const VkCommandBufferBeginInfo *i), (c, i), VKT_FAIL_ALONE(vkBeginCommandBuffer))                \
    X(CreateQueryPool, (VkDevice d, const VkQueryPoolCreateInfo *i, const VkAllocationCallbacks *a, VkQueryPool *out), (d, i, a, out), VKT_FAIL(vkCreateQueryPool, out)) \
    X(CreateFence, (VkDevice d, const VkFenceCreateInfo *i, const VkAllocationCallbacks *a, VkFence *out), (d, i, a, out), VKT_FAIL(vkCreateFence, out)) \
    X(CreatePipelineCache, (VkDevice d, const VkPipelineCacheCreateInfo *i, const VkAllocationCallbacks *a, VkPipelineCache *out), (d, i, a, out), VKT_FAIL(vkCreatePipelineCache, out)) \
    X(CreateDebugUtilsMessengerEXT, (VkInstance n, const VkDebugUtilsMessengerCreateInfoEXT *i, const VkAllocationCallbacks *a, VkDebugUtilsMessengerEXT *out), (n, i, a, out), VKT_FAIL(vkCreateDebugUtilsMessengerEXT, out))

#define VKT_DEFINE(name, parameters, arguments, before)           \
    static PFN_vk##name real_##name;                              \
    static VkResult VKAPI_CALL spy_##name parameters {            \
        before                                                    \
        return real_##name arguments;                             \
    }
VKT_PASSED(VKT_DEFINE)
#undef VKT_DEFINE

/* ---- the spy: what it does more about */

#define VKT_OTHERS(X)                                                                                                                \
    X(CreateInstance) X(DestroyInstance) X(CreateDevice) X(DestroyDevice) X(EnumeratePhysicalDevices) X(GetPhysicalDeviceProperties) \
    X(GetPhysicalDeviceProperties2) X(GetPhysicalDeviceFeatures) X(GetPhysicalDeviceMemoryProperties)                                \
    X(GetPhysicalDeviceQueueFamilyProperties) X(GetDeviceProcAddr) X(AllocateMemory) X(GetBufferMemoryRequirements)                  \
    X(CreateComputePipelines) X(QueueSubmit) X(WaitForFences) X(ResetFences) X(EndCommandBuffer) X(CmdPipelineBarrier) X(CmdCopyBuffer)
#define VKT_REAL(name) static PFN_vk##name real_##name;
VKT_OTHERS(VKT_REAL)
#undef VKT_REAL

static VkResult VKAPI_CALL spy_CreateInstance(const VkInstanceCreateInfo *i, const VkAllocationCallbacks *a, VkInstance *out) {
    VKT_FAIL(vkCreateInstance, out)
    if (vkt_spied.no_devices == 2) return VK_ERROR_INCOMPATIBLE_DRIVER;
    VkResult result = real_CreateInstance(i, a, out);
    if (result == VK_SUCCESS) vkt_spied.last_instance = *out;
    return result;
}

static void VKAPI_CALL spy_DestroyInstance(VkInstance instance, const VkAllocationCallbacks *a) {
    real_DestroyInstance(instance, a);
    if (instance == vkt_spied.last_instance) vkt_spied.last_instance = VK_NULL_HANDLE;
}

static void VKAPI_CALL spy_DestroyDevice(VkDevice device, const VkAllocationCallbacks *a) {
    real_DestroyDevice(device, a);
    if (device == vkt_spied.last_device) vkt_spied.last_device = VK_NULL_HANDLE;
}

/* Pretended devices are known by where their pretences stand. */
static VkPhysicalDevice first_device;

static const vkt_pretence *pretence_of(VkPhysicalDevice *device) {
    for (uint32_t i = 0; i < vkt_spied.pretended; i++) {
        if (*device != (VkPhysicalDevice)(void *)&vkt_spied.pretences[i]) continue;
        *device = first_device;
        return &vkt_spied.pretences[i];
    }
    return NULL;
}

static VkResult VKAPI_CALL spy_EnumeratePhysicalDevices(VkInstance instance, uint32_t *count, VkPhysicalDevice *devices) {
    VKT_FAIL_ALONE(vkEnumeratePhysicalDevices)
    if (vkt_spied.no_devices == 1) return *count = 0, VK_SUCCESS;
    if (!vkt_spied.pretended) return real_EnumeratePhysicalDevices(instance, count, devices);
    uint32_t one = 1, room = *count;
    VkResult result = real_EnumeratePhysicalDevices(instance, &one, &first_device);
    if (result < 0 || one != 1) return result;
    *count = vkt_spied.pretended;
    if (!devices) return VK_SUCCESS;
    if (room < *count) *count = room;
    for (uint32_t i = 0; i < *count; i++) devices[i] = (VkPhysicalDevice)(void *)&vkt_spied.pretences[i];
    return *count < vkt_spied.pretended ? VK_INCOMPLETE : VK_SUCCESS;
}

static void VKAPI_CALL spy_GetPhysicalDeviceProperties(VkPhysicalDevice device, VkPhysicalDeviceProperties *p) {
    const vkt_pretence *as = pretence_of(&device);
    real_GetPhysicalDeviceProperties(device, p);
    if (!as) return;
    if (as->name) snprintf(p->deviceName, sizeof p->deviceName, "%s", as->name);
    if (as->type) p->deviceType = as->type;
    if (as->api_version) p->apiVersion = as->api_version;
    if (as->storage_buffers) p->limits.maxPerStageDescriptorStorageBuffers = as->storage_buffers;
    if (as->binding_most) p->limits.maxStorageBufferRange = as->binding_most;
    if (as->texels_most) p->limits.maxTexelBufferElements = as->texels_most;
    if (as->group_most) p->limits.maxComputeWorkGroupInvocations = as->group_most;
}

static void VKAPI_CALL spy_GetPhysicalDeviceProperties2(VkPhysicalDevice device, VkPhysicalDeviceProperties2 *p) {
    const vkt_pretence *as = pretence_of(&device);
    real_GetPhysicalDeviceProperties2(device, p);
    for (VkBaseOutStructure *next = (VkBaseOutStructure *)p->pNext; as && as->no_ballot && next; next = next->pNext) {
        if (next->sType != VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES) continue;
        ((VkPhysicalDeviceSubgroupProperties *)(void *)next)->supportedOperations = VK_SUBGROUP_FEATURE_BASIC_BIT;
    }
}

static void VKAPI_CALL spy_GetPhysicalDeviceFeatures(VkPhysicalDevice device, VkPhysicalDeviceFeatures *f) {
    const vkt_pretence *as = pretence_of(&device);
    real_GetPhysicalDeviceFeatures(device, f);
    if (as && as->no_float64) f->shaderFloat64 = VK_FALSE;
}

/* Whether memory of the device that was made is in two types: 0 for the device alone, 1 for both. */
static bool staged;

static void VKAPI_CALL spy_GetPhysicalDeviceMemoryProperties(VkPhysicalDevice device, VkPhysicalDeviceMemoryProperties *m) {
    const vkt_pretence *as = pretence_of(&device);
    real_GetPhysicalDeviceMemoryProperties(device, m);
    if (!as || !as->staged) return;
    m->memoryTypeCount = 2;
    m->memoryTypes[1] = m->memoryTypes[0];
    m->memoryTypes[0].propertyFlags = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
    m->memoryTypes[1].propertyFlags &= ~(VkMemoryPropertyFlags)VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
}

static void VKAPI_CALL spy_GetPhysicalDeviceQueueFamilyProperties(VkPhysicalDevice device, uint32_t *count, VkQueueFamilyProperties *families) {
    const vkt_pretence *as = pretence_of(&device);
    real_GetPhysicalDeviceQueueFamilyProperties(device, count, families);
    for (uint32_t i = 0; as && families && i < *count; i++) {
        if (as->no_compute) families[i].queueFlags &= ~(VkQueueFlags)VK_QUEUE_COMPUTE_BIT;
        if (as->no_times) families[i].timestampValidBits = 0;
    }
}

static VkResult VKAPI_CALL spy_CreateDevice(VkPhysicalDevice device, const VkDeviceCreateInfo *i, const VkAllocationCallbacks *a, VkDevice *out) {
    const vkt_pretence *as = pretence_of(&device);
    VKT_FAIL(vkCreateDevice, out)
    VkResult result = real_CreateDevice(device, i, a, out);
    if (result == VK_SUCCESS) vkt_spied.last_device = *out;
    staged = as && as->staged;
    return result;
}

static VkResult VKAPI_CALL spy_AllocateMemory(VkDevice d, const VkMemoryAllocateInfo *i, const VkAllocationCallbacks *a, VkDeviceMemory *out) {
    VkMemoryAllocateInfo info = *i;
    VKT_FAIL(vkAllocateMemory, out)
    vkt_spied.allocations++;
    if (staged) info.memoryTypeIndex = 0;
    return real_AllocateMemory(d, &info, a, out);
}

static void VKAPI_CALL spy_GetBufferMemoryRequirements(VkDevice d, VkBuffer b, VkMemoryRequirements *need) {
    real_GetBufferMemoryRequirements(d, b, need);
    if (staged) need->memoryTypeBits = 3;
}

static VkResult VKAPI_CALL spy_CreateComputePipelines(VkDevice d, VkPipelineCache c, uint32_t n, const VkComputePipelineCreateInfo *i, const VkAllocationCallbacks *a,
                                                      VkPipeline *out) {
    if (spy_fails("vkCreateComputePipelines")) {
        for (uint32_t k = 0; k < n; k++) out[k] = VK_NULL_HANDLE; /* these are defined */
        return vkt_spied.fail_result;
    }
    vkt_spied.pipelines += n;
    return real_CreateComputePipelines(d, c, n, i, a, out);
}

static VkResult VKAPI_CALL spy_EndCommandBuffer(VkCommandBuffer c) {
    VkResult result = real_EndCommandBuffer(c);
    VKT_FAIL_ALONE(vkEndCommandBuffer)
    return result;
}

static VkResult VKAPI_CALL spy_QueueSubmit(VkQueue q, uint32_t n, const VkSubmitInfo *i, VkFence fence) {
    VKT_FAIL_ALONE(vkQueueSubmit)
    vkt_spied.submissions += n;
    return real_QueueSubmit(q, n, i, fence);
}

/* The layer knows of no lost device: what was submitted is really done first. With any other failure it may go on. */
static VkResult VKAPI_CALL spy_WaitForFences(VkDevice d, uint32_t n, const VkFence *fences, VkBool32 all, uint64_t timeout) {
    bool fails = spy_fails("vkWaitForFences");
    VkResult result = fails && vkt_spied.fail_result != VK_ERROR_DEVICE_LOST ? VK_SUCCESS : real_WaitForFences(d, n, fences, all, timeout);
    return fails ? vkt_spied.fail_result : result;
}

static VkResult VKAPI_CALL spy_ResetFences(VkDevice d, uint32_t n, const VkFence *fences) {
    VKT_FAIL_ALONE(vkResetFences)
    return real_ResetFences(d, n, fences);
}

static void VKAPI_CALL spy_CmdPipelineBarrier(VkCommandBuffer c, VkPipelineStageFlags from, VkPipelineStageFlags to, VkDependencyFlags flags, uint32_t n,
                                              const VkMemoryBarrier *barriers, uint32_t buffers, const VkBufferMemoryBarrier *of_buffers, uint32_t images,
                                              const VkImageMemoryBarrier *of_images) {
    if (++vkt_spied.barriers == vkt_spied.barrier_dropped || vkt_spied.barrier_dropped == UINT64_MAX) return;
    real_CmdPipelineBarrier(c, from, to, flags, n, barriers, buffers, of_buffers, images, of_images);
}

static void VKAPI_CALL spy_CmdCopyBuffer(VkCommandBuffer c, VkBuffer from, VkBuffer to, uint32_t n, const VkBufferCopy *regions) {
    vkt_spied.staging_copies++;
    real_CmdCopyBuffer(c, from, to, n, regions);
}

/* ---- the spy: standing between */

static PFN_vkVoidFunction VKAPI_CALL spy_GetDeviceProcAddr(VkDevice device, const char *name);

#define VKT_STAND_BETWEEN(name)                        \
    if (strcmp(asked, "vk" #name) == 0) {              \
        real_##name = (PFN_vk##name)real;              \
        return (PFN_vkVoidFunction)spy_##name;         \
    }
#define VKT_STAND_BETWEEN_PASSED(name, parameters, arguments, before) VKT_STAND_BETWEEN(name)

static void note_name(const char *name) {
    uint32_t i = 0;
    while (i < vkt_spied.asked_count && strcmp(vkt_spied.asked[i], name) != 0) i++;
    if (i < vkt_spied.asked_count) return;
    assert_true(i < sizeof vkt_spied.asked / sizeof vkt_spied.asked[0]);
    snprintf(vkt_spied.asked[vkt_spied.asked_count++], sizeof vkt_spied.asked[0], "%s", name);
}

static PFN_vkVoidFunction stand_between(const char *asked, PFN_vkVoidFunction real) {
    note_name(asked);
    if (!real || (vkt_spied.hidden && strcmp(asked, vkt_spied.hidden) == 0)) return NULL;
    VKT_PASSED(VKT_STAND_BETWEEN_PASSED)
    VKT_OTHERS(VKT_STAND_BETWEEN)
    return real;
}

static PFN_vkVoidFunction VKAPI_CALL spy_GetDeviceProcAddr(VkDevice device, const char *name) { return stand_between(name, real_GetDeviceProcAddr(device, name)); }

static PFN_vkVoidFunction VKAPI_CALL spy_GetInstanceProcAddr(VkInstance instance, const char *name) { return stand_between(name, vkt_loader()(instance, name)); }

void vkt_spy_begin(void) {
    memset(&vkt_spied, 0, sizeof vkt_spied);
    vkt_spied.fail_result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    staged = false;
}

hydra_vk_desc vkt_spy_desc(void) {
    hydra_vk_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.get_instance_proc_addr = spy_GetInstanceProcAddr;
    return desc;
}

void vkt_spy_clear_up(void) {
    VkInstance instance = vkt_spied.last_instance;
    if (!instance) return;
    PFN_vkDestroyDevice destroy_device = (PFN_vkDestroyDevice)vkt_loader()(instance, "vkDestroyDevice");
    if (vkt_spied.last_device) destroy_device(vkt_spied.last_device, NULL);
    PFN_vkDestroyInstance destroy_instance = (PFN_vkDestroyInstance)vkt_loader()(instance, "vkDestroyInstance");
    destroy_instance(instance, NULL);
    vkt_spied.last_instance = VK_NULL_HANDLE;
    vkt_spied.last_device = VK_NULL_HANDLE;
}

#else

typedef int vk_helpers_have_nothing_to_do; /* without Vulkan; a file is not to be empty */

#endif
