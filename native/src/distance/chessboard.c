/* Chessboard distance, one axis after the other.
 *
 * Along x the distance to the nearest marked cell of the row is swept from both
 * ends. Along y, then z, the distance is the minimum over j of max(|j|, distance
 * j rows away); rows are combined as a whole, outwards from j = 1, until no cell
 * of the row can gain any more.
 *
 * Source: Borgefors 1986 for the metric; the separable form follows from it
 * being a maximum over the axes.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "error.h"
#include "base.h"

enum { CAP = 255 };

static void sweep_row(const uint8_t *cells, uint8_t *dist, int32_t n)
{
    int32_t d = CAP;
    for (int32_t i = 0; i < n; i++) {
        d = cells[i] != 0 ? 0 : lr_min_i(d + 1, CAP);
        dist[i] = (uint8_t)d;
    }
    d = CAP;
    for (int32_t i = n - 1; i >= 0; i--) {
        d = lr_min_i(d + 1, dist[i]);
        dist[i] = (uint8_t)d;
    }
}

static void combine_row(uint8_t *best, const uint8_t *other, int32_t n, uint8_t j)
{
    for (int32_t i = 0; i < n; i++) {
        uint8_t d = other[i] > j ? other[i] : j;
        best[i] = best[i] < d ? best[i] : d;
    }
}

static uint8_t largest(const uint8_t *row, int32_t n)
{
    uint8_t m = 0;
    for (int32_t i = 0; i < n; i++)
        m = row[i] > m ? row[i] : m;
    return m;
}

/* One column of m rows of n cells, stride apart, through a copy in spare. */
static void sweep_column(uint8_t *dist, int32_t n, int32_t m, size_t stride, uint8_t *spare)
{
    for (int32_t k = 0; k < m; k++)
        memcpy(spare + (size_t)k * (size_t)n, dist + (size_t)k * stride, (size_t)n);
    for (int32_t k = 0; k < m; k++) {
        uint8_t *best = dist + (size_t)k * stride;
        int32_t reach = lr_min_i(lr_max_i(k, m - 1 - k), CAP - 1);
        for (int32_t j = 1; j <= reach && largest(best, n) > j; j++) {
            if (k - j >= 0)
                combine_row(best, spare + (size_t)(k - j) * (size_t)n, n, (uint8_t)j);
            if (k + j < m)
                combine_row(best, spare + (size_t)(k + j) * (size_t)n, n, (uint8_t)j);
        }
    }
}

lr_status lr_distance(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz, int32_t metric,
                      uint8_t *dist, const lr_watch *watch, lr_error *error)
{
    if (metric != LR_METRIC_CHESSBOARD)
        return lr_fail(error, LR_E_ARGUMENT, "metric %d is not chessboard (0)", metric);
    if (nx < 1 || ny < 1 || nz < 1)
        return lr_fail(error, LR_E_ARGUMENT, "a distance needs cells; there are %d x %d x %d", nx,
                       ny, nz);
    size_t row = (size_t)nx, slice = row * (size_t)ny;
    size_t spare_nbytes = row * (size_t)lr_max_i(ny, nz);
    uint8_t *spare = malloc(spare_nbytes);
    if (spare == NULL)
        return lr_fail_memory(error, spare_nbytes, "distances");
    bool stopped = false;
    for (int32_t z = 0; z < nz && !stopped; z++) {
        uint8_t *first = dist + (size_t)z * slice;
        for (int32_t y = 0; y < ny; y++)
            sweep_row(cells + (size_t)z * slice + (size_t)y * row, first + (size_t)y * row, nx);
        sweep_column(first, nx, ny, row, spare);
        lr_progress(watch, 0.5 * (z + 1) / nz);
        stopped = lr_stopped(watch);
    }
    for (int32_t y = 0; y < ny && !stopped; y++) {
        sweep_column(dist + (size_t)y * row, nx, nz, slice, spare);
        lr_progress(watch, 0.5 + 0.5 * (y + 1) / ny);
        stopped = lr_stopped(watch);
    }
    free(spare);
    return stopped ? lr_fail_stopped(error) : LR_OK;
}
