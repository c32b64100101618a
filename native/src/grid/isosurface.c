/* Volumes that share their samples: the surface cells of one threshold.
 *
 * Ranges tell which bricks can hold some; of those the cells are classified, a layer of bricks at
 * a time. A volume has its own table and masks, and nothing else.
 *
 * Source: Wilhelms and Van Gelder, Octrees for faster isosurface generation, 1992 (ranges).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/isosurface.h"

#include "base/error.h"
#include "grid/classify_cells.h"
#include "grid/visible_cells.h"

/* Of the surface cells of a layer of bricks. */
struct lr_surface_bounds {
    uint64_t n;
    int32_t lo[3], hi[3];
    bool done;
};

/* A threshold as an occupancy which gives it back, or something below it that no whole number lies
 * between. */
static double threshold_of(const lr_samples *s, double stored)
{
    const double one = lr_sample_types[s->map.sample_type].one;
    double t = stored / one;
    while (t * one > stored)
        t = nextafter(t, 0.0);
    return t;
}

lr_status lr_isosurface_begin(lr_samples *s, double threshold, lr_volume **volume, lr_error *error)
{
    lr_status status = lr_samples_check_state(s, true, error);
    if (status == LR_OK && !(threshold > s->map.outside && threshold <= s->map.inside))
        status = lr_fail(error, LR_E_ARGUMENT,
                         "a threshold of these samples lies in (%g, %g], not at %g", s->map.outside,
                         s->map.inside, threshold);
    if (status != LR_OK)
        return status;
    const bool whole = lr_sample_types[s->map.sample_type].whole;
    return lr_isosurface_share(s, s->desc.open != 0 ? LR_KIND_SHEET : LR_KIND_SOLID,
                               whole ? threshold_of(s, threshold) : threshold, volume, error);
}

lr_status lr_isosurface_share(lr_samples *s, int32_t kind, double threshold, lr_volume **volume,
                              lr_error *error)
{
    const bool whole = lr_sample_types[s->map.sample_type].whole;
    lr_volume_desc desc = {.nx = s->desc.nx,
                           .ny = s->desc.ny,
                           .nz = s->desc.nz,
                           .sample_type = s->map.sample_type,
                           .kind = kind,
                           .interpolation = s->desc.interpolation,
                           .threshold = threshold,
                           .outside = whole ? 0.0 : s->map.outside,
                           .inside = whole ? 1.0 : s->map.inside};
    lr_volume *v;
    memcpy(desc.object_from_index, s->desc.object_from_index, sizeof desc.object_from_index);
    const lr_status status = lr_volume_begin(&desc, &v, error);
    if (status != LR_OK)
        return status;
    free(v->samples);
    free(v->cells);
    v->samples = s->samples;
    v->shared = lr_samples_share(s);
    v->n_bricks = v->capacity = s->n_bricks;
    memcpy(v->table, s->table, lr_table_count(v) * sizeof *v->table);
    v->cells = calloc(s->n_bricks, sizeof *v->cells);
    v->parts = calloc((size_t)s->table_size[2], sizeof *v->parts);
    if (v->cells == NULL || v->parts == NULL) {
        lr_volume_free(v);
        return lr_fail_memory(error, s->n_bricks * sizeof *v->cells, "the cells of an isosurface");
    }
    lr_bound_nothing(v);
    *volume = v;
    return LR_OK;
}

/* The range of the samples by which the field in the brick at b is given. */
static void range_of_brick(const lr_volume *v, const int32_t b[3], double *least, double *greatest)
{
    const lr_samples *s = v->shared;
    double low = INFINITY, high = -INFINITY;
    for (int n = 0; n < lr_support_count(lr_is_cubic(v)); n++) {
        int32_t to[3];
        lr_support_brick(lr_is_cubic(v), n, b, to);
        if (!lr_has_brick(s->table_size, to)) {
            low = fmin(low, s->map.outside);
            high = fmax(high, s->map.outside);
            continue;
        }
        const size_t at = lr_place_of(s->table_size, to[0], to[1], to[2]);
        low = s->low[at] < low ? s->low[at] : low;
        high = s->high[at] > high ? s->high[at] : high;
    }
    *least = low;
    *greatest = high;
}

static bool mask_of_brick(const lr_volume *v, const int32_t b[3], lr_mask mask)
{
    double low, high;
    range_of_brick(v, b, &low, &high);
    if (v->transfer != NULL)
        return lr_visible_mask(v, b, low, high, mask);
    return low < v->threshold && high >= v->threshold && lr_surface_mask(v, b, mask);
}

/* Of a brick's cells those between samples of the lattice. */
static void keep_inner(const lr_volume *v, const int32_t b[3], lr_mask mask)
{
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    for (int w = 0; w < LR_WORDS; w++)
        for (uint64_t left = mask[w]; left != 0; left &= left - 1) {
            const int cell = lr_cell_of_bit(w, __builtin_ctzll(left));
            for (int a = 0; a < 3; a++) {
                const int32_t c = LR_SIDE * b[a] + lr_along(cell, a) - LR_PAD;
                if (c < 0 || c >= n[a] - 1)
                    mask[w] &= ~(left & (0 - left));
            }
        }
}

/* Bounds of a brick's cells; most bricks do not widen them. */
static void widen(struct lr_surface_bounds *p, const int32_t b[3], const lr_mask mask)
{
    bool within = p->n > 0;
    for (int a = 0; a < 3; a++)
        within = within && p->lo[a] <= LR_SIDE * b[a] && p->hi[a] >= LR_SIDE * b[a] + LR_SIDE - 1;
    for (int w = 0; w < LR_WORDS && !within; w++)
        for (uint64_t left = mask[w]; left != 0; left &= left - 1) {
            const int cell = lr_cell_of_bit(w, __builtin_ctzll(left));
            for (int a = 0; a < 3; a++) {
                p->lo[a] = lr_min_i(p->lo[a], LR_SIDE * b[a] + lr_along(cell, a));
                p->hi[a] = lr_max_i(p->hi[a], LR_SIDE * b[a] + lr_along(cell, a));
            }
        }
}

/* A brick that takes no memory is constant with all its neighbours, hence holds no surface; if what
 * is inside is visible all its cells are, which the mask of its constant says already. */
static void classify(lr_volume *v, const int32_t b[3], struct lr_surface_bounds *p)
{
    lr_mask mask;
    if (!mask_of_brick(v, b, mask))
        return;
    if (v->desc.kind == LR_KIND_SHEET)
        keep_inner(v, b, mask);
    const size_t at = lr_table_at(v, b[0], b[1], b[2]);
    uint64_t n = 0;
    uint32_t words = 0;
    for (int w = 0; w < LR_WORDS; w++) {
        n += (uint64_t)__builtin_popcountll(mask[w]);
        words |= (uint32_t)(mask[w] != 0) << w;
    }
    assert(v->table[at] >> 8 >= LR_FIRST_STORED || v->transfer != NULL);
    if (v->table[at] >> 8 >= LR_FIRST_STORED)
        memcpy(v->cells[v->table[at] >> 8], mask, sizeof(lr_mask));
    v->table[at] |= words;
    widen(p, b, mask);
    p->n += n;
}

lr_status lr_isosurface_part(lr_volume *v, int32_t part, const lr_watch *watch, lr_error *error)
{
    if (v->parts == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is no isosurface that has been begun");
    const lr_status status = lr_samples_check_part(v->shared, part, error);
    if (status != LR_OK)
        return status;
    struct lr_surface_bounds p = {.n = 0};
    for (int a = 0; a < 3; a++) {
        p.lo[a] = INT32_MAX;
        p.hi[a] = INT32_MIN;
    }
    int32_t b[3] = {0, 0, part};
    for (b[1] = 0; b[1] < v->table_size[1]; b[1]++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        for (b[0] = 0; b[0] < v->table_size[0]; b[0]++)
            classify(v, b, &p);
    }
    p.done = true;
    v->parts[part] = p;
    return LR_OK;
}

lr_status lr_isosurface_finish(lr_volume *v, lr_error *error)
{
    if (v->parts == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is no isosurface that has been begun");
    for (int32_t k = 0; k < v->table_size[2]; k++) {
        const struct lr_surface_bounds *p = &v->parts[k];
        if (!p->done)
            return lr_fail(error, LR_E_ARGUMENT, "part %d of the isosurface is missing", k);
        v->n_surface_cells += p->n;
        for (int a = 0; a < 3 && p->n > 0; a++) {
            v->surface_lo[a] = lr_min_i(v->surface_lo[a], p->lo[a]);
            v->surface_hi[a] = lr_max_i(v->surface_hi[a], p->hi[a]);
        }
    }
    free(v->parts);
    v->parts = NULL;
    v->finished = true;
    return LR_OK;
}
