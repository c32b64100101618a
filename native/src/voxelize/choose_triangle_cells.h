/* Which cells keep their triangles.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_CHOOSE_TRIANGLE_CELLS_H
#define LR_VOXELIZE_CHOOSE_TRIANGLE_CELLS_H

#include "grid/triangle_cells.h"
#include "voxelize/brick_distances.h"
#include "voxelize/triangle_bins.h"

/* The cells of some bricks. */
typedef struct lr_cells_part {
    lr_triangle_cells_part exact;
    uint32_t n;      /* bricks that triangles come near */
    uint32_t *place; /* [n]: in the volume's table */
    lr_mask *near;   /* [n]: cells within LR_EXACT_NEAR of a triangle */
} lr_cells_part;

/* Choose among the cells of the active bricks first..end-1. The volume has all its samples,
 * but is not finished. LR_E_STOPPED, LR_E_MEMORY. What was made is freed by lr_cells_free,
 * after an error too. */
lr_status lr_cells_make(const lr_voxel_job *job, const lr_volume *volume, const lr_bins *bins,
                        uint32_t first, uint32_t end, const lr_watch *watch, lr_cells_part *part,
                        lr_error *error);
void lr_cells_free(lr_cells_part *part);
uint64_t lr_cells_nbytes(const lr_cells_part *part); /* of its triangle cells in a volume */

#endif
