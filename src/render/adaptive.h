/* >>render-adaptive: which tile gets how many samples

   HYDRA's tiles (ALGORITHMS section 3) with a stopping rule that does not bias the picture. Stopping when one's own
   samples look good favours samples that missed something (Kirk & Arvo 1991). So a pixel never decides for itself: the pixels of a tile
   form 16 groups, each spread evenly over the tile, and a group stops counting its samples when the error that the
   *other* groups show is small enough. How many of a pixel's samples count is then independent of what they say, and
   its mean and its error bar stay unbiased. Any two groups' judges share most of their evidence, so all groups of a
   tile stop at nearly the same stage; until the last one does, all go on sampling to be evidence for it.
   (Two halves of each pixel's samples that judge each other are unbiased as well; with nothing in common they disagree
   more often, and more samples are evidence only: bench-trade prints samples counted and traced.)

   Error of a tile, from a set of its pixels: sqrt(mean over them of w v / n), v a pixel's sample variance of luminance
   (within chunks, pooled), n its samples, w = 1 / max(mean, L / 10)^2 with L the picture's mean luminance. A tile is
   also charged with one sample of luminance L that it has not seen: a black tile must be sampled until that would not
   matter. A pixel that is alone in its tile has no others, and judges itself. */
#ifndef HYI_ADAPTIVE_H
#define HYI_ADAPTIVE_H

#include "film.h"

#define HYI_CHUNK_SAMPLES 8u  /* of a pixel, half of them for each half */
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
    float *weights;       /* of each pixel, where there is a target */
    double brightness;    /* L at the start of the stage */
} hyi_schedule;

HYI_FN bool hyi_tile_is_done(const hyi_schedule *schedule, const hyi_tile *tile) {
    return tile->chunks >= schedule->total_chunks || tile->closed == HYI_ALL_GROUPS;
}

HYI_FN uint32_t hyi_stage_target(const hyi_schedule *schedule) {
    uint32_t target = hyi_stage_chunks(schedule->stage);
    return target < schedule->total_chunks ? target : schedule->total_chunks;
}

/* ---- what a chunk says about the error */

/* From the sum of squared differences from the mean. */
HYI_FN double hyi_variance_of(double scatter, uint32_t samples) {
    double variance = scatter / (double)(samples - 1);
    return variance > 0.0 ? variance : 0.0;
}

/* Sample variance of one pixel within a chunk, from both halves; each is a net of its own. */
HYI_FN double hyi_chunk_variance(const float *luminance, uint32_t samples) {
    double sum = 0.0, squares = 0.0;
    for (uint32_t s = 0; s < samples; s++) {
        sum += (double)luminance[s];
        squares += (double)luminance[s] * (double)luminance[s];
    }
    return hyi_variance_of(squares - sum * sum / (double)samples, samples);
}

/* ---- verdicts */

/* Pixels of each group that lie in the region; returns how many in all. */
HYI_FN uint32_t hyi_count_groups(const hyi_film *film, size_t tile, uint32_t counts[HYI_GROUPS]) {
    uint32_t all = 0;
    memset(counts, 0, HYI_GROUPS * sizeof *counts);
    for (uint32_t i = 0; i < film->tile_pixels; i++) {
        uint32_t x = hyi_pixel_left(film, tile, i), y = hyi_pixel_top(film, tile, i);
        if (x < film->left || x >= film->right || y < film->top || y >= film->bottom) continue;
        counts[hyi_group_of(i)]++;
        all++;
    }
    return all;
}

/* Squared error of a tile, from statistic over count of its pixels. */
HYI_FN double hyi_tile_error_square(const hyi_schedule *schedule, const hyi_tile *tile, double statistic, double count) {
    double n = (double)tile->taken, variance = statistic / ((double)tile->judged * count);
    double unseen = schedule->brightness > 0.0 ? 1.0 / (HYI_DARK_SHARE * HYI_DARK_SHARE * n * count) : 0.0;
    return (variance + unseen) / n;
}

/* Closes each group that all others find good enough. */
HYI_FN void hyi_judge_tile(const hyi_schedule *schedule, const hyi_film *film, hyi_tile *tile, size_t index) {
    uint32_t counts[HYI_GROUPS], all = hyi_count_groups(film, index, counts);
    double target = (double)schedule->target * (double)schedule->target;
    if (tile->judged == 0) return;
    for (uint32_t g = 0; g < HYI_GROUPS; g++) {
        bool alone = counts[g] == all;
        double statistic = 0.0;
        for (uint32_t other = 0; other < HYI_GROUPS; other++)
            if (other != g || alone) statistic += hyi_sum_value(&tile->statistic[other]);
        double count = (double)(alone ? all : all - counts[g]);
        if (counts[g] == 0 || hyi_tile_error_square(schedule, tile, statistic, count) <= target) tile->closed |= 1u << g;
    }
}

/* ---- between stages */

/* Verdicts of a finished stage. */
HYI_FN void hyi_judge_tiles(const hyi_schedule *schedule, hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++) {
        hyi_tile *tile = &film->tiles[i];
        if (tile->chunks >= HYI_LEAST_CHUNKS && tile->chunks == hyi_stage_target(schedule)) hyi_judge_tile(schedule, film, tile, i);
    }
}

HYI_FN double hyi_stored_luminance(const hyi_film *film, size_t index) {
    double mean[3];
    hyi_pixel_mean(film, &film->tiles[index / film->tile_pixels], index, mean);
    return hyi_wide_luminance(mean);
}

/* luminance: of each pixel, where that is known from elsewhere, or NULL. */
HYI_FN double hyi_known_luminance(const hyi_film *film, const double *luminance, size_t index) {
    return luminance ? luminance[index] : hyi_stored_luminance(film, index);
}

/* Pixels beyond the region hold zeros and add nothing. */
HYI_FN double hyi_brightness(const hyi_film *film, const double *luminance) {
    double sum = 0.0;
    for (size_t i = 0; i < hyi_film_pixel_count(film); i++) sum += hyi_known_luminance(film, luminance, i);
    return sum / ((double)(film->right - film->left) * (double)(film->bottom - film->top));
}

HYI_FN void hyi_weigh_tile(hyi_schedule *schedule, const hyi_film *film, const double *luminance, size_t tile) {
    for (size_t i = tile * film->tile_pixels; i < (tile + 1) * film->tile_pixels; i++) {
        double scale = fmax(hyi_known_luminance(film, luminance, i), HYI_DARK_SHARE * schedule->brightness);
        schedule->weights[i] = scale > 0.0 ? (float)(1.0 / scale) : 0.0f;
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

/* Lists the next round, moving on through the stages that owe nothing; false when every tile is done. */
HYI_FN bool hyi_next_round(hyi_schedule *schedule, hyi_film *film) {
    for (hyi_list_round(schedule, film); !schedule->active_count; hyi_list_round(schedule, film)) {
        if (schedule->target > 0.0f) hyi_judge_tiles(schedule, film);
        if (hyi_all_tiles_done(schedule, film)) return false;
        schedule->stage++;
    }
    return true;
}

HYI_FN bool hyi_lacks_weights(const hyi_schedule *schedule) { return schedule->target > 0.0f && schedule->weighed_stage != schedule->stage; }

/* Weights are of the film as the stage found it: a render that is saved in mid-stage keeps them. */
HYI_FN void hyi_weigh_round(hyi_schedule *schedule, const hyi_film *film, const double *luminance) {
    schedule->brightness = hyi_brightness(film, luminance);
    for (uint32_t i = 0; i < schedule->active_count; i++) hyi_weigh_tile(schedule, film, luminance, schedule->active[i]);
    schedule->weighed_stage = schedule->stage;
}

#endif /* HYI_ADAPTIVE_H */
