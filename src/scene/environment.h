/* >>scene-environment: sampling weights of an environment map (shaders/shared/light_layouts.h has the layout) */
#ifndef HYI_ENVIRONMENT_H
#define HYI_ENVIRONMENT_H

#include "../base/threads.h"
#include "../../shaders/shared/light_layouts.h"

/* Luminance of a texel as the kernels see it: negative texels weigh nothing. */
HYI_INLINE double hyi_texel_luminance(const float *texel) {
    double luminance = 0.2126 * (double)texel[0] + 0.7152 * (double)texel[1] + 0.0722 * (double)texel[2];
    return luminance > 0.0 ? luminance : 0.0;
}

/* How the range splits: the smaller share, negative when it is the upper half's. Nothing above is written
   as the smallest normal number, because minus zero would read as "nothing below". */
HYI_INLINE float hyi_split_share(double below, double above) {
    double sum = below + above;
    if (!(sum > 0.0)) return 0.5f;
    double share = (below <= above ? below : above) / sum;
    float stored = share > (double)FLT_MIN ? (float)share : FLT_MIN;
    return below <= above ? (below > 0.0 ? stored : 0.0f) : -stored;
}

/* Writes the splits of [first, last) and returns its weight. The recursion is as deep as a binary logarithm. */
HYI_FN double hyi_split_weights(const double *weights, float *splits, uint32_t first, uint32_t last) {
    if (last - first == 1) return weights[first];
    uint32_t middle = first + (last - first) / 2;
    double below = hyi_split_weights(weights, splits, first, middle), above = hyi_split_weights(weights, splits, middle, last);
    splits[middle] = hyi_split_share(below, above);
    return below + above;
}

typedef struct hyi_environment_work {
    const float *texels;
    uint32_t width, height;
    float *cdf;
    double *scratch;     /* width weights per strip of rows */
    double *row_weights; /* height + 1 */
    uint32_t strips;
} hyi_environment_work;

/* Weights of one row's cells, and its splits. */
HYI_FN void hyi_environment_row(const hyi_environment_work *work, uint32_t row, double *weights) {
    uint32_t w = work->width, h = work->height;
    const float *above = work->texels + 3 * (size_t)w * (row == 0 ? 0 : row - 1);
    const float *below = work->texels + 3 * (size_t)w * (row == h ? h - 1 : row);
    double from = row == 0 ? 0.0 : HYI_PI * ((double)row - 0.5) / (double)h, to = row == h ? HYI_PI : HYI_PI * ((double)row + 0.5) / (double)h;
    double solid_angle = 2.0 * sin(0.5 * (from + to)) * sin(0.5 * (to - from)) * 2.0 * HYI_PI / (double)w;
    for (uint32_t x = 0; x < w; x++) {
        uint32_t right = x + 1 == w ? 0 : x + 1;
        double sum = hyi_texel_luminance(above + 3 * (size_t)x) + hyi_texel_luminance(above + 3 * (size_t)right) +
                     hyi_texel_luminance(below + 3 * (size_t)x) + hyi_texel_luminance(below + 3 * (size_t)right);
        weights[x] = 0.25 * sum * solid_angle;
    }
    work->row_weights[row] = hyi_split_weights(weights, work->cdf + (h + 1) + (size_t)w * row, 0, w);
}

HYI_FN void hyi_environment_strip(void *argument, uint32_t strip) {
    const hyi_environment_work *work = (const hyi_environment_work *)argument;
    uint32_t rows = work->height + 1;
    uint32_t first = (uint32_t)((uint64_t)rows * strip / work->strips), last = (uint32_t)((uint64_t)rows * (strip + 1) / work->strips);
    for (uint32_t row = first; row < last; row++) hyi_environment_row(work, row, work->scratch + (size_t)work->width * strip);
}

/* texels: width x height RGB, both at least 1, finite. *cdf gets *cdf_count numbers (free with hyi_free_array),
   *integral the sum of the weights: 0 for a black map. On error nothing is allocated. */
HYI_FN hydra_result hyi_environment_build(hydra_context *context, const float *texels, uint32_t width, uint32_t height, float **cdf,
                                          size_t *cdf_count, float *integral) {
    *cdf = NULL;
    *cdf_count = 0;
    *integral = 0.0f;
    if (hyi_multiply_overflows(width, (size_t)height + 2)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "environment of %u x %u", width, height);
    size_t count = ((size_t)height + 1) + (size_t)width * ((size_t)height + 1);
    hyi_environment_work work;
    memset(&work, 0, sizeof work);
    work.texels = texels;
    work.width = width;
    work.height = height;
    work.strips = height < 64 ? height + 1 : 64;
    HYI_TRY(hyi_alloc_array(context, &work.cdf, count));
    hydra_result result = hyi_alloc_array(context, &work.scratch, (size_t)width * work.strips);
    if (result == HYDRA_OK) result = hyi_alloc_array(context, &work.row_weights, (size_t)height + 1);
    if (result == HYDRA_OK) {
        memset(work.cdf, 0, count * sizeof *work.cdf); /* places no split uses */
        hyi_parallel(context, work.strips, hyi_environment_strip, &work);
        double sum = hyi_split_weights(work.row_weights, work.cdf, 0, height + 1);
        *integral = sum < (double)FLT_MAX ? (float)sum : FLT_MAX;
        *cdf = work.cdf;
        *cdf_count = count;
    } else {
        hyi_free_array(context, &work.cdf, count);
    }
    hyi_free_array(context, &work.row_weights, (size_t)height + 1);
    hyi_free_array(context, &work.scratch, (size_t)width * work.strips);
    return result;
}

#endif /* HYI_ENVIRONMENT_H */
