/* 4x4 affine maps, row-major, acting on column vectors.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_AFFINE_H
#define LR_BASE_AFFINE_H

#include "base/base.h"

LR_INLINE void lr_map_point(const double m[16], const double p[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2] * p[2] + m[4 * i + 3];
}

LR_INLINE void lr_map_vector(const double m[16], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[4 * i] * v[0] + m[4 * i + 1] * v[1] + m[4 * i + 2] * v[2];
}

/* A gradient goes by the transpose of the map back, which m is. */
LR_INLINE void lr_map_gradient(const double m[16], const double g[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[i] * g[0] + m[4 + i] * g[1] + m[8 + i] * g[2];
}

/* out = a b; out may be a or b. */
void lr_affine_multiply(const double a[16], const double b[16], double out[16]);

/* False where m is not a finite, invertible affine map. */
bool lr_affine_invert(const double m[16], double out[16]);

#endif
