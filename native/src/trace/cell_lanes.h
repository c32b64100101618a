/* Eight cells of one ray side by side: the cubics along them, and the light of those that one piece
 * of a transfer function sees.
 *
 * What a cell adds does not depend on what lies before it, so that cells need no order until their
 * light is added up. All instruction sets give the same bits.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CELL_LANES_H
#define LR_TRACE_CELL_LANES_H

#include "trace/ray.h"

enum { LR_CELL_LANES = 8 };

typedef struct lr_cell_lanes {
    _Alignas(64) double corner[8][LR_CELL_LANES];
    double cell[3][LR_CELL_LANES];                      /* its lowest corner, in storage space */
    double t_low[LR_CELL_LANES], t_high[LR_CELL_LANES]; /* the part of the ray in it, between t_min
                                                           and t_max; t_low = t_high: none */
    double c[4][LR_CELL_LANES]; /* the value is sum c[i] x^i, x from 0 to 1 on that part */
    double least[LR_CELL_LANES], greatest[LR_CELL_LANES]; /* bounds of it */
    /* of its piece of the transfer function, as lr_transfer_piece has it */
    double from[LR_CELL_LANES], extinction[2][LR_CELL_LANES], turn[LR_CELL_LANES];
    double middle[LR_CELL_LANES];   /* the value at x = 1/2, from `from` on */
    double after[LR_CELL_LANES];    /* what it lets through */
    double integral[LR_CELL_LANES]; /* of the value's distance from its middle, by opacity */
    double within[LR_CELL_LANES];   /* 1: these are within the tolerance, 0: not */
} lr_cell_lanes;

/* What is the same for all cells of a ray. */
typedef struct lr_lanes_ray {
    double t_min, t_max, speed, tolerance;
    double graze[3]; /* what rounding does at most to t of the planes of an axis */
} lr_lanes_ray;

typedef struct lr_lanes_ops {
    void (*cubics)(lr_cell_lanes *lanes, const lr_ray *r, const lr_lanes_ray *k);
    void (*light)(lr_cell_lanes *lanes, const lr_lanes_ray *k);
} lr_lanes_ops;

/* By the instructions of an lr_simd that the processor has. */
extern const lr_lanes_ops lr_lanes_portable, lr_lanes_avx2, lr_lanes_avx512;

#endif
