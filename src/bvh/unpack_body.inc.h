/* ---- what packets found, worked out for all lanes at once, and told (expanded once for each instruction set) */

/* The triangles that a packet found, and who found each. */
typedef struct HYI_I(hyi_finds) {
    HYI_MW same[HYI_PACKET_WIDTH];       /* the lanes that found the same one */
    uint32_t lanes[HYI_PACKET_WIDTH];    /* their bits */
    uint32_t leaf[HYI_PACKET_WIDTH], triangle[HYI_PACKET_WIDTH], primitive[HYI_PACKET_WIDTH];
    uint32_t count;
    float t[HYI_PACKET_WIDTH], u[HYI_PACKET_WIDTH], v[HYI_PACKET_WIDTH]; /* by lane */
} HYI_I(hyi_finds);

/* Rays of a packet find few triangles. rows: the coordinates of the one that each lane has found, corner k in rows 3 k and on,
   in the order of axis. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_gather_finds)(const hyi_bvh *bvh, const hyi_packet *packet, const uint32_t axis[3], HYI_I(hyi_finds) *finds, float rows[9][HYI_PACKET_WIDTH]) {
    HYI_I(hyi_corner_all) at[3];
    HYI_FW leaves = HYI_LOADW(packet->leaf.bits), triangles = HYI_LOADW(packet->triangle.bits);
    uint32_t left = ~HYI_BITSW(HYI_SAMEW(leaves, HYI_ZEROW())) & HYI_ALLW;
    finds->count = 0;
    for (int i = 0; i < 3; i++) at[i].x = at[i].y = at[i].z = HYI_ZEROW();
    while (left) {
        uint32_t lane = hyi_lowest_bit(left), k = finds->count++, leaf = packet->leaf.word[lane], triangle = packet->triangle.word[lane];
        HYI_MW same = HYI_ANDW(HYI_SAMEW(leaves, HYI_SETW(packet->leaf.bits[lane])), HYI_SAMEW(triangles, HYI_SETW(packet->triangle.bits[lane])));
        const float *row = hyi_leaf_rows(bvh, leaf) + triangle;
        uint32_t count = hyi_leaf_count(leaf);
        for (uint32_t i = 0; i < 3u; i++) {
            at[i].x = HYI_CHOOSEW(same, HYI_SETW(row[(3u * i + axis[0]) * count]), at[i].x);
            at[i].y = HYI_CHOOSEW(same, HYI_SETW(row[(3u * i + axis[1]) * count]), at[i].y);
            at[i].z = HYI_CHOOSEW(same, HYI_SETW(row[(3u * i + axis[2]) * count]), at[i].z);
        }
        finds->same[k] = same;
        finds->lanes[k] = HYI_BITSW(same);
        finds->leaf[k] = leaf;
        finds->triangle[k] = triangle;
        finds->primitive[k] = bvh->ids[hyi_leaf_first(leaf) + triangle];
        left &= ~finds->lanes[k];
    }
    for (int i = 0; i < 3; i++) {
        HYI_STOREW(rows[3 * i], at[i].x);
        HYI_STOREW(rows[3 * i + 1], at[i].y);
        HYI_STOREW(rows[3 * i + 2], at[i].z);
    }
}

/* The planes of as many triangles as there are lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_planes_half)(float rows[9][HYI_PACKET_WIDTH], int half, HYI_I(hyi_plane_half) *plane) {
    HYI_FD e[3], f[3];
    for (int i = 0; i < 3; i++) {
        plane->corner[i] = HYI_LOADH(rows[i], half);
        e[i] = HYI_PIND(HYI_SUBD(HYI_LOADH(rows[i + 3], half), plane->corner[i]));
        f[i] = HYI_PIND(HYI_SUBD(HYI_LOADH(rows[i + 6], half), plane->corner[i]));
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        plane->n[i] = HYI_PIND(HYI_SUBD(HYI_PIND(HYI_MULD(e[j], f[k])), HYI_PIND(HYI_MULD(e[k], f[j]))));
    }
    plane->z[0] = HYI_LOADH(rows[5], half);
    plane->z[1] = HYI_LOADH(rows[8], half);
}

/* hyi_confirm for all lanes of a packet, each with its own triangle. Returns bits of those whose t it has to settle itself. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_rows)(const hyi_packet *packet, float rows[9][HYI_PACKET_WIDTH], float *t, float *u, float *v) {
    HYI_I(hyi_sheared) corners;
    uint32_t doubtful = 0;
    for (int k = 0; k < 3; k++) {
        HYI_FW x = HYI_LOADW(rows[3 * k]), y = HYI_LOADW(rows[3 * k + 1]), z = HYI_LOADW(rows[3 * k + 2]);
        HYI_I(hyi_store_corner)(&corners, k, HYI_I(hyi_shear_lanes)(packet, x, y, z));
    }
    for (int half = 0; half < 2; half++) {
        HYI_I(hyi_plane_half) plane;
        HYI_I(hyi_outcome_half) outcome;
        HYI_I(hyi_planes_half)(rows, half, &plane);
        HYI_I(hyi_confirm_half)(packet, &corners, &plane, half, &outcome);
        HYI_STOREH(t, half, outcome.t);
        HYI_I(hyi_store_weights)(&outcome, half, u, v);
        doubtful |= outcome.doubtful << (uint32_t)half * (HYI_LANES / 2u);
    }
    return doubtful;
}

/* Works out all hits of a packet. */
HYI_FN HYI_TARGET void HYI_I(hyi_work_out)(const hyi_swarm *swarm, const hyi_packet *packet, HYI_I(hyi_finds) *finds) {
    float rows[9][HYI_PACKET_WIDTH];
    uint32_t axis[3];
    hyi_group_axes(packet->group, axis);
    HYI_I(hyi_gather_finds)(swarm->site.bvh, packet, axis, finds, rows);
    if (finds->count == 0) return;
    for (uint32_t left = HYI_I(hyi_confirm_rows)(packet, rows, finds->t, finds->u, finds->v); left; left &= left - 1u) {
        uint32_t lane = hyi_lowest_bit(left);
        finds->t[lane] = hyi_settle_lane(packet, swarm->site.bvh, axis, lane, packet->leaf.word[lane], packet->triangle.word[lane]);
    }
}

/* Some flights of one tree with hits that are put off, at most HYI_LANES, as they are read for that. */
typedef struct HYI_I(hyi_put_off) {
    hyi_flight *flights[HYI_PACKET_WIDTH];
    uint32_t count;
} HYI_I(hyi_put_off);

/* What hyi_confirm needs of a flight, into a lane of a packet, and of its triangle: the coordinates of corner k in rows 3 k and on,
   in the order of axis. */
HYI_INLINE void HYI_I(hyi_lay_flight)(const hyi_bvh *bvh, const hyi_flight *flight, hyi_packet *packet, float rows[9][HYI_PACKET_WIDTH], uint32_t lane) {
    const hyi_aim *aim = &flight->aim;
    const float *row = hyi_leaf_rows(bvh, aim->leaf) + aim->lane;
    uint32_t count = hyi_leaf_count(aim->leaf);
    for (uint32_t i = 0; i < 3u; i++) {
        const float *at = row + aim->axis[i] * count;
        packet->origin[i][lane] = aim->origin[i];
        packet->direction[i][lane] = aim->direction[i];
        rows[i][lane] = at[0];
        rows[i + 3u][lane] = at[3u * count];
        rows[i + 6u][lane] = at[6u * count];
    }
    packet->shear[0][lane] = aim->shear[0];
    packet->shear[1][lane] = aim->shear[1];
    packet->t_by_z[lane] = aim->t_by_z;
}

/* Takes a hit that has been worked out if it is the best: hyi_decide. */
HYI_INLINE void HYI_I(hyi_take_worked_out)(const hyi_site *site, hyi_flight *flight, float t, float u, float v) {
    uint32_t leaf = flight->aim.leaf, primitive = site->bvh->ids[hyi_leaf_first(leaf) + flight->aim.lane];
    flight->aim.leaf = 0;
    if (!(t >= flight->t_min && t <= flight->best.t) || !hyi_beats(&flight->best, t, site->instance, primitive)) return;
    hyi_set_best(site, flight, leaf, flight->aim.lane, primitive, t, u, v);
}

/* hyi_settle of all. */
HYI_FN HYI_TARGET void HYI_I(hyi_settle_lanes)(const hyi_site *site, const HYI_I(hyi_put_off) *some) {
    float at[9][HYI_PACKET_WIDTH], t[HYI_PACKET_WIDTH], u[HYI_PACKET_WIDTH], v[HYI_PACKET_WIDTH];
    hyi_packet packet;
    for (uint32_t i = 0; i < HYI_LANES; i++) HYI_I(hyi_lay_flight)(site->bvh, some->flights[i < some->count ? i : 0u], &packet, at, i);
    uint32_t doubtful = HYI_I(hyi_confirm_rows)(&packet, at, t, u, v);
    for (uint32_t i = 0; i < some->count; i++) {
        if (doubtful >> i & 1u) hyi_settle(site, some->flights[i]);
        else HYI_I(hyi_take_worked_out)(site, some->flights[i], t[i], u[i], v[i]);
    }
}

/* Works out what the first count flights have put off, as many at a time as there are lanes, while the triangles of as many more
   are asked for. */
HYI_FN HYI_TARGET void HYI_I(hyi_settle_all)(const hyi_site *site, hyi_flight *flights, uint32_t count) {
    HYI_I(hyi_put_off) some[2];
    uint32_t side = 0;
    some[0].count = some[1].count = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t leaf = flights[i].aim.leaf;
        const char *rows = (const char *)hyi_leaf_rows(site->bvh, leaf);
        for (uint32_t line = 0; line < 4u; line++) hyi_prefetch(rows + 64u * line);
        hyi_prefetch(&site->bvh->ids[hyi_leaf_first(leaf)]);
        some[side].flights[some[side].count] = &flights[i];
        some[side].count += leaf ? 1u : 0u;
        if (some[side].count < HYI_LANES) continue;
        side ^= 1u;
        if (some[side].count) HYI_I(hyi_settle_lanes)(site, &some[side]);
        some[side].count = 0;
    }
    for (uint32_t k = 0; k < 2u; k++)
        if (some[k].count) HYI_I(hyi_settle_lanes)(site, &some[k]);
}

/* ---- answers */

HYI_INLINE void HYI_I(hyi_unpack_occluded)(const hyi_packet *packet, uint8_t *occluded) {
    for (uint32_t left = packet->live; left; left &= left - 1u) {
        uint32_t lane = hyi_lowest_bit(left);
        occluded[packet->ray[lane]] = packet->instance[lane] != HYK_NONE ? 1 : 0;
    }
}

/* What the rays of one find have in common. Packets of rays are in the first tree alone, whose triangles are unmoved. */
HYI_INLINE void HYI_I(hyi_record_find)(const hyi_swarm *swarm, const HYI_I(hyi_finds) *finds, uint32_t f, bool told, hyi_record *record) {
    const hyi_accel *accel = swarm->site.accel;
    hyk_hit hit;
    hit.t = hit.u = hit.v = 0.0f;
    hit.instance = swarm->site.instance;
    hit.primitive = finds->primitive[f];
    hyi_locate_in_world(accel, &hit.instance, &hit.primitive);
    if (told) hyi_tell_surface(accel, hit, hyi_normal_of_lane(accel, swarm->site.bvh, finds->leaf[f], finds->triangle[f], hit), &record->told);
    else record->hit = hit;
}

/* Answers of all lanes, a row of each of their words. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_record_all)(const hyi_swarm *swarm, const HYI_I(hyi_finds) *finds, bool told, uint32_t words,
                                                 float rows[HYI_RECORD_WORDS][HYI_PACKET_WIDTH]) {
    hyi_record record;
    HYI_FW row[HYI_RECORD_WORDS];
    if (told) hyi_tell_miss(&record.told);
    else hyi_answer_miss(&record.hit);
    for (uint32_t w = 0; w < words; w++) row[w] = HYI_SETW(record.words[w]);
    for (uint32_t f = 0; f < finds->count; f++) {
        HYI_MW same = finds->same[f];
        HYI_I(hyi_record_find)(swarm, finds, f, told, &record);
        row[0] = HYI_CHOOSEW(same, HYI_LOADW(finds->t), row[0]);
        row[1] = HYI_CHOOSEW(same, HYI_LOADW(finds->u), row[1]);
        row[2] = HYI_CHOOSEW(same, HYI_LOADW(finds->v), row[2]);
        for (uint32_t w = 3; w < words; w++) row[w] = HYI_CHOOSEW(same, HYI_SETW(record.words[w]), row[w]);
    }
    for (uint32_t w = 0; w < words; w++) HYI_STOREW(rows[w], row[w]);
}

/* Answers of so many words each, to those of HYI_LANES rays that live. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_records)(const hyi_swarm *swarm, const hyi_packet *packet, const HYI_I(hyi_finds) *finds,
                                                     bool told, uint32_t words, char *out) {
    float rows[HYI_RECORD_WORDS][HYI_PACKET_WIDTH];
    char all[HYI_PACKET_WIDTH * sizeof(hyi_record)];
    size_t size = words * sizeof(float);
    HYI_I(hyi_record_all)(swarm, finds, told, words, rows);
    if (packet->live == HYI_ALLW) {
        HYI_RECORDS(rows, words, out);
        return;
    }
    HYI_RECORDS(rows, words, all);
    for (uint32_t left = packet->live; left; left &= left - 1u) memcpy(out + hyi_lowest_bit(left) * size, all + hyi_lowest_bit(left) * size, size);
}

HYI_FN HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, const hyi_answers *answers) {
    HYI_I(hyi_finds) finds;
    HYI_I(hyi_work_out)(swarm, packet, &finds);
    if (answers->told) HYI_I(hyi_unpack_records)(swarm, packet, &finds, true, HYI_WORDS_OF(hydra_hit), (char *)&answers->told[packet->ray[0]]);
    else HYI_I(hyi_unpack_records)(swarm, packet, &finds, false, HYI_WORDS_OF(hyk_hit), (char *)&answers->hits[packet->ray[0]]);
}

/* Answers the rays of count packets. */
HYI_FN HYI_TARGET void HYI_I(hyi_unpack_all)(const hyi_swarm *swarm, uint32_t count, const hyi_answers *answers) {
    for (uint32_t i = 0; i < count; i++) {
        if (i + 3u < count) hyi_prefetch_answers(answers, swarm->packets[i + 3u].ray[0], HYI_LANES);
        if (swarm->any) HYI_I(hyi_unpack_occluded)(&swarm->packets[i], answers->occluded);
        else HYI_I(hyi_unpack_rays)(swarm, &swarm->packets[i], answers);
    }
}

/* Hits that are not the packet's own are the flights' already. */
HYI_FN HYI_TARGET void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    HYI_I(hyi_finds) finds;
    for (uint32_t left = packet->live; left; left &= left - 1u) {
        uint32_t lane = hyi_lowest_bit(left);
        swarm->flights[packet->ray[lane]].best.instance = packet->instance[lane];
    }
    if (swarm->any) return;
    HYI_I(hyi_work_out)(swarm, packet, &finds);
    for (uint32_t f = 0; f < finds.count; f++) {
        for (uint32_t left = finds.lanes[f]; left; left &= left - 1u) {
            uint32_t lane = hyi_lowest_bit(left);
            hyi_set_best(&swarm->site, &swarm->flights[packet->ray[lane]], finds.leaf[f], finds.triangle[f], finds.primitive[f],
                         finds.t[lane], finds.u[lane], finds.v[lane]);
        }
    }
}
