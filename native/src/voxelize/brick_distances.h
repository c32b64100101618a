/* Signed distances of the samples of a brick in the band around the mesh.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_BRICK_DISTANCES_H
#define LR_VOXELIZE_BRICK_DISTANCES_H

#include "grid/layout.h"
#include "mesh/closest_triangle.h"
#include "mesh/triangle_distance.h"
#include "voxelize/keep_attributes.h"

struct lr_cell_work;

/* What is the same for all bricks. */
typedef struct lr_voxel_job {
    const lr_topology *mesh;
    lr_nearest_search *search;
    bool (*test_cells)(struct lr_cell_work *, uint32_t); /* of cell_tests.h */
    int32_t table_size[3];
    int32_t size[3];   /* of the lattice, samples */
    double band;       /* voxels; samples within it have a distance */
    int32_t filter;    /* lr_filter */
    double half_width; /* of the filter, voxels */
    bool every;        /* every cell near a triangle keeps it */
    bool flat;         /* the mesh is flat-shaded: cells must keep its facets' normals */
    bool sheet;
    lr_attribute_set attributes;
    bool exact; /* a second run chooses triangle cells (choose_triangle_cells.h) */
    const struct lr_winding *hole_fill; /* fills the wide holes of a solid; NULL: no such holes */
} lr_voxel_job;

/* Per-thread memory, with linked lists of the samples that are nearest to each triangle. */
typedef struct lr_scratch {
    int32_t *first;         /* [longest list]: -1 between bricks */
    int32_t next[LR_CELLS]; /* -1: last */
    lr_nearest nearest;
    const uint16_t *component_of; /* [LR_CELLS], of the brick; NULL: sides by pseudonormals */
    const struct lr_component *components; /* those that component_of numbers */
    uint32_t *nearest_triangle;            /* [LR_CELLS]: 1 + nearest triangle; NULL: not stored */
    struct lr_crossed *crossed; /* memory of the box filter where shells cross, or NULL */
} lr_scratch;

/* The number in its brick of a sample of the search. */
LR_INLINE int32_t lr_tile_sample(int tile, int lane)
{
    return lr_in_brick(lr_sample_x(tile, lane), lr_sample_y(tile, lane), lr_sample_z(tile, lane));
}

/* A triangle from a brick's first sample; the frame is still to be made. */
void lr_brick_frame(const lr_topology *mesh, const int32_t first[3], uint32_t t, lr_frame *frame);

/* Signed distances of the samples of a brick, infinity beyond the band; at is its place in
 * the table. loose[LR_CELLS], or NULL: set where the nearest point lies on the mesh's border.
 * False where stopped. */
bool lr_brick_distances(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                        const lr_watch *watch, lr_scratch *scratch, float *distance,
                        uint8_t *loose);

#endif
