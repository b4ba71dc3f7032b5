/* The trees and their traversals: against brute force, against each other, against exact geometry. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

/* ---- a context made by hand: no thread of its own */

typedef struct tb_host {
    hydra_context context;
    ht_memory memory;
} tb_host;

static void tb_open(tb_host *host) {
    memset(host, 0, sizeof *host);
    host->context.desc.allocator = ht_memory_allocator(&host->memory);
    host->context.threads = 1;
}

static void tb_close(tb_host *host) {
    assert_int_equal(host->memory.blocks_now, 0);
    assert_int_equal(host->memory.bytes_now, 0);
    assert_int_equal(host->memory.damaged, 0);
    assert_int_equal(hyi_atomic_load(&host->context.bytes_now), 0);
}

/* ---- scenes of a few instances */

#define TB_MESHES 4
#define TB_INSTANCES 12

typedef struct tb_scene {
    tb_host host;
    ht_mesh mesh[TB_MESHES];
    uint32_t mesh_count, instance_count;
    hyi_bvh bvh[TB_MESHES], top;
    hyk_instance instances[TB_INSTANCES];
    hyk_scene_view view;
    hyi_accel accel;
} tb_scene;

static void tb_build_mesh(tb_scene *s, ht_mesh mesh) {
    uint32_t m = s->mesh_count++;
    s->mesh[m] = mesh;
    assert_int_equal(hyi_bvh_build_triangles(&s->host.context, mesh.positions, mesh.indices, mesh.index_count / 3, HYDRA_BUILD_BEST, &s->bvh[m]), HYDRA_OK);
}

static hydra_isa tb_best_isa(void) { return hyi_best_isa(); }

static void tb_begin(tb_scene *s) {
    memset(s, 0, sizeof *s);
    tb_open(&s->host);
    s->view.instances = s->instances;
    s->accel.view = &s->view;
    s->accel.meshes = s->bvh;
    s->accel.instances = &s->top;
    s->accel.isa = tb_best_isa();
}

/* A scene of one unmoved mesh; takes the mesh over. */
static void tb_single(tb_scene *s, ht_mesh mesh) {
    tb_begin(s);
    tb_build_mesh(s, mesh);
    s->instances[0].flags = HYK_INSTANCE_IDENTITY;
    s->instance_count = 1;
    s->accel.single = true;
}

static void tb_end(tb_scene *s) {
    for (uint32_t m = 0; m < s->mesh_count; m++) {
        hyi_bvh_free(&s->host.context, &s->bvh[m]);
        ht_mesh_free(&s->mesh[m]);
    }
    hyi_bvh_free(&s->host.context, &s->top);
    tb_close(&s->host);
}

/* Places mesh m by a 3x3 matrix and a translation; the inverse by cofactors in double. */
static void tb_place(tb_scene *s, uint32_t m, const double a[9], const double t[3]) {
    hyk_instance *p = &s->instances[s->instance_count++];
    double c[9], det;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            c[3 * j + i] = a[3 * i1 + j1] * a[3 * i2 + j2] - a[3 * i1 + j2] * a[3 * i2 + j1];
        }
    }
    det = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
    for (int i = 0; i < 9; i++) c[i] /= det;
    hyk_vec3 *rows[6] = {&p->row0, &p->row1, &p->row2, &p->inverse0, &p->inverse1, &p->inverse2};
    float *shift[6] = {&p->t0, &p->t1, &p->t2, &p->s0, &p->s1, &p->s2};
    for (int r = 0; r < 3; r++) {
        *rows[r] = hyk_make3((float)a[3 * r], (float)a[3 * r + 1], (float)a[3 * r + 2]);
        *shift[r] = (float)t[r];
        *rows[3 + r] = hyk_make3((float)c[3 * r], (float)c[3 * r + 1], (float)c[3 * r + 2]);
        *shift[3 + r] = (float)-(c[3 * r] * t[0] + c[3 * r + 1] * t[1] + c[3 * r + 2] * t[2]);
    }
    p->mesh = m;
}

static void tb_build_top(tb_scene *s) {
    hyi_box boxes[TB_INSTANCES];
    for (uint32_t i = 0; i < s->instance_count; i++) {
        const hyk_instance *p = &s->instances[i];
        const ht_mesh *mesh = &s->mesh[p->mesh];
        boxes[i] = hyi_box_empty();
        for (uint32_t v = 0; v < mesh->vertex_count; v++) {
            const float *x = mesh->positions + 3 * v;
            float w[3] = {hyi_transform_row(p->row0, p->t0, x), hyi_transform_row(p->row1, p->t1, x), hyi_transform_row(p->row2, p->t2, x)};
            hyi_box_add(&boxes[i], w, w);
        }
    }
    assert_int_equal(hyi_bvh_build_boxes(&s->host.context, boxes, s->instance_count, &s->top), HYDRA_OK);
}

/* ---- brute force: every triangle of every instance, no box looked at */

static void tb_brute_leaf(const hyi_site *site, hyi_flight *flight, uint32_t leaf) {
    for (uint32_t i = 0; i < hyi_leaf_count(leaf); i++) (void)hyi_offer(site, flight, leaf, i);
}

static hyk_hit tb_brute(const tb_scene *s, const hyk_ray *ray) {
    hyi_flight above, below;
    hyk_hit hit;
    (void)hyi_flight_begin(&above, &s->bvh[0], ray, FLT_MAX);
    for (uint32_t i = 0; i < s->instance_count; i++) {
        hyi_site site = hyi_site_of_item(&s->accel, i);
        if (!hyi_flight_enter(&below, &above, &site)) continue;
        if (hyi_child_is_leaf(site.bvh->root)) tb_brute_leaf(&site, &below, site.bvh->root);
        for (uint32_t n = 0; n < site.bvh->node_count; n++) {
            for (uint32_t c = 0; c < HYI_WIDTH; c++) {
                if (hyi_child_is_leaf(site.bvh->nodes[n].child[c])) tb_brute_leaf(&site, &below, site.bvh->nodes[n].child[c]);
            }
        }
        above.best = below.best;
    }
    hyi_answer(&s->accel, &above.best, &hit);
    return hit;
}

static hyk_ray tb_ray(const float o[3], const float d[3], float t_min, float t_max) {
    hyk_ray ray;
    ray.origin = hyk_make3(o[0], o[1], o[2]);
    ray.direction = hyk_make3(d[0], d[1], d[2]);
    ray.t_min = t_min;
    ray.t_max = t_max;
    return ray;
}

/* From within a cube to within a cube, of any length; some along axes, some short. */
static hyk_ray tb_random_ray(ht_rng *rng, float size) {
    float o[3], d[3];
    for (int a = 0; a < 3; a++) {
        o[a] = ht_range(rng, -size, size);
        d[a] = ht_range(rng, -size, size) - o[a];
    }
    uint32_t kind = ht_below(rng, 16);
    if (kind < 3) d[kind] = 0;
    if (kind == 3) d[ht_below(rng, 3)] = -0.0f, d[ht_below(rng, 3)] = 1e-41f;
    if (kind == 4) for (int a = 0; a < 3; a++) o[a] = (float)(int)o[a];
    if (d[0] == 0 && d[1] == 0 && d[2] == 0) d[0] = 1;
    return tb_ray(o, d, kind == 5 ? 0.3f : 0, kind == 6 ? 0.7f : INFINITY);
}

#define TB_BATCH 4096
static hyk_ray tb_rays[TB_BATCH];
static hyk_hit tb_hits[TB_BATCH], tb_other[TB_BATCH];
static uint8_t tb_any[TB_BATCH], tb_any_other[TB_BATCH];

/* The batch as a stream, closest and any. */
static void tb_stream_through(tb_scene *s) {
    hyi_ray_stream stream;
    assert_int_equal(hyi_ray_stream_alloc(&s->host.context, &s->accel, TB_BATCH, &stream), HYDRA_OK);
    hyi_trace_closest(&s->accel, &stream, tb_rays, tb_hits, TB_BATCH);
    hyi_trace_any(&s->accel, &stream, tb_rays, tb_any, TB_BATCH);
    hyi_ray_stream_free(&s->host.context, &stream);
}

/* Scalar, vectors, any hit and (on every brute-th ray) brute force all say the same. */
static void tb_compare(tb_scene *s, uint32_t rays, float size, uint32_t brute, uint64_t seed) {
    ht_rng rng = ht_rng_make(seed);
    uint32_t found = 0;
    for (uint32_t done = 0; done < rays; done += TB_BATCH) {
        for (uint32_t i = 0; i < TB_BATCH; i++) tb_rays[i] = tb_random_ray(&rng, size);
        s->accel.isa = HYDRA_ISA_SCALAR;
        hyi_trace_closest(&s->accel, NULL, tb_rays, tb_other, TB_BATCH);
        hyi_trace_any(&s->accel, NULL, tb_rays, tb_any_other, TB_BATCH);
        s->accel.isa = tb_best_isa();
        tb_stream_through(s);
        assert_memory_equal(tb_hits, tb_other, sizeof tb_hits);
        assert_memory_equal(tb_any, tb_any_other, sizeof tb_any);
        for (uint32_t i = 0; i < TB_BATCH; i++) {
            found += tb_hits[i].instance != HYK_NONE;
            assert_int_equal(tb_any[i], tb_hits[i].instance != HYK_NONE);
            if (i % brute) continue;
            hyk_hit truth = tb_brute(s, &tb_rays[i]), one;
            assert_memory_equal(&truth, &tb_hits[i], sizeof truth);
            hyi_trace_closest(&s->accel, NULL, &tb_rays[i], &one, 1);
            assert_memory_equal(&truth, &one, sizeof truth);
        }
    }
    assert_true(found > rays / 100 && found < rays);
}

/* A flat grid in z = 0, all boxes flat and sharing planes. */
static ht_mesh tb_grid(uint32_t n) {
    const float centre[3] = {0, 0, 0}, u[3] = {1, 0, 0}, v[3] = {0, 1, 0};
    return ht_quad(centre, u, v, n);
}

static ht_mesh tb_needles(ht_rng *rng, uint32_t count) {
    ht_mesh mesh = ht_soup(rng, count, 1.0f, 0.001f);
    for (uint32_t t = 0; t < count; t++) {
        float *p = mesh.positions + 3 * mesh.indices[3 * t + 2];
        for (int a = 0; a < 3; a++) p[a] = ht_range(rng, -1, 1);
    }
    return mesh;
}

static void single_meshes_agree_with_brute_force(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(3);
    ht_mesh meshes[5];
    meshes[0] = ht_icosphere(1, 3);
    meshes[1] = ht_soup(&rng, 3000, 1.0f, 0.1f);
    meshes[2] = tb_needles(&rng, 2000);
    meshes[3] = tb_grid(32);
    meshes[4] = ht_torus(0.7f, 0.25f, 32, 16);
    for (int m = 0; m < 5; m++) {
        static tb_scene s;
        tb_single(&s, meshes[m]);
        tb_compare(&s, ht_pick(10 * TB_BATCH, TB_BATCH), 1.2f, 97, 11 + (uint64_t)m);
        tb_end(&s);
    }
}

static void instances_agree_with_brute_force(void **state) {
    (void)state;
    static tb_scene s;
    ht_rng rng = ht_rng_make(5);
    tb_begin(&s);
    tb_build_mesh(&s, ht_icosphere(1, 2));
    tb_build_mesh(&s, ht_soup(&rng, 500, 1.0f, 0.2f));
    tb_build_mesh(&s, tb_grid(8));
    memset(&s.mesh[3], 0, sizeof s.mesh[3]);
    tb_build_mesh(&s, s.mesh[3]); /* empty */
    for (uint32_t i = 0; i < TB_INSTANCES; i++) {
        double a[9], t[3];
        for (int k = 0; k < 9; k++) a[k] = 0.4 * (double)ht_range(&rng, -1, 1) + (k % 4 == 0 ? (i % 3 ? 0.5 : -0.5) : 0);
        for (int k = 0; k < 3; k++) {
            t[k] = (double)ht_range(&rng, -2, 2);
            a[3 * k] *= i == 4 ? 1e-3 : 1;
        }
        tb_place(&s, i % 4, a, t);
    }
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, zero[3] = {0, 0, 0};
    s.instance_count -= 2; /* the last two: one mesh twice at the same place: ties */
    tb_place(&s, 0, unit, zero);
    tb_place(&s, 0, unit, zero);
    tb_build_top(&s);
    tb_compare(&s, ht_pick(40 * TB_BATCH, TB_BATCH), 3.0f, 97, 17);
    for (uint32_t i = 0; i < TB_BATCH; i++) assert_true(tb_hits[i].instance != TB_INSTANCES - 1);
    tb_end(&s);
}

/* ---- watertightness */

/* A point on edge or vertex of a random triangle, and the triangle's unit normal; for a box the way from its
   middle, which has all faces of the seam on one side: no seam may be an outline as the ray sees it. */
static void tb_seam(const ht_mesh *mesh, ht_rng *rng, float p[3], float n[3]) {
    bool box = mesh->index_count == 36;
    const uint32_t *t = mesh->indices + 3 * ht_below(rng, mesh->index_count / 3);
    uint32_t e = ht_below(rng, 3);
    const float *a = mesh->positions + 3 * t[e], *b = mesh->positions + 3 * t[(e + 1) % 3], *c = mesh->positions + 3 * t[(e + 2) % 3];
    float f = ht_below(rng, 4) ? ht_uniform(rng) : 0.0f;
    for (int i = 0; i < 3; i++) p[i] = a[i] + f * (b[i] - a[i]);
    hyk_vec3 va = hyk_make3(a[0], a[1], a[2]);
    hyk_vec3 ab = hyk_normalize(hyk_sub(hyk_make3(b[0], b[1], b[2]), va)), ac = hyk_normalize(hyk_sub(hyk_make3(c[0], c[1], c[2]), va));
    hyk_vec3 m = hyk_normalize(hyk_cross(ab, ac));
    n[0] = box ? p[0] : m.x;
    n[1] = box ? p[1] : m.y;
    n[2] = box ? p[2] : m.z;
}

/* Misses among rays aimed at seams, from about depth outside of the face (negative: inside). */
static uint32_t tb_leaks(tb_scene *s, uint32_t rays, float depth, uint64_t seed) {
    ht_rng rng = ht_rng_make(seed);
    uint32_t leaks = 0;
    for (uint32_t done = 0; done < rays; done += TB_BATCH) {
        for (uint32_t i = 0; i < TB_BATCH; i++) {
            float p[3], n[3], o[3], d[3], reach = depth * ht_range(&rng, 0.5f, 1);
            tb_seam(&s->mesh[0], &rng, p, n);
            for (int a = 0; a < 3; a++) {
                o[a] = p[a] + reach * (n[a] + ht_range(&rng, -0.2f, 0.2f));
                d[a] = p[a] - o[a];
            }
            tb_rays[i] = tb_ray(o, d, 0, INFINITY);
        }
        tb_stream_through(s);
        for (uint32_t i = 0; i < TB_BATCH; i++) leaks += tb_hits[i].instance == HYK_NONE;
    }
    return leaks;
}

static void closed_meshes_do_not_leak(void **state) {
    (void)state;
    const float low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    ht_mesh meshes[3];
    meshes[0] = ht_icosphere(1, 4);
    meshes[1] = ht_torus(1, 0.4f, 64, 32);
    meshes[2] = ht_box(low, high);
    for (int m = 0; m < 3; m++) {
        static tb_scene s;
        tb_single(&s, meshes[m]);
        assert_int_equal(tb_leaks(&s, ht_pick(1650000, 50000), -0.3f, 21), 0);
        assert_int_equal(tb_leaks(&s, ht_pick(1650000, 50000), 2.0f, 22), 0);
        s.accel.isa = HYDRA_ISA_SCALAR;
        assert_int_equal(tb_leaks(&s, ht_pick(165000, 20000), -0.3f, 23), 0);
        assert_int_equal(tb_leaks(&s, ht_pick(165000, 20000), 2.0f, 24), 0);
        tb_end(&s);
    }
}

/* Share of a box that lies inside, by the parity of crossings, against the mesh's own volume (TRUTH E.1). */
static void parity_gives_the_volume(void **state) {
    (void)state;
    static tb_scene s;
    ht_rng rng = ht_rng_make(31);
    tb_single(&s, ht_torus(1, 0.4f, 48, 24));
    double volume = 0;
    for (uint32_t t = 0; t < s.mesh[0].index_count / 3; t++) {
        const float *p[3];
        for (int k = 0; k < 3; k++) p[k] = s.mesh[0].positions + 3 * s.mesh[0].indices[3 * t + (uint32_t)k];
        volume += ((double)p[0][0] * ((double)p[1][1] * (double)p[2][2] - (double)p[1][2] * (double)p[2][1]) +
                   (double)p[0][1] * ((double)p[1][2] * (double)p[2][0] - (double)p[1][0] * (double)p[2][2]) +
                   (double)p[0][2] * ((double)p[1][0] * (double)p[2][1] - (double)p[1][1] * (double)p[2][0])) / 6;
    }
    ht_stats inside;
    memset(&inside, 0, sizeof inside);
    for (uint32_t i = 0; i < ht_pick(200000, 20000); i++) {
        float o[3] = {ht_range(&rng, -1.5f, 1.5f), ht_range(&rng, -0.5f, 0.5f), ht_range(&rng, -1.5f, 1.5f)}, d[3];
        ht_direction(&rng, d);
        hyk_ray ray = tb_ray(o, d, 0, INFINITY);
        uint32_t crossings = 0;
        for (hyk_hit hit; crossings < 100; crossings++) {
            hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
            if (hit.instance == HYK_NONE) break;
            ray.t_min = nextafterf(hit.t, INFINITY); /* the other triangle of a seam lies at the same t */
        }
        ht_add(&inside, crossings % 2 ? 9.0 : 0.0);
    }
    ht_assert_mean(&inside, volume, 0.05);
    tb_end(&s);
}

/* ---- numbers */

/* t by long double, from the float inputs; also whether the ray surely hits, well away from the edges. */
static bool tb_exact(const float *p[3], const hyk_ray *ray, long double *t) {
    const float o[3] = {ray->origin.x, ray->origin.y, ray->origin.z}, d[3] = {ray->direction.x, ray->direction.y, ray->direction.z};
    long double e[3], f[3], s[3], q[3], r[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (long double)p[1][i] - (long double)p[0][i];
        f[i] = (long double)p[2][i] - (long double)p[0][i];
        s[i] = (long double)o[i] - (long double)p[0][i];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        q[i] = (long double)d[j] * f[k] - (long double)d[k] * f[j];
        r[i] = s[j] * e[k] - s[k] * e[j];
    }
    long double det = e[0] * q[0] + e[1] * q[1] + e[2] * q[2];
    long double u = (s[0] * q[0] + s[1] * q[1] + s[2] * q[2]) / det;
    long double v = ((long double)d[0] * r[0] + (long double)d[1] * r[1] + (long double)d[2] * r[2]) / det;
    *t = (f[0] * r[0] + f[1] * r[1] + f[2] * r[2]) / det;
    return u > 1e-4L && v > 1e-4L && u + v < 1 - 1e-4L && *t > 0;
}

/* Well-shaped triangles, not seen edge on: 8 ulp. Slivers and grazing ones: the worst is printed. */
static void distances_are_exact_to_a_few_ulps(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(41);
    double worst = 0, worst_sliver = 0;
    uint32_t tried = 0;
    for (uint32_t i = 0; i < ht_pick(20000, 2000); i++) {
        static tb_scene s;
        bool sliver = i % 4 == 3;
        ht_mesh mesh = ht_soup(&rng, 1, 0.0f, 1.0f);
        if (sliver) for (int a = 0; a < 3; a++) mesh.positions[6 + a] = mesh.positions[3 + a] + 1e-4f * mesh.positions[6 + a];
        const float *p[3] = {mesh.positions, mesh.positions + 3, mesh.positions + 6};
        float o[3], d[3], b1 = ht_range(&rng, 0.1f, 0.45f), b2 = ht_range(&rng, 0.1f, 0.45f);
        for (int a = 0; a < 3; a++) {
            o[a] = ht_range(&rng, -3, 3);
            d[a] = p[0][a] + b1 * (p[1][a] - p[0][a]) + b2 * (p[2][a] - p[0][a]) - o[a];
        }
        hyk_ray ray = tb_ray(o, d, 0, INFINITY);
        hyk_vec3 e = hyk_make3(p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2]);
        hyk_vec3 f = hyk_make3(p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2]);
        float facing = hyk_abs(hyk_dot(hyk_normalize(hyk_cross(e, f)), hyk_normalize(ray.direction)));
        float shape = hyk_length(hyk_cross(e, f)) / hyk_max(hyk_dot(e, e), hyk_dot(f, f));
        long double t;
        bool sure = tb_exact(p, &ray, &t), well = facing > 0.4f && shape > 0.2f && !sliver;
        tb_single(&s, mesh);
        hyk_hit hit;
        hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
        if (sure && well) assert_int_equal(hit.instance, 0);
        if (sure && hit.instance == 0) {
            double ulps = fabs((double)(((long double)hit.t - t) / t)) / (double)FLT_EPSILON;
            if (well && ulps > worst) worst = ulps;
            if (!well && ulps > worst_sliver) worst_sliver = ulps;
            tried += well;
        }
        tb_end(&s);
    }
    print_message("           t: %.2f ulp well-shaped, %.0f ulp slivers and grazing\n", worst, worst_sliver);
    assert_true(tried > ht_pick(2000, 200));
    assert_true(worst <= 8);
}

/* Van Oosterom and Strackee 1983 (TRUTH E.3). */
static void rays_count_the_solid_angle(void **state) {
    (void)state;
    static tb_scene s;
    ht_rng rng = ht_rng_make(43);
    ht_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    ht_mesh_vertex(&mesh, 1.0f, -0.5f, 0.25f);
    ht_mesh_vertex(&mesh, 0.5f, 1.0f, -0.5f);
    ht_mesh_vertex(&mesh, -0.25f, 0.5f, 1.5f);
    ht_mesh_triangle(&mesh, 0, 1, 2);
    double v[3][3], length[3], dot[3];
    for (int i = 0; i < 9; i++) v[i / 3][i % 3] = (double)mesh.positions[i];
    for (int i = 0; i < 3; i++) {
        const double *a = v[i], *b = v[(i + 1) % 3];
        length[i] = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        dot[i] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }
    double triple = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) + v[0][1] * (v[1][2] * v[2][0] - v[1][0] * v[2][2]) +
                    v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
    double below = length[0] * length[1] * length[2] + dot[0] * length[2] + dot[1] * length[0] + dot[2] * length[1];
    double angle = 2 * atan2(fabs(triple), below);
    ht_stats share;
    memset(&share, 0, sizeof share);
    tb_single(&s, mesh);
    for (uint32_t i = 0; i < ht_pick(400000, 40000); i++) {
        const float o[3] = {0, 0, 0};
        float d[3];
        ht_direction(&rng, d);
        hyk_ray ray = tb_ray(o, d, 0, INFINITY);
        hyk_hit hit;
        hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
        ht_add(&share, hit.instance == 0 ? 4 * HT_PI : 0.0);
    }
    ht_assert_mean(&share, angle, 0.03);
    tb_end(&s);
}

/* The same picture in any size and place. */
static void scale_and_place_do_not_matter(void **state) {
    (void)state;
    const float sizes[] = {1e-18f, 1e-10f, 1e-4f, 1e5f, 1e12f, 1e18f};
    for (uint32_t k = 0; k < HYI_COUNT(sizes); k++) {
        static tb_scene s;
        ht_mesh mesh = ht_icosphere(1, 3);
        ht_mesh_place(&mesh, sizes[k], 0, 0, 0);
        tb_single(&s, mesh);
        tb_compare(&s, TB_BATCH, 1.2f * sizes[k], 301, 51 + k);
        assert_int_equal(tb_leaks(&s, 4 * TB_BATCH, 2.0f * sizes[k], 52), 0);
        assert_int_equal(tb_leaks(&s, 4 * TB_BATCH, -0.3f * sizes[k], 53), 0);
        /* unit directions too: t is then of the size of the scene */
        ht_rng rng = ht_rng_make(54);
        for (int i = 0; i < 1000; i++) {
            const float o[3] = {0, 0, 0};
            float d[3];
            ht_direction(&rng, d);
            hyk_ray ray = tb_ray(o, d, 0, INFINITY);
            hyk_hit hit;
            hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
            assert_int_equal(hit.instance, 0);
            assert_true(hit.t > 0.98f * sizes[k] && hit.t < 1.0001f * sizes[k]);
        }
        tb_end(&s);
    }
}

static void far_from_the_origin_it_stays_closed(void **state) {
    (void)state;
    static tb_scene s;
    ht_mesh mesh = ht_icosphere(1, 3);
    ht_mesh_place(&mesh, 1, 1e4f, -1e4f, 2e4f);
    tb_single(&s, mesh);
    assert_int_equal(tb_leaks(&s, ht_pick(40 * TB_BATCH, TB_BATCH), -0.3f, 61), 0);
    assert_int_equal(tb_leaks(&s, ht_pick(40 * TB_BATCH, TB_BATCH), 2.0f, 62), 0);
    tb_end(&s);
}

/* Directions from 1e-38 to 1e37 long, and origins very far away: no NaN, the right t. */
static void any_length_of_direction(void **state) {
    (void)state;
    static tb_scene s;
    tb_single(&s, ht_icosphere(1, 2));
    const float lengths[] = {1e-38f, 1e-30f, 1e-12f, 1, 1e12f, 1e30f, 1e37f};
    for (uint32_t k = 0; k < HYI_COUNT(lengths); k++) {
        const float o[3] = {0.1f, 0.2f, -0.1f}, d[3] = {0, 0, lengths[k]};
        hyk_ray ray = tb_ray(o, d, 0, INFINITY);
        hyk_hit hit;
        hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
        if (lengths[k] > 1e-38f) assert_int_equal(hit.instance, 0);
        if (lengths[k] > 1e-38f) ht_assert_near(hit.t * lengths[k], 1.05, 0.06);
    }
    const float far_origin[3] = {0.1f, 0.2f, -1e30f}, ahead[3] = {0, 0, 1}, nowhere[3] = {0, 0, 0};
    hyk_ray rays[2] = {tb_ray(far_origin, ahead, 0, INFINITY), tb_ray(far_origin, nowhere, 0, INFINITY)};
    hyk_hit hits[2];
    hyi_trace_closest(&s.accel, NULL, rays, hits, 2);
    assert_true(ht_finite(hits[0].t));
    assert_int_equal(hits[1].instance, HYK_NONE);
    tb_end(&s);
}

/* ---- limits and ties */

static hyk_hit tb_one(const tb_scene *s, float ox, float oy, float oz, float dx, float dy, float dz, float t_min, float t_max) {
    const float o[3] = {ox, oy, oz}, d[3] = {dx, dy, dz};
    hyk_ray ray = tb_ray(o, d, t_min, t_max);
    hyk_hit hit;
    uint8_t any;
    hyi_trace_closest(&s->accel, NULL, &ray, &hit, 1);
    hyi_trace_any(&s->accel, NULL, &ray, &any, 1);
    assert_int_equal(any, hit.instance != HYK_NONE);
    return hit;
}

static void limits_are_inclusive(void **state) {
    (void)state;
    static tb_scene s;
    const float low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    tb_single(&s, ht_box(low, high));
    for (int isa = 0; isa < 2; isa++) {
        s.accel.isa = isa ? HYDRA_ISA_SCALAR : tb_best_isa();
        hyk_hit hit = tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 0, INFINITY);
        assert_true(hit.t == 1 && hit.instance == 0);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 1, INFINITY).t == 1);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, nextafterf(1, 2), INFINITY).t == 2);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 0, 1).t == 1);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 0, nextafterf(1, 0)).t == -1);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 2, 2).t == 2);
        assert_true(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 2.001f, INFINITY).t == -1);
        assert_true(tb_one(&s, 0.25f, 0.125f, -1, 0, 0, 1, 0, INFINITY).t == 0);
        assert_true(tb_one(&s, 0.25f, 0.125f, 3, 0, 0, 2, -2, -1).t == -2);
        assert_int_equal(tb_one(&s, 0.25f, 0.125f, -3, 0, 0, 2, 3, 1).instance, HYK_NONE);
        /* along a face: starts on its plane, leaves through the next one */
        assert_true(tb_one(&s, 0.25f, 1, -3, 0, 0, 1, 0, INFINITY).t == 2);
        assert_true(tb_one(&s, 1, 1, -3, 0, 0, 1, 0, INFINITY).t == 2);
        assert_true(tb_one(&s, -1, -1, -3, 0, -0.0f, 1, 0, INFINITY).t == 2);
    }
    tb_end(&s);
}

static void barycentrics_follow_the_indices(void **state) {
    (void)state;
    static tb_scene s;
    ht_rng rng = ht_rng_make(71);
    tb_single(&s, ht_soup(&rng, 400, 1, 0.4f));
    uint32_t found = 0;
    for (int i = 0; i < 4000; i++) {
        hyk_ray ray = tb_random_ray(&rng, 1.2f);
        hyk_hit hit;
        hyi_trace_closest(&s.accel, NULL, &ray, &hit, 1);
        if (hit.instance == HYK_NONE) continue;
        found++;
        assert_true(hit.u >= 0 && hit.v >= 0 && hit.u + hit.v <= 1.000001f);
        const uint32_t *t = s.mesh[0].indices + 3 * hit.primitive;
        const float o[3] = {ray.origin.x, ray.origin.y, ray.origin.z}, d[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
        for (int a = 0; a < 3; a++) {
            float p = (1 - hit.u - hit.v) * s.mesh[0].positions[3 * t[0] + (uint32_t)a] + hit.u * s.mesh[0].positions[3 * t[1] + (uint32_t)a] +
                      hit.v * s.mesh[0].positions[3 * t[2] + (uint32_t)a];
            ht_assert_near(p, o[a] + hit.t * d[a], 4e-6);
        }
    }
    assert_true(found > 1000);
    tb_end(&s);
}

static void equal_triangles_give_the_smallest(void **state) {
    (void)state;
    const uint32_t counts[] = {1, 2, 9, 1000, 70000};
    for (uint32_t k = 0; k < HYI_COUNT(counts); k++) {
        static tb_scene s;
        ht_mesh mesh;
        memset(&mesh, 0, sizeof mesh);
        ht_mesh_vertex(&mesh, 0, 0, 0);
        ht_mesh_vertex(&mesh, 1, 0, 0);
        ht_mesh_vertex(&mesh, 0, 1, 0);
        for (uint32_t i = 0; i < counts[k]; i++) ht_mesh_triangle(&mesh, 0, 1, 2);
        tb_single(&s, mesh);
        assert_int_equal(s.bvh[0].primitive_count, counts[k]);
        for (int isa = 0; isa < 2; isa++) {
            s.accel.isa = isa ? HYDRA_ISA_SCALAR : tb_best_isa();
            hyk_hit hit = tb_one(&s, 0.25f, 0.25f, 1, 0, 0, -1, 0, INFINITY);
            assert_int_equal(hit.primitive, 0);
            assert_true(hit.t == 1 && hit.u == 0.25f && hit.v == 0.25f);
        }
        tb_end(&s);
    }
}

/* ---- what must not make rays slow: zero directions and origins on planes */

static uint32_t tb_visits(const tb_scene *s, const hyk_ray *ray) {
    hyi_site site = hyi_first_site(&s->accel);
    hyi_flight flight;
    uint32_t visits = 0, list[512], waiting = 0;
    if (hyi_flight_begin(&flight, site.bvh, ray, FLT_MAX)) list[waiting++] = site.bvh->root;
    while (waiting > 0) { /* every child met, without looking at triangles: what boxes alone let pass */
        uint32_t at = list[--waiting];
        float enter[8];
        visits++;
        if (hyi_child_is_leaf(at)) continue;
        for (uint32_t mask = hyi_visit_node_scalar(&flight.aim, &site.bvh->nodes[at], enter); mask; mask &= mask - 1u)
            list[waiting++] = site.bvh->nodes[at].child[hyi_lowest_bit(mask)];
    }
    return visits;
}

static void zero_directions_cost_no_more(void **state) {
    (void)state;
    static tb_scene s;
    ht_mesh mesh = ht_icosphere(1, 5);
    tb_single(&s, mesh);
    double plain = 0, axis = 0, plane = 0;
    ht_rng rng = ht_rng_make(81);
    for (int i = 0; i < 2000; i++) {
        float o[3] = {ht_range(&rng, -0.7f, 0.7f), ht_range(&rng, -0.7f, 0.7f), -2};
        const float straight[3] = {0, 0, 1}, bent[3] = {1e-3f, 1e-3f, 1}, denormal[3] = {1e-41f, -1e-44f, 1};
        hyk_ray ray = tb_ray(o, bent, 0, INFINITY);
        plain += tb_visits(&s, &ray);
        ray = tb_ray(o, i % 2 ? straight : denormal, 0, INFINITY);
        axis += tb_visits(&s, &ray);
        uint32_t n = ht_below(&rng, s.bvh[0].node_count); /* an origin on a slab's plane */
        o[0] = s.bvh[0].nodes[n].planes[0][0];
        ray = tb_ray(o, straight, 0, INFINITY);
        plane += tb_visits(&s, &ray);
    }
    print_message("           visits a ray: %.1f, axis-parallel %.1f, on planes %.1f\n", plain / 2000, axis / 2000, plane / 2000);
    assert_true(axis < 1.1 * plain && plane < 2.5 * plain);
    tb_end(&s);
}

/* ---- the build */

static void degenerate_triangles_are_dropped(void **state) {
    (void)state;
    static tb_scene s;
    ht_mesh mesh = ht_icosphere(1, 1);
    uint32_t good = mesh.index_count / 3;
    uint32_t v = ht_mesh_vertex(&mesh, 5, 5, 5), w = ht_mesh_vertex(&mesh, 7, 7, 7);
    uint32_t x = ht_mesh_vertex(&mesh, 6, 6, 6), y = ht_mesh_vertex(&mesh, 5, 5, 5);
    ht_mesh_triangle(&mesh, v, v, w);
    ht_mesh_triangle(&mesh, v, w, x); /* collinear */
    ht_mesh_triangle(&mesh, v, y, w); /* equal positions */
    ht_mesh_triangle(&mesh, v, v, v);
    tb_single(&s, mesh);
    assert_int_equal(s.bvh[0].degenerate, 4);
    assert_int_equal(s.bvh[0].primitive_count, good);
    assert_true(s.bvh[0].bounds.upper[0] <= 1);
    tb_end(&s);
}

static void nothing_is_hit_by_nothing(void **state) {
    (void)state;
    static tb_scene s;
    ht_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    tb_single(&s, mesh);
    assert_int_equal(tb_one(&s, 0, 0, 0, 1, 0, 0, 0, INFINITY).instance, HYK_NONE);
    s.accel.single = false;
    assert_int_equal(tb_one(&s, 0, 0, 0, 1, 0, 0, 0, INFINITY).instance, HYK_NONE);
    s.accel.empty = true;
    s.accel.instances = NULL;
    assert_int_equal(tb_one(&s, 0, 0, 0, 1, 0, 0, 0, INFINITY).instance, HYK_NONE);
    tb_end(&s);
    ht_mesh_vertex(&mesh, 1, 1, 1);
    ht_mesh_triangle(&mesh, 0, 0, 0);
    tb_single(&s, mesh);
    assert_int_equal(s.bvh[0].degenerate, 1);
    assert_int_equal(tb_one(&s, 0, 0, 0, 1, 1, 1, 0, INFINITY).instance, HYK_NONE);
    tb_end(&s);
}

/* ---- light shapes */

static void shapes_are_seen_in_front_of_surfaces(void **state) {
    (void)state;
    static tb_scene s;
    hyk_light lights[3];
    const uint32_t shape_lights[2] = {2, 1};
    const float low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    hyi_box boxes[2];
    hyi_bvh shapes;
    memset(lights, 0, sizeof lights);
    tb_single(&s, ht_box(low, high));
    lights[1].kind = lights[2].kind = HYK_LIGHT_SPHERE;
    lights[1].radius = lights[2].radius = 0.5f;
    lights[1].position = hyk_make3(0, 0, -3);
    lights[2].position = hyk_make3(0, 0, -5);
    lights[2].flags = HYK_LIGHT_HIDDEN;
    for (int i = 0; i < 2; i++) {
        hyk_vec3 c = lights[shape_lights[i]].position;
        const float p[3] = {c.x, c.y, c.z};
        for (int a = 0; a < 3; a++) {
            boxes[i].lower[a] = p[a] - 0.5f;
            boxes[i].upper[a] = p[a] + 0.5f;
        }
    }
    assert_int_equal(hyi_bvh_build_boxes(&s.host.context, boxes, 2, &shapes), HYDRA_OK);
    s.view.lights = lights;
    s.accel.shapes = &shapes;
    s.accel.shape_lights = shape_lights;
    const float o[3] = {0.1f, 0.05f, -9}, d[3] = {0, 0, 1}, up[3] = {0, 1, 0};
    for (int k = 0; k < 4; k++) {
        s.accel.isa = k % 2 ? HYDRA_ISA_SCALAR : tb_best_isa();
        hyk_ray rays[3] = {tb_ray(o, d, 0, INFINITY), tb_ray(o, up, 0, INFINITY), tb_ray(o, d, 7, INFINITY)};
        hyk_hit hits[3];
        uint8_t any[3];
        hyi_trace_closest(&s.accel, NULL, rays, hits, 3);
        assert_true(hits[0].instance == 0 && hits[0].t == 8);
        hyi_trace_shapes_closest(&s.accel, rays, hits, 3, k < 2);
        assert_int_equal(hits[0].instance, HYK_HIT_SHAPE);
        assert_int_equal(hits[0].primitive, k < 2 ? 1 : 2);
        assert_true(hits[0].t > (k < 2 ? 5.5f : 3.5f) && hits[0].t < (k < 2 ? 5.6f : 3.6f) && hits[0].u == 0);
        assert_int_equal(hits[1].instance, HYK_NONE);
        assert_true(hits[2].instance == 0 && hits[2].t == 8);
        rays[0].t_max = 4;
        hyi_trace_any(&s.accel, NULL, rays, any, 3);
        assert_true(any[0] == 0 && any[1] == 0 && any[2] == 1);
        hyi_trace_shapes_any(&s.accel, rays, any, 3);
        assert_true(any[0] == 1 && any[1] == 0 && any[2] == 1);
    }
    hyi_bvh_free(&s.host.context, &shapes);
    tb_end(&s);
}

/* ---- alpha: a mesh whose first half of triangles is cut out */

static void cut_out_triangles_let_rays_through(void **state) {
    (void)state;
    static tb_scene s;
    hyk_material materials[2];
    hyk_mesh mesh_record;
    hyk_mesh_arrays arrays;
    uint8_t has_alpha = 1;
    ht_mesh mesh = tb_grid(4), behind = tb_grid(4);
    ht_mesh_place(&behind, 1, 0, 0, -1);
    uint32_t front = mesh.index_count / 3;
    ht_mesh_append(&mesh, &behind);
    ht_mesh_free(&behind);
    tb_single(&s, mesh);
    uint32_t *per_triangle = (uint32_t *)calloc(2 * front, sizeof *per_triangle);
    for (uint32_t t = 0; t < 2 * front; t++) per_triangle[t] = t < front;
    memset(materials, 0, sizeof materials);
    memset(&mesh_record, 0, sizeof mesh_record);
    memset(&arrays, 0, sizeof arrays);
    materials[1].flags = HYK_MATERIAL_ALPHA_MASK;
    materials[1].alpha = 0.25f;
    materials[1].alpha_cutoff = 0.5f;
    materials[1].alpha_texture = materials[1].base_color_texture = HYK_NONE;
    mesh_record.flags = HYK_MESH_TRIANGLE_MATERIALS;
    arrays.triangle_materials = per_triangle;
    arrays.indices = s.mesh[0].indices;
    s.instances[0].material = HYK_NONE;
    s.view.materials = materials;
    s.view.meshes = &mesh_record;
    s.view.mesh_arrays = &arrays;
    for (int k = 0; k < 4; k++) {
        s.accel.isa = k % 2 ? HYDRA_ISA_SCALAR : tb_best_isa();
        s.accel.mesh_has_alpha = k < 2 ? &has_alpha : NULL;
        assert_true(tb_one(&s, 0.3f, 0.1f, 1, 0, 0, -1, 0, INFINITY).t == (k < 2 ? 2.0f : 1.0f));
        assert_true(tb_one(&s, 0.3f, 0.1f, 1, 0, 0, -1, 0, 1.5f).t == (k < 2 ? -1.0f : 1.0f));
    }
    free(per_triangle);
    tb_end(&s);
}

int hydra_test_bvh(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_meshes_agree_with_brute_force),
        cmocka_unit_test(instances_agree_with_brute_force),
        cmocka_unit_test(closed_meshes_do_not_leak),
        cmocka_unit_test(parity_gives_the_volume),
        cmocka_unit_test(distances_are_exact_to_a_few_ulps),
        cmocka_unit_test(rays_count_the_solid_angle),
        cmocka_unit_test(scale_and_place_do_not_matter),
        cmocka_unit_test(far_from_the_origin_it_stays_closed),
        cmocka_unit_test(any_length_of_direction),
        cmocka_unit_test(limits_are_inclusive),
        cmocka_unit_test(barycentrics_follow_the_indices),
        cmocka_unit_test(equal_triangles_give_the_smallest),
        cmocka_unit_test(zero_directions_cost_no_more),
        cmocka_unit_test(degenerate_triangles_are_dropped),
        cmocka_unit_test(nothing_is_hit_by_nothing),
        cmocka_unit_test(shapes_are_seen_in_front_of_surfaces),
        cmocka_unit_test(cut_out_triangles_let_rays_through),
    };
    return cmocka_run_group_tests_name("bvh", tests, NULL, NULL);
}
