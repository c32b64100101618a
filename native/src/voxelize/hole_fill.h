/* Fills large holes of a mesh voxelized as a solid, by the 0.5 level set of its generalized
 * winding number.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_HOLE_FILL_H
#define LR_VOXELIZE_HOLE_FILL_H

#include "mesh/winding_number.h"
#include "voxelize/triangle_bins.h"

/* Add the bricks within the band of the level set to those of the mesh. */
lr_status lr_hole_fill_bricks(const lr_winding *winding, const int32_t table_size[3], double band,
                              const lr_watch *watch, lr_bins *bins, lr_error *error);

/* Signed distances of the samples of a brick to the mesh and to the level set, capped at the
 * band. distance[LR_CELLS] comes with those to the mesh, of either sign, infinity beyond the
 * band; loose[LR_CELLS] is set where the nearest point lies on the mesh's border. False where
 * stopped. */
bool lr_hole_fill_brick(const lr_winding *winding, const int32_t first[3], double band,
                        const uint8_t *loose, const lr_watch *watch, float *distance);

#endif
