/* City-block distance, one axis after the other.
 *
 * Along x the distance to the nearest marked cell of the row is swept from both ends;
 * along y and z a row, or a slice, is at most one farther than the one beside it, swept
 * from both sides.
 *
 * Source: Rosenfeld and Pfaltz 1966 (two passes). Departure: an axis at a time, so that
 * whole rows are combined at once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/metrics.h"
#include "error.h"

enum { BLOCK = 4096 }; /* columns along z side by side */

/* n cells of m rows that are stride apart. */
static void sweep_rows(uint8_t *dist, int64_t n, int64_t m, int64_t stride)
{
    for (int64_t k = 1; k < m; k++)
        lr_relax_row(dist + k * stride, dist + (k - 1) * stride, n, 1);
    for (int64_t k = m - 2; k >= 0; k--)
        lr_relax_row(dist + k * stride, dist + (k + 1) * stride, n, 1);
}

lr_status lr_distance_cityblock(const uint8_t *cells, const int32_t n[3], void *out,
                                const lr_watch *watch, lr_error *error)
{
    const size_t row = (size_t)n[0], slice = row * (size_t)n[1];
    uint8_t *dist = out;
    for (int32_t z = 0; z < n[2]; z++) {
        const size_t at = (size_t)z * slice;
        for (size_t y = 0; y < (size_t)n[1]; y++)
            lr_sweep_row(cells + at + y * row, dist + at + y * row, n[0]);
        sweep_rows(dist + at, n[0], n[1], n[0]);
        lr_progress(watch, 0.7 * (z + 1) / n[2]);
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
    }
    for (size_t at = 0; at < slice; at += BLOCK) {
        sweep_rows(dist + at, (int64_t)(slice - at < BLOCK ? slice - at : BLOCK), n[2],
                   (int64_t)slice);
        lr_progress(watch, 0.7 + 0.3 * (double)at / (double)slice);
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
    }
    return LR_OK;
}
