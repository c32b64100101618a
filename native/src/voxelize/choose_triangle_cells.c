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
#include "voxelize/cell_tests.h"
#include "voxelize/filter_profile.h"

enum { POLL = 1 << 6 };

/* Near a crease, errors of the samples become visible to rays that graze a plane. Tolerance in
 * quantization steps, and in voxels. */
static const double CREASE_STEPS = 4.0, CREASE_OFF = 1e-3;
static const double CREASE_FREE = 0.985; /* cosine of half the angle of a crease */

typedef struct work {
    lr_cell_work of_brick;
    const lr_volume *volume;
    double per_value; /* voxels at the surface, of a stored value */
} work;

LR_INLINE bool holds(const lr_mask mask, int cell)
{
    return lr_mask_has(mask, lr_along(cell, 0), lr_along(cell, 1), lr_along(cell, 2));
}

/* ---- samples ----------------------------------------------------------- */

/* The corners of the brick's cells, to f32 accuracy. */
static void read_corners(const work *w, const int32_t first[3], double *field)
{
    enum { SIDE = LR_SIDE + 1 };
    double sample[SIDE * SIDE * SIDE];
    lr_brick_corners(w->volume, first, sample);
    const double *next = sample;
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++)
                field[lr_field_at(x, y, z)] =
                    (double)(float)((*next++ - w->volume->threshold) * w->per_value);
}

/* The samples beside those; 0 where there are none. */
static void read_rim(const work *w, const int32_t first[3], double *field)
{
    const lr_volume *v = w->volume;
    for (int z = -1; z <= LR_SIDE + 1; z++)
        for (int y = -1; y <= LR_SIDE + 1; y++) {
            const bool inside = z >= 0 && z <= LR_SIDE && y >= 0 && y <= LR_SIDE;
            for (int x = -1; x <= LR_SIDE + 1; x += inside ? LR_SIDE + 2 : 1) {
                const int32_t c[3] = {first[0] + x, first[1] + y, first[2] + z};
                const double g = lr_has_sample(v, c) ? lr_sample(v, c[0], c[1], c[2]) : 0.0;
                field[lr_field_at(x, y, z)] = (g - v->threshold) * w->per_value;
            }
        }
}

/* Do the samples of a cell lie on different sides? */
static bool changes(const double *field, int cell)
{
    const double *at = field + lr_field_at(lr_along(cell, 0), lr_along(cell, 1), lr_along(cell, 2));
    int inside = 0;
    for (int b = 0; b < 8; b++)
        inside += at[(b & 1) + LR_FIELD_SIDE * (b >> 1 & 1) + LR_FIELD_LAYER * (b >> 2)] >= 0.0;
    return inside > 0 && inside < 8;
}

/* Do these triangles have about one normal, so that no two of them make a crease? */
static bool is_crease_free(const lr_topology *mesh, const uint32_t *triangle, uint64_t n)
{
    double p[3][3], first[3] = {0.0}, normal[3];
    bool known = false;
    for (uint64_t i = 0; i < n; i++) {
        lr_triangle(mesh, triangle[i], p);
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
static bool keep_lists(const lr_cell_work *w, const lr_mask exact, lr_triangle_cells_part *e)
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

static bool keep(const lr_cell_work *w, uint32_t place, lr_cells_part *part)
{
    lr_mask exact;
    uint64_t any_near = 0, any = 0;
    for (int s = 0; s < LR_WORDS; s++) {
        exact[s] = w->bad[s] & w->touched[s];
        for (uint64_t left = w->bad[s] & ~exact[s]; left != 0; left &= left - 1) {
            const int bit = __builtin_ctzll(left);
            exact[s] |= changes(w->field, lr_cell_of_bit(s, bit)) ? (uint64_t)1 << bit : 0;
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
    lr_cell_work *b = &w->of_brick;
    lr_first_sample(w->volume->table_size, at, b->first);
    memset(b->near, 0, sizeof b->near);
    memset(b->touched, 0, sizeof b->touched);
    memset(b->bad, 0, sizeof b->bad);
    b->n_pairs = 0;
    read_corners(w, b->first, b->field);
    b->crease_free = is_crease_free(b->job->mesh, bins->list + bins->start[active],
                                    bins->start[active + 1] - bins->start[active]);
    if (!b->crease_free)
        read_rim(w, b->first, b->field);
    for (uint64_t i = bins->start[active]; i < bins->start[active + 1]; i++) {
        if (i % POLL == 0 && lr_stopped(watch)) {
            *stopped = true;
            return false;
        }
        if (!b->job->test_cells(b, bins->list[i]))
            return false;
    }
    return keep(b, at, part);
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
    work w = {.volume = volume, .per_value = per_value};
    w.of_brick.job = job;
    w.of_brick.crease_off = fmax(CREASE_OFF, CREASE_STEPS * step);
    bool good = part->place != NULL && part->near != NULL && part->exact.place != NULL &&
                part->exact.doubt != NULL && part->exact.exact != NULL;
    bool stopped = false;
    for (uint32_t i = first; i < end && good; i++) {
        lr_progress(watch, (double)(i - first) / (double)(end - first));
        good = test_brick(&w, bins, i, watch, part, &stopped);
    }
    free(w.of_brick.pairs);
    if (good)
        return LR_OK;
    return stopped ? lr_fail_stopped(error)
                   : lr_fail_memory(error, (n + w.of_brick.room) * sizeof(lr_cell_pair),
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
