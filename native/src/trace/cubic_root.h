/* Root finders: where in a bracket the cubic along the ray passes T.
 *
 * All work on one bracket [a, b] whose ends lie on different sides, so none can
 * fail; where rounding denies the change of sides, the end that is to blame is
 * the root.
 *
 * Source: Sramek 1994, section 5 (newt, bisect, int). Departures: 1. Newton's
 * steps are kept inside the bracket; 2. cubic is the closed form by cosines or by
 * Cardano, corrected by one step of Newton.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CUBIC_ROOT_H
#define LR_TRACE_CUBIC_ROOT_H

#include "grid/trilinear.h"

/* A bracket: f(a) lies on side `above` of level, f(b) on the other one. */
typedef struct lr_bracket {
    double a, b;
    double fa, fb;
    bool above;
} lr_bracket;

/* Of a chord, which is at most sqrt(3) voxels long. */
#define LR_ROOT_ENOUGH 1e-13

/* Does the cubic itself, rounded as it is, change sides? If not, *root is the end
 * that is to blame. */
LR_INLINE bool lr_bracket_holds(const double c[4], double level, lr_bracket *k, double *root,
                                uint64_t *n_samples)
{
    k->fa = lr_cubic(c, k->a) - level;
    k->fb = lr_cubic(c, k->b) - level;
    *n_samples += 2;
    *root = (k->fa >= 0.0) != k->above ? k->a : k->b;
    return (k->fa >= 0.0) == k->above && (k->fb >= 0.0) != k->above;
}

LR_INLINE double lr_root_newton(const double c[4], double level, lr_bracket k, uint64_t *n_samples)
{
    double x;
    if (!lr_bracket_holds(c, level, &k, &x, n_samples))
        return x;
    x = k.a + (k.b - k.a) * k.fa / (k.fa - k.fb);
    for (int step = 0; step < 60 && k.b - k.a > LR_ROOT_ENOUGH; step++) {
        if (!(x > k.a && x < k.b))
            x = 0.5 * (k.a + k.b);
        double fx = lr_cubic(c, x) - level;
        ++*n_samples;
        if ((fx >= 0.0) == k.above)
            k.a = x;
        else
            k.b = x;
        double next = x - fx / lr_cubic_slope(c, x); /* NaN and infinity are caught above */
        if (fabs(next - x) <= LR_ROOT_ENOUGH)
            return lr_clamp(next, k.a, k.b);
        x = next;
    }
    return 0.5 * (k.a + k.b);
}

LR_INLINE double lr_root_bisect(const double c[4], double level, lr_bracket k, uint64_t *n_samples)
{
    double x;
    if (!lr_bracket_holds(c, level, &k, &x, n_samples))
        return x;
    while (k.b - k.a > LR_ROOT_ENOUGH) {
        x = 0.5 * (k.a + k.b);
        ++*n_samples;
        if ((lr_cubic(c, x) >= level) == k.above)
            k.a = x;
        else
            k.b = x;
    }
    return 0.5 * (k.a + k.b);
}

LR_INLINE double lr_root_linear(double level, lr_bracket k)
{
    double x = k.a + (k.b - k.a) * (level - k.fa) / (k.fb - k.fa);
    return x >= k.a && x <= k.b ? x : k.a;
}

/* Real roots of the cubic = level, unordered; how many. */
LR_INLINE int lr_cubic_roots(const double c[4], double level, double root[3])
{
    const double c0 = c[0] - level;
    const double largest = fmax(fabs(c0), fmax(fabs(c[1]), fabs(c[2])));
    if (!(fabs(c[3]) > 1e-9 * largest)) { /* a quadratic, or less, to nine digits */
        const double square = c[1] * c[1] - 4.0 * c[2] * c0;
        if (!(square >= 0.0))
            return 0;
        const double q = -0.5 * (c[1] + copysign(sqrt(square), c[1]));
        root[0] = q / c[2];
        root[1] = c0 / q;
        return 2;
    }
    const double b = c[2] / (3.0 * c[3]), p = c[1] / (3.0 * c[3]) - b * b;
    const double q = b * b * b - 0.5 * b * c[1] / c[3] + 0.5 * c0 / c[3];
    const double square = q * q + p * p * p;
    if (square > 0.0) {
        const double s = cbrt(-q - copysign(sqrt(square), q));
        root[0] = (s != 0.0 ? s - p / s : 0.0) - b;
        return 1;
    }
    const double third = 2.0943951023931953; /* 2 pi / 3 */
    const double angle = atan2(sqrt(-square), -q) / 3.0, radius = 2.0 * sqrt(-p);
    for (int i = 0; i < 3; i++)
        root[i] = radius * cos(angle + i * third) - b;
    return 3;
}

LR_INLINE double lr_root_cubic(const double c[4], double level, lr_bracket k, uint64_t *n_samples)
{
    double root[3], x;
    if (!lr_bracket_holds(c, level, &k, &x, n_samples))
        return x;
    const double slack = 1e-6 * (k.b - k.a);
    const int n = lr_cubic_roots(c, level, root);
    for (int i = 0; i < n; i++)
        if (root[i] >= k.a - slack && root[i] <= k.b + slack) {
            x = root[i] - (lr_cubic(c, root[i]) - level) / lr_cubic_slope(c, root[i]);
            ++*n_samples;
            if (fabs(x - root[i]) <= slack)
                return lr_clamp(x, k.a, k.b);
        }
    return lr_root_bisect(c, level, k, n_samples); /* a double root, to rounding */
}

#endif
