/* >>render-sensor: sensor descriptors checked and turned into what kernels read */
#ifndef HYI_SENSOR_H
#define HYI_SENSOR_H

#include "../backend/chunk.h"
#include "../scene/queries.h"
#include "../scene/validate.h"

HYI_STATIC_ASSERT((int)HYK_SENSOR_PINHOLE == (int)HYDRA_SENSOR_PINHOLE && (int)HYK_SENSOR_THIN_LENS == (int)HYDRA_SENSOR_THIN_LENS &&
                  (int)HYK_SENSOR_ORTHOGRAPHIC == (int)HYDRA_SENSOR_ORTHOGRAPHIC && (int)HYK_SENSOR_POINTS == (int)HYDRA_SENSOR_POINTS &&
                  (int)HYK_SENSOR_EQUIRECTANGULAR == (int)HYDRA_SENSOR_EQUIRECTANGULAR && (int)HYK_SENSOR_RAYS == (int)HYDRA_SENSOR_RAYS);
HYI_STATIC_ASSERT((int)HYK_FILTER_BOX == (int)HYDRA_FILTER_BOX && (int)HYK_FILTER_TENT == (int)HYDRA_FILTER_TENT);

#define HYI_DEGREE 0.017453292519943295

HYI_FN bool hyi_is_perspective(hydra_sensor_kind kind) { return kind == HYDRA_SENSOR_PINHOLE || kind == HYDRA_SENSOR_THIN_LENS; }
HYI_FN bool hyi_is_list(hydra_sensor_kind kind) { return kind == HYDRA_SENSOR_POINTS || kind == HYDRA_SENSOR_RAYS; }

/* ---- checks */

HYI_FN hydra_result hyi_check_camera(hydra_context *context, const hydra_sensor_desc *d) {
    HYI_TRY(hyi_check_finite(context, d->position, 3, "sensor.position"));
    HYI_TRY(hyi_check_finite(context, d->target, 3, "sensor.target"));
    HYI_TRY(hyi_check_finite(context, d->up, 3, "sensor.up"));
    HYI_TRY(hyi_check_finite(context, d->shift, 2, "sensor.shift"));
    if (hyi_is_perspective(d->kind) && d->fov_y != 0.0f)
        HYI_TRY(hyi_check_range(context, d->fov_y, (float)(0.001 * HYI_DEGREE * 0.9999), (float)(179.9 * HYI_DEGREE * 1.0001), HYDRA_ERROR_SENSOR, "sensor.fov_y"));
    HYI_TRY(hyi_check_range(context, d->lens_radius, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.lens_radius"));
    HYI_TRY(hyi_check_range(context, d->focus_distance, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.focus_distance"));
    return hyi_check_range(context, d->ortho_height, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.ortho_height");
}

HYI_FN hydra_result hyi_check_list(hydra_context *context, hydra_view view, size_t size, uint64_t pixels, const char *what) {
    HYI_TRY(hyi_check_view(context, view, size, what));
    if (view.count != pixels) return hyi_fail(context, HYDRA_ERROR_COUNT, "%s has %zu elements, the image %llu pixels", what, view.count, (unsigned long long)pixels);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_sensor(hydra_context *context, const hydra_sensor_desc *d, uint32_t width, uint32_t height) {
    uint64_t pixels = (uint64_t)width * height;
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_SENSOR_RAYS + 1, "sensor.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->filter, HYDRA_FILTER_TENT + 1, "sensor.filter"));
    HYI_TRY(hyi_check_enum(context, (int)d->lightmap, HYDRA_LIGHTMAP_RADIOSITY + 1, "sensor.lightmap"));
    if (d->kind == HYDRA_SENSOR_RAYS) return hyi_check_list(context, d->rays, sizeof(hydra_ray), pixels, "sensor.rays");
    if (d->kind != HYDRA_SENSOR_POINTS) return hyi_check_camera(context, d);
    HYI_TRY(hyi_check_color(context, d->lightmap_albedo, 1.0f, "sensor.lightmap_albedo"));
    HYI_TRY(hyi_check_list(context, d->point_positions, 3 * sizeof(float), pixels, "sensor.point_positions"));
    return hyi_check_list(context, d->point_normals, 3 * sizeof(float), pixels, "sensor.point_normals");
}

/* ---- cameras */

HYI_FN void hyi_cross(const double a[3], const double b[3], double c[3]) {
    for (int i = 0; i < 3; i++) c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

HYI_FN bool hyi_unit(double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(largest > 0.0)) return false;
    for (int i = 0; i < 3; i++) v[i] /= largest;
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++) v[i] /= length;
    return true;
}

/* Axes of the camera in double; distance: from position to target. */
HYI_FN hydra_result hyi_camera_axes(hydra_context *context, const hydra_sensor_desc *d, hyk_camera *camera, double *distance) {
    double forward[3], up[3] = { 0.0, 1.0, 0.0 }, right[3], square = 0.0;
    for (int i = 0; i < 3; i++) forward[i] = (double)d->target[i] - (double)d->position[i];
    for (int i = 0; i < 3; i++) square += forward[i] * forward[i];
    *distance = sqrt(square);
    if (!hyi_unit(forward)) forward[2] = -1.0;
    if (!hyi_all_zero(d->up, 3))
        for (int i = 0; i < 3; i++) up[i] = (double)d->up[i];
    hyi_unit(up);
    hyi_cross(forward, up, right);
    if (fabs(right[0]) + fabs(right[1]) + fabs(right[2]) < 1e-9) return hyi_fail(context, HYDRA_ERROR_SENSOR, "sensor.up is along the view direction");
    hyi_unit(right);
    hyi_cross(right, forward, up);
    camera->right = hyk_make3((float)right[0], (float)right[1], (float)right[2]);
    camera->up = hyk_make3((float)up[0], (float)up[1], (float)up[2]);
    camera->forward = hyk_make3((float)forward[0], (float)forward[1], (float)forward[2]);
    return HYDRA_OK;
}

/* The cone of a pixel is taken half as wide as the pixel: mip levels then blur less than the pixel's own filter. */
#define HYI_CONE_SHARE 0.5f

HYI_FN hydra_result hyi_fill_camera(hydra_context *context, const hydra_sensor_desc *d, uint32_t width, uint32_t height, hyk_camera *camera) {
    memset(camera, 0, sizeof *camera);
    camera->kind = (uint32_t)d->kind;
    camera->filter_kind = (uint32_t)d->filter;
    camera->width = width;
    camera->height = height;
    if (hyi_is_list(d->kind)) return HYDRA_OK;
    double distance;
    HYI_TRY(hyi_camera_axes(context, d, camera, &distance));
    double aspect = (double)width / (double)height, half_height = 1.0;
    if (hyi_is_perspective(d->kind)) half_height = tan(0.5 * (d->fov_y != 0.0f ? (double)d->fov_y : 0.8));
    if (d->kind == HYDRA_SENSOR_ORTHOGRAPHIC) half_height = 0.5 * (d->ortho_height != 0.0f ? (double)d->ortho_height : 2.0);
    camera->position = hyk_make3(d->position[0], d->position[1], d->position[2]);
    camera->half_height = (float)half_height;
    camera->half_width = (float)(half_height * aspect);
    camera->shift_x = hyi_is_perspective(d->kind) ? (float)(2.0 * half_height * (double)d->shift[0]) : 0.0f;
    camera->shift_y = hyi_is_perspective(d->kind) ? (float)(2.0 * half_height * (double)d->shift[1]) : 0.0f;
    camera->lens_radius = d->lens_radius;
    camera->focus_distance = d->focus_distance != 0.0f ? d->focus_distance : distance > 0.0 ? (float)distance : 1.0f;
    float pixel = HYI_CONE_SHARE * 2.0f * camera->half_height / (float)height;
    if (d->kind == HYDRA_SENSOR_EQUIRECTANGULAR) pixel = HYI_CONE_SHARE * 3.1415927f / (float)height;
    if (d->kind == HYDRA_SENSOR_ORTHOGRAPHIC) camera->start_width = pixel;
    else camera->spread = pixel;
    return HYDRA_OK;
}

/* ---- lists: copied, so that the caller may free his own */

typedef struct hyi_sensor {
    float *positions, *normals;
    hydra_ray *rays;
    size_t count;
} hyi_sensor;

HYI_FN size_t hyi_sensor_bytes(hydra_sensor_kind kind, uint64_t pixels) {
    size_t each = kind == HYDRA_SENSOR_POINTS ? 6 * sizeof(float) : kind == HYDRA_SENSOR_RAYS ? sizeof(hydra_ray) : 0;
    return each * (size_t)pixels;
}

HYI_FN void hyi_sensor_free(hydra_context *context, hyi_sensor *sensor) {
    hyi_free_array(context, &sensor->positions, 3 * sensor->count);
    hyi_free_array(context, &sensor->normals, 3 * sensor->count);
    hyi_free_array(context, &sensor->rays, sensor->count);
}

HYI_FN hydra_result hyi_take_points(hydra_context *context, const hydra_sensor_desc *d, hyi_sensor *sensor) {
    HYI_TRY(hyi_copy_floats(context, d->point_positions, 3, &sensor->positions, "sensor.point_positions"));
    HYI_TRY(hyi_copy_floats(context, d->point_normals, 3, &sensor->normals, "sensor.point_normals"));
    for (size_t i = 0; i < sensor->count; i++) {
        float *n = sensor->normals + 3 * i;
        hyk_vec3 unit = hyk_normalize(hyk_make3(n[0], n[1], n[2]));
        if (hyk_length_squared(unit) < 0.5f) return hyi_fail(context, HYDRA_ERROR_SENSOR, "normal %zu has no direction", i);
        n[0] = unit.x;
        n[1] = unit.y;
        n[2] = unit.z;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_sensor_rays(hydra_context *context, const hydra_sensor_desc *d, hyi_sensor *sensor) {
    HYI_TRY(hyi_alloc_array(context, &sensor->rays, sensor->count));
    for (size_t i = 0; i < sensor->count; i++) {
        memcpy(&sensor->rays[i], hyi_view_at(d->rays, sizeof(hydra_ray), i), sizeof(hydra_ray));
        if (!hyi_was_sound((const hyk_ray *)(const void *)&sensor->rays[i])) return hyi_fail(context, HYDRA_ERROR_RAY, "ray %zu of the sensor", i);
    }
    return HYDRA_OK;
}

/* desc is checked. */
HYI_FN hydra_result hyi_take_sensor(hydra_context *context, const hydra_sensor_desc *d, uint64_t pixels, hyi_sensor *sensor) {
    memset(sensor, 0, sizeof *sensor);
    if (!hyi_is_list(d->kind)) return HYDRA_OK;
    sensor->count = (size_t)pixels;
    hydra_result result = d->kind == HYDRA_SENSOR_POINTS ? hyi_take_points(context, d, sensor) : hyi_take_sensor_rays(context, d, sensor);
    if (result != HYDRA_OK) hyi_sensor_free(context, sensor);
    return result;
}

#endif /* HYI_SENSOR_H */
