/* Cells side by side, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/cell_lanes.h"

#define LR_LANES_NAME(name) name##_avx2

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "trace/cell_lanes_impl.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
