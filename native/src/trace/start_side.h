/* Rays that leave triangles: their starts, put on the side to which they leave.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_START_SIDE_H
#define LR_TRACE_START_SIDE_H

#include "grid/triangle_cells.h"

/* The ways, in storage space, that take a start q onto this side, -1 or +1, and onto the other one,
 * of those of a triangle cell's triangles that it lies on but for rounding. */
void lr_ways_to_sides(const lr_volume *v, const int32_t c[3], int32_t side, const double q[3],
                      double way[2][3]);

#endif
