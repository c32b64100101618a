/* Emission and absorption over a part of a ray on which the value is a cubic.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_EMISSION_ABSORPTION_H
#define LR_TRACE_EMISSION_ABSORPTION_H

#include "grid/transfer_function.h"

/* Of the parts so far, front to back. */
typedef struct lr_light_sum {
    double tolerance;
    double color[3], transmittance;
    uint64_t pieces; /* integrals taken */
    double stop;     /* the transmittance at which it ends, without colours; 0: none */
    bool ended;      /* there: */
    double at;       /* in x */
    double albedo[3];
} lr_light_sum;

/* Add the part on which the value is sum c[i] x^i, x from a to b; length: of x from 0 to 1 in
 * object space. */
void lr_add_cubic(lr_light_sum *sum, const lr_transfer *f, const double c[4], double a, double b,
                  double length);

#endif
