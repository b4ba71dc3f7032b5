/* gltf_extras.h: what glTF files say and assimp 5.2 drops: material extensions, texture transforms, the vertical
   field of view of cameras, and EXT_mesh_gpu_instancing */
#ifndef GLTF_EXTRAS_H
#define GLTF_EXTRAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct gltf_material {
    float specular; /* KHR_materials_specular; 1 without it */
    float ior, emissive_strength;
    float transmission, thickness;
    float attenuation_color[3], attenuation_distance; /* distance 0: none */
    uint32_t uv_set;                                  /* of the first texture that the material has */
    float uv_transform[6];                            /* rows of a 2x3 matrix: u' = a u + b v + c */
    bool uv_mixed;                                    /* its textures disagree about set or transform */
} gltf_material;

typedef struct gltf_placement {
    char *name;              /* of the node, as assimp names it */
    float (*transforms)[12]; /* node space, row-major 3x4 */
    size_t count;
} gltf_placement;

typedef struct gltf_extras {
    gltf_material *materials;
    size_t material_count;
    float *camera_fov_y; /* radians; 0: orthographic */
    size_t camera_count;
    gltf_placement *placements;
    size_t placement_count;
} gltf_extras;

/* Reads a .gltf or .glb. Leaves everything empty if the file is none; false with a message if it cannot be read. */
bool gltf_extras_read(gltf_extras *extras, const char *path);
void gltf_extras_free(gltf_extras *extras);
gltf_material gltf_material_default(void);

#endif
