/* What the two kernels of a film begin with: its buffers. */
#define HYK_GLSL 1
#include "film.h"

layout(constant_id = 0) const uint hyk_parts = 0u;  /* planes and ids that the film has */
layout(constant_id = 3) const uint hyk_judged = 0u; /* 1: pixels tell the scatter of each unit's samples */
layout(constant_id = 4) const uint hyk_wants = 0u;  /* as in passes.glsl; 0: there are no extras */
layout(local_size_x = HYK_GROUP) in;
layout(push_constant) uniform hyk_push { hyk_film_call hyk_call; };

#define HYK_FILM(slot, access, name, type) layout(std430, set = 0, binding = slot) access buffer name##_buffer { type name[]; };
layout(std430, set = 0, binding = HYK_BINDING_FILM_PICTURE) readonly buffer hyk_picture_buffer { hyk_picture hyk_the_picture; };
HYK_FILM(HYK_BINDING_FILM_PIXELS, , hyk_pixels, hyk_pixel)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_DIRECT, , hyk_direct, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_INDIRECT, , hyk_indirect, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_CAUSTIC, , hyk_caustic, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_IRRADIANCE, , hyk_irradiance, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_ALBEDO, , hyk_albedo, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_NORMAL, , hyk_normal, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_POSITION, , hyk_position, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_PLANES + HYK_PLANE_DEPTH, , hyk_depth, hyk_sum3)
HYK_FILM(HYK_BINDING_FILM_IDS, , hyk_film_ids, hyk_ids)
HYK_FILM(HYK_BINDING_FILM_OUT, writeonly, hyk_out, uint)

void hyk_put_double(uint i, double x) {
    uvec2 words = unpackDouble2x32(x);
    hyk_out[2u * i] = words.x;
    hyk_out[2u * i + 1u] = words.y;
}

/* ---- three sums of a pixel: of a plane, or of one half of the radiance */

#define HYK_RADIANCE HYK_PLANES /* as if it were a plane */
#define HYK_EACH_PLANE(X) \
    X(DIRECT, direct) X(INDIRECT, indirect) X(CAUSTIC, caustic) X(IRRADIANCE, irradiance) X(ALBEDO, albedo) X(NORMAL, normal) X(POSITION, position) X(DEPTH, depth)

uint hyk_index; /* the pixel, in the film */

bool hyk_has(uint plane) { return (hyk_parts >> plane & 1u) != 0u; }
bool hyk_is_pair(uint plane) { return plane <= HYK_PLANE_IRRADIANCE; }
uint hyk_parts_of(uint plane) { return hyk_is_pair(plane) || plane == HYK_RADIANCE ? 2u : 1u; }

hyk_sum3 hyk_load_radiance(uint part) {
    uint first = 3u * part, top = hyk_pixels[hyk_index].rgb_tops >> 16u * part & 0xffffu;
    return hyk_sum3(hyk_lanes[3](hyk_pixels[hyk_index].rgb[first], hyk_pixels[hyk_index].rgb[first + 1u], hyk_pixels[hyk_index].rgb[first + 2u]), top, 0u);
}

#define HYK_LOAD_CASE(name, sums) case HYK_PLANE_##name: if (hyk_has(HYK_PLANE_##name)) sum = hyk_##sums[at]; break;
hyk_sum3 hyk_load_sum(uint plane, uint part) {
    uint at = hyk_is_pair(plane) ? 2u * hyk_index + part : hyk_index;
    hyk_sum3 sum;
    switch (plane) {
    HYK_EACH_PLANE(HYK_LOAD_CASE)
    default: sum = hyk_load_radiance(part);
    }
    return sum;
}
