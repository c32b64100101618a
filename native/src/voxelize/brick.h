/* Makes one brick of a volume: filtered distances in the band.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_BRICK_H
#define LR_VOXELIZE_BRICK_H

#include "grid/layers.h"
#include "voxelize/brick_distances.h"

typedef enum lr_brick_state {
    LR_STATE_UNKNOWN = 0, /* no sample in the band: all on one side, that of its neighbours */
    LR_STATE_ZERO,
    LR_STATE_ONE,
    LR_STATE_MIXED /* to be stored */
} lr_brick_state;

/* The samples on a brick's faces -x +x -y +y -z +z, a bit each: those inside, and those
 * within the band. */
typedef struct lr_faces {
    uint64_t inside[6], in_band[6];
} lr_faces;

/* Samples and cells as in grid/layout.h. */
typedef struct lr_brick {
    lr_brick_state state;
    _Alignas(16) float value[LR_CELLS]; /* occupancy; quantised only when it is written */
    uint16_t id[LR_CELLS]; /* of the nearest triangle; 0 beyond the band; of meshes with ids */
    lr_mask touched;       /* cells that a triangle of a sheet meets */
    lr_faces faces;
    bool contradicts; /* distances of neighbours differ by more than a voxel */
    bool has_nearest; /* the scratch has nearest triangles */
} lr_brick;

/* False where stopped. */
bool lr_brick_make(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                   const lr_watch *watch, lr_scratch *scratch, lr_brick *brick);

#endif
