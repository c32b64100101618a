/* The pixel's filter.
 *
 * Source: Harris, On the use of windows for harmonic analysis, 1978 (the window
 * of four terms that he calls after Blackman and himself); Cycles stretches it over
 * twice the filter's width.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/film/pixel_filter.h"

/* Integral of the window over 0..x, as a fraction of that over 0..1. */
static double integral(double x)
{
    const double a = (2 * LR_PI) * x;
    return x - (0.48829 * sin(a) - 0.14128 / 2 * sin(2 * a) + 0.01168 / 3 * sin(3 * a)) /
                   (0.35875 * (2 * LR_PI));
}

static double inverse(double fraction)
{
    double lo = 0, hi = 1;
    for (int k = 0; k < 60; k++) {
        const double middle = 0.5 * (lo + hi);
        if (integral(middle) < fraction)
            lo = middle;
        else
            hi = middle;
    }
    return 0.5 * (lo + hi);
}

void lr_filter_make(int32_t filter, double width, double *table)
{
    for (int k = 0; k <= LR_FILTER_TABLE; k++) {
        const double fraction = (double)k / LR_FILTER_TABLE;
        table[k] = filter == LR_FILM_BOX ? fraction - 0.5 : 2 * width * (inverse(fraction) - 0.5);
    }
    table[LR_FILTER_TABLE / 2] = 0;
}
