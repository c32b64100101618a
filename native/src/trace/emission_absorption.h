/* Emission and absorption over a part of a ray on which the value is a cubic.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_EMISSION_ABSORPTION_H
#define LR_TRACE_EMISSION_ABSORPTION_H

#include "trace/light_sum.h"

/* Add the part on which the value is sum c[i] x^i, x from a to b; length: of x from 0 to 1 in
 * object space. m: of all extinction, emission and scattering the part sum m[i] x^i is seen, 0 to
 * 1; NULL: all. */
void lr_add_cubic(lr_light_sum *sum, const lr_transfer *f, const double c[4], const double *m,
                  double a, double b, double length);

/* The same of a part that piece p of the transfer function sees alone. */
void lr_add_piece(lr_light_sum *sum, const lr_transfer_piece *p, const double c[4], const double *m,
                  double a, double b, double length);

#endif
