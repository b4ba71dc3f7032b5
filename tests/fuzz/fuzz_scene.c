/* The input is a program: a sequence of API calls with hostile values, on one scene with at most one render.
   Pointers and counts keep their contract (a buffer holds what the call is told it holds); everything else may lie. */
#include "fuzz.h"

enum { vertex_limit = 64, index_limit = 192, texel_limit = 64, ray_limit = 16, side_limit = 24 };

typedef struct fuzz_state {
    fuzz_input in;
    fuzz_memory memory;
    hydra_context *context;
    hydra_scene *scene;
    hydra_render *render;
    size_t pixels;
    uint32_t steps;
    bool committed;
} fuzz_state;

/* ---- values for descriptors */

/* Ids are small numbers counted from 1, at times stale ones, at times none. */
static uint32_t some_id(fuzz_state *s) {
    uint8_t value = fuzz_u8(&s->in);
    return value < 250 ? value % 6u : fuzz_u32(&s->in);
}

#define SOME_HANDLE(type)                    \
    static type some_##type(fuzz_state *s) { \
        type handle;                         \
        handle.id = some_id(s);              \
        return handle;                       \
    }
SOME_HANDLE(hydra_mesh)
SOME_HANDLE(hydra_instance)
SOME_HANDLE(hydra_material)
SOME_HANDLE(hydra_texture)
SOME_HANDLE(hydra_light)

/* A view of limit elements of element bytes in buffer: a count and a stride that stay inside, or that any
   implementation can and must refuse (a NULL, too small a stride, a product that overflows). */
static hydra_view some_view(fuzz_state *s, const void *buffer, size_t limit, size_t element) {
    hydra_view view;
    memset(&view, 0, sizeof view);
    uint8_t kind = fuzz_u8(&s->in);
    view.data = kind == 255 ? NULL : buffer;
    view.count = fuzz_u8(&s->in) % (limit + 1);
    if (kind < 200) return view;
    if (kind < 220)
        view.stride = element;
    else if (kind < 235)
        view.count /= 2, view.stride = element * 2;
    else if (kind < 245)
        view.stride = element - 1 - fuzz_u8(&s->in) % (element - 1);
    else if (kind < 255)
        view.count = SIZE_MAX / 8, view.stride = 64;
    return view;
}

static hydra_material_desc some_material_desc(fuzz_state *s) {
    fuzz_input *in = &s->in;
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    fuzz_enum(in, &desc.kind, 4);
    fuzz_shares(in, desc.base_color, 3);
    if (fuzz_u8(in) % 4 == 0) fuzz_shares(in, desc.emission, 3);
    desc.emit_both_sides = fuzz_bool(in);
    desc.metallic = fuzz_share(in);
    desc.roughness = fuzz_share(in);
    if (fuzz_u8(in) % 2 == 0) return desc;
    desc.transmission = fuzz_share(in);
    desc.thin = fuzz_bool(in);
    desc.ior = fuzz_u8(in) % 8 ? 1.0001f + 3 * fuzz_share(in) : fuzz_float(in);
    fuzz_shares(in, desc.eta, 3);
    fuzz_shares(in, desc.k, 3);
    fuzz_shares(in, desc.absorption, 3);
    desc.clearcoat = fuzz_share(in);
    desc.clearcoat_roughness = fuzz_share(in);
    fuzz_enum(in, &desc.alpha_mode, 3);
    desc.alpha = fuzz_share(in);
    desc.alpha_cutoff = fuzz_share(in);
    desc.base_color_texture = some_hydra_texture(s);
    desc.metallic_roughness_texture = some_hydra_texture(s);
    desc.normal_texture = some_hydra_texture(s);
    desc.emission_texture = some_hydra_texture(s);
    desc.alpha_texture = some_hydra_texture(s);
    desc.normal_scale = fuzz_share(in);
    return desc;
}

/* The buffers live as long as the call: static, filled anew each time. */
static hydra_mesh_desc some_mesh_desc(fuzz_state *s) {
    static float positions[vertex_limit * 3], normals[vertex_limit * 3], uvs[vertex_limit * 2];
    static uint32_t indices[index_limit];
    static hydra_material materials[index_limit];
    fuzz_input *in = &s->in;
    uint32_t count = 3 + fuzz_u8(in) % (vertex_limit - 2), used = 3 * (1 + fuzz_u8(in) % (index_limit / 3));
    fuzz_floats(in, positions, (int)count * 3);
    for (uint32_t i = 0; i < used; i++) indices[i] = fuzz_u8(in) < 254 ? fuzz_u8(in) % count : fuzz_u32(in);
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions.data = positions;
    desc.positions.count = count;
    desc.indices.data = indices;
    desc.indices.count = used;
    uint8_t extras = fuzz_u8(in);
    if (extras & 1) {
        fuzz_floats(in, normals, (int)count * 3);
        desc.normals = some_view(s, normals, count, 12);
        if (extras & 2) desc.normals.count = count, desc.normals.stride = 0;
    }
    if (extras & 4) {
        fuzz_floats(in, uvs, (int)count * 2);
        desc.uvs = some_view(s, uvs, count, 8);
        if (extras & 2) desc.uvs.count = count, desc.uvs.stride = 0;
    }
    if (extras & 8) {
        for (uint32_t i = 0; i < used / 3; i++) materials[i] = some_hydra_material(s);
        desc.triangle_materials = some_view(s, materials, used / 3, sizeof materials[0]);
        if (extras & 2) desc.triangle_materials.count = used / 3, desc.triangle_materials.stride = 0;
    }
    if ((extras & 0x30) == 0x30) desc.positions = some_view(s, positions, vertex_limit, 12);
    if ((extras & 0x50) == 0x50) desc.indices.stride = fuzz_u8(in) % 5;
    if ((extras & 0x90) == 0x90) memset(&desc.indices, 0, sizeof desc.indices);
    desc.material = some_hydra_material(s);
    desc.instanced_only = extras % 16 == 15;
    return desc;
}

static hydra_instance_desc some_instance_desc(fuzz_state *s) {
    hydra_instance_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.mesh = some_hydra_mesh(s);
    desc.material = some_hydra_material(s);
    uint8_t kind = fuzz_u8(&s->in);
    if (kind < 128) {
        desc.transform[0] = desc.transform[5] = desc.transform[10] = 1;
        for (int i = 3; i < 12; i += 4) desc.transform[i] = fuzz_float(&s->in);
    } else if (kind < 240) {
        fuzz_floats(&s->in, desc.transform, 12);
    }
    return desc;
}

static hydra_light_desc some_light_desc(fuzz_state *s) {
    fuzz_input *in = &s->in;
    hydra_light_desc desc;
    memset(&desc, 0, sizeof desc);
    fuzz_enum(in, &desc.kind, 6);
    if (fuzz_u8(in) % 2) fuzz_enum(in, &desc.unit, 3);
    fuzz_shares(in, desc.color, 3);
    fuzz_floats(in, desc.position, 3);
    fuzz_floats(in, desc.direction, 3);
    fuzz_floats(in, desc.axis_u, 3);
    fuzz_floats(in, desc.axis_v, 3);
    desc.radius = fuzz_share(in);
    desc.cone_outer = fuzz_share(in);
    desc.cone_inner = desc.cone_outer * fuzz_share(in);
    desc.angular_radius = fuzz_share(in);
    desc.both_sides = fuzz_bool(in);
    desc.hidden = fuzz_bool(in);
    return desc;
}

/* ---- calls */

static void add_texture(fuzz_state *s) {
    static float texels[texel_limit * texel_limit * 4];
    fuzz_input *in = &s->in;
    hydra_texture_desc desc;
    memset(&desc, 0, sizeof desc);
    for (int i = 0; i < 64; i++) texels[i] = fuzz_share(in);
    desc.texels = fuzz_u8(in) == 255 ? NULL : texels;
    uint8_t kind = fuzz_u8(in);
    desc.width = kind == 255 ? 65537u + fuzz_u32(in) % 1000000u : fuzz_u8(in) % 9u;
    desc.height = kind == 254 ? 0xffffffffu : fuzz_u8(in) % 9u;
    fuzz_enum(in, &desc.format, 3);
    fuzz_enum(in, &desc.wrap_u, 3);
    fuzz_enum(in, &desc.wrap_v, 3);
    if (kind > 200 && kind < 250) desc.row_stride = fuzz_u8(in);
    desc.no_mipmaps = fuzz_bool(in);
    hydra_scene_add_texture(s->scene, kind == 253 ? NULL : &desc);
}

static void set_environment(fuzz_state *s) {
    static float texels[16 * 8 * 3];
    fuzz_input *in = &s->in;
    hydra_environment_desc desc;
    memset(&desc, 0, sizeof desc);
    fuzz_shares(in, desc.color, 3);
    if (fuzz_bool(in)) {
        fuzz_shares(in, texels, 16 * 8 * 3);
        desc.texels = texels;
        desc.width = fuzz_u8(in) % 17u;
        desc.height = fuzz_u8(in) % 9u;
    }
    desc.rotation = fuzz_float(in);
    fuzz_result(s->context, hydra_scene_set_environment(s->scene, fuzz_u8(in) == 255 ? NULL : &desc));
}

static void commit(fuzz_state *s) {
    hydra_scene_info info;
    s->committed = fuzz_result(s->context, hydra_scene_commit(s->scene)) == HYDRA_OK;
    if (!s->committed) s->committed = fuzz_result(s->context, hydra_scene_commit(s->scene)) == HYDRA_OK; /* mended: see ERRORS */
    if (!s->committed) return;
    FUZZ_MUST(hydra_scene_get_info(s->scene, &info) == HYDRA_OK);
    for (int i = 0; i < 3; i++) {
        FUZZ_MUST(fuzz_finite(info.bounds_min[i]) && fuzz_finite(info.bounds_max[i]));
        FUZZ_MUST(info.bounds_min[i] <= info.bounds_max[i]);
    }
}

static void cast_rays(fuzz_state *s) {
    hydra_ray rays[ray_limit];
    hydra_hit hits[ray_limit];
    uint8_t occluded[ray_limit];
    size_t count = fuzz_u8(&s->in) % (ray_limit + 1u);
    for (size_t i = 0; i < count; i++) {
        fuzz_floats(&s->in, rays[i].origin, 3);
        fuzz_floats(&s->in, rays[i].direction, 3);
        rays[i].t_min = fuzz_u8(&s->in) < 200 ? 0 : fuzz_float(&s->in);
        rays[i].t_max = fuzz_u8(&s->in) < 200 ? INFINITY : fuzz_float(&s->in);
    }
    hydra_result closest = fuzz_code(hydra_scene_closest_hits(s->scene, rays, hits, count));
    hydra_result any = fuzz_code(hydra_scene_any_hits(s->scene, rays, occluded, count));
    FUZZ_MUST(closest == any);
    if (closest != HYDRA_OK && closest != HYDRA_ERROR_RAY) return;
    for (size_t i = 0; i < count; i++) {
        FUZZ_MUST(hits[i].t == hits[i].t && occluded[i] <= 1);
        bool hit = hits[i].primitive != HYDRA_NONE || hits[i].light != 0;
        FUZZ_MUST(!hit || (hits[i].t >= rays[i].t_min && hits[i].t <= rays[i].t_max));
        FUZZ_MUST(hit == (occluded[i] != 0)); /* alpha is decided by the hit, not by the query */
        for (int k = 0; k < 3; k++) FUZZ_MUST(!hit || fuzz_finite(hits[i].normal[k]));
    }
}

static void some_sensor(fuzz_state *s, hydra_sensor_desc *sensor) {
    static float points[side_limit * side_limit * 3], normals[side_limit * side_limit * 3];
    static hydra_ray rays[side_limit * side_limit];
    fuzz_input *in = &s->in;
    fuzz_enum(in, &sensor->kind, 6);
    fuzz_floats(in, sensor->position, 3);
    fuzz_floats(in, sensor->target, 3);
    if (fuzz_bool(in)) fuzz_floats(in, sensor->up, 3);
    if (fuzz_bool(in)) sensor->fov_y = fuzz_float(in);
    if (fuzz_bool(in)) sensor->lens_radius = fuzz_share(in), sensor->focus_distance = fuzz_float(in);
    if (fuzz_bool(in)) sensor->ortho_height = fuzz_float(in);
    if (fuzz_bool(in)) fuzz_floats(in, sensor->shift, 2);
    fuzz_enum(in, &sensor->filter, 2);
    if (sensor->kind == HYDRA_SENSOR_POINTS) {
        for (int i = 0; i < 48; i++) points[i] = fuzz_float(in), normals[i] = fuzz_float(in);
        sensor->point_positions = some_view(s, points, side_limit * side_limit, 12);
        sensor->point_normals = some_view(s, normals, side_limit * side_limit, 12);
        fuzz_enum(in, &sensor->lightmap, 3);
        fuzz_shares(in, sensor->lightmap_albedo, 3);
    } else if (sensor->kind == HYDRA_SENSOR_RAYS) {
        for (int i = 0; i < 16; i++) {
            fuzz_floats(in, rays[i].origin, 3);
            fuzz_floats(in, rays[i].direction, 3);
            rays[i].t_min = fuzz_share(in);
            rays[i].t_max = fuzz_bool(in) ? INFINITY : fuzz_float(in);
        }
        sensor->rays = some_view(s, rays, side_limit * side_limit, sizeof rays[0]);
    }
}

static void create_render(fuzz_state *s) {
    fuzz_input *in = &s->in;
    hydra_render_desc desc;
    hydra_estimate_result estimate;
    if (s->render) return;
    memset(&desc, 0, sizeof desc);
    some_sensor(s, &desc.sensor);
    uint8_t kind = fuzz_u8(in);
    desc.width = 1u + fuzz_u8(in) % side_limit;
    desc.height = 1u + fuzz_u8(in) % side_limit;
    if (desc.sensor.kind == HYDRA_SENSOR_POINTS || desc.sensor.kind == HYDRA_SENSOR_RAYS) {
        size_t count = desc.sensor.kind == HYDRA_SENSOR_RAYS ? desc.sensor.rays.count : desc.sensor.point_positions.count;
        if (kind < 240) desc.width = (uint32_t)(count & 0xffffu), desc.height = 1;
        if (kind < 200) desc.sensor.point_normals.count = count;
        if (count > side_limit * side_limit) desc.sensor.point_normals.count = 0;
    } else if (kind == 255) {
        desc.width = fuzz_u32(in);
        desc.height = fuzz_u32(in);
    }
    if (kind % 5 == 0) {
        for (int i = 0; i < 4; i++) desc.region[i] = fuzz_u8(in) % side_limit;
    }
    desc.outputs = kind % 3 ? fuzz_u32(in) & ((1u << HYDRA_OUTPUT_COUNT) - 1) : 0;
    desc.max_samples = 2u * (1u + fuzz_u8(in) % 4u);
    if (kind % 7 == 0) desc.target_error = fuzz_float(in);
    if (kind % 11 == 0) desc.time_budget = (double)fuzz_float(in) * 0.01;
    if (kind % 13 == 0) desc.first_sample = fuzz_u8(in) % 8u;
    if (kind % 17 == 0) desc.max_samples = fuzz_u8(in);
    desc.max_depth = fuzz_u8(in) % 16u;
    fuzz_enum(in, &desc.strategy, 3);
    desc.seed = fuzz_u8(in);
    desc.tile_size = kind % 4 ? 8u : fuzz_u8(in) % 20u;
    desc.step_seconds = 0.002;
    hydra_result forecast = fuzz_result(s->context, hydra_estimate(s->scene, &desc, &estimate));
    s->render = hydra_render_create(s->scene, &desc);
    if (s->render) FUZZ_MUST(forecast == HYDRA_OK || s->memory.fail_at);
    bool whole = !(desc.region[0] | desc.region[1] | desc.region[2] | desc.region[3]);
    s->pixels = whole ? (size_t)desc.width * desc.height : (size_t)desc.region[2] * desc.region[3];
    s->steps = 0;
}

static void step(fuzz_state *s) {
    if (!s->render || s->steps++ > 6) return;
    if (fuzz_u8(&s->in) > 240) hydra_render_cancel(s->render);
    fuzz_result(s->context, hydra_render_step(s->render));
    fuzz_check_status(s->render);
    fuzz_read_all(s->context, s->render, s->pixels);
}

static void save_and_merge(fuzz_state *s) {
    size_t size = 0;
    if (!s->render || fuzz_code(hydra_render_save(s->render, NULL, &size)) != HYDRA_OK || size > 1u << 24) return;
    uint8_t *film = (uint8_t *)malloc(size + 1);
    if (!film) return;
    size_t room = fuzz_u8(&s->in) == 255 ? size / 2 : size;
    hydra_result saved = fuzz_code(hydra_render_save(s->render, film, &room));
    if (saved == HYDRA_OK) fuzz_result(s->context, hydra_render_merge(s->render, film, size));
    free(film);
}

static void destroy_render(fuzz_state *s) {
    hydra_render_destroy(s->render);
    s->render = NULL;
}

/* Edits are refused while a render lives: that is part of what is tried. */
static void call(fuzz_state *s, uint8_t which) {
    hydra_material_desc material;
    hydra_mesh_desc mesh;
    hydra_instance_desc instance;
    hydra_light_desc light;
    /* clang-format off: a table */
    switch (which % 21) {
    case 0:
        material = some_material_desc(s);
        hydra_scene_add_material(s->scene, &material);
        break;
    case 1:
    case 2:
        mesh = some_mesh_desc(s);
        hydra_scene_add_mesh(s->scene, &mesh);
        break;
    case 3:
        instance = some_instance_desc(s);
        hydra_scene_add_instance(s->scene, &instance);
        break;
    case 4:
    case 5:
        light = some_light_desc(s);
        hydra_scene_add_light(s->scene, &light);
        break;
    case 6: add_texture(s); break;
    case 7: set_environment(s); break;
    case 8:
        material = some_material_desc(s);
        fuzz_result(s->context, hydra_scene_update_material(s->scene, some_hydra_material(s), &material));
        break;
    case 9:
        mesh = some_mesh_desc(s);
        fuzz_result(s->context, hydra_scene_update_mesh(s->scene, some_hydra_mesh(s), &mesh));
        break;
    case 10:
        instance = some_instance_desc(s);
        fuzz_result(s->context, hydra_scene_update_instance(s->scene, some_hydra_instance(s), &instance));
        break;
    case 11:
        light = some_light_desc(s);
        fuzz_result(s->context, hydra_scene_update_light(s->scene, some_hydra_light(s), &light));
        break;
    case 12: fuzz_result(s->context, hydra_scene_remove_mesh(s->scene, some_hydra_mesh(s))); break;
    case 13: fuzz_result(s->context, hydra_scene_remove_instance(s->scene, some_hydra_instance(s))); break;
    case 14: fuzz_result(s->context, hydra_scene_remove_light(s->scene, some_hydra_light(s))); break;
    case 15: commit(s); break;
    case 16: cast_rays(s); break;
    case 17: create_render(s); break;
    case 18: step(s); break;
    case 19: save_and_merge(s); break;
    default: destroy_render(s); break;
    }
    /* clang-format on */
}

static void run_backwards(void *user, uint32_t count, void (*task)(void *, uint32_t), void *argument) {
    (void)user;
    while (count) task(argument, --count);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_state s;
    hydra_context_desc desc;
    memset(&s, 0, sizeof s);
    memset(&desc, 0, sizeof desc);
    s.in.data = data;
    s.in.left = size;
    uint8_t setup = fuzz_u8(&s.in);
    desc.allocator.alloc = fuzz_alloc;
    desc.allocator.release = fuzz_release;
    desc.allocator.user = &s.memory;
    desc.memory_cap = (size_t)256 << 20;
    desc.threads = setup & 1 ? 2 : 1;
    if (setup & 2) desc.parallel_for = run_backwards;
    if (setup & 4) desc.isa = HYDRA_ISA_SCALAR;
    if (setup % 32 == 31) s.memory.fail_at = 1 + fuzz_u8(&s.in);
    s.context = hydra_create(&desc);
    s.scene = s.context ? hydra_scene_create(s.context) : NULL;
    if (s.scene) {
        for (int calls = 0; s.in.left && calls < 64; calls++) call(&s, fuzz_u8(&s.in));
        if (!s.render) { /* whatever it came to is committed, looked at and rendered */
            commit(&s);
            cast_rays(&s);
            create_render(&s);
        } else {
            FUZZ_MUST(hydra_scene_destroy(s.scene) == HYDRA_ERROR_BUSY);
        }
        step(&s);
        destroy_render(&s);
        FUZZ_MUST(hydra_destroy(s.context) == HYDRA_ERROR_BUSY);
        FUZZ_MUST(hydra_scene_destroy(s.scene) == HYDRA_OK);
    }
    if (s.context) FUZZ_MUST(hydra_destroy(s.context) == HYDRA_OK);
    FUZZ_MUST(s.memory.blocks == 0 && s.memory.bytes == 0);
    return 0;
}
