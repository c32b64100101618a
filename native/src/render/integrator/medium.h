/* What rays meet in homogeneous solids: light in closed form, and points that scatter.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_MEDIUM_H
#define LR_RENDER_INTEGRATOR_MEDIUM_H

#include "render/integrator/equiangular.h"
#include "render/integrator/medium_stack.h"

/* What fills the solids that a ray of that visibility is in, added up. False: nothing does. */
bool lr_medium_find(const lr_scene *scene, const lr_medium_stack *in, uint32_t visibility,
                    lr_medium *medium);

/* What a length (0 or more, or infinite) of it adds to a ray, and lets through of what is behind.
 */
void lr_medium_pass(const lr_medium *medium, double length, double color[3], double through[3]);

/* How much of a ray of that throughput it extinguishes, as the mean over what it scatters; 0: it
 * scatters nothing. */
double lr_medium_opacity(const lr_medium *medium, const double throughput[3], double length);

/* The point within the length at which a ray is scattered by the medium of its stack, whose opacity
 * is above 0. u: 0..1. Writes which solid of the stack scatters it, and what that leaves: by the
 * transmittance up to there, and by the opacity, it becomes the weight of the throughput. Returns
 * the distance. */
double lr_medium_draw(const lr_scene *scene, const lr_medium_stack *in, uint32_t visibility,
                      const lr_medium *medium, const double throughput[3], double length,
                      const lr_lamps_beside *lamps, const double u[2], uint32_t *solid,
                      double weight[3]);

#endif
