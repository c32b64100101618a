/* The parts that threads run, each a range of bricks.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_BRICK_JOBS_H
#define LR_VOXELIZE_BRICK_JOBS_H

#include "voxelize/voxelizer.h"

/* Make the bricks of a part; parts may run side by side. */
lr_status lr_part_run(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                      lr_error *error);
/* Find the components of a part's samples. */
lr_status lr_part_components(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                             lr_error *error);
/* Make room in the volume for the bricks of all parts. */
lr_status lr_parts_begin(lr_voxelizer *voxelizer, lr_error *error);
/* Close the gaps between those that are mixed, and enter them into the table. */
lr_status lr_parts_move(lr_voxelizer *voxelizer, const lr_watch *watch, lr_error *error);
void lr_parts_free(lr_voxelizer *voxelizer);

#endif
