/* The corners of surface cells in a byte each, so that two gathers fetch a cell.
 *
 * Whether a ray may meet the surface in a cell does not change where f - T is multiplied by a
 * positive number: so each cell has a scale of its own, and half a step of rounding.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/narrow_band.h"
#include "grid/access.h"
#include "grid/triangle_cells.h"
#include "traversers/cd_corners.h"

static void pack(const lr_volume *v, const int32_t c[3], int8_t packed[8])
{
    double corner[8], largest = 0.0;
    memset(packed, 0, 8);
    if (lr_is_cubic(v) || v->objects != NULL ||
        (v->triangle_cells != NULL && lr_is_triangle_cell(v, c)))
        return;
    lr_corners(v, c, corner);
    for (int b = 0; b < 8; b++) {
        corner[b] -= v->threshold;
        largest = fmax(largest, fabs(corner[b]));
    }
    for (int b = 0; b < 8 && largest > 0.0; b++)
        packed[b] = (int8_t)lrint(corner[b] / largest * 127.0);
}

/* Number a near brick's surface cells. */
static void number_cells(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const lr_cd_distances *f = context;
    const uint32_t entry = lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2]));
    memset(f->first[number], 0, sizeof *f->first);
    if (lr_entry_words(entry) == 0)
        return;
    for (int n = 0; n < LR_CELLS; n++) {
        const int32_t c[3] = {lr_along(n, 0), lr_along(n, 1), lr_along(n, 2)};
        if (lr_entry_has(v, entry, c))
            f->near[number][n] = (uint8_t)(LR_CD_SURFACE | f->first[number][c[2] / 2]++);
    }
}

static void pack_cells(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const lr_cd_distances *f = context;
    for (int n = 0; n < LR_CELLS; n++)
        if (f->near[number][n] & LR_CD_SURFACE) {
            const int32_t c[3] = {LR_SIDE * b[0] + lr_along(n, 0), LR_SIDE * b[1] + lr_along(n, 1),
                                  LR_SIDE * b[2] + lr_along(n, 2)};
            const uint32_t of = f->near[number][n] & (LR_CD_SURFACE - 1u);
            pack(v, c, f->corners[f->first[number][lr_along(n, 2) / 2] + of]);
        }
}

lr_status lr_cd_find_corners(const lr_volume *v, lr_cd_distances *f, uint32_t n_near,
                             const lr_watch *watch, lr_error *error)
{
    f->first = malloc((n_near + (size_t)1) * sizeof *f->first);
    f->corners = malloc((v->n_surface_cells + 1) * sizeof *f->corners);
    if (f->first == NULL || f->corners == NULL)
        return lr_fail_memory(error, v->n_surface_cells * sizeof *f->corners,
                              "corners of surface cells");
    lr_status status = lr_near_each(v, f->bricks, number_cells, f, watch, error);
    if (status != LR_OK)
        return status;
    uint32_t sum = 0;
    for (uint32_t n = 0; n < n_near; n++)
        for (int pair = 0; pair < LR_CD_PAIRS; pair++) {
            const uint32_t count = f->first[n][pair];
            f->first[n][pair] = sum;
            sum += count;
        }
    return lr_near_each(v, f->bricks, pack_cells, f, watch, error);
}
