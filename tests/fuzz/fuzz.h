/* What the fuzz targets share: values drawn from the input, memory that counts and fails, and what must
   hold whatever the input was. */
#ifndef FUZZ_H
#define FUZZ_H

#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define FUZZ_MUST(condition)                                                        \
    do {                                                                            \
        if (!(condition)) {                                                         \
            fprintf(stderr, "%s:%d: broken: %s\n", __FILE__, __LINE__, #condition); \
            abort();                                                                \
        }                                                                           \
    } while (0)

/* ---- values from the input: all zero when it is used up */

typedef struct fuzz_input {
    const uint8_t *data;
    size_t left;
} fuzz_input;

static inline uint8_t fuzz_u8(fuzz_input *in) {
    if (in->left == 0) return 0;
    in->left--;
    return *in->data++;
}

static inline uint32_t fuzz_u32(fuzz_input *in) {
    uint32_t value = 0;
    for (int i = 0; i < 4; i++) value = value << 8 | fuzz_u8(in);
    return value;
}

static inline bool fuzz_bool(fuzz_input *in) { return fuzz_u8(in) & 1; }

/* Mostly harmless, at times an edge of the format, at times any bits. */
static inline float fuzz_float(fuzz_input *in) {
    static const float edges[] = {
        0.0f,        -0.0f,           1.0f,     -1.0f, NAN,    INFINITY, -INFINITY,         3.402823466e+38f, 1e-45f,
        -1e-45f,     1.17549435e-38f, 1e-20f,   1e20f, 1e-6f,  1e6f,     -3.402823466e+38f, 1.0001f,          10.0f,
        0.99999994f, 1.00000012f,     3.14159f, 1e12f, 1e-12f, 0.5f};
    uint8_t kind = fuzz_u8(in);
    if (kind < 160) return ((float)fuzz_u8(in) - 127.5f) / 64.0f;
    if (kind < 208) return (float)fuzz_u8(in) / 255.0f;
    if (kind < 244) return edges[fuzz_u8(in) % (sizeof edges / sizeof edges[0])];
    uint32_t bits = fuzz_u32(in);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline void fuzz_floats(fuzz_input *in, float *values, int count) {
    for (int i = 0; i < count; i++) values[i] = fuzz_float(in);
}

/* Between 0 and 1, but for one time in eight. */
static inline float fuzz_share(fuzz_input *in) { return fuzz_u8(in) % 8 ? (float)fuzz_u8(in) / 255.0f : fuzz_float(in); }

static inline void fuzz_shares(fuzz_input *in, float *values, int count) {
    for (int i = 0; i < count; i++) values[i] = fuzz_share(in);
}

/* A value of an enumeration with count values, at times one that is none. Written through memory. */
static inline void fuzz_enum(fuzz_input *in, void *to, uint32_t count) {
    uint32_t value = fuzz_u8(in);
    value = value < 240 ? value % count : value < 250 ? count : 0x7fffffffu;
    memcpy(to, &value, sizeof value);
}

/* ---- memory: fails from the given call on, counts what lives */

typedef struct fuzz_memory {
    int64_t blocks, bytes, calls, fail_at;
} fuzz_memory;

static inline void *fuzz_alloc(void *user, size_t size) {
    fuzz_memory *memory = (fuzz_memory *)user;
    if (__atomic_add_fetch(&memory->calls, 1, __ATOMIC_SEQ_CST) == memory->fail_at) return NULL;
    void *block = NULL;
    if (size > ((size_t)1 << 30) || !(block = aligned_alloc(64, (size + 63) / 64 * 64))) return NULL;
    memset(block, 0xa5, size);
    __atomic_add_fetch(&memory->blocks, 1, __ATOMIC_SEQ_CST);
    __atomic_add_fetch(&memory->bytes, (int64_t)size, __ATOMIC_SEQ_CST);
    return block;
}

static inline void fuzz_release(void *user, void *block, size_t size) {
    fuzz_memory *memory = (fuzz_memory *)user;
    __atomic_sub_fetch(&memory->blocks, 1, __ATOMIC_SEQ_CST);
    __atomic_sub_fetch(&memory->bytes, (int64_t)size, __ATOMIC_SEQ_CST);
    free(block);
}

/* ---- what must hold */

static inline bool fuzz_finite(float value) { return value - value == 0.0f; }

/* A call's result: one of those declared. */
static inline hydra_result fuzz_code(hydra_result result) {
    FUZZ_MUST((unsigned)result < (unsigned)HYDRA_RESULT_COUNT);
    FUZZ_MUST(hydra_result_text(result)[0] != 0);
    return result;
}

/* The same, and with a message when it is an error: for calls that may write to their context. */
static inline hydra_result fuzz_result(const hydra_context *context, hydra_result result) {
    fuzz_code(result);
    if (result > HYDRA_CANCELLED) FUZZ_MUST(hydra_error_text(context)[0] != 0);
    return result;
}

static inline bool fuzz_is_uint(hydra_output output) {
    return output == HYDRA_PRIMITIVE_ID || output == HYDRA_INSTANCE_ID || output == HYDRA_MESH_ID || output == HYDRA_MATERIAL_ID ||
           output == HYDRA_SAMPLES || output == HYDRA_VALIDITY;
}

/* Reads every output there is: no NaN, no infinity but for depth and unknown errors, nothing negative that is light. */
static inline void fuzz_read_all(const hydra_context *context, hydra_render *render, size_t pixels) {
    enum { limit = 4096 };
    static float buffer[limit * 3];
    if (pixels > limit) return;
    for (uint32_t o = 0; o < HYDRA_OUTPUT_COUNT; o++) {
        hydra_output output = (hydra_output)o;
        if (fuzz_result(context, hydra_render_read(render, output, buffer, 0)) != HYDRA_OK || fuzz_is_uint(output)) continue;
        size_t values = pixels * hydra_output_size(output) / 4;
        for (size_t i = 0; i < values; i++) {
            FUZZ_MUST(buffer[i] == buffer[i]);
            if (output != HYDRA_DEPTH && output != HYDRA_ERROR) FUZZ_MUST(fuzz_finite(buffer[i]));
            if (output != HYDRA_NORMAL && output != HYDRA_POSITION) FUZZ_MUST(buffer[i] >= 0);
        }
    }
}

static inline void fuzz_check_status(hydra_render *render) {
    hydra_status status = hydra_render_status(render);
    FUZZ_MUST(status.fraction >= 0 && status.fraction <= 1);
    FUZZ_MUST(status.seconds >= 0 && status.seconds_left >= 0 && status.samples >= 0);
    FUZZ_MUST(status.error >= 0 && status.error_low <= status.error && status.error <= status.error_high);
    FUZZ_MUST(status.tiles_active <= status.tiles_total);
}

#endif /* FUZZ_H */
