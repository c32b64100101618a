/* What adds up along a ray through visible cells: light, or the extremes and the mean of values.
 *
 * Cells come in order, from any walk. Where a ray enters and leaves one follows from the planes of
 * the cell alone, not from the walk's way to it, and a cell that the ray only grazes within
 * rounding counts nothing: so the sums have the same bits by every exact traverser.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_RAY_SUMS_H
#define LR_TRACE_RAY_SUMS_H

#include "grid/transfer_function.h"
#include "trace/ray.h"

typedef struct lr_ray_sums {
    const lr_trace_options *options;
    double t_min, t_max, speed;
    double graze[3]; /* see cell_graze.h */
    double step;     /* between samples, in t */
    double t; /* where it begins to see something, or ends at `stop`, or has the best value */
    double color[3], transmittance;
    double stop;            /* transmittance at which it ends; 0: none, see options */
    double best;            /* stored value */
    double sum, length;     /* of values over t, and t */
    uint64_t cells, pieces; /* that were looked at */
} lr_ray_sums;

/* Ray i of rays, that begins at t_min. r: set up, entered or not. */
void lr_sums_begin(lr_ray_sums *sums, const lr_volume *volume, const lr_ray *r, const lr_rays *rays,
                   uint64_t i, double t_min, const lr_trace_options *options);

/* Add visible cell c; false: nothing behind it can count. */
bool lr_sums_cell(lr_ray_sums *sums, const lr_volume *volume, const lr_ray *r, lr_lattice lattice,
                  const int32_t c[3]);

/* Write all to entry i of hits; whether it has seen anything. */
bool lr_sums_put(const lr_ray_sums *sums, const lr_volume *volume, const lr_hits *hits, uint64_t i);

#endif
