/* Memory of a voxelization, beside the volume's own.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_SCRATCH_H
#define LR_VOXELIZE_SCRATCH_H

#include "voxelize/voxelizer.h"

/* Bytes that are allocated, and that the next stage will need at most. */
uint64_t lr_voxelizer_scratch(const lr_voxelizer *voxelizer);

#endif
