/* >>bvh-walk: one ray's way through the trees: its stack, its levels and its best hit

   What differs between instruction sets is how eight boxes and up to eight triangles are tested; all else
   is here. */
#ifndef HYI_BVH_WALK_H
#define HYI_BVH_WALK_H

#include "triangle.h"
#include "../../shaders/shared/alpha.h"

/* Everything that rays of a scene can meet. */
typedef struct hyi_accel {
    const hyk_scene_view *view;
    const hyi_bvh *meshes;         /* by mesh index */
    const uint8_t *mesh_has_alpha; /* by mesh index; NULL: none has */
    const hyi_bvh *world;          /* one tree over the first world_count instances, which are unmoved; NULL: none */
    const uint32_t *world_first;   /* of each of them, its first triangle's number in that tree */
    uint32_t world_count;
    bool world_has_alpha;
    const hyi_bvh *instances;      /* over the world, if any, and then the other instances; unused when single */
    bool single;                   /* the world alone, or exactly one instance, identity */
    bool empty;
    const hyi_bvh *shapes;         /* over the RECT, DISC and SPHERE lights; NULL: none */
    const uint32_t *shape_lights;  /* light of each box in shapes */
    hydra_isa isa;                 /* SCALAR, AVX2 or NEON, never AUTO */
} hyi_accel;

/* Constant in each instantiation. */
#define HYI_WALK_ANY 0x1u      /* stops at the first hit */
#define HYI_WALK_ALPHA 0x2u    /* asks hyk_hit_is_opaque on meshes that have alpha */
#define HYI_WALK_LEVELS 0x4u   /* goes through instances */

/* Seven children wait on each level of each of the two trees, and one marks the way back up. */
#define HYI_STACK (2u * (7u * HYI_TREE_DEPTH + 8u))
#define HYI_WALK_ENDED HYI_CHILD_NONE
#define HYI_WALK_UP 0x7ffffffeu

typedef struct hyi_waiting {
    uint32_t child;
    float t;
} hyi_waiting;

typedef struct hyi_walk {
    hyi_aim aim;
    uint32_t at;        /* the child to visit next */
    uint32_t waiting;   /* fill of the stack */
    const hyi_bvh *bvh; /* the tree that at belongs to */
    uint32_t instance;
    bool upper;         /* bvh is the tree over instances */
    bool asks_alpha;
    hyi_best best;
    const hyi_accel *accel;
    const hyk_ray *ray;
    hyi_aim upper_aim;  /* kept while below */
    hyi_waiting stack[HYI_STACK];
} hyi_walk;

/* upper_aim is set before a way up is marked; gcc cannot see that, and warns. */
#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

/* Takes the next child worth visiting off the stack. */
HYI_INLINE void hyi_walk_pop(hyi_walk *walk) {
    while (walk->waiting > 0) {
        const hyi_waiting *top = &walk->stack[--walk->waiting];
        if (top->child == HYI_WALK_UP) {
            walk->aim = walk->upper_aim;
            walk->bvh = walk->accel->instances;
            walk->upper = true;
            hyi_aim_limit(&walk->aim, walk->best.t);
        } else if (top->t <= walk->aim.t_far) {
            walk->at = top->child;
            return;
        }
    }
    walk->at = HYI_WALK_ENDED;
}

#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

/* Of child first and those in mask (not empty), returns the nearest and puts the others on the stack, the
   nearer the higher. */
HYI_INLINE uint32_t hyi_push_farther(hyi_waiting **stack, const uint32_t *child, const float *t, uint32_t first, uint32_t mask) {
    hyi_waiting *base = *stack, *top = base;
    hyi_waiting nearest;
    nearest.child = child[first];
    nearest.t = t[first];
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        hyi_waiting other, farther;
        other.child = child[c];
        other.t = t[c];
        bool nearer = other.t < nearest.t;
        farther.child = nearer ? nearest.child : other.child;
        farther.t = nearer ? nearest.t : other.t;
        nearest.child = nearer ? other.child : nearest.child;
        nearest.t = nearer ? other.t : nearest.t;
        hyi_waiting *place = top++;
        for (; place > base && place[-1].t < farther.t; place--) *place = place[-1];
        *place = farther;
    }
    *stack = top;
    return nearest.child;
}

/* Goes to the nearest of the children in mask. */
HYI_INLINE void hyi_walk_descend(hyi_walk *walk, const uint32_t *child, const float *t, uint32_t mask) {
    uint32_t first = hyi_lowest_bit(mask);
    hyi_waiting *top = walk->stack + walk->waiting;
    mask &= mask - 1u;
    walk->at = mask ? hyi_push_farther(&top, child, t, first, mask) : child[first];
    walk->waiting = (uint32_t)(top - walk->stack);
}

HYI_INLINE const float *hyi_leaf_rows(const hyi_walk *walk) {
    return walk->bvh->rows + 9u * (size_t)hyi_leaf_first(walk->at);
}

/* Ends a walk for any hit. */
HYI_INLINE void hyi_walk_stop(hyi_walk *walk) {
    walk->waiting = 0;
    walk->at = HYI_WALK_ENDED;
}

/* The triangles of the world are numbered through: which instance a number belongs to, and its number there. While a ray
   is under way a hit on the world has instance 0; numbers of the world keep the order of (instance, primitive). */
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

HYI_INLINE bool hyi_walk_lets_pass(const hyi_walk *walk, uint32_t primitive, const float weights[2]) {
    uint32_t instance = walk->instance;
    hyi_locate_in_world(walk->accel, &instance, &primitive);
    return !hyk_hit_is_opaque(walk->accel->view, instance, primitive, weights[0], weights[1], *walk->ray);
}

/* Decides on one triangle of the leaf that at names. Returns whether it is the new best. */
HYI_INLINE bool hyi_walk_offer(hyi_walk *walk, uint32_t lane, uint32_t flags) {
    float weights[2] = {0.0f, 0.0f};
    float t = hyi_confirm(&walk->aim, hyi_leaf_rows(walk), hyi_leaf_count(walk->at), lane, weights);
    if (!(t >= walk->ray->t_min && t <= walk->best.t)) return false;
    uint32_t primitive = walk->bvh->ids[hyi_leaf_first(walk->at) + lane];
    if (!hyi_beats(&walk->best, t, walk->instance, primitive)) return false;
    if ((flags & HYI_WALK_ALPHA) && walk->asks_alpha && hyi_walk_lets_pass(walk, primitive, weights)) return false;
    walk->best.t = t;
    walk->best.u = weights[0];
    walk->best.v = weights[1];
    walk->best.instance = walk->instance;
    walk->best.primitive = primitive;
    hyi_aim_limit(&walk->aim, t);
    return true;
}

/* Offers the triangles of mask, all of them or until one stops the ray. Returns whether one was a hit. */
HYI_INLINE bool hyi_walk_offer_all(hyi_walk *walk, uint32_t mask, uint32_t flags) {
    bool found = false;
    for (; mask; mask &= mask - 1u) {
        if (hyi_walk_offer(walk, hyi_lowest_bit(mask), flags)) found = true;
        if (found && (flags & HYI_WALK_ANY)) break;
    }
    return found;
}

/* Offers the triangles of mask, then goes on. */
HYI_INLINE void hyi_walk_leaf(hyi_walk *walk, uint32_t mask, uint32_t flags) {
    if (hyi_walk_offer_all(walk, mask, flags) && (flags & HYI_WALK_ANY)) hyi_walk_stop(walk);
    else hyi_walk_pop(walk);
}

/* ---- levels */

HYI_INLINE float hyi_transform_row(hyk_vec3 row, float offset, const float *p) {
    return row.x * p[0] + row.y * p[1] + row.z * p[2] + offset;
}

/* Turns to the mesh of an instance, or to the world; the way back up is marked on the stack. The direction is not
   renormalised: t means the same below. One copy for all instruction sets: it rounds. */
HYI_NOINLINE void hyi_walk_enter(hyi_walk *walk) {
    const hyi_accel *accel = walk->accel;
    uint32_t item = walk->bvh->ids[hyi_leaf_first(walk->at)];
    bool world = accel->world && item == 0;
    uint32_t index = accel->world && item > 0 ? accel->world_count + item - 1 : item;
    const hyk_instance *placed = &accel->view->instances[index];
    const hyi_bvh *mesh = world ? accel->world : &accel->meshes[placed->mesh];
    const hyk_ray *ray = walk->ray;
    float origin[3] = {ray->origin.x, ray->origin.y, ray->origin.z};
    float direction[3] = {ray->direction.x, ray->direction.y, ray->direction.z};
    if (!(placed->flags & HYK_INSTANCE_IDENTITY)) {
        float o[3] = {origin[0], origin[1], origin[2]}, d[3] = {direction[0], direction[1], direction[2]};
        origin[0] = hyi_transform_row(placed->inverse0, placed->s0, o);
        origin[1] = hyi_transform_row(placed->inverse1, placed->s1, o);
        origin[2] = hyi_transform_row(placed->inverse2, placed->s2, o);
        direction[0] = hyi_transform_row(placed->inverse0, 0.0f, d);
        direction[1] = hyi_transform_row(placed->inverse1, 0.0f, d);
        direction[2] = hyi_transform_row(placed->inverse2, 0.0f, d);
    }
    hyi_aim aim;
    if (mesh->primitive_count == 0 || !hyi_aim_at(&aim, mesh, origin, direction, ray->t_min, walk->best.t, false)) {
        hyi_walk_pop(walk);
        return;
    }
    walk->upper_aim = walk->aim;
    walk->aim = aim;
    walk->bvh = mesh;
    walk->upper = false;
    walk->instance = index;
    walk->asks_alpha = world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[placed->mesh];
    walk->at = mesh->root;
    walk->stack[walk->waiting].child = HYI_WALK_UP;
    walk->stack[walk->waiting++].t = 0.0f;
}

/* Limits end short of HYI_NO_HIT. */
#define HYI_T_LIMIT 3.0e38f
HYI_INLINE float hyi_finite_limit(float t_max) { return t_max < HYI_T_LIMIT ? t_max : HYI_T_LIMIT; }

/* Sets a ray on its way through one tree, looking no farther than limit. */
HYI_NOINLINE void hyi_walk_begin_tree(hyi_walk *walk, const hyi_accel *accel, const hyi_bvh *bvh, const hyk_ray *ray, float limit) {
    float origin[3] = {ray->origin.x, ray->origin.y, ray->origin.z};
    float direction[3] = {ray->direction.x, ray->direction.y, ray->direction.z};
    walk->accel = accel;
    walk->ray = ray;
    walk->waiting = 0;
    walk->instance = 0;
    walk->bvh = bvh;
    walk->upper = bvh->rows == NULL;
    walk->asks_alpha = false;
    walk->best.t = limit;
    walk->best.u = walk->best.v = 0.0f;
    walk->best.instance = walk->best.primitive = HYK_NONE;
    walk->at = HYI_WALK_ENDED;
    if (bvh->primitive_count == 0 || !(ray->t_min <= limit)) return;
    if (hyi_aim_at(&walk->aim, bvh, origin, direction, ray->t_min, limit, walk->upper)) walk->at = bvh->root;
}

/* Sets a ray on its way through the scene. The world alone, or one unmoved mesh, has no upper tree. */
HYI_INLINE void hyi_walk_begin(hyi_walk *walk, const hyi_accel *accel, const hyk_ray *ray) {
    uint32_t mesh = accel->single ? accel->view->instances[0].mesh : 0u;
    const hyi_bvh *bvh = !accel->single ? accel->instances : accel->world ? accel->world : &accel->meshes[mesh];
    hyi_walk_begin_tree(walk, accel, bvh, ray, hyi_finite_limit(ray->t_max));
    if (accel->single) walk->asks_alpha = accel->world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[mesh];
}

HYI_INLINE void hyi_walk_answer(const hyi_walk *walk, hyk_hit *hit) {
    bool found = walk->best.instance != HYK_NONE;
    hit->t = found ? walk->best.t : -1.0f;
    hit->u = walk->best.u;
    hit->v = walk->best.v;
    hit->instance = walk->best.instance;
    hit->primitive = walk->best.primitive;
    hyi_locate_in_world(walk->accel, &hit->instance, &hit->primitive);
}

#endif /* HYI_BVH_WALK_H */
