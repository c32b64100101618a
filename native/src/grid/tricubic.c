/* The tricubic B-spline of a cell: its samples, value and gradient.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/tricubic.h"

#include "grid/access.h"

enum { SPAN = 4 }; /* samples along an axis */

void lr_tricubic_samples(const lr_volume *v, const int32_t c[3], double s[LR_TRICUBIC_SAMPLES])
{
    bool within = true;
    for (int a = 0; a < 3; a++)
        within = within && c[a] >= 1 && c[a] + SPAN - 2 < LR_SIDE * v->table_size[a];
    if (within) {
        lr_block(v, c[0] - 1, c[1] - 1, c[2] - 1, SPAN, s);
        return;
    }
    for (int k = 0; k < SPAN; k++)
        for (int j = 0; j < SPAN; j++)
            for (int i = 0; i < SPAN; i++) {
                const int32_t at[3] = {c[0] + i - 1, c[1] + j - 1, c[2] + k - 1};
                *s++ = lr_has_sample(v, at) ? lr_sample(v, at[0], at[1], at[2]) : v->outside;
            }
}

/* Weights of the four samples, and of the three differences between them in the slope, times 6 and
 * 2; differences, so that the slope of what is constant is 0. */
static void weigh(double x, double w[SPAN], double d[SPAN - 1])
{
    const double y = 1.0 - x, xx = x * x, yy = y * y;
    w[0] = yy * y;
    w[1] = 4.0 - 3.0 * xx * (2.0 - x);
    w[2] = 4.0 - 3.0 * yy * (2.0 - y);
    w[3] = xx * x;
    d[0] = yy;
    d[1] = 1.0 + 2.0 * x * y;
    d[2] = xx;
}

double lr_tricubic(const double s[LR_TRICUBIC_SAMPLES], const double p[3], double g[3])
{
    double w[3][SPAN], d[3][SPAN - 1], f[SPAN], value = 0.0, slope[3] = {0};
    for (int a = 0; a < 3; a++)
        weigh(p[a], w[a], d[a]);
    for (int k = 0; k < SPAN; k++) {
        double row[SPAN], along_x = 0.0, along_y = 0.0;
        f[k] = 0.0;
        for (int j = 0; j < SPAN; j++, s += SPAN) {
            row[j] = w[0][0] * s[0] + w[0][1] * s[1] + w[0][2] * s[2] + w[0][3] * s[3];
            f[k] += w[1][j] * row[j];
            for (int i = 0; i < SPAN - 1; i++)
                along_x += w[1][j] * d[0][i] * (s[i + 1] - s[i]);
        }
        for (int j = 0; j < SPAN - 1; j++)
            along_y += d[1][j] * (row[j + 1] - row[j]);
        value += w[2][k] * f[k];
        slope[0] += w[2][k] * along_x;
        slope[1] += w[2][k] * along_y;
    }
    for (int k = 0; k < SPAN - 1; k++)
        slope[2] += d[2][k] * (f[k + 1] - f[k]);
    for (int a = 0; a < 3 && g != NULL; a++)
        g[a] = slope[a] / 72.0;
    return value / 216.0;
}
