#version 460
#extension GL_GOOGLE_include_directive : require
/* Every part again, now that it is known what stands before it: prefix sums, or the places of indices. */
#include "scan.glsl"

void hyk_store_sums(uint first, uint count, uvec4 sums) {
    bvec4 there = hyk_there(first, count);
    if (there.w) hyk_out4[first >> 2] = sums;
    else for (uint i = 0u; first + i < count; i++) hyk_out[first + i] = i == 0u ? sums.x : i == 1u ? sums.y : sums.z;
}

void hyk_store_indices(uint first, uvec4 flags, uvec4 places) {
    if (flags.x != 0u) hyk_out[places.x] = first;
    if (flags.y != 0u) hyk_out[places.y] = first + 1u;
    if (flags.z != 0u) hyk_out[places.z] = first + 2u;
    if (flags.w != 0u) hyk_out[places.w] = first + 3u;
}

void main() {
    uvec2 tiles = hyk_tiles_of_part();
    uint before = hyk_sums[gl_WorkGroupID.x], count = hyk_plan.count;
    for (uint tile = tiles.x; tile < tiles.y; tile++) {
        uint first = tile * HYK_SCAN_TILE + HYK_SCAN_EACH * gl_LocalInvocationIndex;
        uvec4 a = HYK_LOAD4(hyk_in, first, count, 0u), b = HYK_LOAD4(hyk_in, first + 4u, count, 0u);
        if (hyk_mode == HYK_SCAN_INDICES) {
            uvec4 flags_a = uvec4(notEqual(a, uvec4(0u))), flags_b = uvec4(notEqual(b, uvec4(0u)));
            a = flags_a;
            b = flags_b;
            uint total = hyk_scan_eights(a, b);
            hyk_store_indices(first, flags_a, a + before);
            hyk_store_indices(first + 4u, flags_b, b + before);
            before += total;
        } else {
            uint total = hyk_scan_eights(a, b);
            hyk_store_sums(first, count, a + before);
            hyk_store_sums(first + 4u, count, b + before);
            before += total;
        }
        barrier();
    }
}
