/* Results of the functions of lights: a ray to a light, and a light's bounds.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_RAY_H
#define LR_RENDER_LIGHTS_LIGHT_RAY_H

#include "base/base.h"

/* A ray from a point to a light; its contribution is f cos x color / pdf. */
typedef struct lr_light_ray {
    double direction[3]; /* unit */
    double distance;     /* infinity for distant lights */
    double color[3];     /* radiance; of a light without extent, irradiance */
    double pdf;          /* per solid angle; 1 for a light without extent */
    bool delta;          /* without extent: no other ray can meet it */
} lr_light_ray;

/* Where a light is, and into which directions it emits how much. */
typedef struct lr_light_bounds {
    double lo[3], hi[3]; /* box */
    double axis[3];      /* unit: it faces directions within an angle of this; */
    double cos_facing;   /* the angle's cosine. */
    double cos_emission; /* It emits up to this angle, at most a right one, beside them. */
    double power;        /* sum of radiant intensities on these axes, of lr_brightness */
    bool distant;        /* it has no box: it lies within that angle of axis; power: irradiance */
} lr_light_bounds;

/* Of the channels' absolute values: negative light counts as much. */
LR_INLINE double lr_brightness(const double rgb[3])
{
    return fabs(rgb[0]) + fabs(rgb[1]) + fabs(rgb[2]);
}

#endif
