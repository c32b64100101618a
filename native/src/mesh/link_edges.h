/* Links the half-edges of a mesh into rings, and finds its orientation.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_LINK_EDGES_H
#define LR_MESH_LINK_EDGES_H

#include "mesh/topology.h"

/* Weld a mesh that lr_topology_begin made, link its edges and orient it. */
lr_status lr_topology_link(lr_topology *topology, const lr_watch *watch, lr_error *error);

/* Has the half-edge one partner, of its own winding? */
bool lr_edge_closed(const lr_topology *topology, uint32_t half_edge);

#endif
