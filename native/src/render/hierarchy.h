/* Bounding volume hierarchy over the world boxes of a scene's instances.
 *
 * A binary tree, depth first: the left child of an inner node follows it, the
 * right one is named. Every leaf holds one instance. A ray's walk is a small
 * stack of its own that can be put aside and taken up again; it yields one
 * instance at a time, near child first by the sign of the direction along the
 * axis of the split (as in Pharr, Jakob, Humphreys: PBR, 7.3).
 *
 * Boxes are f32, rounded outwards: a node is half a cache line.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_HIERARCHY_H
#define LR_HIERARCHY_H

#include "base.h"

#define LR_NOWHERE UINT32_MAX

typedef struct lr_box {
    double lo[3], hi[3]; /* lo > hi: empty */
} lr_box;

enum { LR_LEAF = 3 };

typedef struct lr_node {
    float lo[3], hi[3];
    uint32_t next; /* the right child, or the instance of a leaf */
    uint32_t axis; /* of the split, or LR_LEAF */
} lr_node;

typedef struct lr_hierarchy {
    lr_node *nodes;
    uint32_t n_nodes; /* 0: nothing to hit */
    uint32_t height;  /* entries that a walk's stack needs */
} lr_hierarchy;

/* Over n boxes, fewer than 2^31; empty ones are left out. nodes is freed by the
 * caller. */
lr_status lr_hierarchy_build(const lr_box *boxes, uint32_t n, lr_hierarchy *hierarchy,
                             lr_error *error);

/* Does o + t d cross the box with t in [t_min, t_max]? inv is 1/d; a zero
 * component gives an infinity of its sign, and a product 0 * infinity (the ray
 * runs in a face) NaN, which no comparison takes as a reason to say no. */
LR_INLINE bool lr_node_crossed(const lr_node *node, const double o[3], const double inv[3],
                               double t_min, double t_max)
{
    for (int a = 0; a < 3; a++) {
        const double t_lo = (node->lo[a] - o[a]) * inv[a];
        const double t_hi = (node->hi[a] - o[a]) * inv[a];
        const double t_in = inv[a] < 0 ? t_hi : t_lo;
        const double t_out = inv[a] < 0 ? t_lo : t_hi;
        t_min = t_in > t_min ? t_in : t_min;
        t_max = t_out < t_max ? t_out : t_max;
    }
    return t_min <= t_max;
}

/* The next instance that the ray may meet at t <= t_max, or LR_NOWHERE. The
 * stack begins as {0} with *n = 1. */
LR_INLINE uint32_t lr_hierarchy_next(const lr_hierarchy *hierarchy, const double o[3],
                                     const double inv[3], double t_min, double t_max,
                                     uint32_t *stack, uint32_t *n)
{
    while (*n > 0) {
        const uint32_t at = stack[--*n];
        const lr_node *node = &hierarchy->nodes[at];
        if (!lr_node_crossed(node, o, inv, t_min, t_max))
            continue;
        if (node->axis == LR_LEAF)
            return node->next;
        const bool right_first = inv[node->axis] < 0;
        stack[(*n)++] = right_first ? at + 1 : node->next;
        stack[(*n)++] = right_first ? node->next : at + 1;
    }
    return LR_NOWHERE;
}

#endif
