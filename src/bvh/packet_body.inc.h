/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which rays meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

HYI_INLINE HYI_TARGET void HYI_I(hyi_order_planes)(const hyi_node *node, const uint32_t near_plane[3], HYI_I(hyi_planes) *planes) {
    for (int a = 0; a < 3; a++) {
        planes->near_planes[a] = HYI_LOAD8(hyi_planes_at(node, near_plane[a]));
        planes->far_planes[a] = HYI_LOAD8(hyi_planes_at(node, near_plane[a] ^ HYI_WIDTH));
    }
}

/* Eight boxes against the bounds of a packet: no ray of it enters earlier than enter, or leaves later. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes_all)(const hyi_packet *p, const HYI_I(hyi_planes) *planes, HYI_F8 *enter) {
    HYI_F8 first = HYI_SET8(p->first_t), last = HYI_SET8(p->last_t);
    for (int a = 0; a < 3; a++) {
        HYI_F8 low = HYI_SET8(p->inverse_low[a]), high = HYI_SET8(p->inverse_high[a]);
        HYI_F8 to_near = HYI_SUB8(planes->near_planes[a], HYI_SET8(p->near_origin[a]));
        HYI_F8 to_far = HYI_SUB8(planes->far_planes[a], HYI_SET8(p->far_origin[a]));
        first = HYI_MAX8(first, HYI_MIN8(HYI_MUL8(to_near, low), HYI_MUL8(to_near, high)));
        last = HYI_MIN8(last, HYI_MAX8(HYI_MUL8(to_far, low), HYI_MUL8(to_far, high)));
    }
    *enter = first;
    return HYI_LE8(first, last);
}

/* Bits of the rays of a packet that meet the box of child c. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int a = 0; a < 3; a++) {
        HYI_FW inverse = HYI_LOADW(p->inverse[a]);
        first = HYI_MAXW(first, HYI_MADW(HYI_SETW(hyi_planes_at(node, swarm->near_plane[a])[c]), inverse, HYI_LOADW(p->near_offset[a])));
        last = HYI_MINW(last, HYI_MADW(HYI_SETW(hyi_planes_at(node, swarm->near_plane[a] ^ HYI_WIDTH)[c]), inverse, HYI_LOADW(p->far_offset[a])));
    }
    return HYI_BITSW(HYI_LEW(first, last));
}

/* Of the children in mask, those whose box some ray of a packet meets. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_boxes_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t mask) {
    uint32_t met = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        met &= ~((HYI_I(hyi_meet_box_each)(swarm, p, node, c) ? 0u : 1u) << c);
    }
    return met;
}

/* ---- triangles */

/* A corner in the sheared frames of the rays of a packet. */
typedef struct HYI_I(hyi_corner_all) {
    HYI_FW x, y, z;
} HYI_I(hyi_corner_all);

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_lanes)(const hyi_packet *p, HYI_FW x, HYI_FW y, HYI_FW z) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(z, HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(x, HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(y, HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

/* A corner that is the same for all. */
HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    return HYI_I(hyi_shear_lanes)(p, HYI_SETW(row[axis[0] * stride]), HYI_SETW(row[axis[1] * stride]), HYI_SETW(row[axis[2] * stride]));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf) + triangle;
    uint32_t count = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * count, count);
}

/* One triangle to all rays: the edge functions w, t at the corners, and which rays may hit it. */
typedef struct HYI_I(hyi_meeting) {
    HYI_I(hyi_corner_all) corners[3];
    HYI_FW w[3], least_w, most_w, t[3], first, last;
    uint32_t possible;
} HYI_I(hyi_meeting);

/* From its sheared corners on: the same test as of one ray and eight triangles. Returns the lanes that certainly miss it. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_meet_corners_all)(const hyi_packet *packet, HYI_I(hyi_meeting) *m) {
    const HYI_I(hyi_corner_all) *k = m->corners;
    m->w[0] = HYI_I(hyi_cross_all)(k[2], k[1]);
    m->w[1] = HYI_I(hyi_cross_all)(k[0], k[2]);
    m->w[2] = HYI_I(hyi_cross_all)(k[1], k[0]);
    m->least_w = HYI_MINW(HYI_MINW(m->w[0], m->w[1]), m->w[2]);
    m->most_w = HYI_MAXW(HYI_MAXW(m->w[0], m->w[1]), m->w[2]);
    HYI_MW outside = HYI_ANDW(HYI_LTW(m->least_w, HYI_ZEROW()), HYI_LTW(HYI_ZEROW(), m->most_w));
    for (int i = 0; i < 3; i++) m->t[i] = HYI_MULW(k[i].z, HYI_LOADW(packet->inverse_z));
    m->first = HYI_MINW(HYI_MINW(m->t[0], m->t[1]), m->t[2]);
    m->last = HYI_MAXW(HYI_MAXW(m->t[0], m->t[1]), m->t[2]);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), m->first), early = HYI_LTW(m->last, HYI_LOADW(packet->t_near));
    HYI_MW misses = HYI_ORW(outside, HYI_ORW(late, early));
    m->possible = ~HYI_BITSW(misses) & HYI_ALLW;
    return misses;
}

/* Triangle number triangle of a leaf. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_meet_triangle_all)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle, HYI_I(hyi_meeting) *m) {
    HYI_I(hyi_shear_triangle)(swarm, packet, leaf, triangle, m->corners);
    (void)HYI_I(hyi_meet_corners_all)(packet, m);
}

/* What float can tell of a triangle that rays may hit: see hyi_judge_triangles. t of the certain lies between least and most. */
typedef struct HYI_I(hyi_verdict_all) {
    HYI_FW least, most;
    HYI_MW certain;
    uint32_t missed;
} HYI_I(hyi_verdict_all);

HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_all)(const hyi_packet *packet, const HYI_I(hyi_meeting) *m, HYI_I(hyi_verdict_all) *verdict) {
    HYI_FW zero = HYI_ZEROW(), t_near = HYI_LOADW(packet->t_near), across = zero;
    HYI_FW sum = HYI_ADDW(HYI_ADDW(m->w[0], m->w[1]), m->w[2]), size = HYI_SIZEW(sum);
    HYI_FW farthest = HYI_MAXW(HYI_SIZEW(m->first), HYI_SIZEW(m->last)), along = HYI_MULW(farthest, HYI_SIZEW(HYI_LOADW(packet->direction[2])));
    for (int i = 0; i < 3; i++) across = HYI_MAXW(across, HYI_MAXW(HYI_SIZEW(m->corners[i].x), HYI_SIZEW(m->corners[i].y)));
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(m->w[0], m->t[0]), HYI_MULW(m->w[1], m->t[1])), HYI_MULW(m->w[2], m->t[2])), inverse);
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(m->last, m->first), noise), HYI_SIZEW(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    verdict->least = HYI_SUBW(mean, error);
    verdict->most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, m->least_w), HYI_LTW(m->most_w, zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MULW(HYI_SETW(4.0f), noise), size));
    HYI_FW product = HYI_MINW(HYI_MINW(size, farthest), HYI_MULW(size, farthest));
    known = HYI_ANDW(known, HYI_LTW(HYI_SETW(HYI_EDGE_LEAST), product));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_SIZEW(t_near)));
    verdict->missed = HYI_BITSW(HYI_ANDW(known, HYI_ORW(HYI_LTW(verdict->most, t_near), HYI_LTW(HYI_LOADW(packet->t_far), verdict->least))));
    verdict->certain = HYI_ANDW(known, HYI_LEW(from, verdict->least));
}

/* Corners in the sheared frames as hyi_confirm reads them: floats become doubles on their way from memory for less than out of
   halves of registers. */
typedef struct HYI_I(hyi_sheared) {
    float x[3][HYI_PACKET_WIDTH], y[3][HYI_PACKET_WIDTH];
} HYI_I(hyi_sheared);

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_corner)(HYI_I(hyi_sheared) *corners, int k, HYI_I(hyi_corner_all) corner) {
    HYI_STOREW(corners->x[k], corner.x);
    HYI_STOREW(corners->y[k], corner.y);
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const HYI_FD n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(n[0], v[0])), second = HYI_PIND(HYI_MULD(n[1], v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(n[2], v[2]))));
}

/* The plane of a triangle, or of one a lane, as hyi_cross_plane works it out: a corner, the normal, and z of the others. */
typedef struct HYI_I(hyi_plane_half) {
    HYI_FD corner[3], n[3], z[2];
} HYI_I(hyi_plane_half);

/* What hyi_confirm works out, for half of a packet. */
typedef struct HYI_I(hyi_outcome_half) {
    HYI_FD t, b, c, sum; /* edge functions of corners 1 and 2 and the sum of all: u and v are their ratios */
    uint32_t hit;        /* bits of the rays that hit */
    uint32_t doubtful;   /* of those whose t hyi_confirm has to settle */
} HYI_I(hyi_outcome_half);

HYI_INLINE HYI_TARGET void HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_sheared) *corners,
                                                   const HYI_I(hyi_plane_half) *plane, int half, HYI_I(hyi_outcome_half) *outcome) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0), origin_z = HYI_LOADH(packet->origin[2], half);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_LOADH(corners->x[i], half);
        y[i] = HYI_LOADH(corners->y[i], half);
        to_corner[i] = HYI_PIND(HYI_SUBD(plane->corner[i], HYI_LOADH(packet->origin[i], half)));
        direction[i] = HYI_LOADH(packet->direction[i], half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(plane->n, direction);
    HYI_FD distance = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(plane->n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD at[3] = {HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), zero, zero}, least = at[0], most = at[0];
    for (int i = 1; i < 3; i++) {
        at[i] = HYI_PIND(HYI_MULD(HYI_PIND(HYI_SUBD(plane->z[i - 1], origin_z)), t_by_z));
        least = HYI_MIND(at[i], least);
        most = HYI_MAXD(at[i], most);
    }
    distance = HYI_MIND(most, HYI_MAXD(least, distance)); /* of two zeros the second is kept, as hyi_cross_plane keeps it */
    const HYI_FD w[3] = {a, b, c};
    HYI_FD gap = HYI_PIND(HYI_SUBD(HYI_PIND(HYI_MULD(distance, sum)), HYI_I(hyi_sum_products_half)(w, at)));
    HYI_FD trusted = HYI_PIND(HYI_MULD(HYI_PIND(HYI_MULD(HYI_SETD(HYI_PLANE_TRUST), HYI_MAXD(at[0], HYI_SUBD(zero, at[0])))), HYI_MAXD(sum, HYI_SUBD(zero, sum))));
    outcome->t = distance;
    outcome->b = b;
    outcome->c = c;
    outcome->sum = sum;
    outcome->hit = ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
    outcome->doubtful = outcome->hit & (HYI_LTD(trusted, gap) | HYI_LTD(gap, HYI_SUBD(zero, trusted)));
    if (HYI_ZEROS_ALIKE) outcome->doubtful |= outcome->hit & ~(HYI_LTD(distance, zero) | HYI_LTD(zero, distance));
}

/* u and v of a hit, by half. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_store_weights)(const HYI_I(hyi_outcome_half) *outcome, int half, float *u, float *v) {
    HYI_FD inverse = HYI_PIND(HYI_DIVD(HYI_SETD(1.0), outcome->sum));
    HYI_STOREH(u, half, HYI_MULD(outcome->b, inverse));
    HYI_STOREH(v, half, HYI_MULD(outcome->c, inverse));
}

/* One triangle's plane for all rays. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, HYI_I(hyi_plane_half) *plane) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        double corner = (double)row[0];
        plane->corner[i] = HYI_SETD(corner);
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner);
    }
    for (int i = 0; i < 3; i++) plane->n[i] = HYI_SETD(hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]));
    for (uint32_t k = 0; k < 2; k++) plane->z[k] = HYI_SETD((double)rows[(3u * k + 3u + axis[2]) * stride]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t leaf, uint32_t triangle, float t, float u, float v) {
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        if (hyi_lets_pass(&swarm->site, ray, primitive, u, v)) return false;
    }
    packet->best_t[lane] = packet->least_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    packet->leaf.word[lane] = leaf;
    packet->triangle.word[lane] = triangle;
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number triangle of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_FN HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle, uint32_t mask) {
    HYI_I(hyi_corner_all) corners[3];
    HYI_I(hyi_sheared) sheared;
    HYI_I(hyi_plane_half) plane;
    float t[HYI_PACKET_WIDTH], u[HYI_PACKET_WIDTH] = {0.0f}, v[HYI_PACKET_WIDTH] = {0.0f};
    bool found = false;
    HYI_I(hyi_shear_triangle)(swarm, packet, leaf, triangle, corners);
    for (int k = 0; k < 3; k++) HYI_I(hyi_store_corner)(&sheared, k, corners[k]);
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), &plane);
    for (int half = 0; half < 2; half++) {
        HYI_I(hyi_outcome_half) outcome;
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        if (!some) continue;
        HYI_I(hyi_confirm_half)(packet, &sheared, &plane, half, &outcome);
        HYI_STOREH(t, half, outcome.t);
        for (uint32_t left = some & outcome.doubtful; left; left &= left - 1u) {
            uint32_t lane = base + hyi_lowest_bit(left);
            t[lane] = hyi_settle_lane(packet, swarm->site.bvh, swarm->axis, lane, leaf, triangle);
        }
        if (swarm->site.asks_alpha) HYI_I(hyi_store_weights)(&outcome, half, u, v);
        for (some &= outcome.hit; some; some &= some - 1u) {
            uint32_t lane = base + hyi_lowest_bit(some);
            if (t[lane] <= packet->best_t[lane] && HYI_I(hyi_take_hit)(swarm, packet, lane, leaf, triangle, t[lane], u[lane], v[lane])) found = true;
        }
    }
    return found;
}

/* ---- hits that float is certain of */

/* Where any hit does: the rays in mask are done. */
HYI_INLINE void HYI_I(hyi_stop_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t mask) {
    for (; mask; mask &= mask - 1u) {
        packet->t_far[hyi_lowest_bit(mask)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(mask)] = swarm->site.instance;
    }
}

/* Of the rays in mask, those that have not found the same triangle in another leaf: spatial splits put it into several. */
HYI_FN uint32_t HYI_I(hyi_new_to_rays)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle, uint32_t mask) {
    const uint32_t *ids = swarm->site.bvh->ids;
    uint32_t primitive = ids[hyi_leaf_first(leaf) + triangle], left = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask), other = packet->leaf.word[lane];
        if (other && ids[hyi_leaf_first(other) + packet->triangle.word[lane]] == primitive) left &= ~(1u << lane);
    }
    return left;
}

/* Works out the hits that the rays in mask have put off. */
HYI_FN HYI_TARGET void HYI_I(hyi_settle_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t mask) {
    for (mask &= packet->waiting; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        packet->waiting &= ~(1u << lane);
        (void)HYI_I(hyi_decide_for_all)(swarm, packet, packet->leaf.word[lane], packet->triangle.word[lane], 1u << lane);
    }
}

/* Puts a word where the mask says. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_put_word)(hyi_lane_words *words, HYI_MW where, uint32_t word) {
    hyi_lane_words all;
    all.word[0] = word;
    HYI_STOREW(words->bits, HYI_CHOOSEW(where, HYI_SETW(all.bits[0]), HYI_LOADW(words->bits)));
}

/* hyi_expect, for all rays; returns those of mask, which holds all that are certain, for which the triangle is not certainly
   nearer than all before. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_expect_all)(hyi_packet *packet, uint32_t leaf, uint32_t triangle, const HYI_I(hyi_verdict_all) *verdict, uint32_t mask) {
    HYI_FW least_t = HYI_LOADW(packet->least_t), most = verdict->most;
    HYI_MW nearer = HYI_ANDW(verdict->certain, HYI_LTW(most, least_t));
    HYI_FW limit = HYI_ADDW(most, HYI_MULW(HYI_SETW(4.0f * HYI_ULP), HYI_SIZEW(most)));
    HYI_STOREW(packet->t_far, HYI_CHOOSEW(nearer, limit, HYI_LOADW(packet->t_far)));
    HYI_STOREW(packet->least_t, HYI_CHOOSEW(nearer, verdict->least, least_t));
    HYI_I(hyi_put_word)(&packet->leaf, nearer, leaf);
    HYI_I(hyi_put_word)(&packet->triangle, nearer, triangle);
    packet->waiting |= HYI_BITSW(nearer);
    return mask & ~HYI_BITSW(nearer);
}

/* Offers a triangle to the rays that may hit it. Returns whether one of them does. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle, const HYI_I(hyi_meeting) *m, bool any) {
    uint32_t left = m->possible;
    if (!swarm->site.asks_alpha) {
        HYI_I(hyi_verdict_all) verdict;
        HYI_I(hyi_judge_all)(packet, m, &verdict);
        left &= ~verdict.missed;
        if (!left) return false;
        uint32_t open = left;
        if (any) {
            open &= ~HYI_BITSW(HYI_ANDW(verdict.certain, HYI_LTW(verdict.most, HYI_LOADW(packet->best_t))));
            HYI_I(hyi_stop_rays)(swarm, packet, left & ~open);
        } else {
            open = HYI_I(hyi_expect_all)(packet, leaf, triangle, &verdict, left);
        }
        if (!open) return true;
        open = HYI_I(hyi_new_to_rays)(swarm, packet, leaf, triangle, open);
        HYI_I(hyi_settle_rays)(swarm, packet, open);
        return (open && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, open)) || open != left;
    }
    return HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, left);
}

/* ---- a leaf's triangles, all at once, to all rays of a packet that begin at one point */

/* Where the middle ray of a packet sees a leaf's triangles, and how far off it others may see them. */
typedef struct HYI_I(hyi_outlook) {
    HYI_I(hyi_corners) k[3];
    HYI_F8 half[2];       /* by which shears differ from the middle one */
    HYI_F8 slack, margin; /* more than rounding makes of x or y, and of an edge function */
} HYI_I(hyi_outlook);

/* For another ray a corner's x, for one, is off that of the middle ray by up to half |z|. With that in across, what is worked out
   here is off by less than the noise of hyi_judge_triangles, and so is what a ray itself works out: slack and margin are twice that,
   and more than what underflows. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_look_out)(const hyi_swarm *swarm, const hyi_packet *p, uint32_t leaf, HYI_I(hyi_outlook) *out) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t count = hyi_leaf_count(leaf);
    HYI_F8 across = HYI_ZERO8(), along = across, shear_x = HYI_SET8(-p->shear_middle[0]), shear_y = HYI_SET8(-p->shear_middle[1]);
    for (uint32_t i = 0; i < 3u; i++) {
        const float *row = rows + 3u * i * count;
        HYI_F8 z = HYI_SUB8(HYI_LOADU8(row + swarm->axis[2] * count), HYI_SET8(p->origin[2][0]));
        HYI_F8 x = HYI_MAD8(shear_x, z, HYI_SUB8(HYI_LOADU8(row + swarm->axis[0] * count), HYI_SET8(p->origin[0][0])));
        HYI_F8 y = HYI_MAD8(shear_y, z, HYI_SUB8(HYI_LOADU8(row + swarm->axis[1] * count), HYI_SET8(p->origin[1][0])));
        across = HYI_MAX8(across, HYI_MAX8(HYI_SIZE8(x), HYI_SIZE8(y)));
        along = HYI_MAX8(along, HYI_SIZE8(z));
        out->k[i].x = x;
        out->k[i].y = y;
        out->k[i].z = z;
    }
    for (int a = 0; a < 2; a++) out->half[a] = HYI_SET8(p->shear_half[a]);
    across = HYI_MAD8(HYI_MAX8(out->half[0], out->half[1]), along, across);
    out->slack = HYI_MAD8(HYI_SET8(2.0f * HYI_EDGE_NOISE), HYI_ADD8(across, along), HYI_SET8(16.0f * FLT_MIN));
    out->margin = HYI_MAD8(across, out->slack, HYI_SET8(HYI_EDGE_LEAST));
}

/* Those of which one edge function is above zero for all rays, and one below. They are linear in the shears. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_beside_edges)(const HYI_I(hyi_outlook) *out) {
    HYI_F8 zero = HYI_ZERO8();
    HYI_M8 above = HYI_LT8(zero, zero), below = above;
    for (int i = 0; i < 3; i++) {
        const HYI_I(hyi_corners) *p = &out->k[(i + 2) % 3], *q = &out->k[(i + 1) % 3];
        HYI_F8 w = HYI_SUB8(HYI_MUL8(p->x, q->y), HYI_MUL8(p->y, q->x));
        HYI_F8 by_x = HYI_SIZE8(HYI_SUB8(HYI_MUL8(p->y, q->z), HYI_MUL8(p->z, q->y)));
        HYI_F8 by_y = HYI_SIZE8(HYI_SUB8(HYI_MUL8(p->z, q->x), HYI_MUL8(p->x, q->z)));
        HYI_F8 range = HYI_MAD8(out->half[0], by_x, HYI_MAD8(out->half[1], by_y, out->margin));
        above = HYI_OR8(above, HYI_LT8(range, w));
        below = HYI_OR8(below, HYI_LT8(w, HYI_SUB8(zero, range)));
    }
    return HYI_AND8(above, below);
}

/* Those whose corners lie all on one side of all rays along x, or along y. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_beside_corners)(const HYI_I(hyi_outlook) *out) {
    HYI_F8 low[2], high[2], back = HYI_SUB8(HYI_ZERO8(), out->slack);
    for (int i = 0; i < 3; i++) {
        HYI_F8 z = HYI_SIZE8(out->k[i].z);
        for (int a = 0; a < 2; a++) {
            HYI_F8 at = a ? out->k[i].y : out->k[i].x, off = HYI_MUL8(out->half[a], z), least = HYI_SUB8(at, off), most = HYI_ADD8(at, off);
            low[a] = i ? HYI_MIN8(low[a], least) : least;
            high[a] = i ? HYI_MAX8(high[a], most) : most;
        }
    }
    HYI_M8 after = HYI_OR8(HYI_LT8(out->slack, low[0]), HYI_LT8(out->slack, low[1]));
    return HYI_OR8(after, HYI_OR8(HYI_LT8(high[0], back), HYI_LT8(high[1], back)));
}

/* Bits of the triangles of a leaf that rays of a packet which begin at one point may hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_sift_leaf)(const hyi_swarm *swarm, const hyi_packet *p, uint32_t leaf) {
    HYI_I(hyi_outlook) out;
    HYI_I(hyi_look_out)(swarm, p, leaf, &out);
    HYI_M8 beside = HYI_OR8(HYI_I(hyi_beside_edges)(&out), HYI_I(hyi_beside_corners)(&out));
    return ~HYI_BITS8(beside) & ((1u << hyi_leaf_count(leaf)) - 1u);
}

/* A ray of a packet as leaves see it. */
HYI_INLINE HYI_I(hyi_sight) HYI_I(hyi_sight_of_lane)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t lane) {
    HYI_I(hyi_sight) sight;
    for (int i = 0; i < 3; i++) {
        sight.origin[i] = packet->origin[i][lane];
        sight.axis[i] = swarm->axis[i];
    }
    sight.shear[0] = packet->shear[0][lane];
    sight.shear[1] = packet->shear[1][lane];
    sight.inverse_z = packet->inverse_z[lane];
    sight.along_z = fabsf(packet->direction[2][lane]);
    sight.t_near = packet->t_near[lane];
    sight.t_far = packet->t_far[lane];
    return sight;
}

/* hyi_expect for one ray of a packet; returns whether the triangle is certainly nearer than all before. */
HYI_INLINE bool HYI_I(hyi_expect_lane)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t leaf, uint32_t triangle, float least, float most, bool any) {
    if (any && most < packet->best_t[lane]) HYI_I(hyi_stop_rays)(swarm, packet, 1u << lane);
    if (any) return most < packet->best_t[lane];
    if (most >= packet->least_t[lane]) return false;
    packet->t_far[lane] = most + 4.0f * HYI_ULP * fabsf(most);
    packet->least_t[lane] = least;
    packet->leaf.word[lane] = leaf;
    packet->triangle.word[lane] = triangle;
    packet->waiting |= 1u << lane;
    return true;
}

/* A leaf's triangles, all at once, to one ray of a packet; returns whether it hits one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf_to_lane)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t lane, bool any) {
    HYI_I(hyi_sight) sight = HYI_I(hyi_sight_of_lane)(swarm, packet, lane);
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&sight, hyi_leaf_rows(swarm->site.bvh, leaf), hyi_leaf_count(leaf), false);
    bool found = false;
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t triangle = hyi_lowest_bit(mask);
        bool certain = (verdicts.certain >> triangle & 1u) != 0u;
        if (certain && verdicts.least[triangle] > packet->t_far[lane]) continue;
        if (certain && HYI_I(hyi_expect_lane)(swarm, packet, lane, leaf, triangle, verdicts.least[triangle], verdicts.most[triangle], any)) {
            found = true;
        } else if (HYI_I(hyi_new_to_rays)(swarm, packet, leaf, triangle, 1u << lane)) {
            HYI_I(hyi_settle_rays)(swarm, packet, 1u << lane);
            found = HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, 1u << lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* A leaf's triangles, one after the other, to all rays of a packet; returns whether there was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, bool any) {
    uint32_t triangles = hyi_leaf_count(leaf);
    uint32_t some = packet->spread || any || triangles < 5u ? (1u << triangles) - 1u : HYI_I(hyi_sift_leaf)(swarm, packet, leaf);
    bool found = false;
    for (; some; some &= some - 1u) {
        uint32_t t = hyi_lowest_bit(some);
        HYI_I(hyi_meeting) m;
        HYI_I(hyi_meet_triangle_all)(swarm, packet, leaf, t, &m);
        if (m.possible && HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, &m, any)) found = true;
    }
    return found;
}

/* Packets of a list, each of a pair by itself, some of whose rays meet the box of a leaf, begin to wait. node, c: where the leaf hangs;
   NULL: nowhere. Without a branch on whether they do: it would be taken by chance. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_receive)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, const hyi_node *node, uint32_t c) {
    hyi_visitors *visitors = swarm->visitors;
    uint32_t waiting = visitors->count;
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t p = list[i]; p != HYK_NONE; p = swarm->packets[p].mate) {
            uint32_t rays = node ? HYI_I(hyi_meet_box_each)(swarm, &swarm->packets[p], node, c) : HYI_ALLW;
            visitors->packets[waiting] = p;
            visitors->rays[waiting] = rays;
            visitors->leaves[waiting] = leaf;
            waiting += rays ? 1u : 0u;
            swarm->stream->leaf_visits++;
        }
    }
    visitors->count = waiting;
}

/* How far a packet, or pair, still looks after a hit, and how closely. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_limit_packet)(const hyi_swarm *swarm, const hyi_packet *packet, bool any) {
    hyi_packet *lead = &swarm->packets[packet->lead];
    HYI_FW t_far = HYI_LOADW(lead->t_far);
    if (lead->mate != HYK_NONE) t_far = HYI_MAXW(t_far, HYI_LOADW(swarm->packets[lead->mate].t_far));
    lead->last_t = HYI_GREATESTW(t_far);
    if (any && 2u * hyi_count_lanes(HYI_BITSW(HYI_LTW(HYI_SETW(-FLT_MAX), t_far))) <= HYI_LANES) lead->many_children = HYI_MANY_FOR_FEW;
}

/* Packets that wait meet their leaves. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_admit)(const hyi_swarm *swarm, bool any) {
    hyi_visitors *visitors = swarm->visitors;
    for (uint32_t i = 0; i < visitors->count; i++) {
        hyi_packet *packet = &swarm->packets[visitors->packets[i]];
        uint32_t mask = visitors->rays[i], leaf = visitors->leaves[i];
        bool found = false;
        if (HYI_SOONER_EACH(hyi_count_lanes(mask), hyi_leaf_count(leaf)) && !swarm->site.asks_alpha) {
            for (; mask; mask &= mask - 1u) found = HYI_I(hyi_offer_leaf_to_lane)(swarm, packet, leaf, hyi_lowest_bit(mask), any) || found;
        } else {
            found = HYI_I(hyi_offer_leaf_to_all)(swarm, packet, leaf, any);
        }
        if (found) HYI_I(hyi_limit_packet)(swarm, packet, any);
    }
    visitors->count = 0;
}

HYI_FN HYI_TARGET void HYI_I(hyi_admit_any)(const hyi_swarm *swarm) { HYI_I(hyi_admit)(swarm, true); }

HYI_FN HYI_TARGET void HYI_I(hyi_admit_closest)(const hyi_swarm *swarm) { HYI_I(hyi_admit)(swarm, false); }

HYI_INLINE HYI_TARGET void HYI_I(hyi_admit_all)(const hyi_swarm *swarm) {
    if (swarm->any) HYI_I(hyi_admit_any)(swarm);
    else HYI_I(hyi_admit_closest)(swarm);
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, const hyi_node *node, uint32_t c) {
    HYI_I(hyi_receive)(swarm, leaf, list, count, node, c);
    if (swarm->visitors->count >= HYI_VISITORS_LEAST) HYI_I(hyi_admit_all)(swarm);
}
