/* Entry points for the test of trees of triangles, by every instruction set on the same rays.
 * Compiled by tests/core/test_triangle_tree.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "trace/triangle_tree.h"

/* The one rule of the core that the tree asks for: nothing is left. */
bool lr_tree_accepts(const lr_tree_ray *ray, const lr_triangle_block *block, int lane, double t,
                     bool inward)
{
    (void)ray, (void)block, (void)lane, (void)t, (void)inward;
    return true;
}

LR_API int32_t tree_simd(void)
{
    return lr_cpu_simd();
}

/* A node over eight blocks of eight triangles: corners[64][3][3]. Meet them by n rays
 * o_and_d[n][6]; t[n], infinity where none is met; triangle[n] and steps[n]. */
LR_API void tree_run(int32_t simd, const double (*corners)[3][3], uint64_t n,
                     const double (*o_and_d)[6], double *t, uint32_t *triangle, uint32_t *steps)
{
    static lr_triangle_block blocks[LR_TREE_LANES];
    static lr_tree_node node;
    const lr_triangle_tree tree = {.nodes = &node, .blocks = blocks, .n_nodes = 1, .n_blocks = 8};
    const lr_tree_ops *ops = simd == LR_SIMD_AVX512 ? &lr_tree_avx512
                             : simd == LR_SIMD_AVX2 ? &lr_tree_avx2
                                                    : &lr_tree_portable;
    for (uint32_t b = 0; b < LR_TREE_LANES; b++) {
        node.child[b] = b | LR_LEAF;
        for (int a = 0; a < 3; a++) {
            node.bound[0][a][b] = INFINITY;
            node.bound[1][a][b] = -INFINITY;
        }
        for (uint32_t l = 0; l < LR_TREE_LANES; l++) {
            blocks[b].triangle[l] = LR_TREE_LANES * b + l;
            for (int c = 0; c < 3; c++)
                for (int a = 0; a < 3; a++) {
                    const double x = corners[LR_TREE_LANES * b + l][c][a];
                    blocks[b].corner[c][a][l] = x;
                    node.bound[0][a][b] = fminf(node.bound[0][a][b], (float)x - 0x1p-16f);
                    node.bound[1][a][b] = fmaxf(node.bound[1][a][b], (float)x + 0x1p-16f);
                }
        }
    }
    for (uint64_t i = 0; i < n; i++) {
        lr_ray r = {.t_max = INFINITY};
        for (int a = 0; a < 3; a++) {
            r.o[a] = o_and_d[i][a];
            r.d[a] = o_and_d[i][3 + a];
            r.s[a] = (r.d[a] > 0.0) - (r.d[a] < 0.0);
            r.inv[a] = r.s[a] != 0 ? 1.0 / r.d[a] : 0.0;
        }
        lr_tree_ray k = {.r = &r, .t = INFINITY, .triangle = LR_NO_TRIANGLE};
        ops->meet(&tree, &k);
        t[i] = k.t;
        triangle[i] = k.triangle;
        steps[i] = k.n_nodes + k.n_blocks;
    }
}
