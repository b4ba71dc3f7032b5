/* Corners of a leaf's triangles in the order of the axes of each lane: by choosing, for sets without lookups. */

/* How flights side by side turn axes of space. */
typedef struct HYI_I(hyi_frames) {
    HYI_MW y, z; /* the largest component of the direction is z, or else y, or else x */
} HYI_I(hyi_frames);

/* axis: hyi_aim.axis of all lanes. */
HYI_INLINE HYI_TARGET HYI_I(hyi_frames) HYI_I(hyi_frames_of)(const HYI_FW axis[3]) {
    HYI_I(hyi_frames) frames;
    frames.y = HYI_SAMEW(axis[2], HYI_I(hyi_whole)(1));
    frames.z = HYI_SAMEW(axis[2], HYI_I(hyi_whole)(2));
    return frames;
}

typedef struct HYI_I(hyi_leaf_all) {
    const float *rows;
    uint32_t count;
} HYI_I(hyi_leaf_all);

HYI_INLINE HYI_I(hyi_leaf_all) HYI_I(hyi_open_leaf)(const float *rows, uint32_t count) {
    HYI_I(hyi_leaf_all) leaf;
    leaf.rows = rows;
    leaf.count = count;
    return leaf;
}

/* Corner k of a triangle: its coordinates in the order of axis. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_turn_corner)(const HYI_I(hyi_frames) *frames, const HYI_I(hyi_leaf_all) *leaf, uint32_t triangle, uint32_t k, HYI_FW turned[3]) {
    const float *row = leaf->rows + 3u * k * leaf->count + triangle;
    const HYI_FW v[3] = {HYI_SETW(row[0]), HYI_SETW(row[leaf->count]), HYI_SETW(row[2u * leaf->count])};
    for (uint32_t i = 0; i < 3u; i++) turned[i] = HYI_CHOOSEW(frames->z, v[i], HYI_CHOOSEW(frames->y, v[(i + 2u) % 3u], v[(i + 1u) % 3u]));
}
