/* Area lights: see area_light.c.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_AREA_LIGHT_H
#define LR_RENDER_LIGHTS_AREA_LIGHT_H

#include "render/lights/light_ray.h"

/* As lr_light_sample and lr_light_hit. */
bool lr_area_light_sample(const lr_light *light, const double p[3], const double u[2],
                          lr_light_ray *ray);
bool lr_area_light_hit(const lr_light *light, const double o[3], const double d[3], double *t,
                       double color[3], double *pdf);

/* Its radiant intensity where it shines brightest, as a share of color. */
double lr_area_light_intensity(const lr_light *light);

#endif
