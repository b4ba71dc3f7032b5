/* ---- one ray made ready, its three axes side by side (expanded once for each instruction set that has vectors, in its
   words: HYI_F4 is four floats) */

/* hyi_aim_slabs for a tree of triangles. The fourth of what is loaded and stored belongs to what comes after it in bvh and in
   aim: it is not used there, and overwritten here. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_aim_slabs)(hyi_aim *aim, const hyi_bvh *bvh, HYI_F4 o, HYI_F4 d, uint32_t z) {
    const float *lower = bvh->scaled.lower, *upper = lower + 3;
    float reaches[4];
    HYI_F4 reach = HYI_MAX4(HYI_SIZE4(HYI_SUB4(HYI_LOAD4(lower), o)), HYI_SIZE4(HYI_SUB4(HYI_LOAD4(upper), o)));
    HYI_STORE4(reaches, reach);
    aim->noise = HYI_SHEAR_NOISE * (reaches[0] + reaches[1] + reaches[2]);
    HYI_F4 inverse = HYI_DIV4(HYI_SET4(1.0f), HYI_SIGNED4(HYI_MAX4(HYI_SIZE4(d), HYI_SET4(HYI_STEADY)), d)), zero = HYI_SET4(0.0f);
    HYI_F4 bound = HYI_MUL4(HYI_SET4(HYI_SLAB_BOUND), HYI_ADD4(reach, HYI_SET4(reaches[z])));
    bound = HYI_SIGNED4(HYI_ADD4(bound, HYI_MUL4(HYI_SET4(2.0f * HYI_ULP), HYI_SIZE4(o))), d);
    HYI_STORE4(aim->inverse, inverse);
    HYI_STORE4(aim->near_offset, HYI_SUB4(zero, HYI_MUL4(HYI_ADD4(o, bound), inverse)));
    HYI_STORE4(aim->far_offset, HYI_SUB4(zero, HYI_MUL4(HYI_SUB4(o, bound), inverse)));
}

/* The largest component of a direction, without a branch, which would be guessed wrong half of the time. bits: of floats. */
HYI_INLINE uint32_t HYI_I(hyi_largest_axis)(const uint32_t bits[3]) {
    uint32_t x = bits[0] & 0x7fffffffu, y = bits[1] & 0x7fffffffu, z = bits[2] & 0x7fffffffu;
    uint32_t z_wins = (uint32_t)(z > x) & (uint32_t)(z > y);
    return 2u * z_wins | ((uint32_t)(y > x) & ~z_wins);
}

/* hyi_aim_at for a ray of direction d that is neither short nor long, o and d in the tree's units. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_aim_near)(hyi_aim *aim, const hyi_bvh *bvh, HYI_F4 o, HYI_F4 d, uint32_t z, float t_min, float t_max) {
    float origin[4], direction[4];
    HYI_STORE4(origin, o);
    HYI_STORE4(direction, d);
    HYI_I(hyi_aim_slabs)(aim, bvh, o, d, z);
    aim->t_near = t_min - 4.0f * HYI_ULP * fabsf(t_min);
    aim->t_far = t_max + 4.0f * HYI_ULP * fabsf(t_max);
    aim->axis[0] = 0x09u >> 2u * z & 3u; /* 1, 2, 0 */
    aim->axis[1] = 0x12u >> 2u * z & 3u; /* 2, 0, 1 */
    aim->axis[2] = z;
    for (uint32_t a = 0; a < 3; a++) {
        aim->near_plane[a] = HYI_WIDTH * (2u * a + (aim->inverse[a] < 0.0f ? 1u : 0u));
        aim->origin[a] = origin[aim->axis[a]];
        aim->direction[a] = direction[aim->axis[a]];
    }
    hyi_aim_along(aim);
    aim->unit = aim->inverse_unit = 1.0;
    aim->exact = 0;
}

/* Whether the bits of a float's size are between those of two others; what is not a number has more than all, and fast-math leaves
   integers alone. */
HYI_INLINE bool HYI_I(hyi_size_within)(float value, float least, float most) {
    uint32_t bits, low, high;
    memcpy(&bits, &value, sizeof bits);
    memcpy(&low, &least, sizeof low);
    memcpy(&high, &most, sizeof high);
    bits &= 0x7fffffffu;
    return low <= bits && bits <= high;
}

/* hyi_flight_begin for most rays; false: it has to decide on this one, which is unsound, from afar, of a length far from 1,
   or in a tree of boxes. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_begin_most)(hyi_flight *flight, const hyi_bvh *bvh, const hyk_ray *ray) {
    uint32_t bits[8];
    float t_min, t_max, origin[4], direction[4];
    memcpy(bits, ray, sizeof bits); /* origin, t_min, direction, t_max */
    memcpy(&t_min, &bits[3], sizeof t_min);
    memcpy(&t_max, &bits[7], sizeof t_max);
    HYI_F4 scale = HYI_SET4(bvh->scale), o = HYI_MUL4(HYI_LOAD4(&ray->origin.x), scale), d = HYI_MUL4(HYI_LOAD4(&ray->direction.x), scale);
    uint32_t z = HYI_I(hyi_largest_axis)(bits + 4);
    HYI_STORE4(origin, o);
    HYI_STORE4(direction, d);
    float limit = hyi_finite_limit(t_max);
    if (!HYI_I(hyi_size_within)(direction[z], HYI_SHORTEST, HYI_LONGEST) || (bits[7] & 0x7fffffffu) > 0x7f800000u || !bvh->rows) return false;
    if (!HYI_I(hyi_size_within)(t_min, 0.0f, FLT_MAX) || !(t_min <= limit)) return false;
    for (uint32_t a = 0; a < 3; a++)
        if (!HYI_I(hyi_size_within)(origin[a], 0.0f, HYI_NEAR_BY)) return false;
    hyi_flight_clear(flight, ray, t_min, limit);
    HYI_I(hyi_aim_near)(&flight->aim, bvh, o, d, z, t_min, limit);
    return true;
}

#define HYI_FLIGHT_BEGIN(flight, bvh, ray) (HYI_I(hyi_begin_most)(flight, bvh, ray) || hyi_begin_any(flight, bvh, ray))
