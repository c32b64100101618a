/* Bricks that no triangle comes near take the side of the bricks around them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_FLOOD_FILL_H
#define LR_VOXELIZE_FLOOD_FILL_H

#include "voxelize/voxelizer.h"

/* Give the bricks that no triangle came near their side; *contradicts where what is
 * around them, or bricks side by side, disagree. */
lr_status lr_between_decide(lr_voxelizer *voxelizer, const lr_watch *watch, bool *contradicts,
                            lr_error *error);

#endif
