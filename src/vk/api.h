/*
hydra_vk.h - v0.1 - hydra.h on Vulkan devices: the same kernels, the same API

  Where the implementation of hydra.h is, include this after it:

      #define HYDRA_IMPLEMENTATION
      #include "hydra.h"
      #define HYDRA_VK_IMPLEMENTATION
      #include "hydra_vk.h"

  and create the context with hydra_vk_create instead of hydra_create:

      hydra_context *context;
      if (hydra_vk_create(NULL, NULL, &context) != HYDRA_OK) return;

  All else is hydra.h: scenes, renders, ray queries, hydra_destroy.

WHAT IT DOES
  Paths are traced and rays are cast on the device, by compute shaders whose SPIR-V is in this file. Any
  Vulkan 1.2 device will do that has what REQUIREMENTS lists; no ray tracing extension is used, no shader
  compiler, and nothing is linked (-ldl with glibc before 2.34): the loader is opened at run time. Mesa's lavapipe, which is a
  processor, will do.
  Scenes are committed on the processor. Samples are added up on the device (hydra_vk_desc.film), by the same exact sums, so
  films can be saved, merged and resumed as ever, and adaptive tiles, budgets and error bars are the same. With a fixed count
  of samples only counters come back, until the host needs the film: hydra_render_read, _save and _merge do, and so does
  hydra_render_status when it makes its errors anew. hydra_vk_render_write fills a buffer of the device without that.

WHAT IT DOES NOT
  It draws nothing on a screen, and uses no hardware ray tracing units. A picture is made by one device.

REQUIREMENTS (checked by hydra_vk_create, which names what is missing)
  Vulkan 1.2; a queue with compute; shaderFloat64; subgroup ballot in compute shaders; 31 storage buffers a stage. No
  buffer of a scene may be larger than maxStorageBufferRange (lavapipe: 128 MiB): a triangle takes 48 bytes in the
  largest one, times what spatial splits add (at most 1.4), so some 2 million triangles there.

EQUALITY
  Hits are decided in double precision on a device as on the processor: t, u, v and ids are equal to the bit on devices
  whose double division rounds correctly, as lavapipe's does. Shading is in float: divisions, powers and the order of sums
  differ in the last bits. So pictures of one seed differ by some millionths and, where a last bit decides a path's turn
  (most often in surfaces that blend by alpha), by a sample. Means agree within their error bars; tests hold both to that.
  A film on the device has the bits that the host would have made of the same samples, where the device does not flush small
  floats to 0 (below 1e-36 it may) and the host's compiler does not contract products and sums.
  A device gives the same bits every time, and with any number of threads, tiles, steps and shares, as long as neither
  device nor driver change.

THREADS
  As in hydra.h. One context uses one queue; where several threads cast rays they take turns. Contexts are independent,
  also of one device.

REFERENCES are named where the method stands in the implementation.
*/
#ifndef HYDRA_VK_H
#define HYDRA_VK_H

#include "hydra.h"

#ifndef VULKAN_CORE_H_
#include <vulkan/vulkan_core.h> /* types alone: no function of Vulkan is linked. volk.h or vulkan.h before this do as well */
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------- devices */

typedef enum hydra_vk_device_type {
    HYDRA_VK_DEVICE_ANY, /* the best there is: discrete, integrated, virtual, then processor */
    HYDRA_VK_DEVICE_DISCRETE,
    HYDRA_VK_DEVICE_INTEGRATED,
    HYDRA_VK_DEVICE_VIRTUAL,
    HYDRA_VK_DEVICE_CPU
} hydra_vk_device_type;

typedef struct hydra_vk_device_info {
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    hydra_vk_device_type type;
    uint32_t api_version, driver_version; /* as Vulkan packs them */
    uint64_t memory;       /* bytes of the largest heap on the device */
    uint64_t binding_most; /* maxStorageBufferRange */
    char lacks[128];       /* what it has not that hydra needs; "": nothing */
} hydra_vk_device_info;

/* Where samples are added up. The sums are exact, so both give the same film, to the bit (see EQUALITY). A device's film
   takes some bytes a pixel there (hydra_status.bytes_film, less tiles) beside the host's, and while it goes up or down as
   much again of memory that both see, where that is not the same memory anyway. */
typedef enum hydra_vk_film {
    HYDRA_VK_FILM_AUTO,  /* on the device; on the host where the device is a processor, where a binding of the device is too
                            small for the film, or where that would take more than a quarter of its memory or of memory_cap:
                            foreseen from those alone, not from what else has taken memory meanwhile */
    HYDRA_VK_FILM_HOST,  /* every sample comes back: 16 bytes, 112 where more than radiance is asked for */
    HYDRA_VK_FILM_DEVICE /* where it does not fit, hydra_render_create fails */
} hydra_vk_film;

typedef struct hydra_vk_desc {
    /* Which device: all three must fit where they are given. */
    uint32_t device_number;           /* from 1, in the order of hydra_vk_list_devices; 0: any */
    const char *device_name;          /* part of its name, letter by letter */
    hydra_vk_device_type device_type;

    /* Your own Vulkan. vkGetInstanceProcAddr of your loader (with volk: your global); default: the system's loader is
       opened. With an instance it must be that instance's: the default will do for one that the system's loader made. */
    PFN_vkGetInstanceProcAddr get_instance_proc_addr;
    VkInstance instance;              /* of Vulkan 1.2 at least */
    /* All or none: a device with shaderFloat64 enabled, and a queue of a family with compute. They stay yours and must
       outlive the context. physical_device alone picks the device that the library makes. */
    VkPhysicalDevice physical_device;
    VkDevice device;
    VkQueue queue;
    uint32_t queue_family;
    /* Called around every use of the queue, for queues that your threads use too. Call nothing of hydra while you hold that
       lock: hydra_vk_get_info too waits for threads that want it. */
    void (*lock_queue)(void *user);
    void (*unlock_queue)(void *user);
    void *lock_user;
    const VkAllocationCallbacks *allocation; /* must outlive the context; default: the driver's */

    bool validation;                  /* turns on VK_LAYER_KHRONOS_validation with synchronization validation in an
                                         instance the library makes; messages go to hydra_context_desc.log */
    double slice_seconds;             /* what a submission aims to take at most; default 0.03. From speeds seen so far, so
                                         some take longer; 8 samples of a tile, one scattering, is the least there can be */
    hydra_vk_film film;
    size_t memory_cap;                /* bytes of device memory; default: none */
    /* What hydra_vk_save_pipelines gave, on whatever device: it is used where it fits. Read during the call. */
    const void *pipeline_cache;
    size_t pipeline_cache_size;

    char *error;                      /* gets the message when creation fails, cut to error_size bytes with its zero */
    size_t error_size;
} hydra_vk_desc;

/* Fills infos with at most *count devices and sets *count to how many there are; infos NULL: only that. Of desc, the
   loader and the instance are used; NULL: defaults. No device is HYDRA_OK and 0; no loader, HYDRA_ERROR_DEVICE. */
HYDRA_API hydra_result hydra_vk_list_devices(const hydra_vk_desc *desc, hydra_vk_device_info *infos, uint32_t *count);

/* A context that renders on a device. Both descs may be NULL. *context is NULL on failure:
   HYDRA_ERROR_DEVICE            no loader, no device that was asked for, or it lacks something (named)
   HYDRA_ERROR_ISA               the instruction set asked for is not there
   HYDRA_ERROR_OUT_OF_MEMORY     whatever else makes hydra_create fail, or memory of the host
   HYDRA_ERROR_DEVICE_MEMORY     the device has none
   The context's threads add up samples and build trees; pipelines are made when a render first needs them. */
HYDRA_API hydra_result hydra_vk_create(const hydra_context_desc *desc, const hydra_vk_desc *vk, hydra_context **context);

/* ---------------------------------------------------------------- what a device context adds

   Errors that calls of hydra.h may give with such a context:
   HYDRA_ERROR_DEVICE_LIMIT   a scene's or render's buffer is larger than the device can bind; the message has both numbers
   HYDRA_ERROR_DEVICE_MEMORY  the device's memory, or hydra_vk_desc.memory_cap, is used up
   HYDRA_ERROR_DEVICE_LOST    the driver gave the device up. The context, and every call that needs the device, will go on
                              saying so; scenes are intact, and what was rendered can still be read and saved. Where the film
                              was on the device, that is what it held when the host last had all of it: at the last
                              hydra_render_read, _save, _merge or, once it tells errors, _status. Destroy it and make another
   After the first two the context is as usable as before. Ray queries give these codes too, and HYDRA_ERROR_OUT_OF_MEMORY
   where the host's allocator refuses; they write no text. Where the film is on the device, hydra_render_read, _save and
   _merge may give them as well, and leave the film as it was; a status then has the errors of the one before. */

typedef struct hydra_vk_info {
    char name[VK_MAX_PHYSICAL_DEVICE_NAME_SIZE];
    hydra_vk_device_type type;
    uint64_t bytes_now, bytes_peak;  /* device memory */
    uint32_t pipelines;              /* made so far: kernels times sets of requirements */
    double seconds_start;            /* loader, instance and device */
    double seconds_pipelines;        /* making them; part of hydra_render_create, and of the first ray query and write */
    uint64_t bytes_read;             /* that the host has read of what the device made: counts, samples, films, hits */
    uint64_t submissions;            /* to the queue, in all */
    uint64_t slices;                 /* those that traced paths or cast rays */
    double slice_mean, slice_longest; /* seconds that slices took */
    uint32_t validation_messages;
    bool lost;
} hydra_vk_info;

/* HYDRA_ERROR_HANDLE: not a device context. */
HYDRA_API hydra_result hydra_vk_get_info(const hydra_context *context, hydra_vk_info *info);

/* The pipelines made so far, for hydra_vk_desc.pipeline_cache of a later run: *size bytes; buffer NULL tells the size
   (HYDRA_ERROR_BUFFER: *size was too small). */
HYDRA_API hydra_result hydra_vk_save_pipelines(const hydra_context *context, void *buffer, size_t *size);

/* As hydra_render_read, with the same errors, into a buffer of the caller's device (hydra_vk_desc.device): the pixels are
   copied by the device, and the call returns when they are there. The buffer has memory for all rows behind offset, which is
   not checked, usage TRANSFER_DST, and is the queue family's of the context or shared with it. offset and row_stride are
   multiples of 4 (row_stride 0: tight), else HYDRA_ERROR_STRIDE. The caller synchronises his own uses of the buffer before
   and after. Where the film is on the device, it makes the pixels: the same bits where its double division rounds correctly.
   Not HYDRA_ERROR, for which a pixel's neighbours are asked, nor HYDRA_VALIDITY, nor any output before the first step or
   between hydra_render_merge and the next one: those the host makes, as it does for films of its own. */
HYDRA_API hydra_result hydra_vk_render_write(hydra_render *render, hydra_output output, VkBuffer buffer, VkDeviceSize offset, size_t row_stride);

#ifdef __cplusplus
}
#endif

#endif /* HYDRA_VK_H */
