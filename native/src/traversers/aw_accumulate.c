/* One cell at a time, by the published loop: t of the next plane along an axis is the last
 * one plus a constant.
 *
 * Kept to show its drift: sums round at every step, so that after some hundred cells the
 * order of crossings, hence the cells, differ from the ray's. In f32 nearly every long ray
 * visits wrong cells. It always ends: every step advances by one cell, up to the grid's
 * border.
 *
 * Source: Amanatides and Woo 1987. Departure: ties are broken as elsewhere.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

lr_status lr_aw_accumulate_build(const lr_volume *volume, const int32_t *choices,
                                 const lr_watch *watch, void **data, uint64_t *nbytes,
                                 lr_error *error)
{
    (void)volume, (void)watch;
    return lr_build_choices(choices, 1, data, nbytes, error);
}

void lr_aw_accumulate_free(void *data)
{
    free(data);
}

typedef struct sums {
    double next[3]; /* t of the next plane along each axis */
    double delta[3];
    bool single; /* all of it in f32 */
} sums;

/* The sum of two f32 rounded to f64 and then to f32 is their sum in f32. */
LR_INLINE double rounded(const sums *s, double x)
{
    return s->single ? (double)(float)x : x;
}

LR_INLINE void begin_walk(const int32_t *choices, const lr_ray *r, const lr_cursor *u, sums *s)
{
    s->single = choices[0] == 1;
    for (int a = 0; a < 3; a++) {
        s->next[a] = rounded(s, lr_next_t(r, LR_REGULAR, u, a));
        s->delta[a] = rounded(s, fabs(r->inv[a]));
    }
}

LR_INLINE bool next_cell(const lr_ray *r, lr_cursor *u, sums *s)
{
    int axis = s->next[1] < s->next[0];
    axis = s->next[2] < s->next[axis] ? 2 : axis;
    const bool goes_on = lr_cross(r, u, axis, s->next[axis]);
    s->next[axis] = rounded(s, s->next[axis] + s->delta[axis]);
    return goes_on;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u, sums *s,
                    bool first, lr_tally *tally)
{
    (void)data;
    if (!first && !next_cell(r, u, s))
        return false;
    lr_count_cell(tally);
    while (!lr_is_surface_cell(v, u->c)) {
        if (!next_cell(r, u, s))
            return false;
        lr_count_cell(tally);
    }
    return true;
}

#define LR_NAME                                             aw_accumulate
#define LR_STATE                                            sums
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, ray, cursor, state)
#define LR_REGULAR_WALK                                     walk
#include "trace/walk_template.h"
