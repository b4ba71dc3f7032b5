/* >>render-statistics: standard errors of pixels, error of the picture, status

   The scatter of a pixel's samples overstates its error, because scrambled Sobol points spread out more evenly than
   random ones. The two halves of the samples are independent, so the square of their difference, over 4, is an unbiased
   estimate of the variance of their mean, but a very rough one. Both together: the scatter says how error is shared out
   among the pixels of a block, 8x8 or in a list 64x1, the halves say how much there is in all. */
#ifndef HYI_STATISTICS_H
#define HYI_STATISTICS_H

#include "render.h"

#define HYI_BLOCK_PIXELS 64u
#define HYI_PRIOR_PIXELS 2.0   /* weight of "the scatter is right" against the block's halves */
#define HYI_PRIOR_SAMPLES 4.0  /* weight of the block's mean scatter against a pixel's own */

typedef struct hyi_block_pixel {
    size_t index;
    double mean[3], half_square[3]; /* (a - b)^2 / 4 by channel */
    double luminance, luminance_half_square;
    double scatter;                 /* variance of the mean, from the samples */
} hyi_block_pixel;

typedef struct hyi_block {
    hyi_block_pixel pixels[HYI_BLOCK_PIXELS];
    uint32_t count, left, top, columns; /* the part that lies in the region */
    double scale[3], luminance_scale; /* variance of a channel, luminance = scale x smoothed scatter */
    double mean_scatter;
} hyi_block;

HYI_FN hyi_block_pixel hyi_measure_pixel(const hyi_film *film, uint32_t x, uint32_t y) {
    hyi_block_pixel p;
    p.index = hyi_pixel_index(film, x, y);
    const hyi_tile *tile = &film->tiles[hyi_pixel_tile(film, x, y)];
    const hyi_pixel *pixel = &film->pixels[p.index];
    double a[3], b[3], n = (double)tile->reported[hyi_group_of(p.index)];
    hyi_half_mean(film, tile, p.index, 0, a);
    hyi_half_mean(film, tile, p.index, 1, b);
    for (int i = 0; i < 3; i++) p.mean[i] = 0.5 * (a[i] + b[i]);
    for (int i = 0; i < 3; i++) p.half_square[i] = 0.25 * (a[i] - b[i]) * (a[i] - b[i]);
    p.luminance = hyi_wide_luminance(p.mean);
    double difference = hyi_wide_luminance(a) - hyi_wide_luminance(b);
    p.luminance_half_square = 0.25 * difference * difference;
    double sum = n * p.luminance;
    double squares = hyi_lanes_value(pixel->square, pixel->square_top);
    double variance = n > 1.0 ? fmax(squares - sum * sum / n, 0.0) / (n - 1.0) : 0.0;
    p.scatter = n > 0.0 ? variance / n : 0.0;
    return p;
}

/* Variance of a pixel in units of the block's calibration: its scatter, drawn to the block's mean while samples are few. */
HYI_FN double hyi_smoothed_scatter(const hyi_film *film, const hyi_block *block, const hyi_block_pixel *p) {
    const hyi_tile *tile = &film->tiles[p->index / film->tile_pixels];
    double n = (double)tile->reported[hyi_group_of(p->index)];
    return (n * p->scatter + HYI_PRIOR_SAMPLES * block->mean_scatter) / (n + HYI_PRIOR_SAMPLES);
}

HYI_FN double hyi_block_scale(double halves, double scatter, double count, double prior) {
    double weight = HYI_PRIOR_PIXELS / count;
    return scatter > 0.0 ? (halves + weight * prior * scatter) / (scatter + weight * scatter) : 0.0;
}

HYI_FN void hyi_calibrate_block(hyi_block *block) {
    double scatter = 0.0, luminance = 0.0, halves = 0.0, channel[3] = { 0, 0, 0 }, channel_halves[3] = { 0, 0, 0 };
    double count = (double)block->count;
    for (uint32_t i = 0; i < block->count; i++) {
        const hyi_block_pixel *p = &block->pixels[i];
        scatter += p->scatter;
        luminance += p->luminance * p->luminance;
        halves += p->luminance_half_square;
        for (int c = 0; c < 3; c++) {
            channel[c] += p->mean[c] * p->mean[c];
            channel_halves[c] += p->half_square[c];
        }
    }
    block->mean_scatter = count > 0.0 ? scatter / count : 0.0;
    block->luminance_scale = hyi_block_scale(halves, scatter, count, 1.0);
    for (int c = 0; c < 3; c++) block->scale[c] = hyi_block_scale(channel_halves[c], scatter, count, luminance > 0.0 ? channel[c] / luminance : 1.0);
}

HYI_FN uint32_t hyi_block_width(const hyi_film *film) { return film->tile_height == 1 ? HYI_BLOCK_PIXELS : 8u; }
HYI_FN uint32_t hyi_block_height(const hyi_film *film) { return HYI_BLOCK_PIXELS / hyi_block_width(film); }

/* The block of the frame that starts at (x, y), as far as it lies in the region. */
HYI_FN void hyi_measure_block(const hyi_film *film, uint32_t x, uint32_t y, hyi_block *block) {
    uint32_t x1 = x + hyi_block_width(film), y1 = y + hyi_block_height(film);
    block->left = x > film->left ? x : film->left;
    block->top = y > film->top ? y : film->top;
    block->count = 0;
    x1 = x1 < film->right ? x1 : film->right;
    y1 = y1 < film->bottom ? y1 : film->bottom;
    block->columns = x1 - block->left;
    for (uint32_t j = block->top; j < y1; j++)
        for (uint32_t i = block->left; i < x1; i++) block->pixels[block->count++] = hyi_measure_pixel(film, i, j);
    hyi_calibrate_block(block);
}

/* Calls visit for every block that meets the region, rows first. */
HYI_FN void hyi_each_block(const hyi_film *film, void (*visit)(void *argument, const hyi_film *film, const hyi_block *block), void *argument) {
    uint32_t w = hyi_block_width(film), h = hyi_block_height(film);
    for (uint32_t y = film->top - film->top % h; y < film->bottom; y += h)
        for (uint32_t x = film->left - film->left % w; x < film->right; x += w) {
            hyi_block block;
            hyi_measure_block(film, x, y, &block);
            visit(argument, film, &block);
        }
}

/* Standard error of pixel i of a block, by channel. */
HYI_FN void hyi_pixel_error(const hyi_film *film, const hyi_block *block, uint32_t i, float error[3]) {
    double scatter = hyi_smoothed_scatter(film, block, &block->pixels[i]);
    for (int c = 0; c < 3; c++) error[c] = (float)sqrt(block->scale[c] * scatter);
}

HYI_FN bool hyi_is_heavy(const hyi_film *film, size_t index) {
    const hyi_pixel *pixel = &film->pixels[index];
    const hyi_tile *tile = &film->tiles[index / film->tile_pixels];
    double n = (double)tile->reported[hyi_group_of(index)], sum = n * hyi_stored_luminance(film, index);
    return n >= 64.0 && (double)pixel->largest > 0.1 * sum && (double)pixel->largest > 20.0 * sum / n;
}

/* ---- the picture */

typedef struct hyi_error_sums {
    double brightness;
    double square;                   /* sum over pixels of variance / max(mean, L / 10)^2 */
    double cells, cell, cell_square; /* of the same from (a - b)^2 / 4 alone, summed by cell: their number, sum, sum of squares */
    double pixels;
    uint64_t heavy, dropped;
} hyi_error_sums;

/* Pixels that share their points (sampler.h) form a cell: 4x4, in a list 4x1. Cells are independent. */
HYI_FN uint32_t hyi_cell_of(const hyi_block *block, uint32_t i) {
    uint32_t x = block->left + i % block->columns, y = block->top + i / block->columns;
    return (x / 4) % 16 | ((y / 4) % 2) << 4;
}

HYI_FN void hyi_add_block_error(void *argument, const hyi_film *film, const hyi_block *block) {
    hyi_error_sums *sums = (hyi_error_sums *)argument;
    double cells[32] = { 0.0 };
    bool seen[32] = { false };
    for (uint32_t i = 0; i < block->count; i++) {
        const hyi_block_pixel *p = &block->pixels[i];
        double scale = fmax(p->luminance, HYI_DARK_SHARE * sums->brightness), weight = scale > 0.0 ? 1.0 / (scale * scale) : 0.0;
        bool scattered = block->luminance_scale > 0.0;
        sums->square += weight * (scattered ? block->luminance_scale * hyi_smoothed_scatter(film, block, p) : p->luminance_half_square);
        cells[hyi_cell_of(block, i)] += weight * p->luminance_half_square;
        seen[hyi_cell_of(block, i)] = true;
        sums->heavy += hyi_is_heavy(film, p->index) ? 1u : 0u;
        sums->dropped += film->pixels[p->index].dropped;
    }
    for (int c = 0; c < 32; c++) {
        if (!seen[c]) continue;
        sums->cells += 1.0;
        sums->cell += cells[c];
        sums->cell_square += cells[c] * cells[c];
    }
    sums->pixels += (double)block->count;
}

/* Standard deviation of the squared error's estimate. The cells' own scatter gives it, where there are many; it is never
   taken below what 4 independent normal pixels a cell would give. */
HYI_FN double hyi_error_spread(const hyi_error_sums *s, double square) {
    double least = square * sqrt(2.0 / (4.0 * s->cells));
    if (s->cells < 1.5) return least;
    double mean = s->cell / s->cells, variance = fmax(s->cell_square / s->cells - mean * mean, 0.0) / (s->cells - 1.0);
    return fmax(sqrt(variance) * s->cells / s->pixels, least);
}

/* The interval is for the real error of this picture: its square scatters about its mean as much as the estimate does.
   A film that cannot be had leaves the last report as it was; one that was lost, and is empty again, has none. */
HYI_FN void hyi_make_report(hydra_render *r) {
    double start = hyi_seconds();
    hyi_error_sums sums;
    if (hyi_sync_film(r, false) != HYDRA_OK || hyi_film_is_empty(&r->film)) return;
    memset(&sums, 0, sizeof sums);
    sums.brightness = hyi_brightness(&r->film, NULL);
    hyi_each_block(&r->film, hyi_add_block_error, &sums);
    double square = sums.square / sums.pixels, reach = 1.96 * sqrt(2.0) * hyi_error_spread(&sums, square);
    r->report.error = sqrt(square);
    r->report.low = sqrt(fmax(square - reach, 0.0));
    r->report.high = sqrt(square + reach);
    r->report.heavy_pixels = sums.heavy;
    r->report.dropped_samples = sums.dropped;
    r->report.made_at = r->seconds;
    r->report.cost = hyi_seconds() - start;
}

/* Made anew when the render is done, or when the last one's cost is under a twentieth of the time since. */
HYI_FN void hyi_refresh_report(hydra_render *r) {
    bool stale = r->report.made_at < 0.0 || (r->seconds > r->report.made_at && (r->done || r->seconds - r->report.made_at > 20.0 * r->report.cost));
    if (stale) hyi_make_report(r);
}

/* ---- status */

HYI_FN void hyi_sum_counters(const hydra_render *r, hydra_status *status) {
    for (uint32_t i = 0; i < r->workers; i++) {
        const hyi_counters *c = &r->batches[i].counters;
        status->rays_camera += c->rays_camera;
        status->rays_bounce += c->rays_bounce;
        status->rays_shadow += c->rays_shadow;
        status->paths += c->paths;
        status->seconds_generate += c->generate;
        status->seconds_intersect += c->intersect;
        status->seconds_shade += c->shade;
        status->seconds_shadow += c->shadow;
        status->seconds_accumulate += r->accumulate[i];
    }
}

/* Share of the work that a tile has behind it, if error falls with the root of the samples. */
HYI_FN double hyi_tile_fraction(const hyi_schedule *s, const hyi_tile *tile, uint32_t inside) {
    if (hyi_tile_is_done(s, tile)) return 1.0;
    double fraction = (double)tile->chunks / (double)s->total_chunks;
    if (!(s->target > 0.0f) || !tile->judged) return fraction;
    double statistic = 0.0, target = (double)s->target * (double)s->target;
    for (uint32_t g = 0; g < HYI_GROUPS; g++) statistic += hyi_sum_value(&tile->statistic[g]);
    double square = hyi_tile_error_square(s, tile, statistic, (double)inside);
    return fmax(fraction, square > target ? target / square : 0.99);
}

HYI_FN void hyi_measure_progress(const hydra_render *r, hydra_status *status) {
    const hyi_film *film = &r->film;
    double sum = 0.0, samples = 0.0, pixels = 0.0;
    size_t tiles = hyi_film_tile_count(film);
    bool first_pass = false;
    for (size_t i = 0; i < tiles; i++) {
        uint32_t groups[HYI_GROUPS], inside = hyi_count_groups(film, i, groups);
        sum += hyi_tile_fraction(&r->schedule, &film->tiles[i], inside);
        for (uint32_t g = 0; g < HYI_GROUPS; g++) samples += (double)groups[g] * (double)film->tiles[i].reported[g];
        pixels += (double)inside;
        if (film->tiles[i].chunks == 0) first_pass = true;
        if (!hyi_tile_is_done(&r->schedule, &film->tiles[i])) status->tiles_active += 1.0;
    }
    status->tiles_total = (double)tiles;
    status->samples = samples / pixels;
    status->fraction = sum / (double)tiles;
    status->stage = r->done ? HYDRA_STAGE_DONE : first_pass ? HYDRA_STAGE_FIRST_PASS : HYDRA_STAGE_REFINING;
    if (r->desc.time_budget > 0.0) status->fraction = fmax(status->fraction, fmin(r->seconds / r->desc.time_budget, 1.0));
    if (r->done) status->fraction = 1.0;
}

HYDRA_API hydra_status hydra_render_status(hydra_render *render) {
    hydra_status status;
    memset(&status, 0, sizeof status);
    if (!render) return status;
    hyi_measure_progress(render, &status);
    status.seconds = render->seconds;
    status.seconds_left = status.fraction > 0.0 ? render->seconds * (1.0 - status.fraction) / status.fraction : HUGE_VAL;
    status.error = status.error_low = status.error_high = HUGE_VAL;
    bool reports = status.stage != HYDRA_STAGE_FIRST_PASS && status.samples > 0.0;
    if (reports) hyi_refresh_report(render);
    if (reports && render->report.made_at >= 0.0) {
        status.error = render->report.error;
        status.error_low = render->report.low;
        status.error_high = render->report.high;
        status.heavy_pixels = render->report.heavy_pixels;
        status.dropped_samples = render->report.dropped_samples;
    }
    hyi_sum_counters(render, &status);
    status.bytes_film = hyi_film_bytes(&render->film) + hyi_schedule_bytes(&render->film, render->desc.target_error > 0.0f);
    status.bytes_lanes = render->workers * hyi_worker_bytes(render->scene, &render->film);
    return status;
}

#endif /* HYI_STATISTICS_H */
