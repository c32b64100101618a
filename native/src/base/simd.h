/* Sixteen floats side by side: in one register of AVX-512, two of AVX2, four
 * of SSE, by LR_LANES_SIMD (2, 1, 0). Every operation is that of IEEE 754 on each lane,
 * nothing is fused, so the results are the same bits on all three.
 *
 * Included into a file compiled for its instructions; see closest_triangle_impl.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_LANES_SIMD
#error "LR_LANES_SIMD says which instructions to use"
#endif

#if LR_LANES_SIMD == 2

typedef __m512 lanes;
typedef __mmask16 lane_mask;

#define LR_BINARY(name, operation)                                                                 \
    LR_INLINE lanes name(lanes a, lanes b)                                                         \
    {                                                                                              \
        return _mm512_##operation##_ps(a, b);                                                      \
    }

LR_INLINE lanes lanes_load(const void *from)
{
    return _mm512_load_ps(from);
}

LR_INLINE void lanes_store(void *to, lanes a)
{
    _mm512_store_ps(to, a);
}

LR_INLINE lanes lanes_all(float x)
{
    return _mm512_set1_ps(x);
}

/* Four numbers, four times. */
LR_INLINE lanes lanes_repeat(const float four[4])
{
    return _mm512_broadcast_f32x4(_mm_load_ps(four));
}

/* Each of four numbers four times. */
LR_INLINE lanes lanes_each(const float four[4])
{
    const __m512i which = _mm512_set_epi32(3, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1, 0, 0, 0, 0);
    return _mm512_permutexvar_ps(which, lanes_repeat(four));
}

LR_INLINE lanes lanes_sqrt(lanes a)
{
    return _mm512_sqrt_ps(a);
}

LR_INLINE lanes lanes_abs(lanes a)
{
    return _mm512_abs_ps(a);
}

LR_INLINE lane_mask lanes_less(lanes a, lanes b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ);
}

LR_INLINE lane_mask mask_and(lane_mask a, lane_mask b)
{
    return a & b;
}

LR_INLINE uint32_t mask_bits(lane_mask m)
{
    return m;
}

/* a where m, else b. */
LR_INLINE lanes lanes_pick(lane_mask m, lanes a, lanes b)
{
    return _mm512_mask_blend_ps(m, b, a);
}

LR_INLINE __m128 lanes_fold(lanes a)
{
    __m512 swapped = _mm512_shuffle_f32x4(a, a, 0x4e);
    __m256 two = _mm512_castps512_ps256(_mm512_max_ps(a, swapped));
    return _mm_max_ps(_mm256_castps256_ps128(two), _mm256_extractf128_ps(two, 1));
}

#else

#if LR_LANES_SIMD == 1
enum { LANE_PARTS = 2, LANES_PER_PART = 8 };
typedef __m256 lane_part;
#define LR_OF(operation) _mm256_##operation##_ps
#define LR_LESS(a, b)    _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#else
enum { LANE_PARTS = 4, LANES_PER_PART = 4 };
typedef __m128 lane_part;
#define LR_OF(operation) _mm_##operation##_ps
#define LR_LESS(a, b)    _mm_cmplt_ps(a, b)
#endif

typedef struct lanes {
    lane_part of[LANE_PARTS];
} lanes;
typedef lanes lane_mask; /* all bits of a lane, or none */

#define LR_EACH(expression)                                                                        \
    lanes out;                                                                                     \
    for (int i = 0; i < LANE_PARTS; i++)                                                           \
        out.of[i] = expression;                                                                    \
    return out

#define LR_BINARY(name, operation)                                                                 \
    LR_INLINE lanes name(lanes a, lanes b)                                                         \
    {                                                                                              \
        LR_EACH(LR_OF(operation)(a.of[i], b.of[i]));                                               \
    }

LR_INLINE lanes lanes_load(const void *from)
{
    LR_EACH(LR_OF(load)((const float *)from + LANES_PER_PART * i));
}

LR_INLINE void lanes_store(void *to, lanes a)
{
    for (int i = 0; i < LANE_PARTS; i++)
        LR_OF(store)((float *)to + LANES_PER_PART * i, a.of[i]);
}

LR_INLINE lanes lanes_all(float x)
{
    LR_EACH(LR_OF(set1)(x));
}

LR_INLINE lanes lanes_repeat(const float four[4])
{
#if LR_LANES_SIMD == 1
    LR_EACH(_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(four)), _mm_load_ps(four), 1));
#else
    LR_EACH(_mm_load_ps(four));
#endif
}

LR_INLINE lanes lanes_each(const float four[4])
{
#if LR_LANES_SIMD == 1
    LR_EACH(_mm256_insertf128_ps(_mm256_set1_ps(four[2 * i]), _mm_set1_ps(four[2 * i + 1]), 1));
#else
    LR_EACH(_mm_set1_ps(four[i]));
#endif
}

LR_INLINE lanes lanes_sqrt(lanes a)
{
    LR_EACH(LR_OF(sqrt)(a.of[i]));
}

LR_INLINE lanes lanes_abs(lanes a)
{
    LR_EACH(LR_OF(andnot)(LR_OF(set1)(-0.0f), a.of[i]));
}

LR_INLINE lane_mask lanes_less(lanes a, lanes b)
{
    LR_EACH(LR_LESS(a.of[i], b.of[i]));
}

LR_INLINE lane_mask mask_and(lane_mask a, lane_mask b)
{
    LR_EACH(LR_OF (and)(a.of[i], b.of[i]));
}

LR_INLINE uint32_t mask_bits(lane_mask m)
{
    uint32_t bits = 0;
    for (int i = 0; i < LANE_PARTS; i++)
        bits |= (uint32_t)LR_OF(movemask)(m.of[i]) << (LANES_PER_PART * i);
    return bits;
}

LR_INLINE lanes lanes_pick(lane_mask m, lanes a, lanes b)
{
    LR_EACH(LR_OF(or)(LR_OF (and)(m.of[i], a.of[i]), LR_OF(andnot)(m.of[i], b.of[i])));
}

/* The largest of each four lanes that are four apart. */
LR_INLINE __m128 lanes_fold(lanes a)
{
#if LR_LANES_SIMD == 1
    __m256 two = _mm256_max_ps(a.of[0], a.of[1]);
    return _mm_max_ps(_mm256_castps256_ps128(two), _mm256_extractf128_ps(two, 1));
#else
    return _mm_max_ps(_mm_max_ps(a.of[0], a.of[1]), _mm_max_ps(a.of[2], a.of[3]));
#endif
}

#endif

LR_BINARY(lanes_add, add)
LR_BINARY(lanes_sub, sub)
LR_BINARY(lanes_mul, mul)
LR_BINARY(lanes_div, div)
LR_BINARY(lanes_min, min) /* the second where one is NaN, as the processor does */
LR_BINARY(lanes_max, max)
#undef LR_BINARY

/* The largest of lanes 0, 1, 4, 5, 8 ... and of the others. */
LR_INLINE void lanes_halves(lanes a, float *low, float *high)
{
    __m128 four = lanes_fold(a);
    four = _mm_max_ps(four, _mm_shuffle_ps(four, four, 0xb1));
    *low = _mm_cvtss_f32(four);
    *high = _mm_cvtss_f32(_mm_movehl_ps(four, four));
}

#undef LR_EACH
#undef LR_LESS
#undef LR_OF
