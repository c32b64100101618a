/* How far surface stays from a ray's line where it runs outside the box of the surface cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_LINE_CLEARANCE_H
#define LR_IMAGING_LINE_CLEARANCE_H

#include "trace/sphere_tracing.h"

/* Outside the box: at a distance s from where the line crosses a face, the box is s k
 * away and the surface radius - s at least. */
LR_INLINE double lr_clearance_outside(const lr_ray *r, const lr_pace *p, int axis, double radius)
{
    const double k = fabs(r->d[axis]) * p->per_voxel;
    return radius * k / (1.0 + k);
}

/* Where the ray leaves the box of the surface cells: t, the last cell, and the axis of the face. */
LR_INLINE int lr_last_cell_of_ray(const lr_ray *r, double *t, int32_t c[3])
{
    int axis;
    *t = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    for (int a = 0; a < 3; a++) {
        const double q = r->s[a] != 0 ? r->o[a] + *t * r->d[a] : r->o[a];
        const double to =
            a == axis ? (r->s[a] > 0 ? r->hi[a] : r->lo[a]) : lr_floor_along(q, r->s[a]);
        c[a] = (int32_t)lr_clamp(to, r->lo[a], r->hi[a]);
    }
    return axis;
}

#endif
