/* Finds the cells that a triangle meets.
 *
 * By the separating axes of triangle and box: the box's three, the triangle's normal and the
 * nine products of edges. The box is a cell, widened by a given margin.
 *
 * Source: Akenine-Moeller 2001, Fast 3D triangle-box overlap testing.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/triangle_box.h"

static lr_separator separate(const double axis[3], const double p[3][3])
{
    lr_separator s = {.lo = INFINITY, .hi = -INFINITY};
    for (int a = 0; a < 3; a++) {
        s.axis[a] = axis[a];
        s.extent += fabs(axis[a]);
    }
    for (int c = 0; c < 3; c++) {
        double at = lr_dot(axis, p[c]);
        s.lo = at < s.lo ? at : s.lo;
        s.hi = at > s.hi ? at : s.hi;
    }
    return s;
}

void lr_separators_make(const double p[3][3], lr_separator s[LR_SEPARATORS])
{
    int n = 0;
    double edge[3][3], normal[3];
    for (int e = 0; e < 3; e++)
        lr_sub(p[(e + 1) % 3], p[e], edge[e]);
    lr_cross_product(edge[0], edge[1], normal);
    s[n++] = separate(normal, p);
    for (int e = 0; e < 3; e++)
        for (int a = 0; a < 3; a++) {
            double unit[3] = {a == 0, a == 1, a == 2}, axis[3];
            lr_cross_product(unit, edge[e], axis);
            s[n++] = separate(axis, p);
        }
}

bool lr_cell_range(const double p[3][3], double grow, int32_t lo[3], int32_t hi[3])
{
    for (int a = 0; a < 3; a++) {
        double least = fmin(fmin(p[0][a], p[1][a]), p[2][a]) - grow - 1.0;
        double most = fmax(fmax(p[0][a], p[1][a]), p[2][a]) + grow;
        if (least > 7.0 || most < 0.0)
            return false;
        lo[a] = least > 0.0 ? (int32_t)ceil(least) : 0;
        hi[a] = most < 7.0 ? (int32_t)floor(most) : 7;
    }
    return true;
}

void lr_touch_cells(const double p[3][3], uint64_t touched[8])
{
    int32_t lo[3], hi[3];
    if (!lr_cell_range(p, LR_TOUCH, lo, hi))
        return;
    lr_separator s[LR_SEPARATORS];
    lr_separators_make(p, s);
    for (int32_t z = lo[2]; z <= hi[2]; z++)
        for (int32_t y = lo[1]; y <= hi[1]; y++)
            for (int32_t x = lo[0]; x <= hi[0]; x++) {
                uint64_t *word = &touched[x / 4 + 2 * (y / 4) + 4 * (z / 4)];
                uint64_t bit = (uint64_t)1 << (x % 4 + 4 * (y % 4) + 16 * (z % 4));
                const double centre[3] = {x + 0.5, y + 0.5, z + 0.5};
                if (!(*word & bit) && !lr_apart(s, centre, LR_TOUCH))
                    *word |= bit;
            }
}
