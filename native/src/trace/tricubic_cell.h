/* The hit test of cells in a cubic volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRICUBIC_CELL_H
#define LR_TRACE_TRICUBIC_CELL_H

#include "trace/cell.h"

/* As lr_hit_cell; found->corner is not set. *side: of a ray that has left the surface at t_start,
 * 0: of others; afterwards that in the next cell. */
bool lr_hit_tricubic(const lr_volume *v, const lr_ray *r, const lr_cursor *u, double t_start,
                     int *side, const lr_trace_options *options, lr_found *found,
                     uint64_t *n_samples);

#endif
