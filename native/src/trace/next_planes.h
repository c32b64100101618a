/* Cells one after another, of which nothing but the next planes is looked at: the arithmetic of
 * lr_step, whose t and cells these are to the last bit, with what it would find anew at each cell
 * kept beside the cursor.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_NEXT_PLANES_H
#define LR_TRACE_NEXT_PLANES_H

#include "trace/ray.h"

/* Of each axis the next plane and t there, and how many cells of the ray's lie behind it. */
typedef struct lr_planes {
    double next[3], plane[3], by[3];
    int32_t left[3];
} lr_planes;

LR_INLINE void lr_planes_begin(lr_planes *p, const lr_ray *r, lr_lattice lattice,
                               const lr_cursor *u)
{
    for (int a = 0; a < 3; a++) {
        p->next[a] = lr_next_t(r, lattice, u, a);
        p->plane[a] = u->c[a] + (r->s[a] > 0);
        p->by[a] = r->s[a];
        p->left[a] = r->s[a] > 0 ? r->hi[a] - u->c[a] : r->s[a] < 0 ? u->c[a] - r->lo[a] : 0;
    }
}

/* Through the next plane of an axis, given as a constant: all stays in registers. */
LR_INLINE bool lr_planes_cross(lr_planes *p, const lr_ray *r, lr_lattice lattice, lr_cursor *u,
                               double *t, int axis)
{
    *t = p->next[axis];
    u->axis = axis;
    if (--p->left[axis] < 0 || !(*t <= r->t_max))
        return false;
    u->c[axis] += r->s[axis];
    p->plane[axis] += p->by[axis];
    p->next[axis] = lattice == LR_REGULAR ? (p->plane[axis] - r->o[axis]) * r->inv[axis]
                                          : lr_next_t(r, lattice, u, axis);
    return true;
}

/* Leave the cell u->c; false: the ray has ended. The crossing is at *t, which the caller puts into
 * the cursor where it stops, unless that stands later already. */
LR_INLINE bool lr_planes_step(lr_planes *p, const lr_ray *r, lr_lattice lattice, lr_cursor *u,
                              double *t)
{
    const double x = p->next[0], y = p->next[1], z = p->next[2];
    if (y < x)
        return z < y ? lr_planes_cross(p, r, lattice, u, t, 2)
                     : lr_planes_cross(p, r, lattice, u, t, 1);
    return z < x ? lr_planes_cross(p, r, lattice, u, t, 2)
                 : lr_planes_cross(p, r, lattice, u, t, 0);
}

#endif
