/* What the tests of bad input share: a scene that must survive everything, and a mesh to spoil. */
#ifndef INPUT_HELPERS_H
#define INPUT_HELPERS_H

#include "truth_helpers.h"

static inline void open_good(truth_world *world) {
    truth_open(world);
    truth_scene_mesh(world->scene, truth_mesh_quad(truth_v(0, 0, -2), truth_v(1, 0, 0), truth_v(0, 1, 0), 1), truth_emitter(world->scene, 0.5, 3));
    truth_commit(world);
}

/* The scene still commits, and still shows what it showed. */
static inline void expect_usable(truth_world *world) {
    TRUTH_RESULT(world->context, hydra_scene_commit(world->scene), HYDRA_OK);
    truth_probe probe;
    memset(&probe, 0, sizeof probe);
    probe.samples = 2;
    probe.max_depth = 1;
    TRUTH_NEAR("radiance of the good mesh", truth_radiance(world->scene, truth_v(0, 0, 0), truth_v(0, 0.1, -1), probe).mean, 3, 1e-6);
}

/* An add failed: the commit names it once, with a message, and the one after that succeeds. */
static inline void expect_reported(truth_world *world, const char *what, uint32_t id, hydra_result wanted) {
    if (id != 0) fail_msg("%s: was accepted", what);
    hydra_result got = hydra_scene_commit(world->scene);
    if (got != wanted) fail_msg("%s: \"%s\", wanted \"%s\"", what, hydra_result_text(got), hydra_result_text(wanted));
    assert_int_not_equal(strlen(hydra_error_text(world->context)), 0);
    expect_usable(world);
}

typedef struct mesh_input {
    float positions[12], normals[12], uvs[8];
    uint32_t indices[6];
    uint16_t short_indices[6];
    hydra_material materials[2];
    hydra_mesh_desc desc;
} mesh_input;

static inline void good_mesh(mesh_input *m) {
    static const float square[12] = {5, 0, 0, 6, 0, 0, 6, 1, 0, 5, 1, 0}; /* out of the way of the good mesh */
    static const uint32_t order[6] = {0, 1, 2, 0, 2, 3};
    memset(m, 0, sizeof *m);
    memcpy(m->positions, square, sizeof square);
    for (int i = 0; i < 4; i++) m->normals[3 * i + 2] = 1;
    for (int i = 0; i < 6; i++) {
        m->indices[i] = order[i];
        m->short_indices[i] = (uint16_t)order[i];
    }
    m->desc.positions.data = m->positions;
    m->desc.positions.count = 4;
    m->desc.normals.data = m->normals;
    m->desc.normals.count = 4;
    m->desc.uvs.data = m->uvs;
    m->desc.uvs.count = 4;
    m->desc.indices.data = m->indices;
    m->desc.indices.count = 6;
}

#endif /* INPUT_HELPERS_H */
