/* Nearest triangles by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <immintrin.h>

#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"

#define LR_LANES_SIMD 1
#define LR_SEARCH     lr_nearest_avx2

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "mesh/closest_triangle_impl.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
