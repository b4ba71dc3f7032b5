/* The truth about a ray, in double precision over a plain binary BVH, with an account of what single precision may get
   wrong: a ray that passes an edge, or an end of its interval, closer than rounding can tell may be answered either way.

   Coordinates are floats and exact here. What a float tracer must round are corners relative to the ray's origin, so the
   ray's distance from an edge is uncertain by some roundings of the largest of those (slack below), and the distance
   along the ray by as much again over the slope at which it meets the plane. */
#include "rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double roundings = 16.0 / 16777216.0; /* 16 units in the last place of a float, halved */

typedef struct node {
    float low[3], high[3];
    uint32_t first, count; /* a leaf's triangles; count 0: first is the left child, its sibling the next */
} node;

struct reference {
    const geometry *g;
    node *nodes;
    uint32_t *order;
    uint32_t used;
};

/* ---- building: halves of the space until a few are left */

typedef struct builder {
    reference *r;
    float (*middles)[3]; /* of triangles' boxes, twice */
} builder;

static void bound_node(const reference *r, node *n) {
    for (int k = 0; k < 3; k++) n->low[k] = INFINITY, n->high[k] = -INFINITY;
    for (uint32_t i = 0; i < 3 * n->count; i++) {
        const float *p = r->g->positions + 3 * (size_t)r->g->indices[3 * (size_t)r->order[n->first + i / 3] + i % 3];
        for (int k = 0; k < 3; k++) n->low[k] = fminf(n->low[k], p[k]), n->high[k] = fmaxf(n->high[k], p[k]);
    }
}

/* Those whose middle is below the middle of all middles, along the axis where these spread most. */
static uint32_t divide(const builder *b, const node *n) {
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    uint32_t *order = b->r->order + n->first, left = 0;
    for (uint32_t i = 0; i < n->count; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fminf(low[k], b->middles[order[i]][k]);
            high[k] = fmaxf(high[k], b->middles[order[i]][k]);
        }
    int axis = high[1] - low[1] > high[0] - low[0] ? 1 : 0;
    if (high[2] - low[2] > high[axis] - low[axis]) axis = 2;
    float middle = 0.5f * (low[axis] + high[axis]);
    for (uint32_t i = 0; i < n->count; i++)
        if (b->middles[order[i]][axis] < middle) {
            uint32_t moved = order[left];
            order[left++] = order[i], order[i] = moved;
        }
    return left && left < n->count ? left : n->count / 2;
}

static void build_node(builder *b, uint32_t at) {
    node *n = &b->r->nodes[at];
    bound_node(b->r, n);
    if (n->count <= 4) return;
    uint32_t left = divide(b, n), children = b->r->used;
    b->r->used += 2;
    b->r->nodes[children] = (node){.first = n->first, .count = left};
    b->r->nodes[children + 1] = (node){.first = n->first + left, .count = n->count - left};
    n->first = children, n->count = 0;
    build_node(b, children);
    build_node(b, children + 1);
}

reference *reference_build(const geometry *g) {
    reference *r = bench_alloc(sizeof *r);
    builder b = {r, bench_alloc(g->triangles * sizeof *b.middles)};
    r->g = g, r->used = 1;
    r->nodes = bench_alloc(2 * g->triangles * sizeof *r->nodes);
    r->order = bench_alloc(g->triangles * sizeof *r->order);
    for (size_t i = 0; i < g->triangles; i++) {
        const uint32_t *corner = g->indices + 3 * i;
        const float *p[3] = {g->positions + 3 * (size_t)corner[0], g->positions + 3 * (size_t)corner[1],
                             g->positions + 3 * (size_t)corner[2]};
        for (int k = 0; k < 3; k++) b.middles[i][k] = fminf(fminf(p[0][k], p[1][k]), p[2][k]) + fmaxf(fmaxf(p[0][k], p[1][k]), p[2][k]);
        r->order[i] = (uint32_t)i;
    }
    r->nodes[0] = (node){.first = 0, .count = (uint32_t)g->triangles};
    build_node(&b, 0);
    free(b.middles);
    return r;
}

void reference_free(reference *r) {
    if (!r) return;
    free(r->nodes);
    free(r->order);
    free(r);
}

/* ---- one triangle */

typedef struct meeting {
    double t, slack_t;    /* where the ray meets the plane, and how far off a float's answer may be */
    double margin, slack; /* how far inside the nearest edge the ray passes, and how much of that is uncertain */
} meeting;

static void cross(double out[3], const double a[3], const double b[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* false: no area, or seen exactly edge on. */
static bool meet(const reference *r, const hydra_ray *ray, uint32_t triangle, meeting *out) {
    double p[3][3], e[3][3], d[3] = {ray->direction[0], ray->direction[1], ray->direction[2]}, n[3], m[3], scale = 0.0;
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) {
            p[c][k] =
                (double)r->g->positions[3 * (size_t)r->g->indices[3 * (size_t)triangle + (size_t)c] + (size_t)k] - (double)ray->origin[k];
            scale = fmax(scale, fabs(p[c][k]));
        }
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) e[c][k] = p[(c + 1) % 3][k] - p[c][k];
    cross(n, e[0], e[1]);
    double slope = dot(n, d);
    if (slope == 0.0) return false;
    out->t = dot(p[0], n) / slope;
    out->slack_t = roundings * (scale * sqrt(dot(e[0], e[0]) * dot(e[1], e[1])) / fabs(slope) + fabs(out->t));
    out->slack = roundings * scale;
    out->margin = INFINITY;
    for (int c = 0; c < 3; c++) { /* distance of two lines, with the sign that says inside */
        cross(m, e[c], d);
        double side = dot(p[c], m) * (slope > 0.0 ? 1.0 : -1.0), length = sqrt(dot(m, m));
        out->margin = fmin(out->margin, length > 0.0 ? side / length : 0.0);
    }
    return true;
}

/* ---- one ray */

typedef struct findings {
    double strict, certain; /* nearest hit of exact arithmetic, and nearest that float arithmetic must not miss; or infinity */
    double certain_slack;
    bool possible; /* float arithmetic may find some hit */
} findings;

static bool box_met(const node *n, const hydra_ray *ray, double slack, double nearest) {
    double from = 0.0, to = nearest;
    for (int k = 0; k < 3; k++) {
        double o = ray->origin[k], d = ray->direction[k], low = (double)n->low[k] - slack - o, high = (double)n->high[k] + slack - o;
        if (d == 0.0) {
            if (low > 0.0 || high < 0.0) return false;
            continue;
        }
        double a = low / d, b = high / d;
        from = fmax(from, fmin(a, b));
        to = fmin(to, fmax(a, b));
    }
    return from <= to * (1.0 + 1e-6);
}

static void try_triangle(const reference *r, const hydra_ray *ray, uint32_t triangle, findings *f) {
    meeting m;
    if (!meet(r, ray, triangle, &m)) return;
    double t_min = ray->t_min, t_max = ray->t_max;
    if (m.margin >= -m.slack && m.t >= t_min - m.slack_t && m.t <= t_max + m.slack_t) f->possible = true;
    if (m.margin >= 0.0 && m.t >= t_min && m.t <= t_max && m.t < f->strict) f->strict = m.t;
    if (m.margin > m.slack && m.t > t_min + m.slack_t && m.t < t_max - m.slack_t && m.t + m.slack_t < f->certain + f->certain_slack)
        f->certain = m.t, f->certain_slack = m.slack_t;
}

static findings find(const reference *r, const hydra_ray *ray) {
    findings f = {INFINITY, INFINITY, 0.0, false};
    uint32_t stack[256], depth = 1;
    double slack = 0.0;
    for (int k = 0; k < 3; k++) /* box planes are as far off as corners of triangles */
        slack = fmax(slack, fmax(fabs((double)r->nodes[0].low[k] - ray->origin[k]), fabs((double)r->nodes[0].high[k] - ray->origin[k])));
    slack *= 2.0 * roundings;
    stack[0] = 0;
    while (depth) {
        const node *n = &r->nodes[stack[--depth]];
        if (!box_met(n, ray, slack, fmin((double)ray->t_max, f.certain + f.certain_slack))) continue;
        for (uint32_t i = 0; i < n->count; i++) try_triangle(r, ray, r->order[n->first + i], &f);
        if (n->count || depth + 2 > 256) continue;
        stack[depth++] = n->first;
        stack[depth++] = n->first + 1;
    }
    return f;
}

static verdict judge_hit(const reference *r, const hydra_ray *ray, answer given, const findings *f) {
    meeting m;
    if (given.primitive >= r->g->triangles || !meet(r, ray, given.primitive, &m)) return VERDICT_WRONG;
    double off = fabs((double)given.t - m.t);
    if (m.margin < -m.slack || off > m.slack_t) return VERDICT_WRONG;                      /* not where that triangle is */
    if ((double)given.t > f->certain + f->certain_slack + m.slack_t) return VERDICT_WRONG; /* behind one that is certainly hit */
    return fabs((double)given.t - f->strict) <= m.slack_t ? VERDICT_RIGHT : VERDICT_EDGE;
}

verdict reference_judge(const reference *r, const hydra_ray *ray, answer given, bool any) {
    findings f = find(r, ray);
    if (given.t < 0.0f) return f.certain < INFINITY ? VERDICT_WRONG : f.strict < INFINITY ? VERDICT_EDGE : VERDICT_RIGHT;
    if (!any) return judge_hit(r, ray, given, &f);
    return f.strict < INFINITY ? VERDICT_RIGHT : f.possible ? VERDICT_EDGE : VERDICT_WRONG;
}
