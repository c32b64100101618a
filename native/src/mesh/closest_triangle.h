/* The nearest triangle of every sample of a brick.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_CLOSEST_TRIANGLE_H
#define LR_MESH_CLOSEST_TRIANGLE_H

#include "grid/layout.h"
#include "mesh/topology.h"

/* A brick's samples as 32 tiles of 4 x 2 x 2, so that a tile fills vector
 * registers and stays small. Lanes run x, y, z; tiles run y (4), z (4), x (2), so that
 * each axis has four layers of half tiles, cubes of 2^3 samples. */
enum { LR_TILES = 32, LR_TILE = 16, LR_LAYERS = 4 };

_Static_assert(LR_TILES *LR_TILE == LR_CELLS && 2 * LR_LAYERS == LR_SIDE, "tiles fill a brick");

LR_INLINE int lr_sample_x(int tile, int lane)
{
    return (tile >> 4) * 4 + (lane & 3);
}

LR_INLINE int lr_sample_y(int tile, int lane)
{
    return (tile & 3) * 2 + (lane >> 2 & 1);
}

LR_INLINE int lr_sample_z(int tile, int lane)
{
    return (tile >> 2 & 3) * 2 + (lane >> 3);
}

typedef struct lr_nearest {
    _Alignas(64) float d2[LR_TILES][LR_TILE];       /* squared distance, to f32 accuracy */
    _Alignas(64) float height[LR_TILES][LR_TILE];   /* signed, over the nearest triangle, if
                                                        the closest point lies in its face;
                                                        else infinity */
    _Alignas(64) int32_t winner[LR_TILES][LR_TILE]; /* place in the list; -1: beyond the band */
    _Alignas(64) float worst[LR_LAYERS][LR_TILE];   /* largest d2 of half tiles: x, y + 4 z */
} lr_nearest;

/* Search the listed triangles around a brick whose samples lie within 3.5 of
 * centre. False where stopped. */
typedef bool lr_nearest_search(const lr_topology *mesh, const double centre[3],
                               const uint32_t *list, uint32_t n, double band, const lr_watch *watch,
                               lr_nearest *nearest);

/* By the instructions of an lr_simd that the processor has; all give the same results. */
lr_nearest_search lr_nearest_portable, lr_nearest_avx2, lr_nearest_avx512;

#endif
