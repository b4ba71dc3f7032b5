/* One answer to a ray, however the tree is walked: alone or with others, on each instruction set, with any limit. That of all
   triangles asked in turn is the truth. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "bvh_helpers.h"

#define TB_GRAZING 4000u

/* Of all triangles of a scene's one tree, asked in turn. */
static hyk_hit tb_of_all(const tb_scene *s, const hyk_ray *ray) {
    hyi_site site = hyi_first_site(&s->accel);
    hyi_flight flight;
    hyk_hit hit;
    bool flies = hyi_flight_begin(&flight, site.bvh, ray, FLT_MAX);
    for (uint32_t i = 0; flies && i < site.bvh->node_count * HYI_WIDTH; i++) {
        uint32_t child = site.bvh->nodes[i / HYI_WIDTH].child[i % HYI_WIDTH];
        if (child == HYI_CHILD_NONE || !hyi_child_is_leaf(child)) continue;
        for (uint32_t k = 0; k < hyi_leaf_count(child); k++) (void)hyi_decide(&site, &flight, child, k);
    }
    hyi_answer(&s->accel, &flight.best, &hit);
    return hit;
}

static void tb_expect_hits(tb_scene *s, const hyk_ray *rays, const hyk_hit *truth, hyi_ray_stream *stream, uint32_t count) {
    static hyk_hit hits[TB_GRAZING];
    static uint8_t any[TB_GRAZING];
    hyi_trace_closest(&s->accel, stream, rays, hits, count);
    hyi_trace_any(&s->accel, stream, rays, any, count);
    for (uint32_t i = 0; i < count; i++) {
        if (memcmp(&hits[i], &truth[i], sizeof hits[i]) != 0 || any[i] != (truth[i].instance != HYK_NONE))
            fail_msg("instruction set %d, %s, ray %u of limit %.9g: t %.9g of %u, any %u; of all triangles %.9g of %u", (int)s->accel.isa, stream ? "a batch" : "one by one", i,
                     (double)rays[i].t_max, (double)hits[i].t, hits[i].primitive, any[i], (double)truth[i].t, truth[i].primitive);
    }
}

/* On every instruction set, alone and together, and again with limits at the hits; truth: of all triangles. */
static uint32_t tb_expect_one_answer(tb_scene *s, hyk_ray *rays, uint32_t count) {
    static hyk_hit truth[TB_GRAZING];
    uint32_t found = 0;
    for (int limit = 0; limit < 3; limit++) {
        for (uint32_t i = 0; i < count; i++) {
            bool hit = limit && truth[i].instance == 0;
            if (hit) rays[i].t_max = limit == 1 ? truth[i].t : nextafterf(truth[i].t, INFINITY);
            hyk_hit before = truth[i];
            truth[i] = tb_of_all(s, &rays[i]);
            if (limit) assert_memory_equal(&before, &truth[i], sizeof before);
            found += truth[i].instance == 0;
        }
        for (int isa = HYDRA_ISA_SCALAR; isa <= HYDRA_ISA_NEON; isa++) {
            hyi_ray_stream stream;
            if (!hyi_isa_is_there((hydra_isa)isa)) continue;
            s->accel.isa = (hydra_isa)isa;
            assert_int_equal(hyi_ray_stream_alloc(&s->host.context, &s->accel, count, &stream), HYDRA_OK);
            tb_expect_hits(s, rays, truth, NULL, count);
            tb_expect_hits(s, rays, truth, &stream, count);
            hyi_ray_stream_free(&s->host.context, &stream);
        }
    }
    return found;
}

/* From somewhere in the plane of a triangle to somewhere on it, as floats have them; some from afar, some beside the plane.
   apart: how far what rays of a block go to lies apart, in triangles. */
static void tb_grazing_block(ht_rng *rng, const ht_mesh *mesh, float apart, hyk_ray rays[16]) {
    const uint32_t *t = mesh->indices + 3 * ht_below(rng, mesh->index_count / 3);
    const float *p = mesh->positions + 3 * t[0], *q = mesh->positions + 3 * t[1], *r = mesh->positions + 3 * t[2];
    float u = ht_range(rng, -2, 2), v = ht_range(rng, -2, 2), b = ht_range(rng, 0, 1), c = ht_range(rng, 0, 1 - b), o[3], d[3];
    float away = ht_below(rng, 2) ? 1 : ht_range(rng, 1, 100), beside = ht_below(rng, 2) ? 0 : ldexpf(1, -(int)ht_below(rng, 24));
    for (int a = 0; a < 3; a++) {
        float from = p[a] + u * (q[a] - p[a]) + v * (r[a] - p[a]), to = p[a] + b * (q[a] - p[a]) + c * (r[a] - p[a]);
        o[a] = to + (from - to) * away + beside * ht_range(rng, -1, 1);
    }
    for (int i = 0; i < 16; i++) {
        float x = b + apart * ht_range(rng, -1, 1), y = c + apart * ht_range(rng, -1, 1);
        for (int a = 0; a < 3; a++) d[a] = p[a] + x * (q[a] - p[a]) + y * (r[a] - p[a]) - o[a];
        rays[i] = tb_ray(o, d, 0, INFINITY);
    }
}

/* Triangles right across others are split over many leaves, and t of a ray that nearly runs in the plane of one is only as good
   as the plane. Catches: a t that lies in no leaf of its triangle, which is then lost where something else ends the ray first. */
static void grazing_rays_have_one_answer(void **state) {
    (void)state;
    static tb_scene s;
    static hyk_ray rays[TB_GRAZING];
    const float sizes[] = {0.5f, 0.02f, 1e-4f};
    ht_rng rng = ht_rng_make(17);
    uint32_t count = ht_pick(TB_GRAZING, 1600), split = 0;
    for (uint32_t k = 0; k <= HYI_COUNT(sizes); k++) {
        ht_mesh mesh = ht_soup(&rng, 300, 1, 0.3f), across = k < HYI_COUNT(sizes) ? tb_needles(&rng, 60, sizes[k]) : ht_soup(&rng, 60, 1, 1);
        ht_mesh_append(&mesh, &across);
        ht_mesh_free(&across);
        tb_single(&s, mesh);
        split += s.bvh[0].slot_count - s.bvh[0].primitive_count;
        for (uint32_t i = 0; i < count; i += 16) tb_grazing_block(&rng, &s.mesh[0], i % 64 ? 0.02f : 1, rays + i);
        assert_true(tb_expect_one_answer(&s, rays, count) > count);
        tb_end(&s);
    }
    assert_true(split > 100);
}

/* Corners, origins and directions are whole, so that rays begin in the plane. Catches: a t from edge functions where the plane's
   is right. */
static void rays_that_begin_in_a_plane_meet_it_at_zero(void **state) {
    (void)state;
    static tb_scene s;
    ht_mesh mesh;
    ht_rng rng = ht_rng_make(18);
    uint32_t met = 0;
    memset(&mesh, 0, sizeof mesh);
    ht_mesh_vertex(&mesh, -3000, 1000, 2000);
    ht_mesh_vertex(&mesh, 5000, -1000, 1000);
    ht_mesh_vertex(&mesh, 1000, 6000, -3000);
    ht_mesh_triangle(&mesh, 0, 1, 2);
    tb_single(&s, mesh);
    const float *p = s.mesh[0].positions;
    for (uint32_t i = 0; i < ht_pick(100000, 10000); i++) {
        float b = (float)ht_below(&rng, 500) / 1000, c = (float)ht_below(&rng, 500) / 1000, u = ht_range(&rng, -1, 1), v = ht_range(&rng, -1, 1);
        float slope = ldexpf(1, -(int)ht_below(&rng, 22)), o[3], d[3];
        for (int a = 0; a < 3; a++) {
            o[a] = p[a] + roundf(1000 * b) * ((p[3 + a] - p[a]) / 1000) + roundf(1000 * c) * ((p[6 + a] - p[a]) / 1000);
            d[a] = u * (p[3 + a] - p[a]) + v * (p[6 + a] - p[a]) + slope * ht_range(&rng, -1000, 1000);
        }
        hyk_hit hit = tb_one(&s, o[0], o[1], o[2], d[0], d[1], d[2], -1, 1);
        if (hit.instance == HYK_NONE) continue;
        assert_true(hit.t == 0);
        met++;
    }
    assert_true(met > ht_pick(50000, 5000));
    tb_end(&s);
}

/* All at t 0, however far apart: a float has nothing between. Catches: boxes left out because of a t that is less than theirs. */
static void distances_that_underflow_leave_no_choice(void **state) {
    (void)state;
    static tb_scene s;
    static hyk_ray rays[TB_GRAZING];
    ht_rng rng = ht_rng_make(19);
    ht_mesh mesh = ht_soup(&rng, 500, 1, 0.5f);
    ht_mesh_place(&mesh, 1e-30f, 0, 0, 0);
    tb_single(&s, mesh);
    for (uint32_t i = 0; i < 500; i++) {
        rays[i] = tb_random_ray(&rng, 1);
        rays[i].origin = hyk_scale(rays[i].origin, 1e-30f);
        rays[i].direction = hyk_scale(rays[i].direction, i % 2 ? 1e15f : 1e30f);
        rays[i].t_max = INFINITY;
        rays[i].t_min = 0;
    }
    assert_true(tb_expect_one_answer(&s, rays, 500) > 300);
    tb_end(&s);
}

int hydra_test_bvh_hits_grazing(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grazing_rays_have_one_answer),
        cmocka_unit_test(rays_that_begin_in_a_plane_meet_it_at_zero),
        cmocka_unit_test(distances_that_underflow_leave_no_choice),
    };
    return cmocka_run_group_tests_name("bvh_hits_grazing", tests, NULL, NULL);
}
