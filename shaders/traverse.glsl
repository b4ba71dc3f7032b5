/* Rays through the compressed trees of tree.h. The decision on a triangle is that of src/bvh/triangle.h, operation by
   operation, so that a device finds the hits of the CPU, bit for bit where its double division rounds correctly; what is
   tuned to devices is only the way there. */
#include "tree.h"
#include "alpha.h"
#include "shape.h"

layout(std430, set = 0, binding = HYK_BINDING_TREES) readonly buffer hyk_trees_buffer { hyk_tree hyk_trees[]; };
layout(std430, set = 0, binding = HYK_BINDING_WORLD_FIRST) readonly buffer hyk_world_buffer { uint hyk_world_first[]; };

/* At least the levels of the deepest tree over triangles or shapes, and of the one over instances. */
layout(constant_id = 1) const uint hyk_depth = 64u;
layout(constant_id = 2) const uint hyk_top_depth = 64u;

/* Kernels define hyk_any: whether a ray is done at its first hit; and how words of nodes and slots are fetched:
   hyk_node_words(i), the i-th four words of all nodes, and hyk_slot_at(i). */
#define HYK_NO_HIT 3.402823466e+38
#define HYK_ULP 1.1920928955078125e-07

struct hyk_best { float t, u, v; uint instance, primitive; };

/* A ray in the units of one tree: see hyi_aim. */
struct hyk_aim {
    vec3 inverse, near_offset, far_offset;
    float t_near, t_far;
    vec3 origin, direction; /* the largest component of the direction last */
    vec2 shear;
    uint axis, octant;
    double t_by_z, unit, inverse_unit;
};

/* What a tree is walked for. */
struct hyk_quest {
    hyk_ray ray; /* in world space */
    bool skip_hidden;
    uint world_count; /* meshes that the world tree is over; 0: there is none */
    uint instance;
    bool asks_alpha;
};

vec3 hyk_turned(vec3 v, uint axis) { return axis == 0u ? v.yzx : axis == 1u ? v.zxy : v; }
dvec3 hyk_turned(dvec3 v, uint axis) { return axis == 0u ? v.yzx : axis == 1u ? v.zxy : v; }

double hyk_power_of_two(int exponent) { return packDouble2x32(uvec2(0u, uint(exponent + 1023) << 20)); }

/* ---- aiming: hyi_aim_at */

bool hyk_aim_scale(inout hyk_aim aim, float scale, inout vec3 o, inout vec3 d) {
    const float far = 4611686018427387904.0;
    float largest = hyk_max3(abs(d));
    o = clamp(o * scale, -far, far);
    if (!(largest > 0.0 && largest <= 3.402823466e+38)) return false;
    double factor = double(scale), size = double(largest) * factor;
    aim.unit = 1.0LF;
    aim.inverse_unit = 1.0LF;
    if (size < 9.31322574615478515625e-10LF || size > 1073741824.0LF) {
        int exponent = int(unpackDouble2x32(size).y >> 20) - 1022;
        aim.unit = hyk_power_of_two(-exponent);
        aim.inverse_unit = hyk_power_of_two(exponent);
        factor *= aim.unit;
    }
    d = vec3(dvec3(d) * factor);
    return true;
}

vec3 hyk_reach(hyk_tree tree, vec3 o, bool loose) {
    if (loose) return 4.0 * (max(abs(tree.lower), abs(tree.upper)) + abs(o));
    return max(abs(tree.lower - o), abs(tree.upper - o));
}

/* Twice the bound of hyi_slab_bound: a device's division is off by 2.5 ulps, and its grid adds a rounding. */
void hyk_aim_slabs(inout hyk_aim aim, hyk_tree tree, vec3 o, vec3 d, bool loose) {
    const float steady = 8.67361737988403547e-19;
    vec3 reach = hyk_reach(tree, o, loose);
    vec3 bound = 1.9073486328125e-06 * (reach + reach[aim.axis]) + 4.0 * HYK_ULP * abs(o);
    bvec3 falls = lessThan(d, vec3(0.0));
    vec3 kept = mix(mix(vec3(steady), vec3(-steady), falls), d, greaterThanEqual(abs(d), vec3(steady)));
    vec3 toward = mix(bound, -bound, falls);
    aim.inverse = 1.0 / kept;
    aim.near_offset = -(o + toward) * aim.inverse;
    aim.far_offset = -(o - toward) * aim.inverse;
    aim.octant = (falls.x ? 0u : 1u) | (falls.y ? 0u : 2u) | (falls.z ? 0u : 4u);
}

void hyk_aim_shear(inout hyk_aim aim, vec3 o, vec3 d) {
    aim.axis = abs(d.x) >= abs(d.y) ? 0u : 1u;
    if (abs(d.z) > abs(d[aim.axis])) aim.axis = 2u;
    aim.origin = hyk_turned(o, aim.axis);
    aim.direction = hyk_turned(d, aim.axis);
    aim.t_by_z = 1.0LF / double(aim.direction.z);
    precise dvec2 shear = dvec2(aim.direction.xy) * aim.t_by_z;
    aim.shear = vec2(shear);
}

/* hyi_aim_t */
float hyk_aim_t(hyk_aim aim, float t, float sign) {
    double least = aim.inverse_unit > 1.0LF ? double(sign) * 1.40129846432481707e-45LF : 0.0LF;
    float here = float((double(t) + least) * aim.inverse_unit);
    return here + sign * 4.0 * HYK_ULP * abs(here);
}

/* The farthest t worth visiting. */
void hyk_aim_limit(inout hyk_aim aim, float t) { aim.t_far = hyk_aim_t(aim, min(t, 3.402823466e+38), 1.0); }

/* False: the ray has no direction, or the tree nothing in it. */
bool hyk_aim_at(out hyk_aim aim, hyk_tree tree, vec3 origin, vec3 direction, float t_min, float t_max, bool loose) {
    if (tree.first_node == HYK_TREE_EMPTY || !hyk_aim_scale(aim, tree.scale, origin, direction)) return false;
    hyk_aim_shear(aim, origin, direction);
    hyk_aim_slabs(aim, tree, origin, direction, loose);
    aim.t_near = hyk_aim_t(aim, t_min, -1.0);
    hyk_aim_limit(aim, t_max);
    return true;
}

/* ---- a node */

/* One word of a stack: which node's children wait, and above it which of them, in the order of the ray. */
#define HYK_WAITING 24u
#define HYK_WAITS(group) ((group) > HYK_NODES_MOST)

/* Moves bit p to bit p ^ octant, so that the highest is what the ray meets first. */
uint hyk_in_order(uint places, uint octant) {
    if ((octant & 1u) != 0u) places = (places & 0x55u) << 1 | (places >> 1 & 0x55u);
    if ((octant & 2u) != 0u) places = (places & 0x33u) << 2 | (places >> 2 & 0x33u);
    if ((octant & 4u) != 0u) places = (places & 0x0fu) << 4 | (places >> 4 & 0x0fu);
    return places;
}

/* Lower and upper bytes of an axis come in one vector: two words each. */
uvec4 hyk_near_then_far(uvec4 planes, float inverse) { return inverse < 0.0 ? planes.zwxy : planes; }
vec4 hyk_bytes(uint word) { return vec4(word & 255u, word >> 8 & 255u, word >> 16 & 255u, word >> 24); }

/* Between floats of one sign integers find the same extremes, and processors do so at once, where they must look for NaN
   among floats. Of two negative numbers the wrong one comes out: then a box only seems larger, as t_near below zero is. */
ivec4 hyk_bits(vec4 v) { return floatBitsToInt(v); }

uint hyk_children_met(hyk_aim aim, vec3 stride, vec3 near_start, vec3 far_start, uvec3 near_words, uvec3 far_words) {
    ivec4 near = max(max(hyk_bits(hyk_bytes(near_words.x) * stride.x + near_start.x), hyk_bits(hyk_bytes(near_words.y) * stride.y + near_start.y)),
                     max(hyk_bits(hyk_bytes(near_words.z) * stride.z + near_start.z), hyk_bits(vec4(aim.t_near))));
    ivec4 far = min(min(hyk_bits(hyk_bytes(far_words.x) * stride.x + far_start.x), hyk_bits(hyk_bytes(far_words.y) * stride.y + far_start.y)),
                    min(hyk_bits(hyk_bytes(far_words.z) * stride.z + far_start.z), hyk_bits(vec4(aim.t_far))));
    bvec4 met = lessThanEqual(intBitsToFloat(near), intBitsToFloat(far));
    return (met.x ? 1u : 0u) | (met.y ? 2u : 0u) | (met.z ? 4u : 0u) | (met.w ? 8u : 0u);
}

/* What a ray meets of a node: children that are nodes, as a word of a stack, 0 where there are none; and leaves, one bit a
   place. links: where both stand, see HYK_NODE_CHILDREN. index: of the node's first four words. */
uint hyk_meet_node(hyk_aim aim, uint index, out uint leaves, out uvec4 links) {
    uvec4 head = hyk_node_words(index);
    links = hyk_node_words(index + 1u);
    uvec4 x = hyk_near_then_far(hyk_node_words(index + 2u), aim.inverse.x);
    uvec4 y = hyk_near_then_far(hyk_node_words(index + 3u), aim.inverse.y);
    uvec4 z = hyk_near_then_far(hyk_node_words(index + 4u), aim.inverse.z);
    vec3 step = uintBitsToFloat(uvec3(head.w & 255u, head.w >> 8 & 255u, head.w >> 16 & 255u) << 23);
    vec3 stride = step * aim.inverse, start = uintBitsToFloat(head.xyz) * aim.inverse;
    vec3 near_start = start + aim.near_offset, far_start = start + aim.far_offset;
    uint places = hyk_children_met(aim, stride, near_start, far_start, uvec3(x.x, y.x, z.x), uvec3(x.z, y.z, z.z)) |
                  hyk_children_met(aim, stride, near_start, far_start, uvec3(x.y, y.y, z.y), uvec3(x.w, y.w, z.w)) << 4;
    uint nodes = hyk_in_order(places & head.w >> 24, aim.octant);
    leaves = places & ~(head.w >> 24);
    return nodes != 0u ? links.x | nodes << HYK_WAITING : 0u;
}

/* The slots of those leaves, one bit each. */
uint hyk_slots_of(uint leaves, uvec2 bytes) {
    uint slots = 0u;
    for (uint place = 0u; place < 8u; place++) {
        uint leaf = (place < 4u ? bytes.x : bytes.y) >> (place << 3 & 31u) & 255u, some = 15u >> (leaf >> 5) << (leaf & 31u);
        slots |= (leaves >> place & 1u) != 0u ? some : 0u;
    }
    return slots;
}

/* The number of the highest bit of eight, found by way of a float: not all that run this count leading zeros. */
uint hyk_highest_of_eight(uint bits) { return (floatBitsToUint(float(bits)) >> 23) - 127u; }

/* ---- a triangle: hyi_confirm */

vec2 hyk_shear_corner(hyk_aim aim, vec3 to_corner) {
    precise vec2 across = aim.shear * to_corner.z;
    precise vec2 corner = to_corner.xy - across;
    return corner;
}

double hyk_cross_exact(vec2 p, vec2 q) {
    precise double r = double(p.x) * double(q.y) - double(p.y) * double(q.x);
    return r;
}

double hyk_sum_products(dvec3 a, dvec3 b) {
    precise dvec3 p = a * b;
    precise double sum = p.x + p.y;
    precise double all = sum + p.z;
    return all;
}

/* hyi_crossing */
struct hyk_crossing { dvec3 a, e, f, n, t; double across, plane; };

dvec3 hyk_normal(dvec3 e, dvec3 f) {
    precise dvec3 first = e.yzx * f.zxy, second = e.zxy * f.yzx, n = first - second;
    return n;
}

hyk_crossing hyk_cross_plane(hyk_aim aim, vec3 a, vec3 b, vec3 c) {
    dvec3 corner = dvec3(a), origin = dvec3(aim.origin);
    precise dvec3 to_a = corner - origin, e = dvec3(b) - corner, f = dvec3(c) - corner;
    dvec3 n = hyk_normal(e, f);
    double across = hyk_sum_products(n, dvec3(aim.direction));
    precise double plane = hyk_sum_products(n, to_a) / across;
    precise dvec3 along = dvec3(to_a.z, double(b.z) - origin.z, double(c.z) - origin.z) * aim.t_by_z;
    double least = min(along.x, min(along.y, along.z)), most = max(along.x, max(along.y, along.z));
    return hyk_crossing(to_a, e, f, n, along, across, plane < least ? least : plane > most ? most : plane);
}

/* hyi_settle_distance */
bool hyk_meets_inside(hyk_crossing x, vec3 direction) {
    precise dvec3 on = x.plane * dvec3(direction), q = on - x.a;
    double b = hyk_sum_products(hyk_normal(q, x.f), x.n), c = hyk_sum_products(hyk_normal(x.e, q), x.n);
    precise double both = b + c;
    return b >= 0.0LF && c >= 0.0LF && both <= hyk_sum_products(x.n, x.n);
}

/* t, in the tree's units, of a triangle whose edge functions have the sum given. */
double hyk_distance(hyk_aim aim, hyk_crossing x, dvec3 edges, double sum) {
    double total = hyk_sum_products(edges, x.t);
    precise double expected = x.plane * sum, gap = expected - total;
    precise double share = 4.76837158203125e-07LF * abs(x.t.x), trusted = share * abs(sum), mean = total / sum;
    return abs(gap) > trusted && !hyk_meets_inside(x, aim.direction) ? mean : x.plane;
}

/* Whether the signs of the edge functions agree. Float first: rounding is monotone, so what differs in sign there does. */
bool hyk_edges_agree(vec2 a, vec2 b, vec2 c) {
    precise vec3 first = vec3(c.x * b.y, a.x * c.y, b.x * a.y), second = vec3(c.y * b.x, a.y * c.x, b.y * a.x);
    precise vec3 edges = first - second;
    return !(any(lessThan(edges, vec3(0.0))) && any(greaterThan(edges, vec3(0.0))));
}

/* The corners in the frame of the ray. */
struct hyk_sheared { vec2 a, b, c; };

hyk_sheared hyk_shear(hyk_aim aim, vec3 a, vec3 b, vec3 c) {
    precise vec3 to_a = a - aim.origin, to_b = b - aim.origin, to_c = c - aim.origin;
    return hyk_sheared(hyk_shear_corner(aim, to_a), hyk_shear_corner(aim, to_b), hyk_shear_corner(aim, to_c));
}

/* False: the ray misses the triangle. */
bool hyk_may_hit(hyk_aim aim, hyk_slot slot) {
    hyk_sheared s = hyk_shear(aim, hyk_turned(slot.a, aim.axis), hyk_turned(slot.b, aim.axis), hyk_turned(slot.c, aim.axis));
    return hyk_edges_agree(s.a, s.b, s.c);
}

/* t of the ray, or HYK_NO_HIT where it is not within t_min and t_max. */
float hyk_confirm(hyk_aim aim, hyk_slot slot, float t_min, float t_max, out vec2 weights) {
    vec3 a = hyk_turned(slot.a, aim.axis), b = hyk_turned(slot.b, aim.axis), c = hyk_turned(slot.c, aim.axis);
    hyk_sheared s = hyk_shear(aim, a, b, c);
    hyk_crossing x = hyk_cross_plane(aim, a, b, c);
    dvec3 edges = dvec3(hyk_cross_exact(s.c, s.b), hyk_cross_exact(s.a, s.c), hyk_cross_exact(s.b, s.a));
    precise double some = edges.x + edges.y;
    precise double sum = some + edges.z;
    precise double distance = hyk_distance(aim, x, edges, sum) * aim.unit;
    float t = float(distance);
    bool below = any(lessThan(edges, dvec3(0.0LF))), above = any(greaterThan(edges, dvec3(0.0LF)));
    precise double inverse = 1.0LF / sum;
    weights = vec2(edges.yz * inverse);
    return x.across != 0.0LF && t >= t_min && t <= t_max && !(below && above) && sum != 0.0LF ? t : HYK_NO_HIT;
}

bool hyk_beats(hyk_best best, float t, uint instance, uint primitive) {
    if (t != best.t) return t < best.t;
    return instance != best.instance ? instance < best.instance : primitive < best.primitive;
}

/* ---- whose triangle it is */

/* From a triangle's number in the world to instance and triangle of its mesh. */
void hyk_locate(uint world_count, inout uint instance, inout uint primitive) {
    if (world_count == 0u || instance != 0u) return;
    uint low = 0u, high = world_count;
    while (high - low > 1u) {
        uint middle = low + (high - low) / 2u;
        if (hyk_world_first[middle] <= primitive) low = middle;
        else high = middle;
    }
    instance = low;
    primitive -= hyk_world_first[low];
}

bool hyk_stops(hyk_quest quest, uint primitive, vec2 weights) {
    uint instance = quest.instance;
    hyk_locate(quest.world_count, instance, primitive);
    return hyk_hit_is_opaque(0u, instance, primitive, weights.x, weights.y, quest.ray);
}

/* ---- walking */

/* Both return whether the walk is over. */
bool hyk_meet_triangle(hyk_quest quest, inout hyk_aim aim, inout hyk_best best, hyk_slot slot) {
    vec2 weights;
    float t = hyk_confirm(aim, slot, quest.ray.t_min, best.t, weights);
    if (t == HYK_NO_HIT || !hyk_beats(best, t, quest.instance, slot.item)) return false;
    if (HYK_HAS(hyk_features, HYK_NEEDS_ALPHA) && quest.asks_alpha && !hyk_stops(quest, slot.item, weights)) return false;
    best = hyk_best(t, weights.x, weights.y, quest.instance, slot.item);
    hyk_aim_limit(aim, t);
    return hyk_any;
}

bool hyk_meet_shape(hyk_quest quest, inout hyk_aim aim, inout hyk_best best, uint item) {
    hyk_light light = hyk_lights[item];
    if (quest.skip_hidden && (light.flags & HYK_LIGHT_HIDDEN) != 0u) return false;
    float t = hyk_intersect_shape(light, quest.ray);
    if (!(t >= quest.ray.t_min && t <= best.t && t >= 0.0 && hyk_beats(best, t, HYK_HIT_SHAPE, item))) return false;
    best = hyk_best(t, 0.0, 0.0, HYK_HIT_SHAPE, item);
    hyk_aim_limit(aim, t);
    return hyk_any;
}

/* Takes the first waiting child of group. */
uint hyk_take_child(inout uint group, uint octant) {
    uint bit = hyk_highest_of_eight(group >> HYK_WAITING), child = (group & HYK_NODES_MOST) + (bit ^ octant);
    group ^= 1u << HYK_WAITING << bit;
    group = HYK_WAITS(group) ? group : 0u;
    return child;
}

/* The group in which only the root waits. */
uint hyk_root(uint octant) { return 1u << HYK_WAITING << octant; }

/* Groups that wait, the latest first, 0 after the last: twelve of them in registers, far quicker to reach than an
   invocation's own memory. */
#define HYK_REGISTERS 12u
struct hyk_stack { uvec4 first, second, third; uint deep; };
uint hyk_rest[hyk_depth]; /* not in the struct: glslang would copy it with every call */

/* In the place of the latest: what is left of it, and above that what its child has brought; each unless it is 0. Without
   branches, which processors that pose as devices do not have within a loop. */
void hyk_restack(inout hyk_stack s, uint left, uint brought) {
    bool more = left != 0u && brought != 0u, less = left == 0u && brought == 0u;
    bvec4 up = bvec4(more), down = bvec4(less);
    uint last = s.third.w, next = 0u;
    if (hyk_depth > HYK_REGISTERS) {
        if (more && last != 0u) hyk_rest[s.deep++] = last;
        if (less && s.deep > 0u) next = hyk_rest[--s.deep];
    }
    uvec4 third = mix(mix(s.third, uvec4(s.third.yzw, next), down), uvec4(s.second.w, s.third.xyz), up);
    uvec4 second = mix(mix(s.second, uvec4(s.second.yzw, s.third.x), down), uvec4(s.first.w, s.second.xyz), up);
    uvec4 first = mix(mix(s.first, uvec4(s.first.yzw, s.second.x), down), uvec4(0u, left, s.first.yz), up);
    first.x = brought != 0u ? brought : left != 0u ? left : first.x;
    s.first = first;
    s.second = second;
    s.third = third;
}

/* The first slot of those in a word with one bit a slot, which must not be 0; its bit goes. */
uint hyk_take_slot(inout uint slots) {
    uint lowest = slots & (~slots + 1u);
    slots ^= lowest;
    return (floatBitsToUint(float(int(lowest))) >> 23 & 255u) - 127u;
}

/* Those that the ray may hit. */
uint hyk_sift(hyk_aim aim, uint first_slot, uint slots) {
    uint found = 0u;
    for (;;) {
        if (slots != 0u) {
            uint slot = hyk_take_slot(slots);
            if (hyk_may_hit(aim, hyk_slot_at(first_slot + slot))) found |= 1u << slot;
        }
        if (slots == 0u) break;
    }
    return found;
}

/* Whether the walk is over. */
bool hyk_meet_slots(hyk_quest quest, inout hyk_aim aim, inout hyk_best best, bool boxes, uint first_slot, uint slots) {
    bool done = false;
    if (!boxes) slots = hyk_sift(aim, first_slot, slots);
    for (;;) {
        if (slots != 0u) {
            hyk_slot slot = hyk_slot_at(first_slot + hyk_take_slot(slots));
            done = boxes ? hyk_meet_shape(quest, aim, best, slot.item) : hyk_meet_triangle(quest, aim, best, slot);
        }
        if (done || slots == 0u) break;
    }
    return done;
}

/* Nodes until there are leaves, then the leaves: so that the lanes of a subgroup do the same at the same time (Aila & Laine
   2009, "Understanding the efficiency of ray traversal on GPUs", while-while). Loops end at their end: where lanes are those
   of a processor's vectors, one that ends at its beginning is gone through once more by no lane. And what such a loop hands
   on is set behind a condition: lavapipe (Mesa 22.3) works it out again for the lanes that have left the loop, from what
   they have become, and keeps only what a condition keeps. Returns whether a quest for anything is done. */
bool hyk_walk(hyk_quest quest, hyk_tree tree, inout hyk_aim aim, inout hyk_best best, bool boxes) {
    hyk_stack stack = hyk_stack(uvec4(hyk_root(aim.octant), 0u, 0u, 0u), uvec4(0u), uvec4(0u), 0u);
    uint first_word = HYK_NODE_TEXELS * tree.first_node;
    bool done = false;
    for (;;) {
        uint leaves = 0u;
        uvec4 links = uvec4(0u);
        for (;;) {
            if (leaves == 0u) {
                uint group = stack.first.x, child = hyk_take_child(group, aim.octant);
                uint brought = hyk_meet_node(aim, first_word + HYK_NODE_TEXELS * child, leaves, links);
                hyk_restack(stack, group, brought);
            }
            if (leaves != 0u || stack.first.x == 0u) break;
        }
        done = hyk_meet_slots(quest, aim, best, boxes, tree.first_slot + links.y, hyk_slots_of(leaves, links.zw));
        if (done || stack.first.x == 0u) break;
    }
    return done;
}

vec3 hyk_into(hyk_instance placed, vec3 p, float one) {
    precise vec3 x = vec3(placed.inverse0.x, placed.inverse1.x, placed.inverse2.x) * p.x;
    precise vec3 y = vec3(placed.inverse0.y, placed.inverse1.y, placed.inverse2.y) * p.y;
    precise vec3 z = vec3(placed.inverse0.z, placed.inverse1.z, placed.inverse2.z) * p.z;
    precise vec3 xy = x + y;
    precise vec3 xyz = xy + z;
    precise vec3 r = xyz + vec3(placed.s0, placed.s1, placed.s2) * one;
    return r;
}

/* The tree of an item of the one over instances: hyi_site_of_item and hyi_flight_enter. */
bool hyk_visit(inout hyk_quest quest, uint item, inout hyk_best best) {
    bool world = quest.world_count != 0u && item == 0u;
    quest.instance = quest.world_count != 0u && item > 0u ? quest.world_count + item - 1u : item;
    hyk_instance placed = hyk_instances[quest.instance];
    hyk_tree tree = hyk_trees[world ? HYK_TREE_WORLD : HYK_TREE_MESHES + placed.mesh];
    vec3 origin = quest.ray.origin, direction = quest.ray.direction;
    if ((placed.flags & HYK_INSTANCE_IDENTITY) == 0u) {
        origin = hyk_into(placed, origin, 1.0);
        direction = hyk_into(placed, direction, 0.0);
    }
    quest.asks_alpha = tree.asks_alpha != 0u;
    hyk_aim aim;
    if (!hyk_aim_at(aim, tree, origin, direction, quest.ray.t_min, best.t, false)) return false;
    return hyk_walk(quest, tree, aim, best, false);
}

bool hyk_walk_top(hyk_quest quest, inout hyk_best best) {
    hyk_tree top = hyk_trees[HYK_TREE_TOP];
    hyk_aim aim;
    if (!hyk_aim_at(aim, top, quest.ray.origin, quest.ray.direction, quest.ray.t_min, best.t, true)) return false;
    uint stack[hyk_top_depth], depth = 0u, group = hyk_root(aim.octant);
    for (;;) {
        uint leaves;
        uvec4 links;
        uint child = hyk_take_child(group, aim.octant);
        uint brought = hyk_meet_node(aim, HYK_NODE_TEXELS * (top.first_node + child), leaves, links);
        if (group != 0u && brought != 0u) stack[depth++] = group;
        group = brought != 0u ? brought : group;
        uint slots = hyk_slots_of(leaves, links.zw);
        while (slots != 0u) {
            if (hyk_visit(quest, hyk_slot_at(top.first_slot + links.y + hyk_take_slot(slots)).item, best)) return true;
            hyk_aim_limit(aim, best.t);
        }
        if (group == 0u) {
            if (depth == 0u) return false;
            group = stack[--depth];
        }
    }
    return false;
}

/* ---- what kernels call */

bool hyk_walk_single(inout hyk_quest quest, inout hyk_best best) {
    hyk_tree tree = hyk_trees[HYK_TREE_WORLD];
    quest.instance = 0u;
    quest.asks_alpha = tree.asks_alpha != 0u;
    hyk_aim aim;
    if (!hyk_aim_at(aim, tree, quest.ray.origin, quest.ray.direction, quest.ray.t_min, best.t, false)) return false;
    return hyk_walk(quest, tree, aim, best, false);
}

bool hyk_walk_shapes(hyk_quest quest, inout hyk_best best) {
    hyk_tree tree = hyk_trees[HYK_TREE_SHAPES];
    hyk_aim aim;
    if (!hyk_aim_at(aim, tree, quest.ray.origin, quest.ray.direction, quest.ray.t_min, best.t, true)) return false;
    return hyk_walk(quest, tree, aim, best, true);
}

/* The nearest of triangles and light shapes, or with hyk_any some of them. */
hyk_best hyk_trace(hyk_ray ray, bool skip_hidden) {
    hyk_best best = hyk_best(min(ray.t_max, HYK_REAL_MAX), 0.0, 0.0, HYK_NONE, HYK_NONE);
    hyk_quest quest;
    quest.ray = ray;
    quest.skip_hidden = skip_hidden;
    quest.world_count = hyk_trees[HYK_TREE_WORLD].meshes;
    bool done = HYK_HAS(hyk_features, HYK_NEEDS_INSTANCES) ? hyk_walk_top(quest, best) : hyk_walk_single(quest, best);
    if (best.instance != HYK_NONE) hyk_locate(quest.world_count, best.instance, best.primitive);
    if (HYK_HAS(hyk_features, HYK_NEEDS_SHAPES) && !done) hyk_walk_shapes(quest, best);
    return best;
}
