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

/* Row n of a cell's corners is at (., n & 1, n >> 1): its corners 2 n and 2 n + 1. size: bytes of a
 * sample, a constant. */
LR_INLINE void lr_load_rows(const lr_volume *v, size_t size, int32_t x, int32_t y, int32_t z,
                            uint64_t row[LR_CELL_ROWS])
{
    const int corner = lr_in_brick(x, y, z);
    const bool apart = lr_along(corner, 0) == LR_SIDE - 1;
    if (!apart && lr_along(corner, 1) < LR_SIDE - 1 && lr_along(corner, 2) < LR_SIDE - 1) {
        lr_load_rows_of(v, size, lr_table_of(v, x, y, z), corner, row);
        return;
    }
    for (int n = 0; n < LR_CELL_ROWS; n++) {
        row[n] = 0;
        const int32_t yn = y + (n & 1), zn = z + (n >> 1);
        const unsigned char *at = v->samples + lr_sample_at(v, x, yn, zn) * size;
        if (apart) {
            memcpy(&row[n], at, size);
            at = v->samples + lr_sample_at(v, x + 1, yn, zn) * size;
            memcpy((unsigned char *)&row[n] + size, at, size);
        } else {
            memcpy(&row[n], at, 2 * size);
        }
    }
}

/* The samples of a row as numbers. */
LR_INLINE void lr_unpack_row(uint64_t row, int32_t type, double *first, double *second)
{
    const int bits = type == LR_U8 ? 8 : type == LR_U16 ? 16 : 32;
    const uint32_t low = (uint32_t)(row & (((uint64_t)1 << bits) - 1));
    const uint32_t high = (uint32_t)(row >> bits);
    if (type == LR_F32) {
        float a, b;
        memcpy(&a, &low, sizeof a);
        memcpy(&b, &high, sizeof b);
        *first = a;
        *second = b;
    } else { /* no more than 16 bits */
        *first = (double)(int32_t)low;
        *second = (double)(int32_t)high;
    }
}

#endif
