/* ---- one ray (expanded once for each instruction set, in its words: HYI_F8 is eight floats, HYI_M8 eight truths, and
   HYI_PIN8 keeps values as rounded) */

/* Eight boxes against one ray; the planes come in the order in which it meets them. */
HYI_INLINE HYI_TARGET HYI_M8 HYI_I(hyi_meet_boxes)(const hyi_aim *aim, const HYI_F8 near_planes[3], const HYI_F8 far_planes[3], HYI_F8 *enter) {
    HYI_F8 ix = HYI_SET8(aim->inverse[0]), iy = HYI_SET8(aim->inverse[1]), iz = HYI_SET8(aim->inverse[2]);
    HYI_F8 nx = HYI_MAD8(near_planes[0], ix, HYI_SET8(aim->near_offset[0]));
    HYI_F8 ny = HYI_MAD8(near_planes[1], iy, HYI_SET8(aim->near_offset[1]));
    HYI_F8 nz = HYI_MAD8(near_planes[2], iz, HYI_SET8(aim->near_offset[2]));
    HYI_F8 fx = HYI_MAD8(far_planes[0], ix, HYI_SET8(aim->far_offset[0]));
    HYI_F8 fy = HYI_MAD8(far_planes[1], iy, HYI_SET8(aim->far_offset[1]));
    HYI_F8 fz = HYI_MAD8(far_planes[2], iz, HYI_SET8(aim->far_offset[2]));
    *enter = HYI_MAX8(HYI_MAX8(nx, ny), HYI_MAX8(nz, HYI_SET8(aim->t_near)));
    return HYI_LE8(*enter, HYI_MIN8(HYI_MIN8(fx, fy), HYI_MIN8(fz, HYI_SET8(aim->t_far))));
}

/* Bits of the children that the ray meets, and where it enters them. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_visit_node)(const hyi_aim *aim, const hyi_node *node, float enter[8]) {
    HYI_F8 near_planes[3], far_planes[3], t;
    for (int a = 0; a < 3; a++) {
        near_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a]]);
        far_planes[a] = HYI_LOAD8(node->planes[aim->near_plane[a] ^ 1u]);
    }
    uint32_t mask = HYI_BITS8(HYI_I(hyi_meet_boxes)(aim, near_planes, far_planes, &t));
    HYI_STORE8(enter, t);
    return mask;
}

/* A corner in the sheared frame, eight triangles at once. */
typedef struct HYI_I(hyi_corners) {
    HYI_F8 x, y, z;
} HYI_I(hyi_corners);

HYI_INLINE HYI_TARGET HYI_I(hyi_corners) HYI_I(hyi_shear_corners)(const hyi_aim *aim, const float *row, uint32_t stride) {
    HYI_I(hyi_corners) p;
    p.z = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[2] * stride), HYI_SET8(aim->origin[2])));
    HYI_F8 dx = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[0] * stride), HYI_SET8(aim->origin[0])));
    HYI_F8 dy = HYI_PIN8(HYI_SUB8(HYI_LOADU8(row + aim->axis[1] * stride), HYI_SET8(aim->origin[1])));
    p.x = HYI_PIN8(HYI_SUB8(dx, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[0]), p.z))));
    p.y = HYI_PIN8(HYI_SUB8(dy, HYI_PIN8(HYI_MUL8(HYI_SET8(aim->shear[1]), p.z))));
    return p;
}

/* p.x q.y - p.y q.x */
HYI_INLINE HYI_TARGET HYI_F8 HYI_I(hyi_cross)(HYI_I(hyi_corners) p, HYI_I(hyi_corners) q) {
    return HYI_SUB8(HYI_PIN8(HYI_MUL8(p.x, q.y)), HYI_PIN8(HYI_MUL8(p.y, q.x)));
}

/* Bits of the triangles that need a closer look: edge functions not of both signs, and not all corners beyond one of the
   limits, since t of a hit is a mean of t at the corners. Lanes past count hold other triangles of the tree, or zeros. */
HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_meet_triangles)(const hyi_aim *aim, const float *rows, uint32_t count) {
    HYI_I(hyi_corners) p = HYI_I(hyi_shear_corners)(aim, rows, count);
    HYI_I(hyi_corners) q = HYI_I(hyi_shear_corners)(aim, rows + 3u * count, count);
    HYI_I(hyi_corners) r = HYI_I(hyi_shear_corners)(aim, rows + 6u * count, count);
    HYI_F8 a = HYI_I(hyi_cross)(r, q), b = HYI_I(hyi_cross)(p, r), c = HYI_I(hyi_cross)(q, p), scale = HYI_SET8(aim->inverse_z);
    HYI_M8 below = HYI_LT8(HYI_MIN8(HYI_MIN8(a, b), c), HYI_ZERO8()), above = HYI_LT8(HYI_ZERO8(), HYI_MAX8(HYI_MAX8(a, b), c));
    HYI_F8 ta = HYI_MUL8(p.z, scale), tb = HYI_MUL8(q.z, scale), tc = HYI_MUL8(r.z, scale);
    HYI_M8 late = HYI_LT8(HYI_SET8(aim->t_far), HYI_MIN8(HYI_MIN8(ta, tb), tc));
    HYI_M8 early = HYI_LT8(HYI_MAX8(HYI_MAX8(ta, tb), tc), HYI_SET8(aim->t_near));
    return ~HYI_BITS8(HYI_OR8(HYI_AND8(below, above), HYI_OR8(late, early))) & ((1u << count) - 1u);
}

/* Offers a leaf's triangles to a ray. Returns whether one was a hit. */
HYI_INLINE HYI_TARGET bool HYI_I(hyi_offer_leaf)(const hyi_site *site, hyi_flight *flight, uint32_t leaf, bool any) {
    uint32_t mask = HYI_I(hyi_meet_triangles)(&flight->aim, hyi_leaf_rows(site->bvh, leaf), hyi_leaf_count(leaf));
    bool found = false;
    for (; mask; mask &= mask - 1u) {
        found = hyi_offer(site, flight, leaf, hyi_lowest_bit(mask)) || found;
        if (found && any) break;
    }
    return found;
}

/* One ray through a tree of triangles, from child at on. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_walk_triangles)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    const hyi_node *nodes = site->bvh->nodes;
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        while (!hyi_child_is_leaf(at)) {
            const hyi_node *node = &nodes[at];
            float enter[8];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            at = HYI_CHILD_NONE;
            if (!mask) break;
            uint32_t first = hyi_lowest_bit(mask);
            mask &= mask - 1u;
            at = node->child[first];
            if (mask) at = hyi_push_farther(&top, node->child, enter, first, mask);
        }
        if (at != HYI_CHILD_NONE) {
            if (HYI_I(hyi_offer_leaf)(site, flight, at, any) && any) return;
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_closest)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, false);
}

HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_any)(const hyi_site *site, hyi_flight *flight, uint32_t at) {
    HYI_I(hyi_walk_triangles)(site, flight, at, true);
}

/* One ray through a tree of boxes; visit is called for each box met and says whether to stop. */
HYI_NOINLINE HYI_TARGET void HYI_I(hyi_walk_boxes)(const hyi_bvh *bvh, hyi_flight *flight, uint32_t at, hyi_box_visit visit, void *argument) {
    hyi_waiting stack[HYI_STACK], *top = stack;
    for (;;) {
        if (hyi_child_is_leaf(at)) {
            if (visit(argument, flight, bvh->ids[hyi_leaf_first(at)])) return;
        } else {
            float enter[8];
            const hyi_node *node = &bvh->nodes[at];
            uint32_t mask = HYI_I(hyi_visit_node)(&flight->aim, node, enter);
            if (mask) {
                uint32_t nearest = hyi_push_farther(&top, node->child, enter, hyi_lowest_bit(mask), mask & (mask - 1u));
                top->child = nearest;
                top++->t = -FLT_MAX;
            }
        }
        do {
            if (top == stack) return;
            top--;
        } while (top->t > flight->aim.t_far);
        at = top->child;
    }
}

/* One of the instances that a ray meets; argument: hyi_visit_of. */
HYI_FN HYI_TARGET bool HYI_I(hyi_visit_instance)(void *argument, hyi_flight *flight, uint32_t item) {
    const hyi_visit_of *of = (const hyi_visit_of *)argument;
    hyi_site site = hyi_site_of_item(of->accel, item);
    hyi_flight below;
    if (!hyi_flight_enter(&below, flight, &site)) return false;
    if (of->any) HYI_I(hyi_walk_any)(&site, &below, site.bvh->root);
    else HYI_I(hyi_walk_closest)(&site, &below, site.bvh->root);
    return hyi_flight_return(flight, &below) && of->any;
}

/* One ray through the scene, or through what is left of it below a child of its first tree. */
HYI_FN HYI_TARGET void HYI_I(hyi_walk_scene)(const hyi_site *site, hyi_flight *flight, uint32_t at, bool any) {
    hyi_visit_of of;
    if (site->bvh->rows && any) {
        HYI_I(hyi_walk_any)(site, flight, at);
    } else if (site->bvh->rows) {
        HYI_I(hyi_walk_closest)(site, flight, at);
    } else {
        of.accel = site->accel;
        of.any = any;
        HYI_I(hyi_walk_boxes)(site->bvh, flight, at, HYI_I(hyi_visit_instance), &of);
    }
}
