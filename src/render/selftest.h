/* >>selftest: known answers, asked on the user's own machine through the public calls */
#ifndef HYI_SELFTEST_H
#define HYI_SELFTEST_H

#include "estimate.h"
#include "read.h"
#include "share.h"

typedef struct hyi_selftest {
    hydra_context *context;
    hydra_scene *scene;
    hydra_render *render;
} hyi_selftest;

HYI_FN hydra_result hyi_selftest_wrong(hyi_selftest *t, const char *what, double found, double truth) {
    return hyi_fail(t->context, HYDRA_ERROR_SELFTEST, "%s is %.9g, the truth is %.9g", what, found, truth);
}

HYI_FN hydra_result hyi_selftest_error(hyi_selftest *t, const char *what) {
    char reason[sizeof t->context->error];
    memcpy(reason, t->context->error, sizeof reason);
    return hyi_fail(t->context, HYDRA_ERROR_SELFTEST, "%s could not run (%.300s)", what, reason);
}

/* A sphere of 20 x 4^levels triangles is not needed here: a lattice of longitudes and latitudes, closed and without
   T-junctions. positions: 3 (n (n/2 - 1) + 2) floats; indices: 6 n (n/2 - 1) words. */
#define HYI_SELFTEST_N 32u
#define HYI_SELFTEST_VERTICES (HYI_SELFTEST_N * (HYI_SELFTEST_N / 2 - 1) + 2)
#define HYI_SELFTEST_CORNERS (6 * HYI_SELFTEST_N * (HYI_SELFTEST_N / 2 - 1))

typedef struct hyi_selftest_ball {
    float positions[3 * HYI_SELFTEST_VERTICES];
    uint32_t indices[HYI_SELFTEST_CORNERS];
} hyi_selftest_ball;

HYI_FN void hyi_selftest_vertex(float *p, double latitude, double longitude) {
    p[0] = (float)(cos(latitude) * cos(longitude));
    p[1] = (float)sin(latitude);
    p[2] = (float)(cos(latitude) * sin(longitude));
}

HYI_FN uint32_t hyi_selftest_ring(uint32_t ring, uint32_t step) {
    const uint32_t rings = HYI_SELFTEST_N / 2 - 1;
    if (ring == 0) return HYI_SELFTEST_VERTICES - 2;
    if (ring > rings) return HYI_SELFTEST_VERTICES - 1;
    return (ring - 1) * HYI_SELFTEST_N + step % HYI_SELFTEST_N;
}

/* Front faces look outwards. */
HYI_FN void hyi_selftest_make_ball(hyi_selftest_ball *ball) {
    const uint32_t n = HYI_SELFTEST_N, rings = n / 2 - 1;
    for (uint32_t r = 1; r <= rings; r++)
        for (uint32_t s = 0; s < n; s++)
            hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(r, s), HYI_PI * ((double)r / (double)(rings + 1) - 0.5), 2.0 * HYI_PI * (double)s / (double)n);
    hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(0, 0), -0.5 * HYI_PI, 0.0);
    hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(rings + 1, 0), 0.5 * HYI_PI, 0.0);
    uint32_t *at = ball->indices;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t s = 0; s < n; s++) {
            const uint32_t a = hyi_selftest_ring(r, s), b = hyi_selftest_ring(r, s + 1), c = hyi_selftest_ring(r + 1, s), d = hyi_selftest_ring(r + 1, s + 1);
            if (r < rings) *at++ = a, *at++ = c, *at++ = d;
            if (r > 0) *at++ = a, *at++ = d, *at++ = b;
        }
}

HYI_FN hydra_result hyi_selftest_commit_ball(hyi_selftest *t, const hydra_material_desc *material) {
    hyi_selftest_ball *ball;
    HYI_TRY(hyi_alloc_array(t->context, &ball, 1));
    hyi_selftest_make_ball(ball);
    hydra_mesh_desc mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.positions.data = ball->positions;
    mesh.positions.count = HYI_SELFTEST_VERTICES;
    mesh.indices.data = ball->indices;
    mesh.indices.count = HYI_SELFTEST_CORNERS;
    mesh.material = hydra_scene_add_material(t->scene, material);
    hydra_scene_add_mesh(t->scene, &mesh);
    hydra_result result = hydra_scene_commit(t->scene);
    hyi_free_array(t->context, &ball, 1);
    return result;
}

HYI_FN hydra_result hyi_selftest_finish(hyi_selftest *t, const hydra_render_desc *desc) {
    hydra_render_destroy(t->render);
    t->render = hydra_render_create(t->scene, desc);
    if (!t->render) return HYDRA_ERROR_SELFTEST;
    hydra_result result;
    do result = hydra_render_step(t->render);
    while (result == HYDRA_MORE);
    return result;
}

/* Mean of all pixels' channels; the images here are 8x8. */
HYI_FN double hyi_selftest_mean(hyi_selftest *t) {
    float pixels[3 * 64];
    double sum = 0.0;
    if (hydra_render_read(t->render, HYDRA_RADIANCE, pixels, 0) != HYDRA_OK) return -1.0;
    for (int i = 0; i < 3 * 64; i++) sum += (double)pixels[i];
    return sum / (3.0 * 64.0);
}

HYI_FN hydra_render_desc hyi_selftest_frame(uint32_t samples) {
    hydra_render_desc d;
    memset(&d, 0, sizeof d);
    d.width = d.height = 8;
    d.max_samples = samples;
    return d;
}

/* Inside a closed body of albedo 1/2 that emits 1/2, radiance is 1 in every direction. */
HYI_FN hydra_result hyi_selftest_furnace(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    for (int i = 0; i < 3; i++) m.base_color[i] = m.emission[i] = 0.5f;
    m.emit_both_sides = true;
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "the furnace");
    hydra_render_desc d = hyi_selftest_frame(256);
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, "the furnace");
    double mean = hyi_selftest_mean(t);
    return fabs(mean - 1.0) < 0.02 ? HYDRA_OK : hyi_selftest_wrong(t, "radiance in the furnace", mean, 1.0);
}

/* A lossless body under a sky of 1 is invisible: every sampling routine and density of its BSDF has a part in that. */
HYI_FN hydra_result hyi_selftest_white(hyi_selftest *t, hydra_material_kind kind, float roughness, const char *name) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    m.kind = kind;
    m.roughness = roughness;
    for (int i = 0; i < 3; i++) m.base_color[i] = 1.0f;
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int i = 0; i < 3; i++) sky.color[i] = 1.0f;
    hydra_scene_set_environment(t->scene, &sky);
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, name);
    hydra_render_desc d = hyi_selftest_frame(256);
    d.sensor.position[2] = 3.0f;
    d.sensor.fov_y = 0.7f;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, name);
    double mean = hyi_selftest_mean(t);
    return fabs(mean - 1.0) < 0.02 ? HYDRA_OK : hyi_selftest_wrong(t, name, mean, 1.0);
}

HYI_FN hydra_result hyi_selftest_lambert(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_LAMBERT, 0.0f, "radiance of a white Lambert body"); }
HYI_FN hydra_result hyi_selftest_mirror(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_CONDUCTOR, 0.0f, "radiance of a mirror"); }
HYI_FN hydra_result hyi_selftest_metal(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_CONDUCTOR, 0.8f, "radiance of a rough metal"); }
HYI_FN hydra_result hyi_selftest_glass(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_DIELECTRIC, 0.0f, "radiance of glass"); }
HYI_FN hydra_result hyi_selftest_frosted(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_DIELECTRIC, 0.5f, "radiance of frosted glass"); }
HYI_FN hydra_result hyi_selftest_layered(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_METALLIC_ROUGHNESS, 0.4f, "radiance of a white coated body"); }

/* Under half a sky of radiance 1 a point receives E = pi. */
HYI_FN hydra_result hyi_selftest_irradiance(hyi_selftest *t) {
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int i = 0; i < 3; i++) sky.color[i] = 1.0f;
    hydra_scene_set_environment(t->scene, &sky);
    if (hydra_scene_commit(t->scene) != HYDRA_OK) return hyi_selftest_error(t, "E = pi L");
    float positions[3 * 64], normals[3 * 64];
    memset(positions, 0, sizeof positions);
    for (int i = 0; i < 3 * 64; i++) normals[i] = i % 3 == 1 ? 1.0f : 0.0f;
    hydra_render_desc d = hyi_selftest_frame(64);
    d.sensor.kind = HYDRA_SENSOR_POINTS;
    d.sensor.point_positions.data = positions;
    d.sensor.point_normals.data = normals;
    d.sensor.point_positions.count = d.sensor.point_normals.count = 64;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, "E = pi L");
    double mean = hyi_selftest_mean(t);
    return fabs(mean - HYI_PI) < 0.01 ? HYDRA_OK : hyi_selftest_wrong(t, "irradiance under the sky", mean, HYI_PI);
}

/* From the centre to each vertex and the middle of each edge: every ray must meet the sphere, and the scalar and the
   SIMD traversal must say the same. */
HYI_FN hydra_result hyi_selftest_watertight(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "the watertight sphere");
    const hyi_mesh_slot *mesh = &t->scene->meshes[0];
    hyi_accel scalar = t->scene->accel;
    scalar.isa = HYDRA_ISA_SCALAR;
    for (uint32_t i = 0; i < HYI_SELFTEST_CORNERS; i++) {
        const float *a = mesh->positions + 3 * mesh->indices[i], *b = mesh->positions + 3 * mesh->indices[i - i % 3 + (i + 1) % 3];
        hyk_ray rays[2];
        hyk_hit hits[2], plain[2];
        memset(rays, 0, sizeof rays);
        rays[0].direction = hyk_make3(a[0], a[1], a[2]);
        rays[1].direction = hyk_scale(hyk_add(rays[0].direction, hyk_make3(b[0], b[1], b[2])), 0.5f);
        rays[0].t_max = rays[1].t_max = FLT_MAX;
        hyi_trace_closest(&t->scene->accel, NULL, rays, hits, 2);
        hyi_trace_closest(&scalar, NULL, rays, plain, 2);
        for (int k = 0; k < 2; k++) {
            if (hits[k].instance == HYK_NONE) return hyi_selftest_wrong(t, "a ray through an edge of the sphere: hits", 0.0, 1.0);
            if (memcmp(&hits[k], &plain[k], sizeof hits[k])) return hyi_selftest_wrong(t, "SIMD traversal: distance", (double)hits[k].t, (double)plain[k].t);
        }
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_selftest_compare_films(hyi_selftest *t, const void *share, size_t size) {
    float whole[3 * 64], merged[3 * 64];
    hydra_render_desc d = hyi_selftest_frame(32);
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_read(t->render, HYDRA_RADIANCE, whole, 0) != HYDRA_OK) return hyi_selftest_error(t, "films");
    d.max_samples = 16;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_merge(t->render, share, size) != HYDRA_OK) return hyi_selftest_error(t, "films");
    hydra_render_read(t->render, HYDRA_RADIANCE, merged, 0);
    return memcmp(whole, merged, sizeof whole) ? hyi_selftest_wrong(t, "a film merged of two: its first value", (double)merged[0], (double)whole[0]) : HYDRA_OK;
}

HYI_FN hydra_result hyi_selftest_films(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    for (int i = 0; i < 3; i++) m.base_color[i] = m.emission[i] = 0.5f;
    m.emit_both_sides = true;
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "films");
    hydra_render_desc d = hyi_selftest_frame(32);
    d.first_sample = 16;
    size_t size;
    void *share;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_save(t->render, NULL, &size) != HYDRA_OK) return hyi_selftest_error(t, "films");
    HYI_TRY(hyi_alloc_bytes(t->context, size, &share));
    hydra_result result = hydra_render_save(t->render, share, &size);
    if (result == HYDRA_OK) result = hyi_selftest_compare_films(t, share, size);
    hyi_free_bytes(t->context, share, size);
    return result;
}

HYI_FN hydra_result hyi_selftest_run(hydra_context *context, hydra_result (*test)(hyi_selftest *)) {
    hyi_selftest t;
    t.context = context;
    t.render = NULL;
    t.scene = hydra_scene_create(context);
    if (!t.scene) return HYDRA_ERROR_OUT_OF_MEMORY;
    hydra_result result = test(&t);
    hydra_render_destroy(t.render);
    hydra_scene_destroy(t.scene);
    return result;
}

HYDRA_API hydra_result hydra_selftest(hydra_context *context) {
    if (!context) return HYDRA_ERROR_NULL;
    hydra_result (*const tests[])(hyi_selftest *) = {
        hyi_selftest_watertight, hyi_selftest_irradiance, hyi_selftest_furnace, hyi_selftest_lambert, hyi_selftest_mirror,
        hyi_selftest_metal,      hyi_selftest_glass,      hyi_selftest_frosted, hyi_selftest_layered, hyi_selftest_films,
    };
    for (size_t i = 0; i < HYI_COUNT(tests); i++) HYI_TRY(hyi_selftest_run(context, tests[i]));
    return HYDRA_OK;
}

#endif /* HYI_SELFTEST_H */
