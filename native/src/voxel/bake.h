/* Attributes of a mesh's corners, baked into the samples near the surface.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXEL_BAKE_H
#define LR_VOXEL_BAKE_H

#include "voxel/frame.h"

/* Samples farther from the surface than this, in voxels, are no corners of its
 * cells: sqrt(3), and a quarter for cells that only come near it. */
#define LR_BAKE_REACH 2.0

typedef struct lr_bake {
    const lr_attributes *source; /* NULL: nothing is baked */
    bool colors, normals;
    double color_scale; /* the largest channel that can be told */
} lr_bake;

/* A triangle with its corners' attributes, ready for many samples. */
typedef struct lr_dress {
    const lr_frame *frame;
    double across[3]; /* height of the triangle over edge e */
    double normal[3][3];
    double color[3][3]; /* of vertices; without a texture */
    double uv[3][2];
    const lr_texture *texture;
    double major[2], width; /* a voxel in texels; see voxel/texture.h */
} lr_dress;

/* Check what the mesh carries. */
lr_status lr_bake_check(const lr_mesh *mesh, const lr_watch *watch, lr_bake *bake, lr_error *error);

/* side: -1 where the mesh is wound inside out; frame must live as long. */
void lr_dress_triangle(const lr_bake *bake, uint32_t t, double side, const lr_frame *frame,
                       lr_dress *dress);

/* The codes of volume/attributes.h for the triangle's point that is closest to p;
 * color or normal may be NULL. */
void lr_dress_sample(const lr_bake *bake, const lr_dress *dress, const double p[3], uint32_t *color,
                     uint32_t *normal);

#endif
