/* Transfer functions: what values of a field look like, as pieces that are linear in the value.
 *
 * Between two knots extinction, colour, emission and scattering are linear, beyond the first and
 * the last they are constant. Piece i lies before knot i, the last one beyond all; a value on a
 * knot belongs to the piece above it. Two knots at one value are a jump, and the piece between them
 * is empty.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_TRANSFER_FUNCTION_H
#define LR_GRID_TRANSFER_FUNCTION_H

#include "base/base.h"

typedef struct lr_transfer_piece {
    double from; /* value that these count from: at it, and what they rise by per unit of value */
    double extinction[2], color[3][2], emission[3][2], scattering[3][2];
    double turn;    /* largest rise of a component of the colour, as a share of the largest */
    double emitted; /* the same of emission, and */
    double shines;  /* the largest component of it at from, as such a share */
    bool absorbs;   /* extinction is not 0 throughout */
    bool emits;     /* nor emission */
    bool one_color; /* colour is the same throughout */
} lr_transfer_piece;

struct lr_transfer {
    uint64_t n;
    double *values;            /* [n]: of the knots */
    lr_transfer_piece *pieces; /* [n + 1] */
    double (*knots)[10];       /* [n]: extinction, colour, emission, scattering */
    double full_gradient; /* of values per unit of object space, at which all is seen; 0: off */
    bool emits;           /* emission is not 0 throughout, */
    bool scatters;        /* nor scattering */
    int32_t simd;         /* lr_simd, of numbers: what light is added up by */
};

/* The same of numbers: a value is offset + scale * number. */
lr_status lr_transfer_of_numbers(const lr_transfer *transfer, double scale, double offset,
                                 lr_transfer **of_numbers, lr_error *error);

/* Is anything of the values low..high visible? */
bool lr_transfer_sees(const lr_transfer *transfer, double low, double high);

/* How many knots lie below a value; with `on_it`, or at it. */
LR_INLINE uint64_t lr_knots_below(const lr_transfer *f, double value, bool on_it)
{
    uint64_t low = 0, high = f->n;
    while (low < high) {
        const uint64_t middle = (low + high) / 2;
        const bool below = on_it ? f->values[middle] <= value : f->values[middle] < value;
        low = below ? middle + 1 : low;
        high = below ? high : middle;
    }
    return low;
}

/* Side by side the pieces of values are found by counting the knots below them, unless these are
 * more than so many. */
enum { LR_FEW_KNOTS = 16 };

/* The number of a value's piece. */
LR_INLINE uint64_t lr_piece_of(const lr_transfer *f, double value)
{
    return lr_knots_below(f, value, true);
}

/* The number of the piece that a value comes down into. */
LR_INLINE uint64_t lr_piece_below(const lr_transfer *f, double value)
{
    return lr_knots_below(f, value, false);
}

LR_INLINE double lr_linear(const double line[2], double from)
{
    return line[0] + line[1] * from;
}

/* The share of light that is scattered where it is extinguished; from: of the value, as p->from. */
LR_INLINE void lr_albedo_at(const lr_transfer_piece *p, double from, double albedo[3])
{
    const double extinction = lr_linear(p->extinction, from);
    for (int k = 0; k < 3; k++) {
        const double share = fmax(lr_linear(p->scattering[k], from), 0.0) / extinction;
        albedo[k] = extinction > 0.0 && share < INFINITY ? share : 0.0;
    }
}

#endif
