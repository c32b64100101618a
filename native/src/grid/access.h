/* The samples of the brick store: one, the eight corners of a cell, the stencil of its gradient.
 * All coordinates are storage coordinates.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ACCESS_H
#define LR_GRID_ACCESS_H

#include "grid/surface_cells.h"

LR_INLINE double lr_load(const lr_volume *v, size_t at)
{
    return lr_load_from(v->samples, v->desc.sample_type, at);
}

LR_INLINE size_t lr_sample_at(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return (size_t)(lr_entry(v, x, y, z) >> 8) * LR_CELLS + (size_t)lr_in_brick(x, y, z);
}

/* Is there such a sample? Beyond the table all are what is outside. */
LR_INLINE bool lr_has_sample(const lr_volume *v, const int32_t c[3])
{
    bool has = true;
    for (int a = 0; a < 3; a++)
        has = has && c[a] >= 0 && lr_brick_of(c[a]) < v->table_size[a];
    return has;
}

LR_INLINE double lr_sample(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return lr_load(v, lr_sample_at(v, x, y, z));
}

/* The id of a sample; 0 where the volume has none. */
LR_INLINE int32_t lr_id(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return v->ids != NULL ? v->ids[lr_sample_at(v, x, y, z)] : 0;
}

/* The first samples of the two bricks along each axis that the block of n^3 samples from (x, y, z),
 * n <= LR_SIDE, may lie in. */
LR_INLINE void lr_bricks_of_block(const lr_volume *v, int32_t x, int32_t y, int32_t z, int n,
                                  size_t first[8])
{
    for (int b = 0; b < 8; b++)
        first[b] = (size_t)(lr_entry(v, x + (b & 1) * (n - 1), y + (b >> 1 & 1) * (n - 1),
                                     z + (b >> 2) * (n - 1)) >>
                            8) *
                   LR_CELLS;
}

/* The block of n^3 samples from (x, y, z), n <= 4; x varies fastest. */
LR_INLINE void lr_block(const lr_volume *v, int32_t x, int32_t y, int32_t z, int n, double *out)
{
    const int in[3] = {lr_in_brick(x, 0, 0), lr_in_brick(y, 0, 0), lr_in_brick(z, 0, 0)};
    if (in[0] + n <= LR_SIDE && in[1] + n <= LR_SIDE && in[2] + n <= LR_SIDE) {
        size_t at = lr_sample_at(v, x, y, z);
        for (int k = 0; k < n; k++)
            for (int j = 0; j < n; j++)
                for (int i = 0; i < n; i++)
                    *out++ = lr_load(v, at + (size_t)lr_in_brick(i, j, k));
        return;
    }
    size_t brick[8];
    lr_bricks_of_block(v, x, y, z, n, brick);
    for (int k = 0; k < n; k++)
        for (int j = 0; j < n; j++)
            for (int i = 0; i < n; i++) {
                const int at[3] = {in[0] + i, in[1] + j, in[2] + k};
                const int b =
                    lr_brick_of(at[0]) | lr_brick_of(at[1]) << 1 | lr_brick_of(at[2]) << 2;
                *out++ = lr_load(v, brick[b] + (size_t)lr_in_brick(at[0], at[1], at[2]));
            }
}

/* The samples of the brick whose first is given, and the layer beyond it on each axis, which with
 * them are the corners of its cells; x varies fastest. */
LR_INLINE void lr_brick_corners(const lr_volume *v, const int32_t first[3],
                                double out[(LR_SIDE + 1) * (LR_SIDE + 1) * (LR_SIDE + 1)])
{
    const size_t own = lr_sample_at(v, first[0], first[1], first[2]);
    for (int z = 0; z <= LR_SIDE; z++)
        for (int y = 0; y <= LR_SIDE; y++)
            for (int x = 0; x <= LR_SIDE; x++) {
                const int32_t c[3] = {first[0] + x, first[1] + y, first[2] + z};
                if (x < LR_SIDE && y < LR_SIDE && z < LR_SIDE)
                    *out++ = lr_load(v, own + (size_t)lr_in_brick(x, y, z));
                else
                    *out++ = lr_has_sample(v, c) ? lr_sample(v, c[0], c[1], c[2]) : v->outside;
            }
}

/* Corner b is at offset (b & 1, b >> 1 & 1, b >> 2). */
LR_INLINE void lr_corners(const lr_volume *v, const int32_t c[3], double corner[8])
{
    lr_block(v, c[0], c[1], c[2], 2, corner);
}

LR_INLINE void lr_cross_around_of(const lr_volume *v, int32_t type, const int32_t c[3], double *out,
                                  int stride)
{
    const int32_t first[3] = {c[0] - 1, c[1] - 1, c[2] - 1};
    size_t brick[8], in[3][4];
    int of[3][4];
    bool apart = false;
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 4; i++) {
            const int at = (first[a] & (LR_SIDE - 1)) + i;
            of[a][i] = lr_brick_of(at) << a;
            in[a][i] = (size_t)(at & (LR_SIDE - 1)) << a * LR_SIDE_BITS;
            apart = apart || of[a][i] != 0;
        }
    if (apart)
        lr_bricks_of_block(v, first[0], first[1], first[2], 4, brick);
    else
        brick[0] = lr_sample_at(v, first[0], first[1], first[2]) / LR_CELLS * LR_CELLS;
    LR_UNROLLED for (int n = 0; n < 64; n++)
    {
        const int x = n & 3, y = n >> 2 & 3, z = n >> 4;
        if ((x == 0 || x == 3) + (y == 0 || y == 3) + (z == 0 || z == 3) <= 1)
            out[n * stride] = lr_load_from(v->samples, type,
                                           brick[of[0][x] | of[1][y] | of[2][z]] + in[0][x] +
                                               in[1][y] + in[2][z]);
    }
}

/* Of the 4^3 samples around a cell those that central differences at its corners take: sample n, x
 * fastest, at out[n * stride]; the others are left as they are. */
LR_INLINE void lr_cross_around(const lr_volume *v, const int32_t c[3], double *out, int stride)
{
    switch (v->desc.sample_type) { /* once, not for every sample */
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        lr_cross_around_of(v, id, c, out, stride);                                                 \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
    __builtin_unreachable();
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
