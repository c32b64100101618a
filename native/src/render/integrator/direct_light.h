/* Direct light at surfaces and in volumes, from lights and the world.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H
#define LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H

#include "render/film/film.h"
#include "render/integrator/context.h"
#include "render/integrator/queues.h"
#include "render/integrator/sampled_light.h"

/* Add the direct light of shading points, from lights and from a world that is not of one color:
 * reads the shading points; writes the pixels' sums. Uses shadow rays and the wave. */
lr_status lr_light_shading_points(const lr_context *context, const lr_shading_queue *shading_points,
                                  lr_shadow_queue *shadow_rays, lr_wave *wave, lr_film *film);

/* Add the ambient occlusion of primary hits, up to tile->ao_distance: reads the shading points;
 * writes the pixels' ao. Uses the wave. */
lr_status lr_ambient_occlusion(const lr_context *context, const lr_shading_queue *shading_points,
                               lr_wave *wave, lr_film *film);

/* The expected number of samples of the light where the path was scattered last, at o. */
LR_INLINE double lr_light_probability(const lr_scene *scene, const lr_path *path,
                                      uint64_t light_index, const double o[3])
{
    const lr_light_tree *light_tree = &scene->light_tree;
    const uint32_t bounces = path->bounces[LR_RAY_CAMERA] - 1u;
    const double n[3] = {path->normal[0], path->normal[1], path->normal[2]};
    if (lr_light_tree_all(light_tree, bounces))
        return 1;
    return lr_light_tree_n_samples(light_tree, bounces) *
           lr_light_tree_probability(light_tree, light_index, o, n);
}

/* The MIS weight of one of two techniques: p is its density, q that of the other. Power
 * heuristic: Veach 1997. */
LR_INLINE double lr_mis(double p, double q)
{
    if (!(p < INFINITY))
        return 1;
    return p > 0 ? 1 / (1 + q / p * (q / p)) : 0;
}

#endif
