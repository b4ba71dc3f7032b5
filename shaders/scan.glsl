/* What the kernels of scans and sorts begin with: their buffers, and sums within a workgroup.

   No operation of subgroups is used: subgroups may have any size, be partly filled, and hold invocations in any order. */
#define HYK_GLSL 1
#include "scan.h"

layout(constant_id = 3) const uint hyk_mode = HYK_SCAN_SUMS;
layout(local_size_x = HYK_SCAN_GROUP) in;
layout(push_constant) uniform hyk_push { hyk_scan_call hyk_call; };

/* Every buffer as words, and by fours. IN and OUT may be one: an invocation reads its elements of a tile before a barrier
   and writes the same ones after it. */
#define HYK_WORDS(slot, access, name)                                                         \
    layout(std430, set = 1, binding = slot) access buffer name##_buffer { uint name[]; };     \
    layout(std430, set = 1, binding = slot) access buffer name##_buffer4 { uvec4 name##4[]; };
HYK_WORDS(HYK_BINDING_SCAN_IN, readonly, hyk_in)
HYK_WORDS(HYK_BINDING_SCAN_OUT, writeonly, hyk_out)
HYK_WORDS(HYK_BINDING_SCAN_VALUES_IN, readonly, hyk_values_in)
HYK_WORDS(HYK_BINDING_SCAN_VALUES_OUT, writeonly, hyk_values_out)
HYK_WORDS(HYK_BINDING_SCAN_COUNT, readonly, hyk_count)
HYK_WORDS(HYK_BINDING_SCAN_TOTAL, writeonly, hyk_total)
layout(std430, set = 1, binding = HYK_BINDING_SCAN_PLAN) buffer hyk_plan_buffer { hyk_scan_plan hyk_plan; };
HYK_WORDS(HYK_BINDING_SCAN_SUMS, , hyk_sums)

const uint hyk_segment = 16u; /* invocations whose sums are added up one after the other */
shared uint hyk_own[HYK_SCAN_GROUP];
shared uint hyk_segments[HYK_SCAN_GROUP / hyk_segment];

/* The sum of own of all invocations before this one, and of all. Between two calls there must be a barrier. */
uint hyk_scan_group(uint own, out uint total) {
    uint me = gl_LocalInvocationIndex, first = me / hyk_segment * hyk_segment, before = 0u;
    hyk_own[me] = own;
    barrier();
    if (me < HYK_SCAN_GROUP / hyk_segment) {
        uint sum = 0u;
        for (uint i = 0u; i < hyk_segment; i++) sum += hyk_own[me * hyk_segment + i];
        hyk_segments[me] = sum;
    }
    barrier();
    total = 0u;
    for (uint i = 0u; i < HYK_SCAN_GROUP / hyk_segment; i++) {
        if (i * hyk_segment == first) before = total;
        total += hyk_segments[i];
    }
    for (uint i = first; i < me; i++) before += hyk_own[i];
    return before;
}

/* Of the eight words of every invocation, each becomes the sum of those before it; returns the sum of all. Between two
   calls there must be a barrier. */
uint hyk_scan_eights(inout uvec4 a, inout uvec4 b) {
    a.yzw += uvec3(a.x, 0u, a.z);
    a.zw += a.yy;
    b.yzw += uvec3(b.x, 0u, b.z);
    b.zw += b.yy;
    uint total, before = hyk_scan_group(a.w + b.w, total);
    b = uvec4(0u, b.xyz) + (before + a.w);
    a = uvec4(0u, a.xyz) + before;
    return total;
}

/* Which of the four elements from first on there are. */
bvec4 hyk_there(uint first, uint count) { return lessThan(first + uvec4(0u, 1u, 2u, 3u), uvec4(count)); }

/* Four elements from first on, a multiple of four, and otherwise where there are none. Arrays have room for whole fours. */
#define HYK_LOAD4(name, first, count, otherwise) \
    ((first) < (count) ? mix(uvec4(otherwise), name##4[(first) >> 2], hyk_there(first, count)) : uvec4(otherwise))

/* The tiles of this workgroup's part: from the first, up to the second without it. */
uvec2 hyk_tiles_of_part() {
    uint first = gl_WorkGroupID.x * hyk_plan.part_tiles;
    return uvec2(first, min(first + hyk_plan.part_tiles, hyk_scan_quotient(hyk_plan.count, HYK_SCAN_TILE)));
}
