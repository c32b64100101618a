/* Which cells of shared samples a transfer function lets be seen.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_VISIBLE_CELLS_H
#define LR_GRID_VISIBLE_CELLS_H

#include "grid/brick_grid.h"

/* The visible cells of the brick at a position of the table, whose samples with those of its upper
 * neighbours range from least to greatest; false: none. */
bool lr_visible_mask(const lr_volume *volume, const int32_t b[3], double least, double greatest,
                     lr_mask mask);

#endif
