/* Embree's builds: high and medium quality, low quality for dynamic scenes, refitting; with its own threads, and its
   memory counted by its own monitor. */
#include "rays.h"

#include <stdlib.h>

#if defined(__has_include)
#if __has_include(<embree3/rtcore.h>)
#define HAVE_EMBREE 1
#endif
#endif

#ifdef HAVE_EMBREE
#include <embree3/rtcore.h>

struct peer_builder {
    RTCDevice device;
    const geometry *g;
    RTCScene built;    /* by the last run, if that was no refit */
    RTCScene refitted; /* NULL until the first refit is asked for */
    RTCGeometry refitted_mesh;
    long bytes; /* that the device holds */
};

static bool count_bytes(void *user, ssize_t bytes, bool post) {
    (void)post;
    __atomic_fetch_add((long *)user, (long)bytes, __ATOMIC_RELAXED);
    return true;
}

static void report_error(void *user, enum RTCError code, const char *text) {
    (void)user;
    (void)code;
    bench_stop("embree", text);
}

peer_builder *peer_builder_open(const geometry *g) {
    if (!g) return NULL;
    peer_builder *b = bench_alloc(sizeof *b);
    *b = (peer_builder){.device = rtcNewDevice("threads=0"), .g = g};
    if (!b->device) bench_stop("embree", "rtcNewDevice failed");
    rtcSetDeviceErrorFunction(b->device, report_error, NULL);
    rtcSetDeviceMemoryMonitorFunction(b->device, count_bytes, &b->bytes);
    return b;
}

static void release_built(peer_builder *b) {
    if (b->built) rtcReleaseScene(b->built);
    b->built = NULL;
}

void peer_builder_close(peer_builder *b) {
    if (!b) return;
    release_built(b);
    if (b->refitted) {
        rtcReleaseGeometry(b->refitted_mesh);
        rtcReleaseScene(b->refitted);
    }
    rtcReleaseDevice(b->device);
    free(b);
}

static RTCGeometry new_mesh(peer_builder *b, enum RTCBuildQuality quality) {
    RTCGeometry mesh = rtcNewGeometry(b->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, b->g->positions, 0, 12, b->g->vertices);
    rtcSetSharedGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, b->g->indices, 0, 12, b->g->triangles);
    rtcSetGeometryBuildQuality(mesh, quality);
    return mesh;
}

static RTCScene new_scene(peer_builder *b, RTCGeometry mesh, enum RTCBuildQuality quality, bool dynamic) {
    RTCScene scene = rtcNewScene(b->device);
    rtcSetSceneFlags(scene, dynamic ? RTC_SCENE_FLAG_DYNAMIC : RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(scene, quality);
    rtcAttachGeometry(scene, mesh);
    return scene;
}

static build_cost build(peer_builder *b, enum RTCBuildQuality quality, bool dynamic) {
    long before = b->bytes;
    RTCGeometry mesh = new_mesh(b, quality);
    RTCScene scene = new_scene(b, mesh, quality, dynamic);
    double from = wall_seconds();
    rtcCommitGeometry(mesh);
    rtcCommitScene(scene);
    build_cost cost = {wall_seconds() - from, (size_t)(b->bytes - before), 0.0};
    rtcReleaseGeometry(mesh);
    b->built = scene;
    return cost;
}

static build_cost refit(peer_builder *b) {
    if (!b->refitted) {
        b->refitted_mesh = new_mesh(b, RTC_BUILD_QUALITY_REFIT);
        b->refitted = new_scene(b, b->refitted_mesh, RTC_BUILD_QUALITY_LOW, true);
    }
    double from = wall_seconds();
    rtcUpdateGeometryBuffer(b->refitted_mesh, RTC_BUFFER_TYPE_VERTEX, 0);
    rtcCommitGeometry(b->refitted_mesh);
    rtcCommitScene(b->refitted);
    return (build_cost){wall_seconds() - from, 0, 0.0};
}

build_cost peer_builder_run(peer_builder *b, build_job job) {
    if (!b) return (build_cost){0.0, 0, 0.0};
    release_built(b);
    if (job == BUILD_REFIT) return refit(b);
    if (job == BUILD_BEST) return build(b, RTC_BUILD_QUALITY_HIGH, false);
    return job == BUILD_FAST ? build(b, RTC_BUILD_QUALITY_MEDIUM, false) : build(b, RTC_BUILD_QUALITY_LOW, true);
}

tracer peer_builder_tracer(const peer_builder *b) {
    if (!b) return (tracer){.mode = 0};
    return peer_scene_tracer(b->built ? b->built : b->refitted, 8);
}

#else /* no Embree */

peer_builder *peer_builder_open(const geometry *g) { return (void)g, NULL; }
void peer_builder_close(peer_builder *b) { (void)b; }
build_cost peer_builder_run(peer_builder *b, build_job job) { return (void)b, (void)job, (build_cost){0.0, 0, 0.0}; }
tracer peer_builder_tracer(const peer_builder *b) { return (void)b, (tracer){.mode = 0}; }

#endif
