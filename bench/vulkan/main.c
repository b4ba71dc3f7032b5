/* Vulkan devices beside the processor: rays, paths, and how long the first sample takes.

       make bench-vulkan                     some minutes             QUICK=1 make bench-vulkan      under 45 seconds
       build/bench/vulkan [options] [files.obj]                       once the driver has compiled the shaders

       --only rays,paths,latency,films       --triangles 260k (of the generated scenes)       --reps 5
       --width 512 (primary rays: width^2)                              --side 256 (pictures: side^2 pixels)

   Sides are the scalar traversal and the best instruction set, each with one thread, two and all, and every device that
   hydra_vk_list_devices lists and that lacks nothing (lavapipe takes its threads from LP_NUM_THREADS). They take turns in
   every round; speeds are medians over rounds, and ratios medians of each round's ratio. Tables are also written to
   build/bench/vulkan_*.csv. */
#include "bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

void goal(const char *name, double measured, wish w, double target) {
    bool met = w == AT_LEAST ? measured >= target : measured <= target;
    printf("goal %s %.4g %.4g %s\n", name, measured, target, met ? "ok" : "short");
}

double processor_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

FILE *open_csv(const char *name, const char *header) {
    char path[128];
    snprintf(path, sizeof path, "build/bench/%s", name);
    FILE *file = fopen(path, "w");
    if (!file) bench_stop(path, "cannot be written");
    fprintf(file, "%s\n", header);
    return file;
}

static size_t number(const char *text) {
    char *end;
    double value = strtod(text, &end);
    return (size_t)(value * (*end == 'k' ? 1e3 : *end == 'm' ? 1e6 : 1.0));
}

static bool read_option(options *o, const char *name, const char *value) {
    if (!strcmp(name, "--only"))
        o->only = value;
    else if (!strcmp(name, "--triangles"))
        o->triangles = number(value);
    else if (!strcmp(name, "--reps"))
        o->repeats = atoi(value) < 1 ? 1 : atoi(value) > 64 ? 64 : atoi(value);
    else if (!strcmp(name, "--width"))
        o->width = (uint32_t)number(value);
    else if (!strcmp(name, "--side"))
        o->side = (uint32_t)number(value);
    else
        return false;
    return true;
}

static options read_options(int argc, char **argv) {
    const char *quick = getenv("QUICK");
    options o = {.repeats = 5, .triangles = 260000, .width = 512, .side = 256, .least_seconds = 0.1, .render_seconds = 2.0};
    o.quick = quick && *quick && strcmp(quick, "0");
    if (o.quick) o.triangles = 30000, o.width = 128, o.side = 128, o.least_seconds = 0.01, o.render_seconds = 0.1;
    for (int i = 1; i < argc; i++) {
        if (!strncmp(argv[i], "--", 2)) {
            if (i + 1 == argc || !read_option(&o, argv[i], argv[i + 1])) bench_stop(argv[i], "no such option, or it lacks its value");
            i++;
        } else if (o.file_count < (int)(sizeof o.files / sizeof o.files[0])) {
            o.files[o.file_count++] = argv[i];
        }
    }
    if (o.width < 8 || o.width > 4096 || (o.width & (o.width - 1))) bench_stop("--width", "a power of two, 8 to 4096");
    if (o.side < 1 || o.side > 4096) bench_stop("--side", "1 to 4096");
    if (o.triangles < 2000) bench_stop("--triangles", "at least 2000");
    return o;
}

static bool wanted(const options *o, const char *part) { return !o->only || strstr(o->only, part); }

/* Where drivers keep compiled shaders, if the user has no other wish: of ours, so that runs find what runs before made. */
static void keep_shaders(void) {
    setenv("MESA_SHADER_CACHE_DIR", "build/bench/shader_cache", 0);
    setenv("__GL_SHADER_DISK_CACHE_PATH", "build/bench/shader_cache", 0);
}

int main(int argc, char **argv) {
    static sides s;
    if (argc > 1 && !strcmp(argv[1], "--latency")) return latency_child(argc - 2, argv + 2);
    options o = read_options(argc, argv);
    mkdir("build", 0777);
    mkdir("build/bench", 0777);
    mkdir("build/bench/shader_cache", 0777);
    keep_shaders();
    sides_find(&s);
    setvbuf(stdout, NULL, _IOLBF, 0);
    printf("hydra %d.%d; %d rounds, speeds and ratios are medians\n", HYDRA_VERSION_MAJOR, HYDRA_VERSION_MINOR, o.repeats);
    if (wanted(&o, "latency")) bench_latency(&o, &s, argv[0]);
    if (wanted(&o, "rays")) bench_rays(&o, &s);
    if (wanted(&o, "paths")) bench_paths(&o, &s);
    if (wanted(&o, "films")) bench_films(&o, &s);
    return 0;
}
