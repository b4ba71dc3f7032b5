/* Path tracing: rays a second of whole renders, and where the time goes. */
#include "bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_REPEATS = 64, PASSES = 5 };

static const char *const pass_names[PASSES] = {"generate", "intersect", "shade", "shadow", "add up"};

typedef struct run {
    double wall, processor, rays, mean, error;
    double passes[PASSES];
} run;

typedef struct trial {
    uint32_t samples; /* a pixel: what takes about options.render_seconds */
    double first_seconds;
    run runs[MOST_REPEATS];
} trial;

typedef struct view {
    const char *name;
    hydra_sensor_desc sensor;
} view;

/* ---- one render */

static double luminance(const float *c) { return 0.2126 * (double)c[0] + 0.7152 * (double)c[1] + 0.0722 * (double)c[2]; }

/* The picture's mean and its standard error, for a look at whether sides render the same. */
static void read_mean(hydra_render *render, size_t pixels, run *r) {
    float *image = bench_alloc(12 * pixels), *error = bench_alloc(12 * pixels);
    double sum = 0.0, squares = 0.0;
    hydra_render_read(render, HYDRA_RADIANCE, image, 0);
    hydra_render_read(render, HYDRA_ERROR, error, 0);
    for (size_t i = 0; i < pixels; i++) {
        sum += luminance(image + 3 * i);
        squares += luminance(error + 3 * i) * luminance(error + 3 * i);
    }
    r->mean = sum / (double)pixels, r->error = sqrt(squares) / (double)pixels;
    free(image);
    free(error);
}

static run render(const options *o, const side *on, const view *v, uint32_t samples) {
    hydra_render_desc desc = {.sensor = v->sensor, .width = o->side, .height = o->side, .max_samples = samples, .max_depth = 8};
    hydra_render *r = hydra_render_create(on->scene, &desc);
    hydra_result result;
    if (!r) bench_stop(on->name, hydra_error_text(on->context));
    double from = wall_seconds(), processor = processor_seconds();
    while ((result = hydra_render_step(r)) == HYDRA_MORE) continue;
    run out = {.wall = wall_seconds() - from, .processor = processor_seconds() - processor};
    if (result != HYDRA_OK) bench_stop(on->name, hydra_error_text(on->context));
    hydra_status s = hydra_render_status(r);
    const double passes[PASSES] = {s.seconds_generate, s.seconds_intersect, s.seconds_shade, s.seconds_shadow, s.seconds_accumulate};
    memcpy(out.passes, passes, sizeof passes);
    out.rays = (double)(s.rays_camera + s.rays_bounce + s.rays_shadow);
    read_mean(r, (size_t)o->side * o->side, &out);
    hydra_render_destroy(r);
    return out;
}

/* ---- measuring */

static void warm_up(const options *o, const side *on, const view *v, trial *t) {
    t->first_seconds = render(o, on, v, 2).wall;
    double seconds = render(o, on, v, 2).wall, many = 2.0 * o->render_seconds / seconds;
    if (many > 8.0) { /* the first few samples tell little about the speed of many */
        seconds = render(o, on, v, 8).wall;
        many = 8.0 * o->render_seconds / seconds;
    }
    t->samples = many < 2.0 ? 2u : many > 65536.0 ? 65536u : (uint32_t)many / 2u * 2u;
    if (on->device_number) device_forget_slices(on->context);
}

/* seconds of a ray, which is what the sides have in common. */
static void seconds_a_ray(const trial *t, int repeats, double *out) {
    for (int r = 0; r < repeats; r++) out[r] = t->runs[r].wall / t->runs[r].rays;
}

static void report_side(const options *o, const sides *s, const view *v, const trial *trials, int i, FILE *csv) {
    const side *on = &s->list[i], *peer = sides_scalar_peer(s, on);
    const trial *t = &trials[i];
    double own[MOST_REPEATS], scalar[MOST_REPEATS], walls[MOST_REPEATS], passes[PASSES] = {0, 0, 0, 0, 0}, all = 0.0, wall = 0.0,
                                                                         processor = 0.0;
    seconds_a_ray(t, o->repeats, own);
    if (peer) seconds_a_ray(&trials[peer - s->list], o->repeats, scalar);
    double speed = 1e-6 / median(own, o->repeats), ratio = peer ? median_ratio(scalar, own, o->repeats) : NAN;
    for (int r = 0; r < o->repeats; r++) {
        for (int p = 0; p < PASSES; p++) passes[p] += t->runs[r].passes[p], all += t->runs[r].passes[p];
        walls[r] = t->runs[r].wall, wall += walls[r], processor += t->runs[r].processor;
    }
    const run *truth = &trials[s->truth].runs[0], *mine = &t->runs[0];
    double off = (mine->mean - truth->mean) / sqrt(mine->error * mine->error + truth->error * truth->error);
    printf("%-10s %-26s %8u %8.3f %9.3f %6.2f %8.3f ", v->name, on->name, t->samples, median(walls, o->repeats), speed, processor / wall,
           ratio);
    for (int p = 0; p < PASSES; p++) printf(" %9.1f", 100.0 * passes[p] / all);
    printf(" %7.2f %7.2f\n", all / wall, off);
    fprintf(csv, "%s,%s,%u,%u,%g,%g,%g,%g,%g", v->name, on->name, on->threads, t->samples, median(walls, o->repeats), speed,
            processor / wall, ratio, t->first_seconds);
    for (int p = 0; p < PASSES; p++) fprintf(csv, ",%g", passes[p] / o->repeats);
    fprintf(csv, ",%g\n", off);
}

static void report_device(const side *on, const view *v, const trial *t) {
    hydra_vk_info info = side_info(on);
    device_bytes bytes = device_scene_bytes(on->scene);
    slices submitted = {0, 0.0, 0.0};
    slices_add(&submitted, on);
    printf(
        "device: %s, %s: start %.3f s, %u pipelines in %.3f s, first render of 2 samples %.3f s; scene %.2f MB, memory taken %.1f MB, most %.1f; ",
        v->name, on->name, info.seconds_start, info.pipelines, info.seconds_pipelines, t->first_seconds, 1e-6 * (double)bytes.all,
        1e-6 * (double)info.bytes_now, 1e-6 * (double)info.bytes_peak);
    slices_print(&submitted);
}

static void run_view(const options *o, sides *s, const view *v, scene_maker make, const void *what, FILE *csv) {
    static trial trials[MAX_SIDES];
    sides_open(s, make, what, false);
    for (int i = 0; i < s->count; i++) warm_up(o, &s->list[i], v, &trials[i]);
    for (int r = 0; r < o->repeats; r++)
        for (int i = 0; i < s->count; i++) trials[i].runs[r] = render(o, &s->list[i], v, trials[i].samples);
    printf("%-10s %-26s %8s %8s %9s %6s %8s ", "scene", "side", "samples", "seconds", "Mray/s", "cores", "x scalar");
    for (int p = 0; p < PASSES; p++) printf(" %9s", pass_names[p]);
    printf(" %7s %7s\n", "covered", "sigma");
    for (int i = 0; i < s->count; i++) report_side(o, s, v, trials, i, csv);
    for (int i = 0; i < s->count; i++)
        if (s->list[i].device_number) report_device(&s->list[i], v, &trials[i]);
    sides_close(s);
}

void bench_paths(const options *o, sides *s) {
    view box = {"box", {.position = {0, 1, 3.9f}, .target = {0, 1, 0}, .fov_y = 0.66f}}, outdoors = {"outdoors", {.fov_y = 1.2f}};
    FILE *csv = open_csv(
        "vulkan_paths.csv",
        "scene,side,threads,samples,seconds,mrays,cores,over_scalar,first_seconds,generate,intersect,shade,shadow,accumulate,sigma");
    geometry g;
    geometry_generate(&g, 3, o->triangles);
    for (int k = 0; k < 3; k++) outdoors.sensor.position[k] = g.eye[k], outdoors.sensor.target[k] = g.look[k];
    printf(
        "\nPaths, %u x %u pixels, at most 8 scatterings; outdoors: %zu triangles. Passes in %% of their sum; covered: that sum over wall\n"
        "time; sigma: how many standard errors the picture's mean is off %s's\n",
        o->side, o->side, g.triangles, s->list[s->truth].name);
    run_view(o, s, &box, make_box, NULL, csv);
    run_view(o, s, &outdoors, make_outdoors, &g, csv);
    geometry_free(&g);
    fclose(csv);
}
