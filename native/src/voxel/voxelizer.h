/* What a voxelizer holds between its stages.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZER_H
#define LR_VOXELIZER_H

#include "voxel/brick.h"
#include "voxel/cells.h"
#include "voxel/judge.h"
#include "voxel/labels.h"

typedef struct lr_part {
    uint32_t n;             /* mixed bricks */
    uint32_t *brick;        /* [n]: places in the table */
    unsigned char *samples; /* [n][512] */
    uint16_t *ids;          /* [n][512], or NULL */
    uint64_t (*touched)[8]; /* [n], of sheets */
    uint32_t *block_of;     /* [n]: 1 + block of names, or 0; NULL without */
    uint32_t n_blocks;
    uint32_t *named; /* [n_blocks][512]: 1 + triangle that is nearest, or 0; NULL without */
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
    lr_part *parts;       /* [bins.n_parts] */
    lr_verdict *verdicts; /* [bins.n_active] */
    lr_cells_part *cells; /* [bins.n_parts], or NULL */
};

/* Make the bricks of a part; parts may run side by side. */
lr_status lr_part_run(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                      lr_error *error);
/* Label the samples of a part. */
lr_status lr_part_label(lr_voxelizer *voxelizer, uint32_t index, const lr_watch *watch,
                        lr_error *error);
/* Move the bricks of all parts to the volume. */
lr_status lr_parts_move(lr_voxelizer *voxelizer, const lr_watch *watch, lr_error *error);
void lr_parts_free(lr_voxelizer *voxelizer);

/* Give the bricks that no triangle came near their side; *contradicts where what is
 * around them, or bricks side by side, disagree. */
lr_status lr_between_decide(lr_voxelizer *voxelizer, const lr_watch *watch, bool *contradicts,
                            lr_error *error);

#endif
