/* Bricks at and next to the surface, and windows of cells around them.
 *
 * Distances per cell are stored only near the surface: in *near* bricks, those that hold
 * surface and their 26 neighbours. All others have one distance, in bricks. A near brick's
 * distances are computed in a window of 24^3 cells, the brick itself and LR_NEAR_RADIUS
 * cells around it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_DISTANCE_NARROW_BAND_H
#define LR_DISTANCE_NARROW_BAND_H

#include "grid/surface_cells.h"

enum {
    LR_NEAR_RADIUS = LR_SIDE,
    LR_WINDOW = LR_SIDE + 2 * LR_NEAR_RADIUS,
};

#define LR_FAR_BRICK 0x80000000u

/* Rows along x of a window: bit x of [z][y] is cell (x, y, z). */
typedef uint32_t lr_window[LR_WINDOW][LR_WINDOW];

/* index[lr_table_count()]: near bricks are numbered 0..n_near-1 in the table's
 * order; any other entry is LR_FAR_BRICK | chessboard distance in bricks, capped at
 * 255. The caller frees *index. */
lr_status lr_near_bricks(const lr_volume *v, uint32_t **index, uint32_t *n_near,
                         const lr_watch *watch, lr_error *error);

/* The surface cells around brick b; false where there are none. */
bool lr_window_fill(const lr_volume *v, const int32_t b[3], lr_window window);

/* Grow the set by one cell in every direction, diagonals too. */
void lr_window_grow(lr_window window);

/* Call fill(volume, brick, number, context) for every near brick. */
typedef void lr_near_fill(const lr_volume *v, const int32_t b[3], uint32_t number, void *context);
lr_status lr_near_each(const lr_volume *v, const uint32_t *index, lr_near_fill *fill, void *context,
                       const lr_watch *watch, lr_error *error);

/* Chessboard distances to what is visible, where a structure has them. */
typedef struct lr_empty_cubes {
    const uint32_t *bricks;          /* index into near, or LR_FAR_BRICK | distance in bricks */
    const uint8_t (*near)[LR_CELLS]; /* distance in cells, 0 where one is visible */
} lr_empty_cubes;

#endif
