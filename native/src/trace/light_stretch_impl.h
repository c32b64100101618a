/* Light of a part of a ray on which the value is a cubic and one piece of a transfer function sees
 * it: the part's optical depth and the three integrals that emission_absorption.c names, by its
 * rule. Written once for a number and for vectors of numbers: whoever includes this defines
 * LR_NUMBER, the type, and LR_FORMULA(name), what functions are called for it, and has made the
 * formulas of trilinear_impl.h and of lane_exp_impl.h, and lr_magnitude, for it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */

/* x runs from -1 to 1. */
typedef struct LR_FORMULA(lr_stretch) {
    LR_NUMBER middle; /* value at x = 0, from the piece's own zero */
    LR_NUMBER y[3];   /* value - that = y[0] x + y[1] x^2 + y[2] x^3 */
    LR_NUMBER a[4];   /* optical depth behind x = 0: a[0] x + .. + a[3] x^4 */
    LR_NUMBER depth;  /* from -1 to 1 */
    LR_NUMBER half;   /* length of x from 0 to 1 */
} LR_FORMULA(lr_stretch);

/* The cubic c from a to b; length: of its x from 0 to 1. from, extinction: of the piece. */
LR_INLINE void LR_FORMULA(lr_stretch_of)(LR_FORMULA(lr_stretch) * s, const LR_NUMBER c[4],
                                         LR_NUMBER a, LR_NUMBER b, LR_NUMBER length, LR_NUMBER from,
                                         const LR_NUMBER extinction[2])
{
    const LR_NUMBER m = 0.5 * (a + b), h = 0.5 * (b - a), zero = {0};
    s->half = h * length;
    s->middle = LR_FORMULA(lr_cubic)(c, m) - from;
    s->y[0] = LR_FORMULA(lr_cubic_slope)(c, m) * h;
    s->y[1] = (3.0 * c[3] * m + c[2]) * h * h;
    s->y[2] = c[3] * h * h * h;
    const LR_NUMBER rise = extinction[1] * s->half,
                    mean = extinction[0] + extinction[1] * s->middle;
    s->a[0] = LR_FORMULA(lr_greater)(mean, zero) * s->half;
    s->a[1] = rise * s->y[0] * (1.0 / 2.0);
    s->a[2] = rise * s->y[1] * (1.0 / 3.0);
    s->a[3] = rise * s->y[2] * (1.0 / 4.0);
    s->depth = LR_FORMULA(lr_greater)(2.0 * (s->a[0] + s->a[2]), zero);
}

/* Bounds of what the rule errs, for y dA/dx exp(-A), exp(-A) and y exp(-A). Of the series of
 * exp(-A) those terms are exact that make polynomials up to degree 7: of the first integral one, as
 * A is of degree 4 and y dA/dx of degree 6, of the others two. What follows them is less than A
 * exp(A) and A^2 exp(A) / 2; and exp(x) is at most (1 - x / 32)^-32. */
LR_INLINE void LR_FORMULA(lr_stretch_bound)(const LR_FORMULA(lr_stretch) * s, double r,
                                            LR_NUMBER error[3])
{
    const double deepest = 16.0, per_rule = LR_RULE_LOST / (r * r * r * r * r * r * r * r);
    const LR_NUMBER y2 = LR_FORMULA(lr_magnitude)(s->y[2]), y1 = LR_FORMULA(lr_magnitude)(s->y[1]);
    const LR_NUMBER a3 = LR_FORMULA(lr_magnitude)(s->a[3]), a2 = LR_FORMULA(lr_magnitude)(s->a[2]);
    const LR_NUMBER a1 = LR_FORMULA(lr_magnitude)(s->a[1]), zero = {0};
    const LR_NUMBER y = ((y2 * r + y1) * r + LR_FORMULA(lr_magnitude)(s->y[0])) * r;
    const LR_NUMBER depth = (((a3 * r + a2) * r + a1) * r + s->a[0]) * r;
    const LR_NUMBER slope = ((4.0 * a3 * r + 3.0 * a2) * r + 2.0 * a1) * r + s->a[0];
    /* of what is deeper a number so small that the bound is infinite */
    LR_NUMBER shrinks = LR_FORMULA(lr_greater)(1.0 - depth * (1.0 / 32.0), zero);
    shrinks = LR_FORMULA(lr_where)(depth <= deepest, shrinks, zero);
    for (int i = 0; i < 5; i++)
        shrinks = shrinks * shrinks;
    const LR_NUMBER m = per_rule * depth / shrinks;
    error[0] = m * y * slope;
    error[1] = 0.5 * m * depth * s->half;
    error[2] = error[1] * y;
}

/* The three integrals behind the part's beginning, the last two by the part's length. */
LR_INLINE void LR_FORMULA(lr_stretch_integrate)(const LR_FORMULA(lr_stretch) * s, LR_NUMBER sums[3])
{
    const LR_NUMBER before = s->a[0] - s->a[1] + s->a[2] - s->a[3]; /* depth from x = -1 to 0 */
    sums[0] = sums[1] = sums[2] = (LR_NUMBER){0};
    for (int k = 0; k < LR_RULE_NODES; k++) {
        const double x = lr_rule_node[k];
        const LR_NUMBER y = ((s->y[2] * x + s->y[1]) * x + s->y[0]) * x;
        const LR_NUMBER depth = (((s->a[3] * x + s->a[2]) * x + s->a[1]) * x + s->a[0]) * x;
        const LR_NUMBER slope =
            ((4.0 * s->a[3] * x + 3.0 * s->a[2]) * x + 2.0 * s->a[1]) * x + s->a[0];
        const LR_NUMBER e = lr_rule_weight[k] * LR_FORMULA(lr_lane_exp)(-(before + depth));
        sums[0] += e * slope * y;
        sums[1] += e;
        sums[2] += e * y;
    }
    sums[1] *= s->half;
    sums[2] *= s->half;
}

#undef LR_NUMBER
#undef LR_FORMULA
