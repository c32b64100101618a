/* The corners of cells side by side: rows of two samples along x, fetched as they lie, and made
 * numbers by plain operations that compilers turn into vector instructions.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_CELL_ROWS_H
#define LR_GRID_CELL_ROWS_H

#include "grid/access.h"

enum { LR_CELL_ROWS = 4 };

/* Those of a cell whose corners lie in one brick: its place in the table, and the cell in it. */
LR_INLINE void lr_load_rows_of(const lr_volume *v, size_t size, size_t place, int32_t cell,
                               uint64_t row[LR_CELL_ROWS])
{
    const size_t brick = lr_entry_at(v, place) >> 8;
    const unsigned char *at = v->samples + (brick * LR_CELLS + (size_t)cell) * size;
    for (int n = 0; n < LR_CELL_ROWS; n++) {
        row[n] = 0;
        memcpy(&row[n], at + (size_t)lr_in_brick(0, n & 1, n >> 1) * size, 2 * size);
    }
}

/* Those of any cell; row n is at (., n & 1, n >> 1): its corners 2 n and 2 n + 1. size: bytes of a
 * sample, a constant. wide: rows lie in two bricks, too. */
LR_INLINE void lr_load_rows(const lr_volume *v, size_t size, size_t place, int32_t cell, bool wide,
                            uint64_t row[LR_CELL_ROWS])
{
    const size_t along = (size_t)v->table_size[0], up = along * (size_t)v->table_size[1];
    for (int n = 0; n < LR_CELL_ROWS; n++) {
        const int y = lr_along(cell, 1) + (n & 1), z = lr_along(cell, 2) + (n >> 1);
        const size_t own = place + (y == LR_SIDE ? along : 0) + (z == LR_SIDE ? up : 0);
        const size_t first = (size_t)lr_in_brick(0, y, z), x = (size_t)lr_along(cell, 0);
        const size_t at = (size_t)(lr_entry_at(v, own) >> 8) * LR_CELLS + first;
        row[n] = 0;
        memcpy(&row[n], v->samples + (at + x) * size, (wide ? 1 : 2) * size);
        if (wide) {
            const size_t other = (size_t)(lr_entry_at(v, own + 1) >> 8) * LR_CELLS + first;
            memcpy((unsigned char *)&row[n] + size, v->samples + other * size, size);
        }
    }
}

#endif
