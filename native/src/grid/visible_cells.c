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

#include "grid/access.h"
#include "grid/transfer_function.h"

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

bool lr_visible_mask(const lr_volume *v, const int32_t b[3], double least, double greatest,
                     lr_mask mask)
{
    double low[CORNERS * CORNERS * CORNERS], high[CORNERS * CORNERS * CORNERS];
    if (!v->everywhere && !lr_transfer_sees(v->transfer, least, greatest))
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
