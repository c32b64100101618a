/* Entry points for the test of trees of triangles, by every instruction set on the same rays.
 * Compiled by tests/core/test_triangle_tree.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "base/pages.h"
#include "trace/triangle_tree.h"

/* The one rule of the core that the tree asks for: nothing is left. */
bool lr_tree_accepts(const lr_triangle_tree *tree, const lr_tree_ray *ray, uint32_t triangle,
                     double t, bool inward)
{
    (void)tree, (void)ray, (void)triangle, (void)t, (void)inward;
    return true;
}

LR_API int32_t tree_simd(void)
{
    return lr_cpu_simd();
}

/* A node over eight blocks of eight triangles: corners[64][3][3]; narrow ones where scale, of a
 * voxel, is not 0, for which corners are in f32. Meet them by n rays o_and_d[n][6]; t[n], infinity
 * where none is met; triangle[n] and steps[n]. */
LR_API void tree_run(int32_t simd, const double (*corners)[3][3], double scale, uint64_t n,
                     const double (*o_and_d)[6], double *t, uint32_t *triangle, uint32_t *steps)
{
    static lr_triangle_block blocks[LR_TREE_LANES];
    static lr_narrow_block narrow[LR_TREE_LANES];
    static lr_wide_node node;
    lr_triangle_tree tree = {.boxes = {&node, 1, 8}, .blocks = blocks, .n_blocks = 8};
    for (int a = 0; a < 3 && scale != 0.0; a++) {
        tree.narrow = narrow;
        tree.scale[a] = scale;
        tree.offset[a] = a - 3.0;
    }
    const lr_tree_ops *ops = LR_BY_SIMD(simd, &lr_tree);
    for (uint32_t b = 0; b < LR_TREE_LANES; b++) {
        node.child[b] = b | LR_LEAF;
        for (int a = 0; a < 3; a++) {
            node.bound[0][a][b] = INFINITY;
            node.bound[1][a][b] = -INFINITY;
        }
        for (uint32_t l = 0; l < LR_TREE_LANES; l++) {
            blocks[b].triangle[l] = narrow[b].triangle[l] = LR_TREE_LANES * b + l;
            for (int c = 0; c < 3; c++)
                for (int a = 0; a < 3; a++) {
                    const double given = corners[LR_TREE_LANES * b + l][c][a];
                    const double x = scale != 0.0 ? given * scale + (a - 3.0) : given;
                    narrow[b].corner[c][a][l] = (float)given;
                    blocks[b].corner[c][a][l] = x;
                    node.bound[0][a][b] = fminf(node.bound[0][a][b], (float)x - 0x1p-16f);
                    node.bound[1][a][b] = fmaxf(node.bound[1][a][b], (float)x + 0x1p-16f);
                }
        }
    }
    for (uint64_t i = 0; i < n; i++) {
        lr_tree_ray k = {.t = INFINITY, .triangle = LR_NO_TRIANGLE};
        memcpy(k.r.o, o_and_d[i], sizeof k.r.o);
        memcpy(k.r.d, o_and_d[i] + 3, sizeof k.r.d);
        k.shear = lr_shear_of(&k.r);
        if (lr_slabs_of(k.r.o, k.r.d, k.t_min, &k.slabs))
            ops->meet(&tree, 0, &k);
        t[i] = k.t;
        triangle[i] = k.triangle;
        steps[i] = (uint32_t)(k.n_nodes + k.n_blocks);
    }
}

/* Through a tree over n_boxes boxes[][2][3], by n rays o_and_d[n][6] from t_min to t_max: which
 * boxes each is given, as met[n][n_boxes], 1 for each time. Returns the number of nodes, or
 * UINT32_MAX where something failed or a stack was too small. */
LR_API uint32_t tree_boxes(int32_t simd, uint32_t n_boxes, const lr_box *boxes, uint64_t n,
                           const double (*o_and_d)[6], const double *t_min, const double *t_max,
                           uint8_t *met)
{
    static lr_branch stack[LR_HEIGHT_MAX * (LR_TREE_LANES - 1) + 1];
    const lr_tree_ops *ops = LR_BY_SIMD(simd, &lr_tree);
    lr_hierarchy binary;
    lr_wide_tree tree;
    lr_error error;
    if (lr_hierarchy_build(boxes, n_boxes, 1, &binary, &error) != LR_OK ||
        lr_wide_build(&binary, &LR_ONE_BOX, &tree, &error) != LR_OK)
        return UINT32_MAX;
    bool fits = true;
    for (uint64_t i = 0; i < n; i++) {
        lr_slabs slabs;
        uint64_t n_nodes = 0;
        uint32_t leaf, left = tree.n_nodes > 0 ? 1 : 0;
        if (!lr_slabs_of(o_and_d[i], o_and_d[i] + 3, t_min[i], &slabs))
            continue;
        stack[0] = (lr_branch){-INFINITY, 0};
        const float last = lr_wide_t(&slabs, t_max[i], 1);
        while ((leaf = ops->next(tree.nodes, &slabs, last, stack, &left, &n_nodes)) != LR_NOWHERE) {
            met[i * n_boxes + leaf]++;
            fits = fits && left <= tree.n_branches;
        }
    }
    free(binary.nodes);
    lr_pages_free(tree.nodes);
    return fits ? tree.n_nodes : UINT32_MAX;
}
