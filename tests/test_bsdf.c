/* BSDFs: sampling against density, energy, reciprocity, published values, and everything finite. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#include "hydra_test.h"

#define FEATURES (HYK_NEEDS_SPECULAR | HYK_NEEDS_TRANSMISSION)

int hydra_test_bsdf(void);

/* ---------------------------------------------------------------- a scene of one material */

typedef struct scene {
    hydra_context context;
    hyk_material material;
    hyk_scene_view view;
    float *tables;
    size_t table_count;
} scene;

static void scene_open(scene *s, hyk_material material) {
    memset(s, 0, sizeof *s);
    s->context.desc.allocator.alloc = hyi_default_alloc;
    s->context.desc.allocator.release = hyi_default_release;
    s->material = material;
    assert_int_equal(hyi_energy_tables_build(&s->context, &s->material, 1, &s->tables, &s->table_count), HYDRA_OK);
    s->view.energy_tables = s->tables;
}

static void scene_close(scene *s) {
    hyi_free_array(&s->context, &s->tables, s->table_count);
    assert_int_equal(hyi_atomic_load(&s->context.allocations_now), 0);
}

static hyk_material plain(hyk_uint kind, float roughness, float ior) {
    hyk_material m;
    memset(&m, 0, sizeof m);
    m.kind = kind;
    m.roughness = roughness;
    m.ior = ior;
    m.base_color = hyk_splat(1.0f);
    m.metallic_roughness_texture = HYK_NONE;
    m.energy_table = HYK_NONE;
    return m;
}

/* The kinds of surfaces that the tests go through. */
typedef enum surface { METAL, GLASS, PLASTIC, THIN, CLEAR, COATED_METAL, COATED_PLASTIC, COATED_CLEAR, MIXED, SURFACES } surface;
static const char *const surface_names[SURFACES] = { "metal", "glass", "plastic", "thin", "clear", "coated metal", "coated plastic", "coated clear", "mixed" };

static hyk_material make_material(surface kind, float roughness, float ior) {
    hyk_material m = plain(HYK_MATERIAL_METALLIC_ROUGHNESS, roughness, ior);
    if (kind == METAL) m.kind = HYK_MATERIAL_CONDUCTOR;
    if (kind == GLASS) m.kind = HYK_MATERIAL_DIELECTRIC;
    if (kind == THIN) m.flags |= HYK_MATERIAL_THIN;
    if (kind == THIN || kind == CLEAR || kind == COATED_CLEAR) m.transmission = 1.0f;
    if (kind == COATED_METAL) m.metallic = 1.0f;
    if (kind == COATED_METAL || kind == COATED_PLASTIC || kind == COATED_CLEAR) m.clearcoat = 1.0f;
    if (kind == COATED_PLASTIC) m.clearcoat_roughness = 0.4f;
    if (kind == MIXED) {
        m.metallic = 0.3f;
        m.transmission = 0.5f;
        m.clearcoat = 0.5f;
        m.clearcoat_roughness = 0.2f;
    }
    return m;
}

static hyk_vec3 at_cosine(double cosine, double azimuth) {
    double s = sqrt((1.0 - cosine) * (1.0 + cosine));
    return hyk_make3((float)(s * cos(azimuth)), (float)(s * sin(azimuth)), (float)cosine);
}

/* ---------------------------------------------------------------- energy */

static double radical_inverse(uint32_t i, uint32_t base) {
    double r = 0.0, digit = 1.0 / base;
    for (; i; i /= base, digit /= base) r += digit * (i % base);
    return r;
}

/* Mean power of the samples on Hammersley's points: albedo in the first channel. */
static double albedo_of(const scene *s, hyk_bsdf bsdf, hyk_vec3 wo, uint32_t count) {
    double sum = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        double a = (i + 0.5) / count, b = radical_inverse(i, 2) + 0.25 / count, c = radical_inverse(i, 3) + 0.25 / count;
        hyk_bsdf_sample r = hyk_bsdf_sample_direction(&s->view, bsdf, wo, (float)a * 0.9999999f, hyk_make2((float)b, (float)c * 0.9999999f), FEATURES);
        if (r.flags == 0u) continue;
        double scale = (r.flags & HYK_LOBE_TRANSMIT) && !hyk_bsdf_is(bsdf, HYK_BSDF_THIN) ? (double)(bsdf.glass_eta * bsdf.glass_eta) : 1.0;
        sum += scale * (double)(r.diffuse.x + r.specular.x);
    }
    return sum / count;
}

static int furnace_failures;

static void check_furnace(surface kind, float ior, double tolerance) {
    const float roughness[] = { 0.0f, 0.01f, 0.06f, 0.12f, 0.25f, 0.5f, 0.8f, 1.0f };
    const double cosines[] = { 0.01, 0.05, 0.2, 0.55, 0.8, 1.0 };
    double worst = 0.0, worst_at[3] = { 0 };
    for (size_t r = 0; r < HYI_COUNT(roughness); r++) {
        scene s;
        scene_open(&s, make_material(kind, roughness[r], ior));
        for (int front = 0; front < 2; front++)
            for (size_t c = 0; c < HYI_COUNT(cosines); c++) {
                hyk_bsdf bsdf = hyk_make_bsdf(&s.view, s.material, front != 0, FEATURES);
                if (!front && !hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE)) continue;
                hyk_vec3 wo = at_cosine(cosines[c], 0.7);
                double off = fabs(albedo_of(&s, bsdf, wo, ht_pick(8192, 4096)) - 1.0);
                ht_assert_near(hyk_bsdf_albedo(&s.view, bsdf, wo, FEATURES).y, 1.0, 1e-4);
                if (off > worst) {
                    worst = off;
                    worst_at[0] = (double)roughness[r];
                    worst_at[1] = cosines[c];
                    worst_at[2] = front;
                }
            }
        scene_close(&s);
    }
    printf("furnace %s, ior %g: %.5f at roughness %g, cos %g, front %g\n", surface_names[kind], (double)ior, worst, worst_at[0], worst_at[1], worst_at[2]);
    if (worst > tolerance) furnace_failures++;
}

static void white_furnace(void **state) {
    (void)state;
    const float iors[] = { 1.0001f, 1.1f, 1.5f, 2.5f, 10.0f };
    check_furnace(METAL, 1.5f, 0.005);
    for (int kind = GLASS; kind <= THIN; kind++)
        for (size_t i = 0; i < HYI_COUNT(iors); i++) /* the table's limit: reflection that is all within 1 degree of grazing */
            check_furnace((surface)kind, iors[i], kind == PLASTIC && iors[i] < 1.01f ? 0.015 : 0.005);
    for (int kind = CLEAR; kind < SURFACES; kind++) check_furnace((surface)kind, 1.5f, 0.005);
    assert_int_equal(furnace_failures, 0);
}

/* The same without tables: single scattering alone. At cos 1 and alpha 1 it keeps exactly 1 - ln 2. */
static void loses_energy_without_compensation(void **state) {
    (void)state;
    scene s;
    scene_open(&s, make_material(METAL, 1.0f, 1.5f));
    hyk_material bare = s.material;
    bare.energy_table = HYK_NONE;
    hyk_bsdf bsdf = hyk_make_bsdf(&s.view, bare, true, FEATURES);
    double kept = albedo_of(&s, bsdf, at_cosine(1.0, 0.0), 65536);
    ht_assert_near(kept, 1.0 - log(2.0), 2e-4);
    assert_true(1.0 - kept > 0.1);
    assert_true(1.0 - albedo_of(&s, bsdf, at_cosine(0.5, 0.0), 4096) > 0.1);
    hyk_material glass = make_material(GLASS, 1.0f, 1.5f);
    assert_true(1.0 - albedo_of(&s, hyk_make_bsdf(&s.view, glass, true, FEATURES), at_cosine(0.5, 0.0), 4096) > 0.1);
    scene_close(&s);
}

/* Cycles' table of the directional albedo of GGX (rows cos i/31, columns roughness j/31; Blender 4, table_ggx_E). */
static void single_scattering_matches_published(void **state) {
    (void)state;
    const struct { int i, j; double e; } known[] = { { 1, 31, 0.888202 }, { 2, 31, 0.819138 }, { 3, 31, 0.765057 },
                                                     { 1, 15, 0.952526 }, { 2, 15, 0.919348 }, { 3, 8, 0.892271 } };
    for (size_t k = 0; k < HYI_COUNT(known); k++) {
        scene s;
        scene_open(&s, make_material(METAL, (float)known[k].j / 31.0f, 1.5f));
        hyk_bsdf bsdf = hyk_make_bsdf(&s.view, s.material, true, FEATURES);
        double e = 1.0 - (double)hyk_layers_at(&s.view, bsdf, (float)known[k].i / 31.0f, FEATURES).metal_lost;
        ht_assert_near(e, known[k].e, 0.0035);
        scene_close(&s);
    }
    scene s;
    scene_open(&s, make_material(METAL, 1.0f, 1.5f));
    ht_assert_near(1.0f - hyk_layers_at(&s.view, hyk_make_bsdf(&s.view, s.material, true, FEATURES), 1.0f, FEATURES).metal_lost, 1.0 - log(2.0), 1e-3);
    scene_close(&s);
}

/* ---------------------------------------------------------------- Fresnel */

static double fresnel_in_double(double c, double n) {
    double s = sqrt(1.0 - c * c) / n;
    if (s >= 1.0) return 1.0;
    double t = sqrt(1.0 - s * s), a = (c - n * t) / (c + n * t), b = (n * c - t) / (n * c + t);
    return 0.5 * (a * a + b * b);
}

static void fresnel_values(void **state) {
    (void)state;
    const double degree = 0.017453292519943295;
    ht_assert_near(hyk_fresnel_dielectric(1.0f, 1.5f), 0.04, 1e-7);
    ht_assert_near(hyk_fresnel_dielectric((float)cos(56.30993247402021 * degree), 1.5f), 0.5 * 0.147929, 1e-6);
    ht_assert_near(hyk_fresnel_dielectric((float)cos(85.0 * degree), 1.5f), 0.61279, 1e-5);
    ht_assert_near(hyk_fresnel_dielectric((float)cos(45.0 * degree), 1.5f), 0.05023991, 1e-7);
    assert_true(hyk_fresnel_dielectric((float)cos(41.82 * degree), 1.0f / 1.5f) == 1.0f);
    assert_true(hyk_fresnel_dielectric((float)cos(41.80 * degree), 1.0f / 1.5f) < 1.0f);
    ht_assert_near(hyk_fresnel_complex(1.0f, 0.18f, 3.42f), 0.94499, 1e-5);
    hyi_gauss gauss;
    hyi_make_gauss(&gauss);
    ht_assert_near(hyi_dielectric_mean(&gauss, 1.5f), 0.0917780, 1e-5);
    for (int i = 0; i <= 64; i++)
        for (double n = 1.0001; n < 10.1; n *= 1.3) {
            float c = (float)i / 64.0f, eta = (float)n;
            ht_assert_near(hyk_fresnel_dielectric(c, eta), fresnel_in_double((double)c, (double)eta), 2e-6);
            ht_assert_near(hyk_fresnel_complex(c, eta, 0.0f), fresnel_in_double((double)c, (double)eta), 5e-5);
        }
}

/* ---------------------------------------------------------------- sampling against density */

#define BIN_RINGS 18
#define BIN_SECTORS 10
#define BIN_PARTS 8

/* Bins around an axis, rings uniform in rho = log(1 + angle / width), 0..1 at the opposite pole. */
typedef struct bins {
    hyk_frame frame;
    double width;
    double observed[BIN_RINGS * BIN_SECTORS + 1], expected[BIN_RINGS * BIN_SECTORS + 1]; /* the last: everything else */
} bins;

static int bin_of(const bins *b, hyk_vec3 w) {
    double x = (double)hyk_dot(w, b->frame.x), y = (double)hyk_dot(w, b->frame.y), z = (double)hyk_dot(w, b->frame.z);
    double angle = atan2(sqrt(x * x + y * y), z), rho = log(1.0 + angle / b->width) / log(1.0 + HT_PI / b->width);
    int ring = (int)(rho * BIN_RINGS), sector = (int)((atan2(y, x) / (2.0 * HT_PI) + 0.5) * BIN_SECTORS);
    ring = ring < BIN_RINGS ? ring : BIN_RINGS - 1;
    return ring * BIN_SECTORS + (sector < BIN_SECTORS ? sector : BIN_SECTORS - 1);
}

static void integrate_bins(const scene *s, hyk_bsdf bsdf, hyk_vec3 wo, double side, bins *b) {
    const int rings = BIN_RINGS * BIN_PARTS, sectors = BIN_SECTORS * BIN_PARTS;
    for (int i = 0; i < rings; i++)
        for (int j = 0; j < sectors; j++) {
            double rho = (i + 0.5) / rings, azimuth = ((j + 0.5) / sectors - 0.5) * 2.0 * HT_PI;
            double span = log(1.0 + HT_PI / b->width), angle = b->width * (exp(rho * span) - 1.0), slope = (angle + b->width) * span;
            hyk_vec3 local = hyk_make3((float)(sin(angle) * cos(azimuth)), (float)(sin(angle) * sin(azimuth)), (float)cos(angle));
            hyk_vec3 wi = hyk_to_world(b->frame, local);
            if ((double)wi.z * side <= 0.0) continue;
            double pdf = (double)hyk_bsdf_eval(&s->view, bsdf, wo, wi, FEATURES).pdf;
            b->expected[i / BIN_PARTS * BIN_SECTORS + j / BIN_PARTS] += pdf * sin(angle) * slope / rings * 2.0 * HT_PI / sectors;
        }
}

/* p-value of one side's directions, in bins around the lobe's axis. */
static double chi_square(const scene *s, hyk_bsdf bsdf, hyk_vec3 wo, double side, uint64_t seed) {
    const uint32_t count = 20000;
    bins b;
    memset(&b, 0, sizeof b);
    hyk_vec3 axis = hyk_make3(-wo.x, -wo.y, wo.z), up = hyk_make3(0.0f, 0.0f, 1.0f);
    if (side < 0.0) {
        hyk_real g = hyk_refracted_cosine(wo.z, bsdf.glass_eta);
        if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) axis = hyk_neg(wo);
        else if (g > 0.0f) axis = hyk_refract(wo, up, wo.z, g, bsdf.glass_eta);
        else axis = hyk_neg(up);
    }
    b.frame = hyk_make_frame(hyk_normalize(axis));
    b.width = (double)bsdf.alpha * (side < 0.0 && !hyk_bsdf_is(bsdf, HYK_BSDF_THIN) ? fabs((double)bsdf.glass_eta - 1.0) + 0.05 : 1.0);
    integrate_bins(s, bsdf, wo, side, &b);
    ht_rng rng = ht_rng_make(seed);
    for (uint32_t i = 0; i < count; i++) {
        float u = ht_uniform(&rng), v = ht_uniform(&rng), w = ht_uniform(&rng);
        hyk_bsdf_sample r = hyk_bsdf_sample_direction(&s->view, bsdf, wo, u, hyk_make2(v, w), FEATURES);
        bool counts = r.flags != 0u && (r.flags & HYK_LOBE_DELTA) == 0u && (double)r.wi.z * side > 0.0;
        b.observed[counts ? bin_of(&b, r.wi) : BIN_RINGS * BIN_SECTORS] += 1.0;
    }
    double rest = count;
    for (int i = 0; i < BIN_RINGS * BIN_SECTORS; i++) {
        b.expected[i] *= count;
        rest -= b.expected[i];
    }
    assert_true(rest > -0.005 * count); /* the density does not integrate to more than 1 */
    if (count - rest < 200.0) return 1.0; /* total internal reflection leaves next to nothing on this side */
    /* Everything else, with the bins that the midpoints of the integral only graze; one count of slack. */
    b.expected[BIN_RINGS * BIN_SECTORS] = (rest > 0.0 ? rest : 0.0) + 1.0;
    for (int i = 0; i < BIN_RINGS * BIN_SECTORS; i++) {
        if (b.expected[i] >= 1.0) continue;
        b.expected[BIN_RINGS * BIN_SECTORS] += b.expected[i];
        b.observed[BIN_RINGS * BIN_SECTORS] += b.observed[i];
        b.expected[i] = b.observed[i] = 0.0;
    }
    return ht_chi_square_p(b.observed, b.expected, BIN_RINGS * BIN_SECTORS + 1, 1);
}

static void sampling_follows_density(void **state) {
    (void)state;
    const float roughness[] = { 0.02f, 0.1f, 0.3f, 0.6f, 1.0f };
    const double cosines[] = { 0.15, 0.5, 0.95 };
    const double tests = SURFACES * 5.0 * 3.0 * 4.0, level = 1.0 - pow(1.0 - 0.01, 1.0 / tests);
    double least = 1.0;
    uint64_t seed = 1;
    for (int kind = 0; kind < SURFACES; kind++)
        for (size_t r = 0; r < HYI_COUNT(roughness); r++) {
            scene s;
            scene_open(&s, make_material((surface)kind, roughness[r], 1.5f));
            for (int front = 0; front < 2; front++)
                for (size_t c = 0; c < HYI_COUNT(cosines); c++)
                    for (double side = -1.0; side < 2.0; side += 2.0) {
                        hyk_bsdf bsdf = hyk_make_bsdf(&s.view, s.material, front != 0, FEATURES);
                        if (side < 0.0 && !hyk_bsdf_transmits(bsdf)) continue;
                        if (!hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) && front == 0) continue;
                        double p = chi_square(&s, bsdf, at_cosine(cosines[c], 0.3), side, seed++);
                        if (p < level) printf("%s roughness %g cos %g front %d side %g: p %g\n", surface_names[kind], (double)roughness[r], cosines[c], front, side, p);
                        least = p < least ? p : least;
                    }
            scene_close(&s);
        }
    printf("least p of %u tests: %g, level %g\n", (unsigned)(seed - 1), least, level);
    assert_true(least >= level);
}

static void samples_agree_with_eval(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(11);
    for (int kind = 0; kind < SURFACES; kind++)
        for (int k = 0; k < 200; k++) {
            scene s;
            hyk_material m = make_material((surface)kind, ht_range(&rng, 0.02f, 1.0f), ht_range(&rng, 1.1f, 3.0f));
            m.base_color = hyk_make3(0.9f, 0.5f, 0.1f);
            scene_open(&s, m);
            hyk_bsdf bsdf = hyk_make_bsdf(&s.view, s.material, (k & 1) != 0, FEATURES);
            hyk_vec3 wo = at_cosine((double)ht_range(&rng, 0.01f, 1.0f), 1.0);
            float u = ht_uniform(&rng), v = ht_uniform(&rng), w = ht_uniform(&rng);
            hyk_bsdf_sample r = hyk_bsdf_sample_direction(&s.view, bsdf, wo, u, hyk_make2(v, w), FEATURES);
            if (r.flags != 0u && (r.flags & HYK_LOBE_DELTA) == 0u) {
                hyk_bsdf_value f = hyk_bsdf_eval(&s.view, bsdf, wo, r.wi, FEATURES);
                ht_assert_near(f.pdf / r.pdf, 1.0, 1e-5);
                ht_assert_near(r.specular.y * f.pdf, f.specular.y, 1e-5 * (double)f.specular.y);
                ht_assert_near(r.diffuse.y * f.pdf, f.diffuse.y, 1e-5 * (double)f.diffuse.y);
                assert_true(((r.flags & HYK_LOBE_TRANSMIT) != 0u) == (r.wi.z < 0.0f));
                assert_true(r.u_left >= 0.0f && r.u_left < 1.0f);
            }
            scene_close(&s);
        }
}

/* ---------------------------------------------------------------- reciprocity */

static void check_pair(const scene *s, bool front, hyk_vec3 wo, hyk_vec3 wi) {
    bool through = wi.z < 0.0f, thin = (s->material.flags & HYK_MATERIAL_THIN) != 0u;
    hyk_bsdf here = hyk_make_bsdf(&s->view, s->material, front, FEATURES);
    hyk_bsdf there = hyk_make_bsdf(&s->view, s->material, through ? !front : front, FEATURES);
    float flip = through ? -1.0f : 1.0f;
    hyk_vec3 back_o = hyk_make3(wi.x, wi.y, flip * wi.z), back_i = hyk_make3(wo.x, wo.y, flip * wo.z);
    hyk_bsdf_value f = hyk_bsdf_eval(&s->view, here, wo, wi, FEATURES), g = hyk_bsdf_eval(&s->view, there, back_o, back_i, FEATURES);
    double n = through && !thin ? (double)(here.glass_eta * here.glass_eta) : 1.0;
    double a = n * (double)(f.specular.y + f.diffuse.y) / fabs((double)wi.z), b = (double)(g.specular.y + g.diffuse.y) / fabs((double)wo.z);
    ht_assert_near(a, b, 1e-4 * (fabs(a) + fabs(b)) + 1e-12);
}

static void reciprocity(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(5);
    for (int kind = 0; kind < SURFACES; kind++)
        for (int k = 0; k < 60; k++) {
            scene s;
            hyk_material m = make_material((surface)kind, ht_range(&rng, 0.2f, 1.0f), ht_range(&rng, 1.2f, 2.5f));
            m.base_color = hyk_make3(0.9f, 0.5f, 0.1f);
            scene_open(&s, m);
            for (int pair = 0; pair < 30; pair++) {
                float a[3], b[3];
                ht_direction(&rng, a);
                ht_direction(&rng, b);
                if (fabsf(a[2]) > 1e-3f && fabsf(b[2]) > 1e-3f) check_pair(&s, (pair & 1) != 0, hyk_make3(a[0], a[1], fabsf(a[2])), hyk_make3(b[0], b[1], b[2]));
            }
            scene_close(&s);
        }
}

/* ---------------------------------------------------------------- robustness */

static bool finite3(hyk_vec3 v) { return ht_finite(v.x) && ht_finite(v.y) && ht_finite(v.z) && v.x >= 0.0f && v.y >= 0.0f && v.z >= 0.0f; }

static void check_finite(const scene *s, bool front) {
    const float z[] = { 0.0f, 1e-30f, 1e-12f, 1e-5f, 0.5f, 1.0f };
    const float u[] = { 0.0f, 1e-7f, 0.5f, 0.99999994f };
    hyk_bsdf bsdf = hyk_make_bsdf(&s->view, s->material, front, FEATURES);
    for (size_t i = 0; i < HYI_COUNT(z); i++) {
        hyk_vec3 wo = hyk_make3(sqrtf(1.0f - z[i] * z[i]), 0.0f, z[i]);
        assert_true(finite3(hyk_bsdf_albedo(&s->view, bsdf, wo, FEATURES)));
        for (size_t j = 0; j < HYI_COUNT(z); j++)
            for (int way = 0; way < 4; way++) {
                float side = way & 1 ? -1.0f : 1.0f, x = sqrtf(1.0f - z[j] * z[j]) * (way & 2 ? -1.0f : 1.0f);
                hyk_bsdf_value f = hyk_bsdf_eval(&s->view, bsdf, wo, hyk_make3(x, 0.0f, side * z[j]), FEATURES);
                if (!(finite3(f.diffuse) && finite3(f.specular) && ht_finite(f.pdf) && f.pdf >= 0.0f))
                    fail_msg("kind %u roughness %g ior %g: cos %g to %g: %g %g pdf %g", s->material.kind, (double)s->material.roughness,
                             (double)s->material.ior, (double)z[i], (double)(side * z[j]), (double)f.diffuse.x, (double)f.specular.x, (double)f.pdf);
            }
        for (size_t k = 0; k < 64; k++) {
            hyk_bsdf_sample r = hyk_bsdf_sample_direction(&s->view, bsdf, wo, u[k & 3], hyk_make2(u[k >> 2 & 3], u[k >> 4]), FEATURES);
            assert_true(finite3(r.diffuse) && finite3(r.specular) && ht_finite(r.pdf) && ht_finite(r.u_left));
            assert_true((r.flags == 0u) == (r.pdf == 0.0f));
            if (r.flags != 0u) ht_assert_near(hyk_dot(r.wi, r.wi), 1.0, 1e-5);
        }
    }
}

static void everything_is_finite(void **state) {
    (void)state;
    const float roughness[] = { 0.0f, 0.00999f, 0.01f, 0.3f, 1.0f }, iors[] = { 1.0001f, 1.0021f, 1.5f, 10.0f };
    for (int kind = 0; kind < SURFACES; kind++)
        for (size_t r = 0; r < HYI_COUNT(roughness); r++)
            for (size_t n = 0; n < HYI_COUNT(iors); n++)
                for (int white = 0; white < 2; white++) {
                    scene s;
                    hyk_material m = make_material((surface)kind, roughness[r], iors[n]);
                    m.base_color = hyk_splat((float)white);
                    if (kind == METAL && white) {
                        m.flags |= HYK_MATERIAL_COMPLEX_IOR;
                        m.eta = hyk_make3(0.0f, 0.18f, 3.0f);
                        m.k = hyk_make3(0.0f, 3.42f, 0.0f);
                    }
                    scene_open(&s, m);
                    check_finite(&s, true);
                    check_finite(&s, false);
                    scene_close(&s);
                }
}

/* Without specular features only Lambert is left, whatever the material says. */
static void lambert_alone(void **state) {
    (void)state;
    hyk_scene_view view;
    memset(&view, 0, sizeof view);
    hyk_material m = plain(HYK_MATERIAL_LAMBERT, 0.5f, 1.5f);
    m.base_color = hyk_make3(0.2f, 0.4f, 0.8f);
    for (hyk_uint features = 0; features <= HYK_NEEDS_SPECULAR; features += HYK_NEEDS_SPECULAR) {
        hyk_bsdf bsdf = hyk_make_bsdf(&view, m, false, features);
        hyk_bsdf_value f = hyk_bsdf_eval(&view, bsdf, at_cosine(0.3, 0.0), at_cosine(0.6, 2.0), features);
        ht_assert_near(f.diffuse.y, 0.4 * 0.6 / HT_PI, 1e-7);
        ht_assert_near(f.pdf, 0.6 / HT_PI, 1e-7);
        assert_true(hyk_is_black(f.specular) && hyk_bsdf_has_diffuse(bsdf) && !hyk_bsdf_is_delta_only(bsdf) && !hyk_bsdf_transmits(bsdf));
    }
    hyk_bsdf mirror = hyk_make_bsdf(&view, make_material(METAL, 0.0f, 1.5f), true, FEATURES);
    assert_true(hyk_bsdf_is_delta_only(mirror) && !hyk_bsdf_has_diffuse(mirror));
}

int hydra_test_bsdf(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fresnel_values),           cmocka_unit_test(lambert_alone),
        cmocka_unit_test(loses_energy_without_compensation), cmocka_unit_test(single_scattering_matches_published),
        cmocka_unit_test(samples_agree_with_eval),  cmocka_unit_test(reciprocity),
        cmocka_unit_test(everything_is_finite),     cmocka_unit_test(sampling_follows_density),
        cmocka_unit_test(white_furnace),
    };
    return cmocka_run_group_tests_name("bsdf", tests, NULL, NULL);
}
