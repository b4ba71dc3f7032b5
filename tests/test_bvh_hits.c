/* What a hit says, to the last bit where that is known, and what can be hit: distances, limits, ties, shapes, holes. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "bvh_helpers.h"

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

static void limits_are_inclusive(void **state) {
    (void)state;
    static tb_scene s;
    const float low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    tb_single(&s, ht_box(low, high));
    for (int isa = 0; isa < 2; isa++) {
        s.accel.isa = isa ? HYDRA_ISA_SCALAR : hyi_best_isa();
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
            s.accel.isa = isa ? HYDRA_ISA_SCALAR : hyi_best_isa();
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

/* ---- what is not there */

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
        s.accel.isa = k % 2 ? HYDRA_ISA_SCALAR : hyi_best_isa();
        hyk_ray rays[3] = {tb_ray(o, d, 0, INFINITY), tb_ray(o, up, 0, INFINITY), tb_ray(o, d, 7, INFINITY)};
        hyk_hit hits[3];
        uint8_t any[3];
        hyi_trace_closest(&s.accel, NULL, rays, hits, 3);
        assert_true(hits[0].instance == 0 && hits[0].t == 8);
        hyi_trace_shapes_closest(&s.accel, rays, hits, NULL, 3, k < 2);
        assert_int_equal(hits[0].instance, HYK_HIT_SHAPE);
        assert_int_equal(hits[0].primitive, k < 2 ? 1 : 2);
        assert_true(hits[0].t > (k < 2 ? 5.5f : 3.5f) && hits[0].t < (k < 2 ? 5.6f : 3.6f) && hits[0].u == 0);
        assert_int_equal(hits[1].instance, HYK_NONE);
        assert_true(hits[2].instance == 0 && hits[2].t == 8);
        hyk_hit tie = hits[0];
        hydra_hit told = {.t = hits[0].t, .mesh = 1};
        tie.instance = tie.primitive = 0;
        hyi_trace_shapes_closest(&s.accel, rays, &tie, NULL, 1, k < 2);
        hyi_trace_shapes_closest(&s.accel, rays, NULL, &told, 1, k < 2);
        assert_true(tie.instance == 0 && told.mesh == 1); /* a surface comes before a shape */
        tie.t = nextafterf(tie.t, INFINITY);
        hyi_trace_shapes_closest(&s.accel, rays, &tie, NULL, 1, k < 2);
        assert_int_equal(tie.instance, HYK_HIT_SHAPE);
        rays[0].t_max = 4;
        hyi_trace_any(&s.accel, NULL, rays, any, 3);
        assert_true(any[0] == 0 && any[1] == 0 && any[2] == 1);
        hyi_trace_shapes_any(&s.accel, rays, any, 3);
        assert_true(any[0] == 1 && any[1] == 0 && any[2] == 1);
    }
    hyi_bvh_free(&s.host.context, &shapes);
    tb_end(&s);
}

/* ---- boxes */

#define TB_BOXES 500u

static bool tb_count_box(void *argument, hyi_flight *flight, uint32_t item) {
    (void)flight;
    (void)item;
    ++*(uint32_t *)argument;
    return false;
}

static uint32_t tb_boxes_met(const hyi_bvh *boxes, hydra_isa isa, hyk_ray ray) {
    hyi_flight flight;
    uint32_t met = 0;
    if (hyi_flight_begin(&flight, boxes, &ray, FLT_MAX)) HYI_DISPATCH(isa, hyi_walk_boxes, (boxes, &flight, boxes->root, tb_count_box, &met))
    return met;
}

/* Catches: limits of one sign that are compared as if of the other, so that all that lies behind a ray is met. */
static void boxes_behind_a_ray(void **state) {
    (void)state;
    static hyi_box boxes[TB_BOXES];
    ht_host host;
    ht_rng rng = ht_rng_make(8);
    hyi_bvh tree;
    memset(&host, 0, sizeof host);
    hydra_context *context = ht_open(&host, NULL);
    for (uint32_t i = 0; i < TB_BOXES; i++) {
        for (int a = 0; a < 3; a++) {
            boxes[i].lower[a] = ht_range(&rng, -1, 1);
            boxes[i].upper[a] = boxes[i].lower[a] + 0.2f;
        }
    }
    assert_int_equal(hyi_bvh_build_boxes(context, boxes, TB_BOXES, &tree), HYDRA_OK);
    for (int isa = HYDRA_ISA_SCALAR; isa <= HYDRA_ISA_NEON; isa++) {
        uint32_t ahead = 0, behind = 0;
        for (int i = 0; i < 200 && hyi_isa_is_there((hydra_isa)isa); i++) {
            const float o[3] = {ht_range(&rng, -1, 1), ht_range(&rng, -1, 1), ht_range(&rng, -1, 1)};
            const float d[3] = {ht_range(&rng, -1, 1), ht_range(&rng, -1, 1), ht_range(&rng, -1, 1)};
            uint32_t met = tb_boxes_met(&tree, (hydra_isa)isa, tb_ray(o, d, 0, INFINITY));
            assert_int_equal(tb_boxes_met(&tree, (hydra_isa)isa, tb_ray(o, d, -0.0f, INFINITY)), met);
            assert_int_equal(tb_boxes_met(&tree, (hydra_isa)isa, tb_ray(o, d, -1e-30f, INFINITY)), met);
            behind += tb_boxes_met(&tree, (hydra_isa)isa, tb_ray(o, d, -9, 0));
            ahead += met;
        }
        assert_true(!hyi_isa_is_there((hydra_isa)isa) || (ahead > 200 && behind > 200 && behind < 2 * ahead));
    }
    hyi_bvh_free(context, &tree);
    ht_close(&host);
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
        s.accel.isa = k % 2 ? HYDRA_ISA_SCALAR : hyi_best_isa();
        s.accel.mesh_has_alpha = k < 2 ? &has_alpha : NULL;
        assert_true(tb_one(&s, 0.3f, 0.1f, 1, 0, 0, -1, 0, INFINITY).t == (k < 2 ? 2.0f : 1.0f));
        assert_true(tb_one(&s, 0.3f, 0.1f, 1, 0, 0, -1, 0, 1.5f).t == (k < 2 ? -1.0f : 1.0f));
    }
    free(per_triangle);
    tb_end(&s);
}

int hydra_test_bvh_hits(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distances_are_exact_to_a_few_ulps),
        cmocka_unit_test(rays_count_the_solid_angle),
        cmocka_unit_test(any_length_of_direction),
        cmocka_unit_test(limits_are_inclusive),
        cmocka_unit_test(barycentrics_follow_the_indices),
        cmocka_unit_test(equal_triangles_give_the_smallest),
        cmocka_unit_test(zero_directions_cost_no_more),
        cmocka_unit_test(degenerate_triangles_are_dropped),
        cmocka_unit_test(nothing_is_hit_by_nothing),
        cmocka_unit_test(shapes_are_seen_in_front_of_surfaces),
        cmocka_unit_test(boxes_behind_a_ray),
        cmocka_unit_test(cut_out_triangles_let_rays_through),
    };
    return cmocka_run_group_tests_name("bvh_hits", tests, NULL, NULL);
}
