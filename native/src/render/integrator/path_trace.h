/* Waves: the paths of a stretch of pixels, one bounce at a time.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PATH_TRACE_H
#define LR_RENDER_INTEGRATOR_PATH_TRACE_H

#include "render/integrator/context.h"

/* Follow the camera's paths, of which there is one in workspace->now for every
 * pixel p < n_pixels with now.n[p] = 1, to their end and add what they bring to
 * workspace->pixels. geometry: write the passes that show what is seen first,
 * pixel 0 at `first`. */
lr_status lr_trace_paths(const lr_job *job, uint32_t n_pixels, uint64_t first, bool geometry);

#endif
