/* What a surface carries beside its shape: colours, shading normals.
 *
 * Samples near the surface name the triangle that is nearest to them, and the volume
 * keeps the triangles so named, its *faces*, with what their corners carry. At a hit
 * those named by the corners of its cell compete: the one that the hit lies on wins, and
 * where it lies on none of them, as on triangles much smaller than a voxel, they share
 * it by their distances. So a texture is as sharp as on the mesh, whatever the voxel,
 * seams of UVs and of materials are where the mesh has them, and storage follows the
 * surface: a number per sample, a row per triangle that is named. In a triangle cell nothing
 * competes: the triangle that was hit has a row of its own.
 *
 * Of normals only those count whose face leans little from the surface that was hit: so
 * nothing bleeds over a crease.
 *
 * Source: Shepard 1968 (shares by distance).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ATTRIBUTES_ATTRIBUTES_H
#define LR_GRID_ATTRIBUTES_ATTRIBUTES_H

#include "grid/access.h"

/* A face at a hit. */
typedef struct lr_share {
    uint32_t face;
    double at[3];     /* barycentric, of the face's closest point */
    double beyond[3]; /* of the hit itself, in the face's plane */
    double weight;    /* of all shares: 1 */
} lr_share;

enum { LR_SHARES_MAX = 8 };

/* The faces that share p (0..1) in storage cell c, for a hit of that id; 0: none.
 * geometric: the unit normal of the surface there, of either sign, from which faces must
 * not lean; or NULL. */
uint32_t lr_volume_shares(const lr_volume *volume, const int32_t c[3], const double p[3],
                          int32_t id, const double *geometric, lr_share share[LR_SHARES_MAX]);

/* Linear RGB there, textures averaged over `width` voxels of the surface; false, and rgb
 * untouched, where the volume carries none. triangle: that of a triangle cell which was hit, or
 * LR_NO_TRIANGLE. */
bool lr_volume_color(const lr_volume *volume, const int32_t c[3], const double p[3], int32_t id,
                     uint32_t triangle, double width, double rgb[3]);

/* Unit shading normal in object space, outward as the mesh is wound; false, and n
 * untouched, where the volume carries none. triangle: likewise; geometric is not read where
 * there is one. */
bool lr_volume_shading_normal(const lr_volume *volume, const int32_t c[3], const double p[3],
                              int32_t id, uint32_t triangle, const double *geometric, double n[3]);

/* Does it? */
bool lr_carries_normals(const lr_volume *volume);

/* A triangle with shading normals. */
typedef struct lr_smooth_triangle {
    double corner[3][3], normal[3][3]; /* object space; normals as the mesh is wound */
    double at[3];                      /* barycentric: the hit */
} lr_smooth_triangle;

/* Of a triangle of a triangle cell that was hit at p; false where the volume has no normals for
 * it. */
bool lr_volume_smooth_triangle(const lr_volume *volume, const int32_t c[3], const double p[3],
                               uint32_t triangle, lr_smooth_triangle *smooth);

#endif
