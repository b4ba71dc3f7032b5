/* camera.c: see camera.h */
#include "camera.h"

#include "app.h"
#include "json.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float pi = 3.14159265f;

/* What a camera wants the picture's size to be; 0: it does not care. */
typedef struct frame {
    float aspect;
    uint32_t width, height;
} frame;

static float radians(float degrees) { return degrees * (pi / 180.0f); }

static void choose_size(render_options *options, const frame *wish) {
    float aspect = wish->aspect > 0.01f && wish->aspect < 100.0f ? wish->aspect : 16.0f / 9.0f;
    if (options->width == 0 && options->height == 0 && wish->width > 0 && wish->height > 0) {
        options->width = wish->width;
        options->height = wish->height;
    }
    if (options->width == 0 && options->height == 0) options->width = 1280;
    if (options->height == 0) options->height = (uint32_t)fmaxf((float)options->width / aspect + 0.5f, 1.0f);
    if (options->width == 0) options->width = (uint32_t)fmaxf((float)options->height * aspect + 0.5f, 1.0f);
}

/* A point far enough ahead that float keeps the direction. */
static void look_along(hydra_sensor_desc *sensor, const float forward[3]) {
    const float *p = sensor->position;
    float length = sqrtf(forward[0] * forward[0] + forward[1] * forward[1] + forward[2] * forward[2]);
    float reach = 1.0f + fabsf(p[0]) + fabsf(p[1]) + fabsf(p[2]);
    for (int i = 0; i < 3; i++) sensor->target[i] = p[i] + (length > 0.0f ? forward[i] / length : i == 2 ? -1.0f : 0.0f) * reach;
}

/* The vertical angle under which the picture shows the horizontal one. */
static float vertical_angle(float horizontal, const render_options *options) {
    return 2.0f * atanf(tanf(0.5f * horizontal) * (float)options->height / (float)options->width);
}

/* ---------------------------------------------------------------- px,py,pz,tx,ty,tz[,fov] */

static bool from_numbers(hydra_sensor_desc *sensor, render_options *options) {
    float numbers[7];
    size_t count = options_numbers(options->camera, numbers, 6, 7);
    frame wish = {0.0f, 0, 0};
    if (count == 0) return false;
    memcpy(sensor->position, numbers, sizeof sensor->position);
    memcpy(sensor->target, numbers + 3, sizeof sensor->target);
    if (count == 7) sensor->fov_y = radians(numbers[6]);
    choose_size(options, &wish);
    return true;
}

/* ---------------------------------------------------------------- FILE.json */

/* True when right is not forward x up but its opposite: the picture would have to be mirrored. */
static bool is_mirrored(const float right[3], const float up[3], const float forward[3]) {
    float sum = 0.0f;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        sum += right[i] * (forward[j] * up[k] - forward[k] * up[j]);
    }
    return sum < 0.0f;
}

static bool read_json_camera(hydra_sensor_desc *sensor, render_options *options, const json_document *json) {
    uint32_t camera = json_get(json, 0, "camera");
    if (camera == JSON_NONE) camera = 0;
    float right[3], forward[3];
    bool good = json_numbers(json, json_get(json, camera, "origin"), sensor->position, 3) == 3 &&
                json_numbers(json, json_get(json, camera, "up"), sensor->up, 3) == 3 &&
                json_numbers(json, json_get(json, camera, "forward"), forward, 3) == 3;
    float angle = (float)json_number(json, json_get(json, camera, "hfov_deg"), 0.0);
    if (!good || !(angle > 0.0f && angle < 180.0f)) return false;
    double width = json_number(json, json_get(json, camera, "width"), 0.0);
    double height = json_number(json, json_get(json, camera, "height"), 0.0);
    frame wish = {0.0f, 0, 0};
    if (width >= 1.0 && width <= 65536.0 && height >= 1.0 && height <= 65536.0) {
        wish.width = (uint32_t)width;
        wish.height = (uint32_t)height;
        wish.aspect = (float)(width / height);
    }
    choose_size(options, &wish);
    look_along(sensor, forward);
    sensor->fov_y = vertical_angle(radians(angle), options);
    if (json_numbers(json, json_get(json, camera, "right"), right, 3) == 3 && is_mirrored(right, sensor->up, forward))
        app_warning("%s: its camera is mirrored (right is not forward x up); the picture is not", options->camera);
    return true;
}

static int from_json(hydra_sensor_desc *sensor, render_options *options) {
    size_t size;
    char *text = app_read_file(options->camera, (size_t)256 << 20, &size);
    if (text == NULL) return APP_INPUT;
    json_document json;
    const char *wrong = json_parse(&json, text, size);
    bool good = wrong == NULL && read_json_camera(sensor, options, &json);
    if (wrong != NULL)
        app_error("%s: not JSON: %s", options->camera, wrong);
    else if (!good)
        app_error("%s: has no camera with origin, up, forward and hfov_deg in 0..180", options->camera);
    json_free(&json);
    free(text);
    return good ? APP_DONE : APP_INPUT;
}

/* ---------------------------------------------------------------- cameras of the scene file */

static int from_scene(hydra_sensor_desc *sensor, render_options *options, const scene_camera *camera) {
    frame wish = {camera->aspect, 0, 0};
    choose_size(options, &wish);
    memcpy(sensor->position, camera->position, sizeof sensor->position);
    memcpy(sensor->up, camera->up, sizeof sensor->up);
    look_along(sensor, camera->forward);
    if (camera->ortho_height > 0.0f) {
        sensor->kind = HYDRA_SENSOR_ORTHOGRAPHIC;
        sensor->ortho_height = camera->ortho_height;
    } else if (camera->fov_y > 0.0f) {
        sensor->fov_y = camera->fov_y;
    } else if (camera->fov_x > 0.0f && camera->fov_x < pi) {
        sensor->fov_y = vertical_angle(camera->fov_x, options);
    }
    return APP_DONE;
}

static int from_name(hydra_sensor_desc *sensor, render_options *options, const imported *scene_file) {
    char *end;
    unsigned long index = strtoul(options->camera, &end, 10);
    bool numbered = isdigit((unsigned char)options->camera[0]) && *end == '\0';
    for (size_t i = 0; i < scene_file->camera_count; i++)
        if (numbered ? i == index : strcmp(scene_file->cameras[i].name, options->camera) == 0)
            return from_scene(sensor, options, &scene_file->cameras[i]);
    app_error("--camera %s: the scene has %zu cameras, none of this name or number%s", options->camera, scene_file->camera_count,
              scene_file->camera_count > 0 ? ":" : "; give px,py,pz,tx,ty,tz");
    for (size_t i = 0; i < scene_file->camera_count; i++) app_error("  %zu  %s", i, scene_file->cameras[i].name);
    return APP_USAGE;
}

/* ---------------------------------------------------------------- all in view */

static float dot(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* How far back along the unit vector z the eye must stand from the middle for all corners of the box, of these half
   sizes, to lie inside the picture: a corner at (x, y, z) needs |x| <= (distance - z) tan of the half angle. */
static float distance_for(const float half[3], const float axes[3][3], const float tangents[2]) {
    float distance = 0.0f;
    for (int corner = 0; corner < 8; corner++) {
        float p[3];
        for (int i = 0; i < 3; i++) p[i] = (corner >> i & 1) != 0 ? half[i] : -half[i];
        for (int axis = 0; axis < 2; axis++) distance = fmaxf(distance, fabsf(dot(p, axes[axis])) / tangents[axis] + dot(p, axes[2]));
    }
    return distance;
}

/* From the front, a little from above and from the right. */
static int from_bounds(hydra_sensor_desc *sensor, render_options *options, const hydra_scene *scene) {
    static const float axes[3][3] = {{0.9437f, 0.0f, -0.3308f}, {-0.0907f, 0.9617f, -0.2588f}, {0.3181f, 0.2742f, 0.9075f}};
    hydra_scene_info info;
    frame wish = {0.0f, 0, 0};
    hydra_scene_get_info(scene, &info);
    choose_size(options, &wish);
    sensor->fov_y = radians(35.0f);
    float half[3], tangents[2];
    for (int i = 0; i < 3; i++) {
        half[i] = 0.5f * info.bounds_max[i] - 0.5f * info.bounds_min[i];
        sensor->target[i] = 0.5f * info.bounds_max[i] + 0.5f * info.bounds_min[i];
    }
    tangents[1] = tanf(0.5f * sensor->fov_y) / 1.08f; /* some air around it */
    tangents[0] = tangents[1] * (float)options->width / (float)options->height;
    float distance = distance_for(half, axes, tangents);
    if (!(distance > 0.0f)) distance = 1.0f;
    for (int i = 0; i < 3; i++) sensor->position[i] = sensor->target[i] + axes[2][i] * distance;
    return APP_DONE;
}

int camera_choose(hydra_sensor_desc *sensor, render_options *options, const imported *scene_file, const hydra_scene *scene) {
    memset(sensor, 0, sizeof *sensor);
    sensor->kind = HYDRA_SENSOR_PINHOLE;
    if (options->camera == NULL && scene_file->camera_count > 0) return from_scene(sensor, options, &scene_file->cameras[0]);
    if (options->camera == NULL) return from_bounds(sensor, options, scene);
    if (from_numbers(sensor, options)) return APP_DONE;
    size_t length = strlen(options->camera);
    if (length > 5 && strcmp(options->camera + length - 5, ".json") == 0) return from_json(sensor, options);
    return from_name(sensor, options, scene_file);
}
