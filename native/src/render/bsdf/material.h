/* Materials as the renderer keeps them.
 *
 * A material is the sum of a short list of lobes; mixes of shaders are in their weights.
 * Flags that the integrator needs are derived once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_MATERIAL_H
#define LR_RENDER_BSDF_MATERIAL_H

#include "base/base.h"

typedef enum lr_material_flag {
    LR_MATERIAL_SCATTERS = 1, /* some lobe reflects or refracts */
    LR_MATERIAL_EMITS = 2,
    LR_MATERIAL_CLEAR = 4, /* some light goes straight through */
    LR_MATERIAL_REFRACTS = 8,
    LR_MATERIAL_ABSORBS = 16 /* inside solids */
} lr_material_flag;

typedef struct lr_material {
    const lr_lobe *lobes;
    uint32_t n_lobes;
    uint32_t flags; /* lr_material_flag */
    int32_t index;  /* of the material index pass */
    double ior;     /* of the first lobe that refracts; 1 without */
    double absorption[3];
} lr_material;

/* LR_E_ARGUMENT if the description of material i is invalid. */
lr_status lr_material_check(const lr_material_desc *desc, uint64_t i, lr_error *error);

/* Make a material from a valid description; lobes, its copy of the lobes, must stay. */
void lr_material_make(const lr_material_desc *desc, lr_lobe *lobes, lr_material *material);

#endif
