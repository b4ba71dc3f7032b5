/* >>render-exact-sum: sums that do not depend on the order of their terms

   A number is cut into digits of 32 bits on a fixed grid of exponents ("lanes"); each lane adds its digits as integers, so
   adding is associative. Only the two topmost lanes that any term reached are kept: what falls below is under 2^-32 of
   the largest term (the idea of Demmel & Nguyen 2015, "Parallel reproducible summation", in integers). Hence films add up
   to the same bits in any order, under any number of threads, and whatever the compiler does to floating point. Good for
   2^31 terms. */
#ifndef HYI_EXACT_SUM_H
#define HYI_EXACT_SUM_H

#include "../base/platform.h"

typedef struct hyi_lanes { int64_t high, low; } hyi_lanes;

/* Lane l has the weight 2^(32 l - HYI_LANE_BIAS); an empty sum has top 0, which no term reaches. */
#define HYI_LANE_BIAS 1152

/* A term's three digits; digit[0] belongs to lane first. */
typedef struct hyi_digits {
    int64_t digit[3];
    int first, top; /* top: lane of the highest digit that is not 0; 0 for the number 0 */
} hyi_digits;

HYI_INLINE hyi_digits hyi_split_digits(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    uint64_t mantissa = bits & 0xfffffffffffffu;
    int exponent = (int)(bits >> 52 & 0x7ff);
    if (exponent) mantissa |= (uint64_t)1 << 52;
    else exponent = 1;
    int place = exponent - 1075 + HYI_LANE_BIAS, shift = place & 31;
    uint64_t low = mantissa << shift, high = shift ? mantissa >> (64 - shift) : 0;
    int64_t sign = bits >> 63 ? -1 : 1;
    hyi_digits d;
    d.first = place >> 5;
    d.digit[0] = sign * (int64_t)(low & 0xffffffffu);
    d.digit[1] = sign * (int64_t)(low >> 32);
    d.digit[2] = sign * (int64_t)high;
    d.top = d.digit[2] ? d.first + 2 : d.digit[1] ? d.first + 1 : d.digit[0] ? d.first : 0;
    return d;
}

/* Moves lanes to a higher top. */
HYI_INLINE void hyi_raise_lanes(hyi_lanes *lanes, int from, int to) {
    if (to == from) return;
    lanes->low = to == from + 1 ? lanes->high : 0;
    lanes->high = 0;
}

HYI_INLINE int64_t hyi_digit_of_lane(const hyi_digits *d, int lane) {
    int i = lane - d->first;
    return i >= 0 && i < 3 ? d->digit[i] : 0;
}

/* Adds to lanes whose top is already at least the term's. */
HYI_INLINE void hyi_add_digits(hyi_lanes *lanes, int top, const hyi_digits *d) {
    lanes->high += hyi_digit_of_lane(d, top);
    lanes->low += hyi_digit_of_lane(d, top - 1);
}

HYI_FN double hyi_lanes_value(hyi_lanes lanes, int top) {
    return top ? ldexp((double)lanes.high * 4294967296.0 + (double)lanes.low, 32 * (top - 1) - HYI_LANE_BIAS) : 0.0;
}

/* count sums under one top. */
HYI_INLINE void hyi_sums_add(hyi_lanes *sums, int16_t *top, const double *terms, int count) {
    hyi_digits d[3];
    int highest = *top;
    for (int i = 0; i < count; i++) {
        d[i] = hyi_split_digits(terms[i]);
        if (d[i].top > highest) highest = d[i].top;
    }
    for (int i = 0; i < count; i++) {
        hyi_raise_lanes(&sums[i], *top, highest);
        hyi_add_digits(&sums[i], highest, &d[i]);
    }
    *top = (int16_t)highest;
}

HYI_FN void hyi_sums_merge(hyi_lanes *sums, int16_t *top, const hyi_lanes *others, int16_t other_top, int count) {
    int highest = *top > other_top ? *top : other_top;
    for (int i = 0; i < count; i++) {
        hyi_lanes other = others[i];
        hyi_raise_lanes(&other, other_top, highest);
        hyi_raise_lanes(&sums[i], *top, highest);
        sums[i].high += other.high;
        sums[i].low += other.low;
    }
    *top = (int16_t)highest;
}

/* One sum with its own top. */
typedef struct hyi_sum {
    hyi_lanes lanes;
    int16_t top;
    int16_t unused[3];
} hyi_sum;

HYI_FN void hyi_sum_add(hyi_sum *sum, double term) { hyi_sums_add(&sum->lanes, &sum->top, &term, 1); }
HYI_FN double hyi_sum_value(const hyi_sum *sum) { return hyi_lanes_value(sum->lanes, sum->top); }

/* Three sums under one top. */
typedef struct hyi_sum3 {
    hyi_lanes lanes[3];
    int16_t top;
    int16_t unused[3];
} hyi_sum3;

HYI_FN void hyi_sum3_add(hyi_sum3 *sum, const float terms[3]) {
    const double wide[3] = { (double)terms[0], (double)terms[1], (double)terms[2] };
    hyi_sums_add(sum->lanes, &sum->top, wide, 3);
}
HYI_FN void hyi_sum3_merge(hyi_sum3 *sum, const hyi_sum3 *other) { hyi_sums_merge(sum->lanes, &sum->top, other->lanes, other->top, 3); }
HYI_FN void hyi_sum3_value(const hyi_sum3 *sum, double value[3]) {
    for (int i = 0; i < 3; i++) value[i] = hyi_lanes_value(sum->lanes[i], sum->top);
}

#endif /* HYI_EXACT_SUM_H */
