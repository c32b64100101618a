/* Where the samples of a pixel lie: the same for a pixel, sample and seed,
 * whatever the tile or thread.
 *
 * On the film the R2 sequence (Roberts 2018: multiples of 1/p and 1/p^2, p the
 * plastic number, the real root of p^3 = p + 1), shifted so that sample 0 is
 * the pixel's centre, and turned in each pixel by one of the eight symmetries of
 * the square, which leave the centre where it is. For every choice that a ray
 * makes the first two dimensions of Sobol's sequence, shuffled and scrambled
 * after Owen by a key of the pixel and of the choice (Burley, Practical
 * hash-based Owen scrambling, 2020; the hash is that of Laine and Karras with the
 * constants of Vegdahl): the samples of one choice are even among themselves, and
 * know nothing of those of another. The two kinds do not resonate.
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

LR_INLINE uint32_t lr_pixel_hash(int32_t x, int32_t y, uint32_t seed)
{
    return lr_hash((uint32_t)x ^ lr_hash((uint32_t)y ^ lr_hash(seed)));
}

/* The key of choice `which` among those of a ray with that key. */
LR_INLINE uint32_t lr_key(uint32_t key, uint32_t which)
{
    return lr_hash(key ^ lr_hash(which + 0x9e3779b9u));
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

LR_INLINE uint32_t lr_reverse(uint32_t x)
{
    x = (x & 0x55555555u) << 1 | (x >> 1 & 0x55555555u);
    x = (x & 0x33333333u) << 2 | (x >> 2 & 0x33333333u);
    x = (x & 0x0f0f0f0fu) << 4 | (x >> 4 & 0x0f0f0f0fu);
    return __builtin_bswap32(x);
}

/* Owen's scrambling of a number whose bits are reversed: every bit is turned by
 * a hash of those below it. */
LR_INLINE uint32_t lr_scramble(uint32_t x, uint32_t key)
{
    x ^= x * 0x3d20adeau;
    x += key;
    x *= key >> 16 | 1;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/* The matrix of Sobol's second dimension, Pascal's triangle modulo 2, acts like
 * this on an index: bit i gets the parity of the bits j that contain i. */
LR_INLINE uint32_t lr_pascal(uint32_t x)
{
    x ^= x >> 16 & 0x0000ffffu;
    x ^= x >> 8 & 0x00ff00ffu;
    x ^= x >> 4 & 0x0f0f0f0fu;
    x ^= x >> 2 & 0x33333333u;
    x ^= x >> 1 & 0x55555555u;
    return x;
}

/* Two numbers 0..1 for one choice. */
LR_INLINE void lr_sample_pair(uint32_t key, uint32_t sample, double u[2])
{
    const uint32_t index = lr_reverse(lr_scramble(lr_reverse(sample), key));
    u[0] = lr_fraction(lr_reverse(lr_scramble(index, lr_hash(key ^ 0x5bd1e995u))));
    u[1] = lr_fraction(lr_reverse(lr_scramble(lr_pascal(index), lr_hash(key ^ 0x1b873593u))));
}

/* One number 0..1 for one choice. */
LR_INLINE double lr_sample_one(uint32_t key, uint32_t sample)
{
    const uint32_t index = lr_reverse(lr_scramble(lr_reverse(sample), key));
    return lr_fraction(lr_reverse(lr_scramble(index, lr_hash(key ^ 0xe6546b64u))));
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
