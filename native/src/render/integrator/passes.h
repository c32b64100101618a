/* The passes beside the picture.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PASSES_H
#define LR_RENDER_INTEGRATOR_PASSES_H

#include "render/integrator/context.h"

/* What n pixels from `first` on show where nothing is. */
void lr_write_nothing(const lr_job *job, uint64_t first, uint32_t n);

/* What the camera's rays have hit, in the first n shading points of the wave. */
void lr_write_geometry(const lr_job *job, uint32_t n, uint64_t first);

/* The steps of the first n rays of the wave. */
void lr_write_steps(const lr_job *job, uint32_t n, uint64_t first);

/* Add the mist before a shading point, if the camera sees it. */
void lr_add_mist(const lr_job *job, const lr_shading_point *shading_point);

/* The passes that are sums over samples, of n pixels from `first` on. */
void lr_write_sums(const lr_job *job, uint64_t first, uint32_t n);

#endif
