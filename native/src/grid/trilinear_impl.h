/* The trilinear field of a cell and the cubic along a ray through it, written once for a number and
 * for vectors of numbers: whoever includes this defines LR_NUMBER, the type, and LR_FORMULA(name),
 * what functions are called for it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */

LR_INLINE LR_NUMBER LR_FORMULA(lr_mix)(LR_NUMBER a, LR_NUMBER b, LR_NUMBER u)
{
    return a + u * (b - a);
}

/* p in cell coordinates 0..1. */
LR_INLINE LR_NUMBER LR_FORMULA(lr_trilinear)(const LR_NUMBER s[8], const LR_NUMBER p[3])
{
    const LR_NUMBER low = LR_FORMULA(lr_mix)(LR_FORMULA(lr_mix)(s[0], s[1], p[0]),
                                             LR_FORMULA(lr_mix)(s[2], s[3], p[0]), p[1]);
    const LR_NUMBER high = LR_FORMULA(lr_mix)(LR_FORMULA(lr_mix)(s[4], s[5], p[0]),
                                              LR_FORMULA(lr_mix)(s[6], s[7], p[0]), p[1]);
    return LR_FORMULA(lr_mix)(low, high, p[2]);
}

LR_INLINE void LR_FORMULA(lr_trilinear_gradient)(const LR_NUMBER s[8], const LR_NUMBER p[3],
                                                 LR_NUMBER g[3])
{
    g[0] = LR_FORMULA(lr_mix)(LR_FORMULA(lr_mix)(s[1] - s[0], s[3] - s[2], p[1]),
                              LR_FORMULA(lr_mix)(s[5] - s[4], s[7] - s[6], p[1]), p[2]);
    g[1] = LR_FORMULA(lr_mix)(LR_FORMULA(lr_mix)(s[2] - s[0], s[3] - s[1], p[0]),
                              LR_FORMULA(lr_mix)(s[6] - s[4], s[7] - s[5], p[0]), p[2]);
    g[2] = LR_FORMULA(lr_mix)(LR_FORMULA(lr_mix)(s[4] - s[0], s[5] - s[1], p[0]),
                              LR_FORMULA(lr_mix)(s[6] - s[2], s[7] - s[3], p[0]), p[1]);
}

/* From p, where the field is f, to q it is sum c[i] x^i, x from 0 to 1. */
LR_INLINE void LR_FORMULA(lr_cubic_between)(const LR_NUMBER s[8], const LR_NUMBER p[3],
                                            const LR_NUMBER q[3], LR_NUMBER f, LR_NUMBER c[4])
{
    const LR_NUMBER e[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    const LR_NUMBER xy = s[3] - s[2] - s[1] + s[0], xz = s[5] - s[4] - s[1] + s[0];
    const LR_NUMBER yz = s[6] - s[4] - s[2] + s[0];
    const LR_NUMBER xyz = s[7] - s[6] - s[5] + s[4] - (s[3] - s[2] - s[1] + s[0]);
    LR_NUMBER g[3];
    LR_FORMULA(lr_trilinear_gradient)(s, p, g);
    c[0] = f;
    c[1] = g[0] * e[0] + g[1] * e[1] + g[2] * e[2];
    c[2] = (xy + xyz * p[2]) * e[0] * e[1] + (xz + xyz * p[1]) * e[0] * e[2] +
           (yz + xyz * p[0]) * e[1] * e[2];
    c[3] = xyz * e[0] * e[1] * e[2];
}

LR_INLINE LR_NUMBER LR_FORMULA(lr_cubic)(const LR_NUMBER c[4], LR_NUMBER x)
{
    return ((c[3] * x + c[2]) * x + c[1]) * x + c[0];
}

LR_INLINE LR_NUMBER LR_FORMULA(lr_cubic_slope)(const LR_NUMBER c[4], LR_NUMBER x)
{
    return (3.0 * c[3] * x + 2.0 * c[2]) * x + c[1];
}

#undef LR_NUMBER
#undef LR_FORMULA
