#version 460
#extension GL_GOOGLE_include_directive : require
/* Every tile of a part is sorted by the digit in shared memory, order among equals kept, and its runs of equal digits go
   to where they belong. */
#include "sort.glsl"

shared uint hyk_keys[HYK_TILE_WORDS], hyk_values[HYK_TILE_WORDS];
shared uint hyk_bases[HYK_SORT_DIGITS];  /* where the next run of a digit goes */
shared uint hyk_shifts[HYK_SORT_DIGITS]; /* from a place in the sorted tile to the one in OUT */

void hyk_find_bases() {
    uint me = gl_LocalInvocationIndex, base = 0u;
    if (me >= HYK_SORT_DIGITS) return;
    for (uint digit = 0u; digit < me; digit++) base += hyk_sums[HYK_SORT_TOTALS + digit];
    hyk_bases[me] = base + hyk_sums[me * HYK_SCAN_PARTS + gl_WorkGroupID.x];
}

void hyk_put_pairs(uvec4 keys, uvec4 values, uint ranks, uint low) {
    for (uint i = 0u; i < 4u; i++) {
        uint at = HYK_AT(hyk_place_of(hyk_digit(keys[i]), gl_LocalInvocationIndex, low) + (ranks >> 4u * i & 15u));
        hyk_keys[at] = keys[i];
        hyk_values[at] = values[i];
    }
}

/* After the last key of the array there are keys of the largest digit, which the sorted tile has last. */
void hyk_sort_tile(uint begin) {
    uint me = gl_LocalInvocationIndex, first = begin + HYK_SCAN_EACH * me, count = hyk_plan.count;
    uvec4 keys_a = HYK_LOAD4(hyk_in, first, count, 0xffffffffu), values_a = HYK_LOAD4(hyk_values_in, first, count, 0u);
    uvec4 keys_b = HYK_LOAD4(hyk_in, first + 4u, count, 0xffffffffu), values_b = HYK_LOAD4(hyk_values_in, first + 4u, count, 0u);
    uvec2 fields = uvec2(0u);
    uint ranks_a = hyk_count_digits(fields, keys_a), ranks_b = hyk_count_digits(fields, keys_b);
    uint low = hyk_scan_fields(fields) & 0xffffu;
    hyk_put_pairs(keys_a, values_a, ranks_a, low);
    hyk_put_pairs(keys_b, values_b, ranks_b, low);
    if (me < HYK_SORT_DIGITS) {
        uint start = hyk_place_of(me, 0u, low), end = me + 1u < HYK_SORT_DIGITS ? hyk_place_of(me + 1u, 0u, low) : HYK_SCAN_TILE;
        hyk_shifts[me] = hyk_bases[me] - start;
        hyk_bases[me] += end - start;
    }
    barrier();
}

void hyk_store_tile(uint size) {
    for (uint i = gl_LocalInvocationIndex; i < size; i += HYK_SCAN_GROUP) {
        uint key = hyk_keys[HYK_AT(i)], to = hyk_shifts[hyk_digit(key)] + i;
        hyk_out[to] = key;
        hyk_values_out[to] = hyk_values[HYK_AT(i)];
    }
}

void main() {
    uvec2 tiles = hyk_tiles_of_part();
    hyk_find_bases();
    for (uint tile = tiles.x; tile < tiles.y; tile++) {
        hyk_sort_tile(tile * HYK_SCAN_TILE);
        hyk_store_tile(min(hyk_plan.count - tile * HYK_SCAN_TILE, HYK_SCAN_TILE));
    }
}
