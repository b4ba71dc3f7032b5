/* >>shared-scan: how prefix sums, compaction and sorting of a device's arrays are divided among workgroups

   An array is a row of tiles, which are divided evenly among at most HYK_SCAN_PARTS parts, a workgroup each. Every part
   is summed up, a tile holds those sums and turns them into what stands before each part, and every part then goes on
   from there: reduce, then scan (Chaurasia et al. 2015; Merrill and Grimshaw 2009). No workgroup waits for another, so
   nothing is assumed about the order in which a device runs them. */
#ifndef HYK_SCAN_H
#define HYK_SCAN_H

#include "language.h"

#define HYK_SCAN_GROUP 128u /* every Vulkan device has workgroups of that size */
#define HYK_SCAN_EACH 8u    /* elements of a tile that an invocation takes, next to each other */
#define HYK_SCAN_TILE 1024u
#define HYK_SCAN_PARTS 1024u      /* their sums fit in a tile */
#define HYK_SCAN_MOST 0x40000000u /* elements of an array: then no place in it overflows */

#define HYK_SORT_BITS 4u /* of a pass, at most: a digit */
#define HYK_SORT_DIGITS 16u
#define HYK_SORT_TOTALS (HYK_SORT_DIGITS * HYK_SCAN_PARTS) /* where in the sums the totals of the digits begin */

/* What the kernels are made for. */
#define HYK_SCAN_SUMS 0u    /* out[i] = in[0] + ... + in[i - 1], modulo 2^32 */
#define HYK_SCAN_INDICES 1u /* out = every i whose in[i] is not 0, in order */
#define HYK_SCAN_SORT 2u    /* one pass of a sort by digits */

/* ---- a device's buffers for them, set 1 */

#define HYK_BINDING_SCAN_IN 0 /* SORT: keys, from and to */
#define HYK_BINDING_SCAN_OUT 1
#define HYK_BINDING_SCAN_VALUES_IN 2
#define HYK_BINDING_SCAN_VALUES_OUT 3
#define HYK_BINDING_SCAN_COUNT 4 /* a word of it is the count of elements */
#define HYK_BINDING_SCAN_TOTAL 5 /* a word of it gets the sum of all, or the count of indices */
#define HYK_BINDING_SCAN_PLAN 6
#define HYK_BINDING_SCAN_SUMS 7  /* of parts; SORT: of digit 0 in each part, of digit 1 ..., and then the totals */
#define HYK_SCAN_BINDINGS 8

/* What one dispatch is told, as push constants. */
HYK_STRUCT(hyk_scan_call) {
    hyk_uint capacity; /* elements there is room for: a larger count is cut to it */
    hyk_uint count_at; /* which word of COUNT */
    hyk_uint total_at; /* which word of TOTAL */
    hyk_uint digit;    /* SORT: its lowest bit | how many there are << 8 */
} HYK_END(hyk_scan_call)
HYK_SIZE_IS(hyk_scan_call, 16)

/* What the device finds for a count. It begins with the arguments of an indirect dispatch: a workgroup a part. */
HYK_STRUCT(hyk_scan_plan) {
    hyk_uint parts, groups_y, groups_z;
    hyk_uint count;
    hyk_uint part_tiles; /* of every part but the last, which may have fewer */
    hyk_uint unused0, unused1, unused2;
} HYK_END(hyk_scan_plan)
HYK_SIZE_IS(hyk_scan_plan, 32)

HYK_FN hyk_uint hyk_scan_quotient(hyk_uint a, hyk_uint b) { return (a + b - 1u) / b; }

/* Every part has a tile at least; none is empty. */
HYK_FN hyk_scan_plan hyk_plan_scan(hyk_uint count, hyk_uint capacity) {
    hyk_scan_plan plan;
    plan.count = count < capacity ? count : capacity;
    hyk_uint tiles = hyk_scan_quotient(plan.count, HYK_SCAN_TILE);
    plan.part_tiles = hyk_scan_quotient(tiles, HYK_SCAN_PARTS);
    plan.parts = tiles == 0u ? 0u : hyk_scan_quotient(tiles, plan.part_tiles);
    plan.groups_y = 1u;
    plan.groups_z = 1u;
    plan.unused0 = 0u;
    plan.unused1 = 0u;
    plan.unused2 = 0u;
    return plan;
}

#endif /* HYK_SCAN_H */
