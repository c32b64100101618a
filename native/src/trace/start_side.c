/* Rays that leave triangles: their starts, put on the side to which they leave.
 *
 * A start lies on a triangle but for rounding, and so, half of the time, beyond it. Beside an
 * edge its line may then pass by both triangles of that: the ray gets out of a solid, or into
 * it, unseen. Once the start is clear of what it lies on, by more than rounding does to the
 * intersection of triangles, every triangle that the ray meets is one that it goes through, and
 * triangles that share an edge let none pass between them.
 *
 * The way is that of the sum of the triangles' normals, the shortest one that clears all:
 * at an edge it leads to the side of both. At a corner whose triangles do not all face it,
 * those that do not are left as they are.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/start_side.h"

#include "trace/cell_common.h"

/* Voxels: more than rounding does to heights over triangles in storage space, whose coordinates
 * are below 2^14: some dozen units in the last place of these. */
static const double CLEAR = 1e-10;
/* Triangles that lean more than this from the way, as a cosine, would make it long. */
static const double LEAST_LEAN = 0.05;

/* Is q, which lies in the plane of corners p but for `off`, that near to their triangle, too?
 * square: of the length of its normal n. */
static bool is_over(const lr_triangle_cells *e, uint32_t triangle, const double *const p[3],
                    const double n[3], double square, const double q[3], double off)
{
    bool beside = false;
    for (int c = 0; c < 3; c++) {
        const double *a = p[c], *b = p[(c + 1) % 3];
        const double beyond = lr_beyond_edge(a, b, n, q);
        if (beyond <= 0.0)
            continue;
        const double edge[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
        if (beyond * beyond > 2.0 * off * off * square * lr_dot(edge, edge))
            return false; /* as nearly all are; twice, for what rounds */
        beside = true;
    }
    return !beside || lr_triangle_cell_distance2(e, triangle, q) <= off * off;
}

/* May q lie on the triangle of corners p, but for `off`? Twice, for what rounds. */
static bool is_in_box(const double *const p[3], const double q[3], double off)
{
    bool in = true;
    for (int a = 0; a < 3; a++) {
        const double x[3] = {p[0][a] - q[a], p[1][a] - q[a], p[2][a] - q[a]};
        const double low = x[0] < x[1] ? x[0] : x[1], high = x[0] < x[1] ? x[1] : x[0];
        in &=
            ((low < x[2] ? low : x[2]) <= 2.0 * off) & ((high > x[2] ? high : x[2]) >= -2.0 * off);
    }
    return in;
}

/* Does q lie on the triangle, but for `off`? n: its unit normal to the given side. height: how far
 * q is on that side of its plane. */
static bool lies_on(const lr_triangle_cells *e, uint32_t triangle, int32_t side, const double q[3],
                    double off, double n[3], double *height)
{
    const double *p[3];
    lr_triangle_cell_corners(e, triangle, p);
    if (!is_in_box(p, q, off)) /* as few are */
        return false;
    lr_corners_normal(p, n);
    const double square = lr_dot(n, n), along = lr_height_over(p[0], n, q);
    if (!(along * along <= off * off * square) || !is_over(e, triangle, p, n, square, q, off))
        return false;
    const double unit = -side / sqrt(square);
    *height = along * unit;
    for (int a = 0; a < 3; a++)
        n[a] *= unit;
    return true;
}

void lr_ways_to_sides(const lr_volume *v, const int32_t c[3], int32_t side, const double q[3],
                      double way[2][3])
{
    double n[3], sum[3] = {0}, height = 0.0, low = INFINITY, high = -INFINITY;
    uint32_t count, n_near = 0;
    const double off = lr_start_off(v);
    const uint32_t *list = lr_triangle_cell_list(v, c, &count);
    for (uint32_t i = 0; i < count; i++)
        if (lies_on(v->triangle_cells, list[i], side, q, off, n, &height)) {
            n_near++;
            low = fmin(low, height);
            high = fmax(high, height);
            for (int a = 0; a < 3; a++)
                sum[a] += n[a];
        }
    const double length = sqrt(lr_dot(sum, sum));
    for (int other = 0; other < 2; other++) {
        const double sign = other ? -1.0 : 1.0, least = other ? -high : low;
        double far = n_near == 1 ? fmax(CLEAR - least, 0.0) : 0.0;
        if (n_near > 1 && least < CLEAR && length > LEAST_LEAN)
            for (uint32_t i = 0; i < count; i++)
                if (lies_on(v->triangle_cells, list[i], side, q, off, n, &height)) {
                    const double lean = lr_dot(n, sum) / length;
                    if (lean > LEAST_LEAN)
                        far = fmax(far, (CLEAR - sign * height) / lean);
                }
        for (int a = 0; a < 3; a++)
            way[other][a] = far > 0.0 ? far / length * (sign * sum[a]) : 0.0;
    }
}
