/* Casting a wave: a batch of world-space rays against all instances.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_INTERSECT_CLOSEST_H
#define LR_RENDER_INTEGRATOR_INTERSECT_CLOSEST_H

#include "render/integrator/queues.h"
#include "render/scene/scene.h"

/* Which instances count. */
typedef enum lr_among {
    LR_AMONG_ALL,
    LR_AMONG_OPAQUE, /* those that stop light wherever it meets them */
    LR_AMONG_CLEAR   /* the others */
} lr_among;

typedef struct lr_cast_options {
    double t_min;
    lr_among among;
    bool any;     /* whether something is hit, not what is first */
    bool leaving; /* wave->from and wave->start are set */
    bool steps;   /* count them into wave->hit.steps; not with `any` */
    lr_trace_options trace;
} lr_cast_options;

/* Cast the first n rays of the workspace's wave; ray, visibility and, where they
 * end, t are set. Without `any` the hit of ray i goes to wave->hit[i], wave->t[i]
 * and wave->instance[i]; of several hits at the same t that of the lowest instance.
 * With `any` only wave->instance[i] is set. wave->instance[i] is LR_NOWHERE where
 * nothing is hit. */
lr_status lr_cast(const lr_scene *scene, lr_workspace *workspace, uint32_t n,
                  const lr_cast_options *options, lr_counters *counters, const lr_watch *watch,
                  lr_error *error);

#endif
