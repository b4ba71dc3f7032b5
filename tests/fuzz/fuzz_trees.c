/* hydra_scene_load_trees on damaged and forged bytes. The first byte chooses: the rest of the input as it is; or good trees,
   cut, lengthened and patched as the input says, with or without a checksum that fits. What load refuses must leave the
   scene as it was; what it takes must commit, answer rays with numbers, survive moved vertices and be saved again. */
#include "fuzz.h"

enum { side = 12, vertices = side * side, triangles = 2 * (side - 1) * (side - 1), blob_limit = 1 << 20, ray_count = 64 };

static fuzz_memory memory;
static hydra_context *context;
static hydra_scene *scene;
static hydra_mesh still, moving;
static float positions[3 * vertices], moved[3 * vertices];
static uint32_t indices[3 * triangles];
static hydra_ray rays[ray_count];
static hydra_hit wanted[ray_count];
static uint8_t good[blob_limit], damaged[blob_limit + 256];
static size_t good_size;

/* A bumpy sheet. */
static void make_sheet(void) {
    uint32_t *index = indices;
    for (uint32_t v = 0; v < vertices; v++) {
        float x = (float)(v % side), y = (float)(v / side);
        const float at[3] = {x, y, sinf(1.7f * x) * cosf(1.3f * y)};
        memcpy(positions + 3 * v, at, sizeof at);
        for (int a = 0; a < 3; a++) moved[3 * v + (uint32_t)a] = at[a] * (a == 2 ? -2.0f : 1.0f);
        if (v % side == side - 1 || v / side == side - 1) continue;
        const uint32_t corners[6] = {v, v + 1, v + side, v + 1, v + side + 1, v + side};
        memcpy(index, corners, sizeof corners);
        index += 6;
    }
    for (uint32_t i = 0; i < ray_count; i++) {
        const hydra_ray ray = {{(float)(i % 8) * 1.4f + 0.1f, (float)(i / 8) * 1.4f + 0.1f, 5}, 0, {0.01f * (float)i, -0.2f, -1}, INFINITY};
        rays[i] = ray;
    }
}

static hydra_view view_of(const void *data, size_t count) {
    hydra_view view;
    view.data = data;
    view.stride = 0;
    view.count = count;
    return view;
}

static hydra_mesh add_sheet(bool dynamic) {
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions = view_of(positions, vertices);
    desc.indices = view_of(indices, 3 * triangles);
    desc.dynamic = dynamic;
    hydra_mesh mesh = hydra_scene_add_mesh(scene, &desc);
    FUZZ_MUST(mesh.id);
    return mesh;
}

static void make_scene(void) {
    hydra_context_desc host;
    memset(&host, 0, sizeof host);
    host.allocator.alloc = fuzz_alloc;
    host.allocator.release = fuzz_release;
    host.allocator.user = &memory;
    host.threads = 1;
    context = hydra_create(&host);
    FUZZ_MUST(context);
    scene = hydra_scene_create(context);
    FUZZ_MUST(scene);
    make_sheet();
    still = add_sheet(false);
    moving = add_sheet(true);
    FUZZ_MUST(hydra_scene_commit(scene) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_closest_hits(scene, rays, wanted, ray_count) == HYDRA_OK);
    good_size = blob_limit;
    FUZZ_MUST(hydra_scene_save_trees(scene, good, &good_size) == HYDRA_OK);
}

/* The good bytes with some changed where the input says, and the end moved. */
static size_t damage(fuzz_input *in) {
    uint8_t cut = fuzz_u8(in);
    size_t size = good_size;
    memcpy(damaged, good, good_size);
    if (cut > 250)
        size -= (size_t)fuzz_u32(in) % (good_size + 1);
    else if (cut > 240)
        size += fuzz_u8(in);
    while (in->left >= 4) {
        uint8_t kind = fuzz_u8(in);
        size_t at = kind & 1 ? fuzz_u8(in) : fuzz_u32(in); /* headers are where the trouble is */
        if (kind & 2) {
            uint32_t word = kind & 4 ? fuzz_u32(in) : kind & 8 ? fuzz_u8(in) : 0xffffffffu;
            if (at % good_size + 4 <= good_size) memcpy(damaged + at % good_size, &word, 4);
        } else {
            damaged[at % good_size] ^= fuzz_u8(in);
        }
    }
    return size;
}

/* Size and checksum as they must be, so that everything behind them is looked at. */
static void forge(uint8_t *data, uint64_t size) {
    if (size < sizeof(hyi_trees_header)) return;
    memcpy(data + offsetof(hyi_trees_header, size), &size, sizeof size);
    uint64_t sum = hyi_hash(HYI_TREES_MAGIC, data + HYI_TREES_CHECKED_FROM, (size_t)size - HYI_TREES_CHECKED_FROM);
    memcpy(data + offsetof(hyi_trees_header, checksum), &sum, sizeof sum);
}

static void cast(bool exact) {
    hydra_hit hits[ray_count];
    uint8_t occluded[ray_count];
    FUZZ_MUST(hydra_scene_closest_hits(scene, rays, hits, ray_count) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_any_hits(scene, rays, occluded, ray_count) == HYDRA_OK);
    for (uint32_t i = 0; i < ray_count; i++) {
        bool hit = hits[i].t >= 0;
        FUZZ_MUST(!hit ||
                  (fuzz_finite(hits[i].t) && hits[i].primitive < triangles && (hits[i].mesh == still.id || hits[i].mesh == moving.id)));
        FUZZ_MUST(hit == (occluded[i] != 0));
    }
    if (exact) FUZZ_MUST(memcmp(hits, wanted, sizeof hits) == 0);
}

/* Both trees made anew, from what was loaded where it fits. */
static void commit_anew(bool exact) {
    FUZZ_MUST(hydra_scene_rebuild_mesh(scene, still) == HYDRA_OK && hydra_scene_rebuild_mesh(scene, moving) == HYDRA_OK);
    FUZZ_MUST(fuzz_result(context, hydra_scene_commit(scene)) == HYDRA_OK);
    cast(exact);
}

/* A refit mends the boxes of the one; the other is built. */
static void move_and_save(void) {
    static uint8_t saved[blob_limit];
    size_t size = blob_limit;
    hydra_view none = view_of(NULL, 0);
    FUZZ_MUST(hydra_scene_move_vertices(scene, moving, view_of(moved, vertices), none) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_commit(scene) == HYDRA_OK);
    cast(false);
    FUZZ_MUST(hydra_scene_move_vertices(scene, moving, view_of(positions, vertices), none) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_rebuild_mesh(scene, still) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_commit(scene) == HYDRA_OK);
    cast(true);
    FUZZ_MUST(hydra_scene_save_trees(scene, saved, &size) == HYDRA_OK);
    FUZZ_MUST(hydra_scene_load_trees(scene, saved, size) == HYDRA_OK);
    commit_anew(true);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!context) make_scene();
    fuzz_input in = {data, size};
    uint8_t choice = fuzz_u8(&in);
    size_t bytes = in.left < blob_limit ? in.left : blob_limit;
    if (choice % 8 == 0)
        memcpy(damaged, in.data, bytes);
    else
        bytes = damage(&in);
    if (choice % 8 != 1) forge(damaged, bytes);
    /* Exactly as long as it says, so that reading past the end is seen. */
    uint8_t *trees = (uint8_t *)malloc(bytes ? bytes : 1);
    FUZZ_MUST(trees);
    memcpy(trees, damaged, bytes);
    bool untouched = bytes == good_size && memcmp(trees, good, bytes) == 0;
    hydra_result result = fuzz_result(context, hydra_scene_load_trees(scene, trees, bytes));
    free(trees);
    FUZZ_MUST(result == HYDRA_OK || (result == HYDRA_ERROR_TREE_FORMAT && !untouched));
    commit_anew(untouched || result != HYDRA_OK);
    if (result == HYDRA_OK) move_and_save();
    return 0;
}
