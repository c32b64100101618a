/* A complete octree of occupancy bits over a volume's surface cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/surface_octree.h"

static void set_node(lr_octree *tree, int level, const int32_t c[3])
{
    const size_t at = lr_octree_at(tree, level, c);
    tree->bits[level][at >> 6] |= (uint64_t)1 << (at & 63);
}

void lr_octree_free(lr_octree *tree)
{
    if (tree == NULL)
        return;
    for (int level = 0; level < LR_OCTREE_LEVELS; level++)
        free(tree->bits[level]);
    free(tree);
}

static lr_status add_levels(lr_octree *tree, const lr_volume *v, uint64_t *nbytes, lr_error *error)
{
    const int32_t *size = v->table_size;
    const int32_t largest = lr_max_i(size[0], lr_max_i(size[1], size[2]));
    tree->top = LR_SIDE_BITS;
    while (1 << (tree->top - LR_SIDE_BITS) < largest) {
        const int level = ++tree->top;
        size_t count = 1;
        for (int a = 0; a < 3; a++) {
            tree->size[level][a] = ((LR_SIDE * size[a] - 1) >> level) + 1;
            count *= (size_t)tree->size[level][a];
        }
        const size_t words = (count + 63) / 64;
        tree->bits[level] = calloc(words, sizeof(uint64_t));
        if (tree->bits[level] == NULL)
            return lr_fail_memory(error, words * sizeof(uint64_t), "a level of an octree");
        *nbytes += words * sizeof(uint64_t);
    }
    return LR_OK;
}

lr_status lr_octree_build(const lr_volume *v, const lr_watch *watch, lr_octree **tree,
                          uint64_t *nbytes, lr_error *error)
{
    lr_octree *t = calloc(1, sizeof *t);
    if (t == NULL)
        return lr_fail_memory(error, sizeof *t, "an octree");
    *nbytes = sizeof *t;
    lr_status status = add_levels(t, v, nbytes, error);
    int32_t b[3] = {-1, 0, 0};
    while (status == LR_OK && lr_next_surface_brick(v, watch, b))
        for (int level = LR_SIDE_BITS + 1; level <= t->top; level++)
            set_node(t, level, (const int32_t[3]){LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]});
    if (status == LR_OK && lr_stopped(watch))
        status = lr_fail_stopped(error);
    if (status != LR_OK) {
        lr_octree_free(t);
        return status;
    }
    *tree = t;
    return LR_OK;
}
