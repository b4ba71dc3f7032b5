/* Digits of keys: counting them, and what places in a sorted tile the counts give.

   An invocation counts the digits of its 8 keys in 16 fields of 4 bits, and a workgroup adds fields of 16 bits: word w
   of the 8 that hold them has digit w below and digit w + 8 above (Satish, Harris, Garland 2009, who sort tiles bit by
   bit, and Merrill and Grimshaw 2010, who pack counters so). */
#include "scan.glsl"

/* Word i of a tile in shared memory: with a gap every 32 words, invocations that walk 8 words each meet 32 banks. */
#define HYK_TILE_WORDS (HYK_SCAN_TILE + HYK_SCAN_TILE / 32u)
#define HYK_AT(i) ((i) + ((i) >> 5))
shared uint hyk_tile[HYK_TILE_WORDS]; /* fields */

uint hyk_digit(uint key) { return key >> (hyk_call.digit & 31u) & (1u << (hyk_call.digit >> 8u)) - 1u; }

/* One more of a digit. */
void hyk_count_digit(inout uvec2 fields, uint digit) {
    uint one = 1u << 4u * (digit & 7u);
    if (digit < 8u) fields.x += one;
    else fields.y += one;
}

/* How many of a digit. */
uint hyk_count_of(uvec2 fields, uint digit) { return (digit < 8u ? fields.x : fields.y) >> 4u * (digit & 7u) & 15u; }

/* Word w of fields of 16 bits. */
uint hyk_wide_fields(uvec2 fields, uint w) { return (fields.x >> 4u * w & 15u) | (fields.y >> 4u * w & 15u) << 16u; }

/* Counts the digits of four keys; returns how many of its digit each has before it, in 4 bits a key. */
uint hyk_count_digits(inout uvec2 fields, uvec4 keys) {
    uint ranks = 0u;
    for (uint i = 0u; i < 4u; i++) {
        uint digit = hyk_digit(keys[i]);
        ranks |= hyk_count_of(fields, digit) << 4u * i;
        hyk_count_digit(fields, digit);
    }
    return ranks;
}

/* The fields of all invocations, word 0 of each, then word 1 and so on, become the sums of those before, in hyk_tile;
   returns that of all. Two barriers stand between what others may still read and what is written. */
uint hyk_scan_fields(uvec2 fields) {
    uint me = gl_LocalInvocationIndex, first = HYK_AT(HYK_SCAN_EACH * me);
    for (uint w = 0u; w < 8u; w++) hyk_tile[HYK_AT(w * HYK_SCAN_GROUP + me)] = hyk_wide_fields(fields, w);
    barrier();
    uvec4 a = uvec4(hyk_tile[first], hyk_tile[first + 1u], hyk_tile[first + 2u], hyk_tile[first + 3u]);
    uvec4 b = uvec4(hyk_tile[first + 4u], hyk_tile[first + 5u], hyk_tile[first + 6u], hyk_tile[first + 7u]);
    uint total = hyk_scan_eights(a, b);
    for (uint i = 0u; i < 4u; i++) {
        hyk_tile[first + i] = a[i];
        hyk_tile[first + 4u + i] = b[i];
    }
    barrier();
    return total;
}

/* The place in the sorted tile of the first of an invocation's keys with a digit. low: how many digits are below 8. */
uint hyk_place_of(uint digit, uint invocation, uint low) {
    uint word = hyk_tile[HYK_AT((digit & 7u) * HYK_SCAN_GROUP + invocation)];
    return digit < 8u ? word & 0xffffu : low + (word >> 16u);
}
