/* The operations of SSE2 that the core uses under Intel's names: the processor's own, or,
 * for others and under LR_PORTABLE, the same in plain C. Both give the same bits.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_SSE2_H
#define LR_BASE_SSE2_H

#include "base/cpu.h"

#ifdef LR_X86
#include <emmintrin.h>
#else

typedef union __m128 {
    _Alignas(16) float f[4];
    uint32_t u[4];
} __m128;

typedef union __m128i {
    _Alignas(16) uint8_t b[16];
    uint16_t w[8];
    int16_t s[8];
} __m128i;

#define LR_LANES(type, n, expression)                                                              \
    type out;                                                                                      \
    for (int i = 0; i < (n); i++)                                                                  \
        out.expression;                                                                            \
    return out
#define LR_MAP(name, type, n, expression)                                                          \
    LR_INLINE type name(type a, type b)                                                            \
    {                                                                                              \
        LR_LANES(type, n, expression);                                                             \
    }

/* ---- four floats ------------------------------------------------------- */

LR_MAP(_mm_add_ps, __m128, 4, f[i] = a.f[i] + b.f[i])
LR_MAP(_mm_sub_ps, __m128, 4, f[i] = a.f[i] - b.f[i])
LR_MAP(_mm_mul_ps, __m128, 4, f[i] = a.f[i] * b.f[i])
LR_MAP(_mm_min_ps, __m128, 4, f[i] = a.f[i] < b.f[i] ? a.f[i] : b.f[i])
LR_MAP(_mm_max_ps, __m128, 4, f[i] = a.f[i] > b.f[i] ? a.f[i] : b.f[i])
LR_MAP(_mm_and_ps, __m128, 4, u[i] = a.u[i] & b.u[i])
LR_MAP(_mm_or_ps, __m128, 4, u[i] = a.u[i] | b.u[i])
LR_MAP(_mm_andnot_ps, __m128, 4, u[i] = ~a.u[i] & b.u[i])
LR_MAP(_mm_cmplt_ps, __m128, 4, u[i] = a.f[i] < b.f[i] ? ~0u : 0)
LR_MAP(_mm_cmpgt_ps, __m128, 4, u[i] = a.f[i] > b.f[i] ? ~0u : 0)
LR_MAP(_mm_cmpge_ps, __m128, 4, u[i] = a.f[i] >= b.f[i] ? ~0u : 0)

LR_INLINE __m128 _mm_set1_ps(float x)
{
    LR_LANES(__m128, 4, f[i] = x);
}

LR_INLINE __m128 _mm_setzero_ps(void)
{
    return _mm_set1_ps(0.0f);
}

LR_INLINE __m128 _mm_loadu_ps(const float *from)
{
    LR_LANES(__m128, 4, f[i] = from[i]);
}

LR_INLINE __m128 _mm_load_ps(const float *from)
{
    return _mm_loadu_ps(from);
}

LR_INLINE void _mm_store_ps(float *to, __m128 a)
{
    memcpy(to, a.f, sizeof a.f);
}

LR_INLINE int _mm_movemask_ps(__m128 a)
{
    return (int)(a.u[0] >> 31 | a.u[1] >> 31 << 1 | a.u[2] >> 31 << 2 | a.u[3] >> 31 << 3);
}

/* ---- sixteen bytes, or eight words ------------------------------------- */

LR_MAP(_mm_max_epu8, __m128i, 16, b[i] = a.b[i] > b.b[i] ? a.b[i] : b.b[i])
LR_MAP(_mm_cmpeq_epi8, __m128i, 16, b[i] = a.b[i] == b.b[i] ? 0xff : 0)
LR_MAP(_mm_subs_epu16, __m128i, 8, w[i] = a.w[i] > b.w[i] ? (uint16_t)(a.w[i] - b.w[i]) : 0)
LR_MAP(_mm_cmpeq_epi16, __m128i, 8, w[i] = a.w[i] == b.w[i] ? 0xffff : 0)

LR_INLINE uint8_t lr_narrowed(int16_t x)
{
    return (uint8_t)(int8_t)(x < INT8_MIN ? INT8_MIN : x > INT8_MAX ? INT8_MAX : x);
}

LR_MAP(_mm_packs_epi16, __m128i, 16, b[i] = lr_narrowed(i < 8 ? a.s[i] : b.s[i - 8]))

LR_INLINE __m128i _mm_set1_epi8(char x)
{
    LR_LANES(__m128i, 16, b[i] = (uint8_t)x);
}

LR_INLINE __m128i _mm_set1_epi16(short x)
{
    LR_LANES(__m128i, 8, s[i] = x);
}

LR_INLINE __m128i _mm_setzero_si128(void)
{
    return _mm_set1_epi16(0);
}

LR_INLINE __m128i _mm_loadl_epi64(const __m128i *from)
{
    __m128i out = _mm_setzero_si128();
    memcpy(&out, from, 8);
    return out;
}

LR_INLINE __m128i _mm_loadu_si128(const __m128i *from)
{
    __m128i out;
    memcpy(&out, from, sizeof out);
    return out;
}

LR_INLINE int _mm_movemask_epi8(__m128i a)
{
    int bits = 0;
    for (int i = 0; i < 16; i++)
        bits |= a.b[i] >> 7 << i;
    return bits;
}

#undef LR_MAP
#undef LR_LANES

#endif
#endif
