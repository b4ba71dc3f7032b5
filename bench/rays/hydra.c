/* hydra as a tracer: whole batches, and one ray a call. Public calls only. */
#define HYDRA_IMPLEMENTATION
#include "rays.h"

#include <stdlib.h>
#include <string.h>

typedef struct own_data {
    hydra_ray *rays;
    hydra_hit *hits;
    uint8_t *occluded;
    size_t count;
} own_data;

static void own_empty(tracer *t) {
    own_data *d = t->data;
    if (!d) return;
    free(d->rays);
    free(d->hits);
    free(d->occluded);
    free(d);
    t->data = NULL;
}

/* hydra leaves rays as they are, but both sides shall find memory in the same state: just written. */
static void own_fill(tracer *t, const ray_set *set) {
    own_data *d = t->data;
    if (d && d->count != set->count) own_empty(t), d = NULL;
    if (!d) {
        t->data = d = bench_alloc(sizeof *d);
        d->count = set->count;
        d->rays = bench_alloc(set->count * sizeof *d->rays);
        d->hits = bench_alloc(t->any ? 1 : set->count * sizeof *d->hits);
        d->occluded = bench_alloc(t->any ? set->count : 1);
    }
    memcpy(d->rays, set->rays, set->count * sizeof *d->rays);
    if (t->any)
        memset(d->occluded, 2, set->count);
    else
        memset(d->hits, 0, set->count * sizeof *d->hits);
}

static void own_trace(const tracer *t, size_t first, size_t count) {
    const own_data *d = t->data;
    const hydra_scene *scene = t->self;
    if (t->single && t->any) {
        for (size_t i = first; i < first + count; i++) hydra_scene_any_hits(scene, d->rays + i, d->occluded + i, 1);
    } else if (t->single) {
        for (size_t i = first; i < first + count; i++) hydra_scene_closest_hits(scene, d->rays + i, d->hits + i, 1);
    } else if (t->any) {
        hydra_scene_any_hits(scene, d->rays + first, d->occluded + first, count);
    } else {
        hydra_scene_closest_hits(scene, d->rays + first, d->hits + first, count);
    }
}

static void own_read(const tracer *t, answer *answers, size_t count) {
    const own_data *d = t->data;
    for (size_t i = 0; i < count; i++) {
        if (t->any)
            answers[i] = (answer){d->occluded[i] ? 0.0f : -1.0f, HYDRA_NONE};
        else
            answers[i] = (answer){d->hits[i].t, d->hits[i].primitive};
    }
}

tracer hydra_tracer(const hydra_scene *scene, bool any, bool single) {
    tracer t = {.robust = true, .single = single, .any = any, .self = (void *)scene};
    strcpy(t.name, single ? "hydra single" : "hydra batch");
    t.fill = own_fill, t.trace = own_trace, t.read = own_read, t.empty = own_empty;
    return t;
}
