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

/* t of the next plane along each axis. */
typedef struct planes {
    double next[3];
} planes;

LR_INLINE void begin_walk(const lr_ray *r, lr_lattice lattice, const lr_cursor *u, planes *p)
{
    for (int a = 0; a < 3; a++)
        p->next[a] = lr_next_t(r, lattice, u, a);
}

LR_INLINE bool step(const lr_ray *r, lr_lattice lattice, lr_cursor *u, planes *p, int axis)
{
    bool goes_on = lr_cross(r, u, axis, p->next[axis]);
    p->next[axis] = lr_next_t(r, lattice, u, axis);
    return goes_on;
}

LR_INLINE bool next_cell(const lr_ray *r, lr_lattice lattice, lr_cursor *u, planes *p)
{
    const double *t = p->next;
    if (t[1] < t[0])
        return t[2] < t[1] ? step(r, lattice, u, p, 2) : step(r, lattice, u, p, 1);
    return t[2] < t[0] ? step(r, lattice, u, p, 2) : step(r, lattice, u, p, 0);
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, planes *p, bool first, lr_tally *tally)
{
    (void)data;
    if (!first && !next_cell(r, lattice, u, p))
        return false;
    lr_count_cell(tally);
    while (!lr_is_surface_cell(v, u->c)) {
        if (!next_cell(r, lattice, u, p))
            return false;
        lr_count_cell(tally);
    }
    return true;
}

#define LR_NAME                                             aw
#define LR_STATE                                            planes
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(ray, lattice, cursor, state)
#define LR_WALK                                             walk
#include "trace/walk_template.h"
