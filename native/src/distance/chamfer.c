/* Chessboard and chamfer distances: the shortest path of steps to the 26 neighbours.
 *
 * A forward pass takes the minimum over the 13 neighbours before a cell in raster order, a
 * backward pass that over the others. All steps cost 1: the chessboard
 * distance. Steps through a face cost 3, an edge 4, a corner 5: the chamfer distance,
 * a third of which lies within 5.7 % below and 10.6 % above the Euclidean one;
 * divided by sqrt(11) it is never above.
 *
 * Source: Borgefors 1986. Departure: of a pass only the step along the row is taken cell
 * by cell; the twelve others are taken for whole rows.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "distance/metrics.h"

/* The cost of a step, by the number of coordinates that it changes. */
typedef struct costs {
    uint8_t face, edge, corner;
} costs;

/* Relax by another row: by its same cell, and by the cells on both sides. */
LR_INLINE void relax_from(uint8_t *best, const uint8_t *from, int64_t n, uint8_t straight,
                          uint8_t aside)
{
    lr_relax_row(best, from, n, straight);
    lr_relax_row(best + 1, from, n - 1, aside);
    lr_relax_row(best, from + 1, n - 1, aside);
}

/* Sixteen cells of a row, in the order in which they are taken. */
enum { LANES = 16 };
typedef uint8_t lanes __attribute__((vector_size(LANES)));

LR_INLINE lanes least_of(lanes a, lanes b)
{
    const lanes first = (lanes)(a < b);
    return (a & first) | (b & ~first);
}

/* LR_DISTANCE_CAP at most. */
LR_INLINE lanes sum_of(lanes a, lanes b)
{
    const lanes sum = a + b;
    return sum | (lanes)(sum < a);
}

/* The lanes s places before, none before the first. */
#define BEFORE(v, s)                                                                               \
    __builtin_shufflevector(none, v, 16 - (s), 17 - (s), 18 - (s), 19 - (s), 20 - (s), 21 - (s),   \
                            22 - (s), 23 - (s), 24 - (s), 25 - (s), 26 - (s), 27 - (s), 28 - (s),  \
                            29 - (s), 30 - (s), 31 - (s))

LR_INLINE lanes turned(lanes v)
{
    return __builtin_shufflevector(v, v, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
}

/* Relax along the row itself, from its first cell on or from its last one back. Within sixteen
 * cells every path has at most four steps of 1, 2, 4 and 8 cells; paths from the cells before
 * them are taken last. */
LR_INLINE void relax_along(uint8_t *row, int64_t n, int step, uint8_t cost)
{
    const lanes none = (lanes){0} + LR_DISTANCE_CAP, zero = {0};
    const lanes places = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
    const lanes costs_along = places * cost;
    int32_t d = LR_DISTANCE_CAP;
    int64_t i = 0;
    for (; i + LANES <= n; i += LANES) {
        uint8_t *at = step > 0 ? row + i : row + n - LANES - i;
        lanes v;
        memcpy(&v, at, sizeof v);
        v = step > 0 ? v : turned(v);
        v = least_of(v, sum_of(BEFORE(v, 1), zero + cost));
        v = least_of(v, sum_of(BEFORE(v, 2), zero + (uint8_t)(2 * cost)));
        v = least_of(v, sum_of(BEFORE(v, 4), zero + (uint8_t)(4 * cost)));
        v = least_of(v, sum_of(BEFORE(v, 8), zero + (uint8_t)(8 * cost)));
        v = least_of(v, sum_of(costs_along, zero + (uint8_t)d));
        d = v[LANES - 1];
        v = step > 0 ? v : turned(v);
        memcpy(at, &v, sizeof v);
    }
    for (; i < n; i++) {
        uint8_t *cell = step > 0 ? row + i : row + n - 1 - i;
        d = lr_min_i(d + cost, *cell);
        *cell = (uint8_t)d;
    }
}

/* A pass in tiles of TILE slices by TILE rows, each slice's rows one further back than
 * those of the slice before, so that a row's neighbours before it lie in its own tile or
 * in those that precede it: in the same slices one tile back, in the slices before up to
 * one tile ahead. Tile (Z, Y) is of wave Y + 2 Z; tiles of a wave do not depend on
 * each other. */
enum { TILE = 32 };

typedef struct waves {
    int32_t n_y, n_z, count; /* tiles along y and z; waves of a pass */
} waves;

static waves waves_of(const int32_t n[3])
{
    waves w = {(n[1] + TILE - 2) / TILE + 1, (n[2] - 1) / TILE + 1, 0};
    w.count = w.n_y + 2 * (w.n_z - 1);
    return w;
}

/* The slabs of tiles that take part in a wave: Z from the first on. */
static int32_t first_of_wave(const waves *w, int32_t wave)
{
    return lr_max_i(0, (wave - w->n_y + 2) / 2);
}

static int32_t n_steps(const int32_t n[3])
{
    return 2 * waves_of(n).count;
}

static int64_t n_parts(const int32_t n[3], int32_t step)
{
    const waves w = waves_of(n);
    const int32_t wave = step % w.count;
    return lr_min_i(wave / 2, w.n_z - 1) - first_of_wave(&w, wave) + 1;
}

/* Row j of slice k in the order of the pass: forward (step 1) or backward (step -1). */
static void relax(const lr_field *f, const costs *c, int step, int32_t j, int32_t k)
{
    const int64_t row = f->n[0], slice = row * f->n[1];
    const int32_t y = step > 0 ? j : f->n[1] - 1 - j, z = step > 0 ? k : f->n[2] - 1 - k;
    uint8_t *here = (uint8_t *)f->dist + z * slice + y * row;
    if (step > 0) {
        const uint8_t *cells = f->cells + z * slice + y * row;
        for (int64_t i = 0; i < row; i++)
            here[i] = cells[i] != 0 ? 0 : LR_DISTANCE_CAP;
    }
    for (int32_t side = -1; side <= 1 && k > 0; side++)
        if (y + side >= 0 && y + side < f->n[1])
            relax_from(here, here - step * slice + side * row, row, side == 0 ? c->face : c->edge,
                       side == 0 ? c->edge : c->corner);
    if (j > 0)
        relax_from(here, here - step * row, row, c->face, c->edge);
    relax_along(here, row, step, c->face);
}

static lr_status tile(const lr_field *f, const costs *c, int32_t step, int64_t number,
                      const lr_watch *watch, lr_error *error)
{
    const waves w = waves_of(f->n);
    const int32_t wave = step % w.count, direction = step < w.count ? 1 : -1;
    const int32_t z = first_of_wave(&w, wave) + (int32_t)number, y = wave - 2 * z;
    for (int32_t k = 0; k < TILE && z * TILE + k < f->n[2]; k++) {
        const int32_t low = lr_max_i(0, y * TILE - k);
        const int32_t end = lr_min_i(f->n[1], (y + 1) * TILE - k);
        for (int32_t j = low; j < end; j++)
            relax(f, c, direction, j, z * TILE + k);
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
    }
    return LR_OK;
}

static lr_status chessboard_part(const lr_field *f, int32_t step, int64_t number,
                                 const lr_watch *watch, lr_error *error)
{
    static const costs same = {1, 1, 1};
    return tile(f, &same, step, number, watch, error);
}

static lr_status chamfer_part(const lr_field *f, int32_t step, int64_t number,
                              const lr_watch *watch, lr_error *error)
{
    static const costs chamfer = {3, 4, 5};
    return tile(f, &chamfer, step, number, watch, error);
}

const lr_transform lr_distance_chessboard = {n_steps, n_parts, chessboard_part};
const lr_transform lr_distance_chamfer = {n_steps, n_parts, chamfer_part};
