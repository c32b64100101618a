/* The nearest hits of a wave: rays of world space against all instances.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_INTERSECT_CLOSEST_H
#define LR_RENDER_INTEGRATOR_INTERSECT_CLOSEST_H

#include "render/integrator/context.h"
#include "render/integrator/queues.h"

/* Which instances count. */
typedef enum lr_among {
    LR_AMONG_ALL,
    LR_AMONG_OPAQUE, /* those that stop light wherever it meets them */
    LR_AMONG_CLEAR   /* the others */
} lr_among;

typedef struct lr_intersect_options {
    double t_min;
    lr_among among;
    bool any;     /* whether something is hit, not what is first */
    bool leaving; /* rays->from, rays->start and rays->way are set */
    bool steps;   /* count them into hits->hit.steps; not with `any` */
} lr_intersect_options;

/* Reads the rays; writes their hits. Of several hits at the same t that of the lowest instance
 * counts. With `any` only hits->instance tells something. */
lr_status lr_intersect_closest(const lr_context *context, const lr_intersect_options *options,
                               const lr_ray_queue *rays, lr_hit_queue *hits,
                               lr_intersect_memory *memory);

#endif
