/* Nearest triangles by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"

#define LR_VECTORS 2
#define LR_SEARCH  lr_nearest_avx512

LR_TARGET_AVX512
#include "mesh/closest_triangle_impl.h"
LR_TARGET_END
