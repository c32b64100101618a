/* Samples of 8 bits in the place of wider ones.
 *
 * A steeper ramp spends the 255 steps where hits and gradients read. No sample changes
 * sides of the threshold, so that cells, structures and triangles stay what they are.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_QUANTIZE_H
#define LR_GRID_QUANTIZE_H

#include "grid/brick_grid.h"

#define LR_NARROW_ONE 255.0 /* the stored value of 1, of LR_U8 */

/* The sample of 0..255 in the place of a stored value; occupancy is `gain` times as steep. */
LR_INLINE double lr_narrowed(const lr_volume *v, double value, double gain)
{
    const double level = LR_NARROW_ONE * v->desc.threshold, least = ceil(level);
    const double wanted = level + (value - v->threshold) * (gain * LR_NARROW_ONE / v->one);
    const double step = floor(lr_clamp(wanted, 0.0, LR_NARROW_ONE) + 0.5);
    if (value >= v->threshold)
        return step < least ? least : step;
    return step < least ? step : least - 1.0;
}

#endif
