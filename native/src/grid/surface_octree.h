/* A complete octree of occupancy bits over a volume's surface cells.
 *
 * Node c of level m covers 2^m cells a side and is set where one of them holds surface. The levels
 * of a brick are read from the brick store's own masks and cost nothing.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_SURFACE_OCTREE_H
#define LR_GRID_SURFACE_OCTREE_H

#include "base/error.h"
#include "grid/surface_cells.h"

enum { LR_OCTREE_LEVELS = 24 };

typedef struct lr_octree {
    int top; /* the level whose one node is the volume */
    int32_t size[LR_OCTREE_LEVELS][3];
    uint64_t *bits[LR_OCTREE_LEVELS]; /* by level, a bit per node; NULL up to that of bricks */
} lr_octree;

/* *tree is to be given to lr_octree_free, *nbytes what it takes. LR_E_MEMORY, LR_E_STOPPED. */
lr_status lr_octree_build(const lr_volume *v, const lr_watch *watch, lr_octree **tree,
                          uint64_t *nbytes, lr_error *error);
void lr_octree_free(lr_octree *tree); /* NULL is fine */

/* Where a node above bricks has its bit. */
LR_INLINE size_t lr_octree_at(const lr_octree *tree, int level, const int32_t c[3])
{
    const int32_t *size = tree->size[level];
    return ((size_t)(c[2] >> level) * (size_t)size[1] + (size_t)(c[1] >> level)) * (size_t)size[0] +
           (size_t)(c[0] >> level);
}

LR_INLINE bool lr_octree_has_above_brick(const lr_octree *tree, int level, const int32_t c[3])
{
    const size_t at = lr_octree_at(tree, level, c);
    return tree->bits[level][at >> 6] >> (at & 63) & 1;
}

/* Does the node of that level around storage cell c, which is in the table, hold surface? */
LR_INLINE bool lr_octree_has(const lr_octree *tree, const lr_volume *v, int level,
                             const int32_t c[3])
{
    return level > LR_SIDE_BITS ? lr_octree_has_above_brick(tree, level, c)
                                : lr_cube_has_surface(v, level, c);
}

#endif
