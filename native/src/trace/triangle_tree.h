/* Rays and the triangles of a volume whose surface cells all keep theirs, without a walk through
 * cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRIANGLE_TREE_H
#define LR_TRACE_TRIANGLE_TREE_H

#include "trace/triangle_cell.h"
#include "trace/wide_nodes.h"

/* Up to eight triangles side by side, in storage space. */
typedef struct lr_triangle_block {
    _Alignas(64) double corner[3][3][LR_TREE_LANES]; /* by corner, then by axis */
    uint32_t triangle[LR_TREE_LANES];                /* LR_NO_TRIANGLE: none */
} lr_triangle_block;

/* The same in half the memory: corners as the mesh has them, in f32. */
typedef struct lr_narrow_block {
    _Alignas(64) float corner[3][3][LR_TREE_LANES];
    uint32_t triangle[LR_TREE_LANES];
} lr_narrow_block;

typedef struct lr_triangle_tree {
    const lr_triangle_cells *cells; /* whose triangles these are */
    lr_wide_tree boxes;             /* none where there is but one block */
    lr_triangle_block *blocks;      /* or NULL, and: */
    lr_narrow_block *narrow;
    double scale[3],
        offset[3]; /* that give corners of narrow blocks in storage space, to the bit */
    uint32_t n_blocks;
    int32_t simd; /* lr_simd */
} lr_triangle_tree;

/* Can a tree stand for the volume? */
bool lr_has_only_triangles(const lr_volume *volume);

/* *tree is to be given to lr_triangle_tree_free, *nbytes what it takes. */
lr_status lr_triangle_tree_build(const lr_volume *volume, lr_triangle_tree **tree, uint64_t *nbytes,
                                 lr_error *error);
void lr_triangle_tree_free(lr_triangle_tree *tree); /* NULL is fine */

/* A ray in a tree, and what it has met; each instruction set gives the same bits. */
typedef struct lr_tree_ray {
    lr_ray r; /* for points along it */
    lr_shear shear;
    lr_slabs slabs; /* where there are boxes */
    double t_min;
    int32_t side;               /* see lr_leaving */
    double off;                 /* of the start, from triangles that it lies on */
    bool any;                   /* whatever it meets will do */
    double t;                   /* of the nearest hit, at most; INFINITY: none yet */
    uint32_t triangle;          /* that is hit; LR_NO_TRIANGLE: none */
    uint64_t n_nodes, n_blocks; /* that were looked at */
} lr_tree_ray;

typedef struct lr_tree_ops {
    /* The nearest triangle of a branch: a node, or the number of a block | LR_LEAF. */
    void (*meet)(const lr_triangle_tree *tree, uint32_t branch, lr_tree_ray *ray);
    /* The next leaf of a tree of boxes, as wide_next. */
    uint32_t (*next)(const lr_wide_node *nodes, const lr_slabs *slabs, float last, lr_branch *stack,
                     uint32_t *n, uint64_t *n_nodes);
} lr_tree_ops;

/* By the instructions of an lr_simd that the processor has. */
extern const lr_tree_ops lr_tree_portable, lr_tree_avx2, lr_tree_avx512;
const lr_tree_ops *lr_tree_ops_of(int32_t simd);

/* What a ray in the tree does with a triangle whose line it meets at t: false where that lies
 * behind it, or is what it leaves. */
bool lr_tree_accepts(const lr_triangle_tree *tree, const lr_tree_ray *ray, uint32_t triangle,
                     double t, bool inward);

/* What comes of a ray in the tree. */
typedef enum lr_tree_outcome {
    LR_TREE_MISSES,
    LR_TREE_MEETS, /* ray->triangle, at ray->t */
    LR_TREE_ASKS   /* only a walk through cells can tell, as lr_trace_scene takes one */
} lr_tree_outcome;

/* Do options ask for no more than a tree tells, so that nothing has to be checked by volume? */
bool lr_tree_takes(const lr_trace_options *options);

/* The branch that is the whole of a tree. */
LR_INLINE uint32_t lr_tree_root(const lr_triangle_tree *tree)
{
    return tree->boxes.n_nodes > 0 ? 0 : LR_LEAF;
}

/* Prepare a ray for the tree of a structure that has one, from t_min on, in object space; false: it
 * meets nothing. start: of a ray that leaves a surface, or NULL; way: as lr_leave's. any: whatever
 * the ray meets will do. */
bool lr_tree_aim(const lr_structure *structure, const double o[3], const double d[3], double t_min,
                 const lr_start *start, const double *way, bool any, lr_tree_ray *ray);

/* The nearest triangle of a branch, up to t_max; there only one before `triangle`. */
lr_tree_outcome lr_tree_meet(const lr_structure *structure, uint32_t branch, double t_max,
                             uint32_t triangle, lr_tree_ray *ray);

/* Put what the ray has met into hits[i]; d as for lr_tree_meet. False where only a walk through
 * cells can tell. */
bool lr_tree_put(const lr_structure *structure, const lr_tree_ray *ray, const double d[3],
                 int32_t normal_kind, const lr_hits *hits, uint64_t i);

/* As lr_trace in LR_MODE_SURFACE, by a tree of triangles where the structure has one; steps are not
 * counted. any: whatever a ray meets will do, and only t counts. */
lr_status lr_trace_scene(const lr_structure *structure, const lr_rays *rays, uint64_t n,
                         const lr_trace_options *options, bool any, const lr_hits *hits,
                         lr_counters *counters, const lr_watch *watch, lr_error *error);

#endif
