/* Building and refitting, both sides in turn, on all processors: what hydra_scene_commit and what the peer's commit take,
   and how fast bounce rays then pass. Neither side's clock runs while it is handed its triangles; refitting includes
   handing over the moved vertices, which hydra copies and a peer with a shared buffer does not. */
#include "rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct builds {
    hydra_context *context;
    geometry *g;
    peer_builder *theirs;
    ray_set rays;
    int repeats;
    build_row row;
    build_cost ours[BUILD_JOBS][64], peers[BUILD_JOBS][64];
} builds;

/* FAST is for meshes that change, which have a BVH of their own. */
static hydra_mesh add_mesh(hydra_scene *scene, const geometry *g, hydra_build build, bool dynamic) {
    hydra_mesh_desc mesh = {.positions = {g->positions, 12, g->vertices}, .indices = {g->indices, 4, 3 * g->triangles}};
    mesh.build = build;
    mesh.dynamic = dynamic;
    return hydra_scene_add_mesh(scene, &mesh);
}

static double commit(hydra_context *context, hydra_scene *scene) {
    double from = wall_seconds();
    if (hydra_scene_commit(scene) != HYDRA_OK) bench_stop("hydra_scene_commit", hydra_error_text(context));
    return wall_seconds() - from;
}

static double speed(const builds *b, tracer t) {
    if (!t.trace || !b->rays.count) return 0.0;
    t.fill(&t, &b->rays);
    double seconds = trace_seconds(&t, b->rays.count, 1);
    t.empty(&t);
    return 1e-6 * (double)b->rays.count / seconds;
}

static build_cost finished(const builds *b, const hydra_scene *scene, double seconds) {
    hydra_scene_info info;
    hydra_scene_get_info(scene, &info);
    return (build_cost){seconds, info.bytes_bvh, speed(b, hydra_tracer(scene, false, false))};
}

static build_cost build_ours(const builds *b, build_job job) {
    hydra_scene *scene = hydra_scene_create(b->context);
    bool fast = job != BUILD_BEST;
    add_mesh(scene, b->g, fast ? HYDRA_BUILD_FAST : HYDRA_BUILD_BEST, fast);
    build_cost cost = finished(b, scene, commit(b->context, scene));
    hydra_scene_destroy(scene);
    return cost;
}

static build_cost run_theirs(const builds *b, build_job job) {
    build_cost cost = peer_builder_run(b->theirs, job);
    cost.speed = speed(b, peer_builder_tracer(b->theirs));
    return cost;
}

/* hydra's BEST against high quality, its FAST against medium and low. */
static void time_builds(builds *b) {
    for (int r = 0; r < b->repeats; r++) {
        b->ours[BUILD_BEST][r] = build_ours(b, BUILD_BEST);
        b->peers[BUILD_BEST][r] = run_theirs(b, BUILD_BEST);
        b->peers[BUILD_FAST][r] = run_theirs(b, BUILD_FAST);
        b->ours[BUILD_FAST][r] = b->ours[BUILD_FASTEST][r] = build_ours(b, BUILD_FAST);
        b->peers[BUILD_FASTEST][r] = run_theirs(b, BUILD_FASTEST);
    }
}

/* A wave through all vertices, a hundredth of the scene high. */
static void move(geometry *g, const float *still, float phase) {
    float size = geometry_size(g), waves = 20.0f / size;
    for (size_t i = 0; i < g->vertices; i++)
        for (size_t k = 0; k < 3; k++)
            g->positions[3 * i + k] = still[3 * i + k] + 0.01f * size * sinf(waves * still[3 * i + (k + 1) % 3] + phase + (float)k);
}

static void time_refits(builds *b) {
    geometry *g = b->g;
    float *still = bench_alloc(12 * g->vertices);
    memcpy(still, g->positions, 12 * g->vertices);
    hydra_scene *scene = hydra_scene_create(b->context);
    hydra_mesh mesh = add_mesh(scene, g, HYDRA_BUILD_AUTO, true);
    commit(b->context, scene);
    peer_builder_run(b->theirs, BUILD_REFIT); /* builds */
    for (int r = 0; r < b->repeats; r++) {
        move(g, still, 0.3f * (float)(r + 1));
        double from = wall_seconds();
        if (hydra_scene_move_vertices(scene, mesh, (hydra_view){g->positions, 12, g->vertices}, (hydra_view){NULL, 0, 0}) != HYDRA_OK)
            bench_stop("hydra_scene_move_vertices", hydra_error_text(b->context));
        double seconds = wall_seconds() - from;
        b->ours[BUILD_REFIT][r] = finished(b, scene, seconds + commit(b->context, scene));
        b->peers[BUILD_REFIT][r] = run_theirs(b, BUILD_REFIT);
    }
    hydra_scene_destroy(scene);
    memcpy(g->positions, still, 12 * g->vertices);
    free(still);
}

static build_cost median_cost(const build_cost *costs, int count) {
    double seconds[64], speeds[64];
    for (int i = 0; i < count; i++) seconds[i] = costs[i].seconds, speeds[i] = costs[i].speed;
    return (build_cost){median(seconds, count), costs[0].bytes, median(speeds, count)};
}

static ray_set bounce_rays(const builds *b) {
    ray_set sets[KIND_COUNT], rays;
    hydra_scene *scene = hydra_scene_create(b->context);
    add_mesh(scene, b->g, HYDRA_BUILD_FAST, true);
    commit(b->context, scene);
    ray_sets_make(sets, b->g, scene, 256);
    rays = sets[KIND_BOUNCE1];
    for (int k = 0; k < KIND_COUNT; k++)
        if (k != KIND_BOUNCE1) ray_set_free(&sets[k]);
    hydra_scene_destroy(scene);
    return rays;
}

void bench_builds(hydra_context *context, geometry *g, bool use_peer, int repeats) {
    builds *b = bench_alloc(sizeof *b);
    memset(b, 0, sizeof *b);
    b->context = context, b->g = g, b->repeats = repeats;
    b->theirs = peer_builder_open(use_peer ? g : NULL);
    b->rays = bounce_rays(b);
    time_builds(b);
    time_refits(b);
    memcpy(b->row.scene, g->name, sizeof b->row.scene);
    b->row.triangles = g->triangles;
    for (int j = 0; j < BUILD_JOBS; j++) {
        b->row.ours[j] = median_cost(b->ours[j], repeats);
        b->row.theirs[j] = median_cost(b->peers[j], repeats);
    }
    report_build(&b->row);
    ray_set_free(&b->rays);
    peer_builder_close(b->theirs);
    free(b);
}
