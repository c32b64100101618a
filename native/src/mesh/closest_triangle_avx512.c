/* Nearest triangles by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <immintrin.h>

#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"

#define LR_LANES_SIMD 2
#define LR_SEARCH     lr_nearest_avx512

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))),        \
                             apply_to = function)
#else
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl")
#endif
#include "mesh/closest_triangle_impl.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
