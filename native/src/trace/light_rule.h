/* Gauss and Legendre's rule of four nodes, and the exponential function that goes with it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_LIGHT_RULE_H
#define LR_TRACE_LIGHT_RULE_H

#include "trace/lane_exp.h"

enum { LR_RULE_NODES = 4 };

static const double lr_rule_node[LR_RULE_NODES] = {-0.86113631159405257522, -0.33998104358485626480,
                                                   0.33998104358485626480, 0.86113631159405257522};
static const double lr_rule_weight[LR_RULE_NODES] = {
    0.34785484513745385737, 0.65214515486254614263, 0.65214515486254614263, 0.34785484513745385737};

/* What the rule loses of x^8, and of higher powers for R >= 4: sum over even k >= 8 of
 * R^(8-k) (integral of x^k - rule's sum). */
#define LR_RULE_LOST 0.0138

/* The optical depth of the deepest piece that it is taken over. */
#define LR_RULE_DEEPEST 1.0

/* exp(x) for -LR_RULE_DEEPEST <= x <= LR_RULE_DEEPEST, to 1.3e-11. */
LR_INLINE double lr_rule_exp(double x)
{
    return lr_exp_series(x, 13);
}

#endif
