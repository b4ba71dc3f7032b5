/* environment.h: light from all around, and the sun */
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H

#include "import.h"
#include "options.h"

/* An equirectangular picture, or texels NULL and a constant colour. */
typedef struct environment {
    bool given;
    float *texels;
    uint32_t width, height;
    float color[3];
} environment;

/* Reads what --env names, before the scene, so that a slip shows at once. APP_DONE or the exit code. */
int environment_read(environment *env, const render_options *options);
/* Adds environment and sun; without any light in the scene a constant environment of 1, with a warning. */
int environment_add(const environment *env, const render_options *options, const imported *scene_file, hydra_context *context,
                    hydra_scene *scene);
void environment_free(environment *env);

#endif
