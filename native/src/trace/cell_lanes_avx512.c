/* Cells side by side, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/cell_lanes.h"

#define LR_LANES_NAME(name) name##_avx512

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))),        \
                             apply_to = function)
#else
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl")
#endif
#include "trace/cell_lanes_impl.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
