/* Gradients at samples of rays side by side: how much of each sample they let be seen, and how one
 * light, which nothing shadows, lights it. Included by ray_samples_impl.h.
 *
 * Source: Levoy, Display of surfaces from volume data, 1988 (the gradient as a normal, and as a
 * factor of opacity); Phong, Illumination for computer generated pictures, 1975.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/value_gradient.h"

typedef struct gradient_lanes {
    _Alignas(64) double around[LR_AROUND][LANES]; /* those of central differences at corners */
    double object[3][LANES];                      /* the gradient in object space */
    double seen[LANES];                           /* the share that the gradient's length lets be */
    double lit[LANES], highlight[LANES];          /* of diffuse and of specular light */
} gradient_lanes;

static const int AROUND_STRIDE[3] = {1, 4, 16};

/* Sample of gradient_lanes.around that is corner n of the cell. */
LR_INLINE int around_corner(int n)
{
    return 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
}

/* As lr_values_around: values beside the cell that are none continue the line through it. */
LR_INLINE void continue_lines(gradient_lanes *g, double outside)
{
    for (int a = 0; a < 3; a++)
        for (int n = 0; n < 8; n++) {
            const int s = n >> a & 1 ? AROUND_STRIDE[a] : -AROUND_STRIDE[a];
            const double *const own = g->around[around_corner(n)];
            const double *const other = g->around[around_corner(n) - s];
            double *const beside = g->around[around_corner(n) + s];
            EACH_LANE
            beside[l] = beside[l] == outside ? own[l] + (own[l] - other[l]) : beside[l];
        }
}

/* The samples around the cells of lanes that count. */
LR_INLINE void load_around(gradient_lanes *g, const lr_volume *v, const int32_t c[3][LANES],
                           const double counts[LANES], int32_t type)
{
    for (int l = 0; l < LANES; l++) {
        const int32_t cell[3] = {c[0][l], c[1][l], c[2][l]};
        if (counts[l] != 0.0)
            lr_cross_around_of(v, type, cell, &g->around[0][l], LANES);
    }
    if (v->bounded)
        continue_lines(g, v->outside);
}

/* Where cells have a corner that is no value, 0. */
LR_INLINE void find_values(const gradient_lanes *g, const lr_volume *v, double has[LANES])
{
    EACH_LANE
    has[l] = 1.0;
    for (int n = 0; n < 8 && v->bounded; n++) {
        const double *const corner = g->around[around_corner(n)];
        EACH_LANE
        has[l] = corner[l] == v->outside ? 0.0 : has[l];
    }
}

LR_INLINE void central_gradients(gradient_lanes *g, const lr_volume *v, double p[3][LANES])
{
    double slope[3][LANES];
    for (int a = 0; a < 3; a++) {
        const int s = AROUND_STRIDE[a];
        EACH_LANE
        {
            const double at[3] = {p[0][l], p[1][l], p[2][l]};
            double corner[8];
            for (int n = 0; n < 8; n++)
                corner[n] =
                    0.5 * (g->around[around_corner(n) + s][l] - g->around[around_corner(n) - s][l]);
            slope[a][l] = lr_trilinear(corner, at);
        }
    }
    EACH_LANE
    {
        const double own[3] = {slope[0][l], slope[1][l], slope[2][l]};
        double object[3];
        lr_map_gradient(v->storage_from_object, own, object);
        for (int a = 0; a < 3; a++)
            g->object[a][l] = object[a];
    }
}

/* The gradient of the trilinear field itself. */
LR_INLINE void analytic_gradients(gradient_lanes *g, const lr_volume *v, double corner[8][LANES],
                                  double p[3][LANES])
{
    EACH_LANE
    {
        const double at[3] = {p[0][l], p[1][l], p[2][l]};
        double s[8], own[3], object[3];
        for (int n = 0; n < 8; n++)
            s[n] = corner[n][l];
        lr_trilinear_gradient(s, at, own);
        lr_map_gradient(v->storage_from_object, own, object);
        for (int a = 0; a < 3; a++)
            g->object[a][l] = object[a];
    }
}

/* As lr_modulation_at, interpolated at the samples. */
LR_INLINE void modulate(gradient_lanes *g, const lr_volume *v, double p[3][LANES])
{
    const double full = v->transfer->full_gradient;
    double share[8][LANES], has[LANES];
    find_values(g, v, has);
    for (int n = 0; n < 8; n++) {
        const int at = around_corner(n);
        EACH_LANE
        {
            double own[3], object[3];
            for (int a = 0; a < 3; a++)
                own[a] = 0.5 * (g->around[at + AROUND_STRIDE[a]][l] -
                                g->around[at - AROUND_STRIDE[a]][l]);
            lr_map_gradient(v->storage_from_object, own, object);
            const double part = sqrt(lr_dot(object, object)) / full;
            share[n][l] = part < 1.0 ? part : 1.0;
        }
    }
    EACH_LANE
    {
        const double at[3] = {p[0][l], p[1][l], p[2][l]};
        double corner[8];
        for (int n = 0; n < 8; n++)
            corner[n] = share[n][l];
        g->seen[l] = has[l] * lr_clamp(lr_trilinear(corner, at), 0.0, 1.0);
    }
}

/* How normals that face the viewer are lit; without a gradient, not at all. view: towards the
 * viewer, unit; light: towards the light, unit. */
LR_INLINE void light_normals(gradient_lanes *g, double view[3][LANES], double light[3][LANES],
                             int32_t power)
{
    double base[LANES];
    EACH_LANE
    {
        const double n[3] = {g->object[0][l], g->object[1][l], g->object[2][l]};
        const double v[3] = {view[0][l], view[1][l], view[2][l]};
        const double to[3] = {light[0][l], light[1][l], light[2][l]};
        const double square = lr_dot(n, n);
        const double size = square > 0.0 && square < INFINITY ? sqrt(square) : INFINITY;
        const double nv = lr_dot(n, v) / size, side = nv < 0.0 ? -1.0 : 1.0;
        const double nl = side * lr_dot(n, to) / size;
        const double along = 2.0 * nl * fabs(nv) - lr_dot(to, v); /* of the reflection */
        g->lit[l] = nl > 0.0 ? nl : 0.0;
        base[l] = nl > 0.0 && along > 0.0 ? along : 0.0;
        g->highlight[l] = 1.0;
    }
    for (uint32_t left = (uint32_t)power; left > 0; left >>= 1)
        EACH_LANE
        {
            g->highlight[l] *= left & 1 ? base[l] : 1.0;
            base[l] *= base[l];
        }
}
