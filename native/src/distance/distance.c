/* lr_distance and its parts: checks, then the transform of the metric.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "distance/metrics.h"

static const lr_transform *const transforms[] = {
    [LR_METRIC_CHESSBOARD] = &lr_distance_chessboard,
    [LR_METRIC_CITYBLOCK] = &lr_distance_cityblock,
    [LR_METRIC_CHAMFER345] = &lr_distance_chamfer,
    [LR_METRIC_EUCLID] = &lr_distance_euclid,
};

static lr_status check(const int32_t n[3], int32_t metric, lr_error *error)
{
    const lr_status status = lr_check_choice("metric", metric, LR_METRIC_EUCLID, error);
    if (status != LR_OK)
        return status;
    if (n[0] < 1 || n[1] < 1 || n[2] < 1)
        return lr_fail(error, LR_E_ARGUMENT, "a distance needs cells; there are %d x %d x %d", n[0],
                       n[1], n[2]);
    if (metric == LR_METRIC_EUCLID &&
        (n[0] > LR_EUCLID_MAX || n[1] > LR_EUCLID_MAX || n[2] > LR_EUCLID_MAX))
        return lr_fail(error, LR_E_SIZE, "Euclidean distances are limited to %d cells a side",
                       LR_EUCLID_MAX);
    return LR_OK;
}

lr_status lr_distance_parts(int32_t nx, int32_t ny, int32_t nz, int32_t metric, int32_t step,
                            int32_t *n_steps, int64_t *n_parts, lr_error *error)
{
    const int32_t n[3] = {nx, ny, nz};
    lr_status status = check(n, metric, error);
    if (status != LR_OK)
        return status;
    *n_steps = transforms[metric]->n_steps(n);
    if (step < 0 || step >= *n_steps)
        return lr_fail(error, LR_E_ARGUMENT, "there is no step %d; there are %d", step, *n_steps);
    *n_parts = transforms[metric]->n_parts(n, step);
    return LR_OK;
}

lr_status lr_distance_part(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz, int32_t metric,
                           int32_t step, int64_t part, void *dist, const lr_watch *watch,
                           lr_error *error)
{
    const lr_field field = {cells, {nx, ny, nz}, dist};
    int32_t n_steps;
    int64_t n_parts;
    lr_status status = lr_distance_parts(nx, ny, nz, metric, step, &n_steps, &n_parts, error);
    if (status == LR_OK && (part < 0 || part >= n_parts))
        return lr_fail(error, LR_E_ARGUMENT, "there is no part %lld; step %d has %lld",
                       (long long)part, step, (long long)n_parts);
    return status == LR_OK ? transforms[metric]->part(&field, step, part, watch, error) : status;
}

lr_status lr_distance(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz, int32_t metric,
                      void *dist, const lr_watch *watch, lr_error *error)
{
    const lr_field field = {cells, {nx, ny, nz}, dist};
    lr_status status = check(field.n, metric, error);
    if (status != LR_OK)
        return status;
    const lr_transform *transform = transforms[metric];
    const int32_t n_steps = transform->n_steps(field.n);
    for (int32_t step = 0; step < n_steps; step++) {
        const int64_t n_parts = transform->n_parts(field.n, step);
        for (int64_t part = 0; part < n_parts; part++) {
            status = lr_stopped(watch) ? lr_fail_stopped(error)
                                       : transform->part(&field, step, part, watch, error);
            if (status != LR_OK)
                return status;
            lr_progress(watch, (step + (part + 1.0) / (double)n_parts) / n_steps);
        }
    }
    return LR_OK;
}
