/* Empty radii: the distance around every cell without surface.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/empty_radius.h"

#include "base/error.h"

enum {
    RUN = 8,
    BLOCK_CELLS = (LR_SIDE * RUN + 2 * LR_NEAR_RADIUS) * LR_WINDOW * LR_WINDOW,
};

/* The Euclidean length that the metric's value stands for, in cells. */
static double length_of(const lr_radii *f, const void *dist, size_t at)
{
    const bool safe = f->safe;
    if (f->metric == LR_METRIC_EUCLID)
        return (double)((const float *)dist)[at];
    const double d = ((const uint8_t *)dist)[at];
    if (f->metric == LR_METRIC_CHAMFER345)
        return d / (safe ? sqrt(11.0) : 3.0);
    if (f->metric == LR_METRIC_CITYBLOCK && safe)
        return d / sqrt(3.0);
    return d;
}

/* Rounded down to sixteenths; the float may have been rounded up, so its last bit is undone. */
static uint32_t to_radius(double length, uint32_t most)
{
    const double radius = floor(length * (1.0 - 0x1p-20) * LR_RADIUS_STEPS);
    return radius < most ? (uint32_t)radius : most;
}

static size_t entry_nbytes(const lr_radii *f)
{
    return f->metric == LR_METRIC_EUCLID ? sizeof(float) : sizeof(uint8_t);
}

/* Near bricks side by side along x, which share one transform of their windows. */
typedef struct run {
    lr_radii *made;
    lr_status status;
    lr_error *error;
    int n;
    int32_t last[3];
    uint32_t number; /* of the last */
    lr_window window[RUN];
    uint8_t cells[BLOCK_CELLS];
    float dist[BLOCK_CELLS]; /* room for either type */
} run;

/* Compute the radii of the bricks in the run and empty it. */
static void finish_run(run *j)
{
    const lr_radii *f = j->made;
    const int count = j->n, nx = LR_SIDE * count + 2 * LR_NEAR_RADIUS;
    j->n = 0;
    if (count == 0 || j->status != LR_OK)
        return;
    uint8_t *cell = j->cells;
    for (int z = 0; z < LR_WINDOW; z++)
        for (int y = 0; y < LR_WINDOW; y++)
            for (int x = 0; x < nx; x++) {
                const int k = lr_max_i(0, lr_min_i((x - LR_NEAR_RADIUS) / LR_SIDE, count - 1));
                *cell++ = j->window[k][z][y] >> (x - LR_SIDE * k) & 1;
            }
    j->status = lr_distance(j->cells, nx, LR_WINDOW, LR_WINDOW, f->metric, j->dist, NULL, j->error);
    for (int k = 0; k < count; k++)
        for (int n = 0; n < LR_CELLS; n++) {
            const int x = LR_NEAR_RADIUS + LR_SIDE * k + lr_along(n, 0);
            const int y = LR_NEAR_RADIUS + lr_along(n, 1), z = LR_NEAR_RADIUS + lr_along(n, 2);
            const double length = length_of(f, j->dist, (size_t)((z * LR_WINDOW + y) * nx + x));
            const uint32_t number = j->number + 1 - (uint32_t)(count - k);
            f->near[number][n] = (uint8_t)to_radius(length, LR_NEAR_RADIUS * LR_RADIUS_STEPS);
        }
}

static void add_to_run(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    run *j = context;
    const bool next =
        b[0] == j->last[0] + 1 && b[1] == j->last[1] && b[2] == j->last[2] && j->n < RUN;
    if (!next)
        finish_run(j);
    lr_window_fill(v, b, j->window[j->n]);
    if (j->made->safe)
        lr_window_grow(j->window[j->n]);
    memcpy(j->last, b, sizeof j->last);
    j->number = number;
    j->n++;
}

static lr_status cell_radii(lr_radii *f, const lr_volume *v, const lr_watch *watch, lr_error *error)
{
    run *j = calloc(1, sizeof *j);
    if (j == NULL)
        return lr_fail_memory(error, sizeof *j, "radii");
    j->made = f;
    j->error = error;
    lr_status status = lr_near_each(v, f->bricks, add_to_run, j, watch, error);
    finish_run(j);
    status = status == LR_OK ? j->status : status;
    free(j);
    return status;
}

/* Radii of the bricks that are not near: the least distance from any of their cells to a near
 * brick; near bricks are those that hold surface and their neighbours. */
static lr_status brick_radii(lr_radii *f, const lr_volume *v, const lr_watch *watch,
                             lr_error *error)
{
    const size_t n = lr_table_count(v);
    uint8_t *near = malloc(n);
    void *dist = malloc(n * entry_nbytes(f));
    lr_status status = LR_OK;
    if (near == NULL || dist == NULL)
        status = lr_fail_memory(error, n * (1 + entry_nbytes(f)), "radii of bricks");
    if (status == LR_OK) {
        for (size_t at = 0; at < n && !lr_stopped_now_and_then(watch, at); at++)
            near[at] = !(f->bricks[at] & LR_FAR_BRICK); /* if given up, lr_distance says so */
        const lr_watch quiet = {watch != NULL ? watch->stop : NULL, NULL};
        status = lr_distance(near, v->table_size[0], v->table_size[1], v->table_size[2], f->metric,
                             dist, &quiet, error);
    }
    const lr_radii safely = {.metric = f->metric, .safe = true};
    for (size_t at = 0; status == LR_OK && at < n; at++) {
        if (lr_stopped_now_and_then(watch, at))
            status = lr_fail_stopped(error);
        if (f->bricks[at] & LR_FAR_BRICK)
            f->bricks[at] =
                LR_FAR_BRICK | to_radius(LR_SIDE * length_of(&safely, dist, at), LR_FAR_BRICK - 1);
    }
    free(near);
    free(dist);
    return status;
}

lr_status lr_radii_make(const lr_volume *v, int32_t metric, bool safe, const lr_watch *watch,
                        lr_radii **radii, lr_error *error)
{
    uint32_t n_near = 0;
    lr_radii *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "radii");
    f->volume = v;
    f->metric = metric;
    f->safe = safe;
    lr_status status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
    f->nbytes = sizeof *f + lr_table_count(v) * sizeof *f->bricks + n_near * sizeof *f->near;
    if (status == LR_OK)
        status = brick_radii(f, v, watch, error);
    if (status == LR_OK) {
        f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
        if (f->near == NULL)
            status = lr_fail_memory(error, n_near * sizeof *f->near, "radii");
    }
    if (status == LR_OK)
        status = cell_radii(f, v, watch, error);
    if (status != LR_OK) {
        lr_radii_free(f);
        return status;
    }
    *radii = f;
    return LR_OK;
}

void lr_radii_free(lr_radii *f)
{
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->near);
    free(f);
}
