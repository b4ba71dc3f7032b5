/* >>scene-lights: light descriptors, the environment, and the list of all emitters of a committed scene */
#ifndef HYI_LIGHTS_H
#define HYI_LIGHTS_H

#include "../../shaders/shared/alpha.h"
#include "environment.h"
#include "light_tree.h"
#include "materials.h"
#include "meshes.h"
#include "scene.h"
#include "validate.h"

HYI_STATIC_ASSERT((int)HYK_LIGHT_RECT == (int)HYDRA_LIGHT_RECT && (int)HYK_LIGHT_DISC == (int)HYDRA_LIGHT_DISC &&
                  (int)HYK_LIGHT_SPHERE == (int)HYDRA_LIGHT_SPHERE && (int)HYK_LIGHT_POINT == (int)HYDRA_LIGHT_POINT &&
                  (int)HYK_LIGHT_SPOT == (int)HYDRA_LIGHT_SPOT && (int)HYK_LIGHT_SUN == (int)HYDRA_LIGHT_SUN);

/* ---- descriptor to record */

HYI_FN hydra_result hyi_check_light_unit(hydra_context *context, const hydra_light_desc *d) {
    HYI_TRY(hyi_check_enum(context, (int)d->kind, HYDRA_LIGHT_SUN + 1, "light.kind"));
    HYI_TRY(hyi_check_enum(context, (int)d->unit, HYDRA_UNIT_IRRADIANCE + 1, "light.unit"));
    if ((d->unit == HYDRA_UNIT_POWER && d->kind == HYDRA_LIGHT_SUN) || (d->unit == HYDRA_UNIT_IRRADIANCE && d->kind != HYDRA_LIGHT_SUN))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.unit %d does not fit light.kind %d", (int)d->unit, (int)d->kind);
    return HYDRA_OK;
}

HYI_FN double hyi_cone_outer(const hydra_light_desc *d) { return d->cone_outer != 0.0f ? (double)d->cone_outer : 0.25 * HYI_PI; }

HYI_FN hydra_result hyi_check_light(hydra_context *context, const hydra_light_desc *d) {
    HYI_TRY(hyi_check_light_unit(context, d));
    HYI_TRY(hyi_check_color(context, d->color, FLT_MAX, "light.color"));
    HYI_TRY(hyi_check_finite(context, d->position, 3, "light.position"));
    HYI_TRY(hyi_check_finite(context, d->direction, 3, "light.direction"));
    HYI_TRY(hyi_check_finite(context, d->axis_u, 3, "light.axis_u"));
    HYI_TRY(hyi_check_finite(context, d->axis_v, 3, "light.axis_v"));
    HYI_TRY(hyi_check_finite(context, &d->radius, 1, "light.radius"));
    if ((d->kind == HYDRA_LIGHT_DISC || d->kind == HYDRA_LIGHT_SPHERE) && !(d->radius > 0.0f))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.radius is %g", (double)d->radius);
    HYI_TRY(hyi_check_range(context, d->cone_outer, 0.0f, 3.1415927f, HYDRA_ERROR_LIGHT, "light.cone_outer"));
    HYI_TRY(hyi_check_range(context, d->cone_inner, 0.0f, 3.1415927f, HYDRA_ERROR_LIGHT, "light.cone_inner"));
    if ((double)d->cone_inner > hyi_cone_outer(d))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "light.cone_inner %g is wider than cone_outer %g", (double)d->cone_inner, hyi_cone_outer(d));
    return hyi_check_range(context, d->angular_radius, 0.0f, 1.5707f, HYDRA_ERROR_LIGHT, "light.angular_radius");
}

/* Radiance from flux, for a sheet or sphere of given area. */
HYI_FN float hyi_area_scale(const hydra_light_desc *d, double area, bool both_sides) {
    return d->unit == HYDRA_UNIT_POWER ? (float)(1.0 / (HYI_PI * area * (both_sides ? 2.0 : 1.0))) : 1.0f;
}

HYI_FN hydra_result hyi_fill_rect(hydra_context *context, const hydra_light_desc *d, hyk_light *light, float *scale) {
    light->axis_u = hyi_vec3(d->axis_u);
    light->axis_v = hyi_vec3(d->axis_v);
    float lu = hyk_length(light->axis_u), lv = hyk_length(light->axis_v);
    hyk_vec3 across = hyk_cross(hyk_normalize(light->axis_u), hyk_normalize(light->axis_v));
    float sine = hyk_length(across);
    if (!(lu > 0.0f && lv > 0.0f && sine > 1e-4f)) return hyi_fail(context, HYDRA_ERROR_LIGHT, "axis_u and axis_v span no rectangle");
    if (fabsf(hyk_dot(hyk_normalize(light->axis_u), hyk_normalize(light->axis_v))) > 1e-3f)
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "axis_u and axis_v are not perpendicular");
    double area = 4.0 * (double)lu * (double)lv * (double)sine;
    light->normal = hyk_normalize(across);
    light->area = (float)area;
    *scale = hyi_area_scale(d, area, d->both_sides);
    return HYDRA_OK;
}

HYI_FN void hyi_fill_round(const hydra_light_desc *d, hyk_light *light, float *scale) {
    bool disc = d->kind == HYDRA_LIGHT_DISC;
    double r = (double)d->radius, area = (disc ? 1.0 : 4.0) * HYI_PI * r * r;
    light->radius = d->radius;
    light->area = (float)area;
    *scale = hyi_area_scale(d, area, disc && d->both_sides);
}

/* The falloff between the cones integrates to half their difference in cosine (light.h). */
HYI_FN void hyi_fill_spot(const hydra_light_desc *d, hyk_light *light, float *scale) {
    double outer = hyi_cone_outer(d);
    double inner = d->cone_inner != 0.0f ? (double)d->cone_inner : 0.9 * outer;
    light->cos_outer = (float)cos(outer);
    light->cos_inner = (float)cos(inner);
    double solid = 2.0 * HYI_PI * (2.0 * pow(sin(0.5 * inner), 2.0) + pow(sin(0.5 * outer), 2.0) - pow(sin(0.5 * inner), 2.0));
    if (d->unit == HYDRA_UNIT_POWER) *scale = (float)(1.0 / solid);
}

HYI_FN void hyi_fill_sun(const hydra_light_desc *d, hyk_light *light, float *scale) {
    light->normal = hyk_neg(light->normal); /* towards the sun */
    light->radius = d->angular_radius;
    light->cos_outer = cosf(d->angular_radius);
    double sine = sin((double)d->angular_radius);
    if (d->unit == HYDRA_UNIT_IRRADIANCE && d->angular_radius > 0.0f) *scale = (float)(1.0 / (HYI_PI * sine * sine));
}

HYI_FN hydra_result hyi_fill_light(hydra_context *context, const hydra_light_desc *d, hyk_light *light) {
    memset(light, 0, sizeof *light);
    HYI_TRY(hyi_check_light(context, d));
    float scale = 1.0f;
    light->kind = (uint32_t)d->kind;
    light->flags = (d->both_sides ? HYK_LIGHT_BOTH_SIDES : 0u) | (d->hidden ? HYK_LIGHT_HIDDEN : 0u);
    light->instance = light->primitive = HYK_NONE;
    light->position = hyi_vec3(d->position);
    light->normal = hyi_all_zero(d->direction, 3) ? hyk_make3(0.0f, -1.0f, 0.0f) : hyk_normalize(hyi_vec3(d->direction));
    switch (d->kind) {
        case HYDRA_LIGHT_RECT: HYI_TRY(hyi_fill_rect(context, d, light, &scale)); break;
        case HYDRA_LIGHT_DISC:
        case HYDRA_LIGHT_SPHERE: hyi_fill_round(d, light, &scale); break;
        case HYDRA_LIGHT_POINT:
            if (d->unit == HYDRA_UNIT_POWER) scale = (float)(0.25 / HYI_PI);
            break;
        case HYDRA_LIGHT_SPOT: hyi_fill_spot(d, light, &scale); break;
        case HYDRA_LIGHT_SUN: hyi_fill_sun(d, light, &scale); break;
    }
    light->radiance = hyk_scale(hyi_vec3(d->color), scale);
    if (!hyi_is_finite(light->radiance.x) || !hyi_is_finite(light->radiance.y) || !hyi_is_finite(light->radiance.z) || !hyi_is_finite(light->area))
        return hyi_fail(context, HYDRA_ERROR_LIGHT, "its area or radiance exceeds the range of float");
    return HYDRA_OK;
}

HYDRA_API hydra_light hydra_scene_add_light(hydra_scene *scene, const hydra_light_desc *desc) {
    hydra_light handle = { 0 };
    if (hyi_scene_editable(scene, desc, "hydra_scene_add_light") != HYDRA_OK) return handle;
    hyi_light_slot slot;
    slot.alive = true;
    if (hyi_reject(scene, hyi_fill_light(scene->context, desc, &slot.record)) != HYDRA_OK) return handle;
    if (hyi_reject(scene, hyi_grow_array(scene->context, &scene->lights, &scene->light_capacity, scene->light_count + 1)) != HYDRA_OK) return handle;
    scene->lights[scene->light_count++] = slot;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    handle.id = (uint32_t)scene->light_count;
    return handle;
}

HYI_FN hydra_result hyi_check_light_handle(hydra_scene *scene, hydra_light light) {
    if (light.id == 0 || light.id > scene->light_count || !scene->lights[light.id - 1].alive)
        return hyi_fail(scene->context, HYDRA_ERROR_HANDLE, "light %u", light.id);
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_update_light(hydra_scene *scene, hydra_light light, const hydra_light_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, desc, "hydra_scene_update_light"));
    HYI_TRY(hyi_reject(scene, hyi_check_light_handle(scene, light)));
    hyk_light record;
    HYI_TRY(hyi_reject(scene, hyi_fill_light(scene->context, desc, &record)));
    scene->lights[light.id - 1].record = record;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_remove_light(hydra_scene *scene, hydra_light light) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_remove_light"));
    HYI_TRY(hyi_reject(scene, hyi_check_light_handle(scene, light)));
    scene->lights[light.id - 1].alive = false;
    scene->dirty |= HYI_DIRTY_LIGHTS;
    return HYDRA_OK;
}

/* ---- environment */

HYI_FN hydra_result hyi_check_environment(hydra_context *context, const hydra_environment_desc *d) {
    HYI_TRY(hyi_check_color(context, d->color, FLT_MAX, "environment.color"));
    HYI_TRY(hyi_check_finite(context, &d->rotation, 1, "environment.rotation"));
    if (!d->texels && (d->width || d->height)) return hyi_fail(context, HYDRA_ERROR_NULL, "environment.texels, of %u x %u", d->width, d->height);
    if (!d->texels) return HYDRA_OK;
    if (d->width == 0 || d->height == 0 || d->width > 65536 || d->height > 65536)
        return hyi_fail(context, HYDRA_ERROR_TEXTURE, "the environment has %u x %u texels", d->width, d->height);
    for (size_t i = 0; i < (size_t)3 * d->width * d->height; i++) {
        if (!hyi_is_finite(d->texels[i])) return hyi_fail(context, HYDRA_ERROR_NOT_FINITE, "environment texel %zu", i / 3);
        if (d->texels[i] < 0.0f) return hyi_fail(context, HYDRA_ERROR_COLOR, "environment texel %zu has a channel of %g", i / 3, (double)d->texels[i]);
    }
    return HYDRA_OK;
}

HYDRA_API hydra_result hydra_scene_set_environment(hydra_scene *scene, const hydra_environment_desc *desc) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_set_environment"));
    float *texels = NULL;
    size_t count = 0;
    if (desc) {
        HYI_TRY(hyi_reject(scene, hyi_check_environment(scene->context, desc)));
        if (desc->texels) {
            count = (size_t)3 * desc->width * desc->height;
            HYI_TRY(hyi_reject(scene, hyi_alloc_array(scene->context, &texels, count)));
            memcpy(texels, desc->texels, count * sizeof *texels);
        }
    }
    hyi_free_environment(scene);
    scene->environment_texels = texels;
    scene->environment_width = texels ? desc->width : 0;
    scene->environment_height = texels ? desc->height : 0;
    scene->environment_rotation = desc ? desc->rotation : 0.0f;
    bool white = texels && hyi_all_zero(desc->color, 3);
    for (int i = 0; i < 3; i++) scene->environment_color[i] = !desc ? 0.0f : white ? 1.0f : desc->color[i];
    scene->environment_set = desc && !hyi_all_zero(scene->environment_color, 3);
    scene->dirty |= HYI_DIRTY_ENVIRONMENT;
    return HYDRA_OK;
}

/* ---- all emitters of a scene, gathered by commit */

HYI_FN const hyk_material *hyi_triangle_material(const hydra_scene *scene, const hyi_mesh_slot *mesh, uint32_t override_slot, uint32_t triangle) {
    uint32_t slot = override_slot != HYK_NONE ? override_slot : mesh->triangle_materials ? mesh->triangle_materials[triangle] : mesh->material;
    return &scene->view_materials[slot];
}

/* Mean radiance of an emitting material; black: it emits nothing. */
HYI_FN hyk_vec3 hyi_mean_emission(const hydra_scene *scene, const hyk_material *material) {
    if (!(material->flags & HYK_MATERIAL_EMITS)) return hyk_zero3();
    if (material->emission_texture == HYK_NONE) return material->emission;
    const float *mean = scene->textures[material->emission_texture].mean;
    return hyk_mul(material->emission, hyi_vec3(mean));
}

HYI_FN bool hyi_triangle_emits(const hydra_scene *scene, const hyi_mesh_slot *mesh, uint32_t override_slot, uint32_t triangle) {
    return !hyk_is_black(hyi_mean_emission(scene, hyi_triangle_material(scene, mesh, override_slot, triangle)));
}

/* Number of emitting triangles, and for a mesh of which only some emit, the place of each among them. */
HYI_FN hydra_result hyi_number_emitters(hydra_scene *scene, hyi_mesh_slot *mesh) {
    hyi_free_array(scene->context, &mesh->light_slots, mesh->triangle_count);
    mesh->emitter_count = 0;
    if (!mesh->triangle_materials) {
        if (hyi_triangle_emits(scene, mesh, HYK_NONE, 0)) mesh->emitter_count = mesh->triangle_count;
        return HYDRA_OK;
    }
    for (uint32_t i = 0; i < mesh->triangle_count; i++) mesh->emitter_count += hyi_triangle_emits(scene, mesh, HYK_NONE, i) ? 1u : 0u;
    if (mesh->emitter_count == 0 || mesh->emitter_count == mesh->triangle_count) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(scene->context, &mesh->light_slots, mesh->triangle_count));
    uint32_t next = 0;
    for (uint32_t i = 0; i < mesh->triangle_count; i++) mesh->light_slots[i] = hyi_triangle_emits(scene, mesh, HYK_NONE, i) ? next++ : HYK_NONE;
    return HYDRA_OK;
}

HYI_FN hyk_vec3 hyi_placed_vertex(const hyk_instance *placed, const hyi_mesh_slot *mesh, uint32_t vertex) {
    const float *p = mesh->positions + (size_t)3 * vertex;
    double x = (double)p[0], y = (double)p[1], z = (double)p[2];
    const hyk_vec3 rows[3] = { placed->row0, placed->row1, placed->row2 };
    const float moves[3] = { placed->t0, placed->t1, placed->t2 };
    float world[3];
    for (int r = 0; r < 3; r++) world[r] = (float)((double)rows[r].x * x + (double)rows[r].y * y + (double)rows[r].z * z + (double)moves[r]);
    return hyi_vec3(world);
}

HYI_FN hyk_light hyi_triangle_light(const hydra_scene *scene, uint32_t instance, const hyi_mesh_slot *mesh, uint32_t triangle) {
    const hyk_instance *placed = &scene->placed[instance];
    const hyk_material *material = hyi_triangle_material(scene, mesh, placed->material, triangle);
    const uint32_t *corner = mesh->indices + (size_t)3 * triangle;
    hyk_light light;
    memset(&light, 0, sizeof light);
    light.kind = HYK_LIGHT_TRIANGLE;
    light.position = hyi_placed_vertex(placed, mesh, corner[0]);
    light.axis_u = hyk_sub(hyi_placed_vertex(placed, mesh, corner[1]), light.position);
    light.axis_v = hyk_sub(hyi_placed_vertex(placed, mesh, corner[2]), light.position);
    float lu = hyk_length(light.axis_u), lv = hyk_length(light.axis_v);
    hyk_vec3 across = hyk_cross(hyk_normalize(light.axis_u), hyk_normalize(light.axis_v));
    light.area = 0.5f * lu * lv * hyk_length(across);
    light.normal = hyk_normalize(across);
    if (placed->flags & HYK_INSTANCE_MIRRORED) light.normal = hyk_neg(light.normal);
    light.radiance = hyi_mean_emission(scene, material);
    if (material->flags & HYK_MATERIAL_EMITS_BOTH_SIDES) light.flags |= HYK_LIGHT_BOTH_SIDES;
    if (material->emission_texture != HYK_NONE || hyk_material_has_alpha(*material)) light.flags |= HYK_LIGHT_TEXTURED;
    light.instance = instance;
    light.primitive = triangle;
    return light;
}

HYI_FN size_t hyi_placed_emitters(const hydra_scene *scene, uint32_t instance) {
    const hyk_instance *placed = &scene->placed[instance];
    const hyi_mesh_slot *mesh = &scene->meshes[placed->mesh];
    if (placed->material == HYK_NONE) return mesh->emitter_count;
    /* an override gives every triangle one material, so all or none emit and slots are not looked at */
    return hyi_triangle_emits(scene, mesh, placed->material, 0) ? mesh->triangle_count : 0;
}

HYI_FN bool hyi_is_lit(const hyi_light_slot *slot, bool sun) {
    return slot->alive && (slot->record.kind == HYK_LIGHT_SUN) == sun && !hyk_is_black(slot->record.radiance);
}

HYI_FN void hyi_gather_slots(hydra_scene *scene, bool suns, size_t *at) {
    for (size_t i = 0; i < scene->light_count; i++) {
        if (!hyi_is_lit(&scene->lights[i], suns)) continue;
        scene->light_ids[*at] = (uint32_t)i + 1;
        scene->all_lights[(*at)++] = scene->lights[i].record;
    }
}

HYI_FN void hyi_gather_triangles(hydra_scene *scene, size_t *at) {
    for (size_t i = 0; i < scene->placed_count; i++) {
        hyk_instance *placed = &scene->placed[i];
        const hyi_mesh_slot *mesh = &scene->meshes[placed->mesh];
        placed->first_light = hyi_placed_emitters(scene, (uint32_t)i) ? (uint32_t)*at : HYK_NONE;
        if (placed->first_light == HYK_NONE) continue;
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            if (!hyi_triangle_emits(scene, mesh, placed->material, t)) continue;
            scene->light_ids[*at] = 0;
            scene->all_lights[(*at)++] = hyi_triangle_light(scene, (uint32_t)i, mesh, t);
        }
    }
}

HYI_FN bool hyi_is_shape(const hyk_light *light) { return light->kind <= HYK_LIGHT_SPHERE; }

HYI_FN hyi_box hyi_shape_box(const hyk_light *light) {
    hyk_vec3 extent;
    if (light->kind == HYK_LIGHT_RECT) extent = hyk_add(hyk_abs3(light->axis_u), hyk_abs3(light->axis_v));
    else extent = hyk_splat(light->radius);
    const float center[3] = { light->position.x, light->position.y, light->position.z }, half[3] = { extent.x, extent.y, extent.z };
    hyi_box box;
    for (int i = 0; i < 3; i++) {
        float slack = 4.0f * FLT_EPSILON * (fabsf(center[i]) + half[i]);
        box.lower[i] = fmaxf(center[i] - half[i] - slack, -FLT_MAX);
        box.upper[i] = fminf(center[i] + half[i] + slack, FLT_MAX);
    }
    return box;
}

HYI_FN hydra_result hyi_build_shapes(hydra_scene *scene) {
    uint32_t count = 0;
    for (size_t i = 0; i < scene->view.constants.finite_lights; i++) count += hyi_is_shape(&scene->all_lights[i]) ? 1u : 0u;
    if (!count) return HYDRA_OK;
    HYI_TRY(hyi_alloc_array(scene->context, &scene->shape_lights, count));
    scene->shape_count = count;
    hyi_box *boxes;
    HYI_TRY(hyi_alloc_array(scene->context, &boxes, count));
    uint32_t at = 0;
    for (size_t i = 0; i < scene->view.constants.finite_lights; i++) {
        if (!hyi_is_shape(&scene->all_lights[i])) continue;
        boxes[at] = hyi_shape_box(&scene->all_lights[i]);
        scene->shape_lights[at++] = (uint32_t)i;
    }
    hydra_result result = hyi_bvh_build_boxes(scene->context, boxes, count, &scene->shapes);
    hyi_free_array(scene->context, &boxes, count);
    return result;
}

HYI_FN hydra_result hyi_commit_lights(hydra_scene *scene) {
    hyi_free_lights(scene);
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (scene->meshes[i].alive) HYI_TRY(hyi_number_emitters(scene, &scene->meshes[i]));
    size_t finite = 0, suns = 0;
    for (size_t i = 0; i < scene->light_count; i++) {
        finite += hyi_is_lit(&scene->lights[i], false) ? 1u : 0u;
        suns += hyi_is_lit(&scene->lights[i], true) ? 1u : 0u;
    }
    for (size_t i = 0; i < scene->placed_count; i++) finite += hyi_placed_emitters(scene, (uint32_t)i);
    if (finite + suns > 0x7fffffffu) return hyi_fail(scene->context, HYDRA_ERROR_COUNT, "%zu emitters", finite + suns);
    HYI_TRY(hyi_alloc_array(scene->context, &scene->all_lights, finite + suns));
    if (hyi_alloc_array(scene->context, &scene->light_ids, finite + suns) != HYDRA_OK) {
        hyi_free_array(scene->context, &scene->all_lights, finite + suns);
        return HYDRA_ERROR_OUT_OF_MEMORY;
    }
    scene->all_light_count = finite + suns;
    scene->view.constants.finite_lights = (uint32_t)finite;
    scene->view.constants.suns = (uint32_t)suns;
    size_t at = 0;
    hyi_gather_slots(scene, false, &at);
    hyi_gather_triangles(scene, &at);
    hyi_gather_slots(scene, true, &at);
    if (finite) HYI_TRY(hyi_light_tree_build(scene->context, scene->all_lights, (uint32_t)finite, &scene->light_nodes, &scene->light_node_count));
    return hyi_build_shapes(scene);
}

#endif /* HYI_LIGHTS_H */
