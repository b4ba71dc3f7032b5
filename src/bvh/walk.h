/* >>bvh-walk: what rays can meet, one ray on its way through a tree, and who decides on a triangle

   How eight boxes, up to eight triangles or a packet of rays are tested differs between instruction sets;
   all else is here. */
#ifndef HYI_BVH_WALK_H
#define HYI_BVH_WALK_H

#include "triangle.h"
#include "../../shaders/shared/alpha.h"

/* Everything that rays of a scene can meet. */
typedef struct hyi_accel {
    const hyk_scene_view *view;
    const hyi_bvh *meshes;         /* by mesh index */
    const uint8_t *mesh_has_alpha; /* by mesh index; NULL: none has */
    const uint32_t *placed_ids, *light_ids; /* hydra_instance and hydra_light ids, by the view's numbers */
    const hyi_bvh *world;          /* one tree over the first world_count instances, which are unmoved; NULL: none */
    const uint32_t *world_first;   /* of each of them, its first triangle's number in that tree */
    uint32_t world_count;
    bool world_has_alpha;
    const hyi_bvh *instances;      /* over the world, if any, and then the other instances; unused when single */
    bool single;                   /* the world alone, or exactly one instance, identity */
    bool empty;
    const hyi_bvh *shapes;         /* over the RECT, DISC and SPHERE lights; NULL: none */
    const uint32_t *shape_lights;  /* light of each box in shapes */
    hydra_isa isa;                 /* never AUTO */
    hyi_vicinity vicinity;         /* of the tree that rays begin in, where that holds triangles */
} hyi_accel;

/* A tree and whose it is. */
typedef struct hyi_site {
    const hyi_accel *accel;
    const hyi_bvh *bvh;
    uint32_t instance;
    bool asks_alpha; /* whether hyk_hit_is_opaque must be asked here */
    double *normal;  /* gets that of each new best hit, of any length, in the tree's space; NULL: no one asks */
} hyi_site;

/* A ray on its way through one tree. */
typedef struct hyi_flight {
    hyi_aim aim;
    hyi_best best;
    float t_min;
    const hyk_ray *ray;  /* in world space */
} hyi_flight;

/* A ray that may lie in memory as another type of the same layout. */
HYI_INLINE hyk_ray hyi_load_ray(const hyk_ray *at) {
    hyk_ray ray;
    memcpy(&ray, at, sizeof ray);
    return ray;
}

/* Whether origin, direction and t_min are finite, the direction is not zero, and t_max, which may be infinite, is not
   below t_min. Bits are looked at, which fast-math leaves alone. */
HYI_INLINE bool hyi_ray_is_sound(const hyk_ray *ray) {
    uint32_t bits[8], infinite = 0, direction = 0;
    memcpy(bits, ray, sizeof bits); /* origin, t_min, direction, t_max */
    for (int i = 0; i < 7; i++) infinite |= (bits[i] & 0x7f800000u) == 0x7f800000u ? 1u : 0u;
    for (int i = 4; i < 7; i++) direction |= bits[i] & 0x7fffffffu;
    return !infinite && direction && (bits[7] & 0x7fffffffu) <= 0x7f800000u && ray->t_max >= ray->t_min;
}
HYI_STATIC_ASSERT(sizeof(hyk_ray) == 32 && offsetof(hyk_ray, t_min) == 12 && offsetof(hyk_ray, t_max) == 28);

HYI_FN bool hyi_was_sound(const hyk_ray *at) {
    hyk_ray ray = hyi_load_ray(at);
    return hyi_ray_is_sound(&ray);
}

/* ---- what a child of a node stands for */

HYI_INLINE const float *hyi_leaf_rows(const hyi_bvh *bvh, uint32_t leaf) { return bvh->rows + 9u * (size_t)hyi_leaf_first(leaf); }

/* hyi_prefetch_early of all of a node, and of most of a leaf. */
HYI_INLINE void hyi_prefetch_node_early(const hyi_bvh *bvh, uint32_t node) {
    const char *at = (const char *)&bvh->nodes[node];
    for (uint32_t line = 0; line < 4u; line++) hyi_prefetch_early(at + 64u * line);
}

HYI_INLINE void hyi_prefetch_leaf_early(const hyi_bvh *bvh, uint32_t leaf) {
    const char *at = (const char *)hyi_leaf_rows(bvh, leaf);
    for (uint32_t line = 0; line < 5u; line++) hyi_prefetch_early(at + 64u * line);
}

/* What a child will read first: all of a node, and of a leaf, which begins anywhere in a line, as much as eight triangles take. */
HYI_INLINE void hyi_prefetch_child(const hyi_bvh *bvh, uint32_t child) {
    bool leaf = hyi_child_is_leaf(child);
    const char *at = leaf ? (const char *)hyi_leaf_rows(bvh, child) : (const char *)&bvh->nodes[child];
    for (uint32_t line = 0; line < (leaf ? 6u : 4u); line++) hyi_prefetch(at + 64u * line);
}

/* ---- the children of a node that a single ray still has to visit */

/* Seven wait on each level; eight are written at a time. */
#define HYI_STACK (7u * HYI_TREE_DEPTH + 16u)

/* A child in the low half, the bits of t at which it is entered in the high one: in the order of t, but where that is negative. */
typedef int64_t hyi_waiting;

HYI_INLINE hyi_waiting hyi_waiting_of(uint32_t child, float t) {
    uint32_t bits;
    memcpy(&bits, &t, sizeof bits);
    return (hyi_waiting)((uint64_t)bits << 32 | child);
}

HYI_INLINE float hyi_waiting_t(hyi_waiting waiting) {
    uint32_t bits = (uint32_t)((uint64_t)waiting >> 32);
    float t;
    memcpy(&t, &bits, sizeof t);
    return t;
}

/* No less than all that waits and is entered up to t. Where that is negative, nothing is left out: boxes are, by themselves. */
HYI_INLINE hyi_waiting hyi_waiting_limit(float t) { return hyi_has_sign(t) ? INT64_MAX : hyi_waiting_of(0xffffffffu, t); }

/* Where children lie, nodes first, then leaves, and how far apart: found without a branch, which would be guessed wrong. */
typedef struct hyi_ahead {
    const char *base[2];
    size_t stride[2];
} hyi_ahead;

HYI_INLINE hyi_ahead hyi_ahead_of(const hyi_bvh *bvh) {
    hyi_ahead ahead;
    ahead.base[0] = (const char *)bvh->nodes;
    ahead.base[1] = (const char *)bvh->rows;
    ahead.stride[0] = sizeof *bvh->nodes;
    ahead.stride[1] = 9u * sizeof *bvh->rows;
    return ahead;
}

/* Asks for a child: all of a node, and of a leaf as much, which is less than hyi_prefetch_child asks for: most are not read. */
HYI_INLINE void hyi_ask_for(const hyi_ahead *ahead, uint32_t child) {
    uint32_t leaf = child >> 31;
    const char *at = ahead->base[leaf] + (child & HYI_CHILD_SLOT) * ahead->stride[leaf];
    for (uint32_t line = 0; line < 4u; line++) hyi_prefetch(at + 64u * line);
}

/* Of the children in mask (not empty), returns the nearest and puts the others on the stack, the nearer the higher.
   ahead: NULL or where memory is asked for all. */
HYI_INLINE uint32_t hyi_push_farther(hyi_waiting **stack, const uint32_t *child, const float *t, uint32_t mask, const hyi_ahead *ahead) {
    uint32_t first = hyi_lowest_bit(mask);
    hyi_waiting *base = *stack, *top = base, nearest = hyi_waiting_of(child[first], t[first]);
    if (ahead) hyi_ask_for(ahead, child[first]);
    while ((mask &= mask - 1u) != 0u) {
        uint32_t c = hyi_lowest_bit(mask);
        if (ahead) hyi_ask_for(ahead, child[c]);
        hyi_waiting other = hyi_waiting_of(child[c], t[c]), farther = other > nearest ? other : nearest;
        nearest = other > nearest ? nearest : other;
        hyi_waiting *place = top++;
        for (; place > base && place[-1] < farther; place--) *place = place[-1];
        *place = farther;
    }
    *stack = top;
    return (uint32_t)nearest;
}

/* ---- triangles */

/* In the world, the number of a triangle tells whose it is. */
HYI_INLINE void hyi_locate_in_world(const hyi_accel *accel, uint32_t *instance, uint32_t *primitive) {
    if (!accel->world || *instance != 0) return;
    uint32_t low = 0, high = accel->world_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (accel->world_first[middle] <= *primitive) low = middle;
        else high = middle;
    }
    *instance = low;
    *primitive -= accel->world_first[low];
}

HYI_NOINLINE bool hyi_lets_pass(const hyi_site *site, const hyk_ray *ray, uint32_t primitive, float u, float v) {
    uint32_t instance = site->instance;
    hyi_locate_in_world(site->accel, &instance, &primitive);
    return !hyk_hit_is_opaque(site->accel->view, instance, primitive, u, v, hyi_load_ray(ray));
}

/* A hit of triangle lane of a leaf becomes the best. */
HYI_INLINE void hyi_set_best(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, uint32_t primitive, float t, float u, float v) {
    flight->best.t = t;
    flight->best.u = u;
    flight->best.v = v;
    flight->best.instance = site->instance;
    flight->best.primitive = primitive;
    flight->best.leaf = leaf;
    flight->best.lane = lane;
}

/* Decides on one triangle of a leaf; sheared: as for hyi_confirm_sheared. Returns whether it is the new best. */
HYI_INLINE bool hyi_decide_sheared(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, const float *sheared) {
    float weights[2] = {0.0f, 0.0f};
    double n[3];
    const float *rows = hyi_leaf_rows(site->bvh, leaf);
    float t = hyi_confirm_sheared(&flight->aim, rows, hyi_leaf_count(leaf), lane, sheared, flight->t_min, flight->best.t, weights, n);
    if (t == HYI_NO_HIT) return false;
    uint32_t primitive = site->bvh->ids[hyi_leaf_first(leaf) + lane];
    if (!hyi_beats(&flight->best, t, site->instance, primitive)) return false;
    if (site->asks_alpha && hyi_lets_pass(site, flight->ray, primitive, weights[0], weights[1])) return false;
    hyi_set_best(site, flight, leaf, lane, primitive, t, weights[0], weights[1]);
    for (int i = 0; i < 3 && site->normal; i++) site->normal[flight->aim.axis[i]] = n[i];
    flight->aim.least_t = t;
    hyi_aim_limit(&flight->aim, t);
    return true;
}

HYI_INLINE bool hyi_decide(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane) {
    return hyi_decide_sheared(site, flight, leaf, lane, NULL);
}

/* Works out the hit that was put off. */
HYI_INLINE void hyi_settle(const hyi_site *site, hyi_flight *flight) {
    uint32_t leaf = flight->aim.leaf;
    if (leaf == 0) return;
    flight->aim.leaf = 0;
    (void)hyi_decide(site, flight, leaf, flight->aim.lane);
}

/* Puts a hit off that is nearer than all before, from t least on; any: the ray is done then. */
HYI_INLINE void hyi_postpone(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, float least, float most, bool any) {
    flight->aim.leaf = leaf;
    flight->aim.lane = lane;
    flight->aim.least_t = least;
    flight->aim.t_far = any ? -FLT_MAX : most + 4.0f * HYI_ULP * fabsf(most);
    if (any) flight->best.instance = site->instance;
}

/* Makes every box and triangle lie beyond a ray that is done. */
HYI_INLINE void hyi_flight_stop(hyi_flight *flight) { flight->aim.t_far = -FLT_MAX; }

/* ---- beginning */

/* Limits end short of HYI_NO_HIT. */
#define HYI_T_LIMIT 3.0e38f
HYI_INLINE float hyi_finite_limit(float t_max) { return t_max < HYI_T_LIMIT ? t_max : HYI_T_LIMIT; }

HYI_INLINE void hyi_flight_clear(hyi_flight *flight, const hyk_ray *at, float t_min, float limit) {
    flight->ray = at;
    flight->t_min = t_min;
    flight->best.t = limit;
    flight->best.u = flight->best.v = 0.0f;
    flight->best.instance = flight->best.primitive = HYK_NONE;
    flight->aim.least_t = limit;
    flight->aim.leaf = flight->aim.lane = 0;
}

/* Sets a ray on its way through one tree, looking no farther than its t_max and limit; false: it meets nothing there, as
   an unsound ray does. */
HYI_INLINE bool hyi_flight_begin(hyi_flight *flight, const hyi_bvh *bvh, const hyk_ray *at, float limit) {
    hyk_ray ray = hyi_load_ray(at);
    float origin[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    float direction[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    hyi_flight_clear(flight, at, ray.t_min, hyi_finite_limit(ray.t_max < limit ? ray.t_max : limit));
    if (bvh->primitive_count == 0 || !hyi_ray_is_sound(&ray) || !(ray.t_min <= flight->best.t)) return false;
    return hyi_aim_at(&flight->aim, bvh, origin, direction, ray.t_min, flight->best.t, bvh->rows == NULL);
}

/* One copy for all who rarely need it. */
HYI_NOINLINE bool hyi_begin_any(hyi_flight *flight, const hyi_bvh *bvh, const hyk_ray *at) { return hyi_flight_begin(flight, bvh, at, FLT_MAX); }

/* Where all rays of the scene begin: the world alone, or one unmoved mesh, has no level above it. */
HYI_INLINE hyi_site hyi_first_site(const hyi_accel *accel) {
    uint32_t mesh = accel->single && !accel->world ? accel->view->instances[0].mesh : 0u;
    hyi_site site;
    site.accel = accel;
    site.bvh = !accel->single ? accel->instances : accel->world ? accel->world : &accel->meshes[mesh];
    site.instance = 0;
    site.normal = NULL;
    site.asks_alpha = accel->single && (accel->world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[mesh]);
    return site;
}

/* ---- levels */

HYI_INLINE float hyi_transform_row(hyk_vec3 row, float offset, const float *p) {
    return row.x * p[0] + row.y * p[1] + row.z * p[2] + offset;
}

/* What box item of the tree over instances stands for. */
HYI_FN hyi_site hyi_site_of_item(const hyi_accel *accel, uint32_t item) {
    bool world = accel->world && item == 0;
    hyi_site site;
    site.accel = accel;
    site.normal = NULL;
    site.instance = accel->world && item > 0 ? accel->world_count + item - 1 : item;
    uint32_t mesh = accel->view->instances[site.instance].mesh;
    site.bvh = world ? accel->world : &accel->meshes[mesh];
    site.asks_alpha = world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[mesh];
    return site;
}

/* A ray from the tree over instances as the tree of one of them has it, up to the best hit so far. The direction is not
   renormalised: t means the same below. One copy for all instruction sets: it rounds. */
HYI_NOINLINE hyk_ray hyi_ray_below(const hyi_flight *above, const hyi_site *site) {
    const hyk_instance *placed = &site->accel->view->instances[site->instance];
    hyk_ray ray = hyi_load_ray(above->ray);
    ray.t_max = above->best.t;
    if (placed->flags & HYK_INSTANCE_IDENTITY) return ray;
    float o[3] = {ray.origin.x, ray.origin.y, ray.origin.z}, d[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    ray.origin.x = hyi_transform_row(placed->inverse0, placed->s0, o);
    ray.origin.y = hyi_transform_row(placed->inverse1, placed->s1, o);
    ray.origin.z = hyi_transform_row(placed->inverse2, placed->s2, o);
    ray.direction.x = hyi_transform_row(placed->inverse0, 0.0f, d);
    ray.direction.y = hyi_transform_row(placed->inverse1, 0.0f, d);
    ray.direction.z = hyi_transform_row(placed->inverse2, 0.0f, d);
    return ray;
}

/* Sets it on its way there; false: it meets nothing. */
HYI_FN bool hyi_flight_enter(hyi_flight *below, const hyi_flight *above, const hyi_site *site) {
    hyk_ray ray = hyi_ray_below(above, site);
    float origin[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    float direction[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    below->ray = above->ray;
    below->t_min = above->t_min;
    below->best = above->best;
    below->aim.least_t = above->best.t;
    below->aim.leaf = below->aim.lane = 0;
    return site->bvh->primitive_count && hyi_aim_at(&below->aim, site->bvh, origin, direction, ray.t_min, ray.t_max, false);
}

/* Takes what was found below; returns whether there was something new. */
HYI_INLINE bool hyi_flight_return(hyi_flight *above, const hyi_flight *below) {
    bool found = below->best.t != above->best.t || below->best.primitive != above->best.primitive || below->best.instance != above->best.instance;
    above->best = below->best;
    if (found) hyi_aim_limit(&above->aim, above->best.t);
    return found;
}

/* What a walk through a tree of boxes calls for each box that the ray meets; true: stop. */
typedef bool (*hyi_box_visit)(void *argument, hyi_flight *flight, uint32_t item);

typedef struct hyi_visit_of {
    const hyi_accel *accel;
    bool any;
} hyi_visit_of;

#endif /* HYI_BVH_WALK_H */
