/* How much light GGX microfacets of glass reflect and refract after one bounce; axes as in
 * albedo_reflection.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_ALBEDO_GLASS_H
#define LR_RENDER_BSDF_ALBEDO_GLASS_H

#include "render/bsdf/albedo_reflection.h"

/* [into the denser side, out of it][rough][mu][z]. */
extern const uint16_t lr_albedo_glass[2][LR_ALBEDO_COARSE][LR_ALBEDO_COARSE][LR_ALBEDO_COARSE];
/* [..][rough][z] the same, averaged over the hemisphere. */
extern const uint16_t lr_albedo_glass_mean[2][LR_ALBEDO_COARSE][LR_ALBEDO_COARSE];

#endif
