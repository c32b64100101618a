/* One cell at a time.
 *
 * Every cell that the ray pierces is visited, in order; nothing is built. The other
 * traversers are compared with it.
 *
 * Source: Amanatides and Woo 1987. Departure: t is recomputed at every plane
 * instead of being accumulated, so that it cannot drift.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/next_planes.h"
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

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, lr_planes *p, bool first, lr_tally *tally)
{
    (void)data;
    double t = u->t;
    if (!first && !lr_planes_step(p, r, lattice, u, &t))
        return false;
    lr_count_cell(tally);
    while (!lr_is_surface_cell(v, u->c)) {
        if (!lr_planes_step(p, r, lattice, u, &t))
            return false;
        lr_count_cell(tally);
    }
    u->t = t > u->t ? t : u->t;
    return true;
}

#define LR_NAME  aw
#define LR_STATE lr_planes
#define LR_START(data, volume, ray, lattice, cursor, state)                                        \
    lr_planes_begin(state, ray, lattice, cursor)
#define LR_WALK walk
#include "trace/walk_template.h"
