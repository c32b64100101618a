/* Bounding volume hierarchy over boxes: of a scene's instances, of triangles.
 *
 * A binary tree whose nodes hold the boxes of both children. Every leaf is one box. Rays go
 * through wide nodes that are made of it (trace/wide_nodes.h). Boxes are f32, rounded outwards.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_BVH_H
#define LR_TRACE_BVH_H

#include "base/base.h"
#include "base/error.h"

#define LR_NOWHERE UINT32_MAX
#define LR_LEAF    0x80000000u /* flag of a child that is no node */

enum { LR_HEIGHT_MAX = 64 };

typedef struct lr_box {
    double lo[3], hi[3]; /* lo > hi: empty */
} lr_box;

typedef struct lr_node {
    float bound[2][3][2]; /* lower and upper, per axis, of the two children */
    uint32_t child[2];    /* a node, or the number of a box | LR_LEAF */
} lr_node;

typedef struct lr_hierarchy {
    lr_node *nodes;   /* the first is the root */
    uint32_t n_nodes; /* 0: nothing to hit */
} lr_hierarchy;

/* Over n boxes, fewer than 2^31; empty ones are left out. at_once: so many are met for the cost of
 * one. nodes is freed by the caller. */
lr_status lr_hierarchy_build(const lr_box *boxes, uint32_t n, uint32_t at_once,
                             lr_hierarchy *hierarchy, lr_error *error);

/* Half the area of a box; 0 where it is empty. */
LR_INLINE double lr_half_area(const lr_box *box)
{
    const double x = box->hi[0] - box->lo[0];
    const double y = box->hi[1] - box->lo[1];
    const double z = box->hi[2] - box->lo[2];
    return x >= 0 ? x * y + y * z + z * x : 0;
}

#endif
