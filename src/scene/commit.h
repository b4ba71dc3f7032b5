/* >>scene-commit: from what the caller gave to what rays and kernels read, renewing only what changed */
#ifndef HYI_COMMIT_H
#define HYI_COMMIT_H

#include "energy_tables.h"
#include "lights.h"
#include "materials.h"
#include "textures.h"
#include "trees.h"

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
    accel->placed_ids = scene->placed_ids;
    accel->light_ids = scene->light_ids;
    accel->instances = &scene->top;
    accel->single = hyi_is_single(scene);
    accel->empty = scene->placed_count == 0;
    accel->shapes = scene->shape_count ? &scene->shapes : NULL;
    accel->shape_lights = scene->shape_lights;
    accel->isa = scene->context->isa;
    if (accel->single && !accel->empty) accel->vicinity = hyi_vicinity_of(hyi_first_site(accel).bvh);
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
