/* What the truth tests share beside hydra_test.h: double vectors, poses, meshes, renders run to their
   end, and estimates held against ground truth with their own error bars.

   Everything here goes through the public API; nothing knows how the library works inside. */
#ifndef TRUTH_HELPERS_H
#define TRUTH_HELPERS_H

#include "hydra_test.h"

#define TRUTH_PI HT_PI

/* ---- double vectors */

typedef struct truth_v3 {
    double x, y, z;
} truth_v3;

truth_v3 truth_v(double x, double y, double z);
truth_v3 truth_add(truth_v3 a, truth_v3 b);
truth_v3 truth_sub(truth_v3 a, truth_v3 b);
truth_v3 truth_mul(truth_v3 a, double s);
truth_v3 truth_cross(truth_v3 a, truth_v3 b);
truth_v3 truth_unit(truth_v3 a);
double truth_dot(truth_v3 a, truth_v3 b);
double truth_length(truth_v3 a);
void truth_store(float to[3], truth_v3 v);
truth_v3 truth_load(const float from[3]);

/* ---- random numbers in double */

double truth_rng_unit(ht_rng *rng); /* 0 <= u < 1 */
truth_v3 truth_rng_direction(ht_rng *rng);

/* ---- poses: rotation, uniform scale, translation */

typedef struct truth_pose {
    truth_v3 x, y, z, origin; /* images of the unit axes, and of the origin */
    double scale;
} truth_pose;

truth_pose truth_pose_identity(void);
/* Any rotation; the origin moves by up to offset times scale along each axis. */
truth_pose truth_pose_random(uint64_t seed, double scale, double offset);
truth_v3 truth_pose_point(const truth_pose *pose, truth_v3 p);
truth_v3 truth_pose_vector(const truth_pose *pose, truth_v3 v); /* rotated and scaled */
truth_v3 truth_pose_direction(const truth_pose *pose, truth_v3 v); /* rotated */

/* ---- meshes */

typedef struct truth_mesh {
    float *positions, *normals, *uvs; /* normals and uvs may be NULL */
    uint32_t *indices;
    uint32_t vertices, triangles;
} truth_mesh;

/* centre, half edges; front towards cross(half_u, half_v); cells x cells squares; uv 0..1 along u and v. */
truth_mesh truth_mesh_quad(truth_v3 centre, truth_v3 half_u, truth_v3 half_v, uint32_t cells);
/* Triangles 2 f and 2 f + 1 are face f: -x, +x, -y, +y, -z, +z. Flat, own vertices for each face. */
truth_mesh truth_mesh_box(truth_v3 centre, truth_v3 half, bool inward);
/* Icosahedron divided level times; flat faces (normals NULL); vertices on the sphere. */
truth_mesh truth_mesh_sphere(truth_v3 centre, double radius, unsigned level, bool inward);
/* Soup of count small triangles inside the unit cube. */
truth_mesh truth_mesh_soup(uint64_t seed, uint32_t count);
void truth_mesh_pose(truth_mesh *mesh, const truth_pose *pose);
void truth_mesh_free(truth_mesh *mesh);
double truth_mesh_area(const truth_mesh *mesh);
/* A point on the mesh, uniform by area, and the normal of its triangle. */
void truth_mesh_sample(const truth_mesh *mesh, ht_rng *rng, float point[3], float normal[3]);
hydra_mesh_desc truth_mesh_desc(const truth_mesh *mesh, hydra_material material);
/* Adds and frees it. */
hydra_mesh truth_scene_mesh(hydra_scene *scene, truth_mesh mesh, hydra_material material);
hydra_material truth_lambert(hydra_scene *scene, double albedo);
hydra_material truth_emitter(hydra_scene *scene, double albedo, double radiance);

/* ---- a context and a scene; closing asserts that nothing leaked or was written out of bounds */

typedef struct truth_world {
    ht_host host;
    hydra_context *context;
    hydra_scene *scene;
} truth_world;

void truth_open(truth_world *world);
void truth_open_with(truth_world *world, const hydra_context_desc *desc);
void truth_commit(truth_world *world);
void truth_close(truth_world *world);

/* ---- quick mode: HYDRA_TEST_QUICK=1 takes a fifth of the samples and widens error bounds by 4 */

uint32_t truth_samples(uint32_t samples); /* even */
uint32_t truth_seeds(uint32_t seeds);
double truth_bound(double bound);

/* ---- renders */

/* Creates, steps to HYDRA_OK, asserts success. */
hydra_render *truth_render(hydra_scene *scene, const hydra_render_desc *desc);
void truth_run(hydra_render *render);
/* The whole region: malloc'd, the caller frees. */
float *truth_read(hydra_render *render, hydra_output output, size_t pixels);
uint32_t *truth_read_words(hydra_render *render, hydra_output output, size_t pixels);
hydra_sensor_desc truth_sensor_points(const float *positions, const float *normals, size_t count);
hydra_sensor_desc truth_sensor_pinhole(truth_v3 position, truth_v3 target, double fov_y);
hydra_light_desc truth_light(hydra_light_kind kind, double value);

/* ---- estimates */

typedef struct truth_estimate {
    double mean, error; /* standard error of the mean */
} truth_estimate;

truth_estimate truth_estimate_of(const double *values, size_t count);
/* Channel of an RGB buffer, every pixel an estimate of the same value. */
truth_estimate truth_estimate_channel(const float *rgb, size_t pixels, unsigned channel);

#define TRUTH_PROBES 256 /* pixels of truth_irradiance and truth_radiance */

typedef struct truth_probe {
    uint32_t samples; /* a pixel, of TRUTH_PROBES */
    uint32_t max_depth, seed;
    hydra_strategy strategy;
    hydra_output output; /* HYDRA_RADIANCE = 0 by default */
} truth_probe;

/* E at one point, from 256 pixels that all stand there; the error is the spread over the pixels. */
truth_estimate truth_irradiance(hydra_scene *scene, truth_v3 point, truth_v3 normal, truth_probe probe);
/* Radiance along one ray, likewise. */
truth_estimate truth_radiance(hydra_scene *scene, truth_v3 origin, truth_v3 direction, truth_probe probe);
/* Mean of E over points spread uniformly by area over a mesh, seen from its front. */
truth_estimate truth_mesh_irradiance(hydra_scene *scene, const truth_mesh *mesh, truth_probe probe);

/* Passes when |mean - truth| < 4 errors + float_slack |truth|, and error < bound |truth|. The bound says how
   sharp the test is; the slack is for what float cannot hold (state why where it is above 1e-4). */
void truth_expect_at(const char *file, int line, const char *what, truth_estimate estimate, double truth, double bound, double slack);
#define TRUTH_EXPECT(what, estimate, truth, bound, slack) \
    truth_expect_at(__FILE__, __LINE__, (what), (estimate), (truth), truth_bound(bound), (slack))
/* |value - truth| <= slack max(|truth|, floor 0): an exact comparison, relative. */
void truth_close_at(const char *file, int line, const char *what, double value, double truth, double relative);
#define TRUTH_NEAR(what, value, truth, relative) truth_close_at(__FILE__, __LINE__, (what), (value), (truth), (relative))
/* low <= value <= high */
void truth_within_at(const char *file, int line, const char *what, double value, double low, double high);
#define TRUTH_WITHIN(what, value, low, high) truth_within_at(__FILE__, __LINE__, (what), (value), (low), (high))
void truth_result_at(const char *file, int line, hydra_context *context, hydra_result got, hydra_result wanted);
#define TRUTH_RESULT(context, call, wanted) truth_result_at(__FILE__, __LINE__, (context), (call), (wanted))

/* ---- formulas in double (TRUTH.md B and D) */

/* Irradiance from a polygon of uniform radiance L (Lambert 1760, Arvo 1995), clipped to the horizon. It shines
   from both sides: whoever calls knows which side the point is on. */
#define TRUTH_CORNERS 512
double truth_polygon_irradiance(const truth_v3 *corners, unsigned count, truth_v3 point, truth_v3 normal, double radiance);
/* Unpolarised reflectance of a dielectric for light from outside, n = inside / outside. */
double truth_fresnel(double cosine, double n);
double truth_fresnel_conductor(double cosine, double eta, double k);

#endif /* TRUTH_HELPERS_H */
