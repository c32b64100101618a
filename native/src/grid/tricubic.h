/* The tricubic B-spline, whose coefficients are the samples: smooth to the second derivative.
 *
 * In a cell it is given by the 4^3 samples around, weighted by numbers that are not negative and
 * sum up to 1: it lies in their hull. It does not pass through the samples but averages them, by
 * 2/3 and twice 1/6 along an axis.
 *
 * Source: de Boor, A practical guide to splines, 1978.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_TRICUBIC_H
#define LR_GRID_TRICUBIC_H

#include "grid/brick_grid.h"

enum { LR_TRICUBIC_SAMPLES = 64 };

/* The samples by which the field in storage cell c is given, x fastest, from c - 1 on; `outside`
 * beyond the table. */
void lr_tricubic_samples(const lr_volume *v, const int32_t c[3], double s[LR_TRICUBIC_SAMPLES]);

/* The field of such samples at p in cell coordinates, and its gradient g (NULL: none). */
double lr_tricubic(const double s[LR_TRICUBIC_SAMPLES], const double p[3], double g[3]);

#endif
