/* Islands of a mesh, and the layers that keep them apart.
 *
 * One field cannot represent two surfaces that cross or lie closer than its band: the
 * eyeballs of a head, a leaf through a twig. Islands that may do so get separate layers, and
 * so volumes; a ray takes the nearer hit. Two triangles belong to one island if they alone
 * share an edge and agree in winding (union-find), so islands also end at junctions and
 * where the winding flips. Layers are assigned greedily, the largest island first: the first
 * layer of its kind in which no box is too near.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/pages.h"
#include "base/union_find.h"
#include "mesh/link_edges.h"

enum {
    MOST_LAYERS = 16, /* of each kind */
    POLL = 1 << 14
};

/* Pairs of boxes that are compared at most (a second or so); what is left then
 * goes into the last layer of its kind. */
#define MOST_PAIRS 100000000u

typedef enum kind { OPEN, OUTWARD, INWARD, KINDS } kind;

typedef struct island {
    double lo[3], hi[3];
    double volume; /* times 6, signed */
    bool has_area; /* else it lies in any layer */
    kind kind;
    int32_t layer; /* -1: none yet */
    int32_t next;  /* in its layer; -1: last */
} island;

typedef struct layers {
    int32_t first[KINDS][MOST_LAYERS]; /* island; islands are linked */
    int32_t n[KINDS];
    uint64_t n_pairs;
    double margin;
} layers;

static void join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = lr_root_of(parent, sizeof *parent, a);
    b = lr_root_of(parent, sizeof *parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

/* island_of[triangle], numbered by first triangle; false where stopped. parent and
 * number have room for all triangles. */
static bool find_islands(const lr_topology *m, uint32_t *parent, int32_t *number,
                         int32_t *island_of, int32_t *n, const lr_watch *watch)
{
    uint32_t n_triangles = (uint32_t)m->source.n_triangles;
    for (uint32_t t = 0; t < n_triangles; t++) {
        parent[t] = t;
        number[t] = -1;
    }
    for (uint32_t h = 0; h < 3 * n_triangles; h++) {
        if (h % POLL == 0 && lr_stopped(watch))
            return false;
        if (lr_edge_closed(m, h))
            join(parent, h / 3, m->ring[h] / 3);
    }
    for (uint32_t t = 0; m->twin != NULL && t < n_triangles; t++)
        join(parent, t, m->twin[t]);
    *n = 0;
    for (uint32_t t = 0; t < n_triangles; t++) {
        uint32_t root = lr_root_of(parent, sizeof *parent, t);
        if (number[root] < 0)
            number[root] = (*n)++;
        island_of[t] = number[root];
    }
    return true;
}

static bool is_closed_at(const lr_topology *m, uint64_t t)
{
    uint32_t a = lr_welded(m, t, 0), b = lr_welded(m, t, 1), c = lr_welded(m, t, 2);
    if (a == b || b == c || c == a || !lr_counts(m, t))
        return true; /* it has no edges */
    for (uint32_t e = 0; e < 3; e++)
        if (!lr_edge_closed(m, (uint32_t)(3 * t) + e))
            return false;
    return true;
}

static void measure(const lr_topology *m, const int32_t *island_of, island *islands, int32_t n)
{
    double centre[3]; /* the origin of volumes, to limit cancellation */
    for (int a = 0; a < 3; a++)
        centre[a] = (0.5 * m->lo[a] + 0.5 * m->hi[a]) * m->per_unit;
    for (int32_t i = 0; i < n; i++) {
        islands[i] = (island){.kind = OUTWARD, .layer = -1, .next = -1};
        for (int a = 0; a < 3; a++) {
            islands[i].lo[a] = INFINITY;
            islands[i].hi[a] = -INFINITY;
        }
    }
    for (uint64_t t = 0; t < m->source.n_triangles; t++) {
        island *here = &islands[island_of[t]];
        double p[3][3], yz[3], n_of[3];
        lr_triangle(m, t, p);
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++) {
                p[c][a] -= centre[a];
                here->lo[a] = p[c][a] < here->lo[a] ? p[c][a] : here->lo[a];
                here->hi[a] = p[c][a] > here->hi[a] ? p[c][a] : here->hi[a];
            }
        if (!is_closed_at(m, t))
            here->kind = OPEN;
        if (!lr_counts(m, t))
            continue;
        lr_cross_product(p[1], p[2], yz);
        here->volume += lr_dot(p[0], yz);
        here->has_area = here->has_area || lr_normal_of((const double (*)[3])p, n_of);
    }
    for (int32_t i = 0; i < n; i++)
        if (islands[i].kind != OPEN && islands[i].volume < 0.0)
            islands[i].kind = INWARD;
}

static bool apart(const island *a, const island *b, double margin)
{
    for (int axis = 0; axis < 3; axis++)
        if (a->lo[axis] > b->hi[axis] + margin || b->lo[axis] > a->hi[axis] + margin)
            return true;
    return false;
}

static bool around(const island *outer, const island *inner)
{
    for (int axis = 0; axis < 3; axis++)
        if (inner->lo[axis] < outer->lo[axis] || inner->hi[axis] > outer->hi[axis])
            return false;
    return true;
}

/* The layer of an outward island whose box is around the inward one; -1: none. */
static int32_t layer_around(layers *l, const island *islands, const island *inner)
{
    for (int32_t k = 0; k < l->n[OUTWARD]; k++)
        for (int32_t i = l->first[OUTWARD][k]; i >= 0 && l->n_pairs < MOST_PAIRS;
             i = islands[i].next) {
            l->n_pairs++;
            if (islands[i].kind == OUTWARD && around(&islands[i], inner))
                return k;
        }
    return -1;
}

static bool fits(layers *l, const island *islands, kind of, int32_t k, const island *candidate)
{
    for (int32_t i = l->first[of][k]; i >= 0; i = islands[i].next) {
        if (++l->n_pairs > MOST_PAIRS)
            return false;
        if (!apart(&islands[i], candidate, l->margin))
            return false;
    }
    return true;
}

static void place(layers *l, island *islands, int32_t which)
{
    island *candidate = &islands[which];
    kind of = candidate->kind;
    int32_t k = -1;
    if (of == INWARD)
        k = layer_around(l, islands, candidate);
    if (k >= 0) {
        of = OUTWARD;
    } else {
        for (k = 0; k < l->n[of] && !fits(l, islands, of, k, candidate); k++) {
        }
        if (k == MOST_LAYERS)
            k--;
        if (k == l->n[of])
            l->first[of][l->n[of]++] = -1;
    }
    candidate->layer = k + MOST_LAYERS * (int32_t)of;
    candidate->next = l->first[of][k];
    l->first[of][k] = which;
}

typedef struct rank {
    double size;
    int32_t island;
} rank;

static int by_size(const void *a, const void *b)
{
    const rank *x = a, *y = b;
    if (x->size != y->size)
        return x->size > y->size ? -1 : 1;
    return x->island < y->island ? -1 : 1;
}

static bool place_all(layers *l, island *islands, rank *order, int32_t n, const lr_watch *watch)
{
    for (int32_t i = 0; i < n; i++) {
        double d[3];
        lr_sub(islands[i].hi, islands[i].lo, d);
        order[i] = (rank){lr_dot(d, d), i};
    }
    qsort(order, (size_t)n, sizeof *order, by_size);
    for (int32_t i = 0; i < n; i++) {
        if (lr_stopped(watch))
            return false;
        if (islands[order[i].island].has_area)
            place(l, islands, order[i].island);
    }
    return true;
}

/* Layers of all kinds in one row, without gaps. */
static int32_t number_layers(const layers *l, const island *islands, uint64_t n_triangles,
                             int32_t *layer)
{
    int32_t before[KINDS], n = 0;
    for (int k = 0; k < KINDS; k++) {
        before[k] = n;
        n += l->n[k];
    }
    for (uint64_t t = 0; t < n_triangles; t++) {
        int32_t of = islands[layer[t]].layer;
        layer[t] = of < 0 ? 0 : before[of / MOST_LAYERS] + of % MOST_LAYERS;
    }
    return n;
}

static lr_status split(const lr_topology *m, double margin, const lr_watch *watch, int32_t *layer,
                       int32_t *n_layers, lr_error *error)
{
    size_t n_triangles = m->source.n_triangles;
    uint32_t *parent = lr_pages_new(n_triangles, sizeof *parent);
    int32_t *number = lr_pages_new(n_triangles, sizeof *number);
    island *islands = NULL;
    rank *order = NULL;
    lr_status status = LR_OK;
    int32_t n = 0;
    if (parent == NULL || number == NULL)
        status = lr_fail_memory(error, n_triangles * 8, "the mesh's islands");
    else if (!find_islands(m, parent, number, layer, &n, watch))
        status = lr_fail_stopped(error);
    lr_pages_free(parent);
    lr_pages_free(number);
    if (status != LR_OK)
        return status;
    islands = malloc((size_t)n * sizeof *islands);
    order = malloc((size_t)n * sizeof *order);
    layers l = {.margin = margin * m->per_unit};
    if (islands == NULL || order == NULL) {
        status = lr_fail_memory(error, (uint64_t)n * sizeof *islands, "the mesh's islands");
    } else {
        measure(m, layer, islands, n);
        if (place_all(&l, islands, order, n, watch))
            *n_layers = number_layers(&l, islands, m->source.n_triangles, layer);
        else
            status = lr_fail_stopped(error);
    }
    free(islands);
    free(order);
    return status;
}

/* The coordinates' unit here is a millionth of the farthest vertex. */
static double unit_of(const lr_mesh *mesh)
{
    double farthest = 0.0;
    for (uint64_t i = 0; mesh->vertices != NULL && i < 3 * mesh->n_vertices; i++)
        farthest = fabs(mesh->vertices[i]) > farthest ? fabs(mesh->vertices[i]) : farthest;
    return farthest > 1e-100 && farthest < 1e100 ? 1e-6 * farthest : 1.0;
}

lr_status lr_mesh_layers(const lr_mesh *mesh, double margin, const lr_watch *watch, int32_t *layer,
                         int32_t *n_layers, lr_error *error)
{
    if (!(margin >= 0.0))
        return lr_fail(error, LR_E_ARGUMENT, "margin must be 0 or more; it is %g", margin);
    lr_topology topology;
    lr_status status = lr_topology_begin(mesh, unit_of(mesh), watch, &topology, error);
    if (status == LR_OK)
        status = lr_topology_link(&topology, watch, error);
    if (status == LR_OK)
        status = split(&topology, margin, watch, layer, n_layers, error);
    lr_topology_free(&topology);
    return status;
}
