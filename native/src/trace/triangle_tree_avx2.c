/* Rays through trees of triangles, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <immintrin.h>

#include "base/target.h"
#include "trace/triangle_tree.h"

#define LR_TREE_OPS lr_tree_avx2
#define LR_TREE_FOUR(x)                                                                            \
    _mm256_movemask_pd(_mm256_cmp_pd(_mm256_loadu_pd(x), _mm256_set1_pd(INFINITY), _CMP_LT_OQ))
#define LR_TREE_FINITE(x) (uint32_t)(LR_TREE_FOUR(x) | LR_TREE_FOUR((x) + 4) << 4)
#define LR_WIDE_CROSSED(in, out, last)                                                             \
    (uint32_t)_mm256_movemask_ps(                                                                  \
        _mm256_and_ps(_mm256_cmp_ps((__m256) * (in), (__m256) * (out), _CMP_LE_OQ),                \
                      _mm256_cmp_ps((__m256) * (in), _mm256_set1_ps(last), _CMP_LE_OQ)))

LR_TARGET_AVX2
#include "trace/triangle_tree_impl.h"
LR_TARGET_END
