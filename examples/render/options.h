/* options.h: the command line */
#ifndef OPTIONS_H
#define OPTIONS_H

#include "image_io.h"

#include "hydra.h"

enum { OPTIONS_TARGETS = 32 };

typedef struct render_options {
    const char *scene_path;
    image_target targets[OPTIONS_TARGETS];
    size_t target_count;
    uint32_t width, height; /* 0: not given */
    uint32_t spp, threads, seed, depth;
    double seconds;
    float error;
    hydra_strategy strategy;
    const char *camera;         /* NULL: the file's first, else framing */
    const char *environment;    /* file, or R,G,B; NULL: none */
    float environment_rotation; /* degrees */
    bool has_sun;
    float sun[5];     /* towards the sun; irradiance; angular diameter in degrees */
    uint32_t outputs; /* bits of hydra_output beside those that are always there */
    image_tone tone;
    const char *vulkan; /* part of the name of a Vulkan device, "" for the best; NULL: the processor */
    bool stats;
} render_options;

typedef enum options_result { OPTIONS_RUN, OPTIONS_SHOWN, OPTIONS_WRONG } options_result;

/* OPTIONS_SHOWN: --help or --version was printed. OPTIONS_WRONG: the message stands on stderr. */
options_result options_parse(render_options *result, int argc, char **argv);

/* Reads minimum to maximum numbers with commas between them; 0 unless the whole text is that. */
size_t options_numbers(const char *text, float *numbers, size_t minimum, size_t maximum);

#endif
