/* Creases and borders of a mesh, from its half-edges alone.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/half_edges.h"

/* Cross product of two sides, of coordinates that are divided by unit, in f32. */
static void cross_of(const lr_mesh *mesh, uint32_t half_edge, float unit, float n[3])
{
    const int32_t *corner = mesh->triangles + half_edge / 3 * (size_t)3;
    float p[3][3], u[3], v[3];
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            p[c][a] = (float)mesh->vertices[3 * (size_t)corner[c] + (size_t)a] / unit;
    for (int a = 0; a < 3; a++) {
        u[a] = p[1][a] - p[0][a];
        v[a] = p[2][a] - p[0][a];
    }
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        n[a] = u[b] * v[c] - u[c] * v[b];
    }
}

static bool turns(const lr_mesh *mesh, uint32_t first, uint32_t second, float unit, double cosine)
{
    float a[3], b[3];
    cross_of(mesh, first, unit, a);
    cross_of(mesh, second, unit, b);
    double product = 0.0, aa = 0.0, bb = 0.0;
    for (int i = 0; i < 3; i++) {
        product += (double)a[i] * (double)b[i];
        aa += (double)a[i] * (double)a[i];
        bb += (double)b[i] * (double)b[i];
    }
    return product < cosine * sqrt(aa) * sqrt(bb);
}

static lr_status find(const lr_topology *m, double unit, double cosine, uint32_t (*pair)[2],
                      uint64_t room, const lr_watch *watch, uint64_t *n_pairs, uint64_t *n_border,
                      lr_error *error)
{
    lr_half_edges edges;
    uint64_t *key;
    uint32_t n;
    *n_pairs = *n_border = 0;
    lr_status status = lr_half_edges_begin(m, true, watch, &edges, error);
    while (status == LR_OK &&
           (status = lr_half_edges_next(&edges, watch, &key, &n, error)) == LR_OK && n > 0)
        for (uint32_t first = 0, end; first < n; first = end) {
            end = lr_edge_end(key, n, first);
            *n_border += end == first + 1;
            const uint32_t a = lr_half_edge_of(key[first]);
            const uint32_t b = lr_half_edge_of(key[end > first + 1 ? first + 1 : first]);
            if (a == b || !turns(&m->source, a, b, (float)unit, cosine))
                continue;
            if (*n_pairs < room) {
                pair[*n_pairs][0] = a;
                pair[*n_pairs][1] = b;
            }
            ++*n_pairs;
        }
    lr_half_edges_free(&edges);
    return status;
}

lr_status lr_mesh_edges(const lr_mesh *mesh, int32_t weld, double unit, double cosine,
                        uint32_t *pairs, uint64_t room, const lr_watch *watch, uint64_t *n_pairs,
                        uint64_t *n_border, lr_error *error)
{
    if (!(unit > 0.0 && isfinite(unit)))
        return lr_fail(error, LR_E_ARGUMENT, "unit must be positive and finite; it is %g", unit);
    double farthest = 0.0;
    lr_topology m = {.source = *mesh, .per_unit = 1.0, .side = 1.0};
    lr_status status = lr_mesh_check(mesh, watch, &farthest, error);
    if (status == LR_OK && weld)
        status = lr_topology_weld(&m, watch, error);
    if (status == LR_OK)
        status = find(&m, unit, cosine, (uint32_t (*)[2])(void *)pairs, room, watch, n_pairs,
                      n_border, error);
    lr_topology_free(&m);
    return status;
}
