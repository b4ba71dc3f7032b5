/* What every pass's kernel begins with: the scene's buffers, the pool's buffers, and who this invocation is. */
#extension GL_KHR_shader_subgroup_ballot : require

#define HYK_GLSL 1
#include "passes.h"

layout(constant_id = 0) const uint hyk_features = 0xffffffffu; /* what the scene requires */
layout(constant_id = 4) const uint hyk_wants = 7u;             /* what the picture asks of its paths */
layout(local_size_x = HYK_GROUP) in;
layout(push_constant) uniform hyk_push { hyk_dispatch hyk_call; };

#define HYK_WORK(slot, access, name, type) layout(std430, set = 1, binding = slot) access buffer name##_buffer { type name[]; };
layout(std430, set = 1, binding = HYK_BINDING_PICTURE) readonly buffer hyk_picture_buffer { hyk_picture hyk_the_picture; };
HYK_WORK(HYK_BINDING_UNITS, readonly, hyk_units, hyk_unit)
HYK_WORK(HYK_BINDING_SENSOR, readonly, hyk_sensor, float)
layout(std430, set = 1, binding = HYK_BINDING_COUNTS) buffer hyk_counts_buffer { hyk_counts hyk_count; };
HYK_WORK(HYK_BINDING_QUEUES, , hyk_queues, uint)
HYK_WORK(HYK_BINDING_PATHS, , hyk_paths, hyk_path)
HYK_WORK(HYK_BINDING_HITS, , hyk_hits, hyk_hit)
HYK_WORK(HYK_BINDING_SHADOWS, , hyk_shadows, hyk_shadow)
HYK_WORK(HYK_BINDING_RADIANCE, , hyk_radiance, hyk_lane_radiance)
HYK_WORK(HYK_BINDING_EXTRAS, , hyk_extras, hyk_lane_extra)

#define HYK_ANY_EXTRA (HYK_WANTS_COMPONENTS | HYK_WANTS_IRRADIANCE | HYK_WANTS_SURFACE)

/* The picture's settings, what it wants being a constant. */
hyk_path_settings hyk_settings() { return hyk_path_settings(hyk_the_picture.settings.strategy, hyk_wants); }

/* Appends lane to a queue; all active invocations of a subgroup that have one get their places with one addition. */
#define HYK_APPEND(counter, queue, has_one, lane)                                             \
    {                                                                                          \
        uvec4 hyk_ballot = subgroupBallot(has_one);                                            \
        uint hyk_base = 0u;                                                                    \
        if (subgroupElect()) hyk_base = atomicAdd(counter, subgroupBallotBitCount(hyk_ballot)); \
        hyk_base = subgroupBroadcastFirst(hyk_base);                                           \
        if (has_one) hyk_queues[(queue) * hyk_call.pool_lanes + hyk_base + subgroupBallotExclusiveBitCount(hyk_ballot)] = lane; \
    }

hyk_ray hyk_given_ray(uint i) {
    uint at = 8u * i;
    return hyk_ray(vec3(hyk_sensor[at], hyk_sensor[at + 1u], hyk_sensor[at + 2u]), hyk_sensor[at + 3u],
                   vec3(hyk_sensor[at + 4u], hyk_sensor[at + 5u], hyk_sensor[at + 6u]), hyk_sensor[at + 7u]);
}

/* Clears what a lane gives back, and finds its pixel and sample; false: there is none. */
bool hyk_begin_lane(uint lane, out uint x, out uint y, out uint sample_number) {
    x = 0u;
    y = 0u;
    sample_number = 0u;
    if (lane >= hyk_call.lanes) return false;
    hyk_picture picture = hyk_the_picture;
    hyk_unit unit = hyk_units[lane / hyk_call.lanes_of_unit];
    uint place = lane % hyk_call.lanes_of_unit, pixel = place / unit.samples;
    x = unit.tile_x + hyk_tile_column(picture.tile_width, picture.tile_is_square, pixel);
    y = unit.tile_y + hyk_tile_row(picture.tile_width, picture.tile_is_square, pixel);
    sample_number = unit.first_sample + place % unit.samples;
    bool used = pixel < picture.tile_pixels && hyk_picture_holds(picture, x, y);
    hyk_radiance[lane] = hyk_lane_radiance(vec3(0.0), used ? HYK_LANE_USED : 0u);
    if ((hyk_wants & HYK_ANY_EXTRA) != 0u) {
        hyk_first_surface none = hyk_first_surface(vec3(0.0), 0.0, vec3(0.0), HYK_NONE, vec3(0.0), 0u);
        hyk_extras[lane] = hyk_lane_extra(vec3(0.0), HYK_NONE, vec3(0.0), HYK_NONE, vec3(0.0), 0u, none);
    }
    return used;
}

void hyk_gain(uint lane, uint component, vec3 radiance) {
    if (component == HYK_COMPONENT_DIRECT) hyk_radiance[lane].radiance += radiance;
    else if (component == HYK_COMPONENT_INDIRECT) hyk_extras[lane].indirect += radiance;
    else hyk_extras[lane].caustic += radiance;
}

/* What a vertex gave: light found, a shadow ray to cast, a path to go on with. */
void hyk_keep(hyk_scatter r, uint lane, bool alive) {
    bool split = (hyk_wants & HYK_WANTS_COMPONENTS) != 0u;
    bool shadow = alive && (r.flags & HYK_SCATTER_SHADOW) != 0u, goes_on = alive && (r.flags & HYK_SCATTER_CONTINUES) != 0u;
    if (alive) {
        if (!hyk_is_black(r.emitted)) hyk_gain(lane, split ? r.emitted_component : HYK_COMPONENT_DIRECT, r.emitted);
        if ((hyk_wants & HYK_WANTS_IRRADIANCE) != 0u) hyk_extras[lane].irradiance += r.emitted_irradiance;
        if ((hyk_wants & HYK_WANTS_SURFACE) != 0u && (r.flags & HYK_SCATTER_SURFACE) != 0u) hyk_extras[lane].first = r.first;
        if ((r.flags & HYK_SCATTER_INSIDE) != 0u) hyk_radiance[lane].flags |= HYK_LANE_INSIDE;
    }
    if (shadow) hyk_shadows[lane] = hyk_shadow(r.shadow, r.diffuse, split ? r.diffuse_component : HYK_COMPONENT_DIRECT, r.specular,
                                               split ? r.specular_component : HYK_COMPONENT_DIRECT, r.light_irradiance, 0u);
    if (goes_on) hyk_paths[lane] = r.next;
    HYK_APPEND(hyk_count.shadows_next, 2u, shadow, lane)
    HYK_APPEND(hyk_count.paths_next, 1u - hyk_count.front, goes_on, lane)
}
