/* hydra.c: the place where the library's implementation is compiled */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
