/* Entry points for the test of samples along rays, by every instruction set on the same volume.
 * Compiled by tests/core/test_ray_samples.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "light_arrays.h"
#include "trace/ray_samples.h"

LR_API int32_t samples_simd(void)
{
    return lr_cpu_simd();
}

/* rays[6][n]: origins and directions; out[5][n]: t, light, transmittance. phong may be NULL. */
LR_API void samples_run(int32_t simd, const lr_volume *volume, uint64_t n, const double *rays,
                        double step, double stop_opacity, const lr_phong *phong, int32_t normal,
                        double *out)
{
    lr_sample_rays_of *run = LR_BY_SIMD(simd, lr_sample_rays);
    const lr_rays of = rays_of(rays, n);
    const lr_hits hits = hits_of(out, n);
    const lr_trace_options options = {
        .normal = normal, .step = step, .stop_opacity = stop_opacity, .phong = phong};
    lr_counters counters = {0};
    run(volume, NULL, &of, 0, n, &options, &hits, &counters, NULL);
}
