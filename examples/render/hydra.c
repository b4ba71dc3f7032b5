/* hydra.c: the place where the library's implementation is compiled */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"

#define HYDRA_VK_IMPLEMENTATION
#include "hydra_vk.h"
