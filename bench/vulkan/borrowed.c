/* What bench/rays has of use here: triangles, scenes made of code, OBJ files, rays, medians. */
#include "bench.h"

#include "../rays/geometry.c"
#include "../rays/measure.c"
#include "../rays/obj.c"
#include "../rays/raysets.c"

#define set_cross scenes_set_cross /* raysets.c has one too */
#include "../rays/scenes.c"
