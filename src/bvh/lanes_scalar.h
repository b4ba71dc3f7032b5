/* >>bvh-scalar: traversal in plain C, for any machine: eight lanes are eight floats */
#ifndef HYI_BVH_SCALAR_H
#define HYI_BVH_SCALAR_H

#include "answer.h"

#include "lanes_begin.inc.h"

typedef struct hyi_f8 {
    float v[8];
} hyi_f8;

#define HYI_EIGHT(name, expression)                   \
    HYI_INLINE hyi_f8 name(hyi_f8 a, hyi_f8 b) {      \
        hyi_f8 r;                                     \
        for (int i = 0; i < 8; i++) r.v[i] = (expression); \
        return r;                                     \
    }
HYI_EIGHT(hyi_add8_scalar, a.v[i] + b.v[i])
HYI_EIGHT(hyi_sub8_scalar, a.v[i] - b.v[i])
HYI_EIGHT(hyi_mul8_scalar, a.v[i] * b.v[i])
HYI_EIGHT(hyi_div8_scalar, a.v[i] / b.v[i])
HYI_EIGHT(hyi_min8_scalar, b.v[i] < a.v[i] ? b.v[i] : a.v[i])
HYI_EIGHT(hyi_max8_scalar, b.v[i] > a.v[i] ? b.v[i] : a.v[i])
#undef HYI_EIGHT

HYI_INLINE hyi_f8 hyi_load8_scalar(const float *p) {
    hyi_f8 r;
    memcpy(r.v, p, sizeof r.v);
    return r;
}

HYI_INLINE hyi_f8 hyi_set8_scalar(float value) {
    hyi_f8 r;
    for (int i = 0; i < 8; i++) r.v[i] = value;
    return r;
}

HYI_INLINE hyi_f8 hyi_mad8_scalar(hyi_f8 a, hyi_f8 b, hyi_f8 c) {
    for (int i = 0; i < 8; i++) a.v[i] = a.v[i] * b.v[i] + c.v[i];
    return a;
}

HYI_INLINE hyi_f8 hyi_size8_scalar(hyi_f8 a) {
    for (int i = 0; i < 8; i++) a.v[i] = fabsf(a.v[i]);
    return a;
}

HYI_INLINE hyi_f8 hyi_pin8_scalar(hyi_f8 a) {
    for (int i = 0; i < 8; i++) a.v[i] = hyi_rounded(a.v[i]);
    return a;
}

HYI_INLINE uint32_t hyi_lt8_scalar(hyi_f8 a, hyi_f8 b) {
    uint32_t mask = 0;
    for (int i = 0; i < 8; i++) mask |= (a.v[i] < b.v[i] ? 1u : 0u) << i;
    return mask;
}

HYI_INLINE uint32_t hyi_le8_scalar(hyi_f8 a, hyi_f8 b) {
    uint32_t mask = 0;
    for (int i = 0; i < 8; i++) mask |= (a.v[i] <= b.v[i] ? 1u : 0u) << i;
    return mask;
}

#define HYI_TARGET
#define HYI_ALWAYS_EXACT 1 /* eight judgements would cost more than the decisions that they spare */
#define HYI_EXACT_ALONE 1
#define HYI_I(name) name##_scalar
#define HYI_PUSH_SEVERAL(stack, node, enter, mask, ahead) hyi_push_farther(stack, (node)->child, enter, mask, ahead)
#define HYI_F8 hyi_f8
#define HYI_M8 uint32_t
#define HYI_LOAD8(p) hyi_load8_scalar(p)
#define HYI_LOADU8(p) hyi_load8_scalar(p)
#define HYI_STORE8(p, a) memcpy(p, (a).v, sizeof (a).v)
#define HYI_SET8(value) hyi_set8_scalar(value)
#define HYI_ZERO8() hyi_set8_scalar(0.0f)
#define HYI_ADD8(a, b) hyi_add8_scalar(a, b)
#define HYI_SUB8(a, b) hyi_sub8_scalar(a, b)
#define HYI_MUL8(a, b) hyi_mul8_scalar(a, b)
#define HYI_DIV8(a, b) hyi_div8_scalar(a, b)
#define HYI_MAD8(a, b, c) hyi_mad8_scalar(a, b, c)
#define HYI_MIN8(a, b) hyi_min8_scalar(a, b)
#define HYI_MAX8(a, b) hyi_max8_scalar(a, b)
#define HYI_SIZE8(a) hyi_size8_scalar(a)
#define HYI_MAX8_AS_INTS(a, b) HYI_MAX8(a, b)
#define HYI_MIN8_AS_INTS(a, b) HYI_MIN8(a, b)
#define HYI_LT8(a, b) hyi_lt8_scalar(a, b)
#define HYI_LE8(a, b) hyi_le8_scalar(a, b)
#define HYI_AND8(a, b) ((a) & (b))
#define HYI_OR8(a, b) ((a) | (b))
#define HYI_BITS8(m) (m)
#define HYI_PIN8(a) hyi_pin8_scalar(a)
#define HYI_FLIGHT_BEGIN(flight, accel, bvh, ray) hyi_begin_any(flight, bvh, ray)
#include "walk_body.inc.h"
#include "lanes_end.inc.h"

#endif /* HYI_BVH_SCALAR_H */
