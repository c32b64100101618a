/* The chessboard distances of a volume, and what packets of rays read beside them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRAVERSERS_CD_DISTANCES_H
#define LR_TRAVERSERS_CD_DISTANCES_H

#include "grid/surface_cells.h"

/* A surface cell: this and its number among those of its pair of layers. */
#define LR_CD_SURFACE 0x80

enum { LR_CD_PAIRS = LR_SIDE / 2 /* of the layers along z of a brick */ };

struct lr_cd_packet;

typedef struct lr_cd_distances {
    uint32_t *bricks;          /* [table]: index into near, or LR_FAR_BRICK | distance in bricks */
    uint8_t (*near)[LR_CELLS]; /* distance in cells, or LR_CD_SURFACE | number; one entry more than
                                  is used */
    const struct lr_cd_packet *packet; /* NULL: rays go one at a time, and what follows is NULL */
    uint32_t (*first)[LR_CD_PAIRS];    /* [near]: number of each pair's first surface cell */
    int8_t (*corners)[8]; /* [surface cell]: f - T at its corners by the largest of these, times
                             127; all 0 where the field does not tell */
} lr_cd_distances;

#endif
