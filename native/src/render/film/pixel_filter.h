/* The pixel's filter, as Cycles has it.
 *
 * Samples lie as densely as the filter is high, so that all weigh the same.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_FILM_PIXEL_FILTER_H
#define LR_RENDER_FILM_PIXEL_FILTER_H

#include "base/base.h"

enum { LR_FILTER_TABLE = 512 };

/* Fill table[LR_FILTER_TABLE + 1] with the offsets from the pixel's centre at which
 * the integral of the filter has reached 0..1. */
void lr_filter_make(int32_t filter, double width, double *table);

/* Where a uniform u in 0..1 lands, in pixels from the centre; 0.5 at the centre itself. */
LR_INLINE double lr_filter_offset(const double *table, double u)
{
    const double x = u * LR_FILTER_TABLE;
    const int k = lr_min_i((int)x, LR_FILTER_TABLE - 1);
    return table[k] + (x - k) * (table[k + 1] - table[k]);
}

#endif
