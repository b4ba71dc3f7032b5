/* Speed against accuracy: what a second of path tracing buys, and whether the renderer knows it.

       make bench-trade       about a quarter of an hour       QUICK=1 make bench-trade       under 45 seconds

   For each scene a reference is rendered with another seed; then shorter renders, by samples and by target error, are
   held against it. relMSE = mean over pixels and channels of (a - r)^2 / (r^2 + 0.01), the reference's own noise
   subtracted; cost = relMSE x seconds, constant along an unbiased method's run; it is stated for 512 x 512 pixels and two
   threads, whatever the run used. "claimed" is the error that hydra_status reported, "real" the same figure from the
   reference. Tables are also written to build/bench/trade.csv. */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_PIXELS (256 * 256)

typedef struct bench {
    FILE *csv;
    uint32_t side, reference_samples;
    hydra_context *context;
    float *reference, *image, *sigma;
    bool quick;
} bench;

static void stop(const hydra_context *context, const char *what) {
    fprintf(stderr, "trade: %s: %s\n", what, hydra_error_text(context));
    exit(1);
}

/* ---- scenes */

static void add_quad(hydra_scene *scene, const float corners[4][3], hydra_material material) {
    static const uint32_t indices[6] = { 0, 1, 2, 0, 2, 3 };
    hydra_mesh_desc mesh = { .positions = { corners, 12, 4 }, .indices = { indices, 4, 6 }, .material = material };
    hydra_scene_add_mesh(scene, &mesh);
}

static hydra_material lambert(hydra_scene *scene, float r, float g, float b) {
    return hydra_scene_add_material(scene, &(hydra_material_desc){ .base_color = { r, g, b } });
}

static void add_box_room(hydra_scene *scene) {
    hydra_material white = lambert(scene, 0.73f, 0.73f, 0.73f), red = lambert(scene, 0.63f, 0.065f, 0.05f), green = lambert(scene, 0.14f, 0.45f, 0.091f);
    const float floor[4][3] = { { -1, 0, 1 }, { 1, 0, 1 }, { 1, 0, -1 }, { -1, 0, -1 } }, ceiling[4][3] = { { -1, 2, -1 }, { 1, 2, -1 }, { 1, 2, 1 }, { -1, 2, 1 } };
    const float back[4][3] = { { -1, 0, -1 }, { 1, 0, -1 }, { 1, 2, -1 }, { -1, 2, -1 } };
    const float left[4][3] = { { -1, 0, 1 }, { -1, 0, -1 }, { -1, 2, -1 }, { -1, 2, 1 } }, right[4][3] = { { 1, 0, -1 }, { 1, 0, 1 }, { 1, 2, 1 }, { 1, 2, -1 } };
    add_quad(scene, floor, white);
    add_quad(scene, ceiling, white);
    add_quad(scene, back, white);
    add_quad(scene, left, red);
    add_quad(scene, right, green);
    hydra_scene_add_light(scene, &(hydra_light_desc){ .kind = HYDRA_LIGHT_RECT, .color = { 17, 12, 4 }, .position = { 0, 1.98f, 0 }, .axis_u = { 0.25f, 0, 0 }, .axis_v = { 0, 0, 0.2f } });
}

/* A block standing on the floor, turned about the vertical. */
static void add_block(hydra_scene *scene, float x, float z, float half, float height, float angle) {
    static const uint32_t indices[30] = { 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0, 4, 7, 6, 4, 6, 5 };
    float corners[8][3], c = cosf(angle) * half, s = sinf(angle) * half;
    const float across[4][2] = { { -1, -1 }, { 1, -1 }, { 1, 1 }, { -1, 1 } };
    for (int i = 0; i < 8; i++) {
        const float *a = across[i & 3];
        corners[i][0] = x + c * a[0] - s * a[1];
        corners[i][1] = i < 4 ? 0.0f : height;
        corners[i][2] = z + s * a[0] + c * a[1];
    }
    hydra_mesh_desc mesh = { .positions = { corners, 12, 8 }, .indices = { indices, 4, 30 }, .material = lambert(scene, 0.73f, 0.73f, 0.73f) };
    hydra_scene_add_mesh(scene, &mesh);
}

/* A sphere by longitude and latitude, with its exact normals. */
static void add_sphere(hydra_scene *scene, const float center[3], float radius, hydra_material material) {
    enum { rings = 48, steps = 96 };
    static float positions[(rings + 1) * steps][3], normals[(rings + 1) * steps][3];
    static uint32_t indices[rings * steps * 6];
    size_t count = 0;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t s = 0; s < steps; s++) {
            float v = 3.14159265f * (float)r / rings, u = 6.2831853f * (float)s / steps;
            float *n = normals[r * steps + s], *p = positions[r * steps + s];
            n[0] = sinf(v) * cosf(u), n[1] = cosf(v), n[2] = -sinf(v) * sinf(u);
            for (int i = 0; i < 3; i++) p[i] = center[i] + radius * n[i];
            if (r == rings) continue;
            uint32_t a = r * steps + s, b = r * steps + (s + 1) % steps;
            const uint32_t corner[6] = { a, a + steps, b, b, a + steps, b + steps };
            memcpy(indices + count, corner, sizeof corner);
            count += 6;
        }
    hydra_mesh_desc mesh = { .positions = { positions, 12, (rings + 1) * steps }, .normals = { normals, 12, (rings + 1) * steps },
                             .indices = { indices, 4, count }, .material = material };
    hydra_scene_add_mesh(scene, &mesh);
}

static void diffuse_box(hydra_scene *scene) {
    add_box_room(scene);
    add_block(scene, -0.33f, -0.3f, 0.3f, 1.2f, 0.3f);
    add_block(scene, 0.35f, 0.35f, 0.3f, 0.6f, -0.3f);
}

static void glass_box(hydra_scene *scene) {
    const float left[3] = { -0.42f, 0.4f, -0.25f }, right[3] = { 0.42f, 0.4f, 0.25f };
    add_box_room(scene);
    add_sphere(scene, left, 0.4f, hydra_scene_add_material(scene, &(hydra_material_desc){ .kind = HYDRA_MATERIAL_CONDUCTOR, .base_color = { 0.95f, 0.95f, 0.95f } }));
    add_sphere(scene, right, 0.4f, hydra_scene_add_material(scene, &(hydra_material_desc){ .kind = HYDRA_MATERIAL_DIELECTRIC }));
}

/* White pillars under sun and sky. */
static void courtyard(hydra_scene *scene) {
    hydra_material white = lambert(scene, 0.8f, 0.8f, 0.8f);
    const float floor[4][3] = { { -4, 0, 4 }, { 4, 0, 4 }, { 4, 0, -4 }, { -4, 0, -4 } };
    add_quad(scene, floor, white);
    for (int i = -3; i <= 3; i++)
        for (int j = -3; j <= 1; j++) add_block(scene, (float)i * 0.6f, (float)j * 0.6f, 0.12f, 1.5f + 0.2f * (float)((i * j) % 3), (float)i);
    hydra_scene_set_environment(scene, &(hydra_environment_desc){ .color = { 0.6f, 0.8f, 1.0f } });
    hydra_scene_add_light(scene, &(hydra_light_desc){ .kind = HYDRA_LIGHT_SUN, .unit = HYDRA_UNIT_IRRADIANCE, .color = { 6, 5.6f, 5 }, .direction = { -0.5f, -1, -0.4f }, .angular_radius = 0.0047f });
}

/* ---- measuring */

static hydra_status render(const bench *b, hydra_scene *scene, hydra_render_desc desc, float *image, float *sigma) {
    desc.sensor = (hydra_sensor_desc){ .position = { 0, 1, 3.9f }, .target = { 0, 1, 0 }, .fov_y = 0.66f };
    desc.width = desc.height = b->side;
    desc.max_depth = 8;
    hydra_render *r = hydra_render_create(scene, &desc);
    if (!r) stop(b->context, "hydra_render_create");
    while (hydra_render_step(r) == HYDRA_MORE) continue;
    hydra_render_read(r, HYDRA_RADIANCE, image, 0);
    hydra_render_read(r, HYDRA_ERROR, sigma, 0);
    hydra_status status = hydra_render_status(r);
    hydra_render_destroy(r);
    return status;
}

static double brightness(const float *image, size_t pixels) {
    double sum = 0.0;
    for (size_t i = 0; i < pixels; i++) sum += 0.2126 * image[3 * i] + 0.7152 * image[3 * i + 1] + 0.0722 * image[3 * i + 2];
    return sum / (double)pixels;
}

static double rel_mse(const bench *b, const float *image, const float *noise) {
    size_t count = (size_t)3 * b->side * b->side;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        double r = b->reference[i], d = (double)image[i] - r;
        sum += (d * d - (double)noise[i] * (double)noise[i]) / (r * r + 0.01);
    }
    return sum / (double)count;
}

/* hydra_status.error, from the reference. */
static double real_error(const bench *b, const float *image, const float *noise) {
    size_t pixels = (size_t)b->side * b->side;
    double sum = 0.0, floor = 0.1 * brightness(b->reference, pixels);
    for (size_t i = 0; i < pixels; i++) {
        const float *r = b->reference + 3 * i, *a = image + 3 * i, *n = noise + 3 * i;
        double truth = 0.2126 * r[0] + 0.7152 * r[1] + 0.0722 * r[2], value = 0.2126 * a[0] + 0.7152 * a[1] + 0.0722 * a[2];
        double own = 0.2126 * n[0] + 0.7152 * n[1] + 0.0722 * n[2], scale = truth > floor ? truth : floor;
        sum += ((value - truth) * (value - truth) - own * own) / (scale * scale);
    }
    return sum > 0.0 ? sqrt(sum / (double)pixels) : 0.0;
}

typedef struct result { double cost, claim; } result; /* claim: claimed error over real error */

static result measure(bench *b, hydra_scene *scene, const char *name, const char *how, hydra_render_desc desc, const float *noise) {
    hydra_status s = render(b, scene, desc, b->image, b->sigma);
    double mse = rel_mse(b, b->image, noise), real = real_error(b, b->image, noise);
    double pixels = 512.0 * 512.0 / ((double)b->side * b->side), threads = hydra_context_threads(b->context) / 2.0;
    double cost = mse * s.seconds * pixels * threads;
    double rays = (double)(s.rays_camera + s.rays_bounce + s.rays_shadow) / s.seconds * 1e-6;
    double traced = (double)s.paths / ((double)b->side * b->side); /* those that only judged others included */
    printf("%-12s %-14s %8.1f %8.1f %8.2f %8.2f %10.5f %9.4f %8.2f %8.2f\n", name, how, s.samples, traced, s.seconds, rays, mse, cost, 100.0 * s.error, 100.0 * real);
    fprintf(b->csv, "%s,%s,%g,%g,%g,%g,%g,%g,%g,%g\n", name, how, s.samples, traced, s.seconds, rays, mse, cost, s.error, real);
    return (result){ cost, real > 0.0 ? s.error / real : 1.0 };
}

static result run_scene(bench *b, const char *name, void (*build)(hydra_scene *)) {
    hydra_scene *scene = hydra_scene_create(b->context);
    build(scene);
    if (hydra_scene_commit(scene) != HYDRA_OK) stop(b->context, name);
    static float noise[3 * MAX_PIXELS];
    render(b, scene, (hydra_render_desc){ .max_samples = b->reference_samples, .seed = 77 }, b->reference, noise);
    const uint32_t counts[] = { 16, 64, 256 };
    result runs[3];
    for (int i = 0; i < 3; i++) {
        char how[32];
        snprintf(how, sizeof how, "%u samples", counts[i]);
        runs[i] = measure(b, scene, name, how, (hydra_render_desc){ .max_samples = counts[i] }, noise);
    }
    measure(b, scene, name, "lights only", (hydra_render_desc){ .max_samples = 64, .strategy = HYDRA_STRATEGY_LIGHTS }, noise);
    measure(b, scene, name, "BSDF only", (hydra_render_desc){ .max_samples = 64, .strategy = HYDRA_STRATEGY_BSDF }, noise);
    measure(b, scene, name, "target 10 %", (hydra_render_desc){ .target_error = 0.10f, .max_samples = b->reference_samples }, noise);
    if (!b->quick) measure(b, scene, name, "target 5 %", (hydra_render_desc){ .target_error = 0.05f, .max_samples = b->reference_samples }, noise);
    hydra_scene_destroy(scene);
    return runs[1];
}

static void goal(const char *name, double measured, double target) {
    printf("goal %s %.4g %.4g %s\n", name, measured, target, measured <= target ? "ok" : "short");
}

/* How far a ratio is from 1, whichever way. */
static double either_way(double ratio) { return ratio > 1.0 ? ratio : 1.0 / ratio; }

int main(int argc, char **argv) {
    bool quick = getenv("QUICK") && strcmp(getenv("QUICK"), "0") != 0;
    bench b = { .quick = quick, .side = quick ? 64 : 256, .reference_samples = quick ? 1024 : 2048 };
    b.csv = fopen(argc > 1 ? argv[1] : "build/bench/trade.csv", "w");
    b.context = hydra_create(NULL);
    b.reference = malloc(sizeof(float) * 3 * MAX_PIXELS);
    b.image = malloc(sizeof(float) * 3 * MAX_PIXELS);
    b.sigma = malloc(sizeof(float) * 3 * MAX_PIXELS);
    if (!b.csv || !b.context || !b.reference || !b.image || !b.sigma) return fputs("trade: no memory, or build/bench/trade.csv cannot be written\n", stderr), 1;
    fprintf(b.csv, "scene,run,samples,traced,seconds,mrays_per_second,relmse,cost,claimed,real\n");
    printf("%u x %u pixels, %u threads, at most 8 scatterings, reference of %u samples\n", b.side, b.side, hydra_context_threads(b.context), b.reference_samples);
    printf("%-12s %-14s %8s %8s %8s %8s %10s %9s %8s %8s\n", "scene", "run", "samples", "traced", "seconds", "Mrays/s", "relMSE", "cost", "claim %", "real %");
    result diffuse = run_scene(&b, "box", diffuse_box), glass = run_scene(&b, "glass box", glass_box), open_air = run_scene(&b, "courtyard", courtyard);
    goal("cost-diffuse-box", diffuse.cost, 0.012);
    goal("cost-glass-box", glass.cost, 0.35);
    goal("claimed-error-diffuse-box", either_way(diffuse.claim), 1.2);
    goal("claimed-error-glass-box", either_way(glass.claim), 1.2);
    goal("claimed-error-courtyard", either_way(open_air.claim), 1.2);
    fclose(b.csv);
    hydra_destroy(b.context);
    free(b.reference);
    free(b.image);
    free(b.sigma);
    return 0;
}
