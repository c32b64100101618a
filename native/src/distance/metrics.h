/* The distance transforms behind lr_distance, one file each, in steps of parts.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_DISTANCE_METRICS_H
#define LR_DISTANCE_METRICS_H

#include "base/base.h"

enum { LR_DISTANCE_CAP = 255 };

/* A transform: dist of cells[n[2]][n[1]][n[0]], as for lr_distance. */
typedef struct lr_field {
    const uint8_t *cells;
    int32_t n[3];
    void *dist;
} lr_field;

/* Steps follow one another; the parts of a step may run side by side. A part is
 * short, or checks the stop word itself and returns LR_E_STOPPED. */
typedef struct lr_transform {
    int32_t (*n_steps)(const int32_t n[3]);
    int64_t (*n_parts)(const int32_t n[3], int32_t step);
    lr_status (*part)(const lr_field *f, int32_t step, int64_t part, const lr_watch *watch,
                      lr_error *error);
} lr_transform;

extern const lr_transform lr_distance_chessboard, lr_distance_cityblock, lr_distance_chamfer,
    lr_distance_euclid;

/* For a transform whose last step takes the z axis. */
enum { LR_SLAB = 8 }; /* slices of a part */

LR_INLINE int32_t lr_slabs_of(int32_t n)
{
    return (n - 1) / LR_SLAB + 1;
}

/* Distances along a row of n cells to the nearest that is nonzero. */
LR_INLINE void lr_sweep_row(const uint8_t *cells, uint8_t *dist, int32_t n)
{
    int32_t d = LR_DISTANCE_CAP;
    for (int32_t i = 0; i < n; i++) {
        d = cells[i] != 0 ? 0 : lr_min_i(d + 1, LR_DISTANCE_CAP);
        dist[i] = (uint8_t)d;
    }
    d = LR_DISTANCE_CAP;
    for (int32_t i = n - 1; i >= 0; i--) {
        d = lr_min_i(d + 1, dist[i]);
        dist[i] = (uint8_t)d;
    }
}

/* best[i] = min(best[i], from[i] + cost). */
LR_INLINE void lr_relax_row(uint8_t *best, const uint8_t *from, int64_t n, uint8_t cost)
{
    for (int64_t i = 0; i < n; i++) {
        const uint8_t most = (uint8_t)(LR_DISTANCE_CAP - cost);
        const uint8_t d = (uint8_t)((from[i] < most ? from[i] : most) + cost);
        best[i] = best[i] < d ? best[i] : d;
    }
}

#endif
