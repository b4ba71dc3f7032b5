/* The kernels of kernels_list.h on the host, in float or in double: a copy of them in each file that includes this after
   those of shaders/shared. In double they are the oracle, and tell how far results move when inputs do. */
#ifndef KERNELS_HOST_H
#define KERNELS_HOST_H

#include <stdint.h>

enum { KT_IN_MOST = 40, KT_OUT_MOST = 64 };

/* One case of one kernel. */
typedef struct kt_case {
    const uint32_t *in;
    const void *view;   /* the scene, a hyk_scene_view of the same hyk_real */
    double ulps;        /* in double: inputs are off by up to so many of float */
    int whole_vectors;  /* components of a vector are off by ulps of the largest one, not each by ulps of its own */
    uint64_t noise;     /* by how much is drawn from this */
    uint32_t read, written;
    double scale;
    double value[KT_OUT_MOST], size[KT_OUT_MOST]; /* results, and what their ulps are of */
    char kind[KT_OUT_MOST];                       /* 'u' or 'r' */
} kt_case;

/* The scene's buffers as they are in float, for the oracle to read. */
typedef struct kt_scene {
    const uint32_t *constants, *materials, *instances, *lights, *light_nodes; /* words of records */
    uint32_t material_count, instance_count, light_count, light_node_count;
    const void *textures, *texels, *meshes, *mesh_arrays; /* all words: the same in both */
    const float *environment, *environment_cdf, *energy_tables;
} kt_scene;

/* kernels_double.c. A view has what it reads of reals in double, off by up to ulps of float. */
void kt_run_double(uint32_t kernel, kt_case *k);
const void *kt_make_wide_view(const kt_scene *scene, double ulps, uint64_t noise);
void kt_free_wide_view(const void *view);

/* ---- words */

static inline uint32_t kt_uint(kt_case *k) { return k->in[k->read++]; }

static inline hyk_real kt_exact(kt_case *k) { return HYK_TO_REAL(hyk_bits_float(kt_uint(k))); }

/* -1 .. 1 (Vigna 2015, splitmix64). */
static inline double kt_noise(uint64_t *state) {
    uint64_t x = *state += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return (double)(int64_t)(x ^ (x >> 31)) / 9223372036854775808.0;
}

/* By how much a number of that size is off. */
static inline hyk_real kt_off(kt_case *k, hyk_real size) {
#if HYK_REAL_IS_FLOAT
    (void)k;
    (void)size;
    return 0.0f;
#else
    return k->ulps != 0 ? size * k->ulps * 1.1920928955078125e-07 * kt_noise(&k->noise) : 0;
#endif
}

static inline hyk_real kt_real(kt_case *k) {
    hyk_real x = kt_exact(k);
    return x + kt_off(k, x);
}

/* Random numbers are multiples of 2^-24. */
static inline hyk_real kt_unit(kt_case *k) {
    hyk_real u = kt_exact(k);
    return hyk_clamp(u + kt_off(k, 0.5f), 0.0f, HYK_C(1.0 - 1.0 / 16777216.0));
}

static inline hyk_vec2 kt_vec2(kt_case *k) {
    hyk_real x = kt_real(k);
    return hyk_make2(x, kt_real(k));
}

static inline hyk_vec2 kt_units(kt_case *k) {
    hyk_real x = kt_unit(k);
    return hyk_make2(x, kt_unit(k));
}

static inline hyk_vec3 kt_vec3(kt_case *k) {
    hyk_real x = kt_exact(k), y = kt_exact(k), z = kt_exact(k);
    hyk_real size = hyk_max3(hyk_abs3(hyk_make3(x, y, z)));
    x += kt_off(k, k->whole_vectors ? size : x);
    y += kt_off(k, k->whole_vectors ? size : y);
    z += kt_off(k, k->whole_vectors ? size : z);
    return hyk_make3(x, y, z);
}

static inline void kt_tell(kt_case *k, char kind, double value, double size) {
    k->kind[k->written] = kind;
    k->value[k->written] = value;
    k->size[k->written++] = size > k->scale ? size : k->scale;
}

static inline void kt_tell_real(kt_case *k, hyk_real x) { kt_tell(k, 'r', (double)x, fabs((double)x)); }

/* Errors of a vector are those of its direction and length: of its largest component. */
static inline void kt_tell_vec3(kt_case *k, hyk_vec3 v) {
    double size = (double)hyk_max3(hyk_abs3(v));
    kt_tell(k, 'r', (double)v.x, size);
    kt_tell(k, 'r', (double)v.y, size);
    kt_tell(k, 'r', (double)v.z, size);
}

#define KT_VIEW ((hyk_view)k->view)
#define KT_KERNEL(name) static __attribute__((noinline)) void kt_kernel_##name(kt_case *k)
#define KT_READER(type, name) static inline type kt_##name(kt_case *k)
#define KT_GET(what) kt_##what(k)
#define KT_SCALE(x) k->scale = (double)(x)
#define KT_UINT(x) kt_tell(k, 'u', (double)(x), 0)
#define KT_REAL(x) kt_tell_real(k, x)
#define KT_VEC3(x) kt_tell_vec3(k, x)
#include "kernels_list.h"

#define KT_NUMBER(name) KT_##name,
enum { KT_LIST(KT_NUMBER) KT_COUNT };

static inline void kt_run_here(uint32_t kernel, kt_case *k) {
#define KT_FUNCTION(name) kt_kernel_##name,
    static void (*const kernels[])(kt_case *) = {KT_LIST(KT_FUNCTION)};
    k->read = k->written = 0;
    k->scale = 0;
    kernels[kernel](k);
}

#endif /* KERNELS_HOST_H */
