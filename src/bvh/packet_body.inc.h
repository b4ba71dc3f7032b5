/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which the rays of a swarm meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

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

/* Whether any ray of a packet meets the box of child c. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int k = 0; k < 3; k++) {
        uint32_t a = swarm->axis[k], near_row = swarm->near_plane[a];
        float slack = (near_row & 1u) ? p->bound[a] : -p->bound[a];
        HYI_FW origin = HYI_LOADW(p->origin[k]), inverse = HYI_LOADW(p->inverse[k]);
        first = HYI_MAXW(first, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row][c] + slack), origin), inverse));
        last = HYI_MINW(last, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row ^ 1u][c] - slack), origin), inverse));
    }
    return HYI_BITSW(HYI_LEW(first, last)) != 0u;
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

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[2] * stride]), HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[0] * stride]), HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[1] * stride]), HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

/* Which rays certainly miss one triangle: the same test as of one ray and eight triangles. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_miss_triangle_all)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3]) {
    HYI_I(hyi_corner_all) p = corners[0], q = corners[1], r = corners[2];
    HYI_FW a = HYI_I(hyi_cross_all)(r, q), b = HYI_I(hyi_cross_all)(p, r), c = HYI_I(hyi_cross_all)(q, p);
    HYI_MW below = HYI_LTW(HYI_MINW(HYI_MINW(a, b), c), HYI_ZEROW());
    HYI_MW above = HYI_LTW(HYI_ZEROW(), HYI_MAXW(HYI_MAXW(a, b), c));
    HYI_FW scale = HYI_LOADW(packet->inverse_z);
    HYI_FW ta = HYI_MULW(p.z, scale), tb = HYI_MULW(q.z, scale), tc = HYI_MULW(r.z, scale);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), HYI_MINW(HYI_MINW(ta, tb), tc));
    HYI_MW early = HYI_LTW(HYI_MAXW(HYI_MAXW(ta, tb), tc), HYI_LOADW(packet->t_near));
    return HYI_ORW(HYI_ANDW(below, above), HYI_ORW(late, early));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_size_all)(HYI_FW v) { return HYI_MAXW(v, HYI_SUBW(HYI_ZEROW(), v)); }

/* Of one triangle that rays may hit but those in out, where any hit does: stops the rays that certainly hit it; left: the
   others, without those that turn out to miss it. hyi_judge_triangles, for all rays. Returns whether it stopped any. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_stop_certain)(const hyi_swarm *swarm, hyi_packet *packet, const HYI_I(hyi_corner_all) k[3], HYI_MW out, uint32_t *left) {
    HYI_FW zero = HYI_ZEROW(), scale = HYI_LOADW(packet->inverse_z), t_near = HYI_LOADW(packet->t_near), t_far = HYI_LOADW(packet->t_far);
    HYI_FW a = HYI_I(hyi_cross_all)(k[2], k[1]), b = HYI_I(hyi_cross_all)(k[0], k[2]), c = HYI_I(hyi_cross_all)(k[1], k[0]);
    HYI_FW sum = HYI_ADDW(HYI_ADDW(a, b), c), size = HYI_I(hyi_size_all)(sum), across = zero, along = zero;
    HYI_FW ta = HYI_MULW(k[0].z, scale), tb = HYI_MULW(k[1].z, scale), tc = HYI_MULW(k[2].z, scale);
    HYI_FW first = HYI_MINW(HYI_MINW(ta, tb), tc), last = HYI_MAXW(HYI_MAXW(ta, tb), tc);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAXW(across, HYI_MAXW(HYI_I(hyi_size_all)(k[i].x), HYI_I(hyi_size_all)(k[i].y)));
        along = HYI_MAXW(along, HYI_I(hyi_size_all)(k[i].z));
    }
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(a, ta), HYI_MULW(b, tb)), HYI_MULW(c, tc)), inverse);
    HYI_FW farthest = HYI_MAXW(HYI_I(hyi_size_all)(first), HYI_I(hyi_size_all)(last));
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(last, first), noise), HYI_I(hyi_size_all)(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    HYI_FW least = HYI_SUBW(mean, error), most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, HYI_MINW(HYI_MINW(a, b), c)), HYI_LTW(HYI_MAXW(HYI_MAXW(a, b), c), zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MULW(HYI_SETW(4.0f), noise), size));
    HYI_FW product = HYI_MINW(HYI_MINW(size, farthest), HYI_MULW(size, farthest));
    known = HYI_ANDW(known, HYI_LTW(HYI_SETW(HYI_EDGE_LEAST), product));
    HYI_MW missed = HYI_ANDW(known, HYI_ORW(HYI_LTW(most, t_near), HYI_LTW(t_far, least)));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_I(hyi_size_all)(t_near)));
    HYI_MW hit = HYI_ANDW(HYI_ANDW(known, HYI_LEW(from, least)), HYI_LTW(most, HYI_LOADW(packet->best_t)));
    uint32_t stopped = HYI_BITSW(hit) & ~HYI_BITSW(out);
    *left = HYI_ALLW & ~(stopped | HYI_BITSW(HYI_ORW(out, missed)));
    if (stopped == 0) return false;
    for (uint32_t some = stopped; some; some &= some - 1u) {
        packet->t_far[hyi_lowest_bit(some)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(some)] = swarm->site.instance;
    }
    return true;
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const double n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(HYI_SETD(n[0]), v[0])), second = HYI_PIND(HYI_MULD(HYI_SETD(n[1]), v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(HYI_SETD(n[2]), v[2]))));
}

/* What hyi_confirm works out, for half of a packet: t and the edge functions; the bits of those that are hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3], const double corner[3],
                                                       const double n[3], const double z[3], int half, double t[8], double weights[3][8]) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_HALFD(corners[i].x, half);
        y[i] = HYI_HALFD(corners[i].y, half);
        to_corner[i] = HYI_PIND(HYI_SUBD(HYI_SETD(corner[i]), HYI_HALFD(HYI_LOADW(packet->origin[i]), half)));
        direction[i] = HYI_HALFD(HYI_LOADW(packet->direction[i]), half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(n, direction);
    HYI_FD plane = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD least = HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), most = least;
    for (int i = 1; i < 3; i++) {
        HYI_FD to = HYI_PIND(HYI_SUBD(HYI_SETD(z[i]), HYI_HALFD(HYI_LOADW(packet->origin[2]), half)));
        HYI_FD at = HYI_PIND(HYI_MULD(to, t_by_z));
        least = HYI_MIND(at, least);
        most = HYI_MAXD(at, most);
    }
    HYI_STORED(t, HYI_MIND(most, HYI_MAXD(least, plane))); /* of two zeros the second is kept, as hyi_plane_distance keeps it */
    HYI_STORED(weights[0], b);
    HYI_STORED(weights[1], c);
    HYI_STORED(weights[2], sum);
    return ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
}

/* The plane of a triangle as hyi_plane_distance works it out: a corner and the normal. */
HYI_INLINE void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, double corner[3], double n[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        corner[i] = (double)row[0];
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner[i]);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner[i]);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t primitive, float t, const double weights[3]) {
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        double inverse = hyi_rounded_double(1.0 / weights[2]);
        if (hyi_lets_pass(&swarm->site, ray, primitive, (float)(weights[0] * inverse), (float)(weights[1] * inverse))) return false;
    }
    packet->best_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    for (int i = 0; i < 3; i++) packet->weights[i][lane] = weights[i];
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number t of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], uint32_t mask) {
    double corner[3], n[3], z[3];
    for (uint32_t k = 0; k < 3; k++) z[k] = (double)hyi_leaf_rows(swarm->site.bvh, leaf)[(3u * k + swarm->axis[2]) * hyi_leaf_count(leaf) + triangle];
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    bool found = false;
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), corner, n);
    for (int half = 0; half < 2; half++) {
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        double t[8], weights[3][8];
        if (some) some &= HYI_I(hyi_confirm_half)(packet, corners, corner, n, z, half, t, weights);
        for (; some; some &= some - 1u) {
            uint32_t lane = hyi_lowest_bit(some);
            const double w[3] = {weights[0][lane], weights[1][lane], weights[2][lane]};
            if ((float)t[lane] <= packet->best_t[base + lane] && HYI_I(hyi_take_hit)(swarm, packet, base + lane, primitive, (float)t[lane], w)) found = true;
        }
    }
    return found;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * triangles + triangle, triangles);
}

/* Offers triangle number t of a leaf to all rays but those in out, which miss it. Returns whether one of them hits it. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], HYI_MW out) {
    uint32_t left = ~HYI_BITSW(out) & HYI_ALLW;
    bool found = left && swarm->any && !swarm->site.asks_alpha && HYI_I(hyi_stop_certain)(swarm, packet, corners, out, &left);
    if (left && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, corners, left)) found = true;
    return found;
}

/* node, c: where the leaf hangs; NULL: nowhere. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count,
                                                    const hyi_node *node, uint32_t c) {
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        hyi_packet *packet = &swarm->packets[list[i]];
        bool found = false;
        if (packet->last_t < packet->first_t || (node && !HYI_I(hyi_meet_box_each)(swarm, packet, node, c))) continue;
        for (uint32_t t = 0; t < triangles; t++) {
            HYI_I(hyi_corner_all) corners[3];
            HYI_I(hyi_shear_triangle)(swarm, packet, leaf, t, corners);
            if (HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, corners, HYI_I(hyi_miss_triangle_all)(packet, corners))) found = true;
        }
        if (found) packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    }
}

/* ---- making packets */

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        if (!(HYI_GREATESTW(shear) - HYI_LEASTW(shear) <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        low[a] = HYI_LEASTW(HYI_LOADW(o[a]));
        high[a] = HYI_GREATESTW(HYI_LOADW(o[a]));
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
        packet->bound[a] = bound;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a == (int)axis ? 2 : (a + 3 - (int)axis) % 3 - 1], HYI_LOADW(inverse[a]));
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* Whether |v| <= limit in all lanes; what is not a number is not. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_all_within)(const float *v, float limit) {
    HYI_FW size = HYI_MAXW(HYI_LOADW(v), HYI_SUBW(HYI_ZEROW(), HYI_LOADW(v)));
    return HYI_BITSW(HYI_LEW(size, HYI_SETW(limit))) == HYI_ALLW;
}

/* What directions have in common: see hyi_aim_group; false: they differ in that, or in size by far. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_group)(float d[3][HYI_PACKET_WIDTH], uint32_t *group) {
    HYI_FW zero = HYI_ZEROW(), size[3];
    *group = 0;
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        uint32_t falls = HYI_BITSW(HYI_LTW(v, zero));
        if ((falls != 0u && falls != HYI_ALLW) || !HYI_I(hyi_all_within)(d[a], 1073741824.0f)) return false;
        *group |= (falls ? 1u : 0u) << a;
        size[a] = HYI_MAXW(v, HYI_SUBW(zero, v));
    }
    uint32_t y = HYI_BITSW(HYI_LTW(size[0], size[1])), z = HYI_BITSW(HYI_LTW(HYI_MAXW(size[0], size[1]), size[2]));
    if ((z != 0u && z != HYI_ALLW) || (z == 0u && y != 0u && y != HYI_ALLW)) return false;
    HYI_FW largest = HYI_MAXW(HYI_MAXW(size[0], size[1]), size[2]);
    *group |= (z ? 2u : y ? 1u : 0u) << 3;
    return HYI_LEASTW(largest) >= 9.31322574615478515625e-10f;
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_HALFD(HYI_LOADW(packet->direction[2]), half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_HALFD(HYI_LOADW(packet->direction[i]), half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common of HYI_LANES rays, by their numbers; false: they are of several groups, unsound,
   or of uncommon size. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_rays)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_packet *packet,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float d[3][HYI_PACKET_WIDTH], words[8][HYI_PACKET_WIDTH];
    uint32_t axis[3];
    HYI_RAY_WORDS(rays, numbers, words);
    HYI_FW scale = HYI_SETW(bvh->scale);
    for (uint32_t a = 0; a < 3; a++) {
        HYI_STOREW(o[a], HYI_MULW(HYI_LOADW(words[a]), scale));
        HYI_STOREW(d[a], HYI_MULW(HYI_LOADW(words[4u + a]), scale));
    }
    HYI_STOREW(packet->t_min, HYI_LOADW(words[3]));
    HYI_STOREW(packet->best_t, HYI_LOADW(words[7]));
    if (!HYI_I(hyi_find_group)(d, &packet->group)) return false;
    HYI_FW t_min = HYI_LOADW(packet->t_min), t_max = HYI_LOADW(packet->best_t), limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT)), zero = HYI_ZEROW();
    bool limits = HYI_BITSW(HYI_LEW(t_min, limit)) == HYI_ALLW && HYI_BITSW(HYI_LEW(t_min, t_max)) == HYI_ALLW;
    if (!limits || !HYI_I(hyi_all_within)(packet->t_min, FLT_MAX)) return false;
    hyi_group_axes(packet->group, axis);
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        if (!HYI_I(hyi_all_within)(o[a], 1099511627776.0f)) return false;
        v = HYI_MAXW(HYI_MAXW(v, HYI_SUBW(zero, v)), HYI_SETW(HYI_STEADY));
        HYI_STOREW(inverse[a], HYI_DIVW(HYI_SETW(packet->group >> a & 1u ? -1.0f : 1.0f), v));
        HYI_STOREW(packet->origin[a], HYI_LOADW(o[axis[a]]));
        HYI_STOREW(packet->direction[a], HYI_LOADW(d[axis[a]]));
    }
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    HYI_STOREW(packet->best_t, limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(t_min, HYI_MULW(HYI_MAXW(t_min, HYI_SUBW(zero, t_min)), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(limit, HYI_MULW(HYI_MAXW(limit, HYI_SUBW(zero, limit)), slack)));
    HYI_I(hyi_shear_packet)(packet);
    return true;
}

/* A packet of rays first, first + 1, ... of the swarm's; false: they are not alike, or not fit for one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t first) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
    }
    packet->count = HYI_LANES;
    return HYI_I(hyi_load_rays)(swarm->site.bvh, swarm->rays, packet->ray, packet, o, inverse) &&
           HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_box *box, uint32_t group, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH]) {
    HYI_FW reach[3], zero = HYI_ZEROW();
    for (int a = 0; a < 3; a++) {
        HYI_FW below = HYI_SUBW(HYI_LOADW(o[a]), HYI_SETW(box->lower[a])), above = HYI_SUBW(HYI_SETW(box->upper[a]), HYI_LOADW(o[a]));
        reach[a] = HYI_MAXW(HYI_MAXW(below, HYI_SUBW(zero, below)), HYI_MAXW(above, HYI_SUBW(zero, above)));
    }
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(o[a]), size = HYI_MAXW(v, HYI_SUBW(zero, v)), back = HYI_SUBW(zero, HYI_LOADW(inverse[a]));
        HYI_FW bound = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], reach[group >> 3])), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), size));
        bound = (group >> a & 1u) ? HYI_SUBW(zero, bound) : bound;
        HYI_STOREW(near_offset[a], HYI_MULW(HYI_ADDW(v, bound), back));
        HYI_STOREW(far_offset[a], HYI_MULW(HYI_SUBW(v, bound), back));
    }
}

/* Flights of HYI_LANES rays by their numbers; false: they must be begun one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_begin_flights)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_flight *flights) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    uint32_t plane[3][HYI_PACKET_WIDTH], axes[3][HYI_PACKET_WIDTH], none[HYI_PACKET_WIDTH] = {0}, axis[3];
    hyi_packet p;
    if (!HYI_I(hyi_load_rays)(bvh, rays, numbers, &p, o, inverse)) return false;
    HYI_I(hyi_offset_lanes)(&bvh->scaled, p.group, o, inverse, near_offset, far_offset);
    hyi_group_axes(p.group, axis);
    for (uint32_t a = 0; a < 3; a++) {
        for (uint32_t i = 0; i < HYI_LANES; i++) {
            plane[a][i] = 2u * a + (p.group >> a & 1u);
            axes[a][i] = axis[a];
        }
    }
    const void *boxes[16] = {inverse[0], inverse[1], inverse[2], near_offset[0], near_offset[1], near_offset[2], far_offset[0], far_offset[1], far_offset[2],
                             p.t_near, p.t_far, plane[0], plane[1], plane[2], p.inverse_z, p.best_t};
    const void *triangles[16] = {p.origin[0], p.origin[1], p.origin[2], p.shear[0], p.shear[1], axes[0], axes[1], axes[2],
                                 p.direction[0], p.direction[1], p.direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.inverse));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        flight->aim.t_by_z = p.t_by_z[i];
        flight->aim.unit = flight->aim.inverse_unit = 1.0;
        flight->best.t = p.best_t[i];
        flight->best.u = flight->best.v = 0.0f;
        flight->best.instance = flight->best.primitive = HYK_NONE;
        flight->t_min = p.t_min[i];
        flight->ray = &rays[numbers[i]];
    }
    return true;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, hyk_hit *hits, uint8_t *occluded) {
    for (uint32_t i = 0; i < packet->count; i++) {
        bool found = packet->instance[i] != HYK_NONE;
        if (occluded) {
            occluded[packet->ray[i]] = found ? 1 : 0;
            continue;
        }
        hyk_hit *hit = &hits[packet->ray[i]];
        double inverse = found ? hyi_rounded_double(1.0 / packet->weights[2][i]) : 0.0;
        hit->t = found ? packet->best_t[i] : -1.0f;
        hit->u = found ? (float)(packet->weights[0][i] * inverse) : 0.0f;
        hit->v = found ? (float)(packet->weights[1][i] * inverse) : 0.0f;
        hit->instance = packet->instance[i];
        hit->primitive = packet->primitive[i];
        hyi_locate_in_world(swarm->site.accel, &hit->instance, &hit->primitive);
    }
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->unit != 1.0) return false;
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
        packet->best_t[i] = flight->best.t;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->weights[2][i] = 0.0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->count = count;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* Sum 0 stands for a hit that is not the packet's own. */
HYI_INLINE void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    for (uint32_t i = 0; i < packet->count; i++) {
        hyi_best *best = &swarm->flights[packet->ray[i]].best;
        best->instance = packet->instance[i];
        if (packet->weights[2][i] == 0.0) continue;
        double inverse = hyi_rounded_double(1.0 / packet->weights[2][i]);
        best->t = packet->best_t[i];
        best->u = (float)(packet->weights[0][i] * inverse);
        best->v = (float)(packet->weights[1][i] * inverse);
        best->primitive = packet->primitive[i];
    }
}
