/* Mesh set-up: check, weld, edges, pseudonormals, orientation.
 *
 * Vertices at exactly equal positions are one vertex. Half-edges are dealt out to
 * the lower of their vertices and sorted there by the other one, so that those
 * of one edge lie side by side and are linked into a ring. The pseudonormal of
 * an edge is the sum of its faces' unit normals, that of a vertex weights them
 * by the angle; for a closed mesh the sign of (p - c).n at the closest point c
 * tells inside from outside, wherever c lies. They are summed where they are asked
 * for, around the rings, since few samples ask.
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
#include "voxel/mesh.h"

enum {
    POLL = 1 << 16, /* loop turns between looks at the stop word: some ms */
    AHEAD = 16,     /* vertices whose slots are fetched together; divides POLL */
    FEW = 8,        /* half-edges that are sorted by counting which are less */
    SMALL = 32      /* half-edges that insertion sorts */
};

/* Beyond this distance from the object's origin, in voxels, f64 coordinates
 * are coarser than 1e-5 voxel. */
#define FARTHEST 0x1p36

/* farthest: largest coordinate of all vertices, used or not. */
static lr_status check_vertices(const lr_mesh *mesh, const lr_watch *watch, double *farthest,
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
    for (uint64_t v = 0; v < n; v += AHEAD) {
        if (v % POLL == 0 && lr_stopped(watch)) {
            free(slot);
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
/* Half-edges by their lower vertex: key[start[v]..start[v + 1]] are those of v, each as
 * higher vertex (31 bits), half-edge (32 bits), and whether it runs upwards (1 bit). */
typedef struct buckets {
    uint32_t *start; /* [n_vertices + 1] */
    uint64_t *key;   /* [3 n_triangles] */
} buckets;

#define HIGHER_BITS 33
LR_INLINE uint32_t half_edge_of(uint64_t key)
{
    return (uint32_t)(key >> 1);
}

/* Call for all half-edges: count them, each a ring of its own, then put them. */
static bool deal(lr_topology *m, bool put, buckets *b, const lr_watch *watch)
{
    uint32_t n = (uint32_t)m->source.n_triangles;
    for (uint32_t t = 0; t < n; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return false;
        uint32_t v[4];
        for (int c = 0; c < 3; c++)
            v[c] = lr_welded(m, t, c);
        v[3] = v[0];
        const bool collapsed = v[0] == v[1] || v[1] == v[2] || v[2] == v[0];
        for (uint32_t e = 0, h = 3 * t; e < 3; e++, h++) {
            const bool up = v[e] < v[e + 1];
            const uint32_t lower = up ? v[e] : v[e + 1], higher = up ? v[e + 1] : v[e];
            if (!put)
                m->ring[h] = h;
            if (!put && !collapsed)
                b->start[lower + 1]++;
            if (put && !collapsed)
                b->key[b->start[lower]++] =
                    (uint64_t)higher << HIGHER_BITS | (uint64_t)h << 1 | (uint64_t)up;
        }
    }
    return true;
}

/* Fill the buckets, each in the order of the half-edges. */
static bool fill(lr_topology *m, buckets *b, const lr_watch *watch)
{
    uint64_t n = m->source.n_vertices;
    if (!deal(m, false, b, watch))
        return false;
    for (uint64_t v = 0; v < n; v++)
        b->start[v + 1] += b->start[v];
    if (!deal(m, true, b, watch))
        return false;
    memmove(b->start + 1, b->start, n * sizeof *b->start); /* putting has moved them on */
    b->start[0] = 0;
    return true;
}

static void sift(uint64_t *key, uint32_t root, uint32_t n)
{
    uint64_t moved = key[root];
    for (uint32_t child; (child = 2 * root + 1) < n; root = child) {
        child += child + 1 < n && key[child + 1] > key[child];
        if (key[child] <= moved)
            break;
        key[root] = key[child];
    }
    key[root] = moved;
}

/* A vertex has some six half-edges: without branches. */
static void sort_few(uint64_t *key, uint32_t n)
{
    uint64_t in[FEW], rank[FEW] = {0};
    for (uint32_t i = 0; i < FEW; i++)
        in[i] = i < n ? key[i] : UINT64_MAX;
    for (int i = 0; i < FEW; i++)
        for (int j = 0; j < FEW; j++)
            rank[j] += in[i] < in[j];
    for (uint32_t i = 0; i < n; i++)
        key[rank[i]] = in[i];
}

/* Ascending, in place; counting, insertion or, for the rare vertex with a large fan, heap sort. */
static bool sort(uint64_t *key, uint32_t n, const lr_watch *watch)
{
    if (n <= FEW) {
        sort_few(key, n);
        return true;
    }
    for (uint32_t i = 1; n <= SMALL && i < n; i++) {
        uint64_t moved = key[i];
        uint32_t to = i;
        for (; to > 0 && key[to - 1] > moved; to--)
            key[to] = key[to - 1];
        key[to] = moved;
    }
    for (uint32_t i = n > SMALL ? n / 2 : 0; i-- > 0;) {
        if (i % POLL == 0 && lr_stopped(watch))
            return false;
        sift(key, i, n);
    }
    for (uint32_t last = n > SMALL ? n - 1 : 0; last > 0; last--) {
        if (last % POLL == 0 && lr_stopped(watch))
            return false;
        uint64_t top = key[0];
        key[0] = key[last];
        key[last] = top;
        sift(key, 0, last);
    }
    return true;
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
        if (third_place(m, half_edge_of(run[i])) == third)
            return half_edge_of(run[i]);
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
        uint32_t h = half_edge_of(run[i]), twin = first_twin(m, run, kept, h);
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
        m->ring[half_edge_of(run[i])] = half_edge_of(run[i + 1 < n ? i + 1 : 0]);
    const bool flipped = n == 2 && ((run[0] ^ run[1]) & 1) == 0;
    m->n_border_edges += n == 1;
    m->n_bad_edges += n > 2 || flipped;
    m->n_flipped_edges += flipped;
}

static lr_status link_bucket(lr_topology *m, uint64_t *key, uint32_t n, const lr_watch *watch,
                             lr_error *error)
{
    if (!sort(key, n, watch))
        return lr_fail_stopped(error);
    for (uint32_t first = 0, end; first < n; first = end) {
        for (end = first + 1; end < n && key[end] >> HIGHER_BITS == key[first] >> HIGHER_BITS;
             end++) {
        }
        uint32_t n_run = end - first;
        if (n_run > 1 && !drop_twins(m, key + first, &n_run))
            return lr_fail_memory(error, m->source.n_triangles * 4, "the mesh's double triangles");
        link_run(m, key + first, n_run);
    }
    return LR_OK;
}

static lr_status link_buckets(lr_topology *m, buckets *b, const lr_watch *watch, lr_error *error)
{
    if (!fill(m, b, watch))
        return lr_fail_stopped(error);
    lr_status status = LR_OK;
    for (uint64_t v = 0; v < m->source.n_vertices && status == LR_OK; v++) {
        if (v % 1024 == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        status = link_bucket(m, b->key + b->start[v], b->start[v + 1] - b->start[v], watch, error);
    }
    return status;
}

static lr_status link_edges(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    uint64_t room = 3 * m->source.n_triangles;
    buckets b = {.start = calloc(m->source.n_vertices + 2, sizeof *b.start),
                 .key = malloc(room * sizeof *b.key)};
    m->ring = malloc(room * sizeof *m->ring);
    lr_status status = LR_OK;
    if (b.start == NULL || b.key == NULL || m->ring == NULL) {
        status = lr_fail_memory(error, room * 12, "the mesh's edges");
    } else {
        status = link_buckets(m, &b, watch, error);
    }
    free(b.start);
    free(b.key);
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
    lr_status status = check_vertices(mesh, watch, &farthest, error);
    if (status == LR_OK && !(farthest * m->per_unit <= FARTHEST))
        status = check_reach(m, error);
    if (status == LR_OK)
        status = measure(m, watch, error);
    return status;
}

lr_status lr_topology_link(lr_topology *m, const lr_watch *watch, lr_error *error)
{
    lr_status status = weld(m, watch, error);
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

void lr_topology_free(lr_topology *m)
{
    free(m->weld);
    free(m->ring);
    free(m->twin);
    *m = (lr_topology){0};
}
