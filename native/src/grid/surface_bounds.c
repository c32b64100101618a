/* The box of a volume's surface, tighter than that of its surface cells.
 *
 * Coarse volumes leave much air in the box of their cells, and every ray through it is traced for
 * nothing. The surface in a cell is where the trilinear field is T. With f0 and f1 the field less T
 * on the cell's faces across an axis, both bilinear with the same weights, it lies at
 * x = f0 / (f0 - f1). Where all corners of one face lie on one side, no sum with weights is zero
 * nearer to that face than the nearest of the zeros along the four edges between the faces. So
 * those bound it; where a face has corners on both sides, the surface reaches it.
 *
 * Only the outermost layer of cells along each axis has to be looked at: all others lie further in.
 * In triangle cells rays meet the triangles, and of solids the field, where the mesh has a hole.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/surface_bounds.h"

#include "grid/triangle_cells.h"

/* The box is grown by so much of a cell. Rays are transformed to a volume's space with an error of
 * some 2^-50 of their origin's coordinates, so surfaces in a face of the box are found from a
 * distance of 2^40 cells. */
static const double MARGIN = 0x1p-10;

/* Of a cell's corners, as f - T: how far along an axis, from the face on `side`, nothing of the
 * surface lies; 0..1. */
static double clearance(const double f[8], int axis, int side)
{
    const int step = 1 << axis;
    double nearest = 1.0;
    int inside[2] = {0, 0};
    for (int b = 0; b < 8; b++) {
        if (!isfinite(f[b]) || f[b] == 0.0)
            return 0.0;
        inside[b >> axis & 1] += f[b] > 0.0;
    }
    if (inside[side] != 0 && inside[side] != 4)
        return 0.0;
    for (int b = 0; b < 8; b++) {
        const double near = f[b], far = f[b ^ step];
        if ((b >> axis & 1) == side && (near > 0.0) != (far > 0.0))
            nearest = fmin(nearest, near / (near - far));
    }
    return nearest;
}

/* Do rays meet the field in the cell? */
static bool meets_field(const lr_volume *v, const int32_t c[3])
{
    return v->triangle_cells == NULL || v->desc.kind == LR_KIND_SOLID || !lr_is_triangle_cell(v, c);
}

/* The least clearance of the cells of a brick in a layer, if that is less than `least`. */
static double brick_clearance(const lr_volume *v, const int32_t b[3], int axis, int side,
                              int32_t layer, double least)
{
    int32_t c[3];
    for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, c) && least > 0.0;) {
        double f[8];
        if (c[axis] != layer || !meets_field(v, c))
            continue;
        lr_corners(v, c, f);
        for (int k = 0; k < 8; k++)
            f[k] -= v->threshold;
        least = fmin(least, clearance(f, axis, side));
    }
    return least;
}

/* The same of all cells in a layer; 1: that of the next one. */
static double layer_clearance(const lr_volume *v, int axis, int side, int32_t layer)
{
    double least = 1.0;
    int32_t lo[3], hi[3], b[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = lr_brick_of(a == axis ? layer : v->surface_lo[a]);
        hi[a] = lr_brick_of(a == axis ? layer : v->surface_hi[a]);
    }
    for (b[2] = lo[2]; b[2] <= hi[2] && least > 0.0; b[2]++)
        for (b[1] = lo[1]; b[1] <= hi[1] && least > 0.0; b[1]++)
            for (b[0] = lo[0]; b[0] <= hi[0] && least > 0.0; b[0]++)
                if (lr_entry_words(lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2]))) != 0)
                    least = brick_clearance(v, b, axis, side, layer, least);
    return least;
}

/* Make the box of the cells that of the surface. */
static void tighten(const lr_volume *v, double lo[3], double hi[3])
{
    for (int a = 0; a < 3; a++) {
        double low = lo[a] + layer_clearance(v, a, 0, v->surface_lo[a]);
        double high = hi[a] - layer_clearance(v, a, 1, v->surface_hi[a]);
        const lr_triangle_cells *e = v->triangle_cells;
        for (uint32_t i = 0; e != NULL && i < e->n_vertices; i++) {
            low = fmin(low, e->vertex[i][a]);
            high = fmax(high, e->vertex[i][a]);
        }
        lo[a] = fmax(lo[a], fmin(low, high));
        hi[a] = fmin(hi[a], fmax(low, high));
    }
}

void lr_surface_bounds(const lr_volume *v, double lo[3], double hi[3])
{
    const bool trilinear = v->transfer == NULL && v->objects == NULL && !lr_is_cubic(v);
    for (int a = 0; a < 3; a++) {
        lo[a] = v->surface_lo[a];
        hi[a] = v->surface_hi[a] + 1.0;
    }
    if (trilinear && v->n_surface_cells > 0)
        tighten(v, lo, hi);
    for (int a = 0; a < 3; a++) {
        lo[a] -= MARGIN;
        hi[a] += MARGIN;
    }
}
