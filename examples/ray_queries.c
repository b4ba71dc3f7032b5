/* ray_queries.c: rays on their own: picking, lines of sight, and how open the sky is

       cc -I.. ray_queries.c -o ray_queries -lm -lpthread */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SKY_RAYS = 1024 };

typedef struct named_mesh {
    hydra_mesh mesh;
    const char *name;
} named_mesh;

/* An axis-aligned box without sharing corners, so that faces stay flat. */
static hydra_mesh add_box(hydra_scene *scene, const float low[3], const float high[3]) {
    float corners[8][3];
    static const uint16_t faces[] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                     2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
    for (int i = 0; i < 8; i++)
        for (int axis = 0; axis < 3; axis++) corners[i][axis] = (i >> axis & 1) != 0 ? high[axis] : low[axis];
    return hydra_scene_add_mesh(scene, &(hydra_mesh_desc){.positions = {corners, 12, 8}, .indices = {faces, 2, 36}});
}

static const char *name_of(const named_mesh *meshes, uint32_t id) {
    for (; meshes->name != NULL; meshes++)
        if (meshes->mesh.id == id) return meshes->name;
    return "nothing";
}

/* What lies under the mouse: one ray from the eye through a point of the screen. */
static void pick(const hydra_scene *scene, const named_mesh *meshes, const float eye[3], const float towards[3]) {
    hydra_ray ray = {{eye[0], eye[1], eye[2]}, 0.0f, {towards[0] - eye[0], towards[1] - eye[1], towards[2] - eye[2]}, INFINITY};
    hydra_hit hit;
    hydra_scene_closest_hits(scene, &ray, &hit, 1);
    printf("  towards (%5.2f, %5.2f, %5.2f): %s", (double)towards[0], (double)towards[1], (double)towards[2], name_of(meshes, hit.mesh));
    if (hit.t >= 0.0f)
        printf(", triangle %u at (%.3f, %.3f, %.3f), normal (%.0f, %.0f, %.0f)", (unsigned)hit.primitive,
               (double)(eye[0] + hit.t * ray.direction[0]), (double)(eye[1] + hit.t * ray.direction[1]),
               (double)(eye[2] + hit.t * ray.direction[2]), (double)hit.normal[0], (double)hit.normal[1], (double)hit.normal[2]);
    putchar('\n');
}

/* Whether two points see each other: the direction is the way between them, so the ray ends at t = 1. */
static void sight(const hydra_scene *scene, const float from[3], const float to[3]) {
    hydra_ray ray = {{from[0], from[1], from[2]}, 0.0f, {to[0] - from[0], to[1] - from[1], to[2] - from[2]}, 1.0f};
    uint8_t blocked;
    hydra_scene_any_hits(scene, &ray, &blocked, 1);
    printf("  (%5.2f, %5.2f, %5.2f) to (%5.2f, %5.2f, %5.2f): %s\n", (double)from[0], (double)from[1], (double)from[2], (double)to[0],
           (double)to[1], (double)to[2], blocked ? "blocked" : "visible");
}

/* The share of the sky that lights a point of the floor: many rays in one call. Directions are spread on the disc below
   the hemisphere by a golden-angle spiral, which makes them cosine-weighted (Malley's method). */
static void sky(const hydra_scene *scene, const float point[3]) {
    static hydra_ray rays[SKY_RAYS];
    static uint8_t blocked[SKY_RAYS];
    int open = 0;
    for (int i = 0; i < SKY_RAYS; i++) {
        float square = ((float)i + 0.5f) / SKY_RAYS, radius = sqrtf(square), angle = 2.39996323f * (float)i;
        rays[i] = (hydra_ray){
            {point[0], point[1], point[2]}, 1e-4f, {radius * cosf(angle), sqrtf(1.0f - square), radius * sinf(angle)}, INFINITY};
    }
    hydra_scene_any_hits(scene, rays, blocked, SKY_RAYS);
    for (int i = 0; i < SKY_RAYS; i++) open += blocked[i] == 0;
    printf("  (%5.2f, %5.2f, %5.2f): %5.1f %%\n", (double)point[0], (double)point[1], (double)point[2], 100.0 * open / SKY_RAYS);
}

static void ask(const hydra_scene *scene, const named_mesh *meshes) {
    const float eye[3] = {0, 2, 6};
    puts("Picking from (0, 2, 6)");
    pick(scene, meshes, eye, (const float[3]){-1, 1, 0});
    pick(scene, meshes, eye, (const float[3]){1, 0.5f, 0});
    pick(scene, meshes, eye, (const float[3]){0, 0, 1});
    pick(scene, meshes, eye, (const float[3]){0, 5, 0});
    puts("Lines of sight");
    sight(scene, (const float[3]){-3, 1, 0}, (const float[3]){3, 1, 0});
    sight(scene, (const float[3]){-3, 3, 0}, (const float[3]){3, 3, 0});
    sight(scene, (const float[3]){0, 1, -3}, (const float[3]){0, 1, 3});
    puts("Open sky, cosine-weighted");
    sky(scene, (const float[3]){-1, 0, 0.7f});
    sky(scene, (const float[3]){0, 0, 0});
    sky(scene, (const float[3]){4, 0, 4});
}

int main(void) {
    hydra_context *context = hydra_create(NULL);
    hydra_scene *scene = hydra_scene_create(context);
    const named_mesh meshes[] = {
        {add_box(scene, (const float[3]){-5, -1, -5}, (const float[3]){5, 0, 5}), "floor"},
        {add_box(scene, (const float[3]){-1.5f, 0, -0.5f}, (const float[3]){-0.5f, 2, 0.5f}), "tower"},
        {add_box(scene, (const float[3]){0.5f, 0, -0.5f}, (const float[3]){1.5f, 1, 0.5f}), "crate"},
        {{0}, NULL},
    };
    const hydra_result result = hydra_scene_commit(scene);
    if (result == HYDRA_OK)
        ask(scene, meshes);
    else
        puts(hydra_error_text(context));
    hydra_scene_destroy(scene);
    hydra_destroy(context);
    return result == HYDRA_OK ? 0 : 1;
}
