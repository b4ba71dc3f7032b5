/* From nothing to a first sample: each run is a process of its own, so that no driver has anything at hand. Cold: the
   driver keeps nothing on disk, and there is no blob of pipelines. Blob: that of hydra_vk_save_pipelines. Disk: no blob, but the
   driver's own store of compiled shaders, filled by a run before. */
#include "bench.h"

#include <stdlib.h>
#include <string.h>

enum { STEPS = 6, MOST_RUNS = 16 };

static const char *const step_names[STEPS] = {"context", "commit", "render", "1st step", "1 sample", "pipelines"};

#define BLOB "build/bench/vulkan_pipelines"
#define STORE "build/bench/shader_cache"
/* Mesa's drivers, then NVIDIA's. */
#define NO_STORE "MESA_SHADER_CACHE_DISABLE=true __GL_SHADER_DISK_CACHE=0"
#define WITH_STORE \
    "MESA_SHADER_CACHE_DISABLE=false MESA_SHADER_CACHE_DIR=" STORE " __GL_SHADER_DISK_CACHE=1 __GL_SHADER_DISK_CACHE_PATH=" STORE

/* ---- the child: --latency device isa threads load|save|none */

static void *load_blob(size_t *size) {
    FILE *file = fopen(BLOB, "rb");
    *size = 0;
    if (!file) bench_stop(BLOB, "cannot be read");
    fseek(file, 0, SEEK_END);
    long length = ftell(file);
    rewind(file);
    void *blob = bench_alloc(length > 0 ? (size_t)length : 1);
    if (length > 0) *size = fread(blob, 1, (size_t)length, file);
    fclose(file);
    return blob;
}

static size_t save_blob(const hydra_context *context, bool write) {
    size_t size = 0;
    if (hydra_vk_save_pipelines(context, NULL, &size) != HYDRA_OK) return 0;
    void *blob = bench_alloc(size);
    FILE *file = write && hydra_vk_save_pipelines(context, blob, &size) == HYDRA_OK ? fopen(BLOB, "wb") : NULL;
    if (file) {
        fwrite(blob, 1, size, file);
        fclose(file);
    }
    free(blob);
    return size;
}

static hydra_render *start_render(const side *one) {
    hydra_render_desc desc = {.width = 256, .height = 256, .max_samples = 1024, .max_depth = 8};
    desc.sensor = (hydra_sensor_desc){.position = {0, 1, 3.9f}, .target = {0, 1, 0}, .fov_y = 0.66f};
    hydra_render *render = hydra_render_create(one->scene, &desc);
    if (!render) bench_stop(one->name, hydra_error_text(one->context));
    return render;
}

static void step(const side *one, hydra_render *render) {
    if (hydra_render_step(render) < HYDRA_ERROR_NULL) return;
    bench_stop(one->name, hydra_error_text(one->context));
}

int latency_child(int argc, char **argv) {
    if (argc != 4) return 1;
    side one = {.name = "latency", .device_number = (uint32_t)strtoul(argv[0], NULL, 10), .isa = (hydra_isa)atoi(argv[1])};
    one.threads = (uint32_t)strtoul(argv[2], NULL, 10);
    size_t size = 0;
    void *blob = !strcmp(argv[3], "load") ? load_blob(&size) : NULL;
    double times[STEPS], from = wall_seconds();
    one.context = side_create(&one, blob, size);
    times[0] = wall_seconds() - from;
    one.scene = hydra_scene_create(one.context);
    make_box(one.scene, NULL);
    if (hydra_scene_commit(one.scene) != HYDRA_OK) bench_stop(one.name, hydra_error_text(one.context));
    times[1] = wall_seconds() - from;
    hydra_render *render = start_render(&one);
    times[2] = wall_seconds() - from;
    step(&one, render);
    times[3] = wall_seconds() - from;
    while (hydra_render_status(render).samples < 1.0) step(&one, render);
    times[4] = wall_seconds() - from;
    times[5] = side_info(&one).seconds_pipelines;
    size = one.device_number ? save_blob(one.context, !strcmp(argv[3], "save")) : 0;
    for (int i = 0; i < STEPS; i++) printf("%.9g ", times[i]);
    printf("%zu\n", size);
    hydra_render_destroy(render);
    hydra_scene_destroy(one.scene);
    hydra_destroy(one.context);
    free(blob);
    return 0;
}

/* ---- the parent */

/* Returns the blob's size. */
static size_t run_child(const char *program, const side *one, const char *environment, const char *blob, double times[STEPS]) {
    char command[1024];
    size_t size = 0;
    snprintf(command, sizeof command, "%s '%s' --latency %u %d %u %s", environment, program, one->device_number, (int)one->isa,
             one->threads, blob);
    FILE *answer = popen(command, "r");
    if (!answer) bench_stop("popen", command);
    bool sound = true;
    for (int i = 0; i < STEPS; i++) sound = fscanf(answer, "%lf", &times[i]) == 1 && sound;
    sound = fscanf(answer, "%zu", &size) == 1 && sound;
    if (pclose(answer) != 0 || !sound) bench_stop("no answer from", command);
    return size;
}

static void measure(const char *program, const side *one, const char *how, const char *environment, const char *blob, int runs, FILE *csv) {
    double times[STEPS][MOST_RUNS], of_run[STEPS];
    size_t size = 0;
    for (int r = 0; r < runs; r++) {
        size = run_child(program, one, environment, blob, of_run);
        for (int i = 0; i < STEPS; i++) times[i][r] = of_run[i];
    }
    printf("%-26s %-6s %5d", one->name, how, runs);
    fprintf(csv, "%s,%s,%d", one->name, how, runs);
    for (int i = 0; i < STEPS; i++) {
        printf(" %9.4f", median(times[i], runs));
        fprintf(csv, ",%g", median(times[i], runs));
    }
    printf(" %9zu\n", size);
    fprintf(csv, ",%zu\n", size);
}

void bench_latency(const options *o, const sides *s, const char *program) {
    int runs = o->repeats < MOST_RUNS ? o->repeats : MOST_RUNS, cold = o->quick ? 1 : runs;
    double ignored[STEPS];
    FILE *csv = open_csv("vulkan_latency.csv", "side,how,runs,context,commit,render,first_step,one_sample,pipelines,blob");
    printf("\nLatency: seconds since the start until each is there, a box of 256 x 256 pixels, each run a process of its own; pipelines:\n"
           "seconds of making them among these; blob: bytes of hydra_vk_save_pipelines. Cold and blob without, disk with the driver's own\n"
           "store of compiled shaders\n%-26s %-6s %5s",
           "side", "how", "runs");
    for (int i = 0; i < STEPS; i++) printf(" %9s", step_names[i]);
    printf(" %9s\n", "blob");
    for (int i = 0; i < s->count; i++) {
        const side *one = &s->list[i];
        if (!one->device_number) {
            if (i + 1 == s->count || s->list[i + 1].device_number) measure(program, one, "-", "", "none", runs, csv);
            continue;
        }
        measure(program, one, "cold", NO_STORE, "save", cold, csv);
        measure(program, one, "blob", NO_STORE, "load", cold, csv);
        run_child(program, one, WITH_STORE, "none", ignored);
        measure(program, one, "disk", WITH_STORE, "none", runs, csv);
    }
    fclose(csv);
}
