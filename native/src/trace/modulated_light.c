/* Emission and absorption where all that is seen is times a cubic m, 0 to 1: opacity modulated by
 * the length of the gradient, which is given at the samples and trilinear between.
 *
 * On a piece of the transfer function extinction is a polynomial of degree 6 then, the product of
 * one that is linear in the cubic of the value, and m. Optical depth is exact, of degree 7. The
 * integrals are those of emission_absorption.c, with m beside emission:
 *     y dA/dx exp(-A), m exp(-A), y m exp(-A),
 * by the same rule and bound. No term of theirs is a polynomial that the rule takes exactly, so the
 * bound is that of the whole.
 *
 * Source: Levoy, Display of surfaces from volume data, 1988 (opacity times the gradient).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/modulated_light.h"

#include "grid/trilinear.h"
#include "trace/cubic_root.h"
#include "trace/light_rule.h"

enum { DEPTH_TERMS = 7 };

/* A piece of the ray; x runs from -1 to 1. */
typedef struct stretch {
    double middle;         /* value at x = 0, from the piece's own zero */
    double y[4];           /* value - that = sum y[i] x^i, y[0] = 0 */
    double m[4];           /* the part that is seen */
    double a[DEPTH_TERMS]; /* optical depth behind x = 0: sum a[i] x^(i + 1) */
    double depth;          /* from -1 to 1 */
    double half;           /* length of x from 0 to 1 */
} stretch;

/* sum c[i] x^i about the middle of a..b, whose ends are -1 and 1. */
static void recentre(const double c[4], double a, double b, double to[4])
{
    const double m = 0.5 * (a + b), h = 0.5 * (b - a);
    to[0] = lr_cubic(c, m);
    to[1] = lr_cubic_slope(c, m) * h;
    to[2] = (3.0 * c[3] * m + c[2]) * h * h;
    to[3] = c[3] * h * h * h;
}

static double polynomial(const double *c, int n, double x)
{
    double sum = 0.0;
    for (int i = n - 1; i >= 0; i--)
        sum = sum * x + c[i];
    return sum;
}

static double depth_at(const stretch *s, double x)
{
    return polynomial(s->a, DEPTH_TERMS, x) * x;
}

static double depth_slope(const stretch *s, double x)
{
    double slope[DEPTH_TERMS];
    for (int i = 0; i < DEPTH_TERMS; i++)
        slope[i] = (i + 1) * s->a[i];
    return polynomial(slope, DEPTH_TERMS, x);
}

static void set_up(stretch *s, const lr_transfer_piece *p, const double c[4], const double m[4],
                   double a, double b, double length)
{
    double extinction[4], product[DEPTH_TERMS] = {0.0};
    recentre(c, a, b, s->y);
    recentre(m, a, b, s->m);
    s->half = 0.5 * (b - a) * length;
    s->middle = s->y[0] - p->from;
    s->y[0] = 0.0;
    extinction[0] = fmax(lr_linear(p->extinction, s->middle), 0.0);
    for (int i = 1; i < 4; i++)
        extinction[i] = p->extinction[1] * s->y[i];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            product[i + k] += extinction[i] * s->m[k];
    for (int i = 0; i < DEPTH_TERMS; i++)
        s->a[i] = product[i] * s->half / (i + 1);
    s->depth = fmax(2.0 * (s->a[0] + s->a[2] + s->a[4] + s->a[6]), 0.0);
}

/* The polynomial of the moduli. */
static double majorant(const double *c, int n, double r)
{
    double sum = 0.0;
    for (int i = n - 1; i >= 0; i--)
        sum = sum * r + fabs(c[i]);
    return sum;
}

/* Bounds of what the rule errs, for the three integrals. */
static void bound(const stretch *s, double r, double error[3])
{
    double slope[DEPTH_TERMS];
    for (int i = 0; i < DEPTH_TERMS; i++)
        slope[i] = (i + 1) * s->a[i];
    const double depth = majorant(s->a, DEPTH_TERMS, r) * r, r2 = r * r, r4 = r2 * r2;
    const double lost = depth < 40.0 ? LR_RULE_LOST / (r4 * r4) * exp(depth) : INFINITY;
    const double y = majorant(s->y, 4, r);
    error[0] = lost * y * majorant(slope, DEPTH_TERMS, r);
    error[1] = lost * majorant(s->m, 4, r) * s->half;
    error[2] = error[1] * y;
}

/* Is the error of the piece within its share? As in emission_absorption.c, but that where little is
 * seen the share of the length is that of what is seen of it. */
static bool within(const stretch *s, const lr_transfer_piece *p, double tolerance)
{
    static const double radius[] = {4.0, 7.0};
    for (int i = 0; i < 2; i++) {
        double error[3];
        bound(s, radius[i], error);
        if (lr_light_sum_within(p, tolerance, s->middle, s->depth, s->half, error))
            return true;
    }
    return false;
}

/* Of a piece behind its beginning: sums[0..2] of the three integrals; exact without extinction. */
static void integrate(const stretch *s, double sums[3])
{
    const double start = lr_rule_exp(depth_at(s, -1.0));
    sums[0] = sums[1] = sums[2] = 0.0;
    for (int k = 0; k < LR_RULE_NODES; k++) {
        const double x = lr_rule_node[k];
        const double y = polynomial(s->y, 4, x), m = polynomial(s->m, 4, x);
        const double e = lr_rule_weight[k] * lr_rule_exp(-depth_at(s, x)) * start;
        sums[0] += e * depth_slope(s, x) * y;
        sums[1] += e * m * s->half;
        sums[2] += e * m * y * s->half;
    }
}

/* What is so short that it has one value, and may be as deep as numbers go. */
static void integrate_point(const stretch *s, double after, double sums[3])
{
    sums[0] = sums[2] = 0.0;
    sums[1] = 2.0 * s->half * s->m[0] * (s->depth > 0.0 ? (1.0 - after) / s->depth : 1.0);
}

/* Where the piece is as deep: x from -1 to 1. Newton's steps, kept inside a bracket. */
static double find_depth(const stretch *s, double depth)
{
    const double target = depth + depth_at(s, -1.0);
    double low = -1.0, high = 1.0, x = depth / s->depth * 2.0 - 1.0;
    for (int step = 0; step < 60 && high - low > LR_ROOT_ENOUGH; step++) {
        if (!(x > low && x < high))
            x = 0.5 * (low + high);
        const double excess = depth_at(s, x) - target;
        if (excess < 0.0)
            low = x;
        else
            high = x;
        const double next = x - excess / depth_slope(s, x); /* what is no number is caught above */
        if (fabs(next - x) <= LR_ROOT_ENOUGH)
            return lr_clamp(next, low, high);
        x = next;
    }
    return 0.5 * (low + high);
}

/* Follow the whole piece, and end where the transmittance is sum->stop. */
static void end_in(lr_light_sum *sum, const lr_transfer_piece *p, const stretch *s, double a,
                   double b)
{
    const double after = exp(-s->depth) * sum->transmittance;
    sum->pieces++;
    if (after > sum->stop) {
        sum->transmittance = after;
        return;
    }
    const double x = find_depth(s, log(sum->transmittance / sum->stop));
    sum->ended = true;
    sum->transmittance = sum->stop;
    sum->at = lr_mix(a, b, 0.5 * (1.0 + x));
    lr_albedo_at(p, s->middle + polynomial(s->y, 4, x), sum->albedo);
}

/* Add a part of the piece; false where it is to be halved. last: it cannot be. */
static bool add_part(lr_light_sum *sum, const lr_transfer_piece *p, const stretch *s, bool last)
{
    double integrals[3] = {0.0, 0.0, 0.0};
    const double after = exp(-s->depth);
    const bool closed = !p->absorbs || (p->one_color && !p->emits);
    if (!closed && !(s->depth <= LR_RULE_DEEPEST && within(s, p, sum->tolerance))) {
        if (!last)
            return false;
        integrate_point(s, after, integrals);
    } else if (p->emits || !p->one_color) {
        integrate(s, integrals);
    }
    lr_light_sum_add(sum, p, s->middle, after, integrals);
    return true;
}

void lr_add_modulated(lr_light_sum *sum, const lr_transfer_piece *p, const double c[4],
                      const double m[4], double a, double b, double length)
{
    stretch s;
    if (sum->stop > 0.0) {
        set_up(&s, p, c, m, a, b, length);
        if (p->absorbs && !sum->ended)
            end_in(sum, p, &s, a, b);
        return;
    }
    if (!p->absorbs && !p->emits)
        return;
    const double end = b;
    int halvings = 0;
    while (a < end && sum->transmittance > LR_OPAQUE) {
        const double middle = 0.5 * (a + b);
        set_up(&s, p, c, m, a, b, length);
        if (!add_part(sum, p, &s, !(halvings < LR_MOST_HALVINGS && middle > a && middle < b))) {
            b = middle;
            halvings++;
            continue;
        }
        const double size = b - a;
        a = b;
        b = halvings > 0 ? lr_clamp(a + 2.0 * size, a, end) : end;
        halvings -= halvings > 0;
    }
}
