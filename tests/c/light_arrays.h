/* Rows of numbers as the rays and hits of visible volumes.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "leapray.h"

/* rows[6][n]: origins and directions. */
static lr_rays rays_of(const double *rows, uint64_t n)
{
    return (lr_rays){.ox = rows,
                     .oy = rows + n,
                     .oz = rows + 2 * n,
                     .dx = rows + 3 * n,
                     .dy = rows + 4 * n,
                     .dz = rows + 5 * n};
}

/* rows[5][n]: t, light, transmittance. */
static lr_hits hits_of(double *rows, uint64_t n)
{
    return (lr_hits){.t = rows,
                     .red = rows + n,
                     .green = rows + 2 * n,
                     .blue = rows + 3 * n,
                     .transmittance = rows + 4 * n};
}
