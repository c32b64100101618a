/* The chessboard distances of a volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRAVERSERS_CD_DISTANCES_H
#define LR_TRAVERSERS_CD_DISTANCES_H

#include "grid/layout.h"

typedef struct lr_cd_distances {
    uint32_t *bricks;          /* [table]: index into near, or LR_FAR_BRICK | distance in bricks */
    uint8_t (*near)[LR_CELLS]; /* distance in cells; one entry more than is used */
    bool packet8;              /* rays may go eight side by side */
} lr_cd_distances;

#endif
