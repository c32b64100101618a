/* Shared samples: made, counted, given room.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/samples.h"

#include "base/affine.h"
#include "base/error.h"
#include "base/pages.h"
#include "grid/brick_grid.h"

lr_status lr_samples_begin(const lr_samples_desc *desc, lr_samples **samples, lr_error *error)
{
    double inverse[16];
    const lr_volume_desc volume = {.nx = desc->nx,
                                   .ny = desc->ny,
                                   .nz = desc->nz,
                                   .sample_type = LR_U8,
                                   .kind = LR_KIND_SOLID,
                                   .interpolation = desc->interpolation,
                                   .threshold = 0.5,
                                   .inside = 1.0};
    lr_status status = lr_volume_check(&volume, error);
    if (status == LR_OK)
        status = lr_check_choice("number type", desc->number_type, LR_NUMBER_F64, error);
    if (status != LR_OK)
        return status;
    if (!lr_affine_invert(desc->object_from_index, inverse))
        return lr_fail(error, LR_E_ARGUMENT,
                       "object_from_index must be a finite, invertible, affine 4x4 matrix");
    lr_samples *s = calloc(1, sizeof *s);
    if (s == NULL)
        return lr_fail_memory(error, sizeof *s, "samples");
    s->desc = *desc;
    s->references = 1;
    const bool counts = desc->has_no_data != 0 && lr_is_number(desc->number_type, desc->no_data);
    s->no_data = counts ? desc->no_data : NAN;
    const int32_t n[3] = {desc->nx, desc->ny, desc->nz};
    for (int a = 0; a < 3; a++)
        s->table_size[a] = lr_bricks_along(n[a]);
    const size_t count = lr_samples_count(s);
    s->low = malloc(count * sizeof *s->low);
    s->high = malloc(count * sizeof *s->high);
    s->none = calloc(count, sizeof *s->none);
    s->rounds = calloc(count, sizeof *s->rounds);
    if (s->low == NULL || s->high == NULL || s->none == NULL || s->rounds == NULL) {
        lr_samples_free(s);
        return lr_fail_memory(error, count * (2 * sizeof(double) + 2), "the ranges of bricks");
    }
    for (size_t at = 0; at < count; at++) {
        s->low[at] = INFINITY;
        s->high[at] = -INFINITY;
    }
    *samples = s;
    return LR_OK;
}

lr_samples *lr_samples_share(lr_samples *s)
{
    __atomic_add_fetch(&s->references, 1, __ATOMIC_RELAXED);
    return s;
}

void lr_samples_free(lr_samples *s)
{
    if (s == NULL || __atomic_sub_fetch(&s->references, 1, __ATOMIC_ACQ_REL) > 0)
        return;
    free(s->low);
    free(s->high);
    free(s->none);
    free(s->rounds);
    free(s->table);
    lr_pages_free(s->samples);
    free(s);
}

lr_status lr_samples_check_part(const lr_samples *s, int32_t part, lr_error *error)
{
    if (part < 0 || part >= s->table_size[2])
        return lr_fail(error, LR_E_ARGUMENT, "there is no part %d; there are %d", part,
                       s->table_size[2]);
    return LR_OK;
}

lr_status lr_samples_check_state(const lr_samples *s, bool allocated, lr_error *error)
{
    if ((s->table != NULL) != allocated)
        return lr_fail(error, LR_E_ARGUMENT, "samples are %s allocated",
                       allocated ? "not yet" : "already");
    return LR_OK;
}

lr_status lr_samples_part(const lr_samples *s, int32_t part, int32_t *n_parts, int32_t *first,
                          int32_t *n, lr_error *error)
{
    const lr_status status = lr_samples_check_part(s, part, error);
    if (status != LR_OK)
        return status;
    const int32_t last = s->desc.nz - 1, low = part * LR_SIDE - LR_PAD;
    *n_parts = s->table_size[2];
    *first = lr_max_i(0, lr_min_i(low, last));
    *n = lr_max_i(0, lr_min_i(low + LR_SIDE - 1, last)) - *first + 1;
    return LR_OK;
}

void lr_samples_get_range(const lr_samples *s, lr_samples_range *range)
{
    *range = (lr_samples_range){.low = INFINITY, .high = -INFINITY, .fits_floats = 1};
    for (size_t at = 0, n = lr_samples_count(s); at < n; at++) {
        range->low = fmin(range->low, s->low[at]);
        range->high = fmax(range->high, s->high[at]);
        range->has_none |= (s->none[at] & LR_NONE_NUMBER) != 0;
        range->fits_floats &= !s->rounds[at];
    }
}

/* ---- room ---------------------------------------------------------------- */

static lr_status check_map(const lr_samples *s, const lr_samples_map *m, lr_error *error)
{
    const lr_status status = lr_sample_type_check(m->sample_type, error);
    if (status != LR_OK)
        return status;
    const double numbers[] = {m->gain, m->base, m->outside, m->inside};
    if (!lr_all_finite(numbers, 4) || (m->rounded != 0 && !isfinite(m->threshold)))
        return lr_fail(error, LR_E_ARGUMENT, "a map of numbers must be finite");
    lr_samples_range r;
    lr_samples_get_range(s, &r);
    if (!lr_sample_types[m->sample_type].whole || r.low > r.high)
        return LR_OK;
    const double one = lr_sample_types[m->sample_type].one;
    const double ends[2] = {lr_stored_of(m, r.low), lr_stored_of(m, r.high)};
    for (int e = 0; e < 2; e++)
        if (!(ends[e] >= 0.0 && ends[e] <= one && ends[e] == floor(ends[e])))
            return lr_fail(error, LR_E_ARGUMENT, "numbers in %g..%g do not fit %s as %g..%g", r.low,
                           r.high, lr_sample_types[m->sample_type].name, ends[0], ends[1]);
    return LR_OK;
}

/* Ranges as they are stored; those of numbers that lie outside go down to `outside`. */
static void store_ranges(lr_samples *s)
{
    for (size_t at = 0, n = lr_samples_count(s); at < n; at++) {
        const bool any = s->low[at] <= s->high[at];
        const double a = any ? lr_stored_of(&s->map, s->low[at]) : s->map.outside;
        const double b = any ? lr_stored_of(&s->map, s->high[at]) : s->map.outside;
        const double down = any && !s->none[at] ? INFINITY : s->map.outside;
        s->low[at] = fmin(fmin(a, b), down);
        s->high[at] = fmax(fmax(a, b), s->none[at] ? s->map.outside : -INFINITY);
    }
}

/* The constant brick to which all bricks are alike that the field in the one at b is given by, or
 * LR_FIRST_STORED. */
static uint32_t constant_of(const lr_samples *s, const int32_t b[3])
{
    const size_t at = lr_place_of(s->table_size, b[0], b[1], b[2]);
    const double value = s->low[at];
    const uint32_t brick = value == s->map.outside  ? LR_BRICK_ZERO
                           : value == s->map.inside ? LR_BRICK_ONE
                                                    : LR_FIRST_STORED;
    const bool cubic = s->desc.interpolation == LR_VOLUME_CUBIC;
    bool alike = brick != LR_FIRST_STORED;
    for (int n = 0; n < lr_support_count(cubic) && alike; n++) {
        int32_t to[3];
        lr_support_brick(cubic, n, b, to);
        const bool in = lr_has_brick(s->table_size, to);
        const size_t other = in ? lr_place_of(s->table_size, to[0], to[1], to[2]) : at;
        alike = in ? s->low[other] == value && s->high[other] == value : brick == LR_BRICK_ZERO;
    }
    return alike ? brick : LR_FIRST_STORED;
}

/* Fill a brick with one value. */
static void fill_brick(lr_samples *s, uint32_t brick, double value)
{
    for (size_t i = 0; i < LR_CELLS; i++)
        lr_store_to(lr_samples_of_brick(s, brick), s->map.sample_type, i, value);
}

static uint64_t number_bricks(lr_samples *s)
{
    uint64_t n_bricks = LR_FIRST_STORED;
    int32_t b[3] = {-1, 0, 0};
    for (size_t at = 0; lr_next_brick(s->table_size, b); at++) {
        const uint32_t constant = constant_of(s, b);
        s->table[at] = (constant < LR_FIRST_STORED ? constant : (uint32_t)n_bricks) << 8;
        n_bricks += constant == LR_FIRST_STORED;
    }
    return n_bricks;
}

lr_status lr_samples_allocate(lr_samples *s, const lr_samples_map *map, uint64_t max_nbytes,
                              uint64_t *nbytes, lr_error *error)
{
    lr_status status = lr_samples_check_state(s, false, error);
    if (status == LR_OK)
        status = check_map(s, map, error);
    if (status != LR_OK)
        return status;
    s->map = *map;
    const bool whole = lr_sample_types[map->sample_type].whole;
    s->map.outside = whole ? 0.0 : lr_stored_of(map, map->outside);
    s->map.inside = whole ? lr_sample_types[map->sample_type].one : lr_stored_of(map, map->inside);
    const size_t count = lr_samples_count(s);
    s->table = malloc(count * sizeof *s->table);
    if (s->table == NULL)
        return lr_fail_memory(error, count * sizeof *s->table, "a table of bricks");
    store_ranges(s);
    const uint64_t n_bricks = number_bricks(s);
    const size_t sample = lr_sample_nbytes(map->sample_type);
    *nbytes = n_bricks * (LR_CELLS * sample + sizeof(lr_mask));
    if (n_bricks > LR_MAX_BRICKS)
        return lr_fail(error, LR_E_SIZE,
                       "a volume holds at most %d bricks of 8^3 samples; %llu were wanted",
                       LR_MAX_BRICKS, (unsigned long long)n_bricks);
    if (max_nbytes != 0 && *nbytes > max_nbytes)
        return lr_fail(error, LR_E_MEMORY, "samples take %llu bytes, of which %llu may be taken",
                       (unsigned long long)*nbytes, (unsigned long long)max_nbytes);
    s->samples = lr_pages_new(n_bricks * LR_CELLS, sample);
    if (s->samples == NULL)
        return lr_fail_memory(error, n_bricks * LR_CELLS * sample, "the samples of a volume");
    s->n_bricks = (uint32_t)n_bricks;
    fill_brick(s, LR_BRICK_ZERO, s->map.outside);
    fill_brick(s, LR_BRICK_ONE, s->map.inside);
    for (size_t at = 0; at < count; at++) /* what no numbers are given of */
        if (s->table[at] >> 8 >= LR_FIRST_STORED && s->low[at] == s->high[at])
            fill_brick(s, s->table[at] >> 8, s->low[at]);
    return LR_OK;
}
