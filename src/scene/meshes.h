/* >>scene-meshes: copies of the caller's geometry, and where it is placed */
#ifndef HYI_MESHES_H
#define HYI_MESHES_H

#include "scene.h"
#include "validate.h"

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
