/* The sides of the comparison: which there are, and a scene on each. */
#include "bench.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { LAVAPIPE_MOST_THREADS = 16 }; /* Mesa's LP_MAX_THREADS */

static const char *isa_name(hydra_isa isa) {
    switch (isa) {
    case HYDRA_ISA_SSE42: return "SSE4.2";
    case HYDRA_ISA_AVX2: return "AVX2";
    case HYDRA_ISA_AVX512: return "AVX-512";
    case HYDRA_ISA_NEON: return "NEON";
    default: return "scalar";
    }
}

static void add_side(sides *s, side one) {
    if (s->count < MAX_SIDES) s->list[s->count++] = one;
}

static void add_processor(sides *s, hydra_isa isa, uint32_t threads) {
    side one = {.isa = isa, .threads = threads};
    snprintf(one.name, sizeof one.name, "%s x%u", isa_name(isa), threads);
    add_side(s, one);
}

static hydra_isa best_isa(void) {
    hydra_context *context = hydra_create(NULL);
    if (!context) bench_stop("hydra_create", "no context");
    hydra_isa isa = hydra_context_isa(context);
    hydra_destroy(context);
    return isa;
}

static uint32_t processors(void) {
    long count = sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1u : count > 64 ? 64u : (uint32_t)count;
}

/* How many threads lavapipe starts; 0 there means that the caller does the work. */
static uint32_t lavapipe_threads(void) {
    const char *asked = getenv("LP_NUM_THREADS");
    uint32_t count = asked ? (uint32_t)strtoul(asked, NULL, 10) : processors();
    return count < 1 ? 1u : count > LAVAPIPE_MOST_THREADS ? (uint32_t)LAVAPIPE_MOST_THREADS : count;
}

static void add_processors(sides *s, uint32_t lavapipe) {
    const uint32_t counts[4] = {1, 2, lavapipe, processors()};
    const hydra_isa isas[2] = {HYDRA_ISA_SCALAR, best_isa()};
    for (int i = 0; i < 2; i++) {
        if (i && isas[1] == HYDRA_ISA_SCALAR) {
            printf("this processor or build has no vector instructions that hydra uses: scalar only\n");
            break;
        }
        for (int c = 0; c < 4; c++) {
            bool there = counts[c] > processors();
            for (int past = 0; past < c; past++) there = there || counts[past] == counts[c];
            if (there) continue;
            if (c == 0) s->truth = s->count;
            add_processor(s, isas[i], counts[c]);
        }
    }
    if (processors() < 2) printf("this machine has one processor: nothing is timed with two threads\n");
}

static const char *type_name(hydra_vk_device_type type) {
    switch (type) {
    case HYDRA_VK_DEVICE_DISCRETE: return "discrete GPU";
    case HYDRA_VK_DEVICE_INTEGRATED: return "integrated GPU";
    case HYDRA_VK_DEVICE_VIRTUAL: return "virtual GPU";
    default: return "processor";
    }
}

static void add_device(sides *s, const hydra_vk_device_info *info, uint32_t number) {
    printf("device %u: %s, %s, Vulkan %u.%u, %.1f GiB, binds %.0f MiB", number, info->name, type_name(info->type),
           info->api_version >> 22 & 127u, info->api_version >> 12 & 1023u, (double)info->memory / (1 << 30),
           (double)info->binding_most / (1 << 20));
    if (info->lacks[0]) {
        printf(": left out, it lacks %s\n", info->lacks);
        return;
    }
    side one = {.device_number = number, .lavapipe = strstr(info->name, "llvmpipe") != NULL};
    if (one.lavapipe) one.threads = lavapipe_threads();
    int length = (int)strcspn(info->name, "(");
    while (length > 0 && info->name[length - 1] == ' ') length--;
    snprintf(one.name, sizeof one.name, "%u %.*s", number, length > 24 ? 24 : length, info->name);
    if (one.lavapipe) printf(", %u threads", one.threads);
    printf("\n");
    add_side(s, one);
}

/* What creating a context says tells a missing loader from one without drivers. */
static void say_why_none(void) {
    char why[256] = "";
    hydra_context *context = NULL;
    hydra_vk_desc vk = {.error = why, .error_size = sizeof why};
    if (hydra_vk_create(NULL, &vk, &context) == HYDRA_OK) hydra_destroy(context);
    printf("NO VULKAN on this machine (%s): no device is measured, and no goal that needs one\n", why);
}

void sides_find(sides *s) {
    hydra_vk_device_info infos[MAX_SIDES];
    uint32_t count = MAX_SIDES;
    memset(s, 0, sizeof *s);
    hydra_result result = hydra_vk_list_devices(NULL, infos, &count);
    add_processors(s, result == HYDRA_OK && count ? lavapipe_threads() : 1);
    if (result != HYDRA_OK) {
        say_why_none();
        return;
    }
    if (!count) printf("NO VULKAN DEVICE on this machine, though there is a loader: no device is measured, and no goal that needs one\n");
    for (uint32_t i = 0; i < count && i < MAX_SIDES; i++) add_device(s, &infos[i], i + 1);
    bool hardware = false;
    for (int i = 0; i < s->count; i++) hardware = hardware || (s->list[i].device_number && !s->list[i].lavapipe);
    if (!hardware) printf("no hardware device: none of the numbers below is a GPU's\n");
}

const side *sides_scalar_peer(const sides *s, const side *one) {
    const side *most = NULL;
    for (int i = 0; i < s->count; i++) {
        const side *it = &s->list[i];
        if (it->device_number || it->isa != HYDRA_ISA_SCALAR) continue;
        if (it->threads == one->threads) return it;
        if (!most || it->threads > most->threads) most = it;
    }
    return one->threads ? NULL : most;
}

/* ---- contexts and scenes */

static void say_trouble(void *user, hydra_log_level level, const char *text) {
    if (level != HYDRA_LOG_INFO) fprintf(stderr, "vulkan: %s: %s\n", ((const side *)user)->name, text);
}

hydra_context *side_create(const side *one, const void *cache, size_t cache_size) {
    char why[256] = "no context";
    hydra_context *context = NULL;
    hydra_context_desc desc = {.log = say_trouble, .log_user = (void *)one, .isa = one->isa};
    hydra_vk_desc vk = {.device_number = one->device_number,
                        .pipeline_cache = cache,
                        .pipeline_cache_size = cache_size,
                        .error = why,
                        .error_size = sizeof why};
    if (!one->device_number) {
        desc.threads = one->threads;
        context = hydra_create(&desc);
    } else if (hydra_vk_create(&desc, &vk, &context) != HYDRA_OK) {
        context = NULL;
    }
    if (!context) bench_stop(one->name, why);
    return context;
}

static side *lender(sides *s, const side *to) {
    for (side *one = s->list; one < to; one++)
        if (!one->device_number && !to->device_number && one->isa == to->isa) return one;
    return NULL;
}

/* Trees are built once: all sides walk the same. */
static void keep_trees(const side *one, void **trees, size_t *size) {
    if (*trees || hydra_scene_save_trees(one->scene, NULL, size) != HYDRA_OK) return;
    *trees = bench_alloc(*size);
    if (hydra_scene_save_trees(one->scene, *trees, size) != HYDRA_OK) bench_stop("hydra_scene_save_trees", hydra_error_text(one->context));
}

void sides_open(sides *s, scene_maker make, const void *what, bool share) {
    void *trees = NULL;
    size_t size = 0;
    for (side *one = s->list; one < s->list + s->count; one++) {
        const side *from = share ? lender(s, one) : NULL;
        one->borrowed = from != NULL;
        if (from) {
            one->context = from->context, one->scene = from->scene;
            continue;
        }
        side all = *one; /* where contexts are shared only the building uses their threads: all there are */
        if (share) all.threads = 0;
        one->context = side_create(&all, NULL, 0);
        one->scene = hydra_scene_create(one->context);
        if (!one->scene) bench_stop("hydra_scene_create", hydra_error_text(one->context));
        make(one->scene, what);
        if (trees && hydra_scene_load_trees(one->scene, trees, size) != HYDRA_OK)
            bench_stop("hydra_scene_load_trees", hydra_error_text(one->context));
        double from_when = wall_seconds();
        if (hydra_scene_commit(one->scene) != HYDRA_OK) bench_stop("hydra_scene_commit", hydra_error_text(one->context));
        one->commit_seconds = wall_seconds() - from_when;
        keep_trees(one, &trees, &size);
    }
    free(trees);
}

void sides_close(sides *s) {
    for (side *one = s->list; one < s->list + s->count; one++) {
        if (!one->borrowed) {
            hydra_scene_destroy(one->scene);
            hydra_destroy(one->context);
        }
        one->scene = NULL, one->context = NULL;
    }
}

hydra_vk_info side_info(const side *one) {
    hydra_vk_info info;
    memset(&info, 0, sizeof info);
    if (one->device_number) hydra_vk_get_info(one->context, &info);
    return info;
}

double side_busy_seconds(const side *one) {
    hydra_vk_info info = side_info(one);
    return info.slice_mean * (double)info.slices;
}

void slices_add(slices *sum, const side *one) {
    hydra_vk_info info = side_info(one);
    sum->count += info.slices;
    sum->seconds += info.slice_mean * (double)info.slices;
    if (info.slice_longest > sum->longest) sum->longest = info.slice_longest;
}

void slices_print(const slices *sum) {
    printf("%llu slices once warm, mean %.2f ms, longest %.2f\n", (unsigned long long)sum->count,
           sum->count ? 1e3 * sum->seconds / (double)sum->count : 0.0, 1e3 * sum->longest);
}
