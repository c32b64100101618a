/* Samples along rays side by side, by whatever the processor; and which of them to take.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/ray_samples.h"

#include "base/cpu.h"
#include "grid/transfer_function.h"

#define LR_VECTORS     0
#define LR_SAMPLE_RAYS lr_sample_rays_portable

#include "trace/ray_samples_impl.h"

bool lr_samples_rays(const lr_volume *v, const lr_trace_options *options)
{
    return options->mode == LR_MODE_VOLUME && options->sampling == LR_SAMPLING_POST &&
           v->planes[0] == NULL;
}

void lr_sample_rays(const lr_volume *v, const lr_empty_cubes *cubes, const lr_rays *rays,
                    uint64_t first, uint64_t end, const lr_trace_options *options,
                    const lr_hits *hits, lr_counters *counters, const lr_watch *watch)
{
    lr_sample_rays_of *run = LR_BY_SIMD(v->transfer->simd, lr_sample_rays);
    run(v, cubes, rays, first, end, options, hits, counters, watch);
}
