/* Exact Euclidean distance, one axis after the other.
 *
 * Squares are kept as integers. Along x they follow from sweeps of the row; along y,
 * then z, the square at i is the least of f(j) + (i - j)^2, the lower envelope of
 * parabolas. Its parabolas are found by comparing their intersections, without a division;
 * then the envelope is evaluated. Columns are processed BLOCK at a time. Slices are
 * independent in the first step, rows of columns in the second.
 *
 * Source: Maurer, Qi and Raghavan 2003; Felzenszwalb and Huttenlocher 2012.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "distance/metrics.h"

enum {
    BLOCK = 16,       /* columns side by side: a cache line of squares */
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

/* Room for the columns of one part. */
typedef struct scratch {
    parabola *envelope;
    int32_t *column;
} scratch;

/* n columns side by side, of m squares that are stride apart; false where stopped. */
static bool lower_columns(int32_t *square, int32_t n, int32_t m, size_t stride, const scratch *s,
                          const lr_watch *watch)
{
    int32_t *column = s->column;
    for (int32_t first = 0; first < n && !lr_stopped(watch); first += BLOCK) {
        const int32_t width = lr_min_i(BLOCK, n - first);
        for (int32_t k = 0; k < m; k++)
            for (int32_t i = 0; i < width; i++)
                column[i * m + k] = square[(size_t)k * stride + (size_t)(first + i)];
        for (int32_t i = 0; i < width; i++)
            lower_column(column + i * m, m, s->envelope);
        for (int32_t k = 0; k < m; k++)
            for (int32_t i = 0; i < width; i++)
                square[(size_t)k * stride + (size_t)(first + i)] = column[i * m + k];
    }
    return !lr_stopped(watch);
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

static bool along_xy(const lr_field *f, int32_t z, const scratch *s, const lr_watch *watch)
{
    const size_t row = (size_t)f->n[0], slice = row * (size_t)f->n[1];
    int32_t *first = (int32_t *)f->dist + (size_t)z * slice;
    for (size_t y = 0; y < (size_t)f->n[1] && !lr_stopped(watch); y++)
        sweep_row(f->cells + (size_t)z * slice + y * row, first + y * row, f->n[0]);
    return lower_columns(first, f->n[0], f->n[1], row, s, watch);
}

static bool along_z(const lr_field *f, int32_t y, const scratch *s, const lr_watch *watch)
{
    const size_t row = (size_t)f->n[0], slice = row * (size_t)f->n[1];
    int32_t *first = (int32_t *)f->dist + (size_t)y * row;
    if (!lower_columns(first, f->n[0], f->n[2], slice, s, watch))
        return false;
    for (size_t z = 0; z < (size_t)f->n[2]; z++)
        to_distances(first + z * slice, row);
    return true;
}

static int32_t n_steps(const int32_t n[3])
{
    (void)n;
    return 2;
}

static int64_t n_parts(const int32_t n[3], int32_t step)
{
    return lr_slabs_of(step == 0 ? n[2] : n[1]);
}

static lr_status part(const lr_field *f, int32_t step, int64_t number, const lr_watch *watch,
                      lr_error *error)
{
    const int32_t n = step == 0 ? f->n[2] : f->n[1], m = step == 0 ? f->n[1] : f->n[2];
    const size_t nbytes = (size_t)m * (sizeof(parabola) + BLOCK * sizeof(int32_t));
    parabola *envelope = malloc(nbytes);
    if (envelope == NULL)
        return lr_fail_memory(error, nbytes, "distances");
    const scratch s = {envelope, (int32_t *)(void *)(envelope + m)};
    const int32_t low = (int32_t)number * LR_SLAB, end = lr_min_i(low + LR_SLAB, n);
    bool done = true;
    for (int32_t i = low; i < end && done; i++)
        done = step == 0 ? along_xy(f, i, &s, watch) : along_z(f, i, &s, watch);
    free(envelope);
    return done ? LR_OK : lr_fail_stopped(error);
}

const lr_transform lr_distance_euclid = {n_steps, n_parts, part};
