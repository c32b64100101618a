/* The generalised winding number of a mesh around a point.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_WINDING_NUMBER_H
#define LR_MESH_WINDING_NUMBER_H

#include "mesh/topology.h"

typedef struct lr_winding_node {
    double centre[3];  /* of the triangles' area */
    double normal[3];  /* sum of their area vectors */
    double far2;       /* squared distance beyond which they count as one dipole */
    uint32_t first, n; /* of the list: a leaf where n is small */
} lr_winding_node;

typedef struct lr_winding {
    const lr_topology *mesh;
    uint32_t *list; /* triangles in the order of the leaves */
    uint32_t n;
    lr_winding_node *nodes; /* the children of node i are 2 i + 1 and 2 i + 2 */
} lr_winding;

/* What was built is freed by lr_winding_free, after an error too. */
lr_status lr_winding_make(const lr_topology *mesh, const lr_watch *watch, lr_winding *winding,
                          lr_error *error);
void lr_winding_free(lr_winding *winding);
uint64_t lr_winding_nbytes(const lr_winding *winding);

/* The generalised winding number at a point in the mesh's coordinates: 1 inside a
 * closed mesh, 0 outside, to about 0.01 where triangles are far. */
double lr_winding_at(const lr_winding *winding, const double p[3]);

/* The same with its gradient; fine: to about 0.002. */
double lr_winding_slope(const lr_winding *winding, const double p[3], bool fine,
                        double gradient[3]);

#endif
