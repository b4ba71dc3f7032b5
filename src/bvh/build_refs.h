/* >>bvh-build-refs: the primitives of a build: bounds and ids, degenerate triangles dropped */
#ifndef HYI_BVH_BUILD_REFS_H
#define HYI_BVH_BUILD_REFS_H

#include "layout.h"

/* Work is cut into pieces of this many primitives whatever the number of threads: same pieces, same tree. */
#define HYI_BUILD_CHUNK 8192u

typedef struct hyi_ref {
    float lower[3];
    uint32_t id;
    float upper[3];
    uint32_t unused;
} hyi_ref;

/* A node of the binary tree that the wide one is made from. The two children of a node whose range is
   cut at slot m are nodes 2 (m - 1) and 2 (m - 1) + 1: no two cuts share an m, so places need no counter
   and come out the same on any thread. */
typedef struct hyi_build_node {
    hyi_box box;
    uint32_t first, count;
    uint32_t left; /* HYI_CHILD_NONE: a leaf */
} hyi_build_node;

/* Bounds and number of the primitives in one chunk. */
typedef struct hyi_chunk_sum {
    hyi_box box;
    uint32_t kept, first;
} hyi_chunk_sum;

typedef struct hyi_build {
    hydra_context *context;
    const float *positions;   /* triangles */
    const uint32_t *indices;
    const hyi_box *boxes;     /* or boxes */
    uint32_t source_count, ref_count;
    uint32_t leaf_max;
    float scale;
    hyi_ref *refs, *other;    /* other: where large ranges are partitioned to */
    hyi_build_node *nodes;
    uint32_t node_capacity;
    hyi_chunk_sum *chunks;
    uint32_t chunk_count;
    struct hyi_chunk_split *chunk_splits;
    struct hyi_range *tasks; /* small ranges, a subtree each */
    uint32_t task_count, task_capacity;
    hyi_bvh *bvh;
} hyi_build;

/* Whether the triangle spans no area: equal corners or a cross product of zero. Differences of floats of
   similar size are exact in double, and so are their products up to the last bits. */
HYI_FN bool hyi_triangle_is_degenerate(const float *a, const float *b, const float *c) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
    }
    return e[1] * f[2] == e[2] * f[1] && e[2] * f[0] == e[0] * f[2] && e[0] * f[1] == e[1] * f[0];
}

/* Bounds of primitive i of the source; false: drop it. */
HYI_INLINE bool hyi_source_box(const hyi_build *build, uint32_t i, hyi_box *box) {
    if (build->boxes) {
        *box = build->boxes[i];
        return true;
    }
    const uint32_t *index = build->indices + 3u * (size_t)i;
    const float *a = build->positions + 3u * (size_t)index[0];
    const float *b = build->positions + 3u * (size_t)index[1];
    const float *c = build->positions + 3u * (size_t)index[2];
    *box = hyi_box_empty();
    hyi_box_add(box, a, a);
    hyi_box_add(box, b, b);
    hyi_box_add(box, c, c);
    return !hyi_triangle_is_degenerate(a, b, c);
}

HYI_INLINE uint32_t hyi_chunk_end(uint32_t chunk, uint32_t count) {
    uint32_t left = count - chunk * HYI_BUILD_CHUNK;
    return chunk * HYI_BUILD_CHUNK + (left < HYI_BUILD_CHUNK ? left : HYI_BUILD_CHUNK);
}

HYI_FN void hyi_sum_chunk(void *argument, uint32_t chunk) {
    hyi_build *build = (hyi_build *)argument;
    hyi_chunk_sum sum;
    sum.box = hyi_box_empty();
    sum.kept = sum.first = 0;
    uint32_t end = hyi_chunk_end(chunk, build->source_count);
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_box box;
        if (!hyi_source_box(build, i, &box)) continue;
        hyi_box_add(&sum.box, box.lower, box.upper);
        sum.kept++;
    }
    build->chunks[chunk] = sum;
}

HYI_FN void hyi_fill_chunk(void *argument, uint32_t chunk) {
    hyi_build *build = (hyi_build *)argument;
    hyi_ref *out = build->refs + build->chunks[chunk].first;
    uint32_t end = hyi_chunk_end(chunk, build->source_count);
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_box box;
        if (!hyi_source_box(build, i, &box)) continue;
        for (int a = 0; a < 3; a++) {
            out->lower[a] = box.lower[a] * build->scale;
            out->upper[a] = box.upper[a] * build->scale;
        }
        out->id = i;
        out->unused = 0;
        out++;
    }
}

/* The power of two that brings the largest coordinate to about 1, or 1 where it is within 2^20 of that. */
HYI_FN float hyi_build_scale(const hyi_box *box) {
    float largest = 0.0f;
    for (int a = 0; a < 3; a++) {
        largest = fabsf(box->lower[a]) > largest ? fabsf(box->lower[a]) : largest;
        largest = fabsf(box->upper[a]) > largest ? fabsf(box->upper[a]) : largest;
    }
    int exponent = 0;
    (void)frexpf(largest, &exponent);
    if (largest <= 0.0f || (exponent >= -20 && exponent <= 20)) return 1.0f;
    return ldexpf(1.0f, exponent < -126 ? 126 : -exponent);
}

/* Counts what is kept, sets the bounds and the scale, and fills the references in the source's order. */
HYI_FN hydra_result hyi_build_refs(hyi_build *build) {
    build->chunk_count = build->source_count / HYI_BUILD_CHUNK + (build->source_count % HYI_BUILD_CHUNK != 0u);
    HYI_TRY(hyi_alloc_array(build->context, &build->chunks, build->chunk_count));
    hyi_parallel(build->context, build->chunk_count, hyi_sum_chunk, build);
    hyi_box box = hyi_box_empty();
    for (uint32_t c = 0; c < build->chunk_count; c++) {
        build->chunks[c].first = build->ref_count;
        build->ref_count += build->chunks[c].kept;
        hyi_box_add(&box, build->chunks[c].box.lower, build->chunks[c].box.upper);
    }
    build->bvh->degenerate = build->source_count - build->ref_count;
    build->bvh->primitive_count = build->ref_count;
    if (build->ref_count == 0) return HYDRA_OK;
    build->bvh->bounds = box;
    build->scale = hyi_build_scale(&box);
    HYI_TRY(hyi_alloc_array(build->context, &build->refs, build->ref_count));
    hyi_parallel(build->context, build->chunk_count, hyi_fill_chunk, build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_REFS_H */
