/* >>bvh-triangle: a ray made ready for one tree, and the watertight triangle test

   Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection", JCGT 2 (1). Corners are moved to the
   ray's origin and sheared so that the ray becomes the z axis; the signs of three edge functions decide.
   An edge shared by two triangles gets the same value with opposite sign in both, so a ray cannot pass
   between them.

   Here each vector unit only throws out triangles whose edge functions differ in sign in float: rounding
   is monotone, so a product difference of the wrong sign cannot come out, only zero. What remains is
   decided by hyi_confirm in double, where products of two floats are exact: signs are then exact for the
   sheared corners, and u, v keep their bits on needles. t comes from the plane of the unsheared corners: a
   ray that starts exactly in the plane of a triangle gets t 0, and one that starts off it by a rounding of
   float gets the right sign. A ray that passes beside a triangle by less than the sheared corners are rounded
   may count as a hit, and meets the plane away from the triangle, far away if it nearly runs in it. There t
   follows the edge functions instead (hyi_settle_distance): a hit lies on a part of its triangle, within what
   slabs are thicker by, and so in a leaf that holds that part, however the tree is walked. Every rounding
   is pinned, so no compiler flag or instruction set changes a bit.

   Of most triangles float can also tell that they are hit, and where about (hyi_judge_triangles): such a hit ends a ray that
   asks for any, and otherwise is put off, and worked out only if none that is certainly nearer comes after it. */
#ifndef HYI_BVH_TRIANGLE_H
#define HYI_BVH_TRIANGLE_H

#include "layout.h"
#include "../../shaders/shared/layouts.h"

#define HYI_FAR_AWAY 4611686018427387904.0f /* 2^62: a farther origin is moved to here */
#define HYI_SLAB_BOUND 9.5367431640625e-07f  /* 2^-20 */
#define HYI_ULP 1.1920928955078125e-07f      /* 2^-23 */
#define HYI_THICK 1024.0f                    /* so many times the bound of a ray that begins near by */
#define HYI_NEAR_BY 1099511627776.0f         /* 2^40: origins within it go as they are, many at a time */
#define HYI_SHORTEST 9.31322574615478515625e-10f /* 2^-30 */
#define HYI_LONGEST 1073741824.0f            /* 2^30: directions between these keep their length */
#define HYI_STEADY 8.67361737988403547e-19f  /* 2^-60: the smallest direction component */
#define HYI_T_LEAST 1.40129846432481707e-45  /* 2^-149: the smallest t above 0 */

/* Bounds of what float gets wrong: see hyi_judge_triangles. */
#define HYI_EDGE_NOISE 3.814697265625e-06f /* 2^-18 */
#define HYI_EDGE_LEAST 1.0e-30f
#define HYI_T_NOISE 9.5367431640625e-07f   /* 2^-20 */

#define HYI_PLANE_TRUST 4.76837158203125e-07 /* 2^-21: so little of t at a corner is within the slabs' bound */
#define HYI_SHEAR_NOISE 1.9073486328125e-06f /* 2^-19: more than a sheared corner is off by, of its distances on all axes */

/* Whether the compiler may give either of two zeros as the lesser of both. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#define HYI_ZEROS_ALIKE 1
#else
#define HYI_ZEROS_ALIKE 0
#endif

#define HYI_NO_HIT FLT_MAX                   /* a t beyond every limit */

/* A ray in the units of one tree. t here times unit is t of the ray. Planes are met at t = plane * inverse + offset. */
typedef struct hyi_aim {
    uint32_t near_plane[3];               /* where in hyi_node.planes that is which the ray meets first; the other is ^ HYI_WIDTH */
    float far_offset[3];                  /* of the origin moved by the error bound, as near_offset: slabs only get thicker */
    float inverse[3];                     /* of the direction; finite */
    float near_offset[3];
    float t_near, t_far;
    float inverse_z;                      /* t here by distance along z */
    float least_t;                        /* no less is t of the nearest hit so far, where unit is 1 */
    float origin[3], shear[2];            /* in the order of axis */
    uint32_t axis[3];                     /* x, y, z of the sheared frame; z is the direction's largest */
    float direction[3];                   /* in the order of axis */
    uint32_t leaf, lane;                  /* a triangle that is certainly hit before all others so far, but not worked out yet; leaf 0: none */
    uint32_t exact;                       /* 1: unit is not 1, and float tells nothing of triangles */
    float noise;                          /* more than sheared corners are off their places; 0: not known */
    uint32_t unused;                      /* fills the second cache line */
    double t_by_z;                        /* inverse_z unrounded */
    double unit, inverse_unit;
} hyi_aim;

/* A cache line for boxes, one for triangles, and what only a closer look needs. */
HYI_STATIC_ASSERT(offsetof(hyi_aim, least_t) == 60 && offsetof(hyi_aim, origin) == 64 && offsetof(hyi_aim, leaf) == 108 && offsetof(hyi_aim, t_by_z) == 128);

/* The axes of a sheared frame, and which bytes of four floats, x, y and z first, go there. */
typedef struct hyi_turn {
    uint32_t axis[4];
    uint8_t bytes[16];
} hyi_turn;

/* Where most rays begin, in a tree's units, and what bounds the errors of all that do: see hyi_aim_slabs. Of trees of triangles alone. */
typedef struct hyi_vicinity {
    float middle[4];    /* the last: of t_min, 0 */
    uint32_t radius[4]; /* bits of floats, as distances from middle are compared; the last: t_min is finite */
    float bound[4];     /* hyi_slab_bound */
    float noise;        /* hyi_aim.noise */
} hyi_vicinity;

/* What a triangle must beat, and the answer. */
typedef struct hyi_best {
    float t, u, v;
    uint32_t instance, primitive; /* HYK_NONE: t is t_max */
    uint32_t leaf, lane;          /* where its triangle lies in the tree that has it */
} hyi_best;

/* Of -0 too. */
HYI_INLINE bool hyi_has_sign(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & 0x80000000u) != 0u;
}

/* ---- aiming */

/* Moves a ray of any length into the units of the tree: directions far from 1 in size are scaled by a power
   of two, which t then carries. */
HYI_FN bool hyi_scale_ray(hyi_aim *aim, float scale, const float *origin, const float *direction, float *o, float *d) {
    float largest = 0.0f;
    for (int a = 0; a < 3; a++) {
        float size = fabsf(direction[a]);
        largest = size > largest ? size : largest;
        o[a] = origin[a] * scale;
        o[a] = o[a] < -HYI_FAR_AWAY ? -HYI_FAR_AWAY : o[a] > HYI_FAR_AWAY ? HYI_FAR_AWAY : o[a];
    }
    if (!(largest > 0.0f && largest <= FLT_MAX)) return false;
    double factor = (double)scale, size = (double)largest * factor;
    aim->unit = aim->inverse_unit = 1.0;
    aim->exact = 0;
    if (size < (double)HYI_SHORTEST || size > (double)HYI_LONGEST) {
        int exponent;
        (void)frexp(size, &exponent);
        aim->unit = ldexp(1.0, -exponent);
        aim->inverse_unit = ldexp(1.0, exponent);
        factor *= aim->unit;
        aim->exact = 1;
    }
    for (int a = 0; a < 3; a++) d[a] = (float)((double)direction[a] * factor);
    return true;
}

/* Largest distances from the origin to the box, along each axis. For a tree over instances the sizes of
   origin and box take their place: transforms round relative to these. */
HYI_INLINE float hyi_reach(const hyi_box *box, float origin, int axis, bool loose) {
    float below = fabsf(box->lower[axis] - origin), above = fabsf(box->upper[axis] - origin);
    if (loose) {
        below = 4.0f * (fabsf(box->lower[axis]) + fabsf(origin));
        above = 4.0f * (fabsf(box->upper[axis]) + fabsf(origin));
    }
    return below > above ? below : above;
}

/* Slabs. In 2^-24: a sheared corner is off by at most 2 of its distance across and 4 of that along the ray; t is off the mean
   that HYI_PLANE_TRUST compares it with by at most 8 of the latter; the slabs' own rounding takes 3 of the distance across and
   3 of the origin. 16 and 4 cover all, and make the moved origin really differ. A direction of (nearly) zero becomes 2^-60,
   whose slabs end beyond the reach of the others: they are never NaN, and an origin on a plane lies inside by the bound. */
HYI_INLINE float hyi_slab_bound(float reach, float along, float origin) {
    return HYI_SLAB_BOUND * (reach + along) + 2.0f * HYI_ULP * fabsf(origin);
}

/* A quarter of the tree's largest side beyond its box, along each axis. */
HYI_FN hyi_vicinity hyi_vicinity_of(const hyi_bvh *bvh) {
    const float slack = 1.0f + 16.0f * HYI_ULP; /* for what is rounded here, and in distances from middle */
    hyi_vicinity vicinity;
    float half[3], reach[3], radius[3], largest = 0.0f, farthest = 0.0f;
    memset(&vicinity, 0, sizeof vicinity);
    for (int a = 0; a < 3; a++) {
        vicinity.middle[a] = 0.5f * (bvh->scaled.lower[a] + bvh->scaled.upper[a]);
        half[a] = 0.5f * (bvh->scaled.upper[a] - bvh->scaled.lower[a]) + HYI_ULP * fabsf(vicinity.middle[a]);
        largest = half[a] > largest ? half[a] : largest;
    }
    for (int a = 0; a < 3; a++) {
        radius[a] = half[a] + 0.5f * largest;
        reach[a] = (half[a] + radius[a]) * slack;
        farthest = reach[a] > farthest ? reach[a] : farthest;
        vicinity.noise += HYI_SHEAR_NOISE * slack * reach[a];
    }
    for (int a = 0; a < 3; a++) vicinity.bound[a] = slack * hyi_slab_bound(reach[a], farthest, fabsf(vicinity.middle[a]) + radius[a] * slack);
    memcpy(vicinity.radius, radius, sizeof radius);
    vicinity.radius[3] = 0x7f7fffffu;
    return vicinity;
}

/* Bounds, by axis, that are no less than those which hyi_aim_slabs gave a ray. */
HYI_FN void hyi_cover_slabs(float most[3], const hyi_aim *aim, const hyi_box *box, bool loose) {
    float along = hyi_reach(box, aim->origin[2], (int)aim->axis[2], loose);
    for (int i = 0; i < 3; i++) {
        uint32_t a = aim->axis[i];
        float bound = hyi_slab_bound(hyi_reach(box, aim->origin[i], (int)a, loose), along, aim->origin[i]);
        most[a] = bound > most[a] ? bound : most[a];
    }
}

/* Whether slabs of these bounds are much thicker than those of rays that begin in the tree: rays from very far away are among those
   that they are for. */
HYI_FN bool hyi_slabs_are_thick(const hyi_box *box, const float bound[3]) {
    float largest = 0.0f;
    bool thick = false;
    for (int a = 0; a < 3; a++) largest = box->upper[a] - box->lower[a] > largest ? box->upper[a] - box->lower[a] : largest;
    for (int a = 0; a < 3; a++) {
        float size = fabsf(box->lower[a]) > fabsf(box->upper[a]) ? fabsf(box->lower[a]) : fabsf(box->upper[a]);
        thick = thick || bound[a] > HYI_THICK * hyi_slab_bound(largest, largest, size);
    }
    return thick;
}

HYI_FN void hyi_aim_slabs(hyi_aim *aim, const hyi_box *box, const float *o, const float *d, bool loose) {
    float along = hyi_reach(box, o[aim->axis[2]], (int)aim->axis[2], loose);
    aim->noise = 0.0f;
    for (int a = 0; a < 3; a++) {
        float reach = hyi_reach(box, o[a], a, loose), bound = hyi_slab_bound(reach, along, o[a]);
        aim->noise += HYI_SHEAR_NOISE * reach;
        float steady = fabsf(d[a]) >= HYI_STEADY ? d[a] : d[a] < 0.0f ? -HYI_STEADY : HYI_STEADY;
        bool falls = steady < 0.0f;
        aim->inverse[a] = 1.0f / steady;
        aim->near_offset[a] = -(falls ? o[a] - bound : o[a] + bound) * aim->inverse[a];
        aim->far_offset[a] = -(falls ? o[a] + bound : o[a] - bound) * aim->inverse[a];
        aim->near_plane[a] = HYI_WIDTH * (2u * (uint32_t)a + (falls ? 1u : 0u));
    }
}

/* From the direction in the order of axis. */
HYI_INLINE void hyi_aim_along(hyi_aim *aim) {
    aim->t_by_z = 1.0 / (double)aim->direction[2];
    aim->shear[0] = (float)((double)aim->direction[0] * aim->t_by_z);
    aim->shear[1] = (float)((double)aim->direction[1] * aim->t_by_z);
    aim->inverse_z = (float)aim->t_by_z;
}

HYI_FN void hyi_aim_shear(hyi_aim *aim, const float *o, const float *d) {
    uint32_t z = fabsf(d[0]) >= fabsf(d[1]) ? 0u : 1u;
    z = fabsf(d[2]) > fabsf(d[z]) ? 2u : z;
    aim->axis[0] = z == 2u ? 0u : z + 1u;
    aim->axis[1] = z == 0u ? 2u : z - 1u;
    aim->axis[2] = z;
    for (int a = 0; a < 3; a++) aim->origin[a] = o[aim->axis[a]];
    for (int a = 0; a < 3; a++) aim->direction[a] = d[aim->axis[a]];
    hyi_aim_along(aim);
}

/* A t of the ray in the tree's units, moved up or down by more than a t that is compared with it has been rounded by: that of
   a long direction may have underflowed. */
HYI_INLINE float hyi_aim_t(const hyi_aim *aim, float t, float sign) {
    if (!aim->exact) return t + sign * 4.0f * HYI_ULP * fabsf(t);
    double least = aim->inverse_unit > 1.0 ? (double)sign * HYI_T_LEAST : 0.0;
    float here = (float)(((double)t + least) * aim->inverse_unit);
    return here + sign * 4.0f * HYI_ULP * fabsf(here);
}

/* The farthest t worth visiting. */
HYI_INLINE void hyi_aim_limit(hyi_aim *aim, float t) { aim->t_far = hyi_aim_t(aim, t < FLT_MAX ? t : FLT_MAX, 1.0f); }

/* Makes a ray ready for a tree that is not empty; false: it has no direction and hits nothing. */
HYI_NOINLINE bool hyi_aim_at(hyi_aim *aim, const hyi_bvh *bvh, const float *origin, const float *direction,
                             float t_min, float t_max, bool loose) {
    float o[3], d[3];
    if (!hyi_scale_ray(aim, bvh->scale, origin, direction, o, d)) return false;
    hyi_aim_shear(aim, o, d);
    hyi_aim_slabs(aim, &bvh->scaled, o, d, loose);
    aim->t_near = hyi_aim_t(aim, t_min, -1.0f);
    hyi_aim_limit(aim, t_max);
    return true;
}

/* ---- the test */

/* One corner in the sheared frame: x and y. row: the first float of the corner's x in the leaf. */
HYI_INLINE void hyi_shear_corner(const hyi_aim *aim, const float *row, uint32_t stride, float *x, float *y) {
    float z = hyi_rounded(row[aim->axis[2] * stride] - aim->origin[2]);
    *x = hyi_rounded(hyi_rounded(row[aim->axis[0] * stride] - aim->origin[0]) - hyi_rounded(aim->shear[0] * z));
    *y = hyi_rounded(hyi_rounded(row[aim->axis[1] * stride] - aim->origin[1]) - hyi_rounded(aim->shear[1] * z));
}

HYI_INLINE double hyi_rounded_double(double value) {
#if HYI_GNU && defined(__x86_64__)
    __asm__("" : "+v"(value));
#elif HYI_GNU && defined(__aarch64__)
    __asm__("" : "+w"(value));
#endif
    return value;
}

/* p q - r s of floats: both products are exact, the difference is rounded once. */
HYI_INLINE double hyi_cross_exact(float p, float q, float r, float s) {
    return hyi_rounded_double((double)p * (double)q - (double)r * (double)s);
}

/* a p + b q + c r, in this order. */
HYI_INLINE double hyi_sum_products(double a, double p, double b, double q, double c, double r) {
    double first = hyi_rounded_double(hyi_rounded_double(a * p) + hyi_rounded_double(b * q));
    return hyi_rounded_double(first + hyi_rounded_double(c * r));
}

/* a p - b q of numbers that are not floats. */
HYI_INLINE double hyi_difference_of_products(double a, double p, double b, double q) {
    return hyi_rounded_double(hyi_rounded_double(a * p) - hyi_rounded_double(b * q));
}

/* Of the edges of a triangle. */
HYI_INLINE void hyi_normal(const double e[3], const double f[3], double n[3]) {
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* A triangle and its plane as a ray meets them, in the order of axis and the tree's units. */
typedef struct hyi_crossing {
    double a[3], e[3], f[3]; /* a corner from the ray's origin, and the edges that begin there */
    double n[3], across;     /* the normal, and the direction's part along it; 0: the ray runs in the plane */
    double t[3], least, most; /* at the corners */
    double plane;            /* t at the plane, but between least and most */
} hyi_crossing;

/* Corners' x, y, z lie stride floats apart. */
HYI_INLINE void hyi_cross_plane(const hyi_aim *aim, const float *rows, uint32_t stride, hyi_crossing *x) {
    for (int i = 0; i < 3; i++) {
        const float *row = rows + aim->axis[i] * stride;
        double corner = (double)row[0];
        x->a[i] = hyi_rounded_double(corner - (double)aim->origin[i]);
        x->e[i] = hyi_rounded_double((double)row[3u * stride] - corner);
        x->f[i] = hyi_rounded_double((double)row[6u * stride] - corner);
    }
    hyi_normal(x->e, x->f, x->n);
    const double d[3] = {(double)aim->direction[0], (double)aim->direction[1], (double)aim->direction[2]};
    x->across = hyi_sum_products(x->n[0], d[0], x->n[1], d[1], x->n[2], d[2]);
    if (x->across == 0.0) return;
    double plane = hyi_rounded_double(hyi_sum_products(x->n[0], x->a[0], x->n[1], x->a[1], x->n[2], x->a[2]) / x->across);
    x->least = x->most = x->t[0] = hyi_rounded_double(x->a[2] * aim->t_by_z);
    for (uint32_t k = 1; k < 3; k++) {
        double to_corner = hyi_rounded_double((double)rows[(aim->axis[2] + 3u * k) * stride] - (double)aim->origin[2]);
        double at = x->t[k] = hyi_rounded_double(to_corner * aim->t_by_z);
        x->least = at < x->least ? at : x->least;
        x->most = at > x->most ? at : x->most;
    }
    double within = x->least > plane ? x->least : plane;
    x->plane = x->most < within ? x->most : within;
    if (HYI_ZEROS_ALIKE && plane == 0.0 && x->plane == 0.0) x->plane = hyi_rounded_double(plane);
}

/* Whether t at the plane is so far beyond one of the limits that another t would be too: a mean of t at the corners by the edge
   functions is off that by no more than a sheared corner is off its place, times the slope of the plane. */
HYI_INLINE bool hyi_surely_beyond(const hyi_aim *aim, const hyi_crossing *x, float t_min, float t_max) {
    double plane = x->plane * aim->unit, beyond = plane > (double)t_max ? plane - (double)t_max : (double)t_min - plane;
    double noise = (double)aim->noise * (fabs(x->n[0]) + fabs(x->n[1]) + fabs(x->n[2]));
    return aim->noise > 0.0f && beyond * fabs(x->across) > noise * aim->unit;
}

/* t of a triangle that is hit, where that at its plane differs from the mean by its edge functions, total / sum: the plane's,
   if the ray meets that within the triangle, up to roundings of double. */
HYI_NOINLINE double hyi_settle_distance(const hyi_aim *aim, const float *rows, uint32_t stride, double total, double sum) {
    hyi_crossing x;
    double q[3], u[3], v[3];
    hyi_cross_plane(aim, rows, stride, &x);
    if (x.across == 0.0) return hyi_rounded_double(total / sum);
    for (int i = 0; i < 3; i++) q[i] = hyi_rounded_double(hyi_rounded_double(x.plane * (double)aim->direction[i]) - x.a[i]);
    hyi_normal(q, x.f, u);
    hyi_normal(x.e, q, v);
    double b = hyi_sum_products(u[0], x.n[0], u[1], x.n[1], u[2], x.n[2]);
    double c = hyi_sum_products(v[0], x.n[0], v[1], x.n[1], v[2], x.n[2]);
    bool inside = b >= 0.0 && c >= 0.0 && hyi_rounded_double(b + c) <= hyi_sum_products(x.n[0], x.n[0], x.n[1], x.n[1], x.n[2], x.n[2]);
    return inside ? x.plane : hyi_rounded_double(total / sum);
}

/* t of the ray (not of the tree's units) at triangle lane of a leaf, or HYI_NO_HIT where that is not within t_min and
   t_max; weights: u and v; n: the normal, in the order of axis. sheared: x of this corner and y, of the next and of the last in the
   sheared frame, eight floats apart, if they are known, or NULL. The plane comes first: most of the triangles that fail here lie behind a nearer hit. */
HYI_INLINE float hyi_confirm_sheared(const hyi_aim *aim, const float *rows, uint32_t stride, uint32_t lane, const float *sheared, float t_min, float t_max,
                                     float weights[2], double n[3]) {
    float hx[3], hy[3];
    hyi_crossing x;
    rows += lane;
    hyi_cross_plane(aim, rows, stride, &x);
    if (x.across == 0.0) return HYI_NO_HIT;
    float t = (float)hyi_rounded_double(x.plane * aim->unit);
    if (!(t >= t_min && t <= t_max) && hyi_surely_beyond(aim, &x, t_min, t_max)) return HYI_NO_HIT;
    for (uint32_t k = 0; k < 3; k++) {
        if (sheared) {
            hx[k] = sheared[16u * k];
            hy[k] = sheared[16u * k + 8u];
        } else {
            hyi_shear_corner(aim, rows + 3u * k * stride, stride, &hx[k], &hy[k]);
        }
    }
    const double w[3] = {hyi_cross_exact(hx[2], hy[1], hy[2], hx[1]), hyi_cross_exact(hx[0], hy[2], hy[0], hx[2]), hyi_cross_exact(hx[1], hy[0], hy[1], hx[0])};
    double sum = hyi_rounded_double(hyi_rounded_double(w[0] + w[1]) + w[2]);
    double least = w[0] < w[1] ? w[0] : w[1], most = w[0] > w[1] ? w[0] : w[1];
    least = w[2] < least ? w[2] : least;
    most = w[2] > most ? w[2] : most;
    if (((least < 0.0) & (most > 0.0)) || sum == 0.0) return HYI_NO_HIT; /* which side a triangle turns to a ray cannot be guessed */
    double inverse = hyi_rounded_double(1.0 / sum), total = hyi_sum_products(w[0], x.t[0], w[1], x.t[1], w[2], x.t[2]);
    double gap = hyi_rounded_double(hyi_rounded_double(x.plane * sum) - total);
    if (HYI_UNLIKELY(fabs(gap) > hyi_rounded_double(hyi_rounded_double(HYI_PLANE_TRUST * fabs(x.t[0])) * fabs(sum))))
        t = (float)hyi_rounded_double(hyi_settle_distance(aim, rows, stride, total, sum) * aim->unit);
    if (!(t >= t_min && t <= t_max)) return HYI_NO_HIT;
    weights[0] = (float)(w[1] * inverse);
    weights[1] = (float)(w[2] * inverse);
    for (int i = 0; i < 3; i++) n[i] = x.n[i];
    return t;
}

HYI_INLINE float hyi_confirm(const hyi_aim *aim, const float *rows, uint32_t stride, uint32_t lane, float t_min, float t_max, float weights[2],
                             double n[3]) {
    return hyi_confirm_sheared(aim, rows, stride, lane, NULL, t_min, t_max, weights, n);
}

/* Ties of equal t go to the smaller instance, then the smaller primitive; t_max itself counts as a hit. */
HYI_INLINE bool hyi_beats(const hyi_best *best, float t, uint32_t instance, uint32_t primitive) {
    if (t != best->t) return t < best->t;
    return instance != best->instance ? instance < best->instance : primitive < best->primitive;
}

#endif /* HYI_BVH_TRIANGLE_H */
