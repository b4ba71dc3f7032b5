/* >>scene-validate: checks shared by all descriptors; each names its error */
#ifndef HYI_VALIDATE_H
#define HYI_VALIDATE_H

#include "../base/context.h"

/* By the bits of the exponent: holds under fast-math too. */
HYI_INLINE bool hyi_is_finite(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits & 0x7f800000u) != 0x7f800000u;
}

HYI_FN bool hyi_all_finite(const float *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!hyi_is_finite(x[i])) return false;
    return true;
}

HYI_FN bool hyi_all_zero(const float *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (x[i] != 0.0f) return false;
    return true;
}

HYI_FN hydra_result hyi_check_finite(hydra_context *context, const float *x, size_t count, const char *what) {
    return hyi_all_finite(x, count) ? HYDRA_OK : hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "%s", what);
}

/* A colour: finite, not negative, at most highest. */
HYI_FN hydra_result hyi_check_color(hydra_context *context, const float c[3], float highest, const char *what) {
    HYI_TRY(hyi_check_finite(context, c, 3, what));
    for (int i = 0; i < 3; i++)
        if (c[i] < 0.0f || c[i] > highest) return hyi_fail(context, HYDRA_ERROR_COLOR, "%s[%d] is %g", what, i, (double)c[i]);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_range(hydra_context *context, float x, float lowest, float highest, hydra_result error, const char *what) {
    HYI_TRY(hyi_check_finite(context, &x, 1, what));
    if (x < lowest || x > highest) return hyi_fail(context, error, "%s is %g", what, (double)x);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_enum(hydra_context *context, int value, int count, const char *what) {
    if (value < 0 || value >= count) return hyi_fail(context, HYDRA_ERROR_ENUM, "%s is %d", what, value);
    return HYDRA_OK;
}

/* A view of elements of size bytes, with scalars of 4. */
HYI_FN hydra_result hyi_check_view(hydra_context *context, hydra_view view, size_t size, const char *what) {
    if (!view.data) return hyi_fail(context, HYDRA_ERROR_NULL, "%s.data", what);
    if (view.stride && view.stride < size) return hyi_fail(context, HYDRA_ERROR_STRIDE, "%s.stride is %zu, an element has %zu bytes", what, view.stride, size);
    if (view.stride % 4 || (uintptr_t)view.data % 4) return hyi_fail(context, HYDRA_ERROR_STRIDE, "%s is not aligned to 4 bytes", what);
    if (hyi_multiply_overflows(view.count, view.stride ? view.stride : size)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%s: %zu elements", what, view.count);
    return HYDRA_OK;
}

HYI_INLINE const void *hyi_view_at(hydra_view view, size_t size, size_t i) {
    return (const char *)view.data + i * (view.stride ? view.stride : size);
}

/* Copies a checked view of count x width floats into a tight array of its own; every number must be finite. */
HYI_FN hydra_result hyi_copy_floats(hydra_context *context, hydra_view view, size_t width, float **copy, const char *what) {
    HYI_TRY(hyi_check_view(context, view, width * sizeof(float), what));
    HYI_TRY(hyi_alloc_array(context, copy, view.count * width));
    for (size_t i = 0; i < view.count; i++) {
        float *element = *copy + i * width;
        memcpy(element, hyi_view_at(view, width * sizeof(float), i), width * sizeof(float));
        if (hyi_all_finite(element, width)) continue;
        hyi_free_array(context, copy, view.count * width);
        return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "%s: element %zu", what, i);
    }
    return HYDRA_OK;
}

#endif /* HYI_VALIDATE_H */
