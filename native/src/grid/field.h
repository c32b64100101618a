/* The field of a volume at a point of a cell, whatever it is interpolated by.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_FIELD_H
#define LR_GRID_FIELD_H

#include "grid/tricubic.h"
#include "grid/trilinear.h"

/* The storage cell c of a point of object space, and the place p in it; false where no surface can
 * lie. Not of a rectilinear volume. */
LR_INLINE bool lr_cell_at(const lr_volume *v, const double object[3], int32_t c[3], double p[3])
{
    lr_map_point(v->storage_from_object, object, p);
    for (int a = 0; a < 3; a++) {
        if (!(p[a] >= lr_first_cell(v) && p[a] < lr_last_cell(v, a) + 1))
            return false;
        c[a] = (int32_t)p[a];
        p[a] -= c[a];
    }
    return true;
}

/* f - level at p of storage cell c in stored units, of the right sign; and its gradient g in
 * storage space (NULL: none). */
LR_INLINE double lr_height_in(const lr_volume *v, const int32_t c[3], const double p[3],
                              double level, double g[3])
{
    if (lr_is_cubic(v)) {
        double s[LR_TRICUBIC_SAMPLES];
        lr_tricubic_samples(v, c, s);
        for (int n = 0; n < LR_TRICUBIC_SAMPLES; n++)
            s[n] -= level;
        return lr_tricubic(s, p, g);
    }
    double corner[8];
    lr_corners(v, c, corner);
    if (g != NULL) {
        lr_trilinear_gradient(corner, p, g);
        lr_scale_gradient(v, c, g);
    }
    return lr_trilinear(corner, p) - level;
}

/* Does a point of object space, in storage cell c, lie where the field is at or above a threshold
 * in stored units? c and its place p there are set where lr_cell_at finds them. */
LR_INLINE bool lr_is_above(const lr_volume *v, const double object[3], double threshold,
                           int32_t c[3], double p[3])
{
    return lr_cell_at(v, object, c, p) && lr_height_in(v, c, p, threshold, NULL) >= 0.0;
}

#endif
