/* The hit test of cells in a cubic volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRICUBIC_CELL_H
#define LR_TRACE_TRICUBIC_CELL_H

#include "trace/cell.h"

/* As lr_hit_cell; found->corner is not set. *side: where the ray starts in the cell, 0: as f says;
 * afterwards where it starts in the next one. */
bool lr_hit_tricubic(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int *side,
                     const lr_trace_options *options, lr_found *found, uint64_t *n_samples);

#endif
