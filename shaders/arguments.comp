#version 460
#extension GL_GOOGLE_include_directive : require
/* Between passes: what was appended becomes what is worked on, and the size of the next dispatches. */
#include "passes.glsl"

hyk_groups hyk_groups_for(uint lanes) { return hyk_groups((lanes + HYK_GROUP - 1u) / HYK_GROUP, 1u, 1u, 0u); }

void main() {
    if (gl_GlobalInvocationID.x != 0u) return;
    hyk_counts c = hyk_count;
    c.front = 1u - c.front;
    c.paths = c.paths_next;
    c.shadows = c.shadows_next;
    c.paths_next = 0u;
    c.shadows_next = 0u;
    c.path_groups = hyk_groups_for(c.paths);
    c.shadow_groups = hyk_groups_for(c.shadows);
    c.rays_path += c.paths;
    c.rays_shadow += c.shadows;
    hyk_count = c;
}
