/* Nearest triangles of a brick in f32 around the brick's centre.
 *
 * The forms of frame.h are set up in f64 relative to the centre, and every edge
 * is measured from its point next to the centre, so that f32 keeps some 1e-6
 * voxel wherever it matters, also for slivers and for triangles that are
 * thousands of voxels long. A triangle is only computed for tiles whose largest
 * distance so far it may still beat; it is visited in an order that jumps
 * through the list, so that those distances shrink early.
 *
 * The loops over lanes and tiles have constant bounds and no branches: compilers
 * turn them into vector code.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/nearest.h"

#include "voxel/frame.h"

enum {
    FORMS = 7,  /* height; excess and place of three edges */
    POLL = 1 << 10
};

/* Rounding of the f32 forms, in voxels: a triangle that is within it of being
 * the nearest must not be culled. Coordinates up to 3.5 + band in sums of three
 * products lose a few 2^-24 of that. */
#define SLACK 1e-4f

typedef struct forms {
    float g[FORMS][3]; /* gradient */
    float c[FORMS];    /* value at the brick's centre */
    float lo[3], hi[3]; /* range of place that lies on the edge */
    float middle[3], half[3]; /* bounding box */
} forms;

static void set_box(const double p[3][3], forms *f)
{
    for (int a = 0; a < 3; a++) {
        double lo = p[0][a], hi = p[0][a];
        for (int c = 1; c < 3; c++) {
            lo = p[c][a] < lo ? p[c][a] : lo;
            hi = p[c][a] > hi ? p[c][a] : hi;
        }
        f->middle[a] = (float)(0.5 * (lo + hi));
        f->half[a] = (float)(0.5 * (hi - lo));
    }
}

static void set_form(forms *f, int i, const double g[3], double c)
{
    for (int a = 0; a < 3; a++)
        f->g[i][a] = (float)g[a];
    f->c[i] = (float)c;
}

static void set_forms(const lr_frame *frame, forms *f)
{
    set_form(f, 0, frame->n, -lr_dot(frame->n, frame->p[0]));
    for (int e = 0; e < 3; e++) {
        double place = -lr_dot(frame->u[e], frame->p[e]);
        double next = lr_clamp(place, 0.0, frame->length[e]);
        set_form(f, 1 + e, frame->m[e], -lr_dot(frame->m[e], frame->p[e]));
        set_form(f, 4 + e, frame->u[e], place - next);
        f->lo[e] = (float)-next;
        f->hi[e] = (float)(frame->length[e] - next);
    }
}

/* Centres of the tiles relative to the brick's, and half their extent. */
static const float HALF_TILE[3] = {1.5f, 0.5f, 0.5f};

LR_INLINE float tile_x(int tile)
{
    return (float)(tile & 1) * 4.0f - 2.0f;
}

LR_INLINE float tile_y(int tile)
{
    return (float)(tile >> 1 & 3) * 2.0f - 3.0f;
}

LR_INLINE float tile_z(int tile)
{
    return (float)(tile >> 3) * 2.0f - 3.0f;
}

LR_INLINE float over(float x)
{
    return x > 0.0f ? x : 0.0f;
}

/* Squared gaps between a triangle's box and the tiles along one axis. */
LR_INLINE void axis_gaps(float middle, float half, float half_tile, float first, float step, int n,
                         float *gap2)
{
    for (int i = 0; i < n; i++) {
        float gap = over(fabsf(first + step * (float)i - middle) - (half + half_tile + SLACK));
        gap2[i] = gap * gap;
    }
}

/* Bit per tile whose worst distance the box may beat. */
static uint32_t near_box(const forms *f, const float worst[LR_TILES])
{
    float x[2], y[4], z[4];
    axis_gaps(f->middle[0], f->half[0], HALF_TILE[0], -2.0f, 4.0f, 2, x);
    axis_gaps(f->middle[1], f->half[1], HALF_TILE[1], -3.0f, 2.0f, 4, y);
    axis_gaps(f->middle[2], f->half[2], HALF_TILE[2], -3.0f, 2.0f, 4, z);
    uint32_t bits = 0;
    for (int k = 0; k < 4; k++)
        for (int j = 0; j < 4; j++) {
            float yz = y[j] + z[k];
            int tile = 8 * k + 2 * j;
            bits |= (uint32_t)(yz + x[0] < worst[tile]) << tile;
            bits |= (uint32_t)(yz + x[1] < worst[tile + 1]) << (tile + 1);
        }
    return bits;
}

/* Of those, the ones whose worst distance the plane may beat. */
static uint32_t near_plane(const forms *f, uint32_t tiles, const float worst[LR_TILES])
{
    const float *n = f->g[0];
    float extent = SLACK;
    for (int a = 0; a < 3; a++)
        extent += fabsf(n[a]) * HALF_TILE[a];
    uint32_t bits = 0;
    for (uint32_t left = tiles; left != 0; left &= left - 1) {
        int tile = __builtin_ctz(left);
        float h = f->c[0] + n[0] * tile_x(tile) + n[1] * tile_y(tile) + n[2] * tile_z(tile);
        float gap = over(fabsf(h) - extent);
        bits |= (uint32_t)(gap * gap < worst[tile]) << tile;
    }
    return bits;
}

/* Values of a form in a tile around its centre; the same for all tiles. */
static void set_pattern(const forms *f, float pattern[FORMS][LR_LANES])
{
    for (int i = 0; i < FORMS; i++)
        for (int lane = 0; lane < LR_LANES; lane++) {
            float x = (float)(lane & 3) - 1.5f, y = (float)(lane >> 2 & 1) - 0.5f;
            float z = (float)(lane >> 3) - 0.5f;
            pattern[i][lane] = f->g[i][0] * x + f->g[i][1] * y + f->g[i][2] * z;
        }
}

LR_INLINE float smaller(float a, float b)
{
    return a < b ? a : b;
}

LR_INLINE float larger(float a, float b)
{
    return a > b ? a : b;
}

LR_INLINE float squared_edge(float excess, float place, float lo, float hi)
{
    float below = smaller(place - lo, 0.0f), above = larger(place - hi, 0.0f);
    float outside = below + above;
    return excess * excess + outside * outside;
}

/* Let the triangle compete for the samples of a tile. */
static void compete(const forms *f, float (*restrict pattern)[LR_LANES], int tile, int32_t who,
                    float *restrict d2, int32_t *restrict winner, float *restrict worst)
{
    float b[FORMS];
    for (int i = 0; i < FORMS; i++)
        b[i] = f->c[i] + f->g[i][0] * tile_x(tile) + f->g[i][1] * tile_y(tile) +
               f->g[i][2] * tile_z(tile);
    int32_t bits[LR_LANES];
    for (int lane = 0; lane < LR_LANES; lane++) {
        float h = pattern[0][lane] + b[0];
        float e0 = pattern[1][lane] + b[1], e1 = pattern[2][lane] + b[2];
        float e2 = pattern[3][lane] + b[3];
        float q0 = squared_edge(e0, pattern[4][lane] + b[4], f->lo[0], f->hi[0]);
        float q1 = squared_edge(e1, pattern[5][lane] + b[5], f->lo[1], f->hi[1]);
        float q2 = squared_edge(e2, pattern[6][lane] + b[6], f->lo[2], f->hi[2]);
        float edge = smaller(smaller(q0, q1), q2);
        float outside = larger(larger(e0, e1), e2);
        float in_plane = outside > 0.0f ? edge : 0.0f;
        float candidate = h * h + in_plane;
        int32_t wins = candidate < d2[lane] ? -1 : 0;
        winner[lane] = (who & wins) | (winner[lane] & ~wins);
        d2[lane] = smaller(candidate, d2[lane]);
    }
    /* Floats that are not negative are ordered as their bits. */
    memcpy(bits, d2, sizeof bits);
    int32_t most = 0;
    for (int lane = 0; lane < LR_LANES; lane++)
        most = bits[lane] > most ? bits[lane] : most;
    memcpy(worst, &most, sizeof most);
}

/* A step through n places that visits all of them, near n / golden ratio. */
static uint32_t golden_step(uint32_t n)
{
    uint32_t step = (uint32_t)(0.6180339887 * n);
    for (;; step++) {
        uint32_t a = n, b = step;
        while (b != 0) {
            uint32_t rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1)
            return step;
    }
}

static void enter(const lr_topology *mesh, const double centre[3], uint32_t t, int32_t who,
                  lr_nearest *nearest)
{
    lr_frame frame;
    forms f;
    lr_triangle(mesh, t, frame.p);
    for (int c = 0; c < 3; c++)
        lr_sub(frame.p[c], centre, frame.p[c]);
    set_box((const double(*)[3])frame.p, &f);
    uint32_t tiles = near_box(&f, nearest->worst);
    if (tiles == 0 || !lr_frame_make(&frame))
        return;
    set_forms(&frame, &f);
    tiles = near_plane(&f, tiles, nearest->worst);
    if (tiles == 0)
        return;
    float pattern[FORMS][LR_LANES];
    set_pattern(&f, pattern);
    for (; tiles != 0; tiles &= tiles - 1) {
        int tile = __builtin_ctz(tiles);
        compete(&f, pattern, tile, who, nearest->d2[tile], nearest->winner[tile],
                &nearest->worst[tile]);
    }
}

bool lr_nearest_search(const lr_topology *mesh, const double centre[3], const uint32_t *list,
                       uint32_t n, double band, const lr_watch *watch, lr_nearest *nearest)
{
    float limit = (float)(band * band);
    for (int tile = 0; tile < LR_TILES; tile++) {
        nearest->worst[tile] = limit;
        for (int lane = 0; lane < LR_LANES; lane++) {
            nearest->d2[tile][lane] = limit;
            nearest->winner[tile][lane] = -1;
        }
    }
    uint32_t step = golden_step(n), at = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (i % POLL == POLL - 1 && lr_stopped(watch))
            return false;
        enter(mesh, centre, list[at], (int32_t)at, nearest);
        at = at >= n - step ? at - (n - step) : at + step;
    }
    return true;
}
