/* How much light GGX microfacets reflect after one bounce: what is missing to one goes between
 * them.
 *
 * Tables made by generate_albedo.py, in steps of 1/65535; mu is the cosine of the
 * view, rough the square root of GGX's alpha, n the index of the far side over that
 * of the near side.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_ALBEDO_REFLECTION_H
#define LR_RENDER_BSDF_ALBEDO_REFLECTION_H

#include "base/base.h"

enum { LR_ALBEDO_FINE = 32, LR_ALBEDO_COARSE = 16 };

/* [rough][mu] of facets that reflect all. */
extern const uint16_t lr_albedo_mirror[LR_ALBEDO_FINE][LR_ALBEDO_FINE];
/* [rough] the same, averaged over the hemisphere. */
extern const uint16_t lr_albedo_mirror_mean[LR_ALBEDO_FINE];
/* [rough][mu][z], z = sqrt |n - 1| / (n + 1): of a dielectric that reflects nothing at normal
 * incidence and all at grazing angles, as a fraction of that of facets that reflect all. */
extern const uint16_t lr_albedo_dielectric[LR_ALBEDO_COARSE][LR_ALBEDO_COARSE][LR_ALBEDO_COARSE];

#endif
