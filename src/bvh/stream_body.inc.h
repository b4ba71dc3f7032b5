/* ---- many rays (expanded once for each instruction set)

   Lists hold numbers of flights, or of packets. Each list of a node's children has room for all of the node's. What sends
   a list of flights down says how often these met something nearer than before. */

HYI_FN HYI_TARGET void HYI_I(hyi_list_visit_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space);

/* Keeps of a list the rays that have not met anything nearer than the box of child c since they were put on it; returns
   how many these are. Without a branch: it would be taken by chance. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_still_meet)(const hyi_swarm *swarm, const hyi_node *node, uint32_t c, uint32_t *list, uint32_t count) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t ray = list[i];
        const hyi_aim *aim = &swarm->flights[ray].aim;
        float tx = hyi_planes_at(node, aim->near_plane[0])[c] * aim->inverse[0] + aim->near_offset[0];
        float ty = hyi_planes_at(node, aim->near_plane[1])[c] * aim->inverse[1] + aim->near_offset[1];
        float tz = hyi_planes_at(node, aim->near_plane[2])[c] * aim->inverse[2] + aim->near_offset[2];
        float enter = tx > ty ? tx : ty;
        enter = tz > enter ? tz : enter;
        list[kept] = ray;
        kept += enter <= aim->t_far ? 1u : 0u;
    }
    return kept;
}

/* Puts each of count flights on the lists of the children that it meets; nearest: the least t at which each child is entered. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal_rays)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                                uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH]) {
    HYI_F8 least = HYI_SET8(FLT_MAX);
    uint32_t first = HYI_DEAL_BLOCKS(swarm, node, list, count, lists, stride, dealt, &least);
    for (; first < count; first += 8u) {
        uint32_t some = count - first < 8u ? count - first : 8u;
        hyi_masks8 masks;
        masks.all = 0;
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            HYI_I(hyi_planes) planes;
            const hyi_aim *aim = &swarm->flights[list[first + i]].aim;
            HYI_I(hyi_order_planes)(node, aim->near_plane, &planes);
            HYI_M8 mask = HYI_I(hyi_meet_boxes)(aim, planes.near_planes, planes.far_planes, &enter, false);
            least = HYI_MIN8_WHERE(least, mask, enter);
            masks.bytes[i] = (uint8_t)HYI_BITS8(mask);
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
}

/* The same of packets, which have their near planes in common. Those that seem to meet many children, and begin at different points,
   are looked at by each ray afterwards, as no pairs are: a branch in the midst of the others would be taken by chance. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal_packets)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                                   uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH]) {
    HYI_I(hyi_planes) planes;
    HYI_F8 least = HYI_SET8(FLT_MAX);
    HYI_I(hyi_order_planes)(node, swarm->near_plane, &planes);
    for (uint32_t first = 0; first < count; first += 8u) {
        uint32_t some = count - first < 8u ? count - first : 8u, unsure[8], doubts = 0;
        hyi_masks8 masks;
        masks.all = 0;
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            const hyi_packet *packet = &swarm->packets[list[first + i]];
            HYI_M8 mask = HYI_I(hyi_meet_boxes_all)(packet, &planes, &enter);
            least = HYI_MIN8_WHERE(least, mask, enter);
            uint32_t met = HYI_BITS8(mask);
            masks.bytes[i] = (uint8_t)met;
            unsure[doubts] = i;
            doubts += packet->spread && hyi_count_bits(met) >= packet->many_children ? 1u : 0u;
        }
        for (uint32_t k = 0; k < doubts; k++) {
            uint32_t i = unsure[k];
            masks.bytes[i] = (uint8_t)HYI_I(hyi_meet_boxes_each)(swarm, &swarm->packets[list[first + i]], node, masks.bytes[i]);
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) nearest[c] = dealt[c] ? nearest[c] : FLT_MAX; /* met by bounds, but by no ray */
}

/* Orders all children by t, nearest first, without a branch: a child comes after as many as are nearer, or as near with a
   smaller number. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_order_children)(const float t[HYI_WIDTH], uint32_t order[HYI_WIDTH]) {
    HYI_F8 all = HYI_LOADU8(t);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        HYI_F8 one = HYI_SET8(t[c]);
        order[hyi_count_bits(HYI_BITS8(HYI_LT8(all, one)) | (HYI_BITS8(HYI_LE8(all, one)) & ((1u << c) - 1u)))] = c;
    }
}

/* Asks for what the children with bits in mask will read first. */
HYI_INLINE void HYI_I(hyi_prefetch_children)(const hyi_bvh *bvh, const hyi_node *node, uint32_t mask) {
    for (; mask; mask &= mask - 1u) hyi_prefetch_child(bvh, node->child[hyi_lowest_bit(mask)]);
}

/* Bits of the children that are leaves. */
HYI_INLINE uint32_t HYI_I(hyi_leaves_of)(const hyi_node *node) {
    uint32_t leaves = 0;
    for (uint32_t c = 0; c < HYI_WIDTH; c++) leaves |= node->child[c] >> 31 << c;
    return leaves;
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    const hyi_node *node = &swarm->site.bvh->nodes[at];
    uint32_t stride = (count + 15u) & ~15u, dealt[HYI_WIDTH] = {0}, order[HYI_WIDTH];
    float nearest[HYI_WIDTH];
    HYI_I(hyi_deal_packets)(swarm, node, list, count, space, stride, dealt, nearest);
    uint32_t mask = HYI_BITS8(HYI_LT8(HYI_LOADU8(nearest), HYI_SET8(FLT_MAX))), children = hyi_count_bits(mask);
    HYI_I(hyi_prefetch_children)(swarm->site.bvh, node, mask);
    HYI_I(hyi_order_children)(nearest, order);
    for (uint32_t i = 0; i < children; i++) {
        uint32_t c = order[i], *some = space + c * stride;
        if (hyi_child_is_leaf(node->child[c])) HYI_I(hyi_list_leaf_packets)(swarm, node->child[c], some, dealt[c], node, c);
        else HYI_I(hyi_list_visit_packets)(swarm, node->child[c], some, dealt[c], space + HYI_WIDTH * stride);
    }
}

/* ---- instances */

HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, uint32_t *lists_end, bool deep, bool any,
                                              const float bound[3]);

/* The rays of a list go through what a box of the tree over instances stands for. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_enter)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_site site = hyi_site_of_item(swarm->site.accel, swarm->site.bvh->ids[hyi_leaf_first(leaf)]);
    hyi_flight *below = swarm->stream->flights + swarm->stream->capacity;
    uint32_t entered = 0, flying = 0, *from = space;
    float bound[3] = {0.0f, 0.0f, 0.0f};
    for (uint32_t i = 0; i < count; i++) {
        from[flying] = list[i];
        flying += swarm->flights[list[i]].aim.t_far != -FLT_MAX ? 1u : 0u;
    }
    for (uint32_t first = 0, some; first < flying; first += some) {
        some = flying - first < HYI_LANES ? flying - first : HYI_LANES;
        bool together = some == HYI_LANES && site.bvh->primitive_count && HYI_I(hyi_enter_flights)(&site, swarm->flights, from + first, &below[entered], bound);
        for (uint32_t i = first; i < first + some; i++) {
            from[entered] = from[i];
            if (!together && !hyi_flight_enter(&below[entered], &swarm->flights[from[i]], &site)) continue;
            if (!together) hyi_cover_slabs(bound, &below[entered].aim, &site.bvh->scaled, false);
            entered++;
        }
    }
    HYI_I(hyi_run_flights)(&site, swarm->stream, entered, space + ((entered + 15u) & ~15u), swarm->lists_end, true, swarm->any, bound);
    for (uint32_t i = 0; i < entered; i++) {
        hyi_flight *above = &swarm->flights[from[i]];
        if (hyi_flight_return(above, &below[i]) && swarm->any) hyi_flight_stop(above);
    }
}

/* ---- the way down */

HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_list_one_by_one)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count) {
    uint32_t hits = 0;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (flight->aim.t_far == -FLT_MAX) continue;
        float limit = flight->aim.t_far;
        HYI_I(hyi_walk_scene)(&swarm->site, flight, at, swarm->any);
        if (swarm->any && flight->best.instance != HYK_NONE) hyi_flight_stop(flight);
        hits += flight->aim.t_far < limit ? 1u : 0u;
    }
    return hits;
}

/* Sends a list of packets, which are only in trees of triangles, through the child at: one at a time where more would leave no
   room for lists of one on every level below. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_visit_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    size_t room = (size_t)(swarm->lists_end - space);
    uint32_t some = room >= (size_t)HYI_WIDTH * (count + 15u) + HYI_LIST_RESERVE ? count : 1u;
    if (hyi_child_is_leaf(at)) {
        HYI_I(hyi_list_leaf_packets)(swarm, at, list, count, NULL, 0);
        return;
    }
    for (uint32_t first = 0; first < count; first += some) HYI_I(hyi_list_node_packets)(swarm, at, list + first, some, space);
}

/* Deals a list out at a node, which comes on top of a journey. Children are visited nearest first; where any hit does, leaves
   come before all else, since they end rays the soonest. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_arrive)(hyi_journey *journey, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    const hyi_swarm *swarm = journey->swarm;
    const hyi_bvh *bvh = swarm->site.bvh;
    const hyi_node *node = &bvh->nodes[at];
    hyi_frame *frame = &journey->frames[journey->depth++];
    float nearest[HYI_WIDTH];
    frame->node = node;
    frame->lists = space;
    frame->stride = (count + 15u) & ~15u;
    frame->count = count;
    frame->hits = frame->next = 0;
    memset(frame->dealt, 0, sizeof frame->dealt);
    HYI_I(hyi_deal_rays)(swarm, node, list, count, space, frame->stride, frame->dealt, nearest);
    uint32_t mask = HYI_BITS8(HYI_LT8(HYI_LOADU8(nearest), HYI_SET8(FLT_MAX)));
    if (bvh->rows) HYI_I(hyi_prefetch_children)(bvh, node, mask);
    uint32_t leaves = swarm->any ? HYI_I(hyi_leaves_of)(node) & mask : 0u;
    memcpy(frame->nearest, nearest, sizeof nearest);
    for (uint32_t c = 0; leaves && c < HYI_WIDTH; c++) nearest[c] = leaves >> c & 1u ? -FLT_MAX : nearest[c];
    HYI_I(hyi_order_children)(nearest, frame->order);
    frame->children = hyi_count_bits(mask);
}

/* Sends a list on to what is no leaf of triangles. Where memory for lists is short, rays go one by one. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_go_on)(hyi_journey *journey, const hyi_errand *to) {
    const hyi_swarm *swarm = journey->swarm;
    bool fits = (size_t)(swarm->lists_end - to->space) >= (size_t)(HYI_WIDTH + 2u) * (to->count + 16u);
    if (!fits) *to->hits += HYI_I(hyi_list_one_by_one)(swarm, to->at, to->list, to->count);
    else if (hyi_child_is_leaf(to->at)) HYI_I(hyi_list_enter)(swarm, to->at, to->list, to->count, to->space);
    else HYI_I(hyi_arrive)(journey, to->at, to->list, to->count, to->space);
}

/* Flights meet the leaves that they wait at, but those that have met something nearer meanwhile. Returns how many had a hit. */
HYI_NOINLINE HYI_TARGET uint32_t HYI_I(hyi_run_leaves)(const hyi_swarm *swarm, hyi_waiters *w) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < w->at_leaves; i++) {
        uint32_t ray = w->leaf_rays[i], leaf = w->leaves[i];
        w->leaf_rays[kept] = ray;
        w->leaves[kept] = leaf;
        kept += w->enter[i] <= swarm->flights[ray].aim.t_far ? 1u : 0u;
    }
    w->at_leaves = 0;
    return HYI_I(hyi_offer_leaves_each)(swarm, w->leaves, w->leaf_rays, kept);
}

/* Words without compression: HYI_WAIT_AT_CHILDREN. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_wait_at_each)(hyi_waiters *w, const hyi_node *node, uint32_t ray, HYI_M8 mask, HYI_F8 enter) {
    float t[HYI_WIDTH];
    HYI_STORE8(t, enter);
    hyi_wait_at_children(w, node, ray, HYI_BITS8(mask), t);
}

/* Flights meet the nodes that they wait at, and all that comes after: the first of those that wait goes first, so that its node has time
   to come from memory, and nothing is guessed; the last where too many wait. */
HYI_NOINLINE HYI_TARGET uint32_t HYI_I(hyi_run_nodes)(const hyi_swarm *swarm, hyi_waiters *w) {
    const hyi_bvh *bvh = swarm->site.bvh;
    uint32_t next = 0, hits = 0;
    while (next < w->at_nodes) {
        uint32_t i = w->at_nodes <= HYI_NODES_ENOUGH ? next++ : --w->at_nodes, ahead = next + 3u < w->at_nodes ? next + 3u : i;
        uint32_t early = next + HYI_NODES_EARLY < w->at_nodes ? next + HYI_NODES_EARLY : i;
        const hyi_node *node = &bvh->nodes[w->nodes[i]];
        const hyi_aim *aim = &swarm->flights[w->node_rays[i]].aim;
        HYI_I(hyi_planes) planes;
        HYI_F8 enter;
        hyi_prefetch_node_early(bvh, w->nodes[early]);
        hyi_prefetch_child(bvh, w->nodes[ahead]);
        hyi_prefetch(&swarm->flights[w->node_rays[ahead]]);
        HYI_I(hyi_order_planes)(node, aim->near_plane, &planes);
        HYI_M8 mask = HYI_I(hyi_meet_boxes)(aim, planes.near_planes, planes.far_planes, &enter, false);
        HYI_WAIT_AT_CHILDREN(w, node, w->node_rays[i], mask, enter);
        if (w->at_leaves >= HYI_LEAVES_ENOUGH) hits += HYI_I(hyi_run_leaves)(swarm, w);
    }
    w->at_nodes = 0;
    return hits;
}

/* Flights that wait go on where there are enough of them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_run_waiters)(hyi_journey *journey, uint32_t nodes, uint32_t leaves) {
    uint32_t hits = 0;
    if (journey->waiters.at_nodes >= nodes) hits = HYI_I(hyi_run_nodes)(journey->swarm, &journey->waiters);
    if (journey->waiters.at_leaves >= leaves) hits += HYI_I(hyi_run_leaves)(journey->swarm, &journey->waiters);
    return hits;
}

/* Sends short lists on, flight by flight. Copied without a branch on how many they are, which would be taken by chance. */
HYI_INLINE void HYI_I(hyi_wait_at_node)(hyi_waiters *w, uint32_t at, const uint32_t *list, uint32_t count) {
    memcpy(w->node_rays + w->at_nodes, list, HYI_NODES_OF_LIST * sizeof *list);
    for (uint32_t i = 0; i < HYI_NODES_OF_LIST; i++) w->nodes[w->at_nodes + i] = at;
    w->at_nodes += count;
}

/* The same at a leaf: as many as are too few to meet it abreast. */
HYI_INLINE void HYI_I(hyi_wait_at_leaf)(hyi_waiters *w, uint32_t leaf, float enter, const uint32_t *list, uint32_t count) {
    memcpy(w->leaf_rays + w->at_leaves, list, HYI_LEAVES_OF_LIST * sizeof *list);
    for (uint32_t i = 0; i < HYI_LEAVES_OF_LIST; i++) {
        w->leaves[w->at_leaves + i] = leaf;
        w->enter[w->at_leaves + i] = enter;
    }
    w->at_leaves += count;
}

/* Offers the leaves that come next among a frame's children to their lists. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_list_leaves)(hyi_journey *journey, hyi_frame *frame) {
    const hyi_swarm *swarm = journey->swarm;
    bool cull = HYI_CULL_SHARE * frame->hits >= frame->count;
    for (; frame->next < frame->children; frame->next++) {
        uint32_t c = frame->order[frame->next], leaf = frame->node->child[c], *list = frame->lists + c * frame->stride, count = frame->dealt[c];
        if (!hyi_child_is_leaf(leaf)) break;
        if (cull && count >= HYI_ABREAST_LEAST(hyi_leaf_count(leaf))) count = HYI_I(hyi_still_meet)(swarm, frame->node, c, list, count);
        uint32_t left = HYI_I(hyi_list_leaf_abreast)(swarm, leaf, list, count, &frame->hits);
        HYI_I(hyi_wait_at_leaf)(&journey->waiters, leaf, frame->nearest[c], list + (count - left), left);
    }
    frame->hits += HYI_I(hyi_run_waiters)(journey, UINT32_MAX, HYI_LEAVES_LEAST);
}

/* Finds the list that goes on next; those that are short wait, and so do rays at leaves. false: there is none. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_next)(hyi_journey *journey, hyi_errand *next) {
    const hyi_swarm *swarm = journey->swarm;
    while (journey->depth) {
        hyi_frame *frame = &journey->frames[journey->depth - 1u];
        if (frame->next == frame->children) {
            if (--journey->depth) frame[-1].hits += frame->hits;
            continue;
        }
        uint32_t c = frame->order[frame->next], at = frame->node->child[c], *list = frame->lists + c * frame->stride;
        if (swarm->site.bvh->rows && hyi_child_is_leaf(at)) {
            HYI_I(hyi_list_leaves)(journey, frame);
            continue;
        }
        frame->next++;
        if (swarm->site.bvh->rows && frame->dealt[c] <= HYI_NODES_OF_LIST) {
            HYI_I(hyi_wait_at_node)(&journey->waiters, at, list, frame->dealt[c]);
            frame->hits += HYI_I(hyi_run_waiters)(journey, HYI_NODES_LEAST, HYI_LEAVES_LEAST);
            continue;
        }
        next->at = at;
        next->list = list;
        next->count = frame->dealt[c];
        next->space = frame->lists + HYI_WIDTH * frame->stride;
        next->hits = &frame->hits;
        return true;
    }
    return false;
}

/* Sends a list of flights through a tree with nodes. space: memory for lists, up to swarm->lists_end. */
HYI_FN HYI_TARGET void HYI_I(hyi_travel)(const hyi_swarm *swarm, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_journey journey;
    hyi_errand next;
    uint32_t hits = 0;
    journey.swarm = swarm;
    journey.depth = journey.waiters.at_leaves = journey.waiters.at_nodes = 0;
    next.at = swarm->site.bvh->root;
    next.list = list;
    next.count = count;
    next.space = space;
    next.hits = &hits;
    do HYI_I(hyi_go_on)(&journey, &next);
    while (HYI_I(hyi_find_next)(&journey, &next));
    (void)HYI_I(hyi_run_waiters)(&journey, 0, 0);
}

/* The same, of any tree. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_send)(const hyi_swarm *swarm, const uint32_t *list, uint32_t count, uint32_t *space) {
    uint32_t root = swarm->site.bvh->root;
    if (swarm->site.bvh->rows && hyi_child_is_leaf(root)) HYI_I(hyi_list_leaf_whole)(swarm, root, list, count);
    else HYI_I(hyi_travel)(swarm, list, count, space);
}

/* ---- all rays of a slice */

/* A list of packets of one group goes through the tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_send_packets)(hyi_swarm *swarm, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_visitors visitors;
    visitors.count = 0;
    swarm->visitors = &visitors;
    HYI_I(hyi_list_visit_packets)(swarm, swarm->site.bvh->root, list, count, space);
    HYI_I(hyi_admit_all)(swarm);
    swarm->visitors = NULL;
}

/* Sends count packets on their way, those of a group together. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_packets)(hyi_swarm *swarm, uint32_t count, uint32_t *space) {
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)swarm->packets[i].group;
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        uint32_t some = hyi_pair_packets(swarm->packets, order + first[g], first[g + 1] - first[g], HYI_PAIRS);
        HYI_I(hyi_send_packets)(swarm, order + first[g], some, space + room);
    }
}

/* Packets of the alike among a group's flights; the others come to stand first in rays, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike)(hyi_swarm *swarm, uint32_t *rays, uint32_t count, uint32_t *space) {
    uint32_t made = 0, others = 0;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some > HYI_LANES / 2u && HYI_I(hyi_pack_flights)(swarm, &swarm->packets[made], rays + first, some)) made++;
        else
            for (uint32_t i = 0; i < some; i++) rays[others++] = rays[first + i];
        if (made < swarm->stream->packet_share && first + some < count) continue;
        for (uint32_t i = 0; i < made; i++) space[i] = i;
        uint32_t going = hyi_pair_packets(swarm->packets, space, made, HYI_PAIRS);
        if (going) HYI_I(hyi_send_packets)(swarm, space, going, space + ((made + 15u) & ~15u));
        for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_flights)(swarm, &swarm->packets[i]);
        made = 0;
    }
    return others;
}

/* The same of all count flights, by groups; the others are listed in others. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_run_alike_all)(hyi_swarm *swarm, uint32_t count, uint32_t *others, uint32_t *space) {
    uint32_t first[HYI_RAY_GROUPS + 1], rest = 0;
    uint8_t *keys = (uint8_t *)(void *)space;
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)hyi_aim_group(&swarm->flights[i].aim);
    hyi_group(keys, count, others, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        uint32_t left = HYI_I(hyi_run_alike)(swarm, others + first[g], first[g + 1] - first[g], space);
        memmove(others + rest, others + first[g], left * sizeof *others);
        rest += left;
    }
    return rest;
}

/* Sends the first count flights (deep: of those in instances) through the tree of site. bound: see hyi_cover_slabs. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, uint32_t *lists_end, bool deep, bool any,
                                              const float bound[3]) {
    hyi_swarm swarm;
    uint32_t room = (count + 15u) & ~15u, rest = count;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.lists_end = lists_end;
    swarm.rays = NULL;
    swarm.flights = stream->flights + (deep ? stream->capacity : 0u);
    swarm.packets = stream->packets;
    swarm.any = any;
    memcpy(swarm.bound, bound, sizeof swarm.bound);
    swarm.thick = hyi_slabs_are_thick(&site->bvh->scaled, bound);
    if ((size_t)(lists_end - space) < (size_t)12u * (room + 16u) + HYI_LIST_RESERVE) {
        for (uint32_t i = 0; i < count; i++) HYI_I(hyi_walk_scene)(site, &swarm.flights[i], site->bvh->root, any);
        return;
    }
    if (deep) rest = HYI_I(hyi_run_alike_all)(&swarm, count, space, space + room);
    else
        for (uint32_t i = 0; i < count; i++) space[i] = i;
    if (rest) HYI_I(hyi_send)(&swarm, space, rest, space + room);
    if (!any && site->bvh->rows) HYI_I(hyi_settle_all)(site, swarm.flights, count);
}

/* Answers count rays, at most capacity. Returns whether all were sound. */
HYI_FN HYI_TARGET bool HYI_I(hyi_trace_slice)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, const hyi_answers *answers, uint32_t count) {
    hyi_begun begun = {0, 0, 0, {0.0f, 0.0f, 0.0f}, true};
    hyi_swarm swarm;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.lists_end = stream->lists + stream->list_count;
    swarm.rays = rays;
    swarm.flights = NULL;
    swarm.packets = stream->packets;
    swarm.any = answers->occluded != NULL;
    uint32_t share = swarm.any && stream->scattered && HYI_PACKET_PROBE < stream->packet_share ? HYI_PACKET_PROBE : stream->packet_share;
    while (begun.rays < count) {
        HYI_I(hyi_begin_rays)(site, stream, rays, answers, count, share, &begun);
        stream->leaf_visits = 0;
        if (begun.packets) HYI_I(hyi_run_packets)(&swarm, begun.packets, stream->lists);
        if (swarm.any && begun.packets) stream->scattered = HYI_SCATTERED(stream->leaf_visits, begun.packets);
        share = swarm.any && stream->scattered ? 0u : stream->packet_share;
        HYI_I(hyi_unpack_all)(&swarm, begun.packets, answers);
        begun.packets = 0;
    }
    HYI_I(hyi_run_flights)(site, stream, begun.flights, stream->lists, swarm.lists_end, false, swarm.any, begun.bound);
    for (uint32_t i = 0; i < begun.flights; i++) hyi_tell(site->accel, &stream->flights[i], NULL, answers, (size_t)(stream->flights[i].ray - rays));
    return begun.sound;
}
