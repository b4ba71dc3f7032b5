/* >>shared-sampler: Owen-scrambled Sobol points, spread over the screen like blue noise

   A path takes its random numbers in pairs; pair d of sample s is point s of its own copy of the first two
   Sobol dimensions, a (0,2)-sequence, whose order and digits are scrambled by hashes of d (Burley 2020,
   "Practical hash-based Owen scrambling"; the mixing constants are Vegdahl's, 2021). Padding pairs this way keeps
   every pair a net at every power of two.
   The 16 pixels of a 4x4 block get the same points under digital shifts. The shifts are themselves Sobol points, numbered
   along the Morton curve in scrambled order (after Ahmed & Wonka 2020, "Screen-space blue-noise diffusion of Monte Carlo
   sampling error via hierarchical ordering of pixels"), so they are stratified over each 2x2 and the 4x4 pixels, and
   errors of neighbours cancel; digits below those are random, so that pixels do not repeat each other. Different blocks
   are scrambled apart: how well one set of points does is then no common fate of the whole picture. */
#ifndef HYK_SAMPLER_H
#define HYK_SAMPLER_H

#include "vector.h"

HYK_STRUCT(hyk_sampler) {
    hyk_uint pixel; /* Morton code, bits reversed */
    hyk_uint index; /* sample number */
    hyk_uint seed;
} HYK_END(hyk_sampler)

/* A bijective mix of 32 bits (Wellons 2018, the low-bias search "lowbias32"). */
HYK_FN hyk_uint hyk_hash(hyk_uint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

HYK_FN hyk_uint hyk_hash2(hyk_uint a, hyk_uint b) { return hyk_hash(a ^ (hyk_hash(b) + 0x9e3779b9u)); }

/* Owen scrambling of a number whose digits are stored lowest bit first: each bit is flipped by a hash of those below. */
HYK_FN hyk_uint hyk_owen(hyk_uint x, hyk_uint seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    return x ^ (x * 0x53a22864u);
}

/* Digits of the second Sobol dimension, lowest bit first: its matrix is Pascal's triangle modulo 2, and a binomial
   (k over j) is odd where j's bits are among k's (Lucas), so digit j sums the bits of all k that contain j. */
HYK_FN hyk_uint hyk_sobol_second(hyk_uint index) {
    index ^= (index >> 1) & 0x55555555u;
    index ^= (index >> 2) & 0x33333333u;
    index ^= (index >> 4) & 0x0f0f0f0fu;
    index ^= (index >> 8) & 0x00ff00ffu;
    return index ^ (index >> 16);
}

/* Spreads the low 16 bits to the even places. */
HYK_FN hyk_uint hyk_morton_spread(hyk_uint x) {
    x &= 0xffffu;
    x = (x | (x << 8)) & 0x00ff00ffu;
    x = (x | (x << 4)) & 0x0f0f0f0fu;
    x = (x | (x << 2)) & 0x33333333u;
    return (x | (x << 1)) & 0x55555555u;
}
/* And gathers them again. */
HYK_FN hyk_uint hyk_morton_even_bits(hyk_uint x) {
    x &= 0x55555555u;
    x = (x | (x >> 1)) & 0x33333333u;
    x = (x | (x >> 2)) & 0x0f0f0f0fu;
    x = (x | (x >> 4)) & 0x00ff00ffu;
    return (x | (x >> 8)) & 0x0000ffffu;
}
HYK_FN hyk_uint hyk_morton(hyk_uint x, hyk_uint y) { return hyk_morton_spread(x) | (hyk_morton_spread(y) << 1); }

HYK_FN hyk_sampler hyk_make_sampler(hyk_uint x, hyk_uint y, hyk_uint index, hyk_uint seed) {
    hyk_sampler s;
    s.pixel = hyk_reverse_bits(hyk_morton(x, y));
    s.index = index;
    s.seed = seed;
    return s;
}

HYK_FN hyk_real hyk_unit_real(hyk_uint bits) { return HYK_TO_REAL(bits >> 8) * HYK_C(1.0 / 16777216.0); }

/* Pair d of the sampler's sample, both in [0, 1). */
HYK_FN hyk_vec2 hyk_sample_pair(hyk_sampler s, hyk_uint d) {
    hyk_uint key_pixel = hyk_hash2(s.seed, d), key = hyk_hash2(key_pixel, s.pixel & 0x0fffffffu);
    hyk_uint key_x = hyk_hash(key + 1u), key_y = hyk_hash(key + 2u);
    hyk_uint order = hyk_reverse_bits(hyk_owen(hyk_reverse_bits(s.index), key));
    hyk_uint x = hyk_reverse_bits(hyk_owen(order, key_x));
    hyk_uint y = hyk_reverse_bits(hyk_owen(hyk_sobol_second(order), key_y));
    hyk_uint shift_x = hyk_owen(s.pixel, key_pixel);
    hyk_uint shift_y = hyk_reverse_bits(hyk_sobol_second(hyk_reverse_bits(shift_x)));
    hyk_uint noise = hyk_hash(s.pixel ^ key_pixel);
    return hyk_make2(hyk_unit_real(x ^ shift_x ^ (noise >> 4)), hyk_unit_real(y ^ shift_y ^ (hyk_hash(noise + 1u) >> 4)));
}

#endif /* HYK_SAMPLER_H */
