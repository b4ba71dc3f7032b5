#version 460
#extension GL_GOOGLE_include_directive : require
/* How a count that only the device knows is divided. */
#include "scan.glsl"

void main() {
    if (gl_GlobalInvocationID.x == 0u) hyk_plan = hyk_plan_scan(hyk_count[hyk_call.count_at], hyk_call.capacity);
}
