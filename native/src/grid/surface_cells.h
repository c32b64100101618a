/* Surface cells: is a cell one, does a cube or a brick hold one, one after another. All coordinates
 * are storage coordinates.
 *
 * Those who keep bricks of their own keep their *entries*: what stands in the table at a brick's
 * place, by which its mask is found without the table.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_SURFACE_CELLS_H
#define LR_GRID_SURFACE_CELLS_H

#include "grid/brick_grid.h"

/* The entry at a place of the table, and that of a cell's brick. */
LR_INLINE uint32_t lr_entry_at(const lr_volume *v, size_t place)
{
    return v->table[place];
}

LR_INLINE uint32_t lr_entry(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return v->table[lr_table_of(v, x, y, z)];
}

/* Which words of the mask of its brick hold a surface cell, a bit each; 0: none does. */
LR_INLINE uint8_t lr_entry_words(uint32_t entry)
{
    return entry & 0xff;
}

/* The mask of its brick's surface cells. */
LR_INLINE const uint64_t *lr_entry_mask(const lr_volume *v, uint32_t entry)
{
    return v->cells[entry >> 8];
}

/* Is a cell of its brick a surface cell? */
LR_INLINE bool lr_entry_has(const lr_volume *v, uint32_t entry, const int32_t c[3])
{
    const uint32_t word = lr_word_of(c[0], c[1], c[2]);
    if (!(entry >> word & 1))
        return false;
    return v->cells[entry >> 8][word] >> lr_bit_of(c[0], c[1], c[2]) & 1;
}

/* The same apart, for cells side by side: the word of its brick's mask that a cell's bit is in, and
 * what that and the entry tell. */
LR_INLINE uint64_t lr_entry_cells(const lr_volume *v, uint32_t entry, int32_t x, int32_t y,
                                  int32_t z)
{
    return v->cells[entry >> 8][lr_word_of(x, y, z)];
}

LR_INLINE int32_t lr_entry_has_word(uint32_t entry, int32_t x, int32_t y, int32_t z)
{
    return (int32_t)(entry >> lr_word_of(x, y, z) & 1);
}

LR_INLINE int32_t lr_cells_have(uint64_t cells, int32_t x, int32_t y, int32_t z)
{
    return (int32_t)(cells >> lr_bit_of(x, y, z) & 1);
}

LR_INLINE bool lr_is_surface_cell(const lr_volume *v, const int32_t c[3])
{
    return lr_entry_has(v, lr_entry(v, c[0], c[1], c[2]), c);
}

/* Does the cube of 2^level cells a side that holds a cell, its corner at a multiple of that, hold a
 * surface cell? level: 0..LR_SIDE_BITS. */
LR_INLINE bool lr_cube_has_surface(const lr_volume *v, int level, const int32_t c[3])
{
    const uint32_t entry = lr_entry(v, c[0], c[1], c[2]);
    if (level == LR_SIDE_BITS)
        return lr_entry_words(entry) != 0;
    const uint32_t word = lr_word_of(c[0], c[1], c[2]);
    if (level == LR_WORD_SIDE_BITS)
        return entry >> word & 1;
    const uint64_t cells = v->cells[entry >> 8][word];
    return level == 1 ? lr_word_has_pair(cells, c[0], c[1], c[2])
                      : cells >> lr_bit_of(c[0], c[1], c[2]) & 1;
}

/* ---- one after another --------------------------------------------------- */

/* The surface cells of a brick:
 *     for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, c);) */
typedef struct lr_cell_iterator {
    const uint64_t *mask;
    int32_t first[3];
    int word;
    uint64_t left; /* of the word */
} lr_cell_iterator;

LR_INLINE lr_cell_iterator lr_surface_cells_of(const lr_volume *v, const int32_t b[3])
{
    const uint64_t *mask = lr_entry_mask(v, lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2])));
    return (lr_cell_iterator){mask, {LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]}, 0, mask[0]};
}

LR_INLINE bool lr_next_cell(lr_cell_iterator *i, int32_t c[3])
{
    while (i->left == 0) {
        if (++i->word == LR_WORDS)
            return false;
        i->left = i->mask[i->word];
    }
    const int cell = lr_cell_of_bit(i->word, __builtin_ctzll(i->left));
    i->left &= i->left - 1;
    for (int a = 0; a < 3; a++)
        c[a] = i->first[a] + lr_along(cell, a);
    return true;
}

/* The next brick that holds surface, x fastest; b is {-1, 0, 0} before the first. Looks at the
 * stop word once a row: false, too, where stopped. */
LR_INLINE bool lr_next_surface_brick(const lr_volume *v, const lr_watch *watch, int32_t b[3])
{
    while (lr_next_brick(v->table_size, b)) {
        if (b[0] == 0 && lr_stopped(watch))
            return false;
        if (lr_entry_words(lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2]))) != 0)
            return true;
    }
    return false;
}

#endif
