/* The brick store: room for bricks, and bricks that are opened and moved.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/brick_grid.h"

#include "base/error.h"

uint64_t lr_volume_table_nbytes(const int32_t n[3])
{
    uint64_t count = 1;
    for (int a = 0; a < 3; a++)
        count *= (uint64_t)lr_bricks_along(n[a]);
    return count * sizeof(uint32_t);
}

uint64_t lr_volume_brick_nbytes(int32_t sample_type, bool has_ids)
{
    return LR_CELLS * (lr_sample_nbytes(sample_type) + (has_ids ? sizeof(uint16_t) : 0)) +
           sizeof(lr_mask);
}

lr_status lr_volume_check(const lr_volume_desc *d, lr_error *error)
{
    if (d->nx < 1 || d->ny < 1 || d->nz < 1 || d->nx > LR_MAX_SIDE || d->ny > LR_MAX_SIDE ||
        d->nz > LR_MAX_SIDE)
        return lr_fail(error, LR_E_SIZE,
                       "a volume has 1 to %d samples per axis; %d x %d x %d were wanted",
                       LR_MAX_SIDE, d->nx, d->ny, d->nz);
    lr_status status = lr_sample_type_check(d->sample_type, error);
    if (status != LR_OK)
        return status;
    if (d->kind != LR_KIND_SOLID && d->kind != LR_KIND_SHEET)
        return lr_fail(error, LR_E_ARGUMENT, "kind %d is neither solid (1) nor sheet (2)", d->kind);
    status = lr_check_choice("interpolation", d->interpolation, LR_VOLUME_CUBIC, error);
    if (status != LR_OK)
        return status;
    if (d->interpolation == LR_VOLUME_CUBIC && d->has_ids != 0)
        return lr_fail(error, LR_E_ARGUMENT, "a cubic volume carries no ids");
    const bool whole = lr_sample_types[d->sample_type].whole;
    if (!isfinite(d->outside) || !isfinite(d->inside) ||
        (whole && !(d->outside == 0.0 && d->inside == 1.0)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "outside and inside must be finite, and 0 and 1 of whole numbers; they are "
                       "%g and %g",
                       d->outside, d->inside);
    if (!(d->threshold > d->outside && d->threshold <= d->inside))
        return lr_fail(error, LR_E_ARGUMENT, "threshold must lie in (%g, %g]; it is %g", d->outside,
                       d->inside, d->threshold);
    return LR_OK;
}

lr_status lr_volume_reserve(lr_volume *v, uint64_t n_stored, lr_error *error)
{
    uint64_t wanted = n_stored + LR_FIRST_STORED;
    if (wanted > LR_MAX_BRICKS)
        return lr_fail(error, LR_E_SIZE,
                       "a volume holds at most %d bricks of 8^3 samples; %llu were wanted",
                       LR_MAX_BRICKS - LR_FIRST_STORED, (unsigned long long)n_stored);
    if (wanted <= v->capacity)
        return LR_OK;
    size_t sample_nbytes = LR_CELLS * lr_sample_nbytes(v->desc.sample_type);
    unsigned char *samples = realloc(v->samples, wanted * sample_nbytes);
    if (samples != NULL)
        v->samples = samples;
    lr_mask *cells = realloc(v->cells, wanted * sizeof *cells);
    if (cells != NULL)
        v->cells = cells;
    uint16_t *ids = NULL;
    if (v->desc.has_ids) {
        ids = realloc(v->ids, wanted * LR_CELLS * sizeof *ids);
        if (ids != NULL)
            v->ids = ids;
    }
    uint32_t *block_of = NULL;
    if (v->block_of != NULL) {
        block_of = realloc(v->block_of, wanted * LR_WORDS * sizeof *block_of);
        if (block_of != NULL)
            v->block_of = block_of;
    }
    if (samples == NULL || cells == NULL || (v->desc.has_ids && ids == NULL) ||
        (v->block_of != NULL && block_of == NULL))
        return lr_fail_memory(
            error, wanted * lr_volume_brick_nbytes(v->desc.sample_type, v->desc.has_ids != 0),
            "the bricks of a volume");
    v->capacity = (uint32_t)wanted;
    return LR_OK;
}

void lr_volume_fill_brick(lr_volume *v, uint32_t brick, bool ones)
{
    const size_t at = (size_t)brick * LR_CELLS;
    for (size_t i = 0; i < LR_CELLS; i++)
        lr_store_to(v->samples, v->desc.sample_type, at + i, ones ? v->inside : v->outside);
    if (v->ids != NULL)
        memset(v->ids + at, 0, LR_CELLS * sizeof *v->ids);
    if (v->block_of != NULL)
        memset(v->block_of + LR_WORDS * (size_t)brick, 0, LR_WORDS * sizeof *v->block_of);
    memset(v->cells[brick], 0, sizeof v->cells[brick]);
}

lr_status lr_volume_open_brick(lr_volume *v, size_t at, uint32_t *brick, lr_error *error)
{
    uint32_t present = v->table[at] >> 8;
    if (present < LR_FIRST_STORED) {
        if (v->n_bricks == v->capacity) {
            uint64_t more = (uint64_t)v->capacity + v->capacity / 2 + 64;
            uint64_t most = LR_MAX_BRICKS - LR_FIRST_STORED;
            if (more > most && v->n_bricks < LR_MAX_BRICKS)
                more = most;
            lr_status status = lr_volume_reserve(v, more, error);
            if (status != LR_OK)
                return status;
        }
        lr_volume_fill_brick(v, v->n_bricks, present == LR_BRICK_ONE);
        present = v->n_bricks++;
        v->table[at] = present << 8;
    }
    *brick = present;
    return LR_OK;
}

void lr_volume_move_brick(lr_volume *v, uint32_t to, uint32_t from)
{
    size_t nbytes = LR_CELLS * lr_sample_nbytes(v->desc.sample_type);
    memcpy(v->samples + to * nbytes, v->samples + from * nbytes, nbytes);
    memcpy(v->cells[to], v->cells[from], sizeof v->cells[to]);
    if (v->block_of != NULL)
        memcpy(v->block_of + LR_WORDS * (size_t)to, v->block_of + LR_WORDS * (size_t)from,
               LR_WORDS * sizeof *v->block_of);
    if (v->ids != NULL)
        memcpy(v->ids + (size_t)to * LR_CELLS, v->ids + (size_t)from * LR_CELLS,
               LR_CELLS * sizeof *v->ids);
}

void lr_volume_write_brick(lr_volume *v, uint32_t brick, const float *occupancy,
                           const uint16_t *ids, const uint64_t *touched)
{
    const size_t at = (size_t)brick * LR_CELLS;
    lr_store_occupancies(v->samples, v->desc.sample_type, at, occupancy, LR_CELLS);
    if (v->ids != NULL)
        memcpy(v->ids + at, ids, LR_CELLS * sizeof *ids);
    if (touched != NULL)
        memcpy(v->cells[brick], touched, sizeof(lr_mask));
    else
        memset(v->cells[brick], 0, sizeof(lr_mask));
}

uint32_t lr_volume_enter_brick(lr_volume *v, size_t place, uint32_t brick)
{
    const uint32_t to = v->n_bricks++;
    if (to != brick)
        lr_volume_move_brick(v, to, brick);
    v->table[place] = to << 8;
    return to;
}

void lr_volume_enter_full(lr_volume *v, size_t place)
{
    v->table[place] = LR_BRICK_ONE << 8;
}

void lr_volume_empty_table(lr_volume *v)
{
    memset(v->table, 0, lr_table_count(v) * sizeof *v->table);
}

lr_status lr_volume_touch(lr_volume *v, size_t place, const lr_mask touched, lr_error *error)
{
    uint32_t brick;
    const lr_status status = lr_volume_open_brick(v, place, &brick, error);
    for (int w = 0; w < LR_WORDS && status == LR_OK; w++)
        v->cells[brick][w] |= touched[w];
    return status;
}
