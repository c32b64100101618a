/* What a light sends to a shading point.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_SAMPLED_LIGHT_H
#define LR_RENDER_INTEGRATOR_SAMPLED_LIGHT_H

#include "render/lights/light_ray.h"

/* A light sample as a shading point sees it. */
typedef struct lr_sampled_light {
    lr_light_ray ray;
    uint32_t visibility; /* lr_visibility */
} lr_sampled_light;

#endif
