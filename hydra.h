/* hydra.h is generated from src/ and shaders/shared/ by `make hydra.h`. Edit those, not this. */

/*
hydra.h - v0.1 - global illumination for C: reference images, irradiance, ray queries, with error bars

  Do this in exactly one C or C++ file:

      #define HYDRA_IMPLEMENTATION
      #include "hydra.h"

  and include "hydra.h" without the macro everywhere else. C99 or C++11, no dependency beyond the
  C library and, unless HYDRA_NO_THREADS is defined, the system's threads.

WHAT IT DOES
  You hand over triangle meshes, materials, textures, lights and a camera (or a list of points, or
  of rays) and read back float buffers: radiance, irradiance, depth, normals, ids, and the standard
  error of every pixel. Light transport is solved by unbiased path tracing with multiple importance
  sampling; the picture comes with an estimate of how wrong it still is. Rays can be cast on their
  own, for picking, visibility and physics.

WHAT IT DOES NOT
  It opens no file, prints nothing, owns no global variable and starts no thread you did not allow.
  It renders no volumes other than absorption inside glass, no spectra, no hair, no motion blur, and
  does not denoise. Meshes are triangles.

STEP BY STEP
  1. hydra_create                         a context: memory, threads, log
  2. hydra_scene_create                   a scene; add materials, textures, meshes, instances, lights
  3. hydra_scene_commit                   checks everything and builds what rays need
  4. hydra_render_create                  a picture in progress: sensor, size, budget, outputs
  5. hydra_render_step until not HYDRA_MORE
  6. hydra_render_read                    any output, at any time
  7. hydra_render_destroy, hydra_scene_destroy, hydra_destroy

OPTIONS (define before the implementation; none is needed)
  HYDRA_STATIC       every function static
  HYDRA_NO_THREADS   compile without threads (hydra_context_desc.parallel_for still works)
  HYDRA_NO_SIMD      compile the scalar traversal only
  HYDRA_API          your own linkage specifier, e.g. __declspec(dllexport)

DESCRIPTORS
  Every *_desc may be zeroed; zero means the default that its comment states. Descriptors are read
  during the call only. Array contents are copied unless a field says otherwise, so the caller may
  free its arrays when the call returns.

CONVENTIONS
  Right-handed, +Y up, metres, counter-clockwise front faces, angles in radians. Transforms are
  row-major 3x4 (12 floats: three rows, translation in the last column). Colours are linear
  Rec.709. Radiance in W/(m^2 sr), irradiance in W/m^2, point lights in W/sr or W (see
  hydra_light_unit). Image row 0 is the top row. uv (0,0) is the first texel of the first row.

ERRORS
  Functions that can fail return hydra_result; those that return a handle or a pointer return a zero
  handle (id 0) or NULL. hydra_error_text gives the last message with the numbers in it. An object
  that could not be added leaves the scene unchanged, and the next hydra_scene_commit reports the
  first such error once, naming the call, so a program may check the commit alone. The ray queries
  return codes but write no text, since many threads may call them.

THREADS
  A context, its scenes and their renders are used by one thread at a time. The exceptions are stated
  at the function: the ray queries and hydra_render_cancel may be called from any thread.
  Two contexts share nothing and may be used by two threads.

DETERMINISM
  Same input, same seed: bit-identical buffers for any number of threads, any order of tiles and any
  division of the work into steps, unless a time budget ended the render. Films of disjoint sample
  ranges add up to the same bits as one render of the whole range.

MEMORY
  All memory comes from hydra_context_desc.allocator. hydra_context_desc.memory_cap is never
  exceeded. hydra_estimate forecasts what a render will take.

REFERENCES are named where the method stands in the implementation.
*/
#ifndef HYDRA_H
#define HYDRA_H

#if defined(HYDRA_IMPLEMENTATION) && defined(__STRICT_ANSI__) && !defined(_POSIX_C_SOURCE) && !defined(_GNU_SOURCE)
#define _POSIX_C_SOURCE 200809L /* -std=c99 hides the monotonic clock otherwise */
#endif

#include <stddef.h>
#include <stdint.h>
#include <stdbool.h>

#define HYDRA_VERSION_MAJOR 0
#define HYDRA_VERSION_MINOR 1

#ifndef HYDRA_API
#if defined(HYDRA_STATIC) && defined(__GNUC__)
#define HYDRA_API static __attribute__((unused))
#elif defined(HYDRA_STATIC)
#define HYDRA_API static
#else
#define HYDRA_API extern
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------- results */

/* Everything that can happen, in one list: name, and the text hydra_result_text returns. */
#define HYDRA_RESULTS(X)                                                                             \
    X(HYDRA_OK, "done")                                                                              \
    X(HYDRA_MORE, "there is more to do")                                                             \
    X(HYDRA_CANCELLED, "cancelled by the caller")                                                    \
    X(HYDRA_ERROR_NULL, "a required pointer is NULL")                                                \
    X(HYDRA_ERROR_OUT_OF_MEMORY, "the allocator returned no memory")                                 \
    X(HYDRA_ERROR_MEMORY_CAP, "the memory cap of the context would be exceeded")                     \
    X(HYDRA_ERROR_OVERFLOW, "a product of sizes overflows")                                          \
    X(HYDRA_ERROR_ENUM, "an enumeration value is not one of those declared")                         \
    X(HYDRA_ERROR_HANDLE, "a handle names no living object of this scene")                           \
    X(HYDRA_ERROR_COUNT, "a count is zero, too large or not a multiple of three")                    \
    X(HYDRA_ERROR_STRIDE, "a stride is too small for its element or misaligned")                     \
    X(HYDRA_ERROR_INDEX_SIZE, "index size must be 2 or 4 bytes")                                     \
    X(HYDRA_ERROR_INDEX_RANGE, "an index points past the vertices or materials")                     \
    X(HYDRA_ERROR_NOT_FINITE, "a number is NaN or infinite")                                         \
    X(HYDRA_ERROR_TRANSFORM, "a transform is singular")                                              \
    X(HYDRA_ERROR_COLOR, "a colour, intensity or absorption is negative, or a reflectance above 1")  \
    X(HYDRA_ERROR_ROUGHNESS, "roughness, metallic, transmission or alpha is outside 0..1")           \
    X(HYDRA_ERROR_IOR, "an index of refraction is outside 1.0001..10 (or eta, k out of range)")      \
    X(HYDRA_ERROR_TEXTURE, "a texture has no texels, or a size above 65536")                         \
    X(HYDRA_ERROR_LIGHT, "a light has no extent, no direction or an impossible angle")               \
    X(HYDRA_ERROR_SENSOR, "a sensor has an impossible angle, extent or direction")                   \
    X(HYDRA_ERROR_SIZE, "an image has zero pixels or a region outside its frame")                    \
    X(HYDRA_ERROR_BUDGET, "a budget, sample count or error target is negative, NaN or contradictory")\
    X(HYDRA_ERROR_NOT_COMMITTED, "the scene was edited since its last commit")                       \
    X(HYDRA_ERROR_BUSY, "the scene has living renders, the context living scenes, or a call is running") \
    X(HYDRA_ERROR_OUTPUT, "the output was not requested when the render was created")                \
    X(HYDRA_ERROR_BUFFER, "the buffer is too small")                                                 \
    X(HYDRA_ERROR_FILM_FORMAT, "the film data is damaged or of another version")                     \
    X(HYDRA_ERROR_FILM_MISMATCH, "the film belongs to another scene, sensor, size or seed")          \
    X(HYDRA_ERROR_FILM_OVERLAP, "both films hold the same samples")                                  \
    X(HYDRA_ERROR_TREE_FORMAT, "the tree data is damaged, of another version or from another kind of machine") \
    X(HYDRA_ERROR_RAY, "a ray is not finite, has no direction, or t_min > t_max")                    \
    X(HYDRA_ERROR_THREADS, "no thread could be started")                                             \
    X(HYDRA_ERROR_ISA, "this machine or build lacks the instruction set asked for")                  \
    X(HYDRA_ERROR_DEVICE, "no device, or it lacks something that is needed")                         \
    X(HYDRA_ERROR_DEVICE_LIMIT, "a buffer is larger than the device can bind")                       \
    X(HYDRA_ERROR_DEVICE_MEMORY, "the device has no memory left, or its cap would be exceeded")      \
    X(HYDRA_ERROR_DEVICE_LOST, "the device was lost")                                                \
    X(HYDRA_ERROR_SELFTEST, "the self-test found a wrong answer")

typedef enum hydra_result {
#define HYDRA_RESULT_ENUM(name, text) name,
    HYDRA_RESULTS(HYDRA_RESULT_ENUM)
#undef HYDRA_RESULT_ENUM
    HYDRA_RESULT_COUNT
} hydra_result;

/* ---------------------------------------------------------------- objects */

typedef struct hydra_context hydra_context;
typedef struct hydra_scene hydra_scene;
typedef struct hydra_render hydra_render;

/* Handles. id 0 is "none". A handle belongs to the scene that made it. */
typedef struct hydra_mesh { uint32_t id; } hydra_mesh;
typedef struct hydra_instance { uint32_t id; } hydra_instance;
typedef struct hydra_material { uint32_t id; } hydra_material;
typedef struct hydra_texture { uint32_t id; } hydra_texture;
typedef struct hydra_light { uint32_t id; } hydra_light;

/* count elements, stride bytes apart; stride 0 means tightly packed. Aligned to the element's scalar. */
typedef struct hydra_view {
    const void *data;
    size_t stride;
    size_t count;
} hydra_view;

/* ---------------------------------------------------------------- context */

/* alloc returns size bytes aligned to 64, or NULL; release gets the size that alloc was asked for.
   Both may be called from the thread that called hydra, from its worker threads, and from any thread that casts rays. */
typedef struct hydra_allocator {
    void *(*alloc)(void *user, size_t size);
    void (*release)(void *user, void *memory, size_t size);
    void *user;
} hydra_allocator;

typedef enum hydra_log_level { HYDRA_LOG_INFO, HYDRA_LOG_WARNING, HYDRA_LOG_ERROR } hydra_log_level;

typedef enum hydra_isa {
    HYDRA_ISA_AUTO,   /* the widest that machine and build have */
    HYDRA_ISA_SCALAR, /* plain C */
    HYDRA_ISA_SSE42,
    HYDRA_ISA_AVX2,
    HYDRA_ISA_AVX512, /* F, BW, DQ, VL */
    HYDRA_ISA_NEON
} hydra_isa;

typedef struct hydra_context_desc {
    hydra_allocator allocator; /* both functions or none; default: aligned malloc and free */
    /* Called with every warning and error, and with progress notes. text lives during the call. */
    void (*log)(void *user, hydra_log_level level, const char *text);
    void *log_user;
    uint32_t threads;  /* default: one per processor; 1: only the calling thread; at most 1024 are used */
    /* Your own job system: must call task(argument, i) for every i < count, in any order, on any
       threads, and return when all are done. Replaces the library's threads. */
    void (*parallel_for)(void *user, uint32_t count, void (*task)(void *argument, uint32_t index), void *argument);
    void *parallel_user;
    size_t memory_cap; /* bytes; default: no cap */
    hydra_isa isa;     /* instruction set of the ray traversal */
} hydra_context_desc;

/* desc may be NULL. Returns NULL when there is no memory, no thread, half an allocator, or the isa is missing. */
HYDRA_API hydra_context *hydra_create(const hydra_context_desc *desc);
/* All scenes must be destroyed before (else HYDRA_ERROR_BUSY and nothing happens). NULL is ignored. */
HYDRA_API hydra_result hydra_destroy(hydra_context *context);
/* The message of the last error in this context, "" if none; valid until the next failing call.
   With NULL: why the last hydra_create could not succeed cannot be known, so a general text. */
HYDRA_API const char *hydra_error_text(const hydra_context *context);
/* The text of a result code. Never NULL. */
HYDRA_API const char *hydra_result_text(hydra_result result);

typedef struct hydra_memory_status {
    size_t bytes_now, bytes_peak, allocations_now;
} hydra_memory_status;
HYDRA_API hydra_memory_status hydra_memory(const hydra_context *context);
/* The instruction set in use, and the number of threads. */
HYDRA_API hydra_isa hydra_context_isa(const hydra_context *context);
HYDRA_API uint32_t hydra_context_threads(const hydra_context *context);

/* Checks this build on this machine in a few seconds: furnace, E = pi L, BSDF sampling against pdf,
   watertight sphere, SIMD against scalar traversal, films merged against whole. HYDRA_OK or
   HYDRA_ERROR_SELFTEST with the first wrong answer in hydra_error_text. */
HYDRA_API hydra_result hydra_selftest(hydra_context *context);

/* ---------------------------------------------------------------- scene */

HYDRA_API hydra_scene *hydra_scene_create(hydra_context *context);
/* All renders of it must be destroyed before (else HYDRA_ERROR_BUSY). NULL is ignored. */
HYDRA_API hydra_result hydra_scene_destroy(hydra_scene *scene);

/* --- textures */

typedef enum hydra_texel_format {
    HYDRA_TEXEL_RGBA8_SRGB,   /* colour channels sRGB-encoded, alpha linear */
    HYDRA_TEXEL_RGBA8_LINEAR,
    HYDRA_TEXEL_RGBA32F       /* float, linear */
} hydra_texel_format;

typedef enum hydra_wrap { HYDRA_WRAP_REPEAT, HYDRA_WRAP_CLAMP, HYDRA_WRAP_MIRROR } hydra_wrap;

typedef struct hydra_texture_desc {
    const void *texels;      /* height rows of width texels, 4 channels each */
    uint32_t width, height;  /* 1..65536 */
    size_t row_stride;       /* bytes from row to row; default: tight */
    hydra_texel_format format;
    hydra_wrap wrap_u, wrap_v;
    bool no_mipmaps;         /* keep the full-size level only (a third less memory) */
} hydra_texture_desc;

HYDRA_API hydra_texture hydra_scene_add_texture(hydra_scene *scene, const hydra_texture_desc *desc);

/* --- materials */

typedef enum hydra_material_kind {
    /* Lambert reflection of base_color, both sides. */
    HYDRA_MATERIAL_LAMBERT,
    /* GGX metal (roughness 0: a mirror). Fresnel from eta and k where any k is above 0, else Schlick's
       with base_color at normal incidence. */
    HYDRA_MATERIAL_CONDUCTOR,
    /* GGX dielectric (roughness 0: smooth glass): reflects and refracts by ior; absorption inside.
       The surface must be closed, normals outwards. base_color tints transmitted light
       (all zero: untinted). */
    HYDRA_MATERIAL_DIELECTRIC,
    /* glTF 2.0 metallic-roughness with KHR_materials_ior, _transmission (thin wall, or refracting
       with absorption when not thin), _emissive_strength and _clearcoat. */
    HYDRA_MATERIAL_METALLIC_ROUGHNESS
} hydra_material_kind;

typedef enum hydra_alpha_mode {
    HYDRA_ALPHA_OPAQUE, /* alpha is ignored */
    HYDRA_ALPHA_MASK,   /* holes where alpha < alpha_cutoff */
    HYDRA_ALPHA_BLEND   /* alpha is the share of rays that the surface stops; which, a hash of the ray decides */
} hydra_alpha_mode;

typedef struct hydra_material_desc {
    hydra_material_kind kind;
    float base_color[3];    /* 0..1; zero is black: reflects nothing */
    float emission[3];      /* radiance leaving the front face */
    bool emit_both_sides;
    float metallic;         /* METALLIC_ROUGHNESS only */
    float roughness;        /* 0..1, alpha = roughness^2; 0 exactly (or below 0.01) is a perfect mirror or glass */
    float transmission;     /* METALLIC_ROUGHNESS only: share of light that passes instead of the diffuse part */
    bool thin;              /* METALLIC_ROUGHNESS only: transmission without refraction, a sheet of its own, not a closed body */
    float ior;              /* 1.0001..10; default 1.5 */
    float eta[3], k[3];     /* CONDUCTOR: complex index of refraction */
    float absorption[3];    /* 1/m, inside DIELECTRIC or refracting transmission (Beer-Lambert) */
    float clearcoat;        /* 0..1: METALLIC_ROUGHNESS only, a GGX coat of ior 1.5 */
    float clearcoat_roughness;
    hydra_alpha_mode alpha_mode;
    float alpha;            /* factor on the alpha channel; default 1 (0 means 1) */
    float alpha_cutoff;     /* default 0.5 */
    hydra_texture base_color_texture;         /* rgb times base_color, a times alpha */
    hydra_texture metallic_roughness_texture; /* g times roughness, b times metallic */
    hydra_texture normal_texture;             /* tangent space, +Y up in v as glTF; linear */
    hydra_texture emission_texture;           /* rgb times emission */
    hydra_texture alpha_texture;              /* its r times alpha, instead of base_color_texture's a */
    float normal_scale;     /* default 1 */
} hydra_material_desc;

HYDRA_API hydra_material hydra_scene_add_material(hydra_scene *scene, const hydra_material_desc *desc);
HYDRA_API hydra_result hydra_scene_update_material(hydra_scene *scene, hydra_material material, const hydra_material_desc *desc);

/* --- meshes and instances */

/* How much work a tree over triangles (BVH) is worth. Hits are the same with any. */
typedef enum hydra_build {
    HYDRA_BUILD_AUTO, /* BEST; FAST for dynamic meshes */
    HYDRA_BUILD_FAST, /* built quickly: for geometry that changes often */
    HYDRA_BUILD_BEST  /* takes longer, rays pass faster: for geometry that stays */
} hydra_build;

typedef struct hydra_mesh_desc {
    hydra_view positions;   /* float x, y, z */
    hydra_view normals;     /* float x, y, z, one a vertex; none: flat faces */
    hydra_view uvs;         /* float u, v, one a vertex; none: (0, 0) */
    hydra_view indices;     /* three a triangle; .stride is the index size, 2 or 4 (0 means 4);
                               none: every three positions are a triangle */
    hydra_view triangle_materials; /* hydra_material, one a triangle; none: material for all */
    hydra_material material;       /* none: Lambert 0.8 grey */
    bool instanced_only;    /* not in the scene by itself, only through instances */
    bool dynamic;           /* will be edited: has a BVH of its own, so that an edit builds only that one again, and moved
                               vertices none at all (see hydra_scene_move_vertices). The other meshes that stand by
                               themselves share one, which rays pass faster */
    hydra_build build;      /* of its BVH; the shared one is FAST only if all its meshes say FAST */
} hydra_mesh_desc;

/* Degenerate triangles (no area, or two equal indices) are dropped from ray tracing and counted in
   hydra_scene_info; triangle numbers in hits stay those of the input. */
HYDRA_API hydra_mesh hydra_scene_add_mesh(hydra_scene *scene, const hydra_mesh_desc *desc);
/* Replaces the mesh's contents; the handle and its instances stay. On error the old contents stay. */
HYDRA_API hydra_result hydra_scene_update_mesh(hydra_scene *scene, hydra_mesh mesh, const hydra_mesh_desc *desc);
/* Removes the mesh and all its instances. */
HYDRA_API hydra_result hydra_scene_remove_mesh(hydra_scene *scene, hydra_mesh mesh);
/* A deforming mesh: new positions, and normals, of the same vertices; triangles, uvs and materials stay. Each view holds
   as many elements as the mesh has vertices (else HYDRA_ERROR_COUNT), float x, y, z. normals may be empty: the mesh keeps
   its own; a mesh without normals takes none. Copied.
   The next hydra_scene_commit refits the BVH of a dynamic mesh, its instances with it, in a fraction of the time of a
   build: the tree keeps its shape and gets new boxes. Where that cannot serve (a triangle that had no area has one now,
   or none has any), it builds. The trees of other meshes are built again. Hits are right whatever moves how; but the
   farther a mesh is from the shape its tree was built for, the slower rays pass: see hydra_mesh_info.
   On error nothing changes. */
HYDRA_API hydra_result hydra_scene_move_vertices(hydra_scene *scene, hydra_mesh mesh, hydra_view positions, hydra_view normals);
/* The next commit builds the BVH of the mesh from nothing: dynamic or instanced its own, else the shared one. */
HYDRA_API hydra_result hydra_scene_rebuild_mesh(hydra_scene *scene, hydra_mesh mesh);

typedef struct hydra_instance_desc {
    hydra_mesh mesh;
    float transform[12];     /* object to world; all zero means identity */
    hydra_material material; /* replaces the mesh's materials; none: keep them */
} hydra_instance_desc;

HYDRA_API hydra_instance hydra_scene_add_instance(hydra_scene *scene, const hydra_instance_desc *desc);
HYDRA_API hydra_result hydra_scene_update_instance(hydra_scene *scene, hydra_instance instance, const hydra_instance_desc *desc);
HYDRA_API hydra_result hydra_scene_remove_instance(hydra_scene *scene, hydra_instance instance);

/* --- lights */

typedef enum hydra_light_kind {
    HYDRA_LIGHT_RECT,   /* position: centre; axis_u, axis_v: half edges, perpendicular; shines towards cross(axis_u, axis_v) */
    HYDRA_LIGHT_DISC,   /* position, direction: normal; radius */
    HYDRA_LIGHT_SPHERE, /* position, radius; shines outwards only */
    HYDRA_LIGHT_POINT,  /* position */
    HYDRA_LIGHT_SPOT,   /* position, direction, cone_outer, cone_inner: half angles, smooth between */
    HYDRA_LIGHT_SUN     /* direction the light travels; angular_radius (0: a parallel beam) */
} hydra_light_kind;

typedef enum hydra_light_unit {
    HYDRA_UNIT_DEFAULT, /* RECT, DISC, SPHERE and SUN with a radius: radiance, W/(m^2 sr);
                           POINT, SPOT: intensity, W/sr (a spot's on its axis);
                           SUN without radius: irradiance on a surface facing it, W/m^2 */
    HYDRA_UNIT_POWER,   /* emitted flux, W (not SUN) */
    HYDRA_UNIT_IRRADIANCE /* SUN only: irradiance on a surface facing it, W/m^2 */
} hydra_light_unit;

typedef struct hydra_light_desc {
    hydra_light_kind kind;
    hydra_light_unit unit;
    float color[3];         /* the quantity that unit names, per channel */
    float position[3];
    float direction[3];     /* need not be unit length; default 0, -1, 0 */
    float axis_u[3], axis_v[3];
    float radius;
    float cone_outer, cone_inner; /* default 0.785 (45 degrees) and 0.9 of outer */
    float angular_radius;
    bool both_sides;        /* RECT, DISC */
    bool hidden;            /* rays from the sensor pass through RECT, DISC, SPHERE; a SUN is not seen */
} hydra_light_desc;

/* RECT, DISC and SPHERE are things in the scene: seen, and casting shadows, by any ray. */
HYDRA_API hydra_light hydra_scene_add_light(hydra_scene *scene, const hydra_light_desc *desc);
HYDRA_API hydra_result hydra_scene_update_light(hydra_scene *scene, hydra_light light, const hydra_light_desc *desc);
HYDRA_API hydra_result hydra_scene_remove_light(hydra_scene *scene, hydra_light light);

typedef struct hydra_environment_desc {
    float color[3];         /* constant radiance, or the factor on texels; zero: 1, 1, 1 with texels */
    const float *texels;    /* none (width and height are then 0), or equirectangular RGB, row 0 at +Y, u = 1/2 + atan2(x, -z) / 2 pi: the middle
                               column looks to -Z, three quarters to the right to +X. Copied */
    uint32_t width, height;
    float rotation;         /* about +Y, radians */
} hydra_environment_desc;

/* NULL removes the environment. */
HYDRA_API hydra_result hydra_scene_set_environment(hydra_scene *scene, const hydra_environment_desc *desc);

/* --- commit and what came of it */

/* Builds what changed since the last commit, on all threads of the context. On error the scene keeps
   all it was given; mend what the message names and commit again. */
HYDRA_API hydra_result hydra_scene_commit(hydra_scene *scene);

/* What the scene needs. A feature that is not set costs no memory, no pass and no branch. */
typedef enum hydra_feature {
    HYDRA_NEEDS_TEXTURES = 1 << 0,
    HYDRA_NEEDS_NORMAL_MAPS = 1 << 1,
    HYDRA_NEEDS_ALPHA = 1 << 2,
    HYDRA_NEEDS_SPECULAR = 1 << 3,     /* any BSDF but Lambert */
    HYDRA_NEEDS_TRANSMISSION = 1 << 4,
    HYDRA_NEEDS_ABSORPTION = 1 << 5,
    HYDRA_NEEDS_EMITTERS = 1 << 6,     /* finite lights: selection and shadow pass */
    HYDRA_NEEDS_SHAPES = 1 << 7,       /* rectangles, discs, spheres that rays can hit */
    HYDRA_NEEDS_SUNS = 1 << 8,
    HYDRA_NEEDS_ENVIRONMENT = 1 << 9,
    HYDRA_NEEDS_ENVIRONMENT_MAP = 1 << 10,
    HYDRA_NEEDS_INSTANCES = 1 << 11,   /* a level above: there are instances or dynamic meshes */
    HYDRA_NEEDS_SMOOTH_NORMALS = 1 << 12
} hydra_feature;

/* Bits of hydra_feature; valid after commit. */
HYDRA_API uint32_t hydra_scene_requirements(const hydra_scene *scene);

typedef struct hydra_scene_info {
    uint64_t triangles;        /* of all meshes, once each */
    uint64_t placed_triangles; /* instances counted */
    uint64_t degenerate;       /* dropped */
    uint64_t emitters;         /* lights and emitting triangles */
    double build_seconds;      /* of the last commit's BVH builds */
    uint32_t meshes_built;     /* BVHs the last commit built over triangles, the shared one counted once; */
    uint32_t meshes_refitted;  /* those it fitted to moved vertices, */
    uint32_t trees_loaded;     /* and those it took from hydra_scene_load_trees; the others were kept */
    size_t bytes_bvh, bytes_geometry, bytes_textures, bytes_materials, bytes_lights, bytes_environment, bytes_tables;
    float bounds_min[3], bounds_max[3]; /* of everything that rays can hit; both zero when empty */
} hydra_scene_info;

HYDRA_API hydra_result hydra_scene_get_info(const hydra_scene *scene, hydra_scene_info *info);

/* A mesh and the BVH that rays pass to it: its own where it is dynamic or instanced, else the shared one. */
typedef struct hydra_mesh_info {
    uint64_t triangles;
    uint64_t degenerate;   /* of these, without area: no ray hits them */
    size_t bytes_bvh;      /* of the tree */
    float cost;            /* of a ray that meets the tree's bounds and no triangle, in visits of nodes, as the surface area
                              heuristic expects it; 0: there is no tree, or nothing in it */
    float cost_when_built; /* the same, when the tree was built */
    bool shared;           /* the tree is the shared one */
    bool refitted;         /* since it was built */
    bool rebuild_advised;  /* refits made the cost grow by more than half: a build pays if many rays follow */
} hydra_mesh_info;

/* The scene must be committed. */
HYDRA_API hydra_result hydra_scene_get_mesh_info(const hydra_scene *scene, hydra_mesh mesh, hydra_mesh_info *info);

/* Trees built once and kept in a file of yours. save writes all BVHs over triangles of a committed scene, of *size bytes;
   with buffer NULL it only tells the size (HYDRA_ERROR_BUFFER: *size was too small, and tells it too).
   load copies trees from such bytes: the next successful commit takes each one whose triangles are to be built over, to
   the bit the same positions, indices and hydra_build; it builds the rest, and forgets trees that fit nothing. Hits are
   the same, to the bit, as with the scene that saved them. Several loads before a commit add up.
   The bytes are those of one version of the library and one kind of machine (byte order); of another, damaged or cut off
   they give HYDRA_ERROR_TREE_FORMAT and nothing changes. Everything in them is checked: bytes made by an enemy can make
   rays miss what is there, and no worse. Neither call touches a file. */
HYDRA_API hydra_result hydra_scene_save_trees(const hydra_scene *scene, void *buffer, size_t *size);
HYDRA_API hydra_result hydra_scene_load_trees(hydra_scene *scene, const void *data, size_t size);

/* ---------------------------------------------------------------- ray queries

   Rays on their own: picking, visibility, physics, or a renderer of your own. What they need is a context, a scene with
   meshes and instances, and a commit; materials matter only where they cut holes (alpha), lights only where they have a
   shape that can be hit. A program that uses no more than this and defines HYDRA_STATIC (or links with
   -ffunction-sections -Wl,--gc-sections) gets a third of the library's code.

   Guarantees. Watertight: a ray through a shared edge or vertex hits one of the triangles around it. Exact: among
   triangles the nearest is decided in double from the float coordinates given, t is rounded once; there is no epsilon,
   t_min 0 is allowed, and a ray that starts exactly in the plane of a triangle meets it at t 0. The same ray gets the
   same answer, bit for bit, alone or in any batch, in any order, with any number of threads and any instruction set.

   Speed. One call with many rays beats many calls: from some fifty rays on they go through the tree together. Best is an
   order in which neighbours are alike (the pixels of a small block, then their shadow rays): those go as packets. Others
   are sorted by direction within 65536, so give as many a call as there are. Use several threads by calling from several,
   each with its share. `make bench-rays` measures all this.

   Memory. A call with some fifty or more rays takes memory from the allocator and returns it: 0.2 MB and about a kilobyte a
   ray, never more than 5 MB (6 MB in scenes with instances). Where the allocator or the cap refuses, the answers are the
   same, later.
   Arrays of rays and hits are the caller's; nothing is kept.

   Changing scenes. Mark meshes that move or change as dynamic; see hydra_scene_move_vertices, HYDRA_BUILD_FAST and
   hydra_scene_save_trees. */

typedef struct hydra_ray {
    float origin[3], t_min;    /* points on the ray: origin + t direction, t_min <= t <= t_max */
    float direction[3], t_max; /* need not be unit length; t_max may be infinite */
} hydra_ray;

#define HYDRA_NONE 0xffffffffu

typedef struct hydra_hit {
    float t;            /* negative: no hit */
    float u, v;         /* barycentric weights of vertex 1 and 2; on a light shape 0 */
    uint32_t primitive; /* triangle of the mesh, HYDRA_NONE on a light shape or a miss */
    uint32_t mesh;      /* hydra_mesh id, 0 on a light shape or a miss */
    uint32_t instance;  /* hydra_instance id; 0: the mesh itself */
    uint32_t light;     /* hydra_light id of the shape, else 0 */
    float normal[3];    /* geometric, unit length, world space, towards the front face */
} hydra_hit;

/* Closest hits of count rays: hits[i] belongs to rays[i]. Ties go to the smallest instance, then triangle. Alpha is
   honoured. Any number of threads may call it on one committed scene; runs in the calling thread.
   Rays with NaN or infinite origin, direction or t_min, a zero direction, or t_max below t_min miss; that there were some
   is reported as HYDRA_ERROR_RAY after all others were answered. */
HYDRA_API hydra_result hydra_scene_closest_hits(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, size_t count);
/* occluded[i] is 1 if anything lies on ray i, else 0. As above otherwise. */
HYDRA_API hydra_result hydra_scene_any_hits(const hydra_scene *scene, const hydra_ray *rays, uint8_t *occluded, size_t count);

/* ---------------------------------------------------------------- sensors */

typedef enum hydra_sensor_kind {
    HYDRA_SENSOR_PINHOLE,
    HYDRA_SENSOR_THIN_LENS,
    HYDRA_SENSOR_ORTHOGRAPHIC,
    HYDRA_SENSOR_EQUIRECTANGULAR, /* all directions; the middle of the image looks at target */
    HYDRA_SENSOR_POINTS,          /* irradiance at points with normals: lightmap texels, probes */
    HYDRA_SENSOR_RAYS             /* radiance along rays of the caller */
} hydra_sensor_kind;

typedef enum hydra_filter {
    HYDRA_FILTER_BOX, /* one pixel wide: pixels are averages over their own area */
    HYDRA_FILTER_TENT /* two pixels wide */
} hydra_filter;

/* What a texel of a point list means in HYDRA_RADIANCE; HYDRA_IRRADIANCE is E whatever this says. */
typedef enum hydra_lightmap {
    HYDRA_LIGHTMAP_IRRADIANCE,     /* E, W/m^2 */
    HYDRA_LIGHTMAP_RADIANCE,       /* E / pi: what a white Lambert surface there would show */
    HYDRA_LIGHTMAP_RADIOSITY       /* albedo E, W/m^2, with the albedo given for the sensor */
} hydra_lightmap;

typedef struct hydra_sensor_desc {
    hydra_sensor_kind kind;
    float position[3];
    float target[3];        /* a point it looks at; equal to position: looks to -Z */
    float up[3];            /* default 0, 1, 0; must not be along the view */
    float fov_y;            /* PINHOLE, THIN_LENS: vertical angle, 0.001..179.9 degrees in radians; default 0.8 */
    float lens_radius;      /* THIN_LENS, m */
    float focus_distance;   /* THIN_LENS, m along the axis; default: to target */
    float ortho_height;     /* ORTHOGRAPHIC: height of the image, m; default 2 */
    float shift[2];         /* PINHOLE, THIN_LENS: moves the image window, in image heights */
    hydra_filter filter;
    /* POINTS: float x, y, z each, same count; width x height of the render must equal the count. A point may lie on
       its surface, or off it by some 30 roundings of its coordinates; one that also lies exactly in the plane of
       another surface (a texel's corner where floor meets wall) sees both sides of that: use texel centres.
       Normals need not be unit length. Copied. */
    hydra_view point_positions, point_normals;
    hydra_lightmap lightmap;
    float lightmap_albedo[3]; /* for HYDRA_LIGHTMAP_RADIOSITY */
    hydra_view rays;        /* RAYS: hydra_ray each; count must equal width x height. Copied. */
} hydra_sensor_desc;

/* ---------------------------------------------------------------- rendering */

/* Outputs, and what hydra_render_read writes for a pixel. Means are over the picture's own samples. */
typedef enum hydra_output {
    HYDRA_RADIANCE,     /* float[3] */
    HYDRA_ERROR,        /* float[3]: standard error of HYDRA_RADIANCE, one value a channel; see hydra_status */
    HYDRA_DIRECT,       /* float[3]: light seen directly, by reflection, or after one diffuse scattering */
    HYDRA_INDIRECT,     /* float[3]: after two or more diffuse scatterings */
    HYDRA_CAUSTIC,      /* float[3]: focused on a diffuse surface by mirrors or glass. The three add to RADIANCE */
    HYDRA_IRRADIANCE,   /* float[3]: E at the first surface that scatters diffusely, 0 where it does not */
    HYDRA_ALBEDO,       /* float[3]: reflectance of the first surface */
    HYDRA_NORMAL,       /* float[3]: shading normal of the first surface, mean, not renormalised */
    HYDRA_POSITION,     /* float[3]: world position of the first surface, mean of the samples that hit */
    HYDRA_DEPTH,        /* float: Euclidean distance from the ray's origin, mean of the samples that hit; infinity: none hit */
    HYDRA_COVERAGE,     /* float: share of samples that hit a surface */
    HYDRA_PRIMITIVE_ID, /* uint32: triangle of the pixel's first sample, HYDRA_NONE if it hit no triangle */
    HYDRA_INSTANCE_ID,  /* uint32: hydra_instance id of the same, 0 if the mesh stands by itself or none */
    HYDRA_MESH_ID,      /* uint32: hydra_mesh id of the same, 0 if none */
    HYDRA_MATERIAL_ID,  /* uint32: hydra_material id of the same, 0 if none */
    HYDRA_SAMPLES,      /* uint32: samples in the pixel's value */
    HYDRA_VALIDITY,     /* uint32: bits of hydra_validity */
    HYDRA_OUTPUT_COUNT
} hydra_output;

typedef enum hydra_validity {
    HYDRA_VALID_SAMPLED = 1 << 0,    /* the pixel has samples */
    HYDRA_VALID_CONVERGED = 1 << 1,  /* its tile reached the target error, as far as its samples tell */
    HYDRA_VALID_HEAVY_TAIL = 1 << 2, /* one sample made more than a tenth of the sum of 64 or more: do not trust its error bar */
    HYDRA_VALID_DROPPED = 1 << 3,    /* a sample was not finite and was dropped */
    HYDRA_VALID_INSIDE = 1 << 4      /* POINTS: most rays hit back faces first: the point is inside geometry */
} hydra_validity;

/* For comparing estimators; anything but the default is slower to converge. */
typedef enum hydra_strategy {
    HYDRA_STRATEGY_MIS,       /* light and BSDF sampling, power heuristic */
    HYDRA_STRATEGY_LIGHTS,    /* light sampling alone (light that it cannot sample, through mirrors, by BSDF) */
    HYDRA_STRATEGY_BSDF       /* BSDF sampling alone (lights without extent, by light sampling) */
} hydra_strategy;

typedef struct hydra_render_desc {
    hydra_sensor_desc sensor;
    uint32_t width, height;
    uint32_t region[4];      /* x, y, width, height of the part to render; zero: all of it */
    uint32_t outputs;        /* bits 1 << hydra_output; RADIANCE, ERROR, SAMPLES, VALIDITY are always there */
    /* Whichever comes first ends the render. With none of the three: 64 samples. */
    float target_error;      /* relative error of each tile (see hydra_status); 0: none */
    double time_budget;      /* seconds of hydra_render_step; 0: none */
    uint32_t max_samples;    /* a pixel; even, at most 2147483632. 0: none if a target or a time is given */
    uint32_t first_sample;   /* even: renders [first_sample, max_samples), for shares of one picture; needs
                                max_samples and no target_error */
    uint32_t max_depth;      /* scattering events on a path; default: no limit but Russian roulette */
    hydra_strategy strategy;
    uint32_t seed;
    uint32_t tile_size;      /* 8 or 16; default 16 */
    double step_seconds;     /* how long one hydra_render_step aims to run; default 0.05 */
} hydra_render_desc;

/* The scene must be committed, and must not be edited or destroyed while the render lives. */
HYDRA_API hydra_render *hydra_render_create(hydra_scene *scene, const hydra_render_desc *desc);
/* NULL is ignored. */
HYDRA_API void hydra_render_destroy(hydra_render *render);
/* Works for about step_seconds. HYDRA_MORE: call again. HYDRA_OK: target, budget or cap is reached.
   HYDRA_CANCELLED: see hydra_render_cancel. What was rendered is valid after every return. */
HYDRA_API hydra_result hydra_render_step(hydra_render *render);
/* From any thread: the running or next step returns HYDRA_CANCELLED within about one tile's time, unless the render is
   done. It stays readable, and the step after that one goes on. */
HYDRA_API void hydra_render_cancel(hydra_render *render);

typedef enum hydra_stage { HYDRA_STAGE_FIRST_PASS, HYDRA_STAGE_REFINING, HYDRA_STAGE_DONE } hydra_stage;

typedef struct hydra_status {
    hydra_stage stage;
    double fraction;          /* 0..1 of the work, by the budget that will end it first */
    double seconds;           /* spent in hydra_render_step */
    double seconds_left;      /* estimated; infinity: cannot be known yet */
    double samples;           /* mean a pixel */
    /* Relative error of the picture as it is: sqrt(mean over pixels of (error / max(value, L/10))^2), L the
       mean luminance of the picture, and its 95 % confidence interval. Infinite before the first pass ended. */
    double error, error_low, error_high;
    double tiles_active, tiles_total;
    uint64_t heavy_pixels;    /* flagged HYDRA_VALID_HEAVY_TAIL */
    uint64_t dropped_samples; /* not finite */
    /* Report: rays by kind, CPU seconds by pass summed over threads. */
    uint64_t rays_camera, rays_bounce, rays_shadow, paths;
    double seconds_generate, seconds_intersect, seconds_shade, seconds_shadow, seconds_accumulate;
    size_t bytes_film, bytes_lanes;
} hydra_status;

/* NULL gives a zeroed status. Between steps only. */
HYDRA_API hydra_status hydra_render_status(hydra_render *render);

/* Writes an output: width x height of the region, rows of row_stride bytes (0: tight), row 0 on top.
   pixels is the caller's and must hold them. */
HYDRA_API hydra_result hydra_render_read(hydra_render *render, hydra_output output, void *pixels, size_t row_stride);
/* Bytes of one pixel of an output: 4 or 12. 0 for a value that is no output. */
HYDRA_API size_t hydra_output_size(hydra_output output);

/* Films. save writes the whole state of a render, of *size bytes; with buffer NULL it only tells the size.
   The bytes are the same on every machine. merge adds a saved film to a render made with the same
   scene, sensor, size, seed, tile size and outputs. Either the sample ranges must be disjoint (and the added film
   finished, without a target error), or the tiles: regions then start at multiples of the tile size. What was rendered
   apart is the same, to the bit, as one render of everything; only with a target error do regions differ, since each
   judges by the brightness of its own. Merging a film into a fresh render with the same desc resumes it exactly. On
   error the render is unchanged. */
HYDRA_API hydra_result hydra_render_save(const hydra_render *render, void *buffer, size_t *size);
HYDRA_API hydra_result hydra_render_merge(hydra_render *render, const void *film, size_t size);

/* What a render would take of the host's memory, before it is created. On a device context (hydra_vk.h) some kilobytes of
   the device's bookkeeping come to it. */
typedef struct hydra_estimate_result {
    size_t bytes_film, bytes_lanes, bytes_sensor, bytes_total;
    uint32_t passes;          /* bits of hydra_pass that will run */
    uint32_t kernel_features; /* hydra_feature bits compiled into the shading kernel that will run */
} hydra_estimate_result;

typedef enum hydra_pass {
    HYDRA_PASS_GENERATE = 1 << 0,
    HYDRA_PASS_INTERSECT = 1 << 1,
    HYDRA_PASS_SHAPES = 1 << 2,
    HYDRA_PASS_SHADE = 1 << 3,
    HYDRA_PASS_SHADOW = 1 << 4,
    HYDRA_PASS_ACCUMULATE = 1 << 5
} hydra_pass;

HYDRA_API hydra_result hydra_estimate(hydra_scene *scene, const hydra_render_desc *desc, hydra_estimate_result *estimate);

#ifdef __cplusplus
}
#endif

#endif /* HYDRA_H */

/* ================================================================ end of the API */

#if defined(HYDRA_IMPLEMENTATION) && !defined(HYI_IMPLEMENTED)
#define HYI_IMPLEMENTED

/* The implementation, part by part; search for a mark to get there.

     >>base-platform            compiler, instruction sets, atomics, threads, time
     >>base-context             the context, its errors, log, memory and threads
     >>base-threads             a pool that runs one loop at a time
     >>base-backend             what a context offers that computes elsewhere than on its threads
     >>base-create              contexts, and the text of results
     >>shared-language          what lets one source be C99, C++11 and GLSL 4.60
     >>shared-vector            scalars and vectors under one name in C and GLSL
     >>shared-layouts           the records that kernels read, the same bytes in C and under std430
     >>shared-light-layouts     nodes of the light tree, and how the environment's sampling weights are laid out
     >>shared-views             how kernels reach the scene's buffers
     >>shared-texture           texels, wrapping, bilinear lookup in one mip level
     >>shared-sampler           Owen-scrambled Sobol points, spread over the screen like blue noise
     >>shared-sampling          warps of the unit square, their densities, and the weights of multiple importance sampling
     >>shared-alpha             a triangle's material and uv, and which candidate hits stop a ray, decided inside the traversal
     >>shared-shape             lights that rays can hit: rectangle, disc, sphere
     >>shared-surface           what stands at a hit: place and its error bound, normals, material with textures applied
     >>shared-fresnel           reflectance of smooth interfaces, mirrored and refracted directions
     >>shared-microfacet        the GGX distribution, Smith masking and sampling of visible normals
     >>shared-energy            tables of the energy that single scattering loses, and how they are read
     >>shared-bsdf-layers       what a surface point is made of, and how much each part takes of the light
     >>shared-bsdf-lobes        values and densities of the lobes, for a pair of directions
     >>shared-bsdf              evaluates and samples a surface's scattering
     >>shared-surface-light     points on rectangles, discs, spheres and triangles, in proportion to solid angle
     >>shared-emission          what a surface radiates at a texture coordinate
     >>shared-environment       radiance from infinitely far, and directions in proportion to it
     >>shared-light-tree        choosing one of many lights by what it can give at a point
     >>shared-light             choosing a light and a direction to it, and the density of that choice
     >>shared-camera            rays of the sensors
     >>shared-path              one vertex of a path: emission found, light sampled, next direction
     >>shared-passes            what passes over a pool of lanes hand to each other, and how a lane begins
     >>bvh-layout               what a built tree looks like in memory
     >>bvh-build-vector         four floats at a time for the builder: boxes as two of them
     >>bvh-build-refs           the primitives of a build: boxes and ids, degenerate triangles dropped
     >>bvh-build-split          where to cut a range of primitives: binned surface area heuristic
     >>bvh-build-spatial        spatial splits: parts of triangles on both sides of a plane
     >>bvh-build-part           a range of references becomes two: who goes where, and who owns which places
     >>bvh-build-tree           the binary tree: large ranges cut by all threads together, small ones a thread each
     >>bvh-build-cost           which subtrees of the binary tree become wide nodes and leaves
     >>bvh-build-collapse       from the binary tree to eight-wide nodes and rows of triangles
     >>bvh-build                from triangles or boxes to a tree
     >>bvh-refit                a tree over triangles that moved: same nodes, new boxes and rows, and what it costs now
     >>bvh-save                 a tree as bytes, and bytes as a tree again, once everything in them has been checked
     >>bvh-triangle             a ray made ready for one tree, and the watertight triangle test
     >>bvh-walk                 what rays can meet, one ray on its way through a tree, and who decides on a triangle
     >>bvh-stream               many rays through a tree together
     >>bvh-scalar               traversal in plain C, for any machine: eight lanes are eight floats
     >>bvh-avx2                 traversal in the words of AVX2: eight rays a packet
     >>bvh-avx512               traversal in the words of AVX-512: sixteen rays a packet, lists dealt by compression
     >>bvh-sse42                traversal in the words of SSE4.2: eight lanes are two times four
     >>bvh-neon                 traversal in the words of NEON: eight lanes are two times four
     >>bvh-trace                what the renderer calls: batches of rays against surfaces, then against light shapes
     >>scene                    what a scene holds, and its life
     >>scene-validate           checks shared by all descriptors; each names its error
     >>scene-materials          descriptors checked and turned into what kernels read
     >>scene-meshes             copies of the caller's geometry, and where it is placed
     >>scene-trees              the trees over meshes: loaded, built, or fitted to vertices that moved; and saved
     >>scene-textures           copies of texels and their mip pyramids
     >>scene-energy-tables      computes the albedo tables that the scene's materials need
     >>scene-environment        sampling weights of an environment map (shaders/shared/light_layouts.h has the layout)
     >>scene-light-tree         the tree over the finite lights
     >>scene-lights             light descriptors, the environment, and the list of all emitters of a committed scene
     >>scene-commit             from what the caller gave to what rays and kernels read, renewing only what changed
     >>scene-queries            the caller's own rays
     >>backend-chunk            what a backend is asked for: the samples of one tile, and what it gives back
     >>backend-cpu              the pass sequence on one worker's batch
     >>render-exact-sum         sums that do not depend on the order of their terms
     >>render-film              what is known of each pixel, and how samples come in
     >>render-adaptive          which tile gets how many samples
     >>render-sensor            sensor descriptors checked and turned into what kernels read
     >>render                   a picture in progress: creation, steps, cancelling
     >>render-statistics        standard errors of pixels, error of the picture, status
     >>render-read              outputs, pixel by pixel
     >>render-share             films saved, resumed and added up
     >>render-estimate          what a render would take, by the very functions that will take it
     >>selftest                 known answers, asked on the user's own machine through the public calls
*/

/* >>base-platform: compiler, instruction sets, atomics, threads, time */
#ifndef HYI_PLATFORM_H
#define HYI_PLATFORM_H

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>
#else
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
#if !defined(HYDRA_NO_THREADS)
#include <pthread.h>
#endif
#endif

#if defined(__GNUC__) || defined(__clang__)
#define HYI_GNU 1
#define HYI_INLINE static inline __attribute__((always_inline, unused))
#define HYI_NOINLINE static __attribute__((noinline, unused))
#define HYI_FN static __attribute__((unused))
#define HYI_PRINTF(text, first) __attribute__((format(printf, text, first)))
#define HYI_PREFETCH(p) __builtin_prefetch(p)
#define HYI_LIKELY(x) __builtin_expect(!!(x), 1)
#define HYI_UNLIKELY(x) __builtin_expect(!!(x), 0)
#else
#define HYI_GNU 0
#define HYI_INLINE static inline
#define HYI_NOINLINE static
#define HYI_FN static
#define HYI_PRINTF(text, first)
#define HYI_PREFETCH(p) ((void)(p))
#define HYI_LIKELY(x) (x)
#define HYI_UNLIKELY(x) (x)
#endif

#if !defined(HYDRA_NO_SIMD) && (defined(__x86_64__) || defined(_M_X64))
#define HYI_X86 1
#include <immintrin.h>
#if !HYI_GNU
#include <intrin.h>
#endif
#else
#define HYI_X86 0
#endif
#if !defined(HYDRA_NO_SIMD) && defined(__aarch64__)
#define HYI_NEON 1
#include <arm_neon.h>
#else
#define HYI_NEON 0
#endif
/* Functions that use one instruction set, chosen at run time. FMA may merge products and sums in them: where
   the watertight triangle test stands on separate rounding, that is pinned by hyi_rounded and its kin. */
#if HYI_X86 && HYI_GNU
#define HYI_SSE42 __attribute__((target("sse4.2,popcnt")))
#define HYI_AVX2 __attribute__((target("avx2,fma,bmi,lzcnt,popcnt")))
#define HYI_AVX512 __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,avx2,fma,bmi,lzcnt,popcnt")))
#else
#define HYI_SSE42
#define HYI_AVX2
#define HYI_AVX512
#endif

/* Returns from the enclosing function on anything but HYDRA_OK. */
#define HYI_TRY(expression)                            \
    do {                                               \
        hydra_result hyi_try_result = (expression);    \
        if (hyi_try_result != HYDRA_OK) return hyi_try_result; \
    } while (0)

#define HYI_PI 3.14159265358979323846
#define HYI_COUNT(array) (sizeof(array) / sizeof((array)[0]))
/* A declaration that may be repeated, of a function that is never defined. */
#define HYI_STATIC_ASSERT(condition) extern void hyi_assert_holds(char (*)[(condition) ? 1 : -1])

/* A product kept as its own rounded value: with FMA or fast-math the compiler would otherwise merge it
   into a following sum. Costs no instruction. */
HYI_INLINE float hyi_rounded(float product) {
#if HYI_GNU && defined(__x86_64__)
    __asm__("" : "+x"(product));
#elif HYI_GNU && defined(__aarch64__)
    __asm__("" : "+w"(product));
#endif
    return product;
}

/* Asks for the cache line at address ahead of its use. */
HYI_INLINE void hyi_prefetch(const void *address) {
#if HYI_GNU
    __builtin_prefetch(address);
#elif HYI_X86
    _mm_prefetch((const char *)address, _MM_HINT_T0);
#else
    (void)address;
#endif
}

/* Which thread this is; never 0. */
HYI_INLINE int64_t hyi_this_thread(void) {
#if defined(HYDRA_NO_THREADS)
    return 1;
#elif defined(_WIN32)
    return (int64_t)GetCurrentThreadId();
#else
    return (int64_t)(uintptr_t)pthread_self();
#endif
}

/* ---- atomics, all sequentially consistent: they are used per tile, never per ray */

typedef struct hyi_atomic { int64_t value; } hyi_atomic;

HYI_INLINE int64_t hyi_atomic_add(hyi_atomic *a, int64_t amount) {
#if HYI_GNU
    return __atomic_fetch_add(&a->value, amount, __ATOMIC_SEQ_CST);
#else
    return _InterlockedExchangeAdd64((volatile __int64 *)&a->value, amount);
#endif
}

HYI_INLINE int64_t hyi_atomic_load(const hyi_atomic *a) {
#if HYI_GNU
    return __atomic_load_n(&a->value, __ATOMIC_SEQ_CST);
#else
    return _InterlockedCompareExchange64((volatile __int64 *)&a->value, 0, 0);
#endif
}

HYI_INLINE void hyi_atomic_store(hyi_atomic *a, int64_t value) {
#if HYI_GNU
    __atomic_store_n(&a->value, value, __ATOMIC_SEQ_CST);
#else
    _InterlockedExchange64((volatile __int64 *)&a->value, value);
#endif
}

/* Returns whether value was expected and is now desired. */
HYI_INLINE bool hyi_atomic_swap_if(hyi_atomic *a, int64_t expected, int64_t desired) {
#if HYI_GNU
    return __atomic_compare_exchange_n(&a->value, &expected, desired, false, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
#else
    return _InterlockedCompareExchange64((volatile __int64 *)&a->value, desired, expected) == expected;
#endif
}

/* Raises the atomic to at least value. */
HYI_INLINE void hyi_atomic_raise(hyi_atomic *a, int64_t value) {
    int64_t seen = hyi_atomic_load(a);
    while (seen < value && !hyi_atomic_swap_if(a, seen, value)) seen = hyi_atomic_load(a);
}

/* ---- time and machine */

/* Seconds on a clock that never goes back. */
HYI_FN double hyi_seconds(void) {
#if defined(_WIN32)
    LARGE_INTEGER now, frequency;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&frequency);
    return (double)now.QuadPart / (double)frequency.QuadPart;
#else
#if defined(CLOCK_MONOTONIC)
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#else /* strict C99, and a system header came before this one: POSIX clocks are hidden */
    struct timeval now;
    gettimeofday(&now, NULL);
    return (double)now.tv_sec + 1e-6 * (double)now.tv_usec;
#endif
#endif
}

HYI_FN uint32_t hyi_processor_count(void) {
#if defined(_WIN32)
    SYSTEM_INFO info;
    GetSystemInfo(&info);
    return info.dwNumberOfProcessors ? (uint32_t)info.dwNumberOfProcessors : 1u;
#else
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n > 0 ? (uint32_t)n : 1u;
#endif
}

HYI_FN bool hyi_has_sse42(void) {
#if HYI_X86 && HYI_GNU
    return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
#elif HYI_X86
    int leaf1[4];
    __cpuid(leaf1, 1);
    return (leaf1[2] & (1 << 20)) && (leaf1[2] & (1 << 23));
#else
    return false;
#endif
}

HYI_FN bool hyi_has_avx2(void) {
#if HYI_X86 && HYI_GNU
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi");
#elif HYI_X86
    int leaf1[4], leaf7[4];
    __cpuid(leaf1, 1);
    __cpuidex(leaf7, 7, 0);
    return (leaf1[2] & (1 << 27)) && (leaf1[2] & (1 << 12)) && (_xgetbv(0) & 6) == 6 && (leaf7[1] & (1 << 5)) && (leaf7[1] & (1 << 3));
#else
    return false;
#endif
}

HYI_FN bool hyi_has_avx512(void) {
#if HYI_X86 && HYI_GNU
    return hyi_has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
#elif HYI_X86
    int leaf7[4];
    __cpuidex(leaf7, 7, 0);
    const int needed = 1 << 16 | 1 << 17 | 1 << 30 | (int)(1u << 31);
    return hyi_has_avx2() && (_xgetbv(0) & 0xe6) == 0xe6 && (leaf7[1] & needed) == needed;
#else
    return false;
#endif
}

#endif /* HYI_PLATFORM_H */

/* >>base-context: the context, its errors, log, memory and threads */
#ifndef HYI_CONTEXT_H
#define HYI_CONTEXT_H

typedef struct hyi_pool hyi_pool;
struct hyi_backend;

struct hydra_context {
    hydra_context_desc desc;
    hydra_isa isa;
    uint32_t threads;
    hyi_pool *pool; /* NULL: one thread, or the caller's parallel_for */
    const struct hyi_backend *backend; /* NULL: work is done on the threads (backend.h) */
    void *device;                      /* the backend's */
    uint32_t scenes_living;
    hyi_atomic quiet_thread; /* whose failures leave no text, since it casts rays; 0: none */
    hyi_atomic bytes_now, bytes_peak, allocations_now;
    char error[512];
};

/* ---- errors and log */

HYI_FN void hyi_log(const hydra_context *context, hydra_log_level level, const char *text) {
    if (context->desc.log) context->desc.log(context->desc.log_user, level, text);
}

/* Records and logs the message, unless the thread is to be quiet; returns result, so that a function can end with it. */
HYI_NOINLINE hydra_result hyi_fail(hydra_context *context, hydra_result result, const char *format, ...) HYI_PRINTF(3, 4);
HYI_NOINLINE hydra_result hyi_fail(hydra_context *context, hydra_result result, const char *format, ...) {
    if (hyi_atomic_load(&context->quiet_thread) == hyi_this_thread()) return result;
    int used = snprintf(context->error, sizeof context->error, "%s: ", hydra_result_text(result));
    size_t at = used > 0 && (size_t)used < sizeof context->error ? (size_t)used : 0;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(context->error + at, sizeof context->error - at, format, arguments);
    va_end(arguments);
    hyi_log(context, HYDRA_LOG_ERROR, context->error);
    return result;
}

/* ---- memory. Every block is freed with the size it was asked for with. */

HYI_FN void *hyi_default_alloc(void *user, size_t size) {
    (void)user;
#if defined(_WIN32)
    return _aligned_malloc(size, 64);
#else /* posix_memalign is hidden in strict C99: align by hand, keeping malloc's pointer before the block */
    char *block = size <= SIZE_MAX - 64 - sizeof(void *) ? (char *)malloc(size + 64 + sizeof(void *)) : NULL;
    if (!block) return NULL;
    char *aligned = block + sizeof(void *);
    aligned += (64 - (uintptr_t)aligned % 64) % 64;
    memcpy(aligned - sizeof(void *), &block, sizeof block);
    return aligned;
#endif
}

HYI_FN void hyi_default_release(void *user, void *memory, size_t size) {
    (void)user;
    (void)size;
#if defined(_WIN32)
    _aligned_free(memory);
#else
    void *block;
    memcpy(&block, (char *)memory - sizeof(void *), sizeof block);
    free(block);
#endif
}

HYI_FN bool hyi_multiply_overflows(size_t a, size_t b) {
    return b != 0 && a > SIZE_MAX / b;
}

/* *memory gets size bytes aligned to 64, or NULL when size is 0. Contents are undefined. Any thread; says nothing in
   the context's text. */
HYI_FN hydra_result hyi_try_alloc(hydra_context *context, size_t size, void **memory) {
    *memory = NULL;
    if (size == 0) return HYDRA_OK;
    size_t now = (size_t)hyi_atomic_add(&context->bytes_now, (int64_t)size) + size;
    bool allowed = !context->desc.memory_cap || now <= context->desc.memory_cap;
    if (allowed) *memory = context->desc.allocator.alloc(context->desc.allocator.user, size);
    if (!*memory) {
        hyi_atomic_add(&context->bytes_now, -(int64_t)size);
        return allowed ? HYDRA_ERROR_OUT_OF_MEMORY : HYDRA_ERROR_MEMORY_CAP;
    }
    hyi_atomic_raise(&context->bytes_peak, (int64_t)now);
    hyi_atomic_add(&context->allocations_now, 1);
    return HYDRA_OK;
}

/* The same with a message. */
HYI_FN hydra_result hyi_alloc_bytes(hydra_context *context, size_t size, void **memory) {
    hydra_result result = hyi_try_alloc(context, size, memory);
    if (result == HYDRA_ERROR_OUT_OF_MEMORY) return hyi_fail(context, result, "%zu bytes", size);
    if (result != HYDRA_ERROR_MEMORY_CAP) return result;
    size_t now = (size_t)hyi_atomic_load(&context->bytes_now);
    return hyi_fail(context, result, "%zu bytes more than the %zu now, the cap is %zu", size, now, context->desc.memory_cap);
}

HYI_FN void hyi_free_bytes(hydra_context *context, void *memory, size_t size) {
    if (!memory) return;
    context->desc.allocator.release(context->desc.allocator.user, memory, size);
    hyi_atomic_add(&context->bytes_now, -(int64_t)size);
    hyi_atomic_add(&context->allocations_now, -1);
}

/* Arrays of count elements: hyi_alloc_array(context, &pointer, count) and its reverse, which also sets
   the pointer to NULL. The element type is the pointer's. */
HYI_FN hydra_result hyi_alloc_elements(hydra_context *context, void **memory, size_t count, size_t element) {
    *memory = NULL;
    if (hyi_multiply_overflows(count, element)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%zu elements of %zu bytes", count, element);
    return hyi_alloc_bytes(context, count * element, memory);
}
#define hyi_alloc_array(context, pointer, count) hyi_alloc_elements((context), (void **)(pointer), (count), sizeof **(pointer))
#define hyi_free_array(context, pointer, count) \
    (hyi_free_bytes((context), *(pointer), (size_t)(count) * sizeof **(pointer)), *(pointer) = NULL)

/* Grows an array to hold at least need elements, by half its size at a time; old contents stay. */
HYI_FN hydra_result hyi_grow_elements(hydra_context *context, void **memory, size_t *capacity, size_t need, size_t element) {
    if (need <= *capacity) return HYDRA_OK;
    size_t grown = *capacity + *capacity / 2 + 8;
    if (grown < need) grown = need;
    void *fresh;
    HYI_TRY(hyi_alloc_elements(context, &fresh, grown, element));
    if (*memory) memcpy(fresh, *memory, *capacity * element);
    hyi_free_bytes(context, *memory, *capacity * element);
    *memory = fresh;
    *capacity = grown;
    return HYDRA_OK;
}
#define hyi_grow_array(context, pointer, capacity, need) \
    hyi_grow_elements((context), (void **)(pointer), (capacity), (need), sizeof **(pointer))

#endif /* HYI_CONTEXT_H */

/* >>base-threads: a pool that runs one loop at a time */
#ifndef HYI_THREADS_H
#define HYI_THREADS_H

typedef void (*hyi_task)(void *argument, uint32_t index);

#if !defined(HYDRA_NO_THREADS)

#if defined(_WIN32)
typedef SRWLOCK hyi_mutex;
typedef CONDITION_VARIABLE hyi_condition;
typedef HANDLE hyi_thread;
#define hyi_mutex_init(m) InitializeSRWLock(m)
#define hyi_mutex_lock(m) AcquireSRWLockExclusive(m)
#define hyi_mutex_unlock(m) ReleaseSRWLockExclusive(m)
#define hyi_mutex_destroy(m) ((void)(m))
#define hyi_condition_init(c) InitializeConditionVariable(c)
#define hyi_condition_wait(c, m) SleepConditionVariableSRW((c), (m), INFINITE, 0)
#define hyi_condition_wake_all(c) WakeAllConditionVariable(c)
#define hyi_condition_destroy(c) ((void)(c))
#else
typedef pthread_mutex_t hyi_mutex;
typedef pthread_cond_t hyi_condition;
typedef pthread_t hyi_thread;
#define hyi_mutex_init(m) pthread_mutex_init((m), NULL)
#define hyi_mutex_lock(m) pthread_mutex_lock(m)
#define hyi_mutex_unlock(m) pthread_mutex_unlock(m)
#define hyi_mutex_destroy(m) pthread_mutex_destroy(m)
#define hyi_condition_init(c) pthread_cond_init((c), NULL)
#define hyi_condition_wait(c, m) pthread_cond_wait((c), (m))
#define hyi_condition_wake_all(c) pthread_cond_broadcast(c)
#define hyi_condition_destroy(c) pthread_cond_destroy(c)
#endif

struct hyi_pool {
    hyi_mutex mutex;
    hyi_condition work_is_there, work_is_done;
    hyi_task task;
    void *argument;
    uint32_t count;
    hyi_atomic next;      /* first index nobody has taken */
    uint64_t generation;  /* of the loop in work; under mutex, like the rest */
    uint32_t busy;        /* workers inside the loop */
    uint32_t workers;     /* started threads; the caller works too */
    bool quit;
    hyi_thread *threads;
};

HYI_FN void hyi_pool_work(hyi_pool *pool) {
    for (;;) {
        int64_t index = hyi_atomic_add(&pool->next, 1);
        if (index >= (int64_t)pool->count) return;
        pool->task(pool->argument, (uint32_t)index);
    }
}

#if defined(_WIN32)
static DWORD WINAPI hyi_pool_thread(void *argument)
#else
static void *hyi_pool_thread(void *argument)
#endif
{
    hyi_pool *pool = (hyi_pool *)argument;
    uint64_t done = 0;
    hyi_mutex_lock(&pool->mutex);
    for (;;) {
        while (!pool->quit && pool->generation == done) hyi_condition_wait(&pool->work_is_there, &pool->mutex);
        if (pool->quit) break;
        done = pool->generation;
        hyi_mutex_unlock(&pool->mutex);
        hyi_pool_work(pool);
        hyi_mutex_lock(&pool->mutex);
        if (--pool->busy == 0) hyi_condition_wake_all(&pool->work_is_done);
    }
    hyi_mutex_unlock(&pool->mutex);
    return 0;
}

HYI_FN void hyi_pool_run(hyi_pool *pool, uint32_t count, hyi_task task, void *argument) {
    hyi_mutex_lock(&pool->mutex);
    pool->task = task;
    pool->argument = argument;
    pool->count = count;
    hyi_atomic_store(&pool->next, 0);
    pool->busy = pool->workers;
    pool->generation++;
    hyi_condition_wake_all(&pool->work_is_there);
    hyi_mutex_unlock(&pool->mutex);
    hyi_pool_work(pool);
    hyi_mutex_lock(&pool->mutex);
    while (pool->busy) hyi_condition_wait(&pool->work_is_done, &pool->mutex);
    hyi_mutex_unlock(&pool->mutex);
}

HYI_FN bool hyi_thread_start(hyi_thread *thread, hyi_pool *pool) {
#if defined(_WIN32)
    *thread = CreateThread(NULL, 0, hyi_pool_thread, pool, 0, NULL);
    return *thread != NULL;
#else
    return pthread_create(thread, NULL, hyi_pool_thread, pool) == 0;
#endif
}

HYI_FN void hyi_thread_join(hyi_thread thread) {
#if defined(_WIN32)
    WaitForSingleObject(thread, INFINITE);
    CloseHandle(thread);
#else
    pthread_join(thread, NULL);
#endif
}

HYI_FN void hyi_pool_destroy(hydra_context *context) {
    hyi_pool *pool = context->pool;
    if (!pool) return;
    hyi_mutex_lock(&pool->mutex);
    pool->quit = true;
    hyi_condition_wake_all(&pool->work_is_there);
    hyi_mutex_unlock(&pool->mutex);
    for (uint32_t i = 0; i < pool->workers; i++) hyi_thread_join(pool->threads[i]);
    hyi_condition_destroy(&pool->work_is_there);
    hyi_condition_destroy(&pool->work_is_done);
    hyi_mutex_destroy(&pool->mutex);
    hyi_free_array(context, &pool->threads, context->threads - 1);
    hyi_free_array(context, &context->pool, 1);
}

/* Starts threads - 1 workers: the calling thread is the last one. */
HYI_FN hydra_result hyi_pool_create(hydra_context *context) {
    HYI_TRY(hyi_alloc_array(context, &context->pool, 1));
    hyi_pool *pool = context->pool;
    memset(pool, 0, sizeof *pool);
    if (hyi_alloc_array(context, &pool->threads, context->threads - 1) != HYDRA_OK) {
        hyi_free_array(context, &context->pool, 1);
        return HYDRA_ERROR_OUT_OF_MEMORY;
    }
    hyi_mutex_init(&pool->mutex);
    hyi_condition_init(&pool->work_is_there);
    hyi_condition_init(&pool->work_is_done);
    while (pool->workers < context->threads - 1 && hyi_thread_start(&pool->threads[pool->workers], pool)) pool->workers++;
    if (pool->workers == context->threads - 1) return HYDRA_OK;
    hyi_pool_destroy(context);
    return HYDRA_ERROR_THREADS;
}

#endif /* HYDRA_NO_THREADS */

/* Calls task(argument, i) for every i < count on the context's threads, and returns when all are done.
   Loops do not nest. */
HYI_FN void hyi_parallel(const hydra_context *context, uint32_t count, hyi_task task, void *argument) {
    if (count == 0) return;
    if (context->desc.parallel_for) {
        context->desc.parallel_for(context->desc.parallel_user, count, task, argument);
        return;
    }
#if !defined(HYDRA_NO_THREADS)
    if (context->pool && count > 1) {
        hyi_pool_run(context->pool, count, task, argument);
        return;
    }
#endif
    for (uint32_t i = 0; i < count; i++) task(argument, i);
}

#endif /* HYI_THREADS_H */

/* >>base-backend: what a context offers that computes elsewhere than on its threads

   Scenes, films, schedules and error bars are the host's; a backend is told when a scene was committed, traces rays, and
   takes units of a render's round and hands their lanes to hyi_accumulate. */
#ifndef HYI_BACKEND_H
#define HYI_BACKEND_H

struct hyk_hit;


/* Any of them may be called only while the object it is about lives. Those that fail say why in the context's text, but
   for trace, which many threads may call. */
typedef struct hyi_backend {
    void (*destroy)(hydra_context *context);
    /* dirty: HYI_DIRTY_... since the last commit that succeeded. */
    hydra_result (*commit)(hydra_scene *scene, uint32_t dirty);
    void (*forget_scene)(hydra_scene *scene);
    hydra_result (*begin_render)(hydra_render *render);
    void (*end_render)(hydra_render *render);
    /* Takes units of the round until it is empty or time is up; all that were taken are finished on return. */
    hydra_result (*work)(hydra_render *render);
    /* hits, or else occluded; light shapes included. HYDRA_ERROR_RAY: some were not sound; they meet nothing. */
    hydra_result (*trace)(const hydra_scene *scene, const hydra_ray *rays, struct hyk_hit *hits, uint8_t *occluded, uint32_t count);
} hyi_backend;

#endif /* HYI_BACKEND_H */

/* >>base-create: contexts, and the text of results */
#ifndef HYI_CREATE_H
#define HYI_CREATE_H

HYDRA_API const char *hydra_result_text(hydra_result result) {
    switch (result) {
#define HYI_RESULT_CASE(name, text) case name: return text;
        HYDRA_RESULTS(HYI_RESULT_CASE)
#undef HYI_RESULT_CASE
        case HYDRA_RESULT_COUNT: break;
    }
    return "not a result";
}

HYDRA_API const char *hydra_error_text(const hydra_context *context) {
    return context ? context->error : "no context: out of memory or threads, half an allocator, or an instruction set that is not there";
}

HYI_FN hydra_isa hyi_best_isa(void) {
    if (hyi_has_avx512()) return HYDRA_ISA_AVX512;
    if (hyi_has_avx2()) return HYDRA_ISA_AVX2;
    if (hyi_has_sse42()) return HYDRA_ISA_SSE42;
    return HYI_NEON ? HYDRA_ISA_NEON : HYDRA_ISA_SCALAR;
}

HYI_FN bool hyi_isa_is_there(hydra_isa isa) {
    switch (isa) {
    case HYDRA_ISA_SCALAR: return true;
    case HYDRA_ISA_SSE42: return hyi_has_sse42();
    case HYDRA_ISA_AVX2: return hyi_has_avx2();
    case HYDRA_ISA_AVX512: return hyi_has_avx512();
    case HYDRA_ISA_NEON: return HYI_NEON;
    default: return false;
    }
}

HYI_FN hydra_context_desc hyi_resolved_context_desc(const hydra_context_desc *desc) {
    hydra_context_desc resolved;
    memset(&resolved, 0, sizeof resolved);
    if (desc) resolved = *desc;
    if (!resolved.allocator.alloc && !resolved.allocator.release) {
        resolved.allocator.alloc = hyi_default_alloc;
        resolved.allocator.release = hyi_default_release;
    }
    if (resolved.threads == 0) resolved.threads = hyi_processor_count();
    if (resolved.threads > 1024) resolved.threads = 1024;
    if (resolved.isa == HYDRA_ISA_AUTO) resolved.isa = hyi_best_isa();
    return resolved;
}

HYDRA_API hydra_context *hydra_create(const hydra_context_desc *desc) {
    hydra_context_desc resolved = hyi_resolved_context_desc(desc);
    if (!hyi_isa_is_there(resolved.isa) || !resolved.allocator.alloc || !resolved.allocator.release) return NULL;
    if (resolved.memory_cap && resolved.memory_cap < sizeof(hydra_context)) return NULL;
    hydra_context *context = (hydra_context *)resolved.allocator.alloc(resolved.allocator.user, sizeof *context);
    if (!context) return NULL;
    memset(context, 0, sizeof *context);
    context->desc = resolved;
    context->isa = resolved.isa;
    context->threads = resolved.threads;
    hyi_atomic_store(&context->bytes_now, (int64_t)sizeof *context);
    hyi_atomic_store(&context->bytes_peak, (int64_t)sizeof *context);
    hyi_atomic_store(&context->allocations_now, 1);
#if defined(HYDRA_NO_THREADS)
    if (!resolved.parallel_for) context->threads = 1;
#else
    if (context->threads > 1 && !resolved.parallel_for && hyi_pool_create(context) != HYDRA_OK) {
        resolved.allocator.release(resolved.allocator.user, context, sizeof *context);
        return NULL;
    }
#endif
    return context;
}

HYDRA_API hydra_result hydra_destroy(hydra_context *context) {
    if (!context) return HYDRA_OK;
    if (context->scenes_living) return hyi_fail(context, HYDRA_ERROR_BUSY, "%u scenes of the context are alive", context->scenes_living);
#if !defined(HYDRA_NO_THREADS)
    hyi_pool_destroy(context);
#endif
    if (context->backend) context->backend->destroy(context);
    hydra_allocator allocator = context->desc.allocator;
    allocator.release(allocator.user, context, sizeof *context);
    return HYDRA_OK;
}

HYDRA_API hydra_memory_status hydra_memory(const hydra_context *context) {
    hydra_memory_status status = { 0, 0, 0 };
    if (!context) return status;
    status.bytes_now = (size_t)hyi_atomic_load(&context->bytes_now);
    status.bytes_peak = (size_t)hyi_atomic_load(&context->bytes_peak);
    status.allocations_now = (size_t)hyi_atomic_load(&context->allocations_now);
    return status;
}

HYDRA_API hydra_isa hydra_context_isa(const hydra_context *context) { return context ? context->isa : HYDRA_ISA_SCALAR; }
HYDRA_API uint32_t hydra_context_threads(const hydra_context *context) { return context ? context->threads : 0; }

#endif /* HYI_CREATE_H */

/* >>shared-language: what lets one source be C99, C++11 and GLSL 4.60

   GLSL includes this with HYK_GLSL defined. In C, HYK_REAL may be double: the oracle.
   Rules for everything in shaders/shared: hyk_vec3 and friends have no operators, use the functions of
   vector.h; structs are declared with HYK_STRUCT and ended with HYK_END; functions with HYK_FN, or HYK_CALLED where they
   are so long that C should have one copy of them rather than one in each kernel; no
   pointers, no recursion, no implicit conversions; literals exact in binary carry an f suffix, all
   others go through HYK_C. Conversions: HYK_TO_REAL(x), HYK_TO_UINT(x), HYK_TO_INT(x). */
#ifndef HYK_LANGUAGE_H
#define HYK_LANGUAGE_H

#ifdef HYK_GLSL

#define HYK_FN
#define HYK_CALLED
#define HYK_STRUCT(name) struct name
#define HYK_END(name) ;
#define hyk_real float
#define hyk_uint uint
#define hyk_int int
#define hyk_bool bool
#define hyk_vec2 vec2
#define hyk_vec3 vec3
#define HYK_C(x) float(x)
#define HYK_TO_REAL(x) float(x)
#define HYK_TO_FLOAT(x) float(x)
#define HYK_TO_UINT(x) uint(x)
#define HYK_TO_INT(x) int(x)
#define HYK_REAL_MAX 3.402823466e+38
#define HYK_REAL_EPSILON 5.9604644775390625e-08 /* half an ulp of 1 */
#define HYK_SIZE_IS(name, bytes)

#else

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#ifndef HYK_REAL
#define HYK_REAL float
#define HYK_REAL_IS_FLOAT 1
#endif
#ifndef HYK_REAL_IS_FLOAT
#define HYK_REAL_IS_FLOAT 0
#endif

#if defined(__GNUC__) || defined(__clang__)
#define HYK_FN static inline __attribute__((always_inline, unused))
#define HYK_CALLED static __attribute__((noinline, unused))
#else
#define HYK_FN static inline
#define HYK_CALLED static
#endif
#define HYK_STRUCT(name) typedef struct name
#define HYK_END(name) name;

typedef HYK_REAL hyk_real;
typedef uint32_t hyk_uint;
typedef int32_t hyk_int;
typedef bool hyk_bool;
typedef struct hyk_vec2 { hyk_real x, y; } hyk_vec2;
typedef struct hyk_vec3 { hyk_real x, y, z; } hyk_vec3;

#define HYK_C(x) ((hyk_real)(x))
#define HYK_TO_REAL(x) ((hyk_real)(x))
#define HYK_TO_FLOAT(x) ((float)(x))
#define HYK_TO_UINT(x) ((hyk_uint)(x))
#define HYK_TO_INT(x) ((hyk_int)(x))
#if HYK_REAL_IS_FLOAT
#define HYK_REAL_MAX 3.402823466e+38f
#define HYK_REAL_EPSILON 5.9604644775390625e-08f
/* Size of a layout in bytes, the same under std430. Checked where hyk_real is float. */
#define HYK_SIZE_IS(name, bytes) typedef char hyk_size_of_##name[sizeof(name) == (bytes) ? 1 : -1];
#else
#define HYK_REAL_MAX 1.7976931348623157e+308
#define HYK_REAL_EPSILON 1.1102230246251565e-16
#define HYK_SIZE_IS(name, bytes)
#endif

#endif /* HYK_GLSL */

#define HYK_PI HYK_C(3.14159265358979323846)
#define HYK_INV_PI HYK_C(0.31830988618379067154)
#define HYK_NONE 0xffffffffu

#endif /* HYK_LANGUAGE_H */

/* >>shared-vector: scalars and vectors under one name in C and GLSL */
#ifndef HYK_VECTOR_H
#define HYK_VECTOR_H

#ifdef HYK_GLSL

#define hyk_make2(a, b) vec2(a, b)
#define hyk_make3(a, b, c) vec3(a, b, c)
#define hyk_add(a, b) ((a) + (b))
#define hyk_sub(a, b) ((a) - (b))
#define hyk_mul(a, b) ((a) * (b))
#define hyk_scale(a, s) ((a) * (s))
#define hyk_neg(a) (-(a))
#define hyk_dot(a, b) dot(a, b)
#define hyk_cross(a, b) cross(a, b)
#define hyk_abs3(a) abs(a)
#define hyk_sqrt(x) sqrt(x)
#define hyk_abs(x) abs(x)
#define hyk_min(a, b) min(a, b)
#define hyk_max(a, b) max(a, b)
#define hyk_floor(x) floor(x)
#define hyk_exp(x) exp(x)
#define hyk_log2(x) log2(x)
#define hyk_exp2(x) exp2(x)
#define hyk_pow(x, y) pow(x, y)
#define hyk_min_uint(a, b) min(a, b)
#define hyk_max_uint(a, b) max(a, b)
#define hyk_float_bits(x) floatBitsToUint(x)
#define hyk_bits_float(x) uintBitsToFloat(x)
#define hyk_is_finite(x) (!isnan(x) && !isinf(x))
#define hyk_reverse_bits(x) bitfieldReverse(x)

/* Vulkan lets sines be off by 2^-11 and arcs by 4096 ulps. These are off by about 2 ulps where they are used here, sines
   of up to some thousand. Coefficients: Moshier, Cephes, sinf.c and atanf.c. */
float hyk_from_quarter(float x, float quarters) {
    precise float high = x - quarters * 1.5703125;
    precise float low = high - quarters * 4.837512969970703125e-4;
    precise float rest = low - quarters * 7.54978995489188216e-8;
    return rest;
}
float hyk_wave(float x, int turn) { /* sine of x + turn quarters */
    float quarters = floor(x * 0.636619772367581343 + 0.5);
    float r = hyk_from_quarter(x, quarters), z = r * r;
    int q = int(quarters) + turn;
    float s = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * z * r + r;
    float c = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * z * z - 0.5 * z + 1.0;
    float w = (q & 1) != 0 ? c : s;
    return (q & 2) != 0 ? -w : w;
}
float hyk_sin(float x) { return hyk_wave(x, 0); }
float hyk_cos(float x) { return hyk_wave(x, 1); }
float hyk_atan2(float y, float x) {
    float near = min(abs(x), abs(y)), far = max(abs(x), abs(y)), t = far > 0.0 ? near / far : 0.0;
    bool upper = t > 0.414213562373095049;
    t = upper ? (near - far) / (near + far) : t;
    float z = t * t;
    float arc = (((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1) * z * t + t;
    arc += upper ? 0.785398163397448309 : 0.0;
    arc = abs(y) > abs(x) ? 1.57079632679489662 - arc : arc;
    arc = x < 0.0 ? 3.14159265358979324 - arc : arc;
    return y < 0.0 ? -arc : arc;
}

#else

#if HYK_REAL_IS_FLOAT
#define HYK_MATH(name) name##f
#else
#define HYK_MATH(name) name
#endif

HYK_FN hyk_vec2 hyk_make2(hyk_real x, hyk_real y) { hyk_vec2 r; r.x = x; r.y = y; return r; }
HYK_FN hyk_vec3 hyk_make3(hyk_real x, hyk_real y, hyk_real z) { hyk_vec3 r; r.x = x; r.y = y; r.z = z; return r; }
HYK_FN hyk_vec3 hyk_add(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x + b.x, a.y + b.y, a.z + b.z); }
HYK_FN hyk_vec3 hyk_sub(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x - b.x, a.y - b.y, a.z - b.z); }
HYK_FN hyk_vec3 hyk_mul(hyk_vec3 a, hyk_vec3 b) { return hyk_make3(a.x * b.x, a.y * b.y, a.z * b.z); }
HYK_FN hyk_vec3 hyk_scale(hyk_vec3 a, hyk_real s) { return hyk_make3(a.x * s, a.y * s, a.z * s); }
HYK_FN hyk_vec3 hyk_neg(hyk_vec3 a) { return hyk_make3(-a.x, -a.y, -a.z); }
HYK_FN hyk_real hyk_dot(hyk_vec3 a, hyk_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
HYK_FN hyk_vec3 hyk_cross(hyk_vec3 a, hyk_vec3 b) {
    return hyk_make3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
HYK_FN hyk_real hyk_sqrt(hyk_real x) { return HYK_MATH(sqrt)(x); }
HYK_FN hyk_real hyk_abs(hyk_real x) { return HYK_MATH(fabs)(x); }
HYK_FN hyk_vec3 hyk_abs3(hyk_vec3 a) { return hyk_make3(hyk_abs(a.x), hyk_abs(a.y), hyk_abs(a.z)); }
HYK_FN hyk_real hyk_min(hyk_real a, hyk_real b) { return a < b ? a : b; }
HYK_FN hyk_real hyk_max(hyk_real a, hyk_real b) { return a > b ? a : b; }
HYK_FN hyk_real hyk_floor(hyk_real x) { return HYK_MATH(floor)(x); }
HYK_FN hyk_real hyk_sin(hyk_real x) { return HYK_MATH(sin)(x); }
HYK_FN hyk_real hyk_cos(hyk_real x) { return HYK_MATH(cos)(x); }
HYK_FN hyk_real hyk_atan2(hyk_real y, hyk_real x) { return HYK_MATH(atan2)(y, x); }
HYK_FN hyk_real hyk_exp(hyk_real x) { return HYK_MATH(exp)(x); }
HYK_FN hyk_real hyk_log2(hyk_real x) { return HYK_MATH(log2)(x); }
HYK_FN hyk_real hyk_exp2(hyk_real x) { return HYK_MATH(exp2)(x); }
HYK_FN hyk_uint hyk_min_uint(hyk_uint a, hyk_uint b) { return a < b ? a : b; }
HYK_FN hyk_uint hyk_max_uint(hyk_uint a, hyk_uint b) { return a > b ? a : b; }
HYK_FN hyk_uint hyk_float_bits(float x) { hyk_uint r; memcpy(&r, &x, sizeof r); return r; }
HYK_FN float hyk_bits_float(hyk_uint x) { float r; memcpy(&r, &x, sizeof r); return r; }
#if HYK_REAL_IS_FLOAT /* by the exponent's bits: fast-math assumes comparisons with NaN away */
HYK_FN hyk_bool hyk_is_finite(hyk_real x) { return (hyk_float_bits(x) & 0x7f800000u) != 0x7f800000u; }
#else
HYK_FN hyk_bool hyk_is_finite(hyk_real x) { return hyk_abs(x) <= HYK_REAL_MAX; }
#endif
HYK_FN hyk_uint hyk_reverse_bits(hyk_uint x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    return (x >> 16) | (x << 16);
}

#endif /* HYK_GLSL */

HYK_FN hyk_real hyk_clamp(hyk_real x, hyk_real lo, hyk_real hi) { return hyk_min(hyk_max(x, lo), hi); }
HYK_FN hyk_real hyk_saturate(hyk_real x) { return hyk_min(hyk_max(x, 0.0f), 1.0f); }
HYK_FN hyk_real hyk_square(hyk_real x) { return x * x; }
HYK_FN hyk_real hyk_safe_sqrt(hyk_real x) { return hyk_sqrt(hyk_max(x, 0.0f)); }
HYK_FN hyk_real hyk_lerp(hyk_real a, hyk_real b, hyk_real t) { return a + (b - a) * t; }
HYK_FN hyk_vec3 hyk_splat(hyk_real x) { return hyk_make3(x, x, x); }
HYK_FN hyk_vec3 hyk_zero3(void) { return hyk_make3(0.0f, 0.0f, 0.0f); }
HYK_FN hyk_vec3 hyk_add_scaled(hyk_vec3 a, hyk_vec3 b, hyk_real s) { return hyk_add(a, hyk_scale(b, s)); }
HYK_FN hyk_vec3 hyk_lerp3(hyk_vec3 a, hyk_vec3 b, hyk_real t) { return hyk_add_scaled(a, hyk_sub(b, a), t); }
HYK_FN hyk_real hyk_length_squared(hyk_vec3 a) { return hyk_dot(a, a); }
HYK_FN hyk_real hyk_max3(hyk_vec3 a) { return hyk_max(a.x, hyk_max(a.y, a.z)); }
HYK_FN hyk_bool hyk_is_black(hyk_vec3 a) { return hyk_max3(a) <= 0.0f; }
/* Luminance of linear Rec.709. */
HYK_FN hyk_real hyk_luminance(hyk_vec3 c) { return HYK_C(0.2126) * c.x + HYK_C(0.7152) * c.y + HYK_C(0.0722) * c.z; }

/* Length and unit vector without overflow or underflow of the squares: scaled by the largest component. */
HYK_FN hyk_real hyk_length(hyk_vec3 a) {
    hyk_real m = hyk_max3(hyk_abs3(a));
    if (!(m > 0.0f)) return 0.0f;
    hyk_vec3 s = hyk_make3(a.x / m, a.y / m, a.z / m);
    return m * hyk_sqrt(hyk_dot(s, s));
}
/* Zero stays zero. */
HYK_FN hyk_vec3 hyk_normalize(hyk_vec3 a) {
    hyk_real m = hyk_max3(hyk_abs3(a));
    if (!(m > 0.0f)) return a;
    hyk_vec3 s = hyk_make3(a.x / m, a.y / m, a.z / m);
    return hyk_scale(s, 1.0f / hyk_sqrt(hyk_dot(s, s)));
}

/* An orthonormal frame around unit n (Duff et al. 2017, "Building an orthonormal basis, revisited"). */
HYK_STRUCT(hyk_frame) {
    hyk_vec3 x, y, z;
} HYK_END(hyk_frame)

HYK_FN hyk_frame hyk_make_frame(hyk_vec3 n) {
    hyk_real s = n.z >= 0.0f ? 1.0f : -1.0f;
    hyk_real a = -1.0f / (s + n.z);
    hyk_real b = n.x * n.y * a;
    hyk_frame f;
    f.x = hyk_make3(1.0f + s * n.x * n.x * a, s * b, -s * n.x);
    f.y = hyk_make3(b, s + n.y * n.y * a, -n.y);
    f.z = n;
    return f;
}
HYK_FN hyk_vec3 hyk_to_local(hyk_frame f, hyk_vec3 v) { return hyk_make3(hyk_dot(v, f.x), hyk_dot(v, f.y), hyk_dot(v, f.z)); }
HYK_FN hyk_vec3 hyk_to_world(hyk_frame f, hyk_vec3 v) {
    return hyk_add(hyk_scale(f.x, v.x), hyk_add(hyk_scale(f.y, v.y), hyk_scale(f.z, v.z)));
}

#endif /* HYK_VECTOR_H */

/* >>shared-layouts: the records that kernels read, the same bytes in C and under std430

   Every hyk_vec3 is followed by a scalar that fills its fourth slot. */
#ifndef HYK_LAYOUTS_H
#define HYK_LAYOUTS_H

/* What a scene needs; the values of hydra_feature. Kernels take the set as their last argument: a
   constant in each instantiation, so that what is absent leaves no code. */
#define HYK_NEEDS_TEXTURES 0x1u
#define HYK_NEEDS_NORMAL_MAPS 0x2u
#define HYK_NEEDS_ALPHA 0x4u
#define HYK_NEEDS_SPECULAR 0x8u
#define HYK_NEEDS_TRANSMISSION 0x10u
#define HYK_NEEDS_ABSORPTION 0x20u
#define HYK_NEEDS_EMITTERS 0x40u
#define HYK_NEEDS_SHAPES 0x80u
#define HYK_NEEDS_SUNS 0x100u
#define HYK_NEEDS_ENVIRONMENT 0x200u
#define HYK_NEEDS_ENVIRONMENT_MAP 0x400u
#define HYK_NEEDS_INSTANCES 0x800u
#define HYK_NEEDS_SMOOTH_NORMALS 0x1000u
/* What a white Lambert surface under any light can need, textured emitters included: kernels at a sensor's points. */
#define HYK_NEEDS_AT_POINTS                                                                                                   \
    (HYK_NEEDS_EMITTERS | HYK_NEEDS_SHAPES | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT | HYK_NEEDS_ENVIRONMENT_MAP | HYK_NEEDS_TEXTURES | HYK_NEEDS_ALPHA)
#define HYK_HAS(features, feature) (((features) & (feature)) != 0u)

HYK_STRUCT(hyk_ray) {
    hyk_vec3 origin;
    hyk_real t_min;
    hyk_vec3 direction;
    hyk_real t_max;
} HYK_END(hyk_ray)
HYK_SIZE_IS(hyk_ray, 32)

/* instance: index into the placed instances, HYK_HIT_SHAPE (primitive is then the light) or HYK_NONE. */
#define HYK_HIT_SHAPE 0xfffffffeu
HYK_STRUCT(hyk_hit) {
    hyk_real t, u, v;
    hyk_uint instance, primitive;
} HYK_END(hyk_hit)
HYK_SIZE_IS(hyk_hit, 20)

/* ---- materials: fields as hydra_material_desc, defaults resolved */

#define HYK_MATERIAL_LAMBERT 0u
#define HYK_MATERIAL_CONDUCTOR 1u
#define HYK_MATERIAL_DIELECTRIC 2u
#define HYK_MATERIAL_METALLIC_ROUGHNESS 3u

#define HYK_MATERIAL_EMITS 0x1u
#define HYK_MATERIAL_EMITS_BOTH_SIDES 0x2u
#define HYK_MATERIAL_THIN 0x4u
#define HYK_MATERIAL_COMPLEX_IOR 0x8u  /* conductor with eta and k */
#define HYK_MATERIAL_ALPHA_MASK 0x10u
#define HYK_MATERIAL_ALPHA_BLEND 0x20u
#define HYK_MATERIAL_ABSORBS 0x40u
#define HYK_MATERIAL_TRANSMITS 0x80u   /* light can pass to the other side */

HYK_STRUCT(hyk_material) {
    hyk_vec3 base_color;
    hyk_real metallic;
    hyk_vec3 emission;
    hyk_real roughness;
    hyk_vec3 absorption;
    hyk_real ior;
    hyk_vec3 eta;
    hyk_real transmission;
    hyk_vec3 k;
    hyk_real alpha_cutoff;
    hyk_uint kind, flags;
    hyk_uint energy_table; /* first entry of its directional albedos in the scene's tables, HYK_NONE: needs none */
    hyk_real normal_scale;
    hyk_uint base_color_texture, metallic_roughness_texture, normal_texture, emission_texture; /* HYK_NONE: none */
    hyk_uint alpha_texture;
    hyk_real alpha, clearcoat, clearcoat_roughness;
} HYK_END(hyk_material)
HYK_SIZE_IS(hyk_material, 128)

/* ---- textures: mip levels follow each other, level l starts at texel level_offset[l] */

#define HYK_TEXEL_RGBA8_SRGB 0u
#define HYK_TEXEL_RGBA8_LINEAR 1u
#define HYK_TEXEL_RGBA32F 2u
#define HYK_WRAP_REPEAT 0u
#define HYK_WRAP_CLAMP 1u
#define HYK_WRAP_MIRROR 2u
#define HYK_TEXTURE_LEVELS 17

HYK_STRUCT(hyk_texture) {
    hyk_uint width, height, levels, format;
    hyk_uint wrap_u, wrap_v;
    hyk_uint first_word; /* device copy: where its texels start; RGBA8: one word a texel, float: four */
    hyk_uint level_offset[HYK_TEXTURE_LEVELS];
} HYK_END(hyk_texture)
HYK_SIZE_IS(hyk_texture, 96)

/* ---- geometry */

#define HYK_MESH_HAS_NORMALS 0x1u
#define HYK_MESH_HAS_UVS 0x2u
#define HYK_MESH_TRIANGLE_MATERIALS 0x4u
#define HYK_MESH_LIGHT_SLOTS 0x8u /* only some triangles emit: their place among the mesh's lights is in a list */

HYK_STRUCT(hyk_mesh) {
    hyk_uint flags, material, triangle_count, vertex_count;
    hyk_uint first_position, first_normal, first_uv, first_index; /* device copy: element offsets */
    hyk_uint first_material, first_light_slot, unused0, unused1;
} HYK_END(hyk_mesh)
HYK_SIZE_IS(hyk_mesh, 48)

#define HYK_INSTANCE_IDENTITY 0x1u
#define HYK_INSTANCE_MIRRORED 0x2u /* negative determinant: faces keep their front by flipping the normal */

/* A placed mesh: rows of object-to-world and world-to-object, translation in the fourth column. */
HYK_STRUCT(hyk_instance) {
    hyk_vec3 row0; hyk_real t0;
    hyk_vec3 row1; hyk_real t1;
    hyk_vec3 row2; hyk_real t2;
    hyk_vec3 inverse0; hyk_real s0;
    hyk_vec3 inverse1; hyk_real s1;
    hyk_vec3 inverse2; hyk_real s2;
    hyk_uint mesh;
    hyk_uint material;    /* HYK_NONE: the mesh's own */
    hyk_uint first_light; /* light of its first emitting triangle, HYK_NONE: none emits */
    hyk_uint flags;
} HYK_END(hyk_instance)
HYK_SIZE_IS(hyk_instance, 112)

/* ---- lights. Finite lights stand first (the light tree is over them), then suns. */

#define HYK_LIGHT_RECT 0u
#define HYK_LIGHT_DISC 1u
#define HYK_LIGHT_SPHERE 2u
#define HYK_LIGHT_POINT 3u
#define HYK_LIGHT_SPOT 4u
#define HYK_LIGHT_SUN 5u
#define HYK_LIGHT_TRIANGLE 6u

#define HYK_LIGHT_BOTH_SIDES 0x1u
#define HYK_LIGHT_HIDDEN 0x2u
#define HYK_LIGHT_TEXTURED 0x4u /* triangle: radiance is the mean; the material's emission and alpha at uv count */

HYK_STRUCT(hyk_light) {
    hyk_vec3 position;  /* centre; TRIANGLE: vertex 0 */
    hyk_real area;      /* m^2 (RECT, DISC, SPHERE, TRIANGLE) */
    hyk_vec3 axis_u;    /* RECT: half edge; TRIANGLE: vertex 1 - vertex 0 */
    hyk_real radius;    /* DISC, SPHERE; SUN: angular radius */
    hyk_vec3 axis_v;    /* RECT: half edge; TRIANGLE: vertex 2 - vertex 0 */
    hyk_real cos_outer; /* SPOT; SUN: cosine of its radius */
    hyk_vec3 normal;    /* unit: RECT, DISC, TRIANGLE: front; SPOT: axis; SUN: towards the sun */
    hyk_real cos_inner; /* SPOT */
    hyk_vec3 radiance;  /* POINT, SPOT: intensity; SUN of radius 0: irradiance facing it */
    hyk_uint kind;
    hyk_uint flags;
    hyk_uint instance, primitive; /* TRIANGLE */
    hyk_uint tree_path; /* bit i: the child taken at depth i of the light tree */
} HYK_END(hyk_light)
HYK_SIZE_IS(hyk_light, 96)

/* ---- counts and extents */

HYK_STRUCT(hyk_scene_constants) {
    hyk_vec3 center;       /* of the bounds of everything that rays can hit */
    hyk_real radius;       /* of their bounding sphere, 0: empty */
    hyk_vec3 environment;  /* constant radiance, or the factor on the map */
    hyk_real environment_rotation;
    hyk_uint finite_lights, suns;
    hyk_uint environment_width, environment_height; /* 0: no map */
    hyk_real environment_integral; /* sum of the map's sampling weights; 0: nothing to sample */
    hyk_uint light_nodes, shapes, features;
} HYK_END(hyk_scene_constants)
HYK_SIZE_IS(hyk_scene_constants, 64)

#endif /* HYK_LAYOUTS_H */

/* >>shared-light-layouts: nodes of the light tree, and how the environment's sampling weights are laid out */
#ifndef HYK_LIGHT_LAYOUTS_H
#define HYK_LIGHT_LAYOUTS_H

/* Binary tree over the finite lights (Conty & Kulla 2018), in depth-first order; node 0 is the root. */
HYK_STRUCT(hyk_light_node) {
    hyk_vec3 lower;
    hyk_real intensity; /* luminance of the largest intensity (W/sr) the lights can send, summed */
    hyk_vec3 upper;
    hyk_real cos_o;  /* cone that bounds the lights' normals; -1: any direction */
    hyk_vec3 axis;
    hyk_real cos_e;  /* how far off its normal a light still emits */
    hyk_uint child;  /* inner: index of the second child (the first is the next node); leaf: the light */
    hyk_uint is_leaf;
    hyk_uint both_sides; /* some light also emits against its normal */
    hyk_uint unused;
} HYK_END(hyk_light_node)
HYK_SIZE_IS(hyk_light_node, 64)

#define HYK_LIGHT_TREE_DEPTH 32u /* most choices from the root to a light: the bits of tree_path */

/* Environment map of width w and height h, sampled over the cells between texel centres, where the bilinear
   lookup has one formula: w columns (column x from the centre of texel x to that of x + 1, wrapping round) by
   h + 1 rows (row y from the centre of texel row y - 1 to that of row y; rows 0 and h are the halves at the
   poles). A cell weighs its solid angle times the mean luminance of its four corners;
   environment_integral is the sum of all weights.

   Cells are found by bisection of first the rows, then the columns of that row: the range [first, last) splits
   at m = (first + last) / 2, and the number at m says how: x >= 0: the lower half has the share x of the weight,
   x < 0: the upper half has the share -x. The smaller share is stored, so that shares of 1e-20 keep all bits.
   HYK_LOAD_ENVIRONMENT_CDF: [m], 0 < m < h + 1: rows; [(h + 1) + w * row + m], 0 < m < w: columns. */
#define HYK_ENVIRONMENT_CDF_COUNT(w, h) (((h) + 1u) + (w) * ((h) + 1u))

#endif /* HYK_LIGHT_LAYOUTS_H */

/* >>shared-views: how kernels reach the scene's buffers

   C gets a pointer to a struct of arrays; GLSL a binding per array. HYK_LOAD_X(view, i) reads record i.
   Geometry and texels are per mesh and texture in C (so that an edit touches one of them only) and
   packed in GLSL. */
#ifndef HYK_VIEWS_H
#define HYK_VIEWS_H

#define HYK_BINDING_CONSTANTS 0
#define HYK_BINDING_MATERIALS 1
#define HYK_BINDING_TEXTURES 2
#define HYK_BINDING_TEXELS 3
#define HYK_BINDING_MESHES 4
#define HYK_BINDING_POSITIONS 5
#define HYK_BINDING_NORMALS 6
#define HYK_BINDING_UVS 7
#define HYK_BINDING_INDICES 8
#define HYK_BINDING_TRIANGLE_MATERIALS 9
#define HYK_BINDING_LIGHT_SLOTS 10
#define HYK_BINDING_INSTANCES 11
#define HYK_BINDING_LIGHTS 12
#define HYK_BINDING_LIGHT_NODES 13
#define HYK_BINDING_ENVIRONMENT 14
#define HYK_BINDING_ENVIRONMENT_CDF 15
#define HYK_BINDING_ENERGY_TABLES 16
/* What rays walk through on a device (tree.h); in C it is hyi_accel. */
#define HYK_BINDING_TREES 17
#define HYK_BINDING_NODES 18
#define HYK_BINDING_SLOTS 19
#define HYK_BINDING_WORLD_FIRST 20
#define HYK_SCENE_BINDINGS 21 /* storage buffers; behind them two of these as texel buffers */
#define HYK_BINDING_NODE_TEXELS 21
#define HYK_BINDING_SLOT_TEXELS 22

#ifdef HYK_GLSL

#define hyk_view uint
#define HYK_BUFFER(slot, name, type) layout(std430, set = 0, binding = slot) readonly buffer name##_buffer { type name[]; };
layout(std430, set = 0, binding = HYK_BINDING_CONSTANTS) readonly buffer hyk_constants_buffer { hyk_scene_constants hyk_constants; };
HYK_BUFFER(HYK_BINDING_MATERIALS, hyk_materials, hyk_material)
HYK_BUFFER(HYK_BINDING_TEXTURES, hyk_textures, hyk_texture)
HYK_BUFFER(HYK_BINDING_TEXELS, hyk_texels, uint)
HYK_BUFFER(HYK_BINDING_MESHES, hyk_meshes, hyk_mesh)
HYK_BUFFER(HYK_BINDING_POSITIONS, hyk_positions, float)
HYK_BUFFER(HYK_BINDING_NORMALS, hyk_normals, float)
HYK_BUFFER(HYK_BINDING_UVS, hyk_uvs, float)
HYK_BUFFER(HYK_BINDING_INDICES, hyk_indices, uint)
HYK_BUFFER(HYK_BINDING_TRIANGLE_MATERIALS, hyk_triangle_materials, uint)
HYK_BUFFER(HYK_BINDING_LIGHT_SLOTS, hyk_light_slots, uint)
HYK_BUFFER(HYK_BINDING_INSTANCES, hyk_instances, hyk_instance)
HYK_BUFFER(HYK_BINDING_LIGHTS, hyk_lights, hyk_light)
HYK_BUFFER(HYK_BINDING_LIGHT_NODES, hyk_light_nodes, hyk_light_node)
HYK_BUFFER(HYK_BINDING_ENVIRONMENT, hyk_environment, float)
HYK_BUFFER(HYK_BINDING_ENVIRONMENT_CDF, hyk_environment_cdf, float)
HYK_BUFFER(HYK_BINDING_ENERGY_TABLES, hyk_energy_tables, float)

#define HYK_CONSTANTS(view) hyk_constants
#define HYK_LOAD_MATERIAL(view, i) hyk_materials[i]
#define HYK_LOAD_TEXTURE(view, i) hyk_textures[i]
#define HYK_LOAD_TEXEL_WORD(view, texture, i) hyk_texels[hyk_textures[texture].first_word + (i)]
#define HYK_LOAD_MESH(view, i) hyk_meshes[i]
#define HYK_LOAD_POSITION(view, mesh, i) hyk_positions[3u * hyk_meshes[mesh].first_position + (i)]
#define HYK_LOAD_NORMAL(view, mesh, i) hyk_normals[3u * hyk_meshes[mesh].first_normal + (i)]
#define HYK_LOAD_UV(view, mesh, i) hyk_uvs[2u * hyk_meshes[mesh].first_uv + (i)]
#define HYK_LOAD_INDEX(view, mesh, i) hyk_indices[hyk_meshes[mesh].first_index + (i)]
#define HYK_LOAD_TRIANGLE_MATERIAL(view, mesh, i) hyk_triangle_materials[hyk_meshes[mesh].first_material + (i)]
#define HYK_LOAD_LIGHT_SLOT(view, mesh, i) hyk_light_slots[hyk_meshes[mesh].first_light_slot + (i)]
#define HYK_LOAD_INSTANCE(view, i) hyk_instances[i]
#define HYK_LOAD_LIGHT(view, i) hyk_lights[i]
#define HYK_LOAD_LIGHT_NODE(view, i) hyk_light_nodes[i]
#define HYK_LOAD_ENVIRONMENT(view, i) hyk_environment[i]
#define HYK_LOAD_ENVIRONMENT_CDF(view, i) hyk_environment_cdf[i]
#define HYK_LOAD_ENERGY(view, i) hyk_energy_tables[i]

#else

typedef struct hyk_mesh_arrays {
    const float *positions, *normals, *uvs; /* 3, 3, 2 floats a vertex */
    const uint32_t *indices;                /* 3 a triangle, always there */
    const uint32_t *triangle_materials, *light_slots;
} hyk_mesh_arrays;

typedef struct hyk_scene_view {
    hyk_scene_constants constants;
    const hyk_material *materials;
    const hyk_texture *textures;
    const uint32_t *const *texels;         /* per texture */
    const hyk_mesh *meshes;
    const hyk_mesh_arrays *mesh_arrays;    /* per mesh */
    const hyk_instance *instances;
    const hyk_light *lights;
    const hyk_light_node *light_nodes;
    const float *environment;              /* RGB texels, width x height */
    const float *environment_cdf;          /* see light_layouts.h */
    const float *energy_tables;            /* see energy.h */
} hyk_scene_view;

typedef const hyk_scene_view *hyk_view;
#define HYK_CONSTANTS(view) ((view)->constants)
#define HYK_LOAD_MATERIAL(view, i) ((view)->materials[i])
#define HYK_LOAD_TEXTURE(view, i) ((view)->textures[i])
#define HYK_LOAD_TEXEL_WORD(view, texture, i) ((view)->texels[texture][i])
#define HYK_LOAD_MESH(view, i) ((view)->meshes[i])
#define HYK_LOAD_POSITION(view, mesh, i) HYK_TO_REAL((view)->mesh_arrays[mesh].positions[i])
#define HYK_LOAD_NORMAL(view, mesh, i) HYK_TO_REAL((view)->mesh_arrays[mesh].normals[i])
#define HYK_LOAD_UV(view, mesh, i) HYK_TO_REAL((view)->mesh_arrays[mesh].uvs[i])
#define HYK_LOAD_INDEX(view, mesh, i) ((view)->mesh_arrays[mesh].indices[i])
#define HYK_LOAD_TRIANGLE_MATERIAL(view, mesh, i) ((view)->mesh_arrays[mesh].triangle_materials[i])
#define HYK_LOAD_LIGHT_SLOT(view, mesh, i) ((view)->mesh_arrays[mesh].light_slots[i])
#define HYK_LOAD_INSTANCE(view, i) ((view)->instances[i])
#define HYK_LOAD_LIGHT(view, i) ((view)->lights[i])
#define HYK_LOAD_LIGHT_NODE(view, i) ((view)->light_nodes[i])
#define HYK_LOAD_ENVIRONMENT(view, i) HYK_TO_REAL((view)->environment[i])
#define HYK_LOAD_ENVIRONMENT_CDF(view, i) HYK_TO_REAL((view)->environment_cdf[i])
#define HYK_LOAD_ENERGY(view, i) HYK_TO_REAL((view)->energy_tables[i])

#endif /* HYK_GLSL */

/* Vectors out of the scalar arrays. */
HYK_FN hyk_vec3 hyk_load_position(hyk_view view, hyk_uint mesh, hyk_uint vertex) {
    return hyk_make3(HYK_LOAD_POSITION(view, mesh, 3u * vertex), HYK_LOAD_POSITION(view, mesh, 3u * vertex + 1u),
                     HYK_LOAD_POSITION(view, mesh, 3u * vertex + 2u));
}
HYK_FN hyk_vec3 hyk_load_normal(hyk_view view, hyk_uint mesh, hyk_uint vertex) {
    return hyk_make3(HYK_LOAD_NORMAL(view, mesh, 3u * vertex), HYK_LOAD_NORMAL(view, mesh, 3u * vertex + 1u),
                     HYK_LOAD_NORMAL(view, mesh, 3u * vertex + 2u));
}
HYK_FN hyk_vec2 hyk_load_uv(hyk_view view, hyk_uint mesh, hyk_uint vertex) {
    return hyk_make2(HYK_LOAD_UV(view, mesh, 2u * vertex), HYK_LOAD_UV(view, mesh, 2u * vertex + 1u));
}

#endif /* HYK_VIEWS_H */

/* >>shared-texture: texels, wrapping, bilinear lookup in one mip level */
#ifndef HYK_TEXTURE_H
#define HYK_TEXTURE_H

HYK_STRUCT(hyk_rgba) {
    hyk_vec3 rgb;
    hyk_real a;
} HYK_END(hyk_rgba)

/* sRGB decoding of a byte, IEC 61966-2-1: below 0.04045 c / 12.92, else ((c + 0.055) / 1.055)^2.4, with c = byte / 255.
   In C from a table of just that (a lookup decodes twelve): the power took more time than the rest of a texture lookup. */
#ifdef HYK_GLSL
HYK_FN hyk_real hyk_srgb_decode(hyk_uint byte_value) {
    hyk_real c = HYK_TO_REAL(byte_value) * HYK_C(1.0 / 255.0);
    return c <= HYK_C(0.04045) ? c * HYK_C(1.0 / 12.92) : hyk_pow((c + HYK_C(0.055)) * HYK_C(1.0 / 1.055), HYK_C(2.4));
}
#else
static const float hyk_srgb_table[256] = {
    0.0f, 0.000303526991f, 0.000607053982f, 0.000910580973f, 0.00121410796f, 0.00151763496f, 0.00182116195f, 0.00212468882f,
    0.00242821593f, 0.0027317428f, 0.00303526991f, 0.00334653584f, 0.00367650739f, 0.00402471703f, 0.00439144205f,
    0.00477695325f, 0.00518151652f, 0.00560539169f, 0.00604883302f, 0.00651209056f, 0.00699541019f, 0.00749903219f,
    0.00802319311f, 0.00856812578f, 0.00913405884f, 0.00972121768f, 0.010329823f, 0.0109600937f, 0.0116122449f, 0.012286488f,
    0.0129830325f, 0.0137020834f, 0.0144438436f, 0.0152085144f, 0.0159962941f, 0.0168073755f, 0.0176419541f, 0.01850022f,
    0.0193823613f, 0.0202885624f, 0.0212190095f, 0.0221738853f, 0.0231533665f, 0.0241576321f, 0.0251868591f, 0.0262412224f,
    0.0273208916f, 0.02842604f, 0.0295568351f, 0.0307134446f, 0.0318960324f, 0.0331047662f, 0.0343398079f, 0.0356013142f,
    0.0368894488f, 0.0382043719f, 0.0395462364f, 0.0409151986f, 0.0423114114f, 0.043735031f, 0.045186203f, 0.0466650873f,
    0.0481718257f, 0.0497065671f, 0.0512694567f, 0.0528606474f, 0.054480277f, 0.0561284907f, 0.0578054301f, 0.0595112368f,
    0.0612460524f, 0.0630100146f, 0.064803265f, 0.0666259378f, 0.0684781671f, 0.0703600943f, 0.0722718537f, 0.0742135718f,
    0.0761853829f, 0.078187421f, 0.0802198201f, 0.0822827071f, 0.0843762085f, 0.0865004584f, 0.0886555836f, 0.0908417106f,
    0.0930589661f, 0.0953074694f, 0.097587347f, 0.0998987257f, 0.102241732f, 0.104616486f, 0.107023105f, 0.10946171f,
    0.111932427f, 0.114435375f, 0.116970666f, 0.119538426f, 0.122138776f, 0.124771819f, 0.127437681f, 0.130136475f, 0.13286832f,
    0.135633335f, 0.138431609f, 0.141263291f, 0.144128472f, 0.147027269f, 0.149959788f, 0.152926147f, 0.155926466f,
    0.158960834f, 0.162029371f, 0.165132195f, 0.168269396f, 0.171441108f, 0.174647406f, 0.177888423f, 0.18116425f, 0.18447499f,
    0.187820777f, 0.191201687f, 0.194617838f, 0.198069319f, 0.20155625f, 0.205078736f, 0.208636865f, 0.212230757f, 0.215860501f,
    0.219526201f, 0.223227963f, 0.226965874f, 0.230740055f, 0.23455058f, 0.238397568f, 0.242281124f, 0.246201321f, 0.25015828f,
    0.254152089f, 0.258182853f, 0.262250662f, 0.266355604f, 0.270497799f, 0.274677306f, 0.278894275f, 0.283148736f,
    0.287440836f, 0.291770637f, 0.296138257f, 0.300543785f, 0.304987311f, 0.309468925f, 0.313988715f, 0.318546772f,
    0.323143214f, 0.327778101f, 0.332451522f, 0.337163627f, 0.341914415f, 0.346704066f, 0.351532608f, 0.356400132f,
    0.361306787f, 0.366252601f, 0.371237695f, 0.376262128f, 0.38132602f, 0.386429429f, 0.391572475f, 0.396755219f, 0.401977777f,
    0.407240212f, 0.412542611f, 0.417885065f, 0.423267663f, 0.428690493f, 0.434153646f, 0.439657182f, 0.445201188f,
    0.450785786f, 0.456411034f, 0.462076992f, 0.467783809f, 0.473531485f, 0.479320168f, 0.48514995f, 0.491020858f, 0.496932983f,
    0.502886474f, 0.50888133f, 0.514917672f, 0.520995557f, 0.527115107f, 0.533276379f, 0.539479494f, 0.545724452f, 0.55201143f,
    0.558340371f, 0.564711511f, 0.571124852f, 0.577580452f, 0.584078431f, 0.590618849f, 0.597201765f, 0.603827357f,
    0.610495567f, 0.617206573f, 0.623960376f, 0.630757153f, 0.637596846f, 0.644479692f, 0.651405632f, 0.658374846f,
    0.665387273f, 0.672443151f, 0.679542482f, 0.686685324f, 0.693871737f, 0.701101899f, 0.708375752f, 0.715693474f,
    0.723055124f, 0.730460763f, 0.73791039f, 0.745404184f, 0.752942204f, 0.760524511f, 0.768151164f, 0.775822222f, 0.783537805f,
    0.791297913f, 0.799102724f, 0.806952238f, 0.814846575f, 0.822785735f, 0.830769897f, 0.838799f, 0.846873224f, 0.854992628f,
    0.863157213f, 0.871367097f, 0.8796224f, 0.887923121f, 0.896269381f, 0.904661179f, 0.913098633f, 0.921581864f, 0.930110872f,
    0.938685715f, 0.947306514f, 0.955973327f, 0.964686275f, 0.973445296f, 0.982250571f, 0.991102099f, 1.0f,
};
HYK_FN hyk_real hyk_srgb_decode(hyk_uint byte_value) { return HYK_TO_REAL(hyk_srgb_table[byte_value]); }
#endif

HYK_FN hyk_uint hyk_wrap_texel(hyk_int i, hyk_uint size, hyk_uint mode) {
    hyk_int n = HYK_TO_INT(size);
    if (mode == HYK_WRAP_CLAMP) return HYK_TO_UINT(i < 0 ? 0 : (i >= n ? n - 1 : i));
    if (mode == HYK_WRAP_REPEAT) {
        hyk_int r = i % n;
        return HYK_TO_UINT(r < 0 ? r + n : r);
    }
    hyk_int period = 2 * n;
    hyk_int m = i % period;
    if (m < 0) m += period;
    return HYK_TO_UINT(m < n ? m : period - 1 - m);
}

HYK_FN hyk_rgba hyk_load_texel(hyk_view view, hyk_uint texture, hyk_uint format, hyk_uint at) {
    hyk_rgba r;
    if (format == HYK_TEXEL_RGBA32F) {
        r.rgb = hyk_make3(HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at))),
                          HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 1u))),
                          HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 2u))));
        r.a = HYK_TO_REAL(hyk_bits_float(HYK_LOAD_TEXEL_WORD(view, texture, 4u * at + 3u)));
        return r;
    }
    hyk_uint word = HYK_LOAD_TEXEL_WORD(view, texture, at);
    hyk_uint red = word & 255u, green = (word >> 8) & 255u, blue = (word >> 16) & 255u;
    hyk_real unit = HYK_C(1.0 / 255.0);
    r.a = HYK_TO_REAL(word >> 24) * unit;
    if (format == HYK_TEXEL_RGBA8_SRGB) r.rgb = hyk_make3(hyk_srgb_decode(red), hyk_srgb_decode(green), hyk_srgb_decode(blue));
    else r.rgb = hyk_make3(HYK_TO_REAL(red) * unit, HYK_TO_REAL(green) * unit, HYK_TO_REAL(blue) * unit);
    return r;
}

HYK_FN hyk_rgba hyk_lerp_rgba(hyk_rgba a, hyk_rgba b, hyk_real t) {
    hyk_rgba r;
    r.rgb = hyk_lerp3(a.rgb, b.rgb, t);
    r.a = hyk_lerp(a.a, b.a, t);
    return r;
}

/* uv brought near the origin first, so that its fraction keeps its bits and its floor fits an integer. */
HYK_FN hyk_real hyk_wrap_coordinate(hyk_real u, hyk_uint mode) {
    if (!hyk_is_finite(u)) return 0.0f;
    if (mode == HYK_WRAP_CLAMP) return hyk_clamp(u, -1.0f, 2.0f);
    return u - 2.0f * hyk_floor(u * 0.5f);
}

/* Bilinear lookup at uv in the level nearest to lod (log2 of the footprint in texels of level 0). */
HYK_CALLED hyk_rgba hyk_sample_texture(hyk_view view, hyk_uint texture, hyk_vec2 uv, hyk_real lod) {
    hyk_texture t = HYK_LOAD_TEXTURE(view, texture);
    hyk_uint level = HYK_TO_UINT(hyk_clamp(lod + 0.5f, 0.0f, HYK_TO_REAL(t.levels) - 0.5f));
    hyk_uint w = hyk_max_uint(t.width >> level, 1u), h = hyk_max_uint(t.height >> level, 1u);
    hyk_real x = hyk_wrap_coordinate(uv.x, t.wrap_u) * HYK_TO_REAL(w) - 0.5f;
    hyk_real y = hyk_wrap_coordinate(uv.y, t.wrap_v) * HYK_TO_REAL(h) - 0.5f;
    hyk_real fx = hyk_floor(x), fy = hyk_floor(y);
    hyk_uint x0 = hyk_wrap_texel(HYK_TO_INT(fx), w, t.wrap_u), x1 = hyk_wrap_texel(HYK_TO_INT(fx) + 1, w, t.wrap_u);
    hyk_uint y0 = hyk_wrap_texel(HYK_TO_INT(fy), h, t.wrap_v), y1 = hyk_wrap_texel(HYK_TO_INT(fy) + 1, h, t.wrap_v);
    hyk_uint base = t.level_offset[level];
    hyk_rgba top = hyk_lerp_rgba(hyk_load_texel(view, texture, t.format, base + y0 * w + x0),
                                 hyk_load_texel(view, texture, t.format, base + y0 * w + x1), x - fx);
    hyk_rgba bottom = hyk_lerp_rgba(hyk_load_texel(view, texture, t.format, base + y1 * w + x0),
                                    hyk_load_texel(view, texture, t.format, base + y1 * w + x1), x - fx);
    return hyk_lerp_rgba(top, bottom, y - fy);
}

#endif /* HYK_TEXTURE_H */

/* >>shared-sampler: Owen-scrambled Sobol points, spread over the screen like blue noise

   A path takes its random numbers in pairs; pair d of sample s is point s of its own copy of the first two
   Sobol dimensions, a (0,2)-sequence, whose order and digits are scrambled by hashes of d (Burley 2020,
   "Practical hash-based Owen scrambling"; the mixing constants are Vegdahl's, 2021). Padding pairs this way keeps
   every pair a net at every power of two.
   The 16 pixels of a 4x4 block get the same points under digital shifts. The shifts are themselves Sobol points, numbered
   along the Morton curve in scrambled order (after Ahmed & Wonka 2020, "Screen-space blue-noise diffusion of Monte Carlo
   sampling error via hierarchical ordering of pixels"), so they are stratified over each 2x2 and the 4x4 pixels, and
   errors of neighbours cancel; digits below those are random, so that pixels do not repeat each other. Different blocks
   are scrambled apart: how well one set of points does is then no common fate of the whole picture. */
#ifndef HYK_SAMPLER_H
#define HYK_SAMPLER_H

HYK_STRUCT(hyk_sampler) {
    hyk_uint pixel; /* Morton code, bits reversed */
    hyk_uint index; /* sample number */
    hyk_uint seed;
} HYK_END(hyk_sampler)

/* A bijective mix of 32 bits (Wellons 2018, the low-bias search "lowbias32"). */
HYK_FN hyk_uint hyk_hash(hyk_uint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

HYK_FN hyk_uint hyk_hash2(hyk_uint a, hyk_uint b) { return hyk_hash(a ^ (hyk_hash(b) + 0x9e3779b9u)); }

/* Owen scrambling of a number whose digits are stored lowest bit first: each bit is flipped by a hash of those below. */
HYK_FN hyk_uint hyk_owen(hyk_uint x, hyk_uint seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    return x ^ (x * 0x53a22864u);
}

/* Digits of the second Sobol dimension, lowest bit first: its matrix is Pascal's triangle modulo 2, and a binomial
   (k over j) is odd where j's bits are among k's (Lucas), so digit j sums the bits of all k that contain j. */
HYK_FN hyk_uint hyk_sobol_second(hyk_uint index) {
    index ^= (index >> 1) & 0x55555555u;
    index ^= (index >> 2) & 0x33333333u;
    index ^= (index >> 4) & 0x0f0f0f0fu;
    index ^= (index >> 8) & 0x00ff00ffu;
    return index ^ (index >> 16);
}

/* Spreads the low 16 bits to the even places. */
HYK_FN hyk_uint hyk_morton_spread(hyk_uint x) {
    x &= 0xffffu;
    x = (x | (x << 8)) & 0x00ff00ffu;
    x = (x | (x << 4)) & 0x0f0f0f0fu;
    x = (x | (x << 2)) & 0x33333333u;
    return (x | (x << 1)) & 0x55555555u;
}
/* And gathers them again. */
HYK_FN hyk_uint hyk_morton_even_bits(hyk_uint x) {
    x &= 0x55555555u;
    x = (x | (x >> 1)) & 0x33333333u;
    x = (x | (x >> 2)) & 0x0f0f0f0fu;
    x = (x | (x >> 4)) & 0x00ff00ffu;
    return (x | (x >> 8)) & 0x0000ffffu;
}
HYK_FN hyk_uint hyk_morton(hyk_uint x, hyk_uint y) { return hyk_morton_spread(x) | (hyk_morton_spread(y) << 1); }

HYK_FN hyk_sampler hyk_make_sampler(hyk_uint x, hyk_uint y, hyk_uint index, hyk_uint seed) {
    hyk_sampler s;
    s.pixel = hyk_reverse_bits(hyk_morton(x, y));
    s.index = index;
    s.seed = seed;
    return s;
}

HYK_FN hyk_real hyk_unit_real(hyk_uint bits) { return HYK_TO_REAL(bits >> 8) * HYK_C(1.0 / 16777216.0); }

/* Pair d of the sampler's sample, both in [0, 1). */
HYK_FN hyk_vec2 hyk_sample_pair(hyk_sampler s, hyk_uint d) {
    hyk_uint key_pixel = hyk_hash2(s.seed, d), key = hyk_hash2(key_pixel, s.pixel & 0x0fffffffu);
    hyk_uint key_x = hyk_hash(key + 1u), key_y = hyk_hash(key + 2u);
    hyk_uint order = hyk_reverse_bits(hyk_owen(hyk_reverse_bits(s.index), key));
    hyk_uint x = hyk_reverse_bits(hyk_owen(order, key_x));
    hyk_uint y = hyk_reverse_bits(hyk_owen(hyk_sobol_second(order), key_y));
    hyk_uint shift_x = hyk_owen(s.pixel, key_pixel);
    hyk_uint shift_y = hyk_reverse_bits(hyk_sobol_second(hyk_reverse_bits(shift_x)));
    hyk_uint noise = hyk_hash(s.pixel ^ key_pixel);
    return hyk_make2(hyk_unit_real(x ^ shift_x ^ (noise >> 4)), hyk_unit_real(y ^ shift_y ^ (hyk_hash(noise + 1u) >> 4)));
}

#endif /* HYK_SAMPLER_H */

/* >>shared-sampling: warps of the unit square, their densities, and the weights of multiple importance sampling

   Every warp takes u in [0, 1)^2. Directions are local: z is the axis. Densities are per steradian for
   directions, per unit area for points of a shape of area 1. */
#ifndef HYK_SAMPLING_H
#define HYK_SAMPLING_H

#define HYK_TWO_PI HYK_C(6.28318530717958647693)
#define HYK_HALF_PI HYK_C(1.57079632679489661923)
#define HYK_QUARTER_PI HYK_C(0.78539816339744830962)
/* The largest number below 1: remapped random numbers are kept at or under it. */
#define HYK_BELOW_ONE (1.0f - HYK_REAL_EPSILON)

/* Unit disc, area-preserving and of low distortion (Shirley & Chiu 1997). Density 1 / pi. */
HYK_FN hyk_vec2 hyk_sample_disc(hyk_vec2 u) {
    hyk_real a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
    if (a == 0.0f && b == 0.0f) return hyk_make2(0.0f, 0.0f);
    hyk_bool wide = hyk_abs(a) > hyk_abs(b);
    hyk_real r = wide ? a : b;
    hyk_real phi = wide ? HYK_QUARTER_PI * (b / a) : HYK_HALF_PI - HYK_QUARTER_PI * (a / b);
    return hyk_make2(r * hyk_cos(phi), r * hyk_sin(phi));
}

/* Hemisphere around +z in proportion to the cosine (Malley). z is never exactly zero, so that the density is
   not either: the disc's rim is met only by rounding. */
HYK_FN hyk_vec3 hyk_sample_cosine_hemisphere(hyk_vec2 u) {
    hyk_vec2 d = hyk_sample_disc(u);
    hyk_real z = hyk_sqrt(hyk_max(1.0f - d.x * d.x - d.y * d.y, HYK_REAL_EPSILON * HYK_REAL_EPSILON));
    return hyk_make3(d.x, d.y, z);
}
HYK_FN hyk_real hyk_pdf_cosine_hemisphere(hyk_real cos_theta) { return hyk_max(cos_theta, 0.0f) * HYK_INV_PI; }

/* The direction whose 1 - cos(theta) is given: the form that keeps the bits of small angles. */
HYK_FN hyk_vec3 hyk_direction_near_axis(hyk_real one_minus_cos, hyk_real phi) {
    hyk_real sin_theta = hyk_safe_sqrt(one_minus_cos * (2.0f - one_minus_cos));
    return hyk_make3(sin_theta * hyk_cos(phi), sin_theta * hyk_sin(phi), 1.0f - one_minus_cos);
}

/* Cone around +z that ends where 1 - cos(theta) is one_minus_cos, uniformly in solid angle. Concentric, so
   that strata stay compact. */
HYK_FN hyk_vec3 hyk_sample_cone(hyk_real one_minus_cos, hyk_vec2 u) {
    hyk_vec2 d = hyk_sample_disc(u);
    hyk_real r2 = d.x * d.x + d.y * d.y;
    hyk_real h = one_minus_cos * hyk_min(r2, 1.0f);
    /* (x, y) = sin(theta) d / |d| and sin^2(theta) = h (2 - h), h = one_minus_cos |d|^2 */
    hyk_real s = hyk_sqrt(one_minus_cos * (2.0f - h));
    return hyk_make3(d.x * s, d.y * s, 1.0f - h);
}
HYK_FN hyk_real hyk_pdf_cone(hyk_real one_minus_cos) { return 1.0f / (HYK_TWO_PI * one_minus_cos); }

/* u, known to lie in [lo, lo + width), spread over [0, 1) again. */
HYK_FN hyk_real hyk_respread(hyk_real u, hyk_real lo, hyk_real width) {
    return hyk_clamp((u - lo) / width, 0.0f, HYK_BELOW_ONE);
}

/* Point of [0, 1) with density in proportion to a at 0, b at 1, linear between. */
HYK_FN hyk_real hyk_sample_linear(hyk_real u, hyk_real a, hyk_real b) {
    hyk_real m = hyk_max(a, b);
    if (!(m > 0.0f)) return u;
    hyk_real p = a / m, q = b / m;
    hyk_real root = hyk_sqrt(hyk_lerp(p * p, q * q, u));
    return p + root > 0.0f ? hyk_min(u * (p + q) / (p + root), HYK_BELOW_ONE) : 0.0f;
}

/* ---- long chains of choices from one random number

   A random number has 24 bits. A tree of a million leaves eats 20 of them on the way down, and a branch of
   probability 1e-9 is not even seen. So the number lives on a grid of 2^-24 and every choice draws what lies
   below the grid from a hash: probabilities keep their relative precision at every depth, and the number's
   own stratification is kept, because the hash only fills in bits that were never there. */
HYK_STRUCT(hyk_chooser) {
    hyk_uint steps;        /* the number, in units of 2^-24: an integer, so that its distance from 1 is exact too */
    hyk_uint seed;
    hyk_real probability;  /* of all choices so far */
    hyk_bool second;       /* the last choice */
} HYK_END(hyk_chooser)

#define HYK_CHOICE_STEPS 16777216.0f
#define HYK_CHOICE_LAST 16777215u
#define HYK_CHOICE_CELL HYK_C(5.9604644775390625e-08)

HYK_FN hyk_uint hyk_to_choice_steps(hyk_real u) { return HYK_TO_UINT(hyk_clamp(u, 0.0f, HYK_BELOW_ONE) * HYK_CHOICE_STEPS); }

/* What is left of the number after the choices, for other use. */
HYK_FN hyk_real hyk_choice_rest(hyk_chooser c) { return HYK_TO_REAL(c.steps) * HYK_CHOICE_CELL; }

/* Permuted congruential generator's output step (O'Neill 2014), as a hash. */
HYK_FN hyk_uint hyk_choice_hash(hyk_uint x) {
    hyk_uint word = ((x >> ((x >> 28) + 4u)) ^ x) * 277803737u;
    return (word >> 22) ^ word;
}

/* other: random numbers of the same sample that serve other purposes; they seed the hash. */
HYK_FN hyk_chooser hyk_start_choosing(hyk_real u, hyk_vec2 other) {
    hyk_chooser c;
    c.steps = hyk_to_choice_steps(u);
    c.seed = hyk_choice_hash(c.steps * 747796405u + 2891336453u) ^ hyk_to_choice_steps(other.x);
    c.seed = hyk_choice_hash(c.seed * 747796405u + 2891336453u) ^ hyk_to_choice_steps(other.y);
    c.probability = 1.0f;
    c.second = false;
    return c;
}

/* Takes the rarer branch with probability share (at most 1/2); rarer_is_second says which one it is. The
   number is measured from the rarer branch's end. */
HYK_FN hyk_chooser hyk_choose_share(hyk_chooser c, hyk_real share, hyk_bool rarer_is_second) {
    c.seed = c.seed * 747796405u + 2891336453u;
    hyk_real below_grid = HYK_TO_REAL(hyk_choice_hash(c.seed) >> 8) * (HYK_CHOICE_CELL * HYK_CHOICE_CELL);
    hyk_real on_grid = HYK_TO_REAL(rarer_is_second ? HYK_CHOICE_LAST - c.steps : c.steps) * HYK_CHOICE_CELL;
    hyk_bool rare = on_grid + below_grid < share;
    hyk_real u = rare ? (on_grid + below_grid) / hyk_max(share, HYK_C(1e-37)) : ((on_grid - share) + below_grid) / (1.0f - share);
    hyk_uint steps = hyk_to_choice_steps(u);
    c.steps = rarer_is_second ? HYK_CHOICE_LAST - steps : steps;
    c.probability *= rare ? share : 1.0f - share;
    c.second = rare == rarer_is_second;
    return c;
}

/* Takes the first or the second branch in proportion to weights that are not both zero. */
HYK_FN hyk_chooser hyk_choose(hyk_chooser c, hyk_real first, hyk_real second) {
    return hyk_choose_share(c, hyk_min(first, second) / (first + second), second < first);
}

/* Power heuristic (Veach 1997, 9.2.4, exponent 2): weight of a sample whose own density is a where another
   strategy has density b. Ratios only, so that neither huge nor tiny densities overflow their squares. */
HYK_FN hyk_real hyk_power_heuristic(hyk_real a, hyk_real b) {
    hyk_real p = hyk_min(a, HYK_REAL_MAX), q = hyk_min(b, HYK_REAL_MAX);
    if (!(p > 0.0f)) return 0.0f;
    if (!(q > 0.0f)) return 1.0f;
    if (p >= q) {
        hyk_real r = q / p;
        return 1.0f / (1.0f + r * r);
    }
    hyk_real s = p / q;
    return s * s / (1.0f + s * s);
}

#endif /* HYK_SAMPLING_H */

/* >>shared-alpha: a triangle's material and uv, and which candidate hits stop a ray, decided inside the traversal */
#ifndef HYK_ALPHA_H
#define HYK_ALPHA_H

/* Index of the material on a triangle of a placed mesh. */
HYK_FN hyk_uint hyk_triangle_material(hyk_view view, hyk_uint instance, hyk_uint triangle) {
    hyk_uint own = HYK_LOAD_INSTANCE(view, instance).material;
    if (own != HYK_NONE) return own;
    hyk_uint mesh = HYK_LOAD_INSTANCE(view, instance).mesh;
    hyk_mesh m = HYK_LOAD_MESH(view, mesh);
    if ((m.flags & HYK_MESH_TRIANGLE_MATERIALS) != 0u) return HYK_LOAD_TRIANGLE_MATERIAL(view, mesh, triangle);
    return m.material;
}

/* uv at the weights of vertex 1 and vertex 2; zero where the mesh has none. */
HYK_FN hyk_vec2 hyk_triangle_uv(hyk_view view, hyk_uint mesh, hyk_uint triangle, hyk_vec2 weights) {
    if ((HYK_LOAD_MESH(view, mesh).flags & HYK_MESH_HAS_UVS) == 0u) return hyk_make2(0.0f, 0.0f);
    hyk_vec2 a = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle));
    hyk_vec2 b = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle + 1u));
    hyk_vec2 c = hyk_load_uv(view, mesh, HYK_LOAD_INDEX(view, mesh, 3u * triangle + 2u));
    return hyk_make2(a.x + (b.x - a.x) * weights.x + (c.x - a.x) * weights.y,
                     a.y + (b.y - a.y) * weights.x + (c.y - a.y) * weights.y);
}

HYK_FN hyk_real hyk_alpha_at(hyk_view view, hyk_material material, hyk_vec2 uv) {
    if (material.alpha_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.alpha_texture, uv, 0.0f).rgb.x;
    if (material.base_color_texture != HYK_NONE) return material.alpha * hyk_sample_texture(view, material.base_color_texture, uv, 0.0f).a;
    return material.alpha;
}

/* A number in [0, 1) that depends on the ray and the triangle alone: the same answer in whatever order they meet. A ray
   exactly through a shared edge asks both triangles; a common number for a mesh would tie the layers of foliage together. */
HYK_FN hyk_real hyk_alpha_threshold(hyk_ray ray, hyk_uint instance, hyk_uint primitive) {
    hyk_uint h = hyk_hash2(instance, primitive);
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.y)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.origin.z)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.t_max)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.x)));
    h = hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.y)));
    return hyk_unit_real(hyk_hash2(h, hyk_float_bits(HYK_TO_FLOAT(ray.direction.z))));
}

/* Whether a surface of alpha there stops a ray that draws threshold. */
HYK_FN hyk_bool hyk_alpha_stops(hyk_material material, hyk_real alpha, hyk_real threshold) {
    if ((material.flags & HYK_MATERIAL_ALPHA_MASK) != 0u) return alpha >= material.alpha_cutoff;
    return threshold < alpha;
}

HYK_FN hyk_bool hyk_material_has_alpha(hyk_material material) {
    return (material.flags & (HYK_MATERIAL_ALPHA_MASK | HYK_MATERIAL_ALPHA_BLEND)) != 0u;
}

/* ray is in world space. */
HYK_FN hyk_bool hyk_hit_is_opaque(hyk_view view, hyk_uint instance, hyk_uint primitive, hyk_real u, hyk_real v, hyk_ray ray) {
    hyk_material material = HYK_LOAD_MATERIAL(view, hyk_triangle_material(view, instance, primitive));
    if (!hyk_material_has_alpha(material)) return true;
    hyk_vec2 uv = hyk_triangle_uv(view, HYK_LOAD_INSTANCE(view, instance).mesh, primitive, hyk_make2(u, v));
    return hyk_alpha_stops(material, hyk_alpha_at(view, material, uv), hyk_alpha_threshold(ray, instance, primitive));
}

#endif /* HYK_ALPHA_H */

/* >>shared-shape: lights that rays can hit: rectangle, disc, sphere */
#ifndef HYK_SHAPE_H
#define HYK_SHAPE_H

HYK_FN hyk_real hyk_within_ray(hyk_ray ray, hyk_real t) { return t >= ray.t_min && t <= ray.t_max ? t : -1.0f; }

/* Where the ray meets the plane of a sheet, or -1. */
HYK_FN hyk_real hyk_intersect_sheet_plane(hyk_light light, hyk_vec3 to_center, hyk_ray ray) {
    hyk_real slope = hyk_dot(light.normal, ray.direction);
    if (slope == 0.0f) return -1.0f;
    return hyk_within_ray(ray, hyk_dot(light.normal, to_center) / slope);
}

/* A parallelogram: half edges need not be perpendicular. w lies in it when both its coordinates along them,
   found with the dual basis, are at most 1. */
HYK_FN hyk_bool hyk_rect_holds(hyk_light light, hyk_vec3 w) {
    hyk_vec3 across_v = hyk_cross(light.axis_v, light.normal), across_u = hyk_cross(light.normal, light.axis_u);
    return hyk_abs(hyk_dot(w, across_v)) <= hyk_abs(hyk_dot(light.axis_u, across_v)) &&
           hyk_abs(hyk_dot(w, across_u)) <= hyk_abs(hyk_dot(light.axis_v, across_u));
}

HYK_FN hyk_real hyk_intersect_sheet(hyk_light light, hyk_ray ray) {
    hyk_vec3 to_center = hyk_sub(light.position, ray.origin);
    hyk_real t = hyk_intersect_sheet_plane(light, to_center, ray);
    if (t < 0.0f) return -1.0f;
    hyk_vec3 w = hyk_sub(hyk_scale(ray.direction, t), to_center);
    if (light.kind == HYK_LIGHT_DISC) return hyk_length(w) <= light.radius ? t : -1.0f;
    return hyk_rect_holds(light, w) ? t : -1.0f;
}

/* The discriminant comes from the distance of the centre to the line, not from b^2 - ac, and the roots from
   q, so that neither a distant nor a near or huge sphere loses its bits (Haines, Guenther, Akenine-Moeller
   2019, "Precision improvements for ray/sphere intersection"). All lengths are in units of the larger of
   radius and distance, the direction in units of its largest component: no square over- or underflows. */
HYK_FN hyk_real hyk_intersect_sphere(hyk_light light, hyk_ray ray) {
    hyk_vec3 f = hyk_sub(ray.origin, light.position);
    hyk_real unit = hyk_max(hyk_max3(hyk_abs3(f)), light.radius), stretch = hyk_max3(hyk_abs3(ray.direction));
    if (!(unit > 0.0f && stretch > 0.0f)) return -1.0f;
    f = hyk_make3(f.x / unit, f.y / unit, f.z / unit);
    hyk_vec3 d = hyk_make3(ray.direction.x / stretch, ray.direction.y / stretch, ray.direction.z / stretch);
    hyk_real r = light.radius / unit;
    hyk_real a = hyk_dot(d, d), b = -hyk_dot(f, d);
    hyk_vec3 miss = hyk_add_scaled(f, d, b / a);
    hyk_real height = hyk_length(miss);
    if (!(height <= r)) return -1.0f;
    hyk_real half_chord = hyk_sqrt(a * (r - height) * (r + height));
    hyk_real q = b >= 0.0f ? b + half_chord : b - half_chord;
    if (q == 0.0f) return -1.0f;
    hyk_real length_f = hyk_sqrt(hyk_dot(f, f));
    hyk_real x = (length_f - r) * (length_f + r) / q, y = q / a;
    hyk_real to_ray = unit / stretch;
    hyk_real t = hyk_within_ray(ray, hyk_min(x, y) * to_ray);
    return t < 0.0f ? hyk_within_ray(ray, hyk_max(x, y) * to_ray) : t;
}

/* t of the nearest hit in [t_min, t_max], -1: none. The ray's direction need not be unit length. Sheets are
   hit from both sides, a sphere also from inside. Kinds without a body are never hit. */
HYK_FN hyk_real hyk_intersect_shape(hyk_light light, hyk_ray ray) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_intersect_sphere(light, ray);
    if (light.kind == HYK_LIGHT_RECT || light.kind == HYK_LIGHT_DISC) return hyk_intersect_sheet(light, ray);
    return -1.0f;
}

/* The front's geometric normal, unit length; outwards for the sphere. */
HYK_FN hyk_vec3 hyk_shape_normal(hyk_light light, hyk_vec3 point) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_normalize(hyk_sub(point, light.position));
    return light.normal;
}

/* The radiance that a point of the shape with that front normal sends against a ray of that direction. */
HYK_FN hyk_vec3 hyk_shape_radiance(hyk_light light, hyk_vec3 normal, hyk_vec3 direction) {
    if (hyk_dot(normal, direction) < 0.0f) return light.radiance;
    hyk_bool glows_behind = light.kind != HYK_LIGHT_SPHERE && (light.flags & HYK_LIGHT_BOTH_SIDES) != 0u;
    return glows_behind ? light.radiance : hyk_zero3();
}

#endif /* HYK_SHAPE_H */

/* >>shared-surface: what stands at a hit: place and its error bound, normals, material with textures applied */
#ifndef HYK_SURFACE_H
#define HYK_SURFACE_H

HYK_STRUCT(hyk_surface) {
    hyk_vec3 position;
    hyk_real error;      /* the true point lies within error of position, measured along the normal */
    hyk_vec3 geometric;  /* unit normal of the face, towards the side the ray came from */
    hyk_real uv_scale;   /* uv units per metre, for mip selection */
    hyk_vec3 shading;    /* unit, the same side as geometric */
    hyk_uint material;
    hyk_vec2 uv;
    hyk_bool front;      /* the ray came from outside */
} HYK_END(hyk_surface)

/* Bound of n rounded operations (Higham 2002, section 3.1). */
HYK_FN hyk_real hyk_gamma(hyk_real n) { return n * HYK_REAL_EPSILON / (1.0f - n * HYK_REAL_EPSILON); }

HYK_FN hyk_vec3 hyk_transform_point(hyk_instance m, hyk_vec3 p) {
    return hyk_make3(hyk_dot(m.row0, p) + m.t0, hyk_dot(m.row1, p) + m.t1, hyk_dot(m.row2, p) + m.t2);
}
HYK_FN hyk_vec3 hyk_transform_vector(hyk_instance m, hyk_vec3 v) {
    return hyk_make3(hyk_dot(m.row0, v), hyk_dot(m.row1, v), hyk_dot(m.row2, v));
}
/* By the transpose of the inverse; not unit length. A mirrored instance keeps its outside outside. */
HYK_FN hyk_vec3 hyk_transform_normal(hyk_instance m, hyk_vec3 n) {
    return hyk_add(hyk_scale(m.inverse0, n.x), hyk_add(hyk_scale(m.inverse1, n.y), hyk_scale(m.inverse2, n.z)));
}

/* Error of a point that went through the instance's transform and whose ray will come back through the inverse: both
   roundings, carried to world space (Pharr, Jakob, Humphreys 2023, section 6.8.1, with the way back added). */
HYK_FN hyk_vec3 hyk_transformed_error(hyk_instance m, hyk_vec3 p, hyk_vec3 world, hyk_vec3 error) {
    hyk_vec3 a = hyk_abs3(p), w = hyk_abs3(world);
    hyk_real g = hyk_gamma(4.0f);
    hyk_vec3 back = hyk_make3(hyk_dot(hyk_abs3(m.inverse0), w) + hyk_abs(m.s0), hyk_dot(hyk_abs3(m.inverse1), w) + hyk_abs(m.s1),
                              hyk_dot(hyk_abs3(m.inverse2), w) + hyk_abs(m.s2));
    hyk_vec3 local = hyk_add(error, hyk_scale(back, g));
    return hyk_make3(hyk_dot(hyk_abs3(m.row0), local) + g * (hyk_dot(hyk_abs3(m.row0), a) + hyk_abs(m.t0)),
                     hyk_dot(hyk_abs3(m.row1), local) + g * (hyk_dot(hyk_abs3(m.row1), a) + hyk_abs(m.t1)),
                     hyk_dot(hyk_abs3(m.row2), local) + g * (hyk_dot(hyk_abs3(m.row2), a) + hyk_abs(m.t2)));
}

/* The start of a ray leaving p to the side of the unit normal n: moved by the error bound, and by one rounding more, so
   that it is never on the wrong side of its own surface. */
HYK_FN hyk_vec3 hyk_offset_point(hyk_vec3 p, hyk_vec3 n, hyk_real error) {
    hyk_real rounding = 2.0f * HYK_REAL_EPSILON * (hyk_abs(n.x * p.x) + hyk_abs(n.y * p.y) + hyk_abs(n.z * p.z));
    return hyk_add_scaled(p, n, 2.0f * (error + rounding));
}

/* Unit normal of a triangle from two edges of any length. */
HYK_FN hyk_vec3 hyk_face_normal(hyk_vec3 e1, hyk_vec3 e2) { return hyk_normalize(hyk_cross(hyk_normalize(e1), hyk_normalize(e2))); }

/* A shading normal that the viewer sees from above: bent towards him where interpolation turned it away. */
HYK_FN hyk_vec3 hyk_visible_normal(hyk_vec3 shading, hyk_vec3 to_viewer) {
    hyk_real c = hyk_dot(shading, to_viewer);
    if (c > HYK_C(0.01)) return shading;
    return hyk_normalize(hyk_add_scaled(shading, to_viewer, HYK_C(0.01) - c));
}

HYK_FN hyk_vec3 hyk_smooth_normal(hyk_view view, hyk_instance placed, hyk_vec3 weights, hyk_uint i0, hyk_uint i1, hyk_uint i2) {
    hyk_vec3 n = hyk_scale(hyk_load_normal(view, placed.mesh, i0), weights.x);
    n = hyk_add_scaled(n, hyk_load_normal(view, placed.mesh, i1), weights.y);
    n = hyk_add_scaled(n, hyk_load_normal(view, placed.mesh, i2), weights.z);
    return hyk_normalize(hyk_transform_normal(placed, n));
}

/* Tangent-space normal map over the smooth normal: tangent from the uv gradient, made orthogonal to it. */
HYK_FN hyk_vec3 hyk_mapped_normal(hyk_view view, hyk_material material, hyk_vec2 uv, hyk_real lod, hyk_vec3 shading, hyk_vec3 tangent,
                                  hyk_real handedness) {
    hyk_vec3 t = hyk_normalize(hyk_add_scaled(tangent, shading, -hyk_dot(tangent, shading)));
    if (hyk_length_squared(t) < 0.5f) return shading;
    hyk_vec3 b = hyk_scale(hyk_cross(shading, t), handedness);
    hyk_vec3 m = hyk_sample_texture(view, material.normal_texture, uv, lod).rgb;
    hyk_real x = (2.0f * m.x - 1.0f) * material.normal_scale, y = (2.0f * m.y - 1.0f) * material.normal_scale;
    hyk_real z = 2.0f * m.z - 1.0f;
    if (z <= 0.0f) return shading;
    return hyk_normalize(hyk_add(hyk_scale(t, x), hyk_add(hyk_scale(b, y), hyk_scale(shading, z))));
}

/* log2 of a texture's footprint in texels, for a footprint of width metres. */
HYK_FN hyk_real hyk_texture_lod(hyk_view view, hyk_uint texture, hyk_real width, hyk_real uv_scale) {
    hyk_texture t = HYK_LOAD_TEXTURE(view, texture);
    hyk_real texels = width * uv_scale * hyk_sqrt(HYK_TO_REAL(t.width) * HYK_TO_REAL(t.height));
    return texels > 1.0f ? hyk_log2(texels) : 0.0f;
}

/* The corners of a hit triangle in object space, and what follows from them. */
HYK_STRUCT(hyk_corners) {
    hyk_vec3 weights;    /* barycentric, of the hit */
    hyk_uint i0;
    hyk_vec3 edge1, edge2;
    hyk_vec3 position;
    hyk_uint i1;
    hyk_vec3 error;      /* per component */
    hyk_uint i2;
} HYK_END(hyk_corners)

HYK_FN hyk_corners hyk_load_corners(hyk_view view, hyk_uint mesh, hyk_hit hit) {
    hyk_corners t;
    t.i0 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive);
    t.i1 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive + 1u);
    t.i2 = HYK_LOAD_INDEX(view, mesh, 3u * hit.primitive + 2u);
    hyk_vec3 a = hyk_load_position(view, mesh, t.i0);
    hyk_vec3 b = hyk_load_position(view, mesh, t.i1);
    hyk_vec3 c = hyk_load_position(view, mesh, t.i2);
    t.weights = hyk_make3(1.0f - hit.u - hit.v, hit.u, hit.v);
    hyk_vec3 wa = hyk_scale(a, t.weights.x), wb = hyk_scale(b, t.weights.y), wc = hyk_scale(c, t.weights.z);
    t.position = hyk_add(wa, hyk_add(wb, wc));
    t.error = hyk_scale(hyk_add(hyk_abs3(wa), hyk_add(hyk_abs3(wb), hyk_abs3(wc))), hyk_gamma(8.0f));
    t.edge1 = hyk_sub(b, a);
    t.edge2 = hyk_sub(c, a);
    return t;
}

/* uv and uv_scale of s, and the normal map over its smooth normal; edges in world space. */
HYK_FN hyk_surface hyk_add_texture_space(hyk_view view, hyk_surface s, hyk_uint mesh, hyk_corners t, hyk_vec3 e1, hyk_vec3 e2,
                                         hyk_real width, hyk_uint features) {
    hyk_vec2 a = hyk_load_uv(view, mesh, t.i0), b = hyk_load_uv(view, mesh, t.i1), c = hyk_load_uv(view, mesh, t.i2);
    s.uv = hyk_make2(t.weights.x * a.x + t.weights.y * b.x + t.weights.z * c.x, t.weights.x * a.y + t.weights.y * b.y + t.weights.z * c.y);
    hyk_real du1 = b.x - a.x, dv1 = b.y - a.y, du2 = c.x - a.x, dv2 = c.y - a.y;
    hyk_real determinant = du1 * dv2 - du2 * dv1;
    hyk_real length1 = hyk_length(e1);
    hyk_real height = length1 > 0.0f ? hyk_length(hyk_cross(hyk_scale(e1, 1.0f / length1), e2)) : 0.0f;
    if (height > 0.0f) s.uv_scale = hyk_sqrt(hyk_abs(determinant) / height / length1);
    if (!HYK_HAS(features, HYK_NEEDS_NORMAL_MAPS) || determinant == 0.0f) return s;
    hyk_material material = HYK_LOAD_MATERIAL(view, s.material);
    if (material.normal_texture == HYK_NONE) return s;
    hyk_real sign = determinant > 0.0f ? 1.0f : -1.0f;
    hyk_vec3 tangent = hyk_normalize(hyk_scale(hyk_sub(hyk_scale(e1, dv2), hyk_scale(e2, dv1)), sign));
    hyk_real lod = hyk_texture_lod(view, material.normal_texture, width, s.uv_scale);
    /* v grows downwards in the image, but the map's green points up: hence the minus */
    s.shading = hyk_mapped_normal(view, material, s.uv, lod, s.shading, tangent, -sign);
    return s;
}

/* The surface at a triangle hit; direction is the ray's, width the diameter of its cone there (0: finest mip level). */
HYK_FN hyk_surface hyk_surface_at(hyk_view view, hyk_hit hit, hyk_vec3 direction, hyk_real width, hyk_uint features) {
    hyk_instance placed = HYK_LOAD_INSTANCE(view, hit.instance);
    hyk_uint mesh_flags = HYK_LOAD_MESH(view, placed.mesh).flags;
    hyk_corners t = hyk_load_corners(view, placed.mesh, hit);
    hyk_vec3 e1 = t.edge1, e2 = t.edge2, error = t.error;
    hyk_surface s;
    s.position = t.position;
    s.geometric = hyk_face_normal(e1, e2);
    if (HYK_HAS(features, HYK_NEEDS_INSTANCES) && (placed.flags & HYK_INSTANCE_IDENTITY) == 0u) {
        s.position = hyk_transform_point(placed, t.position);
        error = hyk_transformed_error(placed, t.position, s.position, error);
        s.geometric = hyk_normalize(hyk_transform_normal(placed, s.geometric));
        e1 = hyk_transform_vector(placed, e1);
        e2 = hyk_transform_vector(placed, e2);
    }
    s.error = hyk_dot(hyk_abs3(s.geometric), error);
    s.front = hyk_dot(s.geometric, direction) < 0.0f;
    s.shading = s.geometric;
    s.uv = hyk_make2(0.0f, 0.0f);
    s.uv_scale = 0.0f;
    s.material = hyk_triangle_material(view, hit.instance, hit.primitive);
    if (HYK_HAS(features, HYK_NEEDS_SMOOTH_NORMALS) && (mesh_flags & HYK_MESH_HAS_NORMALS) != 0u) {
        hyk_vec3 smooth_normal = hyk_smooth_normal(view, placed, t.weights, t.i0, t.i1, t.i2);
        if (hyk_length_squared(smooth_normal) > 0.5f)
            s.shading = hyk_scale(smooth_normal, hyk_dot(smooth_normal, s.geometric) < 0.0f ? -1.0f : 1.0f);
    }
    if (HYK_HAS(features, HYK_NEEDS_TEXTURES) && (mesh_flags & HYK_MESH_HAS_UVS) != 0u)
        s = hyk_add_texture_space(view, s, placed.mesh, t, e1, e2, width, features);
    if (!s.front) {
        s.geometric = hyk_neg(s.geometric);
        s.shading = hyk_neg(s.shading);
    }
    s.shading = hyk_visible_normal(s.shading, hyk_neg(direction));
    return s;
}

/* The surface's material with its textures multiplied in. */
HYK_FN hyk_material hyk_material_at(hyk_view view, hyk_surface s, hyk_real width, hyk_uint features) {
    hyk_material m = HYK_LOAD_MATERIAL(view, s.material);
    if (!HYK_HAS(features, HYK_NEEDS_TEXTURES)) return m;
    if (m.base_color_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.base_color_texture, width, s.uv_scale);
        hyk_vec3 texel = hyk_sample_texture(view, m.base_color_texture, s.uv, lod).rgb;
        m.base_color = hyk_mul(m.base_color, hyk_make3(hyk_min(texel.x, 1.0f), hyk_min(texel.y, 1.0f), hyk_min(texel.z, 1.0f)));
    }
    if (m.metallic_roughness_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.metallic_roughness_texture, width, s.uv_scale);
        hyk_rgba texel = hyk_sample_texture(view, m.metallic_roughness_texture, s.uv, lod);
        m.roughness = hyk_saturate(m.roughness * texel.rgb.y);
        m.metallic = hyk_saturate(m.metallic * texel.rgb.z);
    }
    if (m.emission_texture != HYK_NONE) {
        hyk_real lod = hyk_texture_lod(view, m.emission_texture, width, s.uv_scale);
        m.emission = hyk_mul(m.emission, hyk_sample_texture(view, m.emission_texture, s.uv, lod).rgb);
    }
    return m;
}

#endif /* HYK_SURFACE_H */

/* >>shared-fresnel: reflectance of smooth interfaces, mirrored and refracted directions

   cos_o is the cosine between the outgoing direction and the (micro) normal on its side, eta the index on
   the far side over the index on the near side. The formulas are rearranged so that nothing cancels as
   eta goes to 1. */
#ifndef HYK_FRESNEL_H
#define HYK_FRESNEL_H

/* eta times the cosine of the refracted direction, from eta^2 cos_t^2 = cos_o^2 + eta^2 - 1;
   0: total internal reflection. */
HYK_FN hyk_real hyk_refracted_cosine(hyk_real cos_o, hyk_real eta) {
    return hyk_safe_sqrt(cos_o * cos_o + (eta - 1.0f) * (eta + 1.0f));
}

/* Unpolarised reflectance of a dielectric, of both cosines, g = eta cos_t. With e = eta^2 - 1 the amplitudes are
   r_s = -e / (cos_o + g)^2 and r_p = e (cos_o^2 (eta^2 + 1) - 1) / (eta^2 cos_o + g)^2. */
HYK_FN hyk_real hyk_fresnel_of_pair(hyk_real c, hyk_real g, hyk_real eta) {
    hyk_real e = (eta - 1.0f) * (eta + 1.0f);
    if (!(g > 0.0f)) return e == 0.0f ? 0.0f : 1.0f;
    hyk_real s = c + g, p = eta * eta * c + g;
    hyk_real r_s = e / (s * s);
    hyk_real r_p = e * (c * c * (eta * eta + 1.0f) - 1.0f) / (p * p);
    return hyk_min(0.5f * (r_s * r_s + r_p * r_p), 1.0f);
}
HYK_FN hyk_real hyk_fresnel_dielectric(hyk_real cos_o, hyk_real eta) {
    hyk_real c = hyk_saturate(cos_o);
    return hyk_fresnel_of_pair(c, hyk_refracted_cosine(c, eta), eta);
}

/* Unpolarised reflectance of a medium of index eta + i k. With (a + i b)^2 = (eta + i k)^2 - sin^2:
   R_s = |cos - (a + ib)|^2 / |cos + (a + ib)|^2 and R_p = R_s |(a + ib) cos - sin^2|^2 / |(a + ib) cos + sin^2|^2.
   The smaller of a and b comes from a b = eta k, so that it does not cancel. */
HYK_FN hyk_real hyk_fresnel_complex(hyk_real cos_o, hyk_real eta, hyk_real k) {
    hyk_real c = hyk_saturate(cos_o);
    hyk_real c2 = c * c, s2 = 1.0f - c2;
    hyk_real t = (eta - k) * (eta + k) - s2;
    hyk_real length = hyk_sqrt(t * t + 4.0f * eta * eta * k * k);
    hyk_real large = hyk_sqrt(0.5f * (length + hyk_abs(t)));
    hyk_real small_one = large > 0.0f ? eta * k / large : 0.0f;
    hyk_real a = t >= 0.0f ? large : small_one;
    hyk_real b = t >= 0.0f ? small_one : large;
    hyk_real below = hyk_square(a + c) + b * b;
    if (!(below > 0.0f)) return 1.0f;
    hyk_real r_s = (hyk_square(a - c) + b * b) / below;
    hyk_real below_p = hyk_square(a * c + s2) + b * b * c2;
    if (!(below_p > 0.0f)) return r_s;
    hyk_real r_p = r_s * (hyk_square(a * c - s2) + b * b * c2) / below_p;
    return hyk_min(0.5f * (r_s + r_p), 1.0f);
}

/* (1 - cos)^5, the shape of Schlick's approximation (1994); its hemispherical mean is 1/21. */
HYK_FN hyk_real hyk_schlick_weight(hyk_real cos_o) {
    hyk_real m = 1.0f - hyk_saturate(cos_o);
    hyk_real m2 = m * m;
    return m2 * m2 * m;
}
HYK_FN hyk_vec3 hyk_fresnel_schlick(hyk_vec3 f0, hyk_real cos_o) {
    hyk_real w = hyk_schlick_weight(cos_o);
    return hyk_add_scaled(hyk_splat(w), f0, 1.0f - w);
}
#define HYK_SCHLICK_MEAN HYK_C(1.0 / 21.0)

/* Mirror image of wo about the unit normal h, cos_o = dot(wo, h). */
HYK_FN hyk_vec3 hyk_reflect(hyk_vec3 wo, hyk_vec3 h, hyk_real cos_o) {
    return hyk_normalize(hyk_sub(hyk_scale(h, 2.0f * cos_o), wo));
}

/* Snell's law: the direction on the far side; g = hyk_refracted_cosine(cos_o, eta) > 0.
   cos_o - g is written as -(eta^2 - 1) / (cos_o + g). */
HYK_FN hyk_vec3 hyk_refract(hyk_vec3 wo, hyk_vec3 h, hyk_real cos_o, hyk_real g, hyk_real eta) {
    hyk_real along = -(eta - 1.0f) * (eta + 1.0f) / (cos_o + g);
    return hyk_normalize(hyk_sub(hyk_scale(h, along), wo));
}

#endif /* HYK_FRESNEL_H */

/* >>shared-microfacet: the GGX distribution, Smith masking and sampling of visible normals

   Local frame, z the macro normal, alpha the isotropic width. Slopes are taken from x and y, never from
   1 - z^2, and masking from sqrt(z^2 + alpha^2 (x^2 + y^2)), so that narrow lobes and grazing directions keep
   their bits (Walter et al. 2007; Heitz 2014, "Understanding the masking-shadowing function"). */
#ifndef HYK_MICROFACET_H
#define HYK_MICROFACET_H

/* Below this alpha (roughness 0.01) a surface is perfectly smooth. */
#define HYK_SMOOTH_ALPHA HYK_C(1e-4)

HYK_FN hyk_real hyk_alpha_of_roughness(hyk_real roughness) { return hyk_square(hyk_saturate(roughness)); }
HYK_FN hyk_bool hyk_is_smooth(hyk_real alpha) { return alpha < HYK_C(0.9999e-4); }

/* Density of micro normals, per steradian of normal and area of macro surface. */
HYK_FN hyk_real hyk_ggx_distribution(hyk_vec3 h, hyk_real alpha) {
    if (!(h.z > 0.0f)) return 0.0f;
    hyk_real x = h.x / alpha, y = h.y / alpha;
    hyk_real t = alpha * (x * x + y * y + h.z * h.z);
    return HYK_INV_PI / (t * t);
}

/* |cos| (1 + 2 Lambda) of the Smith masking function, 0 only for the zero vector. */
HYK_FN hyk_real hyk_ggx_stretch(hyk_vec3 w, hyk_real alpha) {
    return hyk_sqrt(w.z * w.z + alpha * alpha * (w.x * w.x + w.y * w.y));
}

/* Height-correlated G2(wo, wi) |cos wi| / (4 cos wo |cos wi|): times D and F this is f cos of reflection.
   Also used for transmission, as in today's renderers, with wi on the other side. */
HYK_FN hyk_real hyk_ggx_visibility(hyk_vec3 wo, hyk_vec3 wi, hyk_real alpha) {
    hyk_real o = hyk_abs(wo.z), i = hyk_abs(wi.z);
    return 0.5f * i / (i * hyk_ggx_stretch(wo, alpha) + o * hyk_ggx_stretch(wi, alpha));
}

/* 1 - G2 / G1(wo): what a visible normal loses of the direction it sends on. No difference of near equals:
   the stretch of wi minus its cosine is alpha^2 sin^2 / (their sum). */
HYK_FN hyk_real hyk_ggx_stopped(hyk_vec3 wo, hyk_vec3 wi, hyk_real alpha) {
    hyk_real o = hyk_abs(wo.z), i = hyk_abs(wi.z), stretch_i = hyk_ggx_stretch(wi, alpha);
    hyk_real over = alpha * alpha * (wi.x * wi.x + wi.y * wi.y) / (stretch_i + i);
    return hyk_min(o * over / (i * hyk_ggx_stretch(wo, alpha) + o * stretch_i), 1.0f);
}

/* Density of hyk_ggx_sample over 4 cos(wo, h): the density of the mirrored direction. */
HYK_FN hyk_real hyk_ggx_pdf_reflected(hyk_vec3 wo, hyk_real distribution, hyk_real alpha) {
    return 0.5f * distribution / (wo.z + hyk_ggx_stretch(wo, alpha));
}

/* A micro normal visible from wo, by the spherical cap that mirrors wo into the hemisphere (Dupuy &
   Benyoub 2023, "Sampling visible GGX normals with spherical caps"). wo.z >= 0; around: cosine and sine of the
   cap's azimuth. */
HYK_FN hyk_vec3 hyk_ggx_sample_around(hyk_vec3 wo, hyk_real alpha, hyk_vec2 around, hyk_real u) {
    hyk_vec3 w = hyk_normalize(hyk_make3(alpha * wo.x, alpha * wo.y, wo.z));
    hyk_real z = (1.0f - u) * (1.0f + w.z) - w.z;
    hyk_real r = hyk_safe_sqrt((1.0f - z) * (1.0f + z));
    hyk_vec3 h = hyk_make3(r * around.x + w.x, r * around.y + w.y, z + w.z);
    return hyk_normalize(hyk_make3(alpha * h.x, alpha * h.y, hyk_max(h.z, HYK_REAL_EPSILON * HYK_REAL_EPSILON)));
}
HYK_FN hyk_vec3 hyk_ggx_sample(hyk_vec3 wo, hyk_real alpha, hyk_vec2 u) {
    hyk_real phi = HYK_TWO_PI * u.x;
    return hyk_ggx_sample_around(wo, alpha, hyk_make2(hyk_cos(phi), hyk_sin(phi)), u.y);
}

/* Half vector of a pair on the same side. */
HYK_FN hyk_vec3 hyk_half_reflected(hyk_vec3 wo, hyk_vec3 wi) { return hyk_normalize(hyk_add(wo, wi)); }

/* Half vector of a refracted pair, on the side of +z (Walter et al. 2007, eq. 16). */
HYK_FN hyk_vec3 hyk_half_refracted(hyk_vec3 wo, hyk_vec3 wi, hyk_real eta) {
    hyk_vec3 h = hyk_normalize(hyk_add_scaled(wo, wi, eta));
    if (h.z < 0.0f) return hyk_neg(h);
    return h;
}

/* 4 cos_o times d omega_h / d omega_i of refraction, eta^2 |wi.h| / (wo.h + eta wi.h)^2, with g = eta cos_t and
   |wo.h + eta wi.h| = |eta^2 - 1| / (cos_o + g). Turns the visibility and the pdf of reflection into those of
   transmission. Zero under total internal reflection. */
HYK_FN hyk_real hyk_refraction_jacobian(hyk_real cos_o, hyk_real g, hyk_real eta) {
    hyk_real inverse = (cos_o + g) / ((eta - 1.0f) * (eta + 1.0f));
    return 4.0f * cos_o * eta * g * inverse * inverse;
}

/* ---- directions for light that masking took away once: it leaves in proportion to 1 - E(cos), which falls
   like alpha^2 / (cos^2 + alpha^2). p(cos) is proportional to cos / (cos^2 + alpha^2), inverted exactly. */

HYK_FN hyk_real hyk_lost_norm(hyk_real alpha) { return hyk_log2(1.0f + 1.0f / (alpha * alpha)); }

HYK_FN hyk_vec3 hyk_lost_sample(hyk_real alpha, hyk_vec2 u) {
    hyk_real a2 = alpha * alpha;
    hyk_real z2 = hyk_min(a2 * (hyk_exp2(u.x * hyk_lost_norm(alpha)) - 1.0f), 1.0f);
    hyk_real z = hyk_max(hyk_safe_sqrt(z2), alpha * HYK_REAL_EPSILON);
    hyk_real r = hyk_safe_sqrt(1.0f - z2), phi = HYK_TWO_PI * u.y;
    return hyk_make3(r * hyk_cos(phi), r * hyk_sin(phi), z);
}

HYK_FN hyk_real hyk_lost_pdf(hyk_real cos_i, hyk_real alpha) {
    hyk_real c = hyk_abs(cos_i);
    /* log2 e = 1.4427: the norm is a binary logarithm */
    return HYK_INV_PI * HYK_C(1.44269504088896340736) * c / ((c * c + alpha * alpha) * hyk_lost_norm(alpha));
}

#endif /* HYK_MICROFACET_H */

/* >>shared-energy: tables of the energy that single scattering loses, and how they are read

   A plane holds one function of (cos, alpha): HYK_ENERGY_ROWS rows uniform in roughness = sqrt(alpha) from
   0.01 to 1, each of HYK_ENERGY_COLUMNS values uniform in sqrt(x), x = cos (1 + 2 alpha) / (cos + 2 alpha). That
   x follows the features of masking, which sit at cos ~ alpha, so that rows line up however small alpha is.
   What does not vanish with alpha is stored as the difference to its smooth limit, so that nothing needs
   resolution at cos >> alpha. After the rows come the means 2 integral f(cos) cos dcos, at finer steps of alpha:
   they must be the means of what interpolation gives, or product lobes do not conserve energy.

   A material's header: its own constants and where its planes are (in units of eight floats, exact in float;
   0: it has none). Written by src/scene/energy_tables.h. */
#ifndef HYK_ENERGY_H
#define HYK_ENERGY_H

#define HYK_ENERGY_ROWS 32u
#define HYK_ENERGY_COLUMNS 32u
#define HYK_ENERGY_STRIDE 32u
#define HYK_ENERGY_MEANS 8u /* per row */
#define HYK_ENERGY_PLANE 1280u
#define HYK_ENERGY_UNIT 8u

#define HYK_ENERGY_HEADER 8u
#define HYK_ENERGY_METAL_MEAN 0u  /* r, g, b: hemispherical mean of the complex Fresnel reflectance */
#define HYK_ENERGY_IOR_MEAN 3u    /* the same of the dielectric, from outside */
#define HYK_ENERGY_AT_METAL 4u    /* planes: loss of the white metal; its Schlick part */
#define HYK_ENERGY_AT_PLASTIC 5u  /* plane: what reaches the diffuse base */
#define HYK_ENERGY_AT_GLASS 6u    /* planes: loss from outside, reflectance from outside, both from inside */
#define HYK_ENERGY_AT_COAT 7u     /* one row: the coat's reflectance at its roughness */

/* Means at which a lobe of lost energy is not worth having: its whole albedo is below this. */
#define HYK_ENERGY_LEAST HYK_C(1e-12)

/* Where a direction falls between the columns, whatever the row. */
HYK_FN hyk_real hyk_energy_column(hyk_real cos_theta, hyk_real alpha) {
    hyk_real c = hyk_saturate(cos_theta), width = 2.0f * alpha;
    return hyk_sqrt(c * (1.0f + width) / (c + width)) * (HYK_TO_REAL(HYK_ENERGY_COLUMNS) - 1.0f);
}
/* Its inverse: the cosine of a column, for the table's builder. */
HYK_FN hyk_real hyk_energy_cosine(hyk_real column, hyk_real alpha) {
    hyk_real s = column / (HYK_TO_REAL(HYK_ENERGY_COLUMNS) - 1.0f);
    hyk_real x = s * s, width = 2.0f * alpha;
    return hyk_saturate(x * width / hyk_max(1.0f - x + width, 0.5f * width));
}
HYK_FN hyk_real hyk_energy_row(hyk_real alpha) {
    hyk_real t = (hyk_sqrt(alpha) - HYK_C(0.01)) * HYK_C(1.0 / 0.99);
    return hyk_saturate(t) * (HYK_TO_REAL(HYK_ENERGY_ROWS) - 1.0f);
}
HYK_FN hyk_real hyk_energy_row_alpha(hyk_real row) {
    return hyk_square(HYK_C(0.01) + HYK_C(0.99) * row / (HYK_TO_REAL(HYK_ENERGY_ROWS) - 1.0f));
}

/* Index of the interval that holds x, of last + 1 nodes. */
HYK_FN hyk_uint hyk_energy_interval(hyk_real x, hyk_uint last) {
    return hyk_min_uint(HYK_TO_UINT(hyk_max(x, 0.0f)), last - 1u);
}

/* Two neighbouring rows of every plane, and the share of the second. */
HYK_STRUCT(hyk_energy_rows) {
    hyk_uint offset;
    hyk_real share;
} HYK_END(hyk_energy_rows)

HYK_FN hyk_energy_rows hyk_energy_rows_of(hyk_real alpha) {
    hyk_real row = hyk_energy_row(alpha);
    hyk_uint i = hyk_energy_interval(row, HYK_ENERGY_ROWS - 1u);
    hyk_energy_rows r;
    r.offset = i * HYK_ENERGY_STRIDE;
    r.share = row - HYK_TO_REAL(i);
    return r;
}

HYK_FN hyk_real hyk_energy_mean(hyk_view view, hyk_uint plane, hyk_energy_rows rows) {
    hyk_real x = rows.share * HYK_TO_REAL(HYK_ENERGY_MEANS);
    hyk_uint j = hyk_energy_interval(x, HYK_ENERGY_MEANS);
    hyk_uint i = plane + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + rows.offset / HYK_ENERGY_STRIDE * HYK_ENERGY_MEANS + j;
    return hyk_lerp(HYK_LOAD_ENERGY(view, i), HYK_LOAD_ENERGY(view, i + 1u), x - HYK_TO_REAL(j));
}

/* Mean of a plane of losses. Those fall as alpha^2 log(1 / alpha), which no straight line between rows follows:
   their means are stored over this. */
HYK_FN hyk_real hyk_energy_lost_scale(hyk_real alpha) {
    hyk_real a = hyk_max(alpha, HYK_SMOOTH_ALPHA);
    return a * a * hyk_lost_norm(a);
}
HYK_FN hyk_real hyk_energy_mean_lost(hyk_view view, hyk_uint plane, hyk_energy_rows rows, hyk_real alpha) {
    return hyk_saturate(hyk_energy_mean(view, plane, rows) * hyk_energy_lost_scale(alpha));
}

/* One row, linearly in the column. */
HYK_FN hyk_real hyk_energy_in_row(hyk_view view, hyk_uint row, hyk_real column) {
    hyk_uint i = hyk_energy_interval(column, HYK_ENERGY_COLUMNS - 1u);
    return hyk_lerp(HYK_LOAD_ENERGY(view, row + i), HYK_LOAD_ENERGY(view, row + i + 1u), column - HYK_TO_REAL(i));
}

HYK_FN hyk_real hyk_energy_lookup(hyk_view view, hyk_uint plane, hyk_energy_rows rows, hyk_real column) {
    hyk_uint row = plane + rows.offset;
    return hyk_lerp(hyk_energy_in_row(view, row, column), hyk_energy_in_row(view, row + HYK_ENERGY_STRIDE, column), rows.share);
}

/* Plane offset out of a header; 0: none. */
HYK_FN hyk_uint hyk_energy_plane(hyk_view view, hyk_uint header, hyk_uint field) {
    return HYK_TO_UINT(HYK_LOAD_ENERGY(view, header + field)) * HYK_ENERGY_UNIT;
}

/* Albedo of all further bounces between micro facets of reflectance f (its mean), where single scattering
   keeps the share `kept`: f^2 kept / (1 - f (1 - kept)) of what it loses (Kulla & Conty 2017). */
HYK_FN hyk_real hyk_multiple_scattering(hyk_real f, hyk_real kept) {
    return hyk_min(f * f * kept / hyk_max(1.0f - f * (1.0f - kept), HYK_REAL_EPSILON), 1.0f);
}

#endif /* HYK_ENERGY_H */

/* >>shared-bsdf-layers: what a surface point is made of, and how much each part takes of the light

   Every material is a mixture of three bases under one coat:
     metal    a GGX conductor,
     plastic  a GGX dielectric over a Lambert base,
     glass    a GGX dielectric that light passes: refracting, or a thin sheet that it crosses straight.
   Single scattering loses light to masking, the coat takes some; what is left over goes into lobes of the form
   a(wo) a(wi) / (pi mean(a)), whose albedo is a(wo): reciprocal, and exactly lossless for white inputs
   (Kulla & Conty 2017, "Revisiting physically based shading at Imageworks"). Under a coat that passes t(cos),
   single scattering is weighted by min(t(wo), t(wi)), so that what is left over is never negative. */
#ifndef HYK_BSDF_LAYERS_H
#define HYK_BSDF_LAYERS_H

#define HYK_COAT_IOR 1.5f

#define HYK_BSDF_LAMBERT 0x1u      /* Lambert alone */
#define HYK_BSDF_COMPLEX 0x2u      /* metal with eta and k */
#define HYK_BSDF_THIN 0x4u
#define HYK_BSDF_SMOOTH 0x8u       /* the base is a mirror */
#define HYK_BSDF_GLASS_SMOOTH 0x10u
#define HYK_BSDF_COAT_SMOOTH 0x20u
#define HYK_BSDF_INSIDE 0x40u      /* wo is inside the glass */

HYK_STRUCT(hyk_bsdf) {
    hyk_vec3 base_color;     /* also the tint of what passes */
    hyk_real alpha;
    hyk_vec3 f0;             /* metal: Schlick's, for COMPLEX the one with the same mean */
    hyk_real metal;          /* shares of the bases; their sum is 1 */
    hyk_vec3 eta;
    hyk_real plastic;
    hyk_vec3 k;
    hyk_real glass;
    hyk_vec3 bounce;         /* albedo of the metal's further bounces */
    hyk_real plastic_bounce; /* the same of the dielectric */
    hyk_real ior;
    hyk_real glass_eta;      /* index beyond the surface over the one before it */
    hyk_real coat, coat_alpha;
    hyk_real metal_scale, plastic_scale; /* 1 / (pi mean) of the lobes of what is left over */
    hyk_real glass_reflect, glass_through, glass_split;
    hyk_uint flags;
    hyk_uint at_metal, at_plastic, at_near, at_far, at_coat; /* planes, 0: none */
    hyk_energy_rows rows;
} HYK_END(hyk_bsdf)

HYK_FN hyk_bool hyk_bsdf_is(hyk_bsdf bsdf, hyk_uint flag) { return (bsdf.flags & flag) != 0u; }

/* ---- coat */

HYK_FN hyk_real hyk_coat_reflectance(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    hyk_real smooth_value = hyk_fresnel_dielectric(cos_theta, HYK_COAT_IOR);
    if (bsdf.at_coat == 0u || hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH)) return smooth_value;
    hyk_real more = hyk_energy_in_row(view, bsdf.at_coat, hyk_energy_column(cos_theta, bsdf.coat_alpha));
    return hyk_saturate(smooth_value + more);
}
/* Share of light that passes the coat. */
HYK_FN hyk_real hyk_coat_pass(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    if (!(bsdf.coat > 0.0f)) return 1.0f;
    return 1.0f - bsdf.coat * hyk_coat_reflectance(view, bsdf, cos_theta);
}

/* ---- micro facets: reflectances at cos_h = dot(wo, h); pass: what the coat leaves of the pair */

HYK_FN hyk_vec3 hyk_metal_fresnel(hyk_bsdf bsdf, hyk_real cos_h) {
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_COMPLEX)) return hyk_fresnel_schlick(bsdf.f0, cos_h);
    return hyk_make3(hyk_fresnel_complex(cos_h, bsdf.eta.x, bsdf.k.x), hyk_fresnel_complex(cos_h, bsdf.eta.y, bsdf.k.y),
                     hyk_fresnel_complex(cos_h, bsdf.eta.z, bsdf.k.z));
}

/* Refracting glass. From inside, what the coat stops returns: the facet reflects it. */
HYK_FN hyk_real hyk_glass_facet_reflects(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real pass) {
    hyk_real f = hyk_fresnel_dielectric(cos_h, bsdf.glass_eta);
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE)) return f * pass;
    if (!(bsdf.coat > 0.0f)) return f;
    hyk_real cos_t = hyk_refracted_cosine(cos_h, bsdf.glass_eta) / bsdf.glass_eta;
    return f + (1.0f - f) * (1.0f - hyk_coat_pass(view, bsdf, cos_t));
}
/* g: glass_eta times the refracted cosine; cos_outside: of the pair's direction outside the body, to the macro
   normal. */
HYK_FN hyk_real hyk_glass_facet_passes(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real g, hyk_real cos_outside) {
    hyk_real t = 1.0f - hyk_fresnel_of_pair(cos_h, g, bsdf.glass_eta);
    if (!(bsdf.coat > 0.0f)) return t;
    hyk_real cos_facet = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? g / bsdf.glass_eta : cos_h;
    return t * hyk_min(hyk_coat_pass(view, bsdf, cos_outside), hyk_coat_pass(view, bsdf, cos_facet));
}

/* ---- shares by direction */

HYK_STRUCT(hyk_layers) {
    hyk_real pass;         /* through the coat */
    hyk_real metal_lost;   /* of the white metal, pass included in the balance: pass - its albedo */
    hyk_real schlick;      /* albedo of a metal that reflects (1 - cos)^5 */
    hyk_real diffuse;      /* what reaches the plastic's Lambert base, or crosses a thin sheet */
    hyk_real glass_lost;   /* refracting glass: neither reflected nor transmitted at once */
    hyk_real glass_back;   /* its single reflection */
    hyk_real glass_along;  /* its single transmission */
} HYK_END(hyk_layers)

HYK_FN hyk_layers hyk_layers_of_glass(hyk_view view, hyk_bsdf bsdf, hyk_layers r, hyk_real cos_theta, hyk_real column) {
    hyk_real whole = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? 1.0f : r.pass;
    r.glass_back = hyk_glass_facet_reflects(view, bsdf, cos_theta, r.pass);
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH) && bsdf.at_near != 0u) {
        r.glass_lost = hyk_saturate(hyk_energy_lookup(view, bsdf.at_near, bsdf.rows, column));
        hyk_real more = hyk_energy_lookup(view, bsdf.at_near + HYK_ENERGY_PLANE, bsdf.rows, column);
        r.glass_back = hyk_clamp(r.glass_back + more, 0.0f, hyk_max(whole - r.glass_lost, 0.0f));
    }
    r.glass_along = hyk_max(whole - r.glass_lost - r.glass_back, 0.0f);
    return r;
}

/* Of a direction on wo's side (or beyond a thin sheet). */
HYK_FN hyk_layers hyk_layers_at(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta, hyk_uint features) {
    hyk_layers r;
    hyk_real column = hyk_energy_column(cos_theta, bsdf.alpha);
    hyk_bool tabulated = !hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH);
    r.pass = hyk_coat_pass(view, bsdf, cos_theta);
    r.metal_lost = 0.0f;
    r.schlick = r.pass * hyk_schlick_weight(cos_theta);
    r.diffuse = 0.0f;
    r.glass_lost = 0.0f;
    r.glass_back = 0.0f;
    r.glass_along = 0.0f;
    if (tabulated && bsdf.at_metal != 0u) {
        r.metal_lost = hyk_saturate(hyk_energy_lookup(view, bsdf.at_metal, bsdf.rows, column));
        hyk_real more = hyk_energy_lookup(view, bsdf.at_metal + HYK_ENERGY_PLANE, bsdf.rows, column);
        r.schlick = hyk_clamp(r.schlick + more, 0.0f, r.pass);
    }
    hyk_bool sheet = HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    if (bsdf.plastic > 0.0f || sheet) {
        r.diffuse = r.pass * (1.0f - hyk_fresnel_dielectric(cos_theta, bsdf.ior));
        if (tabulated && bsdf.at_plastic != 0u) r.diffuse += hyk_energy_lookup(view, bsdf.at_plastic, bsdf.rows, column);
        r.diffuse = hyk_saturate(r.diffuse);
    }
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f && !sheet)
        r = hyk_layers_of_glass(view, bsdf, r, cos_theta, column);
    return r;
}

/* Loss of refracting glass for a direction on the other side. */
HYK_FN hyk_real hyk_glass_lost_beyond(hyk_view view, hyk_bsdf bsdf, hyk_real cos_theta) {
    if (bsdf.at_far == 0u) return 0.0f;
    return hyk_saturate(hyk_energy_lookup(view, bsdf.at_far, bsdf.rows, hyk_energy_column(cos_theta, bsdf.alpha)));
}

/* Plastic's first reflection. */
HYK_FN hyk_real hyk_plastic_back(hyk_bsdf bsdf, hyk_layers l) {
    return hyk_max(l.pass - l.diffuse - bsdf.plastic_bounce * l.metal_lost, 0.0f);
}
/* A thin sheet's first transmission. */
HYK_FN hyk_real hyk_sheet_along(hyk_bsdf bsdf, hyk_layers l) {
    return hyk_max(l.diffuse - (1.0f - bsdf.plastic_bounce) * l.metal_lost, 0.0f);
}

/* ---- making */

HYK_FN hyk_real hyk_inverse_mean(hyk_real mean) {
    return mean > HYK_ENERGY_LEAST ? HYK_INV_PI / mean : 0.0f;
}

/* How the glass's lost light divides: beta n_far^2 mean_far of it passes. Any beta is reciprocal (n^2-scaled)
   and lossless; both sides' divisions should be near that of their first scattering: the geometric mean of
   the two betas that would make them equal, kept where both divisions are at most 1. */
HYK_FN hyk_bsdf hyk_divide_glass(hyk_view view, hyk_bsdf r) {
    hyk_real near_lost = hyk_energy_mean_lost(view, r.at_near, r.rows, r.alpha);
    hyk_real far_lost = hyk_energy_mean_lost(view, r.at_far, r.rows, r.alpha);
    if (!(hyk_min(near_lost, far_lost) > HYK_ENERGY_LEAST)) return r;
    hyk_real near_back = hyk_energy_mean(view, r.at_near + HYK_ENERGY_PLANE, r.rows);
    hyk_real far_back = hyk_energy_mean(view, r.at_far + HYK_ENERGY_PLANE, r.rows);
    hyk_real near_part = hyk_saturate(1.0f - near_back / (1.0f - near_lost));
    hyk_real far_part = hyk_saturate(1.0f - far_back / (1.0f - far_lost));
    hyk_bool inside = hyk_bsdf_is(r, HYK_BSDF_INSIDE);
    hyk_real n2 = r.ior * r.ior;
    hyk_real near_limit = 1.0f / ((inside ? 1.0f : n2) * far_lost), far_limit = 1.0f / ((inside ? n2 : 1.0f) * near_lost);
    hyk_real beta = hyk_sqrt(near_part * near_limit) * hyk_sqrt(far_part * far_limit);
    beta = hyk_min(beta, hyk_min(near_limit, far_limit));
    r.glass_split = hyk_saturate(beta / near_limit);
    r.glass_reflect = (1.0f - r.glass_split) * HYK_INV_PI / near_lost;
    r.glass_through = beta * (inside ? n2 : 1.0f) * HYK_INV_PI;
    return r;
}

/* Hemispherical mean of a metal's reflectance; of_complex is it for eta and k. */
HYK_FN hyk_vec3 hyk_metal_mean(hyk_material material, hyk_vec3 of_complex) {
    if ((material.flags & HYK_MATERIAL_COMPLEX_IOR) != 0u && material.kind == HYK_MATERIAL_CONDUCTOR) return of_complex;
    return hyk_lerp3(material.base_color, hyk_splat(1.0f), HYK_SCHLICK_MEAN);
}

HYK_FN hyk_bsdf hyk_set_metal(hyk_bsdf r, hyk_material material, hyk_vec3 mean) {
    r.f0 = material.base_color;
    if ((material.flags & HYK_MATERIAL_COMPLEX_IOR) == 0u || material.kind != HYK_MATERIAL_CONDUCTOR) return r;
    r.flags |= HYK_BSDF_COMPLEX;
    r.eta = material.eta;
    r.k = material.k;
    hyk_vec3 above = hyk_scale(hyk_sub(mean, hyk_splat(HYK_SCHLICK_MEAN)), 1.0f / (1.0f - HYK_SCHLICK_MEAN));
    r.f0 = hyk_make3(hyk_saturate(above.x), hyk_saturate(above.y), hyk_saturate(above.z));
    return r;
}

/* Offsets of the planes, and what depends on roughness alone. */
HYK_FN hyk_bsdf hyk_set_energy(hyk_view view, hyk_bsdf r, hyk_material material, hyk_uint features) {
    hyk_uint header = material.energy_table;
    hyk_vec3 mean = hyk_make3(HYK_LOAD_ENERGY(view, header), HYK_LOAD_ENERGY(view, header + 1u), HYK_LOAD_ENERGY(view, header + 2u));
    mean = hyk_metal_mean(material, mean);
    r = hyk_set_metal(r, material, mean);
    r.at_metal = hyk_energy_plane(view, header, HYK_ENERGY_AT_METAL);
    r.at_plastic = hyk_energy_plane(view, header, HYK_ENERGY_AT_PLASTIC);
    r.at_coat = hyk_energy_plane(view, header, HYK_ENERGY_AT_COAT);
    if (r.at_metal != 0u) {
        hyk_real lost = hyk_energy_mean_lost(view, r.at_metal, r.rows, r.alpha);
        r.metal_scale = hyk_inverse_mean(lost);
        r.bounce = hyk_make3(hyk_multiple_scattering(mean.x, 1.0f - lost), hyk_multiple_scattering(mean.y, 1.0f - lost),
                             hyk_multiple_scattering(mean.z, 1.0f - lost));
        r.plastic_bounce = hyk_multiple_scattering(HYK_LOAD_ENERGY(view, header + HYK_ENERGY_IOR_MEAN), 1.0f - lost);
    }
    if (r.at_plastic != 0u) r.plastic_scale = hyk_inverse_mean(hyk_energy_mean(view, r.at_plastic, r.rows));
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return r;
    hyk_uint glass = hyk_energy_plane(view, header, HYK_ENERGY_AT_GLASS);
    if (glass == 0u) return r;
    hyk_bool inside = hyk_bsdf_is(r, HYK_BSDF_INSIDE);
    r.at_near = inside ? glass + 2u * HYK_ENERGY_PLANE : glass;
    r.at_far = inside ? glass : glass + 2u * HYK_ENERGY_PLANE;
    return hyk_divide_glass(view, r);
}

/* Nothing but Lambert; the start of all others. */
HYK_FN hyk_bsdf hyk_lambert_bsdf(hyk_material material) {
    hyk_bsdf r;
    r.base_color = material.base_color;
    r.alpha = 1.0f;
    r.f0 = hyk_zero3();
    r.metal = 0.0f;
    r.eta = hyk_zero3();
    r.plastic = 0.0f;
    r.k = hyk_zero3();
    r.glass = 0.0f;
    r.bounce = hyk_zero3();
    r.plastic_bounce = 0.0f;
    r.ior = 1.0f;
    r.glass_eta = 1.0f;
    r.coat = 0.0f;
    r.coat_alpha = 1.0f;
    r.metal_scale = 0.0f;
    r.plastic_scale = 0.0f;
    r.glass_reflect = 0.0f;
    r.glass_through = 0.0f;
    r.glass_split = 0.0f;
    r.flags = HYK_BSDF_LAMBERT;
    r.at_metal = 0u;
    r.at_plastic = 0u;
    r.at_near = 0u;
    r.at_far = 0u;
    r.at_coat = 0u;
    r.rows.offset = 0u;
    r.rows.share = 0.0f;
    return r;
}

HYK_FN hyk_bsdf hyk_set_shares(hyk_bsdf r, hyk_material material, hyk_uint features) {
    hyk_real passing = HYK_HAS(features, HYK_NEEDS_TRANSMISSION) ? hyk_saturate(material.transmission) : 0.0f;
    r.metal = material.kind == HYK_MATERIAL_CONDUCTOR ? 1.0f : hyk_saturate(material.metallic);
    if (material.kind == HYK_MATERIAL_DIELECTRIC) {
        passing = 1.0f;
        r.metal = 0.0f;
        if (hyk_is_black(r.base_color)) r.base_color = hyk_splat(1.0f);
    }
    r.glass = (1.0f - r.metal) * passing;
    r.plastic = (1.0f - r.metal) * (1.0f - passing);
    if (material.kind == HYK_MATERIAL_METALLIC_ROUGHNESS) r.coat = hyk_saturate(material.clearcoat);
    r.coat_alpha = hyk_alpha_of_roughness(material.clearcoat_roughness);
    return r;
}

/* Which parts are delta functions. Glass that bends less than a float direction resolves within its lobe
   (alpha (ior - 1) below 2e-5) counts as smooth: rounding would decide what a rough one looks like. So does
   glass of an index below 1.002: nothing in it can be seen to bend, and micro facets would only shadow. */
HYK_FN hyk_bsdf hyk_set_smoothness(hyk_bsdf r, hyk_bool thin, hyk_bool front) {
    if (thin) r.flags |= HYK_BSDF_THIN;
    if (!thin && !front && r.glass > 0.0f) r.flags |= HYK_BSDF_INSIDE;
    if (hyk_is_smooth(r.alpha)) r.flags |= HYK_BSDF_SMOOTH | HYK_BSDF_GLASS_SMOOTH;
    if (!thin && (r.alpha * (r.ior - 1.0f) < HYK_C(2e-5) || r.ior < HYK_C(1.002))) r.flags |= HYK_BSDF_GLASS_SMOOTH;
    if (hyk_is_smooth(r.coat_alpha)) r.flags |= HYK_BSDF_COAT_SMOOTH;
    r.glass_eta = hyk_bsdf_is(r, HYK_BSDF_INSIDE) ? 1.0f / r.ior : r.ior;
    return r;
}

/* The BSDF at a point: material has its textures applied; front: wo is on the surface's front. */
HYK_FN hyk_bsdf hyk_make_bsdf(hyk_view view, hyk_material material, hyk_bool front, hyk_uint features) {
    hyk_bsdf r = hyk_lambert_bsdf(material);
    if (!HYK_HAS(features, HYK_NEEDS_SPECULAR)) return r;
    if (material.kind == HYK_MATERIAL_LAMBERT) return r;
    r.flags = 0u;
    r.alpha = hyk_alpha_of_roughness(material.roughness);
    r.ior = material.ior;
    r.rows = hyk_energy_rows_of(hyk_max(r.alpha, HYK_SMOOTH_ALPHA));
    r = hyk_set_shares(r, material, features);
    r = hyk_set_smoothness(r, (material.flags & HYK_MATERIAL_THIN) != 0u, front);
    hyk_real f0 = hyk_fresnel_dielectric(1.0f, r.ior);
    r.plastic_scale = HYK_INV_PI / ((1.0f - f0) * (1.0f - HYK_SCHLICK_MEAN)); /* without a table: Schlick's mean */
    if (material.energy_table == HYK_NONE) {
        hyk_vec3 mean = hyk_make3(hyk_fresnel_complex(0.5f, material.eta.x, material.k.x), hyk_fresnel_complex(0.5f, material.eta.y, material.k.y),
                                  hyk_fresnel_complex(0.5f, material.eta.z, material.k.z));
        return hyk_set_metal(r, material, hyk_metal_mean(material, mean));
    }
    return hyk_set_energy(view, r, material, features);
}

#endif /* HYK_BSDF_LAYERS_H */

/* >>shared-bsdf-lobes: values and densities of the lobes, for a pair of directions */
#ifndef HYK_BSDF_LOBES_H
#define HYK_BSDF_LOBES_H

/* f cos, split, and the density of hyk_bsdf_sample_direction; delta functions excluded. */
HYK_STRUCT(hyk_bsdf_value) {
    hyk_vec3 diffuse;
    hyk_real pdf;
    hyk_vec3 specular;
    hyk_real unused;
} HYK_END(hyk_bsdf_value)

/* Probabilities of the lobes. */
HYK_STRUCT(hyk_lobe_shares) {
    hyk_real coat;          /* rough coat */
    hyk_real facets;        /* visible normals of the base: reflection and transmission */
    hyk_real diffuse;       /* Lambert */
    hyk_real bounce;        /* lost by masking, reflected */
    hyk_real through;       /* lost by masking, transmitted */
    hyk_real mirror;        /* delta reflection of coat and base */
    hyk_real window;        /* delta transmission */
    hyk_real total;         /* before normalisation: about the albedo; 0: absorbs everything */
} HYK_END(hyk_lobe_shares)

HYK_FN hyk_bsdf_value hyk_no_value(void) {
    hyk_bsdf_value r;
    r.diffuse = hyk_zero3();
    r.pdf = 0.0f;
    r.specular = hyk_zero3();
    r.unused = 0.0f;
    return r;
}

/* Weight of the coat over what lies under it: seen from inside the glass it covers only the opaque bases. */
HYK_FN hyk_real hyk_coat_weight(hyk_bsdf bsdf) {
    return hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? bsdf.coat * (bsdf.metal + bsdf.plastic) : bsdf.coat;
}

/* Brightness of a metal's single scattering. */
HYK_FN hyk_real hyk_metal_back(hyk_bsdf bsdf, hyk_layers l) {
    hyk_real rest = hyk_max(l.pass - l.metal_lost - l.schlick, 0.0f);
    return l.schlick + hyk_max3(bsdf.f0) * rest;
}

HYK_FN hyk_lobe_shares hyk_shares_of_glass(hyk_bsdf bsdf, hyk_layers l, hyk_lobe_shares q) {
    hyk_real tint = hyk_max3(bsdf.base_color);
    hyk_bool sheet = hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    hyk_real back = sheet ? hyk_plastic_back(bsdf, l) : l.glass_back;
    hyk_real along = (sheet ? hyk_sheet_along(bsdf, l) : l.glass_along) * tint;
    if (hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) {
        q.mirror += bsdf.glass * back;
        q.window += bsdf.glass * along;
    } else
        q.facets += bsdf.glass * (back + along);
    hyk_real lost = sheet ? l.metal_lost : l.glass_lost;
    hyk_real split = sheet ? 1.0f - bsdf.plastic_bounce : bsdf.glass_split;
    q.bounce += bsdf.glass * lost * (1.0f - split);
    q.through += bsdf.glass * lost * split * tint;
    return q;
}

/* Chosen in proportion to the albedos of the lobes at wo. */
HYK_FN hyk_lobe_shares hyk_lobe_shares_of(hyk_bsdf bsdf, hyk_layers l, hyk_uint features) {
    hyk_lobe_shares q;
    hyk_real coat = (1.0f - l.pass) * (hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? bsdf.metal + bsdf.plastic : 1.0f);
    hyk_real opaque = bsdf.metal * hyk_metal_back(bsdf, l) + bsdf.plastic * hyk_plastic_back(bsdf, l);
    hyk_bool coat_smooth = hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH), base_smooth = hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH);
    q.coat = coat_smooth ? 0.0f : coat;
    q.mirror = (coat_smooth ? coat : 0.0f) + (base_smooth ? opaque : 0.0f);
    q.facets = base_smooth ? 0.0f : opaque;
    q.diffuse = bsdf.plastic * l.diffuse * hyk_max3(bsdf.base_color);
    q.bounce = l.metal_lost * (bsdf.metal * hyk_max3(bsdf.bounce) + bsdf.plastic * bsdf.plastic_bounce);
    q.through = 0.0f;
    q.window = 0.0f;
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) q = hyk_shares_of_glass(bsdf, l, q);
    q.total = q.coat + q.facets + q.diffuse + q.bounce + q.through + q.mirror + q.window;
    hyk_real scale = q.total > 0.0f ? 1.0f / q.total : 0.0f;
    q.coat *= scale;
    q.facets *= scale;
    q.diffuse *= scale;
    q.bounce *= scale;
    q.through *= scale;
    q.mirror *= scale;
    q.window *= scale;
    return q;
}

/* Probability that a visible facet at cos_h reflects, where some of the base is clear. */
HYK_FN hyk_real hyk_facet_reflects(hyk_bsdf bsdf, hyk_real cos_h, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return 1.0f;
    if (!(bsdf.glass > 0.0f) || hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return 1.0f;
    hyk_real f = hyk_fresnel_dielectric(cos_h, bsdf.glass_eta);
    hyk_real w = hyk_schlick_weight(cos_h);
    hyk_real back = bsdf.glass * f + bsdf.metal * hyk_lerp(hyk_max3(bsdf.f0), 1.0f, w);
    if (bsdf.plastic > 0.0f) back += bsdf.plastic * hyk_fresnel_dielectric(cos_h, bsdf.ior);
    hyk_real along = bsdf.glass * (1.0f - f) * hyk_max3(bsdf.base_color);
    return back + along > 0.0f ? back / (back + along) : 1.0f;
}

/* What facets at cos_h reflect, pass: of the pair through the coat. */
HYK_FN hyk_vec3 hyk_facet_color(hyk_view view, hyk_bsdf bsdf, hyk_real cos_h, hyk_real pass, hyk_bool smooth_parts, hyk_uint features) {
    hyk_vec3 r = hyk_zero3();
    hyk_real grey = 0.0f;
    if (smooth_parts == hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH)) {
        if (bsdf.metal > 0.0f) r = hyk_scale(hyk_metal_fresnel(bsdf, cos_h), bsdf.metal * pass);
        if (bsdf.plastic > 0.0f) grey = bsdf.plastic * pass * hyk_fresnel_dielectric(cos_h, bsdf.ior);
    }
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f && smooth_parts == hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH))
        grey += bsdf.glass * hyk_glass_facet_reflects(view, bsdf, cos_h, pass);
    return hyk_add(r, hyk_splat(grey));
}

/* ---- reflection */

HYK_FN hyk_bsdf_value hyk_add_coat(hyk_bsdf_value r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_vec3 h, hyk_lobe_shares q) {
    hyk_real d = hyk_ggx_distribution(h, bsdf.coat_alpha);
    hyk_real f = hyk_coat_weight(bsdf) * hyk_fresnel_dielectric(hyk_dot(wo, h), HYK_COAT_IOR);
    r.specular = hyk_add(r.specular, hyk_splat(f * d * hyk_ggx_visibility(wo, wi, bsdf.coat_alpha)));
    r.pdf += q.coat * hyk_ggx_pdf_reflected(wo, d, bsdf.coat_alpha);
    return r;
}

/* The product lobes: Lambert base and further bounces. */
HYK_FN hyk_bsdf_value hyk_add_left_over(hyk_bsdf_value r, hyk_bsdf bsdf, hyk_real cos_i, hyk_layers o, hyk_layers i, hyk_lobe_shares q,
                                        hyk_uint features) {
    hyk_real diffuse = bsdf.plastic * o.diffuse * i.diffuse * bsdf.plastic_scale * cos_i;
    r.diffuse = hyk_scale(bsdf.base_color, diffuse);
    hyk_real lost = o.metal_lost * i.metal_lost * bsdf.metal_scale * cos_i;
    hyk_real grey = bsdf.plastic * bsdf.plastic_bounce * lost;
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) {
        if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) grey += bsdf.glass * bsdf.plastic_bounce * lost;
        else grey += bsdf.glass * bsdf.glass_reflect * o.glass_lost * i.glass_lost * cos_i;
    }
    r.specular = hyk_add(r.specular, hyk_add_scaled(hyk_splat(grey), bsdf.bounce, bsdf.metal * lost));
    r.pdf += q.diffuse * hyk_pdf_cosine_hemisphere(cos_i);
    if (q.bounce > 0.0f) r.pdf += q.bounce * hyk_lost_pdf(cos_i, bsdf.alpha);
    return r;
}

HYK_FN hyk_bsdf_value hyk_eval_reflected(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_value r = hyk_no_value();
    hyk_layers i = hyk_layers_at(view, bsdf, wi.z, features);
    hyk_vec3 h = hyk_half_reflected(wo, wi);
    if (q.facets > 0.0f) {
        hyk_real cos_h = hyk_dot(wo, h);
        hyk_real d = hyk_ggx_distribution(h, bsdf.alpha);
        hyk_vec3 color = hyk_facet_color(view, bsdf, cos_h, hyk_min(o.pass, i.pass), false, features);
        r.specular = hyk_scale(color, d * hyk_ggx_visibility(wo, wi, bsdf.alpha));
        r.pdf = q.facets * hyk_facet_reflects(bsdf, cos_h, features) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    }
    if (q.coat > 0.0f) r = hyk_add_coat(r, bsdf, wo, wi, h, q);
    return hyk_add_left_over(r, bsdf, wi.z, o, i, q, features);
}

/* ---- transmission */

/* A thin sheet: the reflection of the direction mirrored back through it (KHR_materials_transmission). */
HYK_FN hyk_bsdf_value hyk_eval_sheet(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_value r = hyk_no_value();
    hyk_vec3 mirrored = hyk_make3(wi.x, wi.y, -wi.z);
    hyk_layers i = hyk_layers_at(view, bsdf, mirrored.z, features);
    hyk_real value = (1.0f - bsdf.plastic_bounce) * o.metal_lost * i.metal_lost * bsdf.metal_scale * mirrored.z;
    if (!hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) {
        hyk_vec3 h = hyk_half_reflected(wo, mirrored);
        hyk_real cos_h = hyk_dot(wo, h);
        hyk_real d = hyk_ggx_distribution(h, bsdf.alpha);
        hyk_real t = (1.0f - hyk_fresnel_dielectric(cos_h, bsdf.ior)) * hyk_min(o.pass, i.pass);
        value += t * d * hyk_ggx_visibility(wo, mirrored, bsdf.alpha);
        r.pdf = q.facets * (1.0f - hyk_facet_reflects(bsdf, cos_h, features)) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    }
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * value);
    if (q.through > 0.0f) r.pdf += q.through * hyk_lost_pdf(mirrored.z, bsdf.alpha);
    return r;
}

/* Walter et al. 2007, eq. 21, times cos wi; radiance comes in with (n_o / n_i)^2 = 1 / glass_eta^2. */
HYK_FN hyk_bsdf_value hyk_add_refracted(hyk_bsdf_value r, hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_lobe_shares q,
                                        hyk_uint features) {
    hyk_vec3 h = hyk_half_refracted(wo, wi, bsdf.glass_eta);
    hyk_real cos_h = hyk_dot(wo, h);
    hyk_real g = bsdf.glass_eta * -hyk_dot(wi, h); /* not from cos_h: the same from both sides, and near total reflection sharp */
    if (!(cos_h > 0.0f) || !(g > 0.0f)) return r;
    hyk_real d = hyk_ggx_distribution(h, bsdf.alpha) * hyk_refraction_jacobian(cos_h, g, bsdf.glass_eta);
    hyk_real cos_outside = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? -wi.z : wo.z;
    hyk_real t = hyk_glass_facet_passes(view, bsdf, cos_h, g, cos_outside) * d * hyk_ggx_visibility(wo, wi, bsdf.alpha);
    r.specular = hyk_add_scaled(r.specular, bsdf.base_color, bsdf.glass * t / (bsdf.glass_eta * bsdf.glass_eta));
    r.pdf += q.facets * (1.0f - hyk_facet_reflects(bsdf, cos_h, features)) * hyk_ggx_pdf_reflected(wo, d, bsdf.alpha);
    return r;
}

HYK_FN hyk_bsdf_value hyk_eval_transmitted(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q,
                                           hyk_uint features) {
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) return hyk_eval_sheet(view, bsdf, wo, wi, o, q, features);
    hyk_bsdf_value r = hyk_no_value();
    if (hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return r;
    hyk_real lost = o.glass_lost * hyk_glass_lost_beyond(view, bsdf, -wi.z) * bsdf.glass_through;
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * lost * -wi.z);
    if (q.through > 0.0f) r.pdf = q.through * hyk_lost_pdf(wi.z, bsdf.alpha);
    return hyk_add_refracted(r, view, bsdf, wo, wi, q, features);
}

#endif /* HYK_BSDF_LOBES_H */

/* >>shared-bsdf: evaluates and samples a surface's scattering

   Local frame, z the shading normal on wo's side. Values are f |cos wi|, radiance transport: across a
   refracting surface they carry (n_o / n_i)^2. Without HYK_NEEDS_SPECULAR only Lambert is left. */
#ifndef HYK_BSDF_H
#define HYK_BSDF_H

#define HYK_LOBE_DIFFUSE 0x1u
#define HYK_LOBE_GLOSSY 0x2u
#define HYK_LOBE_DELTA 0x4u
#define HYK_LOBE_TRANSMIT 0x8u

/* flags 0 and pdf 0: no direction. Not delta: diffuse + specular is the whole value over the whole density.
   Delta: pdf is the probability of the choice, specular the weight over it. */
HYK_STRUCT(hyk_bsdf_sample) {
    hyk_vec3 wi;
    hyk_real pdf;
    hyk_vec3 diffuse;
    hyk_real u_left; /* what is still uniform of u_lobe */
    hyk_vec3 specular;
    hyk_uint flags;
} HYK_END(hyk_bsdf_sample)

HYK_FN hyk_bool hyk_bsdf_has_diffuse(hyk_bsdf bsdf) {
    return (hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT) || bsdf.plastic > 0.0f) && !hyk_is_black(bsdf.base_color);
}
HYK_FN hyk_bool hyk_bsdf_transmits(hyk_bsdf bsdf) { return bsdf.glass > 0.0f && !hyk_is_black(bsdf.base_color); }

HYK_FN hyk_bool hyk_bsdf_is_delta_only(hyk_bsdf bsdf) {
    if (hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT) || hyk_bsdf_has_diffuse(bsdf)) return false;
    if (bsdf.metal + bsdf.plastic > 0.0f && !hyk_bsdf_is(bsdf, HYK_BSDF_SMOOTH)) return false;
    if (bsdf.glass > 0.0f && !hyk_bsdf_is(bsdf, HYK_BSDF_GLASS_SMOOTH)) return false;
    return !(bsdf.coat > 0.0f) || hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH);
}

HYK_FN hyk_bool hyk_bsdf_only_lambert(hyk_bsdf bsdf, hyk_uint features) {
    return !HYK_HAS(features, HYK_NEEDS_SPECULAR) || hyk_bsdf_is(bsdf, HYK_BSDF_LAMBERT);
}

HYK_FN hyk_bsdf_value hyk_eval_lambert(hyk_bsdf bsdf, hyk_real cos_i) {
    hyk_bsdf_value r = hyk_no_value();
    r.pdf = hyk_pdf_cosine_hemisphere(cos_i);
    r.diffuse = hyk_scale(bsdf.base_color, r.pdf);
    return r;
}

/* Of a pair, with what is known of wo already. */
HYK_FN hyk_bsdf_value hyk_eval_pair(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_layers o, hyk_lobe_shares q, hyk_uint features) {
    if (wi.z > 0.0f) return hyk_eval_reflected(view, bsdf, wo, wi, o, q, features);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && wi.z < 0.0f && bsdf.glass > 0.0f)
        return hyk_eval_transmitted(view, bsdf, wo, wi, o, q, features);
    return hyk_no_value();
}

HYK_CALLED hyk_bsdf_value hyk_eval_layers(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_uint features) {
    hyk_layers o = hyk_layers_at(view, bsdf, wo.z, features);
    return hyk_eval_pair(view, bsdf, wo, wi, o, hyk_lobe_shares_of(bsdf, o, features), features);
}

HYK_FN hyk_bsdf_value hyk_bsdf_eval(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec3 wi, hyk_uint features) {
    if (!(wo.z > 0.0f)) return hyk_no_value();
    if (hyk_bsdf_only_lambert(bsdf, features)) return hyk_eval_lambert(bsdf, wi.z);
    return hyk_eval_layers(view, bsdf, wo, wi, features);
}

/* ---- sampling */

HYK_FN hyk_bsdf_sample hyk_no_sample(hyk_real u_lobe) {
    hyk_bsdf_sample r;
    r.wi = hyk_make3(0.0f, 0.0f, 1.0f);
    r.pdf = 0.0f;
    r.diffuse = hyk_zero3();
    r.u_left = u_lobe;
    r.specular = hyk_zero3();
    r.flags = 0u;
    return r;
}

HYK_FN hyk_bsdf_sample hyk_sample_lambert(hyk_bsdf bsdf, hyk_real u_lobe, hyk_vec2 u) {
    hyk_bsdf_sample r = hyk_no_sample(u_lobe);
    r.wi = hyk_sample_cosine_hemisphere(u);
    r.pdf = hyk_pdf_cosine_hemisphere(r.wi.z);
    r.diffuse = bsdf.base_color;
    r.flags = HYK_LOBE_DIFFUSE;
    return r;
}

/* Delta reflection: coat and smooth bases share its direction. */
HYK_FN hyk_bsdf_sample hyk_sample_mirror(hyk_view view, hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_layers o, hyk_real chance,
                                         hyk_uint features) {
    r.wi = hyk_make3(-wo.x, -wo.y, wo.z);
    r.pdf = chance;
    r.specular = hyk_facet_color(view, bsdf, wo.z, o.pass, true, features);
    if (hyk_bsdf_is(bsdf, HYK_BSDF_COAT_SMOOTH))
        r.specular = hyk_add(r.specular, hyk_splat(hyk_coat_weight(bsdf) * hyk_fresnel_dielectric(wo.z, HYK_COAT_IOR)));
    r.specular = hyk_scale(r.specular, 1.0f / chance);
    r.flags = HYK_LOBE_DELTA;
    return r;
}

/* Delta transmission, straight through a thin sheet or refracted. */
HYK_FN hyk_bsdf_sample hyk_sample_window(hyk_view view, hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_layers o, hyk_real chance) {
    hyk_real t;
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) {
        r.wi = hyk_neg(wo);
        t = o.diffuse;
    } else {
        hyk_real g = hyk_refracted_cosine(wo.z, bsdf.glass_eta);
        if (!(g > 0.0f)) return r;
        r.wi = hyk_refract(wo, hyk_make3(0.0f, 0.0f, 1.0f), wo.z, g, bsdf.glass_eta);
        hyk_real cos_outside = hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? -r.wi.z : wo.z;
        t = hyk_glass_facet_passes(view, bsdf, wo.z, g, cos_outside) / (bsdf.glass_eta * bsdf.glass_eta);
    }
    r.pdf = chance;
    r.specular = hyk_scale(bsdf.base_color, bsdf.glass * t / chance);
    r.flags = HYK_LOBE_DELTA | HYK_LOBE_TRANSMIT;
    return r;
}

/* Reflection or transmission at a visible facet: direction and flags; flags stay 0 where it leaves on the
   wrong side. */
HYK_FN hyk_bsdf_sample hyk_sample_facet(hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec2 u, hyk_uint features) {
    hyk_vec3 h = hyk_ggx_sample(wo, bsdf.alpha, u);
    hyk_real cos_h = hyk_dot(wo, h);
    if (!(cos_h > 0.0f)) return r;
    hyk_real reflects = hyk_facet_reflects(bsdf, cos_h, features);
    hyk_bool back = r.u_left < reflects;
    r.u_left = back ? hyk_respread(r.u_left, 0.0f, reflects) : hyk_respread(r.u_left, reflects, 1.0f - reflects);
    r.wi = hyk_reflect(wo, h, cos_h);
    if (back) {
        if (r.wi.z > 0.0f) r.flags = HYK_LOBE_GLOSSY;
        return r;
    }
    if (hyk_bsdf_is(bsdf, HYK_BSDF_THIN)) r.wi.z = -r.wi.z;
    else {
        hyk_real g = hyk_refracted_cosine(cos_h, bsdf.glass_eta);
        if (!(g > 0.0f)) return r;
        r.wi = hyk_refract(wo, h, cos_h, g, bsdf.glass_eta);
    }
    if (r.wi.z < 0.0f) r.flags = HYK_LOBE_GLOSSY | HYK_LOBE_TRANSMIT;
    return r;
}

HYK_FN hyk_bsdf_sample hyk_sample_coat(hyk_bsdf_sample r, hyk_bsdf bsdf, hyk_vec3 wo, hyk_vec2 u) {
    hyk_vec3 h = hyk_ggx_sample(wo, bsdf.coat_alpha, u);
    r.wi = hyk_reflect(wo, h, hyk_dot(wo, h));
    if (r.wi.z > 0.0f) r.flags = HYK_LOBE_GLOSSY;
    return r;
}

/* Chooses a lobe and in it a direction: wi, flags and u_left; delta lobes are complete. */
HYK_FN hyk_bsdf_sample hyk_sample_lobe(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_layers o,
                                       hyk_lobe_shares q, hyk_uint features) {
    hyk_bsdf_sample r = hyk_no_sample(u_lobe);
    hyk_real lo = 0.0f;
    /* the shares add up to 1 but for rounding: no number lies beyond the last of them */
    u_lobe = hyk_min(u_lobe, (q.facets + q.diffuse + q.mirror + q.coat + q.bounce + q.through + q.window) * HYK_BELOW_ONE);
    if (u_lobe < lo + q.facets) {
        r.u_left = hyk_respread(u_lobe, lo, q.facets);
        return hyk_sample_facet(r, bsdf, wo, u, features);
    }
    lo += q.facets;
    if (u_lobe < lo + q.diffuse) {
        r.u_left = hyk_respread(u_lobe, lo, q.diffuse);
        r.wi = hyk_sample_cosine_hemisphere(u);
        r.flags = HYK_LOBE_DIFFUSE;
        return r;
    }
    lo += q.diffuse;
    if (u_lobe < lo + q.mirror) {
        r.u_left = hyk_respread(u_lobe, lo, q.mirror);
        return hyk_sample_mirror(view, r, bsdf, wo, o, q.mirror, features);
    }
    lo += q.mirror;
    if (u_lobe < lo + q.coat) {
        r.u_left = hyk_respread(u_lobe, lo, q.coat);
        return hyk_sample_coat(r, bsdf, wo, u);
    }
    lo += q.coat;
    if (u_lobe < lo + q.bounce) {
        r.u_left = hyk_respread(u_lobe, lo, q.bounce);
        r.wi = hyk_lost_sample(bsdf.alpha, u);
        r.flags = HYK_LOBE_GLOSSY;
        return r;
    }
    lo += q.bounce;
    if (!HYK_HAS(features, HYK_NEEDS_TRANSMISSION)) return r;
    if (q.through > 0.0f && (u_lobe < lo + q.through || !(q.window > 0.0f))) {
        r.u_left = hyk_respread(u_lobe, lo, q.through);
        r.wi = hyk_neg(hyk_lost_sample(bsdf.alpha, u));
        r.flags = HYK_LOBE_GLOSSY | HYK_LOBE_TRANSMIT;
        return r;
    }
    if (!(q.window > 0.0f)) return r;
    r.u_left = hyk_respread(u_lobe, lo + q.through, q.window);
    return hyk_sample_window(view, r, bsdf, wo, o, q.window);
}

HYK_CALLED hyk_bsdf_sample hyk_sample_layers(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_uint features) {
    hyk_layers o = hyk_layers_at(view, bsdf, wo.z, features);
    hyk_lobe_shares q = hyk_lobe_shares_of(bsdf, o, features);
    if (!(q.total > 0.0f)) return hyk_no_sample(u_lobe);
    hyk_bsdf_sample r = hyk_sample_lobe(view, bsdf, wo, u_lobe, u, o, q, features);
    if (r.flags == 0u || (r.flags & HYK_LOBE_DELTA) != 0u) return r;
    hyk_bsdf_value value = hyk_eval_pair(view, bsdf, wo, r.wi, o, q, features);
    if (!(value.pdf > 0.0f)) return hyk_no_sample(r.u_left);
    r.pdf = value.pdf;
    r.diffuse = hyk_scale(value.diffuse, 1.0f / value.pdf);
    r.specular = hyk_scale(value.specular, 1.0f / value.pdf);
    return r;
}

HYK_FN hyk_bsdf_sample hyk_bsdf_sample_direction(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_real u_lobe, hyk_vec2 u, hyk_uint features) {
    if (!(wo.z > 0.0f)) return hyk_no_sample(u_lobe);
    if (hyk_bsdf_only_lambert(bsdf, features)) return hyk_sample_lambert(bsdf, u_lobe, u);
    return hyk_sample_layers(view, bsdf, wo, u_lobe, u, features);
}

/* ---- albedo */

HYK_FN hyk_vec3 hyk_glass_albedo(hyk_bsdf bsdf, hyk_layers o) {
    hyk_bool sheet = hyk_bsdf_is(bsdf, HYK_BSDF_THIN);
    hyk_real back = o.glass_back + (1.0f - bsdf.glass_split) * o.glass_lost;
    hyk_real along = o.glass_along + bsdf.glass_split * o.glass_lost;
    if (sheet) {
        back = o.pass - o.diffuse;
        along = o.diffuse;
    }
    return hyk_add_scaled(hyk_splat(back), bsdf.base_color, along);
}

/* Share of the light along wo that is reflected or transmitted (power: without the n^2 of radiance). */
HYK_CALLED hyk_vec3 hyk_bsdf_albedo(hyk_view view, hyk_bsdf bsdf, hyk_vec3 wo, hyk_uint features) {
    if (hyk_bsdf_only_lambert(bsdf, features)) return bsdf.base_color;
    hyk_layers o = hyk_layers_at(view, bsdf, hyk_max(wo.z, 0.0f), features);
    hyk_real rest = hyk_max(o.pass - o.metal_lost - o.schlick, 0.0f);
    hyk_vec3 metal = hyk_add_scaled(hyk_splat(o.schlick), bsdf.f0, rest);
    metal = hyk_add_scaled(metal, bsdf.bounce, o.metal_lost);
    hyk_vec3 r = hyk_scale(metal, bsdf.metal);
    hyk_real opaque = bsdf.metal + bsdf.plastic;
    hyk_real coat = (1.0f - o.pass) * (hyk_bsdf_is(bsdf, HYK_BSDF_INSIDE) ? opaque : 1.0f);
    r = hyk_add(r, hyk_splat(coat + bsdf.plastic * (o.pass - o.diffuse)));
    r = hyk_add_scaled(r, bsdf.base_color, bsdf.plastic * o.diffuse);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && bsdf.glass > 0.0f) r = hyk_add_scaled(r, hyk_glass_albedo(bsdf, o), bsdf.glass);
    return r;
}

#endif /* HYK_BSDF_H */

/* >>shared-surface-light: points on rectangles, discs, spheres and triangles, in proportion to solid angle

   Everything is relative to the point p that is lit, in units of the light's distance, and built from the
   light's own edges, not from differences of unit vectors: small, distant and grazing lights keep their
   relative precision and no square leaves the range. */
#ifndef HYK_SURFACE_LIGHT_H
#define HYK_SURFACE_LIGHT_H

/* Solid angles below this are beyond float: densities end there. */
#define HYK_LEAST_SOLID_ANGLE HYK_C(1e-36)

HYK_STRUCT(hyk_surface_sample) {
    hyk_vec3 offset;  /* from p to the point on the light */
    hyk_real pdf;     /* per steradian; 0: the light cannot be seen from p */
    hyk_vec3 normal;  /* front */
    hyk_real unused;
    hyk_vec2 weights; /* TRIANGLE: of vertex 1 and vertex 2 */
} HYK_END(hyk_surface_sample)

/* ---- spherical triangles */

/* A triangle seen from the origin: vertex a and the edges to b and c. volume: distance of its plane times its
   double area, that is |a . (b x c)|, handed in because the caller knows it without cancellation. */
HYK_STRUCT(hyk_view_triangle) {
    hyk_vec3 a;
    hyk_real volume;
    hyk_vec3 ab;
    hyk_real solid_angle;
    hyk_vec3 ac;
    hyk_real unused;
} HYK_END(hyk_view_triangle)

/* Van Oosterom & Strackee 1983. */
HYK_FN hyk_view_triangle hyk_view_of_triangle(hyk_vec3 a, hyk_vec3 ab, hyk_vec3 ac, hyk_real volume) {
    hyk_view_triangle t;
    t.a = a;
    t.ab = ab;
    t.ac = ac;
    t.volume = volume;
    hyk_vec3 b = hyk_add(a, ab), c = hyk_add(a, ac);
    hyk_real la = hyk_sqrt(hyk_dot(a, a)), lb = hyk_sqrt(hyk_dot(b, b)), lc = hyk_sqrt(hyk_dot(c, c));
    hyk_real low = la * lb * lc + hyk_dot(a, b) * lc + hyk_dot(a, c) * lb + hyk_dot(b, c) * la;
    t.solid_angle = volume > 0.0f ? 2.0f * hyk_atan2(volume, low) : 0.0f;
    return t;
}

/* Tangent of half the angle between two vectors, from their lengths' product, cross product's length and dot. */
HYK_FN hyk_real hyk_tan_half(hyk_real lengths, hyk_real across, hyk_real along) {
    return along > 0.0f ? across / (lengths + along) : (lengths - along) / hyk_max(across, HYK_C(1e-37));
}

/* From the end of vector a along edge e: which part of the edge lies under an angle whose half has this
   tangent. The edge is resolved into parts along a and across it. */
HYK_FN hyk_real hyk_edge_part(hyk_vec3 a, hyk_vec3 e, hyk_real tan_half) {
    hyk_real length_a = hyk_sqrt(hyk_dot(a, a));
    hyk_vec3 normal = hyk_cross(a, e);
    hyk_real across = hyk_sqrt(hyk_dot(normal, normal)), along = hyk_dot(a, e);
    hyk_real low = across * (1.0f - tan_half) * (1.0f + tan_half) - 2.0f * tan_half * along;
    hyk_real high = 2.0f * tan_half * length_a * length_a;
    return low > high ? hyk_max(high / low, 0.0f) : 1.0f;
}

/* Arvo 1995, "Stratified sampling of spherical triangles", with the sub-triangle's side found from
   tan(E/2) = t t' sin(alpha) / (1 + t t' cos(alpha)), t and t' the tangents of its half sides: no inverse
   cosine, and small triangles lose nothing. Returns the weights of b and c. */
HYK_FN hyk_vec2 hyk_sample_view_triangle(hyk_view_triangle t, hyk_vec2 u) {
    hyk_vec3 b = hyk_add(t.a, t.ab);
    hyk_vec3 n_ab = hyk_cross(t.a, t.ab), n_ac = hyk_cross(t.a, t.ac);
    hyk_real length_a = hyk_sqrt(hyk_dot(t.a, t.a)), length_b = hyk_sqrt(hyk_dot(b, b));
    /* angle at a, up to a common factor: both parts keep their relative precision */
    hyk_real sin_alpha = length_a * t.volume, cos_alpha = hyk_dot(n_ab, n_ac);
    hyk_real norm = hyk_max(hyk_max(hyk_abs(sin_alpha), hyk_abs(cos_alpha)), HYK_C(1e-37));
    sin_alpha /= norm;
    cos_alpha /= norm;
    hyk_real unit = 1.0f / hyk_sqrt(sin_alpha * sin_alpha + cos_alpha * cos_alpha);
    hyk_real half_excess = 0.5f * u.x * t.solid_angle;
    hyk_real se = hyk_sin(half_excess), ce = hyk_cos(half_excess);
    hyk_real tan_ab = hyk_tan_half(length_a * length_b, hyk_sqrt(hyk_dot(n_ab, n_ab)), hyk_dot(t.a, b));
    hyk_real low = tan_ab * unit * (sin_alpha * ce - cos_alpha * se);
    hyk_real part = low > 0.0f ? hyk_edge_part(t.a, t.ac, hyk_min(se / low, HYK_C(1e18))) : 1.0f;
    /* on the arc from b to the point q of edge ac, uniformly in the cosine of the angle at b */
    hyk_vec3 bq = hyk_sub(hyk_scale(t.ac, part), t.ab), q = hyk_add_scaled(t.a, t.ac, part);
    hyk_vec3 n_bq = hyk_cross(b, bq);
    hyk_real across = hyk_sqrt(hyk_dot(n_bq, n_bq));
    hyk_real tan_bq = hyk_min(hyk_tan_half(length_b * hyk_sqrt(hyk_dot(q, q)), across, hyk_dot(b, q)), HYK_C(1e18));
    hyk_real one_minus_cos = u.y * 2.0f * tan_bq * tan_bq / (1.0f + tan_bq * tan_bq);
    hyk_real r = hyk_edge_part(b, bq, hyk_sqrt(one_minus_cos / (2.0f - one_minus_cos)));
    return hyk_make2(1.0f - r, r * part);
}

/* ---- rectangles: two spherical triangles, which, unlike spherical rectangles, need no right angles and do
   not subtract 2 pi from a sum of angles */

/* A light as two triangles around its lower left corner; TRIANGLE: the second has no solid angle. */
HYK_STRUCT(hyk_view_sheet) {
    hyk_view_triangle first, second;
    hyk_real unit;
} HYK_END(hyk_view_sheet)

HYK_FN hyk_bool hyk_light_shows_back(hyk_light light) { return (light.flags & HYK_LIGHT_BOTH_SIDES) != 0u; }

HYK_FN hyk_view_sheet hyk_view_of_sheet(hyk_light light, hyk_vec3 p) {
    hyk_bool rect = light.kind == HYK_LIGHT_RECT;
    hyk_vec3 corner = hyk_sub(light.position, p);
    hyk_vec3 e = light.axis_u, f = light.axis_v;
    if (rect) {
        corner = hyk_sub(hyk_sub(corner, e), f);
        e = hyk_scale(e, 2.0f);
        f = hyk_scale(f, 2.0f);
    }
    hyk_view_sheet s;
    s.unit = hyk_max(hyk_max3(hyk_abs3(corner)), hyk_max(hyk_max3(hyk_abs3(e)), hyk_max3(hyk_abs3(f))));
    hyk_real shrink = 1.0f / s.unit;
    hyk_vec3 a = hyk_scale(corner, shrink);
    e = hyk_scale(e, shrink);
    f = hyk_scale(f, shrink);
    /* the plane's distance from the centre, which is exact for p near the middle of a large sheet */
    hyk_real height = hyk_dot(light.normal, hyk_scale(hyk_sub(p, light.position), shrink));
    if (hyk_light_shows_back(light)) height = hyk_abs(height);
    hyk_vec3 area = hyk_cross(e, f);
    hyk_real volume = height * hyk_sqrt(hyk_dot(area, area));
    s.first = hyk_view_of_triangle(a, e, f, volume);
    s.second = s.first;
    if (rect) s.second = hyk_view_of_triangle(hyk_add(hyk_add(a, e), f), hyk_neg(e), hyk_neg(f), volume);
    else s.second.solid_angle = 0.0f;
    return s;
}

HYK_FN hyk_real hyk_sheet_pdf(hyk_view_sheet s) {
    hyk_real solid_angle = s.first.solid_angle + s.second.solid_angle;
    return solid_angle > HYK_LEAST_SOLID_ANGLE ? 1.0f / solid_angle : 0.0f;
}

HYK_FN hyk_surface_sample hyk_sample_sheet(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_view_sheet s = hyk_view_of_sheet(light, p);
    hyk_surface_sample r;
    r.offset = hyk_zero3();
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = hyk_sheet_pdf(s);
    if (r.pdf == 0.0f) return r;
    hyk_real share = s.first.solid_angle * r.pdf;
    hyk_view_triangle t = s.first;
    if (u.x < share || !(s.second.solid_angle > 0.0f)) { /* share of a lone triangle is 1 but for rounding */
        u.x = hyk_respread(u.x, 0.0f, share);
    } else {
        t = s.second;
        u.x = hyk_respread(u.x, share, hyk_max(1.0f - share, HYK_REAL_EPSILON));
    }
    r.weights = hyk_sample_view_triangle(t, u);
    r.offset = hyk_scale(hyk_add(t.a, hyk_add(hyk_scale(t.ab, r.weights.x), hyk_scale(t.ac, r.weights.y))), s.unit);
    return r;
}

/* ---- disc

   In polar coordinates around the foot of the perpendicular from p: the angle phi of a uniform point of the
   disc, then the radius rho between the chord's ends rho0, rho1 uniformly in the cosine h / sqrt(rho^2 + h^2),
   that is uniformly in solid angle along the chord. The place of the uniform point between the chord's ends,
   (rho^2 - rho0^2) / (rho1^2 - rho0^2), is uniform and independent of phi, so it serves again. The density is
   s0 s1 (s0 + s1) / (2 pi R^2 h) with s = sqrt(rho^2 + h^2): bounded where the area's density s^3 / (pi R^2 h)
   varies without bound. With the foot inside, phi is also drawn uniformly with probability
   R^2 / (R^2 + h^2), density s1 (s1 + h) / (2 pi rho1^2), which is best near the disc. */

HYK_STRUCT(hyk_view_disc) {
    hyk_vec3 to_center; /* from the foot, in the plane; unit is R, or the distance where that is larger */
    hyk_real height;
    hyk_real radius, unit, uniform_share;
    hyk_bool inside;
} HYK_END(hyk_view_disc)

HYK_FN hyk_view_disc hyk_view_of_disc(hyk_light light, hyk_vec3 p) {
    hyk_vec3 to_center = hyk_sub(light.position, p);
    hyk_view_disc d;
    d.unit = hyk_max(hyk_max3(hyk_abs3(to_center)), light.radius);
    to_center = hyk_scale(to_center, 1.0f / d.unit);
    d.radius = light.radius / d.unit;
    hyk_real along = hyk_dot(to_center, light.normal);
    d.height = hyk_light_shows_back(light) ? hyk_abs(along) : -along;
    d.to_center = hyk_add_scaled(to_center, light.normal, -along);
    hyk_real r2 = d.radius * d.radius;
    d.inside = hyk_dot(d.to_center, d.to_center) < r2;
    d.uniform_share = d.inside ? r2 / (r2 + d.height * d.height) : 0.0f;
    return d;
}

/* Ends of the chord through the foot in a unit direction of the plane: rho0, rho1. */
HYK_FN hyk_vec2 hyk_disc_chord(hyk_view_disc d, hyk_vec3 direction) {
    hyk_real along = hyk_dot(d.to_center, direction);
    hyk_vec3 across = hyk_add_scaled(d.to_center, direction, -along);
    hyk_real aside = hyk_sqrt(hyk_dot(across, across));
    hyk_real half_chord = hyk_safe_sqrt((d.radius - aside) * (d.radius + aside));
    return hyk_make2(d.inside ? 0.0f : hyk_max(along - half_chord, 0.0f), hyk_max(along + half_chord, HYK_REAL_EPSILON * d.radius));
}

HYK_FN hyk_real hyk_disc_pdf(hyk_view_disc d, hyk_vec2 chord) {
    hyk_real h = d.height;
    if (!(h * d.radius * d.radius > HYK_LEAST_SOLID_ANGLE)) return 0.0f;
    hyk_real s0 = hyk_sqrt(chord.x * chord.x + h * h), s1 = hyk_sqrt(chord.y * chord.y + h * h);
    hyk_real by_area = s0 * s1 * (s0 + s1) / (HYK_TWO_PI * d.radius * d.radius * h);
    if (!d.inside) return by_area;
    return hyk_lerp(by_area, s1 * (s1 + h) / (HYK_TWO_PI * chord.y * chord.y), d.uniform_share);
}

HYK_FN hyk_surface_sample hyk_sample_disc_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_view_disc d = hyk_view_of_disc(light, p);
    hyk_frame frame = hyk_make_frame(light.normal);
    hyk_vec3 direction;
    hyk_vec2 chord;
    hyk_real place; /* along the chord */
    if (u.x < d.uniform_share) {
        hyk_real phi = HYK_TWO_PI * hyk_respread(u.x, 0.0f, d.uniform_share);
        direction = hyk_add(hyk_scale(frame.x, hyk_cos(phi)), hyk_scale(frame.y, hyk_sin(phi)));
        chord = hyk_disc_chord(d, direction);
        place = u.y;
    } else {
        u.x = hyk_respread(u.x, d.uniform_share, hyk_max(1.0f - d.uniform_share, HYK_REAL_EPSILON));
        hyk_vec2 q = hyk_sample_disc(u);
        hyk_vec3 point = hyk_add(d.to_center, hyk_scale(hyk_add(hyk_scale(frame.x, q.x), hyk_scale(frame.y, q.y)), d.radius));
        direction = hyk_dot(point, point) > 0.0f ? hyk_normalize(point) : frame.x;
        chord = hyk_disc_chord(d, direction);
        hyk_real rho = hyk_dot(point, direction);
        place = hyk_saturate((rho - chord.x) * (rho + chord.x) / hyk_max((chord.y - chord.x) * (chord.y + chord.x), HYK_C(1e-37)));
    }
    hyk_surface_sample r;
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = d.height > 0.0f ? hyk_disc_pdf(d, chord) : 0.0f;
    hyk_real h = d.height;
    hyk_real s0 = hyk_sqrt(chord.x * chord.x + h * h), s1 = hyk_sqrt(chord.y * chord.y + h * h);
    /* s between s0 and s1, uniform in 1 / s; rho^2 = rho0^2 + s^2 - s0^2. From afar s0 and s1 are nearly the same, so s - s0
       comes from the chord: s1 - s0 = (rho1^2 - rho0^2) / (s0 + s1) */
    hyk_real shrink = s0 / hyk_max(hyk_lerp(s1, s0, place), HYK_C(1e-37)), s = s1 * shrink;
    hyk_real beyond = shrink * place * ((chord.y - chord.x) * (chord.y + chord.x) / (s0 + s1));
    hyk_real rho = hyk_clamp(hyk_safe_sqrt(chord.x * chord.x + beyond * (s + s0)), chord.x, chord.y);
    hyk_real side = hyk_dot(hyk_sub(light.position, p), light.normal) < 0.0f ? -1.0f : 1.0f;
    r.offset = hyk_scale(hyk_add_scaled(hyk_scale(direction, rho), light.normal, side * h), d.unit);
    return r;
}

/* Density of a direction that hits the disc. */
HYK_FN hyk_real hyk_pdf_disc_light(hyk_light light, hyk_vec3 p, hyk_vec3 direction) {
    hyk_view_disc d = hyk_view_of_disc(light, p);
    if (!(d.height > 0.0f)) return 0.0f;
    hyk_vec3 in_plane = hyk_add_scaled(direction, light.normal, -hyk_dot(direction, light.normal));
    hyk_bool straight = !(hyk_dot(in_plane, in_plane) > 0.0f);
    in_plane = hyk_normalize(straight ? hyk_make_frame(light.normal).x : in_plane);
    return hyk_disc_pdf(d, hyk_disc_chord(d, in_plane));
}

/* ---- sphere: the cone it subtends */

/* 1 - cos of the cone's half angle; 0: p is not outside. */
HYK_FN hyk_real hyk_sphere_cap(hyk_real distance, hyk_real radius) {
    if (!(distance > radius)) return 0.0f;
    hyk_real sine = radius / distance;
    hyk_real cosine = hyk_sqrt((distance - radius) / distance * (1.0f + sine));
    return hyk_max(sine * sine / (1.0f + cosine), HYK_LEAST_SOLID_ANGLE);
}

HYK_FN hyk_surface_sample hyk_sample_sphere_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    hyk_vec3 to_center = hyk_sub(light.position, p);
    hyk_real distance = hyk_length(to_center);
    hyk_real cap = hyk_sphere_cap(distance, light.radius);
    hyk_surface_sample r;
    r.offset = to_center;
    r.normal = light.normal;
    r.unused = 0.0f;
    r.weights = hyk_make2(0.0f, 0.0f);
    r.pdf = 0.0f;
    if (cap == 0.0f) return r;
    r.pdf = hyk_pdf_cone(cap);
    hyk_frame frame = hyk_make_frame(hyk_scale(to_center, 1.0f / distance));
    hyk_vec3 local = hyk_sample_cone(cap, u);
    /* nearer root of the ray with the sphere, in units of the distance, without cancellation */
    hyk_real sine = light.radius / distance, sin_theta = hyk_sqrt(local.x * local.x + local.y * local.y);
    hyk_real share = hyk_min(sin_theta / sine, 1.0f);
    hyk_real half_chord = sine * hyk_safe_sqrt((1.0f - share) * (1.0f + share));
    hyk_real t = (distance - light.radius) / distance * (1.0f + sine) / (local.z + half_chord);
    /* the normal from its part across the axis, which is exact however far the sphere is */
    hyk_real across = t / sine;
    hyk_vec3 n = hyk_make3(across * local.x, across * local.y, 0.0f);
    n.z = -hyk_safe_sqrt(1.0f - n.x * n.x - n.y * n.y);
    r.normal = hyk_normalize(hyk_to_world(frame, n));
    r.offset = hyk_scale(hyk_to_world(frame, local), t * distance);
    return r;
}

/* ---- any of them */

HYK_FN hyk_surface_sample hyk_sample_surface_light(hyk_light light, hyk_vec3 p, hyk_vec2 u) {
    if (light.kind == HYK_LIGHT_SPHERE) return hyk_sample_sphere_light(light, p, u);
    if (light.kind == HYK_LIGHT_DISC) return hyk_sample_disc_light(light, p, u);
    return hyk_sample_sheet(light, p, u);
}

/* Density, per steradian, of a direction from p that hits the light. */
HYK_FN hyk_real hyk_pdf_surface_light(hyk_light light, hyk_vec3 p, hyk_vec3 direction) {
    if (light.kind == HYK_LIGHT_SPHERE) {
        hyk_real cap = hyk_sphere_cap(hyk_length(hyk_sub(light.position, p)), light.radius);
        return cap > 0.0f ? hyk_pdf_cone(cap) : 0.0f;
    }
    if (light.kind == HYK_LIGHT_DISC) return hyk_pdf_disc_light(light, p, direction);
    return hyk_sheet_pdf(hyk_view_of_sheet(light, p));
}

#endif /* HYK_SURFACE_LIGHT_H */

/* >>shared-emission: what a surface radiates at a texture coordinate */
#ifndef HYK_EMISSION_H
#define HYK_EMISSION_H

/* Radiance that leaves a side that emits; which sides do is for the caller to say. */
HYK_FN hyk_vec3 hyk_emission_at(hyk_view view, hyk_material material, hyk_vec2 uv, hyk_real lod, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_TEXTURES) || material.emission_texture == HYK_NONE) return material.emission;
    return hyk_mul(material.emission, hyk_sample_texture(view, material.emission_texture, uv, lod).rgb);
}

/* Emission of an emitting triangle at those weights, finest texture level; what alpha cuts out of it does not shine. */
HYK_FN hyk_vec3 hyk_triangle_emission(hyk_view view, hyk_uint instance, hyk_uint triangle, hyk_vec2 weights, hyk_uint features) {
    hyk_vec2 uv = hyk_triangle_uv(view, HYK_LOAD_INSTANCE(view, instance).mesh, triangle, weights);
    hyk_material material = HYK_LOAD_MATERIAL(view, hyk_triangle_material(view, instance, triangle));
    hyk_vec3 radiance = hyk_emission_at(view, material, uv, 0.0f, features);
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA) || !hyk_material_has_alpha(material)) return radiance;
    hyk_real alpha = hyk_alpha_at(view, material, uv);
    if ((material.flags & HYK_MATERIAL_ALPHA_MASK) != 0u) alpha = alpha >= material.alpha_cutoff ? 1.0f : 0.0f;
    return hyk_scale(radiance, hyk_saturate(alpha));
}

#endif /* HYK_EMISSION_H */

/* >>shared-environment: radiance from infinitely far, and directions in proportion to it

   A map is sampled over the cells between texel centres (light_layouts.h), in proportion to the bilinearly
   interpolated luminance itself: within a cell the density is the bilinear function of the longitude and of
   the share of the cell's solid angle above the point. So the density of a direction is luminance over
   environment_integral, to within the difference between latitude and that share; no tables are needed to
   tell it, and a pixel that is not black has a density. */
#ifndef HYK_ENVIRONMENT_H
#define HYK_ENVIRONMENT_H

/* A direction on the map: cell and place in it. */
HYK_STRUCT(hyk_map_place) {
    hyk_uint column, row; /* of the cell: 0..width-1, 0..height */
    hyk_real s, t;        /* along the row, down the column: 0..1 in texels */
} HYK_END(hyk_map_place)

/* Latitudes where a row of cells begins and ends, as angles from +Y in units of pi: rows at the poles are halves. */
HYK_FN hyk_vec2 hyk_map_row_range(hyk_uint row, hyk_uint height) {
    hyk_real h = HYK_TO_REAL(height);
    return hyk_make2(row == 0u ? 0.0f : (HYK_TO_REAL(row) - 0.5f) / h, row == height ? 1.0f : (HYK_TO_REAL(row) + 0.5f) / h);
}

/* The environment is turned by its rotation about +Y: what stood at -Z moves towards -X. */
HYK_FN hyk_map_place hyk_place_on_map(hyk_view view, hyk_vec3 direction) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    /* 0 - z, not -z: at a pole C would tell 0 from -0, devices do not */
    hyk_real turn = (hyk_atan2(direction.x, 0.0f - direction.z) + HYK_CONSTANTS(view).environment_rotation) * (0.5f * HYK_INV_PI) + 0.5f;
    hyk_real around = hyk_sqrt(direction.x * direction.x + direction.z * direction.z);
    /* acos(y), but precise at the poles */
    hyk_real v = hyk_atan2(around, direction.y) * HYK_INV_PI;
    hyk_real x = (turn - hyk_floor(turn)) * HYK_TO_REAL(width) + (HYK_TO_REAL(width) - 0.5f);
    hyk_real y = hyk_clamp(v, 0.0f, 1.0f) * HYK_TO_REAL(height) + 0.5f;
    hyk_uint column = HYK_TO_UINT(x);
    hyk_map_place place;
    place.row = hyk_min_uint(HYK_TO_UINT(y), height);
    place.s = x - HYK_TO_REAL(column);
    place.t = hyk_saturate(y - HYK_TO_REAL(place.row));
    place.column = column % width;
    return place;
}

HYK_FN hyk_vec3 hyk_map_texel(hyk_view view, hyk_uint column, hyk_uint row) {
    hyk_uint at = 3u * (row * HYK_CONSTANTS(view).environment_width + column);
    return hyk_make3(HYK_LOAD_ENVIRONMENT(view, at), HYK_LOAD_ENVIRONMENT(view, at + 1u), HYK_LOAD_ENVIRONMENT(view, at + 2u));
}

/* The four texels at a cell's corners: rows above and below, columns left and right. */
HYK_STRUCT(hyk_map_cell) {
    hyk_vec3 above_left, above_right, below_left, below_right;
} HYK_END(hyk_map_cell)

HYK_FN hyk_map_cell hyk_load_map_cell(hyk_view view, hyk_uint column, hyk_uint row) {
    hyk_uint right = column + 1u == HYK_CONSTANTS(view).environment_width ? 0u : column + 1u;
    hyk_uint above = row == 0u ? 0u : row - 1u, below = hyk_min_uint(row, HYK_CONSTANTS(view).environment_height - 1u);
    hyk_map_cell cell;
    cell.above_left = hyk_map_texel(view, column, above);
    cell.above_right = hyk_map_texel(view, right, above);
    cell.below_left = hyk_map_texel(view, column, below);
    cell.below_right = hyk_map_texel(view, right, below);
    return cell;
}

HYK_FN hyk_bool hyk_has_environment_map(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_ENVIRONMENT_MAP) && HYK_CONSTANTS(view).environment_width > 0u;
}

/* Radiance that arrives from a unit direction. */
HYK_FN hyk_vec3 hyk_environment_radiance(hyk_view view, hyk_vec3 direction, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) return hyk_zero3();
    if (!hyk_has_environment_map(view, features)) return HYK_CONSTANTS(view).environment;
    hyk_map_place at = hyk_place_on_map(view, direction);
    hyk_map_cell c = hyk_load_map_cell(view, at.column, at.row);
    hyk_vec3 above = hyk_lerp3(c.above_left, c.above_right, at.s), below = hyk_lerp3(c.below_left, c.below_right, at.s);
    return hyk_mul(HYK_CONSTANTS(view).environment, hyk_lerp3(above, below, at.t));
}

/* ---- sampling the map */

/* Share of a row's solid angle above the place t: cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2). */
HYK_FN hyk_real hyk_map_share_above(hyk_uint row, hyk_uint height, hyk_real t) {
    hyk_vec2 range = hyk_map_row_range(row, height);
    hyk_real down = hyk_max((row == 0u ? t - 0.5f : t) / HYK_TO_REAL(height), 0.0f);
    hyk_real span = range.y - range.x;
    hyk_real part = hyk_sin(HYK_HALF_PI * down) * hyk_sin(HYK_HALF_PI * (2.0f * range.x + down));
    hyk_real whole = hyk_sin(HYK_HALF_PI * span) * hyk_sin(HYK_HALF_PI * (2.0f * range.x + span));
    return hyk_saturate(part / whole);
}

HYK_FN hyk_real hyk_map_luminance(hyk_vec3 texel) { return hyk_max(hyk_luminance(texel), 0.0f); }

HYK_FN hyk_real hyk_pdf_map(hyk_view view, hyk_vec3 direction) {
    hyk_map_place at = hyk_place_on_map(view, direction);
    hyk_map_cell c = hyk_load_map_cell(view, at.column, at.row);
    hyk_real share = hyk_map_share_above(at.row, HYK_CONSTANTS(view).environment_height, at.t);
    hyk_real above = hyk_lerp(hyk_map_luminance(c.above_left), hyk_map_luminance(c.above_right), at.s);
    hyk_real below = hyk_lerp(hyk_map_luminance(c.below_left), hyk_map_luminance(c.below_right), at.s);
    return hyk_lerp(above, below, share) / HYK_CONSTANTS(view).environment_integral;
}

HYK_STRUCT(hyk_map_choice) {
    hyk_uint index;
    hyk_real u;
} HYK_END(hyk_map_choice)

/* Bisects [0, count) by the shares stored from base on. */
HYK_FN hyk_map_choice hyk_bisect_map(hyk_view view, hyk_uint base, hyk_uint count, hyk_chooser chooser) {
    hyk_uint first = 0u, last = count;
    while (last - first > 1u) {
        hyk_uint middle = first + (last - first) / 2u;
        hyk_real share = HYK_LOAD_ENVIRONMENT_CDF(view, base + middle);
        chooser = hyk_choose_share(chooser, hyk_abs(share), share < 0.0f);
        first = chooser.second ? middle : first;
        last = chooser.second ? last : middle;
    }
    hyk_map_choice choice;
    choice.index = first;
    choice.u = hyk_choice_rest(chooser);
    return choice;
}

HYK_FN hyk_vec3 hyk_map_direction(hyk_view view, hyk_uint column, hyk_uint row, hyk_real s, hyk_real share_above) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    hyk_vec2 range = hyk_map_row_range(row, height);
    /* measured from the nearer pole: 1 - cos keeps its bits there */
    hyk_bool south = 2u * row > height;
    hyk_real from = south ? 1.0f - range.y : range.x, to = south ? 1.0f - range.x : range.y;
    hyk_real near_pole = hyk_sin(HYK_HALF_PI * from), far_pole = hyk_sin(HYK_HALF_PI * to);
    hyk_real h = 2.0f * hyk_lerp(near_pole * near_pole, far_pole * far_pole, south ? 1.0f - share_above : share_above);
    hyk_real turn = (HYK_TO_REAL(column) + s + 0.5f) / HYK_TO_REAL(width) - 0.5f;
    hyk_real phi = HYK_TWO_PI * turn - HYK_CONSTANTS(view).environment_rotation;
    hyk_vec3 local = hyk_direction_near_axis(h, phi);
    return hyk_make3(local.y, south ? -local.z : local.z, -local.x);
}

HYK_FN hyk_vec3 hyk_sample_map(hyk_view view, hyk_vec2 u) {
    hyk_uint width = HYK_CONSTANTS(view).environment_width, height = HYK_CONSTANTS(view).environment_height;
    hyk_map_choice row = hyk_bisect_map(view, 0u, height + 1u, hyk_start_choosing(u.y, u));
    hyk_chooser along = hyk_start_choosing(u.x, hyk_make2(row.u, u.y));
    hyk_map_choice column = hyk_bisect_map(view, height + 1u + width * row.index, width, along);
    hyk_map_cell c = hyk_load_map_cell(view, column.index, row.index);
    hyk_real a = hyk_map_luminance(c.above_left), b = hyk_map_luminance(c.above_right);
    hyk_real d = hyk_map_luminance(c.below_left), e = hyk_map_luminance(c.below_right);
    hyk_real share = hyk_sample_linear(row.u, 0.5f * a + 0.5f * b, 0.5f * d + 0.5f * e);
    hyk_real s = hyk_sample_linear(column.u, hyk_lerp(a, d, share), hyk_lerp(b, e, share));
    return hyk_map_direction(view, column.index, row.index, s, share);
}

/* ---- the environment as a light. n: shading normal; both_sides: light from behind counts too */

HYK_FN hyk_vec3 hyk_sample_environment(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec2 u, hyk_uint features) {
    if (hyk_has_environment_map(view, features)) return hyk_sample_map(view, u);
    hyk_vec3 axis = n;
    if (both_sides) {
        if (u.x >= 0.5f) axis = hyk_neg(n);
        u.x = u.x >= 0.5f ? 2.0f * u.x - 1.0f : 2.0f * u.x;
    }
    return hyk_normalize(hyk_to_world(hyk_make_frame(axis), hyk_sample_cosine_hemisphere(u)));
}

HYK_FN hyk_real hyk_pdf_environment(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction, hyk_uint features) {
    if (hyk_has_environment_map(view, features)) return hyk_pdf_map(view, direction);
    hyk_real cos_theta = hyk_dot(n, direction);
    return both_sides ? 0.5f * hyk_pdf_cosine_hemisphere(hyk_abs(cos_theta)) : hyk_pdf_cosine_hemisphere(cos_theta);
}

/* Luminance of the irradiance it may give: exact for constant radiance and nothing in the way, else the mean
   over orientations. */
HYK_FN hyk_real hyk_estimate_environment(hyk_view view, hyk_bool both_sides, hyk_uint features) {
    hyk_real mean = hyk_max(hyk_luminance(HYK_CONSTANTS(view).environment), 0.0f);
    if (hyk_has_environment_map(view, features)) mean *= HYK_CONSTANTS(view).environment_integral * (0.25f * HYK_INV_PI);
    return (both_sides ? HYK_TWO_PI : HYK_PI) * mean;
}

#endif /* HYK_ENVIRONMENT_H */

/* >>shared-light-tree: choosing one of many lights by what it can give at a point

   Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting". A node's
   importance bounds, up to the distance, the irradiance its lights can cause; zero only when none can. */
#ifndef HYK_LIGHT_TREE_H
#define HYK_LIGHT_TREE_H

/* The smallest weight of something that can contribute: keeps underflow from making it impossible. */
#define HYK_LEAST_WEIGHT HYK_C(1e-37)

/* Irradiance is estimated as weight / distance^2; apart, because the square may leave the range. */
HYK_STRUCT(hyk_light_bound) {
    hyk_real weight;
    hyk_real distance;
} HYK_END(hyk_light_bound)

/* Cosine and sine of max(0, a - b) for angles in [0, pi]. */
HYK_FN hyk_vec2 hyk_angle_beyond(hyk_vec2 a, hyk_vec2 b) {
    if (a.x >= b.x) return hyk_make2(1.0f, 0.0f);
    return hyk_make2(a.x * b.x + a.y * b.y, hyk_max(a.y * b.x - a.x * b.y, 0.0f));
}
HYK_FN hyk_vec2 hyk_angle_of_cosine(hyk_real c) { return hyk_make2(c, hyk_safe_sqrt((1.0f - c) * (1.0f + c))); }

/* How far the box (middle as seen from the point, half extents) reaches towards a direction. slack: what
   rounding of coordinates can hide. */
HYK_FN hyk_real hyk_box_reach(hyk_vec3 middle, hyk_vec3 half_extent, hyk_vec3 direction, hyk_real slack) {
    return hyk_dot(middle, direction) + hyk_dot(half_extent, hyk_abs3(direction)) + slack;
}

/* The cosine at the lights, at its best: 0 when no normal within the cone turns far enough to the point. */
HYK_FN hyk_real hyk_emission_bound(hyk_light_node node, hyk_vec3 direction, hyk_vec2 spread) {
    hyk_real facing = -hyk_dot(node.axis, direction);
    if (node.both_sides != 0u) facing = hyk_abs(facing);
    hyk_vec2 cone = hyk_angle_of_cosine(node.cos_o);
    hyk_vec2 beyond = hyk_angle_beyond(hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), cone), spread);
    /* sines come from cosines near 1 with an error of up to the root of the rounding unit */
    hyk_real slack = 0.00390625f * (cone.y + spread.y) + 0.00000095367431640625f;
    return beyond.x < node.cos_e - slack ? 0.0f : hyk_max(beyond.x, slack);
}

HYK_FN hyk_real hyk_receiver_bound(hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction, hyk_vec2 spread) {
    hyk_real facing = hyk_dot(n, direction);
    if (both_sides) facing = hyk_abs(facing);
    hyk_vec2 beyond = hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), spread);
    return hyk_max(beyond.x, 0.00000095367431640625f);
}

HYK_FN hyk_light_bound hyk_bound_light_node(hyk_light_node node, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_vec3 half_extent = hyk_scale(hyk_sub(node.upper, node.lower), 0.5f);
    hyk_vec3 middle = hyk_sub(hyk_add(node.lower, half_extent), p);
    hyk_real distance = hyk_sqrt(hyk_dot(middle, middle)), radius = hyk_sqrt(hyk_dot(half_extent, half_extent));
    hyk_real slack = 8.0f * HYK_REAL_EPSILON * (hyk_max3(hyk_abs3(p)) + hyk_max3(hyk_abs3(node.lower)) + radius);
    hyk_light_bound bound;
    bound.weight = 0.0f;
    bound.distance = hyk_max(hyk_max(distance, radius), HYK_C(1e-30));
    if (!(node.intensity > 0.0f)) return bound;
    if (!both_sides && !(hyk_box_reach(middle, half_extent, n, slack) > 0.0f)) return bound;
    /* one orientation, emitting forwards only: the box must reach behind the point, along the axis */
    hyk_bool one_way = node.cos_o >= 1.0f && node.cos_e >= 0.0f && node.both_sides == 0u;
    if (one_way && !(hyk_box_reach(middle, half_extent, hyk_neg(node.axis), slack) > 0.0f)) return bound;
    bound.weight = node.intensity;
    if (distance <= radius) return bound; /* from within the bounding sphere anything is possible */
    hyk_real sine = radius / distance;
    hyk_vec2 spread = hyk_make2(hyk_sqrt((1.0f - sine) * (1.0f + sine)), sine);
    hyk_vec3 direction = hyk_scale(middle, 1.0f / distance);
    hyk_real emitted = hyk_emission_bound(node, direction, spread);
    if (emitted == 0.0f) bound.weight = 0.0f;
    else bound.weight = hyk_max(node.intensity * emitted * hyk_receiver_bound(n, both_sides, direction, spread), HYK_LEAST_WEIGHT);
    return bound;
}

/* The i-th of a node's two children, a leaf being its own first; HYK_NONE: there is none. */
HYK_FN hyk_uint hyk_light_child(hyk_view view, hyk_uint at, hyk_uint i) {
    if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) return i == 0u ? at : HYK_NONE;
    return i == 0u ? at + 1u : HYK_LOAD_LIGHT_NODE(view, at).child;
}

/* What a node gives, in units of weight at a distance of unit. Never 0 for what can contribute. */
HYK_FN hyk_real hyk_value_of_bound(hyk_light_bound bound, hyk_real unit) {
    if (!(bound.weight > 0.0f)) return 0.0f;
    hyk_real nearness = unit / bound.distance;
    return hyk_clamp(bound.weight * nearness * nearness, HYK_LEAST_WEIGHT, HYK_C(1e36));
}

/* The rarer child of two that can contribute still gets this much: a bound may be far above what its lights
   give, and then a light that matters must not become so rare that finding it blinds. */
#define HYK_LEAST_CHILD_SHARE 0.015625f

/* Probabilities of a node's two children, both 0 when no light of them can contribute. Each child is judged
   by the sum of its own children's bounds, one level further than the paper: so a bright light that faces
   away, or lies below the horizon, no longer draws the walk to its neighbours. */
HYK_FN hyk_vec2 hyk_light_child_shares(hyk_view view, hyk_uint first, hyk_uint second, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_light_node near_node = HYK_LOAD_LIGHT_NODE(view, first);
    hyk_vec3 extent = hyk_sub(near_node.upper, near_node.lower), away = hyk_sub(near_node.lower, p);
    hyk_real unit = hyk_max(hyk_sqrt(hyk_dot(extent, extent) + hyk_dot(away, away)), HYK_C(1e-30));
    hyk_real x = 0.0f, y = 0.0f;
    for (hyk_uint i = 0u; i < 4u; i++) {
        hyk_uint at = hyk_light_child(view, i < 2u ? first : second, i & 1u);
        if (at == HYK_NONE) continue;
        hyk_real value = hyk_value_of_bound(hyk_bound_light_node(HYK_LOAD_LIGHT_NODE(view, at), p, n, both_sides), unit);
        if (i < 2u) x += value;
        else y += value;
    }
    hyk_real less = hyk_min(x, y), sum = x + y;
    if (!(sum > 0.0f)) return hyk_make2(0.0f, 0.0f);
    hyk_real rarer = less > 0.0f ? hyk_max(less / sum, HYK_LEAST_CHILD_SHARE) : 0.0f;
    return x <= y ? hyk_make2(rarer, 1.0f - rarer) : hyk_make2(1.0f - rarer, rarer);
}

HYK_STRUCT(hyk_light_pick) {
    hyk_uint light;       /* HYK_NONE: no light below the node taken can contribute */
    hyk_real probability;
} HYK_END(hyk_light_pick)

HYK_FN hyk_light_pick hyk_pick_light(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_chooser chooser) {
    hyk_light_pick pick;
    pick.light = HYK_NONE;
    chooser.probability = 1.0f;
    hyk_uint at = 0u;
    for (hyk_uint depth = 0u; depth <= HYK_LIGHT_TREE_DEPTH; depth++) {
        hyk_uint child = HYK_LOAD_LIGHT_NODE(view, at).child;
        if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) {
            pick.light = child;
            break;
        }
        hyk_vec2 shares = hyk_light_child_shares(view, at + 1u, child, p, n, both_sides);
        if (!(shares.x + shares.y > 0.0f)) {
            chooser.probability = 0.0f;
            break;
        }
        chooser = hyk_choose_share(chooser, hyk_min(shares.x, shares.y), shares.y < shares.x);
        at = chooser.second ? child : at + 1u;
    }
    pick.probability = chooser.probability;
    return pick;
}

/* The probability with which hyk_pick_light takes the light that this path leads to. */
HYK_FN hyk_real hyk_light_pick_probability(hyk_view view, hyk_uint path, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real probability = 1.0f;
    hyk_uint at = 0u;
    for (hyk_uint depth = 0u; depth < HYK_LIGHT_TREE_DEPTH; depth++) {
        if (HYK_LOAD_LIGHT_NODE(view, at).is_leaf != 0u) break;
        hyk_uint child = HYK_LOAD_LIGHT_NODE(view, at).child;
        hyk_vec2 shares = hyk_light_child_shares(view, at + 1u, child, p, n, both_sides);
        hyk_bool second = ((path >> depth) & 1u) != 0u;
        probability *= second ? shares.y : shares.x;
        at = second ? child : at + 1u;
    }
    return probability;
}

/* Luminance of the irradiance that all finite lights together may give, from the second level of the tree.
   Zero only when no light can contribute. */
HYK_FN hyk_real hyk_estimate_finite_lights(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real sum = 0.0f;
    for (hyk_uint i = 0u; i < 4u; i++) {
        hyk_uint at = hyk_light_child(view, 0u, i >> 1);
        if (at != HYK_NONE) at = hyk_light_child(view, at, i & 1u);
        if (at != HYK_NONE) sum += hyk_value_of_bound(hyk_bound_light_node(HYK_LOAD_LIGHT_NODE(view, at), p, n, both_sides), 1.0f);
    }
    return sum;
}

#endif /* HYK_LIGHT_TREE_H */

/* >>shared-light: choosing a light and a direction to it, and the density of that choice */
#ifndef HYK_LIGHT_H
#define HYK_LIGHT_H

#define HYK_SAMPLE_VALID 0x1u
#define HYK_SAMPLE_DELTA 0x2u   /* no other strategy can find this direction: weight 1 */
#define HYK_SAMPLE_SURFACE 0x4u /* position and normal are set */

/* The contribution is always f cos radiance / pdf. */
HYK_STRUCT(hyk_light_sample) {
    hyk_vec3 direction; /* unit, to the light */
    hyk_real distance;  /* HYK_REAL_MAX: sun, environment */
    hyk_vec3 radiance;  /* that arrives if nothing is in the way; DELTA: irradiance on a facing surface */
    hyk_real pdf;       /* per steradian, choice of the light included; DELTA: that choice alone */
    hyk_vec3 position;
    hyk_uint light;     /* HYK_NONE: environment */
    hyk_vec3 normal;
    hyk_uint flags;
} HYK_END(hyk_light_sample)

HYK_FN hyk_light_sample hyk_no_light_sample(void) {
    hyk_light_sample s;
    s.direction = hyk_zero3();
    s.distance = 0.0f;
    s.radiance = hyk_zero3();
    s.pdf = 0.0f;
    s.position = hyk_zero3();
    s.light = HYK_NONE;
    s.normal = hyk_zero3();
    s.flags = 0u;
    return s;
}

/* ---- lights without extent */

/* Share of a spot's intensity at an angle of that cosine off its axis: 1 inside cone_inner, 0 outside
   cone_outer, x^2 (3 - 2 x) between with x linear in the cosine. Its flux is therefore
   2 pi intensity (1 - (cos_inner + cos_outer) / 2). */
HYK_FN hyk_real hyk_spot_falloff(hyk_light light, hyk_real cosine) {
    if (cosine >= light.cos_inner) return cosine >= light.cos_outer ? 1.0f : 0.0f;
    if (cosine <= light.cos_outer) return 0.0f;
    hyk_real x = hyk_saturate((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer));
    return x * x * (3.0f - 2.0f * x);
}

HYK_FN hyk_real hyk_to_finite(hyk_real x) { return hyk_min(x, HYK_REAL_MAX); }

/* POINT and SPOT: intensity over the square of the distance, divided twice so that no square overflows. */
HYK_FN hyk_light_sample hyk_sample_point_light(hyk_light light, hyk_vec3 p) {
    hyk_light_sample s = hyk_no_light_sample();
    hyk_vec3 offset = hyk_sub(light.position, p);
    s.distance = hyk_length(offset);
    if (!(s.distance > 0.0f)) return s;
    s.direction = hyk_normalize(offset);
    hyk_real share = light.kind == HYK_LIGHT_SPOT ? hyk_spot_falloff(light, -hyk_dot(s.direction, light.normal)) : 1.0f;
    if (!(share > 0.0f)) return s;
    hyk_vec3 e = hyk_scale(light.radiance, share);
    s.radiance = hyk_make3(hyk_to_finite(e.x / s.distance / s.distance), hyk_to_finite(e.y / s.distance / s.distance),
                           hyk_to_finite(e.z / s.distance / s.distance));
    s.pdf = 1.0f;
    s.position = light.position;
    s.normal = hyk_neg(s.direction);
    s.flags = HYK_SAMPLE_VALID | HYK_SAMPLE_DELTA;
    return s;
}

/* ---- suns */

/* 1 - cos of its angular radius, from the angle: the stored cosine has lost the bits of small ones. */
HYK_FN hyk_real hyk_sun_cap(hyk_light light) {
    hyk_real s = hyk_sin(0.5f * light.radius);
    return 2.0f * s * s;
}

/* Whether the disc covers a unit direction: by the chord, which is precise for the smallest discs. */
HYK_FN hyk_bool hyk_sun_covers(hyk_light light, hyk_vec3 direction) {
    if (!(light.radius > 0.0f)) return false;
    hyk_vec3 chord = hyk_sub(direction, light.normal);
    return hyk_dot(chord, chord) <= 2.0f * hyk_sun_cap(light);
}

/* Radiance of a sun seen in a unit direction; zero beside its disc and for parallel beams. */
HYK_FN hyk_vec3 hyk_sun_radiance(hyk_light light, hyk_vec3 direction) {
    if (hyk_sun_covers(light, direction)) return light.radiance;
    return hyk_zero3();
}

HYK_FN hyk_light_sample hyk_sample_sun(hyk_light light, hyk_vec2 u) {
    hyk_light_sample s = hyk_no_light_sample();
    s.distance = HYK_REAL_MAX;
    s.radiance = light.radiance;
    s.flags = HYK_SAMPLE_VALID;
    if (light.radius > 0.0f) {
        hyk_real cap = hyk_sun_cap(light);
        s.direction = hyk_normalize(hyk_to_world(hyk_make_frame(light.normal), hyk_sample_cone(cap, u)));
        s.pdf = hyk_pdf_cone(hyk_max(cap, HYK_LEAST_SOLID_ANGLE));
    } else {
        s.direction = light.normal;
        s.pdf = 1.0f;
        s.flags = HYK_SAMPLE_VALID | HYK_SAMPLE_DELTA;
    }
    return s;
}

/* Luminance of the irradiance a sun can give, at most: zero only when all of its disc is below the horizon. */
HYK_FN hyk_real hyk_estimate_sun(hyk_light light, hyk_vec3 n, hyk_bool both_sides) {
    hyk_real luminance = hyk_max(hyk_luminance(light.radiance), 0.0f), facing = hyk_dot(n, light.normal);
    if (both_sides) facing = hyk_abs(facing);
    if (!(light.radius > 0.0f)) return luminance * hyk_max(facing, 0.0f);
    hyk_real slack = 0.00048828125f; /* of sines taken from cosines near 1 */
    hyk_vec2 disc = hyk_make2(hyk_cos(hyk_min(light.radius, HYK_PI)), hyk_sin(hyk_min(light.radius, HYK_PI)));
    hyk_real beyond = hyk_angle_beyond(hyk_angle_of_cosine(hyk_clamp(facing, -1.0f, 1.0f)), disc).x;
    if (beyond <= -slack) return 0.0f;
    return HYK_TWO_PI * hyk_sun_cap(light) * luminance * hyk_max(beyond, slack);
}

HYK_FN hyk_real hyk_estimate_suns(hyk_view view, hyk_vec3 n, hyk_bool both_sides) {
    hyk_uint first = HYK_CONSTANTS(view).finite_lights, suns = HYK_CONSTANTS(view).suns;
    hyk_real sum = 0.0f;
    for (hyk_uint i = 0u; i < suns; i++) sum += hyk_estimate_sun(HYK_LOAD_LIGHT(view, first + i), n, both_sides);
    return sum;
}

/* Each sun takes the place of those before it in proportion to the sum so far. */
HYK_FN hyk_light_pick hyk_pick_sun(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_chooser chooser) {
    hyk_uint first = HYK_CONSTANTS(view).finite_lights, suns = HYK_CONSTANTS(view).suns;
    hyk_light_pick pick;
    pick.light = first;
    pick.probability = 1.0f;
    if (suns == 1u) return pick;
    hyk_real sum = 0.0f, taken = 0.0f;
    for (hyk_uint i = 0u; i < suns; i++) {
        hyk_real weight = hyk_estimate_sun(HYK_LOAD_LIGHT(view, first + i), n, both_sides);
        if (!(weight > 0.0f)) continue;
        if (sum > 0.0f) chooser = hyk_choose(chooser, sum, weight);
        if (!(sum > 0.0f) || chooser.second) {
            pick.light = first + i;
            taken = weight;
        }
        sum += weight;
    }
    if (!(sum > 0.0f)) pick.light = HYK_NONE;
    pick.probability = sum > 0.0f ? taken / sum : 0.0f;
    return pick;
}

HYK_FN hyk_real hyk_sun_pick_probability(hyk_view view, hyk_light light, hyk_vec3 n, hyk_bool both_sides) {
    if (HYK_CONSTANTS(view).suns == 1u) return 1.0f;
    hyk_real total = hyk_estimate_suns(view, n, both_sides);
    return total > 0.0f ? hyk_estimate_sun(light, n, both_sides) / total : 0.0f;
}

/* ---- finite lights, suns, environment: which */

/* Every group that can contribute gets at least this probability: the estimates know nothing of shadows. */
#define HYK_LEAST_GROUP_SHARE 0.125f

HYK_STRUCT(hyk_light_groups) {
    hyk_real finite, suns, environment; /* probabilities */
} HYK_END(hyk_light_groups)

HYK_FN hyk_bool hyk_has_finite_lights(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_EMITTERS) && HYK_CONSTANTS(view).finite_lights > 0u;
}
HYK_FN hyk_bool hyk_has_suns(hyk_view view, hyk_uint features) {
    return HYK_HAS(features, HYK_NEEDS_SUNS) && HYK_CONSTANTS(view).suns > 0u;
}
HYK_FN hyk_bool hyk_has_environment(hyk_view view, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) return false;
    return !hyk_has_environment_map(view, features) || HYK_CONSTANTS(view).environment_integral > 0.0f;
}

/* In proportion to the estimates, above the least share. */
HYK_FN hyk_real hyk_group_share(hyk_real estimate, hyk_real total, hyk_real groups) {
    return estimate > 0.0f ? HYK_LEAST_GROUP_SHARE + (1.0f - groups * HYK_LEAST_GROUP_SHARE) * (estimate / total) : 0.0f;
}

HYK_FN hyk_light_groups hyk_choose_light_groups(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_uint features) {
    hyk_bool finite = hyk_has_finite_lights(view, features), suns = hyk_has_suns(view, features);
    hyk_bool environment = hyk_has_environment(view, features);
    hyk_light_groups g;
    g.finite = finite ? 1.0f : 0.0f;
    g.suns = suns ? 1.0f : 0.0f;
    g.environment = environment ? 1.0f : 0.0f;
    if (g.finite + g.suns + g.environment <= 1.0f) return g;
    if (finite) g.finite = hyk_min(hyk_estimate_finite_lights(view, p, n, both_sides), HYK_C(1e37));
    if (suns) g.suns = hyk_min(hyk_estimate_suns(view, n, both_sides), HYK_C(1e37));
    if (environment) g.environment = hyk_min(hyk_estimate_environment(view, both_sides, features), HYK_C(1e37));
    hyk_real total = g.finite + g.suns + g.environment;
    hyk_real groups = (g.finite > 0.0f ? 1.0f : 0.0f) + (g.suns > 0.0f ? 1.0f : 0.0f) + (g.environment > 0.0f ? 1.0f : 0.0f);
    g.finite = hyk_group_share(g.finite, total, groups);
    g.suns = hyk_group_share(g.suns, total, groups);
    g.environment = hyk_group_share(g.environment, total, groups);
    return g;
}

/* ---- the sample */

HYK_FN hyk_vec3 hyk_surface_light_radiance(hyk_view view, hyk_light light, hyk_surface_sample s, hyk_vec3 direction, hyk_uint features) {
    hyk_vec3 radiance = hyk_shape_radiance(light, s.normal, direction);
    if (HYK_HAS(features, HYK_NEEDS_TEXTURES | HYK_NEEDS_ALPHA) && (light.flags & HYK_LIGHT_TEXTURED) != 0u && !hyk_is_black(radiance))
        radiance = hyk_triangle_emission(view, light.instance, light.primitive, s.weights, features);
    return radiance;
}

HYK_FN hyk_light_sample hyk_sample_finite_light(hyk_view view, hyk_uint index, hyk_vec3 p, hyk_vec2 u, hyk_uint features) {
    hyk_light light = HYK_LOAD_LIGHT(view, index);
    if (light.kind == HYK_LIGHT_POINT || light.kind == HYK_LIGHT_SPOT) return hyk_sample_point_light(light, p);
    hyk_light_sample s = hyk_no_light_sample();
    hyk_surface_sample on_light = hyk_sample_surface_light(light, p, u);
    if (!(on_light.pdf > 0.0f)) return s;
    s.distance = hyk_length(on_light.offset);
    s.direction = hyk_normalize(on_light.offset);
    s.radiance = hyk_surface_light_radiance(view, light, on_light, s.direction, features);
    s.position = hyk_add(p, on_light.offset);
    s.normal = on_light.normal;
    s.pdf = light.kind == HYK_LIGHT_DISC ? hyk_pdf_disc_light(light, p, s.direction) : on_light.pdf;
    s.flags = s.pdf > 0.0f && !hyk_is_black(s.radiance) ? HYK_SAMPLE_VALID | HYK_SAMPLE_SURFACE : 0u;
    return s;
}

HYK_FN hyk_light_sample hyk_sample_sky(hyk_view view, hyk_vec3 n, hyk_bool both_sides, hyk_vec2 u, hyk_uint features) {
    hyk_light_sample s = hyk_no_light_sample();
    s.direction = hyk_sample_environment(view, n, both_sides, u, features);
    s.distance = HYK_REAL_MAX;
    s.radiance = hyk_environment_radiance(view, s.direction, features);
    s.pdf = hyk_pdf_environment(view, n, both_sides, s.direction, features);
    s.flags = s.pdf > 0.0f && !hyk_is_black(s.radiance) ? HYK_SAMPLE_VALID : 0u;
    return s;
}

/* One direction to one light. n: the shading normal, on the viewer's side; both_sides: the surface transmits,
   so that light from behind counts too; u_select chooses the light, u the direction. */
HYK_CALLED hyk_light_sample hyk_sample_lights(hyk_view view, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_real u_select, hyk_vec2 u,
                                          hyk_uint features) {
    hyk_light_groups groups = hyk_choose_light_groups(view, p, n, both_sides, features);
    hyk_light_sample s = hyk_no_light_sample();
    if (!(groups.finite + groups.suns + groups.environment > 0.0f)) return s;
    hyk_chooser chooser = hyk_start_choosing(u_select, u);
    hyk_bool infinite = !(groups.finite > 0.0f);
    if (groups.finite > 0.0f && groups.finite < 1.0f) {
        chooser = hyk_choose(chooser, groups.finite, groups.suns + groups.environment);
        infinite = chooser.second;
    }
    hyk_bool sky = infinite && !(groups.suns > 0.0f);
    if (infinite && groups.suns > 0.0f && groups.environment > 0.0f) {
        chooser = hyk_choose(chooser, groups.suns, groups.environment);
        sky = chooser.second;
    }
    hyk_real probability = groups.environment;
    hyk_light_pick pick;
    pick.light = HYK_NONE;
    pick.probability = 1.0f;
    if (sky) {
        s = hyk_sample_sky(view, n, both_sides, u, features);
    } else if (infinite) {
        probability = groups.suns;
        pick = hyk_pick_sun(view, n, both_sides, chooser);
        if (pick.light == HYK_NONE) return s;
        s = hyk_sample_sun(HYK_LOAD_LIGHT(view, pick.light), u);
    } else {
        probability = groups.finite;
        pick = hyk_pick_light(view, p, n, both_sides, chooser);
        if (pick.light == HYK_NONE) return s;
        s = hyk_sample_finite_light(view, pick.light, p, u, features);
    }
    s.light = pick.light;
    s.pdf = hyk_to_finite(s.pdf * probability * pick.probability);
    if (!(s.pdf > 0.0f) || (!both_sides && !(hyk_dot(n, s.direction) > 0.0f))) s.flags = 0u;
    return s;
}

/* The density with which hyk_sample_lights, given the same p, n and both_sides, would have produced a unit
   direction that hits a RECT, DISC, SPHERE or TRIANGLE light. distance and light_normal describe that hit. */
HYK_CALLED hyk_real hyk_pdf_light(hyk_view view, hyk_uint light, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction,
                              hyk_real distance, hyk_vec3 light_normal, hyk_uint features) {
    if (!hyk_has_finite_lights(view, features) || !(distance > 0.0f)) return 0.0f;
    hyk_light l = HYK_LOAD_LIGHT(view, light);
    if (!hyk_light_shows_back(l) && !(hyk_dot(light_normal, direction) < 0.0f)) return 0.0f;
    hyk_real pdf = hyk_pdf_surface_light(l, p, direction);
    if (!(pdf > 0.0f)) return 0.0f;
    pdf *= hyk_choose_light_groups(view, p, n, both_sides, features).finite;
    return hyk_to_finite(pdf * hyk_light_pick_probability(view, l.tree_path, p, n, both_sides));
}

/* The same for a ray that escapes: which is a sun, or HYK_NONE for the environment. */
HYK_CALLED hyk_real hyk_pdf_infinite(hyk_view view, hyk_uint which, hyk_vec3 p, hyk_vec3 n, hyk_bool both_sides, hyk_vec3 direction,
                                 hyk_uint features) {
    if (which == HYK_NONE) {
        if (!hyk_has_environment(view, features)) return 0.0f;
        hyk_real share = hyk_choose_light_groups(view, p, n, both_sides, features).environment;
        return share > 0.0f ? share * hyk_pdf_environment(view, n, both_sides, direction, features) : 0.0f;
    }
    if (!hyk_has_suns(view, features)) return 0.0f;
    hyk_light light = HYK_LOAD_LIGHT(view, which);
    if (!hyk_sun_covers(light, direction)) return 0.0f;
    hyk_real pick = hyk_sun_pick_probability(view, light, n, both_sides);
    if (!(pick > 0.0f)) return 0.0f;
    hyk_real pdf = hyk_pdf_cone(hyk_max(hyk_sun_cap(light), HYK_LEAST_SOLID_ANGLE));
    return hyk_choose_light_groups(view, p, n, both_sides, features).suns * pick * pdf;
}

#endif /* HYK_LIGHT_H */

/* >>shared-camera: rays of the sensors */
#ifndef HYK_CAMERA_H
#define HYK_CAMERA_H

#define HYK_SENSOR_PINHOLE 0u
#define HYK_SENSOR_THIN_LENS 1u
#define HYK_SENSOR_ORTHOGRAPHIC 2u
#define HYK_SENSOR_EQUIRECTANGULAR 3u
#define HYK_SENSOR_POINTS 4u
#define HYK_SENSOR_RAYS 5u
#define HYK_FILTER_BOX 0u
#define HYK_FILTER_TENT 1u

HYK_STRUCT(hyk_camera) {
    hyk_vec3 position;
    hyk_uint kind;
    hyk_vec3 right;      /* unit, as up and forward */
    hyk_real half_width; /* of the image window: at distance 1 (perspective), in metres (orthographic) */
    hyk_vec3 up;
    hyk_real half_height;
    hyk_vec3 forward;
    hyk_real lens_radius;
    hyk_real focus_distance;
    hyk_real shift_x, shift_y; /* of the window, in its own units */
    hyk_uint filter_kind;
    hyk_uint width, height;
    hyk_real spread;     /* growth of a pixel's cone per metre */
    hyk_real start_width; /* of the cone at the ray's origin (orthographic) */
} HYK_END(hyk_camera)
HYK_SIZE_IS(hyk_camera, 96)

/* A tent two pixels wide, as an offset from the pixel's middle (the inverse of its distribution). */
HYK_FN hyk_real hyk_tent(hyk_real u) {
    return u < 0.5f ? hyk_sqrt(2.0f * u) - 1.0f : 1.0f - hyk_sqrt(2.0f - 2.0f * u);
}

/* Where in the image, in pixels, sample u of a pixel lies. */
HYK_FN hyk_vec2 hyk_film_point(hyk_camera c, hyk_uint x, hyk_uint y, hyk_vec2 u) {
    if (c.filter_kind == HYK_FILTER_TENT)
        return hyk_make2(HYK_TO_REAL(x) + 0.5f + hyk_tent(u.x), HYK_TO_REAL(y) + 0.5f + hyk_tent(u.y));
    return hyk_make2(HYK_TO_REAL(x) + u.x, HYK_TO_REAL(y) + u.y);
}

HYK_FN hyk_vec3 hyk_camera_space(hyk_camera c, hyk_real x, hyk_real y, hyk_real z) {
    return hyk_add(hyk_scale(c.right, x), hyk_add(hyk_scale(c.up, y), hyk_scale(c.forward, z)));
}

/* The ray through film point f (pixels); lens is uniform in the unit square. */
HYK_FN hyk_ray hyk_camera_ray(hyk_camera c, hyk_vec2 f, hyk_vec2 lens) {
    hyk_real sx = 2.0f * f.x / HYK_TO_REAL(c.width) - 1.0f, sy = 1.0f - 2.0f * f.y / HYK_TO_REAL(c.height);
    hyk_real x = sx * c.half_width + c.shift_x, y = sy * c.half_height + c.shift_y;
    hyk_ray r;
    r.origin = c.position;
    r.t_min = 0.0f;
    r.t_max = HYK_REAL_MAX;
    if (c.kind == HYK_SENSOR_ORTHOGRAPHIC) {
        r.origin = hyk_add(c.position, hyk_camera_space(c, x, y, 0.0f));
        r.direction = c.forward;
    } else if (c.kind == HYK_SENSOR_EQUIRECTANGULAR) {
        hyk_real longitude = sx * HYK_PI, latitude = sy * HYK_PI * 0.5f;
        hyk_real ring = hyk_cos(latitude);
        r.direction = hyk_normalize(hyk_camera_space(c, ring * hyk_sin(longitude), hyk_sin(latitude), ring * hyk_cos(longitude)));
    } else if (c.kind == HYK_SENSOR_THIN_LENS && c.lens_radius > 0.0f) {
        hyk_vec2 on_lens = hyk_sample_disc(lens);
        hyk_real lx = on_lens.x * c.lens_radius, ly = on_lens.y * c.lens_radius;
        /* from the lens to the point that the pinhole ray has in the plane of focus */
        r.origin = hyk_add(c.position, hyk_camera_space(c, lx, ly, 0.0f));
        r.direction = hyk_normalize(hyk_camera_space(c, x * c.focus_distance - lx, y * c.focus_distance - ly, c.focus_distance));
    } else {
        r.direction = hyk_normalize(hyk_camera_space(c, x, y, 1.0f));
    }
    return r;
}

#endif /* HYK_CAMERA_H */

/* >>shared-path: one vertex of a path: emission found, light sampled, next direction

   The estimator is that of Veach 1997, chapters 9 and 10: at each vertex one light sample, and what the BSDF's own
   direction meets next, weighted against each other by the power heuristic. */
#ifndef HYK_PATH_H
#define HYK_PATH_H

/* What the picture asks of its paths. */
#define HYK_WANTS_COMPONENTS 0x1u
#define HYK_WANTS_IRRADIANCE 0x2u
#define HYK_WANTS_SURFACE 0x4u
#define HYK_STRATEGY_MIS 0u
#define HYK_STRATEGY_LIGHTS 1u
#define HYK_STRATEGY_BSDF 2u

/* Which part of the picture a contribution belongs to (ALGORITHMS section 0): with D the scatterings that a diffuse
   lobe made, direct has at most one D, and that one last; a caustic has one D, then speculars; the rest is indirect. */
#define HYK_COMPONENT_DIRECT 0u
#define HYK_COMPONENT_INDIRECT 1u
#define HYK_COMPONENT_CAUSTIC 2u

#define HYK_PATH_FROM_SENSOR 0x1u     /* no scattering yet */
#define HYK_PATH_BOTH_SIDES 0x2u      /* the last vertex sampled lights on both its sides */
#define HYK_PATH_DIFFUSE 0x4u         /* one D at least */
#define HYK_PATH_DIFFUSE_TWICE 0x8u
#define HYK_PATH_SPECULAR_LAST 0x10u
#define HYK_PATH_IRRADIANCE 0x20u     /* past the surface whose irradiance is asked for */
#define HYK_PATH_NO_IRRADIANCE 0x40u  /* that surface gives none on this path */
#define HYK_PATH_POINT 0x80u          /* at a sensor's point, which is a white Lambert surface of its own */
#define HYK_PATH_LEFT_POINT 0x100u    /* the ray that left it */

HYK_STRUCT(hyk_path) {
    hyk_ray ray;             /* unit direction */
    hyk_vec3 throughput;
    hyk_real pdf;            /* of the direction, solid angle; 0: sensor or delta, so no light sampling competes */
    hyk_vec3 normal;         /* shading normal where the direction was made */
    hyk_uint flags;
    hyk_vec3 irradiance;     /* throughput since the surface whose irradiance is asked for, cosine over pdf included */
    hyk_uint depth_left;     /* scatterings still allowed */
    hyk_sampler random;
    hyk_uint bounce;         /* scatterings so far, the point's own included: picks the random numbers */
    hyk_real cone_width, cone_spread;
    hyk_uint unused3, unused4;
    hyk_vec3 vertex;         /* where the direction was made: the ray's origin before it was moved off the surface */
    hyk_real eta_scale;      /* product of n^2 ratios, which Russian roulette must not see as loss */
    hyk_uint lane;           /* whose sample it is */
    hyk_uint unused0, unused1, unused2;
} HYK_END(hyk_path)
HYK_SIZE_IS(hyk_path, 144)

#define HYK_SCATTER_SHADOW 0x1u     /* shadow ray to be cast */
#define HYK_SCATTER_CONTINUES 0x2u  /* next is alive */
#define HYK_SCATTER_SURFACE 0x4u    /* first surface recorded */
#define HYK_SCATTER_INSIDE 0x8u     /* the ray from a sensor's point met a back face */

HYK_STRUCT(hyk_first_surface) {
    hyk_vec3 albedo;
    hyk_real depth;
    hyk_vec3 normal;
    hyk_uint material;
    hyk_vec3 position;
    hyk_uint unused;
} HYK_END(hyk_first_surface)

HYK_STRUCT(hyk_scatter) {
    hyk_vec3 emitted;             /* reaches the sensor for sure */
    hyk_uint emitted_component;
    hyk_vec3 emitted_irradiance;
    hyk_uint flags;
    hyk_vec3 diffuse;             /* reaches it if the shadow ray is free */
    hyk_uint diffuse_component;
    hyk_vec3 specular;
    hyk_uint specular_component;
    hyk_vec3 light_irradiance;
    hyk_real unused;
    hyk_ray shadow;
    hyk_path next;
    hyk_first_surface first;
} HYK_END(hyk_scatter)

HYK_STRUCT(hyk_path_settings) {
    hyk_uint strategy, wants;
} HYK_END(hyk_path_settings)

/* Rays that leave a surface meet it at t = 0 when it is an axis plane through 0, where no rounding moves them off it:
   they begin a little after 0, where no float on a surface is. Not at the very smallest number: its error bound would be
   denormal, and a denormal result costs a hundred cycles. */
#define HYK_AFTER_START HYK_C(1.0e-30)

/* Random pairs: two for the sensor, then four a vertex. */
#define HYK_PAIR_FILM 0u
#define HYK_PAIR_LENS 1u
HYK_FN hyk_uint hyk_pair_of(hyk_path path, hyk_uint which) { return 2u + 4u * path.bounce + which; }

HYK_FN hyk_uint hyk_component_of_emission(hyk_uint flags) {
    if ((flags & HYK_PATH_DIFFUSE_TWICE) != 0u) return HYK_COMPONENT_INDIRECT;
    if ((flags & HYK_PATH_DIFFUSE) != 0u && (flags & HYK_PATH_SPECULAR_LAST) != 0u) return HYK_COMPONENT_CAUSTIC;
    return HYK_COMPONENT_DIRECT;
}
HYK_FN hyk_uint hyk_component_of_diffuse(hyk_uint flags) {
    return (flags & HYK_PATH_DIFFUSE) != 0u ? HYK_COMPONENT_INDIRECT : HYK_COMPONENT_DIRECT;
}
HYK_FN hyk_uint hyk_component_of_specular(hyk_uint flags) {
    return hyk_component_of_emission(flags | HYK_PATH_SPECULAR_LAST);
}

/* Weight of light met by a BSDF's ray, against the light sampling that could have found it with pdf light_pdf. */
HYK_FN hyk_real hyk_emission_weight(hyk_path_settings settings, hyk_real bsdf_pdf, hyk_real light_pdf) {
    if (bsdf_pdf == 0.0f || light_pdf == 0.0f || settings.strategy == HYK_STRATEGY_BSDF) return 1.0f;
    if (settings.strategy == HYK_STRATEGY_LIGHTS) return 0.0f;
    return hyk_power_heuristic(bsdf_pdf, light_pdf);
}
HYK_FN hyk_real hyk_light_weight(hyk_path_settings settings, hyk_bool delta, hyk_real light_pdf, hyk_real bsdf_pdf) {
    if (delta || settings.strategy == HYK_STRATEGY_LIGHTS) return 1.0f;
    if (settings.strategy == HYK_STRATEGY_BSDF) return 0.0f;
    return hyk_power_heuristic(light_pdf, bsdf_pdf);
}

HYK_FN hyk_scatter hyk_no_scatter(void) {
    hyk_scatter r;
    r.emitted = hyk_zero3();
    r.emitted_component = HYK_COMPONENT_DIRECT;
    r.emitted_irradiance = hyk_zero3();
    r.flags = 0u;
    r.diffuse = hyk_zero3();
    r.diffuse_component = HYK_COMPONENT_DIRECT;
    r.specular = hyk_zero3();
    r.specular_component = HYK_COMPONENT_DIRECT;
    r.light_irradiance = hyk_zero3();
    r.unused = 0.0f;
    return r;
}

HYK_FN hyk_scatter hyk_add_emission(hyk_scatter r, hyk_path_settings settings, hyk_path path, hyk_vec3 radiance, hyk_real light_pdf) {
    hyk_vec3 weighted = hyk_scale(radiance, hyk_emission_weight(settings, path.pdf, light_pdf));
    r.emitted = hyk_add(r.emitted, hyk_mul(path.throughput, weighted));
    if ((path.flags & HYK_PATH_IRRADIANCE) != 0u)
        r.emitted_irradiance = hyk_add(r.emitted_irradiance, hyk_mul(path.irradiance, weighted));
    return r;
}

/* What a ray that hit nothing brings: suns and environment. */
HYK_FN hyk_scatter hyk_escape(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_uint features) {
    hyk_scatter r = hyk_no_scatter();
    r.emitted_component = hyk_component_of_emission(path.flags);
    hyk_bool both = (path.flags & HYK_PATH_BOTH_SIDES) != 0u;
    hyk_bool seen = (path.flags & HYK_PATH_FROM_SENSOR) != 0u;
    if (HYK_HAS(features, HYK_NEEDS_SUNS)) {
        hyk_uint first = HYK_CONSTANTS(view).finite_lights;
        for (hyk_uint i = first; i < first + HYK_CONSTANTS(view).suns; i++) {
            hyk_light sun = HYK_LOAD_LIGHT(view, i);
            hyk_vec3 radiance = hyk_sun_radiance(sun, path.ray.direction);
            if (hyk_is_black(radiance) || (seen && (sun.flags & HYK_LIGHT_HIDDEN) != 0u)) continue;
            hyk_real pdf = path.pdf > 0.0f ? hyk_pdf_infinite(view, i, path.vertex, path.normal, both, path.ray.direction, features) : 0.0f;
            r = hyk_add_emission(r, settings, path, radiance, pdf);
        }
    }
    if (HYK_HAS(features, HYK_NEEDS_ENVIRONMENT)) {
        hyk_real pdf = path.pdf > 0.0f ? hyk_pdf_infinite(view, HYK_NONE, path.vertex, path.normal, both, path.ray.direction, features) : 0.0f;
        r = hyk_add_emission(r, settings, path, hyk_environment_radiance(view, path.ray.direction, features), pdf);
    }
    return r;
}

/* A light's own shape was hit. It reflects nothing, so the path ends. */
HYK_FN hyk_scatter hyk_meet_shape(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_hit hit, hyk_uint features) {
    hyk_scatter r = hyk_no_scatter();
    hyk_light light = HYK_LOAD_LIGHT(view, hit.primitive);
    hyk_vec3 n = hyk_shape_normal(light, hyk_add_scaled(path.ray.origin, path.ray.direction, hit.t));
    hyk_vec3 radiance = hyk_shape_radiance(light, n, path.ray.direction);
    r.emitted_component = hyk_component_of_emission(path.flags);
    hyk_real pdf = 0.0f;
    if (path.pdf > 0.0f && !hyk_is_black(radiance))
        pdf = hyk_pdf_light(view, hit.primitive, path.vertex, path.normal, (path.flags & HYK_PATH_BOTH_SIDES) != 0u,
                            path.ray.direction, hit.t, n, features);
    r = hyk_add_emission(r, settings, path, radiance, pdf);
    if ((path.flags & HYK_PATH_FROM_SENSOR) != 0u) {
        r.flags |= HYK_SCATTER_SURFACE;
        r.first.albedo = hyk_zero3();
        r.first.depth = hit.t;
        r.first.normal = hyk_dot(n, path.ray.direction) > 0.0f ? hyk_neg(n) : n;
        r.first.position = hyk_add_scaled(path.ray.origin, path.ray.direction, hit.t);
        r.first.material = HYK_NONE;
        r.first.unused = 0u;
    }
    return r;
}

/* Radiance that a surface of the scene emits against the path, weighted. */
HYK_FN hyk_scatter hyk_meet_emitter(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_hit hit, hyk_surface s,
                                    hyk_material material, hyk_uint features) {
    if ((material.flags & HYK_MATERIAL_EMITS) == 0u || !(s.front || (material.flags & HYK_MATERIAL_EMITS_BOTH_SIDES) != 0u)) return r;
    hyk_instance placed = HYK_LOAD_INSTANCE(view, hit.instance);
    hyk_real pdf = 0.0f;
    if (HYK_HAS(features, HYK_NEEDS_EMITTERS) && path.pdf > 0.0f && placed.first_light != HYK_NONE) {
        hyk_uint slot = hit.primitive;
        if ((HYK_LOAD_MESH(view, placed.mesh).flags & HYK_MESH_LIGHT_SLOTS) != 0u) slot = HYK_LOAD_LIGHT_SLOT(view, placed.mesh, slot);
        if (slot != HYK_NONE)
            pdf = hyk_pdf_light(view, placed.first_light + slot, path.vertex, path.normal, (path.flags & HYK_PATH_BOTH_SIDES) != 0u,
                                path.ray.direction, hit.t, s.front ? s.geometric : hyk_neg(s.geometric), features);
    }
    return hyk_add_emission(r, settings, path, material.emission, pdf);
}

/* Alpha that blends asks a hash of the ray (alpha.h), so rays that are the same in all but their sample must differ in
   something: in how far beyond everything they end, or in the length of a direction that need not be unit. */
HYK_FN hyk_real hyk_salt(hyk_sampler random, hyk_uint which) { return hyk_unit_real(hyk_hash2(hyk_hash2(random.seed, random.index), random.pixel ^ which)); }
HYK_FN hyk_real hyk_salted_infinity(hyk_sampler random, hyk_uint which, hyk_uint features) {
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA)) return HYK_REAL_MAX;
    return HYK_REAL_MAX * (1.0f - 0.125f * hyk_salt(random, which));
}

/* From one offset point to a sampled light point, itself moved off its surface; or to infinity. */
HYK_FN hyk_ray hyk_shadow_ray(hyk_vec3 origin, hyk_light_sample light, hyk_path path, hyk_uint features) {
    hyk_ray r;
    r.origin = origin;
    r.t_min = HYK_AFTER_START;
    r.direction = light.direction;
    r.t_max = hyk_salted_infinity(path.random, path.bounce, features);
    if (light.distance >= HYK_REAL_MAX) return r;
    hyk_vec3 target = light.position;
    if ((light.flags & HYK_SAMPLE_SURFACE) != 0u) {
        hyk_real side = hyk_dot(light.normal, light.direction) > 0.0f ? -1.0f : 1.0f;
        hyk_real error = hyk_gamma(16.0f) * hyk_dot(hyk_abs3(light.normal), hyk_abs3(target));
        target = hyk_offset_point(target, hyk_scale(light.normal, side), error);
    }
    r.direction = hyk_sub(target, origin);
    /* The last 2^-12 of the way is left out: a curved light's surface is known no better near its rim. */
    r.t_max = HYK_C(1.0 - 1.0 / 4096.0);
    if (!HYK_HAS(features, HYK_NEEDS_ALPHA)) return r;
    hyk_real longer = 1.0f + hyk_salt(path.random, path.bounce);
    r.direction = hyk_scale(r.direction, longer);
    r.t_max = r.t_max / longer;
    return r;
}

/* Light sampling at s: the contributions if nothing is in the way, and the ray that finds out. */
HYK_FN hyk_scatter hyk_sample_direct(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_bsdf bsdf,
                                     hyk_frame frame, hyk_vec3 wo, hyk_uint features) {
    hyk_bool both = hyk_bsdf_transmits(bsdf);
    hyk_real select = hyk_sample_pair(path.random, hyk_pair_of(path, 1u)).y;
    hyk_light_sample light = hyk_sample_lights(view, s.position, s.shading, both, select, hyk_sample_pair(path.random, hyk_pair_of(path, 2u)), features);
    if ((light.flags & HYK_SAMPLE_VALID) == 0u || !(light.pdf > 0.0f)) return r;
    hyk_vec3 wi = hyk_to_local(frame, light.direction);
    hyk_real side = hyk_dot(light.direction, s.geometric);
    if (wi.z * side <= 0.0f || (wi.z < 0.0f && !both)) return r;
    hyk_bsdf_value f = hyk_bsdf_eval(view, bsdf, wo, wi, features);
    hyk_real weight = hyk_light_weight(settings, (light.flags & HYK_SAMPLE_DELTA) != 0u, light.pdf, f.pdf) / light.pdf;
    hyk_vec3 incoming = hyk_scale(light.radiance, weight);
    hyk_vec3 arriving = hyk_mul(path.throughput, incoming);
    r.diffuse = hyk_mul(arriving, f.diffuse);
    r.specular = hyk_mul(arriving, f.specular);
    r.diffuse_component = hyk_component_of_diffuse(path.flags);
    r.specular_component = hyk_component_of_specular(path.flags);
    if ((settings.wants & HYK_WANTS_IRRADIANCE) != 0u) {
        if ((path.flags & HYK_PATH_IRRADIANCE) != 0u)
            r.light_irradiance = hyk_mul(path.irradiance, hyk_mul(incoming, hyk_add(f.diffuse, f.specular)));
        else if ((path.flags & HYK_PATH_NO_IRRADIANCE) == 0u && hyk_bsdf_has_diffuse(bsdf) && wi.z > 0.0f)
            r.light_irradiance = hyk_mul(path.irradiance, hyk_scale(incoming, wi.z));
    }
    if (hyk_is_black(r.diffuse) && hyk_is_black(r.specular) && hyk_is_black(r.light_irradiance)) return r;
    hyk_vec3 n = side > 0.0f ? s.geometric : hyk_neg(s.geometric);
    r.shadow = hyk_shadow_ray(hyk_offset_point(s.position, n, s.error), light, path, features);
    r.flags |= HYK_SCATTER_SHADOW;
    return r;
}

/* Probability of going on: the share of light the path still carries. Not before the fourth vertex; and below 1 from the
   64th on, so that light in a lossless trap ends too. Not earlier: weights that grow while nothing is lost are noise. */
HYK_FN hyk_real hyk_survival(hyk_path path) {
    if (path.bounce < 4u) return 1.0f;
    return hyk_clamp(hyk_max3(path.throughput) * path.eta_scale, HYK_C(0.02), path.bounce < 64u ? 1.0f : HYK_C(0.999));
}

/* The part of a sampled scattering that is followed. The whole of it, unless components are told apart: then either the
   diffuse or the specular part, by their luminance, so that each part is estimated without bias. */
HYK_FN hyk_vec3 hyk_choose_part(hyk_bsdf_sample sampled, hyk_bool split, hyk_bool diffuse) {
    if (!split) return hyk_add(sampled.diffuse, sampled.specular);
    hyk_real d = hyk_luminance(sampled.diffuse), s = hyk_luminance(sampled.specular);
    if (diffuse) return hyk_scale(sampled.diffuse, (d + s) / d);
    return hyk_scale(sampled.specular, (d + s) / s);
}

HYK_FN hyk_uint hyk_scatter_flags(hyk_uint flags, hyk_bool diffuse) {
    hyk_uint f = flags & ~(HYK_PATH_FROM_SENSOR | HYK_PATH_BOTH_SIDES | HYK_PATH_SPECULAR_LAST | HYK_PATH_POINT | HYK_PATH_LEFT_POINT);
    if (!diffuse) return f | HYK_PATH_SPECULAR_LAST;
    if ((f & HYK_PATH_DIFFUSE) != 0u) f |= HYK_PATH_DIFFUSE_TWICE;
    return f | HYK_PATH_DIFFUSE;
}

/* Throughput since the surface whose irradiance is asked for; this vertex may be that surface. */
HYK_FN hyk_path hyk_follow_irradiance(hyk_path next, hyk_path path, hyk_bsdf bsdf, hyk_bsdf_sample sampled) {
    if ((path.flags & HYK_PATH_IRRADIANCE) != 0u) {
        next.irradiance = hyk_mul(path.irradiance, hyk_add(sampled.diffuse, sampled.specular));
        return next;
    }
    if (hyk_bsdf_is_delta_only(bsdf)) return next;
    hyk_bool given = hyk_bsdf_has_diffuse(bsdf) && (sampled.flags & (HYK_LOBE_DELTA | HYK_LOBE_TRANSMIT)) == 0u;
    if (!given || (path.flags & HYK_PATH_NO_IRRADIANCE) != 0u) {
        next.flags |= HYK_PATH_NO_IRRADIANCE;
        return next;
    }
    next.flags |= HYK_PATH_IRRADIANCE;
    next.irradiance = hyk_scale(path.irradiance, sampled.wi.z / sampled.pdf);
    return next;
}

/* The path after scattering at s, or no continuation. */
HYK_FN hyk_scatter hyk_sample_next(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_material material,
                                   hyk_bsdf bsdf, hyk_frame frame, hyk_vec3 wo, hyk_uint features) {
    hyk_real u_lobe = hyk_sample_pair(path.random, hyk_pair_of(path, 1u)).x;
    hyk_bsdf_sample sampled = hyk_bsdf_sample_direction(view, bsdf, wo, u_lobe, hyk_sample_pair(path.random, hyk_pair_of(path, 0u)), features);
    if (!(sampled.pdf > 0.0f)) return r;
    hyk_vec3 direction = hyk_normalize(hyk_to_world(frame, sampled.wi));
    hyk_real side = hyk_dot(direction, s.geometric);
    if (side * sampled.wi.z <= 0.0f) return r; /* the shading normal promised a side that the face does not have */
    hyk_vec2 u = hyk_sample_pair(path.random, hyk_pair_of(path, 3u));
    hyk_real d = hyk_luminance(sampled.diffuse), sp = hyk_luminance(sampled.specular);
    hyk_bool split = (settings.wants & HYK_WANTS_COMPONENTS) != 0u && d > 0.0f && sp > 0.0f;
    hyk_bool diffuse = split ? u.y * (d + sp) < d : d > sp;
    hyk_path next = path;
    next.throughput = hyk_mul(path.throughput, hyk_choose_part(sampled, split, diffuse));
    if (hyk_is_black(next.throughput)) return r;
    next.flags = hyk_scatter_flags(path.flags, diffuse);
    if (hyk_bsdf_transmits(bsdf)) next.flags |= HYK_PATH_BOTH_SIDES;
    if ((path.flags & HYK_PATH_POINT) != 0u) next.flags |= HYK_PATH_LEFT_POINT;
    else next.depth_left = path.depth_left - 1u;
    next.bounce = path.bounce + 1u;
    next.pdf = (sampled.flags & HYK_LOBE_DELTA) != 0u ? 0.0f : sampled.pdf;
    next.normal = s.shading;
    next.vertex = s.position;
    if ((settings.wants & HYK_WANTS_IRRADIANCE) != 0u) next = hyk_follow_irradiance(next, path, bsdf, sampled);
    if (HYK_HAS(features, HYK_NEEDS_TRANSMISSION) && (sampled.flags & HYK_LOBE_TRANSMIT) != 0u && (material.flags & HYK_MATERIAL_THIN) == 0u)
        next.eta_scale = path.eta_scale * (s.front ? hyk_square(material.ior) : 1.0f / hyk_square(material.ior));
    if ((sampled.flags & HYK_LOBE_DIFFUSE) != 0u) next.cone_spread = hyk_max(path.cone_spread, HYK_C(0.1));
    else if ((sampled.flags & HYK_LOBE_GLOSSY) != 0u) next.cone_spread = hyk_max(path.cone_spread, HYK_C(0.1) * hyk_square(material.roughness));
    hyk_real survival = hyk_survival(next);
    if (u.x >= survival) return r;
    next.throughput = hyk_scale(next.throughput, 1.0f / survival);
    next.irradiance = hyk_scale(next.irradiance, 1.0f / survival);
    next.ray.origin = hyk_offset_point(s.position, side > 0.0f ? s.geometric : hyk_neg(s.geometric), s.error);
    next.ray.direction = direction;
    next.ray.t_min = HYK_AFTER_START;
    next.ray.t_max = hyk_salted_infinity(path.random, next.bounce, features);
    r.next = next;
    r.flags |= HYK_SCATTER_CONTINUES;
    return r;
}

/* Light sampling and continuation at a surface. */
HYK_FN hyk_scatter hyk_scatter_at(hyk_view view, hyk_path_settings settings, hyk_scatter r, hyk_path path, hyk_surface s, hyk_material material,
                                  hyk_uint features) {
    hyk_bsdf bsdf = hyk_make_bsdf(view, material, s.front, features);
    hyk_frame frame = hyk_make_frame(s.shading);
    hyk_vec3 wo = hyk_to_local(frame, hyk_neg(path.ray.direction));
    if ((path.flags & HYK_PATH_FROM_SENSOR) != 0u && (settings.wants & HYK_WANTS_SURFACE) != 0u) {
        r.flags |= HYK_SCATTER_SURFACE;
        r.first.albedo = hyk_bsdf_albedo(view, bsdf, wo, features);
        r.first.normal = s.shading;
        r.first.position = s.position;
        r.first.material = s.material;
        r.first.unused = 0u;
    }
    if (path.depth_left == 0u && (path.flags & HYK_PATH_POINT) == 0u) return r;
    const hyk_uint any_light = HYK_NEEDS_EMITTERS | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT;
    if (HYK_HAS(features, any_light) && !hyk_bsdf_is_delta_only(bsdf))
        r = hyk_sample_direct(view, settings, r, path, s, bsdf, frame, wo, features);
    return hyk_sample_next(view, settings, r, path, s, material, bsdf, frame, wo, features);
}

/* Vertex of a path where its ray ended: hit.instance HYK_NONE: nowhere. */
HYK_FN hyk_scatter hyk_shade(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_hit hit, hyk_uint features) {
    if (hit.instance == HYK_NONE) return hyk_escape(view, settings, path, features);
    if (HYK_HAS(features, HYK_NEEDS_SHAPES) && hit.instance == HYK_HIT_SHAPE) return hyk_meet_shape(view, settings, path, hit, features);
    path.cone_width += path.cone_spread * hit.t;
    hyk_surface s = hyk_surface_at(view, hit, path.ray.direction, path.cone_width, features);
    hyk_material material = hyk_material_at(view, s, path.cone_width, features);
    if (HYK_HAS(features, HYK_NEEDS_ABSORPTION) && !s.front && (material.flags & HYK_MATERIAL_ABSORBS) != 0u) {
        hyk_vec3 passed = hyk_make3(hyk_exp(-material.absorption.x * hit.t), hyk_exp(-material.absorption.y * hit.t),
                                    hyk_exp(-material.absorption.z * hit.t));
        path.throughput = hyk_mul(path.throughput, passed);
        path.irradiance = hyk_mul(path.irradiance, passed);
    }
    hyk_scatter r = hyk_no_scatter();
    r.first.depth = hit.t;
    r.emitted_component = hyk_component_of_emission(path.flags);
    r = hyk_meet_emitter(view, settings, r, path, hit, s, material, features);
    if ((path.flags & HYK_PATH_LEFT_POINT) != 0u && !s.front && (material.flags & HYK_MATERIAL_TRANSMITS) == 0u) r.flags |= HYK_SCATTER_INSIDE;
    return hyk_scatter_at(view, settings, r, path, s, material, features);
}

HYK_FN hyk_path hyk_begin_path(hyk_ray ray, hyk_sampler random, hyk_uint lane, hyk_uint max_depth, hyk_real cone_width, hyk_real cone_spread) {
    hyk_path p;
    p.ray = ray;
    p.throughput = hyk_splat(1.0f);
    p.pdf = 0.0f;
    p.normal = ray.direction;
    p.vertex = ray.origin;
    p.unused0 = 0u;
    p.unused1 = 0u;
    p.unused2 = 0u;
    p.unused3 = 0u;
    p.unused4 = 0u;
    p.flags = HYK_PATH_FROM_SENSOR;
    p.irradiance = hyk_splat(1.0f);
    p.depth_left = max_depth;
    p.random = random;
    p.bounce = 0u;
    p.cone_width = cone_width;
    p.cone_spread = cone_spread;
    p.eta_scale = 1.0f;
    p.lane = lane;
    return p;
}

/* The first vertex of a path from a sensor's point: white Lambert, so that radiance is irradiance over pi. The point is the
   caller's, rounded in ways unknown: 32 roundings of its coordinates are allowed for. */
HYK_FN hyk_scatter hyk_shade_point(hyk_view view, hyk_path_settings settings, hyk_path path, hyk_vec3 position, hyk_vec3 normal,
                                   hyk_uint features) {
    hyk_surface s;
    s.position = position;
    s.error = hyk_gamma(32.0f) * hyk_dot(hyk_abs3(normal), hyk_abs3(position));
    s.geometric = normal;
    s.shading = normal;
    s.uv = hyk_make2(0.0f, 0.0f);
    s.uv_scale = 0.0f;
    s.material = HYK_NONE;
    s.front = true;
    hyk_material white;
    white.base_color = hyk_splat(1.0f);
    white.metallic = 0.0f;
    white.emission = hyk_zero3();
    white.roughness = 1.0f;
    white.absorption = hyk_zero3();
    white.ior = 1.5f;
    white.eta = hyk_zero3();
    white.transmission = 0.0f;
    white.k = hyk_zero3();
    white.alpha_cutoff = 0.5f;
    white.kind = HYK_MATERIAL_LAMBERT;
    white.flags = 0u;
    white.energy_table = HYK_NONE;
    white.normal_scale = 1.0f;
    white.base_color_texture = HYK_NONE;
    white.metallic_roughness_texture = HYK_NONE;
    white.normal_texture = HYK_NONE;
    white.emission_texture = HYK_NONE;
    white.alpha_texture = HYK_NONE;
    white.alpha = 1.0f;
    white.clearcoat = 0.0f;
    white.clearcoat_roughness = 0.0f;
    hyk_scatter r = hyk_no_scatter();
    r.first.depth = 0.0f;
    path.flags |= HYK_PATH_POINT;
    path.ray.direction = hyk_neg(normal);
    return hyk_scatter_at(view, settings, r, path, s, white, features);
}

#endif /* HYK_PATH_H */

/* >>shared-passes: what passes over a pool of lanes hand to each other, and how a lane begins

   A lane is one sample of one pixel. Its path, its hit, its shadow ray and its result stand at the lane's number in one
   buffer each; which lanes are at work stands in queues of lane numbers. */
#ifndef HYK_PASSES_H
#define HYK_PASSES_H

/* All that the samples of a picture depend on beside the scene. */
HYK_STRUCT(hyk_picture) {
    hyk_camera camera;
    hyk_path_settings settings;
    hyk_uint max_depth;
    hyk_uint tile_pixels;
    hyk_uint tile_width;
    hyk_uint tile_is_square;
    hyk_uint seed_even, seed_odd;      /* of the two halves of the samples */
    hyk_uint left, top, right, bottom; /* pixels outside are not traced */
} HYK_END(hyk_picture)
HYK_SIZE_IS(hyk_picture, 144)

/* Some samples of all pixels of a tile; sample s of pixel p is lane p * samples + s of the unit's lanes. */
HYK_STRUCT(hyk_unit) {
    hyk_uint tile_x, tile_y; /* its first pixel */
    hyk_uint first_sample, samples;
} HYK_END(hyk_unit)
HYK_SIZE_IS(hyk_unit, 16)

#define HYK_LANE_USED 1u   /* the pixel is inside the picture */
#define HYK_LANE_HIT 2u    /* the sensor's ray met something, or the sensor is a point */
#define HYK_LANE_INSIDE 4u /* the first ray from a sensor's point met a back face */

/* What a device gives back of a lane: its radiance, or the first part of it where components are told apart. */
HYK_STRUCT(hyk_lane_radiance) {
    hyk_vec3 radiance;
    hyk_uint flags;
} HYK_END(hyk_lane_radiance)
HYK_SIZE_IS(hyk_lane_radiance, 16)

/* The rest, where it is wanted: the parts after the first, and what the sensor's ray met. */
HYK_STRUCT(hyk_lane_extra) {
    hyk_vec3 indirect;
    hyk_uint instance;
    hyk_vec3 caustic;
    hyk_uint primitive;
    hyk_vec3 irradiance;
    hyk_uint unused;
    hyk_first_surface first;
} HYK_END(hyk_lane_extra)
HYK_SIZE_IS(hyk_lane_extra, 96)

/* A shadow ray, and what its lane gets if nothing is in the way. */
HYK_STRUCT(hyk_shadow) {
    hyk_ray ray;
    hyk_vec3 diffuse;
    hyk_uint diffuse_component;
    hyk_vec3 specular;
    hyk_uint specular_component;
    hyk_vec3 irradiance;
    hyk_uint unused;
} HYK_END(hyk_shadow)
HYK_SIZE_IS(hyk_shadow, 80)

/* ---- a device's buffers for them, set 1 */

#define HYK_BINDING_PICTURE 0
#define HYK_BINDING_UNITS 1
#define HYK_BINDING_SENSOR 2   /* POINTS: position and normal of each; RAYS: hyk_ray each */
#define HYK_BINDING_COUNTS 3
#define HYK_BINDING_QUEUES 4   /* three of them, pool_lanes long each: paths, paths, shadow rays */
#define HYK_BINDING_PATHS 5
#define HYK_BINDING_HITS 6
#define HYK_BINDING_SHADOWS 7
#define HYK_BINDING_RADIANCE 8
#define HYK_BINDING_EXTRAS 9
#define HYK_PASS_BINDINGS 10

#define HYK_GROUP 64u /* lanes of a workgroup */

/* What trace.comp is made for; odd: any hit does. */
#define HYK_TRACE_PATHS 0u
#define HYK_TRACE_SHADOWS 1u
#define HYK_TRACE_RAYS 2u        /* of the caller: SENSOR to HITS */
#define HYK_TRACE_RAYS_ANY 3u    /* SENSOR to QUEUES: 1 or 0 for each */

/* Arguments of an indirect dispatch: workgroups. */
HYK_STRUCT(hyk_groups) {
    hyk_uint x, y, z, unused;
} HYK_END(hyk_groups)

/* How many lanes are in each queue. Shading appends to paths_next and shadows_next; the arguments pass makes them the
   counts of the passes that follow. */
HYK_STRUCT(hyk_counts) {
    hyk_groups path_groups, shadow_groups;
    hyk_uint paths, shadows;
    hyk_uint paths_next, shadows_next;
    hyk_uint rays_path, rays_shadow; /* of the batch so far */
    hyk_uint front;                  /* queue of paths that is read now: 0 or 1 */
    hyk_uint unused;
} HYK_END(hyk_counts)
HYK_SIZE_IS(hyk_counts, 64)

/* Small facts of one dispatch, as push constants. */
HYK_STRUCT(hyk_dispatch) {
    hyk_uint lanes;         /* of all units together, or rays */
    hyk_uint pool_lanes;    /* length of a queue */
    hyk_uint lanes_of_unit; /* at most: its samples are those of the fullest unit */
    hyk_uint unused;
} HYK_END(hyk_dispatch)

/* ---- the first ray of a lane */

/* Even samples belong to one half of the estimate, odd ones to the other: two independent sequences. */
HYK_FN hyk_sampler hyk_lane_sampler(hyk_picture picture, hyk_uint x, hyk_uint y, hyk_uint sample_number) {
    return hyk_make_sampler(x, y, sample_number >> 1, (sample_number & 1u) != 0u ? picture.seed_odd : picture.seed_even);
}

/* A ray as the caller gave it, with a unit direction. */
HYK_FN hyk_ray hyk_callers_ray(hyk_ray given) {
    hyk_real stretch = hyk_length(given.direction);
    hyk_ray ray;
    ray.origin = given.origin;
    ray.direction = hyk_normalize(given.direction);
    ray.t_min = given.t_min * stretch;
    ray.t_max = given.t_max < HYK_REAL_MAX / hyk_max(stretch, 1.0f) ? given.t_max * stretch : HYK_REAL_MAX;
    return ray;
}

HYK_FN hyk_ray hyk_sensor_ray(hyk_camera camera, hyk_uint x, hyk_uint y, hyk_sampler random) {
    hyk_vec2 lens = hyk_make2(0.0f, 0.0f);
    if (camera.kind == HYK_SENSOR_THIN_LENS) lens = hyk_sample_pair(random, HYK_PAIR_LENS);
    return hyk_camera_ray(camera, hyk_film_point(camera, x, y, hyk_sample_pair(random, HYK_PAIR_FILM)), lens);
}

HYK_FN hyk_path hyk_first_path(hyk_picture picture, hyk_ray ray, hyk_sampler random, hyk_uint lane, hyk_uint features) {
    if (ray.t_max >= HYK_REAL_MAX) ray.t_max = hyk_salted_infinity(random, HYK_NONE, features);
    return hyk_begin_path(ray, random, lane, picture.max_depth, picture.camera.start_width, picture.camera.spread);
}

/* Before the scattering at a sensor's point: no ray yet. */
HYK_FN hyk_path hyk_point_path(hyk_picture picture, hyk_sampler random, hyk_uint lane) {
    hyk_ray none;
    none.origin = hyk_zero3();
    none.t_min = 0.0f;
    none.direction = hyk_zero3();
    none.t_max = 0.0f;
    return hyk_begin_path(none, random, lane, picture.max_depth, 0.0f, picture.camera.spread);
}

/* Where pixel i of a tile lies in it: along the Morton curve where the tile is square, else in rows. */
HYK_FN hyk_uint hyk_tile_column(hyk_uint tile_width, hyk_uint is_square, hyk_uint i) {
    return is_square != 0u ? hyk_morton_even_bits(i) : i % tile_width;
}
HYK_FN hyk_uint hyk_tile_row(hyk_uint tile_width, hyk_uint is_square, hyk_uint i) {
    return is_square != 0u ? hyk_morton_even_bits(i >> 1) : i / tile_width;
}

HYK_FN hyk_bool hyk_picture_holds(hyk_picture picture, hyk_uint x, hyk_uint y) {
    return x >= picture.left && x < picture.right && y >= picture.top && y < picture.bottom;
}

#endif /* HYK_PASSES_H */

/* >>bvh-layout: what a built tree looks like in memory

   Eight-wide nodes: one AVX register holds one plane of all eight children. A leaf has one to eight
   triangles, its nine coordinates each as a row of exactly as many floats as there are triangles: no
   lane is stored that is not used, so the same bytes hold a third more triangles in cache than padded
   blocks do. A reader of eight lanes reads past the end of a row, into the next one, and masks.
   Ids stand apart: only hits look at them. */
#ifndef HYI_BVH_LAYOUT_H
#define HYI_BVH_LAYOUT_H

#define HYI_WIDTH 8u
#define HYI_LEAF_MAX 8u
#define HYI_LEAF_MAX_DEVICE 4u /* where lanes are rays, and triangles are met one after the other */
#define HYI_TREE_DEPTH 56u /* levels of the binary tree, and so of the wide one */
#define HYI_PRIMITIVES_MAX (1u << 28)
#define HYI_EMPTY_PLANE 1.0e38f

/* A child: bit 31 set: a leaf, bits 28..30 its count - 1, bits 0..27 its first slot; clear: a node's index. */
#define HYI_CHILD_LEAF 0x80000000u
#define HYI_CHILD_SLOT 0x0fffffffu
#define HYI_CHILD_NONE 0x7fffffffu

typedef struct hyi_box {
    float lower[3], upper[3];
} hyi_box;

/* Planes in the order lower x, upper x, lower y, upper y, lower z, upper z. Unused children are inside out. */
typedef struct hyi_node {
    float planes[6][HYI_WIDTH];
    uint32_t child[HYI_WIDTH];
    uint32_t unused[HYI_WIDTH]; /* fills the fourth cache line */
} hyi_node;

/* All zero: empty, valid, hit by nothing. Nodes and triangles are in units of 1 / scale, a power of two
   that keeps products of three coordinates inside float's range. */
typedef struct hyi_bvh {
    hyi_node *nodes;
    float *rows;      /* 9 floats a slot; NULL: a tree over boxes */
    uint32_t *ids;    /* by slot: triangle or box */
    uint32_t root;    /* a child */
    uint32_t node_count, slot_count, depth;
    float scale;
    hyi_box scaled;   /* bounds times scale */
    hyi_box bounds;
    uint32_t degenerate;      /* triangles dropped */
    uint32_t primitive_count; /* those in the tree */
    size_t bytes;
} hyi_bvh;

/* Eight lanes read from the last row of the last leaf. */
#define HYI_ROWS_PADDING 8u

HYI_INLINE size_t hyi_bvh_row_floats(uint32_t slots) { return (size_t)slots * 9u + HYI_ROWS_PADDING; }

HYI_INLINE uint32_t hyi_make_leaf(uint32_t first, uint32_t count) {
    return HYI_CHILD_LEAF | ((count - 1u) << 28) | first;
}
HYI_INLINE bool hyi_child_is_leaf(uint32_t child) { return (child & HYI_CHILD_LEAF) != 0u; }
HYI_INLINE uint32_t hyi_leaf_count(uint32_t child) { return ((child >> 28) & 7u) + 1u; }
HYI_INLINE uint32_t hyi_leaf_first(uint32_t child) { return child & HYI_CHILD_SLOT; }

/* Leaves it zeroed. */
HYI_FN void hyi_bvh_free(hydra_context *context, hyi_bvh *bvh) {
    hyi_free_array(context, &bvh->nodes, bvh->node_count);
    if (bvh->rows) hyi_free_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    hyi_free_array(context, &bvh->ids, bvh->slot_count);
    memset(bvh, 0, sizeof *bvh);
}

/* Index of the lowest set bit; mask is not 0. */
HYI_INLINE uint32_t hyi_lowest_bit(uint32_t mask) {
#if HYI_GNU
    return (uint32_t)__builtin_ctz(mask);
#else
    unsigned long index;
    _BitScanForward(&index, mask);
    return (uint32_t)index;
#endif
}

/* ---- boxes */

HYI_INLINE hyi_box hyi_box_empty(void) {
    hyi_box box;
    for (int a = 0; a < 3; a++) {
        box.lower[a] = FLT_MAX;
        box.upper[a] = -FLT_MAX;
    }
    return box;
}

HYI_INLINE void hyi_box_add(hyi_box *box, const float *lower, const float *upper) {
    for (int a = 0; a < 3; a++) {
        box->lower[a] = lower[a] < box->lower[a] ? lower[a] : box->lower[a];
        box->upper[a] = upper[a] > box->upper[a] ? upper[a] : box->upper[a];
    }
}

/* The largest size of a coordinate. */
HYI_INLINE float hyi_box_largest(const hyi_box *box) {
    float largest = 0.0f;
    for (int a = 0; a < 3; a++) {
        largest = fabsf(box->lower[a]) > largest ? fabsf(box->lower[a]) : largest;
        largest = fabsf(box->upper[a]) > largest ? fabsf(box->upper[a]) : largest;
    }
    return largest;
}

/* Half of the surface, in double: squares of the smallest and largest floats stay in range. Empty: 0. */
HYI_INLINE double hyi_box_area(const hyi_box *box) {
    double x = (double)box->upper[0] - (double)box->lower[0];
    double y = (double)box->upper[1] - (double)box->lower[1];
    double z = (double)box->upper[2] - (double)box->lower[2];
    return x < 0.0 ? 0.0 : x * y + y * z + z * x;
}

/* ---- nodes, for whoever does not build or pass them: all that knows how they lie in memory */

/* HYI_CHILD_NONE: there is no such child, nor one behind it. */
HYI_INLINE uint32_t hyi_node_child(const hyi_bvh *bvh, uint32_t node, uint32_t c) { return bvh->nodes[node].child[c]; }

/* In the tree's units. */
HYI_INLINE hyi_box hyi_node_box(const hyi_bvh *bvh, uint32_t node, uint32_t c) {
    hyi_box box;
    for (int a = 0; a < 3; a++) {
        box.lower[a] = bvh->nodes[node].planes[2 * a][c];
        box.upper[a] = bvh->nodes[node].planes[2 * a + 1][c];
    }
    return box;
}

/* Gives the first count children, which are all, new boxes, in the tree's units. */
HYI_INLINE void hyi_node_move(hyi_bvh *bvh, uint32_t node, const hyi_box *boxes, uint32_t count) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t c = 0; c < count; c++) {
            bvh->nodes[node].planes[2 * a][c] = boxes[c].lower[a];
            bvh->nodes[node].planes[2 * a + 1][c] = boxes[c].upper[a];
        }
    }
}

/* Where the first float of a triangle lies in its leaf; the other eight follow at distances of count. */
HYI_INLINE float *hyi_leaf_lane(const hyi_bvh *bvh, uint32_t first, uint32_t lane) { return bvh->rows + 9u * (size_t)first + lane; }

#endif /* HYI_BVH_LAYOUT_H */

/* >>bvh-build-vector: four floats at a time for the builder: boxes as two of them

   What the instruction set of every machine of its kind has: SSE2, NEON, or plain C. Lane 3 is along for
   the ride: nothing that is asked of a box looks at it. */
#ifndef HYI_BVH_BUILD_VECTOR_H
#define HYI_BVH_BUILD_VECTOR_H

#if HYI_X86

typedef __m128 hyi_four;
HYI_INLINE hyi_four hyi_four_all(float x) { return _mm_set1_ps(x); }
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) { return _mm_setr_ps(x, y, z, 0.0f); }
HYI_INLINE hyi_four hyi_four_load(const float *p) { return _mm_loadu_ps(p); }
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { _mm_storeu_ps(p, a); }
HYI_INLINE hyi_four hyi_four_min(hyi_four a, hyi_four b) { return _mm_min_ps(a, b); }
HYI_INLINE hyi_four hyi_four_max(hyi_four a, hyi_four b) { return _mm_max_ps(a, b); }
HYI_INLINE hyi_four hyi_four_add(hyi_four a, hyi_four b) { return _mm_add_ps(a, b); }
HYI_INLINE hyi_four hyi_four_sub(hyi_four a, hyi_four b) { return _mm_sub_ps(a, b); }
HYI_INLINE hyi_four hyi_four_mul(hyi_four a, hyi_four b) { return _mm_mul_ps(a, b); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) { return _mm_shuffle_ps(a, a, _MM_SHUFFLE(3, 0, 2, 1)); }
HYI_INLINE float hyi_four_sum(hyi_four a) {
    return _mm_cvtss_f32(_mm_add_ss(_mm_add_ss(a, _mm_shuffle_ps(a, a, 1)), _mm_movehl_ps(a, a)));
}
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) { _mm_storeu_si128((__m128i *)(void *)to, _mm_cvttps_epi32(a)); }
/* Whether a > b in x, y or z. */
HYI_INLINE bool hyi_four_exceeds(hyi_four a, hyi_four b) { return (_mm_movemask_ps(_mm_cmpgt_ps(a, b)) & 7) != 0; }

#elif HYI_NEON

typedef float32x4_t hyi_four;
HYI_INLINE hyi_four hyi_four_all(float x) { return vdupq_n_f32(x); }
HYI_INLINE hyi_four hyi_four_load(const float *p) { return vld1q_f32(p); }
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) {
    const float lanes[4] = {x, y, z, 0.0f};
    return vld1q_f32(lanes);
}
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { vst1q_f32(p, a); }
HYI_INLINE hyi_four hyi_four_min(hyi_four a, hyi_four b) { return vminq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_max(hyi_four a, hyi_four b) { return vmaxq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_add(hyi_four a, hyi_four b) { return vaddq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_sub(hyi_four a, hyi_four b) { return vsubq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_mul(hyi_four a, hyi_four b) { return vmulq_f32(a, b); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) { return vsetq_lane_f32(vgetq_lane_f32(a, 0), vextq_f32(a, a, 1), 2); }
HYI_INLINE float hyi_four_sum(hyi_four a) { return vgetq_lane_f32(a, 0) + vgetq_lane_f32(a, 1) + vgetq_lane_f32(a, 2); }
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) { vst1q_s32(to, vcvtq_s32_f32(a)); }
HYI_INLINE bool hyi_four_exceeds(hyi_four a, hyi_four b) {
    uint32x4_t more = vcgtq_f32(a, b);
    return (vgetq_lane_u32(more, 0) | vgetq_lane_u32(more, 1) | vgetq_lane_u32(more, 2)) != 0u;
}

#else

typedef struct hyi_four {
    float f[4];
} hyi_four;
#define HYI_FOUR_OP(name, expression)                                     \
    HYI_INLINE hyi_four name(hyi_four a, hyi_four b) {                    \
        hyi_four r;                                                       \
        for (int i = 0; i < 4; i++) r.f[i] = (expression);                \
        return r;                                                         \
    }
HYI_FOUR_OP(hyi_four_min, a.f[i] < b.f[i] ? a.f[i] : b.f[i])
HYI_FOUR_OP(hyi_four_max, a.f[i] > b.f[i] ? a.f[i] : b.f[i])
HYI_FOUR_OP(hyi_four_add, a.f[i] + b.f[i])
HYI_FOUR_OP(hyi_four_sub, a.f[i] - b.f[i])
HYI_FOUR_OP(hyi_four_mul, a.f[i] * b.f[i])
#undef HYI_FOUR_OP
HYI_INLINE hyi_four hyi_four_make(float x, float y, float z) {
    hyi_four r;
    r.f[0] = x;
    r.f[1] = y;
    r.f[2] = z;
    r.f[3] = 0.0f;
    return r;
}
HYI_INLINE hyi_four hyi_four_all(float x) {
    hyi_four r = hyi_four_make(x, x, x);
    r.f[3] = x;
    return r;
}
HYI_INLINE hyi_four hyi_four_load(const float *p) {
    hyi_four r = hyi_four_make(p[0], p[1], p[2]);
    r.f[3] = p[3];
    return r;
}
HYI_INLINE void hyi_four_store(float *p, hyi_four a) { memcpy(p, a.f, sizeof a.f); }
HYI_INLINE hyi_four hyi_four_turn(hyi_four a) {
    hyi_four r = hyi_four_make(a.f[1], a.f[2], a.f[0]);
    r.f[3] = a.f[3];
    return r;
}
HYI_INLINE float hyi_four_sum(hyi_four a) { return a.f[0] + a.f[1] + a.f[2]; }
HYI_INLINE void hyi_four_truncate(hyi_four a, int32_t *to) {
    for (int i = 0; i < 4; i++) to[i] = (int32_t)a.f[i];
}
HYI_INLINE bool hyi_four_exceeds(hyi_four a, hyi_four b) { return a.f[0] > b.f[0] || a.f[1] > b.f[1] || a.f[2] > b.f[2]; }

#endif

HYI_INLINE hyi_four hyi_four_abs(hyi_four a) { return hyi_four_max(a, hyi_four_sub(hyi_four_all(0.0f), a)); }

/* Keeps a value as rounded, so that it is the same wherever it is computed again: see hyi_rounded. */
HYI_INLINE hyi_four hyi_four_rounded(hyi_four a) {
#if HYI_GNU && HYI_X86
    __asm__("" : "+x"(a));
#elif HYI_GNU && HYI_NEON
    __asm__("" : "+w"(a));
#elif !HYI_X86 && !HYI_NEON
    for (int i = 0; i < 4; i++) a.f[i] = hyi_rounded(a.f[i]);
#endif
    return a;
}

/* ---- boxes */

typedef struct hyi_bounds {
    hyi_four lower, upper;
} hyi_bounds;

HYI_INLINE hyi_bounds hyi_bounds_empty(void) {
    hyi_bounds b;
    b.lower = hyi_four_all(HYI_EMPTY_PLANE);
    b.upper = hyi_four_all(-HYI_EMPTY_PLANE);
    return b;
}

HYI_INLINE void hyi_bounds_add(hyi_bounds *b, hyi_four lower, hyi_four upper) {
    b->lower = hyi_four_min(b->lower, lower);
    b->upper = hyi_four_max(b->upper, upper);
}

HYI_INLINE void hyi_bounds_meet(hyi_bounds *b, const hyi_bounds *with) {
    b->lower = hyi_four_max(b->lower, with->lower);
    b->upper = hyi_four_min(b->upper, with->upper);
}

HYI_INLINE bool hyi_bounds_are_empty(const hyi_bounds *b) { return hyi_four_exceeds(b->lower, b->upper); }

/* Half of the surface; of an empty box 0. Coordinates are scaled: what gets lost in float is too small to matter. */
HYI_INLINE float hyi_bounds_area(const hyi_bounds *b) {
    hyi_four size = hyi_four_max(hyi_four_sub(b->upper, b->lower), hyi_four_all(0.0f));
    return hyi_four_sum(hyi_four_mul(size, hyi_four_turn(size)));
}

HYI_INLINE float hyi_bounds_area_with(const hyi_bounds *b, hyi_four lower, hyi_four upper) {
    hyi_bounds grown = *b;
    hyi_bounds_add(&grown, lower, upper);
    return hyi_bounds_area(&grown);
}

HYI_INLINE void hyi_bounds_store(const hyi_bounds *b, float *lower, float *upper) {
    float lanes[4];
    hyi_four_store(lanes, b->lower);
    memcpy(lower, lanes, 3 * sizeof *lower);
    hyi_four_store(lanes, b->upper);
    memcpy(upper, lanes, 3 * sizeof *upper);
}

HYI_INLINE hyi_bounds hyi_bounds_load(const float *lower, const float *upper) {
    hyi_bounds b;
    b.lower = hyi_four_make(lower[0], lower[1], lower[2]);
    b.upper = hyi_four_make(upper[0], upper[1], upper[2]);
    return b;
}

#endif /* HYI_BVH_BUILD_VECTOR_H */

/* >>bvh-build-refs: the primitives of a build: boxes and ids, degenerate triangles dropped */
#ifndef HYI_BVH_BUILD_REFS_H
#define HYI_BVH_BUILD_REFS_H

/* Work is cut into pieces of this many primitives whatever the number of threads: same pieces, same tree. */
#define HYI_BUILD_CHUNK 4096u

/* References that spatial splits may add, in percent of the triangles: memory for them is known before the build. */
#define HYI_BUILD_EXTRA_PERCENT 40u

/* A primitive, or with spatial splits the part of one that lies in a cell. Lane 3 of lower holds the id, made
   a float of moderate size so that arithmetic on all lanes never meets a denormal there. */
typedef struct hyi_ref {
    float lower[4], upper[4];
} hyi_ref;
#define HYI_REF_ID_BITS 0x40000000u

/* A node of the binary tree that the wide one is made from. */
typedef struct hyi_build_node {
    float lower[3];
    uint32_t first; /* inner: its left child, the right one follows; leaf: its first reference */
    float upper[3];
    uint32_t count; /* of references; HYI_BUILD_INNER: those it had before it was cut */
} hyi_build_node;
#define HYI_BUILD_INNER 0x80000000u

HYI_INLINE bool hyi_build_is_leaf(const hyi_build_node *node) { return (node->count & HYI_BUILD_INNER) == 0u; }

/* What one chunk of the source has. */
typedef struct hyi_chunk_sum {
    hyi_bounds box, centroids;
    uint32_t kept, first;
} hyi_chunk_sum;

typedef struct hyi_build {
    hydra_context *context;
    const float *positions;   /* triangles */
    const uint32_t *indices;
    const hyi_box *boxes;     /* or boxes */
    uint32_t source_count, ref_count;
    uint32_t capacity;        /* places for references: ref_count and what spatial splits may add */
    uint32_t leaf_max;
    bool best;                /* spatial splits, down to single triangles; leaves are chosen afterwards */
    float scale;
    hyi_ref *refs, *other;    /* other: where ranges are partitioned to */
    hyi_build_node *nodes;
    uint32_t node_capacity;
    struct hyi_cost *costs;   /* of subtrees, by node */
    hyi_chunk_sum *chunks;
    uint32_t chunk_count;
    struct hyi_chunk_split *chunk_splits;
    uint32_t chunk_split_count;
    struct hyi_range *tasks;  /* small ranges, a subtree each */
    uint32_t task_count, task_capacity;
    struct hyi_wide_task *wide_tasks;
    uint32_t wide_task_count, wide_task_capacity;
    hyi_bounds root_box, root_centroids;
    float root_area;
    hyi_bvh *bvh;
} hyi_build;

HYI_INLINE uint32_t hyi_ref_id(const hyi_ref *ref) {
    uint32_t bits;
    memcpy(&bits, &ref->lower[3], sizeof bits);
    return bits & ~HYI_REF_ID_BITS;
}

/* Lane 3 of a box is not its own: the id is set anew. */
HYI_INLINE void hyi_ref_set(hyi_ref *ref, const hyi_bounds *box, uint32_t id) {
    uint32_t bits = id | HYI_REF_ID_BITS;
    hyi_four_store(ref->lower, box->lower);
    hyi_four_store(ref->upper, box->upper);
    memcpy(&ref->lower[3], &bits, sizeof bits);
    ref->upper[3] = 0.0f;
}

HYI_INLINE hyi_bounds hyi_ref_box(const hyi_ref *ref) {
    hyi_bounds box;
    box.lower = hyi_four_load(ref->lower);
    box.upper = hyi_four_load(ref->upper);
    return box;
}

/* Twice the middle. */
HYI_INLINE hyi_four hyi_centroid(const hyi_bounds *box) { return hyi_four_rounded(hyi_four_add(box->lower, box->upper)); }

/* Whether the triangle spans no area: equal corners or a cross product of zero. Differences of floats of
   similar size are exact in double, and so are their products up to the last bits. */
HYI_INLINE bool hyi_triangle_is_degenerate(const float *a, const float *b, const float *c) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
    }
    return e[1] * f[2] == e[2] * f[1] && e[2] * f[0] == e[0] * f[2] && e[0] * f[1] == e[1] * f[0];
}

/* Corner of triangle id of the source. */
HYI_INLINE const float *hyi_source_corner(const hyi_build *build, uint32_t id, uint32_t corner) {
    return build->positions + 3u * (size_t)build->indices[3u * (size_t)id + corner];
}

/* Box of primitive i of the source; false: drop it. */
HYI_INLINE bool hyi_source_box(const hyi_build *build, uint32_t i, hyi_bounds *box) {
    if (build->boxes) {
        *box = hyi_bounds_load(build->boxes[i].lower, build->boxes[i].upper);
        return true;
    }
    const float *a = hyi_source_corner(build, i, 0), *b = hyi_source_corner(build, i, 1), *c = hyi_source_corner(build, i, 2);
    hyi_four p = hyi_four_make(a[0], a[1], a[2]), q = hyi_four_make(b[0], b[1], b[2]), r = hyi_four_make(c[0], c[1], c[2]);
    box->lower = hyi_four_min(hyi_four_min(p, q), r);
    box->upper = hyi_four_max(hyi_four_max(p, q), r);
    return !hyi_triangle_is_degenerate(a, b, c);
}

HYI_INLINE uint32_t hyi_chunks_of(uint32_t count) { return count / HYI_BUILD_CHUNK + (count % HYI_BUILD_CHUNK != 0u); }

HYI_INLINE uint32_t hyi_chunk_end(uint32_t chunk, uint32_t count) {
    uint32_t left = count - chunk * HYI_BUILD_CHUNK;
    return chunk * HYI_BUILD_CHUNK + (left < HYI_BUILD_CHUNK ? left : HYI_BUILD_CHUNK);
}

/* Writes the references of a chunk from its place on, in the source's order, scaled. */
HYI_FN void hyi_fill_chunk(void *argument, uint32_t chunk) {
    hyi_build *build = (hyi_build *)argument;
    hyi_chunk_sum sum;
    sum.box = sum.centroids = hyi_bounds_empty();
    sum.first = build->chunks[chunk].first;
    sum.kept = 0;
    hyi_ref *out = build->refs + sum.first;
    hyi_four scale = hyi_four_all(build->scale);
    uint32_t end = hyi_chunk_end(chunk, build->source_count);
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_bounds box;
        if (!hyi_source_box(build, i, &box)) continue;
        box.lower = hyi_four_mul(box.lower, scale);
        box.upper = hyi_four_mul(box.upper, scale);
        hyi_bounds_add(&sum.box, box.lower, box.upper);
        hyi_four centroid = hyi_centroid(&box);
        hyi_bounds_add(&sum.centroids, centroid, centroid);
        hyi_ref_set(out + sum.kept, &box, i);
        sum.kept++;
    }
    build->chunks[chunk] = sum;
}

/* The power of two that brings the largest coordinate to about 1, or 1 where it is within 2^20 of that. */
HYI_FN float hyi_build_scale(const hyi_box *box) {
    float largest = hyi_box_largest(box);
    int exponent = 0;
    (void)frexpf(largest, &exponent);
    if (largest <= 0.0f || (exponent >= -20 && exponent <= 20)) return 1.0f;
    return ldexpf(1.0f, exponent < -126 ? 126 : -exponent);
}

/* Adds up the chunks: what is kept, the bounds, and where each chunk would begin without gaps. */
HYI_FN void hyi_sum_chunks(hyi_build *build) {
    build->ref_count = 0;
    build->root_box = build->root_centroids = hyi_bounds_empty();
    for (uint32_t c = 0; c < build->chunk_count; c++) {
        hyi_chunk_sum *chunk = &build->chunks[c];
        hyi_bounds_add(&build->root_box, chunk->box.lower, chunk->box.upper);
        hyi_bounds_add(&build->root_centroids, chunk->centroids.lower, chunk->centroids.upper);
        chunk->first = build->ref_count;
        build->ref_count += chunk->kept;
    }
    build->root_area = hyi_bounds_area(&build->root_box);
}

/* Allocates and fills the references, sets the bounds and the scale, and counts what is kept. Unscaled and without
   gaps, as references nearly always are, one pass does. */
HYI_FN hydra_result hyi_build_refs(hyi_build *build) {
    uint32_t room = HYI_PRIMITIVES_MAX - build->source_count; /* slots have as many bits */
    uint32_t extra = build->best ? (uint32_t)((uint64_t)build->source_count * HYI_BUILD_EXTRA_PERCENT / 100u) : 0u;
    build->chunk_count = hyi_chunks_of(build->source_count);
    build->capacity = build->source_count + (extra < room ? extra : room);
    build->scale = 1.0f;
    HYI_TRY(hyi_alloc_array(build->context, &build->chunks, build->chunk_count));
    HYI_TRY(hyi_alloc_array(build->context, &build->refs, build->capacity));
    for (uint32_t c = 0; c < build->chunk_count; c++) build->chunks[c].first = c * HYI_BUILD_CHUNK;
    hyi_parallel(build->context, build->chunk_count, hyi_fill_chunk, build);
    hyi_sum_chunks(build);
    build->bvh->degenerate = build->source_count - build->ref_count;
    build->bvh->primitive_count = build->ref_count;
    if (build->ref_count == 0) return HYDRA_OK;
    hyi_bounds_store(&build->root_box, build->bvh->bounds.lower, build->bvh->bounds.upper);
    build->scale = hyi_build_scale(&build->bvh->bounds);
    if (build->ref_count == build->source_count && build->scale == 1.0f) return HYDRA_OK;
    hyi_parallel(build->context, build->chunk_count, hyi_fill_chunk, build);
    hyi_sum_chunks(build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_REFS_H */

/* >>bvh-build-split: where to cut a range of primitives: binned surface area heuristic

   Wald 2007, "On fast construction of SAH-based bounding volume hierarchies": primitives fall into equal
   bins by their centroids along each axis, and the cut between two bins of least expected cost is taken.
   Bins hold minima, maxima and counts, which add up to the same values in any order. */
#ifndef HYI_BVH_BUILD_SPLIT_H
#define HYI_BVH_BUILD_SPLIT_H

#define HYI_BINS 32u

/* Expected costs while cutting, by the triangle: of a visit to a leaf, and of a node's share that a cut takes. Wide nodes
   and leaves are chosen afterwards, by the costs in bvh-build-cost. */
#define HYI_SPLIT_BLOCK 2.0f
#define HYI_SPLIT_NODE (16.0f / 7.0f)

typedef struct hyi_bins {
    hyi_bounds box[HYI_BINS][3];
    uint32_t count[HYI_BINS][4];
} hyi_bins;

/* How doubled centroids map to bins; the bin of a primitive is the same wherever it is asked for. scale 0: no
   extent along that axis. */
typedef struct hyi_binning {
    hyi_four origin, scale, last;
    float origin_of[4], scale_of[4]; /* the same, by axis */
    uint32_t count;
    bool usable[3];
} hyi_binning;

/* A range of references that becomes a node. It owns capacity places from first on, and uses count of them. */
typedef struct hyi_range {
    hyi_bounds box, centroids;
    uint32_t node, first, count, capacity, depth;
    bool in_other; /* which array it lies in */
} hyi_range;

typedef struct hyi_split {
    float cost;      /* of both sides times the area of the node */
    int axis;        /* -1: none */
    bool spatial;
    uint32_t bin;    /* first bin of the right side */
    float plane;     /* of a spatial split */
    uint32_t left_count, right_count;
    hyi_bounds left, right;
} hyi_split;

HYI_INLINE hyi_binning hyi_make_binning(const hyi_bounds *centroids, uint32_t primitives) {
    hyi_binning binning;
    float extent[4];
    memset(binning.scale_of, 0, sizeof binning.scale_of);
    binning.count = primitives < 8u * (HYI_BINS - 4u) ? 4u + primitives / 8u : HYI_BINS;
    hyi_four_store(extent, hyi_four_sub(centroids->upper, centroids->lower));
    for (int a = 0; a < 3; a++) {
        binning.usable[a] = extent[a] > 1.0e-30f;
        if (binning.usable[a]) binning.scale_of[a] = (float)binning.count / extent[a];
    }
    binning.origin = centroids->lower;
    binning.scale = hyi_four_load(binning.scale_of);
    hyi_four_store(binning.origin_of, binning.origin);
    binning.last = hyi_four_all((float)(binning.count - 1u));
    return binning;
}

/* Bins along all axes. The scale rounds, so that the last bin may be passed: hence the minimum. */
HYI_INLINE void hyi_bins_of(const hyi_binning *binning, hyi_four centroid, int32_t bin[4]) {
    hyi_four at = hyi_four_rounded(hyi_four_mul(hyi_four_rounded(hyi_four_sub(centroid, binning->origin)), binning->scale));
    hyi_four_truncate(hyi_four_min(hyi_four_max(at, hyi_four_all(0.0f)), binning->last), bin);
}

/* Whether a primitive falls into a bin before one that is not the first: as hyi_bins_of says, with the same roundings. */
HYI_INLINE bool hyi_is_before_bin(const hyi_binning *binning, const hyi_ref *ref, int axis, float bin) {
    float centroid = hyi_rounded(ref->lower[axis] + ref->upper[axis]);
    return hyi_rounded(hyi_rounded(centroid - binning->origin_of[axis]) * binning->scale_of[axis]) < bin;
}

/* A loop for each array: see hyi_spatial_clear. */
HYI_FN void hyi_bins_clear(hyi_bins *bins, uint32_t count) {
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) bins->box[b][a] = hyi_bounds_empty();
    }
    memset(bins->count, 0, count * sizeof bins->count[0]);
}

HYI_FN void hyi_bins_merge(hyi_bins *bins, const hyi_bins *more, uint32_t count) {
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) hyi_bounds_add(&bins->box[b][a], more->box[b][a].lower, more->box[b][a].upper);
    }
    for (uint32_t b = 0; b < count; b++) {
        for (int a = 0; a < 3; a++) bins->count[b][a] += more->count[b][a];
    }
}

HYI_INLINE void hyi_bins_add(hyi_bins *bins, const hyi_binning *binning, const hyi_ref *ref) {
    hyi_bounds box = hyi_ref_box(ref);
    int32_t bin[4];
    hyi_bins_of(binning, hyi_centroid(&box), bin);
    hyi_bounds_add(&bins->box[bin[0]][0], box.lower, box.upper);
    hyi_bounds_add(&bins->box[bin[1]][1], box.lower, box.upper);
    hyi_bounds_add(&bins->box[bin[2]][2], box.lower, box.upper);
    bins->count[bin[0]][0]++;
    bins->count[bin[1]][1]++;
    bins->count[bin[2]][2]++;
}

/* Neighbours often share a bin, and would wait for each other there: in long ranges every other one has its own bins. */
#define HYI_BINS_PAIRED (16u * HYI_BINS)

HYI_FN void hyi_bins_fill(hyi_bins *bins, const hyi_binning *binning, const hyi_ref *refs, uint32_t count) {
    hyi_bins odd;
    uint32_t i = 0;
    hyi_bins_clear(bins, binning->count);
    if (count >= HYI_BINS_PAIRED) {
        hyi_bins_clear(&odd, binning->count);
        for (; i + 1u < count; i += 2u) {
            hyi_bins_add(bins, binning, &refs[i]);
            hyi_bins_add(&odd, binning, &refs[i + 1u]);
        }
        hyi_bins_merge(bins, &odd, binning->count);
    }
    for (; i < count; i++) hyi_bins_add(bins, binning, &refs[i]);
}

/* Expected cost of a subtree of count primitives, were it entered: leaves test up to HYI_LEAF_MAX at once, which
   makes ranges that fill them dear to cut. */
HYI_INLINE float hyi_primitives_cost(uint32_t count) {
    return HYI_SPLIT_BLOCK * (float)((count + HYI_LEAF_MAX - 1u) / HYI_LEAF_MAX) + (float)count;
}

/* Both sides of a cut have primitives: what it costs. */
HYI_INLINE float hyi_cut_cost(float left_area, uint32_t left_count, float right_area, uint32_t right_count) {
    return left_area * hyi_primitives_cost(left_count) + right_area * hyi_primitives_cost(right_count);
}

/* Sweeps all axes from the right, then from the left. */
HYI_FN hyi_split hyi_best_split(const hyi_bins *bins, const hyi_binning *binning) {
    float right_area[HYI_BINS][3];
    uint32_t right_count[HYI_BINS][3], count[3] = {0, 0, 0};
    hyi_bounds box[3];
    hyi_split best;
    memset(&best, 0, sizeof best);
    best.axis = -1;
    for (int a = 0; a < 3; a++) box[a] = hyi_bounds_empty();
    for (uint32_t b = binning->count; b-- > 1u;) {
        for (int a = 0; a < 3; a++) {
            hyi_bounds_add(&box[a], bins->box[b][a].lower, bins->box[b][a].upper);
            right_area[b][a] = hyi_bounds_area(&box[a]);
            right_count[b][a] = count[a] += bins->count[b][a];
        }
    }
    for (int a = 0; a < 3; a++) box[a] = hyi_bounds_empty();
    memset(count, 0, sizeof count);
    for (uint32_t b = 1; b < binning->count; b++) {
        for (int a = 0; a < 3; a++) {
            hyi_bounds_add(&box[a], bins->box[b - 1u][a].lower, bins->box[b - 1u][a].upper);
            count[a] += bins->count[b - 1u][a];
            float cost = hyi_cut_cost(hyi_bounds_area(&box[a]), count[a], right_area[b][a], right_count[b][a]);
            if (count[a] == 0 || right_count[b][a] == 0 || !binning->usable[a] || (best.axis >= 0 && cost >= best.cost)) continue;
            best.cost = cost;
            best.axis = a;
            best.bin = b;
            best.left = box[a];
            best.left_count = count[a];
            best.right_count = right_count[b][a];
        }
    }
    if (best.axis < 0) return best;
    best.right = hyi_bounds_empty();
    for (uint32_t b = best.bin; b < binning->count; b++) {
        hyi_bounds_add(&best.right, bins->box[b][best.axis].lower, bins->box[b][best.axis].upper);
    }
    return best;
}

/* Levels that cutting in the middle takes to come down to one primitive. */
HYI_INLINE uint32_t hyi_levels_to_one(uint32_t count) {
    uint32_t levels = 0;
    while ((1u << levels) < count) levels++;
    return levels;
}

/* Whether the range must be cut in the middle for the tree to stay within HYI_TREE_DEPTH. */
HYI_INLINE bool hyi_depth_is_short(uint32_t depth, uint32_t count) {
    return depth + 1u + hyi_levels_to_one(count) >= HYI_TREE_DEPTH;
}

#endif /* HYI_BVH_BUILD_SPLIT_H */

/* >>bvh-build-spatial: spatial splits: parts of triangles on both sides of a plane

   Stich, Friedrich, Dietrich 2009, "Spatial splits in bounding volume hierarchies": a range may also be cut by a
   plane; triangles that cross it are referred to from both sides, each time with the box of the part that lies
   there. A reference may yet go to one side whole where that is cheaper (reference unsplitting).

   Every box of a part contains every point of the triangle that lies in its cell: what is computed is rounded
   outwards by a bound on its error, and cells share their planes. */
#ifndef HYI_BVH_BUILD_SPATIAL_H
#define HYI_BVH_BUILD_SPATIAL_H

#define HYI_SPATIAL_BINS 16u
#define HYI_SPATIAL_LEAST 32u                  /* smaller ranges are cut by objects alone */
#define HYI_SPATIAL_OVERLAP 2.0e-4f            /* of the root's surface: the least overlap that a spatial split may mend */
#define HYI_SPATIAL_GAIN 0.99f                 /* of the object split's cost: what the spatial one must stay below */
#define HYI_SPATIAL_SLOP 9.5367431640625e-07f  /* 2^-20 */
#define HYI_SPATIAL_TINY 1.0e-30f

/* Parts of triangles by bins between planes; a primitive counts where it begins and where it ends. */
typedef struct hyi_spatial_bins {
    hyi_bounds box[3][HYI_SPATIAL_BINS];
    uint32_t begins[3][HYI_SPATIAL_BINS], ends[3][HYI_SPATIAL_BINS];
} hyi_spatial_bins;

typedef struct hyi_grid {
    float plane[3][HYI_SPATIAL_BINS + 1u]; /* bin b lies between planes b and b + 1 */
    float scale[3];                        /* 0: no extent along that axis */
    uint32_t count;
} hyi_grid;

typedef struct hyi_corners {
    float at[3][4];
    hyi_four slop; /* more than the error of a point computed on an edge */
} hyi_corners;

/* The corners of a triangle in the units of the tree. A point of an edge is p + (q - p) t, t = (plane - p) / (q - p)
   along the axis: the roundings add up to less than 8 2^-24 (|p| + |q|), and what flushed denormals lose is less than
   HYI_SPATIAL_TINY. */
HYI_INLINE void hyi_load_corners(const hyi_build *build, uint32_t id, hyi_corners *corners) {
    hyi_four scale = hyi_four_all(build->scale), size = hyi_four_all(0.0f);
    for (uint32_t c = 0; c < 3; c++) {
        const float *p = hyi_source_corner(build, id, c);
        hyi_four corner = hyi_four_mul(hyi_four_make(p[0], p[1], p[2]), scale);
        hyi_four_store(corners->at[c], corner);
        size = hyi_four_max(size, hyi_four_abs(corner));
    }
    corners->slop = hyi_four_add(hyi_four_mul(size, hyi_four_all(HYI_SPATIAL_SLOP)), hyi_four_all(HYI_SPATIAL_TINY));
}

/* The half space on one side of a plane, as a box. */
HYI_INLINE hyi_four hyi_plane_lanes(int axis, float plane, float elsewhere) {
    return hyi_four_make(axis == 0 ? plane : elsewhere, axis == 1 ? plane : elsewhere, axis == 2 ? plane : elsewhere);
}

/* The box, which is that of a part of the triangle, cut by a plane: boxes of both parts. An empty one: no point of
   the triangle lies there. */
HYI_INLINE void hyi_clip(const hyi_corners *corners, const hyi_bounds *box, int axis, float plane, hyi_bounds *left, hyi_bounds *right) {
    *left = *right = hyi_bounds_empty();
    for (int c = 0; c < 3; c++) {
        const float *p = corners->at[c], *q = corners->at[c == 2 ? 0 : c + 1];
        hyi_four from = hyi_four_load(p);
        if (p[axis] <= plane) hyi_bounds_add(left, from, from);
        if (p[axis] >= plane) hyi_bounds_add(right, from, from);
        if (!((p[axis] < plane && q[axis] > plane) || (p[axis] > plane && q[axis] < plane))) continue;
        float along = q[axis] - p[axis];
        hyi_four step = hyi_four_sub(hyi_four_load(q), from);
        hyi_bounds point;
        if (fabsf(along) < HYI_SPATIAL_TINY) { /* too short to divide by: the whole edge */
            point.lower = hyi_four_min(from, hyi_four_load(q));
            point.upper = hyi_four_max(from, hyi_four_load(q));
        } else {
            hyi_four at = hyi_four_add(from, hyi_four_mul(step, hyi_four_all((plane - p[axis]) / along)));
            point.lower = hyi_four_sub(at, corners->slop);
            point.upper = hyi_four_add(at, corners->slop);
        }
        hyi_bounds_add(left, point.lower, point.upper);
        hyi_bounds_add(right, point.lower, point.upper);
    }
    hyi_bounds_meet(left, box);
    hyi_bounds_meet(right, box);
    left->upper = hyi_four_min(left->upper, hyi_plane_lanes(axis, plane, HYI_EMPTY_PLANE));
    right->lower = hyi_four_max(right->lower, hyi_plane_lanes(axis, plane, -HYI_EMPTY_PLANE));
}

/* ---- bins */

HYI_INLINE hyi_grid hyi_make_grid(const hyi_bounds *box, uint32_t count) {
    hyi_grid grid;
    float lower[3], upper[3];
    hyi_bounds_store(box, lower, upper);
    grid.count = count < 256u ? HYI_SPATIAL_BINS / 2u : HYI_SPATIAL_BINS;
    for (int a = 0; a < 3; a++) {
        float extent = upper[a] - lower[a], size = fabsf(lower[a]) > fabsf(upper[a]) ? fabsf(lower[a]) : fabsf(upper[a]);
        /* cells must be wider than the slop */
        bool usable = extent > 1.0e-30f && extent > 1024.0f * HYI_SPATIAL_SLOP * size;
        grid.scale[a] = usable ? (float)grid.count / extent : 0.0f;
        for (uint32_t b = 0; b <= grid.count; b++) {
            grid.plane[a][b] = hyi_rounded(lower[a] + hyi_rounded(extent * ((float)b / (float)grid.count)));
        }
    }
    return grid;
}

/* The bins in which a box begins and ends: decided by the planes themselves, for the partition compares with those. */
HYI_INLINE uint32_t hyi_grid_begin(const hyi_grid *grid, int axis, float lower) {
    int32_t last = (int32_t)grid->count - 1, bin = (int32_t)((lower - grid->plane[axis][0]) * grid->scale[axis]);
    bin = bin < last ? bin > 0 ? bin : 0 : last;
    while (bin > 0 && lower < grid->plane[axis][bin]) bin--;
    while (bin < last && lower >= grid->plane[axis][bin + 1]) bin++;
    return (uint32_t)bin;
}

HYI_INLINE uint32_t hyi_grid_end(const hyi_grid *grid, int axis, uint32_t begin, float upper) {
    int32_t last = (int32_t)grid->count - 1, bin = (int32_t)((upper - grid->plane[axis][0]) * grid->scale[axis]);
    bin = bin < last ? bin > (int32_t)begin ? bin : (int32_t)begin : last;
    while (bin > (int32_t)begin && upper <= grid->plane[axis][bin]) bin--;
    while (bin < last && upper > grid->plane[axis][bin + 1]) bin++;
    return (uint32_t)bin;
}

/* One loop for each array: of loops over several, gcc 12 at -O1 loses stores (its induction variables take the address
   of one array from that of another). */
HYI_FN void hyi_spatial_clear(hyi_spatial_bins *bins, const hyi_grid *grid) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < grid->count; b++) bins->box[a][b] = hyi_bounds_empty();
    }
    memset(bins->begins, 0, sizeof bins->begins);
    memset(bins->ends, 0, sizeof bins->ends);
}

/* Adds the parts of one triangle to the bins from begin to end. */
HYI_INLINE void hyi_spatial_chop(hyi_spatial_bins *bins, const hyi_grid *grid, const hyi_corners *corners, hyi_bounds rest, int axis,
                                 uint32_t begin, uint32_t end) {
    for (uint32_t b = begin; b < end; b++) {
        hyi_bounds left, right;
        hyi_clip(corners, &rest, axis, grid->plane[axis][b + 1u], &left, &right);
        if (!hyi_bounds_are_empty(&left)) hyi_bounds_add(&bins->box[axis][b], left.lower, left.upper);
        rest = right;
    }
    if (!hyi_bounds_are_empty(&rest)) hyi_bounds_add(&bins->box[axis][end], rest.lower, rest.upper);
}

HYI_FN void hyi_spatial_fill(hyi_spatial_bins *bins, const hyi_build *build, const hyi_grid *grid, const hyi_ref *refs, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        const hyi_ref *ref = &refs[i];
        hyi_bounds box = hyi_ref_box(ref);
        hyi_corners corners;
        bool loaded = false;
        for (int a = 0; a < 3; a++) {
            if (!(grid->scale[a] > 0.0f)) continue;
            uint32_t begin = hyi_grid_begin(grid, a, ref->lower[a]), end = hyi_grid_end(grid, a, begin, ref->upper[a]);
            bins->begins[a][begin]++;
            bins->ends[a][end]++;
            if (begin == end) {
                hyi_bounds_add(&bins->box[a][begin], box.lower, box.upper);
                continue;
            }
            if (!loaded) hyi_load_corners(build, hyi_ref_id(ref), &corners);
            loaded = true;
            hyi_spatial_chop(bins, grid, &corners, box, a, begin, end);
        }
    }
}

HYI_FN void hyi_spatial_merge(hyi_spatial_bins *bins, const hyi_spatial_bins *more, const hyi_grid *grid) {
    for (int a = 0; a < 3; a++) {
        for (uint32_t b = 0; b < grid->count; b++) hyi_bounds_add(&bins->box[a][b], more->box[a][b].lower, more->box[a][b].upper);
        for (uint32_t b = 0; b < grid->count; b++) bins->begins[a][b] += more->begins[a][b];
        for (uint32_t b = 0; b < grid->count; b++) bins->ends[a][b] += more->ends[a][b];
    }
}

HYI_FN void hyi_spatial_best_on_axis(const hyi_spatial_bins *bins, const hyi_grid *grid, int axis, hyi_split *best) {
    hyi_bounds right[HYI_SPATIAL_BINS], box = hyi_bounds_empty();
    uint32_t right_count[HYI_SPATIAL_BINS], count = 0;
    for (uint32_t b = grid->count; b-- > 1u;) {
        hyi_bounds_add(&box, bins->box[axis][b].lower, bins->box[axis][b].upper);
        right[b] = box;
        right_count[b] = count += bins->ends[axis][b];
    }
    box = hyi_bounds_empty();
    count = 0;
    for (uint32_t b = 1; b < grid->count; b++) {
        hyi_bounds_add(&box, bins->box[axis][b - 1u].lower, bins->box[axis][b - 1u].upper);
        count += bins->begins[axis][b - 1u];
        if (count == 0 || right_count[b] == 0) continue;
        float cost = hyi_cut_cost(hyi_bounds_area(&box), count, hyi_bounds_area(&right[b]), right_count[b]);
        if (best->axis >= 0 && cost >= best->cost) continue;
        best->cost = cost;
        best->axis = axis;
        best->bin = b;
        best->plane = grid->plane[axis][b];
        best->left = box;
        best->right = right[b];
        best->left_count = count;
        best->right_count = right_count[b];
    }
}

HYI_FN hyi_split hyi_spatial_best(const hyi_spatial_bins *bins, const hyi_grid *grid) {
    hyi_split best;
    memset(&best, 0, sizeof best);
    best.axis = -1;
    best.spatial = true;
    for (int a = 0; a < 3; a++) {
        if (grid->scale[a] > 0.0f) hyi_spatial_best_on_axis(bins, grid, a, &best);
    }
    return best;
}

/* Whether to look for a spatial split: there is room, and the sides of the object split overlap by something. */
HYI_INLINE bool hyi_spatial_pays(const hyi_build *build, const hyi_range *range, const hyi_split *object) {
    if (!build->best || range->capacity == range->count || range->count < HYI_SPATIAL_LEAST) return false;
    if (object->axis < 0) return true;
    hyi_bounds overlap = object->left;
    hyi_bounds_meet(&overlap, &object->right);
    return hyi_bounds_area(&overlap) > HYI_SPATIAL_OVERLAP * build->root_area;
}

HYI_INLINE bool hyi_spatial_is_better(const hyi_split *spatial, const hyi_split *object) {
    if (spatial->axis < 0) return false;
    if (object->axis < 0) return true;
    return spatial->cost < HYI_SPATIAL_GAIN * object->cost;
}

/* ---- references */

/* Where a reference goes. */
typedef struct hyi_parts {
    bool left, right;
    hyi_bounds left_box, right_box;
} hyi_parts;

/* Splits a reference by a spatial split, or gives it whole to a side where both parts would cost more. */
HYI_INLINE void hyi_part_ref(const hyi_build *build, const hyi_split *split, const hyi_ref *ref, bool room, hyi_parts *parts) {
    hyi_bounds box = hyi_ref_box(ref);
    parts->left_box = parts->right_box = box;
    parts->right = ref->upper[split->axis] > split->plane || ref->lower[split->axis] >= split->plane;
    parts->left = ref->lower[split->axis] < split->plane;
    if (!(parts->left && parts->right)) return;
    hyi_corners corners;
    hyi_load_corners(build, hyi_ref_id(ref), &corners);
    hyi_clip(&corners, &box, split->axis, split->plane, &parts->left_box, &parts->right_box);
    bool no_left = hyi_bounds_are_empty(&parts->left_box), no_right = hyi_bounds_are_empty(&parts->right_box);
    if (no_left || no_right) {
        parts->left = no_right && !no_left;
        parts->right = !parts->left;
        if (no_left && no_right) parts->right_box = box;
        return;
    }
    float left_area = hyi_bounds_area(&split->left), right_area = hyi_bounds_area(&split->right);
    float lefts = (float)split->left_count, rights = (float)split->right_count;
    float both = left_area * lefts + right_area * rights;
    float to_left = hyi_bounds_area_with(&split->left, box.lower, box.upper) * lefts + right_area * (rights - 1.0f);
    float to_right = left_area * (lefts - 1.0f) + hyi_bounds_area_with(&split->right, box.lower, box.upper) * rights;
    if (room && both <= to_left && both <= to_right) return;
    parts->left = to_left <= to_right;
    parts->right = !parts->left;
    parts->left_box = parts->right_box = box;
}

#endif /* HYI_BVH_BUILD_SPATIAL_H */

/* >>bvh-build-part: a range of references becomes two: who goes where, and who owns which places

   A range owns more places than it uses where spatial splits may add references. The two children of a node
   whose places are cut at m are nodes 2 (m - 1) and 2 (m - 1) + 1: no two cuts share an m, so places need no
   counter and come out the same on any thread. */
#ifndef HYI_BVH_BUILD_PART_H
#define HYI_BVH_BUILD_PART_H

HYI_INLINE void hyi_set_build_node(hyi_build *build, const hyi_range *range) {
    hyi_build_node *node = &build->nodes[range->node];
    hyi_bounds_store(&range->box, node->lower, node->upper);
    node->first = range->first;
    node->count = range->count;
}

/* Shares out the places that are left, and makes the children's nodes. Counts, boxes and centroids are set. */
HYI_FN void hyi_link_children(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    uint32_t spare = range->capacity - left->count - right->count;
    double weight = (double)left->count, other = (double)right->count;
    uint32_t share = spare ? (uint32_t)((double)spare * (weight / (weight + other))) : 0u;
    left->first = range->first;
    left->capacity = left->count + (share < spare ? share : spare);
    right->first = range->first + left->capacity;
    right->capacity = range->capacity - left->capacity;
    left->node = 2u * (right->first - 1u);
    right->node = left->node + 1u;
    left->depth = right->depth = range->depth + 1u;
    left->in_other = right->in_other = range->in_other;
    build->nodes[range->node].first = left->node;
    build->nodes[range->node].count |= HYI_BUILD_INNER;
}

/* Two ranges that fill, their boxes and centroids growing. */
HYI_INLINE void hyi_begin_sides(hyi_range *left, hyi_range *right) {
    left->count = right->count = 0;
    left->box = left->centroids = right->box = right->centroids = hyi_bounds_empty();
}

HYI_INLINE void hyi_add_centroid(hyi_bounds *centroids, const hyi_bounds *box) {
    hyi_four centroid = hyi_centroid(box);
    hyi_bounds_add(centroids, centroid, centroid);
}

HYI_INLINE void hyi_range_add(hyi_range *range, const hyi_bounds *box) {
    hyi_bounds_add(&range->box, box->lower, box->upper);
    hyi_add_centroid(&range->centroids, box);
    range->count++;
}

/* Sorts references into two places by an object split, without branches. left may be where they lie. */
HYI_FN void hyi_part_objects(const hyi_ref *refs, uint32_t count, const hyi_binning *binning, const hyi_split *split, hyi_ref *to_left,
                             hyi_ref *to_right, hyi_range *left, hyi_range *right) {
    const hyi_four beyond[2] = {hyi_four_all(-HYI_EMPTY_PLANE), hyi_four_all(HYI_EMPTY_PLANE)};
    const float bin = (float)split->bin;
    hyi_bounds l = hyi_bounds_empty(), r = hyi_bounds_empty();
    hyi_ref *to[2] = {to_left, to_right};
    uint32_t filled[2] = {0, 0};
    for (uint32_t i = 0; i < count; i++) {
        uint32_t goes_right = hyi_is_before_bin(binning, &refs[i], split->axis, bin) ? 0u : 1u;
        hyi_ref ref = refs[i];
        hyi_bounds box = hyi_ref_box(&ref);
        hyi_four centroid = hyi_centroid(&box), below = beyond[goes_right], above = beyond[1u - goes_right];
        l.lower = hyi_four_min(l.lower, hyi_four_max(centroid, below));
        l.upper = hyi_four_max(l.upper, hyi_four_min(centroid, above));
        r.lower = hyi_four_min(r.lower, hyi_four_max(centroid, above));
        r.upper = hyi_four_max(r.upper, hyi_four_min(centroid, below));
        to[goes_right][filled[goes_right]++] = ref;
    }
    hyi_begin_sides(left, right);
    left->count = filled[0];
    right->count = filled[1];
    left->centroids = l;
    right->centroids = r;
    left->box = split->left;
    right->box = split->right;
}

/* The same by a spatial split; room: how many references may be added. */
HYI_FN void hyi_part_spatial(const hyi_build *build, const hyi_ref *refs, uint32_t count, const hyi_split *split, uint32_t room,
                             hyi_ref *to_left, hyi_ref *to_right, hyi_range *left, hyi_range *right) {
    hyi_begin_sides(left, right);
    for (uint32_t i = 0; i < count; i++) {
        hyi_ref ref = refs[i];
        hyi_parts parts;
        hyi_part_ref(build, split, &ref, left->count + right->count < i + room, &parts);
        if (parts.left) {
            hyi_ref_set(&to_left[left->count], &parts.left_box, hyi_ref_id(&ref));
            hyi_range_add(left, &parts.left_box);
        }
        if (parts.right) {
            hyi_ref_set(&to_right[right->count], &parts.right_box, hyi_ref_id(&ref));
            hyi_range_add(right, &parts.right_box);
        }
    }
}

/* ---- the middle of the range, where the heuristic cannot tell or may not */

HYI_INLINE bool hyi_ref_before(const hyi_ref *a, const hyi_ref *b, int axis) {
    float ca = hyi_rounded(a->lower[axis] + a->upper[axis]), cb = hyi_rounded(b->lower[axis] + b->upper[axis]);
    return ca < cb || (ca == cb && hyi_ref_id(a) < hyi_ref_id(b));
}

HYI_INLINE void hyi_swap_refs(hyi_ref *a, hyi_ref *b) {
    hyi_ref keep = *a;
    *a = *b;
    *b = keep;
}

/* Orders refs so that no one before middle belongs after it (Hoare's selection, middle of three as pivot). */
HYI_FN void hyi_select_middle(hyi_ref *refs, uint32_t count, uint32_t middle, int axis) {
    uint32_t low = 0, high = count - 1u;
    while (low < high) {
        hyi_ref *a = &refs[low], *b = &refs[low + (high - low) / 2u], *c = &refs[high];
        if (hyi_ref_before(b, a, axis)) hyi_swap_refs(a, b);
        if (hyi_ref_before(c, b, axis)) hyi_swap_refs(b, c);
        if (hyi_ref_before(b, a, axis)) hyi_swap_refs(a, b);
        hyi_ref pivot = *b;
        uint32_t i = low, j = high;
        while (i <= j) {
            while (hyi_ref_before(&refs[i], &pivot, axis)) i++;
            while (hyi_ref_before(&pivot, &refs[j], axis)) j--;
            if (i > j) break;
            hyi_swap_refs(&refs[i], &refs[j]);
            i++;
            if (j == 0) break;
            j--;
        }
        if (middle <= j) high = j;
        else if (middle >= i) low = i;
        else return;
    }
}

HYI_FN int hyi_widest_axis(const hyi_bounds *box) {
    float extent[4];
    int widest = 0;
    hyi_four_store(extent, hyi_four_sub(box->upper, box->lower));
    for (int a = 1; a < 3; a++) {
        if (extent[a] > extent[widest]) widest = a;
    }
    return widest;
}

/* Cuts the range in two halves by count, in the array it lies in. */
HYI_FN void hyi_split_middle(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_ref *refs = (range->in_other ? build->other : build->refs) + range->first;
    uint32_t half = range->count / 2u;
    hyi_select_middle(refs, range->count, half, hyi_widest_axis(&range->centroids));
    hyi_begin_sides(left, right);
    for (uint32_t i = 0; i < range->count; i++) {
        hyi_bounds box = hyi_ref_box(&refs[i]);
        hyi_range_add(i < half ? left : right, &box);
    }
    hyi_link_children(build, range, left, right);
    memmove(refs + left->capacity, refs + half, right->count * sizeof *refs);
}

#endif /* HYI_BVH_BUILD_PART_H */

/* >>bvh-build-tree: the binary tree: large ranges cut by all threads together, small ones a thread each */
#ifndef HYI_BVH_BUILD_TREE_H
#define HYI_BVH_BUILD_TREE_H

/* Ranges above this are cut by all threads together. */
#define HYI_BUILD_LARGE (4u * HYI_BUILD_CHUNK)

/* A piece of a large range: its bins, then where its primitives go. */
typedef struct hyi_chunk_split {
    hyi_bins bins;
    hyi_spatial_bins spatial;
    hyi_range left, right;
    uint32_t left_first, right_first;
} hyi_chunk_split;

/* The large range in work, for its chunks. */
typedef struct hyi_large {
    hyi_build *build;
    hyi_range range;
    hyi_binning binning;
    hyi_grid grid;
    hyi_split split;
    const hyi_ref *from;
    hyi_ref *to_left, *to_right;
} hyi_large;

/* What a subtree is cut with. */
typedef struct hyi_small {
    hyi_bins bins;
    hyi_spatial_bins spatial;
} hyi_small;

/* Whether the range is better left a leaf. The children of a node are tested together, so cutting adds no
   node of its own, only its share of one. */
HYI_INLINE bool hyi_leaf_is_better(const hyi_build *build, const hyi_split *split, const hyi_range *range) {
    if (range->count > build->leaf_max) return false;
    if (split->axis < 0) return true;
    if (build->best) return false;
    float area = hyi_bounds_area(&range->box);
    return hyi_primitives_cost(range->count) * area <= HYI_SPLIT_NODE * area + split->cost;
}

/* ---- small ranges, in one thread. They lie in refs; other is room to work in. */

HYI_FN hyi_split hyi_choose_split(hyi_build *build, hyi_small *work, const hyi_range *range, const hyi_binning *binning) {
    const hyi_ref *refs = build->refs + range->first;
    hyi_bins_fill(&work->bins, binning, refs, range->count);
    hyi_split split = hyi_best_split(&work->bins, binning);
    if (!hyi_spatial_pays(build, range, &split)) return split;
    hyi_grid grid = hyi_make_grid(&range->box, range->count);
    hyi_spatial_clear(&work->spatial, &grid);
    hyi_spatial_fill(&work->spatial, build, &grid, refs, range->count);
    hyi_split spatial = hyi_spatial_best(&work->spatial, &grid);
    return hyi_spatial_is_better(&spatial, &split) ? spatial : split;
}

/* Cuts by a split; false: all went to one side, and nothing is done. */
HYI_FN bool hyi_part_small(hyi_build *build, const hyi_range *range, const hyi_binning *binning, const hyi_split *split,
                           hyi_range *left, hyi_range *right) {
    hyi_ref *refs = build->refs + range->first, *scratch = build->other + range->first;
    if (split->spatial) hyi_part_spatial(build, refs, range->count, split, range->capacity - range->count, refs, scratch, left, right);
    else hyi_part_objects(refs, range->count, binning, split, refs, scratch, left, right);
    if (left->count == 0) memcpy(refs, scratch, right->count * sizeof *refs);
    if (left->count == 0 || right->count == 0) return false;
    hyi_link_children(build, range, left, right);
    memcpy(build->refs + right->first, scratch, right->count * sizeof *refs);
    return true;
}

/* Cuts a small range. Returns false where it becomes a leaf. */
HYI_FN bool hyi_split_small(hyi_build *build, hyi_small *work, const hyi_range *range, hyi_range *left, hyi_range *right) {
    if (range->count < 2u) return false;
    hyi_binning binning = hyi_make_binning(&range->centroids, range->count);
    hyi_split split = hyi_choose_split(build, work, range, &binning);
    if (hyi_leaf_is_better(build, &split, range)) return false;
    bool short_of_depth = hyi_depth_is_short(range->depth, range->count);
    if (short_of_depth && range->count <= build->leaf_max) return false;
    if (split.axis >= 0 && !short_of_depth && hyi_part_small(build, range, &binning, &split, left, right)) return true;
    if (range->count <= build->leaf_max) return false;
    hyi_split_middle(build, range, left, right);
    return true;
}

/* Depth first with a list of its own: one entry a level at most. */
HYI_FN void hyi_build_subtree(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_range list[HYI_TREE_DEPTH + 2u];
    hyi_small work;
    uint32_t waiting = 1;
    list[0] = build->tasks[index];
    if (list[0].in_other) memcpy(build->refs + list[0].first, build->other + list[0].first, list[0].count * sizeof(hyi_ref));
    list[0].in_other = false;
    while (waiting > 0) {
        hyi_range range = list[--waiting], left, right;
        hyi_set_build_node(build, &range);
        if (!hyi_split_small(build, &work, &range, &left, &right)) continue;
        list[waiting++] = right;
        list[waiting++] = left;
    }
}

/* ---- large ranges: chunks in parallel, from one array to the other, order kept */

HYI_FN void hyi_bin_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    hyi_bins_fill(&large->build->chunk_splits[chunk].bins, &large->binning, large->from + begin, end - begin);
}

HYI_FN void hyi_spatial_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    uint32_t begin = chunk * HYI_BUILD_CHUNK, end = hyi_chunk_end(chunk, large->range.count);
    hyi_spatial_bins *bins = &large->build->chunk_splits[chunk].spatial;
    hyi_spatial_clear(bins, &large->grid);
    hyi_spatial_fill(bins, large->build, &large->grid, large->from + begin, end - begin);
}

/* What a spatial split would make of a chunk, counted. */
HYI_FN void hyi_count_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    hyi_chunk_split *piece = &large->build->chunk_splits[chunk];
    uint32_t end = hyi_chunk_end(chunk, large->range.count);
    piece->left.count = piece->right.count = 0;
    for (uint32_t i = chunk * HYI_BUILD_CHUNK; i < end; i++) {
        hyi_parts parts;
        hyi_part_ref(large->build, &large->split, &large->from[i], true, &parts);
        piece->left.count += parts.left ? 1u : 0u;
        piece->right.count += parts.right ? 1u : 0u;
    }
}

/* For an object split the bins know the counts. */
HYI_FN void hyi_count_object_chunks(hyi_large *large, uint32_t chunks) {
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->left.count = 0;
        for (uint32_t b = 0; b < large->split.bin; b++) piece->left.count += piece->bins.count[b][large->split.axis];
        piece->right.count = hyi_chunk_end(c, large->range.count) - c * HYI_BUILD_CHUNK - piece->left.count;
    }
}

HYI_FN void hyi_scatter_chunk(void *argument, uint32_t chunk) {
    hyi_large *large = (hyi_large *)argument;
    hyi_chunk_split *piece = &large->build->chunk_splits[chunk];
    uint32_t begin = chunk * HYI_BUILD_CHUNK, count = hyi_chunk_end(chunk, large->range.count) - begin;
    hyi_ref *left = large->to_left + piece->left_first, *right = large->to_right + piece->right_first;
    if (large->split.spatial) {
        hyi_part_spatial(large->build, large->from + begin, count, &large->split, UINT32_MAX - count, left, right, &piece->left,
                         &piece->right);
    } else {
        hyi_part_objects(large->from + begin, count, &large->binning, &large->split, left, right, &piece->left, &piece->right);
    }
}

/* Gives each chunk its places on both sides; adds up the counts. */
HYI_FN void hyi_place_chunks(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    left->count = right->count = 0;
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &large->build->chunk_splits[c];
        piece->left_first = left->count;
        piece->right_first = right->count;
        left->count += piece->left.count;
        right->count += piece->right.count;
    }
}

/* Replaces the object split by a spatial one where that is better, and fits. Returns whether it did; the chunks are
   then counted. */
HYI_FN bool hyi_choose_spatial(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    hyi_build *build = large->build;
    if (!hyi_spatial_pays(build, &large->range, &large->split)) return false;
    large->grid = hyi_make_grid(&large->range.box, large->range.count);
    hyi_parallel(build->context, chunks, hyi_spatial_chunk, large);
    hyi_spatial_bins *bins = &build->chunk_splits[0].spatial;
    for (uint32_t c = 1; c < chunks; c++) hyi_spatial_merge(bins, &build->chunk_splits[c].spatial, &large->grid);
    hyi_split object = large->split, spatial = hyi_spatial_best(bins, &large->grid);
    if (!hyi_spatial_is_better(&spatial, &object)) return false;
    large->split = spatial;
    hyi_parallel(build->context, chunks, hyi_count_chunk, large);
    hyi_place_chunks(large, chunks, left, right);
    if (left->count && right->count && left->count + right->count <= large->range.capacity) return true;
    large->split = object;
    return false;
}

/* The best object split, from bins that all chunks fill. */
HYI_FN void hyi_choose_object(hyi_large *large, uint32_t chunks) {
    hyi_build *build = large->build;
    hyi_parallel(build->context, chunks, hyi_bin_chunk, large);
    hyi_bins bins = build->chunk_splits[0].bins;
    for (uint32_t c = 1; c < chunks; c++) hyi_bins_merge(&bins, &build->chunk_splits[c].bins, large->binning.count);
    large->split = hyi_best_split(&bins, &large->binning);
}

/* Moves the references of counted chunks to the other array, and measures both sides. */
HYI_FN void hyi_part_large(hyi_large *large, uint32_t chunks, hyi_range *left, hyi_range *right) {
    hyi_build *build = large->build;
    hyi_link_children(build, &large->range, left, right);
    left->in_other = right->in_other = !large->range.in_other;
    large->to_left = (large->range.in_other ? build->refs : build->other) + left->first;
    large->to_right = large->to_left + left->capacity;
    hyi_parallel(build->context, chunks, hyi_scatter_chunk, large);
    left->box = left->centroids = right->box = right->centroids = hyi_bounds_empty();
    for (uint32_t c = 0; c < chunks; c++) {
        hyi_chunk_split *piece = &build->chunk_splits[c];
        hyi_bounds_add(&left->box, piece->left.box.lower, piece->left.box.upper);
        hyi_bounds_add(&right->box, piece->right.box.lower, piece->right.box.upper);
        hyi_bounds_add(&left->centroids, piece->left.centroids.lower, piece->left.centroids.upper);
        hyi_bounds_add(&right->centroids, piece->right.centroids.lower, piece->right.centroids.upper);
    }
}

HYI_FN void hyi_split_large(hyi_build *build, const hyi_range *range, hyi_range *left, hyi_range *right) {
    hyi_large large;
    uint32_t chunks = hyi_chunks_of(range->count);
    large.build = build;
    large.range = *range;
    large.binning = hyi_make_binning(&range->centroids, range->count);
    large.from = (range->in_other ? build->other : build->refs) + range->first;
    bool short_of_depth = hyi_depth_is_short(range->depth, range->count);
    if (!short_of_depth) hyi_choose_object(&large, chunks);
    bool spatial = !short_of_depth && hyi_choose_spatial(&large, chunks, left, right);
    if (short_of_depth || large.split.axis < 0) {
        hyi_split_middle(build, range, left, right);
        return;
    }
    if (!spatial) {
        hyi_count_object_chunks(&large, chunks);
        hyi_place_chunks(&large, chunks, left, right);
    }
    hyi_part_large(&large, chunks, left, right);
}

/* ---- the whole tree */

HYI_FN hyi_range hyi_root_range(const hyi_build *build) {
    hyi_range root;
    root.box = build->root_box;
    root.centroids = build->root_centroids;
    root.node = build->node_capacity - 1u;
    root.first = root.depth = 0;
    root.count = build->ref_count;
    root.capacity = build->capacity;
    root.in_other = false;
    return root;
}

/* Cuts large ranges until only small ones are left, which become tasks. */
HYI_FN hydra_result hyi_collect_tasks(hyi_build *build) {
    hyi_range list[HYI_TREE_DEPTH + 2u];
    uint32_t waiting = 1;
    list[0] = hyi_root_range(build);
    while (waiting > 0) {
        hyi_range range = list[--waiting];
        if (range.count > HYI_BUILD_LARGE) {
            hyi_range left, right;
            hyi_set_build_node(build, &range);
            hyi_split_large(build, &range, &left, &right);
            list[waiting++] = right;
            list[waiting++] = left;
            continue;
        }
        size_t capacity = build->task_capacity;
        HYI_TRY(hyi_grow_array(build->context, &build->tasks, &capacity, (size_t)build->task_count + 1u));
        build->task_capacity = (uint32_t)capacity;
        build->tasks[build->task_count++] = range;
    }
    return HYDRA_OK;
}

/* The binary tree over all references; its root is the last node. */
HYI_FN hydra_result hyi_build_tree(hyi_build *build) {
    build->node_capacity = 2u * build->capacity - 1u;
    HYI_TRY(hyi_alloc_array(build->context, &build->nodes, build->node_capacity));
    HYI_TRY(hyi_alloc_array(build->context, &build->other, build->capacity));
    if (build->ref_count > HYI_BUILD_LARGE) {
        build->chunk_split_count = hyi_chunks_of(build->capacity);
        HYI_TRY(hyi_alloc_array(build->context, &build->chunk_splits, build->chunk_split_count));
    }
    HYI_TRY(hyi_collect_tasks(build));
    hyi_parallel(build->context, build->task_count, hyi_build_subtree, build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_TREE_H */

/* >>bvh-build-cost: which subtrees of the binary tree become wide nodes and leaves

   Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs", section
   3.1: for every node of the binary tree, from the bottom up, the least expected cost of its subtree in 1 to 7
   places of a wide node above it is known from those of its children. */
#ifndef HYI_BVH_BUILD_COST_H
#define HYI_BVH_BUILD_COST_H

/* Expected costs, in visits of a node: a leaf is one pass over its lanes, and more memory with more triangles. */
#define HYI_COST_NODE 1.0f
#define HYI_COST_LEAF 1.0f
#define HYI_COST_TRIANGLE 0.05f

#define HYI_COUNT_MANY 64u

typedef struct hyi_cost {
    float in_places[HYI_WIDTH - 1u]; /* least cost in 1 to 7 places, as far as there are tips */
    uint8_t left[HYI_WIDTH - 1u];    /* of 2 to 8 places, those for the left child; 0: one place less does as well */
    uint8_t tips;                    /* leaves of the binary tree, up to HYI_WIDTH */
    uint8_t count;                   /* references, up to HYI_COUNT_MANY */
    bool leaf;                       /* in one place: whether as a leaf */
} hyi_cost;

HYI_INLINE float hyi_node_area(const hyi_build_node *node) {
    hyi_bounds box = hyi_bounds_load(node->lower, node->upper);
    return hyi_bounds_area(&box);
}

HYI_INLINE float hyi_leaf_cost(float area, uint32_t count) { return area * (HYI_COST_LEAF + HYI_COST_TRIANGLE * (float)count); }

HYI_INLINE void hyi_cost_of_leaf(const hyi_build_node *node, hyi_cost *cost) {
    memset(cost, 0, sizeof *cost);
    cost->in_places[0] = hyi_leaf_cost(hyi_node_area(node), node->count);
    cost->tips = 1;
    cost->count = (uint8_t)node->count;
    cost->leaf = true;
}

/* The best way to share out places, of which there are no more than tips, between two children. */
HYI_INLINE float hyi_best_share(const hyi_cost *left, const hyi_cost *right, uint32_t places, uint8_t *to_left) {
    uint32_t first = places > right->tips ? places - right->tips : 1u, last = left->tips < places ? left->tips : places - 1u;
    float best = FLT_MAX;
    *to_left = (uint8_t)first;
    for (uint32_t k = first; k <= last; k++) {
        float cost = left->in_places[k - 1u] + right->in_places[places - k - 1u];
        if (cost < best) {
            best = cost;
            *to_left = (uint8_t)k;
        }
    }
    return best;
}

/* Costs in two and more places, but for a whole node's. */
HYI_INLINE void hyi_cost_in_places(const hyi_cost *left, const hyi_cost *right, hyi_cost *cost) {
    for (uint32_t places = 2; places < HYI_WIDTH && places <= cost->tips; places++) {
        float shared = hyi_best_share(left, right, places, &cost->left[places - 2u]), less = cost->in_places[places - 2u];
        cost->in_places[places - 1u] = shared < less ? shared : less;
        if (!(shared < less)) cost->left[places - 2u] = 0;
    }
}

HYI_FN void hyi_cost_of_inner(const hyi_build *build, const hyi_build_node *node, hyi_cost *cost) {
    const hyi_cost *left = &build->costs[node->first], *right = left + 1;
    float area = hyi_node_area(node);
    uint32_t count = (uint32_t)left->count + right->count, tips = (uint32_t)left->tips + right->tips;
    uint8_t whole_left;
    tips = tips < HYI_WIDTH ? tips : HYI_WIDTH;
    float wide = area * HYI_COST_NODE + hyi_best_share(left, right, tips, &whole_left);
    float leaf = count <= build->leaf_max ? hyi_leaf_cost(area, count) : FLT_MAX;
    memset(cost->left, 0, sizeof cost->left);
    cost->tips = (uint8_t)tips;
    cost->count = (uint8_t)(count < HYI_COUNT_MANY ? count : HYI_COUNT_MANY);
    cost->leaf = leaf <= wide;
    cost->in_places[0] = cost->leaf ? leaf : wide;
    hyi_cost_in_places(left, right, cost);
    cost->left[HYI_WIDTH - 2u] = whole_left;
}

/* Goes no deeper than HYI_TREE_DEPTH. next: the first task whose costs are known already; UINT32_MAX: there is none. */
HYI_FN void hyi_cost_below(const hyi_build *build, uint32_t at, uint32_t *next) {
    const hyi_build_node *node = &build->nodes[at];
    if (*next < build->task_count && build->tasks[*next].node == at) {
        ++*next;
    } else if (hyi_build_is_leaf(node)) {
        hyi_cost_of_leaf(node, &build->costs[at]);
    } else {
        hyi_cost_below(build, node->first, next);
        hyi_cost_below(build, node->first + 1u, next);
        hyi_cost_of_inner(build, node, &build->costs[at]);
    }
}

HYI_FN void hyi_cost_task(void *argument, uint32_t index) {
    const hyi_build *build = (const hyi_build *)argument;
    uint32_t none = UINT32_MAX;
    hyi_cost_below(build, build->tasks[index].node, &none);
}

/* Costs of all subtrees; tasks were collected from left to right. */
HYI_FN hydra_result hyi_build_costs(hyi_build *build) {
    uint32_t next = 0;
    HYI_TRY(hyi_alloc_array(build->context, &build->costs, build->node_capacity));
    hyi_parallel(build->context, build->task_count, hyi_cost_task, build);
    hyi_cost_below(build, build->node_capacity - 1u, &next);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COST_H */

/* >>bvh-build-collapse: from the binary tree to eight-wide nodes and rows of triangles

   The inner children of a node stand together, the largest is followed first, and its subtree lies in one
   piece: a ray that goes on reads memory close by. What is near the root comes first. */
#ifndef HYI_BVH_BUILD_COLLAPSE_H
#define HYI_BVH_BUILD_COLLAPSE_H

/* Subtrees with no more references than this are written by one thread. */
#define HYI_WIDE_TASK 4096u

/* The binary nodes that become the children of one wide node, widest surface first. */
typedef struct hyi_family {
    uint32_t count, inner;
    uint32_t member[HYI_WIDTH];
    float area[HYI_WIDTH];
} hyi_family;

/* A subtree that one thread writes: its root has its place, its own nodes and slots lie from first on. */
typedef struct hyi_wide_task {
    uint32_t binary, place, level;
    uint32_t first_node, nodes, first_slot, slots, depth;
} hyi_wide_task;

/* A walk over the wide tree, which counts, and then writes. */
typedef struct hyi_wide_walk {
    hyi_build *build;
    bool writes, collects; /* collects: leaves subtrees to tasks */
    uint32_t next_node, next_slot, next_task, depth;
} hyi_wide_walk;

HYI_INLINE bool hyi_becomes_leaf(const hyi_build *build, uint32_t node) { return build->costs[node].leaf; }

/* Keeps the order: largest surface first, then who came first. */
HYI_FN void hyi_family_add(hyi_family *family, const hyi_build *build, uint32_t node) {
    float area = hyi_node_area(&build->nodes[node]);
    uint32_t at = family->count++;
    for (; at > 0 && family->area[at - 1u] < area; at--) {
        family->area[at] = family->area[at - 1u];
        family->member[at] = family->member[at - 1u];
    }
    family->area[at] = area;
    family->member[at] = node;
    family->inner += hyi_becomes_leaf(build, node) ? 0u : 1u;
}

/* Puts a subtree into up to places children. */
HYI_FN void hyi_family_share(hyi_family *family, const hyi_build *build, uint32_t node, uint32_t places) {
    const hyi_cost *cost = &build->costs[node];
    while (places > 1u && cost->left[places - 2u] == 0) places--;
    if (places == 1u) {
        hyi_family_add(family, build, node);
        return;
    }
    uint32_t left = cost->left[places - 2u];
    hyi_family_share(family, build, build->nodes[node].first, left);
    hyi_family_share(family, build, build->nodes[node].first + 1u, places - left);
}

HYI_FN void hyi_gather_family(const hyi_build *build, uint32_t node, hyi_family *family) {
    uint32_t left = build->costs[node].left[HYI_WIDTH - 2u];
    family->count = family->inner = 0;
    hyi_family_share(family, build, build->nodes[node].first, left);
    hyi_family_share(family, build, build->nodes[node].first + 1u, HYI_WIDTH - left);
}

/* ---- leaves */

/* The primitives below a binary node that becomes a leaf, each once; returns how many. */
HYI_FN uint32_t hyi_gather_leaf(const hyi_build *build, uint32_t node, uint32_t count, uint32_t ids[HYI_LEAF_MAX]) {
    const hyi_build_node *from = &build->nodes[node];
    if (!hyi_build_is_leaf(from)) {
        count = hyi_gather_leaf(build, from->first, count, ids);
        return hyi_gather_leaf(build, from->first + 1u, count, ids);
    }
    for (uint32_t i = 0; i < from->count; i++) {
        uint32_t id = hyi_ref_id(&build->refs[from->first + i]), at = 0;
        while (at < count && ids[at] != id) at++;
        ids[at] = id;
        count += at == count ? 1u : 0u;
    }
    return count;
}

HYI_FN void hyi_write_leaf(const hyi_build *build, uint32_t first, uint32_t count, const uint32_t *ids) {
    memcpy(build->bvh->ids + first, ids, count * sizeof *ids);
    if (!build->positions) return;
    float *row = build->bvh->rows + 9u * (size_t)first;
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t corner = 0; corner < 3; corner++) {
            const float *p = hyi_source_corner(build, ids[i], corner);
            for (uint32_t a = 0; a < 3; a++) row[(3u * corner + a) * count + i] = p[a] * build->scale;
        }
    }
}

/* ---- nodes */

HYI_FN void hyi_clear_node(hyi_node *node) {
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        for (int a = 0; a < 3; a++) {
            node->planes[2 * a][c] = HYI_EMPTY_PLANE;
            node->planes[2 * a + 1][c] = -HYI_EMPTY_PLANE;
        }
        node->child[c] = HYI_CHILD_NONE;
        node->unused[c] = 0;
    }
}

HYI_FN void hyi_set_child(hyi_node *node, uint32_t c, const hyi_build_node *box, uint32_t child) {
    for (int a = 0; a < 3; a++) {
        node->planes[2 * a][c] = box->lower[a];
        node->planes[2 * a + 1][c] = box->upper[a];
    }
    node->child[c] = child;
}

/* Gives a leaf its slots, and writes it; returns the child. */
HYI_FN uint32_t hyi_place_leaf(hyi_wide_walk *walk, uint32_t binary) {
    uint32_t ids[HYI_LEAF_MAX], first = walk->next_slot, count = walk->build->costs[binary].count;
    if (walk->writes || walk->build->best) count = hyi_gather_leaf(walk->build, binary, 0, ids); /* parts of one triangle count once */
    walk->next_slot += count;
    if (walk->writes) hyi_write_leaf(walk->build, first, count, ids);
    return hyi_make_leaf(first, count);
}

/* Hands a subtree to a task. The walk that writes meets the same ones in the same order as the one that counts. */
HYI_FN hydra_result hyi_hand_over(hyi_wide_walk *walk, uint32_t binary, uint32_t place, uint32_t level) {
    hyi_build *build = walk->build;
    size_t capacity = build->wide_task_capacity;
    uint32_t at = walk->next_task++;
    if (walk->writes) return HYDRA_OK;
    HYI_TRY(hyi_grow_array(build->context, &build->wide_tasks, &capacity, (size_t)at + 1u));
    build->wide_task_capacity = (uint32_t)capacity;
    memset(&build->wide_tasks[at], 0, sizeof build->wide_tasks[at]);
    build->wide_tasks[at].binary = binary;
    build->wide_tasks[at].place = place;
    build->wide_tasks[at].level = level;
    return HYDRA_OK;
}

/* The wide tree below a binary node that does not become a leaf, whose wide node has its place. */
HYI_FN hydra_result hyi_walk_wide(hyi_wide_walk *walk, uint32_t root, uint32_t root_place, uint32_t root_level) {
    uint32_t binary[HYI_TREE_DEPTH * HYI_WIDTH], place[HYI_TREE_DEPTH * HYI_WIDTH], level[HYI_TREE_DEPTH * HYI_WIDTH];
    hyi_build *build = walk->build;
    uint32_t waiting = 1;
    binary[0] = root;
    place[0] = root_place;
    level[0] = root_level;
    while (waiting > 0) {
        hyi_family family;
        uint32_t from = binary[--waiting], depth = level[waiting];
        hyi_node *node = walk->writes ? &build->bvh->nodes[place[waiting]] : NULL;
        if (walk->collects && (build->nodes[from].count & ~HYI_BUILD_INNER) <= HYI_WIDE_TASK) {
            HYI_TRY(hyi_hand_over(walk, from, place[waiting], depth));
            continue;
        }
        walk->depth = depth + 1u > walk->depth ? depth + 1u : walk->depth;
        hyi_gather_family(build, from, &family);
        walk->next_node += family.inner;
        if (node) hyi_clear_node(node);
        for (uint32_t c = family.count, at = walk->next_node; c-- > 0;) {
            uint32_t member = family.member[c], child;
            if (hyi_becomes_leaf(build, member)) {
                child = hyi_place_leaf(walk, member);
            } else {
                child = --at;
                binary[waiting] = member;
                place[waiting] = at;
                level[waiting++] = depth + 1u;
            }
            if (node) hyi_set_child(node, c, &build->nodes[member], child);
        }
    }
    return HYDRA_OK;
}

/* ---- the whole tree */

HYI_FN void hyi_count_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, false, false, 0, 0, 0, 0};
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
    task->nodes = walk.next_node;
    task->slots = walk.next_slot;
    task->depth = walk.depth;
}

HYI_FN void hyi_write_wide_task(void *argument, uint32_t index) {
    hyi_build *build = (hyi_build *)argument;
    const hyi_wide_task *task = &build->wide_tasks[index];
    hyi_wide_walk walk = {build, true, false, 0, 0, 0, 0};
    walk.next_node = task->first_node;
    walk.next_slot = task->first_slot;
    (void)hyi_walk_wide(&walk, task->binary, task->place, task->level);
}

/* Counts nodes and slots, and gives each task its own. */
HYI_FN hydra_result hyi_count_wide(hyi_build *build, uint32_t root) {
    hyi_wide_walk walk = {build, false, true, 1, 0, 0, 0};
    HYI_TRY(hyi_walk_wide(&walk, root, 0, 0));
    build->wide_task_count = walk.next_task;
    hyi_parallel(build->context, build->wide_task_count, hyi_count_wide_task, build);
    for (uint32_t t = 0; t < build->wide_task_count; t++) {
        hyi_wide_task *task = &build->wide_tasks[t];
        task->first_node = walk.next_node;
        task->first_slot = walk.next_slot;
        walk.next_node += task->nodes;
        walk.next_slot += task->slots;
        walk.depth = task->depth > walk.depth ? task->depth : walk.depth;
    }
    build->bvh->depth = walk.depth;
    build->bvh->node_count = walk.next_node;
    build->bvh->slot_count = walk.next_slot;
    return HYDRA_OK;
}

/* Arrays for the nodes and slots that were counted. */
HYI_FN hydra_result hyi_allocate_wide(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    HYI_TRY(hyi_alloc_array(build->context, &bvh->nodes, bvh->node_count));
    HYI_TRY(hyi_alloc_array(build->context, &bvh->ids, bvh->slot_count));
    bvh->bytes = (size_t)bvh->node_count * sizeof(hyi_node) + (size_t)bvh->slot_count * sizeof(uint32_t);
    if (!build->positions) return HYDRA_OK;
    size_t floats = hyi_bvh_row_floats(bvh->slot_count);
    HYI_TRY(hyi_alloc_array(build->context, &bvh->rows, floats));
    memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    bvh->bytes += floats * sizeof(float);
    return HYDRA_OK;
}

/* Allocates and writes what stays. */
HYI_FN hydra_result hyi_collapse(hyi_build *build) {
    hyi_bvh *bvh = build->bvh;
    uint32_t root = build->node_capacity - 1u, ids[HYI_LEAF_MAX];
    bool one_leaf = hyi_becomes_leaf(build, root);
    bvh->scale = build->scale;
    hyi_bounds_store(&build->root_box, bvh->scaled.lower, bvh->scaled.upper);
    if (one_leaf) {
        bvh->slot_count = hyi_gather_leaf(build, root, 0, ids);
        HYI_TRY(hyi_allocate_wide(build));
        bvh->root = hyi_make_leaf(0, bvh->slot_count);
        hyi_write_leaf(build, 0, bvh->slot_count, ids);
        return HYDRA_OK;
    }
    HYI_TRY(hyi_count_wide(build, root));
    HYI_TRY(hyi_allocate_wide(build));
    bvh->root = 0;
    hyi_wide_walk walk = {build, true, true, 1, 0, 0, 0};
    HYI_TRY(hyi_walk_wide(&walk, root, 0, 0));
    hyi_parallel(build->context, build->wide_task_count, hyi_write_wide_task, build);
    return HYDRA_OK;
}

#endif /* HYI_BVH_BUILD_COLLAPSE_H */

/* >>bvh-build: from triangles or boxes to a tree */
#ifndef HYI_BVH_BUILD_H
#define HYI_BVH_BUILD_H

HYI_FN void hyi_build_release(hyi_build *build) {
    hyi_free_array(build->context, &build->chunk_splits, build->chunk_split_count);
    hyi_free_array(build->context, &build->chunks, build->chunk_count);
    hyi_free_array(build->context, &build->refs, build->capacity);
    hyi_free_array(build->context, &build->other, build->capacity);
    hyi_free_array(build->context, &build->nodes, build->node_capacity);
    hyi_free_array(build->context, &build->costs, build->node_capacity);
    hyi_free_array(build->context, &build->tasks, build->task_capacity);
    hyi_free_array(build->context, &build->wide_tasks, build->wide_task_capacity);
}

HYI_FN hydra_result hyi_build_steps(hyi_build *build) {
    HYI_TRY(hyi_build_refs(build));
    if (build->ref_count == 0) return HYDRA_OK;
    HYI_TRY(hyi_build_tree(build));
    hyi_free_array(build->context, &build->other, build->capacity);
    hyi_free_array(build->context, &build->chunk_splits, build->chunk_split_count);
    HYI_TRY(hyi_build_costs(build));
    return hyi_collapse(build);
}

/* On failure everything is freed and the tree is empty. */
HYI_FN hydra_result hyi_build_run(hyi_build *build) {
    memset(build->bvh, 0, sizeof *build->bvh);
    if (build->source_count == 0) return HYDRA_OK;
    if (build->source_count > HYI_PRIMITIVES_MAX) {
        return hyi_fail(build->context, HYDRA_ERROR_COUNT, "%u primitives in one tree, the limit is %u", build->source_count,
                        HYI_PRIMITIVES_MAX);
    }
    hydra_result result = hyi_build_steps(build);
    hyi_build_release(build);
    if (result != HYDRA_OK) hyi_bvh_free(build->context, build->bvh);
    return result;
}

/* positions: x, y, z tightly packed and finite; indices: three a triangle, in range; quality: BEST or FAST. The tree
   depends on these alone, not on threads. Degenerate triangles are dropped and counted. With BEST a triangle may
   stand in several leaves. */
HYI_FN hydra_result hyi_bvh_build_triangles(hydra_context *context, const float *positions, const uint32_t *indices,
                                            uint32_t triangle_count, hydra_build quality, hyi_bvh *bvh) {
    hyi_build build;
    memset(&build, 0, sizeof build);
    build.context = context;
    build.positions = positions;
    build.indices = indices;
    build.source_count = triangle_count;
    build.leaf_max = context->device ? HYI_LEAF_MAX_DEVICE : HYI_LEAF_MAX;
    build.best = quality != HYDRA_BUILD_FAST;
    build.bvh = bvh;
    return hyi_build_run(&build);
}

/* A leaf is one box: it stands in its parent already. */
HYI_FN hydra_result hyi_bvh_build_boxes(hydra_context *context, const hyi_box *boxes, uint32_t count, hyi_bvh *bvh) {
    hyi_build build;
    memset(&build, 0, sizeof build);
    build.context = context;
    build.boxes = boxes;
    build.source_count = count;
    build.leaf_max = 1;
    build.bvh = bvh;
    return hyi_build_run(&build);
}

#endif /* HYI_BVH_BUILD_H */

/* >>bvh-refit: a tree over triangles that moved: same nodes, new boxes and rows, and what it costs now

   Boxes are made anew from the leaves up, every reference taking the whole of its triangle (a build with spatial splits
   had cut some of them). Parts of the tree are refitted by all threads; minima and maxima come out the same in any order,
   and sums are added up in the order of the parts, which depends on the tree alone. */
#ifndef HYI_BVH_REFIT_H
#define HYI_BVH_REFIT_H

/* ---- boxes of points as the caller gave them: in any part of float's range */

HYI_INLINE hyi_bounds hyi_raw_empty(void) {
    hyi_bounds box;
    box.lower = hyi_four_all(FLT_MAX);
    box.upper = hyi_four_all(-FLT_MAX);
    return box;
}

HYI_INLINE hyi_box hyi_box_of(const hyi_bounds *bounds) {
    hyi_box box;
    hyi_bounds_store(bounds, box.lower, box.upper);
    return box;
}

HYI_INLINE hyi_four hyi_point(const float *p) { return hyi_four_make(p[0], p[1], p[2]); }

/* x, y and z, each stride floats behind the other. */
HYI_INLINE void hyi_four_scatter(hyi_four a, float *to, uint32_t stride) {
#if HYI_X86
    _mm_store_ss(to, a);
    _mm_store_ss(to + stride, _mm_shuffle_ps(a, a, 1));
    _mm_store_ss(to + 2u * stride, _mm_movehl_ps(a, a));
#else
    float lanes[4];
    hyi_four_store(lanes, a);
    for (uint32_t i = 0; i < 3; i++) to[i * stride] = lanes[i];
#endif
}

/* ---- expected cost */

/* What visiting a child adds to the cost of a tree, by the share of rays that come there. */
HYI_INLINE double hyi_child_cost(uint32_t child) {
    if (!hyi_child_is_leaf(child)) return (double)HYI_COST_NODE;
    return (double)HYI_COST_LEAF + (double)HYI_COST_TRIANGLE * (double)hyi_leaf_count(child);
}

/* areas: the sum of hyi_child_cost times area over all children. The unit is the visit of a node. */
HYI_INLINE float hyi_relative_cost(const hyi_bvh *bvh, double areas, double area) {
    return (float)((hyi_child_cost(bvh->root) + (area > 0.0 ? areas / area : 0.0)) / (double)HYI_COST_NODE);
}

/* Expected cost of a ray that meets the tree's bounds and nothing in them (MacDonald and Booth 1990). */
HYI_FN float hyi_bvh_cost(const hyi_bvh *bvh) {
    double areas = 0.0;
    if (bvh->primitive_count == 0) return 0.0f;
    for (uint32_t n = 0; n < bvh->node_count; n++) {
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(bvh, n, c);
            if (child == HYI_CHILD_NONE) break;
            hyi_box box = hyi_node_box(bvh, n, c);
            areas += hyi_child_cost(child) * hyi_box_area(&box);
        }
    }
    return hyi_relative_cost(bvh, areas, hyi_box_area(&bvh->scaled));
}

/* ---- leaves */

/* What a part of the tree comes to. */
typedef struct hyi_refit_sum {
    hyi_bounds real;  /* bounds of the triangles that have an area */
    uint32_t collapsed; /* references to others */
    double areas;       /* see hyi_relative_cost */
} hyi_refit_sum;

/* A subtree. The first ones are opened: their nodes' inner children are parts of their own, from first_child on. */
typedef struct hyi_refit_part {
    uint32_t node, first_child;
    hyi_bounds box;
    hyi_refit_sum sum;
} hyi_refit_part;

typedef struct hyi_refit {
    hydra_context *context;
    const float *positions;
    const uint32_t *indices;
    hyi_bvh *bvh;
    float scale;
    hyi_refit_part *parts;
    uint32_t part_count, opened;
} hyi_refit;

HYI_INLINE hyi_refit_sum hyi_refit_nothing(void) {
    hyi_refit_sum sum;
    sum.real = hyi_raw_empty();
    sum.collapsed = 0;
    sum.areas = 0.0;
    return sum;
}

HYI_FN void hyi_refit_add(hyi_refit_sum *sum, const hyi_refit_sum *more) {
    hyi_bounds_add(&sum->real, more->real.lower, more->real.upper);
    sum->collapsed += more->collapsed;
    sum->areas += more->areas;
}

/* hyi_triangle_is_degenerate, answered in float where float is sure: each part of the cross product, p - q, is off by a
   few 2^-24 of |p| + |q|, unless that is next to underflow; overflow makes no comparison true. */
HYI_INLINE bool hyi_four_is_flat(hyi_four a, hyi_four b, hyi_four c, const float *pa, const float *pb, const float *pc) {
    hyi_four e = hyi_four_sub(b, a), f = hyi_four_sub(c, a);
    hyi_four p = hyi_four_mul(hyi_four_turn(e), hyi_four_turn(hyi_four_turn(f))), q = hyi_four_mul(hyi_four_turn(hyi_four_turn(e)), hyi_four_turn(f));
    hyi_four size = hyi_four_add(hyi_four_abs(p), hyi_four_abs(q));
    hyi_four doubt = hyi_four_add(hyi_four_mul(size, hyi_four_all(9.5367431640625e-07f)), hyi_four_all(7.52316384526264e-37f));
    return !hyi_four_exceeds(hyi_four_abs(hyi_four_sub(p, q)), doubt) && hyi_triangle_is_degenerate(pa, pb, pc);
}

/* Writes the rows of one triangle and adds it to the leaf's box; false: it has no area. It is then written as a point,
   which no ray hits. point: its first corner. */
HYI_INLINE bool hyi_refit_lane(const hyi_refit *refit, const uint32_t *index, float *rows, uint32_t count, hyi_bounds *box,
                               hyi_four *point) {
    const float *pa = refit->positions + 3u * (size_t)index[0];
    const float *pb = refit->positions + 3u * (size_t)index[1];
    const float *pc = refit->positions + 3u * (size_t)index[2];
    hyi_four a = hyi_point(pa), b = hyi_point(pb), c = hyi_point(pc), scale = hyi_four_all(refit->scale);
    bool flat = hyi_four_is_flat(a, b, c, pa, pb, pc);
    if (HYI_UNLIKELY(flat))
        b = c = a;
    else
        hyi_bounds_add(box, hyi_four_min(a, hyi_four_min(b, c)), hyi_four_max(a, hyi_four_max(b, c)));
    hyi_four_scatter(hyi_four_mul(a, scale), rows, count);
    hyi_four_scatter(hyi_four_mul(b, scale), rows + 3u * count, count);
    hyi_four_scatter(hyi_four_mul(c, scale), rows + 6u * count, count);
    *point = a;
    return !flat;
}

/* Box of a leaf's triangles, whose rows are written. One without area counts for it only where there is no other. */
HYI_FN hyi_bounds hyi_refit_leaf(const hyi_refit *refit, uint32_t leaf, hyi_refit_sum *sum) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    const uint32_t *ids = refit->bvh->ids + first;
    hyi_bounds box = hyi_raw_empty();
    hyi_four point = box.lower;
    for (uint32_t lane = 0; lane < count; lane++) {
        float *rows = hyi_leaf_lane(refit->bvh, first, lane);
        if (!hyi_refit_lane(refit, refit->indices + 3u * (size_t)ids[lane], rows, count, &box, &point)) sum->collapsed++;
    }
    hyi_bounds_add(&sum->real, box.lower, box.upper);
    if (hyi_bounds_are_empty(&box)) box.lower = box.upper = point;
    return box;
}

/* ---- nodes */

/* Writes a node whose children's boxes are known; returns their union. */
HYI_FN hyi_bounds hyi_refit_close(const hyi_refit *refit, uint32_t node, const hyi_bounds *raw, hyi_refit_sum *sum) {
    hyi_four scale = hyi_four_all(refit->scale);
    hyi_bounds all = hyi_raw_empty();
    hyi_box boxes[HYI_WIDTH];
    uint32_t count = 0;
    for (; count < HYI_WIDTH; count++) {
        uint32_t child = hyi_node_child(refit->bvh, node, count);
        if (child == HYI_CHILD_NONE) break;
        hyi_bounds_add(&all, raw[count].lower, raw[count].upper);
        hyi_four_scatter(hyi_four_mul(raw[count].lower, scale), boxes[count].lower, 1);
        hyi_four_scatter(hyi_four_mul(raw[count].upper, scale), boxes[count].upper, 1);
        sum->areas += hyi_child_cost(child) * hyi_box_area(&boxes[count]);
    }
    hyi_node_move(refit->bvh, node, boxes, count);
    return all;
}

/* A node on the way down, and the boxes of its children as far as they are known. */
typedef struct hyi_refit_frame {
    uint32_t node, next;
    hyi_bounds boxes[HYI_WIDTH];
} hyi_refit_frame;

/* Depth first, so that a node is written when its leaves have just been. */
HYI_FN hyi_bounds hyi_refit_subtree(const hyi_refit *refit, uint32_t root, hyi_refit_sum *sum) {
    hyi_refit_frame frames[HYI_TREE_DEPTH];
    uint32_t level = 0;
    frames[0].node = root;
    frames[0].next = 0;
    for (;;) {
        hyi_refit_frame *frame = &frames[level];
        uint32_t child = frame->next < HYI_WIDTH ? hyi_node_child(refit->bvh, frame->node, frame->next) : HYI_CHILD_NONE;
        if (child == HYI_CHILD_NONE) {
            hyi_bounds box = hyi_refit_close(refit, frame->node, frame->boxes, sum);
            if (level == 0) return box;
            frame = &frames[--level];
            frame->boxes[frame->next++] = box;
        } else if (hyi_child_is_leaf(child)) {
            frame->boxes[frame->next++] = hyi_refit_leaf(refit, child, sum);
        } else {
            frames[++level].node = child;
            frames[level].next = 0;
        }
    }
}

/* ---- parts */

/* Enough to keep threads evenly busy; a smaller tree is one part. */
#define HYI_REFIT_PARTS 512u

/* Opens parts from the root down, in the order they come, until there are enough. */
HYI_FN void hyi_refit_divide(hyi_refit *refit) {
    refit->part_count = 1;
    refit->opened = 0;
    refit->parts[0].node = 0;
    if (refit->bvh->node_count <= HYI_REFIT_PARTS) return;
    for (; refit->part_count + HYI_WIDTH <= HYI_REFIT_PARTS && refit->opened < refit->part_count; refit->opened++) {
        hyi_refit_part *part = &refit->parts[refit->opened];
        part->first_child = refit->part_count;
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(refit->bvh, part->node, c);
            if (child == HYI_CHILD_NONE) break;
            if (!hyi_child_is_leaf(child)) refit->parts[refit->part_count++].node = child;
        }
    }
}

HYI_FN void hyi_refit_part_task(void *argument, uint32_t index) {
    hyi_refit *refit = (hyi_refit *)argument;
    hyi_refit_part *part = &refit->parts[refit->opened + index];
    hyi_refit_sum sum = hyi_refit_nothing(); /* a local one: parts of other threads lie close */
    part->box = hyi_refit_subtree(refit, part->node, &sum);
    part->sum = sum;
}

/* The node of an opened part, when those below it are done. */
HYI_FN void hyi_refit_opened(const hyi_refit *refit, hyi_refit_part *part) {
    hyi_bounds boxes[HYI_WIDTH];
    uint32_t below = part->first_child;
    part->sum = hyi_refit_nothing();
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        uint32_t child = hyi_node_child(refit->bvh, part->node, c);
        if (child == HYI_CHILD_NONE) break;
        boxes[c] = hyi_child_is_leaf(child) ? hyi_refit_leaf(refit, child, &part->sum) : refit->parts[below++].box;
    }
    part->box = hyi_refit_close(refit, part->node, boxes, &part->sum);
}

/* Refits everything; box: of the whole tree. */
HYI_FN hyi_refit_sum hyi_refit_pass(hyi_refit *refit, hyi_bounds *box) {
    hyi_refit_sum sum = hyi_refit_nothing();
    if (hyi_child_is_leaf(refit->bvh->root)) {
        *box = hyi_refit_leaf(refit, refit->bvh->root, &sum);
        return sum;
    }
    hyi_refit_divide(refit);
    hyi_parallel(refit->context, refit->part_count - refit->opened, hyi_refit_part_task, refit);
    for (uint32_t p = refit->opened; p-- > 0;) hyi_refit_opened(refit, &refit->parts[p]);
    for (uint32_t p = 0; p < refit->part_count; p++) hyi_refit_add(&sum, &refit->parts[p].sum);
    *box = refit->parts[0].box;
    return sum;
}

/* ---- what the tree must hold */

/* Whether a scale keeps coordinates as near to 1 as hyi_build_scale wants them; those far below may be anywhere. */
HYI_FN bool hyi_scale_serves(float scale, const hyi_box *box, bool from_below) {
    float largest = hyi_box_largest(box);
    int exponent = 0;
    (void)frexp((double)largest * (double)scale, &exponent);
    return largest <= 0.0f || (exponent <= 20 && (exponent >= -20 || !from_below));
}

/* Marks the triangles that the tree holds; returns how many. marks: a bit each, zeroed. */
HYI_FN uint32_t hyi_mark_held(const hyi_bvh *bvh, uint32_t *marks) {
    uint32_t held = 0;
    for (uint32_t s = 0; s < bvh->slot_count; s++) {
        uint32_t *word = &marks[bvh->ids[s] / 32u], bit = 1u << (bvh->ids[s] % 32u);
        held += *word & bit ? 0u : 1u;
        *word |= bit;
    }
    return held;
}

/* Counts triangles without area. lost: one that has an area is not in the tree. all: those in the tree may have none. */
HYI_FN uint32_t hyi_count_flat(const hyi_refit *refit, const uint32_t *marks, uint32_t triangle_count, bool all, bool *lost) {
    uint32_t flat = 0;
    *lost = false;
    for (uint32_t t = 0; t < triangle_count; t++) {
        bool held = (marks[t / 32u] >> (t % 32u) & 1u) != 0u;
        if (held && !all) {
            t |= marks[t / 32u] == 0xffffffffu ? 31u : 0u; /* on to the next word */
            continue;
        }
        const uint32_t *index = refit->indices + 3u * (size_t)t;
        const float *p = refit->positions;
        bool is_flat = hyi_triangle_is_degenerate(p + 3u * (size_t)index[0], p + 3u * (size_t)index[1], p + 3u * (size_t)index[2]);
        flat += is_flat ? 1u : 0u;
        *lost = *lost || (!is_flat && !held);
    }
    return flat;
}

HYI_INLINE size_t hyi_mark_words(uint32_t count) { return ((size_t)count + 31u) / 32u; }

/* Sets the number of triangles without area. lost: the tree cannot serve these positions, as a triangle that its build
   dropped has an area now. */
HYI_FN hydra_result hyi_refit_census(const hyi_refit *refit, uint32_t triangle_count, uint32_t collapsed, bool *lost) {
    hyi_bvh *bvh = refit->bvh;
    *lost = false;
    bvh->degenerate = 0;
    if (collapsed == 0 && bvh->primitive_count == triangle_count) return HYDRA_OK;
    uint32_t *marks;
    size_t words = hyi_mark_words(triangle_count);
    HYI_TRY(hyi_alloc_array(refit->context, &marks, words));
    memset(marks, 0, words * sizeof *marks);
    (void)hyi_mark_held(bvh, marks);
    bvh->degenerate = hyi_count_flat(refit, marks, triangle_count, collapsed != 0, lost);
    hyi_free_array(refit->context, &marks, words);
    return HYDRA_OK;
}

/* Bounds of what rays can hit, and the scale. */
HYI_FN void hyi_refit_finish(const hyi_refit *refit, const hyi_box *real) {
    hyi_bvh *bvh = refit->bvh;
    bvh->bounds = *real;
    bvh->scale = refit->scale;
    for (int a = 0; a < 3; a++) {
        bvh->scaled.lower[a] = real->lower[a] * refit->scale;
        bvh->scaled.upper[a] = real->upper[a] * refit->scale;
    }
}

/* A scale that no longer serves costs a second pass. */
HYI_FN hydra_result hyi_refit_run(hyi_refit *refit, uint32_t triangle_count, bool *fits, float *cost) {
    hyi_bounds box;
    bool lost, empty;
    hyi_refit_sum sum = hyi_refit_pass(refit, &box);
    hyi_box real = hyi_box_of(&sum.real), all;
    empty = hyi_bounds_are_empty(&sum.real);
    if (!empty && !hyi_scale_serves(refit->scale, &real, true)) {
        refit->scale = hyi_build_scale(&real);
        sum = hyi_refit_pass(refit, &box);
    }
    all = hyi_box_of(&box);
    HYI_TRY(hyi_refit_census(refit, triangle_count, sum.collapsed, &lost));
    *fits = !lost && !empty && hyi_scale_serves(refit->scale, &all, false);
    if (!*fits) return HYDRA_OK;
    hyi_refit_finish(refit, &real);
    *cost = hyi_relative_cost(refit->bvh, sum.areas, hyi_box_area(&refit->bvh->scaled));
    return HYDRA_OK;
}

/* Fits a tree to new positions of the triangles it was built over. fits is false where it cannot be done: no triangle
   that it holds has an area, one that it does not hold has one, or one without area lies too far outside for any scale.
   The tree must then be built again. After an error it may be refitted once more. */
HYI_FN hydra_result hyi_bvh_refit(hydra_context *context, const float *positions, const uint32_t *indices, uint32_t triangle_count,
                                  hyi_bvh *bvh, bool *fits, float *cost) {
    hyi_refit refit;
    memset(&refit, 0, sizeof refit);
    refit.context = context;
    refit.positions = positions;
    refit.indices = indices;
    refit.bvh = bvh;
    refit.scale = bvh->scale;
    *fits = false;
    if (bvh->primitive_count == 0) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &refit.parts, HYI_REFIT_PARTS));
    hydra_result result = hyi_refit_run(&refit, triangle_count, fits, cost);
    hyi_free_array(context, &refit.parts, HYI_REFIT_PARTS);
    return result;
}

#endif /* HYI_BVH_REFIT_H */

/* >>bvh-save: a tree as bytes, and bytes as a tree again, once everything in them has been checked

   Saved are the nodes, as they lie in memory, and the ids by slot; rows are written from the triangles when a tree is
   adopted, so bytes of others bring no coordinates. Checking is one pass: each node is the child of one node before it and
   no deeper than stacks are, each slot belongs to one leaf, ids are in range, boxes are finite, and what is no child
   cannot be entered. Then no ray can do worse than miss. */
#ifndef HYI_BVH_SAVE_H
#define HYI_BVH_SAVE_H

#define HYI_TREES_MAGIC 0x54524459u /* YDRT; another byte order reads it as something else */
#define HYI_TREES_VERSION 1u        /* counts changes of the format, of nodes and of what they mean */

typedef struct hyi_trees_header {
    uint32_t magic, version;
    uint64_t checksum; /* of all that follows */
    uint64_t size;     /* of everything */
    uint32_t layout, tree_count;
} hyi_trees_header;
#define HYI_TREES_CHECKED_FROM 16u

/* Stands before each tree's nodes and ids. */
typedef struct hyi_tree_record {
    uint64_t fingerprint; /* of what it was built from */
    uint32_t triangle_count, primitive_count, node_count, slot_count, root;
    float scale, cost_when_built;
    uint32_t refitted;
} hyi_tree_record;

HYI_STATIC_ASSERT(sizeof(hyi_trees_header) == 32 && sizeof(hyi_tree_record) == 40);

/* Tells machines and layouts apart whose trees are no use to each other. */
HYI_INLINE uint32_t hyi_trees_layout(void) { return (uint32_t)sizeof(hyi_node) | HYI_WIDTH << 16 | HYI_LEAF_MAX << 24; }

/* ---- a hash

   Four independent chains hide the latency of the multiplication, which is what counts with megabytes. Every step is a
   bijection of the chain for a given word and of the word for a given chain, so no change of a single word is missed. */

HYI_INLINE uint64_t hyi_hash_step(uint64_t hash, uint64_t word) {
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    return hash ^ (hash >> 29);
}

HYI_FN uint64_t hyi_hash(uint64_t seed, const void *data, size_t size) {
    const unsigned char *at = (const unsigned char *)data;
    uint64_t chain[4], words[4];
    for (uint32_t i = 0; i < 4; i++) chain[i] = hyi_hash_step(seed, i + 1u);
    for (size_t left = size; left >= sizeof words; left -= sizeof words, at += sizeof words) {
        memcpy(words, at, sizeof words);
        for (int i = 0; i < 4; i++) chain[i] = hyi_hash_step(chain[i], words[i]);
    }
    memset(words, 0, sizeof words);
    if (size % sizeof words) memcpy(words, at, size % sizeof words);
    uint64_t hash = hyi_hash_step(seed, (uint64_t)size);
    for (int i = 0; i < 4; i++) hash = hyi_hash_step(hash, hyi_hash_step(chain[i], words[i]));
    return hash;
}

/* ---- bytes */

/* Each array of a tree is padded to eight bytes, so that records and nodes lie aligned where the whole does. */
HYI_INLINE size_t hyi_padded(size_t size) { return (size + 7u) & ~(size_t)7u; }

HYI_FN size_t hyi_tree_bytes(const hyi_bvh *bvh) {
    size_t nodes = (size_t)bvh->node_count * sizeof *bvh->nodes, ids = (size_t)bvh->slot_count * sizeof *bvh->ids;
    return sizeof(hyi_tree_record) + hyi_padded(nodes) + hyi_padded(ids);
}

HYI_FN unsigned char *hyi_put(unsigned char *out, const void *data, size_t size) {
    if (size) memcpy(out, data, size);
    memset(out + size, 0, hyi_padded(size) - size);
    return out + hyi_padded(size);
}

/* Writes hyi_tree_bytes; returns what is behind them. record: but for what the tree knows. */
HYI_FN unsigned char *hyi_put_tree(unsigned char *out, const hyi_bvh *bvh, hyi_tree_record record) {
    record.primitive_count = bvh->primitive_count;
    record.node_count = bvh->node_count;
    record.slot_count = bvh->slot_count;
    record.root = bvh->root;
    record.scale = bvh->scale;
    out = hyi_put(out, &record, sizeof record);
    out = hyi_put(out, bvh->nodes, (size_t)bvh->node_count * sizeof *bvh->nodes);
    return hyi_put(out, bvh->ids, (size_t)bvh->slot_count * sizeof *bvh->ids);
}

/* What is left to read. */
typedef struct hyi_bytes {
    const unsigned char *at;
    size_t left;
} hyi_bytes;

/* Copies count elements; false: there are not so many. */
HYI_FN bool hyi_get(hyi_bytes *in, void *data, size_t count, size_t element) {
    if (count > in->left / element || hyi_padded(count * element) > in->left) return false;
    if (count) memcpy(data, in->at, count * element);
    in->at += hyi_padded(count * element);
    in->left -= hyi_padded(count * element);
    return true;
}

/* ---- checking */

typedef struct hyi_tree_check {
    const hyi_bvh *bvh;
    uint8_t *level;  /* by node, from 1; 0: no node before it has it for a child */
    uint32_t *slots; /* a bit each: belongs to a leaf */
    uint32_t slots_seen;
} hyi_tree_check;

/* Whether the box is finite and the right way round, or for an unused child the wrong way round on every axis. */
HYI_FN bool hyi_check_box(const hyi_box *box, bool used) {
    for (int a = 0; a < 3; a++) {
        if (!hyk_is_finite(box->lower[a]) || !hyk_is_finite(box->upper[a])) return false;
        if (used ? box->lower[a] > box->upper[a] : box->lower[a] <= box->upper[a]) return false;
    }
    return true;
}

HYI_FN bool hyi_check_leaf(hyi_tree_check *check, uint32_t leaf) {
    uint32_t first = hyi_leaf_first(leaf), count = hyi_leaf_count(leaf);
    if (first >= check->bvh->slot_count || count > check->bvh->slot_count - first || count > HYI_LEAF_MAX) return false;
    for (uint32_t s = first; s < first + count; s++) {
        uint32_t bit = 1u << (s % 32u);
        if (check->slots[s / 32u] & bit) return false;
        check->slots[s / 32u] |= bit;
    }
    check->slots_seen += count;
    return true;
}

/* A node that was checked before this one has its level, so children that lead back are refused too. */
HYI_FN bool hyi_check_inner(hyi_tree_check *check, uint32_t node, uint32_t child) {
    if (child >= check->bvh->node_count || check->level[child] != 0) return false;
    check->level[child] = (uint8_t)(check->level[node] + 1u);
    return check->level[child] <= HYI_TREE_DEPTH;
}

HYI_FN bool hyi_check_node(hyi_tree_check *check, uint32_t node) {
    uint32_t used = 0;
    if (check->level[node] == 0) return false;
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        uint32_t child = hyi_node_child(check->bvh, node, c);
        hyi_box box = hyi_node_box(check->bvh, node, c);
        if (!hyi_check_box(&box, child != HYI_CHILD_NONE)) return false;
        if (child == HYI_CHILD_NONE) continue;
        if (used++ != c) return false; /* children stand before what is none */
        if (!(hyi_child_is_leaf(child) ? hyi_check_leaf(check, child) : hyi_check_inner(check, node, child))) return false;
    }
    return used > 0;
}

HYI_FN bool hyi_check_nodes(hyi_tree_check *check, uint32_t *depth) {
    const hyi_bvh *bvh = check->bvh;
    *depth = 0;
    if (hyi_child_is_leaf(bvh->root)) {
        if (bvh->node_count != 0 || !hyi_check_leaf(check, bvh->root)) return false;
    } else {
        if (bvh->root != 0 || bvh->node_count == 0) return false;
        check->level[0] = 1;
    }
    for (uint32_t n = 0; n < bvh->node_count; n++) {
        if (!hyi_check_node(check, n)) return false;
        *depth = check->level[n] > *depth ? check->level[n] : *depth;
    }
    return check->slots_seen == bvh->slot_count;
}

/* Numbers that need no more than themselves. */
HYI_FN bool hyi_check_record(const hyi_tree_record *record) {
    int exponent;
    if (record->slot_count == 0 || record->slot_count > HYI_PRIMITIVES_MAX || record->node_count > record->slot_count) return false;
    if (record->primitive_count == 0 || record->primitive_count > record->slot_count) return false;
    if (record->primitive_count > record->triangle_count || record->triangle_count > HYI_PRIMITIVES_MAX || record->refitted > 1u)
        return false;
    if (!hyk_is_finite(record->scale) || !(record->scale > 0.0f) || frexpf(record->scale, &exponent) != 0.5f) return false;
    return hyk_is_finite(record->cost_when_built) && record->cost_when_built >= 0.0f;
}

HYI_FN bool hyi_check_ids(const hyi_bvh *bvh, uint32_t triangle_count, uint32_t *marks) {
    for (uint32_t s = 0; s < bvh->slot_count; s++)
        if (bvh->ids[s] >= triangle_count) return false;
    return hyi_mark_held(bvh, marks) == bvh->primitive_count;
}

/* sound: the tree may be walked, refitted and adopted. */
HYI_FN hydra_result hyi_check_tree(hydra_context *context, hyi_bvh *bvh, uint32_t triangle_count, bool *sound) {
    size_t slot_words = hyi_mark_words(bvh->slot_count), id_words = hyi_mark_words(triangle_count), words = slot_words + id_words;
    hyi_tree_check check;
    memset(&check, 0, sizeof check);
    check.bvh = bvh;
    HYI_TRY(hyi_alloc_array(context, &check.slots, words));
    hydra_result result = hyi_alloc_array(context, &check.level, bvh->node_count);
    if (result == HYDRA_OK) {
        memset(check.slots, 0, words * sizeof *check.slots);
        if (bvh->node_count) memset(check.level, 0, bvh->node_count);
        *sound = hyi_check_nodes(&check, &bvh->depth) && hyi_check_ids(bvh, triangle_count, check.slots + slot_words);
    }
    hyi_free_array(context, &check.level, bvh->node_count);
    hyi_free_array(context, &check.slots, words);
    return result;
}

/* ---- reading */

HYI_FN hydra_result hyi_get_arrays(hydra_context *context, hyi_bytes *in, hyi_bvh *bvh, bool *sound) {
    hydra_result result = hyi_alloc_array(context, &bvh->nodes, bvh->node_count);
    if (result == HYDRA_OK) result = hyi_alloc_array(context, &bvh->ids, bvh->slot_count);
    if (result != HYDRA_OK) return result;
    *sound = hyi_get(in, bvh->nodes, bvh->node_count, sizeof *bvh->nodes) && hyi_get(in, bvh->ids, bvh->slot_count, sizeof *bvh->ids);
    return HYDRA_OK;
}

/* Reads a tree without rows; to be freed whatever comes of it. sound: false: it is damaged. */
HYI_FN hydra_result hyi_get_tree(hydra_context *context, hyi_bytes *in, hyi_tree_record *record, hyi_bvh *bvh, bool *sound) {
    memset(bvh, 0, sizeof *bvh);
    *sound = hyi_get(in, record, 1, sizeof *record) && hyi_check_record(record);
    /* no memory is asked for what the bytes cannot hold */
    *sound = *sound && record->node_count <= in->left / sizeof(hyi_node) && record->slot_count <= in->left / sizeof(uint32_t);
    if (!*sound) return HYDRA_OK;
    bvh->node_count = record->node_count;
    bvh->slot_count = record->slot_count;
    bvh->primitive_count = record->primitive_count;
    bvh->root = record->root;
    bvh->scale = record->scale;
    HYI_TRY(hyi_get_arrays(context, in, bvh, sound));
    return *sound ? hyi_check_tree(context, bvh, record->triangle_count, sound) : HYDRA_OK;
}

/* ---- adopting: rows, bounds and counts from the triangles */

HYI_FN void hyi_adopt_chunk(void *argument, uint32_t chunk) {
    hyi_refit *refit = (hyi_refit *)argument;
    hyi_refit_sum sum = hyi_refit_nothing();
    uint32_t end = hyi_chunk_end(chunk, refit->bvh->node_count);
    for (uint32_t n = chunk * HYI_BUILD_CHUNK; n < end; n++) {
        for (uint32_t c = 0; c < HYI_WIDTH; c++) {
            uint32_t child = hyi_node_child(refit->bvh, n, c);
            if (child == HYI_CHILD_NONE) break;
            if (hyi_child_is_leaf(child)) (void)hyi_refit_leaf(refit, child, &sum);
        }
    }
    refit->parts[chunk].sum = sum;
}

HYI_FN hyi_refit_sum hyi_adopt_leaves(hyi_refit *refit) {
    hyi_refit_sum sum = hyi_refit_nothing();
    if (hyi_child_is_leaf(refit->bvh->root)) (void)hyi_refit_leaf(refit, refit->bvh->root, &sum);
    hyi_parallel(refit->context, refit->part_count, hyi_adopt_chunk, refit);
    for (uint32_t p = 0; p < refit->part_count; p++) hyi_refit_add(&sum, &refit->parts[p].sum);
    return sum;
}

HYI_FN hydra_result hyi_adopt_steps(hyi_refit *refit, uint32_t triangle_count, bool *fits) {
    hyi_bvh *bvh = refit->bvh;
    bool lost;
    memset(bvh->rows + 9u * (size_t)bvh->slot_count, 0, HYI_ROWS_PADDING * sizeof(float));
    hyi_refit_sum sum = hyi_adopt_leaves(refit);
    HYI_TRY(hyi_refit_census(refit, triangle_count, sum.collapsed, &lost));
    hyi_box real = hyi_box_of(&sum.real);
    *fits = !lost && !hyi_bounds_are_empty(&sum.real) && hyi_scale_serves(refit->scale, &real, true);
    hyi_refit_finish(refit, &real);
    bvh->bytes = (size_t)bvh->node_count * sizeof *bvh->nodes + (size_t)bvh->slot_count * sizeof *bvh->ids;
    bvh->bytes += hyi_bvh_row_floats(bvh->slot_count) * sizeof *bvh->rows;
    return HYDRA_OK;
}

/* Makes a tree that was read serve these triangles, of the number it was made for. fits false: it does not. On failure
   it has no rows and is as it was. */
HYI_FN hydra_result hyi_bvh_adopt(hydra_context *context, const float *positions, const uint32_t *indices, uint32_t triangle_count,
                                  hyi_bvh *bvh, bool *fits) {
    hyi_refit refit;
    memset(&refit, 0, sizeof refit);
    refit.context = context;
    refit.positions = positions;
    refit.indices = indices;
    refit.bvh = bvh;
    refit.scale = bvh->scale;
    refit.part_count = (bvh->node_count + HYI_BUILD_CHUNK - 1u) / HYI_BUILD_CHUNK;
    *fits = false;
    HYI_TRY(hyi_alloc_array(context, &refit.parts, refit.part_count));
    hydra_result result = hyi_alloc_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    if (result == HYDRA_OK) result = hyi_adopt_steps(&refit, triangle_count, fits);
    hyi_free_array(context, &refit.parts, refit.part_count);
    if (result != HYDRA_OK && bvh->rows) hyi_free_array(context, &bvh->rows, hyi_bvh_row_floats(bvh->slot_count));
    return result;
}

#endif /* HYI_BVH_SAVE_H */

/* >>bvh-triangle: a ray made ready for one tree, and the watertight triangle test

   Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection", JCGT 2 (1). Corners are moved to the
   ray's origin and sheared so that the ray becomes the z axis; the signs of three edge functions decide.
   An edge shared by two triangles gets the same value with opposite sign in both, so a ray cannot pass
   between them.

   Here each vector unit only throws out triangles whose edge functions differ in sign in float: rounding
   is monotone, so a product difference of the wrong sign cannot come out, only zero. What remains is
   decided by hyi_confirm in double, where products of two floats are exact: signs are then exact for the
   sheared corners, and u, v keep their bits on needles. t comes from the plane of the unsheared corners: a
   ray that starts exactly in the plane of a triangle gets t 0, and one that starts off it by a rounding of
   float gets the right sign; where a far origin leaves the sheared corners coarse, it is kept between t at the corners, so
   that a hit never lies outside of its box. Every rounding in it is pinned, so no compiler flag or instruction set changes
   a bit.

   Of most triangles float can also tell that they are hit, and where about (hyi_judge_triangles): such a hit ends a ray that
   asks for any, and otherwise is put off, and worked out only if none that is certainly nearer comes after it. */
#ifndef HYI_BVH_TRIANGLE_H
#define HYI_BVH_TRIANGLE_H

#define HYI_FAR_AWAY 4611686018427387904.0f /* 2^62: a farther origin is moved to here */
#define HYI_SLAB_BOUND 9.5367431640625e-07f  /* 2^-20 */
#define HYI_ULP 1.1920928955078125e-07f      /* 2^-23 */
#define HYI_STEADY 8.67361737988403547e-19f  /* 2^-60: the smallest direction component */

/* Bounds of what float gets wrong: see hyi_judge_triangles. */
#define HYI_EDGE_NOISE 3.814697265625e-06f /* 2^-18 */
#define HYI_EDGE_LEAST 1.0e-30f
#define HYI_T_NOISE 9.5367431640625e-07f   /* 2^-20 */

#define HYI_NO_HIT FLT_MAX                   /* a t beyond every limit */

/* A ray in the units of one tree. t here times unit is t of the ray. Planes are met at t = plane * inverse + offset. */
typedef struct hyi_aim {
    float inverse[3];                     /* of the direction; finite */
    float near_offset[3], far_offset[3];  /* of the origin moved by the error bound: slabs only get thicker */
    float t_near, t_far;
    uint32_t near_plane[3];               /* row of hyi_node.planes that the ray meets first; the other is ^ 1 */
    float inverse_z;                      /* t here by distance along z */
    float least_t;                        /* no less is t of the nearest hit so far, where unit is 1 */
    float origin[3], shear[2];            /* in the order of axis */
    uint32_t axis[3];                     /* x, y, z of the sheared frame; z is the direction's largest */
    float direction[3];                   /* in the order of axis */
    uint32_t leaf, lane;                  /* a triangle that is certainly hit before all others so far, but not worked out yet; leaf 0: none */
    uint32_t unused[3];                   /* fills the second cache line */
    double t_by_z;                        /* inverse_z unrounded */
    double unit, inverse_unit;
} hyi_aim;

/* A cache line for boxes, one for triangles, and what only a closer look needs. */
HYI_STATIC_ASSERT(offsetof(hyi_aim, least_t) == 60 && offsetof(hyi_aim, origin) == 64 && offsetof(hyi_aim, leaf) == 108 && offsetof(hyi_aim, t_by_z) == 128);

/* What a triangle must beat, and the answer. */
typedef struct hyi_best {
    float t, u, v;
    uint32_t instance, primitive; /* HYK_NONE: t is t_max */
} hyi_best;

/* ---- aiming */

/* Moves a ray of any length into the units of the tree: directions far from 1 in size are scaled by a power
   of two, which t then carries. */
HYI_FN bool hyi_scale_ray(hyi_aim *aim, float scale, const float *origin, const float *direction, float *o, float *d) {
    float largest = 0.0f;
    for (int a = 0; a < 3; a++) {
        float size = fabsf(direction[a]);
        largest = size > largest ? size : largest;
        o[a] = origin[a] * scale;
        o[a] = o[a] < -HYI_FAR_AWAY ? -HYI_FAR_AWAY : o[a] > HYI_FAR_AWAY ? HYI_FAR_AWAY : o[a];
    }
    if (!(largest > 0.0f && largest <= FLT_MAX)) return false;
    double factor = (double)scale, size = (double)largest * factor;
    aim->unit = aim->inverse_unit = 1.0;
    if (size < 9.31322574615478515625e-10 || size > 1073741824.0) {
        int exponent;
        (void)frexp(size, &exponent);
        aim->unit = ldexp(1.0, -exponent);
        aim->inverse_unit = ldexp(1.0, exponent);
        factor *= aim->unit;
    }
    for (int a = 0; a < 3; a++) d[a] = (float)((double)direction[a] * factor);
    return true;
}

/* Largest distances from the origin to the box, along each axis. For a tree over instances the sizes of
   origin and box take their place: transforms round relative to these. */
HYI_INLINE float hyi_reach(const hyi_box *box, float origin, int axis, bool loose) {
    float below = fabsf(box->lower[axis] - origin), above = fabsf(box->upper[axis] - origin);
    if (loose) {
        below = 4.0f * (fabsf(box->lower[axis]) + fabsf(origin));
        above = 4.0f * (fabsf(box->upper[axis]) + fabsf(origin));
    }
    return below > above ? below : above;
}

/* Slabs. A sheared corner is off by at most 4 x 2^-24 of its distance across plus along the ray, t by a few
   ulps of the distance: 2^-20 covers both and the rounding of the slabs themselves. 2^-22 of the origin makes
   the moved one really differ, and covers the rounding of plane * inverse and of the offset. A direction of
   (nearly) zero becomes 2^-60, whose slabs end beyond the reach of the others: they are never NaN, and an
   origin on a plane lies inside by the bound. */
HYI_INLINE float hyi_slab_bound(float reach, float along, float origin) {
    return HYI_SLAB_BOUND * (reach + along) + 2.0f * HYI_ULP * fabsf(origin);
}

HYI_FN void hyi_aim_slabs(hyi_aim *aim, const hyi_box *box, const float *o, const float *d, bool loose) {
    float along = hyi_reach(box, o[aim->axis[2]], (int)aim->axis[2], loose);
    for (int a = 0; a < 3; a++) {
        float bound = hyi_slab_bound(hyi_reach(box, o[a], a, loose), along, o[a]);
        float steady = fabsf(d[a]) >= HYI_STEADY ? d[a] : d[a] < 0.0f ? -HYI_STEADY : HYI_STEADY;
        bool falls = steady < 0.0f;
        aim->inverse[a] = 1.0f / steady;
        aim->near_offset[a] = -(falls ? o[a] - bound : o[a] + bound) * aim->inverse[a];
        aim->far_offset[a] = -(falls ? o[a] + bound : o[a] - bound) * aim->inverse[a];
        aim->near_plane[a] = 2u * (uint32_t)a + (falls ? 1u : 0u);
    }
}

HYI_FN void hyi_aim_shear(hyi_aim *aim, const float *o, const float *d) {
    uint32_t z = fabsf(d[0]) >= fabsf(d[1]) ? 0u : 1u;
    z = fabsf(d[2]) > fabsf(d[z]) ? 2u : z;
    aim->axis[0] = z == 2u ? 0u : z + 1u;
    aim->axis[1] = z == 0u ? 2u : z - 1u;
    aim->axis[2] = z;
    for (int a = 0; a < 3; a++) aim->origin[a] = o[aim->axis[a]];
    for (int a = 0; a < 3; a++) aim->direction[a] = d[aim->axis[a]];
    aim->t_by_z = 1.0 / (double)d[z];
    aim->shear[0] = (float)((double)aim->direction[0] * aim->t_by_z);
    aim->shear[1] = (float)((double)aim->direction[1] * aim->t_by_z);
    aim->inverse_z = (float)aim->t_by_z;
}

/* The farthest t worth visiting, rounded outwards. */
HYI_INLINE void hyi_aim_limit(hyi_aim *aim, float t) {
    float here = (float)((double)(t < FLT_MAX ? t : FLT_MAX) * aim->inverse_unit);
    aim->t_far = here + 4.0f * HYI_ULP * fabsf(here);
}

/* Makes a ray ready for a tree that is not empty; false: it has no direction and hits nothing. */
HYI_NOINLINE bool hyi_aim_at(hyi_aim *aim, const hyi_bvh *bvh, const float *origin, const float *direction,
                             float t_min, float t_max, bool loose) {
    float o[3], d[3];
    if (!hyi_scale_ray(aim, bvh->scale, origin, direction, o, d)) return false;
    hyi_aim_shear(aim, o, d);
    hyi_aim_slabs(aim, &bvh->scaled, o, d, loose);
    float here = (float)((double)t_min * aim->inverse_unit);
    aim->t_near = here - 4.0f * HYI_ULP * fabsf(here);
    hyi_aim_limit(aim, t_max);
    return true;
}

/* ---- the test */

/* One corner in the sheared frame: x and y. row: the first float of the corner's x in the leaf. */
HYI_INLINE void hyi_shear_corner(const hyi_aim *aim, const float *row, uint32_t stride, float *x, float *y) {
    float z = hyi_rounded(row[aim->axis[2] * stride] - aim->origin[2]);
    *x = hyi_rounded(hyi_rounded(row[aim->axis[0] * stride] - aim->origin[0]) - hyi_rounded(aim->shear[0] * z));
    *y = hyi_rounded(hyi_rounded(row[aim->axis[1] * stride] - aim->origin[1]) - hyi_rounded(aim->shear[1] * z));
}

HYI_INLINE double hyi_rounded_double(double value) {
#if HYI_GNU && defined(__x86_64__)
    __asm__("" : "+x"(value));
#elif HYI_GNU && defined(__aarch64__)
    __asm__("" : "+w"(value));
#endif
    return value;
}

/* p q - r s of floats: both products are exact, the difference is rounded once. */
HYI_INLINE double hyi_cross_exact(float p, float q, float r, float s) {
    return hyi_rounded_double((double)p * (double)q - (double)r * (double)s);
}

/* a p + b q + c r, in this order. */
HYI_INLINE double hyi_sum_products(double a, double p, double b, double q, double c, double r) {
    double first = hyi_rounded_double(hyi_rounded_double(a * p) + hyi_rounded_double(b * q));
    return hyi_rounded_double(first + hyi_rounded_double(c * r));
}

/* a p - b q of numbers that are not floats. */
HYI_INLINE double hyi_difference_of_products(double a, double p, double b, double q) {
    return hyi_rounded_double(hyi_rounded_double(a * p) - hyi_rounded_double(b * q));
}

/* t, in the tree's units, at the plane through a triangle's corners, whose x, y, z (in the order of axis) lie stride
   floats apart, but within t at the corners; false: the ray runs in the plane. */
HYI_INLINE bool hyi_plane_distance(const hyi_aim *aim, const float *rows, uint32_t stride, double *t) {
    double a[3], e[3], f[3], n[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + aim->axis[i] * stride;
        double corner = (double)row[0];
        a[i] = hyi_rounded_double(corner - (double)aim->origin[i]);
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
    double across = hyi_sum_products(n[0], (double)aim->direction[0], n[1], (double)aim->direction[1], n[2], (double)aim->direction[2]);
    if (across == 0.0) return false;
    double plane = hyi_rounded_double(hyi_sum_products(n[0], a[0], n[1], a[1], n[2], a[2]) / across);
    double least = hyi_rounded_double(a[2] * aim->t_by_z), most = least;
    for (uint32_t k = 1; k < 3; k++) {
        double to_corner = hyi_rounded_double((double)rows[(aim->axis[2] + 3u * k) * stride] - (double)aim->origin[2]);
        double at = hyi_rounded_double(to_corner * aim->t_by_z);
        least = at < least ? at : least;
        most = at > most ? at : most;
    }
    *t = plane < least ? least : plane > most ? most : plane;
    return true;
}

/* t of the ray (not of the tree's units) at triangle lane of a leaf, or HYI_NO_HIT where that is not within t_min and
   t_max; weights: u and v. The plane comes first: most of the triangles that fail here lie behind a nearer hit. */
HYI_INLINE float hyi_confirm(const hyi_aim *aim, const float *rows, uint32_t stride, uint32_t lane, float t_min, float t_max, float weights[2]) {
    float ax, ay, bx, by, cx, cy;
    double distance;
    rows += lane;
    if (!hyi_plane_distance(aim, rows, stride, &distance)) return HYI_NO_HIT;
    float t = (float)hyi_rounded_double(distance * aim->unit);
    if (!(t >= t_min && t <= t_max)) return HYI_NO_HIT;
    hyi_shear_corner(aim, rows, stride, &ax, &ay);
    hyi_shear_corner(aim, rows + 3u * stride, stride, &bx, &by);
    hyi_shear_corner(aim, rows + 6u * stride, stride, &cx, &cy);
    double a = hyi_cross_exact(cx, by, cy, bx), b = hyi_cross_exact(ax, cy, ay, cx), c = hyi_cross_exact(bx, ay, by, ax);
    double sum = hyi_rounded_double(hyi_rounded_double(a + b) + c);
    if (((a < 0.0 || b < 0.0 || c < 0.0) && (a > 0.0 || b > 0.0 || c > 0.0)) || sum == 0.0) return HYI_NO_HIT;
    double inverse = hyi_rounded_double(1.0 / sum);
    weights[0] = (float)(b * inverse);
    weights[1] = (float)(c * inverse);
    return t;
}

/* Ties of equal t go to the smaller instance, then the smaller primitive; t_max itself counts as a hit. */
HYI_INLINE bool hyi_beats(const hyi_best *best, float t, uint32_t instance, uint32_t primitive) {
    if (t != best->t) return t < best->t;
    return instance != best->instance ? instance < best->instance : primitive < best->primitive;
}

#endif /* HYI_BVH_TRIANGLE_H */

/* >>bvh-walk: what rays can meet, one ray on its way through a tree, and who decides on a triangle

   How eight boxes, up to eight triangles or a packet of rays are tested differs between instruction sets;
   all else is here. */
#ifndef HYI_BVH_WALK_H
#define HYI_BVH_WALK_H

/* Everything that rays of a scene can meet. */
typedef struct hyi_accel {
    const hyk_scene_view *view;
    const hyi_bvh *meshes;         /* by mesh index */
    const uint8_t *mesh_has_alpha; /* by mesh index; NULL: none has */
    const hyi_bvh *world;          /* one tree over the first world_count instances, which are unmoved; NULL: none */
    const uint32_t *world_first;   /* of each of them, its first triangle's number in that tree */
    uint32_t world_count;
    bool world_has_alpha;
    const hyi_bvh *instances;      /* over the world, if any, and then the other instances; unused when single */
    bool single;                   /* the world alone, or exactly one instance, identity */
    bool empty;
    const hyi_bvh *shapes;         /* over the RECT, DISC and SPHERE lights; NULL: none */
    const uint32_t *shape_lights;  /* light of each box in shapes */
    hydra_isa isa;                 /* never AUTO */
} hyi_accel;

/* A tree and whose it is. */
typedef struct hyi_site {
    const hyi_accel *accel;
    const hyi_bvh *bvh;
    uint32_t instance;
    bool asks_alpha; /* whether hyk_hit_is_opaque must be asked here */
} hyi_site;

/* A ray on its way through one tree. */
typedef struct hyi_flight {
    hyi_aim aim;
    hyi_best best;
    float t_min;
    uint32_t unused[2]; /* fills the third cache line */
    const hyk_ray *ray;  /* in world space */
} hyi_flight;

/* A ray that may lie in memory as another type of the same layout. */
HYI_INLINE hyk_ray hyi_load_ray(const hyk_ray *at) {
    hyk_ray ray;
    memcpy(&ray, at, sizeof ray);
    return ray;
}

/* Whether origin, direction and t_min are finite, the direction is not zero, and t_max, which may be infinite, is not
   below t_min. Bits are looked at, which fast-math leaves alone. */
HYI_INLINE bool hyi_ray_is_sound(const hyk_ray *ray) {
    uint32_t bits[8], infinite = 0, direction = 0;
    memcpy(bits, ray, sizeof bits); /* origin, t_min, direction, t_max */
    for (int i = 0; i < 7; i++) infinite |= (bits[i] & 0x7f800000u) == 0x7f800000u ? 1u : 0u;
    for (int i = 4; i < 7; i++) direction |= bits[i] & 0x7fffffffu;
    return !infinite && direction && (bits[7] & 0x7fffffffu) <= 0x7f800000u && ray->t_max >= ray->t_min;
}
HYI_STATIC_ASSERT(sizeof(hyk_ray) == 32 && offsetof(hyk_ray, t_min) == 12 && offsetof(hyk_ray, t_max) == 28);

/* ---- the children of a node that a single ray still has to visit */

/* Seven wait on each level. */
#define HYI_STACK (7u * HYI_TREE_DEPTH + 8u)

typedef struct hyi_waiting {
    uint32_t child;
    float t;
} hyi_waiting;

/* Of child first and those in mask (not empty), returns the nearest and puts the others on the stack, the
   nearer the higher. */
HYI_INLINE uint32_t hyi_push_farther(hyi_waiting **stack, const uint32_t *child, const float *t, uint32_t first, uint32_t mask) {
    hyi_waiting *base = *stack, *top = base;
    hyi_waiting nearest;
    nearest.child = child[first];
    nearest.t = t[first];
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        hyi_waiting other, farther;
        other.child = child[c];
        other.t = t[c];
        bool nearer = other.t < nearest.t;
        farther.child = nearer ? nearest.child : other.child;
        farther.t = nearer ? nearest.t : other.t;
        nearest.child = nearer ? other.child : nearest.child;
        nearest.t = nearer ? other.t : nearest.t;
        hyi_waiting *place = top++;
        for (; place > base && place[-1].t < farther.t; place--) *place = place[-1];
        *place = farther;
    }
    *stack = top;
    return nearest.child;
}

/* ---- triangles */

HYI_INLINE const float *hyi_leaf_rows(const hyi_bvh *bvh, uint32_t leaf) { return bvh->rows + 9u * (size_t)hyi_leaf_first(leaf); }

/* In the world, the number of a triangle tells whose it is. */
HYI_INLINE void hyi_locate_in_world(const hyi_accel *accel, uint32_t *instance, uint32_t *primitive) {
    if (!accel->world || *instance != 0) return;
    uint32_t low = 0, high = accel->world_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (accel->world_first[middle] <= *primitive) low = middle;
        else high = middle;
    }
    *instance = low;
    *primitive -= accel->world_first[low];
}

HYI_NOINLINE bool hyi_lets_pass(const hyi_site *site, const hyk_ray *ray, uint32_t primitive, float u, float v) {
    uint32_t instance = site->instance;
    hyi_locate_in_world(site->accel, &instance, &primitive);
    return !hyk_hit_is_opaque(site->accel->view, instance, primitive, u, v, hyi_load_ray(ray));
}

/* Decides on one triangle of a leaf. Returns whether it is the new best. */
HYI_INLINE bool hyi_decide(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane) {
    float weights[2] = {0.0f, 0.0f};
    float t = hyi_confirm(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), lane, flight->t_min, flight->best.t, weights);
    if (t == HYI_NO_HIT) return false;
    uint32_t primitive = site->bvh->ids[hyi_leaf_first(leaf) + lane];
    if (!hyi_beats(&flight->best, t, site->instance, primitive)) return false;
    if (site->asks_alpha && hyi_lets_pass(site, flight->ray, primitive, weights[0], weights[1])) return false;
    flight->best.t = t;
    flight->best.u = weights[0];
    flight->best.v = weights[1];
    flight->best.instance = site->instance;
    flight->best.primitive = primitive;
    flight->aim.least_t = t;
    hyi_aim_limit(&flight->aim, t);
    return true;
}

/* Works out the hit that was put off. */
HYI_INLINE void hyi_settle(const hyi_site *site, hyi_flight *flight) {
    uint32_t leaf = flight->aim.leaf;
    if (leaf == 0) return;
    flight->aim.leaf = 0;
    (void)hyi_decide(site, flight, leaf, flight->aim.lane);
}

/* hyi_decide, after what was put off. */
HYI_NOINLINE bool hyi_offer(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane) {
    hyi_settle(site, flight);
    return hyi_decide(site, flight, leaf, lane);
}

/* Takes a triangle that is certainly hit, at t between least and most: puts it off where that is nearer than all before,
   and else decides. Most hits are so never worked out: one nearer comes. */
HYI_INLINE bool hyi_expect(const hyi_site *site, hyi_flight *flight, uint32_t leaf, uint32_t lane, float least, float most) {
    if (most >= flight->aim.least_t) return hyi_offer(site, flight, leaf, lane);
    flight->aim.leaf = leaf;
    flight->aim.lane = lane;
    flight->aim.least_t = least;
    flight->best.instance = site->instance;
    hyi_aim_limit(&flight->aim, most);
    return true;
}

/* Makes every box and triangle lie beyond a ray that is done. */
HYI_INLINE void hyi_flight_stop(hyi_flight *flight) { flight->aim.t_far = -FLT_MAX; }

/* ---- beginning and answering */

/* Limits end short of HYI_NO_HIT. */
#define HYI_T_LIMIT 3.0e38f
HYI_INLINE float hyi_finite_limit(float t_max) { return t_max < HYI_T_LIMIT ? t_max : HYI_T_LIMIT; }

/* Sets a ray on its way through one tree, looking no farther than its t_max and limit; false: it meets nothing there, as
   an unsound ray does. */
HYI_INLINE bool hyi_flight_begin(hyi_flight *flight, const hyi_bvh *bvh, const hyk_ray *at, float limit) {
    hyk_ray ray = hyi_load_ray(at);
    float origin[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    float direction[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    flight->ray = at;
    flight->t_min = ray.t_min;
    flight->best.t = hyi_finite_limit(ray.t_max < limit ? ray.t_max : limit);
    flight->best.u = flight->best.v = 0.0f;
    flight->best.instance = flight->best.primitive = HYK_NONE;
    flight->aim.least_t = flight->best.t;
    flight->aim.leaf = flight->aim.lane = 0;
    if (bvh->primitive_count == 0 || !hyi_ray_is_sound(&ray) || !(ray.t_min <= flight->best.t)) return false;
    return hyi_aim_at(&flight->aim, bvh, origin, direction, ray.t_min, flight->best.t, bvh->rows == NULL);
}

/* Where all rays of the scene begin: the world alone, or one unmoved mesh, has no level above it. */
HYI_INLINE hyi_site hyi_first_site(const hyi_accel *accel) {
    uint32_t mesh = accel->single && !accel->world ? accel->view->instances[0].mesh : 0u;
    hyi_site site;
    site.accel = accel;
    site.bvh = !accel->single ? accel->instances : accel->world ? accel->world : &accel->meshes[mesh];
    site.instance = 0;
    site.asks_alpha = accel->single && (accel->world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[mesh]);
    return site;
}

HYI_INLINE void hyi_answer(const hyi_accel *accel, const hyi_best *best, hyk_hit *hit) {
    bool found = best->instance != HYK_NONE;
    hit->t = found ? best->t : -1.0f;
    hit->u = best->u;
    hit->v = best->v;
    hit->instance = best->instance;
    hit->primitive = best->primitive;
    hyi_locate_in_world(accel, &hit->instance, &hit->primitive);
}

/* ---- levels */

HYI_INLINE float hyi_transform_row(hyk_vec3 row, float offset, const float *p) {
    return row.x * p[0] + row.y * p[1] + row.z * p[2] + offset;
}

/* What box item of the tree over instances stands for. */
HYI_FN hyi_site hyi_site_of_item(const hyi_accel *accel, uint32_t item) {
    bool world = accel->world && item == 0;
    hyi_site site;
    site.accel = accel;
    site.instance = accel->world && item > 0 ? accel->world_count + item - 1 : item;
    uint32_t mesh = accel->view->instances[site.instance].mesh;
    site.bvh = world ? accel->world : &accel->meshes[mesh];
    site.asks_alpha = world ? accel->world_has_alpha : accel->mesh_has_alpha && accel->mesh_has_alpha[mesh];
    return site;
}

/* A ray from the tree over instances in the tree of one of them; false: it meets nothing there. The direction is not
   renormalised: t means the same below. One copy for all instruction sets: it rounds. */
HYI_NOINLINE bool hyi_flight_enter(hyi_flight *below, const hyi_flight *above, const hyi_site *site) {
    const hyk_instance *placed = &site->accel->view->instances[site->instance];
    hyk_ray ray = hyi_load_ray(above->ray);
    float origin[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    float direction[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    if (!(placed->flags & HYK_INSTANCE_IDENTITY)) {
        float o[3] = {origin[0], origin[1], origin[2]}, d[3] = {direction[0], direction[1], direction[2]};
        origin[0] = hyi_transform_row(placed->inverse0, placed->s0, o);
        origin[1] = hyi_transform_row(placed->inverse1, placed->s1, o);
        origin[2] = hyi_transform_row(placed->inverse2, placed->s2, o);
        direction[0] = hyi_transform_row(placed->inverse0, 0.0f, d);
        direction[1] = hyi_transform_row(placed->inverse1, 0.0f, d);
        direction[2] = hyi_transform_row(placed->inverse2, 0.0f, d);
    }
    below->ray = above->ray;
    below->t_min = above->t_min;
    below->best = above->best;
    below->aim.least_t = above->best.t;
    below->aim.leaf = below->aim.lane = 0;
    return site->bvh->primitive_count && hyi_aim_at(&below->aim, site->bvh, origin, direction, ray.t_min, above->best.t, false);
}

/* Takes what was found below; returns whether there was something new. */
HYI_INLINE bool hyi_flight_return(hyi_flight *above, const hyi_flight *below) {
    bool found = below->best.t != above->best.t || below->best.primitive != above->best.primitive || below->best.instance != above->best.instance;
    above->best = below->best;
    if (found) hyi_aim_limit(&above->aim, above->best.t);
    return found;
}

/* What a walk through a tree of boxes calls for each box that the ray meets; true: stop. */
typedef bool (*hyi_box_visit)(void *argument, hyi_flight *flight, uint32_t item);

typedef struct hyi_visit_of {
    const hyi_accel *accel;
    bool any;
} hyi_visit_of;

#endif /* HYI_BVH_WALK_H */

/* >>bvh-stream: many rays through a tree together

   A list of rays goes down the tree: at a node each of them meets eight boxes, and its number is put on the list of
   every child that it enters; the children are then visited nearest first, each with its list. A node is loaded once
   for many rays, the rays of a list are independent work for the processor, and nothing is guessed by its branch
   predictor (Barringer, Akenine-Moller 2014, "Dynamic ray stream traversal"; Fuetterling et al. 2015, "Efficient
   ray tracing kernels for modern CPU architectures").

   Where neighbouring rays are alike, a packet of them takes the place of a ray: its node test is interval arithmetic
   over the packet (Reshetov, Soupikov, Hurley 2005, "Multi-level ray tracing algorithm"), as dear as that of one ray,
   and at a leaf a triangle meets all rays of the packet at once.

   Rays of a list have the same signs of direction and the same largest direction component. */
#ifndef HYI_BVH_STREAM_H
#define HYI_BVH_STREAM_H

#define HYI_STREAM_RAYS 2048u    /* on their way at a time */
#define HYI_STREAM_SORTED 65536u /* sorted by direction at a time */
#define HYI_STREAM_LEAST 48u     /* fewer rays go one by one */
#define HYI_LIST_LEAST 2u        /* shorter lists are walked ray by ray */
#define HYI_PACKET_WIDTH 16u     /* at most */
#define HYI_LIST_RESERVE (8u * 16u * (HYI_TREE_DEPTH + 2u)) /* words: for lists of one packet on every level */
#define HYI_RAY_GROUPS 24u       /* eight octants by three largest components */

/* Slopes of the rays of a packet differ by no more than this, and their origins by no more than this share of the
   tree's size. */
#define HYI_PACKET_SLOPES 0.6f
#define HYI_PACKET_ORIGINS 0.02f

/* As many rays as a vector has lanes: bounds of all for the node test, and for triangles what hyi_aim and hyi_best hold
   of one ray, in the units of the tree, with hyi_aim.unit 1. Lanes beyond the last ray repeat the first one with limits
   that nothing meets. */
typedef struct hyi_packet {
    float origin[3][HYI_PACKET_WIDTH], direction[3][HYI_PACKET_WIDTH], shear[2][HYI_PACKET_WIDTH]; /* in the order of axis */
    float inverse[3][HYI_PACKET_WIDTH]; /* likewise, of the direction kept from zero */
    float inverse_z[HYI_PACKET_WIDTH], t_near[HYI_PACKET_WIDTH], t_far[HYI_PACKET_WIDTH], t_min[HYI_PACKET_WIDTH];
    float best_t[HYI_PACKET_WIDTH];
    double t_by_z[HYI_PACKET_WIDTH];
    double weights[3][HYI_PACKET_WIDTH]; /* edge functions of corners 1 and 2 and the sum of all: u and v are their ratios */
    uint32_t instance[HYI_PACKET_WIDTH], primitive[HYI_PACKET_WIDTH];
    uint32_t ray[HYI_PACKET_WIDTH];      /* its number among the rays, or flights, that the packet is made of */
    float near_origin[3], far_origin[3], inverse_low[3], inverse_high[3];
    float bound[3];                      /* of the error of each origin, by which slabs are thicker */
    float first_t, last_t;
    uint32_t spread;                     /* 1: they begin at different points, and bounds of all say little of each */
    uint32_t count, group;               /* rays; what their directions have in common: see hyi_aim_group */
} hyi_packet;

/* Memory for streams. */
typedef struct hyi_ray_stream {
    uint32_t capacity;     /* rays on their way at a time; 0: none, rays go one by one */
    uint32_t packet_share; /* packets that they make */
    uint32_t levels;       /* 1, or 2 where there are instances: flights and packets in the first tree, then in theirs */
    uint32_t sorted;       /* rays sorted at a time */
    hyi_packet *packets;   /* levels times packet_share; the block begins here */
    hyi_flight *flights;   /* levels times capacity */
    uint32_t *lists;       /* list_count */
    uint32_t *order;       /* two times sorted */
    uint8_t *keys;         /* sorted: of rays yet to be sorted by them */
    size_t list_count;
} hyi_ray_stream;

/* Lists in one tree at one time. */
typedef struct hyi_swarm {
    hyi_site site;
    hyi_ray_stream *stream;
    const hyk_ray *rays; /* of packets; NULL: these are made of flights */
    hyi_flight *flights;
    hyi_packet *packets;
    uint32_t near_plane[3], axis[3]; /* of all rays on a list */
    bool any;
} hyi_swarm;

/* Sixteen words of each of some rays, from rows of one word of all, to a line of each, one flight apart. */
HYI_INLINE void hyi_lines(const void *const rows[16], char *lines, uint32_t rays) {
    for (uint32_t i = 0; i < rays; i++)
        for (uint32_t word = 0; word < 16u; word++)
            memcpy(lines + i * sizeof(hyi_flight) + 4u * word, (const char *)rows[word] + 4u * i, 4);
}

/* Of eight items, which children each meets. */
typedef union hyi_masks8 {
    uint8_t bytes[8];
    uint64_t all;
} hyi_masks8;

HYI_INLINE uint32_t hyi_aim_group(const hyi_aim *aim) {
    return (aim->near_plane[0] & 1u) | (aim->near_plane[1] & 1u) << 1 | (aim->near_plane[2] & 1u) << 2 | aim->axis[2] << 3;
}

/* The same of a ray that is not aimed yet, or nearly: ties between axes may fall otherwise. */
HYI_INLINE uint8_t hyi_direction_key(hyk_vec3 d) {
    float x = fabsf(d.x), y = fabsf(d.y), z = fabsf(d.z);
    uint32_t axis = z > x && z > y ? 2u : x >= y ? 0u : 1u;
    return (uint8_t)((d.x < 0.0f ? 1u : 0u) | (d.y < 0.0f ? 2u : 0u) | (d.z < 0.0f ? 4u : 0u) | axis << 3);
}

/* hyi_aim.axis of the rays of a group. */
HYI_INLINE void hyi_group_axes(uint32_t group, uint32_t axis[3]) {
    uint32_t z = group >> 3;
    axis[0] = z == 2u ? 0u : z + 1u;
    axis[1] = z == 0u ? 2u : z - 1u;
    axis[2] = z;
}

/* What rays of a group have in common. */
HYI_INLINE void hyi_set_group(hyi_swarm *swarm, uint32_t group) {
    for (uint32_t a = 0; a < 3; a++) swarm->near_plane[a] = 2u * a + (group >> a & 1u);
    hyi_group_axes(group, swarm->axis);
}

/* Numbers of count keys below HYI_RAY_GROUPS in the order of the keys, stable; first[g] .. first[g + 1]: those of group g. */
HYI_INLINE void hyi_group(const uint8_t *keys, uint32_t count, uint32_t *order, uint32_t first[HYI_RAY_GROUPS + 1]) {
    uint32_t next[HYI_RAY_GROUPS] = {0};
    for (uint32_t i = 0; i < count; i++) next[keys[i]]++;
    first[0] = 0;
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        first[g + 1] = first[g] + next[g];
        next[g] = first[g];
    }
    for (uint32_t i = 0; i < count; i++) order[next[keys[i]]++] = i;
}

/* Of eight. */
HYI_INLINE uint32_t hyi_count_bits(uint32_t bits) {
    bits -= bits >> 1 & 0x55u;
    bits = (bits & 0x33u) + (bits >> 2 & 0x33u);
    return (bits + (bits >> 4)) & 0xfu;
}

/* What a child will read first. */
HYI_INLINE void hyi_prefetch_child(const hyi_bvh *bvh, uint32_t child) {
    const char *at = hyi_child_is_leaf(child) ? (const char *)hyi_leaf_rows(bvh, child) : (const char *)&bvh->nodes[child];
    for (uint32_t line = 0; line < 4u; line++) hyi_prefetch(at + 64u * line);
}

#endif /* HYI_BVH_STREAM_H */

/* >>bvh-scalar: traversal in plain C, for any machine: eight lanes are eight floats */
#ifndef HYI_BVH_SCALAR_H
#define HYI_BVH_SCALAR_H

typedef struct hyi_f8 {
    float v[8];
} hyi_f8;

#define HYI_EIGHT(name, expression)                   \
    HYI_INLINE hyi_f8 name(hyi_f8 a, hyi_f8 b) {      \
        hyi_f8 r;                                     \
        for (int i = 0; i < 8; i++) r.v[i] = (expression); \
        return r;                                     \
    }
HYI_EIGHT(hyi_add8_scalar, a.v[i] + b.v[i])
HYI_EIGHT(hyi_sub8_scalar, a.v[i] - b.v[i])
HYI_EIGHT(hyi_mul8_scalar, a.v[i] * b.v[i])
HYI_EIGHT(hyi_div8_scalar, a.v[i] / b.v[i])
HYI_EIGHT(hyi_min8_scalar, b.v[i] < a.v[i] ? b.v[i] : a.v[i])
HYI_EIGHT(hyi_max8_scalar, b.v[i] > a.v[i] ? b.v[i] : a.v[i])
#undef HYI_EIGHT

HYI_INLINE hyi_f8 hyi_load8_scalar(const float *p) {
    hyi_f8 r;
    memcpy(r.v, p, sizeof r.v);
    return r;
}

HYI_INLINE hyi_f8 hyi_set8_scalar(float value) {
    hyi_f8 r;
    for (int i = 0; i < 8; i++) r.v[i] = value;
    return r;
}

HYI_INLINE hyi_f8 hyi_mad8_scalar(hyi_f8 a, hyi_f8 b, hyi_f8 c) {
    for (int i = 0; i < 8; i++) a.v[i] = a.v[i] * b.v[i] + c.v[i];
    return a;
}

HYI_INLINE hyi_f8 hyi_pin8_scalar(hyi_f8 a) {
    for (int i = 0; i < 8; i++) a.v[i] = hyi_rounded(a.v[i]);
    return a;
}

HYI_INLINE uint32_t hyi_lt8_scalar(hyi_f8 a, hyi_f8 b) {
    uint32_t mask = 0;
    for (int i = 0; i < 8; i++) mask |= (a.v[i] < b.v[i] ? 1u : 0u) << i;
    return mask;
}

HYI_INLINE uint32_t hyi_le8_scalar(hyi_f8 a, hyi_f8 b) {
    uint32_t mask = 0;
    for (int i = 0; i < 8; i++) mask |= (a.v[i] <= b.v[i] ? 1u : 0u) << i;
    return mask;
}

#define HYI_TARGET
#define HYI_ALWAYS_EXACT 1 /* eight judgements would cost more than the decisions that they spare */
#define HYI_I(name) name##_scalar
#define HYI_F8 hyi_f8
#define HYI_M8 uint32_t
#define HYI_LOAD8(p) hyi_load8_scalar(p)
#define HYI_LOADU8(p) hyi_load8_scalar(p)
#define HYI_STORE8(p, a) memcpy(p, (a).v, sizeof (a).v)
#define HYI_SET8(value) hyi_set8_scalar(value)
#define HYI_ZERO8() hyi_set8_scalar(0.0f)
#define HYI_ADD8(a, b) hyi_add8_scalar(a, b)
#define HYI_SUB8(a, b) hyi_sub8_scalar(a, b)
#define HYI_MUL8(a, b) hyi_mul8_scalar(a, b)
#define HYI_DIV8(a, b) hyi_div8_scalar(a, b)
#define HYI_MAD8(a, b, c) hyi_mad8_scalar(a, b, c)
#define HYI_MIN8(a, b) hyi_min8_scalar(a, b)
#define HYI_MAX8(a, b) hyi_max8_scalar(a, b)
#define HYI_LT8(a, b) hyi_lt8_scalar(a, b)
#define HYI_LE8(a, b) hyi_le8_scalar(a, b)
#define HYI_AND8(a, b) ((a) & (b))
#define HYI_OR8(a, b) ((a) | (b))
#define HYI_BITS8(m) (m)
#define HYI_PIN8(a) hyi_pin8_scalar(a)
/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_size)(HYI_F8 v) { return HYI_MAX8(v, HYI_SUB8(HYI_ZERO8(), v)); }

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t by their share in the sum, of the difference between t at the corners;
   rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise could have made says nothing. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const hyi_aim *aim, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), along = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_I(hyi_size)(sum);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAX8(across, HYI_MAX8(HYI_I(hyi_size)(k[i].x), HYI_I(hyi_size)(k[i].y)));
        along = HYI_MAX8(along, HYI_I(hyi_size)(k[i].z));
    }
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 farthest = HYI_MAX8(HYI_I(hyi_size)(first), HYI_I(hyi_size)(last));
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_I(hyi_size)(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MAX8(HYI_MUL8(HYI_SET8(4.0f), noise), HYI_SET8(HYI_EDGE_LEAST)), size));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(aim->t_near)), HYI_LT8(HYI_SET8(aim->t_far), least)));
    float from = aim->t_near + 16.0f * HYI_ULP * fabsf(aim->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. exact: nothing is certain. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_verdicts) verdicts;
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(aim, rows + 3u * i * count, count);
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(aim->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(aim->t_far), first), HYI_LT8(last, HYI_SET8(aim->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (verdicts.possible && !exact)
        HYI_I(hyi_judge_triangles)(aim, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.unit != 1.0, found = false;
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts.certain >> lane & 1u) {
            if (verdicts.least[lane] > flight->aim.t_far) continue;
            found = hyi_expect(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane]) || found;
        } else {
            found = hyi_offer(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) {
                hyi_settle(site, flight);
                return;
            }
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
/* The words of one instruction set end here. */
#undef HYI_ADD2
#undef HYI_ADD4
#undef HYI_ADD8
#undef HYI_ADDD
#undef HYI_ADDW
#undef HYI_ALLW
#undef HYI_ALWAYS_EXACT
#undef HYI_AND4
#undef HYI_AND8
#undef HYI_ANDW
#undef HYI_AS_FLOATS
#undef HYI_BITS2_2
#undef HYI_BITS4_4
#undef HYI_BITS8
#undef HYI_BITSW
#undef HYI_CHOOSE4
#undef HYI_CLEAR_MASKS
#undef HYI_D2
#undef HYI_DEAL
#undef HYI_DIV2
#undef HYI_DIV4
#undef HYI_DIV8
#undef HYI_DIVD
#undef HYI_DIVW
#undef HYI_F4
#undef HYI_F8
#undef HYI_FD
#undef HYI_FW
#undef HYI_GREATEST4
#undef HYI_GREATESTW
#undef HYI_HALFD
#undef HYI_HIGH_AS_DOUBLES
#undef HYI_I
#undef HYI_LANES
#undef HYI_LINES
#undef HYI_LE4
#undef HYI_LE8
#undef HYI_LEAST4
#undef HYI_LEASTW
#undef HYI_LEW
#undef HYI_LOAD4
#undef HYI_LOAD4_ALIGNED
#undef HYI_LOAD8
#undef HYI_LOADD
#undef HYI_LOAD2
#undef HYI_LOADU8
#undef HYI_LOADW
#undef HYI_LOW_AS_DOUBLES
#undef HYI_LT2
#undef HYI_LT4
#undef HYI_LT8
#undef HYI_LTD
#undef HYI_LTW
#undef HYI_M4
#undef HYI_M8
#undef HYI_MAD4
#undef HYI_MAD8
#undef HYI_MASKS
#undef HYI_MAX2
#undef HYI_MAX4
#undef HYI_MAX8
#undef HYI_MAXD
#undef HYI_MAXW
#undef HYI_MIN2
#undef HYI_MIN4
#undef HYI_MIN8
#undef HYI_MIN8_WHERE
#undef HYI_MIND
#undef HYI_MINW
#undef HYI_MUL2
#undef HYI_MUL4
#undef HYI_MUL8
#undef HYI_MULD
#undef HYI_MULW
#undef HYI_MW
#undef HYI_OR4
#undef HYI_OR8
#undef HYI_ORW
#undef HYI_PIN2
#undef HYI_PIN4
#undef HYI_PIN8
#undef HYI_PIND
#undef HYI_PINW
#undef HYI_SET2
#undef HYI_SET4
#undef HYI_SET8
#undef HYI_SETD
#undef HYI_SETW
#undef HYI_STORE2
#undef HYI_STORE4
#undef HYI_STORE8
#undef HYI_STORED
#undef HYI_STOREH
#undef HYI_STOREW
#undef HYI_SUB2
#undef HYI_SUB4
#undef HYI_SUB8
#undef HYI_SUBD
#undef HYI_SUBW
#undef HYI_TARGET
#undef HYI_ZERO8
#undef HYI_ZEROW

#endif /* HYI_BVH_SCALAR_H */

/* >>bvh-avx2: traversal in the words of AVX2: eight rays a packet */
#ifndef HYI_BVH_AVX2_H
#define HYI_BVH_AVX2_H

#if HYI_X86

HYI_INLINE HYI_AVX2 __m256d hyi_pin_double_avx2(__m256d value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX2 __m256 hyi_pin8_avx2(__m256 value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX2 float hyi_greatest_avx2(__m256 a) {
    __m128 four = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    __m128 two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps(two, two, 1)));
}

/* By mask: the numbers of its set bits, lowest first. */
static const uint8_t hyi_front[256][8] = {
    {0,0,0,0,0,0,0,0}, {0,0,0,0,0,0,0,0}, {1,0,0,0,0,0,0,0}, {0,1,0,0,0,0,0,0},
    {2,0,0,0,0,0,0,0}, {0,2,0,0,0,0,0,0}, {1,2,0,0,0,0,0,0}, {0,1,2,0,0,0,0,0},
    {3,0,0,0,0,0,0,0}, {0,3,0,0,0,0,0,0}, {1,3,0,0,0,0,0,0}, {0,1,3,0,0,0,0,0},
    {2,3,0,0,0,0,0,0}, {0,2,3,0,0,0,0,0}, {1,2,3,0,0,0,0,0}, {0,1,2,3,0,0,0,0},
    {4,0,0,0,0,0,0,0}, {0,4,0,0,0,0,0,0}, {1,4,0,0,0,0,0,0}, {0,1,4,0,0,0,0,0},
    {2,4,0,0,0,0,0,0}, {0,2,4,0,0,0,0,0}, {1,2,4,0,0,0,0,0}, {0,1,2,4,0,0,0,0},
    {3,4,0,0,0,0,0,0}, {0,3,4,0,0,0,0,0}, {1,3,4,0,0,0,0,0}, {0,1,3,4,0,0,0,0},
    {2,3,4,0,0,0,0,0}, {0,2,3,4,0,0,0,0}, {1,2,3,4,0,0,0,0}, {0,1,2,3,4,0,0,0},
    {5,0,0,0,0,0,0,0}, {0,5,0,0,0,0,0,0}, {1,5,0,0,0,0,0,0}, {0,1,5,0,0,0,0,0},
    {2,5,0,0,0,0,0,0}, {0,2,5,0,0,0,0,0}, {1,2,5,0,0,0,0,0}, {0,1,2,5,0,0,0,0},
    {3,5,0,0,0,0,0,0}, {0,3,5,0,0,0,0,0}, {1,3,5,0,0,0,0,0}, {0,1,3,5,0,0,0,0},
    {2,3,5,0,0,0,0,0}, {0,2,3,5,0,0,0,0}, {1,2,3,5,0,0,0,0}, {0,1,2,3,5,0,0,0},
    {4,5,0,0,0,0,0,0}, {0,4,5,0,0,0,0,0}, {1,4,5,0,0,0,0,0}, {0,1,4,5,0,0,0,0},
    {2,4,5,0,0,0,0,0}, {0,2,4,5,0,0,0,0}, {1,2,4,5,0,0,0,0}, {0,1,2,4,5,0,0,0},
    {3,4,5,0,0,0,0,0}, {0,3,4,5,0,0,0,0}, {1,3,4,5,0,0,0,0}, {0,1,3,4,5,0,0,0},
    {2,3,4,5,0,0,0,0}, {0,2,3,4,5,0,0,0}, {1,2,3,4,5,0,0,0}, {0,1,2,3,4,5,0,0},
    {6,0,0,0,0,0,0,0}, {0,6,0,0,0,0,0,0}, {1,6,0,0,0,0,0,0}, {0,1,6,0,0,0,0,0},
    {2,6,0,0,0,0,0,0}, {0,2,6,0,0,0,0,0}, {1,2,6,0,0,0,0,0}, {0,1,2,6,0,0,0,0},
    {3,6,0,0,0,0,0,0}, {0,3,6,0,0,0,0,0}, {1,3,6,0,0,0,0,0}, {0,1,3,6,0,0,0,0},
    {2,3,6,0,0,0,0,0}, {0,2,3,6,0,0,0,0}, {1,2,3,6,0,0,0,0}, {0,1,2,3,6,0,0,0},
    {4,6,0,0,0,0,0,0}, {0,4,6,0,0,0,0,0}, {1,4,6,0,0,0,0,0}, {0,1,4,6,0,0,0,0},
    {2,4,6,0,0,0,0,0}, {0,2,4,6,0,0,0,0}, {1,2,4,6,0,0,0,0}, {0,1,2,4,6,0,0,0},
    {3,4,6,0,0,0,0,0}, {0,3,4,6,0,0,0,0}, {1,3,4,6,0,0,0,0}, {0,1,3,4,6,0,0,0},
    {2,3,4,6,0,0,0,0}, {0,2,3,4,6,0,0,0}, {1,2,3,4,6,0,0,0}, {0,1,2,3,4,6,0,0},
    {5,6,0,0,0,0,0,0}, {0,5,6,0,0,0,0,0}, {1,5,6,0,0,0,0,0}, {0,1,5,6,0,0,0,0},
    {2,5,6,0,0,0,0,0}, {0,2,5,6,0,0,0,0}, {1,2,5,6,0,0,0,0}, {0,1,2,5,6,0,0,0},
    {3,5,6,0,0,0,0,0}, {0,3,5,6,0,0,0,0}, {1,3,5,6,0,0,0,0}, {0,1,3,5,6,0,0,0},
    {2,3,5,6,0,0,0,0}, {0,2,3,5,6,0,0,0}, {1,2,3,5,6,0,0,0}, {0,1,2,3,5,6,0,0},
    {4,5,6,0,0,0,0,0}, {0,4,5,6,0,0,0,0}, {1,4,5,6,0,0,0,0}, {0,1,4,5,6,0,0,0},
    {2,4,5,6,0,0,0,0}, {0,2,4,5,6,0,0,0}, {1,2,4,5,6,0,0,0}, {0,1,2,4,5,6,0,0},
    {3,4,5,6,0,0,0,0}, {0,3,4,5,6,0,0,0}, {1,3,4,5,6,0,0,0}, {0,1,3,4,5,6,0,0},
    {2,3,4,5,6,0,0,0}, {0,2,3,4,5,6,0,0}, {1,2,3,4,5,6,0,0}, {0,1,2,3,4,5,6,0},
    {7,0,0,0,0,0,0,0}, {0,7,0,0,0,0,0,0}, {1,7,0,0,0,0,0,0}, {0,1,7,0,0,0,0,0},
    {2,7,0,0,0,0,0,0}, {0,2,7,0,0,0,0,0}, {1,2,7,0,0,0,0,0}, {0,1,2,7,0,0,0,0},
    {3,7,0,0,0,0,0,0}, {0,3,7,0,0,0,0,0}, {1,3,7,0,0,0,0,0}, {0,1,3,7,0,0,0,0},
    {2,3,7,0,0,0,0,0}, {0,2,3,7,0,0,0,0}, {1,2,3,7,0,0,0,0}, {0,1,2,3,7,0,0,0},
    {4,7,0,0,0,0,0,0}, {0,4,7,0,0,0,0,0}, {1,4,7,0,0,0,0,0}, {0,1,4,7,0,0,0,0},
    {2,4,7,0,0,0,0,0}, {0,2,4,7,0,0,0,0}, {1,2,4,7,0,0,0,0}, {0,1,2,4,7,0,0,0},
    {3,4,7,0,0,0,0,0}, {0,3,4,7,0,0,0,0}, {1,3,4,7,0,0,0,0}, {0,1,3,4,7,0,0,0},
    {2,3,4,7,0,0,0,0}, {0,2,3,4,7,0,0,0}, {1,2,3,4,7,0,0,0}, {0,1,2,3,4,7,0,0},
    {5,7,0,0,0,0,0,0}, {0,5,7,0,0,0,0,0}, {1,5,7,0,0,0,0,0}, {0,1,5,7,0,0,0,0},
    {2,5,7,0,0,0,0,0}, {0,2,5,7,0,0,0,0}, {1,2,5,7,0,0,0,0}, {0,1,2,5,7,0,0,0},
    {3,5,7,0,0,0,0,0}, {0,3,5,7,0,0,0,0}, {1,3,5,7,0,0,0,0}, {0,1,3,5,7,0,0,0},
    {2,3,5,7,0,0,0,0}, {0,2,3,5,7,0,0,0}, {1,2,3,5,7,0,0,0}, {0,1,2,3,5,7,0,0},
    {4,5,7,0,0,0,0,0}, {0,4,5,7,0,0,0,0}, {1,4,5,7,0,0,0,0}, {0,1,4,5,7,0,0,0},
    {2,4,5,7,0,0,0,0}, {0,2,4,5,7,0,0,0}, {1,2,4,5,7,0,0,0}, {0,1,2,4,5,7,0,0},
    {3,4,5,7,0,0,0,0}, {0,3,4,5,7,0,0,0}, {1,3,4,5,7,0,0,0}, {0,1,3,4,5,7,0,0},
    {2,3,4,5,7,0,0,0}, {0,2,3,4,5,7,0,0}, {1,2,3,4,5,7,0,0}, {0,1,2,3,4,5,7,0},
    {6,7,0,0,0,0,0,0}, {0,6,7,0,0,0,0,0}, {1,6,7,0,0,0,0,0}, {0,1,6,7,0,0,0,0},
    {2,6,7,0,0,0,0,0}, {0,2,6,7,0,0,0,0}, {1,2,6,7,0,0,0,0}, {0,1,2,6,7,0,0,0},
    {3,6,7,0,0,0,0,0}, {0,3,6,7,0,0,0,0}, {1,3,6,7,0,0,0,0}, {0,1,3,6,7,0,0,0},
    {2,3,6,7,0,0,0,0}, {0,2,3,6,7,0,0,0}, {1,2,3,6,7,0,0,0}, {0,1,2,3,6,7,0,0},
    {4,6,7,0,0,0,0,0}, {0,4,6,7,0,0,0,0}, {1,4,6,7,0,0,0,0}, {0,1,4,6,7,0,0,0},
    {2,4,6,7,0,0,0,0}, {0,2,4,6,7,0,0,0}, {1,2,4,6,7,0,0,0}, {0,1,2,4,6,7,0,0},
    {3,4,6,7,0,0,0,0}, {0,3,4,6,7,0,0,0}, {1,3,4,6,7,0,0,0}, {0,1,3,4,6,7,0,0},
    {2,3,4,6,7,0,0,0}, {0,2,3,4,6,7,0,0}, {1,2,3,4,6,7,0,0}, {0,1,2,3,4,6,7,0},
    {5,6,7,0,0,0,0,0}, {0,5,6,7,0,0,0,0}, {1,5,6,7,0,0,0,0}, {0,1,5,6,7,0,0,0},
    {2,5,6,7,0,0,0,0}, {0,2,5,6,7,0,0,0}, {1,2,5,6,7,0,0,0}, {0,1,2,5,6,7,0,0},
    {3,5,6,7,0,0,0,0}, {0,3,5,6,7,0,0,0}, {1,3,5,6,7,0,0,0}, {0,1,3,5,6,7,0,0},
    {2,3,5,6,7,0,0,0}, {0,2,3,5,6,7,0,0}, {1,2,3,5,6,7,0,0}, {0,1,2,3,5,6,7,0},
    {4,5,6,7,0,0,0,0}, {0,4,5,6,7,0,0,0}, {1,4,5,6,7,0,0,0}, {0,1,4,5,6,7,0,0},
    {2,4,5,6,7,0,0,0}, {0,2,4,5,6,7,0,0}, {1,2,4,5,6,7,0,0}, {0,1,2,4,5,6,7,0},
    {3,4,5,6,7,0,0,0}, {0,3,4,5,6,7,0,0}, {1,3,4,5,6,7,0,0}, {0,1,3,4,5,6,7,0},
    {2,3,4,5,6,7,0,0}, {0,2,3,4,5,6,7,0}, {1,2,3,4,5,6,7,0}, {0,1,2,3,4,5,6,7},
};

/* Appends eight items to the lists of the children that their masks name. The items whose bit is set are moved to the
   front by a permutation from a table. */
HYI_INLINE HYI_AVX2 void hyi_deal_out_avx2(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    __m256i all = _mm256_loadu_si256((const __m256i *)(const void *)items);
    __m128i bits = _mm_loadl_epi64((const __m128i *)(const void *)masks->bytes);
    for (int c = 7; c >= 0; c--) { /* the highest bit of each byte is the child's */
        uint32_t takes = (uint32_t)_mm_movemask_epi8(bits) & 0xffu;
        bits = _mm_add_epi8(bits, bits);
        __m256i places = _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)hyi_front[takes]));
        _mm256_storeu_si256((__m256i *)(void *)(lists + (size_t)(uint32_t)c * stride + dealt[c]), _mm256_permutevar8x32_epi32(all, places));
        dealt[c] += (uint32_t)_mm_popcnt_u32(takes);
    }
}

/* hyi_lines: two transpositions of eight by eight, in three steps each. */
HYI_INLINE HYI_AVX2 void hyi_lines_avx2(const void *const rows[16], char *lines) {
    for (int side = 0; side < 2; side++) {
        __m256 a[8], b[8];
        for (int i = 0; i < 8; i++) a[i] = _mm256_loadu_ps((const float *)rows[8 * side + i]);
        for (int i = 0; i < 8; i += 2) {
            b[i] = _mm256_unpacklo_ps(a[i], a[i + 1]);
            b[i + 1] = _mm256_unpackhi_ps(a[i], a[i + 1]);
        }
        for (int i = 0; i < 8; i += 4) {
            for (int k = 0; k < 2; k++) {
                a[i + 2 * k] = _mm256_shuffle_ps(b[i + k], b[i + k + 2], 0x44);
                a[i + 2 * k + 1] = _mm256_shuffle_ps(b[i + k], b[i + k + 2], 0xee);
            }
        }
        for (int k = 0; k < 4; k++) {
            float *low = (float *)(void *)(lines + (size_t)(uint32_t)k * sizeof(hyi_flight)) + 8 * side;
            float *high = (float *)(void *)(lines + (size_t)(uint32_t)(k + 4) * sizeof(hyi_flight)) + 8 * side;
            _mm256_store_ps(low, _mm256_permute2f128_ps(a[k], a[k + 4], 0x20));
            _mm256_store_ps(high, _mm256_permute2f128_ps(a[k], a[k + 4], 0x31));
        }
    }
}

#define HYI_TARGET HYI_AVX2
#define HYI_I(name) name##_avx2
#define HYI_F8 __m256
#define HYI_ALWAYS_EXACT 0
#define HYI_M8 __m256
#define HYI_LOAD8(p) _mm256_load_ps(p)
#define HYI_LOADU8(p) _mm256_loadu_ps(p)
#define HYI_STORE8(p, a) _mm256_storeu_ps(p, a)
#define HYI_SET8(value) _mm256_set1_ps(value)
#define HYI_ZERO8() _mm256_setzero_ps()
#define HYI_ADD8(a, b) _mm256_add_ps(a, b)
#define HYI_SUB8(a, b) _mm256_sub_ps(a, b)
#define HYI_MUL8(a, b) _mm256_mul_ps(a, b)
#define HYI_DIV8(a, b) _mm256_div_ps(a, b)
#define HYI_MAD8(a, b, c) _mm256_fmadd_ps(a, b, c)
#define HYI_MIN8(a, b) _mm256_min_ps(a, b)
#define HYI_MAX8(a, b) _mm256_max_ps(a, b)
#define HYI_LT8(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define HYI_LE8(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define HYI_AND8(a, b) _mm256_and_ps(a, b)
#define HYI_OR8(a, b) _mm256_or_ps(a, b)
#define HYI_BITS8(m) ((uint32_t)_mm256_movemask_ps(m))
#define HYI_MIN8_WHERE(a, m, b) _mm256_blendv_ps(a, _mm256_min_ps(a, b), m)
#define HYI_PIN8(a) hyi_pin8_avx2(a)
#define HYI_LINES(rows, lines) hyi_lines_avx2(rows, lines)
#define HYI_LANES 8u
#define HYI_ALLW 0xffu
#define HYI_FW __m256
#define HYI_MW __m256
#define HYI_LOADW(p) _mm256_loadu_ps(p)
#define HYI_SETW(value) _mm256_set1_ps(value)
#define HYI_ZEROW() _mm256_setzero_ps()
#define HYI_SUBW(a, b) _mm256_sub_ps(a, b)
#define HYI_MULW(a, b) _mm256_mul_ps(a, b)
#define HYI_MINW(a, b) _mm256_min_ps(a, b)
#define HYI_MAXW(a, b) _mm256_max_ps(a, b)
#define HYI_LTW(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define HYI_ANDW(a, b) _mm256_and_ps(a, b)
#define HYI_ORW(a, b) _mm256_or_ps(a, b)
#define HYI_BITSW(m) ((uint32_t)_mm256_movemask_ps(m))
#define HYI_PINW(a) hyi_pin8_avx2(a)
#define HYI_GREATESTW(a) hyi_greatest_avx2(a)
#define HYI_DEAL 8u
#define HYI_MASKS hyi_masks8
#define HYI_CLEAR_MASKS(masks) ((masks).all = 0)

#define HYI_STOREW(p, a) _mm256_storeu_ps(p, a)
#define HYI_ADDW(a, b) _mm256_add_ps(a, b)
#define HYI_DIVW(a, b) _mm256_div_ps(a, b)
#define HYI_LEW(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define HYI_LEASTW(a) (-hyi_greatest_avx2(_mm256_sub_ps(_mm256_setzero_ps(), a)))
#define HYI_FD __m256d
#define HYI_SETD(value) _mm256_set1_pd(value)
#define HYI_HALFD(a, half) _mm256_cvtps_pd((half) ? _mm256_extractf128_ps(a, 1) : _mm256_castps256_ps128(a))
#define HYI_LOADD(p) _mm256_loadu_pd(p)
#define HYI_STORED(p, a) _mm256_storeu_pd(p, a)
#define HYI_STOREH(p, half, a) _mm_storeu_ps((p) + 4 * (half), _mm256_cvtpd_ps(a))
#define HYI_ADDD(a, b) _mm256_add_pd(a, b)
#define HYI_SUBD(a, b) _mm256_sub_pd(a, b)
#define HYI_MULD(a, b) _mm256_mul_pd(a, b)
#define HYI_DIVD(a, b) _mm256_div_pd(a, b)
#define HYI_MIND(a, b) _mm256_min_pd(a, b)
#define HYI_MAXD(a, b) _mm256_max_pd(a, b)
#define HYI_LTD(a, b) ((uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_LT_OQ)))
#define HYI_PIND(a) hyi_pin_double_avx2(a)
/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_size)(HYI_F8 v) { return HYI_MAX8(v, HYI_SUB8(HYI_ZERO8(), v)); }

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t by their share in the sum, of the difference between t at the corners;
   rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise could have made says nothing. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const hyi_aim *aim, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), along = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_I(hyi_size)(sum);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAX8(across, HYI_MAX8(HYI_I(hyi_size)(k[i].x), HYI_I(hyi_size)(k[i].y)));
        along = HYI_MAX8(along, HYI_I(hyi_size)(k[i].z));
    }
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 farthest = HYI_MAX8(HYI_I(hyi_size)(first), HYI_I(hyi_size)(last));
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_I(hyi_size)(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MAX8(HYI_MUL8(HYI_SET8(4.0f), noise), HYI_SET8(HYI_EDGE_LEAST)), size));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(aim->t_near)), HYI_LT8(HYI_SET8(aim->t_far), least)));
    float from = aim->t_near + 16.0f * HYI_ULP * fabsf(aim->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. exact: nothing is certain. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_verdicts) verdicts;
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(aim, rows + 3u * i * count, count);
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(aim->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(aim->t_far), first), HYI_LT8(last, HYI_SET8(aim->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (verdicts.possible && !exact)
        HYI_I(hyi_judge_triangles)(aim, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.unit != 1.0, found = false;
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts.certain >> lane & 1u) {
            if (verdicts.least[lane] > flight->aim.t_far) continue;
            found = hyi_expect(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane]) || found;
        } else {
            found = hyi_offer(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) {
                hyi_settle(site, flight);
                return;
            }
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which the rays of a swarm meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

/* Eight boxes against the bounds of a packet: no ray of it enters earlier than enter, or leaves later. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes_all)(const hyi_packet *p, const HYI_I(hyi_planes) *planes, HYI_F8 *enter) {
    HYI_F8 first = HYI_SET8(p->first_t), last = HYI_SET8(p->last_t);
    for (int a = 0; a < 3; a++) {
        HYI_F8 low = HYI_SET8(p->inverse_low[a]), high = HYI_SET8(p->inverse_high[a]);
        HYI_F8 to_near = HYI_SUB8(planes->near_planes[a], HYI_SET8(p->near_origin[a]));
        HYI_F8 to_far = HYI_SUB8(planes->far_planes[a], HYI_SET8(p->far_origin[a]));
        first = HYI_MAX8(first, HYI_MIN8(HYI_MUL8(to_near, low), HYI_MUL8(to_near, high)));
        last = HYI_MIN8(last, HYI_MAX8(HYI_MUL8(to_far, low), HYI_MUL8(to_far, high)));
    }
    *enter = first;
    return HYI_LE8(first, last);
}

/* Whether any ray of a packet meets the box of child c. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int k = 0; k < 3; k++) {
        uint32_t a = swarm->axis[k], near_row = swarm->near_plane[a];
        float slack = (near_row & 1u) ? p->bound[a] : -p->bound[a];
        HYI_FW origin = HYI_LOADW(p->origin[k]), inverse = HYI_LOADW(p->inverse[k]);
        first = HYI_MAXW(first, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row][c] + slack), origin), inverse));
        last = HYI_MINW(last, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row ^ 1u][c] - slack), origin), inverse));
    }
    return HYI_BITSW(HYI_LEW(first, last)) != 0u;
}

/* Of the children in mask, those whose box some ray of a packet meets. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_boxes_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t mask) {
    uint32_t met = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        met &= ~((HYI_I(hyi_meet_box_each)(swarm, p, node, c) ? 0u : 1u) << c);
    }
    return met;
}

/* ---- triangles */

/* A corner in the sheared frames of the rays of a packet. */
typedef struct HYI_I(hyi_corner_all) {
    HYI_FW x, y, z;
} HYI_I(hyi_corner_all);

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[2] * stride]), HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[0] * stride]), HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[1] * stride]), HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

/* Which rays certainly miss one triangle: the same test as of one ray and eight triangles. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_miss_triangle_all)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3]) {
    HYI_I(hyi_corner_all) p = corners[0], q = corners[1], r = corners[2];
    HYI_FW a = HYI_I(hyi_cross_all)(r, q), b = HYI_I(hyi_cross_all)(p, r), c = HYI_I(hyi_cross_all)(q, p);
    HYI_MW below = HYI_LTW(HYI_MINW(HYI_MINW(a, b), c), HYI_ZEROW());
    HYI_MW above = HYI_LTW(HYI_ZEROW(), HYI_MAXW(HYI_MAXW(a, b), c));
    HYI_FW scale = HYI_LOADW(packet->inverse_z);
    HYI_FW ta = HYI_MULW(p.z, scale), tb = HYI_MULW(q.z, scale), tc = HYI_MULW(r.z, scale);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), HYI_MINW(HYI_MINW(ta, tb), tc));
    HYI_MW early = HYI_LTW(HYI_MAXW(HYI_MAXW(ta, tb), tc), HYI_LOADW(packet->t_near));
    return HYI_ORW(HYI_ANDW(below, above), HYI_ORW(late, early));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_size_all)(HYI_FW v) { return HYI_MAXW(v, HYI_SUBW(HYI_ZEROW(), v)); }

/* Of one triangle that rays may hit but those in out, where any hit does: stops the rays that certainly hit it; left: the
   others, without those that turn out to miss it. hyi_judge_triangles, for all rays. Returns whether it stopped any. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_stop_certain)(const hyi_swarm *swarm, hyi_packet *packet, const HYI_I(hyi_corner_all) k[3], HYI_MW out, uint32_t *left) {
    HYI_FW zero = HYI_ZEROW(), scale = HYI_LOADW(packet->inverse_z), t_near = HYI_LOADW(packet->t_near), t_far = HYI_LOADW(packet->t_far);
    HYI_FW a = HYI_I(hyi_cross_all)(k[2], k[1]), b = HYI_I(hyi_cross_all)(k[0], k[2]), c = HYI_I(hyi_cross_all)(k[1], k[0]);
    HYI_FW sum = HYI_ADDW(HYI_ADDW(a, b), c), across = zero, along = zero;
    HYI_FW ta = HYI_MULW(k[0].z, scale), tb = HYI_MULW(k[1].z, scale), tc = HYI_MULW(k[2].z, scale);
    HYI_FW first = HYI_MINW(HYI_MINW(ta, tb), tc), last = HYI_MAXW(HYI_MAXW(ta, tb), tc);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAXW(across, HYI_MAXW(HYI_I(hyi_size_all)(k[i].x), HYI_I(hyi_size_all)(k[i].y)));
        along = HYI_MAXW(along, HYI_I(hyi_size_all)(k[i].z));
    }
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(a, ta), HYI_MULW(b, tb)), HYI_MULW(c, tc)), inverse);
    HYI_FW farthest = HYI_MAXW(HYI_I(hyi_size_all)(first), HYI_I(hyi_size_all)(last));
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(last, first), noise), HYI_I(hyi_size_all)(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    HYI_FW least = HYI_SUBW(mean, error), most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, HYI_MINW(HYI_MINW(a, b), c)), HYI_LTW(HYI_MAXW(HYI_MAXW(a, b), c), zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MAXW(HYI_MULW(HYI_SETW(4.0f), noise), HYI_SETW(HYI_EDGE_LEAST)), HYI_I(hyi_size_all)(sum)));
    HYI_MW missed = HYI_ANDW(known, HYI_ORW(HYI_LTW(most, t_near), HYI_LTW(t_far, least)));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_I(hyi_size_all)(t_near)));
    HYI_MW hit = HYI_ANDW(HYI_ANDW(known, HYI_LEW(from, least)), HYI_LTW(most, HYI_LOADW(packet->best_t)));
    uint32_t stopped = HYI_BITSW(hit) & ~HYI_BITSW(out);
    *left = HYI_ALLW & ~(stopped | HYI_BITSW(HYI_ORW(out, missed)));
    if (stopped == 0) return false;
    for (uint32_t some = stopped; some; some &= some - 1u) {
        packet->t_far[hyi_lowest_bit(some)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(some)] = swarm->site.instance;
    }
    return true;
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const double n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(HYI_SETD(n[0]), v[0])), second = HYI_PIND(HYI_MULD(HYI_SETD(n[1]), v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(HYI_SETD(n[2]), v[2]))));
}

/* What hyi_confirm works out, for half of a packet: t and the edge functions; the bits of those that are hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3], const double corner[3],
                                                       const double n[3], const double z[3], int half, double t[8], double weights[3][8]) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_HALFD(corners[i].x, half);
        y[i] = HYI_HALFD(corners[i].y, half);
        to_corner[i] = HYI_PIND(HYI_SUBD(HYI_SETD(corner[i]), HYI_HALFD(HYI_LOADW(packet->origin[i]), half)));
        direction[i] = HYI_HALFD(HYI_LOADW(packet->direction[i]), half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(n, direction);
    HYI_FD plane = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD least = HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), most = least;
    for (int i = 1; i < 3; i++) {
        HYI_FD to = HYI_PIND(HYI_SUBD(HYI_SETD(z[i]), HYI_HALFD(HYI_LOADW(packet->origin[2]), half)));
        HYI_FD at = HYI_PIND(HYI_MULD(to, t_by_z));
        least = HYI_MIND(least, at);
        most = HYI_MAXD(most, at);
    }
    HYI_STORED(t, HYI_MIND(HYI_MAXD(plane, least), most));
    HYI_STORED(weights[0], b);
    HYI_STORED(weights[1], c);
    HYI_STORED(weights[2], sum);
    return ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
}

/* The plane of a triangle as hyi_plane_distance works it out: a corner and the normal. */
HYI_INLINE void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, double corner[3], double n[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        corner[i] = (double)row[0];
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner[i]);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner[i]);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t primitive, float t, const double weights[3]) {
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        double inverse = hyi_rounded_double(1.0 / weights[2]);
        if (hyi_lets_pass(&swarm->site, ray, primitive, (float)(weights[0] * inverse), (float)(weights[1] * inverse))) return false;
    }
    packet->best_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    for (int i = 0; i < 3; i++) packet->weights[i][lane] = weights[i];
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number t of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], uint32_t mask) {
    double corner[3], n[3], z[3];
    for (uint32_t k = 0; k < 3; k++) z[k] = (double)hyi_leaf_rows(swarm->site.bvh, leaf)[(3u * k + swarm->axis[2]) * hyi_leaf_count(leaf) + triangle];
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    bool found = false;
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), corner, n);
    for (int half = 0; half < 2; half++) {
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        double t[8], weights[3][8];
        if (some) some &= HYI_I(hyi_confirm_half)(packet, corners, corner, n, z, half, t, weights);
        for (; some; some &= some - 1u) {
            uint32_t lane = hyi_lowest_bit(some);
            const double w[3] = {weights[0][lane], weights[1][lane], weights[2][lane]};
            if ((float)t[lane] <= packet->best_t[base + lane] && HYI_I(hyi_take_hit)(swarm, packet, base + lane, primitive, (float)t[lane], w)) found = true;
        }
    }
    return found;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * triangles + triangle, triangles);
}

/* Offers triangle number t of a leaf to all rays but those in out, which miss it. Returns whether one of them hits it. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], HYI_MW out) {
    uint32_t left = ~HYI_BITSW(out) & HYI_ALLW;
    bool found = left && swarm->any && !swarm->site.asks_alpha && HYI_I(hyi_stop_certain)(swarm, packet, corners, out, &left);
    if (left && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, corners, left)) found = true;
    return found;
}

/* node, c: where the leaf hangs; NULL: nowhere. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count,
                                                    const hyi_node *node, uint32_t c) {
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        hyi_packet *packet = &swarm->packets[list[i]];
        bool found = false;
        if (packet->last_t < packet->first_t || (node && !HYI_I(hyi_meet_box_each)(swarm, packet, node, c))) continue;
        for (uint32_t t = 0; t < triangles; t++) {
            HYI_I(hyi_corner_all) corners[3];
            HYI_I(hyi_shear_triangle)(swarm, packet, leaf, t, corners);
            if (HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, corners, HYI_I(hyi_miss_triangle_all)(packet, corners))) found = true;
        }
        if (found) packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    }
}

/* ---- making packets */

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        if (!(HYI_GREATESTW(shear) - HYI_LEASTW(shear) <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        low[a] = HYI_LEASTW(HYI_LOADW(o[a]));
        high[a] = HYI_GREATESTW(HYI_LOADW(o[a]));
        extent = box->upper[a] - box->lower[a] > extent ? box->upper[a] - box->lower[a] : extent;
    }
    float below = hyi_reach(box, low[axis], (int)axis, false), above = hyi_reach(box, high[axis], (int)axis, false);
    z = below > above ? below : above;
    for (int a = 0; a < 3; a++) {
        if (!(high[a] - low[a] <= HYI_PACKET_ORIGINS * extent)) return false;
        if (high[a] > low[a]) packet->spread = 1;
        float from_low = hyi_reach(box, low[a], a, false), from_high = hyi_reach(box, high[a], a, false);
        float size = fabsf(low[a]) > fabsf(high[a]) ? fabsf(low[a]) : fabsf(high[a]);
        float bound = hyi_slab_bound(from_low > from_high ? from_low : from_high, z, size);
        bool falls = (packet->group >> a & 1u) != 0u;
        packet->bound[a] = bound;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a == (int)axis ? 2 : (a + 3 - (int)axis) % 3 - 1], HYI_LOADW(inverse[a]));
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* Whether |v| <= limit in all lanes; what is not a number is not. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_all_within)(const float *v, float limit) {
    HYI_FW size = HYI_MAXW(HYI_LOADW(v), HYI_SUBW(HYI_ZEROW(), HYI_LOADW(v)));
    return HYI_BITSW(HYI_LEW(size, HYI_SETW(limit))) == HYI_ALLW;
}

/* What directions have in common: see hyi_aim_group; false: they differ in that, or in size by far. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_group)(float d[3][HYI_PACKET_WIDTH], uint32_t *group) {
    HYI_FW zero = HYI_ZEROW(), size[3];
    *group = 0;
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        uint32_t falls = HYI_BITSW(HYI_LTW(v, zero));
        if ((falls != 0u && falls != HYI_ALLW) || !HYI_I(hyi_all_within)(d[a], 1073741824.0f)) return false;
        *group |= (falls ? 1u : 0u) << a;
        size[a] = HYI_MAXW(v, HYI_SUBW(zero, v));
    }
    uint32_t y = HYI_BITSW(HYI_LTW(size[0], size[1])), z = HYI_BITSW(HYI_LTW(HYI_MAXW(size[0], size[1]), size[2]));
    if ((z != 0u && z != HYI_ALLW) || (z == 0u && y != 0u && y != HYI_ALLW)) return false;
    HYI_FW largest = HYI_MAXW(HYI_MAXW(size[0], size[1]), size[2]);
    *group |= (z ? 2u : y ? 1u : 0u) << 3;
    return HYI_LEASTW(largest) >= 9.31322574615478515625e-10f;
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_HALFD(HYI_LOADW(packet->direction[2]), half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_HALFD(HYI_LOADW(packet->direction[i]), half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common of HYI_LANES rays, by their numbers; false: they are of several groups, unsound,
   or of uncommon size. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_rays)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_packet *packet,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float d[3][HYI_PACKET_WIDTH], scale = bvh->scale;
    uint32_t axis[3];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyk_ray ray = hyi_load_ray(&rays[numbers[i]]);
        o[0][i] = ray.origin.x * scale;
        o[1][i] = ray.origin.y * scale;
        o[2][i] = ray.origin.z * scale;
        d[0][i] = ray.direction.x * scale;
        d[1][i] = ray.direction.y * scale;
        d[2][i] = ray.direction.z * scale;
        packet->t_min[i] = ray.t_min;
        packet->best_t[i] = ray.t_max;
    }
    if (!HYI_I(hyi_find_group)(d, &packet->group)) return false;
    HYI_FW t_min = HYI_LOADW(packet->t_min), t_max = HYI_LOADW(packet->best_t), limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT)), zero = HYI_ZEROW();
    bool limits = HYI_BITSW(HYI_LEW(t_min, limit)) == HYI_ALLW && HYI_BITSW(HYI_LEW(t_min, t_max)) == HYI_ALLW;
    if (!limits || !HYI_I(hyi_all_within)(packet->t_min, FLT_MAX)) return false;
    hyi_group_axes(packet->group, axis);
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        if (!HYI_I(hyi_all_within)(o[a], 1099511627776.0f)) return false;
        v = HYI_MAXW(HYI_MAXW(v, HYI_SUBW(zero, v)), HYI_SETW(HYI_STEADY));
        HYI_STOREW(inverse[a], HYI_DIVW(HYI_SETW(packet->group >> a & 1u ? -1.0f : 1.0f), v));
        HYI_STOREW(packet->origin[a], HYI_LOADW(o[axis[a]]));
        HYI_STOREW(packet->direction[a], HYI_LOADW(d[axis[a]]));
    }
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    HYI_STOREW(packet->best_t, limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(t_min, HYI_MULW(HYI_MAXW(t_min, HYI_SUBW(zero, t_min)), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(limit, HYI_MULW(HYI_MAXW(limit, HYI_SUBW(zero, limit)), slack)));
    HYI_I(hyi_shear_packet)(packet);
    return true;
}

/* A packet of rays first, first + 1, ... of the swarm's; false: they are not alike, or not fit for one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t first) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
    }
    packet->count = HYI_LANES;
    return HYI_I(hyi_load_rays)(swarm->site.bvh, swarm->rays, packet->ray, packet, o, inverse) &&
           HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_box *box, uint32_t group, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH]) {
    HYI_FW reach[3], zero = HYI_ZEROW();
    for (int a = 0; a < 3; a++) {
        HYI_FW below = HYI_SUBW(HYI_LOADW(o[a]), HYI_SETW(box->lower[a])), above = HYI_SUBW(HYI_SETW(box->upper[a]), HYI_LOADW(o[a]));
        reach[a] = HYI_MAXW(HYI_MAXW(below, HYI_SUBW(zero, below)), HYI_MAXW(above, HYI_SUBW(zero, above)));
    }
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(o[a]), size = HYI_MAXW(v, HYI_SUBW(zero, v)), back = HYI_SUBW(zero, HYI_LOADW(inverse[a]));
        HYI_FW bound = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], reach[group >> 3])), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), size));
        bound = (group >> a & 1u) ? HYI_SUBW(zero, bound) : bound;
        HYI_STOREW(near_offset[a], HYI_MULW(HYI_ADDW(v, bound), back));
        HYI_STOREW(far_offset[a], HYI_MULW(HYI_SUBW(v, bound), back));
    }
}

/* Flights of HYI_LANES rays by their numbers; false: they must be begun one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_begin_flights)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_flight *flights) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    uint32_t plane[3][HYI_PACKET_WIDTH], axes[3][HYI_PACKET_WIDTH], none[HYI_PACKET_WIDTH] = {0}, axis[3];
    hyi_packet p;
    if (!HYI_I(hyi_load_rays)(bvh, rays, numbers, &p, o, inverse)) return false;
    HYI_I(hyi_offset_lanes)(&bvh->scaled, p.group, o, inverse, near_offset, far_offset);
    hyi_group_axes(p.group, axis);
    for (uint32_t a = 0; a < 3; a++) {
        for (uint32_t i = 0; i < HYI_LANES; i++) {
            plane[a][i] = 2u * a + (p.group >> a & 1u);
            axes[a][i] = axis[a];
        }
    }
    const void *boxes[16] = {inverse[0], inverse[1], inverse[2], near_offset[0], near_offset[1], near_offset[2], far_offset[0], far_offset[1], far_offset[2],
                             p.t_near, p.t_far, plane[0], plane[1], plane[2], p.inverse_z, p.best_t};
    const void *triangles[16] = {p.origin[0], p.origin[1], p.origin[2], p.shear[0], p.shear[1], axes[0], axes[1], axes[2],
                                 p.direction[0], p.direction[1], p.direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.inverse));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        flight->aim.t_by_z = p.t_by_z[i];
        flight->aim.unit = flight->aim.inverse_unit = 1.0;
        flight->best.t = p.best_t[i];
        flight->best.u = flight->best.v = 0.0f;
        flight->best.instance = flight->best.primitive = HYK_NONE;
        flight->t_min = p.t_min[i];
        flight->ray = &rays[numbers[i]];
    }
    return true;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, hyk_hit *hits, uint8_t *occluded) {
    for (uint32_t i = 0; i < packet->count; i++) {
        bool found = packet->instance[i] != HYK_NONE;
        if (occluded) {
            occluded[packet->ray[i]] = found ? 1 : 0;
            continue;
        }
        hyk_hit *hit = &hits[packet->ray[i]];
        double inverse = found ? hyi_rounded_double(1.0 / packet->weights[2][i]) : 0.0;
        hit->t = found ? packet->best_t[i] : -1.0f;
        hit->u = found ? (float)(packet->weights[0][i] * inverse) : 0.0f;
        hit->v = found ? (float)(packet->weights[1][i] * inverse) : 0.0f;
        hit->instance = packet->instance[i];
        hit->primitive = packet->primitive[i];
        hyi_locate_in_world(swarm->site.accel, &hit->instance, &hit->primitive);
    }
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->unit != 1.0) return false;
        for (int a = 0; a < 3; a++) {
            o[aim->axis[a]][i] = packet->origin[a][i] = aim->origin[a];
            packet->direction[a][i] = aim->direction[a];
            inverse[a][i] = aim->inverse[a];
        }
        packet->shear[0][i] = aim->shear[0];
        packet->shear[1][i] = aim->shear[1];
        packet->inverse_z[i] = aim->inverse_z;
        packet->t_by_z[i] = aim->t_by_z;
        packet->t_min[i] = flight->t_min;
        packet->t_near[i] = aim->t_near;
        packet->t_far[i] = i < count ? aim->t_far : -FLT_MAX;
        packet->best_t[i] = flight->best.t;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->weights[2][i] = 0.0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->count = count;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* Sum 0 stands for a hit that is not the packet's own. */
HYI_INLINE void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    for (uint32_t i = 0; i < packet->count; i++) {
        hyi_best *best = &swarm->flights[packet->ray[i]].best;
        best->instance = packet->instance[i];
        if (packet->weights[2][i] == 0.0) continue;
        double inverse = hyi_rounded_double(1.0 / packet->weights[2][i]);
        best->t = packet->best_t[i];
        best->u = (float)(packet->weights[0][i] * inverse);
        best->v = (float)(packet->weights[1][i] * inverse);
        best->primitive = packet->primitive[i];
    }
}
/* ---- many rays (expanded once for each instruction set)

   Lists hold numbers of flights, or of packets. Each list of a node's children has room for all of the node's. */

HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets);
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count);

/* Keeps of a list the rays that have not met anything nearer than the box of child c since they were put on it; returns
   how many these are. Without a branch: it would be taken by chance. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_still_meet)(const hyi_swarm *swarm, const hyi_node *node, uint32_t c, uint32_t *list, uint32_t count) {
    float x = node->planes[swarm->near_plane[0]][c], y = node->planes[swarm->near_plane[1]][c], z = node->planes[swarm->near_plane[2]][c];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t ray = list[i];
        const hyi_aim *aim = &swarm->flights[ray].aim;
        float tx = x * aim->inverse[0] + aim->near_offset[0], ty = y * aim->inverse[1] + aim->near_offset[1], tz = z * aim->inverse[2] + aim->near_offset[2];
        float enter = tx > ty ? tx : ty;
        enter = tz > enter ? tz : enter;
        list[kept] = ray;
        kept += enter <= aim->t_far ? 1u : 0u;
    }
    return kept;
}

/* Puts each of count items on the lists of the children that it meets; nearest: the least t at which each child is entered. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                           uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH], bool packets) {
    HYI_I(hyi_planes) planes;
    HYI_F8 least = HYI_SET8(FLT_MAX);
    for (int a = 0; a < 3; a++) {
        planes.near_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a]]);
        planes.far_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a] ^ 1u]);
    }
    for (uint32_t first = 0; first < count; first += HYI_DEAL) {
        uint32_t some = count - first < HYI_DEAL ? count - first : HYI_DEAL;
        HYI_MASKS masks;
        HYI_CLEAR_MASKS(masks);
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            uint32_t item = list[first + i];
            HYI_M8 mask = packets ? HYI_I(hyi_meet_boxes_all)(&swarm->packets[item], &planes, &enter)
                                  : HYI_I(hyi_meet_boxes)(&swarm->flights[item].aim, planes.near_planes, planes.far_planes, &enter);
            least = HYI_MIN8_WHERE(least, mask, enter);
            uint32_t met = HYI_BITS8(mask);
            if (packets && swarm->packets[item].spread && hyi_count_bits(met) > 2u) met = HYI_I(hyi_meet_boxes_each)(swarm, &swarm->packets[item], node, met);
            masks.bytes[i] = (uint8_t)met;
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
}

/* Orders all children by t, nearest first, without a branch: a child comes after as many as are nearer, or as near with a
   smaller number. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_order_children)(const float t[HYI_WIDTH], uint32_t order[HYI_WIDTH]) {
    HYI_F8 all = HYI_LOADU8(t);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        HYI_F8 one = HYI_SET8(t[c]);
        order[hyi_count_bits(HYI_BITS8(HYI_LT8(all, one)) | (HYI_BITS8(HYI_LE8(all, one)) & ((1u << c) - 1u)))] = c;
    }
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_node)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    const hyi_node *node = &swarm->site.bvh->nodes[at];
    uint32_t stride = (count + 15u) & ~15u, dealt[HYI_WIDTH] = {0}, order[HYI_WIDTH], mask = 0;
    float nearest[HYI_WIDTH];
    HYI_I(hyi_deal)(swarm, node, list, count, space, stride, dealt, nearest, packets);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        mask |= (dealt[c] ? 1u : 0u) << c;
        nearest[c] = dealt[c] ? nearest[c] : FLT_MAX; /* met by the bounds of a packet, but by none of its rays */
    }
    if (swarm->site.bvh->rows)
        for (uint32_t left = mask; left; left &= left - 1u) hyi_prefetch_child(swarm->site.bvh, node->child[hyi_lowest_bit(left)]);
    HYI_I(hyi_order_children)(nearest, order);
    uint32_t children = hyi_count_bits(mask);
    for (uint32_t i = 0; i < children; i++) {
        uint32_t c = order[i];
        bool leaf = swarm->site.bvh->rows && hyi_child_is_leaf(node->child[c]);
        if (leaf && packets) HYI_I(hyi_list_leaf_packets)(swarm, node->child[c], space + c * stride, dealt[c], node, c);
        else if (leaf) HYI_I(hyi_list_leaf_rays)(swarm, node->child[c], space + c * stride, HYI_I(hyi_still_meet)(swarm, node, c, space + c * stride, dealt[c]));
        else HYI_I(hyi_list_visit)(swarm, node->child[c], space + c * stride, dealt[c], space + HYI_WIDTH * stride, packets);
    }
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_rays)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, false);
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, true);
}

/* ---- leaves */

HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (HYI_I(hyi_offer_leaf)(&swarm->site, flight, leaf, swarm->any) && swarm->any) hyi_flight_stop(flight);
    }
}

/* ---- instances */

HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any);

/* The rays of a list go through what a box of the tree over instances stands for. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_enter)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_site site = hyi_site_of_item(swarm->site.accel, swarm->site.bvh->ids[hyi_leaf_first(leaf)]);
    hyi_flight *below = swarm->stream->flights + swarm->stream->capacity;
    uint32_t entered = 0, *from = space;
    for (uint32_t i = 0; i < count; i++) {
        if (swarm->flights[list[i]].aim.t_far == -FLT_MAX) continue;
        if (hyi_flight_enter(&below[entered], &swarm->flights[list[i]], &site)) from[entered++] = list[i];
    }
    HYI_I(hyi_run_flights)(&site, swarm->stream, entered, space + ((entered + 15u) & ~15u), true, swarm->any);
    for (uint32_t i = 0; i < entered; i++) {
        hyi_flight *above = &swarm->flights[from[i]];
        if (hyi_flight_return(above, &below[i]) && swarm->any) hyi_flight_stop(above);
    }
}

/* ---- the way down */

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_one_by_one)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (flight->aim.t_far == -FLT_MAX) continue;
        HYI_I(hyi_walk_scene)(&swarm->site, flight, at, swarm->any);
        if (swarm->any && flight->best.instance != HYK_NONE) hyi_flight_stop(flight);
    }
}

/* A list of packets through a node: one at a time where more would leave no room for lists of one on every level below. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_list_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, size_t room) {
    bool together = room >= (size_t)HYI_WIDTH * (count + 15u) + HYI_LIST_RESERVE;
    uint32_t some = together ? count : 1u;
    for (uint32_t first = 0; first < count; first += some) HYI_I(hyi_list_node_packets)(swarm, at, list + first, some, space);
}

/* Sends a list through the child at; space: free memory for lists. Where that is short, or the list is, rays go one by
   one. Packets are only in trees of triangles. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    size_t room = (size_t)(swarm->stream->lists + swarm->stream->list_count - space);
    bool fits = room >= (size_t)(HYI_WIDTH + 2u) * (count + 16u), leaf = hyi_child_is_leaf(at);
    if (packets) {
        if (leaf) HYI_I(hyi_list_leaf_packets)(swarm, at, list, count, NULL, 0);
        else HYI_I(hyi_list_packets)(swarm, at, list, count, space, room);
    } else if (leaf && swarm->site.bvh->rows) {
        HYI_I(hyi_list_leaf_rays)(swarm, at, list, count);
    } else if (leaf && fits) {
        HYI_I(hyi_list_enter)(swarm, at, list, count, space);
    } else if (fits && count >= HYI_LIST_LEAST) {
        HYI_I(hyi_list_node_rays)(swarm, at, list, count, space);
    } else {
        HYI_I(hyi_list_one_by_one)(swarm, at, list, count);
    }
}

/* ---- all rays of a slice */

/* Sends count packets on their way, those of a group together. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_packets)(hyi_swarm *swarm, uint32_t count, uint32_t *space) {
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)swarm->packets[i].group;
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, order + first[g], first[g + 1] - first[g], space + room, true);
    }
}

/* Packets of the alike among a group's flights; the others come to stand first in rays, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike)(hyi_swarm *swarm, uint32_t *rays, uint32_t count, uint32_t *space) {
    uint32_t made = 0, others = 0;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some > HYI_LANES / 2u && HYI_I(hyi_pack_flights)(swarm, &swarm->packets[made], rays + first, some)) made++;
        else
            for (uint32_t i = 0; i < some; i++) rays[others++] = rays[first + i];
    }
    for (uint32_t i = 0; i < made; i++) space[i] = i;
    if (made) HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, space, made, space + ((made + 15u) & ~15u), true);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_flights)(swarm, &swarm->packets[i]);
    return others;
}

/* Sends the first count flights (deep: of those in instances) through the tree of site. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any) {
    hyi_swarm swarm;
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = NULL;
    swarm.flights = stream->flights + (deep ? stream->capacity : 0u);
    swarm.packets = stream->packets + (deep ? stream->packet_share : 0u);
    swarm.any = any;
    if (count < HYI_LIST_LEAST || (size_t)(stream->lists + stream->list_count - space) < (size_t)12u * (room + 16u) + HYI_LIST_RESERVE) {
        for (uint32_t i = 0; i < count; i++) HYI_I(hyi_walk_scene)(site, &swarm.flights[i], site->bvh->root, any);
        return;
    }
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)hyi_aim_group(&swarm.flights[i].aim);
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        uint32_t *rays = order + first[g], some = first[g + 1] - first[g];
        hyi_set_group(&swarm, g);
        if (deep && some) some = HYI_I(hyi_run_alike)(&swarm, rays, some, space + room);
        if (some) HYI_I(hyi_list_visit)(&swarm, site->bvh->root, rays, some, space + room, false);
    }
    for (uint32_t i = 0; i < count && !any && site->bvh->rows; i++) hyi_settle(site, &swarm.flights[i]);
}

/* Packets of those among count rays that are alike; numbers and keys of the others go to others and keys, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike_rays)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits,
                                                     uint8_t *occluded, uint32_t count, uint32_t *others, uint8_t *keys) {
    hyi_swarm swarm;
    uint32_t made = 0, rest = 0;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = rays;
    swarm.flights = NULL;
    swarm.packets = stream->packets;
    swarm.any = occluded != NULL;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some == HYI_LANES && HYI_I(hyi_pack_rays)(&swarm, &swarm.packets[made], first)) {
            made++;
            continue;
        }
        for (uint32_t i = first; i < first + some; i++) {
            others[rest] = i;
            keys[rest++] = hyi_direction_key(hyi_load_ray(&rays[i]).direction);
        }
    }
    if (made) HYI_I(hyi_run_packets)(&swarm, made, stream->lists);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_rays)(&swarm, &swarm.packets[i], hits, occluded);
    return rest;
}
/* The words of one instruction set end here. */
#undef HYI_ADD2
#undef HYI_ADD4
#undef HYI_ADD8
#undef HYI_ADDD
#undef HYI_ADDW
#undef HYI_ALLW
#undef HYI_ALWAYS_EXACT
#undef HYI_AND4
#undef HYI_AND8
#undef HYI_ANDW
#undef HYI_AS_FLOATS
#undef HYI_BITS2_2
#undef HYI_BITS4_4
#undef HYI_BITS8
#undef HYI_BITSW
#undef HYI_CHOOSE4
#undef HYI_CLEAR_MASKS
#undef HYI_D2
#undef HYI_DEAL
#undef HYI_DIV2
#undef HYI_DIV4
#undef HYI_DIV8
#undef HYI_DIVD
#undef HYI_DIVW
#undef HYI_F4
#undef HYI_F8
#undef HYI_FD
#undef HYI_FW
#undef HYI_GREATEST4
#undef HYI_GREATESTW
#undef HYI_HALFD
#undef HYI_HIGH_AS_DOUBLES
#undef HYI_I
#undef HYI_LANES
#undef HYI_LINES
#undef HYI_LE4
#undef HYI_LE8
#undef HYI_LEAST4
#undef HYI_LEASTW
#undef HYI_LEW
#undef HYI_LOAD4
#undef HYI_LOAD4_ALIGNED
#undef HYI_LOAD8
#undef HYI_LOADD
#undef HYI_LOAD2
#undef HYI_LOADU8
#undef HYI_LOADW
#undef HYI_LOW_AS_DOUBLES
#undef HYI_LT2
#undef HYI_LT4
#undef HYI_LT8
#undef HYI_LTD
#undef HYI_LTW
#undef HYI_M4
#undef HYI_M8
#undef HYI_MAD4
#undef HYI_MAD8
#undef HYI_MASKS
#undef HYI_MAX2
#undef HYI_MAX4
#undef HYI_MAX8
#undef HYI_MAXD
#undef HYI_MAXW
#undef HYI_MIN2
#undef HYI_MIN4
#undef HYI_MIN8
#undef HYI_MIN8_WHERE
#undef HYI_MIND
#undef HYI_MINW
#undef HYI_MUL2
#undef HYI_MUL4
#undef HYI_MUL8
#undef HYI_MULD
#undef HYI_MULW
#undef HYI_MW
#undef HYI_OR4
#undef HYI_OR8
#undef HYI_ORW
#undef HYI_PIN2
#undef HYI_PIN4
#undef HYI_PIN8
#undef HYI_PIND
#undef HYI_PINW
#undef HYI_SET2
#undef HYI_SET4
#undef HYI_SET8
#undef HYI_SETD
#undef HYI_SETW
#undef HYI_STORE2
#undef HYI_STORE4
#undef HYI_STORE8
#undef HYI_STORED
#undef HYI_STOREH
#undef HYI_STOREW
#undef HYI_SUB2
#undef HYI_SUB4
#undef HYI_SUB8
#undef HYI_SUBD
#undef HYI_SUBW
#undef HYI_TARGET
#undef HYI_ZERO8
#undef HYI_ZEROW

#endif /* HYI_X86 */
#endif /* HYI_BVH_AVX2_H */

/* >>bvh-avx512: traversal in the words of AVX-512: sixteen rays a packet, lists dealt by compression */
#ifndef HYI_BVH_AVX512_H
#define HYI_BVH_AVX512_H

#if HYI_X86

/* The compiler's own intrinsics begin with undefined values, which it then warns of (GCC bug 105593). */
#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#endif

HYI_INLINE HYI_AVX512 __m512d hyi_pin_double_avx512(__m512d value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX512 __m256 hyi_pin8_avx512(__m256 value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

HYI_INLINE HYI_AVX512 __m512 hyi_pin16_avx512(__m512 value) {
#if HYI_GNU
    __asm__("" : "+v"(value));
#endif
    return value;
}

typedef union hyi_masks16 {
    uint8_t bytes[16];
    __m128i lanes;
} hyi_masks16;

/* Appends sixteen items to the lists of the children that their masks name. */
HYI_INLINE HYI_AVX512 void hyi_deal_out_avx512(const uint32_t *items, const hyi_masks16 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    __m512i all = _mm512_loadu_si512(items);
    __m128i bits = masks->lanes;
    for (int c = 7; c >= 0; c--) { /* the highest bit of each byte is the child's */
        __mmask16 takes = _mm_movepi8_mask(bits);
        bits = _mm_add_epi8(bits, bits);
        _mm512_storeu_si512(lists + (size_t)(uint32_t)c * stride + dealt[c], _mm512_maskz_compress_epi32(takes, all));
        dealt[c] += (uint32_t)_mm_popcnt_u32(takes);
    }
}

/* hyi_lines: a transposition in four steps. */
HYI_INLINE HYI_AVX512 void hyi_lines_avx512(const void *const rows[16], char *lines) {
    __m512 a[16], b[16];
    for (int i = 0; i < 16; i++) a[i] = _mm512_loadu_ps(rows[i]);
    for (int i = 0; i < 16; i += 2) {
        b[i] = _mm512_unpacklo_ps(a[i], a[i + 1]);
        b[i + 1] = _mm512_unpackhi_ps(a[i], a[i + 1]);
    }
    for (int i = 0; i < 16; i += 4) {
        for (int k = 0; k < 2; k++) {
            __m512d low = _mm512_castps_pd(b[i + k]), high = _mm512_castps_pd(b[i + k + 2]);
            a[i + 2 * k] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, high));
            a[i + 2 * k + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, high));
        }
    }
    for (int i = 0; i < 16; i += 8) {
        for (int k = 0; k < 4; k++) {
            b[i + k] = _mm512_shuffle_f32x4(a[i + k], a[i + k + 4], 0x88);
            b[i + k + 4] = _mm512_shuffle_f32x4(a[i + k], a[i + k + 4], 0xdd);
        }
    }
    for (int k = 0; k < 8; k++) {
        char *low = lines + (size_t)(uint32_t)k * sizeof(hyi_flight);
        _mm512_store_ps((float *)(void *)low, _mm512_shuffle_f32x4(b[k], b[k + 8], 0x88));
        _mm512_store_ps((float *)(void *)(low + 8u * sizeof(hyi_flight)), _mm512_shuffle_f32x4(b[k], b[k + 8], 0xdd));
    }
}

#define HYI_TARGET HYI_AVX512
#define HYI_LINES(rows, lines) hyi_lines_avx512(rows, lines)
#define HYI_I(name) name##_avx512
#define HYI_F8 __m256
#define HYI_ALWAYS_EXACT 0
#define HYI_M8 __mmask8
#define HYI_LOAD8(p) _mm256_load_ps(p)
#define HYI_LOADU8(p) _mm256_loadu_ps(p)
#define HYI_STORE8(p, a) _mm256_storeu_ps(p, a)
#define HYI_SET8(value) _mm256_set1_ps(value)
#define HYI_ZERO8() _mm256_setzero_ps()
#define HYI_ADD8(a, b) _mm256_add_ps(a, b)
#define HYI_SUB8(a, b) _mm256_sub_ps(a, b)
#define HYI_MUL8(a, b) _mm256_mul_ps(a, b)
#define HYI_DIV8(a, b) _mm256_div_ps(a, b)
#define HYI_MAD8(a, b, c) _mm256_fmadd_ps(a, b, c)
#define HYI_MIN8(a, b) _mm256_min_ps(a, b)
#define HYI_MAX8(a, b) _mm256_max_ps(a, b)
#define HYI_LT8(a, b) _mm256_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define HYI_LE8(a, b) _mm256_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define HYI_AND8(a, b) ((__mmask8)((a) & (b)))
#define HYI_OR8(a, b) ((__mmask8)((a) | (b)))
#define HYI_BITS8(m) ((uint32_t)(m))
#define HYI_MIN8_WHERE(a, m, b) _mm256_mask_min_ps(a, m, a, b)
#define HYI_PIN8(a) hyi_pin8_avx512(a)
#define HYI_LANES 16u
#define HYI_ALLW 0xffffu
#define HYI_FW __m512
#define HYI_MW __mmask16
#define HYI_LOADW(p) _mm512_loadu_ps(p)
#define HYI_SETW(value) _mm512_set1_ps(value)
#define HYI_ZEROW() _mm512_setzero_ps()
#define HYI_SUBW(a, b) _mm512_sub_ps(a, b)
#define HYI_MULW(a, b) _mm512_mul_ps(a, b)
#define HYI_MINW(a, b) _mm512_min_ps(a, b)
#define HYI_MAXW(a, b) _mm512_max_ps(a, b)
#define HYI_LTW(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define HYI_ANDW(a, b) ((__mmask16)((a) & (b)))
#define HYI_ORW(a, b) ((__mmask16)((a) | (b)))
#define HYI_BITSW(m) ((uint32_t)(m))
#define HYI_PINW(a) hyi_pin16_avx512(a)
#define HYI_GREATESTW(a) _mm512_reduce_max_ps(a)
#define HYI_DEAL 16u
#define HYI_MASKS hyi_masks16
#define HYI_CLEAR_MASKS(masks) ((masks).lanes = _mm_setzero_si128())

#define HYI_STOREW(p, a) _mm512_storeu_ps(p, a)
#define HYI_ADDW(a, b) _mm512_add_ps(a, b)
#define HYI_DIVW(a, b) _mm512_div_ps(a, b)
#define HYI_LEW(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define HYI_LEASTW(a) _mm512_reduce_min_ps(a)
#define HYI_FD __m512d
#define HYI_SETD(value) _mm512_set1_pd(value)
#define HYI_HALFD(a, half) _mm512_cvtps_pd((half) ? _mm512_extractf32x8_ps(a, 1) : _mm512_castps512_ps256(a))
#define HYI_LOADD(p) _mm512_loadu_pd(p)
#define HYI_STORED(p, a) _mm512_storeu_pd(p, a)
#define HYI_STOREH(p, half, a) _mm256_storeu_ps((p) + 8 * (half), _mm512_cvtpd_ps(a))
#define HYI_ADDD(a, b) _mm512_add_pd(a, b)
#define HYI_SUBD(a, b) _mm512_sub_pd(a, b)
#define HYI_MULD(a, b) _mm512_mul_pd(a, b)
#define HYI_DIVD(a, b) _mm512_div_pd(a, b)
#define HYI_MIND(a, b) _mm512_min_pd(a, b)
#define HYI_MAXD(a, b) _mm512_max_pd(a, b)
#define HYI_LTD(a, b) ((uint32_t)_mm512_cmp_pd_mask(a, b, _CMP_LT_OQ))
#define HYI_PIND(a) hyi_pin_double_avx512(a)
/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_size)(HYI_F8 v) { return HYI_MAX8(v, HYI_SUB8(HYI_ZERO8(), v)); }

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t by their share in the sum, of the difference between t at the corners;
   rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise could have made says nothing. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const hyi_aim *aim, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), along = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_I(hyi_size)(sum);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAX8(across, HYI_MAX8(HYI_I(hyi_size)(k[i].x), HYI_I(hyi_size)(k[i].y)));
        along = HYI_MAX8(along, HYI_I(hyi_size)(k[i].z));
    }
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 farthest = HYI_MAX8(HYI_I(hyi_size)(first), HYI_I(hyi_size)(last));
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_I(hyi_size)(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MAX8(HYI_MUL8(HYI_SET8(4.0f), noise), HYI_SET8(HYI_EDGE_LEAST)), size));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(aim->t_near)), HYI_LT8(HYI_SET8(aim->t_far), least)));
    float from = aim->t_near + 16.0f * HYI_ULP * fabsf(aim->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. exact: nothing is certain. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_verdicts) verdicts;
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(aim, rows + 3u * i * count, count);
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(aim->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(aim->t_far), first), HYI_LT8(last, HYI_SET8(aim->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (verdicts.possible && !exact)
        HYI_I(hyi_judge_triangles)(aim, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.unit != 1.0, found = false;
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts.certain >> lane & 1u) {
            if (verdicts.least[lane] > flight->aim.t_far) continue;
            found = hyi_expect(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane]) || found;
        } else {
            found = hyi_offer(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) {
                hyi_settle(site, flight);
                return;
            }
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which the rays of a swarm meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

/* Eight boxes against the bounds of a packet: no ray of it enters earlier than enter, or leaves later. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes_all)(const hyi_packet *p, const HYI_I(hyi_planes) *planes, HYI_F8 *enter) {
    HYI_F8 first = HYI_SET8(p->first_t), last = HYI_SET8(p->last_t);
    for (int a = 0; a < 3; a++) {
        HYI_F8 low = HYI_SET8(p->inverse_low[a]), high = HYI_SET8(p->inverse_high[a]);
        HYI_F8 to_near = HYI_SUB8(planes->near_planes[a], HYI_SET8(p->near_origin[a]));
        HYI_F8 to_far = HYI_SUB8(planes->far_planes[a], HYI_SET8(p->far_origin[a]));
        first = HYI_MAX8(first, HYI_MIN8(HYI_MUL8(to_near, low), HYI_MUL8(to_near, high)));
        last = HYI_MIN8(last, HYI_MAX8(HYI_MUL8(to_far, low), HYI_MUL8(to_far, high)));
    }
    *enter = first;
    return HYI_LE8(first, last);
}

/* Whether any ray of a packet meets the box of child c. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int k = 0; k < 3; k++) {
        uint32_t a = swarm->axis[k], near_row = swarm->near_plane[a];
        float slack = (near_row & 1u) ? p->bound[a] : -p->bound[a];
        HYI_FW origin = HYI_LOADW(p->origin[k]), inverse = HYI_LOADW(p->inverse[k]);
        first = HYI_MAXW(first, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row][c] + slack), origin), inverse));
        last = HYI_MINW(last, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row ^ 1u][c] - slack), origin), inverse));
    }
    return HYI_BITSW(HYI_LEW(first, last)) != 0u;
}

/* Of the children in mask, those whose box some ray of a packet meets. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_boxes_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t mask) {
    uint32_t met = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        met &= ~((HYI_I(hyi_meet_box_each)(swarm, p, node, c) ? 0u : 1u) << c);
    }
    return met;
}

/* ---- triangles */

/* A corner in the sheared frames of the rays of a packet. */
typedef struct HYI_I(hyi_corner_all) {
    HYI_FW x, y, z;
} HYI_I(hyi_corner_all);

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[2] * stride]), HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[0] * stride]), HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[1] * stride]), HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

/* Which rays certainly miss one triangle: the same test as of one ray and eight triangles. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_miss_triangle_all)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3]) {
    HYI_I(hyi_corner_all) p = corners[0], q = corners[1], r = corners[2];
    HYI_FW a = HYI_I(hyi_cross_all)(r, q), b = HYI_I(hyi_cross_all)(p, r), c = HYI_I(hyi_cross_all)(q, p);
    HYI_MW below = HYI_LTW(HYI_MINW(HYI_MINW(a, b), c), HYI_ZEROW());
    HYI_MW above = HYI_LTW(HYI_ZEROW(), HYI_MAXW(HYI_MAXW(a, b), c));
    HYI_FW scale = HYI_LOADW(packet->inverse_z);
    HYI_FW ta = HYI_MULW(p.z, scale), tb = HYI_MULW(q.z, scale), tc = HYI_MULW(r.z, scale);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), HYI_MINW(HYI_MINW(ta, tb), tc));
    HYI_MW early = HYI_LTW(HYI_MAXW(HYI_MAXW(ta, tb), tc), HYI_LOADW(packet->t_near));
    return HYI_ORW(HYI_ANDW(below, above), HYI_ORW(late, early));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_size_all)(HYI_FW v) { return HYI_MAXW(v, HYI_SUBW(HYI_ZEROW(), v)); }

/* Of one triangle that rays may hit but those in out, where any hit does: stops the rays that certainly hit it; left: the
   others, without those that turn out to miss it. hyi_judge_triangles, for all rays. Returns whether it stopped any. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_stop_certain)(const hyi_swarm *swarm, hyi_packet *packet, const HYI_I(hyi_corner_all) k[3], HYI_MW out, uint32_t *left) {
    HYI_FW zero = HYI_ZEROW(), scale = HYI_LOADW(packet->inverse_z), t_near = HYI_LOADW(packet->t_near), t_far = HYI_LOADW(packet->t_far);
    HYI_FW a = HYI_I(hyi_cross_all)(k[2], k[1]), b = HYI_I(hyi_cross_all)(k[0], k[2]), c = HYI_I(hyi_cross_all)(k[1], k[0]);
    HYI_FW sum = HYI_ADDW(HYI_ADDW(a, b), c), across = zero, along = zero;
    HYI_FW ta = HYI_MULW(k[0].z, scale), tb = HYI_MULW(k[1].z, scale), tc = HYI_MULW(k[2].z, scale);
    HYI_FW first = HYI_MINW(HYI_MINW(ta, tb), tc), last = HYI_MAXW(HYI_MAXW(ta, tb), tc);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAXW(across, HYI_MAXW(HYI_I(hyi_size_all)(k[i].x), HYI_I(hyi_size_all)(k[i].y)));
        along = HYI_MAXW(along, HYI_I(hyi_size_all)(k[i].z));
    }
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(a, ta), HYI_MULW(b, tb)), HYI_MULW(c, tc)), inverse);
    HYI_FW farthest = HYI_MAXW(HYI_I(hyi_size_all)(first), HYI_I(hyi_size_all)(last));
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(last, first), noise), HYI_I(hyi_size_all)(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    HYI_FW least = HYI_SUBW(mean, error), most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, HYI_MINW(HYI_MINW(a, b), c)), HYI_LTW(HYI_MAXW(HYI_MAXW(a, b), c), zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MAXW(HYI_MULW(HYI_SETW(4.0f), noise), HYI_SETW(HYI_EDGE_LEAST)), HYI_I(hyi_size_all)(sum)));
    HYI_MW missed = HYI_ANDW(known, HYI_ORW(HYI_LTW(most, t_near), HYI_LTW(t_far, least)));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_I(hyi_size_all)(t_near)));
    HYI_MW hit = HYI_ANDW(HYI_ANDW(known, HYI_LEW(from, least)), HYI_LTW(most, HYI_LOADW(packet->best_t)));
    uint32_t stopped = HYI_BITSW(hit) & ~HYI_BITSW(out);
    *left = HYI_ALLW & ~(stopped | HYI_BITSW(HYI_ORW(out, missed)));
    if (stopped == 0) return false;
    for (uint32_t some = stopped; some; some &= some - 1u) {
        packet->t_far[hyi_lowest_bit(some)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(some)] = swarm->site.instance;
    }
    return true;
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const double n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(HYI_SETD(n[0]), v[0])), second = HYI_PIND(HYI_MULD(HYI_SETD(n[1]), v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(HYI_SETD(n[2]), v[2]))));
}

/* What hyi_confirm works out, for half of a packet: t and the edge functions; the bits of those that are hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3], const double corner[3],
                                                       const double n[3], const double z[3], int half, double t[8], double weights[3][8]) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_HALFD(corners[i].x, half);
        y[i] = HYI_HALFD(corners[i].y, half);
        to_corner[i] = HYI_PIND(HYI_SUBD(HYI_SETD(corner[i]), HYI_HALFD(HYI_LOADW(packet->origin[i]), half)));
        direction[i] = HYI_HALFD(HYI_LOADW(packet->direction[i]), half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(n, direction);
    HYI_FD plane = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD least = HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), most = least;
    for (int i = 1; i < 3; i++) {
        HYI_FD to = HYI_PIND(HYI_SUBD(HYI_SETD(z[i]), HYI_HALFD(HYI_LOADW(packet->origin[2]), half)));
        HYI_FD at = HYI_PIND(HYI_MULD(to, t_by_z));
        least = HYI_MIND(least, at);
        most = HYI_MAXD(most, at);
    }
    HYI_STORED(t, HYI_MIND(HYI_MAXD(plane, least), most));
    HYI_STORED(weights[0], b);
    HYI_STORED(weights[1], c);
    HYI_STORED(weights[2], sum);
    return ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
}

/* The plane of a triangle as hyi_plane_distance works it out: a corner and the normal. */
HYI_INLINE void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, double corner[3], double n[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        corner[i] = (double)row[0];
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner[i]);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner[i]);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t primitive, float t, const double weights[3]) {
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        double inverse = hyi_rounded_double(1.0 / weights[2]);
        if (hyi_lets_pass(&swarm->site, ray, primitive, (float)(weights[0] * inverse), (float)(weights[1] * inverse))) return false;
    }
    packet->best_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    for (int i = 0; i < 3; i++) packet->weights[i][lane] = weights[i];
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number t of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], uint32_t mask) {
    double corner[3], n[3], z[3];
    for (uint32_t k = 0; k < 3; k++) z[k] = (double)hyi_leaf_rows(swarm->site.bvh, leaf)[(3u * k + swarm->axis[2]) * hyi_leaf_count(leaf) + triangle];
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    bool found = false;
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), corner, n);
    for (int half = 0; half < 2; half++) {
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        double t[8], weights[3][8];
        if (some) some &= HYI_I(hyi_confirm_half)(packet, corners, corner, n, z, half, t, weights);
        for (; some; some &= some - 1u) {
            uint32_t lane = hyi_lowest_bit(some);
            const double w[3] = {weights[0][lane], weights[1][lane], weights[2][lane]};
            if ((float)t[lane] <= packet->best_t[base + lane] && HYI_I(hyi_take_hit)(swarm, packet, base + lane, primitive, (float)t[lane], w)) found = true;
        }
    }
    return found;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * triangles + triangle, triangles);
}

/* Offers triangle number t of a leaf to all rays but those in out, which miss it. Returns whether one of them hits it. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], HYI_MW out) {
    uint32_t left = ~HYI_BITSW(out) & HYI_ALLW;
    bool found = left && swarm->any && !swarm->site.asks_alpha && HYI_I(hyi_stop_certain)(swarm, packet, corners, out, &left);
    if (left && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, corners, left)) found = true;
    return found;
}

/* node, c: where the leaf hangs; NULL: nowhere. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count,
                                                    const hyi_node *node, uint32_t c) {
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        hyi_packet *packet = &swarm->packets[list[i]];
        bool found = false;
        if (packet->last_t < packet->first_t || (node && !HYI_I(hyi_meet_box_each)(swarm, packet, node, c))) continue;
        for (uint32_t t = 0; t < triangles; t++) {
            HYI_I(hyi_corner_all) corners[3];
            HYI_I(hyi_shear_triangle)(swarm, packet, leaf, t, corners);
            if (HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, corners, HYI_I(hyi_miss_triangle_all)(packet, corners))) found = true;
        }
        if (found) packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    }
}

/* ---- making packets */

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        if (!(HYI_GREATESTW(shear) - HYI_LEASTW(shear) <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        low[a] = HYI_LEASTW(HYI_LOADW(o[a]));
        high[a] = HYI_GREATESTW(HYI_LOADW(o[a]));
        extent = box->upper[a] - box->lower[a] > extent ? box->upper[a] - box->lower[a] : extent;
    }
    float below = hyi_reach(box, low[axis], (int)axis, false), above = hyi_reach(box, high[axis], (int)axis, false);
    z = below > above ? below : above;
    for (int a = 0; a < 3; a++) {
        if (!(high[a] - low[a] <= HYI_PACKET_ORIGINS * extent)) return false;
        if (high[a] > low[a]) packet->spread = 1;
        float from_low = hyi_reach(box, low[a], a, false), from_high = hyi_reach(box, high[a], a, false);
        float size = fabsf(low[a]) > fabsf(high[a]) ? fabsf(low[a]) : fabsf(high[a]);
        float bound = hyi_slab_bound(from_low > from_high ? from_low : from_high, z, size);
        bool falls = (packet->group >> a & 1u) != 0u;
        packet->bound[a] = bound;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a == (int)axis ? 2 : (a + 3 - (int)axis) % 3 - 1], HYI_LOADW(inverse[a]));
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* Whether |v| <= limit in all lanes; what is not a number is not. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_all_within)(const float *v, float limit) {
    HYI_FW size = HYI_MAXW(HYI_LOADW(v), HYI_SUBW(HYI_ZEROW(), HYI_LOADW(v)));
    return HYI_BITSW(HYI_LEW(size, HYI_SETW(limit))) == HYI_ALLW;
}

/* What directions have in common: see hyi_aim_group; false: they differ in that, or in size by far. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_group)(float d[3][HYI_PACKET_WIDTH], uint32_t *group) {
    HYI_FW zero = HYI_ZEROW(), size[3];
    *group = 0;
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        uint32_t falls = HYI_BITSW(HYI_LTW(v, zero));
        if ((falls != 0u && falls != HYI_ALLW) || !HYI_I(hyi_all_within)(d[a], 1073741824.0f)) return false;
        *group |= (falls ? 1u : 0u) << a;
        size[a] = HYI_MAXW(v, HYI_SUBW(zero, v));
    }
    uint32_t y = HYI_BITSW(HYI_LTW(size[0], size[1])), z = HYI_BITSW(HYI_LTW(HYI_MAXW(size[0], size[1]), size[2]));
    if ((z != 0u && z != HYI_ALLW) || (z == 0u && y != 0u && y != HYI_ALLW)) return false;
    HYI_FW largest = HYI_MAXW(HYI_MAXW(size[0], size[1]), size[2]);
    *group |= (z ? 2u : y ? 1u : 0u) << 3;
    return HYI_LEASTW(largest) >= 9.31322574615478515625e-10f;
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_HALFD(HYI_LOADW(packet->direction[2]), half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_HALFD(HYI_LOADW(packet->direction[i]), half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common of HYI_LANES rays, by their numbers; false: they are of several groups, unsound,
   or of uncommon size. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_rays)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_packet *packet,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float d[3][HYI_PACKET_WIDTH], scale = bvh->scale;
    uint32_t axis[3];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyk_ray ray = hyi_load_ray(&rays[numbers[i]]);
        o[0][i] = ray.origin.x * scale;
        o[1][i] = ray.origin.y * scale;
        o[2][i] = ray.origin.z * scale;
        d[0][i] = ray.direction.x * scale;
        d[1][i] = ray.direction.y * scale;
        d[2][i] = ray.direction.z * scale;
        packet->t_min[i] = ray.t_min;
        packet->best_t[i] = ray.t_max;
    }
    if (!HYI_I(hyi_find_group)(d, &packet->group)) return false;
    HYI_FW t_min = HYI_LOADW(packet->t_min), t_max = HYI_LOADW(packet->best_t), limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT)), zero = HYI_ZEROW();
    bool limits = HYI_BITSW(HYI_LEW(t_min, limit)) == HYI_ALLW && HYI_BITSW(HYI_LEW(t_min, t_max)) == HYI_ALLW;
    if (!limits || !HYI_I(hyi_all_within)(packet->t_min, FLT_MAX)) return false;
    hyi_group_axes(packet->group, axis);
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        if (!HYI_I(hyi_all_within)(o[a], 1099511627776.0f)) return false;
        v = HYI_MAXW(HYI_MAXW(v, HYI_SUBW(zero, v)), HYI_SETW(HYI_STEADY));
        HYI_STOREW(inverse[a], HYI_DIVW(HYI_SETW(packet->group >> a & 1u ? -1.0f : 1.0f), v));
        HYI_STOREW(packet->origin[a], HYI_LOADW(o[axis[a]]));
        HYI_STOREW(packet->direction[a], HYI_LOADW(d[axis[a]]));
    }
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    HYI_STOREW(packet->best_t, limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(t_min, HYI_MULW(HYI_MAXW(t_min, HYI_SUBW(zero, t_min)), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(limit, HYI_MULW(HYI_MAXW(limit, HYI_SUBW(zero, limit)), slack)));
    HYI_I(hyi_shear_packet)(packet);
    return true;
}

/* A packet of rays first, first + 1, ... of the swarm's; false: they are not alike, or not fit for one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t first) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
    }
    packet->count = HYI_LANES;
    return HYI_I(hyi_load_rays)(swarm->site.bvh, swarm->rays, packet->ray, packet, o, inverse) &&
           HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_box *box, uint32_t group, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH]) {
    HYI_FW reach[3], zero = HYI_ZEROW();
    for (int a = 0; a < 3; a++) {
        HYI_FW below = HYI_SUBW(HYI_LOADW(o[a]), HYI_SETW(box->lower[a])), above = HYI_SUBW(HYI_SETW(box->upper[a]), HYI_LOADW(o[a]));
        reach[a] = HYI_MAXW(HYI_MAXW(below, HYI_SUBW(zero, below)), HYI_MAXW(above, HYI_SUBW(zero, above)));
    }
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(o[a]), size = HYI_MAXW(v, HYI_SUBW(zero, v)), back = HYI_SUBW(zero, HYI_LOADW(inverse[a]));
        HYI_FW bound = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], reach[group >> 3])), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), size));
        bound = (group >> a & 1u) ? HYI_SUBW(zero, bound) : bound;
        HYI_STOREW(near_offset[a], HYI_MULW(HYI_ADDW(v, bound), back));
        HYI_STOREW(far_offset[a], HYI_MULW(HYI_SUBW(v, bound), back));
    }
}

/* Flights of HYI_LANES rays by their numbers; false: they must be begun one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_begin_flights)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_flight *flights) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    uint32_t plane[3][HYI_PACKET_WIDTH], axes[3][HYI_PACKET_WIDTH], none[HYI_PACKET_WIDTH] = {0}, axis[3];
    hyi_packet p;
    if (!HYI_I(hyi_load_rays)(bvh, rays, numbers, &p, o, inverse)) return false;
    HYI_I(hyi_offset_lanes)(&bvh->scaled, p.group, o, inverse, near_offset, far_offset);
    hyi_group_axes(p.group, axis);
    for (uint32_t a = 0; a < 3; a++) {
        for (uint32_t i = 0; i < HYI_LANES; i++) {
            plane[a][i] = 2u * a + (p.group >> a & 1u);
            axes[a][i] = axis[a];
        }
    }
    const void *boxes[16] = {inverse[0], inverse[1], inverse[2], near_offset[0], near_offset[1], near_offset[2], far_offset[0], far_offset[1], far_offset[2],
                             p.t_near, p.t_far, plane[0], plane[1], plane[2], p.inverse_z, p.best_t};
    const void *triangles[16] = {p.origin[0], p.origin[1], p.origin[2], p.shear[0], p.shear[1], axes[0], axes[1], axes[2],
                                 p.direction[0], p.direction[1], p.direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.inverse));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        flight->aim.t_by_z = p.t_by_z[i];
        flight->aim.unit = flight->aim.inverse_unit = 1.0;
        flight->best.t = p.best_t[i];
        flight->best.u = flight->best.v = 0.0f;
        flight->best.instance = flight->best.primitive = HYK_NONE;
        flight->t_min = p.t_min[i];
        flight->ray = &rays[numbers[i]];
    }
    return true;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, hyk_hit *hits, uint8_t *occluded) {
    for (uint32_t i = 0; i < packet->count; i++) {
        bool found = packet->instance[i] != HYK_NONE;
        if (occluded) {
            occluded[packet->ray[i]] = found ? 1 : 0;
            continue;
        }
        hyk_hit *hit = &hits[packet->ray[i]];
        double inverse = found ? hyi_rounded_double(1.0 / packet->weights[2][i]) : 0.0;
        hit->t = found ? packet->best_t[i] : -1.0f;
        hit->u = found ? (float)(packet->weights[0][i] * inverse) : 0.0f;
        hit->v = found ? (float)(packet->weights[1][i] * inverse) : 0.0f;
        hit->instance = packet->instance[i];
        hit->primitive = packet->primitive[i];
        hyi_locate_in_world(swarm->site.accel, &hit->instance, &hit->primitive);
    }
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->unit != 1.0) return false;
        for (int a = 0; a < 3; a++) {
            o[aim->axis[a]][i] = packet->origin[a][i] = aim->origin[a];
            packet->direction[a][i] = aim->direction[a];
            inverse[a][i] = aim->inverse[a];
        }
        packet->shear[0][i] = aim->shear[0];
        packet->shear[1][i] = aim->shear[1];
        packet->inverse_z[i] = aim->inverse_z;
        packet->t_by_z[i] = aim->t_by_z;
        packet->t_min[i] = flight->t_min;
        packet->t_near[i] = aim->t_near;
        packet->t_far[i] = i < count ? aim->t_far : -FLT_MAX;
        packet->best_t[i] = flight->best.t;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->weights[2][i] = 0.0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->count = count;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* Sum 0 stands for a hit that is not the packet's own. */
HYI_INLINE void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    for (uint32_t i = 0; i < packet->count; i++) {
        hyi_best *best = &swarm->flights[packet->ray[i]].best;
        best->instance = packet->instance[i];
        if (packet->weights[2][i] == 0.0) continue;
        double inverse = hyi_rounded_double(1.0 / packet->weights[2][i]);
        best->t = packet->best_t[i];
        best->u = (float)(packet->weights[0][i] * inverse);
        best->v = (float)(packet->weights[1][i] * inverse);
        best->primitive = packet->primitive[i];
    }
}
/* ---- many rays (expanded once for each instruction set)

   Lists hold numbers of flights, or of packets. Each list of a node's children has room for all of the node's. */

HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets);
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count);

/* Keeps of a list the rays that have not met anything nearer than the box of child c since they were put on it; returns
   how many these are. Without a branch: it would be taken by chance. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_still_meet)(const hyi_swarm *swarm, const hyi_node *node, uint32_t c, uint32_t *list, uint32_t count) {
    float x = node->planes[swarm->near_plane[0]][c], y = node->planes[swarm->near_plane[1]][c], z = node->planes[swarm->near_plane[2]][c];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t ray = list[i];
        const hyi_aim *aim = &swarm->flights[ray].aim;
        float tx = x * aim->inverse[0] + aim->near_offset[0], ty = y * aim->inverse[1] + aim->near_offset[1], tz = z * aim->inverse[2] + aim->near_offset[2];
        float enter = tx > ty ? tx : ty;
        enter = tz > enter ? tz : enter;
        list[kept] = ray;
        kept += enter <= aim->t_far ? 1u : 0u;
    }
    return kept;
}

/* Puts each of count items on the lists of the children that it meets; nearest: the least t at which each child is entered. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                           uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH], bool packets) {
    HYI_I(hyi_planes) planes;
    HYI_F8 least = HYI_SET8(FLT_MAX);
    for (int a = 0; a < 3; a++) {
        planes.near_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a]]);
        planes.far_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a] ^ 1u]);
    }
    for (uint32_t first = 0; first < count; first += HYI_DEAL) {
        uint32_t some = count - first < HYI_DEAL ? count - first : HYI_DEAL;
        HYI_MASKS masks;
        HYI_CLEAR_MASKS(masks);
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            uint32_t item = list[first + i];
            HYI_M8 mask = packets ? HYI_I(hyi_meet_boxes_all)(&swarm->packets[item], &planes, &enter)
                                  : HYI_I(hyi_meet_boxes)(&swarm->flights[item].aim, planes.near_planes, planes.far_planes, &enter);
            least = HYI_MIN8_WHERE(least, mask, enter);
            uint32_t met = HYI_BITS8(mask);
            if (packets && swarm->packets[item].spread && hyi_count_bits(met) > 2u) met = HYI_I(hyi_meet_boxes_each)(swarm, &swarm->packets[item], node, met);
            masks.bytes[i] = (uint8_t)met;
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
}

/* Orders all children by t, nearest first, without a branch: a child comes after as many as are nearer, or as near with a
   smaller number. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_order_children)(const float t[HYI_WIDTH], uint32_t order[HYI_WIDTH]) {
    HYI_F8 all = HYI_LOADU8(t);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        HYI_F8 one = HYI_SET8(t[c]);
        order[hyi_count_bits(HYI_BITS8(HYI_LT8(all, one)) | (HYI_BITS8(HYI_LE8(all, one)) & ((1u << c) - 1u)))] = c;
    }
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_node)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    const hyi_node *node = &swarm->site.bvh->nodes[at];
    uint32_t stride = (count + 15u) & ~15u, dealt[HYI_WIDTH] = {0}, order[HYI_WIDTH], mask = 0;
    float nearest[HYI_WIDTH];
    HYI_I(hyi_deal)(swarm, node, list, count, space, stride, dealt, nearest, packets);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        mask |= (dealt[c] ? 1u : 0u) << c;
        nearest[c] = dealt[c] ? nearest[c] : FLT_MAX; /* met by the bounds of a packet, but by none of its rays */
    }
    if (swarm->site.bvh->rows)
        for (uint32_t left = mask; left; left &= left - 1u) hyi_prefetch_child(swarm->site.bvh, node->child[hyi_lowest_bit(left)]);
    HYI_I(hyi_order_children)(nearest, order);
    uint32_t children = hyi_count_bits(mask);
    for (uint32_t i = 0; i < children; i++) {
        uint32_t c = order[i];
        bool leaf = swarm->site.bvh->rows && hyi_child_is_leaf(node->child[c]);
        if (leaf && packets) HYI_I(hyi_list_leaf_packets)(swarm, node->child[c], space + c * stride, dealt[c], node, c);
        else if (leaf) HYI_I(hyi_list_leaf_rays)(swarm, node->child[c], space + c * stride, HYI_I(hyi_still_meet)(swarm, node, c, space + c * stride, dealt[c]));
        else HYI_I(hyi_list_visit)(swarm, node->child[c], space + c * stride, dealt[c], space + HYI_WIDTH * stride, packets);
    }
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_rays)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, false);
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, true);
}

/* ---- leaves */

HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (HYI_I(hyi_offer_leaf)(&swarm->site, flight, leaf, swarm->any) && swarm->any) hyi_flight_stop(flight);
    }
}

/* ---- instances */

HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any);

/* The rays of a list go through what a box of the tree over instances stands for. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_enter)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_site site = hyi_site_of_item(swarm->site.accel, swarm->site.bvh->ids[hyi_leaf_first(leaf)]);
    hyi_flight *below = swarm->stream->flights + swarm->stream->capacity;
    uint32_t entered = 0, *from = space;
    for (uint32_t i = 0; i < count; i++) {
        if (swarm->flights[list[i]].aim.t_far == -FLT_MAX) continue;
        if (hyi_flight_enter(&below[entered], &swarm->flights[list[i]], &site)) from[entered++] = list[i];
    }
    HYI_I(hyi_run_flights)(&site, swarm->stream, entered, space + ((entered + 15u) & ~15u), true, swarm->any);
    for (uint32_t i = 0; i < entered; i++) {
        hyi_flight *above = &swarm->flights[from[i]];
        if (hyi_flight_return(above, &below[i]) && swarm->any) hyi_flight_stop(above);
    }
}

/* ---- the way down */

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_one_by_one)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (flight->aim.t_far == -FLT_MAX) continue;
        HYI_I(hyi_walk_scene)(&swarm->site, flight, at, swarm->any);
        if (swarm->any && flight->best.instance != HYK_NONE) hyi_flight_stop(flight);
    }
}

/* A list of packets through a node: one at a time where more would leave no room for lists of one on every level below. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_list_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, size_t room) {
    bool together = room >= (size_t)HYI_WIDTH * (count + 15u) + HYI_LIST_RESERVE;
    uint32_t some = together ? count : 1u;
    for (uint32_t first = 0; first < count; first += some) HYI_I(hyi_list_node_packets)(swarm, at, list + first, some, space);
}

/* Sends a list through the child at; space: free memory for lists. Where that is short, or the list is, rays go one by
   one. Packets are only in trees of triangles. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    size_t room = (size_t)(swarm->stream->lists + swarm->stream->list_count - space);
    bool fits = room >= (size_t)(HYI_WIDTH + 2u) * (count + 16u), leaf = hyi_child_is_leaf(at);
    if (packets) {
        if (leaf) HYI_I(hyi_list_leaf_packets)(swarm, at, list, count, NULL, 0);
        else HYI_I(hyi_list_packets)(swarm, at, list, count, space, room);
    } else if (leaf && swarm->site.bvh->rows) {
        HYI_I(hyi_list_leaf_rays)(swarm, at, list, count);
    } else if (leaf && fits) {
        HYI_I(hyi_list_enter)(swarm, at, list, count, space);
    } else if (fits && count >= HYI_LIST_LEAST) {
        HYI_I(hyi_list_node_rays)(swarm, at, list, count, space);
    } else {
        HYI_I(hyi_list_one_by_one)(swarm, at, list, count);
    }
}

/* ---- all rays of a slice */

/* Sends count packets on their way, those of a group together. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_packets)(hyi_swarm *swarm, uint32_t count, uint32_t *space) {
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)swarm->packets[i].group;
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, order + first[g], first[g + 1] - first[g], space + room, true);
    }
}

/* Packets of the alike among a group's flights; the others come to stand first in rays, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike)(hyi_swarm *swarm, uint32_t *rays, uint32_t count, uint32_t *space) {
    uint32_t made = 0, others = 0;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some > HYI_LANES / 2u && HYI_I(hyi_pack_flights)(swarm, &swarm->packets[made], rays + first, some)) made++;
        else
            for (uint32_t i = 0; i < some; i++) rays[others++] = rays[first + i];
    }
    for (uint32_t i = 0; i < made; i++) space[i] = i;
    if (made) HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, space, made, space + ((made + 15u) & ~15u), true);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_flights)(swarm, &swarm->packets[i]);
    return others;
}

/* Sends the first count flights (deep: of those in instances) through the tree of site. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any) {
    hyi_swarm swarm;
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = NULL;
    swarm.flights = stream->flights + (deep ? stream->capacity : 0u);
    swarm.packets = stream->packets + (deep ? stream->packet_share : 0u);
    swarm.any = any;
    if (count < HYI_LIST_LEAST || (size_t)(stream->lists + stream->list_count - space) < (size_t)12u * (room + 16u) + HYI_LIST_RESERVE) {
        for (uint32_t i = 0; i < count; i++) HYI_I(hyi_walk_scene)(site, &swarm.flights[i], site->bvh->root, any);
        return;
    }
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)hyi_aim_group(&swarm.flights[i].aim);
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        uint32_t *rays = order + first[g], some = first[g + 1] - first[g];
        hyi_set_group(&swarm, g);
        if (deep && some) some = HYI_I(hyi_run_alike)(&swarm, rays, some, space + room);
        if (some) HYI_I(hyi_list_visit)(&swarm, site->bvh->root, rays, some, space + room, false);
    }
    for (uint32_t i = 0; i < count && !any && site->bvh->rows; i++) hyi_settle(site, &swarm.flights[i]);
}

/* Packets of those among count rays that are alike; numbers and keys of the others go to others and keys, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike_rays)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits,
                                                     uint8_t *occluded, uint32_t count, uint32_t *others, uint8_t *keys) {
    hyi_swarm swarm;
    uint32_t made = 0, rest = 0;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = rays;
    swarm.flights = NULL;
    swarm.packets = stream->packets;
    swarm.any = occluded != NULL;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some == HYI_LANES && HYI_I(hyi_pack_rays)(&swarm, &swarm.packets[made], first)) {
            made++;
            continue;
        }
        for (uint32_t i = first; i < first + some; i++) {
            others[rest] = i;
            keys[rest++] = hyi_direction_key(hyi_load_ray(&rays[i]).direction);
        }
    }
    if (made) HYI_I(hyi_run_packets)(&swarm, made, stream->lists);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_rays)(&swarm, &swarm.packets[i], hits, occluded);
    return rest;
}
/* The words of one instruction set end here. */
#undef HYI_ADD2
#undef HYI_ADD4
#undef HYI_ADD8
#undef HYI_ADDD
#undef HYI_ADDW
#undef HYI_ALLW
#undef HYI_ALWAYS_EXACT
#undef HYI_AND4
#undef HYI_AND8
#undef HYI_ANDW
#undef HYI_AS_FLOATS
#undef HYI_BITS2_2
#undef HYI_BITS4_4
#undef HYI_BITS8
#undef HYI_BITSW
#undef HYI_CHOOSE4
#undef HYI_CLEAR_MASKS
#undef HYI_D2
#undef HYI_DEAL
#undef HYI_DIV2
#undef HYI_DIV4
#undef HYI_DIV8
#undef HYI_DIVD
#undef HYI_DIVW
#undef HYI_F4
#undef HYI_F8
#undef HYI_FD
#undef HYI_FW
#undef HYI_GREATEST4
#undef HYI_GREATESTW
#undef HYI_HALFD
#undef HYI_HIGH_AS_DOUBLES
#undef HYI_I
#undef HYI_LANES
#undef HYI_LINES
#undef HYI_LE4
#undef HYI_LE8
#undef HYI_LEAST4
#undef HYI_LEASTW
#undef HYI_LEW
#undef HYI_LOAD4
#undef HYI_LOAD4_ALIGNED
#undef HYI_LOAD8
#undef HYI_LOADD
#undef HYI_LOAD2
#undef HYI_LOADU8
#undef HYI_LOADW
#undef HYI_LOW_AS_DOUBLES
#undef HYI_LT2
#undef HYI_LT4
#undef HYI_LT8
#undef HYI_LTD
#undef HYI_LTW
#undef HYI_M4
#undef HYI_M8
#undef HYI_MAD4
#undef HYI_MAD8
#undef HYI_MASKS
#undef HYI_MAX2
#undef HYI_MAX4
#undef HYI_MAX8
#undef HYI_MAXD
#undef HYI_MAXW
#undef HYI_MIN2
#undef HYI_MIN4
#undef HYI_MIN8
#undef HYI_MIN8_WHERE
#undef HYI_MIND
#undef HYI_MINW
#undef HYI_MUL2
#undef HYI_MUL4
#undef HYI_MUL8
#undef HYI_MULD
#undef HYI_MULW
#undef HYI_MW
#undef HYI_OR4
#undef HYI_OR8
#undef HYI_ORW
#undef HYI_PIN2
#undef HYI_PIN4
#undef HYI_PIN8
#undef HYI_PIND
#undef HYI_PINW
#undef HYI_SET2
#undef HYI_SET4
#undef HYI_SET8
#undef HYI_SETD
#undef HYI_SETW
#undef HYI_STORE2
#undef HYI_STORE4
#undef HYI_STORE8
#undef HYI_STORED
#undef HYI_STOREH
#undef HYI_STOREW
#undef HYI_SUB2
#undef HYI_SUB4
#undef HYI_SUB8
#undef HYI_SUBD
#undef HYI_SUBW
#undef HYI_TARGET
#undef HYI_ZERO8
#undef HYI_ZEROW

#if HYI_GNU && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#endif /* HYI_X86 */
#endif /* HYI_BVH_AVX512_H */

/* >>bvh-sse42: traversal in the words of SSE4.2: eight lanes are two times four */
#ifndef HYI_BVH_SSE42_H
#define HYI_BVH_SSE42_H

#if HYI_X86

HYI_INLINE HYI_SSE42 __m128 hyi_pin4_sse42(__m128 value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_SSE42 __m128d hyi_pin2_sse42(__m128d value) {
#if HYI_GNU
    __asm__("" : "+x"(value));
#endif
    return value;
}

HYI_INLINE HYI_SSE42 float hyi_greatest4_sse42(__m128 a) {
    __m128 two = _mm_max_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps(two, two, 1)));
}

HYI_INLINE HYI_SSE42 float hyi_least4_sse42(__m128 a) {
    __m128 two = _mm_min_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_min_ss(two, _mm_shuffle_ps(two, two, 1)));
}

#define HYI_TARGET HYI_SSE42
#define HYI_I(name) name##_sse42
#define HYI_F4 __m128
#define HYI_M4 __m128
#define HYI_LOAD4(p) _mm_loadu_ps(p)
#define HYI_LOAD4_ALIGNED(p) _mm_load_ps(p)
#define HYI_STORE4(p, a) _mm_storeu_ps(p, a)
#define HYI_SET4(value) _mm_set1_ps(value)
#define HYI_ADD4(a, b) _mm_add_ps(a, b)
#define HYI_SUB4(a, b) _mm_sub_ps(a, b)
#define HYI_MUL4(a, b) _mm_mul_ps(a, b)
#define HYI_DIV4(a, b) _mm_div_ps(a, b)
#define HYI_MAD4(a, b, c) _mm_add_ps(_mm_mul_ps(a, b), c)
#define HYI_MIN4(a, b) _mm_min_ps(a, b)
#define HYI_MAX4(a, b) _mm_max_ps(a, b)
#define HYI_LT4(a, b) _mm_cmplt_ps(a, b)
#define HYI_LE4(a, b) _mm_cmple_ps(a, b)
#define HYI_AND4(a, b) _mm_and_ps(a, b)
#define HYI_OR4(a, b) _mm_or_ps(a, b)
#define HYI_CHOOSE4(m, a, b) _mm_blendv_ps(b, a, m)
#define HYI_BITS4_4(low, high) ((uint32_t)_mm_movemask_ps(low) | (uint32_t)_mm_movemask_ps(high) << 4)
#define HYI_PIN4(a) hyi_pin4_sse42(a)
#define HYI_GREATEST4(a) hyi_greatest4_sse42(a)
#define HYI_LEAST4(a) hyi_least4_sse42(a)
#define HYI_D2 __m128d
#define HYI_SET2(value) _mm_set1_pd(value)
#define HYI_LOAD2(p) _mm_loadu_pd(p)
#define HYI_STORE2(p, a) _mm_storeu_pd(p, a)
#define HYI_LOW_AS_DOUBLES(a) _mm_cvtps_pd(a)
#define HYI_HIGH_AS_DOUBLES(a) _mm_cvtps_pd(_mm_movehl_ps(a, a))
#define HYI_AS_FLOATS(low, high) _mm_movelh_ps(_mm_cvtpd_ps(low), _mm_cvtpd_ps(high))
#define HYI_ADD2(a, b) _mm_add_pd(a, b)
#define HYI_SUB2(a, b) _mm_sub_pd(a, b)
#define HYI_MUL2(a, b) _mm_mul_pd(a, b)
#define HYI_DIV2(a, b) _mm_div_pd(a, b)
#define HYI_MIN2(a, b) _mm_min_pd(a, b)
#define HYI_MAX2(a, b) _mm_max_pd(a, b)
#define HYI_LT2(a, b) _mm_cmplt_pd(a, b)
#define HYI_BITS2_2(low, high) ((uint32_t)_mm_movemask_pd(low) | (uint32_t)_mm_movemask_pd(high) << 2)
#define HYI_PIN2(a) hyi_pin2_sse42(a)
/* ---- eight lanes as two times four (expanded once for each instruction set whose vectors have four, in its words
   for four floats and two doubles) */

typedef struct HYI_I(hyi_f8) {
    HYI_F4 low, high;
} HYI_I(hyi_f8);

typedef struct HYI_I(hyi_m8) {
    HYI_M4 low, high;
} HYI_I(hyi_m8);

typedef struct HYI_I(hyi_d4) {
    HYI_D2 low, high;
} HYI_I(hyi_d4);

#define HYI_PAIR(name, result, type, word)                                                        \
    HYI_INLINE HYI_TARGET HYI_I(hyi_##result) HYI_I(hyi_##name)(HYI_I(hyi_##type) a, HYI_I(hyi_##type) b) { \
        HYI_I(hyi_##result) r;                                                                    \
        r.low = word(a.low, b.low);                                                               \
        r.high = word(a.high, b.high);                                                            \
        return r;                                                                                 \
    }
HYI_PAIR(add8, f8, f8, HYI_ADD4)
HYI_PAIR(sub8, f8, f8, HYI_SUB4)
HYI_PAIR(mul8, f8, f8, HYI_MUL4)
HYI_PAIR(div8, f8, f8, HYI_DIV4)
HYI_PAIR(min8, f8, f8, HYI_MIN4)
HYI_PAIR(max8, f8, f8, HYI_MAX4)
HYI_PAIR(lt8, m8, f8, HYI_LT4)
HYI_PAIR(le8, m8, f8, HYI_LE4)
HYI_PAIR(and8, m8, m8, HYI_AND4)
HYI_PAIR(or8, m8, m8, HYI_OR4)
HYI_PAIR(add_doubles, d4, d4, HYI_ADD2)
HYI_PAIR(sub_doubles, d4, d4, HYI_SUB2)
HYI_PAIR(mul_doubles, d4, d4, HYI_MUL2)
HYI_PAIR(div_doubles, d4, d4, HYI_DIV2)
HYI_PAIR(min_doubles, d4, d4, HYI_MIN2)
HYI_PAIR(max_doubles, d4, d4, HYI_MAX2)
#undef HYI_PAIR

/* ---- floats */

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_set8)(float value) {
    HYI_I(hyi_f8) r;
    r.low = r.high = HYI_SET4(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load8)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4(p);
    r.high = HYI_LOAD4(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load_plane)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4_ALIGNED(p);
    r.high = HYI_LOAD4_ALIGNED(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store8)(float *p, HYI_I(hyi_f8) a) {
    HYI_STORE4(p, a.low);
    HYI_STORE4(p + 4, a.high);
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_mad8)(HYI_I(hyi_f8) a, HYI_I(hyi_f8) b, HYI_I(hyi_f8) c) {
    HYI_I(hyi_f8) r;
    r.low = HYI_MAD4(a.low, b.low, c.low);
    r.high = HYI_MAD4(a.high, b.high, c.high);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_pin8)(HYI_I(hyi_f8) a) {
    a.low = HYI_PIN4(a.low);
    a.high = HYI_PIN4(a.high);
    return a;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_min8_where)(HYI_I(hyi_f8) a, HYI_I(hyi_m8) m, HYI_I(hyi_f8) b) {
    a.low = HYI_CHOOSE4(m.low, HYI_MIN4(a.low, b.low), a.low);
    a.high = HYI_CHOOSE4(m.high, HYI_MIN4(a.high, b.high), a.high);
    return a;
}

/* ---- doubles: four, in one half of a packet */

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_set_doubles)(double value) {
    HYI_I(hyi_d4) r;
    r.low = r.high = HYI_SET2(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_half_as_doubles)(HYI_I(hyi_f8) a, int half) {
    HYI_F4 four = half ? a.high : a.low;
    HYI_I(hyi_d4) r;
    r.low = HYI_LOW_AS_DOUBLES(four);
    r.high = HYI_HIGH_AS_DOUBLES(four);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_load_doubles)(const double *p) {
    HYI_I(hyi_d4) r;
    r.low = HYI_LOAD2(p);
    r.high = HYI_LOAD2(p + 2);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_doubles)(double *p, HYI_I(hyi_d4) a) {
    HYI_STORE2(p, a.low);
    HYI_STORE2(p + 2, a.high);
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_half)(float *p, int half, HYI_I(hyi_d4) a) {
    HYI_STORE4(p + 4 * half, HYI_AS_FLOATS(a.low, a.high));
}

HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_lt_doubles)(HYI_I(hyi_d4) a, HYI_I(hyi_d4) b) {
    return HYI_BITS2_2(HYI_LT2(a.low, b.low), HYI_LT2(a.high, b.high));
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_pin_doubles)(HYI_I(hyi_d4) a) {
    a.low = HYI_PIN2(a.low);
    a.high = HYI_PIN2(a.high);
    return a;
}

/* ---- lists */

/* Appends eight items to the lists of the children that their masks name. By bits: permutations from a table were slower. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal_out)(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    for (uint32_t i = 0; i < 8u; i++) {
        for (uint32_t takers = masks->bytes[i]; takers; takers &= takers - 1u) {
            uint32_t c = hyi_lowest_bit(takers);
            lists[(size_t)c * stride + dealt[c]++] = items[i];
        }
    }
}

#define HYI_F8 HYI_I(hyi_f8)
#define HYI_ALWAYS_EXACT 0
#define HYI_M8 HYI_I(hyi_m8)
#define HYI_LOAD8(p) HYI_I(hyi_load_plane)(p)
#define HYI_LOADU8(p) HYI_I(hyi_load8)(p)
#define HYI_STORE8(p, a) HYI_I(hyi_store8)(p, a)
#define HYI_SET8(value) HYI_I(hyi_set8)(value)
#define HYI_ZERO8() HYI_I(hyi_set8)(0.0f)
#define HYI_ADD8(a, b) HYI_I(hyi_add8)(a, b)
#define HYI_SUB8(a, b) HYI_I(hyi_sub8)(a, b)
#define HYI_MUL8(a, b) HYI_I(hyi_mul8)(a, b)
#define HYI_DIV8(a, b) HYI_I(hyi_div8)(a, b)
#define HYI_MAD8(a, b, c) HYI_I(hyi_mad8)(a, b, c)
#define HYI_MIN8(a, b) HYI_I(hyi_min8)(a, b)
#define HYI_MAX8(a, b) HYI_I(hyi_max8)(a, b)
#define HYI_LT8(a, b) HYI_I(hyi_lt8)(a, b)
#define HYI_LE8(a, b) HYI_I(hyi_le8)(a, b)
#define HYI_AND8(a, b) HYI_I(hyi_and8)(a, b)
#define HYI_OR8(a, b) HYI_I(hyi_or8)(a, b)
#define HYI_BITS8(m) HYI_BITS4_4((m).low, (m).high)
#define HYI_MIN8_WHERE(a, m, b) HYI_I(hyi_min8_where)(a, m, b)
#define HYI_PIN8(a) HYI_I(hyi_pin8)(a)
#define HYI_LINES(rows, lines) hyi_lines(rows, lines, 8u)
#define HYI_LANES 8u
#define HYI_ALLW 0xffu
#define HYI_FW HYI_F8
#define HYI_MW HYI_M8
#define HYI_LOADW(p) HYI_LOADU8(p)
#define HYI_STOREW(p, a) HYI_STORE8(p, a)
#define HYI_SETW(value) HYI_SET8(value)
#define HYI_ZEROW() HYI_ZERO8()
#define HYI_ADDW(a, b) HYI_ADD8(a, b)
#define HYI_SUBW(a, b) HYI_SUB8(a, b)
#define HYI_MULW(a, b) HYI_MUL8(a, b)
#define HYI_DIVW(a, b) HYI_DIV8(a, b)
#define HYI_MINW(a, b) HYI_MIN8(a, b)
#define HYI_MAXW(a, b) HYI_MAX8(a, b)
#define HYI_LTW(a, b) HYI_LT8(a, b)
#define HYI_LEW(a, b) HYI_LE8(a, b)
#define HYI_ANDW(a, b) HYI_AND8(a, b)
#define HYI_ORW(a, b) HYI_OR8(a, b)
#define HYI_BITSW(m) HYI_BITS8(m)
#define HYI_PINW(a) HYI_PIN8(a)
#define HYI_GREATESTW(a) HYI_GREATEST4(HYI_MAX4((a).low, (a).high))
#define HYI_LEASTW(a) HYI_LEAST4(HYI_MIN4((a).low, (a).high))
#define HYI_DEAL 8u
#define HYI_MASKS hyi_masks8
#define HYI_CLEAR_MASKS(masks) ((masks).all = 0)
#define HYI_FD HYI_I(hyi_d4)
#define HYI_SETD(value) HYI_I(hyi_set_doubles)(value)
#define HYI_HALFD(a, half) HYI_I(hyi_half_as_doubles)(a, half)
#define HYI_LOADD(p) HYI_I(hyi_load_doubles)(p)
#define HYI_STORED(p, a) HYI_I(hyi_store_doubles)(p, a)
#define HYI_STOREH(p, half, a) HYI_I(hyi_store_half)(p, half, a)
#define HYI_ADDD(a, b) HYI_I(hyi_add_doubles)(a, b)
#define HYI_SUBD(a, b) HYI_I(hyi_sub_doubles)(a, b)
#define HYI_MULD(a, b) HYI_I(hyi_mul_doubles)(a, b)
#define HYI_DIVD(a, b) HYI_I(hyi_div_doubles)(a, b)
#define HYI_MIND(a, b) HYI_I(hyi_min_doubles)(a, b)
#define HYI_MAXD(a, b) HYI_I(hyi_max_doubles)(a, b)
#define HYI_LTD(a, b) HYI_I(hyi_lt_doubles)(a, b)
#define HYI_PIND(a) HYI_I(hyi_pin_doubles)(a)
/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_size)(HYI_F8 v) { return HYI_MAX8(v, HYI_SUB8(HYI_ZERO8(), v)); }

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t by their share in the sum, of the difference between t at the corners;
   rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise could have made says nothing. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const hyi_aim *aim, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), along = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_I(hyi_size)(sum);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAX8(across, HYI_MAX8(HYI_I(hyi_size)(k[i].x), HYI_I(hyi_size)(k[i].y)));
        along = HYI_MAX8(along, HYI_I(hyi_size)(k[i].z));
    }
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 farthest = HYI_MAX8(HYI_I(hyi_size)(first), HYI_I(hyi_size)(last));
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_I(hyi_size)(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MAX8(HYI_MUL8(HYI_SET8(4.0f), noise), HYI_SET8(HYI_EDGE_LEAST)), size));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(aim->t_near)), HYI_LT8(HYI_SET8(aim->t_far), least)));
    float from = aim->t_near + 16.0f * HYI_ULP * fabsf(aim->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. exact: nothing is certain. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_verdicts) verdicts;
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(aim, rows + 3u * i * count, count);
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(aim->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(aim->t_far), first), HYI_LT8(last, HYI_SET8(aim->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (verdicts.possible && !exact)
        HYI_I(hyi_judge_triangles)(aim, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.unit != 1.0, found = false;
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts.certain >> lane & 1u) {
            if (verdicts.least[lane] > flight->aim.t_far) continue;
            found = hyi_expect(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane]) || found;
        } else {
            found = hyi_offer(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) {
                hyi_settle(site, flight);
                return;
            }
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which the rays of a swarm meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

/* Eight boxes against the bounds of a packet: no ray of it enters earlier than enter, or leaves later. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes_all)(const hyi_packet *p, const HYI_I(hyi_planes) *planes, HYI_F8 *enter) {
    HYI_F8 first = HYI_SET8(p->first_t), last = HYI_SET8(p->last_t);
    for (int a = 0; a < 3; a++) {
        HYI_F8 low = HYI_SET8(p->inverse_low[a]), high = HYI_SET8(p->inverse_high[a]);
        HYI_F8 to_near = HYI_SUB8(planes->near_planes[a], HYI_SET8(p->near_origin[a]));
        HYI_F8 to_far = HYI_SUB8(planes->far_planes[a], HYI_SET8(p->far_origin[a]));
        first = HYI_MAX8(first, HYI_MIN8(HYI_MUL8(to_near, low), HYI_MUL8(to_near, high)));
        last = HYI_MIN8(last, HYI_MAX8(HYI_MUL8(to_far, low), HYI_MUL8(to_far, high)));
    }
    *enter = first;
    return HYI_LE8(first, last);
}

/* Whether any ray of a packet meets the box of child c. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int k = 0; k < 3; k++) {
        uint32_t a = swarm->axis[k], near_row = swarm->near_plane[a];
        float slack = (near_row & 1u) ? p->bound[a] : -p->bound[a];
        HYI_FW origin = HYI_LOADW(p->origin[k]), inverse = HYI_LOADW(p->inverse[k]);
        first = HYI_MAXW(first, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row][c] + slack), origin), inverse));
        last = HYI_MINW(last, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row ^ 1u][c] - slack), origin), inverse));
    }
    return HYI_BITSW(HYI_LEW(first, last)) != 0u;
}

/* Of the children in mask, those whose box some ray of a packet meets. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_boxes_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t mask) {
    uint32_t met = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        met &= ~((HYI_I(hyi_meet_box_each)(swarm, p, node, c) ? 0u : 1u) << c);
    }
    return met;
}

/* ---- triangles */

/* A corner in the sheared frames of the rays of a packet. */
typedef struct HYI_I(hyi_corner_all) {
    HYI_FW x, y, z;
} HYI_I(hyi_corner_all);

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[2] * stride]), HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[0] * stride]), HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[1] * stride]), HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

/* Which rays certainly miss one triangle: the same test as of one ray and eight triangles. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_miss_triangle_all)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3]) {
    HYI_I(hyi_corner_all) p = corners[0], q = corners[1], r = corners[2];
    HYI_FW a = HYI_I(hyi_cross_all)(r, q), b = HYI_I(hyi_cross_all)(p, r), c = HYI_I(hyi_cross_all)(q, p);
    HYI_MW below = HYI_LTW(HYI_MINW(HYI_MINW(a, b), c), HYI_ZEROW());
    HYI_MW above = HYI_LTW(HYI_ZEROW(), HYI_MAXW(HYI_MAXW(a, b), c));
    HYI_FW scale = HYI_LOADW(packet->inverse_z);
    HYI_FW ta = HYI_MULW(p.z, scale), tb = HYI_MULW(q.z, scale), tc = HYI_MULW(r.z, scale);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), HYI_MINW(HYI_MINW(ta, tb), tc));
    HYI_MW early = HYI_LTW(HYI_MAXW(HYI_MAXW(ta, tb), tc), HYI_LOADW(packet->t_near));
    return HYI_ORW(HYI_ANDW(below, above), HYI_ORW(late, early));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_size_all)(HYI_FW v) { return HYI_MAXW(v, HYI_SUBW(HYI_ZEROW(), v)); }

/* Of one triangle that rays may hit but those in out, where any hit does: stops the rays that certainly hit it; left: the
   others, without those that turn out to miss it. hyi_judge_triangles, for all rays. Returns whether it stopped any. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_stop_certain)(const hyi_swarm *swarm, hyi_packet *packet, const HYI_I(hyi_corner_all) k[3], HYI_MW out, uint32_t *left) {
    HYI_FW zero = HYI_ZEROW(), scale = HYI_LOADW(packet->inverse_z), t_near = HYI_LOADW(packet->t_near), t_far = HYI_LOADW(packet->t_far);
    HYI_FW a = HYI_I(hyi_cross_all)(k[2], k[1]), b = HYI_I(hyi_cross_all)(k[0], k[2]), c = HYI_I(hyi_cross_all)(k[1], k[0]);
    HYI_FW sum = HYI_ADDW(HYI_ADDW(a, b), c), across = zero, along = zero;
    HYI_FW ta = HYI_MULW(k[0].z, scale), tb = HYI_MULW(k[1].z, scale), tc = HYI_MULW(k[2].z, scale);
    HYI_FW first = HYI_MINW(HYI_MINW(ta, tb), tc), last = HYI_MAXW(HYI_MAXW(ta, tb), tc);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAXW(across, HYI_MAXW(HYI_I(hyi_size_all)(k[i].x), HYI_I(hyi_size_all)(k[i].y)));
        along = HYI_MAXW(along, HYI_I(hyi_size_all)(k[i].z));
    }
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(a, ta), HYI_MULW(b, tb)), HYI_MULW(c, tc)), inverse);
    HYI_FW farthest = HYI_MAXW(HYI_I(hyi_size_all)(first), HYI_I(hyi_size_all)(last));
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(last, first), noise), HYI_I(hyi_size_all)(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    HYI_FW least = HYI_SUBW(mean, error), most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, HYI_MINW(HYI_MINW(a, b), c)), HYI_LTW(HYI_MAXW(HYI_MAXW(a, b), c), zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MAXW(HYI_MULW(HYI_SETW(4.0f), noise), HYI_SETW(HYI_EDGE_LEAST)), HYI_I(hyi_size_all)(sum)));
    HYI_MW missed = HYI_ANDW(known, HYI_ORW(HYI_LTW(most, t_near), HYI_LTW(t_far, least)));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_I(hyi_size_all)(t_near)));
    HYI_MW hit = HYI_ANDW(HYI_ANDW(known, HYI_LEW(from, least)), HYI_LTW(most, HYI_LOADW(packet->best_t)));
    uint32_t stopped = HYI_BITSW(hit) & ~HYI_BITSW(out);
    *left = HYI_ALLW & ~(stopped | HYI_BITSW(HYI_ORW(out, missed)));
    if (stopped == 0) return false;
    for (uint32_t some = stopped; some; some &= some - 1u) {
        packet->t_far[hyi_lowest_bit(some)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(some)] = swarm->site.instance;
    }
    return true;
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const double n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(HYI_SETD(n[0]), v[0])), second = HYI_PIND(HYI_MULD(HYI_SETD(n[1]), v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(HYI_SETD(n[2]), v[2]))));
}

/* What hyi_confirm works out, for half of a packet: t and the edge functions; the bits of those that are hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3], const double corner[3],
                                                       const double n[3], const double z[3], int half, double t[8], double weights[3][8]) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_HALFD(corners[i].x, half);
        y[i] = HYI_HALFD(corners[i].y, half);
        to_corner[i] = HYI_PIND(HYI_SUBD(HYI_SETD(corner[i]), HYI_HALFD(HYI_LOADW(packet->origin[i]), half)));
        direction[i] = HYI_HALFD(HYI_LOADW(packet->direction[i]), half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(n, direction);
    HYI_FD plane = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD least = HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), most = least;
    for (int i = 1; i < 3; i++) {
        HYI_FD to = HYI_PIND(HYI_SUBD(HYI_SETD(z[i]), HYI_HALFD(HYI_LOADW(packet->origin[2]), half)));
        HYI_FD at = HYI_PIND(HYI_MULD(to, t_by_z));
        least = HYI_MIND(least, at);
        most = HYI_MAXD(most, at);
    }
    HYI_STORED(t, HYI_MIND(HYI_MAXD(plane, least), most));
    HYI_STORED(weights[0], b);
    HYI_STORED(weights[1], c);
    HYI_STORED(weights[2], sum);
    return ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
}

/* The plane of a triangle as hyi_plane_distance works it out: a corner and the normal. */
HYI_INLINE void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, double corner[3], double n[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        corner[i] = (double)row[0];
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner[i]);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner[i]);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t primitive, float t, const double weights[3]) {
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        double inverse = hyi_rounded_double(1.0 / weights[2]);
        if (hyi_lets_pass(&swarm->site, ray, primitive, (float)(weights[0] * inverse), (float)(weights[1] * inverse))) return false;
    }
    packet->best_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    for (int i = 0; i < 3; i++) packet->weights[i][lane] = weights[i];
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number t of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], uint32_t mask) {
    double corner[3], n[3], z[3];
    for (uint32_t k = 0; k < 3; k++) z[k] = (double)hyi_leaf_rows(swarm->site.bvh, leaf)[(3u * k + swarm->axis[2]) * hyi_leaf_count(leaf) + triangle];
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    bool found = false;
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), corner, n);
    for (int half = 0; half < 2; half++) {
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        double t[8], weights[3][8];
        if (some) some &= HYI_I(hyi_confirm_half)(packet, corners, corner, n, z, half, t, weights);
        for (; some; some &= some - 1u) {
            uint32_t lane = hyi_lowest_bit(some);
            const double w[3] = {weights[0][lane], weights[1][lane], weights[2][lane]};
            if ((float)t[lane] <= packet->best_t[base + lane] && HYI_I(hyi_take_hit)(swarm, packet, base + lane, primitive, (float)t[lane], w)) found = true;
        }
    }
    return found;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * triangles + triangle, triangles);
}

/* Offers triangle number t of a leaf to all rays but those in out, which miss it. Returns whether one of them hits it. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], HYI_MW out) {
    uint32_t left = ~HYI_BITSW(out) & HYI_ALLW;
    bool found = left && swarm->any && !swarm->site.asks_alpha && HYI_I(hyi_stop_certain)(swarm, packet, corners, out, &left);
    if (left && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, corners, left)) found = true;
    return found;
}

/* node, c: where the leaf hangs; NULL: nowhere. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count,
                                                    const hyi_node *node, uint32_t c) {
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        hyi_packet *packet = &swarm->packets[list[i]];
        bool found = false;
        if (packet->last_t < packet->first_t || (node && !HYI_I(hyi_meet_box_each)(swarm, packet, node, c))) continue;
        for (uint32_t t = 0; t < triangles; t++) {
            HYI_I(hyi_corner_all) corners[3];
            HYI_I(hyi_shear_triangle)(swarm, packet, leaf, t, corners);
            if (HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, corners, HYI_I(hyi_miss_triangle_all)(packet, corners))) found = true;
        }
        if (found) packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    }
}

/* ---- making packets */

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        if (!(HYI_GREATESTW(shear) - HYI_LEASTW(shear) <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        low[a] = HYI_LEASTW(HYI_LOADW(o[a]));
        high[a] = HYI_GREATESTW(HYI_LOADW(o[a]));
        extent = box->upper[a] - box->lower[a] > extent ? box->upper[a] - box->lower[a] : extent;
    }
    float below = hyi_reach(box, low[axis], (int)axis, false), above = hyi_reach(box, high[axis], (int)axis, false);
    z = below > above ? below : above;
    for (int a = 0; a < 3; a++) {
        if (!(high[a] - low[a] <= HYI_PACKET_ORIGINS * extent)) return false;
        if (high[a] > low[a]) packet->spread = 1;
        float from_low = hyi_reach(box, low[a], a, false), from_high = hyi_reach(box, high[a], a, false);
        float size = fabsf(low[a]) > fabsf(high[a]) ? fabsf(low[a]) : fabsf(high[a]);
        float bound = hyi_slab_bound(from_low > from_high ? from_low : from_high, z, size);
        bool falls = (packet->group >> a & 1u) != 0u;
        packet->bound[a] = bound;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a == (int)axis ? 2 : (a + 3 - (int)axis) % 3 - 1], HYI_LOADW(inverse[a]));
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* Whether |v| <= limit in all lanes; what is not a number is not. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_all_within)(const float *v, float limit) {
    HYI_FW size = HYI_MAXW(HYI_LOADW(v), HYI_SUBW(HYI_ZEROW(), HYI_LOADW(v)));
    return HYI_BITSW(HYI_LEW(size, HYI_SETW(limit))) == HYI_ALLW;
}

/* What directions have in common: see hyi_aim_group; false: they differ in that, or in size by far. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_group)(float d[3][HYI_PACKET_WIDTH], uint32_t *group) {
    HYI_FW zero = HYI_ZEROW(), size[3];
    *group = 0;
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        uint32_t falls = HYI_BITSW(HYI_LTW(v, zero));
        if ((falls != 0u && falls != HYI_ALLW) || !HYI_I(hyi_all_within)(d[a], 1073741824.0f)) return false;
        *group |= (falls ? 1u : 0u) << a;
        size[a] = HYI_MAXW(v, HYI_SUBW(zero, v));
    }
    uint32_t y = HYI_BITSW(HYI_LTW(size[0], size[1])), z = HYI_BITSW(HYI_LTW(HYI_MAXW(size[0], size[1]), size[2]));
    if ((z != 0u && z != HYI_ALLW) || (z == 0u && y != 0u && y != HYI_ALLW)) return false;
    HYI_FW largest = HYI_MAXW(HYI_MAXW(size[0], size[1]), size[2]);
    *group |= (z ? 2u : y ? 1u : 0u) << 3;
    return HYI_LEASTW(largest) >= 9.31322574615478515625e-10f;
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_HALFD(HYI_LOADW(packet->direction[2]), half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_HALFD(HYI_LOADW(packet->direction[i]), half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common of HYI_LANES rays, by their numbers; false: they are of several groups, unsound,
   or of uncommon size. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_rays)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_packet *packet,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float d[3][HYI_PACKET_WIDTH], scale = bvh->scale;
    uint32_t axis[3];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyk_ray ray = hyi_load_ray(&rays[numbers[i]]);
        o[0][i] = ray.origin.x * scale;
        o[1][i] = ray.origin.y * scale;
        o[2][i] = ray.origin.z * scale;
        d[0][i] = ray.direction.x * scale;
        d[1][i] = ray.direction.y * scale;
        d[2][i] = ray.direction.z * scale;
        packet->t_min[i] = ray.t_min;
        packet->best_t[i] = ray.t_max;
    }
    if (!HYI_I(hyi_find_group)(d, &packet->group)) return false;
    HYI_FW t_min = HYI_LOADW(packet->t_min), t_max = HYI_LOADW(packet->best_t), limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT)), zero = HYI_ZEROW();
    bool limits = HYI_BITSW(HYI_LEW(t_min, limit)) == HYI_ALLW && HYI_BITSW(HYI_LEW(t_min, t_max)) == HYI_ALLW;
    if (!limits || !HYI_I(hyi_all_within)(packet->t_min, FLT_MAX)) return false;
    hyi_group_axes(packet->group, axis);
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        if (!HYI_I(hyi_all_within)(o[a], 1099511627776.0f)) return false;
        v = HYI_MAXW(HYI_MAXW(v, HYI_SUBW(zero, v)), HYI_SETW(HYI_STEADY));
        HYI_STOREW(inverse[a], HYI_DIVW(HYI_SETW(packet->group >> a & 1u ? -1.0f : 1.0f), v));
        HYI_STOREW(packet->origin[a], HYI_LOADW(o[axis[a]]));
        HYI_STOREW(packet->direction[a], HYI_LOADW(d[axis[a]]));
    }
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    HYI_STOREW(packet->best_t, limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(t_min, HYI_MULW(HYI_MAXW(t_min, HYI_SUBW(zero, t_min)), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(limit, HYI_MULW(HYI_MAXW(limit, HYI_SUBW(zero, limit)), slack)));
    HYI_I(hyi_shear_packet)(packet);
    return true;
}

/* A packet of rays first, first + 1, ... of the swarm's; false: they are not alike, or not fit for one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t first) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
    }
    packet->count = HYI_LANES;
    return HYI_I(hyi_load_rays)(swarm->site.bvh, swarm->rays, packet->ray, packet, o, inverse) &&
           HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_box *box, uint32_t group, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH]) {
    HYI_FW reach[3], zero = HYI_ZEROW();
    for (int a = 0; a < 3; a++) {
        HYI_FW below = HYI_SUBW(HYI_LOADW(o[a]), HYI_SETW(box->lower[a])), above = HYI_SUBW(HYI_SETW(box->upper[a]), HYI_LOADW(o[a]));
        reach[a] = HYI_MAXW(HYI_MAXW(below, HYI_SUBW(zero, below)), HYI_MAXW(above, HYI_SUBW(zero, above)));
    }
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(o[a]), size = HYI_MAXW(v, HYI_SUBW(zero, v)), back = HYI_SUBW(zero, HYI_LOADW(inverse[a]));
        HYI_FW bound = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], reach[group >> 3])), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), size));
        bound = (group >> a & 1u) ? HYI_SUBW(zero, bound) : bound;
        HYI_STOREW(near_offset[a], HYI_MULW(HYI_ADDW(v, bound), back));
        HYI_STOREW(far_offset[a], HYI_MULW(HYI_SUBW(v, bound), back));
    }
}

/* Flights of HYI_LANES rays by their numbers; false: they must be begun one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_begin_flights)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_flight *flights) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    uint32_t plane[3][HYI_PACKET_WIDTH], axes[3][HYI_PACKET_WIDTH], none[HYI_PACKET_WIDTH] = {0}, axis[3];
    hyi_packet p;
    if (!HYI_I(hyi_load_rays)(bvh, rays, numbers, &p, o, inverse)) return false;
    HYI_I(hyi_offset_lanes)(&bvh->scaled, p.group, o, inverse, near_offset, far_offset);
    hyi_group_axes(p.group, axis);
    for (uint32_t a = 0; a < 3; a++) {
        for (uint32_t i = 0; i < HYI_LANES; i++) {
            plane[a][i] = 2u * a + (p.group >> a & 1u);
            axes[a][i] = axis[a];
        }
    }
    const void *boxes[16] = {inverse[0], inverse[1], inverse[2], near_offset[0], near_offset[1], near_offset[2], far_offset[0], far_offset[1], far_offset[2],
                             p.t_near, p.t_far, plane[0], plane[1], plane[2], p.inverse_z, p.best_t};
    const void *triangles[16] = {p.origin[0], p.origin[1], p.origin[2], p.shear[0], p.shear[1], axes[0], axes[1], axes[2],
                                 p.direction[0], p.direction[1], p.direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.inverse));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        flight->aim.t_by_z = p.t_by_z[i];
        flight->aim.unit = flight->aim.inverse_unit = 1.0;
        flight->best.t = p.best_t[i];
        flight->best.u = flight->best.v = 0.0f;
        flight->best.instance = flight->best.primitive = HYK_NONE;
        flight->t_min = p.t_min[i];
        flight->ray = &rays[numbers[i]];
    }
    return true;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, hyk_hit *hits, uint8_t *occluded) {
    for (uint32_t i = 0; i < packet->count; i++) {
        bool found = packet->instance[i] != HYK_NONE;
        if (occluded) {
            occluded[packet->ray[i]] = found ? 1 : 0;
            continue;
        }
        hyk_hit *hit = &hits[packet->ray[i]];
        double inverse = found ? hyi_rounded_double(1.0 / packet->weights[2][i]) : 0.0;
        hit->t = found ? packet->best_t[i] : -1.0f;
        hit->u = found ? (float)(packet->weights[0][i] * inverse) : 0.0f;
        hit->v = found ? (float)(packet->weights[1][i] * inverse) : 0.0f;
        hit->instance = packet->instance[i];
        hit->primitive = packet->primitive[i];
        hyi_locate_in_world(swarm->site.accel, &hit->instance, &hit->primitive);
    }
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->unit != 1.0) return false;
        for (int a = 0; a < 3; a++) {
            o[aim->axis[a]][i] = packet->origin[a][i] = aim->origin[a];
            packet->direction[a][i] = aim->direction[a];
            inverse[a][i] = aim->inverse[a];
        }
        packet->shear[0][i] = aim->shear[0];
        packet->shear[1][i] = aim->shear[1];
        packet->inverse_z[i] = aim->inverse_z;
        packet->t_by_z[i] = aim->t_by_z;
        packet->t_min[i] = flight->t_min;
        packet->t_near[i] = aim->t_near;
        packet->t_far[i] = i < count ? aim->t_far : -FLT_MAX;
        packet->best_t[i] = flight->best.t;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->weights[2][i] = 0.0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->count = count;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* Sum 0 stands for a hit that is not the packet's own. */
HYI_INLINE void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    for (uint32_t i = 0; i < packet->count; i++) {
        hyi_best *best = &swarm->flights[packet->ray[i]].best;
        best->instance = packet->instance[i];
        if (packet->weights[2][i] == 0.0) continue;
        double inverse = hyi_rounded_double(1.0 / packet->weights[2][i]);
        best->t = packet->best_t[i];
        best->u = (float)(packet->weights[0][i] * inverse);
        best->v = (float)(packet->weights[1][i] * inverse);
        best->primitive = packet->primitive[i];
    }
}
/* ---- many rays (expanded once for each instruction set)

   Lists hold numbers of flights, or of packets. Each list of a node's children has room for all of the node's. */

HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets);
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count);

/* Keeps of a list the rays that have not met anything nearer than the box of child c since they were put on it; returns
   how many these are. Without a branch: it would be taken by chance. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_still_meet)(const hyi_swarm *swarm, const hyi_node *node, uint32_t c, uint32_t *list, uint32_t count) {
    float x = node->planes[swarm->near_plane[0]][c], y = node->planes[swarm->near_plane[1]][c], z = node->planes[swarm->near_plane[2]][c];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t ray = list[i];
        const hyi_aim *aim = &swarm->flights[ray].aim;
        float tx = x * aim->inverse[0] + aim->near_offset[0], ty = y * aim->inverse[1] + aim->near_offset[1], tz = z * aim->inverse[2] + aim->near_offset[2];
        float enter = tx > ty ? tx : ty;
        enter = tz > enter ? tz : enter;
        list[kept] = ray;
        kept += enter <= aim->t_far ? 1u : 0u;
    }
    return kept;
}

/* Puts each of count items on the lists of the children that it meets; nearest: the least t at which each child is entered. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                           uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH], bool packets) {
    HYI_I(hyi_planes) planes;
    HYI_F8 least = HYI_SET8(FLT_MAX);
    for (int a = 0; a < 3; a++) {
        planes.near_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a]]);
        planes.far_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a] ^ 1u]);
    }
    for (uint32_t first = 0; first < count; first += HYI_DEAL) {
        uint32_t some = count - first < HYI_DEAL ? count - first : HYI_DEAL;
        HYI_MASKS masks;
        HYI_CLEAR_MASKS(masks);
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            uint32_t item = list[first + i];
            HYI_M8 mask = packets ? HYI_I(hyi_meet_boxes_all)(&swarm->packets[item], &planes, &enter)
                                  : HYI_I(hyi_meet_boxes)(&swarm->flights[item].aim, planes.near_planes, planes.far_planes, &enter);
            least = HYI_MIN8_WHERE(least, mask, enter);
            uint32_t met = HYI_BITS8(mask);
            if (packets && swarm->packets[item].spread && hyi_count_bits(met) > 2u) met = HYI_I(hyi_meet_boxes_each)(swarm, &swarm->packets[item], node, met);
            masks.bytes[i] = (uint8_t)met;
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
}

/* Orders all children by t, nearest first, without a branch: a child comes after as many as are nearer, or as near with a
   smaller number. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_order_children)(const float t[HYI_WIDTH], uint32_t order[HYI_WIDTH]) {
    HYI_F8 all = HYI_LOADU8(t);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        HYI_F8 one = HYI_SET8(t[c]);
        order[hyi_count_bits(HYI_BITS8(HYI_LT8(all, one)) | (HYI_BITS8(HYI_LE8(all, one)) & ((1u << c) - 1u)))] = c;
    }
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_node)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    const hyi_node *node = &swarm->site.bvh->nodes[at];
    uint32_t stride = (count + 15u) & ~15u, dealt[HYI_WIDTH] = {0}, order[HYI_WIDTH], mask = 0;
    float nearest[HYI_WIDTH];
    HYI_I(hyi_deal)(swarm, node, list, count, space, stride, dealt, nearest, packets);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        mask |= (dealt[c] ? 1u : 0u) << c;
        nearest[c] = dealt[c] ? nearest[c] : FLT_MAX; /* met by the bounds of a packet, but by none of its rays */
    }
    if (swarm->site.bvh->rows)
        for (uint32_t left = mask; left; left &= left - 1u) hyi_prefetch_child(swarm->site.bvh, node->child[hyi_lowest_bit(left)]);
    HYI_I(hyi_order_children)(nearest, order);
    uint32_t children = hyi_count_bits(mask);
    for (uint32_t i = 0; i < children; i++) {
        uint32_t c = order[i];
        bool leaf = swarm->site.bvh->rows && hyi_child_is_leaf(node->child[c]);
        if (leaf && packets) HYI_I(hyi_list_leaf_packets)(swarm, node->child[c], space + c * stride, dealt[c], node, c);
        else if (leaf) HYI_I(hyi_list_leaf_rays)(swarm, node->child[c], space + c * stride, HYI_I(hyi_still_meet)(swarm, node, c, space + c * stride, dealt[c]));
        else HYI_I(hyi_list_visit)(swarm, node->child[c], space + c * stride, dealt[c], space + HYI_WIDTH * stride, packets);
    }
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_rays)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, false);
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, true);
}

/* ---- leaves */

HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (HYI_I(hyi_offer_leaf)(&swarm->site, flight, leaf, swarm->any) && swarm->any) hyi_flight_stop(flight);
    }
}

/* ---- instances */

HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any);

/* The rays of a list go through what a box of the tree over instances stands for. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_enter)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_site site = hyi_site_of_item(swarm->site.accel, swarm->site.bvh->ids[hyi_leaf_first(leaf)]);
    hyi_flight *below = swarm->stream->flights + swarm->stream->capacity;
    uint32_t entered = 0, *from = space;
    for (uint32_t i = 0; i < count; i++) {
        if (swarm->flights[list[i]].aim.t_far == -FLT_MAX) continue;
        if (hyi_flight_enter(&below[entered], &swarm->flights[list[i]], &site)) from[entered++] = list[i];
    }
    HYI_I(hyi_run_flights)(&site, swarm->stream, entered, space + ((entered + 15u) & ~15u), true, swarm->any);
    for (uint32_t i = 0; i < entered; i++) {
        hyi_flight *above = &swarm->flights[from[i]];
        if (hyi_flight_return(above, &below[i]) && swarm->any) hyi_flight_stop(above);
    }
}

/* ---- the way down */

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_one_by_one)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (flight->aim.t_far == -FLT_MAX) continue;
        HYI_I(hyi_walk_scene)(&swarm->site, flight, at, swarm->any);
        if (swarm->any && flight->best.instance != HYK_NONE) hyi_flight_stop(flight);
    }
}

/* A list of packets through a node: one at a time where more would leave no room for lists of one on every level below. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_list_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, size_t room) {
    bool together = room >= (size_t)HYI_WIDTH * (count + 15u) + HYI_LIST_RESERVE;
    uint32_t some = together ? count : 1u;
    for (uint32_t first = 0; first < count; first += some) HYI_I(hyi_list_node_packets)(swarm, at, list + first, some, space);
}

/* Sends a list through the child at; space: free memory for lists. Where that is short, or the list is, rays go one by
   one. Packets are only in trees of triangles. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    size_t room = (size_t)(swarm->stream->lists + swarm->stream->list_count - space);
    bool fits = room >= (size_t)(HYI_WIDTH + 2u) * (count + 16u), leaf = hyi_child_is_leaf(at);
    if (packets) {
        if (leaf) HYI_I(hyi_list_leaf_packets)(swarm, at, list, count, NULL, 0);
        else HYI_I(hyi_list_packets)(swarm, at, list, count, space, room);
    } else if (leaf && swarm->site.bvh->rows) {
        HYI_I(hyi_list_leaf_rays)(swarm, at, list, count);
    } else if (leaf && fits) {
        HYI_I(hyi_list_enter)(swarm, at, list, count, space);
    } else if (fits && count >= HYI_LIST_LEAST) {
        HYI_I(hyi_list_node_rays)(swarm, at, list, count, space);
    } else {
        HYI_I(hyi_list_one_by_one)(swarm, at, list, count);
    }
}

/* ---- all rays of a slice */

/* Sends count packets on their way, those of a group together. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_packets)(hyi_swarm *swarm, uint32_t count, uint32_t *space) {
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)swarm->packets[i].group;
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, order + first[g], first[g + 1] - first[g], space + room, true);
    }
}

/* Packets of the alike among a group's flights; the others come to stand first in rays, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike)(hyi_swarm *swarm, uint32_t *rays, uint32_t count, uint32_t *space) {
    uint32_t made = 0, others = 0;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some > HYI_LANES / 2u && HYI_I(hyi_pack_flights)(swarm, &swarm->packets[made], rays + first, some)) made++;
        else
            for (uint32_t i = 0; i < some; i++) rays[others++] = rays[first + i];
    }
    for (uint32_t i = 0; i < made; i++) space[i] = i;
    if (made) HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, space, made, space + ((made + 15u) & ~15u), true);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_flights)(swarm, &swarm->packets[i]);
    return others;
}

/* Sends the first count flights (deep: of those in instances) through the tree of site. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any) {
    hyi_swarm swarm;
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = NULL;
    swarm.flights = stream->flights + (deep ? stream->capacity : 0u);
    swarm.packets = stream->packets + (deep ? stream->packet_share : 0u);
    swarm.any = any;
    if (count < HYI_LIST_LEAST || (size_t)(stream->lists + stream->list_count - space) < (size_t)12u * (room + 16u) + HYI_LIST_RESERVE) {
        for (uint32_t i = 0; i < count; i++) HYI_I(hyi_walk_scene)(site, &swarm.flights[i], site->bvh->root, any);
        return;
    }
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)hyi_aim_group(&swarm.flights[i].aim);
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        uint32_t *rays = order + first[g], some = first[g + 1] - first[g];
        hyi_set_group(&swarm, g);
        if (deep && some) some = HYI_I(hyi_run_alike)(&swarm, rays, some, space + room);
        if (some) HYI_I(hyi_list_visit)(&swarm, site->bvh->root, rays, some, space + room, false);
    }
    for (uint32_t i = 0; i < count && !any && site->bvh->rows; i++) hyi_settle(site, &swarm.flights[i]);
}

/* Packets of those among count rays that are alike; numbers and keys of the others go to others and keys, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike_rays)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits,
                                                     uint8_t *occluded, uint32_t count, uint32_t *others, uint8_t *keys) {
    hyi_swarm swarm;
    uint32_t made = 0, rest = 0;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = rays;
    swarm.flights = NULL;
    swarm.packets = stream->packets;
    swarm.any = occluded != NULL;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some == HYI_LANES && HYI_I(hyi_pack_rays)(&swarm, &swarm.packets[made], first)) {
            made++;
            continue;
        }
        for (uint32_t i = first; i < first + some; i++) {
            others[rest] = i;
            keys[rest++] = hyi_direction_key(hyi_load_ray(&rays[i]).direction);
        }
    }
    if (made) HYI_I(hyi_run_packets)(&swarm, made, stream->lists);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_rays)(&swarm, &swarm.packets[i], hits, occluded);
    return rest;
}
/* The words of one instruction set end here. */
#undef HYI_ADD2
#undef HYI_ADD4
#undef HYI_ADD8
#undef HYI_ADDD
#undef HYI_ADDW
#undef HYI_ALLW
#undef HYI_ALWAYS_EXACT
#undef HYI_AND4
#undef HYI_AND8
#undef HYI_ANDW
#undef HYI_AS_FLOATS
#undef HYI_BITS2_2
#undef HYI_BITS4_4
#undef HYI_BITS8
#undef HYI_BITSW
#undef HYI_CHOOSE4
#undef HYI_CLEAR_MASKS
#undef HYI_D2
#undef HYI_DEAL
#undef HYI_DIV2
#undef HYI_DIV4
#undef HYI_DIV8
#undef HYI_DIVD
#undef HYI_DIVW
#undef HYI_F4
#undef HYI_F8
#undef HYI_FD
#undef HYI_FW
#undef HYI_GREATEST4
#undef HYI_GREATESTW
#undef HYI_HALFD
#undef HYI_HIGH_AS_DOUBLES
#undef HYI_I
#undef HYI_LANES
#undef HYI_LINES
#undef HYI_LE4
#undef HYI_LE8
#undef HYI_LEAST4
#undef HYI_LEASTW
#undef HYI_LEW
#undef HYI_LOAD4
#undef HYI_LOAD4_ALIGNED
#undef HYI_LOAD8
#undef HYI_LOADD
#undef HYI_LOAD2
#undef HYI_LOADU8
#undef HYI_LOADW
#undef HYI_LOW_AS_DOUBLES
#undef HYI_LT2
#undef HYI_LT4
#undef HYI_LT8
#undef HYI_LTD
#undef HYI_LTW
#undef HYI_M4
#undef HYI_M8
#undef HYI_MAD4
#undef HYI_MAD8
#undef HYI_MASKS
#undef HYI_MAX2
#undef HYI_MAX4
#undef HYI_MAX8
#undef HYI_MAXD
#undef HYI_MAXW
#undef HYI_MIN2
#undef HYI_MIN4
#undef HYI_MIN8
#undef HYI_MIN8_WHERE
#undef HYI_MIND
#undef HYI_MINW
#undef HYI_MUL2
#undef HYI_MUL4
#undef HYI_MUL8
#undef HYI_MULD
#undef HYI_MULW
#undef HYI_MW
#undef HYI_OR4
#undef HYI_OR8
#undef HYI_ORW
#undef HYI_PIN2
#undef HYI_PIN4
#undef HYI_PIN8
#undef HYI_PIND
#undef HYI_PINW
#undef HYI_SET2
#undef HYI_SET4
#undef HYI_SET8
#undef HYI_SETD
#undef HYI_SETW
#undef HYI_STORE2
#undef HYI_STORE4
#undef HYI_STORE8
#undef HYI_STORED
#undef HYI_STOREH
#undef HYI_STOREW
#undef HYI_SUB2
#undef HYI_SUB4
#undef HYI_SUB8
#undef HYI_SUBD
#undef HYI_SUBW
#undef HYI_TARGET
#undef HYI_ZERO8
#undef HYI_ZEROW

#endif /* HYI_X86 */
#endif /* HYI_BVH_SSE42_H */

/* >>bvh-neon: traversal in the words of NEON: eight lanes are two times four */
#ifndef HYI_BVH_NEON_H
#define HYI_BVH_NEON_H

#if HYI_NEON

HYI_INLINE float32x4_t hyi_pin4_neon(float32x4_t value) {
#if HYI_GNU
    __asm__("" : "+w"(value));
#endif
    return value;
}

HYI_INLINE float64x2_t hyi_pin2_neon(float64x2_t value) {
#if HYI_GNU
    __asm__("" : "+w"(value));
#endif
    return value;
}

/* One bit a lane. */
HYI_INLINE uint32_t hyi_bits4_4_neon(uint32x4_t low, uint32x4_t high) {
    static const uint16_t bits[8] = {1, 2, 4, 8, 16, 32, 64, 128};
    return vaddvq_u16(vandq_u16(vcombine_u16(vmovn_u32(low), vmovn_u32(high)), vld1q_u16(bits)));
}

HYI_INLINE uint32_t hyi_bits2_2_neon(uint64x2_t low, uint64x2_t high) {
    static const uint32_t bits[4] = {1, 2, 4, 8};
    return vaddvq_u32(vandq_u32(vcombine_u32(vmovn_u64(low), vmovn_u64(high)), vld1q_u32(bits)));
}

#define HYI_TARGET
#define HYI_I(name) name##_neon
#define HYI_F4 float32x4_t
#define HYI_M4 uint32x4_t
#define HYI_LOAD4(p) vld1q_f32(p)
#define HYI_LOAD4_ALIGNED(p) vld1q_f32(p)
#define HYI_STORE4(p, a) vst1q_f32(p, a)
#define HYI_SET4(value) vdupq_n_f32(value)
#define HYI_ADD4(a, b) vaddq_f32(a, b)
#define HYI_SUB4(a, b) vsubq_f32(a, b)
#define HYI_MUL4(a, b) vmulq_f32(a, b)
#define HYI_DIV4(a, b) vdivq_f32(a, b)
#define HYI_MAD4(a, b, c) vfmaq_f32(c, a, b)
#define HYI_MIN4(a, b) vminq_f32(a, b)
#define HYI_MAX4(a, b) vmaxq_f32(a, b)
#define HYI_LT4(a, b) vcltq_f32(a, b)
#define HYI_LE4(a, b) vcleq_f32(a, b)
#define HYI_AND4(a, b) vandq_u32(a, b)
#define HYI_OR4(a, b) vorrq_u32(a, b)
#define HYI_CHOOSE4(m, a, b) vbslq_f32(m, a, b)
#define HYI_BITS4_4(low, high) hyi_bits4_4_neon(low, high)
#define HYI_PIN4(a) hyi_pin4_neon(a)
#define HYI_GREATEST4(a) vmaxvq_f32(a)
#define HYI_LEAST4(a) vminvq_f32(a)
#define HYI_D2 float64x2_t
#define HYI_SET2(value) vdupq_n_f64(value)
#define HYI_LOAD2(p) vld1q_f64(p)
#define HYI_STORE2(p, a) vst1q_f64(p, a)
#define HYI_LOW_AS_DOUBLES(a) vcvt_f64_f32(vget_low_f32(a))
#define HYI_HIGH_AS_DOUBLES(a) vcvt_high_f64_f32(a)
#define HYI_AS_FLOATS(low, high) vcvt_high_f32_f64(vcvt_f32_f64(low), high)
#define HYI_ADD2(a, b) vaddq_f64(a, b)
#define HYI_SUB2(a, b) vsubq_f64(a, b)
#define HYI_MUL2(a, b) vmulq_f64(a, b)
#define HYI_DIV2(a, b) vdivq_f64(a, b)
#define HYI_MIN2(a, b) vminq_f64(a, b)
#define HYI_MAX2(a, b) vmaxq_f64(a, b)
#define HYI_LT2(a, b) vcltq_f64(a, b)
#define HYI_BITS2_2(low, high) hyi_bits2_2_neon(low, high)
#define HYI_PIN2(a) hyi_pin2_neon(a)
/* ---- eight lanes as two times four (expanded once for each instruction set whose vectors have four, in its words
   for four floats and two doubles) */

typedef struct HYI_I(hyi_f8) {
    HYI_F4 low, high;
} HYI_I(hyi_f8);

typedef struct HYI_I(hyi_m8) {
    HYI_M4 low, high;
} HYI_I(hyi_m8);

typedef struct HYI_I(hyi_d4) {
    HYI_D2 low, high;
} HYI_I(hyi_d4);

#define HYI_PAIR(name, result, type, word)                                                        \
    HYI_INLINE HYI_TARGET HYI_I(hyi_##result) HYI_I(hyi_##name)(HYI_I(hyi_##type) a, HYI_I(hyi_##type) b) { \
        HYI_I(hyi_##result) r;                                                                    \
        r.low = word(a.low, b.low);                                                               \
        r.high = word(a.high, b.high);                                                            \
        return r;                                                                                 \
    }
HYI_PAIR(add8, f8, f8, HYI_ADD4)
HYI_PAIR(sub8, f8, f8, HYI_SUB4)
HYI_PAIR(mul8, f8, f8, HYI_MUL4)
HYI_PAIR(div8, f8, f8, HYI_DIV4)
HYI_PAIR(min8, f8, f8, HYI_MIN4)
HYI_PAIR(max8, f8, f8, HYI_MAX4)
HYI_PAIR(lt8, m8, f8, HYI_LT4)
HYI_PAIR(le8, m8, f8, HYI_LE4)
HYI_PAIR(and8, m8, m8, HYI_AND4)
HYI_PAIR(or8, m8, m8, HYI_OR4)
HYI_PAIR(add_doubles, d4, d4, HYI_ADD2)
HYI_PAIR(sub_doubles, d4, d4, HYI_SUB2)
HYI_PAIR(mul_doubles, d4, d4, HYI_MUL2)
HYI_PAIR(div_doubles, d4, d4, HYI_DIV2)
HYI_PAIR(min_doubles, d4, d4, HYI_MIN2)
HYI_PAIR(max_doubles, d4, d4, HYI_MAX2)
#undef HYI_PAIR

/* ---- floats */

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_set8)(float value) {
    HYI_I(hyi_f8) r;
    r.low = r.high = HYI_SET4(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load8)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4(p);
    r.high = HYI_LOAD4(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load_plane)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4_ALIGNED(p);
    r.high = HYI_LOAD4_ALIGNED(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store8)(float *p, HYI_I(hyi_f8) a) {
    HYI_STORE4(p, a.low);
    HYI_STORE4(p + 4, a.high);
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_mad8)(HYI_I(hyi_f8) a, HYI_I(hyi_f8) b, HYI_I(hyi_f8) c) {
    HYI_I(hyi_f8) r;
    r.low = HYI_MAD4(a.low, b.low, c.low);
    r.high = HYI_MAD4(a.high, b.high, c.high);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_pin8)(HYI_I(hyi_f8) a) {
    a.low = HYI_PIN4(a.low);
    a.high = HYI_PIN4(a.high);
    return a;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_min8_where)(HYI_I(hyi_f8) a, HYI_I(hyi_m8) m, HYI_I(hyi_f8) b) {
    a.low = HYI_CHOOSE4(m.low, HYI_MIN4(a.low, b.low), a.low);
    a.high = HYI_CHOOSE4(m.high, HYI_MIN4(a.high, b.high), a.high);
    return a;
}

/* ---- doubles: four, in one half of a packet */

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_set_doubles)(double value) {
    HYI_I(hyi_d4) r;
    r.low = r.high = HYI_SET2(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_half_as_doubles)(HYI_I(hyi_f8) a, int half) {
    HYI_F4 four = half ? a.high : a.low;
    HYI_I(hyi_d4) r;
    r.low = HYI_LOW_AS_DOUBLES(four);
    r.high = HYI_HIGH_AS_DOUBLES(four);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_load_doubles)(const double *p) {
    HYI_I(hyi_d4) r;
    r.low = HYI_LOAD2(p);
    r.high = HYI_LOAD2(p + 2);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_doubles)(double *p, HYI_I(hyi_d4) a) {
    HYI_STORE2(p, a.low);
    HYI_STORE2(p + 2, a.high);
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_half)(float *p, int half, HYI_I(hyi_d4) a) {
    HYI_STORE4(p + 4 * half, HYI_AS_FLOATS(a.low, a.high));
}

HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_lt_doubles)(HYI_I(hyi_d4) a, HYI_I(hyi_d4) b) {
    return HYI_BITS2_2(HYI_LT2(a.low, b.low), HYI_LT2(a.high, b.high));
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_pin_doubles)(HYI_I(hyi_d4) a) {
    a.low = HYI_PIN2(a.low);
    a.high = HYI_PIN2(a.high);
    return a;
}

/* ---- lists */

/* Appends eight items to the lists of the children that their masks name. By bits: permutations from a table were slower. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal_out)(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    for (uint32_t i = 0; i < 8u; i++) {
        for (uint32_t takers = masks->bytes[i]; takers; takers &= takers - 1u) {
            uint32_t c = hyi_lowest_bit(takers);
            lists[(size_t)c * stride + dealt[c]++] = items[i];
        }
    }
}

#define HYI_F8 HYI_I(hyi_f8)
#define HYI_ALWAYS_EXACT 0
#define HYI_M8 HYI_I(hyi_m8)
#define HYI_LOAD8(p) HYI_I(hyi_load_plane)(p)
#define HYI_LOADU8(p) HYI_I(hyi_load8)(p)
#define HYI_STORE8(p, a) HYI_I(hyi_store8)(p, a)
#define HYI_SET8(value) HYI_I(hyi_set8)(value)
#define HYI_ZERO8() HYI_I(hyi_set8)(0.0f)
#define HYI_ADD8(a, b) HYI_I(hyi_add8)(a, b)
#define HYI_SUB8(a, b) HYI_I(hyi_sub8)(a, b)
#define HYI_MUL8(a, b) HYI_I(hyi_mul8)(a, b)
#define HYI_DIV8(a, b) HYI_I(hyi_div8)(a, b)
#define HYI_MAD8(a, b, c) HYI_I(hyi_mad8)(a, b, c)
#define HYI_MIN8(a, b) HYI_I(hyi_min8)(a, b)
#define HYI_MAX8(a, b) HYI_I(hyi_max8)(a, b)
#define HYI_LT8(a, b) HYI_I(hyi_lt8)(a, b)
#define HYI_LE8(a, b) HYI_I(hyi_le8)(a, b)
#define HYI_AND8(a, b) HYI_I(hyi_and8)(a, b)
#define HYI_OR8(a, b) HYI_I(hyi_or8)(a, b)
#define HYI_BITS8(m) HYI_BITS4_4((m).low, (m).high)
#define HYI_MIN8_WHERE(a, m, b) HYI_I(hyi_min8_where)(a, m, b)
#define HYI_PIN8(a) HYI_I(hyi_pin8)(a)
#define HYI_LINES(rows, lines) hyi_lines(rows, lines, 8u)
#define HYI_LANES 8u
#define HYI_ALLW 0xffu
#define HYI_FW HYI_F8
#define HYI_MW HYI_M8
#define HYI_LOADW(p) HYI_LOADU8(p)
#define HYI_STOREW(p, a) HYI_STORE8(p, a)
#define HYI_SETW(value) HYI_SET8(value)
#define HYI_ZEROW() HYI_ZERO8()
#define HYI_ADDW(a, b) HYI_ADD8(a, b)
#define HYI_SUBW(a, b) HYI_SUB8(a, b)
#define HYI_MULW(a, b) HYI_MUL8(a, b)
#define HYI_DIVW(a, b) HYI_DIV8(a, b)
#define HYI_MINW(a, b) HYI_MIN8(a, b)
#define HYI_MAXW(a, b) HYI_MAX8(a, b)
#define HYI_LTW(a, b) HYI_LT8(a, b)
#define HYI_LEW(a, b) HYI_LE8(a, b)
#define HYI_ANDW(a, b) HYI_AND8(a, b)
#define HYI_ORW(a, b) HYI_OR8(a, b)
#define HYI_BITSW(m) HYI_BITS8(m)
#define HYI_PINW(a) HYI_PIN8(a)
#define HYI_GREATESTW(a) HYI_GREATEST4(HYI_MAX4((a).low, (a).high))
#define HYI_LEASTW(a) HYI_LEAST4(HYI_MIN4((a).low, (a).high))
#define HYI_DEAL 8u
#define HYI_MASKS hyi_masks8
#define HYI_CLEAR_MASKS(masks) ((masks).all = 0)
#define HYI_FD HYI_I(hyi_d4)
#define HYI_SETD(value) HYI_I(hyi_set_doubles)(value)
#define HYI_HALFD(a, half) HYI_I(hyi_half_as_doubles)(a, half)
#define HYI_LOADD(p) HYI_I(hyi_load_doubles)(p)
#define HYI_STORED(p, a) HYI_I(hyi_store_doubles)(p, a)
#define HYI_STOREH(p, half, a) HYI_I(hyi_store_half)(p, half, a)
#define HYI_ADDD(a, b) HYI_I(hyi_add_doubles)(a, b)
#define HYI_SUBD(a, b) HYI_I(hyi_sub_doubles)(a, b)
#define HYI_MULD(a, b) HYI_I(hyi_mul_doubles)(a, b)
#define HYI_DIVD(a, b) HYI_I(hyi_div_doubles)(a, b)
#define HYI_MIND(a, b) HYI_I(hyi_min_doubles)(a, b)
#define HYI_MAXD(a, b) HYI_I(hyi_max_doubles)(a, b)
#define HYI_LTD(a, b) HYI_I(hyi_lt_doubles)(a, b)
#define HYI_PIND(a) HYI_I(hyi_pin_doubles)(a)
/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_size)(HYI_F8 v) { return HYI_MAX8(v, HYI_SUB8(HYI_ZERO8(), v)); }

/* What eight triangles are to a ray. */
typedef struct HYI_I(hyi_verdicts) {
    uint32_t possible;        /* bits of those that it may hit */
    uint32_t certain;         /* of those that it hits, from t_near on, whatever the closer look would round */
    float least[8], most[8];  /* between these lies t of the certain ones */
} HYI_I(hyi_verdicts);

/* Where the edge functions have one strict sign, that is theirs in exact arithmetic too, and t is a mean of t at the
   corners with their values as weights. Let the corners be across off the ray at most, and along along it. A sheared
   corner is off its place by less than 2^-22 (across / 2 + along), so that the weights together are off by less than
   noise = 2^-18 across (across + along), and t by their share in the sum, of the difference between t at the corners;
   rounding of t at the corners and of the mean is less than 2^-20 of it. A sum that noise could have made says nothing. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_judge_triangles)(const hyi_aim *aim, const HYI_I(hyi_corners) k[3], const HYI_F8 w[3], const HYI_F8 t[3],
                                                      HYI_F8 first, HYI_F8 last, HYI_M8 one_sign, HYI_I(hyi_verdicts) *verdicts) {
    HYI_F8 across = HYI_ZERO8(), along = HYI_ZERO8(), sum = HYI_ADD8(HYI_ADD8(w[0], w[1]), w[2]), size = HYI_I(hyi_size)(sum);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAX8(across, HYI_MAX8(HYI_I(hyi_size)(k[i].x), HYI_I(hyi_size)(k[i].y)));
        along = HYI_MAX8(along, HYI_I(hyi_size)(k[i].z));
    }
    HYI_F8 noise = HYI_MUL8(HYI_MUL8(HYI_SET8(HYI_EDGE_NOISE), across), HYI_ADD8(across, along)), inverse = HYI_DIV8(HYI_SET8(1.0f), sum);
    HYI_F8 mean = HYI_MUL8(HYI_MAD8(w[2], t[2], HYI_MAD8(w[1], t[1], HYI_MUL8(w[0], t[0]))), inverse);
    HYI_F8 farthest = HYI_MAX8(HYI_I(hyi_size)(first), HYI_I(hyi_size)(last));
    HYI_F8 error = HYI_MAD8(HYI_MUL8(HYI_SUB8(last, first), noise), HYI_I(hyi_size)(inverse), HYI_MUL8(HYI_SET8(HYI_T_NOISE), farthest));
    HYI_F8 least = HYI_SUB8(mean, error), most = HYI_ADD8(mean, error);
    HYI_M8 known = HYI_AND8(one_sign, HYI_LT8(HYI_MAX8(HYI_MUL8(HYI_SET8(4.0f), noise), HYI_SET8(HYI_EDGE_LEAST)), size));
    HYI_M8 missed = HYI_AND8(known, HYI_OR8(HYI_LT8(most, HYI_SET8(aim->t_near)), HYI_LT8(HYI_SET8(aim->t_far), least)));
    float from = aim->t_near + 16.0f * HYI_ULP * fabsf(aim->t_near);
    verdicts->possible &= ~HYI_BITS8(missed);
    verdicts->certain = verdicts->possible & HYI_BITS8(HYI_AND8(known, HYI_LE8(HYI_SET8(from), least)));
    HYI_STORE8(verdicts->least, least);
    HYI_STORE8(verdicts->most, most);
}

/* Possible at first: edge functions not of both signs, and not all corners beyond one of the limits, since t of a hit is a
   mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. exact: nothing is certain. */
HYI_INLINE HYI_TARGET HYI_I(hyi_verdicts) HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count, bool exact) {
    HYI_I(hyi_corners) k[3];
    HYI_I(hyi_verdicts) verdicts;
    for (uint32_t i = 0; i < 3; i++) k[i] = HYI_I(hyi_shear_corners)(aim, rows + 3u * i * count, count);
    HYI_F8 w[3] = {HYI_I(hyi_cross)(k[2], k[1]), HYI_I(hyi_cross)(k[0], k[2]), HYI_I(hyi_cross)(k[1], k[0])}, t[3];
    HYI_F8 least = HYI_MIN8(HYI_MIN8(w[0], w[1]), w[2]), most = HYI_MAX8(HYI_MAX8(w[0], w[1]), w[2]), zero = HYI_ZERO8();
    for (int i = 0; i < 3; i++) t[i] = HYI_MUL8(k[i].z, HYI_SET8(aim->inverse_z));
    HYI_F8 first = HYI_MIN8(HYI_MIN8(t[0], t[1]), t[2]), last = HYI_MAX8(HYI_MAX8(t[0], t[1]), t[2]);
    HYI_M8 outside = HYI_AND8(HYI_LT8(least, zero), HYI_LT8(zero, most));
    HYI_M8 beyond = HYI_OR8(HYI_LT8(HYI_SET8(aim->t_far), first), HYI_LT8(last, HYI_SET8(aim->t_near)));
    verdicts.possible = ~HYI_BITS8(HYI_OR8(outside, beyond)) & ((1u << count) - 1u);
    verdicts.certain = 0;
    if (verdicts.possible && !exact)
        HYI_I(hyi_judge_triangles)(aim, k, w, t, first, last, HYI_OR8(HYI_LT8(zero, least), HYI_LT8(most, zero)), &verdicts);
    return verdicts;
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    bool exact = HYI_ALWAYS_EXACT || site->asks_alpha || flight->aim.unit != 1.0, found = false;
    HYI_I(hyi_verdicts) verdicts = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf), exact);
    for (uint32_t mask = verdicts.possible; mask; mask &= mask - 1u) {
        uint32_t lane = hyi_lowest_bit(mask);
        if (verdicts.certain >> lane & 1u) {
            if (verdicts.least[lane] > flight->aim.t_far) continue;
            found = hyi_expect(site, flight, leaf, lane, verdicts.least[lane], verdicts.most[lane]) || found;
        } else {
            found = hyi_offer(site, flight, leaf, lane) || found;
        }
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) {
                hyi_settle(site, flight);
                return;
            }
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
/* ---- packets of alike rays (expanded once for each instruction set) */

/* The planes of a node in the order in which the rays of a swarm meet them. */
typedef struct HYI_I(hyi_planes) {
    HYI_F8 near_planes[3], far_planes[3];
} HYI_I(hyi_planes);

/* Eight boxes against the bounds of a packet: no ray of it enters earlier than enter, or leaves later. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes_all)(const hyi_packet *p, const HYI_I(hyi_planes) *planes, HYI_F8 *enter) {
    HYI_F8 first = HYI_SET8(p->first_t), last = HYI_SET8(p->last_t);
    for (int a = 0; a < 3; a++) {
        HYI_F8 low = HYI_SET8(p->inverse_low[a]), high = HYI_SET8(p->inverse_high[a]);
        HYI_F8 to_near = HYI_SUB8(planes->near_planes[a], HYI_SET8(p->near_origin[a]));
        HYI_F8 to_far = HYI_SUB8(planes->far_planes[a], HYI_SET8(p->far_origin[a]));
        first = HYI_MAX8(first, HYI_MIN8(HYI_MUL8(to_near, low), HYI_MUL8(to_near, high)));
        last = HYI_MIN8(last, HYI_MAX8(HYI_MUL8(to_far, low), HYI_MUL8(to_far, high)));
    }
    *enter = first;
    return HYI_LE8(first, last);
}

/* Whether any ray of a packet meets the box of child c. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_meet_box_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t c) {
    HYI_FW first = HYI_LOADW(p->t_near), last = HYI_LOADW(p->t_far);
    for (int k = 0; k < 3; k++) {
        uint32_t a = swarm->axis[k], near_row = swarm->near_plane[a];
        float slack = (near_row & 1u) ? p->bound[a] : -p->bound[a];
        HYI_FW origin = HYI_LOADW(p->origin[k]), inverse = HYI_LOADW(p->inverse[k]);
        first = HYI_MAXW(first, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row][c] + slack), origin), inverse));
        last = HYI_MINW(last, HYI_MULW(HYI_SUBW(HYI_SETW(node->planes[near_row ^ 1u][c] - slack), origin), inverse));
    }
    return HYI_BITSW(HYI_LEW(first, last)) != 0u;
}

/* Of the children in mask, those whose box some ray of a packet meets. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_boxes_each)(const hyi_swarm *swarm, const hyi_packet *p, const hyi_node *node, uint32_t mask) {
    uint32_t met = mask;
    for (; mask; mask &= mask - 1u) {
        uint32_t c = hyi_lowest_bit(mask);
        met &= ~((HYI_I(hyi_meet_box_each)(swarm, p, node, c) ? 0u : 1u) << c);
    }
    return met;
}

/* ---- triangles */

/* A corner in the sheared frames of the rays of a packet. */
typedef struct HYI_I(hyi_corner_all) {
    HYI_FW x, y, z;
} HYI_I(hyi_corner_all);

HYI_INLINE HYI_TARGET HYI_I(hyi_corner_all) HYI_I(hyi_shear_all)(const hyi_packet *p, const uint32_t *axis, const float *row, uint32_t stride) {
    HYI_I(hyi_corner_all) c;
    c.z = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[2] * stride]), HYI_LOADW(p->origin[2])));
    HYI_FW dx = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[0] * stride]), HYI_LOADW(p->origin[0])));
    HYI_FW dy = HYI_PINW(HYI_SUBW(HYI_SETW(row[axis[1] * stride]), HYI_LOADW(p->origin[1])));
    c.x = HYI_PINW(HYI_SUBW(dx, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[0]), c.z))));
    c.y = HYI_PINW(HYI_SUBW(dy, HYI_PINW(HYI_MULW(HYI_LOADW(p->shear[1]), c.z))));
    return c;
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_cross_all)(HYI_I(hyi_corner_all) p, HYI_I(hyi_corner_all) q) {
    return HYI_SUBW(HYI_PINW(HYI_MULW(p.x, q.y)), HYI_PINW(HYI_MULW(p.y, q.x)));
}

/* Which rays certainly miss one triangle: the same test as of one ray and eight triangles. */
HYI_INLINE HYI_TARGET HYI_MW HYI_I(hyi_miss_triangle_all)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3]) {
    HYI_I(hyi_corner_all) p = corners[0], q = corners[1], r = corners[2];
    HYI_FW a = HYI_I(hyi_cross_all)(r, q), b = HYI_I(hyi_cross_all)(p, r), c = HYI_I(hyi_cross_all)(q, p);
    HYI_MW below = HYI_LTW(HYI_MINW(HYI_MINW(a, b), c), HYI_ZEROW());
    HYI_MW above = HYI_LTW(HYI_ZEROW(), HYI_MAXW(HYI_MAXW(a, b), c));
    HYI_FW scale = HYI_LOADW(packet->inverse_z);
    HYI_FW ta = HYI_MULW(p.z, scale), tb = HYI_MULW(q.z, scale), tc = HYI_MULW(r.z, scale);
    HYI_MW late = HYI_LTW(HYI_LOADW(packet->t_far), HYI_MINW(HYI_MINW(ta, tb), tc));
    HYI_MW early = HYI_LTW(HYI_MAXW(HYI_MAXW(ta, tb), tc), HYI_LOADW(packet->t_near));
    return HYI_ORW(HYI_ANDW(below, above), HYI_ORW(late, early));
}

HYI_INLINE HYI_TARGET HYI_FW HYI_I(hyi_size_all)(HYI_FW v) { return HYI_MAXW(v, HYI_SUBW(HYI_ZEROW(), v)); }

/* Of one triangle that rays may hit but those in out, where any hit does: stops the rays that certainly hit it; left: the
   others, without those that turn out to miss it. hyi_judge_triangles, for all rays. Returns whether it stopped any. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_stop_certain)(const hyi_swarm *swarm, hyi_packet *packet, const HYI_I(hyi_corner_all) k[3], HYI_MW out, uint32_t *left) {
    HYI_FW zero = HYI_ZEROW(), scale = HYI_LOADW(packet->inverse_z), t_near = HYI_LOADW(packet->t_near), t_far = HYI_LOADW(packet->t_far);
    HYI_FW a = HYI_I(hyi_cross_all)(k[2], k[1]), b = HYI_I(hyi_cross_all)(k[0], k[2]), c = HYI_I(hyi_cross_all)(k[1], k[0]);
    HYI_FW sum = HYI_ADDW(HYI_ADDW(a, b), c), across = zero, along = zero;
    HYI_FW ta = HYI_MULW(k[0].z, scale), tb = HYI_MULW(k[1].z, scale), tc = HYI_MULW(k[2].z, scale);
    HYI_FW first = HYI_MINW(HYI_MINW(ta, tb), tc), last = HYI_MAXW(HYI_MAXW(ta, tb), tc);
    for (int i = 0; i < 3; i++) {
        across = HYI_MAXW(across, HYI_MAXW(HYI_I(hyi_size_all)(k[i].x), HYI_I(hyi_size_all)(k[i].y)));
        along = HYI_MAXW(along, HYI_I(hyi_size_all)(k[i].z));
    }
    HYI_FW noise = HYI_MULW(HYI_MULW(HYI_SETW(HYI_EDGE_NOISE), across), HYI_ADDW(across, along)), inverse = HYI_DIVW(HYI_SETW(1.0f), sum);
    HYI_FW mean = HYI_MULW(HYI_ADDW(HYI_ADDW(HYI_MULW(a, ta), HYI_MULW(b, tb)), HYI_MULW(c, tc)), inverse);
    HYI_FW farthest = HYI_MAXW(HYI_I(hyi_size_all)(first), HYI_I(hyi_size_all)(last));
    HYI_FW error = HYI_ADDW(HYI_MULW(HYI_MULW(HYI_SUBW(last, first), noise), HYI_I(hyi_size_all)(inverse)), HYI_MULW(HYI_SETW(HYI_T_NOISE), farthest));
    HYI_FW least = HYI_SUBW(mean, error), most = HYI_ADDW(mean, error);
    HYI_MW one_sign = HYI_ORW(HYI_LTW(zero, HYI_MINW(HYI_MINW(a, b), c)), HYI_LTW(HYI_MAXW(HYI_MAXW(a, b), c), zero));
    HYI_MW known = HYI_ANDW(one_sign, HYI_LTW(HYI_MAXW(HYI_MULW(HYI_SETW(4.0f), noise), HYI_SETW(HYI_EDGE_LEAST)), HYI_I(hyi_size_all)(sum)));
    HYI_MW missed = HYI_ANDW(known, HYI_ORW(HYI_LTW(most, t_near), HYI_LTW(t_far, least)));
    HYI_FW from = HYI_ADDW(t_near, HYI_MULW(HYI_SETW(16.0f * HYI_ULP), HYI_I(hyi_size_all)(t_near)));
    HYI_MW hit = HYI_ANDW(HYI_ANDW(known, HYI_LEW(from, least)), HYI_LTW(most, HYI_LOADW(packet->best_t)));
    uint32_t stopped = HYI_BITSW(hit) & ~HYI_BITSW(out);
    *left = HYI_ALLW & ~(stopped | HYI_BITSW(HYI_ORW(out, missed)));
    if (stopped == 0) return false;
    for (uint32_t some = stopped; some; some &= some - 1u) {
        packet->t_far[hyi_lowest_bit(some)] = -FLT_MAX;
        packet->instance[hyi_lowest_bit(some)] = swarm->site.instance;
    }
    return true;
}

/* p.x q.y - p.y q.x of floats: both products are exact, the difference is rounded once. */
HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_cross_exact_half)(HYI_FD px, HYI_FD py, HYI_FD qx, HYI_FD qy) {
    return HYI_PIND(HYI_SUBD(HYI_MULD(px, qy), HYI_MULD(py, qx)));
}

HYI_INLINE HYI_TARGET HYI_FD HYI_I(hyi_sum_products_half)(const double n[3], const HYI_FD v[3]) {
    HYI_FD first = HYI_PIND(HYI_MULD(HYI_SETD(n[0]), v[0])), second = HYI_PIND(HYI_MULD(HYI_SETD(n[1]), v[1]));
    return HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(first, second)), HYI_PIND(HYI_MULD(HYI_SETD(n[2]), v[2]))));
}

/* What hyi_confirm works out, for half of a packet: t and the edge functions; the bits of those that are hit. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_confirm_half)(const hyi_packet *packet, const HYI_I(hyi_corner_all) corners[3], const double corner[3],
                                                       const double n[3], const double z[3], int half, double t[8], double weights[3][8]) {
    HYI_FD x[3], y[3], to_corner[3], direction[3], zero = HYI_SETD(0.0);
    for (int i = 0; i < 3; i++) {
        x[i] = HYI_HALFD(corners[i].x, half);
        y[i] = HYI_HALFD(corners[i].y, half);
        to_corner[i] = HYI_PIND(HYI_SUBD(HYI_SETD(corner[i]), HYI_HALFD(HYI_LOADW(packet->origin[i]), half)));
        direction[i] = HYI_HALFD(HYI_LOADW(packet->direction[i]), half);
    }
    HYI_FD a = HYI_I(hyi_cross_exact_half)(x[2], y[2], x[1], y[1]);
    HYI_FD b = HYI_I(hyi_cross_exact_half)(x[0], y[0], x[2], y[2]);
    HYI_FD c = HYI_I(hyi_cross_exact_half)(x[1], y[1], x[0], y[0]);
    uint32_t below = HYI_LTD(HYI_MIND(HYI_MIND(a, b), c), zero), above = HYI_LTD(zero, HYI_MAXD(HYI_MAXD(a, b), c));
    HYI_FD sum = HYI_PIND(HYI_ADDD(HYI_PIND(HYI_ADDD(a, b)), c));
    HYI_FD across = HYI_I(hyi_sum_products_half)(n, direction);
    HYI_FD plane = HYI_PIND(HYI_DIVD(HYI_I(hyi_sum_products_half)(n, to_corner), across));
    HYI_FD t_by_z = HYI_LOADD(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u));
    HYI_FD least = HYI_PIND(HYI_MULD(to_corner[2], t_by_z)), most = least;
    for (int i = 1; i < 3; i++) {
        HYI_FD to = HYI_PIND(HYI_SUBD(HYI_SETD(z[i]), HYI_HALFD(HYI_LOADW(packet->origin[2]), half)));
        HYI_FD at = HYI_PIND(HYI_MULD(to, t_by_z));
        least = HYI_MIND(least, at);
        most = HYI_MAXD(most, at);
    }
    HYI_STORED(t, HYI_MIND(HYI_MAXD(plane, least), most));
    HYI_STORED(weights[0], b);
    HYI_STORED(weights[1], c);
    HYI_STORED(weights[2], sum);
    return ~(below & above) & (HYI_LTD(sum, zero) | HYI_LTD(zero, sum)) & (HYI_LTD(across, zero) | HYI_LTD(zero, across));
}

/* The plane of a triangle as hyi_plane_distance works it out: a corner and the normal. */
HYI_INLINE void HYI_I(hyi_plane_all)(const uint32_t *axis, const float *rows, uint32_t stride, double corner[3], double n[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const float *row = rows + axis[i] * stride;
        corner[i] = (double)row[0];
        e[i] = hyi_rounded_double((double)row[3u * stride] - corner[i]);
        f[i] = hyi_rounded_double((double)row[6u * stride] - corner[i]);
    }
    for (int i = 0; i < 3; i++) n[i] = hyi_difference_of_products(e[(i + 1) % 3], f[(i + 2) % 3], e[(i + 2) % 3], f[(i + 1) % 3]);
}

/* Takes a confirmed hit of one ray if it is the best. */
HYI_INLINE bool HYI_I(hyi_take_hit)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t lane, uint32_t primitive, float t, const double weights[3]) {
    hyi_best best;
    best.t = packet->best_t[lane];
    best.instance = packet->instance[lane];
    best.primitive = packet->primitive[lane];
    if (!(t >= packet->t_min[lane]) || !hyi_beats(&best, t, swarm->site.instance, primitive)) return false;
    if (swarm->site.asks_alpha) {
        const hyk_ray *ray = swarm->rays ? &swarm->rays[packet->ray[lane]] : swarm->flights[packet->ray[lane]].ray;
        double inverse = hyi_rounded_double(1.0 / weights[2]);
        if (hyi_lets_pass(&swarm->site, ray, primitive, (float)(weights[0] * inverse), (float)(weights[1] * inverse))) return false;
    }
    packet->best_t[lane] = t;
    packet->instance[lane] = swarm->site.instance;
    packet->primitive[lane] = primitive;
    for (int i = 0; i < 3; i++) packet->weights[i][lane] = weights[i];
    packet->t_far[lane] = swarm->any ? -FLT_MAX : t + 4.0f * HYI_ULP * fabsf(t);
    return true;
}

/* Decides on triangle number t of a leaf for the rays in mask. Returns whether one of them was hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_decide_for_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], uint32_t mask) {
    double corner[3], n[3], z[3];
    for (uint32_t k = 0; k < 3; k++) z[k] = (double)hyi_leaf_rows(swarm->site.bvh, leaf)[(3u * k + swarm->axis[2]) * hyi_leaf_count(leaf) + triangle];
    uint32_t primitive = swarm->site.bvh->ids[hyi_leaf_first(leaf) + triangle];
    bool found = false;
    HYI_I(hyi_plane_all)(swarm->axis, hyi_leaf_rows(swarm->site.bvh, leaf) + triangle, hyi_leaf_count(leaf), corner, n);
    for (int half = 0; half < 2; half++) {
        uint32_t base = (uint32_t)half * (HYI_LANES / 2u), some = mask >> base & ((1u << (HYI_LANES / 2u)) - 1u);
        double t[8], weights[3][8];
        if (some) some &= HYI_I(hyi_confirm_half)(packet, corners, corner, n, z, half, t, weights);
        for (; some; some &= some - 1u) {
            uint32_t lane = hyi_lowest_bit(some);
            const double w[3] = {weights[0][lane], weights[1][lane], weights[2][lane]};
            if ((float)t[lane] <= packet->best_t[base + lane] && HYI_I(hyi_take_hit)(swarm, packet, base + lane, primitive, (float)t[lane], w)) found = true;
        }
    }
    return found;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_triangle)(const hyi_swarm *swarm, const hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                     HYI_I(hyi_corner_all) corners[3]) {
    const float *rows = hyi_leaf_rows(swarm->site.bvh, leaf);
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t k = 0; k < 3; k++) corners[k] = HYI_I(hyi_shear_all)(packet, swarm->axis, rows + 3u * k * triangles + triangle, triangles);
}

/* Offers triangle number t of a leaf to all rays but those in out, which miss it. Returns whether one of them hits it. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_to_all)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t leaf, uint32_t triangle,
                                                   const HYI_I(hyi_corner_all) corners[3], HYI_MW out) {
    uint32_t left = ~HYI_BITSW(out) & HYI_ALLW;
    bool found = left && swarm->any && !swarm->site.asks_alpha && HYI_I(hyi_stop_certain)(swarm, packet, corners, out, &left);
    if (left && HYI_I(hyi_decide_for_all)(swarm, packet, leaf, triangle, corners, left)) found = true;
    return found;
}

/* node, c: where the leaf hangs; NULL: nowhere. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_packets)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count,
                                                    const hyi_node *node, uint32_t c) {
    uint32_t triangles = hyi_leaf_count(leaf);
    for (uint32_t i = 0; i < count; i++) {
        hyi_packet *packet = &swarm->packets[list[i]];
        bool found = false;
        if (packet->last_t < packet->first_t || (node && !HYI_I(hyi_meet_box_each)(swarm, packet, node, c))) continue;
        for (uint32_t t = 0; t < triangles; t++) {
            HYI_I(hyi_corner_all) corners[3];
            HYI_I(hyi_shear_triangle)(swarm, packet, leaf, t, corners);
            if (HYI_I(hyi_offer_to_all)(swarm, packet, leaf, t, corners, HYI_I(hyi_miss_triangle_all)(packet, corners))) found = true;
        }
        if (found) packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    }
}

/* ---- making packets */

/* Bounds over all lanes; false: the rays are too different to go together. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_bound_packet)(const hyi_box *box, hyi_packet *packet, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float low[3], high[3], extent = 0.0f, z = 0.0f;
    uint32_t axis = packet->group >> 3;
    packet->spread = 0;
    for (int a = 0; a < 2; a++) {
        HYI_FW shear = HYI_LOADW(packet->shear[a]);
        if (!(HYI_GREATESTW(shear) - HYI_LEASTW(shear) <= HYI_PACKET_SLOPES)) return false;
    }
    for (int a = 0; a < 3; a++) {
        low[a] = HYI_LEASTW(HYI_LOADW(o[a]));
        high[a] = HYI_GREATESTW(HYI_LOADW(o[a]));
        extent = box->upper[a] - box->lower[a] > extent ? box->upper[a] - box->lower[a] : extent;
    }
    float below = hyi_reach(box, low[axis], (int)axis, false), above = hyi_reach(box, high[axis], (int)axis, false);
    z = below > above ? below : above;
    for (int a = 0; a < 3; a++) {
        if (!(high[a] - low[a] <= HYI_PACKET_ORIGINS * extent)) return false;
        if (high[a] > low[a]) packet->spread = 1;
        float from_low = hyi_reach(box, low[a], a, false), from_high = hyi_reach(box, high[a], a, false);
        float size = fabsf(low[a]) > fabsf(high[a]) ? fabsf(low[a]) : fabsf(high[a]);
        float bound = hyi_slab_bound(from_low > from_high ? from_low : from_high, z, size);
        bool falls = (packet->group >> a & 1u) != 0u;
        packet->bound[a] = bound;
        packet->near_origin[a] = falls ? low[a] - bound : high[a] + bound;
        packet->far_origin[a] = falls ? high[a] + bound : low[a] - bound;
        HYI_STOREW(packet->inverse[a == (int)axis ? 2 : (a + 3 - (int)axis) % 3 - 1], HYI_LOADW(inverse[a]));
        packet->inverse_low[a] = HYI_LEASTW(HYI_LOADW(inverse[a]));
        packet->inverse_high[a] = HYI_GREATESTW(HYI_LOADW(inverse[a]));
    }
    packet->first_t = HYI_LEASTW(HYI_LOADW(packet->t_near));
    packet->last_t = HYI_GREATESTW(HYI_LOADW(packet->t_far));
    return true;
}

/* Whether |v| <= limit in all lanes; what is not a number is not. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_all_within)(const float *v, float limit) {
    HYI_FW size = HYI_MAXW(HYI_LOADW(v), HYI_SUBW(HYI_ZEROW(), HYI_LOADW(v)));
    return HYI_BITSW(HYI_LEW(size, HYI_SETW(limit))) == HYI_ALLW;
}

/* What directions have in common: see hyi_aim_group; false: they differ in that, or in size by far. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_find_group)(float d[3][HYI_PACKET_WIDTH], uint32_t *group) {
    HYI_FW zero = HYI_ZEROW(), size[3];
    *group = 0;
    for (uint32_t a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        uint32_t falls = HYI_BITSW(HYI_LTW(v, zero));
        if ((falls != 0u && falls != HYI_ALLW) || !HYI_I(hyi_all_within)(d[a], 1073741824.0f)) return false;
        *group |= (falls ? 1u : 0u) << a;
        size[a] = HYI_MAXW(v, HYI_SUBW(zero, v));
    }
    uint32_t y = HYI_BITSW(HYI_LTW(size[0], size[1])), z = HYI_BITSW(HYI_LTW(HYI_MAXW(size[0], size[1]), size[2]));
    if ((z != 0u && z != HYI_ALLW) || (z == 0u && y != 0u && y != HYI_ALLW)) return false;
    HYI_FW largest = HYI_MAXW(HYI_MAXW(size[0], size[1]), size[2]);
    *group |= (z ? 2u : y ? 1u : 0u) << 3;
    return HYI_LEASTW(largest) >= 9.31322574615478515625e-10f;
}

/* hyi_aim_shear for all lanes. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_shear_packet)(hyi_packet *packet) {
    for (int half = 0; half < 2; half++) {
        HYI_FD t_by_z = HYI_DIVD(HYI_SETD(1.0), HYI_HALFD(HYI_LOADW(packet->direction[2]), half));
        for (int i = 0; i < 2; i++) HYI_STOREH(packet->shear[i], half, HYI_MULD(HYI_HALFD(HYI_LOADW(packet->direction[i]), half), t_by_z));
        HYI_STOREH(packet->inverse_z, half, t_by_z);
        HYI_STORED(packet->t_by_z + (uint32_t)half * (HYI_LANES / 2u), t_by_z);
    }
}

/* What packets and flights have in common of HYI_LANES rays, by their numbers; false: they are of several groups, unsound,
   or of uncommon size. o, inverse: by axis of space. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_load_rays)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_packet *packet,
                                                float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH]) {
    float d[3][HYI_PACKET_WIDTH], scale = bvh->scale;
    uint32_t axis[3];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyk_ray ray = hyi_load_ray(&rays[numbers[i]]);
        o[0][i] = ray.origin.x * scale;
        o[1][i] = ray.origin.y * scale;
        o[2][i] = ray.origin.z * scale;
        d[0][i] = ray.direction.x * scale;
        d[1][i] = ray.direction.y * scale;
        d[2][i] = ray.direction.z * scale;
        packet->t_min[i] = ray.t_min;
        packet->best_t[i] = ray.t_max;
    }
    if (!HYI_I(hyi_find_group)(d, &packet->group)) return false;
    HYI_FW t_min = HYI_LOADW(packet->t_min), t_max = HYI_LOADW(packet->best_t), limit = HYI_MINW(t_max, HYI_SETW(HYI_T_LIMIT)), zero = HYI_ZEROW();
    bool limits = HYI_BITSW(HYI_LEW(t_min, limit)) == HYI_ALLW && HYI_BITSW(HYI_LEW(t_min, t_max)) == HYI_ALLW;
    if (!limits || !HYI_I(hyi_all_within)(packet->t_min, FLT_MAX)) return false;
    hyi_group_axes(packet->group, axis);
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(d[a]);
        if (!HYI_I(hyi_all_within)(o[a], 1099511627776.0f)) return false;
        v = HYI_MAXW(HYI_MAXW(v, HYI_SUBW(zero, v)), HYI_SETW(HYI_STEADY));
        HYI_STOREW(inverse[a], HYI_DIVW(HYI_SETW(packet->group >> a & 1u ? -1.0f : 1.0f), v));
        HYI_STOREW(packet->origin[a], HYI_LOADW(o[axis[a]]));
        HYI_STOREW(packet->direction[a], HYI_LOADW(d[axis[a]]));
    }
    HYI_FW slack = HYI_SETW(4.0f * HYI_ULP);
    HYI_STOREW(packet->best_t, limit);
    HYI_STOREW(packet->t_near, HYI_SUBW(t_min, HYI_MULW(HYI_MAXW(t_min, HYI_SUBW(zero, t_min)), slack)));
    HYI_STOREW(packet->t_far, HYI_ADDW(limit, HYI_MULW(HYI_MAXW(limit, HYI_SUBW(zero, limit)), slack)));
    HYI_I(hyi_shear_packet)(packet);
    return true;
}

/* A packet of rays first, first + 1, ... of the swarm's; false: they are not alike, or not fit for one. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_rays)(const hyi_swarm *swarm, hyi_packet *packet, uint32_t first) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        packet->ray[i] = first + i;
        packet->instance[i] = packet->primitive[i] = HYK_NONE;
    }
    packet->count = HYI_LANES;
    return HYI_I(hyi_load_rays)(swarm->site.bvh, swarm->rays, packet->ray, packet, o, inverse) &&
           HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* hyi_aim_slabs for all lanes: where moved planes are met, by axis of space. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_offset_lanes)(const hyi_box *box, uint32_t group, float o[3][HYI_PACKET_WIDTH], float inverse[3][HYI_PACKET_WIDTH],
                                                   float near_offset[3][HYI_PACKET_WIDTH], float far_offset[3][HYI_PACKET_WIDTH]) {
    HYI_FW reach[3], zero = HYI_ZEROW();
    for (int a = 0; a < 3; a++) {
        HYI_FW below = HYI_SUBW(HYI_LOADW(o[a]), HYI_SETW(box->lower[a])), above = HYI_SUBW(HYI_SETW(box->upper[a]), HYI_LOADW(o[a]));
        reach[a] = HYI_MAXW(HYI_MAXW(below, HYI_SUBW(zero, below)), HYI_MAXW(above, HYI_SUBW(zero, above)));
    }
    for (int a = 0; a < 3; a++) {
        HYI_FW v = HYI_LOADW(o[a]), size = HYI_MAXW(v, HYI_SUBW(zero, v)), back = HYI_SUBW(zero, HYI_LOADW(inverse[a]));
        HYI_FW bound = HYI_ADDW(HYI_MULW(HYI_SETW(HYI_SLAB_BOUND), HYI_ADDW(reach[a], reach[group >> 3])), HYI_MULW(HYI_SETW(2.0f * HYI_ULP), size));
        bound = (group >> a & 1u) ? HYI_SUBW(zero, bound) : bound;
        HYI_STOREW(near_offset[a], HYI_MULW(HYI_ADDW(v, bound), back));
        HYI_STOREW(far_offset[a], HYI_MULW(HYI_SUBW(v, bound), back));
    }
}

/* Flights of HYI_LANES rays by their numbers; false: they must be begun one by one. */
HYI_FN HYI_TARGET bool HYI_I(hyi_begin_flights)(const hyi_bvh *bvh, const hyk_ray *rays, const uint32_t *numbers, hyi_flight *flights) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH], near_offset[3][HYI_PACKET_WIDTH], far_offset[3][HYI_PACKET_WIDTH];
    uint32_t plane[3][HYI_PACKET_WIDTH], axes[3][HYI_PACKET_WIDTH], none[HYI_PACKET_WIDTH] = {0}, axis[3];
    hyi_packet p;
    if (!HYI_I(hyi_load_rays)(bvh, rays, numbers, &p, o, inverse)) return false;
    HYI_I(hyi_offset_lanes)(&bvh->scaled, p.group, o, inverse, near_offset, far_offset);
    hyi_group_axes(p.group, axis);
    for (uint32_t a = 0; a < 3; a++) {
        for (uint32_t i = 0; i < HYI_LANES; i++) {
            plane[a][i] = 2u * a + (p.group >> a & 1u);
            axes[a][i] = axis[a];
        }
    }
    const void *boxes[16] = {inverse[0], inverse[1], inverse[2], near_offset[0], near_offset[1], near_offset[2], far_offset[0], far_offset[1], far_offset[2],
                             p.t_near, p.t_far, plane[0], plane[1], plane[2], p.inverse_z, p.best_t};
    const void *triangles[16] = {p.origin[0], p.origin[1], p.origin[2], p.shear[0], p.shear[1], axes[0], axes[1], axes[2],
                                 p.direction[0], p.direction[1], p.direction[2], none, none, none, none, none};
    HYI_LINES(boxes, (char *)flights + offsetof(hyi_flight, aim.inverse));
    HYI_LINES(triangles, (char *)flights + offsetof(hyi_flight, aim.origin));
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        hyi_flight *flight = &flights[i];
        flight->aim.t_by_z = p.t_by_z[i];
        flight->aim.unit = flight->aim.inverse_unit = 1.0;
        flight->best.t = p.best_t[i];
        flight->best.u = flight->best.v = 0.0f;
        flight->best.instance = flight->best.primitive = HYK_NONE;
        flight->t_min = p.t_min[i];
        flight->ray = &rays[numbers[i]];
    }
    return true;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_unpack_rays)(const hyi_swarm *swarm, const hyi_packet *packet, hyk_hit *hits, uint8_t *occluded) {
    for (uint32_t i = 0; i < packet->count; i++) {
        bool found = packet->instance[i] != HYK_NONE;
        if (occluded) {
            occluded[packet->ray[i]] = found ? 1 : 0;
            continue;
        }
        hyk_hit *hit = &hits[packet->ray[i]];
        double inverse = found ? hyi_rounded_double(1.0 / packet->weights[2][i]) : 0.0;
        hit->t = found ? packet->best_t[i] : -1.0f;
        hit->u = found ? (float)(packet->weights[0][i] * inverse) : 0.0f;
        hit->v = found ? (float)(packet->weights[1][i] * inverse) : 0.0f;
        hit->instance = packet->instance[i];
        hit->primitive = packet->primitive[i];
        hyi_locate_in_world(swarm->site.accel, &hit->instance, &hit->primitive);
    }
}

/* A packet of flights; lanes beyond the last repeat the first, and meet nothing. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_pack_flights)(const hyi_swarm *swarm, hyi_packet *packet, const uint32_t *rays, uint32_t count) {
    float o[3][HYI_PACKET_WIDTH], inverse[3][HYI_PACKET_WIDTH];
    for (uint32_t i = 0; i < HYI_LANES; i++) {
        const hyi_flight *flight = &swarm->flights[rays[i < count ? i : 0u]];
        const hyi_aim *aim = &flight->aim;
        if (aim->unit != 1.0) return false;
        for (int a = 0; a < 3; a++) {
            o[aim->axis[a]][i] = packet->origin[a][i] = aim->origin[a];
            packet->direction[a][i] = aim->direction[a];
            inverse[a][i] = aim->inverse[a];
        }
        packet->shear[0][i] = aim->shear[0];
        packet->shear[1][i] = aim->shear[1];
        packet->inverse_z[i] = aim->inverse_z;
        packet->t_by_z[i] = aim->t_by_z;
        packet->t_min[i] = flight->t_min;
        packet->t_near[i] = aim->t_near;
        packet->t_far[i] = i < count ? aim->t_far : -FLT_MAX;
        packet->best_t[i] = flight->best.t;
        packet->instance[i] = flight->best.instance;
        packet->primitive[i] = flight->best.primitive;
        packet->weights[2][i] = 0.0;
        packet->ray[i] = rays[i < count ? i : 0u];
    }
    packet->count = count;
    packet->group = hyi_aim_group(&swarm->flights[rays[0]].aim);
    return HYI_I(hyi_bound_packet)(&swarm->site.bvh->scaled, packet, o, inverse);
}

/* Sum 0 stands for a hit that is not the packet's own. */
HYI_INLINE void HYI_I(hyi_unpack_flights)(const hyi_swarm *swarm, const hyi_packet *packet) {
    for (uint32_t i = 0; i < packet->count; i++) {
        hyi_best *best = &swarm->flights[packet->ray[i]].best;
        best->instance = packet->instance[i];
        if (packet->weights[2][i] == 0.0) continue;
        double inverse = hyi_rounded_double(1.0 / packet->weights[2][i]);
        best->t = packet->best_t[i];
        best->u = (float)(packet->weights[0][i] * inverse);
        best->v = (float)(packet->weights[1][i] * inverse);
        best->primitive = packet->primitive[i];
    }
}
/* ---- many rays (expanded once for each instruction set)

   Lists hold numbers of flights, or of packets. Each list of a node's children has room for all of the node's. */

HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets);
HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count);

/* Keeps of a list the rays that have not met anything nearer than the box of child c since they were put on it; returns
   how many these are. Without a branch: it would be taken by chance. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_still_meet)(const hyi_swarm *swarm, const hyi_node *node, uint32_t c, uint32_t *list, uint32_t count) {
    float x = node->planes[swarm->near_plane[0]][c], y = node->planes[swarm->near_plane[1]][c], z = node->planes[swarm->near_plane[2]][c];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t ray = list[i];
        const hyi_aim *aim = &swarm->flights[ray].aim;
        float tx = x * aim->inverse[0] + aim->near_offset[0], ty = y * aim->inverse[1] + aim->near_offset[1], tz = z * aim->inverse[2] + aim->near_offset[2];
        float enter = tx > ty ? tx : ty;
        enter = tz > enter ? tz : enter;
        list[kept] = ray;
        kept += enter <= aim->t_far ? 1u : 0u;
    }
    return kept;
}

/* Puts each of count items on the lists of the children that it meets; nearest: the least t at which each child is entered. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal)(const hyi_swarm *swarm, const hyi_node *node, const uint32_t *list, uint32_t count,
                                           uint32_t *lists, uint32_t stride, uint32_t dealt[HYI_WIDTH], float nearest[HYI_WIDTH], bool packets) {
    HYI_I(hyi_planes) planes;
    HYI_F8 least = HYI_SET8(FLT_MAX);
    for (int a = 0; a < 3; a++) {
        planes.near_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a]]);
        planes.far_planes[a] = HYI_LOAD8(node->planes[swarm->near_plane[a] ^ 1u]);
    }
    for (uint32_t first = 0; first < count; first += HYI_DEAL) {
        uint32_t some = count - first < HYI_DEAL ? count - first : HYI_DEAL;
        HYI_MASKS masks;
        HYI_CLEAR_MASKS(masks);
        for (uint32_t i = 0; i < some; i++) {
            HYI_F8 enter;
            uint32_t item = list[first + i];
            HYI_M8 mask = packets ? HYI_I(hyi_meet_boxes_all)(&swarm->packets[item], &planes, &enter)
                                  : HYI_I(hyi_meet_boxes)(&swarm->flights[item].aim, planes.near_planes, planes.far_planes, &enter);
            least = HYI_MIN8_WHERE(least, mask, enter);
            uint32_t met = HYI_BITS8(mask);
            if (packets && swarm->packets[item].spread && hyi_count_bits(met) > 2u) met = HYI_I(hyi_meet_boxes_each)(swarm, &swarm->packets[item], node, met);
            masks.bytes[i] = (uint8_t)met;
        }
        HYI_I(hyi_deal_out)(list + first, &masks, lists, stride, dealt);
    }
    HYI_STORE8(nearest, least);
}

/* Orders all children by t, nearest first, without a branch: a child comes after as many as are nearer, or as near with a
   smaller number. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_order_children)(const float t[HYI_WIDTH], uint32_t order[HYI_WIDTH]) {
    HYI_F8 all = HYI_LOADU8(t);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        HYI_F8 one = HYI_SET8(t[c]);
        order[hyi_count_bits(HYI_BITS8(HYI_LT8(all, one)) | (HYI_BITS8(HYI_LE8(all, one)) & ((1u << c) - 1u)))] = c;
    }
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_node)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    const hyi_node *node = &swarm->site.bvh->nodes[at];
    uint32_t stride = (count + 15u) & ~15u, dealt[HYI_WIDTH] = {0}, order[HYI_WIDTH], mask = 0;
    float nearest[HYI_WIDTH];
    HYI_I(hyi_deal)(swarm, node, list, count, space, stride, dealt, nearest, packets);
    for (uint32_t c = 0; c < HYI_WIDTH; c++) {
        mask |= (dealt[c] ? 1u : 0u) << c;
        nearest[c] = dealt[c] ? nearest[c] : FLT_MAX; /* met by the bounds of a packet, but by none of its rays */
    }
    if (swarm->site.bvh->rows)
        for (uint32_t left = mask; left; left &= left - 1u) hyi_prefetch_child(swarm->site.bvh, node->child[hyi_lowest_bit(left)]);
    HYI_I(hyi_order_children)(nearest, order);
    uint32_t children = hyi_count_bits(mask);
    for (uint32_t i = 0; i < children; i++) {
        uint32_t c = order[i];
        bool leaf = swarm->site.bvh->rows && hyi_child_is_leaf(node->child[c]);
        if (leaf && packets) HYI_I(hyi_list_leaf_packets)(swarm, node->child[c], space + c * stride, dealt[c], node, c);
        else if (leaf) HYI_I(hyi_list_leaf_rays)(swarm, node->child[c], space + c * stride, HYI_I(hyi_still_meet)(swarm, node, c, space + c * stride, dealt[c]));
        else HYI_I(hyi_list_visit)(swarm, node->child[c], space + c * stride, dealt[c], space + HYI_WIDTH * stride, packets);
    }
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_rays)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, false);
}

HYI_FN HYI_TARGET void HYI_I(hyi_list_node_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space) {
    HYI_I(hyi_list_node)(swarm, at, list, count, space, true);
}

/* ---- leaves */

HYI_FN HYI_TARGET void HYI_I(hyi_list_leaf_rays)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (HYI_I(hyi_offer_leaf)(&swarm->site, flight, leaf, swarm->any) && swarm->any) hyi_flight_stop(flight);
    }
}

/* ---- instances */

HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any);

/* The rays of a list go through what a box of the tree over instances stands for. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_enter)(const hyi_swarm *swarm, uint32_t leaf, const uint32_t *list, uint32_t count, uint32_t *space) {
    hyi_site site = hyi_site_of_item(swarm->site.accel, swarm->site.bvh->ids[hyi_leaf_first(leaf)]);
    hyi_flight *below = swarm->stream->flights + swarm->stream->capacity;
    uint32_t entered = 0, *from = space;
    for (uint32_t i = 0; i < count; i++) {
        if (swarm->flights[list[i]].aim.t_far == -FLT_MAX) continue;
        if (hyi_flight_enter(&below[entered], &swarm->flights[list[i]], &site)) from[entered++] = list[i];
    }
    HYI_I(hyi_run_flights)(&site, swarm->stream, entered, space + ((entered + 15u) & ~15u), true, swarm->any);
    for (uint32_t i = 0; i < entered; i++) {
        hyi_flight *above = &swarm->flights[from[i]];
        if (hyi_flight_return(above, &below[i]) && swarm->any) hyi_flight_stop(above);
    }
}

/* ---- the way down */

HYI_INLINE HYI_TARGET void HYI_I(hyi_list_one_by_one)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight *flight = &swarm->flights[list[i]];
        if (flight->aim.t_far == -FLT_MAX) continue;
        HYI_I(hyi_walk_scene)(&swarm->site, flight, at, swarm->any);
        if (swarm->any && flight->best.instance != HYK_NONE) hyi_flight_stop(flight);
    }
}

/* A list of packets through a node: one at a time where more would leave no room for lists of one on every level below. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_list_packets)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, size_t room) {
    bool together = room >= (size_t)HYI_WIDTH * (count + 15u) + HYI_LIST_RESERVE;
    uint32_t some = together ? count : 1u;
    for (uint32_t first = 0; first < count; first += some) HYI_I(hyi_list_node_packets)(swarm, at, list + first, some, space);
}

/* Sends a list through the child at; space: free memory for lists. Where that is short, or the list is, rays go one by
   one. Packets are only in trees of triangles. */
HYI_FN HYI_TARGET void HYI_I(hyi_list_visit)(const hyi_swarm *swarm, uint32_t at, const uint32_t *list, uint32_t count, uint32_t *space, bool packets) {
    size_t room = (size_t)(swarm->stream->lists + swarm->stream->list_count - space);
    bool fits = room >= (size_t)(HYI_WIDTH + 2u) * (count + 16u), leaf = hyi_child_is_leaf(at);
    if (packets) {
        if (leaf) HYI_I(hyi_list_leaf_packets)(swarm, at, list, count, NULL, 0);
        else HYI_I(hyi_list_packets)(swarm, at, list, count, space, room);
    } else if (leaf && swarm->site.bvh->rows) {
        HYI_I(hyi_list_leaf_rays)(swarm, at, list, count);
    } else if (leaf && fits) {
        HYI_I(hyi_list_enter)(swarm, at, list, count, space);
    } else if (fits && count >= HYI_LIST_LEAST) {
        HYI_I(hyi_list_node_rays)(swarm, at, list, count, space);
    } else {
        HYI_I(hyi_list_one_by_one)(swarm, at, list, count);
    }
}

/* ---- all rays of a slice */

/* Sends count packets on their way, those of a group together. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_packets)(hyi_swarm *swarm, uint32_t count, uint32_t *space) {
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)swarm->packets[i].group;
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        if (first[g + 1] == first[g]) continue;
        hyi_set_group(swarm, g);
        HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, order + first[g], first[g + 1] - first[g], space + room, true);
    }
}

/* Packets of the alike among a group's flights; the others come to stand first in rays, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike)(hyi_swarm *swarm, uint32_t *rays, uint32_t count, uint32_t *space) {
    uint32_t made = 0, others = 0;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some > HYI_LANES / 2u && HYI_I(hyi_pack_flights)(swarm, &swarm->packets[made], rays + first, some)) made++;
        else
            for (uint32_t i = 0; i < some; i++) rays[others++] = rays[first + i];
    }
    for (uint32_t i = 0; i < made; i++) space[i] = i;
    if (made) HYI_I(hyi_list_visit)(swarm, swarm->site.bvh->root, space, made, space + ((made + 15u) & ~15u), true);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_flights)(swarm, &swarm->packets[i]);
    return others;
}

/* Sends the first count flights (deep: of those in instances) through the tree of site. */
HYI_FN HYI_TARGET void HYI_I(hyi_run_flights)(const hyi_site *site, hyi_ray_stream *stream, uint32_t count, uint32_t *space, bool deep, bool any) {
    hyi_swarm swarm;
    uint32_t room = (count + 15u) & ~15u, first[HYI_RAY_GROUPS + 1], *order = space;
    uint8_t *keys = (uint8_t *)(void *)(space + room);
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = NULL;
    swarm.flights = stream->flights + (deep ? stream->capacity : 0u);
    swarm.packets = stream->packets + (deep ? stream->packet_share : 0u);
    swarm.any = any;
    if (count < HYI_LIST_LEAST || (size_t)(stream->lists + stream->list_count - space) < (size_t)12u * (room + 16u) + HYI_LIST_RESERVE) {
        for (uint32_t i = 0; i < count; i++) HYI_I(hyi_walk_scene)(site, &swarm.flights[i], site->bvh->root, any);
        return;
    }
    for (uint32_t i = 0; i < count; i++) keys[i] = (uint8_t)hyi_aim_group(&swarm.flights[i].aim);
    hyi_group(keys, count, order, first);
    for (uint32_t g = 0; g < HYI_RAY_GROUPS; g++) {
        uint32_t *rays = order + first[g], some = first[g + 1] - first[g];
        hyi_set_group(&swarm, g);
        if (deep && some) some = HYI_I(hyi_run_alike)(&swarm, rays, some, space + room);
        if (some) HYI_I(hyi_list_visit)(&swarm, site->bvh->root, rays, some, space + room, false);
    }
    for (uint32_t i = 0; i < count && !any && site->bvh->rows; i++) hyi_settle(site, &swarm.flights[i]);
}

/* Packets of those among count rays that are alike; numbers and keys of the others go to others and keys, and are counted. */
HYI_FN HYI_TARGET uint32_t HYI_I(hyi_run_alike_rays)(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits,
                                                     uint8_t *occluded, uint32_t count, uint32_t *others, uint8_t *keys) {
    hyi_swarm swarm;
    uint32_t made = 0, rest = 0;
    swarm.site = *site;
    swarm.stream = stream;
    swarm.rays = rays;
    swarm.flights = NULL;
    swarm.packets = stream->packets;
    swarm.any = occluded != NULL;
    for (uint32_t first = 0; first < count; first += HYI_LANES) {
        uint32_t some = count - first < HYI_LANES ? count - first : HYI_LANES;
        if (some == HYI_LANES && HYI_I(hyi_pack_rays)(&swarm, &swarm.packets[made], first)) {
            made++;
            continue;
        }
        for (uint32_t i = first; i < first + some; i++) {
            others[rest] = i;
            keys[rest++] = hyi_direction_key(hyi_load_ray(&rays[i]).direction);
        }
    }
    if (made) HYI_I(hyi_run_packets)(&swarm, made, stream->lists);
    for (uint32_t i = 0; i < made; i++) HYI_I(hyi_unpack_rays)(&swarm, &swarm.packets[i], hits, occluded);
    return rest;
}
/* The words of one instruction set end here. */
#undef HYI_ADD2
#undef HYI_ADD4
#undef HYI_ADD8
#undef HYI_ADDD
#undef HYI_ADDW
#undef HYI_ALLW
#undef HYI_ALWAYS_EXACT
#undef HYI_AND4
#undef HYI_AND8
#undef HYI_ANDW
#undef HYI_AS_FLOATS
#undef HYI_BITS2_2
#undef HYI_BITS4_4
#undef HYI_BITS8
#undef HYI_BITSW
#undef HYI_CHOOSE4
#undef HYI_CLEAR_MASKS
#undef HYI_D2
#undef HYI_DEAL
#undef HYI_DIV2
#undef HYI_DIV4
#undef HYI_DIV8
#undef HYI_DIVD
#undef HYI_DIVW
#undef HYI_F4
#undef HYI_F8
#undef HYI_FD
#undef HYI_FW
#undef HYI_GREATEST4
#undef HYI_GREATESTW
#undef HYI_HALFD
#undef HYI_HIGH_AS_DOUBLES
#undef HYI_I
#undef HYI_LANES
#undef HYI_LINES
#undef HYI_LE4
#undef HYI_LE8
#undef HYI_LEAST4
#undef HYI_LEASTW
#undef HYI_LEW
#undef HYI_LOAD4
#undef HYI_LOAD4_ALIGNED
#undef HYI_LOAD8
#undef HYI_LOADD
#undef HYI_LOAD2
#undef HYI_LOADU8
#undef HYI_LOADW
#undef HYI_LOW_AS_DOUBLES
#undef HYI_LT2
#undef HYI_LT4
#undef HYI_LT8
#undef HYI_LTD
#undef HYI_LTW
#undef HYI_M4
#undef HYI_M8
#undef HYI_MAD4
#undef HYI_MAD8
#undef HYI_MASKS
#undef HYI_MAX2
#undef HYI_MAX4
#undef HYI_MAX8
#undef HYI_MAXD
#undef HYI_MAXW
#undef HYI_MIN2
#undef HYI_MIN4
#undef HYI_MIN8
#undef HYI_MIN8_WHERE
#undef HYI_MIND
#undef HYI_MINW
#undef HYI_MUL2
#undef HYI_MUL4
#undef HYI_MUL8
#undef HYI_MULD
#undef HYI_MULW
#undef HYI_MW
#undef HYI_OR4
#undef HYI_OR8
#undef HYI_ORW
#undef HYI_PIN2
#undef HYI_PIN4
#undef HYI_PIN8
#undef HYI_PIND
#undef HYI_PINW
#undef HYI_SET2
#undef HYI_SET4
#undef HYI_SET8
#undef HYI_SETD
#undef HYI_SETW
#undef HYI_STORE2
#undef HYI_STORE4
#undef HYI_STORE8
#undef HYI_STORED
#undef HYI_STOREH
#undef HYI_STOREW
#undef HYI_SUB2
#undef HYI_SUB4
#undef HYI_SUB8
#undef HYI_SUBD
#undef HYI_SUBW
#undef HYI_TARGET
#undef HYI_ZERO8
#undef HYI_ZEROW

#endif /* HYI_NEON */
#endif /* HYI_BVH_NEON_H */

/* >>bvh-trace: what the renderer calls: batches of rays against surfaces, then against light shapes */
#ifndef HYI_BVH_TRACE_H
#define HYI_BVH_TRACE_H

/* ---- by instruction set */

#if HYI_X86
#define HYI_VECTOR_CASES(name, arguments)                  \
    case HYDRA_ISA_AVX512: name##_avx512 arguments; break; \
    case HYDRA_ISA_AVX2: name##_avx2 arguments; break;     \
    case HYDRA_ISA_SSE42: name##_sse42 arguments; break;
#elif HYI_NEON
#define HYI_VECTOR_CASES(name, arguments) \
    case HYDRA_ISA_NEON: name##_neon arguments; break;
#else
#define HYI_VECTOR_CASES(name, arguments)
#endif

/* Calls name for an instruction set; for one that has vectors. */
#define HYI_DISPATCH(isa, name, arguments)        \
    switch (isa) {                                \
        HYI_VECTOR_CASES(name, arguments)         \
    default: name##_scalar arguments; break;      \
    }
#if HYI_X86 || HYI_NEON
#define HYI_DISPATCH_VECTOR(isa, name, arguments) \
    switch (isa) {                                \
        HYI_VECTOR_CASES(name, arguments)         \
    default: break;                               \
    }
#else /* without vectors no stream has a capacity, and this is never reached */
HYI_INLINE void hyi_no_vectors(const void *site, ...) { (void)site; }
#define HYI_DISPATCH_VECTOR(isa, name, arguments) hyi_no_vectors arguments;
#endif

/* ---- memory for streams */

#define HYI_STREAM_LISTS 40u /* words a ray: eight lists of all at the root, fewer at each level below */

/* Rays a packet. */
HYI_INLINE uint32_t hyi_isa_lanes(hydra_isa isa) { return isa == HYDRA_ISA_AVX512 ? 16u : 8u; }

/* Sizes for calls of about count rays; capacity 0: none are needed. */
HYI_INLINE hyi_ray_stream hyi_plan_ray_stream(const hyi_accel *accel, size_t count) {
    hyi_ray_stream stream;
    uint32_t sorted = count < HYI_STREAM_SORTED ? (uint32_t)count : HYI_STREAM_SORTED;
    memset(&stream, 0, sizeof stream);
    if (accel->isa == HYDRA_ISA_SCALAR || accel->empty || count < HYI_STREAM_LEAST) return stream;
    stream.levels = accel->single ? 1u : 2u;
    stream.capacity = count < HYI_STREAM_RAYS ? ((uint32_t)count + 15u) & ~15u : HYI_STREAM_RAYS;
    stream.packet_share = stream.capacity / hyi_isa_lanes(accel->isa) + HYI_RAY_GROUPS;
    stream.sorted = sorted;
    stream.list_count = (size_t)stream.capacity * HYI_STREAM_LISTS + 2u * HYI_LIST_RESERVE;
    return stream;
}

/* Whole cache lines: flights begin after them. */
HYI_INLINE size_t hyi_packets_bytes(const hyi_ray_stream *stream) {
    return (stream->levels * stream->packet_share * sizeof *stream->packets + 63u) & ~(size_t)63u;
}

HYI_INLINE size_t hyi_ray_stream_bytes(const hyi_ray_stream *stream) {
    if (stream->capacity == 0) return 0;
    return hyi_packets_bytes(stream) + stream->levels * stream->capacity * sizeof *stream->flights +
           (2u * (size_t)stream->sorted + stream->list_count) * sizeof(uint32_t) + stream->sorted;
}

HYI_FN void hyi_ray_stream_free(hydra_context *context, hyi_ray_stream *stream) {
    hyi_free_bytes(context, stream->packets, hyi_ray_stream_bytes(stream));
    memset(stream, 0, sizeof *stream);
}

/* One block. On failure the capacity is 0, and the stream good for rays one by one; nothing is said in the context's text. */
HYI_FN hydra_result hyi_ray_stream_alloc(hydra_context *context, const hyi_accel *accel, size_t count, hyi_ray_stream *stream) {
    void *block;
    *stream = hyi_plan_ray_stream(accel, count);
    hydra_result result = hyi_try_alloc(context, hyi_ray_stream_bytes(stream), &block);
    if (result != HYDRA_OK) memset(stream, 0, sizeof *stream);
    if (stream->capacity == 0) return result;
    stream->packets = (hyi_packet *)block;
    stream->flights = (hyi_flight *)(void *)((char *)block + hyi_packets_bytes(stream));
    stream->lists = (uint32_t *)(void *)(stream->flights + stream->levels * stream->capacity);
    stream->order = stream->lists + stream->list_count;
    stream->keys = (uint8_t *)(void *)(stream->order + 2u * stream->sorted);
    return HYDRA_OK;
}

/* ---- one by one */

HYI_INLINE void hyi_tell(const hyi_accel *accel, const hyi_flight *flight, hyk_hit *hit, uint8_t *occluded) {
    if (occluded) *occluded = flight->best.instance != HYK_NONE;
    else hyi_answer(accel, &flight->best, hit);
}

/* The tracing functions say whether all rays were sound. */
HYI_INLINE bool hyi_was_sound(const hyk_ray *at) {
    hyk_ray ray = hyi_load_ray(at);
    return hyi_ray_is_sound(&ray);
}

HYI_FN bool hyi_trace_singles(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    hyi_site site = hyi_first_site(accel);
    bool sound = true;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        if (hyi_flight_begin(&flight, site.bvh, &rays[i], FLT_MAX)) {
            HYI_DISPATCH(accel->isa, hyi_walk_scene, (&site, &flight, site.bvh->root, occluded != NULL))
        } else {
            sound = hyi_was_sound(&rays[i]) && sound;
        }
        hyi_tell(accel, &flight, hits ? &hits[i] : NULL, occluded ? &occluded[i] : NULL);
    }
    return sound;
}

/* ---- streams */

/* Begins the flights of some rays one by one; those that meet nothing are answered at once. Returns how many fly. */
HYI_FN uint32_t hyi_begin_each(const hyi_site *site, hyi_flight *flights, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded,
                               const uint32_t *order, uint32_t count, bool *sound) {
    uint32_t flying = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t k = order[i];
        if (hyi_flight_begin(&flights[flying], site->bvh, &rays[k], FLT_MAX)) {
            flying++;
        } else {
            *sound = hyi_was_sound(&rays[k]) && *sound;
            hyi_tell(site->accel, &flights[flying], hits ? &hits[k] : NULL, occluded ? &occluded[k] : NULL);
        }
    }
    return flying;
}

/* count rays, at most capacity, by their numbers in order. */
HYI_FN bool hyi_trace_slice(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded,
                            const uint32_t *order, uint32_t count) {
    uint32_t flying = 0, lanes = hyi_isa_lanes(site->accel->isa);
    bool sound = true;
    for (uint32_t first = 0; first < count; first += lanes) {
        uint32_t some = count - first < lanes ? count - first : lanes;
        bool together = false;
        for (uint32_t i = first + lanes; i < count && i < first + 2u * lanes; i++) hyi_prefetch(&rays[order[i]]);
        if (some == lanes && site->bvh->rows)
            HYI_DISPATCH_VECTOR(site->accel->isa, together = hyi_begin_flights, (site->bvh, rays, order + first, stream->flights + flying))
        if (together) flying += lanes;
        else flying += hyi_begin_each(site, stream->flights + flying, rays, hits, occluded, order + first, some, &sound);
    }
    HYI_DISPATCH_VECTOR(site->accel->isa, hyi_run_flights, (site, stream, flying, stream->lists, false, occluded != NULL))
    for (uint32_t i = 0; i < flying; i++) {
        const hyi_flight *flight = &stream->flights[i];
        size_t k = (size_t)(flight->ray - rays);
        hyi_tell(site->accel, flight, hits ? &hits[k] : NULL, occluded ? &occluded[k] : NULL);
    }
    return sound;
}

/* Rays by their numbers in others: sorted by direction, then a slice at a time. sorted: room for as many. */
HYI_FN bool hyi_trace_others(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded,
                             const uint32_t *others, uint32_t *sorted, uint32_t count) {
    uint32_t starts[HYI_RAY_GROUPS + 1];
    bool sound = true;
    hyi_group(stream->keys, count, sorted, starts);
    for (uint32_t i = 0; i < count; i++) sorted[i] = others[sorted[i]];
    for (uint32_t at = 0; at < count; at += stream->capacity) {
        uint32_t slice = count - at < stream->capacity ? count - at : stream->capacity;
        sound = hyi_trace_slice(site, stream, rays, hits, occluded, sorted + at, slice) && sound;
    }
    return sound;
}

/* Up to HYI_STREAM_SORTED rays: the alike go in packets, the rest is listed in others, with its keys, and counted. */
HYI_FN uint32_t hyi_trace_alike(const hyi_site *site, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded,
                                uint32_t count, uint32_t *others) {
    uint32_t rest = 0;
    for (uint32_t first = 0; first < count; first += stream->capacity) {
        uint32_t some = count - first < stream->capacity ? count - first : stream->capacity, left = 0;
        HYI_DISPATCH_VECTOR(site->accel->isa, left = hyi_run_alike_rays,
                     (site, stream, rays + first, hits ? hits + first : NULL, occluded ? occluded + first : NULL, some, others + rest, stream->keys + rest))
        for (uint32_t i = 0; i < left; i++) others[rest + i] += first;
        rest += left;
    }
    return rest;
}

HYI_FN bool hyi_trace_stream(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    hyi_site site = hyi_first_site(accel);
    uint32_t room = stream->sorted, *others = stream->order, *sorted = others + room;
    bool sound = true;
    for (uint32_t first = 0, some; first < count; first += some) {
        hyk_hit *at_hits = hits ? hits + first : NULL;
        uint8_t *at_occluded = occluded ? occluded + first : NULL;
        some = count - first < room ? count - first : room;
        uint32_t rest = some;
        if (site.bvh->rows) rest = hyi_trace_alike(&site, stream, rays + first, at_hits, at_occluded, some, others);
        else
            for (uint32_t i = 0; i < some; i++) {
                others[i] = i;
                stream->keys[i] = hyi_direction_key(hyi_load_ray(&rays[first + i]).direction);
            }
        sound = hyi_trace_others(&site, stream, rays + first, at_hits, at_occluded, others, sorted, rest) && sound;
    }
    return sound;
}

HYI_FN bool hyi_trace_all(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    if (stream && stream->capacity && count >= HYI_STREAM_LEAST) return hyi_trace_stream(accel, stream, rays, hits, occluded, count);
    return hyi_trace_singles(accel, rays, hits, occluded, count);
}

HYI_FN bool hyi_trace_nothing(const hyk_ray *rays, hyk_hit *hits, uint8_t *occluded, uint32_t count) {
    bool sound = true;
    for (uint32_t i = 0; i < count; i++) {
        sound = hyi_was_sound(&rays[i]) && sound;
        if (occluded) {
            occluded[i] = 0;
            continue;
        }
        hits[i].t = -1.0f;
        hits[i].u = hits[i].v = 0.0f;
        hits[i].instance = hits[i].primitive = HYK_NONE;
    }
    return sound;
}

/* Closest hits of count rays on triangles: instance HYK_NONE and t -1 on a miss. Ties: smallest instance,
   then primitive. Light shapes are not looked at. stream: NULL or memory that no one else uses meanwhile.
   Rays are read by hyi_load_ray alone: they may be the caller's hydra_ray. Those that are not sound meet
   nothing; false: there were some. */
HYI_FN bool hyi_trace_closest(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, hyk_hit *hits, uint32_t count) {
    return accel->empty ? hyi_trace_nothing(rays, hits, NULL, count) : hyi_trace_all(accel, stream, rays, hits, NULL, count);
}

/* occluded[i] is set to 0 or 1. Light shapes are not looked at. */
HYI_FN bool hyi_trace_any(const hyi_accel *accel, hyi_ray_stream *stream, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    return accel->empty ? hyi_trace_nothing(rays, NULL, occluded, count) : hyi_trace_all(accel, stream, rays, NULL, occluded, count);
}

/* ---- light shapes: few, so one walk at a time does */

typedef struct hyi_shape_visit {
    const hyi_accel *accel;
    bool skip_hidden, any;
} hyi_shape_visit;

HYI_FN bool hyi_visit_shape(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_shape_visit *visit = (const hyi_shape_visit *)argument;
    uint32_t index = visit->accel->shape_lights[item];
    const hyk_light *light = &visit->accel->view->lights[index];
    if (visit->skip_hidden && (light->flags & HYK_LIGHT_HIDDEN)) return false;
    float t = hyk_intersect_shape(*light, hyi_load_ray(flight->ray));
    if (!(t >= flight->t_min && t <= flight->best.t && t >= 0.0f && hyi_beats(&flight->best, t, HYK_HIT_SHAPE, index))) return false;
    flight->best.t = t;
    flight->best.u = flight->best.v = 0.0f;
    flight->best.instance = HYK_HIT_SHAPE;
    flight->best.primitive = index;
    hyi_aim_limit(&flight->aim, t);
    return visit->any;
}

/* Whether a shape beats limit, the best that is known; the answer is then in flight->best. */
HYI_FN bool hyi_meet_shapes(hyi_shape_visit *visit, hyi_flight *flight, const hyk_ray *ray, const hyi_best *limit) {
    const hyi_bvh *shapes = visit->accel->shapes;
    if (!hyi_flight_begin(flight, shapes, ray, limit->t)) return false;
    flight->best = *limit;
    HYI_DISPATCH(visit->accel->isa, hyi_walk_boxes, (shapes, flight, shapes->root, hyi_visit_shape, visit))
    return flight->best.instance == HYK_HIT_SHAPE;
}

/* Replaces hits[i] where a light shape is nearer: instance HYK_HIT_SHAPE, primitive the light, u = v = 0.
   skip_hidden: lights flagged HYK_LIGHT_HIDDEN are not seen. */
HYI_FN void hyi_trace_shapes_closest(const hyi_accel *accel, const hyk_ray *rays, hyk_hit *hits, uint32_t count, bool skip_hidden) {
    hyi_shape_visit visit;
    visit.accel = accel;
    visit.skip_hidden = skip_hidden;
    visit.any = false;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        hyi_best limit;
        limit.t = hits[i].instance == HYK_NONE ? hyi_finite_limit(hyi_load_ray(&rays[i]).t_max) : hits[i].t;
        limit.u = hits[i].u;
        limit.v = hits[i].v;
        limit.instance = hits[i].instance;
        limit.primitive = hits[i].primitive;
        if (hyi_meet_shapes(&visit, &flight, &rays[i], &limit)) hyi_answer(accel, &flight.best, &hits[i]);
    }
}

/* Sets occluded[i] to 1 where a shape lies on the ray; rays already occluded are skipped. */
HYI_FN void hyi_trace_shapes_any(const hyi_accel *accel, const hyk_ray *rays, uint8_t *occluded, uint32_t count) {
    hyi_shape_visit visit;
    visit.accel = accel;
    visit.skip_hidden = false;
    visit.any = true;
    if (!accel->shapes) return;
    for (uint32_t i = 0; i < count; i++) {
        hyi_flight flight;
        hyi_best limit;
        limit.t = hyi_finite_limit(hyi_load_ray(&rays[i]).t_max);
        limit.u = limit.v = 0.0f;
        limit.instance = limit.primitive = HYK_NONE;
        if (!occluded[i] && hyi_meet_shapes(&visit, &flight, &rays[i], &limit)) occluded[i] = 1;
    }
}

#endif /* HYI_BVH_TRACE_H */

/* >>scene: what a scene holds, and its life */
#ifndef HYI_SCENE_H
#define HYI_SCENE_H

typedef struct hyi_texture_slot {
    hyk_texture record;
    uint32_t *texels;
    size_t words;
    float mean[4]; /* of all texels, linear */
} hyi_texture_slot;

/* How good a tree over triangles is: see hyi_bvh_cost. */
typedef struct hyi_quality {
    float cost, cost_when_built;
    bool refitted;
} hyi_quality;

/* A tree that waits for a commit that can use it. */
typedef struct hyi_loaded_tree {
    hyi_tree_record record;
    hyi_bvh bvh; /* without rows; empty: it was taken, or refused */
} hyi_loaded_tree;

/* The arrays belong to the scene. */
typedef struct hyi_mesh_slot {
    bool alive, instanced_only, dynamic;
    bool built;    /* bvh is there: instances and dynamic meshes have one of their own */
    bool moved;    /* bvh is that of other positions */
    bool in_world; /* part of the scene's world tree as it stands */
    hydra_build build; /* FAST or BEST */
    uint32_t material; /* id; 0: the grey that needs no desc */
    uint32_t vertex_count, triangle_count;
    float *positions, *normals, *uvs;
    uint32_t *indices, *triangle_materials; /* material ids */
    uint32_t *light_slots;  /* made by commit where only some triangles emit */
    uint32_t emitter_count; /* emitting triangles under the mesh's own materials */
    hyi_bvh bvh;
    hyi_quality quality;
} hyi_mesh_slot;

typedef struct hyi_instance_slot {
    bool alive;
    uint32_t mesh, material; /* slot; id, HYK_NONE: the mesh's own */
    float transform[12];
    float inverse[12];
    bool identity, mirrored;
} hyi_instance_slot;

typedef struct hyi_light_slot {
    bool alive;
    hyk_light record;
} hyi_light_slot;

/* What changed since the last commit. */
#define HYI_DIRTY_MESHES 1u
#define HYI_DIRTY_PLACEMENT 2u
#define HYI_DIRTY_MATERIALS 4u
#define HYI_DIRTY_LIGHTS 8u
#define HYI_DIRTY_ENVIRONMENT 16u
#define HYI_DIRTY_ALL 31u

struct hydra_scene {
    hydra_context *context;
    void *device; /* the backend's */
    uint32_t renders_living;
    hydra_result pending; /* of the first add that failed since the last commit */
    char pending_text[sizeof ((hydra_context *)0)->error];
    const char *editing;  /* the call that is under way, for that text */
    uint32_t dirty;

    hyi_texture_slot *textures;
    hyk_material *materials; /* of id 1, 2, ... */
    hyi_mesh_slot *meshes;
    hyi_instance_slot *instances;
    hyi_light_slot *lights;
    size_t texture_count, texture_capacity, material_count, material_capacity, mesh_count, mesh_capacity;
    size_t instance_count, instance_capacity, light_count, light_capacity;

    float environment_color[3], environment_rotation;
    float *environment_texels;
    uint32_t environment_width, environment_height;
    bool environment_set;

    hyi_loaded_tree *loaded; /* until the next commit that succeeds */
    size_t loaded_count, loaded_capacity;

    /* Made by commit. */
    hyk_material *view_materials; /* by id; 0 is the default */
    hyk_texture *view_textures;
    const uint32_t **view_texels;
    hyk_mesh *view_meshes;
    hyk_mesh_arrays *view_arrays;
    hyi_bvh *view_bvhs; /* by mesh: copies of the slots' headers, the nodes are the slots' */
    uint8_t *view_alpha;
    size_t view_mesh_count, view_material_count, view_texture_count;
    hyk_instance *placed;
    uint32_t *placed_ids; /* hydra_instance id of each, 0: a mesh by itself */
    size_t placed_count;
    hyi_bvh world;         /* over the first world_count of placed: unmoved and not dynamic */
    uint32_t *world_first; /* of each, its first triangle in world */
    size_t world_count;
    bool world_stale;      /* a mesh left it, or moved */
    hyi_quality world_quality;
    hyi_bvh top;
    hyk_light *all_lights;
    uint32_t *light_ids; /* hydra_light id of each, 0: a triangle */
    size_t all_light_count;
    hyk_light_node *light_nodes;
    uint32_t light_node_count;
    uint32_t *shape_lights;
    uint32_t shape_count;
    hyi_bvh shapes;
    float *environment_cdf;
    size_t environment_cdf_count;
    float *energy_tables;
    size_t energy_table_count;
    hyk_scene_view view;
    hyi_accel accel;
    hydra_scene_info info;
};

/* Ends an add or update that failed: commit will report the first of them. */
HYI_FN hydra_result hyi_reject(hydra_scene *scene, hydra_result result) {
    if (result != HYDRA_OK && scene->pending == HYDRA_OK) {
        scene->pending = result;
        snprintf(scene->pending_text, sizeof scene->pending_text, "%.400s (in %.100s)", scene->context->error, scene->editing);
    }
    return result;
}

/* Every edit starts here. */
HYI_FN hydra_result hyi_scene_editable(hydra_scene *scene, const void *desc, const char *what) {
    if (!scene) return HYDRA_ERROR_NULL;
    if (scene->renders_living) return hyi_fail(scene->context, HYDRA_ERROR_BUSY, "%s: %u renders of the scene are alive", what, scene->renders_living);
    scene->editing = what;
    if (!desc) return hyi_reject(scene, hyi_fail(scene->context, HYDRA_ERROR_NULL, "%s: the desc", what));
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_committed(const hydra_scene *scene) {
    if (!scene) return HYDRA_ERROR_NULL;
    if (scene->dirty) return hyi_fail(scene->context, HYDRA_ERROR_NOT_COMMITTED, "call hydra_scene_commit first");
    return HYDRA_OK;
}

HYDRA_API hydra_scene *hydra_scene_create(hydra_context *context) {
    if (!context) return NULL;
    hydra_scene *scene;
    if (hyi_alloc_array(context, &scene, 1) != HYDRA_OK) return NULL;
    memset(scene, 0, sizeof *scene);
    scene->context = context;
    scene->dirty = HYI_DIRTY_ALL;
    context->scenes_living++;
    return scene;
}

HYI_FN void hyi_mesh_release(hydra_context *context, hyi_mesh_slot *mesh) {
    size_t vertices = mesh->vertex_count, triangles = mesh->triangle_count;
    hyi_free_array(context, &mesh->positions, 3 * vertices);
    hyi_free_array(context, &mesh->normals, 3 * vertices);
    hyi_free_array(context, &mesh->uvs, 2 * vertices);
    hyi_free_array(context, &mesh->indices, 3 * triangles);
    hyi_free_array(context, &mesh->triangle_materials, triangles);
    hyi_free_array(context, &mesh->light_slots, triangles);
    hyi_bvh_free(context, &mesh->bvh);
    memset(mesh, 0, sizeof *mesh);
}

/* The parts of the committed state, freed one by one so that commit can renew them apart. */
HYI_FN void hyi_free_tables(hydra_scene *scene) {
    hydra_context *context = scene->context;
    hyi_free_array(context, &scene->view_materials, scene->view_material_count);
    hyi_free_array(context, &scene->view_textures, scene->view_texture_count);
    hyi_free_bytes(context, (void *)scene->view_texels, scene->view_texture_count * sizeof *scene->view_texels);
    scene->view_texels = NULL;
    hyi_free_array(context, &scene->energy_tables, scene->energy_table_count);
    scene->view_material_count = scene->view_texture_count = scene->energy_table_count = 0;
}

HYI_FN void hyi_free_placement(hydra_scene *scene) {
    hydra_context *context = scene->context;
    hyi_free_array(context, &scene->view_meshes, scene->view_mesh_count);
    hyi_free_array(context, &scene->view_arrays, scene->view_mesh_count);
    hyi_free_array(context, &scene->view_bvhs, scene->view_mesh_count);
    hyi_free_array(context, &scene->view_alpha, scene->view_mesh_count);
    hyi_free_array(context, &scene->placed, scene->placed_count);
    hyi_free_array(context, &scene->placed_ids, scene->placed_count);
    hyi_bvh_free(context, &scene->top);
    scene->view_mesh_count = scene->placed_count = 0;
}

HYI_FN void hyi_free_world(hydra_scene *scene) {
    hyi_bvh_free(scene->context, &scene->world);
    hyi_free_array(scene->context, &scene->world_first, scene->world_count);
    scene->world_count = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) scene->meshes[i].in_world = false;
}

HYI_FN void hyi_free_loaded(hydra_scene *scene) {
    for (size_t i = 0; i < scene->loaded_count; i++) hyi_bvh_free(scene->context, &scene->loaded[i].bvh);
    hyi_free_array(scene->context, &scene->loaded, scene->loaded_capacity);
    scene->loaded_count = scene->loaded_capacity = 0;
}

HYI_FN void hyi_free_lights(hydra_scene *scene) {
    hydra_context *context = scene->context;
    hyi_free_array(context, &scene->all_lights, scene->all_light_count);
    hyi_free_array(context, &scene->light_ids, scene->all_light_count);
    hyi_free_array(context, &scene->light_nodes, scene->light_node_count);
    hyi_free_array(context, &scene->shape_lights, scene->shape_count);
    hyi_bvh_free(context, &scene->shapes);
    scene->all_light_count = 0;
    scene->light_node_count = scene->shape_count = 0;
}

HYI_FN size_t hyi_environment_texel_count(const hydra_scene *scene) {
    return (size_t)3 * scene->environment_width * scene->environment_height;
}

HYI_FN void hyi_free_environment(hydra_scene *scene) {
    hyi_free_array(scene->context, &scene->environment_texels, hyi_environment_texel_count(scene));
    hyi_free_array(scene->context, &scene->environment_cdf, scene->environment_cdf_count);
    scene->environment_cdf_count = 0;
    scene->environment_width = scene->environment_height = 0;
}

HYDRA_API hydra_result hydra_scene_destroy(hydra_scene *scene) {
    if (!scene) return HYDRA_OK;
    hydra_context *context = scene->context;
    if (scene->renders_living) return hyi_fail(context, HYDRA_ERROR_BUSY, "%u renders of the scene are alive", scene->renders_living);
    if (context->backend) context->backend->forget_scene(scene);
    hyi_free_lights(scene);
    hyi_free_placement(scene);
    hyi_free_world(scene);
    hyi_free_loaded(scene);
    hyi_free_tables(scene);
    hyi_free_environment(scene);
    for (size_t i = 0; i < scene->texture_count; i++) hyi_free_array(context, &scene->textures[i].texels, scene->textures[i].words);
    for (size_t i = 0; i < scene->mesh_count; i++) hyi_mesh_release(context, &scene->meshes[i]);
    hyi_free_array(context, &scene->textures, scene->texture_capacity);
    hyi_free_array(context, &scene->materials, scene->material_capacity);
    hyi_free_array(context, &scene->meshes, scene->mesh_capacity);
    hyi_free_array(context, &scene->instances, scene->instance_capacity);
    hyi_free_array(context, &scene->lights, scene->light_capacity);
    hyi_free_array(context, &scene, 1);
    context->scenes_living--;
    return HYDRA_OK;
}

#endif /* HYI_SCENE_H */

/* >>scene-validate: checks shared by all descriptors; each names its error */
#ifndef HYI_VALIDATE_H
#define HYI_VALIDATE_H

/* By the bits of the exponent: holds under fast-math too. */
HYI_INLINE bool hyi_is_finite(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits & 0x7f800000u) != 0x7f800000u;
}

HYI_FN bool hyi_all_finite(const float *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!hyi_is_finite(x[i])) return false;
    return true;
}

HYI_FN bool hyi_all_zero(const float *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (x[i] != 0.0f) return false;
    return true;
}

HYI_FN hydra_result hyi_check_finite(hydra_context *context, const float *x, size_t count, const char *what) {
    return hyi_all_finite(x, count) ? HYDRA_OK : hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "%s", what);
}

/* A colour: finite, not negative, at most highest. */
HYI_FN hydra_result hyi_check_color(hydra_context *context, const float c[3], float highest, const char *what) {
    HYI_TRY(hyi_check_finite(context, c, 3, what));
    for (int i = 0; i < 3; i++)
        if (c[i] < 0.0f || c[i] > highest) return hyi_fail(context, HYDRA_ERROR_COLOR, "%s[%d] is %g", what, i, (double)c[i]);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_range(hydra_context *context, float x, float lowest, float highest, hydra_result error, const char *what) {
    HYI_TRY(hyi_check_finite(context, &x, 1, what));
    if (x < lowest || x > highest) return hyi_fail(context, error, "%s is %g", what, (double)x);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_enum(hydra_context *context, int value, int count, const char *what) {
    if (value < 0 || value >= count) return hyi_fail(context, HYDRA_ERROR_ENUM, "%s is %d", what, value);
    return HYDRA_OK;
}

/* A view of elements of size bytes, with scalars of 4. */
HYI_FN hydra_result hyi_check_view(hydra_context *context, hydra_view view, size_t size, const char *what) {
    if (!view.data) return hyi_fail(context, HYDRA_ERROR_NULL, "%s.data", what);
    if (view.stride && view.stride < size) return hyi_fail(context, HYDRA_ERROR_STRIDE, "%s.stride is %zu, an element has %zu bytes", what, view.stride, size);
    if (view.stride % 4 || (uintptr_t)view.data % 4) return hyi_fail(context, HYDRA_ERROR_STRIDE, "%s is not aligned to 4 bytes", what);
    if (hyi_multiply_overflows(view.count, view.stride ? view.stride : size)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%s: %zu elements", what, view.count);
    return HYDRA_OK;
}

HYI_INLINE const void *hyi_view_at(hydra_view view, size_t size, size_t i) {
    return (const char *)view.data + i * (view.stride ? view.stride : size);
}

/* Copies a checked view of count x width floats into a tight array of its own; every number must be finite. */
HYI_FN hydra_result hyi_copy_floats(hydra_context *context, hydra_view view, size_t width, float **copy, const char *what) {
    HYI_TRY(hyi_check_view(context, view, width * sizeof(float), what));
    HYI_TRY(hyi_alloc_array(context, copy, view.count * width));
    for (size_t i = 0; i < view.count; i++) {
        float *element = *copy + i * width;
        memcpy(element, hyi_view_at(view, width * sizeof(float), i), width * sizeof(float));
        if (hyi_all_finite(element, width)) continue;
        hyi_free_array(context, copy, view.count * width);
        return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "%s: element %zu", what, i);
    }
    return HYDRA_OK;
}

#endif /* HYI_VALIDATE_H */

/* >>scene-materials: descriptors checked and turned into what kernels read */
#ifndef HYI_MATERIALS_H
#define HYI_MATERIALS_H

HYI_STATIC_ASSERT((int)HYK_MATERIAL_LAMBERT == (int)HYDRA_MATERIAL_LAMBERT && (int)HYK_MATERIAL_CONDUCTOR == (int)HYDRA_MATERIAL_CONDUCTOR &&
                  (int)HYK_MATERIAL_DIELECTRIC == (int)HYDRA_MATERIAL_DIELECTRIC &&
                  (int)HYK_MATERIAL_METALLIC_ROUGHNESS == (int)HYDRA_MATERIAL_METALLIC_ROUGHNESS);

HYI_FN hydra_result hyi_check_texture_handle(hydra_scene *scene, hydra_texture texture, const char *what) {
    if (texture.id > scene->texture_count) return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "%s: texture %u of %zu", what, texture.id, scene->texture_count);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_complex_ior(hydra_context *context, const hydra_material_desc *d) {
    if (hyi_all_zero(d->k, 3)) return HYDRA_OK;
    for (int i = 0; i < 3; i++) {
        HYI_TRY(hyi_check_range(context, d->eta[i], 1e-4f, 100.0f, HYDRA_ERROR_IOR, "material.eta"));
        HYI_TRY(hyi_check_range(context, d->k[i], 0.0f, 100.0f, HYDRA_ERROR_IOR, "material.k"));
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_material(hydra_scene *scene, const hydra_material_desc *d) {
    hydra_context *context = scene->context;
    const hydra_result share = HYDRA_ERROR_ROUGHNESS;
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_MATERIAL_METALLIC_ROUGHNESS + 1, "material.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->alpha_mode, HYDRA_ALPHA_BLEND + 1, "material.alpha_mode"));
    HYI_TRY(hyi_check_color(context, d->base_color, 1.0f, "material.base_color"));
    HYI_TRY(hyi_check_color(context, d->emission, FLT_MAX, "material.emission"));
    HYI_TRY(hyi_check_color(context, d->absorption, FLT_MAX, "material.absorption"));
    HYI_TRY(hyi_check_range(context, d->metallic, 0.0f, 1.0f, share, "material.metallic"));
    HYI_TRY(hyi_check_range(context, d->roughness, 0.0f, 1.0f, share, "material.roughness"));
    HYI_TRY(hyi_check_range(context, d->transmission, 0.0f, 1.0f, share, "material.transmission"));
    HYI_TRY(hyi_check_range(context, d->clearcoat, 0.0f, 1.0f, share, "material.clearcoat"));
    HYI_TRY(hyi_check_range(context, d->clearcoat_roughness, 0.0f, 1.0f, share, "material.clearcoat_roughness"));
    HYI_TRY(hyi_check_range(context, d->alpha, 0.0f, 1.0f, share, "material.alpha"));
    HYI_TRY(hyi_check_range(context, d->alpha_cutoff, 0.0f, 1.0f, share, "material.alpha_cutoff"));
    HYI_TRY(hyi_check_finite(context, &d->normal_scale, 1, "material.normal_scale"));
    HYI_TRY(hyi_check_finite(context, &d->ior, 1, "material.ior"));
    if (d->ior != 0.0f) HYI_TRY(hyi_check_range(context, d->ior, 1.0001f, 10.0f, HYDRA_ERROR_IOR, "material.ior"));
    HYI_TRY(hyi_check_complex_ior(context, d));
    HYI_TRY(hyi_check_texture_handle(scene, d->base_color_texture, "material.base_color_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->metallic_roughness_texture, "material.metallic_roughness_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->normal_texture, "material.normal_texture"));
    HYI_TRY(hyi_check_texture_handle(scene, d->emission_texture, "material.emission_texture"));
    return hyi_check_texture_handle(scene, d->alpha_texture, "material.alpha_texture");
}

HYI_INLINE hyk_vec3 hyi_vec3(const float v[3]) { return hyk_make3(v[0], v[1], v[2]); }
HYI_INLINE uint32_t hyi_texture_slot_of(hydra_texture texture) { return texture.id ? texture.id - 1 : HYK_NONE; }

HYI_FN uint32_t hyi_material_flags(const hydra_material_desc *d) {
    uint32_t flags = 0;
    bool glass = d->kind == HYDRA_MATERIAL_DIELECTRIC || (d->kind == HYDRA_MATERIAL_METALLIC_ROUGHNESS && d->transmission > 0.0f);
    if (!hyi_all_zero(d->emission, 3)) flags |= HYK_MATERIAL_EMITS;
    if (d->emit_both_sides) flags |= HYK_MATERIAL_EMITS_BOTH_SIDES;
    if (d->thin && d->kind == HYDRA_MATERIAL_METALLIC_ROUGHNESS) flags |= HYK_MATERIAL_THIN;
    if (d->kind == HYDRA_MATERIAL_CONDUCTOR && !hyi_all_zero(d->k, 3)) flags |= HYK_MATERIAL_COMPLEX_IOR;
    if (d->alpha_mode == HYDRA_ALPHA_MASK) flags |= HYK_MATERIAL_ALPHA_MASK;
    if (d->alpha_mode == HYDRA_ALPHA_BLEND) flags |= HYK_MATERIAL_ALPHA_BLEND;
    if (glass) flags |= HYK_MATERIAL_TRANSMITS;
    if (glass && !(flags & HYK_MATERIAL_THIN) && !hyi_all_zero(d->absorption, 3)) flags |= HYK_MATERIAL_ABSORBS;
    return flags;
}

/* What a surface without a material is made of, and what a desc's zeros mean. */
HYI_FN hyk_material hyi_default_material(void) {
    hyk_material m;
    memset(&m, 0, sizeof m);
    m.base_color = hyk_splat(0.8f);
    m.ior = 1.5f;
    m.alpha = 1.0f;
    m.alpha_cutoff = 0.5f;
    m.normal_scale = 1.0f;
    m.energy_table = HYK_NONE;
    m.base_color_texture = m.metallic_roughness_texture = m.normal_texture = m.emission_texture = m.alpha_texture = HYK_NONE;
    return m;
}

HYI_FN hyk_material hyi_material_record(const hydra_material_desc *d) {
    hyk_material m = hyi_default_material();
    m.kind = (uint32_t)d->kind;
    m.flags = hyi_material_flags(d);
    m.base_color = hyi_vec3(d->base_color);
    m.emission = hyi_vec3(d->emission);
    m.absorption = hyi_vec3(d->absorption);
    m.eta = hyi_vec3(d->eta);
    m.k = hyi_vec3(d->k);
    m.metallic = d->metallic;
    m.roughness = d->roughness;
    m.transmission = d->transmission;
    if (d->ior != 0.0f) m.ior = d->ior;
    if (d->alpha != 0.0f) m.alpha = d->alpha;
    if (d->alpha_cutoff != 0.0f) m.alpha_cutoff = d->alpha_cutoff;
    if (d->normal_scale != 0.0f) m.normal_scale = d->normal_scale;
    m.clearcoat = d->clearcoat;
    m.clearcoat_roughness = d->clearcoat_roughness;
    m.base_color_texture = hyi_texture_slot_of(d->base_color_texture);
    m.metallic_roughness_texture = hyi_texture_slot_of(d->metallic_roughness_texture);
    m.normal_texture = hyi_texture_slot_of(d->normal_texture);
    m.emission_texture = hyi_texture_slot_of(d->emission_texture);
    m.alpha_texture = hyi_texture_slot_of(d->alpha_texture);
    return m;
}

/* Bits of hydra_feature that a material asks for. */
HYI_FN uint32_t hyi_material_needs(const hyk_material *m) {
    uint32_t needs = 0;
    bool alpha = (m->flags & (HYK_MATERIAL_ALPHA_MASK | HYK_MATERIAL_ALPHA_BLEND)) != 0;
    if (m->base_color_texture != HYK_NONE || m->metallic_roughness_texture != HYK_NONE || m->emission_texture != HYK_NONE)
        needs |= HYK_NEEDS_TEXTURES;
    if (m->normal_texture != HYK_NONE) needs |= HYK_NEEDS_TEXTURES | HYK_NEEDS_NORMAL_MAPS;
    if (alpha) needs |= HYK_NEEDS_ALPHA;
    if (alpha && m->alpha_texture != HYK_NONE) needs |= HYK_NEEDS_TEXTURES;
    if (m->kind != HYK_MATERIAL_LAMBERT) needs |= HYK_NEEDS_SPECULAR;
    if (m->flags & HYK_MATERIAL_TRANSMITS) needs |= HYK_NEEDS_TRANSMISSION;
    if (m->flags & HYK_MATERIAL_ABSORBS) needs |= HYK_NEEDS_ABSORPTION;
    return needs;
}

HYDRA_API hydra_material hydra_scene_add_material(hydra_scene *scene, const hydra_material_desc *desc) {
    hydra_material handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_material") != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_check_material(scene, desc)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->materials, &scene->material_capacity, scene->material_count + 1)) != HYDRA_OK) return handle;
    scene->materials[scene->material_count++] = hyi_material_record(desc);
    scene->dirty |= HYI_DIRTY_MATERIALS;
    handle.id = (uint32_t)scene->material_count;
    return handle;
}

HYDRA_API hydra_result hydra_scene_update_material(hydra_scene *scene, hydra_material material, const hydra_material_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_material"));
    if (material.id == 0 || material.id > scene->material_count)
        return hyi_reject(scene, hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "material %u of %zu", material.id, scene->material_count));
    HYI_TRY(hyi_reject(scene, hyi_check_material(scene, desc)));
    scene->materials[material.id - 1] = hyi_material_record(desc);
    scene->dirty |= HYI_DIRTY_MATERIALS;
    return HYDRA_OK;
}

#endif /* HYI_MATERIALS_H */

/* >>scene-meshes: copies of the caller's geometry, and where it is placed */
#ifndef HYI_MESHES_H
#define HYI_MESHES_H

HYI_FN hydra_result hyi_check_material_handle(hydra_scene *scene, hydra_material material, const char *what) {
    if (material.id > scene->material_count) return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "%s: material %u of %zu", what, material.id, scene->material_count);
    return HYDRA_OK;
}

/* Triangle corners as 32-bit numbers, each below the vertex count. */
HYI_FN hydra_result hyi_copy_indices(hydra_context *context, hydra_view view, uint32_t vertex_count, uint32_t *copy) {
    for (size_t i = 0; i < view.count; i++) {
        uint32_t index;
        if (view.stride == 2) {
            uint16_t narrow;
            memcpy(&narrow, (const char *)view.data + 2 * i, sizeof narrow);
            index = narrow;
        } else {
            memcpy(&index, (const char *)view.data + 4 * i, sizeof index);
        }
        if (index >= vertex_count)
            return hyi_fail(context, HYDRA_ERROR_INDEX_RANGE, "index %zu is %u, the mesh has %u vertices", i, index, vertex_count);
        copy[i] = index;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_indices(hydra_context *context, const hydra_mesh_desc *desc, hyi_mesh_slot *mesh) {
    hydra_view view = desc->indices;
    size_t count = view.data || view.count ? view.count : desc->positions.count;
    if (count == 0 || count % 3 || count / 3 >= 0x7fffffffu) return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu corners of triangles", count);
    if (view.count && !view.data) return hyi_fail(context, HYDRA_ERROR_NULL, "indices.data");
    if (view.data && view.stride != 0 && view.stride != 2 && view.stride != 4)
        return hyi_fail(context, HYDRA_ERROR_INDEX_SIZE, "indices.stride is %zu", view.stride);
    HYI_TRY(hyi_alloc_array(context, &mesh->indices, count));
    mesh->triangle_count = (uint32_t)(count / 3);
    if (view.data) return hyi_copy_indices(context, view, mesh->vertex_count, mesh->indices);
    for (size_t i = 0; i < count; i++) mesh->indices[i] = (uint32_t)i;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_triangle_materials(hydra_scene *scene, const hydra_mesh_desc *desc, hyi_mesh_slot *mesh) {
    hydra_view view = desc->triangle_materials;
    if (!view.data && !view.count) return HYDRA_OK;
    HYI_TRY(hyi_check_view(scene->context, view, sizeof(hydra_material), "triangle_materials"));
    if (view.count != mesh->triangle_count)
        return hyi_fail(scene->context, HYDRA_ERROR_COUNT, "%zu triangle materials for %u triangles", view.count, mesh->triangle_count);
    HYI_TRY(hyi_alloc_array(scene->context, &mesh->triangle_materials, view.count));
    for (size_t i = 0; i < view.count; i++) {
        hydra_material material;
        memcpy(&material, hyi_view_at(view, sizeof material, i), sizeof material);
        HYI_TRY(hyi_check_material_handle(scene, material, "triangle_materials"));
        mesh->triangle_materials[i] = material.id;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_attribute(hydra_context *context, hydra_view view, size_t width, uint32_t vertex_count, float **copy, const char *what) {
    if (!view.data && !view.count) return HYDRA_OK;
    if (view.count != vertex_count) return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu %s for %u positions", view.count, what, vertex_count);
    return hyi_copy_floats(context, view, width, copy, what);
}

HYI_FN hydra_result hyi_take_mesh_parts(hydra_scene *scene, const hydra_mesh_desc *desc, hyi_mesh_slot *mesh) {
    hydra_context *context = scene->context;
    if (desc->positions.count == 0 || desc->positions.count > 0xfffffff0u)
        return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu positions", desc->positions.count);
    HYI_TRY(hyi_check_material_handle(scene, desc->material, "mesh.material"));
    HYI_TRY(hyi_check_enum(context, (int)desc->build, HYDRA_BUILD_BEST + 1, "mesh.build"));
    HYI_TRY(hyi_copy_floats(context, desc->positions, 3, &mesh->positions, "positions"));
    mesh->vertex_count = (uint32_t)desc->positions.count;
    HYI_TRY(hyi_take_attribute(context, desc->normals, 3, mesh->vertex_count, &mesh->normals, "normals"));
    HYI_TRY(hyi_take_attribute(context, desc->uvs, 2, mesh->vertex_count, &mesh->uvs, "uvs"));
    HYI_TRY(hyi_take_indices(context, desc, mesh));
    HYI_TRY(hyi_take_triangle_materials(scene, desc, mesh));
    mesh->material = desc->material.id;
    mesh->instanced_only = desc->instanced_only;
    mesh->dynamic = desc->dynamic;
    mesh->build = desc->build != HYDRA_BUILD_AUTO ? desc->build : desc->dynamic ? HYDRA_BUILD_FAST : HYDRA_BUILD_BEST;
    mesh->alive = true;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_mesh(hydra_scene *scene, const hydra_mesh_desc *desc, hyi_mesh_slot *mesh) {
    memset(mesh, 0, sizeof *mesh);
    hydra_result result = hyi_take_mesh_parts(scene, desc, mesh);
    if (result != HYDRA_OK) hyi_mesh_release(scene->context, mesh);
    return result;
}

HYI_FN hydra_result hyi_check_mesh_handle(const hydra_scene *scene, hydra_mesh mesh, const char *what) {
    if (mesh.id == 0 || mesh.id > scene->mesh_count || !scene->meshes[mesh.id - 1].alive)
        return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "%s: mesh %u", what, mesh.id);
    return HYDRA_OK;
}

/* Whether the world tree is over it. */
HYI_FN bool hyi_in_world(const hyi_mesh_slot *mesh) { return mesh->alive && !mesh->instanced_only && !mesh->dynamic; }

HYI_FN void hyi_mesh_leave(hydra_scene *scene, hyi_mesh_slot *mesh) {
    if (mesh->in_world) scene->world_stale = true;
    hyi_mesh_release(scene->context, mesh);
}

HYDRA_API hydra_mesh hydra_scene_add_mesh(hydra_scene *scene, const hydra_mesh_desc *desc) {
    hydra_mesh handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_mesh") != HYDRA_OK) return handle;
    hyi_mesh_slot mesh;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->meshes, &scene->mesh_capacity, scene->mesh_count + 1)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_take_mesh(scene, desc, &mesh)) != HYDRA_OK) return handle;
    scene->meshes[scene->mesh_count++] = mesh;
    scene->dirty |= HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT;
    handle.id = (uint32_t)scene->mesh_count;
    return handle;
}

HYDRA_API hydra_result hydra_scene_update_mesh(hydra_scene *scene, hydra_mesh mesh, const hydra_mesh_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_mesh"));
    HYI_TRY(hyi_reject(scene, hyi_check_mesh_handle(scene, mesh, "hydra_scene_update_mesh")));
    hyi_mesh_slot fresh;
    HYI_TRY(hyi_reject(scene, hyi_take_mesh(scene, desc, &fresh)));
    hyi_mesh_leave(scene, &scene->meshes[mesh.id - 1]);
    scene->meshes[mesh.id - 1] = fresh;
    scene->dirty |= HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_remove_mesh(hydra_scene *scene, hydra_mesh mesh) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_remove_mesh"));
    HYI_TRY(hyi_reject(scene, hyi_check_mesh_handle(scene, mesh, "hydra_scene_remove_mesh")));
    for (size_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].mesh == mesh.id - 1) scene->instances[i].alive = false;
    hyi_mesh_leave(scene, &scene->meshes[mesh.id - 1]);
    scene->dirty |= HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT;
    return HYDRA_OK;
}

/* ---- moved vertices */

/* New values for an array of three floats a vertex that the mesh has. */
HYI_FN hydra_result hyi_check_moved(hydra_context *context, const hyi_mesh_slot *mesh, const float *now, hydra_view view, const char *what) {
    if (!now || view.count != mesh->vertex_count)
        return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu %s, the mesh has %u", view.count, what, now ? mesh->vertex_count : 0u);
    HYI_TRY(hyi_check_view(context, view, 3 * sizeof(float), what));
    for (size_t i = 0; i < view.count; i++) {
        float element[3];
        memcpy(element, hyi_view_at(view, sizeof element, i), sizeof element);
        if (!hyi_all_finite(element, 3)) return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "%s: element %zu", what, i);
    }
    return HYDRA_OK;
}

HYI_FN void hyi_overwrite(float *now, hydra_view view) {
    size_t size = 3 * sizeof(float);
    if (view.stride == 0 || view.stride == size) memcpy(now, view.data, view.count * size);
    else
        for (size_t i = 0; i < view.count; i++) memcpy(now + 3 * i, hyi_view_at(view, size, i), size);
}

HYI_FN hydra_result hyi_check_move(hydra_scene *scene, hydra_mesh mesh, hydra_view positions, hydra_view normals) {
    HYI_TRY(hyi_check_mesh_handle(scene, mesh, "hydra_scene_move_vertices"));
    const hyi_mesh_slot *slot = &scene->meshes[mesh.id - 1];
    HYI_TRY(hyi_check_moved(scene->context, slot, slot->positions, positions, "positions"));
    if (!normals.data && !normals.count) return HYDRA_OK;
    return hyi_check_moved(scene->context, slot, slot->normals, normals, "normals");
}

/* What was built over the mesh is to be built again. */
HYI_FN void hyi_mesh_outdated(hydra_scene *scene, hyi_mesh_slot *mesh) {
    hyi_bvh_free(scene->context, &mesh->bvh);
    mesh->built = mesh->moved = false;
    if (mesh->in_world) scene->world_stale = true;
    scene->dirty |= HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT;
}

HYDRA_API hydra_result hydra_scene_move_vertices(hydra_scene *scene, hydra_mesh mesh, hydra_view positions, hydra_view normals) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_move_vertices"));
    HYI_TRY(hyi_reject(scene, hyi_check_move(scene, mesh, positions, normals)));
    hyi_mesh_slot *slot = &scene->meshes[mesh.id - 1];
    hyi_overwrite(slot->positions, positions);
    if (normals.count) hyi_overwrite(slot->normals, normals);
    if (!slot->dynamic) hyi_mesh_outdated(scene, slot);
    slot->moved = slot->built;
    scene->dirty |= HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_rebuild_mesh(hydra_scene *scene, hydra_mesh mesh) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_rebuild_mesh"));
    HYI_TRY(hyi_reject(scene, hyi_check_mesh_handle(scene, mesh, "hydra_scene_rebuild_mesh")));
    hyi_mesh_outdated(scene, &scene->meshes[mesh.id - 1]);
    return HYDRA_OK;
}

/* ---- instances */

/* Inverse of a 3x4 transform, in double and with the rows scaled first, so that only true singularity fails. */
HYI_FN bool hyi_invert(const float m[12], float inverse[12], bool *mirrored) {
    double row[3][3], scale[3];
    for (int r = 0; r < 3; r++) {
        scale[r] = fmax(fabs((double)m[4 * r]), fmax(fabs((double)m[4 * r + 1]), fabs((double)m[4 * r + 2])));
        if (!(scale[r] > 0.0)) return false;
        for (int c = 0; c < 3; c++) row[r][c] = (double)m[4 * r + c] / scale[r];
    }
    double cofactor[3][3];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            cofactor[r][c] = row[r1][c1] * row[r2][c2] - row[r1][c2] * row[r2][c1];
        }
    double determinant = row[0][0] * cofactor[0][0] + row[0][1] * cofactor[0][1] + row[0][2] * cofactor[0][2];
    if (fabs(determinant) < 1e-12) return false; /* unit rows this close to a plane: float entries say no more */
    for (int r = 0; r < 3; r++) {
        double translation = 0.0;
        for (int c = 0; c < 3; c++) {
            double value = cofactor[c][r] / determinant / scale[c];
            inverse[4 * r + c] = (float)value;
            translation -= value * (double)m[4 * c + 3];
        }
        inverse[4 * r + 3] = (float)translation;
    }
    *mirrored = determinant < 0.0;
    return hyi_all_finite(inverse, 12);
}

HYI_FN bool hyi_is_identity(const float m[12]) {
    for (int i = 0; i < 12; i++)
        if (m[i] != (i % 5 == 0 ? 1.0f : 0.0f)) return false;
    return true;
}

HYI_FN hydra_result hyi_take_instance(hydra_scene *scene, const hydra_instance_desc *desc, hyi_instance_slot *slot) {
    memset(slot, 0, sizeof *slot);
    HYI_TRY(hyi_check_mesh_handle(scene, desc->mesh, "instance.mesh"));
    HYI_TRY(hyi_check_material_handle(scene, desc->material, "instance.material"));
    HYI_TRY(hyi_check_finite(scene->context, desc->transform, 12, "instance.transform"));
    memcpy(slot->transform, desc->transform, sizeof slot->transform);
    if (hyi_all_zero(desc->transform, 12)) slot->transform[0] = slot->transform[5] = slot->transform[10] = 1.0f;
    if (!hyi_invert(slot->transform, slot->inverse, &slot->mirrored)) return hyi_fail(scene->context, HYDRA_ERROR_TRANSFORM, "instance.transform");
    slot->identity = hyi_is_identity(slot->transform);
    slot->mesh = desc->mesh.id - 1;
    slot->material = desc->material.id ? desc->material.id : HYK_NONE;
    slot->alive = true;
    return HYDRA_OK;
}

HYDRA_API hydra_instance hydra_scene_add_instance(hydra_scene *scene, const hydra_instance_desc *desc) {
    hydra_instance handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_instance") != HYDRA_OK) return handle;
    hyi_instance_slot slot;
    if (hyi_reject(scene, hyi_take_instance(scene, desc, &slot)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->instances, &scene->instance_capacity, scene->instance_count + 1)) != HYDRA_OK) return handle;
    scene->instances[scene->instance_count++] = slot;
    scene->dirty |= HYI_DIRTY_PLACEMENT;
    handle.id = (uint32_t)scene->instance_count;
    return handle;
}

HYI_FN hydra_result hyi_check_instance_handle(hydra_scene *scene, hydra_instance instance) {
    if (instance.id == 0 || instance.id > scene->instance_count || !scene->instances[instance.id - 1].alive)
        return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "instance %u", instance.id);
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_update_instance(hydra_scene *scene, hydra_instance instance, const hydra_instance_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_instance"));
    HYI_TRY(hyi_reject(scene, hyi_check_instance_handle(scene, instance)));
    hyi_instance_slot slot;
    HYI_TRY(hyi_reject(scene, hyi_take_instance(scene, desc, &slot)));
    scene->instances[instance.id - 1] = slot;
    scene->dirty |= HYI_DIRTY_PLACEMENT;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_remove_instance(hydra_scene *scene, hydra_instance instance) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_remove_instance"));
    HYI_TRY(hyi_reject(scene, hyi_check_instance_handle(scene, instance)));
    scene->instances[instance.id - 1].alive = false;
    scene->dirty |= HYI_DIRTY_PLACEMENT;
    return HYDRA_OK;
}

#endif /* HYI_MESHES_H */

/* >>scene-trees: the trees over meshes: loaded, built, or fitted to vertices that moved; and saved

   A tree is known by the hash of what it was built from, not by the mesh or scene it served. */
#ifndef HYI_TREES_H
#define HYI_TREES_H

/* ---- what a tree is built from */

typedef struct hyi_tree_source {
    const float *positions;
    const uint32_t *indices;
    uint32_t triangle_count;
    hydra_build build;
    uint64_t fingerprint; /* 0: no loaded tree can be meant */
} hyi_tree_source;

HYI_FN uint64_t hyi_mix_mesh(uint64_t hash, const hyi_mesh_slot *mesh) {
    const uint32_t counts[2] = { mesh->vertex_count, mesh->triangle_count };
    hash = hyi_hash(hash, counts, sizeof counts);
    hash = hyi_hash(hash, mesh->positions, (size_t)3 * mesh->vertex_count * sizeof *mesh->positions);
    return hyi_hash(hash, mesh->indices, (size_t)3 * mesh->triangle_count * sizeof *mesh->indices);
}

HYI_FN uint64_t hyi_mesh_fingerprint(const hyi_mesh_slot *mesh) { return hyi_mix_mesh((uint64_t)mesh->build, mesh); }

/* FAST only if all its meshes are. */
HYI_FN hydra_build hyi_world_build(const hydra_scene *scene) {
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (hyi_in_world(&scene->meshes[i]) && scene->meshes[i].build != HYDRA_BUILD_FAST) return HYDRA_BUILD_BEST;
    return HYDRA_BUILD_FAST;
}

HYI_FN uint64_t hyi_world_fingerprint(const hydra_scene *scene) {
    uint64_t hash = (uint64_t)hyi_world_build(scene);
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (hyi_in_world(&scene->meshes[i])) hash = hyi_mix_mesh(hash, &scene->meshes[i]);
    return hash;
}

/* Hashing is left out where it can lead to nothing. */
HYI_FN bool hyi_expects_loaded(const hydra_scene *scene, size_t triangle_count) {
    bool expects = false;
    for (size_t i = 0; i < scene->loaded_count; i++)
        expects = expects || (scene->loaded[i].bvh.ids && scene->loaded[i].record.triangle_count == triangle_count);
    return expects;
}

/* ---- a tree: the loaded one that fits, else a new one */

HYI_FN hydra_result hyi_take_loaded(hydra_scene *scene, const hyi_tree_source *source, hyi_bvh *bvh, hyi_quality *quality, bool *taken) {
    *taken = false;
    for (size_t i = 0; i < scene->loaded_count && !*taken; i++) {
        hyi_loaded_tree *loaded = &scene->loaded[i];
        if (!loaded->bvh.ids || loaded->record.triangle_count != source->triangle_count) continue;
        if (loaded->record.fingerprint != source->fingerprint) continue;
        HYI_TRY(hyi_bvh_adopt(scene->context, source->positions, source->indices, source->triangle_count, &loaded->bvh, taken));
        if (!*taken) hyi_bvh_free(scene->context, &loaded->bvh);
        *bvh = loaded->bvh;
        memset(&loaded->bvh, 0, sizeof loaded->bvh);
        quality->cost = hyi_bvh_cost(bvh);
        quality->cost_when_built = loaded->record.cost_when_built;
        quality->refitted = loaded->record.refitted != 0;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_tree(hydra_scene *scene, const hyi_tree_source *source, hyi_bvh *bvh, hyi_quality *quality) {
    bool taken = false;
    if (source->fingerprint) HYI_TRY(hyi_take_loaded(scene, source, bvh, quality, &taken));
    if (taken) {
        scene->info.trees_loaded++;
        return HYDRA_OK;
    }
    HYI_TRY(hyi_bvh_build_triangles(scene->context, source->positions, source->indices, source->triangle_count, source->build, bvh));
    quality->cost = quality->cost_when_built = hyi_bvh_cost(bvh);
    quality->refitted = false;
    scene->info.meshes_built++;
    return HYDRA_OK;
}

/* ---- trees of single meshes */

/* Marks the meshes that need a tree of their own. */
HYI_FN hydra_result hyi_mark_own_trees(hydra_scene *scene, uint8_t **marks) {
    HYI_TRY(hyi_alloc_array(scene->context, marks, scene->mesh_count));
    for (size_t i = 0; i < scene->mesh_count; i++)
        (*marks)[i] = scene->meshes[i].alive && !scene->meshes[i].instanced_only && scene->meshes[i].dynamic ? 1 : 0;
    for (size_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].alive) (*marks)[scene->instances[i].mesh] = 1;
    return HYDRA_OK;
}

/* A tree that cannot be refitted goes. After an error it waits for another try. */
HYI_FN hydra_result hyi_refit_own_tree(hydra_scene *scene, hyi_mesh_slot *mesh) {
    bool fits;
    HYI_TRY(hyi_bvh_refit(scene->context, mesh->positions, mesh->indices, mesh->triangle_count, &mesh->bvh, &fits, &mesh->quality.cost));
    if (!fits) hyi_bvh_free(scene->context, &mesh->bvh);
    mesh->built = mesh->quality.refitted = fits;
    mesh->moved = false;
    scene->info.meshes_refitted += fits ? 1u : 0u;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_own_tree(hydra_scene *scene, hyi_mesh_slot *mesh) {
    hyi_tree_source source;
    source.positions = mesh->positions;
    source.indices = mesh->indices;
    source.triangle_count = mesh->triangle_count;
    source.build = mesh->build;
    source.fingerprint = hyi_expects_loaded(scene, mesh->triangle_count) ? hyi_mesh_fingerprint(mesh) : 0u;
    HYI_TRY(hyi_make_tree(scene, &source, &mesh->bvh, &mesh->quality));
    mesh->built = true;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_commit_own_trees(hydra_scene *scene) {
    uint8_t *marks;
    HYI_TRY(hyi_mark_own_trees(scene, &marks));
    hydra_result result = HYDRA_OK;
    for (size_t i = 0; i < scene->mesh_count && result == HYDRA_OK; i++) {
        hyi_mesh_slot *mesh = &scene->meshes[i];
        if (mesh->built && mesh->moved) result = hyi_refit_own_tree(scene, mesh);
        if (result == HYDRA_OK && !mesh->built && marks[i]) result = hyi_make_own_tree(scene, mesh);
    }
    hyi_free_array(scene->context, &marks, scene->mesh_count);
    return result;
}

/* ---- the tree over all meshes that stand unmoved */

/* All meshes of the world behind each other, for the time of the build. */
typedef struct hyi_world_arrays {
    float *positions;
    uint32_t *indices;
    size_t vertices, triangles;
} hyi_world_arrays;

HYI_FN void hyi_fill_world(const hydra_scene *scene, hyi_world_arrays *w) {
    size_t vertex = 0, triangle = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        if (!hyi_in_world(mesh)) continue;
        memcpy(w->positions + 3 * vertex, mesh->positions, (size_t)3 * mesh->vertex_count * sizeof *w->positions);
        for (size_t c = 0; c < (size_t)3 * mesh->triangle_count; c++) w->indices[3 * triangle + c] = mesh->indices[c] + (uint32_t)vertex;
        vertex += mesh->vertex_count;
        triangle += mesh->triangle_count;
    }
}

HYI_FN hydra_result hyi_make_world_tree(hydra_scene *scene, const float *positions, const uint32_t *indices, size_t triangles) {
    hyi_tree_source source;
    source.positions = positions;
    source.indices = indices;
    source.triangle_count = (uint32_t)triangles;
    source.build = hyi_world_build(scene);
    source.fingerprint = hyi_expects_loaded(scene, triangles) ? hyi_world_fingerprint(scene) : 0u;
    return hyi_make_tree(scene, &source, &scene->world, &scene->world_quality);
}

HYI_FN hydra_result hyi_make_joined_world(hydra_scene *scene, hyi_world_arrays *w) {
    hydra_context *context = scene->context;
    if (w->vertices > UINT32_MAX || w->triangles > UINT32_MAX)
        return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu vertices and %zu triangles in meshes that are not dynamic", w->vertices, w->triangles);
    HYI_TRY(hyi_alloc_array(context, &w->positions, 3 * w->vertices));
    hydra_result result = hyi_alloc_array(context, &w->indices, 3 * w->triangles);
    if (result == HYDRA_OK) {
        hyi_fill_world(scene, w);
        result = hyi_make_world_tree(scene, w->positions, w->indices, w->triangles);
    }
    hyi_free_array(context, &w->positions, 3 * w->vertices);
    hyi_free_array(context, &w->indices, 3 * w->triangles);
    return result;
}

HYI_FN bool hyi_world_is_fresh(const hydra_scene *scene) {
    bool fresh = !scene->world_stale;
    for (size_t i = 0; i < scene->mesh_count; i++) fresh = fresh && scene->meshes[i].in_world == hyi_in_world(&scene->meshes[i]);
    return fresh;
}

/* From a mesh's own arrays where there is only one. */
HYI_FN hydra_result hyi_commit_world(hydra_scene *scene) {
    hyi_world_arrays w = { NULL, NULL, 0, 0 };
    const hyi_mesh_slot *only = NULL;
    size_t count = 0, at = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) count += hyi_in_world(&scene->meshes[i]) ? 1u : 0u;
    hyi_free_world(scene);
    HYI_TRY(hyi_alloc_array(scene->context, &scene->world_first, count));
    scene->world_count = count;
    for (size_t i = 0; i < scene->mesh_count; i++) {
        if (!hyi_in_world(&scene->meshes[i])) continue;
        only = &scene->meshes[i];
        scene->world_first[at++] = (uint32_t)w.triangles;
        w.vertices += only->vertex_count;
        w.triangles += only->triangle_count;
    }
    if (count == 1) HYI_TRY(hyi_make_world_tree(scene, only->positions, only->indices, only->triangle_count));
    if (count > 1) HYI_TRY(hyi_make_joined_world(scene, &w));
    for (size_t i = 0; i < scene->mesh_count; i++) scene->meshes[i].in_world = hyi_in_world(&scene->meshes[i]);
    scene->world_stale = false;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_commit_trees(hydra_scene *scene) {
    double start = hyi_seconds();
    HYI_TRY(hyi_commit_own_trees(scene));
    if (!hyi_world_is_fresh(scene)) HYI_TRY(hyi_commit_world(scene));
    scene->info.build_seconds += hyi_seconds() - start;
    return HYDRA_OK;
}

/* ---- what became of them */

/* Measured on a torus of 65 536 triangles that was twisted, bent, made to ripple and jittered: where the cost had grown by
   half, rays took 1.1 to 1.4 times as long as on a tree built for that shape; at four times, 2 to 2.5. Below half a build
   gained little. Triangles that no tree can part (jitter) made the cost grow tenfold and a build gain 1.2. */
#define HYI_REBUILD_PAYS 1.5f

/* A tree as it stands, with what it was made from: the world's, or of a mesh. */
typedef struct hyi_kept_tree {
    const hyi_bvh *bvh;
    const hyi_quality *quality;
    const hyi_mesh_slot *mesh; /* NULL: the world */
} hyi_kept_tree;

HYI_FN hyi_kept_tree hyi_world_tree(const hydra_scene *scene) {
    hyi_kept_tree tree;
    tree.bvh = &scene->world;
    tree.quality = &scene->world_quality;
    tree.mesh = NULL;
    return tree;
}

HYI_FN hyi_kept_tree hyi_own_tree(const hyi_mesh_slot *mesh) {
    hyi_kept_tree tree;
    tree.bvh = &mesh->bvh;
    tree.quality = &mesh->quality;
    tree.mesh = mesh;
    return tree;
}

HYI_FN uint64_t hyi_count_degenerate(const hyi_mesh_slot *mesh) {
    uint64_t count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *index = mesh->indices + (size_t)3 * t;
        const float *p = mesh->positions;
        count += hyi_triangle_is_degenerate(p + (size_t)3 * index[0], p + (size_t)3 * index[1], p + (size_t)3 * index[2]) ? 1u : 0u;
    }
    return count;
}

HYDRA_API hydra_result hydra_scene_get_mesh_info(const hydra_scene *scene, hydra_mesh mesh, hydra_mesh_info *info) {
    HYI_TRY(hyi_check_committed(scene));
    if (!info) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "info");
    HYI_TRY(hyi_check_mesh_handle(scene, mesh, "hydra_scene_get_mesh_info"));
    const hyi_mesh_slot *slot = &scene->meshes[mesh.id - 1];
    hyi_kept_tree tree = slot->built || !slot->in_world ? hyi_own_tree(slot) : hyi_world_tree(scene);
    memset(info, 0, sizeof *info);
    info->triangles = slot->triangle_count;
    info->degenerate = slot->built ? slot->bvh.degenerate : hyi_count_degenerate(slot);
    info->shared = !tree.mesh;
    info->bytes_bvh = tree.bvh->bytes;
    if (tree.bvh->primitive_count == 0) return HYDRA_OK;
    info->cost = tree.quality->cost;
    info->cost_when_built = tree.quality->cost_when_built;
    info->refitted = tree.quality->refitted;
    info->rebuild_advised = info->refitted && info->cost > HYI_REBUILD_PAYS * info->cost_when_built;
    return HYDRA_OK;
}

/* ---- save */

/* The i-th of all trees that may be there, of which mesh_count + 1; false: there is none, or nothing in it. */
HYI_FN bool hyi_tree_to_save(const hydra_scene *scene, size_t i, hyi_kept_tree *tree) {
    *tree = i == 0 ? hyi_world_tree(scene) : hyi_own_tree(&scene->meshes[i - 1]);
    return tree->bvh->primitive_count != 0;
}

HYI_FN hyi_trees_header hyi_describe_trees(const hydra_scene *scene) {
    hyi_trees_header header;
    hyi_kept_tree tree;
    memset(&header, 0, sizeof header);
    header.magic = HYI_TREES_MAGIC;
    header.version = HYI_TREES_VERSION;
    header.layout = hyi_trees_layout();
    header.size = sizeof header;
    for (size_t i = 0; i <= scene->mesh_count; i++) {
        if (!hyi_tree_to_save(scene, i, &tree)) continue;
        header.size += hyi_tree_bytes(tree.bvh);
        header.tree_count++;
    }
    return header;
}

HYI_FN unsigned char *hyi_save_tree(unsigned char *out, const hydra_scene *scene, const hyi_kept_tree *tree) {
    hyi_tree_record record;
    memset(&record, 0, sizeof record);
    record.fingerprint = tree->mesh ? hyi_mesh_fingerprint(tree->mesh) : hyi_world_fingerprint(scene);
    if (tree->mesh) record.triangle_count = tree->mesh->triangle_count;
    for (size_t i = 0; !tree->mesh && i < scene->mesh_count; i++)
        if (scene->meshes[i].in_world) record.triangle_count += scene->meshes[i].triangle_count;
    record.cost_when_built = tree->quality->cost_when_built;
    record.refitted = tree->quality->refitted ? 1u : 0u;
    return hyi_put_tree(out, tree->bvh, record);
}

HYDRA_API hydra_result hydra_scene_save_trees(const hydra_scene *scene, void *buffer, size_t *size) {
    HYI_TRY(hyi_check_committed(scene));
    if (!size) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "size");
    hyi_trees_header header = hyi_describe_trees(scene);
    size_t room = *size;
    *size = (size_t)header.size;
    if (!buffer) return HYDRA_OK;
    if (room < *size) return hyi_fail(scene->context, HYDRA_ERROR_BUFFER, "%zu bytes for trees of %zu", room, *size);
    hyi_kept_tree tree;
    unsigned char *begin = (unsigned char *)buffer, *out = hyi_put(begin, &header, sizeof header);
    for (size_t i = 0; i <= scene->mesh_count; i++)
        if (hyi_tree_to_save(scene, i, &tree)) out = hyi_save_tree(out, scene, &tree);
    header.checksum = hyi_hash(HYI_TREES_MAGIC, begin + HYI_TREES_CHECKED_FROM, *size - HYI_TREES_CHECKED_FROM);
    (void)hyi_put(begin, &header, sizeof header);
    return HYDRA_OK;
}

/* ---- load */

HYI_FN hydra_result hyi_check_trees_header(hydra_context *context, const unsigned char *data, size_t size, hyi_trees_header *header) {
    if (size < sizeof *header) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes", size);
    memcpy(header, data, sizeof *header);
    if (header->magic != HYI_TREES_MAGIC) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "these are no trees, or of another byte order");
    if (header->version != HYI_TREES_VERSION)
        return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "version %u, this is version %u", header->version, HYI_TREES_VERSION);
    if (header->size != size) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes of %llu", size, (unsigned long long)header->size);
    if (header->checksum != hyi_hash(HYI_TREES_MAGIC, data + HYI_TREES_CHECKED_FROM, size - HYI_TREES_CHECKED_FROM))
        return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "the checksum does not fit");
    if (header->layout != hyi_trees_layout()) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "nodes of another layout");
    return HYDRA_OK;
}

/* Reads one tree behind those that are there. */
HYI_FN hydra_result hyi_load_tree(hydra_scene *scene, hyi_bytes *in) {
    HYI_TRY(hyi_grow_array(scene->context, &scene->loaded, &scene->loaded_capacity, scene->loaded_count + 1));
    hyi_loaded_tree *loaded = &scene->loaded[scene->loaded_count];
    bool sound;
    hydra_result result = hyi_get_tree(scene->context, in, &loaded->record, &loaded->bvh, &sound);
    if (result == HYDRA_OK && !sound) result = hyi_fail(scene->context, HYDRA_ERROR_TREE_FORMAT, "tree %zu is impossible", scene->loaded_count);
    if (result != HYDRA_OK) hyi_bvh_free(scene->context, &loaded->bvh);
    else scene->loaded_count++;
    return result;
}

HYI_FN hydra_result hyi_load_all(hydra_scene *scene, hyi_bytes *in, uint32_t tree_count) {
    for (uint32_t i = 0; i < tree_count; i++) HYI_TRY(hyi_load_tree(scene, in));
    return in->left == 0 ? HYDRA_OK : hyi_fail(scene->context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes too many", in->left);
}

HYDRA_API hydra_result hydra_scene_load_trees(hydra_scene *scene, const void *data, size_t size) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_load_trees"));
    if (!data) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "data");
    hyi_trees_header header;
    hyi_bytes in;
    in.at = (const unsigned char *)data;
    in.left = size;
    HYI_TRY(hyi_check_trees_header(scene->context, in.at, size, &header));
    in.at += sizeof header;
    in.left -= sizeof header;
    size_t before = scene->loaded_count;
    hydra_result result = hyi_load_all(scene, &in, header.tree_count);
    while (result != HYDRA_OK && scene->loaded_count > before) hyi_bvh_free(scene->context, &scene->loaded[--scene->loaded_count].bvh);
    return result;
}

#endif /* HYI_TREES_H */

/* >>scene-textures: copies of texels and their mip pyramids */
#ifndef HYI_TEXTURES_H
#define HYI_TEXTURES_H

HYI_STATIC_ASSERT((int)HYK_TEXEL_RGBA8_SRGB == (int)HYDRA_TEXEL_RGBA8_SRGB && (int)HYK_TEXEL_RGBA8_LINEAR == (int)HYDRA_TEXEL_RGBA8_LINEAR &&
                  (int)HYK_TEXEL_RGBA32F == (int)HYDRA_TEXEL_RGBA32F);
HYI_STATIC_ASSERT((int)HYK_WRAP_REPEAT == (int)HYDRA_WRAP_REPEAT && (int)HYK_WRAP_CLAMP == (int)HYDRA_WRAP_CLAMP &&
                  (int)HYK_WRAP_MIRROR == (int)HYDRA_WRAP_MIRROR);

HYI_FN uint32_t hyi_texel_words(uint32_t format) { return format == HYK_TEXEL_RGBA32F ? 4 : 1; }

HYI_FN hydra_result hyi_check_texture(hydra_context *context, const hydra_texture_desc *desc) {
    if (!desc->texels) return hyi_fail(context, HYDRA_ERROR_NULL, "texture.texels");
    HYI_TRY(hyi_check_enum(context, (int)desc->format, HYDRA_TEXEL_RGBA32F + 1, "texture.format"));
    HYI_TRY(hyi_check_enum(context, (int)desc->wrap_u, HYDRA_WRAP_MIRROR + 1, "texture.wrap_u"));
    HYI_TRY(hyi_check_enum(context, (int)desc->wrap_v, HYDRA_WRAP_MIRROR + 1, "texture.wrap_v"));
    if (desc->width == 0 || desc->height == 0 || desc->width > 65536 || desc->height > 65536)
        return hyi_fail(context, HYDRA_ERROR_TEXTURE, "%u x %u texels", desc->width, desc->height);
    size_t row = (size_t)desc->width * 4 * hyi_texel_words((uint32_t)desc->format);
    if (desc->row_stride && desc->row_stride < row) return hyi_fail(context, HYDRA_ERROR_STRIDE, "texture.row_stride is %zu, a row has %zu bytes", desc->row_stride, row);
    return HYDRA_OK;
}

/* Level sizes and offsets; returns the number of texels of all levels, 0 when they cannot be numbered in 32 bits. */
HYI_FN size_t hyi_plan_levels(hyk_texture *t, bool mipmaps) {
    uint64_t texels = 0;
    uint32_t w = t->width, h = t->height;
    for (t->levels = 0; t->levels < HYK_TEXTURE_LEVELS; t->levels++) {
        t->level_offset[t->levels] = (uint32_t)texels;
        texels += (uint64_t)w * h;
        if ((w == 1 && h == 1) || !mipmaps) {
            t->levels++;
            break;
        }
        w = w > 1 ? w / 2 : 1;
        h = h > 1 ? h / 2 : 1;
    }
    return texels * hyi_texel_words(t->format) > UINT32_MAX ? 0 : (size_t)texels;
}

HYI_FN float hyi_srgb_encode(float c) { return c <= 0.0031308f ? 12.92f * c : 1.055f * powf(c, 1.0f / 2.4f) - 0.055f; }

HYI_FN uint32_t hyi_pack_texel(hyk_rgba c, uint32_t format) {
    float channel[4] = { c.rgb.x, c.rgb.y, c.rgb.z, c.a };
    uint32_t word = 0;
    for (int i = 0; i < 4; i++) {
        float x = i < 3 && format == HYK_TEXEL_RGBA8_SRGB ? hyi_srgb_encode(channel[i]) : channel[i];
        word |= (uint32_t)(x * 255.0f + 0.5f) << (8 * i);
    }
    return word;
}

HYI_FN void hyi_store_texel(uint32_t *texels, uint32_t format, size_t at, hyk_rgba c) {
    if (format != HYK_TEXEL_RGBA32F) {
        texels[at] = hyi_pack_texel(c, format);
        return;
    }
    float channel[4] = { c.rgb.x, c.rgb.y, c.rgb.z, c.a };
    memcpy(texels + 4 * at, channel, sizeof channel);
}

/* One texel of a level: the mean, in linear light, of the box it covers in the level above; boxes of odd sizes overlap
   none and lose none: the last takes what is left. */
HYI_FN hyk_rgba hyi_box_texel(const hyi_texture_slot *slot, uint32_t level, uint32_t x, uint32_t y) {
    const hyk_texture *t = &slot->record;
    hyk_scene_view view;
    memset(&view, 0, sizeof view);
    const uint32_t *texels = slot->texels;
    view.texels = &texels;
    uint32_t w = t->width >> (level - 1), h = t->height >> (level - 1);
    w = w ? w : 1;
    h = h ? h : 1;
    uint32_t nw = w > 1 ? w / 2 : 1, nh = h > 1 ? h / 2 : 1;
    uint32_t x0 = w > 1 ? 2 * x : 0, y0 = h > 1 ? 2 * y : 0;
    uint32_t x1 = x + 1 == nw ? w : x0 + 2, y1 = y + 1 == nh ? h : y0 + 2;
    double sum[4] = { 0, 0, 0, 0 };
    for (uint32_t j = y0; j < y1; j++)
        for (uint32_t i = x0; i < x1; i++) {
            hyk_rgba c = hyk_load_texel(&view, 0, t->format, t->level_offset[level - 1] + j * w + i);
            sum[0] += (double)c.rgb.x;
            sum[1] += (double)c.rgb.y;
            sum[2] += (double)c.rgb.z;
            sum[3] += (double)c.a;
        }
    double scale = 1.0 / ((double)(x1 - x0) * (double)(y1 - y0));
    hyk_rgba mean;
    mean.rgb = hyk_make3((float)(sum[0] * scale), (float)(sum[1] * scale), (float)(sum[2] * scale));
    mean.a = (float)(sum[3] * scale);
    return mean;
}

HYI_FN void hyi_build_level(hyi_texture_slot *slot, uint32_t level) {
    uint32_t w = slot->record.width >> level, h = slot->record.height >> level;
    w = w ? w : 1;
    h = h ? h : 1;
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++)
            hyi_store_texel(slot->texels, slot->record.format, slot->record.level_offset[level] + (size_t)y * w + x, hyi_box_texel(slot, level, x, y));
}

HYI_FN void hyi_texture_mean(hyi_texture_slot *slot) {
    hyk_scene_view view;
    memset(&view, 0, sizeof view);
    const uint32_t *texels = slot->texels;
    view.texels = &texels;
    double sum[4] = { 0, 0, 0, 0 };
    uint32_t count = slot->record.width * slot->record.height;
    for (uint32_t i = 0; i < count; i++) {
        hyk_rgba c = hyk_load_texel(&view, 0, slot->record.format, i);
        sum[0] += (double)c.rgb.x;
        sum[1] += (double)c.rgb.y;
        sum[2] += (double)c.rgb.z;
        sum[3] += (double)c.a;
    }
    for (int i = 0; i < 4; i++) slot->mean[i] = (float)(sum[i] / (double)count);
}

/* Copies the rows into level 0. */
HYI_FN hydra_result hyi_copy_texels(hydra_context *context, hyi_texture_slot *slot, const hydra_texture_desc *desc) {
    size_t row = (size_t)desc->width * 4 * hyi_texel_words(slot->record.format);
    size_t stride = desc->row_stride ? desc->row_stride : row;
    for (uint32_t y = 0; y < desc->height; y++) memcpy((char *)slot->texels + y * row, (const char *)desc->texels + y * stride, row);
    if (slot->record.format != HYK_TEXEL_RGBA32F) return HYDRA_OK;
    for (size_t i = 0; i < (size_t)desc->width * desc->height * 4; i++) {
        float value;
        memcpy(&value, slot->texels + i, sizeof value);
        if (!hyi_is_finite(value)) return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "texel %zu of the texture", i / 4);
        if (value < 0.0f) return hyi_fail(context, HYDRA_ERROR_COLOR, "texel %zu of the texture has a channel of %g", i / 4, (double)value);
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_texture(hydra_context *context, const hydra_texture_desc *desc, hyi_texture_slot *slot) {
    memset(slot, 0, sizeof *slot);
    HYI_TRY(hyi_check_texture(context, desc));
    hyk_texture *t = &slot->record;
    t->width = desc->width;
    t->height = desc->height;
    t->format = (uint32_t)desc->format;
    t->wrap_u = (uint32_t)desc->wrap_u;
    t->wrap_v = (uint32_t)desc->wrap_v;
    size_t texels = hyi_plan_levels(t, !desc->no_mipmaps);
    if (!texels) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u x %u texels", desc->width, desc->height);
    slot->words = texels * hyi_texel_words(t->format);
    HYI_TRY(hyi_alloc_array(context, &slot->texels, slot->words));
    hydra_result result = hyi_copy_texels(context, slot, desc);
    if (result != HYDRA_OK) {
        hyi_free_array(context, &slot->texels, slot->words);
        return result;
    }
    for (uint32_t level = 1; level < t->levels; level++) hyi_build_level(slot, level);
    hyi_texture_mean(slot);
    return HYDRA_OK;
}

HYDRA_API hydra_texture hydra_scene_add_texture(hydra_scene *scene, const hydra_texture_desc *desc) {
    hydra_texture handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_texture") != HYDRA_OK) return handle;
    hyi_texture_slot slot;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->textures, &scene->texture_capacity, scene->texture_count + 1)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_make_texture(scene->context, desc, &slot)) != HYDRA_OK) return handle;
    scene->textures[scene->texture_count++] = slot;
    scene->dirty |= HYI_DIRTY_MATERIALS;
    handle.id = (uint32_t)scene->texture_count;
    return handle;
}

#endif /* HYI_TEXTURES_H */

/* >>scene-energy-tables: computes the albedo tables that the scene's materials need

   shaders/shared/energy.h says what a plane holds. Each value is a quadrature over visible normals, along
   meridians of the spherical cap, each split where reflected or refracted light changes sides. No random
   number: tables are the same everywhere. Materials that agree in what a plane depends on share it; rows
   that nobody reads stay zero. */
#ifndef HYI_ENERGY_TABLES_H
#define HYI_ENERGY_TABLES_H

#define HYI_ENERGY_MERIDIANS 12u /* of half a cap: isotropic */
#define HYI_ENERGY_INSIDE 28u    /* the same where total reflection may come and go between them */
#define HYI_ENERGY_ALONG 20u     /* points of a whole meridian */
#define HYI_ENERGY_PART 12u      /* points of each part of a split one */
#define HYI_ENERGY_PARTS 8u
#define HYI_ENERGY_GAUSS 12u   /* points of the rule for means, in each column */
#define HYI_ENERGY_FEATURES (HYK_NEEDS_SPECULAR | HYK_NEEDS_TRANSMISSION)
#define HYI_ENERGY_COAT_FLOATS (HYK_ENERGY_HEADER + HYK_ENERGY_STRIDE) /* a header with nothing but the coat, its row */

typedef enum hyi_energy_kind { HYI_ENERGY_COAT, HYI_ENERGY_METAL, HYI_ENERGY_PLASTIC, HYI_ENERGY_GLASS, HYI_ENERGY_KINDS } hyi_energy_kind;

typedef struct hyi_gauss {
    double x[HYI_ENERGY_GAUSS], weight[HYI_ENERGY_GAUSS]; /* on [0, 1] */
} hyi_gauss;

/* One set of planes: everything they depend on. */
typedef struct hyi_energy_job {
    hyi_energy_kind kind;
    float ior, coat, coat_roughness;
    uint32_t at;      /* first float of the planes; COAT: of its header */
    uint32_t at_coat; /* header of the coat's job, 0: a header of zeros */
    uint32_t at_metal; /* PLASTIC: the planes of the metal under the same coat */
    uint32_t rows;     /* bit r: row r is read; all only where a texture gives the roughness */
} hyi_energy_job;

typedef struct hyi_energy_build {
    hydra_context *context;
    hyk_material *materials;
    hyi_energy_job *jobs;
    size_t job_capacity;
    uint32_t job_count;
    uint64_t floats;
    uint32_t first_job, jobs_now; /* of the stage at work */
    float *tables;
    hyk_scene_view view;
    hyi_gauss gauss;
    hyk_vec2 around[HYI_ENERGY_MERIDIANS], around_inside[HYI_ENERGY_INSIDE]; /* cosines and sines of the meridians */
} hyi_energy_build;

/* ---- quadrature */

/* Legendre polynomial of degree n and its derivative. */
HYI_FN double hyi_legendre(uint32_t n, double x, double *slope) {
    double p0 = 1.0, p1 = x;
    for (uint32_t k = 2; k <= n; k++) {
        double p2 = ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k;
        p0 = p1;
        p1 = p2;
    }
    *slope = n * (x * p1 - p0) / (x * x - 1.0);
    return p1;
}

/* Roots by Newton's method from Tricomi's estimate. */
HYI_FN void hyi_make_gauss(hyi_gauss *gauss) {
    const uint32_t n = HYI_ENERGY_GAUSS;
    for (uint32_t i = 0; i < n; i++) {
        double x = cos(HYI_PI * (i + 0.75) / (n + 0.5)), slope = 1.0;
        for (int step = 0; step < 8; step++) x -= hyi_legendre(n, x, &slope) / slope;
        hyi_legendre(n, x, &slope);
        gauss->x[i] = 0.5 * (1.0 - x);
        gauss->weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
}

HYI_FN void hyi_make_meridians(hyk_vec2 *around, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        double angle = HYI_PI * (i + 0.5) / count;
        around[i] = hyk_make2((hyk_real)cos(angle), (hyk_real)sin(angle));
    }
}

/* ---- one value: integrals over the normals that wo sees */

typedef struct hyi_energy_sums {
    double lost, schlick, dielectric; /* opaque bases */
    double glass_lost, glass_back;    /* refracting glass */
} hyi_energy_sums;

HYI_FN void hyi_energy_add_opaque(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_vec3 wo, hyk_vec3 h, hyk_real weight, hyi_energy_sums *sums) {
    hyk_real cos_h = hyk_dot(wo, h), whole = hyk_coat_pass(&build->view, *bsdf, wo.z);
    hyk_vec3 wi = hyk_reflect(wo, h, cos_h);
    if (!(wi.z > 0.0f)) {
        sums->lost += (double)(weight * whole);
        return;
    }
    hyk_real pass = hyk_min(whole, hyk_coat_pass(&build->view, *bsdf, wi.z));
    hyk_real stopped = hyk_ggx_stopped(wo, wi, bsdf->alpha), kept = weight * pass * (1.0f - stopped);
    sums->lost += (double)(weight * (whole - pass + pass * stopped));
    sums->schlick += (double)(kept * hyk_schlick_weight(cos_h));
    sums->dielectric += (double)(kept * hyk_fresnel_dielectric(cos_h, bsdf->ior));
}

HYI_FN void hyi_energy_add_glass(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_vec3 wo, hyk_vec3 h, hyk_real weight, hyi_energy_sums *sums) {
    hyk_real cos_h = hyk_dot(wo, h), pass = hyk_coat_pass(&build->view, *bsdf, wo.z);
    bool inside = hyk_bsdf_is(*bsdf, HYK_BSDF_INSIDE);
    hyk_real whole = inside ? 1.0f : pass;
    hyk_vec3 wi = hyk_reflect(wo, h, cos_h);
    bool above = wi.z > 0.0f;
    if (above) pass = hyk_min(pass, hyk_coat_pass(&build->view, *bsdf, wi.z));
    hyk_real stopped = above ? hyk_ggx_stopped(wo, wi, bsdf->alpha) : 1.0f;
    hyk_real back = hyk_glass_facet_reflects(&build->view, *bsdf, cos_h, pass);
    hyk_real g = hyk_refracted_cosine(cos_h, bsdf->glass_eta);
    hyk_real along = 0.0f, stopped_along = 1.0f;
    if (g > 0.0f) {
        wi = hyk_refract(wo, h, cos_h, g, bsdf->glass_eta);
        along = hyk_glass_facet_passes(&build->view, *bsdf, cos_h, g, inside ? hyk_max(-wi.z, 0.0f) : wo.z);
        if (wi.z < 0.0f) stopped_along = hyk_ggx_stopped(wo, wi, bsdf->alpha);
    }
    /* Without a coat back + along is 1, but for rounding that would swamp the small losses. */
    hyk_real rest = bsdf->coat > 0.0f ? whole - back - along : 0.0f;
    sums->glass_lost += (double)(weight * (rest + back * stopped + along * stopped_along));
    sums->glass_back += (double)(weight * back * (1.0f - stopped));
}

/* Which way light leaves a facet: where it changes along a meridian, the integrand has a kink. */
HYI_FN uint32_t hyi_energy_ways(const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec3 h) {
    hyk_real cos_h = hyk_dot(wo, h);
    uint32_t ways = 2.0f * cos_h * h.z > wo.z ? 1u : 0u; /* reflected upwards */
    if (!glass) return ways;
    hyk_real g = hyk_refracted_cosine(cos_h, bsdf->glass_eta);
    if (!(g > 0.0f)) return ways | 2u;
    return ways | (hyk_refract(wo, h, cos_h, g, bsdf->glass_eta).z < 0.0f ? 4u : 0u);
}

/* Places on a meridian where the ways change: the ends of its parts, whose number is returned. A scan finds
   them, bisection their places. */
HYI_FN uint32_t hyi_energy_split(const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec2 around, hyk_real ends[HYI_ENERGY_PARTS]) {
    const uint32_t scan = 12;
    uint32_t count = 0, before = hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, 0.0f));
    for (uint32_t i = 1; i <= scan && count + 1 < HYI_ENERGY_PARTS; i++) {
        hyk_real lo = (hyk_real)(i - 1) / (hyk_real)scan, hi = (hyk_real)i / (hyk_real)scan;
        uint32_t after = hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, hi));
        for (int step = 0; step < 12 && before != after; step++) {
            hyk_real middle = 0.5f * (lo + hi);
            if (hyi_energy_ways(bsdf, glass, wo, hyk_ggx_sample_around(wo, bsdf->alpha, around, middle)) == before) lo = middle;
            else hi = middle;
        }
        if (before != after) ends[count++] = 0.5f * (lo + hi);
        before = after;
    }
    ends[count++] = 1.0f;
    return count;
}

/* Midpoints in t, y = t^3 (10 - 15 t + 6 t^2): that undoes the square roots at both ends of a part, reaches into
   the layer of width alpha^2 where facets are steep, and converges as for periodic integrands (Sidi 1993). */
HYI_FN void hyi_energy_add_part(const hyi_energy_build *build, const hyk_bsdf *bsdf, bool glass, hyk_vec3 wo, hyk_vec2 around, hyk_real lo,
                                hyk_real width, uint32_t points, hyi_energy_sums *sums) {
    for (uint32_t i = 0; i < points; i++) {
        hyk_real t = ((hyk_real)i + 0.5f) / (hyk_real)points;
        hyk_real weight = 30.0f * hyk_square(t * (1.0f - t)) * width / (hyk_real)points;
        hyk_real y = t * t * t * (10.0f + t * (6.0f * t - 15.0f));
        hyk_vec3 h = hyk_ggx_sample_around(wo, bsdf->alpha, around, lo + width * y);
        if (glass) hyi_energy_add_glass(build, bsdf, wo, h, weight, sums);
        else hyi_energy_add_opaque(build, bsdf, wo, h, weight, sums);
    }
}

HYI_FN hyi_energy_sums hyi_energy_integrate(const hyi_energy_build *build, const hyk_bsdf *bsdf, bool glass, hyk_real cos_o) {
    hyi_energy_sums sums;
    bool inside = glass && hyk_bsdf_is(*bsdf, HYK_BSDF_INSIDE);
    const uint32_t meridians = inside ? HYI_ENERGY_INSIDE : HYI_ENERGY_MERIDIANS;
    memset(&sums, 0, sizeof sums);
    hyk_vec3 wo = hyk_make3(hyk_safe_sqrt((1.0f - cos_o) * (1.0f + cos_o)), 0.0f, cos_o);
    for (uint32_t j = 0; j < meridians; j++) {
        hyk_vec2 around = inside ? build->around_inside[j] : build->around[j];
        hyk_real ends[HYI_ENERGY_PARTS], lo = 0.0f;
        uint32_t parts = hyi_energy_split(bsdf, glass, wo, around, ends);
        for (uint32_t i = 0; i < parts; lo = ends[i++])
            hyi_energy_add_part(build, bsdf, glass, wo, around, lo, ends[i] - lo, parts > 1 ? HYI_ENERGY_PART : HYI_ENERGY_ALONG, &sums);
    }
    sums.lost /= meridians;
    sums.schlick /= meridians;
    sums.dielectric /= meridians;
    sums.glass_lost /= meridians;
    sums.glass_back /= meridians;
    return sums;
}

/* ---- one row */

/* 2 integral f(cos) cos dcos, f as the kernels will read it: smooth_part (the plane's limit) plus the differences,
   interpolated between a row and the next, within 0 and 1. Gauss in the logarithm of the cosine: a column may
   span decades. */
typedef double (*hyi_smooth_part)(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real cos_theta);

HYI_FN double hyi_energy_mean(const hyi_energy_build *build, const hyk_bsdf *bsdf, const float *row, double share, hyi_smooth_part smooth_part) {
    double sum = 0.0, hi = log(1e-3 * (double)hyk_energy_cosine(1.0f, bsdf->alpha));
    const float *next = share > 0.0 ? row + HYK_ENERGY_STRIDE : row;
    for (uint32_t c = 0; c + 1 < HYK_ENERGY_COLUMNS; c++) {
        double lo = hi, left = (double)row[c] * (1.0 - share) + (double)next[c] * share, right = (double)row[c + 1] * (1.0 - share) + (double)next[c + 1] * share;
        hi = log((double)hyk_energy_cosine((hyk_real)(c + 1), bsdf->alpha));
        for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) {
            double cosine = exp(lo + (hi - lo) * build->gauss.x[i]);
            double t = (double)hyk_energy_column((hyk_real)cosine, bsdf->alpha) - c;
            double f = left + (right - left) * t;
            if (smooth_part) f += smooth_part(build, bsdf, (hyk_real)cosine);
            f = f < 0.0 ? 0.0 : f > 1.0 ? 1.0 : f;
            sum += 2.0 * f * cosine * cosine * (hi - lo) * build->gauss.weight[i];
        }
    }
    return sum;
}

HYI_FN double hyi_smooth_schlick(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)(hyk_coat_pass(&build->view, *bsdf, c) * hyk_schlick_weight(c));
}
HYI_FN double hyi_smooth_diffuse(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)(hyk_coat_pass(&build->view, *bsdf, c) * (1.0f - hyk_fresnel_dielectric(c, bsdf->ior)));
}
HYI_FN double hyi_smooth_glass(const hyi_energy_build *build, const hyk_bsdf *bsdf, hyk_real c) {
    return (double)hyk_glass_facet_reflects(&build->view, *bsdf, c, hyk_coat_pass(&build->view, *bsdf, c));
}

/* A material of all that a job's planes depend on, at one roughness, with no plane but the coat's. */
HYI_FN hyk_bsdf hyi_energy_bsdf(const hyi_energy_build *build, const hyi_energy_job *job, hyk_real alpha, bool front) {
    hyk_material m;
    memset(&m, 0, sizeof m);
    m.kind = HYK_MATERIAL_METALLIC_ROUGHNESS;
    m.transmission = job->kind == HYI_ENERGY_GLASS ? 1.0f : 0.0f;
    m.ior = job->ior;
    m.clearcoat = job->coat;
    m.clearcoat_roughness = job->coat_roughness;
    m.energy_table = job->at_coat;
    hyk_bsdf bsdf = hyk_make_bsdf(&build->view, m, front, HYI_ENERGY_FEATURES);
    bsdf.alpha = alpha;
    return bsdf;
}

HYI_FN void hyi_energy_coat(hyi_energy_build *build, const hyi_energy_job *job) {
    float *header = build->tables + job->at, *row = header + HYK_ENERGY_HEADER;
    hyi_energy_job bare = *job;
    bare.at_coat = 0;
    bare.coat = 0.0f;
    bare.ior = HYK_COAT_IOR;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, &bare, hyk_alpha_of_roughness(job->coat_roughness), true);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        double sum = hyi_energy_integrate(build, &bsdf, false, cosine).dielectric;
        row[c] = (float)(sum - (double)hyk_fresnel_dielectric(cosine, HYK_COAT_IOR));
    }
    header[HYK_ENERGY_AT_COAT] = (float)((job->at + HYK_ENERGY_HEADER) / HYK_ENERGY_UNIT);
}

HYI_FN void hyi_energy_metal_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    float *lost = build->tables + job->at + r * HYK_ENERGY_STRIDE, *schlick = lost + HYK_ENERGY_PLANE;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), true);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        hyi_energy_sums sums = hyi_energy_integrate(build, &bsdf, false, cosine);
        lost[c] = (float)sums.lost;
        schlick[c] = (float)(sums.schlick - hyi_smooth_schlick(build, &bsdf, cosine));
    }
}

HYI_FN double hyi_dielectric_mean(const hyi_gauss *gauss, float ior) {
    double sum = 0.0;
    for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) { /* cos = x^2: the steep end is at 0 */
        double c = gauss->x[i] * gauss->x[i];
        sum += 4.0 * gauss->weight[i] * gauss->x[i] * c * (double)hyk_fresnel_dielectric((hyk_real)c, ior);
    }
    return sum;
}

HYI_FN void hyi_energy_plastic_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    float *row = build->tables + job->at + r * HYK_ENERGY_STRIDE;
    const float *lost = build->tables + job->at_metal + r * HYK_ENERGY_STRIDE;
    hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), true);
    hyk_real mean = build->tables[job->at_metal + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + r * HYK_ENERGY_MEANS] * hyk_energy_lost_scale(bsdf.alpha);
    hyk_real bounce = hyk_multiple_scattering((hyk_real)hyi_dielectric_mean(&build->gauss, job->ior), 1.0f - mean);
    for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
        hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
        double back = hyi_energy_integrate(build, &bsdf, false, cosine).dielectric;
        double whole = (double)hyk_coat_pass(&build->view, bsdf, cosine);
        row[c] = (float)(whole - back - (double)(bounce * lost[c]) - hyi_smooth_diffuse(build, &bsdf, cosine));
    }
}

HYI_FN void hyi_energy_glass_row(hyi_energy_build *build, const hyi_energy_job *job, uint32_t r) {
    for (uint32_t side = 0; side < 2; side++) {
        float *lost = build->tables + job->at + 2 * side * HYK_ENERGY_PLANE + r * HYK_ENERGY_STRIDE, *back = lost + HYK_ENERGY_PLANE;
        hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)r), side == 0);
        for (uint32_t c = 0; c < HYK_ENERGY_COLUMNS; c++) {
            hyk_real cosine = hyk_energy_cosine((hyk_real)c, bsdf.alpha);
            hyi_energy_sums sums = hyi_energy_integrate(build, &bsdf, true, cosine);
            lost[c] = (float)sums.glass_lost;
            back[c] = (float)(sums.glass_back - hyi_smooth_glass(build, &bsdf, cosine));
        }
    }
}

/* Means from a row up to the next (which may have to be there: share > 0). */
HYI_FN void hyi_energy_row_means(hyi_energy_build *build, const hyi_energy_job *job, uint32_t plane, uint32_t r) {
    float *values = build->tables + job->at + plane * HYK_ENERGY_PLANE;
    float *means = values + HYK_ENERGY_ROWS * HYK_ENERGY_STRIDE + r * HYK_ENERGY_MEANS;
    bool lost = job->kind == HYI_ENERGY_PLASTIC ? false : plane % 2 == 0;
    hyi_smooth_part smooth_part = lost ? NULL : job->kind == HYI_ENERGY_METAL ? hyi_smooth_schlick : job->kind == HYI_ENERGY_GLASS ? hyi_smooth_glass : hyi_smooth_diffuse;
    uint32_t count = r + 1 < HYK_ENERGY_ROWS && (job->rows >> (r + 1) & 1u) ? HYK_ENERGY_MEANS : 1u;
    for (uint32_t j = 0; j < count; j++) {
        double share = (double)j / HYK_ENERGY_MEANS;
        hyk_bsdf bsdf = hyi_energy_bsdf(build, job, hyk_energy_row_alpha((hyk_real)(r + share)), plane < 2);
        double mean = hyi_energy_mean(build, &bsdf, values + r * HYK_ENERGY_STRIDE, share, smooth_part);
        means[j] = (float)(lost ? mean / (double)hyk_energy_lost_scale(bsdf.alpha) : mean);
    }
}

/* ---- what the scene needs */

/* The job that makes these planes: an earlier one, or a new one. */
HYI_FN hydra_result hyi_energy_find(hyi_energy_build *build, hyi_energy_kind kind, float ior, const hyk_material *m, uint32_t *found) {
    hyi_energy_job job;
    memset(&job, 0, sizeof job);
    job.kind = kind;
    job.ior = kind == HYI_ENERGY_COAT || kind == HYI_ENERGY_METAL ? HYK_COAT_IOR : ior;
    if (m->kind == HYK_MATERIAL_METALLIC_ROUGHNESS && m->clearcoat > 0.0f) {
        job.coat = kind == HYI_ENERGY_COAT ? 0.0f : m->clearcoat;
        job.coat_roughness = m->clearcoat_roughness;
    }
    for (*found = 0; *found < build->job_count; ++*found) {
        const hyi_energy_job *old = &build->jobs[*found];
        if (old->kind == kind && old->ior == job.ior && old->coat == job.coat && old->coat_roughness == job.coat_roughness) return HYDRA_OK;
    }
    HYI_TRY(hyi_grow_array(build->context, &build->jobs, &build->job_capacity, (size_t)build->job_count + 1));
    build->jobs[build->job_count++] = job;
    return HYDRA_OK;
}

HYI_FN bool hyi_may_be_rough(const hyk_material *m) {
    return m->metallic_roughness_texture != HYK_NONE ? m->roughness > 0.0f : !hyk_is_smooth(hyk_alpha_of_roughness(m->roughness));
}

/* Whether a material needs a kind of plane. Smooth bases need the plastic's mean, and nothing else. */
HYI_FN bool hyi_energy_needs(const hyk_material *m, hyi_energy_kind kind) {
    bool rough = hyi_may_be_rough(m), thin = (m->flags & HYK_MATERIAL_THIN) != 0;
    if (m->kind == HYK_MATERIAL_LAMBERT) return false;
    if (m->kind == HYK_MATERIAL_CONDUCTOR) return rough && kind == HYI_ENERGY_METAL;
    if (m->kind == HYK_MATERIAL_DIELECTRIC) return rough && (kind == HYI_ENERGY_GLASS) != thin && kind != HYI_ENERGY_COAT;
    switch (kind) {
    case HYI_ENERGY_COAT: return m->clearcoat > 0.0f && !hyk_is_smooth(hyk_alpha_of_roughness(m->clearcoat_roughness));
    case HYI_ENERGY_GLASS: return rough && m->transmission > 0.0f && !thin;
    default: return true;
    }
}

/* A constant roughness lies between two rows. */
HYI_FN uint32_t hyi_energy_rows_read(const hyk_material *m) {
    if (m->metallic_roughness_texture != HYK_NONE) return 0xffffffffu >> (32u - HYK_ENERGY_ROWS);
    hyk_real alpha = hyk_max(hyk_alpha_of_roughness(m->roughness), HYK_SMOOTH_ALPHA);
    return 3u << (hyk_energy_rows_of(alpha).offset / HYK_ENERGY_STRIDE);
}

HYI_FN hydra_result hyi_energy_plan(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    for (uint32_t i = 0; i < count; i++)
        for (int kind = 0; kind < HYI_ENERGY_KINDS; kind++) {
            used[i][kind] = HYK_NONE;
            const hyk_material *m = &build->materials[i];
            if (!hyi_energy_needs(m, (hyi_energy_kind)kind)) continue;
            HYI_TRY(hyi_energy_find(build, (hyi_energy_kind)kind, m->ior, m, &used[i][kind]));
            build->jobs[used[i][kind]].rows |= hyi_energy_rows_read(m);
        }
    return HYDRA_OK;
}

/* Places headers and planes: a header of zeros, the materials' headers, then job by job. */
HYI_FN hydra_result hyi_energy_place(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    static const uint32_t sizes[HYI_ENERGY_KINDS] = { HYI_ENERGY_COAT_FLOATS, 2 * HYK_ENERGY_PLANE, HYK_ENERGY_PLANE, 4 * HYK_ENERGY_PLANE };
    build->floats = HYK_ENERGY_HEADER;
    for (uint32_t i = 0; i < count; i++) {
        bool any = false;
        for (int kind = 0; kind < HYI_ENERGY_KINDS; kind++) any = any || used[i][kind] != HYK_NONE;
        build->materials[i].energy_table = any ? (uint32_t)build->floats : HYK_NONE;
        if (any) build->floats += HYK_ENERGY_HEADER;
        if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24) break;
    }
    for (uint32_t j = 0; j < build->job_count; j++) {
        build->jobs[j].at = (uint32_t)build->floats;
        build->floats += sizes[build->jobs[j].kind];
        if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24) break;
    }
    if (build->floats >= (uint64_t)HYK_ENERGY_UNIT << 24)
        return hyi_fail(build->context, HYDRA_ERROR_OVERFLOW, "albedo tables of too many different materials");
    for (uint32_t i = 0; i < count; i++)
        for (int kind = HYI_ENERGY_METAL; kind < HYI_ENERGY_KINDS; kind++) {
            if (used[i][kind] == HYK_NONE) continue;
            hyi_energy_job *job = &build->jobs[used[i][kind]];
            if (used[i][HYI_ENERGY_COAT] != HYK_NONE) job->at_coat = build->jobs[used[i][HYI_ENERGY_COAT]].at;
            if (kind == HYI_ENERGY_PLASTIC) job->at_metal = build->jobs[used[i][HYI_ENERGY_METAL]].at;
        }
    return HYDRA_OK;
}

HYI_FN float hyi_energy_place_of(const hyi_energy_build *build, uint32_t job) {
    if (job == HYK_NONE) return 0.0f;
    uint32_t at = build->jobs[job].at + (build->jobs[job].kind == HYI_ENERGY_COAT ? HYK_ENERGY_HEADER : 0u);
    return (float)(at / HYK_ENERGY_UNIT);
}

/* Hemispherical mean of one channel's complex Fresnel reflectance. */
HYI_FN double hyi_complex_mean(const hyi_gauss *gauss, hyk_real eta, hyk_real k) {
    double sum = 0.0;
    for (uint32_t i = 0; i < HYI_ENERGY_GAUSS; i++) {
        double c = gauss->x[i] * gauss->x[i];
        sum += 4.0 * gauss->weight[i] * gauss->x[i] * c * (double)hyk_fresnel_complex((hyk_real)c, eta, k);
    }
    return sum;
}

HYI_FN void hyi_energy_header(hyi_energy_build *build, const hyk_material *m, const uint32_t *used) {
    float *header = build->tables + m->energy_table;
    if (m->kind == HYK_MATERIAL_CONDUCTOR && (m->flags & HYK_MATERIAL_COMPLEX_IOR) != 0) {
        header[HYK_ENERGY_METAL_MEAN] = (float)hyi_complex_mean(&build->gauss, m->eta.x, m->k.x);
        header[HYK_ENERGY_METAL_MEAN + 1] = (float)hyi_complex_mean(&build->gauss, m->eta.y, m->k.y);
        header[HYK_ENERGY_METAL_MEAN + 2] = (float)hyi_complex_mean(&build->gauss, m->eta.z, m->k.z);
    }
    header[HYK_ENERGY_IOR_MEAN] = (float)hyi_dielectric_mean(&build->gauss, m->ior);
    header[HYK_ENERGY_AT_METAL] = hyi_energy_place_of(build, used[HYI_ENERGY_METAL]);
    header[HYK_ENERGY_AT_PLASTIC] = hyi_energy_place_of(build, used[HYI_ENERGY_PLASTIC]);
    header[HYK_ENERGY_AT_GLASS] = hyi_energy_place_of(build, used[HYI_ENERGY_GLASS]);
    header[HYK_ENERGY_AT_COAT] = hyi_energy_place_of(build, used[HYI_ENERGY_COAT]);
}

/* ---- building: coats, then metals that read them, then the rest, which reads both */

HYI_FN void hyi_energy_task(void *argument, uint32_t index) {
    hyi_energy_build *build = (hyi_energy_build *)argument;
    const hyi_energy_job *job = &build->jobs[build->first_job + index / HYK_ENERGY_ROWS];
    uint32_t row = index % HYK_ENERGY_ROWS;
    if (job->kind == HYI_ENERGY_COAT && row == 0) hyi_energy_coat(build, job);
    if (!(job->rows >> row & 1u)) return;
    if (job->kind == HYI_ENERGY_METAL) hyi_energy_metal_row(build, job, row);
    if (job->kind == HYI_ENERGY_PLASTIC) hyi_energy_plastic_row(build, job, row);
    if (job->kind == HYI_ENERGY_GLASS) hyi_energy_glass_row(build, job, row);
}

HYI_FN void hyi_energy_mean_task(void *argument, uint32_t index) {
    static const uint32_t planes[HYI_ENERGY_KINDS] = { 0, 2, 1, 4 };
    hyi_energy_build *build = (hyi_energy_build *)argument;
    const hyi_energy_job *job = &build->jobs[build->first_job + index / HYK_ENERGY_ROWS];
    uint32_t row = index % HYK_ENERGY_ROWS;
    for (uint32_t plane = 0; plane < planes[job->kind] && (job->rows >> row & 1u); plane++) hyi_energy_row_means(build, job, plane, row);
}

HYI_FN int hyi_energy_stage(hyi_energy_kind kind) { return kind == HYI_ENERGY_COAT ? 0 : kind == HYI_ENERGY_METAL ? 1 : 2; }

HYI_FN int hyi_energy_compare(const void *a, const void *b) {
    return hyi_energy_stage(((const hyi_energy_job *)a)->kind) - hyi_energy_stage(((const hyi_energy_job *)b)->kind);
}

HYI_FN void hyi_energy_compute(hyi_energy_build *build) {
    uint32_t done = 0;
    qsort(build->jobs, build->job_count, sizeof *build->jobs, hyi_energy_compare);
    while (done < build->job_count) {
        uint32_t end = done;
        while (end < build->job_count && hyi_energy_stage(build->jobs[end].kind) == hyi_energy_stage(build->jobs[done].kind)) end++;
        build->first_job = done;
        hyi_parallel(build->context, (end - done) * HYK_ENERGY_ROWS, hyi_energy_task, build);
        hyi_parallel(build->context, (end - done) * HYK_ENERGY_ROWS, hyi_energy_mean_task, build);
        done = end;
    }
}

HYI_FN hydra_result hyi_energy_run(hyi_energy_build *build, uint32_t count, uint32_t (*used)[HYI_ENERGY_KINDS]) {
    HYI_TRY(hyi_energy_plan(build, count, used));
    HYI_TRY(hyi_energy_place(build, count, used));
    if (build->floats == HYK_ENERGY_HEADER) {
        build->floats = 0;
        return HYDRA_OK;
    }
    HYI_TRY(hyi_alloc_array(build->context, &build->tables, (size_t)build->floats));
    memset(build->tables, 0, (size_t)build->floats * sizeof *build->tables);
    build->view.energy_tables = build->tables;
    hyi_make_gauss(&build->gauss);
    hyi_make_meridians(build->around, HYI_ENERGY_MERIDIANS);
    hyi_make_meridians(build->around_inside, HYI_ENERGY_INSIDE);
    for (uint32_t i = 0; i < count; i++)
        if (build->materials[i].energy_table != HYK_NONE) hyi_energy_header(build, &build->materials[i], used[i]);
    hyi_energy_compute(build);
    return HYDRA_OK;
}

/* Fills energy_table of every material and makes the tables they point into: *tables, *table_count floats, to be
   freed with hyi_free_array; NULL and 0 where no material needs any. */
HYI_FN hydra_result hyi_energy_tables_build(hydra_context *context, hyk_material *materials, uint32_t count, float **tables,
                                            size_t *table_count) {
    hyi_energy_build build;
    uint32_t(*used)[HYI_ENERGY_KINDS];
    memset(&build, 0, sizeof build);
    build.context = context;
    build.materials = materials;
    *tables = NULL;
    *table_count = 0;
    HYI_TRY(hyi_alloc_array(context, &used, count));
    hydra_result result = hyi_energy_run(&build, count, used);
    hyi_free_array(context, &used, count);
    hyi_free_array(context, &build.jobs, build.job_capacity);
    *tables = build.tables;
    *table_count = (size_t)build.floats;
    return result;
}

#endif /* HYI_ENERGY_TABLES_H */

/* >>scene-environment: sampling weights of an environment map (shaders/shared/light_layouts.h has the layout) */
#ifndef HYI_ENVIRONMENT_H
#define HYI_ENVIRONMENT_H

/* Luminance of a texel as the kernels see it: negative texels weigh nothing. */
HYI_INLINE double hyi_texel_luminance(const float *texel) {
    double luminance = 0.2126 * (double)texel[0] + 0.7152 * (double)texel[1] + 0.0722 * (double)texel[2];
    return luminance > 0.0 ? luminance : 0.0;
}

/* How the range splits: the smaller share, negative when it is the upper half's. Nothing above is written
   as the smallest normal number, because minus zero would read as "nothing below". */
HYI_INLINE float hyi_split_share(double below, double above) {
    double sum = below + above;
    if (!(sum > 0.0)) return 0.5f;
    double share = (below <= above ? below : above) / sum;
    float stored = share > (double)FLT_MIN ? (float)share : FLT_MIN;
    return below <= above ? (below > 0.0 ? stored : 0.0f) : -stored;
}

/* Writes the splits of [first, last) and returns its weight. The recursion is as deep as a binary logarithm. */
HYI_FN double hyi_split_weights(const double *weights, float *splits, uint32_t first, uint32_t last) {
    if (last - first == 1) return weights[first];
    uint32_t middle = first + (last - first) / 2;
    double below = hyi_split_weights(weights, splits, first, middle), above = hyi_split_weights(weights, splits, middle, last);
    splits[middle] = hyi_split_share(below, above);
    return below + above;
}

typedef struct hyi_environment_work {
    const float *texels;
    uint32_t width, height;
    float *cdf;
    double *scratch;     /* width weights per strip of rows */
    double *row_weights; /* height + 1 */
    uint32_t strips;
} hyi_environment_work;

/* Weights of one row's cells, and its splits. */
HYI_FN void hyi_environment_row(const hyi_environment_work *work, uint32_t row, double *weights) {
    uint32_t w = work->width, h = work->height;
    const float *above = work->texels + 3 * (size_t)w * (row == 0 ? 0 : row - 1);
    const float *below = work->texels + 3 * (size_t)w * (row == h ? h - 1 : row);
    double from = row == 0 ? 0.0 : HYI_PI * ((double)row - 0.5) / (double)h, to = row == h ? HYI_PI : HYI_PI * ((double)row + 0.5) / (double)h;
    double solid_angle = 2.0 * sin(0.5 * (from + to)) * sin(0.5 * (to - from)) * 2.0 * HYI_PI / (double)w;
    for (uint32_t x = 0; x < w; x++) {
        uint32_t right = x + 1 == w ? 0 : x + 1;
        double sum = hyi_texel_luminance(above + 3 * (size_t)x) + hyi_texel_luminance(above + 3 * (size_t)right) +
                     hyi_texel_luminance(below + 3 * (size_t)x) + hyi_texel_luminance(below + 3 * (size_t)right);
        weights[x] = 0.25 * sum * solid_angle;
    }
    work->row_weights[row] = hyi_split_weights(weights, work->cdf + (h + 1) + (size_t)w * row, 0, w);
}

HYI_FN void hyi_environment_strip(void *argument, uint32_t strip) {
    const hyi_environment_work *work = (const hyi_environment_work *)argument;
    uint32_t rows = work->height + 1;
    uint32_t first = (uint32_t)((uint64_t)rows * strip / work->strips), last = (uint32_t)((uint64_t)rows * (strip + 1) / work->strips);
    for (uint32_t row = first; row < last; row++) hyi_environment_row(work, row, work->scratch + (size_t)work->width * strip);
}

/* texels: width x height RGB, both at least 1, finite. *cdf gets *cdf_count numbers (free with hyi_free_array),
   *integral the sum of the weights: 0 for a black map. On error nothing is allocated. */
HYI_FN hydra_result hyi_environment_build(hydra_context *context, const float *texels, uint32_t width, uint32_t height, float **cdf,
                                          size_t *cdf_count, float *integral) {
    *cdf = NULL;
    *cdf_count = 0;
    *integral = 0.0f;
    if (hyi_multiply_overflows(width, (size_t)height + 2)) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "environment of %u x %u", width, height);
    size_t count = ((size_t)height + 1) + (size_t)width * ((size_t)height + 1);
    hyi_environment_work work;
    memset(&work, 0, sizeof work);
    work.texels = texels;
    work.width = width;
    work.height = height;
    work.strips = height < 64 ? height + 1 : 64;
    HYI_TRY(hyi_alloc_array(context, &work.cdf, count));
    hydra_result result = hyi_alloc_array(context, &work.scratch, (size_t)width * work.strips);
    if (result == HYDRA_OK) result = hyi_alloc_array(context, &work.row_weights, (size_t)height + 1);
    if (result == HYDRA_OK) {
        memset(work.cdf, 0, count * sizeof *work.cdf); /* places no split uses */
        hyi_parallel(context, work.strips, hyi_environment_strip, &work);
        double sum = hyi_split_weights(work.row_weights, work.cdf, 0, height + 1);
        *integral = sum < (double)FLT_MAX ? (float)sum : FLT_MAX;
        *cdf = work.cdf;
        *cdf_count = count;
    } else {
        hyi_free_array(context, &work.cdf, count);
    }
    hyi_free_array(context, &work.row_weights, (size_t)height + 1);
    hyi_free_array(context, &work.scratch, (size_t)width * work.strips);
    return result;
}

#endif /* HYI_ENVIRONMENT_H */

/* >>scene-light-tree: the tree over the finite lights

   Conty Estevez & Kulla 2018: top-down, split where the surface area orientation heuristic is least, over
   bins of the lights' middles along each axis. Two things differ. A node is weighed by the lights' largest
   intensity, not their flux: that is what a point facing them gets, so narrow spots are not undervalued. And
   while bins are compared the spread of normals is measured by the length of their mean (a cap of half angle
   t has a mean of length (1 + cos t) / 2), which adds up without trigonometry; the cones stored in the nodes
   are true bounds, joined bottom-up. */
#ifndef HYI_LIGHT_TREE_H
#define HYI_LIGHT_TREE_H

#define HYI_LIGHT_BINS 16u

HYI_INLINE double hyi_light_luminance(hyk_vec3 c) { return 0.2126 * (double)c.x + 0.7152 * (double)c.y + 0.0722 * (double)c.z; }

/* Largest luminous intensity, W/sr weighed by luminance, that the light sends in any direction. */
HYI_FN double hyi_light_intensity(const hyk_light *light) {
    double luminance = hyi_light_luminance(light->radiance);
    switch (light->kind) {
    case HYK_LIGHT_POINT:
    case HYK_LIGHT_SPOT: return luminance;
    case HYK_LIGHT_SPHERE: return luminance * HYI_PI * (double)light->radius * (double)light->radius;
    default: return luminance * (double)light->area;
    }
}

/* ---- one light's bounds */

typedef struct hyi_light_item {
    float lower[3], upper[3];
    float axis[3];     /* zero: sends into all directions alike, or to both sides */
    float intensity;
    uint32_t light;
} hyi_light_item;

HYI_INLINE void hyi_light_item_grow(hyi_light_item *item, float x, float y, float z) {
    const float p[3] = {x, y, z};
    for (int k = 0; k < 3; k++) {
        if (p[k] < item->lower[k]) item->lower[k] = p[k];
        if (p[k] > item->upper[k]) item->upper[k] = p[k];
    }
}

/* The point of the light's middle plus or minus reach along each axis. */
HYI_FN void hyi_light_item_reach(hyi_light_item *item, const hyk_light *light, float x, float y, float z) {
    hyi_light_item_grow(item, light->position.x - x, light->position.y - y, light->position.z - z);
    hyi_light_item_grow(item, light->position.x + x, light->position.y + y, light->position.z + z);
}

HYI_INLINE float hyi_disc_reach(float radius, float normal) { return radius * sqrtf(fmaxf(1.0f - normal * normal, 0.0f)); }

HYI_FN void hyi_light_item_box(hyi_light_item *item, const hyk_light *light) {
    hyk_vec3 p = light->position, u = light->axis_u, v = light->axis_v, n = light->normal;
    float r = light->radius;
    item->lower[0] = item->upper[0] = p.x;
    item->lower[1] = item->upper[1] = p.y;
    item->lower[2] = item->upper[2] = p.z;
    if (light->kind == HYK_LIGHT_RECT)
        hyi_light_item_reach(item, light, fabsf(u.x) + fabsf(v.x), fabsf(u.y) + fabsf(v.y), fabsf(u.z) + fabsf(v.z));
    if (light->kind == HYK_LIGHT_DISC) hyi_light_item_reach(item, light, hyi_disc_reach(r, n.x), hyi_disc_reach(r, n.y), hyi_disc_reach(r, n.z));
    if (light->kind == HYK_LIGHT_SPHERE) hyi_light_item_reach(item, light, r, r, r);
    if (light->kind == HYK_LIGHT_TRIANGLE) {
        hyi_light_item_grow(item, p.x + u.x, p.y + u.y, p.z + u.z);
        hyi_light_item_grow(item, p.x + v.x, p.y + v.y, p.z + v.z);
    }
}

HYI_INLINE bool hyi_light_has_axis(const hyk_light *light) { return light->kind != HYK_LIGHT_POINT && light->kind != HYK_LIGHT_SPHERE; }

HYI_FN void hyi_light_item_fill(hyi_light_item *item, const hyk_light *light, uint32_t index) {
    bool axis = hyi_light_has_axis(light) && !(light->flags & HYK_LIGHT_BOTH_SIDES);
    double intensity = hyi_light_intensity(light);
    item->light = index;
    item->intensity = intensity < 1e36 ? (float)intensity : 1e36f;
    item->axis[0] = axis ? light->normal.x : 0.0f;
    item->axis[1] = axis ? light->normal.y : 0.0f;
    item->axis[2] = axis ? light->normal.z : 0.0f;
    hyi_light_item_box(item, light);
}

/* ---- cones of directions */

typedef struct hyi_light_cone {
    double axis[3];
    double spread, emission; /* angles: of the normals around the axis, of emission around a normal */
    bool both_sides;
} hyi_light_cone;

HYI_FN hyi_light_cone hyi_cone_of_light(const hyk_light *light) {
    hyi_light_cone cone;
    cone.axis[0] = (double)light->normal.x;
    cone.axis[1] = (double)light->normal.y;
    cone.axis[2] = (double)light->normal.z;
    cone.spread = 0.0;
    cone.emission = 0.5 * HYI_PI;
    cone.both_sides = (light->flags & HYK_LIGHT_BOTH_SIDES) != 0 && hyi_light_has_axis(light);
    if (!hyi_light_has_axis(light)) {
        cone.axis[0] = cone.axis[1] = 0.0;
        cone.axis[2] = 1.0;
        cone.spread = HYI_PI;
    }
    if (light->kind == HYK_LIGHT_SPOT) { /* its flat beam is no cosine: the bound stays above cos 1.3 inside the beam */
        double outer = acos(fmin(fmax((double)light->cos_outer, -1.0), 1.0));
        cone.emission = fmin(outer, 1.3);
        cone.spread = outer - cone.emission;
    }
    return cone;
}

HYI_INLINE double hyi_dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

HYI_FN hyi_light_cone hyi_cone_everywhere(hyi_light_cone a, double emission) {
    a.spread = HYI_PI;
    a.emission = emission;
    return a;
}

/* a's axis turned by an angle towards b. */
HYI_FN void hyi_cone_turn(hyi_light_cone *a, const double *b, double angle) {
    double along = hyi_dot3(a->axis, b), side[3], length;
    for (int k = 0; k < 3; k++) side[k] = b[k] - along * a->axis[k];
    length = sqrt(hyi_dot3(side, side));
    if (!(length > 0.0)) return;
    for (int k = 0; k < 3; k++) a->axis[k] = cos(angle) * a->axis[k] + sin(angle) * side[k] / length;
    length = sqrt(hyi_dot3(a->axis, a->axis));
    for (int k = 0; k < 3; k++) a->axis[k] /= length;
}

/* The narrowest cone around two. Where light leaves to both sides an axis and its opposite mean the same. */
HYI_FN hyi_light_cone hyi_cone_join(hyi_light_cone a, hyi_light_cone b) {
    double emission = fmax(a.emission, b.emission);
    if (a.spread < b.spread) {
        hyi_light_cone swap = a;
        a = b;
        b = swap;
    }
    a.both_sides = a.both_sides || b.both_sides;
    if (a.both_sides && hyi_dot3(a.axis, b.axis) < 0.0)
        for (int k = 0; k < 3; k++) b.axis[k] = -b.axis[k];
    double cross[3] = {a.axis[1] * b.axis[2] - a.axis[2] * b.axis[1], a.axis[2] * b.axis[0] - a.axis[0] * b.axis[2],
                       a.axis[0] * b.axis[1] - a.axis[1] * b.axis[0]};
    double between = atan2(sqrt(hyi_dot3(cross, cross)), hyi_dot3(a.axis, b.axis));
    a.emission = emission;
    if (fmin(between + b.spread, HYI_PI) <= a.spread) return a;
    double spread = 0.5 * (a.spread + between + b.spread);
    if (spread >= HYI_PI || between >= HYI_PI - 1e-9) return hyi_cone_everywhere(a, emission);
    hyi_cone_turn(&a, b.axis, spread - a.spread);
    a.spread = spread;
    return a;
}

/* ---- splitting */

typedef struct hyi_light_bin {
    float lower[3], upper[3];
    double axis[3], intensity;
    uint32_t count;
} hyi_light_bin;

HYI_FN void hyi_light_bin_clear(hyi_light_bin *bin) {
    memset(bin, 0, sizeof *bin);
    for (int k = 0; k < 3; k++) {
        bin->lower[k] = FLT_MAX;
        bin->upper[k] = -FLT_MAX;
    }
}

HYI_INLINE void hyi_light_bin_box(hyi_light_bin *bin, const float *lower, const float *upper) {
    for (int k = 0; k < 3; k++) {
        if (lower[k] < bin->lower[k]) bin->lower[k] = lower[k];
        if (upper[k] > bin->upper[k]) bin->upper[k] = upper[k];
    }
}

HYI_INLINE void hyi_light_bin_add(hyi_light_bin *bin, const hyi_light_item *item) {
    hyi_light_bin_box(bin, item->lower, item->upper);
    for (int k = 0; k < 3; k++) bin->axis[k] += (double)item->intensity * (double)item->axis[k];
    bin->intensity += (double)item->intensity;
    bin->count++;
}

HYI_FN void hyi_light_bin_join(hyi_light_bin *bin, const hyi_light_bin *other) {
    if (other->count == 0) return;
    hyi_light_bin_box(bin, other->lower, other->upper);
    for (int k = 0; k < 3; k++) bin->axis[k] += other->axis[k];
    bin->intensity += other->intensity;
    bin->count += other->count;
}

/* Intensity x extent^2 x solid angle lit, the last from pi (one normal) to 4 pi (all directions). The extent
   is the bounding sphere's, which is what sampling sees; unlike an area it is not zero for lights in a line. */
HYI_FN double hyi_light_bin_cost(const hyi_light_bin *bin) {
    if (bin->count == 0 || !(bin->intensity > 0.0)) return 0.0;
    double extent = 0.0, mean = hyi_dot3(bin->axis, bin->axis) / (bin->intensity * bin->intensity);
    for (int k = 0; k < 3; k++) {
        double side = (double)bin->upper[k] - (double)bin->lower[k];
        extent += side * side;
    }
    return bin->intensity * extent * (4.0 - 3.0 * fmin(mean, 1.0));
}

/* The items in work and where they come out. */
typedef struct hyi_light_build {
    hyk_light *lights;
    hyk_light_node *nodes;
    hyi_light_item *items;
    uint32_t used;
} hyi_light_build;

typedef struct hyi_light_split {
    double cost;
    int axis;      /* -1: none */
    uint32_t bin;  /* first of the upper half */
    float lower, scale;
} hyi_light_split;

HYI_INLINE float hyi_light_middle(const hyi_light_item *item, int axis) { return 0.5f * item->lower[axis] + 0.5f * item->upper[axis]; }

HYI_INLINE uint32_t hyi_light_bin_of(float middle, float lower, float scale) {
    float x = (middle - lower) * scale;
    if (!(x > 0.0f)) return 0;
    return x < (float)HYI_LIGHT_BINS ? (uint32_t)x : HYI_LIGHT_BINS - 1;
}

/* Sweeps the borders between bins. largest: more than that many lights may not go to one side. */
HYI_FN void hyi_light_sweep(const hyi_light_bin *bins, uint32_t largest, double stretch, hyi_light_split *best, const hyi_light_split *candidate) {
    double below_cost[HYI_LIGHT_BINS];
    uint32_t below_count[HYI_LIGHT_BINS];
    hyi_light_bin sum;
    hyi_light_bin_clear(&sum);
    for (uint32_t i = 0; i + 1 < HYI_LIGHT_BINS; i++) {
        hyi_light_bin_join(&sum, &bins[i]);
        below_cost[i + 1] = hyi_light_bin_cost(&sum);
        below_count[i + 1] = sum.count;
    }
    hyi_light_bin_clear(&sum);
    for (uint32_t i = HYI_LIGHT_BINS - 1; i > 0; i--) {
        hyi_light_bin_join(&sum, &bins[i]);
        if (sum.count == 0 || below_count[i] == 0 || sum.count > largest || below_count[i] > largest) continue;
        double cost = stretch * (below_cost[i] + hyi_light_bin_cost(&sum));
        if (best->axis >= 0 && cost >= best->cost) continue;
        *best = *candidate;
        best->cost = cost;
        best->bin = i;
    }
}

HYI_FN void hyi_light_bounds_of_middles(const hyi_light_item *items, uint32_t count, float *lower, float *upper) {
    for (int k = 0; k < 3; k++) lower[k] = upper[k] = hyi_light_middle(items, k);
    for (uint32_t i = 1; i < count; i++)
        for (int k = 0; k < 3; k++) {
            float x = hyi_light_middle(&items[i], k);
            if (x < lower[k]) lower[k] = x;
            if (x > upper[k]) upper[k] = x;
        }
}

/* Thin nodes are split across first: the regulariser k_r of the paper. */
HYI_FN hyi_light_split hyi_light_find_split(const hyi_light_item *items, uint32_t count, uint32_t largest) {
    float lower[3], upper[3], longest = 0.0f;
    hyi_light_split best, candidate;
    hyi_light_bin bins[3][HYI_LIGHT_BINS];
    memset(&best, 0, sizeof best);
    best.axis = -1;
    hyi_light_bounds_of_middles(items, count, lower, upper);
    for (int k = 0; k < 3; k++) {
        longest = fmaxf(longest, upper[k] - lower[k]);
        for (uint32_t i = 0; i < HYI_LIGHT_BINS; i++) hyi_light_bin_clear(&bins[k][i]);
    }
    float scale[3];
    for (int k = 0; k < 3; k++) scale[k] = upper[k] > lower[k] ? fminf((float)HYI_LIGHT_BINS / (upper[k] - lower[k]), FLT_MAX) : 0.0f;
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            if (scale[k] > 0.0f) hyi_light_bin_add(&bins[k][hyi_light_bin_of(hyi_light_middle(&items[i], k), lower[k], scale[k])], &items[i]);
    for (int k = 0; k < 3; k++) {
        if (!(scale[k] > 0.0f)) continue;
        memset(&candidate, 0, sizeof candidate);
        candidate.axis = k;
        candidate.lower = lower[k];
        candidate.scale = scale[k];
        hyi_light_sweep(bins[k], largest, (double)longest / ((double)upper[k] - (double)lower[k]), &best, &candidate);
    }
    return best;
}

/* Moves the lower half to the front, stably enough to be deterministic; returns its size. */
HYI_FN uint32_t hyi_light_partition(hyi_light_item *items, uint32_t count, const hyi_light_split *split) {
    uint32_t front = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (hyi_light_bin_of(hyi_light_middle(&items[i], split->axis), split->lower, split->scale) >= split->bin) continue;
        hyi_light_item swap = items[front];
        items[front] = items[i];
        items[i] = swap;
        front++;
    }
    return front;
}

HYI_FN uint32_t hyi_light_divide(hyi_light_item *items, uint32_t count, uint32_t depth) {
    uint32_t levels_left = HYK_LIGHT_TREE_DEPTH - depth - 1; /* below a child */
    uint32_t largest = levels_left >= 31 ? 0x7fffffffu : 1u << levels_left;
    if (count == 2) return 1;
    hyi_light_split split = hyi_light_find_split(items, count, largest);
    return split.axis < 0 ? count / 2 : hyi_light_partition(items, count, &split);
}

/* ---- nodes */

HYI_FN void hyi_light_node_cone(hyk_light_node *node, const hyi_light_cone *cone) {
    /* rounded outwards; a single orientation stays one, which sampling makes use of */
    double spread = cone->spread > 0.0 ? fmin(cone->spread + 1e-6, HYI_PI) : 0.0;
    node->axis.x = (float)cone->axis[0];
    node->axis.y = (float)cone->axis[1];
    node->axis.z = (float)cone->axis[2];
    node->cos_o = cone->spread >= HYI_PI ? -1.0f : fminf((float)cos(spread), spread > 0.0 ? 1.0f - FLT_EPSILON : 1.0f);
    node->cos_e = cone->emission >= 0.5 * HYI_PI ? 0.0f : (float)cos(cone->emission);
    node->both_sides = cone->both_sides ? 1u : 0u;
}

HYI_FN hyi_light_cone hyi_light_make_leaf(hyi_light_build *build, uint32_t at, const hyi_light_item *item, uint32_t path) {
    hyk_light_node *node = &build->nodes[at];
    hyi_light_cone cone = hyi_cone_of_light(&build->lights[item->light]);
    build->lights[item->light].tree_path = path;
    memset(node, 0, sizeof *node);
    node->lower.x = item->lower[0], node->lower.y = item->lower[1], node->lower.z = item->lower[2];
    node->upper.x = item->upper[0], node->upper.y = item->upper[1], node->upper.z = item->upper[2];
    node->intensity = item->intensity;
    node->child = item->light;
    node->is_leaf = 1;
    hyi_light_node_cone(node, &cone);
    return cone;
}

HYI_FN hyi_light_cone hyi_light_make_node(hyi_light_build *build, hyi_light_item *items, uint32_t count, uint32_t depth, uint32_t path) {
    uint32_t at = build->used++;
    if (count == 1) return hyi_light_make_leaf(build, at, items, path);
    uint32_t half = hyi_light_divide(items, count, depth);
    hyi_light_cone first = hyi_light_make_node(build, items, half, depth + 1, path);
    uint32_t second_at = build->used;
    hyi_light_cone second = hyi_light_make_node(build, items + half, count - half, depth + 1, path | 1u << depth);
    hyi_light_cone cone = hyi_cone_join(first, second);
    const hyk_light_node *a = &build->nodes[at + 1], *b = &build->nodes[second_at];
    hyk_light_node *node = &build->nodes[at];
    memset(node, 0, sizeof *node);
    node->lower.x = fminf(a->lower.x, b->lower.x), node->upper.x = fmaxf(a->upper.x, b->upper.x);
    node->lower.y = fminf(a->lower.y, b->lower.y), node->upper.y = fmaxf(a->upper.y, b->upper.y);
    node->lower.z = fminf(a->lower.z, b->lower.z), node->upper.z = fmaxf(a->upper.z, b->upper.z);
    node->intensity = fminf(a->intensity + b->intensity, 1e36f);
    node->child = second_at;
    hyi_light_node_cone(node, &cone);
    return cone;
}

/* Builds the tree over lights[0, finite_count) and writes their tree_path. *nodes gets *node_count =
   2 finite_count - 1 nodes (NULL and 0 without lights); free with hyi_free_array. The same lights give the
   same tree, whatever the threads. */
HYI_FN hydra_result hyi_light_tree_build(hydra_context *context, hyk_light *lights, uint32_t finite_count, hyk_light_node **nodes,
                                         uint32_t *node_count) {
    *nodes = NULL;
    *node_count = 0;
    if (finite_count == 0) return HYDRA_OK;
    if (finite_count > 0x7fffffffu) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u lights", finite_count);
    hyi_light_build build;
    memset(&build, 0, sizeof build);
    build.lights = lights;
    HYI_TRY(hyi_alloc_array(context, &build.items, finite_count));
    hydra_result result = hyi_alloc_array(context, &build.nodes, 2 * (size_t)finite_count - 1);
    if (result == HYDRA_OK) {
        for (uint32_t i = 0; i < finite_count; i++) hyi_light_item_fill(&build.items[i], &lights[i], i);
        hyi_light_make_node(&build, build.items, finite_count, 0, 0);
        *nodes = build.nodes;
        *node_count = build.used;
    }
    hyi_free_array(context, &build.items, finite_count);
    return result;
}

#endif /* HYI_LIGHT_TREE_H */

/* >>scene-lights: light descriptors, the environment, and the list of all emitters of a committed scene */
#ifndef HYI_LIGHTS_H
#define HYI_LIGHTS_H

HYI_STATIC_ASSERT((int)HYK_LIGHT_RECT == (int)HYDRA_LIGHT_RECT && (int)HYK_LIGHT_DISC == (int)HYDRA_LIGHT_DISC &&
                  (int)HYK_LIGHT_SPHERE == (int)HYDRA_LIGHT_SPHERE && (int)HYK_LIGHT_POINT == (int)HYDRA_LIGHT_POINT &&
                  (int)HYK_LIGHT_SPOT == (int)HYDRA_LIGHT_SPOT && (int)HYK_LIGHT_SUN == (int)HYDRA_LIGHT_SUN);

/* ---- descriptor to record */

HYI_FN hydra_result hyi_check_light_unit(hydra_context *context, const hydra_light_desc *d) {
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_LIGHT_SUN + 1, "light.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->unit, HYDRA_UNIT_IRRADIANCE + 1, "light.unit"));
    if ((d->unit == HYDRA_UNIT_POWER && d->kind == HYDRA_LIGHT_SUN) || (d->unit == HYDRA_UNIT_IRRADIANCE && d->kind != HYDRA_LIGHT_SUN))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.unit %d does not fit light.kind %d", (int)d->unit, (int)d->kind);
    return HYDRA_OK;
}

HYI_FN double hyi_cone_outer(const hydra_light_desc *d) { return d->cone_outer != 0.0f ? (double)d->cone_outer : 0.25 * HYI_PI; }

HYI_FN hydra_result hyi_check_light(hydra_context *context, const hydra_light_desc *d) {
    HYI_TRY(hyi_check_light_unit(context, d));
    HYI_TRY(hyi_check_color(context, d->color, FLT_MAX, "light.color"));
    HYI_TRY(hyi_check_finite(context, d->position, 3, "light.position"));
    HYI_TRY(hyi_check_finite(context, d->direction, 3, "light.direction"));
    HYI_TRY(hyi_check_finite(context, d->axis_u, 3, "light.axis_u"));
    HYI_TRY(hyi_check_finite(context, d->axis_v, 3, "light.axis_v"));
    HYI_TRY(hyi_check_finite(context, &d->radius, 1, "light.radius"));
    if ((d->kind == HYDRA_LIGHT_DISC || d->kind == HYDRA_LIGHT_SPHERE) && !(d->radius > 0.0f))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.radius is %g", (double)d->radius);
    HYI_TRY(hyi_check_range(context, d->cone_outer, 0.0f, 3.1415927f, HYDRA_ERROR_LIGHT, "light.cone_outer"));
    HYI_TRY(hyi_check_range(context, d->cone_inner, 0.0f, 3.1415927f, HYDRA_ERROR_LIGHT, "light.cone_inner"));
    if ((double)d->cone_inner > hyi_cone_outer(d))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.cone_inner %g is wider than cone_outer %g", (double)d->cone_inner, hyi_cone_outer(d));
    return hyi_check_range(context, d->angular_radius, 0.0f, 1.5707f, HYDRA_ERROR_LIGHT, "light.angular_radius");
}

/* Radiance from flux, for a sheet or sphere of given area. */
HYI_FN float hyi_area_scale(const hydra_light_desc *d, double area, bool both_sides) {
    return d->unit == HYDRA_UNIT_POWER ? (float)(1.0 / (HYI_PI * area * (both_sides ? 2.0 : 1.0))) : 1.0f;
}

HYI_FN hydra_result hyi_fill_rect(hydra_context *context, const hydra_light_desc *d, hyk_light *light, float *scale) {
    light->axis_u = hyi_vec3(d->axis_u);
    light->axis_v = hyi_vec3(d->axis_v);
    float lu = hyk_length(light->axis_u), lv = hyk_length(light->axis_v);
    hyk_vec3 across = hyk_cross(hyk_normalize(light->axis_u), hyk_normalize(light->axis_v));
    float sine = hyk_length(across);
    if (!(lu > 0.0f && lv > 0.0f && sine > 1e-4f)) return hyi_fail(context, HYDRA_ERROR_LIGHT, "axis_u and axis_v span no rectangle");
    if (fabsf(hyk_dot(hyk_normalize(light->axis_u), hyk_normalize(light->axis_v))) > 1e-3f)
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "axis_u and axis_v are not perpendicular");
    double area = 4.0 * (double)lu * (double)lv * (double)sine;
    light->normal = hyk_normalize(across);
    light->area = (float)area;
    *scale = hyi_area_scale(d, area, d->both_sides);
    return HYDRA_OK;
}

HYI_FN void hyi_fill_round(const hydra_light_desc *d, hyk_light *light, float *scale) {
    bool disc = d->kind == HYDRA_LIGHT_DISC;
    double r = (double)d->radius, area = (disc ? 1.0 : 4.0) * HYI_PI * r * r;
    light->radius = d->radius;
    light->area = (float)area;
    *scale = hyi_area_scale(d, area, disc && d->both_sides);
}

/* The falloff between the cones integrates to half their difference in cosine (light.h). */
HYI_FN void hyi_fill_spot(const hydra_light_desc *d, hyk_light *light, float *scale) {
    double outer = hyi_cone_outer(d);
    double inner = d->cone_inner != 0.0f ? (double)d->cone_inner : 0.9 * outer;
    light->cos_outer = (float)cos(outer);
    light->cos_inner = (float)cos(inner);
    double solid = 2.0 * HYI_PI * (2.0 * pow(sin(0.5 * inner), 2.0) + pow(sin(0.5 * outer), 2.0) - pow(sin(0.5 * inner), 2.0));
    if (d->unit == HYDRA_UNIT_POWER) *scale = (float)(1.0 / solid);
}

HYI_FN void hyi_fill_sun(const hydra_light_desc *d, hyk_light *light, float *scale) {
    light->normal = hyk_neg(light->normal); /* towards the sun */
    light->radius = d->angular_radius;
    light->cos_outer = cosf(d->angular_radius);
    double sine = sin((double)d->angular_radius);
    if (d->unit == HYDRA_UNIT_IRRADIANCE && d->angular_radius > 0.0f) *scale = (float)(1.0 / (HYI_PI * sine * sine));
}

HYI_FN hydra_result hyi_fill_light(hydra_context *context, const hydra_light_desc *d, hyk_light *light) {
    memset(light, 0, sizeof *light);
    HYI_TRY(hyi_check_light(context, d));
    float scale = 1.0f;
    light->kind = (uint32_t)d->kind;
    light->flags = (d->both_sides ? HYK_LIGHT_BOTH_SIDES : 0u) | (d->hidden ? HYK_LIGHT_HIDDEN : 0u);
    light->instance = light->primitive = HYK_NONE;
    light->position = hyi_vec3(d->position);
    light->normal = hyi_all_zero(d->direction, 3) ? hyk_make3(0.0f, -1.0f, 0.0f) : hyk_normalize(hyi_vec3(d->direction));
    switch (d->kind) {
        case HYDRA_LIGHT_RECT: HYI_TRY(hyi_fill_rect(context, d, light, &scale)); break;
        case HYDRA_LIGHT_DISC:
        case HYDRA_LIGHT_SPHERE: hyi_fill_round(d, light, &scale); break;
        case HYDRA_LIGHT_POINT:
            if (d->unit == HYDRA_UNIT_POWER) scale = (float)(0.25 / HYI_PI);
            break;
        case HYDRA_LIGHT_SPOT: hyi_fill_spot(d, light, &scale); break;
        case HYDRA_LIGHT_SUN: hyi_fill_sun(d, light, &scale); break;
    }
    light->radiance = hyk_scale(hyi_vec3(d->color), scale);
    if (!hyi_is_finite(light->radiance.x) || !hyi_is_finite(light->radiance.y) || !hyi_is_finite(light->radiance.z) || !hyi_is_finite(light->area))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "its area or radiance exceeds the range of float");
    return HYDRA_OK;
}

HYDRA_API hydra_light hydra_scene_add_light(hydra_scene *scene, const hydra_light_desc *desc) {
    hydra_light handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_light") != HYDRA_OK) return handle;
    hyi_light_slot slot;
    slot.alive = true;
    if (hyi_reject(scene, hyi_fill_light(scene->context, desc, &slot.record)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->lights, &scene->light_capacity, scene->light_count + 1)) != HYDRA_OK) return handle;
    scene->lights[scene->light_count++] = slot;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    handle.id = (uint32_t)scene->light_count;
    return handle;
}

HYI_FN hydra_result hyi_check_light_handle(hydra_scene *scene, hydra_light light) {
    if (light.id == 0 || light.id > scene->light_count || !scene->lights[light.id - 1].alive)
        return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "light %u", light.id);
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_update_light(hydra_scene *scene, hydra_light light, const hydra_light_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_light"));
    HYI_TRY(hyi_reject(scene, hyi_check_light_handle(scene, light)));
    hyk_light record;
    HYI_TRY(hyi_reject(scene, hyi_fill_light(scene->context, desc, &record)));
    scene->lights[light.id - 1].record = record;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_remove_light(hydra_scene *scene, hydra_light light) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_remove_light"));
    HYI_TRY(hyi_reject(scene, hyi_check_light_handle(scene, light)));
    scene->lights[light.id - 1].alive = false;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    return HYDRA_OK;
}

/* ---- environment */

HYI_FN hydra_result hyi_check_environment(hydra_context *context, const hydra_environment_desc *d) {
    HYI_TRY(hyi_check_color(context, d->color, FLT_MAX, "environment.color"));
    HYI_TRY(hyi_check_finite(context, &d->rotation, 1, "environment.rotation"));
    if (!d->texels && (d->width || d->height)) return hyi_fail(context, HYDRA_ERROR_NULL, "environment.texels, of %u x %u", d->width, d->height);
    if (!d->texels) return HYDRA_OK;
    if (d->width == 0 || d->height == 0 || d->width > 65536 || d->height > 65536)
        return hyi_fail(context, HYDRA_ERROR_TEXTURE, "the environment has %u x %u texels", d->width, d->height);
    for (size_t i = 0; i < (size_t)3 * d->width * d->height; i++) {
        if (!hyi_is_finite(d->texels[i])) return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "environment texel %zu", i / 3);
        if (d->texels[i] < 0.0f) return hyi_fail(context, HYDRA_ERROR_COLOR, "environment texel %zu has a channel of %g", i / 3, (double)d->texels[i]);
    }
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_set_environment(hydra_scene *scene, const hydra_environment_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_set_environment"));
    float *texels = NULL;
    size_t count = 0;
    if (desc) {
        HYI_TRY(hyi_reject(scene, hyi_check_environment(scene->context, desc)));
        if (desc->texels) {
            count = (size_t)3 * desc->width * desc->height;
            HYI_TRY(hyi_reject(scene, hyi_alloc_array(scene->context, &texels, count)));
            memcpy(texels, desc->texels, count * sizeof *texels);
        }
    }
    hyi_free_environment(scene);
    scene->environment_texels = texels;
    scene->environment_width = texels ? desc->width : 0;
    scene->environment_height = texels ? desc->height : 0;
    scene->environment_rotation = desc ? desc->rotation : 0.0f;
    bool white = texels && hyi_all_zero(desc->color, 3);
    for (int i = 0; i < 3; i++) scene->environment_color[i] = !desc ? 0.0f : white ? 1.0f : desc->color[i];
    scene->environment_set = desc && !hyi_all_zero(scene->environment_color, 3);
    scene->dirty |= HYI_DIRTY_ENVIRONMENT;
    return HYDRA_OK;
}

/* ---- all emitters of a scene, gathered by commit */

HYI_FN const hyk_material *hyi_triangle_material(const hydra_scene *scene, const hyi_mesh_slot *mesh, uint32_t override_slot, uint32_t triangle) {
    uint32_t slot = override_slot != HYK_NONE ? override_slot : mesh->triangle_materials ? mesh->triangle_materials[triangle] : mesh->material;
    return &scene->view_materials[slot];
}

/* Mean radiance of an emitting material; black: it emits nothing. */
HYI_FN hyk_vec3 hyi_mean_emission(const hydra_scene *scene, const hyk_material *material) {
    if (!(material->flags & HYK_MATERIAL_EMITS)) return hyk_zero3();
    if (material->emission_texture == HYK_NONE) return material->emission;
    const float *mean = scene->textures[material->emission_texture].mean;
    return hyk_mul(material->emission, hyi_vec3(mean));
}

HYI_FN bool hyi_triangle_emits(const hydra_scene *scene, const hyi_mesh_slot *mesh, uint32_t override_slot, uint32_t triangle) {
    return !hyk_is_black(hyi_mean_emission(scene, hyi_triangle_material(scene, mesh, override_slot, triangle)));
}

/* Number of emitting triangles, and for a mesh of which only some emit, the place of each among them. */
HYI_FN hydra_result hyi_number_emitters(hydra_scene *scene, hyi_mesh_slot *mesh) {
    hyi_free_array(scene->context, &mesh->light_slots, mesh->triangle_count);
    mesh->emitter_count = 0;
    if (!mesh->triangle_materials) {
        if (hyi_triangle_emits(scene, mesh, HYK_NONE, 0)) mesh->emitter_count = mesh->triangle_count;
        return HYDRA_OK;
    }
    for (uint32_t i = 0; i < mesh->triangle_count; i++) mesh->emitter_count += hyi_triangle_emits(scene, mesh, HYK_NONE, i) ? 1u : 0u;
    if (mesh->emitter_count == 0 || mesh->emitter_count == mesh->triangle_count) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(scene->context, &mesh->light_slots, mesh->triangle_count));
    uint32_t next = 0;
    for (uint32_t i = 0; i < mesh->triangle_count; i++) mesh->light_slots[i] = hyi_triangle_emits(scene, mesh, HYK_NONE, i) ? next++ : HYK_NONE;
    return HYDRA_OK;
}

HYI_FN hyk_vec3 hyi_placed_vertex(const hyk_instance *placed, const hyi_mesh_slot *mesh, uint32_t vertex) {
    const float *p = mesh->positions + (size_t)3 * vertex;
    double x = (double)p[0], y = (double)p[1], z = (double)p[2];
    const hyk_vec3 rows[3] = { placed->row0, placed->row1, placed->row2 };
    const float moves[3] = { placed->t0, placed->t1, placed->t2 };
    float world[3];
    for (int r = 0; r < 3; r++) world[r] = (float)((double)rows[r].x * x + (double)rows[r].y * y + (double)rows[r].z * z + (double)moves[r]);
    return hyi_vec3(world);
}

HYI_FN hyk_light hyi_triangle_light(const hydra_scene *scene, uint32_t instance, const hyi_mesh_slot *mesh, uint32_t triangle) {
    const hyk_instance *placed = &scene->placed[instance];
    const hyk_material *material = hyi_triangle_material(scene, mesh, placed->material, triangle);
    const uint32_t *corner = mesh->indices + (size_t)3 * triangle;
    hyk_light light;
    memset(&light, 0, sizeof light);
    light.kind = HYK_LIGHT_TRIANGLE;
    light.position = hyi_placed_vertex(placed, mesh, corner[0]);
    light.axis_u = hyk_sub(hyi_placed_vertex(placed, mesh, corner[1]), light.position);
    light.axis_v = hyk_sub(hyi_placed_vertex(placed, mesh, corner[2]), light.position);
    float lu = hyk_length(light.axis_u), lv = hyk_length(light.axis_v);
    hyk_vec3 across = hyk_cross(hyk_normalize(light.axis_u), hyk_normalize(light.axis_v));
    light.area = 0.5f * lu * lv * hyk_length(across);
    light.normal = hyk_normalize(across);
    if (placed->flags & HYK_INSTANCE_MIRRORED) light.normal = hyk_neg(light.normal);
    light.radiance = hyi_mean_emission(scene, material);
    if (material->flags & HYK_MATERIAL_EMITS_BOTH_SIDES) light.flags |= HYK_LIGHT_BOTH_SIDES;
    if (material->emission_texture != HYK_NONE || hyk_material_has_alpha(*material)) light.flags |= HYK_LIGHT_TEXTURED;
    light.instance = instance;
    light.primitive = triangle;
    return light;
}

HYI_FN size_t hyi_placed_emitters(const hydra_scene *scene, uint32_t instance) {
    const hyk_instance *placed = &scene->placed[instance];
    const hyi_mesh_slot *mesh = &scene->meshes[placed->mesh];
    if (placed->material == HYK_NONE) return mesh->emitter_count;
    /* an override gives every triangle one material, so all or none emit and slots are not looked at */
    return hyi_triangle_emits(scene, mesh, placed->material, 0) ? mesh->triangle_count : 0;
}

HYI_FN bool hyi_is_lit(const hyi_light_slot *slot, bool sun) {
    return slot->alive && (slot->record.kind == HYK_LIGHT_SUN) == sun && !hyk_is_black(slot->record.radiance);
}

HYI_FN void hyi_gather_slots(hydra_scene *scene, bool suns, size_t *at) {
    for (size_t i = 0; i < scene->light_count; i++) {
        if (!hyi_is_lit(&scene->lights[i], suns)) continue;
        scene->light_ids[*at] = (uint32_t)i + 1;
        scene->all_lights[(*at)++] = scene->lights[i].record;
    }
}

HYI_FN void hyi_gather_triangles(hydra_scene *scene, size_t *at) {
    for (size_t i = 0; i < scene->placed_count; i++) {
        hyk_instance *placed = &scene->placed[i];
        const hyi_mesh_slot *mesh = &scene->meshes[placed->mesh];
        placed->first_light = hyi_placed_emitters(scene, (uint32_t)i) ? (uint32_t)*at : HYK_NONE;
        if (placed->first_light == HYK_NONE) continue;
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            if (!hyi_triangle_emits(scene, mesh, placed->material, t)) continue;
            scene->light_ids[*at] = 0;
            scene->all_lights[(*at)++] = hyi_triangle_light(scene, (uint32_t)i, mesh, t);
        }
    }
}

HYI_FN bool hyi_is_shape(const hyk_light *light) { return light->kind <= HYK_LIGHT_SPHERE; }

HYI_FN hyi_box hyi_shape_box(const hyk_light *light) {
    hyk_vec3 extent;
    if (light->kind == HYK_LIGHT_RECT) extent = hyk_add(hyk_abs3(light->axis_u), hyk_abs3(light->axis_v));
    else extent = hyk_splat(light->radius);
    const float center[3] = { light->position.x, light->position.y, light->position.z }, half[3] = { extent.x, extent.y, extent.z };
    hyi_box box;
    for (int i = 0; i < 3; i++) {
        float slack = 4.0f * FLT_EPSILON * (fabsf(center[i]) + half[i]);
        box.lower[i] = fmaxf(center[i] - half[i] - slack, -FLT_MAX);
        box.upper[i] = fminf(center[i] + half[i] + slack, FLT_MAX);
    }
    return box;
}

HYI_FN hydra_result hyi_build_shapes(hydra_scene *scene) {
    uint32_t count = 0;
    for (size_t i = 0; i < scene->view.constants.finite_lights; i++) count += hyi_is_shape(&scene->all_lights[i]) ? 1u : 0u;
    if (!count) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(scene->context, &scene->shape_lights, count));
    scene->shape_count = count;
    hyi_box *boxes;
    HYI_TRY(hyi_alloc_array(scene->context, &boxes, count));
    uint32_t at = 0;
    for (size_t i = 0; i < scene->view.constants.finite_lights; i++) {
        if (!hyi_is_shape(&scene->all_lights[i])) continue;
        boxes[at] = hyi_shape_box(&scene->all_lights[i]);
        scene->shape_lights[at++] = (uint32_t)i;
    }
    hydra_result result = hyi_bvh_build_boxes(scene->context, boxes, count, &scene->shapes);
    hyi_free_array(scene->context, &boxes, count);
    return result;
}

HYI_FN hydra_result hyi_commit_lights(hydra_scene *scene) {
    hyi_free_lights(scene);
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (scene->meshes[i].alive) HYI_TRY(hyi_number_emitters(scene, &scene->meshes[i]));
    size_t finite = 0, suns = 0;
    for (size_t i = 0; i < scene->light_count; i++) {
        finite += hyi_is_lit(&scene->lights[i], false) ? 1u : 0u;
        suns += hyi_is_lit(&scene->lights[i], true) ? 1u : 0u;
    }
    for (size_t i = 0; i < scene->placed_count; i++) finite += hyi_placed_emitters(scene, (uint32_t)i);
    if (finite + suns > 0x7fffffffu) return hyi_fail(scene->context, HYDRA_ERROR_COUNT, "%zu emitters", finite + suns);
    HYI_TRY(hyi_alloc_array(scene->context, &scene->all_lights, finite + suns));
    if (hyi_alloc_array(scene->context, &scene->light_ids, finite + suns) != HYDRA_OK) {
        hyi_free_array(scene->context, &scene->all_lights, finite + suns);
        return HYDRA_ERROR_OUT_OF_MEMORY;
    }
    scene->all_light_count = finite + suns;
    scene->view.constants.finite_lights = (uint32_t)finite;
    scene->view.constants.suns = (uint32_t)suns;
    size_t at = 0;
    hyi_gather_slots(scene, false, &at);
    hyi_gather_triangles(scene, &at);
    hyi_gather_slots(scene, true, &at);
    if (finite) HYI_TRY(hyi_light_tree_build(scene->context, scene->all_lights, (uint32_t)finite, &scene->light_nodes, &scene->light_node_count));
    return hyi_build_shapes(scene);
}

#endif /* HYI_LIGHTS_H */

/* >>scene-commit: from what the caller gave to what rays and kernels read, renewing only what changed */
#ifndef HYI_COMMIT_H
#define HYI_COMMIT_H

/* ---- materials and textures */

HYI_FN hydra_result hyi_commit_materials(hydra_scene *scene) {
    hydra_context *context = scene->context;
    hyi_free_tables(scene);
    size_t count = scene->material_count + 1;
    HYI_TRY(hyi_alloc_array(context, &scene->view_materials, count));
    scene->view_material_count = count;
    scene->view_materials[0] = hyi_default_material();
    for (size_t i = 1; i < count; i++) scene->view_materials[i] = scene->materials[i - 1];
    HYI_TRY(hyi_alloc_array(context, &scene->view_textures, scene->texture_count));
    void *pointers;
    hydra_result result = hyi_alloc_elements(context, &pointers, scene->texture_count, sizeof *scene->view_texels);
    if (result != HYDRA_OK) {
        hyi_free_array(context, &scene->view_textures, scene->texture_count);
        return result;
    }
    scene->view_texels = (const uint32_t **)pointers;
    scene->view_texture_count = scene->texture_count;
    for (size_t i = 0; i < scene->texture_count; i++) {
        scene->view_textures[i] = scene->textures[i].record;
        scene->view_texels[i] = scene->textures[i].texels;
    }
    return hyi_energy_tables_build(context, scene->view_materials, (uint32_t)count, &scene->energy_tables, &scene->energy_table_count);
}

/* ---- placement */

HYI_FN hyk_instance hyi_placed_record(const float m[12], const float inverse[12], uint32_t mesh, uint32_t material, uint32_t flags) {
    hyk_instance p;
    p.row0 = hyk_make3(m[0], m[1], m[2]);
    p.t0 = m[3];
    p.row1 = hyk_make3(m[4], m[5], m[6]);
    p.t1 = m[7];
    p.row2 = hyk_make3(m[8], m[9], m[10]);
    p.t2 = m[11];
    p.inverse0 = hyk_make3(inverse[0], inverse[1], inverse[2]);
    p.s0 = inverse[3];
    p.inverse1 = hyk_make3(inverse[4], inverse[5], inverse[6]);
    p.s1 = inverse[7];
    p.inverse2 = hyk_make3(inverse[8], inverse[9], inverse[10]);
    p.s2 = inverse[11];
    p.mesh = mesh;
    p.material = material;
    p.first_light = HYK_NONE;
    p.flags = flags;
    return p;
}

/* Standing by itself, either in the world or with a tree of its own. */
HYI_FN bool hyi_stands_alone(const hyi_mesh_slot *mesh) { return mesh->alive && !mesh->instanced_only; }

HYI_FN void hyi_place_meshes(hydra_scene *scene, bool dynamic, size_t *at) {
    static const float identity[12] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 };
    for (size_t i = 0; i < scene->mesh_count; i++) {
        if (!hyi_stands_alone(&scene->meshes[i]) || scene->meshes[i].dynamic != dynamic) continue;
        scene->placed_ids[*at] = 0;
        scene->placed[(*at)++] = hyi_placed_record(identity, identity, (uint32_t)i, HYK_NONE, HYK_INSTANCE_IDENTITY);
    }
}

/* The world's meshes first, in the order of world_first. */
HYI_FN hydra_result hyi_place(hydra_scene *scene) {
    size_t count = 0, at = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) count += hyi_stands_alone(&scene->meshes[i]) ? 1u : 0u;
    for (size_t i = 0; i < scene->instance_count; i++) count += scene->instances[i].alive ? 1u : 0u;
    HYI_TRY(hyi_alloc_array(scene->context, &scene->placed, count));
    hydra_result result = hyi_alloc_array(scene->context, &scene->placed_ids, count);
    if (result != HYDRA_OK) {
        hyi_free_array(scene->context, &scene->placed, count);
        return result;
    }
    scene->placed_count = count;
    hyi_place_meshes(scene, false, &at);
    hyi_place_meshes(scene, true, &at);
    for (size_t i = 0; i < scene->instance_count; i++) {
        const hyi_instance_slot *slot = &scene->instances[i];
        if (!slot->alive) continue;
        uint32_t flags = (slot->identity ? HYK_INSTANCE_IDENTITY : 0u) | (slot->mirrored ? HYK_INSTANCE_MIRRORED : 0u);
        scene->placed_ids[at] = (uint32_t)i + 1;
        scene->placed[at++] = hyi_placed_record(slot->transform, slot->inverse, slot->mesh, slot->material, flags);
    }
    return HYDRA_OK;
}

/* World box of a placed mesh, widened by what the ray's way into object space and back may round. */
HYI_FN bool hyi_placed_box(const hyk_instance *placed, const hyi_box *local, hyi_box *world) {
    const hyk_vec3 rows[3] = { placed->row0, placed->row1, placed->row2 };
    const float moves[3] = { placed->t0, placed->t1, placed->t2 };
    for (int r = 0; r < 3; r++) {
        const float row[3] = { rows[r].x, rows[r].y, rows[r].z };
        double lower = (double)moves[r], upper = lower, size = fabs(lower);
        for (int c = 0; c < 3; c++) {
            double a = (double)row[c] * (double)local->lower[c], b = (double)row[c] * (double)local->upper[c];
            lower += fmin(a, b);
            upper += fmax(a, b);
            size += fmax(fabs(a), fabs(b));
        }
        double slack = (placed->flags & HYK_INSTANCE_IDENTITY) ? 0.0 : 16.0 * (double)FLT_EPSILON * size;
        world->lower[r] = nextafterf((float)(lower - slack), -FLT_MAX);
        world->upper[r] = nextafterf((float)(upper + slack), FLT_MAX);
        if (placed->flags & HYK_INSTANCE_IDENTITY) world->lower[r] = local->lower[r], world->upper[r] = local->upper[r];
        if (!hyi_is_finite(world->lower[r]) || !hyi_is_finite(world->upper[r])) return false;
    }
    return true;
}

/* Over the world, if there is one, and every other placed mesh. */
HYI_FN hydra_result hyi_build_top(hydra_scene *scene) {
    hyi_box *boxes;
    size_t first = scene->world_count, lead = first ? 1 : 0, count = scene->placed_count - first + lead;
    HYI_TRY(hyi_alloc_array(scene->context, &boxes, count));
    hydra_result result = HYDRA_OK;
    if (lead) boxes[0] = scene->world.bounds;
    for (size_t i = first; i < scene->placed_count && result == HYDRA_OK; i++)
        if (!hyi_placed_box(&scene->placed[i], &scene->meshes[scene->placed[i].mesh].bvh.bounds, &boxes[i - first + lead]))
            result = hyi_fail(scene->context, HYDRA_ERROR_TRANSFORM, "instance %u reaches beyond the range of float", scene->placed_ids[i]);
    if (result == HYDRA_OK) result = hyi_bvh_build_boxes(scene->context, boxes, (uint32_t)count, &scene->top);
    hyi_free_array(scene->context, &boxes, count);
    return result;
}

/* Whether rays need no level above: the world alone, or one unmoved mesh. */
HYI_FN bool hyi_is_single(const hydra_scene *scene) {
    if (scene->placed_count == scene->world_count) return true;
    return scene->placed_count == 1 && (scene->placed[0].flags & HYK_INSTANCE_IDENTITY);
}

HYI_FN hyk_mesh hyi_mesh_record(const hyi_mesh_slot *mesh) {
    hyk_mesh record;
    memset(&record, 0, sizeof record);
    record.material = mesh->material;
    record.triangle_count = mesh->triangle_count;
    record.vertex_count = mesh->vertex_count;
    if (mesh->normals) record.flags |= HYK_MESH_HAS_NORMALS;
    if (mesh->uvs) record.flags |= HYK_MESH_HAS_UVS;
    if (mesh->triangle_materials) record.flags |= HYK_MESH_TRIANGLE_MATERIALS;
    if (mesh->light_slots) record.flags |= HYK_MESH_LIGHT_SLOTS;
    return record;
}

HYI_FN hydra_result hyi_alloc_mesh_views(hydra_scene *scene) {
    hydra_context *context = scene->context;
    size_t count = scene->view_mesh_count = scene->mesh_count;
    HYI_TRY(hyi_alloc_array(context, &scene->view_meshes, count));
    HYI_TRY(hyi_alloc_array(context, &scene->view_arrays, count));
    HYI_TRY(hyi_alloc_array(context, &scene->view_bvhs, count));
    return hyi_alloc_array(context, &scene->view_alpha, count);
}

HYI_FN hydra_result hyi_commit_placement(hydra_scene *scene) {
    double start = hyi_seconds();
    hyi_free_placement(scene);
    HYI_TRY(hyi_alloc_mesh_views(scene));
    HYI_TRY(hyi_place(scene));
    if (!hyi_is_single(scene)) HYI_TRY(hyi_build_top(scene));
    scene->info.build_seconds += hyi_seconds() - start;
    return HYDRA_OK;
}

/* Slots and materials into the records by mesh; after lights, which number the emitting triangles. */
HYI_FN void hyi_refresh_mesh_views(hydra_scene *scene) {
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        hyk_mesh_arrays *arrays = &scene->view_arrays[i];
        scene->view_meshes[i] = hyi_mesh_record(mesh);
        scene->view_bvhs[i] = mesh->bvh;
        arrays->positions = mesh->positions;
        arrays->normals = mesh->normals;
        arrays->uvs = mesh->uvs;
        arrays->indices = mesh->indices;
        arrays->triangle_materials = mesh->triangle_materials;
        arrays->light_slots = mesh->light_slots;
    }
}

/* ---- what the scene requires */

/* Features of one placed mesh, over the materials that its triangles really have. */
HYI_FN uint32_t hyi_placed_needs(hydra_scene *scene, const hyk_instance *placed) {
    const hyi_mesh_slot *mesh = &scene->meshes[placed->mesh];
    uint32_t needs = 0;
    uint32_t triangles = mesh->triangle_materials && placed->material == HYK_NONE ? mesh->triangle_count : 1;
    for (uint32_t t = 0; t < triangles; t++) needs |= hyi_material_needs(hyi_triangle_material(scene, mesh, placed->material, t));
    if (!mesh->uvs) needs &= ~HYK_NEEDS_NORMAL_MAPS;
    if (mesh->normals) needs |= HYK_NEEDS_SMOOTH_NORMALS;
    if (!(placed->flags & HYK_INSTANCE_IDENTITY)) needs |= HYK_NEEDS_INSTANCES;
    if (needs & HYK_NEEDS_ALPHA) scene->view_alpha[placed->mesh] = 1;
    return needs;
}

HYI_FN uint32_t hyi_scene_needs(hydra_scene *scene) {
    uint32_t needs = hyi_is_single(scene) ? 0u : HYK_NEEDS_INSTANCES;
    for (size_t i = 0; i < scene->mesh_count; i++) scene->view_alpha[i] = 0;
    for (size_t i = 0; i < scene->placed_count; i++) needs |= hyi_placed_needs(scene, &scene->placed[i]);
    if (scene->view.constants.finite_lights) needs |= HYK_NEEDS_EMITTERS;
    if (scene->view.constants.suns) needs |= HYK_NEEDS_SUNS;
    if (scene->shape_count) needs |= HYK_NEEDS_SHAPES;
    if (scene->environment_set) needs |= HYK_NEEDS_ENVIRONMENT;
    if (scene->environment_set && scene->environment_texels) needs |= HYK_NEEDS_ENVIRONMENT_MAP;
    return needs;
}

HYI_FN hydra_result hyi_commit_environment(hydra_scene *scene) {
    hyi_free_array(scene->context, &scene->environment_cdf, scene->environment_cdf_count);
    scene->environment_cdf_count = 0;
    scene->view.constants.environment_integral = 0.0f;
    if (!scene->environment_set || !scene->environment_texels) return HYDRA_OK;
    return hyi_environment_build(scene->context, scene->environment_texels, scene->environment_width, scene->environment_height,
                                 &scene->environment_cdf, &scene->environment_cdf_count, &scene->view.constants.environment_integral);
}

HYI_FN void hyi_grow_bounds(hyi_box *bounds, const hyi_box *box) {
    for (int i = 0; i < 3; i++) {
        bounds->lower[i] = fminf(bounds->lower[i], box->lower[i]);
        bounds->upper[i] = fmaxf(bounds->upper[i], box->upper[i]);
    }
}

HYI_FN void hyi_commit_bounds(hydra_scene *scene) {
    hyi_box bounds = { { FLT_MAX, FLT_MAX, FLT_MAX }, { -FLT_MAX, -FLT_MAX, -FLT_MAX } };
    if (scene->world.primitive_count) hyi_grow_bounds(&bounds, &scene->world.bounds);
    for (size_t i = scene->world_count; i < scene->placed_count; i++) {
        hyi_box box;
        const hyi_bvh *bvh = &scene->meshes[scene->placed[i].mesh].bvh;
        if (bvh->primitive_count && hyi_placed_box(&scene->placed[i], &bvh->bounds, &box)) hyi_grow_bounds(&bounds, &box);
    }
    if (scene->shape_count) hyi_grow_bounds(&bounds, &scene->shapes.bounds);
    hyk_scene_constants *constants = &scene->view.constants;
    memset(scene->info.bounds_min, 0, sizeof bounds.lower);
    memset(scene->info.bounds_max, 0, sizeof bounds.upper);
    constants->center = hyk_zero3();
    constants->radius = 0.0f;
    if (bounds.lower[0] > bounds.upper[0]) return;
    memcpy(scene->info.bounds_min, bounds.lower, sizeof bounds.lower);
    memcpy(scene->info.bounds_max, bounds.upper, sizeof bounds.upper);
    double half[3];
    for (int i = 0; i < 3; i++) half[i] = 0.5 * ((double)bounds.upper[i] - (double)bounds.lower[i]);
    constants->center = hyk_make3((float)((double)bounds.lower[0] + half[0]), (float)((double)bounds.lower[1] + half[1]), (float)((double)bounds.lower[2] + half[2]));
    constants->radius = (float)sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
}

HYI_FN void hyi_commit_view(hydra_scene *scene) {
    hyk_scene_view *view = &scene->view;
    view->materials = scene->view_materials;
    view->textures = scene->view_textures;
    view->texels = scene->view_texels;
    view->meshes = scene->view_meshes;
    view->mesh_arrays = scene->view_arrays;
    view->instances = scene->placed;
    view->lights = scene->all_lights;
    view->light_nodes = scene->light_nodes;
    view->environment = scene->environment_texels;
    view->environment_cdf = scene->environment_cdf;
    view->energy_tables = scene->energy_tables;
    view->constants.environment = scene->environment_set ? hyi_vec3(scene->environment_color) : hyk_zero3();
    view->constants.environment_rotation = scene->environment_rotation;
    view->constants.environment_width = scene->environment_set ? scene->environment_width : 0;
    view->constants.environment_height = scene->environment_set ? scene->environment_height : 0;
    view->constants.light_nodes = scene->light_node_count;
    view->constants.shapes = scene->shape_count;
    view->constants.features = hyi_scene_needs(scene);
    hyi_accel *accel = &scene->accel;
    memset(accel, 0, sizeof *accel);
    accel->view = view;
    accel->meshes = scene->view_bvhs;
    accel->mesh_has_alpha = (view->constants.features & HYK_NEEDS_ALPHA) ? scene->view_alpha : NULL;
    accel->world = scene->world_count ? &scene->world : NULL;
    accel->world_first = scene->world_first;
    accel->world_count = (uint32_t)scene->world_count;
    for (size_t i = 0; accel->mesh_has_alpha && i < scene->world_count; i++) accel->world_has_alpha |= accel->mesh_has_alpha[scene->placed[i].mesh] != 0;
    accel->instances = &scene->top;
    accel->single = hyi_is_single(scene);
    accel->empty = scene->placed_count == 0;
    accel->shapes = scene->shape_count ? &scene->shapes : NULL;
    accel->shape_lights = scene->shape_lights;
    accel->isa = scene->context->isa;
}

HYI_FN void hyi_commit_info(hydra_scene *scene) {
    hydra_scene_info *info = &scene->info;
    info->triangles = info->placed_triangles = 0;
    info->degenerate = scene->world.degenerate;
    info->bytes_bvh = scene->top.bytes + scene->shapes.bytes + scene->world.bytes + scene->world_count * sizeof *scene->world_first;
    info->bytes_geometry = scene->placed_count * (sizeof *scene->placed + sizeof *scene->placed_ids);
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        info->triangles += mesh->triangle_count;
        if (mesh->built && !mesh->in_world) info->degenerate += mesh->bvh.degenerate;
        info->bytes_bvh += mesh->bvh.bytes;
        size_t floats = 3u + (mesh->normals ? 3u : 0u) + (mesh->uvs ? 2u : 0u);
        size_t words = 3u + (mesh->triangle_materials ? 1u : 0u) + (mesh->light_slots ? 1u : 0u);
        info->bytes_geometry += 4 * (floats * mesh->vertex_count + words * mesh->triangle_count);
    }
    for (size_t i = 0; i < scene->placed_count; i++) info->placed_triangles += scene->meshes[scene->placed[i].mesh].triangle_count;
    info->emitters = scene->all_light_count;
    info->bytes_textures = 0;
    for (size_t i = 0; i < scene->texture_count; i++) info->bytes_textures += 4 * scene->textures[i].words;
    info->bytes_materials = scene->view_material_count * sizeof *scene->view_materials;
    info->bytes_lights = scene->all_light_count * (sizeof *scene->all_lights + sizeof *scene->light_ids) + scene->light_node_count * sizeof *scene->light_nodes;
    info->bytes_environment = 4 * (hyi_environment_texel_count(scene) + scene->environment_cdf_count);
    info->bytes_tables = 4 * scene->energy_table_count;
}

/* ---- the call */

HYI_FN hydra_result hyi_commit_parts(hydra_scene *scene) {
    scene->info.meshes_built = scene->info.meshes_refitted = scene->info.trees_loaded = 0;
    scene->info.build_seconds = 0.0;
    if (scene->dirty & (HYI_DIRTY_PLACEMENT | HYI_DIRTY_MESHES)) HYI_TRY(hyi_commit_trees(scene)); /* a first instance asks for a tree */
    if (scene->dirty & (HYI_DIRTY_PLACEMENT | HYI_DIRTY_MESHES)) HYI_TRY(hyi_commit_placement(scene));
    if (scene->dirty & HYI_DIRTY_MATERIALS) HYI_TRY(hyi_commit_materials(scene));
    if (scene->dirty & ~HYI_DIRTY_ENVIRONMENT) {
        HYI_TRY(hyi_commit_lights(scene));
        hyi_refresh_mesh_views(scene);
    }
    if (scene->dirty & HYI_DIRTY_ENVIRONMENT) HYI_TRY(hyi_commit_environment(scene));
    hyi_commit_bounds(scene);
    hyi_commit_view(scene);
    hyi_commit_info(scene);
    return HYDRA_OK;
}

/* The first add that failed since the last commit is reported once. */
HYI_FN hydra_result hyi_report_pending(hydra_scene *scene) {
    hydra_result pending = scene->pending;
    scene->pending = HYDRA_OK;
    if (pending != HYDRA_OK) memcpy(scene->context->error, scene->pending_text, sizeof scene->pending_text);
    return pending;
}

HYDRA_API hydra_result hydra_scene_commit(hydra_scene *scene) {
    if (!scene) return HYDRA_ERROR_NULL;
    if (scene->renders_living) return hyi_fail(scene->context, HYDRA_ERROR_BUSY, "hydra_scene_commit: %u renders of the scene are alive", scene->renders_living);
    HYI_TRY(hyi_report_pending(scene));
    HYI_TRY(hyi_commit_parts(scene));
    if (scene->context->backend) HYI_TRY(scene->context->backend->commit(scene, scene->dirty));
    scene->dirty = 0;
    hyi_free_loaded(scene);
    return HYDRA_OK;
}

HYDRA_API uint32_t hydra_scene_requirements(const hydra_scene *scene) { return scene && !scene->dirty ? scene->view.constants.features : 0; }

HYDRA_API hydra_result hydra_scene_get_info(const hydra_scene *scene, hydra_scene_info *info) {
    HYI_TRY(hyi_check_committed(scene));
    if (!info) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "info");
    *info = scene->info;
    return HYDRA_OK;
}

#endif /* HYI_COMMIT_H */

/* >>scene-queries: the caller's own rays */
#ifndef HYI_QUERIES_H
#define HYI_QUERIES_H

#define HYI_QUERY_BATCH 256u /* rays a time without memory of the context's */

HYI_STATIC_ASSERT(sizeof(hydra_ray) == sizeof(hyk_ray) && offsetof(hydra_ray, t_max) == offsetof(hyk_ray, t_max));

/* ---- answers */

HYI_FN void hyi_shape_hit(const hydra_scene *scene, const hyk_hit *hit, const hydra_ray *at, hydra_hit *out) {
    hyk_vec3 origin = hyk_make3(at->origin[0], at->origin[1], at->origin[2]), direction = hyk_make3(at->direction[0], at->direction[1], at->direction[2]);
    hyk_vec3 n = hyk_shape_normal(scene->view.lights[hit->primitive], hyk_add_scaled(origin, direction, hit->t));
    out->primitive = HYDRA_NONE;
    out->mesh = out->instance = 0;
    out->light = scene->light_ids[hit->primitive];
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

/* Squares of products of floats stay in double's range, so nothing has to be scaled. */
HYI_INLINE void hyi_unit_normal(const float *a, const float *b, const float *c, float normal[3]) {
    double e[3], f[3];
    for (int i = 0; i < 3; i++) {
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
    }
    double x = e[1] * f[2] - e[2] * f[1], y = e[2] * f[0] - e[0] * f[2], z = e[0] * f[1] - e[1] * f[0];
    double inverse = 1.0 / sqrt(x * x + y * y + z * z);
    normal[0] = (float)(x * inverse);
    normal[1] = (float)(y * inverse);
    normal[2] = (float)(z * inverse);
}

HYI_INLINE void hyi_surface_hit(const hydra_scene *scene, const hyk_hit *hit, hydra_hit *out) {
    const hyk_instance *placed = &scene->placed[hit->instance];
    const hyk_mesh_arrays *arrays = &scene->view_arrays[placed->mesh];
    const uint32_t *index = arrays->indices + 3u * (size_t)hit->primitive;
    hyi_unit_normal(arrays->positions + 3u * (size_t)index[0], arrays->positions + 3u * (size_t)index[1], arrays->positions + 3u * (size_t)index[2], out->normal);
    out->primitive = hit->primitive;
    out->mesh = placed->mesh + 1;
    out->instance = scene->placed_ids[hit->instance];
    out->light = 0;
    if (placed->flags & HYK_INSTANCE_IDENTITY) return;
    hyk_vec3 n = hyk_normalize(hyk_transform_normal(*placed, hyk_make3(out->normal[0], out->normal[1], out->normal[2])));
    out->normal[0] = n.x;
    out->normal[1] = n.y;
    out->normal[2] = n.z;
}

HYI_INLINE void hyi_public_hit(const hydra_scene *scene, const hyk_hit *hit, const hydra_ray *ray, hydra_hit *out) {
    out->t = hit->t;
    out->u = hit->u;
    out->v = hit->v;
    if (hit->instance == HYK_HIT_SHAPE) {
        hyi_shape_hit(scene, hit, ray, out);
    } else if (hit->instance != HYK_NONE) {
        hyi_surface_hit(scene, hit, out);
    } else {
        out->primitive = HYDRA_NONE;
        out->mesh = out->instance = out->light = 0;
        out->normal[0] = out->normal[1] = out->normal[2] = 0.0f;
    }
}

/* Asks for the corners of a hit triangle, or first for the numbers of its corners. */
HYI_INLINE void hyi_prefetch_hit(const hydra_scene *scene, const hyk_hit *hit, bool corners) {
    if (hit->instance == HYK_NONE || hit->instance == HYK_HIT_SHAPE) return;
    const hyk_mesh_arrays *arrays = &scene->view_arrays[scene->placed[hit->instance].mesh];
    const uint32_t *index = arrays->indices + 3u * (size_t)hit->primitive;
    if (!corners) hyi_prefetch(index);
    for (int i = 0; corners && i < 3; i++) hyi_prefetch(arrays->positions + 3u * (size_t)index[i]);
}

HYI_FN void hyi_tell_hits(const hydra_scene *scene, const hyk_hit *found, const hydra_ray *rays, hydra_hit *hits, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (i + 16u < count) hyi_prefetch_hit(scene, &found[i + 16u], false);
        if (i + 8u < count) hyi_prefetch_hit(scene, &found[i + 8u], true);
        hyi_public_hit(scene, &found[i], &rays[i], &hits[i]);
    }
}

/* ---- the calls */

/* These do not write the context's error text, since many threads may call them. */
HYI_FN hydra_result hyi_check_query(const hydra_scene *scene, const void *rays, const void *answers, size_t count) {
    if (!scene || (count && (!rays || !answers))) return HYDRA_ERROR_NULL;
    return scene->dirty ? HYDRA_ERROR_NOT_COMMITTED : HYDRA_OK;
}

/* One query: its memory, and how many rays it goes through at a time. */
typedef struct hyi_query {
    const hydra_scene *scene;
    hyi_ray_stream stream;
    hyk_hit *found;
    size_t batch, found_count;
} hyi_query;

HYI_FN void hyi_query_end(hyi_query *query) {
    hyi_ray_stream_free(query->scene->context, &query->stream);
    hyi_free_array(query->scene->context, &query->found, query->found_count);
}

/* Without the memory for it, rays go one by one. Quiet on failure: the error text is not a query's to write. */
HYI_FN hyi_query hyi_query_begin(const hydra_scene *scene, size_t count, bool any) {
    hyi_query query;
    memset(&query, 0, sizeof query);
    query.scene = scene;
    query.batch = HYI_QUERY_BATCH;
    if (count < HYI_STREAM_LEAST || hyi_ray_stream_alloc(scene->context, &scene->accel, count, &query.stream) != HYDRA_OK) return query;
    size_t batch = count < HYI_STREAM_SORTED ? count : HYI_STREAM_SORTED;
    bool whole = any || (query.stream.capacity > 0 && hyi_try_alloc(scene->context, batch * sizeof *query.found, (void **)&query.found) == HYDRA_OK);
    if (whole) query.batch = batch;
    if (query.found) query.found_count = batch;
    return query;
}

HYI_FN bool hyi_query_closest(hyi_query *query, const hydra_ray *rays, hydra_hit *hits, uint32_t count) {
    const hydra_scene *scene = query->scene;
    const hyk_ray *at = (const hyk_ray *)(const void *)rays;
    hyk_hit here[HYI_QUERY_BATCH], *found = query->found ? query->found : here;
    bool sound = hyi_trace_closest(&scene->accel, &query->stream, at, found, count);
    if (scene->accel.shapes) hyi_trace_shapes_closest(&scene->accel, at, found, count, false);
    hyi_tell_hits(scene, found, rays, hits, count);
    return sound;
}

HYI_FN bool hyi_query_any(hyi_query *query, const hydra_ray *rays, uint8_t *occluded, uint32_t count) {
    const hyk_ray *at = (const hyk_ray *)(const void *)rays;
    bool sound = hyi_trace_any(&query->scene->accel, &query->stream, at, occluded, count);
    if (query->scene->accel.shapes) hyi_trace_shapes_any(&query->scene->accel, at, occluded, count);
    return sound;
}

/* The same on a backend, whose hits wait in memory until they are told. */
HYI_FN hydra_result hyi_query_device(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    size_t batch = count < HYI_STREAM_SORTED ? count : HYI_STREAM_SORTED;
    hydra_result result = HYDRA_OK;
    hyk_hit *found = NULL;
    if (hits) HYI_TRY(hyi_try_alloc(scene->context, batch * sizeof *found, (void **)&found));
    for (size_t first = 0; first < count && (result == HYDRA_OK || result == HYDRA_ERROR_RAY); first += batch) {
        uint32_t n = count - first < batch ? (uint32_t)(count - first) : (uint32_t)batch;
        hydra_result part = scene->context->backend->trace(scene, rays + first, found, hits ? NULL : occluded + first, n);
        if (part != HYDRA_OK) result = part;
        if (hits && (part == HYDRA_OK || part == HYDRA_ERROR_RAY)) hyi_tell_hits(scene, found, rays + first, hits + first, n);
    }
    hyi_free_bytes(scene->context, found, batch * sizeof *found);
    return result;
}

/* hits, or else occluded. */
HYI_FN hydra_result hyi_query_all(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, uint8_t *occluded, size_t count) {
    if (scene->context->backend) return count ? hyi_query_device(scene, rays, hits, occluded, count) : HYDRA_OK;
    hyi_query query = hyi_query_begin(scene, count, hits == NULL);
    bool sound = true;
    for (size_t first = 0; first < count; first += query.batch) {
        uint32_t n = count - first < query.batch ? (uint32_t)(count - first) : (uint32_t)query.batch;
        if (hits) sound = hyi_query_closest(&query, rays + first, hits + first, n) && sound;
        else sound = hyi_query_any(&query, rays + first, occluded + first, n) && sound;
    }
    hyi_query_end(&query);
    return sound ? HYDRA_OK : HYDRA_ERROR_RAY;
}

HYDRA_API hydra_result hydra_scene_closest_hits(const hydra_scene *scene, const hydra_ray *rays, hydra_hit *hits, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, hits, count));
    return hyi_query_all(scene, rays, hits, NULL, count);
}

HYDRA_API hydra_result hydra_scene_any_hits(const hydra_scene *scene, const hydra_ray *rays, uint8_t *occluded, size_t count) {
    HYI_TRY(hyi_check_query(scene, rays, occluded, count));
    return hyi_query_all(scene, rays, NULL, occluded, count);
}

#endif /* HYI_QUERIES_H */

/* >>backend-chunk: what a backend is asked for: the samples of one tile, and what it gives back

   A backend traces the paths of a unit's lanes to their end and leaves a result for each lane. Films, schedules and error
   bars above know nothing of how. */
#ifndef HYI_CHUNK_H
#define HYI_CHUNK_H

/* Everything about a picture that its samples depend on. */
typedef struct hyi_picture {
    const hyk_scene_view *view;
    const hyi_accel *accel;
    hyk_picture kernel;
    const float *point_positions, *point_normals; /* POINTS: 3 floats each; width x height of them */
    const hydra_ray *rays;                        /* RAYS */
    uint32_t features;                            /* of the scene */
} hyi_picture;

/* Parts of a lane's radiance; without HYK_WANTS_COMPONENTS all of it is in the first. */
typedef struct hyi_lane {
    hyk_vec3 part[3];
    hyk_vec3 irradiance;
    hyk_first_surface first;
    uint32_t instance, primitive; /* first hit, as hyk_hit */
    uint32_t flags;               /* HYK_LANE_... */
} hyi_lane;

typedef struct hyi_counters {
    uint64_t rays_camera, rays_bounce, rays_shadow, paths;
    double generate, intersect, shade, shadow;
} hyi_counters;

HYI_FN void hyi_clear_lane(hyi_lane *lane, bool used) {
    memset(lane, 0, sizeof *lane);
    lane->instance = lane->primitive = HYK_NONE;
    lane->first.material = HYK_NONE;
    lane->flags = used ? HYK_LANE_USED : 0u;
}

#endif /* HYI_CHUNK_H */

/* >>backend-cpu: the pass sequence on one worker's batch

   generate -> (intersect -> shapes -> shade -> shadow) until no path is left (Laine, Karras, Aila 2013: small kernels
   connected by buffers). A batch is a few hundred kilobytes, so that it stays in the worker's own cache; paths that end
   are squeezed out by shade as it writes the survivors. */
#ifndef HYI_CPU_H
#define HYI_CPU_H

typedef struct hyi_shadow {
    hyk_vec3 diffuse;
    uint32_t diffuse_component;
    hyk_vec3 specular;
    uint32_t specular_component;
    hyk_vec3 irradiance;
    uint32_t lane;
} hyi_shadow;

typedef struct hyi_batch {
    uint32_t capacity;
    uint32_t paths_alive, shadows_alive;
    hyk_path *paths;
    hyk_ray *rays;
    hyk_hit *hits;
    hyk_ray *shadow_rays;
    hyi_shadow *shadows;
    uint8_t *occluded;
    hyi_lane *lanes;
    hyi_ray_stream stream;
    hyi_counters counters;
} hyi_batch;

#define HYI_LANE_BYTES \
    (sizeof(hyk_path) + 2 * sizeof(hyk_ray) + sizeof(hyk_hit) + sizeof(hyi_shadow) + sizeof(uint8_t) + sizeof(hyi_lane))

HYI_FN void hyi_batch_free(hydra_context *context, hyi_batch *batch) {
    hyi_free_array(context, &batch->paths, batch->capacity);
    hyi_free_array(context, &batch->rays, batch->capacity);
    hyi_free_array(context, &batch->hits, batch->capacity);
    hyi_free_array(context, &batch->shadow_rays, batch->capacity);
    hyi_free_array(context, &batch->shadows, batch->capacity);
    hyi_free_array(context, &batch->occluded, batch->capacity);
    hyi_free_array(context, &batch->lanes, batch->capacity);
    hyi_ray_stream_free(context, &batch->stream);
}

/* Where a backend traces, only lanes are taken: it hands its results over in them. */
HYI_FN hydra_result hyi_batch_alloc(hydra_context *context, const hyi_accel *accel, uint32_t capacity, hyi_batch *batch) {
    memset(batch, 0, sizeof *batch);
    batch->capacity = capacity;
    HYI_TRY(hyi_alloc_array(context, &batch->lanes, capacity));
    if (context->backend) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &batch->paths, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->rays, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->hits, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->shadow_rays, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->shadows, capacity));
    HYI_TRY(hyi_alloc_array(context, &batch->occluded, capacity));
    hydra_result result = hyi_ray_stream_alloc(context, accel, capacity, &batch->stream);
    if (result == HYDRA_OK) return result;
    return hyi_fail(context, result, "ray streams for %u lanes", capacity);
}

/* ---- results */

HYI_INLINE void hyi_lane_add(hyi_lane *lane, uint32_t component, hyk_vec3 radiance) {
    lane->part[component] = hyk_add(lane->part[component], radiance);
}

/* What a vertex gave: light found, a shadow ray to cast, a path to go on with. */
HYI_INLINE void hyi_keep_scatter(hyi_batch *batch, const hyk_scatter *r, uint32_t lane_index, bool split) {
    hyi_lane *lane = &batch->lanes[lane_index];
    hyi_lane_add(lane, split ? r->emitted_component : 0, r->emitted);
    lane->irradiance = hyk_add(lane->irradiance, r->emitted_irradiance);
    if (r->flags & HYK_SCATTER_SURFACE) lane->first = r->first;
    if (r->flags & HYK_SCATTER_INSIDE) lane->flags |= HYK_LANE_INSIDE;
    if (r->flags & HYK_SCATTER_SHADOW) {
        hyi_shadow *shadow = &batch->shadows[batch->shadows_alive];
        shadow->diffuse = r->diffuse;
        shadow->diffuse_component = split ? r->diffuse_component : 0;
        shadow->specular = r->specular;
        shadow->specular_component = split ? r->specular_component : 0;
        shadow->irradiance = r->light_irradiance;
        shadow->lane = lane_index;
        batch->shadow_rays[batch->shadows_alive++] = r->shadow;
    }
    if (r->flags & HYK_SCATTER_CONTINUES) {
        batch->paths[batch->paths_alive] = r->next;
        batch->rays[batch->paths_alive++] = r->next.ray;
    }
}

/* ---- shade: one instantiation for each set of features that scenes commonly have */

HYI_INLINE void hyi_shade_batch(const hyi_picture *picture, hyi_batch *batch, uint32_t features) {
    uint32_t count = batch->paths_alive;
    bool split = (picture->kernel.settings.wants & HYK_WANTS_COMPONENTS) != 0;
    batch->paths_alive = batch->shadows_alive = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t lane = batch->paths[i].lane;
        hyk_scatter r = hyk_shade(picture->view, picture->kernel.settings, batch->paths[i], batch->hits[i], features);
        hyi_keep_scatter(batch, &r, lane, split);
    }
}

#define HYI_FEATURES_PLAIN (HYK_NEEDS_EMITTERS | HYK_NEEDS_SHAPES)
#define HYI_FEATURES_OUTDOOR (HYI_FEATURES_PLAIN | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT | HYK_NEEDS_ENVIRONMENT_MAP | HYK_NEEDS_SMOOTH_NORMALS)
#define HYI_FEATURES_TEXTURED (HYI_FEATURES_OUTDOOR | HYK_NEEDS_TEXTURES | HYK_NEEDS_NORMAL_MAPS | HYK_NEEDS_ALPHA | HYK_NEEDS_INSTANCES)
#define HYI_FEATURES_SPECULAR \
    (HYI_FEATURES_PLAIN | HYK_NEEDS_SPECULAR | HYK_NEEDS_TRANSMISSION | HYK_NEEDS_ABSORPTION | HYK_NEEDS_SMOOTH_NORMALS | HYK_NEEDS_INSTANCES)
#define HYI_FEATURES_EVERYTHING (HYI_FEATURES_TEXTURED | HYI_FEATURES_SPECULAR)
#define HYI_SHADE_KERNELS(X)               \
    X(plain, HYI_FEATURES_PLAIN)           \
    X(outdoor, HYI_FEATURES_OUTDOOR)       \
    X(textured, HYI_FEATURES_TEXTURED)     \
    X(specular, HYI_FEATURES_SPECULAR)     \
    X(everything, HYI_FEATURES_EVERYTHING)

#define HYI_DEFINE_SHADE(name, features) \
    HYI_NOINLINE void hyi_shade_##name(const hyi_picture *picture, hyi_batch *batch) { hyi_shade_batch(picture, batch, (features)); }
HYI_SHADE_KERNELS(HYI_DEFINE_SHADE)
#undef HYI_DEFINE_SHADE

/* The leanest kernel that has all the features; also what hydra_estimate reports. */
HYI_FN uint32_t hyi_kernel_features(uint32_t needs) {
#define HYI_IF_ENOUGH(name, features) if ((needs & ~(uint32_t)(features)) == 0) return (features);
    HYI_SHADE_KERNELS(HYI_IF_ENOUGH)
#undef HYI_IF_ENOUGH
    return HYI_FEATURES_EVERYTHING;
}

HYI_FN void hyi_shade(const hyi_picture *picture, hyi_batch *batch) {
    uint32_t kernel = hyi_kernel_features(picture->features);
#define HYI_CALL_SHADE(name, features) if (kernel == (features)) { hyi_shade_##name(picture, batch); return; }
    HYI_SHADE_KERNELS(HYI_CALL_SHADE)
#undef HYI_CALL_SHADE
}

/* ---- generate */

/* Paths from points start with a scattering at the point, not with a ray. */
HYI_FN void hyi_scatter_point(const hyi_picture *picture, hyi_batch *batch, hyk_sampler random, uint32_t lane, size_t point) {
    const float *p = picture->point_positions + 3 * point, *n = picture->point_normals + 3 * point;
    hyk_vec3 position = hyk_make3(p[0], p[1], p[2]), normal = hyk_make3(n[0], n[1], n[2]);
    hyk_path path = hyk_point_path(picture->kernel, random, lane);
    hyk_scatter r = hyk_shade_point(picture->view, picture->kernel.settings, path, position, normal, HYK_NEEDS_AT_POINTS);
    batch->lanes[lane].flags |= HYK_LANE_HIT;
    hyi_keep_scatter(batch, &r, lane, (picture->kernel.settings.wants & HYK_WANTS_COMPONENTS) != 0);
}

HYI_FN void hyi_generate_lane(const hyi_picture *picture, hyi_batch *batch, uint32_t x, uint32_t y, uint32_t sample, uint32_t lane) {
    const hyk_camera *camera = &picture->kernel.camera;
    size_t element = (size_t)y * camera->width + x; /* of a list */
    hyk_sampler random = hyk_lane_sampler(picture->kernel, x, y, sample);
    if (camera->kind == HYK_SENSOR_POINTS) {
        hyi_scatter_point(picture, batch, random, lane, element);
        return;
    }
    hyk_ray ray;
    if (camera->kind == HYK_SENSOR_RAYS) ray = hyk_callers_ray(hyi_load_ray((const hyk_ray *)(const void *)&picture->rays[element]));
    else ray = hyk_sensor_ray(*camera, x, y, random);
    batch->paths[batch->paths_alive] = hyk_first_path(picture->kernel, ray, random, lane, picture->features);
    batch->rays[batch->paths_alive] = batch->paths[batch->paths_alive].ray;
    batch->paths_alive++;
}

HYI_FN void hyi_generate(const hyi_picture *picture, const hyk_unit *unit, hyi_batch *batch) {
    const hyk_picture *k = &picture->kernel;
    batch->paths_alive = batch->shadows_alive = 0;
    for (uint32_t p = 0; p < k->tile_pixels; p++) {
        uint32_t x = unit->tile_x + hyk_tile_column(k->tile_width, k->tile_is_square, p);
        uint32_t y = unit->tile_y + hyk_tile_row(k->tile_width, k->tile_is_square, p);
        bool used = hyk_picture_holds(*k, x, y);
        for (uint32_t s = 0; s < unit->samples; s++) {
            uint32_t lane = p * unit->samples + s;
            hyi_clear_lane(&batch->lanes[lane], used);
            if (used) hyi_generate_lane(picture, batch, x, y, unit->first_sample + s, lane);
        }
    }
}

/* ---- shadow and intersect */

HYI_FN void hyi_shadow_pass(const hyi_picture *picture, hyi_batch *batch) {
    uint32_t count = batch->shadows_alive;
    if (!count) return;
    hyi_trace_any(picture->accel, &batch->stream, batch->shadow_rays, batch->occluded, count);
    if (picture->accel->shapes) hyi_trace_shapes_any(picture->accel, batch->shadow_rays, batch->occluded, count);
    for (uint32_t i = 0; i < count; i++) {
        if (batch->occluded[i]) continue;
        const hyi_shadow *shadow = &batch->shadows[i];
        hyi_lane *lane = &batch->lanes[shadow->lane];
        hyi_lane_add(lane, shadow->diffuse_component, shadow->diffuse);
        hyi_lane_add(lane, shadow->specular_component, shadow->specular);
        lane->irradiance = hyk_add(lane->irradiance, shadow->irradiance);
    }
    batch->counters.rays_shadow += count;
    batch->shadows_alive = 0;
}

HYI_FN void hyi_intersect_pass(const hyi_picture *picture, hyi_batch *batch, bool from_sensor) {
    hyi_trace_closest(picture->accel, &batch->stream, batch->rays, batch->hits, batch->paths_alive);
    if (picture->accel->shapes) hyi_trace_shapes_closest(picture->accel, batch->rays, batch->hits, batch->paths_alive, from_sensor);
}

HYI_FN void hyi_keep_first_hits(hyi_batch *batch) {
    for (uint32_t i = 0; i < batch->paths_alive; i++) {
        hyi_lane *lane = &batch->lanes[batch->paths[i].lane];
        const hyk_hit *hit = &batch->hits[i];
        lane->instance = hit->instance;
        lane->primitive = hit->primitive;
        if (hit->instance != HYK_NONE) lane->flags |= HYK_LANE_HIT;
    }
}

/* ---- the sequence */

HYI_FN void hyi_cpu_trace_unit(const hyi_picture *picture, const hyk_unit *unit, hyi_batch *batch) {
    hyi_counters *c = &batch->counters;
    double start = hyi_seconds(), now;
    hyi_generate(picture, unit, batch);
    bool from_sensor = picture->kernel.camera.kind != HYK_SENSOR_POINTS;
    if (from_sensor) c->rays_camera += batch->paths_alive;
    c->paths += (uint64_t)picture->kernel.tile_pixels * unit->samples;
    now = hyi_seconds(), c->generate += now - start, start = now;
    hyi_shadow_pass(picture, batch);
    now = hyi_seconds(), c->shadow += now - start, start = now;
    for (bool first = from_sensor; batch->paths_alive; first = false) {
        if (!first) c->rays_bounce += batch->paths_alive;
        hyi_intersect_pass(picture, batch, first);
        now = hyi_seconds(), c->intersect += now - start, start = now;
        if (first) hyi_keep_first_hits(batch);
        hyi_shade(picture, batch);
        now = hyi_seconds(), c->shade += now - start, start = now;
        hyi_shadow_pass(picture, batch);
        now = hyi_seconds(), c->shadow += now - start, start = now;
    }
}

#endif /* HYI_CPU_H */

/* >>render-exact-sum: sums that do not depend on the order of their terms

   A number is cut into digits of 32 bits on a fixed grid of exponents ("lanes"); each lane adds its digits as integers, so
   adding is associative. Only the two topmost lanes that any term reached are kept: what falls below is under 2^-32 of
   the largest term (the idea of Demmel & Nguyen 2015, "Parallel reproducible summation", in integers). Hence films add up
   to the same bits in any order, under any number of threads, and whatever the compiler does to floating point. Good for
   2^31 terms. */
#ifndef HYI_EXACT_SUM_H
#define HYI_EXACT_SUM_H

typedef struct hyi_lanes { int64_t high, low; } hyi_lanes;

/* Lane l has the weight 2^(32 l - HYI_LANE_BIAS); an empty sum has top 0, which no term reaches. */
#define HYI_LANE_BIAS 1152

/* A term's three digits; digit[0] belongs to lane first. */
typedef struct hyi_digits {
    int64_t digit[3];
    int first, top; /* top: lane of the highest digit that is not 0; 0 for the number 0 */
} hyi_digits;

HYI_INLINE hyi_digits hyi_split_digits(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    uint64_t mantissa = bits & 0xfffffffffffffu;
    int exponent = (int)(bits >> 52 & 0x7ff);
    if (exponent) mantissa |= (uint64_t)1 << 52;
    else exponent = 1;
    int place = exponent - 1075 + HYI_LANE_BIAS, shift = place & 31;
    uint64_t low = mantissa << shift, high = shift ? mantissa >> (64 - shift) : 0;
    int64_t sign = bits >> 63 ? -1 : 1;
    hyi_digits d;
    d.first = place >> 5;
    d.digit[0] = sign * (int64_t)(low & 0xffffffffu);
    d.digit[1] = sign * (int64_t)(low >> 32);
    d.digit[2] = sign * (int64_t)high;
    d.top = d.digit[2] ? d.first + 2 : d.digit[1] ? d.first + 1 : d.digit[0] ? d.first : 0;
    return d;
}

/* Moves lanes to a higher top. */
HYI_INLINE void hyi_raise_lanes(hyi_lanes *lanes, int from, int to) {
    if (to == from) return;
    lanes->low = to == from + 1 ? lanes->high : 0;
    lanes->high = 0;
}

HYI_INLINE int64_t hyi_digit_of_lane(const hyi_digits *d, int lane) {
    int i = lane - d->first;
    return i >= 0 && i < 3 ? d->digit[i] : 0;
}

/* Adds to lanes whose top is already at least the term's. */
HYI_INLINE void hyi_add_digits(hyi_lanes *lanes, int top, const hyi_digits *d) {
    lanes->high += hyi_digit_of_lane(d, top);
    lanes->low += hyi_digit_of_lane(d, top - 1);
}

HYI_FN double hyi_lanes_value(hyi_lanes lanes, int top) {
    return top ? ldexp((double)lanes.high * 4294967296.0 + (double)lanes.low, 32 * (top - 1) - HYI_LANE_BIAS) : 0.0;
}

/* count sums under one top. */
HYI_INLINE void hyi_sums_add(hyi_lanes *sums, int16_t *top, const double *terms, int count) {
    hyi_digits d[3];
    int highest = *top;
    for (int i = 0; i < count; i++) {
        d[i] = hyi_split_digits(terms[i]);
        if (d[i].top > highest) highest = d[i].top;
    }
    for (int i = 0; i < count; i++) {
        hyi_raise_lanes(&sums[i], *top, highest);
        hyi_add_digits(&sums[i], highest, &d[i]);
    }
    *top = (int16_t)highest;
}

HYI_FN void hyi_sums_merge(hyi_lanes *sums, int16_t *top, const hyi_lanes *others, int16_t other_top, int count) {
    int highest = *top > other_top ? *top : other_top;
    for (int i = 0; i < count; i++) {
        hyi_lanes other = others[i];
        hyi_raise_lanes(&other, other_top, highest);
        hyi_raise_lanes(&sums[i], *top, highest);
        sums[i].high += other.high;
        sums[i].low += other.low;
    }
    *top = (int16_t)highest;
}

/* One sum with its own top. */
typedef struct hyi_sum {
    hyi_lanes lanes;
    int16_t top;
    int16_t unused[3];
} hyi_sum;

HYI_FN void hyi_sum_add(hyi_sum *sum, double term) { hyi_sums_add(&sum->lanes, &sum->top, &term, 1); }
HYI_FN double hyi_sum_value(const hyi_sum *sum) { return hyi_lanes_value(sum->lanes, sum->top); }

/* Three sums under one top. */
typedef struct hyi_sum3 {
    hyi_lanes lanes[3];
    int16_t top;
    int16_t unused[3];
} hyi_sum3;

HYI_FN void hyi_sum3_add(hyi_sum3 *sum, const float terms[3]) {
    const double wide[3] = { (double)terms[0], (double)terms[1], (double)terms[2] };
    hyi_sums_add(sum->lanes, &sum->top, wide, 3);
}
HYI_FN void hyi_sum3_merge(hyi_sum3 *sum, const hyi_sum3 *other) { hyi_sums_merge(sum->lanes, &sum->top, other->lanes, other->top, 3); }
HYI_FN void hyi_sum3_value(const hyi_sum3 *sum, double value[3]) {
    for (int i = 0; i < 3; i++) value[i] = hyi_lanes_value(sum->lanes[i], sum->top);
}

#endif /* HYI_EXACT_SUM_H */

/* >>render-film: what is known of each pixel, and how samples come in

   Even samples of a pixel make one half of its estimate, odd ones the other. The halves never see each other's random
   numbers, so their difference tells the true error of the scrambled points (statistics.h). */
#ifndef HYI_FILM_H
#define HYI_FILM_H

/* 128 bytes. Sums of radiance for each half, of squared luminance for both. */
typedef struct hyi_pixel {
    hyi_lanes rgb[2][3];
    hyi_lanes square;
    int16_t rgb_top[2];
    int16_t square_top;
    uint16_t dropped; /* samples that were not finite, saturating */
    float largest;    /* luminance of the largest sample */
    uint32_t hits;    /* samples that met a surface, whether or not they count in the sums */
} hyi_pixel;
HYI_STATIC_ASSERT(sizeof(hyi_pixel) == 128);

typedef struct hyi_ids { uint32_t primitive, instance, mesh, material; } hyi_ids;

/* Optional sums, present when an output needs them. PAIR planes are split in halves like radiance; MEAN planes
   are plain sums over all samples. */
typedef enum hyi_plane {
    HYI_PLANE_DIRECT,   /* pair */
    HYI_PLANE_INDIRECT, /* pair */
    HYI_PLANE_CAUSTIC,  /* pair */
    HYI_PLANE_IRRADIANCE, /* pair */
    HYI_PLANE_ALBEDO,   /* mean, as the rest */
    HYI_PLANE_NORMAL,
    HYI_PLANE_POSITION,
    HYI_PLANE_DEPTH,    /* first component: depth; second: samples whose ray from a point met a back face */
    HYI_PLANE_COUNT
} hyi_plane;
HYI_FN bool hyi_plane_is_pair(int plane) { return plane <= HYI_PLANE_IRRADIANCE; }

/* The pixels of a tile fall into groups, 16 pixels apart in Morton order: the places of a 4x4 block (adaptive.h). */
#define HYI_GROUPS 16u
HYI_INLINE uint32_t hyi_group_of(size_t pixel) { return (uint32_t)(pixel % HYI_GROUPS); }

/* All tiles' pixels stand in one array, tile after tile. */
typedef struct hyi_tile {
    uint32_t chunks; /* taken of the schedule */
    uint32_t taken;  /* samples a pixel in them */
    uint32_t judged; /* chunks that the statistic below holds */
    uint32_t closed; /* groups that the others found good enough: a bit each */
    uint32_t reported[HYI_GROUPS]; /* samples of a pixel that are in the sums, half of them in each half */
    hyi_sum statistic[HYI_GROUPS]; /* sum over judged chunks and the group's pixels of the weighted sample variance */
    hyi_atomic lock;
} hyi_tile;
#define HYI_ALL_GROUPS ((1u << HYI_GROUPS) - 1u)

typedef struct hyi_film {
    uint32_t tile_width, tile_height, tile_pixels;
    uint32_t tiles_x, tiles_y, first_tile_x, first_tile_y;
    uint32_t left, top, right, bottom; /* of the region, in the frame */
    uint32_t first_sample;
    uint32_t planes_wanted; /* bits 1 << hyi_plane */
    bool ids_wanted;
    hyi_tile *tiles;
    hyi_pixel *pixels;
    hyi_sum3 *planes[HYI_PLANE_COUNT]; /* pairs: two a pixel, half after half */
    hyi_ids *ids;
} hyi_film;

HYI_INLINE size_t hyi_film_tile_count(const hyi_film *film) { return (size_t)film->tiles_x * film->tiles_y; }
HYI_INLINE size_t hyi_film_pixel_count(const hyi_film *film) { return hyi_film_tile_count(film) * film->tile_pixels; }
HYI_FN size_t hyi_plane_sums(const hyi_film *film, int plane) { return hyi_film_pixel_count(film) * (hyi_plane_is_pair(plane) ? 2u : 1u); }
HYI_INLINE uint32_t hyi_tile_left(const hyi_film *film, size_t tile) { return (film->first_tile_x + (uint32_t)(tile % film->tiles_x)) * film->tile_width; }
HYI_INLINE uint32_t hyi_tile_top(const hyi_film *film, size_t tile) { return (film->first_tile_y + (uint32_t)(tile / film->tiles_x)) * film->tile_height; }

/* Of a tile's pixel, in the frame. */
HYI_INLINE uint32_t hyi_pixel_left(const hyi_film *film, size_t tile, uint32_t i) {
    return hyi_tile_left(film, tile) + hyk_tile_column(film->tile_width, film->tile_width == film->tile_height, i);
}
HYI_INLINE uint32_t hyi_pixel_top(const hyi_film *film, size_t tile, uint32_t i) {
    return hyi_tile_top(film, tile) + hyk_tile_row(film->tile_width, film->tile_width == film->tile_height, i);
}

/* ---- layout and memory */

HYI_FN uint32_t hyi_power_of_two_from(uint32_t x) {
    uint32_t p = 1;
    while (p < x && p < 0x80000000u) p *= 2;
    return p;
}

/* Tiles keep their area where the frame is narrow or low: they are then long, so that lists fill their lanes. */
HYI_FN void hyi_shape_tiles(hyi_film *film, uint32_t tile_size, uint32_t width, uint32_t height) {
    uint32_t area = tile_size * tile_size, w = hyi_power_of_two_from(width), h = hyi_power_of_two_from(height);
    film->tile_height = h < tile_size ? h : tile_size;
    film->tile_width = w < area / film->tile_height ? w : area / film->tile_height;
    film->tile_height = h < area / film->tile_width ? h : area / film->tile_width;
    film->tile_pixels = film->tile_width * film->tile_height;
}

HYI_FN void hyi_plan_film(hyi_film *film, uint32_t tile_size, uint32_t width, uint32_t height, const uint32_t region[4]) {
    memset(film, 0, sizeof *film);
    hyi_shape_tiles(film, tile_size, width, height);
    bool whole = !region[2] && !region[3];
    film->left = whole ? 0 : region[0];
    film->top = whole ? 0 : region[1];
    film->right = whole ? width : region[0] + region[2];
    film->bottom = whole ? height : region[1] + region[3];
    film->first_tile_x = film->left / film->tile_width;
    film->first_tile_y = film->top / film->tile_height;
    film->tiles_x = (film->right - 1) / film->tile_width - film->first_tile_x + 1;
    film->tiles_y = (film->bottom - 1) / film->tile_height - film->first_tile_y + 1;
}

HYI_FN size_t hyi_film_bytes(const hyi_film *film) {
    size_t bytes = hyi_film_tile_count(film) * sizeof(hyi_tile) + hyi_film_pixel_count(film) * sizeof(hyi_pixel);
    for (int p = 0; p < HYI_PLANE_COUNT; p++)
        if (film->planes_wanted >> p & 1u) bytes += hyi_plane_sums(film, p) * sizeof(hyi_sum3);
    if (film->ids_wanted) bytes += hyi_film_pixel_count(film) * sizeof(hyi_ids);
    return bytes;
}

HYI_FN void hyi_film_free(hydra_context *context, hyi_film *film) {
    hyi_free_array(context, &film->tiles, hyi_film_tile_count(film));
    hyi_free_array(context, &film->pixels, hyi_film_pixel_count(film));
    for (int p = 0; p < HYI_PLANE_COUNT; p++) hyi_free_array(context, &film->planes[p], hyi_plane_sums(film, p));
    hyi_free_array(context, &film->ids, hyi_film_pixel_count(film));
}

HYI_FN hydra_result hyi_film_alloc_parts(hydra_context *context, hyi_film *film) {
    size_t pixels = hyi_film_pixel_count(film);
    HYI_TRY(hyi_alloc_array(context, &film->tiles, hyi_film_tile_count(film)));
    HYI_TRY(hyi_alloc_array(context, &film->pixels, pixels));
    memset(film->tiles, 0, hyi_film_tile_count(film) * sizeof *film->tiles);
    memset(film->pixels, 0, pixels * sizeof *film->pixels);
    for (int p = 0; p < HYI_PLANE_COUNT; p++) {
        if (!(film->planes_wanted >> p & 1u)) continue;
        HYI_TRY(hyi_alloc_array(context, &film->planes[p], hyi_plane_sums(film, p)));
        memset(film->planes[p], 0, hyi_plane_sums(film, p) * sizeof *film->planes[p]);
    }
    if (!film->ids_wanted) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(context, &film->ids, pixels));
    memset(film->ids, 0, pixels * sizeof *film->ids);
    for (size_t i = 0; i < pixels; i++) film->ids[i].primitive = HYDRA_NONE;
    return HYDRA_OK;
}

/* film is planned. On failure nothing stays allocated. */
HYI_FN hydra_result hyi_film_alloc(hydra_context *context, hyi_film *film) {
    hydra_result result = hyi_film_alloc_parts(context, film);
    if (result != HYDRA_OK) hyi_film_free(context, film);
    return result;
}

/* Where pixel (x, y) of the frame is stored; it must be inside the region. */
HYI_FN size_t hyi_pixel_tile(const hyi_film *film, uint32_t x, uint32_t y) {
    return (size_t)(y / film->tile_height - film->first_tile_y) * film->tiles_x + (x / film->tile_width - film->first_tile_x);
}
HYI_FN size_t hyi_pixel_index(const hyi_film *film, uint32_t x, uint32_t y) {
    uint32_t lx = x % film->tile_width, ly = y % film->tile_height;
    uint32_t local = film->tile_width == film->tile_height ? hyk_morton(lx, ly) : ly * film->tile_width + lx;
    return hyi_pixel_tile(film, x, y) * film->tile_pixels + local;
}

/* ---- samples coming in */

HYI_INLINE void hyi_lane_radiance(const hyi_lane *lane, float rgb[3]) {
    hyk_vec3 sum = hyk_add(lane->part[0], hyk_add(lane->part[1], lane->part[2]));
    rgb[0] = sum.x;
    rgb[1] = sum.y;
    rgb[2] = sum.z;
}

HYI_INLINE float hyi_luminance(const float c[3]) { return 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2]; }

/* Whether all that the lane brings is finite: bits, so that fast-math does not assume it away. */
HYI_FN bool hyi_lane_is_finite(const hyi_lane *lane) {
    const float *numbers = &lane->part[0].x;
    for (size_t i = 0; i < 12; i++) { /* three parts and the irradiance stand in a row */
        uint32_t bits;
        memcpy(&bits, numbers + i, sizeof bits);
        if ((bits & 0x7f800000u) == 0x7f800000u) return false;
    }
    return true;
}
HYI_STATIC_ASSERT(offsetof(hyi_lane, irradiance) == 36);

HYI_INLINE void hyi_plane_add(const hyi_film *film, int plane, size_t at, hyk_vec3 v) {
    const float terms[3] = { v.x, v.y, v.z };
    if (film->planes[plane]) hyi_sum3_add(&film->planes[plane][at], terms);
}

HYI_FN void hyi_add_means(hyi_film *film, size_t pixel, const hyi_lane *lane) {
    hyk_first_surface first = lane->first;
    if (lane->flags & HYK_LANE_INSIDE) hyi_plane_add(film, HYI_PLANE_DEPTH, pixel, hyk_make3(0.0f, 1.0f, 0.0f));
    if (!(lane->flags & HYK_LANE_HIT)) return;
    hyi_plane_add(film, HYI_PLANE_ALBEDO, pixel, first.albedo);
    hyi_plane_add(film, HYI_PLANE_NORMAL, pixel, first.normal);
    hyi_plane_add(film, HYI_PLANE_POSITION, pixel, first.position);
    hyi_plane_add(film, HYI_PLANE_DEPTH, pixel, hyk_make3(first.depth, 0.0f, 0.0f));
}

/* The part of the picture that only counts while the pixel's group is open. */
HYI_FN void hyi_add_radiance(hyi_film *film, size_t index, int half, const hyi_lane *lane, const float rgb[3], float luminance) {
    hyi_pixel *pixel = &film->pixels[index];
    const double wide[3] = { (double)rgb[0], (double)rgb[1], (double)rgb[2] };
    double square = (double)luminance * (double)luminance;
    hyi_sums_add(pixel->rgb[half], &pixel->rgb_top[half], wide, 3);
    hyi_sums_add(&pixel->square, &pixel->square_top, &square, 1);
    if (luminance > pixel->largest) pixel->largest = luminance;
    for (int part = 0; part < 3; part++) hyi_plane_add(film, HYI_PLANE_DIRECT + part, 2 * index + (size_t)half, lane->part[part]);
    hyi_plane_add(film, HYI_PLANE_IRRADIANCE, 2 * index + (size_t)half, lane->irradiance);
}
HYI_STATIC_ASSERT(HYK_COMPONENT_DIRECT == HYI_PLANE_DIRECT && HYK_COMPONENT_INDIRECT == HYI_PLANE_INDIRECT && HYK_COMPONENT_CAUSTIC == HYI_PLANE_CAUSTIC);

/* Takes a sample; returns its luminance, 0 for one that is not finite. */
HYI_FN float hyi_film_add(hyi_film *film, size_t index, int half, bool open, hyi_lane *lane) {
    hyi_pixel *pixel = &film->pixels[index];
    if (!hyi_lane_is_finite(lane)) {
        for (int part = 0; part < 3; part++) lane->part[part] = hyk_zero3();
        lane->irradiance = hyk_zero3();
        if (pixel->dropped < UINT16_MAX) pixel->dropped++;
    }
    float rgb[3];
    hyi_lane_radiance(lane, rgb);
    float luminance = hyi_luminance(rgb);
    if (open) hyi_add_radiance(film, index, half, lane, rgb, luminance);
    if (lane->flags & HYK_LANE_HIT) pixel->hits++;
    hyi_add_means(film, index, lane);
    return luminance;
}

/* ---- values */

HYI_FN void hyi_half_mean(const hyi_film *film, const hyi_tile *tile, size_t index, int half, double mean[3]) {
    const hyi_pixel *pixel = &film->pixels[index];
    uint32_t reported = tile->reported[hyi_group_of(index)];
    double n = reported ? 0.5 * (double)reported : 1.0;
    for (int i = 0; i < 3; i++) mean[i] = hyi_lanes_value(pixel->rgb[half][i], pixel->rgb_top[half]) / n;
}

HYI_FN double hyi_wide_luminance(const double c[3]) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }

HYI_FN void hyi_pixel_mean(const hyi_film *film, const hyi_tile *tile, size_t index, double mean[3]) {
    double a[3], b[3];
    hyi_half_mean(film, tile, index, 0, a);
    hyi_half_mean(film, tile, index, 1, b);
    for (int i = 0; i < 3; i++) mean[i] = 0.5 * (a[i] + b[i]);
}

#endif /* HYI_FILM_H */

/* >>render-adaptive: which tile gets how many samples

   HYDRA's tiles (ALGORITHMS section 3) with a stopping rule that does not bias the picture. Stopping when one's own
   samples look good favours samples that missed something (Kirk & Arvo 1991). So a pixel never decides for itself: the pixels of a tile
   form 16 groups, each spread evenly over the tile, and a group stops counting its samples when the error that the
   *other* groups show is small enough. How many of a pixel's samples count is then independent of what they say, and
   its mean and its error bar stay unbiased. Any two groups' judges share most of their evidence, so all groups of a
   tile stop at nearly the same stage; until the last one does, all go on sampling to be evidence for it.
   (Two halves of each pixel's samples that judge each other are unbiased as well; with nothing in common they disagree
   more often, and more samples are evidence only: bench-trade prints samples counted and traced.)

   Error of a tile, from a set of its pixels: sqrt(mean over them of w v / n), v a pixel's sample variance of luminance
   (within chunks, pooled), n its samples, w = 1 / max(mean, L / 10)^2 with L the picture's mean luminance. A tile is
   also charged with one sample of luminance L that it has not seen: a black tile must be sampled until that would not
   matter. A pixel that is alone in its tile has no others, and judges itself. */
#ifndef HYI_ADAPTIVE_H
#define HYI_ADAPTIVE_H

#define HYI_CHUNK_SAMPLES 8u  /* of a pixel, half of them for each half */
#define HYI_LEAST_CHUNKS 4u   /* before any verdict */
#define HYI_DARK_SHARE 0.1    /* of L: darker pixels are judged as if that bright */

/* Chunks at the end of a stage: each stage adds a third. */
HYI_FN uint32_t hyi_stage_chunks(uint32_t stage) {
    uint32_t chunks = 1;
    for (uint32_t i = 0; i < stage && chunks < 0x10000000u; i++) chunks += chunks < 3 ? 1 : chunks / 3;
    return chunks;
}

typedef struct hyi_schedule {
    float target;         /* 0: every tile takes all chunks */
    uint32_t total_chunks;
    uint32_t stage;       /* in work */
    uint32_t *active;     /* tiles of this stage's round */
    uint32_t *base;       /* chunks each had when the round began */
    uint32_t active_count;
    uint32_t rounds_each; /* chunks the tile that lacks most must take */
    hyi_atomic next;      /* unit of the round: chunk-major, so that a tile's chunks are taken in order */
    uint32_t weighed_stage; /* whose weights stand below; stage 0 has none */
    float *weights;       /* of each pixel, where there is a target */
    double brightness;    /* L at the start of the stage */
} hyi_schedule;

HYI_FN bool hyi_tile_is_done(const hyi_schedule *schedule, const hyi_tile *tile) {
    return tile->chunks >= schedule->total_chunks || tile->closed == HYI_ALL_GROUPS;
}

HYI_FN uint32_t hyi_stage_target(const hyi_schedule *schedule) {
    uint32_t target = hyi_stage_chunks(schedule->stage);
    return target < schedule->total_chunks ? target : schedule->total_chunks;
}

/* ---- what a chunk says about the error */

/* Sample variance of one pixel within a chunk, from both halves; each is a net of its own. */
HYI_FN double hyi_chunk_variance(const float *luminance, uint32_t samples) {
    double sum = 0.0, squares = 0.0;
    for (uint32_t s = 0; s < samples; s++) {
        sum += (double)luminance[s];
        squares += (double)luminance[s] * (double)luminance[s];
    }
    double variance = (squares - sum * sum / (double)samples) / (double)(samples - 1);
    return variance > 0.0 ? variance : 0.0;
}

/* ---- verdicts */

/* Pixels of each group that lie in the region; returns how many in all. */
HYI_FN uint32_t hyi_count_groups(const hyi_film *film, size_t tile, uint32_t counts[HYI_GROUPS]) {
    uint32_t all = 0;
    memset(counts, 0, HYI_GROUPS * sizeof *counts);
    for (uint32_t i = 0; i < film->tile_pixels; i++) {
        uint32_t x = hyi_pixel_left(film, tile, i), y = hyi_pixel_top(film, tile, i);
        if (x < film->left || x >= film->right || y < film->top || y >= film->bottom) continue;
        counts[hyi_group_of(i)]++;
        all++;
    }
    return all;
}

/* Squared error of a tile, from statistic over count of its pixels. */
HYI_FN double hyi_tile_error_square(const hyi_schedule *schedule, const hyi_tile *tile, double statistic, double count) {
    double n = (double)tile->taken, variance = statistic / ((double)tile->judged * count);
    double unseen = schedule->brightness > 0.0 ? 1.0 / (HYI_DARK_SHARE * HYI_DARK_SHARE * n * count) : 0.0;
    return (variance + unseen) / n;
}

/* Closes each group that all others find good enough. */
HYI_FN void hyi_judge_tile(const hyi_schedule *schedule, const hyi_film *film, hyi_tile *tile, size_t index) {
    uint32_t counts[HYI_GROUPS], all = hyi_count_groups(film, index, counts);
    double target = (double)schedule->target * (double)schedule->target;
    if (tile->judged == 0) return;
    for (uint32_t g = 0; g < HYI_GROUPS; g++) {
        bool alone = counts[g] == all;
        double statistic = 0.0;
        for (uint32_t other = 0; other < HYI_GROUPS; other++)
            if (other != g || alone) statistic += hyi_sum_value(&tile->statistic[other]);
        double count = (double)(alone ? all : all - counts[g]);
        if (counts[g] == 0 || hyi_tile_error_square(schedule, tile, statistic, count) <= target) tile->closed |= 1u << g;
    }
}

/* ---- between stages */

/* Verdicts of a finished stage. */
HYI_FN void hyi_judge_tiles(const hyi_schedule *schedule, hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++) {
        hyi_tile *tile = &film->tiles[i];
        if (tile->chunks >= HYI_LEAST_CHUNKS && tile->chunks == hyi_stage_target(schedule)) hyi_judge_tile(schedule, film, tile, i);
    }
}

HYI_FN double hyi_stored_luminance(const hyi_film *film, size_t index) {
    double mean[3];
    hyi_pixel_mean(film, &film->tiles[index / film->tile_pixels], index, mean);
    return hyi_wide_luminance(mean);
}

/* Pixels beyond the region hold zeros and add nothing. */
HYI_FN double hyi_brightness(const hyi_film *film) {
    double sum = 0.0;
    for (size_t i = 0; i < hyi_film_pixel_count(film); i++) sum += hyi_stored_luminance(film, i);
    return sum / ((double)(film->right - film->left) * (double)(film->bottom - film->top));
}

HYI_FN void hyi_weigh_tile(hyi_schedule *schedule, const hyi_film *film, size_t tile) {
    for (size_t i = tile * film->tile_pixels; i < (tile + 1) * film->tile_pixels; i++) {
        double scale = fmax(hyi_stored_luminance(film, i), HYI_DARK_SHARE * schedule->brightness);
        schedule->weights[i] = scale > 0.0 ? (float)(1.0 / scale) : 0.0f;
    }
}

/* The tiles that this stage still owes chunks. */
HYI_FN void hyi_list_round(hyi_schedule *schedule, const hyi_film *film) {
    uint32_t target = hyi_stage_target(schedule);
    schedule->active_count = schedule->rounds_each = 0;
    for (size_t i = 0; i < hyi_film_tile_count(film); i++) {
        const hyi_tile *tile = &film->tiles[i];
        if (hyi_tile_is_done(schedule, tile) || tile->chunks >= target) continue;
        schedule->base[schedule->active_count] = tile->chunks;
        schedule->active[schedule->active_count++] = (uint32_t)i;
        if (target - tile->chunks > schedule->rounds_each) schedule->rounds_each = target - tile->chunks;
    }
    hyi_atomic_store(&schedule->next, 0);
}

HYI_FN bool hyi_all_tiles_done(const hyi_schedule *schedule, const hyi_film *film) {
    for (size_t i = 0; i < hyi_film_tile_count(film); i++)
        if (!hyi_tile_is_done(schedule, &film->tiles[i])) return false;
    return true;
}

/* Lists the next round, moving on through the stages that owe nothing; false when every tile is done. Weights are of the
   film as the stage found it: a render that is saved in mid-stage keeps them. */
HYI_FN bool hyi_next_round(hyi_schedule *schedule, hyi_film *film) {
    for (hyi_list_round(schedule, film); !schedule->active_count; hyi_list_round(schedule, film)) {
        if (schedule->target > 0.0f) hyi_judge_tiles(schedule, film);
        if (hyi_all_tiles_done(schedule, film)) return false;
        schedule->stage++;
    }
    if (schedule->target > 0.0f && schedule->weighed_stage != schedule->stage) {
        schedule->brightness = hyi_brightness(film);
        for (uint32_t i = 0; i < schedule->active_count; i++) hyi_weigh_tile(schedule, film, schedule->active[i]);
        schedule->weighed_stage = schedule->stage;
    }
    return true;
}

#endif /* HYI_ADAPTIVE_H */

/* >>render-sensor: sensor descriptors checked and turned into what kernels read */
#ifndef HYI_SENSOR_H
#define HYI_SENSOR_H

HYI_STATIC_ASSERT((int)HYK_SENSOR_PINHOLE == (int)HYDRA_SENSOR_PINHOLE && (int)HYK_SENSOR_THIN_LENS == (int)HYDRA_SENSOR_THIN_LENS &&
                  (int)HYK_SENSOR_ORTHOGRAPHIC == (int)HYDRA_SENSOR_ORTHOGRAPHIC && (int)HYK_SENSOR_POINTS == (int)HYDRA_SENSOR_POINTS &&
                  (int)HYK_SENSOR_EQUIRECTANGULAR == (int)HYDRA_SENSOR_EQUIRECTANGULAR && (int)HYK_SENSOR_RAYS == (int)HYDRA_SENSOR_RAYS);
HYI_STATIC_ASSERT((int)HYK_FILTER_BOX == (int)HYDRA_FILTER_BOX && (int)HYK_FILTER_TENT == (int)HYDRA_FILTER_TENT);

#define HYI_DEGREE 0.017453292519943295

HYI_FN bool hyi_is_perspective(hydra_sensor_kind kind) { return kind == HYDRA_SENSOR_PINHOLE || kind == HYDRA_SENSOR_THIN_LENS; }
HYI_FN bool hyi_is_list(hydra_sensor_kind kind) { return kind == HYDRA_SENSOR_POINTS || kind == HYDRA_SENSOR_RAYS; }

/* ---- checks */

HYI_FN hydra_result hyi_check_camera(hydra_context *context, const hydra_sensor_desc *d) {
    HYI_TRY(hyi_check_finite(context, d->position, 3, "sensor.position"));
    HYI_TRY(hyi_check_finite(context, d->target, 3, "sensor.target"));
    HYI_TRY(hyi_check_finite(context, d->up, 3, "sensor.up"));
    HYI_TRY(hyi_check_finite(context, d->shift, 2, "sensor.shift"));
    if (hyi_is_perspective(d->kind) && d->fov_y != 0.0f)
        HYI_TRY(hyi_check_range(context, d->fov_y, (float)(0.001 * HYI_DEGREE * 0.9999), (float)(179.9 * HYI_DEGREE * 1.0001), HYDRA_ERROR_SENSOR, "sensor.fov_y"));
    HYI_TRY(hyi_check_range(context, d->lens_radius, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.lens_radius"));
    HYI_TRY(hyi_check_range(context, d->focus_distance, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.focus_distance"));
    return hyi_check_range(context, d->ortho_height, 0.0f, FLT_MAX, HYDRA_ERROR_SENSOR, "sensor.ortho_height");
}

HYI_FN hydra_result hyi_check_list(hydra_context *context, hydra_view view, size_t size, uint64_t pixels, const char *what) {
    HYI_TRY(hyi_check_view(context, view, size, what));
    if (view.count != pixels) return hyi_fail(context, HYDRA_ERROR_COUNT, "%s has %zu elements, the image %llu pixels", what, view.count, (unsigned long long)pixels);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_sensor(hydra_context *context, const hydra_sensor_desc *d, uint32_t width, uint32_t height) {
    uint64_t pixels = (uint64_t)width * height;
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_SENSOR_RAYS + 1, "sensor.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->filter, HYDRA_FILTER_TENT + 1, "sensor.filter"));
    HYI_TRY(hyi_check_enum(context, (int)d->lightmap, HYDRA_LIGHTMAP_RADIOSITY + 1, "sensor.lightmap"));
    if (d->kind == HYDRA_SENSOR_RAYS) return hyi_check_list(context, d->rays, sizeof(hydra_ray), pixels, "sensor.rays");
    if (d->kind != HYDRA_SENSOR_POINTS) return hyi_check_camera(context, d);
    HYI_TRY(hyi_check_color(context, d->lightmap_albedo, 1.0f, "sensor.lightmap_albedo"));
    HYI_TRY(hyi_check_list(context, d->point_positions, 3 * sizeof(float), pixels, "sensor.point_positions"));
    return hyi_check_list(context, d->point_normals, 3 * sizeof(float), pixels, "sensor.point_normals");
}

/* ---- cameras */

HYI_FN void hyi_cross(const double a[3], const double b[3], double c[3]) {
    for (int i = 0; i < 3; i++) c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

HYI_FN bool hyi_unit(double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(largest > 0.0)) return false;
    for (int i = 0; i < 3; i++) v[i] /= largest;
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++) v[i] /= length;
    return true;
}

/* Axes of the camera in double; distance: from position to target. */
HYI_FN hydra_result hyi_camera_axes(hydra_context *context, const hydra_sensor_desc *d, hyk_camera *camera, double *distance) {
    double forward[3], up[3] = { 0.0, 1.0, 0.0 }, right[3], square = 0.0;
    for (int i = 0; i < 3; i++) forward[i] = (double)d->target[i] - (double)d->position[i];
    for (int i = 0; i < 3; i++) square += forward[i] * forward[i];
    *distance = sqrt(square);
    if (!hyi_unit(forward)) forward[2] = -1.0;
    if (!hyi_all_zero(d->up, 3))
        for (int i = 0; i < 3; i++) up[i] = (double)d->up[i];
    hyi_unit(up);
    hyi_cross(forward, up, right);
    if (fabs(right[0]) + fabs(right[1]) + fabs(right[2]) < 1e-9) return hyi_fail(context, HYDRA_ERROR_SENSOR, "sensor.up is along the view direction");
    hyi_unit(right);
    hyi_cross(right, forward, up);
    camera->right = hyk_make3((float)right[0], (float)right[1], (float)right[2]);
    camera->up = hyk_make3((float)up[0], (float)up[1], (float)up[2]);
    camera->forward = hyk_make3((float)forward[0], (float)forward[1], (float)forward[2]);
    return HYDRA_OK;
}

/* The cone of a pixel is taken half as wide as the pixel: mip levels then blur less than the pixel's own filter. */
#define HYI_CONE_SHARE 0.5f

HYI_FN hydra_result hyi_fill_camera(hydra_context *context, const hydra_sensor_desc *d, uint32_t width, uint32_t height, hyk_camera *camera) {
    memset(camera, 0, sizeof *camera);
    camera->kind = (uint32_t)d->kind;
    camera->filter_kind = (uint32_t)d->filter;
    camera->width = width;
    camera->height = height;
    if (hyi_is_list(d->kind)) return HYDRA_OK;
    double distance;
    HYI_TRY(hyi_camera_axes(context, d, camera, &distance));
    double aspect = (double)width / (double)height, half_height = 1.0;
    if (hyi_is_perspective(d->kind)) half_height = tan(0.5 * (d->fov_y != 0.0f ? (double)d->fov_y : 0.8));
    if (d->kind == HYDRA_SENSOR_ORTHOGRAPHIC) half_height = 0.5 * (d->ortho_height != 0.0f ? (double)d->ortho_height : 2.0);
    camera->position = hyk_make3(d->position[0], d->position[1], d->position[2]);
    camera->half_height = (float)half_height;
    camera->half_width = (float)(half_height * aspect);
    camera->shift_x = hyi_is_perspective(d->kind) ? (float)(2.0 * half_height * (double)d->shift[0]) : 0.0f;
    camera->shift_y = hyi_is_perspective(d->kind) ? (float)(2.0 * half_height * (double)d->shift[1]) : 0.0f;
    camera->lens_radius = d->lens_radius;
    camera->focus_distance = d->focus_distance != 0.0f ? d->focus_distance : distance > 0.0 ? (float)distance : 1.0f;
    float pixel = HYI_CONE_SHARE * 2.0f * camera->half_height / (float)height;
    if (d->kind == HYDRA_SENSOR_EQUIRECTANGULAR) pixel = HYI_CONE_SHARE * 3.1415927f / (float)height;
    if (d->kind == HYDRA_SENSOR_ORTHOGRAPHIC) camera->start_width = pixel;
    else camera->spread = pixel;
    return HYDRA_OK;
}

/* ---- lists: copied, so that the caller may free his own */

typedef struct hyi_sensor {
    float *positions, *normals;
    hydra_ray *rays;
    size_t count;
} hyi_sensor;

HYI_FN size_t hyi_sensor_bytes(hydra_sensor_kind kind, uint64_t pixels) {
    size_t each = kind == HYDRA_SENSOR_POINTS ? 6 * sizeof(float) : kind == HYDRA_SENSOR_RAYS ? sizeof(hydra_ray) : 0;
    return each * (size_t)pixels;
}

HYI_FN void hyi_sensor_free(hydra_context *context, hyi_sensor *sensor) {
    hyi_free_array(context, &sensor->positions, 3 * sensor->count);
    hyi_free_array(context, &sensor->normals, 3 * sensor->count);
    hyi_free_array(context, &sensor->rays, sensor->count);
}

HYI_FN hydra_result hyi_take_points(hydra_context *context, const hydra_sensor_desc *d, hyi_sensor *sensor) {
    HYI_TRY(hyi_copy_floats(context, d->point_positions, 3, &sensor->positions, "sensor.point_positions"));
    HYI_TRY(hyi_copy_floats(context, d->point_normals, 3, &sensor->normals, "sensor.point_normals"));
    for (size_t i = 0; i < sensor->count; i++) {
        float *n = sensor->normals + 3 * i;
        hyk_vec3 unit = hyk_normalize(hyk_make3(n[0], n[1], n[2]));
        if (hyk_length_squared(unit) < 0.5f) return hyi_fail(context, HYDRA_ERROR_SENSOR, "normal %zu has no direction", i);
        n[0] = unit.x;
        n[1] = unit.y;
        n[2] = unit.z;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_take_sensor_rays(hydra_context *context, const hydra_sensor_desc *d, hyi_sensor *sensor) {
    HYI_TRY(hyi_alloc_array(context, &sensor->rays, sensor->count));
    for (size_t i = 0; i < sensor->count; i++) {
        memcpy(&sensor->rays[i], hyi_view_at(d->rays, sizeof(hydra_ray), i), sizeof(hydra_ray));
        if (!hyi_was_sound((const hyk_ray *)(const void *)&sensor->rays[i])) return hyi_fail(context, HYDRA_ERROR_RAY, "ray %zu of the sensor", i);
    }
    return HYDRA_OK;
}

/* desc is checked. */
HYI_FN hydra_result hyi_take_sensor(hydra_context *context, const hydra_sensor_desc *d, uint64_t pixels, hyi_sensor *sensor) {
    memset(sensor, 0, sizeof *sensor);
    if (!hyi_is_list(d->kind)) return HYDRA_OK;
    sensor->count = (size_t)pixels;
    hydra_result result = d->kind == HYDRA_SENSOR_POINTS ? hyi_take_points(context, d, sensor) : hyi_take_sensor_rays(context, d, sensor);
    if (result != HYDRA_OK) hyi_sensor_free(context, sensor);
    return result;
}

#endif /* HYI_SENSOR_H */

/* >>render: a picture in progress: creation, steps, cancelling */
#ifndef HYI_RENDER_H
#define HYI_RENDER_H

HYI_STATIC_ASSERT((int)HYK_STRATEGY_MIS == (int)HYDRA_STRATEGY_MIS && (int)HYK_STRATEGY_LIGHTS == (int)HYDRA_STRATEGY_LIGHTS &&
                  (int)HYK_STRATEGY_BSDF == (int)HYDRA_STRATEGY_BSDF);

/* Error figures of the picture at some moment (statistics.h); making them costs a pass over all pixels. */
typedef struct hyi_error_report {
    double error, low, high;
    uint64_t heavy_pixels, dropped_samples;
    double made_at, cost; /* seconds of rendering when made; seconds it took; made_at < 0: never */
} hyi_error_report;

/* Samples that came with films made elsewhere. */
#define HYI_MAX_RANGES 64
typedef struct hyi_sample_range { uint32_t first, end; } hyi_sample_range;

struct hydra_render {
    hydra_context *context;
    hydra_scene *scene;
    hydra_render_desc desc; /* sensor views are not valid after create */
    hyi_picture picture;
    hyi_sensor sensor;
    hyi_film film;
    hyi_schedule schedule;
    hyi_sample_range ranges[HYI_MAX_RANGES];
    uint32_t range_count;
    hyi_batch *batches; /* one a worker */
    void *device;       /* the backend's */
    uint32_t workers;
    double *accumulate; /* seconds, by worker */
    hyi_atomic cancel;
    bool done;
    double seconds, step_deadline;
    hyi_error_report report;
};

/* ---- checks of the descriptor */

HYI_FN hydra_result hyi_check_frame(hydra_context *context, const hydra_render_desc *d) {
    const uint32_t *r = d->region;
    if (d->width == 0 || d->height == 0) return hyi_fail(context, HYDRA_ERROR_SIZE, "%u x %u pixels", d->width, d->height);
    if ((r[2] == 0) != (r[3] == 0) || (!r[2] && (r[0] || r[1]))) return hyi_fail(context, HYDRA_ERROR_SIZE, "region of %u x %u pixels", r[2], r[3]);
    if ((uint64_t)r[0] + r[2] > d->width || (uint64_t)r[1] + r[3] > d->height)
        return hyi_fail(context, HYDRA_ERROR_SIZE, "region %u, %u, %u x %u reaches beyond %u x %u pixels", r[0], r[1], r[2], r[3], d->width, d->height);
    if (!hyi_is_list(d->sensor.kind) && (d->width > 65536 || d->height > 65536)) return hyi_fail(context, HYDRA_ERROR_SIZE, "%u x %u pixels, the most is 65536 a side", d->width, d->height);
    if ((uint64_t)d->width * d->height > (uint64_t)1 << 36) return hyi_fail(context, HYDRA_ERROR_OVERFLOW, "%u x %u pixels", d->width, d->height);
    if (d->tile_size != 0 && d->tile_size != 8 && d->tile_size != 16) return hyi_fail(context, HYDRA_ERROR_SIZE, "tile_size is %u, not 8 or 16", d->tile_size);
    return HYDRA_OK;
}

HYI_FN bool hyi_is_sound_time(double seconds) { return seconds >= 0.0 && seconds <= 1e15; }

HYI_FN hydra_result hyi_check_budget(hydra_context *context, const hydra_render_desc *d) {
    if (!(d->target_error >= 0.0f) || !hyi_is_finite(d->target_error)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "target_error is %g", (double)d->target_error);
    if (!hyi_is_sound_time(d->time_budget)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "time_budget is %g", d->time_budget);
    if (!hyi_is_sound_time(d->step_seconds)) return hyi_fail(context, HYDRA_ERROR_BUDGET, "step_seconds is %g", d->step_seconds);
    if (d->max_samples % 2 || d->first_sample % 2) return hyi_fail(context, HYDRA_ERROR_BUDGET, "samples %u to %u: both must be even", d->first_sample, d->max_samples);
    if (d->max_samples > 0x7ffffff0u) return hyi_fail(context, HYDRA_ERROR_BUDGET, "max_samples is %u", d->max_samples);
    if (d->first_sample && (d->max_samples <= d->first_sample || d->target_error > 0.0f))
        return hyi_fail(context, HYDRA_ERROR_BUDGET, "first_sample needs a greater max_samples and no target_error");
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_render_desc(hydra_context *context, const hydra_render_desc *d) {
    HYI_TRY(hyi_check_frame(context, d));
    HYI_TRY(hyi_check_budget(context, d));
    HYI_TRY(hyi_check_enum(context, (int)d->strategy, HYDRA_STRATEGY_BSDF + 1, "strategy"));
    if (d->outputs >> HYDRA_OUTPUT_COUNT) return hyi_fail(context, HYDRA_ERROR_ENUM, "outputs is 0x%x", d->outputs);
    return hyi_check_sensor(context, &d->sensor, d->width, d->height);
}

HYI_FN hydra_render_desc hyi_resolved_render_desc(const hydra_render_desc *d) {
    hydra_render_desc r = *d;
    if (r.tile_size == 0) r.tile_size = 16;
    if (r.max_samples == 0) r.max_samples = r.target_error > 0.0f || r.time_budget > 0.0 ? 0x7ffffff0u : 64;
    if (r.max_depth == 0) r.max_depth = 0xffffffffu;
    if (r.step_seconds == 0.0) r.step_seconds = 0.05;
    return r;
}

/* ---- what outputs cost */

HYI_FN bool hyi_wants(const hydra_render_desc *d, hydra_output output) { return (d->outputs >> output & 1u) != 0; }

HYI_FN void hyi_plan_outputs(const hydra_render_desc *d, hyi_film *film) {
    const uint32_t components = 1u << HYDRA_DIRECT | 1u << HYDRA_INDIRECT | 1u << HYDRA_CAUSTIC;
    if (d->outputs & components) film->planes_wanted |= 1u << HYI_PLANE_DIRECT | 1u << HYI_PLANE_INDIRECT | 1u << HYI_PLANE_CAUSTIC;
    if (hyi_wants(d, HYDRA_IRRADIANCE) && d->sensor.kind != HYDRA_SENSOR_POINTS) film->planes_wanted |= 1u << HYI_PLANE_IRRADIANCE;
    if (hyi_wants(d, HYDRA_ALBEDO)) film->planes_wanted |= 1u << HYI_PLANE_ALBEDO;
    if (hyi_wants(d, HYDRA_NORMAL)) film->planes_wanted |= 1u << HYI_PLANE_NORMAL;
    if (hyi_wants(d, HYDRA_POSITION)) film->planes_wanted |= 1u << HYI_PLANE_POSITION;
    if (hyi_wants(d, HYDRA_DEPTH) || d->sensor.kind == HYDRA_SENSOR_POINTS) film->planes_wanted |= 1u << HYI_PLANE_DEPTH;
    film->ids_wanted = (d->outputs & (1u << HYDRA_PRIMITIVE_ID | 1u << HYDRA_INSTANCE_ID | 1u << HYDRA_MESH_ID | 1u << HYDRA_MATERIAL_ID)) != 0;
}

HYI_FN void hyi_plan_render(const hydra_render_desc *d, hyi_film *film) {
    hyi_plan_film(film, d->tile_size, d->width, d->height, d->region);
    film->first_sample = d->first_sample;
    hyi_plan_outputs(d, film);
}

HYI_FN uint32_t hyi_wants_of(const hyi_film *film) {
    uint32_t wants = 0;
    const uint32_t surface = 1u << HYI_PLANE_ALBEDO | 1u << HYI_PLANE_NORMAL | 1u << HYI_PLANE_POSITION | 1u << HYI_PLANE_DEPTH;
    if (film->planes_wanted & 1u << HYI_PLANE_DIRECT) wants |= HYK_WANTS_COMPONENTS;
    if (film->planes_wanted & 1u << HYI_PLANE_IRRADIANCE) wants |= HYK_WANTS_IRRADIANCE;
    if (film->planes_wanted & surface || film->ids_wanted) wants |= HYK_WANTS_SURFACE;
    return wants;
}

HYI_FN size_t hyi_schedule_bytes(const hyi_film *film, bool adaptive) {
    return 2 * hyi_film_tile_count(film) * sizeof(uint32_t) + (adaptive ? hyi_film_pixel_count(film) * sizeof(float) : 0);
}
HYI_FN size_t hyi_worker_bytes(const hydra_scene *scene, const hyi_film *film) {
    size_t lanes = (size_t)film->tile_pixels * HYI_CHUNK_SAMPLES, bytes = sizeof(hyi_batch) + sizeof(double);
    if (scene->context->backend) return bytes + lanes * sizeof(hyi_lane);
    hyi_ray_stream stream = hyi_plan_ray_stream(&scene->accel, lanes);
    return bytes + lanes * HYI_LANE_BYTES + hyi_ray_stream_bytes(&stream);
}

/* ---- creation */

HYI_FN void hyi_fill_picture(hydra_render *r) {
    hyi_picture *p = &r->picture;
    hyk_picture *k = &p->kernel;
    p->view = &r->scene->view;
    p->accel = &r->scene->accel;
    k->settings.strategy = (uint32_t)r->desc.strategy;
    k->settings.wants = hyi_wants_of(&r->film);
    k->tile_pixels = r->film.tile_pixels;
    k->tile_width = r->film.tile_width;
    k->tile_is_square = r->film.tile_width == r->film.tile_height;
    k->left = r->film.left;
    k->top = r->film.top;
    k->right = r->film.right;
    k->bottom = r->film.bottom;
    k->max_depth = r->desc.max_depth;
    k->seed_even = hyk_hash2(r->desc.seed, 0x68616c66u);
    k->seed_odd = hyk_hash2(r->desc.seed, 0x6f746872u);
    p->point_positions = r->sensor.positions;
    p->point_normals = r->sensor.normals;
    p->rays = r->sensor.rays;
    p->features = r->scene->view.constants.features;
}

HYI_FN hydra_result hyi_schedule_alloc(hydra_render *r) {
    hyi_schedule *s = &r->schedule;
    size_t tiles = hyi_film_tile_count(&r->film);
    s->target = r->desc.target_error;
    s->total_chunks = (r->desc.max_samples - r->desc.first_sample + HYI_CHUNK_SAMPLES - 1) / HYI_CHUNK_SAMPLES;
    HYI_TRY(hyi_alloc_array(r->context, &s->active, tiles));
    HYI_TRY(hyi_alloc_array(r->context, &s->base, tiles));
    if (!(s->target > 0.0f)) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(r->context, &s->weights, hyi_film_pixel_count(&r->film)));
    memset(s->weights, 0, hyi_film_pixel_count(&r->film) * sizeof *s->weights);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_workers_alloc(hydra_render *r) {
    uint32_t count = r->context->threads;
    HYI_TRY(hyi_alloc_array(r->context, &r->batches, count));
    memset(r->batches, 0, count * sizeof *r->batches);
    r->workers = count;
    HYI_TRY(hyi_alloc_array(r->context, &r->accumulate, count));
    memset(r->accumulate, 0, count * sizeof *r->accumulate);
    for (uint32_t i = 0; i < count; i++) HYI_TRY(hyi_batch_alloc(r->context, &r->scene->accel, r->film.tile_pixels * HYI_CHUNK_SAMPLES, &r->batches[i]));
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_render_fill(hydra_render *r, const hydra_render_desc *desc) {
    r->desc = hyi_resolved_render_desc(desc);
    r->report.made_at = -1.0;
    HYI_TRY(hyi_fill_camera(r->context, &r->desc.sensor, r->desc.width, r->desc.height, &r->picture.kernel.camera));
    hyi_film planned;
    hyi_plan_render(&r->desc, &planned);
    if (hyi_film_pixel_count(&planned) > (size_t)UINT32_MAX * planned.tile_pixels) return hyi_fail(r->context, HYDRA_ERROR_OVERFLOW, "%u x %u pixels", r->desc.width, r->desc.height);
    HYI_TRY(hyi_take_sensor(r->context, &r->desc.sensor, (uint64_t)r->desc.width * r->desc.height, &r->sensor));
    HYI_TRY(hyi_film_alloc(r->context, &planned));
    r->film = planned;
    HYI_TRY(hyi_schedule_alloc(r));
    HYI_TRY(hyi_workers_alloc(r));
    hyi_fill_picture(r);
    return r->context->backend ? r->context->backend->begin_render(r) : HYDRA_OK;
}

HYDRA_API void hydra_render_destroy(hydra_render *render) {
    if (!render) return;
    hydra_context *context = render->context;
    if (context->backend) context->backend->end_render(render);
    for (uint32_t i = 0; render->batches && i < render->workers; i++) hyi_batch_free(context, &render->batches[i]);
    hyi_free_array(context, &render->batches, render->workers);
    hyi_free_array(context, &render->accumulate, render->workers);
    hyi_free_array(context, &render->schedule.active, hyi_film_tile_count(&render->film));
    hyi_free_array(context, &render->schedule.base, hyi_film_tile_count(&render->film));
    hyi_free_array(context, &render->schedule.weights, hyi_film_pixel_count(&render->film));
    hyi_film_free(context, &render->film);
    hyi_sensor_free(context, &render->sensor);
    render->scene->renders_living--;
    hyi_free_array(context, &render, 1);
}

HYDRA_API hydra_render *hydra_render_create(hydra_scene *scene, const hydra_render_desc *desc) {
    if (!scene) return NULL;
    if (!desc) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "hydra_render_create: the desc"), (hydra_render *)NULL;
    if (hyi_check_committed(scene) != HYDRA_OK || hyi_check_render_desc(scene->context, desc) != HYDRA_OK) return NULL;
    hydra_render *render;
    if (hyi_alloc_array(scene->context, &render, 1) != HYDRA_OK) return NULL;
    memset(render, 0, sizeof *render);
    render->context = scene->context;
    render->scene = scene;
    scene->renders_living++;
    if (hyi_render_fill(render, desc) == HYDRA_OK) return render;
    hydra_render_destroy(render);
    return NULL;
}

/* ---- one unit of work: a chunk of a tile */

HYI_FN uint32_t hyi_chunk_samples(const hydra_render *r, uint32_t chunk) {
    uint32_t first = r->film.first_sample + chunk * HYI_CHUNK_SAMPLES, left = r->desc.max_samples - first;
    return left < HYI_CHUNK_SAMPLES ? left : HYI_CHUNK_SAMPLES;
}

HYI_FN hyk_unit hyi_describe_unit(const hydra_render *r, uint32_t tile, uint32_t chunk) {
    hyk_unit unit;
    unit.tile_x = hyi_tile_left(&r->film, tile);
    unit.tile_y = hyi_tile_top(&r->film, tile);
    unit.first_sample = r->film.first_sample + chunk * HYI_CHUNK_SAMPLES;
    unit.samples = hyi_chunk_samples(r, chunk);
    return unit;
}

HYI_FN void hyi_keep_ids(hydra_render *r, size_t index, const hyi_lane *lane) {
    hyi_ids *ids = &r->film.ids[index];
    if (lane->instance >= HYK_HIT_SHAPE) return;
    ids->primitive = lane->primitive;
    ids->instance = r->scene->placed_ids[lane->instance];
    ids->mesh = r->scene->placed[lane->instance].mesh + 1;
    ids->material = lane->first.material == HYK_NONE ? 0 : lane->first.material;
}

HYI_FN void hyi_accumulate_pixel(hydra_render *r, const hyi_tile *tile, const hyk_unit *unit, size_t index, hyi_lane *lanes, double *judgement) {
    float luminance[HYI_CHUNK_SAMPLES];
    if (r->film.ids && unit->first_sample == r->film.first_sample) hyi_keep_ids(r, index, &lanes[0]);
    uint32_t group = hyi_group_of(index);
    bool open = !(tile->closed >> group & 1u);
    for (uint32_t s = 0; s < unit->samples; s++) luminance[s] = hyi_film_add(&r->film, index, (int)(s & 1), open, &lanes[s]);
    if (!r->schedule.weights) return;
    double weight = (double)r->schedule.weights[index];
    judgement[group] += weight * weight * hyi_chunk_variance(luminance, unit->samples);
}

/* The order in which chunks arrive does not matter: every sum is exact. */
HYI_FN void hyi_accumulate(hydra_render *r, uint32_t tile_index, const hyk_unit *unit, hyi_lane *lanes) {
    hyi_tile *tile = &r->film.tiles[tile_index];
    double judgement[HYI_GROUPS] = { 0.0 };
    while (!hyi_atomic_swap_if(&tile->lock, 0, 1)) continue;
    for (uint32_t p = 0; p < r->film.tile_pixels; p++) {
        hyi_lane *first = &lanes[p * unit->samples];
        if (first->flags & HYK_LANE_USED) hyi_accumulate_pixel(r, tile, unit, (size_t)tile_index * r->film.tile_pixels + p, first, judgement);
    }
    for (uint32_t g = 0; g < HYI_GROUPS; g++)
        if (!(tile->closed >> g & 1u)) tile->reported[g] += unit->samples;
    tile->taken += unit->samples;
    tile->chunks++;
    if (r->schedule.weights && r->schedule.stage > 0 && unit->samples >= 4) {
        for (uint32_t g = 0; g < HYI_GROUPS; g++) hyi_sum_add(&tile->statistic[g], judgement[g]);
        tile->judged++;
    }
    hyi_atomic_store(&tile->lock, 0);
}

HYI_FN void hyi_run_unit(hydra_render *r, uint32_t worker, uint32_t tile, uint32_t chunk) {
    hyi_batch *batch = &r->batches[worker];
    hyk_unit unit = hyi_describe_unit(r, tile, chunk);
    hyi_cpu_trace_unit(&r->picture, &unit, batch);
    double start = hyi_seconds();
    hyi_accumulate(r, tile, &unit, batch->lanes);
    r->accumulate[worker] += hyi_seconds() - start;
}

/* ---- steps */

HYI_FN bool hyi_must_stop(const hydra_render *r) { return hyi_atomic_load(&r->cancel) || hyi_seconds() >= r->step_deadline; }

/* Takes units of the round until it is empty or time is up; every unit that was taken is finished. */
HYI_FN void hyi_work(void *argument, uint32_t worker) {
    hydra_render *r = (hydra_render *)argument;
    hyi_schedule *s = &r->schedule;
    int64_t units = (int64_t)s->active_count * s->rounds_each;
    uint32_t target = hyi_stage_target(s);
    bool first = worker == 0; /* progress even when a step is shorter than a unit */
    while (first || !hyi_must_stop(r)) {
        int64_t unit = hyi_atomic_add(&s->next, 1);
        if (unit >= units) return;
        uint32_t slot = (uint32_t)(unit % s->active_count);
        uint32_t chunk = s->base[slot] + (uint32_t)(unit / s->active_count);
        if (chunk < target) hyi_run_unit(r, worker, s->active[slot], chunk);
        first = false;
    }
}

HYI_FN bool hyi_time_is_up(const hydra_render *r, double step_start) {
    return r->desc.time_budget > 0.0 && r->seconds + (hyi_seconds() - step_start) >= r->desc.time_budget;
}

HYI_FN hydra_result hyi_render_run(hydra_render *r, double start) {
    hyi_schedule *s = &r->schedule;
    do {
        bool round_left = s->active_count && hyi_atomic_load(&s->next) < (int64_t)s->active_count * s->rounds_each;
        if (!round_left && !hyi_next_round(s, &r->film)) {
            r->done = true;
            return HYDRA_OK;
        }
        if (r->context->backend) HYI_TRY(r->context->backend->work(r));
        else hyi_parallel(r->context, r->workers, hyi_work, r);
        if (hyi_atomic_load(&r->cancel)) {
            hyi_atomic_store(&r->cancel, 0);
            return HYDRA_CANCELLED;
        }
        if (hyi_time_is_up(r, start)) {
            r->done = true;
            return HYDRA_OK;
        }
    } while (hyi_seconds() < r->step_deadline);
    return HYDRA_MORE;
}

HYDRA_API hydra_result hydra_render_step(hydra_render *render) {
    if (!render) return HYDRA_ERROR_NULL;
    if (render->done) return HYDRA_OK;
    double start = hyi_seconds(), length = render->desc.step_seconds;
    if (render->desc.time_budget > 0.0 && render->desc.time_budget - render->seconds < length) length = render->desc.time_budget - render->seconds;
    render->step_deadline = start + length;
    hydra_result result = hyi_render_run(render, start);
    render->seconds += hyi_seconds() - start;
    return result;
}

HYDRA_API void hydra_render_cancel(hydra_render *render) {
    if (render) hyi_atomic_store(&render->cancel, 1);
}

#endif /* HYI_RENDER_H */

/* >>render-statistics: standard errors of pixels, error of the picture, status

   The scatter of a pixel's samples overstates its error, because scrambled Sobol points spread out more evenly than
   random ones. The two halves of the samples are independent, so the square of their difference, over 4, is an unbiased
   estimate of the variance of their mean, but a very rough one. Both together: the scatter says how error is shared out
   among the pixels of a block, 8x8 or in a list 64x1, the halves say how much there is in all. */
#ifndef HYI_STATISTICS_H
#define HYI_STATISTICS_H

#define HYI_BLOCK_PIXELS 64u
#define HYI_PRIOR_PIXELS 2.0   /* weight of "the scatter is right" against the block's halves */
#define HYI_PRIOR_SAMPLES 4.0  /* weight of the block's mean scatter against a pixel's own */

typedef struct hyi_block_pixel {
    size_t index;
    double mean[3], half_square[3]; /* (a - b)^2 / 4 by channel */
    double luminance, luminance_half_square;
    double scatter;                 /* variance of the mean, from the samples */
} hyi_block_pixel;

typedef struct hyi_block {
    hyi_block_pixel pixels[HYI_BLOCK_PIXELS];
    uint32_t count, left, top, columns; /* the part that lies in the region */
    double scale[3], luminance_scale; /* variance of a channel, luminance = scale x smoothed scatter */
    double mean_scatter;
} hyi_block;

HYI_FN hyi_block_pixel hyi_measure_pixel(const hyi_film *film, uint32_t x, uint32_t y) {
    hyi_block_pixel p;
    p.index = hyi_pixel_index(film, x, y);
    const hyi_tile *tile = &film->tiles[hyi_pixel_tile(film, x, y)];
    const hyi_pixel *pixel = &film->pixels[p.index];
    double a[3], b[3], n = (double)tile->reported[hyi_group_of(p.index)];
    hyi_half_mean(film, tile, p.index, 0, a);
    hyi_half_mean(film, tile, p.index, 1, b);
    for (int i = 0; i < 3; i++) p.mean[i] = 0.5 * (a[i] + b[i]);
    for (int i = 0; i < 3; i++) p.half_square[i] = 0.25 * (a[i] - b[i]) * (a[i] - b[i]);
    p.luminance = hyi_wide_luminance(p.mean);
    double difference = hyi_wide_luminance(a) - hyi_wide_luminance(b);
    p.luminance_half_square = 0.25 * difference * difference;
    double sum = n * p.luminance;
    double squares = hyi_lanes_value(pixel->square, pixel->square_top);
    double variance = n > 1.0 ? fmax(squares - sum * sum / n, 0.0) / (n - 1.0) : 0.0;
    p.scatter = n > 0.0 ? variance / n : 0.0;
    return p;
}

/* Variance of a pixel in units of the block's calibration: its scatter, drawn to the block's mean while samples are few. */
HYI_FN double hyi_smoothed_scatter(const hyi_film *film, const hyi_block *block, const hyi_block_pixel *p) {
    const hyi_tile *tile = &film->tiles[p->index / film->tile_pixels];
    double n = (double)tile->reported[hyi_group_of(p->index)];
    return (n * p->scatter + HYI_PRIOR_SAMPLES * block->mean_scatter) / (n + HYI_PRIOR_SAMPLES);
}

HYI_FN double hyi_block_scale(double halves, double scatter, double count, double prior) {
    double weight = HYI_PRIOR_PIXELS / count;
    return scatter > 0.0 ? (halves + weight * prior * scatter) / (scatter + weight * scatter) : 0.0;
}

HYI_FN void hyi_calibrate_block(hyi_block *block) {
    double scatter = 0.0, luminance = 0.0, halves = 0.0, channel[3] = { 0, 0, 0 }, channel_halves[3] = { 0, 0, 0 };
    double count = (double)block->count;
    for (uint32_t i = 0; i < block->count; i++) {
        const hyi_block_pixel *p = &block->pixels[i];
        scatter += p->scatter;
        luminance += p->luminance * p->luminance;
        halves += p->luminance_half_square;
        for (int c = 0; c < 3; c++) {
            channel[c] += p->mean[c] * p->mean[c];
            channel_halves[c] += p->half_square[c];
        }
    }
    block->mean_scatter = count > 0.0 ? scatter / count : 0.0;
    block->luminance_scale = hyi_block_scale(halves, scatter, count, 1.0);
    for (int c = 0; c < 3; c++) block->scale[c] = hyi_block_scale(channel_halves[c], scatter, count, luminance > 0.0 ? channel[c] / luminance : 1.0);
}

HYI_FN uint32_t hyi_block_width(const hyi_film *film) { return film->tile_height == 1 ? HYI_BLOCK_PIXELS : 8u; }
HYI_FN uint32_t hyi_block_height(const hyi_film *film) { return HYI_BLOCK_PIXELS / hyi_block_width(film); }

/* The block of the frame that starts at (x, y), as far as it lies in the region. */
HYI_FN void hyi_measure_block(const hyi_film *film, uint32_t x, uint32_t y, hyi_block *block) {
    uint32_t x1 = x + hyi_block_width(film), y1 = y + hyi_block_height(film);
    block->left = x > film->left ? x : film->left;
    block->top = y > film->top ? y : film->top;
    block->count = 0;
    x1 = x1 < film->right ? x1 : film->right;
    y1 = y1 < film->bottom ? y1 : film->bottom;
    block->columns = x1 - block->left;
    for (uint32_t j = block->top; j < y1; j++)
        for (uint32_t i = block->left; i < x1; i++) block->pixels[block->count++] = hyi_measure_pixel(film, i, j);
    hyi_calibrate_block(block);
}

/* Calls visit for every block that meets the region, rows first. */
HYI_FN void hyi_each_block(const hyi_film *film, void (*visit)(void *argument, const hyi_film *film, const hyi_block *block), void *argument) {
    uint32_t w = hyi_block_width(film), h = hyi_block_height(film);
    for (uint32_t y = film->top - film->top % h; y < film->bottom; y += h)
        for (uint32_t x = film->left - film->left % w; x < film->right; x += w) {
            hyi_block block;
            hyi_measure_block(film, x, y, &block);
            visit(argument, film, &block);
        }
}

/* Standard error of pixel i of a block, by channel. */
HYI_FN void hyi_pixel_error(const hyi_film *film, const hyi_block *block, uint32_t i, float error[3]) {
    double scatter = hyi_smoothed_scatter(film, block, &block->pixels[i]);
    for (int c = 0; c < 3; c++) error[c] = (float)sqrt(block->scale[c] * scatter);
}

HYI_FN bool hyi_is_heavy(const hyi_film *film, size_t index) {
    const hyi_pixel *pixel = &film->pixels[index];
    const hyi_tile *tile = &film->tiles[index / film->tile_pixels];
    double n = (double)tile->reported[hyi_group_of(index)], sum = n * hyi_stored_luminance(film, index);
    return n >= 64.0 && (double)pixel->largest > 0.1 * sum && (double)pixel->largest > 20.0 * sum / n;
}

/* ---- the picture */

typedef struct hyi_error_sums {
    double brightness;
    double square;                   /* sum over pixels of variance / max(mean, L / 10)^2 */
    double cells, cell, cell_square; /* of the same from (a - b)^2 / 4 alone, summed by cell: their number, sum, sum of squares */
    double pixels;
    uint64_t heavy, dropped;
} hyi_error_sums;

/* Pixels that share their points (sampler.h) form a cell: 4x4, in a list 4x1. Cells are independent. */
HYI_FN uint32_t hyi_cell_of(const hyi_block *block, uint32_t i) {
    uint32_t x = block->left + i % block->columns, y = block->top + i / block->columns;
    return (x / 4) % 16 | ((y / 4) % 2) << 4;
}

HYI_FN void hyi_add_block_error(void *argument, const hyi_film *film, const hyi_block *block) {
    hyi_error_sums *sums = (hyi_error_sums *)argument;
    double cells[32] = { 0.0 };
    bool seen[32] = { false };
    for (uint32_t i = 0; i < block->count; i++) {
        const hyi_block_pixel *p = &block->pixels[i];
        double scale = fmax(p->luminance, HYI_DARK_SHARE * sums->brightness), weight = scale > 0.0 ? 1.0 / (scale * scale) : 0.0;
        bool scattered = block->luminance_scale > 0.0;
        sums->square += weight * (scattered ? block->luminance_scale * hyi_smoothed_scatter(film, block, p) : p->luminance_half_square);
        cells[hyi_cell_of(block, i)] += weight * p->luminance_half_square;
        seen[hyi_cell_of(block, i)] = true;
        sums->heavy += hyi_is_heavy(film, p->index) ? 1u : 0u;
        sums->dropped += film->pixels[p->index].dropped;
    }
    for (int c = 0; c < 32; c++) {
        if (!seen[c]) continue;
        sums->cells += 1.0;
        sums->cell += cells[c];
        sums->cell_square += cells[c] * cells[c];
    }
    sums->pixels += (double)block->count;
}

/* Standard deviation of the squared error's estimate. The cells' own scatter gives it, where there are many; it is never
   taken below what 4 independent normal pixels a cell would give. */
HYI_FN double hyi_error_spread(const hyi_error_sums *s, double square) {
    double least = square * sqrt(2.0 / (4.0 * s->cells));
    if (s->cells < 1.5) return least;
    double mean = s->cell / s->cells, variance = fmax(s->cell_square / s->cells - mean * mean, 0.0) / (s->cells - 1.0);
    return fmax(sqrt(variance) * s->cells / s->pixels, least);
}

/* The interval is for the real error of this picture: its square scatters about its mean as much as the estimate does. */
HYI_FN void hyi_make_report(hydra_render *r) {
    double start = hyi_seconds();
    hyi_error_sums sums;
    memset(&sums, 0, sizeof sums);
    sums.brightness = hyi_brightness(&r->film);
    hyi_each_block(&r->film, hyi_add_block_error, &sums);
    double square = sums.square / sums.pixels, reach = 1.96 * sqrt(2.0) * hyi_error_spread(&sums, square);
    r->report.error = sqrt(square);
    r->report.low = sqrt(fmax(square - reach, 0.0));
    r->report.high = sqrt(square + reach);
    r->report.heavy_pixels = sums.heavy;
    r->report.dropped_samples = sums.dropped;
    r->report.made_at = r->seconds;
    r->report.cost = hyi_seconds() - start;
}

/* Made anew when the render is done, or when the last one's cost is under a twentieth of the time since. */
HYI_FN void hyi_refresh_report(hydra_render *r) {
    bool stale = r->report.made_at < 0.0 || (r->seconds > r->report.made_at && (r->done || r->seconds - r->report.made_at > 20.0 * r->report.cost));
    if (stale) hyi_make_report(r);
}

/* ---- status */

HYI_FN void hyi_sum_counters(const hydra_render *r, hydra_status *status) {
    for (uint32_t i = 0; i < r->workers; i++) {
        const hyi_counters *c = &r->batches[i].counters;
        status->rays_camera += c->rays_camera;
        status->rays_bounce += c->rays_bounce;
        status->rays_shadow += c->rays_shadow;
        status->paths += c->paths;
        status->seconds_generate += c->generate;
        status->seconds_intersect += c->intersect;
        status->seconds_shade += c->shade;
        status->seconds_shadow += c->shadow;
        status->seconds_accumulate += r->accumulate[i];
    }
}

/* Share of the work that a tile has behind it, if error falls with the root of the samples. */
HYI_FN double hyi_tile_fraction(const hyi_schedule *s, const hyi_tile *tile, uint32_t inside) {
    if (hyi_tile_is_done(s, tile)) return 1.0;
    double fraction = (double)tile->chunks / (double)s->total_chunks;
    if (!(s->target > 0.0f) || !tile->judged) return fraction;
    double statistic = 0.0, target = (double)s->target * (double)s->target;
    for (uint32_t g = 0; g < HYI_GROUPS; g++) statistic += hyi_sum_value(&tile->statistic[g]);
    double square = hyi_tile_error_square(s, tile, statistic, (double)inside);
    return fmax(fraction, square > target ? target / square : 0.99);
}

HYI_FN void hyi_measure_progress(const hydra_render *r, hydra_status *status) {
    const hyi_film *film = &r->film;
    double sum = 0.0, samples = 0.0, pixels = 0.0;
    size_t tiles = hyi_film_tile_count(film);
    bool first_pass = false;
    for (size_t i = 0; i < tiles; i++) {
        uint32_t groups[HYI_GROUPS], inside = hyi_count_groups(film, i, groups);
        sum += hyi_tile_fraction(&r->schedule, &film->tiles[i], inside);
        for (uint32_t g = 0; g < HYI_GROUPS; g++) samples += (double)groups[g] * (double)film->tiles[i].reported[g];
        pixels += (double)inside;
        if (film->tiles[i].chunks == 0) first_pass = true;
        if (!hyi_tile_is_done(&r->schedule, &film->tiles[i])) status->tiles_active += 1.0;
    }
    status->tiles_total = (double)tiles;
    status->samples = samples / pixels;
    status->fraction = sum / (double)tiles;
    status->stage = r->done ? HYDRA_STAGE_DONE : first_pass ? HYDRA_STAGE_FIRST_PASS : HYDRA_STAGE_REFINING;
    if (r->desc.time_budget > 0.0) status->fraction = fmax(status->fraction, fmin(r->seconds / r->desc.time_budget, 1.0));
    if (r->done) status->fraction = 1.0;
}

HYDRA_API hydra_status hydra_render_status(hydra_render *render) {
    hydra_status status;
    memset(&status, 0, sizeof status);
    if (!render) return status;
    hyi_measure_progress(render, &status);
    status.seconds = render->seconds;
    status.seconds_left = status.fraction > 0.0 ? render->seconds * (1.0 - status.fraction) / status.fraction : HUGE_VAL;
    status.error = status.error_low = status.error_high = HUGE_VAL;
    if (status.stage != HYDRA_STAGE_FIRST_PASS && status.samples > 0.0) {
        hyi_refresh_report(render);
        status.error = render->report.error;
        status.error_low = render->report.low;
        status.error_high = render->report.high;
        status.heavy_pixels = render->report.heavy_pixels;
        status.dropped_samples = render->report.dropped_samples;
    }
    hyi_sum_counters(render, &status);
    status.bytes_film = hyi_film_bytes(&render->film) + hyi_schedule_bytes(&render->film, render->desc.target_error > 0.0f);
    status.bytes_lanes = render->workers * hyi_worker_bytes(render->scene, &render->film);
    return status;
}

#endif /* HYI_STATISTICS_H */

/* >>render-read: outputs, pixel by pixel */
#ifndef HYI_READ_H
#define HYI_READ_H

HYDRA_API size_t hydra_output_size(hydra_output output) {
    if ((int)output < 0 || output >= HYDRA_OUTPUT_COUNT) return 0;
    return output <= HYDRA_POSITION ? 12 : 4;
}

HYI_FN bool hyi_output_is_there(const hydra_render *r, hydra_output output) {
    return output == HYDRA_RADIANCE || output == HYDRA_ERROR || output == HYDRA_SAMPLES || output == HYDRA_VALIDITY || hyi_wants(&r->desc, output);
}

/* Factor from the radiance of a point's white surface to what the lightmap means. */
HYI_FN float hyi_lightmap_factor(const hydra_render *r, int channel) {
    const hydra_sensor_desc *s = &r->desc.sensor;
    if (s->kind != HYDRA_SENSOR_POINTS || s->lightmap == HYDRA_LIGHTMAP_RADIANCE) return 1.0f;
    return (float)HYI_PI * (s->lightmap == HYDRA_LIGHTMAP_RADIOSITY ? s->lightmap_albedo[channel] : 1.0f);
}

HYI_FN void hyi_read_pair(const hydra_render *r, hyi_plane plane, size_t index, const hyi_tile *tile, double mean[3]) {
    double half[2][3], n = (double)tile->reported[hyi_group_of(index)];
    for (int h = 0; h < 2; h++) hyi_sum3_value(&r->film.planes[plane][2 * index + (size_t)h], half[h]);
    for (int c = 0; c < 3; c++) mean[c] = n > 0.0 ? (half[0][c] + half[1][c]) / n : 0.0;
}

HYI_FN void hyi_read_mean(const hydra_render *r, hyi_plane plane, size_t index, double count, double mean[3]) {
    hyi_sum3_value(&r->film.planes[plane][index], mean);
    for (int c = 0; c < 3; c++) mean[c] = count > 0.0 ? mean[c] / count : 0.0;
}

HYI_FN void hyi_read_color(const hydra_render *r, hydra_output output, size_t index, float out[3]) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    double mean[3], hits = (double)r->film.pixels[index].hits, taken = (double)tile->taken;
    bool lightmap = true; /* whether the value is light at a point's surface */
    switch (output) {
        case HYDRA_DIRECT: hyi_read_pair(r, HYI_PLANE_DIRECT, index, tile, mean); break;
        case HYDRA_INDIRECT: hyi_read_pair(r, HYI_PLANE_INDIRECT, index, tile, mean); break;
        case HYDRA_CAUSTIC: hyi_read_pair(r, HYI_PLANE_CAUSTIC, index, tile, mean); break;
        case HYDRA_ALBEDO: hyi_read_mean(r, HYI_PLANE_ALBEDO, index, taken, mean), lightmap = false; break;
        case HYDRA_NORMAL: hyi_read_mean(r, HYI_PLANE_NORMAL, index, taken, mean), lightmap = false; break;
        case HYDRA_POSITION: hyi_read_mean(r, HYI_PLANE_POSITION, index, hits, mean), lightmap = false; break;
        case HYDRA_IRRADIANCE:
            lightmap = false;
            if (r->desc.sensor.kind != HYDRA_SENSOR_POINTS) {
                hyi_read_pair(r, HYI_PLANE_IRRADIANCE, index, tile, mean);
                break;
            }
            hyi_pixel_mean(&r->film, tile, index, mean);
            for (int c = 0; c < 3; c++) mean[c] *= HYI_PI;
            break;
        default: hyi_pixel_mean(&r->film, tile, index, mean); break;
    }
    for (int c = 0; c < 3; c++) out[c] = (float)mean[c] * (lightmap ? hyi_lightmap_factor(r, c) : 1.0f);
}

HYI_FN uint32_t hyi_read_validity(const hydra_render *r, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    uint32_t bits = 0;
    if (tile->reported[hyi_group_of(index)]) bits |= HYDRA_VALID_SAMPLED;
    if (tile->closed >> hyi_group_of(index) & 1u) bits |= HYDRA_VALID_CONVERGED;
    if (hyi_is_heavy(&r->film, index)) bits |= HYDRA_VALID_HEAVY_TAIL;
    if (r->film.pixels[index].dropped) bits |= HYDRA_VALID_DROPPED;
    if (r->desc.sensor.kind == HYDRA_SENSOR_POINTS) {
        double met[3];
        hyi_sum3_value(&r->film.planes[HYI_PLANE_DEPTH][index], met);
        if (tile->taken && met[1] > 0.5 * (double)tile->taken) bits |= HYDRA_VALID_INSIDE;
    }
    return bits;
}

HYI_FN float hyi_read_scalar(const hydra_render *r, hydra_output output, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    double hits = (double)r->film.pixels[index].hits, depth[3];
    if (output == HYDRA_COVERAGE) return tile->taken ? (float)(hits / (double)tile->taken) : 0.0f;
    hyi_sum3_value(&r->film.planes[HYI_PLANE_DEPTH][index], depth);
    return hits > 0.0 ? (float)(depth[0] / hits) : HUGE_VALF;
}

HYI_FN uint32_t hyi_read_word(const hydra_render *r, hydra_output output, size_t index) {
    const hyi_tile *tile = &r->film.tiles[index / r->film.tile_pixels];
    switch (output) {
        case HYDRA_PRIMITIVE_ID: return r->film.ids[index].primitive;
        case HYDRA_INSTANCE_ID: return r->film.ids[index].instance;
        case HYDRA_MESH_ID: return r->film.ids[index].mesh;
        case HYDRA_MATERIAL_ID: return r->film.ids[index].material;
        case HYDRA_SAMPLES: return tile->reported[hyi_group_of(index)];
        default: return hyi_read_validity(r, index);
    }
}

HYI_FN void hyi_read_pixel(const hydra_render *r, hydra_output output, size_t index, void *out) {
    if (output <= HYDRA_POSITION) {
        float color[3];
        hyi_read_color(r, output, index, color);
        memcpy(out, color, sizeof color);
    } else if (output == HYDRA_DEPTH || output == HYDRA_COVERAGE) {
        float scalar = hyi_read_scalar(r, output, index);
        memcpy(out, &scalar, sizeof scalar);
    } else {
        uint32_t word = hyi_read_word(r, output, index);
        memcpy(out, &word, sizeof word);
    }
}

typedef struct hyi_error_reader {
    const hydra_render *render;
    char *out;
    size_t stride;
} hyi_error_reader;

HYI_FN void hyi_read_block_errors(void *argument, const hyi_film *film, const hyi_block *block) {
    const hyi_error_reader *to = (const hyi_error_reader *)argument;
    for (uint32_t i = 0; i < block->count; i++) {
        float error[3];
        hyi_pixel_error(film, block, i, error);
        for (int c = 0; c < 3; c++) error[c] *= hyi_lightmap_factor(to->render, c);
        size_t x = block->left - film->left + i % block->columns, y = block->top - film->top + i / block->columns;
        memcpy(to->out + y * to->stride + x * sizeof error, error, sizeof error);
    }
}

HYDRA_API hydra_result hydra_render_read(hydra_render *render, hydra_output output, void *pixels, size_t row_stride) {
    if (!render) return HYDRA_ERROR_NULL;
    const hyi_film *film = &render->film;
    size_t size = hydra_output_size(output), row = size * (film->right - film->left);
    if (!size) return hyi_fail(render->context, HYDRA_ERROR_ENUM, "output %d", (int)output);
    if (!pixels) return hyi_fail(render->context, HYDRA_ERROR_NULL, "pixels");
    if (!hyi_output_is_there(render, output)) return hyi_fail(render->context, HYDRA_ERROR_OUTPUT, "output %d", (int)output);
    if (row_stride && row_stride < row) return hyi_fail(render->context, HYDRA_ERROR_STRIDE, "row_stride is %zu, a row has %zu bytes", row_stride, row);
    size_t stride = row_stride ? row_stride : row;
    if (output == HYDRA_ERROR) {
        hyi_error_reader reader = { render, (char *)pixels, stride };
        hyi_each_block(film, hyi_read_block_errors, &reader);
        return HYDRA_OK;
    }
    for (uint32_t y = film->top; y < film->bottom; y++)
        for (uint32_t x = film->left; x < film->right; x++)
            hyi_read_pixel(render, output, hyi_pixel_index(film, x, y), (char *)pixels + (y - film->top) * stride + size * (x - film->left));
    return HYDRA_OK;
}

#endif /* HYI_READ_H */

/* >>render-share: films saved, resumed and added up

   A saved film is a header, a checksum and the film's state, little-endian, the same bytes on every machine. Reading and
   writing are one description of the format, walked with a stream that does either. */
#ifndef HYI_SHARE_H
#define HYI_SHARE_H

#define HYI_FILM_MAGIC 0x46524459u /* YDRF */
#define HYI_FILM_VERSION 1u

/* Walks bytes: writing, reading, or (no bytes) only counting. */
typedef struct hyi_stream {
    unsigned char *out;
    const unsigned char *in;
    size_t at, size;
    bool overrun;
} hyi_stream;

HYI_FN void hyi_stream_bytes(hyi_stream *s, uint64_t *value, size_t count) {
    size_t at = s->at;
    s->at += count;
    if (!s->out && !s->in) return;
    if (count > s->size || at > s->size - count) {
        s->overrun = true;
        return;
    }
    if (s->in) *value = 0;
    for (size_t i = 0; i < count; i++) {
        if (s->out) s->out[at + i] = (unsigned char)(*value >> (8 * i));
        else *value |= (uint64_t)s->in[at + i] << (8 * i);
    }
}

HYI_FN void hyi_stream_u16(hyi_stream *s, uint16_t *x) { uint64_t wide = *x; hyi_stream_bytes(s, &wide, 2); *x = (uint16_t)wide; }
HYI_FN void hyi_stream_u32(hyi_stream *s, uint32_t *x) { uint64_t wide = *x; hyi_stream_bytes(s, &wide, 4); *x = (uint32_t)wide; }
HYI_FN void hyi_stream_u64(hyi_stream *s, uint64_t *x) { hyi_stream_bytes(s, x, 8); }
HYI_FN void hyi_stream_i16(hyi_stream *s, int16_t *x) { uint16_t u = (uint16_t)*x; hyi_stream_u16(s, &u); *x = (int16_t)u; }
HYI_FN void hyi_stream_i64(hyi_stream *s, int64_t *x) { uint64_t u = (uint64_t)*x; hyi_stream_u64(s, &u); *x = (int64_t)u; }
HYI_FN void hyi_stream_float(hyi_stream *s, float *x) { uint32_t u; memcpy(&u, x, sizeof u); hyi_stream_u32(s, &u); memcpy(x, &u, sizeof u); }
HYI_FN void hyi_stream_double(hyi_stream *s, double *x) { uint64_t u; memcpy(&u, x, sizeof u); hyi_stream_u64(s, &u); memcpy(x, &u, sizeof u); }
HYI_FN void hyi_stream_lanes(hyi_stream *s, hyi_lanes *x) { hyi_stream_i64(s, &x->high); hyi_stream_i64(s, &x->low); }

/* ---- the format */

typedef struct hyi_film_header {
    uint32_t magic, version;
    uint64_t checksum;    /* of all that follows */
    uint64_t fingerprint; /* of scene, sensor and settings */
    uint32_t region[4];   /* left, top, right, bottom */
    uint32_t first_sample, end_sample;
    uint32_t range_count, stage, weighed_stage;
    double brightness;
} hyi_film_header;

HYI_FN void hyi_stream_header(hyi_stream *s, hyi_film_header *h) {
    hyi_stream_u32(s, &h->magic);
    hyi_stream_u32(s, &h->version);
    hyi_stream_u64(s, &h->checksum);
    hyi_stream_u64(s, &h->fingerprint);
    for (int i = 0; i < 4; i++) hyi_stream_u32(s, &h->region[i]);
    hyi_stream_u32(s, &h->first_sample);
    hyi_stream_u32(s, &h->end_sample);
    hyi_stream_u32(s, &h->range_count);
    hyi_stream_u32(s, &h->stage);
    hyi_stream_u32(s, &h->weighed_stage);
    hyi_stream_double(s, &h->brightness);
}
#define HYI_CHECKSUM_FROM 16u

HYI_FN void hyi_stream_tile(hyi_stream *s, hyi_tile *t) {
    hyi_stream_u32(s, &t->chunks);
    hyi_stream_u32(s, &t->taken);
    hyi_stream_u32(s, &t->judged);
    hyi_stream_u32(s, &t->closed);
    for (uint32_t g = 0; g < HYI_GROUPS; g++) {
        hyi_stream_u32(s, &t->reported[g]);
        hyi_stream_lanes(s, &t->statistic[g].lanes);
        hyi_stream_i16(s, &t->statistic[g].top);
    }
}

HYI_FN void hyi_stream_sum3(hyi_stream *s, hyi_sum3 *x) {
    for (int c = 0; c < 3; c++) hyi_stream_lanes(s, &x->lanes[c]);
    hyi_stream_i16(s, &x->top);
}

HYI_FN void hyi_stream_pixel(hyi_stream *s, hyi_pixel *p) {
    for (int h = 0; h < 2; h++) {
        for (int c = 0; c < 3; c++) hyi_stream_lanes(s, &p->rgb[h][c]);
        hyi_stream_i16(s, &p->rgb_top[h]);
    }
    hyi_stream_lanes(s, &p->square);
    hyi_stream_i16(s, &p->square_top);
    hyi_stream_u16(s, &p->dropped);
    hyi_stream_float(s, &p->largest);
    hyi_stream_u32(s, &p->hits);
}

HYI_FN void hyi_stream_ids(hyi_stream *s, hyi_ids *ids) {
    hyi_stream_u32(s, &ids->primitive);
    hyi_stream_u32(s, &ids->instance);
    hyi_stream_u32(s, &ids->mesh);
    hyi_stream_u32(s, &ids->material);
}

/* Everything the film knows of one pixel, with its sampling weights where there is a target. */
typedef struct hyi_pixel_state {
    hyi_pixel pixel;
    hyi_sum3 planes[2 * HYI_PLANE_COUNT];
    hyi_ids ids;
    float weight;
} hyi_pixel_state;

HYI_FN void hyi_stream_pixel_state(hyi_stream *s, const hydra_render *r, hyi_pixel_state *p) {
    hyi_stream_pixel(s, &p->pixel);
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        hyi_stream_sum3(s, &p->planes[2 * plane]);
        if (hyi_plane_is_pair(plane)) hyi_stream_sum3(s, &p->planes[2 * plane + 1]);
    }
    if (r->film.ids) hyi_stream_ids(s, &p->ids);
    if (r->schedule.weights) hyi_stream_float(s, &p->weight);
}

HYI_FN hyi_pixel_state hyi_load_pixel_state(const hydra_render *r, size_t index) {
    hyi_pixel_state p;
    memset(&p, 0, sizeof p);
    p.pixel = r->film.pixels[index];
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        size_t each = hyi_plane_is_pair(plane) ? 2 : 1;
        for (size_t h = 0; h < each; h++) p.planes[2 * (size_t)plane + h] = r->film.planes[plane][each * index + h];
    }
    if (r->film.ids) p.ids = r->film.ids[index];
    if (r->schedule.weights) p.weight = r->schedule.weights[index];
    return p;
}

/* ---- what a film belongs to */

HYI_FN uint64_t hyi_mix(uint64_t hash, const void *data, size_t size) {
    const unsigned char *bytes = (const unsigned char *)data; /* FNV-1a; eight bytes at a time where they are there */
    for (; size >= 8; size -= 8, bytes += 8) {
        uint64_t word = 0;
        for (int i = 0; i < 8; i++) word |= (uint64_t)bytes[i] << (8 * i);
        hash = (hash ^ word) * 0x100000001b3u;
        hash ^= hash >> 29;
    }
    for (size_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

HYI_FN uint64_t hyi_mix_geometry(uint64_t hash, const hydra_scene *scene) {
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        hash = hyi_mix(hash, mesh->positions, (size_t)mesh->vertex_count * 3 * sizeof(float));
        hash = hyi_mix(hash, mesh->indices, (size_t)mesh->triangle_count * 3 * sizeof(uint32_t));
        if (mesh->normals) hash = hyi_mix(hash, mesh->normals, (size_t)mesh->vertex_count * 3 * sizeof(float));
        if (mesh->uvs) hash = hyi_mix(hash, mesh->uvs, (size_t)mesh->vertex_count * 2 * sizeof(float));
        if (mesh->triangle_materials) hash = hyi_mix(hash, mesh->triangle_materials, (size_t)mesh->triangle_count * sizeof(uint32_t));
    }
    for (size_t i = 0; i < scene->texture_count; i++) hash = hyi_mix(hash, scene->textures[i].texels, scene->textures[i].words * sizeof(uint32_t));
    if (scene->environment_texels) hash = hyi_mix(hash, scene->environment_texels, hyi_environment_texel_count(scene) * sizeof(float));
    for (size_t i = 0; i < scene->placed_count; i++) hash = hyi_mix(hash, &scene->placed[i], sizeof scene->placed[i]);
    hash = hyi_mix(hash, scene->view_materials, scene->view_material_count * sizeof *scene->view_materials);
    hash = hyi_mix(hash, scene->all_lights, scene->all_light_count * sizeof *scene->all_lights);
    return hyi_mix(hash, &scene->view.constants, sizeof scene->view.constants);
}

HYI_FN uint64_t hyi_fingerprint(const hydra_render *r) {
    uint64_t hash = hyi_mix_geometry(0xcbf29ce484222325u, r->scene);
    const hydra_render_desc *d = &r->desc;
    uint32_t words[9] = { d->width, d->height, r->film.tile_width, r->film.tile_height, d->seed, d->max_depth, (uint32_t)d->strategy,
                          r->film.planes_wanted, r->film.ids_wanted ? 1u : 0u };
    hash = hyi_mix(hash, words, sizeof words);
    hash = hyi_mix(hash, &d->target_error, sizeof d->target_error);
    hash = hyi_mix(hash, &r->picture.kernel.camera, sizeof r->picture.kernel.camera);
    hash = hyi_mix(hash, r->sensor.positions, r->sensor.positions ? 3 * r->sensor.count * sizeof(float) : 0);
    hash = hyi_mix(hash, r->sensor.normals, r->sensor.normals ? 3 * r->sensor.count * sizeof(float) : 0);
    return hyi_mix(hash, r->sensor.rays, r->sensor.rays ? r->sensor.count * sizeof(hydra_ray) : 0);
}

/* ---- save */

HYI_FN hyi_film_header hyi_describe_film(const hydra_render *r) {
    hyi_film_header h;
    memset(&h, 0, sizeof h);
    h.magic = HYI_FILM_MAGIC;
    h.version = HYI_FILM_VERSION;
    h.fingerprint = hyi_fingerprint(r);
    h.region[0] = r->film.left;
    h.region[1] = r->film.top;
    h.region[2] = r->film.right;
    h.region[3] = r->film.bottom;
    h.first_sample = r->film.first_sample;
    h.end_sample = r->desc.max_samples;
    h.range_count = r->range_count;
    h.stage = r->schedule.stage;
    h.weighed_stage = r->schedule.weighed_stage;
    h.brightness = r->schedule.brightness;
    return h;
}

HYI_FN void hyi_stream_ranges(hyi_stream *s, hyi_sample_range *ranges, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hyi_stream_u32(s, &ranges[i].first);
        hyi_stream_u32(s, &ranges[i].end);
    }
}

HYI_FN size_t hyi_pixel_state_bytes(const hydra_render *r) {
    hyi_stream counter;
    hyi_pixel_state state;
    memset(&counter, 0, sizeof counter);
    memset(&state, 0, sizeof state);
    hyi_stream_pixel_state(&counter, r, &state);
    return counter.at;
}

HYI_FN size_t hyi_saved_bytes(const hydra_render *r, uint32_t ranges, size_t tiles, size_t pixels) {
    hyi_stream counter;
    hyi_film_header header;
    hyi_tile tile;
    memset(&counter, 0, sizeof counter);
    memset(&header, 0, sizeof header);
    memset(&tile, 0, sizeof tile);
    hyi_stream_tile(&counter, &tile);
    size_t tile_bytes = counter.at;
    hyi_stream_header(&counter, &header);
    return counter.at - tile_bytes + 8 * (size_t)ranges + tiles * tile_bytes + pixels * hyi_pixel_state_bytes(r);
}

HYDRA_API hydra_result hydra_render_save(const hydra_render *render, void *buffer, size_t *size) {
    if (!render) return HYDRA_ERROR_NULL;
    if (!size) return hyi_fail(render->context, HYDRA_ERROR_NULL, "size");
    size_t tiles = hyi_film_tile_count(&render->film), pixels = hyi_film_pixel_count(&render->film);
    size_t need = hyi_saved_bytes(render, render->range_count, tiles, pixels), room = *size;
    *size = need;
    if (!buffer) return HYDRA_OK;
    if (room < need) return hyi_fail(render->context, HYDRA_ERROR_BUFFER, "%zu bytes for a film of %zu", room, need);
    hyi_stream s;
    memset(&s, 0, sizeof s);
    s.out = (unsigned char *)buffer;
    s.size = need;
    hyi_film_header header = hyi_describe_film(render);
    hyi_sample_range ranges[HYI_MAX_RANGES];
    memcpy(ranges, render->ranges, sizeof ranges);
    hyi_stream_header(&s, &header);
    hyi_stream_ranges(&s, ranges, render->range_count);
    for (size_t i = 0; i < tiles; i++) {
        hyi_tile tile = render->film.tiles[i];
        hyi_stream_tile(&s, &tile);
    }
    for (size_t i = 0; i < pixels; i++) {
        hyi_pixel_state state = hyi_load_pixel_state(render, i);
        hyi_stream_pixel_state(&s, render, &state);
    }
    header.checksum = hyi_mix(0xcbf29ce484222325u, s.out + HYI_CHECKSUM_FROM, need - HYI_CHECKSUM_FROM);
    s.at = 0;
    hyi_stream_header(&s, &header);
    return HYDRA_OK;
}

/* ---- merge: first everything is checked, then taken over */

typedef struct hyi_incoming {
    hyi_film_header header;
    hyi_sample_range ranges[HYI_MAX_RANGES];
    hyi_film layout;    /* planned as the film was, nothing allocated */
    size_t tiles_at, pixels_at, tile_bytes, pixel_bytes;
    const unsigned char *data;
    size_t size;
    bool by_samples;    /* adds samples to tiles that have some; else brings tiles that are empty here */
} hyi_incoming;

HYI_FN hyi_stream hyi_reader(const hyi_incoming *in, size_t at) {
    hyi_stream s;
    memset(&s, 0, sizeof s);
    s.in = in->data;
    s.size = in->size;
    s.at = at;
    return s;
}

HYI_FN hyi_tile hyi_incoming_tile(const hyi_incoming *in, size_t tile) {
    hyi_tile t;
    memset(&t, 0, sizeof t);
    hyi_stream s = hyi_reader(in, in->tiles_at + tile * in->tile_bytes);
    hyi_stream_tile(&s, &t);
    return t;
}

HYI_FN hydra_result hyi_open_film(hydra_render *r, const void *film, size_t size, hyi_incoming *in) {
    memset(in, 0, sizeof *in);
    in->data = (const unsigned char *)film;
    in->size = size;
    hyi_stream s = hyi_reader(in, 0);
    hyi_stream_header(&s, &in->header);
    const hyi_film_header *h = &in->header;
    if (s.overrun || h->magic != HYI_FILM_MAGIC || h->version != HYI_FILM_VERSION || h->range_count > HYI_MAX_RANGES)
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "no film, or of another version");
    if (h->checksum != hyi_mix(0xcbf29ce484222325u, in->data + HYI_CHECKSUM_FROM, size - HYI_CHECKSUM_FROM))
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "the checksum does not fit");
    if (h->fingerprint != hyi_fingerprint(r)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "made from something else");
    if (h->region[0] >= h->region[2] || h->region[1] >= h->region[3] || h->region[2] > r->desc.width || h->region[3] > r->desc.height)
        return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "its region is impossible");
    const uint32_t region[4] = { h->region[0], h->region[1], h->region[2] - h->region[0], h->region[3] - h->region[1] };
    hyi_plan_film(&in->layout, r->desc.tile_size, r->desc.width, r->desc.height, region);
    size_t tiles = hyi_film_tile_count(&in->layout), pixels = hyi_film_pixel_count(&in->layout);
    hyi_stream_ranges(&s, in->ranges, h->range_count);
    in->tiles_at = s.at;
    in->pixel_bytes = hyi_pixel_state_bytes(r);
    if (size != hyi_saved_bytes(r, h->range_count, tiles, pixels)) return hyi_fail(r->context, HYDRA_ERROR_FILM_FORMAT, "%zu bytes", size);
    in->pixels_at = size - pixels * in->pixel_bytes;
    in->tile_bytes = (in->pixels_at - in->tiles_at) / tiles;
    return HYDRA_OK;
}

/* The tile here that covers the same pixels as an incoming tile; false: there is none. */
HYI_FN bool hyi_matching_tile(const hyi_film *mine, const hyi_film *theirs, size_t tile, size_t *match) {
    uint32_t x = hyi_tile_left(theirs, tile), y = hyi_tile_top(theirs, tile);
    uint32_t tx = x / mine->tile_width, ty = y / mine->tile_height;
    if (tx < mine->first_tile_x || ty < mine->first_tile_y || tx - mine->first_tile_x >= mine->tiles_x || ty - mine->first_tile_y >= mine->tiles_y) return false;
    *match = (size_t)(ty - mine->first_tile_y) * mine->tiles_x + (tx - mine->first_tile_x);
    uint32_t x1 = x + mine->tile_width, y1 = y + mine->tile_height;
    bool left = (mine->left > x ? mine->left : x) == (theirs->left > x ? theirs->left : x);
    bool top = (mine->top > y ? mine->top : y) == (theirs->top > y ? theirs->top : y);
    bool right = (mine->right < x1 ? mine->right : x1) == (theirs->right < x1 ? theirs->right : x1);
    bool bottom = (mine->bottom < y1 ? mine->bottom : y1) == (theirs->bottom < y1 ? theirs->bottom : y1);
    return left && top && right && bottom;
}

HYI_FN bool hyi_ranges_meet(uint32_t first_a, uint32_t end_a, uint32_t first_b, uint32_t end_b) { return first_a < end_b && first_b < end_a; }

/* Whether [first, end) meets any samples that this render has, or will make itself. */
HYI_FN bool hyi_has_samples_of(const hydra_render *r, uint32_t first, uint32_t end) {
    if (hyi_ranges_meet(first, end, r->desc.first_sample, r->desc.max_samples)) return true;
    for (uint32_t i = 0; i < r->range_count; i++)
        if (hyi_ranges_meet(first, end, r->ranges[i].first, r->ranges[i].end)) return true;
    return false;
}

/* Sample shares must be complete, disjoint and without a target: then adding them is all there is to do. */
HYI_FN hydra_result hyi_check_sample_share(hydra_render *r, const hyi_incoming *in) {
    const hyi_film_header *h = &in->header;
    if (r->desc.target_error > 0.0f) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "with a target error, shares must be of different tiles");
    bool meet = hyi_has_samples_of(r, h->first_sample, h->end_sample);
    for (uint32_t i = 0; i < h->range_count; i++) meet = meet || hyi_has_samples_of(r, in->ranges[i].first, in->ranges[i].end);
    if (meet) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "samples %u to %u", h->first_sample, h->end_sample);
    if (r->range_count + h->range_count + 1 > HYI_MAX_RANGES) return hyi_fail(r->context, HYDRA_ERROR_COUNT, "more than %d shares", HYI_MAX_RANGES);
    uint32_t whole = (h->end_sample - h->first_sample + HYI_CHUNK_SAMPLES - 1) / HYI_CHUNK_SAMPLES;
    for (size_t i = 0; i < hyi_film_tile_count(&in->layout); i++)
        if (hyi_incoming_tile(in, i).chunks != whole) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "the share is not finished");
    return HYDRA_OK;
}

HYI_FN bool hyi_render_is_fresh(const hydra_render *r) {
    for (size_t i = 0; i < hyi_film_tile_count(&r->film); i++)
        if (r->film.tiles[i].taken) return false;
    return r->range_count == 0;
}

HYI_FN hydra_result hyi_check_tile_share(hydra_render *r, const hyi_incoming *in) {
    bool fresh = hyi_render_is_fresh(r);
    if (in->header.range_count && !fresh) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "the share holds sample shares of its own");
    for (size_t i = 0; i < hyi_film_tile_count(&in->layout); i++) {
        size_t match = 0;
        hyi_tile tile = hyi_incoming_tile(in, i);
        if (!hyi_matching_tile(&r->film, &in->layout, i, &match)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "its region does not fall on this render's tiles");
        if (tile.taken && r->film.tiles[match].taken) return hyi_fail(r->context, HYDRA_ERROR_FILM_OVERLAP, "tile %zu", match);
        if (tile.chunks > r->schedule.total_chunks) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "it has more samples than this render may take");
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_check_incoming(hydra_render *r, hyi_incoming *in) {
    const hyi_film_header *h = &in->header;
    in->by_samples = h->first_sample != r->desc.first_sample;
    if (!in->by_samples) return hyi_check_tile_share(r, in);
    for (size_t i = 0, match; i < hyi_film_tile_count(&in->layout); i++)
        if (!hyi_matching_tile(&r->film, &in->layout, i, &match)) return hyi_fail(r->context, HYDRA_ERROR_FILM_MISMATCH, "its region does not fall on this render's tiles");
    return hyi_check_sample_share(r, in);
}

HYI_FN void hyi_merge_pixel(hydra_render *r, size_t index, const hyi_pixel_state *in, bool earlier) {
    hyi_pixel *p = &r->film.pixels[index];
    for (int h = 0; h < 2; h++) hyi_sums_merge(p->rgb[h], &p->rgb_top[h], in->pixel.rgb[h], in->pixel.rgb_top[h], 3);
    hyi_sums_merge(&p->square, &p->square_top, &in->pixel.square, in->pixel.square_top, 1);
    p->dropped = (uint16_t)(p->dropped > UINT16_MAX - in->pixel.dropped ? UINT16_MAX : p->dropped + in->pixel.dropped);
    if (in->pixel.largest > p->largest) p->largest = in->pixel.largest;
    p->hits += in->pixel.hits;
    for (int plane = 0; plane < HYI_PLANE_COUNT; plane++) {
        if (!r->film.planes[plane]) continue;
        size_t each = hyi_plane_is_pair(plane) ? 2 : 1;
        for (size_t h = 0; h < each; h++) hyi_sum3_merge(&r->film.planes[plane][each * index + h], &in->planes[2 * (size_t)plane + h]);
    }
    if (r->film.ids && earlier) r->film.ids[index] = in->ids;
    if (r->schedule.weights) r->schedule.weights[index] = in->weight;
}

HYI_FN void hyi_merge_tile(hydra_render *r, const hyi_incoming *in, size_t from, bool earlier) {
    size_t to = 0;
    hyi_tile theirs = hyi_incoming_tile(in, from);
    if (!theirs.taken || !hyi_matching_tile(&r->film, &in->layout, from, &to)) return;
    hyi_tile *mine = &r->film.tiles[to];
    if (in->by_samples) {
        mine->taken += theirs.taken;
        for (uint32_t g = 0; g < HYI_GROUPS; g++) mine->reported[g] += theirs.reported[g];
    } else {
        *mine = theirs;
    }
    size_t count = r->film.tile_pixels;
    for (size_t i = 0; i < count; i++) {
        hyi_pixel_state state;
        memset(&state, 0, sizeof state);
        hyi_stream s = hyi_reader(in, in->pixels_at + (from * count + i) * in->pixel_bytes);
        hyi_stream_pixel_state(&s, r, &state);
        hyi_merge_pixel(r, to * count + i, &state, earlier || !in->by_samples);
    }
}

HYI_FN uint32_t hyi_first_sample_of_all(const hydra_render *r) {
    uint32_t first = r->desc.first_sample;
    for (uint32_t i = 0; i < r->range_count; i++) first = r->ranges[i].first < first ? r->ranges[i].first : first;
    return first;
}

/* Where the schedule goes on: a fresh render takes the film's place in it. */
HYI_FN void hyi_merge_schedule(hydra_render *r, const hyi_incoming *in, bool fresh) {
    hyi_schedule *s = &r->schedule;
    if (in->by_samples) {
        r->ranges[r->range_count].first = in->header.first_sample;
        r->ranges[r->range_count++].end = in->header.end_sample;
    }
    for (uint32_t i = 0; i < in->header.range_count; i++) r->ranges[r->range_count++] = in->ranges[i];
    if (in->by_samples) return;
    if (fresh || in->header.stage < s->stage) s->stage = in->header.stage;
    if (fresh) {
        s->weighed_stage = in->header.weighed_stage;
        s->brightness = in->header.brightness;
    }
}

HYDRA_API hydra_result hydra_render_merge(hydra_render *render, const void *film, size_t size) {
    if (!render) return HYDRA_ERROR_NULL;
    if (!film) return hyi_fail(render->context, HYDRA_ERROR_NULL, "film");
    hyi_incoming in;
    HYI_TRY(hyi_open_film(render, film, size, &in));
    HYI_TRY(hyi_check_incoming(render, &in));
    bool fresh = hyi_render_is_fresh(render);
    uint32_t first = in.header.first_sample;
    for (uint32_t i = 0; i < in.header.range_count; i++) first = in.ranges[i].first < first ? in.ranges[i].first : first;
    bool earlier = first < hyi_first_sample_of_all(render);
    for (size_t i = 0; i < hyi_film_tile_count(&in.layout); i++) hyi_merge_tile(render, &in, i, earlier);
    hyi_merge_schedule(render, &in, fresh);
    render->schedule.active_count = 0; /* the round is listed anew */
    render->done = hyi_all_tiles_done(&render->schedule, &render->film);
    render->report.made_at = -1.0;
    return HYDRA_OK;
}

#endif /* HYI_SHARE_H */

/* >>render-estimate: what a render would take, by the very functions that will take it */
#ifndef HYI_ESTIMATE_H
#define HYI_ESTIMATE_H

HYI_FN uint32_t hyi_passes(uint32_t features) {
    uint32_t passes = HYDRA_PASS_GENERATE | HYDRA_PASS_INTERSECT | HYDRA_PASS_SHADE | HYDRA_PASS_ACCUMULATE;
    const uint32_t lights = HYK_NEEDS_EMITTERS | HYK_NEEDS_SUNS | HYK_NEEDS_ENVIRONMENT;
    if (features & HYK_NEEDS_SHAPES) passes |= HYDRA_PASS_SHAPES;
    if (features & lights) passes |= HYDRA_PASS_SHADOW; /* lights without extent are sampled whatever the strategy */
    return passes;
}

HYDRA_API hydra_result hydra_estimate(hydra_scene *scene, const hydra_render_desc *desc, hydra_estimate_result *estimate) {
    HYI_TRY(hyi_check_committed(scene));
    if (!desc || !estimate) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "hydra_estimate: the desc or the result");
    HYI_TRY(hyi_check_render_desc(scene->context, desc));
    hydra_render_desc resolved = hyi_resolved_render_desc(desc);
    hyi_film film;
    hyi_plan_render(&resolved, &film);
    uint32_t features = scene->view.constants.features;
    estimate->bytes_film = hyi_film_bytes(&film) + hyi_schedule_bytes(&film, resolved.target_error > 0.0f);
    estimate->bytes_lanes = scene->context->threads * hyi_worker_bytes(scene, &film);
    estimate->bytes_sensor = hyi_sensor_bytes(resolved.sensor.kind, (uint64_t)resolved.width * resolved.height);
    estimate->bytes_total = sizeof(hydra_render) + estimate->bytes_film + estimate->bytes_lanes + estimate->bytes_sensor;
    estimate->passes = hyi_passes(features);
    estimate->kernel_features = hyi_kernel_features(features);
    return HYDRA_OK;
}

#endif /* HYI_ESTIMATE_H */

/* >>selftest: known answers, asked on the user's own machine through the public calls */
#ifndef HYI_SELFTEST_H
#define HYI_SELFTEST_H

typedef struct hyi_selftest {
    hydra_context *context;
    hydra_scene *scene;
    hydra_render *render;
} hyi_selftest;

HYI_FN hydra_result hyi_selftest_wrong(hyi_selftest *t, const char *what, double found, double truth) {
    return hyi_fail(t->context, HYDRA_ERROR_SELFTEST, "%s is %.9g, the truth is %.9g", what, found, truth);
}

HYI_FN hydra_result hyi_selftest_error(hyi_selftest *t, const char *what) {
    char reason[sizeof t->context->error];
    memcpy(reason, t->context->error, sizeof reason);
    return hyi_fail(t->context, HYDRA_ERROR_SELFTEST, "%s could not run (%.300s)", what, reason);
}

/* A sphere of 20 x 4^levels triangles is not needed here: a lattice of longitudes and latitudes, closed and without
   T-junctions. positions: 3 (n (n/2 - 1) + 2) floats; indices: 6 n (n/2 - 1) words. */
#define HYI_SELFTEST_N 32u
#define HYI_SELFTEST_VERTICES (HYI_SELFTEST_N * (HYI_SELFTEST_N / 2 - 1) + 2)
#define HYI_SELFTEST_CORNERS (6 * HYI_SELFTEST_N * (HYI_SELFTEST_N / 2 - 1))

typedef struct hyi_selftest_ball {
    float positions[3 * HYI_SELFTEST_VERTICES];
    uint32_t indices[HYI_SELFTEST_CORNERS];
} hyi_selftest_ball;

HYI_FN void hyi_selftest_vertex(float *p, double latitude, double longitude) {
    p[0] = (float)(cos(latitude) * cos(longitude));
    p[1] = (float)sin(latitude);
    p[2] = (float)(cos(latitude) * sin(longitude));
}

HYI_FN uint32_t hyi_selftest_ring(uint32_t ring, uint32_t step) {
    const uint32_t rings = HYI_SELFTEST_N / 2 - 1;
    if (ring == 0) return HYI_SELFTEST_VERTICES - 2;
    if (ring > rings) return HYI_SELFTEST_VERTICES - 1;
    return (ring - 1) * HYI_SELFTEST_N + step % HYI_SELFTEST_N;
}

/* Front faces look outwards. */
HYI_FN void hyi_selftest_make_ball(hyi_selftest_ball *ball) {
    const uint32_t n = HYI_SELFTEST_N, rings = n / 2 - 1;
    for (uint32_t r = 1; r <= rings; r++)
        for (uint32_t s = 0; s < n; s++)
            hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(r, s), HYI_PI * ((double)r / (double)(rings + 1) - 0.5), 2.0 * HYI_PI * (double)s / (double)n);
    hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(0, 0), -0.5 * HYI_PI, 0.0);
    hyi_selftest_vertex(ball->positions + 3 * hyi_selftest_ring(rings + 1, 0), 0.5 * HYI_PI, 0.0);
    uint32_t *at = ball->indices;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t s = 0; s < n; s++) {
            const uint32_t a = hyi_selftest_ring(r, s), b = hyi_selftest_ring(r, s + 1), c = hyi_selftest_ring(r + 1, s), d = hyi_selftest_ring(r + 1, s + 1);
            if (r < rings) *at++ = a, *at++ = c, *at++ = d;
            if (r > 0) *at++ = a, *at++ = d, *at++ = b;
        }
}

HYI_FN hydra_result hyi_selftest_commit_ball(hyi_selftest *t, const hydra_material_desc *material) {
    hyi_selftest_ball *ball;
    HYI_TRY(hyi_alloc_array(t->context, &ball, 1));
    hyi_selftest_make_ball(ball);
    hydra_mesh_desc mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.positions.data = ball->positions;
    mesh.positions.count = HYI_SELFTEST_VERTICES;
    mesh.indices.data = ball->indices;
    mesh.indices.count = HYI_SELFTEST_CORNERS;
    mesh.material = hydra_scene_add_material(t->scene, material);
    hydra_scene_add_mesh(t->scene, &mesh);
    hydra_result result = hydra_scene_commit(t->scene);
    hyi_free_array(t->context, &ball, 1);
    return result;
}

HYI_FN hydra_result hyi_selftest_finish(hyi_selftest *t, const hydra_render_desc *desc) {
    hydra_render_destroy(t->render);
    t->render = hydra_render_create(t->scene, desc);
    if (!t->render) return HYDRA_ERROR_SELFTEST;
    hydra_result result;
    do result = hydra_render_step(t->render);
    while (result == HYDRA_MORE);
    return result;
}

/* Mean of all pixels' channels; the images here are 8x8. */
HYI_FN double hyi_selftest_mean(hyi_selftest *t) {
    float pixels[3 * 64];
    double sum = 0.0;
    if (hydra_render_read(t->render, HYDRA_RADIANCE, pixels, 0) != HYDRA_OK) return -1.0;
    for (int i = 0; i < 3 * 64; i++) sum += (double)pixels[i];
    return sum / (3.0 * 64.0);
}

HYI_FN hydra_render_desc hyi_selftest_frame(uint32_t samples) {
    hydra_render_desc d;
    memset(&d, 0, sizeof d);
    d.width = d.height = 8;
    d.max_samples = samples;
    return d;
}

/* Inside a closed body of albedo 1/2 that emits 1/2, radiance is 1 in every direction. */
HYI_FN hydra_result hyi_selftest_furnace(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    for (int i = 0; i < 3; i++) m.base_color[i] = m.emission[i] = 0.5f;
    m.emit_both_sides = true;
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "the furnace");
    hydra_render_desc d = hyi_selftest_frame(256);
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, "the furnace");
    double mean = hyi_selftest_mean(t);
    return fabs(mean - 1.0) < 0.02 ? HYDRA_OK : hyi_selftest_wrong(t, "radiance in the furnace", mean, 1.0);
}

/* A lossless body under a sky of 1 is invisible: every sampling routine and density of its BSDF has a part in that. */
HYI_FN hydra_result hyi_selftest_white(hyi_selftest *t, hydra_material_kind kind, float roughness, const char *name) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    m.kind = kind;
    m.roughness = roughness;
    for (int i = 0; i < 3; i++) m.base_color[i] = 1.0f;
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int i = 0; i < 3; i++) sky.color[i] = 1.0f;
    hydra_scene_set_environment(t->scene, &sky);
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, name);
    hydra_render_desc d = hyi_selftest_frame(256);
    d.sensor.position[2] = 3.0f;
    d.sensor.fov_y = 0.7f;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, name);
    double mean = hyi_selftest_mean(t);
    return fabs(mean - 1.0) < 0.02 ? HYDRA_OK : hyi_selftest_wrong(t, name, mean, 1.0);
}

HYI_FN hydra_result hyi_selftest_lambert(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_LAMBERT, 0.0f, "radiance of a white Lambert body"); }
HYI_FN hydra_result hyi_selftest_mirror(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_CONDUCTOR, 0.0f, "radiance of a mirror"); }
HYI_FN hydra_result hyi_selftest_metal(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_CONDUCTOR, 0.8f, "radiance of a rough metal"); }
HYI_FN hydra_result hyi_selftest_glass(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_DIELECTRIC, 0.0f, "radiance of glass"); }
HYI_FN hydra_result hyi_selftest_frosted(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_DIELECTRIC, 0.5f, "radiance of frosted glass"); }
HYI_FN hydra_result hyi_selftest_layered(hyi_selftest *t) { return hyi_selftest_white(t, HYDRA_MATERIAL_METALLIC_ROUGHNESS, 0.4f, "radiance of a white coated body"); }

/* Under half a sky of radiance 1 a point receives E = pi. */
HYI_FN hydra_result hyi_selftest_irradiance(hyi_selftest *t) {
    hydra_environment_desc sky;
    memset(&sky, 0, sizeof sky);
    for (int i = 0; i < 3; i++) sky.color[i] = 1.0f;
    hydra_scene_set_environment(t->scene, &sky);
    if (hydra_scene_commit(t->scene) != HYDRA_OK) return hyi_selftest_error(t, "E = pi L");
    float positions[3 * 64], normals[3 * 64];
    memset(positions, 0, sizeof positions);
    for (int i = 0; i < 3 * 64; i++) normals[i] = i % 3 == 1 ? 1.0f : 0.0f;
    hydra_render_desc d = hyi_selftest_frame(64);
    d.sensor.kind = HYDRA_SENSOR_POINTS;
    d.sensor.point_positions.data = positions;
    d.sensor.point_normals.data = normals;
    d.sensor.point_positions.count = d.sensor.point_normals.count = 64;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK) return hyi_selftest_error(t, "E = pi L");
    double mean = hyi_selftest_mean(t);
    return fabs(mean - HYI_PI) < 0.01 ? HYDRA_OK : hyi_selftest_wrong(t, "irradiance under the sky", mean, HYI_PI);
}

/* From the centre to each vertex and the middle of each edge: every ray must meet the sphere, and the scalar and the
   SIMD traversal must say the same. */
HYI_FN hydra_result hyi_selftest_watertight(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "the watertight sphere");
    const hyi_mesh_slot *mesh = &t->scene->meshes[0];
    hyi_accel scalar = t->scene->accel;
    scalar.isa = HYDRA_ISA_SCALAR;
    for (uint32_t i = 0; i < HYI_SELFTEST_CORNERS; i++) {
        const float *a = mesh->positions + 3 * mesh->indices[i], *b = mesh->positions + 3 * mesh->indices[i - i % 3 + (i + 1) % 3];
        hyk_ray rays[2];
        hyk_hit hits[2], plain[2];
        memset(rays, 0, sizeof rays);
        rays[0].direction = hyk_make3(a[0], a[1], a[2]);
        rays[1].direction = hyk_scale(hyk_add(rays[0].direction, hyk_make3(b[0], b[1], b[2])), 0.5f);
        rays[0].t_max = rays[1].t_max = FLT_MAX;
        hyi_trace_closest(&t->scene->accel, NULL, rays, hits, 2);
        hyi_trace_closest(&scalar, NULL, rays, plain, 2);
        for (int k = 0; k < 2; k++) {
            if (hits[k].instance == HYK_NONE) return hyi_selftest_wrong(t, "a ray through an edge of the sphere: hits", 0.0, 1.0);
            if (memcmp(&hits[k], &plain[k], sizeof hits[k])) return hyi_selftest_wrong(t, "SIMD traversal: distance", (double)hits[k].t, (double)plain[k].t);
        }
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_selftest_compare_films(hyi_selftest *t, const void *share, size_t size) {
    float whole[3 * 64], merged[3 * 64];
    hydra_render_desc d = hyi_selftest_frame(32);
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_read(t->render, HYDRA_RADIANCE, whole, 0) != HYDRA_OK) return hyi_selftest_error(t, "films");
    d.max_samples = 16;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_merge(t->render, share, size) != HYDRA_OK) return hyi_selftest_error(t, "films");
    hydra_render_read(t->render, HYDRA_RADIANCE, merged, 0);
    return memcmp(whole, merged, sizeof whole) ? hyi_selftest_wrong(t, "a film merged of two: its first value", (double)merged[0], (double)whole[0]) : HYDRA_OK;
}

HYI_FN hydra_result hyi_selftest_films(hyi_selftest *t) {
    hydra_material_desc m;
    memset(&m, 0, sizeof m);
    for (int i = 0; i < 3; i++) m.base_color[i] = m.emission[i] = 0.5f;
    m.emit_both_sides = true;
    if (hyi_selftest_commit_ball(t, &m) != HYDRA_OK) return hyi_selftest_error(t, "films");
    hydra_render_desc d = hyi_selftest_frame(32);
    d.first_sample = 16;
    size_t size;
    void *share;
    if (hyi_selftest_finish(t, &d) != HYDRA_OK || hydra_render_save(t->render, NULL, &size) != HYDRA_OK) return hyi_selftest_error(t, "films");
    HYI_TRY(hyi_alloc_bytes(t->context, size, &share));
    hydra_result result = hydra_render_save(t->render, share, &size);
    if (result == HYDRA_OK) result = hyi_selftest_compare_films(t, share, size);
    hyi_free_bytes(t->context, share, size);
    return result;
}

HYI_FN hydra_result hyi_selftest_run(hydra_context *context, hydra_result (*test)(hyi_selftest *)) {
    hyi_selftest t;
    t.context = context;
    t.render = NULL;
    t.scene = hydra_scene_create(context);
    if (!t.scene) return HYDRA_ERROR_OUT_OF_MEMORY;
    hydra_result result = test(&t);
    hydra_render_destroy(t.render);
    hydra_scene_destroy(t.scene);
    return result;
}

HYDRA_API hydra_result hydra_selftest(hydra_context *context) {
    if (!context) return HYDRA_ERROR_NULL;
    hydra_result (*const tests[])(hyi_selftest *) = {
        hyi_selftest_watertight, hyi_selftest_irradiance, hyi_selftest_furnace, hyi_selftest_lambert, hyi_selftest_mirror,
        hyi_selftest_metal,      hyi_selftest_glass,      hyi_selftest_frosted, hyi_selftest_layered, hyi_selftest_films,
    };
    for (size_t i = 0; i < HYI_COUNT(tests); i++) HYI_TRY(hyi_selftest_run(context, tests[i]));
    return HYDRA_OK;
}

#endif /* HYI_SELFTEST_H */

#endif /* HYDRA_IMPLEMENTATION */

/*
This software is available under two licences: choose whichever you prefer.

------------------------------------------------------------------------------
ALTERNATIVE A - MIT License

Copyright (c) 2026 hydra contributors

Permission is hereby granted, free of charge, to any person obtaining a copy of
this software and associated documentation files (the "Software"), to deal in
the Software without restriction, including without limitation the rights to
use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies
of the Software, and to permit persons to whom the Software is furnished to do
so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE.

------------------------------------------------------------------------------
ALTERNATIVE B - Public Domain (www.unlicense.org)

This is free and unencumbered software released into the public domain.

Anyone is free to copy, modify, publish, use, compile, sell, or distribute this
software, either in source code form or as a compiled binary, for any purpose,
commercial or non-commercial, and by any means.

In jurisdictions that recognize copyright laws, the author or authors of this
software dedicate any and all copyright interest in the software to the public
domain. We make this dedication for the benefit of the public at large and to
the detriment of our heirs and successors. We intend this dedication to be an
overt act of relinquishment in perpetuity of all present and future rights to
this software under copyright law.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN
ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION
WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
*/
