/* Cells side by side: plain loops over lanes, which compilers turn into vector instructions.
 * Whoever includes this defines LR_LANES_NAME(name), the functions' names, and, for x86, has set
 * their instruction set.
 *
 * The rule, its bound and their source are those of emission_absorption.c, for the whole part of
 * the ray in a cell; cells for which they do not suffice are left to it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/cell_lanes.h"
#include "trace/light_rule.h"

#ifdef __clang__
#define EACH_LANE _Pragma("clang loop vectorize(enable)") for (int l = 0; l < LR_CELL_LANES; l++)
#else
#define EACH_LANE for (int l = 0; l < LR_CELL_LANES; l++)
#endif

LR_INLINE double lesser(double a, double b)
{
    return a < b ? a : b;
}

LR_INLINE double greater(double a, double b)
{
    return a > b ? a : b;
}

/* The part of the ray in each cell, by the cell's planes alone. */
LR_INLINE void find_parts(lr_cell_lanes *k, const lr_ray *r, const lr_lanes_ray *ray)
{
    double in[LR_CELL_LANES], out[LR_CELL_LANES], graze_in[LR_CELL_LANES], graze_out[LR_CELL_LANES];
    EACH_LANE
    {
        in[l] = -INFINITY;
        out[l] = INFINITY;
        graze_in[l] = graze_out[l] = 0.0;
    }
    for (int a = 0; a < 3; a++) {
        if (r->s[a] == 0)
            continue;
        const double near = r->s[a] < 0, far = 1.0 - near;
        const double o = r->o[a], inv = r->inv[a], graze = ray->graze[a];
        EACH_LANE
        {
            const double t = (k->cell[a][l] + near - o) * inv;
            const double end = (k->cell[a][l] + far - o) * inv;
            graze_in[l] = t > in[l] ? graze : graze_in[l];
            graze_out[l] = end < out[l] ? graze : graze_out[l];
            in[l] = greater(t, in[l]);
            out[l] = lesser(end, out[l]);
        }
    }
    const double t_min = ray->t_min, t_max = ray->t_max;
    EACH_LANE
    {
        const double low = greater(in[l], t_min), high = lesser(out[l], t_max);
        const double least = greater(graze_in[l], graze_out[l]);
        const double end = out[l] - in[l] > least ? high : low;
        k->t_low[l] = low;
        k->t_high[l] = greater(end, low);
    }
}

/* The trilinear field along the ray, by the field's own coefficients at the part's beginning. */
LR_INLINE void find_cubics(lr_cell_lanes *k, const lr_ray *r)
{
    const double o[3] = {r->o[0], r->o[1], r->o[2]};
    double d[3];
    for (int a = 0; a < 3; a++)
        d[a] = r->s[a] != 0 ? r->d[a] : 0.0;
    EACH_LANE
    {
        const double size = k->t_high[l] - k->t_low[l];
        double p[3], e[3];
        for (int a = 0; a < 3; a++) {
            p[a] = lr_clamp(o[a] + k->t_low[l] * d[a] - k->cell[a][l], 0.0, 1.0);
            e[a] = size * d[a];
        }
        const double s0 = k->corner[0][l], x = k->corner[1][l] - s0, y = k->corner[2][l] - s0;
        const double z = k->corner[4][l] - s0;
        const double xy = k->corner[3][l] - k->corner[2][l] - x;
        const double xz = k->corner[5][l] - k->corner[4][l] - x;
        const double yz = k->corner[6][l] - k->corner[4][l] - y;
        const double xyz =
            k->corner[7][l] - k->corner[6][l] - (k->corner[5][l] - k->corner[4][l]) - xy;
        const double ax = x + xy * p[1] + (xz + xyz * p[1]) * p[2];
        const double ay = y + xy * p[0] + (yz + xyz * p[0]) * p[2];
        const double az = z + xz * p[0] + (yz + xyz * p[0]) * p[1];
        const double exy = e[0] * e[1];
        k->c[0][l] = s0 + x * p[0] + (y + xy * p[0]) * p[1] +
                     (z + xz * p[0] + (yz + xyz * p[0]) * p[1]) * p[2];
        k->c[1][l] = ax * e[0] + ay * e[1] + az * e[2];
        k->c[2][l] =
            (xy + xyz * p[2]) * exy + ((xz + xyz * p[1]) * e[0] + (yz + xyz * p[0]) * e[1]) * e[2];
        k->c[3][l] = xyz * exy * e[2];
    }
}

/* By their Bernstein coefficients. */
LR_INLINE void find_bounds(lr_cell_lanes *k)
{
    EACH_LANE
    {
        const double b0 = k->c[0][l], b1 = b0 + k->c[1][l] * (1.0 / 3.0);
        const double b2 = b1 + (k->c[1][l] + k->c[2][l]) * (1.0 / 3.0);
        const double b3 = b0 + k->c[1][l] + k->c[2][l] + k->c[3][l];
        k->least[l] = lesser(lesser(b0, b1), lesser(b2, b3));
        k->greatest[l] = greater(greater(b0, b1), greater(b2, b3));
    }
}

static void LR_LANES_NAME(cubics)(lr_cell_lanes *k, const lr_ray *r, const lr_lanes_ray *ray)
{
    find_parts(k, r, ray);
    find_cubics(k, r);
    find_bounds(k);
}

/* The value and the optical depth of each cell, as an lr_stretch has them. */
typedef struct lane_stretch {
    double y[3][LR_CELL_LANES], a[4][LR_CELL_LANES], depth[LR_CELL_LANES];
} lane_stretch;

LR_INLINE void set_up_lanes(lr_cell_lanes *k, const lr_lanes_ray *ray, lane_stretch *s)
{
    const double speed = ray->speed;
    EACH_LANE
    {
        const double half = 0.5 * (k->t_high[l] - k->t_low[l]) * speed;
        const double c1 = k->c[1][l], c2 = k->c[2][l], c3 = k->c[3][l];
        k->middle[l] = k->c[0][l] + 0.5 * c1 + 0.25 * c2 + 0.125 * c3 - k->from[l];
        s->y[0][l] = (c1 + c2 + 0.75 * c3) * 0.5;
        s->y[1][l] = (c2 + 1.5 * c3) * 0.25;
        s->y[2][l] = c3 * 0.125;
        const double rise = k->extinction[1][l] * half;
        const double mean = k->extinction[0][l] + k->extinction[1][l] * k->middle[l];
        s->a[0][l] = greater(mean, 0.0) * half;
        s->a[1][l] = rise * s->y[0][l] * (1.0 / 2.0);
        s->a[2][l] = rise * s->y[1][l] * (1.0 / 3.0);
        s->a[3][l] = rise * s->y[2][l] * (1.0 / 4.0);
        s->depth[l] = greater(2.0 * (s->a[0][l] + s->a[2][l]), 0.0);
    }
}

/* Bound the rule's error, which is none of one colour. exp(x) <= 1 + x + x^2 for x <= 1.79. */
LR_INLINE void judge(lr_cell_lanes *k, const lr_lanes_ray *ray, const lane_stretch *s)
{
    const double r = 4.0, most = 1.79, tolerance = 0.6 * ray->tolerance;
    EACH_LANE
    {
        const double y = ((fabs(s->y[2][l]) * r + fabs(s->y[1][l])) * r + fabs(s->y[0][l])) * r;
        const double depth =
            (((fabs(s->a[3][l]) * r + fabs(s->a[2][l])) * r + fabs(s->a[1][l])) * r + s->a[0][l]) *
            r;
        const double slope =
            ((4.0 * fabs(s->a[3][l]) * r + 3.0 * fabs(s->a[2][l])) * r + 2.0 * fabs(s->a[1][l])) *
                r +
            s->a[0][l];
        const double error =
            LR_RULE_LOST / 65536.0 * depth * (1.0 + depth + depth * depth) * y * slope * k->turn[l];
        /* a product of 0 and infinity, of what is too deep, is passed over */
        const double excess = greater(k->turn[l] * (depth - most), error - tolerance * s->depth[l]);
        k->within[l] = greater(excess, s->depth[l] - LR_RULE_DEEPEST) <= 0.0 ? 1.0 : 0.0;
    }
}

static void LR_LANES_NAME(light)(lr_cell_lanes *k, const lr_lanes_ray *ray)
{
    lane_stretch s;
    set_up_lanes(k, ray, &s);
    judge(k, ray, &s);
    double start[LR_CELL_LANES];
    bool turns = false;
    EACH_LANE
    {
        start[l] = s.a[0][l] - s.a[1][l] + s.a[2][l] - s.a[3][l]; /* depth from x = -1 to 0 */
        k->after[l] = lr_rule_exp(-lesser(s.depth[l], LR_RULE_DEEPEST));
        k->integral[l] = 0.0;
    }
    for (int l = 0; l < LR_CELL_LANES; l++)
        turns = turns || k->turn[l] != 0.0;
    if (!turns)
        return;
    for (int i = 0; i < LR_RULE_NODES; i++) {
        const double x = lr_rule_node[i], weight = lr_rule_weight[i];
        EACH_LANE
        {
            const double y = ((s.y[2][l] * x + s.y[1][l]) * x + s.y[0][l]) * x;
            const double depth =
                (((s.a[3][l] * x + s.a[2][l]) * x + s.a[1][l]) * x + s.a[0][l]) * x;
            const double slope =
                ((4.0 * s.a[3][l] * x + 3.0 * s.a[2][l]) * x + 2.0 * s.a[1][l]) * x + s.a[0][l];
            const double x_exp = lr_clamp(-depth - start[l], -1.0, 0.0);
            k->integral[l] += weight * lr_rule_exp(x_exp) * slope * y;
        }
    }
}

const lr_lanes_ops LR_LANES_NAME(lr_lanes) = {LR_LANES_NAME(cubics), LR_LANES_NAME(light)};

#undef EACH_LANE
