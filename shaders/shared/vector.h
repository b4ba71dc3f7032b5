/* >>shared-vector: scalars and vectors under one name in C and GLSL */
#ifndef HYK_VECTOR_H
#define HYK_VECTOR_H

#include "language.h"

#ifdef HYK_GLSL

#define hyk_make2(a, b) vec2(a, b)
#define hyk_make3(a, b, c) vec3(a, b, c)
#define hyk_add(a, b) ((a) + (b))
#define hyk_sub(a, b) ((a) - (b))
#define hyk_mul(a, b) ((a) * (b))
#define hyk_scale(a, s) ((a) * (s))
#define hyk_neg(a) (-(a))
#define hyk_dot(a, b) dot(a, b)
#define hyk_cross(a, b) cross(a, b)
#define hyk_abs3(a) abs(a)
#define hyk_sqrt(x) sqrt(x)
#define hyk_abs(x) abs(x)
#define hyk_min(a, b) min(a, b)
#define hyk_max(a, b) max(a, b)
#define hyk_floor(x) floor(x)
#define hyk_exp(x) exp(x)
#define hyk_log2(x) log2(x)
#define hyk_exp2(x) exp2(x)
#define hyk_pow(x, y) pow(x, y)
#define hyk_min_uint(a, b) min(a, b)
#define hyk_max_uint(a, b) max(a, b)
#define hyk_float_bits(x) floatBitsToUint(x)
#define hyk_bits_float(x) uintBitsToFloat(x)
#define hyk_is_finite(x) (!isnan(x) && !isinf(x))
#define hyk_reverse_bits(x) bitfieldReverse(x)

/* Vulkan lets sines be off by 2^-11 and arcs by 4096 ulps. These are off by about 2 ulps where they are used here, sines
   of up to some thousand. Coefficients: Moshier, Cephes, sinf.c and atanf.c. */
float hyk_from_quarter(float x, float quarters) {
    precise float high = x - quarters * 1.5703125;
    precise float low = high - quarters * 4.837512969970703125e-4;
    precise float rest = low - quarters * 7.54978995489188216e-8;
    return rest;
}
float hyk_wave(float x, int turn) { /* sine of x + turn quarters */
    float quarters = floor(x * 0.636619772367581343 + 0.5);
    float r = hyk_from_quarter(x, quarters), z = r * r;
    int q = int(quarters) + turn;
    float s = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * z * r + r;
    float c = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * z * z - 0.5 * z + 1.0;
    float w = (q & 1) != 0 ? c : s;
    return (q & 2) != 0 ? -w : w;
}
float hyk_sin(float x) { return hyk_wave(x, 0); }
float hyk_cos(float x) { return hyk_wave(x, 1); }
float hyk_atan2(float y, float x) {
    float near = min(abs(x), abs(y)), far = max(abs(x), abs(y)), t = far > 0.0 ? near / far : 0.0;
    bool upper = t > 0.414213562373095049;
    t = upper ? (near - far) / (near + far) : t;
    float z = t * t;
    float arc = (((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1) * z * t + t;
    arc += upper ? 0.785398163397448309 : 0.0;
    arc = abs(y) > abs(x) ? 1.57079632679489662 - arc : arc;
    arc = x < 0.0 ? 3.14159265358979324 - arc : arc;
    return y < 0.0 ? -arc : arc;
}

#else

#if HYK_REAL_IS_FLOAT
#define HYK_MATH(name) name##f
#else
#define HYK_MATH(name) name
#endif

HYK_FN hyk_vec2 hyk_make2(hyk_real x, hyk_real y) { hyk_vec2 r; r.x = x; r.y = y; return r; }
HYK_FN hyk_vec3 hyk_make3(hyk_real x, hyk_real y, hyk_real z) { hyk_vec3 r; r.x = x; r.y = y; r.z = z; return r; }
HYK_FN hyk_vec3 hyk_add(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x + b.x, a.y + b.y, a.z + b.z); }
HYK_FN hyk_vec3 hyk_sub(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x - b.x, a.y - b.y, a.z - b.z); }
HYK_FN hyk_vec3 hyk_mul(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x * b.x, a.y * b.y, a.z * b.z); }
HYK_FN hyk_vec3 hyk_scale(hyk_vec3 a, hyk_real s) { return hyk_make3(a.x * s, a.y * s, a.z * s); }
HYK_FN hyk_vec3 hyk_neg(hyk_vec3 a) { return hyk_make3(-a.x, -a.y, -a.z); }
HYK_FN hyk_real hyk_dot(hyk_vec3 a, hyk_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
HYK_FN hyk_vec3 hyk_cross(hyk_vec3 a, hyk_vec3 b) {
    return hyk_make3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
HYK_FN hyk_real hyk_sqrt(hyk_real x) { return HYK_MATH(sqrt)(x); }
HYK_FN hyk_real hyk_abs(hyk_real x) { return HYK_MATH(fabs)(x); }
HYK_FN hyk_vec3 hyk_abs3(hyk_vec3 a) { return hyk_make3(hyk_abs(a.x), hyk_abs(a.y), hyk_abs(a.z)); }
HYK_FN hyk_real hyk_min(hyk_real a, hyk_real b) { return a < b ? a : b; }
HYK_FN hyk_real hyk_max(hyk_real a, hyk_real b) { return a > b ? a : b; }
HYK_FN hyk_real hyk_floor(hyk_real x) { return HYK_MATH(floor)(x); }
HYK_FN hyk_real hyk_sin(hyk_real x) { return HYK_MATH(sin)(x); }
HYK_FN hyk_real hyk_cos(hyk_real x) { return HYK_MATH(cos)(x); }
HYK_FN hyk_real hyk_atan2(hyk_real y, hyk_real x) { return HYK_MATH(atan2)(y, x); }
HYK_FN hyk_real hyk_exp(hyk_real x) { return HYK_MATH(exp)(x); }
HYK_FN hyk_real hyk_log2(hyk_real x) { return HYK_MATH(log2)(x); }
HYK_FN hyk_real hyk_exp2(hyk_real x) { return HYK_MATH(exp2)(x); }
HYK_FN hyk_uint hyk_min_uint(hyk_uint a, hyk_uint b) { return a < b ? a : b; }
HYK_FN hyk_uint hyk_max_uint(hyk_uint a, hyk_uint b) { return a > b ? a : b; }
HYK_FN hyk_uint hyk_float_bits(float x) { hyk_uint r; memcpy(&r, &x, sizeof r); return r; }
HYK_FN float hyk_bits_float(hyk_uint x) { float r; memcpy(&r, &x, sizeof r); return r; }
#if HYK_REAL_IS_FLOAT /* by the exponent's bits: fast-math assumes comparisons with NaN away */
HYK_FN hyk_bool hyk_is_finite(hyk_real x) { return (hyk_float_bits(x) & 0x7f800000u) != 0x7f800000u; }
#else
HYK_FN hyk_bool hyk_is_finite(hyk_real x) { return hyk_abs(x) <= HYK_REAL_MAX; }
#endif
HYK_FN hyk_uint hyk_reverse_bits(hyk_uint x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    return (x >> 16) | (x << 16);
}

#endif /* HYK_GLSL */

HYK_FN hyk_real hyk_clamp(hyk_real x, hyk_real lo, hyk_real hi) { return hyk_min(hyk_max(x, lo), hi); }
HYK_FN hyk_real hyk_saturate(hyk_real x) { return hyk_min(hyk_max(x, 0.0f), 1.0f); }
HYK_FN hyk_real hyk_square(hyk_real x) { return x * x; }
HYK_FN hyk_real hyk_safe_sqrt(hyk_real x) { return hyk_sqrt(hyk_max(x, 0.0f)); }
HYK_FN hyk_real hyk_lerp(hyk_real a, hyk_real b, hyk_real t) { return a + (b - a) * t; }
HYK_FN hyk_vec3 hyk_splat(hyk_real x) { return hyk_make3(x, x, x); }
HYK_FN hyk_vec3 hyk_zero3(void) { return hyk_make3(0.0f, 0.0f, 0.0f); }
HYK_FN hyk_vec3 hyk_add_scaled(hyk_vec3 a, hyk_vec3 b, hyk_real s) { return hyk_add(a, hyk_scale(b, s)); }
HYK_FN hyk_vec3 hyk_lerp3(hyk_vec3 a, hyk_vec3 b, hyk_real t) { return hyk_add_scaled(a, hyk_sub(b, a), t); }
HYK_FN hyk_real hyk_length_squared(hyk_vec3 a) { return hyk_dot(a, a); }
HYK_FN hyk_real hyk_max3(hyk_vec3 a) { return hyk_max(a.x, hyk_max(a.y, a.z)); }
HYK_FN hyk_bool hyk_is_black(hyk_vec3 a) { return hyk_max3(a) <= 0.0f; }
/* Luminance of linear Rec.709. */
HYK_FN hyk_real hyk_luminance(hyk_vec3 c) { return HYK_C(0.2126) * c.x + HYK_C(0.7152) * c.y + HYK_C(0.0722) * c.z; }

/* Length and unit vector without overflow or underflow of the squares: scaled by the largest component. */
HYK_FN hyk_real hyk_length(hyk_vec3 a) {
    hyk_real m = hyk_max3(hyk_abs3(a));
    if (!(m > 0.0f)) return 0.0f;
    hyk_vec3 s = hyk_make3(a.x / m, a.y / m, a.z / m);
    return m * hyk_sqrt(hyk_dot(s, s));
}
/* Zero stays zero. */
HYK_FN hyk_vec3 hyk_normalize(hyk_vec3 a) {
    hyk_real m = hyk_max3(hyk_abs3(a));
    if (!(m > 0.0f)) return a;
    hyk_vec3 s = hyk_make3(a.x / m, a.y / m, a.z / m);
    return hyk_scale(s, 1.0f / hyk_sqrt(hyk_dot(s, s)));
}

/* An orthonormal frame around unit n (Duff et al. 2017, "Building an orthonormal basis, revisited"). */
HYK_STRUCT(hyk_frame) {
    hyk_vec3 x, y, z;
} HYK_END(hyk_frame)

HYK_FN hyk_frame hyk_make_frame(hyk_vec3 n) {
    hyk_real s = n.z >= 0.0f ? 1.0f : -1.0f;
    hyk_real a = -1.0f / (s + n.z);
    hyk_real b = n.x * n.y * a;
    hyk_frame f;
    f.x = hyk_make3(1.0f + s * n.x * n.x * a, s * b, -s * n.x);
    f.y = hyk_make3(b, s + n.y * n.y * a, -n.y);
    f.z = n;
    return f;
}
HYK_FN hyk_vec3 hyk_to_local(hyk_frame f, hyk_vec3 v) { return hyk_make3(hyk_dot(v, f.x), hyk_dot(v, f.y), hyk_dot(v, f.z)); }
HYK_FN hyk_vec3 hyk_to_world(hyk_frame f, hyk_vec3 v) {
    return hyk_add(hyk_scale(f.x, v.x), hyk_add(hyk_scale(f.y, v.y), hyk_scale(f.z, v.z)));
}

#endif /* HYK_VECTOR_H */
