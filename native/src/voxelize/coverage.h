/* The box filter: the exactly covered share of every voxel of a brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_COVERAGE_H
#define LR_VOXELIZE_COVERAGE_H

#include "grid/layers.h"
#include "voxelize/coverage_bsp.h"

/* Give the voxels of a brick that triangles cross the share that the mesh covers;
 * value[LR_CELLS] holds the others already: 1 or 0 by their side, as inside tells. The listed
 * triangles are all that come near. room: where shells cross, for the share of their union, or
 * NULL; then *crosses is set where they do. False where stopped. */
bool lr_box_brick(const lr_topology *mesh, const int32_t first[3], const uint32_t *list, uint32_t n,
                  const lr_layers inside, const lr_watch *watch, lr_crossed *room, float *value,
                  bool *crosses);

#endif
