/* Spheres of empty space, by distance transforms.
 *
 * Every empty cell knows a radius: from any of its points the ray can go on so far, in
 * any direction, and meets nothing. It goes by such jumps along the continuous ray and,
 * where the radius is below one voxel, by exact steps from cell to cell. Radii come from
 * the distance to the surface cells and their 26 neighbours, which is just the gap
 * between the two cubes; where the metric is not Euclid's, its value is turned into the
 * least Euclidean distance that it allows: d / sqrt(3) for city-block, d / sqrt(11) for
 * chamfer 3-4-5, d for chessboard.
 *
 * The paper's own step is d (chamfer: a third of it) from the surface cells themselves, at
 * least one voxel, and nothing exact near the surface. It misses cells, and says so.
 *
 * Source: Zuiderveld, Koning and Viergever 1992; the hybrid with exact steps is that of
 * Cohen and Sheffer 1994. Departures: 1. memory follows the surface: bricks near it hold a
 * radius per cell, up to LR_REACH, found in the window around them, others one radius;
 * 2. radii are rounded down to sixteenths of a voxel; 3. jumps are measured in voxels, so
 * that t may have any scale.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/near.h"
#include "error.h"
#include "trace/traverser.h"

enum { SAFE = 0, PAPER = 1 };

enum {
    PER_VOXEL = 16, /* radii are counted in these */
    RUN = 8,
    BLOCK_CELLS = (8 * RUN + 2 * LR_REACH) * LR_WINDOW * LR_WINDOW,
};

typedef struct radii {
    int32_t metric, step;
    uint32_t *bricks;     /* [table]: index into near, or LR_FAR_BRICK | radius of the brick */
    uint8_t (*near)[512]; /* radius, lr_cell_in_brick; 0 for single steps and surface cells */
} radii;

static const int32_t metrics[] = {
    LR_METRIC_CHAMFER345,
    LR_METRIC_CHESSBOARD,
    LR_METRIC_CITYBLOCK,
    LR_METRIC_EUCLID,
}; /* by choice */

void lr_radc_free(void *data)
{
    radii *f = data;
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->near);
    free(f);
}

/* The Euclidean length that the metric's value stands for, in cells. */
static double length_of(const radii *f, const void *dist, size_t at)
{
    const bool safe = f->step == SAFE;
    if (f->metric == LR_METRIC_EUCLID)
        return (double)((const float *)dist)[at];
    const double d = ((const uint8_t *)dist)[at];
    if (f->metric == LR_METRIC_CHAMFER345)
        return d / (safe ? sqrt(11.0) : 3.0);
    if (f->metric == LR_METRIC_CITYBLOCK && safe)
        return d / sqrt(3.0);
    return d;
}

/* Down to sixteenths; a float's rounding up is taken back. */
static uint32_t to_radius(double length, uint32_t most)
{
    const double radius = floor(length * (1.0 - 0x1p-20) * PER_VOXEL);
    return radius < most ? (uint32_t)radius : most;
}

static size_t entry_nbytes(const radii *f)
{
    return f->metric == LR_METRIC_EUCLID ? sizeof(float) : sizeof(uint8_t);
}

/* Near bricks side by side along x, which share one transform of their windows. */
typedef struct run {
    radii *made;
    lr_status status;
    lr_error *error;
    int n;
    int32_t last[3];
    uint32_t number; /* of the last */
    lr_window window[RUN];
    uint8_t cells[BLOCK_CELLS];
    float dist[BLOCK_CELLS]; /* room for either type */
} run;

/* The radii of the bricks in the run, which is empty then. */
static void finish_run(run *j)
{
    const radii *f = j->made;
    const int count = j->n, nx = 8 * count + 2 * LR_REACH;
    j->n = 0;
    if (count == 0 || j->status != LR_OK)
        return;
    uint8_t *cell = j->cells;
    for (int z = 0; z < LR_WINDOW; z++)
        for (int y = 0; y < LR_WINDOW; y++)
            for (int x = 0; x < nx; x++) {
                const int k = lr_max_i(0, lr_min_i(x / 8 - 1, count - 1));
                *cell++ = j->window[k][z][y] >> (x - 8 * k) & 1;
            }
    j->status = lr_distance(j->cells, nx, LR_WINDOW, LR_WINDOW, f->metric, j->dist, NULL, j->error);
    for (int k = 0; k < count; k++)
        for (int n = 0; n < 512; n++) {
            const int x = LR_REACH + 8 * k + (n & 7), y = LR_REACH + (n >> 3 & 7);
            const int z = LR_REACH + (n >> 6);
            const double length = length_of(f, j->dist, (size_t)((z * LR_WINDOW + y) * nx + x));
            const uint32_t number = j->number + 1 - (uint32_t)(count - k);
            f->near[number][n] = (uint8_t)to_radius(length, LR_REACH * PER_VOXEL);
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
    if (j->made->step == SAFE)
        lr_window_grow(j->window[j->n]);
    memcpy(j->last, b, sizeof j->last);
    j->number = number;
    j->n++;
}

static lr_status cell_radii(radii *f, const lr_volume *v, const lr_watch *watch, lr_error *error)
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

/* Radii of the bricks that are not near the surface: of the near ones, which are just those
 * that hold surface and their neighbours, every cell of such a brick is that far away. */
static lr_status brick_radii(radii *f, const lr_volume *v, const lr_watch *watch, lr_error *error)
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
    const radii safely = {.metric = f->metric, .step = SAFE};
    for (size_t at = 0; status == LR_OK && at < n; at++) {
        if (lr_stopped_now_and_then(watch, at))
            status = lr_fail_stopped(error);
        if (f->bricks[at] & LR_FAR_BRICK)
            f->bricks[at] =
                LR_FAR_BRICK | to_radius(8.0 * length_of(&safely, dist, at), LR_FAR_BRICK - 1);
    }
    free(near);
    free(dist);
    return status;
}

lr_status lr_radc_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                        void **data, uint64_t *nbytes, lr_error *error)
{
    uint32_t n_near = 0;
    radii *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "radii");
    f->metric = metrics[choices[0]];
    f->step = choices[1];
    lr_status status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
    *nbytes = sizeof *f + lr_table_count(v) * sizeof *f->bricks + n_near * sizeof *f->near;
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
        lr_radc_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

/* How far it is empty around cell c, in voxels. */
LR_INLINE double radius_at(const radii *f, const lr_volume *v, const int32_t c[3])
{
    const uint32_t at = f->bricks[lr_table_at(v, c[0] >> 3, c[1] >> 3, c[2] >> 3)];
    const uint32_t radius =
        at & LR_FAR_BRICK ? at & ~LR_FAR_BRICK : f->near[at][lr_cell_in_brick(c)];
    return radius * (1.0 / PER_VOXEL);
}

typedef struct pace {
    double per_voxel; /* t */
    double slack;     /* voxels by which a point of the ray may be off, from above */
    double t;         /* of the last sample, by the paper's steps */
} pace;

LR_INLINE void begin_walk(const lr_ray *r, const lr_cursor *u, pace *p)
{
    double most = 0.0;
    for (int a = 0; a < 3; a++)
        most = fmax(most, fabs(r->o[a]) + r->hi[a] + 1.0);
    p->per_voxel = 1.0 / hypot(hypot(r->d[0], r->d[1]), r->d[2]);
    p->slack = most * 0x1p-50; /* o + t d, with t from a plane: four roundings of 2^-53 */
    p->t = u->t;
}

/* The cell of the point at t, never behind c; false outside the volume. */
LR_INLINE bool cell_at(const lr_ray *r, double t, int32_t c[3])
{
    for (int a = 0; a < 3; a++) {
        if (r->s[a] == 0)
            continue;
        const double q = lr_floor_along(r->o[a] + t * r->d[a], r->s[a]);
        if (!(q >= r->lo[a] && q <= r->hi[a]))
            return false;
        const int32_t to = (int32_t)q;
        c[a] = r->s[a] > 0 ? lr_max_i(to, c[a]) : lr_min_i(to, c[a]);
    }
    return true;
}

/* Go on as far as it is empty, but for the slack; or, where that is not even a voxel,
 * to the next cell. */
LR_INLINE bool next_safe(const lr_ray *r, lr_cursor *u, double radius, const pace *p, bool *jump)
{
    const double length = radius - p->slack;
    *jump = radius >= 1.0 && length >= p->slack;
    if (!*jump)
        return lr_step(r, u);
    const double t = u->t + length * p->per_voxel;
    if (!(t <= r->t_max) || !cell_at(r, t, u->c))
        return false;
    u->t = t;
    u->axis = -1;
    return true;
}

LR_INLINE bool walk_safe(const radii *f, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                         const pace *p, bool first, lr_tally *tally)
{
    bool jump;
    if (!first && !lr_step(r, u))
        return false;
    for (;;) {
        lr_count_cell(tally);
        if (lr_wanted(v, u->c))
            return true;
        if (!next_safe(r, u, radius_at(f, v, u->c), p, &jump))
            return false;
        lr_count_jump(tally, jump);
    }
}

/* Samples whose distance is the last one's radius, a voxel at least. */
LR_INLINE bool walk_paper(const radii *f, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                          pace *p, bool first, lr_tally *tally)
{
    int32_t c[3];
    memcpy(c, u->c, sizeof c);
    if (first) {
        lr_count_cell(tally);
        if (lr_wanted(v, c))
            return true;
    }
    for (;;) {
        const double radius = radius_at(f, v, c), t = p->t + fmax(radius, 1.0) * p->per_voxel;
        if (!(t > p->t && t <= r->t_max) || !cell_at(r, t, c))
            return false;
        p->t = t;
        lr_count_cell(tally);
        lr_count_jump(tally, radius > 1.0);
        if (lr_wanted(v, c) && memcmp(c, u->c, sizeof c) != 0 && lr_reach(r, u, c, c))
            return true;
    }
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u, pace *p,
                    bool first, lr_tally *tally)
{
    const radii *f = data;
    return f->step == SAFE ? walk_safe(f, v, r, u, p, first, tally)
                           : walk_paper(f, v, r, u, p, first, tally);
}

#define LR_NAME                                    radc
#define LR_STATE                                   pace
#define LR_START(data, volume, ray, cursor, state) begin_walk(ray, cursor, state)
#define LR_WALK                                    walk
#include "trace/batch.h"
