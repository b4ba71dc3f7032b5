#version 460
#extension GL_GOOGLE_include_directive : require
/* How many keys of every part have each digit. */
#include "sort.glsl"

shared uint hyk_below[HYK_SCAN_GROUP], hyk_above[HYK_SCAN_GROUP];

void main() {
    uvec2 tiles = hyk_tiles_of_part();
    uint me = gl_LocalInvocationIndex, wide[8];
    for (uint w = 0u; w < 8u; w++) wide[w] = 0u;
    for (uint tile = tiles.x; tile < tiles.y; tile++) {
        uint end = min((tile + 1u) * HYK_SCAN_TILE, hyk_plan.count);
        uvec2 fields = uvec2(0u);
        for (uint i = tile * HYK_SCAN_TILE + 4u * me; i < end; i += 4u * HYK_SCAN_GROUP) {
            uvec4 keys = hyk_in4[i >> 2];
            hyk_count_digit(fields, hyk_digit(keys.x));
            if (i + 1u < end) hyk_count_digit(fields, hyk_digit(keys.y));
            if (i + 2u < end) hyk_count_digit(fields, hyk_digit(keys.z));
            if (i + 3u < end) hyk_count_digit(fields, hyk_digit(keys.w));
        }
        for (uint w = 0u; w < 8u; w++) wide[w] += hyk_wide_fields(fields, w);
    }
    for (uint w = 0u; w < 8u; w++) hyk_tile[HYK_AT(w * HYK_SCAN_GROUP + me)] = wide[w];
    barrier();
    uvec2 sum = uvec2(0u); /* of 8 invocations; 16 of these are a digit's, below and above */
    for (uint i = 0u; i < 8u; i++) {
        uint word = hyk_tile[HYK_AT(8u * me + i)];
        sum += uvec2(word & 0xffffu, word >> 16u);
    }
    hyk_below[me] = sum.x;
    hyk_above[me] = sum.y;
    barrier();
    if (me >= HYK_SORT_DIGITS) return;
    uint of_digit = 0u;
    for (uint i = 0u; i < 16u; i++) of_digit += me < 8u ? hyk_below[16u * me + i] : hyk_above[16u * (me - 8u) + i];
    hyk_sums[me * HYK_SCAN_PARTS + gl_WorkGroupID.x] = of_digit;
}
