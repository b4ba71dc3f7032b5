/* >>shared-energy: tables of the energy that single scattering loses, and how they are read

   A plane holds one function of (cos, alpha): HYK_ENERGY_ROWS rows uniform in roughness = sqrt(alpha) from
   0.01 to 1, each of HYK_ENERGY_COLUMNS values uniform in sqrt(x), x = cos (1 + 2 alpha) / (cos + 2 alpha). That
   x follows the features of masking, which sit at cos ~ alpha, so that rows line up however small alpha is.
   What does not vanish with alpha is stored as the difference to its smooth limit, so that nothing needs
   resolution at cos >> alpha. After the rows come the means 2 integral f(cos) cos dcos, at finer steps of alpha:
   they must be the means of what interpolation gives, or product lobes do not conserve energy.

   A material's header: its own constants and where its planes are (in units of eight floats, exact in float;
   0: it has none). Written by src/scene/energy_tables.h. */
#ifndef HYK_ENERGY_H
#define HYK_ENERGY_H

#include "fresnel.h"
#include "microfacet.h"
#include "views.h"

#define HYK_ENERGY_ROWS 32u
#define HYK_ENERGY_COLUMNS 32u
#define HYK_ENERGY_STRIDE 32u
#define HYK_ENERGY_MEANS 8u /* per row */
#define HYK_ENERGY_PLANE 1280u
#define HYK_ENERGY_UNIT 8u

#define HYK_ENERGY_HEADER 8u
#define HYK_ENERGY_METAL_MEAN 0u  /* r, g, b: hemispherical mean of the complex Fresnel reflectance */
#define HYK_ENERGY_IOR_MEAN 3u    /* the same of the dielectric, from outside */
#define HYK_ENERGY_AT_METAL 4u    /* planes: loss of the white metal; its Schlick part */
#define HYK_ENERGY_AT_PLASTIC 5u  /* plane: what reaches the diffuse base */
#define HYK_ENERGY_AT_GLASS 6u    /* planes: loss from outside, reflectance from outside, both from inside */
#define HYK_ENERGY_AT_COAT 7u     /* one row: the coat's reflectance at its roughness */

/* Means at which a lobe of lost energy is not worth having: its whole albedo is below this. */
#define HYK_ENERGY_LEAST HYK_C(1e-12)

/* Where a direction falls between the columns, whatever the row. */
HYK_FN hyk_real hyk_energy_column(hyk_real cos_theta, hyk_real alpha) {
    hyk_real c = hyk_saturate(cos_theta), width = 2.0f * alpha;
    return hyk_sqrt(c * (1.0f + width) / (c + width)) * (HYK_TO_REAL(HYK_ENERGY_COLUMNS) - 1.0f);
}
/* Its inverse: the cosine of a column, for the table's builder. */
HYK_FN hyk_real hyk_energy_cosine(hyk_real column, hyk_real alpha) {
    hyk_real s = column / (HYK_TO_REAL(HYK_ENERGY_COLUMNS) - 1.0f);
    hyk_real x = s * s, width = 2.0f * alpha;
    return hyk_saturate(x * width / hyk_max(1.0f - x + width, 0.5f * width));
}
HYK_FN hyk_real hyk_energy_row(hyk_real alpha) {
    hyk_real t = (hyk_sqrt(alpha) - HYK_C(0.01)) * HYK_C(1.0 / 0.99);
    return hyk_saturate(t) * (HYK_TO_REAL(HYK_ENERGY_ROWS) - 1.0f);
}
HYK_FN hyk_real hyk_energy_row_alpha(hyk_real row) {
    return hyk_square(HYK_C(0.01) + HYK_C(0.99) * row / (HYK_TO_REAL(HYK_ENERGY_ROWS) - 1.0f));
}

/* Index of the interval that holds x, of last + 1 nodes. */
HYK_FN hyk_uint hyk_energy_interval(hyk_real x, hyk_uint last) {
    return hyk_min_uint(HYK_TO_UINT(hyk_max(x, 0.0f)), last - 1u);
}

/* Two neighbouring rows of every plane, and the share of the second. */
HYK_STRUCT(hyk_energy_rows) {
    hyk_uint offset;
    hyk_real share;
} HYK_END(hyk_energy_rows)

HYK_FN hyk_energy_rows hyk_energy_rows_of(hyk_real alpha) {
    hyk_real row = hyk_energy_row(alpha);
    hyk_uint i = hyk_energy_interval(row, HYK_ENERGY_ROWS - 1u);
    hyk_energy_rows r;
    r.offset = i * HYK_ENERGY_STRIDE;
    r.share = row - HYK_TO_REAL(i);
    return r;
}

HYK_FN hyk_real hyk_energy_mean(hyk_view view, hyk_uint plane, hyk_energy_rows rows) {
    hyk_real x = rows.share * HYK_TO_REAL(HYK_ENERGY_MEANS);
    hyk_uint j = hyk_energy_interval(x, HYK_ENERGY_MEANS);
    hyk_uint i = plane + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + rows.offset / HYK_ENERGY_STRIDE * HYK_ENERGY_MEANS + j;
    return hyk_lerp(HYK_LOAD_ENERGY(view, i), HYK_LOAD_ENERGY(view, i + 1u), x - HYK_TO_REAL(j));
}

/* Mean of a plane of losses. Those fall as alpha^2 log(1 / alpha), which no straight line between rows follows:
   their means are stored over this. */
HYK_FN hyk_real hyk_energy_lost_scale(hyk_real alpha) {
    hyk_real a = hyk_max(alpha, HYK_SMOOTH_ALPHA);
    return a * a * hyk_lost_norm(a);
}
HYK_FN hyk_real hyk_energy_mean_lost(hyk_view view, hyk_uint plane, hyk_energy_rows rows, hyk_real alpha) {
    return hyk_saturate(hyk_energy_mean(view, plane, rows) * hyk_energy_lost_scale(alpha));
}

/* One row, linearly in the column. */
HYK_FN hyk_real hyk_energy_in_row(hyk_view view, hyk_uint row, hyk_real column) {
    hyk_uint i = hyk_energy_interval(column, HYK_ENERGY_COLUMNS - 1u);
    return hyk_lerp(HYK_LOAD_ENERGY(view, row + i), HYK_LOAD_ENERGY(view, row + i + 1u), column - HYK_TO_REAL(i));
}

HYK_FN hyk_real hyk_energy_lookup(hyk_view view, hyk_uint plane, hyk_energy_rows rows, hyk_real column) {
    hyk_uint row = plane + rows.offset;
    return hyk_lerp(hyk_energy_in_row(view, row, column), hyk_energy_in_row(view, row + HYK_ENERGY_STRIDE, column), rows.share);
}

/* Plane offset out of a header; 0: none. */
HYK_FN hyk_uint hyk_energy_plane(hyk_view view, hyk_uint header, hyk_uint field) {
    return HYK_TO_UINT(HYK_LOAD_ENERGY(view, header + field)) * HYK_ENERGY_UNIT;
}

/* Albedo of all further bounces between micro facets of reflectance f (its mean), where single scattering
   keeps the share `kept`: f^2 kept / (1 - f (1 - kept)) of what it loses (Kulla & Conty 2017). */
HYK_FN hyk_real hyk_multiple_scattering(hyk_real f, hyk_real kept) {
    return hyk_min(f * f * kept / hyk_max(1.0f - f * (1.0f - kept), HYK_REAL_EPSILON), 1.0f);
}

#endif /* HYK_ENERGY_H */
