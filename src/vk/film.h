/* >>vk-film: a render's film on the device

   Where it fits, samples are added up where they are made: accumulate.comp adds a batch to the same integer sums as
   hyi_film_add, so the film's bits are those that the host would have made of the same samples. The host keeps what is known
   of tiles, and of adaptive ones gets the scatter of each pixel's samples. Its own sums are brought up to date when somebody
   asks for them (hyi_vk_sync_film); until then the device is ahead, and should it be lost, the film is again what it was when
   both last agreed. */
#ifndef HYI_VK_FILM_H
#define HYI_VK_FILM_H

#include "../../shaders/shared/film.h"
#include "scene.h"

HYI_STATIC_ASSERT(sizeof(hyk_pixel) == sizeof(hyi_pixel) && sizeof(hyk_sum3) == sizeof(hyi_sum3) && sizeof(hyk_ids) == sizeof(hyi_ids));
HYI_STATIC_ASSERT((int)HYK_PLANES == (int)HYI_PLANE_COUNT && HYK_FILM_GROUPS == HYI_GROUPS && (int)HYK_PLANE_DEPTH == (int)HYI_PLANE_DEPTH);
HYI_STATIC_ASSERT((int)HYK_RESOLVE_POSITION == (int)HYDRA_POSITION && (int)HYK_RESOLVE_SAMPLES == (int)HYDRA_SAMPLES);
HYI_STATIC_ASSERT(HYK_FILM_BINDINGS <= HYI_VK_STORAGE_BUFFERS && HYK_RESOLVE_LUMINANCE > HYDRA_OUTPUT_COUNT);

#define HYI_VK_FILM_SHARE 4u /* of the device's memory, or of the cap on it, the film may take one part in so many */
#define HYI_VK_GROUPS_ACROSS 1024u /* a dispatch of more workgroups has rows of so many: 65535 a side are promised */

/* What host and device last agreed on, beside the sums. */
typedef struct hyi_vk_agreed {
    hyi_tile *tiles;
    float *weights; /* where there is a target */
    uint32_t stage, weighed_stage;
    double brightness;
} hyi_vk_agreed;

typedef struct hyi_vk_film {
    bool here;  /* on the device; else samples come back (passes.h) */
    bool blank; /* nothing was ever in it: it need not be sent */
    bool stale; /* the host's was changed: it is sent before anything is added */
    bool ahead; /* it has samples that the host's has not */
    hyi_vk_buffer pixels, planes[HYI_PLANE_COUNT], ids, placed, tiles;
    hyi_vk_buffer luminance, told_luminance; /* where there is a target; the latter where the host does not see the device's memory */
    hyi_vk_commands commands; /* for all but batches */
    hyi_vk_set set;
    VkPipeline accumulate;
    hyi_vk_agreed agreed;
    uint32_t *last_unit; /* of each tile in the batch that is linked */
} hyi_vk_film;

/* A buffer of the film, and where the host has the same. */
typedef struct hyi_vk_film_part {
    hyi_vk_buffer *buffer;
    void *host;
    size_t bytes;
} hyi_vk_film_part;
#define HYI_VK_FILM_PARTS (HYI_PLANE_COUNT + 2)

HYI_FN uint32_t hyi_vk_film_parts(hyi_vk_film *f, const hyi_film *film, hyi_vk_film_part parts[HYI_VK_FILM_PARTS]) {
    uint32_t count = 0;
    size_t pixels = hyi_film_pixel_count(film);
    parts[count].buffer = &f->pixels;
    parts[count].host = film->pixels;
    parts[count++].bytes = pixels * sizeof(hyi_pixel);
    for (int p = 0; p < HYI_PLANE_COUNT; p++) {
        if (!(film->planes_wanted >> p & 1u)) continue;
        parts[count].buffer = &f->planes[p];
        parts[count].host = film->planes[p];
        parts[count++].bytes = hyi_plane_sums(film, p) * sizeof(hyi_sum3);
    }
    parts[count].buffer = &f->ids;
    parts[count].host = film->ids;
    parts[count++].bytes = film->ids_wanted ? pixels * sizeof(hyi_ids) : 0;
    return count;
}

/* ---- creation */

/* No binding is too small for it, and it leaves most of the memory to others. */
HYI_FN bool hyi_vk_film_fits(const hyi_vk *vk, hyi_vk_film *f, const hyi_film *film) {
    hyi_vk_film_part parts[HYI_VK_FILM_PARTS];
    uint32_t count = hyi_vk_film_parts(f, film, parts);
    uint64_t most = hyi_vk_largest_heap(&vk->memory), bytes = 0;
    if (vk->desc.memory_cap && vk->desc.memory_cap < most) most = vk->desc.memory_cap;
    for (uint32_t i = 0; i < count; i++) {
        if (parts[i].bytes > vk->limits.maxStorageBufferRange) return false;
        bytes += parts[i].bytes;
    }
    return bytes <= most / HYI_VK_FILM_SHARE;
}

/* On processors that pose as devices samples are the host's already, and it adds them up faster (bench/vulkan). */
HYI_FN bool hyi_vk_film_is_wanted(const hyi_vk *vk, hyi_vk_film *f, const hyi_film *film) {
    if (vk->desc.film != HYDRA_VK_FILM_AUTO) return vk->desc.film == HYDRA_VK_FILM_DEVICE;
    return vk->type != HYDRA_VK_DEVICE_CPU && hyi_vk_film_fits(vk, f, film);
}

HYI_FN hydra_result hyi_vk_send_placed(hyi_vk *vk, hyi_vk_film *f, const hydra_scene *scene) {
    hyk_placed_ids *ids;
    HYI_TRY(hyi_vk_make_buffer(vk, &f->placed, HYI_VK_DEVICE, scene->placed_count * sizeof *ids, "instances of the film"));
    HYI_TRY(hyi_alloc_array(vk->context, &ids, scene->placed_count));
    for (size_t i = 0; i < scene->placed_count; i++) {
        ids[i].instance = scene->placed_ids[i];
        ids[i].mesh = scene->placed[i].mesh + 1;
    }
    hydra_result result = hyi_vk_send(vk, &f->placed, ids, scene->placed_count * sizeof *ids);
    hyi_free_array(vk->context, &ids, scene->placed_count);
    return result;
}

HYI_FN uint32_t hyi_vk_film_features(const hyi_film *film) { return film->planes_wanted | (film->ids_wanted ? HYK_FILM_HAS_IDS : 0u); }

HYI_FN hydra_result hyi_vk_get_resolver(hyi_vk *vk, VkPipeline *pipeline) {
    hyi_vk_shape shape;
    memset(&shape, 0, sizeof shape);
    shape.features = (1u << HYI_PLANE_COUNT) - 1u;
    return hyi_vk_get_pipeline(vk, HYI_VK_KERNEL_resolve, &shape, pipeline);
}

/* What a target takes: the kernel too, which no step then has to wait for. */
HYI_FN hydra_result hyi_vk_make_luminance(hyi_vk *vk, hyi_vk_film *f, size_t bytes) {
    VkPipeline resolver;
    HYI_TRY(hyi_vk_get_resolver(vk, &resolver));
    HYI_TRY(hyi_vk_make_buffer(vk, &f->luminance, HYI_VK_DEVICE, bytes, "the film's luminance"));
    return f->luminance.mapped ? HYDRA_OK : hyi_vk_make_buffer(vk, &f->told_luminance, HYI_VK_READBACK, bytes, "the film's luminance");
}

HYI_FN hydra_result hyi_vk_make_film(hydra_render *render, hyi_vk *vk, hyi_vk_film *f) {
    const hyi_film *film = &render->film;
    hyi_vk_film_part parts[HYI_VK_FILM_PARTS];
    hyi_vk_shape shape;
    f->here = hyi_vk_film_is_wanted(vk, f, film);
    if (!f->here) return HYDRA_OK;
    f->blank = f->stale = true;
    uint32_t count = hyi_vk_film_parts(f, film, parts);
    for (uint32_t i = 0; i < count; i++) HYI_TRY(hyi_vk_make_buffer(vk, parts[i].buffer, HYI_VK_DEVICE, parts[i].bytes, "the film"));
    for (int p = 0; p < HYI_PLANE_COUNT; p++) /* bound, not used */
        if (!f->planes[p].buffer) HYI_TRY(hyi_vk_make_buffer(vk, &f->planes[p], HYI_VK_DEVICE, 0, "the film"));
    HYI_TRY(hyi_vk_make_buffer(vk, &f->tiles, HYI_VK_DEVICE, hyi_film_tile_count(film) * sizeof(hyk_film_tile), "tiles of the film"));
    if (render->schedule.weights) HYI_TRY(hyi_vk_make_luminance(vk, f, hyi_film_pixel_count(film) * sizeof(double)));
    HYI_TRY(hyi_vk_send_placed(vk, f, render->scene));
    HYI_TRY(hyi_vk_make_commands(vk, &f->commands));
    HYI_TRY(hyi_vk_make_set(vk, vk->film_set_layout, HYK_FILM_BINDINGS, 0, &f->set));
    HYI_TRY(hyi_alloc_array(vk->context, &f->last_unit, hyi_film_tile_count(film)));
    memset(f->last_unit, 0, hyi_film_tile_count(film) * sizeof *f->last_unit);
    HYI_TRY(hyi_alloc_array(vk->context, &f->agreed.tiles, hyi_film_tile_count(film)));
    if (render->schedule.weights) HYI_TRY(hyi_alloc_array(vk->context, &f->agreed.weights, hyi_film_pixel_count(film)));
    memset(&shape, 0, sizeof shape);
    shape.features = hyi_vk_film_features(film);
    shape.mode = render->schedule.weights != NULL;
    shape.wants = render->picture.kernel.settings.wants;
    return hyi_vk_get_pipeline(vk, HYI_VK_KERNEL_accumulate, &shape, &f->accumulate);
}

HYI_FN void hyi_vk_free_film(hydra_render *render, hyi_vk *vk, hyi_vk_film *f) {
    const hyi_film *film = &render->film;
    hyi_vk_free_commands(vk, &f->commands);
    hyi_vk_free_set(vk, &f->set);
    hyi_vk_free_buffer(vk, &f->pixels);
    for (int p = 0; p < HYI_PLANE_COUNT; p++) hyi_vk_free_buffer(vk, &f->planes[p]);
    hyi_vk_free_buffer(vk, &f->ids);
    hyi_vk_free_buffer(vk, &f->placed);
    hyi_vk_free_buffer(vk, &f->tiles);
    hyi_vk_free_buffer(vk, &f->luminance);
    hyi_vk_free_buffer(vk, &f->told_luminance);
    hyi_free_array(vk->context, &f->last_unit, hyi_film_tile_count(film));
    hyi_free_array(vk->context, &f->agreed.tiles, hyi_film_tile_count(film));
    hyi_free_array(vk->context, &f->agreed.weights, hyi_film_pixel_count(film));
}

/* The film's own bindings; others are the batch's. */
HYI_FN void hyi_vk_bind_film(const hyi_vk_film *f, const hyi_vk_buffer *picture, hyi_vk_buffer bound[HYK_FILM_BINDINGS]) {
    for (uint32_t i = 0; i < HYK_FILM_BINDINGS; i++) bound[i] = f->tiles;
    bound[HYK_BINDING_FILM_PICTURE] = *picture;
    bound[HYK_BINDING_FILM_PIXELS] = f->pixels;
    for (int p = 0; p < HYI_PLANE_COUNT; p++) bound[HYK_BINDING_FILM_PLANES + p] = f->planes[p];
    bound[HYK_BINDING_FILM_IDS] = f->ids;
    bound[HYK_BINDING_FILM_PLACED] = f->placed;
}

/* ---- units of a batch */

/* The list of each tile's units. */
HYI_FN void hyi_vk_link_units(const hydra_render *render, hyi_vk_film *f, const hyk_unit *units, const uint32_t *tiles, uint32_t count, hyk_film_unit *chains) {
    for (uint32_t i = 0; i < count; i++) {
        uint32_t last = f->last_unit[tiles[i]]; /* of an earlier batch, unless what stands there is of this tile */
        bool follows = last < i && tiles[last] == tiles[i];
        chains[i].tile = tiles[i];
        chains[i].open = ~render->film.tiles[tiles[i]].closed & HYI_ALL_GROUPS;
        chains[i].next = HYK_NONE;
        chains[i].flags = (follows ? 0u : HYK_FILM_FIRST) | (units[i].first_sample == render->film.first_sample ? HYK_FILM_IDS : 0u);
        if (follows) chains[last].next = i;
        f->last_unit[tiles[i]] = i;
    }
}

HYI_FN void hyi_vk_record_accumulate(hyi_vk *vk, const hyi_vk_film *f, hyi_vk_commands *c, const hyi_vk_set *set, uint32_t units, uint32_t lanes_of_unit, uint32_t tile_pixels) {
    hyk_film_call call;
    memset(&call, 0, sizeof call);
    call.count = units;
    call.lanes_of_unit = lanes_of_unit;
    vk->f.CmdBindDescriptorSets(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, vk->film_layout, 0, 1, &set->set, 0, NULL);
    vk->f.CmdPushConstants(c->buffer, vk->film_layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof call, &call);
    vk->f.CmdBindPipeline(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, f->accumulate);
    vk->f.CmdDispatch(c->buffer, (units * tile_pixels + HYK_GROUP - 1) / HYK_GROUP, 1, 1);
}

/* How many pixels of a tile lie in the region. */
HYI_FN uint32_t hyi_vk_pixels_inside(const hyi_film *film, uint32_t tile) {
    uint32_t x = hyi_tile_left(film, tile), y = hyi_tile_top(film, tile), x1 = x + film->tile_width, y1 = y + film->tile_height;
    x = x > film->left ? x : film->left;
    y = y > film->top ? y : film->top;
    x1 = x1 < film->right ? x1 : film->right;
    y1 = y1 < film->bottom ? y1 : film->bottom;
    return (x1 - x) * (y1 - y);
}

/* scatters: of a unit's pixels, as accumulate.comp tells them; NULL where nothing is judged. */
HYI_FN void hyi_vk_count_unit(hydra_render *render, uint32_t tile, const hyk_unit *unit, const double *scatters) {
    const hyi_film *film = &render->film;
    double judgement[HYI_GROUPS] = { 0.0 };
    for (uint32_t p = 0; scatters && p < film->tile_pixels; p++) {
        uint32_t x = hyi_pixel_left(film, tile, p), y = hyi_pixel_top(film, tile, p);
        if (x < film->left || x >= film->right || y < film->top || y >= film->bottom) continue;
        double weight = (double)render->schedule.weights[(size_t)tile * film->tile_pixels + p];
        judgement[hyi_group_of(p)] += weight * weight * hyi_variance_of(scatters[p], unit->samples);
    }
    hyi_count_unit(render, &render->film.tiles[tile], unit, judgement);
}

/* ---- up and down */

HYI_FN bool hyi_vk_parts_are_mapped(const hyi_vk_film_part *parts, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        if (!parts[i].buffer->mapped) return false;
    return true;
}

/* Between the film's buffers and stages: one for each part, since no more memory is promised in one piece than a binding of
   the device had. */
HYI_FN hydra_result hyi_vk_make_stages(hyi_vk *vk, const hyi_vk_film_part *parts, uint32_t count, hyi_vk_buffer *stages, bool up) {
    for (uint32_t i = 0; i < count; i++)
        if (parts[i].bytes) HYI_TRY(hyi_vk_make_buffer(vk, &stages[i], up ? HYI_VK_UPLOAD : HYI_VK_READBACK, parts[i].bytes, "the film on its way"));
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_move_parts(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_film_part *parts, uint32_t count, const hyi_vk_buffer *stages, bool up) {
    double seconds;
    HYI_TRY(hyi_vk_begin(vk, c));
    for (uint32_t i = 0; i < count; i++)
        if (parts[i].bytes) hyi_vk_copy(vk, c, up ? &stages[i] : parts[i].buffer, up ? parts[i].buffer : &stages[i], parts[i].bytes);
    if (up) hyi_vk_barrier(vk, c);
    else hyi_vk_barrier_to_host(vk, c);
    HYI_TRY(hyi_vk_submit(vk, c));
    return hyi_vk_wait(vk, c, &seconds);
}

/* stages NULL: the parts themselves are mapped. */
HYI_FN void hyi_vk_copy_parts(const hyi_vk_film_part *parts, uint32_t count, const hyi_vk_buffer *stages, bool up) {
    for (uint32_t i = 0; i < count; i++) {
        void *device = stages ? stages[i].mapped : parts[i].buffer->mapped;
        if (parts[i].bytes && up) memcpy(device, parts[i].host, parts[i].bytes);
        if (parts[i].bytes && !up) memcpy(parts[i].host, device, parts[i].bytes);
    }
}

HYI_FN hydra_result hyi_vk_transfer_staged(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_film_part *parts, uint32_t count, bool up) {
    hyi_vk_buffer stages[HYI_VK_FILM_PARTS];
    memset(stages, 0, sizeof stages);
    hydra_result result = hyi_vk_make_stages(vk, parts, count, stages, up);
    if (result == HYDRA_OK && up) hyi_vk_copy_parts(parts, count, stages, true);
    if (result == HYDRA_OK) result = hyi_vk_move_parts(vk, c, parts, count, stages, up);
    if (result == HYDRA_OK && !up) hyi_vk_copy_parts(parts, count, stages, false);
    hyi_vk_drain(vk, c);
    for (uint32_t i = 0; i < count; i++) hyi_vk_free_buffer(vk, &stages[i]);
    return result;
}

/* The host's film changes as a whole, or not at all. */
HYI_FN hydra_result hyi_vk_transfer(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_film_part *parts, uint32_t count, bool up) {
    if (hyi_vk_parts_are_mapped(parts, count)) hyi_vk_copy_parts(parts, count, NULL, up);
    else HYI_TRY(hyi_vk_transfer_staged(vk, c, parts, count, up));
    for (uint32_t i = 0; i < count && !up; i++) hyi_vk_count_read(vk, parts[i].bytes);
    return HYDRA_OK;
}

/* A film without samples: zeros, but for ids, which are sent. */
HYI_FN hydra_result hyi_vk_clear_film(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_film_part *parts, uint32_t count) {
    double seconds;
    HYI_TRY(hyi_vk_begin(vk, c));
    for (uint32_t i = 0; i + 1 < count; i++) vk->f.CmdFillBuffer(c->buffer, parts[i].buffer->buffer, 0, VK_WHOLE_SIZE, 0);
    hyi_vk_barrier(vk, c);
    HYI_TRY(hyi_vk_submit(vk, c));
    HYI_TRY(hyi_vk_wait(vk, c, &seconds));
    return parts[count - 1].bytes ? hyi_vk_transfer(vk, c, &parts[count - 1], 1, true) : HYDRA_OK;
}

/* Before samples are added: what the host's film holds stands on the device, and it is kept what both agree on. */
HYI_FN hydra_result hyi_vk_ready_film(hydra_render *render, hyi_vk *vk, hyi_vk_film *f) {
    hyi_vk_film_part parts[HYI_VK_FILM_PARTS];
    uint32_t count = hyi_vk_film_parts(f, &render->film, parts);
    if (f->stale) HYI_TRY(f->blank ? hyi_vk_clear_film(vk, &f->commands, parts, count) : hyi_vk_transfer(vk, &f->commands, parts, count, true));
    f->stale = f->blank = false;
    if (f->ahead) return HYDRA_OK;
    const hyi_schedule *s = &render->schedule;
    memcpy(f->agreed.tiles, render->film.tiles, hyi_film_tile_count(&render->film) * sizeof *f->agreed.tiles);
    if (s->weights) memcpy(f->agreed.weights, s->weights, hyi_film_pixel_count(&render->film) * sizeof *s->weights);
    f->agreed.stage = s->stage;
    f->agreed.weighed_stage = s->weighed_stage;
    f->agreed.brightness = s->brightness;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_fetch_film(hydra_render *render, hyi_vk *vk, hyi_vk_film *f) {
    hyi_vk_film_part parts[HYI_VK_FILM_PARTS];
    uint32_t count = hyi_vk_film_parts(f, &render->film, parts);
    if (!f->ahead) return HYDRA_OK;
    HYI_TRY(hyi_vk_transfer(vk, &f->commands, parts, count, false));
    f->ahead = false;
    return HYDRA_OK;
}

/* The device is lost: the film is what both last agreed on. */
HYI_FN void hyi_vk_lose_film(hydra_render *render, hyi_vk_film *f) {
    hyi_schedule *s = &render->schedule;
    if (!f->ahead) return;
    memcpy(render->film.tiles, f->agreed.tiles, hyi_film_tile_count(&render->film) * sizeof *f->agreed.tiles);
    if (s->weights) memcpy(s->weights, f->agreed.weights, hyi_film_pixel_count(&render->film) * sizeof *s->weights);
    s->stage = f->agreed.stage;
    s->weighed_stage = f->agreed.weighed_stage;
    s->brightness = f->agreed.brightness;
    s->active_count = 0; /* the round is listed anew */
    render->done = false;
    render->report.made_at = -1.0;
    f->ahead = false;
}

/* ---- values of pixels */

/* Outputs that follow from one pixel's sums. */
HYI_FN bool hyi_vk_resolves(hydra_output output) {
    return output != HYDRA_ERROR && output <= HYDRA_SAMPLES;
}

HYI_FN hydra_result hyi_vk_send_tiles(hydra_render *render, hyi_vk *vk, hyi_vk_film *f) {
    size_t count = hyi_film_tile_count(&render->film);
    hyk_film_tile *tiles;
    HYI_TRY(hyi_alloc_array(vk->context, &tiles, count));
    for (size_t i = 0; i < count; i++) {
        tiles[i].taken = render->film.tiles[i].taken;
        memcpy(tiles[i].reported, render->film.tiles[i].reported, sizeof tiles[i].reported);
    }
    hydra_result result = hyi_vk_send(vk, &f->tiles, tiles, count * sizeof *tiles);
    hyi_free_array(vk->context, &tiles, count);
    return result;
}

/* Begins commands that leave count values in out. The film is ready. */
HYI_FN hydra_result hyi_vk_record_resolve(hydra_render *render, hyi_vk *vk, hyi_vk_film *f, const hyi_vk_buffer *picture, uint32_t asked, uint32_t count, const hyi_vk_buffer *out) {
    hyi_vk_buffer bound[HYK_FILM_BINDINGS];
    VkPipeline pipeline;
    hyk_film_call call;
    memset(&call, 0, sizeof call);
    HYI_TRY(hyi_vk_get_resolver(vk, &pipeline));
    HYI_TRY(hyi_vk_send_tiles(render, vk, f));
    HYI_TRY(hyi_vk_begin(vk, &f->commands));
    hyi_vk_bind_film(f, picture, bound);
    bound[HYK_BINDING_FILM_OUT] = *out;
    hyi_vk_write_set(vk, &f->set, bound, HYK_FILM_BINDINGS);
    call.count = count;
    call.asked = asked;
    call.points = render->desc.sensor.kind == HYDRA_SENSOR_POINTS;
    call.factor0 = hyi_lightmap_factor(render, 0);
    call.factor1 = hyi_lightmap_factor(render, 1);
    call.factor2 = hyi_lightmap_factor(render, 2);
    VkCommandBuffer c = f->commands.buffer;
    vk->f.CmdBindDescriptorSets(c, VK_PIPELINE_BIND_POINT_COMPUTE, vk->film_layout, 0, 1, &f->set.set, 0, NULL);
    vk->f.CmdPushConstants(c, vk->film_layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof call, &call);
    vk->f.CmdBindPipeline(c, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    uint32_t groups = (count + HYK_GROUP - 1) / HYK_GROUP, across = groups < HYI_VK_GROUPS_ACROSS ? groups : HYI_VK_GROUPS_ACROSS;
    vk->f.CmdDispatch(c, across, (groups + across - 1) / across, 1);
    hyi_vk_barrier(vk, &f->commands);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_fetch_luminance(hydra_render *render, hyi_vk *vk, hyi_vk_film *f, const hyi_vk_buffer *picture, const double **luminance) {
    double seconds;
    const hyi_vk_buffer *told = f->told_luminance.buffer ? &f->told_luminance : &f->luminance;
    uint32_t pixels = (uint32_t)hyi_film_pixel_count(&render->film);
    HYI_TRY(hyi_vk_record_resolve(render, vk, f, picture, HYK_RESOLVE_LUMINANCE, pixels, &f->luminance));
    if (told != &f->luminance) hyi_vk_copy(vk, &f->commands, &f->luminance, told, pixels * sizeof **luminance);
    hyi_vk_barrier_to_host(vk, &f->commands);
    HYI_TRY(hyi_vk_submit(vk, &f->commands));
    HYI_TRY(hyi_vk_wait(vk, &f->commands, &seconds));
    hyi_vk_count_read(vk, pixels * sizeof **luminance);
    *luminance = (const double *)told->mapped;
    return HYDRA_OK;
}

#endif /* HYI_VK_FILM_H */
