/* >>shared-environment: radiance from infinitely far, and directions in proportion to it

   A map is sampled over the cells between texel centres (light_layouts.h), in proportion to the bilinearly
   interpolated luminance itself: within a cell the density is the bilinear function of the longitude and of
   the share of the cell's solid angle above the point. So the density of a direction is luminance over
   environment_integral, to within the difference between latitude and that share; no tables are needed to
   tell it, and a pixel that is not black has a density. */
#ifndef HYK_ENVIRONMENT_H
#define HYK_ENVIRONMENT_H

#include "sampling.h"
#include "views.h"

/* A direction on the map: cell and place in it. */
HYK_STRUCT(hyk_map_place) {
    hyk_uint column, row; /* of the cell: 0..width-1, 0..height */
    hyk_real s, t;        /* along the row, down the column: 0..1 in texels */
} HYK_END(hyk_map_place)

/* Latitudes where a row of cells begins and ends, as angles from +Y in units of pi: rows at the poles are halves. */
HYK_FN hyk_vec2 hyk_map_row_range(hyk_uint row, hyk_uint height) {
    hyk_real h = HYK_TO_REAL(height);
    return hyk_make2(row == 0u ? 0.0f : (HYK_TO_REAL(row) - 0.5f) / h, row == height ? 1.0f : (HYK_TO_REAL(row) + 0.5f) / h);
}

/* The environment is turned by its rotation about +Y: what stood at -Z moves towards -X. */
HYK_FN hyk_map_place hyk_place_on_map(hyk_view view, hyk_vec3 direction) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    /* 0 - z, not -z: at a pole C would tell 0 from -0, devices do not */
    hyk_real turn = (hyk_atan2(direction.x, 0.0f - direction.z) + HYK_CONSTANTS(view).environment_rotation) * (0.5f * HYK_INV_PI) + 0.5f;
    hyk_real around = hyk_sqrt(direction.x * direction.x + direction.z * direction.z);
    /* acos(y), but precise at the poles */
    hyk_real v = hyk_atan2(around, direction.y) * HYK_INV_PI;
    hyk_real x = (turn - hyk_floor(turn)) * HYK_TO_REAL(width) + (HYK_TO_REAL(width) - 0.5f);
    hyk_real y = hyk_clamp(v, 0.0f, 1.0f) * HYK_TO_REAL(height) + 0.5f;
    hyk_uint column = HYK_TO_UINT(x);
    hyk_map_place place;
    place.row = hyk_min_uint(HYK_TO_UINT(y), height);
    place.s = x - HYK_TO_REAL(column);
    place.t = hyk_saturate(y - HYK_TO_REAL(place.row));
    place.column = column % width;
    return place;
}

HYK_FN hyk_vec3 hyk_map_texel(hyk_view view, hyk_uint column, hyk_uint row) {
    hyk_uint at = 3u * (row * HYK_CONSTANTS(view).environment_width + column);
    return hyk_make3(HYK_LOAD_ENVIRONMENT(view, at), HYK_LOAD_ENVIRONMENT(view, at + 1u), HYK_LOAD_ENVIRONMENT(view, at + 2u));
}

/* The four texels at a cell's corners: rows above and below, columns left and right. */
HYK_STRUCT(hyk_map_cell) {
    hyk_vec3 above_left, above_right, below_left, below_right;
} HYK_END(hyk_map_cell)

HYK_FN hyk_map_cell hyk_load_map_cell(hyk_view view, hyk_uint column, hyk_uint row) {
    hyk_uint right = column + 1u == HYK_CONSTANTS(view).environment_width ? 0u : column + 1u;
    hyk_uint above = row == 0u ? 0u : row - 1u, below = hyk_min_uint(row, HYK_CONSTANTS(view).environment_height - 1u);
    hyk_map_cell cell;
    cell.above_left = hyk_map_texel(view, column, above);
    cell.above_right = hyk_map_texel(view, right, above);
    cell.below_left = hyk_map_texel(view, column, below);
    cell.below_right = hyk_map_texel(view, right, below);
    return cell;
}

HYK_FN hyk_bool hyk_has_environment_map(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_ENVIRONMENT_MAP) && HYK_CONSTANTS(view).environment_width > 0u;
}

/* Radiance that arrives from a unit direction. */
HYK_FN hyk_vec3 hyk_environment_radiance(hyk_view view, hyk_vec3 direction, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) return hyk_zero3();
    if (!hyk_has_environment_map(view, features)) return HYK_CONSTANTS(view).environment;
    hyk_map_place at = hyk_place_on_map(view, direction);
    hyk_map_cell c = hyk_load_map_cell(view, at.column, at.row);
    hyk_vec3 above = hyk_lerp3(c.above_left, c.above_right, at.s), below = hyk_lerp3(c.below_left, c.below_right, at.s);
    return hyk_mul(HYK_CONSTANTS(view).environment, hyk_lerp3(above, below, at.t));
}

/* ---- sampling the map */

/* Share of a row's solid angle above the place t: cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2). */
HYK_FN hyk_real hyk_map_share_above(hyk_uint row, hyk_uint height, hyk_real t) {
    hyk_vec2 range = hyk_map_row_range(row, height);
    hyk_real down = hyk_max((row == 0u ? t - 0.5f : t) / HYK_TO_REAL(height), 0.0f);
    hyk_real span = range.y - range.x;
    hyk_real part = hyk_sin(HYK_HALF_PI * down) * hyk_sin(HYK_HALF_PI * (2.0f * range.x + down));
    hyk_real whole = hyk_sin(HYK_HALF_PI * span) * hyk_sin(HYK_HALF_PI * (2.0f * range.x + span));
    return hyk_saturate(part / whole);
}

HYK_FN hyk_real hyk_map_luminance(hyk_vec3 texel) { return hyk_max(hyk_luminance(texel), 0.0f); }

HYK_FN hyk_real hyk_pdf_map(hyk_view view, hyk_vec3 direction) {
    hyk_map_place at = hyk_place_on_map(view, direction);
    hyk_map_cell c = hyk_load_map_cell(view, at.column, at.row);
    hyk_real share = hyk_map_share_above(at.row, HYK_CONSTANTS(view).environment_height, at.t);
    hyk_real above = hyk_lerp(hyk_map_luminance(c.above_left), hyk_map_luminance(c.above_right), at.s);
    hyk_real below = hyk_lerp(hyk_map_luminance(c.below_left), hyk_map_luminance(c.below_right), at.s);
    return hyk_lerp(above, below, share) / HYK_CONSTANTS(view).environment_integral;
}

HYK_STRUCT(hyk_map_choice) {
    hyk_uint index;
    hyk_real u;
} HYK_END(hyk_map_choice)

/* Bisects [0, count) by the shares stored from base on. */
HYK_FN hyk_map_choice hyk_bisect_map(hyk_view view, hyk_uint base, hyk_uint count, hyk_chooser chooser) {
    hyk_uint first = 0u, last = count;
    while (last - first > 1u) {
        hyk_uint middle = first + (last - first) / 2u;
        hyk_real share = HYK_LOAD_ENVIRONMENT_CDF(view, base + middle);
        chooser = hyk_choose_share(chooser, hyk_abs(share), share < 0.0f);
        first = chooser.second ? middle : first;
        last = chooser.second ? last : middle;
    }
    hyk_map_choice choice;
    choice.index = first;
    choice.u = hyk_choice_rest(chooser);
    return choice;
}

HYK_FN hyk_vec3 hyk_map_direction(hyk_view view, hyk_uint column, hyk_uint row, hyk_real s, hyk_real share_above) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    hyk_vec2 range = hyk_map_row_range(row, height);
    /* measured from the nearer pole: 1 - cos keeps its bits there */
    hyk_bool south = 2u * row > height;
    hyk_real from = south ? 1.0f - range.y : range.x, to = south ? 1.0f - range.x : range.y;
    hyk_real near_pole = hyk_sin(HYK_HALF_PI * from), far_pole = hyk_sin(HYK_HALF_PI * to);
    hyk_real h = 2.0f * hyk_lerp(near_pole * near_pole, far_pole * far_pole, south ? 1.0f - share_above : share_above);
    hyk_real turn = (HYK_TO_REAL(column) + s + 0.5f) / HYK_TO_REAL(width) - 0.5f;
    hyk_real phi = HYK_TWO_PI * turn - HYK_CONSTANTS(view).environment_rotation;
    hyk_vec3 local = hyk_direction_near_axis(h, phi);
    return hyk_make3(local.y, south ? -local.z : local.z, -local.x);
}

HYK_FN hyk_vec3 hyk_sample_map(hyk_view view, hyk_vec2 u) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    hyk_map_choice row = hyk_bisect_map(view, 0u, height + 1u, hyk_start_choosing(u.y, u));
    hyk_chooser along = hyk_start_choosing(u.x, hyk_make2(row.u, u.y));
    hyk_map_choice column = hyk_bisect_map(view, height + 1u + width * row.index, width, along);
    hyk_map_cell c = hyk_load_map_cell(view, column.index, row.index);
    hyk_real a = hyk_map_luminance(c.above_left), b = hyk_map_luminance(c.above_right);
    hyk_real d = hyk_map_luminance(c.below_left), e = hyk_map_luminance(c.below_right);
    hyk_real share = hyk_sample_linear(row.u, 0.5f * a + 0.5f * b, 0.5f * d + 0.5f * e);
    hyk_real s = hyk_sample_linear(column.u, hyk_lerp(a, d, share), hyk_lerp(b, e, share));
    return hyk_map_direction(view, column.index, row.index, s, share);
}

/* ---- the environment as a light. n: shading normal; both_sides: light from behind counts too */

HYK_FN hyk_vec3 hyk_sample_environment(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec2 u, hyk_uint features) {
    if (hyk_has_environment_map(view, features)) return hyk_sample_map(view, u);
    hyk_vec3 axis = n;
    if (both_sides) {
        if (u.x >= 0.5f) axis = hyk_neg(n);
        u.x = u.x >= 0.5f ? 2.0f * u.x - 1.0f : 2.0f * u.x;
    }
    return hyk_normalize(hyk_to_world(hyk_make_frame(axis), hyk_sample_cosine_hemisphere(u)));
}

HYK_FN hyk_real hyk_pdf_environment(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction, hyk_uint features) {
    if (hyk_has_environment_map(view, features)) return hyk_pdf_map(view, direction);
    hyk_real cos_theta = hyk_dot(n, direction);
    return both_sides ? 0.5f * hyk_pdf_cosine_hemisphere(hyk_abs(cos_theta)) : hyk_pdf_cosine_hemisphere(cos_theta);
}

/* Luminance of the irradiance it may give: exact for constant radiance and nothing in the way, else the mean
   over orientations. */
HYK_FN hyk_real hyk_estimate_environment(hyk_view view, hyk_bool both_sides, hyk_uint features) {
    hyk_real mean = hyk_max(hyk_luminance(HYK_CONSTANTS(view).environment), 0.0f);
    if (hyk_has_environment_map(view, features)) mean *= HYK_CONSTANTS(view).environment_integral * (0.25f * HYK_INV_PI);
    return (both_sides ? HYK_TWO_PI : HYK_PI) * mean;
}

#endif /* HYK_ENVIRONMENT_H */
