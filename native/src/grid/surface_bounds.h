/* The box of a volume's surface, tighter than that of its surface cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_SURFACE_BOUNDS_H
#define LR_GRID_SURFACE_BOUNDS_H

#include "base/base.h"

/* Where rays that come from outside can meet the surface of a finished volume, in storage space,
 * with a margin for rounding; lo > hi: nowhere. Of a volume with a transfer function, the box of
 * what is visible. */
void lr_surface_bounds(const lr_volume *volume, double lo[3], double hi[3]);

#endif
