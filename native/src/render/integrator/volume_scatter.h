/* Where volumes scatter the paths of a wave.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_VOLUME_SCATTER_H
#define LR_RENDER_INTEGRATOR_VOLUME_SCATTER_H

#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Draw the numbers that choose points: reads the paths of the rays; writes u. */
void lr_scatter_draw(const lr_path *paths, const lr_ray_queue *rays, lr_volume_scatter *scatter);

/* The points at which the chosen participants scatter: reads the rays, their paths, their ends and
 * the light of volumes before these; writes the points, in the order of the rays. Uses the batch.
 */
lr_status lr_find_volume_points(const lr_context *context, double t_min, const lr_path *paths,
                                lr_wave *wave, lr_volume_queue *points);

#endif
