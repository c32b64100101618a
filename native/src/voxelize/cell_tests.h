/* Tests of triangles against the cells of a brick and the samples there.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_CELL_TESTS_H
#define LR_VOXELIZE_CELL_TESTS_H

#include "voxelize/brick_distances.h"

/* The corners of a brick's cells, and one sample more on either side. */
enum {
    LR_FIELD_SIDE = LR_SIDE + 3,
    LR_FIELD_LAYER = LR_FIELD_SIDE * LR_FIELD_SIDE,
    LR_FIELD_SIZE = LR_FIELD_SIDE * LR_FIELD_LAYER
};

/* The place in a field of the sample that is so far from the brick's first. */
LR_INLINE int lr_field_at(int x, int y, int z)
{
    return x + 1 + LR_FIELD_SIDE * (y + 1) + LR_FIELD_LAYER * (z + 1);
}

typedef struct lr_cell_pair {
    uint32_t cell, triangle;
} lr_cell_pair;

/* What is known of a brick, and what its triangles do to its cells. */
typedef struct lr_cell_work {
    const lr_voxel_job *job;
    int32_t first[3];  /* sample of the brick */
    double crease_off; /* distances that differ by more do so at a crease; voxels */
    bool crease_free;  /* there is no crease in the brick: nothing beyond corners is looked at */
    double field[LR_FIELD_SIZE]; /* samples as distances (true ones near the surface, where the
                                    filter is no ramp); positive inside */
    lr_mask near, touched, bad;
    lr_cell_pair *pairs; /* of all cells and the triangles near them */
    size_t n_pairs, room;
} lr_cell_work;

/* Test one triangle; false without memory. By the instructions of an lr_simd that the processor
 * has; all give the same results. */
typedef bool lr_cell_test(lr_cell_work *w, uint32_t triangle);
lr_cell_test lr_test_cells_portable, lr_test_cells_avx2, lr_test_cells_avx512;

#endif
