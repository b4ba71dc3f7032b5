/* demo.c: a box with a glass and a golden sphere, rendered, written as PNG, and what it cost

       cc -O2 -I.. demo.c -o demo -lm -lpthread && ./demo demo.png
       ./demo demo.png 300       the picture of the README: more seconds */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE = 480, CHECKER = 512, SUBDIVISIONS = 5 };

/* ---------------------------------------------------------------- a sphere of triangles */

typedef struct sphere {
    float (*points)[3]; /* on the unit sphere, so they are the normals too */
    uint32_t (*triangles)[3];
    uint32_t point_count, triangle_count;
} sphere;

static uint32_t add_point(sphere *s, float x, float y, float z) {
    float scale = 1.0f / sqrtf(x * x + y * y + z * z);
    s->points[s->point_count][0] = x * scale;
    s->points[s->point_count][1] = y * scale;
    s->points[s->point_count][2] = z * scale;
    return s->point_count++;
}

static uint32_t add_middle(sphere *s, uint32_t a, uint32_t b) {
    const float *p = s->points[a], *q = s->points[b];
    return add_point(s, p[0] + q[0], p[1] + q[1], p[2] + q[2]);
}

/* Each triangle becomes four. Corners may be doubled: the normals make the surface smooth all the same. */
static void subdivide(sphere *s) {
    uint32_t old = s->triangle_count;
    for (uint32_t i = 0; i < old; i++) {
        uint32_t a = s->triangles[i][0], b = s->triangles[i][1], c = s->triangles[i][2];
        uint32_t ab = add_middle(s, a, b), bc = add_middle(s, b, c), ca = add_middle(s, c, a);
        const uint32_t parts[4][3] = {{ab, bc, ca}, {a, ab, ca}, {ab, b, bc}, {ca, bc, c}};
        memcpy(s->triangles[i], parts[0], sizeof parts[0]);
        memcpy(s->triangles[s->triangle_count], parts[1], 3 * sizeof parts[0]);
        s->triangle_count += 3;
    }
}

/* Starts from the octahedron, counter-clockwise seen from outside. */
static hydra_mesh add_sphere(hydra_scene *scene) {
    static const uint32_t faces[8][3] = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    size_t triangles = 8u << (2 * SUBDIVISIONS);
    sphere s = {malloc(2 * triangles * sizeof *s.points), malloc(triangles * sizeof *s.triangles), 0, 8};
    hydra_mesh none = {0};
    if (s.points == NULL || s.triangles == NULL) return none;
    for (int axis = 0; axis < 3; axis++)
        for (int sign = 1; sign >= -1; sign -= 2)
            add_point(&s, axis == 0 ? (float)sign : 0.0f, axis == 1 ? (float)sign : 0.0f, axis == 2 ? (float)sign : 0.0f);
    memcpy(s.triangles, faces, sizeof faces);
    for (int i = 0; i < SUBDIVISIONS; i++) subdivide(&s);
    hydra_mesh mesh = hydra_scene_add_mesh(scene, &(hydra_mesh_desc){.positions = {s.points, 12, s.point_count},
                                                                     .normals = {s.points, 12, s.point_count},
                                                                     .indices = {s.triangles, 4, 3 * s.triangle_count},
                                                                     .instanced_only = true});
    free(s.points);
    free(s.triangles);
    return mesh;
}

static void place_sphere(hydra_scene *scene, hydra_mesh mesh, float x, float z, float radius, const hydra_material_desc *look) {
    hydra_instance_desc instance = {.mesh = mesh, .material = hydra_scene_add_material(scene, look)};
    const float center[3] = {x, radius, z};
    for (int row = 0; row < 3; row++) {
        instance.transform[5 * row] = radius;
        instance.transform[4 * row + 3] = center[row];
    }
    hydra_scene_add_instance(scene, &instance);
}

/* ---------------------------------------------------------------- the room */

static hydra_texture add_checker(hydra_scene *scene) {
    static uint8_t texels[CHECKER][CHECKER][4];
    for (int y = 0; y < CHECKER; y++)
        for (int x = 0; x < CHECKER; x++) {
            uint8_t shade = ((x / (CHECKER / 8) + y / (CHECKER / 8)) & 1) != 0 ? 214 : 150;
            texels[y][x][0] = texels[y][x][1] = texels[y][x][2] = shade;
            texels[y][x][3] = 255;
        }
    return hydra_scene_add_texture(scene, &(hydra_texture_desc){.texels = texels, .width = CHECKER, .height = CHECKER});
}

static hydra_material matte(hydra_scene *scene, float red, float green, float blue, hydra_texture texture) {
    return hydra_scene_add_material(scene, &(hydra_material_desc){.base_color = {red, green, blue}, .base_color_texture = texture});
}

/* Five walls, two triangles each; the front is open. x, z in -1..1, y in 0..2. */
static void add_room(hydra_scene *scene) {
    static const float corners[20][3] = {
        {-1, 0, 1},  {1, 0, 1},   {1, 0, -1},  {-1, 0, -1}, /* floor */
        {-1, 2, -1}, {1, 2, -1},  {1, 2, 1},   {-1, 2, 1},  /* ceiling */
        {-1, 0, -1}, {1, 0, -1},  {1, 2, -1},  {-1, 2, -1}, /* back */
        {-1, 0, 1},  {-1, 0, -1}, {-1, 2, -1}, {-1, 2, 1},  /* left */
        {1, 0, -1},  {1, 0, 1},   {1, 2, 1},   {1, 2, -1},  /* right */
    };
    float uvs[20][2];
    uint16_t triangles[10][3];
    hydra_material materials[10];
    hydra_texture none = {0};
    const hydra_material walls[5] = {matte(scene, 1, 1, 1, add_checker(scene)), matte(scene, 0.78f, 0.77f, 0.75f, none),
                                     matte(scene, 0.78f, 0.77f, 0.75f, none), matte(scene, 0.72f, 0.16f, 0.09f, none),
                                     matte(scene, 0.09f, 0.33f, 0.46f, none)};
    for (int i = 0; i < 10; i++) {
        const uint16_t first = (uint16_t)(4 * (i / 2)), odd = (uint16_t)(i & 1);
        triangles[i][0] = first;
        triangles[i][1] = (uint16_t)(first + 1 + odd);
        triangles[i][2] = (uint16_t)(first + 2 + odd);
        materials[i] = walls[i / 2];
    }
    for (int i = 0; i < 20; i++) {
        uvs[i][0] = 0.5f + 0.5f * corners[i][0];
        uvs[i][1] = 0.5f + 0.5f * corners[i][2];
    }
    hydra_scene_add_mesh(scene, &(hydra_mesh_desc){.positions = {corners, 12, 20},
                                                   .uvs = {uvs, 8, 20},
                                                   .indices = {triangles, 2, 30},
                                                   .triangle_materials = {materials, 0, 10}});
}

static void add_everything(hydra_scene *scene) {
    add_room(scene);
    hydra_mesh ball = add_sphere(scene);
    /* Gold: complex index of refraction at about 650, 550 and 450 nm (Johnson and Christy 1972). */
    place_sphere(scene, ball, -0.42f, -0.36f, 0.46f,
                 &(hydra_material_desc){
                     .kind = HYDRA_MATERIAL_CONDUCTOR, .roughness = 0.22f, .eta = {0.16f, 0.42f, 1.38f}, .k = {3.78f, 2.35f, 1.92f}});
    place_sphere(scene, ball, 0.44f, 0.22f, 0.38f,
                 &(hydra_material_desc){.kind = HYDRA_MATERIAL_DIELECTRIC, .ior = 1.5f, .absorption = {0.35f, 0.08f, 0.12f}});
    place_sphere(scene, ball, -0.20f, 0.58f, 0.17f,
                 &(hydra_material_desc){.kind = HYDRA_MATERIAL_METALLIC_ROUGHNESS,
                                        .base_color = {0.05f, 0.30f, 0.12f},
                                        .roughness = 0.5f,
                                        .clearcoat = 1.0f,
                                        .clearcoat_roughness = 0.05f});
    hydra_scene_add_light(scene, &(hydra_light_desc){.kind = HYDRA_LIGHT_RECT,
                                                     .color = {4.9f, 4.3f, 3.45f},
                                                     .position = {0, 1.998f, 0},
                                                     .axis_u = {0.68f, 0, 0},
                                                     .axis_v = {0, 0, 0.62f}});
}

/* ---------------------------------------------------------------- a PNG without compression */

static void put_u32(uint8_t *out, uint32_t value) {
    for (int i = 0; i < 4; i++) out[i] = (uint8_t)(value >> (24 - 8 * i));
}

static uint32_t crc32(const uint8_t *bytes, size_t count) {
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

/* Length, type, data, checksum of type and data. chunk has 8 bytes of room before the data and 4 behind. */
static bool write_chunk(FILE *file, const char *type, uint8_t *chunk, size_t count) {
    put_u32(chunk, (uint32_t)count);
    memcpy(chunk + 4, type, 4);
    put_u32(chunk + 8 + count, crc32(chunk + 4, count + 4));
    return fwrite(chunk, 1, count + 12, file) == count + 12;
}

/* zlib's wrapping of stored blocks: one for each row, which is shorter than 65536 bytes. */
static size_t store_rows(uint8_t *out, uint8_t (*rows)[1 + 3 * SIZE]) {
    uint8_t *at = out;
    uint32_t low = 1, high = 0; /* adler32 */
    const uint32_t length = 1 + 3 * SIZE;
    *at++ = 0x78;
    *at++ = 0x01;
    for (int y = 0; y < SIZE; y++) {
        const uint8_t head[5] = {y == SIZE - 1, (uint8_t)length, (uint8_t)(length >> 8), (uint8_t)~length, (uint8_t)(~length >> 8)};
        memcpy(at, head, 5);
        memcpy(at + 5, rows[y], length);
        at += 5 + length;
        for (uint32_t i = 0; i < length; i++) {
            low = (low + rows[y][i]) % 65521u;
            high = (high + low) % 65521u;
        }
    }
    put_u32(at, high << 16 | low);
    return (size_t)(at + 4 - out);
}

static bool write_png(const char *path, uint8_t (*rows)[1 + 3 * SIZE]) {
    static uint8_t chunk[64 + SIZE * (6 + 3 * SIZE)];
    FILE *file = fopen(path, "wb");
    if (file == NULL) return false;
    bool good = fwrite("\x89PNG\r\n\x1a\n", 1, 8, file) == 8;
    const uint8_t format[5] = {8, 2, 0, 0, 0}; /* 8 bits, RGB */
    put_u32(chunk + 8, SIZE);
    put_u32(chunk + 12, SIZE);
    memcpy(chunk + 16, format, 5);
    good = write_chunk(file, "IHDR", chunk, 13) && good;
    good = write_chunk(file, "IDAT", chunk, store_rows(chunk + 8, rows)) && good;
    good = write_chunk(file, "IEND", chunk, 0) && good;
    return fclose(file) == 0 && good;
}

/* Exposure, a filmic curve (K. Narkowicz's fit of ACES, 2016), sRGB. */
static uint8_t develop(float radiance) {
    float x = 0.55f * radiance;
    float y = x * (2.51f * x + 0.03f) / (x * (2.43f * x + 0.59f) + 0.14f);
    y = fminf(fmaxf(y, 0.0f), 1.0f);
    y = y <= 0.0031308f ? 12.92f * y : 1.055f * powf(y, 1.0f / 2.4f) - 0.055f;
    return (uint8_t)(255.0f * y + 0.5f);
}

static bool write_picture(hydra_render *render, const char *path) {
    static float pixels[SIZE][SIZE][3];
    static uint8_t rows[SIZE][1 + 3 * SIZE]; /* each row starts with its filter: none */
    if (hydra_render_read(render, HYDRA_RADIANCE, pixels, 0) != HYDRA_OK) return false;
    for (int y = 0; y < SIZE; y++)
        for (int i = 0; i < 3 * SIZE; i++) rows[y][1 + i] = develop(pixels[y][i / 3][i % 3]);
    return write_png(path, rows);
}

/* ---------------------------------------------------------------- what it cost */

static void print_costs(hydra_context *context, const hydra_scene *scene, hydra_render *render) {
    static const char *const isa_names[] = {"automatic", "scalar", "SSE4.2", "AVX2", "AVX-512", "NEON"};
    hydra_status status = hydra_render_status(render);
    hydra_scene_info info = {0};
    hydra_scene_get_info(scene, &info);
    double mega = 1e-6 / (status.seconds > 0.0 ? status.seconds : 1.0);
    double camera = (double)status.rays_camera * mega, bounce = (double)status.rays_bounce * mega;
    double shadow = (double)status.rays_shadow * mega;
    printf("picture          %d x %d, %llu triangles placed\n", SIZE, SIZE, (unsigned long long)info.placed_triangles);
    printf("time             %.2f s on %u threads (%s)\n", status.seconds, (unsigned)hydra_context_threads(context),
           isa_names[hydra_context_isa(context)]);
    printf("trees built in   %.1f ms\n", 1e3 * info.build_seconds);
    printf("samples a pixel  %.1f on average\n", status.samples);
    printf("million rays/s   %.2f: camera %.2f, bounce %.2f, shadow %.2f\n", camera + bounce + shadow, camera, bounce, shadow);
    printf("relative error   %.2f %%, 95 %% interval %.2f to %.2f %%\n", 100.0 * status.error, 100.0 * status.error_low,
           100.0 * status.error_high);
    printf("memory           %.1f MiB at most\n", (double)hydra_memory(context).bytes_peak / (1024.0 * 1024.0));
}

static hydra_result render_demo(hydra_context *context, hydra_scene *scene, const char *path, double seconds) {
    hydra_render *render = hydra_render_create(
        scene,
        &(hydra_render_desc){.width = SIZE,
                             .height = SIZE,
                             .sensor = {.position = {0, 1, 3.55f}, .target = {0, 1, 0}, .fov_y = 0.735f, .filter = HYDRA_FILTER_TENT},
                             .target_error = 0.03f,
                             .time_budget = seconds});
    hydra_result result = HYDRA_MORE;
    while (result == HYDRA_MORE) {
        result = hydra_render_step(render);
        hydra_status status = hydra_render_status(render);
        fprintf(stderr, "\r%3.0f %%  %.0f samples  ", 100.0 * status.fraction, status.samples);
    }
    fputs("\r                        \r", stderr);
    if (result == HYDRA_OK) print_costs(context, scene, render);
    if (result == HYDRA_OK && write_picture(render, path))
        printf("written          %s\n", path);
    else if (result == HYDRA_OK)
        result = HYDRA_ERROR_BUFFER;
    hydra_render_destroy(render);
    return result;
}

int main(int argc, char **argv) {
    const char *path = argc > 1 ? argv[1] : "demo.png";
    double seconds = argc > 2 ? atof(argv[2]) : 14.0;
    hydra_context *context = hydra_create(NULL);
    hydra_scene *scene = hydra_scene_create(context);
    add_everything(scene);
    hydra_result result = hydra_scene_commit(scene);
    if (result == HYDRA_OK) result = render_demo(context, scene, path, seconds);
    if (result == HYDRA_ERROR_BUFFER)
        fprintf(stderr, "demo: %s could not be written\n", path);
    else if (result != HYDRA_OK)
        fprintf(stderr, "demo: %s: %s\n", hydra_result_text(result), hydra_error_text(context));
    hydra_scene_destroy(scene);
    hydra_destroy(context);
    return result == HYDRA_OK ? 0 : 1;
}
