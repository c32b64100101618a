/* Entry points for the test of rectangles as area lights see them. Compiled by
 * tests/core/test_area_light.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/area.c"

/* Rectangles rect[n] = {x0, x1, y0, y1, z} from the origin, z < 0: their solid angles, whether
 * these are what they are sampled by, and the places {x, y} for the numbers u[n][2]. */
LR_API void area_see(uint64_t n, const double (*rect)[5], const double (*u)[2], double *angle,
                     uint8_t *by_angle, double (*place)[2])
{
    for (uint64_t i = 0; i < n; i++) {
        lr_light_part r = {
            .axis = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
            .to = {0, 0, rect[i][4]},
            .lo = {rect[i][0], rect[i][2]},
            .hi = {rect[i][1], rect[i][3]},
        };
        see_box(&r);
        angle[i] = r.angle;
        by_angle[i] = r.kind == LR_PART_BOX;
        if (by_angle[i])
            place_by_angle(&r, u[i], &place[i][0], &place[i][1]);
    }
}
