/* Exact Euclidean distance, one axis after the other.
 *
 * Squares are kept as integers. Along x they follow from sweeps of the row; along y,
 * then z, the square at i is the least of f(j) + (i - j)^2, the lower envelope of
 * parabolas. Which of them take part is found by comparing where they meet, without a
 * division; then the envelope is followed. Columns are taken BLOCK at a time.
 *
 * Source: Maurer, Qi and Raghavan 2003; Felzenszwalb and Huttenlocher 2012.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/metrics.h"
#include "error.h"

enum {
    BLOCK = 16,       /* columns side by side: a cache line of squares */
    MAX_SIDE = 26754, /* 3 (MAX_SIDE - 1)^2 fits int32 */
    NONE = INT32_MAX, /* no marked cell so far */
};

static void sweep_row(const uint8_t *cells, int32_t *square, int32_t n)
{
    int32_t last = -1;
    for (int32_t i = 0; i < n; i++) {
        last = cells[i] != 0 ? i : last;
        square[i] = last < 0 ? NONE : i - last;
    }
    last = -1;
    for (int32_t i = n - 1; i >= 0; i--) {
        last = cells[i] != 0 ? i : last;
        const int32_t d = last < 0 ? square[i] : lr_min_i(square[i], last - i);
        square[i] = d == NONE ? NONE : d * d;
    }
}

typedef struct parabola {
    int64_t at, f;
} parabola;

/* Does b lie above the lower envelope of a and c everywhere? a.at < b.at < c.at */
LR_INLINE bool hidden(parabola a, parabola b, parabola c)
{
    const int64_t ab = b.at - a.at, bc = c.at - b.at, ac = c.at - a.at;
    return ac * b.f - bc * a.f - ab * c.f > ab * bc * ac;
}

/* One column of m squares in place; envelope has room for m. */
static void lower_column(int32_t *square, int32_t m, parabola *envelope)
{
    int32_t n = 0;
    for (int32_t i = 0; i < m; i++) {
        if (square[i] == NONE)
            continue;
        const parabola p = {i, square[i]};
        while (n >= 2 && hidden(envelope[n - 2], envelope[n - 1], p))
            n--;
        envelope[n++] = p;
    }
    if (n == 0)
        return;
    int32_t k = 0;
    for (int64_t i = 0; i < m; i++) {
        int64_t least = envelope[k].f + (i - envelope[k].at) * (i - envelope[k].at);
        for (; k + 1 < n; k++) {
            const parabola *p = &envelope[k + 1];
            const int64_t next = p->f + (i - p->at) * (i - p->at);
            if (next > least)
                break;
            least = next;
        }
        square[i] = (int32_t)least;
    }
}

/* n columns side by side, of m squares that are stride apart. */
static void lower_columns(int32_t *square, int32_t n, int32_t m, size_t stride, int32_t *column,
                          parabola *envelope)
{
    for (int32_t first = 0; first < n; first += BLOCK) {
        const int32_t width = lr_min_i(BLOCK, n - first);
        for (int32_t k = 0; k < m; k++)
            for (int32_t i = 0; i < width; i++)
                column[i * m + k] = square[(size_t)k * stride + (size_t)(first + i)];
        for (int32_t i = 0; i < width; i++)
            lower_column(column + i * m, m, envelope);
        for (int32_t k = 0; k < m; k++)
            for (int32_t i = 0; i < width; i++)
                square[(size_t)k * stride + (size_t)(first + i)] = column[i * m + k];
    }
}

static void to_distances(void *squares, size_t n)
{
    const int32_t *square = squares;
    float *dist = squares; /* in place, each entry read before it is written */
    for (size_t i = 0; i < n; i++) {
        const int32_t s = square[i];
        dist[i] = s == NONE ? INFINITY : (float)sqrt((double)s);
    }
}

lr_status lr_distance_euclid(const uint8_t *cells, const int32_t n[3], void *out,
                             const lr_watch *watch, lr_error *error)
{
    const size_t row = (size_t)n[0], slice = row * (size_t)n[1];
    const int32_t longest = lr_max_i(n[1], n[2]);
    if (n[0] > MAX_SIDE || longest > MAX_SIDE)
        return lr_fail(error, LR_E_SIZE, "Euclidean distances are limited to %d cells a side",
                       (int)MAX_SIDE);
    const size_t nbytes = (size_t)longest * (sizeof(parabola) + BLOCK * sizeof(int32_t));
    parabola *envelope = malloc(nbytes);
    if (envelope == NULL)
        return lr_fail_memory(error, nbytes, "distances");
    int32_t *column = (int32_t *)(void *)(envelope + longest), *square = out;
    bool stopped = false;
    for (int32_t z = 0; z < n[2] && !stopped; z++) {
        int32_t *first = square + (size_t)z * slice;
        for (size_t y = 0; y < (size_t)n[1]; y++)
            sweep_row(cells + (size_t)z * slice + y * row, first + y * row, n[0]);
        lower_columns(first, n[0], n[1], row, column, envelope);
        lr_progress(watch, 0.5 * (z + 1) / n[2]);
        stopped = lr_stopped(watch);
    }
    for (int32_t y = 0; y < n[1] && !stopped; y++) {
        lower_columns(square + (size_t)y * row, n[0], n[2], slice, column, envelope);
        lr_progress(watch, 0.5 + 0.5 * (y + 1) / n[1]);
        stopped = lr_stopped(watch);
    }
    free(envelope);
    if (stopped)
        return lr_fail_stopped(error);
    to_distances(out, slice * (size_t)n[2]);
    return LR_OK;
}
