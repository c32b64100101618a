/* Chessboard distance: cubic macro regions.
 *
 * Every empty cell stores its chessboard distance d to the nearest surface cell;
 * the cube of half-size d - 1 around it is empty, so the ray leaves it in one
 * jump. Next to the surface d is 1 and the ray goes cell by cell.
 *
 * Source: Sramek 1994, section 3.2.2. Departures: 1. memory grows with the surface:
 * bricks that hold surface and their 26 neighbours store a distance per cell, all
 * others their distance in bricks; 2. distances per cell end at LR_NEAR_RADIUS + 1, which
 * is what a window of neighbouring bricks shows; 3. the cube is clipped to the grid.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "distance/narrow_band.h"
#include "grid/triangle_cells.h"
#include "trace/ray_samples.h"
#include "traversers/cd_corners.h"
#include "traversers/cd_packet.h"

typedef lr_cd_distances distances;

enum { ROW = (1 << LR_SIDE) - 1 }; /* the cells of a brick's row */

void lr_cd_free(void *data)
{
    distances *f = data;
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->near);
    free(f->first);
    free(f->corners);
    free(f);
}

/* Do few of the surface cells keep triangles? Those are tested ray by ray, so packets are slower
 * where most do. */
static bool mostly_field(const lr_volume *v)
{
    return v->triangle_cells == NULL ||
           2 * (uint64_t)v->triangle_cells->n_cells < v->n_surface_cells;
}

/* What the option `rays` asks for; NULL: one at a time. */
enum { IN_LANES, ALONE, IN_LANES_AVX2, IN_LANES_PORTABLE };

static const lr_cd_packet *packet_of(const lr_volume *v, int32_t choice)
{
    if (choice == ALONE || v->planes[0] != NULL || v->transfer != NULL || lr_is_cubic(v) ||
        !mostly_field(v))
        return NULL;
#ifdef LR_X86
    const int32_t simd = lr_cpu_simd();
    if (simd == LR_SIMD_AVX512 && choice == IN_LANES)
        return &lr_cd_packet_avx512;
    if (simd >= LR_SIMD_AVX2 && choice != IN_LANES_PORTABLE)
        return &lr_cd_packet_avx2;
#endif
    return &lr_cd_packet_portable;
}

/* Lanes count bytes from the beginnings of arrays in 31 bits. */
static bool can_gather(const lr_volume *v, uint32_t n_near)
{
    return (uint64_t)n_near * LR_CELLS < INT32_MAX && v->n_surface_cells < INT32_MAX / 8 &&
           lr_table_count(v) < INT32_MAX / 4;
}

/* Grow the set by one cell in every direction, for the time number `step`, as far from the window's
 * border as it has not been wrong before. */
static void grow(lr_window window, int step)
{
    const int lo = step, hi = LR_WINDOW - 1 - step;
    lr_window spare;
    for (int z = lo - 1; z <= hi + 1; z++)
        for (int y = lo; y <= hi; y++) {
            const uint32_t row = window[z][y - 1] | window[z][y] | window[z][y + 1];
            spare[z][y] = row | row << 1 | row >> 1;
        }
    for (int z = lo; z <= hi; z++)
        for (int y = lo; y <= hi; y++)
            window[z][y] = spare[z - 1][y] | spare[z][y] | spare[z + 1][y];
}

/* Numbers of the cells of a layer of a brick, cell (x, y) as bit x + 8 y of each binary digit. */
enum { DIGITS = 4 };
typedef uint64_t counts[LR_SIDE][DIGITS];

/* Count the cells that the set does not cover; false: there are none. */
static bool count_uncovered(lr_window window, counts layers)
{
    uint64_t any = 0;
    for (int z = 0; z < LR_SIDE; z++) {
        uint64_t covered = 0;
        for (int y = 0; y < LR_SIDE; y++)
            covered |=
                (uint64_t)(window[z + LR_NEAR_RADIUS][y + LR_NEAR_RADIUS] >> LR_NEAR_RADIUS & ROW)
                << LR_SIDE * y;
        uint64_t carry = ~covered;
        any |= carry;
        for (int d = 0; d < DIGITS; d++) {
            const uint64_t sum = layers[z][d] ^ carry;
            carry &= layers[z][d];
            layers[z][d] = sum;
        }
    }
    return any != 0;
}

/* The bits of a byte, a byte each. */
LR_INLINE uint64_t spread(uint64_t byte)
{
    const uint64_t ones = 0x0101010101010101u;
    return (((byte & 0xff) * ones & 0x8040201008040201u) + 0x7f * ones) >> 7 & ones;
}

/* The distance of a cell is the number of growths that do not cover it. */
static void cell_distances(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const distances *f = context;
    uint8_t *dist = f->near[number];
    lr_window window;
    counts layers = {0};
    if (!lr_window_fill(v, b, window)) {
        memset(dist, LR_NEAR_RADIUS + 1, LR_CELLS);
        return;
    }
    for (int step = 1; count_uncovered(window, layers) && step <= LR_NEAR_RADIUS; step++)
        grow(window, step);
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++) {
            uint64_t row = 0;
            for (int d = 0; d < DIGITS; d++)
                row += spread(layers[z][d] >> LR_SIDE * y) << d;
            for (int x = 0; x < LR_SIDE; x++)
                dist[lr_in_brick(x, y, z)] = (uint8_t)(row >> LR_SIDE * x);
        }
}

lr_status lr_cd_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                      void **data, uint64_t *nbytes, lr_error *error)
{
    uint32_t n_near = 0;
    distances *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "distances");
    f->packet = packet_of(v, choices[0]);
    lr_status status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
    if (status == LR_OK) {
        f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
        if (f->near == NULL)
            status = lr_fail_memory(error, (uint64_t)n_near * sizeof *f->near, "cell distances");
    }
    if (status == LR_OK)
        status = lr_near_each(v, f->bricks, cell_distances, f, watch, error);
    if (!can_gather(v, n_near))
        f->packet = NULL;
    if (status == LR_OK && f->packet != NULL)
        status = lr_cd_find_corners(v, f, n_near, watch, error);
    if (status != LR_OK) {
        lr_cd_free(f);
        return status;
    }
    *nbytes = sizeof *f + lr_table_count(v) * sizeof *f->bricks + n_near * sizeof *f->near;
    if (f->packet != NULL)
        *nbytes += n_near * sizeof *f->first + v->n_surface_cells * sizeof *f->corners;
    *data = f;
    return LR_OK;
}

LR_INLINE bool empty_cube(const void *data, const lr_volume *v, const lr_ray *r, int *state,
                          const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    (void)state, (void)tally;
    const distances *f = data;
    uint32_t at = f->bricks[lr_table_of(v, c[0], c[1], c[2])];
    if (at & LR_FAR_BRICK) {
        int32_t n = (int32_t)(at & 0xff) - 1;
        for (int a = 0; a < 3; a++) {
            lo[a] = (lr_brick_of(c[a]) - n) * LR_SIDE;
            hi[a] = (lr_brick_of(c[a]) + n) * LR_SIDE + LR_SIDE - 1;
        }
    } else {
        int32_t n = f->near[at][lr_in_brick(c[0], c[1], c[2])] - 1;
        if (n < 0 || n >= LR_CD_SURFACE - 1)
            return true;
        for (int a = 0; a < 3; a++) {
            lo[a] = c[a] - n;
            hi[a] = c[a] + n;
        }
    }
    lr_cut_box(r, lo, hi);
    return false;
}

/* Rays by the packet's own instructions. */
static void trace_packet(const lr_volume *v, const lr_cd_distances *f, const lr_rays *rays,
                         uint64_t first, uint64_t end, const lr_trace_options *options,
                         const lr_hits *hits, lr_counters *counters)
{
    f->packet->trace(v, f, rays, first, end, options, hits, counters);
}

/* Of volumes with a transfer function, whose visible cells have no numbers. */
static lr_empty_cubes cubes_of(const void *data)
{
    const distances *f = data;
    return (lr_empty_cubes){f->bricks, f->near};
}

#define LR_NAME        cd
#define LR_BOX         empty_cube
#define LR_EMPTY_CUBES cubes_of
#define LR_FITS        lr_cd_fits_packet
#define LR_PACKET      trace_packet
#include "trace/walk_template.h"
