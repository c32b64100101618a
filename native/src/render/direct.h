/* Light that comes straight from lamps and from the world.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_DIRECT_H
#define LR_DIRECT_H

#include "render/job.h"

/* Add to the pixels what the first n surfels send to their viewers of the light
 * that lamps and a world of unequal brightness send to them. The wave is
 * overwritten. */
lr_status lr_light_surfels(const lr_job *job, uint32_t n);

/* Add to the pixels' ao how much of the sky within tile->ao_distance the first n
 * surfels see, which are seen by the camera. The wave is overwritten. */
lr_status lr_ambient_occlusion(const lr_job *job, uint32_t n);

/* How often a path's surface, with `bounces` of them behind it, asks each lamp. */
LR_INLINE double lr_lamp_chance(const lr_scene *scene, uint32_t bounces)
{
    const uint64_t n = scene->n_lights + (scene->environment.width > 0);
    return bounces == 0 || n == 0 ? 1 : 1 / (double)n;
}

/* The share of one of two ways to find the same light: densities p of this one
 * and q of the other. Power heuristic: Veach 1997. */
LR_INLINE double lr_mis(double p, double q)
{
    if (!(p < INFINITY))
        return 1;
    return p > 0 ? 1 / (1 + q / p * (q / p)) : 0;
}

#endif
