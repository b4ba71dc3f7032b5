/* Trees that outlive their geometry or their program: refits of moved vertices against fresh builds, their quality report,
   and trees saved, loaded, damaged and forged. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

int hydra_test_trees(void);

/* ---------------------------------------------------------------- a scene with one mesh, and rays at it */

enum { RAYS = 400 };

typedef struct world {
    ht_host host;
    hydra_scene *scene;
    hydra_mesh mesh;
} world;

static hydra_view view_of(const float *data, size_t count) {
    hydra_view view;
    view.data = data;
    view.stride = 0;
    view.count = count;
    return view;
}

static hydra_view nothing(void) { return view_of(NULL, 0); }

static void open_world(world *w, uint32_t threads) {
    memset(w, 0, sizeof *w);
    assert_non_null(ht_open_threads(&w->host, threads));
    w->scene = hydra_scene_create(w->host.context);
    assert_non_null(w->scene);
}

static hydra_mesh add_mesh(world *w, const ht_mesh *mesh, bool dynamic, hydra_build build) {
    hydra_material none = {0};
    hydra_mesh_desc desc = ht_mesh_desc(mesh, none);
    desc.dynamic = dynamic;
    desc.build = build;
    hydra_mesh made = hydra_scene_add_mesh(w->scene, &desc);
    assert_int_not_equal(made.id, 0);
    return made;
}

static void open_mesh(world *w, const ht_mesh *mesh, bool dynamic, hydra_build build) {
    open_world(w, 1);
    w->mesh = add_mesh(w, mesh, dynamic, build);
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
}

static void close_world(world *w) {
    assert_int_equal(hydra_scene_destroy(w->scene), HYDRA_OK);
    ht_close(&w->host);
}

static hydra_scene_info info_of(const world *w) {
    hydra_scene_info info;
    ht_ok(w->host.context, hydra_scene_get_info(w->scene, &info));
    return info;
}

static hydra_mesh_info mesh_info_of(const world *w, hydra_mesh mesh) {
    hydra_mesh_info info;
    ht_ok(w->host.context, hydra_scene_get_mesh_info(w->scene, mesh, &info));
    return info;
}

static void move(world *w, const ht_mesh *to) {
    ht_ok(w->host.context, hydra_scene_move_vertices(w->scene, w->mesh, view_of(to->positions, to->vertex_count), nothing()));
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
}

/* From one point in the bounds, widened to twice their size, to another inside. */
static void make_rays(const hydra_scene_info *info, hydra_ray rays[RAYS]) {
    ht_rng rng = ht_rng_make(7);
    for (int i = 0; i < RAYS; i++) {
        for (int a = 0; a < 3; a++) {
            double low = (double)info->bounds_min[a], extent = (double)info->bounds_max[a] - low;
            double from = low + extent * (2.0 * (double)ht_uniform(&rng) - 0.5), to = low + extent * (double)ht_uniform(&rng);
            rays[i].origin[a] = (float)from;
            rays[i].direction[a] = (float)(to - from);
        }
        rays[i].t_min = 0;
        rays[i].t_max = INFINITY;
    }
}

static void shoot(const world *w, const hydra_ray rays[RAYS], hydra_hit hits[RAYS]) {
    static uint8_t blocked[RAYS];
    assert_int_equal(hydra_scene_closest_hits(w->scene, rays, hits, RAYS), HYDRA_OK);
    assert_int_equal(hydra_scene_any_hits(w->scene, rays, blocked, RAYS), HYDRA_OK);
    for (int i = 0; i < RAYS; i++) assert_int_equal(blocked[i], hits[i].t >= 0);
}

/* Ties have one answer whatever the tree, so hits of two scenes agree to the bit. Returns how many there were. */
static uint32_t expect_same_hits(const world *a, const world *b) {
    static hydra_ray rays[RAYS];
    static hydra_hit hits_a[RAYS], hits_b[RAYS];
    hydra_scene_info info_a = info_of(a), info_b = info_of(b);
    assert_memory_equal(info_a.bounds_min, info_b.bounds_min, sizeof info_a.bounds_min);
    assert_memory_equal(info_a.bounds_max, info_b.bounds_max, sizeof info_a.bounds_max);
    assert_int_equal(info_a.degenerate, info_b.degenerate);
    make_rays(&info_b, rays);
    bool castable = memcmp(info_b.bounds_min, info_b.bounds_max, sizeof info_b.bounds_min) != 0;
    if (!castable) return 0;
    shoot(a, rays, hits_a);
    shoot(b, rays, hits_b);
    uint32_t hit = 0;
    for (int i = 0; i < RAYS; i++) {
        assert_memory_equal(&hits_a[i], &hits_b[i], sizeof hits_a[i]);
        hit += hits_a[i].t >= 0 ? 1u : 0u;
    }
    return hit;
}

/* The scene against a fresh one with the same mesh as it is now. */
static uint32_t expect_like_fresh(const world *w, const ht_mesh *now) {
    world fresh;
    open_mesh(&fresh, now, true, HYDRA_BUILD_AUTO);
    uint32_t hit = expect_same_hits(w, &fresh);
    close_world(&fresh);
    return hit;
}

static ht_mesh copy_of(const ht_mesh *mesh) {
    ht_mesh copy;
    memset(&copy, 0, sizeof copy);
    ht_mesh_append(&copy, mesh);
    return copy;
}

static ht_mesh some_mesh(uint32_t kind) {
    ht_rng rng = ht_rng_make(kind);
    if (kind == 0) return ht_soup(&rng, 700, 1.0f, 0.2f);
    if (kind == 1) return ht_icosphere(1.0f, 3);
    if (kind == 2) return ht_torus(1.0f, 0.3f, 120, 60); /* more nodes than HYI_REFIT_PARTS: several parts */
    if (kind == 3) return ht_soup(&rng, 5, 1.0f, 0.5f);  /* one leaf */
    return ht_soup(&rng, 300, 1.0f, 2.0f);               /* large ones that cross: what spatial splits cut up */
}

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

/* Catches: a tree that depends on who refitted which part of it. */
static void test_same_for_any_threads(void **state) {
    (void)state;
    static const uint32_t threads[] = {1, 2, 5};
    ht_mesh first = ht_icosphere(1.0f, 5), now = copy_of(&first);
    ht_rng rng = ht_rng_make(3);
    void *saved[3];
    size_t size[3];
    ht_mesh_jitter(&now, &rng, 0.05f);
    for (int i = 0; i < 3; i++) {
        world w;
        open_world(&w, threads[i]);
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
    open_world(w, 1);
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
    open_world(&w, 1);
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
    open_world(&w, 1);
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
    open_world(&w, 1);
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

/* ---------------------------------------------------------------- save and load */

typedef struct blob {
    uint8_t *data;
    size_t size;
} blob;

static blob save(const world *w) {
    blob saved = {NULL, 0};
    ht_ok(w->host.context, hydra_scene_save_trees(w->scene, NULL, &saved.size));
    saved.data = (uint8_t *)malloc(saved.size);
    assert_non_null(saved.data);
    ht_ok(w->host.context, hydra_scene_save_trees(w->scene, saved.data, &saved.size));
    return saved;
}

/* Two meshes of the shared tree, and two with their own. change: 0, or what is different. */
static void open_several(world *w, int change) {
    ht_mesh meshes[4] = {ht_icosphere(1.0f, 2), some_mesh(0), some_mesh(1), some_mesh(3)};
    ht_mesh_place(&meshes[1], 1, 2, 0, 0);
    ht_mesh_place(&meshes[2], 1, 0, 2, 0);
    if (change == 1) meshes[2].positions[30] += 0.01f;
    if (change == 2) meshes[3].indices[1] = meshes[3].indices[4];
    if (change == 3) meshes[0].positions[3] += 0.01f;
    open_world(w, 1);
    for (int i = 0; i < 4; i++) {
        hydra_mesh made = add_mesh(w, &meshes[i], i >= 2, change == 4 && i == 2 ? HYDRA_BUILD_FAST : HYDRA_BUILD_BEST);
        if (i == 3) w->mesh = made;
        ht_mesh_free(&meshes[i]);
    }
}

/* Catches: trees that change on the way, are taken for other geometry, or outstay the commit. */
static void test_load_what_was_saved(void **state) {
    (void)state;
    world first;
    open_several(&first, 0);
    ht_ok(first.host.context, hydra_scene_commit(first.scene));
    blob saved = save(&first);
    for (int change = 0; change < 5; change++) {
        world second, built;
        open_several(&second, change);
        open_several(&built, change);
        ht_ok(built.host.context, hydra_scene_commit(built.scene));
        ht_ok(second.host.context, hydra_scene_load_trees(second.scene, saved.data, saved.size));
        ht_ok(second.host.context, hydra_scene_commit(second.scene));
        assert_int_equal(info_of(&second).trees_loaded, change == 0 ? 3 : 2);
        assert_int_equal(info_of(&second).meshes_built, change == 0 ? 0 : 1);
        assert_int_equal(second.scene->loaded_count, 0);
        assert_true(expect_same_hits(&second, &built) > RAYS / 20);
        assert_int_equal(info_of(&second).bytes_bvh, info_of(&built).bytes_bvh);
        blob again = save(&second), wanted = save(&built);
        assert_int_equal(again.size, wanted.size);
        assert_memory_equal(again.data, wanted.data, again.size);
        free(again.data);
        free(wanted.data);
        close_world(&second);
        close_world(&built);
    }
    free(saved.data);
    close_world(&first);
}

/* A refitted tree is saved with its report, loaded, and refitted on; one that was moved since is not taken. */
static void test_load_refitted(void **state) {
    (void)state;
    ht_mesh first = some_mesh(1), now = copy_of(&first);
    ht_rng rng = ht_rng_make(8);
    ht_mesh_jitter(&now, &rng, 0.2f);
    world a, b;
    open_mesh(&a, &first, true, HYDRA_BUILD_AUTO);
    move(&a, &now);
    blob saved = save(&a);
    open_world(&b, 3);
    b.mesh = add_mesh(&b, &now, true, HYDRA_BUILD_AUTO);
    ht_ok(b.host.context, hydra_scene_load_trees(b.scene, saved.data, saved.size));
    memset(saved.data, 0, saved.size); /* it was copied */
    ht_ok(b.host.context, hydra_scene_commit(b.scene));
    assert_int_equal(info_of(&b).trees_loaded, 1);
    hydra_mesh_info info_a = mesh_info_of(&a, a.mesh), info_b = mesh_info_of(&b, b.mesh);
    assert_true(info_b.refitted && info_b.cost_when_built == info_a.cost_when_built && info_b.rebuild_advised == info_a.rebuild_advised);
    ht_assert_near(info_b.cost, info_a.cost, 1e-4 * (double)info_a.cost);
    (void)expect_same_hits(&a, &b);
    move(&b, &first);
    assert_int_equal(info_of(&b).meshes_refitted, 1);
    (void)expect_like_fresh(&b, &first);
    free(saved.data);
    close_world(&a);
    close_world(&b);
    ht_mesh_free(&first);
    ht_mesh_free(&now);
}

/* Nothing to save is a blob too; two blobs add up; what is not used is forgotten. */
static void test_load_several_blobs(void **state) {
    (void)state;
    ht_mesh one = some_mesh(1), two = some_mesh(0);
    world a, b, c;
    open_world(&a, 1);
    ht_ok(a.host.context, hydra_scene_commit(a.scene));
    blob empty = save(&a);
    close_world(&a);
    open_mesh(&a, &one, true, HYDRA_BUILD_AUTO);
    open_mesh(&b, &two, true, HYDRA_BUILD_AUTO);
    blob saved_a = save(&a), saved_b = save(&b);
    open_world(&c, 1);
    c.mesh = add_mesh(&c, &two, true, HYDRA_BUILD_AUTO);
    (void)add_mesh(&c, &one, true, HYDRA_BUILD_AUTO);
    ht_ok(c.host.context, hydra_scene_load_trees(c.scene, saved_a.data, saved_a.size));
    ht_ok(c.host.context, hydra_scene_load_trees(c.scene, empty.data, empty.size));
    ht_ok(c.host.context, hydra_scene_load_trees(c.scene, saved_b.data, saved_b.size));
    ht_ok(c.host.context, hydra_scene_load_trees(c.scene, saved_b.data, saved_b.size));
    ht_ok(c.host.context, hydra_scene_commit(c.scene));
    assert_int_equal(info_of(&c).trees_loaded, 2);
    assert_int_equal(info_of(&c).meshes_built, 0);
    ht_ok(c.host.context, hydra_scene_rebuild_mesh(c.scene, c.mesh));
    ht_ok(c.host.context, hydra_scene_commit(c.scene));
    assert_int_equal(info_of(&c).trees_loaded, 0);
    assert_int_equal(info_of(&c).meshes_built, 1);
    ht_ok(c.host.context, hydra_scene_load_trees(c.scene, saved_b.data, saved_b.size)); /* freed with the scene */
    free(saved_a.data);
    free(saved_b.data);
    free(empty.data);
    close_world(&a);
    close_world(&b);
    close_world(&c);
    ht_mesh_free(&one);
    ht_mesh_free(&two);
}

static void test_save_errors(void **state) {
    (void)state;
    ht_mesh ball = ht_icosphere(1.0f, 1);
    world w;
    open_world(&w, 1);
    w.mesh = add_mesh(&w, &ball, false, HYDRA_BUILD_AUTO);
    size_t size = 0;
    assert_int_equal(hydra_scene_save_trees(w.scene, NULL, &size), HYDRA_ERROR_NOT_COMMITTED);
    assert_int_equal(hydra_scene_save_trees(NULL, NULL, &size), HYDRA_ERROR_NULL);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    assert_int_equal(hydra_scene_save_trees(w.scene, NULL, NULL), HYDRA_ERROR_NULL);
    blob saved = save(&w);
    uint8_t *small = (uint8_t *)malloc(saved.size);
    memset(small, 0xee, saved.size);
    size = saved.size - 1;
    assert_int_equal(hydra_scene_save_trees(w.scene, small, &size), HYDRA_ERROR_BUFFER);
    assert_int_equal(size, saved.size);
    for (size_t i = 0; i < saved.size; i++) assert_int_equal(small[i], 0xee);
    assert_int_equal(hydra_scene_load_trees(w.scene, NULL, saved.size), HYDRA_ERROR_NULL);
    assert_int_equal(hydra_scene_load_trees(NULL, saved.data, saved.size), HYDRA_ERROR_NULL);
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.width = desc.height = 8;
    hydra_render *r = hydra_render_create(w.scene, &desc);
    assert_int_equal(hydra_scene_load_trees(w.scene, saved.data, saved.size), HYDRA_ERROR_BUSY);
    hydra_render_destroy(r);
    free(small);
    free(saved.data);
    close_world(&w);
    ht_mesh_free(&ball);
}

/* ---------------------------------------------------------------- damage and forgery */

/* A load that must be refused with nothing changed; the bytes lie in a block of just their size. */
static void expect_refused(const world *w, const uint8_t *data, size_t size) {
    uint8_t *exact = (uint8_t *)malloc(size ? size : 1);
    int64_t blocks = w->host.memory.blocks_now;
    size_t before = w->scene->loaded_count;
    memcpy(exact, data, size);
    hydra_result result = hydra_scene_load_trees(w->scene, exact, size);
    if (result != HYDRA_ERROR_TREE_FORMAT) fail_msg("%zu bytes gave %d", size, (int)result);
    assert_int_equal(w->scene->loaded_count, before);
    if (before) assert_int_equal(w->host.memory.blocks_now, blocks);
    free(exact);
}

/* Catches: bytes that the checksum does not cover, and reads beyond the end. */
static void test_damaged(void **state) {
    (void)state;
    ht_mesh mesh = some_mesh(0);
    mesh.index_count = 3 * 60;
    world w;
    open_mesh(&w, &mesh, true, HYDRA_BUILD_AUTO);
    blob saved = save(&w);
    ht_ok(w.host.context, hydra_scene_load_trees(w.scene, saved.data, saved.size)); /* one waits all the while */
    for (size_t i = 0; i < saved.size; i++) {
        uint8_t keep = saved.data[i];
        saved.data[i] ^= (uint8_t)(1u << i % 8);
        expect_refused(&w, saved.data, saved.size);
        saved.data[i] = (uint8_t)~keep;
        expect_refused(&w, saved.data, saved.size);
        saved.data[i] = keep;
    }
    for (size_t size = 0; size < saved.size; size++) {
        expect_refused(&w, saved.data, size);
        if (size > sizeof(hyi_trees_header)) assert_non_null(strstr(hydra_error_text(w.host.context), "bytes of"));
    }
    uint8_t *longer = (uint8_t *)calloc(saved.size + 64, 1);
    memcpy(longer, saved.data, saved.size);
    for (size_t more = 1; more <= 64; more++) expect_refused(&w, longer, saved.size + more);
    ht_ok(w.host.context, hydra_scene_rebuild_mesh(w.scene, w.mesh));
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    assert_int_equal(info_of(&w).trees_loaded, 1);
    free(longer);
    free(saved.data);
    close_world(&w);
    ht_mesh_free(&mesh);
}

static void set_child(hyi_node *node, uint32_t c, uint32_t child) {
    for (int a = 0; a < 3; a++) node->planes[2 * a][c] = 0, node->planes[2 * a + 1][c] = 1;
    node->child[c] = child;
}

static void forge_checksum(blob *saved) {
    uint64_t sum = hyi_hash(HYI_TREES_MAGIC, saved->data + HYI_TREES_CHECKED_FROM, saved->size - HYI_TREES_CHECKED_FROM);
    memcpy(saved->data + offsetof(hyi_trees_header, checksum), &sum, sizeof sum);
}

/* Loads bytes whose checksum fits and, if they pass for a tree, uses it as hard as can be. */
static bool use_forged(world *w, const blob *saved, const hydra_ray rays[RAYS], const ht_mesh *mesh) {
    static hydra_hit hits[RAYS];
    static uint8_t blocked[RAYS];
    hydra_result result = hydra_scene_load_trees(w->scene, saved->data, saved->size);
    if (result != HYDRA_OK) assert_int_equal(result, HYDRA_ERROR_TREE_FORMAT);
    if (result != HYDRA_OK) return false;
    ht_ok(w->host.context, hydra_scene_rebuild_mesh(w->scene, w->mesh));
    ht_ok(w->host.context, hydra_scene_commit(w->scene));
    if (info_of(w).trees_loaded == 0) return false;
    assert_int_equal(hydra_scene_closest_hits(w->scene, rays, hits, RAYS), HYDRA_OK);
    assert_int_equal(hydra_scene_any_hits(w->scene, rays, blocked, RAYS), HYDRA_OK);
    for (int i = 0; i < RAYS; i++) assert_true(hits[i].t < 0 || (ht_finite(hits[i].t) && hits[i].primitive < mesh->index_count / 3));
    move(w, mesh); /* a refit walks it too, and mends its boxes */
    if (info_of(w).meshes_refitted) (void)expect_like_fresh(w, mesh);
    return true;
}

/* Every byte changed in several ways under a checksum that fits. Catches: indices, counts, depths and boxes that are
   believed. Run under the sanitizers. */
static void test_forged(void **state) {
    (void)state;
    static hydra_ray rays[RAYS];
    ht_mesh mesh = some_mesh(0);
    mesh.index_count = 3 * 60;
    world w;
    open_mesh(&w, &mesh, true, HYDRA_BUILD_AUTO);
    hydra_scene_info info = info_of(&w);
    make_rays(&info, rays);
    blob saved = save(&w);
    uint32_t used = 0, tried = 0;
    for (size_t i = HYI_TREES_CHECKED_FROM; i < saved.size; i += ht_pick(1, 3)) {
        static const uint8_t changes[] = {0x01, 0x80, 0xff};
        uint8_t keep = saved.data[i];
        for (size_t k = 0; k < sizeof changes; k++, tried++) {
            saved.data[i] = keep ^ changes[k];
            forge_checksum(&saved);
            used += use_forged(&w, &saved, rays, &mesh) ? 1u : 0u;
        }
        saved.data[i] = keep;
    }
    assert_true(used > tried / 20 && used < tried); /* low bits of boxes pass for a tree */
    forge_checksum(&saved);
    assert_true(use_forged(&w, &saved, rays, &mesh));
    free(saved.data);
    close_world(&w);
    ht_mesh_free(&mesh);
}

/* Trees that are wrong in one thing that bytes alone seldom hit, each refused. Catches: loops, shared nodes, stacks that
   overflow, unused children that can be entered. */
static void test_forged_structure(void **state) {
    (void)state;
    ht_mesh mesh = some_mesh(0);
    world w;
    open_mesh(&w, &mesh, true, HYDRA_BUILD_AUTO);
    blob good = save(&w), bad = save(&w);
    size_t at = sizeof(hyi_trees_header), nodes_at = at + sizeof(hyi_tree_record);
    assert_true(w.scene->meshes[0].bvh.node_count > 3);
    for (int kind = 0; kind < 16; kind++) {
        memcpy(bad.data, good.data, good.size);
        hyi_trees_header header;
        hyi_tree_record record;
        hyi_bvh bvh;
        memcpy(&header, bad.data, sizeof header);
        memcpy(&record, bad.data + at, sizeof record);
        memset(&bvh, 0, sizeof bvh);
        bvh.node_count = record.node_count;
        bvh.nodes = (hyi_node *)malloc(record.node_count * sizeof *bvh.nodes);
        uint32_t *ids = (uint32_t *)malloc(record.slot_count * sizeof *ids);
        memcpy(bvh.nodes, bad.data + nodes_at, record.node_count * sizeof *bvh.nodes);
        memcpy(ids, bad.data + nodes_at + record.node_count * sizeof *bvh.nodes, record.slot_count * sizeof *ids);
        uint32_t inner = 0, leaf_node = 0, leaf_child = 0, spare_node = 0, spare_child = HYI_WIDTH, *last_leaf = NULL, *large_leaf = NULL;
        while (hyi_child_is_leaf(bvh.nodes[0].child[inner])) inner++;
        for (uint32_t n = 0; n < record.node_count; n++) {
            for (uint32_t c = 0; c < HYI_WIDTH; c++) {
                uint32_t child = hyi_node_child(&bvh, n, c);
                if (child == HYI_CHILD_NONE && n + 1u < record.node_count) spare_node = n, spare_child = c;
                if (child == HYI_CHILD_NONE) break;
                if (!hyi_child_is_leaf(child)) continue;
                leaf_node = n, leaf_child = c;
                if (hyi_leaf_first(child) + hyi_leaf_count(child) == record.slot_count) last_leaf = &bvh.nodes[n].child[c];
                else if (hyi_leaf_count(child) > 1) large_leaf = &bvh.nodes[n].child[c];
            }
        }
        assert_true(spare_child < HYI_WIDTH && last_leaf && large_leaf && hyi_leaf_count(*last_leaf) < HYI_LEAF_MAX);
        uint32_t *leaf = &bvh.nodes[leaf_node].child[leaf_child];
        switch (kind) {
        case 0: bvh.nodes[0].child[inner] = 0; break;                                 /* its own child */
        case 1: bvh.nodes[0].child[inner] = record.node_count; break;                 /* beyond the end */
        case 2: bvh.nodes[0].child[inner] ^= 1u; break;                               /* one node twice, one never */
        case 3: *leaf = hyi_make_leaf(record.slot_count - 1u, hyi_leaf_count(*leaf)); break;
        case 4: *leaf = HYI_CHILD_LEAF | 7u << 28 | HYI_CHILD_SLOT; break;
        case 5: *leaf = bvh.nodes[0].child[inner]; break;
        case 6: bvh.nodes[spare_node].child[spare_child] = *leaf; break;              /* a leaf twice */
        case 7: bvh.nodes[0].planes[3][inner] = NAN; break;
        case 8: bvh.nodes[0].planes[2][inner] = -INFINITY; break;
        case 9:                                                                       /* no child, with a box */
            for (int a = 0; a < 3; a++) bvh.nodes[spare_node].planes[2 * a][spare_child] = -1, bvh.nodes[spare_node].planes[2 * a + 1][spare_child] = 1;
            break;
        case 10: ids[0] = record.triangle_count; break;
        case 11: ids[0] = ids[1]; break;                                              /* a triangle less */
        case 12: record.root = 1; break;
        case 13: set_child(&bvh.nodes[spare_node], spare_child, record.node_count - 1u); break; /* reached twice */
        case 14:                                                                      /* as many slots, but one beyond the end */
            *last_leaf = hyi_make_leaf(hyi_leaf_first(*last_leaf), hyi_leaf_count(*last_leaf) + 1u);
            *large_leaf = hyi_make_leaf(hyi_leaf_first(*large_leaf), hyi_leaf_count(*large_leaf) - 1u);
            break;
        default: header.tree_count = 0xffffffffu; break;
        }
        memcpy(bad.data, &header, sizeof header);
        memcpy(bad.data + at, &record, sizeof record);
        memcpy(bad.data + nodes_at, bvh.nodes, record.node_count * sizeof *bvh.nodes);
        memcpy(bad.data + nodes_at + record.node_count * sizeof *bvh.nodes, ids, record.slot_count * sizeof *ids);
        forge_checksum(&bad);
        expect_refused(&w, bad.data, bad.size);
        free(bvh.nodes);
        free(ids);
    }
    free(good.data);
    free(bad.data);
    close_world(&w);
    ht_mesh_free(&mesh);
}

/* A chain of nodes as deep as stacks allow is taken, one deeper refused. */
static hydra_result load_chain(world *w, uint32_t depth) {
    hyi_trees_header header;
    hyi_tree_record record;
    hyi_bvh bvh;
    memset(&header, 0, sizeof header);
    memset(&record, 0, sizeof record);
    memset(&bvh, 0, sizeof bvh);
    hyi_node *nodes = (hyi_node *)calloc(depth, sizeof *nodes);
    uint32_t *ids = (uint32_t *)calloc(depth + 1u, sizeof *ids);
    for (uint32_t n = 0; n < depth; n++) {
        hyi_clear_node(&nodes[n]);
        set_child(&nodes[n], 0, hyi_make_leaf(n, 1));
        set_child(&nodes[n], 1, n + 1u < depth ? n + 1u : hyi_make_leaf(depth, 1));
    }
    for (uint32_t i = 0; i <= depth; i++) ids[i] = i;
    bvh.nodes = nodes;
    bvh.ids = ids;
    bvh.node_count = depth;
    bvh.slot_count = bvh.primitive_count = record.triangle_count = depth + 1u;
    bvh.scale = 1;
    header.magic = HYI_TREES_MAGIC;
    header.version = HYI_TREES_VERSION;
    header.layout = hyi_trees_layout();
    header.tree_count = 1;
    header.size = sizeof header + hyi_tree_bytes(&bvh);
    blob forged = {(uint8_t *)malloc((size_t)header.size), (size_t)header.size};
    (void)hyi_put_tree(hyi_put(forged.data, &header, sizeof header), &bvh, record);
    forge_checksum(&forged);
    hydra_result result = hydra_scene_load_trees(w->scene, forged.data, forged.size);
    free(forged.data);
    free(nodes);
    free(ids);
    return result;
}

static void test_forged_depth(void **state) {
    (void)state;
    world w;
    open_world(&w, 1);
    ht_ok(w.host.context, load_chain(&w, HYI_TREE_DEPTH));
    assert_int_equal(load_chain(&w, HYI_TREE_DEPTH + 1u), HYDRA_ERROR_TREE_FORMAT);
    assert_int_equal(load_chain(&w, 300), HYDRA_ERROR_TREE_FORMAT);
    close_world(&w);
}

/* ---------------------------------------------------------------- memory */

/* Moves, commits, saves, loads, commits: once through, counting; then with each allocation failing in turn, when the same
   call made again must succeed. Returns the number of allocations. */
static int64_t live_through(int64_t fail_at, const blob *saved, const ht_mesh *first, const ht_mesh *now) {
    world w, fresh;
    uint32_t failures = 0;
    hydra_result result;
    open_several(&fresh, 0);
    (void)add_mesh(&fresh, now, true, HYDRA_BUILD_AUTO);
    ht_ok(fresh.host.context, hydra_scene_commit(fresh.scene));
    open_several(&w, 0);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    w.mesh = add_mesh(&w, first, true, HYDRA_BUILD_AUTO);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    int64_t before = w.host.memory.calls;
    w.host.memory.fail_at = fail_at ? before + fail_at : 0;
    for (int step = 0; step < 6;) {
        if (step == 0) result = hydra_scene_move_vertices(w.scene, w.mesh, view_of(now->positions, now->vertex_count), nothing());
        else if (step == 2) result = hydra_scene_load_trees(w.scene, saved->data, saved->size);
        else if (step == 3) result = hydra_scene_rebuild_mesh(w.scene, w.mesh);
        else if (step == 4) result = hydra_scene_rebuild_mesh(w.scene, (hydra_mesh){1});
        else result = hydra_scene_commit(w.scene);
        failures += result != HYDRA_OK ? 1u : 0u;
        if (result != HYDRA_OK) assert_int_equal(result, HYDRA_ERROR_OUT_OF_MEMORY);
        step += result == HYDRA_OK ? 1 : 0;
        if (step == 2 && result == HYDRA_OK) { /* rays take memory too, which is not what is tried here */
            ht_memory counts = w.host.memory;
            w.host.memory.fail_at = 0;
            (void)expect_same_hits(&w, &fresh);
            w.host.memory.fail_at = counts.fail_at;
            w.host.memory.calls = counts.calls;
        }
        assert_true(failures <= 1);
    }
    assert_int_equal(failures, fail_at && w.host.memory.calls >= before + fail_at ? 1 : 0);
    uint32_t made = info_of(&w).meshes_built + info_of(&w).trees_loaded;
    assert_true(made == 2 || (failures && made <= 2)); /* a commit that failed may have made one already */
    int64_t calls = w.host.memory.calls - before;
    (void)expect_same_hits(&w, &fresh);
    close_world(&w);
    close_world(&fresh);
    return calls;
}

/* Catches: NULL followed, trees lost or half taken on the way out, commits that cannot be repeated. */
static void test_every_allocation_fails(void **state) {
    (void)state;
    ht_mesh first = some_mesh(1), now = copy_of(&first);
    memcpy(first.positions + 3 * first.indices[0], first.positions + 3 * first.indices[1], 12); /* so that triangles are counted, */
    memcpy(now.positions, first.positions, (size_t)first.vertex_count * 12);
    ht_mesh_place(&now, 1.1f, 0, 4, 0);
    world w;
    open_several(&w, 0);
    (void)add_mesh(&w, &now, true, HYDRA_BUILD_AUTO);
    ht_ok(w.host.context, hydra_scene_commit(w.scene));
    blob saved = save(&w);
    close_world(&w);
    int64_t calls = live_through(0, &saved, &first, &now);
    assert_true(calls > 20 && calls < 2000);
    for (int64_t n = 1; n <= calls; n += (int64_t)ht_pick(1, 4)) (void)live_through(n, &saved, &first, &now);
    free(saved.data);
    ht_mesh_free(&first);
    ht_mesh_free(&now);
}

/* A cap that a load would pass refuses it, and nothing is kept. */
static void test_load_under_a_cap(void **state) {
    (void)state;
    ht_mesh mesh = some_mesh(2);
    world w, capped;
    open_mesh(&w, &mesh, true, HYDRA_BUILD_AUTO);
    blob saved = save(&w);
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    memset(&capped, 0, sizeof capped);
    desc.threads = 1;
    desc.memory_cap = saved.size / 2;
    assert_non_null(ht_open(&capped.host, &desc));
    capped.scene = hydra_scene_create(capped.host.context);
    int64_t bytes = capped.host.memory.bytes_now;
    assert_int_equal(hydra_scene_load_trees(capped.scene, saved.data, saved.size), HYDRA_ERROR_MEMORY_CAP);
    assert_true(capped.host.memory.bytes_peak <= (int64_t)desc.memory_cap);
    assert_true(capped.host.memory.bytes_now < bytes + 4096); /* the list itself may have grown */
    close_world(&capped);
    close_world(&w);
    free(saved.data);
    ht_mesh_free(&mesh);
}

int hydra_test_trees(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_moved_like_fresh), cmocka_unit_test(test_moved_to_other_sizes), cmocka_unit_test(test_collapse_and_back),
        cmocka_unit_test(test_collapse_of_some), cmocka_unit_test(test_dropped_triangles_return), cmocka_unit_test(test_same_for_any_threads),
        cmocka_unit_test(test_scene_follows), cmocka_unit_test(test_moved_normals), cmocka_unit_test(test_move_errors),
        cmocka_unit_test(test_quality_report), cmocka_unit_test(test_report_of_shared), cmocka_unit_test(test_build_choice),
        cmocka_unit_test(test_load_what_was_saved), cmocka_unit_test(test_load_refitted), cmocka_unit_test(test_load_several_blobs),
        cmocka_unit_test(test_save_errors), cmocka_unit_test(test_damaged), cmocka_unit_test(test_forged),
        cmocka_unit_test(test_forged_structure), cmocka_unit_test(test_forged_depth), cmocka_unit_test(test_every_allocation_fails),
        cmocka_unit_test(test_load_under_a_cap)};
    return cmocka_run_group_tests_name("trees", tests, NULL, NULL);
}
