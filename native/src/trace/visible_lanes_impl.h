/* Eight rays side by side in a volume with a transfer function: what is around the cells on which
 * they stand, what sees values, and arithmetic of vectors of numbers.
 *
 * Whoever includes this defines LR_VECTORS, see base/vectors.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vectors.h"
#include "distance/narrow_band.h"
#include "grid/cell_rows.h"
#include "grid/transfer_function.h"
#include "trace/lane_exp.h"

LR_INLINE lr_doubles lr_greater_lanes(lr_doubles a, lr_doubles b)
{
    return lr_pick_doubles(a > b, a, b);
}

LR_INLINE lr_doubles lr_lesser_lanes(lr_doubles a, lr_doubles b)
{
    return lr_pick_doubles(a < b, a, b);
}

#define LR_NUMBER        lr_doubles
#define LR_BITS          lr_unsigned_longs
#define LR_FORMULA(name) name##_lanes
#include "trace/lane_exp_impl.h"

/* The corners of cells, of rows as they were fetched. */
LR_INLINE void lr_unpack_rows(const lr_unsigned_longs row[LR_CELL_ROWS], int32_t type,
                              lr_doubles s[8])
{
    const int bits = type == LR_U8 ? 8 : type == LR_U16 ? 16 : 32;
    const uint64_t mask = ((uint64_t)1 << bits) - 1;
    for (int n = 0; n < 8; n++) {
        const lr_unsigned_longs own = n & 1 ? row[n >> 1] >> bits : row[n >> 1];
        s[n] = type == LR_F32 ? lr_doubles_of_floats(own) : lr_doubles_of_unsigned(own & mask);
    }
}

/* The numbers of the pieces of values. */
LR_INLINE lr_longs lr_pieces_of_lanes(const lr_transfer *f, lr_doubles value)
{
    lr_longs piece = {0};
    for (int l = 0; l < LR_DOUBLE_LANES && f->n > LR_FEW_KNOTS; l++)
        piece[l] = (int64_t)lr_piece_of(f, value[l]);
    for (uint64_t i = 0; i < f->n && f->n <= LR_FEW_KNOTS; i++)
        piece -= value >= f->values[i];
    return piece;
}

/* What is around cells: whether they are visible, and the cube in which nothing is, that of block +
 * 1 cells that they are in, and so far around it. */
typedef struct lr_view {
    lr_eight_ints visible, block, reach;
} lr_view;

/* By the masks of bricks; */
LR_INLINE lr_view lr_look_at_masks(const lr_volume *v, const lr_eight_ints c[3],
                                   const int32_t place[LR_DOUBLE_LANES])
{
    const lr_eight_ints all = ~(lr_eight_ints){0};
    int32_t at[3][LR_DOUBLE_LANES], words[LR_DOUBLE_LANES], word[LR_DOUBLE_LANES];
    int32_t pair[LR_DOUBLE_LANES], cell[LR_DOUBLE_LANES];
    for (int a = 0; a < 3; a++)
        lr_store_eight(at[a], c[a]);
    for (int l = 0; l < LR_DOUBLE_LANES; l++) {
        const int32_t x = at[0][l], y = at[1][l], z = at[2][l];
        const uint32_t entry = lr_entry_at(v, (size_t)place[l]);
        const uint64_t cells = lr_entry_cells(v, entry, x, y, z);
        words[l] = lr_entry_words(entry);
        word[l] = lr_entry_has_word(entry, x, y, z);
        pair[l] = lr_word_has_pair(cells, x, y, z);
        cell[l] = lr_cells_have(cells, x, y, z);
    }
    const lr_eight_ints has_word = lr_load_eight(word) != 0;
    const lr_eight_ints has_pair = has_word & (lr_load_eight(pair) != 0);
    lr_view seen = {.visible = has_word & (lr_load_eight(cell) != 0)};
    seen.block =
        lr_pick_eight(lr_load_eight(words) == 0, all & (LR_SIDE - 1), all & (LR_SIDE / 2 - 1));
    seen.block = lr_pick_eight(has_word, all & 1, seen.block) & ~has_pair;
    return seen;
}

/* and by distances, of cells and of their bricks, that were fetched: */
LR_INLINE lr_view lr_look_at_distances(const int32_t brick[LR_DOUBLE_LANES],
                                       const int32_t distance[LR_DOUBLE_LANES])
{
    const lr_eight_ints bricks = lr_load_eight(brick), cells = lr_load_eight(distance);
    const lr_eight_ints far = bricks < 0; /* LR_FAR_BRICK: the sign */
    lr_view seen = {.visible = ~far & (cells == 0), .block = far & (LR_SIDE - 1)};
    seen.reach = lr_pick_eight(far, ((bricks & 0xff) - 1) * LR_SIDE, cells - 1) & ~seen.visible;
    return seen;
}

LR_INLINE void lr_fetch_distances(const lr_empty_cubes *cubes, const int32_t place[LR_DOUBLE_LANES],
                                  const int32_t cell[LR_DOUBLE_LANES],
                                  int32_t brick[LR_DOUBLE_LANES], int32_t distance[LR_DOUBLE_LANES])
{
    for (int l = 0; l < LR_DOUBLE_LANES; l++) {
        brick[l] = (int32_t)cubes->bricks[place[l]];
        distance[l] = cubes->near[brick[l] < 0 ? 0 : brick[l]][cell[l]];
    }
}

/* Where cells, which lie in the table, are: the places of their bricks there, and their numbers in
 * these. */
LR_INLINE void lr_find_places(const lr_volume *v, const lr_eight_ints c[3],
                              int32_t place[LR_DOUBLE_LANES], int32_t cell[LR_DOUBLE_LANES])
{
    const int32_t *size = v->table_size;
    const int last = LR_SIDE - 1;
    lr_store_eight(place, ((c[2] >> LR_SIDE_BITS) * size[1] + (c[1] >> LR_SIDE_BITS)) * size[0] +
                              (c[0] >> LR_SIDE_BITS));
    lr_store_eight(cell, (c[0] & last) | (c[1] & last) << LR_SIDE_BITS |
                             (c[2] & last) << 2 * LR_SIDE_BITS);
}
