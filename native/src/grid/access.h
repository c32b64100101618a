/* The one accessor of the brick store: is a cell a surface cell, its eight corners, the
 * stencil of its gradient. All coordinates are storage coordinates.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ACCESS_H
#define LR_GRID_ACCESS_H

#include "grid/brick_grid.h"

LR_INLINE uint32_t lr_entry(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return v->table[lr_table_at(v, x >> 3, y >> 3, z >> 3)];
}

LR_INLINE uint32_t lr_sub_of(int32_t x, int32_t y, int32_t z)
{
    return (uint32_t)(((x >> 2) & 1) | ((y >> 2) & 1) << 1 | ((z >> 2) & 1) << 2);
}

LR_INLINE uint32_t lr_bit_of(int32_t x, int32_t y, int32_t z)
{
    return (uint32_t)((x & 3) | (y & 3) << 2 | (z & 3) << 4);
}

/* Is it a surface cell? */
LR_INLINE bool lr_is_surface_cell(const lr_volume *v, const int32_t c[3])
{
    uint32_t entry = lr_entry(v, c[0], c[1], c[2]);
    uint32_t sub = lr_sub_of(c[0], c[1], c[2]);
    if (!(entry >> sub & 1))
        return false;
    return v->cells[entry >> 8][sub] >> lr_bit_of(c[0], c[1], c[2]) & 1;
}

LR_INLINE double lr_load(const lr_volume *v, size_t at)
{
    switch (v->desc.sample_type) {
    case LR_U8:
        return v->samples[at];
    case LR_U16:
        return ((const uint16_t *)(const void *)v->samples)[at];
    default:
        return (double)((const float *)(const void *)v->samples)[at];
    }
}

LR_INLINE size_t lr_sample_at(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return (size_t)(lr_entry(v, x, y, z) >> 8) * LR_BRICK_SAMPLES +
           (size_t)((x & 7) | (y & 7) << 3 | (z & 7) << 6);
}

LR_INLINE double lr_sample(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return lr_load(v, lr_sample_at(v, x, y, z));
}

/* The block of n^3 samples from (x, y, z), n <= 4; x varies fastest. */
LR_INLINE void lr_block(const lr_volume *v, int32_t x, int32_t y, int32_t z, int n, double *out)
{
    if ((x & 7) + n <= 8 && (y & 7) + n <= 8 && (z & 7) + n <= 8) {
        size_t at = lr_sample_at(v, x, y, z);
        for (int k = 0; k < n; k++)
            for (int j = 0; j < n; j++)
                for (int i = 0; i < n; i++)
                    *out++ = lr_load(v, at + (size_t)(i + 8 * j + 64 * k));
        return;
    }
    size_t brick[8]; /* of the two along each axis that the block may lie in */
    for (int b = 0; b < 8; b++)
        brick[b] = (size_t)(lr_entry(v, x + (b & 1) * (n - 1), y + (b >> 1 & 1) * (n - 1),
                                     z + (b >> 2) * (n - 1)) >>
                            8) *
                   LR_BRICK_SAMPLES;
    for (int k = 0; k < n; k++)
        for (int j = 0; j < n; j++)
            for (int i = 0; i < n; i++) {
                const int at[3] = {(x & 7) + i, (y & 7) + j, (z & 7) + k};
                const int in = at[0] >> 3 | at[1] >> 3 << 1 | at[2] >> 3 << 2;
                *out++ = lr_load(
                    v, brick[in] + (size_t)((at[0] & 7) | (at[1] & 7) << 3 | (at[2] & 7) << 6));
            }
}

/* Corner b is at offset (b & 1, b >> 1 & 1, b >> 2). */
LR_INLINE void lr_corners(const lr_volume *v, const int32_t c[3], double corner[8])
{
    lr_block(v, c[0], c[1], c[2], 2, corner);
}

/* Does the cell hold a sample that belongs to the object? */
LR_INLINE bool lr_object_cell(const lr_volume *v, const int32_t c[3])
{
    double corner[8];
    lr_corners(v, c, corner);
    for (int b = 0; b < 8; b++)
        if (corner[b] >= v->threshold)
            return true;
    return false;
}

#endif
