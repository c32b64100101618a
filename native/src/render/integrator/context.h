/* What all stages of a tile read. Their data are in the queues (queues.h) and on the film
 * (render/film/film.h); each stage takes those that it needs, const where it only reads.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_CONTEXT_H
#define LR_RENDER_INTEGRATOR_CONTEXT_H

#include "render/scene/scene.h"

typedef struct lr_context {
    const lr_scene *scene;
    const lr_tile *tile;
    bool last_contributes; /* paths at their last bounce may contribute */
    lr_counters *counters; /* the caller's, or NULL, as the others: what stages count, */
    const lr_watch *watch; /* whether they are to stop, */
    lr_error *error;       /* why they failed */
} lr_context;

/* The watch of one of a stage's many calls: it hears that they are to stop, and has no progress to
 * tell. */
LR_INLINE lr_watch lr_stop_of(const lr_context *context)
{
    return (lr_watch){.stop = context->watch != NULL ? context->watch->stop : NULL};
}

#endif
