/* Coverage of a voxel by a mesh whose shells cross.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_COVERAGE_BSP_H
#define LR_VOXELIZE_COVERAGE_BSP_H

#include "mesh/winding_number.h"

enum {
    LR_MOST_CORNERS = 24, /* of a polygon */
    LR_MOST_PIECES = 32   /* of a voxel that is cut up; others are sampled */
};

typedef struct lr_polygon {
    int n;
    double p[LR_MOST_CORNERS][3];
} lr_polygon;

/* A triangle's part in a cell, and its plane n.p = d. */
typedef struct lr_piece {
    lr_polygon polygon;
    double n[3], d;
} lr_piece;

/* Memory of a thread: pieces of the cells that are open. */
enum { LR_CROSSED_ROOM = 2048 };
typedef struct lr_crossed {
    const lr_winding *winding;
    double origin[3]; /* of the pieces' coordinates, in the mesh's */
    lr_piece piece[LR_CROSSED_ROOM];
} lr_crossed;

/* Set the plane of a piece from its triangle; false where it has no area. */
bool lr_piece_plane(const double triangle[3][3], lr_piece *piece);

/* The coverage of the unit cube at lo by its n pieces, at most LR_MOST_PIECES, the first ones
 * of the room. */
double lr_crossed_coverage(lr_crossed *room, const double lo[3], int n);

/* The same by points, SAMPLES along each axis; *plain: no point is covered twice. */
double lr_sampled_coverage(const lr_crossed *room, const double lo[3], bool *plain);

#endif
