/* Mesh set-up: check, weld, edges, pseudonormals, orientation.
 *
 * Vertices at exactly equal positions are one vertex. The half-edges of one edge are
 * linked into a ring. The pseudonormal of an edge is the sum of its faces' unit normals,
 * that of a vertex weights them by the angle; for a closed mesh the sign of (p - c).n at
 * the closest point c tells inside from outside, wherever c lies. They are summed where
 * they are asked for, around the rings, since few samples ask.
 *
 * Source: Baerentzen and Aanaes 2005, Signed distance computation using the
 * angle weighted pseudonormal.
 * Departures: 1. border edges and vertices have pseudonormals of the faces they
 * have, which gives a sheet its local sides; a fan ends where more than two faces
 * share an edge; 2. a triangle without area keeps its place among the edges, but has
 * no normal and no distance of its own; 3. of
 * triangles on the same three places, wound either way, the first one counts.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/pages.h"
#include "mesh/half_edges.h"

enum {
    POLL = 1 << 16, /* loop turns between looks at the stop word: some ms */
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

/* No vertex that a triangle uses may be so far out that voxels lose their meaning. */
static lr_status check_reach(const lr_topology *m, lr_error *error)
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

/* Bounds, triangles without area, and the volume seen from a vertex, so that little
 * cancels. */
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

/* ---- edges ------------------------------------------------------------- */

static void ends(const lr_topology *m, uint32_t half_edge, uint32_t v[2])
{
    uint32_t t = half_edge / 3, e = half_edge % 3;
    v[0] = lr_welded(m, t, (int)e);
    v[1] = lr_welded(m, t, (int)((e + 1) % 3));
}

static uint32_t third_place(const lr_topology *m, uint32_t h)
{
    return lr_welded(m, h / 3, (int)((h % 3 + 2) % 3));
}

/* The first half-edge of a run whose triangle has the same third place; the
 * half-edge itself where there is none. Only the last of a long run are looked at. */
static uint32_t first_twin(const lr_topology *m, const uint64_t *run, uint32_t n, uint32_t h)
{
    uint32_t third = third_place(m, h);
    for (uint32_t i = n > 64 ? n - 64 : 0; i < n; i++)
        if (third_place(m, lr_half_edge_of(run[i])) == third)
            return lr_half_edge_of(run[i]);
    return h;
}

static bool mark_twin(lr_topology *m, uint32_t t, uint32_t first)
{
    if (m->twin == NULL) {
        m->twin = lr_pages_new(m->source.n_triangles, sizeof *m->twin);
        for (uint32_t i = 0; m->twin != NULL && i < m->source.n_triangles; i++)
            m->twin[i] = i;
    }
    if (m->twin == NULL)
        return false;
    double p[3][3], n[3];
    lr_triangle(m, t, p);
    if (m->twin[t] == t && lr_normal_of((const double (*)[3])p, n))
        m->n_degenerate++; /* those without area are counted before */
    m->twin[t] = first;
    return true;
}

/* Take the half-edges of triangles that are there twice out of a run. */
static bool drop_twins(lr_topology *m, uint64_t *run, uint32_t *n)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < *n; i++) {
        uint32_t h = lr_half_edge_of(run[i]), twin = first_twin(m, run, kept, h);
        if (twin == h)
            run[kept++] = run[i];
        else if (!mark_twin(m, h / 3, twin / 3))
            return false;
    }
    *n = kept;
    return true;
}

static void link_run(lr_topology *m, const uint64_t *run, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        m->ring[lr_half_edge_of(run[i])] = lr_half_edge_of(run[i + 1 < n ? i + 1 : 0]);
    const bool flipped = n == 2 && ((run[0] ^ run[1]) & 1) == 0;
    m->n_border_edges += n == 1;
    m->n_bad_edges += n > 2 || flipped;
    m->n_flipped_edges += flipped;
}

/* The half-edges of one vertex. */
static bool link_vertex(lr_topology *m, uint64_t *key, uint32_t n)
{
    for (uint32_t first = 0, end; first < n; first = end) {
        end = lr_edge_end(key, n, first);
        uint32_t n_run = end - first;
        if (n_run > 1 && !drop_twins(m, key + first, &n_run))
            return false;
        link_run(m, key + first, n_run);
    }
    return true;
}

static lr_status link_edges(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    const uint64_t n = 3 * m->source.n_triangles;
    m->ring = lr_pages_new(n, sizeof *m->ring);
    if (m->ring == NULL)
        return lr_fail_memory(error, n * sizeof *m->ring, "the mesh's edges");
    for (uint32_t h = 0; h < n; h++)
        m->ring[h] = h;
    lr_half_edges edges;
    uint64_t *key;
    uint32_t n_here;
    lr_status status = lr_half_edges_begin(m, false, watch, &edges, error);
    while (status == LR_OK &&
           (status = lr_half_edges_next(&edges, watch, &key, &n_here, error)) == LR_OK &&
           n_here > 0)
        if (!link_vertex(m, key, n_here))
            status =
                lr_fail_memory(error, m->source.n_triangles * 4, "the mesh's double triangles");
    lr_half_edges_free(&edges);
    m->closed = m->n_border_edges == 0 && m->n_bad_edges == 0;
    return status;
}

/* What the triangles that do not count added to the volume. */
static double volume_of_twins(const lr_topology *m)
{
    double from[3], volume = 0.0;
    lr_vertex(m, m->source.triangles[0], from);
    for (uint64_t t = 0; m->twin != NULL && t < m->source.n_triangles; t++) {
        double p[3][3], n[3];
        lr_triangle(m, t, p);
        if (lr_counts(m, t) || !lr_cross_of((const double (*)[3])p, n))
            continue;
        lr_sub(p[0], from, p[0]);
        volume += lr_dot(p[0], n);
    }
    return volume;
}

/* ---- all --------------------------------------------------------------- */

lr_status lr_topology_begin(const lr_mesh *mesh, double voxel_size, const lr_watch *watch,
                            lr_topology *m, lr_error *error)
{
    *m = (lr_topology){.source = *mesh, .per_unit = 1.0 / voxel_size, .side = 1.0};
    double farthest = 0.0;
    lr_status status = lr_mesh_check(mesh, watch, &farthest, error);
    if (status == LR_OK && !(farthest * m->per_unit <= FARTHEST))
        status = check_reach(m, error);
    if (status == LR_OK)
        status = measure(m, watch, error);
    return status;
}

lr_status lr_topology_link(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    lr_status status = lr_topology_weld(m, watch, error);
    if (status == LR_OK)
        status = link_edges(m, watch, error);
    if (status == LR_OK && m->closed && m->volume - volume_of_twins(m) < 0.0)
        m->side = -1.0; /* wound inside out */
    return status;
}

bool lr_edge_closed(const lr_topology *m, uint32_t half_edge)
{
    uint32_t other = m->ring[half_edge], a[2], b[2];
    if (other == half_edge || m->ring[other] != half_edge)
        return false;
    ends(m, half_edge, a);
    ends(m, other, b);
    return a[0] == b[1];
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
