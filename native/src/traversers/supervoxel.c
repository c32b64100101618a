/* Supervoxels: one coarser grid of occupancy bits.
 *
 * A block of size^3 cells that holds no surface is left in one jump; inside any
 * other the ray goes cell by cell. Which size is best depends on the scene.
 *
 * Source: Thaller, Petsche, Rappelsberger et al. 1991, as in Sramek 1994, section 3.2.
 * Departures: 1. blocks of 4 and 2 are read from the brick store's own masks and
 * cost nothing; 2. blocks of 3 do not fill bricks and have bits of their own.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

static const int32_t sizes[] = {4, 2, 3}; /* by choice */

typedef struct blocks {
    int32_t size;
    int32_t count[3];
    uint64_t bits[]; /* of blocks of 3 */
} blocks;

LR_INLINE size_t block_at(const blocks *b, const int32_t c[3])
{
    const size_t row = (size_t)b->count[0], slice = row * (size_t)b->count[1];
    return (size_t)(c[0] / 3) + (size_t)(c[1] / 3) * row + (size_t)(c[2] / 3) * slice;
}

static lr_status add_bits(const lr_volume *v, blocks *made, const lr_watch *watch, lr_error *error)
{
    int32_t b[3] = {-1, 0, 0}, c[3];
    while (lr_next_surface_brick(v, watch, b)) {
        for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, c);) {
            const size_t at = block_at(made, c);
            made->bits[at >> 6] |= (uint64_t)1 << (at & 63);
        }
        lr_progress(watch, (b[2] + 1.0) / v->table_size[2]);
    }
    return lr_stopped(watch) ? lr_fail_stopped(error) : LR_OK;
}

lr_status lr_supervoxel_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                              void **data, uint64_t *nbytes, lr_error *error)
{
    const int32_t size = sizes[choices[0]];
    int32_t count[3];
    size_t words = 0;
    for (int a = 0; a < 3; a++)
        count[a] = (LR_SIDE * v->table_size[a] - 1) / size + 1;
    if (size == 3)
        words = ((size_t)count[0] * (size_t)count[1] * (size_t)count[2] + 63) / 64;
    *nbytes = sizeof(blocks) + words * sizeof(uint64_t);
    blocks *made = calloc(1, *nbytes);
    if (made == NULL)
        return lr_fail_memory(error, *nbytes, "supervoxels");
    made->size = size;
    memcpy(made->count, count, sizeof count);
    lr_status status = size == 3 ? add_bits(v, made, watch, error) : LR_OK;
    if (status != LR_OK) {
        free(made);
        return status;
    }
    *data = made;
    return LR_OK;
}

void lr_supervoxel_free(void *data)
{
    free(data);
}

LR_INLINE bool block_set(const blocks *b, const lr_volume *v, const int32_t c[3])
{
    if (b->size == 3) {
        const size_t at = block_at(b, c);
        return b->bits[at >> 6] >> (at & 63) & 1;
    }
    return lr_cube_has_surface(v, 2, c) && (b->size == 4 || lr_cube_has_surface(v, 1, c));
}

LR_INLINE bool empty_block(const void *data, const lr_volume *v, const lr_ray *r, int *state,
                           const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    (void)state, (void)tally;
    const blocks *b = data;
    const bool set = block_set(b, v, c);
    if (set && lr_is_surface_cell(v, c))
        return true;
    const int32_t size = set ? 1 : b->size;
    for (int a = 0; a < 3; a++) {
        lo[a] = size == 3 ? c[a] / 3 * 3 : c[a] & -size; /* by numbers known now: no division */
        hi[a] = lo[a] + size - 1;
    }
    lr_cut_box(r, lo, hi);
    return false;
}

#define LR_NAME supervoxel
#define LR_BOX  empty_block
#include "trace/walk_template.h"
