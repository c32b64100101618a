/* Lists the triangles of each brick.
 *
 * A triangle is listed in every brick within the band of it, conservatively. Bricks with a
 * list are *active*; ranges of active bricks of similar work are the parts that threads run.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_TRIANGLE_BINS_H
#define LR_VOXELIZE_TRIANGLE_BINS_H

#include "grid/layout.h"
#include "mesh/topology.h"

typedef struct lr_bins {
    uint32_t n_active;
    uint32_t *brick; /* [n_active]: place in the volume's table, ascending */
    uint64_t *start; /* [n_active + 1]: where its list starts */
    uint32_t *list;  /* triangles, ascending within a brick */
    uint32_t n_parts;
    uint32_t *part;   /* [n_parts + 1]: first active brick of each part */
    uint32_t longest; /* list of all */
} lr_bins;

/* Band in voxels. all: also triangles that do not count, which are not known before the
 * mesh is linked. What was built is freed by lr_bins_free, after an error too. */
lr_status lr_bins_make(const lr_topology *mesh, const int32_t table_size[3], double band, bool all,
                       const lr_watch *watch, lr_bins *bins, lr_error *error);
enum { LR_BIN_ACTIVE = 2 };

/* Make the bricks of a table active whose state[n_table] is LR_BIN_ACTIVE, n_active in all,
 * among them those that are active already. */
lr_status lr_bins_add(lr_bins *bins, const uint8_t *state, size_t n_table, uint32_t n_active,
                      lr_error *error);
void lr_bins_free(lr_bins *bins);

#endif
