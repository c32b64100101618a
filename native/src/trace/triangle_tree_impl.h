/* One ray through a tree of triangles, eight boxes or triangles at a time. Whoever includes this
 * defines LR_TREE_OPS, the name of what is made, and, for x86, has set its instruction set and may
 * define LR_TREE_FINITE(x), the lanes of x that are below infinity, as bits.
 *
 * Triangles are met as in triangle_cell.c, by the same operations, so that a ray has the same hit,
 * to the bit, with the tree and without.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/triangle_tree.h"

/* Vectors of compilers, of which these make whatever instructions there are. */
typedef double tree_lanes __attribute__((vector_size(LR_TREE_LANES * sizeof(double))));
typedef int64_t tree_mask __attribute__((vector_size(LR_TREE_LANES * sizeof(double))));
typedef float tree_floats __attribute__((vector_size(LR_TREE_LANES * sizeof(float))));

#define EACH(x)            ((x) - (tree_lanes){0.0}) /* x in each lane */
#define EITHER(mask, a, b) ((tree_lanes)(((mask) & (tree_mask)(a)) | (~(mask) & (tree_mask)(b))))
#define GREATER(a, b)      EITHER((a) > (b), a, b)
#define LESS(a, b)         EITHER((a) < (b), a, b)

#ifndef LR_TREE_FINITE
LR_INLINE uint32_t finite_lanes(const double *x)
{
    uint32_t lanes = 0;
    for (int l = 0; l < LR_TREE_LANES; l++)
        lanes |= (uint32_t)(x[l] < INFINITY) << l;
    return lanes;
}
#define LR_TREE_FINITE finite_lanes
#endif

/* Planes of boxes are widened by what rounding does to t, relatively, as in lr_enter. */
static const double WIDER = 1.0 + 0x1p-49;

typedef struct tree_branch {
    double t;
    uint32_t child;
} tree_branch;

/* The ray, prepared for boxes. Where it does not move along an axis, planes lie at infinity, or, if
 * it runs in one, at NaN, by which no comparison narrows anything. */
typedef struct tree_slabs {
    double o[3], inv[3];
    int near[3], far[3]; /* of a node's six bounds, those that are met first and last */
} tree_slabs;

LR_INLINE tree_slabs slabs_of(const lr_ray *r)
{
    tree_slabs s;
    for (int a = 0; a < 3; a++) {
        s.o[a] = r->o[a];
        s.inv[a] = r->s[a] != 0 ? r->inv[a] : INFINITY;
        s.near[a] = r->s[a] < 0 ? 3 + a : a;
        s.far[a] = r->s[a] < 0 ? a : 3 + a;
    }
    return s;
}

/* Where the ray enters each child's box; infinity where it passes by. */
LR_INLINE void enter_boxes(const lr_tree_node *node, const tree_slabs *s, const lr_tree_ray *k,
                           tree_lanes *t)
{
    const tree_floats *bound = (const tree_floats *)node->bound;
    tree_lanes in = EACH(k->t_min), out = EACH(INFINITY);
    for (int a = 0; a < 3; a++) {
        const tree_lanes near = __builtin_convertvector(bound[s->near[a]], tree_lanes);
        const tree_lanes far = __builtin_convertvector(bound[s->far[a]], tree_lanes);
        const tree_lanes enters = (near - s->o[a]) * s->inv[a];
        const tree_lanes leaves = (far - s->o[a]) * s->inv[a];
        in = GREATER(enters, in);
        out = LESS(leaves, out);
    }
    out = EITHER(out > 0.0, out * WIDER, out);
    *t = EITHER((in <= out) & (in <= k->t), in, EACH(INFINITY));
}

/* Where the ray meets each triangle, between t_min and its nearest hit so far; infinity where it
 * does not, or lies in the plane. sum: of the areas that it sees, whose sign tells from which side.
 */
LR_INLINE void meet_triangles(const lr_triangle_block *block, const lr_tree_ray *k,
                              const lr_shear *s, tree_lanes *t, tree_lanes *sum)
{
    const double *o = k->r->o;
    tree_lanes x[3], y[3], z[3];
    for (int c = 0; c < 3; c++) {
        const tree_lanes *corner = (const tree_lanes *)block->corner[c];
        z[c] = corner[s->z] - o[s->z];
        x[c] = corner[s->x] - o[s->x] - s->sx * z[c];
        y[c] = corner[s->y] - o[s->y] - s->sy * z[c];
    }
    const tree_lanes u = x[2] * y[1] - y[2] * x[1];
    const tree_lanes v = x[0] * y[2] - y[0] * x[2];
    const tree_lanes w = x[1] * y[0] - y[1] * x[0];
    const tree_mask below = (u < 0.0) | (v < 0.0) | (w < 0.0);
    const tree_mask above = (u > 0.0) | (v > 0.0) | (w > 0.0);
    *sum = u + v + w;
    const tree_lanes at = (u * z[0] + v * z[1] + w * z[2]) * s->sz / *sum;
    const tree_mask met = ~(below & above) & (*sum != 0.0) & (at >= k->t_min) & (at <= k->t);
    *t = EITHER(met, at, EACH(INFINITY));
}

LR_INLINE void visit_block(const lr_triangle_block *block, const lr_shear *s, lr_tree_ray *k)
{
    tree_lanes t, sum;
    meet_triangles(block, k, s, &t, &sum);
    for (uint32_t lanes = LR_TREE_FINITE((const double *)&t); lanes != 0; lanes &= lanes - 1) {
        const int l = __builtin_ctz(lanes);
        const uint32_t triangle = block->triangle[l];
        const bool earlier = t[l] < k->t || (t[l] == k->t && triangle < k->triangle);
        if (earlier && lr_tree_accepts(k, block, l, t[l], (sum[l] > 0.0) == (s->sz > 0.0))) {
            k->t = t[l];
            k->triangle = triangle;
        }
    }
}

/* Put the children that the ray enters on the stack, the nearest last. */
LR_INLINE uint32_t push_children(const lr_tree_node *node, const tree_lanes *t, tree_branch *stack,
                                 uint32_t n)
{
    const uint32_t first = n;
    for (uint32_t lanes = LR_TREE_FINITE((const double *)t); lanes != 0; lanes &= lanes - 1) {
        const int l = __builtin_ctz(lanes);
        uint32_t at = n++;
        for (; at > first && stack[at - 1].t < (*t)[l]; at--)
            stack[at] = stack[at - 1];
        stack[at] = (tree_branch){(*t)[l], node->child[l]};
    }
    return n;
}

static void meet_nearest(const lr_triangle_tree *tree, lr_tree_ray *k)
{
    tree_branch stack[LR_HEIGHT_MAX * (LR_TREE_LANES - 1) + 1];
    const lr_shear shear = lr_shear_of(k->r);
    const tree_slabs slabs = slabs_of(k->r);
    uint32_t n = 0;
    stack[n++] = (tree_branch){k->t_min, tree->root};
    while (n > 0) {
        const tree_branch branch = stack[--n];
        if (branch.t > k->t)
            continue;
        if ((branch.child & LR_LEAF) != 0) {
            k->n_blocks++;
            visit_block(&tree->blocks[branch.child & ~LR_LEAF], &shear, k);
            if (k->any && k->triangle != LR_NO_TRIANGLE)
                return;
            continue;
        }
        const lr_tree_node *node = &tree->nodes[branch.child];
        tree_lanes t;
        k->n_nodes++;
        enter_boxes(node, &slabs, k, &t);
        n = push_children(node, &t, stack, n);
    }
}

const lr_tree_ops LR_TREE_OPS = {meet_nearest};
