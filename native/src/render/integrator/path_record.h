/* Records the events on the paths of one pixel, to find the cause of a wrong one.
 *
 * The events go to the caller's record; where that is NULL these functions return at once. They are
 * called once per ray or light sample, never per cell.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PATH_RECORD_H
#define LR_RENDER_INTEGRATOR_PATH_RECORD_H

#include "render/integrator/queues.h"
#include "render/integrator/sampled_light.h"

/* In place of the index of a light: */
#define LR_OWN_EMISSION    UINT64_MAX       /* the surface that is hit */
#define LR_VOLUME_EMISSION (UINT64_MAX - 1) /* volumes before it */

/* The path's next ray, which follows that of its parent; NULL: the camera's. kind: lr_ray_kind. */
void lr_record_ray(const lr_path *path, const lr_path *parent, int kind, lr_record *record);

/* What the path's ray, i of the wave, has hit; NULL: nothing. */
void lr_record_hit(const lr_path *path, const lr_hit_queue *hits, uint32_t i,
                   const lr_shading_point *shading_point, lr_record *record);

/* Where a volume scatters the path's ray before its end. */
void lr_record_scatter(const lr_volume_point *point, const lr_path *path, lr_record *record);

/* A light that the path's ray has met, its MIS weight and its contribution. */
void lr_record_found(const lr_path *path, uint64_t light_index, double mis_weight,
                     const double contribution[3], lr_record *record);

/* A light sample of a shading point, and its shadow ray; sampled: NULL if it does not
 * contribute. */
void lr_record_light(const lr_shading_point *s, uint64_t light_index, double probability,
                     const lr_sampled_light *sampled, lr_shadow_ray *shadow_ray, lr_record *record);

/* The instance that stops a shadow ray. */
void lr_record_blocked(const lr_shadow_ray *shadow_ray, uint32_t instance, lr_record *record);

/* The contribution of the shadow ray. */
void lr_record_contribution(const lr_shadow_ray *shadow_ray, lr_record *record);

#endif
