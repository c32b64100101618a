/* Separating axes of a triangle and the cells of a brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_TRIANGLE_BOX_H
#define LR_MESH_TRIANGLE_BOX_H

#include "mesh/topology.h"

/* Cells are widened by this, so that a triangle in a face shared by two cells meets
 * both, whatever rounding does; voxels. */
#define LR_TOUCH 1e-4

/* An axis with the triangle's range on it: a unit cell around c, widened by g on every
 * side, is apart where axis.c is more than (0.5 + g) extent outside. */
typedef struct lr_separator {
    double axis[3], lo, hi, extent;
} lr_separator;

enum { LR_SEPARATORS = 10 };

void lr_separators_make(const double p[3][3], lr_separator s[LR_SEPARATORS]);

LR_INLINE bool lr_apart(const lr_separator s[LR_SEPARATORS], const double c[3], double grow)
{
    for (int i = 0; i < LR_SEPARATORS; i++) {
        const double at = lr_dot(s[i].axis, c), radius = (0.5 + grow) * s[i].extent;
        if (at < s[i].lo - radius || at > s[i].hi + radius)
            return true;
    }
    return false;
}

/* The cells of a brick, in coordinates from its first sample, that the triangle's box
 * meets when they are widened by grow; false where there are none. */
bool lr_cell_range(const double p[3][3], double grow, int32_t lo[3], int32_t hi[3]);

/* Mark the brick's cells that the triangle, in coordinates from the brick's
 * first sample, meets. */
void lr_touch_cells(const double p[3][3], uint64_t touched[8]);

#endif
