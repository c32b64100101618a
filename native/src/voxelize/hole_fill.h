/* What closes the wide holes of a mesh that is to be a solid: the surface on which it winds
 * half around.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_HOLE_FILL_H
#define LR_VOXELIZE_HOLE_FILL_H

#include "mesh/winding_number.h"
#include "voxelize/triangle_bins.h"

/* Add the bricks within the band of the closing surface to those of the mesh. */
lr_status lr_closing_bricks(const lr_winding *winding, const int32_t table_size[3], double band,
                            const lr_watch *watch, lr_bins *bins, lr_error *error);

/* Signed distances of the samples of a brick to the mesh and what closes it, the band
 * beyond. distance[LR_CELLS] holds those to the mesh, of whatever sign, infinity beyond the
 * band; loose[LR_CELLS] tells where the nearest point lies on the mesh's border. False where
 * stopped. */
bool lr_closing_brick(const lr_winding *winding, const int32_t first[3], double band,
                      const uint8_t *loose, const lr_watch *watch, float *distance);

#endif
