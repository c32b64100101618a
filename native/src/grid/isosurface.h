/* Volumes that share their samples: begun and classified, brick by brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ISOSURFACE_H
#define LR_GRID_ISOSURFACE_H

#include "grid/brick_grid.h"
#include "grid/samples.h"

/* A volume with the table of samples and no cells yet, to be classified part by part. threshold: an
 * occupancy. */
lr_status lr_isosurface_share(lr_samples *samples, int32_t kind, double threshold,
                              lr_volume **volume, lr_error *error);

#endif
