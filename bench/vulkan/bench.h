/* What the files of bench/vulkan share. Scenes, ray sets and medians are those of bench/rays (see borrowed.c); here are
   sides: a processor's instruction set with a number of threads, or a Vulkan device, with a scene committed on it. */
#ifndef BENCH_VULKAN_H
#define BENCH_VULKAN_H

#include "hydra.h"
#include "hydra_vk.h"

#include "../rays/rays.h"

#include <stdio.h>

typedef struct options {
    bool quick;
    const char *only; /* parts to run, with commas; NULL: all */
    int repeats;
    size_t triangles;
    uint32_t width;        /* primary rays: width^2 */
    uint32_t side;         /* of pictures, in pixels */
    double least_seconds;  /* what is quicker is done several times within one measurement */
    double render_seconds; /* that one render is to take */
    const char *files[16];
    int file_count;
} options;

/* ---- sides (sides.c) */

enum { MAX_SIDES = 24 };

typedef struct side {
    char name[64];
    uint32_t device_number; /* of hydra_vk_list_devices; 0: the processor, by hydra itself */
    bool lavapipe;
    hydra_isa isa;
    uint32_t threads;       /* processor: of the context, and that cast rays; lavapipe: that it has; other devices: 0 */
    hydra_context *context; /* while open */
    hydra_scene *scene;
    bool borrowed; /* both belong to another side */
    double commit_seconds;
} side;

typedef struct sides {
    side list[MAX_SIDES];
    int count;
    int truth; /* the one whose answers the others' are held against: best instruction set, one thread */
} sides;

/* Prints what there is, and what is left out and why. */
void sides_find(sides *s);
typedef void (*scene_maker)(hydra_scene *scene, const void *what);
/* A context and the scene for every side. share: sides of one instruction set share theirs, which does for rays. */
void sides_open(sides *s, scene_maker make, const void *what, bool share);
void sides_close(sides *s);
/* The scalar side with as many threads as this one uses, or all there are; NULL: no such side. */
const side *sides_scalar_peer(const sides *s, const side *one);
/* One context of a side, to be destroyed by the caller. cache: what hydra_vk_save_pipelines gave, or NULL. */
hydra_context *side_create(const side *one, const void *cache, size_t cache_size);
hydra_vk_info side_info(const side *one);  /* zeroed for the processor */
double side_busy_seconds(const side *one); /* that submissions took so far */
typedef struct slices {
    uint64_t count;
    double seconds, longest;
} slices;
/* Those since device_forget_slices. */
void slices_add(slices *sum, const side *one);
void slices_print(const slices *sum);

/* ---- parts of the run */

void bench_latency(const options *o, const sides *s, const char *program);
/* The child that bench_latency starts: main's arguments after "--latency". */
int latency_child(int argc, char **argv);
void bench_rays(const options *o, sides *s);
void bench_paths(const options *o, sides *s);
void bench_films(const options *o, const sides *s);

/* Scenes with lights (pictures.c). */
void make_box(hydra_scene *scene, const void *unused);
void make_outdoors(hydra_scene *scene, const void *geometry);

/* ---- inside the library (device.c) */

/* Of all of a scene's buffers on its device; nodes, slots: of the trees. */
typedef struct device_bytes {
    uint64_t all, nodes, slots;
} device_bytes;
device_bytes device_scene_bytes(const hydra_scene *scene);
/* Bytes a second that a device reads and writes while it copies what no cache holds; 0: it could not. */
double device_copy_speed(const side *one);
/* So that what hydra_vk_info tells of submissions is of those that follow: the first wait for compilers. */
void device_forget_slices(hydra_context *context);

/* What a ray takes from the device's trees, mean over the set. */
typedef struct traffic {
    double nodes, slots, bytes;
} traffic;
traffic device_traffic(const hydra_scene *processor_scene, const ray_set *set, bool any);

/* ---- goals (main.c) */

typedef enum wish { AT_LEAST, AT_MOST } wish;
void goal(const char *name, double measured, wish w, double target);
/* Processor time of the whole program. */
double processor_seconds(void);
FILE *open_csv(const char *name, const char *header);

#endif
