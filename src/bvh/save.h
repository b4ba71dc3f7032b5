/* >>bvh-save: a tree as bytes, and bytes as a tree again, once everything in them has been checked

   Saved are the nodes, as they lie in memory, and the ids by slot; rows are written from the triangles when a tree is
   adopted, so bytes of others bring no coordinates. Checking is one pass: each node is the child of one node before it and
   no deeper than stacks are, each slot belongs to one leaf, ids are in range, boxes are finite, and what is no child
   cannot be entered. Then no ray can do worse than miss. */
#ifndef HYI_BVH_SAVE_H
#define HYI_BVH_SAVE_H

#include "../../shaders/shared/vector.h"
#include "refit.h"

#define HYI_TREES_MAGIC 0x54524459u /* YDRT; another byte order reads it as something else */
#define HYI_TREES_VERSION 1u        /* counts changes of the format, of nodes and of what they mean */

typedef struct hyi_trees_header {
    uint32_t magic, version;
    uint64_t checksum; /* of all that follows */
    uint64_t size;     /* of everything */
    uint32_t layout, tree_count;
} hyi_trees_header;
#define HYI_TREES_CHECKED_FROM 16u

/* Stands before each tree's nodes and ids. */
typedef struct hyi_tree_record {
    uint64_t fingerprint; /* of what it was built from */
    uint32_t triangle_count, primitive_count, node_count, slot_count, root;
    float scale, cost_when_built;
    uint32_t refitted;
} hyi_tree_record;

HYI_STATIC_ASSERT(sizeof(hyi_trees_header) == 32 && sizeof(hyi_tree_record) == 40);

/* Tells machines and layouts apart whose trees are no use to each other. */
HYI_INLINE uint32_t hyi_trees_layout(void) { return (uint32_t)sizeof(hyi_node) | HYI_WIDTH << 16 | HYI_LEAF_MAX << 24; }

/* ---- a hash

   Four independent chains hide the latency of the multiplication, which is what counts with megabytes. Every step is a
   bijection of the chain for a given word and of the word for a given chain, so no change of a single word is missed. */

HYI_INLINE uint64_t hyi_hash_step(uint64_t hash, uint64_t word) {
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    return hash ^ (hash >> 29);
}

HYI_FN uint64_t hyi_hash(uint64_t seed, const void *data, size_t size) {
    const unsigned char *at = (const unsigned char *)data;
    uint64_t chain[4], words[4];
    for (uint32_t i = 0; i < 4; i++) chain[i] = hyi_hash_step(seed, i + 1u);
    for (size_t left = size; left >= sizeof words; left -= sizeof words, at += sizeof words) {
        memcpy(words, at, sizeof words);
        for (int i = 0; i < 4; i++) chain[i] = hyi_hash_step(chain[i], words[i]);
    }
    memset(words, 0, sizeof words);
    if (size % sizeof words) memcpy(words, at, size % sizeof words);
    uint64_t hash = hyi_hash_step(seed, (uint64_t)size);
    for (int i = 0; i < 4; i++) hash = hyi_hash_step(hash, hyi_hash_step(chain[i], words[i]));
    return hash;
}

/* ---- bytes */

/* Each array of a tree is padded to eight bytes, so that records and nodes lie aligned where the whole does. */
HYI_INLINE size_t hyi_padded(size_t size) { return (size + 7u) & ~(size_t)7u; }

HYI_FN size_t hyi_tree_bytes(const hyi_bvh *bvh) {
    size_t nodes = (size_t)bvh->node_count * sizeof *bvh->nodes, ids = (size_t)bvh->slot_count * sizeof *bvh->ids;
    return sizeof(hyi_tree_record) + hyi_padded(nodes) + hyi_padded(ids);
}

HYI_FN unsigned char *hyi_put(unsigned char *out, const void *data, size_t size) {
    if (size) memcpy(out, data, size);
    memset(out + size, 0, hyi_padded(size) - size);
    return out + hyi_padded(size);
}

/* Writes hyi_tree_bytes; returns what is behind them. record: but for what the tree knows. */
HYI_FN unsigned char *hyi_put_tree(unsigned char *out, const hyi_bvh *bvh, hyi_tree_record record) {
    record.primitive_count = bvh->primitive_count;
    record.node_count = bvh->node_count;
    record.slot_count = bvh->slot_count;
    record.root = bvh->root;
    record.scale = bvh->scale;
    out = hyi_put(out, &record, sizeof record);
    out = hyi_put(out, bvh->nodes, (size_t)bvh->node_count * sizeof *bvh->nodes);
    return hyi_put(out, bvh->ids, (size_t)bvh->slot_count * sizeof *bvh->ids);
}

/* What is left to read. */
typedef struct hyi_bytes {
    const unsigned char *at;
    size_t left;
} hyi_bytes;

/* Copies count elements; false: there are not so many. */
HYI_FN bool hyi_get(hyi_bytes *in, void *data, size_t count, size_t element) {
    if (count > in->left / element || hyi_padded(count * element) > in->left) return false;
    if (count) memcpy(data, in->at, count * element);
    in->at += hyi_padded(count * element);
    in->left -= hyi_padded(count * element);
    return true;
}

/* ---- checking */

typedef struct hyi_tree_check {
    const hyi_bvh *bvh;
    uint8_t *level;  /* by node, from 1; 0: no node before it has it for a child */
    uint32_t *slots; /* a bit each: belongs to a leaf */
    uint32_t slots_seen;
} hyi_tree_check;

/* Whether the box is finite and the right way round, or for an unused child the wrong way round on every axis. */
HYI_FN bool hyi_check_box(const hyi_box *box, bool used) {
    for (int a = 0; a < 3; a++) {
        if (!hyk_is_finite(box->lower[a]) || !hyk_is_finite(box->upper[a])) return false;
        if (used ? box->lower[a] > box->upper[a] : box->lower[a] <= box->upper[a]) return false;
    }
    return true;
}

HYI_FN bool hyi_check_leaf(hyi_tree_check *check, uint32_t leaf) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    if (first >= check->bvh->slot_count || count > check->bvh->slot_count - first || count > HYI_LEAF_MAX) return false;
    for (uint32_t s = first; s < first + count; s++) {
        uint32_t bit = 1u << (s % 32u);
        if (check->slots[s / 32u] & bit) return false;
        check->slots[s / 32u] |= bit;
    }
    check->slots_seen += count;
    return true;
}

/* A node that was checked before this one has its level, so children that lead back are refused too. */
HYI_FN bool hyi_check_inner(hyi_tree_check *check, uint32_t node, uint32_t child) {
    if (child >= check->bvh->node_count || check->level[child] != 0) return false;
    check->level[child] = (uint8_t)(check->level[node] + 1u);
    return check->level[child] <= HYI_TREE_DEPTH;
}

HYI_FN bool hyi_check_node(hyi_tree_check *check, uint32_t node) {
    uint32_t used = 0;
    if (check->level[node] == 0) return false;
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        uint32_t child = hyi_node_child(check->bvh, node, c);
        hyi_box box = hyi_node_box(check->bvh, node, c);
        if (!hyi_check_box(&box, child != HYI_CHILD_NONE)) return false;
        if (child == HYI_CHILD_NONE) continue;
        if (used++ != c) return false; /* children stand before what is none */
        if (!(hyi_child_is_leaf(child) ? hyi_check_leaf(check, child) : hyi_check_inner(check, node, child))) return false;
    }
    return used > 0;
}

HYI_FN bool hyi_check_nodes(hyi_tree_check *check, uint32_t *depth) {
    const hyi_bvh *bvh = check->bvh;
    *depth = 0;
    if (hyi_child_is_leaf(bvh->root)) {
        if (bvh->node_count != 0 || !hyi_check_leaf(check, bvh->root)) return false;
    } else {
        if (bvh->root != 0 || bvh->node_count == 0) return false;
        check->level[0] = 1;
    }
    for (uint32_t n = 0; n < bvh->node_count; n++) {
        if (!hyi_check_node(check, n)) return false;
        *depth = check->level[n] > *depth ? check->level[n] : *depth;
    }
    return check->slots_seen == bvh->slot_count;
}

/* Numbers that need no more than themselves. */
HYI_FN bool hyi_check_record(const hyi_tree_record *record) {
    int exponent;
    if (record->slot_count == 0 || record->slot_count > HYI_PRIMITIVES_MAX || record->node_count > record->slot_count) return false;
    if (record->primitive_count == 0 || record->primitive_count > record->slot_count) return false;
    if (record->primitive_count > record->triangle_count || record->triangle_count > HYI_PRIMITIVES_MAX || record->refitted > 1u)
        return false;
    if (!hyk_is_finite(record->scale) || !(record->scale > 0.0f) || frexpf(record->scale, &exponent) != 0.5f) return false;
    return hyk_is_finite(record->cost_when_built) && record->cost_when_built >= 0.0f;
}

HYI_FN bool hyi_check_ids(const hyi_bvh *bvh, uint32_t triangle_count, uint32_t *marks) {
    for (uint32_t s = 0; s < bvh->slot_count; s++)
        if (bvh->ids[s] >= triangle_count) return false;
    return hyi_mark_held(bvh, marks) == bvh->primitive_count;
}

/* sound: the tree may be walked, refitted and adopted. */
HYI_FN hydra_result hyi_check_tree(hydra_context *context, hyi_bvh *bvh, uint32_t triangle_count, bool *sound) {
    size_t slot_words = hyi_mark_words(bvh->slot_count), id_words = hyi_mark_words(triangle_count), words = slot_words + id_words;
    hyi_tree_check check;
    memset(&check, 0, sizeof check);
    check.bvh = bvh;
    HYI_TRY(hyi_alloc_array(context, &check.slots, words));
    hydra_result result = hyi_alloc_array(context, &check.level, bvh->node_count);
    if (result == HYDRA_OK) {
        memset(check.slots, 0, words * sizeof *check.slots);
        if (bvh->node_count) memset(check.level, 0, bvh->node_count);
        *sound = hyi_check_nodes(&check, &bvh->depth) && hyi_check_ids(bvh, triangle_count, check.slots + slot_words);
    }
    hyi_free_array(context, &check.level, bvh->node_count);
    hyi_free_array(context, &check.slots, words);
    return result;
}

/* ---- reading */

HYI_FN hydra_result hyi_get_arrays(hydra_context *context, hyi_bytes *in, hyi_bvh *bvh, bool *sound) {
    hydra_result result = hyi_alloc_array(context, &bvh->nodes, bvh->node_count);
    if (result == HYDRA_OK) result = hyi_alloc_array(context, &bvh->ids, bvh->slot_count);
    if (result != HYDRA_OK) return result;
    *sound = hyi_get(in, bvh->nodes, bvh->node_count, sizeof *bvh->nodes) && hyi_get(in, bvh->ids, bvh->slot_count, sizeof *bvh->ids);
    return HYDRA_OK;
}

/* Reads a tree without rows; to be freed whatever comes of it. sound: false: it is damaged. */
HYI_FN hydra_result hyi_get_tree(hydra_context *context, hyi_bytes *in, hyi_tree_record *record, hyi_bvh *bvh, bool *sound) {
    memset(bvh, 0, sizeof *bvh);
    *sound = hyi_get(in, record, 1, sizeof *record) && hyi_check_record(record);
    /* no memory is asked for what the bytes cannot hold */
    *sound = *sound && record->node_count <= in->left / sizeof(hyi_node) && record->slot_count <= in->left / sizeof(uint32_t);
    if (!*sound) return HYDRA_OK;
    bvh->node_count = record->node_count;
    bvh->slot_count = record->slot_count;
    bvh->primitive_count = record->primitive_count;
    bvh->root = record->root;
    bvh->scale = record->scale;
    HYI_TRY(hyi_get_arrays(context, in, bvh, sound));
    return *sound ? hyi_check_tree(context, bvh, record->triangle_count, sound) : HYDRA_OK;
}

/* ---- adopting: rows, bounds and counts from the triangles */

HYI_FN void hyi_adopt_chunk(void *argument, uint32_t chunk) {
    hyi_refit *refit = (hyi_refit *)argument;
    hyi_refit_sum sum = hyi_refit_nothing();
    uint32_t end = hyi_chunk_end(chunk, refit->bvh->node_count);
    for (uint32_t n = chunk * HYI_BUILD_CHUNK; n < end; n++) {
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(refit->bvh, n, c);
            if (child == HYI_CHILD_NONE) break;
            if (hyi_child_is_leaf(child)) (void)hyi_refit_leaf(refit, child, &sum);
        }
    }
    refit->parts[chunk].sum = sum;
}

HYI_FN hyi_refit_sum hyi_adopt_leaves(hyi_refit *refit) {
    hyi_refit_sum sum = hyi_refit_nothing();
    if (hyi_child_is_leaf(refit->bvh->root)) (void)hyi_refit_leaf(refit, refit->bvh->root, &sum);
    hyi_parallel(refit->context, refit->part_count, hyi_adopt_chunk, refit);
    for (uint32_t p = 0; p < refit->part_count; p++) hyi_refit_add(&sum, &refit->parts[p].sum);
    return sum;
}

HYI_FN hydra_result hyi_adopt_steps(hyi_refit *refit, uint32_t triangle_count, bool *fits) {
    hyi_bvh *bvh = refit->bvh;
    bool lost;
    memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    hyi_refit_sum sum = hyi_adopt_leaves(refit);
    HYI_TRY(hyi_refit_census(refit, triangle_count, sum.collapsed, &lost));
    hyi_box real = hyi_box_of(&sum.real);
    *fits = !lost && !hyi_bounds_are_empty(&sum.real) && hyi_scale_serves(refit->scale, &real, true);
    hyi_refit_finish(refit, &real);
    bvh->bytes = (size_t)bvh->node_count * sizeof *bvh->nodes + (size_t)bvh->slot_count * sizeof *bvh->ids;
    bvh->bytes += hyi_bvh_row_floats(bvh->slot_count) * sizeof *bvh->rows;
    return HYDRA_OK;
}

/* Makes a tree that was read serve these triangles, of the number it was made for. fits false: it does not. On failure
   it has no rows and is as it was. */
HYI_FN hydra_result hyi_bvh_adopt(hydra_context *context, const float *positions, const uint32_t *indices, uint32_t triangle_count,
                                  hyi_bvh *bvh, bool *fits) {
    hyi_refit refit;
    memset(&refit, 0, sizeof refit);
    refit.context = context;
    refit.positions = positions;
    refit.indices = indices;
    refit.bvh = bvh;
    refit.scale = bvh->scale;
    refit.part_count = (bvh->node_count + HYI_BUILD_CHUNK - 1u) / HYI_BUILD_CHUNK;
    *fits = false;
    HYI_TRY(hyi_alloc_array(context, &refit.parts, refit.part_count));
    hydra_result result = hyi_alloc_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    if (result == HYDRA_OK) result = hyi_adopt_steps(&refit, triangle_count, fits);
    hyi_free_array(context, &refit.parts, refit.part_count);
    if (result != HYDRA_OK && bvh->rows) hyi_free_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    return result;
}

#endif /* HYI_BVH_SAVE_H */
