#version 460
#extension GL_GOOGLE_include_directive : require
/* A batch's samples enter the film, as hyi_film_add does it: an invocation a pixel, over all units of its tile. */
#include "film.glsl"

HYK_FILM(HYK_BINDING_FILM_UNITS, readonly, hyk_units, hyk_unit)
HYK_FILM(HYK_BINDING_FILM_CHAINS, readonly, hyk_chains, hyk_film_unit)
HYK_FILM(HYK_BINDING_FILM_RADIANCE, readonly, hyk_radiance, hyk_lane_radiance)
HYK_FILM(HYK_BINDING_FILM_EXTRAS, readonly, hyk_extras, hyk_lane_extra)
HYK_FILM(HYK_BINDING_FILM_PLACED, readonly, hyk_placed, hyk_placed_ids)

/* What one invocation works on. */
uint hyk_pixel_of_tile, hyk_first_unit;

uint hyk_first_lane(uint unit) { return unit * hyk_call.lanes_of_unit + hyk_pixel_of_tile * hyk_units[unit].samples; }
bool hyk_is_open(uint unit) { return (hyk_chains[unit].open >> (hyk_pixel_of_tile % HYK_FILM_GROUPS) & 1u) != 0u; }

/* ---- samples */

/* A sample's light; black where anything of it is not finite. */
struct hyk_light_parts {
    vec3 direct, indirect, caustic, irradiance;
    bool finite;
};

bool hyk_finite3(vec3 v) { return all(notEqual(floatBitsToUint(v) & 0x7f800000u, uvec3(0x7f800000u))); }

hyk_light_parts hyk_light_of(uint lane) {
    hyk_light_parts l = hyk_light_parts(hyk_radiance[lane].radiance, vec3(0.0), vec3(0.0), vec3(0.0), true);
    if (hyk_wants != 0u) {
        l.indirect = hyk_extras[lane].indirect;
        l.caustic = hyk_extras[lane].caustic;
        l.irradiance = hyk_extras[lane].irradiance;
    }
    l.finite = hyk_finite3(l.direct) && hyk_finite3(l.indirect) && hyk_finite3(l.caustic) && hyk_finite3(l.irradiance);
    if (!l.finite) l.direct = l.indirect = l.caustic = l.irradiance = vec3(0.0);
    return l;
}

vec3 hyk_radiance_of(hyk_light_parts l) {
    precise vec3 rest = l.indirect + l.caustic, rgb = l.direct + rest;
    return rgb;
}

float hyk_luminance_of(vec3 rgb) {
    precise float luminance = 0.2126 * rgb.x + 0.7152 * rgb.y + 0.0722 * rgb.z;
    return luminance;
}

bool hyk_flagged(uint lane, uint flag) { return (hyk_radiance[lane].flags & flag) != 0u; }

vec3 hyk_surface_of(uint plane, uint lane) {
    bool hit = hyk_flagged(lane, HYK_LANE_HIT);
    if (plane == HYK_PLANE_DEPTH) return vec3(hit && hyk_wants != 0u ? hyk_extras[lane].first.depth : 0.0, hyk_flagged(lane, HYK_LANE_INSIDE) ? 1.0 : 0.0, 0.0);
    if (!hit) return vec3(0.0);
    return plane == HYK_PLANE_ALBEDO ? hyk_extras[lane].first.albedo : plane == HYK_PLANE_NORMAL ? hyk_extras[lane].first.normal : hyk_extras[lane].first.position;
}

vec3 hyk_vector_of(uint plane, uint lane) {
    if (plane >= HYK_PLANE_ALBEDO && plane != HYK_RADIANCE) return hyk_surface_of(plane, lane);
    hyk_light_parts l = hyk_light_of(lane);
    switch (plane) {
    case HYK_PLANE_DIRECT: return l.direct;
    case HYK_PLANE_INDIRECT: return l.indirect;
    case HYK_PLANE_CAUSTIC: return l.caustic;
    case HYK_PLANE_IRRADIANCE: return l.irradiance;
    default: return hyk_radiance_of(l);
    }
}

/* ---- sums */

void hyk_store_radiance(uint part, hyk_sum3 sum) {
    uint tops = hyk_pixels[hyk_index].rgb_tops;
    for (uint c = 0u; c < 3u; c++) hyk_pixels[hyk_index].rgb[3u * part + c] = sum.lanes[c];
    hyk_pixels[hyk_index].rgb_tops = part == 0u ? tops & 0xffff0000u | sum.top : tops & 0xffffu | sum.top << 16;
}

#define HYK_STORE_CASE(name, sums) case HYK_PLANE_##name: if (hyk_has(HYK_PLANE_##name)) hyk_##sums[at] = sum; break;
void hyk_store_sum(uint plane, uint part, hyk_sum3 sum) {
    uint at = hyk_is_pair(plane) ? 2u * hyk_index + part : hyk_index;
    switch (plane) {
    HYK_EACH_PLANE(HYK_STORE_CASE)
    default: hyk_store_radiance(part, sum);
    }
}

/* Surfaces count in every sample, light while the pixel's group is open. */
void hyk_add_to_sum(uint plane, uint part, uint step) {
    hyk_sum3 sum = hyk_load_sum(plane, part);
    for (uint unit = hyk_first_unit; unit != HYK_NONE; unit = hyk_chains[unit].next) {
        uint lane = hyk_first_lane(unit), end = lane + hyk_units[unit].samples;
        if (step == 2u && !hyk_is_open(unit)) continue;
        for (lane += part; lane < end; lane += step) {
            uvec3 bits = floatBitsToUint(hyk_vector_of(plane, lane));
            sum = hyk_add_floats3(sum, bits.x, bits.y, bits.z);
        }
    }
    hyk_store_sum(plane, part, sum);
}

void hyk_add_to_sums() {
    for (uint plane = 0u; plane <= HYK_RADIANCE; plane++) {
        if (plane != HYK_RADIANCE && !hyk_has(plane)) continue;
        uint parts = hyk_parts_of(plane);
        for (uint part = 0u; part < parts; part++) hyk_add_to_sum(plane, part, parts);
    }
}

/* ---- what else a pixel keeps */

/* The sum of squared differences from the mean, of which hyi_chunk_variance makes the variance. */
void hyk_tell_scatter(uint unit, double sum, double squares) {
    precise double scatter = squares - sum * sum / double(hyk_units[unit].samples);
    hyk_put_double(unit * hyk_the_picture.tile_pixels + hyk_pixel_of_tile, scatter);
}

void hyk_add_counts() {
    hyk_lanes square = hyk_pixels[hyk_index].square;
    uint packed_top = hyk_pixels[hyk_index].square_top, top = packed_top & 0xffffu, dropped = packed_top >> 16;
    uint largest = hyk_pixels[hyk_index].largest, hits = hyk_pixels[hyk_index].hits;
    for (uint unit = hyk_first_unit; unit != HYK_NONE; unit = hyk_chains[unit].next) {
        uint lane = hyk_first_lane(unit), end = lane + hyk_units[unit].samples;
        bool open = hyk_is_open(unit);
        precise double sum = 0.0lf, squares = 0.0lf;
        for (; lane < end; lane++) {
            hyk_light_parts l = hyk_light_of(lane);
            float luminance = hyk_luminance_of(hyk_radiance_of(l));
            hyk_digits digits = hyk_digits_of_square(floatBitsToUint(luminance));
            uint higher = open ? hyk_higher(top, digits.top) : top;
            if (!l.finite) dropped = min(dropped + 1u, 0xffffu);
            if (hyk_flagged(lane, HYK_LANE_HIT)) hits++;
            if (open) square = hyk_add_digits(hyk_raise_lanes(square, top, higher), higher, digits);
            top = higher;
            if (open && luminance > uintBitsToFloat(largest)) largest = floatBitsToUint(luminance);
            if (hyk_judged == 0u) continue;
            sum += double(luminance);
            squares += double(luminance) * double(luminance);
        }
        if (hyk_judged != 0u) hyk_tell_scatter(unit, sum, squares);
    }
    hyk_pixels[hyk_index].square = square;
    hyk_pixels[hyk_index].square_top = top | dropped << 16;
    hyk_pixels[hyk_index].largest = largest;
    hyk_pixels[hyk_index].hits = hits;
}

/* ---- ids */

void hyk_keep_ids() {
    if ((hyk_parts & HYK_FILM_HAS_IDS) == 0u) return;
    for (uint unit = hyk_first_unit; unit != HYK_NONE; unit = hyk_chains[unit].next) {
        uint lane = hyk_first_lane(unit), instance = hyk_extras[lane].instance, material = hyk_extras[lane].first.material;
        if ((hyk_chains[unit].flags & HYK_FILM_IDS) == 0u || instance >= HYK_HIT_SHAPE) continue;
        hyk_placed_ids placed = hyk_placed[instance];
        hyk_film_ids[hyk_index] = hyk_ids(hyk_extras[lane].primitive, placed.instance, placed.mesh, material == HYK_NONE ? 0u : material);
    }
}

void main() {
    uint pixels = hyk_the_picture.tile_pixels, unit = gl_GlobalInvocationID.x / pixels;
    if (unit >= hyk_call.count || (hyk_chains[unit].flags & HYK_FILM_FIRST) == 0u) return;
    hyk_pixel_of_tile = gl_GlobalInvocationID.x % pixels;
    hyk_first_unit = unit;
    if ((hyk_radiance[hyk_first_lane(unit)].flags & HYK_LANE_USED) == 0u) return;
    hyk_index = hyk_chains[unit].tile * pixels + hyk_pixel_of_tile;
    hyk_keep_ids();
    hyk_add_to_sums();
    hyk_add_counts();
}
