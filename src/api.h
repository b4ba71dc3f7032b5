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
#define _POSIX_C_SOURCE 200809L /* -std=c99 hides the monotonic clock otherwise, */
#if !defined(_DEFAULT_SOURCE)
#define _DEFAULT_SOURCE 1 /* and huge pages */
#endif
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
    HYDRA_BUILD_FAST, /* a fifth to an eighth of the time; rays then take 5 to 20 % longer (make bench-rays): for geometry
                         that changes often */
    HYDRA_BUILD_BEST  /* spatial splits, and subtrees moved to where they cost least: for geometry that stays */
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
   -ffunction-sections -Wl,--gc-sections) gets about half of the library's code.

   Guarantees. Watertight: a ray through a shared edge or vertex hits one of the triangles around it. Exact: among
   triangles the nearest is decided in double from the float coordinates given, t is rounded once; there is no epsilon,
   t_min 0 is allowed, and a ray that starts exactly in the plane of a triangle meets it at t 0. The same ray gets the
   same answer, bit for bit, alone or in any batch, in any order, with any number of threads and any instruction set.

   Speed. One call with many rays beats many calls: from some fifty rays on they go through the tree together. Best is an
   order in which neighbours are alike (the pixels of a small block, then their shadow rays): those go as packets. Others
   go in lists of up to 8192, or 4096 where any hit does: the longer the better, where rays begin near each other. Use several
   threads by calling from several, each with its share. `make bench-rays` measures all this.

   Memory. A call with some fifty or more rays takes memory from the allocator and returns it: 0.2 MB and about half a
   kilobyte a ray, never more than 3.3 MB (4.8 MB in scenes with instances); where any hit does, 1.8 MB (2.6 MB). Where the
   allocator or the cap refuses, the answers are the same, later.
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
   is reported as HYDRA_ERROR_RAY after all others were answered. hits must not overlap rays. */
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
   the device's bookkeeping come to it; where the film is on the device, a second copy of tiles and weights as well (README,
   Memory: 2 to 12 bytes a pixel). */
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
