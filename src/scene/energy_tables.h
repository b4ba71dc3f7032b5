/* >>scene-energy-tables: computes the albedo tables that the scene's materials need

   shaders/shared/energy.h says what a plane holds. Each value is a quadrature over visible normals, along
   meridians of the spherical cap, each split where reflected or refracted light changes sides. No random
   number: tables are the same everywhere. Materials that agree in what a plane depends on share it; rows
   that nobody reads stay zero. */
#ifndef HYI_ENERGY_TABLES_H
#define HYI_ENERGY_TABLES_H

#include "../base/threads.h"
#include "../../shaders/shared/bsdf.h"

#define HYI_ENERGY_MERIDIANS 12u /* of half a cap: isotropic */
#define HYI_ENERGY_INSIDE 28u    /* the same where total reflection may come and go between them */
#define HYI_ENERGY_ALONG 20u     /* points of a whole meridian */
#define HYI_ENERGY_PART 12u      /* points of each part of a split one */
#define HYI_ENERGY_PARTS 8u
#define HYI_ENERGY_GAUSS 12u   /* points of the rule for means, in each column */
#define HYI_ENERGY_FEATURES (HYK_NEEDS_SPECULAR | HYK_NEEDS_TRANSMISSION)
#define HYI_ENERGY_COAT_FLOATS (HYK_ENERGY_HEADER + HYK_ENERGY_STRIDE) /* a header with nothing but the coat, its row */

typedef enum hyi_energy_kind { HYI_ENERGY_COAT, HYI_ENERGY_METAL, HYI_ENERGY_PLASTIC, HYI_ENERGY_GLASS, HYI_ENERGY_KINDS } hyi_energy_kind;

typedef struct hyi_gauss {
    double x[HYI_ENERGY_GAUSS], weight[HYI_ENERGY_GAUSS]; /* on [0, 1] */
} hyi_gauss;

/* One set of planes: everything they depend on. */
typedef struct hyi_energy_job {
    hyi_energy_kind kind;
    float ior, coat, coat_roughness;
    uint32_t at;      /* first float of the planes; COAT: of its header */
    uint32_t at_coat; /* header of the coat's job, 0: a header of zeros */
    uint32_t at_metal; /* PLASTIC: the planes of the metal under the same coat */
    uint32_t rows;     /* bit r: row r is read; all only where a texture gives the roughness */
} hyi_energy_job;

typedef struct hyi_energy_build {
    hydra_context *context;
    hyk_material *materials;
    hyi_energy_job *jobs;
    size_t job_capacity;
    uint32_t job_count;
    uint64_t floats;
    uint32_t first_job, jobs_now; /* of the stage at work */
    float *tables;
    hyk_scene_view view;
    hyi_gauss gauss;
    hyk_vec2 around[HYI_ENERGY_MERIDIANS], around_inside[HYI_ENERGY_INSIDE]; /* cosines and sines of the meridians */
} hyi_energy_build;

/* ---- quadrature */

/* Legendre polynomial of degree n and its derivative. */
HYI_FN double hyi_legendre(uint32_t n, double x, double *slope) {
    double p0 = 1.0, p1 = x;
    for (uint32_t k = 2; k <= n; k++) {
        double p2 = ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k;
        p0 = p1;
        p1 = p2;
    }
    *slope = n * (x * p1 - p0) / (x * x - 1.0);
    return p1;
}

/* Roots by Newton's method from Tricomi's estimate. */
HYI_FN void hyi_make_gauss(hyi_gauss *gauss) {
    const uint32_t n = HYI_ENERGY_GAUSS;
    for (uint32_t i = 0; i < n; i++) {
        double x = cos(HYI_PI * (i + 0.75) / (n + 0.5)), slope = 1.0;
        for (int step = 0; step < 8; step++) x -= hyi_legendre(n, x, &slope) / slope;
        hyi_legendre(n, x, &slope);
        gauss->x[i] = 0.5 * (1.0 - x);
        gauss->weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
}

HYI_FN void hyi_make_meridians(hyk_vec2 *around, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        double angle = HYI_PI * (i + 0.5) / count;
        around[i] = hyk_make2((hyk_real)cos(angle), (hyk_real)sin(angle));
    }
}

/* ---- one value: integrals over the normals that wo sees */

typedef struct hyi_energy_sums {
    double lost, schlick, dielectric; /* opaque bases */
    double glass_lost, glass_back;    /* refracting glass */
} hyi_energy_sums;

HYI_FN void hyi_energy_add_opaque(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_vec3 wo, hyk_vec3 h, hyk_real weight, hyi_energy_sums *sums) {
    hyk_real cos_h = hyk_dot(wo, h), whole = hyk_coat_pass(&build->view, *bsdf, wo.z);
    hyk_vec3 wi = hyk_reflect(wo, h, cos_h);
    if (!(wi.z > 0.0f)) {
        sums->lost += (double)(weight * whole);
        return;
    }
    hyk_real pass = hyk_min(whole, hyk_coat_pass(&build->view, *bsdf, wi.z));
    hyk_real stopped = hyk_ggx_stopped(wo, wi, bsdf->alpha), kept = weight * pass * (1.0f - stopped);
    sums->lost += (double)(weight * (whole - pass + pass * stopped));
    sums->schlick += (double)(kept * hyk_schlick_weight(cos_h));
    sums->dielectric += (double)(kept * hyk_fresnel_dielectric(cos_h, bsdf->ior));
}

HYI_FN void hyi_energy_add_glass(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_vec3 wo, hyk_vec3 h, hyk_real weight, hyi_energy_sums *sums) {
    hyk_real cos_h = hyk_dot(wo, h), pass = hyk_coat_pass(&build->view, *bsdf, wo.z);
    bool inside = hyk_bsdf_is(*bsdf, HYK_BSDF_INSIDE);
    hyk_real whole = inside ? 1.0f : pass;
    hyk_vec3 wi = hyk_reflect(wo, h, cos_h);
    bool above = wi.z > 0.0f;
    if (above) pass = hyk_min(pass, hyk_coat_pass(&build->view, *bsdf, wi.z));
    hyk_real stopped = above ? hyk_ggx_stopped(wo, wi, bsdf->alpha) : 1.0f;
    hyk_real back = hyk_glass_facet_reflects(&build->view, *bsdf, cos_h, pass);
    hyk_real g = hyk_refracted_cosine(cos_h, bsdf->glass_eta);
    hyk_real along = 0.0f, stopped_along = 1.0f;
    if (g > 0.0f) {
        wi = hyk_refract(wo, h, cos_h, g, bsdf->glass_eta);
        along = hyk_glass_facet_passes(&build->view, *bsdf, cos_h, g, inside ? hyk_max(-wi.z, 0.0f) : wo.z);
        if (wi.z < 0.0f) stopped_along = hyk_ggx_stopped(wo, wi, bsdf->alpha);
    }
    /* Without a coat back + along is 1, but for rounding that would swamp the small losses. */
    hyk_real rest = bsdf->coat > 0.0f ? whole - back - along : 0.0f;
    sums->glass_lost += (double)(weight * (rest + back * stopped + along * stopped_along));
    sums->glass_back += (double)(weight * back * (1.0f - stopped));
}

/* Which way light leaves a facet: where it changes along a meridian, the integrand has a kink. */
HYI_FN uint32_t hyi_energy_ways(const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec3 h) {
    hyk_real cos_h = hyk_dot(wo, h);
    uint32_t ways = 2.0f * cos_h * h.z > wo.z ? 1u : 0u; /* reflected upwards */
    if (!glass) return ways;
    hyk_real g = hyk_refracted_cosine(cos_h, bsdf->glass_eta);
    if (!(g > 0.0f)) return ways | 2u;
    return ways | (hyk_refract(wo, h, cos_h, g, bsdf->glass_eta).z < 0.0f ? 4u : 0u);
}

/* Places on a meridian where the ways change: the ends of its parts, whose number is returned. A scan finds
   them, bisection their places. */
HYI_FN uint32_t hyi_energy_split(const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec2 around, hyk_real ends[HYI_ENERGY_PARTS]) {
    const uint32_t scan = 12;
    uint32_t count = 0, before = hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, 0.0f));
    for (uint32_t i = 1; i <= scan && count + 1 < HYI_ENERGY_PARTS; i++) {
        hyk_real lo = (hyk_real)(i - 1) / (hyk_real)scan, hi = (hyk_real)i / (hyk_real)scan;
        uint32_t after = hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, hi));
        for (int step = 0; step < 12 && before != after; step++) {
            hyk_real middle = 0.5f * (lo + hi);
            if (hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, middle)) == before) lo = middle;
            else hi = middle;
        }
        if (before != after) ends[count++] = 0.5f * (lo + hi);
        before = after;
    }
    ends[count++] = 1.0f;
    return count;
}

/* Midpoints in t, y = t^3 (10 - 15 t + 6 t^2): that undoes the square roots at both ends of a part, reaches into
   the layer of width alpha^2 where facets are steep, and converges as for periodic integrands (Sidi 1993). */
HYI_FN void hyi_energy_add_part(const hyi_energy_build *build, const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec2 around, hyk_real lo,
                                hyk_real width, uint32_t points, hyi_energy_sums *sums) {
    for (uint32_t i = 0; i < points; i++) {
        hyk_real t = ((hyk_real)i + 0.5f) / (hyk_real)points;
        hyk_real weight = 30.0f * hyk_square(t * (1.0f - t)) * width / (hyk_real)points;
        hyk_real y = t * t * t * (10.0f + t * (6.0f * t - 15.0f));
        hyk_vec3 h = hyk_ggx_sample_around(wo, bsdf->alpha, around, lo + width * y);
        if (glass) hyi_energy_add_glass(build, bsdf, wo, h, weight, sums);
        else hyi_energy_add_opaque(build, bsdf, wo, h, weight, sums);
    }
}

HYI_FN hyi_energy_sums hyi_energy_integrate(const hyi_energy_build *build, const hyk_bsdf *bsdf, bool glass, hyk_real cos_o) {
    hyi_energy_sums sums;
    bool inside = glass && hyk_bsdf_is(*bsdf, HYK_BSDF_INSIDE);
    const uint32_t meridians = inside ? HYI_ENERGY_INSIDE : HYI_ENERGY_MERIDIANS;
    memset(&sums, 0, sizeof sums);
    hyk_vec3 wo = hyk_make3(hyk_safe_sqrt((1.0f - cos_o) * (1.0f + cos_o)), 0.0f, cos_o);
    for (uint32_t j = 0; j < meridians; j++) {
        hyk_vec2 around = inside ? build->around_inside[j] : build->around[j];
        hyk_real ends[HYI_ENERGY_PARTS], lo = 0.0f;
        uint32_t parts = hyi_energy_split(bsdf, glass, wo, around, ends);
        for (uint32_t i = 0; i < parts; lo = ends[i++])
            hyi_energy_add_part(build, bsdf, glass, wo, around, lo, ends[i] - lo, parts > 1 ? HYI_ENERGY_PART : HYI_ENERGY_ALONG, &sums);
    }
    sums.lost /= meridians;
    sums.schlick /= meridians;
    sums.dielectric /= meridians;
    sums.glass_lost /= meridians;
    sums.glass_back /= meridians;
    return sums;
}

/* ---- one row */

/* 2 integral f(cos) cos dcos, f as the kernels will read it: smooth_part (the plane's limit) plus the differences,
   interpolated between a row and the next, within 0 and 1. Gauss in the logarithm of the cosine: a column may
   span decades. */
typedef double (*hyi_smooth_part)(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real cos_theta);

HYI_FN double hyi_energy_mean(const hyi_energy_build *build, const hyk_bsdf *bsdf, const float *row, double share, hyi_smooth_part smooth_part) {
    double sum = 0.0, hi = log(1e-3 * (double)hyk_energy_cosine(1.0f, bsdf->alpha));
    const float *next = share > 0.0 ? row + HYK_ENERGY_STRIDE : row;
    for (uint32_t c = 0; c + 1 < HYK_ENERGY_COLUMNS; c++) {
        double lo = hi, left = (double)row[c] * (1.0 - share) + (double)next[c] * share, right = (double)row[c + 1] * (1.0 - share) + (double)next[c + 1] * share;
        hi = log((double)hyk_energy_cosine((hyk_real)(c + 1), bsdf->alpha));
        for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) {
            double cosine = exp(lo + (hi - lo) * build->gauss.x[i]);
            double t = (double)hyk_energy_column((hyk_real)cosine, bsdf->alpha) - c;
            double f = left + (right - left) * t;
            if (smooth_part) f += smooth_part(build, bsdf, (hyk_real)cosine);
            f = f < 0.0 ? 0.0 : f > 1.0 ? 1.0 : f;
            sum += 2.0 * f * cosine * cosine * (hi - lo) * build->gauss.weight[i];
        }
    }
    return sum;
}

HYI_FN double hyi_smooth_schlick(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)(hyk_coat_pass(&build->view, *bsdf, c) * hyk_schlick_weight(c));
}
HYI_FN double hyi_smooth_diffuse(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)(hyk_coat_pass(&build->view, *bsdf, c) * (1.0f - hyk_fresnel_dielectric(c, bsdf->ior)));
}
HYI_FN double hyi_smooth_glass(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)hyk_glass_facet_reflects(&build->view, *bsdf, c, hyk_coat_pass(&build->view, *bsdf, c));
}

/* A material of all that a job's planes depend on, at one roughness, with no plane but the coat's. */
HYI_FN hyk_bsdf hyi_energy_bsdf(const hyi_energy_build *build, const hyi_energy_job *job, hyk_real alpha, bool front) {
    hyk_material m;
    memset(&m, 0, sizeof m);
    m.kind = HYK_MATERIAL_METALLIC_ROUGHNESS;
    m.transmission = job->kind == HYI_ENERGY_GLASS ? 1.0f : 0.0f;
    m.ior = job->ior;
    m.clearcoat = job->coat;
    m.clearcoat_roughness = job->coat_roughness;
    m.energy_table = job->at_coat;
    hyk_bsdf bsdf = hyk_make_bsdf(&build->view, m, front, HYI_ENERGY_FEATURES);
    bsdf.alpha = alpha;
    return bsdf;
}

HYI_FN void hyi_energy_coat(hyi_energy_build *build, const hyi_energy_job *job) {
    float *header = build->tables + job->at, *row = header + HYK_ENERGY_HEADER;
    hyi_energy_job bare = *job;
    bare.at_coat = 0;
    bare.coat = 0.0f;
    bare.ior = HYK_COAT_IOR;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, &bare, hyk_alpha_of_roughness(job->coat_roughness), true);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        double sum = hyi_energy_integrate(build, &bsdf, false, cosine).dielectric;
        row[c] = (float)(sum - (double)hyk_fresnel_dielectric(cosine, HYK_COAT_IOR));
    }
    header[HYK_ENERGY_AT_COAT] = (float)((job->at + HYK_ENERGY_HEADER) / HYK_ENERGY_UNIT);
}

HYI_FN void hyi_energy_metal_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    float *lost = build->tables + job->at + r * HYK_ENERGY_STRIDE, *schlick = lost + HYK_ENERGY_PLANE;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), true);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        hyi_energy_sums sums = hyi_energy_integrate(build, &bsdf, false, cosine);
        lost[c] = (float)sums.lost;
        schlick[c] = (float)(sums.schlick - hyi_smooth_schlick(build, &bsdf, cosine));
    }
}

HYI_FN double hyi_dielectric_mean(const hyi_gauss *gauss, float ior) {
    double sum = 0.0;
    for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) { /* cos = x^2: the steep end is at 0 */
        double c = gauss->x[i] * gauss->x[i];
        sum += 4.0 * gauss->weight[i] * gauss->x[i] * c * (double)hyk_fresnel_dielectric((hyk_real)c, ior);
    }
    return sum;
}

HYI_FN void hyi_energy_plastic_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    float *row = build->tables + job->at + r * HYK_ENERGY_STRIDE;
    const float *lost = build->tables + job->at_metal + r * HYK_ENERGY_STRIDE;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), true);
    hyk_real mean = build->tables[job->at_metal + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + r * HYK_ENERGY_MEANS] * hyk_energy_lost_scale(bsdf.alpha);
    hyk_real bounce = hyk_multiple_scattering((hyk_real)hyi_dielectric_mean(&build->gauss, job->ior), 1.0f - mean);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        double back = hyi_energy_integrate(build, &bsdf, false, cosine).dielectric;
        double whole = (double)hyk_coat_pass(&build->view, bsdf, cosine);
        row[c] = (float)(whole - back - (double)(bounce * lost[c]) - hyi_smooth_diffuse(build, &bsdf, cosine));
    }
}

HYI_FN void hyi_energy_glass_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    for (uint32_t side = 0; side < 2; side++) {
        float *lost = build->tables + job->at + 2 * side * HYK_ENERGY_PLANE + r * HYK_ENERGY_STRIDE, *back = lost + HYK_ENERGY_PLANE;
        hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), side == 0);
        for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
            hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
            hyi_energy_sums sums = hyi_energy_integrate(build, &bsdf, true, cosine);
            lost[c] = (float)sums.glass_lost;
            back[c] = (float)(sums.glass_back - hyi_smooth_glass(build, &bsdf, cosine));
        }
    }
}

/* Means from a row up to the next (which may have to be there: share > 0). */
HYI_FN void hyi_energy_row_means(hyi_energy_build *build, const hyi_energy_job *job, uint32_t plane, uint32_t r) {
    float *values = build->tables + job->at + plane * HYK_ENERGY_PLANE;
    float *means = values + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + r * HYK_ENERGY_MEANS;
    bool lost = job->kind == HYI_ENERGY_PLASTIC ? false : plane % 2 == 0;
    hyi_smooth_part smooth_part = lost ? NULL : job->kind == HYI_ENERGY_METAL ? hyi_smooth_schlick : job->kind == HYI_ENERGY_GLASS ? hyi_smooth_glass : hyi_smooth_diffuse;
    uint32_t count = r + 1 < HYK_ENERGY_ROWS && (job->rows >> (r + 1) & 1u) ? HYK_ENERGY_MEANS : 1u;
    for (uint32_t j = 0; j < count; j++) {
        double share = (double)j / HYK_ENERGY_MEANS;
        hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)(r + share)), plane < 2);
        double mean = hyi_energy_mean(build, &bsdf, values + r * HYK_ENERGY_STRIDE, share, smooth_part);
        means[j] = (float)(lost ? mean / (double)hyk_energy_lost_scale(bsdf.alpha) : mean);
    }
}

/* ---- what the scene needs */

/* The job that makes these planes: an earlier one, or a new one. */
HYI_FN hydra_result hyi_energy_find(hyi_energy_build *build, hyi_energy_kind kind, float ior, const hyk_material *m, uint32_t *found) {
    hyi_energy_job job;
    memset(&job, 0, sizeof job);
    job.kind = kind;
    job.ior = kind == HYI_ENERGY_COAT || kind == HYI_ENERGY_METAL ? HYK_COAT_IOR : ior;
    if (m->kind == HYK_MATERIAL_METALLIC_ROUGHNESS && m->clearcoat > 0.0f) {
        job.coat = kind == HYI_ENERGY_COAT ? 0.0f : m->clearcoat;
        job.coat_roughness = m->clearcoat_roughness;
    }
    for (*found = 0; *found < build->job_count; ++*found) {
        const hyi_energy_job *old = &build->jobs[*found];
        if (old->kind == kind && old->ior == job.ior && old->coat == job.coat && old->coat_roughness == job.coat_roughness) return HYDRA_OK;
    }
    HYI_TRY(hyi_grow_array(build->context, &build->jobs, &build->job_capacity, (size_t)build->job_count + 1));
    build->jobs[build->job_count++] = job;
    return HYDRA_OK;
}

HYI_FN bool hyi_may_be_rough(const hyk_material *m) {
    return m->metallic_roughness_texture != HYK_NONE ? m->roughness > 0.0f : !hyk_is_smooth(hyk_alpha_of_roughness(m->roughness));
}

/* Whether a material needs a kind of plane. Smooth bases need the plastic's mean, and nothing else. */
HYI_FN bool hyi_energy_needs(const hyk_material *m, hyi_energy_kind kind) {
    bool rough = hyi_may_be_rough(m), thin = (m->flags & HYK_MATERIAL_THIN) != 0;
    if (m->kind == HYK_MATERIAL_LAMBERT) return false;
    if (m->kind == HYK_MATERIAL_CONDUCTOR) return rough && kind == HYI_ENERGY_METAL;
    if (m->kind == HYK_MATERIAL_DIELECTRIC) return rough && (kind == HYI_ENERGY_GLASS) != thin && kind != HYI_ENERGY_COAT;
    switch (kind) {
    case HYI_ENERGY_COAT: return m->clearcoat > 0.0f && !hyk_is_smooth(hyk_alpha_of_roughness(m->clearcoat_roughness));
    case HYI_ENERGY_GLASS: return rough && m->transmission > 0.0f && !thin;
    default: return true;
    }
}

/* A constant roughness lies between two rows. */
HYI_FN uint32_t hyi_energy_rows_read(const hyk_material *m) {
    if (m->metallic_roughness_texture != HYK_NONE) return 0xffffffffu >> (32u - HYK_ENERGY_ROWS);
    hyk_real alpha = hyk_max(hyk_alpha_of_roughness(m->roughness), HYK_SMOOTH_ALPHA);
    return 3u << (hyk_energy_rows_of(alpha).offset / HYK_ENERGY_STRIDE);
}

HYI_FN hydra_result hyi_energy_plan(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    for (uint32_t i = 0; i < count; i++)
        for (int kind = 0; kind < HYI_ENERGY_KINDS; kind++) {
            used[i][kind] = HYK_NONE;
            const hyk_material *m = &build->materials[i];
            if (!hyi_energy_needs(m, (hyi_energy_kind)kind)) continue;
            HYI_TRY(hyi_energy_find(build, (hyi_energy_kind)kind, m->ior, m, &used[i][kind]));
            build->jobs[used[i][kind]].rows |= hyi_energy_rows_read(m);
        }
    return HYDRA_OK;
}

/* Places headers and planes: a header of zeros, the materials' headers, then job by job. */
HYI_FN hydra_result hyi_energy_place(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    static const uint32_t sizes[HYI_ENERGY_KINDS] = { HYI_ENERGY_COAT_FLOATS, 2 * HYK_ENERGY_PLANE, HYK_ENERGY_PLANE, 4 * HYK_ENERGY_PLANE };
    build->floats = HYK_ENERGY_HEADER;
    for (uint32_t i = 0; i < count; i++) {
        bool any = false;
        for (int kind = 0; kind < HYI_ENERGY_KINDS; kind++) any = any || used[i][kind] != HYK_NONE;
        build->materials[i].energy_table = any ? (uint32_t)build->floats : HYK_NONE;
        if (any) build->floats += HYK_ENERGY_HEADER;
        if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24) break;
    }
    for (uint32_t j = 0; j < build->job_count; j++) {
        build->jobs[j].at = (uint32_t)build->floats;
        build->floats += sizes[build->jobs[j].kind];
        if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24) break;
    }
    if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24)
        return hyi_fail(build->context, HYDRA_ERROR_OVERFLOW, "albedo tables of too many different materials");
    for (uint32_t i = 0; i < count; i++)
        for (int kind = HYI_ENERGY_METAL; kind < HYI_ENERGY_KINDS; kind++) {
            if (used[i][kind] == HYK_NONE) continue;
            hyi_energy_job *job = &build->jobs[used[i][kind]];
            if (used[i][HYI_ENERGY_COAT] != HYK_NONE) job->at_coat = build->jobs[used[i][HYI_ENERGY_COAT]].at;
            if (kind == HYI_ENERGY_PLASTIC) job->at_metal = build->jobs[used[i][HYI_ENERGY_METAL]].at;
        }
    return HYDRA_OK;
}

HYI_FN float hyi_energy_place_of(const hyi_energy_build *build, uint32_t job) {
    if (job == HYK_NONE) return 0.0f;
    uint32_t at = build->jobs[job].at + (build->jobs[job].kind == HYI_ENERGY_COAT ? HYK_ENERGY_HEADER : 0u);
    return (float)(at / HYK_ENERGY_UNIT);
}

/* Hemispherical mean of one channel's complex Fresnel reflectance. */
HYI_FN double hyi_complex_mean(const hyi_gauss *gauss, hyk_real eta, hyk_real k) {
    double sum = 0.0;
    for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) {
        double c = gauss->x[i] * gauss->x[i];
        sum += 4.0 * gauss->weight[i] * gauss->x[i] * c * (double)hyk_fresnel_complex((hyk_real)c, eta, k);
    }
    return sum;
}

HYI_FN void hyi_energy_header(hyi_energy_build *build, const hyk_material *m, const uint32_t *used) {
    float *header = build->tables + m->energy_table;
    if (m->kind == HYK_MATERIAL_CONDUCTOR && (m->flags & HYK_MATERIAL_COMPLEX_IOR) != 0) {
        header[HYK_ENERGY_METAL_MEAN] = (float)hyi_complex_mean(&build->gauss, m->eta.x, m->k.x);
        header[HYK_ENERGY_METAL_MEAN + 1] = (float)hyi_complex_mean(&build->gauss, m->eta.y, m->k.y);
        header[HYK_ENERGY_METAL_MEAN + 2] = (float)hyi_complex_mean(&build->gauss, m->eta.z, m->k.z);
    }
    header[HYK_ENERGY_IOR_MEAN] = (float)hyi_dielectric_mean(&build->gauss, m->ior);
    header[HYK_ENERGY_AT_METAL] = hyi_energy_place_of(build, used[HYI_ENERGY_METAL]);
    header[HYK_ENERGY_AT_PLASTIC] = hyi_energy_place_of(build, used[HYI_ENERGY_PLASTIC]);
    header[HYK_ENERGY_AT_GLASS] = hyi_energy_place_of(build, used[HYI_ENERGY_GLASS]);
    header[HYK_ENERGY_AT_COAT] = hyi_energy_place_of(build, used[HYI_ENERGY_COAT]);
}

/* ---- building: coats, then metals that read them, then the rest, which reads both */

HYI_FN void hyi_energy_task(void *argument, uint32_t index) {
    hyi_energy_build *build = (hyi_energy_build *)argument;
    const hyi_energy_job *job = &build->jobs[build->first_job + index / HYK_ENERGY_ROWS];
    uint32_t row = index % HYK_ENERGY_ROWS;
    if (job->kind == HYI_ENERGY_COAT && row == 0) hyi_energy_coat(build, job);
    if (!(job->rows >> row & 1u)) return;
    if (job->kind == HYI_ENERGY_METAL) hyi_energy_metal_row(build, job, row);
    if (job->kind == HYI_ENERGY_PLASTIC) hyi_energy_plastic_row(build, job, row);
    if (job->kind == HYI_ENERGY_GLASS) hyi_energy_glass_row(build, job, row);
}

HYI_FN void hyi_energy_mean_task(void *argument, uint32_t index) {
    static const uint32_t planes[HYI_ENERGY_KINDS] = { 0, 2, 1, 4 };
    hyi_energy_build *build = (hyi_energy_build *)argument;
    const hyi_energy_job *job = &build->jobs[build->first_job + index / HYK_ENERGY_ROWS];
    uint32_t row = index % HYK_ENERGY_ROWS;
    for (uint32_t plane = 0; plane < planes[job->kind] && (job->rows >> row & 1u); plane++) hyi_energy_row_means(build, job, plane, row);
}

HYI_FN int hyi_energy_stage(hyi_energy_kind kind) { return kind == HYI_ENERGY_COAT ? 0 : kind == HYI_ENERGY_METAL ? 1 : 2; }

HYI_FN int hyi_energy_compare(const void *a, const void *b) {
    return hyi_energy_stage(((const hyi_energy_job *)a)->kind) - hyi_energy_stage(((const hyi_energy_job *)b)->kind);
}

HYI_FN void hyi_energy_compute(hyi_energy_build *build) {
    uint32_t done = 0;
    qsort(build->jobs, build->job_count, sizeof *build->jobs, hyi_energy_compare);
    while (done < build->job_count) {
        uint32_t end = done;
        while (end < build->job_count && hyi_energy_stage(build->jobs[end].kind) == hyi_energy_stage(build->jobs[done].kind)) end++;
        build->first_job = done;
        hyi_parallel(build->context, (end - done) * HYK_ENERGY_ROWS, hyi_energy_task, build);
        hyi_parallel(build->context, (end - done) * HYK_ENERGY_ROWS, hyi_energy_mean_task, build);
        done = end;
    }
}

HYI_FN hydra_result hyi_energy_run(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    HYI_TRY(hyi_energy_plan(build, count, used));
    HYI_TRY(hyi_energy_place(build, count, used));
    if (build->floats == HYK_ENERGY_HEADER) {
        build->floats = 0;
        return HYDRA_OK;
    }
    HYI_TRY(hyi_alloc_array(build->context, &build->tables, (size_t)build->floats));
    memset(build->tables, 0, (size_t)build->floats * sizeof *build->tables);
    build->view.energy_tables = build->tables;
    hyi_make_gauss(&build->gauss);
    hyi_make_meridians(build->around, HYI_ENERGY_MERIDIANS);
    hyi_make_meridians(build->around_inside, HYI_ENERGY_INSIDE);
    for (uint32_t i = 0; i < count; i++)
        if (build->materials[i].energy_table != HYK_NONE) hyi_energy_header(build, &build->materials[i], used[i]);
    hyi_energy_compute(build);
    return HYDRA_OK;
}

/* Fills energy_table of every material and makes the tables they point into: *tables, *table_count floats, to be
   freed with hyi_free_array; NULL and 0 where no material needs any. */
HYI_FN hydra_result hyi_energy_tables_build(hydra_context *context, hyk_material *materials, uint32_t count, float **tables,
                                            size_t *table_count) {
    hyi_energy_build build;
    uint32_t(*used)[HYI_ENERGY_KINDS];
    memset(&build, 0, sizeof build);
    build.context = context;
    build.materials = materials;
    *tables = NULL;
    *table_count = 0;
    HYI_TRY(hyi_alloc_array(context, &used, count));
    hydra_result result = hyi_energy_run(&build, count, used);
    hyi_free_array(context, &used, count);
    hyi_free_array(context, &build.jobs, build.job_capacity);
    *tables = build.tables;
    *table_count = (size_t)build.floats;
    return result;
}

#endif /* HYI_ENERGY_TABLES_H */
