/* Rays through trees of triangles, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <immintrin.h>

#include "base/target.h"
#include "trace/triangle_tree.h"

#define LR_TREE_OPS lr_tree_avx512
#define LR_TREE_FINITE(x)                                                                          \
    _mm512_cmp_pd_mask(_mm512_loadu_pd(x), _mm512_set1_pd(INFINITY), _CMP_LT_OQ)
#define LR_WIDE_CROSSED(in, out, last)                                                             \
    _mm256_mask_cmp_ps_mask(_mm256_cmp_ps_mask((__m256) * (in), (__m256) * (out), _CMP_LE_OQ),     \
                            (__m256) * (in), _mm256_set1_ps(last), _CMP_LE_OQ)

LR_TARGET_AVX512
#include "trace/triangle_tree_impl.h"
LR_TARGET_END
