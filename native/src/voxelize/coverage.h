/* The box filter: the exact coverage of every voxel of a brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_COVERAGE_H
#define LR_VOXELIZE_COVERAGE_H

#include "grid/layers.h"
#include "voxelize/coverage_bsp.h"

/* Set the coverage of the voxels of a brick that triangles cross; value[LR_CELLS] comes with
 * the others: 1 or 0 by their side, as in `inside`. The list has all triangles within the
 * band. room: memory for the union of crossing shells; if NULL, *crosses is set where they
 * cross. False where stopped. */
bool lr_box_brick(const lr_topology *mesh, const int32_t first[3], const uint32_t *list, uint32_t n,
                  const lr_layers inside, const lr_watch *watch, lr_crossed *room, float *value,
                  bool *crosses);

#endif
