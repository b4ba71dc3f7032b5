#version 460
#extension GL_GOOGLE_include_directive : require
/* The first ray of every lane of a batch, from a camera or a list of rays. */
#include "passes.glsl"

void main() {
    uint lane = gl_GlobalInvocationID.x, x, y, sample_number;
    bool used = hyk_begin_lane(lane, x, y, sample_number);
    if (used) {
        hyk_picture picture = hyk_the_picture;
        hyk_sampler random = hyk_lane_sampler(picture, x, y, sample_number);
        hyk_ray ray;
        if (picture.camera.kind == HYK_SENSOR_RAYS) ray = hyk_callers_ray(hyk_given_ray(y * picture.camera.width + x));
        else ray = hyk_sensor_ray(picture.camera, x, y, random);
        hyk_paths[lane] = hyk_first_path(picture, ray, random, lane, hyk_features);
    }
    HYK_APPEND(hyk_count.paths_next, 1u - hyk_count.front, used, lane)
}
