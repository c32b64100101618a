/* Bounding volume hierarchy over boxes: of a scene's instances, of triangles.
 *
 * A binary tree whose nodes hold the boxes of both children side by side, so that
 * one visit compares the two (as in Aila, Laine 2009). Every leaf is one box.
 * A ray's traversal is a small stack that can be stored and resumed; it
 * yields one box at a time, the nearer child first.
 *
 * Boxes are f32, rounded outwards: a node is less than a cache line.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_BVH_H
#define LR_TRACE_BVH_H

#include "base/base.h"
#include "base/sse2.h"

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

/* An entry of a traversal's stack. */
typedef struct lr_branch {
    double t; /* at which the ray enters its box */
    uint32_t child;
} lr_branch;

typedef struct lr_hierarchy {
    lr_node *nodes;   /* the first is the root */
    uint32_t n_nodes; /* 0: nothing to hit */
    uint32_t height;  /* entries that a stack needs */
} lr_hierarchy;

/* Over n boxes, fewer than 2^31; empty ones are left out. nodes is freed by the
 * caller. */
lr_status lr_hierarchy_build(const lr_box *boxes, uint32_t n, lr_hierarchy *hierarchy,
                             lr_error *error);

/* A ray, prepared for tests of boxes. */
typedef struct lr_slabs {
    double o[3], inv[3];  /* inv: 1/d; infinite, with its sign, where d is 0 */
    uint32_t backward[3]; /* 1 where d is negative */
} lr_slabs;

LR_INLINE lr_slabs lr_slabs_of(const double o[3], const double d[3])
{
    lr_slabs r;
    for (int a = 0; a < 3; a++) {
        r.o[a] = o[a];
        r.inv[a] = 1 / d[a];
        r.backward[a] = r.inv[a] < 0;
    }
    return r;
}

/* One number for each of the two children. */
typedef __m128d lr_both;

LR_INLINE lr_both lr_both_bounds(const float bound[2])
{
    return _mm_cvtps_pd(_mm_castpd_ps(_mm_load_sd((const double *)(const void *)bound)));
}

/* Clip the intervals of both children to their slabs along one axis. Where d is
 * 0 and the ray runs in a face, 0 * infinity gives NaN, which no comparison takes
 * as a reason to narrow: of NaN and a bound, the processor takes the bound. */
LR_INLINE void lr_clip_to_slabs(const lr_node *node, const lr_slabs *r, int a, lr_both *t_min,
                                lr_both *t_max)
{
    const lr_both near = lr_both_bounds(node->bound[r->backward[a]][a]);
    const lr_both far = lr_both_bounds(node->bound[1 - r->backward[a]][a]);
    const lr_both o = _mm_set1_pd(r->o[a]), inv = _mm_set1_pd(r->inv[a]);
    *t_min = _mm_max_pd(_mm_mul_pd(_mm_sub_pd(near, o), inv), *t_min);
    *t_max = _mm_min_pd(_mm_mul_pd(_mm_sub_pd(far, o), inv), *t_max);
}

/* The child of a node to visit next, or LR_NOWHERE; if the ray crosses both, the farther one is
 * pushed. */
LR_INLINE uint32_t lr_node_descend(const lr_node *node, const lr_slabs *ray, double t_min,
                                   double t_max, lr_branch *stack, uint32_t *n)
{
    lr_both in = _mm_set1_pd(t_min), out = _mm_set1_pd(t_max);
    lr_clip_to_slabs(node, ray, 0, &in, &out);
    lr_clip_to_slabs(node, ray, 1, &in, &out);
    lr_clip_to_slabs(node, ray, 2, &in, &out);
    const int crossed = _mm_movemask_pd(_mm_cmple_pd(in, out));
    if (crossed == 3) {
        double t_in[2];
        _mm_storeu_pd(t_in, in);
        const int near = t_in[1] < t_in[0];
        stack[(*n)++] = (lr_branch){t_in[1 - near], node->child[1 - near]};
        return node->child[near];
    }
    return crossed != 0 ? node->child[crossed - 1] : LR_NOWHERE;
}

/* The next box that the ray may meet at t <= t_max, or LR_NOWHERE. The
 * stack begins as {{t_min, 0}} with *n = 1. */
LR_INLINE uint32_t lr_hierarchy_next(const lr_hierarchy *hierarchy, const lr_slabs *ray,
                                     double t_min, double t_max, lr_branch *stack, uint32_t *n)
{
    while (*n > 0) {
        const lr_branch branch = stack[--*n];
        if (branch.t > t_max)
            continue;
        uint32_t at = branch.child;
        while ((at & LR_LEAF) == 0)
            at = lr_node_descend(&hierarchy->nodes[at], ray, t_min, t_max, stack, n);
        if (at != LR_NOWHERE)
            return at & ~LR_LEAF;
    }
    return LR_NOWHERE;
}

#endif
