/* >>base-context: the context, its errors, log, memory and threads */
#ifndef HYI_CONTEXT_H
#define HYI_CONTEXT_H

#include "platform.h"

typedef struct hyi_pool hyi_pool;
struct hyi_backend;

struct hydra_context {
    hydra_context_desc desc;
    hydra_isa isa;
    uint32_t threads;
    hyi_pool *pool; /* NULL: one thread, or the caller's parallel_for */
    const struct hyi_backend *backend; /* NULL: work is done on the threads (backend.h) */
    void *device;                      /* the backend's */
    uint32_t scenes_living;
    hyi_atomic quiet_thread; /* whose failures leave no text, since it casts rays; 0: none */
    hyi_atomic bytes_now, bytes_peak, allocations_now;
    char error[512];
};

/* ---- errors and log */

HYI_FN void hyi_log(const hydra_context *context, hydra_log_level level, const char *text) {
    if (context->desc.log) context->desc.log(context->desc.log_user, level, text);
}

/* Records and logs the message, unless the thread is to be quiet; returns result, so that a function can end with it. */
HYI_NOINLINE hydra_result hyi_fail(hydra_context *context, hydra_result result, const char *format, ...) HYI_PRINTF(3, 4);
HYI_NOINLINE hydra_result hyi_fail(hydra_context *context, hydra_result result, const char *format, ...) {
    if (hyi_atomic_load(&context->quiet_thread) == hyi_this_thread()) return result;
    int used = snprintf(context->error, sizeof context->error, "%s: ", hydra_result_text(result));
    size_t at = used > 0 && (size_t)used < sizeof context->error ? (size_t)used : 0;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(context->error + at, sizeof context->error - at, format, arguments);
    va_end(arguments);
    hyi_log(context, HYDRA_LOG_ERROR, context->error);
    return result;
}

/* ---- memory. Every block is freed with the size it was asked for with. */

/* Blocks that span several huge pages ask for them, where the system gives them to who asks: arrays that are read here and
   there then miss the table of pages less often, and fresh ones have fewer pages to be made. The last part of one stays in
   small pages, so that no more memory is taken than asked for. */
#define HYI_HUGE_PAGE ((size_t)1 << 21)

HYI_FN void *hyi_default_alloc(void *user, size_t size) {
    (void)user;
#if defined(_WIN32)
    return _aligned_malloc(size, 64);
#else /* posix_memalign is hidden in strict C99: align by hand, keeping malloc's pointer before the block */
    size_t alignment = size >= 2u * HYI_HUGE_PAGE ? HYI_HUGE_PAGE : 64u;
    char *block = size <= SIZE_MAX - alignment - sizeof(void *) ? (char *)malloc(size + alignment + sizeof(void *)) : NULL;
    if (!block) return NULL;
    char *aligned = block + sizeof(void *);
    aligned += (alignment - (uintptr_t)aligned % alignment) % alignment;
    memcpy(aligned - sizeof(void *), &block, sizeof block);
#if defined(MADV_HUGEPAGE)
    if (alignment == HYI_HUGE_PAGE) (void)madvise(aligned, size - size % HYI_HUGE_PAGE, MADV_HUGEPAGE);
#endif
    return aligned;
#endif
}

HYI_FN void hyi_default_release(void *user, void *memory, size_t size) {
    (void)user;
    (void)size;
#if defined(_WIN32)
    _aligned_free(memory);
#else
    void *block;
    memcpy(&block, (char *)memory - sizeof(void *), sizeof block);
    free(block);
#endif
}

HYI_FN bool hyi_multiply_overflows(size_t a, size_t b) {
    return b != 0 && a > SIZE_MAX / b;
}

/* *memory gets size bytes aligned to 64, or NULL when size is 0. Contents are undefined. Any thread; says nothing in
   the context's text. */
HYI_FN hydra_result hyi_try_alloc(hydra_context *context, size_t size, void **memory) {
    *memory = NULL;
    if (size == 0) return HYDRA_OK;
    size_t now = (size_t)hyi_atomic_add(&context->bytes_now, (int64_t)size) + size;
    bool allowed = !context->desc.memory_cap || now <= context->desc.memory_cap;
    if (allowed) *memory = context->desc.allocator.alloc(context->desc.allocator.user, size);
    if (!*memory) {
        hyi_atomic_add(&context->bytes_now, -(int64_t)size);
        return allowed ? HYDRA_ERROR_OUT_OF_MEMORY : HYDRA_ERROR_MEMORY_CAP;
    }
    hyi_atomic_raise(&context->bytes_peak, (int64_t)now);
    hyi_atomic_add(&context->allocations_now, 1);
    return HYDRA_OK;
}

/* The same with a message. */
HYI_FN hydra_result hyi_alloc_bytes(hydra_context *context, size_t size, void **memory) {
    hydra_result result = hyi_try_alloc(context, size, memory);
    if (result == HYDRA_ERROR_OUT_OF_MEMORY) return hyi_fail(context, result, "%zu bytes", size);
    if (result != HYDRA_ERROR_MEMORY_CAP) return result;
    size_t now = (size_t)hyi_atomic_load(&context->bytes_now);
    return hyi_fail(context, result, "%zu bytes more than the %zu now, the cap is %zu", size, now, context->desc.memory_cap);
}

HYI_FN void hyi_free_bytes(hydra_context *context, void *memory, size_t size) {
    if (!memory) return;
    context->desc.allocator.release(context->desc.allocator.user, memory, size);
    hyi_atomic_add(&context->bytes_now, -(int64_t)size);
    hyi_atomic_add(&context->allocations_now, -1);
}

/* Arrays of count elements: hyi_alloc_array(context, &pointer, count) and its reverse, which also sets
   the pointer to NULL. The element type is the pointer's. */
HYI_FN hydra_result hyi_alloc_elements(hydra_context *context, void **memory, size_t count, size_t element) {
    *memory = NULL;
    if (hyi_multiply_overflows(count, element)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%zu elements of %zu bytes", count, element);
    return hyi_alloc_bytes(context, count * element, memory);
}
#define hyi_alloc_array(context, pointer, count) hyi_alloc_elements((context), (void **)(pointer), (count), sizeof **(pointer))
#define hyi_free_array(context, pointer, count) \
    (hyi_free_bytes((context), *(pointer), (size_t)(count) * sizeof **(pointer)), *(pointer) = NULL)

/* Grows an array to hold at least need elements, by half its size at a time; old contents stay. */
HYI_FN hydra_result hyi_grow_elements(hydra_context *context, void **memory, size_t *capacity, size_t need, size_t element) {
    if (need <= *capacity) return HYDRA_OK;
    size_t grown = *capacity + *capacity / 2 + 8;
    if (grown < need) grown = need;
    void *fresh;
    HYI_TRY(hyi_alloc_elements(context, &fresh, grown, element));
    if (*memory) memcpy(fresh, *memory, *capacity * element);
    hyi_free_bytes(context, *memory, *capacity * element);
    *memory = fresh;
    *capacity = grown;
    return HYDRA_OK;
}
#define hyi_grow_array(context, pointer, capacity, need) \
    hyi_grow_elements((context), (void **)(pointer), (capacity), (need), sizeof **(pointer))

#endif /* HYI_CONTEXT_H */
