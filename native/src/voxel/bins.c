/* Binning by a counting sort over the volume's table of bricks.
 *
 * A brick is a candidate where the triangle's box, widened by the band, meets
 * it; of those, one is dropped if the plane of the triangle, or the plane that
 * stands on an edge, keeps it out of reach. The second test matters for large
 * triangles, whose box is mostly empty.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/bins.h"

enum {
    POLL = 1 << 14,  /* triangles, or bricks of one triangle, between looks at the stop word */
    MAX_PARTS = 512, /* enough for an even end on many threads */
    BRICK_WORK = 400 /* of a brick without triangles, in units of a listed triangle */
};

/* Samples of a brick lie within HALF of its centre on every axis. */
#define HALF 3.5

/* The bricks that a triangle can reach. */
typedef struct reach {
    int32_t lo[3], hi[3];
    double plane[4][4]; /* n.c + d > 0: out of reach, c the brick's place in the table */
    int n_planes;
} reach;

/* Out of reach where n.(p - on) > slack for the whole brick; n is unit. */
static void add_plane(reach *r, const double n[3], const double on[3], double band)
{
    double *out = r->plane[r->n_planes++];
    double extent = HALF * (fabs(n[0]) + fabs(n[1]) + fabs(n[2]));
    for (int a = 0; a < 3; a++)
        out[a] = 8.0 * n[a];
    out[3] = HALF * (n[0] + n[1] + n[2]) - lr_dot(n, on) - extent - band;
}

static void add_edge_planes(reach *r, const double p[3][3], const double n[3], double band)
{
    for (int e = 0; e < 3; e++) {
        double along[3], out[3];
        lr_sub(p[(e + 1) % 3], p[e], along);
        lr_cross_product(along, n, out);
        double length = sqrt(lr_dot(out, out));
        if (!(length > 0.0))
            continue;
        for (int a = 0; a < 3; a++)
            out[a] /= length;
        if (r->n_planes < 4)
            add_plane(r, out, p[e], band);
    }
}

static bool reach_of(const lr_topology *m, uint64_t t, const int32_t table_size[3], double band,
                     reach *r)
{
    double p[3][3], n[3];
    lr_triangle(m, t, p);
    if (!lr_counts(m, t) || !lr_normal_of((const double(*)[3])p, n))
        return false;
    int64_t n_candidates = 1;
    for (int a = 0; a < 3; a++) {
        double lo = fmin(fmin(p[0][a], p[1][a]), p[2][a]) - band;
        double hi = fmax(fmax(p[0][a], p[1][a]), p[2][a]) + band;
        r->lo[a] = (int32_t)lr_clamp(ceil((lo - 2.0 * HALF) / 8.0), 0.0, table_size[a]);
        r->hi[a] = (int32_t)lr_clamp(floor(hi / 8.0), -1.0, table_size[a] - 1);
        n_candidates *= lr_max_i(r->hi[a] - r->lo[a] + 1, 0);
    }
    r->n_planes = 0;
    if (n_candidates <= 1)
        return true;
    /* Both sides of the plane as one test are two planes; small triangles do
     * with the box alone. */
    double back[3] = {-n[0], -n[1], -n[2]};
    add_plane(r, n, p[0], band);
    add_plane(r, back, p[0], band);
    if (n_candidates > 27)
        add_edge_planes(r, (const double(*)[3])p, n, band);
    return true;
}

static bool out_of_reach(const reach *r, int32_t x, int32_t y, int32_t z)
{
    for (int i = 0; i < r->n_planes; i++) {
        const double *p = r->plane[i];
        if (p[0] * x + p[1] * y + p[2] * z + p[3] > 0.0)
            return true;
    }
    return false;
}

/* Count the triangle in (list NULL), or list it in, every brick that it reaches. */
static bool visit(const reach *r, const int32_t size[3], uint32_t t, uint32_t *count,
                  const uint32_t *active, uint64_t *next, uint32_t *list, const lr_watch *watch)
{
    for (int32_t z = r->lo[2]; z <= r->hi[2]; z++)
        for (int32_t y = r->lo[1]; y <= r->hi[1]; y++) {
            if (r->hi[0] - r->lo[0] > 64 && lr_stopped(watch))
                return false;
            size_t row = ((size_t)z * (size_t)size[1] + (size_t)y) * (size_t)size[0];
            for (int32_t x = r->lo[0]; x <= r->hi[0]; x++) {
                if (out_of_reach(r, x, y, z))
                    continue;
                if (list == NULL)
                    count[row + (size_t)x]++;
                else
                    list[next[active[row + (size_t)x]]++] = t;
            }
        }
    return true;
}

static lr_status visit_all(const lr_topology *m, const int32_t size[3], double band,
                           uint32_t *count, uint64_t *next, uint32_t *list, const lr_watch *watch,
                           lr_error *error)
{
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        reach r;
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (!reach_of(m, t, size, band, &r))
            continue;
        if (!visit(&r, size, (uint32_t)t, count, count, next, list, watch))
            return lr_fail_stopped(error);
    }
    return LR_OK;
}

/* From counts to active bricks; count then says which active brick it is. */
static lr_status make_active(uint32_t *count, size_t n_table, lr_bins *bins, lr_error *error)
{
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
    bins->list = malloc((sum + 1) * sizeof *bins->list);
    if (bins->list == NULL)
        return lr_fail_memory(error, sum * 4, "the triangles of the bricks");
    return LR_OK;
}

static lr_status make_parts(lr_bins *bins, lr_error *error)
{
    uint64_t work = bins->start[bins->n_active] + (uint64_t)bins->n_active * BRICK_WORK;
    bins->n_parts = bins->n_active < MAX_PARTS ? bins->n_active : MAX_PARTS;
    bins->part = malloc(((size_t)bins->n_parts + 1) * sizeof *bins->part);
    if (bins->part == NULL)
        return lr_fail_memory(error, bins->n_parts * 4, "the parts");
    uint32_t brick = 0;
    for (uint32_t i = 0; i < bins->n_parts; i++) {
        uint64_t before = work / bins->n_parts * i;
        while (brick < bins->n_active &&
               bins->start[brick] + (uint64_t)brick * BRICK_WORK < before)
            brick++;
        bins->part[i] = brick;
    }
    bins->part[bins->n_parts] = bins->n_active;
    return LR_OK;
}

lr_status lr_bins_make(const lr_topology *m, const int32_t table_size[3], double band,
                       const lr_watch *watch, lr_bins *bins, lr_error *error)
{
    *bins = (lr_bins){0};
    size_t n_table = (size_t)table_size[0] * (size_t)table_size[1] * (size_t)table_size[2];
    uint32_t *count = calloc(n_table, sizeof *count);
    if (count == NULL)
        return lr_fail_memory(error, n_table * 4, "the table of bricks");
    lr_status status = visit_all(m, table_size, band, count, NULL, NULL, watch, error);
    if (status == LR_OK)
        status = make_active(count, n_table, bins, error);
    uint64_t *next = NULL;
    if (status == LR_OK) {
        next = malloc(((size_t)bins->n_active + 1) * sizeof *next);
        if (next == NULL)
            status = lr_fail_memory(error, (uint64_t)bins->n_active * 8, "the list of bricks");
    }
    if (status == LR_OK) {
        memcpy(next, bins->start, (size_t)bins->n_active * sizeof *next);
        status = visit_all(m, table_size, band, count, next, bins->list, watch, error);
    }
    if (status == LR_OK)
        status = make_parts(bins, error);
    free(next);
    free(count);
    return status;
}

void lr_bins_free(lr_bins *bins)
{
    free(bins->brick);
    free(bins->start);
    free(bins->list);
    free(bins->part);
    *bins = (lr_bins){0};
}
