/* Bricks at and next to the surface, and windows of cells around them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/narrow_band.h"

#include "base/error.h"

lr_status lr_near_bricks(const lr_volume *v, uint32_t **index, uint32_t *n_near,
                         const lr_watch *watch, lr_error *error)
{
    const size_t n = lr_table_count(v);
    uint8_t *holds = malloc(n), *dist = malloc(n);
    uint32_t *made = malloc(n * sizeof *made);
    lr_status status = LR_OK;
    if (holds == NULL || dist == NULL || made == NULL)
        status = lr_fail_memory(error, n * (2 + sizeof *made), "brick distances");
    if (status == LR_OK) {
        for (size_t at = 0; at < n && !lr_stopped_now_and_then(watch, at); at++)
            holds[at] =
                lr_entry_words(lr_entry_at(v, at)) != 0; /* if given up, lr_distance says so */
        const lr_watch quiet = {watch != NULL ? watch->stop : NULL, NULL};
        status = lr_distance(holds, v->table_size[0], v->table_size[1], v->table_size[2],
                             LR_METRIC_CHESSBOARD, dist, &quiet, error);
    }
    if (status == LR_OK) {
        *n_near = 0;
        for (size_t at = 0; at < n && status == LR_OK; at++) {
            made[at] = dist[at] <= 1 ? (*n_near)++ : LR_FAR_BRICK | dist[at];
            if (lr_stopped_now_and_then(watch, at))
                status = lr_fail_stopped(error);
        }
        *index = made;
        made = NULL;
    }
    free(holds);
    free(dist);
    free(made);
    return status;
}

/* Put the surface cells of one brick into the window at offset o. */
static void add_brick(const lr_mask mask, lr_window window, const int o[3])
{
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++)
            window[o[2] + z][o[1] + y] |= lr_mask_row(mask, y, z) << o[0];
}

bool lr_window_fill(const lr_volume *v, const int32_t b[3], lr_window window)
{
    bool any = false;
    memset(window, 0, sizeof(lr_window));
    for (int n = 0; n < 27; n++) {
        const int o[3] = {n % 3, n / 3 % 3, n / 9};
        int32_t q[3];
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            q[a] = b[a] + o[a] - 1;
            inside = inside && q[a] >= 0 && q[a] < v->table_size[a];
        }
        if (!inside)
            continue;
        const uint32_t entry = lr_entry_at(v, lr_table_at(v, q[0], q[1], q[2]));
        if (lr_entry_words(entry) == 0)
            continue;
        add_brick(lr_entry_mask(v, entry), window,
                  (const int[3]){LR_SIDE * o[0], LR_SIDE * o[1], LR_SIDE * o[2]});
        any = true;
    }
    return any;
}

void lr_window_grow(lr_window window)
{
    enum { N = LR_WINDOW };
    lr_window dilated;
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++) {
            uint32_t row = window[z][y];
            dilated[z][y] = row | row << 1 | row >> 1;
        }
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            window[z][y] =
                dilated[z][y] | dilated[z][y > 0 ? y - 1 : y] | dilated[z][y < N - 1 ? y + 1 : y];
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            dilated[z][y] =
                window[z][y] | window[z > 0 ? z - 1 : z][y] | window[z < N - 1 ? z + 1 : z][y];
    memcpy(window, dilated, sizeof dilated);
}

lr_status lr_near_each(const lr_volume *v, const uint32_t *index, lr_near_fill *fill, void *context,
                       const lr_watch *watch, lr_error *error)
{
    const size_t n = lr_table_count(v);
    int32_t b[3] = {-1, 0, 0};
    for (size_t at = 0; lr_next_brick(v->table_size, b); at++) {
        if (b[0] == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (b[0] == 0)
            lr_progress(watch, (double)at / (double)n);
        if (!(index[at] & LR_FAR_BRICK))
            fill(v, b, index[at], context);
    }
    lr_progress(watch, 1.0);
    return LR_OK;
}
