/* Visible cells: those whose values a transfer function lets be seen, in the place of surface
 * cells, so that every structure leaps over all others.
 *
 * A trilinear field takes in a cell all values between the least and the greatest of its corners,
 * and no others: the cell is left out if nothing of these is visible. Ranges of whole bricks tell
 * first.
 *
 * Source: Levoy 1990 (culling), Wilhelms and Van Gelder 1992 (ranges).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/visible_cells.h"

#include "base/error.h"
#include "grid/access.h"
#include "grid/isosurface.h"
#include "grid/transfer_function.h"

static void describe(const lr_samples *s, lr_volume_desc *d)
{
    const bool whole = lr_sample_types[s->map.sample_type].whole;
    *d = (lr_volume_desc){.nx = s->desc.nx,
                          .ny = s->desc.ny,
                          .nz = s->desc.nz,
                          .sample_type = s->map.sample_type,
                          .kind = LR_KIND_SOLID,
                          .interpolation = s->desc.interpolation,
                          .threshold = whole ? 1.0 : s->map.inside,
                          .outside = whole ? 0.0 : s->map.outside,
                          .inside = whole ? 1.0 : s->map.inside};
    memcpy(d->object_from_index, s->desc.object_from_index, sizeof d->object_from_index);
}

static lr_status check(const lr_samples *s, const lr_transfer *numbers, int32_t bounded,
                       lr_error *error)
{
    if (s->desc.interpolation != LR_VOLUME_LINEAR)
        return lr_fail(error, LR_E_ARGUMENT,
                       "volumes of a transfer function are trilinear: interpolation must be "
                       "linear, not cubic");
    if (!(s->map.outside < s->map.inside))
        return lr_fail(error, LR_E_ARGUMENT,
                       "outside must lie below inside; they are stored as %g and %g",
                       s->map.outside, s->map.inside);
    if (!bounded && lr_transfer_sees(numbers, s->map.outside, s->map.outside))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the background is visible by this transfer function: the volume would "
                       "fill all of space");
    return LR_OK;
}

lr_status lr_visible_begin(lr_samples *s, const lr_transfer *transfer, double scale, double offset,
                           int32_t bounded, int32_t everywhere, lr_volume **volume,
                           lr_error *error)
{
    lr_transfer *numbers;
    lr_volume *v;
    lr_volume_desc desc;
    lr_status status = lr_samples_check_state(s, true, error);
    if (status == LR_OK)
        status = lr_transfer_of_numbers(transfer, scale, offset, &numbers, error);
    if (status != LR_OK)
        return status;
    describe(s, &desc);
    status = check(s, numbers, bounded, error);
    if (status == LR_OK)
        status = lr_isosurface_share(s, &desc, &v, error);
    if (status != LR_OK) {
        lr_transfer_free(numbers);
        return status;
    }
    v->transfer = numbers;
    if (v->everywhere || lr_transfer_sees(numbers, v->inside, v->inside))
        memset(v->cells[LR_BRICK_ONE], 0xff, sizeof *v->cells);
    v->value_scale = scale;
    v->value_offset = offset;
    v->bounded = bounded != 0;
    v->everywhere = everywhere != 0;
    *volume = v;
    return LR_OK;
}

enum { CORNERS = LR_SIDE + 1 };

/* Ranges of neighbours along an axis, in place: n numbers become the ranges of pairs `stride`
 * apart. */
LR_INLINE void pair_up(double *low, double *high, int stride, int from)
{
    const double l = low[from + stride], h = high[from + stride];
    low[from] = l < low[from] ? l : low[from];
    high[from] = h > high[from] ? h : high[from];
}

/* The least and the greatest corner of every cell of a brick, at its lowest corner. */
static void cell_ranges(const lr_volume *v, const int32_t b[3], double *low, double *high)
{
    const int32_t first[3] = {LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]};
    lr_brick_corners(v, first, low);
    memcpy(high, low, CORNERS * CORNERS * CORNERS * sizeof *low);
    for (int z = 0; z < CORNERS; z++)
        for (int y = 0; y < CORNERS; y++)
            for (int x = 0; x < LR_SIDE; x++)
                pair_up(low, high, 1, (z * CORNERS + y) * CORNERS + x);
    for (int z = 0; z < CORNERS; z++)
        for (int y = 0; y < LR_SIDE; y++)
            for (int x = 0; x < LR_SIDE; x++)
                pair_up(low, high, CORNERS, (z * CORNERS + y) * CORNERS + x);
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++)
            for (int x = 0; x < LR_SIDE; x++)
                pair_up(low, high, CORNERS * CORNERS, (z * CORNERS + y) * CORNERS + x);
}

/* Is a cell visible whose corners span that range? */
LR_INLINE bool is_visible(const lr_volume *v, double low, double high)
{
    if (low == v->outside && (v->bounded || high == low))
        return false;
    return v->everywhere || lr_transfer_sees(v->transfer, low, high);
}

bool lr_visible_mask(const lr_volume *v, const int32_t b[3], lr_mask mask)
{
    double low[CORNERS * CORNERS * CORNERS], high[CORNERS * CORNERS * CORNERS];
    lr_isosurface_range(v, b, &low[0], &high[0]);
    if (!v->everywhere && !lr_transfer_sees(v->transfer, low[0], high[0]))
        return false;
    cell_ranges(v, b, low, high);
    memset(mask, 0, sizeof(lr_mask));
    bool any = false;
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++) {
            uint64_t row = 0;
            for (int x = 0; x < LR_SIDE; x++) {
                const int at = (z * CORNERS + y) * CORNERS + x;
                row |= (uint64_t)is_visible(v, low[at], high[at]) << x;
            }
            lr_mask_add_row(mask, y, z, row);
            any = any || row != 0;
        }
    return any;
}
