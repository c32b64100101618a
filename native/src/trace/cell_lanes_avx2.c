/* Cells side by side, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/cell_lanes.h"

#define LR_LANES_NAME(name) name##_avx2

LR_TARGET_AVX2
#include "trace/cell_lanes_impl.h"
LR_TARGET_END
