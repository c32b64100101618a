/* One brick of the volume to come: signed distances in the band, filtered.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_BRICK_H
#define LR_VOXELIZE_BRICK_H

#include "mesh/closest_triangle.h"
#include "mesh/signed_distance.h"
#include "mesh/triangle_box.h"
#include "voxelize/keep_attributes.h"
#include "voxelize/triangle_bins.h"

/* What is the same for all bricks. */
typedef struct lr_voxel_job {
    const lr_topology *mesh;
    lr_nearest_search *search;
    int32_t table_size[3];
    int32_t size[3];   /* of the lattice, samples */
    double band;       /* voxels; samples within it have a distance */
    int32_t filter;    /* lr_filter */
    double half_width; /* of the filter, voxels */
    int32_t sample_type;
    bool every; /* cell near a triangle keeps it */
    bool flat;  /* the mesh is flat-shaded: its facets' normals count */
    bool sheet;
    lr_bake bake;
    bool exact; /* cells are judged in a second run (choose_triangle_cells.h) */
    const struct lr_winding *closing; /* of a solid with wide holes; else NULL */
} lr_voxel_job;

typedef enum lr_brick_state {
    LR_STATE_UNKNOWN = 0, /* no sample in the band: all of one side, as its neighbours say */
    LR_STATE_ZERO,
    LR_STATE_ONE,
    LR_STATE_MIXED /* to be stored */
} lr_brick_state;

/* The samples on a brick's faces -x +x -y +y -z +z, a bit each: those inside, and those
 * within the band. */
typedef struct lr_faces {
    uint64_t inside[6], in_band[6];
} lr_faces;

/* Sample x + 8 y + 64 z, cells as in grid/brick_grid.h. */
typedef struct lr_brick {
    lr_brick_state state;
    _Alignas(16) float value[LR_BRICK_SAMPLES]; /* occupancy; quantised only when it is written */
    uint16_t
        id[LR_BRICK_SAMPLES]; /* of the nearest triangle; 0 beyond the band; of meshes with ids */
    uint64_t touched[8];      /* cells that a triangle of a sheet meets */
    lr_faces faces;
    bool contradicts; /* neighbours differ by more than lies between them */
    bool has_nearest; /* the scratch names triangles */
} lr_brick;

/* Per-thread memory: the samples that each listed triangle won, as linked lists. */
typedef struct lr_scratch {
    int32_t *first;                 /* [longest list]: -1 between bricks */
    int32_t next[LR_BRICK_SAMPLES]; /* -1: last */
    lr_nearest nearest;
    const uint16_t *labels; /* [512]: of the brick; NULL: pseudonormals tell the side */
    const struct lr_component *components; /* by label */
    uint32_t *nearest_triangle; /* [512]: 1 + nearest triangle, where the brick is dressed; NULL:
                                   not wanted */
    struct lr_crossed *crossed; /* room of the box filter where shells cross, or NULL */
} lr_scratch;

/* Signed distances of the samples of a brick, infinity beyond the band; at is its place in
 * the table. loose[512], or NULL: set where the nearest point lies on the mesh's border.
 * False where stopped. */
bool lr_brick_distances(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                        const lr_watch *watch, lr_scratch *scratch, float *distance,
                        uint8_t *loose);

/* False where stopped. */
bool lr_brick_make(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                   const lr_watch *watch, lr_scratch *scratch, lr_brick *brick);

#endif
