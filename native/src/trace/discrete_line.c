/* The flag by which discrete lines change their steps.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/discrete_line.h"

#include "base/error.h"

static void flag_cells(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const lr_proximity *f = context;
    uint64_t *mask = f->near[number];
    lr_window window;
    memset(mask, 0, sizeof(lr_mask));
    lr_window_fill(v, b, window);
    lr_window_grow(window);
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++)
            lr_mask_add_row(mask, y, z,
                            window[LR_NEAR_RADIUS + z][LR_NEAR_RADIUS + y] >> LR_NEAR_RADIUS);
}

lr_status lr_proximity_build(lr_proximity *f, const lr_volume *v, const lr_watch *watch,
                             uint64_t *nbytes, lr_error *error)
{
    uint32_t n_near = 0;
    *f = (lr_proximity){NULL, NULL};
    lr_status status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
    if (status != LR_OK)
        return status;
    *nbytes += lr_table_count(v) * sizeof *f->bricks + n_near * sizeof *f->near;
    f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
    if (f->near == NULL)
        return lr_fail_memory(error, n_near * sizeof *f->near, "flags");
    return lr_near_each(v, f->bricks, flag_cells, f, watch, error);
}

void lr_proximity_free(lr_proximity *f)
{
    free(f->bricks);
    free(f->near);
}
