/* What the waves of a tile have in common.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_CONTEXT_H
#define LR_RENDER_INTEGRATOR_CONTEXT_H

#include "render/integrator/intersect_closest.h"

typedef struct lr_job {
    const lr_scene *scene;
    lr_workspace *workspace;
    const lr_tile *tile;
    const lr_passes *passes;
    lr_counters *counters;
    const lr_watch *watch;
    lr_error *error;
    uint32_t branches;     /* places of a pixel in the queue */
    uint32_t sample;       /* the one that is on its way */
    uint32_t sample_bits;  /* 2 to that power is the most of a pixel */
    bool last_contributes; /* a ray that is not scattered any more may still find light */
} lr_job;

/* Aim ray i of the wave. */
LR_INLINE void lr_aim(lr_wave *wave, uint32_t i, const double o[3], const double d[3], double t_max)
{
    lr_put_ray(&wave->ray, i, o, d);
    wave->t[i] = t_max;
}

LR_INLINE lr_status lr_cast_wave(const lr_job *job, uint32_t n, const lr_cast_options *options)
{
    return lr_cast(job->scene, job->workspace, n, options, job->counters, job->watch, job->error);
}

/* Add a contribution, which may be negative, to a pixel, and cut it to what the clamps let pass;
 * bounces: of the path behind the surface. */
LR_INLINE void lr_add_light(const lr_job *job, uint32_t pixel, int bounces, double contribution[3])
{
    double *part = job->workspace->pixels[pixel].part[job->sample % LR_PARTS];
    const double limit = 3 * (bounces > 0 ? job->tile->clamp_indirect : job->tile->clamp_direct);
    const double sum = fabs(contribution[0]) + fabs(contribution[1]) + fabs(contribution[2]);
    const double scale = limit > 0 && sum > limit ? limit / sum : 1;
    for (int a = 0; a < 3; a++)
        part[a] += contribution[a] *= scale;
}

#endif
