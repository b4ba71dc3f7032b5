/* environment.c: see environment.h */
#include "environment.h"

#include "app.h"

#include <stdlib.h>
#include <string.h>

#include <stb/stb_image.h>

static const float degree = 3.14159265f / 180.0f;

int environment_read(environment *env, const render_options *options) {
    memset(env, 0, sizeof *env);
    const char *text = options->environment;
    if (text == NULL) return APP_DONE;
    env->given = true;
    if (options_numbers(text, env->color, 3, 3) == 3) return APP_DONE;
    if (options_numbers(text, env->color, 1, 1) == 1) {
        env->color[1] = env->color[2] = env->color[0];
        return APP_DONE;
    }
    size_t size;
    int width = 0, height = 0, channels;
    char *bytes = app_read_file(text, (size_t)1 << 30, &size);
    if (bytes == NULL) return APP_INPUT;
    env->texels = stbi_loadf_from_memory((const stbi_uc *)bytes, (int)size, &width, &height, &channels, 3);
    free(bytes);
    if (env->texels == NULL) {
        app_error("--env %s: %s; give a Radiance .hdr file or R,G,B", text, stbi_failure_reason());
        return APP_INPUT;
    }
    env->width = (uint32_t)width;
    env->height = (uint32_t)height;
    return APP_DONE;
}

static bool set_environment(hydra_scene *scene, const environment *env, float rotation) {
    hydra_environment_desc desc;
    memset(&desc, 0, sizeof desc);
    memcpy(desc.color, env->color, sizeof desc.color);
    desc.texels = env->texels;
    desc.width = env->width;
    desc.height = env->height;
    desc.rotation = rotation;
    return hydra_scene_set_environment(scene, &desc) == HYDRA_OK;
}

static bool add_sun(hydra_scene *scene, const float sun[5]) {
    hydra_light_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.kind = HYDRA_LIGHT_SUN;
    desc.unit = HYDRA_UNIT_IRRADIANCE;
    for (int i = 0; i < 3; i++) {
        desc.direction[i] = -sun[i];
        desc.color[i] = sun[3];
    }
    desc.angular_radius = 0.5f * sun[4] * degree;
    return hydra_scene_add_light(scene, &desc).id != 0;
}

static int refused(const char *what, const char *text, hydra_context *context) {
    app_error("%s %s: %s", what, text, hydra_error_text(context));
    return APP_INPUT;
}

int environment_add(const environment *env, const render_options *options, const imported *scene_file, hydra_context *context,
                    hydra_scene *scene) {
    environment chosen = *env;
    const float *ambient = scene_file->ambient;
    bool is_lit = scene_file->lights > 0 || env->given || (options->has_sun && options->sun[3] > 0.0f);
    if (!env->given && (ambient[0] > 0.0f || ambient[1] > 0.0f || ambient[2] > 0.0f)) {
        memcpy(chosen.color, ambient, sizeof chosen.color);
        chosen.given = true;
    } else if (!is_lit) {
        app_warning("%s has no light: lit by a constant environment of 1 (see --env and --sun)", options->scene_path);
        for (int i = 0; i < 3; i++) chosen.color[i] = 1.0f;
        chosen.given = true;
    }
    if (chosen.given && !set_environment(scene, &chosen, options->environment_rotation * degree))
        return refused("--env", options->environment != NULL ? options->environment : "of the scene", context);
    if (options->has_sun && !add_sun(scene, options->sun)) return refused("--sun", "", context);
    return APP_DONE;
}

void environment_free(environment *env) {
    stbi_image_free(env->texels);
    env->texels = NULL;
}
