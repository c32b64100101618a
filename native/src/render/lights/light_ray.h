/* What a light answers a point that asks for a way to it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_RAY_H
#define LR_RENDER_LIGHTS_LIGHT_RAY_H

#include "base/base.h"

/* A way from a point to a light: what arrives is f cos x color / pdf. */
typedef struct lr_light_ray {
    double direction[3]; /* unit */
    double distance;     /* infinity for suns */
    double color[3];     /* radiance; of a light without extent the irradiance it brings */
    double pdf;          /* per solid angle; 1 for a light without extent */
    bool delta;          /* without extent: no other ray can meet it */
} lr_light_ray;

#endif
