/* What all modules of the core share.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_BASE_H
#define LR_BASE_BASE_H

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "leapray.h"

#ifndef LR_INLINE /* counts of branches are of a function, not of each copy of it */
#define LR_INLINE static inline __attribute__((always_inline))
#endif
#ifdef __clang__ /* before a loop of a number of turns that is a constant */
#define LR_UNROLLED _Pragma("clang loop unroll(full)")
#else
#define LR_UNROLLED
#endif
#define LR_PI 3.14159265358979323846

LR_INLINE int32_t lr_min_i(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

LR_INLINE int32_t lr_max_i(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

/* NaN in x gives lo. */
LR_INLINE double lr_clamp(double x, double lo, double hi)
{
    double y = x > lo ? x : lo;
    return y < hi ? y : hi;
}

LR_INLINE double lr_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

LR_INLINE void lr_sub(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[i] - b[i];
}

LR_INLINE void lr_cross_product(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Two unit vectors at right angles to the unit vector n and to each other.
 * Source: Duff et al., Building an orthonormal basis, revisited, 2017. */
LR_INLINE void lr_orthonormal_basis(const double n[3], double s[3], double t[3])
{
    const double sign = copysign(1.0, n[2]);
    const double a = -1 / (sign + n[2]), b = n[0] * n[1] * a;
    s[0] = 1 + sign * n[0] * n[0] * a;
    s[1] = sign * b;
    s[2] = -sign * n[0];
    t[0] = b;
    t[1] = sign + n[1] * n[1] * a;
    t[2] = -n[1];
}

LR_INLINE bool lr_all_finite(const double *x, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i]))
            return false;
    return true;
}

/* Wellons 2018, "lowbias32": a bijection with nearly ideal avalanche. */
LR_INLINE uint32_t lr_hash(uint32_t x)
{
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    return x ^ x >> 16;
}

LR_INLINE bool lr_stopped(const lr_watch *watch)
{
    return watch != NULL && watch->stop != NULL && *watch->stop != 0;
}

/* For long loops over small things: asks once in 2^16 turns. */
LR_INLINE bool lr_stopped_now_and_then(const lr_watch *watch, uint64_t turn)
{
    return (turn & 0xffff) == 0 && lr_stopped(watch);
}

LR_INLINE void lr_progress(const lr_watch *watch, double share)
{
    if (watch != NULL && watch->progress != NULL)
        *watch->progress = share;
}

#endif
