/* Triangle cells: surface cells that keep their triangles.
 *
 * Where the samples cannot hold the surface, at borders, junctions, close pairs
 * and creases, a cell has the list of the triangles that come near it, and rays
 * are intersected with those. A volume without such cells has no lr_triangle_cells.
 *
 * A mask tells in which cells the field is not trusted; those of them that are surface
 * cells are the triangle cells. They are numbered by their place (word, then bit) from their
 * brick's first one on, so that a mask and one number per brick find the list.
 * Vertices are shared and in storage space, in f64: two triangles with a common
 * edge see the same bits, whatever bricks they lie in.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_TRIANGLE_CELLS_H
#define LR_GRID_TRIANGLE_CELLS_H

#include "grid/access.h"

/* Triangles within NEAR of a cell are on its list, so that the triangle cells beside a
 * cell of the field know the triangles that it stands for; in voxels. */
#define LR_EXACT_NEAR 0.25

#define LR_NO_TRIANGLE UINT32_MAX

/* What is added here goes through serialize.c, too. */
typedef struct lr_triangle_cells {
    lr_mask *doubt;          /* [n_bricks], as cells of lr_volume: where the field is not trusted */
    uint32_t *first;         /* [n_bricks]: number of the brick's first triangle cell */
    uint32_t *start;         /* [n_cells + 1]: where a cell's list starts */
    uint32_t *list;          /* triangles */
    uint32_t (*triangle)[3]; /* vertices, counter-clockwise from outside */
    double (*vertex)[3];     /* storage space */
    uint16_t *id;            /* one per triangle, or NULL */
    uint32_t *face;          /* likewise: its row among the volume's faces; NULL: it has none */
    double voxels_per_value; /* at the surface: from stored values to distances */
    uint32_t n_bricks, n_cells, n_triangles, n_vertices;
} lr_triangle_cells;

void lr_triangle_cells_free(lr_triangle_cells *exact);
uint64_t lr_triangle_cells_nbytes(const lr_triangle_cells *exact); /* NULL: 0 */

/* The triangle cells of a word. */
LR_INLINE uint64_t lr_triangle_cell_word(const lr_volume *v, uint32_t brick, uint32_t sub)
{
    return v->triangle_cells->doubt[brick][sub] & v->cells[brick][sub];
}

LR_INLINE bool lr_is_triangle_cell(const lr_volume *v, const int32_t c[3])
{
    const uint32_t brick = lr_entry(v, c[0], c[1], c[2]) >> 8;
    return lr_triangle_cell_word(v, brick, lr_word_of(c[0], c[1], c[2])) >>
               lr_bit_of(c[0], c[1], c[2]) &
           1;
}

/* Do the samples of a cell, surface cell or not, tell on which side a point is? */
LR_INLINE bool lr_is_trusted(const lr_volume *v, const int32_t c[3])
{
    const uint32_t brick = lr_entry(v, c[0], c[1], c[2]) >> 8;
    return !lr_mask_has(v->triangle_cells->doubt[brick], c[0], c[1], c[2]);
}

/* Of a word, the cells whose coordinate along an axis is i - 1, i or i + 1. i: -1..4. */
LR_INLINE uint64_t lr_around(int32_t i, int axis)
{
    static const uint64_t first[3] = {0x1111111111111111u, 0x000f000f000f000fu, 0xffffu};
    uint64_t cells = 0;
    for (int32_t k = i > 0 ? i - 1 : 0; k <= (i < 3 ? i + 1 : 3); k++)
        cells |= first[axis] << (k << 2 * axis);
    return cells;
}

/* Is one of the cells around c not trusted, or c itself? Then samples beyond c lie beyond
 * a crease or a border, and differences across them tell nothing of the surface in c. */
LR_INLINE bool lr_near_doubt(const lr_volume *v, const int32_t c[3])
{
    if (v->triangle_cells == NULL)
        return false;
    /* Word by word, of 4^3 cells each: mostly one, at most eight. */
    for (int32_t z = (c[2] - 1) >> 2; z <= (c[2] + 1) >> 2; z++)
        for (int32_t y = (c[1] - 1) >> 2; y <= (c[1] + 1) >> 2; y++)
            for (int32_t x = (c[0] - 1) >> 2; x <= (c[0] + 1) >> 2; x++) {
                const uint32_t brick = lr_entry(v, 4 * x, 4 * y, 4 * z) >> 8;
                const uint64_t word =
                    v->triangle_cells->doubt[brick][lr_word_of(4 * x, 4 * y, 4 * z)];
                if (word != 0 && (word & lr_around(c[0] - 4 * x, 0) & lr_around(c[1] - 4 * y, 1) &
                                  lr_around(c[2] - 4 * z, 2)) != 0)
                    return true;
            }
    return false;
}

/* The list of a triangle cell. */
LR_INLINE const uint32_t *lr_triangle_cell_list(const lr_volume *v, const int32_t c[3], uint32_t *n)
{
    const lr_triangle_cells *e = v->triangle_cells;
    const uint32_t brick = lr_entry(v, c[0], c[1], c[2]) >> 8;
    const uint32_t sub = lr_word_of(c[0], c[1], c[2]);
    const uint64_t below = ((uint64_t)1 << lr_bit_of(c[0], c[1], c[2])) - 1;
    uint32_t cell = e->first[brick];
    for (uint32_t s = 0; s < sub; s++)
        cell += (uint32_t)__builtin_popcountll(lr_triangle_cell_word(v, brick, s));
    cell += (uint32_t)__builtin_popcountll(lr_triangle_cell_word(v, brick, sub) & below);
    *n = e->start[cell + 1] - e->start[cell];
    return e->list + e->start[cell];
}

LR_INLINE void lr_triangle_cell_corners(const lr_triangle_cells *e, uint32_t triangle,
                                        const double *p[3])
{
    for (int c = 0; c < 3; c++)
        p[c] = e->vertex[e->triangle[triangle][c]];
}

/* Normal by the winding, not unit. */
LR_INLINE void lr_corners_normal(const double *const p[3], double n[3])
{
    const double a[3] = {p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2]};
    const double b[3] = {p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2]};
    n[0] = a[1] * b[2] - a[2] * b[1];
    n[1] = a[2] * b[0] - a[0] * b[2];
    n[2] = a[0] * b[1] - a[1] * b[0];
}

LR_INLINE void lr_triangle_cell_normal(const lr_triangle_cells *e, uint32_t triangle, double n[3])
{
    const double *p[3];
    lr_triangle_cell_corners(e, triangle, p);
    lr_corners_normal(p, n);
}

/* How far q is from the plane through p, times the length of its normal n. */
LR_INLINE double lr_height_over(const double p[3], const double n[3], const double q[3])
{
    return n[0] * (q[0] - p[0]) + n[1] * (q[1] - p[1]) + n[2] * (q[2] - p[2]);
}

/* How far q is beyond the edge from a to b of a triangle with the normal n, in its plane, times the
 * lengths of both. */
LR_INLINE double lr_beyond_edge(const double a[3], const double b[3], const double n[3],
                                const double q[3])
{
    const double x = b[0] - a[0], y = b[1] - a[1], z = b[2] - a[2];
    return (y * n[2] - z * n[1]) * (q[0] - a[0]) + (z * n[0] - x * n[2]) * (q[1] - a[1]) +
           (x * n[1] - y * n[0]) * (q[2] - a[2]);
}

/* Squared distance of a point of storage space from a triangle. */
double lr_triangle_cell_distance2(const lr_triangle_cells *exact, uint32_t triangle,
                                  const double q[3]);

/* Of a triangle cell's triangles the one that is nearest to a point of storage space; or
 * LR_NO_TRIANGLE. */
uint32_t lr_triangle_cell_nearest(const lr_volume *volume, const int32_t c[3], const double q[3]);

/* What some bricks of a volume to come hold, in the order of their triangle cells. */
typedef struct lr_triangle_cells_part {
    uint32_t n;      /* bricks with such cells */
    uint32_t *place; /* [n]: in the volume's table */
    lr_mask *doubt;  /* [n]: where the field is not trusted, */
    lr_mask *exact;  /* [n]: of those, the triangle cells */
    uint32_t n_cells;
    uint32_t *count; /* [n_cells]: lengths of the lists */
    uint32_t n_list;
    uint32_t *list; /* triangles of the caller's mesh */
} lr_triangle_cells_part;

/* What the lists' triangles are. */
typedef struct lr_triangle_cells_source {
    const int32_t *triangles; /* [n_triangles][3] */
    uint64_t n_triangles;
    uint64_t n_vertices;
    const uint16_t *ids; /* or NULL */
    bool turned;         /* wound inside out */
    bool faces;          /* note the triangles' numbers plus one in `face` */
    double slope;        /* of the filter at the surface, per voxel */
    void (*vertex)(const void *mesh, int64_t v, double p[3]); /* in storage space */
    const void *mesh;
} lr_triangle_cells_source;

/* Make the cells of the parts triangle cells of a volume whose other surface cells are
 * known. */
lr_status lr_triangle_cells_attach(lr_volume *volume, const lr_triangle_cells_part *parts,
                                   uint32_t n_parts, const lr_triangle_cells_source *source,
                                   const lr_watch *watch, lr_error *error);

#endif
