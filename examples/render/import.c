/* import.c: see import.h. Reading is assimp's work; what comes from it is checked before anything relies on it. */
#include "import.h"

#include "app.h"
#include "geometry.h"
#include "guard.h"

#include <assimp/cimport.h>
#include <assimp/commonMetaData.h>
#include <assimp/postprocess.h>

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { DEPTH_LIMIT = 4096 };

typedef struct importer {
    const char *path;
    hydra_context *context;
    hydra_scene *scene;
    const struct aiScene *source;
    bool is_gltf, keep_meshes;
    gltf_extras extras;
    texture_cache textures;
    material_entry *materials;
    size_t *uses; /* how often each mesh stands in the scene */
    geometry shapes;
    imported *result;
} importer;

int import_exit_code(hydra_result result) {
    switch (result) {
    case HYDRA_ERROR_OUT_OF_MEMORY:
    case HYDRA_ERROR_MEMORY_CAP:
    case HYDRA_ERROR_THREADS:
    case HYDRA_ERROR_ISA: return APP_DEVICE;
    default: return APP_INPUT;
    }
}

/* hydra refused something that was added: the commit hands out the reason. */
static int rejected(const importer *in, const char *what, const char *name) {
    hydra_result result = hydra_scene_commit(in->scene);
    app_error("%s: %s %s: %s", in->path, what, name, hydra_error_text(in->context));
    return import_exit_code(result);
}

static int damaged(const importer *in, const char *what) {
    app_error("%s: %s; the file is damaged", in->path, what);
    return APP_INPUT;
}

/* ---------------------------------------------------------------- reading and checking */

static bool format_is_gltf(const struct aiScene *source) {
    const struct aiMetadata *data = source->mMetaData;
    for (unsigned i = 0; data != NULL && i < data->mNumProperties; i++) {
        if (strcmp(data->mKeys[i].data, AI_METADATA_SOURCE_FORMAT) != 0 || data->mValues[i].mType != AI_AISTRING) continue;
        return strstr(((const struct aiString *)data->mValues[i].mData)->data, "glTF2") != NULL;
    }
    return false;
}

static bool mesh_is_sound(const struct aiMesh *mesh, unsigned materials) {
    if (mesh->mNumVertices > 0 && mesh->mVertices == NULL) return false;
    if (mesh->mNumFaces > 0 && mesh->mFaces == NULL) return false;
    if (mesh->mMaterialIndex >= materials) return false;
    for (unsigned i = 0; i < mesh->mNumFaces; i++) {
        const struct aiFace *face = &mesh->mFaces[i];
        if (face->mNumIndices > 0 && face->mIndices == NULL) return false;
        for (unsigned k = 0; k < face->mNumIndices; k++)
            if (face->mIndices[k] >= mesh->mNumVertices) return false;
    }
    return true;
}

static bool node_is_sound(const struct aiNode *node, unsigned meshes, int depth) {
    if (node == NULL || depth >= DEPTH_LIMIT) return false;
    for (unsigned i = 0; i < node->mNumMeshes; i++)
        if (node->mMeshes[i] >= meshes) return false;
    for (unsigned i = 0; i < node->mNumChildren; i++)
        if (!node_is_sound(node->mChildren[i], meshes, depth + 1)) return false;
    return true;
}

static int check_source(const importer *in) {
    const struct aiScene *source = in->source;
    if (!node_is_sound(source->mRootNode, source->mNumMeshes, 0))
        return damaged(in, "its nodes are nested too deeply or name meshes that are not there");
    for (unsigned i = 0; i < source->mNumMeshes; i++)
        if (!mesh_is_sound(source->mMeshes[i], source->mNumMaterials))
            return damaged(in, "a mesh has indices outside its vertices, or a material that is not there");
    return APP_DONE;
}

static int read_source(importer *in) {
    if (access(in->path, R_OK) != 0) {
        app_error("%s: cannot be opened: %s", in->path, strerror(errno));
        return APP_INPUT;
    }
    guard_begin(in->path);
    in->source = aiImportFile(in->path, 0);
    guard_end();
    if (in->source == NULL) {
        app_error("%s: cannot be imported: %s", in->path, aiGetErrorString());
        return APP_INPUT;
    }
    if (in->source->mRootNode == NULL) return damaged(in, "it holds no scene");
    in->is_gltf = format_is_gltf(in->source);
    return check_source(in);
}

/* Polygons become triangles. Transforms of uv are applied here for every format but glTF, whose own we read. */
static int prepare_source(importer *in) {
    unsigned steps = aiProcess_Triangulate;
    if (!in->is_gltf) steps |= aiProcess_TransformUVCoords;
    guard_begin(in->path);
    in->source = aiApplyPostProcessing(in->source, steps);
    guard_end();
    if (in->source == NULL) {
        app_error("%s: cannot be triangulated: %s", in->path, aiGetErrorString());
        return APP_INPUT;
    }
    if (in->is_gltf && !gltf_extras_read(&in->extras, in->path)) return APP_INPUT;
    return check_source(in);
}

/* ---------------------------------------------------------------- adding */

/* Only what a mesh in use wants: hydra's kernels are chosen by what the scene holds. */
static int add_materials(importer *in) {
    const struct aiScene *source = in->source;
    in->textures.scene = in->scene;
    in->textures.source = source;
    in->textures.scene_path = in->path;
    for (unsigned i = 0; i < source->mNumMeshes; i++) {
        unsigned index = source->mMeshes[i]->mMaterialIndex;
        if (in->uses[i] == 0 || geometry_triangles(source->mMeshes[i]) == 0 || in->materials[index].material.id != 0) continue;
        const gltf_material *extras = index < in->extras.material_count ? &in->extras.materials[index] : NULL;
        const struct aiMaterial *material = source->mMaterials[index];
        in->materials[index] = materials_add(&in->textures, material, in->is_gltf, extras);
        struct aiString name;
        bool named = aiGetMaterialString(material, AI_MATKEY_NAME, &name) == aiReturn_SUCCESS;
        if (in->materials[index].material.id == 0) return rejected(in, "material", named ? name.data : "(unnamed)");
        in->result->lights += in->materials[index].emits;
    }
    return APP_DONE;
}

typedef int (*placer)(importer *in, unsigned mesh, const transform *place);

static const gltf_placement *placement_of(const importer *in, const struct aiNode *node) {
    for (size_t i = 0; i < in->extras.placement_count; i++)
        if (strcmp(in->extras.placements[i].name, node->mName.data) == 0) return &in->extras.placements[i];
    return NULL;
}

static int place_node(importer *in, const struct aiNode *node, const transform *world, placer place) {
    const gltf_placement *placement = placement_of(in, node);
    size_t copies = placement != NULL ? placement->count : 1;
    for (size_t copy = 0; copy < copies; copy++) {
        transform here = *world;
        if (placement != NULL) {
            transform own = transform_from_floats(placement->transforms[copy]);
            here = transform_multiply(world, &own);
        }
        for (unsigned i = 0; i < node->mNumMeshes; i++) {
            int code = place(in, node->mMeshes[i], &here);
            if (code != APP_DONE) return code;
        }
    }
    return APP_DONE;
}

static int walk(importer *in, const struct aiNode *node, const transform *parent, placer place) {
    transform own = transform_from_assimp(&node->mTransformation);
    transform world = parent != NULL ? transform_multiply(parent, &own) : own;
    int code = place_node(in, node, &world, place);
    for (unsigned i = 0; i < node->mNumChildren && code == APP_DONE; i++) code = walk(in, node->mChildren[i], &world, place);
    return code;
}

static int count_use(importer *in, unsigned mesh, const transform *place) {
    (void)place;
    in->uses[mesh]++;
    return APP_DONE;
}

static int place_mesh(importer *in, unsigned index, const transform *place) {
    const struct aiMesh *mesh = in->source->mMeshes[index];
    bool finite = geometry_is_finite(mesh);
    for (int i = 0; i < 12; i++) finite = finite && isfinite(place->m[i]);
    /* What is not finite goes in alone, so that hydra's message counts within this mesh. */
    bool join = in->uses[index] == 1 && !in->keep_meshes && finite;
    bool good = join ? geometry_join(&in->shapes, index, place) : geometry_instance(&in->shapes, index, place);
    in->result->instances += !join;
    if (mesh->mNumBones > 0) app_warning("mesh %s: skinning is ignored: it stands in its rest pose", mesh->mName.data);
    if (mesh->mColors[0] != NULL) app_warning("mesh %s: vertex colours are ignored", mesh->mName.data);
    return good ? APP_DONE : rejected(in, "mesh", mesh->mName.length > 0 ? mesh->mName.data : "(unnamed)");
}

static int add_shapes(importer *in) {
    geometry_init(&in->shapes, in->scene, in->source, in->materials);
    int code = walk(in, in->source->mRootNode, NULL, place_mesh);
    if (code == APP_DONE && !geometry_finish(&in->shapes)) code = rejected(in, "meshes", "joined in world space");
    if (in->shapes.skipped_faces > 0)
        app_warning("%s: %llu points and lines are not rendered", in->path, (unsigned long long)in->shapes.skipped_faces);
    return code;
}

/* Counts how often each mesh stands in the scene, then adds what is used. */
static int add_all(importer *in) {
    in->uses = app_alloc(in->source->mNumMeshes, sizeof *in->uses);
    in->materials = app_alloc(in->source->mNumMaterials, sizeof *in->materials);
    for (unsigned i = 0; i < in->source->mNumMeshes; i++) in->uses[i] = 0;
    memset(in->materials, 0, in->source->mNumMaterials * sizeof *in->materials);
    int code = walk(in, in->source->mRootNode, NULL, count_use);
    if (code == APP_DONE) code = add_materials(in);
    if (code == APP_DONE) code = add_shapes(in);
    return code;
}

static int add_lights(importer *in) {
    imported *result = in->result;
    size_t lamps = 0;
    if (!scene_lights_add(in->scene, in->source, in->is_gltf, &lamps, result->ambient)) return rejected(in, "a", "light");
    result->lights += lamps;
    result->cameras = scene_cameras_read(in->source, &in->extras);
    result->camera_count = in->source->mNumCameras;
    return APP_DONE;
}

static int import_all(importer *in) {
    int code = read_source(in);
    if (code == APP_DONE) code = prepare_source(in);
    if (code == APP_DONE) code = add_all(in);
    if (code == APP_DONE) code = add_lights(in);
    return code;
}

int import_scene(imported *result, hydra_context *context, hydra_scene *scene, const char *path, bool keep_meshes) {
    importer in;
    memset(&in, 0, sizeof in);
    memset(result, 0, sizeof *result);
    in.path = path;
    in.context = context;
    in.scene = scene;
    in.keep_meshes = keep_meshes;
    in.result = result;
    int code = import_all(&in);
    geometry_free(&in.shapes);
    textures_free(&in.textures);
    gltf_extras_free(&in.extras);
    free(in.materials);
    free(in.uses);
    aiReleaseImport(in.source);
    app_flush_warnings();
    return code;
}

void import_free(imported *result) {
    for (size_t i = 0; i < result->camera_count; i++) free(result->cameras[i].name);
    free(result->cameras);
    memset(result, 0, sizeof *result);
}
