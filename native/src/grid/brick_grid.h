/* The brick store: samples in bricks of 8^3 without apron behind a dense table.
 *
 * Inside the core everything is in *storage* coordinates: lattice index + LR_PAD.
 * The pad makes room for the virtual layer of zeros around the lattice and for
 * the gradient stencil of its cells, so that no read needs a bounds check:
 * lattice cells -1..n-1 are storage cells 1..n+1, whose stencils reach 0..n+3.
 *
 * A table entry is brick << 8 | sub: bit s of sub tells whether sub-brick s (4^3
 * cells) holds a surface cell. Brick 0 is zero throughout and brick 1 is one
 * throughout; both exist in memory, so that reads have no special case. Within
 * a brick sample (x, y, z) is at x + 8 y + 64 z; surface cells are eight words of
 * 64 bits, cell (x, y, z) bit x%4 + 4 (y%4) + 16 (z%4) of word x/4 + 2 (y/4) +
 * 4 (z/4).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_BRICK_GRID_H
#define LR_GRID_BRICK_GRID_H

#include "base/base.h"

enum {
    LR_PAD = 2,
    LR_BRICK_SAMPLES = 512,
    LR_BLOCK_SAMPLES = 64,
    LR_BRICK_ZERO = 0,
    LR_BRICK_ONE = 1,
    LR_FIRST_STORED = 2,
    LR_MAX_BRICKS = 1 << 24, /* 24 bits of a table entry */
    LR_MAX_SIDE = 1 << 20    /* samples per axis: storage coordinates stay far inside int32 */
};

struct lr_triangle_cells;      /* grid/triangle_cells.h */
struct lr_triangle_attributes; /* grid/attributes/triangle_attributes.h */
struct lr_objects;             /* grid/objects.h */

/* What is added here goes through serialize.c, too. */
struct lr_volume {
    lr_volume_desc desc;
    double storage_from_object[16]; /* where it is rectilinear, to where its planes lie */
    double object_from_storage[16];
    double *planes[3]; /* NULL, or where the planes of a rectilinear volume lie: of storage
                          samples 0.., n_planes of each axis, increasing throughout */
    int32_t n_planes;
    double one;            /* the stored value of occupancy 1 */
    double threshold;      /* T in stored units */
    int32_t table_size[3]; /* bricks per axis */
    uint32_t *table;
    uint32_t n_bricks; /* with the two constant ones */
    uint32_t capacity;
    unsigned char *samples; /* [n_bricks][512] of desc.sample_type */
    uint16_t *ids;          /* [n_bricks][512], or NULL */
    uint64_t (*cells)[8];   /* [n_bricks]: surface cells; until lr_volume_finish the touched
                               cells of a sheet */
    uint32_t *block_of;     /* [capacity][8]: attribute blocks of sub-bricks, 0: none; or NULL */
    uint32_t n_blocks;      /* with block 0, which is never read */
    uint32_t *nearest_triangle; /* [n_blocks][64]: faces that are nearest, 0: none; or NULL */
    struct lr_triangle_attributes *faces; /* NULL: the surface carries nothing */
    struct lr_triangle_cells
        *triangle_cells;        /* cells with triangles of their own; NULL: there are none */
    struct lr_objects *objects; /* what tells objects apart; NULL: nothing does */
    uint64_t n_surface_cells;
    int32_t surface_lo[3], surface_hi[3]; /* storage cells, inclusive */
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

/* then also of a word of 64 cells, that of sub-brick `sub` of the brick whose first
 * storage cell is `first`. */
LR_INLINE void lr_bound_word(lr_volume *v, const int32_t first[3], int sub, uint64_t word)
{
    for (; word != 0; word &= word - 1) {
        const int bit = __builtin_ctzll(word);
        const int32_t c[3] = {first[0] + 4 * (sub & 1) + (bit & 3),
                              first[1] + 4 * (sub >> 1 & 1) + (bit >> 2 & 3),
                              first[2] + 4 * (sub >> 2) + (bit >> 4)};
        for (int a = 0; a < 3; a++) {
            v->surface_lo[a] = lr_min_i(v->surface_lo[a], c[a]);
            v->surface_hi[a] = lr_max_i(v->surface_hi[a], c[a]);
        }
    }
}

LR_INLINE size_t lr_sample_nbytes(int32_t sample_type)
{
    return sample_type == LR_U8 ? 1 : sample_type == LR_U16 ? 2 : 4;
}

LR_INLINE size_t lr_table_at(const lr_volume *v, int32_t bx, int32_t by, int32_t bz)
{
    return ((size_t)bz * (size_t)v->table_size[1] + (size_t)by) * (size_t)v->table_size[0] +
           (size_t)bx;
}

LR_INLINE size_t lr_table_count(const lr_volume *v)
{
    return (size_t)v->table_size[0] * (size_t)v->table_size[1] * (size_t)v->table_size[2];
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

/* Room for so many stored bricks, so that filling them does not copy. */
lr_status lr_volume_reserve(lr_volume *volume, uint64_t n_stored, lr_error *error);

/* Bytes of the table for a lattice of n samples, and of one stored brick. */
uint64_t lr_volume_table_nbytes(const int32_t n[3]);
uint64_t lr_volume_brick_nbytes(int32_t sample_type, bool has_ids);

#endif
