/* Points of a volume that scatter light partly as a surface does, whose normal is the gradient.
 *
 * Boundaries within data, where the gradient is large, reflect like surfaces; homogeneous parts,
 * whose gradient is noise, scatter by their phase function. What is scattered is the sum of both,
 * weighted by a share that grows with the gradient.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_GRADIENT_SHADING_H
#define LR_RENDER_BSDF_GRADIENT_SHADING_H

#include "render/bsdf/bsdf.h"
#include "render/bsdf/phase.h"

/* How a volume is shaded by its gradient. */
typedef struct lr_gradient_shading {
    double amount; /* 0..1: of the share that surfaces have */
    double scale;  /* length per value: times the gradient's length, how much of amount it is */
    double roughness, specular; /* of these surfaces, as of lr_lobe */
} lr_gradient_shading;

/* A mirror has no density. */
#define LR_GRADIENT_ROUGHNESS_MIN 0.01

/* At one point. */
typedef struct lr_hybrid {
    lr_phase phase;
    double share;    /* of what is scattered, by a surface; the rest goes by the phase function, */
    double color[3]; /* in this colour, at most 1 */
} lr_hybrid;

/* The share of a point by the length of its gradient. */
double lr_gradient_share(const lr_gradient_shading *shading, double slope);

/* The surface of that colour at a point whose normal (unit) faces the viewer. */
void lr_gradient_surface(const lr_gradient_shading *shading, const double color[3],
                         const lr_point *point, lr_bsdf *surface);

/* The response to light from a direction. view: towards the viewer; surface: not read where share
 * is 0. */
lr_response lr_hybrid_eval(const lr_hybrid *hybrid, const lr_bsdf *surface, const double view[3],
                           const double light[3]);

/* A direction in which light may come, by the phase function or the surface; false where it is
 * lost. u: three numbers in 0..1, 1 not included. */
bool lr_hybrid_sample(const lr_hybrid *hybrid, const lr_bsdf *surface, const double view[3],
                      const double u[3], lr_scatter *scatter);

#endif
