/* Trees whose triangles moved: refits against fresh builds, in whole scenes too, and the report on their quality. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "tree_helpers.h"

int hydra_test_trees_refit(void);

/* ---------------------------------------------------------------- refit */

/* One of a number of ways to bend a mesh out of shape. */
static void deform(ht_mesh *mesh, ht_rng *rng) {
    uint32_t kind = ht_below(rng, 6);
    float amount = ht_range(rng, 0.01f, 1.0f);
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        float *p = mesh->positions + 3 * v, x = p[0], y = p[1];
        if (kind == 0) p[0] = x * cosf(3 * y * amount) - p[2] * sinf(3 * y * amount), p[2] = x * sinf(3 * y * amount) + p[2] * cosf(3 * y * amount);
        if (kind == 1) p[1] = y + amount * sinf(5 * x);
        if (kind == 2) p[0] = x * (1 + 3 * amount), p[1] = y / (1 + amount);
        if (kind == 4) p[2] = 0; /* flat: sides that ran along z lose their area */
        if (kind == 5 && v % 3 == 0) memcpy(p, mesh->positions, 3 * sizeof *p);
    }
    if (kind == 3) ht_mesh_jitter(mesh, rng, amount);
}

/* Catches: boxes that do not follow, rows or parts of the tree left out, clipped boxes kept, bounds and counts of before. */
static void test_moved_like_fresh(void **state) {
    (void)state;
    uint32_t hit = 0, refitted = 0, rounds = 0;
    for (uint32_t kind = 0; kind < 5; kind++) {
        for (int build = HYDRA_BUILD_AUTO; build <= HYDRA_BUILD_BEST; build++) {
            ht_mesh first = some_mesh(kind);
            ht_rng rng = ht_rng_make(100 + kind);
            world w;
            open_mesh(&w, &first, true, (hydra_build)build);
            for (uint32_t i = 0; i < ht_pick(12, 4); i++, rounds++) {
                ht_mesh now = copy_of(&first);
                deform(&now, &rng);
                if (i % 2) deform(&now, &rng);
                move(&w, &now);
                refitted += info_of(&w).meshes_refitted;
                hit += expect_like_fresh(&w, &now);
                ht_mesh_free(&now);
            }
            close_world(&w);
            ht_mesh_free(&first);
        }
    }
    assert_true(hit > rounds * RAYS / 10);
    assert_true(refitted > rounds * 2 / 3);
}

/* Sizes from 1e-30 to 1e30 and places far away. Catches: a scale of the tree that the new coordinates do not fit. */
static void test_moved_to_other_sizes(void **state) {
    (void)state;
    static const float sizes[] = {1, 1e6f, 1, 1e-6f, 1e7f, 1e12f, 1e13f, 1e-12f, 1e30f, 1e-30f, 1e-6f, 1e36f, 1};
    for (uint32_t kind = 1; kind < 4; kind++) {
        ht_mesh first = some_mesh(kind);
        world w;
        open_mesh(&w, &first, true, HYDRA_BUILD_AUTO);
        for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
            ht_mesh now = copy_of(&first);
            ht_mesh_place(&now, sizes[i], i % 2 ? 3 * sizes[i] : 0, 0, 0);
            move(&w, &now);
            assert_int_equal(info_of(&w).meshes_refitted, 1);
            assert_true(expect_like_fresh(&w, &now) > RAYS / 40);
            ht_mesh_free(&now);
        }
        close_world(&w);
        ht_mesh_free(&first);
    }
}

/* Catches: triangles of no area that are hit, that widen the bounds, or that are not there when they unfold again. */
static void test_collapse_and_back(void **state) {
    (void)state;
    for (uint32_t kind = 0; kind < 4; kind++) {
        ht_mesh first = some_mesh(kind), now = copy_of(&first);
        world w;
        open_mesh(&w, &first, true, HYDRA_BUILD_AUTO);
        for (uint32_t v = 0; v < now.vertex_count; v++) now.positions[3 * v] = now.positions[3 * v + 1] = now.positions[3 * v + 2] = 0.7f;
        move(&w, &now);
        assert_int_equal(expect_like_fresh(&w, &now), 0);
        hydra_mesh_info info = mesh_info_of(&w, w.mesh);
        assert_int_equal(info.degenerate, first.index_count / 3);
        assert_true(info.cost == 0.0f && !info.rebuild_advised);
        move(&w, &first);
        assert_int_equal(info_of(&w).meshes_built, 1);
        assert_true(expect_like_fresh(&w, &first) > RAYS / 20);
        close_world(&w);
        ht_mesh_free(&first);
        ht_mesh_free(&now);
    }
}

/* A triangle folded to nothing far outside, while all others stay. */
static void test_collapse_of_some(void **state) {
    (void)state;
    ht_mesh first = some_mesh(0), now = copy_of(&first);
    world w;
    open_mesh(&w, &first, true, HYDRA_BUILD_AUTO);
    for (uint32_t t = 0; t < now.index_count / 3; t += 2) {
        float at = t % 4 ? 50.0f : 1e30f; /* 1e30: no scale of the tree serves both */
        for (uint32_t c = 0; c < 3; c++)
            for (uint32_t a = 0; a < 3; a++) now.positions[3 * now.indices[3 * t + c] + a] = t < 20 ? at : (float)(c + 1) * 0.25f;
    }
    move(&w, &now);
    assert_true(expect_like_fresh(&w, &now) > RAYS / 20);
    assert_int_equal(mesh_info_of(&w, w.mesh).degenerate, now.index_count / 6);
    move(&w, &first);
    assert_true(expect_like_fresh(&w, &first) > RAYS / 20);
    close_world(&w);
    ht_mesh_free(&first);
    ht_mesh_free(&now);
}

/* A mesh that begins with triangles of no area: as long as they stay so it is refitted, then built. */
static void test_dropped_triangles_return(void **state) {
    (void)state;
    ht_mesh full = some_mesh(1), folded = copy_of(&full), still = copy_of(&full);
    uint32_t triangle = 1000;
    float *corner = folded.positions + 3 * folded.indices[3 * triangle];
    memcpy(corner, folded.positions + 3 * folded.indices[3 * triangle + 1], 3 * sizeof *corner);
    memcpy(still.positions, folded.positions, (size_t)still.vertex_count * 3 * sizeof(float));
    ht_mesh_place(&still, 1.5f, 0, 0, 0);
    for (int build = HYDRA_BUILD_FAST; build <= HYDRA_BUILD_BEST; build++) {
        world w;
        open_mesh(&w, &folded, true, (hydra_build)build);
        assert_true(info_of(&w).degenerate > 0);
        move(&w, &still);
        assert_int_equal(info_of(&w).meshes_refitted, 1);
        (void)expect_like_fresh(&w, &still);
        move(&w, &full);
        assert_int_equal(info_of(&w).meshes_built, 1);
        assert_int_equal(info_of(&w).degenerate, 0);
        (void)expect_like_fresh(&w, &full);
        close_world(&w);
    }
    ht_mesh_free(&full);
    ht_mesh_free(&folded);
    ht_mesh_free(&still);
}

static uint32_t check_leaf_rows(const hyi_bvh *bvh, uint32_t leaf, const ht_mesh *mesh) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    for (uint32_t lane = 0; lane < count; lane++) {
        const uint32_t *index = mesh->indices + 3 * bvh->ids[first + lane];
        const float *p = mesh->positions;
        bool flat = hyi_triangle_is_degenerate(p + 3 * index[0], p + 3 * index[1], p + 3 * index[2]);
        for (uint32_t i = 0; i < 9; i++)
            assert_true(hyi_leaf_lane(bvh, first, lane)[i * count] == p[3 * index[flat ? 0 : i / 3] + i % 3] * bvh->scale);
    }
    return count;
}

/* Leaves of all sizes have the corners of their triangles, those of one without area at a point. Catches: lanes that reach
   into other leaves, or that belong to another triangle. */
static void test_rows_of_moved_triangles(void **state) {
    (void)state;
    ht_mesh first = ht_icosphere(1.0f, 5), now = copy_of(&first);
    ht_rng rng = ht_rng_make(4);
    ht_mesh_jitter(&now, &rng, 0.05f);
    for (uint32_t i = 0; i < 3 * now.vertex_count; i++) now.positions[i] *= 1e9f;
    for (uint32_t t = 0; t < now.index_count / 3; t += 97)
        memcpy(now.positions + 3 * now.indices[3 * t], now.positions + 3 * now.indices[3 * t + 1], 3 * sizeof(float));
    for (int build = HYDRA_BUILD_FAST; build <= HYDRA_BUILD_BEST; build++) {
        uint32_t seen[HYI_LEAF_MAX + 1] = {0};
        world w;
        open_mesh(&w, &first, true, (hydra_build)build);
        move(&w, &now);
        assert_int_equal(info_of(&w).meshes_refitted, 1);
        const hyi_bvh *bvh = &w.scene->meshes[0].bvh;
        assert_true(bvh->scale != 1.0f);
        for (uint32_t n = 0; n < bvh->node_count; n++)
            for (uint32_t c = 0; c < HYI_WIDTH; c++)
                if (hyi_child_is_leaf(bvh->nodes[n].child[c])) seen[check_leaf_rows(bvh, bvh->nodes[n].child[c], &now)]++;
        assert_true(seen[2] && seen[3] && seen[4] && seen[6]);
        close_world(&w);
    }
    ht_mesh_free(&first);
    ht_mesh_free(&now);
}

/* Catches: a tree that depends on who refitted which part of it. */
static void test_same_for_any_threads(void **state) {
    (void)state;
    static const uint32_t threads[] = {1, 2, 5};
    ht_mesh first = ht_icosphere(1.0f, 5), now = copy_of(&first);
    ht_rng rng = ht_rng_make(3);
    void *saved[3];
    size_t size[3];
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    ht_mesh_jitter(&now, &rng, 0.05f);
    for (int i = 0; i < 3; i++) {
        world w;
        desc.threads = threads[i];
        open_world(&w, &desc);
        w.mesh = add_mesh(&w, &first, true, HYDRA_BUILD_AUTO);
        ht_ok(w.host.context, hydra_scene_commit(w.scene));
        move(&w, &now);
        assert_true(w.scene->meshes[0].bvh.node_count > HYI_REFIT_PARTS);
        ht_ok(w.host.context, hydra_scene_save_trees(w.scene, NULL, &size[i]));
        saved[i] = malloc(size[i]);
        ht_ok(w.host.context, hydra_scene_save_trees(w.scene, saved[i], &size[i]));
        assert_int_equal(size[i], size[0]);
        assert_memory_equal(saved[i], saved[0], size[i]);
        close_world(&w);
    }
    for (int i = 0; i < 3; i++) free(saved[i]);
    ht_mesh_free(&first);
    ht_mesh_free(&now);
}

/* ---------------------------------------------------------------- refit in a scene */

static hydra_instance add_instance(world *w, float x, float turn) {
    hydra_instance_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.mesh = w->mesh;
    const float transform[12] = {cosf(turn), 0, sinf(turn), x, 0, 1, 0, 0.5f, -sinf(turn), 0, cosf(turn), 0};
    memcpy(desc.transform, transform, sizeof transform);
    return hydra_scene_add_instance(w->scene, &desc);
}

/* A room, and a mesh in it that may glow, by itself and twice as an instance. */
static void open_room(world *w, const ht_mesh *mesh, bool dynamic, bool instanced_only) {
    const float low[3] = {-6, -3, -4}, high[3] = {6, 3, 4};
    ht_mesh box = ht_box(low, high);
    hydra_material_desc glow;
    memset(&glow, 0, sizeof glow);
    glow.base_color[0] = glow.emission[1] = 0.5f;
    glow.emit_both_sides = true;
    open_world(w, NULL);
    ht_mesh_flip(&box);
    (void)add_mesh(w, &box, false, HYDRA_BUILD_AUTO);
    hydra_mesh_desc desc = ht_mesh_desc(mesh, hydra_scene_add_material(w->scene, &glow));
    desc.dynamic = dynamic;
    desc.instanced_only = instanced_only;
    w->mesh = hydra_scene_add_mesh(w->scene, &desc);
    assert_int_not_equal(add_instance(w, 3, 0.5f).id, 0);
    assert_int_not_equal(add_instance(w, -3, 1.0f).id, 0);
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
    ht_mesh_free(&box);
}

static void render(const world *w, float pixels[3 * 24 * 16]) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor.position[2] = 3.5f;
    desc.sensor.fov_y = 1.5f;
    desc.width = 24;
    desc.height = 16;
    desc.max_samples = 4;
    hydra_render *r = hydra_render_create(w->scene, &desc);
    assert_non_null(r);
    assert_int_equal(ht_finish(r), HYDRA_OK);
    ht_ok(w->host.context, hydra_render_read(r, HYDRA_RADIANCE, pixels, 0));
    hydra_render_destroy(r);
}

/* Hits, bounds and the light of moved emitters: pictures to the bit those of a scene that never knew another shape.
   Catches: trees above, the shared tree, light lists or mesh records that still see the old positions. */
static void test_scene_follows(void **state) {
    (void)state;
    static float a[3 * 24 * 16], b[3 * 24 * 16];
    for (int kind = 0; kind < 4; kind++) {
        bool dynamic = kind & 1, instanced_only = kind & 2;
        ht_mesh first = ht_icosphere(1.0f, 2), now = copy_of(&first);
        ht_mesh_place(&now, 1.3f, 0.5f, 1.2f, 0);
        world moved, fresh;
        open_room(&moved, &first, dynamic, instanced_only);
        open_room(&fresh, &now, dynamic, instanced_only);
        render(&moved, a);
        ht_ok(moved.host.context, hydra_scene_move_vertices(moved.scene, moved.mesh, view_of(now.positions, now.vertex_count), nothing()));
        hydra_hit hit;
        hydra_ray ray = {{0, 0, 3}, 0, {0, 0, -1}, INFINITY};
        assert_int_equal(hydra_scene_closest_hits(moved.scene, &ray, &hit, 1), HYDRA_ERROR_NOT_COMMITTED);
        ht_ok(moved.host.context, hydra_scene_commit(moved.scene));
        hydra_scene_info info = info_of(&moved);
        assert_int_equal(info.meshes_refitted, dynamic ? 1 : 0);
        assert_int_equal(info.meshes_built, dynamic ? 0 : instanced_only ? 1 : 2);
        assert_true(expect_same_hits(&moved, &fresh) > RAYS / 2);
        render(&fresh, b);
        assert_memory_not_equal(a, b, sizeof a);
        render(&moved, a);
        assert_memory_equal(a, b, sizeof a);
        close_world(&moved);
        close_world(&fresh);
        ht_mesh_free(&first);
        ht_mesh_free(&now);
    }
}

/* New normals shade; none given keeps those that were there. */
static void test_moved_normals(void **state) {
    (void)state;
    ht_mesh ball = ht_icosphere(1.0f, 2);
    world w;
    open_world(&w, NULL);
    hydra_material none = {0};
    hydra_mesh_desc desc = ht_mesh_desc(&ball, none);
    desc.normals = view_of(ball.positions, ball.vertex_count);
    desc.dynamic = true;
    w.mesh = hydra_scene_add_mesh(w.scene, &desc);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    size_t bytes = (size_t)ball.vertex_count * 3 * sizeof(float);
    float *wide = (float *)malloc(2 * bytes);
    for (uint32_t v = 0; v < ball.vertex_count; v++) {
        memcpy(wide + 6 * v, ball.positions + 3 * (ball.vertex_count - 1 - v), 12);
        wide[6 * v + 3] = wide[6 * v + 4] = wide[6 * v + 5] = NAN; /* never to be read */
    }
    hydra_view normals = view_of(wide, ball.vertex_count);
    normals.stride = 24;
    ht_ok(w.host.context, hydra_scene_move_vertices(w.scene, w.mesh, view_of(ball.positions, ball.vertex_count), normals));
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    for (uint32_t v = 0; v < ball.vertex_count; v++) assert_memory_equal(w.scene->meshes[0].normals + 3 * v, wide + 6 * v, 12);
    move(&w, &ball);
    assert_memory_equal(w.scene->meshes[0].normals, wide, 12);
    assert_memory_equal(w.scene->view.mesh_arrays[0].positions, ball.positions, bytes);
    free(wide);
    close_world(&w);
    ht_mesh_free(&ball);
}

/* Each misuse has its name, changes nothing, and is told of by the next commit once. */
static void test_move_errors(void **state) {
    (void)state;
    ht_mesh ball = ht_icosphere(1.0f, 1), bad = copy_of(&ball), empty;
    memset(&empty, 0, sizeof empty);
    world w;
    open_mesh(&w, &ball, true, HYDRA_BUILD_AUTO);
    hydra_mesh strange = {77};
    hydra_view good = view_of(ball.positions, ball.vertex_count), wrong = good;
    bad.positions[40] = NAN;
    wrong.stride = 7;
    const struct {
        hydra_mesh mesh;
        hydra_view positions, normals;
        hydra_result result;
    } cases[] = {
        {strange, good, nothing(), HYDRA_ERROR_HANDLE},
        {{0}, good, nothing(), HYDRA_ERROR_HANDLE},
        {w.mesh, view_of(ball.positions, ball.vertex_count - 1), nothing(), HYDRA_ERROR_COUNT},
        {w.mesh, nothing(), nothing(), HYDRA_ERROR_COUNT},
        {w.mesh, view_of(NULL, ball.vertex_count), nothing(), HYDRA_ERROR_NULL},
        {w.mesh, view_of(bad.positions, bad.vertex_count), nothing(), HYDRA_ERROR_NOT_FINITE},
        {w.mesh, good, good, HYDRA_ERROR_COUNT}, /* it has no normals */
        {w.mesh, wrong, nothing(), HYDRA_ERROR_STRIDE},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(hydra_scene_move_vertices(w.scene, cases[i].mesh, cases[i].positions, cases[i].normals), cases[i].result);
        assert_int_equal(hydra_scene_commit(w.scene), cases[i].result);
        assert_non_null(strstr(hydra_error_text(w.host.context), "hydra_scene_move_vertices"));
        ht_ok(w.host.context, hydra_scene_commit(w.scene));
        (void)expect_like_fresh(&w, &ball);
    }
    hydra_mesh_info info;
    assert_int_equal(hydra_scene_move_vertices(NULL, w.mesh, good, nothing()), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_scene_rebuild_mesh(w.scene, strange), HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_scene_get_mesh_info(w.scene, strange, &info), HYDRA_ERROR_HANDLE);
    assert_int_equal(hydra_scene_get_mesh_info(w.scene, w.mesh, NULL), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_scene_commit(w.scene), HYDRA_ERROR_HANDLE);
    ht_ok(w.host.context, hydra_scene_rebuild_mesh(w.scene, w.mesh));
    assert_int_equal(hydra_scene_get_mesh_info(w.scene, w.mesh, &info), HYDRA_ERROR_NOT_COMMITTED);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.width = desc.height = 8;
    hydra_render *r = hydra_render_create(w.scene, &desc);
    assert_non_null(r);
    assert_int_equal(hydra_scene_move_vertices(w.scene, w.mesh, good, nothing()), HYDRA_ERROR_BUSY);
    assert_int_equal(hydra_scene_rebuild_mesh(w.scene, w.mesh), HYDRA_ERROR_BUSY);
    hydra_render_destroy(r);
    close_world(&w);
    ht_mesh_free(&ball);
    ht_mesh_free(&bad);
}

/* ---------------------------------------------------------------- quality */

/* Catches: costs that do not see what a deformation did, advice that never comes or that a build does not end. */
static void test_quality_report(void **state) {
    (void)state;
    ht_mesh first = some_mesh(2), mixed = copy_of(&first), turned = copy_of(&first);
    ht_rng rng = ht_rng_make(5);
    world w;
    open_mesh(&w, &first, true, HYDRA_BUILD_AUTO);
    hydra_mesh_info built = mesh_info_of(&w, w.mesh);
    assert_true(built.cost > 1 && built.cost == built.cost_when_built);
    assert_true(!built.refitted && !built.rebuild_advised && !built.shared);
    assert_int_equal(built.triangles, first.index_count / 3);
    ht_mesh_place(&turned, 3.0f, 5, 0, 0);
    move(&w, &turned);
    hydra_mesh_info info = mesh_info_of(&w, w.mesh);
    assert_true(info.refitted && !info.rebuild_advised);
    ht_assert_near(info.cost, built.cost, 1e-3 * (double)built.cost);
    for (uint32_t v = mixed.vertex_count - 1; v > 0; v--) { /* every vertex somewhere else */
        uint32_t other = ht_below(&rng, v + 1);
        for (int a = 0; a < 3; a++) {
            float keep = mixed.positions[3 * v + (uint32_t)a];
            mixed.positions[3 * v + (uint32_t)a] = mixed.positions[3 * other + (uint32_t)a];
            mixed.positions[3 * other + (uint32_t)a] = keep;
        }
    }
    move(&w, &mixed);
    info = mesh_info_of(&w, w.mesh);
    assert_true(info.refitted && info.rebuild_advised && info.cost > 3 * built.cost);
    assert_true(info.cost_when_built == built.cost_when_built);
    ht_assert_near(info.cost, hyi_bvh_cost(&w.scene->meshes[0].bvh), 1e-4 * (double)info.cost);
    (void)expect_like_fresh(&w, &mixed);
    ht_ok(w.host.context, hydra_scene_rebuild_mesh(w.scene, w.mesh));
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    hydra_mesh_info again = mesh_info_of(&w, w.mesh);
    assert_int_equal(info_of(&w).meshes_built, 1);
    assert_true(!again.refitted && !again.rebuild_advised && again.cost < info.cost && again.cost == again.cost_when_built);
    (void)expect_like_fresh(&w, &mixed);
    close_world(&w);
    ht_mesh_free(&first);
    ht_mesh_free(&mixed);
    ht_mesh_free(&turned);
}

/* Meshes of the shared tree report that tree, and each its own triangles. */
static void test_report_of_shared(void **state) {
    (void)state;
    ht_mesh ball = ht_icosphere(1.0f, 2), torus = some_mesh(2);
    memcpy(torus.positions + 3 * torus.indices[0], torus.positions + 3 * torus.indices[1], 12); /* two lose their area */
    world w;
    open_world(&w, NULL);
    hydra_mesh a = add_mesh(&w, &ball, false, HYDRA_BUILD_AUTO), b = add_mesh(&w, &torus, false, HYDRA_BUILD_AUTO);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    hydra_mesh_info info_a = mesh_info_of(&w, a), info_b = mesh_info_of(&w, b);
    assert_true(info_a.shared && info_b.shared && info_a.cost == info_b.cost && info_a.bytes_bvh == info_b.bytes_bvh);
    assert_int_equal(info_a.triangles, ball.index_count / 3);
    assert_int_equal(info_a.degenerate, 0);
    assert_int_equal(info_b.degenerate, info_of(&w).degenerate);
    assert_true(info_b.degenerate > 0);
    ht_ok(w.host.context, hydra_scene_rebuild_mesh(w.scene, a));
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    assert_int_equal(info_of(&w).meshes_built, 1);
    close_world(&w);
    ht_mesh_free(&ball);
    ht_mesh_free(&torus);
}

/* The desc's build: checked, and the shared tree FAST only if all say so. */
static void test_build_choice(void **state) {
    (void)state;
    ht_mesh ball = ht_icosphere(1.0f, 2);
    world w;
    open_world(&w, NULL);
    hydra_material none = {0};
    hydra_mesh_desc desc = ht_mesh_desc(&ball, none);
    int impossible = 3;
    memcpy(&desc.build, &impossible, sizeof impossible);
    assert_int_equal(hydra_scene_add_mesh(w.scene, &desc).id, 0);
    assert_int_equal(hydra_scene_commit(w.scene), HYDRA_ERROR_ENUM);
    (void)add_mesh(&w, &ball, false, HYDRA_BUILD_FAST);
    assert_int_equal(hyi_world_build(w.scene), HYDRA_BUILD_FAST);
    (void)add_mesh(&w, &ball, true, HYDRA_BUILD_BEST);
    assert_int_equal(hyi_world_build(w.scene), HYDRA_BUILD_FAST);
    (void)add_mesh(&w, &ball, false, HYDRA_BUILD_AUTO);
    assert_int_equal(hyi_world_build(w.scene), HYDRA_BUILD_BEST);
    (void)add_mesh(&w, &ball, true, HYDRA_BUILD_AUTO);
    assert_int_equal(w.scene->meshes[1].build, HYDRA_BUILD_BEST);
    assert_int_equal(w.scene->meshes[3].build, HYDRA_BUILD_FAST);
    close_world(&w);
    ht_mesh_free(&ball);
}

int hydra_test_trees_refit(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_moved_like_fresh),
        cmocka_unit_test(test_moved_to_other_sizes),
        cmocka_unit_test(test_collapse_and_back),
        cmocka_unit_test(test_collapse_of_some),
        cmocka_unit_test(test_dropped_triangles_return),
        cmocka_unit_test(test_rows_of_moved_triangles),
        cmocka_unit_test(test_same_for_any_threads),
        cmocka_unit_test(test_scene_follows),
        cmocka_unit_test(test_moved_normals),
        cmocka_unit_test(test_move_errors),
        cmocka_unit_test(test_quality_report),
        cmocka_unit_test(test_report_of_shared),
        cmocka_unit_test(test_build_choice),
    };
    return cmocka_run_group_tests_name("trees_refit", tests, NULL, NULL);
}
