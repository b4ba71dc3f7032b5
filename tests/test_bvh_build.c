/* Building trees: what they hold, what spatial splits leave out, threads, memory. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "bvh_helpers.h"

/* ---- loops in an order we choose */

static void bb_backwards(void *user, uint32_t count, void (*task)(void *, uint32_t), void *argument) {
    (void)user;
    while (count-- > 0) task(argument, count);
}

static void bb_even_then_odd(void *user, uint32_t count, void (*task)(void *, uint32_t), void *argument) {
    (void)user;
    for (uint32_t i = 0; i < count; i += 2) task(argument, i);
    for (uint32_t i = 1; i < count; i += 2) task(argument, i);
}

static hyi_bvh bb_build(tb_host *host, const ht_mesh *mesh, hydra_build quality) {
    hyi_bvh bvh;
    float cost;
    assert_int_equal(hyi_bvh_build_triangles(&host->context, mesh->positions, mesh->indices, mesh->index_count / 3, quality, &bvh, &cost), HYDRA_OK);
    ht_assert_near(cost, hyi_bvh_cost(&bvh), 1e-5 * (double)cost);
    return bvh;
}

/* ---- meshes that are hard on builders */

/* Sizes from 1 down to 1e-30 in one mesh: the worst for the depth. */
static ht_mesh bb_sizes(ht_rng *rng, uint32_t count) {
    ht_mesh mesh = ht_soup(rng, count, 1.0f, 0.01f);
    for (uint32_t v = 0; v < 3 * mesh.vertex_count; v++) mesh.positions[v] *= powf(10, -30.0f * (float)(v / 9) / (float)count);
    return mesh;
}

/* Corners on a coarse grid, so that planes of the builder's grids pass through them. */
static ht_mesh bb_on_grid(ht_rng *rng, uint32_t count) {
    ht_mesh mesh = ht_soup(rng, count, 1.0f, 0.5f);
    for (uint32_t v = 0; v < 3 * mesh.vertex_count; v++) mesh.positions[v] = floorf(16 * mesh.positions[v]) / 16;
    return mesh;
}

static ht_mesh bb_equal(ht_rng *rng, uint32_t count) {
    ht_mesh mesh = ht_soup(rng, count, 1.0f, 0.5f);
    for (uint32_t v = 9; v < 3 * mesh.vertex_count; v++) mesh.positions[v] = mesh.positions[v - 9];
    return mesh;
}

#define BB_MESHES 9
static ht_mesh bb_mesh(int k, ht_rng *rng) {
    const float centre[3] = {0, 0, 0}, u[3] = {1, 0, 0}, v[3] = {0, 1, 0};
    ht_mesh mesh;
    switch (k) {
    case 0: return ht_soup(rng, 60000, 1, 0.01f);
    case 1: return ht_icosphere(1, 4);
    case 2: return ht_quad(centre, u, v, 60);
    case 3: return bb_sizes(rng, 20000);
    case 4: return tb_needles(rng, 12000, 0.01f);
    case 5: return bb_on_grid(rng, 5000);
    case 6: return bb_equal(rng, 3000);
    case 7: return ht_soup(rng, 1, 1, 0.5f);
    default: break;
    }
    mesh = tb_needles(rng, 3000, 0.01f);
    for (uint32_t i = 0; i < 3 * mesh.vertex_count; i++) mesh.positions[i] = mesh.positions[i] * 1e30f;
    return mesh;
}

/* ---- what a tree holds */

typedef struct bb_check {
    const hyi_bvh *bvh;
    const ht_mesh *mesh;
    uint8_t *seen;
    bool parts; /* boxes need not hold whole triangles */
} bb_check;

static void bb_check_leaf(const bb_check *k, uint32_t leaf, const hyi_box *box) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    assert_true(first + count <= k->bvh->slot_count);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t id = k->bvh->ids[first + i];
        for (uint32_t j = 0; j < i; j++) assert_true(k->bvh->ids[first + j] != id);
        k->seen[id] = 1;
        for (uint32_t c = 0; c < 9; c++) {
            float p = k->mesh->positions[3 * k->mesh->indices[3 * id + c / 3] + c % 3] * k->bvh->scale;
            assert_true(p == k->bvh->rows[9u * first + c * count + i]);
            if (!k->parts) assert_true(p >= box->lower[c % 3] && p <= box->upper[c % 3]);
        }
    }
}

/* Whether a leaf below child has the triangle, and the point lies in all boxes above it. */
static bool bb_is_covered(const hyi_bvh *bvh, uint32_t child, uint32_t id, const double point[3]) {
    if (hyi_child_is_leaf(child)) {
        for (uint32_t i = 0; i < hyi_leaf_count(child); i++)
            if (bvh->ids[hyi_leaf_first(child) + i] == id) return true;
        return false;
    }
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        const hyi_node *node = &bvh->nodes[child];
        bool inside = node->child[c] != HYI_CHILD_NONE;
        for (int a = 0; a < 3; a++) inside = inside && point[a] >= (double)node->planes[2 * a][c] && point[a] <= (double)node->planes[2 * a + 1][c];
        if (inside && bb_is_covered(bvh, node->child[c], id, point)) return true;
    }
    return false;
}

/* Where the planes of a leaf's box cut the edges of its triangles: where parts end. Catches: boxes of parts that are a
   rounding too small. */
static void bb_check_cuts(const bb_check *k, uint32_t leaf, const hyi_box *box) {
    uint32_t id = k->bvh->ids[hyi_leaf_first(leaf)];
    for (uint32_t n = 0; n < 18; n++) {
        uint32_t axis = n % 3, edge = n / 3 % 3;
        double plane = n < 9 ? (double)box->lower[axis] : (double)box->upper[axis], p[3], q[3], point[3];
        for (uint32_t a = 0; a < 3; a++) {
            p[a] = (double)(k->mesh->positions[3 * k->mesh->indices[3 * id + edge] + a] * k->bvh->scale);
            q[a] = (double)(k->mesh->positions[3 * k->mesh->indices[3 * id + (edge + 1) % 3] + a] * k->bvh->scale);
        }
        if (p[axis] == q[axis]) continue; /* no NaN: -ffast-math would not see it */
        double t = (plane - p[axis]) / (q[axis] - p[axis]);
        if (!(t > 0 && t < 1)) continue;
        for (int a = 0; a < 3; a++) point[a] = p[a] + t * (q[a] - p[a]);
        point[axis] = plane;
        assert_true(bb_is_covered(k->bvh, k->bvh->root, id, point));
    }
}

/* Every child lies in its parent's box; returns the depth. */
static uint32_t bb_check_below(const bb_check *k, uint32_t child, const hyi_box *box) {
    uint32_t depth = 0;
    if (hyi_child_is_leaf(child)) {
        bb_check_leaf(k, child, box);
        if (k->parts) bb_check_cuts(k, child, box);
        return 0;
    }
    assert_true(child < k->bvh->node_count);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        const hyi_node *node = &k->bvh->nodes[child];
        hyi_box inner;
        if (node->child[c] == HYI_CHILD_NONE) continue;
        for (int a = 0; a < 3; a++) {
            inner.lower[a] = node->planes[2 * a][c];
            inner.upper[a] = node->planes[2 * a + 1][c];
            assert_true(inner.lower[a] >= box->lower[a] && inner.upper[a] <= box->upper[a]);
        }
        uint32_t below = bb_check_below(k, node->child[c], &inner);
        depth = below > depth ? below : depth;
    }
    return depth + 1;
}

/* Random points of random triangles, corners and edges among them. */
static void bb_check_points(const bb_check *k, ht_rng *rng, uint32_t count) {
    for (uint32_t n = 0; n < count; n++) {
        uint32_t id = (uint32_t)(ht_range(rng, 0, 1) * 0.9999f * (float)(k->mesh->index_count / 3));
        double w[3] = {(double)ht_range(rng, 0, 1), (double)ht_range(rng, 0, 1), (double)ht_range(rng, 0, 1)}, point[3] = {0, 0, 0};
        if (n % 4 == 1) w[n % 3] = 0;
        if (n % 4 == 2) w[0] = 0, w[1] = n % 8 < 4 ? 0 : w[1], w[2] = 1;
        double sum = w[0] + w[1] + w[2];
        if (!k->seen[id] || !(sum > 0)) continue;
        const uint32_t *index = k->mesh->indices + 3 * id;
        for (int a = 0; a < 3; a++) {
            double corner[3], low = 1e300, high = -1e300;
            for (int c = 0; c < 3; c++) {
                corner[c] = (double)(k->mesh->positions[3 * index[c] + (uint32_t)a] * k->bvh->scale);
                low = corner[c] < low ? corner[c] : low;
                high = corner[c] > high ? corner[c] : high;
                point[a] += corner[c] * (w[c] / sum);
            }
            point[a] = point[a] < low ? low : point[a] > high ? high : point[a]; /* the double's own rounding */
        }
        assert_true(bb_is_covered(k->bvh, k->bvh->root, id, point));
    }
}

static void trees_hold_every_point_of_every_triangle(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(91);
    for (int m = 0; m < 2 * BB_MESHES; m++) {
        tb_host host;
        bool best = m % 2 != 0;
        ht_mesh mesh = bb_mesh(m / 2, &rng);
        uint32_t triangles = mesh.index_count / 3, total = 0;
        tb_open(&host);
        hyi_bvh bvh = bb_build(&host, &mesh, best ? HYDRA_BUILD_BEST : HYDRA_BUILD_FAST);
        bb_check k = {&bvh, &mesh, (uint8_t *)calloc(triangles, 1), best};
        assert_int_equal(bb_check_below(&k, bvh.root, &bvh.scaled), bvh.depth);
        for (uint32_t i = 0; i < triangles; i++) total += k.seen[i];
        assert_int_equal(total, bvh.primitive_count);
        assert_true(bvh.depth <= HYI_TREE_DEPTH);
        assert_true(best ? bvh.slot_count <= triangles + triangles * HYI_BUILD_EXTRA_PERCENT / 100u : bvh.slot_count == bvh.primitive_count);
        assert_int_equal(host.memory.bytes_now, bvh.bytes);
        bb_check_points(&k, &rng, ht_pick(20000, 4000));
        free(k.seen);
        hyi_bvh_free(&host.context, &bvh);
        tb_close(&host);
        ht_mesh_free(&mesh);
    }
}

/* Catches: a builder that never splits. */
static void spatial_splits_are_made_where_boxes_overlap(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(93);
    tb_host host;
    ht_mesh mesh = tb_needles(&rng, 12000, 0.01f);
    tb_open(&host);
    hyi_bvh bvh = bb_build(&host, &mesh, HYDRA_BUILD_BEST);
    assert_true(bvh.slot_count > bvh.primitive_count + bvh.primitive_count / 20u);
    hyi_bvh_free(&host.context, &bvh);
    tb_close(&host);
    ht_mesh_free(&mesh);
}

/* ---- the binary tree, before and after reinsertion */

typedef struct bb_binary {
    double surface;  /* of all nodes with children */
    uint32_t leaves, depth;
    uint8_t *seen;   /* by first reference of a leaf */
} bb_binary;

/* Boxes are the unions of those below, to the bit; parents, counts and heights are right. Returns the height. */
static uint32_t bb_measure_binary(const hyi_build *build, uint32_t at, uint32_t depth, bb_binary *sums) {
    const hyi_build_node *node = &build->nodes[at];
    uint32_t heights[2], count = 0;
    assert_true(depth < HYI_TREE_DEPTH);
    sums->depth = depth > sums->depth ? depth : sums->depth;
    if (hyi_build_is_leaf(node)) {
        assert_int_equal(sums->seen[node->first]++, 0);
        sums->leaves++;
        return 0;
    }
    assert_int_equal(build->parents[node->first / 2u], at);
    for (uint32_t c = 0; c < 2; c++) {
        heights[c] = bb_measure_binary(build, node->first + c, depth + 1, sums);
        count += build->nodes[node->first + c].count & ~HYI_BUILD_INNER;
    }
    assert_true((node->count & ~HYI_BUILD_INNER) >= 2 && (node->count & ~HYI_BUILD_INNER) <= count); /* parts may have been added below */
    for (int a = 0; a < 3; a++) {
        const hyi_build_node *left = &build->nodes[node->first], *right = left + 1;
        assert_true(node->lower[a] == (left->lower[a] < right->lower[a] ? left->lower[a] : right->lower[a]));
        assert_true(node->upper[a] == (left->upper[a] > right->upper[a] ? left->upper[a] : right->upper[a]));
    }
    uint32_t height = 1 + (heights[0] > heights[1] ? heights[0] : heights[1]);
    assert_int_equal(hyi_height_of(build, node), height);
    assert_true(hyi_cost_at(build, node)->tips > 0);
    sums->surface += (double)hyi_node_area(node);
    return height;
}

static bb_binary bb_measure(const hyi_build *build) {
    bb_binary sums = {0, 0, 0, (uint8_t *)calloc(build->capacity, 1)};
    bb_measure_binary(build, build->node_capacity - 1u, 0, &sums);
    free(sums.seen);
    return sums;
}

/* Catches: boxes, counts, heights or links not mended; candidates that move where the tree gets dearer; leaves lost. Mesh 3
   is nearly as deep as trees may be. */
static void bb_check_reinsertion(int m, const ht_mesh *mesh, hydra_build quality) {
    tb_host host;
    hyi_bvh bvh;
    hyi_build build;
    tb_open(&host);
    memset(&bvh, 0, sizeof bvh);
    hyi_build_describe(&build, &host.context, mesh->positions, mesh->indices, mesh->index_count / 3, quality, &bvh);
    assert_int_equal(hyi_build_refs(&build), HYDRA_OK);
    if (build.in_units) assert_int_equal(hyi_build_units(&build), HYDRA_OK);
    assert_int_equal(hyi_build_tree(&build), HYDRA_OK);
    bb_binary before = bb_measure(&build);
    assert_int_equal(hyi_reinsert_largest(&build), HYDRA_OK);
    bb_binary after = bb_measure(&build);
    assert_int_equal(after.leaves, before.leaves);
    assert_true(after.surface <= before.surface * 1.00001);
    if (m < 4) assert_true(build.nodes_in_room == (!build.best && (m == 1 || m == 2))); /* few units of the others merge */
    if (m < 4 && build.in_units) assert_true((build.crowd_count != 0) == (m != 1 && m != 2));
    if (m == 3 || (m == 4 && build.best)) assert_true(after.surface < 0.98 * before.surface);
    hyi_build_release(&build);
    hyi_bvh_free(&host.context, &bvh); /* a quick build has rows from its beginning */
    tb_close(&host);
}

static float bb_in_places(const hyi_build *build, const hyi_build_node *node, uint32_t places) {
    if (hyi_build_is_leaf(node)) return hyi_leaf_cost(hyi_node_area(node), node->count);
    return hyi_places_at(build, node)->cost[places - 1u];
}

/* A node's cost in so many places, the left child getting some of them. */
static float bb_shared(const hyi_build *build, const hyi_build_node *node, uint32_t places, uint32_t left) {
    return bb_in_places(build, &build->nodes[node->first], left) + bb_in_places(build, &build->nodes[node->first + 1u], places - left);
}

static void bb_check_cost(const hyi_build *build, const hyi_build_node *node) {
    const hyi_cost *cost = hyi_cost_at(build, node);
    const float *in_places = hyi_places_at(build, node)->cost;
    for (uint32_t places = 2; places <= HYI_WIDTH; places++) {
        uint32_t left = cost->left[places - 2u];
        float best = FLT_MAX;
        for (uint32_t k = 1; k < places; k++) best = fminf(best, bb_shared(build, node, places, k));
        if (left) assert_true(left < places && bb_shared(build, node, places, left) == best);
        if (places == HYI_WIDTH) assert_true(left && (cost->leaf || in_places[0] == hyi_node_area(node) * HYI_COST_NODE + best));
        else assert_true(in_places[places - 1u] == fminf(best, in_places[places - 2u]));
        if (places < HYI_WIDTH) assert_int_equal(left == 0, in_places[places - 1u] == in_places[places - 2u]);
    }
}

/* The least costs of a node follow from those of its children. Catches: shares of one child counted for the other, and
   places that are not tried. */
static void costs_are_the_least_there_are(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(89);
    for (int m = 0; m < 3; m++) {
        tb_host host;
        ht_mesh mesh = bb_mesh(m, &rng);
        hyi_bvh bvh;
        hyi_build build;
        tb_open(&host);
        memset(&bvh, 0, sizeof bvh);
        hyi_build_describe(&build, &host.context, mesh.positions, mesh.indices, mesh.index_count / 3, HYDRA_BUILD_FAST, &bvh);
        assert_int_equal(hyi_build_refs(&build), HYDRA_OK);
        assert_int_equal(hyi_build_units(&build), HYDRA_OK);
        assert_int_equal(hyi_build_tree(&build), HYDRA_OK);
        for (uint32_t n = 0; n < build.node_capacity; n++)
            if (!hyi_build_is_leaf(&build.nodes[n])) bb_check_cost(&build, &build.nodes[n]);
        hyi_build_release(&build);
        hyi_bvh_free(&host.context, &bvh); /* a quick build has rows from its beginning */
        tb_close(&host);
        ht_mesh_free(&mesh);
    }
}

static void reinsertion_keeps_a_tree_and_makes_it_cheaper(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(98);
    for (int m = 0; m < BB_MESHES; m++) {
        ht_mesh mesh = bb_mesh(m, &rng);
        bb_check_reinsertion(m, &mesh, HYDRA_BUILD_BEST);
        bb_check_reinsertion(m, &mesh, HYDRA_BUILD_FAST);
        ht_mesh_free(&mesh);
    }
}

/* A node that is neither the root, nor below node, nor next to it already, nor where the tree would get too deep. */
static bool bb_may_go(const hyi_build *build, uint32_t node, uint32_t to) {
    if (to == hyi_parent_of(build, node) || to == (node ^ 1u) || hyi_parent_of(build, to) == HYI_NO_NODE) return false;
    for (uint32_t at = to; at != HYI_NO_NODE; at = hyi_parent_of(build, at))
        if (at == node) return false;
    return !hyi_move_is_deep(build, node, to);
}

/* Catches: boxes not mended where a node becomes the sibling of its own grandparent. */
static void any_node_may_go_anywhere(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(96);
    tb_host host;
    ht_mesh mesh = bb_mesh(0, &rng);
    hyi_bvh bvh;
    hyi_build build;
    uint32_t made = 0;
    tb_open(&host);
    memset(&bvh, 0, sizeof bvh);
    hyi_build_describe(&build, &host.context, mesh.positions, mesh.indices, mesh.index_count / 3, HYDRA_BUILD_BEST, &bvh);
    assert_int_equal(hyi_build_refs(&build), HYDRA_OK);
    assert_int_equal(hyi_build_tree(&build), HYDRA_OK);
    uint32_t root = build.node_capacity - 1u, places[2] = {root, root};
    for (uint32_t n = 0; n < 4000; n++) {
        for (int k = 0; k < 2; k++) { /* down at random; a leaf is left for the root */
            bool leaf = hyi_build_is_leaf(&build.nodes[places[k]]);
            places[k] = leaf ? root : build.nodes[places[k]].first + (ht_range(&rng, 0, 1) < 0.5f ? 0u : 1u);
        }
        uint32_t node = places[0], to = places[1], parent = hyi_parent_of(&build, node);
        if (node == root || parent == root) continue;
        if (n % 2 == 0) to = hyi_parent_of(&build, parent);
        if (!bb_may_go(&build, node, to)) continue;
        hyi_make_move(&build, node, to);
        places[0] = places[1] = root;
        made++;
    }
    assert_true(made > 200);
    hyi_cost_mended(&build, root);
    (void)bb_measure(&build);
    hyi_build_release(&build);
    tb_close(&host);
    ht_mesh_free(&mesh);
}

/* A few neighbours of a mesh become one unit. Catches: units that do not merge, or that only their limit stops. */
static void units_are_leaves_of_a_few(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(92);
    for (int m = 1; m < 3; m++) {
        tb_host host;
        ht_mesh mesh = bb_mesh(m, &rng);
        uint32_t triangles = mesh.index_count / 3;
        hyi_bvh bvh;
        hyi_build build;
        tb_open(&host);
        memset(&bvh, 0, sizeof bvh);
        hyi_build_describe(&build, &host.context, mesh.positions, mesh.indices, triangles, HYDRA_BUILD_FAST, &bvh);
        assert_int_equal(hyi_build_refs(&build), HYDRA_OK);
        assert_int_equal(hyi_build_units(&build), HYDRA_OK);
        assert_true(build.unit_count < triangles / 2u && build.unit_count > triangles / 6u);
        assert_true(build.ref_count < build.unit_count / 12u);
        hyi_build_release(&build);
        hyi_bvh_free(&host.context, &bvh); /* a quick build has rows from its beginning */
        tb_close(&host);
        ht_mesh_free(&mesh);
    }
}

/* What merging neighbours adds is the cost of both together less that of each, and those merge that no other neighbour suits
   better. Catches: rows that are mixed up, limits that let too many in, and units that merge with two others. */
static void units_merge_with_the_best_neighbour(void **state) {
    (void)state;
    static hyi_units u;
    static hyi_ref refs[HYI_PIECE];
    ht_rng rng = ht_rng_make(91);
    for (uint32_t count = 1; count <= HYI_PIECE; count += count < 20 ? 1 : 251) {
        float first = 0;
        for (uint32_t i = 0; i < count; i++) {
            float low[3], high[3];
            for (int a = 0; a < 3; a++) low[a] = ht_range(&rng, 0, 1), high[a] = low[a] + ht_range(&rng, 0, 2);
            hyi_bounds box = hyi_bounds_load(low, high);
            hyi_ref_set(&refs[i], &box, 0);
            refs[i].lower[3] = first;
            refs[i].upper[3] = first += 1.0f + floorf(ht_range(&rng, 0, 4));
        }
        u.refs = refs;
        u.count = count;
        hyi_spread_units(&u);
        hyi_weigh_merges(&u, 6);
        hyi_choose_merges(&u);
        const float *losses = u.losses + HYI_LOSS_FIRST;
        for (uint32_t i = 0; i + 1 < count; i++) {
            hyi_bounds box = hyi_ref_box(&refs[i]), next = hyi_ref_box(&refs[i + 1]);
            float a = refs[i].upper[3] - refs[i].lower[3], b = refs[i + 1].upper[3] - refs[i + 1].lower[3];
            float alone = hyi_bounds_area(&box) * (HYI_UNIT_VISIT + HYI_UNIT_TRIANGLE * a) + hyi_bounds_area(&next) * (HYI_UNIT_VISIT + HYI_UNIT_TRIANGLE * b);
            float together = hyi_bounds_area_with(&box, next.lower, next.upper) * (HYI_UNIT_VISIT - HYI_UNIT_PLACE + HYI_UNIT_TRIANGLE * (a + b));
            if (a + b > 6) assert_true(losses[i] == FLT_MAX);
            else assert_true(fabsf(losses[i] - (together - alone)) < 1e-5f * together);
            assert_int_equal(u.merges[i], losses[i] < 0 && losses[i] < losses[(int32_t)i - 1] && losses[i] <= losses[i + 1]);
        }
        assert_int_equal(u.merges[count - 1], 0);
    }
}

/* ---- clusters of units */

/* Random boxes, or equal ones, as a piece has them. */
static void bb_clusters(hyi_clusters *c, ht_rng *rng, uint32_t count, bool equal) {
    memset(c, 0, sizeof *c);
    c->count = count;
    for (uint32_t i = 0; i < count; i++) {
        float low[3] = {0, 0, 0}, high[3] = {1, 1, 1};
        for (int a = 0; a < 3 && !equal; a++) {
            low[a] = floorf(16 * ht_range(rng, 0, 1)) / 16; /* so that some are equally good */
            high[a] = low[a] + floorf(4 * ht_range(rng, 0, 1)) / 16;
        }
        hyi_bounds box = hyi_bounds_load(low, high);
        hyi_unit_set(&c->refs[i], &box, i, 0);
    }
}

static float bb_together(const hyi_clusters *c, uint32_t i, uint32_t j) {
    hyi_bounds box = hyi_ref_box(&c->refs[i]), other = hyi_ref_box(&c->refs[j]);
    return hyi_bounds_area_with(&box, other.lower, other.upper);
}

/* One as high as may be stays. Catches: partners that are
   not looked for far enough, or beyond an end; ties broken so that nobody is chosen back; a limit that loses a cluster. */
static void clusters_choose_the_best_partner(void **state) {
    (void)state;
    static hyi_clusters c;
    static uint32_t merges[HYI_PIECE];
    ht_rng rng = ht_rng_make(97);
    for (uint32_t count = 2; count <= HYI_PIECE; count += count < 40 ? 1 : 41) {
        bb_clusters(&c, &rng, count, false);
        hyi_find_partners(&c);
        for (uint32_t i = 0; i < count; i++) {
            float best = FLT_MAX;
            for (uint32_t j = i < HYI_CLUSTER_REACH ? 0 : i - HYI_CLUSTER_REACH; j < count && j <= i + HYI_CLUSTER_REACH; j++)
                if (j != i && bb_together(&c, i, j) < best) best = bb_together(&c, i, j);
            uint32_t with = (uint32_t)((int32_t)i + c.partner[i]);
            assert_true(with < count && with != i);
            assert_true(bb_together(&c, i, with) == best);
        }
        hyi_merge_partners(&c, merges);
        assert_true(c.count < count && c.count + c.merges == count);
        bb_clusters(&c, &rng, count, true);
        hyi_find_partners(&c);
        hyi_merge_partners(&c, merges);
        assert_int_equal(c.count, (count + 1) / 2);
        bb_clusters(&c, &rng, count, true);
        hyi_bounds box = hyi_ref_box(&c.refs[1]);
        hyi_unit_set(&c.refs[1], &box, 1, HYI_CLUSTER_HEIGHT);
        hyi_find_partners(&c);
        hyi_merge_partners(&c, merges);
        assert_int_equal(c.count, (count + 1) / 2 + 1);
        assert_true(hyi_ref_id(&c.refs[0]) == 0 && hyi_ref_id(&c.refs[1]) == 1);
    }
}

/* Every unit of a piece is in one cluster; children come before parents. Boxes in each other make chains. Catches: passes
   that do not end, and merges that lose one of the two. */
static void clusters_hold_every_unit_once(void **state) {
    (void)state;
    static hyi_ref units[HYI_PIECE];
    static uint32_t merges[HYI_PIECE], roots[HYI_PIECE];
    ht_rng rng = ht_rng_make(90);
    for (uint32_t n = 0; n < 40; n++) {
        uint8_t seen[2 * HYI_PIECE] = {0}, height[HYI_PIECE], tallest = 0;
        hyi_piece piece;
        memset(&piece, 0, sizeof piece);
        piece.units = n < 20 ? n + 1 : 25 * n;
        for (uint32_t i = 0; i < piece.units; i++) {
            float size = n % 2 ? powf(1.5f, (float)(i % 12)) : ht_range(&rng, 0, 1), low[3] = {0, 0, 0}, high[3] = {size, size, size};
            hyi_bounds box = hyi_bounds_load(low, high);
            hyi_unit_set(&units[i], &box, i, 1);
        }
        hyi_cluster_units(units, &piece, merges, roots);
        for (uint32_t m = 0; m < piece.units - piece.clusters; m++) {
            height[m] = 1;
            for (uint32_t side = 0; side < 2; side++) {
                uint32_t what = merges[m] >> 16 * side & 0xffffu, merge = what & ~HYI_CLUSTER_INNER;
                assert_true((what & HYI_CLUSTER_INNER) ? merge < m : what < piece.units);
                assert_int_equal(seen[(what & HYI_CLUSTER_INNER) ? HYI_PIECE + merge : what]++, 0);
                if ((what & HYI_CLUSTER_INNER) && height[merge] >= height[m]) height[m] = (uint8_t)(height[merge] + 1);
            }
            tallest = height[m] > tallest ? height[m] : tallest;
        }
        for (uint32_t i = 0; i < piece.clusters; i++) {
            uint32_t what = roots[i];
            assert_int_equal(seen[(what & HYI_CLUSTER_INNER) ? HYI_PIECE + (what & ~HYI_CLUSTER_INNER) : what]++, 0);
        }
        for (uint32_t i = 0; i < piece.units; i++) assert_int_equal(seen[i], 1);
        for (uint32_t m = 0; m < piece.units - piece.clusters; m++) assert_int_equal(seen[HYI_PIECE + m], 1);
        assert_true(tallest <= HYI_CLUSTER_HEIGHT && (n % 2 == 0 || n < 20 || tallest > 8));
    }
}

/* Quick trees cost rays little more than the best without spatial splits. Catches: an order that is none, and
   wrong boxes. */
static void quick_trees_are_good_ones(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(99);
    for (int m = 0; m < 3; m++) {
        tb_host host;
        ht_mesh mesh = bb_mesh(m, &rng);
        tb_open(&host);
        hyi_bvh quick = bb_build(&host, &mesh, HYDRA_BUILD_FAST), best = bb_build(&host, &mesh, HYDRA_BUILD_BEST);
        assert_true(hyi_bvh_cost(&quick) < 1.12f * hyi_bvh_cost(&best));
        assert_true((float)quick.node_count < 1.5f * (float)best.node_count);
        hyi_bvh_free(&host.context, &quick);
        hyi_bvh_free(&host.context, &best);
        tb_close(&host);
        ht_mesh_free(&mesh);
    }
}

/* Both trees find the same hits. Rays start and end on the grid of the corners now and then. */
static void both_qualities_find_the_same(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(94);
    for (int m = 4; m < 6; m++) {
        tb_host host;
        ht_mesh mesh = bb_mesh(m, &rng);
        hyk_instance instance;
        hyk_scene_view view;
        hyi_accel accel;
        uint32_t found = 0;
        tb_open(&host);
        hyi_bvh trees[2];
        for (int q = 0; q < 2; q++) trees[q] = bb_build(&host, &mesh, q ? HYDRA_BUILD_BEST : HYDRA_BUILD_FAST);
        memset(&instance, 0, sizeof instance);
        memset(&view, 0, sizeof view);
        memset(&accel, 0, sizeof accel);
        instance.flags = HYK_INSTANCE_IDENTITY;
        view.instances = &instance;
        accel.view = &view;
        accel.single = true;
        accel.isa = hyi_best_isa();
        for (uint32_t n = 0; n < ht_pick(40000, 8000); n++) {
            hyk_ray ray;
            hyk_hit hits[2];
            float x[6];
            for (int i = 0; i < 6; i++) x[i] = n % 3 ? ht_range(&rng, -1.2f, 1.2f) : floorf(16 * ht_range(&rng, -1.2f, 1.2f)) / 16;
            ray.origin = hyk_make3(x[0], x[1], x[2]);
            ray.direction = hyk_sub(hyk_make3(x[3], x[4], x[5]), ray.origin);
            ray.t_min = 0;
            ray.t_max = n % 2 ? FLT_MAX : 1;
            for (int q = 0; q < 2; q++) {
                accel.meshes = &trees[q];
                hyi_trace_closest(&accel, NULL, &ray, &hits[q], 1);
            }
            assert_memory_equal(&hits[0], &hits[1], sizeof hits[0]);
            found += hits[0].instance != HYK_NONE;
        }
        assert_true(found > 500);
        for (int q = 0; q < 2; q++) hyi_bvh_free(&host.context, &trees[q]);
        tb_close(&host);
        ht_mesh_free(&mesh);
    }
}

/* ---- threads and memory */

static void bb_expect_same(const hyi_bvh *a, const hyi_bvh *b) {
    assert_int_equal(a->node_count, b->node_count);
    assert_int_equal(a->slot_count, b->slot_count);
    assert_memory_equal(a->nodes, b->nodes, a->node_count * sizeof(hyi_node));
    assert_memory_equal(a->ids, b->ids, a->slot_count * sizeof(uint32_t));
    assert_memory_equal(a->rows, b->rows, hyi_bvh_row_floats(a->slot_count) * sizeof(float));
}

static uint32_t bb_largest_leaf(const hyi_bvh *bvh) {
    uint32_t largest = 0;
    for (uint32_t n = 0; n < bvh->node_count; n++) {
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(bvh, n, c);
            if (child != HYI_CHILD_NONE && hyi_child_is_leaf(child) && hyi_leaf_count(child) > largest) largest = hyi_leaf_count(child);
        }
    }
    return largest;
}

/* Lanes of a device meet a leaf's triangles one after the other. Catches: a builder with a limit of its own. */
static void leaves_end_at_their_limit(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(96);
    ht_mesh mesh = ht_soup(&rng, 20000, 1, 0.03f);
    for (int k = 0; k < 4; k++) {
        tb_host host;
        tb_open(&host);
        host.context.device = k < 2 ? &host : NULL;
        hyi_bvh bvh = bb_build(&host, &mesh, k % 2 ? HYDRA_BUILD_BEST : HYDRA_BUILD_FAST);
        assert_int_equal(bb_largest_leaf(&bvh), k < 2 ? HYI_LEAF_MAX_DEVICE : HYI_LEAF_MAX);
        hyi_bvh_free(&host.context, &bvh);
        tb_close(&host);
    }
    ht_mesh_free(&mesh);
}

static void any_order_of_work_builds_the_same(void **state) {
    (void)state;
    static const uint32_t threads[5] = {1, 1, 2, 3, 7};
    ht_rng rng = ht_rng_make(95);
    for (int m = 0; m < 4; m++) {
        tb_host plain;
        ht_mesh mesh = m < 2 ? ht_soup(&rng, ht_pick(100000, 40000), 1, 0.02f) : tb_needles(&rng, 30000, 0.01f);
        hydra_build quality = m % 2 ? HYDRA_BUILD_BEST : HYDRA_BUILD_FAST;
        tb_open(&plain);
        hyi_bvh first = bb_build(&plain, &mesh, quality);
        for (int k = 0; k < 5; k++) {
            tb_host host;
            tb_open(&host);
            if (k < 2) host.context.desc.parallel_for = k ? bb_backwards : bb_even_then_odd;
#if !defined(HYDRA_NO_THREADS)
            host.context.threads = threads[k];
            if (k >= 2) assert_int_equal(hyi_pool_create(&host.context), HYDRA_OK);
#endif
            hyi_bvh bvh = bb_build(&host, &mesh, quality);
            bb_expect_same(&bvh, &first);
            hyi_bvh_free(&host.context, &bvh);
#if !defined(HYDRA_NO_THREADS)
            if (k >= 2) hyi_pool_destroy(&host.context);
#endif
            tb_close(&host);
        }
        hyi_bvh_free(&plain.context, &first);
        tb_close(&plain);
        ht_mesh_free(&mesh);
    }
}

static void failing_memory_leaks_nothing(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(97);
    ht_mesh mesh = tb_needles(&rng, 20000, 0.01f);
    for (int q = 0; q < 2; q++) {
        int64_t n = 1;
        for (;; n++) {
            tb_host host;
            hyi_bvh bvh;
            float cost;
            tb_open(&host);
            host.memory.fail_at = n;
            hydra_result result = hyi_bvh_build_triangles(&host.context, mesh.positions, mesh.indices, mesh.index_count / 3,
                                                          q ? HYDRA_BUILD_BEST : HYDRA_BUILD_FAST, &bvh, &cost);
            if (result == HYDRA_OK) hyi_bvh_free(&host.context, &bvh);
            else assert_int_equal(result, HYDRA_ERROR_OUT_OF_MEMORY);
            assert_true(bvh.nodes == NULL && bvh.primitive_count == 0);
            tb_close(&host);
            if (result == HYDRA_OK) break;
        }
        assert_true(n > 6 && n < 100);
    }
    ht_mesh_free(&mesh);
}

int hydra_test_bvh_build(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(trees_hold_every_point_of_every_triangle),
        cmocka_unit_test(spatial_splits_are_made_where_boxes_overlap),
        cmocka_unit_test(costs_are_the_least_there_are),
        cmocka_unit_test(reinsertion_keeps_a_tree_and_makes_it_cheaper),
        cmocka_unit_test(any_node_may_go_anywhere),
        cmocka_unit_test(units_are_leaves_of_a_few),
        cmocka_unit_test(units_merge_with_the_best_neighbour),
        cmocka_unit_test(clusters_choose_the_best_partner),
        cmocka_unit_test(clusters_hold_every_unit_once),
        cmocka_unit_test(quick_trees_are_good_ones),
        cmocka_unit_test(both_qualities_find_the_same),
        cmocka_unit_test(leaves_end_at_their_limit),
        cmocka_unit_test(any_order_of_work_builds_the_same),
        cmocka_unit_test(failing_memory_leaks_nothing),
    };
    return cmocka_run_group_tests_name("bvh_build", tests, NULL, NULL);
}
