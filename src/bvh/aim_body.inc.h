/* ---- one ray made ready, its three axes side by side (expanded once for each instruction set that has vectors, in its
   words: HYI_F4 is four floats) */

/* hyi_slab_bound along each axis, and the noise of a tree of triangles, for a ray that begins away from it. The fourth of what is loaded
   belongs to what comes after it in bvh: it is not used. */
HYI_INLINE HYI_TARGET HYI_F4 HYI_I(hyi_bound_from_afar)(hyi_aim *aim, const hyi_bvh *bvh, HYI_F4 o, uint32_t z) {
    const float *lower = bvh->scaled.lower, *upper = lower + 3;
    float reaches[4];
    HYI_F4 reach = HYI_MAX4(HYI_SIZE4(HYI_SUB4(HYI_LOAD4(lower), o)), HYI_SIZE4(HYI_SUB4(HYI_LOAD4(upper), o)));
    HYI_STORE4(reaches, reach);
    aim->noise = HYI_SHEAR_NOISE * (reaches[0] + reaches[1] + reaches[2]);
    HYI_F4 bound = HYI_MUL4(HYI_SET4(HYI_SLAB_BOUND), HYI_ADD4(reach, HYI_SET4(reaches[z])));
    return HYI_ADD4(bound, HYI_MUL4(HYI_SET4(2.0f * HYI_ULP), HYI_SIZE4(o)));
}

/* The same for any ray; false: it begins so far away that its origin has to be moved. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_slabs)(hyi_aim *aim, const hyi_accel *accel, const hyi_bvh *bvh, HYI_F4 o, uint32_t z, HYI_F4 *bound) {
    static const uint32_t near_by[4] = {0x53800000u, 0x53800000u, 0x53800000u, 0x7f7fffffu}; /* HYI_NEAR_BY; t_min is finite */
    const hyi_vicinity *vicinity = &accel->vicinity;
    if (!HYI_EXCEED4(HYI_SUB4(o, HYI_LOAD4(vicinity->middle)), vicinity->radius)) {
        *bound = HYI_LOAD4(vicinity->bound);
        aim->noise = vicinity->noise;
        return true;
    }
    if (HYI_EXCEED4(o, near_by)) return false;
    *bound = HYI_I(hyi_bound_from_afar)(aim, bvh, o, z);
    return true;
}

/* hyi_aim_slabs, by their bound. What is stored as four takes the place of what comes after it in aim, which is written later. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_aim_slabs)(hyi_aim *aim, HYI_F4 o, HYI_F4 d, HYI_F4 bound) {
    HYI_F4 inverse = HYI_DIV4(HYI_SET4(1.0f), HYI_SIGNED4(HYI_MAX4(HYI_SIZE4(d), HYI_SET4(HYI_STEADY)), d)), zero = HYI_SET4(0.0f);
    bound = HYI_SIGNED4(bound, d);
    HYI_STORE_PLACES4(aim->near_plane, d);
    HYI_STORE4(aim->far_offset, HYI_SUB4(zero, HYI_MUL4(HYI_SUB4(o, bound), inverse)));
    HYI_STORE4(aim->inverse, inverse);
    HYI_STORE4(aim->near_offset, HYI_SUB4(zero, HYI_MUL4(HYI_ADD4(o, bound), inverse)));
}

/* The largest component of a direction, without a branch, which would be guessed wrong half of the time. bits: of floats. */
HYI_INLINE uint32_t HYI_I(hyi_largest_axis)(const uint32_t bits[3]) {
    uint32_t x = bits[0] & 0x7fffffffu, y = bits[1] & 0x7fffffffu, z = bits[2] & 0x7fffffffu;
    uint32_t z_wins = (uint32_t)(z > x) & (uint32_t)(z > y);
    return 2u * z_wins | ((uint32_t)(y > x) & ~z_wins);
}

/* hyi_aim_at for a ray of direction d that is neither short nor long, o and d in the tree's units, but for its slabs and noise. What
   is stored as four takes the place of what comes after it in aim, which is written later. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_aim_frame)(hyi_aim *aim, HYI_F4 o, HYI_F4 d, uint32_t z) {
    static const hyi_turn turns[3] = {{{1, 2, 0, 0}, {4, 5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 0, 0, 0, 0}},
                                      {{2, 0, 1, 0}, {8, 9, 10, 11, 0, 1, 2, 3, 4, 5, 6, 7, 0, 0, 0, 0}},
                                      {{0, 1, 2, 0}, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 0, 0, 0, 0}}};
    HYI_STORE4(aim->origin, HYI_BYTES4(o, turns[z].bytes));
    memcpy(aim->axis, turns[z].axis, sizeof aim->axis);
    HYI_STORE4(aim->direction, HYI_BYTES4(d, turns[z].bytes));
    hyi_aim_along(aim);
    aim->leaf = aim->lane = 0;
    aim->unit = aim->inverse_unit = 1.0;
    aim->exact = 0;
}

/* hyi_flight_begin for most rays; false: it has to decide on this one, which is unsound, from afar, of a length far from 1,
   or in a tree of boxes. bvh: where the rays of accel begin. Bits are looked at, which fast-math leaves alone: what is not a number has
   more than all. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_begin_most)(hyi_flight *flight, const hyi_accel *accel, const hyi_bvh *bvh, const hyk_ray *ray) {
    static const uint32_t longest[4] = {0x4e800000u, 0x4e800000u, 0x4e800000u, 0x7f800000u};  /* HYI_LONGEST; t_max may be infinite */
    static const uint32_t shortest[4] = {0x30800000u, 0x30800000u, 0x30800000u, 0x7fffffffu}; /* HYI_SHORTEST */
    uint32_t direction[3];
    float t_min, t_max;
    memcpy(&direction[0], &ray->direction.x, sizeof direction[0]); /* one by one: together they would wait in memory */
    memcpy(&direction[1], &ray->direction.y, sizeof direction[1]);
    memcpy(&direction[2], &ray->direction.z, sizeof direction[2]);
    memcpy(&t_min, &ray->t_min, sizeof t_min);
    memcpy(&t_max, &ray->t_max, sizeof t_max);
    HYI_F4 scale = HYI_SET4(bvh->scale), o = HYI_MUL4(HYI_LOAD4(&ray->origin.x), scale), d = HYI_MUL4(HYI_LOAD4(&ray->direction.x), scale), bound;
    float limit = hyi_finite_limit(t_max);
    uint32_t z = HYI_I(hyi_largest_axis)(direction);
    if (HYI_EXCEED4(d, longest) || !HYI_EXCEED4(d, shortest) || !bvh->rows || !(t_min <= limit)) return false;
    if (!HYI_I(hyi_bound_slabs)(&flight->aim, accel, bvh, o, z, &bound)) return false;
    hyi_flight_clear(flight, ray, t_min, limit);
    HYI_I(hyi_aim_slabs)(&flight->aim, o, d, bound);
    HYI_I(hyi_aim_frame)(&flight->aim, o, d, z);
    flight->aim.t_near = t_min - 4.0f * HYI_ULP * fabsf(t_min);
    flight->aim.t_far = limit + 4.0f * HYI_ULP * fabsf(limit);
    return true;
}

#define HYI_FLIGHT_BEGIN(flight, accel, bvh, ray) (HYI_I(hyi_begin_most)(flight, accel, bvh, ray) || hyi_begin_any(flight, bvh, ray))
