/* Sides by the winding number, asked once per component of the band.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_COMPONENT_SIDES_H
#define LR_VOXELIZE_COMPONENT_SIDES_H

#include "mesh/winding_number.h"
#include "voxelize/brick_distances.h"
#include "voxelize/triangle_bins.h"

enum { LR_UNLABELLED = 0xffff };

/* Of one active brick. */
typedef struct lr_brick_labels {
    uint32_t first;           /* component of its label 0 */
    uint16_t label[LR_CELLS]; /* LR_UNLABELLED beyond the band */
    uint16_t depth[LR_CELLS]; /* distance, in units of band / 65535; 0: links to none */
} lr_brick_labels;

/* Connected samples of one brick. */
struct lr_component {
    uint32_t brick;         /* active brick */
    uint16_t sample, depth; /* its farthest one */
    uint32_t parent;        /* union-find over bricks */
    bool inside;
};
typedef struct lr_component lr_component;

/* Of a part of the active bricks, while others run. */
typedef struct lr_labels_part {
    lr_component *component;
    uint32_t n, room;
} lr_labels_part;

typedef struct lr_labels {
    lr_brick_labels *brick;  /* [n_active] */
    lr_labels_part *part;    /* [n_parts]; NULL once joined */
    lr_component *component; /* [n], once joined */
    uint32_t *root;          /* [n_roots] */
    uint32_t n, n_roots;
} lr_labels;

lr_status lr_labels_begin(const lr_bins *bins, lr_labels *labels, lr_error *error);
/* Label the bricks of a part; parts may run side by side. */
lr_status lr_labels_run(lr_labels *labels, const lr_voxel_job *job, const lr_bins *bins,
                        uint32_t part, const lr_watch *watch, lr_scratch *scratch, lr_error *error);
/* Once all have run: connect the components of neighbouring bricks. */
lr_status lr_labels_join(lr_labels *labels, const lr_voxel_job *job, const lr_bins *bins,
                         const lr_watch *watch, lr_error *error);
/* The sides of roots first..end; ranges may run side by side. False where stopped. */
bool lr_labels_ask(lr_labels *labels, const lr_voxel_job *job, const lr_bins *bins,
                   const lr_winding *winding, uint32_t first, uint32_t end, const lr_watch *watch);
/* Once all are asked: give every component the side of its root. */
void lr_labels_spread(lr_labels *labels);
void lr_labels_free(lr_labels *labels, const lr_bins *bins);

#endif
