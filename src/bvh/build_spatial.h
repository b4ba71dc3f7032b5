/* >>bvh-build-spatial: spatial splits: parts of triangles on both sides of a plane

   Stich, Friedrich, Dietrich 2009, "Spatial splits in bounding volume hierarchies": a range may also be cut by a
   plane; triangles that cross it are referred to from both sides, each time with the box of the part that lies
   there. A reference may yet go to one side whole where that is cheaper (reference unsplitting).

   Every box of a part contains every point of the triangle that lies in its cell: what is computed is rounded
   outwards by a bound on its error, and cells share their planes. */
#ifndef HYI_BVH_BUILD_SPATIAL_H
#define HYI_BVH_BUILD_SPATIAL_H

#include "build_split.h"

#define HYI_SPATIAL_BINS 16u
#define HYI_SPATIAL_LEAST 64u                  /* smaller ranges are cut by objects alone */
#define HYI_SPATIAL_OVERLAP 2.0e-4f            /* of the root's surface: the least overlap that a spatial split may mend */
#define HYI_SPATIAL_GAIN 0.99f                 /* of the object split's cost: what the spatial one must stay below */
#define HYI_SPATIAL_SLOP 9.5367431640625e-07f  /* 2^-20 */
#define HYI_SPATIAL_TINY 1.0e-30f

/* Parts of triangles by bins between planes; a primitive counts where it begins and where it ends. */
typedef struct hyi_spatial_bins {
    hyi_bounds box[3][HYI_SPATIAL_BINS];
    uint32_t begins[3][HYI_SPATIAL_BINS], ends[3][HYI_SPATIAL_BINS];
} hyi_spatial_bins;

typedef struct hyi_grid {
    float plane[3][HYI_SPATIAL_BINS + 1u]; /* bin b lies between planes b and b + 1 */
    float scale[3];                        /* 0: no extent along that axis */
    uint32_t count;
    hyi_four origin, factor, shift;        /* for all axes: a cell's number and what is behind the point; 0.5 without extent */
} hyi_grid;

typedef struct hyi_corners {
    float at[3][4];
    hyi_four slop; /* more than the error of a point computed on an edge */
} hyi_corners;

/* The corners of a triangle in the units of the tree. A point of an edge is p + (q - p) t, t = (plane - p) / (q - p)
   along the axis: the roundings add up to less than 8 2^-24 (|p| + |q|), and what flushed denormals lose is less than
   HYI_SPATIAL_TINY. */
HYI_INLINE void hyi_load_corners(const hyi_build *build, uint32_t id, hyi_corners *corners) {
    hyi_four scale = hyi_four_all(build->scale), size = hyi_four_all(0.0f);
    for (uint32_t c = 0; c < 3; c++) {
        const float *p = hyi_source_corner(build, id, c);
        hyi_four corner = hyi_four_mul(hyi_four_make(p[0], p[1], p[2]), scale);
        hyi_four_store(corners->at[c], corner);
        size = hyi_four_max(size, hyi_four_abs(corner));
    }
    corners->slop = hyi_four_add(hyi_four_mul(size, hyi_four_all(HYI_SPATIAL_SLOP)), hyi_four_all(HYI_SPATIAL_TINY));
}

/* The half space on one side of a plane, as a box. */
HYI_INLINE hyi_four hyi_plane_lanes(int axis, float plane, float elsewhere) {
    return hyi_four_make(axis == 0 ? plane : elsewhere, axis == 1 ? plane : elsewhere, axis == 2 ? plane : elsewhere);
}

/* The box, which is that of a part of the triangle, cut by a plane: boxes of both parts. An empty one: no point of
   the triangle lies there. */
HYI_INLINE void hyi_clip(const hyi_corners *corners, const hyi_bounds *box, int axis, float plane, hyi_bounds *left, hyi_bounds *right) {
    *left = *right = hyi_bounds_empty();
    for (int c = 0; c < 3; c++) {
        const float *p = corners->at[c], *q = corners->at[c == 2 ? 0 : c + 1];
        hyi_four from = hyi_four_load(p);
        if (p[axis] <= plane) hyi_bounds_add(left, from, from);
        if (p[axis] >= plane) hyi_bounds_add(right, from, from);
        if (!((p[axis] < plane && q[axis] > plane) || (p[axis] > plane && q[axis] < plane))) continue;
        float along = q[axis] - p[axis];
        hyi_four step = hyi_four_sub(hyi_four_load(q), from);
        hyi_bounds point;
        if (fabsf(along) < HYI_SPATIAL_TINY) { /* too short to divide by: the whole edge */
            point.lower = hyi_four_min(from, hyi_four_load(q));
            point.upper = hyi_four_max(from, hyi_four_load(q));
        } else {
            hyi_four at = hyi_four_add(from, hyi_four_mul(step, hyi_four_all((plane - p[axis]) / along)));
            point.lower = hyi_four_sub(at, corners->slop);
            point.upper = hyi_four_add(at, corners->slop);
        }
        hyi_bounds_add(left, point.lower, point.upper);
        hyi_bounds_add(right, point.lower, point.upper);
    }
    hyi_bounds_meet(left, box);
    hyi_bounds_meet(right, box);
    left->upper = hyi_four_min(left->upper, hyi_plane_lanes(axis, plane, HYI_EMPTY_PLANE));
    right->lower = hyi_four_max(right->lower, hyi_plane_lanes(axis, plane, -HYI_EMPTY_PLANE));
}

/* ---- bins */

HYI_INLINE hyi_grid hyi_make_grid(const hyi_bounds *box, uint32_t count) {
    hyi_grid grid;
    float lower[3], upper[3], factor[4] = {0.0f, 0.0f, 0.0f, 0.0f}, shift[4] = {0.5f, 0.5f, 0.5f, 0.5f};
    hyi_bounds_store(box, lower, upper);
    grid.count = count < 256u ? HYI_SPATIAL_BINS / 2u : HYI_SPATIAL_BINS;
    for (int a = 0; a < 3; a++) {
        float extent = upper[a] - lower[a], size = fabsf(lower[a]) > fabsf(upper[a]) ? fabsf(lower[a]) : fabsf(upper[a]);
        /* cells must be wider than the slop */
        bool usable = extent > 1.0e-30f && extent > 1024.0f * HYI_SPATIAL_SLOP * size;
        grid.scale[a] = factor[a] = usable ? (float)grid.count / extent : 0.0f;
        if (usable) shift[a] = 0.0f;
        for (uint32_t b = 0; b <= grid.count; b++) {
            grid.plane[a][b] = hyi_rounded(lower[a] + hyi_rounded(extent * ((float)b / (float)grid.count)));
        }
    }
    grid.origin = hyi_four_make(lower[0], lower[1], lower[2]);
    grid.factor = hyi_four_load(factor);
    grid.shift = hyi_four_load(shift);
    return grid;
}

/* The bins in which a box begins and ends: decided by the planes themselves, for the partition compares with those. */
HYI_INLINE uint32_t hyi_grid_begin(const hyi_grid *grid, int axis, float lower) {
    int32_t last = (int32_t)grid->count - 1, bin = (int32_t)((lower - grid->plane[axis][0]) * grid->scale[axis]);
    bin = bin < last ? bin > 0 ? bin : 0 : last;
    while (bin > 0 && lower < grid->plane[axis][bin]) bin--;
    while (bin < last && lower >= grid->plane[axis][bin + 1]) bin++;
    return (uint32_t)bin;
}

HYI_INLINE uint32_t hyi_grid_end(const hyi_grid *grid, int axis, uint32_t begin, float upper) {
    int32_t last = (int32_t)grid->count - 1, bin = (int32_t)((upper - grid->plane[axis][0]) * grid->scale[axis]);
    bin = bin < last ? bin > (int32_t)begin ? bin : (int32_t)begin : last;
    while (bin > (int32_t)begin && upper <= grid->plane[axis][bin]) bin--;
    while (bin < last && upper > grid->plane[axis][bin + 1]) bin++;
    return (uint32_t)bin;
}

/* Both for all axes at once. false: it takes a look at the planes. Those are off their places by less than 2^-24 of the largest
   coordinate and of the extent, a number of a cell by 2^-22 of itself: where there is an extent, all of it comes to less than
   2^-9 of a cell. */
#define HYI_GRID_DOUBT 0.00390625f /* 2^-8 */
HYI_INLINE bool hyi_grid_bins(const hyi_grid *grid, const hyi_bounds *box, int32_t begin[4], int32_t end[4]) {
    const hyi_four least = hyi_four_all(HYI_GRID_DOUBT), most = hyi_four_all(1.0f - HYI_GRID_DOUBT);
    hyi_four low = hyi_four_add(hyi_four_mul(hyi_four_sub(box->lower, grid->origin), grid->factor), grid->shift);
    hyi_four high = hyi_four_add(hyi_four_mul(hyi_four_sub(box->upper, grid->origin), grid->factor), grid->shift);
    hyi_four low_rest = hyi_four_rest(low), high_rest = hyi_four_rest(high);
    uint32_t sure = hyi_four_greater(hyi_four_min(low_rest, high_rest), least) & hyi_four_greater(most, hyi_four_max(low_rest, high_rest));
    sure &= hyi_four_greater(hyi_four_all((float)grid->count), high);
    hyi_four_truncate(low, begin);
    hyi_four_truncate(high, end);
    return (sure & 7u) == 7u;
}

/* One loop for each array: of loops over several, gcc 12 at -O1 loses stores (its induction variables take the address
   of one array from that of another). */
HYI_FN void hyi_spatial_clear(hyi_spatial_bins *bins, const hyi_grid *grid) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < grid->count; b++) bins->box[a][b] = hyi_bounds_empty();
    }
    memset(bins->begins, 0, sizeof bins->begins);
    memset(bins->ends, 0, sizeof bins->ends);
}

/* Adds the parts of one triangle to the bins from begin to end. */
HYI_INLINE void hyi_spatial_chop(hyi_spatial_bins *bins, const hyi_grid *grid, const hyi_corners *corners, hyi_bounds rest, int axis,
                                 uint32_t begin, uint32_t end) {
    for (uint32_t b = begin; b < end; b++) {
        hyi_bounds left, right;
        hyi_clip(corners, &rest, axis, grid->plane[axis][b + 1u], &left, &right);
        if (!hyi_bounds_are_empty(&left)) hyi_bounds_add(&bins->box[axis][b], left.lower, left.upper);
        rest = right;
    }
    if (!hyi_bounds_are_empty(&rest)) hyi_bounds_add(&bins->box[axis][end], rest.lower, rest.upper);
}

HYI_FN void hyi_spatial_merge(hyi_spatial_bins *bins, const hyi_spatial_bins *more, const hyi_grid *grid) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < grid->count; b++) hyi_bounds_add(&bins->box[a][b], more->box[a][b].lower, more->box[a][b].upper);
        for (uint32_t b = 0; b < grid->count; b++) bins->begins[a][b] += more->begins[a][b];
        for (uint32_t b = 0; b < grid->count; b++) bins->ends[a][b] += more->ends[a][b];
    }
}

HYI_INLINE void hyi_spatial_add(hyi_spatial_bins *bins, const hyi_build *build, const hyi_grid *grid, const hyi_ref *ref) {
    hyi_bounds box = hyi_ref_box(ref);
    hyi_corners corners;
    int32_t begin[4], end[4];
    bool loaded = false, sure = hyi_grid_bins(grid, &box, begin, end);
    for (int a = 0; a < 3; a++) {
        if (!(grid->scale[a] > 0.0f)) continue;
        uint32_t first = (uint32_t)begin[a], last = (uint32_t)end[a];
        if (HYI_UNLIKELY(!sure)) {
            first = hyi_grid_begin(grid, a, ref->lower[a]);
            last = hyi_grid_end(grid, a, first, ref->upper[a]);
        }
        bins->begins[a][first]++;
        bins->ends[a][last]++;
        if (first == last) {
            hyi_bounds_add(&bins->box[a][first], box.lower, box.upper);
            continue;
        }
        if (!loaded) hyi_load_corners(build, hyi_ref_id(ref), &corners);
        loaded = true;
        hyi_spatial_chop(bins, grid, &corners, box, a, first, last);
    }
}

/* Every other one of many has its own bins: see hyi_bins_fill. */
HYI_FN void hyi_spatial_fill(hyi_spatial_bins *bins, const hyi_build *build, const hyi_grid *grid, const hyi_ref *refs, uint32_t count) {
    hyi_spatial_bins odd;
    uint32_t i = 0;
    hyi_spatial_clear(bins, grid);
    if (count >= HYI_BINS_PAIRED) {
        hyi_spatial_clear(&odd, grid);
        for (; i + 1u < count; i += 2u) {
            hyi_spatial_add(bins, build, grid, &refs[i]);
            hyi_spatial_add(&odd, build, grid, &refs[i + 1u]);
        }
        hyi_spatial_merge(bins, &odd, grid);
    }
    for (; i < count; i++) hyi_spatial_add(bins, build, grid, &refs[i]);
}

HYI_FN void hyi_spatial_best_on_axis(const hyi_spatial_bins *bins, const hyi_grid *grid, int axis, hyi_split *best) {
    hyi_bounds right[HYI_SPATIAL_BINS], box = hyi_bounds_empty();
    uint32_t right_count[HYI_SPATIAL_BINS], count = 0;
    for (uint32_t b = grid->count; b-- > 1u;) {
        hyi_bounds_add(&box, bins->box[axis][b].lower, bins->box[axis][b].upper);
        right[b] = box;
        right_count[b] = count += bins->ends[axis][b];
    }
    box = hyi_bounds_empty();
    count = 0;
    for (uint32_t b = 1; b < grid->count; b++) {
        hyi_bounds_add(&box, bins->box[axis][b - 1u].lower, bins->box[axis][b - 1u].upper);
        count += bins->begins[axis][b - 1u];
        if (count == 0 || right_count[b] == 0) continue;
        float cost = hyi_cut_cost(hyi_bounds_area(&box), count, hyi_bounds_area(&right[b]), right_count[b]);
        if (best->axis >= 0 && cost >= best->cost) continue;
        best->cost = cost;
        best->axis = axis;
        best->bin = b;
        best->plane = grid->plane[axis][b];
        best->left = box;
        best->right = right[b];
        best->left_count = count;
        best->right_count = right_count[b];
    }
}

HYI_FN hyi_split hyi_spatial_best(const hyi_spatial_bins *bins, const hyi_grid *grid) {
    hyi_split best;
    memset(&best, 0, sizeof best);
    best.axis = -1;
    best.spatial = true;
    for (int a = 0; a < 3; a++) {
        if (grid->scale[a] > 0.0f) hyi_spatial_best_on_axis(bins, grid, a, &best);
    }
    return best;
}

/* Whether to look for a spatial split: there is room, and the sides of the object split overlap by something. */
HYI_INLINE bool hyi_spatial_pays(const hyi_build *build, const hyi_range *range, const hyi_split *object) {
    if (!build->best || range->capacity == range->count || range->count < HYI_SPATIAL_LEAST) return false;
    if (object->axis < 0) return true;
    hyi_bounds overlap = object->left;
    hyi_bounds_meet(&overlap, &object->right);
    return hyi_bounds_area(&overlap) > HYI_SPATIAL_OVERLAP * build->root_area;
}

HYI_INLINE bool hyi_spatial_is_better(const hyi_split *spatial, const hyi_split *object) {
    if (spatial->axis < 0) return false;
    if (object->axis < 0) return true;
    return spatial->cost < HYI_SPATIAL_GAIN * object->cost;
}

/* ---- references */

/* Where a reference goes. */
typedef struct hyi_parts {
    bool left, right;
    hyi_bounds left_box, right_box;
} hyi_parts;

/* Splits a reference by a spatial split, or gives it whole to a side where both parts would cost more. */
HYI_INLINE void hyi_part_ref(const hyi_build *build, const hyi_split *split, const hyi_ref *ref, bool room, hyi_parts *parts) {
    hyi_bounds box = hyi_ref_box(ref);
    parts->left_box = parts->right_box = box;
    parts->right = ref->upper[split->axis] > split->plane || ref->lower[split->axis] >= split->plane;
    parts->left = ref->lower[split->axis] < split->plane;
    if (!(parts->left && parts->right)) return;
    hyi_corners corners;
    hyi_load_corners(build, hyi_ref_id(ref), &corners);
    hyi_clip(&corners, &box, split->axis, split->plane, &parts->left_box, &parts->right_box);
    bool no_left = hyi_bounds_are_empty(&parts->left_box), no_right = hyi_bounds_are_empty(&parts->right_box);
    if (no_left || no_right) {
        parts->left = no_right && !no_left;
        parts->right = !parts->left;
        if (no_left && no_right) parts->right_box = box;
        return;
    }
    float left_area = hyi_bounds_area(&split->left), right_area = hyi_bounds_area(&split->right);
    float lefts = (float)split->left_count, rights = (float)split->right_count;
    float both = left_area * lefts + right_area * rights;
    float to_left = hyi_bounds_area_with(&split->left, box.lower, box.upper) * lefts + right_area * (rights - 1.0f);
    float to_right = left_area * (lefts - 1.0f) + hyi_bounds_area_with(&split->right, box.lower, box.upper) * rights;
    if (room && both <= to_left && both <= to_right) return;
    parts->left = to_left <= to_right;
    parts->right = !parts->left;
    parts->left_box = parts->right_box = box;
}

#endif /* HYI_BVH_BUILD_SPATIAL_H */
