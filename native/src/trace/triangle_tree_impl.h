/* One ray through a tree of triangles, eight boxes or triangles at a time. Whoever includes this
 * defines LR_VECTORS, LR_TREE_OPS, the name of what is made, and, for x86, has set the instruction
 * set.
 *
 * Triangles are met as in triangle_cell.c, by the same operations, so that a ray has the same hit,
 * to the bit, with the tree and without.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vectors.h"
#include "trace/triangle_tree.h"
#include "trace/wide_nodes_impl.h"

_Static_assert((int)LR_TREE_LANES == (int)LR_DOUBLE_LANES, "a block's corners are vectors");

/* One coordinate of a corner of a block's triangles. */
LR_INLINE lr_doubles corners_of(const lr_triangle_tree *tree, uint32_t block, bool narrow, int c,
                                int axis)
{
    if (!narrow)
        return lr_load_doubles(tree->blocks[block].corner[c][axis]);
    const lr_eight_floats f32 = lr_load_eight_floats(tree->narrow[block].corner[c][axis]);
    return __builtin_convertvector(f32, lr_doubles) * tree->scale[axis] + tree->offset[axis];
}

/* The triangles that the ray meets between t_min and its nearest hit so far, as bits: those in
 * whose planes it lies are none. t: where. sum: of the areas that it sees, whose sign tells from
 * which side. */
LR_INLINE uint32_t meet_triangles(const lr_triangle_tree *tree, uint32_t block, bool narrow,
                                  const lr_tree_ray *k, lr_doubles *t, lr_doubles *sum)
{
    const lr_shear *s = &k->shear;
    const double *o = k->r.o;
    lr_doubles x[3], y[3], z[3];
    for (int c = 0; c < 3; c++) {
        z[c] = corners_of(tree, block, narrow, c, s->z) - o[s->z];
        x[c] = corners_of(tree, block, narrow, c, s->x) - o[s->x] - s->sx * z[c];
        y[c] = corners_of(tree, block, narrow, c, s->y) - o[s->y] - s->sy * z[c];
    }
    const lr_doubles u = x[2] * y[1] - y[2] * x[1];
    const lr_doubles v = x[0] * y[2] - y[0] * x[2];
    const lr_doubles w = x[1] * y[0] - y[1] * x[0];
    const lr_longs below = (u < 0.0) | (v < 0.0) | (w < 0.0);
    const lr_longs above = (u > 0.0) | (v > 0.0) | (w > 0.0);
    *sum = u + v + w;
    const uint32_t crossed = lr_bits_of_longs(~(below & above) & (*sum != 0.0));
    if (crossed == 0) /* of most blocks, and divisions take long */
        return 0;
    *t = (u * z[0] + v * z[1] + w * z[2]) * s->sz / *sum;
    return crossed & lr_bits_of_longs((*t >= k->t_min) & (*t <= k->t));
}

/* Meet a block's triangles; true where one is the nearest so far. */
LR_INLINE bool visit_block(const lr_triangle_tree *tree, uint32_t block, lr_tree_ray *k)
{
    lr_doubles t, sum;
    bool nearer = false;
    const bool narrow = tree->narrow != NULL;
    const uint32_t *triangles =
        narrow ? tree->narrow[block].triangle : tree->blocks[block].triangle;
    uint32_t lanes = narrow ? meet_triangles(tree, block, true, k, &t, &sum)
                            : meet_triangles(tree, block, false, k, &t, &sum);
    for (; lanes != 0; lanes &= lanes - 1) {
        const int l = __builtin_ctz(lanes);
        const uint32_t triangle = triangles[l];
        const bool earlier = t[l] < k->t || (t[l] == k->t && triangle < k->triangle);
        if (earlier &&
            lr_tree_accepts(tree, k, triangle, t[l], (sum[l] > 0.0) == (k->shear.sz > 0.0))) {
            k->t = t[l];
            k->triangle = triangle;
            nearer = true;
        }
    }
    return nearer;
}

static void meet_nearest(const lr_triangle_tree *tree, uint32_t branch, lr_tree_ray *k)
{
    if ((branch & LR_LEAF) != 0) {
        k->n_blocks++;
        visit_block(tree, branch & ~LR_LEAF, k);
        return;
    }
    lr_branch stack[LR_HEIGHT_MAX * (LR_TREE_LANES - 1) + 1];
    uint32_t n = 1, leaf;
    stack[0] = (lr_branch){k->slabs.begin, branch};
    float last = lr_wide_t(&k->slabs, k->t, 1);
    while ((leaf = wide_next(tree->boxes.nodes, &k->slabs, last, stack, &n, &k->n_nodes)) !=
           LR_NOWHERE) {
        k->n_blocks++;
        if (!visit_block(tree, leaf, k))
            continue;
        if (k->any)
            return;
        last = lr_wide_t(&k->slabs, k->t, 1);
    }
}

static uint32_t next_leaf(const lr_wide_node *nodes, const lr_slabs *slabs, float last,
                          lr_branch *stack, uint32_t *n, uint64_t *n_nodes)
{
    return wide_next(nodes, slabs, last, stack, n, n_nodes);
}

const lr_tree_ops LR_TREE_OPS = {meet_nearest, next_leaf};
