/* Macro regions that are maximal boxes.
 *
 * From every empty cell that is in no box yet a box is grown, a layer at a time to all six
 * sides in turn, until surface stops it on every side; it may overlap others. A cell stores
 * one box that contains it, and the ray leaves that. Along a flat wall boxes are long where
 * cubes are thin; but a cell near a side of its box has no other, and the result depends on
 * the order in which boxes are made.
 *
 * Source: Devillers 1989 (macro-regions). Departures: 1. memory grows with the surface: boxes
 * of bricks cover the empty bricks, boxes of cells only the inside of bricks that hold
 * surface; 2. a brick has at most 255 boxes; further empty cells are left one by one.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "trace/traverser.h"

enum { ALONE = 255 };

#define OF_CELLS 0x80000000u /* an index into the bricks that hold surface */

typedef struct box {
    int32_t lo[3], hi[3];
} box;

typedef struct list {
    box *boxes;
    uint32_t n, capacity;
} list;

/* A box of cells within their brick. */
typedef struct small_box {
    uint8_t lo[3], hi[3];
} small_box;

/* The boxes of a brick that holds surface. */
typedef struct inner {
    uint32_t first;        /* of its boxes */
    uint8_t box[LR_CELLS]; /* counted from there, or ALONE */
} inner;

typedef struct regions {
    uint32_t *bricks; /* [table]: index into of_bricks, or OF_CELLS | index into inside */
    list of_bricks;
    inner *inside;
    small_box *of_cells;
    uint32_t n_of_cells, capacity;
} regions;

void lr_macro_box_free(void *data)
{
    regions *g = data;
    if (g == NULL)
        return;
    free(g->bricks);
    free(g->of_bricks.boxes);
    free(g->inside);
    free(g->of_cells);
    free(g);
}

LR_INLINE size_t entry_at(const int32_t n[3], int32_t x, int32_t y, int32_t z)
{
    return ((size_t)z * (size_t)n[1] + (size_t)y) * (size_t)n[0] + (size_t)x;
}

static bool empty(const uint8_t *full, const int32_t n[3], const int32_t lo[3], const int32_t hi[3])
{
    for (int32_t z = lo[2]; z <= hi[2]; z++)
        for (int32_t y = lo[1]; y <= hi[1]; y++)
            if (memchr(full + entry_at(n, lo[0], y, z), 1, (size_t)(hi[0] - lo[0] + 1)) != NULL)
                return false;
    return true;
}

/* Grow lo..hi among n entries without those that are full[]. */
static void grow(const uint8_t *full, const int32_t n[3], int32_t lo[3], int32_t hi[3])
{
    for (unsigned open = 63, side = 0; open != 0; side = (side + 1) % 6) {
        const unsigned a = side >> 1;
        int32_t from[3], to[3];
        memcpy(from, lo, sizeof from);
        memcpy(to, hi, sizeof to);
        from[a] = to[a] = side & 1 ? hi[a] + 1 : lo[a] - 1;
        if (!(open >> side & 1))
            continue;
        if (from[a] < 0 || from[a] >= n[a] || !empty(full, n, from, to))
            open &= ~(1u << side);
        else if (side & 1)
            hi[a]++;
        else
            lo[a]--;
    }
}

static lr_status add_box(list *l, const int32_t lo[3], const int32_t hi[3], lr_error *error)
{
    if (l->n == l->capacity) {
        const uint32_t capacity = l->capacity + l->capacity / 2 + 64;
        box *boxes = realloc(l->boxes, capacity * sizeof *boxes);
        if (boxes == NULL)
            return lr_fail_memory(error, capacity * sizeof *boxes, "macro regions");
        l->boxes = boxes;
        l->capacity = capacity;
    }
    for (int a = 0; a < 3; a++) {
        l->boxes[l->n].lo[a] = lo[a];
        l->boxes[l->n].hi[a] = hi[a];
    }
    l->n++;
    return LR_OK;
}

#define NO_BOX UINT32_MAX

/* Boxes for all entries that are not full: id[] is the number of one in the list, or
 * NO_BOX. */
static lr_status cover(const uint8_t *full, const int32_t n[3], list *l, uint32_t *id,
                       const lr_watch *watch, lr_error *error)
{
    const size_t count = entry_at(n, 0, 0, n[2]);
    memset(id, 0xff, count * sizeof *id);
    for (size_t at = 0; at < count; at++) {
        if (full[at] != 0 || id[at] != NO_BOX)
            continue;
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        const int32_t x = (int32_t)(at % (size_t)n[0]), row = (int32_t)(at / (size_t)n[0]);
        int32_t lo[3] = {x, row % n[1], row / n[1]}, hi[3] = {lo[0], lo[1], lo[2]};
        grow(full, n, lo, hi);
        lr_status status = add_box(l, lo, hi, error);
        if (status != LR_OK)
            return status;
        for (int32_t z = lo[2]; z <= hi[2]; z++)
            for (int32_t y = lo[1]; y <= hi[1]; y++)
                for (size_t i = entry_at(n, lo[0], y, z); i <= entry_at(n, hi[0], y, z); i++)
                    id[i] = id[i] == NO_BOX ? l->n - 1 : id[i];
    }
    return LR_OK;
}

/* Keep the boxes of a brick. */
static lr_status add_small(regions *g, const list *l, lr_error *error)
{
    if (g->n_of_cells + l->n > g->capacity) {
        const uint32_t capacity = g->capacity + g->capacity / 2 + l->n;
        small_box *boxes = realloc(g->of_cells, capacity * sizeof *boxes);
        if (boxes == NULL)
            return lr_fail_memory(error, capacity * sizeof *boxes, "macro regions");
        g->of_cells = boxes;
        g->capacity = capacity;
    }
    for (uint32_t i = 0; i < l->n; i++, g->n_of_cells++)
        for (int a = 0; a < 3; a++) {
            g->of_cells[g->n_of_cells].lo[a] = (uint8_t)l->boxes[i].lo[a];
            g->of_cells[g->n_of_cells].hi[a] = (uint8_t)l->boxes[i].hi[a];
        }
    return LR_OK;
}

/* The inside of a brick that holds surface; scratch is memory for its boxes. */
static lr_status cover_brick(const lr_mask mask, regions *g, list *scratch, inner *out,
                             lr_error *error)
{
    static const int32_t side[3] = {LR_SIDE, LR_SIDE, LR_SIDE};
    uint8_t full[LR_CELLS];
    uint32_t id[LR_CELLS];
    for (int n = 0; n < LR_CELLS; n++)
        full[n] = lr_mask_has(mask, lr_along(n, 0), lr_along(n, 1), lr_along(n, 2));
    scratch->n = 0;
    out->first = g->n_of_cells;
    lr_status status = cover(full, side, scratch, id, NULL, error);
    for (int n = 0; status == LR_OK && n < LR_CELLS; n++)
        out->box[n] = (uint8_t)(id[n] < ALONE ? id[n] : ALONE);
    return status == LR_OK ? add_small(g, scratch, error) : status;
}

static lr_status fill(regions *g, const lr_volume *v, uint8_t *full, uint64_t *nbytes,
                      const lr_watch *watch, lr_error *error)
{
    const size_t n = lr_table_count(v);
    uint32_t n_inside = 0;
    for (size_t at = 0; at < n; at++) {
        full[at] = lr_entry_words(lr_entry_at(v, at)) != 0;
        n_inside += full[at];
        if (lr_stopped_now_and_then(watch, at))
            return lr_fail_stopped(error);
    }
    lr_status status = cover(full, v->table_size, &g->of_bricks, g->bricks, watch, error);
    if (status != LR_OK)
        return status;
    g->inside = malloc((n_inside + (size_t)1) * sizeof *g->inside);
    if (g->inside == NULL)
        return lr_fail_memory(error, n_inside * sizeof *g->inside, "macro regions");
    uint32_t made = 0;
    list scratch = {0};
    for (size_t at = 0; status == LR_OK && at < n; at++) {
        if (full[at] == 0)
            continue;
        const uint64_t *mask = lr_entry_mask(v, lr_entry_at(v, at));
        status = lr_stopped(watch) ? lr_fail_stopped(error)
                                   : cover_brick(mask, g, &scratch, &g->inside[made], error);
        g->bricks[at] = OF_CELLS | made++;
        lr_progress(watch, (double)made / n_inside);
    }
    free(scratch.boxes);
    *nbytes = sizeof *g + n * sizeof *g->bricks + n_inside * sizeof *g->inside +
              g->of_bricks.capacity * sizeof(box) + g->capacity * sizeof(small_box);
    return status;
}

lr_status lr_macro_box_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                             void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    const size_t n = lr_table_count(v);
    regions *g = calloc(1, sizeof *g);
    uint8_t *full = malloc(n);
    lr_status status = LR_OK;
    if (g != NULL)
        g->bricks = malloc(n * sizeof *g->bricks);
    if (g == NULL || full == NULL || g->bricks == NULL)
        status = lr_fail_memory(error, n * (1 + sizeof *g->bricks), "macro regions");
    if (status == LR_OK)
        status = fill(g, v, full, nbytes, watch, error);
    free(full);
    if (status != LR_OK) {
        lr_macro_box_free(g);
        return status;
    }
    *data = g;
    return LR_OK;
}

LR_INLINE bool empty_box(const void *data, const lr_volume *v, const lr_ray *r, int *state,
                         const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    (void)state, (void)tally;
    const regions *g = data;
    const uint32_t at = g->bricks[lr_table_of(v, c[0], c[1], c[2])];
    if (at & OF_CELLS) {
        if (lr_is_surface_cell(v, c))
            return true;
        const inner *in = &g->inside[at & ~OF_CELLS];
        const uint8_t number = in->box[lr_in_brick(c[0], c[1], c[2])];
        const small_box *b = &g->of_cells[in->first + (number == ALONE ? 0 : number)];
        for (int a = 0; a < 3; a++) {
            lo[a] = number == ALONE ? c[a] : (c[a] & -LR_SIDE) + b->lo[a];
            hi[a] = number == ALONE ? c[a] : (c[a] & -LR_SIDE) + b->hi[a];
        }
    } else {
        const box *b = &g->of_bricks.boxes[at];
        lr_cells_of_bricks(b->lo, b->hi, lo, hi);
    }
    lr_cut_box(r, lo, hi);
    return false;
}

#define LR_NAME macro_box
#define LR_BOX  empty_box
#include "trace/walk_template.h"
