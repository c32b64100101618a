/* The world's radiance: one colour, or an image by longitude and latitude.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_ENVIRONMENT_H
#define LR_RENDER_LIGHTS_ENVIRONMENT_H

#include "render/lights/light_ray.h"

typedef struct lr_environment {
    double color[3];
    double brightness; /* mean of the image's lr_brightness over all directions */
    double image_from_world[9];
    int32_t width, height;   /* of the table below, a multiple of the image's; 0 without one */
    const lr_texture *image; /* the caller's, or NULL */
    float *rows;             /* [height + 1] fraction of the light below each row */
    float *columns;          /* [height][width + 1] fraction of a row's light before each column */
} lr_environment;

lr_status lr_environment_check(const lr_world *world, lr_error *error);
lr_status lr_environment_make(const lr_world *world, lr_environment *environment, lr_error *error);
void lr_environment_free(lr_environment *environment);

/* The radiance that comes from direction d (unit). */
void lr_environment_radiance(const lr_environment *environment, const double d[3], double rgb[3]);

/* A ray to it as lr_light_sample gives, denser where the image is brighter; false without an
 * image. */
bool lr_environment_sample(const lr_environment *environment, const double u[2], lr_light_ray *ray);
double lr_environment_pdf(const lr_environment *environment, const double d[3]); /* 0 likewise */

#endif
