/* >>render-share: films saved, resumed and added up

   A saved film is a header, a checksum and the film's state, little-endian, the same bytes on every machine. Reading and
   writing are one description of the format, walked with a stream that does either. */
#ifndef HYI_SHARE_H
#define HYI_SHARE_H

#include "statistics.h"

#define HYI_FILM_MAGIC 0x46524459u /* YDRF */
#define HYI_FILM_VERSION 1u

/* Walks bytes: writing, reading, or (no bytes) only counting. */
typedef struct hyi_stream {
    unsigned char *out;
    const unsigned char *in;
    size_t at, size;
    bool overrun;
} hyi_stream;

HYI_FN void hyi_stream_bytes(hyi_stream *s, uint64_t *value, size_t count) {
    size_t at = s->at;
    s->at += count;
    if (!s->out && !s->in) return;
    if (count > s->size || at > s->size - count) {
        s->overrun = true;
        return;
    }
    if (s->in) *value = 0;
    for (size_t i = 0; i < count; i++) {
        if (s->out) s->out[at + i] = (unsigned char)(*value >> (8 * i));
        else *value |= (uint64_t)s->in[at + i] << (8 * i);
    }
}

HYI_FN void hyi_stream_u16(hyi_stream *s, uint16_t *x) { uint64_t wide = *x; hyi_stream_bytes(s, &wide, 2); *x = (uint16_t)wide; }
HYI_FN void hyi_stream_u32(hyi_stream *s, uint32_t *x) { uint64_t wide = *x; hyi_stream_bytes(s, &wide, 4); *x = (uint32_t)wide; }
HYI_FN void hyi_stream_u64(hyi_stream *s, uint64_t *x) { hyi_stream_bytes(s, x, 8); }
HYI_FN void hyi_stream_i16(hyi_stream *s, int16_t *x) { uint16_t u = (uint16_t)*x; hyi_stream_u16(s, &u); *x = (int16_t)u; }
HYI_FN void hyi_stream_i64(hyi_stream *s, int64_t *x) { uint64_t u = (uint64_t)*x; hyi_stream_u64(s, &u); *x = (int64_t)u; }
HYI_FN void hyi_stream_float(hyi_stream *s, float *x) { uint32_t u; memcpy(&u, x, sizeof u); hyi_stream_u32(s, &u); memcpy(x, &u, sizeof u); }
HYI_FN void hyi_stream_double(hyi_stream *s, double *x) { uint64_t u; memcpy(&u, x, sizeof u); hyi_stream_u64(s, &u); memcpy(x, &u, sizeof u); }
HYI_FN void hyi_stream_lanes(hyi_stream *s, hyi_lanes *x) { hyi_stream_i64(s, &x->high); hyi_stream_i64(s, &x->low); }

/* ---- the format */

typedef struct hyi_film_header {
    uint32_t magic, version;
    uint64_t checksum;    /* of all that follows */
    uint64_t fingerprint; /* of scene, sensor and settings */
    uint32_t region[4];   /* left, top, right, bottom */
    uint32_t first_sample, end_sample;
    uint32_t range_count, stage, weighed_stage;
    double brightness;
} hyi_film_header;

HYI_FN void hyi_stream_header(hyi_stream *s, hyi_film_header *h) {
    hyi_stream_u32(s, &h->magic);
    hyi_stream_u32(s, &h->version);
    hyi_stream_u64(s, &h->checksum);
    hyi_stream_u64(s, &h->fingerprint);
    for (int i = 0; i < 4; i++) hyi_stream_u32(s, &h->region[i]);
    hyi_stream_u32(s, &h->first_sample);
    hyi_stream_u32(s, &h->end_sample);
    hyi_stream_u32(s, &h->range_count);
    hyi_stream_u32(s, &h->stage);
    hyi_stream_u32(s, &h->weighed_stage);
    hyi_stream_double(s, &h->brightness);
}
#define HYI_CHECKSUM_FROM 16u

HYI_FN void hyi_stream_tile(hyi_stream *s, hyi_tile *t) {
    hyi_stream_u32(s, &t->chunks);
    hyi_stream_u32(s, &t->taken);
    hyi_stream_u32(s, &t->judged);
    hyi_stream_u32(s, &t->closed);
    for (uint32_t g = 0; g < HYI_GROUPS; g++) {
        hyi_stream_u32(s, &t->reported[g]);
        hyi_stream_lanes(s, &t->statistic[g].lanes);
        hyi_stream_i16(s, &t->statistic[g].top);
    }
}

HYI_FN void hyi_stream_sum3(hyi_stream *s, hyi_sum3 *x) {
    for (int c = 0; c < 3; c++) hyi_stream_lanes(s, &x->lanes[c]);
    hyi_stream_i16(s, &x->top);
}

HYI_FN void hyi_stream_pixel(hyi_stream *s, hyi_pixel *p) {
    for (int h = 0; h < 2; h++) {
        for (int c = 0; c < 3; c++) hyi_stream_lanes(s, &p->rgb[h][c]);
        hyi_stream_i16(s, &p->rgb_top[h]);
    }
    hyi_stream_lanes(s, &p->square);
    hyi_stream_i16(s, &p->square_top);
    hyi_stream_u16(s, &p->dropped);
    hyi_stream_float(s, &p->largest);
    hyi_stream_u32(s, &p->hits);
}

HYI_FN void hyi_stream_ids(hyi_stream *s, hyi_ids *ids) {
    hyi_stream_u32(s, &ids->primitive);
    hyi_stream_u32(s, &ids->instance);
    hyi_stream_u32(s, &ids->mesh);
    hyi_stream_u32(s, &ids->material);
}

/* Everything the film knows of one pixel, with its sampling weights where there is a target. */
typedef struct hyi_pixel_state {
    hyi_pixel pixel;
    hyi_sum3 planes[2 * HYI_PLANE_COUNT];
    hyi_ids ids;
    float weight;
} hyi_pixel_state;

HYI_FN void hyi_stream_pixel_state(hyi_stream *s, const hydra_render *r, hyi_pixel_state *p) {
    hyi_stream_pixel(s, &p->pixel);
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        hyi_stream_sum3(s, &p->planes[2 * plane]);
        if (hyi_plane_is_pair(plane)) hyi_stream_sum3(s, &p->planes[2 * plane + 1]);
    }
    if (r->film.ids) hyi_stream_ids(s, &p->ids);
    if (r->schedule.weights) hyi_stream_float(s, &p->weight);
}

HYI_FN hyi_pixel_state hyi_load_pixel_state(const hydra_render *r, size_t index) {
    hyi_pixel_state p;
    memset(&p, 0, sizeof p);
    p.pixel = r->film.pixels[index];
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        size_t each = hyi_plane_is_pair(plane) ? 2 : 1;
        for (size_t h = 0; h < each; h++) p.planes[2 * (size_t)plane + h] = r->film.planes[plane][each * index + h];
    }
    if (r->film.ids) p.ids = r->film.ids[index];
    if (r->schedule.weights) p.weight = r->schedule.weights[index];
    return p;
}

/* ---- what a film belongs to */

HYI_FN uint64_t hyi_mix(uint64_t hash, const void *data, size_t size) {
    const unsigned char *bytes = (const unsigned char *)data; /* FNV-1a; eight bytes at a time where they are there */
    for (; size >= 8; size -= 8, bytes += 8) {
        uint64_t word = 0;
        for (int i = 0; i < 8; i++) word |= (uint64_t)bytes[i] << (8 * i);
        hash = (hash ^ word) * 0x100000001b3u;
        hash ^= hash >> 29;
    }
    for (size_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

HYI_FN uint64_t hyi_mix_geometry(uint64_t hash, const hydra_scene *scene) {
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        hash = hyi_mix(hash, mesh->positions, (size_t)mesh->vertex_count * 3 * sizeof(float));
        hash = hyi_mix(hash, mesh->indices, (size_t)mesh->triangle_count * 3 * sizeof(uint32_t));
        if (mesh->normals) hash = hyi_mix(hash, mesh->normals, (size_t)mesh->vertex_count * 3 * sizeof(float));
        if (mesh->uvs) hash = hyi_mix(hash, mesh->uvs, (size_t)mesh->vertex_count * 2 * sizeof(float));
        if (mesh->triangle_materials) hash = hyi_mix(hash, mesh->triangle_materials, (size_t)mesh->triangle_count * sizeof(uint32_t));
    }
    for (size_t i = 0; i < scene->texture_count; i++) hash = hyi_mix(hash, scene->textures[i].texels, scene->textures[i].words * sizeof(uint32_t));
    if (scene->environment_texels) hash = hyi_mix(hash, scene->environment_texels, hyi_environment_texel_count(scene) * sizeof(float));
    for (size_t i = 0; i < scene->placed_count; i++) hash = hyi_mix(hash, &scene->placed[i], sizeof scene->placed[i]);
    hash = hyi_mix(hash, scene->view_materials, scene->view_material_count * sizeof *scene->view_materials);
    hash = hyi_mix(hash, scene->all_lights, scene->all_light_count * sizeof *scene->all_lights);
    return hyi_mix(hash, &scene->view.constants, sizeof scene->view.constants);
}

HYI_FN uint64_t hyi_fingerprint(const hydra_render *r) {
    uint64_t hash = hyi_mix_geometry(0xcbf29ce484222325u, r->scene);
    const hydra_render_desc *d = &r->desc;
    uint32_t words[9] = { d->width, d->height, r->film.tile_width, r->film.tile_height, d->seed, d->max_depth, (uint32_t)d->strategy,
                          r->film.planes_wanted, r->film.ids_wanted ? 1u : 0u };
    hash = hyi_mix(hash, words, sizeof words);
    hash = hyi_mix(hash, &d->target_error, sizeof d->target_error);
    hash = hyi_mix(hash, &r->picture.kernel.camera, sizeof r->picture.kernel.camera);
    hash = hyi_mix(hash, r->sensor.positions, r->sensor.positions ? 3 * r->sensor.count * sizeof(float) : 0);
    hash = hyi_mix(hash, r->sensor.normals, r->sensor.normals ? 3 * r->sensor.count * sizeof(float) : 0);
    return hyi_mix(hash, r->sensor.rays, r->sensor.rays ? r->sensor.count * sizeof(hydra_ray) : 0);
}

/* ---- save */

HYI_FN hyi_film_header hyi_describe_film(const hydra_render *r) {
    hyi_film_header h;
    memset(&h, 0, sizeof h);
    h.magic = HYI_FILM_MAGIC;
    h.version = HYI_FILM_VERSION;
    h.fingerprint = hyi_fingerprint(r);
    h.region[0] = r->film.left;
    h.region[1] = r->film.top;
    h.region[2] = r->film.right;
    h.region[3] = r->film.bottom;
    h.first_sample = r->film.first_sample;
    h.end_sample = r->desc.max_samples;
    h.range_count = r->range_count;
    h.stage = r->schedule.stage;
    h.weighed_stage = r->schedule.weighed_stage;
    h.brightness = r->schedule.brightness;
    return h;
}

HYI_FN void hyi_stream_ranges(hyi_stream *s, hyi_sample_range *ranges, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_stream_u32(s, &ranges[i].first);
        hyi_stream_u32(s, &ranges[i].end);
    }
}

HYI_FN size_t hyi_pixel_state_bytes(const hydra_render *r) {
    hyi_stream counter;
    hyi_pixel_state state;
    memset(&counter, 0, sizeof counter);
    memset(&state, 0, sizeof state);
    hyi_stream_pixel_state(&counter, r, &state);
    return counter.at;
}

HYI_FN size_t hyi_saved_bytes(const hydra_render *r, uint32_t ranges, size_t tiles, size_t pixels) {
    hyi_stream counter;
    hyi_film_header header;
    hyi_tile tile;
    memset(&counter, 0, sizeof counter);
    memset(&header, 0, sizeof header);
    memset(&tile, 0, sizeof tile);
    hyi_stream_tile(&counter, &tile);
    size_t tile_bytes = counter.at;
    hyi_stream_header(&counter, &header);
    return counter.at - tile_bytes + 8 * (size_t)ranges + tiles * tile_bytes + pixels * hyi_pixel_state_bytes(r);
}

HYDRA_API hydra_result hydra_render_save(const hydra_render *render, void *buffer, size_t *size) {
    if (!render) return HYDRA_ERROR_NULL;
    if (!size) return hyi_fail(render->context, HYDRA_ERROR_NULL, "size");
    size_t tiles = hyi_film_tile_count(&render->film), pixels = hyi_film_pixel_count(&render->film);
    size_t need = hyi_saved_bytes(render, render->range_count, tiles, pixels), room = *size;
    *size = need;
    if (!buffer) return HYDRA_OK;
    if (room < need) return hyi_fail(render->context, HYDRA_ERROR_BUFFER, "%zu bytes for a film of %zu", room, need);
    HYI_TRY(hyi_sync_film(render, false));
    hyi_stream s;
    memset(&s, 0, sizeof s);
    s.out = (unsigned char *)buffer;
    s.size = need;
    hyi_film_header header = hyi_describe_film(render);
    hyi_sample_range ranges[HYI_MAX_RANGES];
    memcpy(ranges, render->ranges, sizeof ranges);
    hyi_stream_header(&s, &header);
    hyi_stream_ranges(&s, ranges, render->range_count);
    for (size_t i = 0; i < tiles; i++) {
        hyi_tile tile = render->film.tiles[i];
        hyi_stream_tile(&s, &tile);
    }
    for (size_t i = 0; i < pixels; i++) {
        hyi_pixel_state state = hyi_load_pixel_state(render, i);
        hyi_stream_pixel_state(&s, render, &state);
    }
    header.checksum = hyi_mix(0xcbf29ce484222325u, s.out + HYI_CHECKSUM_FROM, need - HYI_CHECKSUM_FROM);
    s.at = 0;
    hyi_stream_header(&s, &header);
    return HYDRA_OK;
}

/* ---- merge: first everything is checked, then taken over */

typedef struct hyi_incoming {
    hyi_film_header header;
    hyi_sample_range ranges[HYI_MAX_RANGES];
    hyi_film layout;    /* planned as the film was, nothing allocated */
    size_t tiles_at, pixels_at, tile_bytes, pixel_bytes;
    const unsigned char *data;
    size_t size;
    bool by_samples;    /* adds samples to tiles that have some; else brings tiles that are empty here */
} hyi_incoming;

HYI_FN hyi_stream hyi_reader(const hyi_incoming *in, size_t at) {
    hyi_stream s;
    memset(&s, 0, sizeof s);
    s.in = in->data;
    s.size = in->size;
    s.at = at;
    return s;
}

HYI_FN hyi_tile hyi_incoming_tile(const hyi_incoming *in, size_t tile) {
    hyi_tile t;
    memset(&t, 0, sizeof t);
    hyi_stream s = hyi_reader(in, in->tiles_at + tile * in->tile_bytes);
    hyi_stream_tile(&s, &t);
    return t;
}

HYI_FN hydra_result hyi_open_film(hydra_render *r, const void *film, size_t size, hyi_incoming *in) {
    memset(in, 0, sizeof *in);
    in->data = (const unsigned char *)film;
    in->size = size;
    hyi_stream s = hyi_reader(in, 0);
    hyi_stream_header(&s, &in->header);
    const hyi_film_header *h = &in->header;
    if (s.overrun || h->magic != HYI_FILM_MAGIC || h->version != HYI_FILM_VERSION || h->range_count > HYI_MAX_RANGES)
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "no film, or of another version");
    if (h->checksum != hyi_mix(0xcbf29ce484222325u, in->data + HYI_CHECKSUM_FROM, size - HYI_CHECKSUM_FROM))
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "the checksum does not fit");
    if (h->fingerprint != hyi_fingerprint(r)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "made from something else");
    if (h->region[0] >= h->region[2] || h->region[1] >= h->region[3] || h->region[2] > r->desc.width || h->region[3] > r->desc.height)
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "its region is impossible");
    const uint32_t region[4] = { h->region[0], h->region[1], h->region[2] - h->region[0], h->region[3] - h->region[1] };
    hyi_plan_film(&in->layout, r->desc.tile_size, r->desc.width, r->desc.height, region);
    size_t tiles = hyi_film_tile_count(&in->layout), pixels = hyi_film_pixel_count(&in->layout);
    hyi_stream_ranges(&s, in->ranges, h->range_count);
    in->tiles_at = s.at;
    in->pixel_bytes = hyi_pixel_state_bytes(r);
    if (size != hyi_saved_bytes(r, h->range_count, tiles, pixels)) return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "%zu bytes", size);
    in->pixels_at = size - pixels * in->pixel_bytes;
    in->tile_bytes = (in->pixels_at - in->tiles_at) / tiles;
    return HYDRA_OK;
}

/* The tile here that covers the same pixels as an incoming tile; false: there is none. */
HYI_FN bool hyi_matching_tile(const hyi_film *mine, const hyi_film *theirs, size_t tile, size_t *match) {
    uint32_t x = hyi_tile_left(theirs, tile), y = hyi_tile_top(theirs, tile);
    uint32_t tx = x / mine->tile_width, ty = y / mine->tile_height;
    if (tx < mine->first_tile_x || ty < mine->first_tile_y || tx - mine->first_tile_x >= mine->tiles_x || ty - mine->first_tile_y >= mine->tiles_y) return false;
    *match = (size_t)(ty - mine->first_tile_y) * mine->tiles_x + (tx - mine->first_tile_x);
    uint32_t x1 = x + mine->tile_width, y1 = y + mine->tile_height;
    bool left = (mine->left > x ? mine->left : x) == (theirs->left > x ? theirs->left : x);
    bool top = (mine->top > y ? mine->top : y) == (theirs->top > y ? theirs->top : y);
    bool right = (mine->right < x1 ? mine->right : x1) == (theirs->right < x1 ? theirs->right : x1);
    bool bottom = (mine->bottom < y1 ? mine->bottom : y1) == (theirs->bottom < y1 ? theirs->bottom : y1);
    return left && top && right && bottom;
}

HYI_FN bool hyi_ranges_meet(uint32_t first_a, uint32_t end_a, uint32_t first_b, uint32_t end_b) { return first_a < end_b && first_b < end_a; }

/* Whether [first, end) meets any samples that this render has, or will make itself. */
HYI_FN bool hyi_has_samples_of(const hydra_render *r, uint32_t first, uint32_t end) {
    if (hyi_ranges_meet(first, end, r->desc.first_sample, r->desc.max_samples)) return true;
    for (uint32_t i = 0; i < r->range_count; i++)
        if (hyi_ranges_meet(first, end, r->ranges[i].first, r->ranges[i].end)) return true;
    return false;
}

/* Sample shares must be complete, disjoint and without a target: then adding them is all there is to do. */
HYI_FN hydra_result hyi_check_sample_share(hydra_render *r, const hyi_incoming *in) {
    const hyi_film_header *h = &in->header;
    if (r->desc.target_error > 0.0f) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "with a target error, shares must be of different tiles");
    bool meet = hyi_has_samples_of(r, h->first_sample, h->end_sample);
    for (uint32_t i = 0; i < h->range_count; i++) meet = meet || hyi_has_samples_of(r, in->ranges[i].first, in->ranges[i].end);
    if (meet) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "samples %u to %u", h->first_sample, h->end_sample);
    if (r->range_count + h->range_count + 1 > HYI_MAX_RANGES) return hyi_fail(r->context, HYDRA_ERROR_COUNT, "more than %d shares", HYI_MAX_RANGES);
    uint32_t whole = (h->end_sample - h->first_sample + HYI_CHUNK_SAMPLES - 1) / HYI_CHUNK_SAMPLES;
    for (size_t i = 0; i < hyi_film_tile_count(&in->layout); i++)
        if (hyi_incoming_tile(in, i).chunks != whole) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "the share is not finished");
    return HYDRA_OK;
}

HYI_FN bool hyi_render_is_fresh(const hydra_render *r) { return hyi_film_is_empty(&r->film) && r->range_count == 0; }

HYI_FN hydra_result hyi_check_tile_share(hydra_render *r, const hyi_incoming *in) {
    bool fresh = hyi_render_is_fresh(r);
    if (in->header.range_count && !fresh) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "the share holds sample shares of its own");
    for (size_t i = 0; i < hyi_film_tile_count(&in->layout); i++) {
        size_t match = 0;
        hyi_tile tile = hyi_incoming_tile(in, i);
        if (!hyi_matching_tile(&r->film, &in->layout, i, &match)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "its region does not fall on this render's tiles");
        if (tile.taken && r->film.tiles[match].taken) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "tile %zu", match);
        if (tile.chunks > r->schedule.total_chunks) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "it has more samples than this render may take");
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_incoming(hydra_render *r, hyi_incoming *in) {
    const hyi_film_header *h = &in->header;
    in->by_samples = h->first_sample != r->desc.first_sample;
    if (!in->by_samples) return hyi_check_tile_share(r, in);
    for (size_t i = 0, match; i < hyi_film_tile_count(&in->layout); i++)
        if (!hyi_matching_tile(&r->film, &in->layout, i, &match)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "its region does not fall on this render's tiles");
    return hyi_check_sample_share(r, in);
}

HYI_FN void hyi_merge_pixel(hydra_render *r, size_t index, const hyi_pixel_state *in, bool earlier) {
    hyi_pixel *p = &r->film.pixels[index];
    for (int h = 0; h < 2; h++) hyi_sums_merge(p->rgb[h], &p->rgb_top[h], in->pixel.rgb[h], in->pixel.rgb_top[h], 3);
    hyi_sums_merge(&p->square, &p->square_top, &in->pixel.square, in->pixel.square_top, 1);
    p->dropped = (uint16_t)(p->dropped > UINT16_MAX - in->pixel.dropped ? UINT16_MAX : p->dropped + in->pixel.dropped);
    if (in->pixel.largest > p->largest) p->largest = in->pixel.largest;
    p->hits += in->pixel.hits;
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        size_t each = hyi_plane_is_pair(plane) ? 2 : 1;
        for (size_t h = 0; h < each; h++) hyi_sum3_merge(&r->film.planes[plane][each * index + h], &in->planes[2 * (size_t)plane + h]);
    }
    if (r->film.ids && earlier) r->film.ids[index] = in->ids;
    if (r->schedule.weights) r->schedule.weights[index] = in->weight;
}

HYI_FN void hyi_merge_tile(hydra_render *r, const hyi_incoming *in, size_t from, bool earlier) {
    size_t to = 0;
    hyi_tile theirs = hyi_incoming_tile(in, from);
    if (!theirs.taken || !hyi_matching_tile(&r->film, &in->layout, from, &to)) return;
    hyi_tile *mine = &r->film.tiles[to];
    if (in->by_samples) {
        mine->taken += theirs.taken;
        for (uint32_t g = 0; g < HYI_GROUPS; g++) mine->reported[g] += theirs.reported[g];
    } else {
        *mine = theirs;
    }
    size_t count = r->film.tile_pixels;
    for (size_t i = 0; i < count; i++) {
        hyi_pixel_state state;
        memset(&state, 0, sizeof state);
        hyi_stream s = hyi_reader(in, in->pixels_at + (from * count + i) * in->pixel_bytes);
        hyi_stream_pixel_state(&s, r, &state);
        hyi_merge_pixel(r, to * count + i, &state, earlier || !in->by_samples);
    }
}

HYI_FN uint32_t hyi_first_sample_of_all(const hydra_render *r) {
    uint32_t first = r->desc.first_sample;
    for (uint32_t i = 0; i < r->range_count; i++) first = r->ranges[i].first < first ? r->ranges[i].first : first;
    return first;
}

/* Where the schedule goes on: a fresh render takes the film's place in it. */
HYI_FN void hyi_merge_schedule(hydra_render *r, const hyi_incoming *in, bool fresh) {
    hyi_schedule *s = &r->schedule;
    if (in->by_samples) {
        r->ranges[r->range_count].first = in->header.first_sample;
        r->ranges[r->range_count++].end = in->header.end_sample;
    }
    for (uint32_t i = 0; i < in->header.range_count; i++) r->ranges[r->range_count++] = in->ranges[i];
    if (in->by_samples) return;
    if (fresh || in->header.stage < s->stage) s->stage = in->header.stage;
    if (fresh) {
        s->weighed_stage = in->header.weighed_stage;
        s->brightness = in->header.brightness;
    }
}

HYDRA_API hydra_result hydra_render_merge(hydra_render *render, const void *film, size_t size) {
    if (!render) return HYDRA_ERROR_NULL;
    if (!film) return hyi_fail(render->context, HYDRA_ERROR_NULL, "film");
    hyi_incoming in;
    HYI_TRY(hyi_open_film(render, film, size, &in));
    HYI_TRY(hyi_sync_film(render, true));
    HYI_TRY(hyi_check_incoming(render, &in));
    bool fresh = hyi_render_is_fresh(render);
    uint32_t first = in.header.first_sample;
    for (uint32_t i = 0; i < in.header.range_count; i++) first = in.ranges[i].first < first ? in.ranges[i].first : first;
    bool earlier = first < hyi_first_sample_of_all(render);
    for (size_t i = 0; i < hyi_film_tile_count(&in.layout); i++) hyi_merge_tile(render, &in, i, earlier);
    hyi_merge_schedule(render, &in, fresh);
    render->schedule.active_count = 0; /* the round is listed anew */
    render->done = hyi_all_tiles_done(&render->schedule, &render->film);
    render->report.made_at = -1.0;
    return HYDRA_OK;
}

#endif /* HYI_SHARE_H */
