#version 460
#extension GL_GOOGLE_include_directive : require
/* The first scattering of every lane of a batch whose sensor is a list of points. */
#include "passes.glsl"

vec3 hyk_given_vector(uint i) { return vec3(hyk_sensor[3u * i], hyk_sensor[3u * i + 1u], hyk_sensor[3u * i + 2u]); }

void main() {
    uint lane = gl_GlobalInvocationID.x, x, y, sample_number;
    bool used = hyk_begin_lane(lane, x, y, sample_number);
    hyk_scatter r = hyk_no_scatter();
    if (used) {
        hyk_picture picture = hyk_the_picture;
        uint point = y * picture.camera.width + x, points = picture.camera.width * picture.camera.height;
        hyk_path path = hyk_point_path(picture, hyk_lane_sampler(picture, x, y, sample_number), lane);
        r = hyk_shade_point(0u, hyk_settings(), path, hyk_given_vector(point), hyk_given_vector(points + point), hyk_features & HYK_NEEDS_AT_POINTS);
        hyk_radiance[lane].flags |= HYK_LANE_HIT;
    }
    hyk_keep(r, lane, used);
}
