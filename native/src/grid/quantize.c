/* A finished volume in place: the samples, those of second objects, then bricks that
 * the steeper ramp made constant are dropped.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/quantize.h"

#include "base/error.h"
#include "grid/objects.h"
#include "grid/triangle_cells.h"

enum {
    POLL = 1 << 20, /* samples between two looks at the stop word: some ms */
    N_U16 = 1 << 16
};

/* What becomes of stored values, worked out once where there are many samples. */
typedef struct converter {
    const lr_volume *v;
    double gain;
    const uint8_t *known; /* of every value of u16, or NULL */
} converter;

/* Every sample shrinks, so that none is overwritten before it is read; false: stopped. */
static bool narrow(const converter *c, unsigned char *samples, size_t n, const lr_watch *watch)
{
    const uint16_t *wide = (const uint16_t *)(const void *)samples;
    for (size_t first = 0; first < n; first += POLL) {
        const size_t end = n - first < POLL ? n : first + POLL;
        if (lr_stopped(watch))
            return false;
        for (size_t at = first; at < end && c->known != NULL; at++)
            samples[at] = c->known[wide[at]];
        for (size_t at = first; at < end && c->known == NULL; at++) {
            const double value = lr_load_from(samples, c->v->desc.sample_type, at);
            samples[at] = (unsigned char)lr_narrowed(c->v, value, c->gain);
        }
    }
    return true;
}

static bool narrow_all(lr_volume *v, double gain, uint8_t *known, const lr_watch *watch)
{
    const size_t n = (size_t)v->n_bricks * LR_CELLS;
    const bool often = v->one == N_U16 - 1 && n > N_U16;
    for (size_t value = 0; value < N_U16 && often; value++)
        known[value] = (uint8_t)lr_narrowed(v, (double)value, gain);
    const converter c = {.v = v, .gain = gain, .known = often ? known : NULL};
    lr_objects *o = v->objects;
    if (!narrow(&c, v->samples, n, watch))
        return false;
    return o == NULL || narrow(&c, o->samples, (size_t)o->n_blocks * LR_WORD_CELLS, watch);
}

/* ---- bricks that became constant ---------------------------------------- */

static bool any(const void *bytes, size_t n)
{
    const unsigned char *b = bytes;
    return b[0] != 0 || memcmp(b, b + 1, n - 1) != 0;
}

static bool any_block(const uint32_t *block_of, uint32_t brick)
{
    return any(block_of + LR_WORDS * (size_t)brick, LR_WORDS * sizeof *block_of);
}

/* The constant brick that may stand for a stored one, or the brick itself. */
static uint32_t stand_in(const lr_volume *v, uint32_t brick)
{
    const lr_objects *o = v->objects;
    const unsigned char *samples = v->samples + (size_t)brick * LR_CELLS;
    if (any(v->cells[brick], sizeof v->cells[brick]) ||
        (v->block_of != NULL && any_block(v->block_of, brick)) ||
        (v->triangle_cells != NULL && any(v->triangle_cells->doubt[brick], sizeof(lr_mask))) ||
        (o != NULL && (samples[0] != 0 || any_block(o->block_of, brick))) ||
        (samples[0] != 0 && samples[0] != UINT8_MAX) ||
        memcmp(samples, samples + 1, LR_CELLS - 1) != 0)
        return brick;
    return samples[0] == 0 ? LR_BRICK_ZERO : LR_BRICK_ONE;
}

/* Move what an array has of the bricks that stay to its front; it loses what is left over. */
static void *pack(void *array, size_t stride, const uint32_t *to, uint32_t n, uint32_t n_left)
{
    unsigned char *bytes = array;
    if (array == NULL)
        return NULL;
    for (uint32_t b = LR_FIRST_STORED; b < n; b++)
        if (to[b] >= LR_FIRST_STORED && to[b] != b)
            memcpy(bytes + to[b] * stride, bytes + b * stride, stride);
    void *shrunk = realloc(array, n_left * stride);
    return shrunk != NULL ? shrunk : array;
}

static void drop_constant(lr_volume *v, uint32_t *to)
{
    const uint32_t n = v->n_bricks;
    uint32_t next = LR_FIRST_STORED;
    for (uint32_t b = 0; b < n; b++) {
        to[b] = b < LR_FIRST_STORED ? b : stand_in(v, b);
        if (b >= LR_FIRST_STORED && to[b] == b)
            to[b] = next++;
    }
    const size_t n_table = lr_table_count(v);
    for (size_t at = 0; at < n_table; at++)
        v->table[at] = to[v->table[at] >> 8] << 8 | (v->table[at] & 0xff);
    v->samples = pack(v->samples, LR_CELLS, to, n, next);
    v->ids = pack(v->ids, LR_CELLS * sizeof *v->ids, to, n, next);
    v->cells = pack(v->cells, sizeof *v->cells, to, n, next);
    v->block_of = pack(v->block_of, LR_WORDS * sizeof *v->block_of, to, n, next);
    if (v->triangle_cells != NULL) {
        v->triangle_cells->doubt =
            pack(v->triangle_cells->doubt, sizeof *v->triangle_cells->doubt, to, n, next);
        v->triangle_cells->first =
            pack(v->triangle_cells->first, sizeof *v->triangle_cells->first, to, n, next);
        v->triangle_cells->n_bricks = next;
    }
    if (v->objects != NULL)
        v->objects->block_of =
            pack(v->objects->block_of, LR_WORDS * sizeof *v->objects->block_of, to, n, next);
    v->n_bricks = v->capacity = next;
}

lr_status lr_volume_narrow(lr_volume *v, double gain, const lr_watch *watch, lr_error *error)
{
    if (!v->finished || v->desc.sample_type == LR_U8)
        return lr_fail(error, LR_E_ARGUMENT, "only a finished volume of u16 or f32 becomes u8");
    if (lr_is_cubic(v))
        return lr_fail(error, LR_E_ARGUMENT, "a cubic volume keeps its samples as they are");
    if (!lr_holds_occupancies(v))
        return lr_fail(error, LR_E_ARGUMENT, "an isosurface keeps its samples as they are");
    if (!(gain > 0.0 && gain <= 256.0))
        return lr_fail(error, LR_E_ARGUMENT, "gain must lie in 0..256, it is %g", gain);
    lr_objects *o = v->objects;
    uint32_t *to = malloc(v->n_bricks * sizeof *to);
    uint8_t *known = malloc(N_U16);
    lr_status status = LR_OK;
    if (to == NULL || known == NULL)
        status = lr_fail_memory(error, v->n_bricks * sizeof *to + N_U16, "narrower samples");
    else if (!narrow_all(v, gain, known, watch))
        status = lr_fail_stopped(error);
    free(known);
    if (status != LR_OK) {
        free(to);
        return status;
    }
    if (v->triangle_cells != NULL)
        v->triangle_cells->voxels_per_value *= v->one / (LR_NARROW_ONE * gain);
    if (o != NULL && o->samples != NULL) {
        unsigned char *shrunk = realloc(o->samples, (size_t)o->n_blocks * LR_WORD_CELLS);
        o->samples = shrunk != NULL ? shrunk : o->samples;
    }
    v->desc.sample_type = LR_U8;
    v->one = LR_NARROW_ONE;
    v->threshold = LR_NARROW_ONE * v->desc.threshold;
    drop_constant(v, to);
    free(to);
    return LR_OK;
}
