/* >>bvh-stream: many rays through a tree together

   A list of rays goes down the tree: at a node each of them meets eight boxes, and its number is put on the list of
   every child that it enters; the children are then visited nearest first, each with its list. A node is loaded once
   for many rays, the rays of a list are independent work for the processor, and nothing is guessed by its branch
   predictor (Barringer, Akenine-Moller 2014, "Dynamic ray stream traversal"; Fuetterling et al. 2015, "Efficient
   ray tracing kernels for modern CPU architectures").

   Where neighbouring rays are alike, a packet of them takes the place of a ray: its node test is interval arithmetic
   over the packet (Reshetov, Soupikov, Hurley 2005, "Multi-level ray tracing algorithm"), as dear as that of one ray,
   and at a leaf a triangle meets all rays of the packet at once.

   Packets of a list have the same signs of direction and the same largest direction component. Flights of a list may go
   anywhere: rays that begin near each other meet the same nodes at first, whatever their directions. */
#ifndef HYI_BVH_STREAM_H
#define HYI_BVH_STREAM_H

#include "answer.h"

#define HYI_STREAM_RAYS 8192u     /* on their way at a time */
#define HYI_STREAM_RAYS_ANY 4096u /* of those that any hit ends: nearly all of their way is in long lists */
#define HYI_STREAM_PACKETS 128u  /* of them at a time, at most */
#define HYI_STREAM_LEAST 48u     /* fewer rays go one by one */
#define HYI_CULL_SHARE 6u        /* if fewer than one in so many met something, lists are not looked through for rays to leave out */
#define HYI_PACKET_WIDTH 16u     /* at most */
#define HYI_PACKET_LEAST 6u      /* rays that make a packet worth it */
#define HYI_MANY_CHILDREN 4u     /* met by the bounds of a packet, make it worth looking at each of its rays, */
#define HYI_MANY_FOR_FEW 2u      /* and so many where half of the rays or more are done, and bounds are those of all */
#define HYI_VISITORS_LEAST 8u    /* packets that come to leaves wait until they are so many */
#define HYI_VISITORS_MOST (HYI_VISITORS_LEAST + HYI_STREAM_PACKETS)
#define HYI_PACKET_GROUPS 3u     /* of more directions than that, blocks of rays are not worth being looked through for packets */
#define HYI_PACKET_PROBE 18u     /* where packets had scattered, so many are made of a slice's first rays, to see whether they still do */
/* Whether rays that any hit ends had better not go in packets: one that comes to more than twenty leaves, where a ray comes to two or three,
   has fallen apart, and is on its way for a ray or two at a time. */
#define HYI_SCATTERED(visits, packets) ((visits) > 20u * (packets))
/* Whether so many rays of a packet meet a leaf of so many triangles sooner one by one: each then meets all of them at once, which
   takes a third longer than it takes all rays to meet one. */
#define HYI_SOONER_EACH(rays, triangles) (4u * (rays) <= 3u * (triangles))

/* So many rays of a list meet a leaf of so many triangles sooner abreast, one triangle after the other, than one by one. */
#define HYI_ABREAST_LEAST(triangles) ((triangles) + 3u)

/* Flights that few others go with wait, each with the leaf or the node that it has come to, until there are so many for one loop. */
#define HYI_LEAVES_LEAST 16u
#define HYI_LEAVES_ENOUGH 64u    /* leaves that nodes of such flights have found */
#define HYI_LEAVES_EARLY 8u      /* so far ahead memory is asked for leaves, */
#define HYI_NODES_EARLY 20u      /* and for nodes */
#define HYI_LEAVES_OF_LIST 12u   /* more than go one by one of any list at a leaf */
#define HYI_LEAVES_MOST (HYI_LEAVES_LEAST + HYI_WIDTH * HYI_LEAVES_OF_LIST)
#define HYI_NODES_LEAST 64u
#define HYI_NODES_ENOUGH 1024u   /* the last goes first where more wait, and its node has no time to come */
#define HYI_NODES_OF_LIST 6u     /* lists that are no longer fall apart at a node */
#define HYI_NODES_MOST (HYI_NODES_ENOUGH + HYI_WIDTH * (HYI_TREE_DEPTH + 2u)) /* seven wait on each level, and eight are stored at a time */
HYI_STATIC_ASSERT(HYI_ABREAST_LEAST(HYI_LEAF_MAX) <= HYI_LEAVES_OF_LIST && HYI_NODES_LEAST + HYI_NODES_OF_LIST <= HYI_NODES_ENOUGH);
HYI_STATIC_ASSERT(HYI_LEAVES_ENOUGH + 2u * HYI_WIDTH <= HYI_LEAVES_MOST);

#define HYI_LIST_RESERVE (8u * 16u * (HYI_TREE_DEPTH + 2u)) /* words: for lists of one packet on every level */
#define HYI_RAY_GROUPS 24u       /* eight octants by three largest components */

/* Slopes of the rays of a packet differ by no more than this, and their origins by no more than this share of the
   tree's size. */
#define HYI_PACKET_SLOPES 0.6f
#define HYI_PACKET_ORIGINS 0.02f

/* Rays of two packets that go as a pair are off the middle of the first by slopes of no more than this. */
#define HYI_PAIR_SLOPES 0.15f

/* A word a lane; vectors of floats move them. */
typedef union hyi_lane_words {
    uint32_t word[HYI_PACKET_WIDTH];
    float bits[HYI_PACKET_WIDTH];
} hyi_lane_words;

/* As many rays as a vector has lanes: bounds of all for the node test, and for triangles what hyi_aim and hyi_best hold
   of one ray, in the units of the tree, with hyi_aim.unit 1. Lanes without a ray lie within the bounds
   of the others, with limits that nothing meets. */
typedef struct hyi_packet {
    float origin[3][HYI_PACKET_WIDTH], direction[3][HYI_PACKET_WIDTH], shear[2][HYI_PACKET_WIDTH]; /* in the order of axis */
    float inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH]; /* by axis of space */
    float inverse_z[HYI_PACKET_WIDTH], t_near[HYI_PACKET_WIDTH], t_far[HYI_PACKET_WIDTH], t_min[HYI_PACKET_WIDTH];
    float best_t[HYI_PACKET_WIDTH], least_t[HYI_PACKET_WIDTH]; /* of the nearest hit that is worked out, and hyi_aim.least_t */
    double t_by_z[HYI_PACKET_WIDTH];
    uint32_t instance[HYI_PACKET_WIDTH], primitive[HYI_PACKET_WIDTH]; /* of what is worked out */
    hyi_lane_words leaf, triangle;       /* the nearest so far, worked out or not; leaf 0: nothing here */
    uint32_t waiting;                    /* bits of the lanes where that is certain, but not worked out */
    uint32_t ray[HYI_PACKET_WIDTH];      /* its number among the rays, or flights, that the packet is made of */
    float near_origin[3], far_origin[3], inverse_low[3], inverse_high[3];
    float first_t, last_t;
    uint32_t spread;                     /* 1: they begin at different points, and bounds of all say little of each */
    uint32_t live, group;                /* bits of the lanes with a ray; what their directions have in common: see hyi_aim_group */
    float shear_middle[2], shear_half[2]; /* of all rays, and the most by which they are off it */
    uint32_t lead, mate;                 /* of a pair: who goes for both, with the bounds of both; of that one: the other, HYK_NONE: it goes alone */
    uint32_t many_children;              /* met by bounds of rays that begin at different points, make it worth looking at each ray */
    uint32_t unused[6];                  /* fills the last cache line: vectors of rays lie in one each */
} hyi_packet;
HYI_STATIC_ASSERT(sizeof(hyi_packet) % 64u == 0);

/* Memory for streams. */
typedef struct hyi_ray_stream {
    uint32_t capacity;     /* rays on their way at a time; 0: none, rays go one by one */
    uint32_t packet_share; /* packets on their way at a time */
    uint32_t levels;       /* 1, or 2 where there are instances: flights in the first tree, then in theirs */
    uint32_t leaf_visits;  /* of packets, each to each leaf */
    bool scattered;        /* whether the last packets that any hit ends made too many of these */
    hyi_packet *packets;   /* packet_share: on one level, for only trees of triangles have any; the block begins here */
    hyi_flight *flights;   /* levels times capacity */
    uint32_t *lists;       /* list_count */
    size_t list_count;
} hyi_ray_stream;

/* Packets that have come to leaves wait until there are enough for one loop, and what they read has come from memory. */
typedef struct hyi_visitors {
    uint32_t count, packets[HYI_VISITORS_MOST], leaves[HYI_VISITORS_MOST];
    uint32_t rays[HYI_VISITORS_MOST]; /* bits of those that meet the box of the leaf */
} hyi_visitors;

/* Lists in one tree at one time. */
typedef struct hyi_swarm {
    hyi_site site;
    hyi_ray_stream *stream;
    uint32_t *lists_end; /* of the memory for lists */
    const hyk_ray *rays; /* of packets; NULL: these are made of flights */
    hyi_flight *flights;
    hyi_packet *packets;
    hyi_visitors *visitors; /* of packets; NULL: there are none */
    uint32_t near_plane[3], axis[3]; /* of all packets on a list */
    float bound[3];                  /* of all flights: see hyi_cover_slabs */
    bool thick;                      /* whether that is too much for most of them */
    bool any;
} hyi_swarm;

/* A node on the way of a list of flights: to each child goes a list, and children before next have been visited. */
typedef struct hyi_frame {
    const hyi_node *node;
    uint32_t *lists, stride, count, hits; /* count: of all; hits: how often these met something nearer than before */
    uint32_t next, children, dealt[HYI_WIDTH], order[HYI_WIDTH];
    float nearest[HYI_WIDTH]; /* where each child is entered first */
} hyi_frame;

/* Flights that wait, by their numbers, and what they have come to. */
typedef struct hyi_waiters {
    uint32_t at_leaves, leaf_rays[HYI_LEAVES_MOST], leaves[HYI_LEAVES_MOST];
    float enter[HYI_LEAVES_MOST]; /* no flight of its list entered the leaf's box before */
    uint32_t at_nodes, node_rays[HYI_NODES_MOST], nodes[HYI_NODES_MOST];
} hyi_waiters;

/* A list and what it comes to next. space: memory for lists after it; hits: where hits of its rays are counted. */
typedef struct hyi_errand {
    uint32_t at, count;
    const uint32_t *list;
    uint32_t *space, *hits;
} hyi_errand;

/* A list of flights on its way down a tree. */
typedef struct hyi_journey {
    const hyi_swarm *swarm;
    uint32_t depth;
    hyi_frame frames[HYI_TREE_DEPTH];
    hyi_waiters waiters;
} hyi_journey;

/* A flight waits at each of the children with bits in mask. */
HYI_INLINE void hyi_wait_at_children(hyi_waiters *w, const hyi_node *node, uint32_t ray, uint32_t mask, const float enter[HYI_WIDTH]) {
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask), child = node->child[c], leaf = child >> 31;
        w->leaf_rays[w->at_leaves] = w->node_rays[w->at_nodes] = ray;
        w->leaves[w->at_leaves] = w->nodes[w->at_nodes] = child;
        w->enter[w->at_leaves] = enter[c];
        w->at_leaves += leaf;
        w->at_nodes += leaf ^ 1u;
    }
}

/* What the first of a slice of rays have become: those that meet nothing are neither. */
typedef struct hyi_begun {
    uint32_t rays, packets, flights;
    float bound[3]; /* see hyi_cover_slabs: of the flights */
    bool sound;     /* all of them */
} hyi_begun;

/* The eight words of count rays: rows of one word of all. */
HYI_INLINE void hyi_ray_words(const hyk_ray *rays, float words[8][HYI_PACKET_WIDTH], uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        float ray[8];
        memcpy(ray, &rays[i], sizeof ray);
        for (uint32_t word = 0; word < 8u; word++) words[word][i] = ray[word];
    }
}

/* Sixteen words of each of some rays, from rows of one word of all, to a line of each, one flight apart. */
HYI_INLINE void hyi_lines(const void *const rows[16], char *lines, uint32_t rays) {
    for (uint32_t i = 0; i < rays; i++)
        for (uint32_t word = 0; word < 16u; word++)
            memcpy(lines + i * sizeof(hyi_flight) + 4u * word, (const char *)rows[word] + 4u * i, 4);
}

/* One answer, told or for the renderer, and its words. */
typedef union hyi_record {
    hydra_hit told;
    hyk_hit hit;
    float words[10];
} hyi_record;
#define HYI_WORDS_OF(type) ((uint32_t)(sizeof(type) / sizeof(float)))
#define HYI_RECORD_WORDS HYI_WORDS_OF(hyi_record)
HYI_STATIC_ASSERT(sizeof(hyi_record) == sizeof(hydra_hit) && offsetof(hydra_hit, u) == 4 && offsetof(hydra_hit, v) == 8 && offsetof(hyk_hit, u) == 4 &&
                  offsetof(hyk_hit, v) == 8); /* t, u and v come first in both */

/* Records of so many words each, one after the other, from rows of one word of all. */
HYI_INLINE void hyi_records(float rows[HYI_RECORD_WORDS][HYI_PACKET_WIDTH], uint32_t words, char *out, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t word = 0; word < words; word++) memcpy(out + sizeof(float) * (words * i + word), &rows[word][i], sizeof(float));
}

/* Of eight items, which children each meets. */
typedef union hyi_masks8 {
    uint8_t bytes[8];
    uint64_t all;
} hyi_masks8;

HYI_INLINE uint32_t hyi_aim_group(const hyi_aim *aim) {
    uint32_t group = aim->axis[2] << 3;
    for (uint32_t a = 0; a < 3; a++) group |= (aim->near_plane[a] & HYI_WIDTH ? 1u : 0u) << a;
    return group;
}

/* hyi_aim.axis of the rays of a group. */
HYI_INLINE void hyi_group_axes(uint32_t group, uint32_t axis[3]) {
    uint32_t z = group >> 3;
    axis[0] = z == 2u ? 0u : z + 1u;
    axis[1] = z == 0u ? 2u : z - 1u;
    axis[2] = z;
}

/* What rays of a group have in common. */
HYI_INLINE void hyi_set_group(hyi_swarm *swarm, uint32_t group) {
    for (uint32_t a = 0; a < 3; a++) swarm->near_plane[a] = HYI_WIDTH * (2u * a + (group >> a & 1u));
    hyi_group_axes(group, swarm->axis);
}

/* Numbers of count keys below HYI_RAY_GROUPS in the order of the keys, stable; first[g] .. first[g + 1]: those of group g. */
HYI_INLINE void hyi_group(const uint8_t *keys, uint32_t count, uint32_t *order, uint32_t first[HYI_RAY_GROUPS + 1]) {
    uint32_t next[HYI_RAY_GROUPS] = {0};
    for (uint32_t i = 0; i < count; i++) next[keys[i]]++;
    first[0] = 0;
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        first[g + 1] = first[g] + next[g];
        next[g] = first[g];
    }
    for (uint32_t i = 0; i < count; i++) order[next[keys[i]]++] = i;
}

/* Of eight. */
HYI_INLINE uint32_t hyi_count_bits(uint32_t bits) {
#if HYI_GNU
    return (uint32_t)__builtin_popcount(bits);
#else
    bits -= bits >> 1 & 0x55u;
    bits = (bits & 0x33u) + (bits >> 2 & 0x33u);
    return (bits + (bits >> 4)) & 0xfu;
#endif
}

/* Of the lanes of a vector. */
HYI_INLINE uint32_t hyi_count_lanes(uint32_t bits) { return hyi_count_bits(bits & 0xffu) + hyi_count_bits(bits >> 8); }

/* What boxes and triangles need of a ray. */
HYI_INLINE void hyi_prefetch_flight(const hyi_flight *flight) {
    hyi_prefetch(&flight->aim);
    hyi_prefetch(flight->aim.origin);
}

/* t of a ray of a packet at a triangle that it hits, where vectors do not decide: by hyi_confirm. */
HYI_NOINLINE float hyi_settle_lane(const hyi_packet *packet, const hyi_bvh *bvh, const uint32_t *axis, uint32_t lane, uint32_t leaf, uint32_t triangle) {
    hyi_aim aim;
    float weights[2];
    double n[3];
    for (int i = 0; i < 3; i++) {
        aim.axis[i] = axis[i];
        aim.origin[i] = packet->origin[i][lane];
        aim.direction[i] = packet->direction[i][lane];
    }
    aim.shear[0] = packet->shear[0][lane];
    aim.shear[1] = packet->shear[1][lane];
    aim.t_by_z = packet->t_by_z[lane];
    aim.unit = 1.0;
    aim.noise = 0.0f;
    return hyi_confirm(&aim, hyi_leaf_rows(bvh, leaf), hyi_leaf_count(leaf), triangle, -FLT_MAX, FLT_MAX, weights, n);
}

/* ---- packets in pairs: where boxes are met by bounds, those of two packets from one point are met as fast as those of one */

/* Lets other, of the same group, go along with lead; false: they do not begin at one point, or are too different. */
HYI_INLINE bool hyi_join_packets(hyi_packet *lead, const hyi_packet *other) {
    bool apart = lead->spread || other->spread;
    for (int a = 0; a < 2; a++) apart = apart || !(fabsf(lead->shear_middle[a] - other->shear_middle[a]) + other->shear_half[a] <= HYI_PAIR_SLOPES);
    for (int a = 0; a < 3; a++) apart = apart || lead->origin[a][0] != other->origin[a][0];
    if (apart) return false;
    for (int a = 0; a < 3; a++) {
        lead->inverse_low[a] = lead->inverse_low[a] < other->inverse_low[a] ? lead->inverse_low[a] : other->inverse_low[a];
        lead->inverse_high[a] = lead->inverse_high[a] > other->inverse_high[a] ? lead->inverse_high[a] : other->inverse_high[a];
    }
    lead->first_t = lead->first_t < other->first_t ? lead->first_t : other->first_t;
    lead->last_t = lead->last_t > other->last_t ? lead->last_t : other->last_t;
    return true;
}

/* Makes pairs of neighbours on a list of packets of one group, which then has one number for both, or of none; returns how many it has. */
HYI_INLINE uint32_t hyi_pair_packets(hyi_packet *packets, uint32_t *list, uint32_t count, bool pairs) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t first = list[i], second = i + 1u < count ? list[i + 1u] : HYK_NONE;
        packets[first].lead = list[kept++] = first;
        packets[first].mate = HYK_NONE;
        if (!pairs || second == HYK_NONE || !hyi_join_packets(&packets[first], &packets[second])) continue;
        packets[first].mate = second;
        packets[second].lead = first;
        packets[second].mate = HYK_NONE;
        i++;
    }
    return kept;
}

/* ---- beginning */

/* Of flights side by side, as many as a vector has lanes, keeps those whose bits are set; returns how many these are. */
HYI_INLINE uint32_t hyi_keep_flights(hyi_flight *flights, uint32_t bits) {
    uint32_t kept = 0;
    if ((bits & (bits + 1u)) == 0) return hyi_count_lanes(bits);
    for (; bits; bits &= bits - 1u) {
        uint32_t lane = hyi_lowest_bit(bits);
        if (lane != kept) flights[kept] = flights[lane];
        kept++;
    }
    return kept;
}

/* Begins the flights of some rays one by one; those that meet nothing are answered at once. */
HYI_FN void hyi_begin_each(const hyi_site *site, const hyi_ray_stream *stream, const hyk_ray *rays, const hyi_answers *answers,
                           uint32_t first, uint32_t count, hyi_begun *begun) {
    for (uint32_t i = first; i < first + count; i++) {
        hyi_flight *flight = &stream->flights[begun->flights];
        if (hyi_flight_begin(flight, site->bvh, &rays[i], FLT_MAX)) {
            hyi_cover_slabs(begun->bound, &flight->aim, &site->bvh->scaled, site->bvh->rows == NULL);
            begun->flights++;
        } else {
            begun->sound = hyi_was_sound(&rays[i]) && begun->sound;
            hyi_tell(site->accel, flight, NULL, answers, i);
        }
    }
}

#endif /* HYI_BVH_STREAM_H */
