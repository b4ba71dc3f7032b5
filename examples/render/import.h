/* import.h: a scene file becomes a hydra scene */
#ifndef IMPORT_H
#define IMPORT_H

#include "scene_lights.h"

#include "hydra.h"

typedef struct imported {
    scene_camera *cameras;
    size_t camera_count;
    size_t lights; /* lamps and emitting materials in use */
    float ambient[3];
    size_t instances;
} imported;

/* keep_meshes: one hydra mesh for each mesh of the file even where it stands once, so that ids tell objects apart.
   Returns APP_DONE, or the exit code after a message. */
int import_scene(imported *result, hydra_context *context, hydra_scene *scene, const char *path, bool keep_meshes);
void import_free(imported *result);
/* The exit code that belongs to a result of hydra. */
int import_exit_code(hydra_result result);

#endif
