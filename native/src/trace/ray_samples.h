/* Light of samples at equal steps along rays, classified after interpolation: rays side by side.
 *
 * Sample k of a ray lies at t = k step, in the cell whose half-open cube holds it. It counts where
 * that cell is visible, so that nothing depends on the way there: rays leap over bricks, and over
 * words of bricks, in which nothing is visible, by the masks that every volume has, or farther by a
 * structure's distances.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_RAY_SAMPLES_H
#define LR_TRACE_RAY_SAMPLES_H

#include "distance/narrow_band.h"
#include "trace/ray.h"

/* cubes: NULL, or leaps go by these, which changes no bit. Rays first..end-1 through a regular
 * volume with a transfer function; all instruction sets give the same bits. Looks at the stop word
 * on the way. */
typedef void lr_sample_rays_of(const lr_volume *volume, const lr_empty_cubes *cubes,
                               const lr_rays *rays, uint64_t first, uint64_t end,
                               const lr_trace_options *options, const lr_hits *hits,
                               lr_counters *counters, const lr_watch *watch);

extern lr_sample_rays_of lr_sample_rays_portable, lr_sample_rays_avx2, lr_sample_rays_avx512;

/* By the instructions that the transfer function was told of. */
lr_sample_rays_of lr_sample_rays;

/* Are these for the rays through a volume? */
bool lr_samples_rays(const lr_volume *volume, const lr_trace_options *options);

#endif
