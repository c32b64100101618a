/* Connects the samples of a brick that lie on one side of the surface.
 *
 * Two neighbours whose distances to the surface add up to more than the distance between them
 * lie on one side of it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_LINK_SAMPLES_H
#define LR_VOXELIZE_LINK_SAMPLES_H

#include "base/base.h"

/* Factor of that distance: more than rounding to f32 and 16 bits can change. */
#define LR_LINK 1.001

/* Connect them: parent[LR_CELLS] makes trees. distance: 0 where a sample links to none, infinity
 * or below beyond the band. */
void lr_link_samples(const float *distance, uint16_t *parent);
uint16_t lr_linked_root(uint16_t *parent, uint16_t sample);

#endif
