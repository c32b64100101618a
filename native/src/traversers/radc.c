/* Spheres of empty space, by distance transforms.
 *
 * Every empty cell has a radius within which no surface lies, from any of its points in any
 * direction. The ray jumps by that along its continuous line and, where the radius is below
 * one voxel, takes exact steps from cell to cell. Radii come from a distance transform of
 * the cells (distance/empty_radius.h).
 *
 * The paper's step is d (chamfer: a third of it) from the surface cells, at least one voxel,
 * without exact steps near the surface. It misses cells.
 *
 * Source: Zuiderveld, Koning and Viergever 1992; the hybrid with exact steps is that of
 * Cohen and Sheffer 1994. Departures: 1. radii end at LR_NEAR_RADIUS near the surface and are
 * rounded down to sixteenths of a voxel; 2. jumps are measured in voxels, so that t may
 * have any scale. The skip of whole pixels is in imaging/.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/sphere_tracing.h"
#include "trace/traverser.h"

enum { SAFE = 0, PAPER = 1 };

static const int32_t metrics[] = {
    LR_METRIC_CHAMFER345,
    LR_METRIC_CHESSBOARD,
    LR_METRIC_CITYBLOCK,
    LR_METRIC_EUCLID,
}; /* by choice */

lr_status lr_radc_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                        void **data, uint64_t *nbytes, lr_error *error)
{
    lr_radii *radii = NULL;
    const bool safe = choices[1] == SAFE;
    lr_status status = lr_radii_make(v, metrics[choices[0]], safe, watch, &radii, error);
    if (status == LR_OK)
        *nbytes = radii->nbytes;
    *data = radii;
    return status;
}

void lr_radc_free(void *data)
{
    lr_radii_free(data);
}

typedef struct pace {
    lr_pace along;
    double t; /* of the last sample, by the paper's steps */
} pace;

LR_INLINE void begin_walk(const lr_ray *r, const lr_cursor *u, pace *p)
{
    lr_begin_spheres(r, &p->along);
    p->t = u->t;
}

LR_INLINE bool walk_safe(const lr_radii *f, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                         const lr_pace *p, bool first, lr_tally *tally)
{
    bool jump;
    if (!first && !lr_step(r, LR_REGULAR, u))
        return false;
    for (;;) {
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, u->c))
            return true;
        if (!lr_next_sphere(r, u, lr_radius_at(f, u->c), p, &jump))
            return false;
        lr_count_jump(tally, jump);
    }
}

/* Samples whose distance is the last one's radius, a voxel at least. */
LR_INLINE bool walk_paper(const lr_radii *f, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                          pace *p, bool first, lr_tally *tally)
{
    int32_t c[3];
    memcpy(c, u->c, sizeof c);
    if (first) {
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, c))
            return true;
    }
    for (;;) {
        const double radius = lr_radius_at(f, c), t = p->t + fmax(radius, 1.0) * p->along.per_voxel;
        if (!(t > p->t && t <= r->t_max) || !lr_cell_along(r, t, c))
            return false;
        p->t = t;
        lr_count_cell(tally);
        lr_count_jump(tally, radius > 1.0);
        if (lr_is_surface_cell(v, c) && memcmp(c, u->c, sizeof c) != 0 &&
            lr_advance_to_box(r, LR_REGULAR, u, c, c))
            return true;
    }
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u, pace *p,
                    bool first, lr_tally *tally)
{
    const lr_radii *f = data;
    return f->safe ? walk_safe(f, v, r, u, &p->along, first, tally)
                   : walk_paper(f, v, r, u, p, first, tally);
}

#define LR_NAME                                             radc
#define LR_STATE                                            pace
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(ray, cursor, state)
#define LR_REGULAR_WALK                                     walk
#include "trace/walk_template.h"
