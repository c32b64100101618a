/* Volumes as callers know them: made, filled and read block by block.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/affine.h"
#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/objects.h"
#include "grid/triangle_cells.h"

/* ---- making ------------------------------------------------------------ */

lr_status lr_volume_begin(const lr_volume_desc *desc, lr_volume **volume, lr_error *error)
{
    lr_status status = lr_volume_check(desc, error);
    if (status != LR_OK)
        return status;
    double storage_from_object[16];
    if (!lr_affine_invert(desc->object_from_index, storage_from_object))
        return lr_fail(error, LR_E_ARGUMENT,
                       "object_from_index must be a finite, invertible, affine 4x4 matrix");
    const int32_t n[3] = {desc->nx, desc->ny, desc->nz};
    uint64_t table_nbytes = lr_volume_table_nbytes(n);
    lr_volume *v = calloc(1, sizeof *v);
    if (v == NULL)
        return lr_fail_memory(error, sizeof *v, "a volume");
    v->desc = *desc;
    v->table = calloc(table_nbytes, 1);
    if (v->table == NULL) {
        lr_volume_free(v);
        return lr_fail_memory(error, table_nbytes, "the brick table of a volume");
    }
    for (int a = 0; a < 3; a++)
        v->table_size[a] = lr_bricks_along(n[a]);
    for (int a = 0; a < 3; a++)
        storage_from_object[4 * a + 3] += LR_PAD;
    memcpy(v->storage_from_object, storage_from_object, sizeof storage_from_object);
    const double shift[16] = {1, 0, 0, -LR_PAD, 0, 1, 0, -LR_PAD, 0, 0, 1, -LR_PAD, 0, 0, 0, 1};
    lr_affine_multiply(desc->object_from_index, shift, v->object_from_storage);
    v->one = lr_sample_types[desc->sample_type].one;
    v->threshold = desc->threshold * v->one;
    v->outside = desc->outside * v->one;
    v->inside = desc->inside * v->one;
    status = lr_volume_reserve(v, 0, error);
    if (status != LR_OK) {
        lr_volume_free(v);
        return status;
    }
    lr_volume_fill_brick(v, LR_BRICK_ZERO, false);
    lr_volume_fill_brick(v, LR_BRICK_ONE, true);
    v->n_bricks = LR_FIRST_STORED;
    *volume = v;
    return LR_OK;
}

void lr_volume_free(lr_volume *v)
{
    if (v == NULL)
        return;
    free(v->planes[0]);
    free(v->table);
    if (v->shared == NULL)
        free(v->samples);
    lr_samples_free(v->shared);
    free(v->parts);
    free(v->ids);
    free(v->cells);
    free(v->block_of);
    free(v->nearest_triangle);
    lr_triangle_attributes_free(v->faces);
    lr_triangle_cells_free(v->triangle_cells);
    lr_objects_free(v->objects);
    lr_transfer_free(v->transfer);
    free(v);
}

/* ---- filling and reading blocks ---------------------------------------- */

/* The part of a block that lies in one brick. */
typedef struct part {
    int32_t brick[3]; /* position in the table */
    int32_t lo[3];    /* storage coordinates of its first sample */
    int32_t size[3];
    size_t from; /* of its first sample in the block */
} part;

static part part_of(const int32_t first[3], const int32_t size[3], const int32_t brick[3])
{
    part p;
    size_t from[3];
    for (int a = 0; a < 3; a++) {
        p.brick[a] = brick[a];
        p.lo[a] = lr_max_i(first[a], brick[a] * LR_SIDE);
        p.size[a] = lr_min_i(first[a] + size[a], (brick[a] + 1) * LR_SIDE) - p.lo[a];
        from[a] = (size_t)(p.lo[a] - first[a]);
    }
    p.from = (from[2] * (size_t)size[1] + from[1]) * (size_t)size[0] + from[0];
    return p;
}

LR_INLINE size_t in_brick(const part *p, int j, int k)
{
    return (size_t)lr_in_brick(p->lo[0], p->lo[1] + j, p->lo[2] + k);
}

LR_INLINE size_t in_block(const part *p, const int32_t size[3], int j, int k)
{
    return p->from + ((size_t)k * (size_t)size[1] + (size_t)j) * (size_t)size[0];
}

static bool any_nonzero(const part *p, const int32_t size[3], const unsigned char *block,
                        size_t nbytes)
{
    if (block == NULL)
        return false;
    for (int k = 0; k < p->size[2]; k++)
        for (int j = 0; j < p->size[1]; j++) {
            const unsigned char *row = block + in_block(p, size, j, k) * nbytes;
            for (size_t b = 0; b < (size_t)p->size[0] * nbytes; b++)
                if (row[b] != 0)
                    return true;
        }
    return false;
}

static void put_rows(const part *p, const int32_t size[3], const void *block, void *brick,
                     size_t nbytes)
{
    for (int k = 0; k < p->size[2]; k++)
        for (int j = 0; j < p->size[1]; j++)
            memcpy((unsigned char *)brick + in_brick(p, j, k) * nbytes,
                   (const unsigned char *)block + in_block(p, size, j, k) * nbytes,
                   (size_t)p->size[0] * nbytes);
}

static void get_rows(const part *p, const int32_t size[3], void *block, const void *brick,
                     size_t nbytes)
{
    for (int k = 0; k < p->size[2]; k++)
        for (int j = 0; j < p->size[1]; j++)
            memcpy((unsigned char *)block + in_block(p, size, j, k) * nbytes,
                   (const unsigned char *)brick + in_brick(p, j, k) * nbytes,
                   (size_t)p->size[0] * nbytes);
}

/* Touched cells of a sheet; NULL in block: all. */
static void put_touched(lr_volume *v, const part *p, const int32_t size[3], const uint8_t *block,
                        uint32_t brick)
{
    for (int k = 0; k < p->size[2]; k++)
        for (int j = 0; j < p->size[1]; j++)
            for (int i = 0; i < p->size[0]; i++) {
                if (block != NULL && block[in_block(p, size, j, k) + (size_t)i] == 0)
                    continue;
                int32_t x = p->lo[0] + i, y = p->lo[1] + j, z = p->lo[2] + k;
                lr_mask_add(v->cells[brick], x, y, z);
            }
}

static lr_status put_part(lr_volume *v, const part *p, const int32_t size[3], const void *samples,
                          const uint16_t *ids, const uint8_t *touched, lr_error *error)
{
    size_t nbytes = lr_sample_nbytes(v->desc.sample_type);
    bool sheet = v->desc.kind == LR_KIND_SHEET;
    size_t at = lr_table_at(v, p->brick[0], p->brick[1], p->brick[2]);
    bool needed = v->table[at] >> 8 != LR_BRICK_ZERO || v->outside != 0.0 ||
                  any_nonzero(p, size, samples, nbytes) ||
                  (v->desc.has_ids && any_nonzero(p, size, (const void *)ids, sizeof *ids)) ||
                  (sheet && (touched == NULL || any_nonzero(p, size, touched, 1)));
    if (!needed)
        return LR_OK;
    uint32_t brick;
    lr_status status = lr_volume_open_brick(v, at, &brick, error);
    if (status != LR_OK)
        return status;
    size_t first = (size_t)brick * LR_CELLS;
    put_rows(p, size, samples, v->samples + first * nbytes, nbytes);
    if (v->desc.has_ids && ids != NULL)
        put_rows(p, size, ids, v->ids + first, sizeof *ids);
    if (sheet)
        put_touched(v, p, size, touched, brick);
    return LR_OK;
}

static lr_status check_finite(int32_t type, const int32_t size[3], const void *samples,
                              lr_error *error)
{
    const size_t nx = (size_t)size[0], ny = (size_t)size[1], n = nx * ny * (size_t)size[2];
    const size_t i = lr_first_not_finite(samples, type, n);
    if (i == n)
        return LR_OK;
    return lr_fail(error, LR_E_ARGUMENT,
                   "samples must be finite; sample (%zu, %zu, %zu) of the block is %g", i % nx,
                   i / nx % ny, i / nx / ny, lr_load_from(samples, type, i));
}

lr_status lr_volume_put(lr_volume *v, const int32_t origin[3], const int32_t size[3],
                        const void *samples, const uint16_t *ids, const uint8_t *touched,
                        lr_error *error)
{
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    if (v->finished || v->shared != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a finished volume, or an isosurface, takes no more samples");
    for (int a = 0; a < 3; a++)
        if (origin[a] < 0 || size[a] < 0 || size[a] > n[a] || origin[a] > n[a] - size[a])
            return lr_fail(error, LR_E_ARGUMENT,
                           "the block leaves the lattice along %c: it has %d samples from %d on, "
                           "the lattice %d",
                           "xyz"[a], size[a], origin[a], n[a]);
    if (size[0] == 0 || size[1] == 0 || size[2] == 0)
        return LR_OK;
    lr_status status = check_finite(v->desc.sample_type, size, samples, error);
    if (status != LR_OK)
        return status;
    int32_t first[3], b0[3], b1[3];
    for (int a = 0; a < 3; a++) {
        first[a] = origin[a] + LR_PAD;
        b0[a] = lr_brick_of(first[a]);
        b1[a] = lr_brick_of(first[a] + size[a] - 1);
    }
    for (int32_t z = b0[2]; z <= b1[2]; z++)
        for (int32_t y = b0[1]; y <= b1[1]; y++)
            for (int32_t x = b0[0]; x <= b1[0]; x++) {
                part p = part_of(first, size, (const int32_t[3]){x, y, z});
                status = put_part(v, &p, size, samples, ids, touched, error);
                if (status != LR_OK)
                    return status;
            }
    return LR_OK;
}

static void get_surface(const lr_volume *v, const part *p, const int32_t size[3], uint8_t *block,
                        uint32_t brick)
{
    for (int k = 0; k < p->size[2]; k++)
        for (int j = 0; j < p->size[1]; j++)
            for (int i = 0; i < p->size[0]; i++) {
                int32_t x = p->lo[0] + i, y = p->lo[1] + j, z = p->lo[2] + k;
                const bool exact =
                    v->triangle_cells != NULL &&
                    lr_triangle_cell_word(v, brick, lr_word_of(x, y, z)) >> lr_bit_of(x, y, z) & 1;
                block[in_block(p, size, j, k) + (size_t)i] =
                    lr_mask_has(v->cells[brick], x, y, z) + exact;
            }
}

lr_status lr_volume_get(const lr_volume *v, const int32_t origin[3], const int32_t size[3],
                        void *samples, uint16_t *ids, uint8_t *surface, lr_error *error)
{
    size_t count = 1;
    int32_t first[3], b0[3], b1[3];
    for (int a = 0; a < 3; a++) {
        if (size[a] < 0 || origin[a] < -LR_MAX_SIDE || origin[a] > 2 * LR_MAX_SIDE ||
            size[a] > 2 * LR_MAX_SIDE)
            return lr_fail(error, LR_E_ARGUMENT, "block of %d samples from %d on along %c", size[a],
                           origin[a], "xyz"[a]);
        count *= (size_t)size[a];
        first[a] = origin[a] + LR_PAD;
        b0[a] = lr_max_i(lr_brick_of(first[a]), 0);
        b1[a] = lr_min_i(lr_brick_of(first[a] + size[a] - 1), v->table_size[a] - 1);
    }
    if (count == 0)
        return LR_OK;
    size_t nbytes = lr_sample_nbytes(v->desc.sample_type);
    if (samples != NULL)
        memset(samples, 0, count * nbytes);
    for (size_t i = 0; i < count && samples != NULL && v->outside != 0.0; i++)
        lr_store_to(samples, v->desc.sample_type, i, v->outside);
    if (ids != NULL)
        memset(ids, 0, count * sizeof *ids);
    if (surface != NULL)
        memset(surface, 0, count);
    for (int32_t z = b0[2]; z <= b1[2]; z++)
        for (int32_t y = b0[1]; y <= b1[1]; y++)
            for (int32_t x = b0[0]; x <= b1[0]; x++) {
                part p = part_of(first, size, (const int32_t[3]){x, y, z});
                uint32_t brick = v->table[lr_table_at(v, x, y, z)] >> 8;
                size_t at = (size_t)brick * LR_CELLS;
                if (samples != NULL)
                    get_rows(&p, size, samples, v->samples + at * nbytes, nbytes);
                if (ids != NULL && v->ids != NULL)
                    get_rows(&p, size, ids, v->ids + at, sizeof *ids);
                if (surface != NULL)
                    get_surface(v, &p, size, surface, brick);
            }
    return LR_OK;
}

/* ---- what a volume holds ----------------------------------------------- */

static uint64_t count_full(const lr_volume *v)
{
    uint64_t n_full = 0;
    size_t n = lr_table_count(v);
    for (size_t at = 0; at < n; at++)
        n_full += v->table[at] >> 8 == LR_BRICK_ONE;
    return n_full;
}

void lr_volume_get_info(const lr_volume *v, lr_volume_info *info)
{
    memset(info, 0, sizeof *info);
    info->desc = v->desc;
    info->n_bricks = v->n_bricks - LR_FIRST_STORED;
    info->n_full = count_full(v);
    info->n_surface_cells = v->n_surface_cells;
    info->nbytes =
        sizeof *v + 3 * (uint64_t)v->n_planes * sizeof **v->planes +
        lr_table_count(v) * sizeof *v->table +
        (uint64_t)v->capacity * lr_volume_brick_nbytes(v->desc.sample_type, v->desc.has_ids != 0) +
        lr_triangle_cells_nbytes(v->triangle_cells) + lr_objects_nbytes(v);
    if (v->objects != NULL) {
        info->n_objects = v->objects->n_objects;
        info->n_shared = v->objects->n_shared;
        info->n_dropped = v->objects->n_dropped;
    }
    info->n_triangle_cells = v->triangle_cells != NULL ? v->triangle_cells->n_cells : 0;
    info->n_cell_triangles =
        v->triangle_cells != NULL ? v->triangle_cells->start[v->triangle_cells->n_cells] : 0;
    info->triangle_cells_nbytes = lr_triangle_cells_nbytes(v->triangle_cells);
    info->has_colors = v->faces != NULL && v->faces->source != NULL;
    info->has_normals = v->faces != NULL && v->faces->normal != NULL;
    if (v->block_of != NULL)
        info->nbytes += (uint64_t)v->capacity * LR_WORDS * sizeof *v->block_of +
                        v->n_blocks * lr_volume_block_nbytes() +
                        lr_triangle_attributes_nbytes(v->faces);
    for (int a = 0; a < 3; a++) {
        info->surface_lo[a] = v->surface_lo[a] - LR_PAD;
        info->surface_hi[a] = v->surface_hi[a] - LR_PAD;
    }
}

lr_status lr_volume_get_bricks(const lr_volume *v, int32_t *origins, uint64_t n, lr_error *error)
{
    uint64_t n_stored = v->n_bricks - LR_FIRST_STORED, n_all = n_stored + count_full(v);
    if (n < n_all)
        return lr_fail(error, LR_E_SIZE, "origins has room for %llu bricks, the volume has %llu",
                       (unsigned long long)n, (unsigned long long)n_all);
    uint64_t full = n_stored;
    for (int32_t z = 0; z < v->table_size[2]; z++)
        for (int32_t y = 0; y < v->table_size[1]; y++)
            for (int32_t x = 0; x < v->table_size[0]; x++) {
                uint32_t brick = v->table[lr_table_at(v, x, y, z)] >> 8;
                if (brick == LR_BRICK_ZERO)
                    continue;
                uint64_t i = brick == LR_BRICK_ONE ? full++ : brick - LR_FIRST_STORED;
                origins[3 * i] = LR_SIDE * x - LR_PAD;
                origins[3 * i + 1] = LR_SIDE * y - LR_PAD;
                origins[3 * i + 2] = LR_SIDE * z - LR_PAD;
            }
    return LR_OK;
}
