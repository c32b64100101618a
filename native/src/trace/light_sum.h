/* The light of parts of a ray, added up front to back.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_LIGHT_SUM_H
#define LR_TRACE_LIGHT_SUM_H

#include "grid/transfer_function.h"

/* What remains of light behind it is lost in the rounding of what is before it. */
#define LR_OPAQUE 1e-16
/* So is such a share of the largest colour in that of the sum. A part on a knot may have a depth
 * that is rounded to 0, of which there is no share. */
#define LR_LOST_LIGHT 0x1p-60
/* A part whose integrals are off by too much is halved so often, at most. */
#define LR_MOST_HALVINGS 60

/* Of the parts so far, front to back. */
typedef struct lr_light_sum {
    double tolerance;
    double color[3], transmittance;
    uint64_t pieces; /* integrals taken */
    double stop;     /* the transmittance at which it ends, without colours; 0: none */
    bool ended;      /* there: */
    double at;       /* in x */
    double albedo[3];
} lr_light_sum;

/* Add the light of a part on one piece of the transfer function, of which `after` = exp(-depth) is
 * let through. middle: a value of it, as p->from; y: the value's distance from that, A: the depth
 * behind the part's beginning. integrals: of y dA exp(-A), and by the length that emits of exp(-A)
 * and y exp(-A). */
LR_INLINE void lr_light_sum_add(lr_light_sum *sum, const lr_transfer_piece *p, double middle,
                                double after, const double integrals[3])
{
    for (int k = 0; k < 3; k++) {
        double light = lr_linear(p->color[k], middle) * (1.0 - after);
        light += p->color[k][1] * integrals[0];
        if (p->emits)
            light +=
                lr_linear(p->emission[k], middle) * integrals[1] + p->emission[k][1] * integrals[2];
        sum->color[k] += sum->transmittance * light;
    }
    sum->transmittance *= after;
    sum->pieces++;
}

/* Are the errors of the three integrals within the part's share? That is, of colour, its opacity's,
 * and of emission, its length's. depth: the part's optical depth; half: of its length. */
LR_INLINE bool lr_light_sum_within(const lr_transfer_piece *p, double tolerance, double middle,
                                   double depth, double half, const double error[3])
{
    const bool color =
        p->one_color || p->turn * error[0] <= 0.6 * tolerance * depth + LR_LOST_LIGHT;
    const double shines = p->shines + p->emitted * fabs(middle);
    const bool emission =
        !p->emits || shines * error[1] + p->emitted * error[2] <= tolerance * half;
    return color && emission;
}

#endif
