/* camera.h: which camera renders, and how large the picture is */
#ifndef CAMERA_H
#define CAMERA_H

#include "import.h"
#include "options.h"

/* Fills the sensor and what is missing of options->width and height. After the commit: without any camera all
   of the scene comes into view. APP_DONE, or the exit code after a message. */
int camera_choose(hydra_sensor_desc *sensor, render_options *options, const imported *scene_file, const hydra_scene *scene);

#endif
