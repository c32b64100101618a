/* Entry points for the test of light along rays, by every instruction set on the same volume.
 * Compiled by tests/core/test_ray_light.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
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
    lr_light_rays_of *run = simd == LR_SIMD_AVX512 ? lr_light_rays_avx512
                            : simd == LR_SIMD_AVX2 ? lr_light_rays_avx2
                                                   : lr_light_rays_portable;
    const lr_rays of = {.ox = rays,
                        .oy = rays + n,
                        .oz = rays + 2 * n,
                        .dx = rays + 3 * n,
                        .dy = rays + 4 * n,
                        .dz = rays + 5 * n,
                        .t_max = rays + 6 * n,
                        .stop = stops ? rays + 7 * n : NULL};
    const lr_hits hits = {.t = out,
                          .red = out + n,
                          .green = out + 2 * n,
                          .blue = out + 3 * n,
                          .transmittance = out + 4 * n};
    const lr_trace_options options = {.tolerance = tolerance, .stop_opacity = stop_opacity};
    lr_counters counters = {0};
    run(volume, NULL, &of, 0, n, &options, &hits, &counters, NULL);
}
