/* Embree 3 as tracers: single rays, packets of 4, 8 and 16, streams of rays and of packets, each in a scene of every
   build quality and flag that its manual names for speed. Without its header: says so. */
#include "rays.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_include)
#if __has_include(<embree3/rtcore.h>)
#define HAVE_EMBREE 1
#endif
#endif

#ifdef HAVE_EMBREE
#include <embree3/rtcore.h>
#if defined(__SSE__) || defined(__x86_64__)
#include <xmmintrin.h>
#endif

struct peer {
    RTCDevice device;
    const geometry *g;
    RTCScene scenes[PEER_VARIANTS];
};

/* ---- scenes */

static bool variant_robust(int variant) { return variant & 1; }
bool peer_variant_compact(int variant) { return variant & 2; }
static bool variant_high(int variant) { return variant & 4; }

static void report_error(void *user, enum RTCError code, const char *text) {
    (void)user;
    (void)code;
    bench_stop("embree", text);
}

bool peer_installed(char text[128]) {
    snprintf(text, 128, "Embree %s", RTC_VERSION_STRING);
    return true;
}

peer *peer_open(const geometry *g) {
    peer *p = calloc(1, sizeof *p);
    if (!p) bench_stop("memory", "there is none");
    p->device = rtcNewDevice("threads=0");
    if (!p->device) bench_stop("embree", "rtcNewDevice failed");
    rtcSetDeviceErrorFunction(p->device, report_error, NULL);
    p->g = g;
    return p;
}

void peer_close(peer *p) {
    for (int v = 0; v < PEER_VARIANTS; v++) peer_release(p, v);
    rtcReleaseDevice(p->device);
    free(p);
}

void peer_build(peer *p, int variant) {
    if (p->scenes[variant]) return;
    enum RTCBuildQuality quality = variant_high(variant) ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;
    int flags = (variant_robust(variant) ? RTC_SCENE_FLAG_ROBUST : 0) | (peer_variant_compact(variant) ? RTC_SCENE_FLAG_COMPACT : 0);
    RTCScene scene = rtcNewScene(p->device);
    RTCGeometry mesh = rtcNewGeometry(p->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, p->g->positions, 0, 12, p->g->vertices);
    rtcSetSharedGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, p->g->indices, 0, 12, p->g->triangles);
    rtcSetGeometryBuildQuality(mesh, quality);
    rtcCommitGeometry(mesh);
    rtcSetSceneFlags(scene, (enum RTCSceneFlags)flags);
    rtcSetSceneBuildQuality(scene, quality);
    rtcAttachGeometry(scene, mesh);
    rtcReleaseGeometry(mesh);
    rtcCommitScene(scene);
    p->scenes[variant] = scene;
}

void peer_release(peer *p, int variant) {
    if (p->scenes[variant]) rtcReleaseScene(p->scenes[variant]);
    p->scenes[variant] = NULL;
}

/* ---- modes */

typedef struct mode_info {
    const char *name;
    int width; /* rays in a packet; 1: as structures */
    bool coherent, stream;
} mode_info;

static const mode_info modes[PEER_MODES] = {
    {"1", 1, false, false},         {"4", 4, false, false},           {"8", 8, false, false},           {"8 coherent", 8, true, false},
    {"16", 16, false, false},       {"16 coherent", 16, true, false}, {"1M", 1, false, true},           {"1M coherent", 1, true, true},
    {"4 coherent", 4, true, false}, {"16M", 16, false, true},         {"16M coherent", 16, true, true},
};

enum { STREAM = 4096 }; /* rays a stream call gets at most: what Embree has to hand stays in the cache */

static const int all_valid[16] __attribute__((aligned(64))) = {-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};

/* A ray that no packet's or stream's traversal answers: the filling of the last packet. */
static hydra_ray ray_or_idle(const ray_set *set, size_t i) {
    hydra_ray ray = set->rays[i < set->count ? i : set->count - 1];
    if (i >= set->count) ray.t_min = 1.0f, ray.t_max = 0.0f;
    return ray;
}

static void set_ray(struct RTCRay *out, const hydra_ray *r) {
    out->org_x = r->origin[0], out->org_y = r->origin[1], out->org_z = r->origin[2], out->tnear = r->t_min;
    out->dir_x = r->direction[0], out->dir_y = r->direction[1], out->dir_z = r->direction[2], out->time = 0.0f;
    out->tfar = r->t_max, out->mask = ~0u, out->id = 0, out->flags = 0;
}

static void fill1(void *data, const ray_set *set, bool any) {
    for (size_t i = 0; i < set->count; i++) {
        if (any) {
            set_ray((struct RTCRay *)data + i, &set->rays[i]);
        } else {
            struct RTCRayHit *out = (struct RTCRayHit *)data + i;
            memset(out, 0, sizeof *out);
            set_ray(&out->ray, &set->rays[i]);
            out->hit.geomID = out->hit.primID = out->hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        }
    }
}

static void trace1(RTCScene scene, const mode_info *mode, struct RTCIntersectContext *context, void *data, bool any, size_t first,
                   size_t end) {
    struct RTCRay *rays = data;
    struct RTCRayHit *hits = data;
    size_t step = mode->stream ? STREAM : 1;
    for (size_t i = first; i < end; i += step) {
        unsigned n = (unsigned)(end - i < step ? end - i : step);
        if (mode->stream && any)
            rtcOccluded1M(scene, context, rays + i, n, sizeof *rays);
        else if (mode->stream)
            rtcIntersect1M(scene, context, hits + i, n, sizeof *hits);
        else if (any)
            rtcOccluded1(scene, context, rays + i);
        else
            rtcIntersect1(scene, context, hits + i);
    }
}

/* Packets of N. The structures have the same members but for their length; hence a macro. */
#define PACKETS(N)                                                                                                                \
    static void set_packet##N(struct RTCRay##N *out, int lane, const hydra_ray *r) {                                              \
        out->org_x[lane] = r->origin[0], out->org_y[lane] = r->origin[1], out->org_z[lane] = r->origin[2];                        \
        out->dir_x[lane] = r->direction[0], out->dir_y[lane] = r->direction[1], out->dir_z[lane] = r->direction[2];               \
        out->tnear[lane] = r->t_min, out->tfar[lane] = r->t_max, out->time[lane] = 0.0f;                                          \
        out->mask[lane] = ~0u, out->id[lane] = 0, out->flags[lane] = 0;                                                           \
    }                                                                                                                             \
    static void fill##N(void *data, const ray_set *set, bool any) {                                                               \
        for (size_t p = 0; p * N < set->count; p++) {                                                                             \
            struct RTCRayHit##N *hits = (struct RTCRayHit##N *)data + p;                                                          \
            struct RTCRay##N *rays = any ? (struct RTCRay##N *)data + p : &hits->ray;                                             \
            if (!any) memset(&hits->hit, 0xff, sizeof hits->hit);                                                                 \
            for (int lane = 0; lane < N; lane++) {                                                                                \
                hydra_ray r = ray_or_idle(set, p * N + (size_t)lane);                                                             \
                set_packet##N(rays, lane, &r);                                                                                    \
            }                                                                                                                     \
        }                                                                                                                         \
    }                                                                                                                             \
    static void packets##N(RTCScene scene, struct RTCIntersectContext *context, void *data, bool any, size_t first, size_t end) { \
        struct RTCRay##N *rays = data;                                                                                            \
        struct RTCRayHit##N *hits = data;                                                                                         \
        for (size_t p = first / N; p * N < end; p++) {                                                                            \
            int tail[N] __attribute__((aligned(64)));                                                                             \
            const int *valid = all_valid;                                                                                         \
            if (end - p * N < N) {                                                                                                \
                for (size_t lane = 0; lane < N; lane++) tail[lane] = p * N + lane < end ? -1 : 0;                                 \
                valid = tail;                                                                                                     \
            }                                                                                                                     \
            if (any)                                                                                                              \
                rtcOccluded##N(valid, scene, context, rays + p);                                                                  \
            else                                                                                                                  \
                rtcIntersect##N(valid, scene, context, hits + p);                                                                 \
        }                                                                                                                         \
    }                                                                                                                             \
    static answer answer##N(const void *data, bool any, size_t i) {                                                               \
        const struct RTCRayHit##N *hits = (const struct RTCRayHit##N *)data + i / N;                                              \
        if (any) return (answer){((const struct RTCRay##N *)data)[i / N].tfar[i % N] < 0.0f ? 0.0f : -1.0f, HYDRA_NONE};          \
        bool hit = hits->hit.geomID[i % N] != RTC_INVALID_GEOMETRY_ID;                                                            \
        return (answer){hit ? hits->ray.tfar[i % N] : -1.0f, hits->hit.primID[i % N]};                                            \
    }

PACKETS(4)
PACKETS(8)
PACKETS(16)

/* Streams of 16-packets. */
static void trace16m(RTCScene scene, struct RTCIntersectContext *context, void *data, bool any, size_t first, size_t end) {
    struct RTCRay16 *rays = data;
    struct RTCRayHit16 *hits = data;
    size_t last = (end + 15) / 16, step = STREAM / 16;
    for (size_t p = first / 16; p < last; p += step) {
        unsigned n = (unsigned)(last - p < step ? last - p : step);
        if (any)
            rtcOccludedNM(scene, context, (struct RTCRayN *)(rays + p), 16, n, sizeof *rays);
        else
            rtcIntersectNM(scene, context, (struct RTCRayHitN *)(hits + p), 16, n, sizeof *hits);
    }
}

/* ---- tracers */

typedef struct embree_data {
    void *rays;
    size_t count;
} embree_data;

static void embree_empty(tracer *t) {
    embree_data *d = t->data;
    if (!d) return;
    free(d->rays);
    free(d);
    t->data = NULL;
}

static void embree_fill(tracer *t, const ray_set *set) {
    embree_data *d = t->data;
    if (d && d->count != set->count) embree_empty(t), d = NULL;
    if (!d) {
        t->data = d = bench_alloc(sizeof *d);
        d->count = set->count;
        d->rays = bench_alloc(((set->count + 15) & ~(size_t)15) * (t->any ? sizeof(struct RTCRay) : sizeof(struct RTCRayHit)));
    }
    switch (modes[t->mode].width) {
    case 1: fill1(d->rays, set, t->any); break;
    case 4: fill4(d->rays, set, t->any); break;
    case 8: fill8(d->rays, set, t->any); break;
    default: fill16(d->rays, set, t->any);
    }
}

/* Embree's manual asks for denormals to be flushed while it traces. */
static unsigned flush_denormals(void) {
#ifdef _MM_SET_FLUSH_ZERO_MODE
    unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u);
    return before;
#else
    return 0;
#endif
}

static void restore_denormals(unsigned before) {
#ifdef _MM_SET_FLUSH_ZERO_MODE
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

static void embree_trace(const tracer *t, size_t first, size_t count) {
    const mode_info *mode = &modes[t->mode];
    void *rays = ((const embree_data *)t->data)->rays;
    unsigned before = flush_denormals();
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = mode->coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    size_t end = first + count;
    if (mode->width == 1)
        trace1(t->self, mode, &context, rays, t->any, first, end);
    else if (mode->stream)
        trace16m(t->self, &context, rays, t->any, first, end);
    else if (mode->width == 4)
        packets4(t->self, &context, rays, t->any, first, end);
    else if (mode->width == 8)
        packets8(t->self, &context, rays, t->any, first, end);
    else
        packets16(t->self, &context, rays, t->any, first, end);
    restore_denormals(before);
}

static answer answer1(const void *data, bool any, size_t i) {
    const struct RTCRayHit *hit = (const struct RTCRayHit *)data + i;
    if (any) return (answer){((const struct RTCRay *)data)[i].tfar < 0.0f ? 0.0f : -1.0f, HYDRA_NONE};
    return (answer){hit->hit.geomID != RTC_INVALID_GEOMETRY_ID ? hit->ray.tfar : -1.0f, hit->hit.primID};
}

static void embree_read(const tracer *t, answer *answers, size_t count) {
    const void *rays = ((const embree_data *)t->data)->rays;
    int width = modes[t->mode].width;
    for (size_t i = 0; i < count; i++) {
        if (width == 1)
            answers[i] = answer1(rays, t->any, i);
        else if (width == 4)
            answers[i] = answer4(rays, t->any, i);
        else if (width == 8)
            answers[i] = answer8(rays, t->any, i);
        else
            answers[i] = answer16(rays, t->any, i);
    }
}

static tracer new_tracer(RTCScene scene, int mode, bool any) {
    tracer t = {.single = mode == 0, .self = scene, .mode = mode, .any = any};
    t.fill = embree_fill, t.trace = embree_trace, t.read = embree_read, t.empty = embree_empty;
    return t;
}

tracer peer_scene_tracer(void *scene, int width) {
    int mode = 0;
    while (modes[mode].width != width) mode++;
    return new_tracer(scene, mode, false);
}

tracer peer_tracer(peer *p, int variant, int mode, bool any) {
    tracer t = new_tracer(p->scenes[variant], mode, any);
    t.robust = variant_robust(variant);
    snprintf(t.name, sizeof t.name, "%s%s%s %s", variant_high(variant) ? "high" : "medium", peer_variant_compact(variant) ? " compact" : "",
             t.robust ? " robust" : "", modes[mode].name);
    /* rtcOccluded16 with the coherent flag does not return from a compact robust scene (Sponza, the first packet) */
    bool wide = modes[mode].width == 16 || modes[mode].stream;
    if (any && peer_variant_compact(variant) && t.robust && modes[mode].coherent && wide) t.trace = NULL;
    return t;
}

#else /* no Embree */

bool peer_installed(char text[128]) {
    snprintf(text, 128, "embree: not installed");
    return false;
}
bool peer_variant_compact(int variant) { return (void)variant, false; }
peer *peer_open(const geometry *g) { return (void)g, NULL; }
void peer_close(peer *p) { (void)p; }
void peer_build(peer *p, int variant) { (void)p, (void)variant; }
void peer_release(peer *p, int variant) { (void)p, (void)variant; }
tracer peer_tracer(peer *p, int variant, int mode, bool any) {
    (void)p, (void)variant, (void)mode, (void)any;
    return (tracer){.mode = 0};
}
tracer peer_scene_tracer(void *scene, int width) {
    (void)scene, (void)width;
    return (tracer){.mode = 0};
}

#endif
