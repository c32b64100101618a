/* Eight rays side by side on their way into a box of cells: the arithmetic of ray.h, operation by
 * operation, so that rays are its own to the last bit. Planes lie at the integers.
 *
 * Whoever includes this has included base/vectors.h with the instruction set of its choice.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/ray.h"

typedef struct lr_enter_lanes {
    lr_doubles o[3], d[3], inv[3]; /* as of an lr_ray */
    lr_longs up[3], down[3];
    lr_doubles t_max;
    lr_longs is; /* a ray */
} lr_enter_lanes;

/* Where they stand. */
typedef struct lr_cursor_lanes {
    lr_doubles c[3], axis, t;
} lr_cursor_lanes;

LR_INLINE lr_doubles lr_greater_doubles(lr_doubles a, lr_doubles b)
{
    return lr_pick_doubles(a > b, a, b);
}

/* As lr_ray_setup, from object space. */
LR_INLINE void lr_set_up_lanes(lr_enter_lanes *r, const lr_volume *v, const lr_doubles o[3],
                               const lr_doubles d[3], lr_doubles t_max)
{
    const double *m = v->storage_from_object;
    const lr_doubles zero = {0}, none = lr_all_doubles(LR_LEAST_COMPONENT);
    lr_doubles largest = zero, sum = zero;
    for (int i = 0; i < 3; i++) {
        r->o[i] = m[4 * i] * o[0] + m[4 * i + 1] * o[1] + m[4 * i + 2] * o[2] + m[4 * i + 3];
        r->d[i] = m[4 * i] * d[0] + m[4 * i + 1] * d[1] + m[4 * i + 2] * d[2];
        const lr_doubles size = lr_absolute_doubles(r->d[i]);
        largest = lr_greater_doubles(size, largest);
        sum += r->o[i] - r->o[i] + (size - size);
    }
    r->is = (largest >= none) & (sum == zero);
    const lr_doubles least = lr_greater_doubles(LR_TINY_COMPONENT * largest, none);
    for (int i = 0; i < 3; i++) {
        const lr_longs moves = lr_absolute_doubles(r->d[i]) >= least;
        r->up[i] = moves & (r->d[i] > zero);
        r->down[i] = moves & (r->d[i] < zero);
        r->inv[i] = lr_pick_doubles(moves, 1.0 / r->d[i], zero);
    }
    r->t_max = t_max;
}

/* As lr_enter; which of them do. */
LR_INLINE lr_longs lr_enter_box_lanes(const lr_enter_lanes *r, const int32_t lo[3],
                                      const int32_t hi[3], lr_doubles t_min, lr_cursor_lanes *u)
{
    const double wider = 1.0 + 8.0 * 0x1p-53;
    lr_doubles t1 = r->t_max;
    lr_longs enters = r->is & (t_min <= r->t_max) & (t_min < INFINITY);
    u->t = t_min;
    u->axis = lr_all_doubles(-1.0);
    for (int a = 0; a < 3; a++) {
        const lr_doubles low = lr_all_doubles(lo[a]), high = lr_all_doubles(hi[a] + 1.0);
        const lr_longs moves = r->up[a] | r->down[a];
        const lr_doubles near = (lr_pick_doubles(r->up[a], low, high) - r->o[a]) * r->inv[a];
        lr_doubles far = (lr_pick_doubles(r->up[a], high, low) - r->o[a]) * r->inv[a];
        enters &= moves | ((r->o[a] >= low) & (r->o[a] < high));
        const lr_longs later = moves & (near > u->t);
        u->t = lr_pick_doubles(later, near, u->t);
        u->axis = lr_pick_doubles(later, lr_all_doubles(a), u->axis);
        far = lr_pick_doubles(far > 0.0, far * wider, far);
        t1 = lr_pick_doubles(moves & (far < t1), far, t1);
    }
    for (int a = 0; a < 3; a++) {
        const lr_doubles low = lr_all_doubles(lo[a]), high = lr_all_doubles(hi[a]);
        const lr_longs moves = r->up[a] | r->down[a];
        const lr_doubles q = lr_pick_doubles(moves, r->o[a] + u->t * r->d[a], r->o[a]);
        lr_doubles c = lr_rounded_down_doubles(q);
        c = lr_pick_doubles(r->down[a] & (c == q), c - 1.0, c);
        u->c[a] = lr_pick_doubles(u->axis == (double)a, lr_pick_doubles(r->up[a], low, high),
                                  lr_clamp_doubles(c, low, high));
    }
    return enters & (u->t <= t1);
}
