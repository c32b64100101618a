/* What rounding does to where a ray enters and leaves cells: shorter ways through one count
 * nothing, so that sums along rays do not depend on which cells a walk visits there.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CELL_GRAZE_H
#define LR_TRACE_CELL_GRAZE_H

#include "trace/ray.h"

/* Of positions on a ray, relatively: a sum, a product and a reciprocal, at both of two planes. And
 * voxels that are never taken for a graze. */
#define LR_GRAZE_ROUNDING 0x1p-49
#define LR_LEAST_CHORD    1e-6

/* At most to t of the planes of each axis. */
LR_INLINE void lr_grazes_of(const lr_volume *v, const lr_ray *r, double graze[3])
{
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    double fastest = 0.0;
    for (int a = 0; a < 3; a++)
        fastest = fmax(fastest, fabs(r->d[a]));
    for (int a = 0; a < 3; a++) {
        const double extent = v->planes[0] != NULL ? fabs(v->planes[a][n[a] + 1]) : n[a];
        graze[a] = fmin(LR_GRAZE_ROUNDING * (fabs(r->o[a]) + extent + 1.0) * fabs(r->inv[a]),
                        LR_LEAST_CHORD / fastest);
    }
}

#endif
