/* >>shared-light-tree: choosing one of many lights by what it can give at a point

   Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting". A node's
   importance bounds, up to the distance, the irradiance its lights can cause; zero only when none can. */
#ifndef HYK_LIGHT_TREE_H
#define HYK_LIGHT_TREE_H

#include "sampling.h"
#include "views.h"

/* The smallest weight of something that can contribute: keeps underflow from making it impossible. */
#define HYK_LEAST_WEIGHT HYK_C(1e-37)

/* Irradiance is estimated as weight / distance^2; apart, because the square may leave the range. */
HYK_STRUCT(hyk_light_bound) {
    hyk_real weight;
    hyk_real distance;
} HYK_END(hyk_light_bound)

/* Cosine and sine of max(0, a - b) for angles in [0, pi]. */
HYK_FN hyk_vec2 hyk_angle_beyond(hyk_vec2 a, hyk_vec2 b) {
    if (a.x >= b.x) return hyk_make2(1.0f, 0.0f);
    return hyk_make2(a.x * b.x + a.y * b.y, hyk_max(a.y * b.x - a.x * b.y, 0.0f));
}
HYK_FN hyk_vec2 hyk_angle_of_cosine(hyk_real c) { return hyk_make2(c, hyk_safe_sqrt((1.0f - c) * (1.0f + c))); }

/* How far the box (middle as seen from the point, half extents) reaches towards a direction. slack: what
   rounding of coordinates can hide. */
HYK_FN hyk_real hyk_box_reach(hyk_vec3 middle, hyk_vec3 half_extent, hyk_vec3 direction, hyk_real slack) {
    return hyk_dot(middle, direction) + hyk_dot(half_extent, hyk_abs3(direction)) + slack;
}

/* The cosine at the lights, at its best: 0 when no normal within the cone turns far enough to the point. */
HYK_FN hyk_real hyk_emission_bound(hyk_light_node node, hyk_vec3 direction, hyk_vec2 spread) {
    hyk_real facing = -hyk_dot(node.axis, direction);
    if (node.both_sides != 0u) facing = hyk_abs(facing);
    hyk_vec2 cone = hyk_angle_of_cosine(node.cos_o);
    hyk_vec2 beyond = hyk_angle_beyond(hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), cone), spread);
    /* sines come from cosines near 1 with an error of up to the root of the rounding unit */
    hyk_real slack = 0.00390625f * (cone.y + spread.y) + 0.00000095367431640625f;
    return beyond.x < node.cos_e - slack ? 0.0f : hyk_max(beyond.x, slack);
}

HYK_FN hyk_real hyk_receiver_bound(hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction, hyk_vec2 spread) {
    hyk_real facing = hyk_dot(n, direction);
    if (both_sides) facing = hyk_abs(facing);
    hyk_vec2 beyond = hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), spread);
    return hyk_max(beyond.x, 0.00000095367431640625f);
}

HYK_FN hyk_light_bound hyk_bound_light_node(hyk_light_node node, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_vec3 half_extent = hyk_scale(hyk_sub(node.upper, node.lower), 0.5f);
    hyk_vec3 middle = hyk_sub(hyk_add(node.lower, half_extent), p);
    hyk_real distance = hyk_sqrt(hyk_dot(middle, middle)), radius = hyk_sqrt(hyk_dot(half_extent, half_extent));
    hyk_real slack = 8.0f * HYK_REAL_EPSILON * (hyk_max3(hyk_abs3(p)) + hyk_max3(hyk_abs3(node.lower)) + radius);
    hyk_light_bound bound;
    bound.weight = 0.0f;
    bound.distance = hyk_max(hyk_max(distance, radius), HYK_C(1e-30));
    if (!(node.intensity > 0.0f)) return bound;
    if (!both_sides && !(hyk_box_reach(middle, half_extent, n, slack) > 0.0f)) return bound;
    /* one orientation, emitting forwards only: the box must reach behind the point, along the axis */
    hyk_bool one_way = node.cos_o >= 1.0f && node.cos_e >= 0.0f && node.both_sides == 0u;
    if (one_way && !(hyk_box_reach(middle, half_extent, hyk_neg(node.axis), slack) > 0.0f)) return bound;
    bound.weight = node.intensity;
    if (distance <= radius) return bound; /* from within the bounding sphere anything is possible */
    hyk_real sine = radius / distance;
    hyk_vec2 spread = hyk_make2(hyk_sqrt((1.0f - sine) * (1.0f + sine)), sine);
    hyk_vec3 direction = hyk_scale(middle, 1.0f / distance);
    hyk_real emitted = hyk_emission_bound(node, direction, spread);
    if (emitted == 0.0f) bound.weight = 0.0f;
    else bound.weight = hyk_max(node.intensity * emitted * hyk_receiver_bound(n, both_sides, direction, spread), HYK_LEAST_WEIGHT);
    return bound;
}

/* The i-th of a node's two children, a leaf being its own first; HYK_NONE: there is none. */
HYK_FN hyk_uint hyk_light_child(hyk_view view, hyk_uint at, hyk_uint i) {
    if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) return i == 0u ? at : HYK_NONE;
    return i == 0u ? at + 1u : HYK_LOAD_LIGHT_NODE(view, at).child;
}

/* What a node gives, in units of weight at a distance of unit. Never 0 for what can contribute. */
HYK_FN hyk_real hyk_value_of_bound(hyk_light_bound bound, hyk_real unit) {
    if (!(bound.weight > 0.0f)) return 0.0f;
    hyk_real nearness = unit / bound.distance;
    return hyk_clamp(bound.weight * nearness * nearness, HYK_LEAST_WEIGHT, HYK_C(1e36));
}

/* The rarer child of two that can contribute still gets this much: a bound may be far above what its lights
   give, and then a light that matters must not become so rare that finding it blinds. */
#define HYK_LEAST_CHILD_SHARE 0.015625f

/* Probabilities of a node's two children, both 0 when no light of them can contribute. Each child is judged
   by the sum of its own children's bounds, one level further than the paper: so a bright light that faces
   away, or lies below the horizon, no longer draws the walk to its neighbours. */
HYK_FN hyk_vec2 hyk_light_child_shares(hyk_view view, hyk_uint first, hyk_uint second, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_light_node near_node = HYK_LOAD_LIGHT_NODE(view, first);
    hyk_vec3 extent = hyk_sub(near_node.upper, near_node.lower), away = hyk_sub(near_node.lower, p);
    hyk_real unit = hyk_max(hyk_sqrt(hyk_dot(extent, extent) + hyk_dot(away, away)), HYK_C(1e-30));
    hyk_real x = 0.0f, y = 0.0f;
    for (hyk_uint i = 0u; i < 4u; i++) {
        hyk_uint at = hyk_light_child(view, i < 2u ? first : second, i & 1u);
        if (at == HYK_NONE) continue;
        hyk_real value = hyk_value_of_bound(hyk_bound_light_node(HYK_LOAD_LIGHT_NODE(view, at), p, n, both_sides), unit);
        if (i < 2u) x += value;
        else y += value;
    }
    hyk_real less = hyk_min(x, y), sum = x + y;
    if (!(sum > 0.0f)) return hyk_make2(0.0f, 0.0f);
    hyk_real rarer = less > 0.0f ? hyk_max(less / sum, HYK_LEAST_CHILD_SHARE) : 0.0f;
    return x <= y ? hyk_make2(rarer, 1.0f - rarer) : hyk_make2(1.0f - rarer, rarer);
}

HYK_STRUCT(hyk_light_pick) {
    hyk_uint light;       /* HYK_NONE: no light below the node taken can contribute */
    hyk_real probability;
} HYK_END(hyk_light_pick)

HYK_FN hyk_light_pick hyk_pick_light(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_chooser chooser) {
    hyk_light_pick pick;
    pick.light = HYK_NONE;
    chooser.probability = 1.0f;
    hyk_uint at = 0u;
    for (hyk_uint depth = 0u; depth <= HYK_LIGHT_TREE_DEPTH; depth++) {
        hyk_uint child = HYK_LOAD_LIGHT_NODE(view, at).child;
        if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) {
            pick.light = child;
            break;
        }
        hyk_vec2 shares = hyk_light_child_shares(view, at + 1u, child, p, n, both_sides);
        if (!(shares.x + shares.y > 0.0f)) {
            chooser.probability = 0.0f;
            break;
        }
        chooser = hyk_choose_share(chooser, hyk_min(shares.x, shares.y), shares.y < shares.x);
        at = chooser.second ? child : at + 1u;
    }
    pick.probability = chooser.probability;
    return pick;
}

/* The probability with which hyk_pick_light takes the light that this path leads to. */
HYK_FN hyk_real hyk_light_pick_probability(hyk_view view, hyk_uint path, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real probability = 1.0f;
    hyk_uint at = 0u;
    for (hyk_uint depth = 0u; depth < HYK_LIGHT_TREE_DEPTH; depth++) {
        if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) break;
        hyk_uint child = HYK_LOAD_LIGHT_NODE(view, at).child;
        hyk_vec2 shares = hyk_light_child_shares(view, at + 1u, child, p, n, both_sides);
        hyk_bool second = ((path >> depth) & 1u) != 0u;
        probability *= second ? shares.y : shares.x;
        at = second ? child : at + 1u;
    }
    return probability;
}

/* Luminance of the irradiance that all finite lights together may give, from the second level of the tree.
   Zero only when no light can contribute. */
HYK_FN hyk_real hyk_estimate_finite_lights(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real sum = 0.0f;
    for (hyk_uint i = 0u; i < 4u; i++) {
        hyk_uint at = hyk_light_child(view, 0u, i >> 1);
        if (at != HYK_NONE) at = hyk_light_child(view, at, i & 1u);
        if (at != HYK_NONE) sum += hyk_value_of_bound(hyk_bound_light_node(HYK_LOAD_LIGHT_NODE(view, at), p, n, both_sides), 1.0f);
    }
    return sum;
}

#endif /* HYK_LIGHT_TREE_H */
