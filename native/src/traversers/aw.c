/* One cell at a time.
 *
 * Every cell that the ray pierces is visited, in order; nothing is built. The
 * yardstick for all others.
 *
 * Source: Amanatides and Woo 1987. Departure: t is recomputed at every plane
 * instead of being accumulated, so that it cannot drift.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

lr_status lr_aw_build(const lr_volume *volume, const lr_watch *watch, void **data,
                      uint64_t *nbytes, lr_error *error)
{
    return lr_build_nothing(volume, watch, data, nbytes, error);
}

void lr_aw_free(void *data)
{
    (void)data;
}

LR_INLINE bool one_cell(const void *data, const lr_volume *v, const lr_ray *r, int *state,
                        const int32_t c[3], int32_t lo[3], int32_t hi[3])
{
    (void)data, (void)r, (void)state;
    memcpy(lo, c, 3 * sizeof *lo);
    memcpy(hi, c, 3 * sizeof *hi);
    return lr_wanted(v, c);
}

#define LR_NAME aw
#define LR_BOX one_cell
#include "trace/batch.h"
