/* A triangle mesh prepared for signed distances: welded vertices, linked edges, and whether
 * it bounds a solid.
 *
 * Coordinates are *storage* coordinates of the volume to come (see
 * grid/brick_grid.h), so the unit is the voxel edge; they are computed from the
 * caller's vertices on demand, not stored. Half-edge 3 t + e runs from corner e
 * of triangle t to the next.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_TOPOLOGY_H
#define LR_MESH_TOPOLOGY_H

#include "base/base.h"
#include "base/error.h"

typedef struct lr_topology {
    lr_mesh source;      /* the caller's arrays */
    double per_unit;     /* voxels per unit of object space */
    double origin[3];    /* storage coordinate 0, in voxels from the object's origin */
    double lo[3], hi[3]; /* bounds of the triangles with area, object space */
    uint32_t *weld;      /* [n_vertices]: the first vertex at the same place; NULL: itself */
    uint32_t *ring;      /* [3 n_triangles]: the next half-edge on the same edge, in a circle */
    uint32_t *twin;      /* [n_triangles]: the first triangle with the same corners, which alone
                            counts; NULL: all differ */
    uint64_t n_flat;     /* triangles without area */
    uint64_t n_border_edges, n_bad_edges;
    uint64_t n_degenerate;    /* triangles without area, or that do not count */
    uint64_t n_flipped_edges; /* those of the bad ones with two triangles */
    double volume;            /* signed, times 6, of all triangles */
    double side;              /* -1 where the mesh is wound inside out, else 1 */
    bool closed;              /* every edge has two triangles of one winding */
} lr_topology;

/* Refuse arrays that are no mesh. farthest: largest coordinate of all vertices, used or not. */
lr_status lr_mesh_check(const lr_mesh *mesh, const lr_watch *watch, double *farthest,
                        lr_error *error);
/* Make vertices at the same place one: fill topology->weld. Part of lr_topology_link. */
lr_status lr_topology_weld(lr_topology *topology, const lr_watch *watch, lr_error *error);

/* Check the mesh, find its bounds and volume. origin is left 0: coordinates are voxels
 * from the object's origin until the caller sets it. What was built is freed by
 * lr_topology_free, after an error too. */
lr_status lr_topology_begin(const lr_mesh *mesh, double voxel_size, const lr_watch *watch,
                            lr_topology *topology, lr_error *error);
/* Free what linking (link_edges.h) made, once signs and edges are not needed any more. */
void lr_topology_unlink(lr_topology *topology);
void lr_topology_free(lr_topology *topology);

LR_INLINE void lr_vertex(const lr_topology *m, int64_t v, double p[3])
{
    const double *x = m->source.vertices + 3 * v;
    for (int a = 0; a < 3; a++)
        p[a] = x[a] * m->per_unit - m->origin[a];
}

LR_INLINE void lr_triangle(const lr_topology *m, uint64_t t, double p[3][3])
{
    const int32_t *corner = m->source.triangles + 3 * t;
    for (int c = 0; c < 3; c++)
        lr_vertex(m, corner[c], p[c]);
}

LR_INLINE uint32_t lr_welded(const lr_topology *m, uint64_t t, int corner)
{
    uint32_t v = (uint32_t)m->source.triangles[3 * t + (uint64_t)corner];
    return m->weld != NULL ? m->weld[v] : v;
}

LR_INLINE bool lr_counts(const lr_topology *m, uint64_t t)
{
    return m->twin == NULL || m->twin[t] == t;
}

/* A triangle whose height is below this fraction of its longest side has no area:
 * its cross product is then rounding (2^-51 of the sides' product) to within one
 * part in 10^6, and at 4096 voxels it is thinner than 10^-5 voxel. */
#define LR_FLAT 1e-9

/* Cross product of two sides by the winding; false where there is no area. */
LR_INLINE bool lr_cross_of(const double p[3][3], double n[3])
{
    double u[3], v[3], w[3];
    lr_sub(p[1], p[0], u);
    lr_sub(p[2], p[0], v);
    lr_sub(p[2], p[1], w);
    lr_cross_product(u, v, n);
    double uu = lr_dot(u, u), vv = lr_dot(v, v), ww = lr_dot(w, w);
    double longest = uu > vv ? uu : vv;
    longest = longest > ww ? longest : ww;
    return lr_dot(n, n) > LR_FLAT * longest * (LR_FLAT * longest); /* false for 0 > 0 */
}

/* Unit normal by the winding; false, and zero, where there is no area. */
LR_INLINE bool lr_normal_of(const double p[3][3], double n[3])
{
    bool has_area = lr_cross_of(p, n);
    double scale = has_area ? 1.0 / sqrt(lr_dot(n, n)) : 0.0;
    for (int a = 0; a < 3; a++)
        n[a] *= scale;
    return has_area;
}

#endif
