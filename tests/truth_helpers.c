#include "truth_helpers.h"

/* ---------------------------------------------------------------- vectors */

truth_v3 truth_v(double x, double y, double z) {
    truth_v3 v = {x, y, z};
    return v;
}
truth_v3 truth_add(truth_v3 a, truth_v3 b) { return truth_v(a.x + b.x, a.y + b.y, a.z + b.z); }
truth_v3 truth_sub(truth_v3 a, truth_v3 b) { return truth_v(a.x - b.x, a.y - b.y, a.z - b.z); }
truth_v3 truth_mul(truth_v3 a, double s) { return truth_v(a.x * s, a.y * s, a.z * s); }
truth_v3 truth_cross(truth_v3 a, truth_v3 b) {
    return truth_v(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
double truth_dot(truth_v3 a, truth_v3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
double truth_length(truth_v3 a) { return sqrt(truth_dot(a, a)); }
truth_v3 truth_unit(truth_v3 a) { return truth_mul(a, 1.0 / truth_length(a)); }

void truth_store(float to[3], truth_v3 v) {
    to[0] = (float)v.x;
    to[1] = (float)v.y;
    to[2] = (float)v.z;
}
truth_v3 truth_load(const float from[3]) { return truth_v((double)from[0], (double)from[1], (double)from[2]); }

/* ---------------------------------------------------------------- random numbers */

double truth_rng_unit(ht_rng *rng) { return (double)ht_u32(rng) * (1.0 / 4294967296.0); }

truth_v3 truth_rng_direction(ht_rng *rng) {
    double z = 1.0 - 2.0 * truth_rng_unit(rng), angle = 2.0 * TRUTH_PI * truth_rng_unit(rng);
    double r = sqrt(1.0 - z * z);
    return truth_v(r * cos(angle), r * sin(angle), z);
}

/* ---------------------------------------------------------------- poses */

truth_pose truth_pose_identity(void) {
    truth_pose pose = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}, 1.0};
    return pose;
}

truth_pose truth_pose_random(uint64_t seed, double scale, double offset) {
    ht_rng rng = ht_rng_make(seed);
    truth_pose pose;
    pose.z = truth_rng_direction(&rng);
    pose.x = truth_unit(truth_cross(truth_rng_direction(&rng), pose.z));
    pose.y = truth_cross(pose.z, pose.x);
    pose.scale = scale;
    pose.x = truth_mul(pose.x, scale);
    pose.y = truth_mul(pose.y, scale);
    pose.z = truth_mul(pose.z, scale);
    double span = 2.0 * offset * scale;
    pose.origin.x = span * (truth_rng_unit(&rng) - 0.5);
    pose.origin.y = span * (truth_rng_unit(&rng) - 0.5);
    pose.origin.z = span * (truth_rng_unit(&rng) - 0.5);
    return pose;
}

truth_v3 truth_pose_vector(const truth_pose *pose, truth_v3 v) {
    return truth_add(truth_add(truth_mul(pose->x, v.x), truth_mul(pose->y, v.y)), truth_mul(pose->z, v.z));
}
truth_v3 truth_pose_point(const truth_pose *pose, truth_v3 p) { return truth_add(truth_pose_vector(pose, p), pose->origin); }
truth_v3 truth_pose_direction(const truth_pose *pose, truth_v3 v) { return truth_mul(truth_pose_vector(pose, v), 1.0 / pose->scale); }

/* ---------------------------------------------------------------- meshes */

static void *allocate(size_t count, size_t size) {
    void *memory = calloc(count ? count : 1, size);
    assert_non_null(memory);
    return memory;
}

static truth_mesh mesh_empty(uint32_t vertices, uint32_t triangles) {
    truth_mesh mesh;
    mesh.positions = (float *)allocate(3 * (size_t)vertices, sizeof(float));
    mesh.indices = (uint32_t *)allocate(3 * (size_t)triangles, sizeof(uint32_t));
    mesh.normals = NULL;
    mesh.uvs = NULL;
    mesh.vertices = vertices;
    mesh.triangles = triangles;
    return mesh;
}

static void set_triangle(truth_mesh *mesh, uint32_t triangle, uint32_t a, uint32_t b, uint32_t c) {
    mesh->indices[3 * triangle] = a;
    mesh->indices[3 * triangle + 1] = b;
    mesh->indices[3 * triangle + 2] = c;
}

truth_mesh truth_mesh_quad(truth_v3 centre, truth_v3 half_u, truth_v3 half_v, uint32_t cells) {
    uint32_t row = cells + 1;
    truth_mesh mesh = mesh_empty(row * row, 2 * cells * cells);
    mesh.uvs = (float *)allocate(2 * (size_t)mesh.vertices, sizeof(float));
    for (uint32_t j = 0; j < row; j++)
        for (uint32_t i = 0; i < row; i++) {
            double u = (double)i / cells, v = (double)j / cells;
            truth_v3 p = truth_add(centre, truth_add(truth_mul(half_u, 2 * u - 1), truth_mul(half_v, 2 * v - 1)));
            truth_store(&mesh.positions[3 * (j * row + i)], p);
            mesh.uvs[2 * (j * row + i)] = (float)u;
            mesh.uvs[2 * (j * row + i) + 1] = (float)v;
        }
    for (uint32_t j = 0; j < cells; j++)
        for (uint32_t i = 0; i < cells; i++) {
            uint32_t a = j * row + i, t = 2 * (j * cells + i);
            set_triangle(&mesh, t, a, a + 1, a + row + 1);
            set_triangle(&mesh, t + 1, a, a + row + 1, a + row);
        }
    return mesh;
}

truth_mesh truth_mesh_box(truth_v3 centre, truth_v3 half, bool inward) {
    static const double axes[6][3][3] = {/* normal, then u and v with cross(u, v) = normal */
                                         {{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},  {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                         {{0, -1, 0}, {1, 0, 0}, {0, 0, 1}},  {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},
                                         {{0, 0, -1}, {0, 1, 0}, {1, 0, 0}},  {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}};
    truth_mesh mesh = mesh_empty(24, 12);
    for (uint32_t f = 0; f < 6; f++) {
        for (uint32_t c = 0; c < 4; c++) {
            double su = c == 1 || c == 2 ? 1 : -1, sv = c >= 2 ? 1 : -1, p[3];
            for (int k = 0; k < 3; k++) p[k] = axes[f][0][k] + su * axes[f][1][k] + sv * axes[f][2][k];
            truth_store(&mesh.positions[3 * (4 * f + c)],
                        truth_add(centre, truth_v(p[0] * half.x, p[1] * half.y, p[2] * half.z)));
        }
        uint32_t a = 4 * f, second = inward ? 2u : 1u, third = inward ? 1u : 2u;
        set_triangle(&mesh, 2 * f, a, a + second, a + third);
        second = inward ? 3u : 2u;
        third = inward ? 2u : 3u;
        set_triangle(&mesh, 2 * f + 1, a, a + second, a + third);
    }
    return mesh;
}

static truth_mesh mesh_icosahedron(void) {
    static const double g = 1.6180339887498949;
    static const uint8_t faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                                         {11, 10, 2}, {10, 7, 6}, {7, 1, 8},   {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                                         {3, 8, 9},  {4, 9, 5},  {2, 4, 11},  {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    const double at[12][3] = {{-1, g, 0}, {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                              {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    truth_mesh mesh = mesh_empty(60, 20);
    for (uint32_t f = 0; f < 20; f++)
        for (uint32_t c = 0; c < 3; c++) {
            const double *p = at[faces[f][c]];
            truth_store(&mesh.positions[9 * f + 3 * c], truth_unit(truth_v(p[0], p[1], p[2])));
            mesh.indices[3 * f + c] = 3 * f + c;
        }
    return mesh;
}

/* Corners, then the middles of the edges: four triangles for each. Middles of a shared edge get the same bits
   because the sum of two floats does not depend on their order. */
static truth_mesh mesh_divide(const truth_mesh *coarse) {
    static const uint8_t parts[4][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}};
    truth_mesh mesh = mesh_empty(12 * coarse->triangles, 4 * coarse->triangles);
    for (uint32_t t = 0; t < coarse->triangles; t++) {
        truth_v3 p[6];
        for (int k = 0; k < 3; k++) p[k] = truth_load(&coarse->positions[9 * t + 3 * (uint32_t)k]);
        for (int k = 0; k < 3; k++) p[3 + k] = truth_unit(truth_add(p[k], p[(k + 1) % 3]));
        for (uint32_t q = 0; q < 12; q++) {
            truth_store(&mesh.positions[36 * t + 3 * q], p[parts[q / 3][q % 3]]);
            mesh.indices[12 * t + q] = 12 * t + q;
        }
    }
    return mesh;
}

truth_mesh truth_mesh_sphere(truth_v3 centre, double radius, unsigned level, bool inward) {
    truth_mesh mesh = mesh_icosahedron();
    for (unsigned l = 0; l < level; l++) {
        truth_mesh fine = mesh_divide(&mesh);
        truth_mesh_free(&mesh);
        mesh = fine;
    }
    for (uint32_t i = 0; i < mesh.vertices; i++)
        truth_store(&mesh.positions[3 * i], truth_add(centre, truth_mul(truth_load(&mesh.positions[3 * i]), radius)));
    for (uint32_t t = 0; inward && t < mesh.triangles; t++) {
        uint32_t swap = mesh.indices[3 * t];
        mesh.indices[3 * t] = mesh.indices[3 * t + 1];
        mesh.indices[3 * t + 1] = swap;
    }
    return mesh;
}

truth_mesh truth_mesh_soup(uint64_t seed, uint32_t count) {
    ht_rng rng = ht_rng_make(seed);
    truth_mesh mesh = mesh_empty(3 * count, count);
    for (uint32_t t = 0; t < count; t++) {
        truth_v3 at = truth_v(truth_rng_unit(&rng), truth_rng_unit(&rng), truth_rng_unit(&rng));
        for (uint32_t c = 0; c < 3; c++) {
            truth_store(&mesh.positions[9 * t + 3 * c], truth_add(at, truth_mul(truth_rng_direction(&rng), 0.15)));
            mesh.indices[3 * t + c] = 3 * t + c;
        }
    }
    return mesh;
}

void truth_mesh_pose(truth_mesh *mesh, const truth_pose *pose) {
    for (uint32_t i = 0; i < mesh->vertices; i++)
        truth_store(&mesh->positions[3 * i], truth_pose_point(pose, truth_load(&mesh->positions[3 * i])));
    for (uint32_t i = 0; mesh->normals && i < mesh->vertices; i++)
        truth_store(&mesh->normals[3 * i], truth_pose_direction(pose, truth_load(&mesh->normals[3 * i])));
}

void truth_mesh_free(truth_mesh *mesh) {
    free(mesh->positions);
    free(mesh->normals);
    free(mesh->uvs);
    free(mesh->indices);
    memset(mesh, 0, sizeof *mesh);
}

static void mesh_corners(const truth_mesh *mesh, uint32_t triangle, truth_v3 p[3]) {
    for (uint32_t k = 0; k < 3; k++) p[k] = truth_load(&mesh->positions[3 * mesh->indices[3 * triangle + k]]);
}

static truth_v3 mesh_cross(const truth_mesh *mesh, uint32_t triangle) {
    truth_v3 p[3];
    mesh_corners(mesh, triangle, p);
    return truth_cross(truth_sub(p[1], p[0]), truth_sub(p[2], p[0]));
}

double truth_mesh_area(const truth_mesh *mesh) {
    double area = 0;
    for (uint32_t t = 0; t < mesh->triangles; t++) area += 0.5 * truth_length(mesh_cross(mesh, t));
    return area;
}

void truth_mesh_sample(const truth_mesh *mesh, ht_rng *rng, float point[3], float normal[3]) {
    double left = truth_rng_unit(rng) * truth_mesh_area(mesh);
    uint32_t t = 0;
    for (; t + 1 < mesh->triangles; t++) {
        double area = 0.5 * truth_length(mesh_cross(mesh, t));
        if (left < area) break;
        left -= area;
    }
    truth_v3 p[3];
    mesh_corners(mesh, t, p);
    double s = sqrt(truth_rng_unit(rng)), v = truth_rng_unit(rng);
    truth_v3 at = truth_add(truth_mul(p[0], 1 - s), truth_add(truth_mul(p[1], s * (1 - v)), truth_mul(p[2], s * v)));
    truth_store(point, at);
    truth_store(normal, truth_unit(mesh_cross(mesh, t)));
}

hydra_mesh_desc truth_mesh_desc(const truth_mesh *mesh, hydra_material material) {
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions.data = mesh->positions;
    desc.positions.count = mesh->vertices;
    desc.normals.data = mesh->normals;
    desc.normals.count = mesh->normals ? mesh->vertices : 0;
    desc.uvs.data = mesh->uvs;
    desc.uvs.count = mesh->uvs ? mesh->vertices : 0;
    desc.indices.data = mesh->indices;
    desc.indices.count = 3 * (size_t)mesh->triangles;
    desc.material = material;
    return desc;
}

hydra_mesh truth_scene_mesh(hydra_scene *scene, truth_mesh mesh, hydra_material material) {
    hydra_mesh_desc desc = truth_mesh_desc(&mesh, material);
    hydra_mesh added = hydra_scene_add_mesh(scene, &desc);
    truth_mesh_free(&mesh);
    assert_int_not_equal(added.id, 0);
    return added;
}

hydra_material truth_emitter(hydra_scene *scene, double albedo, double radiance) {
    hydra_material_desc desc;
    memset(&desc, 0, sizeof desc);
    for (int c = 0; c < 3; c++) {
        desc.base_color[c] = (float)albedo;
        desc.emission[c] = (float)radiance;
    }
    hydra_material added = hydra_scene_add_material(scene, &desc);
    assert_int_not_equal(added.id, 0);
    return added;
}

hydra_material truth_lambert(hydra_scene *scene, double albedo) { return truth_emitter(scene, albedo, 0); }

/* ---------------------------------------------------------------- worlds */

void truth_open_with(truth_world *world, const hydra_context_desc *given) {
    hydra_context_desc desc;
    memset(world, 0, sizeof *world);
    memset(&desc, 0, sizeof desc);
    if (given) desc = *given;
    world->context = ht_open(&world->host, &desc);
    assert_non_null(world->context);
    world->scene = hydra_scene_create(world->context);
    assert_non_null(world->scene);
}

void truth_open(truth_world *world) { truth_open_with(world, NULL); }

void truth_commit(truth_world *world) { TRUTH_RESULT(world->context, hydra_scene_commit(world->scene), HYDRA_OK); }

void truth_close(truth_world *world) {
    TRUTH_RESULT(world->context, hydra_scene_destroy(world->scene), HYDRA_OK);
    ht_close(&world->host);
}

/* ---------------------------------------------------------------- quick mode */

uint32_t truth_samples(uint32_t samples) {
    uint32_t less = ht_quick() ? samples / 5 & ~1u : samples & ~1u;
    return less < 2 ? 2 : less;
}
uint32_t truth_seeds(uint32_t seeds) { return ht_quick() ? (seeds + 4) / 5 : seeds; }
double truth_bound(double bound) { return ht_quick() ? bound * 4 : bound; } /* a fifth of the samples, with errors up to N^-0.85 */

/* ---------------------------------------------------------------- renders */

void truth_run(hydra_render *render) {
    hydra_result result = HYDRA_MORE;
    while (result == HYDRA_MORE) result = hydra_render_step(render);
    TRUTH_RESULT(NULL, result, HYDRA_OK);
}

hydra_render *truth_render(hydra_scene *scene, const hydra_render_desc *desc) {
    hydra_render *render = hydra_render_create(scene, desc);
    if (!render) fail_msg("hydra_render_create returned NULL");
    truth_run(render);
    return render;
}

float *truth_read(hydra_render *render, hydra_output output, size_t pixels) {
    size_t size = hydra_output_size(output);
    float *values = (float *)allocate(pixels, size);
    TRUTH_RESULT(NULL, hydra_render_read(render, output, values, 0), HYDRA_OK);
    for (size_t i = 0; i < pixels * size / sizeof(float); i++) assert_true(values[i] == values[i]); /* never a NaN */
    return values;
}

uint32_t *truth_read_words(hydra_render *render, hydra_output output, size_t pixels) {
    uint32_t *values = (uint32_t *)allocate(pixels, sizeof *values);
    assert_int_equal(hydra_output_size(output), sizeof *values);
    TRUTH_RESULT(NULL, hydra_render_read(render, output, values, 0), HYDRA_OK);
    return values;
}

hydra_sensor_desc truth_sensor_points(const float *positions, const float *normals, size_t count) {
    hydra_sensor_desc sensor;
    memset(&sensor, 0, sizeof sensor);
    sensor.kind = HYDRA_SENSOR_POINTS;
    sensor.point_positions.data = positions;
    sensor.point_positions.count = count;
    sensor.point_normals.data = normals;
    sensor.point_normals.count = count;
    return sensor;
}

hydra_sensor_desc truth_sensor_pinhole(truth_v3 position, truth_v3 target, double fov_y) {
    hydra_sensor_desc sensor;
    memset(&sensor, 0, sizeof sensor);
    sensor.kind = HYDRA_SENSOR_PINHOLE;
    truth_store(sensor.position, position);
    truth_store(sensor.target, target);
    sensor.fov_y = (float)fov_y;
    return sensor;
}

hydra_light_desc truth_light(hydra_light_kind kind, double value) {
    hydra_light_desc light;
    memset(&light, 0, sizeof light);
    light.kind = kind;
    for (int c = 0; c < 3; c++) light.color[c] = (float)value;
    return light;
}

/* ---------------------------------------------------------------- estimates */

truth_estimate truth_estimate_of(const double *values, size_t count) {
    truth_estimate e = {0, 0};
    for (size_t i = 0; i < count; i++) e.mean += values[i] / (double)count;
    for (size_t i = 0; i < count; i++) e.error += (values[i] - e.mean) * (values[i] - e.mean);
    e.error = sqrt(e.error / ((double)(count - 1) * (double)count));
    return e;
}

truth_estimate truth_estimate_channel(const float *rgb, size_t pixels, unsigned channel) {
    double *values = (double *)allocate(pixels, sizeof *values);
    for (size_t i = 0; i < pixels; i++) values[i] = (double)rgb[3 * i + channel];
    truth_estimate e = truth_estimate_of(values, pixels);
    free(values);
    return e;
}

static truth_estimate probe_sensor(hydra_scene *scene, const hydra_sensor_desc *sensor, truth_probe probe) {
    hydra_render_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.sensor = *sensor;
    desc.width = 16;
    desc.height = TRUTH_PROBES / 16;
    desc.max_samples = probe.samples;
    desc.max_depth = probe.max_depth;
    desc.strategy = probe.strategy;
    desc.seed = probe.seed;
    desc.outputs = 1u << probe.output;
    desc.step_seconds = 10;
    hydra_render *render = truth_render(scene, &desc);
    float *rgb = truth_read(render, probe.output, TRUTH_PROBES);
    truth_estimate e = truth_estimate_channel(rgb, TRUTH_PROBES, 0);
    free(rgb);
    hydra_render_destroy(render);
    return e;
}

truth_estimate truth_irradiance(hydra_scene *scene, truth_v3 point, truth_v3 normal, truth_probe probe) {
    float positions[3 * TRUTH_PROBES], normals[3 * TRUTH_PROBES];
    for (int i = 0; i < TRUTH_PROBES; i++) {
        truth_store(&positions[3 * i], point);
        truth_store(&normals[3 * i], normal);
    }
    hydra_sensor_desc sensor = truth_sensor_points(positions, normals, TRUTH_PROBES);
    return probe_sensor(scene, &sensor, probe);
}

truth_estimate truth_radiance(hydra_scene *scene, truth_v3 origin, truth_v3 direction, truth_probe probe) {
    hydra_ray rays[TRUTH_PROBES];
    for (int i = 0; i < TRUTH_PROBES; i++) {
        truth_store(rays[i].origin, origin);
        truth_store(rays[i].direction, direction);
        rays[i].t_min = 0;
        rays[i].t_max = INFINITY;
    }
    hydra_sensor_desc sensor;
    memset(&sensor, 0, sizeof sensor);
    sensor.kind = HYDRA_SENSOR_RAYS;
    sensor.rays.data = rays;
    sensor.rays.count = TRUTH_PROBES;
    return probe_sensor(scene, &sensor, probe);
}

truth_estimate truth_mesh_irradiance(hydra_scene *scene, const truth_mesh *mesh, truth_probe probe) {
    float positions[3 * TRUTH_PROBES], normals[3 * TRUTH_PROBES];
    ht_rng rng = ht_rng_make(probe.seed + 77u);
    for (int i = 0; i < TRUTH_PROBES; i++) truth_mesh_sample(mesh, &rng, &positions[3 * i], &normals[3 * i]);
    hydra_sensor_desc sensor = truth_sensor_points(positions, normals, TRUTH_PROBES);
    return probe_sensor(scene, &sensor, probe);
}

/* ---------------------------------------------------------------- verdicts */

void truth_expect_at(const char *file, int line, const char *what, truth_estimate e, double truth, double bound, double slack) {
    double away = fabs(e.mean - truth), size = fabs(truth);
    if (getenv("HYDRA_TEST_VERBOSE"))
        print_message("    %s: %.6g, truth %.6g, off %.4f%%, %.2f errors of %.4f%%\n", what, e.mean, truth,
                      100 * (e.mean / truth - 1), e.error > 0 ? away / e.error : 0.0, 100 * e.error / size);
    if (!(away <= 4 * e.error + slack * size)) {
        print_error("%s: %.9g, truth %.9g: off by %.3g (%.3g of it), %.1f standard errors\n", what, e.mean, truth,
                    e.mean - truth, away / size, away / e.error);
        _fail(file, line);
    }
    if (!(e.error <= bound * size)) {
        print_error("%s: relative standard error %.3g above the bound %.3g\n", what, e.error / size, bound);
        _fail(file, line);
    }
}

void truth_close_at(const char *file, int line, const char *what, double value, double truth, double relative) {
    if (fabs(value - truth) <= relative * fabs(truth)) return;
    print_error("%s: %.9g, truth %.9g: off by %.3g of it, allowed %.3g\n", what, value, truth, value / truth - 1, relative);
    _fail(file, line);
}

void truth_within_at(const char *file, int line, const char *what, double value, double low, double high) {
    if (getenv("HYDRA_TEST_VERBOSE")) print_message("    %s: %.6g in %.6g .. %.6g\n", what, value, low, high);
    if (value >= low && value <= high) return;
    print_error("%s: %.9g is outside %.9g .. %.9g\n", what, value, low, high);
    _fail(file, line);
}

void truth_result_at(const char *file, int line, hydra_context *context, hydra_result got, hydra_result wanted) {
    if (got == wanted) return;
    print_error("result is \"%s\", wanted \"%s\"; message: %s\n", hydra_result_text(got), hydra_result_text(wanted),
                context ? hydra_error_text(context) : "-");
    _fail(file, line);
}

/* ---------------------------------------------------------------- formulas */

/* The part of the polygon above the plane of the receiver: Sutherland-Hodgman against one plane. */
static unsigned clip_to_horizon(const truth_v3 *in, unsigned count, truth_v3 normal, truth_v3 *out) {
    unsigned kept = 0;
    for (unsigned i = 0; i < count; i++) {
        truth_v3 a = in[i], b = in[(i + 1) % count];
        double da = truth_dot(a, normal), db = truth_dot(b, normal);
        if (da >= 0) out[kept++] = a;
        if ((da > 0 && db < 0) || (da < 0 && db > 0)) out[kept++] = truth_add(a, truth_mul(truth_sub(b, a), da / (da - db)));
    }
    return kept;
}

double truth_polygon_irradiance(const truth_v3 *corners, unsigned count, truth_v3 point, truth_v3 normal, double radiance) {
    truth_v3 moved[TRUTH_CORNERS], above[2 * TRUTH_CORNERS];
    normal = truth_unit(normal);
    for (unsigned i = 0; i < count; i++) moved[i] = truth_sub(corners[i], point);
    unsigned kept = clip_to_horizon(moved, count, normal, above);
    double sum = 0;
    for (unsigned i = 0; i < kept; i++) {
        truth_v3 a = above[i], b = above[(i + 1) % kept], c = truth_cross(a, b);
        double sine = truth_length(c);
        if (sine > 0) sum += atan2(sine, truth_dot(a, b)) * truth_dot(normal, c) / sine;
    }
    return 0.5 * radiance * fabs(sum);
}

double truth_fresnel(double cosine, double n) {
    double sine2 = (1 - cosine * cosine) / (n * n);
    if (sine2 >= 1) return 1;
    double inside = sqrt(1 - sine2);
    double s = (cosine - n * inside) / (cosine + n * inside), p = (n * cosine - inside) / (n * cosine + inside);
    return 0.5 * (s * s + p * p);
}

double truth_fresnel_conductor(double cosine, double eta, double k) {
    double c2 = cosine * cosine, s2 = 1 - c2, t0 = eta * eta - k * k - s2;
    double a2b2 = sqrt(t0 * t0 + 4 * eta * eta * k * k), a = sqrt(0.5 * (a2b2 + t0));
    double rs = (a2b2 + c2 - 2 * cosine * a) / (a2b2 + c2 + 2 * cosine * a);
    double x = c2 * a2b2 + s2 * s2, y = 2 * cosine * a * s2;
    return 0.5 * (rs + rs * (x - y) / (x + y));
}
