#version 460
#extension GL_GOOGLE_include_directive : require
/* A group of the kernels of kernels_list.h, -DKT_GROUP=n, on a device: case by case, words to words. */
#define HYK_GLSL 1
#include "passes.h"
#include "scan.h"

layout(local_size_x = 64) in;
layout(push_constant) uniform kt_push { uint kt_kernel, kt_cases, kt_in_words, kt_out_words; };
layout(std430, set = 1, binding = 0) readonly buffer kt_in_buffer { uint kt_in[]; };
layout(std430, set = 1, binding = 1) writeonly buffer kt_out_buffer { uint kt_out[]; };

uint kt_read, kt_written;

uint kt_uint() { return kt_in[kt_read++]; }
float kt_real() { return uintBitsToFloat(kt_uint()); }
float kt_unit() { return kt_real(); }
float kt_exact() { return kt_real(); }
vec2 kt_vec2() {
    float x = kt_real();
    return vec2(x, kt_real());
}
vec2 kt_units() { return kt_vec2(); }
vec3 kt_vec3() {
    vec2 xy = kt_vec2();
    return vec3(xy, kt_real());
}

void kt_tell3(vec3 x) {
    for (uint i = 0u; i < 3u; i++) kt_out[kt_written++] = floatBitsToUint(x[i]);
}

#define KT_VIEW 0u
#define KT_KERNEL(name) void kt_kernel_##name()
#define KT_READER(type, name) type kt_##name()
#define KT_GET(what) kt_##what()
#define KT_SCALE(x)
#define KT_UINT(x) kt_out[kt_written++] = (x)
#define KT_REAL(x) kt_out[kt_written++] = floatBitsToUint(x)
#define KT_VEC3(x) kt_tell3(x)
#include "kernels_list.h"

#define KT_RUN(name) if (kt_kernel == kt_number++) kt_kernel_##name();

void main() {
    uint kt_number = 0u;
    if (gl_GlobalInvocationID.x >= kt_cases) return;
    kt_read = gl_GlobalInvocationID.x * kt_in_words;
    kt_written = gl_GlobalInvocationID.x * kt_out_words;
#if KT_GROUP == 0
    KT_VECTOR(KT_RUN)
#elif KT_GROUP == 1
    KT_WHOLE(KT_RUN)
#elif KT_GROUP == 2
    KT_WARPS(KT_RUN)
#elif KT_GROUP == 3
    KT_OPTICS(KT_RUN)
#elif KT_GROUP == 4
    KT_IMAGES(KT_RUN)
#elif KT_GROUP == 5
    KT_BSDF(KT_RUN)
#elif KT_GROUP == 6
    KT_LIGHTS(KT_RUN)
#else
    KT_PATHS(KT_RUN)
#endif
}
