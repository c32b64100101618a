/* Nearest triangles by the instructions that every processor here has (SSE2).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <immintrin.h>

#include "voxel/frame.h"
#include "voxel/nearest.h"

#define LR_LANES_SIMD 0
#define LR_SEARCH     lr_nearest_portable
#include "voxel/search.h"
