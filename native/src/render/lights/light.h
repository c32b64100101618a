/* Lights of all types: intersection and sampling.
 *
 * Each function calls that of the light's type: see light_type.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_H
#define LR_RENDER_LIGHTS_LIGHT_H

#include "render/lights/light_ray.h"

/* LR_E_ARGUMENT if light i is invalid. */
lr_status lr_light_check(const lr_light *light, uint64_t i, lr_error *error);

/* Can rays meet it? */
bool lr_light_has_extent(const lr_light *light);

void lr_light_bound(const lr_light *light, lr_light_bounds *bounds);

/* Sample a ray from p to the light; false where it does not contribute. u: 0..1, 1 not
 * included. */
bool lr_light_sample(const lr_light *light, const double p[3], const double u[2],
                     lr_light_ray *ray);

/* Intersect a ray (d unit) with a light of extent before t_max: its distance, its radiance, and
 * the density of lr_light_sample from o. False where it is missed or dark. */
bool lr_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                  double *t, double color[3], double *pdf);

#endif
