/* Sixteen floats or integers, or eight doubles, side by side, by the compilers' own vector types:
 * in one register of AVX-512, two of AVX2, four of SSE or NEON. Only what these do not say for
 * themselves, gathers and the bits of a mask, is written by instruction set: LR_VECTORS is 2 for
 * AVX-512, 1 for AVX2, 0 for any other. Every operation is that of IEEE 754 on each lane.
 *
 * Included into a file compiled for its instructions; see cd_packet_impl.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VECTORS
#error "LR_VECTORS says which instructions to use"
#endif

#include "base/cpu.h"

#ifdef LR_X86
#include <immintrin.h>
#endif

enum { LR_LANES = 16, LR_ALL_LANES = 0xffff };
enum { LR_DOUBLE_LANES = 8, LR_ALL_DOUBLE_LANES = 0xff };

typedef float lr_floats __attribute__((vector_size(64)));
typedef int32_t lr_ints __attribute__((vector_size(64))); /* as a mask: -1 where set, else 0 */

typedef double lr_doubles __attribute__((vector_size(64)));
typedef int64_t lr_longs __attribute__((vector_size(64))); /* as a mask, as lr_ints */
typedef uint64_t lr_unsigned_longs __attribute__((vector_size(64)));

/* Eight beside eight doubles. */
typedef int32_t lr_eight_ints __attribute__((vector_size(32)));
typedef float lr_eight_floats __attribute__((vector_size(32)));

/* From memory and to it, aligned or not. */
#define LR_IN_MEMORY(vector, number, kind)                                                         \
    LR_INLINE vector lr_load_##kind(const number *from)                                            \
    {                                                                                              \
        vector x;                                                                                  \
        memcpy(&x, from, sizeof x);                                                                \
        return x;                                                                                  \
    }                                                                                              \
    LR_INLINE void lr_store_##kind(number *to, vector x)                                           \
    {                                                                                              \
        memcpy(to, &x, sizeof x);                                                                  \
    }
LR_IN_MEMORY(lr_floats, float, floats)
LR_IN_MEMORY(lr_ints, int32_t, ints)
LR_IN_MEMORY(lr_doubles, double, doubles)
LR_IN_MEMORY(lr_eight_ints, int32_t, eight)
LR_IN_MEMORY(lr_eight_floats, float, eight_floats)
#undef LR_IN_MEMORY

/* A function of each lane: gcc has none of vectors. */
#ifdef __clang__
#define LR_EACH_LANE(name, vector, of_vector, of_number)                                           \
    LR_INLINE vector name(vector a)                                                                \
    {                                                                                              \
        return of_vector(a);                                                                       \
    }
#else
#define LR_EACH_LANE(name, vector, of_vector, of_number)                                           \
    LR_INLINE vector name(vector a)                                                                \
    {                                                                                              \
        vector all;                                                                                \
        for (size_t l = 0; l < sizeof a / sizeof a[0]; l++)                                        \
            all[l] = of_number(a[l]);                                                              \
        return all;                                                                                \
    }
#endif
LR_EACH_LANE(lr_root_floats, lr_floats, __builtin_elementwise_sqrt, sqrtf)
LR_EACH_LANE(lr_rounded_down, lr_floats, __builtin_elementwise_floor, floorf)
LR_EACH_LANE(lr_root_doubles, lr_doubles, __builtin_elementwise_sqrt, sqrt)
LR_EACH_LANE(lr_rounded_down_doubles, lr_doubles, __builtin_elementwise_floor, floor)
#undef LR_EACH_LANE

LR_INLINE lr_floats lr_all_floats(float x)
{
    return x - (lr_floats){0};
}

LR_INLINE lr_ints lr_all_ints(int32_t x)
{
    return x - (lr_ints){0};
}

LR_INLINE lr_floats lr_floats_of(lr_ints x)
{
    return __builtin_convertvector(x, lr_floats);
}

/* Towards 0. */
LR_INLINE lr_ints lr_ints_of(lr_floats x)
{
    return __builtin_convertvector(x, lr_ints);
}

/* a where m, else b. */
LR_INLINE lr_ints lr_pick_ints(lr_ints m, lr_ints a, lr_ints b)
{
    return (m & a) | (~m & b);
}

LR_INLINE lr_floats lr_pick(lr_ints m, lr_floats a, lr_floats b)
{
    return (lr_floats)lr_pick_ints(m, (lr_ints)a, (lr_ints)b);
}

/* The second where one is NaN. */
LR_INLINE lr_floats lr_least(lr_floats a, lr_floats b)
{
    return lr_pick(a < b, a, b);
}

LR_INLINE lr_floats lr_greatest(lr_floats a, lr_floats b)
{
    return lr_pick(a > b, a, b);
}

LR_INLINE lr_ints lr_least_ints(lr_ints a, lr_ints b)
{
    return lr_pick_ints(a < b, a, b);
}

LR_INLINE lr_ints lr_greatest_ints(lr_ints a, lr_ints b)
{
    return lr_pick_ints(a > b, a, b);
}

LR_INLINE lr_floats lr_absolute(lr_floats a)
{
    return (lr_floats)((lr_ints)a & INT32_MAX);
}

/* The mask of which a bit is set for each lane; and back. */
LR_INLINE lr_ints lr_lanes_of(uint32_t bits)
{
#if LR_VECTORS == 2
    return (lr_ints)_mm512_movm_epi32((__mmask16)bits);
#else
    const lr_ints bit = {1 << 0, 1 << 1, 1 << 2,  1 << 3,  1 << 4,  1 << 5,  1 << 6,  1 << 7,
                         1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
    return (lr_all_ints((int32_t)bits) & bit) != 0;
#endif
}

LR_INLINE uint32_t lr_bits_of(lr_ints m)
{
#if LR_VECTORS == 2
    return _mm512_movepi32_mask((__m512i)m);
#elif LR_VECTORS == 1
    __m256 half[2];
    memcpy(half, &m, sizeof m);
    return (uint32_t)_mm256_movemask_ps(half[0]) | (uint32_t)_mm256_movemask_ps(half[1]) << 8;
#elif defined LR_X86
    __m128 part[4];
    uint32_t bits = 0;
    memcpy(part, &m, sizeof m);
    for (int q = 0; q < 4; q++)
        bits |= (uint32_t)_mm_movemask_ps(part[q]) << 4 * q;
    return bits;
#else
    const lr_ints bit = {1 << 0, 1 << 1, 1 << 2,  1 << 3,  1 << 4,  1 << 5,  1 << 6,  1 << 7,
                         1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
    const lr_ints set = m & bit;
    int32_t bits = 0;
    for (int l = 0; l < LR_LANES; l++)
        bits |= set[l];
    return (uint32_t)bits;
#endif
}

/* 32 bits of each lane of `bits` from base + at bytes; other lanes 0. */
LR_INLINE lr_ints lr_gather(const void *base, lr_ints at, uint32_t bits)
{
#if LR_VECTORS == 2
    return (lr_ints)_mm512_mask_i32gather_epi32(_mm512_setzero_si512(), (__mmask16)bits,
                                                (__m512i)at, base, 1);
#elif LR_VECTORS == 1
    __m256i half[2], of[2], found[2];
    const lr_ints m = lr_lanes_of(bits);
    lr_ints all;
    memcpy(half, &at, sizeof at);
    memcpy(of, &m, sizeof m);
    for (int h = 0; h < 2; h++)
        found[h] = _mm256_mask_i32gather_epi32(_mm256_setzero_si256(), base, half[h], of[h], 1);
    memcpy(&all, found, sizeof all);
    return all;
#else
    lr_ints all = {0};
    for (uint32_t left = bits; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        int32_t one;
        memcpy(&one, (const char *)base + (uint32_t)at[l], sizeof one);
        all[l] = one;
    }
    return all;
#endif
}

/* ---- doubles ---------------------------------------------------------------- */

LR_INLINE lr_doubles lr_all_doubles(double x)
{
    return x - (lr_doubles){0};
}

LR_INLINE lr_doubles lr_pick_doubles(lr_longs m, lr_doubles a, lr_doubles b)
{
#if LR_VECTORS == 2
    const __mmask8 k = _mm512_movepi64_mask((__m512i)m);
    return (lr_doubles)_mm512_mask_blend_pd(k, (__m512d)b, (__m512d)a);
#else
    return (lr_doubles)((m & (lr_longs)a) | (~m & (lr_longs)b));
#endif
}

/* As lr_clamp. */
LR_INLINE lr_doubles lr_clamp_doubles(lr_doubles x, lr_doubles lo, lr_doubles hi)
{
    const lr_doubles y = lr_pick_doubles(x > lo, x, lo);
    return lr_pick_doubles(y < hi, y, hi);
}

LR_INLINE lr_doubles lr_absolute_doubles(lr_doubles a)
{
    return (lr_doubles)((lr_longs)a & INT64_MAX);
}

/* x with the sign of y. */
LR_INLINE lr_doubles lr_signed_as(lr_doubles x, lr_doubles y)
{
    return (lr_doubles)(((lr_longs)x & INT64_MAX) | ((lr_longs)y & INT64_MIN));
}

LR_INLINE uint32_t lr_bits_of_longs(lr_longs m)
{
#if LR_VECTORS == 2
    return _mm512_movepi64_mask((__m512i)m);
#elif LR_VECTORS == 1
    __m256d half[2];
    memcpy(half, &m, sizeof m);
    return (uint32_t)_mm256_movemask_pd(half[0]) | (uint32_t)_mm256_movemask_pd(half[1]) << 4;
#else
    uint32_t bits = 0;
    for (int l = 0; l < LR_DOUBLE_LANES; l++)
        bits |= (uint32_t)(m[l] & 1) << l;
    return bits;
#endif
}

LR_INLINE bool lr_any(lr_longs m)
{
    return lr_bits_of_longs(m) != 0;
}

LR_INLINE lr_longs lr_longs_of(uint32_t bits)
{
    const lr_longs bit = {1, 2, 4, 8, 16, 32, 64, 128};
    return (((int64_t)bits - (lr_longs){0}) & bit) != 0;
}

/* Those of `from` that are in bits, one after another; `to` has room for eight. And back: each in
 * its lane, others 0. */
LR_INLINE void lr_pack_doubles(double *to, const double *from, uint32_t bits)
{
#if LR_VECTORS == 2
    _mm512_storeu_pd(to, _mm512_maskz_compress_pd((__mmask8)bits, _mm512_loadu_pd(from)));
#else
    for (uint32_t left = bits; left != 0; left &= left - 1)
        *to++ = from[__builtin_ctz(left)];
#endif
}

LR_INLINE lr_doubles lr_unpack_doubles(const double *from, uint32_t bits)
{
#if LR_VECTORS == 2
    return (lr_doubles)_mm512_maskz_expand_pd((__mmask8)bits, _mm512_loadu_pd(from));
#else
    double all[LR_DOUBLE_LANES] = {0};
    for (uint32_t left = bits; left != 0; left &= left - 1)
        all[__builtin_ctz(left)] = *from++;
    return lr_load_doubles(all);
#endif
}

/* Of eight numbers those that `which` tells. */
LR_INLINE lr_doubles lr_pick_of_eight(const double eight[LR_DOUBLE_LANES], lr_longs which)
{
#if LR_VECTORS == 2
    return (lr_doubles)_mm512_permutexvar_pd((__m512i)which, _mm512_loadu_pd(eight));
#else
    double picked[LR_DOUBLE_LANES];
    for (int l = 0; l < LR_DOUBLE_LANES; l++)
        picked[l] = eight[which[l]];
    return lr_load_doubles(picked);
#endif
}

/* ---- eight integers beside eight doubles ------------------------------------ */

/* Towards 0. */
LR_INLINE lr_eight_ints lr_eight_ints_of(lr_doubles x)
{
    return __builtin_convertvector(x, lr_eight_ints);
}

LR_INLINE lr_doubles lr_doubles_of(lr_eight_ints x)
{
    return __builtin_convertvector(x, lr_doubles);
}

LR_INLINE lr_longs lr_longs_of_ints(lr_eight_ints x)
{
    return __builtin_convertvector(x, lr_longs);
}

/* Of numbers below 2^52. */
LR_INLINE lr_doubles lr_doubles_of_unsigned(lr_unsigned_longs x)
{
    return (lr_doubles)(x | 0x4330000000000000u) - 0x1p52;
}

/* Of the low halves, as bits of floats. */
LR_INLINE lr_doubles lr_doubles_of_floats(lr_unsigned_longs x)
{
    const lr_eight_ints low = __builtin_convertvector(x, lr_eight_ints);
    return __builtin_convertvector((lr_eight_floats)low, lr_doubles);
}

LR_INLINE lr_eight_ints lr_pick_eight(lr_eight_ints m, lr_eight_ints a, lr_eight_ints b)
{
    return (m & a) | (~m & b);
}

LR_INLINE lr_eight_floats lr_pick_eight_floats(lr_eight_ints m, lr_eight_floats a,
                                               lr_eight_floats b)
{
    return (lr_eight_floats)lr_pick_eight(m, (lr_eight_ints)a, (lr_eight_ints)b);
}

LR_INLINE uint32_t lr_bits_of_eight(lr_eight_ints m)
{
#if LR_VECTORS == 2
    return _mm256_movepi32_mask((__m256i)m);
#elif LR_VECTORS == 1
    return (uint32_t)_mm256_movemask_ps((__m256)m);
#else
    const lr_ints all = {m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7]};
    return lr_bits_of(all);
#endif
}
