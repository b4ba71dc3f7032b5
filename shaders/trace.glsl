/* What rays meet: of the living paths, to the lights, or of the caller. */
layout(constant_id = 3) const uint hyk_mode = HYK_TRACE_PATHS;
const bool hyk_any = (hyk_mode & 1u) != 0u;
#include "traverse.glsl"

uint hyk_ray_count() {
    return hyk_mode == HYK_TRACE_PATHS ? hyk_count.paths : hyk_mode == HYK_TRACE_SHADOWS ? hyk_count.shadows : hyk_call.lanes;
}

uint hyk_lane_at(uint i) {
    if (hyk_mode == HYK_TRACE_PATHS) return hyk_queues[hyk_count.front * hyk_call.pool_lanes + i];
    return hyk_mode == HYK_TRACE_SHADOWS ? hyk_queues[2u * hyk_call.pool_lanes + i] : i;
}

hyk_ray hyk_ray_of(uint lane) {
    if (hyk_mode == HYK_TRACE_PATHS) return hyk_paths[lane].ray;
    if (hyk_mode == HYK_TRACE_SHADOWS) return hyk_shadows[lane].ray; /* no ?: between a buffer's struct and a function's: glslang 12 mixes their types */
    return hyk_given_ray(lane);
}

void hyk_keep_first_hit(uint lane, hyk_hit hit) {
    if (hit.instance != HYK_NONE) hyk_radiance[lane].flags |= HYK_LANE_HIT;
    if ((hyk_wants & HYK_WANTS_SURFACE) == 0u) return;
    hyk_extras[lane].instance = hit.instance;
    hyk_extras[lane].primitive = hit.primitive;
}

void hyk_arrive(uint lane) {
    hyk_shadow light = hyk_shadows[lane];
    hyk_gain(lane, light.diffuse_component, light.diffuse);
    hyk_gain(lane, light.specular_component, light.specular);
    if ((hyk_wants & HYK_WANTS_IRRADIANCE) != 0u) hyk_extras[lane].irradiance += light.irradiance;
}

/* Which ray an invocation takes. Where workgroups are dealt to threads in runs, and not to whoever is free, neighbouring
   rays, which cost alike, go to different runs: pieces of 256 are taken sixteen apart. */
uint hyk_ray_taken(uint i, uint count) {
#ifdef HYK_RUNS_OF_GROUPS
    uint run = count / (16u * 256u), piece = i / 256u;
    if (piece < 16u * run) return (piece % run * 16u + piece / run) * 256u + i % 256u;
#endif
    return i;
}

void main() {
    uint i = gl_GlobalInvocationID.x, count = hyk_ray_count();
    if (i >= count) return;
    uint lane = hyk_lane_at(hyk_ray_taken(i, count));
    bool from_sensor = hyk_mode == HYK_TRACE_PATHS && (hyk_paths[lane].flags & HYK_PATH_FROM_SENSOR) != 0u;
    hyk_best best = hyk_trace(hyk_ray_of(lane), from_sensor);
    bool found = best.instance != HYK_NONE;
    hyk_hit hit = hyk_hit(found ? best.t : -1.0, best.u, best.v, best.instance, best.primitive);
    if (!hyk_any) hyk_hits[lane] = hit;
    if (from_sensor) hyk_keep_first_hit(lane, hit);
    if (hyk_mode == HYK_TRACE_SHADOWS && !found) hyk_arrive(lane);
    if (hyk_mode == HYK_TRACE_RAYS_ANY) hyk_queues[lane] = found ? 1u : 0u;
}
