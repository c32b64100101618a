/* The half-edges of a mesh, edge by edge.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_HALF_EDGES_H
#define LR_MESH_HALF_EDGES_H

#include "mesh/topology.h"

/* Half-edges by the lower of their (welded) vertices, those of the vertices first..end - 1 at a
 * time: key[start[v + 1] - before..] are those of v, each as higher vertex (31 bits), half-edge
 * (32 bits), and whether it runs upwards (1 bit). */
typedef struct lr_half_edges {
    const lr_topology *mesh;
    bool all;        /* also those of triangles that use a place twice */
    uint32_t *start; /* [n_vertices + 2] */
    uint64_t *key;   /* [room] */
    uint64_t room;
    uint32_t first, end; /* vertices */
    uint32_t before;     /* half-edges of the vertices before */
    uint32_t vertex, at; /* the next to be given, and where its half-edges start */
} lr_half_edges;

#define LR_HIGHER_BITS 33

LR_INLINE uint32_t lr_half_edge_of(uint64_t key)
{
    return (uint32_t)(key >> 1);
}

/* Where, of a vertex' sorted half-edges, those of the edge end that starts at first. */
LR_INLINE uint32_t lr_edge_end(const uint64_t *key, uint32_t n, uint32_t first)
{
    uint32_t end = first + 1;
    while (end < n && key[end] >> LR_HIGHER_BITS == key[first] >> LR_HIGHER_BITS)
        end++;
    return end;
}

/* all: also half-edges of triangles that use a place twice, but for those that have no length.
 * The mesh is checked, and welded if it is to be. What was built is freed by
 * lr_half_edges_free, after an error too. */
lr_status lr_half_edges_begin(const lr_topology *mesh, bool all, const lr_watch *watch,
                              lr_half_edges *edges, lr_error *error);
/* The sorted half-edges key[n] of the next vertex that is the lower one of some; those of one
 * edge are neighbours, in ascending order. They may be overwritten. n is 0 at the end. */
lr_status lr_half_edges_next(lr_half_edges *edges, const lr_watch *watch, uint64_t **key,
                             uint32_t *n, lr_error *error);
void lr_half_edges_free(lr_half_edges *edges);

/* Bytes that the above allocates at most, the weld included. */
uint64_t lr_half_edges_nbytes(uint64_t n_vertices, uint64_t n_triangles);

#endif
