/* main.c: hydra-render, a command-line renderer: options, import, commit, render, write */
#include "app.h"
#include "camera.h"
#include "environment.h"
#include "import.h"
#include "options.h"
#include "progress.h"
#include "report.h"

#include "hydra_vk.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct session {
    render_options options;
    hydra_context *context;
    hydra_scene *scene;
    hydra_render *render;
    imported scene_file;
    environment environment;
    report report;
} session;

static volatile sig_atomic_t stop_wanted;

/* The first Ctrl-C ends the picture, the second the program. */
static void on_interrupt(int signal_number) {
    (void)signal_number;
    stop_wanted = 1;
}

static void catch_interrupt(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_interrupt;
    action.sa_flags = (int)SA_RESETHAND;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

/* Errors are told where they are handled, with the file's name; warnings come from here. */
static void on_log(void *user, hydra_log_level level, const char *text) {
    (void)user;
    if (level == HYDRA_LOG_WARNING) app_warning("%s", text);
}

static int open_context(session *s) {
    hydra_context_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.log = on_log;
    desc.threads = s->options.threads;
    char why[256] = "";
    if (s->options.vulkan != NULL) {
        hydra_vk_desc device;
        memset(&device, 0, sizeof device);
        device.device_name = s->options.vulkan;
        device.error = why;
        device.error_size = sizeof why;
        hydra_vk_create(&desc, &device, &s->context);
    } else {
        s->context = hydra_create(&desc);
    }
    s->scene = s->context != NULL ? hydra_scene_create(s->context) : NULL;
    if (s->scene != NULL) return APP_DONE;
    app_error("hydra cannot start: %s", why[0] != '\0' ? why : hydra_error_text(s->context));
    return APP_DEVICE;
}

static int load(session *s) {
    double start = app_seconds();
    bool keep_meshes = (s->options.outputs & (1u << HYDRA_MESH_ID | 1u << HYDRA_INSTANCE_ID)) != 0;
    int code = environment_read(&s->environment, &s->options);
    if (code == APP_DONE) code = import_scene(&s->scene_file, s->context, s->scene, s->options.scene_path, keep_meshes);
    if (code == APP_DONE) code = environment_add(&s->environment, &s->options, &s->scene_file, s->context, s->scene);
    environment_free(&s->environment);
    s->report.load_seconds = app_seconds() - start;
    return code;
}

static int commit(session *s) {
    double start = app_seconds();
    hydra_result result = hydra_scene_commit(s->scene);
    s->report.commit_seconds = app_seconds() - start;
    if (result == HYDRA_OK) return APP_DONE;
    app_error("%s: %s", s->options.scene_path, hydra_error_text(s->context));
    return import_exit_code(result);
}

static int start_render(session *s) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    int code = camera_choose(&desc.sensor, &s->options, &s->scene_file, s->scene);
    if (code != APP_DONE) return code;
    desc.width = s->options.width;
    desc.height = s->options.height;
    desc.outputs = s->options.outputs;
    desc.target_error = s->options.error;
    desc.time_budget = s->options.seconds;
    desc.max_samples = s->options.spp;
    desc.max_depth = s->options.depth;
    desc.strategy = s->options.strategy;
    desc.seed = s->options.seed;
    s->render = hydra_render_create(s->scene, &desc);
    if (s->render != NULL) return APP_DONE;
    app_error("%s: cannot render %u x %u: %s", s->options.scene_path, (unsigned)desc.width, (unsigned)desc.height,
              hydra_error_text(s->context));
    hydra_estimate_result estimate;
    return hydra_estimate(s->scene, &desc, &estimate) == HYDRA_OK ? APP_DEVICE : APP_INPUT;
}

static int render(session *s) {
    progress bar;
    progress_begin(&bar);
    catch_interrupt();
    hydra_result result = HYDRA_MORE;
    while (result == HYDRA_MORE && !stop_wanted) {
        result = hydra_render_step(s->render);
        hydra_status status = hydra_render_status(s->render);
        progress_show(&bar, &status);
    }
    hydra_status status = hydra_render_status(s->render);
    progress_end(&bar, &status);
    if (result == HYDRA_OK) return APP_DONE;
    if (result == HYDRA_MORE || result == HYDRA_CANCELLED) return APP_STOPPED;
    app_error("rendering stopped: %s", hydra_error_text(s->context));
    return APP_DEVICE;
}

static int write_pictures(session *s) {
    double start = app_seconds();
    hydra_status status = hydra_render_status(s->render);
    char comment[160];
    snprintf(comment, sizeof comment, "hydra %d.%d, %.1f samples a pixel, relative error %.4f, 95 %% interval %.4f to %.4f",
             HYDRA_VERSION_MAJOR, HYDRA_VERSION_MINOR, status.samples, status.error, status.error_low, status.error_high);
    image_source source = {s->render, s->options.width, s->options.height, s->options.outputs, s->options.tone, comment};
    int code = APP_DONE;
    for (size_t i = 0; i < s->options.target_count; i++)
        if (!image_write(&s->options.targets[i], &source)) code = APP_USAGE;
    s->report.write_seconds = app_seconds() - start;
    return code;
}

/* What was rendered is written even when the rendering stopped early. */
static int render_and_write(session *s) {
    int code = render(s);
    int written = write_pictures(s);
    hydra_status status = hydra_render_status(s->render);
    if (s->options.stats) report_print(&s->report, &s->scene_file, s->context, s->scene, &status);
    return written != APP_DONE ? written : code;
}

static int run(session *s) {
    for (size_t i = 0; i < s->options.target_count; i++)
        if (!image_target_probe(&s->options.targets[i])) return APP_USAGE;
    int code = open_context(s);
    if (code == APP_DONE) code = load(s);
    if (code == APP_DONE) code = commit(s);
    if (code == APP_DONE) code = start_render(s);
    if (code == APP_DONE) code = render_and_write(s);
    return code;
}

int main(int argc, char **argv) {
    session s;
    memset(&s, 0, sizeof s);
    options_result parsed = options_parse(&s.options, argc, argv);
    if (parsed != OPTIONS_RUN) return parsed == OPTIONS_SHOWN ? APP_DONE : APP_USAGE;
    int code = run(&s);
    app_flush_warnings();
    hydra_render_destroy(s.render);
    hydra_scene_destroy(s.scene);
    hydra_destroy(s.context);
    import_free(&s.scene_file);
    return code;
}
