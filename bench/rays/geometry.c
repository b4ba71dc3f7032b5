/* Triangles: collecting and bounding them. */
#include "rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void *grown(void *memory, size_t count, size_t *room, size_t element) {
    if (count < *room) return memory;
    *room = 2 * count + 1024;
    memory = realloc(memory, *room * element);
    if (!memory) bench_stop("memory", "there is none");
    return memory;
}

uint32_t maker_vertex(maker *m, float x, float y, float z) {
    m->positions = grown(m->positions, m->vertices, &m->vertex_room, 12);
    float *p = m->positions + 3 * m->vertices;
    p[0] = x, p[1] = y, p[2] = z;
    return (uint32_t)m->vertices++;
}

void maker_triangle(maker *m, uint32_t a, uint32_t b, uint32_t c) {
    m->indices = grown(m->indices, m->triangles, &m->triangle_room, 12);
    uint32_t *out = m->indices + 3 * m->triangles++;
    out[0] = a, out[1] = b, out[2] = c;
}

static void set_bounds(geometry *g) {
    for (int k = 0; k < 3; k++) g->bounds[0][k] = INFINITY, g->bounds[1][k] = -INFINITY;
    for (size_t i = 0; i < 3 * g->triangles; i++)
        for (int k = 0; k < 3; k++) {
            float x = g->positions[3 * (size_t)g->indices[i] + (size_t)k];
            g->bounds[0][k] = fminf(g->bounds[0][k], x);
            g->bounds[1][k] = fmaxf(g->bounds[1][k], x);
        }
}

void maker_finish(maker *m, geometry *g) {
    g->vertices = m->vertices, g->triangles = m->triangles;
    g->positions = bench_alloc(12 * m->vertices + 16);
    g->indices = bench_alloc(12 * m->triangles);
    if (m->vertices) memcpy(g->positions, m->positions, 12 * m->vertices);
    memset(g->positions + 3 * m->vertices, 0, 16);
    if (m->triangles) memcpy(g->indices, m->indices, 12 * m->triangles);
    free(m->positions);
    free(m->indices);
    memset(m, 0, sizeof *m);
    set_bounds(g);
}

float geometry_size(const geometry *g) {
    float sum = 0.0f;
    for (int k = 0; k < 3; k++) sum += (g->bounds[1][k] - g->bounds[0][k]) * (g->bounds[1][k] - g->bounds[0][k]);
    return sqrtf(sum);
}

void geometry_free(geometry *g) {
    free(g->positions);
    free(g->indices);
    memset(g, 0, sizeof *g);
}

uint32_t hash_u32(uint32_t seed, uint32_t i) {
    uint32_t x = i * 0x9e3779b9u ^ seed * 0x85ebca6bu;
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    x ^= x >> 16;
    x = (x + seed) * 0xc2b2ae35u;
    return x ^ (x >> 15);
}

float hash_float(uint32_t seed, uint32_t i) { return (float)(hash_u32(seed, i) >> 8) * (1.0f / 16777216.0f); }
