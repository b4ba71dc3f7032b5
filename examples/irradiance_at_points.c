/* irradiance_at_points.c: light arriving at points, as lightmaps and probes want it, against the exact answer

   A rectangle of radiance L hangs above a floor. What it sends to a point below is E = pi L F, with the form factor F of
   a rectangle and a parallel small surface, which has a closed form (e.g. Howell, Menguc, Siegel, "Thermal Radiation
   Heat Transfer", configuration B-3).

       cc -I.. irradiance_at_points.c -o irradiance_at_points -lm -lpthread */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#include <math.h>
#include <stdio.h>

enum { SIDE = 5, POINTS = SIDE * SIDE };

static const double radiance = 10.0, light_height = 1.5, half_width = 0.5, half_depth = 0.3;

/* The form factor of a rectangle whose one corner stands above the point, a by b at height h. Odd in a and in b. */
static double corner(double a, double b, double h) {
    const double x = a / h, y = b / h, p = sqrt(1.0 + x * x), q = sqrt(1.0 + y * y);
    return (x / p * atan(y / p) + y / q * atan(x / q)) / (2.0 * 3.14159265358979);
}

/* Any rectangle is four such ones, added and subtracted. */
static double exact(double x, double z) {
    const double x0 = -half_width - x, x1 = half_width - x, z0 = -half_depth - z, z1 = half_depth - z, h = light_height;
    return 3.14159265358979 * radiance * (corner(x1, z1, h) - corner(x0, z1, h) - corner(x1, z0, h) + corner(x0, z0, h));
}

static void build_scene(hydra_scene *scene) {
    static const float floor[] = {-2, 0, 2, 2, 0, 2, 2, 0, -2, -2, 0, -2};
    static const uint16_t triangles[] = {0, 1, 2, 0, 2, 3};
    hydra_scene_add_mesh(scene, &(hydra_mesh_desc){.positions = {floor, 12, 4}, .indices = {triangles, 2, 6}});
    hydra_scene_add_light(scene, &(hydra_light_desc){.kind = HYDRA_LIGHT_RECT,
                                                     .color = {(float)radiance, (float)radiance, (float)radiance},
                                                     .position = {0, (float)light_height, 0},
                                                     .axis_u = {(float)half_width, 0, 0},
                                                     .axis_v = {0, 0, (float)half_depth}});
}

static void place_points(float points[POINTS][3], float normals[POINTS][3]) {
    for (int i = 0; i < POINTS; i++) {
        points[i][0] = 0.6f * (float)(i % SIDE - SIDE / 2);
        points[i][1] = 0.0f;
        points[i][2] = 0.6f * (float)(i / SIDE - SIDE / 2);
        normals[i][0] = normals[i][2] = 0.0f;
        normals[i][1] = 1.0f;
    }
}

static void print_points(const float points[POINTS][3], const float measured[POINTS][3], const float sigma[POINTS][3]) {
    double worst = 0.0;
    puts("     x      z     E measured  +- std. error     E exact   deviation / std. error");
    for (int i = 0; i < POINTS; i++) {
        const double truth = exact((double)points[i][0], (double)points[i][2]);
        const double deviation = ((double)measured[i][0] - truth) / (double)sigma[i][0];
        printf("%6.2f %6.2f   %12.5f  +- %9.5f  %12.5f   %8.2f\n", (double)points[i][0], (double)points[i][2], (double)measured[i][0],
               (double)sigma[i][0], truth, deviation);
        worst = fmax(worst, fabs(deviation));
    }
    printf("largest deviation: %.2f standard errors\n", worst);
}

int main(void) {
    static float points[POINTS][3], normals[POINTS][3], measured[POINTS][3], sigma[POINTS][3];
    hydra_context *context = hydra_create(NULL);
    hydra_scene *scene = hydra_scene_create(context);
    build_scene(scene);
    place_points(points, normals);
    if (hydra_scene_commit(scene) != HYDRA_OK) puts(hydra_error_text(context));

    /* A list of points is a picture of any shape with as many pixels; here a square. */
    hydra_render *render = hydra_render_create(scene, &(hydra_render_desc){.width = SIDE,
                                                                           .height = SIDE,
                                                                           .max_samples = 4096,
                                                                           .sensor = {.kind = HYDRA_SENSOR_POINTS,
                                                                                      .lightmap = HYDRA_LIGHTMAP_IRRADIANCE,
                                                                                      .point_positions = {points, 0, POINTS},
                                                                                      .point_normals = {normals, 0, POINTS}}});
    while (hydra_render_step(render) == HYDRA_MORE) {}
    const hydra_result read = hydra_render_read(render, HYDRA_RADIANCE, measured, 0);
    hydra_render_read(render, HYDRA_ERROR, sigma, 0);
    if (read == HYDRA_OK)
        print_points((const float(*)[3])points, (const float(*)[3])measured, (const float(*)[3])sigma);
    else
        puts(hydra_error_text(context));

    hydra_render_destroy(render);
    hydra_scene_destroy(scene);
    hydra_destroy(context);
    return read == HYDRA_OK ? 0 : 1;
}
