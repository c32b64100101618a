/* Signed distance from a point to the triangle that is nearest to it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_SIGNED_DISTANCE_H
#define LR_MESH_SIGNED_DISTANCE_H

#include "mesh/triangle_distance.h"

/* Signed distance, positive inside (behind the winding's front). The sign is that of the
 * triangle's closest feature. *height is the same, but where the closest point lies on the
 * mesh's border (*border): there it is the height over the surface's continuation, so that
 * the field of a sheet continues straight beyond its border. */
double lr_signed_distance(const lr_topology *mesh, uint32_t t, const lr_frame *frame,
                          const double p[3], double *height, bool *border);

#endif
