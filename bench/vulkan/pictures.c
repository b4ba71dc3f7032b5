/* Scenes for path tracing: a box with a lamp, few triangles and much light between them; and trees under sun and sky,
   many triangles and short paths. */
#include "bench.h"

#include <math.h>

static hydra_material lambert(hydra_scene *scene, float r, float g, float b) {
    return hydra_scene_add_material(scene, &(hydra_material_desc){.base_color = {r, g, b}});
}

/* From a corner and two edges; faces cross(u, v). */
static void add_wall(hydra_scene *scene, const float corner[3], const float u[3], const float v[3], hydra_material material) {
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    float corners[4][3];
    for (int k = 0; k < 3; k++) {
        corners[0][k] = corner[k];
        corners[1][k] = corner[k] + u[k];
        corners[2][k] = corner[k] + u[k] + v[k];
        corners[3][k] = corner[k] + v[k];
    }
    hydra_mesh_desc mesh = {.positions = {corners, 12, 4}, .indices = {indices, 4, 6}, .material = material};
    hydra_scene_add_mesh(scene, &mesh);
}

/* A block on the floor, turned about the vertical: four sides and a lid. */
static void add_block(hydra_scene *scene, float x, float z, float half, float height, float angle, hydra_material material) {
    const float up[3] = {0, height, 0};
    float corner[5][3];
    for (int i = 0; i < 5; i++) {
        float a = angle + 1.57079633f * ((float)i + 0.5f), reach = 1.41421356f * half;
        corner[i][0] = x + reach * sinf(a), corner[i][1] = 0.0f, corner[i][2] = z + reach * cosf(a);
    }
    float lid[3] = {corner[0][0], height, corner[0][2]}, across[2][3];
    for (int i = 0; i < 4; i++) {
        float along[3] = {corner[i + 1][0] - corner[i][0], 0, corner[i + 1][2] - corner[i][2]};
        add_wall(scene, corner[i], along, up, material);
    }
    for (int k = 0; k < 3; k++) across[0][k] = corner[1][k] - corner[0][k], across[1][k] = corner[3][k] - corner[0][k];
    add_wall(scene, lid, across[0], across[1], material);
}

void make_box(hydra_scene *scene, const void *unused) {
    (void)unused;
    hydra_material white = lambert(scene, 0.73f, 0.73f, 0.73f);
    const float low[3] = {-1, 0, -1}, front[3] = {-1, 0, 1}, right[3] = {1, 0, 1}, top[3] = {-1, 2, -1};
    const float x[3] = {2, 0, 0}, y[3] = {0, 2, 0}, z[3] = {0, 0, 2}, back_z[3] = {0, 0, -2};
    add_wall(scene, low, z, x, white);
    add_wall(scene, top, x, z, white);
    add_wall(scene, low, x, y, white);
    add_wall(scene, front, back_z, y, lambert(scene, 0.63f, 0.065f, 0.05f));
    add_wall(scene, right, y, back_z, lambert(scene, 0.14f, 0.45f, 0.091f));
    add_block(scene, -0.33f, -0.3f, 0.3f, 1.2f, 0.3f, white);
    add_block(scene, 0.35f, 0.35f, 0.3f, 0.6f, -0.3f, white);
    hydra_light_desc lamp = {
        .kind = HYDRA_LIGHT_RECT, .color = {17, 12, 4}, .position = {0, 1.98f, 0}, .axis_u = {0.25f, 0, 0}, .axis_v = {0, 0, 0.2f}};
    hydra_scene_add_light(scene, &lamp);
}

void make_outdoors(hydra_scene *scene, const void *what) {
    const geometry *g = what;
    hydra_mesh_desc mesh = {.positions = {g->positions, 12, g->vertices}, .indices = {g->indices, 4, 3 * g->triangles}};
    mesh.material = lambert(scene, 0.45f, 0.5f, 0.3f);
    hydra_scene_add_mesh(scene, &mesh);
    hydra_scene_set_environment(scene, &(hydra_environment_desc){.color = {0.6f, 0.8f, 1.0f}});
    hydra_light_desc sun = {.kind = HYDRA_LIGHT_SUN,
                            .unit = HYDRA_UNIT_IRRADIANCE,
                            .color = {6, 5.6f, 5},
                            .direction = {-0.5f, -1, -0.4f},
                            .angular_radius = 0.0047f};
    hydra_scene_add_light(scene, &sun);
}
