/* Emission and absorption over a part of a ray on which the value is a cubic, without steps.
 *
 * The part is cut where the cubic passes a knot. On what lies between, extinction, colour and
 * emission are polynomials; optical depth is one, too, and exact. With y the value's distance from
 * its middle and A the depth behind the part's beginning, all that is left are integrals of
 *     y dA/dx exp(-A), exp(-A), y exp(-A),
 * whatever the number of colours; of one colour only the first kind's closed form, 1 - exp(-A), is
 * needed. They are taken by Gauss and Legendre's rule of four nodes where its error is bounded:
 * with x running from -1 to 1, a function whose power series is majorised by M(R) within R errs by
 * less than LR_RULE_LOST M(R) / R^8, since the rule is exact up to degree 7. Polynomials are
 * majorised by the moduli of their coefficients. Where the bound is too large the piece is halved.
 *
 * Source: Max, Optical models for direct volume rendering, 1995 (the integral); Williams and Max,
 * A volume density optical model, 1992 (linear pieces, in closed form).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/emission_absorption.h"

#include "trace/cell.h"
#include "trace/light_stretch.h"
#include "trace/modulated_light.h"

LR_INLINE void set_up(lr_stretch *s, const lr_transfer_piece *p, const double c[4], double a,
                      double b, double length)
{
    lr_stretch_of(s, c, a, b, length, p->from, p->extinction);
}

/* Is the error of the piece within its share, by one of two bounds? */
static bool within(const lr_stretch *s, const lr_transfer_piece *p, double tolerance)
{
    static const double radius[] = {4.0, 7.0};
    for (int i = 0; i < 2; i++) {
        double error[3];
        lr_stretch_bound(s, radius[i], error);
        if (lr_light_sum_within(p, tolerance, s->middle, s->depth, s->half, error))
            return true;
    }
    return false;
}

/* Emission alone: exact. */
static void add_emission(lr_light_sum *sum, const lr_transfer_piece *p, const lr_stretch *s)
{
    const double integrals[3] = {0.0, 2.0 * s->half, s->y[1] * s->half * (2.0 / 3.0)};
    lr_light_sum_add(sum, p, s->middle, 1.0, integrals);
}

/* What is so short that it has one value, and may be as deep as numbers go. */
static void add_point(lr_light_sum *sum, const lr_transfer_piece *p, const lr_stretch *s)
{
    const double after = exp(-s->depth);
    const double seen = s->depth > 0.0 ? (1.0 - after) / s->depth : 1.0;
    const double integrals[3] = {0.0, 2.0 * s->half * seen, 0.0};
    lr_light_sum_add(sum, p, s->middle, after, integrals);
}

/* Where the piece is as deep: x from -1 to 1. Newton's steps, kept inside a bracket. */
static double find_depth(const lr_stretch *s, double depth)
{
    const double *a = s->a, target = depth - (a[0] - a[1] + a[2] - a[3]);
    double low = -1.0, high = 1.0, x = depth / s->depth * 2.0 - 1.0;
    for (int step = 0; step < 60 && high - low > LR_ROOT_ENOUGH; step++) {
        if (!(x > low && x < high))
            x = 0.5 * (low + high);
        const double excess = (((a[3] * x + a[2]) * x + a[1]) * x + a[0]) * x - target;
        const double slope = ((4.0 * a[3] * x + 3.0 * a[2]) * x + 2.0 * a[1]) * x + a[0];
        if (excess < 0.0)
            low = x;
        else
            high = x;
        const double next = x - excess / slope; /* NaN and infinity are caught above */
        if (fabs(next - x) <= LR_ROOT_ENOUGH)
            return lr_clamp(next, low, high);
        x = next;
    }
    return 0.5 * (low + high);
}

/* Follow the cubic from a to b on one piece, and end where the transmittance is sum->stop. */
static void end_in_piece(lr_light_sum *sum, const lr_transfer_piece *p, const double c[4], double a,
                         double b, double length)
{
    if (!p->absorbs || sum->ended)
        return;
    lr_stretch s;
    set_up(&s, p, c, a, b, length);
    const double after = exp(-s.depth) * sum->transmittance;
    sum->pieces++;
    if (after > sum->stop) {
        sum->transmittance = after;
        return;
    }
    const double x = find_depth(&s, log(sum->transmittance / sum->stop));
    sum->ended = true;
    sum->transmittance = sum->stop;
    sum->at = lr_mix(a, b, 0.5 * (1.0 + x));
    lr_albedo_at(p, s.middle + ((s.y[2] * x + s.y[1]) * x + s.y[0]) * x, sum->albedo);
}

void lr_add_piece(lr_light_sum *sum, const lr_transfer_piece *p, const double c[4], const double *m,
                  double a, double b, double length)
{
    static const double none[3] = {0.0, 0.0, 0.0};
    if (m != NULL) {
        lr_add_modulated(sum, p, c, m, a, b, length);
        return;
    }
    if (sum->stop > 0.0) {
        end_in_piece(sum, p, c, a, b, length);
        return;
    }
    if (!p->absorbs && !p->emits)
        return;
    const double end = b;
    int halvings = 0;
    while (a < end && sum->transmittance > LR_OPAQUE) {
        lr_stretch s;
        set_up(&s, p, c, a, b, length);
        const bool closed = p->one_color && !p->emits;
        if (closed) {
            lr_light_sum_add(sum, p, s.middle, lr_lane_exp(-s.depth), none);
        } else if (!p->absorbs) {
            add_emission(sum, p, &s);
        } else if (!within(&s, p, sum->tolerance)) {
            const double middle = 0.5 * (a + b);
            if (halvings < LR_MOST_HALVINGS && middle > a && middle < b) {
                b = middle;
                halvings++;
                continue;
            }
            add_point(sum, p, &s);
        } else {
            double integrals[3];
            lr_stretch_integrate(&s, integrals);
            lr_light_sum_add(sum, p, s.middle, lr_lane_exp(-s.depth), integrals);
        }
        const double size = b - a;
        a = b;
        b = halvings > 0 ? lr_clamp(a + 2.0 * size, a, end) : end;
        halvings -= halvings > 0;
    }
}

/* The cubic from a to b, where it runs one way from fa to fb: cut where it passes knots. */
static void add_monotone(lr_light_sum *sum, const lr_transfer *f, const double c[4],
                         const double *m, double a, double b, double fa, double fb, double length)
{
    const bool up = fb > fa;
    uint64_t piece = up ? lr_piece_of(f, fa) : lr_piece_below(f, fa);
    for (;;) {
        const bool last =
            up ? piece == f->n || f->values[piece] >= fb : piece == 0 || f->values[piece - 1] <= fb;
        if (last)
            break;
        const double level = f->values[up ? piece : piece - 1];
        const lr_bracket bracket = {a, b, fa, fb, !up};
        uint64_t n_samples = 0;
        const double at = lr_root_newton(c, level, bracket, &n_samples);
        lr_add_piece(sum, &f->pieces[piece], c, m, a, at, length);
        a = at;
        fa = level;
        piece = up ? piece + 1 : piece - 1;
    }
    lr_add_piece(sum, &f->pieces[piece], c, m, a, b, length);
}

/* Bounds of the cubic on a..b, by its Bernstein coefficients. */
LR_INLINE void hull(const double c[4], double a, double b, double *low, double *high)
{
    const double h = b - a;
    const double d0 = lr_cubic(c, a), d1 = lr_cubic_slope(c, a) * h;
    const double d2 = (3.0 * c[3] * a + c[2]) * h * h, d3 = c[3] * h * h * h;
    const double b1 = d0 + d1 * (1.0 / 3.0), b2 = b1 + (d1 + d2) * (1.0 / 3.0);
    const double b3 = d0 + d1 + d2 + d3;
    *low = fmin(fmin(d0, b1), fmin(b2, b3));
    *high = fmax(fmax(d0, b1), fmax(b2, b3));
}

void lr_add_cubic(lr_light_sum *sum, const lr_transfer *f, const double c[4], const double *m,
                  double a, double b, double length)
{
    double low, high, x[2];
    hull(c, a, b, &low, &high);
    const uint64_t piece = lr_piece_of(f, low);
    if (piece == f->n || high < f->values[piece]) {
        lr_add_piece(sum, &f->pieces[piece], c, m, a, b, length);
        return;
    }
    const int n = lr_cubic_extrema(c, x);
    double fa = lr_cubic(c, a);
    for (int i = 0; i <= n; i++) {
        const double end = i < n ? x[i] : b;
        if (!(end > a) || end > b)
            continue;
        const double fb = lr_cubic(c, end);
        add_monotone(sum, f, c, m, a, end, fa, fb, length);
        a = end;
        fa = fb;
    }
}
