/* Direct light: what lights and the world send to surfaces.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H
#define LR_RENDER_INTEGRATOR_DIRECT_LIGHT_H

#include "render/integrator/sampled_light.h"

/* Add to the pixels what the first n shading points send to their viewers of the light
 * that lights and a world of unequal brightness send to them. The wave is
 * overwritten. */
lr_status lr_light_shading_points(const lr_job *job, uint32_t n);

/* Add to the pixels' ao how much of the sky within tile->ao_distance the first n
 * shading points see, which are seen by the camera. The wave is overwritten. */
lr_status lr_ambient_occlusion(const lr_job *job, uint32_t n);

/* How often the surface that the path has left last asked the light; at the point o. */
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

/* The share of one of two ways to find the same light: densities p of this one
 * and q of the other. Power heuristic: Veach 1997. */
LR_INLINE double lr_mis(double p, double q)
{
    if (!(p < INFINITY))
        return 1;
    return p > 0 ? 1 / (1 + q / p * (q / p)) : 0;
}

#endif
