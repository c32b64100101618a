/* Light along rays without steps: rays side by side, each lane with a cell of its own ray.
 *
 * What a ray finds depends on its cells' planes and samples alone, not on its neighbours nor on the
 * way from cell to cell: rays leap over cubes in which nothing is visible by the masks that every
 * volume has, or farther by a structure's distances, with the same bits. A cell that the ray only
 * grazes within rounding counts nothing.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_RAY_LIGHT_H
#define LR_TRACE_RAY_LIGHT_H

#include "trace/ray_samples.h"

/* cubes: NULL, or leaps go by these, which changes no bit. Rays first..end-1 through a regular
 * volume with a transfer function that nothing modulates; all instruction sets give the same bits.
 * Where watch says stop, rays are left as they are. */
typedef lr_sample_rays_of lr_light_rays_of;

extern lr_light_rays_of lr_light_rays_portable, lr_light_rays_avx2, lr_light_rays_avx512;

/* By the instructions that the transfer function was told of. */
lr_light_rays_of lr_light_rays;

/* Are these for the rays through a volume? */
bool lr_lights_rays(const lr_volume *volume, const lr_trace_options *options);

#endif
