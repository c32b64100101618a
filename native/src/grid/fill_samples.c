/* Numbers into shared samples: a layer of bricks at a time, or leaf by leaf.
 *
 * Every number is read twice: first for the ranges of the bricks, by which those that take memory
 * are told, then to be stored. A layer's bricks are nobody else's, so that layers may be taken side
 * by side. Rows are looked at and stored as a whole, and cut into bricks while they are near.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "grid/brick_grid.h"
#include "grid/samples.h"

/* Lattice coordinates lo..hi of what brick b holds along an axis of n numbers: of a capped lattice
 * those in it, of an open one those that its border is repeated from, too; lo > hi: none. */
typedef struct span {
    int32_t lo, hi;
    bool beyond; /* the brick reaches beyond the lattice, which is outside there */
} span;

static span span_of(int32_t b, int32_t n, bool open)
{
    const int32_t lo = b * LR_SIDE - LR_PAD, hi = lo + LR_SIDE - 1;
    if (!open)
        return (span){lr_max_i(lo, 0), lr_min_i(hi, n - 1), lo < 0 || hi > n - 1};
    return (span){lr_max_i(0, lr_min_i(lo, n - 1)), lr_max_i(0, lr_min_i(hi, n - 1)), false};
}

/* The part of the numbers that a layer takes. */
typedef struct layer {
    const unsigned char *numbers; /* of slice `first` on */
    int32_t first;
    size_t nbytes; /* of a number */
    span z;
} layer;

/* allocated: whether the samples must be. */
static lr_status layer_of(const lr_samples *s, bool allocated, int32_t part, const void *numbers,
                          layer *l, lr_error *error)
{
    int32_t n_parts, n;
    lr_status status = lr_samples_check_state(s, allocated, error);
    if (status == LR_OK)
        status = lr_samples_part(s, part, &n_parts, &l->first, &n, error);
    if (status != LR_OK)
        return status;
    l->numbers = numbers;
    l->nbytes = lr_number_nbytes(s->desc.number_type);
    l->z = span_of(part, s->desc.nz, s->desc.open != 0);
    return LR_OK;
}

static const void *row_of(const lr_samples *s, const layer *l, int32_t y, int32_t z)
{
    const size_t row = (size_t)(z - l->first) * (size_t)s->desc.ny + (size_t)y;
    return l->numbers + row * (size_t)s->desc.nx * l->nbytes;
}

/* ---- ranges -------------------------------------------------------------- */

/* Of the bricks of row by of a layer. */
static void scan_row(lr_samples *s, const layer *l, int32_t by, int32_t bz, lr_columns *c)
{
    const bool open = s->desc.open != 0;
    const int32_t type = s->desc.number_type;
    const span y = span_of(by, s->desc.ny, open);
    lr_columns_begin(c, type, (size_t)s->desc.nx);
    c->rounds = false;
    for (int32_t k = l->z.lo; k <= l->z.hi; k++)
        for (int32_t j = y.lo; j <= y.hi; j++)
            lr_columns_add(c, type, s->no_data, row_of(s, l, j, k), (size_t)s->desc.nx);
    const bool any = l->z.lo <= l->z.hi && y.lo <= y.hi;
    for (int32_t bx = 0; bx < s->table_size[0]; bx++) {
        const size_t at = lr_place_of(s->table_size, bx, by, bz);
        const span x = span_of(bx, s->desc.nx, open);
        const bool beyond = l->z.beyond || y.beyond || x.beyond;
        bool none = false;
        if (any && x.lo <= x.hi)
            lr_columns_range(c, type, (size_t)x.lo, (size_t)x.hi, &s->low[at], &s->high[at], &none);
        s->none[at] = (uint8_t)((beyond ? LR_NONE_BEYOND : 0) | (none ? LR_NONE_NUMBER : 0));
        s->rounds[at] = c->rounds;
    }
}

lr_status lr_samples_scan(lr_samples *s, int32_t part, const void *numbers, const lr_watch *watch,
                          lr_error *error)
{
    layer l;
    lr_status status = layer_of(s, false, part, numbers, &l, error);
    if (status != LR_OK)
        return status;
    const size_t n = (size_t)s->desc.nx;
    unsigned char *room = malloc(n * (2 * l.nbytes + 1));
    if (room == NULL)
        return lr_fail_memory(error, n * (2 * l.nbytes + 1), "a row of numbers");
    lr_columns c = {.low = room, .high = room + n * l.nbytes, .none = room + 2 * n * l.nbytes};
    for (int32_t by = 0; by < s->table_size[1] && status == LR_OK; by++) {
        scan_row(s, &l, by, part, &c);
        if (lr_stopped(watch))
            status = lr_fail_stopped(error);
    }
    free(room);
    return status;
}

/* ---- samples ------------------------------------------------------------- */

/* Cut a row of samples, the pad before it included, into the bricks of its row. */
static void cut_row(const lr_samples *s, const unsigned char *row, const uint32_t *table,
                    size_t in_brick, size_t nbytes)
{
    const size_t piece = LR_SIDE * nbytes;
    for (int32_t bx = 0; bx < s->table_size[0]; bx++)
        if (table[bx] >> 8 >= LR_FIRST_STORED)
            memcpy(lr_samples_of_brick(s, table[bx] >> 8) + in_brick * nbytes,
                   row + (size_t)bx * piece, piece);
}

/* A row of samples with the pad and what fills its last brick. */
typedef struct padded_row {
    unsigned char *samples, *outside; /* [n] */
    size_t n, nbytes;
    int32_t type;
} padded_row;

/* The pad of an open lattice repeats its border. */
static void repeat_border(padded_row *r, size_t nx)
{
    const double first = lr_load_from(r->samples, r->type, LR_PAD);
    const double last = lr_load_from(r->samples, r->type, LR_PAD + nx - 1);
    for (size_t i = 0; i < LR_PAD; i++)
        lr_store_to(r->samples, r->type, i, first);
    for (size_t i = LR_PAD + nx; i < r->n; i++)
        lr_store_to(r->samples, r->type, i, last);
}

static void fill_row(const lr_samples *s, const layer *l, int32_t by, int32_t bz, padded_row *r)
{
    const bool open = s->desc.open != 0;
    const size_t nx = (size_t)s->desc.nx;
    const uint32_t *table = s->table + lr_place_of(s->table_size, 0, by, bz);
    for (int32_t k = 0; k < LR_SIDE; k++)
        for (int32_t j = 0; j < LR_SIDE; j++) {
            const int32_t z = bz * LR_SIDE + k - LR_PAD, y = by * LR_SIDE + j - LR_PAD;
            const int32_t zin = lr_max_i(0, lr_min_i(z, s->desc.nz - 1));
            const int32_t yin = lr_max_i(0, lr_min_i(y, s->desc.ny - 1));
            const unsigned char *row = r->outside;
            if (open || (z == zin && y == yin)) {
                lr_store_numbers(&s->map, s->desc.number_type, s->no_data, row_of(s, l, yin, zin),
                                 nx, r->samples + LR_PAD * r->nbytes);
                if (open)
                    repeat_border(r, nx);
                row = r->samples;
            }
            cut_row(s, row, table, (size_t)lr_in_brick(0, j, k), r->nbytes);
        }
}

lr_status lr_samples_fill(lr_samples *s, int32_t part, const void *numbers, const lr_watch *watch,
                          lr_error *error)
{
    layer l;
    lr_status status = layer_of(s, true, part, numbers, &l, error);
    if (status != LR_OK)
        return status;
    padded_row r = {.n = (size_t)s->table_size[0] * LR_SIDE,
                    .nbytes = lr_sample_nbytes(s->map.sample_type),
                    .type = s->map.sample_type};
    r.samples = malloc(2 * r.n * r.nbytes);
    if (r.samples == NULL)
        return lr_fail_memory(error, 2 * r.n * r.nbytes, "a row of samples");
    r.outside = r.samples + r.n * r.nbytes;
    for (size_t i = 0; i < 2 * r.n; i++)
        lr_store_to(r.samples, r.type, i, s->map.outside);
    for (int32_t by = 0; by < s->table_size[1] && status == LR_OK; by++) {
        fill_row(s, &l, by, part, &r);
        if (lr_stopped(watch))
            status = lr_fail_stopped(error);
    }
    free(r.samples);
    return status;
}

/* ---- leaves and tiles ---------------------------------------------------- */

/* The brick of a leaf or tile that is size numbers along each axis. */
static lr_status brick_of_leaf(const lr_samples *s, const int32_t origin[3], int32_t size,
                               int32_t b[3], lr_error *error)
{
    bool fits = size > 0 && size % LR_SIDE == 0 && s->desc.open == 0;
    for (int a = 0; a < 3 && fits; a++) {
        const int64_t at = (int64_t)origin[a] + LR_PAD, last = (at + size) / LR_SIDE;
        fits = at >= 0 && at % LR_SIDE == 0 && last <= s->table_size[a];
        b[a] = (int32_t)(at / LR_SIDE);
    }
    return fits ? LR_OK
                : lr_fail(error, LR_E_ARGUMENT,
                          "a leaf of %d numbers at (%d, %d, %d) is none of bricks of the lattice",
                          size, origin[0], origin[1], origin[2]);
}

/* The brick of leaf i, unless the watch says stop. */
static lr_status next_leaf(const lr_samples *s, const int32_t *origins, uint64_t i,
                           const lr_watch *watch, int32_t b[3], lr_error *error)
{
    return lr_stopped_now_and_then(watch, i) ? lr_fail_stopped(error)
                                             : brick_of_leaf(s, origins + 3 * i, LR_SIDE, b, error);
}

lr_status lr_samples_scan_leaves(lr_samples *s, const int32_t *origins, const void *numbers,
                                 uint64_t n, const lr_watch *watch, lr_error *error)
{
    const int32_t type = s->desc.number_type;
    const size_t nbytes = LR_SIDE * lr_number_nbytes(type);
    double low[LR_SIDE], high[LR_SIDE];
    uint8_t outside[LR_SIDE];
    lr_columns c = {.low = low, .high = high, .none = outside};
    lr_status status = lr_samples_check_state(s, false, error);
    for (uint64_t i = 0; i < n && status == LR_OK; i++) {
        int32_t b[3];
        status = next_leaf(s, origins, i, watch, b, error);
        if (status != LR_OK)
            break;
        const size_t at = lr_place_of(s->table_size, b[0], b[1], b[2]);
        const unsigned char *row = (const unsigned char *)numbers + i * LR_SIDE * LR_SIDE * nbytes;
        bool none = false;
        lr_columns_begin(&c, type, LR_SIDE);
        c.rounds = false;
        for (int k = 0; k < LR_SIDE * LR_SIDE; k++)
            lr_columns_add(&c, type, s->no_data, row + (size_t)k * nbytes, LR_SIDE);
        lr_columns_range(&c, type, 0, LR_SIDE - 1, &s->low[at], &s->high[at], &none);
        s->none[at] = none ? LR_NONE_NUMBER : 0;
        s->rounds[at] = c.rounds;
    }
    return status;
}

lr_status lr_samples_fill_leaves(lr_samples *s, const int32_t *origins, const void *numbers,
                                 uint64_t n, const lr_watch *watch, lr_error *error)
{
    const size_t nbytes = LR_CELLS * lr_number_nbytes(s->desc.number_type);
    lr_status status = lr_samples_check_state(s, true, error);
    for (uint64_t i = 0; i < n && status == LR_OK; i++) {
        int32_t b[3];
        status = next_leaf(s, origins, i, watch, b, error);
        if (status != LR_OK)
            break;
        const uint32_t brick = s->table[lr_place_of(s->table_size, b[0], b[1], b[2])] >> 8;
        if (brick >= LR_FIRST_STORED)
            lr_store_numbers(&s->map, s->desc.number_type, s->no_data,
                             (const unsigned char *)numbers + i * nbytes, LR_CELLS,
                             lr_samples_of_brick(s, brick));
    }
    return status;
}

static void put_tile(lr_samples *s, const int32_t b[3], int32_t n, double value)
{
    const bool none = isnan(value) || value == s->no_data;
    for (int32_t z = 0; z < n; z++)
        for (int32_t y = 0; y < n; y++)
            for (int32_t x = 0; x < n; x++) {
                const size_t at = lr_place_of(s->table_size, b[0] + x, b[1] + y, b[2] + z);
                s->none[at] = none ? LR_NONE_NUMBER : 0;
                s->rounds[at] = !none && (double)(float)value != value;
                if (!none)
                    s->low[at] = s->high[at] = value;
            }
}

lr_status lr_samples_put_tiles(lr_samples *s, const int32_t *origins, const int32_t *sizes,
                               const double *values, uint64_t n, const lr_watch *watch,
                               lr_error *error)
{
    lr_status status = lr_samples_check_state(s, false, error);
    for (uint64_t i = 0; i < n && status == LR_OK; i++) {
        int32_t b[3];
        status = lr_stopped(watch) ? lr_fail_stopped(error)
                                   : brick_of_leaf(s, origins + 3 * i, sizes[i], b, error);
        if (status == LR_OK)
            put_tile(s, b, sizes[i] / LR_SIDE, values[i]);
    }
    return status;
}
