/* What participating instances do to rays before these hit a surface: they emit and absorb.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_VOLUME_LIGHT_H
#define LR_RENDER_INTEGRATOR_VOLUME_LIGHT_H

#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Reads the rays and where they end, in t; writes what comes of each, from t_min on. paths: of the
 * rays, whose media count for colors, not for what is let through; NULL: colors may be wrong.
 * scatter: which participants or media scatter rays is to be chosen; or NULL. Uses the batch. */
lr_status lr_find_volume_light(const lr_context *context, double t_min, const lr_path *paths,
                               const lr_ray_queue *rays, const double *ends, lr_batch *batch,
                               lr_volume_light *light, lr_volume_scatter *scatter);

/* Of what lies behind it, what the part of a ray from t = begin to end lets through to rays of
 * that visibility; without that of one instance (LR_NOWHERE: none). Uses the batch. */
lr_status lr_find_transmittance(const lr_context *context, const double o[3], const double d[3],
                                double begin, double end, uint32_t visibility, uint32_t without,
                                lr_batch *batch, double *transmittance);

/* Rays that have chosen a participant. */
typedef struct lr_participant_choice {
    uint32_t participant;
    const uint32_t *of_ray;
} lr_participant_choice;

/* Fill the batch with the rays that may meet a participating instance, of those that have chosen it
 * (NULL: of all): reads the rays; writes the batch, and which ray each of it is. Returns their
 * number. */
uint32_t lr_fill_participant(const lr_scene *scene, const lr_participant *participant,
                             const lr_participant_choice *choice, double t_min,
                             const lr_ray_queue *rays, const double *ends, uint32_t *ray_of,
                             lr_batch *batch);

/* Sum up along the n rays of a filled batch, which end at batch->stop if they are to: reads its
 * rays; writes its hits. */
lr_status lr_sum_up(const lr_context *context, uint32_t instance, bool stops, uint32_t n,
                    lr_batch *batch);

#endif
