/* What participating instances do to rays before these hit a surface: they emit and absorb.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_VOLUME_LIGHT_H
#define LR_RENDER_INTEGRATOR_VOLUME_LIGHT_H

#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Reads the rays and where they end, in t; writes what comes of each, from t_min on; without colors
 * those may be wrong, and what is let through is right. Uses the batch. The scene has participating
 * instances. */
lr_status lr_find_volume_light(const lr_context *context, double t_min, bool colors,
                               const lr_ray_queue *rays, const double *ends, lr_batch *batch,
                               lr_volume_light *light);

/* Of what lies behind it, what the part of a ray from t = begin to end lets through to rays of
 * that visibility. Uses the batch. */
lr_status lr_find_transmittance(const lr_context *context, const double o[3], const double d[3],
                                double begin, double end, uint32_t visibility, lr_batch *batch,
                                double *transmittance);

#endif
