/* Microfacets by GGX, in the frame of the normal (z up); view and light leave the
 * surface.
 *
 * Source: Walter et al., Microfacet models for refraction through rough surfaces,
 * 2007 (distribution, half vectors, Jacobians); Heitz, Understanding the
 * masking-shadowing function, 2014 (height-correlated Smith); Heitz, Sampling the
 * GGX distribution of visible normals, 2018; Dupuy and Benyoub, Sampling visible
 * GGX normals with spherical caps, 2023 (how they are sampled here).
 * Departures: refraction has the masking of reflection, and radiance is not scaled by the
 * square of the index, both as in Cycles.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_GGX_H
#define LR_RENDER_BSDF_GGX_H

#include "base/base.h"

/* Density of the normals h (unit). */
LR_INLINE double lr_ggx_d(double alpha, const double h[3])
{
    const double t = (h[0] * h[0] + h[1] * h[1]) / (alpha * alpha) + h[2] * h[2];
    return h[2] > 0 ? 1 / (LR_PI * alpha * alpha * t * t) : 0;
}

/* Smith's lambda of a direction with that cosine to the normal, on either side. */
LR_INLINE double lr_ggx_lambda(double alpha, double cosine)
{
    const double c2 = cosine * cosine;
    return 0.5 * (sqrt(1 + alpha * alpha * (1 - c2) / c2) - 1);
}

/* A microfacet's normal, sampled among those visible from view. turn: the cosine and the sine of a
 * turn, uniform in all; v: 0..1. */
LR_INLINE void lr_ggx_sample(double alpha, const double view[3], const double turn[2], double v,
                             double h[3])
{
    double s[3] = {alpha * view[0], alpha * view[1], view[2]};
    const double length = sqrt(lr_dot(s, s));
    for (int a = 0; a < 3; a++)
        s[a] /= length;
    const double z = (1 - v) * (1 + s[2]) - s[2];
    const double r = sqrt(lr_clamp(1 - z * z, 0, 1));
    h[0] = alpha * (r * turn[0] + s[0]);
    h[1] = alpha * (r * turn[1] + s[1]);
    h[2] = fmax(z + s[2], 1e-16);
    const double norm = sqrt(lr_dot(h, h));
    for (int a = 0; a < 3; a++)
        h[a] /= norm;
}

/* Reflectance of a smooth dielectric under that cosine (>= 0); n: index of the far
 * side over that of the near side. */
LR_INLINE double lr_fresnel(double cosine, double n)
{
    const double g2 = n * n - 1 + cosine * cosine;
    if (!(g2 > 0))
        return 1;
    const double g = sqrt(g2);
    const double a = (g - cosine) / (g + cosine);
    const double b = ((g + cosine) * cosine - 1) / ((g - cosine) * cosine + 1);
    return 0.5 * a * a * (1 + b * b);
}

/* The same at normal incidence. */
LR_INLINE double lr_fresnel_0(double n)
{
    return (n - 1) * (n - 1) / ((n + 1) * (n + 1));
}

/* view mirrored in h. */
LR_INLINE void lr_reflect(const double view[3], const double h[3], double light[3])
{
    const double c = 2 * lr_dot(view, h);
    for (int a = 0; a < 3; a++)
        light[a] = c * h[a] - view[a];
}

/* view refracted through a facet with normal h; false for total internal reflection. */
LR_INLINE bool lr_refract(const double view[3], const double h[3], double n, double light[3])
{
    const double c = lr_dot(view, h);
    const double t2 = 1 - (1 - c * c) / (n * n);
    if (!(t2 > 0))
        return false;
    const double along = c / n - sqrt(t2);
    for (int a = 0; a < 3; a++)
        light[a] = along * h[a] - view[a] / n;
    return true;
}

#endif
