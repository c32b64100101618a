/* lr_volume_finish: which cells hold surface, and which bricks need no memory.
 *
 * A brick that is 0 or 1 throughout and carries neither ids nor attributes is dropped; a surface
 * cell whose lowest corner lies in a dropped brick brings that brick back, since the cell's bit
 * needs a place.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */

#include "grid/classify_cells.h"

#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"

#define LR_VECTORS 0 /* compiled once, for all processors */
#include "base/vectors.h"

/* The constant brick that a brick is like, 2: neither. Ids other than 0, touched
 * cells and attributes are something to keep. */
static uint32_t constant_of(const lr_volume *v, uint32_t brick)
{
    size_t at = (size_t)brick * LR_CELLS;
    for (size_t s = 0; v->block_of != NULL && s < LR_WORDS; s++)
        if (v->block_of[LR_WORDS * (size_t)brick + s] != 0)
            return 2;
    if (v->ids != NULL)
        for (int i = 0; i < LR_CELLS; i++)
            if (v->ids[at + (size_t)i] != 0)
                return 2;
    if (v->desc.kind == LR_KIND_SHEET)
        for (int s = 0; s < LR_WORDS; s++)
            if (v->cells[brick][s] != 0)
                return 2;
    double first = lr_load(v, at);
    if (first != v->outside && first != v->inside)
        return 2;
    for (int i = 1; i < LR_CELLS; i++)
        if (lr_load(v, at + (size_t)i) != first)
            return 2;
    return first == v->outside ? LR_BRICK_ZERO : LR_BRICK_ONE;
}

/* Drop constant bricks and close the gaps. moved[b] is where brick b went. */
static lr_status drop_constants(lr_volume *v, const lr_watch *watch, lr_error *error)
{
    uint32_t *moved = malloc((size_t)v->n_bricks * sizeof *moved);
    if (moved == NULL)
        return lr_fail_memory(error, (uint64_t)v->n_bricks * sizeof *moved, "a list of bricks");
    uint32_t next = LR_FIRST_STORED;
    bool stopped = false;
    for (uint32_t b = LR_FIRST_STORED; b < v->n_bricks && !stopped; b++) {
        uint32_t constant = constant_of(v, b);
        moved[b] = constant < 2 ? constant : next++;
        stopped = lr_stopped(watch);
    }
    if (!stopped) {
        for (uint32_t b = LR_FIRST_STORED; b < v->n_bricks; b++)
            if (moved[b] >= LR_FIRST_STORED && moved[b] != b)
                lr_volume_move_brick(v, moved[b], b);
        size_t n = lr_table_count(v);
        for (size_t at = 0; at < n; at++)
            if (v->table[at] >> 8 >= LR_FIRST_STORED)
                v->table[at] = moved[v->table[at] >> 8] << 8;
        v->n_bricks = next;
    }
    free(moved);
    return stopped ? lr_fail_stopped(error) : LR_OK;
}

typedef uint8_t eight_bytes __attribute__((vector_size(8)));
typedef uint16_t eight_words __attribute__((vector_size(16)));

/* A row's samples that are at or above T, as bits. Whole numbers are where they are at or above the
 * next whole number, f32 at or above the next float. */
static uint32_t above_row(const lr_volume *v, size_t at)
{
    const double t = ceil(v->threshold);
    switch (v->desc.sample_type) {
    case LR_U8: {
        eight_bytes row;
        memcpy(&row, v->samples + at, sizeof row);
        return lr_bits_of_eight(__builtin_convertvector(row >= (uint8_t)t, lr_eight_ints));
    }
    case LR_U16: {
        eight_words row;
        memcpy(&row, v->samples + 2 * at, sizeof row);
        return lr_bits_of_eight(__builtin_convertvector(row >= (uint16_t)t, lr_eight_ints));
    }
    case LR_F32: {
        const float *row = (const float *)(const void *)v->samples + at;
        float least = (float)v->threshold;
        if ((double)least < v->threshold)
            least = nextafterf(least, INFINITY);
        return lr_bits_of_eight(lr_load_eight_floats(row) >= least);
    }
    default: {
        uint32_t above = 0;
        for (size_t x = 0; x < LR_SIDE; x++)
            above |= (uint32_t)(lr_load(v, at + x) >= v->threshold) << x;
        return above;
    }
    }
}

/* Samples at or above T, a bit each: rows of a brick's own and of the near layers of its
 * neighbours, `before` of them below it. */
enum { MOST_ROWS = LR_SIDE + 3 };
typedef uint32_t above_bits[MOST_ROWS][MOST_ROWS];

/* span: of the samples along an axis by which the field in a cell is given. */
LR_INLINE void above_rows(const lr_volume *v, const int32_t b[3], int before, int span,
                          above_bits rows)
{
    enum { LAST = LR_SIDE - 1 };
    size_t brick[27]; /* this one and its neighbours, by offsets -1..1; zeros beyond the table */
    for (int n = 0; n < 27; n++) {
        int32_t to[3];
        lr_support_brick(true, n, b, to);
        const bool inside = lr_has_brick(v->table_size, to);
        const size_t place = inside ? lr_table_at(v, to[0], to[1], to[2]) : 0;
        brick[n] = (size_t)(inside ? v->table[place] >> 8 : LR_BRICK_ZERO) * LR_CELLS;
    }
    for (int k = 0; k < LR_SIDE + span - 1; k++)
        for (int j = 0; j < LR_SIDE + span - 1; j++) {
            const int y = j - before, z = k - before;
            const size_t at = (size_t)lr_in_brick(0, y, z);
            const int n = 13 + 3 * lr_brick_of(y) + 9 * lr_brick_of(z);
            uint32_t row = above_row(v, brick[n] + at) << before;
            if (before > 0)
                row |= lr_load(v, brick[n - 1] + at + LAST) >= v->threshold;
            for (int x = 0; x < span - 1 - before; x++) {
                const bool above = lr_load(v, brick[n + 1] + at + (size_t)x) >= v->threshold;
                row |= (uint32_t)above << (before + LR_SIDE + x);
            }
            rows[k][j] = row;
        }
}

/* The cells whose samples lie on both sides: no others hold surface, as the field lies in the hull
 * of the samples by which it is given. */
LR_INLINE bool mixed_cells(const lr_volume *v, const int32_t b[3], int before, int span,
                           lr_mask mask)
{
    above_bits rows;
    above_rows(v, b, before, span, rows);
    memset(mask, 0, sizeof(lr_mask));
    uint64_t any_cell = 0;
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++) {
            uint32_t any = 0, all = UINT32_MAX;
            for (int n = 0; n < span * span; n++) {
                const uint32_t row = rows[z + n / span][y + n % span];
                any |= row;
                all &= row;
            }
            uint32_t some = 0, each = UINT32_MAX;
            for (int x = 0; x < span; x++) {
                some |= any >> x;
                each &= all >> x;
            }
            const uint64_t cells = some & ~each & 0xff;
            lr_mask_add_row(mask, y, z, cells);
            any_cell |= cells;
        }
    return any_cell != 0;
}

bool lr_surface_mask(const lr_volume *v, const int32_t b[3], lr_mask mask)
{
    return lr_is_cubic(v) ? mixed_cells(v, b, 1, 4, mask) : mixed_cells(v, b, 0, 2, mask);
}

/* Is the brick surrounded, where its cells' field reaches, by its own constant? */
static bool plain(const lr_volume *v, const int32_t b[3])
{
    uint32_t constant = v->table[lr_table_at(v, b[0], b[1], b[2])] >> 8;
    if (constant >= LR_FIRST_STORED)
        return false;
    for (int n = 0; n < lr_support_count(lr_is_cubic(v)); n++) {
        int32_t to[3];
        lr_support_brick(lr_is_cubic(v), n, b, to);
        const bool inside = lr_has_brick(v->table_size, to);
        const size_t place = inside ? lr_table_at(v, to[0], to[1], to[2]) : 0;
        if ((inside ? v->table[place] >> 8 : LR_BRICK_ZERO) != constant)
            return false;
    }
    return true;
}

static lr_status classify_brick(lr_volume *v, const int32_t b[3], lr_error *error)
{
    lr_mask mask;
    if (plain(v, b))
        return LR_OK;
    size_t at = lr_table_at(v, b[0], b[1], b[2]);
    bool any = lr_surface_mask(v, b, mask);
    if (v->table[at] >> 8 < LR_FIRST_STORED && (!any || v->desc.kind == LR_KIND_SHEET))
        return LR_OK; /* an untouched brick of a sheet holds no surface */
    uint32_t brick;
    lr_status status = lr_volume_open_brick(v, at, &brick, error);
    if (status != LR_OK)
        return status;
    uint32_t sub = 0;
    for (int s = 0; s < LR_WORDS; s++) {
        v->cells[brick][s] = v->desc.kind == LR_KIND_SHEET ? v->cells[brick][s] & mask[s] : mask[s];
        sub |= (uint32_t)(v->cells[brick][s] != 0) << s;
        v->n_surface_cells += (uint64_t)__builtin_popcountll(v->cells[brick][s]);
    }
    v->table[at] = brick << 8 | sub;
    return LR_OK;
}

static void bound(lr_volume *v, const int32_t b[3])
{
    const uint32_t entry = v->table[lr_table_at(v, b[0], b[1], b[2])];
    const int32_t first[3] = {LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]};
    for (int s = 0; s < LR_WORDS && (entry & 0xff) != 0; s++)
        lr_bound_word(v, first, s, v->cells[entry >> 8][s]);
}

lr_status lr_volume_finish_triangle_cells(lr_volume *v, const lr_triangle_cells_part *parts,
                                          uint32_t n_parts, const lr_triangle_cells_source *source,
                                          const lr_watch *watch, lr_error *error)
{
    lr_status status = drop_constants(v, watch, error);
    lr_bound_nothing(v);
    v->n_surface_cells = 0;
    for (int32_t z = 0; status == LR_OK && z < v->table_size[2]; z++) {
        for (int32_t y = 0; status == LR_OK && y < v->table_size[1]; y++) {
            if (lr_stopped(watch))
                return lr_fail_stopped(error);
            for (int32_t x = 0; status == LR_OK && x < v->table_size[0]; x++) {
                const int32_t b[3] = {x, y, z};
                status = classify_brick(v, b, error);
                if (status == LR_OK)
                    bound(v, b);
            }
        }
        lr_progress(watch, (double)(z + 1) / v->table_size[2]);
    }
    if (status == LR_OK && n_parts > 0)
        status = lr_triangle_cells_attach(v, parts, n_parts, source, watch, error);
    if (status == LR_OK)
        status = lr_volume_trim_blocks(v, watch, error);
    if (status == LR_OK && v->n_bricks < v->capacity) { /* give back what was not needed */
        v->capacity = 0;
        status = lr_volume_reserve(v, v->n_bricks - LR_FIRST_STORED, error);
    }
    v->finished = status == LR_OK;
    return status;
}

lr_status lr_volume_finish(lr_volume *v, const lr_watch *watch, lr_error *error)
{
    if (v->shared != NULL && !v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "an isosurface is finished by lr_isosurface_finish");
    return v->finished ? LR_OK : lr_volume_finish_triangle_cells(v, NULL, 0, NULL, watch, error);
}
