/* Directed chessboard distance: one field for each of the eight octants.
 *
 * Only cells ahead of a ray matter. s of a cell is the chessboard distance to the nearest
 * surface cell among those that are not behind it on any axis; the cube of s cells a side,
 * with the cell at its near corner, is empty and left in one jump. Rays along a surface or
 * away from it make long jumps where an undirected field allows single cells.
 *
 * Source: Deakin and Knackstedt 2020 (anisotropic Chebyshev distance). Departures:
 * 1. memory grows with the surface as in cd: bricks at the surface store their cells'
 * distances, 4 bits each, all bricks their own in bricks; 2. a cell's distance counts its own
 * brick and the next, at most 15 cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/narrow_band.h"
#include "trace/traverser.h"

enum {
    SEEN = 2 * LR_SIDE, /* cells along an axis: the brick and the one ahead */
    CAP = 15,
    OCTANTS = 8,
    ROW = (1 << LR_SIDE) - 1 /* the cells of a brick's row */
};

typedef struct octants {
    uint32_t *bricks;    /* [table]: index into near, or LR_FAR_BRICK */
    uint8_t (*ahead)[8]; /* [table][octant]: distance in bricks, 0 where they hold surface */
    uint8_t (*near)[OCTANTS][LR_CELLS / 2]; /* [octant]: distance in cells, two to a byte */
} octants;

void lr_cd_octant_free(void *data)
{
    octants *f = data;
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->ahead);
    free(f->near);
    free(f);
}

/* Bit a of an octant is set where rays go up along axis a. */
LR_INLINE int sign_of(int octant, int a)
{
    return octant >> a & 1 ? 1 : -1;
}

/* 1 + the least of the seven entries ahead in the octant; at lies at p in a block
 * of n entries a side, stride apart; beyond the block all is empty. */
LR_INLINE uint8_t past_neighbours(const uint8_t *at, int octant, const int32_t p[3],
                                  const int32_t n[3], const ptrdiff_t stride[3], uint8_t cap)
{
    uint8_t least = cap - 1;
    for (int k = 1; k < 8; k++) {
        ptrdiff_t to = 0;
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            const int step = (k >> a & 1) * sign_of(octant, a);
            inside = inside && p[a] + step >= 0 && p[a] + step < n[a];
            to += step * stride[a];
        }
        if (inside && at[to] < least)
            least = at[to];
    }
    return (uint8_t)(least + 1);
}

/* All bricks, from the octant's far corner on; ends early where stopped. */
static void brick_distances(const lr_volume *v, int octant, uint8_t (*ahead)[OCTANTS],
                            const lr_watch *watch)
{
    const int32_t *n = v->table_size;
    const ptrdiff_t row = OCTANTS * (ptrdiff_t)n[0], stride[3] = {OCTANTS, row, row * n[1]};
    for (int32_t k = 0; k < n[2]; k++)
        for (int32_t j = 0; j < n[1] && !lr_stopped(watch); j++)
            for (int32_t i = 0; i < n[0]; i++) {
                const int32_t p[3] = {octant & 1 ? n[0] - 1 - i : i, octant & 2 ? n[1] - 1 - j : j,
                                      octant & 4 ? n[2] - 1 - k : k};
                const size_t at = lr_table_at(v, p[0], p[1], p[2]);
                ahead[at][octant] =
                    lr_entry_words(lr_entry_at(v, at)) != 0
                        ? 0
                        : past_neighbours(&ahead[at][octant], octant, p, n, stride, 255);
            }
}

/* A window with a border of unknown cells, which count as full; window cell (x, y, z) is bit x + 1
 * of row [z + 1][y + 1]. */
enum { FRAMED = LR_WINDOW + 2, OWN = LR_NEAR_RADIUS + 1 };

typedef uint32_t framed[FRAMED][FRAMED];

static void frame(lr_window window, framed rows)
{
    memset(rows, 0xff, sizeof(framed));
    for (int z = 0; z < LR_WINDOW; z++)
        for (int y = 0; y < LR_WINDOW; y++)
            rows[z + 1][y + 1] = window[z][y] << 1 | 1u << (LR_WINDOW + 1) | 1;
}

/* Grow the set by one cell against the octant, in the brick's part of the window: from near to
 * far, so that cells ahead have not grown yet. */
static void grow_against(framed rows, int octant)
{
    const int up_z = sign_of(octant, 2), up_y = sign_of(octant, 1);
    for (int k = 0; k < SEEN; k++) {
        const int z = up_z > 0 ? OWN + k : OWN + LR_SIDE - 1 - k;
        for (int j = 0; j < SEEN; j++) {
            const int y = up_y > 0 ? OWN + j : OWN + LR_SIDE - 1 - j;
            const uint32_t row =
                rows[z][y] | rows[z][y + up_y] | rows[z + up_z][y] | rows[z + up_z][y + up_y];
            rows[z][y] = row | (octant & 1 ? row >> 1 : row << 1);
        }
    }
}

/* The distance of a cell is the number of growths that cover it. */
static void octant_distances(framed rows, int octant, uint8_t out[LR_CELLS / 2])
{
    uint8_t dist[LR_CELLS] = {0};
    for (int step = 0; step < CAP; step++) {
        uint32_t all = ROW;
        for (int z = 0; z < LR_SIDE; z++)
            for (int y = 0; y < LR_SIDE; y++) {
                const uint32_t covered = rows[OWN + z][OWN + y] >> OWN & ROW;
                all &= covered;
                for (int x = 0; x < LR_SIDE; x++)
                    dist[lr_in_brick(x, y, z)] += !(covered >> x & 1);
            }
        if (all == ROW)
            break;
        grow_against(rows, octant);
    }
    for (int n = 0; n < LR_CELLS / 2; n++)
        out[n] = (uint8_t)(dist[2 * n] | dist[2 * n + 1] << 4);
}

static void cell_distances(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const octants *f = context;
    lr_window window;
    framed rows;
    lr_window_fill(v, b, window);
    for (int octant = 0; octant < OCTANTS; octant++) {
        frame(window, rows);
        octant_distances(rows, octant, f->near[number][octant]);
    }
}

lr_status lr_cd_octant_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                             void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    const size_t n = lr_table_count(v);
    uint32_t n_near = 0;
    octants *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "distances ahead");
    lr_status status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
    if (status == LR_OK) {
        f->ahead = malloc(n * sizeof *f->ahead);
        f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
        *nbytes = sizeof *f + n * (sizeof *f->bricks + sizeof *f->ahead) + n_near * sizeof *f->near;
        if (f->ahead == NULL || f->near == NULL)
            status = lr_fail_memory(error, *nbytes, "distances ahead");
    }
    for (int octant = 0; status == LR_OK && octant < OCTANTS; octant++) {
        brick_distances(v, octant, f->ahead, watch);
        if (lr_stopped(watch))
            status = lr_fail_stopped(error);
    }
    if (status == LR_OK)
        status = lr_near_each(v, f->bricks, cell_distances, f, watch, error);
    if (status != LR_OK) {
        lr_cd_octant_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

/* The octant of a ray; along an axis it does not move either will do. */
LR_INLINE void begin_walk(const lr_ray *r, int *octant)
{
    *octant = (r->s[0] > 0) | (r->s[1] > 0) << 1 | (r->s[2] > 0) << 2;
}

LR_INLINE bool empty_ahead(const void *data, const lr_volume *v, const lr_ray *r, const int *octant,
                           const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    (void)tally;
    const octants *f = data;
    const size_t at = lr_table_of(v, c[0], c[1], c[2]);
    const uint32_t number = f->bricks[at];
    int32_t n, side; /* so many blocks of so many cells are empty, this one included */
    if (number & LR_FAR_BRICK) {
        n = f->ahead[at][*octant];
        side = LR_SIDE;
    } else {
        const int cell = lr_in_brick(c[0], c[1], c[2]);
        n = f->near[number][*octant][cell >> 1] >> 4 * (cell & 1) & 15;
        side = 1;
        if (n == 0)
            return true;
        if (f->ahead[at][*octant] > 1) {
            n = f->ahead[at][*octant];
            side = LR_SIDE;
        }
    }
    for (int a = 0; a < 3; a++) {
        const int32_t first = c[a] / side;
        lo[a] = r->s[a] > 0 ? c[a] : (first - n + 1) * side;
        hi[a] = r->s[a] > 0 ? (first + n) * side - 1 : c[a];
        if (r->s[a] == 0)
            lo[a] = hi[a] = c[a];
    }
    lr_cut_box(r, lo, hi);
    return false;
}

#define LR_NAME                                             cd_octant
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(ray, state)
#define LR_STATE                                            int
#define LR_BOX                                              empty_ahead
#include "trace/walk_template.h"
