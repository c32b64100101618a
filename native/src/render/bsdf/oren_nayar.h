/* Rough diffuse reflection, in the frame of the normal (z up), stronger towards the light
 * than Lambert's.
 *
 * Source: Fujii, A tiny improvement of Oren-Nayar reflectance model; several bounces between
 * the facets by the OpenPBR specification, 2024. Both as in Cycles, so that several bounces
 * are tinted twice.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_OREN_NAYAR_H
#define LR_RENDER_BSDF_OREN_NAYAR_H

#include "render/bsdf/ggx.h"

/* Single-bounce response for viewer and light along the normal, over Lambert's. */
LR_INLINE double lr_oren_nayar_level(double rough)
{
    return 1 / (1 + rough * (0.5 - 2 / (3 * LR_PI)));
}

/* The albedo of single bounces as seen under a cosine. */
LR_INLINE double lr_oren_nayar_albedo(double rough, double cosine)
{
    const double s = sqrt(fmax(1 - cosine * cosine, 0)), angle = acos(lr_clamp(cosine, 0, 1));
    const double tail = cosine > 1e-6 ? s / cosine * (1 - s * s * s) : 0; /* its limit is 0 */
    const double g = s * (angle - 2.0 / 3 - s * cosine) + 2.0 / 3 * tail;
    return lr_oren_nayar_level(rough) * (1 + rough * g / LR_PI);
}

/* The factor of several bounces that does not depend on the light. tint: the light left by a
 * bounce. */
LR_INLINE double lr_oren_nayar_multiple(double rough, double cos_view, double tint)
{
    if (rough == 0)
        return 0;
    const double mean = lr_oren_nayar_level(rough) * (1 + rough * (2.0 / 3 - 5.6 / (3 * LR_PI)));
    return tint * tint * mean / (1 - mean) * (1 - lr_oren_nayar_albedo(rough, cos_view)) /
           (1 - tint * (1 - mean));
}

/* The response over that of Lambert's. */
LR_INLINE double lr_oren_nayar(double rough, double again, const double view[3],
                               const double light[3])
{
    if (rough == 0)
        return 1;
    double t = lr_dot(view, light) - view[2] * light[2];
    if (t > 0)
        t /= fmax(view[2], light[2]);
    return lr_oren_nayar_level(rough) * (1 + rough * t) +
           again * (1 - lr_oren_nayar_albedo(rough, light[2]));
}

#endif
