/* The store for eight lanes of AVX-512: cells' places and corners by gathers.
 *
 * What follows is compiled for that instruction set, whatever the file is; only call it where the
 * processor has it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_GATHER_H
#define LR_GRID_GATHER_H

#include <immintrin.h>

#include "base/target.h"
#include "grid/triangle_cells.h"

LR_TARGET_AVX512

/* ---- bricks and cells ---------------------------------------------------- */

LR_INLINE __m256i lr_lanes_brick_along(const lr_volume *v, int a, __m256i c)
{
    const int32_t stride[3] = {1, v->table_size[0], v->table_size[0] * v->table_size[1]};
    const __m256i b = _mm256_srai_epi32(c, LR_SIDE_BITS);
    return a == 0 ? b : _mm256_mullo_epi32(b, _mm256_set1_epi32(stride[a]));
}

/* The places in the table of the bricks of cells. */
LR_INLINE __m256i lr_lanes_table_of(const lr_volume *v, const __m256i c[3])
{
    return _mm256_add_epi32(
        _mm256_add_epi32(lr_lanes_brick_along(v, 0, c[0]), lr_lanes_brick_along(v, 1, c[1])),
        lr_lanes_brick_along(v, 2, c[2]));
}

/* What a coordinate adds to the number of a cell in its brick. */
LR_INLINE __m256i lr_lanes_in_brick_along(int a, __m256i c)
{
    return _mm256_slli_epi32(_mm256_and_si256(c, _mm256_set1_epi32(LR_SIDE - 1)), a * LR_SIDE_BITS);
}

/* Where cells are in an array of LR_CELLS items for each brick, numbered as given. */
LR_INLINE __m512i lr_lanes_item_of(__m256i brick, __m256i in_brick)
{
    return _mm512_add_epi64(_mm512_slli_epi64(_mm512_cvtepu32_epi64(brick), 3 * LR_SIDE_BITS),
                            _mm512_cvtepi32_epi64(in_brick));
}

LR_INLINE __m512i lr_lanes_cell_of(__m256i brick, const __m256i c[3])
{
    const __m256i in = _mm256_add_epi32(
        _mm256_add_epi32(lr_lanes_in_brick_along(0, c[0]), lr_lanes_in_brick_along(1, c[1])),
        lr_lanes_in_brick_along(2, c[2]));
    return lr_lanes_item_of(brick, in);
}

/* ---- samples ------------------------------------------------------------- */

LR_INLINE __m256i lr_lanes_entries(const lr_volume *v, __mmask8 m, __m256i at)
{
    return _mm256_mmask_i32gather_epi32(_mm256_setzero_si256(), m, at, v->table, 4);
}

LR_INLINE __m256i lr_lanes_low_bits(__m256i x, int32_t mask)
{
    return _mm256_and_si256(x, _mm256_set1_epi32(mask));
}

/* Two samples of nbytes each side by side, as they are stored. back: lanes that have two samples
 * before them in their row, so that four bytes never reach beyond the last brick. */
LR_INLINE void lr_lanes_pairs_of(const unsigned char *samples, size_t nbytes, __mmask8 m,
                                 __m512i at, __mmask8 back, __m256i *first, __m256i *second)
{
    const __m256i none = _mm256_setzero_si256();
    if (nbytes == 2) {
        const __m256i pair = _mm512_mask_i64gather_epi32(none, m, at, samples, 2);
        *first = lr_lanes_low_bits(pair, 0xffff);
        *second = _mm256_srli_epi32(pair, 16);
    } else if (nbytes == 1) {
        at = _mm512_mask_sub_epi64(at, back, at, _mm512_set1_epi64(2));
        const __m256i four = _mm512_mask_i64gather_epi32(none, m, at, samples, 1);
        const __m256i pair = _mm256_mask_srli_epi32(four, back, four, 16);
        *first = lr_lanes_low_bits(pair, 0xff);
        *second = lr_lanes_low_bits(_mm256_srli_epi32(pair, 8), 0xff);
    } else {
        const __m512i pair = _mm512_mask_i64gather_epi64(_mm512_setzero_si512(), m, at, samples, 4);
        *first = _mm512_cvtepi64_epi32(pair);
        *second = _mm512_cvtepi64_epi32(_mm512_srli_epi64(pair, 32));
    }
}

LR_INLINE void lr_lanes_pairs(const lr_volume *v, __mmask8 m, __m512i at, __mmask8 back,
                              __m256i *first, __m256i *second)
{
    switch (v->desc.sample_type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        lr_lanes_pairs_of(v->samples, sizeof(stored), m, at, back, first, second);                 \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
    __builtin_unreachable();
}

LR_INLINE __m512d lr_lanes_values(const lr_volume *v, __m256i stored)
{
    return v->desc.sample_type == LR_F32 ? _mm512_cvtps_pd(_mm256_castsi256_ps(stored))
                                         : _mm512_cvtepi32_pd(stored);
}

/* The corners of the lanes' cells, as lr_corners; *entry: the cells' own. */
LR_INLINE void lr_lanes_corners(const lr_volume *v, const __m256i c[3], __mmask8 m, __m512d s[8],
                                __m256i *entry)
{
    const __m256i one = _mm256_set1_epi32(1),
                  upper[2] = {_mm256_add_epi32(c[1], one), _mm256_add_epi32(c[2], one)};
    const __m256i x = lr_lanes_in_brick_along(0, c[0]), first = lr_lanes_brick_along(v, 0, c[0]);
    const __m256i y[2] = {lr_lanes_brick_along(v, 1, c[1]), lr_lanes_brick_along(v, 1, upper[0])};
    const __m256i z[2] = {lr_lanes_brick_along(v, 2, c[2]), lr_lanes_brick_along(v, 2, upper[1])};
    const __m256i y_in[2] = {lr_lanes_in_brick_along(1, c[1]),
                             lr_lanes_in_brick_along(1, upper[0])};
    const __m256i z_in[2] = {lr_lanes_in_brick_along(2, c[2]),
                             lr_lanes_in_brick_along(2, upper[1])};
    const __mmask8 apart = /* in two bricks */
        _mm256_mask_cmpeq_epi32_mask(m, x, _mm256_set1_epi32(LR_SIDE - 1));
    const __m256i from = _mm256_mask_sub_epi32(x, apart, x, one);
    const __mmask8 back = _mm256_mask_cmpge_epi32_mask(m, from, _mm256_set1_epi32(2));
    for (int n = 0; n < 4; n++) {
        const int j = n & 1, l = n >> 1;
        const __m256i at = _mm256_add_epi32(_mm256_add_epi32(first, y[j]), z[l]);
        const __m256i row = _mm256_add_epi32(y_in[j], z_in[l]);
        const __m256i of = lr_lanes_entries(v, m, at);
        __m256i low, high;
        lr_lanes_pairs(v, m,
                       lr_lanes_item_of(_mm256_srli_epi32(of, 8), _mm256_add_epi32(from, row)),
                       back, &low, &high);
        if (apart != 0) {
            const __m256i next = lr_lanes_entries(v, apart, _mm256_add_epi32(at, one));
            __m256i beyond, unused;
            lr_lanes_pairs(v, apart, lr_lanes_item_of(_mm256_srli_epi32(next, 8), row), 0, &beyond,
                           &unused);
            low = _mm256_mask_mov_epi32(low, apart, high);
            high = _mm256_mask_mov_epi32(high, apart, beyond);
        }
        s[2 * n] = lr_lanes_values(v, low);
        s[2 * n + 1] = lr_lanes_values(v, high);
        if (n == 0)
            *entry = of;
    }
}

/* ---- triangle cells -------------------------------------------------------- */

/* Lanes whose field is not trusted in their cell, of the given entries. */
LR_INLINE __mmask8 lr_lanes_doubted(const lr_volume *v, const __m256i c[3], __mmask8 m,
                                    __m256i entry)
{
    __m256i word = _mm256_setzero_si256(), bit = _mm256_setzero_si256();
    for (int a = 0; a < 3; a++) {
        const __m256i half = lr_lanes_low_bits(_mm256_srli_epi32(c[a], LR_WORD_SIDE_BITS), 1);
        word = _mm256_or_si256(word, _mm256_slli_epi32(half, a));
        bit = _mm256_or_si256(bit, _mm256_slli_epi32(lr_lanes_low_bits(c[a], 3), 2 * a));
    }
    const __m512i brick = _mm512_cvtepu32_epi64(_mm256_srli_epi32(entry, 8));
    const __m512i cells = _mm512_mask_i64gather_epi64(
        _mm512_setzero_si512(), m,
        _mm512_add_epi64(_mm512_slli_epi64(brick, 3), _mm512_cvtepu32_epi64(word)),
        v->triangle_cells->doubt, 8);
    return _mm512_mask_test_epi64_mask(m, _mm512_srlv_epi64(cells, _mm512_cvtepu32_epi64(bit)),
                                       _mm512_set1_epi64(1));
}

LR_TARGET_END

#endif
