/* scene_lights.h: lights and cameras of the scene file */
#ifndef SCENE_LIGHTS_H
#define SCENE_LIGHTS_H

#include "gltf_extras.h"

#include "hydra.h"

#include <assimp/scene.h>

typedef struct scene_camera {
    char *name;
    float position[3], forward[3], up[3];
    float fov_x, fov_y; /* radians; 0: the other one holds, or neither for an orthographic camera */
    float aspect;       /* width / height; 0: the picture's own */
    float ortho_height; /* m; 0: perspective */
} scene_camera;

/* Adds the lights; the number of those that shine in *count and the sum of ambient ones in ambient.
   False: hydra rejected one; the next commit says why. */
bool scene_lights_add(hydra_scene *scene, const struct aiScene *source, bool is_gltf, size_t *count, float ambient[3]);
/* As many as source has. */
scene_camera *scene_cameras_read(const struct aiScene *source, const gltf_extras *extras);

#endif
