/* Rays and the triangles of a volume whose surface cells all keep theirs, without a walk through
 * cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRIANGLE_TREE_H
#define LR_TRACE_TRIANGLE_TREE_H

#include "trace/bvh.h"
#include "trace/triangle_cell.h"

enum { LR_TREE_LANES = 8 };

/* Up to eight triangles side by side, in storage space. */
typedef struct lr_triangle_block {
    _Alignas(64) double corner[3][3][LR_TREE_LANES]; /* by corner, then by axis */
    uint32_t triangle[LR_TREE_LANES];                /* LR_NO_TRIANGLE: none */
} lr_triangle_block;

/* Boxes of up to eight children; those of none are empty. */
typedef struct lr_tree_node {
    _Alignas(64) float bound[2][3][LR_TREE_LANES]; /* lower and upper, by axis */
    uint32_t child[LR_TREE_LANES];                 /* a node, or a block | LR_LEAF */
} lr_tree_node;

typedef struct lr_triangle_tree {
    lr_tree_node *nodes;
    lr_triangle_block *blocks;
    uint32_t n_nodes, n_blocks;
    uint32_t root; /* as a child */
    int32_t simd;  /* lr_simd */
} lr_triangle_tree;

/* Can a tree stand for the volume? */
bool lr_has_only_triangles(const lr_volume *volume);

/* *tree is to be given to lr_triangle_tree_free, *nbytes what it takes. */
lr_status lr_triangle_tree_build(const lr_volume *volume, lr_triangle_tree **tree, uint64_t *nbytes,
                                 lr_error *error);
void lr_triangle_tree_free(lr_triangle_tree *tree); /* NULL is fine */

/* What a ray has met; each instruction set gives the same bits. */
typedef struct lr_tree_ray {
    const lr_ray *r;
    const lr_volume *v;
    double t_min;
    int32_t side;               /* see lr_leaving */
    double off;                 /* of the start, from triangles that it lies on */
    bool any;                   /* whatever it meets will do */
    double t;                   /* of the nearest hit, at most; INFINITY: none yet */
    uint32_t triangle;          /* that is hit; LR_NO_TRIANGLE: none */
    uint32_t n_nodes, n_blocks; /* that were looked at */
} lr_tree_ray;

typedef struct lr_tree_ops {
    void (*meet)(const lr_triangle_tree *tree, lr_tree_ray *ray); /* the nearest triangle */
} lr_tree_ops;

/* By the instructions of an lr_simd that the processor has. */
extern const lr_tree_ops lr_tree_portable, lr_tree_avx2, lr_tree_avx512;

/* What a ray in the tree does with a triangle of a block whose line it meets at t: false where that
 * lies behind it, or is what it leaves. */
bool lr_tree_accepts(const lr_tree_ray *ray, const lr_triangle_block *block, int lane, double t,
                     bool inward);

/* As lr_trace in LR_MODE_SURFACE, by a tree of triangles where the structure has one; steps are not
 * counted. any: whatever a ray meets will do, and only t counts. */
lr_status lr_trace_scene(const lr_structure *structure, const lr_rays *rays, uint64_t n,
                         const lr_trace_options *options, bool any, const lr_hits *hits,
                         lr_counters *counters, const lr_watch *watch, lr_error *error);

#endif
