/* What the hit tests of triangle cells and of cells of the field beside them have in common.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CELL_COMMON_H
#define LR_TRACE_CELL_COMMON_H

#include "grid/access.h"
#include "trace/ray.h"

/* What the field beside a triangle cell may be off, in voxels: corners that are off by
 * more make a cell exact (voxelize/choose_triangle_cells.c), which is asked for triangles as near
 * to it as LR_EXACT_NEAR. */
#define LR_FIELD_OFF 0.4

/* A start on a triangle, after the way to the world and back, lies within this; far from the
 * origin within a share of the distance, which f64 leaves after a dozen roundings. Voxels. */
LR_INLINE double lr_start_off(const lr_volume *v)
{
    const double *m = v->storage_from_object;
    return fmax(1e-6, 0x1p-49 * (fabs(m[3]) + fabs(m[7]) + fabs(m[11])));
}

LR_INLINE void lr_point_at(const lr_ray *r, double t, double q[3])
{
    for (int a = 0; a < 3; a++)
        q[a] = r->s[a] == 0 ? r->o[a] : r->o[a] + t * r->d[a];
}

/* The same as lr_is_surface_cell, for any cell. */
LR_INLINE bool lr_holds_surface(const lr_volume *v, const int32_t c[3])
{
    for (int a = 0; a < 3; a++)
        if (c[a] < v->surface_lo[a] || c[a] > v->surface_hi[a])
            return false;
    return lr_is_surface_cell(v, c);
}

#endif
