/* Gradients at samples of rays side by side: how much of each sample they let be seen, and how one
 * light, which nothing shadows, lights it. Included by ray_samples_impl.h.
 *
 * Source: Levoy, Display of surfaces from volume data, 1988 (the gradient as a normal, and as a
 * factor of opacity); Phong, Illumination for computer generated pictures, 1975.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/value_gradient.h"

#define LR_NUMBER        lr_doubles
#define LR_FORMULA(name) name##_lanes
#include "grid/trilinear_impl.h"

/* The samples of central differences at the corners of cells. */
typedef struct gradient_lanes {
    _Alignas(64) double around[LR_AROUND][LR_DOUBLE_LANES];
} gradient_lanes;

static const int AROUND_STRIDE[3] = {1, 4, 16};

/* Sample of gradient_lanes.around that is corner n of the cell. */
LR_INLINE int around_corner(int n)
{
    return 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
}

LR_INLINE lr_doubles dot(const lr_doubles a[3], const lr_doubles b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

LR_INLINE void to_object(const lr_volume *v, const lr_doubles g[3], lr_doubles out[3])
{
    const double *m = v->storage_from_object;
    for (int i = 0; i < 3; i++)
        out[i] = m[i] * g[0] + m[4 + i] * g[1] + m[8 + i] * g[2];
}

/* As lr_values_around: values beside the cell that are none continue the line through it. */
LR_INLINE void continue_lines(gradient_lanes *g, double outside)
{
    for (int a = 0; a < 3; a++)
        for (int n = 0; n < 8; n++) {
            const int s = n >> a & 1 ? AROUND_STRIDE[a] : -AROUND_STRIDE[a];
            const lr_doubles own = lr_load_doubles(g->around[around_corner(n)]);
            const lr_doubles other = lr_load_doubles(g->around[around_corner(n) - s]);
            double *const at = g->around[around_corner(n) + s];
            const lr_doubles beside = lr_load_doubles(at);
            lr_store_doubles(at, lr_pick_doubles(beside == outside, own + (own - other), beside));
        }
}

/* The samples around the cells of packed samples from n on, those of bits. */
LR_INLINE void load_around(gradient_lanes *g, const lr_volume *v, const int32_t c[3][MOST_SAMPLES],
                           int n, uint32_t bits, int32_t type)
{
    for (; bits != 0; bits &= bits - 1) {
        const int l = __builtin_ctz(bits);
        const int32_t cell[3] = {c[0][n + l], c[1][n + l], c[2][n + l]};
        lr_cross_around_of(v, type, cell, &g->around[0][l], LR_DOUBLE_LANES);
    }
    if (v->bounded)
        continue_lines(g, v->outside);
}

/* Twice the central difference along axis a at corner n. */
LR_INLINE lr_doubles central_difference(const gradient_lanes *g, int n, int a)
{
    const int at = around_corner(n), s = AROUND_STRIDE[a];
    return 0.5 * (lr_load_doubles(g->around[at + s]) - lr_load_doubles(g->around[at - s]));
}

LR_INLINE void central_gradients(const gradient_lanes *g, const lr_doubles p[3],
                                 lr_doubles slope[3])
{
    for (int a = 0; a < 3; a++) {
        lr_doubles corner[8];
        for (int n = 0; n < 8; n++)
            corner[n] = central_difference(g, n, a);
        slope[a] = lr_trilinear_lanes(corner, p);
    }
}

/* As lr_modulation_at, interpolated at the samples; 0 where cells have a corner that is no value.
 */
LR_INLINE lr_doubles modulation(const gradient_lanes *g, const lr_volume *v, const lr_doubles p[3])
{
    const double full = v->transfer->full_gradient;
    const lr_doubles zero = {0}, one = lr_all_doubles(1.0);
    lr_doubles share[8], has = one;
    for (int n = 0; n < 8; n++) {
        lr_doubles own[3], object[3];
        for (int a = 0; a < 3; a++)
            own[a] = central_difference(g, n, a);
        to_object(v, own, object);
        share[n] = lr_lesser_lanes(lr_root_doubles(dot(object, object)) / full, one);
        if (v->bounded)
            has = lr_pick_doubles(lr_load_doubles(g->around[around_corner(n)]) == v->outside, zero,
                                  has);
    }
    return has * lr_clamp_doubles(lr_trilinear_lanes(share, p), zero, one);
}

/* Towards the light, unit; 0, 0, 0: at the viewer. */
static void find_lamp(const lr_phong *phong, double lamp[3])
{
    const double *to = phong->light; /* may be so short that its square is 0 */
    const double most = fmax(fabs(to[0]), fmax(fabs(to[1]), fabs(to[2])));
    for (int a = 0; a < 3; a++)
        lamp[a] = most > 0.0 ? to[a] / most : 0.0;
    const double length = sqrt(lr_dot(lamp, lamp));
    for (int a = 0; a < 3 && most > 0.0; a++)
        lamp[a] /= length;
}

/* How normals that face the viewer are lit, which colours are multiplied by and what is added to
 * them; without a gradient, by ambient light alone. view: towards the viewer, unit. */
LR_INLINE void light_normals(const lr_volume *v, const lr_doubles slope[3],
                             const lr_doubles view[3], const double lamp[3], const lr_phong *phong,
                             lr_doubles *share, lr_doubles *highlight)
{
    const lr_doubles zero = {0}, one = lr_all_doubles(1.0), none = lr_all_doubles(INFINITY);
    const bool beside = lamp[0] == 0.0 && lamp[1] == 0.0 && lamp[2] == 0.0; /* the viewer */
    lr_doubles n[3], to[3];
    for (int a = 0; a < 3; a++)
        to[a] = beside ? view[a] : lr_all_doubles(lamp[a]);
    to_object(v, slope, n);
    const lr_doubles square = dot(n, n);
    const lr_doubles size =
        lr_pick_doubles((square > 0.0) & (square < INFINITY), lr_root_doubles(square), none);
    const lr_doubles faces = dot(n, view), side = lr_pick_doubles(faces < 0.0, -one, one);
    const lr_doubles nl = side * dot(n, to) / size;
    *share = phong->ambient + phong->diffuse * lr_pick_doubles(nl > 0.0, nl, zero);
    *highlight = zero;
    if (!(phong->specular > 0.0))
        return;
    const lr_doubles nv = lr_absolute_doubles(faces / size);
    const lr_doubles along = 2.0 * nl * nv - dot(to, view); /* of the reflection */
    lr_doubles base = lr_pick_doubles((nl > 0.0) & (along > 0.0), along, zero), shine = one;
    for (uint32_t left = (uint32_t)phong->power; left > 0; left >>= 1) {
        shine *= left & 1 ? base : one;
        base *= base;
    }
    *highlight = phong->specular * shine;
}
