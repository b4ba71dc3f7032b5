/* ---- a list of flights at a leaf (expanded once for each instruction set)

   Where there are enough of them, as many as a vector has lanes meet a triangle at once, as the rays of a packet do, though they
   may go anywhere: each lane takes the coordinates of corners in the order of its own axes. Few meet all triangles of the leaf at
   once, one after the other. */

/* ---- many */

/* Flights side by side: what triangles need of them, where packets keep it. */
typedef struct HYI_I(hyi_abreast) {
    hyi_packet rays;
    hyi_flight *flights[HYI_PACKET_WIDTH];
    HYI_I(hyi_frames) frames;
    uint32_t live; /* bits of the lanes with a flight */
} HYI_I(hyi_abreast);

/* Flights by their numbers; lanes beyond the last repeat the first. false: float tells nothing of some. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_go_abreast)(const hyi_swarm *swarm, const uint32_t *list, uint32_t count, HYI_I(hyi_abreast) *abreast) {
    const char *at[HYI_LANES];
    HYI_FW limits[4], start[4], frame[4];
    hyi_packet *rays = &abreast->rays;
    uint32_t exact = 0;
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &swarm->flights[list[i < count ? i : 0u]];
        abreast->flights[i] = flight;
        at[i] = (const char *)flight;
        exact |= flight->aim.exact;
    }
    if (exact) return false;
    HYI_FOUR_WORDS(at, offsetof(hyi_flight, aim.t_near), limits);
    HYI_FOUR_WORDS(at, offsetof(hyi_flight, aim.origin), start);
    HYI_FOUR_WORDS(at, offsetof(hyi_flight, aim.shear[1]), frame);
    HYI_STOREW(rays->t_near, limits[0]);
    HYI_STOREW(rays->t_far, limits[1]);
    HYI_STOREW(rays->inverse_z, limits[2]);
    HYI_STOREW(rays->least_t, limits[3]);
    for (uint32_t k = 0; k < 3; k++) HYI_STOREW(rays->origin[k], start[k]);
    HYI_STOREW(rays->shear[0], start[3]);
    HYI_STOREW(rays->shear[1], frame[0]);
    HYI_STOREW(rays->direction[2], HYI_DIVW(HYI_SETW(1.0f), limits[2])); /* a rounding off: bounds of errors are all it is for */
    abreast->frames = HYI_I(hyi_frames_of)(frame + 1);
    abreast->live = HYI_ALLW >> (HYI_LANES - count);
    return true;
}

/* A triangle for each lane that may hit one: the one that it is judged by next. */
typedef struct HYI_I(hyi_held) {
    HYI_I(hyi_meeting) m; /* possible: the lanes that hold one */
    HYI_FW triangle;
} HYI_I(hyi_held);

/* Where a lane may hit the triangle it met last, it holds that. misses: all other lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_hold)(HYI_I(hyi_held) *held, const HYI_I(hyi_meeting) *last, HYI_MW misses, uint32_t triangle) {
    HYI_I(hyi_meeting) *m = &held->m;
    for (uint32_t i = 0; i < 3; i++) {
        m->corners[i].x = HYI_CHOOSEW(misses, m->corners[i].x, last->corners[i].x);
        m->corners[i].y = HYI_CHOOSEW(misses, m->corners[i].y, last->corners[i].y);
        m->w[i] = HYI_CHOOSEW(misses, m->w[i], last->w[i]);
        m->t[i] = HYI_CHOOSEW(misses, m->t[i], last->t[i]);
    }
    m->least_w = HYI_CHOOSEW(misses, m->least_w, last->least_w);
    m->most_w = HYI_CHOOSEW(misses, m->most_w, last->most_w);
    m->first = HYI_CHOOSEW(misses, m->first, last->first);
    m->last = HYI_CHOOSEW(misses, m->last, last->last);
    m->possible |= last->possible;
    held->triangle = HYI_CHOOSEW(misses, held->triangle, HYI_I(hyi_whole)(triangle));
}

/* Decides for one lane after the other. Returns the bits of those with a hit. */
HYI_FN uint32_t HYI_I(hyi_offer_to_lanes)(const hyi_swarm *swarm, HYI_I(hyi_abreast) *abreast, uint32_t leaf, const hyi_lane_words *triangle, uint32_t mask) {
    uint32_t found = 0;
    for (; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        hyi_flight *flight = abreast->flights[lane];
        if (!HYI_I(hyi_offer)(&swarm->site, flight, leaf, triangle->word[lane])) continue;
        if (swarm->any) hyi_flight_stop(flight);
        abreast->rays.t_far[lane] = flight->aim.t_far;
        abreast->rays.least_t[lane] = flight->aim.least_t;
        found |= 1u << lane;
    }
    return found;
}

/* Judges the triangles held: hits that are nearer for certain than all before are put off, and what float cannot tell is decided.
   Returns the bits of the lanes with a hit. A lane that holds what it was judged by before is not nearer again: least_t is no more. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_judge_held)(const hyi_swarm *swarm, HYI_I(hyi_abreast) *abreast, uint32_t leaf, const HYI_I(hyi_held) *held, bool any) {
    hyi_packet *rays = &abreast->rays;
    HYI_I(hyi_verdict_all) verdict;
    hyi_lane_words triangle;
    float most[HYI_PACKET_WIDTH];
    HYI_I(hyi_judge_all)(rays, &held->m, &verdict);
    uint32_t left = held->m.possible & ~verdict.missed;
    if (!left) return 0;
    HYI_FW limit = HYI_ADDW(verdict.most, HYI_MULW(HYI_SETW(4.0f * HYI_ULP), HYI_SIZEW(verdict.most)));
    HYI_MW nearer = HYI_ANDW(verdict.certain, HYI_LTW(verdict.most, HYI_LOADW(rays->least_t)));
    uint32_t sure = swarm->site.asks_alpha ? 0u : left & HYI_BITSW(nearer);
    HYI_STOREW(triangle.bits, held->triangle);
    if (sure) {
        HYI_STOREW(most, verdict.most);
        HYI_STOREW(rays->least_t, HYI_CHOOSEW(nearer, verdict.least, HYI_LOADW(rays->least_t)));
        HYI_STOREW(rays->t_far, HYI_CHOOSEW(nearer, any ? HYI_SETW(-FLT_MAX) : limit, HYI_LOADW(rays->t_far)));
    }
    for (uint32_t mask = sure; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        hyi_postpone(&swarm->site, abreast->flights[lane], leaf, triangle.word[lane], rays->least_t[lane], most[lane], any);
    }
    return left == sure ? sure : sure | HYI_I(hyi_offer_to_lanes)(swarm, abreast, leaf, &triangle, left & ~sure);
}

/* Triangle number triangle of a leaf to all lanes; returns those that certainly miss it. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_meet_triangle_abreast)(const HYI_I(hyi_abreast) *abreast, const HYI_I(hyi_leaf_all) *leaf, uint32_t triangle, HYI_I(hyi_meeting) *m) {
    for (uint32_t k = 0; k < 3; k++) {
        HYI_FW v[3];
        HYI_I(hyi_turn_corner)(&abreast->frames, leaf, triangle, k, v);
        m->corners[k] = HYI_I(hyi_shear_lanes)(&abreast->rays, v[0], v[1], v[2]);
    }
    HYI_MW misses = HYI_I(hyi_meet_corners_all)(&abreast->rays, m);
    m->possible &= abreast->live;
    return misses;
}

/* Offers a leaf's triangles, one after the other, to all lanes. Few lanes may hit any one of them, so these are judged together.
   Returns how many have a hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_offer_leaf_abreast)(const hyi_swarm *swarm, HYI_I(hyi_abreast) *abreast, uint32_t leaf, bool any) {
    uint32_t count = hyi_leaf_count(leaf), triangle = 0, found = 0;
    HYI_I(hyi_leaf_all) all = HYI_I(hyi_open_leaf)(hyi_leaf_rows(swarm->site.bvh, leaf), count);
    HYI_I(hyi_held) held;
    do (void)HYI_I(hyi_meet_triangle_abreast)(abreast, &all, triangle, &held.m);
    while (!held.m.possible && ++triangle < count);
    if (triangle == count) return 0;
    held.triangle = HYI_I(hyi_whole)(triangle);
    while (++triangle < count) {
        HYI_I(hyi_meeting) m;
        HYI_MW misses = HYI_I(hyi_meet_triangle_abreast)(abreast, &all, triangle, &m);
        if (!m.possible) continue;
        if (m.possible & held.m.possible) {
            found |= HYI_I(hyi_judge_held)(swarm, abreast, leaf, &held, any);
            held.m.possible = 0;
        }
        HYI_I(hyi_hold)(&held, &m, misses, triangle);
    }
    if (held.m.possible) found |= HYI_I(hyi_judge_held)(swarm, abreast, leaf, &held, any);
    return hyi_count_lanes(found);
}

/* ---- few */

/* hyi_offer_leaf with its most common end, a single triangle that is hit for certain, and before all others, by itself. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf_straight)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    HYI_I(hyi_sight) sight = HYI_I(hyi_sight_of)(&flight->aim);
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&sight, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), false);
    uint32_t possible = verdicts.possible;
    if (!possible) return false;
    uint32_t lane = hyi_lowest_bit(possible), nearer = (uint32_t)(verdicts.most[lane] < flight->aim.least_t);
    if (HYI_UNLIKELY((possible & (possible - 1u)) | (possible & ~verdicts.certain) | (nearer ^ 1u))) {
        bool found = HYI_I(hyi_offer_possible)(site, flight, leaf, &verdicts, any);
        if (found && any) hyi_flight_stop(flight);
        return found;
    }
    hyi_postpone(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane], any);
    return true;
}

HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf_alone)(const hyi_swarm *swarm, hyi_flight *flight, uint32_t leaf) {
    if (!swarm->site.asks_alpha && !flight->aim.exact) return HYI_I(hyi_offer_leaf_straight)(&swarm->site, flight, leaf, swarm->any);
    bool found = HYI_I(hyi_offer_leaf)(&swarm->site, flight, leaf, swarm->any);
    if (found && swarm->any) hyi_flight_stop(flight);
    return found;
}

/* Flights by their numbers, each at a leaf of its own. Returns how many had a hit. */
HYI_NOINLINE HYI_TARGET uint32_t HYI_I(hyi_offer_leaves_each)(const hyi_swarm *swarm, const uint32_t *leaves, const uint32_t *list, uint32_t count) {
    uint32_t hits = 0;
    for (uint32_t i = 0; i < count; i++) {
        hyi_prefetch_flight(&swarm->flights[list[i + 1u < count ? i + 1u : i]]);
        hyi_prefetch_leaf_early(swarm->site.bvh, leaves[i + HYI_LEAVES_EARLY < count ? i + HYI_LEAVES_EARLY : i]);
        hyi_prefetch_child(swarm->site.bvh, leaves[i + 3u < count ? i + 3u : i]);
        hits += HYI_I(hyi_offer_leaf_alone)(swarm, &swarm->flights[list[i]], leaves[i]) ? 1u : 0u;
    }
    return hits;
}

/* ---- all */

/* The same of all at one leaf, at most HYI_LANES. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_offer_leaf_each)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    uint32_t leaves[HYI_LANES];
    for (uint32_t i = 0; i < count; i++) leaves[i] = leaf;
    return HYI_I(hyi_offer_leaves_each)(swarm, leaves, list, count);
}

/* Some flights, at most HYI_LANES. */
HYI_NOINLINE HYI_TARGET uint32_t HYI_I(hyi_leaf_abreast)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    HYI_I(hyi_abreast) abreast;
    if (!HYI_I(hyi_go_abreast)(swarm, list, count, &abreast)) return HYI_I(hyi_offer_leaf_each)(swarm, leaf, list, count);
    return swarm->any ? HYI_I(hyi_offer_leaf_abreast)(swarm, &abreast, leaf, true) : HYI_I(hyi_offer_leaf_abreast)(swarm, &abreast, leaf, false);
}

/* Rays of a list meet a leaf abreast as long as there are enough; returns how many are left, the last of the list. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_list_leaf_abreast)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *hits) {
    uint32_t enough = HYI_ABREAST_LEAST(hyi_leaf_count(leaf));
    for (; count >= enough || count >= HYI_LANES; list += HYI_LANES) {
        uint32_t some = count < HYI_LANES ? count : HYI_LANES;
        *hits += HYI_I(hyi_leaf_abreast)(swarm, leaf, list, some);
        count -= some;
    }
    return count;
}

/* All of a list, where the leaf is all of the tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_whole)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    uint32_t hits = 0, left = HYI_I(hyi_list_leaf_abreast)(swarm, leaf, list, count, &hits);
    (void)HYI_I(hyi_offer_leaf_each)(swarm, leaf, list + (count - left), left);
}
