/* geometry.c: see geometry.h */
#include "geometry.h"

#include "app.h"

#include <stdlib.h>
#include <string.h>

/* One index below 2^32 stays free for every vertex of the largest mesh that assimp makes. */
static const size_t soup_limit = (size_t)1 << 30;

void geometry_init(geometry *g, hydra_scene *scene, const struct aiScene *source, const material_entry *materials) {
    memset(g, 0, sizeof *g);
    g->scene = scene;
    g->source = source;
    g->materials = materials;
    g->soups[1].smooth = true;
    g->meshes = app_alloc(source->mNumMeshes, sizeof *g->meshes);
    for (unsigned i = 0; i < source->mNumMeshes; i++) g->meshes[i].id = 0;
}

static void free_soup(geometry_soup *soup) {
    free(soup->positions);
    free(soup->normals);
    free(soup->uvs);
    free(soup->indices);
    free(soup->materials);
    bool smooth = soup->smooth;
    memset(soup, 0, sizeof *soup);
    soup->smooth = smooth;
}

void geometry_free(geometry *g) {
    free_soup(&g->soups[0]);
    free_soup(&g->soups[1]);
    free(g->meshes);
}

size_t geometry_triangles(const struct aiMesh *mesh) {
    size_t count = 0;
    for (unsigned i = 0; i < mesh->mNumFaces; i++) count += mesh->mFaces[i].mNumIndices == 3;
    return count;
}

static bool all_finite(const struct aiVector3D *vectors, unsigned count, int components) {
    if (vectors == NULL) return true;
    for (unsigned i = 0; i < count; i++) {
        bool good = isfinite(vectors[i].x) && isfinite(vectors[i].y) && (components < 3 || isfinite(vectors[i].z));
        if (!good) return false;
    }
    return true;
}

bool geometry_is_finite(const struct aiMesh *mesh) {
    if (!all_finite(mesh->mVertices, mesh->mNumVertices, 3) || !all_finite(mesh->mNormals, mesh->mNumVertices, 3)) return false;
    for (int set = 0; set < AI_MAX_NUMBER_OF_TEXTURECOORDS; set++)
        if (!all_finite(mesh->mTextureCoords[set], mesh->mNumVertices, 2)) return false;
    return true;
}

/* ---------------------------------------------------------------- parts of a mesh */

static const material_entry *material_of(const geometry *g, const struct aiMesh *mesh) { return &g->materials[mesh->mMaterialIndex]; }

/* assimp counts v from the bottom whatever the file does; hydra and glTF from the top. */
static void copy_uvs(const geometry *g, const struct aiMesh *mesh, float *uvs) {
    const material_entry *material = material_of(g, mesh);
    uint32_t set = material->uv_set < AI_MAX_NUMBER_OF_TEXTURECOORDS ? material->uv_set : 0;
    const struct aiVector3D *source = mesh->mTextureCoords[set] != NULL ? mesh->mTextureCoords[set] : mesh->mTextureCoords[0];
    const float *m = material->uv_transform;
    for (unsigned i = 0; i < mesh->mNumVertices; i++) {
        float u = source != NULL ? source[i].x : 0.0f, v = source != NULL ? 1.0f - source[i].y : 0.0f;
        uvs[2 * i] = m[0] * u + m[1] * v + m[2];
        uvs[2 * i + 1] = m[3] * u + m[4] * v + m[5];
    }
}

static size_t copy_indices(const struct aiMesh *mesh, uint32_t *indices, uint32_t base, bool swap) {
    size_t used = 0;
    for (unsigned i = 0; i < mesh->mNumFaces; i++) {
        const struct aiFace *face = &mesh->mFaces[i];
        if (face->mNumIndices != 3) continue;
        indices[used++] = base + face->mIndices[0];
        indices[used++] = base + face->mIndices[swap ? 2 : 1];
        indices[used++] = base + face->mIndices[swap ? 1 : 2];
    }
    return used / 3;
}

static hydra_view view_of(const void *data, size_t stride, size_t count) {
    hydra_view view = {data, stride, count};
    return view;
}

/* ---------------------------------------------------------------- joined meshes */

static void grow(geometry_soup *soup, size_t vertices, size_t triangles) {
    if (vertices > soup->vertex_capacity) {
        soup->vertex_capacity = vertices > 2 * soup->vertex_capacity ? vertices : 2 * soup->vertex_capacity;
        soup->positions = app_realloc(soup->positions, soup->vertex_capacity, 3 * sizeof(float));
        soup->uvs = app_realloc(soup->uvs, soup->vertex_capacity, 2 * sizeof(float));
        if (soup->smooth) soup->normals = app_realloc(soup->normals, soup->vertex_capacity, 3 * sizeof(float));
    }
    if (triangles > soup->triangle_capacity) {
        soup->triangle_capacity = triangles > 2 * soup->triangle_capacity ? triangles : 2 * soup->triangle_capacity;
        soup->indices = app_realloc(soup->indices, soup->triangle_capacity, 3 * sizeof(uint32_t));
        soup->materials = app_realloc(soup->materials, soup->triangle_capacity, sizeof(hydra_material));
    }
}

static bool add_soup(geometry *g, geometry_soup *soup) {
    if (soup->triangles == 0) return true;
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions = view_of(soup->positions, 0, soup->vertices);
    if (soup->smooth) desc.normals = view_of(soup->normals, 0, soup->vertices);
    desc.uvs = view_of(soup->uvs, 0, soup->vertices);
    desc.indices = view_of(soup->indices, 4, 3 * soup->triangles);
    desc.triangle_materials = view_of(soup->materials, 0, soup->triangles);
    hydra_mesh mesh = hydra_scene_add_mesh(g->scene, &desc);
    free_soup(soup);
    return mesh.id != 0;
}

static void append_vertices(geometry_soup *soup, const struct aiMesh *mesh, const transform *place) {
    double cofactors[9];
    transform_cofactors(place, cofactors);
    double side = transform_determinant(place) < 0.0 ? -1.0 : 1.0;
    for (unsigned i = 0; i < mesh->mNumVertices; i++) {
        double p[3] = {mesh->mVertices[i].x, mesh->mVertices[i].y, mesh->mVertices[i].z}, out[3];
        transform_point(place, p, out);
        float *position = soup->positions + 3 * (soup->vertices + i);
        for (int k = 0; k < 3; k++) position[k] = (float)out[k];
        if (!soup->smooth) continue;
        double n[3] = {mesh->mNormals[i].x, mesh->mNormals[i].y, mesh->mNormals[i].z};
        for (int k = 0; k < 3; k++) out[k] = side * (cofactors[3 * k] * n[0] + cofactors[3 * k + 1] * n[1] + cofactors[3 * k + 2] * n[2]);
        vector_normalize(out);
        float *normal = soup->normals + 3 * (soup->vertices + i);
        for (int k = 0; k < 3; k++) normal[k] = (float)out[k];
    }
}

bool geometry_join(geometry *g, unsigned index, const transform *place) {
    const struct aiMesh *mesh = g->source->mMeshes[index];
    geometry_soup *soup = &g->soups[mesh->mNormals != NULL];
    size_t triangles = geometry_triangles(mesh);
    g->skipped_faces += mesh->mNumFaces - triangles;
    if (triangles == 0) return true;
    if (soup->vertices + mesh->mNumVertices > soup_limit && !add_soup(g, soup)) return false;
    grow(soup, soup->vertices + mesh->mNumVertices, soup->triangles + triangles);
    append_vertices(soup, mesh, place);
    copy_uvs(g, mesh, soup->uvs + 2 * soup->vertices);
    /* A mirrored mesh keeps its front faces in front. */
    bool swap = transform_determinant(place) < 0.0;
    copy_indices(mesh, soup->indices + 3 * soup->triangles, (uint32_t)soup->vertices, swap);
    for (size_t i = 0; i < triangles; i++) soup->materials[soup->triangles + i] = material_of(g, mesh)->material;
    soup->vertices += mesh->mNumVertices;
    soup->triangles += triangles;
    return true;
}

bool geometry_finish(geometry *g) { return add_soup(g, &g->soups[0]) && add_soup(g, &g->soups[1]); }

/* ---------------------------------------------------------------- instances */

static bool add_mesh(geometry *g, unsigned index) {
    const struct aiMesh *mesh = g->source->mMeshes[index];
    size_t triangles = geometry_triangles(mesh);
    float *uvs = app_alloc(mesh->mNumVertices, 2 * sizeof(float));
    uint32_t *indices = app_alloc(triangles, 3 * sizeof(uint32_t));
    copy_uvs(g, mesh, uvs);
    copy_indices(mesh, indices, 0, false);
    hydra_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.positions = view_of(mesh->mVertices, sizeof(struct aiVector3D), mesh->mNumVertices);
    if (mesh->mNormals != NULL) desc.normals = view_of(mesh->mNormals, sizeof(struct aiVector3D), mesh->mNumVertices);
    desc.uvs = view_of(uvs, 0, mesh->mNumVertices);
    desc.indices = view_of(indices, 4, 3 * triangles);
    desc.material = material_of(g, mesh)->material;
    desc.instanced_only = true;
    g->meshes[index] = hydra_scene_add_mesh(g->scene, &desc);
    free(uvs);
    free(indices);
    return g->meshes[index].id != 0;
}

bool geometry_instance(geometry *g, unsigned index, const transform *place) {
    const struct aiMesh *mesh = g->source->mMeshes[index];
    size_t triangles = geometry_triangles(mesh);
    if (g->meshes[index].id == 0) g->skipped_faces += mesh->mNumFaces - triangles;
    if (triangles == 0) return true;
    if (g->meshes[index].id == 0 && !add_mesh(g, index)) return false;
    hydra_instance_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.mesh = g->meshes[index];
    for (int i = 0; i < 12; i++) desc.transform[i] = (float)place->m[i];
    return hydra_scene_add_instance(g->scene, &desc).id != 0;
}
