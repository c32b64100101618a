/* Does the ray meet the surface f = T inside the cell it stands on, and where?
 *
 * Along the ray the trilinear field is a cubic. Its values at the entry and the
 * exit are taken on the faces, bilinearly from the face's own four samples, so
 * that both cells of a face see the same bits and no ray slips between them.
 * `faces` looks at these two values only; `extrema` also at the extrema of the
 * cubic, so that an entry and exit through the same face of the surface is not
 * lost. The first interval with a change of sides holds the first root.
 *
 * Source: Sramek 1994, section 5 (faces, int); Marmitt, Kleer, Wald et al. 2004
 * (splitting at extrema). Departure: coefficients are taken at the entry, not at
 * the ray's origin.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CELL_H
#define LR_TRACE_CELL_H

#include "grid/triangle_cells.h"
#include "grid/trilinear.h"
#include "trace/cubic_root.h"
#include "trace/ray.h"

/* A ray's way through one cell. */
typedef struct lr_chord {
    double corner[8];
    double in[3], out[3]; /* cell coordinates */
    double t_in, t_out;
    double f_in, f_out;
    double c[4]; /* f = sum c[i] x^i, x = 0..1 from in to out */
} lr_chord;

typedef struct lr_found {
    double t;
    int32_t c[3]; /* storage cell */
    double p[3];  /* cell coordinates */
    double corner[8];
    uint32_t triangle; /* of a triangle cell; or LR_NO_TRIANGLE */
    int32_t object;    /* in a volume that tells objects apart; or LR_NO_OBJECT */
} lr_found;

/* f on the face where coordinate a is 0 or 1. */
LR_INLINE double lr_face_value(const double s[8], int a, bool upper, const double p[3])
{
    const int u = a == 0 ? 1 : 0, v = a == 2 ? 1 : 2;
    const int first = upper ? 1 << a : 0, du = 1 << u, dv = 1 << v;
    return lr_mix(lr_mix(s[first], s[first + du], p[u]),
                  lr_mix(s[first + dv], s[first + du + dv], p[u]), p[v]);
}

LR_INLINE void lr_chord_points(lr_chord *h, const lr_ray *r, lr_lattice lattice, const lr_cursor *u,
                               int *axis_out)
{
    h->t_in = u->t;
    h->t_out = lr_exit_t(r, lattice, u->c, u->c, axis_out);
    h->t_out = h->t_out > h->t_in ? h->t_out : h->t_in;
    for (int a = 0; a < 3; a++) {
        const double low = lr_plane_at(r, lattice, a, u->c[a]);
        double in = r->o[a] + h->t_in * r->d[a] - low;
        double out = r->o[a] + h->t_out * r->d[a] - low;
        if (r->s[a] == 0) /* t may be so large that 0 * t is not */
            in = out = r->o[a] - low;
        if (lattice == LR_RECTILINEAR) {
            const double size = lr_plane_at(r, lattice, a, u->c[a] + 1) - low;
            in /= size;
            out /= size;
        }
        h->in[a] = a == u->axis ? (r->s[a] > 0 ? 0.0 : 1.0) : lr_clamp(in, 0.0, 1.0);
        h->out[a] = a == *axis_out ? (r->s[a] > 0 ? 1.0 : 0.0) : lr_clamp(out, 0.0, 1.0);
    }
}

LR_INLINE void lr_chord_values(lr_chord *h, const lr_ray *r, const lr_cursor *u, int axis_out)
{
    const double *s = h->corner;
    h->f_in =
        u->axis < 0 ? lr_trilinear(s, h->in) : lr_face_value(s, u->axis, r->s[u->axis] < 0, h->in);
    h->f_out = lr_face_value(s, axis_out, r->s[axis_out] > 0, h->out);
}

LR_INLINE void lr_chord_cubic(lr_chord *h)
{
    lr_cubic_between(h->corner, h->in, h->out, h->f_in, h->c);
}

/* Ascending extrema of the cubic inside (0, 1); how many. */
LR_INLINE int lr_cubic_extrema(const double c[4], double x[2])
{
    const double a = 3.0 * c[3], b = 2.0 * c[2]; /* a x^2 + b x + c1 = 0 */
    const double square = b * b - 4.0 * a * c[1];
    if (!(square >= 0.0))
        return 0;
    const double q = -0.5 * (b + copysign(sqrt(square), b));
    double first = q / a, second = c[1] / q; /* either may be infinite or NaN: no extremum */
    if (first > second) {
        double swap = first;
        first = second;
        second = swap;
    }
    int n = 0;
    if (first > 0.0 && first < 1.0)
        x[n++] = first;
    if (second > 0.0 && second < 1.0)
        x[n++] = second;
    return n;
}

/* Of what the coefficients add up to: more than all that rounding does to the cubic. */
#define LR_CUBIC_SLACK 1e-9

/* Does the cubic surely stay on this side of level, or run one way, so that no extremum in
 * (0, 1) tells of another side? It lies in the hull of its Bernstein coefficients, its
 * slope in that of its own. Saves most cells the search for extrema. */
LR_INLINE bool lr_cubic_stays(const double c[4], double level, bool above)
{
    const double slack = LR_CUBIC_SLACK * (fabs(c[0]) + fabs(c[1]) + fabs(c[2]) + fabs(c[3]));
    const double sign = above ? 1.0 : -1.0, b0 = sign * (c[0] - level);
    const double d0 = sign * c[1], d1 = d0 + sign * c[2];
    const double b1 = b0 + d0 * (1.0 / 3.0), b2 = b1 + d1 * (1.0 / 3.0);
    const double d2 = d1 + sign * (c[2] + 3.0 * c[3]), b3 = b2 + d2 * (1.0 / 3.0);
    if (d0 > slack && d1 > slack && d2 > slack)
        return true;
    return b0 > slack && b1 > slack && b2 > slack && b3 > slack;
}

/* corner: of the cell that the ray stands on. side: where the ray starts in it, -1 below
 * T, +1 at or above, 0: as f says. A ray that starts on the surface always looks at the
 * extrema. */
LR_INLINE bool lr_hit_corners(const lr_volume *v, const double corner[8], const lr_ray *r,
                              lr_lattice lattice, const lr_cursor *u, int side,
                              const lr_trace_options *options, lr_found *found, uint64_t *n_samples)
{
    lr_chord h;
    int axis_out;
    memcpy(h.corner, corner, sizeof h.corner);
    lr_chord_points(&h, r, lattice, u, &axis_out);
    lr_chord_values(&h, r, u, axis_out);
    *n_samples += 2;
    const double level = v->threshold;
    const bool above = side != 0 ? side > 0 : h.f_in >= level;
    const bool change = (h.f_out >= level) != above;
    const bool extrema = options->hit_test == LR_HIT_EXTREMA || side != 0;
    if (!change && !extrema)
        return false;
    lr_chord_cubic(&h);
    if (!change && lr_cubic_stays(h.c, level, above))
        return false;
    double x[2];
    lr_bracket k = {0.0, 1.0, h.f_in, h.f_out, above};
    bool bracketed = change;
    int n = extrema ? lr_cubic_extrema(h.c, x) : 0;
    for (int i = 0; i < n; i++) {
        double f = lr_cubic(h.c, x[i]);
        ++*n_samples;
        if ((f >= level) != above) {
            k.b = x[i];
            k.fb = f;
            bracketed = true;
            break;
        }
        k.a = x[i];
        k.fa = f;
    }
    if (!bracketed)
        return false;
    double at = options->root == LR_ROOT_LINEAR   ? lr_root_linear(level, k)
                : options->root == LR_ROOT_NEWTON ? lr_root_newton(h.c, level, k, n_samples)
                : options->root == LR_ROOT_BISECT ? lr_root_bisect(h.c, level, k, n_samples)
                                                  : lr_root_cubic(h.c, level, k, n_samples);
    found->t = h.t_in + at * (h.t_out - h.t_in);
    if (!(found->t <= r->t_max)) /* asked only now, so that t does not depend on it */
        return false;
    for (int i = 0; i < 3; i++)
        found->p[i] = h.in[i] + at * (h.out[i] - h.in[i]);
    memcpy(found->c, u->c, sizeof found->c);
    memcpy(found->corner, h.corner, sizeof h.corner);
    return true;
}

LR_INLINE bool lr_hit_cell(const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                           const lr_cursor *u, int side, const lr_trace_options *options,
                           lr_found *found, uint64_t *n_samples)
{
    double corner[8];
    lr_corners(v, u->c, corner);
    return lr_hit_corners(v, corner, r, lattice, u, side, options, found, n_samples);
}

#endif
