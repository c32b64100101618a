/* Decides whether a mesh that is not closed is a solid or a sheet.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_SOLID_OR_SHEET_H
#define LR_VOXELIZE_SOLID_OR_SHEET_H

#include "mesh/winding_number.h"

typedef struct lr_mesh_kind {
    bool solid;
    int32_t reason; /* lr_reason */
    double hole;    /* extent of the widest loop of border edges, voxels */
    bool wide;      /* wide enough to be visible */
} lr_mesh_kind;

/* Decide by edges alone; *open: holes or inconsistent winding make it a sheet. */
lr_status lr_mesh_kind_by_edges(const lr_topology *mesh, const lr_watch *watch,
                                lr_mesh_kind *mesh_kind, bool *open, lr_error *error);
/* Then decide by probes. */
lr_status lr_mesh_kind_by_probes(const lr_winding *winding, const lr_watch *watch,
                                 lr_mesh_kind *mesh_kind, lr_error *error);

#endif
