/* Which cells does a triangle meet?
 *
 * Separating axes of triangle and box: the box's three, the triangle's normal
 * and the nine products of edges. The box is a cell widened by TOUCH on every
 * side, so that a triangle in a face shared by two cells meets both, whatever
 * rounding does.
 *
 * Source: Akenine-Moeller 2001, Fast 3D triangle-box overlap testing.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/brick.h"

#define TOUCH 1e-4 /* voxel */

/* An axis with the triangle's range on it, widened by the box's radius: the box
 * around c is apart where axis.c lies outside. */
typedef struct separator {
    double axis[3], lo, hi;
} separator;

static separator separate(const double axis[3], const double p[3][3])
{
    separator s = {.lo = INFINITY, .hi = -INFINITY};
    double radius = 0.0;
    for (int a = 0; a < 3; a++) {
        s.axis[a] = axis[a];
        radius += (0.5 + TOUCH) * fabs(axis[a]);
    }
    for (int c = 0; c < 3; c++) {
        double at = lr_dot(axis, p[c]);
        s.lo = at < s.lo ? at : s.lo;
        s.hi = at > s.hi ? at : s.hi;
    }
    s.lo -= radius;
    s.hi += radius;
    return s;
}

static int make_separators(const double p[3][3], separator s[10])
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
    return n;
}

static bool apart(const separator *s, int n, const double c[3])
{
    for (int i = 0; i < n; i++) {
        double at = lr_dot(s[i].axis, c);
        if (at < s[i].lo || at > s[i].hi)
            return true;
    }
    return false;
}

static bool cell_range(const double p[3][3], int32_t lo[3], int32_t hi[3])
{
    for (int a = 0; a < 3; a++) {
        double least = fmin(fmin(p[0][a], p[1][a]), p[2][a]) - TOUCH - 1.0;
        double most = fmax(fmax(p[0][a], p[1][a]), p[2][a]) + TOUCH;
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
    if (!cell_range(p, lo, hi))
        return;
    separator s[10];
    int n = make_separators(p, s);
    for (int32_t z = lo[2]; z <= hi[2]; z++)
        for (int32_t y = lo[1]; y <= hi[1]; y++)
            for (int32_t x = lo[0]; x <= hi[0]; x++) {
                uint64_t *word = &touched[x / 4 + 2 * (y / 4) + 4 * (z / 4)];
                uint64_t bit = (uint64_t)1 << (x % 4 + 4 * (y % 4) + 16 * (z % 4));
                const double centre[3] = {x + 0.5, y + 0.5, z + 0.5};
                if (!(*word & bit) && !apart(s, n, centre))
                    *word |= bit;
            }
}
