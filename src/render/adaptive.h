/* >>render-adaptive: which tile gets how many samples

   HYDRA's tiles (ALGORITHMS section 3) with a stopping rule that does not bias the picture. Stopping when one's own
   estimate looks good favours estimates that missed something. So each half of the samples judges the other: half A's
   samples enter the picture up to the stage at which half B found the error small enough, and the other way round. How
   many of a half's samples count is then independent of what they say, and its mean stays unbiased. A half that has
   been judged but has not yet judged goes on sampling for its verdict only.

   Error of a tile, as half h sees it: sqrt(mean over pixels of w v / 2n), v a pixel's sample variance of luminance
   (within chunks, pooled), n the samples of one half, w = 1 / max(mean, L / 10)^2 with L the picture's mean luminance,
   everything from half h. A tile is also charged with one sample of luminance L that it has not seen: a black tile
   must be sampled until that would not matter. */
#ifndef HYI_ADAPTIVE_H
#define HYI_ADAPTIVE_H

#include "film.h"

#define HYI_CHUNK_SAMPLES 8u  /* a pixel, half of them for each half */
#define HYI_LEAST_CHUNKS 4u   /* before any verdict */
#define HYI_DARK_SHARE 0.1    /* of L: darker pixels are judged as if that bright */

/* Chunks at the end of a stage: each stage adds a third. */
HYI_FN uint32_t hyi_stage_chunks(uint32_t stage) {
    uint32_t chunks = 1;
    for (uint32_t i = 0; i < stage && chunks < 0x10000000u; i++) chunks += chunks < 3 ? 1 : chunks / 3;
    return chunks;
}

typedef struct hyi_schedule {
    float target;         /* 0: every tile takes all chunks */
    uint32_t total_chunks;
    uint32_t stage;       /* in work */
    uint32_t *active;     /* tiles of this stage's round */
    uint32_t *base;       /* chunks each had when the round began */
    uint32_t active_count;
    uint32_t rounds_each; /* chunks the tile that lacks most must take */
    hyi_atomic next;      /* unit of the round: chunk-major, so that a tile's chunks are taken in order */
    uint32_t weighed_stage; /* whose weights stand below; stage 0 has none */
    float *weights;       /* 2 a pixel, where there is a target */
    double brightness[2]; /* L by each half, at the start of the stage */
} hyi_schedule;

HYI_FN bool hyi_tile_is_done(const hyi_schedule *schedule, const hyi_tile *tile) {
    return tile->chunks >= schedule->total_chunks || (tile->passed[0] && tile->passed[1]);
}

HYI_FN uint32_t hyi_stage_target(const hyi_schedule *schedule) {
    uint32_t target = hyi_stage_chunks(schedule->stage);
    return target < schedule->total_chunks ? target : schedule->total_chunks;
}

/* ---- what a chunk says about the error */

/* Sum over the chunk's pixels of weight times sample variance, for one half; lum holds samples of both halves. */
HYI_FN double hyi_pixel_variance(const float *lum, uint32_t samples, int half) {
    double sum = 0.0, squares = 0.0;
    uint32_t n = 0;
    for (uint32_t s = (uint32_t)half; s < samples; s += 2, n++) {
        sum += (double)lum[s];
        squares += (double)lum[s] * (double)lum[s];
    }
    if (n < 2) return 0.0;
    double variance = (squares - sum * sum / (double)n) / (double)(n - 1);
    return variance > 0.0 ? variance : 0.0;
}

HYI_FN bool hyi_tile_passes(const hyi_schedule *schedule, const hyi_tile *tile, int half, uint32_t pixels) {
    if (tile->judged == 0) return false;
    double n = 0.5 * (double)tile->taken, count = (double)pixels;
    double variance = hyi_sum_value(&tile->statistic[half]) / ((double)tile->judged * count);
    double unseen = 1.0 / (HYI_DARK_SHARE * HYI_DARK_SHARE) / (2.0 * n * count);
    double error = sqrt((variance + (schedule->brightness[half] > 0.0 ? unseen : 0.0)) / (2.0 * n));
    return error <= (double)schedule->target;
}

/* ---- between stages */

/* Pixels of a tile that lie in the region. */
HYI_FN uint32_t hyi_tile_inside(const hyi_film *film, size_t tile) {
    uint32_t x0 = hyi_tile_left(film, tile), y0 = hyi_tile_top(film, tile);
    uint32_t x1 = x0 + film->tile_width, y1 = y0 + film->tile_height;
    if (x0 < film->left) x0 = film->left;
    if (y0 < film->top) y0 = film->top;
    if (x1 > film->right) x1 = film->right;
    if (y1 > film->bottom) y1 = film->bottom;
    return (x1 - x0) * (y1 - y0);
}

/* Verdicts of a finished stage. */
HYI_FN void hyi_judge_tiles(const hyi_schedule *schedule, hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++) {
        hyi_tile *tile = &film->tiles[i];
        if (tile->chunks < HYI_LEAST_CHUNKS || tile->chunks != hyi_stage_target(schedule)) continue;
        for (int half = 0; half < 2; half++)
            if (!tile->passed[half]) tile->passed[half] = hyi_tile_passes(schedule, tile, half, hyi_tile_inside(film, i)) ? 1u : 0u;
    }
}

HYI_FN void hyi_measure_brightness(hyi_schedule *schedule, const hyi_film *film) {
    double sum[2] = { 0.0, 0.0 };
    for (size_t i = 0; i < hyi_film_pixel_count(film); i++) {
        const hyi_tile *tile = &film->tiles[i / film->tile_pixels];
        for (int half = 0; half < 2; half++) {
            double mean[3];
            hyi_half_mean(film, tile, i, half, mean);
            sum[half] += hyi_wide_luminance(mean);
        }
    }
    double count = (double)(film->right - film->left) * (double)(film->bottom - film->top);
    for (int half = 0; half < 2; half++) schedule->brightness[half] = sum[half] / count;
}

HYI_FN void hyi_weigh_tile(hyi_schedule *schedule, const hyi_film *film, size_t tile) {
    for (size_t i = tile * film->tile_pixels; i < (tile + 1) * film->tile_pixels; i++)
        for (int half = 0; half < 2; half++) {
            double mean[3];
            hyi_half_mean(film, &film->tiles[tile], i, half, mean);
            double scale = fmax(hyi_wide_luminance(mean), HYI_DARK_SHARE * schedule->brightness[half]);
            schedule->weights[2 * i + (size_t)half] = scale > 0.0 ? (float)(1.0 / scale) : 0.0f;
        }
}

/* The tiles that this stage still owes chunks. */
HYI_FN void hyi_list_round(hyi_schedule *schedule, const hyi_film *film) {
    uint32_t target = hyi_stage_target(schedule);
    schedule->active_count = schedule->rounds_each = 0;
    for (size_t i = 0; i < hyi_film_tile_count(film); i++) {
        const hyi_tile *tile = &film->tiles[i];
        if (hyi_tile_is_done(schedule, tile) || tile->chunks >= target) continue;
        schedule->base[schedule->active_count] = tile->chunks;
        schedule->active[schedule->active_count++] = (uint32_t)i;
        if (target - tile->chunks > schedule->rounds_each) schedule->rounds_each = target - tile->chunks;
    }
    hyi_atomic_store(&schedule->next, 0);
}

HYI_FN bool hyi_all_tiles_done(const hyi_schedule *schedule, const hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++)
        if (!hyi_tile_is_done(schedule, &film->tiles[i])) return false;
    return true;
}

/* Lists the next round, moving on through the stages that owe nothing; false when every tile is done. Weights are of the
   film as the stage found it: a render that is saved in mid-stage keeps them. */
HYI_FN bool hyi_next_round(hyi_schedule *schedule, hyi_film *film) {
    for (hyi_list_round(schedule, film); !schedule->active_count; hyi_list_round(schedule, film)) {
        if (schedule->target > 0.0f) hyi_judge_tiles(schedule, film);
        if (hyi_all_tiles_done(schedule, film)) return false;
        schedule->stage++;
    }
    if (schedule->target > 0.0f && schedule->weighed_stage != schedule->stage) {
        hyi_measure_brightness(schedule, film);
        for (uint32_t i = 0; i < schedule->active_count; i++) hyi_weigh_tile(schedule, film, schedule->active[i]);
        schedule->weighed_stage = schedule->stage;
    }
    return true;
}

#endif /* HYI_ADAPTIVE_H */
