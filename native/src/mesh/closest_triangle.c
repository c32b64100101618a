/* Nearest triangles by SSE2, which every x86-64 processor has, or without vector
 * instructions.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"

#define LR_VECTORS 0
#define LR_SEARCH  lr_nearest_portable
#include "mesh/closest_triangle_impl.h"
