/* Where paths go on from the surfaces that they have hit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_SCATTER_H
#define LR_RENDER_INTEGRATOR_SCATTER_H

#include "render/integrator/context.h"

/* Decide which kinds of rays are followed from a shading point; sets their probabilities. At most
 * 1 + *spare of them are; those beyond the first are taken from *spare. */
void lr_scatter_choose(const lr_job *job, lr_shading_point *shading_point, uint32_t *free_slots);

/* Put the rays that were chosen into the next queue. */
void lr_scatter_on(const lr_job *job, const lr_shading_point *shading_point);

/* How far a ray of this kind from a surface of the path must see nothing, to see
 * the world. */
double lr_world_distance(const lr_job *job, const lr_path *path, int kind);

#endif
