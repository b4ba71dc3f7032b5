/* >>bvh-build-cluster: units of a piece become subtrees, for quick builds

   Meister, Bittner 2018, "Parallel locally-ordered clustering for bounding volume hierarchy construction": each cluster
   looks for its best partner, by the surface of both together, among those close to it on the curve, and pairs that choose
   each other merge, until few are left. These are what the tree above is cut over. Pieces of the curve work by themselves,
   in memory that stays in a core's cache. */
#ifndef HYI_BVH_BUILD_CLUSTER_H
#define HYI_BVH_BUILD_CLUSTER_H

#include "build_cost.h"

#define HYI_CLUSTER_REACH 4u    /* partners are looked for so far away in the order, on both sides */
#define HYI_CLUSTER_SHARE 16u   /* units of a piece for one of its clusters */
#define HYI_CLUSTER_HEIGHT 20u  /* the most levels of a cluster: the tree above needs some as well */
#define HYI_CLUSTER_FEW 16u     /* passes end when one has merged less than this part of the clusters */
#define HYI_CLUSTER_FAR 1.0e18f /* half the size of a box that is no one's best partner */
#define HYI_CLUSTER_INNER 0x8000u
HYI_STATIC_ASSERT(HYI_CLUSTER_INNER > HYI_PIECE);

/* Clusters in the order of the curve: references whose id is a unit of the piece, or HYI_CLUSTER_INNER and a merge, and
   whose count is the height; their boxes as rows of floats, with something to look at before and behind them; and half the
   surface of each together with those behind it. */
#define HYI_CLUSTER_ROOM (HYI_PIECE + 2u * HYI_CLUSTER_REACH + 4u)
typedef struct hyi_clusters {
    hyi_ref refs[HYI_PIECE + 4u];
    float planes[6][HYI_CLUSTER_ROOM]; /* lower x, y, z, upper x, y, z */
    float surfaces[HYI_CLUSTER_REACH][HYI_CLUSTER_ROOM];
    int32_t partner[HYI_PIECE + 4u];   /* how far away */
    uint8_t heights[HYI_PIECE];
    uint32_t count, merges;
} hyi_clusters;

/* Nobody's best partners stand before the first and behind the last cluster. */
HYI_FN void hyi_fence_clusters(hyi_clusters *c) {
    for (uint32_t p = 0; p < 6; p++) {
        const hyi_four beyond = hyi_four_all(p < 3u ? -HYI_CLUSTER_FAR : HYI_CLUSTER_FAR);
        for (uint32_t i = 0; i < HYI_CLUSTER_REACH; i += 4u) hyi_four_store(&c->planes[p][i], beyond);
        for (uint32_t i = 0; i < HYI_CLUSTER_REACH + 4u; i += 4u) hyi_four_store(&c->planes[p][HYI_CLUSTER_REACH + c->count + i], beyond);
    }
}

/* Boxes become rows. What stands in the last four behind the last cluster does not matter: the fence goes over it. */
HYI_FN void hyi_spread_clusters(hyi_clusters *c) {
    for (uint32_t i = 0; i < c->count; i += 4u) {
        for (uint32_t side = 0; side < 2; side++) {
            hyi_four rows[4];
            for (uint32_t k = 0; k < 4; k++) rows[k] = hyi_four_load(side ? c->refs[i + k].upper : c->refs[i + k].lower);
            hyi_four_transpose(rows);
            for (uint32_t a = 0; a < 3; a++) hyi_four_store(&c->planes[3u * side + a][HYI_CLUSTER_REACH + i], rows[a]);
        }
    }
    hyi_fence_clusters(c);
}

typedef struct hyi_four_boxes {
    hyi_four plane[6];
} hyi_four_boxes;

HYI_INLINE hyi_four_boxes hyi_load_boxes(const hyi_clusters *c, uint32_t at) {
    hyi_four_boxes boxes;
    for (uint32_t p = 0; p < 6; p++) boxes.plane[p] = hyi_four_load(&c->planes[p][at]);
    return boxes;
}

/* Half of the surface of four boxes together with four others. */
HYI_INLINE hyi_four hyi_surface_with(const hyi_four_boxes *boxes, const hyi_clusters *c, uint32_t at) {
    hyi_four_boxes with = hyi_load_boxes(c, at);
    hyi_four size[3];
    for (uint32_t a = 0; a < 3; a++)
        size[a] = hyi_four_sub(hyi_four_max(boxes->plane[3u + a], with.plane[3u + a]), hyi_four_min(boxes->plane[a], with.plane[a]));
    return hyi_four_surface(size[0], size[1], size[2]);
}

/* From those before the first on, who are nobody's best partners. */
HYI_FN void hyi_find_surfaces(hyi_clusters *c) {
    for (uint32_t at = 0; at < HYI_CLUSTER_REACH + c->count; at += 4u) {
        const hyi_four_boxes boxes = hyi_load_boxes(c, at);
        for (uint32_t k = 1; k <= HYI_CLUSTER_REACH; k++) hyi_four_store(&c->surfaces[k - 1u][at], hyi_surface_with(&boxes, c, at + k));
    }
}

/* Each cluster's best partner. Of equally good ones the one that is its pair in the order comes first, then closer ones,
   then those before it: an order of all pairs, so that the best of them always choose each other. */
HYI_FN void hyi_find_partners(hyi_clusters *c) {
    const float odd[4] = {0.0f, 1.0f, 0.0f, 1.0f};
    const hyi_four parity = hyi_four_load(odd), half = hyi_four_all(0.5f), ones = hyi_four_all(1.0f), back = hyi_four_all(-1.0f);
    hyi_spread_clusters(c);
    hyi_find_surfaces(c);
    for (uint32_t i = 0; i < c->count; i += 4u) {
        const uint32_t at = HYI_CLUSTER_REACH + i;
        hyi_four before = hyi_four_load(&c->surfaces[0][at - 1u]), behind = hyi_four_load(&c->surfaces[0][at]);
        hyi_four best = hyi_four_pick_less(parity, half, behind, before), other = hyi_four_pick_less(parity, half, before, behind);
        hyi_four which = hyi_four_pick_less(parity, half, ones, back);
        which = hyi_four_pick_less(other, best, hyi_four_sub(hyi_four_all(0.0f), which), which);
        best = hyi_four_min(other, best);
        for (uint32_t k = 2; k <= HYI_CLUSTER_REACH; k++) {
            before = hyi_four_load(&c->surfaces[k - 1u][at - k]);
            behind = hyi_four_load(&c->surfaces[k - 1u][at]);
            which = hyi_four_pick_less(before, best, hyi_four_all(-(float)k), which);
            best = hyi_four_min(before, best);
            which = hyi_four_pick_less(behind, best, hyi_four_all((float)k), which);
            best = hyi_four_min(behind, best);
        }
        hyi_four_truncate(which, &c->partner[i]);
    }
}

/* Merges those that chose each other, each at the place of the first of the two, unless that gets too high. No branch on who
   merges: the second of two is written too, and then replaced by who comes next. */
HYI_FN void hyi_merge_partners(hyi_clusters *c, uint32_t *merges) {
    uint32_t left = 0;
    for (uint32_t i = 0; i < c->count; i++) c->heights[i] = (uint8_t)hyi_unit_count(&c->refs[i]);
    for (uint32_t i = 0; i < c->count; i++) {
        uint32_t with = (uint32_t)((int32_t)i + c->partner[i]), height = c->heights[i], other = c->heights[with];
        uint32_t higher = other > height ? other : height;
        uint32_t mutual = (uint32_t)(c->partner[with] == -c->partner[i]) & (uint32_t)(higher < HYI_CLUSTER_HEIGHT);
        uint32_t merge = mutual & (uint32_t)(with > i), all = 0u - merge;
        const hyi_ref *first = &c->refs[i], *second = &c->refs[i + ((with - i) & all)];
        hyi_bounds box = hyi_ref_box(first), more = hyi_ref_box(second);
        uint32_t id = hyi_ref_id(first);
        merges[c->merges] = hyi_ref_id(second) << 16 | id;
        hyi_bounds_add(&box, more.lower, more.upper);
        hyi_unit_set(&c->refs[left], &box, id ^ ((id ^ (HYI_CLUSTER_INNER | c->merges)) & all), height + ((higher + 1u - height) & all));
        c->merges += merge;
        left += 1u - (mutual & (uint32_t)(with < i));
    }
    c->count = left;
}

/* Clusters of a piece's units. merges and roots: room for as many as there are units: the children of each merge, the second
   in the high half; and what is left. By itself, as making units is: what each works in is not to stand on the stack together. */
HYI_NOINLINE void hyi_cluster_units(const hyi_ref *units, hyi_piece *piece, uint32_t *merges, uint32_t *roots) {
    hyi_clusters c;
    uint32_t before, enough = piece->units / HYI_CLUSTER_SHARE + 1u;
    c.count = piece->units;
    c.merges = 0;
    for (uint32_t i = 0; i < c.count; i++) {
        hyi_bounds box = hyi_ref_box(&units[i]);
        hyi_unit_set(&c.refs[i], &box, i, 0);
    }
    while (c.count > enough) {
        before = c.count;
        hyi_find_partners(&c);
        hyi_merge_partners(&c, merges);
        if (before - c.count <= before / HYI_CLUSTER_FEW) break;
    }
    for (uint32_t i = 0; i < c.count; i++) roots[i] = hyi_ref_id(&c.refs[i]);
    piece->clusters = c.count;
}

/* ---- pieces, each by itself */

/* A piece's merges take the places of its keys, and what is left the second half of these. */
HYI_INLINE uint32_t *hyi_piece_merges(const hyi_build *build, uint32_t piece) { return (uint32_t *)(void *)(build->keys + (size_t)piece * HYI_PIECE); }
HYI_INLINE uint32_t *hyi_piece_roots(const hyi_build *build, uint32_t piece) {
    uint32_t left = build->primitive_count - piece * HYI_PIECE;
    return hyi_piece_merges(build, piece) + (left < HYI_PIECE ? left : HYI_PIECE);
}

/* With places for most units; with fewer than it takes, nothing comes of it but their number. */
HYI_FN void hyi_try_piece(hyi_build *build, uint32_t index, uint32_t most) {
    hyi_piece *piece = &build->pieces[index];
    uint32_t begin = index * HYI_PIECE, left = build->primitive_count - begin;
    piece->units = hyi_make_units(build, begin, left < HYI_PIECE ? left : HYI_PIECE, piece->unit, most);
    if (piece->units <= most) hyi_cluster_units(piece->unit, piece, hyi_piece_merges(build, index), hyi_piece_roots(build, index));
}

HYI_FN void hyi_make_piece(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    build->pieces[index].unit = build->units + (size_t)index * HYI_PIECE_UNITS;
    hyi_try_piece(build, index, HYI_PIECE_UNITS);
}

HYI_FN void hyi_make_crowded_piece(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    if (build->pieces[index].units > HYI_PIECE_UNITS) hyi_try_piece(build, index, HYI_PIECE);
}

/* Once more those whose units were too many for their places. */
HYI_FN hydra_result hyi_make_crowded_pieces(hyi_build *build) {
    size_t at = 0;
    for (uint32_t p = 0; p < build->piece_count; p++) build->crowd_count += build->pieces[p].units > HYI_PIECE_UNITS ? HYI_PIECE : 0u;
    if (build->crowd_count == 0) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(build->context, &build->crowd, build->crowd_count));
    for (uint32_t p = 0; p < build->piece_count; p++) {
        if (build->pieces[p].units <= HYI_PIECE_UNITS) continue;
        build->pieces[p].unit = build->crowd + at;
        at += HYI_PIECE;
    }
    hyi_parallel(build->context, build->piece_count, hyi_make_crowded_piece, build);
    return HYDRA_OK;
}

/* Gives each piece its places. */
HYI_FN hydra_result hyi_make_pieces(hyi_build *build) {
    uint32_t merges = 0;
    hyi_parallel(build->context, build->piece_count, hyi_make_piece, build);
    HYI_TRY(hyi_make_crowded_pieces(build));
    build->ref_count = 0;
    for (uint32_t p = 0; p < build->piece_count; p++) {
        hyi_piece *piece = &build->pieces[p];
        piece->first_ref = build->ref_count;
        piece->first_pair = merges;
        build->ref_count += piece->clusters;
        merges += piece->units - piece->clusters;
    }
    for (uint32_t p = 0; p < build->piece_count; p++) build->pieces[p].first_pair += build->ref_count - 1u;
    build->unit_count = build->ref_count + merges;
    return HYDRA_OK;
}

/* References become units, and these clusters; references are then to clusters, without boxes yet. */
HYI_FN hydra_result hyi_build_units(hyi_build *build) {
    uint32_t count = build->primitive_count = build->ref_count;
    HYI_TRY(hyi_place_rows(build));
    hyi_sort_refs(build);
    build->piece_count = hyi_pieces_of(count);
    HYI_TRY(hyi_alloc_array(build->context, &build->pieces, build->piece_count));
    return hyi_make_pieces(build);
}

/* ---- their place in the binary tree */

HYI_INLINE void hyi_set_unit_node(const hyi_build *build, uint32_t at, const hyi_ref *unit) {
    hyi_build_node *node = &build->nodes[at];
    hyi_bounds box = hyi_ref_box(unit);
    hyi_bounds_store(&box, node->lower, node->upper);
    node->first = hyi_ref_id(unit);
    node->count = hyi_unit_count(unit);
}

HYI_INLINE hyi_bounds hyi_pair_box(const hyi_build *build, uint32_t pair) {
    const hyi_build_node *left = &build->nodes[2u * pair], *right = left + 1;
    hyi_bounds box = hyi_bounds_load(left->lower, left->upper), other = hyi_bounds_load(right->lower, right->upper);
    hyi_bounds_add(&box, other.lower, other.upper);
    return box;
}

/* The count is set with the costs. */
HYI_INLINE void hyi_set_pair_node(const hyi_build *build, uint32_t at, uint32_t pair, const hyi_bounds *box) {
    hyi_build_node *node = &build->nodes[at];
    hyi_bounds_store(box, node->lower, node->upper);
    node->first = 2u * pair;
    node->count = HYI_BUILD_INNER;
    build->parents[pair] = at;
}

/* A reference to a cluster that is no unit has the pair of its children as its id, and no count. */
HYI_INLINE void hyi_set_cluster_node(const hyi_build *build, uint32_t at, const hyi_ref *cluster) {
    hyi_bounds box = hyi_ref_box(cluster);
    if (hyi_unit_count(cluster)) hyi_set_unit_node(build, at, cluster);
    else hyi_set_pair_node(build, at, hyi_ref_id(cluster), &box);
}

HYI_INLINE void hyi_set_member_node(const hyi_build *build, uint32_t at, const hyi_piece *piece, const hyi_ref *units, uint32_t what) {
    if (what & HYI_CLUSTER_INNER) {
        uint32_t pair = piece->first_pair + (what & ~HYI_CLUSTER_INNER);
        hyi_bounds box = hyi_pair_box(build, pair);
        hyi_set_pair_node(build, at, pair, &box);
        hyi_cost_of(build, at);
    } else {
        hyi_set_unit_node(build, at, &units[what]);
    }
}

/* A reference to what is left of a piece: its box. */
HYI_INLINE hyi_bounds hyi_set_root(const hyi_build *build, const hyi_piece *piece, const hyi_ref *units, uint32_t what, hyi_ref *ref) {
    uint32_t pair = piece->first_pair + (what & ~HYI_CLUSTER_INNER);
    hyi_bounds box;
    if (what & HYI_CLUSTER_INNER) {
        box = hyi_pair_box(build, pair);
        hyi_unit_set(ref, &box, pair, 0);
        return box;
    }
    *ref = units[what];
    return hyi_ref_box(ref);
}

/* Nodes below a piece's clusters, children before parents; and references to the clusters. */
HYI_FN void hyi_place_piece(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_piece *piece = &build->pieces[index];
    const hyi_ref *units = piece->unit;
    const uint32_t *merges = hyi_piece_merges(build, index), *roots = hyi_piece_roots(build, index);
    hyi_bounds centroids = hyi_bounds_empty();
    for (uint32_t m = 0; m < piece->units - piece->clusters; m++) {
        uint32_t at = 2u * (piece->first_pair + m);
        hyi_set_member_node(build, at, piece, units, merges[m] & 0xffffu);
        hyi_set_member_node(build, at + 1u, piece, units, merges[m] >> 16);
    }
    for (uint32_t i = 0; i < piece->clusters; i++) {
        hyi_bounds box = hyi_set_root(build, piece, units, roots[i], &build->refs[piece->first_ref + i]);
        hyi_add_centroid(&centroids, &box);
    }
    piece->centroids = centroids;
}

HYI_FN void hyi_place_clusters(hyi_build *build) {
    hyi_parallel(build->context, build->piece_count, hyi_place_piece, build);
    build->root_centroids = hyi_bounds_empty();
    for (uint32_t p = 0; p < build->piece_count; p++)
        hyi_bounds_add(&build->root_centroids, build->pieces[p].centroids.lower, build->pieces[p].centroids.upper);
}

#endif /* HYI_BVH_BUILD_CLUSTER_H */
