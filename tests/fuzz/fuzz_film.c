/* hydra_render_merge on damaged films. The first byte chooses: the rest of the input as it is; or a good film of a
   disjoint range of samples, cut, lengthened and patched as the input says. What merge refuses must leave the
   render as it was, to the byte; what it takes must still read as numbers and render on. */
#include "fuzz.h"

enum { side = 12, film_limit = 1 << 20 };

static fuzz_memory memory;
static hydra_context *context;
static hydra_scene *scene;
static uint8_t good_film[film_limit], before[film_limit], after[film_limit], damaged[film_limit + 256];
static size_t good_size;

static hydra_render *make_render(uint32_t first, uint32_t end) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor.position[2] = 3;
    desc.width = desc.height = side;
    desc.tile_size = 8;
    desc.outputs = (1u << HYDRA_DEPTH) | (1u << HYDRA_ALBEDO) | (1u << HYDRA_DIRECT) | (1u << HYDRA_PRIMITIVE_ID);
    desc.first_sample = first;
    desc.max_samples = end;
    hydra_render *render = hydra_render_create(scene, &desc);
    FUZZ_MUST(render);
    return render;
}

static void finish(hydra_render *render) {
    hydra_result result = HYDRA_MORE;
    while (result == HYDRA_MORE) result = hydra_render_step(render);
    FUZZ_MUST(result == HYDRA_OK);
}

static size_t save(const hydra_render *render, uint8_t *to) {
    size_t size = film_limit;
    FUZZ_MUST(hydra_render_save(render, to, &size) == HYDRA_OK && size <= film_limit);
    return size;
}

/* A triangle under a sky: some pixels hit, some do not. */
static void make_scene(void) {
    static const float corners[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    hydra_context_desc host;
    hydra_mesh_desc mesh;
    hydra_environment_desc sky;
    memset(&host, 0, sizeof host);
    memset(&mesh, 0, sizeof mesh);
    memset(&sky, 0, sizeof sky);
    host.allocator.alloc = fuzz_alloc;
    host.allocator.release = fuzz_release;
    host.allocator.user = &memory;
    host.threads = 1;
    mesh.positions.data = corners;
    mesh.positions.count = 3;
    sky.color[0] = sky.color[1] = sky.color[2] = 1;
    context = hydra_create(&host);
    FUZZ_MUST(context);
    scene = hydra_scene_create(context);
    FUZZ_MUST(scene && hydra_scene_add_mesh(scene, &mesh).id);
    FUZZ_MUST(hydra_scene_set_environment(scene, &sky) == HYDRA_OK && hydra_scene_commit(scene) == HYDRA_OK);
    hydra_render *other = make_render(4, 8);
    finish(other);
    good_size = save(other, good_film);
    hydra_render_destroy(other);
}

/* The good film with bytes changed where the input says, and its end moved. */
static size_t damage(fuzz_input *in) {
    uint8_t cut = fuzz_u8(in);
    size_t size = good_size;
    memcpy(damaged, good_film, good_size);
    if (cut > 250)
        size -= (size_t)fuzz_u32(in) % (good_size + 1);
    else if (cut > 240)
        size += fuzz_u8(in);
    while (in->left >= 4) {
        uint8_t kind = fuzz_u8(in);
        size_t at = kind & 1 ? fuzz_u8(in) : fuzz_u32(in); /* headers are where the trouble is */
        if (kind & 2) {
            uint32_t word = kind & 4 ? fuzz_u32(in) : 0xffffffffu;
            if (at % good_size + 4 <= good_size) memcpy(damaged + at % good_size, &word, 4);
        } else {
            damaged[at % good_size] ^= fuzz_u8(in);
        }
    }
    return size;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!context) make_scene();
    fuzz_input in = {data, size};
    int64_t blocks = memory.blocks;
    bool whole = fuzz_u8(&in) & 1;
    size_t bytes = 0;
    if (whole) {
        bytes = in.left < film_limit ? in.left : film_limit;
        memcpy(damaged, in.data, bytes);
    } else {
        bytes = damage(&in);
    }
    hydra_render *render = make_render(0, 4);
    if (size % 2) FUZZ_MUST(hydra_render_step(render) <= HYDRA_MORE);
    size_t before_size = save(render, before);
    /* Exactly as long as it says, so that reading past the end is seen. */
    uint8_t *film = (uint8_t *)malloc(bytes ? bytes : 1);
    FUZZ_MUST(film);
    memcpy(film, damaged, bytes);
    hydra_result result = fuzz_result(context, hydra_render_merge(render, film, bytes));
    bool untouched = bytes == good_size && memcmp(film, good_film, bytes) == 0;
    if (untouched) FUZZ_MUST(result == HYDRA_OK);
    if (result != HYDRA_OK) {
        size_t after_size = save(render, after);
        FUZZ_MUST(after_size == before_size && memcmp(before, after, after_size) == 0);
    }
    free(film);
    fuzz_read_all(context, render, side * side);
    fuzz_check_status(render);
    fuzz_result(context, hydra_render_step(render));
    fuzz_read_all(context, render, side * side);
    hydra_render_destroy(render);
    FUZZ_MUST(memory.blocks == blocks);
    return 0;
}
