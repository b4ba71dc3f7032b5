/* geometry.h: assimp's meshes become hydra meshes: joined where a mesh stands once, instanced where it stands often */
#ifndef GEOMETRY_H
#define GEOMETRY_H

#include "materials.h"
#include "transform.h"

#include "hydra.h"

/* Triangles in world space that share one hydra mesh, so that rays see one tree and not hundreds that overlap. */
typedef struct geometry_soup {
    float *positions, *normals, *uvs;
    uint32_t *indices;
    hydra_material *materials; /* one a triangle */
    size_t vertices, vertex_capacity, triangles, triangle_capacity;
    bool smooth;
} geometry_soup;

typedef struct geometry {
    hydra_scene *scene;
    const struct aiScene *source;
    const material_entry *materials; /* of the source, same order */
    hydra_mesh *meshes;              /* hydra's, for the source meshes that are instanced; id 0: not yet added */
    geometry_soup soups[2];          /* flat, smooth */
    uint64_t skipped_faces;          /* points and lines */
} geometry;

void geometry_init(geometry *g, hydra_scene *scene, const struct aiScene *source, const material_entry *materials);
void geometry_free(geometry *g);
/* Triangles of a source mesh. */
size_t geometry_triangles(const struct aiMesh *mesh);
/* False: hydra rejected something; the next commit says what. */
bool geometry_join(geometry *g, unsigned mesh, const transform *place);
bool geometry_instance(geometry *g, unsigned mesh, const transform *place);
/* Adds what was joined. */
bool geometry_finish(geometry *g);
/* NaN or infinity anywhere in the mesh. */
bool geometry_is_finite(const struct aiMesh *mesh);

#endif
