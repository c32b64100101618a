/* Waves of light: the surfels of a wave lit by every light and by the world.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_WAVES_H
#define LR_WAVES_H

#include "render/workspace.h"

/* What the waves of a tile have in common. */
typedef struct lr_job {
    const lr_scene *scene;
    lr_workspace *workspace;
    lr_trace_options trace;
    lr_counters *counters;
    const lr_watch *watch;
    lr_error *error;
} lr_job;

/* Add the radiance that the first n surfels send to the viewer in this sample to
 * workspace->sum. The wave is overwritten. */
lr_status lr_light_surfels(const lr_job *job, uint32_t n, uint32_t sample);

#endif
