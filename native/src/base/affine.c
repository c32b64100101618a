/* Affine maps.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/affine.h"

void lr_affine_multiply(const double a[16], const double b[16], double out[16])
{
    double product[16];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            product[4 * i + j] = a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] +
                                 a[4 * i + 2] * b[8 + j] + a[4 * i + 3] * b[12 + j];
    memcpy(out, product, sizeof product);
}

bool lr_affine_invert(const double m[16], double out[16])
{
    for (int i = 0; i < 16; i++)
        if (!isfinite(m[i]))
            return false;
    if (m[12] != 0.0 || m[13] != 0.0 || m[14] != 0.0 || m[15] != 1.0)
        return false;
    /* Columns are scaled to unit length first, so that the determinant says how
     * nearly flat the map is, whatever its units. */
    double length[3], a[9];
    for (int j = 0; j < 3; j++) {
        length[j] = hypot(hypot(m[j], m[4 + j]), m[8 + j]);
        if (!(length[j] > 0.0) || !isfinite(length[j]) || !isfinite(1.0 / length[j]))
            return false;
        for (int i = 0; i < 3; i++)
            a[3 * i + j] = m[4 * i + j] / length[j];
    }
    double cofactor[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            cofactor[3 * i + j] = a[3 * i1 + j1] * a[3 * i2 + j2] - a[3 * i1 + j2] * a[3 * i2 + j1];
        }
    double det = a[0] * cofactor[0] + a[1] * cofactor[1] + a[2] * cofactor[2];
    if (!(fabs(det) > 1e-12)) /* unit columns: flat to within rounding */
        return false;
    double inverse[16] = {0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse[4 * i + j] = cofactor[3 * j + i] / det / length[i];
    for (int i = 0; i < 3; i++) {
        inverse[4 * i + 3] =
            -(inverse[4 * i] * m[3] + inverse[4 * i + 1] * m[7] + inverse[4 * i + 2] * m[11]);
        if (!isfinite(inverse[4 * i + 3]))
            return false;
    }
    inverse[15] = 1.0;
    memcpy(out, inverse, sizeof inverse);
    return true;
}
