/* Which cells of a filled volume hold surface: the end of lr_volume_finish.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_CLASSIFY_CELLS_H
#define LR_GRID_CLASSIFY_CELLS_H

#include "grid/triangle_cells.h"

/* The surface cells of the brick at a position of the table; false: none. */
bool lr_surface_mask(const lr_volume *volume, const int32_t b[3], lr_mask mask);

/* lr_volume_finish with triangle cells, which count as surface cells, too. */
lr_status lr_volume_finish_triangle_cells(lr_volume *volume, const lr_triangle_cells_part *parts,
                                          uint32_t n_parts, const lr_triangle_cells_source *source,
                                          const lr_watch *watch, lr_error *error);

#endif
