#version 460
#extension GL_GOOGLE_include_directive : require
/* A vertex of every path whose ray has been traced. */
#include "passes.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    bool alive = i < hyk_count.paths;
    hyk_scatter r = hyk_no_scatter();
    uint lane = 0u;
    if (alive) {
        lane = hyk_queues[hyk_count.front * hyk_call.pool_lanes + i];
        r = hyk_shade(0u, hyk_settings(), hyk_paths[lane], hyk_hits[lane], hyk_features);
    }
    hyk_keep(r, lane, alive);
}
