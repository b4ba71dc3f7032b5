/* >>bvh-trace: what the renderer calls: batches of rays against surfaces, then against light shapes */
#ifndef HYI_BVH_TRACE_H
#define HYI_BVH_TRACE_H

#include "build.h"
#include "lanes_scalar.h"
#include "lanes_avx2.h"
#include "lanes_avx512.h"
#include "lanes_sse42.h"
#include "lanes_neon.h"

/* ---- by instruction set */

#if HYI_X86
#define HYI_VECTOR_CASES(name, arguments)                  \
    case HYDRA_ISA_AVX512: name##_avx512 arguments; break; \
    case HYDRA_ISA_AVX2: name##_avx2 arguments; break;     \
    case HYDRA_ISA_SSE42: name##_sse42 arguments; break;
#elif HYI_NEON
#define HYI_VECTOR_CASES(name, arguments) \
    case HYDRA_ISA_NEON: name##_neon arguments; break;
#else
#define HYI_VECTOR_CASES(name, arguments)
#endif

/* Calls name for an instruction set; for one that has vectors. */
#define HYI_DISPATCH(isa, name, arguments)        \
    switch (isa) {                                \
        HYI_VECTOR_CASES(name, arguments)         \
    default: name##_scalar arguments; break;      \
    }
#if HYI_X86 || HYI_NEON
#define HYI_DISPATCH_VECTOR(isa, name, arguments) \
    switch (isa) {                                \
        HYI_VECTOR_CASES(name, arguments)         \
    default: break;                               \
    }
#else /* without vectors no stream has a capacity, and this is never reached */
HYI_INLINE void hyi_no_vectors(const void *site, ...) { (void)site; }
#define HYI_DISPATCH_VECTOR(isa, name, arguments) hyi_no_vectors arguments;
#endif

/* ---- memory for streams */

#define HYI_STREAM_LISTS 40u /* words a ray: eight lists of all at the root, fewer at each level below */

/* A block of rays makes no more packets than there is room for. */
HYI_STATIC_ASSERT(HYI_STREAM_LEAST / 8u > HYI_PACKET_WIDTH / HYI_PACKET_LEAST);

/* Sizes for calls of about count rays; capacity 0: none are needed. */
HYI_INLINE hyi_ray_stream hyi_plan_ray_stream(const hyi_accel *accel, size_t count) {
    hyi_ray_stream stream;
    memset(&stream, 0, sizeof stream);
    if (accel->isa == HYDRA_ISA_SCALAR || accel->empty || count < HYI_STREAM_LEAST) return stream;
    stream.levels = accel->single ? 1u : 2u;
    stream.capacity = count < HYI_STREAM_RAYS ? ((uint32_t)count + 15u) & ~15u : HYI_STREAM_RAYS;
    stream.packet_share = stream.capacity / 8u < HYI_STREAM_PACKETS ? stream.capacity / 8u : HYI_STREAM_PACKETS;
    stream.list_count = (size_t)stream.capacity * HYI_STREAM_LISTS + 2u * HYI_LIST_RESERVE;
    return stream;
}

/* Whole cache lines: flights begin after them. */
HYI_INLINE size_t hyi_packets_bytes(const hyi_ray_stream *stream) {
    return (stream->packet_share * sizeof *stream->packets + 63u) & ~(size_t)63u;
}

HYI_INLINE size_t hyi_ray_stream_bytes(const hyi_ray_stream *stream) {
    if (stream->capacity == 0) return 0;
    return hyi_packets_bytes(stream) + stream->levels * stream->capacity * sizeof *stream->flights + stream->list_count * sizeof(uint32_t);
}

HYI_FN void hyi_ray_stream_free(hydra_context *context, hyi_ray_stream *stream) {
    hyi_free_bytes(context, stream->packets, hyi_ray_stream_bytes(stream));
    memset(stream, 0, sizeof *stream);
}

/* One block. On failure the capacity is 0, and the stream good for rays one by one; nothing is said in the context's text. */
HYI_FN hydra_result hyi_ray_stream_alloc(hydra_context *context, const hyi_accel *accel, size_t count, hyi_ray_stream *stream) {
    void *block;
    *stream = hyi_plan_ray_stream(accel, count);
    if (stream->capacity == 0) return HYDRA_OK;
    hydra_result result = hyi_try_alloc(context, hyi_ray_stream_bytes(stream), &block);
    if (result != HYDRA_OK) {
        memset(stream, 0, sizeof *stream);
        return result;
    }
    stream->packets = (hyi_packet *)block;
    stream->flights = (hyi_flight *)(void *)((char *)block + hyi_packets_bytes(stream));
    stream->lists = (uint32_t *)(void *)(stream->flights + stream->levels * stream->capacity);
    return HYDRA_OK;
}

/* ---- one by one */

/* The tracing functions say whether all rays were sound. */
HYI_INLINE bool hyi_trace_singles(const hyi_accel *accel, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    bool sound = true;
    HYI_DISPATCH(accel->isa, sound = hyi_trace_singles, (accel, rays, answers, count))
    return sound;
}

/* ---- streams */

HYI_FN bool hyi_trace_stream(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    hyi_site site = hyi_first_site(accel);
    bool sound = true, whole = true;
    uint32_t share = answers->occluded && HYI_STREAM_RAYS_ANY < stream->capacity ? HYI_STREAM_RAYS_ANY : stream->capacity;
    for (uint32_t first = 0, some; first < count; first += some) {
        hyi_answers from = hyi_answers_from(answers, first);
        some = count - first < share ? count - first : share;
        HYI_DISPATCH_VECTOR(accel->isa, whole = hyi_trace_slice, (&site, stream, rays + first, &from, some))
        sound = sound && whole;
    }
    return sound;
}

HYI_FN bool hyi_trace_nothing(const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    bool sound = true;
    for (uint32_t i = 0; i < count; i++) {
        sound = hyi_was_sound(&rays[i]) && sound;
        if (answers->occluded) answers->occluded[i] = 0;
        else if (answers->hits) hyi_answer_miss(&answers->hits[i]);
        else hyi_tell_miss(&answers->told[i]);
    }
    return sound;
}

/* What lies on count rays of triangles. Ties: smallest instance, then primitive. Light shapes are not looked at. stream: NULL
   or memory that no one else uses meanwhile. Rays are read by hyi_load_ray alone: they may be the caller's hydra_ray. Those
   that are not sound meet nothing; false: there were some. */
HYI_FN bool hyi_trace(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    if (accel->empty) return hyi_trace_nothing(rays, answers, count);
    if (stream && stream->capacity && count >= HYI_STREAM_LEAST) return hyi_trace_stream(accel, stream, rays, answers, count);
    return hyi_trace_singles(accel, rays, answers, count);
}

/* Closest hits: instance HYK_NONE and t -1 on a miss. */
HYI_FN bool hyi_trace_closest(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint32_t count) {
    hyi_answers answers;
    memset(&answers, 0, sizeof answers);
    answers.hits = hits;
    return hyi_trace(accel, stream, rays, &answers, count);
}

/* occluded[i] is set to 0 or 1. */
HYI_FN bool hyi_trace_any(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    hyi_answers answers;
    memset(&answers, 0, sizeof answers);
    answers.occluded = occluded;
    return hyi_trace(accel, stream, rays, &answers, count);
}

/* ---- light shapes: few, so one walk at a time does */

typedef struct hyi_shape_visit {
    const hyi_accel *accel;
    bool skip_hidden, any;
} hyi_shape_visit;

HYI_FN bool hyi_visit_shape(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_shape_visit *visit = (const hyi_shape_visit *)argument;
    uint32_t index = visit->accel->shape_lights[item];
    const hyk_light *light = &visit->accel->view->lights[index];
    if (visit->skip_hidden && (light->flags & HYK_LIGHT_HIDDEN)) return false;
    float t = hyk_intersect_shape(*light, hyi_load_ray(flight->ray));
    if (!(t >= flight->t_min && t <= flight->best.t && t >= 0.0f && hyi_beats(&flight->best, t, HYK_HIT_SHAPE, index))) return false;
    flight->best.t = t;
    flight->best.u = flight->best.v = 0.0f;
    flight->best.instance = HYK_HIT_SHAPE;
    flight->best.primitive = index;
    hyi_aim_limit(&flight->aim, t);
    return visit->any;
}

/* Whether a shape beats limit, the best that is known; the answer is then in flight->best. */
HYI_FN bool hyi_meet_shapes(hyi_shape_visit *visit, hyi_flight *flight, const hyk_ray *ray, const hyi_best *limit) {
    const hyi_bvh *shapes = visit->accel->shapes;
    if (!hyi_flight_begin(flight, shapes, ray, limit->t)) return false;
    flight->best = *limit;
    HYI_DISPATCH(visit->accel->isa, hyi_walk_boxes, (shapes, flight, shapes->root, hyi_visit_shape, visit))
    return flight->best.instance == HYK_HIT_SHAPE;
}

/* Replaces hits[i], or else told[i], where a light shape is nearer: instance HYK_HIT_SHAPE, primitive the light, u = v = 0.
   skip_hidden: lights flagged HYK_LIGHT_HIDDEN are not seen. */
HYI_FN void hyi_trace_shapes_closest(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, hydra_hit *told, uint32_t count, bool skip_hidden) {
    hyi_shape_visit visit;
    visit.accel = accel;
    visit.skip_hidden = skip_hidden;
    visit.any = false;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        hyi_best limit;
        float t = hits ? hits[i].t : told[i].t;
        bool found = hits ? hits[i].instance != HYK_NONE : told[i].mesh != 0;
        limit.t = found ? t : hyi_finite_limit(hyi_load_ray(&rays[i]).t_max);
        limit.u = limit.v = 0.0f;
        limit.instance = limit.primitive = found ? 0u : HYK_NONE; /* a surface before a shape at equal t, whichever it is */
        if (!hyi_meet_shapes(&visit, &flight, &rays[i], &limit)) continue;
        if (hits) hyi_answer(accel, &flight.best, &hits[i]);
        else hyi_tell_shape(accel, flight.best.primitive, flight.best.t, &rays[i], &told[i]);
    }
}

/* Sets occluded[i] to 1 where a shape lies on the ray; rays already occluded are skipped. */
HYI_FN void hyi_trace_shapes_any(const hyi_accel *accel, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    hyi_shape_visit visit;
    visit.accel = accel;
    visit.skip_hidden = false;
    visit.any = true;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        hyi_best limit;
        limit.t = hyi_finite_limit(hyi_load_ray(&rays[i]).t_max);
        limit.u = limit.v = 0.0f;
        limit.instance = limit.primitive = HYK_NONE;
        if (!occluded[i] && hyi_meet_shapes(&visit, &flight, &rays[i], &limit)) occluded[i] = 1;
    }
}

#endif /* HYI_BVH_TRACE_H */
