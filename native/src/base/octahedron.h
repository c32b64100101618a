/* The map of directions onto the square -1..1: an octahedron whose lower half is turned outward.
 *
 * Source: Meyer, Suessmuth, Sussner et al. 2010; Cigolle, Donow, Evangelakos et al. 2014.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_OCTAHEDRON_H
#define LR_BASE_OCTAHEDRON_H

#include "base/base.h"

/* Turn one half of the octahedron over the diagonals onto the other. */
LR_INLINE void lr_octahedron_turn(double uv[2])
{
    const double u = copysign(1.0 - fabs(uv[1]), uv[0]);
    uv[1] = copysign(1.0 - fabs(uv[0]), uv[1]);
    uv[0] = u;
}

/* n need not be unit; false: of nothing. */
LR_INLINE bool lr_octahedron_map(const double n[3], double uv[2])
{
    const double sum = fabs(n[0]) + fabs(n[1]) + fabs(n[2]);
    if (!(sum > 0.0 && isfinite(sum)))
        return false;
    uv[0] = n[0] / sum;
    uv[1] = n[1] / sum;
    if (n[2] < 0.0)
        lr_octahedron_turn(uv);
    return true;
}

/* The unit vector there. */
LR_INLINE void lr_octahedron_direction(const double at[2], double n[3])
{
    const double w = 1.0 - fabs(at[0]) - fabs(at[1]);
    double uv[2] = {at[0], at[1]};
    if (w < 0.0)
        lr_octahedron_turn(uv);
    const double length = sqrt(uv[0] * uv[0] + uv[1] * uv[1] + w * w);
    n[0] = uv[0] / length;
    n[1] = uv[1] / length;
    n[2] = w / length;
}

#endif
