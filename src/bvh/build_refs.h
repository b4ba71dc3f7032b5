/* >>bvh-build-refs: the primitives of a build: boxes and ids, degenerate triangles dropped */
#ifndef HYI_BVH_BUILD_REFS_H
#define HYI_BVH_BUILD_REFS_H

#include "build_vector.h"

/* Work is cut into pieces of this many primitives whatever the number of threads: same pieces, same tree. */
#define HYI_BUILD_CHUNK 4096u

/* A subtree over no more references is one thread's work: small trees are work for many. */
#define HYI_BUILD_TASK 1024u

/* References that spatial splits may add, in percent of the triangles: memory for them is known before the build. */
#define HYI_BUILD_EXTRA_PERCENT 40u

/* A primitive, or with spatial splits the part of one that lies in a cell. Lane 3 of lower holds the id, made
   a float of moderate size so that arithmetic on all lanes never meets a denormal there. */
typedef struct hyi_ref {
    float lower[4], upper[4];
} hyi_ref;
#define HYI_REF_ID_BITS 0x40000000u

/* A node of the binary tree that the wide one is made from. */
typedef struct hyi_build_node {
    float lower[3];
    uint32_t first; /* inner: its left child, the right one follows; leaf: its first reference */
    float upper[3];
    uint32_t count; /* of references; HYI_BUILD_INNER: those it had before it was cut */
} hyi_build_node;
#define HYI_BUILD_INNER 0x80000000u

HYI_INLINE bool hyi_build_is_leaf(const hyi_build_node *node) { return (node->count & HYI_BUILD_INNER) == 0u; }

/* What one chunk of the source has. */
typedef struct hyi_chunk_sum {
    hyi_bounds box, centroids;
    uint32_t kept, first;
} hyi_chunk_sum;

/* A piece of the curve of a quick build: so many triangles become units, and these clusters. */
typedef struct hyi_piece {
    hyi_bounds centroids; /* of the clusters */
    hyi_ref *unit;
    uint32_t units, clusters, first_pair, first_ref;
} hyi_piece;
#define HYI_PIECE 1024u
#define HYI_PIECE_UNITS 576u /* places for the units of a piece: more than most have; those with more get others */

typedef struct hyi_build {
    hydra_context *context;
    const float *positions;   /* triangles */
    const uint32_t *indices;
    const hyi_box *boxes;     /* or boxes */
    uint32_t source_count, ref_count;
    uint32_t capacity;        /* places for references: ref_count and what spatial splits may add */
    uint32_t primitive_count; /* in units: triangles; references are to clusters of units then */
    uint32_t leaf_max;        /* primitives in a leaf */
    uint32_t range_max;       /* references in a range that no cut divides */
    bool in_units;            /* a quick build: see bvh-build-units and bvh-build-cluster */
    uint32_t *order;          /* in units: ids by place */
    uint64_t *keys;           /* in units: codes and references; then what clusters are made of */
    hyi_piece *pieces;
    uint32_t piece_count, unit_count;
    hyi_ref *units;           /* in units: HYI_PIECE_UNITS places for each piece */
    hyi_ref *crowd;           /* for pieces with more */
    size_t crowd_count;
    hyi_ref *spare;           /* for units and keys of few triangles */
    size_t spare_count;
    hyi_ref *block;           /* refs, and in quick builds order before them and room behind */
    size_t room;              /* its places */
    bool nodes_in_room;       /* nodes, costs and parents lie there as well */
    bool other_in_room;
    bool best;                /* spatial splits, and reinsertion */
    float scale;
    hyi_ref *refs, *other;    /* other: where ranges are partitioned to */
    hyi_build_node *nodes;
    uint32_t node_capacity;
    struct hyi_cost *costs;   /* of subtrees, by pairs of nodes */
    union hyi_place_costs *places; /* the same; of builds that are not quick, in places of other that ranges have done with */
    uint32_t *parents;        /* by pairs of nodes; NULL: nobody asks */
    hyi_chunk_sum *chunks;
    uint32_t chunk_count;
    struct hyi_chunk_split *chunk_splits;
    uint32_t chunk_split_count;
    struct hyi_range *tasks;  /* small ranges, a subtree each */
    uint32_t task_count, task_capacity;
    struct hyi_wide_task *wide_tasks;
    uint32_t wide_task_count, wide_task_capacity;
    hyi_bounds root_box, root_centroids;
    float root_area;
    float cost;               /* of the tree that was made: see hyi_bvh_cost */
    hyi_bvh *bvh;
} hyi_build;

HYI_INLINE uint32_t hyi_ref_id(const hyi_ref *ref) {
    uint32_t bits;
    memcpy(&bits, &ref->lower[3], sizeof bits);
    return bits & ~HYI_REF_ID_BITS;
}

/* Lane 3 of a box is not its own: the id is set anew. */
HYI_INLINE void hyi_ref_set(hyi_ref *ref, const hyi_bounds *box, uint32_t id) {
    uint32_t bits = id | HYI_REF_ID_BITS;
    hyi_four_store(ref->lower, box->lower);
    hyi_four_store(ref->upper, box->upper);
    memcpy(&ref->lower[3], &bits, sizeof bits);
    ref->upper[3] = 0.0f;
}

HYI_INLINE hyi_bounds hyi_ref_box(const hyi_ref *ref) {
    hyi_bounds box;
    box.lower = hyi_four_load(ref->lower);
    box.upper = hyi_four_load(ref->upper);
    return box;
}

/* Twice the middle. */
HYI_INLINE hyi_four hyi_centroid(const hyi_bounds *box) { return hyi_four_rounded(hyi_four_add(box->lower, box->upper)); }

/* Whether the triangle spans no area: equal corners or a cross product of zero. Differences of floats of
   similar size are exact in double, and so are their products up to the last bits. */
HYI_INLINE bool hyi_triangle_is_degenerate(const float *a, const float *b, const float *c) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
    }
    return e[1] * f[2] == e[2] * f[1] && e[2] * f[0] == e[0] * f[2] && e[0] * f[1] == e[1] * f[0];
}

/* hyi_triangle_is_degenerate, answered in float where float is sure: each part of the cross product, p - q, is off by a
   few 2^-24 of |p| + |q|, unless that is next to underflow; overflow makes no comparison true. */
HYI_INLINE bool hyi_four_is_flat(hyi_four a, hyi_four b, hyi_four c, const float *pa, const float *pb, const float *pc) {
    hyi_four e = hyi_four_sub(b, a), f = hyi_four_sub(c, a);
    hyi_four p = hyi_four_mul(hyi_four_turn(e), hyi_four_turn(hyi_four_turn(f))), q = hyi_four_mul(hyi_four_turn(hyi_four_turn(e)), hyi_four_turn(f));
    hyi_four size = hyi_four_add(hyi_four_abs(p), hyi_four_abs(q));
    hyi_four doubt = hyi_four_add(hyi_four_mul(size, hyi_four_all(9.5367431640625e-07f)), hyi_four_all(7.52316384526264e-37f));
    return !hyi_four_exceeds(hyi_four_abs(hyi_four_sub(p, q)), doubt) && hyi_triangle_is_degenerate(pa, pb, pc);
}

/* Bits of those of four triangles, as rows of x, y and z by corner, of which hyi_four_is_flat would ask for more than floats. */
HYI_INLINE uint32_t hyi_four_maybe_flat(hyi_four a[4], hyi_four b[4], hyi_four c[4]) {
    const hyi_four share = hyi_four_all(9.5367431640625e-07f), least = hyi_four_all(7.52316384526264e-37f);
    hyi_four e[3], f[3];
    uint32_t sure = 0;
    for (int i = 0; i < 3; i++) {
        e[i] = hyi_four_sub(b[i], a[i]);
        f[i] = hyi_four_sub(c[i], a[i]);
    }
    for (int i = 0; i < 3; i++) {
        int next = i == 2 ? 0 : i + 1, last = i == 0 ? 2 : i - 1;
        hyi_four p = hyi_four_mul(e[next], f[last]), q = hyi_four_mul(e[last], f[next]);
        hyi_four size = hyi_four_add(hyi_four_abs(p), hyi_four_abs(q));
        sure |= hyi_four_greater(hyi_four_abs(hyi_four_sub(p, q)), hyi_four_add(hyi_four_mul(size, share), least));
    }
    return ~sure & 15u;
}

/* Corner of triangle id of the source. */
HYI_INLINE const float *hyi_source_corner(const hyi_build *build, uint32_t id, uint32_t corner) {
    return build->positions + 3u * (size_t)build->indices[3u * (size_t)id + corner];
}

/* Box of primitive i of the source; false: drop it. */
HYI_INLINE bool hyi_source_box(const hyi_build *build, uint32_t i, hyi_bounds *box) {
    if (build->boxes) {
        *box = hyi_bounds_load(build->boxes[i].lower, build->boxes[i].upper);
        return true;
    }
    const float *a = hyi_source_corner(build, i, 0), *b = hyi_source_corner(build, i, 1), *c = hyi_source_corner(build, i, 2);
    hyi_four p = hyi_four_load3(a), q = hyi_four_load3(b), r = hyi_four_load3(c);
    box->lower = hyi_four_min(hyi_four_min(p, q), r);
    box->upper = hyi_four_max(hyi_four_max(p, q), r);
    return !hyi_four_is_flat(p, q, r, a, b, c);
}

/* ---- triangles of leaves, four side by side */

/* By corner: of four triangles in turn, and after hyi_turn_triangles rows of x, y and z; and the last corners as they were. */
typedef struct hyi_four_triangles {
    hyi_four corner[3][4], third[4];
} hyi_four_triangles;

/* Of fewer than four the last stands for those that are not there. */
HYI_INLINE void hyi_load_triangles(const float *positions, const uint32_t *indices, const uint32_t *ids, uint32_t count, hyi_four_triangles *lanes) {
    for (uint32_t lane = 0; lane < 4; lane++) {
        const uint32_t *index = indices + 3u * (size_t)ids[lane < count ? lane : count - 1u];
        for (uint32_t c = 0; c < 3; c++) lanes->corner[c][lane] = hyi_four_load3(positions + 3u * (size_t)index[c]);
        lanes->third[lane] = lanes->corner[2][lane];
    }
}

HYI_INLINE void hyi_turn_triangles(hyi_four_triangles *lanes) {
    for (uint32_t c = 0; c < 3; c++) hyi_four_transpose(lanes->corner[c]);
}

/* rows: of the first lane; stride: triangles of the leaf, which are four or more, or all there. Then rows reach into the next
   ones, which come later, but for the last three. */
HYI_INLINE void hyi_store_triangles(const hyi_four_triangles *lanes, uint32_t count, hyi_four scale, float *rows, uint32_t stride) {
    for (uint32_t r = 0; r < 6; r++) hyi_four_store(rows + r * stride, hyi_four_mul(lanes->corner[r / 3u][r % 3u], scale));
    if (count == 4u) {
        for (uint32_t r = 0; r < 3; r++) hyi_four_store(rows + (6u + r) * stride, hyi_four_mul(lanes->corner[2][r], scale));
    } else {
        for (uint32_t k = 0; k < count; k++) hyi_four_scatter(hyi_four_mul(lanes->third[k], scale), rows + 6u * stride + k, stride);
    }
}

/* Triangles lie anywhere: those in slots behind a leaf's, which are written after it, are asked for, and where their rows go.
   end: slots from there on are another's, or not there. */
#define HYI_ASK_AHEAD 40u
#define HYI_SOURCE_LARGE 32768u /* the cache has fewer triangles than that: they need not be asked for */
HYI_INLINE void hyi_ask_for_slots(const hyi_bvh *bvh, const float *positions, const uint32_t *indices, uint32_t first, uint32_t count, uint32_t end) {
    const uint32_t last = end - 1u;
    for (uint32_t s = first + HYI_ASK_AHEAD; s < first + HYI_ASK_AHEAD + count; s++) {
        const uint32_t soon = s < last ? s : last, later = s + HYI_ASK_AHEAD < last ? s + HYI_ASK_AHEAD : last;
        const uint32_t *index = indices + 3u * (size_t)bvh->ids[soon];
        hyi_prefetch(hyi_leaf_lane(bvh, soon, 0));
        hyi_prefetch(indices + 3u * (size_t)bvh->ids[later]);
        for (uint32_t c = 0; c < 3; c++) hyi_prefetch(positions + 3u * (size_t)index[c]);
    }
}

/* ---- references */

HYI_INLINE uint32_t hyi_chunks_of(uint32_t count) { return count / HYI_BUILD_CHUNK + (count % HYI_BUILD_CHUNK != 0u); }

HYI_INLINE uint32_t hyi_chunk_end(uint32_t chunk, uint32_t count) {
    uint32_t left = count - chunk * HYI_BUILD_CHUNK;
    return chunk * HYI_BUILD_CHUNK + (left < HYI_BUILD_CHUNK ? left : HYI_BUILD_CHUNK);
}

/* Writes the references of a chunk from its place on, in the source's order, scaled. */
HYI_FN void hyi_fill_chunk(void *argument, uint32_t chunk) {
    hyi_build *build = (hyi_build *)argument;
    hyi_chunk_sum sum;
    sum.box = sum.centroids = hyi_bounds_empty();
    sum.first = build->chunks[chunk].first;
    sum.kept = 0;
    hyi_ref *out = build->refs + sum.first;
    hyi_four scale = hyi_four_all(build->scale);
    uint32_t end = hyi_chunk_end(chunk, build->source_count);
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_bounds box;
        if (!hyi_source_box(build, i, &box)) continue;
        box.lower = hyi_four_mul(box.lower, scale);
        box.upper = hyi_four_mul(box.upper, scale);
        hyi_bounds_add(&sum.box, box.lower, box.upper);
        hyi_four centroid = hyi_centroid(&box);
        hyi_bounds_add(&sum.centroids, centroid, centroid);
        hyi_ref_set(out + sum.kept, &box, i);
        sum.kept++;
    }
    build->chunks[chunk] = sum;
}

/* The power of two that brings the largest coordinate to about 1, or 1 where it is within 2^20 of that. */
HYI_FN float hyi_build_scale(const hyi_box *box) {
    float largest = hyi_box_largest(box);
    int exponent = 0;
    (void)frexpf(largest, &exponent);
    if (largest <= 0.0f || (exponent >= -20 && exponent <= 20)) return 1.0f;
    return ldexpf(1.0f, exponent < -126 ? 126 : -exponent);
}

/* Each chunk where its part of the source is. */
HYI_FN void hyi_spread_chunks(hyi_build *build) {
    for (uint32_t c = 0; c < build->chunk_count; c++) build->chunks[c].first = c * HYI_BUILD_CHUNK;
}

/* Adds up the chunks: what is kept, the bounds, and where each chunk would begin without gaps. */
HYI_FN void hyi_sum_chunks(hyi_build *build) {
    build->ref_count = 0;
    build->root_box = build->root_centroids = hyi_bounds_empty();
    for (uint32_t c = 0; c < build->chunk_count; c++) {
        hyi_chunk_sum *chunk = &build->chunks[c];
        hyi_bounds_add(&build->root_box, chunk->box.lower, chunk->box.upper);
        hyi_bounds_add(&build->root_centroids, chunk->centroids.lower, chunk->centroids.upper);
        chunk->first = build->ref_count;
        build->ref_count += chunk->kept;
    }
    build->root_area = hyi_bounds_area(&build->root_box);
}

/* How keys are sorted: the more of them, the wider the digits. A thread has a few pieces: each has counts of its own. */
typedef struct hyi_sort_shape {
    uint32_t digit_bits, digits, passes, pieces;
} hyi_sort_shape;
#define HYI_CODE_BITS 32u
#define HYI_SORT_WIDE 8192u
#define HYI_SORT_LARGE 32768u /* with fewer keys, threads wait for each other longer than they work */
#define HYI_SORT_PIECES 64u /* at most */

HYI_FN hyi_sort_shape hyi_shape_of_sort(const hyi_build *build) {
    hyi_sort_shape shape;
    uint32_t most = build->source_count < HYI_SORT_LARGE ? 1u : 2u * build->context->threads;
    shape.digit_bits = build->source_count < HYI_SORT_WIDE ? 8u : 11u;
    shape.digits = 1u << shape.digit_bits;
    shape.passes = (HYI_CODE_BITS + shape.digit_bits - 1u) / shape.digit_bits;
    most = most < HYI_SORT_PIECES ? most : HYI_SORT_PIECES;
    shape.pieces = build->chunk_count < most ? build->chunk_count : most;
    if (shape.pieces == 0) shape.pieces = 1;
    return shape;
}

/* The C library gives large blocks back to the system unless they come again and again, and fresh pages take up to a third of
   the time of a quick build. So it works in what is done with: nodes take the place of the references, and costs and parents
   come behind them, in pages that stay untouched where there are few units; and before there are rows, the tree's own memory
   for these has first the keys, with the second array that they are sorted into and the counts of the sort, and then keys and
   units. Few triangles have too few rows for that. */
#define HYI_NODE_BYTES 66u /* for each triangle: nodes, costs and parents where there are nine units for sixteen triangles */

/* In places for references; even ones are those of cache lines. */
HYI_INLINE size_t hyi_room_for(size_t bytes) { return (bytes + 2u * sizeof(hyi_ref) - 1u) / (2u * sizeof(hyi_ref)) * 2u; }

HYI_INLINE uint32_t hyi_pieces_of(uint32_t count) { return count / HYI_PIECE + (count % HYI_PIECE != 0u); }

HYI_INLINE size_t hyi_order_places(uint32_t count) { return ((size_t)count + 2u * HYI_LEAF_MAX - 1u) / HYI_LEAF_MAX * HYI_LEAF_MAX; }

/* Order, and behind it references. */
HYI_FN hydra_result hyi_place_quick_refs(hyi_build *build) {
    size_t order = hyi_room_for(hyi_order_places(build->source_count) * sizeof *build->order);
    build->room = order + hyi_room_for((size_t)build->source_count * HYI_NODE_BYTES);
    HYI_TRY(hyi_alloc_array(build->context, &build->block, build->room));
    build->order = (uint32_t *)(void *)build->block;
    build->refs = build->block + order;
    return HYDRA_OK;
}

/* Rows for as many slots as there are triangles, and in them units and keys. */
HYI_FN hydra_result hyi_place_rows(hyi_build *build) {
    hyi_sort_shape shape = hyi_shape_of_sort(build);
    size_t floats = hyi_bvh_row_floats(build->ref_count), keys = build->ref_count * sizeof *build->keys;
    size_t sorting = keys + (size_t)shape.pieces * shape.digits * sizeof(uint32_t);
    size_t units = (size_t)hyi_pieces_of(build->ref_count) * HYI_PIECE_UNITS * sizeof(hyi_ref);
    size_t first = hyi_room_for(units > sorting ? units : sorting), all = first + hyi_room_for(keys);
    build->bvh->slot_count = build->ref_count;
    HYI_TRY(hyi_alloc_array(build->context, &build->bvh->rows, floats));
    build->units = (hyi_ref *)(void *)build->bvh->rows;
    if (all * sizeof(hyi_ref) > floats * sizeof(float)) {
        HYI_TRY(hyi_alloc_array(build->context, &build->spare, all));
        build->spare_count = all;
        build->units = build->spare;
    }
    build->keys = (uint64_t *)(void *)(build->units + first);
    return HYDRA_OK;
}

/* Allocates and fills the references, sets the bounds and the scale, and counts what is kept. Unscaled and without
   gaps, as references nearly always are, one pass does. In quick builds gaps stay: references are about to be sorted. */
HYI_FN hydra_result hyi_build_refs(hyi_build *build) {
    uint32_t room = HYI_PRIMITIVES_MAX - build->source_count; /* slots have as many bits */
    uint32_t extra = build->best ? (uint32_t)((uint64_t)build->source_count * HYI_BUILD_EXTRA_PERCENT / 100u) : 0u;
    build->chunk_count = hyi_chunks_of(build->source_count);
    build->capacity = build->source_count + (extra < room ? extra : room);
    build->scale = 1.0f;
    HYI_TRY(hyi_alloc_array(build->context, &build->chunks, build->chunk_count));
    if (build->in_units) {
        HYI_TRY(hyi_place_quick_refs(build));
    } else {
        build->room = build->capacity;
        HYI_TRY(hyi_alloc_array(build->context, &build->block, build->room));
        build->refs = build->block;
    }
    hyi_spread_chunks(build);
    hyi_parallel(build->context, build->chunk_count, hyi_fill_chunk, build);
    hyi_sum_chunks(build);
    build->bvh->degenerate = build->source_count - build->ref_count;
    build->bvh->primitive_count = build->ref_count;
    if (build->ref_count == 0) return HYDRA_OK;
    hyi_bounds_store(&build->root_box, build->bvh->bounds.lower, build->bvh->bounds.upper);
    build->scale = hyi_build_scale(&build->bvh->bounds);
    if ((build->in_units || build->ref_count == build->source_count) && build->scale == 1.0f) return HYDRA_OK;
    if (build->in_units) hyi_spread_chunks(build);
    hyi_parallel(build->context, build->chunk_count, hyi_fill_chunk, build);
    hyi_sum_chunks(build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_REFS_H */
