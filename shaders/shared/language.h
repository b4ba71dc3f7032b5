/* >>shared-language: what lets one source be C99, C++11 and GLSL 4.60

   GLSL includes this with HYK_GLSL defined. In C, HYK_REAL may be double: the oracle.
   Rules for everything in shaders/shared: hyk_vec3 and friends have no operators, use the functions of
   vector.h; structs are declared with HYK_STRUCT and ended with HYK_END; functions with HYK_FN, or HYK_CALLED where they
   are so long that C should have one copy of them rather than one in each kernel; no
   pointers, no recursion, no implicit conversions; literals exact in binary carry an f suffix, all
   others go through HYK_C. Conversions: HYK_TO_REAL(x), HYK_TO_UINT(x), HYK_TO_INT(x). */
#ifndef HYK_LANGUAGE_H
#define HYK_LANGUAGE_H

#ifdef HYK_GLSL

#define HYK_FN
#define HYK_CALLED
#define HYK_STRUCT(name) struct name
#define HYK_END(name) ;
#define hyk_real float
#define hyk_uint uint
#define hyk_int int
#define hyk_bool bool
#define hyk_vec2 vec2
#define hyk_vec3 vec3
#define HYK_C(x) float(x)
#define HYK_TO_REAL(x) float(x)
#define HYK_TO_FLOAT(x) float(x)
#define HYK_TO_UINT(x) uint(x)
#define HYK_TO_INT(x) int(x)
#define HYK_REAL_MAX 3.402823466e+38
#define HYK_REAL_EPSILON 5.9604644775390625e-08 /* half an ulp of 1 */
#define HYK_SIZE_IS(name, bytes)

#else

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#ifndef HYK_REAL
#define HYK_REAL float
#define HYK_REAL_IS_FLOAT 1
#endif
#ifndef HYK_REAL_IS_FLOAT
#define HYK_REAL_IS_FLOAT 0
#endif

#if defined(__GNUC__) || defined(__clang__)
#define HYK_FN static inline __attribute__((always_inline, unused))
#define HYK_CALLED static __attribute__((noinline, unused))
#else
#define HYK_FN static inline
#define HYK_CALLED static
#endif
#define HYK_STRUCT(name) typedef struct name
#define HYK_END(name) name;

typedef HYK_REAL hyk_real;
typedef uint32_t hyk_uint;
typedef int32_t hyk_int;
typedef bool hyk_bool;
typedef struct hyk_vec2 { hyk_real x, y; } hyk_vec2;
typedef struct hyk_vec3 { hyk_real x, y, z; } hyk_vec3;

#define HYK_C(x) ((hyk_real)(x))
#define HYK_TO_REAL(x) ((hyk_real)(x))
#define HYK_TO_FLOAT(x) ((float)(x))
#define HYK_TO_UINT(x) ((hyk_uint)(x))
#define HYK_TO_INT(x) ((hyk_int)(x))
#if HYK_REAL_IS_FLOAT
#define HYK_REAL_MAX 3.402823466e+38f
#define HYK_REAL_EPSILON 5.9604644775390625e-08f
/* Size of a layout in bytes, the same under std430. Checked where hyk_real is float. */
#define HYK_SIZE_IS(name, bytes) typedef char hyk_size_of_##name[sizeof(name) == (bytes) ? 1 : -1];
#else
#define HYK_REAL_MAX 1.7976931348623157e+308
#define HYK_REAL_EPSILON 1.1102230246251565e-16
#define HYK_SIZE_IS(name, bytes)
#endif

#endif /* HYK_GLSL */

#define HYK_PI HYK_C(3.14159265358979323846)
#define HYK_INV_PI HYK_C(0.31830988618379067154)
#define HYK_NONE 0xffffffffu

#endif /* HYK_LANGUAGE_H */
