/* Answers held against the peer's, ray by ray, and against the reference. */
#include "rays.h"

#include <math.h>
#include <stdio.h>

enum { ULPS = 64, JUDGED = 20000 };

static struct {
    unsigned long rays, differ, ties, judged, wrong, edges, theirs_wrong; /* compared with the peer; judged by the reference */
} totals;

unsigned long compare_wrong(void) { return totals.wrong; }

void compare_end(void) {
    if (!totals.judged) return;
    printf(
        "answers: %lu compared with the peer's, %lu differ beyond %d ulp, %lu are other triangles at the same distance (shared edges, doubles)\n",
        totals.rays, totals.differ, ULPS, totals.ties);
    printf(
        "answers: %lu of hydra's judged by the double reference: %lu wrong, %lu at edges within rounding; of the peer's that differ %lu wrong\n",
        totals.judged, totals.wrong, totals.edges, totals.theirs_wrong);
}

void compare_sample(const char *scene, const ray_set *set, const answer *answers, const reference *truth) {
    size_t verdicts[3] = {0, 0, 0}, judged = set->count < JUDGED ? set->count : JUDGED;
    for (size_t i = 0; i < judged; i++) {
        size_t ray = i * set->count / judged;
        verdicts[reference_judge(truth, &set->rays[ray], answers[ray], set->any)]++;
    }
    totals.judged += judged, totals.wrong += verdicts[VERDICT_WRONG], totals.edges += verdicts[VERDICT_EDGE];
    if (verdicts[VERDICT_WRONG])
        printf("  %s %s: the double reference finds %zu of %zu answers of hydra's wrong\n", scene, kind_names[set->kind],
               verdicts[VERDICT_WRONG], judged);
}

typedef struct difference {
    size_t hit, distance, tie; /* one hits and one misses; other distances; same distance, another triangle */
    size_t judged, ours[3], theirs[3];
} difference;

/* The bound is of the larger of the distance and the origin's coordinates, from which distances are computed. */
static bool same_distance(const hydra_ray *ray, float a, float b) {
    const float *o = ray->origin, *d = ray->direction;
    float reach = fmaxf(fmaxf(fabsf(o[0]), fabsf(o[1])), fabsf(o[2])) / sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    return fabsf(a - b) <= ULPS * 0x1p-24f * fmaxf(fmaxf(fabsf(a), fabsf(b)), reach);
}

static bool differs(difference *sum, const ray_set *set, size_t i, answer a, answer b) {
    if ((a.t < 0.0f) != (b.t < 0.0f)) return sum->hit++, true;
    if (a.t < 0.0f || set->any) return false;
    if (!same_distance(&set->rays[i], a.t, b.t)) return sum->distance++, true;
    if (a.primitive != b.primitive) sum->tie++;
    return false;
}

static void print_example(const ray_set *set, size_t i, answer a, answer b) {
    const hydra_ray *r = &set->rays[i];
    printf("    wrong: ray %zu o %.9g %.9g %.9g d %.9g %.9g %.9g t %g..%g: hydra t %.9g triangle %u, peer t %.9g triangle %u\n", i,
           (double)r->origin[0], (double)r->origin[1], (double)r->origin[2], (double)r->direction[0], (double)r->direction[1],
           (double)r->direction[2], (double)r->t_min, (double)r->t_max, (double)a.t, a.primitive, (double)b.t, b.primitive);
}

void compare_answers(const char *scene, const ray_set *set, const answer *ours, const answer *theirs, const char *their_name,
                     const reference *truth) {
    difference sum = {.hit = 0};
    for (size_t i = 0; i < set->count; i++) {
        if (!differs(&sum, set, i, ours[i], theirs[i]) || sum.judged == JUDGED) continue;
        verdict us = reference_judge(truth, &set->rays[i], ours[i], set->any),
                them = reference_judge(truth, &set->rays[i], theirs[i], set->any);
        if (us == VERDICT_WRONG && sum.ours[us] < 3) print_example(set, i, ours[i], theirs[i]);
        sum.judged++, sum.ours[us]++, sum.theirs[them]++;
    }
    totals.rays += set->count, totals.differ += sum.hit + sum.distance, totals.ties += sum.tie, totals.judged += sum.judged;
    totals.wrong += sum.ours[VERDICT_WRONG], totals.edges += sum.ours[VERDICT_EDGE], totals.theirs_wrong += sum.theirs[VERDICT_WRONG];
    if (!sum.judged) return;
    printf("  %s %s, against %s: %zu of %zu differ (%zu hit or miss, %zu distance by over %d ulp)", scene, kind_names[set->kind],
           their_name, sum.hit + sum.distance, set->count, sum.hit, sum.distance, ULPS);
    if (sum.tie) printf(", %zu name another triangle at the same distance", sum.tie);
    printf("; right, edge, wrong: hydra %zu %zu %zu, peer %zu %zu %zu%s", sum.ours[0], sum.ours[1], sum.ours[2], sum.theirs[0],
           sum.theirs[1], sum.theirs[2], sum.judged == JUDGED ? " of those judged" : "");
    printf("\n");
}
