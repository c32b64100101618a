/* The exponential function, written once for a number and for vectors of numbers: whoever includes
 * this defines LR_NUMBER and LR_BITS, the type and unsigned integers of its size, and
 * LR_FORMULA(name), what functions are called for it, and has made LR_FORMULA(lr_greater).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */

/* Its series up to x^degree, a constant of 13 at most: of even and of odd powers, side by side. */
LR_INLINE LR_NUMBER LR_FORMULA(lr_exp_series)(LR_NUMBER x, int degree)
{
    const LR_NUMBER square = x * x;
    LR_NUMBER sum[2];
    sum[degree % 2] = (LR_NUMBER){0} + lr_inverse_factorial[degree];
    sum[1 - degree % 2] = (LR_NUMBER){0} + lr_inverse_factorial[degree - 1];
    LR_UNROLLED for (int n = degree - 2; n >= 0; n--)
    {
        sum[n % 2] = sum[n % 2] * square + lr_inverse_factorial[n];
    }
    return sum[0] + sum[1] * x;
}

/* exp(x) for x <= 0, to 1e-14 of it; below -700 it is that of -700. */
LR_INLINE LR_NUMBER LR_FORMULA(lr_lane_exp)(LR_NUMBER x)
{
    const double shift = 0x1.8p52; /* a sum with it holds a whole number in its lowest bits */
    const double ln2_high = 0x1.62e42fefa0000p-1, ln2_low = 0x1.cf79abc9e3b3ap-40;
    const LR_NUMBER y = LR_FORMULA(lr_greater)(x, (LR_NUMBER){0} - 700.0);
    const LR_NUMBER shifted = y * 0x1.71547652b82fep+0 + shift, n = shifted - shift;
    const LR_NUMBER r = (y - n * ln2_high) - n * ln2_low; /* -0.35 to 0.35 */
    LR_NUMBER sum = LR_FORMULA(lr_exp_series)(r, 11);
    LR_BITS bits, power;
    memcpy(&bits, &sum, sizeof bits);
    memcpy(&power, &shifted, sizeof power);
    bits += power << 52;
    memcpy(&sum, &bits, sizeof sum);
    return sum;
}

#undef LR_BITS
#undef LR_NUMBER
#undef LR_FORMULA
