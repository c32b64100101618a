/* Mesh set-up: check, weld, edges, pseudonormals, orientation.
 *
 * Vertices at exactly equal positions are one vertex. Half-edges are sorted by
 * their two vertices (two counting passes, higher vertex first), so that those
 * of one edge lie side by side and are linked into a ring. The pseudonormal of
 * an edge is the sum of its faces' unit normals, that of a vertex weights them
 * by the angle; for a closed mesh the sign of (p - c).n at the closest point c
 * tells inside from outside, wherever c lies.
 *
 * Source: Baerentzen and Aanaes 2005, Signed distance computation using the
 * angle weighted pseudonormal.
 * Departures: 1. border edges and vertices have pseudonormals of the faces they
 * have, which gives a sheet its local sides; 2. a triangle without area keeps its
 * place among the edges, but has no normal and no distance of its own; 3. of
 * triangles on the same three places, wound either way, the first one counts.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/mesh.h"

enum { POLL = 1 << 16 }; /* loop turns between looks at the stop word: some ms */

/* Beyond this distance from the object's origin, in voxels, f64 coordinates
 * are coarser than 1e-5 voxel. */
#define FARTHEST 0x1p36

static lr_status check_vertices(const lr_mesh *mesh, lr_error *error)
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
    for (uint64_t i = 0; i < 3 * mesh->n_vertices; i++)
        if (!isfinite(mesh->vertices[i]))
            return lr_fail(error, LR_E_ARGUMENT, "vertex %llu of the mesh has the coordinate %g",
                           (unsigned long long)(i / 3), mesh->vertices[i]);
    for (uint64_t i = 0; i < 3 * mesh->n_triangles; i++)
        if (mesh->triangles[i] < 0 || (uint64_t)mesh->triangles[i] >= mesh->n_vertices)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu of the mesh names vertex %d, but there are %llu vertices",
                           (unsigned long long)(i / 3), mesh->triangles[i],
                           (unsigned long long)mesh->n_vertices);
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

static void widen(lr_topology *m, const int32_t corner[3])
{
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            double x = m->source.vertices[3 * (int64_t)corner[c] + a];
            m->lo[a] = x < m->lo[a] ? x : m->lo[a];
            m->hi[a] = x > m->hi[a] ? x : m->hi[a];
        }
}

static lr_status find_bounds(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    for (int a = 0; a < 3; a++) {
        m->lo[a] = INFINITY;
        m->hi[a] = -INFINITY;
    }
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        double p[3][3], n[3];
        lr_triangle(m, t, p);
        if (lr_normal_of((const double(*)[3])p, n))
            widen(m, m->source.triangles + 3 * t);
        else
            m->n_degenerate++;
    }
    if (m->n_degenerate == m->source.n_triangles)
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
static uint32_t first_at(const double *vertices, uint32_t v, uint32_t *slot, uint64_t mask)
{
    const double *p = vertices + 3 * (size_t)v;
    uint64_t at = mix(mix(mix(0, p[0]), p[1]), p[2]) & mask;
    while (slot[at] != 0 && !same_place(vertices + 3 * (size_t)(slot[at] - 1), p))
        at = (at + 1) & mask;
    if (slot[at] == 0)
        slot[at] = v + 1;
    return slot[at] - 1;
}

static lr_status weld(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    uint64_t n = m->source.n_vertices, n_slots = 16, n_double = 0;
    while (n_slots < 2 * n)
        n_slots *= 2;
    uint32_t *slot = calloc(n_slots, sizeof *slot);
    m->weld = malloc(n * sizeof *m->weld);
    if (slot == NULL || m->weld == NULL) {
        free(slot);
        return lr_fail_memory(error, (n_slots + n) * 4, "the mesh's vertices");
    }
    for (uint64_t v = 0; v < n; v++) {
        if (v % POLL == 0 && lr_stopped(watch)) {
            free(slot);
            return lr_fail_stopped(error);
        }
        m->weld[v] = first_at(m->source.vertices, (uint32_t)v, slot, n_slots - 1);
        n_double += m->weld[v] != v;
    }
    free(slot);
    if (n_double == 0) {
        free(m->weld);
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

/* A triangle that uses a place twice has no edges worth linking. */
static bool collapsed(const lr_topology *m, uint64_t t)
{
    uint32_t a = lr_welded(m, t, 0), b = lr_welded(m, t, 1), c = lr_welded(m, t, 2);
    return a == b || b == c || c == a;
}

static uint32_t lower(const lr_topology *m, uint32_t half_edge)
{
    uint32_t v[2];
    ends(m, half_edge, v);
    return v[0] < v[1] ? v[0] : v[1];
}

static uint32_t higher(const lr_topology *m, uint32_t half_edge)
{
    uint32_t v[2];
    ends(m, half_edge, v);
    return v[0] < v[1] ? v[1] : v[0];
}

/* Stable counting sort of half-edges by one of their vertices. */
static bool sort_by(const lr_topology *m, uint32_t (*key)(const lr_topology *, uint32_t),
                    const uint32_t *in, uint32_t n, uint32_t *count, uint32_t *out,
                    const lr_watch *watch)
{
    memset(count, 0, m->source.n_vertices * sizeof *count);
    for (uint32_t i = 0; i < n; i++) {
        if (i % POLL == 0 && lr_stopped(watch))
            return false;
        count[key(m, in[i])]++;
    }
    uint32_t sum = 0;
    for (uint64_t v = 0; v < m->source.n_vertices; v++) {
        uint32_t here = count[v];
        count[v] = sum;
        sum += here;
    }
    for (uint32_t i = 0; i < n; i++) {
        if (i % POLL == 0 && lr_stopped(watch))
            return false;
        out[count[key(m, in[i])]++] = in[i];
    }
    return true;
}

/* The first half-edge of a run whose triangle has the same third place; the
 * half-edge itself where there is none. Only the last of a long run are looked at. */
static uint32_t first_twin(const lr_topology *m, const uint32_t *run, uint32_t n, uint32_t h)
{
    uint32_t third = lr_welded(m, h / 3, (int)((h + 2) % 3));
    for (uint32_t i = n > 64 ? n - 64 : 0; i < n; i++)
        if (lr_welded(m, run[i] / 3, (int)((run[i] + 2) % 3)) == third)
            return run[i];
    return h;
}

static bool mark_twin(lr_topology *m, uint32_t t, uint32_t first)
{
    if (m->twin == NULL) {
        m->twin = malloc(m->source.n_triangles * sizeof *m->twin);
        for (uint32_t i = 0; m->twin != NULL && i < m->source.n_triangles; i++)
            m->twin[i] = i;
    }
    if (m->twin == NULL)
        return false;
    double p[3][3], n[3];
    lr_triangle(m, t, p);
    if (m->twin[t] == t && lr_normal_of((const double(*)[3])p, n))
        m->n_degenerate++; /* those without area are counted before */
    m->twin[t] = first;
    return true;
}

/* Take the half-edges of triangles that are there twice out of a run. */
static bool drop_twins(lr_topology *m, uint32_t *run, uint32_t *n)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < *n; i++) {
        uint32_t twin = first_twin(m, run, kept, run[i]);
        if (twin == run[i])
            run[kept++] = run[i];
        else if (!mark_twin(m, run[i] / 3, twin / 3))
            return false;
    }
    *n = kept;
    return true;
}

static void link_run(lr_topology *m, const uint32_t *run, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        m->ring[run[i]] = run[(i + 1) % n];
    uint32_t a[2], b[2];
    ends(m, run[0], a);
    if (n == 1) {
        m->n_border_edges++;
        m->at_border[a[0]] = m->at_border[a[1]] = 1;
        return;
    }
    ends(m, run[1], b);
    m->n_bad_edges += n > 2 || a[0] == b[0];
}

static lr_status link_runs(lr_topology *m, uint32_t *sorted, uint32_t n, const lr_watch *watch,
                           lr_error *error)
{
    for (uint32_t first = 0, end; first < n; first = end) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        uint32_t lo = lower(m, sorted[first]), hi = higher(m, sorted[first]);
        for (end = first + 1; end < n; end++)
            if (lower(m, sorted[end]) != lo || higher(m, sorted[end]) != hi)
                break;
        uint32_t n_run = end - first;
        if (!drop_twins(m, sorted + first, &n_run))
            return lr_fail_memory(error, m->source.n_triangles * 4, "the mesh's double triangles");
        link_run(m, sorted + first, n_run);
    }
    return LR_OK;
}

static lr_status link_edges(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    uint64_t room = 3 * m->source.n_triangles;
    uint32_t *count = malloc(m->source.n_vertices * sizeof *count);
    uint32_t *a = malloc(room * sizeof *a), *b = malloc(room * sizeof *b);
    m->ring = malloc(room * sizeof *m->ring);
    m->at_border = calloc(m->source.n_vertices, 1);
    lr_status status = LR_OK;
    if (count == NULL || a == NULL || b == NULL || m->ring == NULL || m->at_border == NULL) {
        status = lr_fail_memory(error, 3 * room * 4, "the mesh's edges");
    } else {
        uint32_t n = 0;
        for (uint32_t h = 0; h < (uint32_t)room; h++) {
            m->ring[h] = h;
            if (!collapsed(m, h / 3))
                a[n++] = h;
        }
        if (sort_by(m, higher, a, n, count, b, watch) && sort_by(m, lower, b, n, count, a, watch))
            status = link_runs(m, a, n, watch, error);
        else
            status = lr_fail_stopped(error);
    }
    free(count);
    free(a);
    free(b);
    m->closed = m->n_border_edges == 0 && m->n_bad_edges == 0;
    return status;
}

/* ---- pseudonormals and orientation ------------------------------------- */

static double angle_at(const double p[3][3], int c)
{
    double u[3], v[3], n[3];
    lr_sub(p[(c + 1) % 3], p[c], u);
    lr_sub(p[(c + 2) % 3], p[c], v);
    lr_cross_product(u, v, n);
    return atan2(sqrt(lr_dot(n, n)), lr_dot(u, v));
}

/* Vertex normals, and the signed volume seen from inside the bounds. */
static lr_status add_normals(lr_topology *m, const lr_watch *watch, double *volume,
                             lr_error *error)
{
    double centre[3];
    for (int a = 0; a < 3; a++)
        centre[a] = (0.5 * m->lo[a] + 0.5 * m->hi[a]) * m->per_unit;
    *volume = 0.0;
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        double p[3][3], n[3], x[3], y[3], z[3], yz[3];
        lr_triangle(m, t, p);
        if (!lr_counts(m, t) || !lr_normal_of((const double(*)[3])p, n))
            continue;
        for (int c = 0; c < 3; c++) {
            double angle = angle_at((const double(*)[3])p, c);
            double *sum = m->vertex_normal[lr_welded(m, t, c)];
            for (int a = 0; a < 3; a++)
                sum[a] += angle * n[a];
        }
        lr_sub(p[0], centre, x);
        lr_sub(p[1], centre, y);
        lr_sub(p[2], centre, z);
        lr_cross_product(y, z, yz);
        *volume += lr_dot(x, yz);
    }
    return LR_OK;
}

lr_status lr_topology_link(const lr_mesh *mesh, double voxel_size, const lr_watch *watch,
                           lr_topology *m, lr_error *error)
{
    *m = (lr_topology){.source = *mesh, .per_unit = 1.0 / voxel_size, .side = 1.0};
    lr_status status = check_vertices(mesh, error);
    if (status == LR_OK)
        status = check_reach(m, error);
    if (status == LR_OK)
        status = find_bounds(m, watch, error);
    if (status == LR_OK)
        status = weld(m, watch, error);
    if (status == LR_OK)
        status = link_edges(m, watch, error);
    return status;
}

lr_status lr_topology_make(const lr_mesh *mesh, double voxel_size, const lr_watch *watch,
                           lr_topology *m, lr_error *error)
{
    lr_status status = lr_topology_link(mesh, voxel_size, watch, m, error);
    if (status != LR_OK)
        return status;
    m->vertex_normal = calloc(mesh->n_vertices, sizeof *m->vertex_normal);
    if (m->vertex_normal == NULL)
        return lr_fail_memory(error, mesh->n_vertices * 24, "the mesh's normals");
    double volume;
    status = add_normals(m, watch, &volume, error);
    if (status == LR_OK && m->closed && volume < 0.0)
        m->side = -1.0;
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

void lr_topology_free(lr_topology *m)
{
    free(m->weld);
    free(m->ring);
    free(m->twin);
    free(m->at_border);
    free(m->vertex_normal);
    *m = (lr_topology){0};
}
