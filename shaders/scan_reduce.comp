#version 460
#extension GL_GOOGLE_include_directive : require
/* The sum of every part. */
#include "scan.glsl"

void main() {
    uvec2 tiles = hyk_tiles_of_part();
    uint end = min(tiles.y * HYK_SCAN_TILE, hyk_plan.count), total;
    uvec4 own = uvec4(0u);
    for (uint i = tiles.x * HYK_SCAN_TILE + 4u * gl_LocalInvocationIndex; i < end; i += 4u * HYK_SCAN_GROUP) {
        uvec4 words = HYK_LOAD4(hyk_in, i, end, 0u);
        own += hyk_mode == HYK_SCAN_INDICES ? uvec4(notEqual(words, uvec4(0u))) : words;
    }
    hyk_scan_group(own.x + own.y + own.z + own.w, total);
    if (gl_LocalInvocationIndex == 0u) hyk_sums[gl_WorkGroupID.x] = total;
}
