/* Every kernel of shaders/shared by itself, on a device and in float on the host, against the same source in double
   (kernels_double.c): the same calls (kernels_list.h) with the same inputs (kernels_inputs.h).

   Whole numbers must be equal to the bit. Reals may be off by a bound of each kernel's own, in ulps of float: of their own
   size, of a vector's largest component, or of a size that kernels_list.h names (KT_SCALE). Two bounds are kept. One is of
   the error as it stands, where that says something. The other, for all, is of the error over one such ulp plus what the
   exact result moves by when inputs, and the numbers of the scene, move by an ulp each: so it tells how far a result is
   from the exact one of nearly the same inputs (Higham 2002, section 1.5), and is small for what is computed well, however
   ill-conditioned it is.
   Where inputs that move by up to 16 ulps make the exact result jump, or a whole number of it change, the last bits of a
   comparison decide. Such cases are counted and not compared; how many there may be is bounded as well. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#define HYDRA_VK_IMPLEMENTATION
#include "hydra_vk.h"
#include "hydra_test.h"

#include "build/vk/kernels_spirv.h"
#include "kernels_host.h"
#include "kernels_inputs.h"
#include "kernels_scene.h"

int hydra_test_vk_kernels(void);

enum { CASES_MOST = 2000, VIEWS = 3, DRAWS = 5, MANY_DRAWS = 80 };
#define FAR_ULPS 16.0

/* ---- what each kernel is held to */

typedef struct kernel_rule {
    double mixed;       /* bound of the error over an ulp and the condition, for all but 1 % of the cases */
    double worst;       /* for those, too */
    double plain;       /* bound of the error in ulps; 0: there is none, or nothing but whole numbers */
    uint32_t undecided; /* of a thousand cases, at most */
} kernel_rule;

/* Measured with lavapipe and gcc, and up to half as much again. Both sides are held to the same, so a bound that is above
   what C needs comes from what Vulkan lets devices do, which is more yet: quotients are off by 2.5 ulps at most, exp2(x) by
   3 + 2 |x|, log2 by 3, or by 2^-21 where x is near 1, and pow by what these make of it. */
static const kernel_rule rules[KT_COUNT] = {
    /* cosines and arcs are our own on devices */
    [KT_sine] = {0.4, 0.4, 1, 0},
    [KT_sine_of_little] = {0.7, 0.7, 1.5, 0},
    [KT_arc] = {1.2, 1.2, 3, 0},
    [KT_exponential] = {3.5, 5, 80, 0}, /* exp(x), x down to -80 */
    [KT_logarithm] = {0.7, 0.9, 2, 0},
    [KT_power_of_two] = {1.5, 3, 4, 0},
    [KT_srgb] = {12, 12, 12, 0}, /* a table in C, pow on devices */
    [KT_quotient] = {0.9, 1.1, 2, 0},
    [KT_length] = {1.9, 2.2, 2.5, 0},
    [KT_products] = {0.9, 1.2, 2, 0},
    [KT_frame] = {0.7, 0.9, 1.5, 0},
    [KT_little] = {0.8, 1, 3, 0},
    /* whole numbers */
    [KT_bits] = {0, 0, 0, 0},
    [KT_hashes] = {0, 0, 0, 0},
    [KT_curve] = {0, 0, 0, 0},
    [KT_pair] = {0, 0, 0, 0},
    [KT_salt] = {0.9, 0.9, 0.9, 0},
    [KT_threshold] = {0, 0, 0, 0},
    [KT_wrap] = {0, 0, 0, 0},
    [KT_plan] = {0, 0, 0, 0},
    /* warps */
    [KT_disc] = {1.1, 1.8, 2.5, 0},
    [KT_hemisphere] = {1.6, 2, 0, 0}, /* z at the rim is the root of a rounding */
    [KT_near_axis] = {1, 1.6, 3, 0},
    [KT_cone] = {1.6, 2, 9, 0},
    [KT_respread] = {0.3, 0.4, 0.9, 0},
    [KT_linear] = {1.5, 2, 0, 0},
    [KT_choices] = {1.9, 2.5, 6, 20},
    [KT_weights] = {1.4, 1.8, 4, 0},
    /* interfaces */
    [KT_dielectric] = {6.5, 64, 0, 0}, /* at Brewster's angle from inside only the sum is well-conditioned, not its parts */
    [KT_metal] = {5, 7, 45, 0},
    [KT_schlick] = {1.9, 3, 3, 0},
    [KT_mirror] = {1.8, 2.5, 60, 0},
    [KT_facet] = {1.9, 2.2, 12, 0},
    [KT_facet_normal] = {2, 1e5, 0, 0}, /* the worst: the largest number of [0, 1), from grazing directions */
    [KT_halves] = {1.9, 2.4, 0, 0},
    [KT_lost] = {3, 7, 0, 0}, /* exp2 less 1 */
    [KT_energy_place] = {2.5, 3.2, 0, 0},
    /* cameras */
    [KT_film] = {0.6, 0.6, 0.7, 0},
    [KT_camera_ray] = {1, 1.8, 3, 0},
    [KT_callers_ray] = {1.8, 2.2, 3, 0},
    /* images: wrapping uv near the origin costs a rounding of 1, which the texture's slope multiplies */
    [KT_texture] = {1.6, 5, 9, 5},
    [KT_texture_lod] = {0.9, 1.6, 3.5, 0},
    [KT_alpha] = {1.5, 2.5, 8, 40},
    [KT_triangle] = {2.2, 4, 30, 5},
    [KT_sky] = {3, 4.5, 15, 5},
    [KT_sky_place] = {1.9, 2.2, 3, 20}, /* undecided: borders of cells, the poles */
    [KT_sky_sample] = {4, 96, 0, 10},
    [KT_sky_plain] = {1.4, 2.2, 0, 0},
    /* scattering. The worst: lost light, whose tables fall steeply, where it is a millionth of all; and facets at the end of their cap */
    [KT_bsdf] = {2, 2.5, 20, 0},
    [KT_bsdf_value] = {6, 2048, 0, 5},
    [KT_bsdf_sample] = {6, 1024, 0, 20},
    [KT_bsdf_albedo] = {2, 3, 60, 0},
    /* lights. The worst: a rectangle seen from near its middle, its halves' solid angles being ill-conditioned there */
    [KT_light_point] = {1.8, 2.2, 0, 5},
    [KT_light_surface] = {4.5, 64, 0, 30},
    [KT_light_density] = {4, 48, 0, 5},
    [KT_light_sun] = {1.8, 2.5, 0, 5},
    [KT_light_shape] = {1.7, 2.2, 0, 15},
    [KT_light_bound] = {1.7, 2.2, 240, 5},
    [KT_light_pick] = {4, 8, 0, 5},
    [KT_light_any] = {6.5, 80, 0, 10},
    [KT_light_pdf] = {3.5, 9, 0, 5},
    [KT_light_far] = {3.5, 7, 0, 5},
    /* surfaces and paths. The worst: a normal map's slope, as for textures */
    [KT_offset] = {2.5, 8, 220, 0},
    [KT_place] = {1.6, 2.4, 4, 0},
    [KT_surface] = {16, 48, 0, 5},
    [KT_material] = {0.9, 1.4, 3, 5},
    [KT_shadow] = {1.7, 2.2, 3, 0},
    [KT_survival] = {0.4, 0.4, 0.7, 0},
    [KT_escape] = {3.2, 4.5, 30, 5},
    [KT_first_path] = {2, 3.5, 8, 0},
    /* all of it, shade.comp: a vertex of a path */
    [KT_shade] = {16, 256, 0, 30},
};

/* ---- the bench: a device with the kernels and the scene, and the scene for the oracle */

typedef struct kernel_bench {
    hydra_context *context;
    hydra_scene *scene;
    hyi_vk *vk;
    hyi_vk_commands commands;
    hyi_vk_buffer in, out, told;
    hyi_vk_set set;
    VkPipeline pipelines[KT_GROUPS];
    const void *exact, *near[VIEWS], *far[VIEWS]; /* views in double: as it is, and with numbers that are off */
    uint32_t words[CASES_MOST][KT_IN_MOST], results[CASES_MOST][KT_OUT_MOST];
} kernel_bench;

typedef struct group {
    const uint32_t *words;
    size_t bytes;
} group;

#define GROUP(n) {kernels_spirv_##n, sizeof kernels_spirv_##n}
static const group groups[KT_GROUPS] = {GROUP(0), GROUP(1), GROUP(2), GROUP(3), GROUP(4), GROUP(5), GROUP(6), GROUP(7)};

static void make_pipeline(kernel_bench *b, uint32_t g) {
    VkShaderModuleCreateInfo code;
    VkComputePipelineCreateInfo info;
    memset(&code, 0, sizeof code);
    memset(&info, 0, sizeof info);
    code.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    code.pCode = groups[g].words;
    code.codeSize = groups[g].bytes;
    info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
    info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
    info.stage.pName = "main";
    info.layout = b->vk->layout;
    assert_int_equal(b->vk->f.CreateShaderModule(b->vk->device, &code, NULL, &info.stage.module), VK_SUCCESS);
    assert_int_equal(b->vk->f.CreateComputePipelines(b->vk->device, b->vk->cache, 1, &info, NULL, &b->pipelines[g]), VK_SUCCESS);
    b->vk->f.DestroyShaderModule(b->vk->device, info.stage.module, NULL);
}

static void make_views(kernel_bench *b) {
    const hydra_scene *scene = b->scene;
    kt_scene s;
    memset(&s, 0, sizeof s);
    s.constants = (const uint32_t *)&scene->view.constants;
    s.materials = (const uint32_t *)scene->view.materials;
    s.instances = (const uint32_t *)scene->view.instances;
    s.lights = (const uint32_t *)scene->view.lights;
    s.light_nodes = (const uint32_t *)scene->view.light_nodes;
    s.material_count = (uint32_t)scene->view_material_count;
    s.instance_count = (uint32_t)scene->placed_count;
    s.light_count = (uint32_t)scene->all_light_count;
    s.light_node_count = scene->light_node_count;
    s.textures = scene->view.textures;
    s.texels = scene->view.texels;
    s.meshes = scene->view.meshes;
    s.mesh_arrays = scene->view.mesh_arrays;
    s.environment = scene->view.environment;
    s.environment_cdf = scene->view.environment_cdf;
    s.energy_tables = scene->view.energy_tables;
    b->exact = kt_make_wide_view(&s, 0, 0);
    for (uint32_t i = 0; i < VIEWS; i++) {
        b->near[i] = kt_make_wide_view(&s, 1, 100 + i);
        b->far[i] = kt_make_wide_view(&s, FAR_ULPS, 200 + i);
    }
}

static int open_kernels(void **state) {
    kernel_bench *b = (kernel_bench *)calloc(1, sizeof *b);
    *state = b;
    b->context = hydra_create(NULL);
    assert_non_null(b->context);
    b->vk = (hyi_vk *)b->context->device;
    assert_non_null(b->vk);
    b->scene = make_scene(b->context);
    make_views(b);
    assert_int_equal(hyi_vk_make_buffer(b->vk, &b->in, HYI_VK_DEVICE, sizeof b->words, "inputs"), HYDRA_OK);
    assert_int_equal(hyi_vk_make_buffer(b->vk, &b->out, HYI_VK_DEVICE, sizeof b->results, "results"), HYDRA_OK);
    assert_int_equal(hyi_vk_make_buffer(b->vk, &b->told, HYI_VK_READBACK, sizeof b->results, "results told"), HYDRA_OK);
    assert_int_equal(hyi_vk_make_set(b->vk, b->vk->pass_layout, HYK_PASS_BINDINGS, 0, &b->set), HYDRA_OK);
    hyi_vk_buffer bound[2] = {b->in, b->out};
    hyi_vk_write_set(b->vk, &b->set, bound, 2);
    for (uint32_t g = 0; g < KT_GROUPS; g++) make_pipeline(b, g);
    return hyi_vk_make_commands(b->vk, &b->commands) == HYDRA_OK ? 0 : 1;
}

static int close_kernels(void **state) {
    kernel_bench *b = (kernel_bench *)*state;
    for (uint32_t g = 0; g < KT_GROUPS; g++) b->vk->f.DestroyPipeline(b->vk->device, b->pipelines[g], NULL);
    hyi_vk_free_set(b->vk, &b->set);
    hyi_vk_free_buffer(b->vk, &b->in);
    hyi_vk_free_buffer(b->vk, &b->out);
    hyi_vk_free_buffer(b->vk, &b->told);
    hyi_vk_free_commands(b->vk, &b->commands);
    kt_free_wide_view(b->exact);
    for (uint32_t i = 0; i < VIEWS; i++) {
        kt_free_wide_view(b->near[i]);
        kt_free_wide_view(b->far[i]);
    }
    hydra_result gone = hydra_scene_destroy(b->scene), result = hydra_destroy(b->context);
    free(b);
    return gone == HYDRA_OK && result == HYDRA_OK ? 0 : 1;
}

/* ---- running */

static void finish_kernels(kernel_bench *b) {
    double seconds;
    assert_int_equal(hyi_vk_submit(b->vk, &b->commands), HYDRA_OK);
    assert_int_equal(hyi_vk_wait(b->vk, &b->commands, &seconds), HYDRA_OK);
}

static void run(kernel_bench *b, VkPipeline pipeline, const hyi_vk_set *set, const uint32_t call[4], uint32_t lanes) {
    VkDescriptorSet sets[2] = {((const hyi_vk_scene *)b->scene->device)->set.set, set->set};
    VkCommandBuffer buffer = b->commands.buffer;
    hyi_vk *vk = b->vk;
    assert_int_equal(hyi_vk_begin(vk, &b->commands), HYDRA_OK);
    vk->f.CmdBindPipeline(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    vk->f.CmdBindDescriptorSets(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, vk->layout, 0, 2, sets, 0, NULL);
    vk->f.CmdPushConstants(buffer, vk->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, 16, call);
    vk->f.CmdDispatch(buffer, (lanes + HYK_GROUP - 1) / HYK_GROUP, 1, 1);
    hyi_vk_barrier(vk, &b->commands);
    finish_kernels(b);
}

static void fetch_results(kernel_bench *b, const hyi_vk_buffer *from, void *to, size_t bytes) {
    assert_int_equal(hyi_vk_begin(b->vk, &b->commands), HYDRA_OK);
    hyi_vk_copy(b->vk, &b->commands, from, &b->told, bytes);
    hyi_vk_barrier_to_host(b->vk, &b->commands);
    finish_kernels(b);
    memcpy(to, b->told.mapped, bytes);
}

/* kernel: its number in the group. */
static void run_on_device(kernel_bench *b, uint32_t g, uint32_t kernel, uint32_t cases) {
    const uint32_t call[4] = {kernel, cases, KT_IN_MOST, KT_OUT_MOST};
    memset(b->results, 0xa5, sizeof b->results);
    assert_int_equal(hyi_vk_send(b->vk, &b->in, b->words, cases * sizeof b->words[0]), HYDRA_OK);
    assert_int_equal(hyi_vk_send(b->vk, &b->out, b->results, cases * sizeof b->results[0]), HYDRA_OK);
    run(b, b->pipelines[g], &b->set, call, cases);
    fetch_results(b, &b->out, b->results, cases * sizeof b->results[0]);
}

/* ---- running shade.comp: a case a lane */

typedef struct lanes {
    hyk_path paths[CASES_MOST];
    hyk_hit hits[CASES_MOST];
    hyk_shadow shadows[CASES_MOST];
    hyk_lane_radiance radiance[CASES_MOST];
    hyk_lane_extra extras[CASES_MOST];
    uint32_t queues[3][CASES_MOST];
    hyk_counts counts;
} lanes;

static void fill_lanes(const kernel_bench *b, lanes *l, uint32_t cases) {
    memset(l, 0, sizeof *l);
    l->counts.paths = cases;
    for (uint32_t i = 0; i < cases; i++) {
        kt_case k;
        k.in = b->words[i];
        k.read = 0;
        l->paths[i] = kt_path(&k);
        l->hits[i] = kt_hit(&k);
        l->queues[0][i] = i;
        l->extras[i].first.depth = -1; /* none */
    }
}

#define SHADE_WANTS (HYK_WANTS_COMPONENTS | HYK_WANTS_IRRADIANCE | HYK_WANTS_SURFACE)

/* A buffer of the pass and what is in it. */
typedef struct part {
    uint32_t binding;
    void *data;
    size_t bytes;
} part;

static VkPipeline shade_pipeline(kernel_bench *b) {
    hyi_vk_shape shape = {HYI_FEATURES_EVERYTHING, 0, 0, 0, SHADE_WANTS};
    VkPipeline pipeline = VK_NULL_HANDLE;
    assert_int_equal(hyi_vk_get_pipeline(b->vk, HYI_VK_KERNEL_shade, &shape, &pipeline), HYDRA_OK);
    return pipeline;
}

static void shade_lanes(kernel_bench *b, lanes *l) {
    const uint32_t call[4] = {l->counts.paths, CASES_MOST, CASES_MOST, 0}; /* hyk_dispatch */
    hyk_picture picture;
    hyi_vk_buffer buffers[HYK_PASS_BINDINGS];
    hyi_vk_set set = {VK_NULL_HANDLE, VK_NULL_HANDLE};
    const part parts[] = {{HYK_BINDING_PICTURE, &picture, sizeof picture},
                          {HYK_BINDING_COUNTS, &l->counts, sizeof l->counts},
                          {HYK_BINDING_QUEUES, l->queues, sizeof l->queues},
                          {HYK_BINDING_PATHS, l->paths, sizeof l->paths},
                          {HYK_BINDING_HITS, l->hits, sizeof l->hits},
                          {HYK_BINDING_SHADOWS, l->shadows, sizeof l->shadows},
                          {HYK_BINDING_RADIANCE, l->radiance, sizeof l->radiance},
                          {HYK_BINDING_EXTRAS, l->extras, sizeof l->extras}};
    memset(&picture, 0, sizeof picture);
    memset(buffers, 0, sizeof buffers);
    picture.settings.strategy = HYK_STRATEGY_MIS;
    picture.settings.wants = SHADE_WANTS;
    for (size_t i = 0; i < HYI_COUNT(parts); i++) {
        hyi_vk_buffer *buffer = &buffers[parts[i].binding];
        assert_int_equal(hyi_vk_make_buffer(b->vk, buffer, HYI_VK_DEVICE, parts[i].bytes, "lanes"), HYDRA_OK);
        assert_int_equal(hyi_vk_send(b->vk, buffer, parts[i].data, parts[i].bytes), HYDRA_OK);
    }
    buffers[HYK_BINDING_UNITS] = buffers[HYK_BINDING_SENSOR] = buffers[HYK_BINDING_PICTURE]; /* bound, not used */
    assert_int_equal(hyi_vk_make_set(b->vk, b->vk->pass_layout, HYK_PASS_BINDINGS, 0, &set), HYDRA_OK);
    hyi_vk_write_set(b->vk, &set, buffers, HYK_PASS_BINDINGS);
    run(b, shade_pipeline(b), &set, call, l->counts.paths);
    for (size_t i = 0; i < HYI_COUNT(parts); i++) {
        fetch_results(b, &buffers[parts[i].binding], parts[i].data, parts[i].bytes);
        hyi_vk_free_buffer(b->vk, &buffers[parts[i].binding]);
    }
    hyi_vk_free_set(b->vk, &set);
}

static bool is_in(const uint32_t *queue, uint32_t count, uint32_t lane) {
    for (uint32_t i = 0; i < count; i++)
        if (queue[i] == lane) return true;
    return false;
}

static void tell3(uint32_t **to, hyk_vec3 v, bool there) {
    const float xyz[3] = {v.x, v.y, v.z};
    for (int k = 0; k < 3; k++) *(*to)++ = there ? hyk_float_bits(xyz[k]) : 0;
}
static void tell1(uint32_t **to, float x, bool there) { *(*to)++ = there ? hyk_float_bits(x) : 0; }

/* In the order of the kernel shade. */
static void tell_lane(const lanes *l, uint32_t i, uint32_t *to) {
    bool shadow = is_in(l->queues[2], l->counts.shadows_next, i), goes_on = is_in(l->queues[1], l->counts.paths_next, i);
    const hyk_lane_extra *extra = &l->extras[i];
    const hyk_shadow *s = &l->shadows[i];
    const hyk_path *next = &l->paths[i];
    hyk_vec3 direct = l->radiance[i].radiance;
    bool surface = extra->first.depth >= 0;
    *to++ = !hyk_is_black(extra->caustic) ? HYK_COMPONENT_CAUSTIC : !hyk_is_black(extra->indirect) ? HYK_COMPONENT_INDIRECT : HYK_COMPONENT_DIRECT;
    *to++ = (l->radiance[i].flags & HYK_LANE_INSIDE) != 0;
    *to++ = shadow;
    *to++ = shadow ? s->diffuse_component : 0;
    *to++ = shadow ? s->specular_component : 0;
    *to++ = goes_on;
    *to++ = goes_on ? next->flags : 0;
    *to++ = goes_on ? next->depth_left : 0;
    *to++ = goes_on ? next->bounce : 0;
    *to++ = surface;
    *to++ = surface ? extra->first.material : 0;
    tell3(&to, hyk_add(direct, hyk_add(extra->indirect, extra->caustic)), true);
    tell3(&to, extra->irradiance, true);
    tell3(&to, s->diffuse, shadow);
    tell3(&to, s->specular, shadow);
    tell3(&to, s->irradiance, shadow);
    tell3(&to, s->ray.origin, shadow);
    tell3(&to, s->ray.direction, shadow);
    tell1(&to, s->ray.t_max, shadow);
    tell3(&to, next->ray.origin, goes_on);
    tell3(&to, next->ray.direction, goes_on);
    tell3(&to, next->throughput, goes_on);
    tell1(&to, next->pdf, goes_on);
    tell3(&to, next->irradiance, goes_on);
    tell3(&to, next->normal, goes_on);
    tell1(&to, next->eta_scale, goes_on);
    tell1(&to, next->cone_width, goes_on);
    tell1(&to, next->cone_spread, goes_on);
    tell3(&to, extra->first.albedo, surface);
    tell3(&to, extra->first.normal, surface);
    tell3(&to, extra->first.position, surface);
}

static void run_shade(kernel_bench *b, uint32_t cases) {
    lanes *l = (lanes *)malloc(sizeof *l);
    fill_lanes(b, l, cases);
    shade_lanes(b, l);
    memset(b->results, 0xa5, sizeof b->results);
    for (uint32_t i = 0; i < cases; i++) tell_lane(l, i, b->results[i]);
    free(l);
}

/* ---- measuring */

/* The exact results of a case, and what becomes of them when inputs move. */
typedef struct truth {
    kt_case exact;
    double moves[KT_OUT_MOST]; /* by how much, for an ulp of inputs */
    bool undecided;
} truth;

typedef struct error {
    double plain, mixed;
} error;

static double larger(double a, double b) { return a > b ? a : b; }

static double ulp_of(double size) {
    int exponent;
    (void)frexp(size > (double)FLT_MIN ? size : (double)FLT_MIN, &exponent);
    return ldexp(1.0, exponent - 24);
}

static void move_inputs(const kernel_bench *b, uint32_t kernel, const uint32_t *in, double ulps, uint32_t draw, bool closely, kt_case *moved) {
    moved->in = in;
    moved->whole_vectors = closely;
    moved->ulps = ulps;
    moved->noise = draw;
    moved->view = ulps > 1 ? b->far[draw % VIEWS] : b->near[draw % VIEWS];
    kt_run_double(kernel, moved);
}

static bool same_kinds(const kt_case *a, const kt_case *b) { return a->written == b->written && !memcmp(a->kind, b->kind, a->written); }

/* Whether a whole number of the result has changed, or a real by far more than it does for an ulp. */
static bool has_jumped(const truth *t, const kt_case *moved) {
    for (uint32_t r = 0; r < t->exact.written; r++) {
        double by = fabs(moved->value[r] - t->exact.value[r]);
        if (t->exact.kind[r] == 'u' ? by != 0 : by > 30 * FAR_ULPS * (t->moves[r] + ulp_of(t->exact.size[r]))) return true;
    }
    return false;
}

static void find_truth(const kernel_bench *b, uint32_t kernel, const uint32_t *in, uint32_t draws, truth *t) {
    kt_case moved;
    memset(t, 0, sizeof *t);
    t->exact.in = in;
    t->exact.view = b->exact;
    kt_run_double(kernel, &t->exact);
    for (uint32_t i = 0; i < draws; i++) {
        move_inputs(b, kernel, in, 1, i, draws > DRAWS, &moved);
        assert_true(same_kinds(&t->exact, &moved));
        for (uint32_t r = 0; r < moved.written; r++) {
            double by = fabs(moved.value[r] - t->exact.value[r]);
            if (moved.kind[r] == 'u' && by != 0) t->undecided = true;
            if (by > t->moves[r]) t->moves[r] = by;
        }
    }
    for (uint32_t i = 0; i < draws && !t->undecided; i++) {
        move_inputs(b, kernel, in, FAR_ULPS, i, draws > DRAWS, &moved);
        t->undecided = has_jumped(t, &moved);
    }
}

typedef struct measured {
    error host, device;
    uint32_t undecided, loose, wholes, reals;
} measured;

static double value_of(char kind, uint32_t word) { return kind == 'u' ? (double)word : (double)hyk_bits_float(word); }

/* What a device may flush to zero is no error. */
static void add_error(error *e, const truth *t, uint32_t r, double value) {
    double by = fabs(value - t->exact.value[r]) - (double)FLT_MIN, ulp = ulp_of(t->exact.size[r]);
    if (!(by <= DBL_MAX)) by = DBL_MAX; /* NaN and infinity */
    e->plain = larger(e->plain, by / ulp);
    e->mixed = larger(e->mixed, by / (ulp + t->moves[r]));
}

/* One case; false: a whole number is not what it should be. */
static bool compare(measured *m, const truth *t, const kt_case *host, const uint32_t *device) {
    for (uint32_t r = 0; r < t->exact.written; r++) {
        char kind = t->exact.kind[r];
        double here = host->value[r], there = value_of(kind, device[r]);
        m->wholes += kind == 'u';
        m->reals += kind == 'r';
        if (kind == 'u' && (here != t->exact.value[r] || there != here)) return false;
        if (kind == 'u') continue;
        add_error(&m->host, t, r, here);
        add_error(&m->device, t, r, there);
    }
    return true;
}

static void fail_case(const char *name, const truth *t, const kt_case *host, const uint32_t *device, uint32_t i, const measured *m,
                      const kernel_rule *rule) {
    for (uint32_t k = 0; k < host->read; k++) print_error("  input %u: %08x %.9g\n", k, host->in[k], (double)hyk_bits_float(host->in[k]));
    for (uint32_t r = 0; r < host->written; r++)
        print_error("  result %u: %.9g in float, %.9g on the device, %.12g is exact, which moves by %.3g, size %.3g\n", r, host->value[r],
                    value_of(t->exact.kind[r], device[r]), t->exact.value[r], t->moves[r], t->exact.size[r]);
    fail_msg("%s, case %u: a whole number differs, or a real is off by %.4g, on the device by %.4g (bound %.4g); in ulps by %.4g and %.4g (bound %.4g)",
             name, i, m->host.mixed, m->device.mixed, rule->worst, m->host.plain, m->device.plain, rule->plain);
}

static bool is_wrong(const measured *m, const kernel_rule *rule) {
    return larger(m->host.mixed, m->device.mixed) > rule->worst || (rule->plain > 0 && larger(m->host.plain, m->device.plain) > rule->plain);
}

static void keep_larger(error *all, const error *one) {
    all->plain = larger(all->plain, one->plain);
    all->mixed = larger(all->mixed, one->mixed);
}

/* A case that looks wrong is looked at again, with many more draws: a comparison may have been decided by last bits. */
static void check_case(const kernel_bench *b, uint32_t kernel, const char *name, uint32_t i, measured *all) {
    const kernel_rule *rule = &rules[kernel];
    kt_case host;
    host.in = b->words[i];
    host.view = &b->scene->view;
    kt_run_here(kernel, &host);
    for (uint32_t draws = DRAWS;; draws = MANY_DRAWS) {
        truth t;
        measured m;
        memset(&m, 0, sizeof m);
        find_truth(b, kernel, b->words[i], draws, &t);
        assert_true(same_kinds(&t.exact, &host) && b->results[i][t.exact.written] == 0xa5a5a5a5u);
        if (t.undecided) {
            all->undecided++;
            return;
        }
        bool right = compare(&m, &t, &host, b->results[i]) && !is_wrong(&m, rule);
        bool loose = larger(m.host.mixed, m.device.mixed) > rule->mixed;
        if ((!right || loose) && draws < MANY_DRAWS) continue;
        if (!right) fail_case(name, &t, &host, b->results[i], i, &m, rule);
        all->loose += loose;
        keep_larger(&all->host, &m.host);
        keep_larger(&all->device, &m.device);
        all->wholes += m.wholes;
        all->reals += m.reals;
        return;
    }
}

/* By its name, so that a new kernel leaves the others' cases as they are (FNV-1a: Fowler, Noll, Vo). */
static uint64_t seed_of(const char *name) {
    uint64_t seed = 0xcbf29ce484222325u;
    while (*name) seed = (seed ^ (unsigned char)*name++) * 0x100000001b3u;
    return seed;
}

static void check_kernel(kernel_bench *b, uint32_t g, uint32_t number, uint32_t kernel, const char *name, void (*make)(input *)) {
    ht_rng rng = ht_rng_make(seed_of(name));
    const uint32_t cases = ht_pick(CASES_MOST, 500);
    const kernel_rule *rule = &rules[kernel];
    measured m;
    memset(&m, 0, sizeof m);
    memset(b->words, 0, sizeof b->words);
    for (uint32_t i = 0; i < cases; i++) {
        input in = {b->words[i], 0, i, &rng, b->scene};
        make(&in);
        assert_true(in.count <= KT_IN_MOST);
    }
    if (g < KT_GROUPS) run_on_device(b, g, number, cases);
    else run_shade(b, cases);
    for (uint32_t i = 0; i < cases; i++) check_case(b, kernel, name, i, &m);
    print_message("%-15s %6u %6u %5u %5u |%9.3g %9.3g %9.3g |%9.3g %9.3g %6.3g %6.3g\n", name, m.wholes, m.reals, m.undecided, m.loose,
                  m.host.plain, m.device.plain, rule->plain, m.host.mixed, m.device.mixed, rule->mixed, rule->worst);
    if (1000 * m.undecided > cases * rule->undecided) fail_msg("%s: %u of %u cases are undecided", name, m.undecided, cases);
    if (100 * m.loose > cases) fail_msg("%s: %u of %u cases are off by more than %.4g", name, m.loose, cases, rule->mixed);
}

#define CHECK(name) check_kernel(b, g, number++, KT_##name, #name, in_##name);
#define GROUP_TEST(group, title, LIST)                                                                                   \
    static void title(void **state) {                                                                                    \
        kernel_bench *b = (kernel_bench *)*state;                                                                                      \
        uint32_t g = group, number = 0;                                                                                  \
        print_message("%-15s %6s %6s %5s %5s |%9s %9s %9s |%9s %9s %6s %6s\n", "kernel", "wholes", "reals", "undec", "loose", "ulps", \
                      "device", "bound", "mixed", "device", "bound", "worst");                                           \
        LIST(CHECK)                                                                                                      \
    }
GROUP_TEST(0, test_vectors, KT_VECTOR)
GROUP_TEST(1, test_whole_numbers, KT_WHOLE)
GROUP_TEST(2, test_warps, KT_WARPS)
GROUP_TEST(3, test_optics, KT_OPTICS)
GROUP_TEST(4, test_images, KT_IMAGES)
GROUP_TEST(5, test_scattering, KT_BSDF)
GROUP_TEST(6, test_lights, KT_LIGHTS)
GROUP_TEST(7, test_surfaces_and_paths, KT_PATHS)
GROUP_TEST(KT_GROUPS, test_shading, KT_SHADE)

int hydra_test_vk_kernels(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_vectors), cmocka_unit_test(test_whole_numbers), cmocka_unit_test(test_warps),
        cmocka_unit_test(test_optics),  cmocka_unit_test(test_images),        cmocka_unit_test(test_scattering),
        cmocka_unit_test(test_lights),  cmocka_unit_test(test_surfaces_and_paths),
        cmocka_unit_test(test_shading),
    };
    return cmocka_run_group_tests_name("vk_kernels", tests, open_kernels, close_kernels);
}
