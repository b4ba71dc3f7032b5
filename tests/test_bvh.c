/* Trees and their traversals: against brute force, against each other, and closed as the meshes are. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "bvh_helpers.h"

/* ---- instances */

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
    for (uint32_t i = 0; i < hyi_leaf_count(leaf); i++) (void)hyi_decide(site, flight, leaf, i);
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

/* ---- comparing */

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
        s->accel.isa = hyi_best_isa();
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

static void single_meshes_agree_with_brute_force(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(3);
    ht_mesh meshes[5];
    meshes[0] = ht_icosphere(1, 3);
    meshes[1] = ht_soup(&rng, 3000, 1.0f, 0.1f);
    meshes[2] = tb_needles(&rng, 2000, 0.001f);
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

/* ---- sizes and places */

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

int hydra_test_bvh(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_meshes_agree_with_brute_force),
        cmocka_unit_test(instances_agree_with_brute_force),
        cmocka_unit_test(closed_meshes_do_not_leak),
        cmocka_unit_test(parity_gives_the_volume),
        cmocka_unit_test(scale_and_place_do_not_matter),
        cmocka_unit_test(far_from_the_origin_it_stays_closed),
    };
    return cmocka_run_group_tests_name("bvh", tests, NULL, NULL);
}
