#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <stdio.h>

int main(void) {
    static const float xyz[] = {-1, 0, 1, 1, 0, 1, 1, 0, -1, -1, 0, -1}; /* a floor of 2 m x 2 m */
    static const uint32_t tri[] = {0, 1, 2, 0, 2, 3};
    static float pixels[90][160][3], sigma[90][160][3];

    hydra_context *ctx = hydra_create(NULL); /* NULL: all defaults */
    hydra_scene *scene = hydra_scene_create(ctx);
    hydra_material_desc grey = {.base_color = {0.7f, 0.7f, 0.7f}};
    hydra_mesh_desc floor = {.positions = {xyz, 12, 4}, .indices = {tri, 4, 6}};
    floor.material = hydra_scene_add_material(scene, &grey);
    hydra_scene_add_mesh(scene, &floor);
    hydra_light_desc lamp = {.kind = HYDRA_LIGHT_RECT, .color = {10, 10, 10}, .position = {0, 1.5f, 0}};
    lamp.axis_u[0] = lamp.axis_v[2] = 0.3f; /* half edges: 0.6 m x 0.6 m, shining down */
    hydra_scene_add_light(scene, &lamp);
    if (hydra_scene_commit(scene) != HYDRA_OK) puts(hydra_error_text(ctx));

    hydra_render_desc desc = {.width = 160, .height = 90, .target_error = 0.02f, .time_budget = 10.0};
    desc.sensor = (hydra_sensor_desc){.position = {0, 1, 3}, .target = {0, 0.5f, 0}};
    hydra_render *r = hydra_render_create(scene, &desc);
    while (hydra_render_step(r) == HYDRA_MORE) printf("\r%3.0f %%", 100.0 * hydra_render_status(r).fraction);
    hydra_render_read(r, HYDRA_RADIANCE, pixels, 0); /* float RGB, linear, row 0 on top */
    hydra_render_read(r, HYDRA_ERROR, sigma, 0);     /* standard error of each value */
    printf("\rbelow the lamp: %.4f +- %.4f W/(m^2 sr)\n", pixels[64][80][0], sigma[64][80][0]);

    hydra_render_destroy(r);
    hydra_scene_destroy(scene);
    hydra_destroy(ctx);
    return 0;
}
