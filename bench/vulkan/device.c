/* What only the library's inside can tell: bytes on the device, the speed of its memory, and what rays take from it. */
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#define HYDRA_VK_IMPLEMENTATION
#include "hydra_vk.h"

#include "bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

device_bytes device_scene_bytes(const hydra_scene *scene) {
    const hyi_vk_scene *s = scene->device;
    device_bytes bytes = {0, 0, 0};
    for (uint32_t b = 0; s && b < HYK_SCENE_BINDINGS; b++) bytes.all += s->buffers[b].size;
    if (s) bytes.nodes = s->buffers[HYK_BINDING_NODES].size, bytes.slots = s->buffers[HYK_BINDING_SLOTS].size;
    return bytes;
}

void device_forget_slices(hydra_context *context) {
    hyi_vk *vk = context->device;
    if (!vk) return;
    hyi_vk_acquire(&vk->shared);
    vk->slices = 0;
    vk->slice_total = vk->slice_longest = 0.0;
    hyi_vk_release(&vk->shared);
}

/* ---- the speed of memory */

static double copy_seconds(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_buffer pair[2], int copies) {
    double seconds = 0.0;
    if (hyi_vk_begin(vk, c) != HYDRA_OK) return 0.0;
    hyi_vk_mark(vk, c);
    for (int i = 0; i < copies; i++) {
        hyi_vk_copy(vk, c, &pair[i & 1], &pair[~i & 1], pair[0].size);
        hyi_vk_barrier(vk, c);
    }
    hyi_vk_mark(vk, c);
    if (hyi_vk_submit(vk, c) != HYDRA_OK || hyi_vk_wait(vk, c, &seconds) != HYDRA_OK) return 0.0;
    return seconds;
}

/* Buffers are as large as may be, up to a quarter of a GiB: caches of today's devices hold a tenth of that. */
double device_copy_speed(const side *one) {
    enum { repeats = 5, copies = 4 };
    hydra_context *context = side_create(one, NULL, 0);
    hyi_vk *vk = context->device;
    hyi_vk_commands commands;
    hyi_vk_buffer pair[2];
    double seconds[repeats], speed = 0.0;
    VkDeviceSize bytes = (VkDeviceSize)256 << 20;
    if (bytes > vk->limits.maxStorageBufferRange) bytes = vk->limits.maxStorageBufferRange / 4 * 4;
    memset(&commands, 0, sizeof commands);
    memset(pair, 0, sizeof pair);
    if (hyi_vk_make_commands(vk, &commands) == HYDRA_OK && hyi_vk_make_buffer(vk, &pair[0], HYI_VK_DEVICE, bytes, "copy") == HYDRA_OK &&
        hyi_vk_make_buffer(vk, &pair[1], HYI_VK_DEVICE, bytes, "copy") == HYDRA_OK) {
        copy_seconds(vk, &commands, pair, copies); /* pages of memory are made at first touch */
        for (int i = 0; i < repeats; i++) seconds[i] = copy_seconds(vk, &commands, pair, copies);
        double typical = median(seconds, repeats);
        if (typical > 0.0) speed = 2.0 * copies * (double)bytes / typical;
    }
    hyi_vk_free_buffer(vk, &pair[0]);
    hyi_vk_free_buffer(vk, &pair[1]);
    hyi_vk_free_commands(vk, &commands);
    hydra_destroy(context);
    return speed;
}

/* ---- what rays take: the walk of shaders/traverse.glsl over the same nodes, counted. Boxes and order are the device's;
   the test of a triangle is a plain one, since only the order of hits matters. */

typedef struct walker {
    const uint32_t *nodes;
    const hyk_slot *slots;
    double origin[3], direction[3], inverse[3], t_min, t_max;
    uint32_t octant;
    bool any;
    uint64_t nodes_met, slots_met;
} walker;

static bool meets_child(const walker *w, const uint32_t *node, uint32_t place) {
    const unsigned char *planes = (const unsigned char *)(node + HYK_NODE_PLANES);
    double near = w->t_min, far = w->t_max;
    for (int a = 0; a < 3; a++) {
        float corner;
        memcpy(&corner, &node[HYK_NODE_ORIGIN + a], sizeof corner);
        double step = ldexp(1.0, (int)(node[HYK_NODE_STEPS] >> 8 * a & 255u) - 127);
        double lower = (corner + step * planes[16 * a + place] - w->origin[a]) * w->inverse[a];
        double upper = (corner + step * planes[16 * a + 8 + place] - w->origin[a]) * w->inverse[a];
        near = fmax(near, fmin(lower, upper));
        far = fmin(far, fmax(lower, upper));
    }
    return near <= far;
}

static void cross(double out[3], const double a[3], const double b[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Moeller and Trumbore 1997. */
static bool meets_triangle(walker *w, const hyk_slot *slot) {
    const double a[3] = {slot->a.x, slot->a.y, slot->a.z};
    const double e[3] = {slot->b.x - a[0], slot->b.y - a[1], slot->b.z - a[2]},
                 f[3] = {slot->c.x - a[0], slot->c.y - a[1], slot->c.z - a[2]};
    const double s[3] = {w->origin[0] - a[0], w->origin[1] - a[1], w->origin[2] - a[2]};
    double p[3], q[3];
    cross(p, w->direction, f);
    cross(q, s, e);
    double across = dot(e, p), u = dot(s, p) / across, v = dot(w->direction, q) / across, t = dot(f, q) / across;
    if (!(across != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= w->t_min && t <= w->t_max)) return false;
    w->t_max = t;
    return true;
}

/* Whether a walk for anything is over. leaf: what a node says of it. */
static bool walk_leaf(walker *w, const uint32_t *node, uint32_t leaf) {
    uint32_t first = node[HYK_NODE_SLOTS] + (leaf & 31u);
    for (uint32_t i = 0; i < HYK_LEAF_MOST - (leaf >> 5); i++) {
        w->slots_met++;
        if (meets_triangle(w, &w->slots[first + i]) && w->any) return true;
    }
    return false;
}

/* As on the device, which children a node's ray meets is settled when the node is met, and leaves come before nodes. */
static bool walk_node(walker *w, uint32_t index) {
    const uint32_t *node = w->nodes + (size_t)HYK_NODE_WORDS * index;
    uint32_t met = 0;
    w->nodes_met++;
    for (uint32_t place = 0; place < HYI_WIDTH; place++)
        if (meets_child(w, node, place)) met |= 1u << place;
    for (uint32_t place = 0; place < HYI_WIDTH; place++)
        if ((met >> place & 1u) && walk_leaf(w, node, node[HYK_NODE_LEAVES + place / 4] >> 8 * (place % 4) & 255u)) return true;
    for (uint32_t turn = HYI_WIDTH; turn-- > 0;) {
        uint32_t place = turn ^ w->octant;
        if ((met & node[HYK_NODE_STEPS] >> 24) >> place & 1u && walk_node(w, node[HYK_NODE_CHILDREN] + place)) return true;
    }
    return false;
}

static void aim(walker *w, const hyk_tree *tree, const hydra_ray *ray) {
    w->octant = 0;
    for (int a = 0; a < 3; a++) {
        double d = ray->direction[a];
        w->origin[a] = (double)ray->origin[a] * (double)tree->scale;
        w->direction[a] = d * (double)tree->scale;
        w->inverse[a] = 1.0 / (fabs(w->direction[a]) < 1e-18 ? copysign(1e-18, d) : w->direction[a]);
        if (!(d < 0.0)) w->octant |= 1u << a;
    }
    w->t_min = ray->t_min, w->t_max = ray->t_max;
}

traffic device_traffic(const hydra_scene *scene, const ray_set *set, bool any) {
    const hyi_bvh *bvh = hyi_vk_one_mesh_is_all(scene) ? &scene->view_bvhs[scene->placed[0].mesh] : &scene->world;
    hyi_vk_forest forest = {NULL, NULL, 0, 0};
    forest.nodes = bench_alloc((size_t)4 * HYK_NODE_WORDS * hyi_vk_nodes_of(bvh));
    forest.slots = bench_alloc(sizeof(hyk_slot) * hyi_vk_slots_of(bvh));
    hyk_tree tree = hyi_vk_plant(bvh, &forest);
    walker w = {.nodes = forest.nodes, .slots = forest.slots, .any = any};
    for (size_t i = 0; i < set->count; i++) {
        aim(&w, &tree, &set->rays[i]);
        walk_node(&w, tree.first_node);
    }
    free(forest.nodes);
    free(forest.slots);
    double count = (double)set->count;
    traffic mean = {(double)w.nodes_met / count, (double)w.slots_met / count, sizeof(hyk_ray) + (any ? sizeof(uint32_t) : sizeof(hyk_hit))};
    mean.bytes += mean.nodes * 4.0 * HYK_NODE_WORDS + mean.slots * sizeof(hyk_slot);
    return mean;
}
