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
    LR_MATERIAL_FILLS = 16, /* solids with what absorbs, scatters or emits light */
    LR_MATERIAL_BARE = 32   /* no surface, just what fills it */
} lr_material_flag;

/* Into which directions a point of a volume scatters light. */
typedef struct lr_phase {
    int32_t kind; /* lr_phase_kind */
    double g;     /* mean cosine, within LR_ANISOTROPY_MAX */
} lr_phase;

/* A beam has no density; as in Cycles. */
#define LR_ANISOTROPY_MAX 0.999

/* What light meets in a homogeneous solid, per unit of world length. */
typedef struct lr_medium {
    double extinction[3]; /* absorption and scattering */
    double scattering[3];
    double glow[3]; /* radiance that is added */
} lr_medium;

typedef struct lr_material {
    const lr_lobe *lobes;
    uint32_t n_lobes;
    uint32_t flags; /* lr_material_flag */
    int32_t index;  /* of the material index pass */
    double ior;     /* of the first lobe that refracts; 1 without */
    lr_medium medium;
    lr_phase phase; /* of what the medium scatters */
} lr_material;

/* LR_E_ARGUMENT if the description of material i is invalid. */
lr_status lr_material_check(const lr_material_desc *desc, uint64_t i, lr_error *error);

/* Make a material from a valid description; lobes, its copy of the lobes, must stay. */
void lr_material_make(const lr_material_desc *desc, lr_lobe *lobes, lr_material *material);

#endif
