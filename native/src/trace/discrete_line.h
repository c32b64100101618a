/* Discrete lines between the centres of two voxels, in integers, and the flag by which they change
 * their steps.
 *
 * A 26-connected line takes a step of one voxel along its longest axis and, where the line has come
 * nearer to the next row, along the others with it; a 6-connected one crosses one plane between
 * voxels at a time. The adaptive one goes by 26-steps and, where a flag says that surface is next
 * to the voxel, by 6-steps. Both share their state, how far they are along each axis, so that a
 * change of steps does not bend the line.
 *
 * Source: Kaufman and Shimony 1986; the adaptive line: Yagel, Cohen and Kaufman 1992.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_DISCRETE_LINE_H
#define LR_TRACE_DISCRETE_LINE_H

#include "distance/narrow_band.h"
#include "trace/ray.h"

/* One bit per cell, of bricks near the surface only: is a surface cell at most a step away? */
typedef struct lr_proximity {
    uint32_t *bricks; /* [table]: index into near, or LR_FAR_BRICK */
    lr_mask *near;
} lr_proximity;

/* *flags is filled, and to be given to lr_proximity_free in any case; *nbytes is added to.
 * LR_E_MEMORY, LR_E_STOPPED. */
lr_status lr_proximity_build(lr_proximity *flags, const lr_volume *v, const lr_watch *watch,
                             uint64_t *nbytes, lr_error *error);
void lr_proximity_free(lr_proximity *flags);

LR_INLINE bool lr_is_near_surface(const lr_proximity *f, const lr_volume *v, const int32_t c[3])
{
    const uint32_t number = f->bricks[lr_table_of(v, c[0], c[1], c[2])];
    if (number & LR_FAR_BRICK)
        return false;
    return lr_mask_has(f->near[number], c[0], c[1], c[2]);
}

typedef struct lr_discrete_line {
    int32_t from[3], sign[3];
    int64_t n[3]; /* steps from end to end along each axis */
    int64_t k[3]; /* steps done */
    int longest;
} lr_discrete_line;

/* From voxel to voxel; an axis stays where its end lies against the sign. */
LR_INLINE void lr_begin_line(lr_discrete_line *l, const int32_t from[3], const int32_t to[3],
                             const int32_t sign[3])
{
    l->longest = 0;
    for (int a = 0; a < 3; a++) {
        l->from[a] = from[a];
        l->sign[a] = sign[a];
        l->k[a] = 0;
        l->n[a] = lr_max_i(0, (to[a] - from[a]) * sign[a]);
        l->longest = l->n[a] > l->n[l->longest] ? a : l->longest;
    }
}

/* The line of a ray in cell c: to the cell by which it leaves its cells. */
LR_INLINE void lr_begin_line_of_ray(lr_discrete_line *l, const lr_ray *r, const int32_t c[3])
{
    int axis;
    const double t = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    int32_t to[3];
    for (int a = 0; a < 3; a++) {
        const double q = a == axis ? (r->s[a] > 0 ? r->hi[a] : r->lo[a])
                                   : floor(r->o[a] + (r->s[a] != 0 ? t * r->d[a] : 0.0));
        to[a] = (int32_t)lr_clamp(q, r->lo[a], r->hi[a]);
    }
    lr_begin_line(l, c, to, r->s);
}

LR_INLINE void lr_line_cell(const lr_discrete_line *l, int32_t c[3])
{
    for (int a = 0; a < 3; a++)
        c[a] = l->from[a] + l->sign[a] * (int32_t)l->k[a];
}

/* The other coordinates where the line is one voxel on along its longest axis; false
 * where that is no step to a neighbour, after steps of the other kind. */
LR_INLINE bool lr_step_26(lr_discrete_line *l)
{
    const int m = l->longest;
    const int64_t along = 2 * (l->k[m] + 1);
    int64_t to[3];
    for (int a = 0; a < 3; a++) {
        to[a] = l->k[a] + (along * l->n[a] > (2 * l->k[a] + 1) * l->n[m]);
        if (a != m && along * l->n[a] > (2 * to[a] + 1) * l->n[m])
            return false;
    }
    to[m] = l->k[m] + 1;
    if (to[m] > l->n[m])
        return false;
    memcpy(l->k, to, sizeof to);
    return true;
}

/* Through the plane between two voxels that the line crosses next; false at its end. */
LR_INLINE bool lr_step_6(lr_discrete_line *l)
{
    int axis = -1;
    for (int a = 0; a < 3; a++) {
        if (l->k[a] == l->n[a])
            continue;
        if (axis < 0 || (2 * l->k[a] + 1) * l->n[axis] < (2 * l->k[axis] + 1) * l->n[a])
            axis = a;
    }
    if (axis < 0)
        return false;
    l->k[axis]++;
    return true;
}

/* On to the next voxel: by 26-steps if `wide`, where there is such a step; false at the end. */
LR_INLINE bool lr_step_line(lr_discrete_line *l, bool wide)
{
    return (wide && lr_step_26(l)) || lr_step_6(l);
}

/* Stand on cell c, though the ray may pass it by; false beyond the ray's end. */
LR_INLINE bool lr_stand_on(const lr_ray *r, lr_cursor *u, const int32_t c[3])
{
    if (lr_advance_to_box(r, LR_REGULAR, u, c, c))
        return true;
    double in = u->t;
    for (int a = 0; a < 3; a++) {
        if (c[a] == u->c[a])
            continue;
        const double t = lr_plane_t(r, LR_REGULAR, a, c[a] + (r->s[a] < 0));
        if (t >= in) {
            in = t;
            u->axis = a;
        }
    }
    memcpy(u->c, c, sizeof u->c);
    u->t = in;
    return in <= r->t_max;
}

#endif
