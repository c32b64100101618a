/* How much memory making a volume takes beside the volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_SCRATCH_H
#define LR_VOXELIZE_SCRATCH_H

#include "voxelize/voxelizer.h"

/* Memory beside the volume that is held, and that the coming stage wants. */
uint64_t lr_voxelizer_scratch(const lr_voxelizer *voxelizer);

#endif
