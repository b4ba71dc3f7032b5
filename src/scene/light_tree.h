/* >>scene-light-tree: the tree over the finite lights

   Conty Estevez & Kulla 2018: top-down, split where the surface area orientation heuristic is least, over
   bins of the lights' middles along each axis. Two things differ. A node is weighed by the lights' largest
   intensity, not their flux: that is what a point facing them gets, so narrow spots are not undervalued. And
   while bins are compared the spread of normals is measured by the length of their mean (a cap of half angle
   t has a mean of length (1 + cos t) / 2), which adds up without trigonometry; the cones stored in the nodes
   are true bounds, joined bottom-up. */
#ifndef HYI_LIGHT_TREE_H
#define HYI_LIGHT_TREE_H

#include "../base/context.h"
#include "../../shaders/shared/light_layouts.h"

#define HYI_LIGHT_BINS 16u

HYI_INLINE double hyi_light_luminance(hyk_vec3 c) { return 0.2126 * (double)c.x + 0.7152 * (double)c.y + 0.0722 * (double)c.z; }

/* Largest luminous intensity, W/sr weighed by luminance, that the light sends in any direction. */
HYI_FN double hyi_light_intensity(const hyk_light *light) {
    double luminance = hyi_light_luminance(light->radiance);
    switch (light->kind) {
    case HYK_LIGHT_POINT:
    case HYK_LIGHT_SPOT: return luminance;
    case HYK_LIGHT_SPHERE: return luminance * HYI_PI * (double)light->radius * (double)light->radius;
    default: return luminance * (double)light->area;
    }
}

/* ---- one light's bounds */

typedef struct hyi_light_item {
    float lower[3], upper[3];
    float axis[3];     /* zero: sends into all directions alike, or to both sides */
    float intensity;
    uint32_t light;
} hyi_light_item;

HYI_INLINE void hyi_light_item_grow(hyi_light_item *item, float x, float y, float z) {
    const float p[3] = {x, y, z};
    for (int k = 0; k < 3; k++) {
        if (p[k] < item->lower[k]) item->lower[k] = p[k];
        if (p[k] > item->upper[k]) item->upper[k] = p[k];
    }
}

/* The point of the light's middle plus or minus reach along each axis. */
HYI_FN void hyi_light_item_reach(hyi_light_item *item, const hyk_light *light, float x, float y, float z) {
    hyi_light_item_grow(item, light->position.x - x, light->position.y - y, light->position.z - z);
    hyi_light_item_grow(item, light->position.x + x, light->position.y + y, light->position.z + z);
}

HYI_INLINE float hyi_disc_reach(float radius, float normal) { return radius * sqrtf(fmaxf(1.0f - normal * normal, 0.0f)); }

HYI_FN void hyi_light_item_box(hyi_light_item *item, const hyk_light *light) {
    hyk_vec3 p = light->position, u = light->axis_u, v = light->axis_v, n = light->normal;
    float r = light->radius;
    item->lower[0] = item->upper[0] = p.x;
    item->lower[1] = item->upper[1] = p.y;
    item->lower[2] = item->upper[2] = p.z;
    if (light->kind == HYK_LIGHT_RECT)
        hyi_light_item_reach(item, light, fabsf(u.x) + fabsf(v.x), fabsf(u.y) + fabsf(v.y), fabsf(u.z) + fabsf(v.z));
    if (light->kind == HYK_LIGHT_DISC) hyi_light_item_reach(item, light, hyi_disc_reach(r, n.x), hyi_disc_reach(r, n.y), hyi_disc_reach(r, n.z));
    if (light->kind == HYK_LIGHT_SPHERE) hyi_light_item_reach(item, light, r, r, r);
    if (light->kind == HYK_LIGHT_TRIANGLE) {
        hyi_light_item_grow(item, p.x + u.x, p.y + u.y, p.z + u.z);
        hyi_light_item_grow(item, p.x + v.x, p.y + v.y, p.z + v.z);
    }
}

HYI_INLINE bool hyi_light_has_axis(const hyk_light *light) { return light->kind != HYK_LIGHT_POINT && light->kind != HYK_LIGHT_SPHERE; }

HYI_FN void hyi_light_item_fill(hyi_light_item *item, const hyk_light *light, uint32_t index) {
    bool axis = hyi_light_has_axis(light) && !(light->flags & HYK_LIGHT_BOTH_SIDES);
    double intensity = hyi_light_intensity(light);
    item->light = index;
    item->intensity = intensity < 1e36 ? (float)intensity : 1e36f;
    item->axis[0] = axis ? light->normal.x : 0.0f;
    item->axis[1] = axis ? light->normal.y : 0.0f;
    item->axis[2] = axis ? light->normal.z : 0.0f;
    hyi_light_item_box(item, light);
}

/* ---- cones of directions */

typedef struct hyi_light_cone {
    double axis[3];
    double spread, emission; /* angles: of the normals around the axis, of emission around a normal */
    bool both_sides;
} hyi_light_cone;

HYI_FN hyi_light_cone hyi_cone_of_light(const hyk_light *light) {
    hyi_light_cone cone;
    cone.axis[0] = (double)light->normal.x;
    cone.axis[1] = (double)light->normal.y;
    cone.axis[2] = (double)light->normal.z;
    cone.spread = 0.0;
    cone.emission = 0.5 * HYI_PI;
    cone.both_sides = (light->flags & HYK_LIGHT_BOTH_SIDES) != 0 && hyi_light_has_axis(light);
    if (!hyi_light_has_axis(light)) {
        cone.axis[0] = cone.axis[1] = 0.0;
        cone.axis[2] = 1.0;
        cone.spread = HYI_PI;
    }
    if (light->kind == HYK_LIGHT_SPOT) { /* its flat beam is no cosine: the bound stays above cos 1.3 inside the beam */
        double outer = acos(fmin(fmax((double)light->cos_outer, -1.0), 1.0));
        cone.emission = fmin(outer, 1.3);
        cone.spread = outer - cone.emission;
    }
    return cone;
}

HYI_INLINE double hyi_dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

HYI_FN hyi_light_cone hyi_cone_everywhere(hyi_light_cone a, double emission) {
    a.spread = HYI_PI;
    a.emission = emission;
    return a;
}

/* a's axis turned by an angle towards b. */
HYI_FN void hyi_cone_turn(hyi_light_cone *a, const double *b, double angle) {
    double along = hyi_dot3(a->axis, b), side[3], length;
    for (int k = 0; k < 3; k++) side[k] = b[k] - along * a->axis[k];
    length = sqrt(hyi_dot3(side, side));
    if (!(length > 0.0)) return;
    for (int k = 0; k < 3; k++) a->axis[k] = cos(angle) * a->axis[k] + sin(angle) * side[k] / length;
    length = sqrt(hyi_dot3(a->axis, a->axis));
    for (int k = 0; k < 3; k++) a->axis[k] /= length;
}

/* The narrowest cone around two. Where light leaves to both sides an axis and its opposite mean the same. */
HYI_FN hyi_light_cone hyi_cone_join(hyi_light_cone a, hyi_light_cone b) {
    double emission = fmax(a.emission, b.emission);
    if (a.spread < b.spread) {
        hyi_light_cone swap = a;
        a = b;
        b = swap;
    }
    a.both_sides = a.both_sides || b.both_sides;
    if (a.both_sides && hyi_dot3(a.axis, b.axis) < 0.0)
        for (int k = 0; k < 3; k++) b.axis[k] = -b.axis[k];
    double cross[3] = {a.axis[1] * b.axis[2] - a.axis[2] * b.axis[1], a.axis[2] * b.axis[0] - a.axis[0] * b.axis[2],
                       a.axis[0] * b.axis[1] - a.axis[1] * b.axis[0]};
    double between = atan2(sqrt(hyi_dot3(cross, cross)), hyi_dot3(a.axis, b.axis));
    a.emission = emission;
    if (fmin(between + b.spread, HYI_PI) <= a.spread) return a;
    double spread = 0.5 * (a.spread + between + b.spread);
    if (spread >= HYI_PI || between >= HYI_PI - 1e-9) return hyi_cone_everywhere(a, emission);
    hyi_cone_turn(&a, b.axis, spread - a.spread);
    a.spread = spread;
    return a;
}

/* ---- splitting */

typedef struct hyi_light_bin {
    float lower[3], upper[3];
    double axis[3], intensity;
    uint32_t count;
} hyi_light_bin;

HYI_FN void hyi_light_bin_clear(hyi_light_bin *bin) {
    memset(bin, 0, sizeof *bin);
    for (int k = 0; k < 3; k++) {
        bin->lower[k] = FLT_MAX;
        bin->upper[k] = -FLT_MAX;
    }
}

HYI_INLINE void hyi_light_bin_box(hyi_light_bin *bin, const float *lower, const float *upper) {
    for (int k = 0; k < 3; k++) {
        if (lower[k] < bin->lower[k]) bin->lower[k] = lower[k];
        if (upper[k] > bin->upper[k]) bin->upper[k] = upper[k];
    }
}

HYI_INLINE void hyi_light_bin_add(hyi_light_bin *bin, const hyi_light_item *item) {
    hyi_light_bin_box(bin, item->lower, item->upper);
    for (int k = 0; k < 3; k++) bin->axis[k] += (double)item->intensity * (double)item->axis[k];
    bin->intensity += (double)item->intensity;
    bin->count++;
}

HYI_FN void hyi_light_bin_join(hyi_light_bin *bin, const hyi_light_bin *other) {
    if (other->count == 0) return;
    hyi_light_bin_box(bin, other->lower, other->upper);
    for (int k = 0; k < 3; k++) bin->axis[k] += other->axis[k];
    bin->intensity += other->intensity;
    bin->count += other->count;
}

/* Intensity x extent^2 x solid angle lit, the last from pi (one normal) to 4 pi (all directions). The extent
   is the bounding sphere's, which is what sampling sees; unlike an area it is not zero for lights in a line. */
HYI_FN double hyi_light_bin_cost(const hyi_light_bin *bin) {
    if (bin->count == 0 || !(bin->intensity > 0.0)) return 0.0;
    double extent = 0.0, mean = hyi_dot3(bin->axis, bin->axis) / (bin->intensity * bin->intensity);
    for (int k = 0; k < 3; k++) {
        double side = (double)bin->upper[k] - (double)bin->lower[k];
        extent += side * side;
    }
    return bin->intensity * extent * (4.0 - 3.0 * fmin(mean, 1.0));
}

/* The items in work and where they come out. */
typedef struct hyi_light_build {
    hyk_light *lights;
    hyk_light_node *nodes;
    hyi_light_item *items;
    uint32_t used;
} hyi_light_build;

typedef struct hyi_light_split {
    double cost;
    int axis;      /* -1: none */
    uint32_t bin;  /* first of the upper half */
    float lower, scale;
} hyi_light_split;

HYI_INLINE float hyi_light_middle(const hyi_light_item *item, int axis) { return 0.5f * item->lower[axis] + 0.5f * item->upper[axis]; }

HYI_INLINE uint32_t hyi_light_bin_of(float middle, float lower, float scale) {
    float x = (middle - lower) * scale;
    if (!(x > 0.0f)) return 0;
    return x < (float)HYI_LIGHT_BINS ? (uint32_t)x : HYI_LIGHT_BINS - 1;
}

/* Sweeps the borders between bins. largest: more than that many lights may not go to one side. */
HYI_FN void hyi_light_sweep(const hyi_light_bin *bins, uint32_t largest, double stretch, hyi_light_split *best, const hyi_light_split *candidate) {
    double below_cost[HYI_LIGHT_BINS];
    uint32_t below_count[HYI_LIGHT_BINS];
    hyi_light_bin sum;
    hyi_light_bin_clear(&sum);
    for (uint32_t i = 0; i + 1 < HYI_LIGHT_BINS; i++) {
        hyi_light_bin_join(&sum, &bins[i]);
        below_cost[i + 1] = hyi_light_bin_cost(&sum);
        below_count[i + 1] = sum.count;
    }
    hyi_light_bin_clear(&sum);
    for (uint32_t i = HYI_LIGHT_BINS - 1; i > 0; i--) {
        hyi_light_bin_join(&sum, &bins[i]);
        if (sum.count == 0 || below_count[i] == 0 || sum.count > largest || below_count[i] > largest) continue;
        double cost = stretch * (below_cost[i] + hyi_light_bin_cost(&sum));
        if (best->axis >= 0 && cost >= best->cost) continue;
        *best = *candidate;
        best->cost = cost;
        best->bin = i;
    }
}

HYI_FN void hyi_light_bounds_of_middles(const hyi_light_item *items, uint32_t count, float *lower, float *upper) {
    for (int k = 0; k < 3; k++) lower[k] = upper[k] = hyi_light_middle(items, k);
    for (uint32_t i = 1; i < count; i++)
        for (int k = 0; k < 3; k++) {
            float x = hyi_light_middle(&items[i], k);
            if (x < lower[k]) lower[k] = x;
            if (x > upper[k]) upper[k] = x;
        }
}

/* Thin nodes are split across first: the regulariser k_r of the paper. */
HYI_FN hyi_light_split hyi_light_find_split(const hyi_light_item *items, uint32_t count, uint32_t largest) {
    float lower[3], upper[3], longest = 0.0f;
    hyi_light_split best, candidate;
    hyi_light_bin bins[3][HYI_LIGHT_BINS];
    memset(&best, 0, sizeof best);
    best.axis = -1;
    hyi_light_bounds_of_middles(items, count, lower, upper);
    for (int k = 0; k < 3; k++) {
        longest = fmaxf(longest, upper[k] - lower[k]);
        for (uint32_t i = 0; i < HYI_LIGHT_BINS; i++) hyi_light_bin_clear(&bins[k][i]);
    }
    float scale[3];
    for (int k = 0; k < 3; k++) scale[k] = upper[k] > lower[k] ? fminf((float)HYI_LIGHT_BINS / (upper[k] - lower[k]), FLT_MAX) : 0.0f;
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            if (scale[k] > 0.0f) hyi_light_bin_add(&bins[k][hyi_light_bin_of(hyi_light_middle(&items[i], k), lower[k], scale[k])], &items[i]);
    for (int k = 0; k < 3; k++) {
        if (!(scale[k] > 0.0f)) continue;
        memset(&candidate, 0, sizeof candidate);
        candidate.axis = k;
        candidate.lower = lower[k];
        candidate.scale = scale[k];
        hyi_light_sweep(bins[k], largest, (double)longest / ((double)upper[k] - (double)lower[k]), &best, &candidate);
    }
    return best;
}

/* Moves the lower half to the front, stably enough to be deterministic; returns its size. */
HYI_FN uint32_t hyi_light_partition(hyi_light_item *items, uint32_t count, const hyi_light_split *split) {
    uint32_t front = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (hyi_light_bin_of(hyi_light_middle(&items[i], split->axis), split->lower, split->scale) >= split->bin) continue;
        hyi_light_item swap = items[front];
        items[front] = items[i];
        items[i] = swap;
        front++;
    }
    return front;
}

HYI_FN uint32_t hyi_light_divide(hyi_light_item *items, uint32_t count, uint32_t depth) {
    uint32_t levels_left = HYK_LIGHT_TREE_DEPTH - depth - 1; /* below a child */
    uint32_t largest = levels_left >= 31 ? 0x7fffffffu : 1u << levels_left;
    if (count == 2) return 1;
    hyi_light_split split = hyi_light_find_split(items, count, largest);
    return split.axis < 0 ? count / 2 : hyi_light_partition(items, count, &split);
}

/* ---- nodes */

HYI_FN void hyi_light_node_cone(hyk_light_node *node, const hyi_light_cone *cone) {
    /* rounded outwards; a single orientation stays one, which sampling makes use of */
    double spread = cone->spread > 0.0 ? fmin(cone->spread + 1e-6, HYI_PI) : 0.0;
    node->axis.x = (float)cone->axis[0];
    node->axis.y = (float)cone->axis[1];
    node->axis.z = (float)cone->axis[2];
    node->cos_o = cone->spread >= HYI_PI ? -1.0f : fminf((float)cos(spread), spread > 0.0 ? 1.0f - FLT_EPSILON : 1.0f);
    node->cos_e = cone->emission >= 0.5 * HYI_PI ? 0.0f : (float)cos(cone->emission);
    node->both_sides = cone->both_sides ? 1u : 0u;
}

HYI_FN hyi_light_cone hyi_light_make_leaf(hyi_light_build *build, uint32_t at, const hyi_light_item *item, uint32_t path) {
    hyk_light_node *node = &build->nodes[at];
    hyi_light_cone cone = hyi_cone_of_light(&build->lights[item->light]);
    build->lights[item->light].tree_path = path;
    memset(node, 0, sizeof *node);
    node->lower.x = item->lower[0], node->lower.y = item->lower[1], node->lower.z = item->lower[2];
    node->upper.x = item->upper[0], node->upper.y = item->upper[1], node->upper.z = item->upper[2];
    node->intensity = item->intensity;
    node->child = item->light;
    node->is_leaf = 1;
    hyi_light_node_cone(node, &cone);
    return cone;
}

HYI_FN hyi_light_cone hyi_light_make_node(hyi_light_build *build, hyi_light_item *items, uint32_t count, uint32_t depth, uint32_t path) {
    uint32_t at = build->used++;
    if (count == 1) return hyi_light_make_leaf(build, at, items, path);
    uint32_t half = hyi_light_divide(items, count, depth);
    hyi_light_cone first = hyi_light_make_node(build, items, half, depth + 1, path);
    uint32_t second_at = build->used;
    hyi_light_cone second = hyi_light_make_node(build, items + half, count - half, depth + 1, path | 1u << depth);
    hyi_light_cone cone = hyi_cone_join(first, second);
    const hyk_light_node *a = &build->nodes[at + 1], *b = &build->nodes[second_at];
    hyk_light_node *node = &build->nodes[at];
    memset(node, 0, sizeof *node);
    node->lower.x = fminf(a->lower.x, b->lower.x), node->upper.x = fmaxf(a->upper.x, b->upper.x);
    node->lower.y = fminf(a->lower.y, b->lower.y), node->upper.y = fmaxf(a->upper.y, b->upper.y);
    node->lower.z = fminf(a->lower.z, b->lower.z), node->upper.z = fmaxf(a->upper.z, b->upper.z);
    node->intensity = fminf(a->intensity + b->intensity, 1e36f);
    node->child = second_at;
    hyi_light_node_cone(node, &cone);
    return cone;
}

/* Builds the tree over lights[0, finite_count) and writes their tree_path. *nodes gets *node_count =
   2 finite_count - 1 nodes (NULL and 0 without lights); free with hyi_free_array. The same lights give the
   same tree, whatever the threads. */
HYI_FN hydra_result hyi_light_tree_build(hydra_context *context, hyk_light *lights, uint32_t finite_count, hyk_light_node **nodes,
                                         uint32_t *node_count) {
    *nodes = NULL;
    *node_count = 0;
    if (finite_count == 0) return HYDRA_OK;
    if (finite_count > 0x7fffffffu) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u lights", finite_count);
    hyi_light_build build;
    memset(&build, 0, sizeof build);
    build.lights = lights;
    HYI_TRY(hyi_alloc_array(context, &build.items, finite_count));
    hydra_result result = hyi_alloc_array(context, &build.nodes, 2 * (size_t)finite_count - 1);
    if (result == HYDRA_OK) {
        for (uint32_t i = 0; i < finite_count; i++) hyi_light_item_fill(&build.items[i], &lights[i], i);
        hyi_light_make_node(&build, build.items, finite_count, 0, 0);
        *nodes = build.nodes;
        *node_count = build.used;
    }
    hyi_free_array(context, &build.items, finite_count);
    return result;
}

#endif /* HYI_LIGHT_TREE_H */
