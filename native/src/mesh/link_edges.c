/* Links the half-edges of a mesh into rings, and finds its orientation.
 *
 * The half-edges of one edge are linked into a ring. The pseudonormal of an edge is the sum of
 * its faces' unit normals, that of a vertex weights them by the angle; for a closed mesh the sign
 * of (p - c).n at the closest point c tells inside from outside, wherever c lies. They are summed
 * around the rings on demand, since few samples need them.
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
#include "mesh/link_edges.h"

#include "base/pages.h"
#include "mesh/half_edges.h"

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

/* Remove the half-edges of duplicate triangles from a run. */
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

/* Subtract from the volume what the triangles that do not count have added. */
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
