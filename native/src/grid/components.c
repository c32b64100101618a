/* Components of the samples inside that are small: islands.
 *
 * Rows are cut into runs; runs of neighbouring rows that touch, at corners too, are joined. Samples
 * that share a cell are then of one component, so that a surface cell belongs to one alone.
 *
 * Source: He, Chao, Suzuki, A run-based two-scan labeling algorithm, 2008.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "base/union_find.h"
#include "grid/brick_grid.h"

typedef struct run {
    uint32_t parent;
    int32_t first, last; /* samples along x */
    uint64_t n;          /* of a root: samples of the component */
} run;

typedef struct runs {
    const uint8_t *inside;
    int32_t n[3];
    uint64_t *start; /* [ny nz + 1]: the first run of each row */
    run *run;
} runs;

/* The next run of a row from x on; false: there is none. */
static bool next_run(const uint8_t *row, int32_t n, int32_t x, run *r)
{
    while (x < n && row[x] == 0)
        x++;
    r->first = x;
    while (x < n && row[x] != 0)
        x++;
    r->last = x - 1;
    return r->first < n;
}

static bool count_runs(runs *s, const lr_watch *watch)
{
    uint64_t count = 0;
    const uint64_t n_rows = (uint64_t)s->n[1] * (uint64_t)s->n[2];
    for (uint64_t row = 0; row < n_rows; row++) {
        run r = {.last = -1};
        s->start[row] = count;
        while (next_run(s->inside + row * (uint64_t)s->n[0], s->n[0], r.last + 1, &r))
            count++;
        if (lr_stopped_now_and_then(watch, row))
            return false;
    }
    s->start[n_rows] = count;
    return true;
}

static void join(runs *s, uint32_t i, uint32_t j)
{
    const uint32_t a = lr_root_of(&s->run->parent, sizeof(run), i);
    const uint32_t b = lr_root_of(&s->run->parent, sizeof(run), j);
    if (a == b)
        return;
    s->run[a < b ? b : a].parent = a < b ? a : b;
    s->run[a < b ? a : b].n += s->run[a < b ? b : a].n;
}

/* Join the runs of a row with those of one before it. */
static void join_rows(runs *s, uint64_t row, uint64_t before)
{
    uint64_t j = s->start[before];
    for (uint64_t i = s->start[row]; i < s->start[row + 1]; i++) {
        while (j < s->start[before + 1] && s->run[j].last + 1 < s->run[i].first)
            j++;
        for (uint64_t k = j; k < s->start[before + 1] && s->run[k].first <= s->run[i].last + 1; k++)
            join(s, (uint32_t)i, (uint32_t)k);
    }
}

static bool join_runs(runs *s, const lr_watch *watch)
{
    for (int32_t z = 0; z < s->n[2]; z++)
        for (int32_t y = 0; y < s->n[1]; y++) {
            const uint64_t row = (uint64_t)z * (uint64_t)s->n[1] + (uint64_t)y;
            run r = {.last = -1};
            for (uint64_t i = s->start[row]; i < s->start[row + 1]; i++) {
                next_run(s->inside + row * (uint64_t)s->n[0], s->n[0], r.last + 1, &r);
                s->run[i] = (run){(uint32_t)i, r.first, r.last, (uint64_t)(r.last - r.first + 1)};
            }
            if (y > 0)
                join_rows(s, row, row - 1);
            for (int32_t side = -1; side <= 1 && z > 0; side++)
                if (y + side >= 0 && y + side < s->n[1])
                    join_rows(s, row, row - (uint64_t)s->n[1] + (uint64_t)(int64_t)side);
            if (y == 0 && lr_stopped(watch))
                return false;
        }
    return true;
}

static void mark_small(runs *s, uint64_t least, uint8_t *small)
{
    const uint64_t n_rows = (uint64_t)s->n[1] * (uint64_t)s->n[2];
    memset(small, 0, n_rows * (uint64_t)s->n[0]);
    for (uint64_t row = 0; row < n_rows; row++)
        for (uint64_t i = s->start[row]; i < s->start[row + 1]; i++)
            if (s->run[lr_root_of(&s->run->parent, sizeof(run), (uint32_t)i)].n < least)
                memset(small + row * (uint64_t)s->n[0] + s->run[i].first, 1,
                       (size_t)(s->run[i].last - s->run[i].first + 1));
}

lr_status lr_small_components(const uint8_t *inside, int32_t nx, int32_t ny, int32_t nz,
                              uint64_t least, uint8_t *small, const lr_watch *watch,
                              lr_error *error)
{
    if (nx < 1 || ny < 1 || nz < 1 || nx > LR_MAX_SIDE || ny > LR_MAX_SIDE || nz > LR_MAX_SIDE)
        return lr_fail(error, LR_E_ARGUMENT,
                       "components are of 1 to %d samples per axis; there are %d x %d x %d",
                       LR_MAX_SIDE, nx, ny, nz);
    runs s = {.inside = inside, .n = {nx, ny, nz}};
    const uint64_t nbytes = ((uint64_t)ny * (uint64_t)nz + 1) * sizeof *s.start;
    s.start = malloc(nbytes);
    if (s.start == NULL)
        return lr_fail_memory(error, nbytes, "the rows of a lattice");
    lr_status status = count_runs(&s, watch) ? LR_OK : lr_fail_stopped(error);
    const uint64_t n = status == LR_OK ? s.start[(uint64_t)ny * (uint64_t)nz] : 0;
    if (n > UINT32_MAX)
        status = lr_fail(error, LR_E_SIZE, "components of %llu runs of samples; %u are possible",
                         (unsigned long long)n, UINT32_MAX);
    if (status == LR_OK) {
        s.run = malloc((n + 1) * sizeof *s.run);
        if (s.run == NULL)
            status = lr_fail_memory(error, (n + 1) * sizeof *s.run, "runs of samples");
    }
    if (status == LR_OK && !join_runs(&s, watch))
        status = lr_fail_stopped(error);
    if (status == LR_OK)
        mark_small(&s, least, small);
    free(s.run);
    free(s.start);
    return status;
}
