/* Checks materials, and derives their flags once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/material.h"

#include "base/error.h"

static bool is_color(const double c[3])
{
    for (int a = 0; a < 3; a++)
        if (!isfinite(c[a]) || c[a] < 0)
            return false;
    return true;
}

static bool is_black(const double c[3])
{
    return c[0] == 0 && c[1] == 0 && c[2] == 0;
}

static lr_status check_color(const double c[3], const char *name, uint64_t i, lr_error *error)
{
    if (is_color(c))
        return LR_OK;
    return lr_fail(error, LR_E_ARGUMENT,
                   "material %llu must have a finite %s of 0 or more, it has (%g, %g, %g)",
                   (unsigned long long)i, name, c[0], c[1], c[2]);
}

static lr_status check_fraction(double x, const char *name, uint64_t i, lr_error *error)
{
    if (x >= 0 && x <= 1)
        return LR_OK;
    return lr_fail(error, LR_E_ARGUMENT, "material %llu must have a %s of 0 to 1, it has %g",
                   (unsigned long long)i, name, x);
}

static lr_status check_principled(const lr_lobe *lobe, uint64_t i, lr_error *error)
{
    lr_status status = check_fraction(lobe->metallic, "metallic", i, error);
    if (status == LR_OK)
        status = check_fraction(lobe->specular, "specular level", i, error);
    if (status == LR_OK)
        status = check_fraction(lobe->transmission, "transmission", i, error);
    if (status == LR_OK)
        status = check_fraction(lobe->alpha, "alpha", i, error);
    if (status == LR_OK)
        status = check_color(lobe->specular_tint, "specular tint", i, error);
    if (status == LR_OK)
        status = check_color(lobe->emission, "emission", i, error);
    return status;
}

static lr_status check_lobe(const lr_lobe *lobe, uint64_t i, lr_error *error)
{
    if (lobe->kind < LR_LOBE_DIFFUSE || lobe->kind > LR_LOBE_PRINCIPLED)
        return lr_fail(error, LR_E_ARGUMENT,
                       "material %llu must have lobes of kinds %d to %d, one is of kind %d",
                       (unsigned long long)i, LR_LOBE_DIFFUSE, LR_LOBE_PRINCIPLED, lobe->kind);
    if (!(lobe->weight >= 0 && isfinite(lobe->weight)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "material %llu must have finite weights of 0 or more, one is %g",
                       (unsigned long long)i, lobe->weight);
    if (!(lobe->ior > 0 && isfinite(lobe->ior)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "material %llu must have a finite index of refraction above 0, it has %g",
                       (unsigned long long)i, lobe->ior);
    lr_status status = check_color(lobe->color, "color", i, error);
    if (status == LR_OK)
        status = check_fraction(lobe->roughness, "roughness", i, error);
    if (status == LR_OK && lobe->kind == LR_LOBE_PRINCIPLED)
        status = check_principled(lobe, i, error);
    return status;
}

static lr_status check_glow(const double glow[3], uint64_t i, lr_error *error)
{
    if (lr_all_finite(glow, 3))
        return LR_OK;
    return lr_fail(error, LR_E_ARGUMENT,
                   "material %llu must have a finite glow, it is (%g, %g, %g)",
                   (unsigned long long)i, glow[0], glow[1], glow[2]);
}

static lr_status check_medium(const lr_material_desc *desc, uint64_t i, lr_error *error)
{
    lr_status status = check_color(desc->absorption, "absorption", i, error);
    if (status == LR_OK)
        status = check_color(desc->scattering, "scattering", i, error);
    if (status == LR_OK)
        status = check_glow(desc->glow, i, error);
    if (status != LR_OK)
        return status;
    if (desc->phase != LR_PHASE_HENYEY_GREENSTEIN && desc->phase != LR_PHASE_RAYLEIGH)
        return lr_fail(
            error, LR_E_ARGUMENT, "the phase function of material %llu must be %d or %d, it is %d",
            (unsigned long long)i, LR_PHASE_HENYEY_GREENSTEIN, LR_PHASE_RAYLEIGH, desc->phase);
    if (!(fabs(desc->anisotropy) <= 1))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the anisotropy of material %llu must lie between -1 and 1, it is %g",
                       (unsigned long long)i, desc->anisotropy);
    if (desc->bare != 0 && desc->n_lobes > 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "material %llu must have no lobes, as it has no surface; it has %u",
                       (unsigned long long)i, desc->n_lobes);
    return LR_OK;
}

lr_status lr_material_check(const lr_material_desc *desc, uint64_t i, lr_error *error)
{
    if (desc->n_lobes > LR_LOBES_MAX)
        return lr_fail(error, LR_E_SIZE, "material %llu must have at most %d lobes, it has %u",
                       (unsigned long long)i, LR_LOBES_MAX, desc->n_lobes);
    if (desc->n_lobes > 0 && desc->lobes == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "the lobes of material %llu are NULL",
                       (unsigned long long)i);
    lr_status status = check_medium(desc, i, error);
    for (uint32_t k = 0; k < desc->n_lobes && status == LR_OK; k++)
        status = check_lobe(&desc->lobes[k], i, error);
    return status;
}

/* The flags of one lobe. */
static uint32_t flags_of(const lr_lobe *lobe)
{
    if (lobe->weight == 0)
        return 0;
    switch (lobe->kind) {
    case LR_LOBE_TRANSPARENT:
        return LR_MATERIAL_CLEAR;
    case LR_LOBE_EMISSION:
        return is_black(lobe->color) ? 0 : LR_MATERIAL_EMITS;
    case LR_LOBE_GLASS:
    case LR_LOBE_REFRACTION:
        return LR_MATERIAL_SCATTERS | LR_MATERIAL_REFRACTS;
    case LR_LOBE_PRINCIPLED:
        return (lobe->alpha < 1 ? LR_MATERIAL_CLEAR : 0) |
               (lobe->alpha > 0 ? LR_MATERIAL_SCATTERS : 0) |
               (lobe->alpha * lobe->transmission * (1 - lobe->metallic) > 0 ? LR_MATERIAL_REFRACTS
                                                                            : 0) |
               (lobe->alpha > 0 && !is_black(lobe->emission) ? LR_MATERIAL_EMITS : 0);
    default:
        return LR_MATERIAL_SCATTERS;
    }
}

/* What fills the solids of a material, and its flag. */
static uint32_t fill(const lr_material_desc *desc, lr_material *material)
{
    lr_medium *medium = &material->medium;
    for (int a = 0; a < 3; a++) {
        medium->extinction[a] = desc->absorption[a] + desc->scattering[a];
        medium->scattering[a] = desc->scattering[a];
        medium->glow[a] = desc->glow[a];
    }
    material->phase =
        (lr_phase){desc->phase, lr_clamp(desc->anisotropy, -LR_ANISOTROPY_MAX, LR_ANISOTROPY_MAX)};
    return is_black(medium->extinction) && is_black(medium->glow) ? 0 : LR_MATERIAL_FILLS;
}

void lr_material_make(const lr_material_desc *desc, lr_lobe *lobes, lr_material *material)
{
    *material = (lr_material){
        .lobes = lobes,
        .n_lobes = desc->n_lobes,
        .index = desc->index,
        .ior = 1,
    };
    material->flags = fill(desc, material);
    if (desc->bare != 0) {
        lobes[0] =
            (lr_lobe){.kind = LR_LOBE_TRANSPARENT, .weight = 1, .color = {1, 1, 1}, .ior = 1};
        material->n_lobes = 1;
        material->flags |= LR_MATERIAL_BARE | LR_MATERIAL_CLEAR;
    }
    for (uint32_t k = 0; k < desc->n_lobes; k++) {
        lobes[k] = desc->lobes[k];
        const uint32_t flags = flags_of(&lobes[k]);
        if ((flags & ~material->flags & LR_MATERIAL_REFRACTS) != 0)
            material->ior = lobes[k].ior;
        material->flags |= flags;
    }
}
