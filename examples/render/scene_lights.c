/* scene_lights.c: see scene_lights.h */
#include "scene_lights.h"

#include "app.h"
#include "transform.h"

#include <string.h>

enum { DEPTH_LIMIT = 4096 };

static const struct aiNode *find_node(const struct aiNode *node, const char *name, int depth) {
    if (strcmp(node->mName.data, name) == 0) return node;
    for (unsigned i = 0; i < node->mNumChildren && depth < DEPTH_LIMIT; i++) {
        const struct aiNode *found = find_node(node->mChildren[i], name, depth + 1);
        if (found != NULL) return found;
    }
    return NULL;
}

/* Lights and cameras hang on the node of the same name; without one they stand in the world. */
static transform place_of(const struct aiScene *source, const char *name) {
    transform place = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    for (const struct aiNode *node = find_node(source->mRootNode, name, 0); node != NULL; node = node->mParent) {
        transform own = transform_from_assimp(&node->mTransformation);
        place = transform_multiply(&own, &place);
    }
    return place;
}

static void to_world(const transform *place, const struct aiVector3D *v, int is_point, float out[3]) {
    double local[3] = {v->x, v->y, v->z}, world[3];
    if (is_point)
        transform_point(place, local, world);
    else
        transform_vector(place, local, world);
    for (int i = 0; i < 3; i++) out[i] = (float)world[i];
}

/* ---------------------------------------------------------------- lights */

/* A rectangle that shines along its direction: u x v = direction. */
static void area_light(hydra_light_desc *desc, const struct aiLight *light, const transform *place) {
    double d[3] = {light->mDirection.x, light->mDirection.y, light->mDirection.z};
    double v[3] = {light->mUp.x, light->mUp.y, light->mUp.z}, u[3], out[3];
    vector_cross(v, d, u);
    vector_normalize(u);
    vector_normalize(v);
    desc->kind = HYDRA_LIGHT_RECT;
    for (int i = 0; i < 3; i++) u[i] *= 0.5 * (double)light->mSize.x;
    for (int i = 0; i < 3; i++) v[i] *= 0.5 * (double)light->mSize.y;
    transform_vector(place, u, out);
    for (int i = 0; i < 3; i++) desc->axis_u[i] = (float)out[i];
    transform_vector(place, v, out);
    for (int i = 0; i < 3; i++) desc->axis_v[i] = (float)out[i];
}

/* The glTF importer hands through half angles, the others the whole ones that assimp's documentation names. */
static void spot_light(hydra_light_desc *desc, const struct aiLight *light, bool is_gltf) {
    float half = is_gltf ? 1.0f : 0.5f;
    desc->kind = HYDRA_LIGHT_SPOT;
    desc->cone_outer = half * light->mAngleOuterCone;
    desc->cone_inner = half * light->mAngleInnerCone;
    if (desc->cone_inner <= 0.0f) desc->cone_inner = 1e-4f * desc->cone_outer;
    if (desc->cone_inner > desc->cone_outer) desc->cone_inner = desc->cone_outer;
}

/* False: nothing that hydra has. */
static bool describe_light(hydra_light_desc *desc, const struct aiLight *light, const transform *place, bool is_gltf) {
    memset(desc, 0, sizeof *desc);
    desc->color[0] = light->mColorDiffuse.r;
    desc->color[1] = light->mColorDiffuse.g;
    desc->color[2] = light->mColorDiffuse.b;
    to_world(place, &light->mPosition, 1, desc->position);
    to_world(place, &light->mDirection, 0, desc->direction);
    switch (light->mType) {
    case aiLightSource_POINT: desc->kind = HYDRA_LIGHT_POINT; return true;
    case aiLightSource_SPOT: spot_light(desc, light, is_gltf); return true;
    case aiLightSource_DIRECTIONAL: desc->kind = HYDRA_LIGHT_SUN; return true;
    case aiLightSource_AREA: area_light(desc, light, place); return true;
    default: return false;
    }
}

static void add_ambient(const struct aiLight *light, float ambient[3]) {
    ambient[0] += light->mColorAmbient.r;
    ambient[1] += light->mColorAmbient.g;
    ambient[2] += light->mColorAmbient.b;
}

bool scene_lights_add(hydra_scene *scene, const struct aiScene *source, bool is_gltf, size_t *count, float ambient[3]) {
    *count = 0;
    for (unsigned i = 0; i < source->mNumLights; i++) {
        const struct aiLight *light = source->mLights[i];
        transform place = place_of(source, light->mName.data);
        hydra_light_desc desc;
        if (light->mType == aiLightSource_AMBIENT) {
            add_ambient(light, ambient);
        } else if (!describe_light(&desc, light, &place, is_gltf)) {
            app_warning("light %s: of a kind that is not supported; ignored", light->mName.data);
        } else if (desc.color[0] != 0.0f || desc.color[1] != 0.0f || desc.color[2] != 0.0f) {
            if (hydra_scene_add_light(scene, &desc).id == 0) return false;
            ++*count;
        }
    }
    return true;
}

/* ---------------------------------------------------------------- cameras */

scene_camera *scene_cameras_read(const struct aiScene *source, const gltf_extras *extras) {
    scene_camera *cameras = app_alloc(source->mNumCameras, sizeof *cameras);
    for (unsigned i = 0; i < source->mNumCameras; i++) {
        const struct aiCamera *from = source->mCameras[i];
        transform place = place_of(source, from->mName.data);
        scene_camera *to = &cameras[i];
        memset(to, 0, sizeof *to);
        to->name = app_copy(from->mName.data);
        to_world(&place, &from->mPosition, 1, to->position);
        to_world(&place, &from->mLookAt, 0, to->forward);
        to_world(&place, &from->mUp, 0, to->up);
        to->aspect = from->mAspect > 0.0f && isfinite(from->mAspect) ? from->mAspect : 0.0f;
        to->fov_x = from->mHorizontalFOV;
        if (from->mOrthographicWidth > 0.0f) /* half the width */
            to->ortho_height = 2.0f * from->mOrthographicWidth / (to->aspect > 0.0f ? to->aspect : 1.0f);
        if (i < extras->camera_count && extras->camera_fov_y[i] > 0.0f) {
            to->fov_y = extras->camera_fov_y[i];
            to->fov_x = 0.0f;
        }
    }
    return cameras;
}
