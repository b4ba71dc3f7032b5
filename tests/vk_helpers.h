/* What the tests about Vulkan alone share: contexts made with any hydra_vk_desc, devices of the test's own, and a spy
   between the library and the loader that counts calls, lets them fail, hides functions, and pretends devices to be other
   than they are. For files named test_vk_<subject>.c. */
#ifndef VK_HELPERS_H
#define VK_HELPERS_H

#include "hydra_test.h"

/* From here on these are the library's own: contexts of the processor. */
#undef hydra_create
#undef hydra_destroy

/* ---- contexts */

/* Memory and log as in ht_host; what the validation layer says is counted apart. */
typedef struct vkt_host {
    ht_host host;
    uint32_t said;      /* messages of the layer */
    char last_said[512];
    char error[512];    /* why creation failed */
} vkt_host;

/* vk NULL: the library's own device. Validation is on where the library makes the instance. threads 0: 1. */
hydra_result vkt_try(vkt_host *h, const hydra_vk_desc *vk, uint32_t threads);
/* The same; it must succeed. */
hydra_context *vkt_open(vkt_host *h, const hydra_vk_desc *vk, uint32_t threads);
hydra_context *vkt_open_cpu(vkt_host *h, uint32_t threads);
/* Nothing leaked, nothing was written out of bounds, and the layer has said nothing. */
void vkt_close(vkt_host *h);
void vkt_expect_clean(const vkt_host *h); /* of a creation that failed */
hydra_vk_info vkt_info(const hydra_context *context);

/* ---- the loader, and a device of the test's own */

PFN_vkGetInstanceProcAddr vkt_loader(void);

#define VKT_OWN_FUNCTIONS(X)                                                                                                        \
    X(DestroyInstance) X(EnumeratePhysicalDevices) X(GetPhysicalDeviceMemoryProperties) X(CreateDevice) X(GetDeviceProcAddr)        \
    X(DestroyDevice) X(GetDeviceQueue) X(CreateBuffer) X(DestroyBuffer) X(GetBufferMemoryRequirements) X(AllocateMemory)            \
    X(FreeMemory) X(BindBufferMemory) X(MapMemory) X(CreateCommandPool) X(DestroyCommandPool) X(AllocateCommandBuffers)             \
    X(BeginCommandBuffer) X(EndCommandBuffer) X(CmdFillBuffer) X(CmdPipelineBarrier) X(QueueSubmit) X(QueueWaitIdle) X(DeviceWaitIdle) \
    X(CreateDebugUtilsMessengerEXT) X(DestroyDebugUtilsMessengerEXT)

/* With the validation layer, whose messages it counts. */
typedef struct vkt_own {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    VkDebugUtilsMessengerEXT messenger;
    const VkAllocationCallbacks *allocation;
    uint32_t said;
    char last_said[512];
#define VKT_MEMBER(name) PFN_vk##name name;
    VKT_OWN_FUNCTIONS(VKT_MEMBER)
#undef VKT_MEMBER
} vkt_own;

void vkt_own_open(vkt_own *own, const VkAllocationCallbacks *allocation);
void vkt_own_close(vkt_own *own); /* the layer has said nothing */
hydra_vk_desc vkt_own_desc(const vkt_own *own);

/* A buffer that the host sees. */
typedef struct vkt_buffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    unsigned char *bytes;
} vkt_buffer;
vkt_buffer vkt_make_buffer(const vkt_own *own, VkDeviceSize size);
void vkt_free_buffer(const vkt_own *own, vkt_buffer *buffer);

/* ---- allocation callbacks that count */

typedef struct vkt_counted {
    VkAllocationCallbacks callbacks;
    int64_t blocks_now, calls;
} vkt_counted;
void vkt_count_allocations(vkt_counted *counted);

/* ---- the spy */

/* A device as the library is made to see it; behind it is the first real one. Zero, or NULL: as that is. */
typedef struct vkt_pretence {
    const char *name;
    VkPhysicalDeviceType type;
    uint32_t api_version;
    bool no_float64, no_ballot, no_compute, no_times;
    bool staged; /* what the device has for itself, the host does not see: two types of memory */
    uint32_t storage_buffers, binding_most, texels_most, group_most;
} vkt_pretence;

typedef struct vkt_spy {
    /* The fail_at-th call (from 1) of fail_name, or of any function that can fail, gives fail_result; with fail_after all
       later ones too, or fail_more of them. What it would have made is then a handle that is none, as Vulkan allows. 0: none. */
    const char *fail_name;
    uint64_t fail_at;
    bool fail_after;
    uint64_t fail_more;
    VkResult fail_result;
    uint64_t calls;           /* of those */
    const char *failed;       /* name of the last that failed */
    const char *hidden;       /* a function that the loader does not know */
    uint64_t barrier_dropped; /* the so-manieth vkCmdPipelineBarrier (from 1) does not happen; UINT64_MAX: none does */
    uint64_t barriers, submissions, allocations, pipelines, staging_copies;
    uint32_t no_devices;      /* the loader knows none: 1, an empty list; 2, vkCreateInstance says so */
    VkInstance last_instance; /* made and not destroyed */
    VkDevice last_device;
    uint32_t pretended;       /* how many devices there are; 0: the real ones */
    vkt_pretence pretences[8];
    uint32_t asked_count;     /* functions that the loader and the device were asked for */
    char asked[128][56];
} vkt_spy;

/* One at a time. */
extern vkt_spy vkt_spied;
void vkt_spy_begin(void); /* forgets all that was told and counted */
hydra_vk_desc vkt_spy_desc(void);
/* Destroys what the library could not since its function was hidden. */
void vkt_spy_clear_up(void);

#endif /* VK_HELPERS_H */
