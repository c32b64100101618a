/* Shading by the gradient.
 *
 * Source: Levoy, Display of surfaces from volume data, 1988 (the gradient as normal); Kroes, Post,
 * Botha, Exposure render, 2012 (surfaces beside the phase function, by the gradient's length).
 * Departures: both respond at every point, weighted, where Kroes et al. choose one at random; the
 * surface is a dielectric over a diffuse base, which keeps all light.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/gradient_shading.h"

static const double IOR = 1.5; /* of specular 0.5, as of Blender's Principled BSDF */

double lr_gradient_share(const lr_gradient_shading *shading, double slope)
{
    return shading->amount * -expm1(-shading->scale * slope);
}

void lr_gradient_surface(const lr_gradient_shading *shading, const double color[3],
                         const lr_point *point, lr_bsdf *surface)
{
    const lr_lobe lobe = {
        .kind = LR_LOBE_PRINCIPLED,
        .flags = LR_LOBE_MULTISCATTER,
        .weight = 1,
        .color = {color[0], color[1], color[2]},
        .roughness = fmax(shading->roughness, LR_GRADIENT_ROUGHNESS_MIN),
        .ior = IOR,
        .specular = shading->specular,
        .specular_tint = {1, 1, 1},
        .alpha = 1,
    };
    const lr_material material = {.lobes = &lobe, .n_lobes = 1, .ior = IOR};
    lr_bsdf_at(&material, point, surface);
}

/* The probabilities of the phase function, [0], and of the surface's groups, about in proportion to
 * what they scatter. */
static void probabilities(const lr_hybrid *h, const lr_bsdf *surface,
                          double probability[LR_RAY_GLOSSY + 1])
{
    const double mean = (h->color[0] + h->color[1] + h->color[2]) / 3;
    double sum = probability[0] = (1 - h->share) * mean;
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_GLOSSY; kind++)
        sum += probability[kind] = h->share * surface->albedo[kind];
    for (int k = 0; k <= LR_RAY_GLOSSY; k++)
        probability[k] /= sum;
}

lr_response lr_hybrid_eval(const lr_hybrid *h, const lr_bsdf *surface, const double view[3],
                           const double light[3])
{
    lr_response sum = lr_phase_eval(h->phase, view, light);
    for (int a = 0; a < 3; a++)
        sum.f_cos[a] *= (1 - h->share) * h->color[a];
    if (!(h->share > 0))
        return sum;
    double probability[LR_RAY_GLOSSY + 1];
    lr_response group[LR_GROUPS];
    probabilities(h, surface, probability);
    lr_bsdf_eval(surface, light, group);
    sum.pdf *= probability[0];
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_GLOSSY; kind++) {
        const lr_response *r = &group[kind - 1];
        sum.pdf += probability[kind] * r->pdf;
        for (int a = 0; a < 3; a++)
            sum.f_cos[a] += h->share * r->f_cos[a];
    }
    return sum;
}

bool lr_hybrid_sample(const lr_hybrid *h, const lr_bsdf *surface, const double view[3],
                      const double u[3], lr_scatter *scatter)
{
    double probability[LR_RAY_GLOSSY + 1] = {1};
    double x[3] = {u[0], u[1], u[2]};
    int chosen = 0;
    if (h->share > 0)
        probabilities(h, surface, probability);
    while (chosen < LR_RAY_GLOSSY && x[2] >= probability[chosen])
        x[2] -= probability[chosen++];
    if (!(probability[chosen] > 0)) /* rounding left a rest */
        return false;
    x[2] = fmin(x[2] / probability[chosen], 1 - 0x1p-53);
    if (chosen == 0)
        *scatter = lr_phase_sample(h->phase, view, x);
    else if (!lr_bsdf_sample(surface, chosen, x, scatter))
        return false;
    scatter->kind = LR_RAY_VOLUME;
    for (int a = 0; a < 3; a++)
        scatter->weight[a] *= chosen == 0 ? (1 - h->share) * h->color[a] : h->share;
    if (!(h->share > 0))
        return true;
    for (int a = 0; a < 3; a++)
        scatter->weight[a] /= probability[chosen];
    scatter->pdf = lr_hybrid_eval(h, surface, view, scatter->direction).pdf;
    return scatter->pdf > 0;
}
