/* What is written for a ray: misses, and hits with normals and ids.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_HIT_RECORD_H
#define LR_TRACE_HIT_RECORD_H

#include "trace/hit_normal.h"
#include "trace/object_cell.h"

LR_INLINE void lr_put_triple(double *x, double *y, double *z, uint64_t i, const double v[3])
{
    if (x != NULL)
        x[i] = v[0];
    if (y != NULL)
        y[i] = v[1];
    if (z != NULL)
        z[i] = v[2];
}

LR_INLINE void lr_put_cell(const lr_hits *hits, uint64_t i, const int32_t c[3])
{
    if (hits->ci != NULL)
        hits->ci[i] = c[0] - LR_PAD;
    if (hits->cj != NULL)
        hits->cj[i] = c[1] - LR_PAD;
    if (hits->ck != NULL)
        hits->ck[i] = c[2] - LR_PAD;
}

/* Rays first..end-1 hit nothing. */
LR_INLINE void lr_put_misses(const lr_hits *hits, uint64_t first, uint64_t end)
{
    double *const numbers[6] = {hits->nx, hits->ny, hits->nz, hits->gx, hits->gy, hits->gz};
    int32_t *const cells[3] = {hits->ci, hits->cj, hits->ck};
    for (uint64_t i = first; i < end; i++)
        hits->t[i] = INFINITY;
    for (int n = 0; n < 6; n++)
        if (numbers[n] != NULL)
            memset(numbers[n] + first, 0, (end - first) * sizeof(double));
    for (int n = 0; n < 3; n++)
        for (uint64_t i = first; i < end && cells[n] != NULL; i++)
            cells[n][i] = INT32_MIN;
    if (hits->id != NULL)
        memset(hits->id + first, 0, (end - first) * sizeof *hits->id);
    for (uint64_t i = first; i < end && hits->triangle != NULL; i++)
        hits->triangle[i] = LR_NO_TRIANGLE;
}

LR_INLINE void lr_put_miss(const lr_hits *hits, uint64_t i)
{
    lr_put_misses(hits, i, i + 1);
}

/* Ray i has stood in so many cells. */
LR_INLINE void lr_put_steps(const lr_hits *hits, uint64_t i, uint64_t cells)
{
    if (hits->steps != NULL)
        hits->steps[i] = (int32_t)(cells < INT32_MAX ? cells : INT32_MAX);
}

/* Rays first..end-1 meet nothing of a visible volume. */
LR_INLINE void lr_put_dark(const lr_hits *hits, uint64_t first, uint64_t end)
{
    double *const numbers[6] = {hits->red,           hits->green, hits->blue,
                                hits->transmittance, hits->value, hits->length};
    const double dark[6] = {0.0, 0.0, 0.0, 1.0, NAN, 0.0};
    lr_put_misses(hits, first, end);
    for (int n = 0; n < 6; n++)
        for (uint64_t i = first; i < end && numbers[n] != NULL; i++)
            numbers[n][i] = dark[n];
    for (uint64_t i = first; i < end; i++)
        lr_put_steps(hits, i, 0);
}

/* What ray i has seen of one, from t on (infinity: nothing), in so many cells. */
LR_INLINE void lr_put_light(const lr_hits *hits, uint64_t i, double t, const double color[3],
                            double transmittance, uint64_t cells, lr_counters *counters)
{
    hits->t[i] = t;
    lr_put_triple(hits->red, hits->green, hits->blue, i, color);
    if (hits->transmittance != NULL)
        hits->transmittance[i] = transmittance;
    lr_put_steps(hits, i, cells);
    counters->cells += cells;
    counters->hits += t < INFINITY;
    if (counters->most_cells < cells)
        counters->most_cells = cells;
}

LR_INLINE void lr_towards_origin(const double d[3], double normal[3])
{
    double length = sqrt(lr_dot(d, d));
    for (int a = 0; a < 3; a++)
        normal[a] = -d[a] / length;
}

/* The id of the object sample nearest to p among the cell's corners. */
LR_INLINE int32_t lr_nearest_id(const lr_volume *v, const int32_t c[3], const double corner[8],
                                const double p[3])
{
    if (v->ids == NULL)
        return 0;
    double nearest = INFINITY;
    int32_t id = 0;
    for (int b = 0; b < 8; b++) {
        const double q[3] = {p[0] - (b & 1), p[1] - (b >> 1 & 1), p[2] - (b >> 2)};
        double square = lr_dot(q, q);
        if (corner[b] >= v->threshold && square < nearest) {
            nearest = square;
            id = lr_id(v, c[0] + (b & 1), c[1] + (b >> 1 & 1), c[2] + (b >> 2));
        }
    }
    return id;
}

/* What is known of a triangle that was hit. */
LR_INLINE void lr_put_triangle(const lr_volume *v, const lr_hits *hits, uint64_t i,
                               const lr_found *found, int32_t normal_kind)
{
    double own[3], shading[3];
    if (hits->triangle != NULL)
        hits->triangle[i] = found->triangle;
    if (hits->id != NULL)
        hits->id[i] = v->triangle_cells->id != NULL ? v->triangle_cells->id[found->triangle] : 0;
    if (hits->nx == NULL && hits->gx == NULL)
        return;
    lr_triangle_normals(v, found->triangle, found->c, found->p, normal_kind, own, shading);
    lr_put_triple(hits->nx, hits->ny, hits->nz, i, shading);
    lr_put_triple(hits->gx, hits->gy, hits->gz, i, own);
}

/* A surface hit; d is the ray's direction in object space. */
LR_INLINE void lr_put_surface(const lr_volume *v, const lr_hits *hits, uint64_t i,
                              const lr_found *found, const double d[3], int32_t normal_kind)
{
    const int32_t *c = found->c;
    const double *corner = found->corner;
    hits->t[i] = found->t;
    lr_put_cell(hits, i, c);
    if (found->triangle != LR_NO_TRIANGLE) {
        lr_put_triangle(v, hits, i, found, normal_kind);
        return;
    }
    if (hits->id == NULL && hits->nx == NULL && hits->gx == NULL)
        return; /* only whether and where */
    const int32_t id = found->object != LR_NO_OBJECT ? lr_id_of_object(v, found)
                                                     : lr_nearest_id(v, c, corner, found->p);
    if (hits->id != NULL)
        hits->id[i] = id;
    if (hits->nx == NULL && hits->gx == NULL)
        return;
    double own[3], shading[3];
    if (!lr_field_normal(v, c, corner, found->p, own))
        lr_towards_origin(d, own);
    lr_put_triple(hits->gx, hits->gy, hits->gz, i, own);
    if (hits->nx == NULL)
        return;
    lr_field_shading_normal(v, found->object, id, c, found->p, normal_kind, own, shading);
    lr_put_triple(hits->nx, hits->ny, hits->nz, i, shading);
}

/* An object cell: its normal is that of the face by which the ray came, none
 * where it started inside. */
LR_INLINE void lr_put_binary(const lr_volume *v, const lr_hits *hits, uint64_t i, const lr_ray *r,
                             const lr_cursor *u)
{
    double g[3] = {0.0, 0.0, 0.0}, normal[3] = {0.0, 0.0, 0.0};
    hits->t[i] = u->t;
    lr_put_cell(hits, i, u->c);
    if (u->axis >= 0) {
        g[u->axis] = r->s[u->axis];
        lr_outward(v, g, normal);
    }
    lr_put_triple(hits->nx, hits->ny, hits->nz, i, normal);
    lr_put_triple(hits->gx, hits->gy, hits->gz, i, normal);
    if (hits->id != NULL) {
        double corner[8];
        const double centre[3] = {0.5, 0.5, 0.5};
        lr_corners(v, u->c, corner);
        hits->id[i] = lr_nearest_id(v, u->c, corner, centre);
    }
}

#endif
