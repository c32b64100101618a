/* The uniform hit test: equidistant samples along the ray.
 *
 * The field is taken at t_min, t_min + step, ...; the surface lies between the
 * first two neighbours on different sides, which may be several cells apart. Its
 * derivative jumps at every face in between, so that only bisection and linear
 * interpolation apply. Whatever begins and ends between two samples is lost.
 *
 * Only samples in surface cells and the ones before and after them are evaluated;
 * beyond, the side cannot change.
 *
 * Source: Sramek 1994, section 5 (the way of RADC).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_UNIFORM_SAMPLES_H
#define LR_TRACE_UNIFORM_SAMPLES_H

#include "trace/cell.h"

/* The storage cell around the ray's point at t, its corners, and f there. */
LR_INLINE double lr_sample_along(const lr_volume *v, const lr_ray *r, double t, lr_found *at)
{
    const int32_t last[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1};
    at->t = t;
    for (int a = 0; a < 3; a++) {
        double q = r->s[a] == 0 ? r->o[a] : r->o[a] + t * r->d[a];
        at->c[a] = (int32_t)lr_clamp(floor(q), 1.0, last[a]);
        at->p[a] = lr_clamp(q - at->c[a], 0.0, 1.0);
    }
    lr_corners(v, at->c, at->corner);
    return lr_trilinear(at->corner, at->p);
}

LR_INLINE bool lr_hit_uniform(const lr_volume *v, const lr_ray *r, const lr_cursor *u, double t_min,
                              int side, const lr_trace_options *options, lr_found *found,
                              uint64_t *n_samples)
{
    int axis;
    const double level = v->threshold, length = sqrt(lr_dot(r->d, r->d));
    const double step = options->step / length;
    /* no cell is longer, also where the ray was said to start in a cell far from its origin */
    const double t_end = fmax(u->t, t_min) + 2.0 / length;
    const double t_out = fmin(lr_exit_t(r, LR_REGULAR, u->c, u->c, &axis), t_end);
    const double first = ceil((u->t - t_min) / step);
    double ta = t_min + (first > 0.0 ? first - 1.0 : 0.0) * step;
    double fa = lr_sample_along(v, r, ta, found);
    ++*n_samples;
    const bool above = side != 0 && ta == t_min ? side > 0 : fa >= level;
    for (double k = first > 0.0 ? first : 1.0;; k += 1.0) {
        double tb = t_min + k * step;
        if (!(tb > ta))
            return false;
        double fb = lr_sample_along(v, r, tb, found);
        ++*n_samples;
        if ((fb >= level) == above) {
            if (!(tb < t_out))
                return false;
            ta = tb;
            fa = fb;
            continue;
        }
        if (options->root == LR_ROOT_LINEAR) {
            const lr_bracket bracket = {ta, tb, fa, fb, above};
            ta = lr_root_linear(level, bracket);
        } else {
            const double enough = LR_ROOT_ENOUGH * (tb - ta);
            while (tb - ta > enough) {
                double t = 0.5 * (ta + tb);
                if (!(t > ta && t < tb))
                    break;
                ++*n_samples;
                if ((lr_sample_along(v, r, t, found) >= level) == above)
                    ta = t;
                else
                    tb = t;
            }
        }
        lr_sample_along(v, r, ta, found);
        return ta <= r->t_max;
    }
}

#endif
