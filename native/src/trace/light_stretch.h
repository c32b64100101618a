/* Light of a part of a ray on one piece of a transfer function, by numbers.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_LIGHT_STRETCH_H
#define LR_TRACE_LIGHT_STRETCH_H

#include "grid/trilinear.h"
#include "trace/light_rule.h"

LR_INLINE double lr_magnitude(double x)
{
    return fabs(x);
}

LR_INLINE double lr_where(bool m, double a, double b)
{
    return m ? a : b;
}

#define LR_NUMBER        double
#define LR_FORMULA(name) name
#include "trace/light_stretch_impl.h"

#endif
