/* ---- rays made ready, as many at a time as a vector has lanes (expanded once for each instruction set) */

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_negative)(HYI_FW v) { return HYI_SUBW(HYI_ZEROW(), v); }

/* Where slabs are met of which the origin is moved by bound, which has the direction's sign: see hyi_aim_slabs. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_store_offsets)(HYI_FW origin, HYI_FW bound, HYI_FW inverse, float *near_offset, float *far_offset) {
    HYI_FW back = HYI_I(hyi_negative)(inverse);
    HYI_STOREW(near_offset, HYI_MULW(HYI_ADDW(origin, bound), back));
    HYI_STOREW(far_offset, HYI_MULW(HYI_SUBW(origin, bound), back));
}

/* The least and the greatest of all lanes, which are the same where these are coordinates of a camera. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_range)(const float lanes[HYI_PACKET_WIDTH], float *least, float *greatest) {
    HYI_FW v = HYI_LOADW(lanes);
    *least = *greatest = lanes[0];
    if (HYI_BITSW(HYI_SAMEW(v, HYI_SETW(lanes[0]))) == HYI_ALLW) return;
    *least = HYI_LEASTW(v);
    *greatest = HYI_GREATESTW(v);
}

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        float least = HYI_LEASTW(shear), greatest = HYI_GREATESTW(shear), middle = 0.5f * (least + greatest);
        packet->shear_middle[a] = middle;
        packet->shear_half[a] = greatest - middle > middle - least ? greatest - middle : middle - least;
        if (!(greatest - least <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        HYI_I(hyi_range)(o[a], &low[a], &high[a]);
        extent = box->upper[a] - box->lower[a] > extent ? box->upper[a] - box->lower[a] : extent;
    }
    float below = hyi_reach(box, low[axis], (int)axis, false), above = hyi_reach(box, high[axis], (int)axis, false);
    z = below > above ? below : above;
    for (int a = 0; a < 3; a++) {
        if (!(high[a] - low[a] <= HYI_PACKET_ORIGINS * extent)) return false;
        if (high[a] > low[a]) packet->spread = 1;
        float from_low = hyi_reach(box, low[a], a, false), from_high = hyi_reach(box, high[a], a, false);
        float size = fabsf(low[a]) > fabsf(high[a]) ? fabsf(low[a]) : fabsf(high[a]);
        float bound = hyi_slab_bound(from_low > from_high ? from_low : from_high, z, size);
        bool falls = (packet->group >> a & 1u) != 0u;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a], HYI_LOADW(inverse[a]));
        HYI_I(hyi_store_offsets)(HYI_LOADW(o[a]), HYI_SETW(falls ? -bound : bound), HYI_LOADW(inverse[a]), packet->near_offset[a], packet->far_offset[a]);
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    HYI_STOREW(packet->least_t, HYI_LOADW(packet->best_t));
    packet->waiting = 0;
    packet->many_children = HYI_MANY_CHILDREN;
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* HYI_LANES rays as they came, in the units of a tree. */
typedef struct HYI_I(hyi_block) {
    HYI_FW origin[3], direction[3], size[3]; /* size of each direction component */
    HYI_FW t_min, t_limit;
    HYI_MW falls[3], y, z; /* signs of the direction; its largest component is z, or else y, or else x */
} HYI_I(hyi_block);

/* A whole number in all lanes: these are only moved, and chosen from. */
HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_whole)(uint32_t value) {
    float bits;
    memcpy(&bits, &value, sizeof bits);
    return HYI_SETW(bits);
}

/* Bits of lanes that are within -limit and limit; what is not a number is not. Integers are compared: with fast-math, a comparison
   of floats may take it for one. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_within)(HYI_FW v, HYI_FW limit) {
    return HYI_BITSW(HYI_SAMEW(HYI_MAXW_AS_INTS(HYI_SIZEW(v), limit), limit));
}

/* HYI_LANES successive rays; false: some are unsound, or of uncommon size. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_block)(const hyi_bvh *bvh, const hyk_ray *rays, HYI_I(hyi_block) *block) {
    float words[8][HYI_PACKET_WIDTH];
    HYI_RAY_WORDS(rays, words);
    HYI_FW scale = HYI_SETW(bvh->scale), t_max = HYI_LOADW(words[7]);
    block->t_min = HYI_LOADW(words[3]);
    block->t_limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT));
    uint32_t fit = HYI_I(hyi_within)(block->t_min, HYI_SETW(FLT_MAX)) & HYI_I(hyi_within)(t_max, HYI_I(hyi_whole)(0x7f800000u)); /* may be infinite */
    fit &= HYI_BITSW(HYI_LEW(block->t_min, block->t_limit)) & HYI_BITSW(HYI_LEW(block->t_min, t_max));
    for (uint32_t a = 0; a < 3; a++) {
        block->origin[a] = HYI_MULW(HYI_LOADW(words[a]), scale);
        block->direction[a] = HYI_MULW(HYI_LOADW(words[4u + a]), scale);
        block->size[a] = HYI_SIZEW(block->direction[a]);
        block->falls[a] = HYI_LTW(block->direction[a], HYI_ZEROW());
        fit &= HYI_I(hyi_within)(block->origin[a], HYI_SETW(HYI_NEAR_BY)) & HYI_I(hyi_within)(block->direction[a], HYI_SETW(HYI_LONGEST));
    }
    HYI_FW of_two = HYI_MAXW(block->size[0], block->size[1]);
    block->y = HYI_LTW(block->size[0], block->size[1]);
    block->z = HYI_LTW(of_two, block->size[2]);
    return (fit & HYI_BITSW(HYI_LEW(HYI_SETW(HYI_SHORTEST), HYI_MAXW(of_two, block->size[2])))) == HYI_ALLW;
}

/* hyi_aim_group of each lane, as a number. */
HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_find_groups)(const HYI_I(hyi_block) *block) {
    HYI_FW zero = HYI_ZEROW(), group = HYI_CHOOSEW(block->z, HYI_SETW(16.0f), HYI_CHOOSEW(block->y, HYI_SETW(8.0f), zero));
    for (uint32_t a = 0; a < 3; a++) group = HYI_ADDW(group, HYI_CHOOSEW(block->falls[a], HYI_SETW((float)(1u << a)), zero));
    return group;
}

/* Of values by axis of space, that of axis k in the sheared frame of each ray: see hyi_aim_shear. */
HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_turn)(const HYI_I(hyi_block) *block, const HYI_FW v[3], uint32_t k) {
    return HYI_CHOOSEW(block->z, v[k], HYI_CHOOSEW(block->y, v[(k + 2u) % 3u], v[(k + 1u) % 3u]));
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_LOADH(packet->direction[2], half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_LOADH(packet->direction[i], half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_fill_packet)(const HYI_I(hyi_block) *block, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW sign = HYI_CHOOSEW(block->falls[a], HYI_SETW(-1.0f), HYI_SETW(1.0f));
        HYI_STOREW(o[a], block->origin[a]);
        HYI_STOREW(inverse[a], HYI_DIVW(sign, HYI_MAXW(block->size[a], HYI_SETW(HYI_STEADY))));
        HYI_STOREW(packet->origin[a], HYI_I(hyi_turn)(block, block->origin, a));
        HYI_STOREW(packet->direction[a], HYI_I(hyi_turn)(block, block->direction, a));
    }
    HYI_STOREW(packet->t_min, block->t_min);
    HYI_STOREW(packet->best_t, block->t_limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(block->t_min, HYI_MULW(HYI_SIZEW(block->t_min), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(block->t_limit, HYI_MULW(HYI_SIZEW(block->t_limit), slack)));
    HYI_I(hyi_shear_packet)(packet);
}

/* Makes a packet of the rays in live, which are of one group, out of what was filled in; first: the number of the block's first
   ray; false: they are too different. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_bvh *bvh, hyi_packet *packet, uint32_t first, uint32_t live, uint32_t group,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    packet->group = group;
    if (!HYI_I(hyi_bound_packet)(&bvh->scaled, packet, o, inverse)) return false;
    packet->live = live;
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
        packet->leaf.word[i] = packet->triangle.word[i] = 0;
    }
    return true;
}

/* Gives the lanes that are not live the value of one that is. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_spread_value)(float to[HYI_PACKET_WIDTH], const float from[HYI_PACKET_WIDTH], HYI_MW live, uint32_t lane) {
    HYI_STOREW(to, HYI_CHOOSEW(live, HYI_LOADW(from), HYI_SETW(from[lane])));
}

/* hyi_pack_rays of some lanes of a block: the others are taken out of what bounds are made of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_pack_some)(const hyi_bvh *bvh, const hyi_packet *filled, hyi_packet *packet, uint32_t first, HYI_MW live, uint32_t group,
                                            float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float at[3][HYI_PACKET_WIDTH], of[3][HYI_PACKET_WIDTH];
    uint32_t lane = hyi_lowest_bit(HYI_BITSW(live));
    HYI_FW never = HYI_SETW(-FLT_MAX);
    memcpy(packet->direction, filled->direction, sizeof packet->direction);
    memcpy(packet->inverse_z, filled->inverse_z, sizeof packet->inverse_z);
    memcpy(packet->t_min, filled->t_min, sizeof packet->t_min);
    memcpy(packet->t_by_z, filled->t_by_z, sizeof packet->t_by_z);
    for (uint32_t a = 0; a < 3; a++) {
        HYI_I(hyi_spread_value)(at[a], o[a], live, lane);
        HYI_I(hyi_spread_value)(of[a], inverse[a], live, lane);
        HYI_I(hyi_spread_value)(packet->origin[a], filled->origin[a], live, lane);
        if (a < 2) HYI_I(hyi_spread_value)(packet->shear[a], filled->shear[a], live, lane);
    }
    HYI_I(hyi_spread_value)(packet->t_near, filled->t_near, live, lane);
    HYI_STOREW(packet->t_far, HYI_CHOOSEW(live, HYI_LOADW(filled->t_far), never));
    HYI_STOREW(packet->best_t, HYI_CHOOSEW(live, HYI_LOADW(filled->best_t), never));
    return HYI_I(hyi_pack_rays)(bvh, packet, first, HYI_BITSW(live), group, at, of);
}

/* Packets of the groups of a block where there are enough of one; group: each ray's. Returns the bits of the rays that go in none; to
   each group of these belong too few. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_pack_groups)(const hyi_bvh *bvh, const float group[HYI_PACKET_WIDTH], const hyi_packet *filled, hyi_packet *packets,
                                                  uint32_t first, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH], uint32_t *made) {
    HYI_FW groups = HYI_LOADW(group);
    uint32_t rest = 0;
    for (uint32_t left = HYI_ALLW, some; left; left &= ~some) {
        float one = group[hyi_lowest_bit(left)];
        HYI_MW live = HYI_SAMEW(groups, HYI_SETW(one));
        some = HYI_BITSW(live);
        bool enough = hyi_count_lanes(some) >= HYI_PACKET_LEAST;
        if (enough && HYI_I(hyi_pack_some)(bvh, filled, &packets[*made], first, live, (uint32_t)one, o, inverse)) (*made)++;
        else rest |= some;
    }
    return rest;
}

/* How many different groups the lanes have, but no more than HYI_PACKET_GROUPS + 1. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_count_groups)(const float group[HYI_PACKET_WIDTH]) {
    uint32_t left = HYI_ALLW, count = 0;
    for (; count <= HYI_PACKET_GROUPS && left; count++) left &= ~HYI_BITSW(HYI_SAMEW(HYI_LOADW(group), HYI_SETW(group[hyi_lowest_bit(left)])));
    return count;
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->exact) return false;
        for (int a = 0; a < 3; a++) {
            o[aim->axis[a]][i] = packet->origin[a][i] = aim->origin[a];
            packet->direction[a][i] = aim->direction[a];
            inverse[a][i] = aim->inverse[a];
        }
        packet->shear[0][i] = aim->shear[0];
        packet->shear[1][i] = aim->shear[1];
        packet->inverse_z[i] = aim->inverse_z;
        packet->t_by_z[i] = aim->t_by_z;
        packet->t_min[i] = flight->t_min;
        packet->t_near[i] = aim->t_near;
        packet->t_far[i] = i < count ? aim->t_far : -FLT_MAX;
        packet->best_t[i] = i < count ? flight->best.t : -FLT_MAX;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->leaf.word[i] = packet->triangle.word[i] = 0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->live = (1u << count) - 1u;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* ---- flights */

/* hyi_reach for all lanes. */
HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_reach_all)(const hyi_box *box, HYI_FW origin, int axis, bool loose) {
    HYI_FW lower = HYI_SETW(box->lower[axis]), upper = HYI_SETW(box->upper[axis]);
    HYI_FW below = HYI_SIZEW(HYI_SUBW(lower, origin)), above = HYI_SIZEW(HYI_SUBW(upper, origin));
    if (!loose) return HYI_MAXW(below, above);
    HYI_FW larger = HYI_MAXW(HYI_SIZEW(lower), HYI_SIZEW(upper));
    return HYI_MULW(HYI_SETW(4.0f), HYI_ADDW(larger, HYI_SIZEW(origin)));
}

/* Whether all lanes begin where the vicinity of the tree bounds their errors. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_begin_near_by)(const hyi_site *site, const HYI_I(hyi_block) *block) {
    const hyi_vicinity *vicinity = &site->accel->vicinity;
    float radius[3];
    uint32_t within = site->accel->single ? HYI_ALLW : 0u;
    memcpy(radius, vicinity->radius, sizeof radius);
    for (uint32_t a = 0; a < 3; a++) within &= HYI_I(hyi_within)(HYI_SUBW(block->origin[a], HYI_SETW(vicinity->middle[a])), HYI_SETW(radius[a]));
    return within == HYI_ALLW;
}

/* hyi_slab_bound for all lanes, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_bound_lanes)(const hyi_bvh *bvh, const HYI_I(hyi_block) *block, HYI_FW bound[3]) {
    HYI_FW reach[3];
    for (int a = 0; a < 3; a++) reach[a] = HYI_I(hyi_reach_all)(&bvh->scaled, block->origin[a], a, bvh->rows == NULL);
    HYI_FW along = HYI_I(hyi_turn)(block, reach, 2);
    for (int a = 0; a < 3; a++)
        bound[a] = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], along)), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), HYI_SIZEW(block->origin[a])));
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. most: see hyi_cover_slabs. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_site *site, const HYI_I(hyi_block) *block, float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH], float most[3]) {
    bool near_by = HYI_I(hyi_begin_near_by)(site, block);
    HYI_FW bound[3];
    if (near_by)
        for (int a = 0; a < 3; a++) bound[a] = HYI_SETW(site->accel->vicinity.bound[a]);
    else HYI_I(hyi_bound_lanes)(site->bvh, block, bound);
    for (int a = 0; a < 3; a++) {
        float greatest = near_by ? site->accel->vicinity.bound[a] : HYI_GREATESTW(bound[a]);
        most[a] = greatest > most[a] ? greatest : most[a];
        bound[a] = HYI_CHOOSEW(block->falls[a], HYI_I(hyi_negative)(bound[a]), bound[a]);
        HYI_I(hyi_store_offsets)(block->origin[a], bound[a], HYI_LOADW(inverse[a]), near_offset[a], far_offset[a]);
    }
}

/* hyi_aim.near_plane and .axis of all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_name_axes)(const HYI_I(hyi_block) *block, float plane[3][HYI_PACKET_WIDTH], float axis[3][HYI_PACKET_WIDTH]) {
    const HYI_FW axes[3] = {HYI_I(hyi_whole)(0), HYI_I(hyi_whole)(1), HYI_I(hyi_whole)(2)};
    for (uint32_t a = 0; a < 3; a++) {
        HYI_STOREW(plane[a], HYI_CHOOSEW(block->falls[a], HYI_I(hyi_whole)(HYI_WIDTH * (2u * a + 1u)), HYI_I(hyi_whole)(HYI_WIDTH * 2u * a)));
        HYI_STOREW(axis[a], HYI_I(hyi_turn)(block, axes, a));
    }
}

/* Flights of rays first, first + 1, ... of what was filled into a packet. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_cut_flights)(const hyi_site *site, const HYI_I(hyi_block) *block, const hyi_packet *p, float inverse[3][HYI_PACKET_WIDTH],
                                                  const hyk_ray *rays, hyi_flight *flights, float most[3]) {
    float near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    float plane[3][HYI_PACKET_WIDTH], axis[3][HYI_PACKET_WIDTH];
    static const uint32_t none[HYI_PACKET_WIDTH] = {0};
    hyi_flight blank;
    size_t third = offsetof(hyi_flight, aim.t_by_z);
    memset(&blank, 0, sizeof blank);
    blank.aim.unit = blank.aim.inverse_unit = 1.0;
    blank.best.instance = blank.best.primitive = HYK_NONE;
    HYI_I(hyi_offset_lanes)(site, block, inverse, near_offset, far_offset, most);
    HYI_I(hyi_name_axes)(block, plane, axis);
    const void *boxes[16] = {plane[0], plane[1], plane[2], far_offset[0], far_offset[1], far_offset[2], inverse[0], inverse[1], inverse[2],
                             near_offset[0], near_offset[1], near_offset[2], p->t_near, p->t_far, p->inverse_z, p->best_t};
    const void *triangles[16] = {p->origin[0], p->origin[1], p->origin[2], p->shear[0], p->shear[1], axis[0], axis[1], axis[2],
                                 p->direction[0], p->direction[1], p->direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.near_plane));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        memcpy((char *)flight + third, (const char *)&blank + third, sizeof blank - third);
        flight->aim.t_by_z = p->t_by_z[i];
        flight->best.t = p->best_t[i];
        flight->t_min = p->t_min[i];
        flight->ray = &rays[i];
    }
}

/* Flights of HYI_LANES others, by their numbers, in the tree of site; false: they must enter one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_enter_flights)(const hyi_site *site, const hyi_flight *above, const uint32_t *numbers, hyi_flight *below, float most[3]) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    hyk_ray rays[HYI_PACKET_WIDTH];
    HYI_I(hyi_block) block;
    hyi_packet packet;
    for (uint32_t i = 0; i < HYI_LANES; i++) rays[i] = hyi_ray_below(&above[numbers[i]], site);
    if (!HYI_I(hyi_load_block)(site->bvh, rays, &block)) return false;
    HYI_I(hyi_fill_packet)(&block, &packet, o, inverse);
    HYI_I(hyi_cut_flights)(site, &block, &packet, inverse, rays, below, most);
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        below[i].ray = above[numbers[i]].ray;
        below[i].best = above[numbers[i]].best;
    }
    return true;
}

/* Sets rays begun->rays, begun->rays + 1, ... on their way: packets of those that are alike, flights of the others, until there
   are count, at most capacity, or share packets; share 0: none are made. Those that meet nothing are answered at once. */
HYI_FN HYI_TARGET void HYI_I(hyi_begin_rays)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, const hyi_answers *answers,
                                             uint32_t count, uint32_t share, hyi_begun *begun) {
    hyi_packet filled;
    for (uint32_t first; (first = begun->rays) < count && (share == 0 || begun->packets + HYI_LANES / HYI_PACKET_LEAST < share); begun->rays += HYI_LANES) {
        float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], group[HYI_PACKET_WIDTH];
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        HYI_I(hyi_block) block;
        if (some < HYI_LANES || !HYI_I(hyi_load_block)(site->bvh, rays + first, &block)) {
            hyi_begin_each(site, stream, rays, answers, first, some, begun);
            continue;
        }
        HYI_STOREW(group, HYI_I(hyi_find_groups)(&block));
        uint32_t groups = site->bvh->rows && share ? HYI_I(hyi_count_groups)(group) : HYI_PACKET_GROUPS + 1u, rest = HYI_ALLW;
        hyi_packet *to = groups == 1u ? &stream->packets[begun->packets] : &filled;
        HYI_I(hyi_fill_packet)(&block, to, o, inverse);
        if (groups == 1u && HYI_I(hyi_pack_rays)(site->bvh, to, first, HYI_ALLW, (uint32_t)group[0], o, inverse)) {
            begun->packets++;
            continue;
        }
        if (groups > 1u && groups <= HYI_PACKET_GROUPS) rest = HYI_I(hyi_pack_groups)(site->bvh, group, to, stream->packets, first, o, inverse, &begun->packets);
        if (rest == 0) continue;
        HYI_I(hyi_cut_flights)(site, &block, to, inverse, rays + first, stream->flights + begun->flights, begun->bound);
        begun->flights += hyi_keep_flights(stream->flights + begun->flights, rest);
    }
}
