/* Entry points for the test of light along rays, by every instruction set on the same volume.
 * Compiled by tests/core/test_ray_light.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "light_arrays.h"
#include "trace/ray_light.h"

LR_API int32_t light_simd(void)
{
    return lr_cpu_simd();
}

/* rays[8][n]: origins, directions, t_max and, where stops, the transmittances at which they end;
 * out[5][n]: t, light, transmittance. */
LR_API void light_run(int32_t simd, const lr_volume *volume, uint64_t n, const double *rays,
                      int32_t stops, double tolerance, double stop_opacity, double *out)
{
    lr_light_rays_of *run = LR_BY_SIMD(simd, lr_light_rays);
    lr_rays of = rays_of(rays, n);
    of.t_max = rays + 6 * n;
    of.stop = stops ? rays + 7 * n : NULL;
    const lr_hits hits = hits_of(out, n);
    const lr_trace_options options = {.tolerance = tolerance, .stop_opacity = stop_opacity};
    lr_counters counters = {0};
    run(volume, NULL, &of, 0, n, &options, &hits, &counters, NULL);
}
