/* From a hit to the point that is lit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_SURFACE_H
#define LR_SURFACE_H

#include "render/workspace.h"

/* The point that ray i of the wave has hit. Surfaces have two sides; the
 * direction of the ray against the field's own normal tells which one is seen,
 * and the normal is turned to it. */
void lr_surface_find(const lr_scene *scene, const lr_wave *wave, uint32_t i, lr_surfel *surfel);

#endif
