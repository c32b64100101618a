/* Chooses the cells that keep their triangles: those whose field differs from the surface.
 *
 * Runs when all samples of the volume are made, so it tests the field that rays will meet.
 * A cell keeps triangles if one of the triangles near it
 *  1. has an edge near it that is a border, or has more than two triangles, or two of
 *     opposite winding;
 *  2. differs from the samples: at one of the cell's corners the sample is not the distance
 *     from the triangle's plane. Small differences count only at creases, where the field's
 *     gradient differs too;
 *  3. meets it where the field is wrong: not zero on the triangle, or of another gradient;
 * and if rays can hit something in it: a triangle meets it, or its samples change sides.
 * 2 finds close pairs and flipped windings, 3 creases and thin walls. A job may also ask for
 * every cell near a triangle; then nothing is tested.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/choose_triangle_cells.h"

#include "grid/access.h"
#include "grid/trilinear.h"
#include "mesh/link_edges.h"
#include "mesh/triangle_box.h"
#include "voxelize/filter_profile.h"

enum { SIDE = LR_SIDE + 1, CORNERS = SIDE * SIDE * SIDE, POLL = 1 << 6, MOST_POLYGON = 9 };

/* Tolerances, in voxels. A sphere of radius R leaves its tangent plane by r^2 / (2R) at the
 * distance r, and the error of its field is 1/(4R): smooth surfaces need no triangle cells
 * down to a radius of BEND voxels. */
static const double SURFACE_OFF = 0.05, CORNER_OFF = 0.1, GRADIENT_OFF = 0.25, BEND = 4.0;
/* Tolerance of the gradient for flat-shaded meshes: 1 degree. */
static const double FLAT_OFF = 0.0175;

/* Near a crease of more than 20 degrees, errors of the samples become visible to rays that
 * graze a plane. Tolerance in quantization steps, and in voxels. */
static const double CREASE = 0.35, CREASE_STEPS = 4.0, CREASE_OFF = 1e-3;
static const double CREASE_FREE = 0.985; /* cosine of half the angle of a crease */

/* A brick's samples and those beyond it, as distances (true ones near the surface, where
 * the filter is no ramp); positive inside. */
typedef struct field {
    float s[CORNERS];
} field;

typedef struct pair {
    uint32_t cell, triangle;
} pair;

typedef struct work {
    const lr_voxel_job *job;
    const lr_volume *volume;
    int32_t first[3];  /* sample of the brick */
    double per_value;  /* voxels at the surface, of a stored value */
    double crease_off; /* CREASE_OFF, or more where the samples are coarse; voxels */
    bool crease_free;  /* there is no crease in the brick */
    field field;
    lr_mask near, touched, bad;
    pair *pairs;
    size_t n_pairs, room;
} work;

LR_INLINE bool holds(const lr_mask mask, int cell)
{
    return lr_mask_has(mask, lr_along(cell, 0), lr_along(cell, 1), lr_along(cell, 2));
}

LR_INLINE void add(lr_mask mask, int cell)
{
    lr_mask_add(mask, lr_along(cell, 0), lr_along(cell, 1), lr_along(cell, 2));
}

/* ---- samples ----------------------------------------------------------- */

static void read_field(const lr_volume *v, const int32_t first[3], double scale, field *f)
{
    double sample[CORNERS];
    lr_brick_corners(v, first, sample);
    for (int i = 0; i < CORNERS; i++)
        f->s[i] = (float)((sample[i] - v->threshold) * scale);
}

/* The same of one sample, which may lie outside the brick. */
static double sample_at(const work *w, const int32_t at[3])
{
    const lr_volume *v = w->volume;
    if (at[0] >= 0 && at[0] < SIDE && at[1] >= 0 && at[1] < SIDE && at[2] >= 0 && at[2] < SIDE)
        return (double)w->field.s[at[0] + SIDE * (at[1] + SIDE * at[2])];
    const int32_t c[3] = {w->first[0] + at[0], w->first[1] + at[1], w->first[2] + at[2]};
    const double g = lr_has_sample(v, c) ? lr_sample(v, c[0], c[1], c[2]) : 0.0;
    return (g - v->threshold) * w->per_value;
}

static void cell_corners(const field *f, int cell, double corner[8])
{
    const int at = lr_along(cell, 0) + SIDE * (lr_along(cell, 1) + SIDE * lr_along(cell, 2));
    for (int b = 0; b < 8; b++)
        corner[b] = (double)f->s[at + (b & 1) + SIDE * (b >> 1 & 1) + SIDE * SIDE * (b >> 2)];
}

/* Do the samples of a cell lie on different sides? */
static bool changes(const field *f, int cell)
{
    double corner[8];
    int inside = 0;
    cell_corners(f, cell, corner);
    for (int b = 0; b < 8; b++)
        inside += corner[b] >= 0.0;
    return inside > 0 && inside < 8;
}

/* ---- one triangle and one cell ----------------------------------------- */

/* A triangle in coordinates from the brick's first sample. */
typedef struct piece {
    double p[3][3], n[3]; /* unit, outward */
    double wound[3];      /* unit, by the winding */
    double lo[3], hi[3];
    bool ends[3]; /* is the edge from that corner not closed (lr_edge_closed)? */
    uint32_t triangle;
} piece;

/* Does a segment meet the cell, widened by LR_EXACT_NEAR? */
static bool segment_near(const double a[3], const double b[3], const double cell[3])
{
    double in = 0.0, out = 1.0;
    for (int i = 0; i < 3; i++) {
        const double lo = cell[i] - LR_EXACT_NEAR, hi = cell[i] + 1.0 + LR_EXACT_NEAR;
        const double d = b[i] - a[i];
        if (d == 0.0) {
            if (a[i] < lo || a[i] > hi)
                return false;
            continue;
        }
        const double t0 = ((d > 0.0 ? lo : hi) - a[i]) / d, t1 = ((d > 0.0 ? hi : lo) - a[i]) / d;
        in = t0 > in ? t0 : in;
        out = t1 < out ? t1 : out;
    }
    return in <= out;
}

static bool ends_near(const piece *t, const double cell[3])
{
    for (int e = 0; e < 3; e++)
        if (t->ends[e] && segment_near(t->p[e], t->p[(e + 1) % 3], cell))
            return true;
    return false;
}

/* The distance that a sample stores at the distance s from a plane. */
LR_INLINE double told_at(const lr_voxel_job *job, double s)
{
    const double r = job->half_width;
    return job->filter == LR_FILTER_RAMP
               ? lr_clamp(s, -r, r)
               : (lr_profile(job->filter, s, r) - 0.5) / lr_profile_slope(job->filter, r);
}

/* Does the field around a sample, which lies at s from the triangle's plane and differs by gap,
 * have another gradient than the plane? */
static bool goes_elsewhere(const work *w, const int32_t at[3], const double n[3], double s,
                           double gap)
{
    for (int a = 0; a < 3; a++)
        for (int step = -1; step <= 1; step += 2) {
            int32_t beside[3] = {at[0], at[1], at[2]};
            beside[a] += step;
            const double off = sample_at(w, beside) - told_at(w->job, s - step * n[a]) - gap;
            if (fabs(off) > CREASE)
                return true;
        }
    return false;
}

/* Squared distance of a point from the part of the plane that the triangle covers, along
 * the plane. */
static double beside2(const piece *t, const double q[3])
{
    double best = INFINITY;
    bool in_face = true;
    for (int c = 0; c < 3; c++) {
        double along[3], from[3], out[3];
        lr_sub(t->p[(c + 1) % 3], t->p[c], along);
        lr_sub(q, t->p[c], from);
        lr_cross_product(along, t->wound, out);
        const double length2 = lr_dot(along, along), height = lr_dot(t->n, from);
        const double fraction = lr_clamp(lr_dot(along, from) / length2, 0.0, 1.0);
        double square = -height * height;
        for (int a = 0; a < 3; a++)
            square += (from[a] - fraction * along[a]) * (from[a] - fraction * along[a]);
        in_face = in_face && lr_dot(out, from) <= 0.0;
        best = square < best ? square : best;
    }
    return in_face ? 0.0 : best;
}

/* Case 2 above. crease: whether one may be near. */
static bool corners_off(const work *w, const piece *t, const int32_t c[3], const double corner[8],
                        bool crease)
{
    const double cell[3] = {c[0], c[1], c[2]};
    double from[3];
    lr_sub(cell, t->p[0], from);
    const double first = -lr_dot(t->n, from);
    for (int b = 0; b < 8; b++) {
        const double s = first - (b & 1) * t->n[0] - (b >> 1 & 1) * t->n[1] - (b >> 2) * t->n[2];
        const double gap = corner[b] - told_at(w->job, s), off = fabs(gap) - CORNER_OFF;
        const int32_t at[3] = {c[0] + (b & 1), c[1] + (b >> 1 & 1), c[2] + (b >> 2)};
        if (crease && fabs(gap) > w->crease_off && goes_elsewhere(w, at, t->n, s, gap))
            return true;
        if (off <= 0.0)
            continue;
        const double q[3] = {at[0], at[1], at[2]};
        if (off > beside2(t, q) / (2.0 * BEND))
            return true;
    }
    return false;
}

/* The part of a polygon below a plane of one axis, sign * p[a] <= bound.
 *
 * Source: Sutherland and Hodgman 1974. */
static int clip(double p[MOST_POLYGON][3], int n, int a, double sign, double bound)
{
    double out[MOST_POLYGON][3];
    int kept = 0;
    for (int i = 0; i < n; i++) {
        const double *q = p[(i + 1) % n];
        const double at = sign * p[i][a] - bound, next = sign * q[a] - bound;
        if (at <= 0.0 && kept < MOST_POLYGON)
            memcpy(out[kept++], p[i], sizeof out[0]);
        if ((at < 0.0) != (next < 0.0) && at != 0.0 && next != 0.0 && kept < MOST_POLYGON) {
            for (int c = 0; c < 3; c++)
                out[kept][c] = p[i][c] + (q[c] - p[i][c]) * (at / (at - next));
            kept++;
        }
    }
    memcpy(p, out, (size_t)kept * sizeof *p);
    return kept;
}

static bool point_off(const double corner[8], const double cell[3], const double p[3],
                      const double n[3], double gradient_off)
{
    double q[3], g[3];
    for (int a = 0; a < 3; a++)
        q[a] = lr_clamp(p[a] - cell[a], 0.0, 1.0);
    if (fabs(lr_trilinear(corner, q)) > SURFACE_OFF)
        return true;
    lr_trilinear_gradient(corner, q, g);
    for (int a = 0; a < 3; a++)
        g[a] += n[a];
    return lr_dot(g, g) > gradient_off * gradient_off;
}

/* Case 3 above, at the corners and the middle of the triangle's part in the cell. */
static bool surface_off(const piece *t, const double cell[3], const double corner[8],
                        double gradient_off)
{
    double p[MOST_POLYGON][3], middle[3] = {0.0, 0.0, 0.0};
    int n = 3;
    memcpy(p, t->p, sizeof t->p);
    for (int a = 0; a < 3 && n > 0; a++) {
        if (t->hi[a] > cell[a] + 1.0)
            n = clip(p, n, a, 1.0, cell[a] + 1.0 + LR_TOUCH);
        if (t->lo[a] < cell[a])
            n = clip(p, n, a, -1.0, LR_TOUCH - cell[a]);
    }
    for (int i = 0; i < n; i++) {
        if (point_off(corner, cell, p[i], t->n, gradient_off))
            return true;
        for (int a = 0; a < 3; a++)
            middle[a] += p[i][a] / n;
    }
    return n > 0 && point_off(corner, cell, middle, t->n, gradient_off);
}

/* ---- a brick ----------------------------------------------------------- */

static bool add_pair(work *w, uint32_t cell, uint32_t triangle)
{
    if (w->n_pairs == w->room) {
        const size_t room = 2 * w->room + 4096;
        pair *pairs = realloc(w->pairs, room * sizeof *pairs);
        if (pairs == NULL)
            return false;
        w->pairs = pairs;
        w->room = room;
    }
    w->pairs[w->n_pairs++] = (pair){cell, triangle};
    return true;
}

static bool test_cell(work *w, const piece *t, const lr_separator *s, const int32_t c[3])
{
    const double centre[3] = {c[0] + 0.5, c[1] + 0.5, c[2] + 0.5};
    const double cell[3] = {c[0], c[1], c[2]};
    const int at = lr_in_brick(c[0], c[1], c[2]);
    double gap = lr_gap(s, centre, LR_EXACT_NEAR);
    for (int a = 0; a < 3; a++) /* the cell's own axes */
        gap = fmax(gap, fmax(t->lo[a] - cell[a] - 1.0, cell[a] - t->hi[a]));
    if (gap > LR_EXACT_NEAR)
        return true;
    const bool touched = gap <= LR_TOUCH;
    add(w->near, at);
    if (touched)
        add(w->touched, at);
    if (!holds(w->bad, at)) {
        double corner[8];
        cell_corners(&w->field, at, corner);
        if (w->job->every || ends_near(t, cell) ||
            corners_off(w, t, c, corner, touched && !w->crease_free) ||
            (touched && surface_off(t, cell, corner, w->job->flat ? FLAT_OFF : GRADIENT_OFF)))
            add(w->bad, at);
    }
    return add_pair(w, (uint32_t)at, t->triangle);
}

/* Do these triangles have about one normal, so that no two of them make a crease? */
static bool is_crease_free(const work *w, const uint32_t *triangle, uint64_t n)
{
    double p[3][3], first[3], normal[3];
    bool known = false;
    for (uint64_t i = 0; i < n; i++) {
        lr_triangle(w->job->mesh, triangle[i], p);
        if (!lr_normal_of((const double (*)[3])p, normal))
            continue;
        if (known && lr_dot(first, normal) < CREASE_FREE)
            return false;
        if (!known)
            memcpy(first, normal, sizeof first);
        known = true;
    }
    return true;
}

static bool test_triangle(work *w, uint32_t triangle)
{
    const lr_topology *mesh = w->job->mesh;
    piece t = {.triangle = triangle};
    lr_triangle(mesh, triangle, t.p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            t.p[c][a] -= w->first[a];
    int32_t lo[3], hi[3];
    if (!lr_normal_of((const double (*)[3])t.p, t.wound) ||
        !lr_cell_range((const double (*)[3])t.p, LR_EXACT_NEAR, lo, hi))
        return true;
    for (int a = 0; a < 3; a++) {
        t.n[a] = t.wound[a] * mesh->side;
        t.lo[a] = fmin(fmin(t.p[0][a], t.p[1][a]), t.p[2][a]);
        t.hi[a] = fmax(fmax(t.p[0][a], t.p[1][a]), t.p[2][a]);
        t.ends[a] = !lr_edge_closed(mesh, 3 * triangle + (uint32_t)a);
    }
    lr_separator s[LR_SEPARATORS];
    lr_separators_make((const double (*)[3])t.p, s);
    int32_t c[3];
    for (c[2] = lo[2]; c[2] <= hi[2]; c[2]++)
        for (c[1] = lo[1]; c[1] <= hi[1]; c[1]++)
            for (c[0] = lo[0]; c[0] <= hi[0]; c[0]++)
                if (!test_cell(w, &t, s, c))
                    return false;
    return true;
}

/* ---- lists ------------------------------------------------------------- */

static bool has_room(lr_triangle_cells_part *e, uint32_t n_cells, uint32_t n_list)
{
    uint32_t *count = realloc(e->count, ((size_t)e->n_cells + n_cells + 1) * sizeof *count);
    if (count != NULL)
        e->count = count;
    uint32_t *list = realloc(e->list, ((size_t)e->n_list + n_list + 1) * sizeof *list);
    if (list != NULL)
        e->list = list;
    return count != NULL && list != NULL;
}

/* Sort the pairs of triangle cells into lists, in the order of the mask's bits. */
static bool keep_lists(const work *w, const lr_mask exact, lr_triangle_cells_part *e)
{
    uint32_t place[LR_CELLS], n_cells = 0, n_list = 0;
    uint32_t count[LR_CELLS] = {0}, start[LR_CELLS];
    for (int cell = 0; cell < LR_CELLS; cell++) {
        place[cell] = holds(exact, cell) ? lr_mask_rank(exact, lr_along(cell, 0), lr_along(cell, 1),
                                                        lr_along(cell, 2))
                                         : UINT32_MAX;
        n_cells += place[cell] != UINT32_MAX;
    }
    for (size_t i = 0; i < w->n_pairs; i++)
        if (place[w->pairs[i].cell] != UINT32_MAX) {
            count[place[w->pairs[i].cell]]++;
            n_list++;
        }
    if (!has_room(e, n_cells, n_list))
        return false;
    memcpy(e->count + e->n_cells, count, n_cells * sizeof *count);
    for (uint32_t i = 0, at = e->n_list; i < n_cells; at += count[i++])
        start[i] = at;
    for (size_t i = 0; i < w->n_pairs; i++)
        if (place[w->pairs[i].cell] != UINT32_MAX)
            e->list[start[place[w->pairs[i].cell]]++] = w->pairs[i].triangle;
    e->n_cells += n_cells;
    e->n_list += n_list;
    return true;
}

static bool keep(const work *w, uint32_t place, lr_cells_part *part)
{
    lr_mask exact;
    uint64_t any_near = 0, any = 0;
    for (int s = 0; s < LR_WORDS; s++) {
        exact[s] = w->bad[s] & w->touched[s];
        for (uint64_t left = w->bad[s] & ~exact[s]; left != 0; left &= left - 1) {
            const int bit = __builtin_ctzll(left);
            exact[s] |= changes(&w->field, lr_cell_of_bit(s, bit)) ? (uint64_t)1 << bit : 0;
        }
        any |= w->bad[s];
        any_near |= w->near[s];
    }
    if (any_near != 0) {
        memcpy(part->near[part->n], w->near, sizeof w->near);
        part->place[part->n++] = place;
    }
    if (any == 0)
        return true;
    lr_triangle_cells_part *e = &part->exact;
    memcpy(e->doubt[e->n], w->bad, sizeof w->bad);
    memcpy(e->exact[e->n], exact, sizeof exact);
    e->place[e->n++] = place;
    return keep_lists(w, exact, e);
}

static bool test_brick(work *w, const lr_bins *bins, uint32_t active, const lr_watch *watch,
                       lr_cells_part *part, bool *stopped)
{
    const uint32_t at = bins->brick[active];
    const lr_volume *v = w->volume;
    lr_first_sample(v->table_size, at, w->first);
    memset(w->near, 0, sizeof w->near);
    memset(w->touched, 0, sizeof w->touched);
    memset(w->bad, 0, sizeof w->bad);
    w->n_pairs = 0;
    read_field(v, w->first, w->per_value, &w->field);
    w->crease_free = is_crease_free(w, bins->list + bins->start[active],
                                    bins->start[active + 1] - bins->start[active]);
    for (uint64_t i = bins->start[active]; i < bins->start[active + 1]; i++) {
        if (i % POLL == 0 && lr_stopped(watch)) {
            *stopped = true;
            return false;
        }
        if (!test_triangle(w, bins->list[i]))
            return false;
    }
    return keep(w, at, part);
}

lr_status lr_cells_make(const lr_voxel_job *job, const lr_volume *volume, const lr_bins *bins,
                        uint32_t first, uint32_t end, const lr_watch *watch, lr_cells_part *part,
                        lr_error *error)
{
    const size_t n = (size_t)(end - first) + 1;
    *part = (lr_cells_part){.place = malloc(n * sizeof *part->place),
                            .near = malloc(n * sizeof *part->near)};
    part->exact.place = malloc(n * sizeof *part->exact.place);
    part->exact.doubt = malloc(n * sizeof *part->exact.doubt);
    part->exact.exact = malloc(n * sizeof *part->exact.exact);
    const double per_value = 1.0 / (volume->one * lr_profile_slope(job->filter, job->half_width));
    const double step = per_value * lr_sample_types[volume->desc.sample_type].step;
    work w = {.job = job,
              .volume = volume,
              .per_value = per_value,
              .crease_off = fmax(CREASE_OFF, CREASE_STEPS * step)};
    bool good = part->place != NULL && part->near != NULL && part->exact.place != NULL &&
                part->exact.doubt != NULL && part->exact.exact != NULL;
    bool stopped = false;
    for (uint32_t i = first; i < end && good; i++) {
        lr_progress(watch, (double)(i - first) / (double)(end - first));
        good = test_brick(&w, bins, i, watch, part, &stopped);
    }
    free(w.pairs);
    if (good)
        return LR_OK;
    return stopped ? lr_fail_stopped(error)
                   : lr_fail_memory(error, n * sizeof(pair) + w.room * sizeof(pair),
                                    "the triangle cells of a part");
}

void lr_cells_free(lr_cells_part *part)
{
    free(part->place);
    free(part->near);
    free(part->exact.place);
    free(part->exact.doubt);
    free(part->exact.exact);
    free(part->exact.count);
    free(part->exact.list);
    memset(part, 0, sizeof *part);
}

uint64_t lr_cells_nbytes(const lr_cells_part *part)
{
    const lr_triangle_cells_part *e = &part->exact;
    return (uint64_t)e->n_cells * sizeof *e->count + (uint64_t)e->n_list * sizeof *e->list;
}
