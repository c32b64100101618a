/* Entry points for the test of cells side by side, by every instruction set on the same numbers.
 * Compiled by tests/core/test_cell_lanes.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "trace/cell_lanes.h"

LR_API int32_t lanes_simd(void)
{
    return lr_cpu_simd();
}

LR_API uint64_t lanes_nbytes(void)
{
    return sizeof(lr_cell_lanes);
}

/* numbers[8 + 3 + 2 + 1 + 2 + 1 + 2][8]: corners, cells, o, d, t_min and t_max, from, extinction,
 * turn, tolerance and speed; out: lanes_nbytes() of what came. */
LR_API void lanes_run(int32_t simd, const double (*numbers)[LR_CELL_LANES], void *out)
{
    const lr_lanes_ops *ops = simd == LR_SIMD_AVX512 ? &lr_lanes_avx512
                              : simd == LR_SIMD_AVX2 ? &lr_lanes_avx2
                                                     : &lr_lanes_portable;
    lr_cell_lanes k;
    memset(&k, 0, sizeof k);
    memcpy(k.corner, numbers, sizeof k.corner);
    memcpy(k.cell, numbers + 8, sizeof k.cell);
    lr_ray r = {.t_max = numbers[12][1]};
    for (int a = 0; a < 3; a++) {
        r.o[a] = numbers[11][a];
        r.d[a] = numbers[11][3 + a];
        r.s[a] = (r.d[a] > 0.0) - (r.d[a] < 0.0);
        r.inv[a] = r.s[a] != 0 ? 1.0 / r.d[a] : 0.0;
    }
    const lr_lanes_ray ray = {.t_min = numbers[12][0],
                              .t_max = numbers[12][1],
                              .tolerance = numbers[12][2],
                              .speed = numbers[12][3]};
    ops->cubics(&k, &r, &ray);
    memcpy(k.from, numbers + 13, sizeof k.from);
    memcpy(k.extinction, numbers + 14, sizeof k.extinction);
    memcpy(k.turn, numbers + 16, sizeof k.turn);
    ops->light(&k, &ray);
    memcpy(out, &k, sizeof k);
}
