/* Trees of boxes whose nodes have up to eight children: of a scene's instances, of triangles.
 *
 * A ray is tested against all boxes of a node at once, in f32. The test never passes by a box that
 * the ray enters: the ray's start is rounded away from each plane, so that differences keep their
 * signs, and what is left, relative errors of products, is added to where it leaves. t is measured
 * in the largest component of the direction, so that no product overflows before the others count.
 *
 * Source: Wald, Benthin, Boulos 2008, Getting rid of packets: efficient SIMD single-ray traversal
 * using multi-branching BVHs.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_WIDE_NODES_H
#define LR_TRACE_WIDE_NODES_H

#include <float.h>

#include "trace/bvh.h"

enum { LR_TREE_LANES = 8 };

/* Boxes of up to eight children; those of none are empty. */
typedef struct lr_wide_node {
    _Alignas(32) float bound[2][3][LR_TREE_LANES]; /* lower and upper, by axis */
    uint32_t child[LR_TREE_LANES];                 /* a node, or the number of a leaf | LR_LEAF */
} lr_wide_node;

typedef struct lr_wide_tree {
    lr_wide_node *nodes; /* the first is the root; given to lr_pages_free by whoever built it */
    uint32_t n_nodes;    /* 0: nothing to meet */
    uint32_t n_branches; /* entries that a stack needs */
} lr_wide_tree;

/* A child of the binary hierarchy. */
typedef struct lr_child {
    uint32_t node;
    int side;
} lr_child;

/* How leaves are made. */
typedef struct lr_leaf_maker {
    uint32_t most; /* boxes in a leaf */
    /* The number of a leaf over these boxes. It is called twice for each, in the same order: first
     * while nodes are counted, of which `counted` says the end. */
    uint32_t (*make)(void *own, const lr_hierarchy *binary, lr_child at);
    lr_status (*counted)(void *own, lr_error *error);
    void *own;
} lr_leaf_maker;

/* A leaf is one box, by its number. */
extern const lr_leaf_maker LR_ONE_BOX;

/* Over the boxes of a binary hierarchy. */
lr_status lr_wide_build(const lr_hierarchy *binary, const lr_leaf_maker *leaves, lr_wide_tree *tree,
                        lr_error *error);

/* A part of a tree that a ray has still to visit. */
typedef struct lr_branch {
    float t; /* at which the ray enters its box, see lr_wide_t */
    uint32_t child;
} lr_branch;

/* A ray, prepared for boxes. Where it does not move along an axis, planes lie at infinity, or, if
 * it runs in one, at NaN, by which no comparison narrows anything. */
typedef struct lr_slabs {
    float near_o[3], far_o[3]; /* the start, beyond itself for planes that are met first, last */
    float inv[3];              /* of the direction over its largest component */
    int near[3], far[3];       /* of a node's six bounds, those that are met first and last */
    float begin;
    double unit; /* the largest component */
} lr_slabs;

/* What f32 does to t, relatively: three roundings, and those of both sides of a comparison. */
#define LR_WIDE_OFF 0x1p-20f

/* As the test of boxes counts t; rounded up (sign 1) or down (-1). */
LR_INLINE float lr_wide_t(const lr_slabs *s, double t, int sign)
{
    const double scaled = t * s->unit;
    const float x = sign < 0 && scaled > (double)FLT_MAX ? FLT_MAX : (float)scaled;
    return x + (float)sign * (fabsf(x) * LR_WIDE_OFF + FLT_MIN);
}

/* From o along d, from t_min on; false: no ray, as it has no direction or no number for a
 * coordinate. */
LR_INLINE bool lr_slabs_of(const double o[3], const double d[3], double t_min, lr_slabs *s)
{
    /* A component so small beside another moves a ray by less than STILL over 2^30 units. */
    static const double TINY = 1e-30, STILL = 0x1p-60;
    double sum = 0.0;
    s->unit = 0.0;
    for (int a = 0; a < 3; a++) {
        s->unit = fabs(d[a]) > s->unit ? fabs(d[a]) : s->unit;
        sum += (o[a] - o[a]) + (d[a] - d[a]); /* 0, or NaN */
    }
    if (!(s->unit > 0.0) || sum != 0.0)
        return false;
    for (int a = 0; a < 3; a++) {
        const bool moves = fabs(d[a]) >= TINY * s->unit, back = moves && d[a] < 0.0;
        const double off = fabs(o[a]) * (double)FLT_EPSILON + (moves ? (double)FLT_MIN : STILL);
        const float below = (float)(o[a] - off), above = (float)(o[a] + off);
        s->near_o[a] = back ? below : above;
        s->far_o[a] = back ? above : below;
        s->inv[a] = moves ? (float)(s->unit / d[a]) : INFINITY;
        s->near[a] = back ? 3 + a : a;
        s->far[a] = back ? a : 3 + a;
    }
    s->begin = lr_wide_t(s, t_min, -1);
    return true;
}

#endif
