/* Attributes of a mesh's corners: which triangles the samples near the surface name, and
 * what those carry.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_KEEP_ATTRIBUTES_H
#define LR_VOXELIZE_KEEP_ATTRIBUTES_H

#include "mesh/topology.h"

/* Samples farther from the surface than this, in voxels, are no corners of its
 * cells: sqrt(3), and a quarter for cells that only come near it. */
#define LR_BAKE_REACH 2.0

/* What a mesh carries. */
typedef struct lr_bake {
    bool wanted; /* something */
    bool normals, sources, colors, uvs;
} lr_bake;

/* Check what the mesh carries. */
lr_status lr_bake_check(const lr_mesh *mesh, const lr_watch *watch, lr_bake *bake, lr_error *error);

/* Give a finished volume, whose samples name triangles by their number plus one, the faces
 * that are left of these, and number them anew. */
lr_status lr_bake_faces(const lr_bake *bake, const lr_topology *mesh, lr_volume *volume,
                        const lr_watch *watch, lr_error *error);

#endif
