/* Emission and absorption of a piece of a ray whose opacity is modulated by the gradient.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_MODULATED_LIGHT_H
#define LR_TRACE_MODULATED_LIGHT_H

#include "trace/light_sum.h"

/* As lr_add_cubic with m, where the whole part lies on one piece of the transfer function. */
void lr_add_modulated(lr_light_sum *sum, const lr_transfer_piece *p, const double c[4],
                      const double m[4], double a, double b, double length);

#endif
