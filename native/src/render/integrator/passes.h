/* The passes beside the combined one.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PASSES_H
#define LR_RENDER_INTEGRATOR_PASSES_H

#include "render/film/film.h"
#include "render/integrator/queues.h"

/* Primary hits: reads the shading points; writes the geometry passes. */
void lr_write_geometry(const lr_scene *scene, const lr_shading_queue *shading_points,
                       lr_film *film);

/* Cells that primary rays visited: reads the wave's paths and hits; writes the steps pass. */
void lr_write_steps(const lr_path *paths, const lr_ray_queue *rays, const lr_hit_queue *hits,
                    lr_film *film);

/* Mist: reads a shading point; writes its pixel's sum. */
void lr_add_mist(const lr_scene *scene, const lr_shading_point *shading_point, lr_film *film);

#endif
