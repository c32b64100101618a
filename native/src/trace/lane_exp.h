/* The exponential function, in plain operations that compilers turn into vector instructions: the
 * same bits whatever these are, and of one number or of many.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_LANE_EXP_H
#define LR_TRACE_LANE_EXP_H

#include "base/base.h"

static const double lr_inverse_factorial[] = {1.0,
                                              1.0,
                                              1.0 / 2.0,
                                              1.0 / 6.0,
                                              1.0 / 24.0,
                                              1.0 / 120.0,
                                              1.0 / 720.0,
                                              1.0 / 5040.0,
                                              1.0 / 40320.0,
                                              1.0 / 362880.0,
                                              1.0 / 3628800.0,
                                              1.0 / 39916800.0,
                                              1.0 / 479001600.0,
                                              1.0 / 6227020800.0};

/* Its series up to x^degree, a constant of 13 at most. */
LR_INLINE double lr_exp_series(double x, int degree)
{
    double sum = lr_inverse_factorial[degree];
    LR_UNROLLED for (int n = degree - 1; n >= 0; n--)
    {
        sum = sum * x + lr_inverse_factorial[n];
    }
    return sum;
}

/* exp(x) for x <= 0, to 1e-14 of it; below -700 it is that of -700. */
LR_INLINE double lr_lane_exp(double x)
{
    const double shift = 0x1.8p52; /* a sum with it holds a whole number in its lowest bits */
    const double ln2_high = 0x1.62e42fefa0000p-1, ln2_low = 0x1.cf79abc9e3b3ap-40;
    const double y = x > -700.0 ? x : -700.0;
    const double shifted = y * 0x1.71547652b82fep+0 + shift, n = shifted - shift;
    const double r = (y - n * ln2_high) - n * ln2_low; /* -0.35 to 0.35 */
    double sum = lr_exp_series(r, 11);
    uint64_t bits, power;
    memcpy(&bits, &sum, sizeof bits);
    memcpy(&power, &shifted, sizeof power);
    bits += power << 52;
    memcpy(&sum, &bits, sizeof sum);
    return sum;
}

#endif
