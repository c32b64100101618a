/* City-block distance, one axis after the other.
 *
 * Along x the distance to the nearest marked cell of the row is swept from both ends;
 * along y and z a row, or a block of columns, is at most one farther than the one beside
 * it, swept from both sides. Slices are independent in the first step, blocks of columns in
 * the second.
 *
 * Source: Rosenfeld and Pfaltz 1966 (two passes). Departure: an axis at a time, so that
 * whole rows are combined at once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "distance/metrics.h"

enum { BLOCK = 16384 }; /* columns along z of a part */

/* n cells of m rows that are stride apart; false where stopped. */
static bool sweep_rows(uint8_t *dist, int64_t n, int64_t m, int64_t stride, const lr_watch *watch)
{
    for (int64_t k = 1; k < m && !lr_stopped(watch); k++)
        lr_relax_row(dist + k * stride, dist + (k - 1) * stride, n, 1);
    for (int64_t k = m - 2; k >= 0 && !lr_stopped(watch); k--)
        lr_relax_row(dist + k * stride, dist + (k + 1) * stride, n, 1);
    return !lr_stopped(watch);
}

static int32_t n_steps(const int32_t n[3])
{
    (void)n;
    return 2;
}

static int64_t n_parts(const int32_t n[3], int32_t step)
{
    return step == 0 ? lr_slabs_of(n[2]) : ((int64_t)n[0] * n[1] - 1) / BLOCK + 1;
}

static bool sweep_slice(const lr_field *f, int32_t z, const lr_watch *watch)
{
    const int64_t row = f->n[0], slice = row * f->n[1];
    uint8_t *dist = (uint8_t *)f->dist + z * slice;
    for (int64_t y = 0; y < f->n[1] && !lr_stopped(watch); y++)
        lr_sweep_row(f->cells + z * slice + y * row, dist + y * row, f->n[0]);
    return sweep_rows(dist, row, f->n[1], row, watch);
}

static lr_status part(const lr_field *f, int32_t step, int64_t number, const lr_watch *watch,
                      lr_error *error)
{
    const int64_t slice = (int64_t)f->n[0] * f->n[1], first = number * BLOCK;
    bool done = true;
    if (step == 1) {
        const int64_t n = slice - first < BLOCK ? slice - first : BLOCK;
        done = sweep_rows((uint8_t *)f->dist + first, n, f->n[2], slice, watch);
    } else {
        const int32_t low = (int32_t)number * LR_SLAB, end = lr_min_i(low + LR_SLAB, f->n[2]);
        for (int32_t z = low; z < end && done; z++)
            done = sweep_slice(f, z, watch);
    }
    return done ? LR_OK : lr_fail_stopped(error);
}

const lr_transform lr_distance_cityblock = {n_steps, n_parts, part};
