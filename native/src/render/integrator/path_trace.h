/* Waves: the paths of a stretch of pixels, one bounce at a time.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PATH_TRACE_H
#define LR_RENDER_INTEGRATOR_PATH_TRACE_H

#include "render/film/film.h"
#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Follow the camera's paths, of which there is one in queues->now for every pixel p of the film
 * with now.n[p] = 1, to their end and add what they contribute to the film. geometry: write the
 * passes that show what is seen first. */
lr_status lr_trace_paths(const lr_context *context, bool geometry, lr_queues *queues,
                         lr_film *film);

#endif
