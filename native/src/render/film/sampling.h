/* Sample sequences: determined by pixel, sample and seed, whatever the tile or thread.
 *
 * For every choice the first two dimensions of Sobol's sequence, shuffled and
 * scrambled after Owen by a key of the choice (Burley, Practical hash-based Owen
 * scrambling, 2020; the hash is that of Laine and Karras with the constants of
 * Vegdahl): the samples of one choice are of low discrepancy, and independent of those
 * of another. Pixels share keys and take consecutive parts of the sequence along a Morton
 * curve: the samples of a pixel, and of neighbours together, are of low discrepancy, so
 * that the errors of neighbours cancel for the eye (Ahmed and Wonka,
 * Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical
 * ordering of pixels, 2020). Departure: the order within four pixels is one of eight,
 * by the shuffling in base 2.
 *
 * On the film every pixel has a scrambling of its own, shifted (bit by bit, which
 * keeps the discrepancy) so that sample 0 is the centre.
 *
 * Fractions are 32-bit fixed point, so that wrapping is exact.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_FILM_SAMPLING_H
#define LR_RENDER_FILM_SAMPLING_H

#include "base/base.h"

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

/* Every other bit of the result, from the lowest on, is one of x. */
LR_INLINE uint32_t lr_spread(uint32_t x)
{
    x &= 0xffffu;
    x = (x | x << 8) & 0x00ff00ffu;
    x = (x | x << 4) & 0x0f0f0f0fu;
    x = (x | x << 2) & 0x33333333u;
    return (x | x << 1) & 0x55555555u;
}

/* A pixel's part of the sequences: their key, which the pixels of a square block share, and where
 * the part begins. */
typedef struct lr_turn {
    uint32_t key, first;
} lr_turn;

/* sample_bits: 2 to that power is the most samples of a pixel. */
LR_INLINE lr_turn lr_pixel_turn(int32_t x, int32_t y, uint32_t seed, uint32_t sample_bits)
{
    const uint32_t side_bits = (32 - sample_bits) / 2; /* of a block: all that 32 bits can number */
    const uint32_t within = (1u << side_bits) - 1;
    const uint32_t u = (uint32_t)x, v = (uint32_t)y;
    const uint32_t place = lr_spread(u & within) | lr_spread(v & within) << 1;
    return (lr_turn){
        .key = lr_hash(u >> side_bits ^ lr_hash(v >> side_bits ^ lr_hash(seed ^ 0x68bc21ebu))),
        .first = place << sample_bits,
    };
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

LR_INLINE void lr_sobol_pair(uint32_t key, uint32_t sample, uint32_t u[2])
{
    const uint32_t index = lr_reverse(lr_scramble(lr_reverse(sample), key));
    u[0] = lr_reverse(lr_scramble(index, lr_hash(key ^ 0x5bd1e995u)));
    u[1] = lr_reverse(lr_scramble(lr_pascal(index), lr_hash(key ^ 0x1b873593u)));
}

/* Two numbers 0..1 for one choice. */
LR_INLINE void lr_sample_pair(uint32_t key, uint32_t sample, double u[2])
{
    uint32_t x[2];
    lr_sobol_pair(key, sample, x);
    u[0] = lr_fraction(x[0]);
    u[1] = lr_fraction(x[1]);
}

/* One number 0..1 for one choice. */
LR_INLINE double lr_sample_one(uint32_t key, uint32_t sample)
{
    const uint32_t index = lr_reverse(lr_scramble(lr_reverse(sample), key));
    return lr_fraction(lr_reverse(lr_scramble(index, lr_hash(key ^ 0xe6546b64u))));
}

/* What moves the samples of a pixel with that hash, so that the first is its centre. */
LR_INLINE void lr_film_shift(uint32_t hash, uint32_t shift[2])
{
    lr_sobol_pair(hash, 0, shift);
    for (int a = 0; a < 2; a++)
        shift[a] ^= 0x80000000u;
}

/* On the film within the pixel, 0..1 from its lower left corner. */
LR_INLINE void lr_film_sample(uint32_t hash, const uint32_t shift[2], uint32_t sample, double *x,
                              double *y)
{
    uint32_t u[2];
    lr_sobol_pair(hash, sample, u);
    const uint32_t p = u[0] ^ shift[0], q = u[1] ^ shift[1];
    *x = lr_fraction(hash & 1 ? 0u - p : p); /* mirrored, or samples would tend upwards */
    *y = lr_fraction(hash & 2 ? 0u - q : q);
}

/* A direction about n (unit), its density proportional to the cosine. */
LR_INLINE void lr_cosine_direction(const double n[3], double u, double v, double d[3])
{
    double s[3], t[3];
    lr_orthonormal_basis(n, s, t);
    const double r = sqrt(u), x = r * cos(2 * LR_PI * v), y = r * sin(2 * LR_PI * v);
    for (int a = 0; a < 3; a++)
        d[a] = x * s[a] + y * t[a] + sqrt(1 - u) * n[a];
}

#endif
