/* Sides by the winding number, evaluated once per component of the band.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_COMPONENT_SIDES_H
#define LR_VOXELIZE_COMPONENT_SIDES_H

#include "mesh/winding_number.h"
#include "voxelize/brick_distances.h"
#include "voxelize/triangle_bins.h"

enum { LR_NO_COMPONENT = 0xffff };

/* Of one active brick. */
typedef struct lr_brick_components {
    uint32_t first;               /* number of the brick's component 0 among all */
    uint16_t component[LR_CELLS]; /* within the brick; LR_NO_COMPONENT beyond the band */
    uint16_t depth[LR_CELLS];     /* distance, in units of band / 65535; 0: links to none */
} lr_brick_components;

/* Connected samples of one brick. */
struct lr_component {
    uint32_t brick;         /* active brick */
    uint16_t sample, depth; /* its farthest one from the mesh */
    uint32_t parent;        /* union-find over bricks */
    bool inside;
};
typedef struct lr_component lr_component;

/* Components of a part of the active bricks, before they are joined. */
typedef struct lr_components_part {
    lr_component *component;
    uint32_t n, room;
} lr_components_part;

typedef struct lr_components {
    lr_brick_components *brick; /* [n_active] */
    lr_components_part *part;   /* [n_parts]; NULL once joined */
    lr_component *component;    /* [n], once joined */
    uint32_t *root;             /* [n_roots] */
    uint32_t n, n_roots;
} lr_components;

lr_status lr_components_begin(const lr_bins *bins, lr_components *all, lr_error *error);
/* Find the components of a part's bricks; parts may run side by side. */
lr_status lr_components_find(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                             uint32_t part, const lr_watch *watch, lr_scratch *scratch,
                             lr_error *error);
/* After all parts: connect the components of neighbouring bricks. */
lr_status lr_components_join(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                             const lr_watch *watch, lr_error *error);
/* Decide the sides of roots first..end; ranges may run side by side. False where stopped. */
bool lr_components_decide(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                          const lr_winding *winding, uint32_t first, uint32_t end,
                          const lr_watch *watch);
/* Once all roots are decided: give every component the side of its root. */
void lr_components_spread(lr_components *all);
void lr_components_free(lr_components *all, const lr_bins *bins);

#endif
