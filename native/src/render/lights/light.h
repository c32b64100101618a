/* Lights: where they are seen, how brightly, and how to sample them.
 *
 * What each function answers, the light's own type says: see light_type.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_H
#define LR_RENDER_LIGHTS_LIGHT_H

#include "base/base.h"

/* A ray from a point to a light: what arrives is f cos x color / pdf. */
typedef struct lr_light_ray {
    double direction[3]; /* unit */
    double distance;     /* infinity for distant lights */
    double color[3];     /* radiance; of a light without extent the irradiance it brings */
    double pdf;          /* per solid angle; 1 for a light without extent */
    bool delta;          /* without extent: no other ray can meet it */
} lr_light_ray;

/* Where a light is, which way it shines and how much. */
typedef struct lr_light_bounds {
    double lo[3], hi[3]; /* box */
    double axis[3];      /* unit: it faces directions within an angle of this; */
    double cos_facing;   /* the angle's cosine. */
    double cos_shining;  /* It shines up to this angle, at most a right one, beside them. */
    double power;        /* sum of radiant intensities on these axes, of lr_brightness */
    bool distant;        /* it has no box: it lies within that angle of axis; power: irradiance */
} lr_light_bounds;

/* Of all colours, whatever their sign: light that is taken away counts as much. */
LR_INLINE double lr_brightness(const double rgb[3])
{
    return fabs(rgb[0]) + fabs(rgb[1]) + fabs(rgb[2]);
}

/* Whether light i can be used. */
lr_status lr_light_check(const lr_light *light, uint64_t i, lr_error *error);

/* Can rays meet it? */
bool lr_light_has_extent(const lr_light *light);

void lr_light_bound(const lr_light *light, lr_light_bounds *bounds);

/* A ray from p to the light; false where p gets nothing by it. u: 0..1, 1 not included. */
bool lr_light_sample(const lr_light *light, const double p[3], const double u[2],
                     lr_light_ray *ray);

/* Where a ray (d unit) meets a light of extent before t_max: its distance, its radiance, and
 * the density with which lr_light_sample finds it from o. False where it is missed or dark. */
bool lr_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                  double *t, double color[3], double *pdf);

#endif
