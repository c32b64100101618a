/* The brick store: samples in bricks (layout.h) without apron behind a dense table.
 *
 * Inside the core everything is in *storage* coordinates: lattice index + LR_PAD.
 * The pad makes room for the virtual layer of zeros around the lattice and for
 * the gradient stencil of its cells, so that no read needs a bounds check:
 * lattice cells -1..n-1 are storage cells 1..n+1, whose stencils reach 0..n+3. The field of a cubic
 * volume reaches one cell further to each side, and a sample more: see tricubic.h.
 *
 * A table entry is brick << 8 | words: bit w of words tells whether word w of the brick's mask
 * of surface cells holds one. Brick 0 is `outside` throughout, which is 0 of occupancies, and brick
 * 1 is `inside` throughout, 1 of these; both exist in memory, so that reads have no special case.
 *
 * Nothing outside grid/ reads the table, the arrays or the constants below: surface_cells.h and
 * access.h read them for all.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_BRICK_GRID_H
#define LR_GRID_BRICK_GRID_H

#include "grid/layout.h"
#include "grid/sample_types.h"

enum {
    LR_BRICK_ZERO = 0,
    LR_BRICK_ONE = 1,
    LR_FIRST_STORED = 2,
    LR_MAX_BRICKS = 1 << 24, /* 24 bits of a table entry */
    LR_MAX_SIDE = 1 << 20    /* samples per axis: storage coordinates stay far inside int32 */
};

#define LR_MOST_TABLE 134217728.0 /* bricks: a lattice of 4096^3, whose tables take 1.2 GB */

struct lr_triangle_cells;      /* grid/triangle_cells.h */
struct lr_triangle_attributes; /* grid/attributes/triangle_attributes.h */
struct lr_objects;             /* grid/objects.h */
struct lr_surface_bounds;      /* grid/isosurface.c */
struct lr_transfer;            /* grid/transfer_function.h */

/* What is added here goes through serialize.c, too. */
struct lr_volume {
    lr_volume_desc desc;
    double storage_from_object[16]; /* where it is rectilinear, to where its planes lie */
    double object_from_storage[16];
    double *planes[3]; /* NULL, or where the planes of a rectilinear volume lie: of storage
                          samples 0.., n_planes of each axis, increasing throughout */
    int32_t n_planes;
    double one;             /* the stored value of occupancy 1 */
    double outside, inside; /* the stored values of the two constant bricks */
    double threshold;       /* T in stored units */
    int32_t table_size[3];  /* bricks per axis */
    uint32_t *table;
    uint32_t n_bricks; /* with the two constant ones */
    uint32_t capacity;
    unsigned char *samples;          /* [n_bricks][LR_CELLS] of desc.sample_type */
    lr_samples *shared;              /* whose they are; NULL: the volume's own */
    struct lr_surface_bounds *parts; /* until an isosurface is finished */
    uint16_t *ids;                   /* [n_bricks][LR_CELLS], or NULL */
    lr_mask *cells;     /* [n_bricks]: surface cells; until lr_volume_finish the touched
                           cells of a sheet */
    uint32_t *block_of; /* [capacity][LR_WORDS]: attribute blocks of words, 0: none; or NULL */
    uint32_t n_blocks;  /* with block 0, which is never read */
    uint32_t *nearest_triangle; /* [n_blocks][LR_WORD_CELLS]: nearest faces, 0: none; or NULL */
    struct lr_triangle_attributes *faces; /* NULL: the surface carries nothing */
    struct lr_triangle_cells
        *triangle_cells;        /* cells with triangles of their own; NULL: there are none */
    struct lr_objects *objects; /* what tells objects apart; NULL: nothing does */
    uint64_t n_surface_cells;
    int32_t surface_lo[3], surface_hi[3]; /* storage cells, inclusive */
    struct lr_transfer *transfer;     /* of stored numbers: surface cells are those that it lets be
                                         seen; NULL: those that hold surface */
    double value_scale, value_offset; /* with one: a value is offset + scale * stored number */
    bool bounded;                     /* with one: what is outside are no values; */
    bool everywhere;                  /* surface cells are all that hold values */
    bool finished;
    bool flat; /* of a flat-shaded mesh: normals are those of the hit's own cell */
};

/* Bounds of the surface cells: at first of none, */
LR_INLINE void lr_bound_nothing(lr_volume *v)
{
    for (int a = 0; a < 3; a++) {
        v->surface_lo[a] = INT32_MAX / 2;
        v->surface_hi[a] = INT32_MIN / 2;
    }
}

/* then also of the cells of a word of the mask of the brick whose first storage cell is `first`. */
LR_INLINE void lr_bound_word(lr_volume *v, const int32_t first[3], int word, uint64_t cells)
{
    for (; cells != 0; cells &= cells - 1) {
        const int cell = lr_cell_of_bit(word, __builtin_ctzll(cells));
        for (int a = 0; a < 3; a++) {
            v->surface_lo[a] = lr_min_i(v->surface_lo[a], first[a] + lr_along(cell, a));
            v->surface_hi[a] = lr_max_i(v->surface_hi[a], first[a] + lr_along(cell, a));
        }
    }
}

LR_INLINE size_t lr_sample_nbytes(int32_t sample_type)
{
    return lr_sample_types[sample_type].nbytes;
}

LR_INLINE size_t lr_table_at(const lr_volume *v, int32_t bx, int32_t by, int32_t bz)
{
    return lr_place_of(v->table_size, bx, by, bz);
}

/* The place in the table of the brick of a storage cell. */
LR_INLINE size_t lr_table_of(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    return lr_table_at(v, lr_brick_of(x), lr_brick_of(y), lr_brick_of(z));
}

LR_INLINE size_t lr_table_count(const lr_volume *v)
{
    return (size_t)v->table_size[0] * (size_t)v->table_size[1] * (size_t)v->table_size[2];
}

/* Are its samples occupancies 0..1, its own? */
LR_INLINE bool lr_holds_occupancies(const lr_volume *v)
{
    return v->shared == NULL && v->desc.outside == 0.0 && v->desc.inside == 1.0;
}

LR_INLINE bool lr_is_cubic(const lr_volume *v)
{
    return v->desc.interpolation == LR_VOLUME_CUBIC;
}

/* The first and the last storage cell along an axis that can hold surface. */
LR_INLINE int32_t lr_first_cell(const lr_volume *v)
{
    return lr_is_cubic(v) ? LR_PAD - 2 : LR_PAD - 1;
}

LR_INLINE int32_t lr_last_cell(const lr_volume *v, int a)
{
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    return n[a] + LR_PAD - (lr_is_cubic(v) ? 0 : 1);
}

/* Can there be such a volume, whatever object_from_index is? */
lr_status lr_volume_check(const lr_volume_desc *desc, lr_error *error);

/* Fill a stored brick with zeros or ones; it has neither ids nor names nor touched cells. */
void lr_volume_fill_brick(lr_volume *volume, uint32_t brick, bool ones);

/* The brick at a table position, for writing: a constant one is first stored,
 * filled with its constant. Not after lr_volume_finish. */
lr_status lr_volume_open_brick(lr_volume *volume, size_t at, uint32_t *brick, lr_error *error);

/* Copy a stored brick to another number; the blocks of its names stay where they are. */
void lr_volume_move_brick(lr_volume *volume, uint32_t to, uint32_t from);

/* ---- bricks by number: for those who make them side by side, each its own ---- */

/* The number of stored brick i. */
LR_INLINE uint32_t lr_stored_brick(uint32_t i)
{
    return LR_FIRST_STORED + i;
}

/* Give a brick, for which there is room, its samples, of occupancies 0..1; its ids, where the
 * volume has some, and its touched cells (NULL: none). */
void lr_volume_write_brick(lr_volume *volume, uint32_t brick, const float *occupancy,
                           const uint16_t *ids, const uint64_t *touched);

/* Enter such a brick into the table as the next of the volume, to whose place it moves; returns
 * its number there. Those before it have all been entered. */
uint32_t lr_volume_enter_brick(lr_volume *volume, size_t place, uint32_t brick);

/* Make the brick at a place of the table one that is 1 throughout. */
void lr_volume_enter_full(lr_volume *volume, size_t place);

/* Forget all that was entered. */
void lr_volume_empty_table(lr_volume *volume);

/* Add touched cells to those of the brick at a place of a sheet's table. */
lr_status lr_volume_touch(lr_volume *volume, size_t place, const lr_mask touched, lr_error *error);

/* Room for so many stored bricks, so that filling them does not copy. */
lr_status lr_volume_reserve(lr_volume *volume, uint64_t n_stored, lr_error *error);

/* Bytes of the table for a lattice of n samples, and of one stored brick. */
uint64_t lr_volume_table_nbytes(const int32_t n[3]);
uint64_t lr_volume_brick_nbytes(int32_t sample_type, bool has_ids);

#endif
