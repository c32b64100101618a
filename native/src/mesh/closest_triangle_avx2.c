/* Nearest triangles by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"

#define LR_VECTORS 1
#define LR_SEARCH  lr_nearest_avx2

LR_TARGET_AVX2
#include "mesh/closest_triangle_impl.h"
LR_TARGET_END
