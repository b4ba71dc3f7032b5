/* Rays a second through hydra_scene_closest_hits and hydra_scene_any_hits, the whole set in one call a thread. */
#include "bench.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_REPEATS = 64, MOST_THREADS = 64 };

typedef struct question {
    const ray_set *set;
    bool any;
    hydra_hit *hits, *true_hits; /* one of the kinds is used */
    uint8_t *occluded, *true_occluded;
} question;

typedef struct timing {
    double wall[MOST_REPEATS], processor[MOST_REPEATS], device[MOST_REPEATS]; /* seconds, of all rays once */
    int calls;                                                                /* that make one measurement */
    size_t other_ids, other_bits;                                             /* answers that differ from the truth */
} timing;

/* ---- one call */

typedef struct share {
    const side *on;
    const question *q;
    size_t first, count;
    pthread_barrier_t *start;
    hydra_result result;
} share;

static void *cast_share(void *argument) {
    share *s = argument;
    const hydra_ray *rays = s->q->set->rays + s->first;
    if (s->start) pthread_barrier_wait(s->start);
    if (s->q->any)
        s->result = hydra_scene_any_hits(s->on->scene, rays, s->q->occluded + s->first, s->count);
    else
        s->result = hydra_scene_closest_hits(s->on->scene, rays, s->q->hits + s->first, s->count);
    return NULL;
}

/* Wall time, since a device's work is not the calling thread's. On a device one thread calls: more would take turns. */
static double cast(const side *on, const question *q) {
    share shares[MOST_THREADS];
    pthread_t ids[MOST_THREADS];
    pthread_barrier_t start;
    unsigned threads = on->device_number ? 1 : on->threads;
    size_t step = (q->set->count / threads + SHARE_STEP - 1) / SHARE_STEP * SHARE_STEP;
    pthread_barrier_init(&start, NULL, threads);
    for (unsigned i = 0; i < threads; i++) {
        size_t first = i * step < q->set->count ? i * step : q->set->count;
        size_t end = i + 1 < threads && first + step < q->set->count ? first + step : q->set->count;
        shares[i] = (share){on, q, first, end - first, i ? &start : NULL, HYDRA_OK};
        if (i && pthread_create(&ids[i], NULL, cast_share, &shares[i])) bench_stop("pthread_create", "no thread");
    }
    if (threads > 1) pthread_barrier_wait(&start);
    double from = wall_seconds();
    cast_share(&shares[0]);
    for (unsigned i = 1; i < threads; i++) pthread_join(ids[i], NULL);
    double seconds = wall_seconds() - from;
    pthread_barrier_destroy(&start);
    for (unsigned i = 0; i < threads; i++)
        if (shares[i].result != HYDRA_OK) bench_stop(on->name, hydra_result_text(shares[i].result));
    return seconds;
}

/* ---- measuring */

/* The first call makes pipelines and finds the size of slices. */
static void warm_up(const options *o, const side *on, const question *q, timing *t) {
    cast(on, q);
    double seconds = cast(on, q);
    t->calls = seconds * 64.0 > o->least_seconds ? (int)(o->least_seconds / seconds) + 1 : 64;
    if (on->device_number) device_forget_slices(on->context);
}

static void measure(const side *on, const question *q, timing *t, int round) {
    double wall = 0.0, processor = processor_seconds(), device = side_busy_seconds(on);
    for (int i = 0; i < t->calls; i++) wall += cast(on, q);
    t->wall[round] = wall / t->calls;
    t->processor[round] = (processor_seconds() - processor) / t->calls;
    t->device[round] = (side_busy_seconds(on) - device) / t->calls;
}

static void take_truth(const sides *s, question *q) {
    cast(&s->list[s->truth], q);
    if (q->any)
        memcpy(q->true_occluded, q->occluded, q->set->count);
    else
        memcpy(q->true_hits, q->hits, q->set->count * sizeof *q->hits);
}

static void forget_answers(const question *q) {
    if (q->any)
        memset(q->occluded, 2, q->set->count);
    else
        memset(q->hits, 0xff, q->set->count * sizeof *q->hits);
}

static void judge(const question *q, timing *t) {
    t->other_ids = t->other_bits = 0;
    for (size_t i = 0; q->any && i < q->set->count; i++) t->other_ids += q->occluded[i] != q->true_occluded[i];
    for (size_t i = 0; !q->any && i < q->set->count; i++) {
        const hydra_hit *a = &q->hits[i], *b = &q->true_hits[i];
        t->other_ids += a->primitive != b->primitive || a->mesh != b->mesh || a->instance != b->instance || a->light != b->light;
        t->other_bits += memcmp(a, b, sizeof *a) != 0;
    }
    if (q->any) t->other_bits = t->other_ids;
}

static void time_sides(const options *o, sides *s, question *q, timing *timings) {
    take_truth(s, q);
    for (int i = 0; i < s->count; i++) {
        forget_answers(q);
        warm_up(o, &s->list[i], q, &timings[i]);
        judge(q, &timings[i]);
    }
    for (int r = 0; r < o->repeats; r++)
        for (int i = 0; i < s->count; i++) measure(&s->list[i], q, &timings[i], r);
}

/* ---- report */

typedef struct report {
    const options *o;
    const char *scene;
    const sides *s;
    FILE *csv;
    double copy_speed[MAX_SIDES];
    slices submitted[MAX_SIDES]; /* for the scene */
    size_t wrong;
} report;

/* Speed over that of the scalar side with as many threads: by wall time, or by processor time. */
static double over_scalar(const report *r, const timing *timings, int i, bool by_processor) {
    const side *peer = sides_scalar_peer(r->s, &r->s->list[i]);
    if (!peer) return NAN;
    const timing *theirs = &timings[peer - r->s->list], *ours = &timings[i];
    return by_processor ? median_ratio(theirs->processor, ours->processor, r->o->repeats)
                        : median_ratio(theirs->wall, ours->wall, r->o->repeats);
}

static void report_side(report *r, const question *q, const timing *timings, int i) {
    const side *on = &r->s->list[i];
    const timing *t = &timings[i];
    const char *kind = kind_names[q->set->kind], *hit = q->any ? "any" : "closest";
    int n = r->o->repeats;
    double mega = 1e-6 * (double)q->set->count, wall = median(t->wall, n), device = median(t->device, n),
           cores = median_ratio(t->processor, t->wall, n);
    double ratio = over_scalar(r, timings, i, false), by_processor = over_scalar(r, timings, i, true);
    printf("%-14s %-8s %-8s %-26s %9.3f", r->scene, kind, hit, on->name, mega / wall);
    if (on->device_number)
        printf(" %9.3f", mega / device);
    else
        printf(" %9s", "-");
    printf(" %6.2f %8.3f %8.3f %7zu %7zu\n", cores, ratio, by_processor, t->other_ids, t->other_bits);
    fprintf(r->csv, "%s,%s,%s,%s,%u,%zu,%g,%g,%g,%g,%g,%zu,%zu\n", r->scene, kind, hit, on->name, on->threads, q->set->count, mega / wall,
            on->device_number ? mega / device : 0.0, cores, ratio, by_processor, t->other_ids, t->other_bits);
    r->wrong += t->other_ids;
}

static void report_goals(const report *r, const question *q, const timing *timings) {
    for (int i = 0; i < r->s->count; i++) {
        const side *on = &r->s->list[i];
        char name[160];
        if (!on->lavapipe) continue;
        double ratio = over_scalar(r, timings, i, false);
        snprintf(name, sizeof name, "lavapipe-over-scalar-x%u-%s-%s-%s", on->threads, r->scene, kind_names[q->set->kind],
                 q->any ? "any" : "closest");
        if (ratio == ratio)
            goal(name, ratio, AT_LEAST, 1.0);
        else
            printf("no goal %s: there is no scalar side with as many threads\n", name);
    }
}

/* How far a device is from what its memory could give, if no cache held any of a scene's trees. */
static void report_memory(const report *r, const question *q, const timing *timings, const traffic *per_ray) {
    for (int i = 0; i < r->s->count; i++) {
        const side *on = &r->s->list[i];
        if (!on->device_number) continue;
        double rays = (double)q->set->count / median(timings[i].device, r->o->repeats), moved = rays * per_ray->bytes;
        printf(
            "memory: %s %s %s, %s: %.1f nodes, %.1f triangles, %.0f bytes a ray without caches; %.2f GB/s of %.1f when copying, %.1f %%\n",
            r->scene, kind_names[q->set->kind], q->any ? "any" : "closest", on->name, per_ray->nodes, per_ray->slots, per_ray->bytes,
            1e-9 * moved, 1e-9 * r->copy_speed[i], r->copy_speed[i] > 0.0 ? 100.0 * moved / r->copy_speed[i] : NAN);
    }
}

static void report_devices(const report *r) {
    for (int i = 0; i < r->s->count; i++) {
        const side *on = &r->s->list[i];
        hydra_vk_info info = side_info(on);
        if (!on->device_number) continue;
        device_bytes bytes = device_scene_bytes(on->scene);
        printf("device: %s, %s: scene %.2f MB (nodes %.2f, triangles of trees %.2f), memory taken %.1f MB, most %.1f; commit %.3f s; ",
               r->scene, on->name, 1e-6 * (double)bytes.all, 1e-6 * (double)bytes.nodes, 1e-6 * (double)bytes.slots,
               1e-6 * (double)info.bytes_now, 1e-6 * (double)info.bytes_peak, on->commit_seconds);
        slices_print(&r->submitted[i]);
    }
}

/* ---- scenes */

static void make_plain(hydra_scene *scene, const void *what) {
    const geometry *g = what;
    hydra_mesh_desc mesh = {.positions = {g->positions, 12, g->vertices}, .indices = {g->indices, 4, 3 * g->triangles}};
    hydra_scene_add_mesh(scene, &mesh);
}

static void ask(report *r, sides *s, const ray_set *set, bool any) {
    static timing timings[MAX_SIDES];
    question q = {.set = set, .any = any};
    if (any)
        q.occluded = bench_alloc(set->count), q.true_occluded = bench_alloc(set->count);
    else
        q.hits = bench_alloc(set->count * sizeof *q.hits), q.true_hits = bench_alloc(set->count * sizeof *q.hits);
    time_sides(r->o, s, &q, timings);
    for (int i = 0; i < s->count; i++) {
        slices_add(&r->submitted[i], &s->list[i]);
        report_side(r, &q, timings, i);
    }
    report_goals(r, &q, timings);
    ray_set sample = ray_set_sample(set, 16384);
    traffic per_ray = device_traffic(s->list[s->truth].scene, &sample, any);
    report_memory(r, &q, timings, &per_ray);
    ray_set_free(&sample);
    free(q.hits), free(q.true_hits), free(q.occluded), free(q.true_occluded);
}

static void run_scene(report *r, sides *s, const geometry *g, const char *name) {
    const int kinds[2] = {KIND_PRIMARY, KIND_BOUNCE1};
    ray_set sets[KIND_COUNT];
    r->scene = name;
    memset(r->submitted, 0, sizeof r->submitted);
    sides_open(s, make_plain, g, true);
    ray_sets_make(sets, g, s->list[s->truth].scene, r->o->width);
    printf("%s: %zu triangles, %zu primary rays, %zu diffuse\n", name, g->triangles, sets[KIND_PRIMARY].count, sets[KIND_BOUNCE1].count);
    printf("%-14s %-8s %-8s %-26s %9s %9s %6s %8s %8s %7s %7s\n", "scene", "rays", "hit", "side", "Mray/s", "dispatch", "cores", "x scalar",
           "by core", "ids !=", "bits !=");
    for (int k = 0; k < 2; k++)
        for (int any = 0; any < 2 && sets[kinds[k]].count; any++) ask(r, s, &sets[kinds[k]], any != 0);
    report_devices(r);
    for (int k = 0; k < KIND_COUNT; k++) ray_set_free(&sets[k]);
    sides_close(s);
}

void bench_rays(const options *o, sides *s) {
    static report r;
    const int generated[2] = {0, 3}; /* smooth, foliage */
    r.o = o, r.s = s, r.wrong = 0;
    r.csv = open_csv("vulkan_rays.csv",
                     "scene,rays,hit,side,threads,count,mrays,mrays_dispatch,cores,over_scalar,over_scalar_by_core,other_ids,other_bits");
    printf(
        "\nRays. dispatch: Mray/s of the device alone, without what goes up and down; cores: processors kept busy; x scalar: speed over\n"
        "the scalar traversal with as many threads (a GPU: with all); by core: the same by processor time, which other programs\n"
        "disturb less; then how many answers differ from %s's, in ids and in any bit\n",
        s->list[s->truth].name);
    for (int i = 0; i < s->count; i++) r.copy_speed[i] = s->list[i].device_number ? device_copy_speed(&s->list[i]) : 0.0;
    for (int i = 0; i < 2 + o->file_count; i++) {
        geometry g;
        if (i < 2)
            geometry_generate(&g, generated[i], o->triangles);
        else if (!geometry_read_obj(&g, o->files[i - 2]))
            bench_stop(o->files[i - 2], "no triangles could be read");
        run_scene(&r, s, &g, i < 2 ? scene_kinds[generated[i]] : g.name);
        geometry_free(&g);
    }
    fclose(r.csv);
    goal("rays-with-other-ids", (double)r.wrong, AT_MOST, 0.0);
}
