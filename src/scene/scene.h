/* >>scene: what a scene holds, and its life */
#ifndef HYI_SCENE_H
#define HYI_SCENE_H

#include "../../shaders/shared/views.h"
#include "../base/backend.h"
#include "../bvh/save.h"
#include "../bvh/trace.h"

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
