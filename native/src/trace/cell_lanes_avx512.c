/* Cells side by side, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/cell_lanes.h"

#define LR_LANES_NAME(name) name##_avx512

LR_TARGET_AVX512
#include "trace/cell_lanes_impl.h"
LR_TARGET_END
