/* The gradient of the values of a visible volume, and the samples that it is made of.
 *
 * Its direction is that of surfaces' normals, by the same choice of differences. Samples that are
 * no values, as all beyond the lattice of a bounded volume, are continued linearly from the cell:
 * central differences beside them become one-sided.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_VALUE_GRADIENT_H
#define LR_GRID_VALUE_GRADIENT_H

#include "grid/trilinear.h"

enum { LR_AROUND = 64 }; /* samples of a cell and its neighbours */

/* Continue a line of four samples, of which the inner two are those of the cell. longer: how many
 * times as long as the cell those beside it are. */
LR_INLINE void lr_continue_line(double outside, const double longer[2], double *line, int stride)
{
    double *at[4] = {line, line + stride, line + 2 * stride, line + 3 * stride};
    const double rise = *at[2] - *at[1];
    if (*at[0] == outside)
        *at[0] = *at[1] - longer[0] * rise;
    if (*at[3] == outside)
        *at[3] = *at[2] + longer[1] * rise;
}

/* The lengths of the cells beside storage cell c along axis a, in its own. */
LR_INLINE void lr_lengths_beside(const lr_volume *v, const int32_t c[3], int a, double longer[2])
{
    longer[0] = longer[1] = 1.0;
    if (v->planes[0] == NULL)
        return;
    const double *at = v->planes[a] + c[a], own = at[1] - at[0];
    longer[0] = (at[0] - at[-1]) / own;
    longer[1] = (at[2] - at[1]) / own;
}

/* The 4^3 samples around storage cell c, x fastest; false where the cell itself has one that is no
 * value. */
LR_INLINE bool lr_values_around(const lr_volume *v, const int32_t c[3], double b[LR_AROUND])
{
    lr_block(v, c[0] - 1, c[1] - 1, c[2] - 1, 4, b);
    if (!v->bounded)
        return true;
    for (int n = 0; n < 8; n++)
        if (b[21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2)] == v->outside)
            return false;
    double longer[3][2];
    for (int a = 0; a < 3; a++)
        lr_lengths_beside(v, c, a, longer[a]);
    for (int j = 1; j < 3; j++)
        for (int k = 1; k < 3; k++)
            lr_continue_line(v->outside, longer[0], b + 4 * j + 16 * k, 1);
    for (int i = 0; i < 4; i++)
        for (int k = 1; k < 3; k++)
            lr_continue_line(v->outside, longer[1], b + i + 16 * k, 4);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            lr_continue_line(v->outside, longer[2], b + i + 4 * j, 16);
    return true;
}

/* As long as the second vector, and as directed as the first. */
LR_INLINE void lr_stretch_to(double g[3], const double length_of[3])
{
    const double own = sqrt(lr_dot(g, g)), wanted = sqrt(lr_dot(length_of, length_of));
    for (int a = 0; a < 3; a++)
        g[a] = own > 0.0 ? g[a] * (wanted / own) : 0.0;
}

/* The gradient of values at p of storage cell c, in object space; false where there is none. By
 * LR_NORMAL_SMOOTH, which blends directions, its length is that of central differences. */
LR_INLINE bool lr_value_gradient(const lr_volume *v, const int32_t c[3], const double p[3],
                                 int32_t normal_kind, double gradient[3])
{
    double b[LR_AROUND], g[3];
    if (!lr_values_around(v, c, b))
        return false;
    if (normal_kind == LR_NORMAL_ANALYTIC) {
        const double cell[8] = {b[21], b[22], b[25], b[26], b[37], b[38], b[41], b[42]};
        lr_trilinear_gradient(cell, p, g);
        lr_scale_gradient(v, c, g);
    } else if (normal_kind == LR_NORMAL_SOBEL || normal_kind == LR_NORMAL_ZUCKER_HUMMEL) {
        lr_averaged_gradient_in(v, c, b, p,
                                normal_kind == LR_NORMAL_SOBEL ? lr_sobel : lr_zucker_hummel, g);
    } else {
        lr_central_gradient_in(v, c, b, p, g);
    }
    if (normal_kind == LR_NORMAL_SMOOTH) {
        double blended[3];
        int32_t first[3];
        lr_first_around(c, p, first);
        const int at =
            (first[0] - c[0] + 1) + 4 * (first[1] - c[1] + 1) + 16 * (first[2] - c[2] + 1);
        lr_smooth_gradient_in(v, c, b + at, 4, p, blended);
        lr_stretch_to(blended, g);
        memcpy(g, blended, sizeof g);
    }
    lr_map_gradient(v->storage_from_object, g, gradient);
    for (int a = 0; a < 3; a++)
        gradient[a] *= v->value_scale;
    const double square = lr_dot(gradient, gradient);
    return square > 0.0 && square < INFINITY;
}

/* How much of a transfer function is seen at the corners of storage cell c, 0..1, by the lengths of
 * their gradients by central differences; false where the cell has a sample that is no value. */
LR_INLINE bool lr_modulation_at(const lr_volume *v, const int32_t c[3], double full_gradient,
                                double corner[8])
{
    double b[LR_AROUND], slope[3][8];
    if (!lr_values_around(v, c, b))
        return false;
    for (int a = 0; a < 3; a++)
        lr_central_differences(v, c, b, a, slope[a]);
    for (int n = 0; n < 8; n++) {
        const double g[3] = {slope[0][n], slope[1][n], slope[2][n]};
        double object[3];
        lr_map_gradient(v->storage_from_object, g, object);
        corner[n] = fmin(sqrt(lr_dot(object, object)) / full_gradient, 1.0);
    }
    return true;
}

#endif
