/* Where samples are added up: films of one picture on the host and on the device, by turns. */
#include "bench.h"

#include <string.h>

enum { PLACES = 2, FILM_SIDE = 64, MOST_REPEATS = 64, FILM_SAMPLES = 32 };
static const char *const place_names[PLACES] = {"host", "device"};

typedef struct place {
    hydra_context *context;
    hydra_scene *scene;
    double seconds[MOST_REPEATS], processor[MOST_REPEATS];
    double bytes; /* read back, a sample */
} place;

static void open_place(const side *on, int i, place *p) {
    hydra_context_desc host;
    hydra_vk_desc desc;
    memset(&host, 0, sizeof host);
    memset(&desc, 0, sizeof desc);
    host.threads = 1;
    desc.device_number = on->device_number;
    desc.film = i ? HYDRA_VK_FILM_DEVICE : HYDRA_VK_FILM_HOST;
    if (hydra_vk_create(&host, &desc, &p->context) != HYDRA_OK) bench_stop("hydra_vk_create", on->name);
    p->scene = hydra_scene_create(p->context);
    make_box(p->scene, NULL);
    if (hydra_scene_commit(p->scene) != HYDRA_OK) bench_stop("hydra_scene_commit", hydra_error_text(p->context));
}

static void close_place(place *p) {
    hydra_scene_destroy(p->scene);
    hydra_destroy(p->context);
}

/* One picture, ready to be read. */
static void make_film(place *p, bool all_outputs, int round) {
    hydra_render_desc desc;
    hydra_vk_info before, after;
    memset(&desc, 0, sizeof desc);
    desc.width = desc.height = FILM_SIDE;
    desc.max_samples = FILM_SAMPLES;
    desc.max_depth = 4;
    desc.outputs = all_outputs ? (1u << HYDRA_OUTPUT_COUNT) - 1u : 0u;
    desc.sensor.position[1] = desc.sensor.target[1] = 1;
    desc.sensor.position[2] = 3.9f;
    desc.sensor.fov_y = 0.66f;
    desc.step_seconds = 60;
    hydra_render *render = hydra_render_create(p->scene, &desc);
    if (!render) bench_stop("hydra_render_create", hydra_error_text(p->context));
    hydra_vk_get_info(p->context, &before);
    double start = wall_seconds(), processor = processor_seconds();
    while (hydra_render_step(render) == HYDRA_MORE) continue;
    p->seconds[round] = wall_seconds() - start;
    p->processor[round] = processor_seconds() - processor;
    hydra_vk_get_info(p->context, &after);
    p->bytes = (double)(after.bytes_read - before.bytes_read) / ((double)FILM_SIDE * FILM_SIDE * FILM_SAMPLES);
    hydra_render_destroy(render);
}

static void run_device(const options *o, const side *on, FILE *csv) {
    static place places[PLACES];
    for (int i = 0; i < PLACES; i++) open_place(on, i, &places[i]);
    for (int all = 0; all < 2; all++) {
        for (int i = 0; i < PLACES; i++) make_film(&places[i], all != 0, 0); /* makes the kernels */
        for (int r = 0; r < o->repeats; r++)
            for (int i = 0; i < PLACES; i++) make_film(&places[i], all != 0, r);
        double host = median(places[0].processor, o->repeats);
        for (int i = 0; i < PLACES; i++) {
            double seconds = median(places[i].seconds, o->repeats), processor = median(places[i].processor, o->repeats);
            printf("%-26s %-9s %-7s %9.3f %9.3f %9.3f %9.3f\n", on->name, all ? "all" : "radiance", place_names[i], seconds, processor, processor / host, places[i].bytes);
            fprintf(csv, "%s,%s,%s,%g,%g,%g,%g\n", on->name, all ? "all" : "radiance", place_names[i], seconds, processor, processor / host, places[i].bytes);
        }
    }
    for (int i = 0; i < PLACES; i++) close_place(&places[i]);
}

void bench_films(const options *o, const sides *s) {
    FILE *csv = open_csv("vulkan_films.csv", "device,outputs,film,seconds,processor_seconds,over_host,bytes_a_sample");
    printf("\nFilms, %d x %d pixels, %d samples, at most 4 scatterings; seconds are wall time, then the program's processor time, then that over\n"
           "the host film's, and the bytes read back for each sample\n", FILM_SIDE, FILM_SIDE, FILM_SAMPLES);
    printf("%-26s %-9s %-7s %9s %9s %9s %9s\n", "device", "outputs", "film", "seconds", "processor", "x host", "bytes");
    for (int i = 0; i < s->count; i++)
        if (s->list[i].device_number) run_device(o, &s->list[i], csv);
    fclose(csv);
}
