/* Sides of the bricks that no triangle comes near, by a flood fill from the bricks around.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_FLOOD_FILL_H
#define LR_VOXELIZE_FLOOD_FILL_H

#include "voxelize/voxelizer.h"

/* Set the sides of the bricks that no triangle comes near; *contradicts where those around a
 * component, or neighbouring bricks, disagree. */
lr_status lr_between_decide(lr_voxelizer *voxelizer, const lr_watch *watch, bool *contradicts,
                            lr_error *error);

#endif
