/* Checks, welds and measures a mesh.
 *
 * Vertices at exactly equal positions are one vertex.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/topology.h"

#include "base/pages.h"

enum {
    POLL = 1 << 16, /* iterations between checks of the stop word: some ms */
    AHEAD = 16      /* vertices whose slots are fetched together; divides POLL */
};

/* Beyond this distance from the object's origin, in voxels, f64 coordinates
 * are coarser than 1e-5 voxel. */
#define FARTHEST 0x1p36

lr_status lr_mesh_check(const lr_mesh *mesh, const lr_watch *watch, double *farthest,
                        lr_error *error)
{
    if (mesh->vertices == NULL || mesh->triangles == NULL || mesh->n_vertices == 0 ||
        mesh->n_triangles == 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the mesh has %llu vertices and %llu triangles; at least one triangle is "
                       "needed",
                       (unsigned long long)mesh->n_vertices, (unsigned long long)mesh->n_triangles);
    if (mesh->n_vertices > INT32_MAX || mesh->n_triangles > UINT32_MAX / 3 - 1)
        return lr_fail(error, LR_E_SIZE,
                       "the mesh has %llu vertices and %llu triangles; at most %d and %u are taken",
                       (unsigned long long)mesh->n_vertices, (unsigned long long)mesh->n_triangles,
                       INT32_MAX, UINT32_MAX / 3 - 1);
    for (uint64_t i = 0; i < 3 * mesh->n_vertices; i++) {
        if (i % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (!isfinite(mesh->vertices[i]))
            return lr_fail(error, LR_E_ARGUMENT, "vertex %llu of the mesh has the coordinate %g",
                           (unsigned long long)(i / 3), mesh->vertices[i]);
        *farthest = fmax(*farthest, fabs(mesh->vertices[i]));
    }
    for (uint64_t i = 0; i < 3 * mesh->n_triangles; i++) {
        if (i % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (mesh->triangles[i] < 0 || (uint64_t)mesh->triangles[i] >= mesh->n_vertices)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu of the mesh names vertex %d, but there are %llu vertices",
                           (unsigned long long)(i / 3), mesh->triangles[i],
                           (unsigned long long)mesh->n_vertices);
    }
    return LR_OK;
}

/* Refuse vertices of triangles that lie beyond FARTHEST. */
static lr_status check_extent(const lr_topology *m, lr_error *error)
{
    for (uint64_t i = 0; i < 3 * m->source.n_triangles; i++) {
        const double *v = m->source.vertices + 3 * (int64_t)m->source.triangles[i];
        for (int a = 0; a < 3; a++)
            if (!(fabs(v[a]) * m->per_unit <= FARTHEST))
                return lr_fail(error, LR_E_SIZE,
                               "vertex %d lies %g from the object's origin, too far for a "
                               "voxel_size of %g: coordinates carry at most %g voxels",
                               m->source.triangles[i], fabs(v[a]), 1.0 / m->per_unit, FARTHEST);
    }
    return LR_OK;
}

static void widen(const lr_topology *m, const int32_t corner[3], double lo[3], double hi[3])
{
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            double x = m->source.vertices[3 * (int64_t)corner[c] + a];
            lo[a] = x < lo[a] ? x : lo[a];
            hi[a] = x > hi[a] ? x : hi[a];
        }
}

/* Find the bounds, the triangles without area, and the volume, with a vertex as origin to limit
 * cancellation. */
static lr_status measure(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    double lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
    double from[3], volume = 0.0;
    lr_vertex(m, m->source.triangles[0], from);
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        double p[3][3], n[3];
        lr_triangle(m, t, p);
        if (!lr_cross_of((const double (*)[3])p, n)) {
            m->n_flat++;
            continue;
        }
        widen(m, m->source.triangles + 3 * t, lo, hi);
        lr_sub(p[0], from, p[0]);
        volume += lr_dot(p[0], n);
    }
    m->volume = volume;
    m->n_degenerate = m->n_flat;
    memcpy(m->lo, lo, sizeof lo);
    memcpy(m->hi, hi, sizeof hi);
    if (m->n_flat == m->source.n_triangles)
        return lr_fail(error, LR_E_ARGUMENT, "none of the mesh's %llu triangles has an area",
                       (unsigned long long)m->source.n_triangles);
    return LR_OK;
}

/* ---- welding ----------------------------------------------------------- */

static uint64_t mix(uint64_t h, double x)
{
    uint64_t bits;
    x += 0.0; /* -0 is 0 */
    memcpy(&bits, &x, sizeof bits);
    h = (h ^ bits) * 0x9e3779b97f4a7c15u;
    h = (h ^ h >> 32) * 0xd6e8feb86659fd93u;
    return h ^ h >> 29;
}

static bool same_place(const double *a, const double *b)
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Open addressing; a slot holds a vertex + 1. */
static uint32_t first_at(const double *vertices, uint32_t v, uint32_t *slot, uint64_t at,
                         uint64_t mask)
{
    const double *p = vertices + 3 * (size_t)v;
    while (slot[at] != 0 && !same_place(vertices + 3 * (size_t)(slot[at] - 1), p))
        at = (at + 1) & mask;
    if (slot[at] == 0)
        slot[at] = v + 1;
    return slot[at] - 1;
}

lr_status lr_topology_weld(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    uint64_t n = m->source.n_vertices, n_slots = 16, n_double = 0;
    while (n_slots < 2 * n)
        n_slots *= 2;
    uint32_t *slot = lr_pages_new(n_slots, sizeof *slot);
    m->weld = lr_pages_new(n, sizeof *m->weld);
    if (slot == NULL || m->weld == NULL) {
        lr_pages_free(slot);
        return lr_fail_memory(error, (n_slots + n) * 4, "the mesh's vertices");
    }
    for (uint64_t v = 0; v < n; v += AHEAD) {
        if (v % POLL == 0 && lr_stopped(watch)) {
            lr_pages_free(slot);
            return lr_fail_stopped(error);
        }
        uint64_t at[AHEAD], end = v + AHEAD < n ? v + AHEAD : n;
        for (uint64_t w = v; w < end; w++) {
            const double *p = m->source.vertices + 3 * w;
            at[w - v] = mix(mix(mix(0, p[0]), p[1]), p[2]) & (n_slots - 1);
            __builtin_prefetch(&slot[at[w - v]]);
        }
        for (uint64_t w = v; w < end; w++) {
            m->weld[w] = first_at(m->source.vertices, (uint32_t)w, slot, at[w - v], n_slots - 1);
            n_double += m->weld[w] != w;
        }
    }
    lr_pages_free(slot);
    if (n_double == 0) {
        lr_pages_free(m->weld);
        m->weld = NULL;
    }
    return LR_OK;
}

/* ---- all --------------------------------------------------------------- */

lr_status lr_topology_begin(const lr_mesh *mesh, double voxel_size, const lr_watch *watch,
                            lr_topology *m, lr_error *error)
{
    *m = (lr_topology){.source = *mesh, .per_unit = 1.0 / voxel_size, .side = 1.0};
    double farthest = 0.0;
    lr_status status = lr_mesh_check(mesh, watch, &farthest, error);
    if (status == LR_OK && !(farthest * m->per_unit <= FARTHEST))
        status = check_extent(m, error);
    if (status == LR_OK)
        status = measure(m, watch, error);
    return status;
}

void lr_topology_unlink(lr_topology *m)
{
    lr_pages_free(m->weld);
    lr_pages_free(m->ring);
    lr_pages_free(m->twin);
    m->weld = m->ring = m->twin = NULL;
}

void lr_topology_free(lr_topology *m)
{
    lr_topology_unlink(m);
    *m = (lr_topology){0};
}
