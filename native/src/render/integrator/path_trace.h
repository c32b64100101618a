/* Path tracing in waves: all paths of a range of pixels, one bounce at a time.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PATH_TRACE_H
#define LR_RENDER_INTEGRATOR_PATH_TRACE_H

#include "render/film/film.h"
#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Trace the camera's paths, one in queues->now for every pixel p of the film with now.n[p] = 1,
 * and add their contributions to the film. geometry: write the passes of primary hits. */
lr_status lr_trace_paths(const lr_context *context, bool geometry, lr_queues *queues,
                         lr_film *film);

#endif
