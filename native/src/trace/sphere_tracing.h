/* Going along a continuous ray by spheres of empty space.
 *
 * A jump goes as far as the radius of the cell; where that is below one voxel, an exact
 * step goes to the next cell. After a jump the cell is found by floor, which is safe, as
 * all of the sphere is empty.
 *
 * Source: Zuiderveld, Koning and Viergever 1992; the hybrid with exact steps is that of
 * Cohen and Sheffer 1994.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_SPHERE_TRACING_H
#define LR_TRACE_SPHERE_TRACING_H

#include "distance/empty_radius.h"
#include "trace/ray.h"

typedef struct lr_pace {
    double per_voxel; /* t */
    double slack;     /* voxels by which a point of the ray may be off, from above */
} lr_pace;

LR_INLINE void lr_begin_spheres(const lr_ray *r, lr_pace *p)
{
    double most = 0.0;
    for (int a = 0; a < 3; a++)
        most = fmax(most, fabs(r->o[a]) + r->hi[a] + 1.0);
    p->per_voxel = 1.0 / hypot(hypot(r->d[0], r->d[1]), r->d[2]);
    p->slack = most * 0x1p-50; /* o + t d, with t from a plane: four roundings of 2^-53 */
}

/* The cell of the point at t, never behind c; false outside the volume. */
LR_INLINE bool lr_cell_along(const lr_ray *r, double t, int32_t c[3])
{
    for (int a = 0; a < 3; a++) {
        if (r->s[a] == 0)
            continue;
        const double q = lr_floor_along(r->o[a] + t * r->d[a], r->s[a]);
        if (!(q >= r->lo[a] && q <= r->hi[a]))
            return false;
        const int32_t to = (int32_t)q;
        c[a] = r->s[a] > 0 ? lr_max_i(to, c[a]) : lr_min_i(to, c[a]);
    }
    return true;
}

/* Go on as far as it is empty, but for the slack; or, where that is not even a voxel,
 * to the next cell. */
LR_INLINE bool lr_next_sphere(const lr_ray *r, lr_cursor *u, double radius, const lr_pace *p,
                              bool *jump)
{
    const double length = radius - p->slack;
    *jump = radius >= 1.0 && length >= p->slack;
    if (!*jump)
        return lr_step(r, LR_REGULAR, u);
    const double t = u->t + length * p->per_voxel;
    if (!(t <= r->t_max) || !lr_cell_along(r, t, u->c))
        return false;
    u->t = t;
    u->axis = -1;
    return true;
}

#endif
