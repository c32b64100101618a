/* The trilinear field of a cell: its value, gradient and central differences.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_TRILINEAR_H
#define LR_GRID_TRILINEAR_H

#include "base/affine.h"
#include "grid/objects.h"
#include "grid/tricubic.h"

#define LR_NUMBER        double
#define LR_FORMULA(name) name
#include "grid/trilinear_impl.h"

/* From slopes by cell to slopes by unit of storage space. */
LR_INLINE void lr_scale_gradient(const lr_volume *v, const int32_t c[3], double g[3])
{
    for (int a = 0; a < 3 && v->planes[0] != NULL; a++)
        g[a] /= v->planes[a][c[a] + 1] - v->planes[a][c[a]];
}

/* Central differences along axis a of a rectilinear volume; those of the cell are at[0]
 * and at[1]. */
LR_INLINE void lr_spread_differences(const double *at, int a, double corner[8])
{
    for (int n = 0; n < 8; n++) {
        const int upper = n >> a & 1;
        corner[n] *= 2.0 / (at[upper + 1] - at[upper - 1]);
    }
}

/* Central differences along axis a at the eight corners of storage cell c; b: the 4^3 samples
 * around it. */
LR_INLINE void lr_central_differences(const lr_volume *v, const int32_t c[3], const double b[64],
                                      int a, double corner[8])
{
    const int stride[3] = {1, 4, 16};
    for (int n = 0; n < 8; n++) {
        const double *at = b + 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
        corner[n] = 0.5 * (at[stride[a]] - at[-stride[a]]);
    }
    if (v->planes[0] != NULL)
        lr_spread_differences(v->planes[a] + c[a], a, corner);
}

/* These interpolated at p. */
LR_INLINE void lr_central_gradient_in(const lr_volume *v, const int32_t c[3], const double b[64],
                                      const double p[3], double g[3])
{
    for (int a = 0; a < 3; a++) {
        double corner[8];
        lr_central_differences(v, c, b, a, corner);
        g[a] = lr_trilinear(corner, p);
    }
}

/* Likewise of the volume's samples; of one object's own field, or LR_NO_OBJECT. */
LR_INLINE void lr_central_gradient(const lr_volume *v, int32_t object, const int32_t c[3],
                                   const double p[3], double g[3])
{
    double b[64];
    lr_block_of(v, object, c[0] - 1, c[1] - 1, c[2] - 1, 4, b);
    lr_central_gradient_in(v, c, b, p, g);
}

/* Weights of central differences along a line through a sample, through its neighbours beside an
 * edge and beside a corner; 1 together with the four of each.
 *
 * Sources: Sobel and Feldman 1968; Zucker and Hummel, A three-dimensional edge operator, 1981,
 * whose weights are those of the distance: 1, 1/sqrt(2), 1/sqrt(3). */
static const double lr_sobel[3] = {0.25, 0.125, 0.0625};
static const double lr_zucker_hummel[3] = {0.16292407789368385, 0.11520472029718912,
                                           0.09406426022938993};

/* As lr_central_gradient_in, of differences that are averaged over the nine lines around. */
LR_INLINE void lr_averaged_gradient_in(const lr_volume *v, const int32_t c[3], const double b[64],
                                       const double p[3], const double weight[3], double g[3])
{
    const int stride[3] = {1, 4, 16};
    for (int a = 0; a < 3; a++) {
        const int u = stride[(a + 1) % 3], w = stride[(a + 2) % 3], s = stride[a];
        double corner[8];
        for (int n = 0; n < 8; n++) {
            const double *at = b + 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
            corner[n] = 0.0;
            for (int j = -1; j <= 1; j++)
                for (int i = -1; i <= 1; i++) {
                    const double *line = at + i * u + j * w;
                    corner[n] += weight[(i != 0) + (j != 0)] * 0.5 * (line[s] - line[-s]);
                }
        }
        if (v->planes[0] != NULL)
            lr_spread_differences(v->planes[a] + c[a], a, corner);
        g[a] = lr_trilinear(corner, p);
    }
}

/* As lr_central_gradient, of the same differences. */
LR_INLINE void lr_averaged_gradient(const lr_volume *v, int32_t object, const int32_t c[3],
                                    const double p[3], const double weight[3], double g[3])
{
    double b[64];
    if (lr_is_cubic(v))
        lr_tricubic_samples(v, c, b);
    else
        lr_block_of(v, object, c[0] - 1, c[1] - 1, c[2] - 1, 4, b);
    lr_averaged_gradient_in(v, c, b, p, weight, g);
}

/* The point at p of cell c in the coordinates of another cell of a rectilinear volume. */
LR_INLINE void lr_other_cell(const lr_volume *v, const int32_t c[3], const double p[3],
                             const int32_t other[3], double q[3])
{
    for (int a = 0; a < 3; a++) {
        const double *planes = v->planes[a], low = planes[other[a]];
        const double at = planes[c[a]] + p[a] * (planes[c[a] + 1] - planes[c[a]]);
        q[a] = (at - low) / (planes[other[a] + 1] - low);
    }
}

/* The lowest of the 2^3 cells around the sample nearest to p of cell c. */
LR_INLINE void lr_first_around(const int32_t c[3], const double p[3], int32_t first[3])
{
    for (int a = 0; a < 3; a++)
        first[a] = c[a] - (p[a] < 0.5);
}

/* The analytic gradients of these cells, taken at p, made unit and blended: continuous across
 * faces. b: a block of `side` samples along each axis, from the first cell's on.
 *
 * Source: Hansson-Soderlund, Evans, Akenine-Moller 2022. */
LR_INLINE void lr_smooth_gradient_in(const lr_volume *v, const int32_t c[3], const double *b,
                                     int side, const double p[3], double g[3])
{
    double weight[3];
    int32_t first[3];
    lr_first_around(c, p, first);
    for (int a = 0; a < 3; a++)
        weight[a] = p[a] - 0.5 + (c[a] - first[a]);
    memset(g, 0, 3 * sizeof *g);
    for (int n = 0; n < 8; n++) {
        const int o[3] = {n & 1, n >> 1 & 1, n >> 2};
        double corner[8], q[3], slope[3], share = 1.0;
        int32_t cell[3];
        for (int m = 0; m < 8; m++)
            corner[m] = b[o[0] + (m & 1) + side * (o[1] + (m >> 1 & 1) + side * (o[2] + (m >> 2)))];
        for (int a = 0; a < 3; a++) {
            q[a] = p[a] + (c[a] - first[a]) - o[a];
            cell[a] = first[a] + o[a];
            share *= o[a] ? weight[a] : 1.0 - weight[a];
        }
        if (v->planes[0] != NULL)
            lr_other_cell(v, c, p, cell, q);
        lr_trilinear_gradient(corner, q, slope);
        lr_scale_gradient(v, cell, slope);
        const double length = sqrt(lr_dot(slope, slope));
        for (int a = 0; a < 3 && length > 0.0; a++)
            g[a] += share * slope[a] / length;
    }
}

/* Likewise of the volume's samples; of one object's own field, or LR_NO_OBJECT. */
LR_INLINE void lr_smooth_gradient(const lr_volume *v, int32_t object, const int32_t c[3],
                                  const double p[3], double g[3])
{
    double b[27];
    int32_t first[3];
    lr_first_around(c, p, first);
    lr_block_of(v, object, first[0], first[1], first[2], 3, b);
    lr_smooth_gradient_in(v, c, b, 3, p, g);
}

#endif
