/* Attributes of a mesh's corners: copies those of the triangles that a volume refers to.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_KEEP_ATTRIBUTES_H
#define LR_VOXELIZE_KEEP_ATTRIBUTES_H

#include "mesh/topology.h"

/* Samples within this distance of the surface, in voxels, store their nearest triangle: the
 * diagonal of a cell, sqrt(3), and a quarter for cells that only come near the surface. */
#define LR_ATTRIBUTE_RADIUS 2.0

/* Which attributes a mesh has. */
typedef struct lr_attribute_set {
    bool any; /* one of the following */
    bool normals, sources, colors, uvs;
} lr_attribute_set;

/* List the attributes of the mesh and check them. */
lr_status lr_check_attributes(const lr_mesh *mesh, const lr_watch *watch, lr_attribute_set *set,
                              lr_error *error);

/* Give a finished volume, whose samples store their nearest triangle's number plus one, the
 * attributes of those triangles; number the triangles anew, without those that none stores. */
lr_status lr_keep_attributes(const lr_attribute_set *set, const lr_topology *mesh,
                             lr_volume *volume, const lr_watch *watch, lr_error *error);

#endif
