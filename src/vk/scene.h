/* >>vk-scene: a committed scene on the device */
#ifndef HYI_VK_SCENE_H
#define HYI_VK_SCENE_H

#include "submit.h"
#include "tree.h"

typedef struct hyi_vk_scene {
    hyi_vk_buffer buffers[HYK_SCENE_BINDINGS]; /* by binding */
    hyi_vk_set set;
    VkBufferView texels[HYI_VK_TEXEL_BUFFERS]; /* nodes and slots, where trace is trace_texels */
    hyi_vk_kernel trace;
    uint32_t depth, top_depth; /* see traverse.glsl */
    uint32_t shapes;           /* in the trees that stand there */
    hyk_tree *trees;           /* the host's copy */
    size_t tree_count;
} hyi_vk_scene;

/* ---- what is renewed when */

/* Bits HYI_DIRTY_ that change what a binding holds. Lights are made anew with anything but the environment. */
HYI_FN uint32_t hyi_vk_depends_on(uint32_t binding) {
    const uint32_t geometry = HYI_DIRTY_MESHES | HYI_DIRTY_PLACEMENT, but_environment = HYI_DIRTY_ALL & ~HYI_DIRTY_ENVIRONMENT;
    switch (binding) {
    case HYK_BINDING_CONSTANTS: return HYI_DIRTY_ALL;
    case HYK_BINDING_MATERIALS: case HYK_BINDING_TEXTURES: case HYK_BINDING_TEXELS: case HYK_BINDING_ENERGY_TABLES: return HYI_DIRTY_MATERIALS;
    case HYK_BINDING_POSITIONS: case HYK_BINDING_NORMALS: case HYK_BINDING_UVS: case HYK_BINDING_INDICES: case HYK_BINDING_TRIANGLE_MATERIALS:
    case HYK_BINDING_NODES: case HYK_BINDING_SLOTS: case HYK_BINDING_WORLD_FIRST: return geometry;
    case HYK_BINDING_ENVIRONMENT: case HYK_BINDING_ENVIRONMENT_CDF: return HYI_DIRTY_ENVIRONMENT;
    default: return but_environment; /* meshes, instances: their first light; light slots, lights, nodes; trees: which ask for alpha */
    }
}

/* ---- what is written */

/* The sizes of a scene's packed arrays. */
typedef struct hyi_vk_sizes {
    uint64_t vertices, normals, uvs, corners, triangle_materials, light_slots, texel_words, nodes, slots;
} hyi_vk_sizes;

HYI_FN void hyi_vk_measure_tree(hyi_vk_sizes *s, const hyi_bvh *bvh) {
    s->nodes += hyi_vk_nodes_of(bvh);
    s->slots += hyi_vk_slots_of(bvh);
}

HYI_FN hyi_vk_sizes hyi_vk_measure(const hydra_scene *scene) {
    hyi_vk_sizes s;
    memset(&s, 0, sizeof s);
    for (size_t i = 0; i < scene->view_mesh_count; i++) {
        const hyk_mesh *mesh = &scene->view_meshes[i];
        s.vertices += mesh->vertex_count;
        s.corners += (uint64_t)3 * mesh->triangle_count;
        if (mesh->flags & HYK_MESH_HAS_NORMALS) s.normals += mesh->vertex_count;
        if (mesh->flags & HYK_MESH_HAS_UVS) s.uvs += mesh->vertex_count;
        if (mesh->flags & HYK_MESH_TRIANGLE_MATERIALS) s.triangle_materials += mesh->triangle_count;
        if (mesh->flags & HYK_MESH_LIGHT_SLOTS) s.light_slots += mesh->triangle_count;
        hyi_vk_measure_tree(&s, &scene->view_bvhs[i]);
    }
    for (size_t i = 0; i < scene->texture_count; i++) s.texel_words += scene->textures[i].words;
    hyi_vk_measure_tree(&s, &scene->top);
    hyi_vk_measure_tree(&s, &scene->world);
    hyi_vk_measure_tree(&s, &scene->shapes);
    return s;
}

HYI_FN uint64_t hyi_vk_bytes_of(const hydra_scene *scene, const hyi_vk_sizes *s, uint32_t binding) {
    switch (binding) {
    case HYK_BINDING_CONSTANTS: return sizeof(hyk_scene_constants);
    case HYK_BINDING_MATERIALS: return scene->view_material_count * sizeof(hyk_material);
    case HYK_BINDING_TEXTURES: return scene->view_texture_count * sizeof(hyk_texture);
    case HYK_BINDING_TEXELS: return 4 * s->texel_words;
    case HYK_BINDING_MESHES: return scene->view_mesh_count * sizeof(hyk_mesh);
    case HYK_BINDING_POSITIONS: return 12 * s->vertices;
    case HYK_BINDING_NORMALS: return 12 * s->normals;
    case HYK_BINDING_UVS: return 8 * s->uvs;
    case HYK_BINDING_INDICES: return 4 * s->corners;
    case HYK_BINDING_TRIANGLE_MATERIALS: return 4 * s->triangle_materials;
    case HYK_BINDING_LIGHT_SLOTS: return 4 * s->light_slots;
    case HYK_BINDING_INSTANCES: return scene->placed_count * sizeof(hyk_instance);
    case HYK_BINDING_LIGHTS: return scene->all_light_count * sizeof(hyk_light);
    case HYK_BINDING_LIGHT_NODES: return scene->light_node_count * sizeof(hyk_light_node);
    case HYK_BINDING_ENVIRONMENT: return 4 * (uint64_t)hyi_environment_texel_count(scene);
    case HYK_BINDING_ENVIRONMENT_CDF: return 4 * (uint64_t)scene->environment_cdf_count;
    case HYK_BINDING_ENERGY_TABLES: return 4 * (uint64_t)scene->energy_table_count;
    case HYK_BINDING_TREES: return (HYK_TREE_MESHES + scene->view_mesh_count) * sizeof(hyk_tree);
    case HYK_BINDING_NODES: return 4 * HYK_NODE_WORDS * s->nodes;
    case HYK_BINDING_SLOTS: return sizeof(hyk_slot) * s->slots;
    default: return 4 * (uint64_t)scene->world_count;
    }
}

HYI_FN const char *hyi_vk_name_of(uint32_t binding) {
    static const char *const names[HYK_SCENE_BINDINGS] = {
        "constants", "materials", "textures", "texels", "meshes", "vertex positions", "vertex normals", "vertex uvs", "vertex indices", "triangles' materials",
        "triangles' lights", "instances", "lights", "light tree", "environment", "environment's weights", "energy tables", "trees", "nodes of trees",
        "triangles of trees", "meshes of the shared tree" };
    return names[binding];
}

/* Meshes with the places of their arrays in the packed ones. */
HYI_FN void hyi_vk_write_meshes(const hydra_scene *scene, hyk_mesh *to) {
    hyi_vk_sizes at;
    memset(&at, 0, sizeof at);
    for (size_t i = 0; i < scene->view_mesh_count; i++) {
        hyk_mesh mesh = scene->view_meshes[i];
        mesh.first_position = (uint32_t)at.vertices;
        mesh.first_normal = (uint32_t)at.normals;
        mesh.first_uv = (uint32_t)at.uvs;
        mesh.first_index = (uint32_t)at.corners;
        mesh.first_material = (uint32_t)at.triangle_materials;
        mesh.first_light_slot = (uint32_t)at.light_slots;
        at.vertices += mesh.vertex_count;
        at.corners += (uint64_t)3 * mesh.triangle_count;
        if (mesh.flags & HYK_MESH_HAS_NORMALS) at.normals += mesh.vertex_count;
        if (mesh.flags & HYK_MESH_HAS_UVS) at.uvs += mesh.vertex_count;
        if (mesh.flags & HYK_MESH_TRIANGLE_MATERIALS) at.triangle_materials += mesh.triangle_count;
        if (mesh.flags & HYK_MESH_LIGHT_SLOTS) at.light_slots += mesh.triangle_count;
        to[i] = mesh;
    }
}

HYI_FN void hyi_vk_write_textures(const hydra_scene *scene, hyk_texture *to) {
    size_t words = 0;
    for (size_t i = 0; i < scene->view_texture_count; i++) {
        hyk_texture texture = scene->view_textures[i];
        texture.first_word = (uint32_t)words;
        to[i] = texture;
        words += scene->textures[i].words;
    }
}

HYI_FN char *hyi_vk_append(char *to, const void *from, uint64_t bytes) {
    if (from && bytes) memcpy(to, from, (size_t)bytes);
    return from ? to + bytes : to;
}

/* One array of every mesh, or of every texture, one after the other. */
HYI_FN void hyi_vk_write_packed(const hydra_scene *scene, uint32_t binding, char *to) {
    for (size_t i = 0; binding == HYK_BINDING_TEXELS && i < scene->texture_count; i++)
        to = hyi_vk_append(to, scene->textures[i].texels, 4 * (uint64_t)scene->textures[i].words);
    for (size_t i = 0; binding != HYK_BINDING_TEXELS && i < scene->view_mesh_count; i++) {
        const hyk_mesh_arrays *arrays = &scene->view_arrays[i];
        uint64_t vertices = scene->view_meshes[i].vertex_count, triangles = scene->view_meshes[i].triangle_count;
        switch (binding) {
        case HYK_BINDING_POSITIONS: to = hyi_vk_append(to, arrays->positions, 12 * vertices); break;
        case HYK_BINDING_NORMALS: to = hyi_vk_append(to, arrays->normals, 12 * vertices); break;
        case HYK_BINDING_UVS: to = hyi_vk_append(to, arrays->uvs, 8 * vertices); break;
        case HYK_BINDING_INDICES: to = hyi_vk_append(to, arrays->indices, 12 * triangles); break;
        case HYK_BINDING_TRIANGLE_MATERIALS: to = hyi_vk_append(to, arrays->triangle_materials, 4 * triangles); break;
        default: to = hyi_vk_append(to, arrays->light_slots, 4 * triangles);
        }
    }
}

/* ---- trees */

HYI_FN bool hyi_vk_asks_alpha(const hyi_accel *accel, uint32_t mesh) { return accel->mesh_has_alpha && accel->mesh_has_alpha[mesh]; }

/* Where no level is above, rays begin in the world's tree, or in that of the one mesh, which is then planted as the world. */
HYI_FN bool hyi_vk_one_mesh_is_all(const hydra_scene *scene) {
    return !scene->accel.world && scene->accel.single && scene->placed_count != 0;
}

HYI_FN void hyi_vk_plant_all(const hydra_scene *scene, hyk_tree *trees, hyi_vk_forest *forest) {
    trees[HYK_TREE_SHAPES] = hyi_vk_plant(&scene->shapes, forest);
    for (uint32_t i = 0; i < forest->slot_count; i++) forest->slots[i].item = scene->shape_lights[forest->slots[i].item];
    trees[HYK_TREE_TOP] = hyi_vk_plant(&scene->top, forest);
    trees[HYK_TREE_WORLD] = hyi_vk_plant(&scene->world, forest);
    for (size_t i = 0; i < scene->view_mesh_count; i++) trees[HYK_TREE_MESHES + i] = hyi_vk_plant(&scene->view_bvhs[i], forest);
    if (hyi_vk_one_mesh_is_all(scene)) trees[HYK_TREE_WORLD] = trees[HYK_TREE_MESHES + scene->placed[0].mesh];
}

HYI_FN void hyi_vk_mark_trees(const hydra_scene *scene, hyk_tree *trees) {
    const hyi_accel *accel = &scene->accel;
    for (size_t i = 0; i < scene->view_mesh_count; i++) trees[HYK_TREE_MESHES + i].asks_alpha = hyi_vk_asks_alpha(accel, (uint32_t)i);
    trees[HYK_TREE_WORLD].asks_alpha = hyi_vk_one_mesh_is_all(scene) ? hyi_vk_asks_alpha(accel, scene->placed[0].mesh) : accel->world_has_alpha;
    trees[HYK_TREE_WORLD].meshes = accel->world ? accel->world_count : 0;
}

/* Rounded up, so that scenes of like depth share their pipelines. */
HYI_FN uint32_t hyi_vk_stack_for(uint32_t levels) { return levels ? (levels + 3u) / 4u * 4u : 4u; }

HYI_FN void hyi_vk_measure_depths(const hydra_scene *scene, hyi_vk_scene *s) {
    uint32_t levels = scene->world.depth > scene->shapes.depth ? scene->world.depth : scene->shapes.depth;
    for (size_t i = 0; i < scene->view_mesh_count; i++)
        if (scene->view_bvhs[i].depth > levels) levels = scene->view_bvhs[i].depth;
    s->depth = hyi_vk_stack_for(levels);
    s->top_depth = hyi_vk_stack_for(scene->top.depth);
}

/* ---- renewing */

/* A commit at work: where each renewed binding is written. */
typedef struct hyi_vk_renewal {
    hyi_vk *vk;
    const hydra_scene *scene;
    hyi_vk_scene *on_device;
    hyi_vk_sizes sizes;
    uint32_t renewed; /* bits by binding */
    hyi_vk_buffer stages[HYK_SCENE_BINDINGS]; /* where the host does not see the device's memory */
    void *to[HYK_SCENE_BINDINGS];
} hyi_vk_renewal;

HYI_FN uint32_t hyi_vk_choose_renewed(const hydra_scene *scene, const hyi_vk_scene *s, uint32_t dirty) {
    uint32_t renewed = 0;
    bool shapes = (dirty & ~HYI_DIRTY_ENVIRONMENT) && (scene->shape_count || s->shapes);
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++)
        if (!s->buffers[b].buffer || (dirty & hyi_vk_depends_on(b))) renewed |= 1u << b;
    if (shapes) renewed |= 1u << HYK_BINDING_NODES | 1u << HYK_BINDING_SLOTS;
    const uint32_t planted = 1u << HYK_BINDING_NODES | 1u << HYK_BINDING_SLOTS;
    if (renewed & planted) renewed |= planted | 1u << HYK_BINDING_TREES;
    return renewed;
}

HYI_FN hydra_result hyi_vk_make_room(hyi_vk_renewal *r) {
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++) {
        hyi_vk_buffer *buffer = &r->on_device->buffers[b];
        if (!(r->renewed >> b & 1u)) continue;
        uint64_t bytes = hyi_vk_bytes_of(r->scene, &r->sizes, b);
        hyi_vk_free_buffer(r->vk, buffer);
        HYI_TRY(hyi_vk_make_buffer(r->vk, buffer, HYI_VK_DEVICE, bytes, hyi_vk_name_of(b)));
        if (!buffer->mapped) HYI_TRY(hyi_vk_make_buffer(r->vk, &r->stages[b], HYI_VK_UPLOAD, bytes, hyi_vk_name_of(b)));
        r->to[b] = buffer->mapped ? buffer->mapped : r->stages[b].mapped;
    }
    return HYDRA_OK;
}

HYI_FN void hyi_vk_write_binding(hyi_vk_renewal *r, uint32_t b) {
    const hydra_scene *scene = r->scene;
    uint64_t bytes = hyi_vk_bytes_of(scene, &r->sizes, b);
    switch (b) {
    case HYK_BINDING_CONSTANTS: hyi_vk_append((char *)r->to[b], &scene->view.constants, bytes); break;
    case HYK_BINDING_MATERIALS: hyi_vk_append((char *)r->to[b], scene->view_materials, bytes); break;
    case HYK_BINDING_TEXTURES: hyi_vk_write_textures(scene, (hyk_texture *)r->to[b]); break;
    case HYK_BINDING_MESHES: hyi_vk_write_meshes(scene, (hyk_mesh *)r->to[b]); break;
    case HYK_BINDING_INSTANCES: hyi_vk_append((char *)r->to[b], scene->placed, bytes); break;
    case HYK_BINDING_LIGHTS: hyi_vk_append((char *)r->to[b], scene->all_lights, bytes); break;
    case HYK_BINDING_LIGHT_NODES: hyi_vk_append((char *)r->to[b], scene->light_nodes, bytes); break;
    case HYK_BINDING_ENVIRONMENT: hyi_vk_append((char *)r->to[b], scene->environment_texels, bytes); break;
    case HYK_BINDING_ENVIRONMENT_CDF: hyi_vk_append((char *)r->to[b], scene->environment_cdf, bytes); break;
    case HYK_BINDING_ENERGY_TABLES: hyi_vk_append((char *)r->to[b], scene->energy_tables, bytes); break;
    case HYK_BINDING_TREES: hyi_vk_append((char *)r->to[b], r->on_device->trees, bytes); break;
    case HYK_BINDING_WORLD_FIRST: hyi_vk_append((char *)r->to[b], scene->world_first, bytes); break;
    case HYK_BINDING_NODES: case HYK_BINDING_SLOTS: break; /* planted */
    default: hyi_vk_write_packed(scene, b, (char *)r->to[b]);
    }
}

HYI_FN hydra_result hyi_vk_write_all(hyi_vk_renewal *r) {
    hyi_vk_scene *s = r->on_device;
    hyi_vk_forest forest;
    memset(&forest, 0, sizeof forest);
    forest.nodes = (uint32_t *)r->to[HYK_BINDING_NODES];
    forest.slots = (hyk_slot *)r->to[HYK_BINDING_SLOTS];
    if (r->renewed >> HYK_BINDING_NODES & 1u) {
        size_t count = HYK_TREE_MESHES + r->scene->view_mesh_count;
        hyi_free_array(r->vk->context, &s->trees, s->tree_count);
        s->tree_count = 0;
        HYI_TRY(hyi_alloc_array(r->vk->context, &s->trees, count));
        s->tree_count = count;
        hyi_vk_plant_all(r->scene, s->trees, &forest);
        hyi_vk_measure_depths(r->scene, s);
        s->shapes = r->scene->shape_count;
    }
    hyi_vk_mark_trees(r->scene, s->trees);
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++)
        if (r->renewed >> b & 1u) hyi_vk_write_binding(r, b);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_send_stages(hyi_vk_renewal *r, hyi_vk_commands *c) {
    double seconds;
    HYI_TRY(hyi_vk_make_commands(r->vk, c));
    HYI_TRY(hyi_vk_begin(r->vk, c));
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++) {
        if (r->stages[b].buffer) hyi_vk_copy(r->vk, c, &r->stages[b], &r->on_device->buffers[b], r->stages[b].size);
    }
    hyi_vk_barrier(r->vk, c);
    HYI_TRY(hyi_vk_submit(r->vk, c));
    return hyi_vk_wait(r->vk, c, &seconds);
}

HYI_FN void hyi_vk_free_texels(hyi_vk *vk, hyi_vk_scene *s) {
    for (uint32_t i = 0; i < HYI_VK_TEXEL_BUFFERS; i++) {
        if (s->texels[i]) vk->f.DestroyBufferView(vk->device, s->texels[i], vk->desc.allocation);
        s->texels[i] = VK_NULL_HANDLE;
    }
}

HYI_FN hydra_result hyi_vk_make_texels(hyi_vk *vk, hyi_vk_scene *s, uint32_t i, VkFormat format) {
    VkBufferViewCreateInfo info;
    memset(&info, 0, sizeof info);
    info.sType = VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO;
    info.buffer = s->buffers[HYK_BINDING_NODES + i].buffer;
    info.format = format;
    info.range = VK_WHOLE_SIZE;
    HYI_VK_MAKE(vk, "vkCreateBufferView", CreateBufferView(vk->device, &info, vk->desc.allocation, &s->texels[i]), s->texels[i]);
    hyi_vk_write_texels(vk, &s->set, HYK_BINDING_NODE_TEXELS + i, s->texels[i]);
    return HYDRA_OK;
}

/* Processors that pose as devices fetch texels faster than words (trace_texels.comp). */
HYI_FN hydra_result hyi_vk_choose_trace(hyi_vk *vk, hyi_vk_scene *s) {
    VkDeviceSize most = (VkDeviceSize)vk->limits.maxTexelBufferElements * HYI_VK_TEXEL;
    bool fits = s->buffers[HYK_BINDING_NODES].size <= most && s->buffers[HYK_BINDING_SLOTS].size <= most;
    s->trace = vk->type == HYDRA_VK_DEVICE_CPU && fits ? HYI_VK_KERNEL_trace_texels : HYI_VK_KERNEL_trace;
    if (s->trace == HYI_VK_KERNEL_trace) return HYDRA_OK;
    HYI_TRY(hyi_vk_make_texels(vk, s, 0, VK_FORMAT_R32G32B32A32_UINT));
    return hyi_vk_make_texels(vk, s, 1, VK_FORMAT_R32G32B32A32_SFLOAT);
}

HYI_FN hydra_result hyi_vk_renew(hyi_vk_renewal *r) {
    hyi_vk_commands commands;
    bool staged = false;
    hyi_vk_free_texels(r->vk, r->on_device);
    HYI_TRY(hyi_vk_make_room(r));
    HYI_TRY(hyi_vk_write_all(r));
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++) staged = staged || r->stages[b].buffer;
    memset(&commands, 0, sizeof commands);
    hydra_result result = staged ? hyi_vk_send_stages(r, &commands) : HYDRA_OK;
    hyi_vk_free_commands(r->vk, &commands);
    HYI_TRY(result);
    if (!r->on_device->set.set) HYI_TRY(hyi_vk_make_set(r->vk, r->vk->scene_layout, HYK_SCENE_BINDINGS, HYI_VK_TEXEL_BUFFERS, &r->on_device->set));
    hyi_vk_write_set(r->vk, &r->on_device->set, r->on_device->buffers, HYK_SCENE_BINDINGS);
    return hyi_vk_choose_trace(r->vk, r->on_device);
}

/* What a kernel that casts rays in the scene is made for. */
HYI_FN hyi_vk_shape hyi_vk_trace_shape(const hydra_scene *scene, uint32_t mode) {
    const hyi_vk_scene *s = (const hyi_vk_scene *)scene->device;
    hyi_vk_shape shape;
    memset(&shape, 0, sizeof shape);
    shape.features = scene->view.constants.features & (HYK_NEEDS_ALPHA | HYK_NEEDS_INSTANCES | HYK_NEEDS_SHAPES);
    shape.depth = s->depth;
    shape.top_depth = s->top_depth;
    shape.mode = mode;
    return shape;
}

/* ---- what the backend is asked for */

HYI_FN void hyi_vk_forget_scene(hydra_scene *scene) {
    hyi_vk *vk = (hyi_vk *)scene->context->device;
    hyi_vk_scene *s = (hyi_vk_scene *)scene->device;
    if (!s) return;
    hyi_vk_free_set(vk, &s->set);
    hyi_vk_free_texels(vk, s);
    for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++) hyi_vk_free_buffer(vk, &s->buffers[b]);
    hyi_free_array(vk->context, &s->trees, s->tree_count);
    hyi_free_array(vk->context, &s, 1);
    scene->device = NULL;
}

/* After a failure nothing is left on the device, and the next commit writes it all. */
HYI_FN hydra_result hyi_vk_commit(hydra_scene *scene, uint32_t dirty) {
    hyi_vk_renewal *r;
    hyi_vk_scene *s;
    HYI_TRY(hyi_vk_check_lost((hyi_vk *)scene->context->device));
    HYI_TRY(hyi_alloc_array(scene->context, &r, 1));
    memset(r, 0, sizeof *r);
    hydra_result result = HYDRA_OK;
    if (!scene->device) {
        result = hyi_alloc_array(scene->context, &s, 1);
        if (result == HYDRA_OK) memset(s, 0, sizeof *s);
        scene->device = result == HYDRA_OK ? s : NULL;
    }
    if (result == HYDRA_OK) {
        r->vk = (hyi_vk *)scene->context->device;
        r->scene = scene;
        r->on_device = (hyi_vk_scene *)scene->device;
        r->sizes = hyi_vk_measure(scene);
        r->renewed = hyi_vk_choose_renewed(scene, r->on_device, dirty);
        result = hyi_vk_renew(r);
        for (uint32_t b = 0; b < HYK_SCENE_BINDINGS; b++) hyi_vk_free_buffer(r->vk, &r->stages[b]);
        if (result != HYDRA_OK) hyi_vk_forget_scene(scene);
    }
    hyi_free_array(scene->context, &r, 1);
    return result;
}

#endif /* HYI_VK_SCENE_H */
