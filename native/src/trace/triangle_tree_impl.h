/* One ray through a tree of triangles: plain loops over eight boxes or triangles, which compilers
 * turn into vector instructions. Whoever includes this defines LR_TREE_OPS, the name of what is
 * made, and, for x86, has set its instruction set.
 *
 * Triangles are met as in triangle_cell.c, by the same operations, so that a ray has the same hit,
 * to the bit, with the tree and without.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/triangle_tree.h"

#ifdef __clang__
#define EACH_LANE _Pragma("clang loop vectorize(enable)") for (int l = 0; l < LR_TREE_LANES; l++)
#else
#define EACH_LANE for (int l = 0; l < LR_TREE_LANES; l++)
#endif

/* Planes of boxes are widened by what rounding does to t, relatively, as in lr_enter. */
static const double WIDER = 1.0 + 0x1p-49;

typedef struct tree_branch {
    double t;
    uint32_t child;
} tree_branch;

/* Where the ray enters each child's box; infinity where it passes by. */
LR_INLINE void enter_boxes(const lr_tree_node *node, const lr_tree_ray *k,
                           double t_in[LR_TREE_LANES])
{
    const lr_ray *r = k->r;
    double out[LR_TREE_LANES];
    EACH_LANE
    {
        t_in[l] = k->t_min;
        out[l] = k->t;
    }
    for (int a = 0; a < 3; a++) {
        const float *low = node->bound[0][a], *high = node->bound[1][a];
        const double o = r->o[a], inv = r->inv[a];
        if (r->s[a] == 0) {
            EACH_LANE
            {
                const bool within = (double)low[l] <= o && o <= (double)high[l];
                t_in[l] = within ? t_in[l] : INFINITY;
            }
            continue;
        }
        const float *near = r->s[a] > 0 ? low : high, *far = r->s[a] > 0 ? high : low;
        EACH_LANE
        {
            const double enters = ((double)near[l] - o) * inv;
            const double leaves = ((double)far[l] - o) * inv;
            const double widened = leaves > 0.0 ? leaves * WIDER : leaves;
            t_in[l] = enters > t_in[l] ? enters : t_in[l];
            out[l] = widened < out[l] ? widened : out[l];
        }
    }
    EACH_LANE
    {
        t_in[l] = t_in[l] <= out[l] ? t_in[l] : INFINITY;
    }
}

/* Where the ray's line meets each triangle; NaN where it passes by or lies in the plane. sum: of
 * the areas that it sees, whose sign tells from which side. */
LR_INLINE void meet_triangles(const lr_triangle_block *block, const lr_ray *r, const lr_shear *s,
                              double t[LR_TREE_LANES], double sum[LR_TREE_LANES])
{
    double x[3][LR_TREE_LANES], y[3][LR_TREE_LANES], z[3][LR_TREE_LANES];
    const double ox = r->o[s->x], oy = r->o[s->y], oz = r->o[s->z];
    const double sx = s->sx, sy = s->sy, sz = s->sz;
    for (int c = 0; c < 3; c++) {
        const double *px = block->corner[c][s->x], *py = block->corner[c][s->y];
        const double *pz = block->corner[c][s->z];
        EACH_LANE
        {
            z[c][l] = pz[l] - oz;
            x[c][l] = px[l] - ox - sx * z[c][l];
            y[c][l] = py[l] - oy - sy * z[c][l];
        }
    }
    EACH_LANE
    {
        const double u = x[2][l] * y[1][l] - y[2][l] * x[1][l];
        const double v = x[0][l] * y[2][l] - y[0][l] * x[2][l];
        const double w = x[1][l] * y[0][l] - y[1][l] * x[0][l];
        const bool below = (u < 0.0) | (v < 0.0) | (w < 0.0);
        const bool above = (u > 0.0) | (v > 0.0) | (w > 0.0);
        const double all = u + v + w;
        const double at = (u * z[0][l] + v * z[1][l] + w * z[2][l]) * sz / all;
        sum[l] = all;
        t[l] = ((below & above) | (all == 0.0)) ? (double)NAN : at;
    }
}

LR_INLINE void visit_block(const lr_triangle_block *block, const lr_shear *s, lr_tree_ray *k)
{
    double t[LR_TREE_LANES], sum[LR_TREE_LANES];
    meet_triangles(block, k->r, s, t, sum);
    for (int l = 0; l < LR_TREE_LANES; l++) {
        if (!(t[l] >= k->t_min && t[l] <= k->t && t[l] < INFINITY))
            continue;
        const uint32_t triangle = block->triangle[l];
        const bool earlier = t[l] < k->t || triangle < k->triangle;
        if (earlier && lr_tree_accepts(k, triangle, t[l], (sum[l] > 0.0) == (s->sz > 0.0))) {
            k->t = t[l];
            k->triangle = triangle;
        }
    }
}

/* Put the children that the ray enters on the stack, the nearest last. */
LR_INLINE uint32_t push_children(const lr_tree_node *node, const double t[LR_TREE_LANES],
                                 tree_branch *stack, uint32_t n)
{
    const uint32_t first = n;
    for (int l = 0; l < LR_TREE_LANES; l++) {
        if (!(t[l] < INFINITY))
            continue;
        uint32_t at = n++;
        for (; at > first && stack[at - 1].t < t[l]; at--)
            stack[at] = stack[at - 1];
        stack[at] = (tree_branch){t[l], node->child[l]};
    }
    return n;
}

static void meet_nearest(const lr_triangle_tree *tree, lr_tree_ray *k)
{
    tree_branch stack[LR_HEIGHT_MAX * (LR_TREE_LANES - 1) + 1];
    const lr_shear s = lr_shear_of(k->r);
    uint32_t n = 0;
    stack[n++] = (tree_branch){k->t_min, tree->root};
    while (n > 0) {
        const tree_branch branch = stack[--n];
        if (branch.t > k->t)
            continue;
        if ((branch.child & LR_LEAF) != 0) {
            k->n_blocks++;
            visit_block(&tree->blocks[branch.child & ~LR_LEAF], &s, k);
            if (k->any && k->triangle != LR_NO_TRIANGLE)
                return;
            continue;
        }
        const lr_tree_node *node = &tree->nodes[branch.child];
        double t[LR_TREE_LANES];
        k->n_nodes++;
        enter_boxes(node, k, t);
        n = push_children(node, t, stack, n);
    }
}

const lr_tree_ops LR_TREE_OPS = {meet_nearest};
