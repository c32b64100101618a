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

/* The second where one is NaN. */
LR_INLINE double lr_greater(double a, double b)
{
    return a > b ? a : b;
}

#define LR_NUMBER        double
#define LR_BITS          uint64_t
#define LR_FORMULA(name) name
#include "trace/lane_exp_impl.h"

#endif
