/* What a voxelizer holds between its stages.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_VOXELIZER_H
#define LR_VOXELIZE_VOXELIZER_H

#include "voxelize/brick.h"
#include "voxelize/choose_triangle_cells.h"
#include "voxelize/component_sides.h"
#include "voxelize/solid_or_sheet.h"

/* Of the bricks of a part those that are mixed. They lie in the volume from brick `first` on,
 * their names from block 1 + 8 (first - LR_FIRST_STORED) on, until all parts have run. */
typedef struct lr_part {
    uint32_t n;                 /* mixed bricks */
    uint32_t *brick;            /* [n]: places in the table */
    uint32_t first;             /* brick of the volume */
    uint32_t next_block;        /* of names */
    uint32_t *nearest_triangle; /* [512], of the brick at hand: 1 + triangle that is nearest, or 0;
                        NULL without */
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
    lr_judgement judgement;
    bool by_winding; /* sides come from labels, not from pseudonormals */
    lr_winding winding;
    lr_labels labels;
    lr_part *parts;          /* [bins.n_parts] */
    lr_verdict *verdicts;    /* [bins.n_active] */
    lr_cells_part *cells;    /* [bins.n_parts], or NULL */
    uint64_t scratch_nbytes; /* the most so far, with the coming stage */
};

/* Memory beside the volume that is held, and that the coming stage wants. */
uint64_t lr_voxelizer_scratch(const lr_voxelizer *voxelizer);

/* Make the bricks of a part; parts may run side by side. */
lr_status lr_part_run(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                      lr_error *error);
/* Label the samples of a part. */
lr_status lr_part_label(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                        lr_error *error);
/* Make room in the volume for the bricks of all parts. */
lr_status lr_parts_begin(lr_voxelizer *voxelizer, lr_error *error);
/* Close the gaps between those that are mixed, and enter them into the table. */
lr_status lr_parts_move(lr_voxelizer *voxelizer, const lr_watch *watch, lr_error *error);
void lr_parts_free(lr_voxelizer *voxelizer);

/* Give the bricks that no triangle came near their side; *contradicts where what is
 * around them, or bricks side by side, disagree. */
lr_status lr_between_decide(lr_voxelizer *voxelizer, const lr_watch *watch, bool *contradicts,
                            lr_error *error);

#endif
