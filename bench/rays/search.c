/* Which of the peer's ways is fastest for a ray set: all are tried on a sample, the best few go on to the final. */
#include "rays.h"

#include <stdlib.h>

enum { FASTEST = 3 };

void search_variant(search *s, peer *p, int variant, const ray_set *sample) {
    for (int mode = 0; mode < PEER_MODES; mode++) {
        tracer t = peer_tracer(p, variant, mode, sample->any);
        double seconds[2];
        if (!t.trace) continue;
        time_alternating(&t, 1, sample, 1, 2, seconds);
        s->found[s->count++] = (candidate){variant, mode, t.robust, t.single, seconds[0] < seconds[1] ? seconds[0] : seconds[1]};
        t.empty(&t);
    }
}

static int by_seconds(const void *a, const void *b) {
    double x = ((const candidate *)a)->seconds, y = ((const candidate *)b)->seconds;
    return (x > y) - (x < y);
}

/* What has been passed over once is never chosen later: trying more variants only fills places from above. So the
   structure of a variant that is in no final can go. */
int search_finalists(const search *s, candidate finalists[MAX_FINALISTS]) {
    candidate sorted[PEER_VARIANTS * PEER_MODES];
    int count = 0;
    bool robust = false, single = false;
    for (int i = 0; i < s->count; i++) sorted[i] = s->found[i];
    qsort(sorted, (size_t)s->count, sizeof *sorted, by_seconds);
    for (int i = 0; i < s->count; i++) {
        const candidate *c = &sorted[i];
        if (i >= FASTEST && (robust || !c->robust) && (single || !c->single)) continue;
        finalists[count++] = *c;
        robust |= c->robust;
        single |= c->single;
    }
    return count;
}
