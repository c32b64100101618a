/* Decides whether a mesh that is not closed is a solid or a sheet.
 *
 * The winding number is evaluated on either side of points on the surface. A solid has its
 * inside on one side, or on both where shells overlap; a sheet has no inside, or fractional
 * winding numbers near its borders. Edges alone do not decide: a mesh whose faces are all
 * doubled has no open edge. The winding number fills holes of a solid, which is invisible
 * while they are well below a voxel, that is a pixel or two; wider holes are visible, so such
 * a mesh is a sheet. So is one of inconsistent winding, by which the winding number is wrong.
 *
 * Source: Jacobson, Kavan, Sorkine-Hornung 2013 for the winding number; the rule is
 * our own.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/solid_or_sheet.h"

#include "base/union_find.h"

enum { PROBES = 500, POLL = 1 << 14 };

#define OFFSET      0.02 /* of a probe from the surface, voxels */
#define DOUBT       0.25 /* largest distance of a certain winding number from a whole number */
#define MOST_DOUBTS 0.05 /* fraction of the probes of a solid */
#define HOLE        0.5  /* extent up to which a hole is invisible, voxels */

/* A number in 0..1 for each n, the same in every run. */
static double uniform(uint32_t n)
{
    return lr_hash(n) * 0x1p-32;
}

static double area_of(const lr_topology *m, uint64_t t)
{
    double p[3][3], n[3];
    lr_triangle(m, t, p);
    return lr_counts(m, t) && lr_cross_of((const double (*)[3])p, n) ? sqrt(lr_dot(n, n)) : 0.0;
}

static bool looks_solid(const lr_winding *w, uint64_t t, uint32_t probe)
{
    double p[3][3], n[3], at[2][3], inside[2];
    double u = uniform(3 * probe), v = uniform(3 * probe + 1);
    lr_triangle(w->mesh, t, p);
    lr_normal_of((const double (*)[3])p, n);
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    for (int side = 0; side < 2; side++) {
        for (int a = 0; a < 3; a++) {
            double on = p[0][a] + u * (p[1][a] - p[0][a]) + v * (p[2][a] - p[0][a]);
            at[side][a] = on + (side == 0 ? OFFSET : -OFFSET) * n[a];
        }
        inside[side] = fabs(lr_winding_at(w, at[side]));
    }
    double least = fmin(inside[0], inside[1]), most = fmax(inside[0], inside[1]);
    return most > 1.0 - DOUBT && (least < DOUBT || least > 1.0 - DOUBT);
}

/* Probe points spread evenly over the area. */
static lr_status probe(const lr_winding *w, const lr_watch *watch, double *doubts, lr_error *error)
{
    const lr_topology *m = w->mesh;
    double total = 0.0, sum = 0.0;
    uint32_t n = 0, n_solid = 0;
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        total += area_of(m, t);
    }
    for (uint64_t t = 0; t < m->source.n_triangles && n < PROBES; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        for (sum += area_of(m, t); n < PROBES && sum >= total * (n + 0.5) / PROBES; n++)
            n_solid += looks_solid(w, t, n);
    }
    *doubts = n > 0 ? 1.0 - (double)n_solid / n : 1.0;
    return LR_OK;
}

/* ---- holes ------------------------------------------------------------- */

typedef struct rim {
    uint32_t parent;
    double lo[3], hi[3];
} rim;

static uint32_t rim_at(const lr_topology *m, uint32_t t, int corner, uint32_t *number, rim *rims,
                       uint32_t *n)
{
    uint32_t v = lr_welded(m, t, corner);
    if (number[v] == 0) {
        double p[3];
        lr_vertex(m, v, p);
        rims[*n].parent = *n;
        memcpy(rims[*n].lo, p, sizeof p);
        memcpy(rims[*n].hi, p, sizeof p);
        number[v] = ++*n;
    }
    return lr_root_of(&rims->parent, sizeof *rims, number[v] - 1);
}

static void join(rim *rims, uint32_t from, uint32_t to)
{
    if (from == to)
        return;
    rims[from].parent = to;
    for (int a = 0; a < 3; a++) {
        rims[to].lo[a] = fmin(rims[to].lo[a], rims[from].lo[a]);
        rims[to].hi[a] = fmax(rims[to].hi[a], rims[from].hi[a]);
    }
}

/* Extent of the widest loop of border edges; number and rims have room for all. */
static bool widest(const lr_topology *m, uint32_t *number, rim *rims, const lr_watch *watch,
                   double *hole)
{
    uint32_t n = 0;
    for (uint32_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return false;
        uint32_t a = lr_welded(m, t, 0), b = lr_welded(m, t, 1), c = lr_welded(m, t, 2);
        if (!lr_counts(m, t) || a == b || b == c || c == a)
            continue;
        for (int e = 0; e < 3; e++)
            if (m->ring[3 * t + (uint32_t)e] == 3 * t + (uint32_t)e)
                join(rims, rim_at(m, t, e, number, rims, &n),
                     rim_at(m, t, (e + 1) % 3, number, rims, &n));
    }
    *hole = 0.0;
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            *hole = fmax(*hole, rims[i].hi[a] - rims[i].lo[a]);
    return true;
}

static lr_status measure_holes(const lr_topology *m, const lr_watch *watch, double *hole,
                               lr_error *error)
{
    uint64_t n = m->n_border_edges * 2;
    uint32_t *number = calloc(m->source.n_vertices, sizeof *number);
    rim *rims = malloc((n + 1) * sizeof *rims);
    lr_status status = LR_OK;
    if (number == NULL || rims == NULL)
        status = lr_fail_memory(error, m->source.n_vertices * 4 + n * sizeof *rims,
                                "the mesh's borders");
    else if (!widest(m, number, rims, watch, hole))
        status = lr_fail_stopped(error);
    free(number);
    free(rims);
    return status;
}

lr_status lr_mesh_kind_by_edges(const lr_topology *m, const lr_watch *watch, lr_mesh_kind *j,
                                bool *open, lr_error *error)
{
    lr_status status = measure_holes(m, watch, &j->hole, error);
    j->wide = j->hole > HOLE;
    *open = j->wide || m->n_flipped_edges > 0;
    if (status == LR_OK && *open) {
        j->solid = false;
        j->reason = j->wide ? LR_REASON_HOLES : LR_REASON_FLIPPED;
    }
    return status;
}

lr_status lr_mesh_kind_by_probes(const lr_winding *w, const lr_watch *watch, lr_mesh_kind *j,
                                 lr_error *error)
{
    double doubts = 0.0;
    lr_status status = probe(w, watch, &doubts, error);
    j->solid = doubts <= MOST_DOUBTS;
    j->reason = j->solid ? LR_REASON_ENCLOSES : LR_REASON_EMPTY;
    return status;
}
