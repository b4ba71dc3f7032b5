/* options.c: see options.h. One table holds every flag with its help text. */
#include "options.h"

#include "app.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help_head[] =
    "usage: hydra-render SCENE [options] -o PICTURE\n"
    "\n"
    "Path-traces a glTF, GLB, OBJ, PLY or FBX file (or whatever else assimp reads) and says how wrong the picture\n"
    "still is. Without --spp, --time or --error it takes 64 samples a pixel; with several, the first one ends it.\n"
    "\n";

static const char help_tail[] =
    "\n"
    "Camera: px,py,pz,tx,ty,tz[,vertical fov in degrees] | index or name of a camera in the scene file |\n"
    "        FILE.json with origin, right, up, forward, hfov_deg. Default: the file's first camera, else all in view.\n"
    "Layers: direct indirect caustic irradiance albedo normal position depth coverage primitive instance mesh\n"
    "        material samples validity error, or all. EXR pictures hold radiance and every layer asked for.\n"
    "Units:  lights of the scene file are taken as radiometric: W/sr, W/m^2, W/(m^2 sr).\n"
    "Exit:   0 done, 1 wrong command line or target, 2 wrong input, 3 memory, threads or machine,\n"
    "        4 stopped by Ctrl-C (what was rendered is written).\n";

typedef bool (*flag_reader)(render_options *result, const char *flag, const char *text);

typedef struct flag {
    const char *name, *argument, *help;
    flag_reader read;
} flag;

size_t options_numbers(const char *text, float *numbers, size_t minimum, size_t maximum) {
    size_t count = 0;
    for (;;) {
        char *end;
        float number = strtof(text, &end);
        if (end == text || count == maximum || !isfinite(number)) return 0;
        numbers[count++] = number;
        if (*end == '\0') return count >= minimum ? count : 0;
        if (*end != ',') return 0;
        text = end + 1;
    }
}

static bool read_whole(const char *name, const char *text, uint32_t minimum, uint32_t maximum, uint32_t *value) {
    char *end;
    unsigned long long number = strtoull(text, &end, 10);
    if (isdigit((unsigned char)text[0]) && *end == '\0' && number >= minimum && number <= maximum) {
        *value = (uint32_t)number;
        return true;
    }
    app_error("%s: \"%s\" is not a whole number from %u to %u", name, text, (unsigned)minimum, (unsigned)maximum);
    return false;
}

static bool read_real(const char *name, const char *text, double minimum, double maximum, double *value) {
    char *end;
    double number = strtod(text, &end);
    if (end != text && *end == '\0' && number >= minimum && number <= maximum) {
        *value = number;
        return true;
    }
    app_error("%s: \"%s\" is not a number from %g to %g", name, text, minimum, maximum);
    return false;
}

static bool read_word(const char *name, const char *text, const char *const *words, size_t count, unsigned *value) {
    for (*value = 0; *value < count; ++*value)
        if (strcmp(words[*value], text) == 0) return true;
    app_error("%s: \"%s\" is none of those that --help lists", name, text);
    return false;
}

static bool read_target(render_options *result, const char *name, const char *text) {
    if (result->target_count == OPTIONS_TARGETS) {
        app_error("%s: more than %d pictures", name, (int)OPTIONS_TARGETS);
        return false;
    }
    return image_target_parse(&result->targets[result->target_count++], text);
}

static bool read_width(render_options *r, const char *name, const char *text) { return read_whole(name, text, 1, 65536, &r->width); }

static bool read_height(render_options *r, const char *name, const char *text) { return read_whole(name, text, 1, 65536, &r->height); }

static bool read_spp(render_options *r, const char *name, const char *text) {
    if (!read_whole(name, text, 1, 1u << 30, &r->spp)) return false;
    r->spp += r->spp & 1u;
    return true;
}

static bool read_time(render_options *r, const char *name, const char *text) { return read_real(name, text, 0.001, 1e9, &r->seconds); }

static bool read_error(render_options *r, const char *name, const char *text) {
    double percent_or_share;
    if (!read_real(name, text, 1e-6, 10.0, &percent_or_share)) return false;
    r->error = (float)percent_or_share;
    return true;
}

static bool read_threads(render_options *r, const char *name, const char *text) { return read_whole(name, text, 1, 1024, &r->threads); }

static bool read_seed(render_options *r, const char *name, const char *text) { return read_whole(name, text, 0, UINT32_MAX, &r->seed); }

static bool read_depth(render_options *r, const char *name, const char *text) { return read_whole(name, text, 1, 1u << 20, &r->depth); }

static bool read_strategy(render_options *r, const char *name, const char *text) {
    static const char *const words[] = {"mis", "lights", "bsdf"};
    unsigned value;
    if (!read_word(name, text, words, 3, &value)) return false;
    r->strategy = (hydra_strategy)value;
    return true;
}

static bool read_camera(render_options *r, const char *name, const char *text) {
    (void)name;
    r->camera = text;
    return true;
}

static bool read_environment(render_options *r, const char *name, const char *text) {
    (void)name;
    r->environment = text;
    return true;
}

static bool read_rotation(render_options *r, const char *name, const char *text) {
    double degrees;
    if (!read_real(name, text, -3600.0, 3600.0, &degrees)) return false;
    r->environment_rotation = (float)degrees;
    return true;
}

static bool read_sun(render_options *r, const char *name, const char *text) {
    r->sun[3] = 3.0f;
    r->sun[4] = 0.53f;
    size_t count = options_numbers(text, r->sun, 3, 5);
    bool good = count != 0 && (r->sun[0] != 0.0f || r->sun[1] != 0.0f || r->sun[2] != 0.0f) && r->sun[3] >= 0.0f && r->sun[4] >= 0.0f &&
                r->sun[4] <= 180.0f;
    if (!good) app_error("%s: \"%s\" is not x,y,z[,irradiance[,angular diameter in degrees]]", name, text);
    r->has_sun = true;
    return good;
}

static bool read_layers(render_options *r, const char *name, const char *text) {
    while (*text != '\0') {
        size_t length = strcspn(text, ",");
        uint32_t bits = image_layer_bits(text, length);
        if (bits == 0) {
            app_error("%s: there is no layer \"%.*s\"; --help lists them", name, (int)length, text);
            return false;
        }
        r->outputs |= bits;
        text += length + (text[length] == ',');
    }
    return true;
}

static bool read_exposure(render_options *r, const char *name, const char *text) {
    double stops;
    if (!read_real(name, text, -60.0, 60.0, &stops)) return false;
    r->tone.exposure = (float)stops;
    return true;
}

static bool read_tonemap(render_options *r, const char *name, const char *text) {
    static const char *const words[] = {"none", "reinhard", "aces"};
    unsigned value;
    if (!read_word(name, text, words, 3, &value)) return false;
    r->tone.curve = (image_curve)value;
    return true;
}

static bool read_vulkan(render_options *r, const char *name, const char *text) {
    (void)name;
    r->vulkan = strcmp(text, "any") == 0 ? "" : text;
    return true;
}

static bool read_stats(render_options *r, const char *name, const char *text) {
    (void)name, (void)text;
    return r->stats = true;
}

static bool read_quiet(render_options *r, const char *name, const char *text) {
    (void)r, (void)name, (void)text;
    app_set_quiet(true);
    return true;
}

static const flag flags[] = {
    {"-o", "FILE", "picture to write: .png, .exr or .pfm; may be repeated; LAYER=FILE writes a layer", read_target},
    {"--width", "N", "pixels (default 1280, or what fits the camera)", read_width},
    {"--height", "N", "pixels (default 720, or what fits the camera)", read_height},
    {"--spp", "N", "stop at N samples a pixel (rounded up to even)", read_spp},
    {"--time", "SECONDS", "stop after so much rendering", read_time},
    {"--error", "E", "stop at this relative error, e.g. 0.02", read_error},
    {"--camera", "CAMERA", "see below", read_camera},
    {"--env", "FILE.hdr|R,G,B", "light from all around: an equirectangular picture or a constant", read_environment},
    {"--env-rotation", "DEGREES", "turns the environment about +Y", read_rotation},
    {"--sun", "X,Y,Z[,E[,DEG]]", "a sun in direction X,Y,Z; irradiance E (3), diameter DEG (0.53)", read_sun},
    {"--aov", "LIST", "layers beside radiance, with commas between", read_layers},
    {"--exposure", "EV", "PNG only: brightens by 2^EV (default 0)", read_exposure},
    {"--tonemap", "CURVE", "PNG only: none (default), reinhard, aces", read_tonemap},
    {"--depth", "N", "longest path, in scattering events (default: no limit)", read_depth},
    {"--strategy", "NAME", "mis (default), lights, bsdf", read_strategy},
    {"--vulkan", "DEVICE", "renders on a Vulkan device: part of its name, or any", read_vulkan},
    {"--threads", "N", "default: one for each processor", read_threads},
    {"--seed", "N", "default 0", read_seed},
    {"--stats", NULL, "prints what it cost", read_stats},
    {"--quiet", NULL, "only errors on stderr", read_quiet},
    {"--help", NULL, "prints this", NULL},
    {"--version", NULL, "prints the version", NULL},
};

static void show_help(void) {
    fputs(help_head, stdout);
    for (size_t i = 0; i < sizeof flags / sizeof flags[0]; i++) {
        char left[64];
        snprintf(left, sizeof left, "%s %s", flags[i].name, flags[i].argument ? flags[i].argument : "");
        printf("  %-24s %s\n", left, flags[i].help);
    }
    fputs(help_tail, stdout);
}

static const flag *find_flag(const char *name) {
    for (size_t i = 0; i < sizeof flags / sizeof flags[0]; i++)
        if (strcmp(flags[i].name, name) == 0) return &flags[i];
    return NULL;
}

static options_result read_scene(render_options *result, const char *text) {
    if (result->scene_path == NULL) {
        result->scene_path = text;
        return OPTIONS_RUN;
    }
    app_error("two scenes: \"%s\" and \"%s\"; give one", result->scene_path, text);
    return OPTIONS_WRONG;
}

static options_result read_flag(render_options *result, int argc, char **argv, int *at) {
    const char *name = argv[*at];
    const flag *found = find_flag(name);
    if (found == NULL) {
        app_error("%s: no such option; --help lists them", name);
        return OPTIONS_WRONG;
    }
    if (found->read == NULL) {
        if (strcmp(name, "--help") == 0)
            show_help();
        else
            printf("hydra-render %d.%d\n", HYDRA_VERSION_MAJOR, HYDRA_VERSION_MINOR);
        return OPTIONS_SHOWN;
    }
    if (found->argument != NULL && ++*at >= argc) {
        app_error("%s: needs %s behind it", name, found->argument);
        return OPTIONS_WRONG;
    }
    return found->read(result, name, argv[*at]) ? OPTIONS_RUN : OPTIONS_WRONG;
}

static options_result check_complete(const render_options *result) {
    if (result->scene_path != NULL && result->target_count > 0) return OPTIONS_RUN;
    app_error(result->scene_path == NULL ? "no scene given; try --help" : "no picture given: add -o FILE.png");
    return OPTIONS_WRONG;
}

options_result options_parse(render_options *result, int argc, char **argv) {
    memset(result, 0, sizeof *result);
    for (int i = 1; i < argc; i++) {
        bool is_flag = argv[i][0] == '-' && argv[i][1] != '\0';
        options_result step = is_flag ? read_flag(result, argc, argv, &i) : read_scene(result, argv[i]);
        if (step != OPTIONS_RUN) return step;
    }
    for (size_t i = 0; i < result->target_count; i++) result->outputs |= image_target_bits(&result->targets[i]);
    return check_complete(result);
}
