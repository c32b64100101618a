/* Signed distance from a point to the triangle that is nearest to it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_SIGNED_DISTANCE_H
#define LR_MESH_SIGNED_DISTANCE_H

#include "mesh/triangle_distance.h"

/* Signed distance, positive inside (behind the winding's front). The feature of
 * the triangle that is nearest gives the sign. *height is the same, but beyond the
 * border of the mesh: there it is the height over the surface's continuation, so
 * that the field of a sheet runs on straight beyond its rim; *border tells. */
double lr_signed_distance(const lr_topology *mesh, uint32_t t, const lr_frame *frame,
                          const double p[3], double *height, bool *border);

#endif
