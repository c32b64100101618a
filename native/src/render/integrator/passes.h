/* The passes beside the picture.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PASSES_H
#define LR_RENDER_INTEGRATOR_PASSES_H

#include "render/film/film.h"
#include "render/integrator/queues.h"

/* What the camera's rays have hit: reads the shading points; writes the geometry passes. */
void lr_write_geometry(const lr_scene *scene, const lr_shading_queue *shading_points,
                       lr_film *film);

/* How many cells they visited: reads the wave's paths and hits; writes the steps pass. */
void lr_write_steps(const lr_path *paths, const lr_ray_queue *rays, const lr_hit_queue *hits,
                    lr_film *film);

/* The mist before what the camera sees: reads a shading point; writes its pixel's sum. */
void lr_add_mist(const lr_scene *scene, const lr_shading_point *shading_point, lr_film *film);

#endif
