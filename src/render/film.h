/* >>render-film: what is known of each pixel, and how samples come in

   Even samples of a pixel make one half of its estimate, odd ones the other. The halves never see each other's random
   numbers, so their difference tells the true error of the scrambled points (statistics.h). */
#ifndef HYI_FILM_H
#define HYI_FILM_H

#include "../backend/chunk.h"
#include "exact_sum.h"

/* 128 bytes. Sums of radiance for each half, of squared luminance for both. */
typedef struct hyi_pixel {
    hyi_lanes rgb[2][3];
    hyi_lanes square;
    int16_t rgb_top[2];
    int16_t square_top;
    uint16_t dropped; /* samples that were not finite, saturating */
    float largest;    /* luminance of the largest sample */
    uint32_t hits;    /* samples that met a surface, whether or not they count in the sums */
} hyi_pixel;
HYI_STATIC_ASSERT(sizeof(hyi_pixel) == 128);

typedef struct hyi_ids { uint32_t primitive, instance, mesh, material; } hyi_ids;

/* Optional sums, present when an output needs them. PAIR planes are split in halves like radiance; MEAN planes
   are plain sums over all samples. */
typedef enum hyi_plane {
    HYI_PLANE_DIRECT,   /* pair */
    HYI_PLANE_INDIRECT, /* pair */
    HYI_PLANE_CAUSTIC,  /* pair */
    HYI_PLANE_IRRADIANCE, /* pair */
    HYI_PLANE_ALBEDO,   /* mean, as the rest */
    HYI_PLANE_NORMAL,
    HYI_PLANE_POSITION,
    HYI_PLANE_DEPTH,    /* first component: depth; second: samples whose ray from a point met a back face */
    HYI_PLANE_COUNT
} hyi_plane;
HYI_FN bool hyi_plane_is_pair(int plane) { return plane <= HYI_PLANE_IRRADIANCE; }

/* The pixels of a tile fall into groups, 16 pixels apart in Morton order: the places of a 4x4 block (adaptive.h). */
#define HYI_GROUPS 16u
HYI_INLINE uint32_t hyi_group_of(size_t pixel) { return (uint32_t)(pixel % HYI_GROUPS); }

/* All tiles' pixels stand in one array, tile after tile. */
typedef struct hyi_tile {
    uint32_t chunks; /* taken of the schedule */
    uint32_t taken;  /* samples a pixel in them */
    uint32_t judged; /* chunks that the statistic below holds */
    uint32_t closed; /* groups that the others found good enough: a bit each */
    uint32_t reported[HYI_GROUPS]; /* samples of a pixel that are in the sums, half of them in each half */
    hyi_sum statistic[HYI_GROUPS]; /* sum over judged chunks and the group's pixels of the weighted sample variance */
    hyi_atomic lock;
} hyi_tile;
#define HYI_ALL_GROUPS ((1u << HYI_GROUPS) - 1u)

typedef struct hyi_film {
    uint32_t tile_width, tile_height, tile_pixels;
    uint32_t tiles_x, tiles_y, first_tile_x, first_tile_y;
    uint32_t left, top, right, bottom; /* of the region, in the frame */
    uint32_t first_sample;
    uint32_t planes_wanted; /* bits 1 << hyi_plane */
    bool ids_wanted;
    hyi_tile *tiles;
    hyi_pixel *pixels;
    hyi_sum3 *planes[HYI_PLANE_COUNT]; /* pairs: two a pixel, half after half */
    hyi_ids *ids;
} hyi_film;

HYI_INLINE size_t hyi_film_tile_count(const hyi_film *film) { return (size_t)film->tiles_x * film->tiles_y; }
HYI_INLINE size_t hyi_film_pixel_count(const hyi_film *film) { return hyi_film_tile_count(film) * film->tile_pixels; }
HYI_FN size_t hyi_plane_sums(const hyi_film *film, int plane) { return hyi_film_pixel_count(film) * (hyi_plane_is_pair(plane) ? 2u : 1u); }
HYI_INLINE uint32_t hyi_tile_left(const hyi_film *film, size_t tile) { return (film->first_tile_x + (uint32_t)(tile % film->tiles_x)) * film->tile_width; }
HYI_INLINE uint32_t hyi_tile_top(const hyi_film *film, size_t tile) { return (film->first_tile_y + (uint32_t)(tile / film->tiles_x)) * film->tile_height; }

/* Of a tile's pixel, in the frame. */
HYI_INLINE uint32_t hyi_pixel_left(const hyi_film *film, size_t tile, uint32_t i) {
    return hyi_tile_left(film, tile) + hyk_tile_column(film->tile_width, film->tile_width == film->tile_height, i);
}
HYI_INLINE uint32_t hyi_pixel_top(const hyi_film *film, size_t tile, uint32_t i) {
    return hyi_tile_top(film, tile) + hyk_tile_row(film->tile_width, film->tile_width == film->tile_height, i);
}

/* ---- layout and memory */

HYI_FN uint32_t hyi_power_of_two_from(uint32_t x) {
    uint32_t p = 1;
    while (p < x && p < 0x80000000u) p *= 2;
    return p;
}

/* Tiles keep their area where the frame is narrow or low: they are then long, so that lists fill their lanes. */
HYI_FN void hyi_shape_tiles(hyi_film *film, uint32_t tile_size, uint32_t width, uint32_t height) {
    uint32_t area = tile_size * tile_size, w = hyi_power_of_two_from(width), h = hyi_power_of_two_from(height);
    film->tile_height = h < tile_size ? h : tile_size;
    film->tile_width = w < area / film->tile_height ? w : area / film->tile_height;
    film->tile_height = h < area / film->tile_width ? h : area / film->tile_width;
    film->tile_pixels = film->tile_width * film->tile_height;
}

HYI_FN void hyi_plan_film(hyi_film *film, uint32_t tile_size, uint32_t width, uint32_t height, const uint32_t region[4]) {
    memset(film, 0, sizeof *film);
    hyi_shape_tiles(film, tile_size, width, height);
    bool whole = !region[2] && !region[3];
    film->left = whole ? 0 : region[0];
    film->top = whole ? 0 : region[1];
    film->right = whole ? width : region[0] + region[2];
    film->bottom = whole ? height : region[1] + region[3];
    film->first_tile_x = film->left / film->tile_width;
    film->first_tile_y = film->top / film->tile_height;
    film->tiles_x = (film->right - 1) / film->tile_width - film->first_tile_x + 1;
    film->tiles_y = (film->bottom - 1) / film->tile_height - film->first_tile_y + 1;
}

HYI_FN size_t hyi_film_bytes(const hyi_film *film) {
    size_t bytes = hyi_film_tile_count(film) * sizeof(hyi_tile) + hyi_film_pixel_count(film) * sizeof(hyi_pixel);
    for (int p = 0; p < HYI_PLANE_COUNT; p++)
        if (film->planes_wanted >> p & 1u) bytes += hyi_plane_sums(film, p) * sizeof(hyi_sum3);
    if (film->ids_wanted) bytes += hyi_film_pixel_count(film) * sizeof(hyi_ids);
    return bytes;
}

HYI_FN void hyi_film_free(hydra_context *context, hyi_film *film) {
    hyi_free_array(context, &film->tiles, hyi_film_tile_count(film));
    hyi_free_array(context, &film->pixels, hyi_film_pixel_count(film));
    for (int p = 0; p < HYI_PLANE_COUNT; p++) hyi_free_array(context, &film->planes[p], hyi_plane_sums(film, p));
    hyi_free_array(context, &film->ids, hyi_film_pixel_count(film));
}

HYI_FN hydra_result hyi_film_alloc_parts(hydra_context *context, hyi_film *film) {
    size_t pixels = hyi_film_pixel_count(film);
    HYI_TRY(hyi_alloc_array(context, &film->tiles, hyi_film_tile_count(film)));
    HYI_TRY(hyi_alloc_array(context, &film->pixels, pixels));
    memset(film->tiles, 0, hyi_film_tile_count(film) * sizeof *film->tiles);
    memset(film->pixels, 0, pixels * sizeof *film->pixels);
    for (int p = 0; p < HYI_PLANE_COUNT; p++) {
        if (!(film->planes_wanted >> p & 1u)) continue;
        HYI_TRY(hyi_alloc_array(context, &film->planes[p], hyi_plane_sums(film, p)));
        memset(film->planes[p], 0, hyi_plane_sums(film, p) * sizeof *film->planes[p]);
    }
    if (!film->ids_wanted) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &film->ids, pixels));
    memset(film->ids, 0, pixels * sizeof *film->ids);
    for (size_t i = 0; i < pixels; i++) film->ids[i].primitive = HYDRA_NONE;
    return HYDRA_OK;
}

HYI_FN bool hyi_film_is_empty(const hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++)
        if (film->tiles[i].taken) return false;
    return true;
}

/* film is planned. On failure nothing stays allocated. */
HYI_FN hydra_result hyi_film_alloc(hydra_context *context, hyi_film *film) {
    hydra_result result = hyi_film_alloc_parts(context, film);
    if (result != HYDRA_OK) hyi_film_free(context, film);
    return result;
}

/* Where pixel (x, y) of the frame is stored; it must be inside the region. */
HYI_FN size_t hyi_pixel_tile(const hyi_film *film, uint32_t x, uint32_t y) {
    return (size_t)(y / film->tile_height - film->first_tile_y) * film->tiles_x + (x / film->tile_width - film->first_tile_x);
}
HYI_FN size_t hyi_pixel_index(const hyi_film *film, uint32_t x, uint32_t y) {
    uint32_t lx = x % film->tile_width, ly = y % film->tile_height;
    uint32_t local = film->tile_width == film->tile_height ? hyk_morton(lx, ly) : ly * film->tile_width + lx;
    return hyi_pixel_tile(film, x, y) * film->tile_pixels + local;
}

/* ---- samples coming in */

HYI_INLINE void hyi_lane_radiance(const hyi_lane *lane, float rgb[3]) {
    hyk_vec3 sum = hyk_add(lane->part[0], hyk_add(lane->part[1], lane->part[2]));
    rgb[0] = sum.x;
    rgb[1] = sum.y;
    rgb[2] = sum.z;
}

HYI_INLINE float hyi_luminance(const float c[3]) { return 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2]; }

/* Whether all that the lane brings is finite: bits, so that fast-math does not assume it away. */
HYI_FN bool hyi_lane_is_finite(const hyi_lane *lane) {
    const float *numbers = &lane->part[0].x;
    for (size_t i = 0; i < 12; i++) { /* three parts and the irradiance stand in a row */
        uint32_t bits;
        memcpy(&bits, numbers + i, sizeof bits);
        if ((bits & 0x7f800000u) == 0x7f800000u) return false;
    }
    return true;
}
HYI_STATIC_ASSERT(offsetof(hyi_lane, irradiance) == 36);

HYI_INLINE void hyi_plane_add(const hyi_film *film, int plane, size_t at, hyk_vec3 v) {
    const float terms[3] = { v.x, v.y, v.z };
    if (film->planes[plane]) hyi_sum3_add(&film->planes[plane][at], terms);
}

HYI_FN void hyi_add_means(hyi_film *film, size_t pixel, const hyi_lane *lane) {
    hyk_first_surface first = lane->first;
    if (lane->flags & HYK_LANE_INSIDE) hyi_plane_add(film, HYI_PLANE_DEPTH, pixel, hyk_make3(0.0f, 1.0f, 0.0f));
    if (!(lane->flags & HYK_LANE_HIT)) return;
    hyi_plane_add(film, HYI_PLANE_ALBEDO, pixel, first.albedo);
    hyi_plane_add(film, HYI_PLANE_NORMAL, pixel, first.normal);
    hyi_plane_add(film, HYI_PLANE_POSITION, pixel, first.position);
    hyi_plane_add(film, HYI_PLANE_DEPTH, pixel, hyk_make3(first.depth, 0.0f, 0.0f));
}

/* The part of the picture that only counts while the pixel's group is open. */
HYI_FN void hyi_add_radiance(hyi_film *film, size_t index, int half, const hyi_lane *lane, const float rgb[3], float luminance) {
    hyi_pixel *pixel = &film->pixels[index];
    const double wide[3] = { (double)rgb[0], (double)rgb[1], (double)rgb[2] };
    double square = (double)luminance * (double)luminance;
    hyi_sums_add(pixel->rgb[half], &pixel->rgb_top[half], wide, 3);
    hyi_sums_add(&pixel->square, &pixel->square_top, &square, 1);
    if (luminance > pixel->largest) pixel->largest = luminance;
    for (int part = 0; part < 3; part++) hyi_plane_add(film, HYI_PLANE_DIRECT + part, 2 * index + (size_t)half, lane->part[part]);
    hyi_plane_add(film, HYI_PLANE_IRRADIANCE, 2 * index + (size_t)half, lane->irradiance);
}
HYI_STATIC_ASSERT(HYK_COMPONENT_DIRECT == HYI_PLANE_DIRECT && HYK_COMPONENT_INDIRECT == HYI_PLANE_INDIRECT && HYK_COMPONENT_CAUSTIC == HYI_PLANE_CAUSTIC);

/* Takes a sample; returns its luminance, 0 for one that is not finite. */
HYI_FN float hyi_film_add(hyi_film *film, size_t index, int half, bool open, hyi_lane *lane) {
    hyi_pixel *pixel = &film->pixels[index];
    if (!hyi_lane_is_finite(lane)) {
        for (int part = 0; part < 3; part++) lane->part[part] = hyk_zero3();
        lane->irradiance = hyk_zero3();
        if (pixel->dropped < UINT16_MAX) pixel->dropped++;
    }
    float rgb[3];
    hyi_lane_radiance(lane, rgb);
    float luminance = hyi_luminance(rgb);
    if (open) hyi_add_radiance(film, index, half, lane, rgb, luminance);
    if (lane->flags & HYK_LANE_HIT) pixel->hits++;
    hyi_add_means(film, index, lane);
    return luminance;
}

/* ---- values */

HYI_FN void hyi_half_mean(const hyi_film *film, const hyi_tile *tile, size_t index, int half, double mean[3]) {
    const hyi_pixel *pixel = &film->pixels[index];
    uint32_t reported = tile->reported[hyi_group_of(index)];
    double n = reported ? 0.5 * (double)reported : 1.0;
    for (int i = 0; i < 3; i++) mean[i] = hyi_lanes_value(pixel->rgb[half][i], pixel->rgb_top[half]) / n;
}

HYI_FN double hyi_wide_luminance(const double c[3]) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }

HYI_FN void hyi_pixel_mean(const hyi_film *film, const hyi_tile *tile, size_t index, double mean[3]) {
    double a[3], b[3];
    hyi_half_mean(film, tile, index, 0, a);
    hyi_half_mean(film, tile, index, 1, b);
    for (int i = 0; i < 3; i++) mean[i] = 0.5 * (a[i] + b[i]);
}

#endif /* HYI_FILM_H */
