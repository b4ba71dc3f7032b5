/* >>scene-trees: the trees over meshes: loaded, built, or fitted to vertices that moved; and saved

   A tree is known by the hash of what it was built from, not by the mesh or scene it served. */
#ifndef HYI_TREES_H
#define HYI_TREES_H

#include "meshes.h"

/* ---- what a tree is built from */

typedef struct hyi_tree_source {
    const float *positions;
    const uint32_t *indices;
    uint32_t triangle_count;
    hydra_build build;
    uint64_t fingerprint; /* 0: no loaded tree can be meant */
} hyi_tree_source;

HYI_FN uint64_t hyi_mix_mesh(uint64_t hash, const hyi_mesh_slot *mesh) {
    const uint32_t counts[2] = { mesh->vertex_count, mesh->triangle_count };
    hash = hyi_hash(hash, counts, sizeof counts);
    hash = hyi_hash(hash, mesh->positions, (size_t)3 * mesh->vertex_count * sizeof *mesh->positions);
    return hyi_hash(hash, mesh->indices, (size_t)3 * mesh->triangle_count * sizeof *mesh->indices);
}

HYI_FN uint64_t hyi_mesh_fingerprint(const hyi_mesh_slot *mesh) { return hyi_mix_mesh((uint64_t)mesh->build, mesh); }

/* FAST only if all its meshes are. */
HYI_FN hydra_build hyi_world_build(const hydra_scene *scene) {
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (hyi_in_world(&scene->meshes[i]) && scene->meshes[i].build != HYDRA_BUILD_FAST) return HYDRA_BUILD_BEST;
    return HYDRA_BUILD_FAST;
}

HYI_FN uint64_t hyi_world_fingerprint(const hydra_scene *scene) {
    uint64_t hash = (uint64_t)hyi_world_build(scene);
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (hyi_in_world(&scene->meshes[i])) hash = hyi_mix_mesh(hash, &scene->meshes[i]);
    return hash;
}

/* Hashing is left out where it can lead to nothing. */
HYI_FN bool hyi_expects_loaded(const hydra_scene *scene, size_t triangle_count) {
    bool expects = false;
    for (size_t i = 0; i < scene->loaded_count; i++)
        expects = expects || (scene->loaded[i].bvh.ids && scene->loaded[i].record.triangle_count == triangle_count);
    return expects;
}

/* ---- a tree: the loaded one that fits, else a new one */

HYI_FN hydra_result hyi_take_loaded(hydra_scene *scene, const hyi_tree_source *source, hyi_bvh *bvh, hyi_quality *quality, bool *taken) {
    *taken = false;
    for (size_t i = 0; i < scene->loaded_count && !*taken; i++) {
        hyi_loaded_tree *loaded = &scene->loaded[i];
        if (!loaded->bvh.ids || loaded->record.triangle_count != source->triangle_count) continue;
        if (loaded->record.fingerprint != source->fingerprint) continue;
        HYI_TRY(hyi_bvh_adopt(scene->context, source->positions, source->indices, source->triangle_count, &loaded->bvh, taken));
        if (!*taken) hyi_bvh_free(scene->context, &loaded->bvh);
        *bvh = loaded->bvh;
        memset(&loaded->bvh, 0, sizeof loaded->bvh);
        quality->cost = hyi_bvh_cost(bvh);
        quality->cost_when_built = loaded->record.cost_when_built;
        quality->refitted = loaded->record.refitted != 0;
    }
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_tree(hydra_scene *scene, const hyi_tree_source *source, hyi_bvh *bvh, hyi_quality *quality) {
    bool taken = false;
    if (source->fingerprint) HYI_TRY(hyi_take_loaded(scene, source, bvh, quality, &taken));
    if (taken) {
        scene->info.trees_loaded++;
        return HYDRA_OK;
    }
    HYI_TRY(hyi_bvh_build_triangles(scene->context, source->positions, source->indices, source->triangle_count, source->build, bvh, &quality->cost));
    quality->cost_when_built = quality->cost;
    quality->refitted = false;
    scene->info.meshes_built++;
    return HYDRA_OK;
}

/* ---- trees of single meshes */

/* Marks the meshes that need a tree of their own. */
HYI_FN hydra_result hyi_mark_own_trees(hydra_scene *scene, uint8_t **marks) {
    HYI_TRY(hyi_alloc_array(scene->context, marks, scene->mesh_count));
    for (size_t i = 0; i < scene->mesh_count; i++)
        (*marks)[i] = scene->meshes[i].alive && !scene->meshes[i].instanced_only && scene->meshes[i].dynamic ? 1 : 0;
    for (size_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].alive) (*marks)[scene->instances[i].mesh] = 1;
    return HYDRA_OK;
}

/* A tree that cannot be refitted goes. After an error it waits for another try. */
HYI_FN hydra_result hyi_refit_own_tree(hydra_scene *scene, hyi_mesh_slot *mesh) {
    bool fits;
    HYI_TRY(hyi_bvh_refit(scene->context, mesh->positions, mesh->indices, mesh->triangle_count, &mesh->bvh, &fits, &mesh->quality.cost));
    if (!fits) hyi_bvh_free(scene->context, &mesh->bvh);
    mesh->built = mesh->quality.refitted = fits;
    mesh->moved = false;
    scene->info.meshes_refitted += fits ? 1u : 0u;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_make_own_tree(hydra_scene *scene, hyi_mesh_slot *mesh) {
    hyi_tree_source source;
    source.positions = mesh->positions;
    source.indices = mesh->indices;
    source.triangle_count = mesh->triangle_count;
    source.build = mesh->build;
    source.fingerprint = hyi_expects_loaded(scene, mesh->triangle_count) ? hyi_mesh_fingerprint(mesh) : 0u;
    HYI_TRY(hyi_make_tree(scene, &source, &mesh->bvh, &mesh->quality));
    mesh->built = true;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_commit_own_trees(hydra_scene *scene) {
    uint8_t *marks;
    HYI_TRY(hyi_mark_own_trees(scene, &marks));
    hydra_result result = HYDRA_OK;
    for (size_t i = 0; i < scene->mesh_count && result == HYDRA_OK; i++) {
        hyi_mesh_slot *mesh = &scene->meshes[i];
        if (mesh->built && mesh->moved) result = hyi_refit_own_tree(scene, mesh);
        if (result == HYDRA_OK && !mesh->built && marks[i]) result = hyi_make_own_tree(scene, mesh);
    }
    hyi_free_array(scene->context, &marks, scene->mesh_count);
    return result;
}

/* ---- the tree over all meshes that stand unmoved */

/* All meshes of the world behind each other, for the time of the build. */
typedef struct hyi_world_arrays {
    float *positions;
    uint32_t *indices;
    size_t vertices, triangles;
} hyi_world_arrays;

HYI_FN void hyi_fill_world(const hydra_scene *scene, hyi_world_arrays *w) {
    size_t vertex = 0, triangle = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const hyi_mesh_slot *mesh = &scene->meshes[i];
        if (!hyi_in_world(mesh)) continue;
        memcpy(w->positions + 3 * vertex, mesh->positions, (size_t)3 * mesh->vertex_count * sizeof *w->positions);
        for (size_t c = 0; c < (size_t)3 * mesh->triangle_count; c++) w->indices[3 * triangle + c] = mesh->indices[c] + (uint32_t)vertex;
        vertex += mesh->vertex_count;
        triangle += mesh->triangle_count;
    }
}

HYI_FN hydra_result hyi_make_world_tree(hydra_scene *scene, const float *positions, const uint32_t *indices, size_t triangles) {
    hyi_tree_source source;
    source.positions = positions;
    source.indices = indices;
    source.triangle_count = (uint32_t)triangles;
    source.build = hyi_world_build(scene);
    source.fingerprint = hyi_expects_loaded(scene, triangles) ? hyi_world_fingerprint(scene) : 0u;
    return hyi_make_tree(scene, &source, &scene->world, &scene->world_quality);
}

HYI_FN hydra_result hyi_make_joined_world(hydra_scene *scene, hyi_world_arrays *w) {
    hydra_context *context = scene->context;
    if (w->vertices > UINT32_MAX || w->triangles > UINT32_MAX)
        return hyi_fail(context, HYDRA_ERROR_COUNT, "%zu vertices and %zu triangles in meshes that are not dynamic", w->vertices, w->triangles);
    HYI_TRY(hyi_alloc_array(context, &w->positions, 3 * w->vertices));
    hydra_result result = hyi_alloc_array(context, &w->indices, 3 * w->triangles);
    if (result == HYDRA_OK) {
        hyi_fill_world(scene, w);
        result = hyi_make_world_tree(scene, w->positions, w->indices, w->triangles);
    }
    hyi_free_array(context, &w->positions, 3 * w->vertices);
    hyi_free_array(context, &w->indices, 3 * w->triangles);
    return result;
}

HYI_FN bool hyi_world_is_fresh(const hydra_scene *scene) {
    bool fresh = !scene->world_stale;
    for (size_t i = 0; i < scene->mesh_count; i++) fresh = fresh && scene->meshes[i].in_world == hyi_in_world(&scene->meshes[i]);
    return fresh;
}

/* From a mesh's own arrays where there is only one. */
HYI_FN hydra_result hyi_commit_world(hydra_scene *scene) {
    hyi_world_arrays w = { NULL, NULL, 0, 0 };
    const hyi_mesh_slot *only = NULL;
    size_t count = 0, at = 0;
    for (size_t i = 0; i < scene->mesh_count; i++) count += hyi_in_world(&scene->meshes[i]) ? 1u : 0u;
    hyi_free_world(scene);
    HYI_TRY(hyi_alloc_array(scene->context, &scene->world_first, count));
    scene->world_count = count;
    for (size_t i = 0; i < scene->mesh_count; i++) {
        if (!hyi_in_world(&scene->meshes[i])) continue;
        only = &scene->meshes[i];
        scene->world_first[at++] = (uint32_t)w.triangles;
        w.vertices += only->vertex_count;
        w.triangles += only->triangle_count;
    }
    if (count == 1) HYI_TRY(hyi_make_world_tree(scene, only->positions, only->indices, only->triangle_count));
    if (count > 1) HYI_TRY(hyi_make_joined_world(scene, &w));
    for (size_t i = 0; i < scene->mesh_count; i++) scene->meshes[i].in_world = hyi_in_world(&scene->meshes[i]);
    scene->world_stale = false;
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_commit_trees(hydra_scene *scene) {
    double start = hyi_seconds();
    HYI_TRY(hyi_commit_own_trees(scene));
    if (!hyi_world_is_fresh(scene)) HYI_TRY(hyi_commit_world(scene));
    scene->info.build_seconds += hyi_seconds() - start;
    return HYDRA_OK;
}

/* ---- what became of them */

/* Measured on a torus of 65 536 triangles that was twisted, bent, made to ripple and jittered: where the cost had grown by
   half, rays took 1.1 to 1.4 times as long as on a tree built for that shape; at four times, 2 to 2.5. Below half a build
   gained little. Triangles that no tree can part (jitter) made the cost grow tenfold and a build gain 1.2. */
#define HYI_REBUILD_PAYS 1.5f

/* A tree as it stands, with what it was made from: the world's, or of a mesh. */
typedef struct hyi_kept_tree {
    const hyi_bvh *bvh;
    const hyi_quality *quality;
    const hyi_mesh_slot *mesh; /* NULL: the world */
} hyi_kept_tree;

HYI_FN hyi_kept_tree hyi_world_tree(const hydra_scene *scene) {
    hyi_kept_tree tree;
    tree.bvh = &scene->world;
    tree.quality = &scene->world_quality;
    tree.mesh = NULL;
    return tree;
}

HYI_FN hyi_kept_tree hyi_own_tree(const hyi_mesh_slot *mesh) {
    hyi_kept_tree tree;
    tree.bvh = &mesh->bvh;
    tree.quality = &mesh->quality;
    tree.mesh = mesh;
    return tree;
}

HYI_FN uint64_t hyi_count_degenerate(const hyi_mesh_slot *mesh) {
    uint64_t count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *index = mesh->indices + (size_t)3 * t;
        const float *p = mesh->positions;
        count += hyi_triangle_is_degenerate(p + (size_t)3 * index[0], p + (size_t)3 * index[1], p + (size_t)3 * index[2]) ? 1u : 0u;
    }
    return count;
}

HYDRA_API hydra_result hydra_scene_get_mesh_info(const hydra_scene *scene, hydra_mesh mesh, hydra_mesh_info *info) {
    HYI_TRY(hyi_check_committed(scene));
    if (!info) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "info");
    HYI_TRY(hyi_check_mesh_handle(scene, mesh, "hydra_scene_get_mesh_info"));
    const hyi_mesh_slot *slot = &scene->meshes[mesh.id - 1];
    hyi_kept_tree tree = slot->built || !slot->in_world ? hyi_own_tree(slot) : hyi_world_tree(scene);
    memset(info, 0, sizeof *info);
    info->triangles = slot->triangle_count;
    info->degenerate = slot->built ? slot->bvh.degenerate : hyi_count_degenerate(slot);
    info->shared = !tree.mesh;
    info->bytes_bvh = tree.bvh->bytes;
    if (tree.bvh->primitive_count == 0) return HYDRA_OK;
    info->cost = tree.quality->cost;
    info->cost_when_built = tree.quality->cost_when_built;
    info->refitted = tree.quality->refitted;
    info->rebuild_advised = info->refitted && info->cost > HYI_REBUILD_PAYS * info->cost_when_built;
    return HYDRA_OK;
}

/* ---- save */

/* The i-th of all trees that may be there, of which mesh_count + 1; false: there is none, or nothing in it. */
HYI_FN bool hyi_tree_to_save(const hydra_scene *scene, size_t i, hyi_kept_tree *tree) {
    *tree = i == 0 ? hyi_world_tree(scene) : hyi_own_tree(&scene->meshes[i - 1]);
    return tree->bvh->primitive_count != 0;
}

HYI_FN hyi_trees_header hyi_describe_trees(const hydra_scene *scene) {
    hyi_trees_header header;
    hyi_kept_tree tree;
    memset(&header, 0, sizeof header);
    header.magic = HYI_TREES_MAGIC;
    header.version = HYI_TREES_VERSION;
    header.layout = hyi_trees_layout();
    header.size = sizeof header;
    for (size_t i = 0; i <= scene->mesh_count; i++) {
        if (!hyi_tree_to_save(scene, i, &tree)) continue;
        header.size += hyi_tree_bytes(tree.bvh);
        header.tree_count++;
    }
    return header;
}

HYI_FN unsigned char *hyi_save_tree(unsigned char *out, const hydra_scene *scene, const hyi_kept_tree *tree) {
    hyi_tree_record record;
    memset(&record, 0, sizeof record);
    record.fingerprint = tree->mesh ? hyi_mesh_fingerprint(tree->mesh) : hyi_world_fingerprint(scene);
    if (tree->mesh) record.triangle_count = tree->mesh->triangle_count;
    for (size_t i = 0; !tree->mesh && i < scene->mesh_count; i++)
        if (scene->meshes[i].in_world) record.triangle_count += scene->meshes[i].triangle_count;
    record.cost_when_built = tree->quality->cost_when_built;
    record.refitted = tree->quality->refitted ? 1u : 0u;
    return hyi_put_tree(out, tree->bvh, record);
}

HYDRA_API hydra_result hydra_scene_save_trees(const hydra_scene *scene, void *buffer, size_t *size) {
    HYI_TRY(hyi_check_committed(scene));
    if (!size) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "size");
    hyi_trees_header header = hyi_describe_trees(scene);
    size_t room = *size;
    *size = (size_t)header.size;
    if (!buffer) return HYDRA_OK;
    if (room < *size) return hyi_fail(scene->context, HYDRA_ERROR_BUFFER, "%zu bytes for trees of %zu", room, *size);
    hyi_kept_tree tree;
    unsigned char *begin = (unsigned char *)buffer, *out = hyi_put(begin, &header, sizeof header);
    for (size_t i = 0; i <= scene->mesh_count; i++)
        if (hyi_tree_to_save(scene, i, &tree)) out = hyi_save_tree(out, scene, &tree);
    header.checksum = hyi_hash(HYI_TREES_MAGIC, begin + HYI_TREES_CHECKED_FROM, *size - HYI_TREES_CHECKED_FROM);
    (void)hyi_put(begin, &header, sizeof header);
    return HYDRA_OK;
}

/* ---- load */

HYI_FN hydra_result hyi_check_trees_header(hydra_context *context, const unsigned char *data, size_t size, hyi_trees_header *header) {
    if (size < sizeof *header) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes", size);
    memcpy(header, data, sizeof *header);
    if (header->magic != HYI_TREES_MAGIC) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "these are no trees, or of another byte order");
    if (header->version != HYI_TREES_VERSION)
        return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "version %u, this is version %u", header->version, HYI_TREES_VERSION);
    if (header->size != size) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes of %llu", size, (unsigned long long)header->size);
    if (header->checksum != hyi_hash(HYI_TREES_MAGIC, data + HYI_TREES_CHECKED_FROM, size - HYI_TREES_CHECKED_FROM))
        return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "the checksum does not fit");
    if (header->layout != hyi_trees_layout()) return hyi_fail(context, HYDRA_ERROR_TREE_FORMAT, "nodes of another layout");
    return HYDRA_OK;
}

/* Reads one tree behind those that are there. */
HYI_FN hydra_result hyi_load_tree(hydra_scene *scene, hyi_bytes *in) {
    HYI_TRY(hyi_grow_array(scene->context, &scene->loaded, &scene->loaded_capacity, scene->loaded_count + 1));
    hyi_loaded_tree *loaded = &scene->loaded[scene->loaded_count];
    bool sound;
    hydra_result result = hyi_get_tree(scene->context, in, &loaded->record, &loaded->bvh, &sound);
    if (result == HYDRA_OK && !sound) result = hyi_fail(scene->context, HYDRA_ERROR_TREE_FORMAT, "tree %zu is impossible", scene->loaded_count);
    if (result != HYDRA_OK) hyi_bvh_free(scene->context, &loaded->bvh);
    else scene->loaded_count++;
    return result;
}

HYI_FN hydra_result hyi_load_all(hydra_scene *scene, hyi_bytes *in, uint32_t tree_count) {
    for (uint32_t i = 0; i < tree_count; i++) HYI_TRY(hyi_load_tree(scene, in));
    return in->left == 0 ? HYDRA_OK : hyi_fail(scene->context, HYDRA_ERROR_TREE_FORMAT, "%zu bytes too many", in->left);
}

HYDRA_API hydra_result hydra_scene_load_trees(hydra_scene *scene, const void *data, size_t size) {
    HYI_TRY(hyi_scene_editable(scene, scene, "hydra_scene_load_trees"));
    if (!data) return hyi_fail(scene->context, HYDRA_ERROR_NULL, "data");
    hyi_trees_header header;
    hyi_bytes in;
    in.at = (const unsigned char *)data;
    in.left = size;
    HYI_TRY(hyi_check_trees_header(scene->context, in.at, size, &header));
    in.at += sizeof header;
    in.left -= sizeof header;
    size_t before = scene->loaded_count;
    hydra_result result = hyi_load_all(scene, &in, header.tree_count);
    while (result != HYDRA_OK && scene->loaded_count > before) hyi_bvh_free(scene->context, &scene->loaded[--scene->loaded_count].bvh);
    return result;
}

#endif /* HYI_TREES_H */
