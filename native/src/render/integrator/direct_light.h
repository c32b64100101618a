/* Direct light: what lights and the world send to surfaces.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H
#define LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H

#include "render/film/film.h"
#include "render/integrator/context.h"
#include "render/integrator/queues.h"
#include "render/integrator/sampled_light.h"

/* What shading points send to their viewers of the light that lights and a world of unequal
 * brightness send to them: reads the shading points; writes the pixels' sums, and on the way
 * shadow rays and the wave. */
lr_status lr_light_shading_points(const lr_context *context, const lr_shading_queue *shading_points,
                                  lr_shadow_queue *shadow_rays, lr_wave *wave, lr_film *film);

/* How much of the sky within tile->ao_distance shading points see, which are seen by the camera:
 * reads the shading points; writes the pixels' ao, and on the way the wave. */
lr_status lr_ambient_occlusion(const lr_context *context, const lr_shading_queue *shading_points,
                               lr_wave *wave, lr_film *film);

/* The expected number of samples that the surface which the path has left last took of the light;
 * at the point o. */
LR_INLINE double lr_light_probability(const lr_scene *scene, const lr_path *path,
                                      uint64_t light_index, const double o[3])
{
    const lr_light_tree *light_tree = &scene->light_tree;
    const uint32_t bounces = path->bounces[LR_RAY_CAMERA] - 1u;
    const double n[3] = {path->normal[0], path->normal[1], path->normal[2]};
    if (lr_light_tree_all(light_tree, bounces))
        return 1;
    return lr_light_tree_asked(light_tree, bounces) *
           lr_light_tree_probability(light_tree, light_index, o, n);
}

/* The MIS weight of one of two ways to find the same light: densities p of this one
 * and q of the other. Power heuristic: Veach 1997. */
LR_INLINE double lr_mis(double p, double q)
{
    if (!(p < INFINITY))
        return 1;
    return p > 0 ? 1 / (1 + q / p * (q / p)) : 0;
}

#endif
