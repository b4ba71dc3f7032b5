/* >>shared-views: how kernels reach the scene's buffers

   C gets a pointer to a struct of arrays; GLSL a binding per array. HYK_LOAD_X(view, i) reads record i.
   Geometry and texels are per mesh and texture in C (so that an edit touches one of them only) and
   packed in GLSL. */
#ifndef HYK_VIEWS_H
#define HYK_VIEWS_H

#include "layouts.h"
#include "light_layouts.h"

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
