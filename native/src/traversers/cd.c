/* Chessboard distance: cubic macro regions.
 *
 * Every empty cell knows its chessboard distance d to the nearest surface cell;
 * the cube of half-size d - 1 around it is empty, so the ray leaves it in one
 * jump. Next to the surface d is 1 and the ray goes cell by cell.
 *
 * Source: Sramek 1994, section 3.2.2. Departures: 1. memory follows the surface:
 * bricks that hold surface and their 26 neighbours store a distance per cell, all
 * others their distance in bricks; 2. distances per cell end at REACH + 1, which
 * is what two bricks side by side can see; 3. the cube is cut to the grid.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

enum {
    REACH = 8,            /* cells looked at around a brick */
    SIDE = 8 + 2 * REACH, /* of the window in which a brick's distances are found */
};

#define FAR_BRICK 0x80000000u /* a distance in bricks, not an index into near */

typedef struct distances {
    uint32_t *bricks;     /* [table]: index into near, or FAR_BRICK | distance in bricks */
    uint8_t (*near)[512]; /* distance in cells, x + 8 y + 64 z */
} distances;

void lr_cd_free(void *data)
{
    distances *f = data;
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->near);
    free(f);
}

/* Distances in bricks to the nearest brick with surface. */
static lr_status brick_distances(const lr_volume *v, uint8_t *dist, const lr_watch *watch,
                                 lr_error *error)
{
    size_t n = lr_table_count(v);
    uint8_t *holds = malloc(n);
    if (holds == NULL)
        return lr_fail_memory(error, n, "brick distances");
    for (size_t at = 0; at < n; at++)
        holds[at] = (v->table[at] & 0xff) != 0;
    const lr_watch quiet = {watch != NULL ? watch->stop : NULL, NULL};
    lr_status status = lr_distance(holds, v->table_size[0], v->table_size[1], v->table_size[2],
                                   LR_METRIC_CHESSBOARD, dist, &quiet, error);
    free(holds);
    return status;
}

/* Put the surface cells of one brick into the window at offset o: rows along x. */
static void add_brick(const uint64_t words[8], uint32_t rows[SIDE][SIDE], const int o[3])
{
    for (int z = 0; z < 8; z++)
        for (int y = 0; y < 8; y++) {
            int word = 2 * (y >> 2) + 4 * (z >> 2), bit = 4 * (y & 3) + 16 * (z & 3);
            uint32_t cells =
                (uint32_t)(words[word] >> bit & 15) | (uint32_t)(words[word + 1] >> bit & 15) << 4;
            rows[o[2] + z][o[1] + y] |= cells << o[0];
        }
}

static bool gather(const lr_volume *v, const int32_t b[3], uint32_t rows[SIDE][SIDE])
{
    bool any = false;
    memset(rows, 0, SIDE * sizeof rows[0]);
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
        uint32_t entry = v->table[lr_table_at(v, q[0], q[1], q[2])];
        if ((entry & 0xff) == 0)
            continue;
        add_brick(v->cells[entry >> 8], rows, (const int[3]){8 * o[0], 8 * o[1], 8 * o[2]});
        any = true;
    }
    return any;
}

/* Grow the set by one cell in every direction, diagonals too. */
static void dilate(uint32_t rows[SIDE][SIDE], uint32_t spare[SIDE][SIDE])
{
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++) {
            uint32_t row = rows[z][y];
            spare[z][y] = row | row << 1 | row >> 1;
        }
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++)
            rows[z][y] =
                spare[z][y] | spare[z][y > 0 ? y - 1 : y] | spare[z][y < SIDE - 1 ? y + 1 : y];
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++)
            spare[z][y] =
                rows[z][y] | rows[z > 0 ? z - 1 : z][y] | rows[z < SIDE - 1 ? z + 1 : z][y];
    memcpy(rows, spare, SIDE * sizeof rows[0]);
}

/* The distance of a cell is the number of growths that cover it. */
static void cell_distances(const lr_volume *v, const int32_t b[3], uint8_t dist[512])
{
    uint32_t rows[SIDE][SIDE], spare[SIDE][SIDE];
    memset(dist, 0, 512);
    if (!gather(v, b, rows)) {
        memset(dist, REACH + 1, 512);
        return;
    }
    for (int step = 0; step <= REACH; step++) {
        uint32_t all = 0xff;
        for (int z = 0; z < 8; z++)
            for (int y = 0; y < 8; y++) {
                uint32_t covered = rows[z + REACH][y + REACH] >> REACH & 0xff;
                all &= covered;
                for (int x = 0; x < 8; x++)
                    dist[x + 8 * y + 64 * z] += !(covered >> x & 1);
            }
        if (all == 0xff)
            return;
        dilate(rows, spare);
    }
}

lr_status lr_cd_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                      void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    size_t n = lr_table_count(v);
    distances *f = calloc(1, sizeof *f);
    uint8_t *dist = malloc(n);
    lr_status status = LR_OK;
    if (f != NULL)
        f->bricks = malloc(n * sizeof *f->bricks);
    if (f == NULL || dist == NULL || f->bricks == NULL)
        status = lr_fail_memory(error, n * (1 + sizeof *f->bricks), "brick distances");
    if (status == LR_OK)
        status = brick_distances(v, dist, watch, error);
    uint32_t n_near = 0;
    for (size_t at = 0; status == LR_OK && at < n; at++)
        f->bricks[at] = dist[at] <= 1 ? n_near++ : FAR_BRICK | dist[at];
    free(dist);
    if (status == LR_OK) {
        f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
        if (f->near == NULL)
            status = lr_fail_memory(error, (uint64_t)n_near * sizeof *f->near, "cell distances");
        *nbytes = sizeof *f + n * sizeof *f->bricks + (uint64_t)n_near * sizeof *f->near;
    }
    for (int32_t z = 0; status == LR_OK && z < v->table_size[2]; z++)
        for (int32_t y = 0; status == LR_OK && y < v->table_size[1]; y++) {
            if (lr_stopped(watch)) {
                status = lr_fail_stopped(error);
                break;
            }
            for (int32_t x = 0; x < v->table_size[0]; x++) {
                uint32_t at = f->bricks[lr_table_at(v, x, y, z)];
                if (!(at & FAR_BRICK))
                    cell_distances(v, (const int32_t[3]){x, y, z}, f->near[at]);
            }
            lr_progress(watch, (z + (y + 1.0) / v->table_size[1]) / v->table_size[2]);
        }
    if (status != LR_OK) {
        lr_cd_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

LR_INLINE bool empty_cube(const void *data, const lr_volume *v, const lr_ray *r, int *state,
                          const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    (void)state, (void)tally;
    const distances *f = data;
    uint32_t at = f->bricks[lr_table_at(v, c[0] >> 3, c[1] >> 3, c[2] >> 3)];
    if (at & FAR_BRICK) {
        int32_t n = (int32_t)(at & 0xff) - 1;
        for (int a = 0; a < 3; a++) {
            lo[a] = ((c[a] >> 3) - n) * 8;
            hi[a] = ((c[a] >> 3) + n) * 8 + 7;
        }
    } else {
        int32_t n = f->near[at][(c[0] & 7) + 8 * (c[1] & 7) + 64 * (c[2] & 7)] - 1;
        if (n < 0)
            return true;
        for (int a = 0; a < 3; a++) {
            lo[a] = c[a] - n;
            hi[a] = c[a] + n;
        }
    }
    lr_cut_box(r, lo, hi);
    return false;
}

#define LR_NAME cd
#define LR_BOX  empty_cube
#include "trace/batch.h"
