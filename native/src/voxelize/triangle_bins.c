/* Lists the triangles of each brick, by a counting sort over the volume's table of bricks.
 *
 * Candidates are the bricks that the triangle's box, widened by the band, meets. A small
 * triangle, at most two bricks along each axis, is listed in all of them, and they are stored
 * between counting and listing. The box of a large one is mostly empty: its rows are clipped
 * by the triangle's plane and by the planes through its edges, and bricks are left out whose
 * centre is farther than the band and half a brick's diagonal.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/pages.h"
#include "voxelize/triangle_bins.h"

#include "mesh/triangle_distance.h"

enum {
    POLL = 1 << 14,   /* triangles, or bricks of one triangle, between checks of the stop word */
    MAX_PARTS = 512,  /* enough that many threads end at about one time */
    PART_WORK = 4000, /* at least of a part, unlike which the call that runs it takes no time */
    BRICK_WORK = 400, /* of a brick without triangles, in units of a listed triangle */
    PLANES = 5
};

/* Samples of a brick lie within HALF of its centre on every axis, */
#define HALF          (0.5 * (LR_SIDE - 1))
#define HALF_DIAGONAL (HALF * 1.73206) /* a little more than sqrt(3) */

/* Stored per triangle: its lowest brick's place in the table (27 bits) and, per axis, whether
 * it is listed in the next one too; or one of these. */
#define SECOND_BRICK (1u << 27)
#define NOWHERE      0xffffffffu
#define LARGE        0xfffffffeu

typedef struct binning {
    const lr_topology *mesh;
    int32_t size[3]; /* of the table */
    bool all;        /* also triangles that do not count */
    double band;
    uint32_t *count; /* [table]: triangles, then the active brick's number */
    uint32_t *box;   /* [n_triangles] */
    uint64_t *next;  /* [n_active] */
    uint32_t *list;  /* NULL while counting */
    const lr_watch *watch;
} binning;

/* The bricks that can come within the band of a triangle. */
typedef struct brick_range {
    int32_t lo[3], hi[3];
    lr_frame frame;
    double plane[PLANES][4]; /* n.c + d > 0: farther than the band; c: the brick in the table */
} brick_range;

LR_INLINE void put(binning *b, size_t brick, uint32_t t)
{
    if (b->list == NULL)
        b->count[brick]++;
    else
        b->list[b->next[b->count[brick]]++] = t;
}

static void put_small(binning *b, uint32_t box, uint32_t t)
{
    size_t place = box & (SECOND_BRICK - 1), row = (size_t)b->size[0];
    size_t layer = row * (size_t)b->size[1];
    uint32_t nx = box >> 27 & 1, ny = box >> 28 & 1, nz = box >> 29 & 1;
    for (uint32_t z = 0; z <= nz; z++)
        for (uint32_t y = 0; y <= ny; y++)
            for (uint32_t x = 0; x <= nx; x++)
                put(b, place + x + y * row + z * layer, t);
}

/* The plane behind which n.(p - on) > band for the whole brick; n is unit. */
static void set_plane(double out[4], const double n[3], const double on[3], double band)
{
    double extent = HALF * (fabs(n[0]) + fabs(n[1]) + fabs(n[2]));
    for (int a = 0; a < 3; a++)
        out[a] = LR_SIDE * n[a];
    out[3] = HALF * (n[0] + n[1] + n[2]) - lr_dot(n, on) - extent - band;
}

/* The row's range of bricks that no plane excludes, one more at either end for rounding. */
static void cut_row(const brick_range *r, int32_t y, int32_t z, int32_t *first, int32_t *last)
{
    double lo = r->lo[0], hi = r->hi[0];
    for (int i = 0; i < PLANES; i++) {
        const double *p = r->plane[i];
        double rest = p[1] * y + p[2] * z + p[3];
        if (p[0] > 1e-6)
            hi = fmin(hi, floor(-rest / p[0]) + 1.0);
        else if (p[0] < -1e-6)
            lo = fmax(lo, ceil(-rest / p[0]) - 1.0);
    }
    *first = lo > hi ? 0 : (int32_t)lo;
    *last = lo > hi ? -1 : (int32_t)hi;
}

static bool in_range(const brick_range *r, double band, int32_t x, int32_t y, int32_t z)
{
    for (int i = 0; i < PLANES; i++) {
        const double *p = r->plane[i];
        if (p[0] * x + p[1] * y + p[2] * z + p[3] > 0.0)
            return false;
    }
    const double centre[3] = {LR_SIDE * x + HALF, LR_SIDE * y + HALF, LR_SIDE * z + HALF};
    double most = band + HALF_DIAGONAL;
    return lr_frame_distance2(&r->frame, centre) <= most * most;
}

/* False where stopped. */
static bool put_large(binning *b, const brick_range *r, uint32_t t)
{
    for (int32_t z = r->lo[2]; z <= r->hi[2]; z++)
        for (int32_t y = r->lo[1]; y <= r->hi[1]; y++) {
            int32_t first, last;
            if (lr_stopped(b->watch))
                return false;
            cut_row(r, y, z, &first, &last);
            const size_t row = lr_place_of(b->size, 0, y, z);
            for (int32_t x = first; x <= last; x++)
                if (in_range(r, b->band, x, y, z))
                    put(b, row + (size_t)x, t);
        }
    return true;
}

/* The frame is made already. */
static void set_planes(brick_range *r, double band)
{
    lr_frame *f = &r->frame;
    double back[3] = {-f->n[0], -f->n[1], -f->n[2]};
    set_plane(r->plane[0], f->n, f->p[0], band);
    set_plane(r->plane[1], back, f->p[0], band);
    for (int e = 0; e < 3; e++)
        set_plane(r->plane[2 + e], f->m[e], f->p[e], band);
}

static uint32_t box_of(const binning *b, uint64_t t, brick_range *r)
{
    double cross[3];
    const double (*p)[3] = (const double (*)[3])r->frame.p;
    lr_triangle(b->mesh, t, r->frame.p);
    if ((!b->all && !lr_counts(b->mesh, t)) || (b->mesh->n_flat > 0 && !lr_cross_of(p, cross)))
        return NOWHERE;
    uint32_t second = 0;
    bool large = false;
    for (int a = 0; a < 3; a++) {
        double lo = p[0][a] < p[1][a] ? p[0][a] : p[1][a];
        double hi = p[0][a] > p[1][a] ? p[0][a] : p[1][a];
        lo = (lo < p[2][a] ? lo : p[2][a]) - b->band;
        hi = (hi > p[2][a] ? hi : p[2][a]) + b->band;
        r->lo[a] = (int32_t)lr_clamp(ceil((lo - 2.0 * HALF) / LR_SIDE), 0.0, b->size[a]);
        r->hi[a] = (int32_t)lr_clamp(floor(hi / LR_SIDE), -1.0, b->size[a] - 1);
        if (r->hi[a] < r->lo[a])
            return NOWHERE;
        second |= (uint32_t)(r->hi[a] > r->lo[a]) << a;
        large = large || r->hi[a] > r->lo[a] + 1;
    }
    return large ? LARGE
                 : (uint32_t)lr_place_of(b->size, r->lo[0], r->lo[1], r->lo[2]) |
                       second * SECOND_BRICK;
}

static lr_status visit_all(binning *b, lr_error *error)
{
    for (uint64_t t = 0; t < b->mesh->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(b->watch))
            return lr_fail_stopped(error);
        brick_range r;
        if (b->list == NULL || b->box[t] == LARGE)
            b->box[t] = box_of(b, t, &r);
        if (b->box[t] < LARGE) {
            put_small(b, b->box[t], (uint32_t)t);
        } else if (b->box[t] == LARGE && lr_frame_make(&r.frame)) {
            set_planes(&r, b->band);
            if (!put_large(b, &r, (uint32_t)t))
                return lr_fail_stopped(error);
        }
    }
    return LR_OK;
}

/* From counts to active bricks; count then says which active brick it is. */
static lr_status make_active(uint32_t *count, const int32_t size[3], lr_bins *bins, lr_error *error)
{
    size_t n_table = (size_t)size[0] * (size_t)size[1] * (size_t)size[2];
    for (size_t i = 0; i < n_table; i++)
        bins->n_active += count[i] != 0;
    bins->brick = malloc(((size_t)bins->n_active + 1) * sizeof *bins->brick);
    bins->start = malloc(((size_t)bins->n_active + 1) * sizeof *bins->start);
    if (bins->brick == NULL || bins->start == NULL)
        return lr_fail_memory(error, (uint64_t)bins->n_active * 12, "the list of bricks");
    uint32_t active = 0;
    uint64_t sum = 0;
    for (size_t i = 0; i < n_table; i++) {
        if (count[i] == 0)
            continue;
        bins->brick[active] = (uint32_t)i;
        bins->start[active] = sum;
        bins->longest = count[i] > bins->longest ? count[i] : bins->longest;
        sum += count[i];
        count[i] = active++;
    }
    bins->start[active] = sum;
    bins->list = lr_pages_new(sum + 1, sizeof *bins->list);
    if (bins->list == NULL)
        return lr_fail_memory(error, sum * 4, "the triangles of the bricks");
    return LR_OK;
}

static lr_status make_parts(lr_bins *bins, lr_error *error)
{
    uint64_t work = bins->start[bins->n_active] + (uint64_t)bins->n_active * BRICK_WORK;
    const uint64_t most = work / PART_WORK < MAX_PARTS ? work / PART_WORK + 1 : MAX_PARTS;
    bins->n_parts = bins->n_active < most ? bins->n_active : (uint32_t)most;
    bins->part = malloc(((size_t)bins->n_parts + 1) * sizeof *bins->part);
    if (bins->part == NULL)
        return lr_fail_memory(error, bins->n_parts * 4, "the parts");
    uint32_t brick = 0;
    for (uint32_t i = 0; i < bins->n_parts; i++) {
        uint64_t before = work / bins->n_parts * i;
        while (brick < bins->n_active && bins->start[brick] + (uint64_t)brick * BRICK_WORK < before)
            brick++;
        bins->part[i] = brick;
    }
    bins->part[bins->n_parts] = bins->n_active;
    return LR_OK;
}

static lr_status list_all(binning *b, lr_bins *bins, lr_error *error)
{
    lr_status status = visit_all(b, error);
    if (status == LR_OK)
        status = make_active(b->count, b->size, bins, error);
    if (status != LR_OK)
        return status;
    b->next = malloc(((size_t)bins->n_active + 1) * sizeof *b->next);
    if (b->next == NULL)
        return lr_fail_memory(error, (uint64_t)bins->n_active * 8, "the list of bricks");
    memcpy(b->next, bins->start, (size_t)bins->n_active * sizeof *b->next);
    b->list = bins->list;
    status = visit_all(b, error);
    return status == LR_OK ? make_parts(bins, error) : status;
}

lr_status lr_bins_make(const lr_topology *m, const int32_t table_size[3], double band, bool all,
                       const lr_watch *watch, lr_bins *bins, lr_error *error)
{
    *bins = (lr_bins){0};
    binning b = {.mesh = m, .all = all, .band = band, .watch = watch};
    size_t n_table = 1;
    for (int a = 0; a < 3; a++) {
        b.size[a] = table_size[a];
        n_table *= (size_t)table_size[a];
    }
    b.count = lr_pages_new(n_table, sizeof *b.count);
    b.box = lr_pages_new(m->source.n_triangles, sizeof *b.box);
    lr_status status = LR_OK;
    if (b.count == NULL || b.box == NULL)
        status =
            lr_fail_memory(error, (n_table + m->source.n_triangles) * 4, "the table of bricks");
    else
        status = list_all(&b, bins, error);
    free(b.next);
    lr_pages_free(b.box);
    lr_pages_free(b.count);
    return status;
}

lr_status lr_bins_add(lr_bins *bins, const uint8_t *state, size_t n_table, uint32_t n_active,
                      lr_error *error)
{
    uint32_t *brick = malloc(((size_t)n_active + 1) * sizeof *brick), n = 0, old = 0;
    uint64_t *start = malloc(((size_t)n_active + 1) * sizeof *start);
    if (brick == NULL || start == NULL) {
        free(brick);
        free(start);
        return lr_fail_memory(error, (uint64_t)n_active * 12, "the list of bricks");
    }
    for (size_t at = 0; at < n_table; at++) {
        if (state[at] != LR_BIN_ACTIVE)
            continue;
        brick[n] = (uint32_t)at;
        start[n++] = bins->start[old];
        old += old < bins->n_active && bins->brick[old] == at;
    }
    start[n] = bins->start[old];
    free(bins->brick);
    free(bins->start);
    free(bins->part);
    bins->brick = brick;
    bins->start = start;
    bins->part = NULL;
    bins->n_active = n;
    return make_parts(bins, error);
}

void lr_bins_free(lr_bins *bins)
{
    free(bins->brick);
    free(bins->start);
    lr_pages_free(bins->list);
    free(bins->part);
    *bins = (lr_bins){0};
}
