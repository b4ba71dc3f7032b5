/* >>base-create: contexts, and the text of results */
#ifndef HYI_CREATE_H
#define HYI_CREATE_H

#include "backend.h"

HYDRA_API const char *hydra_result_text(hydra_result result) {
    switch (result) {
#define HYI_RESULT_CASE(name, text) case name: return text;
        HYDRA_RESULTS(HYI_RESULT_CASE)
#undef HYI_RESULT_CASE
        case HYDRA_RESULT_COUNT: break;
    }
    return "not a result";
}

HYDRA_API const char *hydra_error_text(const hydra_context *context) {
    return context ? context->error : "no context: out of memory or threads, half an allocator, or an instruction set that is not there";
}

HYI_FN hydra_isa hyi_best_isa(void) {
    if (hyi_has_avx512()) return HYDRA_ISA_AVX512;
    if (hyi_has_avx2()) return HYDRA_ISA_AVX2;
    if (hyi_has_sse42()) return HYDRA_ISA_SSE42;
    return HYI_NEON ? HYDRA_ISA_NEON : HYDRA_ISA_SCALAR;
}

HYI_FN bool hyi_isa_is_there(hydra_isa isa) {
    switch (isa) {
    case HYDRA_ISA_SCALAR: return true;
    case HYDRA_ISA_SSE42: return hyi_has_sse42();
    case HYDRA_ISA_AVX2: return hyi_has_avx2();
    case HYDRA_ISA_AVX512: return hyi_has_avx512();
    case HYDRA_ISA_NEON: return HYI_NEON;
    default: return false;
    }
}

HYI_FN hydra_context_desc hyi_resolved_context_desc(const hydra_context_desc *desc) {
    hydra_context_desc resolved;
    memset(&resolved, 0, sizeof resolved);
    if (desc) resolved = *desc;
    if (!resolved.allocator.alloc && !resolved.allocator.release) {
        resolved.allocator.alloc = hyi_default_alloc;
        resolved.allocator.release = hyi_default_release;
    }
    if (resolved.threads == 0) resolved.threads = hyi_processor_count();
    if (resolved.threads > 1024) resolved.threads = 1024;
    if (resolved.isa == HYDRA_ISA_AUTO) resolved.isa = hyi_best_isa();
    return resolved;
}

HYDRA_API hydra_context *hydra_create(const hydra_context_desc *desc) {
    hydra_context_desc resolved = hyi_resolved_context_desc(desc);
    if (!hyi_isa_is_there(resolved.isa) || !resolved.allocator.alloc || !resolved.allocator.release) return NULL;
    if (resolved.memory_cap && resolved.memory_cap < sizeof(hydra_context)) return NULL;
    hydra_context *context = (hydra_context *)resolved.allocator.alloc(resolved.allocator.user, sizeof *context);
    if (!context) return NULL;
    memset(context, 0, sizeof *context);
    context->desc = resolved;
    context->isa = resolved.isa;
    context->threads = resolved.threads;
    hyi_atomic_store(&context->bytes_now, (int64_t)sizeof *context);
    hyi_atomic_store(&context->bytes_peak, (int64_t)sizeof *context);
    hyi_atomic_store(&context->allocations_now, 1);
#if defined(HYDRA_NO_THREADS)
    if (!resolved.parallel_for) context->threads = 1;
#else
    if (context->threads > 1 && !resolved.parallel_for && hyi_pool_create(context) != HYDRA_OK) {
        resolved.allocator.release(resolved.allocator.user, context, sizeof *context);
        return NULL;
    }
#endif
    return context;
}

HYDRA_API hydra_result hydra_destroy(hydra_context *context) {
    if (!context) return HYDRA_OK;
    if (context->scenes_living) return hyi_fail(context, HYDRA_ERROR_BUSY, "%u scenes of the context are alive", context->scenes_living);
#if !defined(HYDRA_NO_THREADS)
    hyi_pool_destroy(context);
#endif
    if (context->backend) context->backend->destroy(context);
    hydra_allocator allocator = context->desc.allocator;
    allocator.release(allocator.user, context, sizeof *context);
    return HYDRA_OK;
}

HYDRA_API hydra_memory_status hydra_memory(const hydra_context *context) {
    hydra_memory_status status = { 0, 0, 0 };
    if (!context) return status;
    status.bytes_now = (size_t)hyi_atomic_load(&context->bytes_now);
    status.bytes_peak = (size_t)hyi_atomic_load(&context->bytes_peak);
    status.allocations_now = (size_t)hyi_atomic_load(&context->allocations_now);
    return status;
}

HYDRA_API hydra_isa hydra_context_isa(const hydra_context *context) { return context ? context->isa : HYDRA_ISA_SCALAR; }
HYDRA_API uint32_t hydra_context_threads(const hydra_context *context) { return context ? context->threads : 0; }

#endif /* HYI_CREATE_H */
