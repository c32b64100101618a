/* Putting triangle cells into a finished volume.
 *
 * Only the triangles on some list, and their vertices, are copied.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/triangle_cells.h"

#include "base/affine.h"
#include "base/error.h"

void lr_triangle_cells_free(lr_triangle_cells *e)
{
    if (e == NULL)
        return;
    free(e->doubt);
    free(e->first);
    free(e->start);
    free(e->list);
    free(e->triangle);
    free(e->vertex);
    free(e->id);
    free(e->face);
    free(e);
}

uint64_t lr_triangle_cells_nbytes(const lr_triangle_cells *e)
{
    if (e == NULL)
        return 0;
    return sizeof *e + (uint64_t)e->n_bricks * (sizeof *e->doubt + sizeof *e->first) +
           ((uint64_t)e->n_cells + 1) * sizeof *e->start +
           (uint64_t)e->start[e->n_cells] * sizeof *e->list +
           (uint64_t)e->n_triangles * (sizeof *e->triangle + (e->id != NULL ? sizeof *e->id : 0) +
                                       (e->face != NULL ? sizeof *e->face : 0)) +
           (uint64_t)e->n_vertices * sizeof *e->vertex;
}

/* ---- bricks ------------------------------------------------------------ */

/* Every brick with such cells must be stored, since their bits need a place. */
static lr_status open_bricks(lr_volume *v, const lr_triangle_cells_part *parts, uint32_t n_parts,
                             lr_error *error)
{
    uint64_t n = v->n_bricks - LR_FIRST_STORED;
    for (uint32_t p = 0; p < n_parts; p++)
        for (uint32_t i = 0; i < parts[p].n; i++)
            n += v->table[parts[p].place[i]] >> 8 < LR_FIRST_STORED;
    lr_status status = lr_volume_reserve(v, n, error);
    for (uint32_t p = 0; p < n_parts; p++)
        for (uint32_t i = 0; i < parts[p].n && status == LR_OK; i++) {
            const uint32_t sub = v->table[parts[p].place[i]] & 0xff;
            uint32_t brick = LR_BRICK_ZERO;
            status = lr_volume_open_brick(v, parts[p].place[i], &brick, error);
            v->table[parts[p].place[i]] = brick << 8 | sub;
        }
    return status;
}

static void mark_brick(lr_volume *v, uint32_t place, const lr_mask doubt, const lr_mask exact)
{
    int32_t first[3];
    lr_first_sample(v->table_size, place, first);
    const uint32_t brick = v->table[place] >> 8;
    for (int s = 0; s < LR_WORDS; s++) {
        const uint64_t more = exact[s] & ~v->cells[brick][s];
        v->cells[brick][s] |= more;
        v->n_surface_cells += (uint64_t)__builtin_popcountll(more);
        v->table[place] |= (uint32_t)(exact[s] != 0) << s;
        v->triangle_cells->doubt[brick][s] = doubt[s];
        lr_bound_word(v, first, s, more);
    }
}

/* ---- triangles --------------------------------------------------------- */

/* Numbers for what is used: number[i] is set nonzero for those, and becomes its
 * place among them, from 1 on. Returns how many. */
static uint32_t count_up(uint32_t *number, uint64_t n)
{
    uint32_t count = 0;
    for (uint64_t i = 0; i < n; i++)
        if (number[i] != 0)
            number[i] = ++count;
    return count;
}

static lr_status take_triangles(lr_triangle_cells *e, const lr_triangle_cells_source *s,
                                uint32_t *number, lr_error *error)
{
    e->n_triangles = count_up(number, s->n_triangles);
    uint32_t *vertex = calloc(s->n_vertices, sizeof *vertex);
    e->triangle = malloc(((size_t)e->n_triangles + 1) * sizeof *e->triangle);
    if (s->ids != NULL)
        e->id = malloc(((size_t)e->n_triangles + 1) * sizeof *e->id);
    if (s->faces)
        e->face = malloc(((size_t)e->n_triangles + 1) * sizeof *e->face);
    if (vertex == NULL || e->triangle == NULL || (s->ids != NULL && e->id == NULL) ||
        (s->faces && e->face == NULL)) {
        free(vertex);
        return lr_fail_memory(error, s->n_vertices * sizeof *vertex, "the triangles of cells");
    }
    for (uint64_t t = 0; t < s->n_triangles; t++)
        for (uint64_t c = 0; c < 3 && number[t] != 0; c++)
            vertex[s->triangles[3 * t + c]] = 1;
    e->n_vertices = count_up(vertex, s->n_vertices);
    e->vertex = malloc(((size_t)e->n_vertices + 1) * sizeof *e->vertex);
    if (e->vertex == NULL) {
        free(vertex);
        return lr_fail_memory(error, e->n_vertices * sizeof *e->vertex, "the vertices of cells");
    }
    for (uint64_t i = 0; i < s->n_vertices; i++)
        if (vertex[i] != 0)
            s->vertex(s->mesh, (int64_t)i, e->vertex[vertex[i] - 1]);
    for (uint64_t t = 0; t < s->n_triangles; t++) {
        if (number[t] == 0)
            continue;
        for (uint64_t c = 0; c < 3; c++)
            e->triangle[number[t] - 1][s->turned ? 2 - c : c] = vertex[s->triangles[3 * t + c]] - 1;
        if (s->ids != NULL)
            e->id[number[t] - 1] = s->ids[t];
        if (s->faces)
            e->face[number[t] - 1] = (uint32_t)t + 1;
    }
    free(vertex);
    return LR_OK;
}

static lr_status take_lists(lr_volume *v, lr_triangle_cells *e, const lr_triangle_cells_part *parts,
                            uint32_t n_parts, const lr_triangle_cells_source *source,
                            lr_error *error)
{
    uint32_t *number = calloc(source->n_triangles, sizeof *number);
    if (number == NULL)
        return lr_fail_memory(error, source->n_triangles * sizeof *number, "a list of triangles");
    uint32_t cell = 0, at = 0;
    for (uint32_t p = 0; p < n_parts; p++) {
        uint32_t in_part = cell;
        for (uint32_t i = 0; i < parts[p].n; i++) {
            e->first[v->table[parts[p].place[i]] >> 8] = in_part;
            for (int s = 0; s < LR_WORDS; s++)
                in_part += (uint32_t)__builtin_popcountll(parts[p].exact[i][s]);
        }
        for (uint32_t i = 0; i < parts[p].n_cells; i++) {
            e->start[cell++] = at;
            at += parts[p].count[i];
        }
        for (uint32_t i = 0; i < parts[p].n_list; i++)
            number[parts[p].list[i]] = 1;
    }
    e->start[cell] = at;
    lr_status status = take_triangles(e, source, number, error);
    at = 0;
    for (uint32_t p = 0; p < n_parts; p++)
        for (uint32_t i = 0; i < parts[p].n_list; i++)
            e->list[at++] = number[parts[p].list[i]] - 1;
    free(number);
    return status;
}

/* ---- all --------------------------------------------------------------- */

static lr_status make(lr_volume *v, lr_triangle_cells *e, const lr_triangle_cells_part *parts,
                      uint32_t n_parts, const lr_triangle_cells_source *source, lr_error *error)
{
    uint64_t n_cells = 0, n_list = 0;
    for (uint32_t p = 0; p < n_parts; p++) {
        n_cells += parts[p].n_cells;
        n_list += parts[p].n_list;
    }
    if (n_cells >= UINT32_MAX || n_list >= UINT32_MAX)
        return lr_fail(error, LR_E_SIZE,
                       "the triangle cells' lists would hold %llu triangles, more than 2^32",
                       (unsigned long long)n_list);
    lr_status status = open_bricks(v, parts, n_parts, error);
    if (status != LR_OK)
        return status;
    e->n_bricks = v->n_bricks;
    e->n_cells = (uint32_t)n_cells;
    e->voxels_per_value = 1.0 / (source->slope * v->one);
    e->doubt = calloc(e->n_bricks, sizeof *e->doubt);
    e->first = calloc(e->n_bricks, sizeof *e->first);
    e->start = malloc((n_cells + 1) * sizeof *e->start);
    e->list = malloc((n_list + 1) * sizeof *e->list);
    if (e->doubt == NULL || e->first == NULL || e->start == NULL || e->list == NULL)
        return lr_fail_memory(error, (n_cells + n_list) * sizeof *e->list, "the triangle cells");
    return take_lists(v, e, parts, n_parts, source, error);
}

lr_status lr_triangle_cells_attach(lr_volume *v, const lr_triangle_cells_part *parts,
                                   uint32_t n_parts, const lr_triangle_cells_source *source,
                                   const lr_watch *watch, lr_error *error)
{
    uint32_t n = 0;
    for (uint32_t p = 0; p < n_parts; p++)
        n += parts[p].n;
    if (n == 0)
        return LR_OK;
    lr_triangle_cells *e = calloc(1, sizeof *e);
    lr_status status = e == NULL ? lr_fail_memory(error, sizeof *e, "triangle cells")
                                 : make(v, e, parts, n_parts, source, error);
    if (status == LR_OK && lr_stopped(watch))
        status = lr_fail_stopped(error);
    if (status != LR_OK) {
        lr_triangle_cells_free(e);
        return status;
    }
    v->triangle_cells = e;
    for (uint32_t p = 0; p < n_parts; p++)
        for (uint32_t i = 0; i < parts[p].n; i++)
            mark_brick(v, parts[p].place[i], parts[p].doubt[i], parts[p].exact[i]);
    return LR_OK;
}

/* ---- points ------------------------------------------------------------ */

/* Source: Ericson 2005, Real-time collision detection, 5.1.5. */
double lr_triangle_cell_distance2(const lr_triangle_cells *e, uint32_t triangle, const double q[3])
{
    const double *p[3];
    double n[3], best = INFINITY;
    bool over_face = true;
    lr_triangle_cell_corners(e, triangle, p);
    lr_triangle_cell_normal(e, triangle, n);
    for (int c = 0; c < 3; c++)
        over_face = over_face && lr_beyond_edge(p[c], p[(c + 1) % 3], n, q) <= 0.0;
    if (over_face) {
        const double height = lr_height_over(p[0], n, q);
        return height * height / lr_dot(n, n);
    }
    for (int c = 0; c < 3; c++) {
        double along[3], from[3], square = 0.0;
        for (int i = 0; i < 3; i++) {
            along[i] = p[(c + 1) % 3][i] - p[c][i];
            from[i] = q[i] - p[c][i];
        }
        const double share = lr_clamp(lr_dot(along, from) / lr_dot(along, along), 0.0, 1.0);
        for (int i = 0; i < 3; i++)
            square += (from[i] - share * along[i]) * (from[i] - share * along[i]);
        best = square < best ? square : best;
    }
    return best;
}

uint32_t lr_triangle_cell_nearest(const lr_volume *v, const int32_t c[3], const double q[3])
{
    uint32_t nearest = LR_NO_TRIANGLE, n;
    double least = INFINITY;
    if (v->triangle_cells == NULL || !lr_is_triangle_cell(v, c))
        return nearest;
    const uint32_t *list = lr_triangle_cell_list(v, c, &n);
    for (uint32_t i = 0; i < n; i++) {
        const double square = lr_triangle_cell_distance2(v->triangle_cells, list[i], q);
        if (square < least) {
            least = square;
            nearest = list[i];
        }
    }
    return nearest;
}

lr_status lr_volume_exact_at(const lr_volume *v, const double *points, uint64_t n, uint8_t *exact,
                             lr_error *error)
{
    if (!v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    const int32_t last[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1}; /* storage cells */
    for (uint64_t i = 0; i < n; i++) {
        double q[3];
        int32_t c[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        bool inside = v->triangle_cells != NULL;
        for (int a = 0; a < 3; a++) {
            inside = inside && q[a] >= 1.0 && q[a] <= last[a] + 1.0;
            c[a] = (int32_t)lr_clamp(floor(q[a]), 1.0, last[a]);
        }
        exact[i] = inside && lr_is_triangle_cell(v, c);
    }
    return LR_OK;
}
