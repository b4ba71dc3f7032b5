/* >>shared-layouts: the records that kernels read, the same bytes in C and under std430

   Every hyk_vec3 is followed by a scalar that fills its fourth slot. */
#ifndef HYK_LAYOUTS_H
#define HYK_LAYOUTS_H

#include "vector.h"

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
