#version 460
#extension GL_GOOGLE_include_directive : require
/* Values of pixels out of the film's sums, as render/read.h makes them. */
#include "film.glsl"

HYK_FILM(HYK_BINDING_FILM_TILES, readonly, hyk_tiles, hyk_film_tile)

double hyk_power_of_two(int exponent) { return packDouble2x32(uvec2(0u, uint(clamp(exponent, -1022, 1023) + 1023) << 20)); }

double hyk_value_of(hyk_lanes lanes, uint top) {
    if (top == 0u) return 0.0lf;
    int exponent = 32 * (int(top) - 1) - int(HYK_LANE_BIAS), half_of_it = exponent >> 1;
    precise double high = double(int(lanes.high1)) * 4294967296.0lf + double(lanes.high0);
    precise double low = double(int(lanes.low1)) * 4294967296.0lf + double(lanes.low0);
    precise double value = high * 4294967296.0lf + low;
    precise double scaled = value * hyk_power_of_two(half_of_it) * hyk_power_of_two(exponent - half_of_it);
    return scaled;
}

dvec3 hyk_values_of(hyk_sum3 sum) {
    return dvec3(hyk_value_of(sum.lanes[0], sum.top), hyk_value_of(sum.lanes[1], sum.top), hyk_value_of(sum.lanes[2], sum.top));
}

uint hyk_reported() {
    uint pixels = hyk_the_picture.tile_pixels;
    return hyk_tiles[hyk_index / pixels].reported[hyk_index % pixels % HYK_FILM_GROUPS];
}

/* Radiance is the mean of its halves' means, other light the mean of all samples, as are surfaces. */
dvec3 hyk_mean_of(uint plane, uint count) {
    double n = count != 0u ? double(count) : 1.0lf;
    precise dvec3 sum = dvec3(0.0lf), mean;
    for (uint part = 0u; part < hyk_parts_of(plane); part++) {
        dvec3 values = hyk_values_of(hyk_load_sum(plane, part));
        if (plane == HYK_RADIANCE) values = values / (0.5lf * n);
        sum += values;
    }
    mean = plane == HYK_RADIANCE ? 0.5lf * sum : sum / n;
    return count != 0u || plane == HYK_RADIANCE ? mean : dvec3(0.0lf);
}

/* ---- what is asked for */

uint hyk_plane_asked() {
    switch (hyk_call.asked) {
    case HYK_RESOLVE_DIRECT: return HYK_PLANE_DIRECT;
    case HYK_RESOLVE_INDIRECT: return HYK_PLANE_INDIRECT;
    case HYK_RESOLVE_CAUSTIC: return HYK_PLANE_CAUSTIC;
    case HYK_RESOLVE_IRRADIANCE: return hyk_call.points != 0u ? HYK_RADIANCE : HYK_PLANE_IRRADIANCE;
    case HYK_RESOLVE_ALBEDO: return HYK_PLANE_ALBEDO;
    case HYK_RESOLVE_NORMAL: return HYK_PLANE_NORMAL;
    case HYK_RESOLVE_POSITION: return HYK_PLANE_POSITION;
    case HYK_RESOLVE_DEPTH: return HYK_PLANE_DEPTH;
    default: return HYK_RADIANCE;
    }
}

uint hyk_count_asked(uint taken) {
    switch (hyk_call.asked) {
    case HYK_RESOLVE_ALBEDO: case HYK_RESOLVE_NORMAL: return taken;
    case HYK_RESOLVE_POSITION: case HYK_RESOLVE_DEPTH: return hyk_pixels[hyk_index].hits;
    default: return hyk_reported();
    }
}

/* Light at a point's surface is scaled to what a lightmap means. */
void hyk_put_color(uint i, dvec3 mean) {
    if (hyk_call.asked == HYK_RESOLVE_IRRADIANCE && hyk_call.points != 0u) mean = mean * 3.14159265358979323846lf;
    vec3 color = vec3(mean);
    if (hyk_call.asked <= HYK_RESOLVE_CAUSTIC) color = color * vec3(hyk_call.factor0, hyk_call.factor1, hyk_call.factor2);
    for (uint c = 0u; c < 3u; c++) hyk_out[3u * i + c] = floatBitsToUint(color[c]);
}

void hyk_put_luminance(uint i, dvec3 mean) {
    precise double luminance = 0.2126lf * mean.x + 0.7152lf * mean.y + 0.0722lf * mean.z;
    hyk_put_double(i, luminance);
}

uint hyk_coverage(uint taken) {
    double hits = double(hyk_pixels[hyk_index].hits);
    return taken != 0u ? floatBitsToUint(float(hits / double(taken))) : 0u;
}

uint hyk_word_asked(uint taken) {
    switch (hyk_call.asked) {
    case HYK_RESOLVE_COVERAGE: return hyk_coverage(taken);
    case HYK_RESOLVE_PRIMITIVE_ID: return hyk_film_ids[hyk_index].primitive;
    case HYK_RESOLVE_INSTANCE_ID: return hyk_film_ids[hyk_index].instance;
    case HYK_RESOLVE_MESH_ID: return hyk_film_ids[hyk_index].mesh;
    case HYK_RESOLVE_MATERIAL_ID: return hyk_film_ids[hyk_index].material;
    default: return hyk_reported();
    }
}

void main() {
    uint i = gl_GlobalInvocationID.y * gl_NumWorkGroups.x * HYK_GROUP + gl_GlobalInvocationID.x, asked = hyk_call.asked;
    if (i >= hyk_call.count) return;
    hyk_picture picture = hyk_the_picture;
    uint width = picture.right - picture.left;
    hyk_index = asked == HYK_RESOLVE_LUMINANCE ? i : hyk_film_index_of(picture, picture.left + i % width, picture.top + i / width);
    uint taken = hyk_tiles[hyk_index / picture.tile_pixels].taken;
    if (asked >= HYK_RESOLVE_COVERAGE && asked <= HYK_RESOLVE_SAMPLES) {
        hyk_out[i] = hyk_word_asked(taken);
        return;
    }
    uint count = hyk_count_asked(taken);
    dvec3 mean = hyk_mean_of(hyk_plane_asked(), count);
    if (asked == HYK_RESOLVE_DEPTH) hyk_out[i] = count != 0u ? floatBitsToUint(float(mean.x)) : 0x7f800000u; /* infinity: nothing was hit */
    else if (asked == HYK_RESOLVE_LUMINANCE) hyk_put_luminance(i, mean);
    else hyk_put_color(i, mean);
}
