/* Phase functions: into which directions a point of a volume scatters light.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_PHASE_H
#define LR_RENDER_BSDF_PHASE_H

#include "render/bsdf/bsdf.h"

/* The response to light from a direction, of albedo 1. view: towards the viewer; both unit. */
lr_response lr_phase_eval(lr_phase phase, const double view[3], const double light[3]);

/* A direction in which light may come, with the density of that response. u: 0..1. */
lr_scatter lr_phase_sample(lr_phase phase, const double view[3], const double u[2]);

#endif
