/* Empty radii: the distance around every cell without surface.
 *
 * Every empty cell has a radius: no surface cell lies within that distance of any of its
 * points. It is the distance to the surface cells and their 26 neighbours, which is the gap
 * between the two cubes. A metric other than the Euclidean is converted to the least
 * Euclidean distance that it allows: d / sqrt(3) for city-block, d / sqrt(11) for chamfer
 * 3-4-5, d for chessboard.
 *
 * Memory grows with the surface: bricks near it hold a radius per cell, up to LR_NEAR_RADIUS,
 * computed in the window around them, others one radius. Radii are in voxels, rounded down
 * to sixteenths.
 *
 * Source: Zuiderveld, Koning and Viergever 1992.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_DISTANCE_EMPTY_RADIUS_H
#define LR_DISTANCE_EMPTY_RADIUS_H

#include "distance/narrow_band.h"

enum {
    LR_RADIUS_STEPS = 16, /* radii are counted in these parts of a voxel */
};

typedef struct lr_radii {
    const lr_volume *volume;
    int32_t metric;            /* lr_metric */
    bool safe;                 /* else the metric's own distance to the surface cells */
    uint32_t *bricks;          /* [table]: index into near, or LR_FAR_BRICK | radius of the brick */
    uint8_t (*near)[LR_CELLS]; /* radius; 0 next to surface cells and on them */
    uint64_t nbytes;
} lr_radii;

/* metric: lr_metric; Euclid's gives the largest radii. *radii is to be given to lr_radii_free, and
 * the volume must live longer. Without safe, distances by the metric, a third of it for chamfer,
 * within which there may be surface. */
lr_status lr_radii_make(const lr_volume *volume, int32_t metric, bool safe, const lr_watch *watch,
                        lr_radii **radii, lr_error *error);

void lr_radii_free(lr_radii *radii); /* NULL is fine */

/* The radius of storage cell c, in voxels. */
LR_INLINE double lr_radius_at(const lr_radii *f, const int32_t c[3])
{
    const uint32_t at = f->bricks[lr_table_of(f->volume, c[0], c[1], c[2])];
    const uint32_t radius =
        at & LR_FAR_BRICK ? at & ~LR_FAR_BRICK : f->near[at][lr_in_brick(c[0], c[1], c[2])];
    return radius * (1.0 / LR_RADIUS_STEPS);
}

#endif
