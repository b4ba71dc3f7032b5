/* >>vk-functions: Vulkan's loader opened at run time, and the functions that are used */
#ifndef HYI_VK_FUNCTIONS_H
#define HYI_VK_FUNCTIONS_H

#include "../render/selftest.h"
#include "api.h"

#if !defined(_WIN32)
#include <dlfcn.h>
#endif

/* Asked for without an instance; of an instance; of a device. */
#define HYI_VK_GLOBAL_FUNCTIONS(X) X(CreateInstance) X(EnumerateInstanceVersion) X(EnumerateInstanceLayerProperties) X(EnumerateInstanceExtensionProperties)
#define HYI_VK_INSTANCE_FUNCTIONS(X)                                                                                          \
    X(DestroyInstance) X(EnumeratePhysicalDevices) X(GetPhysicalDeviceProperties) X(GetPhysicalDeviceProperties2)             \
    X(GetPhysicalDeviceFeatures) X(GetPhysicalDeviceMemoryProperties) X(GetPhysicalDeviceQueueFamilyProperties)              \
    X(CreateDevice) X(GetDeviceProcAddr)
#define HYI_VK_DEVICE_FUNCTIONS(X)                                                                                            \
    X(DestroyDevice) X(GetDeviceQueue) X(AllocateMemory) X(FreeMemory) X(MapMemory)                                           \
    X(CreateBuffer) X(DestroyBuffer) X(CreateBufferView) X(DestroyBufferView) X(GetBufferMemoryRequirements) X(BindBufferMemory) X(CreateShaderModule)                 \
    X(DestroyShaderModule) X(CreateDescriptorSetLayout) X(DestroyDescriptorSetLayout) \
    X(CreatePipelineLayout) X(DestroyPipelineLayout) X(CreateComputePipelines) X(DestroyPipeline) X(CreatePipelineCache)      \
    X(DestroyPipelineCache) X(GetPipelineCacheData) X(CreateDescriptorPool) X(DestroyDescriptorPool) X(AllocateDescriptorSets) \
    X(UpdateDescriptorSets) X(CreateCommandPool) X(DestroyCommandPool) X(AllocateCommandBuffers) X(BeginCommandBuffer)        \
    X(EndCommandBuffer) X(CmdBindPipeline) X(CmdBindDescriptorSets) X(CmdPushConstants) X(CmdDispatch) X(CmdDispatchIndirect) \
    X(CmdPipelineBarrier) X(CmdCopyBuffer) X(CmdFillBuffer) X(CmdUpdateBuffer) X(CmdResetQueryPool) X(CmdWriteTimestamp) X(CreateQueryPool)     \
    X(DestroyQueryPool) X(GetQueryPoolResults) X(CreateFence) X(DestroyFence) X(ResetFences) X(WaitForFences) X(QueueSubmit)

typedef struct hyi_vk_functions {
    void *library;
    PFN_vkGetInstanceProcAddr GetInstanceProcAddr;
#define HYI_VK_MEMBER(name) PFN_vk##name name;
    HYI_VK_GLOBAL_FUNCTIONS(HYI_VK_MEMBER)
    HYI_VK_INSTANCE_FUNCTIONS(HYI_VK_MEMBER)
    HYI_VK_DEVICE_FUNCTIONS(HYI_VK_MEMBER)
#undef HYI_VK_MEMBER
    PFN_vkCreateDebugUtilsMessengerEXT CreateDebugUtilsMessengerEXT; /* with validation */
    PFN_vkDestroyDebugUtilsMessengerEXT DestroyDebugUtilsMessengerEXT;
} hyi_vk_functions;

/* Pointers to objects and to functions do not convert in standard C. */
HYI_FN PFN_vkGetInstanceProcAddr hyi_vk_loader_entry(void *library) {
    PFN_vkGetInstanceProcAddr entry = NULL;
#if defined(_WIN32)
    FARPROC found = GetProcAddress((HMODULE)library, "vkGetInstanceProcAddr");
#else
    void *found = dlsym(library, "vkGetInstanceProcAddr");
#endif
    HYI_STATIC_ASSERT(sizeof found == sizeof entry);
    memcpy(&entry, &found, sizeof entry);
    return entry;
}

HYI_FN void *hyi_vk_open_library(void) {
#if defined(_WIN32)
    return (void *)LoadLibraryA("vulkan-1.dll");
#elif defined(__APPLE__)
    void *library = dlopen("libvulkan.1.dylib", RTLD_NOW | RTLD_LOCAL);
    return library ? library : dlopen("libMoltenVK.dylib", RTLD_NOW | RTLD_LOCAL);
#else
    void *library = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    return library ? library : dlopen("libvulkan.so", RTLD_NOW | RTLD_LOCAL);
#endif
}

HYI_FN void hyi_vk_close_library(hyi_vk_functions *f) {
    if (!f->library) return;
#if defined(_WIN32)
    FreeLibrary((HMODULE)f->library);
#else
    dlclose(f->library);
#endif
    f->library = NULL;
}

#define HYI_VK_LOAD_FROM_INSTANCE(name) f->name = (PFN_vk##name)f->GetInstanceProcAddr(instance, "vk" #name); all = all && f->name;
#define HYI_VK_LOAD_FROM_DEVICE(name) f->name = (PFN_vk##name)f->GetDeviceProcAddr(device, "vk" #name); all = all && f->name;

/* given: the caller's entry, or NULL. */
HYI_FN bool hyi_vk_open(hyi_vk_functions *f, PFN_vkGetInstanceProcAddr given) {
    VkInstance instance = VK_NULL_HANDLE;
    bool all = true;
    memset(f, 0, sizeof *f);
    f->GetInstanceProcAddr = given;
    if (!given) {
        f->library = hyi_vk_open_library();
        if (f->library) f->GetInstanceProcAddr = hyi_vk_loader_entry(f->library);
        if (!f->GetInstanceProcAddr) return hyi_vk_close_library(f), false;
    }
    HYI_VK_GLOBAL_FUNCTIONS(HYI_VK_LOAD_FROM_INSTANCE)
    return all;
}

HYI_FN bool hyi_vk_load_instance(hyi_vk_functions *f, VkInstance instance) {
    bool all = true;
    HYI_VK_INSTANCE_FUNCTIONS(HYI_VK_LOAD_FROM_INSTANCE)
    f->CreateDebugUtilsMessengerEXT = (PFN_vkCreateDebugUtilsMessengerEXT)f->GetInstanceProcAddr(instance, "vkCreateDebugUtilsMessengerEXT");
    f->DestroyDebugUtilsMessengerEXT = (PFN_vkDestroyDebugUtilsMessengerEXT)f->GetInstanceProcAddr(instance, "vkDestroyDebugUtilsMessengerEXT");
    return all;
}

HYI_FN bool hyi_vk_load_device(hyi_vk_functions *f, VkDevice device) {
    bool all = true;
    HYI_VK_DEVICE_FUNCTIONS(HYI_VK_LOAD_FROM_DEVICE)
    return all;
}

#undef HYI_VK_LOAD_FROM_INSTANCE
#undef HYI_VK_LOAD_FROM_DEVICE

#endif /* HYI_VK_FUNCTIONS_H */
