/* Samples at equal distances along the ray; the cell of each is found by floor.
 *
 * The cells of consecutive samples need not touch: one that the ray crosses over a
 * chord c shorter than the step is missed with probability 1 - c / step, so no step
 * is safe. Cells that are found are searched from where the ray enters them, as
 * elsewhere; what is lost are those that fall between two samples.
 *
 * Source: Levoy 1988; Robb and Barillot 1988. Departures: 1. sample k lies at k steps,
 * steps are not added up; 2. samples in one cell are one visit to it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

static const double steps[] = {0.5, 1.0, 0.25, 0.1}; /* voxels, by choice */

lr_status lr_uniform_build(const lr_volume *volume, const int32_t *choices, const lr_watch *watch,
                           void **data, uint64_t *nbytes, lr_error *error)
{
    (void)volume, (void)watch;
    return lr_build_choices(choices, 1, data, nbytes, error);
}

void lr_uniform_free(void *data)
{
    free(data);
}

typedef struct samples {
    double first, step, last; /* t of the first sample, between two, where the ray leaves */
    double k, end;            /* the next sample, and a number that none inside can have */
} samples;

LR_INLINE void begin_walk(const int32_t *choices, const lr_ray *r, const lr_cursor *u, samples *s)
{
    const double step = steps[choices[0]];
    int axis;
    double across = 0.0; /* longer than any ray through the volume */
    for (int a = 0; a < 3; a++)
        across += r->hi[a] - r->lo[a] + 1;
    s->first = u->t;
    s->step = step / hypot(hypot(r->d[0], r->d[1]), r->d[2]);
    s->last = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    s->last = s->last < r->t_max ? s->last : r->t_max;
    s->k = 0.0;
    s->end = across / step + 2.0;
}

/* The cell of the point at t; false outside the volume. */
LR_INLINE bool cell_at(const lr_ray *r, double t, int32_t c[3])
{
    for (int a = 0; a < 3; a++) {
        const double q = floor(r->o[a] + (r->s[a] != 0 ? t * r->d[a] : 0.0));
        if (!(q >= r->lo[a] && q <= r->hi[a]))
            return false;
        c[a] = (int32_t)q;
    }
    return true;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u, samples *s,
                    bool first, lr_tally *tally)
{
    (void)data;
    if (first) { /* the first sample lies in the cell that the cursor stands on */
        s->k = 1.0;
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, u->c))
            return true;
    }
    for (; s->k < s->end; s->k += 1.0) {
        const double t = s->first + s->k * s->step;
        int32_t c[3];
        if (!(t <= s->last))
            return false;
        lr_count_cell(tally);
        if (!cell_at(r, t, c) || !lr_is_surface_cell(v, c) || memcmp(c, u->c, sizeof c) == 0)
            continue;
        if (lr_advance_to_box(r, LR_REGULAR, u, c, c)) /* else it was touched by rounding only */
            return true;
    }
    return false;
}

#define LR_NAME                                             uniform
#define LR_STATE                                            samples
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, ray, cursor, state)
#define LR_REGULAR_WALK                                     walk
#include "trace/walk_template.h"
