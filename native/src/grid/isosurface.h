/* Volumes that share their samples: begun and classified, brick by brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ISOSURFACE_H
#define LR_GRID_ISOSURFACE_H

#include "grid/brick_grid.h"
#include "grid/samples.h"

/* A volume with the table of samples and no cells yet, to be classified part by part. */
lr_status lr_isosurface_share(lr_samples *samples, const lr_volume_desc *desc, lr_volume **volume,
                              lr_error *error);

#endif
