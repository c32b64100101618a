/* Places on a ray by the angle that the way to them takes up at the lamps beside it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_EQUIANGULAR_H
#define LR_RENDER_INTEGRATOR_EQUIANGULAR_H

#include "render/integrator/path_state.h"
#include "render/scene/scene.h"

/* A lamp beside a ray. Lengths are counted on the ray, from where it starts. */
typedef struct lr_lamp_beside {
    double nearest;    /* where the ray is nearest to it */
    double away;       /* how far from it that is, with its own extent */
    double begin, end; /* what it may light of the ray */
    double angle;      /* that this takes up at the lamp */
    double chance;     /* that places are drawn by it; all add up to 1 */
} lr_lamp_beside;

typedef struct lr_lamps_beside {
    uint32_t n;
    double share; /* of places that are drawn by them, 0 where there are none */
    lr_lamp_beside lamps[LR_LIGHTS_ALL];
} lr_lamps_beside;

/* The lamps that may light places on a ray of a path, from o along d (unit) up to a length, which
 * may be infinite, in what extinguishes that much. */
void lr_lamps_beside_find(const lr_scene *scene, const lr_path *path, const double o[3],
                          const double d[3], double length, double extinction,
                          lr_lamps_beside *beside);

/* A place by one of the lamps, of which there are some. u: 0..1. */
double lr_lamps_beside_draw(const lr_lamps_beside *beside, double u);

/* The density of such places at t. */
double lr_lamps_beside_pdf(const lr_lamps_beside *beside, double t);

#endif
