/* The layout of bricks: pure arithmetic, for the store and for those who keep something per
 * brick or per cell beside it.
 *
 * A brick is a cube of LR_SIDE^3 samples, and of the cells whose lowest corners these are. All
 * coordinates are storage coordinates (brick_grid.h) or count from the brick's first sample;
 * sample or cell (x, y, z) of a brick is its number x + 8 y + 64 z. A mask has a bit for each cell
 * of a brick, in words of 4^3 cells: cell (x, y, z) is bit x%4 + 4 (y%4) + 16 (z%4) of word
 * x/4 + 2 (y/4) + 4 (z/4).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_LAYOUT_H
#define LR_GRID_LAYOUT_H

#include "base/base.h"

enum {
    LR_PAD = 2, /* samples before the lattice's first in storage coordinates: see brick_grid.h */
    LR_SIDE_BITS = 3,
    LR_SIDE = 1 << LR_SIDE_BITS,         /* samples along a brick */
    LR_CELLS = 1 << 3 * LR_SIDE_BITS,    /* samples, or cells, of a brick */
    LR_WORD_SIDE_BITS = 2,               /* of the 4 cells along a word of a mask */
    LR_WORD_CELLS = 64,                  /* cells of a word */
    LR_WORDS = LR_CELLS / LR_WORD_CELLS, /* words of a mask */
};

typedef uint64_t lr_mask[LR_WORDS];

/* ---- bricks ------------------------------------------------------------ */

/* How many bricks hold n samples and the pad around them. */
LR_INLINE int32_t lr_bricks_along(int32_t n)
{
    return (n + 2 * LR_PAD + LR_SIDE - 1) / LR_SIDE;
}

/* The brick of a storage coordinate. */
LR_INLINE int32_t lr_brick_of(int32_t x)
{
    return x >> LR_SIDE_BITS;
}

/* Where a brick is in a table of size[3] bricks. */
LR_INLINE size_t lr_place_of(const int32_t size[3], int32_t bx, int32_t by, int32_t bz)
{
    return ((size_t)bz * (size_t)size[1] + (size_t)by) * (size_t)size[0] + (size_t)bx;
}

/* The first sample of the brick at a place of a table. */
LR_INLINE void lr_first_sample(const int32_t size[3], uint32_t place, int32_t first[3])
{
    const uint32_t nx = (uint32_t)size[0], ny = (uint32_t)size[1];
    first[0] = LR_SIDE * (int32_t)(place % nx);
    first[1] = LR_SIDE * (int32_t)(place / nx % ny);
    first[2] = LR_SIDE * (int32_t)(place / nx / ny);
}

/* The bricks of a table, one after another, x fastest; b is {-1, 0, 0} before the first. */
LR_INLINE bool lr_next_brick(const int32_t size[3], int32_t b[3])
{
    if (++b[0] < size[0])
        return b[2] < size[2];
    b[0] = 0;
    if (++b[1] == size[1]) {
        b[1] = 0;
        b[2]++;
    }
    return b[2] < size[2];
}

/* The cells of bricks from..to. */
LR_INLINE void lr_cells_of_bricks(const int32_t from[3], const int32_t to[3], int32_t lo[3],
                                  int32_t hi[3])
{
    for (int a = 0; a < 3; a++) {
        lo[a] = from[a] * LR_SIDE;
        hi[a] = to[a] * LR_SIDE + LR_SIDE - 1;
    }
}

/* The bricks that hold the samples by which the field of a brick's cells is given: its own and its
 * upper neighbours, of a cubic field its lower ones, too. How many, and where number n is. */
LR_INLINE int lr_support_count(bool cubic)
{
    return cubic ? 27 : 8;
}

LR_INLINE void lr_support_brick(bool cubic, int n, const int32_t b[3], int32_t to[3])
{
    const int32_t offset[3] = {cubic ? n % 3 - 1 : n & 1, cubic ? n / 3 % 3 - 1 : n >> 1 & 1,
                               cubic ? n / 9 - 1 : n >> 2};
    for (int a = 0; a < 3; a++)
        to[a] = b[a] + offset[a];
}

/* Is there such a brick in a table of size[3]? */
LR_INLINE bool lr_has_brick(const int32_t size[3], const int32_t b[3])
{
    bool has = true;
    for (int a = 0; a < 3; a++)
        has = has && b[a] >= 0 && b[a] < size[a];
    return has;
}

/* ---- samples, or cells, of a brick -------------------------------------- */

/* The number of a sample in its brick; its coordinates may count from anywhere. */
LR_INLINE int lr_in_brick(int32_t x, int32_t y, int32_t z)
{
    enum { LAST = LR_SIDE - 1 };
    return (x & LAST) | (y & LAST) << LR_SIDE_BITS | (z & LAST) << 2 * LR_SIDE_BITS;
}

/* Back: its coordinate along an axis. */
LR_INLINE int lr_along(int sample, int axis)
{
    return sample >> axis * LR_SIDE_BITS & (LR_SIDE - 1);
}

/* From a sample's number to that of the next one along an axis. */
LR_INLINE int lr_stride(int axis)
{
    return 1 << axis * LR_SIDE_BITS;
}

/* ---- masks -------------------------------------------------------------- */

/* The word of a cell, and its bit there. */
LR_INLINE uint32_t lr_word_of(int32_t x, int32_t y, int32_t z)
{
    return (uint32_t)(((x >> 2) & 1) | ((y >> 2) & 1) << 1 | ((z >> 2) & 1) << 2);
}

LR_INLINE uint32_t lr_bit_of(int32_t x, int32_t y, int32_t z)
{
    return (uint32_t)((x & 3) | (y & 3) << 2 | (z & 3) << 4);
}

LR_INLINE bool lr_mask_has(const lr_mask mask, int32_t x, int32_t y, int32_t z)
{
    return mask[lr_word_of(x, y, z)] >> lr_bit_of(x, y, z) & 1;
}

LR_INLINE void lr_mask_add(lr_mask mask, int32_t x, int32_t y, int32_t z)
{
    mask[lr_word_of(x, y, z)] |= (uint64_t)1 << lr_bit_of(x, y, z);
}

/* The cells of a row along x, a bit each. */
LR_INLINE uint32_t lr_mask_row(const lr_mask mask, int y, int z)
{
    const uint32_t word = lr_word_of(0, y, z), bit = lr_bit_of(0, y, z);
    return (uint32_t)(mask[word] >> bit & 15) | (uint32_t)(mask[word + 1] >> bit & 15) << 4;
}

LR_INLINE void lr_mask_add_row(lr_mask mask, int y, int z, uint64_t row)
{
    const uint32_t word = lr_word_of(0, y, z), bit = lr_bit_of(0, y, z);
    mask[word] |= (row & 15) << bit;
    mask[word + 1] |= (row >> 4 & 15) << bit;
}

/* The number in its brick of the cell that is a bit of a word. */
LR_INLINE int lr_cell_of_bit(int word, int bit)
{
    return lr_in_brick(4 * (word & 1) + (bit & 3), 4 * (word >> 1 & 1) + (bit >> 2 & 3),
                       4 * (word >> 2) + (bit >> 4));
}

/* How many cells of a mask, which has it, come before a cell: word by word, bit by bit. */
LR_INLINE uint32_t lr_mask_rank(const lr_mask mask, int32_t x, int32_t y, int32_t z)
{
    const uint32_t word = lr_word_of(x, y, z);
    const uint64_t below = ((uint64_t)1 << lr_bit_of(x, y, z)) - 1;
    uint32_t rank = (uint32_t)__builtin_popcountll(mask[word] & below);
    for (uint32_t w = 0; w < word; w++)
        rank += (uint32_t)__builtin_popcountll(mask[w]);
    return rank;
}

/* Does a word hold one of the 2^3 cells around a cell whose lowest is even? */
LR_INLINE bool lr_word_has_pair(uint64_t word, int32_t x, int32_t y, int32_t z)
{
    return (word >> lr_bit_of(x & ~1, y & ~1, z & ~1) & 0x330033) != 0;
}

/* The eight cubes of 2^3 cells of a word: bit i of a cube is its cell (i & 1, i >> 1 & 1, i >> 2);
 * which of them hold one, likewise. */
LR_INLINE uint8_t lr_cubes_of_word(uint64_t word, uint8_t cubes[8])
{
    uint8_t any = 0;
    for (int k = 0; k < 8; k++) {
        const uint64_t cells = word >> lr_bit_of(2 * (k & 1), 2 * (k >> 1 & 1), 2 * (k >> 2));
        cubes[k] = (uint8_t)((cells & 3) | (cells >> 4 & 3) << 2 | (cells >> 16 & 3) << 4 |
                             (cells >> 20 & 3) << 6);
        any |= (uint8_t)((cubes[k] != 0) << k);
    }
    return any;
}

#endif
