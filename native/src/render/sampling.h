/* Where the samples of a pixel lie: the same for a pixel, sample and seed,
 * whatever the tile or thread.
 *
 * On the film the R2 sequence (Roberts 2018: multiples of 1/p and 1/p^2, p the
 * plastic number, the real root of p^3 = p + 1), shifted so that sample 0 is
 * the pixel's centre, and turned in each pixel by one of the eight symmetries of
 * the square, which leave the centre where it is. Over the hemisphere the first
 * two dimensions of Sobol's sequence, each pixel with its own digital shift
 * (Kollig, Keller 2002). The two kinds do not resonate.
 *
 * Fractions are 32-bit fixed point, so that wrapping is exact.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_SAMPLING_H
#define LR_SAMPLING_H

#include "base.h"

LR_INLINE double lr_fraction(uint32_t u)
{
    return u * 0x1p-32;
}

/* Wellons, "lowbias32": a bijection with nearly ideal avalanche. */
LR_INLINE uint32_t lr_hash(uint32_t x)
{
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    return x ^ x >> 16;
}

LR_INLINE uint32_t lr_pixel_hash(int32_t x, int32_t y, uint32_t seed)
{
    return lr_hash((uint32_t)x ^ lr_hash((uint32_t)y ^ lr_hash(seed)));
}

/* Within the pixel, 0..1 from its lower left corner. */
LR_INLINE void lr_film_sample(uint32_t hash, uint32_t sample, double *x, double *y)
{
    uint32_t u = 0x80000000u + sample * 0xc13fa9a9u; /* 2^32 / p */
    uint32_t v = 0x80000000u + sample * 0x91e10da6u; /* 2^32 / p^2 */
    if (hash & 1)
        u = 0u - u;
    if (hash & 2)
        v = 0u - v;
    *x = lr_fraction(hash & 4 ? v : u);
    *y = lr_fraction(hash & 4 ? u : v);
}

LR_INLINE void lr_sphere_sample(uint32_t hash, uint32_t sample, double *u, double *v)
{
    uint32_t a = lr_hash(hash ^ 0x9e3779b9u), b = lr_hash(a);
    uint32_t bit = 0x80000000u, sobol = 0x80000000u;
    for (; sample != 0; sample >>= 1, bit >>= 1, sobol ^= sobol >> 1)
        if (sample & 1) {
            a ^= bit;
            b ^= sobol;
        }
    *u = lr_fraction(a);
    *v = lr_fraction(b);
}

/* A direction about n (unit), its density proportional to the cosine.
 * Basis: Duff et al., Building an orthonormal basis, revisited, 2017. */
LR_INLINE void lr_cosine_direction(const double n[3], double u, double v, double d[3])
{
    const double two_pi = 6.283185307179586;
    const double r = sqrt(u), x = r * cos(two_pi * v), y = r * sin(two_pi * v);
    const double z = sqrt(1 - u);
    const double sign = copysign(1.0, n[2]);
    const double a = -1 / (sign + n[2]), b = n[0] * n[1] * a;
    d[0] = x * (1 + sign * n[0] * n[0] * a) + y * b + z * n[0];
    d[1] = x * sign * b + y * (sign + n[1] * n[1] * a) + z * n[1];
    d[2] = -x * sign * n[0] - y * n[1] + z * n[2];
}

#endif
