/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. Bits of floats, compared as integers, are
   in the order of floats but for two negative ones. Integers are the sooner compared, and a ray that goes alone waits for every
   comparison on its way: where it begins at t +0 or later, what is negative is behind it, however it compares, and a box that
   is left there is not met. Rays that begin earlier compare floats. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter, bool alone) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    if (!alone || hyi_has_sign(aim->t_near)) {
        *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
        return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
    }
    *enter = HYI_MAX8_AS_INTS(HYI_MAX8_AS_INTS(nx, ny), HYI_MAX8_AS_INTS(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8_AS_INTS(HYI_MIN8_AS_INTS(fx, fy), HYI_MIN8_AS_INTS(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(hyi_planes_at(node, aim->near_plane[a]));
        far_planes[a] = HYI_LOAD8(hyi_planes_at(node, aim->near_plane[a] ^ HYI_WIDTH));
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t, true));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

/* What triangles need of one ray: see hyi_aim. */
typedef struct HYI_I(hyi_sight) {
    float origin[3], shear[2], inverse_z, along_z, t_near, t_far;
    uint32_t axis[3];
} HYI_I(hyi_sight);

HYI_INLINE HYI_I(hyi_sight) HYI_I(hyi_sight_of)(const hyi_aim *aim) {
    HYI_I(hyi_sight) sight;
    for (int i = 0; i < 3; i++) {
        sight.origin[i] = aim->origin[i];
        sight.axis[i] = aim->axis[i];
    }
    sight.shear[0] = aim->shear[0];
    sight.shear[1] = aim->shear[1];
    sight.inverse_z = aim->inverse_z;
    sight.along_z = fabsf(aim->direction[2]);
    sight.t_near = aim->t_near;
    sight.t_far = aim->t_far;
    return sight;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const HYI_I(hyi_sight) *sight, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + sight->axis[2] * stride), HYI_SET8(sight->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + sight->axis[0] * stride), HYI_SET8(sight->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + sight->axis[1] * stride), HYI_SET8(sight->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(sight->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(sight->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t, by whichever weights (hyi_settle_distance), by their share in the sum, of the
   difference between t at the corners; rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise
   could have made says nothing, nor do numbers whose products come near to underflow; overflow is out of reach, for trees keep
   coordinates below 2^20. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const HYI_I(hyi_sight) *sight, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_SIZE8(sum);
    HYI_F8 farthest = HYI_MAX8(HYI_SIZE8(first), HYI_SIZE8(last)), along = HYI_MUL8(farthest, HYI_SET8(sight->along_z));
    for (int i = 0; i < 3; i++) across = HYI_MAX8(across, HYI_MAX8(HYI_SIZE8(k[i].x), HYI_SIZE8(k[i].y)));
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_SIZE8(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MUL8(HYI_SET8(4.0f), noise), size));
    HYI_F8 product = HYI_MIN8(HYI_MIN8(size, farthest), HYI_MUL8(size, farthest));
    known = HYI_AND8(known, HYI_LT8(HYI_SET8(HYI_EDGE_LEAST), product));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(sight->t_near)), HYI_LT8(HYI_SET8(sight->t_far), least)));
    float from = sight->t_near + 16.0f * HYI_ULP * fabsf(sight->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Bits of the triangles that seem to be met beyond one of the limits: without a division, and without a bound of what is rounded. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_seem_beyond)(const HYI_I(hyi_sight) *sight, const HYI_F8 w[3], const HYI_F8 t[3]) {
    HYI_F8 sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), total = HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), zero = HYI_ZERO8();
    HYI_F8 from_near = HYI_MUL8(HYI_SUB8(total, HYI_MUL8(HYI_SET8(sight->t_near), sum)), sum);
    HYI_F8 from_far = HYI_MUL8(HYI_SUB8(total, HYI_MUL8(HYI_SET8(sight->t_far), sum)), sum);
    return HYI_BITS8(HYI_OR8(HYI_LT8(from_near, zero), HYI_LT8(zero, from_far)));
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. exact: nothing is certain. alone: hits are decided on at once, so a closer look is for what seems to be
   no hit, such as the triangle that the ray comes from. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_corners)(const HYI_I(hyi_sight) *sight, const HYI_I(hyi_corners) k[3], uint32_t count, bool exact,
                                                              bool alone) {
    HYI_I(hyi_verdicts) verdicts;
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(sight->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(sight->t_far), first), HYI_LT8(last, HYI_SET8(sight->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (!verdicts.possible || exact || (alone && !(HYI_I(hyi_seem_beyond)(sight, w, t) & verdicts.possible))) return verdicts;
    HYI_I(hyi_judge_triangles)(sight, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Lanes past count hold other triangles of the tree, or zeros. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangles)(const HYI_I(hyi_sight) *sight, const float *rows, uint32_t count, HYI_I(hyi_corners) k[3]) {
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(sight, rows + 3u * i * count, count);
}

HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const HYI_I(hyi_sight) *sight, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_shear_triangles)(sight, rows, count, k);
    return HYI_I(hyi_meet_corners)(sight, k, count, exact, false);
}

/* hyi_decide, after what was put off. Out of line: decisions would take the registers of the walk. */
HYI_NOINLINE HYI_TARGET bool HYI_I(hyi_offer_sheared)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, const float *sheared) {
    uint32_t waits = flight->aim.leaf;
    if (waits) {
        flight->aim.leaf = 0;
        (void)HYI_I(hyi_offer_sheared)(site, flight, waits, flight->aim.lane, NULL);
    }
    return hyi_decide_sheared(site, flight, leaf, lane, sheared);
}

HYI_FN HYI_TARGET bool HYI_I(hyi_offer)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane) {
    return HYI_I(hyi_offer_sheared)(site, flight, leaf, lane, NULL);
}

/* Takes a triangle that is certainly hit, at t between least and most: puts it off where that is nearer than all before,
   and else decides. Most hits are so never worked out: one nearer comes. Only two lines of the flight are touched. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_expect)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, float least, float most, bool any) {
    if (most >= flight->aim.least_t) return HYI_I(hyi_offer)(site, flight, leaf, lane);
    hyi_postpone(site, flight, leaf, lane, least, most, any);
    return true;
}

/* Offers those of a leaf's triangles that a ray may hit. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_possible)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, const HYI_I(hyi_verdicts) *verdicts, bool any) {
    bool found = false;
    for (uint32_t mask = verdicts->possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts->certain >> lane & 1u) {
            if (verdicts->least[lane] > flight->aim.t_far) continue;
            found = HYI_I(hyi_expect)(site, flight, leaf, lane, verdicts->least[lane], verdicts->most[lane], any) || found;
        } else {
            found = HYI_I(hyi_offer)(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* Offers a leaf's triangles to a ray. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.exact;
    HYI_I(hyi_sight) sight = HYI_I(hyi_sight_of)(&flight->aim);
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&sight, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    return HYI_I(hyi_offer_possible)(site, flight, leaf, &verdicts, any);
}

/* Decides on a leaf's triangles at once: with one ray there is nothing to put them off for, since few of them pass in float, and
   most of those are hit. false: there were none, and nothing has changed. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf) {
    HYI_I(hyi_sight) sight = HYI_I(hyi_sight_of)(&flight->aim);
    HYI_I(hyi_corners) k[3];
    float sheared[6][8];
    HYI_I(hyi_shear_triangles)(&sight, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), k);
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_corners)(&sight, k, hyi_leaf_count(leaf), HYI_EXACT_ALONE || flight->aim.exact, true);
    if (!verdicts.possible) return false;
    hyi_prefetch(&site->bvh->ids[hyi_leaf_first(leaf)]);
    for (int i = 0; i < 3; i++) {
        HYI_STORE8(sheared[2 * i], k[i].x);
        HYI_STORE8(sheared[2 * i + 1], k[i].y);
    }
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        (void)HYI_I(hyi_offer_sheared)(site, flight, leaf, lane, &sheared[0][lane]);
    }
    return true;
}

/* One ray through a tree of triangles, from child at on. What a list has put off before stays so. Memory is asked for all of a node's
   children that are met, but not where any hit will do: such a ray ends before it comes to most of them. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_ahead ahead = hyi_ahead_of(site->bvh);
    hyi_waiting stack[HYI_STACK], *top = stack, limit = hyi_waiting_limit(flight->aim.t_far);
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t others = mask & (mask - 1u);
            at = node->child[hyi_lowest_bit(mask)];
            if (others & (others - 1u)) at = HYI_PUSH_SEVERAL(&top, node, enter, mask, any ? NULL : &ahead);
            else if (others) at = hyi_push_farther(&top, node->child, enter, mask, any ? NULL : &ahead);
            else if (!any) hyi_ask_for(&ahead, at);
        }
        if (at != HYI_CHILD_NONE && any) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, true)) return;
        } else if (at != HYI_CHILD_NONE && HYI_I(hyi_decide_leaf)(site, flight, at)) {
            limit = hyi_waiting_limit(flight->aim.t_far);
        }
        do {
            if (top == stack) return;
            top--;
        } while (*top > limit);
        at = (uint32_t)*top;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, mask, NULL);
                *top++ = hyi_waiting_of(nearest, -FLT_MAX);
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (hyi_waiting_t(*top) > flight->aim.t_far);
        at = (uint32_t)*top;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}

/* Rays one by one, from their beginnings on; answers them, and returns whether all were sound. */
HYI_FN HYI_TARGET bool HYI_I(hyi_trace_singles)(const hyi_accel *accel, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    hyi_site site = hyi_first_site(accel);
    bool sound = true, any = answers->occluded != NULL;
    double n[3];
    if (answers->told && site.bvh->rows && site.bvh->scale == 1.0f) site.normal = n; /* the tree has the mesh's own floats */
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        if (HYI_FLIGHT_BEGIN(&flight, accel, site.bvh, &rays[i])) HYI_I(hyi_walk_scene)(&site, &flight, site.bvh->root, any);
        else sound = hyi_was_sound(&rays[i]) && sound; /* it meets nothing */
        hyi_tell(accel, &flight, site.normal, answers, i);
    }
    return sound;
}
