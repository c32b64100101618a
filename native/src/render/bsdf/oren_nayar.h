/* Rough diffuse surfaces, in the frame of the normal (z up): grooves that send light back
 * to where it came from.
 *
 * Source: Fujii, A tiny improvement of Oren-Nayar reflectance model; the light that
 * bounces several times between the grooves after the OpenPBR specification, 2024.
 * Both as Cycles has them; so the colour of such light is taken up twice.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_OREN_NAYAR_H
#define LR_RENDER_BSDF_OREN_NAYAR_H

#include "render/bsdf/ggx.h"

/* What a single bounce reflects of light that comes from where the viewer is, from above. */
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

/* What comes back by several bounces, but for what depends on the light. tint: what is left of
 * light by a bounce. */
LR_INLINE double lr_oren_nayar_multiple(double rough, double cos_view, double tint)
{
    if (rough == 0)
        return 0;
    const double mean = lr_oren_nayar_level(rough) * (1 + rough * (2.0 / 3 - 5.6 / (3 * LR_PI)));
    return tint * tint * mean / (1 - mean) * (1 - lr_oren_nayar_albedo(rough, cos_view)) /
           (1 - tint * (1 - mean));
}

/* How much more a rough surface sends to the viewer than a smooth one. */
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
