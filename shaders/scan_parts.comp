#version 460
#extension GL_GOOGLE_include_directive : require
/* The sums of parts become what stands before each; a workgroup a row of them: in a sort, a digit. */
#include "scan.glsl"

void main() {
    uint row = gl_WorkGroupID.x * HYK_SCAN_PARTS, first = row + HYK_SCAN_EACH * gl_LocalInvocationIndex, end = row + hyk_plan.parts;
    uvec4 a = HYK_LOAD4(hyk_sums, first, end, 0u), b = HYK_LOAD4(hyk_sums, first + 4u, end, 0u);
    uint total = hyk_scan_eights(a, b);
    hyk_sums4[first >> 2] = a;
    hyk_sums4[(first >> 2) + 1u] = b;
    if (gl_LocalInvocationIndex != 0u) return;
    if (hyk_mode == HYK_SCAN_SORT) hyk_sums[HYK_SORT_TOTALS + gl_WorkGroupID.x] = total;
    else hyk_total[hyk_call.total_at] = total;
}
