/* Solids that cut instances.
 *
 * Nothing is cut beforehand: a hit on the wrong side of a solid is passed through. So the cut is
 * as exact as the solid's own surface, takes no memory, and may move from frame to frame.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_CLIP_H
#define LR_RENDER_SCENE_CLIP_H

#include "base/base.h"

/* A placed clip. */
typedef struct lr_placed_clip {
    const lr_volume *volume;
    double object_from_world[16];
    double threshold; /* in stored units, margin included */
    bool inside;
} lr_placed_clip;

/* LR_E_ARGUMENT with a sentence that names the instance. */
lr_status lr_clip_place(const lr_clip *clip, uint64_t instance, lr_placed_clip *placed,
                        lr_error *error);

/* Whether a hit at a point of world space counts. leaves: it leaves the instance, for which the
 * margin is nothing: a ray that starts on a face of the cut would meet the surface beside it. */
bool lr_clips_keep(const lr_placed_clip *clips, uint64_t n, const double world[3], bool leaves);

#endif
