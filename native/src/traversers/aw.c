/* One cell at a time.
 *
 * Every cell that the ray pierces is visited, in order; nothing is built. The other
 * traversers are compared with it.
 *
 * Source: Amanatides and Woo 1987. Departure: t is recomputed at every plane
 * instead of being accumulated, so that it cannot drift.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

lr_status lr_aw_build(const lr_volume *volume, const int32_t *choices, const lr_watch *watch,
                      void **data, uint64_t *nbytes, lr_error *error)
{
    (void)volume, (void)choices, (void)watch, (void)error;
    return lr_build_nothing(data, nbytes);
}

void lr_aw_free(void *data)
{
    (void)data;
}

/* The next plane along each axis, and t there; how many cells of the box lie behind it. */
typedef struct planes {
    double next[3], plane[3], by[3];
    int32_t left[3];
} planes;

LR_INLINE void begin_walk(const lr_ray *r, lr_lattice lattice, const lr_cursor *u, planes *p)
{
    for (int a = 0; a < 3; a++) {
        p->next[a] = lr_next_t(r, lattice, u, a);
        p->plane[a] = u->c[a] + (r->s[a] > 0);
        p->by[a] = r->s[a];
        p->left[a] = r->s[a] > 0 ? r->hi[a] - u->c[a] : r->s[a] < 0 ? u->c[a] - r->lo[a] : 0;
    }
}

/* The cursor's t and axis are set by the walk, at its end. */
LR_INLINE bool step(const lr_ray *r, lr_lattice lattice, lr_cursor *u, planes *p, int axis,
                    double *t)
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

LR_INLINE bool next_cell(const lr_ray *r, lr_lattice lattice, lr_cursor *u, planes *p, double *t)
{
    const double x = p->next[0], y = p->next[1], z = p->next[2];
    if (y < x)
        return z < y ? step(r, lattice, u, p, 2, t) : step(r, lattice, u, p, 1, t);
    return z < x ? step(r, lattice, u, p, 2, t) : step(r, lattice, u, p, 0, t);
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, planes *p, bool first, lr_tally *tally)
{
    (void)data;
    double t = u->t;
    if (!first && !next_cell(r, lattice, u, p, &t))
        return false;
    lr_count_cell(tally);
    while (!lr_is_surface_cell(v, u->c)) {
        if (!next_cell(r, lattice, u, p, &t))
            return false;
        lr_count_cell(tally);
    }
    u->t = t > u->t ? t : u->t;
    return true;
}

#define LR_NAME                                             aw
#define LR_STATE                                            planes
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(ray, lattice, cursor, state)
#define LR_WALK                                             walk
#include "trace/walk_template.h"
