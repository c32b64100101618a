/* Half-edges, sorted by their edges.
 *
 * Each is listed at the lower of its vertices and sorted there by the other one, so that those
 * of one edge are neighbours. A large mesh is sorted in pieces, some vertices at a time, so
 * that no list of all half-edges is needed; each piece reads all triangles once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/half_edges.h"

#include "base/pages.h"

enum {
    POLL = 1 << 16,      /* iterations between checks of the stop word: some ms */
    FEW = 8,             /* half-edges that are sorted by counting which are less */
    SMALL = 32,          /* half-edges that insertion sorts */
    PIECES = 4,          /* of a large mesh, or some more */
    LEAST_ROOM = 1 << 21 /* half-edges of a piece, at least */
};

/* ---- pieces ------------------------------------------------------------ */

typedef struct corners {
    uint32_t v[4]; /* welded; the first one again */
    bool skipped;
} corners;

LR_INLINE corners corners_of(const lr_half_edges *h, uint32_t t)
{
    corners c;
    for (int k = 0; k < 3; k++)
        c.v[k] = lr_welded(h->mesh, t, k);
    c.v[3] = c.v[0];
    c.skipped = !h->all && (c.v[0] == c.v[1] || c.v[1] == c.v[2] || c.v[2] == c.v[0]);
    return c;
}

/* Count those of each vertex v in start[v + 2]. */
static bool count(lr_half_edges *h, const lr_watch *watch)
{
    const uint32_t n = (uint32_t)h->mesh->source.n_triangles;
    for (uint32_t t = 0; t < n; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return false;
        const corners c = corners_of(h, t);
        for (int e = 0; e < 3; e++) {
            const uint32_t from = c.v[e], to = c.v[e + 1];
            h->start[(from < to ? from : to) + 2] += !c.skipped && from != to;
        }
    }
    return true;
}

/* Put those of the vertices first..end - 1, each vertex' in their own order. */
static bool put(lr_half_edges *h, const lr_watch *watch)
{
    const uint32_t n = (uint32_t)h->mesh->source.n_triangles, n_here = h->end - h->first;
    for (uint32_t t = 0; t < n; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return false;
        const uint32_t a = lr_welded(h->mesh, t, 0), b = lr_welded(h->mesh, t, 1),
                       d = lr_welded(h->mesh, t, 2);
        if ((a >= h->end && b >= h->end && d >= h->end) ||
            (a < h->first && b < h->first && d < h->first))
            continue; /* most triangles, of most pieces */
        const corners c = corners_of(h, t);
        if (c.skipped)
            continue;
        for (uint32_t e = 0; e < 3; e++) {
            const bool up = c.v[e] < c.v[e + 1];
            const uint32_t lower = up ? c.v[e] : c.v[e + 1], higher = up ? c.v[e + 1] : c.v[e];
            if (lower - h->first < n_here && lower != higher)
                h->key[h->start[lower + 1]++ - h->before] =
                    (uint64_t)higher << LR_HIGHER_BITS | (uint64_t)(3 * t + e) << 1 | (uint64_t)up;
        }
    }
    return true;
}

/* As many vertices as there is room for; at least one. */
static lr_status next_piece(lr_half_edges *h, const lr_watch *watch, lr_error *error)
{
    const uint32_t n_vertices = (uint32_t)h->mesh->source.n_vertices;
    h->first = h->end;
    h->before = h->start[h->first + 1];
    do
        h->end++;
    while (h->end < n_vertices && h->start[h->end + 2] - h->before <= h->room);
    const uint64_t needed = h->start[h->end + 1] - h->before;
    if (needed > h->room || h->key == NULL) {
        h->room = needed > h->room ? needed : h->room;
        lr_pages_free(h->key);
        h->key = lr_pages_new(h->room, sizeof *h->key);
    }
    if (h->key == NULL)
        return lr_fail_memory(error, h->room * sizeof *h->key, "the mesh's edges");
    h->vertex = h->first;
    h->at = h->before;
    return put(h, watch) ? LR_OK : lr_fail_stopped(error);
}

static uint64_t room_of(uint64_t n_triangles)
{
    const uint64_t n = 3 * n_triangles, most = n / PIECES > LEAST_ROOM ? n / PIECES : LEAST_ROOM;
    return most < n ? most : n;
}

/* ---- sorting ----------------------------------------------------------- */

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

/* ---- all --------------------------------------------------------------- */

lr_status lr_half_edges_begin(const lr_topology *mesh, bool all, const lr_watch *watch,
                              lr_half_edges *h, lr_error *error)
{
    const uint64_t n = mesh->source.n_vertices;
    *h = (lr_half_edges){.mesh = mesh, .all = all, .room = room_of(mesh->source.n_triangles)};
    h->start = lr_pages_new(n + 2, sizeof *h->start);
    if (h->start == NULL)
        return lr_fail_memory(error, (n + 2) * sizeof *h->start, "the mesh's edges");
    if (!count(h, watch))
        return lr_fail_stopped(error);
    for (uint64_t v = 0; v < n; v++)
        h->start[v + 2] += h->start[v + 1];
    return LR_OK;
}

lr_status lr_half_edges_next(lr_half_edges *h, const lr_watch *watch, uint64_t **key, uint32_t *n,
                             lr_error *error)
{
    *n = 0;
    while (*n == 0) {
        if (h->vertex == h->end) {
            if (h->end == h->mesh->source.n_vertices)
                return LR_OK;
            const lr_status status = next_piece(h, watch, error);
            if (status != LR_OK)
                return status;
        }
        if (h->vertex % 1024 == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        *key = h->key + (h->at - h->before);
        *n = h->start[h->vertex + 1] - h->at; /* where putting has moved it: to the end */
        h->at = h->start[++h->vertex];
    }
    return sort(*key, *n, watch) ? LR_OK : lr_fail_stopped(error);
}

void lr_half_edges_free(lr_half_edges *h)
{
    lr_pages_free(h->start);
    lr_pages_free(h->key);
    *h = (lr_half_edges){0};
}

uint64_t lr_half_edges_nbytes(uint64_t n_vertices, uint64_t n_triangles)
{
    uint64_t n_slots = 16;
    while (n_slots < 2 * n_vertices)
        n_slots *= 2;
    const uint64_t pieces = n_vertices * sizeof(uint32_t) + room_of(n_triangles) * sizeof(uint64_t);
    const uint64_t slots = n_slots * sizeof(uint32_t);
    return n_vertices * sizeof(uint32_t) + (pieces > slots ? pieces : slots);
}
