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
    double t_min, t_max;
    double speed;    /* length of the ray's direction in object space */
    double step;     /* between samples, in t */
    double graze[3]; /* what rounding does at most to t of the planes of an axis */
    double t;        /* where it begins to see something, or has the best value */
    double color[3], transmittance;
    double best;            /* stored value */
    double sum, length;     /* of values over t, and t */
    uint64_t cells, pieces; /* that were looked at */
} lr_ray_sums;

/* r: set up, entered or not; t_min: where the ray begins. */
void lr_sums_begin(lr_ray_sums *sums, const lr_volume *volume, const lr_ray *r, const double d[3],
                   double t_min, const lr_trace_options *options);

/* Add visible cell c; false: nothing behind it can count. */
bool lr_sums_cell(lr_ray_sums *sums, const lr_volume *volume, const lr_ray *r, lr_lattice lattice,
                  const int32_t c[3]);

/* Write what has added up to entry i of hits; whether the ray has seen anything. */
bool lr_sums_put(const lr_ray_sums *sums, const lr_volume *volume, const lr_hits *hits, uint64_t i);

#endif
