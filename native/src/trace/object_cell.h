/* The hit test of cells in a volume that tells objects apart.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_OBJECT_CELL_H
#define LR_TRACE_OBJECT_CELL_H

#include "trace/cell.h"

/* As lr_hit_cell, for every object in the cell by itself; the nearest root wins, of
 * equal ones that of the lower object. */
bool lr_hit_objects(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side,
                    const lr_trace_options *options, lr_found *found, uint64_t *n_samples);

/* The id of the hit object's sample that is nearest to the hit. */
int32_t lr_id_of_object(const lr_volume *v, const lr_found *found);

#endif
