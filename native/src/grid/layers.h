/* One bit for each sample of a brick, a word for each layer across z: sample (x, y, z) is bit
 * x + 8 y of word z. So a layer is worked on at once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_LAYERS_H
#define LR_GRID_LAYERS_H

#include "grid/layout.h"

enum { LR_LAYER_SAMPLES = LR_SIDE * LR_SIDE };

typedef uint64_t lr_layers[LR_SIDE];

_Static_assert(LR_LAYER_SAMPLES == 64, "a layer is a word");

#define LR_COLUMN_FIRST 0x0101010101010101u
#define LR_COLUMN_LAST  0x8080808080808080u

LR_INLINE bool lr_layers_have(const lr_layers layers, int sample)
{
    return layers[sample / LR_LAYER_SAMPLES] >> sample % LR_LAYER_SAMPLES & 1;
}

/* Set the bits of samples side by side from a sample on, of the same layer. */
LR_INLINE void lr_layers_add(lr_layers layers, int sample, uint64_t bits)
{
    layers[sample / LR_LAYER_SAMPLES] |= bits << sample % LR_LAYER_SAMPLES;
}

/* The samples of a layer whose neighbours along an axis are set. */
LR_INLINE uint64_t lr_layers_neighbours(const lr_layers layers, int z)
{
    const uint64_t w = layers[z];
    const uint64_t spread =
        (w << 1 & ~LR_COLUMN_FIRST) | (w >> 1 & ~LR_COLUMN_LAST) | w << LR_SIDE | w >> LR_SIDE;
    return spread | (z > 0 ? layers[z - 1] : 0) | (z < LR_SIDE - 1 ? layers[z + 1] : 0);
}

/* The first column of a layer, side by side. */
LR_INLINE uint64_t lr_layer_column(uint64_t layer)
{
    return (layer & LR_COLUMN_FIRST) * 0x0102040810204080u >> 56;
}

/* The faces -x +x -y +y -z +z of a brick, a bit for each sample: those of neighbours compare. */
LR_INLINE void lr_layers_faces(const lr_layers layers, uint64_t face[6])
{
    memset(face, 0, 6 * sizeof *face);
    for (int z = 0; z < LR_SIDE; z++) {
        face[0] |= lr_layer_column(layers[z]) << LR_SIDE * z;
        face[1] |= lr_layer_column(layers[z] >> (LR_SIDE - 1)) << LR_SIDE * z;
        face[2] |= (layers[z] & 0xff) << LR_SIDE * z;
        face[3] |= (layers[z] >> 56) << LR_SIDE * z;
    }
    face[4] = layers[0];
    face[5] = layers[LR_SIDE - 1];
}

/* The samples of layer z that lie in the box lo..hi - 1, counted from the brick's first. */
LR_INLINE uint64_t lr_layer_in_box(const int32_t lo[3], const int32_t hi[3], int z)
{
    uint64_t layer = 0;
    if (z < lo[2] || z >= hi[2])
        return 0;
    for (int y = lr_max_i(lo[1], 0); y < lr_min_i(hi[1], LR_SIDE); y++)
        for (int x = lr_max_i(lo[0], 0); x < lr_min_i(hi[0], LR_SIDE); x++)
            layer |= (uint64_t)1 << (x + LR_SIDE * y);
    return layer;
}

#endif
