/* lr_distance: checks, then the transform of the metric.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/metrics.h"
#include "error.h"

static lr_transform *const transforms[] = {
    [LR_METRIC_CHESSBOARD] = lr_distance_chessboard,
    [LR_METRIC_CITYBLOCK] = lr_distance_cityblock,
    [LR_METRIC_CHAMFER345] = lr_distance_chamfer,
    [LR_METRIC_EUCLID] = lr_distance_euclid,
};

lr_status lr_distance(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz, int32_t metric,
                      void *dist, const lr_watch *watch, lr_error *error)
{
    if (metric < LR_METRIC_CHESSBOARD || metric > LR_METRIC_EUCLID)
        return lr_fail(error, LR_E_ARGUMENT,
                       "metric %d is none of chessboard (0), city-block (1), chamfer 3-4-5 (2) "
                       "and Euclid (3)",
                       metric);
    if (nx < 1 || ny < 1 || nz < 1)
        return lr_fail(error, LR_E_ARGUMENT, "a distance needs cells; there are %d x %d x %d", nx,
                       ny, nz);
    return transforms[metric](cells, (const int32_t[3]){nx, ny, nz}, dist, watch, error);
}
