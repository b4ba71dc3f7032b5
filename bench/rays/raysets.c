/* The rays: a camera's, what scatters from their hits, what goes from there to a light, and rays from anywhere. */
#include "rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const kind_names[KIND_COUNT] = {"primary", "bounce1", "bounce2", "shadow", "ao", "random"};

static void set_normalized(float out[3], const float v[3]) {
    double length = sqrt((double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2]);
    for (int i = 0; i < 3; i++) out[i] = (float)(v[i] / length);
}

static void set_cross(float out[3], const float a[3], const float b[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Every second bit of a Morton code. */
static uint32_t even_bits(uint32_t code) {
    code &= 0x55555555u;
    code = (code | (code >> 1)) & 0x33333333u;
    code = (code | (code >> 2)) & 0x0f0f0f0fu;
    code = (code | (code >> 4)) & 0x00ff00ffu;
    return (code | (code >> 8)) & 0x0000ffffu;
}

/* In Morton order: 16 successive rays are a square of 4 x 4 pixels, 64 one of 8 x 8. width is a power of two. */
static void make_primary(ray_set *set, const geometry *g, uint32_t width) {
    float forward[3], right[3], up[3] = {0, 1, 0};
    for (int i = 0; i < 3; i++) forward[i] = g->look[i] - g->eye[i];
    set_normalized(forward, forward);
    if (fabsf(forward[1]) > 0.99f) up[1] = 0, up[2] = 1;
    set_cross(right, forward, up);
    set_normalized(right, right);
    set_cross(up, right, forward);
    const float half = 0.7f; /* tangent of half the angle of view, 70 degrees */
    set->count = (size_t)width * width;
    set->rays = bench_alloc(set->count * sizeof *set->rays);
    for (uint32_t i = 0; i < set->count; i++) {
        float x = half * (2.0f * ((float)even_bits(i) + 0.5f) / (float)width - 1.0f);
        float y = half * (1.0f - 2.0f * ((float)even_bits(i >> 1) + 0.5f) / (float)width);
        hydra_ray *r = &set->rays[i];
        for (int k = 0; k < 3; k++) r->origin[k] = g->eye[k], r->direction[k] = forward[k] + x * right[k] + y * up[k];
        set_normalized(r->direction, r->direction);
        r->t_min = 0.0f, r->t_max = INFINITY;
    }
}

/* Cosine-distributed about n: a point of the unit sphere around its tip. */
static void set_cosine(float out[3], const float n[3], uint32_t seed, uint32_t i) {
    float z = 1.0f - 2.0f * hash_float(seed, 2 * i), phi = 6.2831853f * hash_float(seed, 2 * i + 1);
    float s = sqrtf(fmaxf(0.0f, 1.0f - z * z));
    float v[3] = {n[0] + s * cosf(phi), n[1] + s * sinf(phi), n[2] + z};
    if (fabsf(v[0]) + fabsf(v[1]) + fabsf(v[2]) < 1e-4f) memcpy(v, n, sizeof v);
    set_normalized(out, v);
}

/* The point hit, lifted off its surface on the side the ray came from, and the normal of that side. */
static void hit_point(const hydra_ray *ray, const hydra_hit *hit, float lift, float point[3], float normal[3]) {
    float facing = ray->direction[0] * hit->normal[0] + ray->direction[1] * hit->normal[1] + ray->direction[2] * hit->normal[2];
    for (int k = 0; k < 3; k++) {
        normal[k] = facing > 0.0f ? -hit->normal[k] : hit->normal[k];
        point[k] = ray->origin[k] + hit->t * ray->direction[k] + lift * normal[k];
    }
}

/* One ray of the kind from every hit of the parents, in their order. */
static void make_from_hits(ray_set *set, const ray_set *parents, const hydra_hit *hits, const geometry *g) {
    float lift = 2e-5f * geometry_size(g), light_radius = 0.02f * geometry_size(g);
    set->rays = bench_alloc(parents->count * sizeof *set->rays);
    set->count = 0;
    for (uint32_t i = 0; i < parents->count; i++) {
        float normal[3];
        if (hits[i].t < 0.0f) continue;
        hydra_ray *r = &set->rays[set->count++];
        hit_point(&parents->rays[i], &hits[i], lift, r->origin, normal);
        r->t_min = 0.0f, r->t_max = INFINITY;
        if (set->kind == KIND_SHADOW) { /* to a point in a ball; the direction's length is the distance */
            for (int k = 0; k < 3; k++) {
                float off = light_radius * (2.0f * hash_float(11 + (uint32_t)k, i) - 1.0f);
                r->direction[k] = g->light[k] + off - r->origin[k];
            }
            r->t_max = 1.0f;
        } else {
            set_cosine(r->direction, normal, 20 + (uint32_t)set->kind, i);
            if (set->kind == KIND_AO) r->t_max = 0.05f * geometry_size(g);
        }
    }
}

static void make_random(ray_set *set, const geometry *g, size_t count) {
    const float up[3] = {0, 0, 0};
    set->count = count;
    set->rays = bench_alloc(count * sizeof *set->rays);
    for (uint32_t i = 0; i < count; i++) {
        hydra_ray *r = &set->rays[i];
        for (uint32_t k = 0; k < 3; k++) r->origin[k] = g->bounds[0][k] + hash_float(31 + k, i) * (g->bounds[1][k] - g->bounds[0][k]);
        set_cosine(r->direction, up, 40, i); /* about no normal: uniform */
        r->t_min = 0.0f, r->t_max = INFINITY;
    }
}

static hydra_hit *trace_hits(const hydra_scene *scene, const ray_set *set) {
    hydra_hit *hits = bench_alloc(set->count * sizeof *hits);
    if (hydra_scene_closest_hits(scene, set->rays, hits, set->count) != HYDRA_OK)
        bench_stop("hydra_scene_closest_hits", kind_names[set->kind]);
    return hits;
}

void ray_sets_make(ray_set sets[KIND_COUNT], const geometry *g, const hydra_scene *scene, uint32_t width) {
    for (int k = 0; k < KIND_COUNT; k++) sets[k] = (ray_set){.kind = k, .any = k == KIND_SHADOW || k == KIND_AO};
    make_primary(&sets[KIND_PRIMARY], g, width);
    hydra_hit *hits = trace_hits(scene, &sets[KIND_PRIMARY]);
    make_from_hits(&sets[KIND_BOUNCE1], &sets[KIND_PRIMARY], hits, g);
    make_from_hits(&sets[KIND_SHADOW], &sets[KIND_PRIMARY], hits, g);
    make_from_hits(&sets[KIND_AO], &sets[KIND_PRIMARY], hits, g);
    free(hits);
    hits = trace_hits(scene, &sets[KIND_BOUNCE1]);
    make_from_hits(&sets[KIND_BOUNCE2], &sets[KIND_BOUNCE1], hits, g);
    free(hits);
    make_random(&sets[KIND_RANDOM], g, (size_t)width * width);
}

ray_set ray_set_sample(const ray_set *set, size_t count) {
    enum { run = 512 };
    if (count >= set->count) count = set->count;
    ray_set out = {.kind = set->kind, .any = set->any, .rays = bench_alloc(count * sizeof *out.rays), .count = count};
    size_t runs = (count + run - 1) / run;
    for (size_t r = 0; r < runs; r++) {
        size_t first = r * (set->count / runs) / SHARE_STEP * SHARE_STEP, n = count - r * run < run ? count - r * run : run;
        memcpy(out.rays + r * run, set->rays + first, n * sizeof *out.rays);
    }
    return out;
}

void ray_set_free(ray_set *set) {
    free(set->rays);
    set->rays = NULL, set->count = 0;
}
