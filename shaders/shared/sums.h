/* >>shared-sums: exact sums in words of 32 bits

   The sums of render/exact_sum.h, to the bit, where there are no integers of 64 bits: a term is cut into digits of 32 bits
   on a grid of exponents, each lane adds its digits as integers of 64 bits in two words, and the two topmost lanes that any
   term reached are kept. Terms come as the bits of floats, so that no arithmetic of a device touches them. */
#ifndef HYK_SUMS_H
#define HYK_SUMS_H

#include "language.h"

/* Two integers, the less significant word of each first. */
HYK_STRUCT(hyk_lanes) {
    hyk_uint high0, high1, low0, low1;
} HYK_END(hyk_lanes)
HYK_SIZE_IS(hyk_lanes, 16)

/* Three sums under one top; an empty sum has top 0. */
HYK_STRUCT(hyk_sum3) {
    hyk_lanes lanes[3];
    hyk_uint top, unused;
} HYK_END(hyk_sum3)
HYK_SIZE_IS(hyk_sum3, 56)

/* Lane l has the weight 2^(32 l - bias). */
#define HYK_LANE_BIAS 1152u

/* A term's digits, of lanes first, first + 1 and first + 2. */
HYK_STRUCT(hyk_digits) {
    hyk_uint digit0, digit1, digit2;
    hyk_uint first, top; /* top: lane of the highest digit that is not 0; 0 for the number 0 */
    hyk_uint sign;       /* all bits set: the number is negative */
} HYK_END(hyk_digits)

/* (high 2^32 + low) 2^(place - bias). */
HYK_FN hyk_digits hyk_place_digits(hyk_uint low, hyk_uint high, hyk_uint place, hyk_uint sign) {
    hyk_digits d;
    hyk_uint shift = place & 31u, back = (32u - shift) & 31u;
    d.first = place >> 5;
    d.digit0 = low << shift;
    d.digit1 = (high << shift) | (shift != 0u ? low >> back : 0u);
    d.digit2 = shift != 0u ? high >> back : 0u;
    d.top = d.digit2 != 0u ? d.first + 2u : d.digit1 != 0u ? d.first + 1u : d.digit0 != 0u ? d.first : 0u;
    d.sign = sign;
    return d;
}

HYK_FN hyk_uint hyk_float_exponent(hyk_uint bits) { return (bits >> 23) & 0xffu; }
/* A denormal number is counted from the smallest exponent. */
HYK_FN hyk_uint hyk_float_mantissa(hyk_uint bits) { return (bits & 0x7fffffu) | (hyk_float_exponent(bits) != 0u ? 0x800000u : 0u); }
HYK_FN hyk_uint hyk_float_place(hyk_uint bits) { return hyk_float_exponent(bits) != 0u ? hyk_float_exponent(bits) : 1u; }

/* What an infinity, or what is not a number and then quiet, has in double: sums take it as that. */
HYK_FN hyk_digits hyk_digits_of_no_number(hyk_uint bits, hyk_uint sign) {
    hyk_uint mantissa = bits & 0x7fffffu, quiet = mantissa != 0u ? 0x400000u : 0u;
    return hyk_place_digits((mantissa | quiet) << 9, 1u, 67u << 5, sign);
}

HYK_FN hyk_digits hyk_digits_of(hyk_uint bits) {
    hyk_uint sign = (bits >> 31) != 0u ? 0xffffffffu : 0u;
    if (hyk_float_exponent(bits) == 0xffu) return hyk_digits_of_no_number(bits, sign);
    return hyk_place_digits(hyk_float_mantissa(bits), 0u, hyk_float_place(bits) + (HYK_LANE_BIAS - 150u), sign);
}

/* Those of the square, which has 48 bits: of three products of 12 bits each. */
HYK_FN hyk_digits hyk_digits_of_square(hyk_uint bits) {
    if (hyk_float_exponent(bits) == 0xffu) return hyk_digits_of_no_number(bits, 0u);
    hyk_uint m = hyk_float_mantissa(bits), upper = m >> 12, lower = m & 0xfffu, cross = 2u * upper * lower;
    hyk_uint first = lower * lower, second = first + (cross << 12), low = second + ((upper * upper) << 24);
    hyk_uint high = (cross >> 20) + ((upper * upper) >> 8) + (second < first ? 1u : 0u) + (low < second ? 1u : 0u);
    return hyk_place_digits(low, high, 2u * hyk_float_place(bits) + (HYK_LANE_BIAS - 300u), 0u);
}

/* Moves lanes to a higher top. */
HYK_FN hyk_lanes hyk_raise_lanes(hyk_lanes lanes, hyk_uint from, hyk_uint to) {
    if (to == from) return lanes;
    lanes.low0 = to == from + 1u ? lanes.high0 : 0u;
    lanes.low1 = to == from + 1u ? lanes.high1 : 0u;
    lanes.high0 = 0u;
    lanes.high1 = 0u;
    return lanes;
}

HYK_FN hyk_uint hyk_digit_of_lane(hyk_digits d, hyk_uint lane) {
    hyk_uint i = lane - d.first;
    return i == 0u ? d.digit0 : i == 1u ? d.digit1 : i == 2u ? d.digit2 : 0u;
}

/* Adds to lanes whose top is already at least the term's. */
HYK_FN hyk_lanes hyk_add_digits(hyk_lanes lanes, hyk_uint top, hyk_digits d) {
    hyk_uint high = hyk_digit_of_lane(d, top), low = hyk_digit_of_lane(d, top - 1u);
    hyk_uint high0 = (high ^ d.sign) - d.sign, low0 = (low ^ d.sign) - d.sign; /* in two's complement */
    lanes.high0 += high0;
    lanes.high1 += (high != 0u ? d.sign : 0u) + (lanes.high0 < high0 ? 1u : 0u);
    lanes.low0 += low0;
    lanes.low1 += (low != 0u ? d.sign : 0u) + (lanes.low0 < low0 ? 1u : 0u);
    return lanes;
}

HYK_FN hyk_uint hyk_higher(hyk_uint a, hyk_uint b) { return a > b ? a : b; }

HYK_FN hyk_sum3 hyk_add_digits3(hyk_sum3 sum, hyk_digits x, hyk_digits y, hyk_digits z) {
    hyk_uint top = hyk_higher(hyk_higher(sum.top, x.top), hyk_higher(y.top, z.top));
    sum.lanes[0] = hyk_add_digits(hyk_raise_lanes(sum.lanes[0], sum.top, top), top, x);
    sum.lanes[1] = hyk_add_digits(hyk_raise_lanes(sum.lanes[1], sum.top, top), top, y);
    sum.lanes[2] = hyk_add_digits(hyk_raise_lanes(sum.lanes[2], sum.top, top), top, z);
    sum.top = top;
    return sum;
}

/* Three floats, by their bits. */
HYK_FN hyk_sum3 hyk_add_floats3(hyk_sum3 sum, hyk_uint x, hyk_uint y, hyk_uint z) {
    return hyk_add_digits3(sum, hyk_digits_of(x), hyk_digits_of(y), hyk_digits_of(z));
}

#endif /* HYK_SUMS_H */
