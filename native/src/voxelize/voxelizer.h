/* State of a voxelization between its stages.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_VOXELIZER_H
#define LR_VOXELIZE_VOXELIZER_H

#include "voxelize/brick.h"
#include "voxelize/choose_triangle_cells.h"
#include "voxelize/component_sides.h"
#include "voxelize/solid_or_sheet.h"

/* Of the bricks of a part those that are mixed. They lie in the volume from brick `first` on,
 * until all parts have run. */
typedef struct lr_part {
    uint32_t n;                 /* mixed bricks */
    uint32_t *brick;            /* [n]: places in the table */
    uint32_t first;             /* brick of the volume */
    uint32_t next_block;        /* of names */
    uint32_t *nearest_triangle; /* [LR_CELLS], of the brick at hand: 1 + triangle that is nearest,
                                   or 0; NULL without */
} lr_part;

typedef struct lr_verdict {
    uint8_t state; /* lr_brick_state */
    lr_faces faces;
    bool contradicts;
} lr_verdict;

struct lr_voxelizer {
    lr_voxelize_options options;
    lr_topology mesh;
    lr_bins bins;
    lr_voxel_job job;
    lr_volume_desc desc; /* of the volume */
    lr_volume *volume;   /* NULL once it is given away */
    int32_t simd;        /* lr_simd in use */
    int32_t stage;       /* lr_stage */
    uint32_t n_parts;    /* of the stage */
    bool *ran;           /* [n_parts] */
    lr_mesh_kind mesh_kind;
    bool by_winding; /* sides by components, not by pseudonormals */
    lr_winding winding;
    lr_components components;
    lr_part *parts;          /* [bins.n_parts] */
    lr_verdict *verdicts;    /* [bins.n_active] */
    lr_cells_part *chosen;   /* [bins.n_parts]: triangle cells; or NULL */
    uint64_t scratch_nbytes; /* the most so far, with the coming stage */
};

#endif
