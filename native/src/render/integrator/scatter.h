/* Continues paths from the surfaces that they have hit, and from where volumes scatter them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_SCATTER_H
#define LR_RENDER_INTEGRATOR_SCATTER_H

#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Decide which kinds of rays a shading point spawns: reads its BSDF and path; writes
 * their probabilities. At most 1 + *free_slots of them are; those beyond the first are taken from
 * *free_slots. */
void lr_scatter_choose(const lr_context *context, lr_shading_point *shading_point,
                       uint32_t *free_slots);

/* Decide whether a point in a volume is continued, and, where no slot is free, whether that or the
 * shading point behind it (NULL: there is none): reads the path; writes both. To be called before
 * lr_scatter_choose of the latter. */
void lr_scatter_choose_volume(const lr_context *context, lr_volume_point *point,
                              lr_shading_point *behind, uint32_t *free_slots);

/* Spawn the rays that were chosen: reads the shading point; writes paths into the next queue. */
void lr_scatter_on(const lr_context *context, const lr_shading_point *shading_point,
                   lr_path_queue *next);

/* The distance within which a ray of this kind from a surface of the path must miss, to see the
 * world. */
double lr_world_distance(const lr_tile *tile, const lr_path *path, int kind);

#endif
